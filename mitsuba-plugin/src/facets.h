#pragma once

#include <mitsuba/render/microfacet.h>

#include "ggx_reflection.h"
#include "sgtd_distribution.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * Facets that reflect, with one interface for what they run on: `ReflectingFacets` for the
 * distributions of this project, `BuiltinFacets` for Mitsuba's own GGX and Beckmann.
 *
 * Where they differ is here and nowhere else: in the guards that each needs, and in the order of
 * operations, which the built-in ones have from `roughconductor` to the last. A guard that one does
 * not need is a constant or returns what it got, and leaves no operation behind.
 */
template <typename Float, typename Spectrum, typename Distribution> class ReflectingFacets {
public:
    MI_IMPORT_TYPES()

    /// What a pair of directions gives: D, masking, and the density of the outgoing one.
    struct At {
        Float d, g, pdf;
    };

    /// A reflection that was drawn: its facet and the density of that, the direction, and the
    /// weight if facets were perfect mirrors.
    struct Drawn {
        Normal3f m;
        Float pdf;
        Vector3f wo;
        Float weight;
        Mask valid;
    };

    template <typename... Args> ReflectingFacets(const Float &alpha_u, const Float &alpha_v,
                                                 bool correlated, const Args &...args)
        : m_distr(args...), m_alpha_u(alpha_u), m_alpha_v(alpha_v), m_correlated(correlated) {}

    /// The roughness that the distribution has.
    const Float &alpha_u() const { return m_alpha_u; }
    const Float &alpha_v() const { return m_alpha_v; }

    template <bool Value, bool Pdf>
    At at(const Vector3f &wi, const Vector3f &wo, const Vector3f &m) const {
        return to_outgoing<Pdf>(m_distr.template reflected<Value, Pdf>(wi, wo, m_correlated), wo,
                                m);
    }

    Drawn draw(const Vector3f &wi, const Point2f &u) const {
        return take(m_distr.sample_reflection(wi, u, m_correlated), wi);
    }

    /// Both for one view.
    std::pair<At, Drawn> at_and_draw(const Vector3f &wi, const Vector3f &wo, const Vector3f &m,
                                     const Point2f &u) const {
        auto [at, drawn] = m_distr.reflected_and_sample(wi, wo, u, m_correlated);
        return { to_outgoing<true>(at, wo, m), take(drawn, wi) };
    }

    /// Products of denormal cosines are 0, and their quotients not a number.
    static Mask defined(const Mask &active, const Float &cos_i, const Float &cos_o) {
        return active && dr::minimum(cos_i, cos_o) > 1e-30f;
    }

    /// Is there light? `finite` says whether the value, made from D, is one that single precision
    /// holds: within 1e-18 of grazing, D and 1/cos leave it.
    static Mask lit(const Mask &active, const Float &D, const Mask &finite) {
        return active && D != 0.f && finite;
    }

    /// Is there a density? If the value was asked for, `lit` says where it is.
    static Mask dense(const Mask &active, const Mask &, const Float &pdf) {
        return active && dr::isfinite(pdf);
    }

    /// A cosine to the facet as Fresnel's equations bear it: below 1e-10 its square is 0, and they
    /// are 0/0 for eta = 1.
    static Float incidence(const Float &cosine) { return dr::maximum(cosine, 1e-10f); }

private:
    template <bool Pdf, typename Reflected>
    static At to_outgoing(const Reflected &at, const Vector3f &wo, const Vector3f &m) {
        if constexpr (Pdf)
            return { at.d, at.g, at.pdf / (4.f * dr::maximum(dr::dot(wo, m), 1e-18f)) };
        else
            return { at.d, at.g, 0.f };
    }

    template <typename Sample> static Drawn take(const Sample &s, const Vector3f &wi) {
        Float facing = dr::dot(wi, s.m);
        Vector3f wo  = reflect(wi, s.m);
        // A cosine below 1e-7 is the rounding of the reflection, its sign included
        return { s.m, s.pdf, wo, s.d_over_pdf * s.g * facing / Frame3f::cos_theta(wi),
                 s.pdf > 0.f && Frame3f::cos_theta(wo) > 1e-7f && facing > 0.f };
    }

    Distribution m_distr;
    Float m_alpha_u, m_alpha_v;
    bool m_correlated;
};

/// Masking and shadowing for Mitsuba's own distributions.
template <typename Float, typename Distribution, typename Vector>
Float builtin_g2(const Distribution &distr, const Vector &wi, const Vector &wo, const Vector &m,
                 bool correlated) {
    if (!correlated)
        return distr.G(wi, wo, m);
    // 1/(1 + Lambda_i + Lambda_o) with Lambda = 1/G1 - 1
    Float g_i = distr.smith_g1(wi, m), g_o = distr.smith_g1(wo, m);
    return dr::select(g_i > 0.f && g_o > 0.f, g_i * g_o / (g_i + g_o - g_i * g_o), 0.f);
}

/// See ReflectingFacets.
template <typename Float, typename Spectrum> class BuiltinFacets {
public:
    MI_IMPORT_TYPES(MicrofacetDistribution)
    using Own   = ReflectingFacets<Float, Spectrum, SgtdDistribution<Float, Spectrum>>;
    using At    = typename Own::At;
    using Drawn = typename Own::Drawn;

    BuiltinFacets(MicrofacetType type, const Float &alpha_u, const Float &alpha_v, bool visible,
                  bool correlated)
        : m_distr(type, alpha_u, alpha_v, visible), m_alpha_u(alpha_u), m_alpha_v(alpha_v),
          m_visible(visible), m_correlated(correlated) {}

    const Float &alpha_u() const { return m_alpha_u; }
    const Float &alpha_v() const { return m_alpha_v; }

    template <bool Value, bool Pdf>
    At at(const Vector3f &wi, const Vector3f &wo, const Vector3f &m) const {
        Float D = m_distr.eval(m), G = 0.f, pdf = 0.f;
        if constexpr (Value)
            G = g2(wi, wo, m);
        if constexpr (Pdf)
            pdf = m_visible ? D * m_distr.smith_g1(wi, m) / (4.f * Frame3f::cos_theta(wi))
                            : m_distr.pdf(wi, m) / (4.f * dr::dot(wo, m));
        return { D, G, pdf };
    }

    Drawn draw(const Vector3f &wi, const Point2f &u) const {
        auto [m, pdf] = m_distr.sample(wi, u);
        Vector3f wo   = reflect(wi, m);
        Float weight;
        if (m_visible)
            weight = m_correlated ? Float(g2(wi, wo, m) / m_distr.smith_g1(wi, m))
                                  : m_distr.smith_g1(wo, m);
        else
            weight =
                g2(wi, wo, m) * dr::dot(wi, m) / (Frame3f::cos_theta(wi) * Frame3f::cos_theta(m));
        return { m, pdf, wo, weight, pdf != 0.f && Frame3f::cos_theta(wo) > 0.f };
    }

    static Mask defined(const Mask &active, const Float &, const Float &) { return active; }

    static Mask lit(const Mask &active, const Float &D, const Mask &) { return active && D != 0.f; }

    static Mask dense(const Mask &, const Mask &lit, const Float &) { return lit; }

    static Float incidence(const Float &cosine) { return cosine; }

private:
    Float g2(const Vector3f &wi, const Vector3f &wo, const Vector3f &m) const {
        return builtin_g2<Float>(m_distr, wi, wo, m, m_correlated);
    }

    MicrofacetDistribution m_distr;
    Float m_alpha_u, m_alpha_v;
    bool m_visible, m_correlated;
};

/**
 * The same for facets that refract as well. Directions may lie on either side: those that the
 * tables take are turned upright, and Mitsuba's own D and G are even.
 */
template <typename Float, typename Spectrum> class RefractingFacets {
public:
    MI_IMPORT_TYPES()
    using Distribution = SgtdDistribution<Float, Spectrum>;
    using Sample       = typename Distribution::Sample;

    /// Does the density need D?
    static constexpr bool DensityFromValue = false;

    template <typename... Args> RefractingFacets(bool correlated, const Args &...args)
        : m_distr(args...), m_correlated(correlated) {}

    /// A direction as the methods take it.
    static Vector3f upright(const Vector3f &v) { return dr::mulsign(v, Frame3f::cos_theta(v)); }

    /// Masking and shadowing of a reflection, and masking alone.
    Float G(const Vector3f &wi, const Vector3f &wo, const Vector3f &m) const {
        return m_distr.G(wi, wo, m, m_correlated);
    }
    Float smith_g1(const Vector3f &v, const Vector3f &m) const { return m_distr.smith_g1(v, m); }

    /// D of the facet `m`, which is along the sum of the two vectors.
    Float eval(const Vector3f &a, const Vector3f &b, const Vector3f &) const {
        return m_distr.eval(a, b);
    }

    /// Density of the facet `m`.
    Float pdf(const Vector3f &wi, const Vector3f &m, const Float & /* D */,
              const Float & /* dot_i */, const Float & /* cos_i */) const {
        return m_distr.pdf(wi, m);
    }

    Sample sample(const Vector3f &wi, const Float & /* cos_i */, const Point2f &u) const {
        return m_distr.sample(wi, u);
    }

    /// Is a facet that was drawn seen, and does the sample leave on the side that it should? Below
    /// 1e-7 the cosine is the rounding of the direction, its sign included.
    static Mask faces(const Mask &active, const Vector3f &wi, const Sample &s) {
        return active && dr::dot(wi, s.m) > 0.f;
    }
    static Mask leaves(const Mask &active, const Float &cosine) { return active && cosine > 1e-7f; }

    /// D G (wi.m) / (cos_i pdf) of a sample; `g()` is its masking and shadowing.
    template <typename Masking> Float weight(const Sample &s, const Vector3f &, const Vector3f &,
                                             const Float &dot_i, const Float &cos_i,
                                             const Masking &g) const {
        return Float(s.d_over_pdf * g() * dot_i / cos_i);
    }

    /// As those of ReflectingFacets.
    static Mask defined(const Mask &active, const Float &cos_i, const Float &cos_o) {
        return active && dr::minimum(cos_i, dr::abs(cos_o)) > 1e-30f;
    }
    static Mask lit(const Mask &active, const Float &D, const Mask &finite) {
        return active && D > 0.f && finite;
    }

private:
    Distribution m_distr;
    bool m_correlated;
};

/// See RefractingFacets. Where all normals are drawn, rough ones are drawn more often (Walter et
/// al. 2007, section 5.3).
template <typename Float, typename Spectrum> class BuiltinRefractingFacets {
public:
    MI_IMPORT_TYPES(MicrofacetDistribution)
    using Sample = typename SgtdDistribution<Float, Spectrum>::Sample;

    static constexpr bool DensityFromValue = true;

    BuiltinRefractingFacets(MicrofacetType type, const Float &alpha_u, const Float &alpha_v,
                            bool visible, bool correlated)
        : m_distr(type, alpha_u, alpha_v, visible), m_visible(visible), m_correlated(correlated) {}

    static Vector3f upright(const Vector3f &v) { return v; }

    Float G(const Vector3f &wi, const Vector3f &wo, const Vector3f &m) const {
        return builtin_g2<Float>(m_distr, wi, wo, m, m_correlated);
    }
    Float smith_g1(const Vector3f &v, const Vector3f &m) const { return m_distr.smith_g1(v, m); }

    Float eval(const Vector3f &, const Vector3f &, const Vector3f &m) const {
        return m_distr.eval(m);
    }

    Float pdf(const Vector3f &wi, const Vector3f &m, const Float &D, const Float &dot_i,
              const Float &cos_i) const {
        return m_visible ? Float(D * smith_g1(wi, m) * dot_i / cos_i) : widened(cos_i).pdf(wi, m);
    }

    Sample sample(const Vector3f &wi, const Float &cos_i, const Point2f &u) const {
        auto [m, pdf] = widened(cos_i).sample(wi, u);
        return { m, pdf, 0.f };
    }

    static Mask faces(const Mask &active, const Vector3f &, const Sample &) { return active; }
    static Mask leaves(const Mask &active, const Float &) { return active; }

    template <typename Masking> Float weight(const Sample &s, const Vector3f &wi,
                                             const Vector3f &wo, const Float &dot_i,
                                             const Float &cos_i, const Masking &g) const {
        if (!m_visible)
            return m_distr.eval(s.m) / dr::maximum(s.pdf, 1e-30f) * g() * dot_i / cos_i;
        // What is left of D, exactly, also where D and the density underflow
        return m_correlated ? Float(g() / smith_g1(wi, s.m)) : smith_g1(wo, s.m);
    }

    static Mask defined(const Mask &active, const Float &, const Float &) { return active; }
    static Mask lit(const Mask &active, const Float &, const Mask &finite) {
        return active && finite;
    }

private:
    MicrofacetDistribution widened(const Float &cos_i) const {
        MicrofacetDistribution distr(m_distr);
        if (!m_visible)
            distr.scale_alpha(1.2f - .2f * dr::sqrt(cos_i));
        return distr;
    }

    MicrofacetDistribution m_distr;
    bool m_visible, m_correlated;
};

NAMESPACE_END(mitsuba)

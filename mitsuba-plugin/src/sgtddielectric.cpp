#include <mitsuba/core/string.h>
#include <mitsuba/render/fresnel.h>
#include <mitsuba/render/texture.h>

#include <cmath>
#include <sstream>
#include <type_traits>

#include "mitsuba_version.h"
#include "refraction_index.h"
#include "sgtd_bsdf.h"
#include "smith_transmission.h"

NAMESPACE_BEGIN(mitsuba)

// clang-format off
/**!
.. _bsdf-sgtddielectric:

Rough dielectric with an SGTD distribution (:monosp:`sgtddielectric`)
---------------------------------------------------------------------

.. pluginparameters::

 * - int_ior
   - |float| or |string|
   - Index of refraction below the surface, or the name of a material of Mitsuba's list. Numbers
     must be finite and above 0. (Default: ``bk7``, 1.5046)

 * - ext_ior
   - |float| or |string|
   - The same above the surface, where its normal points. (Default: ``air``, 1.000277)

 * - eta
   - |float|
   - Quotient of the two; must be finite and above 0. Cannot be given, but changed.
   - |exposed|, |differentiable|, |discontinuous|

 * - specular_reflectance, specular_transmittance
   - |spectrum| or |texture|
   - Factors on the reflected and on the transmitted light. Numbers must be finite; below 0, a
     warning. Physical values are 1. (Default: 1)
   - |exposed|, |differentiable|

 * - alpha, alpha_u, alpha_v, distribution, gamma, p, lambda, shift, mu, filename, angles, slopes, values, quantity, tail, tail_exponent, knee, members, masking, sample_visible, accuracy
   - as in :ref:`sgtdconductor <bsdf-sgtdconductor>`
   - Roughness, shape and sampling. Textures of roughness, exposure and defaults are the same too.

This is a drop-in for ``roughdielectric`` (Walter et al. 2007, *Microfacet Models for Refraction
through Rough Surfaces*) whose microfacet normals follow the skewed generalized t-distribution; see
:ref:`sgtdconductor <bsdf-sgtdconductor>` for its formula. With the half vector h = wi + wo of a
reflection and h = wi + eta wo of a refraction, m = h / abs(h) and all cosines taken absolute,

    reflection      F D(m) G / (4 cos_i)
    transmission    (1 - F) D(m) G eta^2 (wi.m) (wo.m) / (cos_i abs(h)^2)

are the values times cos_o. Radiance that crosses the surface is scaled by 1/eta^2 on top, the
quantity that is traced from light sources is not. Light that meets a second facet is lost, as in
``roughdielectric``: reflection and transmission together stay below 1.

Upright facets refract into the rim of a cone. For tails of 2 p gamma < 4 the value and the density
are infinite on that rim, though not their integrals: light samples that come near it are noisy,
material samples are not.

``masking`` = ``height_correlated`` is 1/(1 + Lambda_i + Lambda_o) in reflection and Euler's beta
function B(1 + Lambda_i, 1 + Lambda_o) in transmission, whose directions lie on either side.

``beckmann`` and ``ggx`` without a shift run on Mitsuba's own MicrofacetDistribution and give the
values of ``roughdielectric``, with two differences. Polarized variants have the Mueller matrices
of Fresnel's equations, where ``roughdielectric`` depolarizes. With ``sample_visible`` = |false|
the weight of a sample is the value by the density, where ``roughdielectric`` draws from a widened
lobe and leaves that out of the weight.

Equal indices are allowed: light then passes straight on, reported as ``DeltaTransmission``. So it
does where eta differs from 1 by less than 1e-5, since two directions in single precision no longer
say there which facet refracts one into the other.

The ``albedo`` of the ``aov`` integrator is what is reflected and transmitted at normal incidence:
1 unless the glass is colored.

 */
// clang-format on
template <typename Float, typename Spectrum> class SgtdDielectric final
    : public SgtdBSDF<Float, Spectrum> {
public:
    MI_IMPORT_BASE(SgtdBSDF, m_flags, m_components, m_alpha_u, m_alpha_v, m_anisotropic,
                   m_height_correlated, m_ndf, m_tables, changed, check_constant, describe,
                   follows_shape, normals, restore, sample_following, to_stokes_bases, watch,
                   with_tables)
    MI_IMPORT_TYPES(Texture)

    SgtdDielectric(const Properties &props) : Base(props, false) {
        for (const char *name : { "specular_reflectance", "specular_transmittance" })
            check_constant(props, name);
        if (props.has_property("specular_reflectance"))
            m_specular_reflectance = props.get_texture<Texture>("specular_reflectance");
        if (props.has_property("specular_transmittance"))
            m_specular_transmittance = props.get_texture<Texture>("specular_transmittance");
        if ((m_colored_reflection = m_specular_reflectance != nullptr))
            watch("specular_reflectance", m_specular_reflectance.get());
        if ((m_colored_transmission = m_specular_transmittance != nullptr))
            watch("specular_transmittance", m_specular_transmittance.get());

        double int_ior = refraction_index(props, "int_ior", "bk7"),
               ext_ior = refraction_index(props, "ext_ior", "air");
        m_eta          = (ScalarFloat)(int_ior / ext_ior);
        check_eta(m_eta);
        update_eta();

        uint32_t extra = BSDFFlags::FrontSide | BSDFFlags::BackSide;
        if (m_anisotropic)
            extra = extra | BSDFFlags::Anisotropic;
        m_components.push_back(extra | BSDFFlags::GlossyReflection);
        m_components.push_back(extra | BSDFFlags::GlossyTransmission | BSDFFlags::NonSymmetric);
        m_flags = m_components[0] | m_components[1];
    }

    void traverse(TraversalCallback *cb) override {
        Base::traverse(cb);
        cb->put("eta", m_eta, ParamFlags::Differentiable | ParamFlags::Discontinuous);
        if (m_specular_reflectance)
            cb->put("specular_reflectance", m_specular_reflectance, ParamFlags::Differentiable);
        if (m_specular_transmittance)
            cb->put("specular_transmittance", m_specular_transmittance, ParamFlags::Differentiable);
    }

    void parameters_changed(const std::vector<std::string> &keys = {}) override {
        bool index = changed(keys, "eta");
        try {
            if (index)
                check_eta(m_eta);
            Base::parameters_changed(keys);
        } catch (...) {
            if (index)
                m_eta = dr::opaque<Float>(m_last_eta);
            restore();
            throw;
        }
        if (index)
            update_eta();
    }

    /**
     * Not a diffuse part, which glass lacks, but what denoisers take an albedo for: a color in [0,
     * 1] that does not depend on the view. It is what glass reflects and transmits at normal
     * incidence, whatever the roughness: 1 unless it is colored.
     */
    Spectrum eval_diffuse_reflectance(const SurfaceInteraction3f &si, Mask active) const override {
        UnpolarizedSpectrum F(std::get<0>(fresnel(Float(1.f), m_eta))), reflected = F,
                                                                        transmitted = 1.f - F;
        if (m_specular_reflectance)
            reflected *= m_specular_reflectance->eval(si, active);
        if (m_specular_transmittance)
            transmitted *= m_specular_transmittance->eval(si, active);
        return depolarizer<Spectrum>(dr::clip(reflected + transmitted, 0.f, 1.f)) & active;
    }

    std::pair<BSDFSample3f, Spectrum> sample(const BSDFContext &ctx, const SurfaceInteraction3f &si,
                                             Float sample1, const Point2f &sample2,
                                             Mask active) const override {
        MI_MASKED_FUNCTION(ProfilerPhase::BSDFSample, active);

        BSDFSample3f bs = dr::zeros<BSDFSample3f>();
        bool reflects   = ctx.is_enabled(BSDFFlags::GlossyReflection, 0),
             transmits  = ctx.is_enabled(BSDFFlags::GlossyTransmission, 1);
        Float side = Frame3f::cos_theta(si.wi), cos_i = dr::abs(side);
        active &= cos_i > 0.f;
        if (unlikely((!reflects && !transmits) || dr::none_or<false>(active)))
            return { bs, 0.f };
        if (follows_shape())
            return sample_following(ctx, si, sample1, sample2, active);
        // A view from below is turned about the origin: D and G are even
        Vector3f wi = dr::mulsign(si.wi, side);

        auto draw = [&](const auto &facets) -> std::pair<BSDFSample3f, Spectrum> {
            auto drawn  = facets.sample(wi, cos_i, sample2);
            Normal3f m  = drawn.m;
            Float dot_i = dr::dot(si.wi, m);
            active      = facets.faces(active, wi, drawn);
            if (!m_ordinary) // otherwise bs.pdf > 0 says so
                active &= drawn.pdf > 0.f;

            auto [F, cos_t, eta, inv_eta] = fresnel(dot_i, m_eta);
            Mask reflected                = reflects;
            if (reflects && transmits)
                reflected = sample1 < dr::detach(F);
            Float share = dr::select(reflected, F, 1.f - F), weight = share, probability = 1.f;
            if (reflects && transmits) {
                // What is drawn as often as it is worth weighs 1, but has a derivative
                probability = dr::detach(share);
                weight      = 1.f;
                if constexpr (dr::is_diff_v<Float>)
                    if (dr::grad_enabled(share))
                        weight = share / dr::maximum(probability, 1e-30f);
            } else {
                active &= share > 0.f;
            }

            Mask straight      = !reflected && index_matched(eta);
            Vector3f refracted = refract(si.wi, m, cos_t, inv_eta);
            if (!m_ordinary) // at great indices it cancels, and is no longer as long as 1
                refracted = dr::normalize(refracted);
            bs.wo                       = dr::select(reflected, reflect(si.wi, m), refracted);
            dr::masked(bs.wo, straight) = -si.wi;

            // wi.m - eta cos_t, by Snell's law without the cancellation at eta = 1
            dot_i      = dr::abs(dot_i);
            cos_t      = dr::abs(cos_t);
            Float sum  = dr::fmadd(eta, cos_t, dot_i),
                  less = dr::select(straight, 1.f, (1.f - eta) * (1.f + eta)) / sum,
                  jacobian =
                      dr::select(reflected, dr::rcp(4.f * dot_i), dr::square(eta / less) * cos_t);
            bs.pdf               = probability * dr::select(straight, 1.f, drawn.pdf * jacobian);
            bs.eta               = dr::select(reflected, 1.f, eta);
            bs.sampled_component = dr::select(reflected, UInt32(0), UInt32(1));
            bs.sampled_type      = dr::select(reflected, UInt32(+BSDFFlags::GlossyReflection),
                                              dr::select(straight, UInt32(+BSDFFlags::DeltaTransmission),
                                                         UInt32(+BSDFFlags::GlossyTransmission)));

            // The cosine on the side that the sample should be on
            active      = facets.leaves(active,
                                        dr::mulsign_neg(dr::mulsign(Frame3f::cos_theta(bs.wo), side),
                                                        dr::select(reflected, Float(-1.f), Float(1.f))));
            Vector3f in = facets.upright(si.wi), out = facets.upright(bs.wo);
            weight *= facets.weight(drawn, in, out, dot_i, cos_i,
                                    [&] { return masking(facets, in, out, m, reflected); });
            if (ctx.mode == TransportMode::Radiance)
                weight *= dr::select(reflected, 1.f, dr::square(inv_eta));
            active &= dr::isfinite(weight) && dr::isfinite(bs.pdf) && bs.pdf > 0.f;
            return { bs, colored(ctx, si, bs.wo, m, weight, reflected, active) };
        };

        return with_facets(si, active, draw);
    }

    Spectrum eval(const BSDFContext &ctx, const SurfaceInteraction3f &si, const Vector3f &wo,
                  Mask active) const override {
        MI_MASKED_FUNCTION(ProfilerPhase::BSDFEvaluate, active);
        return evaluate<true, false>(ctx, si, wo, active).first;
    }

    Float pdf(const BSDFContext &ctx, const SurfaceInteraction3f &si, const Vector3f &wo,
              Mask active) const override {
        MI_MASKED_FUNCTION(ProfilerPhase::BSDFEvaluate, active);
        return evaluate<false, true>(ctx, si, wo, active).second;
    }

    std::pair<Spectrum, Float> eval_pdf(const BSDFContext &ctx, const SurfaceInteraction3f &si,
                                        const Vector3f &wo, Mask active) const override {
        MI_MASKED_FUNCTION(ProfilerPhase::BSDFEvaluate, active);
        return evaluate<true, true>(ctx, si, wo, active);
    }

    std::string to_string() const override {
        std::ostringstream oss;
        oss << "SgtdDielectric[" << std::endl;
        describe(oss);
        if (m_specular_reflectance)
            oss << "  specular_reflectance = " << string::indent(m_specular_reflectance) << ","
                << std::endl;
        if (m_specular_transmittance)
            oss << "  specular_transmittance = " << string::indent(m_specular_transmittance) << ","
                << std::endl;
        oss << "  eta = " << m_eta << std::endl << "]";
        return oss.str();
    }

    MI_DECLARE_CLASS(SgtdDielectric)

protected:
    const Float *shown(const std::string &name) const override {
        return name == "eta" ? &m_eta : Base::shown(name);
    }

private:
    // ------------------------------------------------------------------
    //  Index of refraction
    // ------------------------------------------------------------------

    /// Derives what follows from eta.
    void update_eta() {
        if (recording<Float>()) // from now on it may be anything
            m_eta_known = false;
        else
            m_last_eta = dr::slice(dr::detach(m_eta));
        m_inv_eta = dr::rcp(m_eta);
        m_match   = 1e-5f;
        dr::make_opaque(m_eta, m_inv_eta, m_match);
        m_ordinary = m_eta_known && m_last_eta > .25f && m_last_eta < 4.f &&
                     std::abs(m_last_eta - 1.f) >= 1e-3f;
    }

    /// Is eta so near 1 that light passes straight on? There a direction's rounding, 1e-7, is one
    /// percent of the half vector wi + eta wo.
    Mask index_matched(const Float &eta) const {
        return m_ordinary ? Mask(false) : Mask(dr::abs(eta - 1.f) < m_match);
    }

    // ------------------------------------------------------------------
    //  Evaluation
    // ------------------------------------------------------------------

    /// Calls `f` with the facets at a place.
    template <typename Function>
    auto with_facets(const SurfaceInteraction3f &si, const Mask &active, const Function &f) const {
        return Base::template with_facets<BuiltinRefractingFacets<Float, Spectrum>>(
            si, active,
            [&](const Float &alpha_u, const Float &alpha_v, const auto &f_) {
                return with_tables(alpha_u, [&](const SgtdTables<Float> &tables) {
                    return f_(RefractingFacets<Float, Spectrum>(m_height_correlated, *m_ndf, tables,
                                                                alpha_u, alpha_v, normals(),
                                                                !m_anisotropic));
                });
            },
            f);
    }

    /// Masking and shadowing; `wo` was on the side of `wi` if `reflected`. A facet is seen from a
    /// direction as its reverse is from the opposite one.
    template <typename Facets> Float masking(const Facets &facets, const Vector3f &wi,
                                             const Vector3f &wo, const Vector3f &m,
                                             const Mask &reflected) const {
        Float G = facets.G(wi, wo, m);
        return m_height_correlated ? correlated(facets, wi, wo, m, reflected, G) : G;
    }

    /// Masking and shadowing correlated by height, from that of a reflection.
    template <typename Facets>
    static Float correlated(const Facets &facets, const Vector3f &wi, const Vector3f &wo,
                            const Vector3f &m, const Mask &reflected, const Float &reflection) {
        return dr::select(reflected, reflection,
                          correlated_transmission(facets.smith_g1(wi, m), facets.smith_g1(wo, m)));
    }

    /// The value of the BSDF times the cosine, and the density of `wo` under sample().
    template <bool Value, bool Pdf>
    std::pair<Spectrum, Float> evaluate(const BSDFContext &ctx, const SurfaceInteraction3f &si,
                                        const Vector3f &wo, Mask active) const {
        bool reflects  = ctx.is_enabled(BSDFFlags::GlossyReflection, 0),
             transmits = ctx.is_enabled(BSDFFlags::GlossyTransmission, 1);
        Float side = Frame3f::cos_theta(si.wi), cos_i = dr::abs(side),
              cos_o    = Frame3f::cos_theta(wo);
        Mask reflected = dr::mulsign(cos_o, side) > 0.f;
        Float eta      = dr::select(side > 0.f, m_eta, m_inv_eta),
              inv_eta  = dr::select(side > 0.f, m_inv_eta, m_eta);

        // The half vector, and the normal that it is along, turned up. Near eta = 1 it cancels: a
        // sum that is rounded as the compiler likes would be another one in pdf() than in
        // eval_pdf()
        Float scale = dr::select(reflected, Float(1.f), eta);
        Vector3f h(dr::fmadd(wo.x(), scale, si.wi.x()), dr::fmadd(wo.y(), scale, si.wi.y()),
                   dr::fmadd(wo.z(), scale, si.wi.z()));
        Float h2    = dr::maximum(dr::squared_norm(h), 1e-30f);
        Vector3f m  = dr::mulsign(Vector3f(h * dr::rsqrt(h2)), h.z());
        Float dot_i = dr::dot(si.wi, m), dot_o = dr::dot(wo, m);

        // Both directions see the same side of the facet
        active &= dot_i * side > 0.f && dot_o * cos_o > 0.f;
        if (!reflects)
            active &= !reflected;
        if (!transmits)
            active &= reflected;
        else if (!m_ordinary)
            active &= reflected || !index_matched(eta);
        if (unlikely((!reflects && !transmits) || dr::none_or<false>(active)))
            return { 0.f, 0.f };

        Float F = std::get<0>(fresnel(dot_i, m_eta)), share = dr::select(reflected, F, 1.f - F);
        dot_i = dr::abs(dot_i);
        dot_o = dr::abs(dot_o);

        return with_facets(si, active, [&](const auto &facets) -> std::pair<Spectrum, Float> {
            active      = facets.defined(active, cos_i, cos_o);
            Vector3f in = facets.upright(si.wi), out = facets.upright(wo);
            Float D = 0.f, pdf = 0.f;
            if constexpr (Value || std::decay_t<decltype(facets)>::DensityFromValue)
                D = facets.eval(dr::mulsign(si.wi, h.z()), dr::mulsign(Vector3f(wo * scale), h.z()),
                                m);
            // d(m) / d(wo); h is as long as wi.m + eta wo.m
            Float jacobian = dr::select(reflected, dr::rcp(4.f * dr::maximum(dot_o, 1e-18f)),
                                        dr::square(eta) * dot_o / h2);

            Spectrum value(0.f);
            if constexpr (Value) {
                Float result = share * D * masking(facets, in, out, m, reflected) *
                               dr::select(reflected, Float(.25f), jacobian * dot_i) / cos_i;
                if (ctx.mode == TransportMode::Radiance)
                    result *= dr::select(reflected, 1.f, dr::square(inv_eta));
                value = colored(ctx, si, wo, m, result, reflected,
                                facets.lit(active, D, dr::isfinite(result)));
            }
            if constexpr (Pdf) {
                pdf = facets.pdf(in, m, D, dot_i, cos_i) * jacobian;
                if (reflects && transmits)
                    pdf *= share;
                pdf = dr::select(active && dr::isfinite(pdf), pdf, 0.f);
            }
            return { value, pdf };
        });
    }

    /// Multiplies by the textures; a Mueller matrix with `value` as its first element if polarized.
    Spectrum colored(const BSDFContext &ctx, const SurfaceInteraction3f &si, const Vector3f &wo,
                     const Vector3f &m, const Float &value, const Mask &reflected,
                     const Mask &active) const {
        UnpolarizedSpectrum result(value);
        Mask r = active && reflected, t = active && !reflected;
        if (m_specular_reflectance)
            result *= dr::select(reflected, m_specular_reflectance->eval(si, r), 1.f);
        if (m_specular_transmittance)
            result *= dr::select(reflected, 1.f, m_specular_transmittance->eval(si, t));
        if constexpr (is_polarized_v<Spectrum>) {
            UnpolarizedSpectrum cosine(dr::dot(si.wi, m)), eta(m_eta);
            // Both matrices are the same for either direction of travel
            Spectrum M = dr::select(reflected, mueller::specular_reflection(cosine, eta),
                                    mueller::specular_transmission(cosine, eta));
            // Fresnel's equations without polarization round otherwise
            UnpolarizedSpectrum M00 = M(0, 0);
            M *= result / dr::select(M00 > 0.f, M00, 1.f);
            return to_stokes_bases(ctx, M, si.wi, wo, m) & (active && dr::all(M00 > 0.f));
        } else {
            return result & active;
        }
    }

private:
    ref<Texture> m_specular_reflectance, m_specular_transmittance;
    /// Relative index of refraction below the surface, and above it
    Float m_eta, m_inv_eta;
    /// Distance from 1 within which an index counts as equal
    Float m_match;
    ScalarFloat m_last_eta = 1;
    /// Is eta what the host saw last? Not after a change inside a frozen function.
    bool m_eta_known = true;
    /// Is eta for certain neither equal to 1 nor so great or small that refract() cancels?
    FrozenChoice<Float> m_ordinary;
    /// Are there a specular_reflectance and a specular_transmittance?
    FrozenChoice<Float> m_colored_reflection, m_colored_transmission;

    MI_TRAVERSE_CB(Base, m_ordinary, m_colored_reflection, m_colored_transmission,
                   m_specular_reflectance, m_specular_transmittance, m_eta, m_inv_eta, m_match)
};

/// Entry point; refuses to register anything in another release of Mitsuba, whose classes have
/// another layout.
extern "C" MI_EXPORT void init_plugin(std::string_view name, PluginRegisterFn fn) {
    sgtd::check_mitsuba_version();
    MI_REGISTER_PLUGIN(fn, name, SgtdDielectric);
}

NAMESPACE_END(mitsuba)

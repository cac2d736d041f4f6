#include <mitsuba/core/string.h>
#include <mitsuba/render/fresnel.h>
#include <mitsuba/render/ior.h>
#include <mitsuba/render/texture.h>

#include <sstream>

#include "mitsuba_version.h"
#include "sgtd_reflecting.h"

NAMESPACE_BEGIN(mitsuba)

// clang-format off
/**!
.. _bsdf-sgtdconductor:

Rough conductor with an SGTD distribution (:monosp:`sgtdconductor`)
-------------------------------------------------------------------

.. pluginparameters::

 * - material
   - |string|
   - Name of a metal of Mitsuba's list, for example ``Au``. Excludes ``eta`` and ``k``.
     (Default: none)

 * - eta, k
   - |spectrum| or |texture|
   - Real and imaginary part of the index of refraction. Numbers must be finite; parts below 0,
     which some fits to metals have, mean what they mean in ``roughconductor``, with a warning.
     (Default: 0 and 1, a perfect mirror)
   - |exposed|, |differentiable|, |discontinuous|

 * - specular_reflectance
   - |spectrum| or |texture|
   - Factor on the reflected light. Numbers must be finite; below 0, a warning. (Default: 1)
   - |exposed|, |differentiable|

 * - alpha, alpha_u, alpha_v
   - |float| or |texture|
   - Roughness, or roughness along the tangent and the bitangent. Numbers must be finite. Values
     below 1e-4 are raised to 1e-4, those of textures too; a number below 0 is told by a warning,
     and refused when an update brings it. (Default: 0.1)
   - |exposed|, |differentiable|, |discontinuous|

 * - distribution
   - |string|
   - Row of the family. A row fixes the parameters that are not in its list; giving a fixed one is
     an error. (Default: ``sgtd``)

     - ``sgtd``: gamma, p, lambda
     - ``gtd``: gamma, p
     - ``sgnd``: p, lambda (gamma = inf)
     - ``std``: gamma, lambda (p = 1)
     - ``gnd``: p (gamma = inf)
     - ``snd``: lambda (gamma = inf, p = 1)
     - ``student``: gamma (p = 1)
     - ``hyper_cauchy``: gamma (p = 1); gamma is the exponent q of the literature and alpha its
       sigma: Student's distribution at a roughness of alpha sqrt(2 / (gamma - 1))
     - ``beckmann``: none (gamma = inf, p = 1)
     - ``ggx``: none (gamma = 2, p = 1)
     - ``tabulated``: a table, given by the parameters below
     - ``mixture``: a weighted sum, given by ``members``

 * - filename
   - |string|
   - A table as .csv or .npz, two columns or arrays with names: ``angle`` (degrees from the normal)
     or ``slope``, and ``D``, ``D_cos``, ``slope_density`` or ``value``. (Default: none)

 * - angles, slopes, values
   - |string| or tensor
   - The same in the scene: 2 to 1000 numbers. (Default: none)
   - |exposed|, |differentiable| (``values``)

 * - quantity
   - |string|
   - What the values are: ``D``, ``D_cos`` (D cos(theta)) or ``slope`` (D cos(theta)^4, the density
     of slopes). (Default: what the file says, or ``D``)

 * - tail, tail_exponent
   - |string|, |float|
   - What lies beyond the last row: ``cut``, nothing, or ``power``, a power of the slope whose
     exponent (of the density of slopes, above 3; GGX has 4) is that of the last two rows if it is
     left out. (Default: what the file says, or ``power``)

 * - knee
   - |float|
   - The slope k of the interpolation: ln f is linear in ln(k^2 + x^2) between two rows. (Default:
     where the table is straightest)

 * - members
   - |string|
   - Up to 16 members of a mixture, separated by semicolons: "weight=0.7 alpha=0.1
     distribution=student gamma=1.6; weight=0.3 distribution=tabulated filename=haze.csv". Weights
     are shares of the normals as seen from above. Shown by traverse as ``weights`` and ``alphas``.
   - |exposed|, |differentiable|

 * - gamma
   - |float|
   - Tail, greater than 1; small values are heavy tails, inf is allowed. 2 p gamma must exceed 3.
     (Default: 2)
   - |exposed|, |differentiable|

 * - inv_gamma
   - |float|
   - 1 / gamma, at least 0 and below 1. Excludes ``gamma``, and has a derivative where that is
     infinite. (Default: none)
   - |exposed|, |differentiable|

 * - p
   - |float|
   - Kurtosis, 0.1 to 100: 1 is the bell of Beckmann and GGX, larger values are flatter.
     (Default: 1)
   - |exposed|, |differentiable|

 * - lambda
   - |float|
   - Skew, -0.9999 to 0.9999: positive values widen the outer side of the shift. (Default: 0)
   - |exposed|, |differentiable|

 * - shift
   - |float|
   - Slope at which the profile peaks divided by the roughness, 0 to 10000. Free in every row.
     (Default: 0)
   - |exposed|, |differentiable|

 * - mu
   - |float|
   - That slope itself, at least 0. Excludes ``shift``; needs one constant ``alpha``. The tables
     follow when ``alpha`` is changed. (Default: none)
   - |exposed|, |differentiable|

 * - masking
   - |string|
   - ``separable``: shadowing and masking are independent, as in ``roughconductor``.
     ``height_correlated``: they are correlated by the height of the facet.
     (Default: ``separable``)

 * - multiple_scattering
   - |boolean|
   - Return the light that the microsurface reflects more than once. Without it, that light is
     lost. (Default: |false|)

 * - sample_visible
   - |boolean|
   - Draw from the visible normals, or from all normals. (Default: |true|)

 * - sample_bounded
   - |boolean|
   - Of the visible normals, leave out those that reflect the view below the horizon, as far as a
     bound in closed form goes: exact for one roughness, conservative for two. (Default: |true|,
     but |false| where Mitsuba's own ``ggx`` and ``beckmann`` run)

 * - accuracy
   - |float|
   - Relative error of G1 that the masking table may have, 0 to 0.1. Scalar variants go down to
     1e-10, and 0 means quadrature on every call there. The finest of the other variants, whose
     tables are in single precision, is 1e-7: smaller values and 0 mean that. (Default: 1e-5)

This is a drop-in for ``roughconductor`` whose microfacet normals follow the skewed generalized
t-distribution of Ribardiere et al., *Microfacet BSDFs Generated from NDFs and Explicit
Microgeometry*, 2019. With the slope t = tan(theta) of a normal and x = t / alpha,

    D = A f(x) / (pi alpha_u alpha_v cos(theta)^4)
    f(x) = (1 + u / (gamma - 1))^(-gamma),  u = (abs(x - shift) / (1 +- lambda))^(2 p)

with + where x exceeds the shift; gamma = inf means f = exp(-u). Two roughnesses stretch the slopes
along the two tangents, as in GGX. All defaults together are GGX, while ``roughconductor`` defaults
to Beckmann: name the distribution when the two are compared.

Values decide what is computed, not the row. Without a shift, gamma = 2 and p = 1 run on Mitsuba's
own MicrofacetDistribution and give the values of ``roughconductor`` (lambda is then a factor 1 +
lambda on the roughness). So does ``beckmann``; as Mitsuba masks that by a fit within 6e-3, gamma =
inf in other rows keeps tables of its own.

With ``multiple_scattering``, a reciprocal lobe returns what single scattering loses,

    f_ms = F_ms (1 - E(w_i)) (1 - E(w_o)) / (pi (1 - E_avg))

where E is the albedo of single scattering for a perfect mirror, tabulated for this shape and this
masking, and E_avg its average. F_ms = F^2 E_avg / (1 - F (1 - E_avg)), with the average F of the
Fresnel reflectance, is what repeated reflections leave of each wavelength: metals become darker and
more saturated as roughness grows, and a mirror loses nothing. ``specular_reflectance`` scales the
sum of both lobes, and polarized variants return this light unpolarized. Two roughnesses are
tabulated as a pair, and again when one is changed; if a texture drives one of them, E is that of
the isotropic surface with their mean, and the balance of energy is approximate. Tables follow
roughness up to 8. They hold E within 1e-3; where one does not (thin rings with two roughnesses), a
warning tells the error. Equal materials share one.

Of a table or a mixture, ``alpha`` is the mean slope. Left out, the distribution is as it was given;
another value, a texture, or two roughnesses stretch its slopes until their mean is that.

Changing a shape parameter makes new tables, which a frozen function cannot record: it is done
before the call, and the function follows. An update with a number that is out of range or not
finite is refused, and the material keeps all that it had.

Shape parameters can be differentiated, in forward and in reverse mode. As with any change, the
material learns of a gradient by an update: call ``dr.enable_grad(params[key])``, then
``params.update()``. It then runs on tables that hold derivatives as well (at the points of ``ggx``
and ``beckmann`` too), and samples are detached: directions do not move, values follow the shape. The
derivative of ``pdf`` is that of the density of visible normals; the share of them that
``sample_bounded`` leaves out has none. By ``shift`` at 0 derivatives are one-sided; next to the cusp
of a profile with p < 1/2, those by ``shift`` are as large as one likes. Without a gradient,
nothing is computed for it. ``multiple_scattering`` and a gradient of the shape exclude each other.

So can ``values``, ``weights`` and ``alphas``, all at the cost of one. Their gradient leads back to
them once: a loop that does not set new numbers calls ``params.set_dirty(key)`` and
``params.update()`` before each pass. Where ``alpha`` is left out, slopes stay where they are, else
the mean slope does. A value of 0 stays 0 and has no derivative.

What the ``albedo`` of the ``aov`` integrator shows is a color for denoisers: the reflectance at normal
incidence times ``specular_reflectance``, within [0, 1] and the same from every view.

 */
// clang-format on
template <typename Float, typename Spectrum> class SgtdConductor final
    : public SgtdReflecting<Float, Spectrum> {
public:
    MI_IMPORT_BASE(SgtdReflecting, m_flags, m_components, m_anisotropic, m_missing_energy,
                   m_multiple_scattering, check_constant, describe, follows_shape, loss_surface,
                   mitsubas_own, own_facets, reflects, roughness, sample_following, to_stokes_bases,
                   watch, with_facets)
    MI_IMPORT_TYPES(Texture)

    SgtdConductor(const Properties &props) : Base(props) {
        read_metal(props);
        m_colored = m_specular_reflectance != nullptr;
        update_flags();
    }

    void traverse(TraversalCallback *cb) override {
        Base::traverse(cb);
        if (m_specular_reflectance)
            cb->put("specular_reflectance", m_specular_reflectance, ParamFlags::Differentiable);
        cb->put("eta", m_eta, ParamFlags::Differentiable | ParamFlags::Discontinuous);
        cb->put("k", m_k, ParamFlags::Differentiable | ParamFlags::Discontinuous);
    }

    void parameters_changed(const std::vector<std::string> &keys = {}) override {
        Base::parameters_changed(keys);
        update_flags();
    }

    /**
     * Not a diffuse part, which metals lack, but what denoisers take an albedo for: a color in [0,
     * 1] that does not depend on the view. It is the reflectance at normal incidence, whatever the
     * roughness.
     */
    Spectrum eval_diffuse_reflectance(const SurfaceInteraction3f &si, Mask active) const override {
        dr::Complex<UnpolarizedSpectrum> eta(m_eta->eval(si, active), m_k->eval(si, active));
        UnpolarizedSpectrum albedo = fresnel_conductor(UnpolarizedSpectrum(1.f), eta);
        if (m_specular_reflectance)
            albedo *= m_specular_reflectance->eval(si, active);
        return depolarizer<Spectrum>(dr::clip(albedo, 0.f, 1.f)) & active;
    }

    std::pair<BSDFSample3f, Spectrum> sample(const BSDFContext &ctx, const SurfaceInteraction3f &si,
                                             Float sample1, const Point2f &sample2,
                                             Mask active) const override {
        MI_MASKED_FUNCTION(ProfilerPhase::BSDFSample, active);

        active &= Frame3f::cos_theta(si.wi) > 0.f;
        if (unlikely(!ctx.is_enabled(BSDFFlags::GlossyReflection) || dr::none_or<false>(active)))
            return { dr::zeros<BSDFSample3f>(), 0.f };
        if (follows_shape())
            return sample_following(ctx, si, sample1, sample2, active);
        return with_facets(si, active, [&](const auto &facets) {
            auto drawn = facets.draw(si.wi, sample2);
            if (m_multiple_scattering)
                return mix_sample(facets, drawn, ctx, si, sample1, sample2, active);
            return color_sample(facets, drawn, ctx, si, active && drawn.valid);
        });
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

    /// One look at what depends on the view alone, which evaluation and sample share.
    std::tuple<Spectrum, Float, BSDFSample3f, Spectrum>
    eval_pdf_sample(const BSDFContext &ctx, const SurfaceInteraction3f &si, const Vector3f &wo,
                    Float sample1, const Point2f &sample2, Mask active) const override {
        if (mitsubas_own() || m_multiple_scattering || follows_shape() ||
            !ctx.is_enabled(BSDFFlags::GlossyReflection))
            return Base::eval_pdf_sample(ctx, si, wo, sample1, sample2, active);
        MI_MASKED_FUNCTION(ProfilerPhase::BSDFSample, active);

        active &= Frame3f::cos_theta(si.wi) > 0.f;
        if (unlikely(dr::none_or<false>(active)))
            return { 0.f, 0.f, dr::zeros<BSDFSample3f>(), 0.f };
        Vector3f half           = dr::normalize(wo + si.wi);
        Mask lit                = active && reflects(si.wi, wo, half);
        auto [alpha_u, alpha_v] = roughness(si, active);
        return own_facets(
            alpha_u, alpha_v,
            [&](const auto &facets) -> std::tuple<Spectrum, Float, BSDFSample3f, Spectrum> {
                auto [at, drawn]  = facets.at_and_draw(si.wi, wo, half, sample2);
                auto [value, pdf] = color<true, true>(facets, at, ctx, si, wo, half, lit);
                auto [bs, weight] = color_sample(facets, drawn, ctx, si, active && drawn.valid);
                return { value, pdf, bs, weight };
            });
    }

    std::string to_string() const override {
        std::ostringstream oss;
        oss << "SgtdConductor[" << std::endl;
        describe(oss);
        if (m_specular_reflectance)
            oss << "  specular_reflectance = " << string::indent(m_specular_reflectance) << ","
                << std::endl;
        oss << "  eta = " << string::indent(m_eta) << "," << std::endl
            << "  k = " << string::indent(m_k) << std::endl
            << "]";
        return oss.str();
    }

    MI_DECLARE_CLASS(SgtdConductor)

private:
    // ------------------------------------------------------------------
    //  Reading of properties
    // ------------------------------------------------------------------

    void read_metal(const Properties &props) {
        std::string material(props.get<std::string_view>("material", "none"));
        check_constant(props, "eta");
        check_constant(props, "k");
        check_constant(props, "specular_reflectance");
        if (material == "none") {
            m_eta = props.get_unbounded_texture<Texture>("eta", 0.f);
            m_k   = props.get_unbounded_texture<Texture>("k", 1.f);
        } else {
            if (props.has_property("eta") || props.has_property("k"))
                Throw("parameters \"material\" and \"eta\" or \"k\" are given together: choose one "
                      "or the other");
            try {
                std::tie(m_eta, m_k) = complex_ior_from_file<Spectrum, Texture>(material);
            } catch (const std::exception &error) {
                Throw("material \"%s\" is unknown: choose one of Mitsuba's metals, such as Au (%s)",
                      material, error.what());
            }
        }
        if (props.has_property("specular_reflectance"))
            m_specular_reflectance = props.get_texture<Texture>("specular_reflectance");
        watch("eta", m_eta.get());
        watch("k", m_k.get());
        if (m_specular_reflectance)
            watch("specular_reflectance", m_specular_reflectance.get());
    }

    void update_flags() {
        m_flags = BSDFFlags::GlossyReflection | BSDFFlags::FrontSide;
        if (m_anisotropic)
            m_flags = m_flags | BSDFFlags::Anisotropic;
        m_components.clear();
        m_components.push_back(m_flags);
    }

    // ------------------------------------------------------------------
    //  Evaluation
    // ------------------------------------------------------------------

    static BSDFSample3f sample_towards(const Vector3f &wo, const Float &pdf) {
        BSDFSample3f bs      = dr::zeros<BSDFSample3f>();
        bs.wo                = wo;
        bs.pdf               = pdf;
        bs.eta               = 1.f;
        bs.sampled_component = 0;
        bs.sampled_type      = +BSDFFlags::GlossyReflection;
        return bs;
    }

    /// A sample of single scattering, in color.
    template <typename Facets, typename Drawn> std::pair<BSDFSample3f, Spectrum>
    color_sample(const Facets &facets, const Drawn &drawn, const BSDFContext &ctx,
                 const SurfaceInteraction3f &si, Mask active) const {
        // From normals to outgoing directions
        Float pdf                  = drawn.pdf / (4.f * dr::dot(drawn.wo, drawn.m));
        Spectrum F                 = reflectance(facets, ctx, si, drawn.wo, drawn.m, active);
        UnpolarizedSpectrum result = drawn.weight;
        if (m_specular_reflectance)
            result *= m_specular_reflectance->eval(si, active);
        return { sample_towards(drawn.wo, pdf), (F * result) & active };
    }

    /// A sample of both lobes: one of them gives the direction, both its value and density.
    template <typename Facets, typename Drawn>
    std::pair<BSDFSample3f, Spectrum> mix_sample(const Facets &facets, const Drawn &drawn,
                                                 const BSDFContext &ctx,
                                                 const SurfaceInteraction3f &si, Float sample1,
                                                 const Point2f &sample2, Mask active) const {
        auto surface = loss_surface(facets);
        Float lost   = m_missing_energy.missing_energy(surface, si.wi);
        Mask again   = active && sample1 < lost;
        Vector3f wo  = dr::select(
            again, m_missing_energy.sample(surface, sample1 / dr::maximum(lost, 1e-30f), sample2),
            drawn.wo);
        Vector3f m        = dr::normalize(wo + si.wi);
        Mask seen         = (again || (active && drawn.valid)) && reflects(si.wi, wo, m);
        auto [value, pdf] = evaluate<true, true>(facets, ctx, si, wo, m, seen);
        return { sample_towards(wo, pdf), (value / dr::maximum(pdf, 1e-30f)) & (pdf > 0.f) };
    }

    /// The value of the BSDF times the cosine, and the density of `wo` under sample().
    template <bool Value, bool Pdf>
    std::pair<Spectrum, Float> evaluate(const BSDFContext &ctx, const SurfaceInteraction3f &si,
                                        const Vector3f &wo, Mask active) const {
        Vector3f m = dr::normalize(wo + si.wi);
        active &= reflects(si.wi, wo, m);
        if (unlikely(!ctx.is_enabled(BSDFFlags::GlossyReflection) || dr::none_or<false>(active)))
            return { 0.f, 0.f };
        return with_facets(si, active, [&](const auto &facets) {
            return evaluate<Value, Pdf>(facets, ctx, si, wo, m, active);
        });
    }

    /// The same for given facets, of which `m` reflects.
    template <bool Value, bool Pdf, typename Facets>
    std::pair<Spectrum, Float> evaluate(const Facets &facets, const BSDFContext &ctx,
                                        const SurfaceInteraction3f &si, const Vector3f &wo,
                                        const Vector3f &m, Mask active) const {
        auto at     = facets.template at<Value, Pdf>(si.wi, wo, m);
        auto result = color<Value, Pdf>(facets, at, ctx, si, wo, m, active);
        if (m_multiple_scattering)
            add_multiple_scattering<Value, Pdf>(facets, si, wo, active, result.first,
                                                result.second);
        return result;
    }

    /// Value and density of single scattering in color.
    template <bool Value, bool Pdf, typename Facets, typename At>
    std::pair<Spectrum, Float> color(const Facets &facets, const At &at, const BSDFContext &ctx,
                                     const SurfaceInteraction3f &si, const Vector3f &wo,
                                     const Vector3f &m, Mask active) const {
        return Base::template single_scattering<Value, Pdf>(
            facets, at, si.wi, wo, active,
            [&](UnpolarizedSpectrum result, const Mask &lit) -> Spectrum {
                Spectrum F = reflectance(facets, ctx, si, wo, m, lit);
                if (m_specular_reflectance)
                    result *= m_specular_reflectance->eval(si, lit);
                return F * result;
            });
    }

    /// Adds the lobe that returns what single scattering loses, and the density of its samples.
    template <bool Value, bool Pdf, typename Facets>
    void add_multiple_scattering(const Facets &facets, const SurfaceInteraction3f &si,
                                 const Vector3f &wo, const Mask &active, Spectrum &value,
                                 Float &pdf) const {
        auto surface = loss_surface(facets);
        Float lost   = m_missing_energy.missing_energy(surface, si.wi);
        if constexpr (Value) {
            dr::Complex<UnpolarizedSpectrum> eta(m_eta->eval(si, active), m_k->eval(si, active));
            UnpolarizedSpectrum result =
                m_missing_energy.tint(surface.average_missing_energy,
                                      m_missing_energy.average_fresnel(eta)) *
                m_missing_energy.lobe(surface, lost, wo);
            if (m_specular_reflectance)
                result *= m_specular_reflectance->eval(si, active);
            value += depolarizer<Spectrum>(result) & active;
        }
        if constexpr (Pdf)
            pdf = dr::select(active, dr::lerp(pdf, m_missing_energy.pdf(surface, wo), lost), 0.f);
    }

    /// Fresnel reflectance of the facet `m`; a Mueller matrix in the bases of the two directions if
    /// polarized.
    template <typename Facets> Spectrum reflectance(const Facets &facets, const BSDFContext &ctx,
                                                    const SurfaceInteraction3f &si,
                                                    const Vector3f &wo, const Vector3f &m,
                                                    Mask active) const {
        dr::Complex<UnpolarizedSpectrum> eta(m_eta->eval(si, active), m_k->eval(si, active));
        auto cosine = [&](const Vector3f &w) {
            return UnpolarizedSpectrum(facets.incidence(dr::dot(w, m)));
        };
        if constexpr (is_polarized_v<Spectrum>) {
            // Light comes from wo, and an adjoint query swaps the two directions
            bool radiance = ctx.mode == TransportMode::Radiance;
            return to_stokes_bases(ctx,
                                   mueller::specular_reflection(cosine(radiance ? wo : si.wi), eta),
                                   si.wi, wo, m);
        } else {
            return fresnel_conductor(cosine(si.wi), eta);
        }
    }

private:
    ref<Texture> m_eta, m_k, m_specular_reflectance;
    /// Is there a specular_reflectance?
    FrozenChoice<Float> m_colored;

    MI_TRAVERSE_CB(Base, m_colored, m_eta, m_k, m_specular_reflectance)
};

/// Entry point; refuses to register anything in another release of Mitsuba, whose classes have
/// another layout.
extern "C" MI_EXPORT void init_plugin(std::string_view name, PluginRegisterFn fn) {
    sgtd::check_mitsuba_version();
    MI_REGISTER_PLUGIN(fn, name, SgtdConductor);
}

NAMESPACE_END(mitsuba)

#include <mitsuba/core/string.h>
#include <mitsuba/core/warp.h>
#include <mitsuba/render/fresnel.h>
#include <mitsuba/render/texture.h>

#include <algorithm>
#include <sstream>

#include "mitsuba_version.h"
#include "refraction_index.h"
#include "sgtd_interface.h"
#include "sgtd_reflecting.h"

NAMESPACE_BEGIN(mitsuba)

// clang-format off
/**!
.. _bsdf-sgtdplastic:

Rough plastic with an SGTD distribution (:monosp:`sgtdplastic`)
---------------------------------------------------------------

.. pluginparameters::

 * - diffuse_reflectance
   - |spectrum| or |texture|
   - Albedo of the base below the coat. Numbers must be finite; below 0, a warning. (Default: 0.5)
   - |exposed|, |differentiable|

 * - nonlinear
   - |boolean|
   - Color light by each of its reflections between base and coat, so that dark colors become more
     saturated. (Default: |false|)

 * - int_ior
   - |float| or |string|
   - Index of refraction of the coat, or the name of a material of Mitsuba's list. Numbers must be
     finite and above 0. (Default: ``polypropylene``, 1.49)

 * - ext_ior
   - |float| or |string|
   - The same above the surface. (Default: ``air``, 1.000277)

 * - eta
   - |float|
   - Quotient of the two; must be finite and above 0. Cannot be given, but changed.
   - |exposed|, |differentiable|, |discontinuous|

 * - specular_reflectance
   - |spectrum| or |texture|
   - Factor on the light that the coat reflects. Numbers must be finite; below 0, a warning. Physical
     values are 1. (Default: 1)
   - |exposed|, |differentiable|

 * - alpha, alpha_u, alpha_v
   - |float|
   - Roughness of the coat, or roughness along the tangent and the bitangent: numbers, as in
     ``roughplastic``. Values below 1e-4 are raised to 1e-4. (Default: 0.1)
   - |exposed|, |differentiable|, |discontinuous|

 * - distribution, gamma, inv_gamma, p, lambda, shift, mu, filename, angles, slopes, values, quantity, tail, tail_exponent, knee, members, masking, sample_visible, sample_bounded, accuracy
   - as in :ref:`sgtdconductor <bsdf-sgtdconductor>`
   - Shape and sampling. Exposure and defaults are the same too.

 * - multiple_scattering
   - |boolean|
   - Account for light that meets the coat more than once: what is not reflected gets below it.
     Without it, that light is lost, as in ``roughplastic``. (Default: |false|)

This is a drop-in for ``roughplastic``, a diffuse base below a rough dielectric coat, whose microfacet
normals follow the skewed generalized t-distribution; see :ref:`sgtdconductor <bsdf-sgtdconductor>`
for its formula. With d the diffuse reflectance,

    f = F D G / (4 cos_i cos_o) + d T(w_i) T(w_o) / (pi eta^2 (1 - R_int d'))

where T is the share of light that one meeting with the coat transmits and R_int the share of
diffuse light from below that it throws back; d' is d if ``nonlinear``, 1 otherwise. T and R_int are
integrals over the facets of this distribution, its masking included, for one roughness and one
index: they are tabulated when the material is built or one of these is changed, which a frozen
function cannot do. Tables hold T within 1e-3, or 3e-3 for two roughnesses; within 1.5e-2 if the
index of the coat is the lower one, where total reflection has a corner.

With ``multiple_scattering``, T is 1 less all that is reflected: F D G / (4 cos_i cos_o), and what
the facets reflect twice or more,

    f_ms = F_ms (1 - E(w_i)) (1 - E(w_o)) / (pi (1 - E_avg))

the lobe of ``sgtdconductor`` with F_ms = F^2 E_avg / (1 - F (1 - E_avg)) of the coat's average
reflectance F, a few percent of what a mirror would return. The rest enters: so R_int is 1 less the
average of T by eta^2, and a white base without absorption returns all light. That light which has
entered leaves the coat in the directions of T is an assumption, which Smith's model of the surface
does not make.

Where ``distribution`` is ``ggx``, or the numbers lead there, and where it is ``beckmann``, the
specular part and its sampling run on Mitsuba's own MicrofacetDistribution and give the values of
``roughplastic`` but for rounding. Different from it are, on purpose,

 - R_int, which ``roughplastic`` averages by a sum that is 1/64 too small: its diffuse part is up to
   3 percent too dark, most for smooth coats at ``nonlinear`` = |false|;
 - T where the cosine is as small as the roughness, which ``roughplastic`` interpolates linearly
   between 64 cosines: 5e-4 apart at ``alpha`` = 0.1, but a tenth at 0.01;
 - T of ``beckmann``, which follows from its exact masking, not from a fit: up to 2e-3;
 - polarized variants, whose specular part has the Mueller matrices of Fresnel's equations, where
   ``roughplastic`` depolarizes;
 - equal indices, which are allowed: the coat reflects nothing then.

Derivatives by ``alpha`` and ``eta`` follow the specular part and 1/eta^2; T and R_int count as
constant, as in ``roughplastic``. Neither shape parameters nor the numbers of tables and mixtures can
be differentiated.

The ``albedo`` of the ``aov`` integrator is the diffuse reflectance.

 */
// clang-format on
template <typename Float, typename Spectrum> class SgtdPlastic final
    : public SgtdReflecting<Float, Spectrum> {
public:
    MI_IMPORT_BASE(SgtdReflecting, m_flags, m_components, m_alpha_u, m_alpha_v, m_anisotropic,
                   m_height_correlated, m_missing_energy, m_multiple_scattering, m_ndf, m_node,
                   changed, check_constant, constant, core_alpha, core_ndf, describe, follows_shape,
                   loss_surface, plain_number, reflects, restore, sample_following, set_constant,
                   to_stokes_bases, watch, with_facets)
    MI_IMPORT_TYPES(Texture)

    SgtdPlastic(const Properties &props) : Base(props) {
        for (const char *name : { "alpha", "alpha_u", "alpha_v" })
            if (props.has_property(name) && !plain_number(props, name))
                Throw("parameter \"%s\" is a texture, but must be one number: what the coat "
                      "transmits is tabulated for one roughness",
                      name);
        check_constant(props, "diffuse_reflectance");
        check_constant(props, "specular_reflectance");
        m_diffuse_reflectance = props.get_texture<Texture>("diffuse_reflectance", .5f);
        watch("diffuse_reflectance", m_diffuse_reflectance.get());
        if (props.has_property("specular_reflectance")) {
            m_specular_reflectance = props.get_texture<Texture>("specular_reflectance");
            watch("specular_reflectance", m_specular_reflectance.get());
        }
        m_colored   = m_specular_reflectance != nullptr;
        m_nonlinear = props.get<bool>("nonlinear", false);
        m_eta       = (ScalarFloat)(refraction_index(props, "int_ior", "polypropylene") /
                              refraction_index(props, "ext_ior", "air"));
        check_eta(m_eta);

        m_components.push_back(BSDFFlags::GlossyReflection | BSDFFlags::FrontSide |
                               (m_anisotropic ? BSDFFlags::Anisotropic : BSDFFlags::Empty));
        m_components.push_back(BSDFFlags::DiffuseReflection | BSDFFlags::FrontSide);
        m_flags = m_components[0] | m_components[1];
        show_roughness();
        update_coat();
        update_weights();
    }

    void traverse(TraversalCallback *cb) override {
        cb->put("diffuse_reflectance", m_diffuse_reflectance, ParamFlags::Differentiable);
        Base::traverse(cb);
        cb->put("eta", m_eta, ParamFlags::Differentiable | ParamFlags::Discontinuous);
        if (m_specular_reflectance)
            cb->put("specular_reflectance", m_specular_reflectance, ParamFlags::Differentiable);
    }

    void parameters_changed(const std::vector<std::string> &keys = {}) override {
        const sgtd::host::RowShape before                 = m_node;
        const std::shared_ptr<const sgtd::host::Ndf> held = m_ndf;
        const char *const rough[]                         = { "alpha", "alpha_u", "alpha_v" };
        const bool fixed = recording<Float>(), index = changed(keys, "eta");
        bool coat = index;
        for (const char *name : rough)
            coat |= changed(keys, name);
        try {
            if (fixed && !keys.empty() && coat)
                for (const char *name : { "alpha", "alpha_u", "alpha_v", "eta" })
                    if (string::contains(keys, name))
                        Throw(
                            "parameter \"%s\" cannot be changed inside a frozen function, as what "
                            "the coat transmits is tabulated on the host: change it before the "
                            "call",
                            name);
            if (index)
                check_eta(m_eta);
            if (coat && !fixed)
                set_roughness();
            Base::parameters_changed(keys);
        } catch (...) {
            restore();
            if (!fixed) {
                show_roughness();
                m_eta = dr::opaque<Float>(m_last_eta);
            }
            throw;
        }
        if (!fixed) {
            show_roughness();
            if (coat || !(m_node == before) || m_ndf != held)
                update_coat();
        }
        update_weights();
    }

    Spectrum eval_diffuse_reflectance(const SurfaceInteraction3f &si, Mask active) const override {
        return depolarizer<Spectrum>(m_diffuse_reflectance->eval(si, active)) & active;
    }

    std::pair<BSDFSample3f, Spectrum> sample(const BSDFContext &ctx, const SurfaceInteraction3f &si,
                                             Float sample1, const Point2f &sample2,
                                             Mask active) const override {
        MI_MASKED_FUNCTION(ProfilerPhase::BSDFSample, active);

        const Lobes lobes(ctx);
        active &= Frame3f::cos_theta(si.wi) > 0.f;
        if (unlikely(!lobes.any() || dr::none_or<false>(active)))
            return { dr::zeros<BSDFSample3f>(), 0.f };
        if (follows_shape())
            return sample_following(ctx, si, sample1, sample2, active);
        return with_facets(
            si, active, [&](const auto &facets) -> std::pair<BSDFSample3f, Spectrum> {
                const View view = look(facets, lobes, si.wi, active);
                Mask coated = active && sample1 < view.specular, again = false, valid = active;
                Vector3f wo = warp::square_to_cosine_hemisphere(sample2);
                if (lobes.specular) {
                    auto drawn             = facets.draw(si.wi, sample2);
                    dr::masked(wo, coated) = drawn.wo;
                    valid &= !coated || drawn.valid;
                    if (m_multiple_scattering) {
                        Float share           = view.specular * view.again;
                        again                 = coated && sample1 < share;
                        dr::masked(wo, again) = m_missing_energy.sample(
                            view.surface, sample1 / dr::maximum(share, 1e-30f), sample2);
                        valid |= again;
                    }
                }
                BSDFSample3f bs      = dr::zeros<BSDFSample3f>();
                bs.wo                = wo;
                bs.eta               = 1.f;
                bs.sampled_component = dr::select(coated, UInt32(0), UInt32(1));
                bs.sampled_type      = dr::select(coated, UInt32(+BSDFFlags::GlossyReflection),
                                                  UInt32(+BSDFFlags::DiffuseReflection));
                auto [value, pdf]    = evaluate<true, true>(facets, view, lobes, ctx, si, wo,
                                                            valid && Frame3f::cos_theta(wo) > 0.f);
                bs.pdf               = pdf;
                return { bs, (value / dr::maximum(pdf, 1e-30f)) & (pdf > 0.f) };
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

    std::string to_string() const override {
        std::ostringstream oss;
        oss << "SgtdPlastic[" << std::endl;
        describe(oss);
        oss << "  diffuse_reflectance = " << string::indent(m_diffuse_reflectance) << ","
            << std::endl;
        if (m_specular_reflectance)
            oss << "  specular_reflectance = " << string::indent(m_specular_reflectance) << ","
                << std::endl;
        oss << "  nonlinear = " << (bool)m_nonlinear << "," << std::endl
            << "  eta = " << m_eta << std::endl
            << "]";
        return oss.str();
    }

    MI_DECLARE_CLASS(SgtdPlastic)

protected:
    const Float *shown(const std::string &name) const override {
        for (size_t i = 0; i < roughnesses(); ++i)
            if (name == roughness_name(i))
                return &m_shown_alpha[i];
        return name == "eta" ? &m_eta : Base::shown(name);
    }

    void traverse_roughness(TraversalCallback *cb, uint32_t flags) override {
        for (size_t i = 0; i < roughnesses(); ++i)
            cb->put(roughness_name(i), m_shown_alpha[i], flags);
    }

    const char *no_gradient() const override {
        return "what the coat of sgtdplastic transmits has no derivatives by it: differentiate by "
               "alpha, eta or the reflectances";
    }

private:
    // ------------------------------------------------------------------
    //  Roughness: numbers for the user, textures for all other BSDFs
    // ------------------------------------------------------------------

    size_t roughnesses() const { return m_anisotropic ? 2 : 1; }

    const char *roughness_name(size_t i) const {
        return !m_anisotropic ? "alpha" : i == 0 ? "alpha_u" : "alpha_v";
    }

    const Texture *roughness_texture(size_t i) const {
        return i == 0 ? m_alpha_u.get() : m_alpha_v.get();
    }

    /// Takes over what traverse() has changed.
    void set_roughness() {
        for (size_t i = 0; i < roughnesses(); ++i) {
            if (dr::width(m_shown_alpha[i]) != 1)
                Throw("parameter \"%s\" is an array of %s numbers, but must be one number",
                      roughness_name(i), dr::width(m_shown_alpha[i]));
            set_constant(i == 0 ? m_alpha_u.get() : m_alpha_v.get(), m_shown_alpha[i]);
        }
    }

    /// Gives traverse() the roughness as it is; one that has a gradient stays the variable that it
    /// is.
    void show_roughness() {
        for (size_t i = 0; i < roughnesses(); ++i)
            if (std::optional<double> value = constant(roughness_texture(i)))
                if (dr::width(m_shown_alpha[i]) != 1 || !dr::grad_enabled(m_shown_alpha[i]) ||
                    dr::slice(dr::detach(m_shown_alpha[i])) != (ScalarFloat)*value)
                    m_shown_alpha[i] = dr::opaque<Float>((ScalarFloat)*value);
    }

    // ------------------------------------------------------------------
    //  What is known before any light is
    // ------------------------------------------------------------------

    /// Tabulates what the coat reflects or transmits.
    void update_coat() {
        m_last_eta = dr::slice(dr::detach(m_eta));
        // Facets of greater roughness are no steeper to single precision
        auto alpha = [&](const Texture *texture) {
            return std::min(core_alpha(constant(texture).value_or(.1)), 1e6);
        };
        double u = alpha(m_alpha_u.get()), v = alpha(m_alpha_v.get());
        auto made = core_ndf()->interface(m_height_correlated, u, v, (double)m_last_eta,
                                          !m_multiple_scattering);
        if (made != m_interface.source)
            m_interface = SgtdInterface<Float>::load(std::move(made), u, v);
    }

    /// What follows from the rest by arithmetic alone.
    void update_weights() {
        Float diffuse  = m_diffuse_reflectance->mean(),
              specular = m_specular_reflectance ? m_specular_reflectance->mean() : Float(1.f),
              sum      = diffuse + specular;
        m_specular_sampling_weight =
            dr::clip(dr::select(sum > 0.f, specular / dr::maximum(sum, 1e-30f), .5f), 0.f, 1.f);
        m_inv_eta_2 = dr::rcp(dr::square(m_eta));
        dr::make_opaque(m_eta, m_inv_eta_2, m_specular_sampling_weight);
    }

    // ------------------------------------------------------------------
    //  Evaluation
    // ------------------------------------------------------------------

    /// Which lobes a query asks for.
    struct Lobes {
        bool specular, diffuse;

        explicit Lobes(const BSDFContext &ctx)
            : specular(ctx.is_enabled(BSDFFlags::GlossyReflection, 0)),
              diffuse(ctx.is_enabled(BSDFFlags::DiffuseReflection, 1)) {}

        bool any() const { return specular || diffuse; }
    };

    /// What a view has in common for all directions of light.
    struct View {
        /// T of the view
        Float transmitted;
        /// Probability to draw from what the coat reflects, and the share in it of light that it
        /// reflects twice or more
        Float specular, again;
        /// The surface as the table of missing energy knows it, 1 - E of the view, and F_ms
        typename SgtdMultipleScattering<Float>::Surface surface;
        Float lost, tint;
    };

    template <typename Facets> View look(const Facets &facets, const Lobes &lobes,
                                         const Vector3f &wi, const Mask &active) const {
        View view;
        if (m_multiple_scattering) {
            view.surface = loss_surface(facets);
            view.lost    = m_missing_energy.missing_energy(view.surface, wi);
            view.tint    = m_missing_energy.tint(view.surface.average_missing_energy,
                                                 m_interface.facet_reflectance);
            Float once = m_interface.at(wi, m_anisotropic, active), twice = view.tint * view.lost;
            view.again       = twice / dr::maximum(once + twice, 1e-30f);
            view.transmitted = dr::maximum(1.f - once - twice, 0.f);
        } else {
            view.transmitted = m_interface.at(wi, m_anisotropic, active);
        }
        if (lobes.specular && lobes.diffuse) {
            Float specular = (1.f - view.transmitted) * m_specular_sampling_weight,
                  diffuse  = view.transmitted * (1.f - m_specular_sampling_weight);
            view.specular  = specular / dr::maximum(specular + diffuse, 1e-30f);
        } else {
            view.specular = lobes.specular ? 1.f : 0.f;
        }
        return view;
    }

    /// T of a direction of light.
    Float transmitted(const View &view, const Vector3f &wo, const Mask &active) const {
        Float table = m_interface.at(wo, m_anisotropic, active);
        if (!m_multiple_scattering)
            return table;
        return dr::maximum(
            1.f - table - view.tint * m_missing_energy.missing_energy(view.surface, wo), 0.f);
    }

    /// R_int: the share of diffuse light from below that the coat throws back.
    Float internal_reflectance(const View &view) const {
        if (!m_multiple_scattering)
            return m_interface.internal_reflectance;
        // What is not thrown back leaves, and 1 - R leaves from below as T / eta^2 enters from
        // above
        Float enters = 1.f - m_interface.average - view.tint * view.surface.average_missing_energy;
        return 1.f - enters * m_inv_eta_2;
    }

    /// The value of the BSDF times the cosine, and the density of `wo` under sample().
    template <bool Value, bool Pdf>
    std::pair<Spectrum, Float> evaluate(const BSDFContext &ctx, const SurfaceInteraction3f &si,
                                        const Vector3f &wo, Mask active) const {
        const Lobes lobes(ctx);
        active &= Frame3f::cos_theta(si.wi) > 0.f && Frame3f::cos_theta(wo) > 0.f;
        if (unlikely(!lobes.any() || dr::none_or<false>(active)))
            return { 0.f, 0.f };
        return with_facets(si, active, [&](const auto &facets) {
            return evaluate<Value, Pdf>(facets, look(facets, lobes, si.wi, active), lobes, ctx, si,
                                        wo, active);
        });
    }

    /// The same for given facets.
    template <bool Value, bool Pdf, typename Facets>
    std::pair<Spectrum, Float> evaluate(const Facets &facets, const View &view, const Lobes &lobes,
                                        const BSDFContext &ctx, const SurfaceInteraction3f &si,
                                        const Vector3f &wo, const Mask &active) const {
        Spectrum value(0.f);
        Float pdf = 0.f;
        if (lobes.specular) {
            Vector3f m           = dr::normalize(wo + si.wi);
            auto at              = facets.template at<Value, Pdf>(si.wi, wo, m);
            std::tie(value, pdf) = Base::template single_scattering<Value, Pdf>(
                facets, at, si.wi, wo, active && reflects(si.wi, wo, m),
                [&](UnpolarizedSpectrum result, const Mask &lit) -> Spectrum {
                    if (m_specular_reflectance)
                        result *= m_specular_reflectance->eval(si, lit);
                    return reflectance(facets, ctx, si, wo, m) * result;
                });
            if (m_multiple_scattering) {
                if constexpr (Value) {
                    UnpolarizedSpectrum result =
                        view.tint * m_missing_energy.lobe(view.surface, view.lost, wo);
                    if (m_specular_reflectance)
                        result *= m_specular_reflectance->eval(si, active);
                    value += depolarizer<Spectrum>(result) & active;
                }
                if constexpr (Pdf)
                    pdf = dr::lerp(pdf, m_missing_energy.pdf(view.surface, wo), view.again);
            }
            if constexpr (Pdf)
                pdf *= view.specular;
        }
        if (lobes.diffuse) {
            Float cosine = Frame3f::cos_theta(wo);
            if constexpr (Value) {
                UnpolarizedSpectrum base = m_diffuse_reflectance->eval(si, active);
                const Float back         = internal_reflectance(view);
                UnpolarizedSpectrum result =
                    m_nonlinear ? UnpolarizedSpectrum(base * back) : UnpolarizedSpectrum(back);
                result = base / (1.f - result) *
                         (dr::InvPi<Float> * m_inv_eta_2 * cosine * view.transmitted *
                          transmitted(view, wo, active));
                value += depolarizer<Spectrum>(result) & active;
            }
            if constexpr (Pdf)
                pdf = dr::fmadd((1.f - view.specular) * dr::InvPi<Float>, cosine, pdf);
        }
        return { value, dr::select(active, pdf, 0.f) };
    }

    /// Fresnel reflectance of the facet `m`; a Mueller matrix in the bases of the two directions if
    /// polarized.
    template <typename Facets> Spectrum reflectance(const Facets &facets, const BSDFContext &ctx,
                                                    const SurfaceInteraction3f &si,
                                                    const Vector3f &wo, const Vector3f &m) const {
        Float cosine = facets.incidence(dr::dot(si.wi, m)), F = std::get<0>(fresnel(cosine, m_eta));
        if constexpr (is_polarized_v<Spectrum>) {
            Spectrum M = mueller::specular_reflection(UnpolarizedSpectrum(cosine),
                                                      UnpolarizedSpectrum(m_eta));
            // Fresnel's equations without polarization round otherwise
            UnpolarizedSpectrum M00 = M(0, 0);
            M *= UnpolarizedSpectrum(F) / dr::select(M00 > 0.f, M00, 1.f);
            return to_stokes_bases(ctx, M, si.wi, wo, m) & dr::all(M00 > 0.f);
        } else {
            DRJIT_MARK_USED(ctx);
            DRJIT_MARK_USED(wo);
            return F;
        }
    }

private:
    ref<Texture> m_diffuse_reflectance, m_specular_reflectance;
    /// Index of refraction of the coat over that above, and what follows from it
    Float m_eta, m_inv_eta_2;
    ScalarFloat m_last_eta = 1;
    /// The roughness for traverse(): the second one only if there are two
    Float m_shown_alpha[2];
    Float m_specular_sampling_weight;
    FrozenChoice<Float> m_nonlinear;
    /// Is there a specular_reflectance?
    FrozenChoice<Float> m_colored;
    /// R of the coat if light is scattered more than once, T otherwise
    SgtdInterface<Float> m_interface;

    MI_TRAVERSE_CB(Base, m_nonlinear, m_colored, m_diffuse_reflectance, m_specular_reflectance,
                   m_eta, m_inv_eta_2, m_shown_alpha, m_specular_sampling_weight, m_interface)
};

/// Entry point; refuses to register anything in another release of Mitsuba, whose classes have
/// another layout.
extern "C" MI_EXPORT void init_plugin(std::string_view name, PluginRegisterFn fn) {
    sgtd::check_mitsuba_version();
    MI_REGISTER_PLUGIN(fn, name, SgtdPlastic);
}

NAMESPACE_END(mitsuba)

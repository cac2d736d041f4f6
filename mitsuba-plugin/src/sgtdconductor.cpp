#include <mitsuba/core/string.h>
#include <mitsuba/render/bsdf.h>
#include <mitsuba/render/fresnel.h>
#include <mitsuba/render/ior.h>
#include <mitsuba/render/microfacet.h>
#include <mitsuba/render/texture.h>

#include <cmath>
#include <sstream>

#include "mitsuba_version.h"
#include "sgtd_distribution.h"
#include "sgtd_multiple_scattering.h"

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
   - Real and imaginary part of the index of refraction. Numbers must be finite and at least 0.
     (Default: 0 and 1, a perfect mirror)
   - |exposed|, |differentiable|, |discontinuous|

 * - specular_reflectance
   - |spectrum| or |texture|
   - Factor on the reflected light. Numbers must be finite and at least 0. (Default: 1)
   - |exposed|, |differentiable|

 * - alpha, alpha_u, alpha_v
   - |float| or |texture|
   - Roughness, or roughness along the tangent and the bitangent. Numbers must be finite and at
     least 0. Values below 1e-4 are raised to 1e-4, those of textures too. (Default: 0.1)
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

 * - gamma
   - |float|
   - Tail, greater than 1; small values are heavy tails, inf is allowed. 2 p gamma must exceed 3.
     (Default: 2)
   - |exposed|

 * - p
   - |float|
   - Kurtosis, 0.1 to 100: 1 is the bell of Beckmann and GGX, larger values are flatter.
     (Default: 1)
   - |exposed|

 * - lambda
   - |float|
   - Skew, -0.9999 to 0.9999: positive values widen the outer side of the shift. (Default: 0)
   - |exposed|

 * - shift
   - |float|
   - Slope at which the profile peaks divided by the roughness, 0 to 10000. Free in every row.
     (Default: 0)
   - |exposed|

 * - mu
   - |float|
   - That slope itself, at least 0. Excludes ``shift``; needs one constant ``alpha``. The tables
     follow when ``alpha`` is changed; derivatives with respect to ``alpha`` are those at a fixed
     shift. (Default: none)
   - |exposed|

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

 * - accuracy
   - |float|
   - Relative error of G1 that the tables may have, 0 to 0.1. 0 asks for the finest tables, and for
     quadrature on every call in scalar variants. (Default: 1e-5)

This is a drop-in for ``roughconductor`` whose microfacet normals follow the skewed generalized
t-distribution of Ribardiere et al., *Microfacet BSDFs Generated from NDFs and Explicit
Microgeometry*, 2019. With the slope t = tan(theta) of a normal and x = t / alpha,

    D = A f(x) / (pi alpha_u alpha_v cos(theta)^4)
    f(x) = (1 + u / (gamma - 1))^(-gamma),  u = (abs(x - shift) / (1 +- lambda))^(2 p)

with + where x exceeds the shift; gamma = inf means f = exp(-u). Two roughnesses stretch the slopes
along the two tangents, as in GGX. All defaults together are GGX, while ``roughconductor`` defaults
to Beckmann: name the distribution when the two are compared.

``beckmann`` and ``ggx`` without a shift run on Mitsuba's own MicrofacetDistribution and give the
values of ``roughconductor``.

With ``multiple_scattering``, a reciprocal lobe returns what single scattering loses,

    f_ms = F_ms (1 - E(w_i)) (1 - E(w_o)) / (pi (1 - E_avg))

where E is the albedo of single scattering for a perfect mirror, tabulated for this shape and this
masking, and E_avg its average. F_ms = F^2 E_avg / (1 - F (1 - E_avg)), with the average F of the
Fresnel reflectance, is what repeated reflections leave of each wavelength: metals become darker and
more saturated as roughness grows, and a mirror loses nothing. ``specular_reflectance`` scales the
sum of both lobes, and polarized variants return this light unpolarized. Two roughnesses are
tabulated as a pair, and again when one is changed; if a texture drives one of them, E is that of
the isotropic surface with their mean, and the balance of energy is approximate. Tables follow
roughness up to 8.

The shape parameters are exposed as plain numbers, without derivatives. Changing one makes new
tables; a value out of range is refused, and the material keeps what it had.

 */
// clang-format on
template <typename Float, typename Spectrum> class SgtdConductor final
    : public BSDF<Float, Spectrum> {
public:
    MI_IMPORT_BASE(BSDF, m_flags, m_components)
    MI_IMPORT_TYPES(Texture, MicrofacetDistribution)
    using Distribution = SgtdDistribution<Float, Spectrum>;

    SgtdConductor(const Properties &props) : Base(props) {
        read_metal(props);
        read_roughness(props);
        read_shape(props);

        m_sample_visible    = props.get<bool>("sample_visible", true);
        std::string masking = string::to_lower(props.get<std::string_view>("masking", "separable"));
        if (masking != "separable" && masking != "height_correlated")
            Throw("masking \"%s\" is unknown: choose one of separable, height_correlated", masking);
        m_height_correlated = masking == "height_correlated";
        m_accuracy          = props.get<double>("accuracy", 1e-5);
        if (!(m_accuracy >= 0.0 && m_accuracy <= 0.1))
            Throw("parameter \"accuracy\" is %s, but must be between 0 and 0.1", m_accuracy);

        m_multiple_scattering = props.get<bool>("multiple_scattering", false);

        update_shape();
        update_losses();
        update_flags();
    }

    void traverse(TraversalCallback *cb) override {
        const auto rough = ParamFlags::Differentiable | ParamFlags::Discontinuous;
        if (m_specular_reflectance)
            cb->put("specular_reflectance", m_specular_reflectance, ParamFlags::Differentiable);
        if (m_alpha_u == m_alpha_v) {
            cb->put("alpha", m_alpha_u, rough);
        } else {
            cb->put("alpha_u", m_alpha_u, rough);
            cb->put("alpha_v", m_alpha_v, rough);
        }
        cb->put("eta", m_eta, rough);
        cb->put("k", m_k, rough);
        for (Parameter &parameter : m_parameters)
            if (parameter.free)
                cb->put(parameter.name, parameter.value, ParamFlags::NonDifferentiable);
    }

    void parameters_changed(const std::vector<std::string> &keys = {}) override {
        bool shape =
            keys.empty() || (m_parameters[Offset].is_mu && string::contains(keys, "alpha"));
        for (const Parameter &parameter : m_parameters)
            shape |= string::contains(keys, parameter.name);
        if (shape)
            update_shape();
        if (shape || (m_losses.fixed &&
                      (string::contains(keys, "alpha_u") || string::contains(keys, "alpha_v"))))
            update_losses();
        update_flags();
    }

    std::pair<BSDFSample3f, Spectrum> sample(const BSDFContext &ctx, const SurfaceInteraction3f &si,
                                             Float sample1, const Point2f &sample2,
                                             Mask active) const override {
        MI_MASKED_FUNCTION(ProfilerPhase::BSDFSample, active);

        BSDFSample3f bs   = dr::zeros<BSDFSample3f>();
        Float cos_theta_i = Frame3f::cos_theta(si.wi);
        active &= cos_theta_i > 0.f;
        if (unlikely(!ctx.is_enabled(BSDFFlags::GlossyReflection) || dr::none_or<false>(active)))
            return { bs, 0.f };

        Normal3f m;
        UnpolarizedSpectrum weight;
        Mask visible            = active;
        auto [alpha_u, alpha_v] = roughness(si, active);
        if (m_builtin) {
            MicrofacetDistribution distr(*m_builtin, alpha_u, alpha_v, m_sample_visible);
            std::tie(m, bs.pdf) = distr.sample(si.wi, sample2);
            bs.wo               = reflect(si.wi, m);
            active &= bs.pdf != 0.f && Frame3f::cos_theta(bs.wo) > 0.f;
            if (m_sample_visible)
                weight = m_height_correlated
                             ? Float(builtin_g2(distr, si.wi, bs.wo, m) / distr.smith_g1(si.wi, m))
                             : distr.smith_g1(bs.wo, m);
            else
                weight = builtin_g2(distr, si.wi, bs.wo, m) * dr::dot(si.wi, m) /
                         (cos_theta_i * Frame3f::cos_theta(m));
        } else {
            Distribution distr(*m_ndf, m_tables, alpha_u, alpha_v, m_sample_visible);
            auto drawn = distr.sample(si.wi, sample2);
            m          = drawn.m;
            bs.pdf     = drawn.pdf;
            bs.wo      = reflect(si.wi, m);
            // A cosine below 1e-7 is the rounding of the reflection, its sign included
            active &= bs.pdf > 0.f && Frame3f::cos_theta(bs.wo) > 1e-7f && dr::dot(si.wi, m) > 0.f;
            weight = drawn.d_over_pdf * distr.G(si.wi, bs.wo, m, m_height_correlated) *
                     dr::dot(si.wi, m) / cos_theta_i;
        }

        bs.eta               = 1.f;
        bs.sampled_component = 0;
        bs.sampled_type      = +BSDFFlags::GlossyReflection;
        if (m_multiple_scattering) {
            // One of the lobes gives the direction, both of them its value and density
            auto surface = loss_surface(alpha_u, alpha_v);
            Float lost   = m_losses.loss(surface, si.wi);
            Mask again   = visible && sample1 < lost;
            bs.wo        = dr::select(
                again, m_losses.sample(surface, sample1 / dr::maximum(lost, 1e-30f), sample2),
                bs.wo);
            auto [value, pdf] = evaluate<true, true>(ctx, si, bs.wo, again || active);
            bs.pdf            = pdf;
            return { bs, (value / dr::maximum(pdf, 1e-30f)) & (pdf > 0.f) };
        }
        // From normals to outgoing directions
        bs.pdf /= 4.f * dr::dot(bs.wo, m);

        Spectrum F = reflectance(ctx, si, bs.wo, m, active);
        if (m_specular_reflectance)
            weight *= m_specular_reflectance->eval(si, active);
        return { bs, (F * weight) & active };
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
        oss << "SgtdConductor[" << std::endl << "  distribution = " << m_row << "," << std::endl;
        for (const Parameter &parameter : m_parameters)
            if (parameter.free)
                oss << "  " << parameter.name << " = " << parameter.value << "," << std::endl;
        oss << "  masking = " << (m_height_correlated ? "height_correlated" : "separable") << ","
            << std::endl
            << "  multiple_scattering = " << m_multiple_scattering << "," << std::endl
            << "  sample_visible = " << m_sample_visible << "," << std::endl
            << "  accuracy = " << m_accuracy << "," << std::endl
            << "  alpha_u = " << string::indent(m_alpha_u) << "," << std::endl
            << "  alpha_v = " << string::indent(m_alpha_v) << "," << std::endl;
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

    /// A number of at least 0; absent, its default.
    static double number(const Properties &props, const char *name, double default_value) {
        double value = props.get<double>(name, default_value);
        if (!std::isfinite(value) || value < 0.0)
            Throw("parameter \"%s\" is %s, but must be a finite number of at least 0", name, value);
        return value;
    }

    /// Checks a property that a texture is made from, where it is a plain number or color.
    static void check_constant(const Properties &props, const char *name) {
        if (!props.has_property(name))
            return;
        Properties::Type type = props.type(name);
        if (type == Properties::Type::Float || type == Properties::Type::Integer) {
            number(props, name, 0.0);
        } else if (type == Properties::Type::Color) {
            ScalarColor3f color = props.get<ScalarColor3f>(name);
            for (size_t i = 0; i < 3; ++i)
                if (!std::isfinite(color[i]) || color[i] < 0.f)
                    Throw("parameter \"%s\" is %s, but its parts must be finite numbers of at "
                          "least 0",
                          name, color);
        }
    }

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
    }

    void read_roughness(const Properties &props) {
        for (const char *name : { "alpha", "alpha_u", "alpha_v" })
            check_constant(props, name);
        bool u = props.has_property("alpha_u"), v = props.has_property("alpha_v");
        if (u != v)
            Throw("parameter \"%s\" is missing: give both alpha_u and alpha_v, or alpha alone",
                  u ? "alpha_v" : "alpha_u");
        if (u && props.has_property("alpha"))
            Throw("parameters \"alpha\" and \"alpha_u\", \"alpha_v\" are given together: choose "
                  "alpha alone, or the other two");
        if (u) {
            m_alpha_u = props.get_unbounded_texture<Texture>("alpha_u");
            m_alpha_v = props.get_unbounded_texture<Texture>("alpha_v");
        } else {
            m_alpha_u = m_alpha_v = props.get_unbounded_texture<Texture>("alpha", 0.1f);
        }
    }

    void read_shape(const Properties &props) {
        m_row = string::to_lower(props.get<std::string_view>("distribution", "sgtd"));
        for (Parameter &parameter : m_parameters)
            if (props.has_property(parameter.name)) {
                parameter.value = props.get<double>(parameter.name);
                parameter.given = true;
            }

        Parameter &offset = m_parameters[Offset];
        if (props.has_property("mu")) {
            if (offset.given)
                Throw("parameters \"mu\" and \"shift\" are given together: choose one (shift = mu "
                      "/ alpha)");
            Properties::Type type =
                props.has_property("alpha") ? props.type("alpha") : Properties::Type::Float;
            if (m_alpha_u != m_alpha_v ||
                (type != Properties::Type::Float && type != Properties::Type::Integer))
                Throw("parameter \"mu\" is given, but needs \"alpha\" as one number (the shape "
                      "depends on mu / alpha): give \"shift\" instead");
            offset = { "mu", number(props, "mu", 0.0), true, true, true };
        }

        // A parameter is free if the row accepts it beside those that were given
        sgtd::host::Shape shape = resolve(&Parameter::given).shape;
        const double values[]   = { shape.gamma, shape.p, shape.lambda };
        std::optional<double> given[Offset];
        for (size_t i = 0; i < Offset; ++i)
            if (m_parameters[i].given)
                given[i] = values[i];
        for (size_t i = 0; i < Offset; ++i) {
            Parameter &parameter                = m_parameters[i];
            std::optional<double> probe[Offset] = { given[0], given[1], given[2] };
            parameter.value                     = *(probe[i] = values[i]);
            try {
                sgtd::host::shape_of_row(m_row, probe[0], probe[1], probe[2], {});
                parameter.free = true;
            } catch (const std::invalid_argument &) {
                parameter.free = false;
            }
        }
    }

    // ------------------------------------------------------------------
    //  Shape
    // ------------------------------------------------------------------

    /// A shape parameter as the user sees it.
    struct Parameter {
        const char *name;
        double value;
        /// Was it given by the user?
        bool given;
        /// Does the row leave it free?
        bool free;
        /// Is it an absolute slope, to be divided by the roughness?
        bool is_mu;
    };

    /// The shape for the current values of the parameters for which `present` holds.
    sgtd::host::RowShape resolve(bool Parameter::*present) const {
        std::optional<double> values[Offset + 1];
        for (size_t i = 0; i <= Offset; ++i)
            if (m_parameters[i].*present)
                values[i] = m_parameters[i].value;
        try {
            if (!m_parameters[Offset].is_mu)
                return sgtd::host::shape_of_row(m_row, values[0], values[1], values[2], values[3]);

            double mu = m_parameters[Offset].value;
            if (!std::isfinite(mu) || mu < 0.0)
                Throw("parameter \"mu\" is %s, but must be a finite number of at least 0", mu);
            // alpha_scale does not depend on the shift
            double scale =
                sgtd::host::shape_of_row(m_row, values[0], values[1], values[2], {}).alpha_scale;
            double alpha = std::max((double)dr::slice(dr::detach(m_alpha_u->mean())) * scale, 1e-4);
            try {
                return sgtd::host::shape_of_row(m_row, values[0], values[1], values[2], mu / alpha);
            } catch (const std::invalid_argument &error) {
                Throw("parameter \"mu\" is %s at a roughness of %s, where %s", mu, alpha,
                      error.what());
            }
        } catch (const std::invalid_argument &error) {
            Throw("%s", error.what());
        }
    }

    /// Makes the tables for the current parameters; if they are refused, restores the parameters
    /// and throws.
    void update_shape() {
        try {
            sgtd::host::RowShape row = resolve(&Parameter::free);
            if (m_current && m_current->row.shape == row.shape) {
                m_current->parameters = m_parameters;
                return;
            }

            std::optional<MicrofacetType> builtin;
            if (row.shape.shift == 0.0 && m_row == "beckmann")
                builtin = MicrofacetType::Beckmann;
            if (row.shape.shift == 0.0 && m_row == "ggx")
                builtin = MicrofacetType::GGX;

            std::shared_ptr<const sgtd::host::Ndf> ndf;
            // Without tables there are fewer variables to traverse, so frozen functions notice the
            // switch
            SgtdTables<Float> tables;
            if (!builtin) {
                try {
                    ndf = sgtd::host::Ndf::get(row.shape, m_accuracy, m_sample_visible);
                } catch (const std::invalid_argument &error) {
                    Throw("%s", error.what());
                }
                tables = SgtdTables<Float>::load(*ndf, row);
            }

            m_builtin = builtin;
            m_ndf     = std::move(ndf);
            m_tables  = std::move(tables);
            m_current = { row, m_parameters };
        } catch (...) {
            if (m_current)
                m_parameters = m_current->parameters;
            throw;
        }
    }

    /// Makes the table of what single scattering loses, if it is to be returned.
    void update_losses() {
        if (!m_multiple_scattering)
            return;
        using MultipleScattering = SgtdMultipleScattering<Float>;
        const auto &row          = m_current->row;
        // Mitsuba's own distributions have no tables of ours
        std::shared_ptr<const sgtd::host::Ndf> ndf =
            m_ndf ? m_ndf : sgtd::host::Ndf::get(row.shape, m_accuracy, m_sample_visible);
        auto constant = [&](const Texture *alpha) {
            return std::max((double)dr::slice(dr::detach(alpha->mean())) * row.alpha_scale, 1e-4);
        };
        bool varying = m_alpha_u->is_spatially_varying() || m_alpha_v->is_spatially_varying();
        if (m_alpha_u == m_alpha_v || varying) {
            m_losses = MultipleScattering::load(ndf->losses(m_height_correlated));
        } else {
            double u = constant(m_alpha_u.get()), v = constant(m_alpha_v.get());
            m_losses = MultipleScattering::load(ndf->losses(m_height_correlated, u, v), u, v);
        }
    }

    void update_flags() {
        m_flags = BSDFFlags::GlossyReflection | BSDFFlags::FrontSide;
        if (m_alpha_u != m_alpha_v)
            m_flags = m_flags | BSDFFlags::Anisotropic;
        m_components.clear();
        m_components.push_back(m_flags);
    }

    // ------------------------------------------------------------------
    //  Evaluation
    // ------------------------------------------------------------------

    std::pair<Float, Float> roughness(const SurfaceInteraction3f &si, Mask active) const {
        return { m_alpha_u->eval_1(si, active), m_alpha_v->eval_1(si, active) };
    }

    /// The roughness as the table of losses knows it.
    auto loss_surface(const Float &alpha_u, const Float &alpha_v) const {
        auto least = [&](const Float &alpha) {
            return dr::maximum(m_builtin ? alpha : alpha * m_tables.alpha_scale, 1e-4f);
        };
        return m_losses.surface(least(alpha_u), least(alpha_v));
    }

    /// Masking and shadowing for Mitsuba's own distributions.
    Float builtin_g2(const MicrofacetDistribution &distr, const Vector3f &wi, const Vector3f &wo,
                     const Vector3f &m) const {
        if (!m_height_correlated)
            return distr.G(wi, wo, m);
        // 1/(1 + Lambda_i + Lambda_o) with Lambda = 1/G1 - 1
        Float g_i = distr.smith_g1(wi, m), g_o = distr.smith_g1(wo, m);
        return dr::select(g_i > 0.f && g_o > 0.f, g_i * g_o / (g_i + g_o - g_i * g_o), 0.f);
    }

    /// The value of the BSDF times the cosine, and the density of `wo` under sample().
    template <bool Value, bool Pdf>
    std::pair<Spectrum, Float> evaluate(const BSDFContext &ctx, const SurfaceInteraction3f &si,
                                        const Vector3f &wo, Mask active) const {
        Float cos_theta_i = Frame3f::cos_theta(si.wi), cos_theta_o = Frame3f::cos_theta(wo);
        Vector3f m = dr::normalize(wo + si.wi);
        // A facet is seen from its front side from both directions
        active &= cos_theta_i > 0.f && cos_theta_o > 0.f && dr::dot(si.wi, m) > 0.f &&
                  dr::dot(wo, m) > 0.f;
        if (unlikely(!ctx.is_enabled(BSDFFlags::GlossyReflection) || dr::none_or<false>(active)))
            return { 0.f, 0.f };

        Float D = 0.f, G = 0.f, pdf = 0.f;
        auto [alpha_u, alpha_v] = roughness(si, active);
        if (m_builtin) {
            MicrofacetDistribution distr(*m_builtin, alpha_u, alpha_v, m_sample_visible);
            if constexpr (Value || Pdf)
                D = distr.eval(m);
            if constexpr (Value)
                G = builtin_g2(distr, si.wi, wo, m);
            if constexpr (Pdf)
                pdf = m_sample_visible ? D * distr.smith_g1(si.wi, m) / (4.f * cos_theta_i)
                                       : distr.pdf(si.wi, m) / (4.f * dr::dot(wo, m));
        } else {
            // Products of denormal cosines are 0, and their quotients not a number
            active &= dr::minimum(cos_theta_i, cos_theta_o) > 1e-30f;
            Distribution distr(*m_ndf, m_tables, alpha_u, alpha_v, m_sample_visible);
            if constexpr (Value) {
                D = distr.eval(si.wi, wo);
                G = distr.G(si.wi, wo, m, m_height_correlated);
            }
            if constexpr (Pdf)
                pdf = distr.pdf(si.wi, m) / (4.f * dr::maximum(dr::dot(wo, m), 1e-18f));
        }

        Spectrum value(0.f);
        if constexpr (Value) {
            UnpolarizedSpectrum result = D * G / (4.f * cos_theta_i);
            // Within 1e-18 of grazing, D and 1/cos leave single precision
            Mask lit   = active && D > 0.f && dr::all(dr::isfinite(result));
            Spectrum F = reflectance(ctx, si, wo, m, lit);
            if (m_specular_reflectance)
                result *= m_specular_reflectance->eval(si, lit);
            value = (F * result) & lit;
        }
        pdf = dr::select(active && dr::isfinite(pdf), pdf, 0.f);
        if (m_multiple_scattering)
            add_multiple_scattering<Value, Pdf>(si, wo, alpha_u, alpha_v, active, value, pdf);
        return { value, pdf };
    }

    /// Adds the lobe that returns what single scattering loses, and the density of its samples.
    template <bool Value, bool Pdf>
    void add_multiple_scattering(const SurfaceInteraction3f &si, const Vector3f &wo,
                                 const Float &alpha_u, const Float &alpha_v, const Mask &active,
                                 Spectrum &value, Float &pdf) const {
        auto surface = loss_surface(alpha_u, alpha_v);
        Float lost   = m_losses.loss(surface, si.wi);
        if constexpr (Value) {
            dr::Complex<UnpolarizedSpectrum> eta(m_eta->eval(si, active), m_k->eval(si, active));
            UnpolarizedSpectrum result =
                m_losses.tint(surface.average_loss, eta) *
                (dr::InvPi<Float> * Frame3f::cos_theta(wo) * lost * m_losses.loss(surface, wo) /
                 dr::maximum(surface.average_loss, 1e-30f));
            if (m_specular_reflectance)
                result *= m_specular_reflectance->eval(si, active);
            value += depolarizer<Spectrum>(result) & active;
        }
        if constexpr (Pdf)
            pdf = dr::select(active, dr::lerp(pdf, m_losses.pdf(surface, wo), lost), 0.f);
    }

    /// Fresnel reflectance of the facet `m`; a Mueller matrix in the bases of the two directions if
    /// polarized.
    Spectrum reflectance(const BSDFContext &ctx, const SurfaceInteraction3f &si, const Vector3f &wo,
                         const Vector3f &m, Mask active) const {
        dr::Complex<UnpolarizedSpectrum> eta(m_eta->eval(si, active), m_k->eval(si, active));
        // Below 1e-10 the square of the cosine is 0, and Fresnel's equations are 0/0 for eta = 1
        auto cosine = [&](const Vector3f &w) {
            return UnpolarizedSpectrum(dr::maximum(dr::dot(w, m), 1e-10f));
        };
        if constexpr (is_polarized_v<Spectrum>) {
            // Light travels along -to_light and leaves along to_eye; an adjoint query swaps the two
            bool radiance     = ctx.mode == TransportMode::Radiance;
            Vector3f to_light = radiance ? wo : si.wi, to_eye = radiance ? si.wi : wo;

            Spectrum M = mueller::specular_reflection(cosine(to_light), eta);

            // M refers to axes perpendicular to the plane of incidence. Any axis will do where
            // there is no such plane.
            Vector3f axis_in = dr::cross(m, -to_light), axis_out = dr::cross(m, to_eye);
            // (the square of a smaller length underflows in normalize())
            Mask collinear = dr::squared_norm(axis_in) < 1e-30f;
            axis_in        = dr::select(collinear, Vector3f(1, 0, 0), dr::normalize(axis_in));
            axis_out       = dr::select(collinear, Vector3f(1, 0, 0), dr::normalize(axis_out));

            return mueller::rotate_mueller_basis(M, -to_light, axis_in,
                                                 mueller::stokes_basis(-to_light), to_eye, axis_out,
                                                 mueller::stokes_basis(to_eye));
        } else {
            return fresnel_conductor(cosine(si.wi), eta);
        }
    }

private:
    ref<Texture> m_eta, m_k, m_specular_reflectance, m_alpha_u, m_alpha_v;
    bool m_sample_visible, m_height_correlated, m_multiple_scattering;
    double m_accuracy;

    /// Name of the row, and its parameters; the last one is the shift or mu.
    static constexpr size_t Offset = 3;
    using Parameters               = std::array<Parameter, Offset + 1>;
    std::string m_row;
    Parameters m_parameters = { { { "gamma", 0.0, false, false, false },
                                  { "p", 0.0, false, false, false },
                                  { "lambda", 0.0, false, false, false },
                                  { "shift", 0.0, false, true, false } } };

    /// What the tables were made for.
    struct Current {
        sgtd::host::RowShape row;
        Parameters parameters;
    };
    std::optional<Current> m_current;

    /// Set where Mitsuba's own distribution is used instead of the tables
    std::optional<MicrofacetType> m_builtin;
    std::shared_ptr<const sgtd::host::Ndf> m_ndf;
    SgtdTables<Float> m_tables;
    /// Empty unless light is scattered more than once
    SgtdMultipleScattering<Float> m_losses;

    MI_TRAVERSE_CB(Base, m_eta, m_k, m_specular_reflectance, m_alpha_u, m_alpha_v, m_tables,
                   m_losses)
};

/// Entry point; refuses to register anything in another release of Mitsuba, whose classes have
/// another layout.
extern "C" MI_EXPORT void init_plugin(std::string_view name, PluginRegisterFn fn) {
    sgtd::check_mitsuba_version();
    MI_REGISTER_PLUGIN(fn, name, SgtdConductor);
}

NAMESPACE_END(mitsuba)

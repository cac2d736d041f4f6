#pragma once

#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <ostream>

#include <mitsuba/core/properties.h>
#include <mitsuba/core/string.h>
#include <mitsuba/render/bsdf.h>
#include <mitsuba/render/microfacet.h>
#include <mitsuba/render/mueller.h>
#include <mitsuba/render/texture.h>

#include "sgtd_distribution.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * What all BSDFs with an SGTD distribution have in common: the roughness, the row of the family
 * with its parameters, and the distribution that follows from them.
 */
template <typename Float, typename Spectrum> class SgtdBSDF : public BSDF<Float, Spectrum> {
public:
    MI_IMPORT_BASE(BSDF)
    MI_IMPORT_TYPES(Texture, MicrofacetDistribution)

    void traverse(TraversalCallback *cb) override {
        const auto rough = ParamFlags::Differentiable | ParamFlags::Discontinuous;
        if (m_alpha_u == m_alpha_v) {
            cb->put("alpha", m_alpha_u, rough);
        } else {
            cb->put("alpha_u", m_alpha_u, rough);
            cb->put("alpha_v", m_alpha_v, rough);
        }
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
    }

protected:
    SgtdBSDF(const Properties &props) : Base(props) {
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

        update_shape();
    }

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

    // ------------------------------------------------------------------
    //  Use by the BSDF
    // ------------------------------------------------------------------

    /// The roughness along both tangents, as `MicrofacetDistribution` or `SgtdDistribution` takes
    /// it.
    std::pair<Float, Float> roughness(const SurfaceInteraction3f &si, Mask active) const {
        Float alpha_u = m_alpha_u->eval_1(si, active),
              alpha_v = m_alpha_u == m_alpha_v ? alpha_u : m_alpha_v->eval_1(si, active);
        if (m_builtin_scaled) {
            alpha_u *= m_tables.alpha_scale;
            alpha_v *= m_tables.alpha_scale;
        }
        return { alpha_u, alpha_v };
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

    /// From the Mueller matrix of the facet `m`, whose axes are those of the plane of incidence, to
    /// that of the bases which Mitsuba gives to the two directions.
    static Spectrum to_stokes_bases(const BSDFContext &ctx, const Spectrum &M, const Vector3f &wi,
                                    const Vector3f &wo, const Vector3f &m) {
        // Light travels along -to_light and leaves along to_eye; an adjoint query swaps the two
        bool radiance     = ctx.mode == TransportMode::Radiance;
        Vector3f to_light = radiance ? wo : wi, to_eye = radiance ? wi : wo;

        // Axes perpendicular to the plane of incidence. Any will do where there is no such plane.
        Vector3f axis_in = dr::cross(m, -to_light), axis_out = dr::cross(m, to_eye);
        // (the square of a smaller length underflows in normalize())
        Mask collinear = dr::squared_norm(axis_in) < 1e-30f;
        axis_in        = dr::select(collinear, Vector3f(1, 0, 0), dr::normalize(axis_in));
        axis_out       = dr::select(collinear, Vector3f(1, 0, 0), dr::normalize(axis_out));

        return mueller::rotate_mueller_basis(M, -to_light, axis_in,
                                             mueller::stokes_basis(-to_light), to_eye, axis_out,
                                             mueller::stokes_basis(to_eye));
    }

    /// Writes the lines of to_string() that all BSDFs have.
    void describe(std::ostream &os) const {
        os << "  distribution = " << m_row << "," << std::endl;
        for (const Parameter &parameter : m_parameters)
            if (parameter.free)
                os << "  " << parameter.name << " = " << parameter.value << "," << std::endl;
        os << "  masking = " << (m_height_correlated ? "height_correlated" : "separable") << ","
           << std::endl
           << "  sample_visible = " << m_sample_visible << "," << std::endl
           << "  accuracy = " << m_accuracy << "," << std::endl
           << "  alpha_u = " << string::indent(m_alpha_u) << "," << std::endl
           << "  alpha_v = " << string::indent(m_alpha_v) << "," << std::endl;
    }

private:
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

            // Whatever the row was called, its numbers decide what is needed
            sgtd::host::Node node        = sgtd::host::lowest_node(row.shape);
            sgtd::host::RowShape reduced = { node.shape, row.alpha_scale * node.alpha_scale };
            std::optional<MicrofacetType> builtin;
            if (node.closed_form)
                builtin = MicrofacetType::GGX;
            // Mitsuba masks Beckmann by a fit that is off by 6e-3: only for who asks for it by name
            else if (m_row == "beckmann" && node.shape.shift == 0.0)
                builtin = MicrofacetType::Beckmann;

            std::shared_ptr<const sgtd::host::Ndf> ndf;
            SgtdTables<Float> tables;
            if (builtin) {
                tables = SgtdTables<Float>::without(reduced.alpha_scale);
            } else {
                try {
                    ndf = sgtd::host::Ndf::get(
                        reduced.shape, SgtdTables<Float>::accuracy(m_accuracy), m_sample_visible);
                } catch (const std::invalid_argument &error) {
                    Throw("%s", error.what());
                }
                tables = SgtdTables<Float>::load(*ndf, reduced);
            }

            m_builtin        = builtin;
            m_builtin_scaled = builtin && reduced.alpha_scale != 1.0;
            m_ndf            = std::move(ndf);
            m_tables         = std::move(tables);
            m_node           = reduced;
            m_current        = { row, m_parameters };
        } catch (...) {
            if (m_current)
                m_parameters = m_current->parameters;
            throw;
        }
    }

protected:
    ref<Texture> m_alpha_u, m_alpha_v;
    bool m_sample_visible, m_height_correlated;

    /// Set where Mitsuba's own distribution is used instead of the tables
    std::optional<MicrofacetType> m_builtin;
    /// Is its roughness that of the user times `m_tables.alpha_scale`?
    bool m_builtin_scaled = false;
    std::shared_ptr<const sgtd::host::Ndf> m_ndf;
    SgtdTables<Float> m_tables;
    /// The lowest node that the numbers allow, and the factor on the user's roughness there
    sgtd::host::RowShape m_node;

private:
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

    MI_TRAVERSE_CB(Base, m_alpha_u, m_alpha_v, m_tables)
};

NAMESPACE_END(mitsuba)

#pragma once

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <ostream>
#include <set>
#include <vector>

#include <mitsuba/core/properties.h>
#include <mitsuba/core/string.h>
#include <mitsuba/render/bsdf.h>
#include <mitsuba/render/microfacet.h>
#include <mitsuba/render/mueller.h>
#include <mitsuba/render/texture.h>

#include "facets.h"
#include "frozen_choice.h"
#include "radial_source.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * What all BSDFs with an SGTD distribution have in common: the roughness, the row of the family
 * with its parameters, and the distribution that follows from them.
 */
template <typename Float, typename Spectrum> class SgtdBSDF : public BSDF<Float, Spectrum> {
public:
    MI_IMPORT_BASE(BSDF)
    MI_IMPORT_TYPES(Texture)

    void traverse(TraversalCallback *cb) override {
        traverse_roughness(cb, ParamFlags::Differentiable | ParamFlags::Discontinuous);
        m_source.traverse(cb);
        for (size_t i = 0; i < Count; ++i)
            if (m_parameters[i].free)
                cb->put(m_parameters[i].name, m_shown[i], ParamFlags::Differentiable);
    }

    void parameters_changed(const std::vector<std::string> &keys = {}) override {
        try {
            std::vector<std::optional<double>> numbers = check_textures(keys);
            bool shape                                 = read_parameters(keys);
            if (m_source) {
                const char *followed = m_source.with_gradient(attached);
                if (const char *reason = followed ? no_gradient() : nullptr)
                    Throw("parameter \"%s\" has a gradient, but %s", followed, reason);
                const bool moved = m_source.update(keys);
                if (!recording<Float>()) {
                    if (moved || m_numbers.any != (followed != nullptr)) {
                        update_source();
                        numbers[0] = m_watched[0].last; // it may have followed
                    }
                    tie_numbers();
                }
            }
            if (m_parameters[Offset].is_mu && changed(keys, "alpha")) {
                if (recording<Float>() && !keys.empty())
                    Throw("parameter \"mu\" is given, so the shape depends on \"alpha\", which "
                          "cannot be changed inside a frozen function: change it before the call, "
                          "or give \"shift\" instead");
                shape = !recording<Float>();
            }
            if (!recording<Float>() && (shape || with_gradient(attached) != m_gradient.which()))
                update_shape();
            for (size_t i = 0; i < m_watched.size(); ++i)
                m_watched[i].last = numbers[i];
        } catch (...) {
            restore();
            throw;
        }
    }

    UnpolarizedSpectrum eval_attribute(const std::string &name, const SurfaceInteraction3f &si,
                                       Mask active) const override {
        const Float *number = shown(name);
        return number ? UnpolarizedSpectrum(*number) : Base::eval_attribute(name, si, active);
    }

    Color3f eval_attribute_3(const std::string &name, const SurfaceInteraction3f &si,
                             Mask active) const override {
        const Float *number = shown(name);
        return number ? Color3f(*number) : Base::eval_attribute_3(name, si, active);
    }

protected:
    /// `reflects_only`: may normals be left out whose reflection is below the horizon?
    SgtdBSDF(const Properties &props, bool reflects_only)
        : Base(props), m_plugin(props.plugin_name()) {
        m_row = string::to_lower(props.get<std::string_view>("distribution", "sgtd"));
        if (RadialSource<Float>::is_one(m_row)) {
            m_source.read(m_row, props);
            m_parameters[Offset].free = false;
        }
        read_roughness(props);
        if (!m_source)
            read_shape(props);

        m_sample_visible = props.get<bool>("sample_visible", true);
        m_can_bound      = reflects_only && m_sample_visible;
        if (reflects_only && props.has_property("sample_bounded"))
            m_bounded_asked = props.get<bool>("sample_bounded");
        if (m_bounded_asked.value_or(false) && !m_sample_visible)
            Throw("parameters \"sample_bounded\" = true and \"sample_visible\" = false are given "
                  "together: it is the visible normals that can be bounded, so remove one of them");
        std::string masking = string::to_lower(props.get<std::string_view>("masking", "separable"));
        if (masking != "separable" && masking != "height_correlated")
            Throw("masking \"%s\" is unknown: choose one of separable, height_correlated", masking);
        m_height_correlated = masking == "height_correlated";
        m_accuracy          = props.get<double>("accuracy", sgtd::host::DefaultAccuracy);
        if (!(m_accuracy >= 0.0 && m_accuracy <= 0.1))
            Throw("parameter \"accuracy\" is %s, but must be between 0 and 0.1", m_accuracy);

        if (m_source)
            update_source();
        else
            update_shape();
    }

    /// Shows the roughness.
    virtual void traverse_roughness(TraversalCallback *cb, uint32_t flags) {
        if (m_anisotropic) {
            cb->put("alpha_u", m_alpha_u, flags);
            cb->put("alpha_v", m_alpha_v, flags);
        } else {
            cb->put("alpha", m_alpha_u, flags);
        }
    }

    // ------------------------------------------------------------------
    //  Reading of properties
    // ------------------------------------------------------------------

    /// Warns once, by name: what a built-in accepts is accepted, whatever it means.
    void warn_once(const std::string &message) const {
        static std::mutex mutex;
        static std::set<std::string> said;
        std::string id(this->id()),
            text = m_plugin + (id.empty() ? "" : " \"" + id + "\"") + ": " + message;
        std::lock_guard<std::mutex> lock(mutex);
        if (said.insert(text).second)
            Log(Warn, "%s", text);
    }

    /// The number that a property is, if it is one.
    static std::optional<double> plain_number(const Properties &props, const char *name) {
        if (!props.has_property(name))
            return {};
        Properties::Type type = props.type(name);
        if (type == Properties::Type::Float || type == Properties::Type::Integer)
            return props.get<double>(name);
        return {};
    }

    /// Is a roughness one that D can be evaluated for? A negative one is raised to 1e-4.
    static bool valid_roughness(double alpha) {
        return !std::isnan(alpha) && alpha < std::numeric_limits<double>::infinity();
    }

    /// Checks a property that a texture is made from, where it is a plain number or color.
    void check_constant(const Properties &props, const char *name) const {
        bool rough = std::string_view(name).substr(0, 5) == "alpha";
        if (!props.has_property(name))
            return;
        auto valid = [&](double value) {
            return rough ? valid_roughness(value) : std::isfinite(value);
        };
        const char *meaning = rough ? "which is the same as 1e-4" : "which no surface has";
        if (std::optional<double> value = plain_number(props, name)) {
            if (!valid(*value))
                Throw("parameter \"%s\" is %s, but must be a finite number of at least 0", name,
                      *value);
            if (*value < 0.0)
                warn_once(tfm::format("parameter \"%s\" is %s, %s", name, *value, meaning));
        } else if (props.type(name) == Properties::Type::Color) {
            ScalarColor3f color = props.get<ScalarColor3f>(name);
            for (size_t i = 0; i < 3; ++i)
                if (!valid(color[i]))
                    Throw("parameter \"%s\" is %s, but its parts must be finite numbers of at "
                          "least 0",
                          name, color);
            if (dr::any(color < 0.f))
                warn_once(tfm::format("parameter \"%s\" is %s, and has parts below 0, %s", name,
                                      color, meaning));
        }
    }

    /// The number that a texture is at every place, if it is one and can be read now.
    static std::optional<double> constant(const Texture *texture) {
        if (recording<Float>())
            return {};
        try {
            if (texture->is_spatially_varying())
                return {};
            Float mean = dr::detach(texture->mean());
            if (dr::width(mean) != 1)
                return {};
            return (double)dr::slice(mean);
        } catch (const std::exception &) {
            // Textures need not have a mean, nor say that they vary
            return {};
        }
    }

    /// Sets the number of a texture that is one.
    static void set_constant(Texture *texture, const Float &value) {
        struct Writer : TraversalCallback {
            explicit Writer(const Float &number) : m_value(number) {}

            void put_value(std::string_view name, void *target, uint32_t,
                           const std::type_info &type) override {
                if (name == "value" && strcmp(type.name(), typeid(Float).name()) == 0)
                    *(Float *)target = m_value;
            }

            void put_object(std::string_view, Object *, uint32_t) override {}

        private:
            Float m_value;
        } writer(value);
        texture->traverse(&writer);
        texture->parameters_changed({ "value" });
    }

    /// Has a texture refused when it becomes a number that is not finite.
    void watch(const char *name, Texture *texture) {
        m_watched.push_back({ name, texture, constant(texture) });
    }

    /// Takes back what was changed: for updates that are refused.
    void restore() {
        for (Float &shown : m_shown)
            shown = dr::detach(shown);
        for (const Watched &watched : m_watched)
            if (watched.last && constant(watched.texture) != watched.last)
                set_constant(watched.texture, dr::opaque<Float>((ScalarFloat)*watched.last));
        show_parameters();
        m_source.show();
    }

    /// Does a list of changes, which is empty if nothing is known, have a name in it?
    static bool changed(const std::vector<std::string> &keys, const char *name) {
        return keys.empty() || string::contains(keys, name);
    }

    /// The number of that name as traverse() shows it, if there is one.
    virtual const Float *shown(const std::string &name) const {
        for (size_t i = 0; i < Count; ++i)
            if (m_parameters[i].free && name == m_parameters[i].name)
                return &m_shown[i];
        return nullptr;
    }

    // ------------------------------------------------------------------
    //  Use by the BSDF
    // ------------------------------------------------------------------

    /// Has the shape a gradient here? While an integrator suspends them, it has none.
    bool follows_shape() const {
        if constexpr (dr::is_diff_v<Float>) {
            if (m_source)
                return follows_numbers();
            const Which tables = m_gradient.which(), now = with_gradient(tracked);
            for (size_t i = 0; i < Count; ++i)
                if (now[i] && !tables[i])
                    Throw("parameter \"%s\" has a gradient that the tables lack: call update() of "
                          "the scene's parameters after dr.enable_grad()%s",
                          m_parameters[i].name,
                          m_parameters[i].is_mu ? " of mu or alpha, on which the shift depends"
                                                : "");
            return now != Which{};
        } else {
            return false;
        }
    }

    /// Calls `f` with the tables, which carry the gradients of the shape where there are any.
    template <typename Function> auto with_tables(const Float &alpha, const Function &f) const {
        if constexpr (dr::is_diff_v<Float>) {
            if (follows_shape()) {
                if (m_source) {
                    const SgtdTables<Float> tables = m_tables.following(m_numbers);
                    return f(tables);
                }
                auto [excess, scale]           = shape_excess(alpha);
                const SgtdTables<Float> tables = m_tables.following(m_gradient, excess, scale);
                return f(tables);
            }
        } else {
            DRJIT_MARK_USED(alpha);
        }
        return f(m_tables);
    }

    /**
     * A sample where the shape has a gradient: direction and density are those of the shape as it
     * is, and the value follows it.
     *
     * A direction that moved with the shape would carry light across the edges of what it hits,
     * which no gradient sees. The density that is returned has the gradient of pdf(), so that
     * weights of several strategies add up to 1 with their gradients.
     */
    std::pair<BSDFSample3f, Spectrum> sample_following(const BSDFContext &ctx,
                                                       const SurfaceInteraction3f &si,
                                                       Float sample1, const Point2f &sample2,
                                                       Mask active) const {
        BSDFSample3f bs;
        Spectrum weight;
        {
            dr::suspend_grad<Float> suspended;
            std::tie(bs, weight) = this->sample(ctx, si, sample1, sample2, active);
        }
        bs     = dr::detach(bs);
        weight = dr::detach(weight);
        // What was drawn in vain has a density too, and may be on the wrong side
        Mask drawn        = active && bs.pdf > 0.f && dr::any(unpolarized_spectrum(weight) > 0.f);
        auto [value, pdf] = this->eval_pdf(ctx, si, bs.wo, drawn);
        Mask follows      = drawn && pdf > 0.f;
        Float at          = dr::select(follows, dr::detach(pdf), 1.f);
        if constexpr (dr::is_diff_v<Float>)
            bs.pdf *= dr::replace_grad(Float(1.f), dr::select(follows, pdf / at, 1.f));
        // (light that passes straight on has no value to evaluate)
        return { bs, dr::select(follows, value / at, weight) };
    }

    /// Does Mitsuba's own distribution run, with its own sampling?
    bool mitsubas_own() const { return m_builtin && !m_sample_bounded; }

    /// The roughness along both tangents, as the distribution takes it.
    std::pair<Float, Float> roughness(const SurfaceInteraction3f &si, const Mask &active) const {
        Float alpha_u = m_alpha_u->eval_1(si, active),
              alpha_v = m_anisotropic ? m_alpha_v->eval_1(si, active) : alpha_u;
        if (m_builtin_scaled) {
            alpha_u *= m_tables.alpha_scale;
            alpha_v *= m_tables.alpha_scale;
        }
        return { alpha_u, alpha_v };
    }

    /// Calls `f` with the facets at a place: the one fork between Mitsuba's own distributions,
    /// which `Builtin` stands for, and those of this project, which `own` makes from the roughness.
    template <typename Builtin, typename Own, typename Function>
    auto with_facets(const SurfaceInteraction3f &si, const Mask &active, const Own &own,
                     const Function &f) const {
        auto [alpha_u, alpha_v] = roughness(si, active);
        // Mitsuba's own follow no gradient of the shape: one that is there is refused
        if (!follows_shape() && mitsubas_own())
            return f(Builtin(m_beckmann ? MicrofacetType::Beckmann : MicrofacetType::GGX, alpha_u,
                             alpha_v, m_sample_visible, m_height_correlated));
        return own(alpha_u, alpha_v, f);
    }

    /// Which normals the tables draw.
    sgtd::host::Normals normals() const {
        using sgtd::host::Normals;
        return !m_sample_visible  ? Normals::All
               : m_sample_bounded ? Normals::Reflecting
                                  : Normals::Visible;
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

    /// Why derivatives by the shape cannot be had, if so.
    virtual const char *no_gradient() const { return nullptr; }

    /// Writes the lines of to_string() that all BSDFs have.
    void describe(std::ostream &os) const {
        os << "  distribution = " << m_row << "," << std::endl;
        m_source.describe(os);
        for (const Parameter &parameter : m_parameters)
            if (parameter.free)
                os << "  " << parameter.name << " = " << parameter.value << "," << std::endl;
        os << "  masking = " << (m_height_correlated ? "height_correlated" : "separable") << ","
           << std::endl
           << "  sample_visible = " << (bool)m_sample_visible << "," << std::endl;
        if (m_bounded_asked)
            os << "  sample_bounded = " << *m_bounded_asked << "," << std::endl;
        os << "  accuracy = " << m_accuracy << "," << std::endl
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
            m_alpha_u = m_alpha_v =
                props.get_unbounded_texture<Texture>("alpha", m_source ? width() : 0.1f);
            m_alpha_of_source = m_source && !props.has_property("alpha");
        }
        m_anisotropic = m_alpha_u != m_alpha_v;
        watch(m_anisotropic ? "alpha_u" : "alpha", m_alpha_u.get());
        if (m_anisotropic)
            watch("alpha_v", m_alpha_v.get());
    }

    void read_shape(const Properties &props) {
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
            if (m_anisotropic || (props.has_property("alpha") && !plain_number(props, "alpha")))
                Throw("parameter \"mu\" is given, but needs \"alpha\" as one number (the shape "
                      "depends on mu / alpha): give \"shift\" instead");
            offset       = { "mu", props.get<double>("mu"), true, true };
            offset.is_mu = true;
        }

        Parameter &tail = m_parameters[0];
        if (props.has_property("inv_gamma")) {
            if (tail.given)
                Throw("parameters \"inv_gamma\" and \"gamma\" are given together: choose one "
                      "(inv_gamma = 1 / gamma, 0 for an infinite gamma)");
            tail            = { "inv_gamma", props.get<double>("inv_gamma"), true, false };
            tail.is_inverse = true;
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
            probe[i]                            = values[i];
            if (!parameter.is_inverse)
                parameter.value = values[i];
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
        bool is_mu = false;
        /// Is it 1/gamma?
        bool is_inverse = false;
    };

    /// The shape for the current values of the parameters for which `present` holds.
    sgtd::host::RowShape resolve(bool Parameter::*present) const {
        std::optional<double> values[Count];
        for (size_t i = 0; i < Count; ++i)
            if (m_parameters[i].*present)
                values[i] = m_parameters[i].value;
        if (m_parameters[0].is_inverse && values[0]) {
            double inverse = *values[0];
            if (!(inverse >= 0.0 && inverse < 1.0))
                Throw(
                    "parameter \"inv_gamma\" is %s, but must be at least 0 and below 1: it is 1 / "
                    "gamma, 0 gives Gaussian-like tails, 0.5 those of GGX",
                    inverse);
            values[0] = 1.0 / inverse;
        }
        try {
            if (!m_parameters[Offset].is_mu)
                return sgtd::host::shape_of_row(m_row, values[0], values[1], values[2], values[3]);

            double mu = m_parameters[Offset].value;
            if (!std::isfinite(mu) || mu < 0.0)
                Throw("parameter \"mu\" is %s, but must be a finite number of at least 0", mu);
            // alpha_scale does not depend on the shift
            double scale =
                sgtd::host::shape_of_row(m_row, values[0], values[1], values[2], {}).alpha_scale;
            double alpha = std::max((double)dr::slice(dr::detach(m_alpha_u->mean())) * scale,
                                    sgtd::host::LeastAlpha);
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

    /// The roughness at which a table or a mixture is as it was given.
    float width() const { return (float)m_source.radial()->width(); }

    /// Makes the tables of a distribution that is not of the family.
    void update_source() {
        // Derivatives are tabulated over the cells of masking, which have to be as fine
        const bool follows    = m_source.with_gradient(attached);
        const double accuracy = follows ? std::min(m_accuracy, 1e-7) : m_accuracy;
        try {
            m_ndf = sgtd::host::Ndf::get(*m_source.radial(), SgtdTables<Float>::accuracy(accuracy),
                                         m_sample_visible);
        } catch (const std::invalid_argument &error) {
            Throw("%s", error.what());
        }
        m_node    = { { 2.0, 1.0, 0.0, 0.0 }, 1.0 };
        m_tables  = SgtdTables<Float>::load(*m_ndf, m_node, accuracy);
        m_numbers = follows ? NumbersGradient<Float>::load(*m_ndf, m_tables.steep, m_source.m_shown)
                            : NumbersGradient<Float>();
        m_builtin = false;
        m_beckmann       = false;
        m_builtin_scaled = false;
        m_sample_bounded = m_can_bound && m_bounded_asked.value_or(true);
        m_steep          = m_tables.steep;
        m_cells          = m_tables.by_cells;
        m_odds           = m_tables.by_odds;
        // A roughness that nobody gave follows the table, until somebody changes it
        if (m_alpha_of_source && m_width != width()) {
            if (m_width != 0.f && constant(m_alpha_u.get()) == (double)m_width) {
                set_constant(m_alpha_u.get(), dr::opaque<Float>((ScalarFloat)width()));
                m_watched[0].last = constant(m_alpha_u.get());
            }
            m_width = width();
        }
    }

    /// Makes the tables for the current parameters; if they are refused, restores the parameters
    /// and throws.
    void update_shape() {
        try {
            sgtd::host::RowShape row = resolve(&Parameter::free);
            const Which gradient     = with_gradient(attached);
            const bool follows       = gradient != Which{};
            if (m_current && m_current->row.shape == row.shape && gradient == m_gradient.which()) {
                m_current->parameters = m_parameters;
                show_parameters();
                return;
            }

            // Whatever the row was called, its numbers decide what is needed
            sgtd::host::Node node        = sgtd::host::lowest_node(row.shape);
            sgtd::host::RowShape reduced = { node.shape, row.alpha_scale * node.alpha_scale };
            const sgtd::host::CodePath path =
                sgtd::host::code_path(m_row, node, m_bounded_asked.value_or(false));
            // A closed form knows nothing of its neighbors
            const bool builtin = path != sgtd::host::CodePath::Tables && !follows;
            double accuracy    = m_accuracy;
            if (follows) {
                if (const char *reason = no_gradient())
                    Throw("the shape has a gradient, but %s", reason);
                // Not the node: a skew without a shift has a derivative of its own, and a finer
                // masking table, over whose cells derivatives are tabulated as well
                reduced  = row;
                accuracy = std::min(accuracy, 1e-7);
            }

            std::shared_ptr<const sgtd::host::Ndf> ndf;
            SgtdTables<Float> tables;
            if (builtin) {
                tables = SgtdTables<Float>::without(reduced.alpha_scale);
            } else {
                try {
                    ndf = sgtd::host::Ndf::get(reduced.shape, SgtdTables<Float>::accuracy(accuracy),
                                               m_sample_visible);
                } catch (const std::invalid_argument &error) {
                    Throw("%s", error.what());
                }
                tables = SgtdTables<Float>::load(*ndf, reduced, accuracy);
            }
            m_gradient =
                follows ? ShapeGradient<Float>::load(*ndf, gradient) : ShapeGradient<Float>();

            m_builtin        = builtin;
            m_sample_bounded = m_can_bound && m_bounded_asked.value_or(!m_builtin);
            m_beckmann       = path == sgtd::host::CodePath::Beckmann;
            m_builtin_scaled = builtin && reduced.alpha_scale != 1.0;
            m_steep          = tables.steep;
            m_cells          = false;
            m_odds           = false;
            m_ndf            = std::move(ndf);
            m_tables         = std::move(tables);
            m_node           = reduced;
            m_scaled_by_tail = row.alpha_scale != 1.0;
            m_current        = { row, m_parameters };
            show_parameters();
        } catch (...) {
            if (m_current)
                m_parameters = m_current->parameters;
            throw;
        }
    }

    /// Reads those parameters that traverse() has changed. Were there any?
    bool read_parameters(const std::vector<std::string> &keys) {
        bool any = false;
        for (size_t i = 0; i < Count; ++i) {
            Parameter &parameter = m_parameters[i];
            if (!parameter.free || !changed(keys, parameter.name))
                continue;
            if (recording<Float>()) {
                if (keys.empty())
                    continue;
                Throw("parameter \"%s\" cannot be changed inside a frozen function, as its tables "
                      "are made on the host: change it before the call",
                      parameter.name);
            }
            if (dr::width(m_shown[i]) != 1)
                Throw("parameter \"%s\" is an array of %s numbers, but must be one number",
                      parameter.name, dr::width(m_shown[i]));
            ScalarFloat value = dr::slice(dr::detach(m_shown[i]));
            // Single precision shows less than was given
            if (value != (ScalarFloat)parameter.value)
                parameter.value = decimal(value);
            any = true;
        }
        return any;
    }

    /// The shortest decimal that rounds to a number in single precision: 1.7, not 1.7000000477.
    static double decimal(ScalarFloat value) {
        if (sizeof(ScalarFloat) == 8 || !std::isfinite(value))
            return (double)value;
        char text[32];
        for (int digits = 1; digits <= std::numeric_limits<ScalarFloat>::max_digits10; ++digits) {
            std::snprintf(text, sizeof(text), "%.*g", digits, (double)value);
            if ((ScalarFloat)std::strtod(text, nullptr) == value)
                break;
        }
        return std::strtod(text, nullptr);
    }

    /// Gives traverse() the parameters as they are. One that has a gradient stays the variable that
    /// it is: no copy of it, which would be none of its own graph.
    void show_parameters() {
        for (size_t i = 0; i < Count; ++i)
            if (!attached(m_shown[i]))
                m_shown[i] = dr::opaque<Float>((ScalarFloat)m_parameters[i].value);
    }

    // ------------------------------------------------------------------
    //  Derivatives by the shape
    // ------------------------------------------------------------------

    using Which = typename ShapeGradient<Float>::Which;

    /// Gives the numbers of a table or a mixture their gradients, if they have any.
    void tie_numbers() {
        if (!m_numbers.any)
            return;
        // A roughness that follows the table leaves slopes where they are
        m_numbers.scaled = !(m_alpha_of_source && constant(m_alpha_u.get()) == (double)m_width);
        m_numbers.tie(m_source.m_shown);
    }

    /// Has one of these numbers a gradient here?
    bool follows_numbers() const {
        bool any = false;
        for (size_t i = 0; i < m_source.names().size(); ++i) {
            if (!tracked(m_source.m_shown[i]))
                continue;
            const char *remedy = "call set_dirty() and update() of the scene's parameters after "
                                 "dr.enable_grad(), and again after each pass that takes gradients";
            if (!m_numbers.is_tied_to(i, m_source.m_shown[i]))
                Throw("parameter \"%s\" has a gradient that the tables lack: %s",
                      m_source.names()[i], remedy);
            if (!m_numbers.is_open()) {
                const std::string message =
                    tfm::format("the gradient of parameter \"%s\" has been taken, and there is "
                                "none until the next update: %s",
                                m_source.names()[i], remedy);
                // Calls are recorded for all materials there are, those of other scenes too
                if (!jit_flag(JitFlag::SymbolicScope))
                    Throw("%s", message);
                warn_once(message);
                continue;
            }
            any = true;
        }
        return any;
    }

    /// Has a variable a gradient?
    static bool attached(const Float &x) { return dr::grad_enabled(x); }

    /// The same, unless derivatives are suspended.
    static bool tracked(const Float &x) {
        if constexpr (dr::is_diff_v<Float>)
            return ad_grad_enabled(x.index_combined());
        else
            return attached(x);
    }

    /// Which of 1/gamma, p, lambda and shift have a gradient, in the sense of `has`.
    template <typename Has> Which with_gradient(const Has &has) const {
        Which result = {};
        if constexpr (dr::is_diff_v<Float>) {
            for (size_t i = 0; i < Count; ++i)
                result[i] = m_parameters[i].free && has(m_shown[i]);
            // The shift is mu / alpha then
            if (m_parameters[Offset].is_mu && has(m_alpha_u->mean()))
                result[Offset] = true;
        }
        return result;
    }

    /// What carries the gradients, and the factor on the roughness with its own; `alpha` is the
    /// roughness that the user gave.
    std::pair<ShapeExcess<Float>, Float> shape_excess(const Float &alpha) const {
        ShapeExcess<Float> excess;
        excess.which = with_gradient(tracked);
        auto by      = [](const Float &x) { return dr::replace_grad(Float(0.f), x); };
        Float scale  = m_tables.alpha_scale;
        for (size_t i = 1; i < Offset; ++i)
            if (excess.which[i])
                excess.value[i] = by(m_shown[i]);
        if (excess.which[0]) {
            excess.value[0] = by(m_shown[0]);
            // d(1/gamma) = -d(gamma)/gamma^2, which is 0 at infinity
            const Float &k = m_tables.profile.inv_gamma_1;
            if (!m_parameters[0].is_inverse)
                excess.value[0] *= -dr::square(k / (1.f + k));
            // sqrt(2/(gamma-1)) = sqrt(2 k), dk = (1+k)^2 d(1/gamma)
            if (m_scaled_by_tail)
                scale = dr::fmadd(scale, excess.value[0] * dr::square(1.f + k) / (2.f * k), scale);
        }
        if (excess.which[Offset])
            excess.value[Offset] =
                by(m_parameters[Offset].is_mu
                       ? Float(m_shown[Offset] /
                               dr::maximum(alpha * scale, (ScalarFloat)sgtd::host::LeastAlpha))
                       : m_shown[Offset]);
        return { excess, scale };
    }

    // ------------------------------------------------------------------
    //  Textures that are numbers
    // ------------------------------------------------------------------

    struct Watched {
        const char *name;
        Texture *texture;
        /// What it was last, if it is a number
        std::optional<double> last;
    };

    /// Refuses numbers that no texture should have; returns what they are now.
    std::vector<std::optional<double>> check_textures(const std::vector<std::string> &keys) const {
        std::vector<std::optional<double>> now(m_watched.size());
        for (size_t i = 0; i < m_watched.size(); ++i) {
            const Watched &watched = m_watched[i];
            now[i]                 = watched.last;
            if (!changed(keys, watched.name))
                continue;
            now[i] = constant(watched.texture);
            if (!now[i] || now[i] == watched.last)
                continue;
            bool rough = watched.texture == m_alpha_u.get() || watched.texture == m_alpha_v.get();
            if (!std::isfinite(*now[i]) || (rough && *now[i] < 0.0))
                Throw("parameter \"%s\" is %s, but must be a finite number%s", watched.name,
                      *now[i], rough ? " of at least 0" : "");
        }
        return now;
    }

protected:
    ref<Texture> m_alpha_u, m_alpha_v;
    FrozenChoice<Float> m_sample_visible, m_height_correlated;
    /// Are there two roughnesses?
    FrozenChoice<Float> m_anisotropic;
    /// Are those visible normals left out that reflect below the horizon?
    FrozenChoice<Float> m_sample_bounded;

    /// Is Mitsuba's own distribution used instead of the tables?
    FrozenChoice<Float> m_builtin;
    /// Is that Beckmann's, not GGX?
    FrozenChoice<Float> m_beckmann;
    /// Is its roughness that of the user times `m_tables.alpha_scale`?
    FrozenChoice<Float> m_builtin_scaled;
    /// The choice that the tables hold
    FrozenChoice<Float> m_steep;
    /// Is the distribution a table or a mixture, and are its visible normals drawn over the odds?
    FrozenChoice<Float> m_cells, m_odds;
    std::shared_ptr<const sgtd::host::Ndf> m_ndf;
    SgtdTables<Float> m_tables;
    /// Empty unless a parameter of the shape has a gradient
    ShapeGradient<Float> m_gradient;
    /// Empty unless numbers of a table or a mixture have one
    NumbersGradient<Float> m_numbers;
    /// The lowest node that the numbers allow, and the factor on the user's roughness there
    sgtd::host::RowShape m_node;
    /// Name of the BSDF
    std::string m_plugin;

private:
    /// May they be, and was that asked for, or forbidden, by name?
    bool m_can_bound = false;
    std::optional<bool> m_bounded_asked;
    double m_accuracy;
    /// Does the factor on the roughness depend on gamma, as that of hyper_cauchy?
    bool m_scaled_by_tail = false;

    /// Name of the row, and its parameters; the last one is the shift or mu.
    static constexpr size_t Offset = 3, Count = 4;
    using Parameters = std::array<Parameter, Count>;
    std::string m_row;
    Parameters m_parameters = { { { "gamma", 0.0, false, false },
                                  { "p", 0.0, false, false },
                                  { "lambda", 0.0, false, false },
                                  { "shift", 0.0, false, true } } };
    /// The same for traverse(). Values stay in double precision: what was given is not rounded.
    Float m_shown[Count];

    /// What the distribution is if it is none of the family
    RadialSource<Float> m_source;
    /// Is the roughness that of the source, and what was that?
    bool m_alpha_of_source = false;
    float m_width          = 0.f;

    std::vector<Watched> m_watched;

    /// What the tables were made for.
    struct Current {
        sgtd::host::RowShape row;
        Parameters parameters;
    };
    std::optional<Current> m_current;

    // Choices first: see FrozenChoice
    MI_TRAVERSE_CB(Base, m_sample_visible, m_height_correlated, m_anisotropic, m_sample_bounded,
                   m_builtin, m_beckmann, m_builtin_scaled, m_steep, m_cells, m_odds, m_gradient,
                   m_numbers, m_shown, m_alpha_u, m_alpha_v, m_tables, m_source.m_shown)
};

NAMESPACE_END(mitsuba)

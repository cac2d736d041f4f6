#pragma once

#include <array>
#include <cstdlib>
#include <cmath>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <drjit/tensor.h>
#include <mitsuba/core/fresolver.h>
#include <mitsuba/core/properties.h>
#include <mitsuba/core/string.h>

#include <mitsuba/render/bsdf.h>

#include "bridge.h"
#include "frozen_choice.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * A distribution that is given by numbers instead of a row of the family: a table, or a mixture.
 *
 * What users may change are the values of a table, and the weights and roughnesses of a mixture.
 * They are read, and made into a distribution, on the host.
 */
template <typename Float> class RadialSource {
public:
    using ScalarFloat = dr::scalar_t<Float>;
    using FloatBuffer = DynamicBuffer<Float>;
    using Radial      = sgtd::host::Radial;

    static bool is_one(std::string_view row) { return row == "tabulated" || row == "mixture"; }

    /// Is there one?
    operator bool() const { return m_kind != Kind::None; }

    void read(const std::string &row, const Properties &props) {
        for (const char *name : { "gamma", "p", "lambda", "shift", "mu" })
            if (props.has_property(name))
                Throw("parameter \"%s\" is given, but distribution \"%s\" has no such shape: "
                      "remove it, or choose a row of the family",
                      name, row);
        if (row == "tabulated")
            read_table(props);
        else
            read_mixture(props);
        m_radial = make(numbers());
        show();
    }

    const Radial::Pointer &radial() const { return m_radial; }

    void traverse(TraversalCallback *cb) {
        for (size_t i = 0; i < names().size(); ++i)
            cb->put(names()[i], m_shown[i], ParamFlags::Differentiable);
    }

    /// Reads what traverse() has changed. Was there anything? A change that is refused throws, and
    /// `show` takes it back.
    bool update(const std::vector<std::string> &keys) {
        bool any = false;
        for (const char *name : names())
            any |= keys.empty() || string::contains(keys, name);
        if (!any || (keys.empty() && recording<Float>()))
            return false;
        if (recording<Float>())
            Throw("the numbers of a distribution cannot be changed inside a frozen function, as "
                  "its tables are made on the host: change them before the call");
        Numbers now = numbers();
        for (size_t i = 0; i < names().size(); ++i) {
            std::vector<double> read = to_host(m_shown[i]);
            if (read.size() != now[i].size())
                Throw("parameter \"%s\" has %s numbers, but must have %s: make a new material for "
                      "a table of another size",
                      names()[i], read.size(), now[i].size());
            // Single precision shows less than was given
            for (size_t k = 0; k < read.size(); ++k)
                if ((ScalarFloat)now[i][k] != (ScalarFloat)read[k])
                    now[i][k] = read[k];
        }
        if (now == numbers())
            return false;
        m_radial = make(now);
        take(now);
        return true;
    }

    /// Gives traverse() the numbers as they are.
    void show() {
        const Numbers now = numbers();
        for (size_t i = 0; i < names().size(); ++i) {
            std::vector<ScalarFloat> shown(now[i].begin(), now[i].end());
            m_shown[i] = dr::load<FloatBuffer>(shown.data(), shown.size());
            dr::make_opaque(m_shown[i]);
        }
    }

    /// Names of the lists that traverse() shows, in the order of `m_shown`.
    std::vector<const char *> names() const {
        switch (m_kind) {
        case Kind::Table:
            return { "values" };
        case Kind::Mixture:
            return { "weights", "alphas" };
        default:
            return {};
        }
    }

    /// The first list with a gradient, in the sense of `has`; null if there is none.
    template <typename Has> const char *with_gradient(const Has &has) const {
        if constexpr (dr::is_diff_v<Float>) {
            for (size_t i = 0; i < names().size(); ++i)
                if (has(m_shown[i]))
                    return names()[i];
        } else {
            DRJIT_MARK_USED(has);
        }
        return nullptr;
    }

    void describe(std::ostream &os) const {
        if (m_kind == Kind::Table) {
            if (!m_table.path.empty())
                os << "  filename = \"" << m_table.path << "\"," << std::endl;
            os << "  rows = " << m_table.places.size() << "," << std::endl
               << "  quantity = " << m_table.quantity << "," << std::endl
               << "  tail = " << m_table.tail << "," << std::endl;
            if (m_table.tail_exponent)
                os << "  tail_exponent = " << *m_table.tail_exponent << "," << std::endl;
        } else if (m_kind == Kind::Mixture) {
            os << "  members = [" << std::endl;
            for (const Member &member : m_members)
                os << "    weight=" << member.weight << " alpha=" << member.alpha << " "
                   << member.text << "," << std::endl;
            os << "  ]," << std::endl;
        }
    }

private:
    enum class Kind { None, Table, Mixture };

    /// One distribution of a mixture.
    struct Member {
        double weight, alpha;
        Radial::Pointer radial;
        /// Factor on the roughness
        double scale;
        std::string text;
    };

    /// What can be changed: values, or weights and roughnesses.
    using Numbers = std::array<std::vector<double>, 2>;

    Numbers numbers() const {
        Numbers result;
        if (m_kind == Kind::Table)
            result[0] = m_table.values;
        for (const Member &member : m_members) {
            result[0].push_back(member.weight);
            result[1].push_back(member.alpha);
        }
        return result;
    }

    void take(const Numbers &numbers) {
        if (m_kind == Kind::Table)
            m_table.values = numbers[0];
        for (size_t i = 0; i < m_members.size(); ++i) {
            m_members[i].weight = numbers[0][i];
            m_members[i].alpha  = numbers[1][i];
        }
    }

    Radial::Pointer make(const Numbers &numbers) const {
        return told([&] {
            if (m_kind == Kind::Table) {
                sgtd::host::TableSource table = m_table;
                table.values                  = numbers[0];
                return Radial::table(table);
            }
            std::vector<Radial::Part> parts;
            for (size_t i = 0; i < m_members.size(); ++i)
                parts.push_back(
                    { numbers[0][i], numbers[1][i] * m_members[i].scale, m_members[i].radial });
            return Radial::mixture(parts);
        });
    }

    /// With errors of the core as Mitsuba tells its own.
    template <typename Call> static auto told(const Call &call) {
        try {
            return call();
        } catch (const std::invalid_argument &error) {
            Throw("%s", error.what());
        }
    }

    // ------------------------------------------------------------------
    //  Tables
    // ------------------------------------------------------------------

    void read_table(const Properties &props) {
        m_kind = Kind::Table;
        std::string quantity(props.get<std::string_view>("quantity", "")),
            tail                       = string::to_lower(props.get<std::string_view>("tail", ""));
        std::optional<double> exponent = number(props, "tail_exponent"),
                              knee     = number(props, "knee");
        bool angles = props.has_property("angles"), slopes = props.has_property("slopes"),
             values = props.has_property("values");
        if (props.has_property("filename")) {
            if (angles || slopes || values)
                Throw("parameters \"filename\" and \"angles\", \"slopes\" or \"values\" are given "
                      "together: a table is in a file or in the scene, so choose one");
            std::string path =
                file_resolver()->resolve(props.get<std::string_view>("filename")).string();
            m_table =
                told([&] { return sgtd::host::TableSource::read(path, quantity, tail, exponent); });
            if (knee)
                m_table.knee = knee;
            return;
        }
        if (angles == slopes || !values)
            Throw("distribution \"tabulated\" needs \"filename\", or \"values\" and one of "
                  "\"angles\" (in degrees) and \"slopes\" (their tangents)");
        m_table.by_angles = angles;
        m_table.places    = list(props, angles ? "angles" : "slopes");
        m_table.values    = list(props, "values");
        if (!quantity.empty())
            m_table.quantity = quantity;
        if (!tail.empty())
            m_table.tail = tail;
        m_table.tail_exponent = exponent;
        m_table.knee          = knee;
    }

    static std::optional<double> number(const Properties &props, const char *name) {
        if (!props.has_property(name))
            return {};
        return props.get<double>(name);
    }

    /// A property that is a list of numbers: a text, a tensor, or an array of the variant.
    static std::vector<double> list(const Properties &props, const char *name) {
        switch (props.type(name)) {
        case Properties::Type::String: {
            std::string text(props.get<std::string_view>(name));
            std::vector<double> result;
            for (const std::string &token : string::tokenize(text, " ,;\t\r\n"))
                result.push_back(to_number(name, token));
            return result;
        }
        case Properties::Type::Integer:
        case Properties::Type::Float:
            return { props.get<double>(name) };
        case Properties::Type::Vector: {
            auto v = props.get<Vector<double, 3>>(name);
            return { v.x(), v.y(), v.z() };
        }
        case Properties::Type::Any:
            return any(props, name);
        default:
            Throw("parameter \"%s\" must be a list of numbers: a text such as \"0, 10, 20\", or a "
                  "mi.TensorXf",
                  name);
        }
    }

    static std::vector<double> any(const Properties &props, const char *name) {
        using Tensor = dr::Tensor<FloatBuffer>;
        try {
            return to_host(props.get_any<Tensor>(name).array());
        } catch (const std::exception &) {
        }
        try {
            return to_host(props.get_any<FloatBuffer>(name));
        } catch (const std::exception &) {
            Throw("parameter \"%s\" must be a list of numbers: a text such as \"0, 10, 20\", or a "
                  "mi.TensorXf",
                  name);
        }
    }

    static double to_number(const char *name, const std::string &token) {
        char *end    = nullptr;
        double value = std::strtod(token.c_str(), &end);
        if (token.empty() || *end)
            Throw("parameter \"%s\" has \"%s\", which is not a number", name, token);
        return value;
    }

    static std::vector<double> to_host(const FloatBuffer &buffer) {
        std::vector<ScalarFloat> values(dr::width(buffer));
        if (!values.empty())
            dr::store(values.data(), dr::detach(buffer));
        return { values.begin(), values.end() };
    }

    // ------------------------------------------------------------------
    //  Mixtures
    // ------------------------------------------------------------------

    /// "weight=0.7 alpha=0.1 distribution=student gamma=1.6; weight=0.3 alpha=0.4"
    void read_mixture(const Properties &props) {
        m_kind = Kind::Mixture;
        if (!props.has_property("members"))
            Throw("distribution \"mixture\" needs \"members\": \"weight=0.7 alpha=0.1 "
                  "distribution=student gamma=1.6; weight=0.3 alpha=0.4 distribution=ggx\"");
        std::string text(props.get<std::string_view>("members"));
        size_t count = 0;
        for (const std::string &part : string::tokenize(text, ";")) {
            std::string member = string::trim(part, " \t\r\n");
            if (member.empty())
                continue;
            ++count;
            try {
                m_members.push_back(read_member(member));
            } catch (const std::exception &error) {
                Throw("member %s of the mixture, \"%s\": %s", count, member, error.what());
            }
        }
    }

    static Member read_member(const std::string &text) {
        Properties props;
        std::string rest;
        for (const std::string &token : string::tokenize(text, " \t\r\n")) {
            size_t equals = token.find('=');
            if (equals == std::string::npos)
                Throw("\"%s\" is not of the form name=value", token);
            std::string name = token.substr(0, equals), value = token.substr(equals + 1);
            for (const char *known :
                 { "weight", "alpha", "gamma", "p", "lambda", "shift", "tail_exponent", "knee",
                   "distribution", "filename", "quantity", "tail", "" }) {
                if (!*known)
                    Throw("parameter \"%s\" is unknown: there are weight, alpha, distribution, "
                          "gamma, p, lambda, shift, and filename, quantity, tail, tail_exponent, "
                          "knee of a table",
                          name);
                if (name == known)
                    break;
            }
            if (props.has_property(name))
                Throw("parameter \"%s\" is given twice", name);
            bool is_text = name == "distribution" || name == "filename" || name == "quantity" ||
                           name == "tail";
            if (is_text)
                props.set(name, value);
            else
                props.set(name, to_number(name.c_str(), value));
            if (name != "weight" && name != "alpha")
                rest += (rest.empty() ? "" : " ") + token;
        }
        Member member;
        member.text     = rest;
        member.weight   = props.get<double>("weight", 1.0);
        std::string row = string::to_lower(props.get<std::string_view>("distribution", "sgtd"));
        if (row == "mixture")
            Throw("a mixture of mixtures is one mixture: list all members in one");
        if (row == "tabulated") {
            RadialSource table;
            table.read(row, props);
            member.radial = table.radial();
            member.scale  = 1.0;
            member.alpha  = props.get<double>("alpha", member.radial->width());
        } else {
            sgtd::host::RowShape shape = told([&] {
                return sgtd::host::shape_of_row(row, number(props, "gamma"), number(props, "p"),
                                                number(props, "lambda"), number(props, "shift"));
            });
            member.radial              = Radial::family(shape.shape);
            member.scale               = shape.alpha_scale;
            member.alpha               = props.get<double>("alpha", 0.1);
        }
        for (const std::string &name : props.unqueried())
            Throw("parameter \"%s\" is not one of distribution \"%s\"", name, row);
        return member;
    }

    Kind m_kind = Kind::None;
    sgtd::host::TableSource m_table;
    std::vector<Member> m_members;
    Radial::Pointer m_radial;

public:
    std::array<FloatBuffer, 2> m_shown;
};

NAMESPACE_END(mitsuba)

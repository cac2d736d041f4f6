#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/string_view.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "python_arrays.h"

/// `sgtd._core`: the core over flat arrays of float64. `sgtd/ndf.py` checks arguments and gives
/// arrays their shape.

namespace nb = nanobind;
using namespace nb::literals;
using sgtd::host::Ndf;
using sgtd::host::Node;
using sgtd::host::Radial;
using sgtd::host::Shape;
using sgtd::host::TableSource;
using sgtd::python::Array;
using sgtd::python::in;
using sgtd::python::Output;

NB_MODULE(_core, m) {
    m.attr("steep")            = sgtd::host::Steep;
    m.attr("default_accuracy") = sgtd::host::DefaultAccuracy;
    m.attr("least_alpha")      = sgtd::host::LeastAlpha;

    nb::class_<Shape>(m, "Shape", "Shape of a distribution at unit roughness.")
        .def(
            "__init__",
            [](Shape *self, double gamma, double p, double lam, double shift) {
                new (self) Shape{ gamma, p, lam, shift };
            },
            "gamma"_a, "p"_a, "lam"_a, "shift"_a)
        .def_ro("gamma", &Shape::gamma)
        .def_ro("p", &Shape::p)
        .def_ro("lam", &Shape::lambda)
        .def_ro("shift", &Shape::shift)
        .def(
            "numbers",
            [](const Shape &shape) {
                return nb::make_tuple(shape.gamma, shape.p, shape.lambda, shape.shift);
            },
            nb::sig("def numbers(self) -> tuple[float, float, float, float]"),
            "(gamma, p, lambda, shift)")
        .def(
            "__eq__", [](const Shape &shape, const Shape &other) { return shape == other; },
            nb::is_operator(), nb::sig("def __eq__(self, other: object, /) -> bool"))
        .def("__hash__",
             [](const Shape &shape) {
                 return nb::hash(nb::make_tuple(shape.gamma, shape.p, shape.lambda, shape.shift));
             })
        .def(
            "__reduce__",
            [](nb::handle self) { return nb::make_tuple(self.type(), self.attr("numbers")()); },
            nb::sig(
                "def __reduce__(self) -> tuple[type[Shape], tuple[float, float, float, float]]"));

    m.def(
        "shape_of_row",
        [](std::string_view row, std::optional<double> gamma, std::optional<double> p,
           std::optional<double> lam, std::optional<double> shift) {
            auto result = sgtd::host::shape_of_row(row, gamma, p, lam, shift);
            return std::make_pair(result.shape, result.alpha_scale);
        },
        "row"_a, "gamma"_a = nb::none(), "p"_a = nb::none(), "lam"_a = nb::none(),
        "shift"_a = nb::none(),
        "The shape of a named row of the family, and the factor on every roughness given with it.");

    nb::class_<Node>(m, "Node", "The node of the family's tree at which a shape runs.")
        .def_ro("name", &Node::name)
        .def_ro("shape", &Node::shape)
        .def_ro("alpha_scale", &Node::alpha_scale)
        .def_ro("closed_form", &Node::closed_form);
    m.def("lowest_node", &sgtd::host::lowest_node, "shape"_a,
          "The lowest node that the numbers of a shape allow.");
    m.def(
        "code_path",
        [](std::string_view row, const Shape &shape, bool bounded) {
            switch (sgtd::host::code_path(row, sgtd::host::lowest_node(shape), bounded)) {
            case sgtd::host::CodePath::Ggx:
                return "ggx";
            case sgtd::host::CodePath::Beckmann:
                return "beckmann";
            default:
                return "tables";
            }
        },
        "row"_a, "shape"_a, "bounded"_a = false,
        "What evaluates a material of that row: \"ggx\" or \"beckmann\", Mitsuba's own code, or "
        "\"tables\".");

    m.def("check_roughness", &sgtd::host::check_roughness, "alpha_u"_a, "alpha_v"_a);
    m.def(
        "first_of_wrong_length",
        [](const Array &w, double tolerance) {
            nb::gil_scoped_release unlocked;
            return sgtd::host::first_of_wrong_length(in(w), tolerance);
        },
        "w"_a, "tolerance"_a,
        "Index of the first row of w whose length differs from 1 by more than the tolerance.");
    m.def(
        "first_outside",
        [](const Array &x, double low, double high) {
            nb::gil_scoped_release unlocked;
            return sgtd::host::first_outside(in(x), low, high);
        },
        "x"_a, "low"_a, "high"_a, "Index of the first number of x that is not in [low, high].");

    nb::class_<TableSource>(m, "TableSource", "A table as the user gives it.")
        .def(
            "__init__",
            [](TableSource *self, const Array &places, bool by_angles, const Array &values,
               std::string quantity, std::string tail, std::optional<double> tail_exponent,
               std::optional<double> knee, std::string path) {
                new (self) TableSource{ { places.data(), places.data() + places.size() },
                                        by_angles,
                                        { values.data(), values.data() + values.size() },
                                        std::move(quantity),
                                        std::move(tail),
                                        tail_exponent,
                                        knee,
                                        std::move(path) };
            },
            "places"_a, "by_angles"_a, "values"_a, "quantity"_a = "D", "tail"_a = "power",
            "tail_exponent"_a = nb::none(), "knee"_a = nb::none(), "path"_a = "")
        .def_static("read", &TableSource::read, "path"_a, "quantity"_a = "", "tail"_a = "",
                    "tail_exponent"_a = nb::none(),
                    "From a .csv or .npz file; what is left out is what the file says.")
        .def_prop_ro(
            "places", [](const TableSource &source) { return Output(source.places).release(); },
            nb::rv_policy::move)
        .def_ro("by_angles", &TableSource::by_angles)
        .def_prop_ro(
            "values", [](const TableSource &source) { return Output(source.values).release(); },
            nb::rv_policy::move)
        .def_ro("quantity", &TableSource::quantity)
        .def_ro("tail", &TableSource::tail)
        .def_ro("tail_exponent", &TableSource::tail_exponent)
        .def_ro("knee", &TableSource::knee)
        .def_ro("path", &TableSource::path);

    // Objects are shared and have no method that changes them
    auto shared = [](const Radial::Pointer &radial) {
        return std::const_pointer_cast<Radial>(radial);
    };
    nb::class_<Radial>(m, "Radial",
                       "What a distribution is made from: a member of the family, a table, or a "
                       "mixture of these.")
        .def_static(
            "family", [=](const Shape &shape) { return shared(Radial::family(shape)); }, "shape"_a)
        .def_static(
            "table",
            [=](const TableSource &source) {
                nb::gil_scoped_release unlocked;
                return shared(Radial::table(source));
            },
            "source"_a)
        .def_static(
            "mixture",
            [=](const std::vector<std::tuple<double, double, std::shared_ptr<Radial>>> &given) {
                std::vector<Radial::Part> parts;
                for (const auto &[weight, alpha, radial] : given)
                    parts.push_back({ weight, alpha, radial });
                return shared(Radial::mixture(parts));
            },
            "parts"_a, "Weights, roughnesses and distributions.")
        .def(
            "resampled",
            [=](const Radial &radial, size_t nodes) {
                nb::gil_scoped_release unlocked;
                return shared(radial.resampled(nodes));
            },
            "nodes"_a, "The same as a table of so many nodes.")
        .def_prop_ro("is_family", &Radial::is_family)
        .def_prop_ro("is_table", &Radial::is_table)
        .def_prop_ro("width", &Radial::width,
                     "The roughness at which a table or mixture is as it was given.")
        .def_prop_ro("key",
                     [](const Radial &radial) {
                         return nb::bytes(radial.key().data(), radial.key().size());
                     })
        .def_prop_ro(
            "slopes", [](const Radial &radial) { return Output(radial.slopes()).release(); },
            nb::rv_policy::move)
        .def_prop_ro(
            "slope_densities",
            [](const Radial &radial) { return Output(radial.slope_densities()).release(); },
            nb::rv_policy::move)
        .def_prop_ro("knee", &Radial::knee)
        .def_prop_ro("tail_exponent", &Radial::tail_exponent, "0 if the table is cut.");

    nb::class_<Ndf>(m, "Ndf", "A distribution with its tables.")
        .def_static(
            "get",
            [](const Radial &radial, double accuracy, bool visible) {
                nb::gil_scoped_release unlocked;
                return std::const_pointer_cast<Ndf>(Ndf::get(radial, accuracy, visible));
            },
            "radial"_a, "accuracy"_a, "visible"_a = true)
        .def_static(
            "get",
            [](const Shape &shape, double accuracy, bool visible) {
                nb::gil_scoped_release unlocked;
                return std::const_pointer_cast<Ndf>(Ndf::get(shape, accuracy, visible));
            },
            "shape"_a, "accuracy"_a, "visible"_a = true)
        .def_prop_ro("normalization", [](const Ndf &ndf) { return ndf.numbers().normalization; })
        .def_prop_ro("accuracy_reached",
                     [](const Ndf &ndf) { return ndf.numbers().accuracy_reached; })
        .def_prop_ro("steepness", [](const Ndf &ndf) { return ndf.tables().steepness; })
        .def_prop_ro(
            "mean", [](const Ndf &ndf) { return ndf.numbers().mean; },
            "Mean of the stretched slope.")
        .def_prop_ro(
            "by_odds", [](const Ndf &ndf) { return ndf.numbers().by_odds; },
            "Are visible normals tabulated over the odds of the profile?")
        .def_prop_ro("table_bytes",
                     [](const Ndf &ndf) {
                         auto tables = ndf.tables();
                         return (tables.lambda.size + tables.visible.size + tables.cells.size) *
                                sizeof(float);
                     })
        .def(
            "missing_energy",
            [](const Ndf &ndf, bool correlated, std::optional<double> alpha_u,
               std::optional<double> alpha_v) {
                nb::gil_scoped_release unlocked;
                auto missing = alpha_u && alpha_v
                                   ? ndf.missing_energy(correlated, *alpha_u, *alpha_v)
                                   : ndf.missing_energy(correlated);
                return std::make_pair(missing->table.size() * sizeof(float), missing->reached);
            },
            "correlated"_a, "alpha_u"_a = nb::none(), "alpha_v"_a = nb::none(),
            "(bytes, error of E that was measured) of the table of what single scattering loses.")
        .def_prop_ro("count_of_numbers", &Ndf::count_of_numbers,
                     "Values of a table, or weights and then roughnesses of a mixture.")
        .def(
            "by_numbers",
            [](const Ndf &ndf, std::string_view quantity, double alpha_u, double alpha_v,
               const Array &w) {
                Output result(ndf.count_of_numbers() * (w.size() / 3));
                {
                    nb::gil_scoped_release unlocked;
                    ndf.by_numbers(quantity, alpha_u, alpha_v, in(w), result.out());
                }
                return result.release();
            },
            "quantity"_a, "alpha_u"_a, "alpha_v"_a, "w"_a,
            "Derivatives of \"d\" or \"lambda\" by the logarithms of all numbers, a row for each "
            "direction.")
        .def(
            "eval",
            [](const Ndf &ndf, std::string_view query, double alpha_u, double alpha_v,
               const Array &first, std::optional<Array> second) {
                Output result(Ndf::results_of(query, first.size()));
                {
                    nb::gil_scoped_release unlocked;
                    Ndf::In beside = second ? in(*second) : Ndf::In{ nullptr, 0 };
                    ndf.eval(query, alpha_u, alpha_v, in(first), beside, result.out());
                }
                return result.release();
            },
            "query"_a, "alpha_u"_a, "alpha_v"_a, "first"_a, "second"_a = nb::none(),
            "A function of the core's table of queries over arrays, by its name.");

    sgtd::python::add_microsurface(m);
}

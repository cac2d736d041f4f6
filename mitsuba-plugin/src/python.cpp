#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/string_view.h>

#include "bridge.h"

/// `sgtd._core`: the core over flat arrays of float64. `sgtd/ndf.py` checks arguments and gives
/// arrays their shape.

namespace nb = nanobind;
using namespace nb::literals;
using sgtd::host::Ndf;

namespace {

/// C-contiguous float64 of any shape; the number of values is what counts here.
using Array = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;

Ndf::In in(const Array &array) { return { array.data(), array.size() }; }

/// A new flat array, to be filled without the interpreter lock.
class Output {
public:
    explicit Output(size_t size) : m_data(new double[size]), m_size(size) {}

    Ndf::Out out() { return { m_data.get(), m_size }; }

    nb::object release() {
        double *data = m_data.release();
        nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<double *>(p); });
        return nb::ndarray<nb::numpy, double, nb::ndim<1>>(data, { m_size }, owner).cast();
    }

private:
    std::unique_ptr<double[]> m_data;
    size_t m_size;
};

template <typename Call> nb::object fill(size_t size, Call &&call) {
    Output result(size);
    {
        nb::gil_scoped_release unlocked;
        call(result.out());
    }
    return result.release();
}

using PerNumber    = void (Ndf::*)(Ndf::In, Ndf::Out) const;
using PerDirection = void (Ndf::*)(double, double, Ndf::In, Ndf::Out) const;

template <PerNumber Method> nb::object per_number(const Ndf &ndf, const Array &x) {
    return fill(x.size(), [&](Ndf::Out out) { (ndf.*Method)(in(x), out); });
}

template <PerDirection Method>
nb::object per_direction(const Ndf &ndf, double alpha_u, double alpha_v, const Array &w) {
    return fill(w.size() / 3, [&](Ndf::Out out) { (ndf.*Method)(alpha_u, alpha_v, in(w), out); });
}

} // namespace

NB_MODULE(_core, m) {
    m.attr("mitsuba_release") = SGTD_MITSUBA_RELEASE;
    m.attr("steep")           = sgtd::host::Steep;

    m.def(
        "shape_of_row",
        [](std::string_view row, std::optional<double> gamma, std::optional<double> p,
           std::optional<double> lam, std::optional<double> shift) {
            auto result = sgtd::host::shape_of_row(row, gamma, p, lam, shift);
            return nb::make_tuple(result.shape.gamma, result.shape.p, result.shape.lambda,
                                  result.shape.shift, result.alpha_scale);
        },
        "row"_a, "gamma"_a = nb::none(), "p"_a = nb::none(), "lam"_a = nb::none(),
        "shift"_a = nb::none(),
        "(gamma, p, lambda, shift, alpha_scale) of a named row of the family.");

    m.def(
        "lowest_node",
        [](double gamma, double p, double lam, double shift) {
            auto node = sgtd::host::lowest_node({ gamma, p, lam, shift });
            return nb::make_tuple(node.name, node.shape.gamma, node.shape.p, node.shape.lambda,
                                  node.shape.shift, node.alpha_scale, node.closed_form);
        },
        "gamma"_a, "p"_a, "lam"_a, "shift"_a,
        "(name, gamma, p, lambda, shift, alpha_scale, closed_form) of the node at which a shape "
        "runs.");

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

    nb::class_<Ndf>(m, "Ndf", "A validated shape with its tables.")
        .def_static(
            "get",
            [](double gamma, double p, double lam, double shift, double accuracy, bool visible) {
                nb::gil_scoped_release unlocked;
                // The object is shared and has no method that changes it
                return std::const_pointer_cast<Ndf>(
                    Ndf::get({ gamma, p, lam, shift }, accuracy, visible));
            },
            "gamma"_a, "p"_a, "lam"_a, "shift"_a, "accuracy"_a, "visible"_a = true)
        .def_prop_ro("normalization", [](const Ndf &ndf) { return ndf.tables().normalization; })
        .def_prop_ro("accuracy_reached",
                     [](const Ndf &ndf) { return ndf.tables().accuracy_reached; })
        .def_prop_ro("steepness", [](const Ndf &ndf) { return ndf.tables().steepness; })
        .def_prop_ro("table_bytes",
                     [](const Ndf &ndf) {
                         auto tables = ndf.tables();
                         return (tables.lambda.size + tables.visible.size) * sizeof(float);
                     })
        .def(
            "losses",
            [](const Ndf &ndf, bool correlated, std::optional<double> alpha_u,
               std::optional<double> alpha_v) {
                nb::gil_scoped_release unlocked;
                auto losses = alpha_u && alpha_v ? ndf.losses(correlated, *alpha_u, *alpha_v)
                                                 : ndf.losses(correlated);
                return std::make_pair(losses->table.size() * sizeof(float), losses->reached);
            },
            "correlated"_a, "alpha_u"_a = nb::none(), "alpha_v"_a = nb::none(),
            "(bytes, error of E that was measured) of the table of what single scattering loses.")
        .def("d", &per_direction<&Ndf::d_batch>, "alpha_u"_a, "alpha_v"_a, "m"_a)
        .def("lambda_", &per_direction<&Ndf::lambda_batch>, "alpha_u"_a, "alpha_v"_a, "w"_a)
        .def("g1", &per_direction<&Ndf::g1_batch>, "alpha_u"_a, "alpha_v"_a, "w"_a)
        .def(
            "g2",
            [](const Ndf &ndf, double alpha_u, double alpha_v, const Array &wi, const Array &wo,
               bool correlated) {
                return fill(wi.size() / 3, [&](Ndf::Out out) {
                    ndf.g2_batch(alpha_u, alpha_v, in(wi), in(wo), correlated, out);
                });
            },
            "alpha_u"_a, "alpha_v"_a, "wi"_a, "wo"_a, "correlated"_a)
        .def(
            "pdf",
            [](const Ndf &ndf, double alpha_u, double alpha_v, const Array &wi, const Array &normal,
               bool visible) {
                return fill(wi.size() / 3, [&](Ndf::Out out) {
                    ndf.pdf_batch(alpha_u, alpha_v, in(wi), in(normal), visible, out);
                });
            },
            "alpha_u"_a, "alpha_v"_a, "wi"_a, "m"_a, "visible"_a)
        .def(
            "sample",
            [](const Ndf &ndf, double alpha_u, double alpha_v, const Array &wi, const Array &u,
               bool visible) {
                Output normals(wi.size()), pdf(wi.size() / 3);
                {
                    nb::gil_scoped_release unlocked;
                    ndf.sample_batch(alpha_u, alpha_v, in(wi), in(u), visible, normals.out(),
                                     pdf.out());
                }
                return nb::make_tuple(normals.release(), pdf.release());
            },
            "alpha_u"_a, "alpha_v"_a, "wi"_a, "u"_a, "visible"_a)
        .def("profile", &per_number<&Ndf::profile_batch>, "x"_a)
        .def("cdf", &per_number<&Ndf::cdf_batch>, "x"_a)
        .def("sf", &per_number<&Ndf::sf_batch>, "x"_a)
        .def("quantile", &per_number<&Ndf::quantile_batch>, "u"_a)
        .def("isf", &per_number<&Ndf::isf_batch>, "s"_a);
}

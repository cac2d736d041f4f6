#include <algorithm>
#include <array>
#include <string_view>

#include <nanobind/stl/array.h>
#include <nanobind/stl/string_view.h>

#include "python_arrays.h"

/// Explicit surfaces for `sgtd/microsurface`. Every long call has a `Watch` and runs without the
/// interpreter lock, so that another thread can show how far it is, and stop it.

namespace sgtd::python {

using namespace nb::literals;
using host::Goniometer;
using host::Microsurface;
using host::Ndf;
using host::SlopeAgreement;
using host::Watch;

static Flat to_array(const std::vector<double> &values) {
    Output result(values.size());
    std::copy(values.begin(), values.end(), result.out().data);
    return result.release();
}

void add_microsurface(nb::module_ &m) {
    nb::class_<Watch>(m, "Watch", "How far a long call is; `stop` ends it.")
        .def(nb::init<>())
        .def_prop_ro("done", &Watch::done, "Steps or walks.")
        .def_prop_ro("distance", &Watch::distance,
                     "Kolmogorov-Smirnov distance that the last step of a generator began with.")
        .def("stop", &Watch::stop);

    nb::class_<SlopeAgreement>(m, "SlopeAgreement", "How near slopes are to a distribution.")
        .def_ro("ks", &SlopeAgreement::ks, "Kolmogorov-Smirnov distance of the radial slopes.")
        .def_ro("tv", &SlopeAgreement::tv,
                "Total variation over 64 x 32 bins of equal probability, radius and azimuth.")
        .def_ro("tv_independent", &SlopeAgreement::tv_independent,
                "What as many independent facets have of it, on average.")
        .def_ro("worst_bin", &SlopeAgreement::worst_bin,
                "Greatest relative error of 100 radial bins of equal probability.")
        .def_ro("mean_error", &SlopeAgreement::mean_error,
                "Mean length of the slopes over that of the target, less 1.");
    m.def(
        "slope_agreement",
        [](const Ndf &ndf, double alpha_u, double alpha_v, const Array &slopes) {
            nb::gil_scoped_release unlocked;
            return ndf.slope_agreement(alpha_u, alpha_v, in(slopes));
        },
        "ndf"_a, "alpha_u"_a, "alpha_v"_a, "slopes"_a,
        "Distances of slopes, packed x, y, from a distribution.");

    nb::class_<Goniometer>(m, "Goniometer", "What a virtual goniometer measures.")
        .def(
            "__init__",
            [](Goniometer *self, std::array<double, 3> wi, std::string_view material,
               std::array<double, 3> eta, std::array<double, 3> k, size_t orders, size_t polar,
               size_t azimuths, size_t cosines, uint64_t walks, uint64_t seed) {
                auto kind = material == "conductor"    ? host::FacetMaterial::Conductor
                            : material == "dielectric" ? host::FacetMaterial::Dielectric
                                                       : host::FacetMaterial::Mirror;
                new (self)
                    Goniometer{ wi, kind, eta, k, orders, polar, azimuths, cosines, walks, seed };
            },
            "wi"_a, "material"_a, "eta"_a, "k"_a, "orders"_a, "polar"_a, "azimuths"_a, "cosines"_a,
            "walks"_a, "seed"_a)
        .def(
            "reflectance",
            [](const Goniometer &goniometer, const Array &cosines) {
                Output result(3 * cosines.size());
                goniometer.reflectance(in(cosines), result.out());
                return result.release();
            },
            "cosines"_a,
            "What a facet reflects of light from outside at each cosine, three colors in a row.");
    m.def(
        "measure_model",
        [](const Ndf &ndf, double alpha_u, double alpha_v, const Goniometer &goniometer,
           const Watch &watch) {
            Output result(goniometer.numbers());
            {
                nb::gil_scoped_release unlocked;
                ndf.measure_model(alpha_u, alpha_v, goniometer, watch, result.out());
            }
            return result.release();
        },
        "ndf"_a, "alpha_u"_a, "alpha_v"_a, "goniometer"_a, "watch"_a,
        "Walks on Smith's model of a surface; the numbers are those of Microsurface.measure.");

    nb::class_<Microsurface>(m, "Microsurface", "A periodic surface made of facets.")
        .def(
            "__init__",
            [](Microsurface *self, size_t nx, size_t ny, double dx, double dy,
               const Array &heights) { new (self) Microsurface(nx, ny, dx, dy, in(heights)); },
            "nx"_a, "ny"_a, "dx"_a, "dy"_a, "heights"_a)
        .def_static(
            "generate",
            [](const Ndf &ndf, size_t size, double correlation, uint64_t seed, double tolerance,
               size_t steps, const Watch &watch) {
                nb::gil_scoped_release unlocked;
                return Microsurface::generate(ndf, size, correlation, seed, tolerance, steps,
                                              watch);
            },
            "ndf"_a, "size"_a, "correlation"_a, "seed"_a, "tolerance"_a, "steps"_a, "watch"_a)
        .def(
            "heights",
            [](const Microsurface &surface) {
                auto heights = surface.heights();
                Output result(heights.size);
                std::copy_n(heights.data, heights.size, result.out().data);
                return result.release();
            },
            "x first")
        .def(
            "slopes",
            [](const Microsurface &surface) {
                std::vector<double> slopes;
                {
                    nb::gil_scoped_release unlocked;
                    slopes = surface.slopes();
                }
                return to_array(slopes);
            },
            "Of all facets, packed x, y: lower and upper of each cell in turn.")
        .def(
            "projected_areas",
            [](const Microsurface &surface, const Array &w) {
                Output result(w.size() / 3);
                {
                    nb::gil_scoped_release unlocked;
                    surface.projected_areas(in(w), result.out());
                }
                return result.release();
            },
            "w"_a,
            "Area of all facets that face a direction, seen from there, per area of the tile.")
        .def(
            "areas_by_cosine",
            [](const Microsurface &surface, const Goniometer &goniometer) {
                std::vector<double> areas;
                {
                    nb::gil_scoped_release unlocked;
                    areas = surface.areas_by_cosine(goniometer);
                }
                return to_array(areas);
            },
            "goniometer"_a, "The same for its view, by the cosine between view and normal.")
        .def(
            "measure",
            [](const Microsurface &surface, const Goniometer &goniometer, const Watch &watch) {
                Output result(goniometer.numbers());
                {
                    nb::gil_scoped_release unlocked;
                    surface.measure(goniometer, watch, result.out());
                }
                return result.release();
            },
            "goniometer"_a, "watch"_a,
            "Walks, lost, sums of bounces and of their squares; first facets by cosine; energies "
            "by "
            "(hemisphere, order, polar, azimuth, color); sums of their squares.");
}

} // namespace sgtd::python

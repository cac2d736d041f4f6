#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sgtd_constants.h"

/// The Rust core as the C++ of this folder sees it.
///
/// `bridge.cpp` is the only file that includes the generated cxx header. Errors of the core arrive
/// here as `std::invalid_argument` with the core's message. Directions are unit vectors in the
/// local frame (z is the surface normal), densities are per solid angle.
namespace sgtd::host {

/// A contiguous run of values that somebody else owns.
template <typename T> struct Slice {
    T *data;
    size_t size;
};

/// Shape of a distribution at unit roughness.
struct Shape {
    double gamma, p, lambda, shift;

    std::array<double, 4> numbers() const { return { gamma, p, lambda, shift }; }

    bool operator==(const Shape &other) const { return numbers() == other.numbers(); }
};

/// What a row of the family makes of the parameters that were given.
struct RowShape {
    Shape shape;
    /// Factor on the roughness that the user gives: 1 but for `hyper_cauchy`.
    double alpha_scale;

    bool operator==(const RowShape &other) const {
        return shape == other.shape && alpha_scale == other.alpha_scale;
    }
};

/// The node of the family's tree at which a shape runs: the lowest one that its numbers allow.
struct Node {
    /// Name of the row
    std::string name;
    /// The shape without what a roughness says as well: a skew without a shift
    Shape shape;
    /// Factor on the roughness that makes up for it
    double alpha_scale;
    /// Is it GGX without shift, where D, masking and visible normals are closed forms?
    bool closed_form;
};

using Vec3 = std::array<double, 3>;

struct NormalSample {
    Vec3 m;
    /// Density of `m` per solid angle; 0 if there is no valid sample.
    double pdf;
    /// D(m) / pdf, without the overflow of the quotient.
    double d_over_pdf;
};

/// Which normals are drawn: all, the visible ones, or of these (as far as the limits of the core
/// go) those that reflect the view above the horizon.
enum class Normals { All, Visible, Reflecting };

/// A view that is reflected.
struct Reflection {
    double alpha_u, alpha_v;
    Vec3 wi;
    /// Masking and shadowing by height, or independent of each other
    bool correlated;
    Normals normals;
};

/// What a pair of directions gives: D, cosine and density of its half vector, and masking.
struct Reflected {
    double d, cos, g2, pdf;
};

/// A normal, and the masking of the reflection about it.
struct ReflectionSample {
    NormalSample normal;
    double g2;
};

/// Greatest `steepness` for single precision: a slope has 2e-7 of relative error, a Gaussian 28.
/// Lower values cost time, higher ones accuracy.
constexpr double Steep = 38.0;

/// A table as the user gives it.
struct TableSource {
    /// Angles in degrees, or slopes
    std::vector<double> places;
    bool by_angles = false;
    std::vector<double> values;
    /// D, D_cos or slope; power or cut
    std::string quantity = "D", tail = "power";
    std::optional<double> tail_exponent, knee;
    /// The file it is from, for errors
    std::string path;

    /// What a file says; texts that are not empty and a number that is given come first.
    static TableSource read(std::string_view path, std::string_view quantity, std::string_view tail,
                            std::optional<double> tail_exponent);
};

/// What a distribution is made from: a member of the family, a table, or a mixture of these.
/// Immutable; equal keys are equal distributions.
class Radial {
public:
    using Pointer = std::shared_ptr<const Radial>;

    static Pointer family(const Shape &shape);
    static Pointer table(const TableSource &source);

    struct Part {
        double weight, alpha;
        Pointer radial;
    };
    static Pointer mixture(const std::vector<Part> &parts);

    /// The same as a table of so many nodes.
    Pointer resampled(size_t nodes) const;

    ~Radial();
    Radial(const Radial &)            = delete;
    Radial &operator=(const Radial &) = delete;

    bool is_family() const;
    bool is_table() const;
    /// The roughness at which a table or mixture is as it was given; 1 for the family.
    double width() const;
    const std::string &key() const { return m_key; }

    /// Of a table as it was given: slopes and densities there, knee, and the exponent of its tail
    /// (0 if it is cut).
    std::vector<double> slopes() const;
    std::vector<double> slope_densities() const;
    double knee() const;
    double tail_exponent() const;

private:
    friend class Ndf;
    struct Impl;
    explicit Radial(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> m_impl;
    std::string m_key;
};

/// What is known of a distribution before the tables that normals are drawn from.
struct Numbers {
    double normalization, accuracy_reached;
    /// Mean of the stretched slope
    double mean;
    /// Are visible normals drawn over the odds F / (1 - F) instead of the squared slope?
    bool by_odds;
};

/// Numbers and arrays from which D, Lambda and the sampler can be evaluated in single precision.
struct Tables : Numbers {
    double scale;
    /// Greatest |d ln D / d ln(slope)| that matters: by how much D magnifies a slope's rounding.
    double steepness;
    uint32_t lambda_entries, visible_rows, visible_cells;
    Slice<const float> lambda, visible;
    /// Cells of a profile that is no member of the family, and, where it is steep, the same in
    /// double precision
    Slice<const float> cells;
    Slice<const double> precise_cells = { nullptr, 0 };
};

/// What single scattering loses: numbers and an array from which 1 - E can be evaluated.
struct MissingEnergy {
    double slope, power, end, spread, greatest, least_alpha, greatest_alpha;
    /// log2(1 - E_avg) of one pair of roughnesses, and its derivatives by their logarithms
    double average_log, average_u, average_v;
    /// Greatest error of E that was measured
    double reached;
    /// Nodes of the grid over the view, and over roughness or azimuth
    uint32_t views, columns;
    std::vector<float> table;
};

/// What a rough interface reflects or transmits at one pair of roughnesses and one index: numbers
/// and an array from which it can be evaluated.
struct Interface {
    /// Azimuths of the array; 1 for one roughness
    uint32_t columns;
    /// Cosine of total reflection, or 0
    double critical;
    /// 2 * integral of the quantity * mu
    double average;
    /// The same of what is reflected from below, if transmittance was asked for
    double internal_reflectance;
    /// The same of what a facet reflects from above
    double facet_reflectance;
    std::vector<float> table;
};

/// 1/gamma, p, lambda and shift: what derivatives are taken by.
constexpr size_t ShapeParameters = 4;

/// Derivatives of ln A and of the masking table by these.
struct Gradient {
    std::array<double, ShapeParameters> log_normalization;
    /// Of each cell of the masking table, four coefficients for each parameter
    std::vector<float> table;
};

/// Derivatives by the logarithms of the numbers of a table or a mixture: a matrix, a column for
/// each number, that gives the changes of all tables. `masking::NumbersTable` of the core says what
/// its rows are, in blocks of four.
struct NumbersGradient {
    size_t columns, cells_of_h, cells_of_f;
    /// The cells of f in which 0 is, in single and in double precision
    size_t first, first_precise;
    std::vector<float> matrix;
};

/// Shape of a named row; parameters that were left out take their defaults.
RowShape shape_of_row(std::string_view row, std::optional<double> gamma, std::optional<double> p,
                      std::optional<double> lambda, std::optional<double> shift);

Node lowest_node(const Shape &shape);

/// What evaluates a material: Mitsuba's own distributions, or tables.
enum class CodePath { Tables, Ggx, Beckmann };

/// That of a named row whose numbers lead to `node`. Numbers decide, with one exception: Mitsuba
/// masks Beckmann by a fit that is off by 6e-3, which is only for who asks for it by name, and not
/// for bounded sampling at the same time, as Mitsuba has none.
inline CodePath code_path(std::string_view row, const Node &node, bool bounded) {
    if (node.closed_form)
        return CodePath::Ggx;
    return row == "beckmann" && node.shape.shift == 0.0 && !bounded ? CodePath::Beckmann
                                                                    : CodePath::Tables;
}

/// Throws if the core would not take these roughnesses.
void check_roughness(double alpha_u, double alpha_v);

/// Index of the first of the packed directions whose length differs from 1 by more than
/// `tolerance`; their number if there is none.
size_t first_of_wrong_length(Slice<const double> w, double tolerance);

/// Index of the first number outside [low, high]; their number if there is none.
size_t first_outside(Slice<const double> x, double low, double high);

/// How far a long call is, for other threads to see; they may ask it to stop.
class Watch {
public:
    Watch();
    ~Watch();
    Watch(const Watch &)            = delete;
    Watch &operator=(const Watch &) = delete;

    /// Steps or walks.
    uint64_t done() const;
    /// Kolmogorov-Smirnov distance that the last step of a generator began with.
    double distance() const;
    void stop() const;

private:
    friend class Ndf;
    friend class Microsurface;
    struct Impl;
    std::unique_ptr<Impl> m_impl;
};

/// How near slopes are to a distribution.
struct SlopeAgreement {
    double ks, tv, tv_independent, worst_bin, mean_error;
};

/// What facets are made of.
enum class FacetMaterial { Mirror, Conductor, Dielectric };

/// What a virtual goniometer measures.
struct Goniometer {
    Vec3 wi;
    FacetMaterial material;
    /// Per color; a dielectric has its relative index in all of `eta`
    std::array<double, 3> eta, k;
    size_t orders, polar, azimuths, cosines;
    uint64_t walks, seed;

    /// How many numbers it has to say: walks, lost, sums of bounces and of their squares; first
    /// facets by cosine; energies by (hemisphere, order, polar, azimuth, color); their squares.
    size_t numbers() const;

    /// What a facet reflects of light from outside at each of the cosines, three colors in a row.
    void reflectance(Slice<const double> incident, Slice<double> out) const;
};

/// One distribution with its tables. Roughness is an argument of every method (at least 1e-4).
class Ndf {
public:
    /// Equal arguments share one object for as long as somebody holds it. Thread safe.
    static std::shared_ptr<const Ndf> get(const Radial &radial, double accuracy, bool visible);
    static std::shared_ptr<const Ndf> get(const Shape &shape, double accuracy, bool visible) {
        return get(*Radial::family(shape), accuracy, visible);
    }

    ~Ndf();
    Ndf(const Ndf &)            = delete;
    Ndf &operator=(const Ndf &) = delete;

    Numbers numbers() const;

    /// Views into this object: valid for as long as it lives. What normals are drawn from is made
    /// on the first call.
    Tables tables() const;

    /// Made anew on every call. Throws for what is not of the family.
    Gradient gradient() const;

    /// The same for a table or a mixture; `precise` asks for what double precision reads as well.
    NumbersGradient numbers_gradient(bool precise) const;

    /// Derivatives of "d" or "lambda" of packed directions by the logarithms of all numbers, and
    /// how many these are: the values of a table; the weights, then the roughnesses of a mixture.
    size_t count_of_numbers() const;
    void by_numbers(std::string_view quantity, double alpha_u, double alpha_v,
                    Slice<const double> w, Slice<double> out) const;

    double d(double alpha_u, double alpha_v, const Vec3 &m) const;
    double projected_area(double alpha_u, double alpha_v, const Vec3 &w) const;
    double pdf(double alpha_u, double alpha_v, const Vec3 &wi, const Vec3 &m,
               Normals normals) const;
    NormalSample sample(double alpha_u, double alpha_v, const Vec3 &wi, double u1, double u2,
                        Normals normals) const;

    /// All that a reflection asks for in one call, and both at once: they share the view.
    Reflected reflected(const Reflection &view, const Vec3 &wo) const;
    ReflectionSample sample_reflection(const Reflection &view, double u1, double u2) const;
    std::pair<Reflected, ReflectionSample>
    reflected_and_sample(const Reflection &view, const Vec3 &wo, double u1, double u2) const;

    /// What single scattering loses at every isotropic roughness, or at one pair of roughnesses.
    /// Shared like the object of `get`.
    std::shared_ptr<const MissingEnergy> missing_energy(bool correlated) const;
    std::shared_ptr<const MissingEnergy> missing_energy(bool correlated, double alpha_u,
                                                        double alpha_v) const;

    /// The reflectance or the transmittance of an interface with the index `eta`, that below over
    /// that above. Shared in the same way.
    std::shared_ptr<const Interface> interface(bool correlated, double alpha_u, double alpha_v,
                                               double eta, bool transmittance) const;

    /// Functions over arrays, by their names in the core's table of queries. Directions are packed
    /// xyz. `results_of` says how many numbers come of so many in the first array.
    using In  = Slice<const double>;
    using Out = Slice<double>;
    static size_t results_of(std::string_view query, size_t numbers);
    void eval(std::string_view query, double alpha_u, double alpha_v, In first, In second,
              Out out) const;

    /// Distances of slopes (packed x, y) from this distribution.
    SlopeAgreement slope_agreement(double alpha_u, double alpha_v, In slopes) const;

    /// Walks on Smith's model of a surface: all numbers of `Goniometer::numbers`.
    void measure_model(double alpha_u, double alpha_v, const Goniometer &goniometer,
                       const Watch &watch, Out out) const;

private:
    friend class Microsurface;
    struct Impl;
    explicit Ndf(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> m_impl;
};

/// A periodic surface made of facets.
class Microsurface {
public:
    /// With slopes of this distribution, at unit roughness and spacing.
    static Microsurface generate(const Ndf &ndf, size_t size, double correlation, uint64_t seed,
                                 double tolerance, size_t steps, const Watch &watch);
    /// Of given heights, x first.
    Microsurface(size_t nx, size_t ny, double dx, double dy, Slice<const double> heights);
    ~Microsurface();
    Microsurface(Microsurface &&other) noexcept;

    Slice<const double> heights() const;
    /// Of all facets, packed x, y
    std::vector<double> slopes() const;
    /// Areas of facets that face each of the directions, packed xyz
    void projected_areas(Slice<const double> w, Slice<double> out) const;
    /// Those that one view sees, by the cosine between it and the normal
    std::vector<double> areas_by_cosine(const Goniometer &goniometer) const;
    void measure(const Goniometer &goniometer, const Watch &watch, Slice<double> out) const;

private:
    struct Impl;
    explicit Microsurface(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> m_impl;
};

} // namespace sgtd::host

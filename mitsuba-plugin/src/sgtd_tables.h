#pragma once

#include <cstring>
#include <type_traits>

#include <mitsuba/core/fwd.h>
#include <mitsuba/core/logger.h>

#include "numbers_gradient.h"
#include "piecewise_profile.h"
#include "sgtd_profile.h"
#include "shape_gradient.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * Numbers and tables of one shape, in the form that traced code reads.
 *
 * All of them are opaque variables, table lengths included: a literal or a host branch would give
 * each material a code path of its own, and lanes that mix k code paths cost about k times as much.
 * Scalar variants in double precision call the core instead; they only need `alpha_scale`.
 */
template <typename Float_> struct SgtdTables {
    using Float       = Float_;
    using Double      = dr::float64_array_t<Float>;
    using UInt32      = dr::uint32_array_t<Float>;
    using FloatBuffer = DynamicBuffer<Float>;

    /// Size of the visible-normal table, of which `sample_visible = false` has the last row alone.
    static constexpr uint32_t Rows = sgtd::host::VisibleRows, Cells = sgtd::host::VisibleCells,
                              Block = sgtd::host::VisibleBlock;
    /// Of a list of knots or masses, every eighth in front; of a row, that list and a pair per cell
    static constexpr uint32_t List = Block + Cells, RowSize = List + 2 * Cells;

    /// Size of the masking table's header: one entry per exponent of a float.
    static constexpr uint32_t Entries = sgtd::host::MaskingEntries;

    /// Single precision evaluates tables here, whether traced or not. The core is called for every
    /// value by variants in double precision, and where more is asked for than single precision
    /// has.
    static constexpr bool Single = std::is_same_v<dr::scalar_t<Float>, float>;
    bool by_core                 = !Single;

    /// Factor on the roughness that the user gives
    Float alpha_scale;
    /// A / pi
    Float factor;
    SgtdProfile<Float> profile;
    /// The same and the factor in double precision; made only if `steep`
    SgtdProfile<Double> precise;
    Double precise_scale;
    /// What stands for the profile of the family if there is a table or a mixture instead, and the
    /// same in double precision
    PiecewiseProfile<Float> cells;
    PiecewiseProfile<Double> precise_cells;
    bool by_cells = false;
    /// Are visible normals tabulated over the odds of the profile, not over rho^2?
    bool by_odds = false;
    /// Does the rounding of a slope in single precision change D by more than about 1e-5?
    bool steep = false;
    /// The b of the row coordinate a / (a + b) of the visible-normal table
    Float scale;
    /// Entries and cubics of the masking table; knots y = rho^2 and rows of the visible-normal
    /// table: lists of y and of the masses above a knot, pairs (y, width) and (mass, densities)
    FloatBuffer lambda, visible;

    /// What carries the gradients of the shape, if any has one: only in what `following` returns
    const ShapeGradient<Float> *gradient = nullptr;
    ShapeExcess<Float> excess;
    /// The same for the numbers of a table or a mixture
    const NumbersGradient<Float> *numbers = nullptr;

    /// The same with the gradients of the shape, and of a factor on the roughness that depends on
    /// it. `derivatives` must outlive the result.
    SgtdTables following(const ShapeGradient<Float> &derivatives, const ShapeExcess<Float> &by,
                         const Float &roughness) const {
        SgtdTables result = *this;
        result.gradient   = &derivatives;
        result.excess     = by;
        Float log_a       = 0.f;
        const auto each   = derivatives.log_normalization();
        for (size_t k = 0; k < each.size(); ++k)
            if (by.which[k])
                log_a = dr::fmadd(by.value[k], each[k], log_a);
        result.factor      = dr::fmadd(factor, log_a, factor);
        result.profile     = profile.following(by);
        result.alpha_scale = roughness;
        if (steep) {
            result.precise       = precise.following(by);
            result.precise_scale = dr::replace_grad(precise_scale, Double(roughness));
        }
        return result;
    }

    /// The same with the gradients of the numbers of a table or a mixture.
    SgtdTables following(const NumbersGradient<Float> &derivatives) const {
        SgtdTables result = *this;
        result.numbers    = &derivatives;
        // What grows wider at a roughness that is fixed is scaled back
        if (derivatives.scaled) {
            result.alpha_scale = dr::fnmadd(alpha_scale, derivatives.log_mean(), alpha_scale);
            if (steep)
                result.precise_scale = dr::replace_grad(precise_scale, Double(result.alpha_scale));
        }
        return result;
    }

    /// Is there a gradient of the shape or of numbers?
    bool follows() const { return gradient || numbers; }

    /**
     * What a material on Mitsuba's own distribution has instead of tables: nothing but a factor on
     * its roughness, if that is not 1. (That it is there or not is a choice of its own: see
     * FrozenChoice.)
     */
    static SgtdTables without(double alpha_scale) {
        SgtdTables result;
        if (alpha_scale != 1.0) {
            result.alpha_scale = (float)alpha_scale;
            dr::make_opaque(result.alpha_scale);
        }
        return result;
    }

    /// The accuracy to ask the core for: nothing finer than single precision can show.
    static double accuracy(double given) {
        return dr::is_jit_v<Float> && given > 0.0 ? std::max(given, 1e-7) : given;
    }

    /// `accuracy` is what was asked for.
    static SgtdTables load(const sgtd::host::Ndf &ndf, const sgtd::host::RowShape &row,
                           double accuracy) {
        SgtdTables result;
        result.by_core = !dr::is_jit_v<Float> && (!Single || accuracy < 1e-7);
        if constexpr (Single) {
            const sgtd::host::Tables tables = ndf.tables();
            const sgtd::host::Shape &shape  = row.shape;
            if ((tables.visible_rows != Rows && tables.visible_rows != 1) ||
                tables.visible_cells != Cells ||
                tables.visible.size != (1 + tables.visible_rows) * RowSize ||
                tables.lambda_entries != Entries)
                Throw("sgtd: the tables of the core do not have the layout that this plugin was "
                      "built for; rebuild the package.");
            result.alpha_scale = (float)row.alpha_scale;
            result.factor      = (float)(tables.normalization / dr::Pi<double>);
            result.by_cells    = tables.cells.size > 0;
            result.by_odds     = tables.by_odds;
            if (result.by_cells)
                result.cells = PiecewiseProfile<Float>::load(tables.cells);
            else
                result.profile = SgtdProfile<Float>::load(shape);
            result.steep = tables.steepness > sgtd::host::Steep;
            if (result.steep) {
                if (result.by_cells)
                    result.precise_cells = PiecewiseProfile<Double>::load(tables.precise_cells);
                else
                    result.precise = SgtdProfile<Double>::load(shape);
                result.precise_scale = row.alpha_scale;
                dr::make_opaque(result.precise_scale);
            }
            result.scale   = (float)tables.scale;
            result.lambda  = dr::load<FloatBuffer>(tables.lambda.data, tables.lambda.size);
            result.visible = dr::load<FloatBuffer>(tables.visible.data, tables.visible.size);
            dr::make_opaque(result.alpha_scale, result.factor, result.scale, result.lambda,
                            result.visible);
        } else {
            DRJIT_MARK_USED(ndf);
            result.alpha_scale = (Float)row.alpha_scale;
        }
        return result;
    }

    /// The square root of f at y = rho^2.
    Float sqrt_f(const Float &y) const {
        if (!by_cells)
            return profile.sqrt_f(y);
        if constexpr (dr::is_diff_v<Float>)
            if (numbers)
                return cells.sqrt_f(y, [&](const UInt32 &cell, const Float &log_t) {
                    return numbers->log_density(cell, log_t);
                });
        return cells.sqrt_f(y);
    }

    Double precise_sqrt_f(const Double &y) const {
        if (!by_cells)
            return precise.sqrt_f(y);
        if constexpr (dr::is_diff_v<Float>)
            if (numbers)
                return precise_cells.sqrt_f(y, [&](const auto &cell, const Double &log_t) {
                    return Double(numbers->precise_log_density(cell, Float(log_t)));
                });
        return precise_cells.sqrt_f(y);
    }

    /// Neighboring numbers of a table: as many as `Value` has, from a multiple of that on.
    template <typename Value> static Value read(const FloatBuffer &table, const UInt32 &index) {
        if constexpr (dr::is_jit_v<Float>) {
            return dr::gather<Value>(table, index);
        } else {
            Value result;
            std::memcpy((void *)&result,
                        table.data() + (size_t)index * (sizeof(Value) / sizeof(float)),
                        sizeof(Value));
            return result;
        }
    }

    DRJIT_STRUCT(SgtdTables, alpha_scale, factor, profile, precise, precise_scale, cells,
                 precise_cells, scale, lambda, visible)
};

NAMESPACE_END(mitsuba)

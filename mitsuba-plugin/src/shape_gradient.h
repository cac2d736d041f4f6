#pragma once

#include <array>

#include <mitsuba/core/fwd.h>

#include "bridge.h"
#include "frozen_choice.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * How the normalization and the masking of a shape follow 1/gamma, p, lambda and shift: tables that
 * are there only if one of these has a gradient.
 *
 * Where a parameter has one, what it exceeds its value by is a number that is 0 and carries the
 * gradient. First order in these numbers is all that is needed, so a table t becomes t + sum_k
 * excess_k dt/dtheta_k, with a look-up for each k that has a gradient and none for the others.
 */
template <typename Float_> struct ShapeGradient {
    using Float       = Float_;
    using FloatBuffer = DynamicBuffer<Float>;
    using Which       = std::array<bool, sgtd::host::ShapeParameters>;

    /// Which parameters have a gradient, and whether any has: what selects code.
    FrozenChoice<Float> any, by_tail, by_p, by_lambda, by_shift;
    /// d ln A / d theta
    Float log_a_tail, log_a_p, log_a_lambda, log_a_shift;
    /// Four cubics for each cell of the masking table, in its order
    FloatBuffer table;

    static ShapeGradient load(const sgtd::host::Ndf &ndf, const Which &which) {
        const sgtd::host::Gradient core = ndf.gradient();
        ShapeGradient result;
        result.any          = true;
        result.by_tail      = which[0];
        result.by_p         = which[1];
        result.by_lambda    = which[2];
        result.by_shift     = which[3];
        const auto &log_a   = core.log_normalization;
        using Scalar        = dr::scalar_t<Float>;
        result.log_a_tail   = (Scalar)log_a[0];
        result.log_a_p      = (Scalar)log_a[1];
        result.log_a_lambda = (Scalar)log_a[2];
        result.log_a_shift  = (Scalar)log_a[3];
        result.table        = dr::load<FloatBuffer>(core.table.data(), core.table.size());
        dr::make_opaque(result.log_a_tail, result.log_a_p, result.log_a_lambda, result.log_a_shift,
                        result.table);
        return result;
    }

    Which which() const { return { by_tail, by_p, by_lambda, by_shift }; }

    std::array<Float, 4> log_normalization() const {
        return { log_a_tail, log_a_p, log_a_lambda, log_a_shift };
    }

    DRJIT_STRUCT(ShapeGradient, any, by_tail, by_p, by_lambda, by_shift, log_a_tail, log_a_p,
                 log_a_lambda, log_a_shift, table)
};

/// Numbers that are 0 and carry the gradients of 1/gamma, p, lambda and shift; only those that
/// `which` has are there.
template <typename Float> struct ShapeExcess {
    typename ShapeGradient<Float>::Which which = {};
    std::array<Float, sgtd::host::ShapeParameters> value;
};

NAMESPACE_END(mitsuba)

#pragma once

#include <algorithm>

#include <mitsuba/core/fwd.h>

#include "bridge.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * The radial profile f of the family over a Dr.Jit type.
 *
 * Single precision does for most shapes. Where f is steep in ln x (a thin ring, the edge of a box),
 * the rounding of a single-precision slope alone changes f by more than 1e-5; such shapes are
 * evaluated with `Value` in double precision.
 */
template <typename Value_> struct SgtdProfile {
    using Value  = Value_;
    using Scalar = dr::scalar_t<Value>;

    /// Least exponent given to exp2, which returns garbage where its result would be denormal.
    static constexpr Scalar LeastPower = (Scalar)-120;

    /// 1 / (gamma - 1), gamma (finite), p, shift, 1 / (1 + lambda), 1 / (1 - lambda)
    Value inv_gamma_1, gamma, p, shift, inv_outer, inv_inner;

    static SgtdProfile load(const sgtd::host::Shape &shape) {
        SgtdProfile result;
        result.inv_gamma_1 = (Scalar)(1.0 / (shape.gamma - 1.0));
        result.gamma       = (Scalar)std::min(shape.gamma, 1e30);
        result.p           = (Scalar)shape.p;
        result.shift       = (Scalar)shape.shift;
        result.inv_outer   = (Scalar)(1.0 / (1.0 + shape.lambda));
        result.inv_inner   = (Scalar)(1.0 / (1.0 - shape.lambda));
        dr::make_opaque(result.inv_gamma_1, result.gamma, result.p, result.shift, result.inv_outer,
                        result.inv_inner);
        return result;
    }

    /**
     * Half of -ln f at rho = sqrt(y), f = (1 + u/(gamma-1))^(-gamma).
     *
     * With k = 1/(gamma-1) and z = k u this is gamma ln(1+z) / 2, or (1 + k) u phi(z) / 2 with
     * phi(z) = ln(1+z)/z for a small z, which includes k = 0 (gamma = inf).
     */
    Value half_exponent(const Value &y) const {
        // Below 1e-20 the derivative of the square root would not be finite
        Value x = dr::sqrt(dr::maximum(y, (Scalar)1e-20)) - shift;
        x *= dr::select(x > 0, inv_outer, inv_inner);
        Value x2    = dr::clip(dr::square(x), (Scalar)1e-30, (Scalar)1e37);
        Value power = dr::exp2(dr::clip(p * dr::log2(x2), LeastPower, (Scalar)126)),
              u = dr::select(p == 1, x2, power), z = dr::minimum(inv_gamma_1 * u, (Scalar)1e37);
        // ln(1+z) loses the digits of a small z (at 1e-4 three remain): 2 artanh(z/(2+z)) there
        Value inv_2z = dr::rcp(2 + z), s2 = dr::square(z * inv_2z),
              odd = dr::fmadd(s2, (Scalar)(1.0 / 9.0), (Scalar)(1.0 / 7.0)),
              series =
                  2 * inv_2z *
                  dr::fmadd(s2, dr::fmadd(s2, dr::fmadd(s2, odd, (Scalar).2), (Scalar)(1.0 / 3.0)),
                            (Scalar)1);
        Value small = dr::fmadd(inv_gamma_1, u, u) * series,
              large = gamma * dr::log(1 + dr::maximum(z, (Scalar).5));
        // exp(-200) is 0 in single precision; beyond, the products may overflow
        return dr::minimum((Scalar).5 * dr::select(z < (Scalar).5, small, large), (Scalar)200);
    }

    DRJIT_STRUCT(SgtdProfile, inv_gamma_1, gamma, p, shift, inv_outer, inv_inner)
};

NAMESPACE_END(mitsuba)

#pragma once

#include <algorithm>

#include <mitsuba/core/fwd.h>

#include "bridge.h"
#include "powers.h"

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
    using Mask   = dr::mask_t<Value>;

    /// 1 / (gamma - 1), gamma (finite), p, shift, 1 / (1 + lambda), 1 / (1 - lambda)
    Value inv_gamma_1, gamma, p, shift, inv_outer, inv_inner;

    /// Does p carry a gradient? Then p = 1 must not be taken out of the derivative.
    bool p_follows = false;

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

    /// The same with the gradients of 1/gamma, p, lambda and shift.
    template <typename Excess> SgtdProfile following(const Excess &excess) const {
        SgtdProfile result = *this;
        auto by            = [&](size_t k) { return Value(excess.value[k]); };
        if (excess.which[0]) {
            result.inv_gamma_1 = dr::fmadd(by(0), dr::square(1 + inv_gamma_1), inv_gamma_1);
            // Beyond, only inv_gamma_1 counts where f is not 0, and the square is not finite
            result.gamma = dr::fnmadd(
                by(0), dr::select(gamma < (Scalar)1e6, dr::square(gamma), (Scalar)0), gamma);
        }
        if (excess.which[1]) {
            result.p         = p + by(1);
            result.p_follows = true;
        }
        if (excess.which[2]) {
            result.inv_outer = dr::fnmadd(by(2), dr::square(inv_outer), inv_outer);
            result.inv_inner = dr::fmadd(by(2), dr::square(inv_inner), inv_inner);
        }
        if (excess.which[3])
            result.shift = shift + by(3);
        return result;
    }

    /**
     * The square root of f = (1 + u/(gamma-1))^(-gamma) at rho = sqrt(y): f itself may underflow
     * where D does not.
     *
     * With k = 1/(gamma-1) and z = k u, -ln f is gamma ln(1+z), or (1 + k) u phi(z) with phi(z) =
     * ln(1+z)/z for a small z, which includes k = 0 (gamma = inf).
     */
    Value sqrt_f(const Value &y) const {
        // Below 1e-20 the derivative of the square root would not be finite
        Value x = dr::sqrt(dr::maximum(y, (Scalar)1e-20)) - shift;
        x *= dr::select(x > 0, inv_outer, inv_inner);
        Value x2 = dr::minimum(dr::maximum(dr::square(x), (Scalar)1e-30), (Scalar)1e37);
        Split split(x2);
        if constexpr (!dr::is_jit_v<Value>)
            if (p == 1)
                return sqrt_f_of(x2);
        // u = x2^p
        Value at_1 = p_follows ? Value(x2 * dr::fmadd(p - 1, dr::log(x2), (Scalar)1)) : x2;
        Value u =
            dr::select(p == 1, at_1, power(p, split.octave, p * split.r * log2_ratio(split.r)));
        return sqrt_f_of(u);
    }

private:
    /// The square root of f at u.
    Value sqrt_f_of(const Value &u) const {
        Value z = dr::minimum(inv_gamma_1 * u, (Scalar)1e37);
        // 1 + z loses the digits of a small z, whose octave is 0
        Split split(1 + z);
        Mask near      = split.octave == 0;
        Value exponent = (Scalar)-.5 * gamma, r = dr::select(near, z, split.r),
              times = dr::select(near, (Scalar)-.5 * dr::fmadd(inv_gamma_1, u, u), exponent * r);
        return power(exponent, split.octave, times * log2_ratio(r));
    }

    using Split = typename Powers<Value>::Split;

    static Value power(const Value &exponent, const Value &octave, const Value &rest) {
        return Powers<Value>::power(exponent, octave, rest);
    }

    static Value log2_ratio(const Value &r) { return Powers<Value>::log2_ratio(r); }

public:
    DRJIT_STRUCT(SgtdProfile, inv_gamma_1, gamma, p, shift, inv_outer, inv_inner)
};

NAMESPACE_END(mitsuba)

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
    using Mask   = dr::mask_t<Value>;

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
        Value u = dr::select(p == 1, x2, power(p, split.octave, p * split.r * log2_ratio(split.r)));
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

    using UInt = dr::uint_array_t<Value>;
    using Int  = dr::int_array_t<Value>;

    static constexpr bool Single      = sizeof(Scalar) == 4;
    static constexpr int MantissaBits = Single ? 23 : 52, Bias = Single ? 127 : 1023;
    /// Bits of the square root of 1/2
    static constexpr dr::scalar_t<Int> LeastMantissa =
        Single ? (dr::scalar_t<Int>)0x3f3504f3 : (dr::scalar_t<Int>)0x3fe6a09e667f3bcd;

    /// A positive number as 2^octave (1 + r), with 1 + r between the square roots of 1/2 and 2.
    struct Split {
        Value octave, r;

        explicit Split(const Value &x) {
            Int n =
                (Int(dr::reinterpret_array<UInt>(dr::detach(x))) - LeastMantissa) >> MantissaBits;
            octave = Value(n);
            r      = dr::fmsub(x, power_of_2(-n), (Scalar)1);
        }
    };

    /**
     * 2^(exponent octave + rest).
     *
     * A sum of 40 would be off by 2e-6 from its rounding alone, which a large gamma magnifies: its
     * whole part is kept apart.
     */
    static Value power(const Value &exponent, const Value &octave, const Value &rest) {
        Value high = exponent * octave, low = dr::fmsub(exponent, octave, high),
              whole = dr::round(high), part = (high - whole) + (low + rest), n = dr::round(part),
              e = dr::minimum(dr::maximum(whole + n, (Scalar)-Bias), (Scalar)Bias);
        return exp2(part - n) * power_of_2(Int(e));
    }

    /// 2^n for -Bias <= n <= Bias, where the first of these is 0.
    static Value power_of_2(const Int &n) {
        return dr::reinterpret_array<Value>(UInt(n + Bias) << MantissaBits);
    }

    /// log2(1 + r) / r for 1 + r between the square roots of 1/2 and 2, a minimax polynomial in
    /// single precision: dr::log2() spends half its time on all other numbers.
    static Value log2_ratio(const Value &r) {
        if constexpr (Single) {
            return dr::estrin(r, 1.44269502f, -.721347332f, .480910629f, -.360703677f, .287916243f,
                              -.238944814f, .215715617f, -.207269818f, .125837058f);
        } else {
            Mask tiny = dr::abs(r) < 1e-8;
            return dr::select(tiny, dr::fnmadd(.5 * dr::InvLogTwo<Value>, r, dr::InvLogTwo<Value>),
                              dr::log2(1 + r) / dr::select(tiny, 1, r));
        }
    }

    /// Of a number between -1/2 and 1/2, a minimax polynomial in single precision.
    static Value exp2(const Value &x) {
        if constexpr (Single)
            return dr::estrin(x, 1.f, .693147182f, .240226462f, .0555032864f, .00961848907f,
                              .00133999309f, .000153458124f);
        else
            return dr::exp2(x);
    }

public:
    DRJIT_STRUCT(SgtdProfile, inv_gamma_1, gamma, p, shift, inv_outer, inv_inner)
};

NAMESPACE_END(mitsuba)

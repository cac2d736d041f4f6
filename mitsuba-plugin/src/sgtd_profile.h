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

    /// Least exponent of 2: what exp2 returns for a denormal result is garbage.
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
        Value x2 = dr::clip(dr::square(x), (Scalar)1e-30, (Scalar)1e37),
              u  = dr::select(p == 1, x2, Power(x2, p).value()),
              z  = dr::minimum(inv_gamma_1 * u, (Scalar)1e37);
        // ln(1+z) loses the digits of a small z (at 1e-4 three remain): 2 artanh(z/(2+z)) there
        Value inv_2z = dr::rcp(2 + z), s2 = dr::square(z * inv_2z),
              odd = dr::fmadd(s2, (Scalar)(1.0 / 9.0), (Scalar)(1.0 / 7.0)),
              series =
                  2 * inv_2z *
                  dr::fmadd(s2, dr::fmadd(s2, dr::fmadd(s2, odd, (Scalar).2), (Scalar)(1.0 / 3.0)),
                            (Scalar)1);
        Mask near   = z < (Scalar).5;
        Value small = (Scalar)(-.5 * 1.4426950408889634) * dr::fmadd(inv_gamma_1, u, u) * series;
        Power large(1 + dr::maximum(z, (Scalar).5), (Scalar)-.5 * gamma);
        large.whole = dr::select(near, 0, large.whole);
        large.rest  = dr::select(near, small, large.rest);
        return large.value();
    }

    /**
     * base^exponent = 2^(whole + rest).
     *
     * As one number of 40, exponent log2(base) would be off by 2e-6 from its rounding alone, which
     * a large gamma magnifies.
     */
    struct Power {
        Value whole, rest;

        Power(const Value &base, const Value &exponent) {
            // Bits of the exponent of a positive normal number
            Int field    = Int(dr::reinterpret_array<UInt>(dr::detach(base)) >> MantissaBits);
            Value octave = Value(field - Bias), mantissa = base * power_of_2(Bias - field),
                  high = exponent * octave, low = dr::fmadd(exponent, octave, -high);
            whole = dr::round(high);
            rest  = (high - whole) + dr::fmadd(exponent, dr::log2(mantissa), low);
        }

        Value value() const {
            return dr::exp2(dr::clip(rest, LeastPower, -LeastPower)) *
                   power_of_2(Int(dr::clip(whole, LeastPower, -LeastPower)));
        }

    private:
        using UInt = dr::uint_array_t<Value>;
        using Int  = dr::int_array_t<Value>;

        static constexpr bool Single      = sizeof(Scalar) == 4;
        static constexpr int MantissaBits = Single ? 23 : 52, Bias = Single ? 127 : 1023;

        static Value power_of_2(const Int &n) {
            return dr::reinterpret_array<Value>(UInt(n + Bias) << MantissaBits);
        }
    };

    DRJIT_STRUCT(SgtdProfile, inv_gamma_1, gamma, p, shift, inv_outer, inv_inner)
};

NAMESPACE_END(mitsuba)

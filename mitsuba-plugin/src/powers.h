#pragma once

#include <mitsuba/core/fwd.h>

NAMESPACE_BEGIN(mitsuba)

/**
 * Powers over a Dr.Jit type, from the bits of a number: what single precision needs of them takes
 * half the time of dr::log2() and dr::exp2(), and a sum of a whole part and the rest keeps the
 * digits that a large exponent magnifies.
 */
template <typename Value_> struct Powers {
    using Value  = Value_;
    using Scalar = dr::scalar_t<Value>;
    using Mask   = dr::mask_t<Value>;
    using UInt   = dr::uint_array_t<Value>;
    using Int    = dr::int_array_t<Value>;

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
            return dr::fmadd(x, exp2_ratio(x), 1.f);
        else
            return dr::exp2(x);
    }

    /// (2^x - 1) / x of the same numbers, in single precision.
    static Value exp2_ratio(const Value &x) {
        return dr::estrin(x, (Scalar).693147182, (Scalar).240226462, (Scalar).0555032864,
                          (Scalar).00961848907, (Scalar).00133999309, (Scalar).000153458124);
    }
};

NAMESPACE_END(mitsuba)

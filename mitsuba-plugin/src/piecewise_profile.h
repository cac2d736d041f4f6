#pragma once

#include <cstring>
#include <type_traits>

#include <mitsuba/core/fwd.h>

#include "bridge.h"
#include "powers.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * A radial profile of any number of pieces over a Dr.Jit type: f, the odds y = F / (1 - F) below a
 * slope, and the slope with given odds.
 *
 * A piece is f = f0 t^(-e) with t = 1 + (s - s0) r over the square s of the slope; its mass is
 * v + m (t^(1-e) - 1) / (1-e), which is F below the median and F - 1 above it. Nothing is searched:
 * the bits of an argument select an octave, which says where its buckets begin and by how much a
 * mantissa is shifted to number them; a bucket holds the first cell in it and where the next three
 * begin. `rust-core/src/profile/cells.rs` makes the tables.
 */
template <typename Value_> struct PiecewiseProfile {
    using Value  = Value_;
    using Scalar = dr::scalar_t<Value>;
    using Mask   = dr::mask_t<Value>;
    using UInt32 = dr::uint32_array_t<Value>;
    using Buffer = DynamicBuffer<Value>;
    using P      = Powers<Value>;

    /// Numbers of an octave's list, of a bucket and of a cell. The core has the same constants.
    static constexpr uint32_t Octaves = 256, BucketSize = 4, CellSize = 8;

    Buffer table;

    static PiecewiseProfile load(sgtd::host::Slice<const Scalar> source) {
        PiecewiseProfile result;
        result.table = dr::load<Buffer>(source.data, source.size);
        dr::make_opaque(result.table);
        return result;
    }

    /// The square root of f, and what of its piece led there.
    struct At {
        Value s, sqrt_f;
    };

    /// The square root of f at s.
    Value sqrt_f(const Value &s) const {
        Cell cell(*this, 0, s);
        return cell.sqrt_f(cell.log_t(s));
    }

    /// The same, where the number of the cell and log2 t say by what `change` ln f changes.
    template <typename Change> Value sqrt_f(const Value &s, const Change &change) const {
        Cell cell(*this, 0, s);
        Log log_t   = cell.log_t(s);
        Value value = cell.sqrt_f(log_t);
        return dr::fmadd(value, (Scalar).5 * change(cell.number, log_t.octave + log_t.rest), value);
    }

    /// The same, with the odds below it.
    struct WithOdds {
        Value sqrt_f, odds;
    };

    WithOdds at(const Value &s) const {
        Cell cell(*this, 0, s);
        Log log_t = cell.log_t(s);
        // (t^(1-e) - 1) / (1-e) = log t (2^z - 1) / z
        Value less = 1 - cell.exponent, z = less * (log_t.octave + log_t.rest), moment;
        Mask near = dr::abs(z) < (Scalar).5;
        moment    = dr::select(
            near, (log_t.octave + log_t.rest) * P::exp2_ratio(dr::select(near, z, (Scalar)0)),
            (P::power(less, log_t.octave, less * log_t.rest) - 1) /
                dr::select(near, (Scalar)1, less));
        Value v = dr::fmadd(cell.mass, moment, cell.base);
        // v may have been rounded beyond an end of what lies between 0 and 1
        Mask above = cell.base < 0;
        Value odds = dr::select(above, (1 + v) / dr::maximum(-v, (Scalar)LeastMass), v / (1 - v));
        return { cell.sqrt_f(log_t),
                 dr::minimum(dr::maximum(odds, (Scalar)0), (Scalar)GreatestOdds) };
    }

    /// The square of the slope below which the odds are `odds`, and f there.
    At draw(const Value &odds) const {
        Cell cell(*this, 1, odds);
        Value v = dr::select(odds < 1, odds, (Scalar)-1) / (1 + odds), less = 1 - cell.exponent,
              moment = (v - cell.base) * cell.inv_mass, x = less * moment;
        typename P::Split split(dr::maximum(1 + x, (Scalar)1e-30));
        // 1 + x loses the digits of a small x, whose octave is 0
        Mask near = split.octave == 0;
        Log log_t;
        Value all    = dr::select(near, moment * P::log2_ratio(dr::select(near, x, (Scalar)0)),
                                  (split.octave + split.r * P::log2_ratio(split.r)) /
                                      dr::select(near, (Scalar)1, less));
        log_t.octave = dr::minimum(dr::maximum(dr::round(all), (Scalar)-126), (Scalar)126);
        log_t.rest   = all - log_t.octave;
        Value power  = P::power_of_2(typename P::Int(log_t.octave)),
              growth = dr::fmadd(power * log_t.rest, P::exp2_ratio(log_t.rest), power - 1);
        return { dr::maximum(dr::fmadd(growth, cell.inv_rate, cell.anchor), (Scalar)0),
                 cell.sqrt_f(log_t) };
    }

private:
    /// Odds are told apart up to here, and what lies above slopes down to here.
    static constexpr double GreatestOdds = 1e18, LeastMass = 1e-18;

    /// A logarithm to base 2 in two parts, for powers that keep their digits.
    struct Log {
        Value octave, rest;
    };

    struct Cell {
        Value anchor, rate, inv_rate, log_f, exponent, base, mass, inv_mass;
        /// Its position in the table
        UInt32 number;

        /// The cell of a number in the list over s (0) or over the odds (1).
        Cell(const PiecewiseProfile &profile, uint32_t list, const Value &x) {
            constexpr uint32_t Mantissa = (1u << 23) - 1u;
            using Bucket                = dr::Array<Value, BucketSize>;
            using Numbers               = dr::Array<Value, CellSize>;
            Value at                    = dr::detach(x);
            UInt32 bits                 = bits_of(at),
                   entry  = whole(profile.template read<Value>(list * Octaves + (bits >> 23u)));
            UInt32 bucket = (entry >> 5u) + ((bits & Mantissa) >> (entry & 31u));
            Bucket starts = profile.template read<Bucket>(bucket);
            number        = whole(starts[0]);
            for (uint32_t i = 1; i < BucketSize; ++i)
                number += dr::select(starts[i] <= at, UInt32(1u), UInt32(0u));
            Numbers n = profile.template read<Numbers>(number);
            anchor    = n[0];
            rate      = n[1];
            inv_rate  = n[2];
            log_f     = n[3];
            exponent  = n[4];
            base      = n[5];
            mass      = n[6];
            inv_mass  = n[7];
        }

        /// log2 t at s.
        Log log_t(const Value &s) const {
            Value r = (s - anchor) * rate;
            // 1 + r loses the digits of a small r, whose octave is 0
            typename P::Split split(dr::maximum(1 + r, (Scalar)1e-30));
            r = dr::select(split.octave == 0, r, split.r);
            return { split.octave, r * P::log2_ratio(r) };
        }

        Value sqrt_f(const Log &log_t) const {
            Value half = (Scalar)-.5 * exponent;
            return P::power(half, log_t.octave, dr::fmadd(half, log_t.rest, (Scalar).5 * log_f));
        }
    };

    /// The bits of the float at or below a number that is not negative.
    static UInt32 bits_of(const Value &x) {
        if constexpr (P::Single) {
            return dr::reinterpret_array<UInt32>(dr::maximum(x, 0.f));
        } else {
            using UInt64 = dr::uint64_array_t<Value>;
            // Exponents of a double begin 896 below those of a float, its mantissa has 29 bits more
            UInt64 bits = dr::reinterpret_array<UInt64>(dr::minimum(dr::maximum(x, 1e-37), 1e37));
            return UInt32((bits >> 29) - (UInt64(896) << 23));
        }
    }

    /// An index in the table.
    static UInt32 whole(const Value &x) {
        if constexpr (P::Single)
            return dr::reinterpret_array<UInt32>(x);
        else
            return UInt32(x);
    }

    /// Neighboring numbers: as many as `Numbers` has, from a multiple of that on.
    template <typename Numbers> Numbers read(const UInt32 &index) const {
        if constexpr (dr::is_jit_v<Value>) {
            return dr::gather<Numbers>(table, index);
        } else {
            Numbers result;
            std::memcpy((void *)&result,
                        table.data() + (size_t)index * (sizeof(Numbers) / sizeof(Scalar)),
                        sizeof(Numbers));
            return result;
        }
    }

public:
    DRJIT_STRUCT(PiecewiseProfile, table)
};

NAMESPACE_END(mitsuba)

#pragma once

#include <mitsuba/core/fwd.h>

#include "sgtd_constants.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * Azimuth of a visible slope of radius rho, counted from the azimuth of the view (cosine c, sine
 * s).
 *
 * Its density is proportional to (c + b cos(phi))+, b = rho s, on [0, phi_1] and its mirror image,
 * where phi_1 = pi, or c + b cos(phi_1) = 0 if b > c. In psi = phi_1 - phi and units of c + b the
 * integral from psi = 0 is
 *
 *     h(psi) = slope_0 psi + a (psi - sin(psi)) + e (1 - cos(psi)),
 *     slope_0 = max(c - b, 0),  a = min(b, c),  e = sqrt(max(b^2 - c^2, 0)):
 *
 * a sum of positive terms, so neither h nor its derivative cancels where it vanishes.
 *
 * Where only slopes count that reflect the view above the horizon, phi ends at phi_2 = acos(kappa),
 * which phi_1 never is before, and h is the same with
 *
 *     slope_0 = c + b kappa,  a = -b kappa,  e = b sin(phi_2),
 *
 * whose slope_0 is never below c/2.
 */
template <typename Float> struct Azimuth {
    using Mask   = dr::mask_t<Float>;
    using UInt32 = dr::uint32_array_t<Float>;

    /// 1 / (c + b); the constants of h; where phi ends, its sine and minus its cosine; h there
    Float inv_sum, slope_0, a, e, phi_1, sin_1, cos_1, mass;
    /// Does phi end at phi_2?
    bool bounded = false;

    Azimuth(const Float &c, const Float &b) {
        inv_sum   = dr::rcp(dr::maximum(c + b, 1e-18f));
        Float e2  = (b - c) * inv_sum;
        slope_0   = dr::select(e2 < 0.f, -e2, 0.f);
        a         = dr::fnmadd(.5f, dr::abs(e2), .5f);
        Mask past = e2 > 1e-12f;
        // e^2 as it is would give an infinite derivative at b = c
        e = dr::select(past, dr::sqrt(dr::maximum(e2, 1e-12f)), 0.f);
        // e is the tangent of half the angle that is cut off
        phi_1 = dr::fnmadd(2.f, atan(e), dr::Pi<Float>);
        mass  = dr::fmadd(c * inv_sum, phi_1, e);
        // Where b > c, (a, e) is (cos, sin)(pi - phi_1) times b in units of c + b; else e is 0
        Float inv_b = dr::rcp(dr::fmadd(.5f, dr::square(e), .5f));
        sin_1       = e * inv_b;
        cos_1       = dr::select(past, a * inv_b, 1.f);
    }

    /**
     * The azimuths that reflect the view above the horizon.
     *
     * `less` and `more` are 1 - kappa and 1 + kappa, both times the same positive number; the
     * second is negative where phi_2 = pi. `rise` is 1 + tan^2 of the facet.
     */
    static Azimuth within(const Float &c, const Float &b, const Float &less, const Float &more,
                          const Float &rise) {
        Azimuth result;
        result.bounded = true;
        result.inv_sum = dr::rcp(dr::maximum(c + b, 1e-18f));
        Mask limited   = more > 0.f;
        Float unit     = dr::rcp(dr::maximum(less + more, 1e-30f)),
              // not 0, so that neither the mass is nor a derivative infinite
            l       = dr::select(limited, dr::maximum(less * unit, 1e-10f), 1.f),
              m     = dr::select(limited, dr::maximum(more * unit, 1e-12f), 1e-12f),
              small = dr::minimum(l, m), angle = 2.f * dr::sqrt(small) * arc_sine(small),
              c_unit = c * result.inv_sum, b_unit = b * result.inv_sum;
        result.cos_1   = l - m;
        result.phi_1   = dr::select(m < l, dr::Pi<Float> - angle, angle);
        result.sin_1   = 2.f * dr::sqrt(l * m);
        result.slope_0 = dr::select(limited, .5f * c_unit * rise, c_unit - b_unit);
        result.a       = c_unit - result.slope_0;
        result.e       = b_unit * result.sin_1;
        result.mass    = dr::fmadd(c_unit, result.phi_1, result.e);
        return result;
    }

    /// h and its first three derivatives.
    struct Terms {
        Float psi, value, slope, curvature, third, sine, versine;
    };

    Terms assemble(const Float &psi, const Float &sine, const Float &versine) const {
        Float p2 = dr::square(psi), cosine = 1.f - versine;
        // psi - sin(psi) has four digits left at psi = 0.03, the series seven up to psi = 1
        Float series =
                  psi * p2 * dr::estrin(p2, 1.f / 6.f, -1.f / 120.f, 1.f / 5040.f, -1.f / 362880.f),
              lag = dr::select(psi < 1.f, series, psi - sine);
        return { psi,
                 dr::fmadd(slope_0, psi, dr::fmadd(a, lag, e * versine)),
                 dr::fmadd(a, versine, dr::fmadd(e, sine, slope_0)),
                 dr::fmadd(a, sine, e * cosine),
                 dr::fmsub(a, cosine, e * sine),
                 sine,
                 versine };
    }

    /// Sine and cosine of phi = phi_1 - psi.
    std::pair<Float, Float> sincos(const Terms &at) const {
        Float cosine = 1.f - at.versine;
        return { dr::fmadd(sin_1, cosine, cos_1 * at.sine),
                 dr::fmsub(sin_1, at.sine, cos_1 * cosine) };
    }

    /**
     * The terms at the psi where h(psi) = share * mass, for a share in [0, 1].
     *
     * The guess is within 3 % of psi, and a step of Householder's method with three derivatives
     * leaves a third of the fourth power of that, less than the rounding of single precision.
     */
    Terms solve(const Float &share) const {
        const Azimuth fixed = detached();
        Float wanted = share * mass, target = dr::detach(wanted),
              start     = bounded ? fixed.guess_within(dr::detach(share)) : fixed.guess(target),
              sine_half = sin(.5f * start), cosine_half = cos(.5f * start);
        Terms at =
            fixed.assemble(start, 2.f * sine_half * cosine_half, 2.f * dr::square(sine_half));
        Float step = fixed.step(at, target);
        // Derivative of the solution by the implicit function theorem: 0 - d(miss) / h'(psi)
        if constexpr (dr::is_diff_v<Float>) {
            if (dr::grad_enabled(wanted, slope_0, a, e)) {
                Float slope = dr::maximum(fixed.moved(at, step).slope, 1e-6f);
                step -= dr::replace_grad(Float(0.f), (moved(at, step).value - wanted) / slope);
            }
        }
        return moved(at, step);
    }

private:
    Azimuth() = default;

    /// psi with h(psi) = target to 1.7 %: the limits slope_0 psi, e psi^2 / 2 and a psi^3 / 6 of h,
    /// added as cubes, times minimax fits over the share of the first two (one of which is 0) and
    /// psi^2.
    Float guess(const Float &target) const {
        Float root = dr::sqrt(.5f * target * e),
              cube = dr::fmadd(
                  slope_0, dr::square(slope_0),
                  dr::fmadd(root, dr::square(root), a * dr::square(target) * (1.f / 6.f))),
              // minus a third of the exponent and of the mantissa below it, and a step of Newton
            third = dr::reinterpret_array<Float>(
                0x54a2fa8cu - dr::mul_hi(dr::reinterpret_array<UInt32>(dr::maximum(cube, 1e-30f)),
                                         UInt32(0x55555556u)));
        third *= dr::fnmadd((1.f / 3.f) * cube * third, dr::square(third), 4.f / 3.f);
        Float v = (slope_0 + root) * third, psi = target * third;
        Mask past = e > 0.f;
        auto fit  = [&](size_t k) {
            const auto &fits = sgtd::host::AzimuthFits;
            return dr::select(past, Float(fits[1][k]), Float(fits[0][k]));
        };
        Float by_share = dr::fmadd(fit(2), v, fit(1)), by_angle = dr::fmadd(fit(5), v, fit(4));
        by_share = dr::fmadd(v * (1.f - v), dr::fmadd(by_share, v, fit(0)), 1.f);
        by_angle = dr::fmadd(dr::square(psi), dr::fmadd(by_angle, v, fit(3)), 1.f);
        return psi * by_share * by_angle;
    }

    /// psi with h(psi) = share * mass to 3 %, where phi ends at phi_2: over g = psi / sqrt(1 + q
    /// psi^2), h is close to the monotone rational-quadratic function with its values and slopes at
    /// both ends, which has a closed-form inverse. q is a fit over c in units of c + b.
    Float guess_within(const Float &share) const {
        const auto &steep = sgtd::host::AzimuthSteepFit;
        const auto &flat  = sgtd::host::AzimuthFlatFit;
        Float c = slope_0 + a, rest = 1.f - c,
              q      = dr::select(c > sgtd::host::AzimuthSteep,
                                  dr::fmadd(rest, dr::fmadd(rest, steep[2], steep[1]), steep[0]),
                                  dr::fmadd(c, flat[1], flat[0])),
              spread = dr::fmadd(q * phi_1, phi_1, 1.f), inv_root = dr::rsqrt(spread),
              end = phi_1 * inv_root, unit = end * dr::rcp(mass), d0 = slope_0 * unit,
              d1 = unit * dr::square(spread) * inv_root, k = d0 + d1 - 2.f,
              b    = dr::fnmadd(share, k, d0),
              root = dr::sqrt(dr::maximum(dr::fmadd(b, b, 4.f * share * (1.f - b)), 1e-30f)),
              g    = end * dr::minimum(2.f * share / dr::maximum(b + root, 1e-30f), 1.f);
        return g * dr::rsqrt(dr::fnmadd(q * g, g, 1.f));
    }

    /// One step towards h(psi) = target.
    Float step(const Terms &at, const Float &target) const {
        Float miss = target - at.value, bend = miss * at.curvature, square = dr::square(at.slope),
              divisor =
                  dr::fmadd(dr::square(miss), at.third * (1.f / 6.f), at.slope * (square + bend));
        return miss * dr::fmadd(.5f, bend, square) / dr::maximum(divisor, 1e-30f);
    }

    /// The terms a step away, by a rotation: exact to 2e-8 for steps below 0.06.
    Terms moved(const Terms &at, const Float &step) const {
        Float square       = dr::square(step),
              step_versine = square * dr::fnmadd(square, 1.f / 24.f, .5f),
              step_sine = dr::fnmadd(step * square, 1.f / 6.f, step), cosine = 1.f - at.versine;
        return assemble(at.psi + step,
                        at.sine + dr::fmsub(cosine, step_sine, at.sine * step_versine),
                        at.versine + dr::fmadd(at.sine, step_sine, cosine * step_versine));
    }

    /// Minimax polynomials on [0, 1], and [0, 1.6] for sine and cosine: the functions of Dr.Jit are
    /// for arguments of any size, and longer.
    static Float atan(const Float &x) {
        return x * dr::estrin(dr::square(x), 1.f, -.333330721f, .199926198f, -.142036453f,
                              .106409349f, -.0750429556f, .0426915288f, -.0160686318f,
                              .00284988992f);
    }
    /// asin(sqrt(x)) / sqrt(x) on [0, 1/2]
    static Float arc_sine(const Float &x) {
        return dr::estrin(x, 1.00000009f, 0.166649005f, 0.075538159f, 0.0385999597f, 0.0617493668f,
                          -0.0564740372f, 0.101885297f);
    }
    static Float sin(const Float &x) {
        return x * dr::estrin(dr::square(x), 1.f, -.166666567f, .00833301619f, -.000198064721f,
                              2.59931085e-6f);
    }
    static Float cos(const Float &x) {
        return dr::estrin(dr::square(x), 1.f, -.5f, .0416666307f, -.00138882955f, 2.47568096e-5f,
                          -2.59922928e-7f);
    }

    Azimuth detached() const {
        Azimuth result;
        result.slope_0 = dr::detach(slope_0);
        result.a       = dr::detach(a);
        result.e       = dr::detach(e);
        result.phi_1   = dr::detach(phi_1);
        result.mass    = dr::detach(mass);
        return result;
    }
};

NAMESPACE_END(mitsuba)

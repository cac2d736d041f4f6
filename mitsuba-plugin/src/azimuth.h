#pragma once

#include <mitsuba/core/fwd.h>

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
 */
template <typename Float> struct Azimuth {
    using Mask   = dr::mask_t<Float>;
    using UInt32 = dr::uint32_array_t<Float>;

    /// 1 / (c + b); the constants of h; phi_1, its sine and minus its cosine; h at psi = phi_1
    Float inv_sum, slope_0, a, e, phi_1, sin_1, cos_1, mass;

    Azimuth(const Float &c, const Float &b) {
        inv_sum   = dr::rcp(dr::maximum(c + b, 1e-18f));
        slope_0   = dr::maximum(c - b, 0.f) * inv_sum;
        a         = dr::maximum(dr::minimum(b, c), 0.f) * inv_sum;
        Float e2  = (b - c) * inv_sum;
        Mask past = e2 > 1e-12f;
        // e^2 as it is would give an infinite derivative at b = c
        e     = dr::select(past, dr::sqrt(dr::maximum(e2, 1e-12f)), 0.f);
        phi_1 = dr::Pi<Float> - dr::select(past, dr::atan2(e, dr::maximum(a, 1e-18f)), 0.f);
        // (a, e) has the length b / (c + b) there
        Float inv_b = dr::rcp(dr::maximum(b * inv_sum, 1e-18f));
        sin_1       = e * inv_b;
        cos_1       = dr::select(past, a * inv_b, 1.f);
        mass        = dr::fmadd(c * inv_sum, phi_1, e);
    }

    /// h and its first two derivatives.
    struct Terms {
        Float psi, value, slope, curvature, sine, versine;
    };

    Terms terms(const Float &psi) const {
        auto [sin_half, cos_half] = dr::sincos(.5f * psi);
        return assemble(psi, 2.f * sin_half * cos_half, 2.f * dr::square(sin_half));
    }

    /// The terms to 2e-4, which is less than a step of Halley's method leaves at the start.
    Terms rough_terms(const Float &psi) const {
        Float x = .5f * psi, x2 = dr::square(x),
              sine =
                  x * dr::fnmadd(
                          x2, dr::fnmadd(x2, dr::fnmadd(x2, 1.f / 5040.f, 1.f / 120.f), 1.f / 6.f),
                          1.f),
              cosine = dr::fnmadd(
                  x2,
                  dr::fnmadd(x2,
                             dr::fnmadd(x2, dr::fnmadd(x2, 1.f / 40320.f, 1.f / 720.f), 1.f / 24.f),
                             .5f),
                  1.f);
        return assemble(psi, 2.f * sine * cosine, 2.f * dr::square(sine));
    }

    /// The terms a small step from `at`, by a rotation: exact to 2e-8 for steps below 0.02.
    Terms moved(const Terms &at, const Float &psi) const {
        Float step = psi - at.psi, square = dr::square(step), step_versine = .5f * square,
              step_sine = dr::fnmadd(step * square, 1.f / 6.f, step), cosine = 1.f - at.versine;
        return assemble(psi, at.sine + dr::fmsub(cosine, step_sine, at.sine * step_versine),
                        at.versine + dr::fmadd(at.sine, step_sine, cosine * step_versine));
    }

    Terms assemble(const Float &psi, const Float &sine, const Float &versine) const {
        Float p2 = dr::square(psi);
        // psi - sin(psi) has four digits left at psi = 0.03, the series seven up to psi = 1
        Float series = dr::fnmadd(p2, 1.f / 5040.f - p2 * (1.f / 362880.f), 1.f / 120.f);
        series       = psi * p2 * dr::fnmadd(p2, series, 1.f / 6.f);
        Float lag    = dr::select(psi < 1.f, series, psi - sine);
        return { psi,
                 dr::fmadd(slope_0, psi, dr::fmadd(a, lag, e * versine)),
                 dr::fmadd(a, versine, dr::fmadd(e, sine, slope_0)),
                 dr::fmadd(a, sine, e * (1.f - versine)),
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
     * The guess has the limits slope_0 psi, e psi^2 / 2 and a psi^3 / 6 of h and is off by at most
     * 22 % of psi. One step of Halley's method leaves 0.3 %, two leave the rounding of single
     * precision (4e-7 of psi, over a grid of b/(b + c) and share).
     */
    Terms solve(const Float &share) const {
        const Azimuth fixed = detached();
        Float wanted = share * mass, target = dr::detach(wanted), root = .5f * target * fixed.e;
        Float cube =
            dr::fmadd(fixed.slope_0, dr::square(fixed.slope_0),
                      dr::fmadd(root, dr::sqrt(root), fixed.a * dr::square(target) * (1.f / 6.f)));
        // Its inverse cube root to 4 %: a third of the exponent and of the mantissa below it
        Float root_3 = dr::reinterpret_array<Float>(
            0x54a2fa8cu - dr::mul_hi(dr::reinterpret_array<UInt32>(dr::maximum(cube, 1e-30f)),
                                     UInt32(0x55555556u)));
        Terms first  = fixed.rough_terms(dr::minimum(target * root_3, fixed.phi_1)),
              second = fixed.terms(fixed.halley(first, target));
        Float psi    = fixed.halley(second, target);
        // Derivative of the solution by the implicit function theorem: 0 - d(miss) / h'(psi)
        if constexpr (dr::is_diff_v<Float>) {
            if (dr::grad_enabled(wanted, slope_0, a, e)) {
                Float slope = dr::maximum(fixed.moved(second, psi).slope, 1e-6f);
                psi -= dr::replace_grad(Float(0.f), (moved(second, psi).value - wanted) / slope);
            }
        }
        return moved(second, psi);
    }

private:
    Azimuth() = default;

    /// One step towards h(psi) = target.
    Float halley(const Terms &at, const Float &target) const {
        Float miss = at.value - target,
              bend = dr::fmsub(at.slope, at.slope, .5f * miss * at.curvature);
        return dr::clip(at.psi - miss * at.slope / dr::maximum(bend, 1e-30f), 0.f, phi_1);
    }

    Azimuth detached() const {
        Azimuth result;
        result.slope_0 = dr::detach(slope_0);
        result.a       = dr::detach(a);
        result.e       = dr::detach(e);
        result.phi_1   = dr::detach(phi_1);
        return result;
    }
};

NAMESPACE_END(mitsuba)

#pragma once

#include <mitsuba/core/fwd.h>

NAMESPACE_BEGIN(mitsuba)

/// Stirling's series of ln Gamma(x) - ((x - 1/2) ln x - x + ln(2 pi)/2); the first term that it
/// leaves out is 1/(1680 x^7), and x >= 3.
template <typename Float> Float stirling_rest(const Float &x) {
    Float r = dr::rcp(x), r2 = dr::square(r);
    return r * dr::fmadd(r2, dr::fmadd(r2, 1.f / 1260.f, -1.f / 360.f), 1.f / 12.f);
}

/**
 * Masking and shadowing of a transmission where both are correlated by the height of the facet,
 * from g_i = G1(omega_i) and g_o = G1(omega_o) on either side.
 *
 * A facet that a share v of the surface lies below is seen from above with the probability
 * v^Lambda_i, and from below with (1 - v)^Lambda_o (Smith's model). The mean over all heights is
 *
 *     G2 = B(1 + Lambda_i, 1 + Lambda_o) = B(1/g_i, 1/g_o)
 *
 * where a reflection, seen twice from above, has 1/(1 + Lambda_i + Lambda_o). Heitz et al. 2016,
 * Multiple-Scattering Microfacet BSDFs with the Smith Model. G1 below 1e-9 counts as 0.
 */
template <typename Float> Float correlated_transmission(const Float &g_i, const Float &g_o) {
    Float x = dr::rcp(dr::maximum(g_i, 1e-9f)), y = dr::rcp(dr::maximum(g_o, 1e-9f));
    // B is symmetric; y is the lesser from here on
    Float greater = dr::maximum(x, y);
    y             = dr::minimum(x, y);
    x             = greater;

    // B(x, y) = B(x + 2, y + 2) times these ratios; there Stirling's series is accurate
    Float s      = x + y,
          ratios = (s / x) * ((s + 1.f) / (x + 1.f)) * ((s + 2.f) / y) * ((s + 3.f) / (y + 1.f));
    x += 2.f;
    y += 2.f;
    s += 4.f;

    // ln(x/s) = ln(1 - share) = -2 artanh(share / (2 - share)), whose argument is at most 1/3:
    // x ln(x/s) with a rounded quotient would lose all digits of a great x
    Float share = y / s, t = share / (2.f - share), t2 = dr::square(t),
          odd   = dr::fmadd(t2, dr::fmadd(t2, 1.f / 11.f, 1.f / 9.f), 1.f / 7.f),
          log_x = -2.f * t * dr::fmadd(t2, dr::fmadd(t2, dr::fmadd(t2, odd, .2f), 1.f / 3.f), 1.f);
    Float exponent = dr::fmadd(x - .5f, log_x, (y - .5f) * dr::log(share)) + stirling_rest(x) +
                     stirling_rest(y) - stirling_rest(s);
    // sqrt(2 pi / s) is what is left of Stirling's formula
    Float result = ratios * dr::exp(exponent) * dr::sqrt(dr::TwoPi<Float> / s);
    return dr::select(g_i > 1e-9f && g_o > 1e-9f, result, 0.f);
}

NAMESPACE_END(mitsuba)

//! The kernel of Smith's masking: how much of a slope beyond q stands in the way.

use std::f64::consts::FRAC_PI_2;

/// `√(ρ²−q²) − q acos(q/ρ)` and `acos(q/ρ)`, with `past = ρ − q`.
///
/// With t = tan ψ = √(ρ²−q²)/q the bracket is q (t − atan t), which cancels for small t: at t = 0.01 four digits are
/// lost, so its series is used below a quarter.
pub(crate) fn bracket(q: f64, rho: f64, past: f64) -> (f64, f64) {
    let height = (past * (rho + q)).sqrt();
    let angle = height.atan2(q);
    if height < 0.25 * q {
        let t = height / q;
        let w = t * t;
        let series = (0..12).rev().fold(0.0, |sum, k| 1.0 / f64::from(2 * k + 3) - w * sum);
        (height * w * series, angle)
    } else {
        (height - q * angle, angle)
    }
}

/// Terms of the kernels' series in (q/ρ)²; they are used for q < ρ/2, where the first one left out is 2e-16.
const TERMS: usize = 24;

/// The kernels far from their start, as powers of `ratio = q/ρ₀`: with x = q/ρ,
/// `w/ρ² = √(1−x²) − x acos x = 1 − πx/2 + Σ a_k x^(2k+2)/(2k+2)` and `v/ρ = acos x = π/2 − Σ a_k x^(2k+1)`; and their derivatives by ρ,
/// `w′/ρ = w/ρ² + √(1−x²)` and `v′ = v/ρ + x/√(1−x²)`.
///
/// `term` gets j, `ratio^j` and the coefficients of w, w′, v and v′.
pub(crate) fn far_series(ratio: f64, mut term: impl FnMut(usize, f64, [f64; 4])) {
    term(0, 1.0, [1.0, 2.0, FRAC_PI_2, FRAC_PI_2]);
    term(1, ratio, [-FRAC_PI_2, -FRAC_PI_2, 0.0, 0.0]);
    let (mut binomial, mut power) = (1.0, ratio);
    for k in 0..TERMS {
        let k2 = 2.0 * k as f64;
        let a = binomial / (k2 + 1.0);
        term(2 * k + 1, power, [0.0, 0.0, -a, binomial - a]);
        // √(1−x²) = 1 − Σ binomial_(k) x^(2k+2)/(2k+2)
        let w = a / (k2 + 2.0);
        term(2 * k + 2, power * ratio, [w, w - binomial / (k2 + 2.0), 0.0, 0.0]);
        binomial *= (k2 + 1.0) / (k2 + 2.0);
        power *= ratio * ratio;
    }
}

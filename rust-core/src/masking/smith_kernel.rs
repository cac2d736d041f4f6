//! The kernel of Smith's masking: how much of a slope beyond q stands in the way.

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

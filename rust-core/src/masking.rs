//! Smith masking of any radial profile.
//!
//! `H(q) = (2A/π) ∫_q^∞ f(ρ) ρ [√(ρ²−q²) − q acos(q/ρ)] dρ`, `S(q) = −H′(q) = (2A/π) ∫_q^∞ f(ρ) ρ acos(q/ρ) dρ`,
//! `Λ = H(a)/a`, `a = 1/(tan θ √(σx² cos²φ + σy² sin²φ))`, `G1 = a/(a + H(a))`.
//!
//! The double integral of Ribardière et al. 2019, Eq. 10, reduced to a single one.

use crate::profile::{Profile, Tail};
use crate::quadrature::{gauss, tanh_sinh};
use std::f64::consts::FRAC_2_PI;

/// `H(q)` and `S(q)` of one profile at one argument.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Masking {
    /// H(q), the expected height above a plane of slope q; Λ = H/q.
    pub h: f64,
    /// S(q) = −H′(q), the share of directional slopes above q.
    pub s: f64,
}

/// Points of the Gauss rule on smooth panels: at depth steps of e^8, 20 points leave 1e-14.
const SMOOTH_POINTS: usize = 24;

/// `H(q)` and `S(q)` by quadrature, q ≥ 0; relative error below 1e-12.
///
/// Panels end at the profile's break points. The first one starts at the bracket's zero, `(ρ−q)^(3/2)`, and panels at a
/// cusp start with a broken power: both get the tanh-sinh rule, all others a Gauss rule in ρ or ln ρ. What lies
/// beyond the last break point of a power tail is added in closed form.
pub fn masking(profile: &dyn Profile, q: f64) -> Masking {
    let breaks = profile.breaks(q);
    let cusps = profile.cusps();
    let (mut h, mut s) = (0.0, 0.0);
    // `past` = ρ − q without cancellation
    let mut add = |rho: f64, past: f64, weight: f64| {
        let mass = weight * profile.f(rho) * rho;
        let (bracket, angle) = bracket(q, rho, past);
        h += mass * bracket;
        s += mass * angle;
    };
    let mut left = q;
    for (index, &right) in breaks.iter().enumerate() {
        let width = right - left;
        let cusp = cusps.iter().any(|&c| c == left || c == right);
        if index == 0 || cusp {
            for &(from_left, from_right, weight) in tanh_sinh() {
                let rho = if from_left < 0.5 { left + from_left * width } else { right - from_right * width };
                let past = if index == 0 { from_left * width } else { rho - q };
                add(rho, past, weight * width);
            }
        } else if right > 2.0 * left {
            let log = (right / left).ln();
            for &(t, weight) in gauss(SMOOTH_POINTS).nodes() {
                let rho = left * (t * log).exp();
                add(rho, rho - q, weight * log * rho);
            }
        } else {
            for &(t, weight) in gauss(SMOOTH_POINTS).nodes() {
                let rho = left + t * width;
                add(rho, rho - q, weight * width);
            }
        }
        left = right;
    }
    if let Tail::Power { excess } = profile.tail() {
        // ∫_R^∞ f(R) (ρ/R)^(−3−e) ρ [ρ − πq/2 + q²/(2ρ)] dρ, and with acos(q/ρ) = π/2 − q/ρ
        let mass = profile.f(left) * left;
        if mass > 0.0 {
            let w = q / left;
            let half_pi = std::f64::consts::FRAC_PI_2;
            let (i0, i1, i2) = (1.0 / excess, 1.0 / (1.0 + excess), 1.0 / (2.0 + excess));
            h += mass * left * left * (i0 - half_pi * w * i1 + 0.5 * w * w * i2);
            s += mass * left * (half_pi * i1 - w * i2);
        }
    }
    let factor = profile.normalization() * FRAC_2_PI;
    Masking { h: factor * h, s: factor * s }
}

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

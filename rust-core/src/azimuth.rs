//! The azimuth of a visible slope, given its radius: a Kepler equation.
//!
//! At stretched slope ρ the azimuth φ towards the view has density ∝ max(0, c + ρ s cos φ). With
//! κ = ρs/(c + ρs) its cumulative function is `(1−κ) φ + κ sin φ` on [0, φ₁], φ₁ = acos(−c/(ρs)), or π where ρs ≤ c.

use std::f64::consts::PI;

/// Steps of the iteration; convergence to the last bit takes at most 8 over a grid of κ and v (test `azimuth`).
const CAP: usize = 40;

/// A stretched view and a slope radius.
#[derive(Debug, Clone, Copy)]
pub struct Azimuth {
    kappa: f64,
    /// φ₁
    limit: f64,
    /// `∫ max(0, c + ρ s cos φ) dφ` over the circle
    pub mass: f64,
}

impl Azimuth {
    /// For cosine c and sine s of the stretched view, and slope ρ.
    pub fn new(cos: f64, sin: f64, rho: f64) -> Self {
        let across = rho * sin;
        let sum = cos + across;
        let kappa = if sum > 0.0 { across / sum } else { 0.0 };
        let mut limit = PI;
        let mut mass = 2.0 * PI * cos;
        if across > cos {
            let past = across - cos;
            let (height, angle) = crate::masking::bracket(cos, across, past);
            limit = PI - angle;
            mass += 2.0 * height;
        }
        Self { kappa, limit, mass }
    }

    /// φ in (−π, π] from u in [0, 1].
    pub fn sample(&self, u: f64) -> f64 {
        let share = (2.0 * u - 1.0).abs();
        let phi = self.solve(share);
        if u < 0.5 { -phi } else { phi }
    }

    /// Solves `(1−κ) φ + κ sin φ = share · M`, M the value at φ₁.
    ///
    /// The left side is concave and rising: Newton's steps from the left of the root stay there and cannot fail.
    fn solve(&self, share: f64) -> f64 {
        let value = |phi: f64| (1.0 - self.kappa) * phi + self.kappa * phi.sin();
        let target = share * value(self.limit);
        // the tangent at 0 has slope 1 and lies above the curve
        let mut phi = target.min(self.limit);
        for _ in 0..CAP {
            let slope = 1.0 - self.kappa + self.kappa * phi.cos();
            let step = (target - value(phi)) / slope;
            if !(step > 1e-16 * phi) {
                break;
            }
            phi = (phi + step).min(self.limit);
        }
        phi
    }
}

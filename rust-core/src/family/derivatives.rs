//! Derivatives of the family's profile by 1/γ, p, λ and m.
//!
//! With `κ = 1/(γ−1)`, `z = κu`, `u = r^(2p)`: `ln f = −γ ln(1+z)`, so
//!
//! `∂ ln f/∂(1/γ) = (1+κ)² [u² φ(z) − u/(1+z)]`, `φ(z) = (ln(1+z) − z/(1+z))/z²`,
//! `∂ ln f/∂p = −2 (1+κ) u ln r/(1+z)`, `∂ ln f/∂ ln r = −2p (1+κ) u/(1+z)`.
//!
//! λ and m move x itself: `∂f/∂m = −f′` and `∂f/∂λ = ∓(x−m) f′/c`, integrated by parts.

use crate::family::skewed_t::SkewedT;
use crate::profile::derivatives::{Derivatives, PARAMETERS, Term};

/// Below this the closed form of φ cancels by more than its series, of eight terms, is off.
const SMALL: f64 = 0.02;
/// Beyond this u is about to overflow, and f has long become a power.
const LARGEST: f64 = 1e250;

/// What all four derivatives are made of.
struct At {
    /// r, and 1/c with the sign of x − m
    radius: f64,
    signed_inverse: f64,
    /// (1+κ) u/(1+z)
    drop: f64,
    by_inverse_gamma: f64,
}

impl SkewedT {
    fn derivatives_at(&self, distance: f64) -> At {
        let shape = self.shape();
        let outer = distance > 0.0;
        let width = if outer { 1.0 + shape.lambda() } else { 1.0 - shape.lambda() };
        let radius = distance.abs() / width;
        let u = radius.powf(2.0 * shape.p()).min(LARGEST);
        // 0 for γ = ∞
        let kappa = 1.0 / (shape.gamma() - 1.0);
        let (z, more) = (kappa * u, 1.0 + kappa);
        let shrunk = u / (1.0 + z);
        let square = if z < SMALL {
            // Σ (−z)^k (k+1)/(k+2)
            u * u * (0..8).rev().fold(0.0, |sum, k| f64::from(k + 1) / f64::from(k + 2) - z * sum)
        } else {
            (z.ln_1p() - z / (1.0 + z)) / (kappa * kappa)
        };
        At {
            radius,
            signed_inverse: if outer { 1.0 / width } else { -1.0 / width },
            drop: more * shrunk,
            by_inverse_gamma: more * more * (square - shrunk),
        }
    }

    /// `∂ ln f/∂p`.
    fn by_p(at: &At) -> f64 {
        if at.radius > 0.0 { -2.0 * at.drop * at.radius.ln() } else { 0.0 }
    }
}

impl Derivatives for SkewedT {
    fn terms(&self, from: f64, past: f64) -> [Term; PARAMETERS] {
        let distance = (from - self.shape().shift()) + past;
        let at = self.derivatives_at(distance);
        [
            Term { alpha: at.by_inverse_gamma, beta: 0.0 },
            Term { alpha: Self::by_p(&at), beta: 0.0 },
            Term { alpha: at.signed_inverse, beta: at.signed_inverse * distance },
            Term { alpha: 0.0, beta: 1.0 },
        ]
    }

    fn log_f(&self, x: f64) -> [f64; PARAMETERS] {
        let at = self.derivatives_at(x - self.shape().shift());
        if at.radius == 0.0 {
            return [0.0; PARAMETERS];
        }
        let by_log_radius = -2.0 * self.shape().p() * at.drop;
        // ∂ ln r/∂λ = ∓1/c and ∂ ln r/∂m = ∓1/(c r), upper signs outside
        let shrink = -at.signed_inverse;
        [at.by_inverse_gamma, Self::by_p(&at), by_log_radius * shrink, by_log_radius * shrink / at.radius]
    }

    fn excess(&self) -> [f64; PARAMETERS] {
        let shape = self.shape();
        if shape.gamma().is_infinite() {
            return [0.0; PARAMETERS];
        }
        [-2.0 * shape.p() * shape.gamma() * shape.gamma(), 2.0 * shape.gamma(), 0.0, 0.0]
    }
}

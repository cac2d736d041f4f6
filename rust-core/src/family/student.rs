//! Masking of Student's distribution (p = 1, λ = 0, m = 0) in closed form, with Beckmann as γ → ∞ and GGX at γ = 2.
//!
//! The slopes along one direction have the density `P₂(q) ∝ (1 + q²/(γ−1))^(½−γ)`, which is again a profile of the family:
//! with `γ′ = γ − ½` and `r = κ q`, `κ² = (γ′−1)/(γ−1)`, it is `κ g(r)/(2 J₁(∞))`, where g and its moments J are those of a [`Side`]
//! with γ′ and p = 1. Integrating it once and twice from q on,
//!
//! `S(q) = J₁ᶜ(r)/(2 J₁(∞))`, `H(q) = [½ (1 + r²/(γ′−1)) g(r) − r J₁ᶜ(r)] / (2 κ J₁(∞))`, `J₁ᶜ(r) = J₁(∞) − J₁(r)`.
//!
//! Λ = H/q then is `K (γ−1+q²)^(3/2−γ)/((2γ−3) q) − ½ I_y(γ−1, ½)` with `y = (γ−1)/(γ−1+q²)`, and
//! `e^(−q²)/(2q√π) − ½ erfc(q)` for Beckmann.

use crate::family::partial_moment::{Radius, Side};
use crate::family::shape::Shape;
use crate::profile::Masking;

/// The constants of one γ.
#[derive(Debug, Clone, Copy)]
pub struct StudentMasking {
    side: Side,
    /// 1/(γ′−1)
    inverse_less: f64,
    /// κ
    scale: f64,
    /// 1/(2 J₁(∞))
    factor: f64,
}

/// How much greater than H its first term may be. The terms have a relative error of up to 6e-14 apart from that of g, which they
/// share, and H so many times as much: 1e-12 at 16. The greatest ratio is 2γ − 2 for a power tail, so quadrature takes over
/// only where γ > 9, and then at 2q² ≈ 16, where Λ is 1e-5. A lower limit costs time there, a higher one digits.
const LARGEST_CANCELLATION: f64 = 16.0;

impl StudentMasking {
    /// The closed form for a shape, if it has one.
    pub fn new(shape: &Shape) -> Option<Self> {
        if shape.p() != 1.0 || shape.lambda() != 0.0 || shape.shift() != 0.0 {
            return None;
        }
        // exact for every γ above 3/2
        let gamma = shape.gamma() - 0.5;
        let side = Side::new(gamma, 1.0);
        let scale = if gamma.is_finite() { ((gamma - 1.0) / (shape.gamma() - 1.0)).sqrt() } else { 1.0 };
        Some(Self { side, inverse_less: 1.0 / (gamma - 1.0), scale, factor: 0.5 / side.total(1) })
    }

    /// H and S at q ≥ 0 to 1e-12; `None` where the difference would not hold that (test `closed_form_of_masking_is_exact`).
    pub fn at(&self, q: f64) -> Option<Masking> {
        let r = self.scale * q;
        let (g, above) = (self.side.kernel(Radius::exact(r)), self.side.upper(1, Radius::exact(r)));
        let (first, second) = (0.5 * (r * r).mul_add(self.inverse_less, 1.0) * g, r * above);
        let difference = first - second;
        (first <= LARGEST_CANCELLATION * difference)
            .then(|| Masking { h: difference * self.factor / self.scale, s: above * self.factor })
    }
}

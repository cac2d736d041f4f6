//! A rough interface between two media, lit from one side: what one meeting with it reflects and what it transmits, by quadrature.
//!
//! With F the reflectance of a facet and G the share of what leaves it that nothing hides,
//!
//! ```text
//! R(ω_i) = ⟨F G(ω_o)⟩          ω_o reflected
//! T(ω_i) = ⟨(1 − F) G(ω_t)⟩    ω_t refracted, G of the other side
//! ```
//!
//! averaged over the visible facets. R + T ≤ 1: the rest meets a second facet. As `cos θ_i (1 − F) D G` is the same for a path and for its reverse but
//! for η², the average of T from below is that from above by η² (`⟨T⟩ = 2 ∫ T μ dμ`).

use super::albedo::{Incidence, Place, SingleScattering};
use super::fresnel::dielectric;
use crate::ndf::Shadowing;
use crate::numerics::quadrature::gauss;

impl SingleScattering<'_> {
    /// T of an interface whose relative index is `eta`, that of the far side over that of the view's.
    pub fn transmittance(&self, view: Incidence, eta: f64) -> f64 {
        self.over_azimuths(view, |place, azimuth| self.transmitted_along(&view, place, azimuth, eta))
    }

    /// `∫ ρ f (a + ρ x)⁺ (1 − F) G dρ` along one azimuth.
    fn transmitted_along(&self, view: &Incidence, place: &Place, (x, y): (f64, f64), eta: f64) -> f64 {
        let &Place { sin, cos, a, .. } = place;
        let (slope_x, slope_y) = (view.along * x, view.shear * x + view.across * y);
        let seen_from = if a > 0.0 { place.masked / a } else { f64::INFINITY };
        let ln_gamma = libm::lgamma(2.0 + seen_from);
        // the facet with slopes (sx, sy) by its normal times `length`
        let leaves = |(sx, sy, sz): (f64, f64, f64), length: f64| {
            let cosine = ((sz * cos + sin * sx) / length).min(1.0);
            if !(cosine > 0.0) {
                return 0.0;
            }
            let (reflected, beyond) = dielectric(cosine, eta);
            // the refracted direction, turned upwards: ω_i/η + (cos_t − cos_i/η) m
            let along = (beyond - cosine / eta) / length;
            let (tx, ty, tz) = (sin / eta + along * sx, along * sy, cos / eta + along * sz);
            if !(tz > 0.0 && reflected < 1.0) {
                return 0.0;
            }
            let (tx, ty) = (view.along * tx + view.shear * ty, view.across * ty);
            let across = tx.hypot(ty);
            let lambda = across * self.ndf.lambda_table().h(tz / across.max(1e-300)) / tz;
            let seen = match self.shadowing {
                Shadowing::Separable => 1.0 / (1.0 + lambda),
                // seen from the view already
                Shadowing::HeightCorrelated => correlated(seen_from, ln_gamma, lambda),
            };
            (1.0 - reflected) * seen
        };
        let at = |rho: f64| {
            let (sx, sy) = (rho * slope_x, rho * slope_y);
            (a + rho * x).max(0.0) * leaves((sx, sy, 1.0), (1.0 + sx * sx + sy * sy).sqrt())
        };
        let front = if x < 0.0 { a / -x } else { f64::INFINITY };
        let count = self.rule.radial;
        let mut sum = 0.0;
        for (ends, nodes) in self.edges.windows(2).zip(self.nodes.chunks_exact(count)) {
            if ends[1] <= front {
                sum += nodes.iter().map(|&(rho, mass)| mass * at(rho)).sum::<f64>();
            } else {
                let profile = self.ndf.profile();
                return sum + gauss(count).integrate(ends[0], front, |rho| rho * profile.f_fast(rho) * at(rho));
            }
        }
        // all facets beyond stand upright
        let last = self.edges[self.edges.len() - 1];
        if last < front {
            let ([m1, m2], [f1, f2]) = (self.tails.at(last), self.tails.at(front));
            sum += (a * (m1 - f1) + x * (m2 - f2)).max(0.0) * leaves((slope_x, slope_y, 0.0), slope_x.hypot(slope_y));
        }
        sum
    }
}

/// G2/G1 of a transmission correlated by height: `(1 + Λ_i) B(1 + Λ_i, 1 + Λ_o)` (Heitz et al. 2016), which is `Γ(2 + Λ_i) Γ(1 + Λ_o)/Γ(2 + Λ_i + Λ_o)`.
fn correlated(seen_from: f64, ln_gamma: f64, leaving: f64) -> f64 {
    // B falls like Λ_i^(−1 − Λ_o): the limit at the horizon
    if !(seen_from < 1e9) {
        return if leaving < 1e-9 { 1.0 } else { 0.0 };
    }
    let ln = ln_gamma + libm::lgamma(1.0 + leaving) - libm::lgamma(2.0 + seen_from + leaving);
    ln.exp().min(1.0)
}

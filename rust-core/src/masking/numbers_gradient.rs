//! How a distribution follows the numbers that it is given by: the values of a table, or the weights and the scales of a mixture's parts.
//!
//! All derivatives are by the logarithms of these numbers, at fixed slopes: a table that grows wider in the process is not scaled back to mean
//! slope 1. What does that is a factor on the roughness, whose derivative is −[`NumbersGradient::log_mean`].
//!
//! With `F_j = A_j f_j(x/s_j)/s_j²` a mixture is `A f = Σ w_j F_j` and `H(q) = Σ w_j s_j H_j(q/s_j)`, weights being divided by their sum:
//!
//! `∂ ln(A f)/∂ ln w_j = r_j − w_j`, `∂ ln(A f)/∂ ln s_j = −r_j (2 + d ln f_j/d ln x)`, `r_j = w_j F_j/(A f)`,
//! `∂H/∂ ln w_j = w_j (s_j H_j − H)`, `∂H/∂ ln s_j = w_j (s_j H_j + q S_j)`.

use crate::masking::integral::{MaskingIntegral, Rule};
use crate::masking::values_gradient::ValuesGradient;
use crate::profile::{Masking, Part, Profile};

/// The derivatives of one table or mixture.
#[derive(Debug, Clone)]
pub struct NumbersGradient {
    source: Source,
    log_mean: Vec<f64>,
}

#[derive(Debug, Clone)]
enum Source {
    Values(ValuesGradient),
    /// masking of each part
    Parts(Vec<MaskingIntegral>),
}

/// Step in ln x of differences, where f or S of a part is all that is known of it.
const STEP: f64 = 1e-5;

impl NumbersGradient {
    /// Samples a profile; `None` for one that is neither a table nor a mixture.
    pub fn new(profile: &dyn Profile, rule: Rule) -> Option<Self> {
        if let Some(values) = ValuesGradient::new(profile, rule) {
            let log_mean = values.log_mean().to_vec();
            return Some(Self { source: Source::Values(values), log_mean });
        }
        let parts = profile.parts();
        if parts.is_empty() {
            return None;
        }
        let share = |part: &Part| part.weight * part.scale * part.profile.mean() / profile.mean();
        let by_weight = parts.iter().map(|part| share(part) - part.weight);
        let log_mean = by_weight.chain(parts.iter().map(share)).collect();
        let masking = parts.iter().map(|part| MaskingIntegral::new(part.profile.as_ref(), rule)).collect();
        Some(Self { source: Source::Parts(masking), log_mean })
    }

    /// How many numbers there are: the values of a table, or the weights of all parts, then their scales.
    pub fn count(&self) -> usize {
        self.log_mean.len()
    }

    /// `∂ ln/∂ ln` of the mean slope.
    pub fn log_mean(&self) -> &[f64] {
        &self.log_mean
    }

    /// `∂ ln(A f)/∂ ln` at x, for the profile that was sampled; 0 where f is.
    pub fn log_density(&self, profile: &dyn Profile, x: f64) -> Vec<f64> {
        if !(profile.f(x) > 0.0) {
            return vec![0.0; self.count()];
        }
        match &self.source {
            Source::Values(gradient) => {
                let mut by = gradient.log_normalization().to_vec();
                if let Some(values) = profile.values() {
                    let cell = values.cell_of(x);
                    let ([first, second], share) = (values.rows(cell), values.share(cell, x, 0.0));
                    by[first] += 1.0 - share;
                    by[second] += share;
                }
                by
            }
            Source::Parts(_) => {
                let whole = profile.normalization() * profile.f(x);
                let shares = profile.parts().iter().map(|part| {
                    let f = part.profile.normalization() * part.profile.f(x / part.scale);
                    part.weight * f / (part.scale * part.scale * whole)
                });
                let by_scale = |(part, share): (&Part, f64)| {
                    if share > 0.0 { -share * (2.0 + log_slope(part.profile.as_ref(), x / part.scale)) } else { 0.0 }
                };
                let by_weight = profile.parts().iter().zip(shares.clone()).map(|(part, share)| share - part.weight);
                by_weight.chain(profile.parts().iter().zip(shares).map(by_scale)).collect()
            }
        }
    }

    /// H and S, and `∂H/∂ ln` and `∂S/∂ ln`, at q ≥ 0, for the profile that was sampled.
    pub fn at(&self, profile: &dyn Profile, q: f64) -> (Masking, Vec<Masking>) {
        let masking = match &self.source {
            Source::Values(gradient) => return gradient.at(profile, q),
            Source::Parts(masking) => masking,
        };
        let each: Vec<(&Part, &MaskingIntegral, Masking)> = profile
            .parts()
            .iter()
            .zip(masking)
            .map(|(part, masking)| (part, masking, masking.at(part.profile.as_ref(), q / part.scale)))
            .collect();
        let h: f64 = each.iter().map(|(part, _, at)| part.weight * part.scale * at.h).sum();
        let s: f64 = each.iter().map(|(part, _, at)| part.weight * at.s).sum();
        let by_weight = each
            .iter()
            .map(|(part, _, at)| Masking { h: part.weight * (part.scale * at.h - h), s: part.weight * (at.s - s) });
        let by_scale = each.iter().map(|(part, masking, at)| {
            let s = |log: f64| masking.at(part.profile.as_ref(), q / part.scale * log.exp()).s;
            // −∂/∂q of w (s H + q S) is −w q dS/dq
            let slope = if q > 0.0 { (s(STEP) - s(-STEP)) / (2.0 * STEP) } else { 0.0 };
            Masking { h: part.weight * (part.scale * at.h + q * at.s), s: -part.weight * slope }
        });
        (Masking { h, s }, by_weight.chain(by_scale).collect())
    }
}

/// `d ln f/d ln x`; 0 next to where f ends, where there is none.
pub fn log_slope(profile: &dyn Profile, x: f64) -> f64 {
    let log = |step: f64| profile.f(x * step.exp()).ln();
    let slope = (log(STEP) - log(-STEP)) / (2.0 * STEP);
    if slope.is_finite() { slope } else { 0.0 }
}

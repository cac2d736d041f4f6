//! A weighted sum of profiles: a polished core and a haze around it, grains and the scratches between them.
//!
//! The density of slopes is `Σ w_j P_j(x/s_j)/s_j²`, so that F and 1 − F are sums, and so is masking: `H(q) = Σ w_j s_j H_j(q/s_j)`, as exact as
//! that of the parts.

use crate::error::{ParameterError, require};
use crate::numerics::invert::{self, Monotone};
use crate::profile::{Coordinate, Profile, Tail};
use std::sync::Arc;

/// One profile of a mixture.
#[derive(Clone)]
pub struct Part {
    /// Its share of all normals, as seen from above.
    pub weight: f64,
    /// Its unit of slope.
    pub scale: f64,
    /// Its shape.
    pub profile: Arc<dyn Profile>,
}

/// A sum of profiles, at mean slope 1.
#[derive(Clone)]
pub struct MixtureProfile {
    parts: Vec<Part>,
    /// `w_j A_j/s_j²` of each part, over their sum A
    heights: Vec<f64>,
    normalization: f64,
    width: f64,
    cusps: Vec<f64>,
    tail: Tail,
}

/// Most parts of a mixture.
pub const PARTS: usize = 16;
/// From where on one power of the slope outweighs another: its share of the sum.
const NEGLIGIBLE: f64 = 1e-17;

impl MixtureProfile {
    /// Mixes parts with positive weights, which need not add up to 1, and roughnesses as their scales.
    ///
    /// # Errors
    /// Names the part and its value: a weight or a scale that is not positive; none or too many of them.
    pub fn new(parts: Vec<Part>) -> Result<Self, ParameterError> {
        if !(1..=PARTS).contains(&parts.len()) {
            return Err(ParameterError::Table {
                problem: format!("of the mixture has {} rows, but must have 1 to {PARTS}", parts.len()),
                mend: "each row is a distribution with its weight",
            });
        }
        for (k, part) in parts.iter().enumerate() {
            if !(part.weight > 0.0 && part.weight < f64::INFINITY) {
                return Err(ParameterError::Row {
                    name: "weights",
                    row: k + 1,
                    value: part.weight,
                    must: "be positive",
                    mend: "leave out what has no share",
                });
            }
            require(
                (1e-6..=1e6).contains(&part.scale),
                "alpha",
                part.scale,
                "between 1e-6 and 1e6",
                "each part of a mixture has a roughness of its own",
            )?;
        }
        let total: f64 = parts.iter().map(|part| part.weight).sum();
        let width: f64 = parts.iter().map(|part| part.weight / total * part.scale * part.profile.mean()).sum();
        let parts: Vec<Part> = parts
            .into_iter()
            .map(|part| Part { weight: part.weight / total, scale: part.scale / width, ..part })
            .collect();
        let heights: Vec<f64> =
            parts.iter().map(|part| part.weight * part.profile.normalization() / (part.scale * part.scale)).collect();
        let normalization: f64 = heights.iter().sum();
        let heights = heights.iter().map(|height| height / normalization).collect();
        let mut cusps: Vec<f64> =
            parts.iter().flat_map(|part| part.profile.cusps().iter().map(|x| x * part.scale)).collect();
        cusps.sort_by(f64::total_cmp);
        cusps.dedup();
        let mut mixture = Self { parts, heights, normalization, width, cusps, tail: Tail::Exponential };
        mixture.tail = mixture.heaviest_tail();
        Ok(mixture)
    }

    /// Mean slope of the mixture as it was given: with a roughness of this the parts have the scales that were given.
    pub fn width(&self) -> f64 {
        self.width
    }

    /// The power that outlives the others.
    fn heaviest_tail(&self) -> Tail {
        let powers: Vec<(f64, f64, f64)> = self
            .parts
            .iter()
            .zip(&self.heights)
            .filter_map(|(part, height)| match part.profile.tail() {
                Tail::Power { exact_from, excess } => {
                    let from = exact_from * part.scale;
                    // logarithm of the factor in front of x^(−3−excess)
                    let at = exact_from.max(1.0);
                    let factor = height.ln() + part.profile.f(at).ln() + (3.0 + excess) * (at * part.scale).ln();
                    Some((excess, from, factor))
                }
                Tail::Exponential => None,
            })
            .collect();
        let Some(&(excess, from, factor)) = powers.iter().min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return Tail::Exponential;
        };
        let outweighs = powers.iter().filter(|other| other.0 > excess).map(|other| {
            let log = (other.2 - factor - NEGLIGIBLE.ln()) / (other.0 - excess);
            log.clamp(0.0, 700.0).exp()
        });
        let same = powers.iter().filter(|other| other.0 == excess).map(|other| other.1);
        Tail::Power { excess, exact_from: outweighs.chain(same).fold(from, f64::max) }
    }

    fn sum(&self, of: impl Fn(&Part) -> f64) -> f64 {
        self.parts.iter().map(|part| part.weight * of(part)).sum()
    }
}

impl Profile for MixtureProfile {
    fn f(&self, x: f64) -> f64 {
        self.parts.iter().zip(&self.heights).map(|(part, height)| height * part.profile.f(x / part.scale)).sum()
    }

    fn f_past(&self, from: f64, past: f64) -> f64 {
        let f = |part: &Part| part.profile.f_past(from / part.scale, past / part.scale);
        self.parts.iter().zip(&self.heights).map(|(part, height)| height * f(part)).sum()
    }

    fn f_fast(&self, x: f64) -> f64 {
        self.parts.iter().zip(&self.heights).map(|(part, height)| height * part.profile.f_fast(x / part.scale)).sum()
    }

    fn normalization(&self) -> f64 {
        self.normalization
    }

    fn cdf(&self, x: f64) -> f64 {
        self.sum(|part| part.profile.cdf(x / part.scale)).min(1.0)
    }

    fn sf(&self, x: f64) -> f64 {
        self.sum(|part| part.profile.sf(x / part.scale)).min(1.0)
    }

    fn quantile(&self, u: f64) -> f64 {
        if u > 0.5 {
            return self.isf(1.0 - u);
        }
        let density = |x: f64| 2.0 * self.normalization * x * self.f(x);
        invert::solve(&Monotone { value: &|x| self.cdf(x), rising: true, slope: &density }, u, 1.0)
    }

    fn isf(&self, u: f64) -> f64 {
        if u > 0.5 {
            return self.quantile(1.0 - u);
        }
        let density = |x: f64| -2.0 * self.normalization * x * self.f(x);
        invert::solve(&Monotone { value: &|x| self.sf(x), rising: false, slope: &density }, u, 1.0)
    }

    fn mean(&self) -> f64 {
        self.sum(|part| part.scale * part.profile.mean())
    }

    fn breaks(&self, depth: f64) -> Vec<f64> {
        let mut breaks: Vec<f64> =
            self.parts.iter().flat_map(|part| part.profile.breaks(depth).into_iter().map(|x| x * part.scale)).collect();
        breaks.sort_by(f64::total_cmp);
        breaks.dedup();
        breaks
    }

    fn cusps(&self) -> &[f64] {
        &self.cusps
    }

    fn bends_at_breaks(&self) -> bool {
        self.parts.iter().any(|part| part.profile.bends_at_breaks())
    }

    fn coordinate(&self) -> Coordinate {
        let any = self.parts.iter().any(|part| part.profile.coordinate() == Coordinate::Odds);
        if any { Coordinate::Odds } else { Coordinate::Square }
    }

    fn tail(&self) -> Tail {
        self.tail
    }

    fn parts(&self) -> &[Part] {
        &self.parts
    }
}

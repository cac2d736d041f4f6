//! Where a view and a roughness are in a table of missing energy, and back.

use super::{GREATEST_ALPHA, LEAST_ALPHA};
use crate::ndf::{Ndf, Roughness, Shadowing};
use crate::profile::Tail;
use crate::scattering::albedo::Incidence;
use glam::DVec3;

/// Where a view and a roughness are in a table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coordinates {
    /// x, the median slope.
    pub slope: f64,
    /// q, at most a half: heavy tails make E like a power of the cotangent towards the horizon.
    pub power: f64,
    /// e, at most 1: they make √(1 − E) like a power of the slope of the view along the normal.
    pub end: f64,
    /// s, at most a half: and a power of the roughness, seen from the horizon.
    pub spread: f64,
}

impl Coordinates {
    /// Those of a distribution: they depend on its median slope and on its tail.
    pub fn new(ndf: &Ndf, shadowing: Shadowing) -> Self {
        let profile = ndf.profile();
        let (power, end, spread) = match profile.tail() {
            Tail::Power { excess, .. } => {
                // correlated masking is complete at the horizon, whatever the tail: E rises from there like a power of it
                let more = if shadowing == Shadowing::Separable { 0.2 } else { 0.0 };
                (
                    (more + 0.5 * excess).clamp(0.1, 0.5),
                    (0.5 + 0.5 * excess).min(1.0),
                    (0.1 + 0.8 * excess).clamp(0.2, 0.5),
                )
            }
            Tail::Exponential => (0.5, 1.0, 0.5),
        };
        Self { slope: profile.quantile(0.5), power, end, spread }
    }

    /// v of a view with this cotangent.
    pub fn view(&self, cot: f64, along: f64) -> f64 {
        if cot.is_finite() {
            1.0 - (1.0 - (cot / (cot + self.half(along))).powf(self.power)).powf(self.end)
        } else {
            1.0
        }
    }
    /// w of a roughness, from 0 at no roughness to 1 at the greatest.
    pub fn roughness(&self, alpha: f64) -> f64 {
        (self.compressed(alpha) / self.compressed(GREATEST_ALPHA)).powf(self.spread)
    }
    /// Where the average of a roughness is in its list: its logarithm, from 0 at the least roughness to 1 at the greatest.
    pub fn log_roughness(alpha: f64) -> f64 {
        (1.0 - (alpha / GREATEST_ALPHA).ln() / (LEAST_ALPHA / GREATEST_ALPHA).ln()).clamp(0.0, 1.0)
    }
    /// w^(1/s) at the greatest roughness, before it was scaled to 1.
    pub fn greatest(&self) -> f64 {
        self.compressed(GREATEST_ALPHA)
    }
    fn compressed(&self, alpha: f64) -> f64 {
        let x = alpha * self.slope;
        x / (1.0 + x)
    }
    /// The azimuth, from 0 along the first tangent to 1 along the second; even in both components.
    pub fn azimuth(alpha: Roughness, w: DVec3) -> f64 {
        let (x, y) = (alpha.u.sqrt() * w.x.abs(), alpha.v.sqrt() * w.y.abs());
        if x + y > 0.0 { y / (x + y) } else { 0.0 }
    }

    /// c
    fn half(&self, along: f64) -> f64 {
        let x = along * self.slope;
        x / x.mul_add(x, 1.0)
    }
    pub(super) fn cotangent_at(&self, v: f64, along: f64) -> f64 {
        let ratio = (1.0 - (1.0 - v).powf(1.0 / self.end)).powf(1.0 / self.power);
        if ratio < 1.0 { self.half(along) * ratio / (1.0 - ratio) } else { f64::INFINITY }
    }
    pub(super) fn roughness_at(&self, w: f64) -> f64 {
        // not 0, where the quadrature has nothing to stretch
        self.expanded(w.powf(1.0 / self.spread).max(1e-9) * self.greatest())
    }
    pub(super) fn roughness_at_log(log: f64) -> f64 {
        GREATEST_ALPHA * (LEAST_ALPHA / GREATEST_ALPHA).powf(1.0 - log)
    }
    /// Inverse of `compressed`.
    fn expanded(&self, x: f64) -> f64 {
        x / (1.0 - x) / self.slope
    }
    /// The horizontal direction with this azimuth.
    pub(crate) fn direction_at(azimuth: f64, alpha: Roughness) -> DVec3 {
        DVec3::new((1.0 - azimuth) / alpha.u.sqrt(), azimuth / alpha.v.sqrt(), 0.0).normalize_or(DVec3::X)
    }
    pub(super) fn view_at(&self, v: f64, horizontal: Incidence) -> Incidence {
        Incidence { a: self.cotangent_at(v, horizontal.along) / horizontal.along, ..horizontal }
    }
}

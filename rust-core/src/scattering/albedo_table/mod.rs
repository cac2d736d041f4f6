//! The energy lost by single scattering, tabulated for one shape.
//!
//! What is stored is `√(1 − E)`: its square cannot leave 0 … 1 by interpolation and keeps its digits where almost nothing is lost. A view
//! enters as `v = 1 − (1 − (cot/(cot + c))^q)^e`, `c = α_∥ x/(1 + (α_∥ x)²)`: at low roughness the missing energy ends where the view is as steep
//! as the facets, at high roughness where it is as flat as the rest of the angle between them and the normal; a roughness as
//! `w = (αx/(αx + 1))^s`. x is the median slope of the shape. In these coordinates `1 − E` has a limit at every edge, and power laws of heavy
//! tails are as smooth as others.
//!
//! * **Isotropic** tables hold any roughness: bicubic Hermite polynomials over (v, w), so textures and derivatives need nothing else.
//! * **Anisotropic** tables hold one pair of roughnesses: over v and the azimuth, as value and derivatives with respect to
//!   both logarithms of the roughness, read bilinearly. (Four variables at once take 10⁵ nodes to reach 1e-3.)
//!
//! Smooth shapes have few nodes computed, at Chebyshev's points, and the grids filled from the polynomials through them. The error is then measured;
//! shapes with corners (boxes, rings) are computed at every node of a larger grid.
//!
//! The average `1 − E_avg = ∫ (1 − E) cos θ dω/π` is that of the *tabulated* E. So what a lobe made from the table returns is all that the
//! table says is lost: a furnace is off by the error of E at the view, and by no more.

mod coordinates;
mod isotropic;
mod pair;
mod refine;

pub use crate::constants::{AVERAGE, LEAST_ALPHA, PACKET};
pub use coordinates::Coordinates;

use crate::ndf::Roughness;
use crate::numerics::quadrature::gauss;
use crate::scattering::albedo::Incidence;
use glam::DVec3;
use std::f64::consts::LN_2;

/// The greatest roughness of a table: beyond, the missing energy stays what it is there, where most of the energy is lost.
pub const GREATEST_ALPHA: f64 = 8.0;

/// The missing energy of one shape.
#[derive(Debug, Clone)]
pub struct AlbedoTable {
    flat: Vec<f32>,
    /// Nodes of the grid over the view, and over roughness or azimuth.
    grid: (usize, usize),
    coordinates: Coordinates,
    /// The pair of an anisotropic table.
    fixed: Option<Fixed>,
    reached: f64,
}

/// The roughness of an anisotropic table, and its average.
#[derive(Debug, Clone, Copy)]
struct Fixed {
    alpha: Roughness,
    average: Average,
}

/// `log₂ (1 − E_avg)` at one pair of roughnesses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Average {
    /// Its value.
    pub log: f64,
    /// Its derivatives with respect to `ln α_u` and `ln α_v`.
    pub slopes: [f64; 2],
}

impl AlbedoTable {
    /// The grid over (v, w) in packets (value, derivatives per cell along v, w and both), then the logarithms of the average; or the grid over
    /// v and azimuth in packets (value, derivatives with respect to ln α_u and ln α_v, 0).
    pub fn flat(&self) -> &[f32] {
        &self.flat
    }

    /// Nodes of the grid over the view, and over roughness or azimuth.
    pub fn grid(&self) -> (usize, usize) {
        self.grid
    }

    /// Where a view and a roughness are in the table.
    pub fn coordinates(&self) -> Coordinates {
        self.coordinates
    }

    /// `log₂ (1 − E_avg)` of an anisotropic table.
    pub fn average(&self) -> Option<Average> {
        self.fixed.map(|fixed| fixed.average)
    }

    /// The greatest error of E that was measured, at places spread evenly over the table.
    pub fn reached(&self) -> f64 {
        self.reached
    }

    /// `1 − E(ω)`, ω.z ≥ 0. An anisotropic table follows a roughness beside its own to first order; an isotropic one reads α_u.
    pub fn missing_energy(&self, alpha: Roughness, w: DVec3) -> f64 {
        let along = Incidence::new(alpha, w).along;
        let v = self.coordinates.view(w.z / w.x.hypot(w.y), along);
        let root = match self.fixed {
            None => self.root(v, self.coordinates.roughness(alpha.u)),
            Some(fixed) => {
                let [value, by_u, by_v, _] = self.packet(v, Coordinates::azimuth(alpha, w));
                value + by_u * (alpha.u / fixed.alpha.u).ln() + by_v * (alpha.v / fixed.alpha.v).ln()
            }
        };
        root.clamp(0.0, 1.0).powi(2)
    }

    /// `1 − E_avg`.
    pub fn average_missing_energy(&self, alpha: Roughness) -> f64 {
        let log = match self.fixed {
            None => {
                let x = Coordinates::log_roughness(alpha.u) * (AVERAGE - 1) as f64;
                let cell = (x as usize).min(AVERAGE - 2);
                let at = |k: usize| f64::from(self.flat[self.flat.len() - AVERAGE + k]);
                at(cell) + (x - cell as f64) * (at(cell + 1) - at(cell))
            }
            Some(Fixed { alpha: own, average: Average { log, slopes } }) => {
                log + slopes[0] * (alpha.u / own.u).ln() + slopes[1] * (alpha.v / own.v).ln()
            }
        };
        (log * LN_2).exp()
    }

    /// `∫ root² d(cos² θ)`, cell by cell of v.
    fn integral(&self, cells: usize, points: usize, along: f64, root: impl Fn(f64) -> f64) -> f64 {
        let square_at = |v: f64| {
            let cot = self.coordinates.cotangent_at(v, along);
            if cot.is_finite() { cot * cot / (1.0 + cot * cot) } else { 1.0 }
        };
        let mut ends: Vec<f64> = (0..cells - 1).map(|k| square_at(k as f64 / (cells - 1) as f64)).collect();
        // the last cell begins close to the horizon for a low roughness
        while let Some(&last) = ends.last()
            && last < 1.0
        {
            let next = 9.0 * last / (1.0 - last);
            ends.push(if next < 1e4 { next / (1.0 + next) } else { 1.0 });
        }
        let sum: f64 = ends
            .windows(2)
            .map(|ends| {
                gauss(points).integrate(ends[0], ends[1], |square| {
                    let cot = (square / (1.0 - square)).sqrt();
                    root(self.coordinates.view(cot, along)).clamp(0.0, 1.0).powi(2)
                })
            })
            .sum();
        sum.max(f64::MIN_POSITIVE)
    }
}

//! The energy lost by single scattering, tabulated for one shape.
//!
//! What is stored is `√(1 − E)`: its square cannot leave 0 … 1 by interpolation and keeps its digits where almost nothing is
//! lost. A view enters as `v = 1 − (1 − (cot/(cot + c))^q)^e`, `c = α_∥ x/(1 + (α_∥ x)²)`: at low roughness losses end where the view
//! is as steep as the facets, at high roughness where it is as flat as the rest of the angle between them and the normal; a roughness as `w = (αx/(αx + 1))^s`. x is the median slope of the shape. In
//! these coordinates the loss has a limit at every edge, and power laws of heavy tails are as smooth as others.
//!
//! * **Isotropic** tables hold any roughness: bicubic Hermite polynomials over (v, w), so textures and derivatives need nothing else.
//! * **Anisotropic** tables hold one pair of roughnesses: over v and the azimuth, as value and derivatives with respect to
//!   both logarithms of the roughness, read bilinearly. (Four variables at once take 10⁵ nodes to reach 1e-3.)
//!
//! Smooth shapes have few nodes computed, at Chebyshev's points, and the grids filled from the polynomials through them. The error is then measured;
//! losses with corners (boxes, rings) are computed at every node of a larger grid.
//!
//! The average `1 − E_avg = ∫ (1 − E) cos θ dω/π` is that of the *tabulated* E. So what a lobe made from the table returns is all that the
//! table says is lost: a furnace is off by the error of E at the view, and by no more.

use crate::ndf::{Ndf, Roughness, Shadowing};
use crate::numerics::quadrature::gauss;
use crate::numerics::{greatest, hermite};
use crate::profile::Tail;
use crate::scattering::albedo::{Rule, SingleScattering, View};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::LN_2;

/// Nodes of the isotropic average.
pub const AVERAGE: usize = 512;
/// Numbers at every node of a grid.
pub const PACKET: usize = 4;

/// The least roughness of a material.
pub const LEAST_ALPHA: f64 = 1e-4;
/// The greatest roughness of a table: beyond, the losses stay what they are there, where most of the energy is lost.
pub const GREATEST_ALPHA: f64 = 8.0;
/// Efforts for isotropic tables: the next promising one is tried until the error is small enough.
const EFFORTS: [Effort; 6] = [
    Effort { grid: (32, 32), points: (16, 16), rule: Rule::TABLE, below: f64::INFINITY, enough: 4e-4 },
    Effort { grid: (32, 32), points: (24, 24), rule: Rule::TABLE, below: 1e-2, enough: 4e-4 },
    Effort { grid: (32, 32), points: (32, 32), rule: Rule::TABLE, below: 8e-4, enough: 4e-4 },
    Effort { grid: (64, 48), points: (64, 48), rule: Rule::TABLE, below: 3e-2, enough: 4e-4 },
    Effort { grid: (96, 64), points: (96, 64), rule: Rule::FINE, below: f64::INFINITY, enough: 6e-4 },
    Effort { grid: (96, 160), points: (96, 160), rule: Rule::FINE, below: f64::INFINITY, enough: 6e-4 },
];
/// The same for anisotropic tables, over v and the azimuth.
const ANISOTROPIC_EFFORTS: [Effort; 4] = [
    Effort { grid: (128, 32), points: (16, 10), rule: Rule::ANISOTROPIC, below: f64::INFINITY, enough: 6e-4 },
    Effort { grid: (192, 48), points: (32, 20), rule: Rule::ANISOTROPIC, below: 1e-2, enough: 6e-4 },
    Effort { grid: (192, 48), points: (192, 20), rule: Rule::ANISOTROPIC, below: 2e-2, enough: 6e-4 },
    Effort { grid: (192, 48), points: (192, 48), rule: Rule::PAIR, below: f64::INFINITY, enough: 6e-4 },
];
/// Places of a table at which the error is measured.
const MEASURED: usize = 121;
/// Further ones along the normal.
const MEASURED_NORMAL: usize = 60;
/// Nodes from which the average is interpolated to all of its list.
const AVERAGE_NODES: usize = 103;
/// Relative step of derivatives with respect to the roughness.
const STEP: f64 = 1e-3;

/// Nodes of a grid, and how they are computed.
#[derive(Debug, Clone, Copy)]
struct Effort {
    /// Nodes along both axes.
    grid: (usize, usize),
    /// Of which so many are computed: all of them, or Chebyshev's points if fewer.
    points: (usize, usize),
    rule: Rule,
    /// Errors of the effort before above which this one is left out: corners are hopeless for few nodes.
    below: f64,
    /// The error at which no further effort is made.
    enough: f64,
}

impl Effort {
    /// What is computed along both axes.
    fn nodes(&self) -> (Nodes, Nodes) {
        (Nodes::new(self.points.0, self.grid.0), Nodes::new(self.points.1, self.grid.1))
    }
}

/// Losses of one shape.
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
    fn new(ndf: &Ndf, shadowing: Shadowing) -> Self {
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
    fn cotangent_at(&self, v: f64, along: f64) -> f64 {
        let ratio = (1.0 - (1.0 - v).powf(1.0 / self.end)).powf(1.0 / self.power);
        if ratio < 1.0 { self.half(along) * ratio / (1.0 - ratio) } else { f64::INFINITY }
    }
    fn roughness_at(&self, w: f64) -> f64 {
        // not 0, where the quadrature has nothing to stretch
        self.expanded(w.powf(1.0 / self.spread).max(1e-9) * self.greatest())
    }
    fn roughness_at_log(log: f64) -> f64 {
        GREATEST_ALPHA * (LEAST_ALPHA / GREATEST_ALPHA).powf(1.0 - log)
    }
    /// Inverse of `compressed`.
    fn expanded(&self, x: f64) -> f64 {
        x / (1.0 - x) / self.slope
    }
    /// The horizontal direction with this azimuth.
    fn direction_at(azimuth: f64, alpha: Roughness) -> DVec3 {
        DVec3::new((1.0 - azimuth) / alpha.u.sqrt(), azimuth / alpha.v.sqrt(), 0.0).normalize_or(DVec3::X)
    }
    fn view_at(&self, v: f64, horizontal: View) -> View {
        View { a: self.cotangent_at(v, horizontal.along) / horizontal.along, ..horizontal }
    }
}

impl AlbedoTable {
    /// Tabulates a distribution for every isotropic roughness.
    pub fn isotropic(ndf: &Ndf, shadowing: Shadowing) -> Self {
        let coordinates = Coordinates::new(ndf, shadowing);
        let exact = |source: &SingleScattering<'_>, v: f64, w: f64| {
            let alpha = coordinates.roughness_at(w);
            let flat = View { a: 0.0, along: alpha, across: alpha, shear: 0.0 };
            source.loss(coordinates.view_at(v, flat)).sqrt()
        };
        // finer than the first efforts, so that the error of their rule counts as well
        let judge = SingleScattering::new(ndf, shadowing, Rule::FINE);
        let measured = Measured::new(|v, w| exact(&judge, v, w));
        let mut best = Self { flat: Vec::new(), grid: (0, 0), coordinates, fixed: None, reached: f64::INFINITY };
        for effort in EFFORTS {
            if best.reached > effort.below {
                continue;
            }
            let source = SingleScattering::new(ndf, shadowing, effort.rule);
            let (views, roughnesses) = effort.grid;
            let (nodes_v, nodes_w) = effort.nodes();
            let values: Vec<f64> = (0..effort.points.0 * effort.points.1)
                .into_par_iter()
                .map(|k| exact(&source, nodes_v.at[k / effort.points.1], nodes_w.at[k % effort.points.1]))
                .collect();
            let by_v = nodes_v.fill(&values, views);
            let slope_v = nodes_v.fill(&nodes_v.derivative(&values), views);
            let fill = |values: &[f64]| {
                let turned = turn(values, views);
                let slopes = nodes_w.derivative(&turned);
                // (w, v) → (v, w)
                [turned, slopes].map(|turned| turn(&nodes_w.fill(&turned, roughnesses), roughnesses))
            };
            let ([f, f_w], [f_v, f_vw]) = (fill(&by_v), fill(&slope_v));
            let mut table = Self { flat: Vec::with_capacity(PACKET * f.len() + AVERAGE), grid: effort.grid, ..best };
            let (cell_v, cell_w) = (1.0 / (views - 1) as f64, 1.0 / (roughnesses - 1) as f64);
            for k in 0..f.len() {
                table
                    .flat
                    .extend([f[k], f_v[k] * cell_v, f_w[k] * cell_w, f_vw[k] * cell_v * cell_w].map(|x| x as f32));
            }
            table.reached = measured.error(|v, w| table.root(v, w));
            if best.flat.is_empty() || table.reached < best.reached {
                best = table;
            }
            if best.reached <= effort.enough {
                break;
            }
        }
        let logs = Nodes::even(AVERAGE_NODES);
        let averages: Vec<f64> = logs
            .at
            .par_iter()
            .map(|&log| {
                let alpha = Coordinates::roughness_at_log(log);
                let w = coordinates.roughness(alpha);
                best.integral(best.grid.0, 4, alpha, |v| best.root(v, w)).log2()
            })
            .collect();
        let slopes = logs.derivative(&averages);
        best.flat.extend((0..AVERAGE).map(|k| {
            let (cell, t) = locate(k as f64 / (AVERAGE - 1) as f64, AVERAGE_NODES);
            let [[f0, d0], [f1, d1]] = hermite::weights(t);
            let width = 1.0 / (AVERAGE_NODES - 1) as f64;
            (f0 * averages[cell] + f1 * averages[cell + 1] + width * (d0 * slopes[cell] + d1 * slopes[cell + 1])) as f32
        }));
        best
    }

    /// Tabulates a distribution for one pair of roughnesses.
    pub fn anisotropic(ndf: &Ndf, shadowing: Shadowing, alpha: Roughness) -> Self {
        let coordinates = Coordinates::new(ndf, shadowing);
        let exact = |source: &SingleScattering<'_>, v: f64, azimuth: f64, alpha: Roughness| {
            let horizontal = View::new(alpha, Coordinates::direction_at(azimuth, alpha));
            source.loss(coordinates.view_at(v, horizontal)).sqrt()
        };
        let compute = |effort: Effort, alpha: Roughness| -> Vec<f64> {
            let source = SingleScattering::new(ndf, shadowing, effort.rule);
            let (views, azimuths) = effort.nodes();
            let (count, inner) = effort.points;
            (0..count * inner)
                .into_par_iter()
                .map(|k| exact(&source, views.at[k / inner], azimuths.at[k % inner], alpha))
                .collect()
        };
        let spread = |effort: Effort, values: &[f64], (views, azimuths): (usize, usize)| {
            let (nodes_v, nodes_azimuth) = effort.nodes();
            let turned = turn(&nodes_v.fill(values, views), views);
            turn(&nodes_azimuth.fill(&turned, azimuths), azimuths)
        };
        let stepped =
            [alpha, Roughness { u: alpha.u * (1.0 + STEP), ..alpha }, Roughness { v: alpha.v * (1.0 + STEP), ..alpha }];
        let step = STEP.ln_1p();
        let first = ANISOTROPIC_EFFORTS[0];
        let coarse = stepped.map(|alpha| compute(first, alpha));
        // derivatives need no corners: the nodes of the first effort do
        let slopes = [1, 2].map(|side| {
            let pairs = coarse[side].iter().zip(&coarse[0]);
            pairs.map(|(there, here)| (there - here) / step).collect::<Vec<f64>>()
        });
        let judge = SingleScattering::new(ndf, shadowing, Rule::PAIR);
        let measured = Measured::new(|v, azimuth| exact(&judge, v, azimuth, alpha));
        let average = Average { log: 0.0, slopes: [0.0; 2] };
        let fixed = Some(Fixed { alpha, average });
        let mut best = Self { flat: Vec::new(), grid: (0, 0), coordinates, fixed, reached: f64::INFINITY };
        for (k, &effort) in ANISOTROPIC_EFFORTS.iter().enumerate() {
            if best.reached > effort.below {
                continue;
            }
            let values = if k == 0 { coarse[0].clone() } else { compute(effort, alpha) };
            let values = spread(effort, &values, effort.grid);
            let [by_u, by_v] = [0, 1].map(|side| spread(first, &slopes[side], effort.grid));
            let mut table = Self { flat: Vec::with_capacity(PACKET * values.len()), grid: effort.grid, ..best };
            for (value, (by_u, by_v)) in values.iter().zip(by_u.iter().zip(&by_v)) {
                table.flat.extend([*value, *by_u, *by_v, 0.0].map(|x| x as f32));
            }
            table.reached = measured.error(|v, azimuth| table.packet(v, azimuth)[0]);
            if best.flat.is_empty() || table.reached < best.reached {
                best = table;
            }
            if best.reached <= effort.enough {
                break;
            }
        }
        // azimuths evenly in angle, in the frame of the roughness
        let azimuthal = gauss(48);
        let integral = |k: usize, by: f64, alpha: Roughness| {
            azimuthal.integrate(0.0, 1.0, |t| {
                let (sin, cos) = (std::f64::consts::FRAC_PI_2 * t).sin_cos();
                let w = DVec3::new(cos, sin, 0.0);
                let azimuth = Coordinates::azimuth(alpha, w);
                best.integral(best.grid.0, 1, View::new(alpha, w).along, |v| {
                    let packet = best.packet(v, azimuth);
                    packet[0] + by * packet[k]
                })
            })
        };
        let whole = integral(0, 0.0, alpha).log2();
        let slope = |k: usize| (integral(k, step, stepped[k]).log2() - whole) / step;
        let slopes = [slope(1), slope(2)];
        best.fixed = Some(Fixed { alpha, average: Average { log: whole, slopes } });
        best
    }

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
    pub fn loss(&self, alpha: Roughness, w: DVec3) -> f64 {
        let along = View::new(alpha, w).along;
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
    pub fn average_loss(&self, alpha: Roughness) -> f64 {
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

    /// The bicubic polynomial of an isotropic grid.
    fn root(&self, v: f64, w: f64) -> f64 {
        let ((i, s), (j, t)) = (locate(v, self.grid.0), locate(w, self.grid.1));
        let (along_v, along_w) = (hermite::weights(s), hermite::weights(t));
        let mut sum = 0.0;
        for (di, [value_v, slope_v]) in along_v.into_iter().enumerate() {
            for (dj, [value_w, slope_w]) in along_w.into_iter().enumerate() {
                let at = PACKET * ((i + di) * self.grid.1 + j + dj);
                let packet = &self.flat[at..at + PACKET];
                sum += value_v * (value_w * f64::from(packet[0]) + slope_w * f64::from(packet[2]))
                    + slope_v * (value_w * f64::from(packet[1]) + slope_w * f64::from(packet[3]));
            }
        }
        sum
    }

    /// Bilinear interpolation of an anisotropic grid.
    fn packet(&self, v: f64, azimuth: f64) -> [f64; PACKET] {
        let ((i, s), (j, t)) = (locate(v, self.grid.0), locate(azimuth, self.grid.1));
        let at = |i: usize, j: usize, k: usize| f64::from(self.flat[PACKET * (i * self.grid.1 + j) + k]);
        std::array::from_fn(|k| {
            let row = |i: usize| at(i, j, k) + t * (at(i, j + 1, k) - at(i, j, k));
            row(i) + s * (row(i + 1) - row(i))
        })
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

/// √(1 − E) at places spread evenly over a table (the first two coordinates of Roberts' sequence), by quadrature.
struct Measured(Vec<(f64, f64, f64)>);

impl Measured {
    fn new(exact: impl Fn(f64, f64) -> f64 + Sync) -> Self {
        let place = |k: usize, step: f64| (0.5 + step * k as f64).fract();
        let at = |k: usize| (place(k, 0.7548776662466927), place(k, 0.5698402909980532));
        // and along the normal, where a box has a corner at the roughness at which its rim reflects to the horizon
        let normal = |k: usize| (1.0, (k as f64 + 0.5) / MEASURED_NORMAL as f64);
        let all = (0..MEASURED + MEASURED_NORMAL).into_par_iter();
        let places = all.map(|k| if k < MEASURED { at(k) } else { normal(k - MEASURED) });
        Self(places.map(|(x, y)| (x, y, exact(x, y))).collect())
    }
    /// The greatest error of E.
    fn error(&self, root: impl Fn(f64, f64) -> f64) -> f64 {
        greatest(self.0.iter().map(|&(x, y, exact)| (root(x, y).powi(2) - exact.powi(2)).abs()))
    }
}

/// The cell of a coordinate in [0, 1], and the place in it.
fn locate(x: f64, count: usize) -> (usize, f64) {
    let x = x.clamp(0.0, 1.0) * (count - 1) as f64;
    let cell = (x as usize).min(count - 2);
    (cell, x - cell as f64)
}

/// Points of [0, 1], ascending, ends included, at which a function is known along the first axis of an array.
struct Nodes {
    at: Vec<f64>,
    /// Even ones are joined piece by piece, Chebyshev's points of the second kind by one polynomial through all.
    even: bool,
}

impl Nodes {
    /// All nodes of a grid, or Chebyshev's points if fewer.
    fn new(count: usize, grid: usize) -> Self {
        if count == grid { Self::even(grid) } else { Self::chebyshev(count) }
    }
    fn even(count: usize) -> Self {
        Self { at: (0..count).map(|k| k as f64 / (count - 1) as f64).collect(), even: true }
    }
    fn chebyshev(count: usize) -> Self {
        let at = (0..count).map(|k| 0.5 - 0.5 * (std::f64::consts::PI * k as f64 / (count - 1) as f64).cos()).collect();
        Self { at, even: false }
    }
    /// Values at `count` even points.
    fn fill(&self, values: &[f64], count: usize) -> Vec<f64> {
        if self.even && self.at.len() == count { values.to_vec() } else { along_first(&self.at, values, count) }
    }
    /// Derivatives at the nodes.
    fn derivative(&self, values: &[f64]) -> Vec<f64> {
        if self.even { differences(self.at.len(), values) } else { derivative(&self.at, values) }
    }
}

/// Derivatives along the first axis at `count` even points of [0, 1], from the polynomial through five neighbors: their closed form is
/// `Σ_{j≠k} (w_j/w_k)(f_j − f_k)/(k − j)` with the barycentric weights `(−1)^j C(4, j)`.
fn differences(count: usize, values: &[f64]) -> Vec<f64> {
    const WEIGHTS: [f64; 5] = [1.0, -4.0, 6.0, -4.0, 1.0];
    let inner = values.len() / count;
    let mut out = vec![0.0; values.len()];
    for (k, out) in out.chunks_exact_mut(inner).enumerate() {
        let first = k.saturating_sub(2).min(count - 5);
        let own = &values[k * inner..][..inner];
        for (j, weight) in WEIGHTS.iter().enumerate().filter(|&(j, _)| first + j != k) {
            let step = (k as f64 - (first + j) as f64) / (count - 1) as f64;
            let share = weight / WEIGHTS[k - first] / step;
            let other = &values[(first + j) * inner..][..inner];
            for (out, (other, own)) in out.iter_mut().zip(other.iter().zip(own)) {
                *out += share * (other - own);
            }
        }
    }
    out
}

/// Barycentric weights of Chebyshev's points.
fn weight(k: usize, count: usize) -> f64 {
    let size = if k == 0 || k == count - 1 { 0.5 } else { 1.0 };
    if k.is_multiple_of(2) { size } else { -size }
}

/// Values at `count` even points from values at Chebyshev's, along the first axis: the barycentric formula (Berrut & Trefethen 2004,
/// Eq. 4.2 with 5.4).
fn along_first(nodes: &[f64], values: &[f64], count: usize) -> Vec<f64> {
    let inner = values.len() / nodes.len();
    let mut out = vec![0.0; count * inner];
    for (k, out) in out.chunks_exact_mut(inner).enumerate() {
        let x = k as f64 / (count - 1) as f64;
        if let Some(hit) = nodes.iter().position(|&node| (node - x).abs() < 1e-14) {
            out.copy_from_slice(&values[hit * inner..][..inner]);
            continue;
        }
        let weights: Vec<f64> =
            nodes.iter().enumerate().map(|(j, &node)| weight(j, nodes.len()) / (x - node)).collect();
        let sum: f64 = weights.iter().sum();
        for (weight, values) in weights.iter().zip(values.chunks_exact(inner)) {
            out.iter_mut().zip(values).for_each(|(out, value)| *out += weight / sum * value);
        }
    }
    out
}

/// Derivatives along the first axis at Chebyshev's points of the polynomials through the values there (Berrut & Trefethen 2004, Eq. 9.4).
fn derivative(nodes: &[f64], values: &[f64]) -> Vec<f64> {
    let count = nodes.len();
    let inner = values.len() / count;
    let mut out = vec![0.0; values.len()];
    for (k, out) in out.chunks_exact_mut(inner).enumerate() {
        let own = &values[k * inner..][..inner];
        for (j, other) in values.chunks_exact(inner).enumerate().filter(|&(j, _)| j != k) {
            let share = weight(j, count) / weight(k, count) / (nodes[k] - nodes[j]);
            for (out, (other, own)) in out.iter_mut().zip(other.iter().zip(own)) {
                *out += share * (other - own);
            }
        }
    }
    out
}

/// Moves the first axis, of the given length, behind the others.
fn turn(values: &[f64], first: usize) -> Vec<f64> {
    let inner = values.len() / first;
    (0..inner).flat_map(|j| (0..first).map(move |i| values[i * inner + j])).collect()
}

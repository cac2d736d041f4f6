//! What a rough interface reflects or transmits, tabulated over the view for one roughness and one index.
//!
//! A view enters by the distance of its cosine from that of the horizon, that of the normal, or that of total reflection, μ_c, whichever is nearer: there, R and T
//! may be like powers. The octaves of a distance are divided into equal cells with a cubic each: the exponent and the first bits of the mantissa of a number find its
//! cell, and what happens at the roughness is as well resolved as what happens over all views. Two roughnesses add the azimuth, in columns between which cells are
//! interpolated linearly.

use super::albedo::{Incidence, Rule, SingleScattering};
use super::albedo_table::Coordinates;
use super::fresnel::{average_dielectric, dielectric, over_cosines};
use crate::constants::{INTERFACE_CELLS, INTERFACE_OCTAVES};
use crate::ndf::{Ndf, Roughness, Shadowing};
use crate::numerics::hermite;
use crate::numerics::interpolation::{Axis, locate};
use crate::numerics::quadrature::gauss;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::FRAC_PI_2;

/// Cells over the distance of a cosine from one of the special ones.
const CELLS: usize = INTERFACE_OCTAVES * INTERFACE_CELLS;
/// Columns of a table for two roughnesses: with 17, .3 and .03 are off by more than 1e-3.
const AZIMUTHS: usize = 33;
/// Azimuths at which two roughnesses are computed; all others follow from the polynomial through these.
const COMPUTED_AZIMUTHS: usize = 9;
/// Points of each octave of the view that are computed for smooth shapes; those with corners need all.
const COMPUTED_VIEWS: usize = 6;
/// Points over a quarter of the azimuth for averages.
const AVERAGED_AZIMUTHS: usize = 12;

/// What is tabulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// R: all but what is reflected at once may be taken as transmitted.
    Reflectance,
    /// T: light that meets a second facet is lost.
    Transmittance,
}

/// R or T of one interface.
#[derive(Debug, Clone)]
pub struct InterfaceTable {
    flat: Vec<f32>,
    columns: usize,
    critical: f64,
    alpha: Roughness,
    average: f64,
    internal_reflectance: f64,
    facet_reflectance: f64,
}

impl InterfaceTable {
    /// Tabulates an interface; `eta` is the index below over that above.
    pub fn new(ndf: &Ndf, shadowing: Shadowing, alpha: Roughness, eta: f64, quantity: Quantity) -> Self {
        let isotropic = alpha.u == alpha.v;
        // total reflection is a corner as well
        let corners = eta < 1.0 || !ndf.profile().cusps().is_empty();
        let rule = if !corners {
            Rule::TABLE
        } else if isotropic {
            Rule::FINE
        } else {
            Rule::ANISOTROPIC
        };
        let source = SingleScattering::new(ndf, shadowing, rule);
        let exact = |w: DVec3| {
            let view = Incidence::new(alpha, w);
            match quantity {
                Quantity::Reflectance => source.reflectance(view, |cosine| dielectric(cosine, eta).0),
                Quantity::Transmittance => source.transmittance(view, eta),
            }
        };
        let azimuths = if isotropic { 1 } else { AZIMUTHS };
        let axis = Axis::new(if eta < 1.0 { AZIMUTHS } else { COMPUTED_AZIMUTHS }, AZIMUTHS);
        let octave = Axis::new(if corners { INTERFACE_CELLS + 1 } else { COMPUTED_VIEWS }, INTERFACE_CELLS + 1);
        // of each octave the last points; its first one is the last of the octave before
        let per_octave = octave.at.len() - 1;
        let critical = (1.0 - eta * eta).max(0.0).sqrt();
        let sides = Side::all(critical);
        let octaves = || (0..INTERFACE_OCTAVES).map(|o| o as f64);
        let distances: Vec<f64> = [distance_at(0.0)]
            .into_iter()
            .chain(
                octaves()
                    .flat_map(|o| octave.at[1..].iter().map(move |t| distance_at((o + t) * INTERFACE_CELLS as f64))),
            )
            .collect();
        let column = |azimuth: f64| -> Vec<f64> {
            let horizontal = Coordinates::direction_at(azimuth, alpha);
            let all: Vec<f64> = sides.iter().flat_map(|side| distances.iter().map(|&y| side.cosine(y))).collect();
            all.par_iter().map(|&cosine| exact(towards(cosine, horizontal))).collect()
        };
        let computed: Vec<f64> =
            if isotropic { column(0.0) } else { axis.at.iter().flat_map(|&x| column(x)).collect() };
        let columns = if isotropic { computed } else { axis.fill(&computed, azimuths) };
        let mut flat = vec![0.0; 4 * CELLS * sides.len() * azimuths];
        for (j, column) in columns.chunks_exact(distances.len() * sides.len()).enumerate() {
            for (side, values) in column.chunks_exact(distances.len()).enumerate() {
                for o in 0..INTERFACE_OCTAVES {
                    let own = &values[o * per_octave..=(o + 1) * per_octave];
                    let slopes = octave.fill(&octave.derivative(own), INTERFACE_CELLS + 1);
                    let values = octave.fill(own, INTERFACE_CELLS + 1);
                    let width = 1.0 / INTERFACE_CELLS as f64;
                    for k in 0..INTERFACE_CELLS {
                        let at = |k: usize| [values[k], slopes[k] * width];
                        let cubic = hermite::cubic(at(k), at(k + 1), 1.0);
                        let cell = 4 * ((side * CELLS + o * INTERFACE_CELLS + k) * azimuths + j);
                        flat[cell..cell + 4].copy_from_slice(&cubic.map(|c| c as f32));
                    }
                }
            }
        }
        let facet_reflectance = average_dielectric(eta);
        let mut table = Self {
            flat,
            columns: azimuths,
            critical,
            alpha,
            average: 0.0,
            internal_reflectance: 0.0,
            facet_reflectance,
        };
        table.average = table.integral();
        if quantity == Quantity::Transmittance {
            table.internal_reflectance = internal_reflectance(&source, alpha, eta);
        }
        table
    }

    /// Cubics in the place within a cell, four coefficients each: cells by special cosine and octave, the nearest first, columns next to each other.
    pub fn flat(&self) -> &[f32] {
        &self.flat
    }

    /// Azimuths from tangent to tangent; 1 for one roughness.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// μ_c, the cosine below which everything is reflected; 0 if there is none.
    pub fn critical(&self) -> f64 {
        self.critical
    }

    /// R or T of a direction, ω.z > 0.
    pub fn at(&self, w: DVec3) -> f64 {
        let (side, y) = Side::of(self.critical, w.z);
        let (cell, t) = cell_of(y);
        let cell = side * CELLS + cell;
        let value = |column: usize| {
            let at = 4 * (cell * self.columns + column);
            hermite::value(std::array::from_fn(|k| f64::from(self.flat[at + k])), t)
        };
        if self.columns == 1 {
            return value(0);
        }
        let (column, s) = locate(Coordinates::azimuth(self.alpha, w), self.columns);
        value(column) + s * (value(column + 1) - value(column))
    }

    /// Its average over diffuse light, `2 ∫ μ dμ` of it.
    pub fn average(&self) -> f64 {
        self.average
    }

    /// Of T: the share of diffuse light from below that is reflected at once.
    pub fn internal_reflectance(&self) -> f64 {
        self.internal_reflectance
    }

    /// The share of diffuse light from above that a facet reflects.
    pub fn facet_reflectance(&self) -> f64 {
        self.facet_reflectance
    }

    fn integral(&self) -> f64 {
        over_quarter(self.columns > 1, |phi| {
            let (sin, cos) = phi.sin_cos();
            let cells = |side: Side| {
                let ends = move |k: usize| side.cosine(if k == 0 { 0.0 } else { distance_at((k - 1) as f64) });
                (0..=CELLS).map(move |k| (ends(k), ends(k + 1))).collect::<Vec<_>>()
            };
            let integral = |(from, to): (f64, f64)| {
                let at = |mu: f64| 2.0 * mu * self.at(towards(mu, DVec3::new(cos, sin, 0.0)));
                gauss(3).integrate(from.min(to), from.max(to), at)
            };
            Side::all(self.critical).into_iter().flat_map(cells).map(integral).sum()
        })
    }
}

/// The average over diffuse light from below of what the interface reflects at once.
fn internal_reflectance(source: &SingleScattering<'_>, alpha: Roughness, eta: f64) -> f64 {
    let inverse = 1.0 / eta;
    over_quarter(alpha.u != alpha.v, |phi| {
        let (sin, cos) = phi.sin_cos();
        over_cosines(inverse, |mu| {
            let view = Incidence::new(alpha, towards(mu, DVec3::new(cos, sin, 0.0)));
            source.reflectance(view, |cosine| dielectric(cosine, inverse).0)
        })
    })
}

/// The mean over a quarter of the azimuth, if there is something to average.
fn over_quarter(anisotropic: bool, at: impl Fn(f64) -> f64 + Sync) -> f64 {
    if !anisotropic {
        return at(0.0);
    }
    let nodes = gauss(AVERAGED_AZIMUTHS).nodes();
    nodes.par_iter().map(|&(t, weight)| weight * at(FRAC_PI_2 * t)).sum()
}

/// The direction with a cosine above a horizontal one.
fn towards(cosine: f64, horizontal: DVec3) -> DVec3 {
    let sin = (1.0 - cosine * cosine).max(0.0).sqrt();
    DVec3::new(sin * horizontal.x, sin * horizontal.y, cosine)
}

/// What a distance is measured from, and to where.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Side {
    from: f64,
    to: f64,
}

impl Side {
    /// Upwards from μ_c, down from the normal; upwards from the horizon and down from μ_c if that is not 0.
    fn all(critical: f64) -> Vec<Self> {
        let between = |from: f64, to: f64| [Self { from, to }, Self { from: to, to: from }];
        let above = between(critical, 1.0).to_vec();
        if critical > 0.0 { [above, between(0.0, critical).to_vec()].concat() } else { above }
    }

    /// That of a cosine, and its distance, up to a half.
    fn of(critical: f64, cosine: f64) -> (usize, f64) {
        let (first, low, high) = if cosine < critical { (2, 0.0, critical) } else { (0, critical, 1.0) };
        let (a, b) = (cosine - low, high - cosine);
        (first + usize::from(b < a), a.min(b) / (high - low))
    }

    /// The cosine at a distance.
    fn cosine(self, distance: f64) -> f64 {
        self.from + distance * (self.to - self.from)
    }
}

/// The distance at a place counted in cells.
fn distance_at(place: f64) -> f64 {
    let octave = (place / INTERFACE_CELLS as f64).floor();
    let mantissa = 1.0 + place / INTERFACE_CELLS as f64 - octave;
    mantissa * (octave - 1.0 - INTERFACE_OCTAVES as f64).exp2()
}

/// The cell of a distance, and the place in it.
fn cell_of(distance: f64) -> (usize, f64) {
    let distance = distance.clamp(distance_at(0.0), 0.5);
    let octave = distance.log2().floor().min(-2.0);
    let place = (distance * (-octave).exp2() - 1.0) * INTERFACE_CELLS as f64;
    let cell = (place.max(0.0) as usize).min(INTERFACE_CELLS - 1);
    ((octave + 1.0 + INTERFACE_OCTAVES as f64) as usize * INTERFACE_CELLS + cell, place - cell as f64)
}

//! How fine a table has to be: efforts, from few nodes to many, and the error that each has, measured.

use super::AlbedoTable;
use crate::numerics::greatest;
use crate::numerics::interpolation::Axis;
use crate::scattering::albedo::Rule;
use rayon::prelude::*;

/// Places of a table at which the error is measured.
const MEASURED: usize = 121;
/// Further ones along the normal.
const MEASURED_NORMAL: usize = 60;

/// Nodes of a grid, and how they are computed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    /// Nodes along both axes.
    pub(super) grid: (usize, usize),
    /// Of which so many are computed: all of them, or Chebyshev's points if fewer.
    pub(super) points: (usize, usize),
    pub(super) rule: Rule,
    /// Errors of the effort before above which this one is left out: corners are hopeless for few nodes.
    pub(super) below: f64,
    /// The error at which no further effort is made.
    pub(super) enough: f64,
}

impl Effort {
    /// What is computed along both axes.
    pub(super) fn nodes(&self) -> (Axis, Axis) {
        (Axis::new(self.points.0, self.grid.0), Axis::new(self.points.1, self.grid.1))
    }
}

/// The table of the first effort whose error is small enough; of the best one if none is.
pub(super) fn refined(efforts: &[Effort], mut table: impl FnMut(&Effort) -> AlbedoTable) -> AlbedoTable {
    let mut best = table(&efforts[0]);
    for (before, effort) in efforts.iter().zip(&efforts[1..]) {
        if best.reached <= before.enough {
            break;
        }
        if best.reached <= effort.below {
            let next = table(effort);
            if next.reached < best.reached {
                best = next;
            }
        }
    }
    best
}

/// √(1 − E) at places spread evenly over a table (the first two coordinates of Roberts' sequence), by quadrature.
pub(super) struct Measured(Vec<(f64, f64, f64)>);

impl Measured {
    pub(super) fn new(exact: impl Fn(f64, f64) -> f64 + Sync) -> Self {
        let place = |k: usize, step: f64| (0.5 + step * k as f64).fract();
        let at = |k: usize| (place(k, 0.7548776662466927), place(k, 0.5698402909980532));
        // and along the normal, where a box has a corner at the roughness at which its rim reflects to the horizon
        let normal = |k: usize| (1.0, (k as f64 + 0.5) / MEASURED_NORMAL as f64);
        let all = (0..MEASURED + MEASURED_NORMAL).into_par_iter();
        let places = all.map(|k| if k < MEASURED { at(k) } else { normal(k - MEASURED) });
        Self(places.map(|(x, y)| (x, y, exact(x, y))).collect())
    }
    /// The greatest error of E.
    pub(super) fn error(&self, root: impl Fn(f64, f64) -> f64) -> f64 {
        greatest(self.0.iter().map(|&(x, y, exact)| (root(x, y).powi(2) - exact.powi(2)).abs()))
    }
}

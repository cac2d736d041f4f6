//! Tables for every isotropic roughness: bicubic over view and roughness.

use super::coordinates::Coordinates;
use super::refine::{Effort, Measured, refined};
use super::{AVERAGE, AlbedoTable, PACKET};
use crate::ndf::{Ndf, Shadowing};
use crate::numerics::hermite;
use crate::numerics::interpolation::{Axis, locate, transposed};
use crate::scattering::albedo::{Incidence, Rule, SingleScattering};
use rayon::prelude::*;

/// Efforts for isotropic tables: the next promising one is tried until the error is small enough.
const EFFORTS: [Effort; 6] = [
    Effort { grid: (32, 32), points: (16, 16), rule: Rule::TABLE, below: f64::INFINITY, enough: 4e-4 },
    Effort { grid: (32, 32), points: (24, 24), rule: Rule::TABLE, below: 1e-2, enough: 4e-4 },
    Effort { grid: (32, 32), points: (32, 32), rule: Rule::TABLE, below: 8e-4, enough: 4e-4 },
    Effort { grid: (64, 48), points: (64, 48), rule: Rule::TABLE, below: 3e-2, enough: 4e-4 },
    Effort { grid: (96, 64), points: (96, 64), rule: Rule::FINE, below: f64::INFINITY, enough: 6e-4 },
    Effort { grid: (96, 160), points: (96, 160), rule: Rule::FINE, below: f64::INFINITY, enough: 6e-4 },
];
/// Nodes from which the average is interpolated to all of its list.
const AVERAGE_NODES: usize = 103;

impl AlbedoTable {
    /// Tabulates a distribution for every isotropic roughness.
    pub fn isotropic(ndf: &Ndf, shadowing: Shadowing) -> Self {
        let coordinates = Coordinates::new(ndf, shadowing);
        let exact = |source: &SingleScattering<'_>, v: f64, w: f64| {
            let alpha = coordinates.roughness_at(w);
            let flat = Incidence { a: 0.0, along: alpha, across: alpha, shear: 0.0 };
            source.missing_energy(coordinates.view_at(v, flat)).sqrt()
        };
        // finer than the first efforts, so that the error of their rule counts as well
        let judge = SingleScattering::new(ndf, shadowing, Rule::FINE);
        let measured = Measured::new(|v, w| exact(&judge, v, w));
        let mut best = refined(&EFFORTS, |effort| {
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
                let turned = transposed(values, views);
                let slopes = nodes_w.derivative(&turned);
                // (w, v) → (v, w)
                [turned, slopes].map(|turned| transposed(&nodes_w.fill(&turned, roughnesses), roughnesses))
            };
            let ([f, f_w], [f_v, f_vw]) = (fill(&by_v), fill(&slope_v));
            let flat = Vec::with_capacity(PACKET * f.len() + AVERAGE);
            let mut table = Self { flat, grid: effort.grid, coordinates, fixed: None, reached: f64::INFINITY };
            let (cell_v, cell_w) = (1.0 / (views - 1) as f64, 1.0 / (roughnesses - 1) as f64);
            for k in 0..f.len() {
                table
                    .flat
                    .extend([f[k], f_v[k] * cell_v, f_w[k] * cell_w, f_vw[k] * cell_v * cell_w].map(|x| x as f32));
            }
            table.reached = measured.error(|v, w| table.root(v, w));
            table
        });
        let logs = Axis::even(AVERAGE_NODES);
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

    /// The bicubic polynomial of an isotropic grid.
    pub(super) fn root(&self, v: f64, w: f64) -> f64 {
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
}

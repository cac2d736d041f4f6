//! Tables for one pair of roughnesses: bilinear over view and azimuth, with derivatives by both.

use super::coordinates::Coordinates;
use super::refine::{Effort, Measured, refined};
use super::{AlbedoTable, Average, Fixed, PACKET};
use crate::ndf::{Ndf, Roughness, Shadowing};
use crate::numerics::interpolation::{locate, transposed};
use crate::numerics::quadrature::gauss;
use crate::scattering::albedo::{Incidence, Rule, SingleScattering};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::FRAC_PI_2;

/// Efforts over v and the azimuth, as those of isotropic tables.
const EFFORTS: [Effort; 4] = [
    Effort { grid: (128, 32), points: (16, 10), rule: Rule::ANISOTROPIC, below: f64::INFINITY, enough: 6e-4 },
    Effort { grid: (192, 48), points: (32, 20), rule: Rule::ANISOTROPIC, below: 1e-2, enough: 6e-4 },
    Effort { grid: (192, 48), points: (192, 20), rule: Rule::ANISOTROPIC, below: 2e-2, enough: 6e-4 },
    Effort { grid: (192, 48), points: (192, 48), rule: Rule::PAIR, below: f64::INFINITY, enough: 6e-4 },
];
/// Relative step of derivatives with respect to the roughness.
const STEP: f64 = 1e-3;

impl AlbedoTable {
    /// Tabulates a distribution for one pair of roughnesses.
    pub fn anisotropic(ndf: &Ndf, shadowing: Shadowing, alpha: Roughness) -> Self {
        let coordinates = Coordinates::new(ndf, shadowing);
        let exact = |source: &SingleScattering<'_>, v: f64, azimuth: f64, alpha: Roughness| {
            let horizontal = Incidence::new(alpha, Coordinates::direction_at(azimuth, alpha));
            source.missing_energy(coordinates.view_at(v, horizontal)).sqrt()
        };
        let compute = |effort: &Effort, alpha: Roughness| -> Vec<f64> {
            let source = SingleScattering::new(ndf, shadowing, effort.rule);
            let (views, azimuths) = effort.nodes();
            let (count, inner) = effort.points;
            (0..count * inner)
                .into_par_iter()
                .map(|k| exact(&source, views.at[k / inner], azimuths.at[k % inner], alpha))
                .collect()
        };
        let spread = |effort: &Effort, values: &[f64], (views, azimuths): (usize, usize)| {
            let (nodes_v, nodes_azimuth) = effort.nodes();
            let turned = transposed(&nodes_v.fill(values, views), views);
            transposed(&nodes_azimuth.fill(&turned, azimuths), azimuths)
        };
        let stepped =
            [alpha, Roughness { u: alpha.u * (1.0 + STEP), ..alpha }, Roughness { v: alpha.v * (1.0 + STEP), ..alpha }];
        let step = STEP.ln_1p();
        let first = &EFFORTS[0];
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
        let mut best = refined(&EFFORTS, |effort| {
            let values = if effort.points == first.points { coarse[0].clone() } else { compute(effort, alpha) };
            let values = spread(effort, &values, effort.grid);
            let [by_u, by_v] = [0, 1].map(|side| spread(first, &slopes[side], effort.grid));
            let flat = Vec::with_capacity(PACKET * values.len());
            let mut table = Self { flat, grid: effort.grid, coordinates, fixed, reached: f64::INFINITY };
            for (value, (by_u, by_v)) in values.iter().zip(by_u.iter().zip(&by_v)) {
                table.flat.extend([*value, *by_u, *by_v, 0.0].map(|x| x as f32));
            }
            table.reached = measured.error(|v, azimuth| table.packet(v, azimuth)[0]);
            table
        });
        // azimuths evenly in angle, in the frame of the roughness
        let azimuthal = gauss(48);
        let integral = |k: usize, by: f64, alpha: Roughness| {
            azimuthal.integrate(0.0, 1.0, |t| {
                let (sin, cos) = (FRAC_PI_2 * t).sin_cos();
                let w = DVec3::new(cos, sin, 0.0);
                let azimuth = Coordinates::azimuth(alpha, w);
                best.integral(best.grid.0, 1, Incidence::new(alpha, w).along, |v| {
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

    /// Bilinear interpolation of an anisotropic grid.
    pub(super) fn packet(&self, v: f64, azimuth: f64) -> [f64; PACKET] {
        let ((i, s), (j, t)) = (locate(v, self.grid.0), locate(azimuth, self.grid.1));
        let at = |i: usize, j: usize, k: usize| f64::from(self.flat[PACKET * (i * self.grid.1 + j) + k]);
        std::array::from_fn(|k| {
            let row = |i: usize| at(i, j, k) + t * (at(i, j + 1, k) - at(i, j, k));
            row(i) + s * (row(i + 1) - row(i))
        })
    }
}

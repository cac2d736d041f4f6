//! Derivatives of H by the parameters of a profile, over the cells of H's own table.
//!
//! So whoever has found the cell of H has found that of its derivatives, and they are as smooth there.

use crate::masking::gradient::MaskingGradient;
use crate::masking::table::LambdaTable;
use crate::numerics::hermite;
use crate::profile::derivatives::PARAMETERS;
use crate::profile::{Masking, Profile};

/// ∂H/∂θ tabulated for 1/γ, p, λ and m.
#[derive(Debug, Clone)]
pub struct GradientTable {
    /// Of each cell, four coefficients for each parameter, the constant first
    flat: Vec<f32>,
    log_normalization: [f64; PARAMETERS],
}

impl GradientTable {
    /// Tabulates the derivatives over the cells of `table`.
    pub fn new(profile: &dyn Profile, gradient: &MaskingGradient, table: &LambdaTable) -> Self {
        let cubics = cubics(table, |q| gradient.at(profile, q).1);
        let flat = cubics.iter().flatten().map(|&c| c as f32).collect();
        Self { flat, log_normalization: gradient.log_normalization() }
    }

    /// Four coefficients for 1/γ, p, λ and m, cell after cell, in the order of the cells of H.
    pub fn flat(&self) -> &[f32] {
        &self.flat
    }

    /// `∂ ln A/∂θ`.
    pub fn log_normalization(&self) -> [f64; PARAMETERS] {
        self.log_normalization
    }
}

/// Derivatives of H by some parameters over the cells of H: a cubic for each parameter, cell after cell.
pub(super) fn cubics<V: AsRef<[Masking]>>(table: &LambdaTable, at: impl Fn(f64) -> V) -> Vec<[f64; 4]> {
    let cells = table.cells();
    let mut left = at(0.0);
    let mut cubics = Vec::with_capacity(left.as_ref().len() * cells.len());
    for (from, to) in cells {
        if to.is_infinite() {
            cubics.extend(left.as_ref().iter().map(|by| [by.h, 0.0, 0.0, 0.0]));
            break;
        }
        let right = at(to);
        for (left, right) in left.as_ref().iter().zip(right.as_ref()) {
            cubics.push(hermite::cubic([left.h, -left.s], [right.h, -right.s], to - from));
        }
        left = right;
    }
    cubics
}

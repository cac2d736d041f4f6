//! Derivatives of H by the parameters of a profile, over the cells of H's own table.
//!
//! So whoever has found the cell of H has found that of its derivatives, and they are as smooth there.

use crate::masking::gradient::MaskingGradient;
use crate::masking::table::LambdaTable;
use crate::numerics::hermite;
use crate::profile::Profile;
use crate::profile::derivatives::PARAMETERS;

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
        let cells = table.cells();
        let mut flat = Vec::with_capacity(4 * PARAMETERS * cells.len());
        let at = |q: f64| gradient.at(profile, q).1;
        let mut left = at(0.0);
        for (from, to) in cells {
            if to.is_infinite() {
                flat.extend(left.iter().flat_map(|by| [by.h as f32, 0.0, 0.0, 0.0]));
                break;
            }
            let right = at(to);
            for (left, right) in left.iter().zip(&right) {
                let cubic = hermite::cubic([left.h, -left.s], [right.h, -right.s], to - from);
                flat.extend(cubic.map(|c| c as f32));
            }
            left = right;
        }
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

//! How a table follows its values: ln f is linear in their logarithms.

use super::{Kind, TabulatedProfile};
use crate::profile::derivatives::Values;

impl TabulatedProfile {
    /// What tells apart tables that are equal but follow their values differently: how many were given, whether a node at 0 was added to them, and
    /// whether the tail has the exponent of the last cell.
    pub fn given_as(&self) -> [f64; 3] {
        [self.given as f64, f64::from(u8::from(self.begins_above_0)), f64::from(u8::from(self.tail_is_continued))]
    }
}

impl Values for TabulatedProfile {
    fn count(&self) -> usize {
        self.given
    }

    fn cell_of(&self, x: f64) -> usize {
        self.cell(x).unwrap_or(self.cells.len())
    }

    fn rows(&self, cell: usize) -> [usize; 2] {
        // beyond the last node the last cell goes on; a node at 0 that was added has the value of the next one
        let cell = cell.min(self.cells.len() - 1);
        let added = usize::from(self.begins_above_0);
        [cell.saturating_sub(added), cell + 1 - added]
    }

    fn share(&self, cell: usize, from: f64, past: f64) -> f64 {
        let beyond = cell >= self.cells.len();
        if beyond && !self.tail_is_continued {
            return 1.0;
        }
        let cell = &self.cells[cell.min(self.cells.len() - 1)];
        match cell.kind {
            Kind::Power { .. } => cell.log_w(from, past) / cell.span,
            // proportional to the one value that is not 0
            Kind::Ramp { rising } => f64::from(u8::from(rising)),
            Kind::Empty => 0.0,
        }
    }

    fn share_rate_of_tail(&self) -> f64 {
        if self.tail_is_continued { 2.0 / self.last().span } else { 0.0 }
    }
}

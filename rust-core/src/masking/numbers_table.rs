//! Derivatives by the numbers of a table or a mixture in the form that single-precision renderers read: a matrix.
//!
//! All that a renderer evaluates is linear in small changes of the numbers. So the product of this matrix with the changes of their logarithms is a table
//! that has a gradient; whoever finds a cell of H or of f reads the cell's change there, whatever the number of numbers, and the way back is one
//! product for all that was evaluated.

use crate::masking::gradient_table::cubics;
use crate::masking::numbers_gradient::NumbersGradient;
use crate::masking::table::LambdaTable;
use crate::profile::Profile;
use crate::profile::cells::{ProfileCells, Span};

/// Rows of a block: what one look-up reads.
pub const BLOCK: usize = 4;
/// Where a cubic is taken through, in shares of its cell: Chebyshev's points.
const POINTS: [f64; BLOCK] =
    [0.038_060_233_744_356_63, 0.308_658_283_817_455_1, 0.691_341_716_182_544_9, 0.961_939_766_255_643_4];
/// Cells narrower than this in log₂ t have no slope that single precision sees.
const LEAST_SPAN: f64 = 1e-9;
/// The least log₂ t of a point, on the ramp next to a 0: nearer to its end it would round into the next cell.
const LEAST_LOG: f64 = -16.0;

/// The matrix: a row for each number of the tables, a column for each number of the source.
#[derive(Debug, Clone)]
pub struct NumbersTable {
    flat: Vec<f32>,
    columns: usize,
    cells_of_h: usize,
    cells_of_f: usize,
}

impl NumbersTable {
    /// Tabulates over the cells of H and over those of f, and if asked for over those of f in double precision.
    pub fn new(
        profile: &dyn Profile,
        gradient: &NumbersGradient,
        table: &LambdaTable,
        cells: &ProfileCells,
        precise: bool,
    ) -> Self {
        let columns = gradient.count();
        let mut blocks: Vec<[f64; BLOCK]> = gradient.log_mean().iter().map(|&by| [by, 0.0, 0.0, 0.0]).collect();
        blocks.extend(cubics(table, |q| gradient.at(profile, q).1));
        let cells_of_h = blocks.len() / columns - 1;
        let single = cells.spans(true);
        let cells_of_f = single.len();
        let double = if precise { cells.spans(false) } else { Vec::new() };
        for span in single.iter().chain(&double) {
            blocks.extend(over_span(profile, gradient, span));
        }
        let by_row = blocks
            .chunks(columns)
            .flat_map(|block| (0..BLOCK).flat_map(move |c| block.iter().map(move |b| b[c] as f32)));
        Self { flat: by_row.collect(), columns, cells_of_h, cells_of_f }
    }

    /// Row after row. A block of four rows is the change of the mean slope's logarithm (and three of 0); then one for each cell of H,
    /// a cubic in the distance from its left end; then one for each cell of f over s, a cubic in log₂ t that is `∂ ln(A f)`; then those in double
    /// precision, if they were asked for.
    pub fn flat(&self) -> &[f32] {
        &self.flat
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of cells of H.
    pub fn cells_of_h(&self) -> usize {
        self.cells_of_h
    }

    /// Number of cells of f in single precision.
    pub fn cells_of_f(&self) -> usize {
        self.cells_of_f
    }
}

/// Cubics in log₂ t, one for each number.
fn over_span(profile: &dyn Profile, gradient: &NumbersGradient, span: &Span) -> Vec<[f64; BLOCK]> {
    let columns = gradient.count();
    let at = |log: f64| gradient.log_density(profile, span.square(log).max(0.0).sqrt());
    let log = |s: f64| span.log_t(s).max(LEAST_LOG);
    let first = log(span.start);
    let Some(end) = span.end else {
        // a table goes on as a line, a mixture as what outlives all others
        let values = at(first);
        let next = if profile.values().is_some() { at(first + 1.0) } else { values.clone() };
        return (0..columns).map(|k| newton([first, first + 1.0], [values[k], next[k]])).collect();
    };
    let width = log(end) - first;
    if width.abs() < LEAST_SPAN {
        let middle = gradient.log_density(profile, (0.5 * (span.start + end)).sqrt());
        return middle.iter().map(|&by| [by, 0.0, 0.0, 0.0]).collect();
    }
    let points = POINTS.map(|t| width.mul_add(t, first));
    let values = points.map(at);
    (0..columns).map(|k| newton(points, [0, 1, 2, 3].map(|j| values[j][k]))).collect()
}

/// Coefficients, the constant first, of the polynomial through points.
fn newton<const N: usize>(x: [f64; N], y: [f64; N]) -> [f64; BLOCK] {
    let mut differences = y;
    for order in 1..N {
        for k in (order..N).rev() {
            differences[k] = (differences[k] - differences[k - 1]) / (x[k] - x[k - order]);
        }
    }
    let mut result = [0.0; BLOCK];
    for k in (0..N).rev() {
        // result · (X − x_k) + difference
        for j in (1..BLOCK).rev() {
            result[j] = result[j - 1] - x[k] * result[j];
        }
        result[0] = differences[k] - x[k] * result[0];
    }
    result
}

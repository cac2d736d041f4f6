//! Heights on a periodic grid, two triangles per cell.
//!
//! ```text
//! (i, j+1) ──── (i+1, j+1)       lower facet: (i, j), (i+1, j), (i, j+1)
//!     │ ╲  upper  │              upper facet: (i+1, j+1), (i, j+1), (i+1, j)
//!     │   ╲       │
//!     │ lower ╲   │              All facets have the same projected area, so the histogram of their slopes
//!  (i, j) ──── (i+1, j)          is the distribution D·cos θ_m.
//! ```

use crate::error::ParameterError;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// A periodic surface: the grid is the tile that repeats along x and y.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    nx: usize,
    ny: usize,
    spacing: DVec2,
    heights: Vec<f64>,
}

/// Number of points along one side of a tile: fewer than 4 are no surface, more need another index type.
pub(super) const POINTS: std::ops::RangeInclusive<usize> = 4..=16384;

impl Surface {
    /// A tile of `nx × ny` points, x first, with their distances along x and y.
    ///
    /// # Errors
    /// A side that is too short or too long, a wrong number of heights, a height or a spacing that is not a number.
    pub fn new(nx: usize, ny: usize, spacing: DVec2, heights: Vec<f64>) -> Result<Self, ParameterError> {
        for (name, count) in [("nx", nx), ("ny", ny)] {
            crate::error::require(
                POINTS.contains(&count),
                name,
                count as f64,
                "between 4 and 16384",
                "it is the number of points along one side of the tile",
            )?;
        }
        for (name, value) in [("dx", spacing.x), ("dy", spacing.y)] {
            crate::error::require(
                value > 0.0 && value.is_finite(),
                name,
                value,
                "a positive number",
                "it is the distance between neighboring points",
            )?;
        }
        if heights.len() != nx * ny {
            return Err(ParameterError::Length { name: "heights", found: heights.len(), expected: nx * ny });
        }
        if let Some(&height) = heights.iter().find(|h| !h.is_finite()) {
            return Err(ParameterError::OutOfRange {
                name: "heights",
                value: height,
                range: "finite numbers",
                mend: "fill or cut out points that were not measured",
            });
        }
        Ok(Self { nx, ny, spacing, heights })
    }

    /// Points along x.
    pub fn nx(&self) -> usize {
        self.nx
    }
    /// Points along y.
    pub fn ny(&self) -> usize {
        self.ny
    }
    /// Distances of points along x and y.
    pub fn spacing(&self) -> DVec2 {
        self.spacing
    }
    /// Heights, x first.
    pub fn heights(&self) -> &[f64] {
        &self.heights
    }
    /// Number of facets.
    pub fn facets(&self) -> usize {
        2 * self.heights.len()
    }

    /// The same surface with its slopes multiplied along x and y: heights by `alpha.x`, the spacing along y by `alpha.x/alpha.y`.
    #[must_use]
    pub fn stretched(&self, alpha: DVec2) -> Self {
        let spacing = DVec2::new(self.spacing.x, self.spacing.y * (alpha.x / alpha.y));
        Self { spacing, heights: self.heights.iter().map(|h| h * alpha.x).collect(), ..*self }
    }

    /// Heights of the corners of a cell: (i, j), (i+1, j), (i, j+1), (i+1, j+1), with i and j inside the tile.
    #[inline]
    pub(super) fn corners(&self, i: usize, j: usize) -> [f64; 4] {
        let right = if i + 1 == self.nx { 0 } else { i + 1 };
        let (row, above) = (j * self.nx, if j + 1 == self.ny { 0 } else { (j + 1) * self.nx });
        [self.heights[row + i], self.heights[row + right], self.heights[above + i], self.heights[above + right]]
    }

    /// Height of a point, one column or row beyond the tile at the most.
    #[inline]
    pub(super) fn corner(&self, i: usize, j: usize) -> f64 {
        self.heights[if j == self.ny { 0 } else { j } * self.nx + if i == self.nx { 0 } else { i }]
    }

    /// Slopes of the lower and the upper facet of a cell.
    #[inline]
    pub(super) fn cell_slopes(&self, i: usize, j: usize) -> [DVec2; 2] {
        let [a, b, c, d] = self.corners(i, j);
        [DVec2::new(b - a, c - a) / self.spacing, DVec2::new(d - c, d - b) / self.spacing]
    }

    /// Slopes of all facets: lower and upper of each cell in turn.
    pub fn slopes(&self) -> Vec<DVec2> {
        let mut slopes = vec![DVec2::ZERO; self.facets()];
        slopes.par_chunks_mut(2 * self.nx).enumerate().for_each(|(j, row)| {
            for (i, cell) in row.chunks_mut(2).enumerate() {
                cell.copy_from_slice(&self.cell_slopes(i, j));
            }
        });
        slopes
    }

    /// Area of all facets that face ω, seen from there, per area of the tile: `⟨(ω_z − s·ω_xy)⁺⟩`.
    pub fn projected_area(&self, w: DVec3) -> f64 {
        // row by row, so that the sum does not depend on the number of threads
        let rows: Vec<f64> = (0..self.ny)
            .into_par_iter()
            .map(|j| {
                let facing = |s: &DVec2| (w.z - s.x * w.x - s.y * w.y).max(0.0);
                (0..self.nx).map(|i| self.cell_slopes(i, j).iter().map(facing).sum::<f64>()).sum()
            })
            .collect();
        rows.iter().sum::<f64>() / self.facets() as f64
    }

    /// Smith's G1 of the surface's own distribution of slopes, which for a periodic height field is its mean masking as well:
    /// the visible area is cos θ, whatever the arrangement of facets.
    pub fn g1(&self, w: DVec3) -> f64 {
        if w.z <= 0.0 { 0.0 } else { w.z / self.projected_area(w) }
    }

    /// `Λ = tan θ ⟨(s_θ − cot θ)⁺⟩` of the surface's own distribution, s_θ the slope along ω: by the one-sided integral of Smith's theory, not by
    /// areas.
    pub fn lambda(&self, w: DVec3) -> f64 {
        let rows: Vec<f64> = (0..self.ny)
            .into_par_iter()
            .map(|j| {
                let hidden = |s: &DVec2| (s.x * w.x + s.y * w.y - w.z).max(0.0);
                (0..self.nx).map(|i| self.cell_slopes(i, j).iter().map(hidden).sum::<f64>()).sum()
            })
            .collect();
        rows.iter().sum::<f64>() / (self.facets() as f64 * w.z)
    }

    /// Least and greatest height.
    pub fn range(&self) -> (f64, f64) {
        self.heights.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &h| (low.min(h), high.max(h)))
    }
}

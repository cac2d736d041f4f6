//! Least and greatest heights over blocks of cells: what a ray may skip.

use super::surface::Surface;
use rayon::prelude::*;

/// Bounds of the heights of a block, rounded outwards.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    pub(super) low: f32,
    pub(super) high: f32,
}

impl Bounds {
    fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }
}

/// Blocks of 1, 2, 4, … cells along each side; those at the end of a tile may be smaller.
pub(super) struct Pyramid {
    levels: Vec<Level>,
}

struct Level {
    width: usize,
    bounds: Vec<Bounds>,
}

impl Pyramid {
    pub(super) fn new(surface: &Surface) -> Self {
        let (mut width, mut height) = (surface.nx(), surface.ny());
        let mut bounds = vec![Bounds { low: 0.0, high: 0.0 }; width * height];
        bounds.par_chunks_mut(width).enumerate().for_each(|(j, row)| {
            for (i, bounds) in row.iter_mut().enumerate() {
                let corners = surface.corners(i, j);
                let low = corners.iter().fold(f64::INFINITY, |low, &h| low.min(h));
                let high = corners.iter().fold(f64::NEG_INFINITY, |high, &h| high.max(h));
                *bounds = Bounds { low: -up(-low), high: up(high) };
            }
        });
        let mut levels = vec![Level { width, bounds }];
        while width > 1 || height > 1 {
            let below = &levels[levels.len() - 1];
            let (wide, high) = (width.div_ceil(2), height.div_ceil(2));
            let bounds = (0..wide * high)
                .map(|k| {
                    let (i, j) = (2 * (k % wide), 2 * (k / wide));
                    let (right, above) = ((i + 1).min(width - 1), (j + 1).min(height - 1));
                    let at = |i: usize, j: usize| below.bounds[j * width + i];
                    at(i, j).union(at(right, j)).union(at(i, above)).union(at(right, above))
                })
                .collect();
            (width, height) = (wide, high);
            levels.push(Level { width, bounds });
        }
        Self { levels }
    }

    pub(super) fn top(&self) -> usize {
        self.levels.len() - 1
    }

    /// Bounds of the block of 2^level cells that a cell is in.
    #[inline]
    pub(super) fn bounds(&self, level: usize, i: usize, j: usize) -> Bounds {
        let Level { width, bounds } = &self.levels[level];
        bounds[(j >> level) * width + (i >> level)]
    }

    /// Bounds of the whole tile.
    pub(super) fn all(&self) -> Bounds {
        self.bounds(self.top(), 0, 0)
    }
}

/// The least single-precision number that is not below.
fn up(x: f64) -> f32 {
    let nearest = x as f32;
    if f64::from(nearest) < x { nearest.next_up() } else { nearest }
}

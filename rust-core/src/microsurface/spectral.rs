//! Fourier transforms of periodic grids, and the height field whose gradient is nearest to a given field of edges.

use rayon::prelude::*;
use realfft::num_complex::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};
use std::f64::consts::PI;
use std::sync::Arc;

/// Plans for one size of grid; rows are x, contiguous.
pub(super) struct Spectral {
    nx: usize,
    ny: usize,
    rows_forward: Arc<dyn RealToComplex<f64>>,
    rows_backward: Arc<dyn ComplexToReal<f64>>,
    columns_forward: Arc<dyn Fft<f64>>,
    columns_backward: Arc<dyn Fft<f64>>,
    /// half a spectrum, its columns contiguous
    columns: Vec<Complex<f64>>,
    /// the same, its rows contiguous
    rows: Vec<Complex<f64>>,
}

impl Spectral {
    pub(super) fn new(nx: usize, ny: usize) -> Self {
        let mut real = RealFftPlanner::new();
        let mut complex = FftPlanner::new();
        let half = (nx / 2 + 1) * ny;
        Self {
            nx,
            ny,
            rows_forward: real.plan_fft_forward(nx),
            rows_backward: real.plan_fft_inverse(nx),
            columns_forward: complex.plan_fft_forward(ny),
            columns_backward: complex.plan_fft_inverse(ny),
            columns: vec![Complex::default(); half],
            rows: vec![Complex::default(); half],
        }
    }

    /// Multiplies the spectrum of a grid by `factor(cos k_x, cos k_y)` over the number of its points, in place.
    pub(super) fn filter(&mut self, grid: &mut [f64], factor: impl Fn(f64, f64) -> f64 + Sync) {
        let (nx, ny, half) = (self.nx, self.ny, self.nx / 2 + 1);
        self.rows.par_chunks_mut(half).zip(grid.par_chunks_mut(nx)).for_each_init(
            || self.rows_forward.make_scratch_vec(),
            |scratch, (out, row)| {
                // the lengths are those of the plan: nothing else can fail
                let _ = self.rows_forward.process_with_scratch(row, out, scratch);
            },
        );
        transpose(&self.rows, &mut self.columns, half, ny);
        let cosines: Vec<f64> = (0..ny).map(|j| (2.0 * PI * j as f64 / ny as f64).cos()).collect();
        let normalization = 1.0 / (nx as f64 * ny as f64);
        self.columns.par_chunks_mut(ny).enumerate().for_each_init(
            || vec![Complex::default(); self.columns_forward.get_inplace_scratch_len()],
            |scratch, (i, column)| {
                self.columns_forward.process_with_scratch(column, scratch);
                let along_x = (2.0 * PI * i as f64 / nx as f64).cos();
                for (value, &along_y) in column.iter_mut().zip(&cosines) {
                    *value *= normalization * factor(along_x, along_y);
                }
                self.columns_backward.process_with_scratch(column, scratch);
                // a row of real numbers has real ends; rounding leaves a trace that the inverse would refuse
                if i == 0 || 2 * i == nx {
                    column.iter_mut().for_each(|value| value.im = 0.0);
                }
            },
        );
        transpose(&self.columns, &mut self.rows, ny, half);
        self.rows.par_chunks_mut(half).zip(grid.par_chunks_mut(nx)).for_each_init(
            || self.rows_backward.make_scratch_vec(),
            |scratch, (row, out)| {
                let _ = self.rows_backward.process_with_scratch(row, out, scratch);
            },
        );
    }

    /// The heights of mean 0 whose differences along x and y are nearest to a field with this negative divergence: the five-point
    /// Poisson equation on a torus, in place.
    pub(super) fn integrate(&mut self, negative_divergence: &mut [f64]) {
        self.filter(negative_divergence, |x, y| {
            let laplacian = 4.0 - 2.0 * x - 2.0 * y;
            if laplacian > 0.0 { 1.0 / laplacian } else { 0.0 }
        });
    }
}

/// `to[i][j] = from[j][i]`, in blocks that stay in the cache.
fn transpose(from: &[Complex<f64>], to: &mut [Complex<f64>], width: usize, height: usize) {
    const BLOCK: usize = 16;
    to.par_chunks_mut(BLOCK * height).enumerate().for_each(|(block, to)| {
        let first = block * BLOCK;
        for j0 in (0..height).step_by(BLOCK) {
            for (i, row) in to.chunks_mut(height).enumerate() {
                for j in j0..(j0 + BLOCK).min(height) {
                    row[j] = from[j * width + first + i];
                }
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Differences of known heights lead back to them, on grids that are not square and not powers of two as well.
    #[test]
    fn heights_come_back_from_their_differences() {
        for (nx, ny) in [(8, 8), (12, 20), (9, 7), (64, 32)] {
            let mut heights: Vec<f64> = (0..nx * ny).map(|k| ((k * k * 7 + k) % 101) as f64 / 101.0).collect();
            let mean = heights.iter().sum::<f64>() / (nx * ny) as f64;
            heights.iter_mut().for_each(|h| *h -= mean);
            let at = |i: usize, j: usize| heights[(j % ny) * nx + i % nx];
            let mut field: Vec<f64> = (0..nx * ny)
                .map(|k| {
                    let (i, j) = (k % nx, k / nx);
                    4.0 * at(i, j) - at(i + 1, j) - at(i + nx - 1, j) - at(i, j + 1) - at(i, j + ny - 1)
                })
                .collect();
            Spectral::new(nx, ny).integrate(&mut field);
            let worst = field.iter().zip(&heights).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-13, "{nx} × {ny}: {worst:.1e}");
        }
    }
}

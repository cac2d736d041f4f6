//! Functions known at points of [0, 1] along one axis of an array: derivatives there, and values at other points.

use std::f64::consts::PI;

/// Points of [0, 1], ascending, ends included, at which a function is known along the first axis of an array.
pub(crate) struct Axis {
    pub(crate) at: Vec<f64>,
    /// Even ones are joined piece by piece, Chebyshev's points of the second kind by one polynomial through all.
    even: bool,
}

impl Axis {
    /// All nodes of a grid, or Chebyshev's points if fewer.
    pub(crate) fn new(count: usize, grid: usize) -> Self {
        if count == grid { Self::even(grid) } else { Self::chebyshev(count) }
    }
    pub(crate) fn even(count: usize) -> Self {
        Self { at: (0..count).map(|k| k as f64 / (count - 1) as f64).collect(), even: true }
    }
    fn chebyshev(count: usize) -> Self {
        let at = (0..count).map(|k| 0.5 - 0.5 * (PI * k as f64 / (count - 1) as f64).cos()).collect();
        Self { at, even: false }
    }
    /// Values at `count` even points.
    pub(crate) fn fill(&self, values: &[f64], count: usize) -> Vec<f64> {
        if self.even && self.at.len() == count { values.to_vec() } else { along_first(&self.at, values, count) }
    }
    /// Derivatives at the nodes.
    pub(crate) fn derivative(&self, values: &[f64]) -> Vec<f64> {
        if self.even { differences(self.at.len(), values) } else { derivative(&self.at, values) }
    }
}

/// The cell of a coordinate in [0, 1], and the place in it.
pub(crate) fn locate(x: f64, count: usize) -> (usize, f64) {
    let x = x.clamp(0.0, 1.0) * (count - 1) as f64;
    let cell = (x as usize).min(count - 2);
    (cell, x - cell as f64)
}

/// Derivatives along the first axis at `count` even points of [0, 1], from the polynomial through five neighbors: their closed form is
/// `Σ_{j≠k} (w_j/w_k)(f_j − f_k)/(k − j)` with the barycentric weights `(−1)^j C(4, j)`.
fn differences(count: usize, values: &[f64]) -> Vec<f64> {
    const WEIGHTS: [f64; 5] = [1.0, -4.0, 6.0, -4.0, 1.0];
    let inner = values.len() / count;
    let mut out = vec![0.0; values.len()];
    for (k, out) in out.chunks_exact_mut(inner).enumerate() {
        let first = k.saturating_sub(2).min(count - 5);
        let own = &values[k * inner..][..inner];
        for (j, weight) in WEIGHTS.iter().enumerate().filter(|&(j, _)| first + j != k) {
            let step = (k as f64 - (first + j) as f64) / (count - 1) as f64;
            let share = weight / WEIGHTS[k - first] / step;
            let other = &values[(first + j) * inner..][..inner];
            for (out, (other, own)) in out.iter_mut().zip(other.iter().zip(own)) {
                *out += share * (other - own);
            }
        }
    }
    out
}

/// Barycentric weights of Chebyshev's points.
fn weight(k: usize, count: usize) -> f64 {
    let size = if k == 0 || k == count - 1 { 0.5 } else { 1.0 };
    if k.is_multiple_of(2) { size } else { -size }
}

/// Values at `count` even points from values at Chebyshev's, along the first axis: the barycentric formula (Berrut & Trefethen 2004,
/// Eq. 4.2 with 5.4).
fn along_first(nodes: &[f64], values: &[f64], count: usize) -> Vec<f64> {
    let inner = values.len() / nodes.len();
    let mut out = vec![0.0; count * inner];
    for (k, out) in out.chunks_exact_mut(inner).enumerate() {
        let x = k as f64 / (count - 1) as f64;
        if let Some(hit) = nodes.iter().position(|&node| (node - x).abs() < 1e-14) {
            out.copy_from_slice(&values[hit * inner..][..inner]);
            continue;
        }
        let weights: Vec<f64> =
            nodes.iter().enumerate().map(|(j, &node)| weight(j, nodes.len()) / (x - node)).collect();
        let sum: f64 = weights.iter().sum();
        for (weight, values) in weights.iter().zip(values.chunks_exact(inner)) {
            out.iter_mut().zip(values).for_each(|(out, value)| *out += weight / sum * value);
        }
    }
    out
}

/// Derivatives along the first axis at Chebyshev's points of the polynomials through the values there (Berrut & Trefethen 2004, Eq. 9.4).
fn derivative(nodes: &[f64], values: &[f64]) -> Vec<f64> {
    let count = nodes.len();
    let inner = values.len() / count;
    let mut out = vec![0.0; values.len()];
    for (k, out) in out.chunks_exact_mut(inner).enumerate() {
        let own = &values[k * inner..][..inner];
        for (j, other) in values.chunks_exact(inner).enumerate().filter(|&(j, _)| j != k) {
            let share = weight(j, count) / weight(k, count) / (nodes[k] - nodes[j]);
            for (out, (other, own)) in out.iter_mut().zip(other.iter().zip(own)) {
                *out += share * (other - own);
            }
        }
    }
    out
}

/// Moves the first axis, of the given length, behind the others.
pub(crate) fn transposed(values: &[f64], first: usize) -> Vec<f64> {
    let inner = values.len() / first;
    (0..inner).flat_map(|j| (0..first).map(move |i| values[i * inner + j])).collect()
}

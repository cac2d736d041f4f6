//! Tables of points as users bring them, by chance: smooth, noisy, rings with an empty middle, one giant cell, cliffs.
#![allow(dead_code)] // every test crate uses a part of it

use super::Random;
use sgtd_core::profile::{TableTail, TabulatedProfile};

/// The kinds of [`random_table`].
pub const KINDS: u32 = 8;

/// Slopes, values and tail.
#[derive(Debug, Clone)]
pub struct Points {
    /// tan θ
    pub slopes: Vec<f64>,
    /// D cos⁴
    pub values: Vec<f64>,
    /// What lies beyond.
    pub tail: TableTail,
}

impl Points {
    /// The profile.
    pub fn profile(&self) -> TabulatedProfile {
        TabulatedProfile::new(&self.slopes, &self.values, self.tail).unwrap_or_else(|error| panic!("{self:?}: {error}"))
    }
}

/// A table with so many nodes.
pub fn random_table(random: &mut Random, kind: u32, count: usize) -> Points {
    let alpha = random.log_between(0.01, 3.0);
    let mut slopes: Vec<f64> = match random.below(3) {
        // even in angle
        0 => (0..count).map(|k| (k as f64 / count as f64 * 1.55).tan()).collect(),
        // even in slope
        1 => (0..count).map(|k| 8.0 * alpha * k as f64 / count as f64).collect(),
        _ => {
            let mut slopes: Vec<f64> = (0..count).map(|_| alpha * random.log_between(1e-3, 30.0)).collect();
            slopes.sort_by(f64::total_cmp);
            slopes
        }
    };
    slopes.dedup_by(|a, b| *a <= *b * (1.0 + 1e-12));
    let student = |x: f64, gamma: f64| (1.0 + (x / alpha).powi(2) / (gamma - 1.0)).powf(-gamma);
    let gamma = random.between(1.6, 6.0);
    let power = TableTail::Power(Some(random.between(3.05, 9.0)));
    let tail = if random.below(2) == 0 { power } else { TableTail::Cut };
    let (mut tail, mut values): (TableTail, Vec<f64>) = match kind {
        0 => (tail, slopes.iter().map(|&x| student(x, gamma)).collect()),
        1 => (tail, slopes.iter().map(|&x| (-(x / alpha).powi(2)).exp()).collect()),
        // noise of 5 %, and of a factor of 30
        2 => (tail, slopes.iter().map(|&x| student(x, gamma) * random.between(0.95, 1.05)).collect()),
        3 => (tail, slopes.iter().map(|_| random.log_between(0.03, 1.0)).collect()),
        // a ring whose middle is empty
        4 => (tail, slopes.iter().map(|&x| if x < alpha { 0.0 } else { student(x - alpha, gamma) }).collect()),
        // zeros by chance
        5 => (tail, slopes.iter().map(|_| if random.below(3) == 0 { 0.0 } else { random.unit() }).collect()),
        // cliffs
        6 => (tail, slopes.iter().map(|_| random.log_between(1e-60, 1.0)).collect()),
        // a step
        _ => (tail, slopes.iter().map(|&x| if x < alpha { 1.0 } else { 1e-3 }).collect()),
    };
    if values.iter().all(|&value| value < 1e-290) {
        values[0] = 1.0;
    }
    if slopes.len() < 2 {
        (slopes, values, tail) = (vec![0.0, alpha], vec![1.0, 0.5], power);
    }
    Points { slopes, values, tail }
}

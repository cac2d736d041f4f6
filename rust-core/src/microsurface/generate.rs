//! A periodic surface whose facets have the slopes of a given distribution.
//!
//! A Gaussian field is moved, step by step, onto the target. Radial slopes become scores (`scores`) in which every isotropic target is a
//! pair of independent normal numbers. There the histogram is mapped onto its target by smooth functions of the slope (a radial map, then maps
//! along random directions), never facet by facet: that would fit noise. The displacements, each bounded, are projected onto
//! gradients of heights.

use super::agreement::{self, Agreement};
use super::scores::Scores;
use super::spectral::Spectral;
use super::surface::{POINTS, Surface};
use super::transport::{Histogram, Map, normal_quantile};
use crate::error::{ParameterError, require};
use crate::profile::Profile;
use glam::DVec2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;
use std::f64::consts::PI;

/// What a surface should be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Points along each side of the tile.
    pub size: usize,
    /// Correlation length of the heights it begins with, in points: their covariance is exp(−d²/ℓ²).
    pub correlation: f64,
    /// Of all random numbers.
    pub seed: u64,
    /// Kolmogorov–Smirnov distance at which it stops, if radius and azimuth together are as even as those of independent facets.
    pub tolerance: f64,
    /// Steps after which it stops anyway.
    pub steps: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { size: 512, correlation: 8.0, seed: 0, tolerance: 1e-3, steps: 200 }
    }
}

impl Settings {
    fn check(&self) -> Result<(), ParameterError> {
        require(
            POINTS.contains(&self.size) && self.size >= 16,
            "size",
            self.size as f64,
            "between 16 and 16384",
            "it is the number of points along each side; 512 give half a million facets",
        )?;
        require(
            self.correlation >= 1.0 && self.correlation <= self.size as f64 / 4.0,
            "correlation",
            self.correlation,
            "between 1 and a quarter of the size",
            "it is the correlation length in points; 8 suits most shapes, thin rings want 16",
        )?;
        require(
            self.tolerance > 0.0 && self.tolerance < 1.0,
            "tolerance",
            self.tolerance,
            "between 0 and 1",
            "it is a distance of distributions; 1e-3 is what half a million independent facets have",
        )?;
        require(self.steps >= 1, "steps", self.steps as f64, "at least 1", "24 suit most shapes")
    }
}

/// A surface at unit roughness and unit spacing, and how near it came.
#[derive(Debug, Clone, PartialEq)]
pub struct Generated {
    /// The surface; [`Surface::stretched`] gives it a roughness.
    pub surface: Surface,
    /// Its slopes against the profile.
    pub agreement: Agreement,
    /// Steps that were made.
    pub steps: usize,
}

/// Makes a surface whose slopes have the distribution of `profile`; after each step `watch` is told the distance that the step began with,
/// and may stop it by returning false.
///
/// # Errors
/// Names the setting that is out of range.
pub fn generate(
    profile: &dyn Profile,
    settings: &Settings,
    mut watch: impl FnMut(usize, f64) -> bool,
) -> Result<Generated, ParameterError> {
    settings.check()?;
    let mut field = Field::new(profile, settings);
    let (mut best, mut heights) = (f64::INFINITY, Vec::new());
    let (mut steps, mut seen) = (0, SEEN);
    loop {
        let distance = field.distance();
        // above 1 while either is not what was asked for
        let excess = (distance / (seen * settings.tolerance)).max(field.unevenness());
        if excess < best {
            best = excess;
            heights.clone_from(&field.heights);
        }
        let ends = !watch(steps, distance) || steps == settings.steps;
        if ends || (best <= 1.0 && steps >= LEAST_STEPS) {
            let surface = Surface::new(settings.size, settings.size, DVec2::ONE, heights.clone())?;
            let agreement = Agreement::of(&surface, DVec2::ONE, profile);
            if ends || agreement.ks <= settings.tolerance {
                return Ok(Generated { surface, agreement, steps });
            }
            // the histogram has not seen what it should have
            seen *= SEEN;
            best = f64::INFINITY;
        }
        field.step(steps);
        steps += 1;
    }
}

/// The distance of a step is taken at the edges of a histogram: between them it is greater by a few percent.
const SEEN: f64 = 0.9;
/// So many are made in any case: they cost a second at 512² and lower the distance to a fifth of the default tolerance.
const LEAST_STEPS: usize = 24;
/// Steps without a bound on displacements: far from the target it would only delay.
const FREE_STEPS: usize = 6;
/// Greatest displacement of a slope per step, in units of the roughness: more makes tails leak into what is near.
const BOUND: f64 = 0.3;
/// A projection keeps about half of a displacement. 1.5 needs more steps for rings, 1.8 loses more of heavy tails.
const RELAXATION: f64 = 1.7;
/// Greatest slope aimed at, in units of the roughness and of the points along a side: where half a million facets have slopes of 1e5, the gradient
/// that is nearest to them is wrong everywhere else (KS 3e-3 at 2pγ = 3.1, 3e-4 with this bound).
const STEEPEST: f64 = 4.0;
/// Directions of a step, evenly spaced from a random one.
const DIRECTIONS: usize = 4;
/// Range of scores in histograms.
const GREATEST_SCORE: f64 = 8.0;

struct Field {
    n: usize,
    heights: Vec<f64>,
    scores: Scores,
    spectral: Spectral,
    /// per facet: scores, then displacements of slopes
    facets: Vec<DVec2>,
    work: Vec<f64>,
    radial: Histogram,
    random: ChaCha8Rng,
}

impl Field {
    fn new(profile: &dyn Profile, settings: &Settings) -> Self {
        let n = settings.size;
        let mut heights = vec![0.0; n * n];
        heights.par_chunks_mut(n).enumerate().for_each(|(j, row)| {
            let mut random = ChaCha8Rng::seed_from_u64(settings.seed);
            random.set_stream(1 + j as u64);
            for pair in row.chunks_mut(2) {
                let (radius, angle) = ((-2.0 * (1.0 - unit(&mut random)).ln()).sqrt(), 2.0 * PI * unit(&mut random));
                let normal = [radius * angle.cos(), radius * angle.sin()];
                pair.iter_mut().zip(normal).for_each(|(height, normal)| *height = normal);
            }
        });
        let mut spectral = Spectral::new(n, n);
        // the square root of the spectrum of exp(−d²/ℓ²)
        let width = settings.correlation * settings.correlation / 8.0;
        spectral.filter(&mut heights, |x, y| {
            let (kx, ky) = (x.clamp(-1.0, 1.0).acos(), y.clamp(-1.0, 1.0).acos());
            if kx + ky > 0.0 { (-width * (kx * kx + ky * ky)).exp() } else { 0.0 }
        });
        let mut field = Self {
            n,
            heights,
            scores: Scores::new(profile),
            spectral,
            facets: vec![DVec2::ZERO; 2 * n * n],
            work: vec![0.0; n * n],
            radial: Histogram::new(&[] as &[f64], 0.0, GREATEST_SCORE, |&y| y),
            random: ChaCha8Rng::seed_from_u64(settings.seed),
        };
        field.read_slopes(|slope| slope);
        let mean = field.facets.iter().map(|s| s.length()).sum::<f64>() / field.facets.len() as f64;
        let scale = profile.mean() / mean;
        field.heights.iter_mut().for_each(|h| *h *= scale);
        field.read_scores();
        field
    }

    /// A function of the slope of each facet, at unit spacing.
    fn read_slopes(&mut self, value: impl Fn(DVec2) -> DVec2 + Sync) {
        let (n, heights) = (self.n, &self.heights);
        self.facets.par_chunks_mut(2 * n).enumerate().for_each(|(j, row)| {
            let here = &heights[j * n..(j + 1) * n];
            let above = (j + 1) % n * n;
            let above = &heights[above..above + n];
            for (i, cell) in row.chunks_mut(2).enumerate() {
                let right = if i + 1 == n { 0 } else { i + 1 };
                let (a, b, c, d) = (here[i], here[right], above[i], above[right]);
                cell[0] = value(DVec2::new(b - a, c - a));
                cell[1] = value(DVec2::new(d - c, d - b));
            }
        });
    }

    fn read_scores(&mut self) {
        let scores = std::mem::replace(&mut self.scores, Scores::empty());
        self.read_slopes(|slope| {
            let radius = slope.length();
            if radius > 0.0 { slope * (scores.score(radius) / radius) } else { DVec2::ZERO }
        });
        self.scores = scores;
        self.radial = Histogram::new(&self.facets, 0.0, GREATEST_SCORE, |y| y.length());
    }

    /// Kolmogorov–Smirnov distance of the radial slopes, at the edges of a fine histogram.
    fn distance(&self) -> f64 {
        self.radial.distance(|y| -(-0.5 * y * y).exp_m1())
    }

    /// Total variation of radius and azimuth over that of independent facets.
    fn unevenness(&self) -> f64 {
        let tv = agreement::total_variation(&self.facets, |y| -(-0.5 * y * y).exp_m1());
        tv / agreement::independent_variation(self.facets.len())
    }

    fn step(&mut self, step: usize) {
        let radial = self.radial.map_to(|_, above| (-2.0 * above.ln()).sqrt());
        self.facets.par_iter_mut().for_each(|y| {
            let radius = y.length();
            if radius > 0.0 {
                *y *= radial.at(radius).max(0.0) / radius;
            }
        });
        let start = unit(&mut self.random) * PI;
        for k in 0..DIRECTIONS {
            // each direction is followed by the one across it
            let quarter = (k % 2) as f64 / 2.0 + (k / 2) as f64 / DIRECTIONS as f64;
            let direction = DVec2::from_angle(start + PI * quarter);
            let map: Map = Histogram::new(&self.facets, -GREATEST_SCORE, GREATEST_SCORE, |y| y.dot(direction))
                .map_to(normal_quantile);
            self.facets.par_iter_mut().for_each(|y| {
                let along = y.dot(direction);
                *y += (map.at(along) - along) * direction;
            });
        }
        self.displace(if step < FREE_STEPS { f64::INFINITY } else { BOUND });
        self.read_scores();
    }

    /// Moves the heights so that slopes come as near as they can to those of the scores.
    fn displace(&mut self, bound: f64) {
        let n = self.n;
        let (heights, scores) = (&self.heights, &self.scores);
        let steepest = STEEPEST * n as f64;
        let displacement = |score: DVec2, slope: DVec2| {
            let radius = score.length();
            let target = if radius > 0.0 { score * (scores.slope(radius).min(steepest) / radius) } else { DVec2::ZERO };
            let away = target - slope;
            away / (1.0 + away.length_squared() / (bound * bound)).sqrt()
        };
        self.facets.par_chunks_mut(2 * n).enumerate().for_each(|(j, row)| {
            let here = &heights[j * n..(j + 1) * n];
            let above = (j + 1) % n * n;
            let above = &heights[above..above + n];
            for (i, cell) in row.chunks_mut(2).enumerate() {
                let right = if i + 1 == n { 0 } else { i + 1 };
                let (a, b, c, d) = (here[i], here[right], above[i], above[right]);
                cell[0] = displacement(cell[0], DVec2::new(b - a, c - a));
                cell[1] = displacement(cell[1], DVec2::new(d - c, d - b));
            }
        });
        let facets = &self.facets;
        self.work.par_chunks_mut(n).enumerate().for_each(|(j, row)| {
            let here = &facets[2 * j * n..2 * (j + 1) * n];
            let below = (j + n - 1) % n * 2 * n;
            let below = &facets[below..below + 2 * n];
            for (i, value) in row.iter_mut().enumerate() {
                let left = if i == 0 { n - 1 } else { i - 1 };
                // each edge has a facet on both sides
                let along_x = |i: usize| 0.5 * (here[2 * i].x + below[2 * i + 1].x);
                let up = 0.5 * (here[2 * i].y + here[2 * left + 1].y);
                let down = 0.5 * (below[2 * i].y + below[2 * left + 1].y);
                *value = along_x(left) - along_x(i) + down - up;
            }
        });
        self.spectral.integrate(&mut self.work);
        self.heights.iter_mut().zip(&self.work).for_each(|(h, move_by)| *h += RELAXATION * move_by);
    }
}

/// Evenly in [0, 1), 53 bits.
pub(super) fn unit(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

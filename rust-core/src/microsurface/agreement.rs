//! How near the slopes of a surface are to a distribution.

use super::surface::Surface;
use crate::profile::Profile;
use glam::DVec2;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Distances between the histogram of facet slopes and its target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Kolmogorov–Smirnov distance of the radial slopes.
    pub ks: f64,
    /// Total variation over 64 × 32 bins of radius and azimuth that have the same probability.
    pub tv: f64,
    /// What as many independent facets have of it, on average.
    pub tv_independent: f64,
    /// Greatest relative error among 100 radial bins of the same probability.
    pub worst_bin: f64,
    /// Mean length of the stretched slopes over that of the target, less 1: heavy tails end at a finite facet.
    pub mean_error: f64,
}

/// Bins of the radius and of the azimuth, and radial bins of [`Agreement::worst_bin`].
const RADII: usize = 64;
const AZIMUTHS: usize = 32;
const RADIAL: usize = 100;

impl Agreement {
    /// Of a surface whose slopes, divided by the roughness `alpha`, should have this profile.
    pub fn of(surface: &Surface, alpha: DVec2, profile: &dyn Profile) -> Self {
        let slopes: Vec<DVec2> = surface.slopes().into_iter().map(|s| s / alpha).collect();
        Self::of_slopes(&slopes, profile)
    }

    /// Of stretched slopes, one per facet.
    pub fn of_slopes(slopes: &[DVec2], profile: &dyn Profile) -> Self {
        let count = slopes.len() as f64;
        let mut radii: Vec<f64> = slopes.par_iter().map(|s| s.length()).collect();
        let edges: Vec<f64> = (1..RADII).map(|k| profile.quantile(k as f64 / RADII as f64)).collect();
        let share = |r: f64| (edges.partition_point(|&edge| edge <= r) as f64 + 0.5) / RADII as f64;
        let tv = total_variation(slopes, share);
        let mean_error = radii.iter().sum::<f64>() / (count * profile.mean()) - 1.0;
        radii.par_sort_unstable_by(f64::total_cmp);
        let ks = radii
            .par_iter()
            .enumerate()
            .map(|(k, &r)| {
                let share = if r < 1e300 { profile.cdf(r) } else { 1.0 };
                (share - k as f64 / count).max((k + 1) as f64 / count - share)
            })
            .reduce(|| 0.0, f64::max);
        let below = |share: f64| match share {
            0.0 => 0,
            1.0 => radii.len(),
            _ => radii.partition_point(|&r| r < profile.quantile(share)),
        };
        let worst_bin = (0..RADIAL)
            .map(|k| below((k + 1) as f64 / RADIAL as f64) - below(k as f64 / RADIAL as f64))
            .map(|found| (found as f64 * RADIAL as f64 / count - 1.0).abs())
            .fold(0.0, f64::max);
        Self { ks, tv, tv_independent: independent_variation(slopes.len()), worst_bin, mean_error }
    }
}

/// Total variation of plane vectors over bins of azimuth and of the share of lengths below theirs.
pub(super) fn total_variation(vectors: &[DVec2], share_below: impl Fn(f64) -> f64 + Sync) -> f64 {
    const CHUNK: usize = 1 << 14;
    let bins = vectors
        .par_chunks(CHUNK)
        .map(|vectors| {
            let mut bins = vec![0_u32; RADII * AZIMUTHS];
            for vector in vectors {
                let turn = vector.y.atan2(vector.x) / (2.0 * PI) + 0.5;
                let azimuth = ((turn * AZIMUTHS as f64) as usize).min(AZIMUTHS - 1);
                let radius = ((share_below(vector.length()) * RADII as f64) as usize).min(RADII - 1);
                bins[radius * AZIMUTHS + azimuth] += 1;
            }
            bins
        })
        .reduce(
            || vec![0; RADII * AZIMUTHS],
            |mut a, b| {
                a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                a
            },
        );
    let count = vectors.len() as f64;
    let expected = count / bins.len() as f64;
    bins.iter().map(|&found| (f64::from(found) - expected).abs()).sum::<f64>() / (2.0 * count)
}

/// What independent vectors have of it on average: E|n − μ| of a count of mean μ is √(2μ/π).
pub(super) fn independent_variation(count: usize) -> f64 {
    ((RADII * AZIMUTHS) as f64 / (2.0 * PI * count as f64)).sqrt()
}

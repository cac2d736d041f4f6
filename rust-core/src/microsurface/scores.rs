//! Slopes as scores: `y = √(−2 ln sf(r))`, the radius of a pair of independent normal numbers where r is the radius of a slope of the target.

use crate::profile::Profile;

/// Radius of slopes against radius of scores, linear between nodes: one map and its exact inverse.
pub(super) struct Scores {
    /// slopes at nodes that are `STEP` apart
    radii: Vec<f64>,
    /// for each bucket of slopes, the first node that its slopes may lie beyond
    first: Vec<u32>,
    /// the slope in the middle of the buckets
    scale: f64,
}

/// Between two nodes lie 1e-3 of all slopes at the most, and the map bends by less than 1e-5 of them.
const STEP: f64 = 1.0 / 256.0;
/// Beyond it lie 1e-16 of all slopes.
const GREATEST: f64 = 8.5;
const BUCKETS: usize = 4096;

impl Scores {
    /// No map.
    pub(super) fn empty() -> Self {
        Self { radii: Vec::new(), first: Vec::new(), scale: 1.0 }
    }

    pub(super) fn new(profile: &dyn Profile) -> Self {
        let count = (GREATEST / STEP) as usize + 1;
        let mut radii = vec![0.0];
        for k in 1..count {
            let square = (k as f64 * STEP).powi(2);
            let exact = if square < 1.0 {
                profile.quantile(-(-0.5 * square).exp_m1())
            } else {
                profile.isf((-0.5 * square).exp())
            };
            // thin rings: neighbors may round to the same number
            let previous: f64 = radii[k - 1];
            radii.push(exact.max(previous * (1.0 + 1e-15)).max(f64::MIN_POSITIVE));
        }
        let scale = profile.isf(0.5);
        let mut first = vec![0; BUCKETS];
        for (bucket, first) in first.iter_mut().enumerate() {
            let share = bucket as f64 / BUCKETS as f64;
            let edge = scale * share / (1.0 - share);
            *first = radii.partition_point(|&r| r <= edge).saturating_sub(1) as u32;
        }
        Self { radii, first, scale }
    }

    /// The score of a slope.
    pub(super) fn score(&self, r: f64) -> f64 {
        let bucket = ((r / (r + self.scale) * BUCKETS as f64) as usize).min(BUCKETS - 1);
        let last = self.radii.len() - 2;
        let mut node = (self.first[bucket] as usize).min(last);
        while node < last && self.radii[node + 1] <= r {
            node += 1;
        }
        // rounding of the bucket may have gone too far
        while node > 0 && self.radii[node] > r {
            node -= 1;
        }
        let (left, right) = (self.radii[node], self.radii[node + 1]);
        (node as f64 + (r - left) / (right - left)) * STEP
    }

    /// The slope of a score; linear beyond the last node.
    pub(super) fn slope(&self, y: f64) -> f64 {
        let at = y / STEP;
        let node = (at as usize).min(self.radii.len() - 2);
        let (left, right) = (self.radii[node], self.radii[node + 1]);
        (at - node as f64).mul_add(right - left, left)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::family::shape::Shape;
    use crate::family::skewed_t::SkewedT;

    #[test]
    fn scores_and_slopes_are_inverse() -> Result<(), crate::error::ParameterError> {
        for (gamma, p, lambda, shift) in
            [(2.0, 1.0, 0.0, 0.0), (f64::INFINITY, 3.0, 0.0, 5.0), (1.6, 1.0, 0.3, 0.0), (3.0, 2.0, 0.5, 30.0)]
        {
            let profile = SkewedT::new(Shape::new(gamma, p, lambda, shift)?);
            let scores = Scores::new(&profile);
            for k in 1..3000 {
                let y = f64::from(k) / 3000.0 * 8.0;
                let r = scores.slope(y);
                assert!((scores.score(r) - y).abs() < 1e-9, "{gamma} {shift}: {y}");
                let share = profile.sf(r);
                assert!((share - (-0.5 * y * y).exp()).abs() < 2e-5, "{gamma} {shift}: {y} {share}");
            }
        }
        Ok(())
    }
}

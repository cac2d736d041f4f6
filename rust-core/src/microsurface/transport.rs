//! Monotone maps that move one histogram onto a distribution, smooth at the scale of the histogram's noise.

use rayon::prelude::*;

/// A map that is linear between knots and a shift beyond them.
pub(super) struct Map {
    /// value of the map at the edges of even bins
    at: Vec<f64>,
    low: f64,
    per_width: f64,
    greatest: f64,
}

/// Even bins of histograms.
const BINS: usize = 4096;
/// Knots hold this share of the values; beyond the last one, fewer values decide on their own knot.
const SHARE: f64 = 1.0 / 400.0;
/// Values of the last knots. With 48 the tail of GGX stays .5 % short of its mean slope at 512², with 1 the heaviest tails leak.
const LEAST: u32 = 6;

/// Counts of values in even bins of [low, high); what lies outside is counted in the last ones.
pub(super) struct Histogram {
    low: f64,
    high: f64,
    counts: Vec<u32>,
}

impl Histogram {
    pub(super) fn new<T: Sync>(items: &[T], low: f64, high: f64, value: impl Fn(&T) -> f64 + Sync) -> Self {
        const CHUNK: usize = 1 << 15;
        let per_width = BINS as f64 / (high - low);
        let counts = items
            .par_chunks(CHUNK)
            .map(|chunk| {
                let mut counts = vec![0_u32; BINS];
                for item in chunk {
                    // saturates below and above
                    counts[(((value(item) - low) * per_width) as usize).min(BINS - 1)] += 1;
                }
                counts
            })
            .reduce(
                || vec![0; BINS],
                |mut a, b| {
                    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                    a
                },
            );
        Self { low, high, counts }
    }

    fn total(&self) -> u32 {
        self.counts.iter().sum()
    }

    fn edge(&self, bin: usize) -> f64 {
        self.low + (self.high - self.low) * bin as f64 / BINS as f64
    }

    /// Greatest distance at an edge between the share below it and `cdf`.
    pub(super) fn distance(&self, cdf: impl Fn(f64) -> f64) -> f64 {
        let total = f64::from(self.total());
        let mut below = 0.0;
        let mut greatest: f64 = 0.0;
        for (bin, &count) in self.counts.iter().enumerate() {
            below += f64::from(count);
            greatest = greatest.max((below / total - cdf(self.edge(bin + 1))).abs());
        }
        greatest
    }

    /// The map onto the distribution with this quantile of (share below, share above).
    pub(super) fn map_to(&self, quantile: impl Fn(f64, f64) -> f64) -> Map {
        let total = self.total();
        let full = ((f64::from(total) * SHARE) as u32).max(LEAST);
        // knots: (edge, value)
        let mut knots: Vec<(f64, f64)> = Vec::new();
        let (mut below, mut inside) = (0_u32, 0_u32);
        for (bin, &count) in self.counts.iter().enumerate() {
            inside += count;
            let above = total - below - inside;
            // a quarter of what is left beyond, where that is less
            let wanted = full.min((below.min(above) / 4).max(LEAST));
            if inside >= wanted && above >= LEAST {
                below += inside;
                inside = 0;
                let edge = self.edge(bin + 1);
                let share = f64::from(below) / f64::from(total);
                knots.push((edge, quantile(share, f64::from(above) / f64::from(total))));
            }
        }
        let mut at = Vec::with_capacity(BINS + 1);
        let mut next = 0;
        for bin in 0..=BINS {
            let x = self.edge(bin);
            while next < knots.len() && knots[next].0 < x {
                next += 1;
            }
            at.push(match (next.checked_sub(1).map(|k| knots[k]), knots.get(next)) {
                (Some((x0, y0)), Some(&(x1, y1))) => y0 + (x - x0) / (x1 - x0) * (y1 - y0),
                (Some((edge, value)), None) | (None, Some(&(edge, value))) => x + (value - edge),
                (None, None) => x,
            });
        }
        Map { at, low: self.low, per_width: BINS as f64 / (self.high - self.low), greatest: BINS as f64 }
    }
}

impl Map {
    pub(super) fn at(&self, x: f64) -> f64 {
        let at = (x - self.low) * self.per_width;
        if at < 0.0 {
            return x + (self.at[0] - self.low);
        }
        if at >= self.greatest {
            return x + (self.at[BINS] - (self.low + self.greatest / self.per_width));
        }
        let bin = at as usize;
        (at - bin as f64).mul_add(self.at[bin + 1] - self.at[bin], self.at[bin])
    }
}

/// The number that a normal number is below with this probability; from the smaller of the two shares.
pub(super) fn normal_quantile(below: f64, above: f64) -> f64 {
    if below < above {
        return -normal_quantile(above, below);
    }
    // Newton's method on ln of the complement, which is almost a parabola, from its leading term
    let target = above.max(1e-300);
    let mut x = (-2.0 * (2.0 * target).min(1.0).ln()).sqrt();
    for _ in 0..60 {
        let sf = 0.5 * libm::erfc(x * std::f64::consts::FRAC_1_SQRT_2);
        let density = (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
        let step = sf / density * (sf / target).ln();
        x += step;
        if step.abs() < 1e-12 {
            break;
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_normal_numbers() {
        for x in [0.0, 0.3, 1.0, 2.5, 6.0_f64] {
            let share = |x: f64| 0.5 * libm::erfc(x / 2.0_f64.sqrt());
            for x in [x, -x] {
                assert!((normal_quantile(share(-x), share(x)) - x).abs() < 1e-9, "{x}");
            }
        }
    }

    /// Even numbers become normal ones, and a histogram that fits is left alone.
    #[test]
    fn a_map_moves_a_histogram_onto_its_target() {
        let even: Vec<f64> = (0..200_000).map(|k| (f64::from(k) + 0.5) / 200_000.0).collect();
        let histogram = Histogram::new(&even, 0.0, 1.0, |&x| x);
        let map = histogram.map_to(normal_quantile);
        for u in [0.01, 0.2, 0.5, 0.9, 0.999] {
            assert!((map.at(u) - normal_quantile(u, 1.0 - u)).abs() < 0.02, "{u}");
        }
        let same = histogram.map_to(|below, _| below);
        for u in [-0.5, 0.0, 0.2, 0.7, 1.0, 2.0] {
            // as far apart as the numbers are, which do not reach 0 and 1
            assert!((same.at(u) - u).abs() < 5e-6, "{u}: {}", same.at(u));
        }
        assert!(histogram.distance(|u| u) < 5e-6 && histogram.distance(|u| u * u) > 0.2);
    }
}

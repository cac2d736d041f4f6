//! Any profile as a table with a given number of nodes.
//!
//! The nodes are placed where every cell has the same error: for a permitted error every cell, from the left on, goes as far as it may;
//! the error for which that takes as many nodes as there are is found by bisection. What counts is the relative error of f,
//! more where more normals are. Chords lie on one side of a bend, so at last the values at the nodes are moved by half of what is missing
//! between them.

use crate::error::ParameterError;
use crate::numerics::greatest;
use crate::profile::tabulated::{NODES, Nodes};
use crate::profile::{Profile, TableTail, TabulatedProfile, Tail};

/// A table made from a profile: what [`TabulatedProfile::with_knee`] takes.
#[derive(Debug, Clone)]
pub struct Resampled {
    /// The table.
    pub profile: TabulatedProfile,
    /// Its nodes, in the units of the profile it was made from.
    pub slopes: Vec<f64>,
    /// f at the nodes.
    pub values: Vec<f64>,
    /// What lies beyond.
    pub tail: TableTail,
    /// The knee, in the same units as the slopes.
    pub knee: f64,
}

/// Points between two break points at which errors are measured.
const POINTS: usize = 24;
/// A profile without a power tail ends where f, its mass and its mean slope beyond are below this share.
const SPENT: f64 = 1e-8;
/// Knees that are tried, in units of the median slope.
const KNEES: [f64; 11] = [0.02, 0.1, 0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 5.0, 10.0];
/// The error at which knees are compared.
const TRIAL: f64 = 0.01;
/// Below this ln f counts as 0: as in a table.
const LEAST_LOG: f64 = -690.0;
/// How often the values at the nodes are moved.
const MOVES: usize = 8;

/// A point of the profile.
#[derive(Debug, Clone, Copy)]
struct Point {
    x: f64,
    log_f: f64,
    /// how much its error counts
    weight: f64,
}

struct Curve {
    points: Vec<Point>,
    /// exponent of a power tail
    power: Option<f64>,
    /// index of the point where a profile without one may end
    end: usize,
}

impl Curve {
    fn new(profile: &dyn Profile) -> Self {
        let mut xs = vec![0.0];
        for right in profile.breaks(60.0) {
            let left = xs[xs.len() - 1];
            let ratio = if left > 0.0 { right / left } else { f64::INFINITY };
            for k in 1..=POINTS {
                let t = k as f64 / POINTS as f64;
                let x = if ratio < 1e3 && ratio > 2.0 { left * ratio.powf(t) } else { left + t * (right - left) };
                if x > xs[xs.len() - 1] {
                    xs.push(x);
                }
            }
        }
        let values: Vec<f64> = xs.iter().map(|&x| profile.f(x)).collect();
        let peak = greatest(values.iter().copied());
        // how many normals there are around x, in slopes and in area
        let mass = |x: f64, f: f64| x * x * f * (1.0 + x / profile.mean());
        let most = greatest(xs.iter().zip(&values).map(|(&x, &f)| mass(x, f)));
        let mut points: Vec<Point> = xs
            .iter()
            .zip(&values)
            .map(|(&x, &f)| {
                let share = mass(x, f) / most;
                let least =
                    [(8e-7, 0.8), (1e-8, 0.1), (1e-30, 0.02), (0.0, 1e-4)].iter().find(|(least, _)| f > least * peak);
                let visible = least.map_or(0.0, |&(_, weight)| weight);
                Point { x, log_f: f.ln().max(LEAST_LOG), weight: (30.0 * share).clamp(visible, 1.0) }
            })
            .collect();
        let last = points.iter().rposition(|point| point.log_f > LEAST_LOG).unwrap_or(0);
        points.truncate(last + 1);
        let power = match profile.tail() {
            Tail::Power { excess, .. } => Some(3.0 + excess),
            Tail::Exponential => None,
        };
        let end = points.iter().position(|point| {
            let (sf, f) = (profile.sf(point.x), point.log_f.exp());
            sf < SPENT && point.x * sf < SPENT * profile.mean() && f < SPENT * peak
        });
        let end = end.unwrap_or(points.len() - 1);
        Self { points, power, end }
    }

    /// ln(k² + x²) at all points.
    fn coordinates(&self, knee: f64) -> Vec<f64> {
        self.points.iter().map(|point| 2.0 * (point.x / knee).hypot(1.0).ln()).collect()
    }

    /// Errors above and below the chord between two points, weighed.
    fn chord(&self, at: &[f64], from: usize, to: usize, ends: [f64; 2]) -> [f64; 2] {
        let slope = (ends[1] - ends[0]) / (at[to] - at[from]);
        (from..=to).fold([0.0_f64; 2], |[above, below], k| {
            let point = &self.points[k];
            let error = point.weight * (point.log_f - ends[0] - slope * (at[k] - at[from]));
            [above.max(error), below.min(error)]
        })
    }

    fn error(&self, at: &[f64], from: usize, to: usize) -> f64 {
        let [above, below] = self.chord(at, from, to, [self.points[from].log_f, self.points[to].log_f]);
        above.max(-below)
    }

    /// The first point from which on the tail alone will do.
    fn last_node(&self, at: &[f64], permitted: f64) -> usize {
        let Some(power) = self.power else { return self.end };
        let count = self.points.len();
        let good = |from: usize| {
            (from..count).all(|k| {
                let line = self.points[from].log_f - 0.5 * power * (at[k] - at[from]);
                self.points[k].weight * (self.points[k].log_f - line).abs() <= permitted
            })
        };
        // what is good stays good farther out
        let (mut bad, mut fine) = (0, count - 1);
        if good(1) {
            return 1;
        }
        while fine - bad > 1 {
            let middle = (bad + fine) / 2;
            if good(middle) { fine = middle } else { bad = middle }
        }
        fine.min(self.end.max(1)).max(1)
    }

    /// Nodes whose cells go as far as an error permits; ended early when there are more than `most`.
    fn march(&self, at: &[f64], permitted: f64, most: usize) -> Vec<usize> {
        let last = self.last_node(at, permitted);
        let mut nodes = vec![0];
        while let Some(&from) = nodes.last()
            && from < last
            && nodes.len() <= most
        {
            let fits = |to: usize| self.error(at, from, to) <= permitted;
            // the farthest that fits, as if errors only grew
            let (mut fit, mut step) = (from + 1, 1);
            while fit + step <= last && fits(fit + step) {
                fit += step;
                step *= 2;
            }
            while step > 1 {
                step /= 2;
                if fit + step <= last && fits(fit + step) {
                    fit += step;
                }
            }
            nodes.push(fit);
        }
        nodes
    }
}

/// Makes a table of 2 to 1000 nodes.
///
/// # Errors
/// Another number of nodes.
pub fn resample(profile: &dyn Profile, count: usize) -> Result<Resampled, ParameterError> {
    let refused = ParameterError::OutOfRange {
        name: "nodes",
        value: count as f64,
        range: "between 2 and 1000",
        mend: "64 reach 1e-3 of G1 for most distributions",
    };
    if !(NODES.0..=NODES.1).contains(&count) {
        return Err(refused);
    }
    let curve = Curve::new(profile);
    let slopes: Vec<f64> = curve.points.iter().map(|point| point.x).collect();
    let median = profile.quantile(0.5);
    let straightest = Nodes::of_points(&slopes, curve.points.iter().map(|point| point.log_f)).knee();
    let knees = KNEES.iter().map(|knee| median * knee).chain([straightest]);
    let (mut knee, mut fewest) = (median, usize::MAX);
    for candidate in knees {
        let needed = curve.march(&curve.coordinates(candidate), TRIAL, fewest.min(4 * NODES.1)).len();
        if needed < fewest {
            (knee, fewest) = (candidate, needed);
        }
    }
    let at = curve.coordinates(knee);
    // ln of the permitted error
    let (mut low, mut high) = (1e-12_f64.ln(), 1e4_f64.ln());
    let mut nodes = curve.march(&at, high.exp(), count);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        let tried = curve.march(&at, middle.exp(), count);
        if tried.len() <= count {
            (nodes, high) = (tried, middle);
        } else {
            low = middle;
        }
    }
    let mut logs: Vec<f64> = nodes.iter().map(|&k| curve.points[k].log_f).collect();
    let exact = logs.clone();
    for _ in 0..MOVES {
        let missing: Vec<f64> = nodes
            .windows(2)
            .enumerate()
            .map(|(j, ends)| curve.chord(&at, ends[0], ends[1], [logs[j], logs[j + 1]]).iter().sum::<f64>())
            .collect();
        for (j, log) in logs.iter_mut().enumerate() {
            let (left, right) = (j.checked_sub(1).and_then(|j| missing.get(j)), missing.get(j));
            // an end that has one neighbor stays: D at the normal, and the tail
            if let (Some(left), Some(right)) = (left, right)
                && left * right > 0.0
            {
                *log += 0.25 * if left.abs() < right.abs() { left } else { right };
            }
        }
    }
    let values = |logs: &[f64]| logs.iter().map(|log| log.exp()).collect::<Vec<f64>>();
    let slopes: Vec<f64> = nodes.iter().map(|&k| curve.points[k].x).collect();
    let tail = TableTail::Power(curve.power);
    let build = |values: &[f64]| TabulatedProfile::with_knee(&slopes, values, Some(knee), tail);
    let (values, profile) = match build(&values(&logs)) {
        Ok(profile) => (values(&logs), profile),
        Err(_) => (values(&exact), build(&values(&exact))?),
    };
    Ok(Resampled { profile, slopes, values, tail, knee })
}

//! Measurements: each runs one function over all four sources and records its errors.

pub mod directions;
pub mod masking;
pub mod moments;
pub mod profile;
pub mod solvers;

use crate::cases::{self, Case, Random};
use crate::oracle::Oracle;
use rayon::prelude::*;
use std::f64::consts::FRAC_2_PI;

/// Values below this are denormal or close to it: they need only be as small.
const SMALLEST: f64 = 1e-290;

/// The four sources of inputs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Source {
    List,
    Edge,
    Spaced,
    Random,
}

/// Errors of one function.
#[derive(Debug, Clone, Default)]
pub struct Record {
    /// The greatest relative error.
    pub max: f64,
    /// Where it occurred.
    pub worst: String,
    squares: f64,
    /// Comparisons per source.
    pub counts: [usize; 4],
}

impl Record {
    /// Records `got` against `want`.
    pub fn compare(&mut self, source: Source, got: f64, want: f64, input: impl Fn() -> String) {
        let error = if got == want || want.abs() < SMALLEST && got.abs() <= 2.0 * SMALLEST {
            0.0
        } else {
            (got - want).abs() / want.abs()
        };
        self.error(source, error, || format!("{}: got {got:e}, wants {want:e}", input()));
    }

    /// Records an error; one that is not a number counts as infinite.
    pub fn error(&mut self, source: Source, error: f64, input: impl Fn() -> String) {
        let error = if error.is_nan() { f64::INFINITY } else { error };
        self.counts[source as usize] += 1;
        self.squares += error * error;
        if error > self.max {
            self.max = error;
            self.worst = input();
        }
    }

    /// Number of comparisons.
    pub fn count(&self) -> usize {
        self.counts.iter().sum()
    }

    /// Root of the mean square error.
    pub fn rms(&self) -> f64 {
        (self.squares / self.count().max(1) as f64).sqrt()
    }

    fn merge(mut self, other: Self) -> Self {
        if other.max > self.max {
            (self.max, self.worst) = (other.max, other.worst);
        }
        self.squares += other.squares;
        for (mine, theirs) in self.counts.iter_mut().zip(other.counts) {
            *mine += theirs;
        }
        self
    }
}

/// How many shapes come from chance.
const RANDOM_SHAPES: usize = 40;

/// Shapes of all four sources.
fn shapes(what: &str) -> Vec<(Source, Case)> {
    let random = cases::random_shapes(&mut Random::seeded(what), RANDOM_SHAPES);
    let label = |source: Source, cases: Vec<Case>| cases.into_iter().map(move |case| (source, case));
    label(Source::List, cases::LIST.to_vec())
        .chain(label(Source::Edge, cases::edge_shapes()))
        .chain(label(Source::Spaced, cases::spaced_shapes()))
        .chain(label(Source::Random, random))
        .collect()
}

/// Runs `measure` on every shape, in parallel; the number is different for every shape.
fn over_shapes(what: &str, measure: impl Fn(&mut Record, Source, Case, u64) + Sync) -> Record {
    let shapes = (0..).zip(shapes(what)).collect();
    over(shapes, |record, (index, (source, case))| measure(record, source, case, index))
}

/// Runs `measure` on every input, in parallel.
fn over<T: Send>(inputs: Vec<T>, measure: impl Fn(&mut Record, T) + Sync) -> Record {
    inputs
        .into_par_iter()
        .map(|input| {
            let mut record = Record::default();
            measure(&mut record, input);
            record
        })
        .reduce(Record::default, Record::merge)
}

fn oracle(case: Case) -> Oracle {
    Oracle { gamma: case.gamma, p: case.p, lambda: case.lambda, m: case.shift }
}

/// A row of the reference files.
pub struct Reference {
    pub case: Case,
    pub argument: f64,
    pub value: f64,
}

/// The reference values that were handed to this project.
const VISIBLE: &str = "visible.csv";
/// Our own: other shapes, exact binary inputs.
const PROFILE: &str = "profile.csv";

/// The reference values of one quantity from both files.
pub fn references(quantity: &str) -> Vec<Reference> {
    let mut rows = from_file(VISIBLE, quantity);
    rows.extend(from_file(PROFILE, quantity));
    rows
}

fn from_file(file: &str, quantity: &str) -> Vec<Reference> {
    let path = format!("{}/../tests/reference/{file}", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"));
    let mut rows = Vec::new();
    for (number, line) in text.lines().enumerate().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let cell = |i: usize| -> f64 {
            cells[i].parse().unwrap_or_else(|_| panic!("{path}, line {}: cell {i} of {line}", number + 1))
        };
        if cells[4] == quantity {
            let case = Case { gamma: cell(0), p: cell(1), lambda: cell(2), shift: cell(3) };
            let argument = if cells[5].is_empty() { 0.0 } else { cell(5) };
            rows.push(Reference { case, argument, value: cell(6) });
        }
    }
    assert!(rows.len() > 20, "{path}: only {} values of {quantity}", rows.len());
    rows
}

/// How far the oracle is from our own reference values, whose inputs are exact doubles; the shared file's are decimals,
/// and the rounding of its γ = 1.501 alone moves Λ by 1e-13.
pub fn oracle_against_references(quantity: &str) -> Record {
    let rows = from_file(PROFILE, quantity);
    // every quantity but f takes milliseconds
    let step = if quantity == "Af" { 1 } else { 11 };
    rows.par_iter()
        .step_by(step)
        .map(|row| {
            let mut record = Record::default();
            let (oracle, x) = (oracle(row.case), row.argument);
            let a = oracle.normalization();
            let got = match quantity {
                "A" => a,
                "Af" => a * oracle.f(x),
                "cdf" => 2.0 * a * oracle.below(x),
                "sf" => 2.0 * a * oracle.above(x),
                "Lambda" => FRAC_2_PI * a * oracle.bracket_integral(x) / x,
                other => panic!("no such quantity: {other}"),
            };
            record.compare(Source::List, got, row.value, || format!("{:?} at {x:e}", row.case));
            record
        })
        .reduce(Record::default, Record::merge)
}

/// Slopes at which profiles are evaluated: a list, the surroundings of m and the ends of double precision, an even
/// spacing in −ln f on both sides, and chance.
pub fn slopes(case: Case, seed: u64) -> Vec<(Source, f64)> {
    let Case { lambda, shift: m, .. } = case;
    let oracle = oracle(case);
    let outer = |depth: f64| m + (1.0 + lambda) * oracle.radius_at(depth);
    let inner = |depth: f64| m - (1.0 - lambda) * oracle.radius_at(depth);
    let mut random = Random::new(seed);
    let mut all: Vec<(Source, f64)> =
        [1e-8, 1e-3, 0.03, 0.3, 1.0, 2.5, 7.0, 40.0, 1e3].map(|x| (Source::List, x)).to_vec();
    all.extend([0.0, 5e-324, 1e-300, m, m.next_down(), m.next_up(), 0.5 * m, outer(640.0)].map(|x| (Source::Edge, x)));
    for depth in [1e-6, 0.1, 1.0, 6.0, 30.0, 150.0, 500.0] {
        all.extend([outer(depth), inner(depth)].map(|x| (Source::Spaced, x)));
    }
    for _ in 0..4 {
        let depth = random.log_between(1e-4, 660.0);
        all.extend([random.log_between(1e-8, 1e3), outer(depth), inner(depth)].map(|x| (Source::Random, x)));
    }
    all.retain(|&(_, x)| (0.0..1e140).contains(&x));
    all
}

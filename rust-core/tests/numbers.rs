//! Do the derivatives by the values of a table, and by the weights and scales of a mixture, agree with differences?

mod cases;

use cases::tables::{KINDS, Points, random_table};
use cases::{Case, Random};
use glam::DVec3;
use rayon::prelude::*;
use sgtd_core::masking::table::FINEST_SINGLE;
use sgtd_core::ndf::{Ndf, Roughness};
use sgtd_core::profile::tabulated::TableTail;
use sgtd_core::profile::{MixtureProfile, Part, Profile, ProfileCells, TabulatedProfile};
use std::sync::Arc;
use std::time::Instant;

const ALPHA: Roughness = Roughness { u: 0.7, v: 0.4 };

/// Made from the logarithms of its numbers.
type Made = Box<dyn Fn(&[f64]) -> Box<dyn Profile> + Sync>;

struct Source {
    name: String,
    numbers: Vec<f64>,
    made: Made,
    /// where f has a corner
    nodes: Vec<f64>,
}

/// Tables of all kinds, tails that go on among them, with the knee that they have chosen.
fn tables(counts: &[usize]) -> Vec<Source> {
    let mut random = Random::seeded("values");
    (0..KINDS)
        .flat_map(|kind| counts.iter().map(move |&count| (kind, count)))
        .map(|(kind, count)| {
            let mut points = random_table(&mut random, kind, count);
            if kind == 0 {
                points.tail = TableTail::Power(None);
            }
            let Points { slopes, values, tail } = points;
            let profile = TabulatedProfile::new(&slopes, &values, tail).expect("a table");
            let knee = profile.knee() * profile.width();
            let logs = values.iter().map(|value| value.ln()).collect();
            let nodes = profile.nodes().map(|node| node.0).collect();
            let made = move |logs: &[f64]| -> Box<dyn Profile> {
                let values: Vec<f64> = logs.iter().map(|log| log.exp()).collect();
                Box::new(TabulatedProfile::with_knee(&slopes, &values, Some(knee), tail).expect("a table"))
            };
            Source {
                name: format!("table of kind {kind} with {count} rows"),
                numbers: logs,
                made: Box::new(made),
                nodes,
            }
        })
        .collect()
}

/// Members of the family, and a table among them.
fn mixtures() -> Vec<Source> {
    let table = || -> Arc<dyn Profile> {
        let values = [1.0, 0.8, 0.3, 0.05, 1e-3];
        Arc::new(TabulatedProfile::new(&[0.0, 0.2, 0.5, 1.1, 2.0], &values, TableTail::Cut).expect("a table"))
    };
    let member = |gamma, p, lambda, shift| -> Arc<dyn Profile> { Arc::new(Case { gamma, p, lambda, shift }.profile()) };
    let list: Vec<(Vec<Arc<dyn Profile>>, Vec<f64>)> = vec![
        (vec![member(1.6, 1.0, 0.0, 0.0), member(f64::INFINITY, 2.0, 0.0, 0.0)], vec![0.7, 0.3, 0.1, 0.5]),
        (
            vec![member(2.0, 1.3, 0.4, 2.0), member(2.6, 1.0, 0.0, 0.0), member(1e9, 5.0, 0.0, 0.0)],
            vec![1.0, 2.0, 0.2, 0.15, 0.05, 0.6],
        ),
        (vec![table(), member(3.0, 1.0, 0.0, 0.0)], vec![0.4, 0.6, 0.3, 0.02]),
    ];
    list.into_iter()
        .enumerate()
        .map(|(k, (profiles, numbers))| {
            let made =
                move |logs: &[f64]| -> Box<dyn Profile> {
                    let (weights, scales) = logs.split_at(profiles.len());
                    let parts = profiles.iter().zip(weights.iter().zip(scales)).map(|(profile, (weight, scale))| {
                        Part { weight: weight.exp(), scale: scale.exp(), profile: Arc::clone(profile) }
                    });
                    Box::new(MixtureProfile::new(parts.collect()).expect("a mixture"))
                };
            let logs: Vec<f64> = numbers.iter().map(|x| x.ln()).collect();
            let nodes = if k == 2 { made(&logs).breaks(50.0) } else { Vec::new() };
            Source { name: format!("mixture {k}"), numbers: logs, made: Box::new(made), nodes }
        })
        .collect()
}

/// Normals and directions at slopes of all sizes, away from corners of f.
fn directions(source: &Source) -> Vec<DVec3> {
    let mut random = Random::new(3);
    let slope = |x: f64, y: f64| (x / ALPHA.u).hypot(y / ALPHA.v);
    std::iter::repeat_with(|| {
        let (rho, phi) = (random.log_between(0.02, 20.0), random.between(0.0, 6.0));
        (ALPHA.u * rho * f64::cos(phi), ALPHA.v * rho * f64::sin(phi))
    })
    .filter(|&(x, y)| source.nodes.iter().all(|node| (slope(x, y) / node - 1.0).abs() > 1e-3))
    .map(|(x, y)| DVec3::new(x, y, 1.0).normalize())
    .take(60)
    .collect()
}

fn norm(values: impl Iterator<Item = f64>) -> f64 {
    values.map(|x| x * x).sum::<f64>().sqrt()
}

#[test]
fn d_and_masking_follow_the_numbers() {
    let sources: Vec<Source> = tables(&[2, 5, 20]).into_iter().chain(mixtures()).collect();
    let worst = sources
        .par_iter()
        .map(|source| {
            let made = |logs: &[f64]| Ndf::new((source.made)(logs), 0.0).expect("an accuracy");
            let (ndf, w) = (made(&source.numbers), directions(source));
            let got: Vec<(Vec<f64>, Vec<f64>)> = w
                .iter()
                .map(|&w| (ndf.d_by_numbers(ALPHA, w).expect("has"), ndf.lambda_by_numbers(ALPHA, w).expect("has")))
                .collect();
            let mut worst = 0.0_f64;
            for k in 0..source.numbers.len() {
                if source.numbers[k] == f64::NEG_INFINITY {
                    assert!(got.iter().all(|(d, lambda)| d[k] == 0.0 && lambda[k] == 0.0));
                    continue;
                }
                let step = 1e-4;
                let at = [-2.0, -1.0, 1.0, 2.0].map(|x| {
                    let mut moved = source.numbers.clone();
                    moved[k] += x * step;
                    let ndf = made(&moved);
                    w.iter().map(|&w| (ndf.d(ALPHA, w), ndf.lambda(ALPHA, w))).collect::<Vec<_>>()
                });
                let difference = |f: &dyn Fn((f64, f64)) -> f64, j: usize| {
                    let [a, b, c, d] = [0, 1, 2, 3].map(|i| f(at[i][j]));
                    (8.0 * (c - b) - (d - a)) / (12.0 * step)
                };
                for (what, of, mine) in [
                    ("D", (|both: (f64, f64)| both.0) as fn((f64, f64)) -> f64, 0),
                    ("Lambda", |both: (f64, f64)| both.1, 1),
                ] {
                    // in units of the quantity itself: the greatest is not all that counts
                    let scale = |j: usize| of((ndf.d(ALPHA, w[j]), ndf.lambda(ALPHA, w[j]))).max(1e-200);
                    let by = |j: usize| if mine == 0 { got[j].0[k] } else { got[j].1[k] };
                    let error = norm((0..w.len()).map(|j| (by(j) - difference(&of, j)) / scale(j)));
                    let size = norm((0..w.len()).map(|j| difference(&of, j) / scale(j)));
                    assert!(error < 1e-5 * size + 1e-7, "{}: {what} by number {k}: {error:e} of {size:e}", source.name);
                    worst = worst.max(error / (size + 1e-3));
                }
            }
            worst
        })
        .reduce(|| 0.0, f64::max);
    println!("worst, relative: {worst:e}");
}

/// A common factor on the values or the weights says nothing; one on the scales is a roughness, which is held.
#[test]
fn common_factors_say_nothing() {
    for source in tables(&[7, 64]).into_iter().chain(mixtures()) {
        let ndf = Ndf::new((source.made)(&source.numbers), 0.0).expect("an accuracy");
        for w in directions(&source) {
            let d = ndf.d_by_numbers(ALPHA, w).expect("has");
            let lambda = ndf.lambda_by_numbers(ALPHA, w).expect("has");
            for (by, value) in [(d, ndf.d(ALPHA, w)), (lambda, ndf.lambda(ALPHA, w))] {
                let groups = if source.name.starts_with("mixture") { 2 } else { 1 };
                for group in by.chunks(by.len() / groups) {
                    let size: f64 = group.iter().map(|x| x.abs()).sum();
                    let sum: f64 = group.iter().sum();
                    assert!(sum.abs() <= 1e-7 * (size + value), "{}: {sum:e} of {size:e}", source.name);
                }
            }
        }
    }
}

#[test]
fn the_matrix_holds_the_derivatives() {
    for source in tables(&[5, 64]).into_iter().chain(mixtures()) {
        let ndf = Ndf::new((source.made)(&source.numbers), FINEST_SINGLE).expect("an accuracy");
        let profile = ndf.profile();
        let cells = ProfileCells::new(profile);
        let start = Instant::now();
        let table = ndf.numbers_table(&cells, true).expect("has");
        let time = start.elapsed();
        let gradient = ndf.numbers_gradient().expect("has");
        let columns = gradient.count();
        assert_eq!(table.columns(), columns);
        let block = |k: usize, c: usize, j: usize| f64::from(table.flat()[(4 * k + c) * columns + j]);
        let cubic = |k: usize, j: usize, x: f64| (0..4).rev().fold(0.0_f64, |sum, c| sum.mul_add(x, block(k, c, j)));
        // masking, as G1 sees it
        let (mut error, mut size) = (0.0_f64, 0.0_f64);
        let h_cells = ndf.lambda_table().cells();
        assert_eq!(table.cells_of_h(), h_cells.len());
        for (k, &(left, right)) in h_cells.iter().enumerate().filter(|(_, ends)| ends.1.is_finite()).step_by(7) {
            for t in [0.2, 0.5, 0.85] {
                let d = t * (right - left);
                let h = ndf.lambda_table().h(left + d);
                for (j, by) in gradient.at(profile, left + d).1.iter().enumerate() {
                    error = error.max((cubic(1 + k, j, d) - by.h).abs() / (left + d + h));
                    size = size.max(by.h.abs() / (left + d + h));
                }
            }
        }
        // ln f, in both precisions, where it is not faint
        let (mut f_error, mut f_size) = (0.0_f64, 0.0_f64);
        let peak = (0..400).map(|k| profile.f(0.01 * f64::from(k))).fold(0.0, f64::max);
        let single = cells.spans(true);
        assert_eq!(table.cells_of_f(), single.len());
        let offset = 1 + h_cells.len();
        for (first, spans) in [(offset, single), (offset + table.cells_of_f(), cells.spans(false))] {
            for (k, span) in spans.iter().enumerate() {
                let end = span.end.unwrap_or(4.0 * span.start.max(1e-9));
                for t in [0.15, 0.5, 0.8] {
                    let s = span.start + t * (end - span.start);
                    if profile.f(s.sqrt()) < 1e-8 * peak || end < span.start * 1.001 {
                        continue;
                    }
                    for (j, by) in gradient.log_density(profile, s.sqrt()).iter().enumerate() {
                        f_error = f_error.max((cubic(first + k, j, span.log_t(s)) - by).abs());
                        f_size = f_size.max(by.abs());
                    }
                }
            }
        }
        println!(
            "{}: G1 {error:.1e} of {size:.1e}, ln D {f_error:.1e} of {f_size:.1e}, {} + {} cells, {time:?}",
            source.name,
            table.cells_of_h(),
            table.cells_of_f()
        );
        assert!(error < 1e-5 * size && f_error < 5e-5 * f_size, "{}", source.name);
    }
}

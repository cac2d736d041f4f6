//! The stretched distribution over directions: D, Λ, G1, G2 and the pdf of D·cos, at accuracy 0.
//!
//! References take the three coordinates of a direction as exact numbers; that its length is 1 only to rounding changes
//! nothing.

use super::{Record, SMALLEST, Source, oracle, over_shapes};
use crate::cases::{Case, Random, direction};
use crate::oracle::Oracle;
use crate::oracle::double_double::Dd;
use glam::DVec3;
use sgtd_core::ndf::{Ndf, Roughness, Shadowing};
use std::f64::consts::{FRAC_2_PI, FRAC_PI_2, PI};

/// Built for one shape in so many: its tables cost a hundred times as much as the values.
const THINNING: u64 = 6;

fn reference_ndf(case: Case) -> Ndf {
    Ndf::new(Box::new(case.profile()), 0.0).unwrap_or_else(|error| panic!("{case:?}: {error}"))
}

fn alphas(seed: u64) -> Roughness {
    let (u, v) = [(1.0, 1.0), (0.1, 0.1), (0.35, 0.1), (1e-4, 1e-4), (10.0, 1e-3), (1.0, 1e-4)][seed as usize % 6];
    Roughness { u, v }
}

/// Directions: some angles, the pole and the horizon, slopes spread over the profile, and chance.
fn directions(case: Case, alpha: Roughness, seed: u64) -> Vec<(Source, DVec3)> {
    let oracle = oracle(case);
    let mut random = Random::new(seed);
    let stretched = |x: f64, phi: f64| DVec3::new(alpha.u * x * phi.cos(), alpha.v * x * phi.sin(), 1.0).normalize();
    let mut all = [0.1, 0.5, 1.0, 1.4].map(|theta| (Source::List, direction(theta, 0.7 + theta))).to_vec();
    all.push((Source::Edge, direction(1e-9, 1.0)));
    all.push((Source::Edge, direction(FRAC_PI_2 - 1e-9, 2.0)));
    for (k, depth) in [1e-3, 0.3, 1.0, 5.0, 40.0, 300.0].into_iter().enumerate() {
        let x = case.shift + (1.0 + case.lambda) * oracle.radius_at(depth);
        all.push((Source::Spaced, stretched(x.min(1e12), k as f64)));
        all.push((
            Source::Spaced,
            stretched((case.shift - (1.0 - case.lambda) * oracle.radius_at(depth)).max(0.0), k as f64),
        ));
    }
    all.extend((0..4).map(|_| (Source::Random, random.direction())));
    all
}

/// `√((x a)² + (y b)²)` of exact factors.
fn length(x: (f64, Dd), y: (f64, Dd)) -> Dd {
    let (x, y) = (Dd::from(x.0) * x.1, Dd::from(y.0) * y.1);
    (x * x + y * y).sqrt()
}

fn d_of(oracle: &Oracle, normalization: f64, alpha: Roughness, m: DVec3) -> Option<f64> {
    let one = Dd::from(1.0);
    let (u, v, z) = (Dd::from(alpha.u), Dd::from(alpha.v), Dd::from(m.z));
    let rho = length((m.x, one / u), (m.y, one / v)) / z;
    let f = oracle.f_at(rho);
    // D may be larger than f by cos⁴, but f is what underflows
    (f > SMALLEST).then(|| f * normalization / (PI * (u * v * z * z * z * z).hi))
}

pub fn d() -> Record {
    over_d("d", |ndf, alpha, m| ndf.d(alpha, m), |d, _| d)
}

pub fn pdf_projected() -> Record {
    over_d("pdf_projected", |ndf, alpha, m| ndf.pdf_projected(alpha, m), |d, cos| d * cos)
}

fn over_d(what: &str, got: fn(&Ndf, Roughness, DVec3) -> f64, want: fn(f64, f64) -> f64) -> Record {
    over_shapes(what, |record, _, case, seed| {
        if seed % THINNING != 0 {
            return;
        }
        let (ndf, oracle) = (reference_ndf(case), oracle(case));
        let normalization = oracle.normalization();
        for k in 0..2 {
            let alpha = alphas(seed / THINNING + k);
            for (source, m) in directions(case, alpha, seed) {
                if let Some(d) = d_of(&oracle, normalization, alpha, m) {
                    let input = || format!("{case:?} {alpha:?} m = {m:?}");
                    record.compare(source, got(&ndf, alpha, m), want(d, m.z), input);
                }
            }
        }
    })
}

/// Λ of a direction, with the promised range of a.
fn lambda_of(oracle: &Oracle, factor: f64, alpha: Roughness, w: DVec3) -> Option<f64> {
    let across = length((w.x, Dd::from(alpha.u)), (w.y, Dd::from(alpha.v)));
    let a = (Dd::from(w.z) / across).hi;
    (1e-8..=1e3).contains(&a).then(|| factor * oracle.bracket_integral(a) / a)
}

pub fn lambda() -> Record {
    over_lambda("lambda(w)", |ndf, alpha, w| ndf.lambda(alpha, w), |lambda, _| lambda)
}

pub fn projected_area() -> Record {
    let area = |lambda: f64, cos: f64| cos * (1.0 + lambda);
    over_lambda("projected_area", |ndf, alpha, w| ndf.projected_area(alpha, w), area)
}

pub fn g1() -> Record {
    over_lambda("g1", |ndf, alpha, w| ndf.g1(alpha, w), |lambda, _| 1.0 / (1.0 + lambda))
}

fn over_lambda(what: &str, got: fn(&Ndf, Roughness, DVec3) -> f64, want: fn(f64, f64) -> f64) -> Record {
    over_shapes(what, |record, _, case, seed| {
        if seed % 11 != 0 {
            return;
        }
        let (ndf, oracle, alpha) = (reference_ndf(case), oracle(case), alphas(seed / 11));
        let factor = FRAC_2_PI * oracle.normalization();
        for ((source, w), k) in directions(case, alpha, seed).into_iter().zip(seed / 11..) {
            if k % 4 == 0
                && let Some(lambda) = lambda_of(&oracle, factor, alpha, w)
            {
                record.compare(source, got(&ndf, alpha, w), want(lambda, w.z), || {
                    format!("{case:?} {alpha:?} w = {w:?}")
                });
            }
        }
    })
}

pub fn g2() -> Record {
    over_shapes("g2", |record, _, case, seed| {
        if seed % 17 != 0 {
            return;
        }
        let (ndf, oracle, alpha) = (reference_ndf(case), oracle(case), alphas(seed / 17));
        let factor = FRAC_2_PI * oracle.normalization();
        let directions = directions(case, alpha, seed);
        for k in (0..directions.len()).step_by(5) {
            let ((source, wi), (_, wo)) = (directions[k], directions[(k + 7) % directions.len()]);
            let (Some(i), Some(o)) = (lambda_of(&oracle, factor, alpha, wi), lambda_of(&oracle, factor, alpha, wo))
            else {
                continue;
            };
            let both = [
                (Shadowing::HeightCorrelated, 1.0 / (1.0 + i + o)),
                (Shadowing::Separable, 1.0 / ((1.0 + i) * (1.0 + o))),
            ];
            for (shadowing, want) in both {
                let got = ndf.g2(alpha, wi, wo, shadowing);
                record.compare(source, got, want, || format!("{case:?} {alpha:?} {shadowing:?} {wi:?} {wo:?}"));
            }
        }
    })
}

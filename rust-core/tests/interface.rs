//! Does a rough interface reflect and transmit what its tables say, and no more light than there is?

mod cases;

use cases::{Case, Random, direction, row_cases};
use glam::DVec3;
use rayon::prelude::*;
use sgtd_core::ndf::{Ndf, Roughness, Shadowing};
use sgtd_core::scattering::albedo::{Incidence, Rule, SingleScattering};
use sgtd_core::scattering::fresnel::{average_dielectric, dielectric};
use sgtd_core::scattering::interface_table::{InterfaceTable, Quantity};
use std::f64::consts::PI;

const MODES: [Shadowing; 2] = [Shadowing::Separable, Shadowing::HeightCorrelated];

fn ndf(case: Case) -> Ndf {
    Ndf::new(Box::new(case.profile()), 1e-6).unwrap_or_else(|error| panic!("{case:?}: {error}"))
}

fn isotropic(alpha: f64) -> Roughness {
    Roughness { u: alpha, v: alpha }
}

/// R and T of one direction by drawing visible normals.
fn drawn(ndf: &Ndf, alpha: Roughness, wi: DVec3, eta: f64, mode: Shadowing) -> [f64; 2] {
    const COUNT: u32 = 200_000;
    let sum = (0..COUNT)
        .into_par_iter()
        .map(|k| {
            // the first two coordinates of Roberts' sequence
            let u = [0.7548776662466927, 0.5698402909980532].map(|step| (0.5 + step * f64::from(k)).fract());
            let sample = ndf.sample_visible(alpha, wi, (u[0], u[1]));
            let m = sample.m;
            let cosine = wi.dot(m);
            if !(sample.pdf > 0.0 && cosine > 0.0) {
                return [0.0; 2];
            }
            let (reflectance, beyond) = dielectric(cosine, eta);
            let weight = sample.d_over_pdf * cosine / wi.z;
            let wo = 2.0 * cosine * m - wi;
            let below = wi * (1.0 / eta) - m * (cosine / eta - beyond);
            let lambda = |w: DVec3| ndf.lambda(alpha, w);
            let transmitted = if below.z > 0.0 {
                match mode {
                    Shadowing::Separable => ndf.g1(alpha, wi) * ndf.g1(alpha, below),
                    Shadowing::HeightCorrelated => {
                        let (a, b) = (1.0 + lambda(wi), 1.0 + lambda(below));
                        (libm_lgamma(a) + libm_lgamma(b) - libm_lgamma(a + b)).exp()
                    }
                }
            } else {
                0.0
            };
            let reflected = if wo.z > 0.0 { ndf.g2(alpha, wi, wo, mode) } else { 0.0 };
            [weight * reflectance * reflected, weight * (1.0 - reflectance) * transmitted]
        })
        .reduce(|| [0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    sum.map(|x| x / f64::from(COUNT))
}

/// ln Γ from another library than the core's.
fn libm_lgamma(x: f64) -> f64 {
    statrs::function::gamma::ln_gamma(x)
}

/// Shapes with corners, heavy tails, and in between.
fn shapes() -> Vec<Case> {
    let more = [
        Case { gamma: 2.0, p: 1.0, lambda: 0.0, shift: 0.0 },
        Case { gamma: 1.52, p: 1.0, lambda: 0.0, shift: 0.0 },
        Case { gamma: 2.0, p: 1.0, lambda: 0.0, shift: 5.0 },
        Case { gamma: f64::INFINITY, p: 50.0, lambda: 0.5, shift: 0.0 },
    ];
    row_cases().into_iter().map(|(_, case)| case).chain(more).collect()
}

#[test]
fn interfaces_agree_with_brute_force() {
    let mut random = Random::seeded("interface");
    for case in shapes() {
        if case.gamma * case.p < 1.55 {
            continue; // nor have most of these
        }
        let ndf = ndf(case);
        for eta in [1.5, 1.0 / 1.4] {
            let alpha = Roughness { u: random.log_between(0.05, 1.0), v: random.log_between(0.05, 1.0) };
            let wi = direction((0.02 + 0.98 * random.unit()).acos(), random.between(-PI, PI));
            for mode in MODES {
                let source = SingleScattering::new(&ndf, mode, Rule::PAIR);
                let view = Incidence::new(alpha, wi);
                let found =
                    [source.reflectance(view, |cosine| dielectric(cosine, eta).0), source.transmittance(view, eta)];
                let expected = drawn(&ndf, alpha, wi, eta, mode);
                for (name, found, expected) in [("R", found[0], expected[0]), ("T", found[1], expected[1])] {
                    let error = (found - expected).abs();
                    // the tails of gamma = 1.6 reach beyond the slopes that have a sample
                    assert!(error < 2e-3, "{name} {case:?} {mode:?} {alpha:?} {wi} {eta}: {found}, drawn {expected}");
                }
                assert!(found[0] + found[1] < 1.0 + 1e-4, "{case:?} {mode:?}: {found:?} is more than there was");
            }
        }
    }
}

/// Any view, from table and by quadrature; where light from above may be totally reflected, corners are as sharp as the surface is smooth.
#[test]
fn tables_hold_interfaces() {
    let mut random = Random::seeded("interface tables");
    let mut worst = [0.0f64; 3];
    for (n, case) in shapes().into_iter().enumerate() {
        let ndf = ndf(case);
        let mode = MODES[n % 2];
        for anisotropic in [false, true] {
            if anisotropic && n % 3 != 0 {
                continue; // these take a second each
            }
            let alpha = random.log_between(0.01, 1.5);
            let ratio = if anisotropic { random.log_between(0.1, 10.0) } else { 1.0 };
            let alpha = Roughness { u: alpha, v: alpha * ratio };
            let eta = [1.5, 1.33, 2.4, 0.7][n % 4];
            let kind = if eta < 1.0 { 2 } else { usize::from(anisotropic) };
            let source = SingleScattering::new(&ndf, mode, Rule::PAIR);
            for quantity in [Quantity::Reflectance, Quantity::Transmittance] {
                let table = InterfaceTable::new(&ndf, mode, alpha, eta, quantity);
                for _ in 0..60 {
                    let mu = if random.below(3) == 0 { random.log_between(1e-4, 1.0) } else { random.unit().max(1e-4) };
                    let w = direction(mu.acos(), random.between(-PI, PI));
                    let view = Incidence::new(alpha, w);
                    let exact = match quantity {
                        Quantity::Reflectance => source.reflectance(view, |cosine| dielectric(cosine, eta).0),
                        Quantity::Transmittance => source.transmittance(view, eta),
                    };
                    let error = (table.at(w) - exact).abs();
                    if error > worst[kind] {
                        worst[kind] = error;
                        println!("{case:?} {mode:?} {alpha:?} {eta} {quantity:?}: {error:.1e} at {w}");
                    }
                }
            }
        }
    }
    println!("worst of one roughness, of two, and of an index below 1: {worst:?}");
    for (found, permitted) in worst.into_iter().zip([1e-3, 3e-3, 1.5e-2]) {
        assert!(found < permitted, "{worst:?}");
    }
}

/// Light that crosses from below is as much as crosses from above, by η²; and smooth glass is Fresnel's.
#[test]
fn averages_are_reciprocal() {
    let mut random = Random::seeded("reciprocal");
    for case in shapes() {
        let ndf = ndf(case);
        for mode in MODES {
            let alpha = isotropic(random.log_between(0.02, 1.0));
            let eta = random.between(1.2, 2.0);
            let above = InterfaceTable::new(&ndf, mode, alpha, eta, Quantity::Transmittance);
            let below = InterfaceTable::new(&ndf, mode, alpha, 1.0 / eta, Quantity::Transmittance);
            let (there, back) = (above.average() / (eta * eta), below.average());
            assert!((there - back).abs() < 1e-3, "{case:?} {mode:?} {alpha:?} {eta}: {there} and {back}");
            // R from below by its own table
            let reflected = InterfaceTable::new(&ndf, mode, alpha, 1.0 / eta, Quantity::Reflectance).average();
            let internal = above.internal_reflectance();
            // a ring makes kinks on both ways
            assert!(
                (reflected - internal).abs() < if case.shift > 2.0 { 3e-3 } else { 1e-3 },
                "{case:?} {mode:?} {alpha:?}: {reflected}, {internal}"
            );
            assert!(internal + there < 1.0 + 1e-3);
        }
    }
    let smooth = InterfaceTable::new(&ndf(shapes()[0]), MODES[0], isotropic(1e-4), 1.5, Quantity::Transmittance);
    for mu in [0.01, 0.1, 0.5, 1.0] {
        let expected = 1.0 - dielectric(mu, 1.5).0;
        let found = smooth.at(direction(f64::acos(mu), 0.3));
        assert!((found - expected).abs() < 3e-3, "{mu}: {found}, not {expected}");
    }
}

/// The average of Fresnel's equations in closed form (Walsh 1926, as in d'Eon & Irving 2011), and the law that joins both sides.
#[test]
fn diffuse_light_meets_smooth_glass() {
    for eta in [1.2f64, 1.5, 2.4] {
        let (n2, n4) = (eta.powi(2), eta.powi(4));
        let terms = [
            0.5,
            (eta - 1.0) * (3.0 * eta + 1.0) / (6.0 * (eta + 1.0).powi(2)),
            n2 * (n2 - 1.0).powi(2) / (n2 + 1.0).powi(3) * ((eta - 1.0) / (eta + 1.0)).ln(),
            -2.0 * eta.powi(3) * (n2 + 2.0 * eta - 1.0) / ((n2 + 1.0) * (n4 - 1.0)),
            8.0 * n4 * (n4 + 1.0) / ((n2 + 1.0) * (n4 - 1.0).powi(2)) * eta.ln(),
        ];
        let expected: f64 = terms.iter().sum();
        let found = average_dielectric(eta);
        assert!((found - expected).abs() < 1e-6, "{eta}: {found}, not {expected}");
        let inside = 1.0 - (1.0 - expected) / n2;
        assert!((average_dielectric(1.0 / eta) - inside).abs() < 1e-5, "{eta}: {}", average_dielectric(1.0 / eta));
    }
}

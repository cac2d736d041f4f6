//! Do the laws hold that follow from what D, G1, G2 and the pdfs are?
//!
//! Integrals over normals run in stretched slopes (ρ, ψ), where nothing depends on the roughness, but every value comes
//! from the public functions of directions. One law is integrated in real angles too, so that a mistaken Jacobian
//! cannot hide.

mod cases;

use cases::tables::{KINDS, random_table};
use cases::{Case, Random, direction, row_cases};
use glam::DVec3;
use rayon::prelude::*;
use sgtd_core::ndf::{Ndf, Roughness, Shadowing};
use sgtd_core::numerics::quadrature::gauss;
use sgtd_core::profile::{MixtureProfile, Part, Profile, Tail};
use std::f64::consts::PI;
use std::sync::Arc;

/// Permitted error of laws at accuracy 0.
const TOLERANCE: f64 = 1e-9;

const ALPHAS: [Roughness; 4] = [
    Roughness { u: 1.0, v: 1.0 },
    Roughness { u: 0.1, v: 0.1 },
    Roughness { u: 0.05, v: 0.5 },
    Roughness { u: 2.0, v: 0.02 },
];

const DEGREES: [f64; 7] = [0.0, 20.0, 45.0, 70.0, 85.0, 89.0, 89.9];

fn views() -> impl Iterator<Item = DVec3> {
    DEGREES.into_iter().enumerate().map(|(k, degrees)| direction(degrees.to_radians(), 0.3 + 1.1 * k as f64))
}

fn ndf(case: Case, accuracy: f64) -> Ndf {
    Ndf::new(Box::new(case.profile()), accuracy).unwrap_or_else(|error| panic!("{case:?}: {error}"))
}

/// Runs a law on every row of the family, in parallel.
fn for_all_rows(accuracy: f64, law: impl Fn(&str, &Ndf) + Sync) {
    row_cases().into_par_iter().for_each(|(name, case)| law(name, &ndf(case, accuracy)));
}

/// The same on tables of every kind, and on mixtures of a table and a row.
fn for_all_profiles(accuracy: f64, law: impl Fn(&str, &Ndf) + Sync) {
    for_all_rows(accuracy, &law);
    let mut random = Random::seeded("tables");
    let tables: Vec<_> =
        (0..3 * KINDS).map(|k| (k, random_table(&mut random, k % KINDS, [3, 20, 64][(k / KINDS) as usize]))).collect();
    tables.par_iter().for_each(|(k, points)| {
        let new = |profile: Box<dyn Profile>| Ndf::new(profile, accuracy).unwrap_or_else(|error| panic!("{error}"));
        law(&format!("table {k}: {points:?}"), &new(Box::new(points.profile())));
        let row: Arc<dyn Profile> = Arc::new(row_cases()[*k as usize % 10].1.profile());
        let parts = [(0.7, 0.3, row), (0.3, 0.1, Arc::new(points.profile()) as _)];
        let parts = parts.map(|(weight, scale, profile)| Part { weight, scale, profile });
        let mixture = MixtureProfile::new(parts.to_vec()).unwrap_or_else(|error| panic!("{error}"));
        law(&format!("mixture with table {k}: {points:?}"), &new(Box::new(mixture)));
    });
}

/// Nodes and weights of `∫₀^∞ … dρ` for integrands like f times powers of ρ, with a singularity at `kink`.
fn radial_nodes(profile: &dyn Profile, kink: Option<f64>) -> Vec<(f64, f64)> {
    let mut ends = profile.breaks(100.0);
    let last = ends[ends.len() - 1];
    if let Some(a) = kink {
        // graded towards a, where the share of the circle that is visible begins to shrink like √(ρ−a)
        ends.extend((0..14).map(|k| a * (1.0 + 0.25f64.powi(k))).chain([a]).filter(|&x| x < last));
    }
    ends.push(0.0);
    ends.sort_by(f64::total_cmp);
    let mut nodes = Vec::new();
    let mut panel = |left: f64, right: f64| {
        nodes.extend(gauss(24).nodes().iter().map(|&(t, weight)| (left + t * (right - left), weight * (right - left))));
    };
    for pair in ends.windows(2) {
        let mut left = pair[0];
        while left > 0.0 && pair[1] > 4.0 * left {
            panel(left, 2.0 * left);
            left *= 2.0;
        }
        panel(left, pair[1]);
    }
    if let Tail::Power { excess, .. } = profile.tail() {
        // ρ = R v^(−1/e) turns ρ^(−1−e) into a constant
        nodes.extend(gauss(24).nodes().iter().map(|&(v, weight)| {
            let rho = last * v.powf(-1.0 / excess);
            (rho, weight * rho / (excess * v))
        }));
    }
    nodes
}

/// The normal of a stretched slope, and dω/(ρ dρ dψ).
fn normal(alpha: Roughness, rho: f64, psi: f64) -> (DVec3, f64) {
    let m = DVec3::new(alpha.u * rho * psi.cos(), alpha.v * rho * psi.sin(), 1.0).normalize();
    (m, alpha.u * alpha.v * m.z * m.z * m.z)
}

/// `∫ value(m) dω_m` over the normals that face w; all normals where `w` is the pole.
fn over_normals(profile: &dyn Profile, alpha: Roughness, w: DVec3, mut value: impl FnMut(DVec3) -> f64) -> f64 {
    let (across_u, across_v) = (alpha.u * w.x, alpha.v * w.y);
    let a = w.z / across_u.hypot(across_v);
    let towards = across_v.atan2(across_u);
    let mut sum = 0.0;
    for (rho, weight) in radial_nodes(profile, a.is_finite().then_some(a)) {
        let half = if rho > a { (-a / rho).acos() } else { PI };
        sum += weight
            * rho
            * gauss(20).integrate(-half, half, |psi| {
                let (m, jacobian) = normal(alpha, rho, towards + psi);
                value(m) * jacobian
            });
    }
    sum
}

#[test]
fn projected_normals_integrate_to_one() {
    for_all_profiles(0.0, |name, ndf| {
        for alpha in ALPHAS {
            let whole = over_normals(ndf.profile(), alpha, DVec3::Z, |m| ndf.d(alpha, m) * m.z);
            assert!((whole - 1.0).abs() < TOLERANCE, "{name} {alpha:?}: ∫ D cos = 1 {:+e}", whole - 1.0);
        }
    });
}

/// The same in real angles: t = tan θ at fixed azimuth, `dω cos θ = t dt dφ cos⁴θ`.
#[test]
fn projected_normals_integrate_to_one_in_real_angles() {
    // the trapezoidal rule converges like exp(−2 N atanh(αv/αu))
    const AZIMUTHS: u32 = 400;
    for_all_rows(0.0, |name, ndf| {
        let nodes = radial_nodes(ndf.profile(), None);
        for alpha in [ALPHAS[1], ALPHAS[2]] {
            let mut whole = 0.0;
            for k in 0..AZIMUTHS {
                let phi = 2.0 * PI * (f64::from(k) + 0.37) / f64::from(AZIMUTHS);
                let stretch = 1.0 / (phi.cos() / alpha.u).hypot(phi.sin() / alpha.v);
                whole += nodes
                    .iter()
                    .map(|&(x, weight)| {
                        let tan = x * stretch;
                        let m = DVec3::new(tan * phi.cos(), tan * phi.sin(), 1.0).normalize();
                        ndf.d(alpha, m) * m.z.powi(4) * tan * weight * stretch
                    })
                    .sum::<f64>();
            }
            whole *= 2.0 * PI / f64::from(AZIMUTHS);
            assert!((whole - 1.0).abs() < TOLERANCE, "{name} {alpha:?}: ∫ D cos = 1 {:+e}", whole - 1.0);
        }
    });
}

/// Heitz 2014, Eq. 16: what is visible of the microsurface covers the view exactly.
#[test]
fn weak_white_furnace() {
    for_all_profiles(0.0, |name, ndf| {
        for alpha in ALPHAS {
            for w in views() {
                let seen = over_normals(ndf.profile(), alpha, w, |m| ndf.d(alpha, m) * w.dot(m).max(0.0));
                let ratio = ndf.g1(alpha, w) * seen / w.z;
                assert!((ratio - 1.0).abs() < TOLERANCE, "{name} {alpha:?} {w:?}: 1 {:+e}", ratio - 1.0);
            }
        }
    });
}

/// With the masking table in place of quadrature, the law holds to the accuracy that was asked for.
#[test]
fn weak_white_furnace_with_tables() {
    for accuracy in [1e-2, 1e-4, 1e-6] {
        for_all_profiles(accuracy, |name, ndf| {
            for w in views() {
                let alpha = ALPHAS[2];
                let seen = over_normals(ndf.profile(), alpha, w, |m| ndf.d(alpha, m) * w.dot(m).max(0.0));
                let ratio = ndf.g1(alpha, w) * seen / w.z;
                assert!((ratio - 1.0).abs() < accuracy, "{name} {accuracy:e} {w:?}: 1 {:+e}", ratio - 1.0);
            }
        });
    }
}

/// A perfect mirror on the microsurface returns no more than it receives, and separable shadowing returns less.
#[test]
fn furnace_returns_no_more_than_it_receives() {
    for_all_rows(1e-4, |name, ndf| {
        for alpha in [ALPHAS[1], ALPHAS[2]] {
            for wi in views() {
                let albedo = |shadowing| {
                    over_normals(ndf.profile(), alpha, wi, |m| {
                        let wo = 2.0 * wi.dot(m) * m - wi;
                        ndf.d(alpha, m) * ndf.g2(alpha, wi, wo, shadowing) * wi.dot(m).max(0.0) / wi.z
                    })
                };
                let (correlated, separable) = (albedo(Shadowing::HeightCorrelated), albedo(Shadowing::Separable));
                assert!(correlated <= 1.0 + 1e-4, "{name} {alpha:?} {wi:?}: albedo {correlated}");
                assert!(separable <= correlated, "{name} {alpha:?} {wi:?}: {separable} > {correlated}");
                assert!(separable > 0.01, "{name} {alpha:?} {wi:?}: albedo {separable}");
            }
        }
    });
}

/// Exchanging the directions changes nothing, to the last bit, and nothing is brighter than its darker end.
#[test]
fn shadowing_is_reciprocal_and_bounded() {
    let mut random = Random::seeded("shadowing");
    let pairs: Vec<(DVec3, DVec3)> = (0..2000).map(|_| (random.direction(), random.direction())).collect();
    for accuracy in [0.0, 1e-3] {
        for_all_rows(accuracy, |name, ndf| {
            for (k, &(wi, wo)) in pairs.iter().enumerate() {
                let alpha = ALPHAS[k % ALPHAS.len()];
                let (i, o) = (ndf.g1(alpha, wi), ndf.g1(alpha, wo));
                let [correlated, separable] = [Shadowing::HeightCorrelated, Shadowing::Separable].map(|shadowing| {
                    let g2 = ndf.g2(alpha, wi, wo, shadowing);
                    assert_eq!(g2, ndf.g2(alpha, wo, wi, shadowing), "{name} {alpha:?} {wi:?} {wo:?}");
                    g2
                });
                assert!(0.0 <= separable && separable <= correlated * (1.0 + 1e-15), "{name} {alpha:?} {wi:?} {wo:?}");
                assert!(correlated <= i.min(o), "{name} {alpha:?} {wi:?} {wo:?}: {correlated} > {i}, {o}");
                assert!(0.0 < i && i <= 1.0, "{name} {alpha:?} {wi:?}: G1 = {i}");
            }
        });
    }
}

/// Masking only grows towards grazing, and ∂(aΛ)/∂a = −S lies between −½ and 0.
#[test]
fn masking_is_monotone_towards_grazing() {
    for_all_rows(0.0, |name, ndf| {
        let alpha = ALPHAS[0];
        let mut before: Option<(f64, f64)> = None;
        for k in 0..900 {
            let w = direction(PI / 2.0 * f64::from(k) / 900.0 + 1e-6, 0.4);
            let (a, lambda) = (w.z / w.x.hypot(w.y), ndf.lambda(alpha, w));
            if let Some((earlier_a, earlier)) = before {
                // both may have underflowed
                assert!(
                    lambda > earlier || lambda == 0.0 && earlier == 0.0,
                    "{name}: Λ falls from {earlier:e} to {lambda:e} at a = {a}"
                );
                let slope = (a * lambda - earlier_a * earlier) / (a - earlier_a);
                assert!((-0.5 - 1e-9..=1e-9).contains(&slope), "{name}: H' = {slope} at a = {a}");
            }
            before = Some((a, lambda));
        }
    });
}

/// What the table of visible normals draws has a density that integrates to all but the normals lost at the horizon.
#[test]
fn visible_pdf_integrates_to_what_is_not_lost() {
    for_all_rows(1e-3, |name, ndf| {
        let knots = ndf.visible_table().slopes();
        for alpha in ALPHAS {
            for w in views() {
                let (across_u, across_v) = (alpha.u * w.x, alpha.v * w.y);
                let (a, towards) = (w.z / across_u.hypot(across_v), across_v.atan2(across_u));
                let mut whole = 0.0;
                for pair in knots.windows(2).filter(|pair| pair[1].is_finite()) {
                    // the spline is a rational function of ρ² on each cell: quarters of it are smooth
                    for k in 0..4 {
                        let end = |k: f64| {
                            let (low, high) = (pair[0] * pair[0], pair[1] * pair[1]);
                            (low + (high - low) * k / 4.0).sqrt()
                        };
                        whole += gauss(16).integrate(end(f64::from(k)), end(f64::from(k) + 1.0), |rho| {
                            let half = if rho > a { (-a / rho).acos() } else { PI };
                            rho * gauss(16).integrate(-half, half, |psi| {
                                let (m, jacobian) = normal(alpha, rho, towards + psi);
                                ndf.pdf_visible(alpha, w, m) * jacobian
                            })
                        });
                    }
                }
                // the share that is lost is drawn like every other: count it
                let draws = 4000;
                let invalid = (0..draws)
                    .filter(|k| {
                        ndf.sample_visible(alpha, w, ((f64::from(*k) + 0.5) / f64::from(draws), 0.5)).pdf == 0.0
                    })
                    .count();
                let lost = invalid as f64 / f64::from(draws);
                assert!(
                    (whole + lost - 1.0).abs() < 1e-6 + 1.0 / f64::from(draws),
                    "{name} {alpha:?} {w:?}: {whole} + {lost}"
                );
                assert!(lost > 0.0 || (whole - 1.0).abs() < 1e-4, "{name} {alpha:?} {w:?}: {whole}, none lost");
            }
        }
    });
}

//! Does light that walks on facets of glass go where energy, reciprocity and quadrature say?

mod cases;

use cases::{Case, Random, direction, row_cases};
use glam::DVec3;
use rayon::prelude::*;
use sgtd_core::ndf::{Ndf, Roughness, Shadowing};
use sgtd_core::scattering::albedo::{Incidence, Rule, SingleScattering};
use sgtd_core::scattering::fresnel::dielectric;
use sgtd_core::scattering::random_walk::{Exit, RandomWalk};

fn ndf(case: Case) -> Ndf {
    Ndf::new(Box::new(case.profile()), 1e-6).unwrap_or_else(|error| panic!("{case:?}: {error}"))
}

/// Where all of `count` walks go; a walk that does not end fails the test.
fn exits(
    ndf: &Ndf,
    alpha: Roughness,
    eta: f64,
    count: u64,
    seed: u64,
    from: impl Fn(&mut Random) -> DVec3 + Sync,
) -> Vec<(DVec3, Exit)> {
    const CHUNK: u64 = 4096;
    let walk = RandomWalk::new(ndf, alpha);
    (0..count.div_ceil(CHUNK))
        .into_par_iter()
        .flat_map_iter(|chunk| {
            let mut random = Random::new(seed + 7919 * chunk);
            let (walk, from) = (&walk, &from);
            (0..CHUNK.min(count - chunk * CHUNK)).map(move |_| {
                let wi = from(&mut random);
                let mut met = 0;
                let exit = walk.walk_dielectric(wi, eta, &mut || random.unit(), |cosine| {
                    assert!((0.0..=1.0 + 1e-9).contains(&cosine), "{cosine}");
                    met += 1;
                });
                let Some(exit) = exit else { panic!("a walk did not leave") };
                assert_eq!(exit.bounces, met);
                assert!((exit.direction.length() - 1.0).abs() < 1e-9 && exit.direction.z != 0.0);
                (wi, exit)
            })
        })
        .collect()
}

/// All light leaves, on one side or the other; and what meets one facet is what quadrature says of correlated masking: from above and from below.
#[test]
fn single_facets_agree_with_quadrature() {
    const COUNT: u64 = 100_000;
    for (n, (_, case)) in row_cases().into_iter().enumerate() {
        let ndf = ndf(case);
        let source = SingleScattering::new(&ndf, Shadowing::HeightCorrelated, Rule::REFERENCE);
        let etas = [[1.5, 1.05], [2.5, 0.7]][n % 2];
        for (alpha, theta, eta) in [
            (Roughness { u: 0.3, v: 0.3 }, 1.3, etas[0]),
            (Roughness { u: 1.0, v: 1.0 }, 0.1, etas[1]),
            (Roughness { u: 0.8, v: 0.2 }, 0.8, etas[0]),
        ] {
            for side in [1.0, -1.0] {
                let wi = side * direction(theta, 0.5);
                let view = Incidence::new(alpha, wi * side);
                let ratio = if side > 0.0 { eta } else { 1.0 / eta };
                let expected =
                    [source.reflectance(view, |cosine| dielectric(cosine, ratio).0), source.transmittance(view, ratio)];
                let mut found = [0.0; 2];
                for (_, exit) in exits(&ndf, alpha, eta, COUNT, 11, |_| wi) {
                    if exit.bounces == 1 {
                        found[usize::from(exit.direction.z * side < 0.0)] += 1.0 / COUNT as f64;
                    }
                }
                for (found, expected) in found.into_iter().zip(expected) {
                    let noise = (expected * (1.0 - expected) / COUNT as f64).sqrt();
                    assert!(
                        (found - expected).abs() < 4.5 * noise + 3e-4,
                        "{case:?} {alpha:?} {theta} {ratio}: {found}, not {expected}"
                    );
                }
            }
        }
    }
}

/// Diffuse light: as much goes from one bin of directions to another as comes back, after one facet and after more, but for the factor η² between
/// the two sides.
#[test]
fn the_walk_is_reciprocal() {
    const COUNT: u64 = 600_000;
    const BINS: usize = 3;
    for (case, alpha, eta) in [
        (Case { gamma: 2.0, p: 1.0, lambda: 0.0, shift: 0.0 }, Roughness { u: 1.0, v: 1.0 }, 1.5),
        (Case { gamma: 2.5, p: 1.5, lambda: 0.4, shift: 0.7 }, Roughness { u: 1.2, v: 0.5 }, 2.0),
    ] {
        let ndf = ndf(case);
        // bins: three of the cosine squared, above and below
        let bin = |w: DVec3| ((w.z * w.z * BINS as f64) as usize).min(BINS - 1) + if w.z < 0.0 { BINS } else { 0 };
        let mut counts = [[[0.0_f64; 2 * BINS]; 2 * BINS]; 2];
        for side in [1.0, -1.0] {
            let diffuse = |random: &mut Random| side * direction(random.unit().sqrt().acos(), 6.3 * random.unit());
            for (wi, exit) in exits(&ndf, alpha, eta, COUNT, 5, diffuse) {
                counts[usize::from(exit.bounces > 1)][bin(wi)][bin(exit.direction)] += 1.0;
            }
        }
        for (order, counts) in counts.iter().enumerate() {
            // etendue of either side
            let area = |k: usize| if k < BINS { 1.0 } else { eta * eta };
            for (i, o) in (0..2 * BINS).flat_map(|i| (0..i).map(move |o| (i, o))) {
                let (there, back) = (area(i) * counts[i][o], area(o) * counts[o][i]);
                let noise = (area(i).powi(2) * counts[i][o] + area(o).powi(2) * counts[o][i]).sqrt();
                assert!(
                    (there - back).abs() < 4.5 * noise.max(1.0),
                    "order {order}, bins {i} and {o}: {there} there, {back} back, noise {noise}"
                );
            }
        }
        let crossed: f64 = counts[1][..BINS].iter().map(|row| row[BINS..].iter().sum::<f64>()).sum();
        assert!(crossed > 0.05 * COUNT as f64, "{crossed}");
    }
}

/// Glass in a medium of its own index is not there: light goes straight on, however many facets it meets.
#[test]
fn equal_indices_bend_nothing() {
    let ndf = ndf(Case { gamma: 2.0, p: 1.0, lambda: 0.0, shift: 0.0 });
    for (wi, exit) in exits(&ndf, Roughness { u: 1.0, v: 0.6 }, 1.0, 20_000, 3, |random| {
        direction(1.5 * random.unit(), 6.3 * random.unit()) * if random.below(2) == 0 { 1.0 } else { -1.0 }
    }) {
        assert!((exit.direction + wi).length() < 1e-9, "{wi} goes to {}", exit.direction);
        assert_eq!(exit.bounces % 2, 1);
    }
}

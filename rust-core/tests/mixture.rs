//! Is a mixture the sum of its parts?

mod cases;

use cases::altered::Altered;
use cases::second_moment::second_moment;
use cases::tables::{KINDS, random_table};
use cases::{Random, random_shapes};
use rayon::prelude::*;
use sgtd_core::masking::{MaskingIntegral, Rule};
use sgtd_core::ndf::{Ndf, Roughness};
use sgtd_core::profile::{MixtureProfile, Part, Profile, Tail};
use std::f64::consts::PI;
use std::sync::Arc;

/// Mixtures of one to four members, tables, or both.
fn mixtures(what: &str, count: usize) -> Vec<MixtureProfile> {
    let mut random = Random::seeded(what);
    (0..count)
        .map(|k| {
            let parts = (0..1 + k % 4)
                .map(|j| {
                    let weight = random.log_between(1e-3, 1.0);
                    let scale = random.log_between(0.01, 2.0);
                    let profile: Arc<dyn Profile> = if (k + j) % 3 == 0 {
                        let kind = random.below(KINDS);
                        let points = 2 + random.below(40) as usize;
                        Arc::new(random_table(&mut random, kind, points).profile())
                    } else {
                        let mut case = random_shapes(&mut random, 1)[0];
                        // thin rings and near-divergent tails are tested where they are alone
                        case.shift = case.shift.min(20.0);
                        case.gamma = case.gamma.max(1.6 / case.p);
                        Arc::new(case.profile())
                    };
                    Part { weight, scale, profile }
                })
                .collect();
            MixtureProfile::new(parts).unwrap_or_else(|error| panic!("{error}"))
        })
        .collect()
}

/// The same as a profile that does not say of what it is made.
fn blend(mixture: &MixtureProfile) -> Altered<MixtureProfile> {
    Altered { profile: mixture.clone(), f: |_, f| f, bends: true }
}

#[test]
fn masking_is_that_of_the_blended_slopes() {
    mixtures("masking", 60).par_iter().for_each(|mixture| {
        assert!((mixture.mean() - 1.0).abs() < 1e-12, "mean slope {}", mixture.mean());
        if let Tail::Power { exact_from, .. } = mixture.tail()
            && exact_from > 1e12
        {
            // the blend does not reach the power that it ends with
            return;
        }
        let blend = blend(mixture);
        let [exact, blended] =
            [mixture as &dyn Profile, &blend].map(|profile| MaskingIntegral::new(profile, Rule::REFERENCE));
        let mut random = Random::new(3);
        let end = mixture.breaks(20.0).pop().unwrap_or(1.0).min(1e3);
        for _ in 0..30 {
            let q = random.log_between(1e-3, end);
            let (got, want) = (exact.at(mixture, q), blended.at(&blend, q));
            let error = (got.h - want.h).abs() / (q + want.h);
            assert!(error < 1e-9, "H({q}) = {} is not {}: {error:e}", got.h, want.h);
        }
    });
}

#[test]
fn inverses_undo_what_they_invert() {
    mixtures("inverses", 60).par_iter().for_each(|mixture| {
        let mut random = Random::new(4);
        for _ in 0..300 {
            let u = if random.below(2) == 0 { random.unit() } else { random.log_between(1e-30, 0.5) };
            let (low, high) = (mixture.quantile(u), mixture.isf(u));
            for (x, value) in [(low, &(|x| mixture.cdf(x)) as &dyn Fn(f64) -> f64), (high, &|x| mixture.sf(x))] {
                let (a, b) = (value(x * (1.0 - 4e-15)), value(x * (1.0 + 4e-15)));
                let between = a.min(b) <= u && u <= a.max(b);
                let error = if between { 0.0 } else { (value(x) - u).abs() / u };
                assert!(error < 1e-11, "{x:e} is not what {u:e} is at: {error:e}");
            }
        }
    });
}

#[test]
fn visible_sampling_has_little_variance() {
    let worst = mixtures("variance", 60)
        .into_par_iter()
        .map(|mixture| {
            let kind = mixture.coordinate();
            let ndf = Ndf::new(Box::new(mixture), 1e-5).unwrap_or_else(|error| panic!("{error}"));
            let scale = ndf.visible_table().scale();
            let worst = [0.02, 0.1, 0.25, 0.5, 0.63, 0.8, 0.93, 0.98]
                .map(|position| second_moment(&ndf, scale * position / (1.0 - position)))
                .into_iter()
                .fold(0.0, |worst: f64, second| if second < worst { worst } else { second });
            println!("{kind:?} {worst}");
            worst
        })
        .reduce(|| 0.0, f64::max);
    assert!(worst <= 1.002, "E[w²] = {worst}");
}

#[test]
fn functions_are_those_of_the_parts() {
    mixtures("parts", 30).into_par_iter().for_each(|mixture| {
        let parts: Vec<(f64, f64, Arc<dyn Profile>)> =
            mixture.parts().iter().map(|part| (part.weight, part.scale, part.profile.clone())).collect();
        let ndf = Ndf::new(Box::new(mixture), 0.0).unwrap_or_else(|error| panic!("{error}"));
        let alpha = Roughness { u: 0.4, v: 0.15 };
        let mut random = Random::new(6);
        for _ in 0..40 {
            let m = random.direction();
            // D is a sum over roughnesses, Λ too
            let (mut d, mut lambda) = (0.0, 0.0);
            for (weight, scale, profile) in &parts {
                let own = Roughness { u: alpha.u * scale, v: alpha.v * scale };
                let x = (m.x / own.u).hypot(m.y / own.v) / m.z;
                d += weight * profile.normalization() * profile.f(x) / (PI * own.u * own.v * m.z.powi(4));
                let masking = MaskingIntegral::new(profile.as_ref(), Rule::REFERENCE);
                let a = m.z / (own.u * m.x).hypot(own.v * m.y);
                lambda += weight * masking.at(profile.as_ref(), a).h / a;
            }
            let got = (ndf.d(alpha, m), ndf.lambda(alpha, m));
            assert!((got.0 - d).abs() <= 1e-9 * d + 1e-250, "D = {} is not {d}", got.0);
            assert!((got.1 - lambda).abs() <= 1e-11 * lambda, "Λ = {} is not {lambda}", got.1);
        }
    });
}

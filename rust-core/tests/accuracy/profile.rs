//! The radial profile: f, A, the cdf, its complement, their inverses and the mean.

use super::{Record, SMALLEST, Source, oracle, over_shapes, references, slopes};
use crate::cases::Case;
use crate::oracle::double_double::Dd;
use sgtd_core::profile::Profile;

/// One slope in so many is integrated, to keep the time within bounds; which ones changes from shape to shape.
const THINNING: u64 = 8;

fn thinned(case: Case, seed: u64) -> Vec<(Source, f64)> {
    slopes(case, seed).into_iter().zip(seed..).filter(|(_, k)| k % THINNING == 0).map(|(slope, _)| slope).collect()
}

pub fn f() -> Record {
    let mut record = over_shapes("f", |record, _, case, seed| {
        let (profile, oracle) = (case.profile(), oracle(case));
        for (source, x) in slopes(case, seed) {
            record.compare(source, profile.f(x), oracle.f(x), || format!("{case:?} x = {x:e}"));
        }
    });
    for row in references("Af") {
        let profile = row.case.profile();
        let got = profile.normalization() * profile.f(row.argument);
        record.compare(Source::List, got, row.value, || format!("A·f, {:?} x = {:e}", row.case, row.argument));
    }
    record
}

/// At a slope of more than 16 digits.
pub fn f_past() -> Record {
    over_shapes("f_past", |record, _, case, seed| {
        let (profile, oracle) = (case.profile(), oracle(case));
        for (source, x) in slopes(case, seed) {
            for past in [0.4 * (x.next_up() - x), 1e-3 * x, 2.0 * x] {
                let want = oracle.f_at(Dd::from(x) + Dd::from(past));
                record.compare(source, profile.f_past(x, past), want, || format!("{case:?} x = {x:e} + {past:e}"));
            }
        }
    })
}

pub fn f_fast() -> Record {
    over_shapes("f_fast", |record, _, case, seed| {
        let (profile, oracle) = (case.profile(), oracle(case));
        for (source, x) in slopes(case, seed) {
            // x − m is rounded, which no arithmetic after it can mend: one ulp of x counts as one of the argument
            let (f, want) = (profile.f_fast(x), oracle.f(x));
            let (below, above) = (oracle.f(x.next_down().max(0.0)), oracle.f(x.next_up()));
            let nearest = f.clamp(want.min(below).min(above), want.max(below).max(above));
            let error = if f < SMALLEST { 0.0 } else { (f - nearest).abs() / want };
            record.error(source, error, || format!("{case:?} x = {x:e}: got {f:e}, wants {want:e}"));
        }
    })
}

pub fn normalization() -> Record {
    let mut record = over_shapes("normalization", |record, source, case, _| {
        record.compare(source, case.profile().normalization(), oracle(case).normalization(), || format!("{case:?}"));
    });
    for row in references("A") {
        record.compare(Source::List, row.case.profile().normalization(), row.value, || format!("{:?}", row.case));
    }
    record
}

pub fn mean() -> Record {
    over_shapes("mean", |record, source, case, _| {
        let oracle = oracle(case);
        let want = 2.0 * oracle.normalization() * oracle.second();
        record.compare(source, case.profile().mean(), want, || format!("{case:?}"));
    })
}

pub fn cdf() -> Record {
    integral("cdf", |profile, x| profile.cdf(x), |oracle, x| oracle.below(x))
}

pub fn sf() -> Record {
    integral("sf", |profile, x| profile.sf(x), |oracle, x| oracle.above(x))
}

/// Slopes below the rim of a ring or box whose edge is close to the normal, where f is still within its peak and differences cancel: every
/// kind of tail, p × shift near 1 × x towards 0.
fn below_the_peak() -> Vec<(Source, Case, Vec<f64>)> {
    let mut all = Vec::new();
    for gamma in [1.05, 1.7, 3.0, 15.9, 1e3, 1e8, f64::INFINITY] {
        for p in [2.3, 7.0, 20.0, 50.0] {
            for (lambda, shift) in [(0.0, 1.0), (0.0, 0.96), (0.0, 1.06), (-0.7, 1.7), (0.5, 0.51)] {
                let slopes = [1e-5, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.4].map(|share| share * shift);
                all.push((Source::Spaced, Case { gamma, p, lambda, shift }, slopes.to_vec()));
            }
        }
    }
    let mut random = crate::cases::Random::seeded("below the peak");
    for mut case in crate::cases::random_shapes(&mut random, 300) {
        case.shift = ((1.0 - case.lambda) * random.log_between(0.5, 2.0)).min(1e3);
        all.push((Source::Random, case, vec![case.shift * random.log_between(1e-4, 1.0)]));
    }
    all
}

fn integral(quantity: &str, got: fn(&dyn Profile, f64) -> f64, want: fn(&crate::oracle::Oracle, f64) -> f64) -> Record {
    let peaks = super::over(below_the_peak(), |record, (source, case, slopes)| {
        let (profile, oracle) = (case.profile(), oracle(case));
        let factor = 2.0 * oracle.normalization();
        for x in slopes {
            record.compare(source, got(&profile, x), factor * want(&oracle, x), || format!("{case:?} x = {x:e}"));
        }
    });
    let mut record = over_shapes(quantity, |record, _, case, seed| {
        let (profile, oracle) = (case.profile(), oracle(case));
        let factor = 2.0 * oracle.normalization();
        for (source, x) in thinned(case, seed) {
            record.compare(source, got(&profile, x), factor * want(&oracle, x), || format!("{case:?} x = {x:e}"));
        }
    });
    for row in references(quantity) {
        let x = row.argument;
        record.compare(Source::List, got(&row.case.profile(), x), row.value, || format!("{:?} x = {x:e}", row.case));
    }
    record.merge(peaks)
}

/// Probabilities: a list, the ends of what is promised, an even spacing in the logarithm, and chance.
fn shares(seed: u64) -> Vec<(Source, f64)> {
    let mut random = crate::cases::Random::new(seed);
    let mut all = [0.5, 0.25, 0.1, 1e-3, 1e-8, 0.9, 0.999].map(|u| (Source::List, u)).to_vec();
    all.extend([1e-300, 0.5f64.next_down(), 0.5f64.next_up(), 1.0 - 0.5f64.powi(24)].map(|u| (Source::Edge, u)));
    all.extend((1..10).map(|k| (Source::Spaced, 10f64.powi(-30 * k))));
    all.extend((0..4).map(|_| (Source::Random, random.log_between(1e-300, 1.0))));
    all
}

pub fn quantile() -> Record {
    inverse("quantile", |profile, x| profile.cdf(x), |profile, u| profile.quantile(u))
}

pub fn isf() -> Record {
    inverse("isf", |profile, x| profile.sf(x), |profile, u| profile.isf(u))
}

fn inverse(what: &str, forth: fn(&dyn Profile, f64) -> f64, back: fn(&dyn Profile, f64) -> f64) -> Record {
    over_shapes(what, |record, _, case, seed| {
        let profile = case.profile();
        for (source, u) in shares(seed) {
            let x = back(&profile, u);
            // Next to a thin ring no double hits u: the cdf changes by 1e-6 from one to the next. Between the values at
            // both neighbors of x, u is met.
            let neighbors = [forth(&profile, x.next_down()), forth(&profile, x.next_up())];
            let nearest = u.clamp(neighbors[0].min(neighbors[1]), neighbors[0].max(neighbors[1]));
            record.compare(source, nearest, u, || format!("{case:?} u = {u:e}, x = {x:e}"));
        }
        for (source, x) in slopes(case, seed) {
            let u = forth(&profile, x);
            // the other function holds the digits above one half; below 1e-300 there are none
            if (1e-300..=0.5).contains(&u) {
                record.compare(source, back(&profile, u), x, || format!("{case:?} x = {x:e}, u = {u:e}"));
            }
        }
    })
}

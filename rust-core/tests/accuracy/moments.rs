//! Partial moments of one side, and the gamma functions and powers that they are made of.

use super::{Record, Source, over_shapes};
use crate::cases::{Case, Random};
use crate::oracle::Oracle;
use crate::oracle::double_double::Dd;
use sgtd_core::family::partial_moment::{Radius, Side, Width};
use sgtd_core::numerics::exponent::Exponent;
use sgtd_core::numerics::gamma_ratio;

fn centered(case: Case) -> Oracle {
    Oracle { gamma: case.gamma, p: case.p, lambda: 0.0, m: 0.0 }
}

/// Γ(s): the moment ∫ r^(k−1) exp(−r^(2p)) dr = Γ(k/2p)/(2p).
pub fn gamma() -> Record {
    over_shapes("gamma", |record, source, case, seed| {
        let k = 1 + (seed % 3) as u32;
        let want = Oracle { gamma: f64::INFINITY, ..centered(case) }.moment_above(k, 0.0) * 2.0 * case.p;
        // s = k/(2p) is rounded: d ln Γ/ds = ψ(s), which s ψ(s) of −1 … 10 turns into some ulps
        let s = f64::from(k) / (2.0 * case.p);
        record.compare(source, gamma_ratio::gamma(s), want, || format!("s = {s}"));
    })
}

/// The ratio of that moment at γ and at ∞.
pub fn scaled_gamma_ratio() -> Record {
    over_shapes("scaled_gamma_ratio", |record, source, case, seed| {
        let k = 1 + (seed % 3) as u32;
        let oracle = centered(case);
        let want = oracle.moment_above(k, 0.0) / Oracle { gamma: f64::INFINITY, ..oracle }.moment_above(k, 0.0);
        let s = f64::from(k) / (2.0 * case.p);
        let b = (2.0 * case.p).mul_add(case.gamma, -f64::from(k)) / (2.0 * case.p);
        let got = gamma_ratio::scaled_gamma_ratio(case.gamma, s, b);
        record.compare(source, got, want, || format!("{case:?} k = {k}"));
    })
}

pub fn total() -> Record {
    over_shapes("total", |record, source, case, seed| {
        let k = 1 + (seed % 3) as u32;
        let got = Side::new(case.gamma, case.p).total(k);
        record.compare(source, got, centered(case).moment_above(k, 0.0), || format!("{case:?} k = {k}"));
    })
}

/// Distances from m: by depth on a list, at the ends, evenly, and by chance.
fn radii(case: Case, seed: u64) -> [(Source, f64); 7] {
    let mut random = Random::new(seed);
    let oracle = centered(case);
    [
        (Source::List, 1.0),
        (Source::List, 0.3),
        (Source::Edge, oracle.radius_at(600.0).min(1e140)),
        (Source::Edge, 1e-12),
        (Source::Spaced, oracle.radius_at([0.01, 0.2, 0.7, 1.0, 1.7, 4.0, 20.0, 100.0][seed as usize % 8]).min(1e140)),
        (Source::Random, oracle.radius_at(random.log_between(1e-3, 300.0)).min(1e140)),
        (Source::Random, random.log_between(1e-6, 1e3)),
    ]
}

pub fn lower() -> Record {
    over_shapes("lower", |record, _, case, seed| {
        let side = Side::new(case.gamma, case.p);
        for (source, r) in radii(case, seed) {
            let k = 1 + ((seed + r.to_bits()) % 3) as u32;
            let want = centered(case).moment_below(k, r);
            record.compare(source, side.lower(k, Radius::exact(r)), want, || format!("{case:?} k = {k} r = {r:e}"));
        }
    })
}

pub fn upper() -> Record {
    over_shapes("upper", |record, _, case, seed| {
        let side = Side::new(case.gamma, case.p);
        for (source, r) in radii(case, seed) {
            let k = 1 + ((seed + r.to_bits()) % 3) as u32;
            let want = centered(case).moment_above(k, r);
            record.compare(source, side.upper(k, Radius::exact(r)), want, || format!("{case:?} k = {k} r = {r:e}"));
        }
    })
}

pub fn kernel() -> Record {
    over_shapes("g", |record, _, case, seed| {
        let side = Side::new(case.gamma, case.p);
        for (source, r) in radii(case, seed) {
            let want = centered(case).g(Dd::from(r));
            record.compare(source, side.kernel(Radius::exact(r)), want, || format!("{case:?} r = {r:e}"));
        }
    })
}

pub fn kernel_fast() -> Record {
    over_shapes("g_fast", |record, _, case, seed| {
        let side = Side::new(case.gamma, case.p);
        for (source, r) in radii(case, seed) {
            record
                .compare(source, side.kernel_fast(r), centered(case).g(Dd::from(r)), || format!("{case:?} r = {r:e}"));
        }
    })
}

pub fn depth() -> Record {
    over_shapes("depth", |record, _, case, seed| {
        let side = Side::new(case.gamma, case.p);
        for (source, r) in radii(case, seed) {
            record
                .compare(source, side.depth(r), centered(case).depth(Dd::from(r)).hi, || format!("{case:?} r = {r:e}"));
        }
    })
}

pub fn radius_at_depth() -> Record {
    over_shapes("radius_at_depth", |record, _, case, seed| {
        let side = Side::new(case.gamma, case.p);
        for (source, r) in radii(case, seed) {
            let depth = centered(case).depth(Dd::from(r)).hi;
            if (1e-14..1e4).contains(&depth) {
                record.compare(source, side.radius_at_depth(depth), r, || format!("{case:?} depth {depth:e}"));
            }
        }
    })
}

/// hi + lo, whose error counts against the whole.
pub fn radius() -> Record {
    over_shapes("radius", |record, _, case, seed| {
        for (source, x) in super::slopes(case, seed) {
            let past = x * f64::EPSILON * [0.0, 0.3, 1e6][seed as usize % 3];
            let skew = if x + past > case.shift { case.lambda } else { -case.lambda };
            let got = Radius::of(x, past, case.shift, Width::new(skew));
            let width = Dd::from(1.0) + Dd::from(skew);
            let distance = Dd::from(x) + Dd::from(past) - Dd::from(case.shift);
            let want = if distance.hi < 0.0 { -distance / width } else { distance / width };
            let error = if want.hi < 1e-280 {
                (got.hi - want.hi).abs() / 1e-280
            } else {
                ((got.hi - want.hi) + (got.lo - want.lo)).abs() / want.hi
            };
            record.error(source, error, || format!("{case:?} x = {x:e} past {past:e}"));
        }
    })
}

/// Exponents: every branch, at the thresholds and by chance; arguments over the whole range that does not overflow.
fn powers(got: fn(Exponent, f64) -> f64, sign: f64) -> Record {
    let mut record = Record::default();
    let mut random = Random::seeded("powers");
    let list = [2.0, 1.0, 3.0, 0.5, 1.5, 2.5, 0.75].map(|e| (Source::List, e));
    let edge = [16.0, 15.5, 16.5, 17.0, 2f64.next_up(), 2f64.next_down(), 100.0, 1e3].map(|e| (Source::Edge, e));
    let spaced = (1..40).map(|k| (Source::Spaced, 0.25 * f64::from(k)));
    let by_chance: Vec<(Source, f64)> = (0..100).map(|_| (Source::Random, random.log_between(0.5, 100.0))).collect();
    for (source, e) in list.into_iter().chain(edge).chain(spaced).chain(by_chance) {
        for _ in 0..20 {
            let x = random.log_between((-600.0 / e.max(2.0)).exp(), (600.0 / e.max(2.0)).exp());
            let want = (Dd::from(sign * e) * Dd::from(x).ln()).exp().hi;
            record.compare(source, got(Exponent::new(e), x), want, || format!("{x:e}^{}", sign * e));
        }
    }
    record
}

pub fn power() -> Record {
    powers(|exponent, x| exponent.of(x), 1.0)
}

pub fn power_fast() -> Record {
    powers(|exponent, x| exponent.fast(x), 1.0)
}

pub fn reciprocal_fast() -> Record {
    powers(|exponent, x| exponent.fast_reciprocal(x), -1.0)
}

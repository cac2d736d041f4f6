//! Does single precision read a profile from its cells as the profile is?

mod cases;

use cases::Random;
use cases::tables::{KINDS, random_table};
use rayon::prelude::*;
use sgtd_core::family::shape::Shape;
use sgtd_core::family::skewed_t::SkewedT;
use sgtd_core::profile::cells::{BUCKET, CELL, OCTAVES};
use sgtd_core::profile::{MixtureProfile, Part, Profile, ProfileCells, TableTail, TabulatedProfile};
use std::sync::Arc;

/// A reader as renderers have it, in single precision where they have that.
struct Reader(Vec<f32>);

struct Found {
    log_f: f64,
    s: f64,
    odds: f64,
}

impl Reader {
    fn cell(&self, list: usize, key: f32) -> [f64; CELL] {
        let bits = key.to_bits();
        let entry = self.0[list * OCTAVES + (bits >> 23) as usize].to_bits();
        let shift = entry & 31;
        let bucket = (entry >> 5) + if shift == 31 { 0 } else { (bits & 0x7f_ffff) >> shift };
        let bucket = &self.0[BUCKET * bucket as usize..][..BUCKET];
        let later = bucket[1..].iter().filter(|&&start| start <= key).count();
        let cell = bucket[0].to_bits() as usize + later;
        std::array::from_fn(|k| f64::from(self.0[CELL * cell + k]))
    }

    fn moment(log_t: f64, less: f64) -> f64 {
        if (less * log_t).abs() < 1e-9 { log_t } else { (less * log_t).exp_m1() / less }
    }

    fn odds(v: f64) -> f64 {
        if v < 0.0 { (1.0 + v) / (-v).max(1e-18) } else { v / (1.0 - v) }
    }

    fn at(&self, s: f64) -> Found {
        let [anchor, rate, _, log2_f, exponent, v, m, _] = self.cell(0, s as f32);
        let log_t = ((s - anchor) * rate).max(-1.0 + 1e-7).ln_1p();
        let v = v + m * Self::moment(log_t, 1.0 - exponent);
        Found { log_f: log2_f * std::f64::consts::LN_2 - exponent * log_t, s, odds: Self::odds(v) }
    }

    fn drawn(&self, odds: f64) -> Found {
        let [anchor, _, inverse, log2_f, exponent, v, _, inverse_m] = self.cell(1, odds as f32);
        let wanted = if odds < 1.0 { odds / (1.0 + odds) } else { -1.0 / (1.0 + odds) };
        let (q, less) = ((wanted - v) * inverse_m, 1.0 - exponent);
        let log_t = if (less * q).abs() < 1e-12 { q } else { (less * q).max(-1.0 + 1e-7).ln_1p() / less };
        Found { log_f: log2_f * std::f64::consts::LN_2 - exponent * log_t, s: anchor + log_t.exp_m1() * inverse, odds }
    }
}

fn check(name: &str, profile: &dyn Profile, permitted: f64) -> (f64, f64, f64) {
    let cells = ProfileCells::new(profile);
    let reader = Reader(cells.single().to_vec());
    let mut random = Random::seeded(name);
    let (mut worst, mut back) = (0.0_f64, 0.0_f64);
    let peak =
        (0..4000).map(|k| profile.f(profile.quantile((f64::from(k) + 0.5) / 4000.0))).fold(profile.f(0.0), f64::max);
    for _ in 0..4000 {
        let x = profile.quantile(random.unit()).max(1e-9);
        let x = if random.unit() < 0.3 { profile.isf(random.log_between(1e-15, 1.0)).max(1e-9) } else { x };
        let s = f64::from((x * x) as f32);
        let (x, f) = (s.sqrt(), profile.f(s.sqrt()));
        if f < 1e-7 * peak {
            continue;
        }
        // by how much the rounding of a slope alone changes ln f
        let beside = (profile.f(x * (1.0 + 2e-7)) / f).ln().abs() + (profile.f(x * (1.0 - 2e-7)) / f).ln().abs();
        if !(beside < 1e-4) {
            continue;
        }
        let found = reader.at(s);
        let error = (found.log_f - f.ln()).abs() - beside;
        assert!(error < permitted, "{name}: ln f({x:e}) is off by {error:e}, {} cells", cells.count());
        worst = worst.max(error);
        let odds = profile.cdf(x) / profile.sf(x);
        if odds < 1e17 {
            let by_slope = x * x * f * profile.normalization() / (profile.cdf(x) * profile.sf(x)) * 1e-7;
            let error = (found.odds - odds).abs() / odds.max(0.01) - 4.0 * by_slope;
            assert!(error < 2e-5, "{name}: odds at {x:e} are {:e}, not {odds:e}", found.odds);
            let drawn = reader.drawn(found.odds);
            let again = reader.at(drawn.s);
            let error = (again.odds - found.odds).abs() / found.odds.max(0.01) - 4.0 * by_slope;
            assert!(error < 2e-5, "{name}: {:e} comes back as {:e} from {:e}", found.odds, again.odds, drawn.s);
            back = back.max(error);
        }
    }
    // beyond its end a cut table has nothing, and everything lies below
    let beyond = (1.0 + 1e-5) * profile.isf(1e-300);
    if profile.f(beyond) == 0.0 && profile.sf(beyond) == 0.0 {
        let found = reader.at(beyond * beyond);
        assert!(
            found.log_f < -600.0 && found.odds > 1e17,
            "{name}: ln f {}, odds {:e} at {beyond}",
            found.log_f,
            found.odds
        );
    }
    (worst, back, cells.count() as f64)
}

#[test]
fn tables_are_read_as_they_are() {
    let mut random = Random::seeded("cells");
    let points: Vec<_> = (0..KINDS)
        .flat_map(|kind| [2, 3, 17, 64, 300, 1000].map(|count| (kind, count)))
        .map(|(kind, count)| (kind, count, random_table(&mut random, kind, count)))
        .collect();
    let worst = points
        .par_iter()
        .map(|(kind, count, points)| check(&format!("kind {kind}, {count} nodes"), &points.profile(), 1e-5))
        .reduce(|| (0.0, 0.0, 0.0), |a, b| (a.0.max(b.0), a.1.max(b.1), a.2.max(b.2)));
    println!("worst {worst:?}");
}

#[test]
fn mixtures_and_families_are_approached() {
    let student = |gamma: f64, p: f64, lambda: f64, shift: f64| -> Arc<dyn Profile> {
        Arc::new(SkewedT::new(Shape::new(gamma, p, lambda, shift).unwrap_or_else(|error| panic!("{error}"))))
    };
    let mut random = Random::seeded("mixed cells");
    let tables: Vec<Arc<dyn Profile>> =
        (0..KINDS).map(|kind| Arc::new(random_table(&mut random, kind, 30).profile()) as Arc<dyn Profile>).collect();
    let inf = f64::INFINITY;
    let mut cases: Vec<Vec<(f64, f64, Arc<dyn Profile>)>> = vec![
        vec![(1.0, 1.0, student(2.0, 1.0, 0.0, 0.0))],
        vec![(1.0, 1.0, student(inf, 1.0, 0.0, 0.0))],
        vec![(0.7, 0.1, student(1.6, 1.0, 0.0, 0.0)), (0.3, 0.5, student(inf, 1.0, 0.0, 0.0))],
        vec![(0.5, 0.02, student(inf, 1.0, 0.0, 0.0)), (0.5, 1.0, student(2.7, 1.3, 0.3, 0.5))],
        vec![(0.5, 0.1, student(2.8, 0.6, -0.4, 3.0)), (0.5, 0.3, student(inf, 5.0, 0.0, 0.0))],
        vec![(0.9, 0.1, student(1.52, 1.0, 0.0, 0.0)), (0.1, 2.0, student(inf, 2.0, 0.5, 8.0))],
    ];
    cases.extend(tables.iter().map(|table| vec![(0.4, 0.2, table.clone()), (0.6, 0.1, student(1.8, 1.0, 0.0, 0.0))]));
    let worst = cases
        .par_iter()
        .enumerate()
        .map(|(k, parts)| {
            let parts = parts
                .iter()
                .map(|(weight, scale, profile)| Part { weight: *weight, scale: *scale, profile: profile.clone() })
                .collect();
            let mixture = MixtureProfile::new(parts).unwrap_or_else(|error| panic!("{error}"));
            check(&format!("mixture {k}"), &mixture, 2e-5)
        })
        .reduce(|| (0.0, 0.0, 0.0), |a, b| (a.0.max(b.0), a.1.max(b.1), a.2.max(b.2)));
    println!("worst {worst:?}");
}

/// The list over s in double precision says what the one in single precision says, to its own digits; and how steep a table is.
#[test]
fn double_precision_has_the_same_cells() {
    let mut random = Random::seeded("double cells");
    for (kind, count) in [(0, 64), (2, 1000), (4, 30), (6, 12)] {
        let profile = random_table(&mut random, kind, count).profile();
        let cells = ProfileCells::new(&profile);
        let (double, mut steepest) = (cells.double(), 0.0_f64);
        let peak = profile.nodes().map(|node| node.1).fold(0.0, f64::max);
        for _ in 0..4000 {
            let x = profile.quantile(random.unit()).max(1e-9);
            let s = x * x;
            // the float at or below s
            let bits = if f64::from(s as f32) > s { (s as f32).next_down() } else { s as f32 }.to_bits();
            let entry = double[(bits >> 23) as usize] as u32;
            let bucket = (entry >> 5) + ((bits & 0x7f_ffff) >> (entry & 31));
            let bucket = &double[BUCKET * bucket as usize..][..BUCKET];
            let cell = bucket[0] as usize + bucket[1..].iter().filter(|&&start| start <= s).count();
            let [anchor, rate, _, log2_f, exponent, ..] = double[CELL * cell..][..CELL] else { panic!("no cell") };
            let log_f = log2_f * std::f64::consts::LN_2 - exponent * ((s - anchor) * rate).ln_1p();
            let f = profile.f(x);
            let steep = |h: f64| ((profile.f(x * (1.0 + h)) / f).ln() / h).abs();
            let here = steep(1e-7).max(steep(-1e-7));
            // x is rounded once more than s
            assert!((log_f - f.ln()).abs() < 1e-12 + 1e-15 * here, "kind {kind}: {log_f} is not {} at {x:e}", f.ln());
            if f > 2e-7 * peak && steep(1e-7).min(steep(-1e-7)) > 0.999 * here {
                steepest = steepest.max(here);
            }
        }
        assert!(steepest < 1.001 * cells.steepness(), "kind {kind}: {steepest} is steeper than {}", cells.steepness());
        assert!(cells.steepness() < 1e3 * steepest.max(0.1), "kind {kind}: {} is too much", cells.steepness());
    }
}

/// Two parts with a thousand steps each have more places between steps than there may be cells: they are cells all the same.
#[test]
fn parts_with_a_thousand_steps_end() {
    let mut random = Random::seeded("steps");
    let mut steps = || -> Arc<dyn Profile> {
        let slopes: Vec<f64> = (0..1000).map(|k| f64::from(k) * 0.003).collect();
        let values: Vec<f64> = slopes.iter().map(|_| 10f64.powf(random.between(-200.0, 0.0))).collect();
        let profile = TabulatedProfile::new(&slopes, &values, TableTail::Cut);
        Arc::new(profile.unwrap_or_else(|error| panic!("{error}")))
    };
    let parts = [(1.0, 1.0), (1.0, 0.37)];
    let parts = parts.map(|(weight, scale)| Part { weight, scale, profile: steps() }).into();
    let mixture = MixtureProfile::new(parts).unwrap_or_else(|error| panic!("{error}"));
    let cells = ProfileCells::new(&mixture);
    assert!(cells.single().iter().all(|number| !number.is_nan()), "{} cells", cells.count());
}

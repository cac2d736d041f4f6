//! How many nodes does a distribution need?

mod cases;

use cases::{LIST, Random, random_shapes, row_cases};
use rayon::prelude::*;
use sgtd_core::masking::{MaskingIntegral, Rule};
use sgtd_core::profile::resample::resample;
use sgtd_core::profile::{Profile, TabulatedProfile};

/// Greatest error of G1, and relative error of f where it is above 1e-6 of its peak.
fn errors(exact: &dyn Profile, table: &TabulatedProfile) -> (f64, f64) {
    let unit = table.width();
    let (of_exact, of_table) =
        (MaskingIntegral::new(exact, Rule::REFERENCE), MaskingIntegral::new(table, Rule::REFERENCE));
    let mut g1 = 0.0_f64;
    for k in 0..400 {
        let a = 10f64.powf(-4.0 + 8.0 * f64::from(k) / 400.0) * exact.mean();
        let (want, got) = (a / (a + of_exact.at(exact, a).h), a / (a + unit * of_table.at(table, a / unit).h));
        g1 = g1.max((got / want - 1.0).abs());
    }
    let mut xs: Vec<f64> = exact
        .breaks(60.0)
        .windows(2)
        .flat_map(|ends| (0..50).map(|k| ends[0] + (ends[1] - ends[0]) * f64::from(k) / 50.0).collect::<Vec<_>>())
        .collect();
    xs.insert(0, 0.0);
    let peak = xs.iter().map(|&x| exact.f(x)).fold(0.0, f64::max);
    let mut d = (0.0_f64, 0.0);
    for &x in &xs {
        let want = exact.f(x) * exact.normalization();
        let got = table.f(x / unit) * table.normalization() / (unit * unit);
        if exact.f(x) > 1e-6 * peak && !((got / want - 1.0).abs() <= d.0) {
            d = ((got / want - 1.0).abs(), x);
        }
    }
    (g1, d.0)
}

#[test]
fn sixty_four_nodes_make_any_row() {
    let rows = row_cases().into_iter().map(|(name, case)| (name.to_owned(), case));
    let mut random = Random::seeded("resample");
    let more = random_shapes(&mut random, 150);
    let named = LIST.into_iter().chain(more).map(|case| (format!("{case:?}"), case));
    let worst = rows
        .chain(named)
        // heavier tails take more
        .filter(|(_, case)| case.excess() >= 0.2)
        .collect::<Vec<_>>()
        .par_iter()
        .map(|(name, case)| {
            let exact = case.profile();
            let student = case.p == 1.0 && case.lambda == 0.0 && case.shift == 0.0;
            let made =
                resample(&exact, if student { 32 } else { 64 }).unwrap_or_else(|error| panic!("{name}: {error}"));
            let (g1, d) = errors(&exact, &made.profile);
            // a thin ring takes more: its sides are straight in no coordinate
            let permitted = if case.shift < 50.0 { 1e-2 } else { 3e-2 };
            assert!(g1 <= 1e-3 && d <= permitted, "{name}: G1 {g1:.1e}, D {d:.1e} with {} nodes", made.slopes.len());
            (g1, d)
        })
        .reduce(|| (0.0, 0.0), |a, b| (a.0.max(b.0), a.1.max(b.1)));
    println!("worst {worst:?}");
}

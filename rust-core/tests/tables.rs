//! Do the tables keep what they promise: accuracy, size, and a flat layout that gives what the core gives?

mod cases;

use cases::altered::Altered;
use cases::{Case, LIST, Random};
use rayon::prelude::*;
use sgtd_core::masking::table::{ENTRIES, FINEST_SINGLE, LambdaTable};
use sgtd_core::masking::{MaskingIntegral, Rule};
use sgtd_core::ndf::{Ndf, Roughness, Shadowing};
use sgtd_core::numerics::greatest;
use sgtd_core::sampling::visible_table::{BLOCK, CELLS, LIST_SIZE, ROW_SIZE, VIEW_ROWS, VisibleTable};
use sgtd_core::scattering::albedo_table::AlbedoTable;

const ACCURACIES: [f64; 10] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10];

/// Accuracies that are promised to be reached; beyond, the finest table may be too coarse next to a cusp.
const REACHED_FROM: f64 = 1e-6;

/// Bytes that the two tables of a material may take together at the default accuracy.
const DEFAULT_ACCURACY: f64 = 1e-5;
const LARGEST: usize = 16 * 1024;

fn shapes() -> Vec<Case> {
    let mut shapes = LIST.to_vec();
    shapes.extend(cases::random_shapes(&mut Random::seeded("tables"), 20));
    shapes
}

/// Arguments between which the table is measured: evenly in the logarithm, over all octaves that a table may span.
fn arguments() -> impl Iterator<Item = f64> {
    const COUNT: u32 = 2000;
    (0..COUNT).map(|k| 10f64.powf(-9.0 + 17.0 * f64::from(k) / f64::from(COUNT)))
}

/// The relative error of G1 against quadrature is at most what `reached` says, and that at most what was asked for.
#[test]
fn promised_accuracy_is_reached() {
    let results: Vec<(Case, [(f64, f64, f64, usize); ACCURACIES.len()])> = shapes()
        .into_par_iter()
        .map(|case| {
            let profile = case.profile();
            let masking = MaskingIntegral::new(&profile, Rule::REFERENCE);
            let rough = MaskingIntegral::new(&profile, Rule::TABLE);
            let truth: Vec<(f64, f64)> = arguments().map(|a| (a, masking.at(&profile, a).h)).collect();
            let measured = ACCURACIES.map(|accuracy| {
                let rule = if accuracy < FINEST_SINGLE { &masking } else { &rough };
                let table = LambdaTable::new(&profile, rule, accuracy);
                let (error, a) = truth
                    .iter()
                    .map(|&(a, h)| (((a + h) / (a + table.h(a)) - 1.0).abs(), a))
                    .fold((0.0, 0.0), |worst, next| if !(next.0 <= worst.0) { next } else { worst });
                (error, table.reached(), a, 4 * table.flat().len())
            });
            (case, measured)
        })
        .collect();
    let mut failures = Vec::new();
    for (case, measured) in results {
        println!("{case:?}");
        for (accuracy, (error, reached, a, bytes)) in ACCURACIES.into_iter().zip(measured) {
            println!("    {accuracy:.0e}: error {error:.1e} at a = {a:.2e}, reached {reached:.1e}, {bytes} bytes");
            if error > reached {
                failures.push(format!("{case:?} at {accuracy:e}: error {error:.2e} above {reached:.2e} at a = {a:e}"));
            }
            if accuracy >= REACHED_FROM && reached > accuracy {
                failures.push(format!("{case:?} at {accuracy:e}: reached only {reached:.2e}"));
            }
            if reached > 4.0 * FINEST_SINGLE.max(accuracy) {
                failures.push(format!("{case:?} at {accuracy:e}: reached only {reached:.2e}"));
            }
        }
    }
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}

/// A finer accuracy never makes a smaller table, and what is reached follows what is asked for.
#[test]
fn tables_grow_with_accuracy() {
    for case in LIST {
        let profile = case.profile();
        let rough = MaskingIntegral::new(&profile, Rule::TABLE);
        let sizes = ACCURACIES.map(|accuracy| LambdaTable::new(&profile, &rough, accuracy).flat().len());
        assert!(sizes.windows(2).all(|pair| pair[0] <= pair[1]), "{case:?}: {sizes:?}");
    }
}

#[test]
fn tables_fit_into_the_first_level_cache() {
    for case in shapes() {
        let ndf = Ndf::new(Box::new(case.profile()), DEFAULT_ACCURACY).unwrap_or_else(|error| panic!("{error}"));
        let bytes = 4 * (ndf.lambda_table().flat().len() + ndf.visible_table().flat().len());
        assert!(bytes <= LARGEST, "{case:?}: {bytes} bytes");
    }
}

/// H from the flat table as a renderer reads it: single precision, an octave's entry, one cubic.
fn h_from_flat(table: &LambdaTable, a: f32) -> f32 {
    let (entries, cells) = table.flat().split_at(ENTRIES);
    let bits = a.to_bits();
    let entry = entries[(bits >> 23) as usize].to_bits();
    let (shift, start) = (entry & 31, entry >> 5);
    let cell = (start + ((bits & 0x7f_ffff) >> shift)) as usize;
    let d = a - f32::from_bits((bits >> shift) << shift);
    cells[4 * cell..4 * cell + 4].iter().rev().fold(0.0, |sum, c| d * sum + c).max(0.0)
}

#[test]
fn flat_masking_table_gives_what_the_core_gives() {
    for case in LIST {
        for accuracy in [1e-2, 1e-4, 1e-6] {
            let ndf = Ndf::new(Box::new(case.profile()), accuracy).unwrap_or_else(|error| panic!("{error}"));
            let table = ndf.lambda_table();
            let special = [0.0, f32::from_bits(1), f32::MIN_POSITIVE, f32::MAX];
            for a in arguments().map(|a| a as f32).chain(special) {
                let flat = h_from_flat(table, a);
                let core = table.h(f64::from(a));
                // rounding of the single-precision cubic, whose terms are as large as H at the left end
                let error = (f64::from(flat) - core).abs() / (f64::from(a) + core);
                assert!(error < 1e-6, "{case:?} {accuracy:e} a = {a:e}: H = {flat:e}, core {core:e}");
            }
        }
    }
}

/// The layout that renderers read: every eighth knot, all 64 knots, left knot and width of the 63 cells; then for each view the masses
/// C likewise, and mass and packed end densities of the cells.
#[test]
fn flat_visible_table_gives_what_the_core_gives() {
    for case in LIST {
        let ndf = Ndf::new(Box::new(case.profile()), DEFAULT_ACCURACY).unwrap_or_else(|error| panic!("{error}"));
        let table = ndf.visible_table();
        let flat = table.flat();
        assert_eq!(flat.len(), (1 + VIEW_ROWS) * ROW_SIZE, "{case:?}");
        let every_eighth = |list: &[f32]| list[BLOCK..].iter().copied().step_by(BLOCK).collect::<Vec<_>>();
        assert_eq!(flat[..BLOCK], every_eighth(&flat[..LIST_SIZE]), "{case:?}");
        let knots = table.knots();
        assert_eq!((knots.len(), knots[0]), (CELLS, 0.0), "{case:?}");
        assert_eq!(knots, &flat[BLOCK..LIST_SIZE], "{case:?}");
        assert!(knots.windows(2).all(|pair| pair[0] < pair[1]), "{case:?}: knots {knots:?}");
        assert!(table.scale() > 0.0 && table.scale().is_finite());
        assert!((table.scale() * std::f64::consts::PI / ndf.profile().mean() - 1.0).abs() < 1e-14, "{case:?}");
        let slopes = table.slopes();
        assert_eq!(slopes.len(), CELLS);
        assert!(
            slopes.iter().zip(knots).all(|(slope, &y)| (slope * slope - f64::from(y)).abs() <= 1e-15 * f64::from(y))
        );
        for (j, cell) in flat[LIST_SIZE..ROW_SIZE].chunks(2).enumerate() {
            let want = if j + 1 < CELLS { [knots[j], knots[j + 1] - knots[j]] } else { [0.0; 2] };
            assert_eq!(cell, want, "{case:?} cell {j}");
        }
        for (row, numbers) in flat[ROW_SIZE..].chunks(ROW_SIZE).enumerate() {
            let (masses, pairs) = numbers.split_at(LIST_SIZE);
            assert_eq!(masses[..BLOCK], every_eighth(masses), "{case:?} row {row}");
            let masses = &masses[BLOCK..];
            assert_eq!(masses[0], 1.0, "{case:?} row {row}");
            assert!(masses.windows(2).all(|pair| pair[0] >= pair[1]), "{case:?} row {row}: masses above do not fall");
            assert!(masses[CELLS - 1] >= 0.0, "{case:?} row {row}");
            let ends = |j: usize| {
                let bits = pairs[2 * j + 1].to_bits();
                [f32::from_bits(bits & 0xFFFF_0000), f32::from_bits(bits << 16)]
            };
            for j in 0..CELLS - 1 {
                assert_eq!(pairs[2 * j], masses[j] - masses[j + 1], "{case:?} row {row}: mass of cell {j}");
                assert!(ends(j).iter().all(|g| *g >= 0.0 && g.is_finite()), "{case:?} row {row} cell {j}");
                assert!(j == 0 || ends(j - 1)[1] == ends(j)[0], "{case:?} row {row}: jumps at knot {j}");
            }
            assert_eq!(pairs[2 * CELLS - 2..], [0.0; 2]);
            // exactly on a row, the density at a knot is g
            let a = table.scale() * row as f64 / (VIEW_ROWS - 1 - row) as f64;
            let mixture =
                if row == VIEW_ROWS - 1 { table.unseen() } else { table.mixture(a / a.hypot(1.0), 1.0 / a.hypot(1.0)) };
            for (j, &knot) in knots.iter().enumerate().take(CELLS - 1) {
                let (got, want) = (table.density(mixture, f64::from(knot)), f64::from(ends(j)[0]));
                let empty = pairs[2 * j] == 0.0;
                assert!(
                    empty || (got - want).abs() <= 1e-5 * want,
                    "{case:?} row {row} knot {j}: {got:e}, not {want:e}"
                );
            }
        }
    }
}

/// Λ and G1 of directions at any accuracy are those of the table or of quadrature; the two modes agree to the promise.
#[test]
fn modes_agree_to_the_promised_accuracy() {
    let mut random = Random::seeded("modes");
    let views: Vec<_> = (0..300).map(|_| random.direction()).collect();
    LIST.into_par_iter().for_each(|case| {
        let ndf = |accuracy| Ndf::new(Box::new(case.profile()), accuracy).unwrap_or_else(|error| panic!("{error}"));
        let exact = ndf(0.0);
        assert!(exact.accuracy_reached() <= 1e-12);
        for accuracy in [1e-2, 1e-4] {
            let table = ndf(accuracy);
            assert!(table.accuracy_reached() <= accuracy, "{case:?}: {} of {accuracy}", table.accuracy_reached());
            for (k, &w) in views.iter().enumerate() {
                let alpha = [(1.0, 1.0), (0.1, 0.1), (0.05, 0.5)][k % 3];
                let alpha = Roughness { u: alpha.0, v: alpha.1 };
                let error = (table.g1(alpha, w) / exact.g1(alpha, w) - 1.0).abs();
                assert!(error <= table.accuracy_reached(), "{case:?} {accuracy:e} {alpha:?} {w:?}: {error:e}");
            }
        }
    });
}

/// Without visible normals only the row of D·cos is there, and all draws and densities are those of the whole table, bit for bit.
#[test]
fn the_table_of_projected_normals_is_the_last_row() {
    for case in LIST {
        let whole = Ndf::new(Box::new(case.profile()), DEFAULT_ACCURACY).unwrap_or_else(|error| panic!("{error}"));
        let alone =
            Ndf::projected(Box::new(case.profile()), DEFAULT_ACCURACY).unwrap_or_else(|error| panic!("{error}"));
        let (table, row) = (whole.visible_table(), alone.visible_table());
        assert_eq!((table.rows(), row.rows()), (VIEW_ROWS, 1));
        assert_eq!(row.flat().len(), 2 * ROW_SIZE);
        assert_eq!(row.flat()[..ROW_SIZE], table.flat()[..ROW_SIZE]);
        assert_eq!(row.flat()[ROW_SIZE..], table.flat()[VIEW_ROWS * ROW_SIZE..]);
        let alpha = Roughness { u: 0.3, v: 0.1 };
        for k in 0..64 {
            let u = (f64::from(k) / 64.0, 0.37);
            let (a, b) = (whole.sample_projected(alpha, u), alone.sample_projected(alpha, u));
            assert_eq!(a, b, "{case:?}");
            assert_eq!(whole.pdf_projected(alpha, a.m), alone.pdf_projected(alpha, a.m), "{case:?}");
            // still a sampler that says what it draws
            let drawn = alone.sample_visible(alpha, cases::direction(1.2, 0.3), u);
            let said = alone.pdf_visible(alpha, cases::direction(1.2, 0.3), drawn.m);
            assert!(drawn.pdf == 0.0 || (said / drawn.pdf - 1.0).abs() < 1e-6, "{case:?}: {said} {}", drawn.pdf);
        }
    }
}

/// A shape of which only D and G1 are asked for has no table of visible normals, and the one that comes with the first draw is what it would
/// have been, for all threads that draw first.
#[test]
fn normals_are_tabulated_when_they_are_drawn() {
    for case in LIST {
        let profile = case.profile();
        let expected = VisibleTable::new(&profile, &MaskingIntegral::new(&profile, Rule::TABLE));
        let ndf = Ndf::new(Box::new(profile), DEFAULT_ACCURACY).unwrap_or_else(|error| panic!("{error}"));
        let (alpha, views) =
            (Roughness { u: 0.3, v: 0.1 }, [0.1, 0.8, 1.2, 1.5].map(|theta| cases::direction(theta, 0.3)));
        let ask = || views.iter().map(|&w| (ndf.d(alpha, w), ndf.g1(alpha, w))).collect::<Vec<_>>();
        let before = ask();
        assert!(!ndf.draws(), "{case:?}");
        let drawn: Vec<_> = (0..8).into_par_iter().map(|_| ndf.sample_visible(alpha, views[0], (0.3, 0.7))).collect();
        assert!(ndf.draws() && drawn.iter().all(|sample| *sample == drawn[0]), "{case:?}");
        assert_eq!(ndf.visible_table().flat(), expected.flat(), "{case:?}");
        assert_eq!(ask(), before, "{case:?}");
    }
}

/// Two knots that single precision cannot tell apart would make a cell without a width: the rim of a ring at m = 1000 with p = 50.
#[test]
fn knots_are_distinct_as_they_are_stored() {
    let mut all = cases::edge_shapes();
    all.extend(cases::random_shapes(&mut Random::seeded("knots"), 100));
    all.into_par_iter().for_each(|case| {
        let profile = case.profile();
        let table = VisibleTable::projected(&profile, &MaskingIntegral::new(&profile, Rule::TABLE));
        assert!(table.knots().windows(2).all(|pair| pair[0] < pair[1]), "{case:?}: {:?}", table.knots());
    });
}

/// `f64::max` drops what is not a number: a table of NaN would have reached 0.
#[test]
fn tables_of_nan_do_not_claim_to_be_exact() {
    assert_eq!(greatest([1.0, f64::NAN, 2.0]), f64::INFINITY);
    assert_eq!(greatest([]), 0.0);
    for case in [LIST[0], LIST[1], LIST[4]] {
        // not a number here and there, which no constructor lets through
        let f = |x, f| if x > 2.0 { f64::NAN } else { f };
        let profile = Altered { profile: case.profile(), f, bends: false };
        let masking = MaskingIntegral::new(&profile, Rule::TABLE);
        assert_eq!(LambdaTable::new(&profile, &masking, 1e-3).reached(), f64::INFINITY, "{case:?}");
        let ndf = Ndf::new(Box::new(profile), 1e-3).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(ndf.visible_table().flat().len(), (1 + VIEW_ROWS) * ROW_SIZE, "{case:?}");
        if case == LIST[0] {
            let table = AlbedoTable::anisotropic(&ndf, Shadowing::Separable, Roughness { u: 0.1, v: 0.3 });
            assert_eq!(table.reached(), f64::INFINITY, "{case:?}");
        }
    }
}

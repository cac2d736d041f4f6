//! Does every public function keep the error that the table permits it?
//!
//! `cargo test --release --test accuracy -- --nocapture` prints maximum, root mean square and worst input per function.

mod cases;
#[path = "accuracy/coverage.rs"]
mod coverage;
#[path = "accuracy/measure.rs"]
mod measure;
mod oracle;
#[path = "accuracy/table.rs"]
mod table;

use measure::Source;
use std::collections::BTreeSet;
use table::{Check, TABLE};

/// The tests below are one row of the table each, so that a failure does not hide others.
fn check(rows: impl Fn(&str) -> bool) {
    let mut failures = Vec::new();
    for row in TABLE.iter().filter(|row| rows(row.function)) {
        let Check::Within { permitted, against, measure } = row.check else { continue };
        let record = measure();
        println!(
            "{:<42} max {:.1e} of {permitted:.0e}, rms {:.1e}, {} inputs, against {against}\n    worst: {}",
            row.function,
            record.max,
            record.rms(),
            record.count(),
            record.worst
        );
        for source in [Source::List, Source::Edge, Source::Spaced, Source::Random] {
            assert!(record.counts[source as usize] > 0, "{}: no inputs from source {source:?}", row.function);
        }
        if record.max > permitted {
            failures.push(format!("{}: {:.2e} > {permitted:.0e} at {}", row.function, record.max, record.worst));
        }
    }
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}

#[test]
fn profiles_stay_within_their_permitted_error() {
    check(|function| function.starts_with("profile::"));
}

#[test]
fn moments_stay_within_their_permitted_error() {
    check(|function| {
        ["family::partial_moment::", "numerics::gamma_ratio::", "numerics::exponent::"]
            .iter()
            .any(|file| function.starts_with(file))
    });
}

#[test]
fn solvers_stay_within_their_permitted_error() {
    check(|function| {
        ["numerics::quadrature::", "numerics::invert::", "sampling::azimuth::"]
            .iter()
            .any(|file| function.starts_with(file))
    });
}

#[test]
fn masking_stays_within_its_permitted_error() {
    check(|function| function.starts_with("masking::integral::"));
}

#[test]
fn directions_stay_within_their_permitted_error() {
    check(|function| function.starts_with("ndf::"));
}

#[test]
fn every_measured_row_is_checked() {
    let measured =
        ["profile::", "family::partial_moment::", "numerics::", "sampling::azimuth::", "masking::integral::", "ndf::"];
    for row in TABLE {
        if let Check::Within { .. } = row.check {
            let checked = measured.iter().any(|&start| row.function.starts_with(start));
            assert!(checked, "{} is in the table, but no test above measures it", row.function);
        }
    }
}

/// The oracle is independent of the reference files, so it is measured against them before it measures anything.
#[test]
fn oracle_reproduces_the_reference_values() {
    for (quantity, permitted) in [("A", 2e-15), ("Af", 2e-15), ("cdf", 5e-15), ("sf", 1e-14), ("Lambda", 1e-14)] {
        let record = measure::oracle_against_references(quantity);
        println!(
            "{quantity:<7} max {:.1e} of {permitted:.0e}, rms {:.1e}, worst {}",
            record.max,
            record.rms(),
            record.worst
        );
        assert!(record.max <= permitted, "{quantity}: {:.1e} at {}", record.max, record.worst);
    }
}

#[test]
fn every_public_function_has_a_row() {
    let functions = coverage::public_functions();
    assert!(functions.len() > 40, "only {} public functions found: the reader is broken", functions.len());
    let rows: BTreeSet<String> = TABLE.iter().map(|row| row.function.to_owned()).collect();
    let without: Vec<_> = functions.difference(&rows).collect();
    let beyond: Vec<_> = rows.difference(&functions).collect();
    assert!(without.is_empty(), "public functions without a row in tests/accuracy/table.rs: {without:#?}");
    assert!(beyond.is_empty(), "rows of functions that are no longer public: {beyond:#?}");
}

#[test]
fn tests_that_are_named_exist() {
    let tests = coverage::tests();
    for row in TABLE {
        if let Check::Total { test } = row.check {
            assert!(tests.contains(test), "{} is covered by {test}, which does not exist", row.function);
        }
    }
    let referred = coverage::tests_that_are_referred_to();
    assert!(!referred.is_empty(), "no documentation names a test: the reader is broken");
    for (file, test) in referred {
        assert!(tests.contains(&test), "src/{file}.rs refers to the test {test}, which does not exist");
    }
}

//! Does the fuzz target's check pass for a few seconds? (`cargo run --release --example fuzz` runs as long as it is
//! told to.)

#[path = "../examples/fuzz/check.rs"]
mod check;

use check::{Bits, Input, Parameters, Tables, check, check_cells, check_inverses};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Time that the test may take.
const BUDGET: Duration = Duration::from_secs(4);
/// At least so many shapes must have been accepted, or the test looks at nothing.
const LEAST: usize = 60;

#[test]
fn nothing_that_is_accepted_gives_a_bad_value() {
    let start = Instant::now();
    let mut accepted = 0;
    let mut first = 0;
    while start.elapsed() < BUDGET || accepted < LEAST {
        let results: Vec<Result<bool, String>> = (first..first + 64)
            .into_par_iter()
            .map(|seed: u64| {
                let mut bits = Bits::new(seed);
                let reference = seed.is_multiple_of(64);
                let (built, what) = if seed % 2 == 1 {
                    let tables = Tables::draw(&mut bits);
                    (tables.build(reference), format!("{tables:?}"))
                } else {
                    let parameters = Parameters::draw(&mut bits);
                    (parameters.build(reference), parameters.bits())
                };
                let Some(ndf) = built else { return Ok(false) };
                for k in 0..if reference { 100 } else { 1000 } {
                    let input = Input::draw(&mut bits);
                    check(&ndf, &input)
                        .and_then(|()| if k % 32 == 0 { check_inverses(ndf.profile(), &input) } else { Ok(()) })
                        .map_err(|error| format!("seed {seed}: {what}, reference {reference}:\n{error}"))?;
                }
                if seed % 2 == 1 {
                    check_cells(ndf.profile()).map_err(|error| format!("seed {seed}: {what}:\n{error}"))?;
                }
                Ok(true)
            })
            .collect();
        for result in results {
            accepted += usize::from(result.unwrap_or_else(|error| panic!("{error}")));
        }
        first += 64;
    }
    println!("{accepted} shapes of {first} accepted");
    assert!(accepted < first as usize, "nothing was refused: raw bits are missing");
}

//! Fuzzing on stable: raw parameter bytes in, no bad value out.
//!
//! `cargo run --release --example fuzz -- --seconds 600 [--seed N] [--profiles 1]`
//!
//! With `--profiles 1`, tables and mixtures alone, many of them: each as a profile, with its inverses and what single precision reads of it.
//!
//! Every shape that the core accepts is evaluated at some thousands of inputs; the first failing one is printed as bits
//! and ends the run with an error.

mod check;

use check::{Bits, Input, Parameters, Tables, check, check_cells, check_inverses, check_profile};
use rayon::prelude::*;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant, SystemTime};

/// Inputs per shape: building its tables takes as long as some hundred evaluations.
const INPUTS: u64 = 4000;
/// One shape in so many is evaluated by quadrature, at fewer inputs.
const REFERENCE_EVERY: u64 = 64;
/// Inputs of such a shape.
const REFERENCE_INPUTS: u64 = 200;
/// One input in so many inverts the cdf.
const INVERSES_EVERY: u64 = 32;

#[derive(Default)]
struct Counts {
    tried: AtomicU64,
    accepted: AtomicU64,
    inputs: AtomicU64,
    reference: AtomicU64,
}

/// One shape and its inputs.
fn run(seed: u64, counts: &Counts) -> Result<(), String> {
    let mut bits = Bits::new(seed);
    counts.tried.fetch_add(1, Ordering::Relaxed);
    let (built, what, reference) = if seed.is_multiple_of(2) {
        let tables = Tables::draw(&mut bits);
        let reference = bits.next().is_multiple_of(REFERENCE_EVERY);
        (tables.build(reference), format!("seed {seed}, {tables:?}"), reference)
    } else {
        let parameters = Parameters::draw(&mut bits);
        let reference = bits.next().is_multiple_of(REFERENCE_EVERY);
        (parameters.build(reference), parameters.bits(), reference)
    };
    let Some(ndf) = built else { return Ok(()) };
    counts.accepted.fetch_add(1, Ordering::Relaxed);
    let inputs = if reference { REFERENCE_INPUTS } else { INPUTS };
    for k in 0..inputs {
        let input = Input::draw(&mut bits);
        let mut result = check(&ndf, &input);
        if k % INVERSES_EVERY == 0 {
            result = result.and_then(|()| check_inverses(ndf.profile(), &input));
        }
        result.map_err(|error| format!("{what}, reference {reference}:\n{error}"))?;
    }
    counts.inputs.fetch_add(inputs, Ordering::Relaxed);
    if reference {
        counts.reference.fetch_add(inputs, Ordering::Relaxed);
    }
    Ok(())
}

/// Inputs of a profile alone.
const PROFILE_INPUTS: usize = 8;
/// What single precision reads costs a hundred times as much, so that one in this many profiles is checked for it.
const CELLS_EVERY: u64 = 16;

/// One table or mixture, as a profile.
fn run_profile(seed: u64, counts: &Counts) -> Result<(), String> {
    let mut bits = Bits::new(seed);
    counts.tried.fetch_add(1, Ordering::Relaxed);
    let tables = Tables::draw(&mut bits);
    let Some(profile) = tables.profile() else { return Ok(()) };
    counts.accepted.fetch_add(1, Ordering::Relaxed);
    let inputs = (0..PROFILE_INPUTS).map(|_| Input::draw(&mut bits)).try_for_each(|input| {
        check_profile(profile.as_ref(), input.x()).and_then(|()| check_inverses(profile.as_ref(), &input))
    });
    let cells = || if seed.is_multiple_of(CELLS_EVERY) { check_cells(profile.as_ref()) } else { Ok(()) };
    inputs.and_then(|()| cells()).map_err(|error| format!("seed {seed}, {tables:?}:\n{error}"))?;
    counts.inputs.fetch_add(PROFILE_INPUTS as u64, Ordering::Relaxed);
    Ok(())
}

/// The number that follows an option.
fn option(name: &str) -> Option<u64> {
    let mut arguments = std::env::args().skip_while(|argument| argument != name).skip(1);
    arguments.next().and_then(|value| value.parse().ok())
}

fn main() -> ExitCode {
    let seconds = option("--seconds").unwrap_or(60);
    let clock = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(1, |time| time.as_nanos() as u64);
    let seed = option("--seed").unwrap_or(clock);
    println!("seed {seed}, {seconds} s");
    let run = if option("--profiles").is_some() { run_profile } else { run };
    let counts = Counts::default();
    let start = Instant::now();
    let mut shape = 0;
    let mut failure = None;
    let mut reported = start;
    while failure.is_none() && start.elapsed() < Duration::from_secs(seconds) {
        let batch = shape..shape + 256;
        shape += 256;
        failure = batch.into_par_iter().find_map_any(|k| run(seed.wrapping_add(k), &counts).err());
        if reported.elapsed() > Duration::from_secs(30) {
            reported = Instant::now();
            println!("{:>5.0} s: {} inputs", start.elapsed().as_secs_f64(), counts.inputs.load(Ordering::Relaxed));
        }
    }
    let [tried, accepted, inputs, reference] =
        [&counts.tried, &counts.accepted, &counts.inputs, &counts.reference].map(|count| count.load(Ordering::Relaxed));
    println!(
        "{inputs} inputs ({reference} by quadrature) at {accepted} shapes, {:.0} % of {tried} tried, in {:.0} s",
        100.0 * accepted as f64 / tried as f64,
        start.elapsed().as_secs_f64()
    );
    match failure {
        None => ExitCode::SUCCESS,
        Some(failure) => {
            println!("FAILED: {failure}");
            ExitCode::FAILURE
        }
    }
}

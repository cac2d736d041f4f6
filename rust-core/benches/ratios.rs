//! Core functions against a peer, as ratios of medians from interleaved repetitions in one run.
//!
//! `cargo bench --bench ratios`; the targets stand in the README.

use glam::DVec3;
use sgtd_core::masking::{MaskingIntegral, Rule};
use sgtd_core::ndf::{Ndf, Roughness};
use sgtd_core::shape::Shape;
use sgtd_core::skewed_t::SkewedT;
use std::hint::black_box;
use std::time::Instant;

/// Repetitions of each pair; the median of 41 moves by about 1 % on a noisy machine.
const REPETITIONS: usize = 41;
/// Calls per repetition: some tens of microseconds.
const CALLS: usize = 4096;

/// Nanoseconds per call of `f` over all inputs.
fn time<T: Copy>(inputs: &[T], f: &mut dyn FnMut(T) -> f64) -> f64 {
    let start = Instant::now();
    let mut sum = 0.0;
    for &input in inputs {
        sum += f(black_box(input));
    }
    black_box(sum);
    start.elapsed().as_nanos() as f64 / inputs.len() as f64
}

fn quantiles(values: &mut [f64]) -> (f64, f64, f64) {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share) as usize];
    (at(0.25), at(0.5), at(0.75))
}

/// Times both sides alternately and prints the ratio of each pair of repetitions.
fn compare<T: Copy, U: Copy>(
    what: &str,
    target: &str,
    (ours, f): (&[T], &mut dyn FnMut(T) -> f64),
    (theirs, g): (&[U], &mut dyn FnMut(U) -> f64),
) {
    let (mut a, mut b, mut ratio) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..REPETITIONS {
        let (x, y) = (time(ours, f), time(theirs, g));
        a.push(x);
        b.push(y);
        ratio.push(x / y);
    }
    let (low, middle, high) = quantiles(&mut ratio);
    println!(
        "{what:<58} {:>8.1} ns {:>8.1} ns   ratio {middle:.3} [{low:.3}, {high:.3}]   target {target}",
        quantiles(&mut a).1,
        quantiles(&mut b).1,
    );
}

/// Van der Corput points: the same inputs in every run.
fn spread(count: usize, base: u32) -> Vec<f64> {
    (1..=count as u32)
        .map(|mut k| {
            let (mut value, mut unit) = (0.0, 1.0 / f64::from(base));
            while k > 0 {
                value += unit * f64::from(k % base);
                k /= base;
                unit /= f64::from(base);
            }
            value
        })
        .collect()
}

fn directions(count: usize) -> Vec<DVec3> {
    spread(count, 2)
        .into_iter()
        .zip(spread(count, 3))
        .map(|(u, v)| {
            let z = 1.0 - u;
            let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
            let r = (1.0 - z * z).max(0.0).sqrt();
            DVec3::new(r * cos, r * sin, z)
        })
        .collect()
}

fn main() {
    let ndf = |gamma, p, lambda, shift, accuracy| {
        let shape = Shape::new(gamma, p, lambda, shift).expect("shapes of this bench are valid");
        Ndf::new(Box::new(SkewedT::new(shape)), accuracy).expect("accuracies of this bench are valid")
    };
    let full = ndf(2.7, 1.3, 0.3, 0.4, 1e-5);
    let ggx = ndf(2.0, 1.0, 0.0, 0.0, 1e-5);
    let alpha = Roughness { u: 0.3, v: 0.2 };
    let w = directions(CALLS);
    let pairs: Vec<(f64, f64)> = spread(CALLS, 2).into_iter().zip(spread(CALLS, 5)).collect();
    let radii: Vec<f64> = spread(CALLS, 2).into_iter().map(|u| 4.0 * u).collect();
    println!("{:<58} {:>11} {:>11}", "ours against theirs, medians of interleaved repetitions", "ours", "theirs");
    compare(
        "D, full SGTD against two powf",
        "<= 1.25",
        (&w, &mut |w| full.d(alpha, w)),
        (&radii, &mut |x: f64| (1.0 + x.powf(black_box(2.6))).powf(black_box(-2.7))),
    );
    compare(
        "D, GGX shape against GGX closed form",
        "-",
        (&w, &mut |w| ggx.d(alpha, w)),
        (&w, &mut |w: DVec3| {
            let s = (w.x / alpha.u).powi(2) + (w.y / alpha.v).powi(2) + w.z * w.z;
            1.0 / (std::f64::consts::PI * alpha.u * alpha.v * s * s)
        }),
    );
    compare(
        "Lambda from the table against GGX closed form",
        "<= 2.5",
        (&w, &mut |w| full.lambda(alpha, w)),
        (&w, &mut |w: DVec3| {
            let (x, y) = (alpha.u * w.x, alpha.v * w.y);
            0.5 * ((1.0 + (x * x + y * y) / (w.z * w.z)).sqrt() - 1.0)
        }),
    );
    let profile = SkewedT::new(Shape::new(2.7, 1.3, 0.3, 0.4).expect("valid"));
    let integral = MaskingIntegral::new(&profile, Rule::REFERENCE);
    let smooth = SkewedT::new(Shape::new(2.0, 1.0, 0.0, 0.0).expect("valid"));
    let smooth_integral = MaskingIntegral::new(&smooth, Rule::REFERENCE);
    compare(
        "Lambda by quadrature: full SGTD, GGX shape",
        "<= 3000 ns",
        (&radii, &mut |q| integral.at(&profile, q).h),
        (&radii, &mut |q| smooth_integral.at(&smooth, q).h),
    );
    let wi = DVec3::new(0.8, 0.0, 0.6);
    compare(
        "sample a visible normal: full SGTD against GGX shape",
        "-",
        (&pairs, &mut |u| full.sample_visible(alpha, wi, u).pdf),
        (&pairs, &mut |u| ggx.sample_visible(alpha, wi, u).pdf),
    );
    compare(
        "pdf of a visible normal: full SGTD against GGX shape",
        "-",
        (&w, &mut |m| full.pdf_visible(alpha, wi, m)),
        (&w, &mut |m| ggx.pdf_visible(alpha, wi, m)),
    );
}

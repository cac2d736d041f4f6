//! Core functions against a peer, as ratios of medians from interleaved repetitions in one run.
//!
//! `cargo bench -p sgtd-benches --bench ratios`; the targets stand in the README.

use glam::DVec3;
use sgtd_core::family::shape::Shape;
use sgtd_core::family::skewed_t::SkewedT;
use sgtd_core::masking::{MaskingIntegral, Rule};
use sgtd_core::ndf::{Ndf, Roughness};
use sgtd_core::numerics::quadrature::gauss;
use sgtd_core::profile::Profile;
use sgtd_core::sampling::visible_table::VisibleTable;
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

/// `E[w²]` of the weight true/drawn density of visible normals, over what is drawn, for one shape and view (stretched slope a).
fn second_moment(profile: &SkewedT, integral: &MaskingIntegral, table: &VisibleTable, a: f64) -> f64 {
    let length = (1.0 + a * a).sqrt();
    let mixture = table.mixture(a / length, 1.0 / length);
    let factor = profile.normalization() / std::f64::consts::PI;
    let (mut second, mut first, mut drawn) = (0.0, 0.0, 0.0);
    for ends in table.slopes().windows(2) {
        for &(t, weight) in gauss(24).nodes() {
            let rho = ends[0] + t * (ends[1] - ends[0]);
            let past = if rho > a { ((rho - a) * (rho + a)).sqrt() - a * (a / rho).acos() } else { 0.0 };
            let area = 2.0 * rho * weight * (ends[1] - ends[0]);
            let exact = factor * profile.f(rho) * (std::f64::consts::PI * a + past) / (a + integral.at(profile, a).h);
            let spline = table.density(mixture, rho * rho);
            if spline > 0.0 {
                second += area * exact * exact / spline;
            }
            first += area * exact;
            drawn += area * spline;
        }
    }
    // relative to the ideal density on the same support
    second * drawn / (first * first)
}

/// Prints the worst second moment over rows of the family and views from 0 to 89.9 degrees at unit roughness.
fn print_second_moments() {
    let shapes = [
        ("sgtd", 2.7, 1.3, 0.3, 0.4),
        ("gtd", 1.8, 2.0, 0.0, 1.0),
        ("sgnd", f64::INFINITY, 1.7, -0.5, 2.0),
        ("std", 3.0, 1.0, -0.6, 0.5),
        ("gnd", f64::INFINITY, 0.6, 0.0, 0.0),
        ("snd", f64::INFINITY, 1.0, 0.8, 1.0),
        ("student", 1.6, 1.0, 0.0, 0.0),
        ("beckmann", f64::INFINITY, 1.0, 0.0, 0.7),
        ("ggx", 2.0, 1.0, 0.0, 5.0),
    ];
    let mut worst = (0.0, "", 0.0);
    for (name, gamma, p, lambda, shift) in shapes {
        let profile = SkewedT::new(Shape::new(gamma, p, lambda, shift).expect("shapes of this bench are valid"));
        let integral = MaskingIntegral::new(&profile, Rule::TABLE);
        let table = VisibleTable::new(&profile, &integral);
        for degrees in 1..=90 {
            let angle = f64::from(degrees).min(89.9).to_radians();
            let moment = second_moment(&profile, &integral, &table, 1.0 / angle.tan());
            if moment > worst.0 {
                worst = (moment, name, angle.to_degrees());
            }
        }
    }
    println!(
        "E[w^2] of visible sampling, worst of 9 rows x 90 views: {:.5} ({} at {:.1} degrees)   target <= 1.002",
        worst.0, worst.1, worst.2
    );
}

/// Times what a material costs to build, and prints its bytes.
fn print_construction() {
    let shape = |gamma, p, lambda, shift| Shape::new(gamma, p, lambda, shift).expect("valid");
    for (name, shape, target) in [
        ("a full SGTD", shape(2.7, 1.3, 0.3, 0.4), "<= 2 ms, <= 16384 bytes"),
        ("Student's, closed masking", shape(1.6, 1.0, 0.0, 0.0), "-"),
        ("the same by quadrature", shape(1.6, 1.0, 0.0, 1e-9), "-"),
    ] {
        let times = [false, true].map(|draws| {
            let mut seconds: Vec<f64> = (0..REPETITIONS)
                .map(|_| {
                    let start = Instant::now();
                    let ndf = Ndf::new(Box::new(SkewedT::new(shape)), 1e-5).expect("valid");
                    if draws {
                        black_box(ndf.visible_table());
                    }
                    black_box(ndf);
                    start.elapsed().as_secs_f64() * 1e3
                })
                .collect();
            quantiles(&mut seconds)
        });
        let ((_, light, _), (low, middle, high)) = (times[0], times[1]);
        let ndf = Ndf::new(Box::new(SkewedT::new(shape)), 1e-5).expect("valid");
        let bytes = 4 * (ndf.lambda_table().flat().len() + ndf.visible_table().flat().len());
        println!(
            "{name:<26} at accuracy 1e-5: {middle:.2} ms [{low:.2}, {high:.2}], {bytes} bytes of tables   target {target}\n\
             {name:<26} without normals to draw (D and G1): {light:.2} ms   target <= 0.3 ms"
        );
    }
}

fn main() {
    print_second_moments();
    print_construction();
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
        (&radii, &mut |q| smooth_integral.by_quadrature(&smooth, q).h),
    );
    let student = SkewedT::new(Shape::new(1.6, 1.0, 0.0, 0.0).expect("valid"));
    let student_integral = MaskingIntegral::new(&student, Rule::REFERENCE);
    let student_table = ndf(1.6, 1.0, 0.0, 0.0, 1e-5);
    compare(
        "Lambda of Student's: closed form against quadrature",
        "<= 1",
        (&radii, &mut |q| student_integral.at(&student, q).h),
        (&radii, &mut |q| student_integral.by_quadrature(&student, q).h),
    );
    compare(
        "Lambda of Student's: closed form against its table",
        "-",
        (&radii, &mut |q| student_integral.at(&student, q).h),
        (&radii, &mut |q| student_table.lambda_table().h(q)),
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

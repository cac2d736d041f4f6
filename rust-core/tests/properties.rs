//! What holds for every shape, roughness and direction, however close to the edge of the domain?
//!
//! Generators prefer edges: parameters at the ends of their ranges or a rounding away, directions at the pole and the
//! horizon, random numbers 0 and just below 1.

mod cases;

use cases::{Random, direction};
use glam::DVec3;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use sgtd_core::family::shape::Shape;
use sgtd_core::family::skewed_t::SkewedT;
use sgtd_core::masking::{MaskingIntegral, Rule};
use sgtd_core::ndf::{Ndf, Roughness, Shadowing};
use sgtd_core::profile::Profile;
use std::f64::consts::{FRAC_PI_2, PI};

/// Evenly in the logarithm.
fn log_range(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low.ln()..=high.ln()).prop_map(move |x| x.exp().clamp(low, high))
}

fn edges(values: &'static [f64]) -> impl Strategy<Value = f64> {
    prop::sample::select(values)
}

fn gamma() -> impl Strategy<Value = f64> {
    prop_oneof![
        3 => edges(&[1.05, 1.5, 2.0, 2.5, 15.999999999999998, 16.0, 1e12, 1e15, 1e25, f64::MAX, f64::INFINITY]),
        3 => log_range(1e-3, 1e2).prop_map(|x| 1.0 + x),
        1 => log_range(2.0, 1e13),
        2 => Just(f64::INFINITY),
    ]
}

fn p() -> impl Strategy<Value = f64> {
    prop_oneof![2 => edges(&[0.1, 0.25, 0.5, 1.0, 1.0000000000000002, 2.0, 50.0, 100.0]), 3 => log_range(0.1, 100.0)]
}

fn lambda() -> impl Strategy<Value = f64> {
    prop_oneof![
        2 => edges(&[0.0, -0.0, 5e-324, 1e-16, -0.999, 0.999, 0.9999, -0.9999]),
        1 => (any::<bool>(), log_range(1e-4, 1.0)).prop_map(|(minus, x)| if minus { x - 1.0 } else { 1.0 - x }),
        2 => -0.9..0.9f64,
    ]
}

fn shift() -> impl Strategy<Value = f64> {
    prop_oneof![2 => edges(&[0.0, 0.0, 5e-324, 1e-300, 1.0, 1e3, 1e4]), 3 => log_range(1e-8, 1e4)]
}

/// Accepted shapes: γ is raised to where masking is finite, now and then to the very limit.
fn shapes() -> impl Strategy<Value = Shape> {
    (gamma(), p(), lambda(), shift(), log_range(1e-13, 1.0)).prop_map(|(gamma, p, lambda, shift, excess)| {
        let least = (1.5 / p * (1.0 + excess)).max(1.0 + 1e-9);
        Shape::new(gamma.max(least), p, lambda, shift).unwrap_or_else(|error| panic!("{error}"))
    })
}

fn roughness() -> impl Strategy<Value = Roughness> {
    let one = || prop_oneof![1 => edges(&[1e-4, 0.1, 1.0, 10.0]), 2 => log_range(1e-4, 10.0)];
    (one(), one()).prop_map(|(u, v)| Roughness { u, v })
}

fn directions() -> impl Strategy<Value = DVec3> {
    let theta = prop_oneof![
        1 => edges(&[0.0, 1e-12, 1e-8, FRAC_PI_2 - 1e-12, FRAC_PI_2 - 1e-6, FRAC_PI_2, 0.5, 1.5]),
        1 => log_range(1e-9, 1.0),
        1 => log_range(1e-12, 1.0).prop_map(|x| FRAC_PI_2 - x),
        2 => 0.0..FRAC_PI_2,
    ];
    (theta, -PI..PI).prop_map(|(theta, phi)| direction(theta, phi))
}

fn units() -> impl Strategy<Value = f64> {
    prop_oneof![1 => edges(&[0.0, 5e-324, 0.5, 0.9999999403953552, 0.9999999999999999]), 3 => 0.0..1.0f64]
}

fn ndf(shape: Shape, accuracy: f64) -> Ndf {
    Ndf::new(Box::new(SkewedT::new(shape)), accuracy).unwrap_or_else(|error| panic!("{error}"))
}

fn configuration(cases: u32) -> ProptestConfig {
    // the same seed as the other tests, from the environment or fixed: a failure can be repeated
    let seed = Random::seeded("properties").bits();
    let rng_seed = RngSeed::Fixed(u64::from(seed));
    ProptestConfig { cases, failure_persistence: None, rng_seed, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(configuration(3000))]

    /// f peaks with 1 at m and falls to both sides.
    #[test]
    fn profiles_fall_away_from_the_shift(shape in shapes(), x in log_range(1e-9, 1e6), factor in log_range(1.0, 10.0)) {
        let profile = SkewedT::new(shape);
        let m = shape.shift();
        prop_assert_eq!(profile.f(m), 1.0);
        let (near, far) = (profile.f(m + x), profile.f(m + x * factor));
        prop_assert!((0.0..=1.0).contains(&near) && far <= near * (1.0 + 1e-13), "outside: {} then {}", near, far);
        let (near, far) = (m - m / (1.0 + x), m - m / (1.0 + x * factor));
        let (near, far) = (profile.f(m - near.min(m)), profile.f(m - far.min(m)));
        prop_assert!((0.0..=1.0).contains(&near) && far <= near * (1.0 + 1e-9), "inside: {} then {}", near, far);
    }

    /// cdf rises, sf falls, and together they are 1.
    #[test]
    fn distribution_functions_are_monotone(
        shape in shapes(), x in log_range(1e-9, 1e9), factor in log_range(1.0, 10.0),
    ) {
        let profile = SkewedT::new(shape);
        let (cdf, sf) = (profile.cdf(x), profile.sf(x));
        let (later_cdf, later_sf) = (profile.cdf(x * factor), profile.sf(x * factor));
        prop_assert!((cdf + sf - 1.0).abs() < 1e-12, "cdf + sf = {}", cdf + sf);
        let rises = |low: f64, high: f64| 0.0 <= low && low <= high * (1.0 + 1e-12) && high <= 1.0;
        prop_assert!(rises(cdf, later_cdf), "cdf {} then {}", cdf, later_cdf);
        prop_assert!(rises(later_sf, sf), "sf {} then {}", sf, later_sf);
    }

    /// Inverses rise and come back, up to what one rounding of x changes.
    #[test]
    fn inverses_come_back(shape in shapes(), u in prop_oneof![log_range(1e-300, 0.999999), 1e-9..0.999999999f64]) {
        let profile = SkewedT::new(shape);
        let (low, high) = (profile.quantile(u), profile.isf(u));
        prop_assert!(low > 0.0 && low < f64::INFINITY && high > 0.0 && high < f64::INFINITY, "{} {}", low, high);
        let slack = 1.0 + 1e-11;
        // a tail like 1/x reaches 1e-300 where doubles end
        prop_assume!(high < 1e304);
        let between = |below: f64, above: f64| below <= u * slack && u <= above * slack;
        let (below, above) = (profile.cdf(low.next_down()), profile.cdf(low.next_up()));
        prop_assert!(between(below, above), "u is outside {} .. {} at x = {}", below, above, low);
        let (below, above) = (profile.sf(high.next_up()), profile.sf(high.next_down()));
        prop_assert!(between(below, above), "u is outside {} .. {} at x = {}", below, above, high);
    }
}

proptest! {
    #![proptest_config(configuration(400))]

    /// H falls, is convex, and lies between its tangent at 0 and its value there.
    #[test]
    fn masking_is_convex(shape in shapes(), a in log_range(1e-9, 1e6), factor in log_range(1.01, 10.0)) {
        let profile = SkewedT::new(shape);
        let masking = MaskingIntegral::new(&profile, Rule::REFERENCE);
        let (zero, near, far) = (masking.at(&profile, 0.0), masking.at(&profile, a), masking.at(&profile, a * factor));
        // next to 2pγ = 3 half of the mean lies in the last of the tail; the promise ends at an excess of 1e-3
        let excess = (2.0 * shape.p()).mul_add(shape.gamma(), -3.0);
        let slack = (1e-12 + 1e-15 / excess) * zero.h;
        let above_tangent = near.h >= (zero.h - 0.5 * a - slack).max(0.0);
        prop_assert!(above_tangent && near.h <= zero.h + slack, "H = {} of {}", near.h, zero.h);
        let falls = far.s <= near.s * (1.0 + 1e-9);
        prop_assert!((0.0..=0.5 + 1e-12).contains(&near.s) && falls, "S {} then {}", near.s, far.s);
        let chord = (near.h - far.h) / (a * factor - a);
        let rounding = (1e-11 * near.h + slack) / (a * factor - a) + 1e-9 * near.s;
        let between = (far.s - rounding..=near.s + rounding).contains(&chord);
        prop_assert!(between, "chord {} outside {} .. {}", chord, far.s, near.s);
    }

    /// No value of a direction is negative, infinite or not a number, and shadowing is reciprocal and bounded.
    #[test]
    fn directions_give_good_values(
        shape in shapes(), alpha in roughness(), wi in directions(), wo in directions(), m in directions(),
        accuracy in prop_oneof![3 => log_range(1e-5, 0.1), 1 => Just(0.0)],
    ) {
        let ndf = ndf(shape, accuracy);
        let good = |x: f64| (0.0..=f64::MAX).contains(&x);
        for m in [m, (wi + wo).normalize_or(DVec3::Z), DVec3::Z, DVec3::X] {
            prop_assert!(good(ndf.d(alpha, m)), "D = {}", ndf.d(alpha, m));
            prop_assert!(good(ndf.pdf_projected(alpha, m)), "pdf = {}", ndf.pdf_projected(alpha, m));
            prop_assert!(good(ndf.pdf_visible(alpha, wi, m)), "pdf = {}", ndf.pdf_visible(alpha, wi, m));
            prop_assert_eq!(ndf.d(alpha, -m), 0.0);
        }
        let (i, o) = (ndf.g1(alpha, wi), ndf.g1(alpha, wo));
        let lambda = ndf.lambda(alpha, wi);
        prop_assert!(good(lambda) && (0.0..=1.0).contains(&i), "Λ = {}, G1 = {}", lambda, i);
        for shadowing in [Shadowing::Separable, Shadowing::HeightCorrelated] {
            let g2 = ndf.g2(alpha, wi, wo, shadowing);
            prop_assert_eq!(g2, ndf.g2(alpha, wo, wi, shadowing));
            prop_assert!((0.0..=i.min(o)).contains(&g2), "G2 = {} of {} and {}", g2, i, o);
        }
    }

    /// A sample is a normal of unit length that faces the viewer, with the density that is reported for it.
    #[test]
    fn samples_are_what_they_report(
        shape in shapes(), alpha in roughness(), wi in directions(), u in (units(), units()),
    ) {
        let ndf = ndf(shape, 1e-3);
        for (sample, visible) in [(ndf.sample_visible(alpha, wi, u), true), (ndf.sample_projected(alpha, u), false)] {
            if sample.pdf == 0.0 {
                continue;
            }
            prop_assert!(sample.pdf > 0.0 && sample.pdf < f64::INFINITY, "{:?}", sample);
            prop_assert!((0.0..f64::INFINITY).contains(&sample.d_over_pdf), "{:?}", sample);
            prop_assert!((sample.m.length() - 1.0).abs() < 1e-12 && sample.m.z > 0.0, "{:?}", sample);
            prop_assert!(!visible || sample.m.dot(wi) > -1e-12, "{:?} faces away", sample);
            // the rounding of m: between the densities a hundred roundings of the slope to either side, up to what the
            // cosine loses where the density vanishes at the rim of what is visible
            let pdf = |step: f64| {
                let m = DVec3::new(sample.m.x * (1.0 + step), sample.m.y * (1.0 + step), sample.m.z);
                if visible { ndf.pdf_visible(alpha, wi, m) } else { ndf.pdf_projected(alpha, m) }
            };
            let [here, below, above] = [0.0, -1e-14, 1e-14].map(pdf);
            let nearest = sample.pdf.clamp(here.min(below).min(above), here.max(below).max(above));
            let facing = if visible { sample.m.dot(wi).abs() } else { 1.0 };
            let slack = 1e-9 + 4e-15 / facing;
            let slope = (sample.m.x / alpha.u).hypot(sample.m.y / alpha.v) / sample.m.z;
            let at_knot = ndf.visible_table().slopes().iter().any(|knot| (slope - knot).abs() <= 1e-9 * knot);
            prop_assert!((nearest / sample.pdf - 1.0).abs() < slack || at_knot, "{} is reported as {:?}", here, sample);
        }
    }

    /// Turning everything by the same angle changes nothing where both roughnesses are equal.
    #[test]
    fn isotropic_values_do_not_turn(
        shape in shapes(), alpha in log_range(1e-3, 5.0), theta in 0.0..1.57f64, angle in -PI..PI,
    ) {
        let (ndf, alpha) = (ndf(shape, 1e-3), Roughness { u: alpha, v: alpha });
        let (there, here) = (direction(theta, angle), direction(theta, 0.0));
        let (turned, still) = (ndf.d(alpha, there), ndf.d(alpha, here));
        // the rounding of the turned direction, as much as the profile is steep
        let permitted = (1e-12 + 5e-13 * ndf.steepness()) * still.max(1e-30);
        let far_out = still < 1e-7 * ndf.d(alpha, DVec3::Z);
        prop_assert!((turned - still).abs() <= permitted || far_out, "{} {}", turned, still);
        prop_assert!((ndf.g1(alpha, there) / ndf.g1(alpha, here) - 1.0).abs() < 1e-12);
    }
}

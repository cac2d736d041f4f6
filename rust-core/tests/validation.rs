//! Do constructors refuse what is out of range, and say which parameter, which value and which range?

mod cases;

use sgtd_core::error::ParameterError;
use sgtd_core::family::shape::{ROWS, Row, Shape};
use sgtd_core::family::skewed_t::SkewedT;
use sgtd_core::ndf::{Ndf, Roughness};
use sgtd_core::profile::Profile;

const INF: f64 = f64::INFINITY;
const NAN: f64 = f64::NAN;

/// The message names the parameter and the value, and gives both ends of the range.
fn assert_names(result: Result<impl std::fmt::Debug, ParameterError>, parameter: &str, value: f64) {
    let Err(error) = result else { panic!("{parameter} = {value} was accepted: {result:?}") };
    let message = error.to_string();
    for part in [format!("\"{parameter}\""), format!("{value}"), "must be".to_owned()] {
        assert!(message.contains(&part), "{parameter} = {value}: no {part} in {message:?}");
    }
}

#[test]
fn shapes_out_of_range_are_named() {
    for gamma in [1.0, 0.999, 0.0, -2.0, -INF, NAN] {
        assert_names(Shape::new(gamma, 1.0, 0.0, 0.0), "gamma", gamma);
    }
    for p in [0.0999, 0.0, -1.0, 100.001, INF, NAN] {
        assert_names(Shape::new(2.0, p, 0.0, 0.0), "p", p);
    }
    for lambda in [1.0, -1.0, 0.99991, INF, NAN] {
        assert_names(Shape::new(2.0, 1.0, lambda, 0.0), "lambda", lambda);
    }
    for shift in [-1e-9, -5e-324, 10000.1, INF, NAN] {
        assert_names(Shape::new(2.0, 1.0, 0.0, shift), "shift", shift);
    }
}

/// γ and p are each in range, their product is not: the message must give both and the way out.
#[test]
fn tails_too_heavy_for_masking_are_named() {
    for (gamma, p) in [(1.5, 1.0), (1.4, 1.0), (3.0, 0.5), (1.2, 1.25), (14.9, 0.1)] {
        let Err(error) = Shape::new(gamma, p, 0.0, 0.0) else { panic!("γ = {gamma}, p = {p} was accepted") };
        let message = error.to_string();
        for part in ["\"gamma\"", "\"p\"", &format!("{gamma}"), &format!("{p}"), "greater than 3"] {
            assert!(message.contains(part), "no {part} in {message:?}");
        }
        let ParameterError::TailTooHeavy { least_gamma, least_p, .. } = error else { panic!("{error:?}") };
        assert!(Shape::new(least_gamma * (1.0 + 1e-12), p, 0.0, 0.0).is_ok(), "the mend of γ = {gamma} does not help");
        assert!(Shape::new(gamma, least_p * (1.0 + 1e-12), 0.0, 0.0).is_ok(), "the mend of p = {p} does not help");
    }
    assert!(Shape::new(1.5f64.next_up(), 1.0, 0.0, 0.0).is_ok());
}

#[test]
fn ends_of_the_ranges_are_accepted() {
    for (gamma, p, lambda, shift) in [
        (1.0f64.next_up(), 100.0, 0.0, 0.0),
        (f64::MAX, 0.1, 0.9999, 1e4),
        (INF, 0.1, -0.9999, 1e4),
        (INF, 100.0, -0.0, -0.0),
        (15.0f64.next_up(), 0.1, 0.0, 5e-324),
    ] {
        let profile = Shape::new(gamma, p, lambda, shift).map(SkewedT::new);
        let a = profile.unwrap_or_else(|error| panic!("{error}")).normalization();
        assert!(a.is_finite() && a > 0.0, "A = {a} at {gamma} {p} {lambda} {shift}");
    }
}

#[test]
fn shapes_keep_their_parameters() {
    for case in cases::LIST.into_iter().chain(cases::edge_shapes()) {
        let shape = case.shape();
        assert_eq!(
            [shape.gamma(), shape.p(), shape.lambda(), shape.shift()],
            [case.gamma, case.p, case.lambda, case.shift]
        );
        assert_eq!(SkewedT::new(shape).shape(), &shape);
    }
}

#[test]
fn roughness_out_of_range_is_named() {
    for value in [0.0, -0.0, -0.1, 9.9e-7, 5e-324, 1.1e6, INF, NAN] {
        assert_names(Roughness::new(value, 0.5), "alpha_u", value);
        assert_names(Roughness::new(0.5, value), "alpha_v", value);
    }
    for value in [1e-6, 1e-4, 1.0, 1e6] {
        assert_eq!(Roughness::new(value, 0.5), Ok(Roughness { u: value, v: 0.5 }));
    }
}

#[test]
fn accuracy_out_of_range_is_named() {
    let ndf = |accuracy| Ndf::new(Box::new(cases::LIST[0].profile()), accuracy).map(|ndf| ndf.accuracy_reached());
    for value in [-1e-3, -5e-324, 0.1f64.next_up(), 1.0, INF, NAN] {
        assert_names(ndf(value), "accuracy", value);
    }
    for value in [0.0, 5e-324, 1e-7, 1e-3, 0.1] {
        assert!(ndf(value).is_ok(), "{value} was refused");
    }
}

#[test]
fn rows_are_found_by_name() {
    for row in ROWS {
        assert_eq!(Row::named(row.name), Ok(ROWS.iter().find(|other| other.name == row.name).unwrap_or(&ROWS[0])));
    }
    for unknown in ["", "GGX", "ggx ", "phong"] {
        let Err(error) = Row::named(unknown) else { panic!("{unknown:?} was found") };
        let message = error.to_string();
        for name in ROWS.map(|row| row.name) {
            assert!(message.contains(name), "{name} is not among the names in {message:?}");
        }
    }
}

/// Source: Table 1 of Ribardière et al. 2019, with p = 1 for the skewed t.
#[test]
fn rows_fix_their_parameters() {
    let table: [(&str, Option<f64>, Option<f64>, Option<f64>); 10] = [
        ("sgtd", None, None, None),
        ("gtd", None, None, Some(0.0)),
        ("sgnd", Some(INF), None, None),
        ("std", None, Some(1.0), None),
        ("gnd", Some(INF), None, Some(0.0)),
        ("snd", Some(INF), Some(1.0), None),
        ("student", None, Some(1.0), Some(0.0)),
        ("hyper_cauchy", None, Some(1.0), Some(0.0)),
        ("beckmann", Some(INF), Some(1.0), Some(0.0)),
        ("ggx", Some(2.0), Some(1.0), Some(0.0)),
    ];
    assert_eq!(table.len(), ROWS.len());
    for (name, gamma, p, lambda) in table {
        let row = Row::named(name).unwrap_or_else(|error| panic!("{error}"));
        let free = |fixed: Option<f64>, value: f64| if fixed.is_some() { None } else { Some(value) };
        let shape = row.shape(free(gamma, 3.0), free(p, 1.7), free(lambda, 0.2), Some(0.6));
        let shape = shape.unwrap_or_else(|error| panic!("{name}: {error}"));
        let wanted = [gamma.unwrap_or(3.0), p.unwrap_or(1.7), lambda.unwrap_or(0.2), 0.6];
        assert_eq!([shape.gamma(), shape.p(), shape.lambda(), shape.shift()], wanted, "{name}");
        for (parameter, fixed, given) in [
            ("gamma", gamma, row.shape(Some(3.0), None, None, None)),
            ("p", p, row.shape(None, Some(1.7), None, None)),
            ("lambda", lambda, row.shape(None, None, Some(0.2), None)),
        ] {
            if fixed.is_some() {
                let Err(error) = given else { panic!("{name} accepted {parameter}") };
                let message = error.to_string();
                assert!(message.contains(name) && message.contains(parameter), "{message}");
            }
        }
    }
}

/// D(θ) = (q−1)(2σ²)^(q−1) / (π cos⁴θ (2σ² + tan²θ)^q) is Student's D with γ = q at roughness σ·alpha_scale.
#[test]
fn hyper_cauchy_is_student_at_another_scale() {
    for q in [1.6, 2.0, 2.3, 5.0, 40.0] {
        let row = Row::named("hyper_cauchy").unwrap_or_else(|error| panic!("{error}"));
        let shape = row.shape(Some(q), None, None, None).unwrap_or_else(|error| panic!("{error}"));
        let ndf = Ndf::new(Box::new(SkewedT::new(shape)), 1e-3).unwrap_or_else(|error| panic!("{error}"));
        for sigma in [0.05, 0.4, 1.0] {
            let alpha = sigma * row.alpha_scale(&shape);
            for theta in [0.0, 0.1, 0.7, 1.3, 1.5] {
                let (tan, cos) = (f64::tan(theta), f64::cos(theta));
                let width = 2.0 * sigma * sigma;
                let want = (q - 1.0) * width.powf(q - 1.0)
                    / (std::f64::consts::PI * cos.powi(4) * (width + tan * tan).powf(q));
                let got = ndf.d(Roughness { u: alpha, v: alpha }, cases::direction(theta, 0.3));
                assert!((got / want - 1.0).abs() < 1e-12, "q = {q}, σ = {sigma}, θ = {theta}: {got:e}, not {want:e}");
            }
        }
    }
    for row in ROWS.iter().filter(|row| row.name != "hyper_cauchy") {
        let shape = row.shape(None, None, None, None).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(row.alpha_scale(&shape), 1.0, "{}", row.name);
    }
}

//! Do the derivatives by the shape agree with differences of direct integrals?

mod cases;

use cases::Case;
use sgtd_core::masking::table::FINEST_SINGLE;
use sgtd_core::masking::{MaskingGradient, Rule};
use sgtd_core::ndf::{Ndf, Roughness};
use std::time::Instant;

/// Reference values; `tests/reference/generate_gradient.py` makes them.
const REFERENCE: &str = include_str!("../../tests/reference/gradient.csv");

struct Row {
    case: Case,
    /// of 1/γ, p, λ and m
    parameter: usize,
    /// `None` for ln A
    argument: Option<f64>,
    value: f64,
}

fn rows() -> Vec<Row> {
    let number = |text: &str| text.parse::<f64>().unwrap_or_else(|_| panic!("{text:?} is not a number"));
    REFERENCE
        .lines()
        .skip(1)
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            let [gamma, p, lambda, shift] = [0, 1, 2, 3].map(|k| number(cells[k]));
            let parameter = ["inverse_gamma", "p", "lambda", "shift"].iter().position(|&name| name == cells[4]);
            Row {
                case: Case { gamma, p, lambda, shift },
                parameter: parameter.expect("a parameter of the family"),
                argument: (cells[5] == "H").then(|| number(cells[6])),
                value: number(cells[7]),
            }
        })
        .collect()
}

/// The reference rule keeps 2e-9 of the greater of the derivative and the function itself.
#[test]
fn masking_and_normalization_follow_the_shape() {
    let rows = rows();
    assert!(rows.len() >= 200, "only {} rows", rows.len());
    let mut worst = [0.0_f64; 4];
    for row in &rows {
        let profile = row.case.profile();
        let gradient = MaskingGradient::new(&profile, Rule::REFERENCE).expect("a member of the family");
        let (got, scale) = match row.argument {
            None => (gradient.log_normalization()[row.parameter], 1.0),
            Some(a) => {
                let (value, by) = gradient.at(&profile, a);
                (by[row.parameter].h, value.h)
            }
        };
        let error = (got - row.value).abs() / row.value.abs().max(scale);
        assert!(
            error < 1e-9,
            "{:?} by parameter {} at {:?}: {got}, not {}",
            row.case,
            row.parameter,
            row.argument,
            row.value
        );
        worst[row.parameter] = worst[row.parameter].max(error);
    }
    println!("worst, by 1/gamma, p, lambda and shift: {worst:?}");
}

/// The slope with which a table is interpolated, and how long a table takes.
#[test]
fn masking_of_the_gradient_has_its_slope() {
    for row in rows().iter().filter(|row| row.argument.is_none() && row.parameter == 0) {
        let profile = row.case.profile();
        let gradient = MaskingGradient::new(&profile, Rule::REFERENCE).expect("a member of the family");
        for a in [0.1, 0.7, 1.9, 11.0, 1e5] {
            let h = 1e-4 * a;
            let at = |q: f64| gradient.at(&profile, q);
            let (value, by) = at(a);
            for (k, here) in by.iter().enumerate() {
                let [far_left, left, right, far_right] = [-2.0, -1.0, 1.0, 2.0].map(|x| at(a + x * h).1[k].h);
                let slope = (8.0 * (right - left) - (far_right - far_left)) / (12.0 * h);
                let scale = here.s.abs().max(value.s) + value.h / a;
                assert!(
                    (slope + here.s).abs() <= 1e-6 * scale + 1e-300,
                    "{:?} by parameter {k} at {a}: {slope}, not {}",
                    row.case,
                    -here.s
                );
            }
        }
    }
}

#[test]
fn gradient_tables_hold_the_gradient() {
    let mut worst = [0.0_f64; 4];
    for row in rows().iter().filter(|row| row.argument.is_none() && row.parameter == 0) {
        let ndf = Ndf::new(Box::new(row.case.profile()), FINEST_SINGLE).expect("a valid accuracy");
        let start = Instant::now();
        let table = ndf.gradient_table().expect("a member of the family");
        let time = start.elapsed();
        let profile = ndf.profile();
        let gradient = MaskingGradient::new(profile, Rule::REFERENCE).expect("a member of the family");
        let cells = ndf.lambda_table().cells();
        assert_eq!(table.flat().len(), 16 * cells.len());
        let (mut own, mut greatest) = ([0.0_f64; 4], [0.0_f64; 4]);
        for (cell, &(left, right)) in cells.iter().enumerate().filter(|(_, ends)| ends.1.is_finite()) {
            for t in [0.2, 0.5, 0.85] {
                let d = t * (right - left);
                let a = left + d;
                let (value, by) = gradient.at(profile, a);
                for k in 0..4 {
                    let c = &table.flat()[16 * cell + 4 * k..][..4];
                    let h = c.iter().rev().fold(0.0, |sum, &c| sum * d + f64::from(c));
                    // as G1 sees it
                    own[k] = own[k].max((h - by[k].h).abs() / (a + value.h));
                    greatest[k] = greatest[k].max(by[k].h.abs() / (a + value.h));
                }
            }
        }
        println!("{:?}: {own:?}, {} cells, {time:?}", row.case, cells.len());
        for k in 0..4 {
            worst[k] = worst[k].max(own[k] / greatest[k]);
        }
    }
    println!("worst error of G1's derivatives, of the greatest value of each: {worst:?}");
    assert!(worst.iter().all(|&error| error < 5e-5));
}

#[test]
fn the_distribution_follows_the_shape() {
    let alpha = Roughness { u: 0.4, v: 0.25 };
    for row in rows().iter().filter(|row| row.argument.is_none() && row.parameter == 0) {
        let Case { gamma, p, lambda, shift } = row.case;
        if gamma.is_infinite() || shift == 0.0 || lambda == 0.0 {
            continue; // one-sided
        }
        let made = |theta: [f64; 4]| {
            let [inverse, p, lambda, shift] = theta;
            Ndf::new(Box::new(Case { gamma: 1.0 / inverse, p, lambda, shift }.profile()), 0.0).expect("valid")
        };
        let theta = [1.0 / gamma, p, lambda, shift];
        let ndf = made(theta);
        for (x, y) in [(0.01, 0.02), (0.1, 0.05), (0.3, -0.2), (2.0, 1.0)] {
            let m = glam::DVec3::new(x, y, 1.0).normalize();
            let by = ndf.d_gradient(alpha, m).expect("a member of the family");
            let lambda_by = ndf.lambda_gradient(alpha, m).expect("a member of the family");
            for k in 0..4 {
                let h = 1e-5 * (2.0 * p * gamma - 3.0).min(theta[k].abs()).min(0.1);
                let moved = |x: f64| {
                    let mut theta = theta;
                    theta[k] += x * h;
                    let ndf = made(theta);
                    (ndf.d(alpha, m), ndf.lambda(alpha, m))
                };
                let (left, right) = (moved(-1.0), moved(1.0));
                let (d, lambda) = ((right.0 - left.0) / (2.0 * h), (right.1 - left.1) / (2.0 * h));
                let scale = ndf.d(alpha, m) / theta[k].abs().max(1e-3) + 1e-100;
                assert!((d - by[k]).abs() < 1e-5 * scale.max(by[k].abs()), "{:?} D by {k}: {d}, {}", row.case, by[k]);
                let scale = ndf.lambda(alpha, m) / theta[k].abs().max(1e-3) + 1e-100;
                assert!(
                    (lambda - lambda_by[k]).abs() < 1e-5 * scale.max(lambda_by[k].abs()),
                    "{:?} Lambda by {k}: {lambda}, {}",
                    row.case,
                    lambda_by[k]
                );
            }
        }
    }
}

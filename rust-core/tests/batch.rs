//! Functions over arrays: are they those of one direction at a time, on one thread and on many, and are arrays that do not fit refused?

mod cases;

use cases::{Case, Random};
use glam::DVec3;
use sgtd_core::batch::{QUERIES, Query, first_of_wrong_length, first_outside, is_parallel};
use sgtd_core::ndf::{Ndf, Normals, Roughness};

const COUNT: usize = 3000;

fn query(name: &str) -> &'static Query {
    Query::named(name).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn arrays_are_evaluated_row_by_row() {
    let case = Case { gamma: 2.3, p: 1.4, lambda: 0.3, shift: 0.5 };
    let ndf = Ndf::new(Box::new(case.profile()), 1e-5).unwrap_or_else(|error| panic!("{error}"));
    let alpha = Roughness { u: 0.4, v: 0.4 };
    let mut random = Random::seeded("batch");
    let directions =
        |random: &mut Random| -> Vec<f64> { (0..COUNT).flat_map(|_| random.direction().to_array()).collect() };
    let (first, second) = (directions(&mut random), directions(&mut random));
    let at = |w: &[f64], k: usize| DVec3::from_slice(&w[3 * k..3 * k + 3]);
    assert!(is_parallel(COUNT) && !is_parallel(10));
    for rows in [10, COUNT] {
        for (name, one) in [
            ("pdf_reflecting", &(|a, b| ndf.pdf(alpha, a, b, Normals::Reflecting)) as &dyn Fn(DVec3, DVec3) -> f64),
            ("pdf_visible", &|a, b| ndf.pdf_visible(alpha, a, b)),
        ] {
            let query = query(name);
            assert_eq!((query.width(), query.results()), (3, 1));
            let mut out = vec![0.0; rows];
            let done = query.eval(&ndf, alpha, &first[..3 * rows], &second[..3 * rows], &mut out);
            assert_eq!(done, Ok(()));
            for (k, &value) in out.iter().enumerate() {
                assert_eq!(value, one(at(&first, k), at(&second, k)), "{name}, row {k} of {rows}");
            }
        }
    }
    let numbers: Vec<f64> = (0..2 * COUNT).map(|_| random.unit()).collect();
    let sampler = query("sample_reflecting");
    let mut out = vec![0.0; sampler.results() * COUNT];
    assert_eq!(sampler.eval(&ndf, alpha, &first, &numbers, &mut out), Ok(()));
    for k in 0..COUNT {
        let sample = ndf.sample(alpha, at(&first, k), (numbers[2 * k], numbers[2 * k + 1]), Normals::Reflecting);
        assert_eq!((at(&out, k), out[3 * COUNT + k]), (sample.m, sample.pdf), "row {k}");
    }
}

#[test]
fn arrays_that_do_not_fit_are_refused() {
    let case = Case { gamma: 2.0, p: 1.0, lambda: 0.0, shift: 0.0 };
    let ndf = Ndf::new(Box::new(case.profile()), 1e-3).unwrap_or_else(|error| panic!("{error}"));
    let alpha = Roughness { u: 0.4, v: 0.4 };
    for query in QUERIES {
        let wrong = query.eval(&ndf, alpha, &[0.5; 6], &[0.5; 7], &mut [0.0; 11]);
        assert!(wrong.is_err());
    }
    let unknown = Query::named("speed").err().map(|error| error.to_string()).unwrap_or_default();
    assert!(unknown.contains("speed") && unknown.contains("pdf_reflecting"), "{unknown}");
}

#[test]
fn the_first_wrong_row_is_found() {
    for rows in [5, COUNT] {
        let mut w = [0.0, 0.6, 0.8].repeat(rows);
        assert_eq!(first_of_wrong_length(&w, 1e-6), rows);
        (w[3 * (rows - 1)], w[6]) = (0.1, f64::NAN);
        assert_eq!(first_of_wrong_length(&w, 1e-6), 2);
        let mut x = vec![0.5; rows];
        assert_eq!(first_outside(&x, 0.0, 1.0), rows);
        x[rows - 1] = 1.5;
        assert_eq!(first_outside(&x, 0.0, 1.0), rows - 1);
    }
}

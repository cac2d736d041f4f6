//! Functions over arrays: a table of what can be asked of a distribution, and the loop that runs any of it on all threads.
//!
//! A new function for arrays is one line in [`QUERIES`]. Everything above (the bridge, the Python module) asks by name.

use crate::error::ParameterError;
use crate::ndf::{Ndf, Normals, Roughness, Shadowing};
use crate::profile::Profile;
use crate::profile::derivatives::PARAMETERS;
use glam::DVec3;
use rayon::prelude::*;

/// Some rows: the distribution, its roughness, two arrays of arguments, two of results.
type Rows = fn(&Ndf, Roughness, &[f64], &[f64], &mut [f64], &mut [f64]);

/// One function, by what a row of its arguments and results is. The loop over rows is compiled with the function inside: an indirect
/// call for each row takes longer than G1 itself.
pub struct Query {
    name: &'static str,
    /// numbers per row in the two arrays of arguments
    arguments: (usize, usize),
    /// numbers per row in the two arrays of results
    results: (usize, usize),
    rows: Rows,
}

/// A function of a number, a stretched radial slope or a probability: `|profile, x|`.
macro_rules! number {
    ($name:literal, $call:expr) => {
        Query {
            name: $name,
            arguments: (1, 0),
            results: (1, 0),
            rows: |ndf, _, x, _, out, _| {
                for (out, &x) in out.iter_mut().zip(x) {
                    *out = $call(ndf.profile(), x);
                }
            },
        }
    };
}

/// A function of a direction: `|ndf, alpha, w|`.
macro_rules! direction {
    ($name:literal, $call:expr) => {
        Query {
            name: $name,
            arguments: (3, 0),
            results: (1, 0),
            rows: |ndf, alpha, w, _, out, _| {
                for (out, w) in out.iter_mut().zip(w.chunks_exact(3)) {
                    *out = $call(ndf, alpha, DVec3::from_slice(w));
                }
            },
        }
    };
}

/// Derivatives of a function of a direction by 1/γ, p, λ and m; NaN for a profile that has none: `|ndf, alpha, w|`.
macro_rules! gradient {
    ($name:literal, $call:expr) => {
        Query {
            name: $name,
            arguments: (3, 0),
            results: (PARAMETERS, 0),
            rows: |ndf, alpha, w, _, out, _| {
                for (out, w) in out.chunks_exact_mut(PARAMETERS).zip(w.chunks_exact(3)) {
                    let by: Option<[f64; PARAMETERS]> = $call(ndf, alpha, DVec3::from_slice(w));
                    out.copy_from_slice(&by.unwrap_or([f64::NAN; PARAMETERS]));
                }
            },
        }
    };
}

/// A function of two directions: `|ndf, alpha, first, second|`.
macro_rules! pair {
    ($name:literal, $call:expr) => {
        Query {
            name: $name,
            arguments: (3, 3),
            results: (1, 0),
            rows: |ndf, alpha, first, second, out, _| {
                for ((out, a), b) in out.iter_mut().zip(first.chunks_exact(3)).zip(second.chunks_exact(3)) {
                    *out = $call(ndf, alpha, DVec3::from_slice(a), DVec3::from_slice(b));
                }
            },
        }
    };
}

/// A sampler, from a direction and two random numbers to a normal and its density: `|ndf, alpha, wi, u|`.
macro_rules! sampler {
    ($name:literal, $call:expr) => {
        Query {
            name: $name,
            arguments: (3, 2),
            results: (3, 1),
            rows: |ndf, alpha, wi, u, normals, densities| {
                let arguments = wi.chunks_exact(3).zip(u.chunks_exact(2));
                for ((m, pdf), (wi, u)) in normals.chunks_exact_mut(3).zip(densities).zip(arguments) {
                    let sample = $call(ndf, alpha, DVec3::from_slice(wi), (u[0], u[1]));
                    m.copy_from_slice(&sample.m.to_array());
                    *pdf = sample.pdf;
                }
            },
        }
    };
}

/// Every function.
pub const QUERIES: &[Query] = &[
    number!("profile", |profile: &dyn Profile, x| profile.f(x)),
    number!("cdf", |profile: &dyn Profile, x| profile.cdf(x)),
    number!("sf", |profile: &dyn Profile, x| profile.sf(x)),
    number!("quantile", |profile: &dyn Profile, u| profile.quantile(u)),
    number!("isf", |profile: &dyn Profile, s| profile.isf(s)),
    direction!("d", Ndf::d),
    direction!("lambda", Ndf::lambda),
    direction!("g1", Ndf::g1),
    pair!("g2_separable", |ndf: &Ndf, alpha, wi, wo| ndf.g2(alpha, wi, wo, Shadowing::Separable)),
    pair!("g2_height_correlated", |ndf: &Ndf, alpha, wi, wo| ndf.g2(alpha, wi, wo, Shadowing::HeightCorrelated)),
    pair!("pdf_visible", Ndf::pdf_visible),
    pair!("pdf_projected", |ndf: &Ndf, alpha, _, m| ndf.pdf_projected(alpha, m)),
    pair!("pdf_reflecting", |ndf: &Ndf, alpha, wi, m| ndf.pdf(alpha, wi, m, Normals::Reflecting)),
    gradient!("normalization_gradient", |ndf: &Ndf, _, _| ndf.log_normalization_gradient()),
    gradient!("d_gradient", Ndf::d_gradient),
    gradient!("lambda_gradient", Ndf::lambda_gradient),
    sampler!("sample_visible", Ndf::sample_visible),
    sampler!("sample_reflecting", |ndf: &Ndf, alpha, wi, u| ndf.sample(alpha, wi, u, Normals::Reflecting)),
    sampler!("sample_projected", |ndf: &Ndf, alpha, _, u| ndf.sample_projected(alpha, u)),
];

/// Rows per task: large enough that the queue costs nothing, small enough to balance two cores.
const CHUNK: usize = 1024;

/// Are there rows for more than one task?
pub fn is_parallel(rows: usize) -> bool {
    rows > CHUNK
}

impl Query {
    /// Finds a function by its name.
    ///
    /// # Errors
    /// Lists the names there are.
    pub fn named(name: &str) -> Result<&'static Query, ParameterError> {
        QUERIES.iter().find(|query| query.name == name).ok_or_else(|| ParameterError::UnknownQuery {
            given: name.to_owned(),
            known: QUERIES.iter().map(|query| query.name).collect::<Vec<_>>().join(", "),
        })
    }

    /// Numbers per row of the first array.
    pub fn width(&self) -> usize {
        self.arguments.0
    }

    /// Numbers per row of the results.
    pub fn results(&self) -> usize {
        self.results.0 + self.results.1
    }

    /// Runs the function over all rows, on the threads of the rayon pool that this is called in. `out` has the first result of all
    /// rows, then the second one.
    ///
    /// # Errors
    /// An array whose length does not fit the first one's.
    pub fn eval(
        &self,
        ndf: &Ndf,
        alpha: Roughness,
        first: &[f64],
        second: &[f64],
        out: &mut [f64],
    ) -> Result<(), ParameterError> {
        let (a, b) = self.arguments;
        let (c, d) = self.results;
        let rows = first.len() / a;
        for (name, found, expected) in [
            ("first", first.len(), a * rows),
            ("second", second.len(), b * rows),
            ("results", out.len(), (c + d) * rows),
        ] {
            if found != expected {
                return Err(ParameterError::Length { name, found, expected });
            }
        }
        let (left, right) = out.split_at_mut(c * rows);
        if !is_parallel(rows) {
            (self.rows)(ndf, alpha, first, second, left, right);
            return Ok(());
        }
        let part = |width: usize, task: usize| CHUNK * width * task..(CHUNK * (task + 1)).min(rows) * width;
        let run = |task: usize, left: &mut [f64], right: &mut [f64]| {
            (self.rows)(ndf, alpha, &first[part(a, task)], &second[part(b, task)], left, right);
        };
        let tasks = left.par_chunks_mut(CHUNK * c).enumerate();
        if d == 0 {
            tasks.for_each(|(task, left)| run(task, left, &mut []));
        } else {
            tasks.zip(right.par_chunks_mut(CHUNK * d)).for_each(|((task, left), right)| run(task, left, right));
        }
        Ok(())
    }
}

/// Derivatives of D (`d`) or Λ (`lambda`) of packed directions by the logarithms of the numbers of a table or a mixture, a row of them for each
/// direction.
///
/// # Errors
/// A member of the family; another quantity; an array of results that does not fit.
pub fn by_numbers(
    ndf: &Ndf,
    quantity: &str,
    alpha: Roughness,
    w: &[f64],
    out: &mut [f64],
) -> Result<(), ParameterError> {
    let of: fn(&Ndf, Roughness, DVec3) -> Option<Vec<f64>> = match quantity {
        "d" => Ndf::d_by_numbers,
        "lambda" => Ndf::lambda_by_numbers,
        _ => {
            return Err(ParameterError::UnknownName {
                name: "quantity",
                given: quantity.to_owned(),
                known: "d, lambda",
            });
        }
    };
    let columns = ndf.numbers_gradient().ok_or(ParameterError::NoNumbers)?.count();
    let expected = w.len() / 3 * columns;
    if out.len() != expected {
        return Err(ParameterError::Length { name: "results", found: out.len(), expected });
    }
    out.par_chunks_mut(columns).zip(w.par_chunks_exact(3)).with_min_len(16).for_each(|(out, w)| {
        out.copy_from_slice(&of(ndf, alpha, DVec3::from_slice(w)).unwrap_or_else(|| vec![0.0; columns]));
    });
    Ok(())
}

fn direction(packed: &[f64], row: usize) -> DVec3 {
    DVec3::from_slice(&packed[3 * row..3 * row + 3])
}

/// Index of the first direction whose length differs from 1 by more than `tolerance` or is not a number; their number if
/// there is none.
pub fn first_of_wrong_length(w: &[f64], tolerance: f64) -> usize {
    first_where(w.len() / 3, |row| !((direction(w, row).length() - 1.0).abs() <= tolerance))
}

/// Index of the first number that is not in [low, high]; their number if there is none.
pub fn first_outside(x: &[f64], low: f64, high: f64) -> usize {
    first_where(x.len(), |row| !(low..=high).contains(&x[row]))
}

fn first_where(rows: usize, wrong: impl Fn(usize) -> bool + Sync + Send) -> usize {
    let found = if is_parallel(rows) {
        (0..rows).into_par_iter().with_min_len(CHUNK).position_first(&wrong)
    } else {
        (0..rows).position(wrong)
    };
    found.unwrap_or(rows)
}

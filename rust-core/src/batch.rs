//! Functions over arrays: a table of what can be asked of a distribution, and the loop that runs any of it on all threads.
//!
//! A new function for arrays is one line in [`QUERIES`]. Everything above (the bridge, the Python module) asks by name.

use crate::error::ParameterError;
use crate::ndf::{Ndf, NormalSample, Roughness, Shadowing};
use crate::profile::Profile;
use glam::DVec3;
use rayon::prelude::*;

/// One function, by what a row of its arguments is.
pub enum Query {
    /// Of a number: a stretched radial slope, or a probability. The roughness does not matter.
    Number(fn(&dyn Profile, f64) -> f64),
    /// Of a direction.
    Direction(fn(&Ndf, Roughness, DVec3) -> f64),
    /// Of two directions.
    Pair(fn(&Ndf, Roughness, DVec3, DVec3) -> f64),
    /// Of a direction and two random numbers; the results are all normals, then all densities.
    Sample(fn(&Ndf, Roughness, DVec3, (f64, f64)) -> NormalSample),
}

use Query::{Direction, Number, Pair, Sample};

/// Every function by its name.
pub const QUERIES: [(&str, Query); 14] = [
    ("profile", Number(|profile, x| profile.f(x))),
    ("cdf", Number(|profile, x| profile.cdf(x))),
    ("sf", Number(|profile, x| profile.sf(x))),
    ("quantile", Number(|profile, u| profile.quantile(u))),
    ("isf", Number(|profile, s| profile.isf(s))),
    ("d", Direction(Ndf::d)),
    ("lambda", Direction(Ndf::lambda)),
    ("g1", Direction(Ndf::g1)),
    ("g2_separable", Pair(|ndf, alpha, wi, wo| ndf.g2(alpha, wi, wo, Shadowing::Separable))),
    ("g2_height_correlated", Pair(|ndf, alpha, wi, wo| ndf.g2(alpha, wi, wo, Shadowing::HeightCorrelated))),
    ("pdf_visible", Pair(Ndf::pdf_visible)),
    ("pdf_projected", Pair(|ndf, alpha, _, m| ndf.pdf_projected(alpha, m))),
    ("sample_visible", Sample(Ndf::sample_visible)),
    ("sample_projected", Sample(|ndf, alpha, _, u| ndf.sample_projected(alpha, u))),
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
        const TABLE: &[(&str, Query)] = &QUERIES;
        TABLE.iter().find(|entry| entry.0 == name).map(|entry| &entry.1).ok_or_else(|| ParameterError::UnknownQuery {
            given: name.to_owned(),
            known: TABLE.iter().map(|entry| entry.0).collect::<Vec<_>>().join(", "),
        })
    }

    /// Numbers per row of the first array.
    pub fn width(&self) -> usize {
        match self {
            Number(_) => 1,
            Direction(_) | Pair(_) | Sample(_) => 3,
        }
    }

    /// Numbers per row of the second array.
    fn width_beside(&self) -> usize {
        match self {
            Number(_) | Direction(_) => 0,
            Pair(_) => 3,
            Sample(_) => 2,
        }
    }

    /// Numbers per row of the results.
    pub fn results(&self) -> usize {
        match self {
            Number(_) | Direction(_) | Pair(_) => 1,
            Sample(_) => 4,
        }
    }

    /// Runs the function over all rows, on the threads of the rayon pool that this is called in.
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
        let rows = first.len() / self.width();
        for (name, found, expected) in [
            ("first", first.len(), self.width() * rows),
            ("second", second.len(), self.width_beside() * rows),
            ("results", out.len(), self.results() * rows),
        ] {
            if found != expected {
                return Err(ParameterError::Length { name, found, expected });
            }
        }
        match self {
            Number(call) => {
                let profile = ndf.profile();
                per_row(out, |row| call(profile, first[row]));
            }
            Direction(call) => per_row(out, |row| call(ndf, alpha, direction(first, row))),
            Pair(call) => per_row(out, |row| call(ndf, alpha, direction(first, row), direction(second, row))),
            Sample(call) => {
                let (normals, densities) = out.split_at_mut(3 * rows);
                per_row_of_two(normals, densities, |row| {
                    let sample = call(ndf, alpha, direction(first, row), (second[2 * row], second[2 * row + 1]));
                    (sample.m, sample.pdf)
                });
            }
        }
        Ok(())
    }
}

fn per_row(out: &mut [f64], call: impl Fn(usize) -> f64 + Sync) {
    let task = |(start, out): (usize, &mut [f64])| {
        for (offset, result) in out.iter_mut().enumerate() {
            *result = call(CHUNK * start + offset);
        }
    };
    if is_parallel(out.len()) { out.par_chunks_mut(CHUNK).enumerate().for_each(task) } else { task((0, out)) }
}

fn per_row_of_two(vectors: &mut [f64], numbers: &mut [f64], call: impl Fn(usize) -> (DVec3, f64) + Sync) {
    let task = |(start, (vectors, numbers)): (usize, (&mut [f64], &mut [f64]))| {
        for (offset, (vector, number)) in vectors.chunks_exact_mut(3).zip(numbers).enumerate() {
            let (result, beside) = call(CHUNK * start + offset);
            vector.copy_from_slice(&result.to_array());
            *number = beside;
        }
    };
    if is_parallel(numbers.len()) {
        vectors.par_chunks_mut(3 * CHUNK).zip(numbers.par_chunks_mut(CHUNK)).enumerate().for_each(task);
    } else {
        task((0, (vectors, numbers)));
    }
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

//! The error that every constructor of this crate returns.
//!
//! ```
//! use sgtd_core::family::shape::Shape;
//!
//! let Err(error) = Shape::new(1.4, 1.0, 0.0, 0.0) else { panic!("2pγ is below 3") };
//! assert!(error.to_string().contains("raise gamma above 1.5"));
//! ```

use thiserror::Error;

/// What is wrong with a parameter, in words for the person who set it.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ParameterError {
    /// A value outside its range.
    #[error("parameter \"{name}\" is {value}, but must be {range}: {mend}")]
    OutOfRange {
        /// The parameter as the user writes it.
        name: &'static str,
        /// The value that was given.
        value: f64,
        /// The allowed range.
        range: &'static str,
        /// What to do about it.
        mend: &'static str,
    },
    /// Tail and kurtosis together leave no finite masking.
    #[error(
        "parameters \"gamma\" = {gamma} and \"p\" = {p} give 2*p*gamma = {product}, but it must be \
         greater than 3: masking is infinite otherwise; raise gamma above {least_gamma} or p above {least_p}"
    )]
    TailTooHeavy {
        /// The tail parameter.
        gamma: f64,
        /// The kurtosis parameter.
        p: f64,
        /// 2pγ.
        product: f64,
        /// The least γ at this p.
        least_gamma: f64,
        /// The least p at this γ.
        least_p: f64,
    },
    /// A parameter that the chosen row of the family fixes.
    #[error(
        "distribution \"{row}\" fixes \"{name}\" to {fixed}, but {value} was given: remove the parameter \
         or choose a distribution in which it is free"
    )]
    Fixed {
        /// The chosen row.
        row: &'static str,
        /// The parameter.
        name: &'static str,
        /// The value the row fixes it to.
        fixed: f64,
        /// The value that was given.
        value: f64,
    },
    /// Derivatives by the shape of something that has none.
    #[error("the distribution is not of the family, so it has no derivatives by gamma, p, lambda and shift")]
    NoGradient,
    /// Derivatives by numbers of what has none.
    #[error("the distribution is of the family, so it has no values or weights that derivatives could be taken by")]
    NoNumbers,
    /// No such row.
    #[error("distribution \"{given}\" is unknown: choose one of {known}")]
    UnknownRow {
        /// What was given.
        given: String,
        /// The names there are, separated by commas.
        known: String,
    },
    /// No such function over arrays.
    #[error("function \"{given}\" is unknown: there are {known}")]
    UnknownQuery {
        /// What was given.
        given: String,
        /// The names there are, separated by commas.
        known: String,
    },
    /// No such name.
    #[error("parameter \"{name}\" is \"{given}\", but must be one of {known}")]
    UnknownName {
        /// The parameter as the user writes it.
        name: &'static str,
        /// What was given.
        given: String,
        /// The names there are, separated by commas.
        known: &'static str,
    },
    /// A number in a table.
    #[error("\"{name}\" in row {row} is {value}, but must {must}: {mend}")]
    Row {
        /// The column.
        name: &'static str,
        /// The row, counted from 1.
        row: usize,
        /// The value that was given.
        value: f64,
        /// What it must be or do.
        must: &'static str,
        /// What to do about it.
        mend: &'static str,
    },
    /// A table as a whole.
    #[error("the table {problem}: {mend}")]
    Table {
        /// What is wrong with it.
        problem: String,
        /// What to do about it.
        mend: &'static str,
    },
    /// What is wrong with a file of a table.
    #[error("{path}: {problem}: {mend}")]
    File {
        /// Its path, as it was given.
        path: String,
        /// What is wrong.
        problem: String,
        /// What to do about it.
        mend: &'static str,
    },
    /// What is wrong with the table in a file.
    #[error("{path}: {source}")]
    InFile {
        /// Its path, as it was given.
        path: String,
        /// What is wrong.
        source: Box<ParameterError>,
    },
    /// Arrays of a batch call that do not fit each other.
    #[error("array \"{name}\" has {found} numbers, but {expected} are needed")]
    Length {
        /// The array.
        name: &'static str,
        /// Its length.
        found: usize,
        /// The length that fits the others.
        expected: usize,
    },
}

/// Checks `value` against a closed or open range, given as a predicate, and names it in the error.
pub(crate) fn require(
    ok: bool,
    name: &'static str,
    value: f64,
    range: &'static str,
    mend: &'static str,
) -> Result<(), ParameterError> {
    if ok { Ok(()) } else { Err(ParameterError::OutOfRange { name, value, range, mend }) }
}

//! The four shape parameters of the family, and the named rows of its table of special cases.
//!
//! ```
//! use sgtd_core::family::shape::{Row, Shape};
//!
//! let shape = Shape::new(2.5, 1.0, 0.3, 0.4)?;
//! assert_eq!((shape.gamma(), shape.shift()), (2.5, 0.4));
//! // a row of the table fixes what its name says
//! assert_eq!(Row::named("beckmann")?.shape(None, None, None, None)?.gamma(), f64::INFINITY);
//! assert!(Row::named("beckmann")?.shape(Some(3.0), None, None, None).is_err());
//! # Ok::<(), sgtd_core::error::ParameterError>(())
//! ```

use crate::error::{ParameterError, require};

/// Shape of a distribution at unit roughness: all four parameters are pure numbers.
///
/// `f(x) = (1 + u/(γ−1))^(−γ)` with `u = (|x−m|/c±)^(2p)` and `c± = 1 ± λ`; at `γ = ∞`, `f(x) = exp(−u)`.
///
/// Source: Ribardière et al. 2019, Eq. 1–4, with `m = μ/σ`: keeping `m` fixed instead of `μ` makes every
/// member of the family shape invariant, so anisotropy and masking need one function of one variable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    gamma: f64,
    p: f64,
    lambda: f64,
    shift: f64,
}

/// Least and greatest kurtosis that the accuracy tests cover.
const P_RANGE: (f64, f64) = (0.1, 100.0);
/// Greatest |λ|: the narrow side keeps a width of 1e-4 in units of the roughness.
const LAMBDA_MAX: f64 = 0.9999;
/// Greatest relative shift; the ring is then 10⁴ times thinner than its radius.
const SHIFT_MAX: f64 = 1e4;
/// From here on γ is infinite to every digit: −ln f differs from its limit u by u²/(2γ), u < 745.
pub(crate) const INFINITE_GAMMA: f64 = 1e25;

impl Shape {
    /// Validates the four parameters.
    ///
    /// Domain: `γ > 1` (infinity allowed), `0.1 ≤ p ≤ 100`, `2pγ > 3`, `|λ| ≤ 0.9999`, `0 ≤ m ≤ 10⁴`.
    ///
    /// # Errors
    /// Names the parameter, its value, the allowed range and the mend.
    pub fn new(gamma: f64, p: f64, lambda: f64, shift: f64) -> Result<Self, ParameterError> {
        require(
            gamma > 1.0,
            "gamma",
            gamma,
            "a number greater than 1, or inf",
            "inf gives Gaussian-like tails, 2 those of GGX",
        )?;
        require(
            (P_RANGE.0..=P_RANGE.1).contains(&p),
            "p",
            p,
            "between 0.1 and 100",
            "1 is the bell of Beckmann and GGX, larger is flatter, smaller is more peaked",
        )?;
        let product = 2.0 * p * gamma;
        if product <= 3.0 {
            return Err(ParameterError::TailTooHeavy { gamma, p, product, least_gamma: 1.5 / p, least_p: 1.5 / gamma });
        }
        require(
            lambda.abs() <= LAMBDA_MAX,
            "lambda",
            lambda,
            "between -0.9999 and 0.9999",
            "0 is no skew, positive values widen the outer side",
        )?;
        require(
            (0.0..=SHIFT_MAX).contains(&shift),
            "shift",
            shift,
            "between 0 and 10000",
            "it is the radius of the ring divided by the roughness, 0 is no ring",
        )?;
        Ok(Self { gamma, p, lambda, shift })
    }

    /// Tail parameter γ; infinite for exponential tails.
    pub fn gamma(&self) -> f64 {
        self.gamma
    }
    /// Kurtosis parameter p.
    pub fn p(&self) -> f64 {
        self.p
    }
    /// Skew λ.
    pub fn lambda(&self) -> f64 {
        self.lambda
    }
    /// Relative shift m = μ/σ.
    pub fn shift(&self) -> f64 {
        self.shift
    }

    /// The same with another γ and λ, which the caller knows to be in range.
    pub(crate) fn with(&self, gamma: f64, lambda: f64) -> Self {
        Self { gamma, lambda, ..*self }
    }
}

/// A named row of the family: which parameters it fixes, and to what.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// The name that users write.
    pub name: &'static str,
    gamma: Option<f64>,
    p: Option<f64>,
    lambda: Option<f64>,
}

const fn row(name: &'static str, gamma: Option<f64>, p: Option<f64>, lambda: Option<f64>) -> Row {
    Row { name, gamma, p, lambda }
}

/// All rows. A shift is free in every one of them.
///
/// Source: Ribardière et al. 2019, Table 1; the skewed t (`std`) has p = 1, not 2 as the heading of its section says.
pub const ROWS: [Row; 10] = [
    row("sgtd", None, None, None),
    row("gtd", None, None, Some(0.0)),
    row("sgnd", Some(f64::INFINITY), None, None),
    row("std", None, Some(1.0), None),
    row("gnd", Some(f64::INFINITY), None, Some(0.0)),
    row("snd", Some(f64::INFINITY), Some(1.0), None),
    row("student", None, Some(1.0), Some(0.0)),
    row("hyper_cauchy", None, Some(1.0), Some(0.0)),
    row("beckmann", Some(f64::INFINITY), Some(1.0), Some(0.0)),
    row("ggx", Some(2.0), Some(1.0), Some(0.0)),
];

/// Values that free parameters take when the user leaves them out: GGX.
const DEFAULTS: (f64, f64, f64, f64) = (2.0, 1.0, 0.0, 0.0);

impl Row {
    /// Finds a row by its name (lower case).
    ///
    /// # Errors
    /// Lists the names there are.
    pub fn named(name: &str) -> Result<&'static Row, ParameterError> {
        ROWS.iter().find(|row| row.name == name).ok_or_else(|| ParameterError::UnknownRow {
            given: name.to_owned(),
            known: ROWS.map(|row| row.name).join(", "),
        })
    }

    /// The shape of this row with the parameters that the user gave; `None` means left out.
    ///
    /// # Errors
    /// A parameter that the row fixes was given, or a value is out of range.
    pub fn shape(
        &self,
        gamma: Option<f64>,
        p: Option<f64>,
        lambda: Option<f64>,
        shift: Option<f64>,
    ) -> Result<Shape, ParameterError> {
        let choose = |name, fixed: Option<f64>, given: Option<f64>, default| match (fixed, given) {
            (Some(fixed), Some(value)) => Err(ParameterError::Fixed { row: self.name, name, fixed, value }),
            (Some(fixed), None) => Ok(fixed),
            (None, given) => Ok(given.unwrap_or(default)),
        };
        Shape::new(
            choose("gamma", self.gamma, gamma, DEFAULTS.0)?,
            choose("p", self.p, p, DEFAULTS.1)?,
            choose("lambda", self.lambda, lambda, DEFAULTS.2)?,
            shift.unwrap_or(DEFAULTS.3),
        )
    }

    /// The fixed values of gamma, p and lambda.
    fn fixed(&self) -> [Option<f64>; 3] {
        [self.gamma, self.p, self.lambda]
    }

    /// How many of gamma, p and lambda are free.
    pub fn freedom(&self) -> usize {
        self.fixed().iter().filter(|value| value.is_none()).count()
    }

    /// Does the shape have the values that this row fixes?
    pub fn allows(&self, shape: &Shape) -> bool {
        let values = [shape.gamma, shape.p, shape.lambda];
        self.fixed().iter().zip(values).all(|(fixed, value)| fixed.is_none_or(|fixed| fixed == value))
    }

    /// Is every shape of the other row one of this row's?
    pub fn includes(&self, other: &Row) -> bool {
        self.fixed().iter().zip(other.fixed()).all(|(mine, theirs)| mine.is_none() || *mine == theirs)
    }

    /// Factor on the roughness that the user gives: 1 but for `hyper_cauchy`.
    ///
    /// The hyper-Cauchy distribution of the literature is
    /// `D(θ) = (q−1) (2σ²)^(q−1) / (π cos⁴θ (2σ² + tan²θ)^q)`, that is Student's with `γ = q` and
    /// `α = σ √(2/(q−1))`.
    pub fn alpha_scale(&self, shape: &Shape) -> f64 {
        if self.name == "hyper_cauchy" && shape.gamma.is_finite() { (2.0 / (shape.gamma - 1.0)).sqrt() } else { 1.0 }
    }
}

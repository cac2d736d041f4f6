//! What masking, sampling and tables need to know of a radial profile, and nothing else.
//!
//! A profile lives at unit roughness: `x` is the slope tan θ_m divided by the roughness. Any profile that
//! implements this trait (a measured one, a piecewise one) gets masking, sampling, anisotropy and tables.
//!
//! ```
//! use sgtd_core::family::{shape::Shape, skewed_t::SkewedT};
//! use sgtd_core::profile::{MixtureProfile, Part, Profile};
//! use std::sync::Arc;
//!
//! let part = |weight, scale, gamma| -> Result<Part, sgtd_core::error::ParameterError> {
//!     Ok(Part { weight, scale, profile: Arc::new(SkewedT::new(Shape::new(gamma, 1.0, 0.0, 0.0)?)) })
//! };
//! let mixture = MixtureProfile::new(vec![part(0.8, 0.1, f64::INFINITY)?, part(0.2, 0.5, 2.0)?])?;
//! assert!((mixture.cdf(1.0) + mixture.sf(1.0) - 1.0).abs() < 1e-12);
//! # Ok::<(), sgtd_core::error::ParameterError>(())
//! ```

pub mod cells;
pub mod derivatives;
pub mod mixture;
pub mod pieces;
pub mod resample;
pub mod table_file;
pub mod tabulated;

pub use cells::ProfileCells;
pub use mixture::{MixtureProfile, Part};
pub use pieces::Piece;
pub use tabulated::{Quantity, TableTail, TabulatedProfile};

/// `H(q)` and `S(q)` of one profile at one argument.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Masking {
    /// H(q), Λ = H/q.
    pub h: f64,
    /// S(q) = −H′(q), the share of directional slopes above q.
    pub s: f64,
}

/// How a profile ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tail {
    /// Faster than any power: nothing is left beyond the last break point.
    Exponential,
    /// `f(x) ∝ x^(−3−excess)` to double precision from `exact_from` on.
    Power {
        /// Where the power law has become exact.
        exact_from: f64,
        /// By how much the exponent exceeds 3, the least for which masking is finite.
        excess: f64,
    },
}

/// Over what visible normals are tabulated; either has a table of the same size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coordinate {
    /// x²: for profiles that are smooth between a few break points.
    Square,
    /// F/(1−F): for profiles of any number of pieces whose quantiles are closed forms.
    Odds,
}

/// A radial slope profile at unit roughness.
///
/// `D(ω_m) = A f(x) / (π σx σy cos⁴θ_m)`, `1/(2A) = ∫₀^∞ x f(x) dx`, `F(x) = 2A ∫₀^x t f(t) dt`.
pub trait Profile: Send + Sync {
    /// `f(x)`, not normalized, for x ≥ 0.
    fn f(&self, x: f64) -> f64;
    /// `f(from + past)` where the sum need not be representable: thin rings need it.
    fn f_past(&self, from: f64, past: f64) -> f64 {
        self.f(from + past)
    }
    /// `f(x)` for rendering: plain arithmetic; its error may grow with −ln f, to 1e-11 at 1e-290.
    fn f_fast(&self, x: f64) -> f64 {
        self.f(x)
    }
    /// `A`.
    fn normalization(&self) -> f64;
    /// `F(x)`, the share of slopes below x in the projected distribution D·cos.
    fn cdf(&self, x: f64) -> f64;
    /// `1 − F(x)` with its own relative accuracy.
    fn sf(&self, x: f64) -> f64;
    /// Inverse of [`Profile::cdf`] on [0, 1].
    fn quantile(&self, u: f64) -> f64;
    /// Inverse of [`Profile::sf`] on [0, 1].
    fn isf(&self, u: f64) -> f64;
    /// `2A ∫₀^∞ x² f(x) dx`, the mean slope.
    fn mean(&self) -> f64;
    /// Points of (0, ∞), ascending, between which ln f changes by about 10 at the most and f is smooth. They end
    /// where f, times x³, has fallen by e^−depth below its peak, or well into the part of a power tail that is exact; cusps of
    /// f are among them.
    fn breaks(&self, depth: f64) -> Vec<f64>;
    /// Points where f is not smooth.
    fn cusps(&self) -> &[f64];
    /// Whether f may have a corner or a step at a break point: then nothing is integrated across one.
    fn bends_at_breaks(&self) -> bool {
        false
    }
    /// Of what it is the sum, where it is one: masking is then the sum of theirs.
    fn parts(&self) -> &[Part] {
        &[]
    }
    /// Of what pieces it is made, where it is: single precision then has them exactly.
    fn pieces(&self) -> Option<Vec<Piece>> {
        None
    }
    /// Over what visible normals are tabulated.
    fn coordinate(&self) -> Coordinate {
        Coordinate::Square
    }
    /// How it ends.
    fn tail(&self) -> Tail;
    /// How it follows its parameters, where that is known.
    fn derivatives(&self) -> Option<&dyn derivatives::Derivatives> {
        None
    }
    /// How it follows the values that it is interpolated between, if it is.
    fn values(&self) -> Option<&dyn derivatives::Values> {
        None
    }
    /// H and S at q ≥ 0 in closed form, to 1e-12; `None` where there is none, or none that holds this. Masking is then found
    /// by quadrature.
    fn masking(&self, _q: f64) -> Option<Masking> {
        None
    }
}

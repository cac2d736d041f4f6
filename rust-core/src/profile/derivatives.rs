//! How a profile follows its parameters, in the form that survives cusps.
//!
//! Masking and the normalization are integrals `∫ f w dx` over a kernel w. A parameter that moves or widens f makes
//! `∂f/∂θ` behave like `|x−m|^(2p−1)` at a cusp, which no rule sums well below p = ½; integrated by parts it becomes f against w′.

/// Parameters of the family: 1/γ, p, λ and m, in this order. 1/γ instead of γ, for the derivative to exist at γ = ∞.
pub const PARAMETERS: usize = 4;

/// `∂/∂θ ∫_q^∞ f w dx = ∫_q^∞ f (α w + β w′) dx` for every smooth w with w(q) = 0, or q = 0 and w(0) = 0.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Term {
    /// What stands before w.
    pub alpha: f64,
    /// What stands before w′.
    pub beta: f64,
}

/// A profile with derivatives by its parameters.
pub trait Derivatives {
    /// The terms of each parameter at `x = from + past`; the sum need not be representable.
    fn terms(&self, from: f64, past: f64) -> [Term; PARAMETERS];
    /// `∂ ln f/∂θ` at a fixed x; 0 at a cusp itself, where there may be none.
    fn log_f(&self, x: f64) -> [f64; PARAMETERS];
    /// `∂e/∂θ` of a tail `f ∝ x^(−3−e)`.
    fn excess(&self) -> [f64; PARAMETERS];
}

/// A profile that is interpolated between values at fixed slopes.
///
/// In each of its cells two of the values have a part: `∂ ln f/∂ ln v` is `1 − share` for the first and `share` for the second of them, and 0 for all
/// others. A value of 0 stays 0: it has no logarithm.
pub trait Values {
    /// How many values there are.
    fn count(&self) -> usize;
    /// The cell that x is in.
    fn cell_of(&self, x: f64) -> usize;
    /// The rows of the two values that a cell lies between.
    fn rows(&self, cell: usize) -> [usize; 2];
    /// The second one's share at `x = from + past`, seen from a cell.
    fn share(&self, cell: usize, from: f64, past: f64) -> f64;
    /// By how much the share grows per e-fold of x where a power tail is exact.
    fn share_rate_of_tail(&self) -> f64;
}

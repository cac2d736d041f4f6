//! Powers with an exponent that is fixed for the life of a material.
//!
//! Most materials have p = 1 and many a whole or half γ: those need no logarithm.

/// An exponent, sorted by how it is best applied.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Exponent {
    /// The square, by far the most common (p = 1).
    Two,
    /// Three or four: still as accurate as `powf`.
    Few(i32),
    /// A small whole number.
    Whole(i32),
    /// A small whole number and a half.
    Half(i32),
    /// Anything else.
    Real(f64),
}

/// Largest whole part that is multiplied out: rounding grows with it (2e-15 at 16), time by one
/// multiplication per doubling.
const LARGEST: f64 = 16.0;

impl Exponent {
    /// Sorts `exponent`, which is positive.
    pub fn new(exponent: f64) -> Self {
        if exponent == 2.0 {
            Self::Two
        } else if exponent == 3.0 || exponent == 4.0 {
            Self::Few(exponent as i32)
        } else if exponent <= LARGEST && exponent.fract() == 0.0 {
            Self::Whole(exponent as i32)
        } else if exponent <= LARGEST && exponent.fract() == 0.5 {
            Self::Half(exponent as i32)
        } else {
            Self::Real(exponent)
        }
    }

    /// `x^exponent` for x ≥ 0; relative error below 4e-16.
    #[inline]
    pub fn of(self, x: f64) -> f64 {
        match self {
            Self::Two => x * x,
            Self::Few(n) => x.powi(n),
            Self::Whole(n) => x.powf(f64::from(n)),
            Self::Half(n) => x.powf(f64::from(n) + 0.5),
            Self::Real(exponent) => x.powf(exponent),
        }
    }

    /// `x^exponent` for x ≥ 0 where an error of 3e-16 (1 + |ln x^exponent|) will do: `exp` of `ln` takes two thirds of the
    /// time of `powf`, which carries a logarithm of twice the length.
    #[inline]
    pub fn fast(self, x: f64) -> f64 {
        match self {
            Self::Two => x * x,
            Self::Few(n) | Self::Whole(n) => x.powi(n),
            Self::Half(n) => x.powi(n) * x.sqrt(),
            Self::Real(exponent) => (exponent * x.ln()).exp(),
        }
    }

    /// `x^−exponent` for x > 0, to the accuracy of [`Exponent::fast`].
    #[inline]
    pub fn fast_reciprocal(self, x: f64) -> f64 {
        match self {
            Self::Real(exponent) => (-exponent * x.ln()).exp(),
            _ => 1.0 / self.fast(x),
        }
    }
}

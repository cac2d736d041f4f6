//! Arithmetic on unevaluated sums of two doubles: about 31 decimal digits.
//!
//! Sums and products: Dekker 1971, Knuth TAOCP 4.2.2. `exp` by Taylor's series after halving, `ln` by one Newton step
//! on it.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// `hi + lo` with |lo| at most half an ulp of hi.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dd {
    /// The value rounded to double.
    pub hi: f64,
    /// What rounding left out.
    pub lo: f64,
}

/// ln 2 to 32 digits.
const LN_2: Dd = Dd { hi: std::f64::consts::LN_2, lo: 2.3190468138462996e-17 };
/// 2^-HALVINGS of the reduced argument goes into Taylor's series.
const HALVINGS: i32 = 8;

impl From<f64> for Dd {
    fn from(hi: f64) -> Self {
        Self { hi, lo: 0.0 }
    }
}

/// `a + b` for |a| ≥ |b|.
fn quick_sum(a: f64, b: f64) -> Dd {
    let hi = a + b;
    Dd { hi, lo: b - (hi - a) }
}

/// `a + b` exactly.
fn two_sum(a: f64, b: f64) -> Dd {
    let hi = a + b;
    let back = hi - a;
    Dd { hi, lo: (a - (hi - back)) + (b - back) }
}

impl Add for Dd {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let (high, low) = (two_sum(self.hi, other.hi), two_sum(self.lo, other.lo));
        let first = quick_sum(high.hi, high.lo + low.hi);
        quick_sum(first.hi, first.lo + low.lo)
    }
}

impl Neg for Dd {
    type Output = Self;
    fn neg(self) -> Self {
        Self { hi: -self.hi, lo: -self.lo }
    }
}

impl Sub for Dd {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Dd {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let hi = self.hi * other.hi;
        let lo = self.hi.mul_add(other.hi, -hi) + (self.hi * other.lo + self.lo * other.hi);
        quick_sum(hi, lo)
    }
}

impl Div for Dd {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let first = self.hi / other.hi;
        let rest = self - other * Dd::from(first);
        let second = rest.hi / other.hi;
        let rest = rest - other * Dd::from(second);
        quick_sum(first, second) + Dd::from(rest.hi / other.hi)
    }
}

impl Dd {
    /// Square root.
    pub fn sqrt(self) -> Self {
        if self.hi <= 0.0 {
            return Dd::from(0.0);
        }
        let root = Dd::from(self.hi.sqrt());
        root + (self - root * root) / (root + root)
    }

    /// e to this power; 0 or ∞ where double precision ends.
    pub fn exp(self) -> Self {
        if self.hi > 709.7 {
            return Dd::from(f64::INFINITY);
        }
        if self.hi < -745.0 {
            return Dd::from(0.0);
        }
        let k = (self.hi / LN_2.hi).round();
        let r = (self - LN_2 * Dd::from(k)) * Dd::from(0.5f64.powi(HALVINGS));
        // e^r − 1
        let mut sum = Dd::from(0.0);
        for n in (1..=10).rev() {
            sum = (sum + Dd::from(1.0)) * r / Dd::from(f64::from(n));
        }
        for _ in 0..HALVINGS {
            sum = sum * (sum + Dd::from(2.0));
        }
        let value = sum + Dd::from(1.0);
        // in two steps: 2^k alone may be subnormal
        let (first, second) = (2f64.powi(k as i32 / 2), 2f64.powi(k as i32 - k as i32 / 2));
        Dd { hi: value.hi * first * second, lo: value.lo * first * second }
    }

    /// Natural logarithm of a positive number.
    pub fn ln(self) -> Self {
        let guess = Dd::from(self.hi.ln());
        let error = self * (-guess).exp() - Dd::from(1.0);
        guess + error - error * error * Dd::from(0.5)
    }
}

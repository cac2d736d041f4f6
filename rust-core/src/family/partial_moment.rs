//! Partial moments of one side of the profile: the closed forms under A, the radial cdf and the moments.
//!
//! With `g(r) = (1 + r^(2p)/(γ−1))^(−γ)` (or `exp(−r^(2p))`), `s = k/(2p)`:
//!
//! `J_k(R) = ∫₀^R r^(k−1) g(r) dr = (γ−1)^s B(z; s, γ−s) / (2p)`, `z = y/(1+y)`, `y = R^(2p)/(γ−1)`.
//!
//! Everything is written as prefix `R^k g(R)` times a ratio of order one, so that tails of 1e-290 keep all
//! their digits; the complement comes from its own expansion, never from `1 − J`.

use crate::family::shape::INFINITE_GAMMA;
use crate::numerics::exponent::Exponent;
use crate::numerics::gamma_ratio::{gamma, scaled_gamma_ratio};

/// The width 1 ± λ of one side, with its rounding error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Width {
    hi: f64,
    lo: f64,
    inverse: f64,
}

impl Width {
    /// `1 + skew`, where `skew` is λ on the outer side and −λ on the inner one.
    pub fn new(skew: f64) -> Self {
        let hi = 1.0 + skew;
        Self { hi, lo: skew - (hi - 1.0), inverse: 1.0 / hi }
    }
}

/// A radius with its rounding error, so that steep profiles keep their digits: the value is `hi + lo`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radius {
    /// The rounded value.
    pub hi: f64,
    /// What rounding left out.
    pub lo: f64,
}

impl Radius {
    /// `|from + past − m| / width`, where the sum need not be representable.
    #[inline]
    pub fn of(from: f64, past: f64, m: f64, width: Width) -> Self {
        let (start, start_lo) = two_sum(from, -m);
        let (distance, distance_lo) = two_sum(start, past);
        let signed_lo = distance_lo + start_lo;
        let (distance, distance_lo) = if distance < 0.0 { (-distance, -signed_lo) } else { (distance, signed_lo) };
        let hi = distance * width.inverse;
        let lo = (hi.mul_add(-width.hi, distance) + distance_lo - hi * width.lo) * width.inverse;
        Self { hi, lo: if lo.is_finite() { lo } else { 0.0 } }
    }

    /// A radius without a rounding error.
    pub fn exact(hi: f64) -> Self {
        Self { hi, lo: 0.0 }
    }
}

/// Knuth's sum: the rounded value and what rounding left out, whatever the magnitudes.
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let back = sum - a;
    (sum, (a - (sum - back)) + (b - back))
}

/// One side's radial function `g(r)` and its moments.
#[derive(Debug, Clone, Copy)]
pub struct Side {
    gamma: f64,
    two_p: f64,
    /// 1/(γ−1)
    inverse_less: f64,
    kurtosis: Exponent,
    tail: Exponent,
}

/// From here on g is exp(−u) with that difference added: γ would magnify the rounding of 1 + u/γ beyond all bounds.
const ALMOST_INFINITE_GAMMA: f64 = 1e15;
/// Beyond this, exp(−u) is 0.
const SPENT: f64 = 746.0;
/// Beyond this, r^(2p) and its rounding error are about to overflow.
const LARGEST_BASE: f64 = 1e300;
/// Up to here the rounding of 1 + y costs less than 1e-13.
const LARGEST_PLAIN_GAMMA: f64 = 1e3;
/// Below this g loses digits, but r^k g in a power tail may still be 1e-280.
const LEAST_NORMAL: f64 = 1e-305;
/// Terms after which a series or continued fraction has long converged; the slowest (z = 0.99) needs 3500.
const MOST_TERMS: usize = 5000;
/// Up to here the power series of the lower function is used where the continued fraction does not converge.
const LOWER_SERIES_MAX: f64 = 0.9;
/// The same where b is below [`NEAR_LIMIT`]: the total is about 1/b there, and the lower function a small difference. At 2pγ = 3.001, k = 3
/// and z = 0.91 it would be off by 9e-13.
const LOWER_SERIES_MAX_NEAR_LIMIT: f64 = 0.99;
/// Only the third moment next to 2pγ = 3 has a b below.
const NEAR_LIMIT: f64 = 0.1;

impl Side {
    /// γ (infinity allowed) and p of a validated shape.
    pub fn new(gamma: f64, p: f64) -> Self {
        let gamma = if gamma < INFINITE_GAMMA { gamma } else { f64::INFINITY };
        Self {
            gamma,
            two_p: 2.0 * p,
            inverse_less: 1.0 / (gamma - 1.0),
            kurtosis: Exponent::new(2.0 * p),
            tail: Exponent::new(gamma),
        }
    }

    /// `g(r)` for `r ≥ 0`.
    ///
    /// Relative error below 1e-13 down to 1e-290: every rounding that the exponents γ and 2p would amplify is
    /// carried along to first order.
    #[inline]
    pub fn kernel(&self, Radius { hi, lo }: Radius) -> f64 {
        if hi <= 0.0 {
            return 1.0;
        }
        let power = self.kurtosis.of(hi);
        let relative = self.two_p * (lo / hi);
        if self.gamma > ALMOST_INFINITE_GAMMA {
            if power > SPENT {
                return 0.0;
            }
            // −γ ln(1 + u/(γ−1)) = −u + u (u/2 − 1)/γ, to 1e-20
            let rest = power * ((0.5 * power - 1.0) / self.gamma - relative);
            return (-power).exp() * (1.0 + rest);
        }
        let less = self.gamma - 1.0;
        let y = power * self.inverse_less;
        if y > LARGEST_BASE {
            // log g = −γ (2p ln r − ln(γ−1)), where r^(2p) is too large to be multiplied out.
            return (-self.gamma * (self.two_p * hi.ln() - less.ln())).exp();
        }
        let y_lo = y.mul_add(-less, power) * self.inverse_less + y * relative;
        let base = 1.0 + y;
        let base_lo = if y < 1.0 { y - (base - 1.0) } else { 1.0 - (base - y) } + y_lo;
        let correction = -self.gamma * (base_lo / base);
        // γ may be 10¹²: the correction is then 1e-4 and needs its second order too
        let correction = if correction.abs() < 1e-9 { 1.0 + correction } else { correction.exp() };
        correction / self.tail.of(base)
    }

    /// `g(r)` without carrying rounding errors along: to 1e-13, growing with −ln g and p to 1e-11 at 1e-290, p = 50.
    #[inline]
    pub fn kernel_fast(&self, r: f64) -> f64 {
        let power = self.kurtosis.fast(r);
        if self.gamma.is_infinite() {
            return (-power).exp();
        }
        // The rounding of the base is magnified by γ.
        if self.gamma > LARGEST_PLAIN_GAMMA {
            self.kernel(Radius::exact(r))
        } else {
            self.tail.fast_reciprocal(power.mul_add(self.inverse_less, 1.0))
        }
    }

    /// −ln g(r): how far below its peak the profile is.
    pub fn depth(&self, r: f64) -> f64 {
        let u = r.powf(self.two_p);
        if self.gamma.is_infinite() {
            return u;
        }
        let y = u * self.inverse_less;
        // where r^(2p) overflows (p = 1: at 1e154) power tails have most of their way to 1e-300 still before them
        self.gamma * if y > LARGEST_BASE { self.two_p * r.ln() + self.inverse_less.ln() } else { y.ln_1p() }
    }

    /// Inverse of [`Side::depth`].
    pub fn radius_at_depth(&self, depth: f64) -> f64 {
        let u = if self.gamma.is_infinite() {
            depth
        } else if depth < 700.0 * self.gamma {
            (self.gamma - 1.0) * (depth / self.gamma).exp_m1()
        } else {
            return ((depth / self.gamma + (self.gamma - 1.0).ln()) / self.two_p).exp();
        };
        u.powf(1.0 / self.two_p)
    }

    /// `J_k(∞)`, k = 1, 2, 3, for k < 2pγ.
    pub fn total(&self, k: u32) -> f64 {
        let s = f64::from(k) / self.two_p;
        gamma(s) * scaled_gamma_ratio(self.gamma, s, self.other(k)) / self.two_p
    }

    /// γ − k/(2p) in one rounding: near the limit of the domain it is small.
    fn other(&self, k: u32) -> f64 {
        self.two_p.mul_add(self.gamma, -f64::from(k)) / self.two_p
    }

    /// `J_k(r)`.
    pub fn lower(&self, k: u32, r: Radius) -> f64 {
        if r.hi <= 0.0 {
            return 0.0;
        }
        if r.hi.is_infinite() {
            return self.total(k);
        }
        let at = self.at(k, r);
        if at.prefix == 0.0 {
            return if at.fraction_converges { self.total(k) } else { 0.0 };
        }
        if at.fraction_converges {
            self.total(k) - at.prefix * self.upper_fraction(&at) / self.two_p
        } else if at.z <= if at.b < NEAR_LIMIT { LOWER_SERIES_MAX_NEAR_LIMIT } else { LOWER_SERIES_MAX } {
            at.prefix * self.lower_series(&at) / f64::from(k)
        } else {
            self.total(k) - at.prefix * self.upper_series(&at) / self.two_p
        }
    }

    /// `J_k(∞) − J_k(r)`.
    pub fn upper(&self, k: u32, r: Radius) -> f64 {
        if r.hi <= 0.0 {
            return self.total(k);
        }
        if r.hi.is_infinite() {
            return 0.0;
        }
        let at = self.at(k, r);
        if at.prefix == 0.0 {
            return if at.fraction_converges { 0.0 } else { self.total(k) };
        }
        if at.fraction_converges {
            at.prefix * self.upper_fraction(&at) / self.two_p
        } else if at.z <= 0.5 {
            self.total(k) - at.prefix * self.lower_series(&at) / f64::from(k)
        } else {
            at.prefix * self.upper_series(&at) / self.two_p
        }
    }

    fn at(&self, k: u32, radius: Radius) -> Argument {
        let r = radius.hi;
        let s = f64::from(k) / self.two_p;
        let u = r.powf(self.two_p);
        let (z, x, scaled) = if self.gamma.is_infinite() {
            (0.0, 1.0, u)
        } else {
            let y = u / (self.gamma - 1.0);
            if y > LARGEST_BASE {
                (1.0, 0.0, self.gamma)
            } else {
                let x = 1.0 / (1.0 + y);
                // γ z, which tends to u as γ → ∞
                (y * x, x, self.gamma * y * x)
            }
        };
        // r^k g(r), from logarithms where r^k alone would overflow or g has become denormal
        let g = self.kernel(radius);
        let power = r.powi(k as i32);
        let prefix = if power.is_finite() && g > LEAST_NORMAL {
            power * g
        } else {
            let rest = scaled * self.two_p * (radius.lo / r);
            (f64::from(k) * r.ln() - self.depth(r) - if rest.is_finite() { rest } else { 0.0 }).exp()
        };
        Argument { s, b: self.other(k), z, x, scaled, prefix, fraction_converges: scaled > s.max(0.5) }
    }

    /// `Σ (γ)_n/(s+1)_n zⁿ`, all terms positive (DLMF 8.17.8 after Euler's transformation; 8.7.1 at γ = ∞).
    fn lower_series(&self, at: &Argument) -> f64 {
        let mut term = 1.0;
        let mut sum = 1.0;
        for n in 0..MOST_TERMS {
            let n = n as f64;
            term *= (at.scaled + n * at.z) / (at.s + 1.0 + n);
            sum += term;
            if term < 1e-17 * sum {
                break;
            }
        }
        sum
    }

    /// `1/b Σ (γ)_n/(b+1)_n xⁿ`, b = γ−s: the same series seen from the other end, for z > ½.
    fn upper_series(&self, at: &Argument) -> f64 {
        let b = at.b;
        let mut term = 1.0;
        let mut sum = 1.0;
        for n in 0..MOST_TERMS {
            let n = n as f64;
            term *= (self.gamma + n) * at.x / (b + 1.0 + n);
            sum += term;
            if term < 1e-17 * sum {
                break;
            }
        }
        sum / b
    }

    /// Continued fraction of the upper function, in a form without differences of large numbers: at γ = 10¹²
    /// the usual one (DLMF 8.17.22) forms 1 − (1 − 1e-12) and is left with four digits.
    ///
    /// It is the even part of DLMF 8.17.22 (Didonato & Morris 1992, section 7) with `γ z − s` taken from the
    /// profile; at γ = ∞ it is that of Γ(s, u), DLMF 8.9.2.
    fn upper_fraction(&self, at: &Argument) -> f64 {
        let (a, s) = (at.b, at.s);
        let difference = at.scaled - s;
        let term = |n: f64| -> (f64, f64) {
            if self.gamma.is_infinite() {
                return (n * (s - n), 2.0 * n + difference + 1.0);
            }
            let d = a + 2.0 * n - 1.0;
            let alpha = if n > 0.0 {
                ((a + n - 1.0) / d) * ((self.gamma + n - 1.0) / d) * n * (s - n) * at.x * at.x
            } else {
                0.0
            };
            let first = if n > 0.0 { n + n * (s - n) * at.x / d } else { 0.0 };
            (alpha, first + (a + n) / (a + 2.0 * n + 1.0) * (difference + 1.0 + n * (1.0 + at.z)))
        };
        // modified Lentz
        const TINY: f64 = 1e-300;
        let (_, beta) = term(0.0);
        let mut value = if beta == 0.0 { TINY } else { beta };
        let (mut c, mut d) = (value, 0.0);
        for n in 1..MOST_TERMS {
            let (alpha, beta) = term(n as f64);
            d = beta + alpha * d;
            d = 1.0 / if d == 0.0 { TINY } else { d };
            c = beta + alpha / c;
            c = if c == 0.0 { TINY } else { c };
            let factor = c * d;
            value *= factor;
            if (factor - 1.0).abs() < 1e-16 {
                break;
            }
        }
        1.0 / value
    }
}

/// Where the expansions of one moment are evaluated.
struct Argument {
    s: f64,
    /// γ − s
    b: f64,
    z: f64,
    x: f64,
    /// γ z
    scaled: f64,
    /// r^k g(r)
    prefix: f64,
    fraction_converges: bool,
}

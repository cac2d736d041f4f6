//! The family straight from its definition: the profile in double-double arithmetic and its integrals by the tanh-sinh
//! rule.
//!
//! Nothing is shared with the crate under test: no closed form, no special function, no Gauss rule. Relative errors
//! are below 1e-14 (measured by `oracle_reproduces_the_reference_values` of the accuracy tests).
#![allow(dead_code)] // every test crate uses a part of it

pub mod double_double;

use double_double::Dd;
use std::sync::OnceLock;

/// A shape by its four parameters.
#[derive(Debug, Clone, Copy)]
pub struct Oracle {
    /// Tail.
    pub gamma: f64,
    /// Kurtosis.
    pub p: f64,
    /// Skew.
    pub lambda: f64,
    /// Relative shift.
    pub m: f64,
}

/// Which side of m.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Side {
    Inner,
    Outer,
}

/// Where pieces end, in −ln g above its value at the start of the integral.
const LEVELS: [f64; 8] = [1e-6, 1e-2, 0.3, 1.0, 2.5, 5.0, 9.0, 14.0];
/// Distance of the levels that follow.
const STEP: f64 = 7.0;
/// An integral ends where the integrand has fallen by e to this power.
const SPENT: f64 = 60.0;
/// Distances below this leave f at 1 to all digits; its logarithm would need denormal numbers.
const LEAST: f64 = 1e-280;
/// Where f itself has underflowed.
const LOST: f64 = 750.0;
/// A power tail counts as exact where its corrections are below one part in this.
const EXACT: f64 = 1e17;

impl Oracle {
    fn width(&self, side: Side) -> Dd {
        let lambda = Dd::from(self.lambda);
        Dd::from(1.0) + if side == Side::Outer { lambda } else { -lambda }
    }

    /// `g(r)`: f at distance r·c from m.
    pub fn g(&self, r: Dd) -> f64 {
        (-self.depth(r)).exp().hi
    }

    /// −ln g(r).
    pub fn depth(&self, r: Dd) -> Dd {
        if r.hi <= LEAST {
            return Dd::from(0.0);
        }
        let log_u = Dd::from(2.0 * self.p) * r.ln();
        if self.gamma.is_infinite() {
            return log_u.exp();
        }
        let (gamma, less) = (Dd::from(self.gamma), Dd::from(self.gamma) - Dd::from(1.0));
        if log_u.hi > 600.0 {
            return gamma * (log_u - less.ln());
        }
        gamma * (Dd::from(1.0) + log_u.exp() / less).ln()
    }

    /// Distance from m in units of the side's width.
    fn radius(&self, x: Dd, side: Side) -> Dd {
        let distance = if side == Side::Outer { x - Dd::from(self.m) } else { Dd::from(self.m) - x };
        distance / self.width(side)
    }

    fn side_of(&self, x: f64) -> Side {
        if x >= self.m { Side::Outer } else { Side::Inner }
    }

    /// `f(x)`.
    pub fn f(&self, x: f64) -> f64 {
        self.f_at(Dd::from(x))
    }

    /// `f(x)` for an x of 31 digits.
    pub fn f_at(&self, x: Dd) -> f64 {
        let side = self.side_of(x.hi);
        let r = self.radius(x, side);
        // x.hi = m: its low part decides
        if r.hi < 0.0 {
            let other = if side == Side::Outer { Side::Inner } else { Side::Outer };
            return self.g(self.radius(x, other));
        }
        self.g(r)
    }

    /// `1/(2A) = ∫ x f dx`.
    pub fn half_reciprocal(&self) -> f64 {
        self.below(self.m) + self.above(self.m)
    }

    /// `A`.
    pub fn normalization(&self) -> f64 {
        0.5 / self.half_reciprocal()
    }

    /// `∫₀^x t f dt`.
    pub fn below(&self, x: f64) -> f64 {
        let first = |x: Dd| x.hi;
        let rim = self.radius(Dd::from(0.0), Side::Inner);
        if x <= self.m {
            return self.piece(Side::Inner, self.radius(Dd::from(x), Side::Inner), Some(rim), 1.0, &[], &first);
        }
        let inner = if self.m > 0.0 { self.below(self.m) } else { 0.0 };
        inner + self.piece(Side::Outer, Dd::from(0.0), Some(self.radius(Dd::from(x), Side::Outer)), 1.0, &[], &first)
    }

    /// `∫_x^∞ t f dt`.
    pub fn above(&self, x: f64) -> f64 {
        self.beyond(x, 1.0, &[], &|t: Dd| t.hi)
    }

    /// `∫₀^∞ x² f dx`.
    pub fn second(&self) -> f64 {
        let second = |t: Dd| t.hi * t.hi;
        let rim = self.radius(Dd::from(0.0), Side::Inner);
        let inner =
            if self.m > 0.0 { self.piece(Side::Inner, Dd::from(0.0), Some(rim), 2.0, &[], &second) } else { 0.0 };
        inner + self.piece(Side::Outer, Dd::from(0.0), None, 2.0, &[], &second)
    }

    /// `∫₀^r t^(k−1) g dt`.
    pub fn moment_below(&self, k: u32, r: f64) -> f64 {
        let weight = |t: Dd| t.hi.powi(k as i32 - 1);
        self.centered().piece(Side::Outer, Dd::from(0.0), Some(Dd::from(r)), f64::from(k - 1), &[], &weight)
    }

    /// `∫_r^∞ t^(k−1) g dt`.
    pub fn moment_above(&self, k: u32, r: f64) -> f64 {
        let weight = |t: Dd| t.hi.powi(k as i32 - 1);
        self.centered().piece(Side::Outer, Dd::from(r), None, f64::from(k - 1), &[], &weight)
    }

    /// The profile with neither skew nor shift, which is g itself.
    fn centered(&self) -> Self {
        Self { lambda: 0.0, m: 0.0, ..*self }
    }

    /// `∫_q^∞ t f [√(t²−q²) − q acos(q/t)] dt`: H but for the factor 2A/π.
    pub fn bracket_integral(&self, q: f64) -> f64 {
        self.beyond(q, 2.0, &scales(q), &|t: Dd| t.hi * kernel(q, (t - Dd::from(q)).hi.max(0.0)).0)
    }

    /// `∫_q^∞ t f acos(q/t) dt`: S but for the factor 2A/π.
    pub fn angle_integral(&self, q: f64) -> f64 {
        self.beyond(q, 1.0, &scales(q), &|t: Dd| t.hi * kernel(q, (t - Dd::from(q)).hi.max(0.0)).1)
    }

    /// `∫_x^∞ weight(t) f(t) dt` for a weight that grows like `t^power`.
    fn beyond(&self, x: f64, power: f64, cuts: &[Dd], weight: &dyn Fn(Dd) -> f64) -> f64 {
        let x = Dd::from(x);
        if x.hi >= self.m {
            return self.piece(Side::Outer, self.radius(x, Side::Outer), None, power, cuts, weight);
        }
        self.piece(Side::Inner, Dd::from(0.0), Some(self.radius(x, Side::Inner)), power, cuts, weight)
            + self.piece(Side::Outer, Dd::from(0.0), None, power, cuts, weight)
    }

    /// One side's share, between two distances from m (`None`: to infinity).
    fn piece(&self, side: Side, from: Dd, to: Option<Dd>, power: f64, cuts: &[Dd], weight: &dyn Fn(Dd) -> f64) -> f64 {
        let width = self.width(side);
        let sign = Dd::from(if side == Side::Outer { 1.0 } else { -1.0 });
        let x_of = |r: Dd| Dd::from(self.m) + sign * width * r;
        let integrand = |r: Dd| {
            let g = self.g(r);
            if g > 0.0 { weight(x_of(r)) * g } else { 0.0 }
        };
        let start = self.depth(from).hi;
        if !(start <= LOST) {
            return 0.0;
        }
        let end = to.map_or(f64::INFINITY, |r| r.hi);
        let tail = (Dd::from(2.0 * self.p) * Dd::from(self.gamma) - Dd::from(1.0 + power)).hi;
        let mut ends = vec![from];
        let mut cut_radii: Vec<Dd> = cuts.iter().map(|&x| self.radius(x, side)).filter(|r| r.hi > from.hi).collect();
        cut_radii.sort_by(|a, b| a.hi.total_cmp(&b.hi));
        let reference = from.hi.max(self.radius_at(start + 1.0));
        let levels = LEVELS.into_iter().chain((1..2000).map(|k| LEVELS[7] + STEP * f64::from(k)));
        let mut power_from = None;
        let mut reached = false;
        for level in levels {
            let r = self.radius_at(start + level);
            if !(r > ends[ends.len() - 1].hi) {
                continue;
            }
            let last = ends[ends.len() - 1].hi;
            ends.extend(cut_radii.iter().filter(|cut| cut.hi > last && cut.hi < r.min(end)));
            reached = r >= end;
            if reached {
                break;
            }
            ends.push(Dd::from(r));
            if level - (power + 2.0) * (r / reference).max(1.0).ln() > SPENT {
                break;
            }
            let nearby = self.m.max(cuts.first().map_or(0.0, |q| q.hi));
            let corrections = (self.gamma * self.gamma).max(1.0) * r.powf(-2.0 * self.p);
            if to.is_none() && corrections < 1.0 / EXACT && r > EXACT * nearby {
                power_from = Some(r);
                break;
            }
        }
        if let (true, Some(to)) = (reached, to) {
            ends.push(to);
        }
        let sum: f64 = ends.windows(2).map(|pair| tanh_sinh(pair[0], pair[1], &integrand)).sum();
        let rest = power_from.map_or(0.0, |r| integrand(Dd::from(r)) * r / tail);
        width.hi * (sum + rest)
    }

    /// Where −ln g has this value; needed for cuts only, so plain arithmetic will do.
    pub fn radius_at(&self, depth: f64) -> f64 {
        let log_u = if self.gamma.is_infinite() {
            depth.ln()
        } else {
            let share = depth / self.gamma;
            (self.gamma - 1.0).ln() + if share < 600.0 { share.exp_m1().ln() } else { share }
        };
        (log_u / (2.0 * self.p)).exp()
    }
}

/// `√(ρ²−q²) − q acos(q/ρ)` and `acos(q/ρ)` for ρ = q + past.
///
/// With t = tan ψ the bracket is q (t − atan t), and `atan t = t/(1+K)`, `K = t²/(3 + 4t²/(5 + 9t²/(7 + …)))` (Euler)
/// gives `t − atan t = t K/(1+K)` without a difference.
pub fn kernel(q: f64, past: f64) -> (f64, f64) {
    let height = (past * (past + 2.0 * q)).sqrt();
    let angle = height.atan2(q);
    let t = height / q;
    if t > 2.0 {
        return (height - q * angle, angle);
    }
    let w = t * t;
    let fraction = (2..60).rev().fold(0.0, |below, n| f64::from(n * n) * w / (f64::from(2 * n + 1) + below));
    let k = w / (3.0 + fraction);
    (height * k / (1.0 + k), angle)
}

/// Where pieces end because the kernel changes: q and multiples of it.
fn scales(q: f64) -> Vec<Dd> {
    (1..20).map(|k| Dd::from(q * 8f64.powi(k))).collect()
}

/// Step of the rule.
const H: f64 = 1.0 / 9.0;

/// (distance from the nearer end as a share of the piece, weight), right half; the first node is the middle.
fn rule() -> &'static [(f64, f64)] {
    static RULE: OnceLock<Vec<(f64, f64)>> = OnceLock::new();
    RULE.get_or_init(|| {
        (0..)
            .map(|k| {
                let t = H * f64::from(k);
                let q = (-std::f64::consts::PI * t.sinh()).exp();
                (q / (1.0 + q), H * std::f64::consts::PI * t.cosh() * q / ((1.0 + q) * (1.0 + q)))
            })
            .take_while(|&(_, weight)| weight > 1e-19)
            .collect()
    })
}

/// The tanh-sinh rule on one piece; in ln r where the ends are some way apart. (Where they are farther apart still,
/// from is next to 0, and the rule's nodes crowd there anyway.)
fn tanh_sinh(from: Dd, to: Dd, integrand: &dyn Fn(Dd) -> f64) -> f64 {
    let logarithmic = to.hi > 4.0 * from.hi && to.hi < 1e3 * from.hi;
    let width = to - from;
    let span = if logarithmic { (to.hi / from.hi).ln() } else { 0.0 };
    let mut sum = 0.0;
    for (k, &(share, weight)) in rule().iter().enumerate() {
        let both = if logarithmic {
            [from.hi * (share * span).exp(), to.hi * (-share * span).exp()].map(|r| integrand(Dd::from(r)) * r * span)
        } else {
            let step = width * Dd::from(share);
            [from + step, to - step].map(|r| integrand(r) * width.hi)
        };
        sum += weight * if k == 0 { both[0] } else { both[0] + both[1] };
    }
    sum
}

/// `∫₀^b f` for a smooth f.
pub fn integrate(b: f64, f: impl Fn(f64) -> f64) -> f64 {
    tanh_sinh(Dd::from(0.0), Dd::from(b), &|t: Dd| f(t.hi))
}

//! The profile of the skewed generalized t-distribution, with A, cdf and their inverses in closed form.
//!
//! Source: Ribardière et al. 2019, Eq. 1–6, in the parametrisation of [`Shape`].
//!
//! ```
//! use sgtd_core::family::{shape::Shape, skewed_t::SkewedT};
//! use sgtd_core::profile::Profile;
//!
//! let profile = SkewedT::new(Shape::new(2.5, 1.5, 0.4, 0.7)?);
//! let median = profile.quantile(0.5);
//! assert!((profile.cdf(median) - 0.5).abs() < 1e-12 && (profile.sf(median) - 0.5).abs() < 1e-12);
//! # Ok::<(), sgtd_core::error::ParameterError>(())
//! ```

use crate::family::partial_moment::{Radius, Side, Width};
use crate::family::shape::Shape;
use crate::family::student::StudentMasking;
use crate::numerics::invert::{self, Monotone};
use crate::numerics::quadrature::gauss;
use crate::profile::derivatives::Derivatives;
use crate::profile::{Masking, Profile, Tail};

/// The SGTD profile at unit roughness.
#[derive(Debug, Clone)]
pub struct SkewedT {
    shape: Shape,
    side: Side,
    outer_width: Width,
    inner_width: Width,
    /// 1/(1−λ), 1/(1+λ)
    inverse_widths: [f64; 2],
    normalization: f64,
    /// Parts of `∫ x f dx` right and left of m.
    outer: f64,
    inner: f64,
    mean: f64,
    cusps: Vec<f64>,
    tail: Tail,
    closed_masking: Option<StudentMasking>,
}

/// Log-depth between break points.
const STEP: f64 = 6.0;

/// Break points go on this far into the part of a power tail that is exact.
const POWER_SPAN: f64 = 8.0;
/// Where a profile ends at the latest, so that its third moment stays finite.
const X_MAX: f64 = 1e100;

impl SkewedT {
    /// Builds the profile; all constants are closed forms.
    pub fn new(shape: Shape) -> Self {
        let side = Side::new(shape.gamma(), shape.p());
        let (m, wide, narrow) = (shape.shift(), 1.0 + shape.lambda(), 1.0 - shape.lambda());
        let outer = wide * (m * side.total(1) + wide * side.total(2));
        let rim = Radius::of(0.0, 0.0, m, Width::new(-shape.lambda()));
        let [j1, j2, j3] = [1, 2, 3].map(|k| side.lower(k, rim));
        let inner = narrow * (m * j1 - narrow * j2);
        let normalization = 0.5 / (outer + inner);
        // (m ± c r)² f, integrated on both sides
        let second = wide * (m * (m * side.total(1) + 2.0 * wide * side.total(2)) + wide * wide * side.total(3))
            + narrow * (m * (m * j1 - 2.0 * narrow * j2) + narrow * narrow * j3);
        let two_p = 2.0 * shape.p();
        // A cusp is where |x−m|^(2p) is not analytic, or where the two widths meet.
        let smooth = shape.lambda() == 0.0 && shape.p().fract() == 0.0;
        let cusps = if m > 0.0 && !smooth { vec![m] } else { Vec::new() };
        let tail = if shape.gamma().is_finite() {
            let exponent = two_p * shape.gamma();
            // f = c x^(−e) (1 + O(γ² r^(−2p)) + O(e m/x)): both corrections below 1e-17
            let by_power = (1e17 * shape.gamma() * shape.gamma()).powf(1.0 / two_p);
            let by_shift = 1e17 * exponent * (m + 1e-300);
            Tail::Power { excess: two_p.mul_add(shape.gamma(), -3.0), exact_from: wide * by_power.max(by_shift) }
        } else {
            Tail::Exponential
        };
        Self {
            shape,
            side,
            outer_width: Width::new(shape.lambda()),
            inner_width: Width::new(-shape.lambda()),
            inverse_widths: [1.0 / narrow, 1.0 / wide],
            normalization,
            outer,
            inner,
            mean: 2.0 * normalization * second,
            cusps,
            tail,
            closed_masking: StudentMasking::new(&shape),
        }
    }

    /// The parameters.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    fn radius(&self, x: f64) -> Radius {
        let m = self.shape.shift();
        Radius::of(x, 0.0, m, if x > m { self.outer_width } else { self.inner_width })
    }

    /// `∫_x^∞ t f dt` for x ≥ m.
    fn outer_above(&self, x: f64) -> f64 {
        let (m, wide, r) = (self.shape.shift(), 1.0 + self.shape.lambda(), self.radius(x));
        wide * (if m > 0.0 { m * self.side.upper(1, r) } else { 0.0 } + wide * self.side.upper(2, r))
    }

    /// `∫_m^x t f dt` for x ≥ m.
    fn outer_below(&self, x: f64) -> f64 {
        let (m, wide, r) = (self.shape.shift(), 1.0 + self.shape.lambda(), self.radius(x));
        wide * (if m > 0.0 { m * self.side.lower(1, r) } else { 0.0 } + wide * self.side.lower(2, r))
    }

    /// `∫_x^m t f dt` for x ≤ m: both terms come from the lower functions, whose ratio keeps them apart.
    fn inner_above(&self, x: f64) -> f64 {
        let (m, narrow, r) = (self.shape.shift(), 1.0 - self.shape.lambda(), self.radius(x));
        narrow * (m * self.side.lower(1, r) - narrow * self.side.lower(2, r))
    }

    /// `∫₀^x t f dt` for x ≤ m.
    fn inner_below(&self, x: f64) -> f64 {
        let m = self.shape.shift();
        // The whole less what lies above x: cancels for small x.
        let difference = self.inner - self.inner_above(x);
        if difference > CANCELS * self.inner {
            return difference;
        }
        // T(r) = m J₁ᶜ(r) − c J₂ᶜ(r), the integral from −∞ on: cancels where much of it lies below 0.
        let narrow = 1.0 - self.shape.lambda();
        let terms = |r: Radius| (m * self.side.upper(1, r), narrow * self.side.upper(2, r));
        let ((first, second), (first_at_zero, second_at_zero)) = (terms(self.radius(x)), terms(self.radius(0.0)));
        let difference = (first - second) - (first_at_zero - second_at_zero);
        if difference > KEPT * (first + second + first_at_zero + second_at_zero) {
            return narrow * difference;
        }
        self.inner_by_quadrature(x)
    }

    /// `∫₀^x t f dt` for x in the lower part of the inner side, whose rise towards m is followed down panel by panel.
    fn inner_by_quadrature(&self, x: f64) -> f64 {
        let (m, narrow) = (self.shape.shift(), 1.0 - self.shape.lambda());
        let top = self.side.depth(self.radius(x).hi);
        let edges = depths()
            .skip_while(|&depth| depth <= top)
            .take_while(|&depth| depth < top + SPENT)
            .map(|depth| m - narrow * self.side.radius_at_depth(depth))
            .take_while(|&edge| edge > 0.0);
        let (mut sum, mut right) = (0.0, x);
        for left in edges.filter(|&edge| edge < x).chain([0.0]) {
            sum += gauss(24).integrate(left, right, |t| t * self.f(t));
            right = left;
        }
        sum
    }
}

/// Below this ratio of difference to terms another form is better: at 0.25 a difference loses two bits.
const CANCELS: f64 = 0.25;
/// What a difference of four terms must keep of them: at γ = ∞, p = 50, m = 1, x = 0.01 it keeps 1/150, which costs 1.5e-11.
const KEPT: f64 = 0.1;
/// What lies so many powers of e below the end of an integral does not count.
const SPENT: f64 = 45.0;

impl Profile for SkewedT {
    fn f(&self, x: f64) -> f64 {
        self.side.kernel(self.radius(x))
    }

    fn f_past(&self, from: f64, past: f64) -> f64 {
        let m = self.shape.shift();
        // the sum may round to m from either side
        let width = if (from - m) + past > 0.0 { self.outer_width } else { self.inner_width };
        self.side.kernel(Radius::of(from, past, m, width))
    }

    #[inline]
    fn f_fast(&self, x: f64) -> f64 {
        let d = x - self.shape.shift();
        let (inner, outer) = (-d * self.inverse_widths[0], d * self.inverse_widths[1]);
        // which side x is on cannot be predicted, but the other one is negative
        self.side.kernel_fast(if outer > inner { outer } else { inner })
    }

    fn normalization(&self) -> f64 {
        self.normalization
    }

    fn cdf(&self, x: f64) -> f64 {
        if x <= 0.0 {
            return 0.0;
        }
        let below = if x <= self.shape.shift() { self.inner_below(x) } else { self.inner + self.outer_below(x) };
        (2.0 * self.normalization * below).min(1.0)
    }

    fn sf(&self, x: f64) -> f64 {
        if x <= 0.0 {
            return 1.0;
        }
        let above = if x < self.shape.shift() { self.inner_above(x) + self.outer } else { self.outer_above(x) };
        (2.0 * self.normalization * above).min(1.0)
    }

    fn quantile(&self, u: f64) -> f64 {
        if u > 0.5 {
            return self.isf(1.0 - u);
        }
        let density = |x: f64| 2.0 * self.normalization * x * self.f(x);
        invert::solve(&Monotone { value: &|x| self.cdf(x), rising: true, slope: &density }, u, self.start())
    }

    fn isf(&self, u: f64) -> f64 {
        if u > 0.5 {
            return self.quantile(1.0 - u);
        }
        let density = |x: f64| -2.0 * self.normalization * x * self.f(x);
        invert::solve(&Monotone { value: &|x| self.sf(x), rising: false, slope: &density }, u, self.start())
    }

    fn mean(&self) -> f64 {
        self.mean
    }

    fn breaks(&self, depth: f64) -> Vec<f64> {
        let m = self.shape.shift();
        let (narrow, wide) = (1.0 - self.shape.lambda(), 1.0 + self.shape.lambda());
        let mut points: Vec<f64> = depths()
            .take_while(|&d| d < depth + STEP)
            .map(|d| m - narrow * self.side.radius_at_depth(d))
            .take_while(|&x| x > 0.0)
            .collect();
        points.reverse();
        if m > 0.0 {
            points.push(m);
        }
        let exact_from = match self.tail {
            Tail::Power { exact_from, .. } => exact_from,
            Tail::Exponential => f64::INFINITY,
        };
        let reference = m + wide * self.side.radius_at_depth(1.0);
        for level in depths() {
            let x = m + wide * self.side.radius_at_depth(level);
            if points.last().is_some_and(|&last| x <= last) {
                continue;
            }
            if x > X_MAX {
                break;
            }
            points.push(x);
            if x >= POWER_SPAN * exact_from || level - 3.0 * (x / reference).max(1.0).ln() > depth {
                break;
            }
        }
        points.dedup();
        points
    }

    fn cusps(&self) -> &[f64] {
        &self.cusps
    }

    fn tail(&self) -> Tail {
        self.tail
    }

    fn derivatives(&self) -> Option<&dyn Derivatives> {
        Some(self)
    }

    fn masking(&self, q: f64) -> Option<Masking> {
        self.closed_masking.as_ref()?.at(q)
    }
}

impl SkewedT {
    /// A point well inside the distribution, where the search for a quantile begins.
    fn start(&self) -> f64 {
        self.shape.shift() + self.side.radius_at_depth(0.5)
    }
}

/// Depths at which panels end: finer near the peak, where a box bends and a cusp begins.
fn depths() -> impl Iterator<Item = f64> {
    const NEAR: [f64; 9] = [1e-14, 1e-9, 1e-5, 1e-2, 0.2, 1.0, 3.0, 7.0, 12.0];
    NEAR.into_iter().chain((1..4000).map(|k| 12.0 + STEP * f64::from(k)))
}

//! The azimuth of a visible slope, given its radius: a Kepler equation.
//!
//! At stretched slope ρ the azimuth φ towards the view (cosine c, sine s) has density ∝ max(0, c + b cos φ), b = ρ s, on
//! [0, φ₁] and its mirror image; φ₁ = π, or acos(−c/b) where b > c. Counted from the far end, ψ = φ₁ − φ, its integral
//! is a sum of positive terms that cancels nowhere: in units of c + b,
//!
//! `h(ψ) = d ψ + a (ψ − sin ψ) + e (1 − cos ψ)`, `d = max(c−b, 0)`, `a = min(b, c)`, `e = √max(b²−c², 0)`.
//!
//! Where only slopes count that reflect the view above the horizon ([`Horizon`]), φ ends at φ₂ = acos κ, which is never beyond φ₁, and h is the
//! same with `d = c + b κ`, `a = −b κ`, `e = b sin φ₂`. Its derivative d at the far end is then never below c/2.

use crate::constants::{AZIMUTH_FITS, AZIMUTH_FLAT_FIT, AZIMUTH_STEEP, AZIMUTH_STEEP_FIT};
use crate::sampling::bounded::Horizon;
use std::f64::consts::PI;

/// A stretched view and a slope radius.
#[derive(Debug, Clone, Copy)]
pub struct Azimuth {
    d: f64,
    a: f64,
    e: f64,
    /// c in units of c + b
    c: f64,
    /// φ₁ or φ₂, its sine and cosine
    limit: f64,
    sin_limit: f64,
    cos_limit: f64,
    /// h there
    half: f64,
    /// c + b
    sum: f64,
    bounded: bool,
}

impl Azimuth {
    /// For cosine c ≥ 0 and sine s of the stretched view, both times any positive number, and slope ρ.
    pub fn new(cos: f64, sin: f64, rho: f64) -> Self {
        let b = rho * sin;
        let sum = cos + b;
        let unit = if sum >= f64::MIN_POSITIVE { 1.0 / sum } else { 0.0 };
        let (d, a) = ((cos - b).max(0.0) * unit, cos.min(b) * unit);
        let e = ((b - cos).max(0.0) * unit).sqrt();
        // tan of half the angle that is cut off
        let limit = PI - 2.0 * e.atan();
        let c = cos * unit;
        // half of what φ₁ lacks of π has the tangent e
        let inverse = 1.0 / e.mul_add(e, 1.0);
        let (sin_limit, cos_limit) = (2.0 * e * inverse, -(2.0 * c).min(1.0) * inverse);
        Self { d, a, e, c, limit, sin_limit, cos_limit, half: c * limit + e, sum, bounded: false }
    }

    /// The azimuths that reflect the view above the horizon, for one roughness; the mass is 0 where there are none.
    pub fn bounded(cos: f64, sin: f64, rho: f64, horizon: &Horizon) -> Self {
        let b = rho * sin;
        let sum = cos + b;
        let unit = if sum >= f64::MIN_POSITIVE { 1.0 / sum } else { 0.0 };
        let c = cos * unit;
        let (less, more) = horizon.complements(rho);
        let limited = more > 0.0;
        // 1 ∓ κ in units of 2, the smaller of both exactly
        let inverse = 1.0 / (less + more).max(f64::MIN_POSITIVE);
        let (less, more) = if limited { (less.max(0.0) * inverse, more * inverse) } else { (1.0, 0.0) };
        let cos_limit = more - less;
        let small = less.min(more);
        let angle = 2.0 * small.sqrt() * arc_sine(small);
        let limit = if cos_limit < 0.0 { PI - angle } else { angle };
        let sin_limit = 2.0 * (less * more).sqrt();
        let d = if limited { 0.5 * c * horizon.rise(rho) } else { (cos - b) * unit };
        let e = b * unit * sin_limit;
        Self { d, a: c - d, e, c, limit, sin_limit, cos_limit, half: c.mul_add(limit, e), sum, bounded: true }
    }

    /// `∫ max(0, c + b cos φ) dφ` over the azimuths that are drawn.
    pub fn mass(&self) -> f64 {
        2.0 * self.half * self.sum
    }

    /// Draws φ from u in [0, 1].
    pub fn sample(&self, u: f64) -> Drawn {
        let share = 1.0 - (2.0 * u - 1.0).abs();
        let at =
            self.solve(share * self.half, if self.bounded { self.start_bounded(share) } else { self.start(share) });
        // φ = φ₁ − ψ
        let cosine = 1.0 - at.versine;
        let sin = self.sin_limit * cosine - self.cos_limit * at.sine;
        let cos = self.cos_limit * cosine + self.sin_limit * at.sine;
        Drawn {
            sin: if u < 0.5 { -sin } else { sin },
            cos,
            share: 0.5 * at.slope / self.half,
            inverse_share: 2.0 * self.half / at.slope,
        }
    }

    /// ψ with `h(ψ) = target`, to 3e-8 of ψ.
    fn solve(&self, target: f64, start: f64) -> Terms {
        let (sin, cos) = sin_cos(0.5 * start);
        let at = self.assemble(start, 2.0 * sin * cos, 2.0 * sin * sin);
        self.moved(&at, self.step(&at, target))
    }

    /// ψ with `h(ψ) = share · h(φ₁)` to 1.7 %.
    ///
    /// The limits d ψ, e ψ²/2 and a ψ³/6 of h, added as cubes, are off by up to 18 %. What is missing depends on the share v that the first
    /// two have (one of d and e is 0), and towards ψ = π on ψ²: minimax fits over both.
    fn start(&self, share: f64) -> f64 {
        // half to 1e-3 does for the start, which need not wait for the library's arc tangent
        let e2 = self.e * self.e;
        let rough = self.e * e2.mul_add(e2.mul_add(0.079331, -0.288679), 0.995354);
        let target = share * (self.c * 2.0f64.mul_add(-rough, PI) + self.e);
        let root = (0.5 * self.e * target).sqrt();
        let cube =
            (self.d * self.d).mul_add(self.d, (root * root).mul_add(root, self.a * target * target * (1.0 / 6.0)));
        let inverse_root = rough_inverse_cbrt(cube.max(f64::MIN_POSITIVE));
        let (v, psi) = ((self.d + root) * inverse_root, target * inverse_root);
        // a table, because which of the two it is cannot be predicted
        let [c0, c1, c2, c3, c4, c5] = AZIMUTH_FITS[usize::from(self.e > 0.0)];
        let by_share = (v * (1.0 - v)).mul_add(v.mul_add(v.mul_add(c2, c1), c0), 1.0);
        let by_angle = (psi * psi).mul_add(v.mul_add(v.mul_add(c5, c4), c3), 1.0);
        psi * by_share * by_angle
    }

    /// ψ with `h(ψ) = share · h(φ₂)` to 3 %.
    ///
    /// h is known with its slopes at both ends, 0 and φ₂. Over `g = ψ/√(1 + q ψ²)` it is close to the monotone rational-quadratic function with
    /// these values and slopes (Gregory & Delbourgo 1982), which has a closed-form inverse; q is fitted to the share b of c + b.
    fn start_bounded(&self, share: f64) -> f64 {
        let c = self.c;
        let q = if c > AZIMUTH_STEEP {
            let [q0, q1, q2] = AZIMUTH_STEEP_FIT;
            (1.0 - c).mul_add((1.0 - c).mul_add(q2, q1), q0)
        } else {
            let [q0, q1] = AZIMUTH_FLAT_FIT;
            c.mul_add(q1, q0)
        };
        let spread = (q * self.limit).mul_add(self.limit, 1.0);
        let root = spread.sqrt();
        let end = self.limit / root;
        let unit = end / self.half.max(f64::MIN_POSITIVE);
        let (d0, d1) = (self.d * unit, unit * spread * root);
        let k = d0 + d1 - 2.0;
        let b = d0 - share * k;
        let below = b + (b * b + 4.0 * (1.0 - b) * share).max(0.0).sqrt();
        let g = end * if below > 0.0 { (2.0 * share / below).min(1.0) } else { 0.0 };
        g / (1.0 - q * g * g).sqrt()
    }

    /// The step towards `h(ψ) = target` of Householder's method with three derivatives: it leaves a third of the fourth power
    /// of the error.
    fn step(&self, at: &Terms, target: f64) -> f64 {
        let (miss, slope) = (at.value - target, at.slope);
        let curvature = self.e.mul_add(1.0 - at.versine, self.a * at.sine);
        let third = self.a.mul_add(1.0 - at.versine, -self.e * at.sine);
        let bend = miss * curvature;
        let square = slope * slope;
        let divisor = slope * (square - bend) + miss * miss * third * (1.0 / 6.0);
        if divisor > 0.0 { -miss * (square - 0.5 * bend) / divisor } else { 0.0 }
    }

    /// The terms a small step away, by the Taylor series of the rotation: 1e-14 for steps below 0.06.
    fn moved(&self, at: &Terms, step: f64) -> Terms {
        let psi = (at.psi + step).max(0.0).min(self.limit);
        let delta = psi - at.psi;
        let square = delta * delta;
        let versine = square * square.mul_add(square.mul_add(1.0 / 720.0, -1.0 / 24.0), 0.5);
        let sine = delta * square.mul_add(square.mul_add(square.mul_add(-1.0 / 5040.0, 1.0 / 120.0), -1.0 / 6.0), 1.0);
        let cosine = 1.0 - at.versine;
        self.assemble(
            psi,
            at.sine + cosine.mul_add(sine, -at.sine * versine),
            at.versine + at.sine.mul_add(sine, cosine * versine),
        )
    }

    fn assemble(&self, psi: f64, sine: f64, versine: f64) -> Terms {
        let square = psi * psi;
        // ψ − sin ψ by its series where it has lost four digits and more
        let lag =
            if psi < 0.05 { psi * square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)) } else { psi - sine };
        Terms {
            psi,
            sine,
            versine,
            value: self.d.mul_add(psi, self.a.mul_add(lag, self.e * versine)),
            slope: self.a.mul_add(versine, self.e.mul_add(sine, self.d)),
        }
    }
}

/// Sine and cosine on [0, 1.6] by Taylor's series: the library does not know the range and guesses a branch for it.
fn sin_cos(x: f64) -> (f64, f64) {
    const fn series<const N: usize>(first: u32) -> [f64; N] {
        let mut terms = [1.0; N];
        let mut k = 1;
        while k < N {
            let n = (2 * k as u32 + first - 1) as f64;
            terms[k] = -terms[k - 1] / (n * (n + 1.0));
            k += 1;
        }
        terms
    }
    const SIN: [f64; 12] = series(1);
    const COS: [f64; 12] = series(0);
    let x2 = x * x;
    let (x4, x8) = (x2 * x2, x2 * x2 * x2 * x2);
    let sum = |c: &[f64; 12]| {
        let four = |k: usize| x4.mul_add(x2.mul_add(c[k + 3], c[k + 2]), x2.mul_add(c[k + 1], c[k]));
        x8.mul_add(x8.mul_add(four(8), four(4)), four(0))
    };
    (x * sum(&SIN), sum(&COS))
}

/// `asin(√z)/√z` on [0, ½] to 4e-10: a fit in Chebyshev's points.
fn arc_sine(z: f64) -> f64 {
    const C: [f64; 10] = [
        0.999999999721,
        0.166666775338,
        0.074993057238,
        0.0448136838512,
        0.0282684617102,
        0.0371769537863,
        -0.0443963859907,
        0.167486025402,
        -0.202711588927,
        0.146362583451,
    ];
    C.iter().rev().fold(0.0, |sum, &c| z.mul_add(sum, c))
}

/// Inverse cube root of a normal positive number to 0.3 %: minus a third of its bits, and one step of Newton.
fn rough_inverse_cbrt(x: f64) -> f64 {
    // four thirds of the exponent's bias, less what makes the error symmetric
    const OFFSET: u64 = 0x553E_F0FF_289D_D796;
    let y = f64::from_bits(OFFSET - x.to_bits() / 3);
    y * (4.0 / 3.0 - (1.0 / 3.0) * (x * y) * (y * y))
}

/// An azimuth that was drawn.
#[derive(Debug, Clone, Copy)]
pub struct Drawn {
    /// sin φ
    pub sin: f64,
    /// cos φ
    pub cos: f64,
    /// Density of φ on the circle.
    pub share: f64,
    /// Its inverse, which is there at the same time.
    pub inverse_share: f64,
}

/// h and its derivative at ψ, with 1 − cos ψ for accuracy near 0.
#[derive(Debug, Clone, Copy)]
struct Terms {
    psi: f64,
    sine: f64,
    versine: f64,
    value: f64,
    slope: f64,
}

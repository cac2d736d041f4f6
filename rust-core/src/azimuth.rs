//! The azimuth of a visible slope, given its radius: a Kepler equation.
//!
//! At stretched slope ρ the azimuth φ towards the view (cosine c, sine s) has density ∝ max(0, c + b cos φ), b = ρ s, on
//! [0, φ₁] and its mirror image; φ₁ = π, or acos(−c/b) where b > c. Counted from the far end, ψ = φ₁ − φ, its integral
//! is a sum of positive terms that cancels nowhere: in units of c + b,
//!
//! `h(ψ) = d ψ + a (ψ − sin ψ) + e (1 − cos ψ)`, `d = max(c−b, 0)`, `a = min(b, c)`, `e = √max(b²−c², 0)`.

use std::f64::consts::PI;

/// A stretched view and a slope radius.
#[derive(Debug, Clone, Copy)]
pub struct Azimuth {
    d: f64,
    a: f64,
    e: f64,
    /// b in units of c + b
    b: f64,
    /// φ₁
    limit: f64,
    /// h(φ₁)
    half: f64,
    /// c + b
    sum: f64,
}

impl Azimuth {
    /// For cosine c ≥ 0 and sine s of the stretched view, both times any positive number, and slope ρ.
    pub fn new(cos: f64, sin: f64, rho: f64) -> Self {
        let b = rho * sin;
        let sum = cos + b;
        let unit = if sum >= f64::MIN_POSITIVE { 1.0 / sum } else { 0.0 };
        let (d, a) = ((cos - b).max(0.0) * unit, cos.min(b) * unit);
        let e = ((b - cos).max(0.0) * unit).sqrt();
        let limit = if e > 0.0 { PI - e.atan2(a) } else { PI };
        Self { d, a, e, b: b * unit, limit, half: cos * unit * limit + e, sum }
    }

    /// `∫ max(0, c + b cos φ) dφ` over the circle.
    pub fn mass(&self) -> f64 {
        2.0 * self.half * self.sum
    }

    /// Draws φ from u in [0, 1].
    pub fn sample(&self, u: f64) -> Drawn {
        let at = self.solve(1.0 - (2.0 * u - 1.0).abs());
        // φ = φ₁ − ψ, where cos φ₁ = −c/b and sin φ₁ = √(b²−c²)/b, or −1 and 0
        let (sin_limit, cos_limit) = if self.e > 0.0 {
            let inverse = 1.0 / self.b;
            (self.e * inverse, -self.a * inverse)
        } else {
            (0.0, -1.0)
        };
        let cosine = 1.0 - at.versine;
        let sin = sin_limit * cosine - cos_limit * at.sine;
        let cos = cos_limit * cosine + sin_limit * at.sine;
        Drawn { sin: if u < 0.5 { -sin } else { sin }, cos, share: 0.5 * at.slope / self.half }
    }

    /// ψ with `h(ψ) = share · h(φ₁)`.
    ///
    /// The start combines the three limits d ψ, e ψ²/2 and a ψ³/6 of h into one cube and is off by 18 % at most; two
    /// steps of Halley's method leave 4e-3 and 2e-7 of ψ there, and far less elsewhere (test `solvers_stay_within_their_permitted_error`).
    fn solve(&self, share: f64) -> Terms {
        let target = share * self.half;
        let root = 0.5 * self.e * target;
        let cube = self.d * self.d * self.d + root * root.sqrt() + self.a * target * target * (1.0 / 6.0);
        let start = if cube > 0.0 { (target / rough_cbrt(cube)).min(self.limit) } else { 0.0 };
        let first = self.rough_terms(start);
        let second = self.terms(self.improve(&first, target));
        self.moved(&second, self.improve(&second, target))
    }

    /// One step of Halley's method.
    fn improve(&self, at: &Terms, target: f64) -> f64 {
        let miss = at.value - target;
        let curvature = self.a * at.sine + self.e * (1.0 - at.versine);
        let bend = at.slope * at.slope - 0.5 * miss * curvature;
        if bend > 0.0 { (at.psi - miss * at.slope / bend).max(0.0).min(self.limit) } else { at.psi }
    }

    fn terms(&self, psi: f64) -> Terms {
        let (sin, cos) = (0.5 * psi).sin_cos();
        self.assemble(psi, 2.0 * sin * cos, 2.0 * sin * sin)
    }

    /// The terms to 2e-4, which is less than a step of Halley's method leaves at the start.
    fn rough_terms(&self, psi: f64) -> Terms {
        let x = 0.5 * psi;
        let square = x * x;
        let sin = x * (1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0))));
        let cos = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0 - square * (1.0 / 40320.0))));
        self.assemble(psi, 2.0 * sin * cos, 2.0 * sin * sin)
    }

    /// The terms a small step away, by the Taylor series of the rotation: 1e-16 for steps below 0.013.
    fn moved(&self, at: &Terms, psi: f64) -> Terms {
        let delta = psi - at.psi;
        let square = delta * delta;
        let versine = 0.5 * square * (1.0 - square * (1.0 / 12.0) * (1.0 - square * (1.0 / 30.0)));
        let sine = delta * (1.0 - square * (1.0 / 6.0) * (1.0 - square * (1.0 / 20.0)));
        let cosine = 1.0 - at.versine;
        self.assemble(
            psi,
            at.sine + (cosine * sine - at.sine * versine),
            at.versine + (at.sine * sine + cosine * versine),
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
            value: self.d * psi + self.a * lag + self.e * versine,
            slope: self.d + self.a * versine + self.e * sine,
        }
    }
}

/// Cube root of a normal positive number to 0.2 %, for starting values: a third of its bits, and one step of Newton.
fn rough_cbrt(x: f64) -> f64 {
    // two thirds of the exponent's bias, less what makes the error symmetric
    const OFFSET: u64 = 0x2A9F_7893_782D_A1CE;
    let y = f64::from_bits(x.to_bits() / 3 + OFFSET);
    y + (x / (y * y) - y) * (1.0 / 3.0)
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

//! Quadrature rules, the inversion of monotone functions, and the azimuth of visible slopes.

use super::{Record, Source};
use crate::cases::Random;
use crate::oracle;
use sgtd_core::numerics::invert::{self, Monotone};
use sgtd_core::numerics::quadrature::gauss;
use sgtd_core::sampling::azimuth::Azimuth;
use std::f64::consts::PI;

/// `∫_a^b x^k dx` for all k that an n-point rule integrates exactly.
pub fn gauss_rule() -> Record {
    let mut record = Record::default();
    let mut random = Random::seeded("gauss");
    let sizes = [(Source::List, 12), (Source::List, 24), (Source::Edge, 1), (Source::Edge, 64)]
        .into_iter()
        .chain((2..64).step_by(5).map(|n| (Source::Spaced, n)))
        .chain((0..8).map(|_| (Source::Random, 1 + random.below(64) as usize)))
        .collect::<Vec<_>>();
    for (source, n) in sizes {
        for k in 0..2 * n as i32 {
            let (a, b) = (0.0, random.between(0.5, 2.0));
            let want = (f64::from(k + 1) * f64::ln(b)).exp() / f64::from(k + 1);
            let got = gauss(n).integrate(a, b, |x| x.powi(k));
            record.compare(source, got, want, || format!("{n} points, x^{k} on [0, {b}]"));
        }
    }
    record
}

/// Inverses of e^−x, x/(1+x) and 1/(1+x³), which have closed forms; targets down to 1e-300.
pub fn inversion() -> Record {
    let mut record = Record::default();
    let mut random = Random::seeded("invert");
    let mut targets = [0.5, 0.1, 0.01, 1e-8].map(|u| (Source::List, u)).to_vec();
    targets.extend([1e-300, 1e-16, 0.9].map(|u| (Source::Edge, u)));
    targets.extend((1..30).map(|k| (Source::Spaced, 10f64.powi(-10 * k))));
    targets.extend((0..60).map(|_| (Source::Random, random.log_between(1e-290, 0.9))));
    let exponential = Monotone { value: &|x| (-x).exp(), rising: false, slope: &|x| -(-x).exp() };
    let share = Monotone { value: &|x| x / (1.0 + x), rising: true, slope: &|x| 1.0 / ((1.0 + x) * (1.0 + x)) };
    // its slope underflows where its value does not
    let cube = |x: f64| 1.0 / (1.0 + x * x * x);
    let power = Monotone { value: &cube, rising: false, slope: &|x| -3.0 * x * x * cube(x) * cube(x) };
    for (source, u) in targets {
        for start in [1.0, 1e-3, 1e6] {
            let got = invert::solve(&exponential, u, start);
            record.compare(source, got, -u.ln(), || format!("exp(-x) = {u:e} from {start:e}"));
            let got = invert::solve(&share, u, start);
            record.compare(source, got, u / (1.0 - u), || format!("x/(1+x) = {u:e} from {start:e}"));
            let got = invert::solve(&power, u, start);
            record.compare(source, got, ((1.0 - u) / u).cbrt(), || format!("1/(1+x³) = {u:e} from {start:e}"));
        }
    }
    record
}

/// (c, s, ρ): a view's cosine and sine, and a slope; b = ρ s around c, far below and far above it.
fn views() -> Vec<(Source, f64, f64, f64)> {
    let mut random = Random::seeded("azimuth");
    let view = |a: f64| (a / a.hypot(1.0), 1.0 / a.hypot(1.0));
    let mut all = Vec::new();
    for rho in [1e-3, 0.3, 1.0, 3.0, 1e3] {
        all.push((Source::List, 1.0, rho));
    }
    for (a, ratio) in [(1.0, 1.0), (1.0, 1.0 + 1e-15), (1.0, 1.0 - 1e-15), (1e-8, 1e12), (1e8, 1e-12), (1e-12, 1.0)] {
        all.push((Source::Edge, a, a * ratio));
    }
    for k in -20..=20 {
        all.push((Source::Spaced, 0.3, 0.3 * 10f64.powf(0.4 * f64::from(k))));
    }
    for _ in 0..60 {
        let a = random.log_between(1e-6, 1e6);
        all.push((Source::Random, a, a * random.log_between(1e-3, 1e3)));
    }
    all.into_iter().map(|(source, a, rho)| (source, view(a).0, view(a).1, rho)).collect()
}

/// `∫ max(0, c + b cos φ) dφ` over [from, φ₁], by the tanh-sinh rule on a form that cancels nowhere:
/// `c + b cos φ` is `2b sin((φ₁+φ)/2) sin((φ₁−φ)/2)` where b > c, and `(c−b) + 2b cos²(φ/2)` elsewhere.
fn arc(c: f64, b: f64, psi: f64) -> f64 {
    if b > c {
        let half = ((b - c) * (b + c)).sqrt().atan2(c);
        let limit = PI - half;
        oracle::integrate(psi, |t| 2.0 * b * (limit - 0.5 * t).sin() * (0.5 * t).sin())
    } else {
        oracle::integrate(psi, |t| (c - b) + 2.0 * b * (0.5 * t).sin().powi(2))
    }
}

fn limit(c: f64, b: f64) -> f64 {
    if b > c { PI - ((b - c) * (b + c)).sqrt().atan2(c) } else { PI }
}

pub fn azimuth_mass() -> Record {
    let mut record = Record::default();
    for (source, c, s, rho) in views() {
        let want = 2.0 * arc(c, rho * s, limit(c, rho * s));
        record.compare(source, Azimuth::new(c, s, rho).mass(), want, || format!("c = {c:e} s = {s:e} rho = {rho:e}"));
    }
    record
}

/// The share of the mass beyond the azimuth that was drawn, against the number it was drawn from.
pub fn azimuth_sample() -> Record {
    let mut record = Record::default();
    for (source, c, s, rho) in views() {
        let azimuth = Azimuth::new(c, s, rho);
        let b = rho * s;
        for k in 0..=16 {
            let u = 0.5 + 0.5 * f64::from(k) / 16.0;
            let drawn = azimuth.sample(u);
            let psi = limit(c, b) - drawn.sin.atan2(drawn.cos);
            let share = 2.0 * arc(c, b, psi.max(0.0)) / azimuth.mass();
            // of the half circle; absolute, because near ψ = 0 it is the third power of ψ that counts
            record.error(source, (share - (2.0 - 2.0 * u)).abs(), || {
                format!("c = {c:e} s = {s:e} rho = {rho:e} u = {u}")
            });
        }
    }
    record
}

//! Every erratum of `docs/errata.md`: the printed form is off, ours agrees with direct integration.

use glam::DVec3;
use sgtd_core::family::shape::Shape;
use sgtd_core::family::skewed_t::SkewedT;
use sgtd_core::ndf::{Ndf, Roughness};
use sgtd_core::numerics::gamma_ratio::gamma;
use sgtd_core::numerics::quadrature::gauss;
use sgtd_core::profile::Profile;
use std::f64::consts::PI;

fn profile(gamma: f64, p: f64, lambda: f64, shift: f64) -> SkewedT {
    SkewedT::new(Shape::new(gamma, p, lambda, shift).expect("valid"))
}

/// `∫ g` over (a, b) on panels of equal width.
fn integral(a: f64, b: f64, panels: usize, g: impl Fn(f64) -> f64) -> f64 {
    let width = (b - a) / panels as f64;
    (0..panels).map(|k| gauss(16).integrate(a + k as f64 * width, a + (k + 1) as f64 * width, &g)).sum()
}

/// A by direct integration of x f(x), split at the shift; ln x beyond 50.
fn direct_normalization(shift: f64, f: impl Fn(f64) -> f64) -> f64 {
    let near = integral(0.0, shift, 40, |x| x * f(x)) + integral(shift, shift + 50.0, 400, |x| x * f(x));
    let far = integral((shift + 50.0).ln(), 60.0, 400, |w| (2.0 * w).exp() * f(w.exp()));
    0.5 / (near + far)
}

fn assert_close(ours: f64, truth: f64) {
    assert!((ours / truth - 1.0).abs() < 1e-10, "{ours} against {truth}");
}

fn assert_off(printed: f64, truth: f64, at_least: f64) {
    assert!((printed / truth - 1.0).abs() > at_least, "printed {printed} is not off from {truth}");
}

#[test]
fn skewed_t_has_p_one() {
    let one = profile(3.0, 1.0, 0.3, 0.7);
    let two = profile(3.0, 2.0, 0.3, 0.7);
    assert_close(one.normalization(), direct_normalization(0.7, |x| one.f(x)));
    assert_off(one.normalization(), direct_normalization(0.7, |x| two.f(x)), 0.03);
}

#[test]
fn cdf_prefactor_has_no_theta() {
    // GTD at p = 1, γ = 2, μ = 0, σ = 0.5: F = 1 − 1/(1 + x²)
    let (theta, sigma) = (0.4_f64, 0.5);
    let x = theta.tan() / sigma;
    let direct = 2.0 * integral(0.0, x, 40, |t| t / (1.0 + t * t).powi(2));
    assert_close(profile(2.0, 1.0, 0.0, 0.0).cdf(x), direct);
    assert_off(theta * direct, direct, 0.5);
}

#[test]
fn anisotropic_exponent_is_outside() {
    // isotropic σ, where B = 1/σ²: the anisotropic form must reduce to the isotropic one
    let (p, sigma, mu, t) = (1.4_f64, 0.3_f64, 0.1, 0.5_f64);
    let isotropic = ((t - mu) / sigma).powf(2.0 * p);
    let b = 1.0 / (sigma * sigma);
    assert_close(b.powf(p) * (t - mu).powf(2.0 * p), isotropic);
    assert_off((b.powf(p) * (t - mu)).powf(2.0 * p), isotropic, 0.5);
    assert_close(-profile(f64::INFINITY, p, 0.0, mu / sigma).f(t / sigma).ln(), isotropic);
    // Eq. 36 is the case p = 1
    assert_off((b * (t - mu)).powi(2), b * (t - mu).powi(2), 0.5);
}

#[test]
fn skewed_normal_normalization() {
    let (lambda, m) = (0.3_f64, 0.2 / 0.3);
    let ours = profile(f64::INFINITY, 1.0, lambda, m);
    let truth = direct_normalization(m, |x| ours.f(x));
    assert_close(ours.normalization(), truth);
    let (wide, narrow) = (1.0 + lambda, 1.0 - lambda);
    let closed = |exponential: f64| {
        let half = 0.5 * PI.sqrt();
        let erf = statrs::function::erf::erf(m / narrow);
        0.5 / (wide * (m * half + 0.5 * wide) + narrow * (m * half * erf - 0.5 * narrow * (1.0 - exponential)))
    };
    assert_close(closed((-m * m / (narrow * narrow)).exp()), truth);
    assert_off(closed((-m * m / wide).exp()), truth, 0.03);
}

#[test]
fn skewed_normal_quantile() {
    let (lambda, sigma, xi) = (0.4_f64, 0.3_f64, 0.7_f64);
    let x = profile(f64::INFINITY, 1.0, lambda, 0.0).quantile(xi);
    let correct = (1.0 + lambda) * (-(1.0 - xi).ln()).sqrt();
    assert_close(x, correct);
    assert_off(-(1.0 - xi).ln() / (sigma * (1.0 + lambda)).powi(2) / sigma, x, 0.5);
}

#[test]
fn shifted_student_normalization() {
    let (g, m) = (2.6_f64, 0.8_f64);
    let ours = profile(g, 1.0, 0.0, m);
    let truth = direct_normalization(m, |x| ours.f(x));
    assert_close(ours.normalization(), truth);
    let z = m * m / (g - 1.0);
    // ₂F₁(½, γ; 3/2; −z) = ∫₀¹ (1 + z w²)^(−γ) dw
    let hypergeometric = integral(0.0, 1.0, 40, |w| (1.0 + z * w * w).powf(-g));
    let (a, b, c) = (
        (1.0 + z).powf(1.0 - g),
        (g - 1.0).sqrt() * m * PI.sqrt() * gamma(g - 0.5) / gamma(g),
        2.0 * m * m * hypergeometric,
    );
    assert_close(1.0 / (a + b + c), truth);
    assert_off(1.0 / (a - b - c), truth, 0.5);
}

#[test]
fn shifted_beckmann_normalization() {
    let m = 0.2 / 0.3;
    let ours = profile(f64::INFINITY, 1.0, 0.0, m);
    let truth = direct_normalization(m, |x| ours.f(x));
    assert_close(ours.normalization(), truth);
    assert!((truth - 0.385).abs() < 5e-4, "{truth}");
    assert_off(1.0, truth, 1.0);
}

#[test]
fn shifted_ggx_normalization() {
    let m = 0.9_f64;
    let ours = profile(2.0, 1.0, 0.0, m);
    let truth = direct_normalization(m, |x| ours.f(x));
    assert_close(ours.normalization(), truth);
    // 1/(2A) = ½ + (m/2)(π/2 + atan m)
    assert_close(1.0 / (1.0 + m * (0.5 * PI + m.atan())), truth);
}

#[test]
fn shifted_ggx_cdf() {
    let (m, x) = (0.9_f64, 1.7_f64);
    let ours = profile(2.0, 1.0, 0.0, m);
    let a = ours.normalization();
    let truth = 2.0 * a * (integral(0.0, m, 40, |t| t * ours.f(t)) + integral(m, x, 40, |t| t * ours.f(t)));
    assert_close(ours.cdf(x), truth);
    let at = |r: f64| 0.5 * m * (r / (1.0 + r * r) + r.atan()) - 0.5 / (1.0 + r * r);
    assert_close(2.0 * a * (at(x - m) - at(-m)), truth);
    // the wrong sign of the arctangent of the shift
    assert_off(2.0 * a * (at(x - m) - at(-m) - m * m.atan()), truth, 0.3);
}

#[test]
fn anisotropic_form_with_fixed_mu_loses_mass() {
    let (su, sv, mu) = (0.1_f64, 0.5_f64, 0.2_f64);
    // D cos dω in slopes is A f/(π σx σy) dslopes
    let mass = |a: f64, shift: &dyn Fn(f64) -> f64| {
        integral(0.0, 2.0 * PI, 200, |phi| {
            let b = (phi.cos() / su).powi(2) + (phi.sin() / sv).powi(2);
            let m = shift(b);
            let radial = integral(0.0, m, 20, |x| x * (-(x - m) * (x - m)).exp())
                + integral(m, m + 8.0, 20, |x| x * (-(x - m) * (x - m)).exp());
            a / (PI * su * sv) * radial / b
        })
    };
    // the printed form: |tan θ − μ|² B, that is a shift of μ√B in x, with A at σ² = σx σy
    let sigma = (su * sv).sqrt();
    let printed = mass(profile(f64::INFINITY, 1.0, 0.0, mu / sigma).normalization(), &|b| mu * b.sqrt());
    assert!((printed - 0.907).abs() < 5e-4, "{printed}");
    let m = 0.6;
    assert_close(mass(profile(f64::INFINITY, 1.0, 0.0, m).normalization(), &|_| m), 1.0);
    // and through the crate's own D, per solid angle
    let ndf = Ndf::new(Box::new(profile(f64::INFINITY, 1.0, 0.0, m)), 0.0).expect("valid");
    let alpha = Roughness::new(su, sv).expect("valid");
    let total = integral(0.0, 2.0 * PI, 100, |phi| {
        integral(-14.0, 8.0, 60, |w| {
            let theta = w.exp().atan();
            let (sin, cos) = theta.sin_cos();
            // dω = sin θ dθ, dθ = cos²θ d tan θ
            let m = DVec3::new(sin * phi.cos(), sin * phi.sin(), cos);
            ndf.d(alpha, m) * cos * sin * cos * cos * w.exp()
        })
    });
    assert!((total - 1.0).abs() < 1e-7, "{total}");
}

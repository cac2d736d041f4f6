//! Fresnel's equations for metals and for glass, and their average over all directions.

use crate::numerics::quadrature::gauss;

/// Fresnel reflectance of a metal for unpolarized light (Born & Wolf, section 14.2).
pub fn conductor(cosine: f64, eta: f64, k: f64) -> f64 {
    let (c2, s2) = (cosine * cosine, 1.0 - cosine * cosine);
    let t0 = eta * eta - k * k - s2;
    let length = t0.hypot(2.0 * eta * k);
    let a = (0.5 * (length + t0)).max(0.0).sqrt();
    let s = (length + c2 - 2.0 * a * cosine) / (length + c2 + 2.0 * a * cosine);
    let (x, y) = (c2 * length + s2 * s2, 2.0 * a * cosine * s2);
    0.5 * s * (1.0 + (x - y) / (x + y))
}

/// Fresnel reflectance of glass for unpolarized light, and the cosine beyond; `eta` is the index beyond over that before. Total reflection is (1, 0).
pub fn dielectric(cosine: f64, eta: f64) -> (f64, f64) {
    let beyond = 1.0 - (1.0 - cosine * cosine) / (eta * eta);
    if beyond <= 0.0 {
        return (1.0, 0.0);
    }
    let beyond = beyond.sqrt();
    let s = (cosine - eta * beyond) / (cosine + eta * beyond);
    let p = (eta * cosine - beyond) / (eta * cosine + beyond);
    (0.5 * (s * s + p * p), beyond)
}

/// `2 ∫₀¹ F(μ) μ dμ`: the share of diffuse light that smooth glass reflects.
pub fn average_dielectric(eta: f64) -> f64 {
    over_cosines(eta, |cosine| dielectric(cosine, eta).0)
}

/// `2 ∫₀¹ g(μ) μ dμ` of what follows `F(μ)`: `eta` says where total reflection begins, next to which g may be like a square root.
pub(crate) fn over_cosines(eta: f64, mut g: impl FnMut(f64) -> f64) -> f64 {
    let critical = (1.0 - eta * eta).max(0.0).sqrt();
    // distances from the critical cosine are squared: roots become smooth
    let mut piece = |end: f64| {
        let width = end - critical;
        gauss(24).integrate(0.0, 1.0, |t| {
            let cosine = critical + width * t * t;
            2.0 * t * 2.0 * cosine * g(cosine)
        }) * width.abs()
    };
    piece(1.0) + if critical > 0.0 { piece(0.0) } else { 0.0 }
}

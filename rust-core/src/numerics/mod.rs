//! What the mathematics above stands on: powers, gamma functions, quadrature, interpolation, inversion.

pub mod exponent;
pub mod gamma_ratio;
pub(crate) mod hermite;
pub(crate) mod interpolation;
pub mod invert;
pub mod quadrature;

/// The greatest of some errors, 0 if there is none. One that is not a number counts as infinite, where `f64::max` would drop it: a
/// table of NaN must not say that it is exact.
pub fn greatest(errors: impl IntoIterator<Item = f64>) -> f64 {
    errors.into_iter().fold(0.0, |worst, error| {
        if error <= worst {
            worst
        } else if error.is_nan() {
            f64::INFINITY
        } else {
            error
        }
    })
}

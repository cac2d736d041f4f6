//! What the mathematics above stands on: powers, gamma functions, quadrature, interpolation, inversion.

pub mod exponent;
pub mod gamma_ratio;
pub(crate) mod hermite;
pub mod invert;
pub mod quadrature;

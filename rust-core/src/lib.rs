//! core
pub mod azimuth;
pub mod bridge;
pub mod error;
pub mod exponent;
pub mod gamma_ratio;
pub mod invert;
pub mod lambda_table;
pub mod masking;
pub mod ndf;
pub mod partial_moment;
pub mod profile;
pub mod quadrature;
pub mod shape;
pub mod skewed_t;
pub mod visible_table;

//! Smith masking of any radial profile: the kernel, the integral, and a table of it.

pub mod gradient;
pub mod gradient_table;
mod integral;
pub(crate) mod smith_kernel;
pub mod table;

pub use gradient::MaskingGradient;
pub use gradient_table::GradientTable;
pub use integral::{MaskingIntegral, Rule};

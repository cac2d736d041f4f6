//! Smith masking of any radial profile: the kernel, the integral, and a table of it.

pub mod gradient;
pub mod gradient_table;
mod integral;
pub mod numbers_gradient;
pub mod numbers_table;
pub(crate) mod smith_kernel;
pub mod table;
pub mod values_gradient;

pub use gradient::MaskingGradient;
pub use gradient_table::GradientTable;
pub use integral::{MaskingIntegral, Rule};
pub use numbers_gradient::NumbersGradient;
pub use numbers_table::NumbersTable;
pub use values_gradient::ValuesGradient;

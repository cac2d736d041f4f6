//! Smith masking of any radial profile: the kernel, the integral, and a table of it.

mod integral;
pub(crate) mod smith_kernel;
pub mod table;

pub use integral::{MaskingIntegral, Rule};

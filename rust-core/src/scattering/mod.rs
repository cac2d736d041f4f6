//! What becomes of light: its first reflection, the energy that one reflection loses, and walks that follow it further.

#[doc(hidden)]
pub mod albedo;
#[doc(hidden)]
pub mod albedo_table;
pub mod fresnel;
#[doc(hidden)]
pub mod interface;
#[doc(hidden)]
pub mod interface_table;
pub mod random_walk;
#[doc(hidden)]
pub mod reflection;

//! What becomes of light: its first reflection, the energy that one reflection loses, and walks that follow it further.

pub mod albedo;
pub mod albedo_table;
pub mod random_walk;
pub mod reflection;

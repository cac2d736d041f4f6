//! What light does beyond its first facet: the energy that one reflection loses, and walks that follow it.

pub mod albedo;
pub mod albedo_table;
pub mod random_walk;

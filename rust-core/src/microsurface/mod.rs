//! Explicit microgeometry: surfaces made of facets, and light traced on them.
//!
//! A Smith model knows a surface by the distribution of its slopes alone. Here is the surface itself: [`generate`] makes one whose facets have a
//! given distribution, [`trace`] follows rays on it and [`goniometer`] counts where they go, so that what the model adds (independent facets,
//! one bounce) can be judged.

pub mod agreement;
pub mod facet;
pub mod generate;
pub mod goniometer;
mod pyramid;
mod scores;
mod spectral;
pub mod surface;
pub mod trace;
mod transport;

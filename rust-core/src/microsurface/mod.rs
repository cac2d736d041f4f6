//! Explicit microgeometry: surfaces made of facets, and light traced on them.
//!
//! A Smith model knows a surface by the distribution of its slopes alone. Here is the surface itself: [`generate`] makes one whose facets have a
//! given distribution, [`trace`] follows rays on it and [`goniometer`] counts where they go, so that what the model adds (independent facets,
//! one bounce) can be judged.
//!
//! ```
//! use sgtd_core::family::{shape::Shape, skewed_t::SkewedT};
//! use sgtd_core::microsurface::generate::{Settings, generate};
//!
//! let profile = SkewedT::new(Shape::new(2.0, 1.0, 0.0, 0.0)?);
//! let settings = Settings { size: 64, correlation: 4.0, tolerance: 0.02, ..Settings::default() };
//! let made = generate(&profile, &settings, |_step, _distance| true)?;
//! assert!(made.agreement.ks <= 0.02);
//! # Ok::<(), sgtd_core::error::ParameterError>(())
//! ```

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

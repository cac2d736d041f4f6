//! The *Skewed Generalized T-Distribution* (SGTD) family of microfacet normal distributions.
//!
//! ```text
//! x  = tan θ_m · √(cos²φ/σx² + sin²φ/σy²)        stretched radial slope (isotropic: tan θ_m / σ)
//! u  = (|x − m| / (1 ± λ))^(2p)                  + where x > m, − where x < m
//! f  = (1 + u/(γ−1))^(−γ)                        exp(−u) at γ = ∞
//! D  = A f(x) / (π σx σy cos⁴θ_m)                1/(2A) = ∫₀^∞ x f(x) dx
//! Λ  = H(a)/a,  a = 1/(tan θ √(σx² cos²φ + σy² sin²φ)),  G1 = 1/(1 + Λ)
//! ```
//!
//! Source: M. Ribardière, B. Bringier, L. Simonot, D. Meneveaux, *Microfacet BSDFs Generated from NDFs and Explicit
//! Microgeometry*, ACM Trans. Graph. 38(5), 2019, with its supplement *Skewed Generalized T-Distribution*. Equations below are
//! those of the supplement; where it errs, `docs/errata.md` says how and which test shows it.
//!
//! # Conventions
//! Directions are unit vectors in the local frame, z along the geometric normal. ω_i points to the viewer, ω_o to the
//! light, m is a microfacet normal. D and every pdf of a normal are densities per solid angle of m; slopes are tangents of polar
//! angles, *stretched* where divided by the roughness; ρ is the length of a stretched slope.
//!
//! # From equation to function
//!
//! | what | equations | function | file |
//! |---|---|---|---|
//! | shape parameters, the ten rows of Table 1 | 1–4, Table 1 | [`family::shape::Shape`], [`family::shape::ROWS`] | `family/shape.rs` |
//! | the tree of special cases | Figure 1 | [`family::tree::Node`] | `family/tree.rs` |
//! | the profile f | 2–4, 13, 24, 28, 31, 35, 40 | [`profile::Profile::f`] by `Side::kernel` | `family/partial_moment.rs` |
//! | normalization A | 5–6, 15, 26–27, 30, 33, 37–38, 42 | [`profile::Profile::normalization`] | `family/skewed_t.rs` |
//! | anisotropic D | 14, 29, 36, 39, 41 | [`ndf::Ndf::d`] | `ndf.rs` |
//! | radial cdf, its complement, their inverses | 7–9, 16–18, 34, 43 | [`profile::Profile::cdf`], `sf`, `quantile`, `isf` | `family/skewed_t.rs` |
//! | masking Λ, G1, G2 | 10–12 | [`ndf::Ndf::lambda`], [`ndf::Ndf::g1`], [`ndf::Ndf::g2`] | `masking/integral.rs`, `masking/table.rs` |
//! | derivatives by the shape | – | [`ndf::Ndf::d_gradient`], [`ndf::Ndf::lambda_gradient`], [`ndf::Ndf::log_normalization_gradient`] | `family/derivatives.rs`, `masking/gradient.rs` |
//! | masking in closed form (p = 1, λ = 0, m = 0) | – | [`profile::Profile::masking`] | `family/student.rs` |
//! | profiles given by points, sums of profiles | – | [`profile::TabulatedProfile`], [`profile::MixtureProfile`] | `profile/tabulated.rs`, `profile/mixture.rs` |
//! | sampling of D·cos | 7–9 | [`ndf::Ndf::sample_projected`] | `sampling/visible_table.rs` |
//! | sampling of visible normals | – | [`ndf::Ndf::sample`] | `sampling/visible_table.rs`, `sampling/azimuth.rs`, `sampling/bounded.rs` |
//! | what one reflection loses, 1 − E | – | `SingleScattering::missing_energy`, `AlbedoTable` | `scattering/albedo.rs`, `scattering/albedo_table/` |
//! | what a rough interface reflects and transmits | – | `SingleScattering::reflectance`, `SingleScattering::transmittance`, `InterfaceTable` | `scattering/interface.rs`, `scattering/interface_table.rs` |
//! | walks on Smith's microsurface | – | [`scattering::random_walk::RandomWalk`] | `scattering/random_walk.rs` |
//! | surfaces made of facets, walks on them | – | [`microsurface::generate::generate`], [`microsurface::trace::Tracer`] | `microsurface/` |
//!
//! # One way through the rooms
//! [`error`] and `numerics` → [`profile`] (the trait) → [`family`] (this family behind it) → `masking` → `sampling` → [`ndf`] → [`scattering`]
//! and `batch` → [`microsurface`] → `bridge`. Nothing from `masking` on knows which profile it serves. Rooms without a link are not for users of
//! the crate: they are reachable for its tests, and may change.

#![cfg_attr(not(test), deny(unused_crate_dependencies))]

#[doc(hidden)]
pub mod batch;
#[doc(hidden)]
pub mod bridge;
#[doc(hidden)]
pub mod constants;
pub mod error;
pub mod family;
#[doc(hidden)]
pub mod masking;
pub mod microsurface;
pub mod ndf;
#[doc(hidden)]
pub mod numerics;
pub mod profile;
pub mod radial;
#[doc(hidden)]
pub mod sampling;
pub mod scattering;

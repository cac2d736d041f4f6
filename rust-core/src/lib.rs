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
//! | what | equations | where |
//! |---|---|---|
//! | shape parameters, the ten rows of Table 1 | 1–4, Table 1 | [`family::shape::Shape`], [`family::shape::ROWS`] |
//! | the tree of special cases | Figure 1 | [`family::tree::Node`] |
//! | the profile f | 2–4, 13, 24, 28, 31, 35, 40 | [`family::partial_moment::Side::kernel`], [`profile::Profile::f`] |
//! | normalization A | 5–6, 15, 26–27, 30, 33, 37–38, 42 | [`profile::Profile::normalization`] |
//! | anisotropic D | 14, 29, 36, 39, 41 | [`ndf::Ndf::d`] |
//! | radial cdf, its complement, their inverses | 7–9, 16–18, 34, 43 | [`profile::Profile::cdf`], `sf`, `quantile`, `isf` |
//! | masking Λ, G1, G2 | 10–12 | [`masking::MaskingIntegral::at`], [`ndf::Ndf::lambda`], [`ndf::Ndf::g2`] |
//! | masking in closed form (p = 1, λ = 0, m = 0) | – | [`family::student::StudentMasking`] |
//! | profiles given by points, sums of profiles | – | [`profile::TabulatedProfile`], [`profile::MixtureProfile`] |
//! | sampling of D·cos | 7–9 | [`ndf::Ndf::sample_projected`] |
//! | missing energy of single scattering | – | [`scattering::albedo::SingleScattering::missing_energy`], [`scattering::albedo_table::AlbedoTable`] |
//! | walks on the microsurface | – | [`scattering::random_walk::RandomWalk`] |
//! | sampling of visible normals | – | [`sampling::visible_table::VisibleTable`], [`sampling::azimuth::Azimuth`], [`ndf::Ndf::sample`], [`sampling::bounded::Horizon`] |
//!
//! # One way through the rooms
//! [`error`] and [`numerics`] → [`profile`] (the trait) → [`family`] (this family behind it) → [`masking`] → [`sampling`] → [`ndf`] → [`scattering`]
//! and [`batch`] → [`bridge`]. Nothing from [`masking`] on knows which profile it serves.

pub mod batch;
pub mod bridge;
pub mod constants;
pub mod error;
pub mod family;
pub mod masking;
pub mod microsurface;
pub mod ndf;
pub mod numerics;
pub mod profile;
pub mod sampling;
pub mod scattering;

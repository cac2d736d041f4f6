//! Light on a Smith microsurface, facet by facet: the reference for everything that approximates multiple scattering.
//!
//! Source: E. Heitz, J. Hanika, E. d'Eon, C. Dachsbacher, *Multiple-Scattering Microfacet BSDFs with the Smith Model*, ACM Trans. Graph.
//! 35(4), 2016. A ray flies at heights h with `P(no hit up to h′) = (C(h)/C(h′))^Λ`, C the cdf of heights (Eq. 9–10, with `Λ(−ω) =
//! −1 − Λ(ω)`), meets a facet that is visible to it, and is reflected; it ends when it leaves upwards. Only `ln C` has to be known, so no
//! distribution of heights is chosen. Single scattering of this model has height-correlated masking.
//!
//! A facet of glass refracts as well. Beyond it, the surface is seen from its other side: turned about the origin it has the same distribution of
//! normals, and 1 − C in place of C. The walk ends when it leaves on either side.
//!
//! Facets are drawn exactly, for any [`Profile`]: from steps above the profile, by rejection. No table of visible normals enters; Λ is that of
//! the distribution's masking table.
//!
//! ```
//! use glam::DVec3;
//! use sgtd_core::family::{shape::Shape, skewed_t::SkewedT};
//! use sgtd_core::ndf::{Ndf, Roughness};
//! use sgtd_core::scattering::random_walk::RandomWalk;
//!
//! let ndf = Ndf::new(Box::new(SkewedT::new(Shape::new(2.0, 1.0, 0.0, 0.0)?)), 1e-5)?;
//! let walk = RandomWalk::new(&ndf, Roughness::new(0.5, 0.5)?);
//! // any generator of numbers in [0, 1)
//! let mut state = 0.0_f64;
//! let mut random = || {
//!     state = (state + 0.618_033_988_749_895).fract();
//!     state
//! };
//! let exit = walk.walk(DVec3::Z, &mut random, |_cosine| ());
//! assert!(exit.is_some_and(|exit| exit.direction.z > 0.0 && exit.bounces >= 1));
//! # Ok::<(), sgtd_core::error::ParameterError>(())
//! ```

use super::fresnel::dielectric;
use crate::ndf::{Ndf, Roughness};
use crate::numerics::greatest;
use crate::profile::{Profile, Tail};
use glam::DVec3;
use std::f64::consts::PI;

/// A walk that left the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exit {
    /// Where it goes: below the horizon if it went through glass.
    pub direction: DVec3,
    /// How many facets it met.
    pub bounces: u32,
}

/// A microsurface to walk on.
pub struct RandomWalk<'a> {
    ndf: &'a Ndf,
    alpha: Roughness,
    /// ρ f and ρ² f
    steps: [Steps; 2],
}

/// Attempts after which a facet is given up. What is drawn from lies close above the profile: so many failures in a row mean that the numbers
/// are not random.
const MOST_ATTEMPTS: u32 = 100_000;
/// Facets after which a walk is given up. Without absorption the chance of that is below 1e-9 for roughness up to 10.
const MOST_FACETS: u32 = 100_000;

impl<'a> RandomWalk<'a> {
    /// A surface with this distribution of normals.
    pub fn new(ndf: &'a Ndf, alpha: Roughness) -> Self {
        Self { ndf, alpha, steps: [1, 2].map(|power| Steps::new(ndf.profile(), power)) }
    }

    /// Follows light that arrives from ω_i, ω_i.z > 0; `facet` is told the cosine at every facet. `None` if it does not leave within
    /// 100 000 facets, or finds none.
    pub fn walk(&self, wi: DVec3, random: &mut impl FnMut() -> f64, mut facet: impl FnMut(f64)) -> Option<Exit> {
        self.follow(wi, random, |cosine, _, _| {
            facet(cosine);
            None
        })
    }

    /// Follows light that arrives at glass from ω_i, which is on either side: each facet reflects or refracts it, as Fresnel's equations choose, and
    /// nothing is absorbed. `eta` is the index below over that above; `facet` is told the cosine at every facet. `None` as in [`Self::walk`].
    pub fn walk_dielectric(
        &self,
        wi: DVec3,
        eta: f64,
        random: &mut impl FnMut() -> f64,
        mut facet: impl FnMut(f64),
    ) -> Option<Exit> {
        self.follow(wi, random, |cosine, above, random| {
            facet(cosine);
            let ratio = if above { eta } else { 1.0 / eta };
            let (reflected, beyond) = dielectric(cosine.min(1.0), ratio);
            (random() >= reflected).then_some((ratio, beyond))
        })
    }

    /// `meet` chooses what a facet does that is met at a cosine, from above or not: reflect, or refract into a medium with an index relative to that
    /// of the ray, at a cosine beyond.
    fn follow<R: FnMut() -> f64>(
        &self,
        wi: DVec3,
        random: &mut R,
        mut meet: impl FnMut(f64, bool, &mut R) -> Option<(f64, f64)>,
    ) -> Option<Exit> {
        let mut above = wi.z >= 0.0;
        // below the surface, all is turned about the origin
        let mut ray = if above { -wi } else { wi };
        // ln C, 0 at the top
        let mut height = 0.0;
        for bounces in 0..MOST_FACETS {
            let depth = -(1.0 - random()).ln();
            if ray.z > 0.0 {
                let lambda = self.ndf.lambda(self.alpha, ray);
                if lambda <= 0.0 || height + depth / lambda >= 0.0 {
                    return Some(Exit { direction: if above { ray } else { -ray }, bounces });
                }
                height += depth / lambda;
            } else {
                height -= depth / (1.0 + self.ndf.lambda(self.alpha, -ray));
            }
            let view = -ray;
            let m = self.visible_normal(view, random)?;
            let cosine = view.dot(m);
            ray = if let Some((eta, beyond)) = meet(cosine, above, random) {
                above = !above;
                // ln(1 − C); not 0, which is the top itself
                height = (-f64::exp_m1(height.min(-f64::MIN_POSITIVE))).ln();
                (view / eta + (beyond - cosine / eta) * m).normalize()
            } else {
                (2.0 * cosine * m - view).normalize()
            };
        }
        None
    }

    /// Draws a normal with density `∝ D(m) ⟨v·m⟩`, for views from above and from below; `None` for a view from which no facet is seen,
    /// and after 100 000 attempts.
    pub fn visible_normal(&self, view: DVec3, random: &mut impl FnMut() -> f64) -> Option<DVec3> {
        let stretched = DVec3::new(self.alpha.u * view.x, self.alpha.v * view.y, view.z).normalize_or(DVec3::Z);
        let sin = stretched.x.hypot(stretched.y);
        let (cos_view, sin_view) = if sin > 0.0 { (stretched.x / sin, stretched.y / sin) } else { (1.0, 0.0) };
        let (rho, sine, cosine) = self.visible_slope(stretched.z, sin, random)?;
        let (x, y) = (cosine * cos_view - sine * sin_view, sine * cos_view + cosine * sin_view);
        // so that slopes of 1e200 do not overflow
        let unit = 1.0 / rho.max(1.0);
        let m = DVec3::new(self.alpha.u * rho * unit * x, self.alpha.v * rho * unit * y, unit);
        Some(m.normalize_or(DVec3::Z))
    }

    /// Radius and azimuth (sine, cosine) of a slope with density `∝ f(ρ) ρ (c + ρ s cos φ)⁺`.
    fn visible_slope(&self, c: f64, s: f64, random: &mut impl FnMut() -> f64) -> Option<(f64, f64, f64)> {
        let [area, flux] = &self.steps;
        if c >= 0.0 {
            let (flat, tilted) = (c * area.total(), s * flux.total());
            for _ in 0..MOST_ATTEMPTS {
                let steps = if random() * (flat + tilted) < flat { area } else { flux };
                let Some(rho) = steps.draw(self.ndf.profile(), 0.0, random) else { continue };
                let (sine, cosine) = (2.0 * PI * random()).sin_cos();
                if random() * (c + rho * s) < c + rho * s * cosine {
                    return Some((rho, sine, cosine));
                }
            }
            return None;
        }
        // only slopes beyond a show their front, within acos(a/ρ) of the view's azimuth
        let a = -c / s;
        if !a.is_finite() || a >= flux.greatest() {
            return None;
        }
        for _ in 0..MOST_ATTEMPTS {
            let Some(rho) = flux.draw(self.ndf.profile(), a, random) else { continue };
            let limit = (a / rho).min(1.0).acos();
            let (sine, cosine) = (limit * (2.0 * random() - 1.0)).sin_cos();
            // (cos φ − a/ρ) over the density of φ, at most π/2
            if random() * 0.5 * PI < (cosine - a / rho) * limit {
                return Some((rho, sine, cosine));
            }
        }
        None
    }
}

/// Steps between which `ρ^k f` is enclosed from above.
struct Steps {
    power: i32,
    edges: Vec<f64>,
    /// upper bound in each step
    bounds: Vec<f64>,
    /// area of all steps before each one; last, that of all
    before: Vec<f64>,
    /// area beyond the last edge, and the exponent with which it falls
    tail: Option<(f64, f64)>,
}

/// Steps between two break points of the profile: f changes by 20 % from one to the next.
const STEPS: usize = 64;
/// Points per step at which the bound is taken, and what a smooth function may rise between them.
const PROBES: usize = 8;
const MARGIN: f64 = 1.02;

impl Steps {
    fn new(profile: &dyn Profile, power: i32) -> Self {
        let breaks = profile.breaks(60.0);
        let mut edges = vec![0.0];
        for &right in &breaks {
            let left = edges[edges.len() - 1];
            for k in 1..=STEPS {
                let t = k as f64 / STEPS as f64;
                let even = left > 0.0 && right > 2.0 * left;
                edges.push(if even { left * (right / left).powf(t) } else { left + t * (right - left) });
            }
        }
        edges.dedup();
        let bounds: Vec<f64> = edges
            .windows(2)
            .map(|ends| {
                let probe = |k: usize| {
                    let past = (ends[1] - ends[0]) * k as f64 / PROBES as f64;
                    (ends[0] + past).powi(power) * profile.f_past(ends[0], past)
                };
                MARGIN * greatest((0..=PROBES).map(probe))
            })
            .collect();
        let mut before = vec![0.0];
        for (ends, bound) in edges.windows(2).zip(&bounds) {
            before.push(before[before.len() - 1] + bound * (ends[1] - ends[0]));
        }
        let last = edges[edges.len() - 1];
        let tail = match profile.tail() {
            Tail::Power { excess, .. } => {
                let exponent = excess + f64::from(2 - power);
                Some((profile.f(last) * last.powi(power + 1) / exponent, exponent))
            }
            Tail::Exponential => None,
        };
        Self { power, edges, bounds, before, tail }
    }

    fn total(&self) -> f64 {
        self.before[self.before.len() - 1] + self.tail.map_or(0.0, |(area, _)| area)
    }

    /// Nothing lies beyond.
    fn greatest(&self) -> f64 {
        if self.tail.is_some() { f64::INFINITY } else { self.edges[self.edges.len() - 1] }
    }

    /// One attempt to draw ρ > a.
    fn draw(&self, profile: &dyn Profile, a: f64, random: &mut impl FnMut() -> f64) -> Option<f64> {
        let last = self.edges.len() - 1;
        let first = (self.edges.partition_point(|&edge| edge <= a) - 1).min(last);
        let target = self.before[first] + random() * (self.total() - self.before[first]);
        let step = self.before.partition_point(|&area| area <= target) - 1;
        if step >= self.bounds.len() {
            let (_, exponent) = self.tail?;
            return Some(self.edges[last].max(a) * (1.0 - random()).powf(-1.0 / exponent))
                .filter(|rho| rho.is_finite());
        }
        let (left, width) = (self.edges[step], self.edges[step + 1] - self.edges[step]);
        let past = width * random();
        let rho = left + past;
        let density = rho.powi(self.power) * profile.f_past(left, past);
        (rho > a && random() * self.bounds[step] < density).then_some(rho)
    }
}

//! The energy that single scattering loses: `1 − E(ω_i)` of a mirror microsurface, by quadrature.
//!
//! `E(ω_i) = ∫ D(m) ⟨ω_i·m⟩ G2(ω_i, ω_o) dm / (cos θ_i (1 + Λ_i))` over the normals whose reflection ω_o leaves upwards,
//! with G2 without its factor for ω_i: the share of light that leaves after one reflection (Heitz et al. 2016, order 1).
//!
//! In slopes s, with t the tangent of the view, ω_o is above the horizon inside the circle `|s − t|² < 1 + |t|²`, which holds
//! the origin. So for every azimuth ψ of the stretched slope the radius runs from 0 to one end that depends smoothly on ψ, and no rule
//! sees the kink at the horizon. What is integrated is the loss, a sum of positive terms: it keeps its digits where E is almost 1.

use crate::ndf::{Ndf, Roughness, Shadowing};
use crate::numerics::hermite;
use crate::numerics::quadrature::gauss;
use crate::profile::{Profile, Tail};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// A view, with the roughness in the frame of its azimuth: slopes are `(along·x, shear·x + across·y)` for stretched slopes (x, y).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Incidence {
    /// `cot θ / along`, the argument of masking; 0 at the horizon, infinite along the normal.
    pub a: f64,
    /// Roughness in the plane of incidence, `√(α_u² cos²φ + α_v² sin²φ)`.
    pub along: f64,
    /// `α_u α_v / along`.
    pub across: f64,
    /// `(α_v² − α_u²) sin φ cos φ / along`; its sign does not matter.
    pub shear: f64,
}

impl Incidence {
    /// The view of a direction, ω.z ≥ 0.
    pub fn new(alpha: Roughness, w: DVec3) -> Self {
        let sin = w.x.hypot(w.y);
        let (x, y) = if sin > 0.0 { (w.x / sin, w.y / sin) } else { (1.0, 0.0) };
        let along = (alpha.u * x).hypot(alpha.v * y);
        Self {
            a: w.z / (sin * along),
            along,
            across: alpha.u * alpha.v / along,
            shear: (alpha.v - alpha.u) * (alpha.v + alpha.u) * x * y / along,
        }
    }
}

/// How fine the quadrature is: Gauss points per quarter of the circle, and per panel of the radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rule {
    azimuthal: usize,
    pub(super) radial: usize,
}

impl Rule {
    /// E within 2e-4 of drawn normals, whose noise that is (test `missing_energy_agrees_with_brute_force`).
    pub const REFERENCE: Self = Self { azimuthal: 48, radial: 16 };
    /// For isotropic tables: E within 1e-4 of the reference for smooth profiles.
    pub const TABLE: Self = Self { azimuthal: 12, radial: 6 };
    /// For shapes with corners, boxes and rings: they make kinks in what depends on the azimuth.
    pub const FINE: Self = Self { azimuthal: 24, radial: 10 };
    /// E within 3e-4 where the two roughnesses differ: their ratio narrows what depends on the azimuth.
    pub const ANISOTROPIC: Self = Self { azimuthal: 20, radial: 6 };
    /// For such shapes with corners: E within 3e-4.
    pub const PAIR: Self = Self { azimuthal: 40, radial: 8 };
}

/// Panels wider than this ratio are divided: masking of ω_o changes over a factor of about that in slope.
const RATIO: f64 = 4.0;
/// Panels below the first one with this share of all normals are merged.
const LEAST_SHARE: f64 = 1e-4;
/// Stretched slopes beyond are lost: their reflection is masked whatever the view.
const GREATEST_SLOPE: f64 = 1e9;

/// A profile sampled for the integral over the slopes.
pub struct SingleScattering<'a> {
    pub(super) ndf: &'a Ndf,
    pub(super) shadowing: Shadowing,
    pub(super) rule: Rule,
    pub(super) edges: Vec<f64>,
    /// (ρ, weight ρ f) for each panel in turn
    pub(super) nodes: Vec<(f64, f64)>,
    pub(super) tails: TailMoments,
}

impl<'a> SingleScattering<'a> {
    /// Samples the profile of a distribution.
    pub fn new(ndf: &'a Ndf, shadowing: Shadowing, rule: Rule) -> Self {
        let profile = ndf.profile();
        let edges = panel_edges(profile);
        let mut nodes = Vec::with_capacity(edges.len() * rule.radial);
        for ends in edges.windows(2) {
            let width = ends[1] - ends[0];
            nodes.extend(gauss(rule.radial).nodes().iter().map(|&(t, weight)| {
                let rho = ends[0] + t * width;
                (rho, weight * width * rho * profile.f(rho))
            }));
        }
        let tails = TailMoments::new(profile, &edges);
        Self { ndf, shadowing, rule, edges, nodes, tails }
    }

    /// `1 − E`.
    pub fn missing_energy(&self, view: Incidence) -> f64 {
        self.over_reflections(view, 1.0, |_, hidden| hidden)
    }

    /// The share of light that leaves after one reflection, if a facet reflects `share` of it, given the cosine at which it is met.
    pub fn reflectance(&self, view: Incidence, share: impl Fn(f64) -> f64) -> f64 {
        self.over_reflections(view, 0.0, |cosine, hidden| share(cosine) * (1.0 - hidden))
    }

    /// The mean over all visible facets that reflect the view upwards, of what depends on the cosine at which they are met, and on the share of
    /// the reflection that is hidden; facets far beyond all others count as `beyond`.
    fn over_reflections(&self, view: Incidence, beyond: f64, of: impl Fn(f64, f64) -> f64) -> f64 {
        self.over_azimuths(view, |place, azimuth| self.along_azimuth(&view, place, azimuth, beyond, &of))
    }

    /// The mean over all visible facets of what is known along each azimuth of the stretched slope.
    pub(super) fn over_azimuths(&self, view: Incidence, along: impl Fn(&Place, (f64, f64)) -> f64) -> f64 {
        // along the normal every azimuth is the view's; a finite stand-in is 1e-12 off
        let a = view.a.min(1e6 / view.along.min(1.0));
        let sec = (1.0 + (a * view.along).powi(2)).sqrt();
        let place = Place { sin: 1.0 / sec, cos: a * view.along / sec, a, masked: self.ndf.lambda_table().h(a) };
        let mut sum = 0.0;
        // symmetric in y without shear
        let quarters: &[f64] = if view.shear == 0.0 { &[0.0, 1.0] } else { &[-2.0, -1.0, 0.0, 1.0] };
        for &quarter in quarters {
            for &(t, weight) in gauss(self.rule.azimuthal).nodes() {
                let (y, x) = (FRAC_PI_2 * (quarter + t)).sin_cos();
                sum += weight * along(&place, (x, y));
            }
        }
        let arc = if view.shear == 0.0 { PI } else { FRAC_PI_2 };
        (sum * arc * self.ndf.profile().normalization() / PI / (a + place.masked)).clamp(0.0, 1.0)
    }

    /// The factor `(a + ρ x)⁺` of a visible facet included, along one azimuth.
    fn along_azimuth(
        &self,
        view: &Incidence,
        &Place { sin, cos, a, masked }: &Place,
        (x, y): (f64, f64),
        beyond: f64,
        of: &impl Fn(f64, f64) -> f64,
    ) -> f64 {
        let (slope_x, slope_y) = (view.along * x, view.shear * x + view.across * y);
        let square = slope_x * slope_x + slope_y * slope_y;
        // end of the radius: z s² ρ² − 2 sin s_x ρ − z < 0
        let half = sin * slope_x;
        let root = (half * half + cos * cos * square).sqrt();
        let end = if half > 0.0 { (root + half) / (cos * square) } else { cos / (root - half) };
        let front = if x < 0.0 { a / -x } else { f64::INFINITY };
        let at = |rho: f64| {
            let (sx, sy) = (rho * slope_x, rho * slope_y);
            let facing = cos + sin * sx;
            let sec2 = 1.0 + sx * sx + sy * sy;
            let twice = 2.0 * facing / sec2;
            let (ox, oy, oz) = (twice * sx - sin, twice * sy, twice - cos);
            // stretched: the transpose of the map from stretched slopes to slopes
            let (tx, ty) = (view.along * ox + view.shear * oy, view.across * oy);
            let across = (tx * tx + ty * ty).sqrt();
            let oz = oz.max(0.0);
            // area − z, at view and light, in units that cancel
            let hidden = across * self.ndf.lambda_table().h(oz / across.max(1e-300));
            let (hidden, visible) = match self.shadowing {
                Shadowing::Separable => (hidden, oz),
                // times a, which may be 0
                Shadowing::HeightCorrelated => (hidden * a, oz * (a + masked)),
            };
            let hidden = if hidden > 0.0 { hidden / (hidden + visible) } else { 0.0 };
            (a + rho * x).max(0.0) * of(facing / sec2.sqrt(), hidden)
        };
        let mut sum = 0.0;
        let count = self.rule.radial;
        let mut from = 0.0;
        for (ends, nodes) in self.edges.windows(2).zip(self.nodes.chunks_exact(count)) {
            if ends[1] <= end {
                sum += nodes.iter().map(|&(rho, mass)| mass * at(rho)).sum::<f64>();
                from = ends[1];
            } else {
                let profile = self.ndf.profile();
                sum += gauss(count).integrate(from, end, |rho| rho * profile.f_fast(rho) * at(rho));
                from = end;
                break;
            }
        }
        let [m1, m2] = self.tails.at(from.min(front));
        let [f1, f2] = self.tails.at(front);
        sum + beyond * (a * (m1 - f1) + x * (m2 - f2)).max(0.0)
    }
}

/// A view as the integral over the slopes knows it.
pub(super) struct Place {
    pub(super) sin: f64,
    pub(super) cos: f64,
    /// As [`Incidence::a`], but finite.
    pub(super) a: f64,
    /// H(a)
    pub(super) masked: f64,
}

/// Ends of the panels of the radius.
fn panel_edges(profile: &dyn Profile) -> Vec<f64> {
    let mut breaks: Vec<f64> = profile.breaks(40.0).into_iter().filter(|&x| x < GREATEST_SLOPE).collect();
    if let Tail::Power { .. } = profile.tail() {
        breaks.push(GREATEST_SLOPE);
    }
    let mut edges = vec![0.0];
    let mut left = 0.0;
    for &right in &breaks {
        if profile.cdf(right) - profile.cdf(left) < LEAST_SHARE
            && profile.sf(right) > 0.1
            && !profile.cusps().contains(&right)
        {
            continue;
        }
        let pieces = if left > 0.0 { ((right / left).ln() / RATIO.ln()).ceil().max(1.0) as i32 } else { 1 };
        for k in 1..pieces {
            edges.push(left * (right / left).powf(f64::from(k) / f64::from(pieces)));
        }
        edges.push(right);
        left = right;
    }
    edges
}

/// `∫_ρ^∞ t f dt` and `∫_ρ^∞ t² f dt`, tabulated.
pub(super) struct TailMoments {
    /// (ρ, both integrals, both integrands)
    points: Vec<(f64, [f64; 2], [f64; 2])>,
    /// By how much the exponent of a power tail exceeds 3.
    excess: Option<f64>,
}

/// Points per panel: cubics in between are then good to 1e-6.
const TAIL_POINTS: usize = 8;

impl TailMoments {
    fn new(profile: &dyn Profile, edges: &[f64]) -> Self {
        let mut rhos: Vec<f64> = edges
            .windows(2)
            .flat_map(|ends| {
                (0..TAIL_POINTS).map(move |k| {
                    let t = k as f64 / TAIL_POINTS as f64;
                    if ends[0] > 0.0 { ends[0] * (ends[1] / ends[0]).powf(t) } else { ends[1] * t }
                })
            })
            .collect();
        let last = edges[edges.len() - 1];
        rhos.push(last);
        let integrands = |rho: f64| {
            let f = rho * profile.f(rho);
            [f, rho * f]
        };
        let excess = match profile.tail() {
            Tail::Power { excess, .. } => Some(excess),
            Tail::Exponential => None,
        };
        let mut sums = excess.map_or([0.0; 2], |excess| {
            let mass = profile.f(last) * last * last;
            [mass / (1.0 + excess), mass * last / excess]
        });
        let mut points = vec![(last, sums, integrands(last))];
        for ends in rhos.windows(2).rev() {
            let width = ends[1] - ends[0];
            for &(t, weight) in gauss(6).nodes() {
                let rho = ends[0] + t * width;
                let [first, second] = integrands(rho);
                sums = [sums[0] + weight * width * first, sums[1] + weight * width * second];
            }
            points.push((ends[0], sums, integrands(ends[0])));
        }
        points.reverse();
        Self { points, excess }
    }

    pub(super) fn at(&self, rho: f64) -> [f64; 2] {
        let next = self.points.partition_point(|point| point.0 <= rho);
        if next == self.points.len() {
            let (last, [first, second], _) = self.points[next - 1];
            return self.excess.map_or([0.0; 2], |excess| {
                let fall = (rho / last).powf(-excess);
                [first * fall * (last / rho), second * fall]
            });
        }
        let (left, right) = (&self.points[next.max(1) - 1], &self.points[next]);
        [0, 1].map(|k| {
            let (at_left, at_right) = ([left.1[k], -left.2[k]], [right.1[k], -right.2[k]]);
            hermite::value(hermite::cubic(at_left, at_right, right.0 - left.0), rho - left.0)
        })
    }
}

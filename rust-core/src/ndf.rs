//! The stretched distribution: roughness and anisotropy, written once above any radial profile.
//!
//! Directions are unit vectors in the local frame, z along the geometric normal; ω_i points to the viewer, ω_o to the light,
//! m is the microfacet normal. D and pdf are densities per solid angle of m; ∫ D cos θ_m dω_m = 1.
//!
//! ```
//! use glam::DVec3;
//! use sgtd_core::family::{shape::Shape, skewed_t::SkewedT};
//! use sgtd_core::ndf::{Ndf, Normals, Roughness, Shadowing};
//!
//! let ndf = Ndf::new(Box::new(SkewedT::new(Shape::new(1.6, 1.0, 0.0, 0.0)?)), 1e-5)?;
//! let (alpha, wi) = (Roughness::new(0.3, 0.1)?, DVec3::new(0.6, 0.0, 0.8));
//! let sample = ndf.sample(alpha, wi, (0.3, 0.7), Normals::Visible);
//! let wo = 2.0 * wi.dot(sample.m) * sample.m - wi;
//! assert!((sample.pdf / ndf.pdf(alpha, wi, sample.m, Normals::Visible) - 1.0).abs() < 1e-6);
//! assert!(ndf.g2(alpha, wi, wo, Shadowing::HeightCorrelated) <= ndf.g1(alpha, wi));
//! # Ok::<(), sgtd_core::error::ParameterError>(())
//! ```

use crate::error::{ParameterError, require};
use crate::masking::numbers_gradient::log_slope;
use crate::masking::table::{FINEST_SINGLE, LambdaTable};
use crate::masking::{GradientTable, MaskingGradient, MaskingIntegral, NumbersGradient, NumbersTable, Rule};
use crate::numerics::greatest;
use crate::profile::derivatives::PARAMETERS;
use crate::profile::{Coordinate, Profile, ProfileCells};
use crate::sampling::azimuth::Azimuth;
use crate::sampling::bounded::Horizon;
use crate::sampling::coordinate;
use crate::sampling::visible_table::{Mixture, VisibleTable};
use glam::DVec3;
use std::f64::consts::PI;
use std::sync::{Arc, OnceLock};

/// Roughness along both tangents (Mitsuba's `alpha_u`, `alpha_v`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roughness {
    /// Along x.
    pub u: f64,
    /// Along y.
    pub v: f64,
}

impl Roughness {
    /// Validates both values: 1e-6 … 1e6.
    ///
    /// # Errors
    /// Names the one that is not.
    pub fn new(u: f64, v: f64) -> Result<Self, ParameterError> {
        for (name, value) in [("alpha_u", u), ("alpha_v", v)] {
            require(
                (1e-6..=1e6).contains(&value),
                name,
                value,
                "between 1e-6 and 1e6",
                "0 is a smooth mirror: use a smooth material",
            )?;
        }
        Ok(Self { u, v })
    }
}

/// How masking and shadowing are combined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shadowing {
    /// G2 = G1(ω_i) G1(ω_o).
    Separable,
    /// G2 = 1/(1 + Λ(ω_i) + Λ(ω_o)).
    HeightCorrelated,
}

/// A sampled microfacet normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalSample {
    /// The normal.
    pub m: DVec3,
    /// Its density per solid angle; 0 marks a normal that no reflection can use.
    pub pdf: f64,
    /// D(m)/pdf, finite where both overflow.
    pub d_over_pdf: f64,
}

pub(crate) const INVALID: NormalSample = NormalSample { m: DVec3::Z, pdf: 0.0, d_over_pdf: 0.0 };

/// A profile with its tables, ready to be evaluated and sampled at any roughness.
pub struct Ndf {
    profile: Arc<dyn Profile>,
    lambda_table: LambdaTable,
    /// made when a normal is first drawn: D and masking do without, and it takes longer than all else
    visible_table: OnceLock<VisibleTable>,
    /// does it have rows for views?
    visible: bool,
    coordinate: Coordinate,
    /// present at accuracy 0
    quadrature: Option<MaskingIntegral>,
    accuracy: f64,
    /// A/π
    factor: f64,
    /// made when derivatives are first asked for
    gradient: OnceLock<Option<MaskingGradient>>,
    numbers_gradient: OnceLock<Option<NumbersGradient>>,
}

/// A direction in stretched slope space, at any length: masking and sampling depend on ratios alone.
struct Stretched {
    direction: DVec3,
    /// its length across the normal
    across: f64,
}

/// Which normals are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Normals {
    /// All, from D·cos θ_m, whatever the view.
    All,
    /// Those that are visible.
    Visible,
    /// Of the visible ones, as far as the limits of [`Horizon`] go, those that reflect the view above the horizon. For reflections alone: others
    /// may refract it.
    Reflecting,
}

/// A view with what all its samples and densities share.
pub struct View<'a> {
    ndf: &'a Ndf,
    alpha: Roughness,
    normals: Normals,
    stretched: Stretched,
    mixture: Mixture,
    horizon: Option<Horizon>,
    /// the share of the radii that are drawn
    share: f64,
}

impl Stretched {
    fn new(alpha: Roughness, w: DVec3) -> Self {
        let direction = DVec3::new(alpha.u * w.x, alpha.v * w.y, w.z);
        Self { direction, across: norm(direction.x, direction.y) }
    }
}

impl Ndf {
    /// The same without what only visible normals need: visible normals are then drawn as along the normal, whatever the view,
    /// and their density says so.
    ///
    /// # Errors
    /// As [`Ndf::new`].
    pub fn projected(profile: Box<dyn Profile>, accuracy: f64) -> Result<Self, ParameterError> {
        Self::shared(profile.into(), accuracy, false)
    }

    /// Tabulates a profile; `accuracy` is the permitted relative error of G1, 0 means quadrature on every call. Only masking is tabulated
    /// at once: the table that normals are drawn from is made with the first of them, so that a new shape costs little where D and G1 are
    /// all that is asked for, as in a fit.
    ///
    /// # Errors
    /// `accuracy` is negative, above 0.1 or not a number.
    pub fn new(profile: Box<dyn Profile>, accuracy: f64) -> Result<Self, ParameterError> {
        Self::shared(profile.into(), accuracy, true)
    }

    /// Either, for a profile that others have too.
    ///
    /// # Errors
    /// As [`Ndf::new`].
    pub fn shared(profile: Arc<dyn Profile>, accuracy: f64, visible: bool) -> Result<Self, ParameterError> {
        require(
            (0.0..=0.1).contains(&accuracy),
            "accuracy",
            accuracy,
            "between 0 and 0.1",
            "it is the permitted relative error of G1; 0 asks for quadrature on every call",
        )?;
        let masking = MaskingIntegral::new(profile.as_ref(), rule(accuracy));
        // single-precision renderers read a table at accuracy 0 too
        let tabulated = if accuracy == 0.0 { FINEST_SINGLE } else { accuracy };
        let lambda_table = LambdaTable::new(profile.as_ref(), &masking, tabulated);
        let factor = profile.normalization() / PI;
        let quadrature = (accuracy == 0.0).then_some(masking);
        let coordinate = profile.coordinate();
        Ok(Self {
            profile,
            lambda_table,
            visible_table: OnceLock::new(),
            visible,
            coordinate,
            quadrature,
            accuracy,
            factor,
            gradient: OnceLock::new(),
            numbers_gradient: OnceLock::new(),
        })
    }

    /// The radial profile.
    pub fn profile(&self) -> &dyn Profile {
        self.profile.as_ref()
    }
    /// The masking table.
    pub fn lambda_table(&self) -> &LambdaTable {
        &self.lambda_table
    }
    /// The table of visible normals; made on the first call, once for all threads.
    #[inline]
    pub fn visible_table(&self) -> &VisibleTable {
        self.visible_table.get_or_init(|| {
            let profile = self.profile.as_ref();
            let masking = MaskingIntegral::new(profile, rule(self.accuracy));
            if self.visible { VisibleTable::new(profile, &masking) } else { VisibleTable::projected(profile, &masking) }
        })
    }
    /// Has the table of visible normals been made?
    pub fn draws(&self) -> bool {
        self.visible_table.get().is_some()
    }
    /// Greatest |d ln f / d ln x| where f is above 1e-7 of its peak: by how much D magnifies the rounding of a slope.
    pub fn steepness(&self) -> f64 {
        let profile = self.profile.as_ref();
        let knots = self.visible_table().slopes();
        let points: Vec<(f64, f64)> = knots
            .windows(2)
            .flat_map(|pair| (0..8).map(|k| pair[0] + (pair[1] - pair[0]) * f64::from(k) / 8.0))
            .map(|x| (x, profile.f_fast(x)))
            .collect();
        let peak = greatest(points.iter().map(|&(_, f)| f));
        greatest(
            points
                .windows(2)
                .filter(|pair| pair[0].0 > 0.0 && pair[0].1.min(pair[1].1) > 1e-7 * peak)
                .map(|pair| ((pair[1].1 / pair[0].1).ln() / (pair[1].0 / pair[0].0).ln()).abs()),
        )
    }
    /// The relative error of G1 that calls of this object have.
    pub fn accuracy_reached(&self) -> f64 {
        if self.accuracy == 0.0 { 1e-12 } else { self.lambda_table.reached() }
    }

    /// How masking and A follow the parameters of the family, by quadrature; `None` for a profile that is not of the family.
    fn gradient(&self) -> Option<&MaskingGradient> {
        self.gradient.get_or_init(|| MaskingGradient::new(self.profile.as_ref(), Rule::REFERENCE)).as_ref()
    }

    /// `∂ ln A/∂θ` for θ = 1/γ, p, λ and m; `None` for a profile that is not of the family.
    pub fn log_normalization_gradient(&self) -> Option<[f64; PARAMETERS]> {
        Some(self.gradient()?.log_normalization())
    }

    /// `∂D/∂θ` for θ = 1/γ, p, λ and m, at a fixed roughness and normal; 0 at a cusp itself, where there may be none.
    pub fn d_gradient(&self, alpha: Roughness, m: DVec3) -> Option<[f64; PARAMETERS]> {
        let (log_a, derivatives) = (self.log_normalization_gradient()?, self.profile.derivatives()?);
        let d = self.d(alpha, m);
        if d == 0.0 {
            return Some([0.0; PARAMETERS]);
        }
        let by = derivatives.log_f(norm(m.x / alpha.u, m.y / alpha.v) / m.z);
        Some(std::array::from_fn(|k| d * (log_a[k] + by[k])))
    }

    /// `∂Λ/∂θ` for θ = 1/γ, p, λ and m, at a fixed roughness and direction, by quadrature whatever the accuracy; infinite where Λ is, 0 below
    /// the horizon.
    pub fn lambda_gradient(&self, alpha: Roughness, w: DVec3) -> Option<[f64; PARAMETERS]> {
        let gradient = self.gradient()?;
        let across = Stretched::new(alpha, w).across;
        if w.z <= 0.0 || across == 0.0 {
            return Some([0.0; PARAMETERS]);
        }
        let a = w.z / across;
        let (_, by) = gradient.at(self.profile.as_ref(), a);
        Some(by.map(|by| by.h / a))
    }

    /// The derivatives of H and A in the form that single-precision renderers read; `None` for a profile that is not of the family.
    pub fn gradient_table(&self) -> Option<GradientTable> {
        let profile = self.profile.as_ref();
        // a table shows less than a finer rule would find
        let gradient = MaskingGradient::new(profile, Rule::TABLE)?;
        Some(GradientTable::new(profile, &gradient, &self.lambda_table))
    }

    /// How all follows the numbers of a table or a mixture; `None` for a member of the family.
    pub fn numbers_gradient(&self) -> Option<&NumbersGradient> {
        let make = || NumbersGradient::new(self.profile.as_ref(), Rule::REFERENCE);
        self.numbers_gradient.get_or_init(make).as_ref()
    }

    /// `∂D/∂ ln` of each number of a table or a mixture (see [`NumbersGradient`]), at a fixed roughness and normal.
    pub fn d_by_numbers(&self, alpha: Roughness, m: DVec3) -> Option<Vec<f64>> {
        let gradient = self.numbers_gradient()?;
        let (d, x) = (self.d(alpha, m), norm(m.x / alpha.u, m.y / alpha.v) / m.z);
        if d == 0.0 {
            return Some(vec![0.0; gradient.count()]);
        }
        let profile = self.profile.as_ref();
        // a mean slope that grows is a roughness that shrinks
        let by_roughness = -2.0 - log_slope(profile, x);
        let by = gradient.log_density(profile, x);
        Some(by.iter().zip(gradient.log_mean()).map(|(by, mean)| d * (by - mean * by_roughness)).collect())
    }

    /// `∂Λ/∂ ln` of each number, at a fixed roughness and direction, by quadrature; 0 below the horizon.
    pub fn lambda_by_numbers(&self, alpha: Roughness, w: DVec3) -> Option<Vec<f64>> {
        let gradient = self.numbers_gradient()?;
        let across = Stretched::new(alpha, w).across;
        if w.z <= 0.0 || across == 0.0 {
            return Some(vec![0.0; gradient.count()]);
        }
        let (profile, a) = (self.profile.as_ref(), w.z / across);
        // Λ = H(a)/a with an a that shrinks like the roughness grows
        let (at, by) = gradient.at(profile, a);
        let by_roughness = at.h + a * at.s;
        Some(by.iter().zip(gradient.log_mean()).map(|(by, mean)| (by.h - mean * by_roughness) / a).collect())
    }

    /// The derivatives by the numbers of a table or a mixture in the form that single-precision renderers read; `precise` adds
    /// those of f in double precision. `None` for a member of the family.
    pub fn numbers_table(&self, cells: &ProfileCells, precise: bool) -> Option<NumbersTable> {
        let profile = self.profile.as_ref();
        let gradient = NumbersGradient::new(profile, Rule::TABLE)?;
        Some(NumbersTable::new(profile, &gradient, &self.lambda_table, cells, precise))
    }

    /// `D(m) = A f(x) / (π σx σy cos⁴θ_m)`; 0 for m at or below the horizon.
    pub fn d(&self, alpha: Roughness, m: DVec3) -> f64 {
        if m.z <= 0.0 {
            return 0.0;
        }
        // two divisions where the formula has six
        let (inverse_area, sec) = (1.0 / (alpha.u * alpha.v), 1.0 / m.z);
        let f = if self.quadrature.is_some() {
            let (from, past) = slope_and_rest(alpha, m);
            self.profile.f_past(from, past)
        } else {
            self.profile.f_fast(norm(m.x * alpha.v, m.y * alpha.u) * (inverse_area * sec))
        };
        let (scale, sec2) = (self.factor * inverse_area, sec * sec);
        if sec2 < 1e100 {
            // f comes last
            finite(scale * sec2 * sec2 * f)
        } else {
            if f == 0.0 {
                return 0.0;
            }
            // cos⁴ underflows long before the quotient overflows
            let root = f.sqrt() * sec2;
            finite(scale * root * root)
        }
    }

    /// `f(x)`: the reference at accuracy 0, else as fast as can be.
    #[inline]
    fn shape_factor(&self, x: f64) -> f64 {
        if self.quadrature.is_some() { self.profile.f(x) } else { self.profile.f_fast(x) }
    }

    /// `Λ(ω)`; at and below the horizon, where it is infinite, the greatest finite number.
    pub fn lambda(&self, alpha: Roughness, w: DVec3) -> f64 {
        let across = norm(alpha.u * w.x, alpha.v * w.y);
        if w.z <= 0.0 {
            return f64::MAX;
        }
        if across == 0.0 {
            return 0.0;
        }
        finite(self.h(w.z / across) * (across / w.z))
    }

    /// `cos θ (1 + Λ(ω))`, the area of all facets that face ω, seen from there: finite at the horizon too, and below it what it is there.
    pub fn projected_area(&self, alpha: Roughness, w: DVec3) -> f64 {
        let (across, up) = (norm(alpha.u * w.x, alpha.v * w.y), w.z.max(0.0));
        if across == 0.0 { up } else { across.mul_add(self.h(up / across), up) }
    }

    /// `H(a)`, where Λ = H(a)/a.
    #[inline]
    fn h(&self, a: f64) -> f64 {
        match &self.quadrature {
            Some(masking) => masking.at(self.profile.as_ref(), a).h,
            None => self.lambda_table.h(a),
        }
    }

    /// Smith's `G1(ω) = 1/(1 + Λ)`; 0 at and below the horizon.
    pub fn g1(&self, alpha: Roughness, w: DVec3) -> f64 {
        if w.z <= 0.0 { 0.0 } else { 1.0 / (1.0 + self.lambda(alpha, w)) }
    }

    /// Masking and shadowing together.
    pub fn g2(&self, alpha: Roughness, wi: DVec3, wo: DVec3, shadowing: Shadowing) -> f64 {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return 0.0;
        }
        let (i, o) = (self.lambda(alpha, wi), self.lambda(alpha, wo));
        match shadowing {
            // one product: the same for both orders of the directions
            Shadowing::Separable => 1.0 / ((1.0 + i) * (1.0 + o)),
            Shadowing::HeightCorrelated => 1.0 / (1.0 + (i + o).min(f64::MAX)),
        }
    }

    /// What sampling needs of a view; `None` at and below the horizon, from where nothing is seen.
    pub fn view(&self, alpha: Roughness, wi: DVec3, normals: Normals) -> Option<View<'_>> {
        if !(wi.z > 0.0) {
            return None;
        }
        let stretched = Stretched::new(alpha, wi);
        let mixture = match normals {
            Normals::All => self.visible_table().unseen(),
            _ => self.visible_table().mixture(stretched.direction.z, stretched.across),
        };
        let (horizon, share) = match normals {
            Normals::All | Normals::Visible => (None, 1.0),
            Normals::Reflecting => {
                let horizon = Horizon::new((alpha.u, alpha.v), wi);
                let greatest = match self.coordinate {
                    Coordinate::Square => horizon.square(),
                    Coordinate::Odds => coordinate::of_slope(self.profile.as_ref(), horizon.square().sqrt()),
                };
                let share = self.visible_table().share_below(mixture, greatest);
                (Some(horizon), share)
            }
        };
        Some(View { ndf: self, alpha, normals, stretched, mixture, horizon, share })
    }

    /// Density per solid angle of the normals that [`Ndf::sample`] draws.
    pub fn pdf(&self, alpha: Roughness, wi: DVec3, m: DVec3, normals: Normals) -> f64 {
        self.view(alpha, wi, normals).map_or(0.0, |view| view.pdf(m))
    }

    /// [`Ndf::pdf`] of [`Normals::Visible`].
    pub fn pdf_visible(&self, alpha: Roughness, wi: DVec3, m: DVec3) -> f64 {
        self.pdf(alpha, wi, m, Normals::Visible)
    }

    /// [`Ndf::sample`] from [`Normals::Visible`].
    pub fn sample_visible(&self, alpha: Roughness, wi: DVec3, u: (f64, f64)) -> NormalSample {
        self.sample(alpha, wi, u, Normals::Visible)
    }

    /// Draws a normal for a view; the reported pdf is the density of what is drawn.
    pub fn sample(&self, alpha: Roughness, wi: DVec3, u: (f64, f64), normals: Normals) -> NormalSample {
        self.view(alpha, wi, normals).map_or(INVALID, |view| view.sample(u))
    }

    /// Draws a stretched slope; its f, and its density per dρ².
    #[inline]
    fn sample_radius(&self, mixture: Mixture, u: f64) -> Option<(f64, f64, f64)> {
        let (y, density) = self.visible_table().sample(mixture, u)?;
        match self.coordinate {
            Coordinate::Square => {
                let rho = y.sqrt();
                Some((rho, self.shape_factor(rho), density))
            }
            Coordinate::Odds => {
                let profile = self.profile.as_ref();
                let rho = coordinate::slope(profile, y);
                let f = self.shape_factor(rho);
                Some((rho, f, density * coordinate::stretch(profile, y, f)))
            }
        }
    }

    /// Density per dρ² of what [`Ndf::sample_radius`] draws.
    #[inline]
    fn radial_density(&self, mixture: Mixture, rho: f64) -> f64 {
        match self.coordinate {
            Coordinate::Square => self.visible_table().density(mixture, rho * rho),
            Coordinate::Odds => {
                let profile = self.profile.as_ref();
                let y = coordinate::of_slope(profile, rho);
                self.visible_table().density(mixture, y) * coordinate::stretch(profile, y, self.shape_factor(rho))
            }
        }
    }

    /// Density per solid angle of the normals that [`Ndf::sample_projected`] draws: D·cos θ_m up to the spline.
    pub fn pdf_projected(&self, alpha: Roughness, m: DVec3) -> f64 {
        if m.z <= 0.0 {
            return 0.0;
        }
        if self.accuracy == 0.0 {
            return self.d(alpha, m) * m.z;
        }
        let rho = norm(m.x / alpha.u, m.y / alpha.v) / m.z;
        let radial = self.radial_density(self.visible_table().unseen(), rho);
        finite(radial / PI / (alpha.u * alpha.v * m.z * m.z * m.z))
    }

    /// Draws a normal from D·cos θ_m, whatever the view.
    pub fn sample_projected(&self, alpha: Roughness, u: (f64, f64)) -> NormalSample {
        let (rho, f, area_density) = if self.accuracy == 0.0 {
            let rho = self.profile.quantile(u.0);
            let f = self.profile.f(rho);
            (rho, f, self.factor * f)
        } else {
            let Some((rho, f, radial)) = self.sample_radius(self.visible_table().unseen(), u.0) else { return INVALID };
            (rho, f, radial / PI)
        };
        let (sin, cos) = (2.0 * PI * u.1).sin_cos();
        self.finish(alpha, (rho * cos, rho * sin), area_density, f / area_density)
    }

    /// The normal of a stretched slope drawn with the given density per slope area; f divided by that density.
    fn finish(&self, alpha: Roughness, slope: (f64, f64), area_density: f64, f_over_density: f64) -> NormalSample {
        let m = DVec3::new(alpha.u * slope.0, alpha.v * slope.1, 1.0);
        let sec = m.length();
        let m = m * (1.0 / sec);
        let pdf = area_density * (1.0 / (alpha.u * alpha.v)) * (sec * sec * sec);
        let d_over_pdf = self.factor * f_over_density * sec;
        if m.z > 0.0 && pdf > 0.0 && pdf.is_finite() && d_over_pdf.is_finite() {
            NormalSample { m, pdf, d_over_pdf }
        } else {
            INVALID
        }
    }
}

impl View<'_> {
    /// The share of the radii of visible normals that are drawn.
    pub fn share(&self) -> f64 {
        self.share
    }

    /// Density per solid angle of the normals that [`View::sample`] draws.
    pub fn pdf(&self, m: DVec3) -> f64 {
        if m.z <= 0.0 {
            return 0.0;
        }
        if self.normals == Normals::All {
            return self.ndf.pdf_projected(self.alpha, m);
        }
        let (alpha, direction) = (self.alpha, self.stretched.direction);
        let slope = (m.x / (alpha.u * m.z), m.y / (alpha.v * m.z));
        let rho = norm(slope.0, slope.1);
        let facing = direction.z + direction.x * slope.0 + direction.y * slope.1;
        if facing <= 0.0 {
            return 0.0;
        }
        let radial = self.ndf.radial_density(self.mixture, rho);
        if radial == 0.0 {
            return 0.0;
        }
        let mass = self.azimuth(rho).mass() * self.share;
        if mass > 0.0 { finite(2.0 * radial * facing / mass / (alpha.u * alpha.v * m.z * m.z * m.z)) } else { 0.0 }
    }

    /// Draws a normal; the reported pdf is the density of what is drawn.
    pub fn sample(&self, u: (f64, f64)) -> NormalSample {
        if self.normals == Normals::All {
            return self.ndf.sample_projected(self.alpha, u);
        }
        let Some((rho, f, radial)) = self.ndf.sample_radius(self.mixture, u.0 * self.share) else { return INVALID };
        let radial = radial / self.share;
        // before the azimuth, which does not need it: the processor then works on both
        let f_over_density = f / (2.0 * radial);
        let azimuth = self.azimuth(rho).sample(u.1);
        if !(azimuth.share > 0.0) {
            return INVALID;
        }
        // the azimuth is counted from that of the view
        let Stretched { direction, across } = self.stretched;
        let (cos_view, sin_view) = if across > 0.0 { (direction.x / across, direction.y / across) } else { (1.0, 0.0) };
        let (sin, cos) = (azimuth.sin, azimuth.cos);
        let slope = (rho * (cos * cos_view - sin * sin_view), rho * (sin * cos_view + cos * sin_view));
        self.ndf.finish(self.alpha, slope, 2.0 * radial * azimuth.share, f_over_density * azimuth.inverse_share)
    }

    #[inline]
    fn azimuth(&self, rho: f64) -> Azimuth {
        let (cos, sin) = (self.stretched.direction.z, self.stretched.across);
        match &self.horizon {
            Some(horizon) if horizon.limits_azimuth() => Azimuth::bounded(cos, sin, rho, horizon),
            _ => Azimuth::new(cos, sin, rho),
        }
    }
}

/// With what tables are made.
fn rule(accuracy: f64) -> Rule {
    if accuracy < FINEST_SINGLE { Rule::REFERENCE } else { Rule::TABLE }
}

/// `√((m_x/α_u)² + (m_y/α_v)²)/m_z` and what rounding left out of it: at the rim of a ring of m = 1000 one ulp of the
/// slope changes D by 1e-6.
fn slope_and_rest(alpha: Roughness, m: DVec3) -> (f64, f64) {
    let quotient = |a: f64, b: f64| (a / b, (-(a / b)).mul_add(b, a) / b);
    let ((x, x_rest), (y, y_rest)) = (quotient(m.x, alpha.u), quotient(m.y, alpha.v));
    let (xx, yy) = (x * x, y * y);
    let square = xx + yy;
    if !(1e-240..1e280).contains(&square) {
        return (norm(x, y) / m.z, 0.0);
    }
    let sum_rest = xx.min(yy) - (square - xx.max(yy));
    let square_rest = sum_rest + x.mul_add(x, -xx) + y.mul_add(y, -yy) + 2.0 * (x * x_rest + y * y_rest);
    let root = square.sqrt();
    let root_rest = ((-root).mul_add(root, square) + square_rest) / (2.0 * root);
    let (rho, rho_rest) = quotient(root, m.z);
    let rest = rho_rest + root_rest / m.z;
    (rho, if rest.is_finite() { rest } else { 0.0 })
}

/// Length of a vector: `hypot` where squares leave the range of f64, which costs ten times as much.
#[inline]
fn norm(x: f64, y: f64) -> f64 {
    let square = x * x + y * y;
    if (1e-280..1e280).contains(&square) { square.sqrt() } else { x.hypot(y) }
}

/// Overflow of a positive quantity saturates instead of becoming infinite.
fn finite(x: f64) -> f64 {
    x.min(f64::MAX)
}

//! Single reflection seen from one direction: all that a renderer asks for at a hit, with what its questions share computed once.
//!
//! A renderer evaluates the direction of a light and draws a direction of its own at the same view. Both need the view's masking, its stretched
//! direction and the limits of its visible normals.

use crate::ndf::{Ndf, NormalSample, Normals, Roughness, Shadowing, View};
use glam::DVec3;

/// What a pair of directions gives.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Reflected {
    /// D of the half vector.
    pub d: f64,
    /// cos θ of the half vector.
    pub cos: f64,
    /// Masking and shadowing together.
    pub g2: f64,
    /// Density of the half vector per solid angle under [`Reflection::sample`].
    pub pdf: f64,
}

/// One view of a distribution.
pub struct Reflection<'a> {
    ndf: &'a Ndf,
    alpha: Roughness,
    shadowing: Shadowing,
    wi: DVec3,
    /// cos θ_i (1 + Λ_i)
    area: f64,
    view: View<'a>,
}

impl<'a> Reflection<'a> {
    /// A view; `None` at and below the horizon.
    pub fn new(ndf: &'a Ndf, alpha: Roughness, shadowing: Shadowing, wi: DVec3, normals: Normals) -> Option<Self> {
        let view = ndf.view(alpha, wi, normals)?;
        Some(Self { ndf, alpha, shadowing, wi, area: ndf.projected_area(alpha, wi), view })
    }

    /// The view itself.
    pub fn view(&self) -> &View<'a> {
        &self.view
    }

    /// D, G2 and the density at the half vector of the view and ω_o; zeros where nothing is reflected.
    pub fn at(&self, wo: DVec3) -> Reflected {
        let half = self.wi + wo;
        if !(wo.z > 0.0 && half.z > 0.0) {
            return Reflected::default();
        }
        let m = half * (1.0 / half.length());
        Reflected { d: self.ndf.d(self.alpha, m), cos: m.z, g2: self.g2(wo), pdf: self.view.pdf(m) }
    }

    /// Draws a normal, and the masking of the reflection about it: 0 where that does not leave.
    pub fn sample(&self, u: (f64, f64)) -> (NormalSample, f64) {
        let sample = self.view.sample(u);
        let facing = self.wi.dot(sample.m);
        let wo = 2.0 * facing * sample.m - self.wi;
        (sample, if facing > 0.0 && wo.z > 0.0 { self.g2(wo) } else { 0.0 })
    }

    fn g2(&self, wo: DVec3) -> f64 {
        let area = self.ndf.projected_area(self.alpha, wo);
        let both = match self.shadowing {
            Shadowing::Separable => self.area * area,
            Shadowing::HeightCorrelated => self.area.mul_add(wo.z, self.wi.z * (area - wo.z)),
        };
        self.wi.z * wo.z / both
    }
}

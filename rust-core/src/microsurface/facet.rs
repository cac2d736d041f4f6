//! What a facet does with light: a mirror, a metal, glass.

use super::trace::Side;
use crate::scattering::fresnel::{conductor, dielectric};
use glam::DVec3;

/// What the surface is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Material {
    /// Reflects everything.
    Mirror,
    /// A metal of three colors, with its complex indices η − i k.
    Conductor {
        /// Real parts.
        eta: DVec3,
        /// Imaginary parts.
        k: DVec3,
    },
    /// Glass below, air above: the index of the inside over that of the outside.
    Dielectric {
        /// The relative index.
        eta: f64,
    },
}

/// What has become of a ray at a facet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scattered {
    /// Where it goes.
    pub direction: DVec3,
    /// Factor on its energy, per color.
    pub weight: DVec3,
    /// The side on which it goes on.
    pub side: Side,
}

impl Material {
    /// A ray that arrives in `direction` at a facet with normal `m` (upwards), seen from `side`; `u` in [0, 1) chooses what a dielectric does.
    pub fn scatter(&self, direction: DVec3, m: DVec3, side: Side, u: f64) -> Scattered {
        // towards the ray
        let facing = if side == Side::Above { m } else { -m };
        // rounding may see an edge-on facet from behind
        let cosine = (-direction.dot(facing)).clamp(0.0, 1.0);
        let reflected = (direction + 2.0 * cosine * facing).normalize();
        match *self {
            Self::Mirror => Scattered { direction: reflected, weight: DVec3::ONE, side },
            Self::Conductor { .. } => Scattered { direction: reflected, weight: self.reflectance(cosine), side },
            Self::Dielectric { eta } => {
                let eta = if side == Side::Above { eta } else { 1.0 / eta };
                let (reflectance, refracted) = dielectric(cosine, eta);
                if u < reflectance {
                    return Scattered { direction: reflected, weight: DVec3::ONE, side };
                }
                let along = direction + cosine * facing;
                let direction = (along / eta - refracted * facing).normalize();
                Scattered { direction, weight: DVec3::ONE, side: side.other() }
            }
        }
    }
}

impl Material {
    /// What of light that arrives from outside at this cosine is reflected, per color.
    pub fn reflectance(&self, cosine: f64) -> DVec3 {
        match *self {
            Self::Mirror => DVec3::ONE,
            Self::Conductor { eta, k } => {
                DVec3::from_array(std::array::from_fn(|c| conductor(cosine.clamp(0.0, 1.0), eta[c], k[c])))
            }
            Self::Dielectric { eta } => DVec3::splat(dielectric(cosine.clamp(0.0, 1.0), eta).0),
        }
    }
}

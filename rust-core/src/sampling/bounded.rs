//! The slopes whose reflection is above the horizon: what a sampler of reflections need not draw beyond.
//!
//! A facet of slope s reflects a view whose own slope is t = tan θ upwards iff `|s − t|² < sec²θ`, a disc that holds the origin. In slopes divided by
//! the roughness and polar coordinates around the normal, with `ρ± = (sec θ ± tan θ)/α` for one roughness:
//!
//! * **radius**: no slope beyond `ρ₊` counts, whatever its azimuth;
//! * **azimuth**, between ρ₋ and ρ₊: `cos φ > κ = (ρ² − ρ₊ρ₋)/(ρ (ρ₊ − ρ₋))`; below ρ₋ all do.
//!
//! With two roughnesses the disc is stretched to an ellipse. Its farthest point is at most `|t| + sec θ/min(α_u, α_v)` away, t the stretched slope of
//! the view; the azimuths of one radius are no interval any more, so they are not limited.
//!
//! The azimuths are those of a disc that is a little larger: at the rim of the disc itself their range ends, and a direction in single precision does
//! not tell any more how wide it is.
//!
//! Up to that both limits are exact, so the density of what is drawn is that of visible normals divided by the share that is left. Smith's visible normals draw
//! 30 to 70 % of all reflections of heavy tails below the horizon.

pub use crate::constants::HORIZON_MARGIN as MARGIN;
use glam::DVec3;

/// The limits of one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Horizon {
    /// ρ₊, the radius beyond which nothing counts.
    far: f64,
    /// ρ₋; infinite where azimuths are not limited.
    near: f64,
}

impl Horizon {
    /// The limits for a view above the horizon, at the roughness along x and y.
    pub fn new((alpha_u, alpha_v): (f64, f64), w: DVec3) -> Self {
        let tangent = (1.0 + w.x.hypot(w.y)) / w.z;
        if alpha_u == alpha_v {
            Self { far: tangent / alpha_u, near: 1.0 / (tangent * alpha_u) }
        } else {
            let view = (w.x / alpha_u).hypot(w.y / alpha_v);
            Self { far: (view + 1.0 / alpha_u.min(alpha_v)) / w.z, near: f64::INFINITY }
        }
    }

    /// ρ₊².
    pub fn square(&self) -> f64 {
        (self.far * self.far).min(f64::MAX)
    }

    /// Are azimuths limited?
    pub fn limits_azimuth(&self) -> bool {
        self.near < f64::INFINITY
    }

    /// `1 − κ` and `1 + κ` of the enlarged disc, both times the same positive number; the second is below 0 where no azimuth is cut off.
    #[inline]
    pub(crate) fn complements(&self, rho: f64) -> (f64, f64) {
        let (far, near) = ((1.0 + MARGIN) * self.far, (1.0 + MARGIN) * self.near);
        ((far - rho) * (rho + near), (rho + far) * (rho - near))
    }

    /// `2 (1 + κ ρ tan θ)` for the slope that ρ stands for: the derivative of [`crate::sampling::azimuth`] at its far end in units of c/2, without
    /// cancellation.
    #[inline]
    pub(crate) fn rise(&self, rho: f64) -> f64 {
        1.0 - MARGIN + rho * rho / (self.far * self.near * (1.0 + MARGIN))
    }
}

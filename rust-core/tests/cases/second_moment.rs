//! The variance of visible sampling, by quadrature.
#![allow(dead_code)] // every test crate uses a part of it

use glam::DVec3;
use sgtd_core::ndf::{Ndf, Roughness};
use sgtd_core::numerics::quadrature::gauss;
use sgtd_core::sampling::azimuth::Azimuth;

/// E[w²] of the weight true/drawn over what is drawn, seen under cot θ = a.
pub fn second_moment(ndf: &Ndf, a: f64) -> f64 {
    let profile = ndf.profile();
    let (cos, sin) = (a / a.hypot(1.0), 1.0 / a.hypot(1.0));
    let wi = DVec3::new(sin, 0.0, cos);
    let alpha = Roughness { u: 1.0, v: 1.0 };
    let knots = ndf.visible_table().slopes();
    let last = knots[knots.len() - 1];
    let mut ends = profile.breaks(60.0);
    ends.extend(knots.iter().filter(|&&x| x > 0.0));
    ends.extend((0..14).map(|k| a * (1.0 + 0.25f64.powi(k))).chain([a]));
    ends.retain(|&x| x <= last);
    ends.sort_by(f64::total_cmp);
    ends.dedup();
    let (mut left, mut truth, mut drawn, mut second) = (0.0, 0.0, 0.0, 0.0);
    for right in ends {
        for &(t, weight) in gauss(8).nodes() {
            let rho = left + t * (right - left);
            // the azimuth is drawn exactly, so that one direction tells the weight of all
            let m = DVec3::new(rho, 0.0, 1.0).normalize();
            let ring = weight * (right - left) * rho * Azimuth::new(cos, sin, rho).mass();
            let got = ndf.pdf_visible(alpha, wi, m) * m.z.powi(3) / (cos + sin * rho) * ring;
            let want = profile.f(rho) * ring;
            truth += want;
            drawn += got;
            if got > 0.0 {
                second += want * want / got;
            } else {
                // next to the end, or where single precision ends
                assert!(profile.sf(rho) < 1e-12 || want < 1e-30, "nothing is drawn at {rho:e}: {want:e}");
            }
        }
        left = right;
    }
    assert!(drawn < 1.0 + 1e-4, "the density integrates to {drawn}");
    second * drawn / (truth * truth)
}

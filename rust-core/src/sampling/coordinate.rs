//! The coordinate y over which visible normals are tabulated.
//!
//! What a view sees of a profile is `f(ρ) ρ` times a factor that is smooth in ρ. Over ρ² the spline has to follow f, which 63 cells can
//! where f is smooth between few break points. Over the odds `y = F/(1−F)` f drops out: `d(ρ²)/dy = (1−F)²/(A f)`, so that what is tabulated is the
//! smooth factor alone, whatever f is. For GGX both are the same.

use crate::profile::{Coordinate, Profile};

/// Odds beyond this are not drawn: y² still fits into single precision.
const ODDS_CAP: f64 = 1e18;

/// y at a slope.
pub(crate) fn of_slope(profile: &dyn Profile, rho: f64) -> f64 {
    match profile.coordinate() {
        Coordinate::Square => rho * rho,
        Coordinate::Odds => {
            let sf = profile.sf(rho);
            // the smaller of both is the one that keeps its digits
            let odds = if sf < 0.5 { (1.0 - sf) / sf } else { profile.cdf(rho) / sf };
            odds.min(ODDS_CAP)
        }
    }
}

/// The slope at y.
pub(crate) fn slope(profile: &dyn Profile, y: f64) -> f64 {
    match profile.coordinate() {
        Coordinate::Square => y.sqrt(),
        Coordinate::Odds if y < 1.0 => profile.quantile(y / (1.0 + y)),
        Coordinate::Odds => profile.isf(1.0 / (1.0 + y)),
    }
}

/// `dy/d(ρ²)` where f is `f`.
pub(crate) fn stretch(profile: &dyn Profile, y: f64, f: f64) -> f64 {
    match profile.coordinate() {
        Coordinate::Square => 1.0,
        Coordinate::Odds => profile.normalization() * f * (1.0 + y) * (1.0 + y),
    }
}

/// `f d(ρ²)/dy`, finite where f is 0.
pub(crate) fn shrunk_f(profile: &dyn Profile, y: f64, f: f64) -> f64 {
    match profile.coordinate() {
        Coordinate::Square => f,
        Coordinate::Odds => 1.0 / (profile.normalization() * (1.0 + y) * (1.0 + y)),
    }
}

/// The slope beyond which nothing is drawn, if a profile goes on for ever.
pub(crate) fn cap(profile: &dyn Profile, slope_cap: f64) -> f64 {
    match profile.coordinate() {
        Coordinate::Square => slope_cap,
        Coordinate::Odds => slope_cap.min(profile.isf(1.0 / ODDS_CAP)),
    }
}

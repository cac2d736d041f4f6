//! A profile that differs from another in what it says of itself.

use sgtd_core::profile::{Profile, Tail};

/// Everything as another profile has it, but for the following; nothing of what that one could answer in closed form.
pub struct Altered<P> {
    /// The other one.
    pub profile: P,
    /// What becomes of its f: x, f(x).
    pub f: fn(f64, f64) -> f64,
    /// Does f bend at break points?
    pub bends: bool,
}

impl<P: Profile> Profile for Altered<P> {
    fn f(&self, x: f64) -> f64 {
        (self.f)(x, self.profile.f(x))
    }
    fn f_past(&self, from: f64, past: f64) -> f64 {
        (self.f)(from + past, self.profile.f_past(from, past))
    }
    fn normalization(&self) -> f64 {
        self.profile.normalization()
    }
    fn cdf(&self, x: f64) -> f64 {
        self.profile.cdf(x)
    }
    fn sf(&self, x: f64) -> f64 {
        self.profile.sf(x)
    }
    fn quantile(&self, u: f64) -> f64 {
        self.profile.quantile(u)
    }
    fn isf(&self, u: f64) -> f64 {
        self.profile.isf(u)
    }
    fn mean(&self) -> f64 {
        self.profile.mean()
    }
    fn breaks(&self, depth: f64) -> Vec<f64> {
        self.profile.breaks(depth)
    }
    fn cusps(&self) -> &[f64] {
        self.profile.cusps()
    }
    fn bends_at_breaks(&self) -> bool {
        self.bends
    }
    fn tail(&self) -> Tail {
        self.profile.tail()
    }
}

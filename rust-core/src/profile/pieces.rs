//! Any profile as pieces of Student distributions over the square of the slope, which is what single precision reads.
//!
//! With `s = x²` a piece is `f = f₀ t^(−e)`, `t = 1 + (s − s₀) r`: between two nodes of a table it is exact, with `r = 1/(k² + s₀)`, and the ramps next to a
//! 0 are `e = −1`. The mass of a piece is in closed form, `∫ f ds = f₀/r · (t^(1−e) − 1)/(1−e)`, and so is its inverse.
//!
//! Other profiles are approached: r and e are chosen so that a piece has the profile's values at both ends and in the middle, and pieces are halved
//! until ln f is as near as `PERMITTED` asks for.

use crate::numerics::greatest;
use crate::profile::Profile;

/// f between `start` and the start of the next piece, in x².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Where it begins.
    pub start: f64,
    /// s₀, where t = 1: it need not lie inside.
    pub anchor: f64,
    /// r; 0 where f is constant or 0.
    pub rate: f64,
    /// ln f₀; −∞ where there is nothing.
    pub log_f: f64,
    /// e
    pub exponent: f64,
}

/// Error of ln f that is permitted: what single precision makes of D anyway.
const PERMITTED: f64 = 4e-6;
/// Where f is below this share of its peak, the error may grow.
const FAINT: f64 = 1e-9;
/// How much more it may be there.
const FAINT_FACTOR: f64 = 100.0;
/// Most pieces of a profile that has to be approached, or one between any two of its break points; its error grows rather than their number.
pub const MOST: usize = 4096;
/// How often a piece is halved.
const HALVINGS: usize = 40;
/// By how much errors grow from one try to the next.
const COARSER: f64 = 4.0;
/// And by how much less often pieces are halved: where two parts of a mixture both have a thousand steps, the places between steps are
/// more than [`MOST`] at any error.
const LESS_DEEP: usize = 4;
/// How far below its peak a profile is followed.
const DEPTH: f64 = 75.0;
/// `r` times the width of a piece, at least: less is an exponential.
const LEAST_GROWTH: f64 = 1e-3;
/// And at most.
const GREATEST_GROWTH: f64 = 1e6;

impl Piece {
    /// Nothing from a place on.
    pub fn empty(start: f64) -> Self {
        Self { start, anchor: start, rate: 0.0, log_f: f64::NEG_INFINITY, exponent: 0.0 }
    }

    /// t at s.
    pub fn t(&self, s: f64) -> f64 {
        (s - self.anchor).mul_add(self.rate, 1.0)
    }

    /// ln f at s.
    pub fn log_at(&self, s: f64) -> f64 {
        let log_t = ((s - self.anchor) * self.rate).max(-1.0).ln_1p();
        if log_t == 0.0 { self.log_f } else { self.exponent.mul_add(-log_t, self.log_f) }
    }

    /// The same with another anchor, where t is positive.
    pub fn anchored(&self, anchor: f64) -> Self {
        Self { anchor, rate: self.rate / self.t(anchor), log_f: self.log_at(anchor), ..*self }
    }

    /// |d ln f / d ln x| at s.
    pub fn steepness(&self, s: f64) -> f64 {
        (2.0 * self.exponent * self.rate * s / self.t(s)).abs()
    }
}

/// The pieces of a profile, from 0 on; the last one never ends.
pub fn pieces(profile: &dyn Profile) -> Vec<Piece> {
    if let Some(exact) = profile.pieces() {
        return exact;
    }
    let mut ends = vec![0.0];
    ends.extend(profile.breaks(DEPTH).into_iter().map(|x| x * x).filter(|s| *s > 0.0 && *s < 1e36));
    ends.dedup();
    let peak = greatest(ends.iter().map(|s| profile.f(s.sqrt())));
    let (mut permitted, mut halvings) = (PERMITTED, HALVINGS);
    loop {
        let mut found = Vec::new();
        for pair in ends.windows(2) {
            // just inside: f may have a step at a break point
            let inside = [pair[0].sqrt().next_up().next_up(), pair[1].sqrt().next_down().next_down()];
            let sides = [0, 1].map(|k| (pair[k], profile.f(inside[k]).ln()));
            divide(profile, sides, (permitted, peak.ln() + FAINT.ln()), halvings, &mut found);
        }
        if found.len() <= MOST || halvings == 0 {
            let end = ends[ends.len() - 1];
            if profile.f(end.sqrt() * 1.0001) == 0.0 {
                found.push(Piece::empty(end));
            }
            return found;
        }
        permitted *= COARSER;
        halvings = halvings.saturating_sub(LESS_DEEP);
    }
}

/// Appends the pieces between two points (s, ln f).
fn divide(
    profile: &dyn Profile,
    [left, right]: [(f64, f64); 2],
    (permitted, faint): (f64, f64),
    depth: usize,
    found: &mut Vec<Piece>,
) {
    // the next try is coarser
    if found.len() > MOST && depth > 0 {
        return;
    }
    let log_f = |s: f64| profile.f(s.sqrt()).ln();
    let width = right.0 - left.0;
    let middle = 0.5 * (left.0 + right.0);
    let piece = if left.1 == f64::NEG_INFINITY || right.1 == f64::NEG_INFINITY {
        Piece::empty(left.0)
    } else {
        through(left, (middle, log_f(middle)), right)
    };
    let error = greatest([0.02_f64, 0.15, 0.5, 0.85].map(|part| {
        let s = part.mul_add(width, left.0);
        let (exact, reached) = (log_f(s), piece.log_at(s));
        if exact == reached { 0.0 } else { (exact - reached).abs() }
    }));
    let bright = left.1.max(right.1) > faint;
    let permitted_here = if bright { permitted } else { FAINT_FACTOR * permitted };
    if error <= permitted_here || depth == 0 || !(middle > left.0 && middle < right.0) {
        found.push(piece);
        return;
    }
    // wide ones in the logarithm
    let at = if left.0 > 0.0 && right.0 > 4.0 * left.0 { (left.0 * right.0).sqrt() } else { middle };
    let between = (at, log_f(at));
    divide(profile, [left, between], (permitted, faint), depth - 1, found);
    divide(profile, [between, right], (permitted, faint), depth - 1, found);
}

/// The piece with given values at three points.
fn through(left: (f64, f64), middle: (f64, f64), right: (f64, f64)) -> Piece {
    let (width, rise) = (right.0 - left.0, right.1 - left.1);
    let half = (middle.0 - left.0) / width;
    // ln(1 + h g)/ln(1 + g) grows from 0 at g = −1 to 1 at infinity
    let wanted = (middle.1 - left.1) / rise;
    let share = |growth: f64| (half * growth).ln_1p() / growth.ln_1p();
    let growth = if rise == 0.0 || !(wanted > share(-0.999) && wanted < share(GREATEST_GROWTH)) {
        // no such piece has a peak: a straight one, to be halved
        LEAST_GROWTH
    } else {
        let (mut low, mut high) = if wanted < half { (-0.999, -1e-9) } else { (1e-9, GREATEST_GROWTH) };
        for _ in 0..80 {
            let at = if high > 1.0 && low > 0.0 { (low * high).sqrt() } else { 0.5 * (low + high) };
            if share(at) < wanted { low = at } else { high = at }
        }
        let growth: f64 = 0.5 * (low + high);
        if growth.abs() < LEAST_GROWTH { LEAST_GROWTH.copysign(growth) } else { growth }
    };
    Piece { start: left.0, anchor: left.0, rate: growth / width, log_f: left.1, exponent: -rise / growth.ln_1p() }
}

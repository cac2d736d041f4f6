//! One fuzzed input: raw bytes to parameters, and what must hold for whatever the core accepts.

use glam::DVec3;
use sgtd_core::family::shape::Shape;
use sgtd_core::family::skewed_t::SkewedT;
use sgtd_core::ndf::{Ndf, NormalSample, Normals, Roughness, Shadowing};
use sgtd_core::profile::cells::{BUCKET, CELL, OCTAVES};
use sgtd_core::profile::{MixtureProfile, Part, Profile, ProfileCells, TableTail, TabulatedProfile};
use std::sync::Arc;

/// xorshift64* (Vigna 2016).
#[derive(Debug, Clone)]
pub struct Bits(u64);

impl Bits {
    /// Any seed.
    pub fn new(seed: u64) -> Self {
        // SplitMix64, so that neighboring seeds have nothing in common; a state of 0 would stay there
        let mut z = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        Self((z ^ (z >> 31)) | 1)
    }

    /// 64 random bits.
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn log_between(&mut self, low: f64, high: f64) -> f64 {
        (low.ln() + self.unit() * (high / low).ln()).exp()
    }

    /// Any bit pattern: not numbers, infinities and denormals included.
    fn raw(&mut self) -> f64 {
        f64::from_bits(self.next())
    }

    fn one_of<const N: usize>(&mut self, values: [f64; N]) -> f64 {
        values[(self.next() % N as u64) as usize]
    }

    /// An edge value, a value from inside, or any bit pattern.
    fn mixed<const N: usize>(&mut self, edges: [f64; N], inside: impl Fn(&mut Self) -> f64) -> f64 {
        match self.next() % 8 {
            0 => self.one_of(edges),
            1 => self.one_of(edges) * (1.0 + 1e-12 * (self.unit() - 0.5)),
            2 if self.next().is_multiple_of(8) => self.raw(),
            _ => inside(self),
        }
    }
}

/// Parameters of a shape as a user might set them; most, but not all of them, are accepted.
#[derive(Debug, Clone, Copy)]
pub struct Parameters {
    gamma: f64,
    p: f64,
    lambda: f64,
    shift: f64,
    accuracy: f64,
}

impl Parameters {
    /// Draws them.
    pub fn draw(bits: &mut Bits) -> Self {
        let p = bits.mixed([0.1, 0.25, 0.5, 1.0, 2.0, 50.0, 100.0], |b| b.log_between(0.1, 100.0));
        let gamma =
            bits.mixed([1.0, 1.05, 1.5, 2.0, 2.5, 16.0, 1e6, 1e12, 1e300, f64::MAX, f64::INFINITY], |b| {
                match b.next() % 4 {
                    0 => f64::INFINITY,
                    1 => (3.0 + b.log_between(1e-12, 10.0)) / (2.0 * p),
                    2 => 1.0 + b.log_between(1e-3, 100.0),
                    _ => b.log_between(1.5, 1e13),
                }
            });
        let lambda = bits.mixed([0.0, -0.0, 5e-324, 0.9999, -0.9999, 0.999, -0.999], |b| {
            let size = 1.0 - b.log_between(1e-4, 1.0);
            if b.next() % 2 == 0 { size } else { -size }
        });
        let shift = bits.mixed([0.0, 0.0, 5e-324, 1e-300, 1.0, 1e3, 1e4], |b| b.log_between(1e-8, 1e4));
        let accuracy = bits.mixed([1e-3, 1e-2, 0.1, 1e-7, 5e-324, -1.0], |b| b.log_between(1e-6, 0.1));
        Self { gamma, p, lambda, shift, accuracy }
    }

    /// The core's object, or `None` where the parameters are refused. `reference` asks for quadrature on every call.
    pub fn build(&self, reference: bool) -> Option<Ndf> {
        let shape = Shape::new(self.gamma, self.p, self.lambda, self.shift).ok()?;
        Ndf::new(Box::new(SkewedT::new(shape)), if reference { 0.0 } else { self.accuracy }).ok()
    }

    /// In a form that can be read back to the last bit.
    pub fn bits(&self) -> String {
        let numbers = [self.gamma, self.p, self.lambda, self.shift, self.accuracy];
        format!("{self:?} = {:016x?}", numbers.map(f64::to_bits))
    }
}

/// A table as a user might bring it, or a mixture of two.
#[derive(Debug, Clone)]
pub struct Tables {
    tables: Vec<(Vec<f64>, Vec<f64>, TableTail)>,
    accuracy: f64,
    weight: f64,
    scale: f64,
}

impl Tables {
    /// Draws them; many, but not all of them, are accepted.
    pub fn draw(bits: &mut Bits) -> Self {
        let tables = (0..1 + u64::from(bits.next().is_multiple_of(4))).map(|_| Self::table(bits)).collect();
        let accuracy = bits.log_between(1e-6, 0.1);
        Self { tables, accuracy, weight: bits.log_between(1e-12, 1.0), scale: bits.log_between(1e-4, 1e4) }
    }

    fn table(bits: &mut Bits) -> (Vec<f64>, Vec<f64>, TableTail) {
        let count = match bits.next() % 16 {
            0 => 2,
            1 => 250,
            2 if bits.next().is_multiple_of(8) => 1000,
            _ => 2 + bits.next() % 40,
        };
        let unit = bits.log_between(1e-5, 1e3);
        let mut slopes: Vec<f64> = match bits.next() % 3 {
            0 => (0..count).map(|k| unit * k as f64).collect(),
            1 => (0..count).map(|_| unit * bits.log_between(1e-12, 1e3)).collect(),
            _ => (0..count).map(|_| unit * (1.0 + bits.log_between(1e-15, 1e2))).collect(),
        };
        slopes.sort_by(f64::total_cmp);
        let kind = bits.next() % 8;
        let steep = bits.log_between(0.1, 50.0);
        let values = slopes
            .iter()
            .map(|&x| match kind {
                0 => (1.0 + (x / unit).powi(2)).powf(-steep),
                1 => (-(x / unit).powi(2)).exp(),
                2 => bits.unit(),
                3 => bits.log_between(1e-300, 1e300),
                4 => bits.log_between(1e-20, 1.0),
                5 => bits.one_of([0.0, 1.0, 1e-300, 5e-324, 0.5]),
                6 if bits.next().is_multiple_of(64) => bits.raw(),
                _ => (1.0 + (x / unit).powi(2)).powi(-2) * (0.9 + 0.2 * bits.unit()),
            })
            .collect();
        let tail = match bits.next() % 4 {
            0 => TableTail::Cut,
            1 => TableTail::Power(None),
            _ => TableTail::Power(Some(3.0 + bits.log_between(1e-6, 1e3))),
        };
        (slopes, values, tail)
    }

    /// The core's object, or `None` where the tables are refused.
    pub fn build(&self, reference: bool) -> Option<Ndf> {
        Ndf::new(self.profile()?, if reference { 0.0 } else { self.accuracy }).ok()
    }

    /// The profile alone.
    pub fn profile(&self) -> Option<Box<dyn Profile>> {
        let new = |(slopes, values, tail): &(Vec<f64>, Vec<f64>, TableTail)| {
            TabulatedProfile::new(slopes, values, *tail).ok()
        };
        let first = new(&self.tables[0])?;
        let Some(second) = self.tables.get(1) else { return Some(Box::new(first)) };
        let parts = vec![
            Part { weight: 1.0, scale: 1.0, profile: Arc::new(first) },
            Part { weight: self.weight, scale: self.scale, profile: Arc::new(new(second)?) },
        ];
        Some(Box::new(MixtureProfile::new(parts).ok()?))
    }
}

/// What one evaluation of everything is given.
#[derive(Debug, Clone, Copy)]
pub struct Input {
    alpha: Roughness,
    wi: DVec3,
    wo: DVec3,
    m: DVec3,
    u: (f64, f64),
    x: f64,
}

/// A unit vector, or now and then one that is not.
fn direction(bits: &mut Bits) -> DVec3 {
    let kind = bits.next();
    if kind.is_multiple_of(64) {
        return DVec3::new(bits.raw(), bits.raw(), bits.raw());
    }
    let phi = 2.0 * std::f64::consts::PI * bits.unit();
    let cos = match kind % 8 {
        1 => bits.one_of([0.0, -0.0, 1.0, -1.0, 5e-324, 1e-300, 1e-30, 1e-7, 1e-4, 0.5, 1.0 - 1.2e-16, 1.0 - 1e-9]),
        2 => bits.log_between(1e-20, 1.0),
        3 => 1.0 - bits.log_between(1e-16, 1.0),
        4 => -bits.unit(),
        _ => bits.unit(),
    };
    let sin = ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt();
    match kind % 5 {
        0 => DVec3::new(sin, 0.0, cos),
        1 => DVec3::new(0.0, -sin, cos),
        _ => DVec3::new(sin * phi.cos(), sin * phi.sin(), cos),
    }
}

impl Input {
    /// The stretched slope.
    #[allow(dead_code)] // the test of this target does not ask for it
    pub fn x(&self) -> f64 {
        self.x
    }

    /// Draws one.
    pub fn draw(bits: &mut Bits) -> Self {
        let roughness = |b: &mut Bits| loop {
            let value = b.mixed([1e-6, 1e-4, 0.1, 1.0, 10.0, 1e6], |b| b.log_between(1e-4, 10.0));
            // the constructor refuses what is out of range
            if Roughness::new(value, value).is_ok() {
                return value;
            }
        };
        let (u, v) = (roughness(bits), roughness(bits));
        let number = |b: &mut Bits| match b.next() % 8 {
            0 => b.one_of([0.0, 5e-324, 1e-300, 0.5, 1.0 - 2f64.powi(-24), 1.0f64.next_down(), 2f64.powi(-24)]),
            _ => b.unit(),
        };
        let (wi, wo, m) = (direction(bits), direction(bits), direction(bits));
        // the same direction twice, and the normal that reflects one into the other
        let wo = if bits.next().is_multiple_of(16) { wi } else { wo };
        let m = if bits.next().is_multiple_of(4) { (wi + wo).normalize_or(DVec3::Z) } else { m };
        let x = bits.mixed([0.0, 5e-324, 1e-300, 1.0, 1e3, 1e154, 1e200, f64::MAX], |b| b.log_between(1e-12, 1e12));
        let x = if x >= 0.0 { x } else { 1.0 };
        Self { alpha: Roughness { u, v }, wi, wo, m, u: (number(bits), number(bits)), x }
    }
}

/// Evaluates everything; says what is wrong with the first bad value, and gives the input as bits.
pub fn check(ndf: &Ndf, input: &Input) -> Result<(), String> {
    let Input { alpha, wi, wo, m, u, x } = *input;
    let fail = |what: &str, value: f64| {
        let numbers = [alpha.u, alpha.v, wi.x, wi.y, wi.z, wo.x, wo.y, wo.z, m.x, m.y, m.z, u.0, u.1, x];
        Err(format!("{what} = {value:e} at {input:?} = {:016x?}", numbers.map(f64::to_bits)))
    };
    // raw vectors need not give a number, but must not make anything panic
    let unit = [wi, wo, m].map(|w| (w.length() - 1.0).abs() < 1e-6);
    let bounded = |value: f64, most: f64| value >= 0.0 && value <= most;
    let finite = |value: f64| bounded(value, f64::MAX);

    let (d, pdf) = (ndf.d(alpha, m), ndf.pdf_projected(alpha, m));
    let visible = ndf.pdf_visible(alpha, wi, m);
    let (lambda, g1_i, g1_o) = (ndf.lambda(alpha, wi), ndf.g1(alpha, wi), ndf.g1(alpha, wo));
    // the heaviest tail lets D grow like tan θ, of which f keeps 1e108; more is an overflow that was clipped
    if unit[2] && !bounded(d, 1e200) {
        return fail("D", d);
    }
    if unit[2] && !finite(pdf) {
        return fail("pdf of D cos", pdf);
    }
    if unit[0] && unit[2] && !finite(visible) {
        return fail("pdf of visible normals", visible);
    }
    if unit[0] && !finite(lambda) {
        return fail("Λ", lambda);
    }
    if unit[0] && !bounded(g1_i, 1.0) {
        return fail("G1", g1_i);
    }
    for shadowing in [Shadowing::Separable, Shadowing::HeightCorrelated] {
        let g2 = ndf.g2(alpha, wi, wo, shadowing);
        if unit[0] && unit[1] && !bounded(g2, g1_i.min(g1_o)) {
            return fail("G2", g2);
        }
    }
    let reflecting = ndf.pdf(alpha, wi, m, Normals::Reflecting);
    if unit[0] && unit[2] && !finite(reflecting) {
        return fail("pdf of bounded visible normals", reflecting);
    }
    let samples = [
        (ndf.sample_visible(alpha, wi, u), unit[0]),
        (ndf.sample(alpha, wi, u, Normals::Reflecting), unit[0]),
        (ndf.sample_projected(alpha, u), true),
    ];
    for (NormalSample { m, pdf, d_over_pdf }, applies) in samples {
        if applies && !finite(pdf) {
            return fail("pdf of a sample", pdf);
        }
        if applies && !finite(d_over_pdf) {
            return fail("D/pdf of a sample", d_over_pdf);
        }
        if applies && !((m.length() - 1.0).abs() < 1e-9 && m.z >= 0.0) {
            return fail("length of a sampled normal", m.length());
        }
    }
    check_profile(ndf.profile(), x)
}

/// What a profile says of one slope.
pub fn check_profile(profile: &dyn Profile, x: f64) -> Result<(), String> {
    let fail = |what: &str, value: f64| Err(format!("{what} = {value:e} at {x:e} = {:016x}", x.to_bits()));
    let bounded = |value: f64, most: f64| value >= 0.0 && value <= most;
    let (f, cdf, sf) = (profile.f(x), profile.cdf(x), profile.sf(x));
    if !bounded(f, 1.0 + 1e-12) {
        return fail("f", f);
    }
    if !bounded(cdf, 1.0) {
        return fail("cdf", cdf);
    }
    if !bounded(sf, 1.0) {
        return fail("sf", sf);
    }
    if !((cdf + sf - 1.0).abs() < 1e-10) {
        return fail("cdf + sf", cdf + sf);
    }
    Ok(())
}

/// Inverses cost ten times as much as everything else, so they are checked less often.
pub fn check_inverses(profile: &dyn Profile, input: &Input) -> Result<(), String> {
    for u in [input.u.0, input.u.1] {
        let (low, high) = (profile.quantile(u), profile.isf(u));
        if !((0.0..f64::INFINITY).contains(&low) && high >= 0.0 && (high < f64::INFINITY || u == 0.0)) {
            return Err(format!("quantile = {low:e}, isf = {high:e} at u = {u:e} = {:016x}", u.to_bits()));
        }
        let (cdf, sf) = (profile.cdf(low), profile.sf(high));
        // where no double lies closer, those a few roundings away are on both sides
        let (less, more) = (1.0 - 16.0 * f64::EPSILON, 1.0 + 16.0 * f64::EPSILON);
        let between = |a: f64, b: f64| a.min(b) <= u && u <= a.max(b);
        let near = |got: f64| u < 1e-290 || (got - u).abs() <= 1e-3 * u;
        let good = (near(cdf) || between(profile.cdf(low * less), profile.cdf(low * more)))
            && (near(sf) || between(profile.sf(high * less), profile.sf(high * more)));
        if !good {
            return Err(format!("cdf(quantile) = {cdf:e}, sf(isf) = {sf:e} at u = {u:e} = {:016x}", u.to_bits()));
        }
    }
    Ok(())
}

/// What single precision reads of a profile: every index is one, and every cell is made of numbers.
pub fn check_cells(profile: &dyn Profile) -> Result<(), String> {
    let cells = ProfileCells::new(profile);
    let flat = cells.single();
    let fail = |what: &str, at: usize| Err(format!("{what} at {at} of {} cells", cells.count()));
    for key in (0..2 * OCTAVES).filter(|key| key % OCTAVES < 255) {
        let entry = flat[key].to_bits();
        let shift = entry & 31;
        let buckets = if shift == 31 { 1 } else { 1 << (23 - shift) };
        for bucket in (0..buckets).map(|k| BUCKET * ((entry >> 5) as usize + k)) {
            let Some(found) = flat.get(bucket..bucket + BUCKET) else { return fail("no bucket", key) };
            let more = found[1..].iter().filter(|start| **start < f32::MAX).count();
            let first = found[0].to_bits() as usize;
            if !found[1..].is_sorted() || found[1..].iter().any(|start| start.is_nan()) {
                return fail("starts out of order", key);
            }
            for cell in first..=first + more {
                let Some(cell) = flat.get(CELL * cell..CELL * (cell + 1)) else { return fail("no cell", key) };
                if cell.iter().any(|number| !number.is_finite()) {
                    return fail("a number that is none", key);
                }
            }
        }
    }
    Ok(())
}

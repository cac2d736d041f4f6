//! Shapes and numbers that tests are fed with, from four sources: a list, the edges of the domain, an even spacing,
//! chance.
#![allow(dead_code)] // every test crate uses a part of it

pub mod altered;
pub mod piecewise;
pub mod second_moment;
pub mod tables;

use glam::DVec3;
use sgtd_core::family::shape::{ROWS, Shape};
use sgtd_core::family::skewed_t::SkewedT;
use std::f64::consts::PI;

/// Four shape parameters, not yet validated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    /// γ
    pub gamma: f64,
    /// p
    pub p: f64,
    /// λ
    pub lambda: f64,
    /// m
    pub shift: f64,
}

const fn case(gamma: f64, p: f64, lambda: f64, shift: f64) -> Case {
    Case { gamma, p, lambda, shift }
}

impl Case {
    /// The validated shape.
    pub fn shape(&self) -> Shape {
        Shape::new(self.gamma, self.p, self.lambda, self.shift).unwrap_or_else(|error| panic!("{self:?}: {error}"))
    }

    /// Its profile.
    pub fn profile(&self) -> SkewedT {
        SkewedT::new(self.shape())
    }

    /// 2pγ − 3, which masking needs positive.
    pub fn excess(&self) -> f64 {
        (2.0 * self.p).mul_add(self.gamma, -3.0)
    }
}

const INF: f64 = f64::INFINITY;

/// Every kind of profile, and the shapes that are known to be hard.
pub const LIST: [Case; 40] = [
    // nodes of the family
    case(2.0, 1.0, 0.0, 0.0),
    case(INF, 1.0, 0.0, 0.0),
    case(3.0, 1.0, 0.0, 0.0),
    case(2.5, 1.0, 0.3, 0.4),
    case(2.5, 1.5, 0.4, 0.7),
    case(INF, 1.7, 0.3, 0.9),
    case(INF, 0.5, 0.0, 0.0),
    case(INF, 1.0, 0.5, 0.7),
    case(2.0, 1.0, 0.0, 0.5),
    case(INF, 1.0, 0.0, 0.5),
    case(4.0, 3.0, 0.0, 1.0),
    case(2.0, 1.5, 0.0, 0.6),
    // tails near the limit of finite masking
    case(1.501, 1.0, 0.0, 0.0),
    case(1.5005, 1.0, 0.0, 2.0),
    case(1.55, 1.0, 0.3, 0.5),
    case(1.6, 1.0, 0.0, 0.0),
    case(6.002, 0.25, 0.6, 0.8),
    case(1.05, 1.4291, -0.3, 0.1),
    case(1.05, 30.0, 0.4, 0.5),
    // boxes
    case(2.0, 50.0, 0.0, 0.0),
    case(INF, 50.0, 0.0, 0.0),
    case(INF, 20.0, 0.0, 2.0),
    case(1.7, 50.0, -0.9, 0.4),
    // cusps
    case(INF, 0.25, 0.0, 0.5),
    case(8.0, 0.25, 0.0, 0.0),
    case(30.0, 0.25, -0.5, 3.0),
    case(6.1, 0.25, 0.0, 0.5),
    // rings
    case(2.0, 1.0, 0.0, 5.0),
    case(INF, 1.0, 0.0, 100.0),
    case(2.0, 1.0, 0.0, 1000.0),
    case(INF, 1.0, 0.999, 1000.0),
    case(4.0, 50.0, 0.2, 1000.0),
    case(3.0, 2.0, 0.5, 30.0),
    // skews
    case(2.0, 1.0, 0.95, 0.5),
    case(INF, 1.0, -0.99, 0.3),
    case(3.0, 1.3, -0.9, 5.0),
    case(2.0, 1.0, -0.999, 4.0),
    // γ where it is almost infinite
    case(1e6, 1.0, 0.0, 0.0),
    case(1e12, 1.5, 0.2, 0.4),
    case(200.0, 1.0, 0.1, 0.01),
];

/// One shape for each of the ten named rows, none at a node that another row has too where the row leaves a choice.
pub fn row_cases() -> Vec<(&'static str, Case)> {
    let parameters = [
        (Some(1.9), Some(1.3), Some(0.4), 0.6),
        (Some(1.7), Some(1.4), None, 0.3),
        (None, Some(0.8), Some(-0.5), 1.0),
        (Some(2.2), None, Some(0.5), 0.4),
        (None, Some(2.5), None, 0.8),
        (None, None, Some(0.6), 0.5),
        (Some(1.6), None, None, 0.0),
        (Some(2.3), None, None, 0.0),
        (None, None, None, 0.7),
        (None, None, None, 1.5),
    ];
    ROWS.iter()
        .zip(parameters)
        .map(|(row, (gamma, p, lambda, shift))| {
            let shape = row.shape(gamma, p, lambda, Some(shift)).unwrap_or_else(|error| panic!("{error}"));
            (row.name, case(shape.gamma(), shape.p(), shape.lambda(), shape.shift()))
        })
        .collect()
}

/// The domain for which accuracy is promised.
pub mod domain {
    /// Least finite γ.
    pub const GAMMA_MIN: f64 = 1.05;
    /// Greatest finite γ.
    pub const GAMMA_MAX: f64 = 1e12;
    /// Range of p.
    pub const P: (f64, f64) = (0.25, 50.0);
    /// Greatest |λ|.
    pub const LAMBDA: f64 = 0.999;
    /// Greatest m.
    pub const SHIFT: f64 = 1e3;
    /// Least 2pγ − 3.
    pub const EXCESS: f64 = 1e-3;
}

/// γ raised to where masking is promised at this p.
fn admissible(gamma: f64, p: f64, lambda: f64, shift: f64) -> Case {
    let least = (3.0 + domain::EXCESS) / (2.0 * p) * (1.0 + f64::EPSILON);
    case(gamma.max(least), p, lambda, shift)
}

/// Corners of the domain.
pub fn edge_shapes() -> Vec<Case> {
    let mut cases = Vec::new();
    for gamma in [domain::GAMMA_MIN, domain::GAMMA_MAX, INF] {
        for p in [domain::P.0, 1.0, domain::P.1] {
            for lambda in [-domain::LAMBDA, 0.0, domain::LAMBDA] {
                for shift in [0.0, 1e-300, domain::SHIFT] {
                    cases.push(admissible(gamma, p, lambda, shift));
                }
            }
        }
    }
    cases
}

/// A lattice through the domain; λ and m step through their values side by side.
pub fn spaced_shapes() -> Vec<Case> {
    let skews = [(0.0, 0.0), (0.5, 0.1), (-0.7, 1.0), (0.9, 30.0), (-0.95, 0.3)];
    let mut cases = Vec::new();
    for gamma in [1.05, 1.2, 1.7, 3.0, 8.0, 15.9, 40.0, 1e3, 1e6, INF] {
        for p in [0.25, 0.6, 1.0, 2.3, 7.0, 50.0] {
            let (lambda, shift) = skews[cases.len() % skews.len()];
            cases.push(admissible(gamma, p, lambda, shift));
        }
    }
    cases
}

/// Shapes by chance, denser towards the edges of the domain.
pub fn random_shapes(random: &mut Random, count: usize) -> Vec<Case> {
    (0..count)
        .map(|_| {
            let p = random.log_between(domain::P.0, domain::P.1);
            let gamma = match random.below(4) {
                0 => INF,
                // 2pγ − 3 by decades
                1 => ((3.0 + random.log_between(domain::EXCESS, 10.0)) / (2.0 * p)).max(domain::GAMMA_MIN),
                2 => 1.0 + random.log_between(0.05, 20.0),
                _ => random.log_between(2.0, domain::GAMMA_MAX),
            };
            let lambda = match random.below(3) {
                0 => 0.0,
                1 => random.sign() * (1.0 - random.log_between(1.0 - domain::LAMBDA, 1.0)),
                _ => random.sign() * random.log_between(1e-8, domain::LAMBDA),
            };
            let shift = if random.below(3) == 0 { 0.0 } else { random.log_between(1e-6, domain::SHIFT) };
            admissible(gamma, p, lambda, shift)
        })
        .collect()
}

/// The environment variable that replaces the fixed seed.
const SEED_VARIABLE: &str = "SGTD_TEST_SEED";

/// PCG-XSH-RR 64/32 (O'Neill 2014): small, seeded, the same on every machine.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// Seeded from the environment, or with a fixed number; prints the seed, so that a failure can be repeated.
    pub fn seeded(what: &str) -> Self {
        let seed = std::env::var(SEED_VARIABLE).ok().and_then(|text| text.parse().ok()).unwrap_or(20190707);
        println!("{what}: seed {seed} (set {SEED_VARIABLE} for another)");
        Self::new(seed)
    }

    /// With a given seed.
    pub fn new(seed: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x853C_49E6_748F_EA9B);
        random.bits();
        random
    }

    /// 32 random bits.
    pub fn bits(&mut self) -> u32 {
        let old = self.0;
        self.0 = old.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((((old >> 18) ^ old) >> 27) as u32).rotate_right((old >> 59) as u32)
    }

    /// Evenly in [0, 1), all 53 bits.
    pub fn unit(&mut self) -> f64 {
        let bits = (u64::from(self.bits()) << 21) ^ (u64::from(self.bits()) >> 11);
        bits as f64 / (1u64 << 53) as f64
    }

    /// Evenly between two numbers.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + self.unit() * (high - low)
    }

    /// Evenly in the logarithm between two positive numbers.
    pub fn log_between(&mut self, low: f64, high: f64) -> f64 {
        (self.between(low.ln(), high.ln())).exp().clamp(low, high)
    }

    /// A whole number below `n`.
    pub fn below(&mut self, n: u32) -> u32 {
        self.bits() % n
    }

    /// 1 or −1.
    pub fn sign(&mut self) -> f64 {
        if self.below(2) == 0 { 1.0 } else { -1.0 }
    }

    /// A direction of the upper hemisphere, often close to the horizon or the pole.
    pub fn direction(&mut self) -> DVec3 {
        let phi = self.between(-PI, PI);
        let theta = match self.below(4) {
            0 => self.log_between(1e-9, 1.0),
            1 => PI / 2.0 - self.log_between(1e-9, 1.0),
            _ => self.between(0.0, PI / 2.0),
        };
        direction(theta, phi)
    }
}

/// The unit vector with these polar angles.
pub fn direction(theta: f64, phi: f64) -> DVec3 {
    let (sin, cos) = theta.sin_cos();
    DVec3::new(sin * phi.cos(), sin * phi.sin(), cos)
}

//! Gauss–Legendre rules for smooth panels.

use std::sync::OnceLock;

/// Nodes on (0, 1) and weights of an n-point Gauss–Legendre rule.
#[derive(Debug)]
pub struct Gauss {
    nodes: Vec<(f64, f64)>,
}

/// The n-point rule, n ≤ 64; computed once per n.
pub fn gauss(n: usize) -> &'static Gauss {
    static RULES: [OnceLock<Gauss>; 65] = [const { OnceLock::new() }; 65];
    RULES[n.min(64)].get_or_init(|| Gauss::new(n.min(64)))
}

impl Gauss {
    fn new(n: usize) -> Self {
        let legendre = |x: f64| {
            // recurrence of DLMF 18.9.1, with the derivative from 18.9.18
            let (mut previous, mut current) = (1.0, x);
            for k in 1..n {
                let k = k as f64;
                (previous, current) = (current, ((2.0 * k + 1.0) * x * current - k * previous) / (k + 1.0));
            }
            (current, n as f64 * (x * current - previous) / (x * x - 1.0))
        };
        let nodes = (0..n)
            .map(|i| {
                let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
                for _ in 0..8 {
                    let (value, slope) = legendre(x);
                    x -= value / slope;
                }
                let (_, slope) = legendre(x);
                (0.5 - 0.5 * x, 1.0 / ((1.0 - x * x) * slope * slope))
            })
            .collect();
        Self { nodes }
    }

    /// Nodes on (0, 1) with their weights.
    pub fn nodes(&self) -> &[(f64, f64)] {
        &self.nodes
    }

    /// `∫_a^b f`.
    pub fn integrate(&self, a: f64, b: f64, mut f: impl FnMut(f64) -> f64) -> f64 {
        (b - a) * self.nodes.iter().map(|&(t, w)| w * f(a + t * (b - a))).sum::<f64>()
    }
}

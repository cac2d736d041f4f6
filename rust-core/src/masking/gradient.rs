//! How masking and the normalization follow the parameters of a profile.
//!
//! With `W(q) = ∫_q^∞ f w dρ`, `w = ρ [√(ρ²−q²) − q acos(q/ρ)]`, and `N = ∫₀^∞ ρ f dρ = 1/(2A)`, `H = W/(πN)`, so
//!
//! `∂ ln A/∂θ = −2A ∂N/∂θ`, `∂H/∂θ = (2A/π) ∂W/∂θ + H ∂ ln A/∂θ`, and the same for S = −H′ with `v = −∂w/∂q = ρ acos(q/ρ)`.
//!
//! The differentiation is under the integral, as `Term` describes it: the kernels are w, w′, v and v′.

use crate::masking::integral::{Rule, panel_edges};
use crate::masking::smith_kernel::{bracket, far_series};
use crate::numerics::quadrature::gauss;
use crate::profile::derivatives::{Derivatives, PARAMETERS, Term};
use crate::profile::{Masking, Profile, Tail};
use std::f64::consts::FRAC_2_PI;

/// From this fraction of the last edge on a power tail is followed by its law.
const FAR: f64 = 2.0;

/// The derivatives of one profile: a fixed sampling of f and of its terms.
#[derive(Debug, Clone)]
pub struct MaskingGradient {
    /// A
    normalization: f64,
    /// Left and right ends
    panels: Vec<(f64, f64)>,
    nodes: Vec<Node>,
    points: usize,
    log_normalization: [f64; PARAMETERS],
    end: Option<End>,
}

/// One point of a panel.
#[derive(Debug, Clone, Copy)]
struct Node {
    /// ρ − left end
    past: f64,
    /// weight · f
    mass: f64,
    terms: [Term; PARAMETERS],
}

/// A power tail from `from` on: `f = height (ρ/from)^(−3−excess)`.
#[derive(Debug, Clone)]
struct End {
    from: f64,
    /// or is what lies beyond so little that it does not count?
    is_exact: bool,
    height: f64,
    excess: f64,
    terms: [Term; PARAMETERS],
    /// ∂ excess/∂θ: `α` falls by so much per e-fold of ρ
    falls: [f64; PARAMETERS],
}

/// ∂H/∂θ and ∂S/∂θ at one argument, by 1/γ, p, λ and m.
pub type ByParameter = [Masking; PARAMETERS];

/// W and V, and their derivatives.
#[derive(Clone, Copy)]
struct Sums {
    value: Masking,
    by: ByParameter,
}

impl Sums {
    const ZERO: Self = Self { value: Masking { h: 0.0, s: 0.0 }, by: [Masking { h: 0.0, s: 0.0 }; PARAMETERS] };

    #[inline]
    fn add(&mut self, q: f64, rho: f64, past: f64, node: (f64, &[Term; PARAMETERS])) {
        let (mass, terms) = node;
        let height = (past * (rho + q)).sqrt();
        let (k, angle) = bracket(q, rho, past);
        let (w, v) = (mass * rho * k, mass * rho * angle);
        let (w_slope, v_slope) = (mass * (k + height), mass * (angle + q / height));
        self.value.h += w;
        self.value.s += v;
        for (by, term) in self.by.iter_mut().zip(terms) {
            by.h += term.alpha * w + term.beta * w_slope;
            by.s += term.alpha * v + term.beta * v_slope;
        }
    }
}

impl MaskingGradient {
    /// Samples a profile; `None` if it has no derivatives.
    ///
    /// With [`Rule::REFERENCE`] the relative error is below 1e-9 of the greatest of a derivative's parts.
    pub fn new(profile: &dyn Profile, rule: Rule) -> Option<Self> {
        let derivatives = profile.derivatives()?;
        let edges = panel_edges(profile, rule.depth());
        let points = rule.points();
        let rule = gauss(points);
        let mut nodes = Vec::with_capacity(points * edges.len());
        for ends in edges.windows(2) {
            let (left, width) = (ends[0], ends[1] - ends[0]);
            nodes.extend(rule.nodes().iter().map(|&(t, weight)| {
                let past = t * width;
                let terms = derivatives.terms(left, past);
                Node { past, mass: weight * width * profile.f_past(left, past), terms }
            }));
        }
        let panels: Vec<(f64, f64)> = edges.windows(2).map(|ends| (ends[0], ends[1])).collect();
        let end = match (profile.tail(), edges.last()) {
            (Tail::Power { excess, exact_from }, Some(&from)) => Some(End {
                from,
                is_exact: from / FAR >= exact_from,
                height: profile.f(from),
                excess,
                terms: derivatives.terms(from, 0.0),
                falls: derivatives.excess(),
            }),
            _ => None,
        };
        // ∂N/∂θ, by the kernel ρ, whose derivative is 1
        let mut by = [0.0; PARAMETERS];
        for (&(left, _), nodes) in panels.iter().zip(nodes.chunks(points)) {
            for node in nodes {
                for (by, term) in by.iter_mut().zip(&node.terms) {
                    *by += node.mass * (term.alpha * (left + node.past) + term.beta);
                }
            }
        }
        if let Some(end) = &end {
            let n = end.excess + 1.0;
            for (k, by) in by.iter_mut().enumerate() {
                let alpha = end.terms[k].alpha / n - end.falls[k] / (n * n);
                let beta = end.terms[k].beta / end.from;
                *by += end.height * end.from * end.from * (alpha + end.beta_integral(k, beta, n));
            }
        }
        let normalization = profile.normalization();
        let log_normalization = by.map(|by| -2.0 * normalization * by);
        Some(Self { normalization, panels, nodes, points, log_normalization, end })
    }

    /// `∂ ln A/∂θ` for 1/γ, p, λ and m.
    pub fn log_normalization(&self) -> [f64; PARAMETERS] {
        self.log_normalization
    }

    /// H and S, and their derivatives, at q ≥ 0, for the profile that was sampled.
    pub fn at(&self, profile: &dyn Profile, q: f64) -> (Masking, ByParameter) {
        let (Some(&(_, last)), Some(derivatives)) = (self.panels.last(), profile.derivatives()) else {
            return (Sums::ZERO.value, Sums::ZERO.by);
        };
        let sum = |q: f64| self.normalized(self.sum(profile, derivatives, q));
        if let Some(end) = &self.end
            && end.is_exact
            && q > end.from / FAR
        {
            // self-similar: H falls by the power e, whose own derivative adds a logarithm
            let from = end.from / FAR;
            let Sums { value, by } = sum(from);
            let (fold, fall) = ((q / from).ln(), (q / from).powf(-end.excess));
            let mut result = [Masking { h: 0.0, s: 0.0 }; PARAMETERS];
            for (k, result) in result.iter_mut().enumerate() {
                let h = by[k].h - value.h * end.falls[k] * fold;
                *result = Masking { h: fall * h, s: fall / q * (end.excess * h + value.h * end.falls[k]) };
            }
            return (Masking { h: fall * value.h, s: fall * value.s * (from / q) }, result);
        }
        let sums = if q >= last { Sums::ZERO } else { sum(q) };
        (sums.value, sums.by)
    }

    /// From W to H.
    fn normalized(&self, sums: Sums) -> Sums {
        let factor = FRAC_2_PI * self.normalization;
        let value = Masking { h: factor * sums.value.h, s: factor * sums.value.s };
        let mut by = sums.by;
        for (by, log_a) in by.iter_mut().zip(&self.log_normalization) {
            *by = Masking { h: factor * by.h + value.h * log_a, s: factor * by.s + value.s * log_a };
        }
        Sums { value, by }
    }

    fn sum(&self, profile: &dyn Profile, derivatives: &dyn Derivatives, q: f64) -> Sums {
        let mut sums = Sums::ZERO;
        let here = self.panels.partition_point(|&(_, right)| right <= q);
        let mut next = here + 1;
        // from q to the end of its panel, and to that of the next one if the kernel's start is close to it
        let mut ends = vec![q];
        ends.push(self.panels[here].1);
        if let Some(&(left, right)) = self.panels.get(next)
            && left - q < 0.5 * (right - left)
        {
            ends.push(right);
            next += 1;
        }
        // ρ = q + t² makes the kernels' start smooth; no piece crosses a break
        for pair in ends.windows(2) {
            let (from, to) = ((pair[0] - q).sqrt(), (pair[1] - q).sqrt());
            let width = to - from;
            for &(t, weight) in gauss(self.points).nodes() {
                let root = from + t * width;
                let past = root * root;
                let mass = 2.0 * weight * width * root * profile.f_past(q, past);
                sums.add(q, q + past, past, (mass, &derivatives.terms(q, past)));
            }
        }
        let nodes = self.nodes[(next * self.points).min(self.nodes.len())..].chunks(self.points);
        for (&(left, _), nodes) in self.panels[next.min(self.panels.len())..].iter().zip(nodes) {
            let gap = left - q;
            for node in nodes {
                sums.add(q, left + node.past, gap + node.past, (node.mass, &node.terms));
            }
        }
        if let Some(end) = &self.end {
            end.add(q, &mut sums);
        }
        sums
    }
}

impl End {
    /// `∫_1^∞ t^(−1−n) β(t)/t dt`, of a β that grows like ρ (λ) or stays (m), given as `β/from` at `from`.
    fn beta_integral(&self, parameter: usize, beta: f64, n: f64) -> f64 {
        match parameter {
            SKEW => beta / n,
            _ => beta / (n + 1.0),
        }
    }

    /// Adds `∫_from^∞`, by the kernels' series in q/ρ.
    fn add(&self, q: f64, sums: &mut Sums) {
        let ratio = q / self.from;
        let mass = self.height * self.from * self.from * self.from;
        // `Σ c_j (q/ρ)^j` against `t^(−1−e) (α − falls ln t)` gives `c_j ratio^j (α/n − falls/n²)`, n = e + j
        far_series(ratio, |j, power, [w, w_slope, v, v_slope]| {
            let n = self.excess + j as f64;
            sums.value.h += mass * power * w / n;
            sums.value.s += mass * power * v / self.from / (n + 1.0);
            for (k, by) in sums.by.iter_mut().enumerate() {
                let (alpha, fall, beta) = (self.terms[k].alpha, self.falls[k], self.terms[k].beta / self.from);
                let integral = |n: f64| alpha / n - fall / (n * n);
                by.h += mass * power * (w * integral(n) + w_slope * self.beta_integral(k, beta, n));
                by.s +=
                    mass / self.from * power * (v * integral(n + 1.0) + v_slope * self.beta_integral(k, beta, n + 1.0));
            }
        });
    }
}

/// Index of λ.
const SKEW: usize = 2;

//! How masking, the normalization and the mean slope of a table follow its values, at fixed slopes.
//!
//! With `N = ∫ ρ f dρ`, `M = ∫ ρ² f dρ` and the kernel w of masking (see [`gradient`](super::gradient)), a value v that enters as
//! `∂ ln f/∂ ln v = φ` has
//!
//! `∂ ln A = −(1/N) ∫ ρ f φ dρ`, `∂ ln M/N = (1/M) ∫ ρ² f φ dρ − (1/N) ∫ ρ f φ dρ`, `∂H = (1/πN) ∫_q^∞ f w φ dρ + H ∂ ln A`.
//!
//! φ is not 0 in two cells alone, where it is the share of [`Values`]; so there are two sums for each cell, whatever the number of values.

use crate::masking::integral::{Rule, panel_edges};
use crate::masking::smith_kernel::{bracket, far_series};
use crate::numerics::quadrature::gauss;
use crate::profile::derivatives::Values;
use crate::profile::{Masking, Profile, Tail};
use std::f64::consts::FRAC_2_PI;

/// From this fraction of the last edge on a power tail is followed by its law.
const FAR: f64 = 2.0;

/// The derivatives of one table: a fixed sampling of f.
#[derive(Debug, Clone)]
pub struct ValuesGradient {
    count: usize,
    /// A
    normalization: f64,
    panels: Vec<Panel>,
    nodes: Vec<Node>,
    points: usize,
    end: Option<End>,
    log_normalization: Vec<f64>,
    log_mean: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Panel {
    left: f64,
    right: f64,
    cell: usize,
}

/// One point of a panel.
#[derive(Debug, Clone, Copy)]
struct Node {
    /// ρ − left end
    past: f64,
    /// weight · f
    mass: f64,
    share: f64,
}

/// A power tail from `from` on: `f = height (ρ/from)^(−3−excess)`, with a share that grows by `rate` per e-fold of ρ.
#[derive(Debug, Clone, Copy)]
struct End {
    from: f64,
    /// or is what lies beyond so little that it does not count?
    is_exact: bool,
    height: f64,
    excess: f64,
    cell: usize,
    share: f64,
    rate: f64,
}

/// An integral with f, and its derivatives by the logarithms of all values.
struct Sums {
    value: Masking,
    by: Vec<Masking>,
}

impl Sums {
    fn new(count: usize) -> Self {
        let zero = Masking { h: 0.0, s: 0.0 };
        Self { value: zero, by: vec![zero; count] }
    }

    /// Adds what a cell has, and the part of it that its second value has.
    fn add(&mut self, [first, second]: [usize; 2], whole: Masking, part: Masking) {
        self.value = plus(self.value, whole);
        self.by[first] = plus(self.by[first], Masking { h: whole.h - part.h, s: whole.s - part.s });
        self.by[second] = plus(self.by[second], part);
    }
}

fn plus(a: Masking, b: Masking) -> Masking {
    Masking { h: a.h + b.h, s: a.s + b.s }
}

impl ValuesGradient {
    /// Samples a profile; `None` if it is not given by values.
    pub fn new(profile: &dyn Profile, rule: Rule) -> Option<Self> {
        let values = profile.values()?;
        let edges = panel_edges(profile, rule.depth());
        let points = rule.points();
        let rule = gauss(points);
        let mut nodes = Vec::with_capacity(points * edges.len());
        let mut panels = Vec::with_capacity(edges.len());
        for ends in edges.windows(2) {
            let (left, right) = (ends[0], ends[1]);
            let cell = values.cell_of(0.5 * (left + right));
            panels.push(Panel { left, right, cell });
            nodes.extend(rule.nodes().iter().map(|&(t, weight)| {
                let past = t * (right - left);
                let mass = weight * (right - left) * profile.f_past(left, past);
                Node { past, mass, share: values.share(cell, left, past) }
            }));
        }
        let end = match (profile.tail(), edges.last()) {
            (Tail::Power { excess, exact_from }, Some(&from)) => {
                let cell = values.cell_of(from.next_up());
                Some(End {
                    from,
                    is_exact: from / FAR >= exact_from,
                    height: profile.f(from),
                    excess,
                    cell,
                    share: values.share(cell, from, 0.0),
                    rate: values.share_rate_of_tail(),
                })
            }
            _ => None,
        };
        // N and M in the places of H and S
        let mut sums = Sums::new(values.count());
        for (panel, nodes) in panels.iter().zip(nodes.chunks(points)) {
            let (mut whole, mut part) = ([0.0; 2], [0.0; 2]);
            for node in nodes {
                let rho = panel.left + node.past;
                for (k, kernel) in [rho, rho * rho].into_iter().enumerate() {
                    whole[k] += node.mass * kernel;
                    part[k] += node.share * node.mass * kernel;
                }
            }
            sums.add(values.rows(panel.cell), of_pair(whole), of_pair(part));
        }
        if let Some(end) = &end {
            let mass = end.height * end.from * end.from;
            let [n, m] = [(mass, end.excess + 1.0), (mass * end.from, end.excess)].map(|(mass, n)| end.moment(mass, n));
            sums.add(values.rows(end.cell), of_pair([n.0, m.0]), of_pair([n.1, m.1]));
        }
        let normalization = profile.normalization();
        let log_normalization: Vec<f64> = sums.by.iter().map(|by| -by.h / sums.value.h).collect();
        let log_mean = sums.by.iter().zip(&log_normalization).map(|(by, log_a)| by.s / sums.value.s + log_a).collect();
        let count = values.count();
        Some(Self { count, normalization, panels, nodes, points, end, log_normalization, log_mean })
    }

    /// `∂ ln A/∂ ln v` of every value.
    pub fn log_normalization(&self) -> &[f64] {
        &self.log_normalization
    }

    /// `∂ ln/∂ ln v` of the mean slope, in the unit of the table's slopes.
    pub fn log_mean(&self) -> &[f64] {
        &self.log_mean
    }

    /// H and S, and `∂H/∂ ln v` and `∂S/∂ ln v` for every value, at q ≥ 0, for the profile that was sampled.
    pub fn at(&self, profile: &dyn Profile, q: f64) -> (Masking, Vec<Masking>) {
        let of = |sums: Sums| (sums.value, sums.by);
        let zero = Sums::new(self.count);
        let (Some(last), Some(values)) = (self.panels.last(), profile.values()) else { return of(zero) };
        if let Some(end) = &self.end
            && end.is_exact
            && q > end.from / FAR
        {
            // self-similar: H falls by the power e, whose own derivative adds a logarithm
            let from = end.from / FAR;
            let Sums { value, by } = self.normalized(self.sum(profile, values, from));
            let (fold, fall) = ((q / from).ln(), (q / from).powf(-end.excess));
            let [first, second] = values.rows(end.cell);
            let by = by
                .iter()
                .enumerate()
                .map(|(k, by)| {
                    let rate = f64::from(u8::from(k == second)) - f64::from(u8::from(k == first));
                    let h = value.h.mul_add(end.rate * rate * fold, by.h);
                    Masking { h: fall * h, s: fall / q * (end.excess * h - value.h * end.rate * rate) }
                })
                .collect();
            return (Masking { h: fall * value.h, s: fall * value.s * (from / q) }, by);
        }
        of(if q >= last.right { zero } else { self.normalized(self.sum(profile, values, q)) })
    }

    /// From W to H.
    fn normalized(&self, mut sums: Sums) -> Sums {
        let factor = FRAC_2_PI * self.normalization;
        let Masking { h, s } = sums.value;
        let value = Masking { h: factor * h, s: factor * s };
        for (by, log_a) in sums.by.iter_mut().zip(&self.log_normalization) {
            *by = Masking { h: factor * by.h + value.h * log_a, s: factor * by.s + value.s * log_a };
        }
        Sums { value, by: sums.by }
    }

    fn sum(&self, profile: &dyn Profile, values: &dyn Values, q: f64) -> Sums {
        let mut sums = Sums::new(self.count);
        let here = self.panels.partition_point(|panel| panel.right <= q);
        // from q to the end of its panel, and to that of the next one if the kernel's start is close to it;
        // ρ = q + t² makes that start smooth
        let mut from = q;
        let mut next = here;
        while let Some(panel) = self.panels.get(next)
            && (next == here || next == here + 1 && panel.left - q < 0.5 * (panel.right - panel.left))
        {
            let (left, right) = ((from - q).sqrt(), (panel.right - q).sqrt());
            let samples = gauss(self.points).nodes().iter().map(|&(t, weight)| {
                let root = left + t * (right - left);
                let past = root * root;
                let mass = 2.0 * weight * (right - left) * root * profile.f_past(q, past);
                (q + past, past, mass, values.share(panel.cell, q, past))
            });
            add_samples(&mut sums, values.rows(panel.cell), q, samples);
            from = panel.right;
            next += 1;
        }
        let nodes = self.nodes[next * self.points..].chunks(self.points);
        for (panel, nodes) in self.panels[next..].iter().zip(nodes) {
            let gap = panel.left - q;
            let samples = nodes.iter().map(|node| (panel.left + node.past, gap + node.past, node.mass, node.share));
            add_samples(&mut sums, values.rows(panel.cell), q, samples);
        }
        if let Some(end) = &self.end {
            end.add(values, q, &mut sums);
        }
        sums
    }
}

fn of_pair([h, s]: [f64; 2]) -> Masking {
    Masking { h, s }
}

/// Adds points (ρ, ρ − q, weight · f, share) of one cell.
fn add_samples(sums: &mut Sums, rows: [usize; 2], q: f64, samples: impl Iterator<Item = (f64, f64, f64, f64)>) {
    let (mut whole, mut part) = (Masking { h: 0.0, s: 0.0 }, Masking { h: 0.0, s: 0.0 });
    for (rho, past, mass, share) in samples {
        let (bracket, angle) = bracket(q, rho, past);
        let here = Masking { h: mass * rho * bracket, s: mass * rho * angle };
        whole = plus(whole, here);
        part = plus(part, Masking { h: share * here.h, s: share * here.s });
    }
    sums.add(rows, whole, part);
}

impl End {
    /// `mass ∫_1^∞ t^(−1−n) dt`, and the same with the share.
    fn moment(&self, mass: f64, n: f64) -> (f64, f64) {
        (mass / n, mass * (self.share / n + self.rate / (n * n)))
    }

    /// Adds `∫_from^∞`, by the kernels' series in q/ρ.
    fn add(&self, values: &dyn Values, q: f64, sums: &mut Sums) {
        let square = self.height * self.from * self.from;
        let (mut whole, mut part) = (Masking { h: 0.0, s: 0.0 }, Masking { h: 0.0, s: 0.0 });
        far_series(q / self.from, |j, power, [w, _, v, _]| {
            let n = self.excess + j as f64;
            let h = self.moment(square * self.from * power * w, n);
            let s = self.moment(square * power * v, n + 1.0);
            whole = plus(whole, Masking { h: h.0, s: s.0 });
            part = plus(part, Masking { h: h.1, s: s.1 });
        });
        sums.add(values.rows(self.cell), whole, part);
    }
}

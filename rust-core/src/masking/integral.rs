//! Smith masking of any radial profile.
//!
//! `H(q) = (2A/π) ∫_q^∞ f(ρ) ρ [√(ρ²−q²) − q acos(q/ρ)] dρ`, `S(q) = −H′(q) = (2A/π) ∫_q^∞ f(ρ) ρ acos(q/ρ) dρ`,
//! `Λ = H(a)/a`, `a = 1/(tan θ √(σx² cos²φ + σy² sin²φ))`, `G1 = a/(a + H(a))`.
//!
//! This is the double integral of Ribardière et al. 2019, Eq. 10, reduced to a single one.
//!
//! The quadrature has a fixed part and a moving part. The profile is sampled once, on Gauss panels that no cusp of
//! f and no ρ = 0 comes closer to than half their width. For an argument q, panels beyond 2q enter through their
//! moments (the kernel is a power series in q/ρ there), panels nearer than that through their nodes, and only
//! the piece that starts at q, where the kernel begins like (ρ−q)^(3/2), samples the profile anew.

use crate::masking::smith_kernel::bracket;
use crate::numerics::quadrature::gauss;
use crate::profile::{Masking, Profile, Tail};
use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};

/// How fine the quadrature is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rule {
    /// Gauss points per panel.
    points: usize,
    /// How far below its peak, in units of ln, the profile is followed.
    depth: f64,
}

impl Rule {
    /// Relative error of H below 1e-12 for every q, down to where f itself underflows.
    pub const REFERENCE: Self = Self { points: 24, depth: 745.0 };
    /// Relative error of a + H below 1e-9: for tables.
    pub const TABLE: Self = Self { points: 12, depth: 50.0 };

    /// Gauss points per panel.
    pub(super) fn points(self) -> usize {
        self.points
    }
    /// How far below its peak, in units of ln, the profile is followed.
    pub(super) fn depth(self) -> f64 {
        self.depth
    }
}

/// Kernel terms in (q/ρ)²; with ρ > 2q the first one left out is 2e-18.
const TERMS: usize = 24;
/// Multiple of q from which a panel counts as far.
const FAR: f64 = 2.0;
/// Panels end this close to ρ = 0 and to cusps, in units of the roughness; what lies nearer weighs less than 1e-13.
const FLOOR: f64 = 1e-10;

/// The fixed part of the quadrature for one profile.
#[derive(Debug, Clone)]
pub struct MaskingIntegral {
    panels: Vec<Panel>,
    /// (ρ − left end, weight · ρ · f), `points` per panel
    nodes: Vec<(f64, f64)>,
    points: usize,
    factor: f64,
    tail: Tail,
    /// of everything beyond the last panel, in units of its right end
    end: Moments,
    zero: Masking,
    /// whether the profile may have a corner at the end of a panel
    bends: bool,
    /// of a sum of profiles: theirs
    parts: Vec<MaskingIntegral>,
}

#[derive(Debug, Clone, Copy)]
struct Panel {
    left: f64,
    right: f64,
    /// of everything from `left` on, in units of `left`
    beyond: Moments,
}

/// `Σ mass (ρ/unit)^j` for j = 1, 0 and −1, −3, …
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    first: f64,
    zeroth: f64,
    odd: [f64; TERMS],
}

impl Moments {
    fn add(&mut self, ratio: f64, mass: f64) {
        self.first += mass * ratio;
        self.zeroth += mass;
        let inverse = 1.0 / ratio;
        let square = inverse * inverse;
        let mut power = mass * inverse;
        for odd in &mut self.odd {
            *odd += power;
            power *= square;
        }
    }

    /// Adds moments whose unit is `ratio` times this one's.
    fn add_scaled(&mut self, other: &Self, ratio: f64) {
        self.first += other.first * ratio;
        self.zeroth += other.zeroth;
        let inverse = 1.0 / ratio;
        let square = inverse * inverse;
        let mut power = inverse;
        for (mine, theirs) in self.odd.iter_mut().zip(&other.odd) {
            *mine += theirs * power;
            power *= square;
        }
    }
}

impl MaskingIntegral {
    /// Samples a profile.
    pub fn new(profile: &dyn Profile, rule: Rule) -> Self {
        let zero = Masking { h: profile.mean() / std::f64::consts::PI, s: 0.5 };
        if !profile.parts().is_empty() {
            return Self {
                panels: Vec::new(),
                nodes: Vec::new(),
                points: rule.points,
                factor: 0.0,
                tail: profile.tail(),
                end: Moments::default(),
                zero,
                bends: false,
                parts: profile.parts().iter().map(|part| Self::new(part.profile.as_ref(), rule)).collect(),
            };
        }
        let edges = panel_edges(profile, rule.depth);
        let gauss = gauss(rule.points);
        let mut nodes = Vec::with_capacity(rule.points * edges.len());
        for ends in edges.windows(2) {
            let width = ends[1] - ends[0];
            nodes.extend(gauss.nodes().iter().map(|&(t, weight)| {
                let past = t * width;
                (past, weight * width * (ends[0] + past) * profile.f_past(ends[0], past))
            }));
        }
        let last = edges.last().copied().unwrap_or(1.0);
        // from the last edge R on: f(R) (ρ/R)^(−3−e)
        let mut beyond = Moments::default();
        let tail = profile.tail();
        if let Tail::Power { excess, .. } = tail {
            let mass = profile.f(last) * last * last;
            beyond.first = mass / excess;
            beyond.zeroth = mass / (1.0 + excess);
            for (k, odd) in beyond.odd.iter_mut().enumerate() {
                *odd = mass / (excess + 2.0 + 2.0 * k as f64);
            }
        }
        let end = beyond;
        let mut unit = last;
        let mut panels: Vec<Panel> = Vec::with_capacity(edges.len());
        for (ends, nodes) in edges.windows(2).zip(nodes.chunks(rule.points)).rev() {
            let (left, right) = (ends[0], ends[1]);
            // the first panel starts at 0 and is never far
            let own = if left > 0.0 { left } else { right };
            let mut sum = Moments::default();
            sum.add_scaled(&beyond, unit / own);
            for &(past, mass) in nodes {
                sum.add((left + past) / own, mass);
            }
            panels.push(Panel { left, right, beyond: sum });
            (beyond, unit) = (sum, own);
        }
        panels.reverse();
        let factor = profile.normalization() * FRAC_2_PI;
        Self {
            panels,
            nodes,
            points: rule.points,
            factor,
            tail,
            end,
            zero,
            bends: profile.bends_at_breaks(),
            parts: Vec::new(),
        }
    }

    /// `H(q)` and `S(q)`, q ≥ 0, for the profile that was sampled: its closed form where it has one, else by quadrature.
    pub fn at(&self, profile: &dyn Profile, q: f64) -> Masking {
        if !self.parts.is_empty() {
            return self.sum_of_parts(profile, q, Self::at);
        }
        profile.masking(q).unwrap_or_else(|| self.by_quadrature(profile, q))
    }

    /// `H = Σ w s H_j(q/s)` and `S = Σ w S_j(q/s)`.
    fn sum_of_parts(&self, profile: &dyn Profile, q: f64, at: fn(&Self, &dyn Profile, f64) -> Masking) -> Masking {
        let mut sum = Masking { h: 0.0, s: 0.0 };
        for (part, integral) in profile.parts().iter().zip(&self.parts) {
            let Masking { h, s } = at(integral, part.profile.as_ref(), q / part.scale);
            sum.h += part.weight * part.scale * h;
            sum.s += part.weight * s;
        }
        sum
    }

    /// The same without looking for a closed form.
    pub fn by_quadrature(&self, profile: &dyn Profile, q: f64) -> Masking {
        if !self.parts.is_empty() {
            return self.sum_of_parts(profile, q, Self::by_quadrature);
        }
        let Some(last) = self.panels.last() else { return self.zero };
        if q <= 0.0 {
            return self.zero;
        }
        let from = last.right / FAR;
        if let Tail::Power { excess, exact_from } = self.tail
            && q >= from
            && from >= exact_from
        {
            // self-similar
            let Masking { h, s } = self.sum(profile, from);
            let fall = (q / from).powf(-excess);
            return Masking { h: h * fall, s: s * fall * (from / q) };
        }
        if q >= last.right {
            return Masking { h: 0.0, s: 0.0 };
        }
        self.sum(profile, q)
    }

    fn sum(&self, profile: &dyn Profile, q: f64) -> Masking {
        let here = self.panels.partition_point(|panel| panel.right <= q);
        let mut next = here + 1;
        let mut end = self.panels[here].right;
        // a panel that starts close behind q sees the kernel's singularity: it is taken along
        let mut corner = None;
        if let Some(panel) = self.panels.get(next)
            && end - q < 0.5 * (panel.right - panel.left)
        {
            corner = self.bends.then_some(end);
            end = panel.right;
            next += 1;
        }
        let (mut h, mut s) = (0.0, 0.0);
        // ρ = q + w² makes the kernel's start a polynomial
        let mut piece = |from: f64, width: f64| {
            for &(t, weight) in gauss(self.points).nodes() {
                let w = from + t * width;
                let past = w * w;
                let rho = q + past;
                let (bracket, angle) = bracket(q, rho, past);
                let mass = 2.0 * weight * width * w * rho * profile.f_past(q, past);
                h += mass * bracket;
                s += mass * angle;
            }
        };
        let width = (end - q).sqrt();
        match corner {
            Some(corner) => {
                let first = (corner - q).sqrt();
                piece(0.0, first);
                piece(first, width - first);
            }
            None => piece(0.0, width),
        }
        let far = self.panels.partition_point(|panel| panel.left < FAR * q).max(next);
        let near = next..far;
        let nodes = self.nodes[next * self.points..far * self.points].chunks(self.points);
        for (panel, nodes) in self.panels[near].iter().zip(nodes) {
            // first the difference of two numbers that are exact: ρ − q would lose what a ring of m = 1000 is made of
            let gap = panel.left - q;
            for &(past, mass) in nodes {
                let (bracket, angle) = bracket(q, panel.left + past, gap + past);
                h += mass * bracket;
                s += mass * angle;
            }
        }
        if let Some(panel) = self.panels.get(far) {
            let (far_h, far_s) = panel.beyond.kernel_sums(q / panel.left);
            h += far_h * panel.left;
            s += far_s;
        } else if let Some(last) = self.panels.last() {
            // all panels are near: what is left is the closed-form end of a power tail
            let (tail_h, tail_s) = self.end.kernel_sums(q / last.right);
            h += tail_h * last.right;
            s += tail_s;
        }
        Masking { h: self.factor * h, s: self.factor * s }
    }
}

impl Moments {
    /// Sums of the kernels over masses beyond, for w = q/unit:
    /// `√(1−w²) − w acos w = 1 − πw/2 + Σ a_k w^(2k+2)/(2k+2)`, `acos w = π/2 − Σ a_k w^(2k+1)`,
    /// `a_k = (2k)!/(4^k k!² (2k+1))`.
    fn kernel_sums(&self, w: f64) -> (f64, f64) {
        let square = w * w;
        let (mut h, mut s) = (self.first - FRAC_PI_2 * w * self.zeroth, FRAC_PI_2 * self.zeroth);
        let mut binomial = 1.0;
        let mut power = w;
        for (k, &moment) in self.odd.iter().enumerate() {
            let k = k as f64;
            let term = binomial / (2.0 * k + 1.0) * power * moment;
            s -= term;
            h += term * w / (2.0 * k + 2.0);
            binomial *= (2.0 * k + 1.0) / (2.0 * k + 2.0);
            power *= square;
        }
        (h, s)
    }
}

/// Edges of panels: the profile's break points, refined until no panel is wider than twice its distance from ρ = 0
/// and from the cusps.
pub(super) fn panel_edges(profile: &dyn Profile, depth: f64) -> Vec<f64> {
    let breaks = profile.breaks(depth);
    let singular = |x: f64| x == 0.0 || profile.cusps().contains(&x);
    let distance = |left: f64, right: f64| {
        profile.cusps().iter().chain(&[0.0]).fold((f64::INFINITY, 0.0), |best, &z| {
            let d = if z <= left { left - z } else { z - right };
            if d < best.0 { (d, z) } else { best }
        })
    };
    let mut edges = vec![0.0];
    // a stack of intervals, the leftmost on top
    let mut stack: Vec<(f64, f64)> = breaks
        .iter()
        .rev()
        .zip(breaks.iter().rev().skip(1).chain(&[0.0]))
        .map(|(&right, &left)| (left, right))
        .collect();
    while let Some((left, right)) = stack.pop() {
        let width = right - left;
        let (nearest, z) = distance(left, right);
        let too_wide = width > 2.0 * nearest && width > FLOOR;
        let cut = match (singular(left), singular(right)) {
            _ if !too_wide => None,
            (true, true) => Some(0.5 * (left + right)),
            _ if z <= left => Some(z + (nearest + width / 3.0).min(3.0 * nearest.max(width / 9.0))),
            _ => Some(z - (nearest + width / 3.0).min(3.0 * nearest.max(width / 9.0))),
        };
        match cut {
            Some(cut) if cut > left && cut < right => {
                stack.push((cut, right));
                stack.push((left, cut));
            }
            _ => edges.push(right),
        }
    }
    edges
}

//! A profile of many pieces: ln f is linear in x² between nodes, so that every node is a bend and every integral a closed form.

use sgtd_core::numerics::invert::{self, Monotone};
use sgtd_core::numerics::quadrature::gauss;
use sgtd_core::profile::{Profile, Tail};

/// Nodes (y, ln f) with y = x², ascending from 0; nothing lies beyond the last one.
pub struct Piecewise {
    nodes: Vec<[f64; 2]>,
    bends: Vec<f64>,
    /// ∫ x f dx up to each node
    below: Vec<f64>,
    mean: f64,
}

impl Piecewise {
    pub fn new(nodes: Vec<[f64; 2]>) -> Self {
        let mut below = vec![0.0];
        let mut second = 0.0;
        for pair in nodes.windows(2) {
            below.push(below[below.len() - 1] + area(pair, pair[1][0]));
            let (left, right) = (pair[0][0].sqrt(), pair[1][0].sqrt());
            second += gauss(12).integrate(left, right, |x| x * x * at(pair, x * x));
        }
        let mean = second / below[below.len() - 1];
        let bends = nodes[1..].iter().map(|node| node[0].sqrt()).collect();
        Self { nodes, bends, below, mean }
    }

    fn piece(&self, y: f64) -> Option<usize> {
        let k = self.nodes.partition_point(|node| node[0] <= y);
        (k < self.nodes.len()).then(|| k.max(1) - 1)
    }

    fn area_below(&self, x: f64) -> f64 {
        let y = x * x;
        match self.piece(y) {
            Some(k) => self.below[k] + area(&self.nodes[k..k + 2], y),
            None => self.whole(),
        }
    }

    fn whole(&self) -> f64 {
        self.below[self.below.len() - 1]
    }
}

fn slope(pair: &[[f64; 2]]) -> f64 {
    (pair[1][1] - pair[0][1]) / (pair[1][0] - pair[0][0])
}

fn at(pair: &[[f64; 2]], y: f64) -> f64 {
    (pair[0][1] + slope(pair) * (y - pair[0][0])).exp()
}

/// ∫ x f dx from the left end of a piece to y.
fn area(pair: &[[f64; 2]], y: f64) -> f64 {
    let (slope, width) = (slope(pair), y - pair[0][0]);
    let unit = if slope * width == 0.0 { width } else { (slope * width).exp_m1() / slope };
    0.5 * pair[0][1].exp() * unit
}

impl Profile for Piecewise {
    fn f(&self, x: f64) -> f64 {
        self.piece(x * x).map_or(0.0, |k| at(&self.nodes[k..k + 2], x * x))
    }
    fn normalization(&self) -> f64 {
        0.5 / self.whole()
    }
    fn cdf(&self, x: f64) -> f64 {
        self.area_below(x) / self.whole()
    }
    fn sf(&self, x: f64) -> f64 {
        1.0 - self.cdf(x)
    }
    fn quantile(&self, u: f64) -> f64 {
        let density = |x: f64| x * self.f(x) / self.whole();
        invert::solve(&Monotone { value: &|x| self.cdf(x), rising: true, slope: &density }, u, self.mean)
    }
    fn isf(&self, u: f64) -> f64 {
        self.quantile(1.0 - u)
    }
    fn mean(&self) -> f64 {
        self.mean
    }
    fn breaks(&self, _depth: f64) -> Vec<f64> {
        self.bends.clone()
    }
    fn cusps(&self) -> &[f64] {
        &self.bends
    }
    fn tail(&self) -> Tail {
        Tail::Exponential
    }
}

//! The masking table: H over one variable, for every roughness and direction, as small as an accuracy allows.
//!
//! Nodes are the floats whose low mantissa bits are zero: 2^b of them per octave from 2^kmin on, and 0. The cell of an
//! argument is found by a shift of its bits, and any power law is equally smooth in every octave, so the tails near
//! 2pγ = 3 need no coordinate of their own. Each node holds H and H′ = −S; cells are cubic Hermite polynomials.

use crate::masking::{Masking, MaskingIntegral};
use crate::profile::Profile;

/// H tabulated in single precision.
#[derive(Debug, Clone)]
pub struct LambdaTable {
    /// (H, H′) per node; the first node is 0.
    flat: Vec<f32>,
    /// The same cells as cubics in a − a_left, for scalar code.
    cubics: Vec<[f64; 4]>,
    last: f64,
    shift: u32,
    first: u32,
    reached: f64,
}

/// Mantissa bits of f32.
const MANTISSA: u32 = 23;
/// The finest spacing: 2⁹ nodes per octave (32 octaves then take 128 KiB).
const FINEST: u32 = 9;
/// The range of octaves that a table may span.
const OCTAVES: (i32, i32) = (-40, 60);
/// The finest accuracy that single-precision nodes can hold.
pub const FINEST_ACCURACY: f64 = 1e-7;
/// The share of the permitted error that interpolation may use, as measured at the quarter points of each cell; the
/// rest is left for rounding and for errors that peak elsewhere.
const SHARE: f64 = 0.5;

/// What rounding to single precision adds to the error: half an ulp of H and of its slope.
const ROUNDING: f64 = 5e-8;

struct Node {
    a: f64,
    h: f64,
    slope: f64,
}

impl LambdaTable {
    /// The coarsest table whose G1 is within `accuracy` (relative) at every point measured.
    ///
    /// Nodes are doubled until the error, measured at three points of every cell, is below half the accuracy; the
    /// midpoints are the next table's nodes, so few values are computed twice.
    pub fn new(profile: &dyn Profile, masking: &MaskingIntegral, accuracy: f64) -> Self {
        let permitted = SHARE * (accuracy.max(FINEST_ACCURACY) - ROUNDING);
        let node = |a: f64| {
            let Masking { h, s } = masking.at(profile, a);
            Node { a, h, slope: -s }
        };
        let zero = node(0.0);
        // Where H has become a straight line towards 0, and where it no longer counts against a.
        let mut low = ilog2(profile.mean()).clamp(OCTAVES.0 + 1, 20) - 1;
        let error_of_first = |low: i32| {
            let end = node(2f64.powi(low));
            [0.25, 0.5, 0.75].map(|t| error(&zero, &end, &node(t * end.a))).into_iter().fold(0.0, f64::max)
        };
        while low > OCTAVES.0 && error_of_first(low) > permitted {
            low -= 1;
        }
        let first_error = error_of_first(low);
        let mut octaves = vec![node(2f64.powi(low))];
        while octaves.last().is_some_and(|n| n.h > 0.5 * permitted * n.a) && low + (octaves.len() as i32) < OCTAVES.1 {
            octaves.push(node(2f64.powi(low + octaves.len() as i32)));
        }
        if octaves.len() == 1 {
            octaves.push(node(2f64.powi(low + 1)));
        }
        let mut nodes = octaves;
        let mut bits = 0;
        let mut reached;
        loop {
            let middles: Vec<Node> = nodes.windows(2).map(|pair| node(0.5 * (pair[0].a + pair[1].a))).collect();
            let cells = || nodes.windows(2).zip(&middles);
            reached = cells().map(|(pair, middle)| error(&pair[0], &pair[1], middle)).fold(0.0, f64::max);
            if reached <= permitted {
                // next to a cusp the error peaks beside the middle
                let quarter = |t: f64| {
                    cells()
                        .map(|(pair, _)| error(&pair[0], &pair[1], &node(pair[0].a + t * (pair[1].a - pair[0].a))))
                        .fold(0.0, f64::max)
                };
                reached = reached.max(quarter(0.25)).max(quarter(0.75));
            }
            if reached <= permitted || bits == FINEST {
                break;
            }
            bits += 1;
            let mut merged = Vec::with_capacity(2 * nodes.len());
            let mut middles = middles.into_iter();
            for node in nodes {
                merged.push(node);
                merged.extend(middles.next());
            }
            nodes = merged;
        }
        let end = nodes.last().map_or(0.0, |n| n.h / n.a);
        let shift = MANTISSA - bits;
        let flat: Vec<f32> = std::iter::once(&zero).chain(&nodes).flat_map(|n| [n.h as f32, n.slope as f32]).collect();
        let starts = [0.0].into_iter().chain(nodes.iter().map(|n| n.a));
        let cubics = flat
            .as_chunks::<2>()
            .0
            .windows(2)
            .zip(starts.zip(nodes.iter().map(|n| n.a)))
            .map(|(pair, (left, right))| cubic(pair[0].map(f64::from), pair[1].map(f64::from), right - left))
            .collect();
        Self {
            cubics,
            last: nodes.last().map_or(0.0, |n| n.a),
            flat,
            shift,
            first: (2f32.powi(low)).to_bits() >> shift,
            reached: reached.max(end).max(first_error) / SHARE + ROUNDING,
        }
    }

    /// Pairs (H, H′).
    pub fn flat(&self) -> &[f32] {
        &self.flat
    }
    /// How far the bits of an argument are shifted to number its cell.
    pub fn shift(&self) -> u32 {
        self.shift
    }
    /// The shifted bits of the first positive node.
    pub fn first(&self) -> u32 {
        self.first
    }
    /// Number of cells.
    pub fn cells(&self) -> u32 {
        (self.flat.len() / 2 - 1) as u32
    }
    /// The relative error of G1 that was reached.
    pub fn reached(&self) -> f64 {
        self.reached
    }

    /// H(a), a ≥ 0.
    #[inline]
    pub fn h(&self, a: f64) -> f64 {
        // beyond the last node H stays what it is there: nothing against a
        let a = a.min(self.last);
        let key = (a as f32).to_bits() >> self.shift;
        let cell = ((key + 1).max(self.first) - self.first).min(self.cubics.len() as u32 - 1);
        let left = if cell == 0 { 0.0 } else { f64::from(f32::from_bits((self.first + cell - 1) << self.shift)) };
        let d = a - left;
        let [c0, c1, c2, c3] = self.cubics[cell as usize];
        (c0 + d * (c1 + d * (c2 + d * c3))).max(0.0)
    }
}

/// The cubic in the distance from the left end that has the given values and slopes at both ends.
fn cubic([h0, s0]: [f64; 2], [h1, s1]: [f64; 2], width: f64) -> [f64; 4] {
    let chord = (h1 - h0) / width;
    [h0, s0, (3.0 * chord - 2.0 * s0 - s1) / width, (s0 + s1 - 2.0 * chord) / (width * width)]
}

fn ilog2(x: f64) -> i32 {
    x.log2().clamp(-1000.0, 1000.0) as i32
}

/// Relative error of G1 = a/(a+H) at a point within a cell.
fn error(left: &Node, right: &Node, point: &Node) -> f64 {
    let width = right.a - left.a;
    let [c0, c1, c2, c3] = cubic([left.h, left.slope], [right.h, right.slope], width);
    let d = point.a - left.a;
    let h = c0 + d * (c1 + d * (c2 + d * c3));
    (h - point.h).abs() / (point.a + point.h)
}

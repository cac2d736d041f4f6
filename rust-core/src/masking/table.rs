//! The masking table: H over one variable, for every roughness and direction, as small as an accuracy allows.
//!
//! An octave [2^k, 2^(k+1)) is divided into 2^b cells, with b as the octave needs it: a cusp or a thin ring fills one octave, and
//! a power law is equally smooth in every one, so the tails near 2pγ = 3 need no coordinate of their own. The exponent bits of
//! an argument select the octave's entry and the leading bits of its mantissa the cell, so nothing is searched and no
//! argument is out of range. Cells are the cubic polynomials that match H and H′ = −S at both ends, written in the distance
//! from the left end. All octaves below the first share one cell that begins at 0, those above the last one a constant.

// all exponents of a float, so that none needs a check
pub use crate::constants::MASKING_ENTRIES as ENTRIES;
use crate::masking::MaskingIntegral;
use crate::numerics::{greatest, hermite};
use crate::profile::{Masking, Profile};

/// H tabulated.
#[derive(Debug, Clone)]
pub struct LambdaTable {
    /// One entry for every exponent of a float.
    octaves: Vec<Octave>,
    /// Coefficients of each cell, the constant first.
    cubics: Vec<[f64; 4]>,
    flat: Vec<f32>,
    reached: f64,
}

/// Where an octave's cells begin, and by how much a mantissa is shifted to number them.
#[derive(Debug, Clone, Copy)]
struct Octave {
    start: u32,
    shift: u32,
}

impl Octave {
    /// The shift in the low five bits, the first cell above them.
    fn packed(self) -> u32 {
        (self.start << 5) | self.shift
    }
}

/// Shift of octaves that are not divided: it takes the exponent away too, so that their cells count from 0.
const WHOLE: u32 = 31;
/// Mantissa bits of f32.
const MANTISSA: u32 = 23;
const MANTISSA_MASK: u32 = (1 << MANTISSA) - 1;
const SIGN: u32 = 1 << 31;
/// The finest division of an octave: 2¹⁰ cells (32 KiB in single precision would hold two such octaves).
const FINEST: u32 = 10;
/// The range of octaves that a table may span.
const OCTAVES: (i32, i32) = (-40, 60);
/// The finest accuracy of a table, bounded by the rule it is made with.
pub const FINEST_ACCURACY: f64 = 1e-10;
/// The finest accuracy of what is read in single precision.
pub const FINEST_SINGLE: f64 = 1e-7;
/// The share of the permitted error that interpolation may use, as measured at the quarter points of each cell; the
/// rest is left for rounding and for errors that peak elsewhere.
const SHARE: f64 = 0.5;

/// What rounding to single precision adds to the error.
const ROUNDING: f64 = 5e-8;

#[derive(Clone, Copy)]
struct Knot {
    a: f64,
    h: f64,
    slope: f64,
}

impl LambdaTable {
    /// The coarsest table whose G1 is within `accuracy` (relative) at every point measured.
    pub fn new(profile: &dyn Profile, masking: &MaskingIntegral, accuracy: f64) -> Self {
        let accuracy = accuracy.max(FINEST_ACCURACY);
        let rounding = if accuracy < FINEST_SINGLE { 0.0 } else { ROUNDING };
        let permitted = SHARE * (accuracy - rounding);
        let node = |a: f64| {
            let Masking { h, s } = masking.at(profile, a);
            Knot { a, h, slope: -s }
        };
        let zero = node(0.0);
        // Where H has become a straight line towards 0, and where it no longer counts against a.
        let mut low = ilog2(profile.mean()).clamp(OCTAVES.0 + 1, 20) - 1;
        let error_of_first = |low: i32| {
            let end = node(2f64.powi(low));
            greatest([0.25, 0.5, 0.75].map(|t| error(&zero, &end, &node(t * end.a))))
        };
        let mut reached = error_of_first(low);
        while low > OCTAVES.0 && reached > permitted {
            low -= 1;
            reached = error_of_first(low);
        }
        let mut left = node(2f64.powi(low));
        let mut cubics = vec![cubic(&zero, &left)];
        let mut octaves = vec![Octave { start: 0, shift: WHOLE }; (f32::MAX_EXP - 2 + low) as usize + 1];
        while left.h > 0.5 * permitted * left.a && left.a < 2f64.powi(OCTAVES.1) {
            let right = node(2.0 * left.a);
            let start = cubics.len() as u32;
            let (nodes, error) = divide(left, right, permitted, &node);
            reached = reached.max(error);
            cubics.extend(nodes.windows(2).map(|pair| cubic(&pair[0], &pair[1])));
            octaves.push(Octave { start, shift: MANTISSA - (nodes.len() - 1).ilog2() });
            left = right;
        }
        // H stays what it is there: nothing against a
        octaves.resize(ENTRIES, Octave { start: cubics.len() as u32, shift: WHOLE });
        cubics.push([left.h, 0.0, 0.0, 0.0]);
        let header = octaves.iter().map(|octave| f32::from_bits(octave.packed()));
        let flat = header.chain(cubics.iter().flatten().map(|&c| c as f32)).collect();
        let end = left.h / left.a;
        Self { octaves, cubics, flat, reached: greatest([reached, end]) / SHARE + rounding }
    }

    /// 256 integers, one per exponent (the shift in the low five bits, the first cell above them), then four
    /// coefficients per cell.
    pub fn flat(&self) -> &[f32] {
        &self.flat
    }
    /// The relative error of G1 that was reached.
    pub fn reached(&self) -> f64 {
        self.reached
    }

    /// The ends of each cell; the last one, in which nothing counts against a any more, has no end.
    pub fn cells(&self) -> Vec<(f64, f64)> {
        // exponents without a cell of their own share the first one
        let first = self.octaves.iter().take_while(|octave| octave.start == 0).count();
        let left_of = |exponent: usize| 2f64.powi(exponent as i32 - (f32::MAX_EXP - 1));
        let mut cells = vec![(0.0, left_of(first))];
        for (exponent, octave) in self.octaves.iter().enumerate().skip(first) {
            if octave.shift == WHOLE {
                cells.push((left_of(exponent), f64::INFINITY));
                break;
            }
            let (left, parts) = (left_of(exponent), 1_u32 << (MANTISSA - octave.shift));
            let at = |part: u32| left + left * f64::from(part) / f64::from(parts);
            cells.extend((0..parts).map(|part| (at(part), at(part + 1))));
        }
        cells
    }

    /// H(a), a ≥ 0.
    #[inline]
    pub fn h(&self, a: f64) -> f64 {
        let bits = (a as f32).to_bits() & !SIGN;
        let Octave { start, shift } = self.octaves[(bits >> MANTISSA) as usize];
        let left = f32::from_bits((bits >> shift) << shift);
        let cell = start + ((bits & MANTISSA_MASK) >> shift);
        let d = a - f64::from(left);
        hermite::value(self.cubics[cell as usize], d).max(0.0)
    }
}

/// Divides an octave until the error, measured at three points of every cell, is permitted; the nodes and that error.
///
/// The midpoints are the next division's nodes, so few values are computed twice.
fn divide(left: Knot, right: Knot, permitted: f64, node: &impl Fn(f64) -> Knot) -> (Vec<Knot>, f64) {
    let mut nodes = vec![left, right];
    loop {
        let middles: Vec<Knot> = nodes.windows(2).map(|pair| node(0.5 * (pair[0].a + pair[1].a))).collect();
        let cells = || nodes.windows(2).zip(&middles);
        let mut worst = greatest(cells().map(|(pair, middle)| error(&pair[0], &pair[1], middle)));
        if worst <= permitted {
            // next to a cusp the error peaks beside the middle
            let quarter = |t: f64| {
                greatest(
                    cells().map(|(pair, _)| error(&pair[0], &pair[1], &node(pair[0].a + t * (pair[1].a - pair[0].a)))),
                )
            };
            worst = greatest([worst, quarter(0.25), quarter(0.75)]);
        }
        if worst <= permitted || nodes.len() > 1 << FINEST {
            return (nodes, worst);
        }
        let mut merged = Vec::with_capacity(2 * nodes.len());
        let mut middles = middles.into_iter();
        for node in nodes {
            merged.push(node);
            merged.extend(middles.next());
        }
        nodes = merged;
    }
}

/// The cell between two nodes.
fn cubic(left: &Knot, right: &Knot) -> [f64; 4] {
    hermite::cubic([left.h, left.slope], [right.h, right.slope], right.a - left.a)
}

fn ilog2(x: f64) -> i32 {
    x.log2().clamp(-1000.0, 1000.0) as i32
}

/// Relative error of G1 = a/(a+H) at a point within a cell.
fn error(left: &Knot, right: &Knot, point: &Knot) -> f64 {
    let h = hermite::value(cubic(left, right), point.a - left.a);
    (h - point.h).abs() / (point.a + point.h)
}

//! A profile of any number of pieces for single precision: ln f, the odds F/(1−F) and their inverse, each after three loads.
//!
//! Nothing is searched: the exponent bits of an argument select an octave, its leading mantissa bits a bucket of that octave, and a bucket
//! knows the first cell in it and where the next three begin. There are two such lists of cells, one over `s = x²` and one over the odds
//! `y = F/(1−F)`. A cell is a [`Piece`] with its mass `v + m (t^(1−e) − 1)/(1−e)`, which is F below the median and F − 1 above it, so that either
//! tail keeps its digits.
//!
//! Pieces are split where 1 − F has halved, so that a difference of two masses keeps its digits too. Cells that single precision does not
//! tell apart are left out.

use crate::numerics::greatest;
use crate::profile::Profile;
use crate::profile::pieces::{Piece, pieces};
use std::f64::consts::LN_2;
use std::sync::OnceLock;

/// Octaves of each list: all exponents of a float, so that none needs a check.
pub const OCTAVES: usize = 256;
/// Numbers of a bucket: the first cell and the starts of three more.
pub const BUCKET: usize = 4;
/// Numbers of a cell: anchor, rate, its inverse, log₂ f, e, v, m, its inverse.
pub const CELL: usize = 8;
/// The finest division of an octave.
const FINEST: u32 = 14;
/// Octaves that are not divided.
const WHOLE: u32 = 31;
/// Mantissa bits of f32.
const MANTISSA: u32 = 23;
/// Halvings of 1 − F that are told apart: odds to 10¹⁹.
const HALVINGS: i32 = 63;
/// The greatest s that is told apart.
const GREATEST: f64 = 1e36;
/// Splits are no nearer to each other and to the ends of pieces than this share of s.
const APART: f64 = 1.0 / 1024.0;
/// What lies above the end of a cut table, so that the number has a sign.
const LEAST_SHARE: f64 = 1e-30;
/// log₂ f of what is empty.
const NOTHING: f64 = -1000.0;
/// Where f is below this share of its peak its rounding does not count.
const FAINT: f64 = 1e-7;

/// Tables for single and, the same, for double precision.
#[derive(Debug, Clone)]
pub struct ProfileCells {
    single: Vec<f32>,
    /// made when it is asked for
    double: OnceLock<Vec<f64>>,
    cells: Vec<Cell>,
    steepness: f64,
    count: usize,
}

/// A cell in double precision.
#[derive(Debug, Clone, Copy)]
struct Cell {
    /// where it begins, in s and in y
    start: f64,
    odds: f64,
    numbers: [f64; CELL],
}

/// Where a cell over s is, and its t = 1 + (s − anchor) rate; the last one has no end.
#[derive(Debug, Clone, Copy)]
pub struct Span {
    /// Where it begins.
    pub start: f64,
    /// And ends.
    pub end: Option<f64>,
    anchor: f64,
    rate: f64,
}

impl Span {
    /// log₂ t at s.
    pub fn log_t(&self, s: f64) -> f64 {
        ((s - self.anchor) * self.rate).max(-1.0).ln_1p() / LN_2
    }

    /// s with a given log₂ t.
    pub fn square(&self, log_t: f64) -> f64 {
        self.anchor + (log_t * LN_2).exp_m1() / self.rate
    }
}

impl ProfileCells {
    /// Tabulates a profile.
    pub fn new(profile: &dyn Profile) -> Self {
        let pieces = pieces(profile);
        let cells = cells(profile, &pieces);
        let (single, count) = flat(&cells, |x| f64::from(x as f32));
        Self {
            single: single.iter().map(|number| number.single()).collect(),
            double: OnceLock::new(),
            cells,
            steepness: steepness(&pieces),
            count,
        }
    }

    /// [`OCTAVES`] entries for s, as many for y (a shift in the low five bits, above them the number of the first bucket); buckets and
    /// cells, whose numbers count from the start. Integers are stored as the bits of a float.
    pub fn single(&self) -> &[f32] {
        &self.single
    }

    /// The same in double precision, where integers are numbers; the bits of an argument are those of the float below it.
    pub fn double(&self) -> &[f64] {
        self.double.get_or_init(|| flat(&self.cells, |x| x).0.iter().map(|number| number.double()).collect())
    }

    /// The cells over s in their order, in single or in double precision.
    pub fn spans(&self, single: bool) -> Vec<Span> {
        let round = |x: f64| if single { f64::from(x as f32) } else { x };
        let kept = List::kept(&self.cells, |cell| round(cell.start));
        let end = |k: usize| kept.get(k + 1).map(|next| next.0);
        let span = |(k, &(start, numbers)): (usize, &(f64, [f64; CELL]))| Span {
            start,
            end: end(k),
            anchor: round(numbers[0]),
            rate: round(numbers[1]),
        };
        kept.iter().enumerate().map(span).collect()
    }

    /// The number of the first of them in the table: that in which 0 is.
    pub fn first(&self, single: bool) -> usize {
        let whole = |k: usize| if single { self.single[k].to_bits() } else { self.double()[k] as u32 };
        whole(BUCKET * (whole(0) >> 5) as usize) as usize
    }

    /// Greatest |d ln f / d ln x| where f is above 1e-7 of its peak.
    pub fn steepness(&self) -> f64 {
        self.steepness
    }

    /// Number of cells over s.
    pub fn count(&self) -> usize {
        self.count
    }
}

fn steepness(pieces: &[Piece]) -> f64 {
    let peak = greatest(pieces.iter().map(|piece| piece.log_f));
    let least = peak + FAINT.ln();
    greatest(pieces.iter().enumerate().map(|(k, piece)| {
        let end = pieces.get(k + 1).map_or(GREATEST, |next| next.start);
        if piece.log_at(piece.start).max(piece.log_at(end)) < least {
            return 0.0;
        }
        piece.steepness(piece.start).max(piece.steepness(end))
    }))
}

/// All cells, from 0 on.
fn cells(profile: &dyn Profile, pieces: &[Piece]) -> Vec<Cell> {
    let halvings = (1..=HALVINGS).map(|k| profile.isf(2f64.powi(-k)).powi(2));
    let mut splits: Vec<f64> = halvings.filter(|s| *s > 0.0 && *s < GREATEST).collect();
    // the end of a cut table is a place, not a tail
    splits.dedup_by(|next, last| *next < *last * (1.0 + APART));
    let median = splits.first().copied().unwrap_or(0.0);
    let mut cells = Vec::with_capacity(pieces.len() + splits.len());
    for (k, piece) in pieces.iter().enumerate() {
        let end = pieces.get(k + 1).map_or(GREATEST, |next| next.start);
        let inside = splits.iter().copied().filter(|s| {
            *s == median && *s > piece.start && *s < end || *s > piece.start * (1.0 + APART) && *s < end * (1.0 - APART)
        });
        let starts: Vec<f64> = std::iter::once(piece.start).chain(inside).collect();
        for (j, &start) in starts.iter().enumerate() {
            let end = starts.get(j + 1).copied().unwrap_or(end);
            cells.push(cell(profile, piece, [start, end], start >= median));
        }
    }
    cells
}

/// `(t^(1−e) − 1)/(1−e)`
fn moment(log_t: f64, exponent: f64) -> f64 {
    let less = 1.0 - exponent;
    let power = less * log_t;
    if power == 0.0 { log_t } else { log_t * power.exp_m1() / power }
}

fn cell(profile: &dyn Profile, piece: &Piece, [start, end]: [f64; 2], above: bool) -> Cell {
    // the sign says which: never 0 above
    let mass = |s: f64| if above { -profile.sf(s.sqrt()).max(LEAST_SHARE) } else { profile.cdf(s.sqrt()) };
    let sf = profile.sf(start.sqrt());
    let odds = profile.cdf(start.sqrt()) / sf.max(1e-37);
    let empty = piece.log_f == f64::NEG_INFINITY;
    // counted from where f is greater: the other end may be 0
    let from_end = !empty && piece.log_at(end) > piece.log_at(start) + 1.0;
    let anchored = if empty { *piece } else { piece.anchored(if from_end { end } else { start }) };
    let at = if empty { start } else { anchored.anchor };
    let v = mass(at);
    let other = if from_end { start } else { end };
    let exact = profile.normalization() * anchored.log_f.exp() / anchored.rate;
    // the mass between the ends is the profile's, also where the piece is near it alone
    let log_t = ((other - at) * anchored.rate).max(-1.0).ln_1p();
    let whole = moment(log_t.max(-700.0), anchored.exponent);
    let m = if empty || !(whole.abs() > 0.0) {
        0.0
    } else {
        let from_ends = (mass(other) - v) / whole;
        if (from_ends / exact - 1.0).abs() < 1e-3 { from_ends } else { exact }
    };
    let inverse = |x: f64| if x == 0.0 { 0.0 } else { 1.0 / x };
    let log_f = if empty { NOTHING } else { (anchored.log_f / LN_2).max(NOTHING) };
    let numbers = [at, anchored.rate, inverse(anchored.rate), log_f, anchored.exponent, v, m, inverse(m)];
    Cell { start, odds, numbers: numbers.map(|x| x.clamp(-1e37, 1e37)) }
}

/// A number of the flat table.
#[derive(Debug, Clone, Copy)]
enum Number {
    Index(u32),
    Value(f64),
}

impl Number {
    fn single(self) -> f32 {
        match self {
            Self::Index(index) => f32::from_bits(index),
            Self::Value(value) => value as f32,
        }
    }

    fn double(self) -> f64 {
        match self {
            Self::Index(index) => f64::from(index),
            Self::Value(value) => value,
        }
    }
}

/// Both lists in one table, for numbers that are rounded; the number of cells over s.
fn flat(cells: &[Cell], round: impl Fn(f64) -> f64) -> (Vec<Number>, usize) {
    let by_slope = List::new(cells, |cell| round(cell.start));
    let by_odds = List::new(cells, |cell| round(cell.odds.min(1e37)));
    let buckets = 2 * OCTAVES / BUCKET;
    let first = [buckets, buckets + by_slope.buckets.len()];
    let end = BUCKET * (first[1] + by_odds.buckets.len());
    let base = end.div_ceil(CELL);
    let at = [base, base + by_slope.cells.len()];
    let mut numbers = Vec::with_capacity(CELL * (at[1] + by_odds.cells.len()));
    for (list, first) in [&by_slope, &by_odds].into_iter().zip(first) {
        numbers.extend(list.octaves.iter().map(|octave| Number::Index(((octave.0 + first as u32) << 5) | octave.1)));
    }
    for (list, at) in [&by_slope, &by_odds].into_iter().zip(at) {
        for (cell, starts) in &list.buckets {
            numbers.push(Number::Index(cell + at as u32));
            numbers.extend(starts.map(Number::Value));
        }
    }
    numbers.resize(CELL * base, Number::Value(0.0));
    for list in [&by_slope, &by_odds] {
        numbers.extend(list.cells.iter().flatten().map(|&x| Number::Value(x)));
    }
    (numbers, by_slope.cells.len())
}

/// Cells over one coordinate, and what finds them.
struct List {
    /// the first bucket and the shift of each octave
    octaves: Vec<(u32, u32)>,
    /// the cell at the left end, and the starts of the next ones
    buckets: Vec<(u32, [f64; BUCKET - 1])>,
    cells: Vec<[f64; CELL]>,
}

/// The bits of the float at or below x.
fn bits(x: f64) -> u32 {
    let near = x as f32;
    if f64::from(near) > x { near.next_down().to_bits() } else { near.to_bits() }
}

/// The float with these bits; infinity above all others.
fn of_bits(bits: u32) -> f64 {
    f64::from(f32::from_bits(bits.min(f32::INFINITY.to_bits())))
}

impl List {
    /// The cells that are told apart, and where they begin.
    fn kept(cells: &[Cell], coordinate: impl Fn(&Cell) -> f64) -> Vec<(f64, [f64; CELL])> {
        // the last of those that begin at the same number; the first one begins at 0
        let mut kept: Vec<(f64, [f64; CELL])> = Vec::with_capacity(cells.len());
        for cell in cells {
            let start = coordinate(cell);
            match kept.last_mut() {
                Some(last) if !(start > last.0) => last.1 = cell.numbers,
                _ => kept.push((start, cell.numbers)),
            }
        }
        Self::thin_out(&mut kept);
        kept
    }

    fn new(cells: &[Cell], coordinate: impl Fn(&Cell) -> f64) -> Self {
        let kept = Self::kept(cells, coordinate);
        let starts: Vec<f64> = kept.iter().map(|cell| cell.0).collect();
        let mut octaves = Vec::with_capacity(OCTAVES);
        let mut buckets: Vec<(u32, [f64; BUCKET - 1])> = Vec::new();
        for octave in 0..OCTAVES as u32 {
            let (low, high) = (octave << MANTISSA, (octave + 1) << MANTISSA);
            let inside = starts_within(&starts, low, high);
            if inside.is_empty() {
                let bucket = bucket(&starts, inside);
                if buckets.last() != Some(&bucket) {
                    buckets.push(bucket);
                }
                octaves.push((buckets.len() as u32 - 1, WHOLE));
                continue;
            }
            let depth = (0..=FINEST).find(|&depth| fits(&starts[inside.clone()], depth)).unwrap_or(FINEST);
            let (width, first) = (1 << (MANTISSA - depth), buckets.len() as u32);
            let mut from = inside.start;
            for k in 0..1u32 << depth {
                let (left, right) = (of_bits(low + k * width), of_bits(low + (k + 1) * width));
                while from < starts.len() && starts[from] <= left {
                    from += 1;
                }
                let count = starts[from..].iter().take_while(|&&start| start < right).count();
                buckets.push(bucket(&starts, from..from + count));
                from += count;
            }
            octaves.push((first, MANTISSA - depth));
        }
        Self { octaves, buckets, cells: kept.into_iter().map(|cell| cell.1).collect() }
    }

    /// Leaves out the narrowest cells where more of them begin than the finest bucket can tell apart; the wider neighbor goes on over them.
    fn thin_out(kept: &mut Vec<(f64, [f64; CELL])>) {
        let of = |cell: &(f64, [f64; CELL])| bits(cell.0) >> (MANTISSA - FINEST);
        let mut from = 1;
        while from + BUCKET <= kept.len() {
            if of(&kept[from]) != of(&kept[from + BUCKET - 1]) {
                from += 1;
                continue;
            }
            let end = |k: usize| kept.get(k + 1).map_or(f64::INFINITY, |next| next.0);
            let width = |k: usize| end(k) - kept[k].0;
            let narrowest = (from..from + BUCKET).min_by(|&i, &j| width(i).total_cmp(&width(j))).unwrap_or(from);
            if narrowest + 1 < kept.len() && width(narrowest + 1) > width(narrowest - 1) {
                kept[narrowest + 1].0 = kept[narrowest].0;
            }
            kept.remove(narrowest);
        }
    }
}

/// Indices of the starts between two floats, that at the lower one excluded.
fn starts_within(starts: &[f64], low: u32, high: u32) -> std::ops::Range<usize> {
    let (low, high) = (of_bits(low), of_bits(high));
    let from = starts.partition_point(|&start| start <= low);
    from..starts.partition_point(|&start| start < high).max(from)
}

fn bucket(starts: &[f64], inside: std::ops::Range<usize>) -> (u32, [f64; BUCKET - 1]) {
    let mut next = [f64::from(f32::MAX); BUCKET - 1];
    next.iter_mut().zip(&starts[inside.clone()]).for_each(|(next, &start)| *next = start);
    (inside.start.max(1) as u32 - 1, next)
}

/// Whether no bucket of an octave has more starts behind its lower end than it can hold.
fn fits(inside: &[f64], depth: u32) -> bool {
    let (shift, edge) = (MANTISSA - depth, (1u32 << (MANTISSA - depth)) - 1);
    let at_edge = |x: f64| bits(x) & edge == 0 && f64::from(f32::from_bits(bits(x))) == x;
    inside
        .windows(BUCKET)
        .all(|starts| bits(starts[0]) >> shift != bits(starts[BUCKET - 1]) >> shift || at_edge(starts[0]))
}

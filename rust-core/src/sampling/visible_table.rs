//! The table from which visible normals are drawn: one monotone spline in ρ², or in the odds of the profile, for every roughness
//! and direction.
//!
//! In stretched slopes the visible slopes seen under `a = cot θ` have the radial density
//! `n(ρ; a) = (2A/π) f(ρ) ρ [π a + k(ρ, a)]`, `k = √(ρ²−a²) − a acos(a/ρ)` for ρ > a and 0 below,
//! with total mass `a + H(a)`. A row of the table holds, at knots `y` (ρ², or what [`crate::profile::Coordinate`] says), the share `C` of the mass above y and
//! `g = −dC/dy`; rows are spaced evenly in `a/(a + b)`. Interpolating C and g between two rows gives
//! the knot values and slopes of one monotone rational-quadratic spline (Gregory & Delbourgo 1982), which has a
//! closed-form inverse. The spline *is* the sampling density, so its error costs variance and never bias.
//!
//! At ρ² rather than ρ the density at the normal itself is neither 0 nor ∞. Masses are counted from above because tails need
//! relative accuracy in single precision, and because 1 − u is exact for a single-precision u.

use crate::masking::MaskingIntegral;
use crate::masking::smith_kernel::bracket;
use crate::numerics::greatest;
use crate::numerics::quadrature::gauss;
use crate::profile::{Coordinate, Profile, Tail};
use crate::sampling::coordinate;
use std::f64::consts::PI;

pub use crate::constants::{BLOCK, CELLS, LEAST_SHARE, VIEW_ROWS};

/// Length of a list of knots or masses with every eighth in front.
pub const LIST_SIZE: usize = BLOCK + CELLS;
/// Length of a list, and of a pair of numbers for each cell: what the knots and every row take in the flat table.
pub const ROW_SIZE: usize = LIST_SIZE + 2 * CELLS;
/// Stretched slopes beyond this are not drawn: their reflection is below the horizon for every view that is farther than
/// 1e-8 from grazing (roughness 1e-4), and ρ⁴ still fits into single precision.
const SLOPE_CAP: f64 = 1e9;

/// Gauss points per piece: masses need no more than single precision.
const POINTS: usize = 12;
/// Depth to which knots are placed: e^−40 of the peak.
const PLACING_DEPTH: f64 = 40.0;

/// Knots, masses above them and densities, in single precision as renderers read them.
#[derive(Debug, Clone)]
pub struct VisibleTable {
    flat: Vec<f32>,
    rows: usize,
    scale: f64,
    slopes: [f64; CELLS],
}

/// A point of the interpolated spline: which cell, and its two ends.
#[derive(Debug, Clone, Copy)]
struct Cell {
    y: f64,
    width: f64,
    mass: f64,
    inverse_mass: f64,
    /// densities at both ends, in units of mass/width
    ends: (f64, f64),
}

/// A row, or a mixture of two neighbours.
#[derive(Debug, Clone, Copy)]
pub struct Mixture {
    row: usize,
    t: f64,
}

impl VisibleTable {
    /// Tabulates a profile.
    pub fn new(profile: &dyn Profile, masking: &MaskingIntegral) -> Self {
        Self::with_rows(profile, masking, VIEW_ROWS)
    }

    /// The row of D·cos alone, an eighth of the size: every view is that along the normal.
    pub fn projected(profile: &dyn Profile, masking: &MaskingIntegral) -> Self {
        Self::with_rows(profile, masking, 1)
    }

    /// The last `rows` rows, of `VIEW_ROWS`.
    fn with_rows(profile: &dyn Profile, masking: &MaskingIntegral, rows: usize) -> Self {
        let scale = row_scale(profile);
        let breaks = profile.breaks(PLACING_DEPTH);
        let knots = place_knots(profile, &breaks, scale);
        let mut flat = Vec::with_capacity((1 + rows) * ROW_SIZE);
        let stored = knots.map(|rho| coordinate::of_slope(profile, rho) as f32);
        extend_list(&mut flat, &stored);
        extend_cells(&mut flat, &stored, |ends| [ends[0], ends[1] - ends[0]]);
        let shrunk = knots.map(|rho| coordinate::shrunk_f(profile, coordinate::of_slope(profile, rho), profile.f(rho)));
        // nodes and profile are shared by all rows
        let cells: Vec<Vec<Sample>> =
            knots.windows(2).map(|ends| samples(profile, &breaks, ends[0], ends[1])).collect();
        let factor = profile.normalization() / PI;
        for row in VIEW_ROWS - rows..VIEW_ROWS {
            let position = row as f64 / (VIEW_ROWS - 1) as f64;
            let view = RowView { position, scale };
            // the lost cell: what lies beyond the last finite knot
            let masses: Vec<f64> = cells
                .iter()
                .map(|cell| cell.iter().map(|node| 2.0 * factor * node.mass * view.kernel(node.rho)).sum())
                .collect();
            let total = match view.cotangent() {
                Some(a) => (a + masking.at(profile, a).h) / (a + scale),
                None => 1.0,
            };
            let lost = (total - masses.iter().sum::<f64>()).max(0.0);
            let mut above = [lost; CELLS];
            for j in (0..CELLS - 1).rev() {
                above[j] = above[j + 1] + masses[j];
            }
            let share = 1.0 / above[0];
            let above = above.map(|mass| (share * mass) as f32);
            extend_list(&mut flat, &above);
            let density: [f32; CELLS] =
                std::array::from_fn(|j| (share * factor * shrunk[j] * view.kernel(knots[j])) as f32);
            let mut masses = above.windows(2).map(|ends| ends[0] - ends[1]);
            extend_cells(&mut flat, &density, |ends| [masses.next().unwrap_or(0.0), packed(ends[0], ends[1])]);
        }
        debug_assert_eq!(flat.len(), (1 + rows) * ROW_SIZE);
        let slopes = stored.map(|y| coordinate::slope(profile, f64::from(y)));
        Self { flat, rows, scale, slopes }
    }

    /// The knots y, every eighth in front of all 64, and 63 pairs of a cell's left knot and width; then rows: the masses C above
    /// the knots likewise, and pairs of a cell's mass and the densities g at its two ends, 16 bits each. Two zeros end each.
    pub fn flat(&self) -> &[f32] {
        &self.flat
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The finite knots as slopes ρ.
    pub fn slopes(&self) -> &[f64] {
        &self.slopes
    }

    /// The b of the row coordinate a/(a + b).
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// The row coordinate for a stretched view with the given cosine and sine, both times any positive number.
    pub fn mixture(&self, cos: f64, sin: f64) -> Mixture {
        if self.rows < VIEW_ROWS {
            return self.unseen();
        }
        let r = cos / (cos + sin * self.scale) * (VIEW_ROWS - 1) as f64;
        let row = (r as usize).min(VIEW_ROWS - 2);
        Mixture { row, t: r - row as f64 }
    }

    /// The last row alone: the distribution of D·cos, seen along the normal.
    pub fn unseen(&self) -> Mixture {
        Mixture { row: self.rows - 1, t: 0.0 }
    }

    /// The finite knots y.
    pub fn knots(&self) -> &[f32] {
        &self.flat[BLOCK..LIST_SIZE]
    }

    fn knot(&self, j: usize) -> f64 {
        f64::from(self.flat[BLOCK + j])
    }

    /// Both rows of a mixture.
    #[inline]
    fn mixed(&self, mixture: Mixture) -> Rows<'_> {
        let row = |index: usize| {
            let start = (1 + index) * ROW_SIZE;
            let (list, pairs) = self.flat[start..start + ROW_SIZE].split_at(LIST_SIZE);
            Row { masses: list.as_chunks().0, pairs: pairs.as_chunks().0 }
        };
        Rows { first: row(mixture.row), second: row((mixture.row + 1).min(self.rows - 1)), t: mixture.t }
    }

    #[inline]
    fn cell(&self, rows: &Rows, j: usize) -> Cell {
        let [mass, g0, g1] = rows.cell(j);
        let (y, width) = (self.knot(j), self.knot(j + 1) - self.knot(j));
        let inverse_mass = if mass > 0.0 { 1.0 / mass } else { 0.0 };
        let unit = width * inverse_mass;
        Cell { y, width, mass, inverse_mass, ends: (g0 * unit, g1 * unit) }
    }

    /// Draws y from u in [0, 1); the density per dy, or `None` for a normal lost at the horizon.
    pub fn sample(&self, mixture: Mixture, u: f64) -> Option<(f64, f64)> {
        let rows = self.mixed(mixture);
        let target = 1.0 - u;
        let j = last_where(|k| rows.masses(k), |mass| mass >= target);
        if j == CELLS - 1 {
            return None;
        }
        let cell = self.cell(&rows, j);
        if cell.mass <= 0.0 {
            return None;
        }
        let q = ((rows.above(j) - target) * cell.inverse_mass).clamp(0.0, 1.0);
        let (d0, d1) = cell.ends;
        let k = d0 + d1 - 2.0;
        let b = d0 - q * k;
        let below = b + (b * b + 4.0 * (1.0 - b) * q).max(0.0).sqrt();
        let tau = if below > 0.0 { (2.0 * q / below).min(1.0) } else { 0.0 };
        Some((cell.y + tau * cell.width, cell.density(tau)))
    }

    /// The share of what [`VisibleTable::sample`] draws that is below y: with u times it, nothing else is drawn, and the density is [`VisibleTable::density`]
    /// by it. At least [`LEAST_SHARE`], whose rest is drawn in vain.
    pub fn share_below(&self, mixture: Mixture, y: f64) -> f64 {
        let rows = self.mixed(mixture);
        let knots = self.flat[..LIST_SIZE].as_chunks::<BLOCK>().0;
        let j = last_where(|k| knots[k].map(f64::from), |knot| knot <= y);
        let above = rows.above(j);
        let below = if j == CELLS - 1 {
            0.0
        } else {
            let cell = self.cell(&rows, j);
            cell.mass * cell.share((y - cell.y) / cell.width)
        };
        (1.0 - (above - below)).max(LEAST_SHARE)
    }

    /// Density per dy of what [`VisibleTable::sample`] draws.
    pub fn density(&self, mixture: Mixture, y: f64) -> f64 {
        let knots = self.flat[..LIST_SIZE].as_chunks::<BLOCK>().0;
        let j = last_where(|k| knots[k].map(f64::from), |knot| knot <= y);
        if j == CELLS - 1 {
            return 0.0;
        }
        let cell = self.cell(&self.mixed(mixture), j);
        cell.density((y - cell.y) / cell.width)
    }
}

/// Appends every eighth value, then all of them.
fn extend_list(flat: &mut Vec<f32>, values: &[f32; CELLS]) {
    flat.extend(values.iter().step_by(BLOCK));
    flat.extend(values);
}

/// Appends a pair for each cell, from the values at its ends, and two zeros.
fn extend_cells(flat: &mut Vec<f32>, ends: &[f32; CELLS], pair: impl FnMut(&[f32]) -> [f32; 2]) {
    flat.extend(ends.windows(2).flat_map(pair));
    flat.extend([0.0; 2]);
}

/// Two densities in the upper and the lower half of one number, each rounded to eight bits and the exponent: the spline *is* the
/// density, so that 0.2 % at its knots costs 4e-6 of variance.
fn packed(first: f32, second: f32) -> f32 {
    let half = |x: f32| {
        let bits = x.min(3e38).to_bits();
        (bits + 0x7FFF + ((bits >> 16) & 1)) >> 16
    };
    f32::from_bits((half(first) << 16) | half(second))
}

/// A row of the flat table: blocks of the list of masses, and pairs (mass, packed densities).
#[derive(Clone, Copy)]
struct Row<'a> {
    masses: &'a [[f32; BLOCK]],
    pairs: &'a [[f32; 2]],
}

/// Two rows and where between them.
struct Rows<'a> {
    first: Row<'a>,
    second: Row<'a>,
    t: f64,
}

impl Rows<'_> {
    #[inline]
    fn mix(&self, first: f32, second: f32) -> f64 {
        let (a, b) = (f64::from(first), f64::from(second));
        self.t.mul_add(b - a, a)
    }

    /// Masses above the knots of block k; block 0 has every eighth knot.
    #[inline]
    fn masses(&self, k: usize) -> [f64; BLOCK] {
        let (first, second) = (&self.first.masses[k], &self.second.masses[k]);
        std::array::from_fn(|i| self.mix(first[i], second[i]))
    }

    /// Mass above knot j.
    #[inline]
    fn above(&self, j: usize) -> f64 {
        let (k, i) = (1 + j / BLOCK, j % BLOCK);
        self.mix(self.first.masses[k][i], self.second.masses[k][i])
    }

    /// The mass of cell j and the densities at its ends.
    #[inline]
    fn cell(&self, j: usize) -> [f64; 3] {
        let unpacked = |[mass, ends]: [f32; 2]| {
            let bits = ends.to_bits();
            [mass, f32::from_bits(bits & 0xFFFF_0000), f32::from_bits(bits << 16)]
        };
        let (first, second) = (unpacked(self.first.pairs[j]), unpacked(self.second.pairs[j]));
        std::array::from_fn(|i| self.mix(first[i], second[i]))
    }
}

/// The last cell whose left knot has a value that `holds`, which is taken for granted at the first of a block.
#[inline]
fn last_where(block: impl Fn(usize) -> [f64; BLOCK], holds: impl Fn(f64) -> bool) -> usize {
    // eight comparisons side by side are faster than three in turn
    let count = |values: [f64; BLOCK]| values[1..].iter().map(|&value| usize::from(holds(value))).sum::<usize>();
    let k = count(block(0));
    k * BLOCK + count(block(k + 1))
}

impl Cell {
    /// The share of the cell's mass below the fraction τ of its width.
    fn share(&self, tau: f64) -> f64 {
        let (d0, d1) = self.ends;
        let rest = tau * (1.0 - tau);
        tau.mul_add(tau, d0 * rest) / (d0 + d1 - 2.0).mul_add(rest, 1.0)
    }

    fn density(&self, tau: f64) -> f64 {
        if self.mass <= 0.0 {
            return 0.0;
        }
        let (d0, d1) = self.ends;
        let rest = tau * (1.0 - tau);
        let below = (d0 + d1 - 2.0).mul_add(rest, 1.0);
        let above = (d1 * tau).mul_add(tau, rest.mul_add(2.0, d0 * (1.0 - tau) * (1.0 - tau)));
        self.mass * above / (self.width * below * below)
    }
}

/// The view that a row stands for.
#[derive(Clone, Copy)]
struct RowView {
    position: f64,
    scale: f64,
}

impl RowView {
    /// a, or `None` where it is infinite.
    fn cotangent(&self) -> Option<f64> {
        (self.position < 1.0).then(|| self.scale * self.position / (1.0 - self.position))
    }

    /// `[π a + k(ρ, a)]/(a + b)`, finite for every a.
    fn kernel(&self, rho: f64) -> f64 {
        let Some(a) = self.cotangent() else { return PI };
        let k = if rho > a { bracket(a, rho, rho - a).0 } else { 0.0 };
        (PI * a + k) / (a + self.scale)
    }
}

/// The profile at a slope.
#[derive(Clone, Copy)]
struct Sample {
    rho: f64,
    y: f64,
    /// f d(ρ²)/dy
    shrunk: f64,
    /// weight · f · ρ
    mass: f64,
}

/// The profile at Gauss points between `left` and `right`, on pieces that end at its break points.
fn samples(profile: &dyn Profile, breaks: &[f64], left: f64, right: f64) -> Vec<Sample> {
    let rule = gauss(POINTS);
    let first = breaks.partition_point(|&x| x <= left);
    let last = breaks.partition_point(|&x| x < right);
    let inside = breaks[first..last].iter().copied();
    let mut start = left;
    let mut samples = Vec::with_capacity(POINTS * (1 + last - first));
    for end in inside.chain([right]) {
        // power tails are smooth in ln ρ
        let log = if end > 2.0 * start && start > 0.0 { (end / start).ln() } else { 0.0 };
        samples.extend(rule.nodes().iter().map(|&(t, weight)| {
            let (rho, weight) = if log > 0.0 {
                let rho = start * (t * log).exp();
                (rho, weight * log * rho)
            } else {
                (start + t * (end - start), weight * (end - start))
            };
            let (f, y) = (profile.f(rho), coordinate::of_slope(profile, rho));
            Sample { rho, y, shrunk: coordinate::shrunk_f(profile, y, f), mass: weight * rho * f }
        }));
        start = end;
    }
    samples
}

/// b: the slope at which masking changes its regime.
fn row_scale(profile: &dyn Profile) -> f64 {
    profile.mean() / PI
}

/// Cells below the mode with a smaller share than this would drown in the rounding of the masses above them.
const LEAST_MASS: f64 = 2e-6;
/// Break points are set for quadrature and often lie too close for knots: cells begin with this share, which is worth halving.
const LIGHT: f64 = 1e-3;
/// Shares of D·cos above the first knots over the odds.
const ODDS_SHARES: [f64; 7] = [0.98, 0.8, 0.5, 0.2, 0.05, 5e-3, 1e-4];
/// The views at whose rows the excess is measured: horizon, middle, normal.
const PROBES: [f64; 3] = [0.0, 0.5, 1.0];
/// Knots are moved at most so many times once all are spent.
const MOVES: usize = 4 * CELLS;
/// Knots beyond the end of a profile: each so much farther out than the last.
const PADDING: f64 = 1.0625;

/// A cell while knots are being placed.
struct Draft {
    left: f64,
    right: f64,
    /// y at both ends
    ends: [f64; 2],
    samples: Vec<Sample>,
    /// what each probe sees of it
    masses: [f64; 3],
    /// its part of E[w²] − 1 for each probe
    excess: [f64; 3],
    /// cannot be halved any more
    whole: bool,
}

impl Draft {
    /// The slope that halves the mass of ρ f, one of the samples.
    fn middle(&self) -> f64 {
        let total: f64 = self.samples.iter().map(|n| n.mass).sum();
        let mut sum = 0.0;
        for (k, sample) in self.samples.iter().enumerate() {
            sum += sample.mass;
            if sum >= 0.5 * total && total > 0.0 {
                // never the outermost one: a cell must shrink by a real amount
                return self.samples[k.clamp(2, self.samples.len() - 3)].rho;
            }
        }
        self.samples[self.samples.len() / 2].rho
    }

    fn worst(&self) -> f64 {
        greatest(self.excess)
    }
}

/// Whether two knots y are still two in single precision.
fn apart([left, right]: [f64; 2]) -> bool {
    (left as f32) < right as f32
}

/// Places the 64 finite knots, ascending from 0, where they lower E[w²] most.
///
/// Few break points: cells between them are halved (by mass), the one with the greatest excess first, until all knots are spent. As
/// many as there are knots: neighbors are joined first, those that raise the excess least; then knots move from where a join costs least to
/// where a halving gains most.
fn place_knots(profile: &dyn Profile, breaks: &[f64], scale: f64) -> [f64; CELLS] {
    let cap = coordinate::cap(profile, SLOPE_CAP);
    let mut ends = vec![0.0];
    match profile.coordinate() {
        Coordinate::Square => ends.extend(breaks.iter().copied().filter(|&x| x < cap)),
        // f has dropped out, and its break points with it
        Coordinate::Odds => {
            let shares = ODDS_SHARES.iter().map(|&share| profile.isf(share)).filter(|&x| x < cap);
            ends.extend(shares.chain((cap < SLOPE_CAP).then_some(cap)));
            ends.dedup();
        }
    }
    if matches!(profile.tail(), Tail::Power { .. }) && cap == SLOPE_CAP || ends.len() < 2 {
        ends.push(SLOPE_CAP);
    }
    let probes = PROBES.map(|position| RowView { position, scale });
    let mut placing = Placing { profile, breaks, probes, totals: [0.0; 3] };
    let mut drafts: Vec<Draft> = ends.windows(2).map(|pair| placing.draft(pair[0], pair[1])).collect();
    for draft in &drafts {
        placing.totals.iter_mut().zip(draft.masses).for_each(|(total, mass)| *total += mass);
    }
    if drafts.len() < CELLS {
        drafts = placing.without_light_ones(drafts);
        drafts.iter_mut().for_each(|draft| placing.measure(draft));
        placing.halve(&mut drafts);
    } else {
        drafts.iter_mut().for_each(|draft| placing.measure(draft));
        placing.join_and_move(&mut drafts);
    }
    let ends = drafts.iter().map(|draft| draft.left).chain(drafts.last().map(|draft| draft.right));
    let mut knots = [f64::NAN; CELLS];
    knots.iter_mut().zip(ends).for_each(|(knot, end)| *knot = end);
    // a profile so narrow that cells cannot be halved any more leaves empty cells at its end
    for k in drafts.len() + 1..CELLS {
        knots[k] = knots[k - 1] * PADDING;
    }
    debug_assert!(
        knots[0] == 0.0 && knots.is_sorted_by(|&a, &b| apart([a, b].map(|x| coordinate::of_slope(profile, x)))),
        "{knots:?}"
    );
    knots
}

/// What places knots.
struct Placing<'a> {
    profile: &'a dyn Profile,
    breaks: &'a [f64],
    probes: [RowView; 3],
    /// what each probe sees of all slopes
    totals: [f64; 3],
}

impl Placing<'_> {
    fn draft(&self, left: f64, right: f64) -> Draft {
        self.weighed(left, right, samples(self.profile, self.breaks, left, right))
    }

    fn weighed(&self, left: f64, right: f64, samples: Vec<Sample>) -> Draft {
        let masses = self.probes.map(|probe| samples.iter().map(|n| n.mass * probe.kernel(n.rho)).sum::<f64>());
        let ends = [left, right].map(|rho| coordinate::of_slope(self.profile, rho));
        Draft { left, right, ends, samples, masses, excess: [0.0; 3], whole: false }
    }

    fn measure(&self, draft: &mut Draft) {
        draft.excess = std::array::from_fn(|k| self.excess(draft, k) / self.totals[k]);
    }

    /// `∫ n²/n̂ − ∫ n` over a cell for the spline n̂ with the cell's exact mass and end densities.
    fn excess(&self, draft: &Draft, probe: usize) -> f64 {
        let (view, mass) = (&self.probes[probe], draft.masses[probe]);
        if mass <= 0.0 {
            return 0.0;
        }
        let [y0, y1] = draft.ends;
        // densities per dy are half those per ρ dρ
        let end = |rho: f64, y: f64| {
            let shrunk = coordinate::shrunk_f(self.profile, y, self.profile.f(rho));
            0.5 * shrunk * view.kernel(rho) * (y1 - y0) / mass
        };
        let ends = (end(draft.left, y0), end(draft.right, y1));
        let cell = Cell { y: y0, width: y1 - y0, mass, inverse_mass: 1.0 / mass, ends };
        let second: f64 = draft
            .samples
            .iter()
            .map(|n| {
                let kernel = view.kernel(n.rho);
                // n.mass carries ρ dρ f; the density per dy is f d(ρ²)/dy kernel / 2
                let exact = 0.5 * n.shrunk * kernel;
                let spline = cell.density((n.y - y0) / (y1 - y0));
                if spline > 0.0 { n.mass * kernel * exact / spline } else { 0.0 }
            })
            .sum();
        (second - mass).max(0.0)
    }

    /// Whether a cell has less than a share of the mass in every probe.
    fn lighter(&self, draft: &Draft, share: f64) -> bool {
        draft.masses.iter().zip(&self.totals).all(|(mass, total)| *mass < share * total)
    }

    fn joined(&self, first: &Draft, second: &Draft) -> Draft {
        self.weighed(first.left, second.right, [&first.samples[..], &second.samples].concat())
    }

    /// Cells that do not deserve their own knot join the one before.
    fn without_light_ones(&self, drafts: Vec<Draft>) -> Vec<Draft> {
        let mut joined: Vec<Draft> = Vec::with_capacity(CELLS);
        for draft in drafts {
            match joined.last_mut() {
                Some(last)
                    if self.lighter(last, LIGHT)
                        || self.lighter(&draft, LIGHT)
                        || !apart(last.ends)
                        || !apart(draft.ends) =>
                {
                    *last = self.joined(last, &draft);
                }
                _ => joined.push(draft),
            }
        }
        joined
    }

    /// Halves the cell with the greatest excess until all knots are spent.
    fn halve(&self, drafts: &mut Vec<Draft>) {
        while drafts.len() < CELLS - 1
            && let Some((worst, halves)) = self.next_halves(drafts)
        {
            drafts.splice(worst..=worst, halves);
        }
    }

    /// The cell with the greatest excess among those that can be halved, and its halves; marks those that cannot.
    fn next_halves(&self, drafts: &mut [Draft]) -> Option<(usize, [Draft; 2])> {
        loop {
            let candidates = (0..drafts.len()).filter(|&k| !drafts[k].whole);
            let worst = candidates.max_by(|&i, &j| drafts[i].worst().total_cmp(&drafts[j].worst()))?;
            let Draft { left, right, ends: [y0, y1], .. } = drafts[worst];
            let middle = drafts[worst].middle();
            let y = coordinate::of_slope(self.profile, middle);
            if apart([y0, y]) && apart([y, y1]) {
                let mut halves = [(left, middle), (middle, right)].map(|(left, right)| self.draft(left, right));
                if !halves.iter().any(|half| self.lighter(half, LEAST_MASS)) {
                    halves.iter_mut().for_each(|half| self.measure(half));
                    return Some((worst, halves));
                }
            }
            drafts[worst].whole = true;
        }
    }

    /// By how much a join raises the excess; less than anything where both should be one.
    fn price(&self, first: &Draft, second: &Draft) -> f64 {
        let lost = |draft: &Draft| self.lighter(draft, LEAST_MASS) || !apart(draft.ends);
        if lost(first) || lost(second) {
            return f64::NEG_INFINITY;
        }
        let mut joined = self.joined(first, second);
        self.measure(&mut joined);
        greatest([0, 1, 2].map(|k| joined.excess[k] - first.excess[k] - second.excess[k]))
    }

    /// Joins neighbors until there are few enough, then moves knots as long as it pays.
    fn join_and_move(&self, drafts: &mut Vec<Draft>) {
        let mut prices: Vec<f64> = drafts.windows(2).map(|pair| self.price(&pair[0], &pair[1])).collect();
        let cheapest = |prices: &[f64], without: Option<usize>| {
            let free = (0..prices.len()).filter(|&k| without.is_none_or(|cell| k != cell && k + 1 != cell));
            free.min_by(|&i, &j| prices[i].total_cmp(&prices[j]))
        };
        // prices of both joins of the cells from..=to
        let reprice = |drafts: &[Draft], prices: &mut [f64], from: usize, to: usize| {
            for k in from.saturating_sub(1)..(to + 1).min(prices.len()) {
                prices[k] = self.price(&drafts[k], &drafts[k + 1]);
            }
        };
        let join = |drafts: &mut Vec<Draft>, prices: &mut Vec<f64>, k: usize| {
            let mut joined = self.joined(&drafts[k], &drafts[k + 1]);
            self.measure(&mut joined);
            drafts.splice(k..k + 2, [joined]);
            prices.remove(k);
            reprice(drafts, prices, k, k);
        };
        while (drafts.len() >= CELLS || prices.contains(&f64::NEG_INFINITY))
            && let Some(k) = cheapest(&prices, None)
        {
            join(drafts, &mut prices, k);
        }
        self.halve(drafts);
        prices = drafts.windows(2).map(|pair| self.price(&pair[0], &pair[1])).collect();
        for _ in 0..MOVES {
            let Some((worst, halves)) = self.next_halves(drafts) else { return };
            let Some(k) = cheapest(&prices, Some(worst)) else { return };
            let gain = greatest(
                [0, 1, 2].map(|probe| drafts[worst].excess[probe] - halves[0].excess[probe] - halves[1].excess[probe]),
            );
            if gain <= prices[k] {
                drafts[worst].whole = true;
                continue;
            }
            drafts.splice(worst..=worst, halves);
            prices.insert(worst, f64::INFINITY);
            reprice(drafts, &mut prices, worst, worst + 1);
            join(drafts, &mut prices, if k > worst { k + 1 } else { k });
        }
    }
}

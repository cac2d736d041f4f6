//! The table from which visible normals are drawn: one monotone spline in ρ², for every roughness and direction.
//!
//! In stretched slopes the visible slopes seen under `a = cot θ` have the radial density
//! `n(ρ; a) = (2A/π) f(ρ) ρ [π a + k(ρ, a)]`, `k = √(ρ²−a²) − a acos(a/ρ)` for ρ > a and 0 below,
//! with total mass `a + H(a)`. A row of the table holds, at knots `y = ρ²`, the share `C` of the mass above y and
//! `g = −dC/dy`; rows are spaced evenly in `a/(a + b)`. Interpolating C and g between two rows gives
//! the knot values and slopes of one monotone rational-quadratic spline (Gregory & Delbourgo 1982), which has a
//! closed-form inverse. The spline *is* the sampling density, so its error costs variance and never bias.
//!
//! At ρ² rather than ρ the density at the normal itself is neither 0 nor ∞. Masses are counted from above because tails need
//! relative accuracy in single precision, and because 1 − u is exact for a single-precision u.

use crate::masking::MaskingIntegral;
use crate::masking::smith_kernel::bracket;
use crate::numerics::quadrature::gauss;
use crate::profile::Profile;
use std::f64::consts::PI;

/// Number of cells in ρ².
pub const CELLS: usize = 64;
/// Number of rows in a/(a + b).
pub const ROWS: usize = 15;
/// Values that are compared at a time: every eighth knot selects a block of eight.
pub const BLOCK: usize = 8;
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
        Self::with_rows(profile, masking, ROWS)
    }

    /// The row of D·cos alone, an eighth of the size: every view is that along the normal.
    pub fn projected(profile: &dyn Profile, masking: &MaskingIntegral) -> Self {
        Self::with_rows(profile, masking, 1)
    }

    /// The last `rows` rows, of `ROWS`.
    fn with_rows(profile: &dyn Profile, masking: &MaskingIntegral, rows: usize) -> Self {
        let scale = row_scale(profile);
        let breaks = profile.breaks(PLACING_DEPTH);
        let knots = place_knots(profile, &breaks, scale);
        let mut flat = Vec::with_capacity((1 + rows) * ROW_SIZE);
        let squares: Vec<f32> = knots.iter().map(|&rho| (rho * rho) as f32).collect();
        extend_list(&mut flat, &squares);
        extend_cells(&mut flat, &squares, |ends| [ends[0], ends[1] - ends[0]]);
        // nodes and profile are shared by all rows
        let cells: Vec<Vec<Node>> = knots.windows(2).map(|ends| nodes(profile, &breaks, ends[0], ends[1])).collect();
        let factor = profile.normalization() / PI;
        for row in ROWS - rows..ROWS {
            let position = row as f64 / (ROWS - 1) as f64;
            let view = View { position, scale };
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
            let mut above = vec![lost; CELLS];
            for j in (0..CELLS - 1).rev() {
                above[j] = above[j + 1] + masses[j];
            }
            let share = 1.0 / above[0];
            let above: Vec<f32> = above.iter().map(|&mass| (share * mass) as f32).collect();
            extend_list(&mut flat, &above);
            let density: Vec<f32> =
                knots.iter().map(|&rho| (share * factor * profile.f(rho) * view.kernel(rho)) as f32).collect();
            let mut masses = above.windows(2).map(|ends| ends[0] - ends[1]);
            extend_cells(&mut flat, &density, |ends| [masses.next().unwrap_or(0.0), packed(ends[0], ends[1])]);
        }
        Self { flat, rows, scale }
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
    pub fn slopes(&self) -> Vec<f64> {
        self.knots().iter().map(|&y| f64::from(y).sqrt()).collect()
    }

    /// The b of the row coordinate a/(a + b).
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// The row coordinate for a stretched view with the given cosine and sine, both times any positive number.
    pub fn mixture(&self, cos: f64, sin: f64) -> Mixture {
        if self.rows < ROWS {
            return self.unseen();
        }
        let r = cos / (cos + sin * self.scale) * (ROWS - 1) as f64;
        let row = (r as usize).min(ROWS - 2);
        Mixture { row, t: r - row as f64 }
    }

    /// The last row alone: the distribution of D·cos, seen along the normal.
    pub fn unseen(&self) -> Mixture {
        Mixture { row: self.rows - 1, t: 0.0 }
    }

    /// The finite knots, ρ².
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

    /// Draws ρ² from u in [0, 1); the density per dρ², or `None` for a normal lost at the horizon.
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

    /// Density per dρ² of what [`VisibleTable::sample`] draws.
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
fn extend_list(flat: &mut Vec<f32>, values: &[f32]) {
    flat.extend(values.iter().step_by(BLOCK));
    flat.extend(values);
}

/// Appends a pair for each cell, from the values at its ends, and two zeros.
fn extend_cells(flat: &mut Vec<f32>, ends: &[f32], pair: impl FnMut(&[f32]) -> [f32; 2]) {
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
struct View {
    position: f64,
    scale: f64,
}

impl View {
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

struct Node {
    rho: f64,
    /// weight · f · ρ
    mass: f64,
}

/// Gauss nodes between `left` and `right`, on pieces that end at the profile's break points.
fn nodes(profile: &dyn Profile, breaks: &[f64], left: f64, right: f64) -> Vec<Node> {
    let rule = gauss(POINTS);
    let first = breaks.partition_point(|&x| x <= left);
    let last = breaks.partition_point(|&x| x < right);
    let inside = breaks[first..last].iter().copied();
    let mut start = left;
    let mut nodes = Vec::with_capacity(POINTS * (1 + last - first));
    for end in inside.chain([right]) {
        // power tails are smooth in ln ρ
        let log = if end > 2.0 * start && start > 0.0 { (end / start).ln() } else { 0.0 };
        nodes.extend(rule.nodes().iter().map(|&(t, weight)| {
            let (rho, weight) = if log > 0.0 {
                let rho = start * (t * log).exp();
                (rho, weight * log * rho)
            } else {
                (start + t * (end - start), weight * (end - start))
            };
            Node { rho, mass: weight * rho * profile.f(rho) }
        }));
        start = end;
    }
    nodes
}

/// b: the slope at which masking changes its regime.
fn row_scale(profile: &dyn Profile) -> f64 {
    profile.mean() / PI
}

/// Cells below the mode with a smaller share than this would drown in the rounding of the masses above them.
const LEAST_MASS: f64 = 2e-6;

/// A cell while knots are being placed.
struct Draft {
    left: f64,
    right: f64,
    nodes: Vec<Node>,
    excess: f64,
}

/// Places the 64 finite knots where they lower E[w²] most: the cell with the greatest excess is halved (by mass)
/// until all are spent.
fn place_knots(profile: &dyn Profile, breaks: &[f64], scale: f64) -> Vec<f64> {
    let probes = [0.0, 0.5, 1.0].map(|position| View { position, scale });
    let mut ends: Vec<f64> = breaks.iter().copied().filter(|&x| x < SLOPE_CAP).collect();
    ends.insert(0, 0.0);
    if let crate::profile::Tail::Power { .. } = profile.tail() {
        ends.push(SLOPE_CAP);
    }
    let drafts: Vec<Draft> = ends
        .windows(2)
        .map(|pair| Draft {
            left: pair[0],
            right: pair[1],
            nodes: nodes(profile, breaks, pair[0], pair[1]),
            excess: 0.0,
        })
        .collect();
    // totals per probe, so that excesses are shares of the whole
    let masses =
        |draft: &Draft| probes.map(|probe| draft.nodes.iter().map(|n| n.mass * probe.kernel(n.rho)).sum::<f64>());
    let totals = drafts.iter().map(masses).fold([0.0; 3], |sum, m| [sum[0] + m[0], sum[1] + m[1], sum[2] + m[2]]);
    // Break points that were set for quadrature lie too close for knots: cells begin with a share worth halving.
    let mut merged: Vec<Draft> = Vec::with_capacity(CELLS);
    for draft in drafts {
        match merged.last_mut() {
            Some(last) if light(last, &masses, &totals) || light(&draft, &masses, &totals) => {
                last.right = draft.right;
                last.nodes = nodes(profile, breaks, last.left, last.right);
            }
            _ => merged.push(draft),
        }
    }
    let mut drafts = merged;
    let measure = |draft: &mut Draft| {
        draft.excess =
            probes.iter().zip(totals).map(|(probe, total)| excess(profile, draft, probe) / total).fold(0.0, f64::max);
    };
    drafts.iter_mut().for_each(measure);
    while drafts.len() < CELLS - 1 {
        let Some(worst) = (0..drafts.len()).max_by(|&i, &j| drafts[i].excess.total_cmp(&drafts[j].excess)) else {
            break;
        };
        let draft = &drafts[worst];
        let middle = draft.middle();
        let halves = [(draft.left, middle), (middle, draft.right)];
        if draft.excess < 0.0 {
            break;
        }
        if !(middle > draft.left && middle < draft.right) {
            drafts[worst].excess = -1.0;
            continue;
        }
        let mut pair =
            halves.map(|(left, right)| Draft { left, right, nodes: nodes(profile, breaks, left, right), excess: 0.0 });
        if pair.iter().any(|half| masses(half).iter().zip(&totals).all(|(mass, total)| *mass < LEAST_MASS * total)) {
            drafts[worst].excess = -1.0;
            continue;
        }
        pair.iter_mut().for_each(measure);
        drafts.splice(worst..=worst, pair);
    }
    let mut knots: Vec<f64> = drafts.iter().map(|d| d.left).collect();
    knots.push(drafts.last().map_or(1.0, |d| d.right));
    // a profile so narrow that cells cannot be halved any more leaves empty cells at its end
    while knots.len() < CELLS {
        let last = knots[knots.len() - 1];
        knots.push(last * 1.0625);
    }
    knots
}

/// Whether a cell has so little mass in every probe that it does not deserve its own knot.
fn light(draft: &Draft, masses: &impl Fn(&Draft) -> [f64; 3], totals: &[f64; 3]) -> bool {
    masses(draft).iter().zip(totals).all(|(mass, total)| *mass < 1e-3 * total)
}

impl Draft {
    /// Halves the cell by mass of ρ f (weighed with ρ where that is more even), between the nodes.
    fn middle(&self) -> f64 {
        let total: f64 = self.nodes.iter().map(|n| n.mass).sum();
        let mut sum = 0.0;
        for (k, node) in self.nodes.iter().enumerate() {
            sum += node.mass;
            if sum >= 0.5 * total && total > 0.0 {
                // never the outermost node: a cell must shrink by a real amount
                return self.nodes[k.clamp(2, self.nodes.len() - 3)].rho;
            }
        }
        self.nodes[self.nodes.len() / 2].rho
    }
}

/// `∫ n²/n̂ − ∫ n` over a cell for the spline n̂ with the cell's exact mass and end densities.
fn excess(profile: &dyn Profile, draft: &Draft, view: &View) -> f64 {
    let mass: f64 = draft.nodes.iter().map(|n| n.mass * view.kernel(n.rho)).sum();
    if mass <= 0.0 {
        return 0.0;
    }
    let (y0, y1) = (draft.left * draft.left, draft.right * draft.right);
    // densities per dy are half those per ρ dρ
    let end = |rho: f64| 0.5 * profile.f(rho) * view.kernel(rho) * (y1 - y0) / mass;
    let ends = (end(draft.left), end(draft.right));
    let cell = Cell { y: y0, width: y1 - y0, mass, inverse_mass: 1.0 / mass, ends };
    let second: f64 = draft
        .nodes
        .iter()
        .map(|n| {
            let kernel = view.kernel(n.rho);
            // n.mass carries ρ dρ f; the density per dy is f kernel / 2
            let exact = 0.5 * profile.f(n.rho) * kernel;
            let spline = cell.density((n.rho * n.rho - y0) / (y1 - y0));
            if spline > 0.0 { n.mass * kernel * exact / spline } else { 0.0 }
        })
        .sum();
    (second - mass).max(0.0)
}

//! A profile given by points: measured, drawn, or computed elsewhere.
//!
//! Between two nodes `ln f` is linear in `ln(k² + x²)`, so every cell is a piece of a Student distribution, `f ∝ (k² + x²)^(−e)`: GGX and
//! Student's rows are exact with any nodes, power tails continue the last cell, and nothing bends at x = 0. With `w = k² + x²` and
//! `L = ln(w/w₀)` the mass of a cell from its left end on is
//!
//! `∫ t f dt = ½ f₀ w₀ (e^((1−e)L) − 1)/(1−e)`,
//!
//! a closed form with a closed inverse; neither has a special case at e = 1 when written with `(eᶻ − 1)/z` and `ln(1+z)/z`. Every mass is
//! counted from the end of the cell at which it is greatest, and 1 − F from above, so nothing cancels.
//!
//! A cell with a 0 at one end is linear in x², one with 0 at both ends is empty: rings may have an empty middle.
//!
//! The knee k is the one number that the nodes do not say. It is chosen where the table is straightest: where leaving out every node in
//! turn changes least.

use crate::error::{ParameterError, require};
use crate::numerics::quadrature::gauss;
use crate::profile::derivatives::Values;
use crate::profile::{Coordinate, Piece, Profile, Tail};

mod values;

/// Least and greatest number of nodes.
pub const NODES: (usize, usize) = (2, 1000);
/// A value below this share of the greatest is 0: the quotient of two values stays a number.
const LEAST_VALUE: f64 = 1e-300;
/// Mean slopes that are a roughness.
const WIDTHS: (f64, f64) = (1e-6, 1e6);
/// The greatest slope of a node: what single precision can square.
const GREATEST_SLOPE: f64 = 1e9;
/// Cells narrower than this in `ln(k² + x²)` have no slope that is a number.
const LEAST_SPAN: f64 = 1e-200;
/// Log-depth between break points.
const STEP: f64 = 6.0;
/// A panel beyond the knee spans no greater ratio of slopes, in units of ln: Gauss rules see the poles at ±ik.
const LOG_RATIO: f64 = 1.5;
/// How deep a panel may end below everything farther out: masking of a valley is that of what lies beyond.
const VALLEY: f64 = 60.0;
/// Break points go on this far into the part of a power tail that is exact.
const POWER_SPAN: f64 = 8.0;
/// Quantiles of power tails end here.
const X_MAX: f64 = 1e304;
/// Points per panel of the mean slope; its panels are those of masking.
const MEAN_POINTS: usize = 24;
/// ln f × x³ is followed this far below its peak for the mean slope.
const MEAN_DEPTH: f64 = 60.0;

/// What the values of a table are, up to a common factor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// D, normals per solid angle.
    Normals,
    /// D cos θ, their projected area: what an image of the microsurface seen from above counts.
    ProjectedNormals,
    /// D cos⁴ θ, normals per area of the plane of slopes: what a histogram of height differences in two directions counts.
    Slopes,
}

impl Quantity {
    /// D of a density of slopes is this at a slope times that density, and so on.
    pub fn per_slope_density(self, x: f64) -> f64 {
        x.mul_add(x, 1.0).sqrt().powi(self.power())
    }

    /// Finds a quantity by the name that users write.
    ///
    /// # Errors
    /// Lists the names there are.
    pub fn named(name: &str) -> Result<Self, ParameterError> {
        match name {
            "D" => Ok(Self::Normals),
            "D_cos" => Ok(Self::ProjectedNormals),
            "slope" => Ok(Self::Slopes),
            _ => {
                Err(ParameterError::UnknownName { name: "quantity", given: name.to_owned(), known: "D, D_cos, slope" })
            }
        }
    }

    /// The power of cos θ that makes it a density of slopes.
    fn power(self) -> i32 {
        match self {
            Self::Normals => 4,
            Self::ProjectedNormals => 3,
            Self::Slopes => 0,
        }
    }
}

/// How a table goes on beyond its last node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TableTail {
    /// As a power of the slope: the exponent that is given, or that of the last cell.
    Power(Option<f64>),
    /// Not at all.
    Cut,
}

/// What lies between two nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    /// f = f₀ (w/w₀)^(−e)
    Power {
        exponent: f64,
    },
    /// f proportional to the distance in x² from the end that is 0.
    Ramp {
        rising: bool,
    },
    Empty,
}

/// From a node to the next one.
#[derive(Debug, Clone, Copy)]
struct Cell {
    x: f64,
    end: f64,
    /// k² + x²
    w: f64,
    /// f at both ends
    f: f64,
    f_end: f64,
    log_f: f64,
    /// ln(w/w₀) of the whole cell
    span: f64,
    kind: Kind,
    /// ∫ t f dt
    mass: f64,
}

/// A table of f, at mean slope 1.
#[derive(Debug, Clone)]
pub struct TabulatedProfile {
    cells: Vec<Cell>,
    /// ends of all cells, and what lies below and above each
    ends: Vec<f64>,
    below: Vec<f64>,
    above: Vec<f64>,
    knee: f64,
    tail: Option<f64>,
    /// does the tail have the exponent of the last cell?
    tail_is_continued: bool,
    width: f64,
    normalization: f64,
    /// the number of values that were given
    given: usize,
    /// was a node at 0 added to them?
    begins_above_0: bool,
}

/// `(eᶻ − 1)/z`
fn exp_ratio(z: f64) -> f64 {
    if z == 0.0 { 1.0 } else { z.exp_m1() / z }
}

/// `ln(1 + z)/z`, z > −1
fn log_ratio(z: f64) -> f64 {
    if z == 0.0 { 1.0 } else { z.ln_1p() / z }
}

impl Cell {
    fn new([x, end]: [f64; 2], [f, f_end]: [f64; 2], [log_f, log_end]: [f64; 2], knee: f64) -> Self {
        let w = knee.mul_add(knee, x * x);
        let mut cell = Self { x, end, w, f, f_end, log_f, span: 0.0, kind: Kind::Empty, mass: 0.0 };
        cell.span = cell.log_w(end, 0.0);
        cell.kind = match (f > 0.0, f_end > 0.0) {
            (true, true) => Kind::Power { exponent: (log_f - log_end) / cell.span },
            (false, false) => Kind::Empty,
            (_, rising) => Kind::Ramp { rising },
        };
        cell.mass = cell.below(end);
        cell
    }

    /// ln(w/w₀) at from + past.
    fn log_w(&self, from: f64, past: f64) -> f64 {
        let growth = ((from - self.x) + past) * (from + past + self.x) / self.w;
        if growth < f64::INFINITY { growth.ln_1p() } else { 2.0 * (from + past).ln() - self.w.ln() }
    }

    /// x where ln(w/w₀) is `log`.
    fn at_log(&self, log: f64) -> f64 {
        if log > 600.0 {
            return (0.5 * log).exp() * self.w.sqrt();
        }
        self.x.mul_add(self.x, self.w * log.exp_m1()).sqrt()
    }

    /// Which share of the cell lies left of from + past, in x².
    fn share(&self, from: f64, past: f64) -> f64 {
        ((from - self.x) + past) * (from + past + self.x) / ((self.end - self.x) * (self.end + self.x))
    }

    fn f(&self, from: f64, past: f64) -> f64 {
        match self.kind {
            Kind::Power { exponent } => (self.log_f - exponent * self.log_w(from, past)).exp(),
            Kind::Ramp { rising: true } => self.f_end * self.share(from, past),
            Kind::Ramp { rising: false } => self.f * (1.0 - self.share(from, past)).max(0.0),
            Kind::Empty => 0.0,
        }
    }

    /// The same in x².
    fn piece(&self) -> Piece {
        let start = self.x * self.x;
        let rate = 1.0 / ((self.end - self.x) * (self.end + self.x));
        match self.kind {
            Kind::Power { exponent } => Piece { start, anchor: start, rate: 1.0 / self.w, log_f: self.log_f, exponent },
            Kind::Ramp { rising: true } => {
                Piece { start, anchor: self.end * self.end, rate, log_f: self.f_end.ln(), exponent: -1.0 }
            }
            Kind::Ramp { rising: false } => {
                Piece { start, anchor: start, rate: -rate, log_f: self.log_f, exponent: -1.0 }
            }
            Kind::Empty => Piece::empty(start),
        }
    }

    /// ∫ t f dt from the left end to x.
    fn below(&self, x: f64) -> f64 {
        match self.kind {
            Kind::Power { exponent } => {
                let (less, log) = (1.0 - exponent, self.log_w(x, 0.0));
                // counted from the end where w f is greater
                let unit = if less > 0.0 { self.f(x, 0.0) * self.w * log.exp() } else { self.f * self.w };
                0.5 * unit * log * exp_ratio(-(less * log).abs())
            }
            Kind::Ramp { rising } => {
                let (share, area) = (self.share(x, 0.0), 0.25 * (self.end - self.x) * (self.end + self.x));
                if rising { area * self.f_end * share * share } else { area * self.f * share * (2.0 - share) }
            }
            Kind::Empty => 0.0,
        }
    }

    /// ∫ t f dt from x to the right end.
    fn above(&self, x: f64) -> f64 {
        match self.kind {
            Kind::Power { exponent } => {
                let (less, w_end) = (1.0 - exponent, self.w * self.span.exp());
                let log = -((x - self.end) * (x + self.end) / w_end).max(-1.0).ln_1p().max(-self.span);
                let unit =
                    if less > 0.0 { self.f_end * w_end } else { self.f(x, 0.0) * self.w * self.log_w(x, 0.0).exp() };
                0.5 * unit * log * exp_ratio(-(less * log).abs())
            }
            Kind::Ramp { rising } => {
                let (width, area) = ((self.end - self.x) * (self.end + self.x), 0.25);
                let rest = (self.end - x) * (self.end + x) / width;
                let area = area * width;
                if rising { area * self.f_end * rest * (2.0 - rest) } else { area * self.f * rest * rest }
            }
            Kind::Empty => 0.0,
        }
    }

    /// x with ∫ t f dt = `mass` from the left end to it.
    fn at_below(&self, mass: f64) -> f64 {
        let x = match self.kind {
            Kind::Power { exponent } => {
                let less = 1.0 - exponent;
                let share = 2.0 * mass / (self.f * self.w);
                self.at_log((share * log_ratio((less * share).max(-1.0 + f64::EPSILON))).clamp(0.0, self.span))
            }
            Kind::Ramp { rising } => {
                let (width, share) = ((self.end - self.x) * (self.end + self.x), (mass / self.mass).clamp(0.0, 1.0));
                let share = if rising { share.sqrt() } else { share / (1.0 + (1.0 - share).sqrt()) };
                self.x.mul_add(self.x, width * share).sqrt()
            }
            Kind::Empty => self.end,
        };
        x.clamp(self.x, self.end)
    }

    /// x with ∫ t f dt = `mass` from it to the right end.
    fn at_above(&self, mass: f64) -> f64 {
        let x = match self.kind {
            Kind::Power { exponent } => {
                let (less, w_end) = (1.0 - exponent, self.w * self.span.exp());
                let share = 2.0 * mass / (self.f_end * w_end);
                let log = (share * log_ratio((-less * share).max(-1.0 + f64::EPSILON))).clamp(0.0, self.span);
                let square = self.end.mul_add(self.end, w_end * (-log).exp_m1());
                if square > 0.5 * self.end * self.end {
                    square.sqrt()
                } else if less < 0.0 {
                    // far from the right end of a cell that falls: e^((1−e)L) is a sum of two positive terms
                    let left = (-2.0 * less * mass / (self.f * self.w) + (less * self.span).exp()).ln() / less;
                    self.at_log(left.clamp(0.0, self.span))
                } else {
                    self.at_log(self.span - log)
                }
            }
            Kind::Ramp { rising } => {
                let (width, share) = ((self.end - self.x) * (self.end + self.x), (mass / self.mass).clamp(0.0, 1.0));
                let rest = if rising { share / (1.0 + (1.0 - share).sqrt()) } else { share.sqrt() };
                self.x.mul_add(self.x, width * (1.0 - rest)).sqrt()
            }
            Kind::Empty => self.x,
        };
        x.clamp(self.x, self.end)
    }
}

/// The distribution of slopes in a table before it is scaled: nodes from 0 on, values with a greatest of 1.
pub(crate) struct Nodes {
    x: Vec<f64>,
    f: Vec<f64>,
    log_f: Vec<f64>,
    /// the number of values that were given, and whether a node at 0 was added to them
    given: usize,
    begins_above_0: bool,
}

fn row(name: &'static str, row: usize, value: f64, must: &'static str, mend: &'static str) -> ParameterError {
    ParameterError::Row { name, row: row + 1, value, must, mend }
}

impl Nodes {
    /// Checks a table.
    fn new(slopes: &[f64], values: &[f64]) -> Result<Self, ParameterError> {
        if slopes.len() != values.len() {
            return Err(ParameterError::Length { name: "values", found: values.len(), expected: slopes.len() });
        }
        if !(NODES.0..=NODES.1).contains(&slopes.len()) {
            return Err(ParameterError::Table {
                problem: format!("has {} rows, but must have 2 to 1000", slopes.len()),
                mend: "one point is no distribution; more points than 1000 can be averaged or thinned out",
            });
        }
        for (k, &x) in slopes.iter().enumerate() {
            if !(0.0..=GREATEST_SLOPE).contains(&x) {
                return Err(row(
                    "slopes",
                    k,
                    x,
                    "be between 0 and 1e9",
                    "slopes are tangents of angles below 90 degrees",
                ));
            }
            if k > 0 && x <= slopes[k - 1] {
                return Err(row(
                    "slopes",
                    k,
                    x,
                    "be greater than in the row before",
                    "sort the rows, one for each slope",
                ));
            }
        }
        for (k, &value) in values.iter().enumerate() {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(row(
                    "values",
                    k,
                    value,
                    "be a number that is not negative",
                    "clip noise below 0 to 0, and leave out rows without a value",
                ));
            }
        }
        let greatest = values.iter().fold(0.0_f64, |greatest, &value| greatest.max(value));
        if greatest <= 0.0 {
            return Err(ParameterError::Table {
                problem: "has no mass: all of its values are 0".to_owned(),
                mend: "give at least one positive value",
            });
        }
        let share = |value: f64| if value / greatest < LEAST_VALUE { 0.0 } else { value / greatest };
        let last = values.iter().rposition(|&value| share(value) > 0.0).unwrap_or(0);
        // one 0 behind the last positive value ends a ramp, more of them are nothing
        let count = (last + 2).min(values.len());
        let (mut x, mut f) =
            (slopes[..count].to_vec(), values[..count].iter().map(|&value| share(value)).collect::<Vec<_>>());
        let begins_above_0 = x[0] > 0.0;
        if begins_above_0 {
            x.insert(0, 0.0);
            f.insert(0, f[0]);
        }
        let log_f = f.iter().map(|f| f.ln()).collect();
        Ok(Self { x, f, log_f, given: values.len(), begins_above_0 })
    }

    /// Points that are known to be in order.
    pub(crate) fn of_points(x: &[f64], log_f: impl Iterator<Item = f64>) -> Self {
        let log_f: Vec<f64> = log_f.collect();
        let f = log_f.iter().map(|log| log.exp()).collect();
        Self { x: x.to_vec(), f, log_f, given: x.len(), begins_above_0: false }
    }

    /// The slope below which half the normals of D·cos lie, f linear in x² between nodes: 1 for GGX at unit roughness.
    fn median(&self) -> f64 {
        let mut sums = vec![0.0];
        for k in 1..self.x.len() {
            let width = (self.x[k] - self.x[k - 1]) * (self.x[k] + self.x[k - 1]);
            sums.push(sums[k - 1] + 0.5 * width * (self.f[k] + self.f[k - 1]));
        }
        let half = 0.5 * sums[sums.len() - 1];
        let k = sums.partition_point(|&sum| sum <= half).clamp(1, sums.len() - 1);
        let t = ((half - sums[k - 1]) / (sums[k] - sums[k - 1])).clamp(0.0, 1.0);
        (self.x[k - 1] * self.x[k - 1] + t * (self.x[k] - self.x[k - 1]) * (self.x[k] + self.x[k - 1])).sqrt()
    }

    /// By how much ln f at the nodes differs from the line through both neighbors, in total.
    fn bend(&self, knee: f64) -> f64 {
        let spans: Vec<f64> = self
            .x
            .windows(2)
            .map(|x| ((x[1] - x[0]) * (x[1] + x[0]) / knee.mul_add(knee, x[0] * x[0])).ln_1p())
            .collect();
        let bends = (1..spans.len()).filter(|&k| self.f[k - 1].min(self.f[k]).min(self.f[k + 1]) > 0.0).map(|k| {
            let line = (self.log_f[k - 1] * spans[k] + self.log_f[k + 1] * spans[k - 1]) / (spans[k - 1] + spans[k]);
            (self.log_f[k] - line).abs()
        });
        bends.sum()
    }

    /// The knee for which the table is straightest.
    pub(crate) fn knee(&self) -> f64 {
        /// Range of the search around the median slope, and how many points begin it.
        const RANGE: f64 = 100.0;
        const POINTS: usize = 24;
        /// Steps of the golden section, which reach 1e-9.
        const STEPS: usize = 44;
        /// What another knee must gain: noise has no preference.
        const GAIN: f64 = 0.8;
        let median = self.median();
        let positive = self.f.iter().rposition(|&f| f > 0.0).unwrap_or(0);
        let greatest = (self.x[positive].max(median) / median).clamp(1.0, RANGE);
        let (low, high) = (-RANGE.ln(), greatest.ln());
        let bend = |log: f64| self.bend(median * log.exp());
        let at = |k: usize| low + (high - low) * k as f64 / POINTS as f64;
        let Some(best) = (0..=POINTS).min_by(|&i, &j| bend(at(i)).total_cmp(&bend(at(j)))) else { return median };
        let (mut left, mut right) = (at(best.saturating_sub(1)), at((best + 1).min(POINTS)));
        let ratio = 0.5 * (5f64.sqrt() - 1.0);
        let (mut a, mut b) = (right - ratio * (right - left), left + ratio * (right - left));
        let (mut at_a, mut at_b) = (bend(a), bend(b));
        for _ in 0..STEPS {
            if at_a <= at_b {
                (right, b, at_b) = (b, a, at_a);
                a = right - ratio * (right - left);
                at_a = bend(a);
            } else {
                (left, a, at_a) = (a, b, at_b);
                b = left + ratio * (right - left);
                at_b = bend(b);
            }
        }
        let (log, least) = if at_a <= at_b { (a, at_a) } else { (b, at_b) };
        if least < GAIN * bend(0.0) { median * log.exp() } else { median }
    }
}

impl TabulatedProfile {
    /// A table of the density of slopes: `values ∝ D cos⁴` at `slopes = tan θ`. Below the first node f is constant.
    ///
    /// # Errors
    /// Names the row, its value and what to do: rows that are not sorted, negative or no numbers, too few or too many rows, no mass; a tail
    /// for which masking is infinite.
    pub fn new(slopes: &[f64], values: &[f64], tail: TableTail) -> Result<Self, ParameterError> {
        Self::with_knee(slopes, values, None, tail)
    }

    /// The same with the knee k of the interpolation, a slope; `None` chooses it.
    ///
    /// # Errors
    /// As [`TabulatedProfile::new`], and a knee that is not positive.
    pub fn with_knee(
        slopes: &[f64],
        values: &[f64],
        knee: Option<f64>,
        tail: TableTail,
    ) -> Result<Self, ParameterError> {
        let nodes = Nodes::new(slopes, values)?;
        if let Some(knee) = knee {
            require(
                (1e-9..=1e9).contains(&knee),
                "knee",
                knee,
                "between 1e-9 and 1e9",
                "it is the slope at which the interpolation turns from a bell into a power; leave it out to have it chosen",
            )?;
        }
        let knee = knee.unwrap_or_else(|| nodes.knee());
        Self::from_nodes(&nodes, knee, tail)
    }

    /// The same from polar angles in degrees, or with another quantity.
    ///
    /// # Errors
    /// As [`TabulatedProfile::new`].
    pub fn from_angles(
        degrees: &[f64],
        values: &[f64],
        quantity: Quantity,
        knee: Option<f64>,
        tail: TableTail,
    ) -> Result<Self, ParameterError> {
        for (k, &angle) in degrees.iter().enumerate() {
            if !(0.0..90.0).contains(&angle) {
                return Err(row(
                    "angles",
                    k,
                    angle,
                    "be at least 0 and below 90 degrees",
                    "leave out the horizon: there the slope is infinite",
                ));
            }
            if k > 0 && angle <= degrees[k - 1] {
                return Err(row(
                    "angles",
                    k,
                    angle,
                    "be greater than in the row before",
                    "sort the rows, one for each angle",
                ));
            }
        }
        let slopes: Vec<f64> = degrees.iter().map(|angle| angle.to_radians().tan()).collect();
        Self::of(&slopes, values, quantity, knee, tail)
    }

    /// The same with another quantity at given slopes.
    ///
    /// # Errors
    /// As [`TabulatedProfile::with_knee`].
    pub fn of(
        slopes: &[f64],
        values: &[f64],
        quantity: Quantity,
        knee: Option<f64>,
        tail: TableTail,
    ) -> Result<Self, ParameterError> {
        if slopes.len() != values.len() || quantity == Quantity::Slopes {
            return Self::with_knee(slopes, values, knee, tail);
        }
        let density = |(x, value): (&f64, &f64)| value / quantity.per_slope_density(*x);
        // what is wrong with a value is said of the value
        let bad = |value: f64| !(value >= 0.0 && value.is_finite());
        let density: Vec<f64> =
            slopes.iter().zip(values).map(|pair| if bad(*pair.1) { *pair.1 } else { density(pair) }).collect();
        Self::with_knee(slopes, &density, knee, tail)
    }

    fn from_nodes(nodes: &Nodes, knee: f64, tail: TableTail) -> Result<Self, ParameterError> {
        let cells = |unit: f64| -> Vec<Cell> {
            (1..nodes.x.len())
                .map(|k| {
                    let pair = |values: &[f64]| [values[k - 1], values[k]];
                    Cell::new(pair(&nodes.x).map(|x| x / unit), pair(&nodes.f), pair(&nodes.log_f), knee / unit)
                })
                .collect()
        };
        let check = |cells: &[Cell]| match cells.iter().position(|cell| !(cell.span > LEAST_SPAN)) {
            Some(k) => Err(row(
                "slopes",
                // as the user counts them
                k + 1 - usize::from(nodes.begins_above_0),
                nodes.x[k + 1],
                "differ from the row before by more than rounding",
                "leave one of the two out",
            )),
            None => Ok(()),
        };
        let raw = cells(1.0);
        check(&raw)?;
        let exponent = Self::tail_exponent(&raw, tail)?;
        let unscaled = Self::assemble(raw, knee, exponent, 1.0);
        let width = unscaled.integrate_mean();
        if !(WIDTHS.0..=WIDTHS.1).contains(&width) {
            return Err(ParameterError::Table {
                problem: format!("has a mean slope of {width:e}, but it must be between 1e-6 and 1e6"),
                mend: "slopes are tangents of angles, without a unit",
            });
        }
        // neighbors may round to one number when they are divided
        let scaled = cells(width);
        check(&scaled)?;
        Ok(Self {
            tail_is_continued: tail == TableTail::Power(None) && exponent.is_some(),
            given: nodes.given,
            begins_above_0: nodes.begins_above_0,
            ..Self::assemble(scaled, knee / width, exponent, width)
        })
    }

    /// e of what lies beyond the last node, f ∝ w^(−e); `None` where nothing does.
    fn tail_exponent(cells: &[Cell], tail: TableTail) -> Result<Option<f64>, ParameterError> {
        let last = cells[cells.len() - 1];
        let TableTail::Power(given) = tail else { return Ok(None) };
        let power = match (given, last.kind) {
            (Some(power), _) => power,
            // a power of the slope times 0
            _ if last.f_end == 0.0 => return Ok(None),
            (None, Kind::Power { exponent }) => 2.0 * exponent,
            (None, _) => {
                return Err(ParameterError::Table {
                    problem: "has no tail that could be continued: its last value but one is 0".to_owned(),
                    mend: "give \"tail_exponent\", or set \"tail\" to cut",
                });
            }
        };
        if !(power > 3.0 && power.is_finite()) {
            let whose = if given.is_some() { "\"tail_exponent\" is" } else { "the last cell falls with the power" };
            return Err(ParameterError::Table {
                problem: format!(
                    "goes on with too heavy a tail: {whose} {power}, but it must be greater than 3, or masking is infinite"
                ),
                mend: "give a greater \"tail_exponent\" (GGX has 4), or set \"tail\" to cut",
            });
        }
        Ok((last.f_end > 0.0).then_some(0.5 * power))
    }

    fn assemble(cells: Vec<Cell>, knee: f64, tail: Option<f64>, width: f64) -> Self {
        let ends = cells.iter().map(|cell| cell.end).collect();
        let mut profile = Self {
            cells,
            ends,
            below: Vec::new(),
            above: Vec::new(),
            knee,
            tail,
            tail_is_continued: false,
            width,
            normalization: 0.0,
            given: 0,
            begins_above_0: false,
        };
        let mut sum = 0.0;
        profile.below = std::iter::once(0.0)
            .chain(profile.cells.iter().map(|cell| {
                sum += cell.mass;
                sum
            }))
            .collect();
        let beyond = profile.beyond(profile.last().end);
        let mut sum = beyond;
        let mut above: Vec<f64> = profile
            .cells
            .iter()
            .rev()
            .map(|cell| {
                sum += cell.mass;
                sum
            })
            .collect();
        above.reverse();
        above.push(beyond);
        profile.normalization = 0.5 / above[0];
        profile.above = above;
        profile
    }

    fn last(&self) -> &Cell {
        &self.cells[self.cells.len() - 1]
    }

    /// The end of a power tail as a cell that starts at the last node.
    fn tail_cell(&self) -> Option<Cell> {
        let last = self.last();
        self.tail.map(|exponent| Cell {
            x: last.end,
            end: f64::INFINITY,
            w: self.knee.mul_add(self.knee, last.end * last.end),
            f: last.f_end,
            f_end: 0.0,
            log_f: last.f_end.ln(),
            span: f64::INFINITY,
            kind: Kind::Power { exponent },
            mass: 0.0,
        })
    }

    /// ∫_x^∞ t f dt for x at or beyond the last node.
    fn beyond(&self, x: f64) -> f64 {
        self.tail_cell().map_or(0.0, |tail| {
            let exponent = self.tail.unwrap_or(2.0);
            let log = tail.log_w(x, 0.0);
            0.5 / (exponent - 1.0) * tail.w * (tail.log_f + (1.0 - exponent) * log).exp()
        })
    }

    /// x with ∫_x^∞ t f dt = `mass`, at or beyond the last node.
    fn at_beyond(&self, mass: f64) -> f64 {
        let beyond = self.above[self.cells.len()];
        match self.tail_cell() {
            Some(tail) if mass <= 0.0 => tail.end,
            Some(tail) if mass < beyond => {
                let log = -(mass / beyond).max(f64::MIN_POSITIVE).ln() / (self.tail.unwrap_or(2.0) - 1.0);
                tail.at_log(log).min(X_MAX)
            }
            _ => self.last().end,
        }
    }

    /// The cell that x is in, `None` beyond the last.
    fn cell(&self, x: f64) -> Option<usize> {
        let k = self.ends.partition_point(|&end| end < x);
        (k < self.cells.len()).then_some(k)
    }

    /// Mean slope of the table as it was given: with a roughness of this the distribution is that of the table.
    pub fn width(&self) -> f64 {
        self.width
    }

    /// k, in units of the mean slope.
    pub fn knee(&self) -> f64 {
        self.knee
    }

    /// The nodes: x in units of the mean slope, and f; the first is at 0.
    pub fn nodes(&self) -> impl Iterator<Item = (f64, f64)> {
        let first = self.cells[0];
        std::iter::once((first.x, first.f)).chain(self.cells.iter().map(|cell| (cell.end, cell.f_end)))
    }

    /// The power of the slope with which f falls beyond the last node; `None` where nothing is there.
    pub fn tail_power(&self) -> Option<f64> {
        self.tail.map(|exponent| 2.0 * exponent)
    }

    /// Points between which f is smooth and ln f changes by [`STEP`] at the most, with `ln f x³` there; they end in a power tail where
    /// it is exact, or where that has fallen far enough.
    fn panel_ends(&self, depth: f64) -> Vec<f64> {
        let weight = |x: f64, log_f: f64| log_f + 3.0 * x.ln();
        // greatest ln f x³ from each node on
        let mut greatest = vec![f64::NEG_INFINITY; self.cells.len() + 1];
        for k in (0..self.cells.len()).rev() {
            let cell = &self.cells[k];
            greatest[k] = greatest[k + 1].max(weight(cell.end, cell.f_end.ln()));
        }
        let peak = greatest[0];
        let mut points: Vec<(f64, f64)> = Vec::new();
        for (k, cell) in self.cells.iter().enumerate() {
            let mut logs = Vec::new();
            let log_end = cell.f_end.ln();
            if let Kind::Power { exponent } = cell.kind {
                let count = ((exponent * cell.span).abs() / STEP).floor();
                let step = STEP / exponent.abs();
                // from the greater value down, until what is left counts for nothing
                let top = cell.log_f.max(log_end);
                let beyond = if exponent > 0.0 { greatest[k] - 3.0 * cell.end.ln() } else { log_end };
                for j in 1..=count as usize {
                    if top - STEP * j as f64 + 2.0 * STEP < beyond - VALLEY {
                        break;
                    }
                    let along = step * j as f64;
                    logs.push(if exponent > 0.0 { along } else { cell.span - along });
                }
            }
            // the poles at ±ik
            let first = if cell.x < self.knee { cell.log_w(self.knee.min(cell.end), 0.0) } else { 0.0 };
            let rest = cell.span - first;
            let pieces = (0.5 * rest / LOG_RATIO).ceil();
            if first > 0.0 {
                logs.push(first);
            }
            logs.extend((1..pieces as usize).map(|j| first + rest * j as f64 / pieces));
            logs.sort_by(f64::total_cmp);
            for log in logs {
                let x = cell.at_log(log);
                if x > points.last().map_or(0.0, |last| last.0) * (1.0 + 1e-9) && x < cell.end * (1.0 - 1e-9) {
                    points.push((x, weight(x, cell.f(x, 0.0).ln())));
                }
            }
            points.push((cell.end, weight(cell.end, log_end)));
        }
        // what has fallen far below the peak and does not rise again
        let keep =
            points.iter().rposition(|point| point.1 > peak - depth).map_or(points.len(), |k| (k + 2).min(points.len()));
        let complete = keep == points.len();
        let mut ends: Vec<f64> = points[..keep].iter().map(|point| point.0).collect();
        if let (true, Some(tail), Tail::Power { exact_from, .. }) = (complete, self.tail_cell(), self.tail()) {
            let exponent = self.tail.unwrap_or(2.0);
            let mut log = 0.0;
            loop {
                let x = ends[ends.len() - 1];
                if x >= POWER_SPAN * exact_from || weight(x, tail.log_f - exponent * log) < peak - depth {
                    break;
                }
                let step = (STEP / exponent).min(2.0 * LOG_RATIO);
                log += step;
                let next = tail.at_log(log);
                if next > x {
                    ends.push(next);
                }
            }
        }
        ends
    }

    /// 2A ∫ x² f dx by quadrature.
    fn integrate_mean(&self) -> f64 {
        let ends = self.panel_ends(MEAN_DEPTH);
        let rule = gauss(MEAN_POINTS);
        let mut sum = 0.0;
        let mut left = 0.0;
        for &right in &ends {
            sum += rule.integrate(left, right, |x| x * x * self.f(x));
            left = right;
        }
        if let Tail::Power { excess, .. } = self.tail() {
            // at the last end the power is exact, or nothing is left
            sum += left * left * left * self.f(left) / excess;
        }
        2.0 * self.normalization * sum
    }
}

impl Profile for TabulatedProfile {
    fn f(&self, x: f64) -> f64 {
        self.f_past(x, 0.0)
    }

    fn f_past(&self, from: f64, past: f64) -> f64 {
        match self.cell(from + past) {
            Some(k) => self.cells[k].f(from, past),
            None => self.tail_cell().map_or(0.0, |tail| tail.f(from, past)),
        }
    }

    fn normalization(&self) -> f64 {
        self.normalization
    }

    fn cdf(&self, x: f64) -> f64 {
        if x <= 0.0 {
            return 0.0;
        }
        let below = match self.cell(x) {
            Some(k) => self.below[k] + self.cells[k].below(x),
            None => self.below[self.cells.len()] + (self.above[self.cells.len()] - self.beyond(x)).max(0.0),
        };
        (2.0 * self.normalization * below).min(1.0)
    }

    fn sf(&self, x: f64) -> f64 {
        if x <= 0.0 {
            return 1.0;
        }
        let above = match self.cell(x) {
            Some(k) => self.above[k + 1] + self.cells[k].above(x),
            None => self.beyond(x),
        };
        (2.0 * self.normalization * above).min(1.0)
    }

    fn quantile(&self, u: f64) -> f64 {
        if u > 0.5 {
            return self.isf(1.0 - u);
        }
        let target = u / (2.0 * self.normalization);
        let k = self.below.partition_point(|&below| below <= target).max(1) - 1;
        match self.cells.get(k) {
            Some(cell) => cell.at_below(target - self.below[k]),
            // at most half lies below: the difference keeps its digits
            None => self.at_beyond(self.above[0] - target),
        }
    }

    fn isf(&self, u: f64) -> f64 {
        if u > 0.5 {
            return self.quantile(1.0 - u);
        }
        // u may be the least number there is
        let target = if u > 0.0 { (u / (2.0 * self.normalization)).max(f64::MIN_POSITIVE) } else { 0.0 };
        if target < self.above[self.cells.len()] {
            return self.at_beyond(target);
        }
        // the last node with no less above it
        let k = self.above.partition_point(|&above| above >= target).max(1) - 1;
        match self.cells.get(k) {
            Some(cell) => cell.at_above(target - self.above[k + 1]),
            None => self.last().end,
        }
    }

    fn mean(&self) -> f64 {
        1.0
    }

    fn breaks(&self, depth: f64) -> Vec<f64> {
        self.panel_ends(depth)
    }

    fn cusps(&self) -> &[f64] {
        &[]
    }

    fn bends_at_breaks(&self) -> bool {
        true
    }

    fn coordinate(&self) -> Coordinate {
        Coordinate::Odds
    }

    fn values(&self) -> Option<&dyn Values> {
        Some(self)
    }

    fn pieces(&self) -> Option<Vec<Piece>> {
        let beyond = self.tail_cell().map_or_else(|| Piece::empty(self.last().end.powi(2)), |tail| tail.piece());
        Some(self.cells.iter().map(Cell::piece).chain([beyond]).collect())
    }

    fn tail(&self) -> Tail {
        match self.tail {
            // f = C x^(−2e) (1 + O(e k²/x²))
            Some(exponent) => Tail::Power {
                excess: 2.0f64.mul_add(exponent, -3.0),
                exact_from: self.last().end.max(self.knee * (1e17 * exponent).sqrt()),
            },
            None => Tail::Exponential,
        }
    }
}

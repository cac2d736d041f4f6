//! Inversion of a monotone positive function on (0, ∞) over hundreds of orders of magnitude.

/// A monotone function and its derivative.
pub struct Monotone<'a> {
    /// Positive, monotone, between 0 and 1.
    pub value: &'a dyn Fn(f64) -> f64,
    /// Whether it rises; its derivative may have underflowed to 0 and cannot tell.
    pub rising: bool,
    /// Its derivative.
    pub slope: &'a dyn Fn(f64) -> f64,
}

/// Steps after which bisection alone has exhausted all 2¹¹ exponents and 52 bits of the argument.
const MOST_STEPS: usize = 200;
/// Arguments end here, so that they do not overflow when divided by the width of a narrow side.
const X_MAX: f64 = 1e304;

/// Finds x with `value(x) = target` for 0 ≤ target ≤ 1; 0 or ∞ where the target is at the end of the range.
///
/// Newton's method on ln value against ln x, kept inside a bracket: where a step leaves the bracket, the last one did not
/// halve ln(value/target), or the value has underflowed to 0, the bracket is halved (geometrically) instead. The result is
/// a fixed point to the last two bits of x.
pub fn solve(function: &Monotone, target: f64, start: f64) -> f64 {
    let rising = function.rising;
    if target <= 0.0 {
        return if rising { 0.0 } else { f64::INFINITY };
    }
    if target >= 1.0 {
        return if rising { f64::INFINITY } else { 0.0 };
    }
    let (mut low, mut high) = (0.0_f64, f64::INFINITY);
    let mut x = start;
    let log_target = target.ln();
    // squared by each step out of reach of Newton's: a quantile may lie at 1e299, and the density is 0 long before
    let mut reach = 16.0_f64;
    let mut last_miss = f64::INFINITY;
    for _ in 0..MOST_STEPS {
        let value = (function.value)(x);
        if value == target {
            return x;
        }
        if (value < target) == rising {
            low = x
        } else {
            high = x
        }
        let slope = (function.slope)(x);
        let (next, miss) = if value > 0.0 && slope != 0.0 {
            // d ln value / d ln x = x slope / value
            let difference = (target - value) / value;
            let log_ratio = if difference.abs() < 0.5 { difference.ln_1p() } else { log_target - value.ln() };
            (x + x * (log_ratio * value / (x * slope)).exp_m1(), log_ratio.abs())
        } else {
            (f64::NAN, f64::INFINITY)
        };
        // Newton's step to an end of the bracket that is next to x: no double is closer to the root.
        if (next == low || next == high) && (next - x).abs() <= 4.0 * f64::EPSILON * x {
            return next;
        }
        // Across the rim of a ring with two widths Newton's steps go to and fro and hardly closer.
        let slow = miss > 0.5 * last_miss && low > 0.0 && high < f64::INFINITY;
        last_miss = miss;
        let inside = next > low && next < high;
        let step = if inside && (next - x).abs() <= 2.0 * f64::EPSILON * x {
            return next;
        } else if inside && !slow && next < 16.0 * x && next > x / 16.0 {
            next
        } else if low == 0.0 || high.is_infinite() {
            let away = if low == 0.0 { x.min(high) / reach } else { x.max(low) * reach };
            reach = (reach * reach).min(1e16);
            away.min(X_MAX)
        } else if high < 2.0 * low {
            low + 0.5 * (high - low)
        } else {
            low.sqrt() * high.sqrt()
        };
        if (step - x).abs() <= 2.0 * f64::EPSILON * x || step == low && step == high || step == 0.0 {
            return step;
        }
        x = step;
    }
    x
}

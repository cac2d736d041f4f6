//! Is every function continuous where its formula changes?
//!
//! Two neighboring inputs on either side of a switch must give values that differ by no more than the function itself
//! does: `|after − before| ≤ (slope · step + tolerance) · |value|`, with the slope taken from wider steps on the same
//! side.

mod cases;

use cases::Case;
use sgtd_core::family::partial_moment::{Radius, Side};
use sgtd_core::family::shape::Shape;
use sgtd_core::family::skewed_t::SkewedT;
use sgtd_core::masking::table::{ENTRIES, LambdaTable};
use sgtd_core::masking::{MaskingIntegral, Rule};
use sgtd_core::numerics::exponent::Exponent;
use sgtd_core::numerics::gamma_ratio::scaled_gamma_ratio;
use sgtd_core::profile::Profile;
use sgtd_core::sampling::visible_table::{CELLS, VisibleTable};

const INF: f64 = f64::INFINITY;

/// Everything that a shape determines, at slopes that spread over it: the names say what jumped.
fn fingerprint(gamma: f64, p: f64, lambda: f64, shift: f64) -> Vec<(String, f64)> {
    let shape = Shape::new(gamma, p, lambda, shift).unwrap_or_else(|error| panic!("{error}"));
    let profile = SkewedT::new(shape);
    let masking = MaskingIntegral::new(&profile, Rule::REFERENCE);
    let mut values = vec![("A".to_owned(), profile.normalization()), ("mean".to_owned(), profile.mean())];
    for x in [0.01, 0.2, 0.7, 0.95, 1.3, 2.1] {
        values.push((format!("f({x})"), profile.f(x)));
        values.push((format!("cdf({x})"), profile.cdf(x)));
        values.push((format!("sf({x})"), profile.sf(x)));
        values.push((format!("H({x})"), masking.at(&profile, x).h));
        values.push((format!("quantile({x}/3)"), profile.quantile(x / 3.0)));
    }
    values
}

/// The values at two parameters differ by less than `permitted`, relatively.
fn assert_close(what: &str, before: &[(String, f64)], after: &[(String, f64)], permitted: f64) {
    for ((name, before), (_, after)) in before.iter().zip(after) {
        let change = if after == before { 0.0 } else { (after / before - 1.0).abs() };
        assert!(change <= permitted, "{what}: {name} jumps from {before:e} to {after:e}, by {change:.1e}");
    }
}

/// Other parameters while one crosses its switch.
const OTHERS: [(f64, f64, f64); 5] =
    [(1.0, 0.0, 0.0), (1.0, 0.3, 0.5), (0.6, -0.4, 0.2), (2.5, 0.0, 0.8), (7.0, 0.8, 1.5)];

/// γ → ∞: f differs from its limit by u²/(2γ) and less, so at 10¹² by 1e-11 where u is 5.
#[test]
fn gamma_towards_infinity() {
    for (p, lambda, shift) in OTHERS {
        let limit = fingerprint(INF, p, lambda, shift);
        // how far H, f and sf are from their limits at γ = 10⁴ measures the slope against 1/γ
        let near = fingerprint(1e4, p, lambda, shift);
        for gamma in [1e5, 1e7, 1e9, 1e11, 1e13, 1e15, 1e18, 1e100, f64::MAX] {
            let at = fingerprint(gamma, p, lambda, shift);
            for ((name, limit), ((_, near), (_, at))) in limit.iter().zip(near.iter().zip(&at)) {
                if *limit < 1e-200 {
                    continue;
                }
                let expected = (near / limit - 1.0) * 1e4 / gamma;
                let change = at / limit - 1.0;
                // far out, 1/γ is not small against u⁻², and the change less than linear; but it is neither missed nor
                // doubled
                let off = (change - expected).abs();
                let permitted = if expected.abs() < 1e-5 { 0.3 } else { 1.0 } * expected.abs() + 2e-12;
                assert!(
                    off <= permitted,
                    "p = {p}, γ = {gamma:e}: {name} is off its limit by {change:.1e}, not {expected:.1e}"
                );
            }
        }
    }
}

/// Exponents γ and 2p are sorted into Two, Few, Whole, Half and Real: next to each the value is the same function.
#[test]
fn powers_near_whole_exponents_are_continuous() {
    for twice in 1..40 {
        let exponent = 0.5 * f64::from(twice);
        for x in [1e-9, 0.3, 1.0 - 1e-9, 1.0, 1.7, 50.0, 1e9] {
            let at = |e: f64| {
                let power = Exponent::new(e);
                [power.of(x), power.fast(x), 1.0 / power.fast_reciprocal(x)]
            };
            for (here, beside) in at(exponent)
                .into_iter()
                .zip(at(exponent.next_up()))
                .chain(at(exponent).into_iter().zip(at(exponent.next_down())))
            {
                // one ulp of the exponent, times ln x, and rounding
                let permitted = 4e-16 * (2.0 + exponent * f64::ln(x).abs());
                let change = (beside / here - 1.0).abs();
                assert!(change <= 2.0 * permitted, "{x}^{exponent}: jumps by {change:e} beside it");
            }
        }
    }
}

#[test]
fn whole_and_half_tails_are_continuous() {
    for gamma in [2.0, 2.5, 3.0, 4.0, 5.5, 16.0, 16.5, 17.0] {
        for (p, lambda, shift) in OTHERS {
            if 2.0 * p * gamma <= 3.01 {
                continue;
            }
            let here = fingerprint(gamma, p, lambda, shift);
            for beside in [gamma * (1.0 + 1e-14), gamma * (1.0 - 1e-14)] {
                assert_close(&format!("γ = {gamma}"), &here, &fingerprint(beside, p, lambda, shift), 1e-11);
            }
        }
    }
}

#[test]
fn p_across_one_and_other_whole_values() {
    for p in [0.5, 1.0, 1.5, 2.0, 3.0, 8.0, 8.25, 50.0] {
        for (gamma, lambda, shift) in [(INF, 0.0, 0.0), (INF, 0.3, 0.5), (4.0, 0.0, 0.0), (4.0, -0.4, 0.8)] {
            let here = fingerprint(gamma, p, lambda, shift);
            for beside in [p * (1.0 + 1e-14), p * (1.0 - 1e-14)] {
                assert_close(&format!("p = {p}"), &here, &fingerprint(gamma, beside, lambda, shift), 1e-11);
            }
        }
    }
}

/// λ = 0 may make the rim of a ring smooth, which moves panels of the quadrature.
#[test]
fn lambda_towards_zero() {
    for (gamma, p, shift) in [(2.0, 1.0, 0.5), (INF, 1.0, 1.0), (3.0, 2.0, 0.9), (INF, 0.7, 0.4), (2.2, 1.0, 0.0)] {
        let here = fingerprint(gamma, p, 0.0, shift);
        for lambda in [1e-16, 1e-15, 1e-14, -1e-14, -1e-16, 5e-324] {
            assert_close(&format!("λ = {lambda:e}"), &here, &fingerprint(gamma, p, lambda, shift), 2e-12);
        }
    }
}

/// At shift 0 there is no inner side; just above it there is one, a denormal wide.
#[test]
fn shift_towards_zero() {
    for (gamma, p, lambda) in [(2.0, 1.0, 0.0), (INF, 1.0, 0.0), (3.0, 1.4, 0.3), (INF, 0.3, -0.5), (2.0, 50.0, 0.0)] {
        let here = fingerprint(gamma, p, lambda, 0.0);
        for shift in [5e-324, 1e-310, 1e-300, 1e-200, 1e-100, 1e-30, 1e-15] {
            // d ln f/dm is 2p/x and less at the slopes looked at
            let permitted = 2e-12 + 1e3 * p * shift;
            assert_close(&format!("m = {shift:e}"), &here, &fingerprint(gamma, p, lambda, shift), permitted);
        }
    }
}

/// x across m, where the two sides meet: f, cdf, sf and H, one ulp to either side.
#[test]
fn slopes_across_the_shift() {
    for (gamma, p, lambda, m) in [
        (2.0, 1.0, 0.4, 0.7),
        (INF, 1.0, -0.9, 2.0),
        (3.0, 1.7, 0.99, 10.0),
        (INF, 0.25, 0.3, 0.5),
        (4.0, 50.0, 0.2, 1000.0),
    ] {
        let case = Case { gamma, p, lambda, shift: m };
        let profile = case.profile();
        let masking = MaskingIntegral::new(&profile, Rule::REFERENCE);
        let at = |x: f64| {
            [profile.f(x), profile.cdf(x), profile.sf(x), masking.at(&profile, x).h, masking.at(&profile, x).s]
        };
        let here = at(m);
        assert_eq!(here[0], 1.0, "{case:?}: f(m)");
        for x in [m.next_down(), m.next_up()] {
            for (k, (here, beside)) in here.into_iter().zip(at(x)).enumerate() {
                let ulp = (x - m).abs();
                // f falls like (ulp/c)^(2p), the others by their densities
                let own = if k == 0 { (ulp / (1.0 - lambda.abs())).powf(2.0 * p) } else { 0.0 };
                let change = (beside / here - 1.0).abs();
                assert!(
                    change <= own + 5e-12,
                    "{case:?}, value {k}: {here:e} to {beside:e} one ulp from m, by {change:e}"
                );
            }
        }
    }
}

/// The ratio of gamma functions goes from products to Stirling's series where γ − s reaches a fixed number.
#[test]
fn gamma_ratio_where_its_series_takes_over() {
    for s in [0.01, 0.3, 0.5, 1.0, 1.7, 3.0, 6.0] {
        for b in 1..40 {
            let b = f64::from(b);
            let at = |b: f64| scaled_gamma_ratio(b + s, s, b);
            let change = (at(b.next_down()) / at(b) - 1.0).abs();
            assert!(change < 2e-14, "s = {s}, γ − s = {b}: jumps by {change:e}");
        }
    }
}

/// J_k and its complement change between two series and a continued fraction; the arguments where they do are not
/// public, so a fine scan in r passes all of them: the third difference of ln J would show a jump.
#[test]
fn moments_where_their_expansions_change() {
    for gamma in [1.05, 1.6, 2.0, 5.5, 16.0, 40.0, 1e3, 1e12, INF] {
        for p in [0.25, 0.5, 1.0, 1.3, 3.0, 20.0, 50.0] {
            if 2.0 * p * gamma < 3.001 {
                continue;
            }
            let side = Side::new(gamma, p);
            for k in 1..=3 {
                for upper in [false, true] {
                    let value = |depth: f64| {
                        let r = Radius::exact(side.radius_at_depth(depth));
                        let value = if upper { side.upper(k, r) } else { side.lower(k, r) };
                        (value.ln(), r.hi.ln())
                    };
                    // steps of 1e-4 in ln depth: a smooth function's third divided difference times its step cubed is
                    // 1e-11
                    let step = 1.0001f64;
                    let mut depth = 1e-3;
                    let mut last = [value(depth), value(depth * step), value(depth * step * step)];
                    depth *= step * step;
                    while depth < 60.0 {
                        depth *= step;
                        let next = value(depth);
                        let third = next.0 - 3.0 * last[2].0 + 3.0 * last[1].0 - last[0].0;
                        let size = 1.0 + next.0.abs();
                        assert!(
                            third.abs() < 1e-10 * size,
                            "γ = {gamma}, p = {p}, k = {k}, upper {upper}: ln J bends by {third:e} at r = {:e}",
                            next.1.exp()
                        );
                        last = [last[1], last[2], next];
                        // large steps in between, so that 10⁴ points cover the range
                        if depth > 1.0 {
                            depth += 1e-4 * depth * 4.0;
                            last = [value(depth / step / step), value(depth / step), value(depth)];
                        }
                    }
                }
            }
        }
    }
}

/// H of the masking table is continuous across the borders of its cells, and so is its slope.
#[test]
fn masking_table_across_its_cells() {
    for case in cases::LIST {
        let profile = case.profile();
        let masking = MaskingIntegral::new(&profile, Rule::TABLE);
        let table = LambdaTable::new(&profile, &masking, 1e-4);
        // exponents whose octave is divided: their cells are told apart by bits of the mantissa
        let shift = |exponent: u32| table.flat()[exponent as usize].to_bits() & 31;
        let divided: Vec<u32> = (0..ENTRIES as u32).filter(|&exponent| shift(exponent) <= 23).collect();
        let (Some(first), Some(last)) = (divided.first(), divided.last()) else { panic!("{case:?}: no octave") };
        assert_eq!(divided.len() as u32, last + 1 - first, "{case:?}");
        let inner = divided.iter().flat_map(|&exponent| {
            (0..1u32 << (23 - shift(exponent))).map(move |cell| (exponent << 23) + (cell << shift(exponent)))
        });
        let end = (last + 1) << 23;
        for border in inner.chain([end]) {
            let at_bits = |k: i64| f64::from(f32::from_bits((i64::from(border) + k) as u32));
            // the cell is found in single precision: four of its steps to either side
            let (below, at, above) = (at_bits(-4), at_bits(0), at_bits(4));
            let [before, here, after] = [below, at, above].map(|a| table.h(a));
            let (left, right) = ((here - before) / (at - below), (after - here) / (above - at));
            let slope = |h: f64| (-0.5 - 1e-6..=1e-6).contains(&h);
            assert!(slope(left) && slope(right), "{case:?}: H jumps at {at}, with slopes {left} and {right}");
            if border < end {
                // beyond the last cell H is constant
                assert!((left - right).abs() < 3e-3, "{case:?}: H' jumps from {left} to {right} at {at}");
            }
        }
        let end = f64::from(f32::from_bits(end));
        assert_eq!(table.h(2.0 * end), table.h(end), "{case:?}: beyond the last cell");
    }
}

/// The density of visible slopes is continuous across knots, and across rows.
#[test]
fn visible_table_across_its_cells_and_rows() {
    for case in cases::LIST {
        let profile = case.profile();
        let table = VisibleTable::new(&profile, &MaskingIntegral::new(&profile, Rule::TABLE));
        let view = |a: f64| table.mixture(a / a.hypot(1.0), 1.0 / a.hypot(1.0));
        for a in [1e-3, 0.3, 2.0, 50.0] {
            let mixture = view(a);
            for &slope in &table.slopes()[1..CELLS - 1] {
                let y = f64::from((slope * slope) as f32);
                let (before, at) = (table.density(mixture, y.next_down()), table.density(mixture, y));
                assert!(
                    (before - at).abs() <= 1e-9 * at.max(before),
                    "{case:?} a = {a}: density jumps from {before:e} to {at:e} at y = {y:e}"
                );
            }
        }
        for row in 1..15 {
            let a = table.scale() * f64::from(row) / f64::from(15 - row);
            for y in [0.0, 0.1, 1.0, case.shift * case.shift] {
                let (before, after) =
                    (table.density(view(a * (1.0 - 1e-14)), y), table.density(view(a * (1.0 + 1e-14)), y));
                assert!(
                    (before - after).abs() <= 1e-9 * after.max(before),
                    "{case:?}: density jumps across row {row} at y = {y}"
                );
            }
        }
    }
}

/// The lowest row of the family that a shape belongs to gives the same numbers as every row above it.
#[test]
fn rows_agree_at_their_common_nodes() {
    use sgtd_core::family::shape::Row;
    let row = |name: &str, gamma, p, lambda, shift| {
        let row = Row::named(name).unwrap_or_else(|error| panic!("{error}"));
        row.shape(gamma, p, lambda, Some(shift)).unwrap_or_else(|error| panic!("{name}: {error}"))
    };
    for shift in [0.0, 0.4] {
        let ggx = row("ggx", None, None, None, shift);
        for other in [
            row("student", Some(2.0), None, None, shift),
            row("hyper_cauchy", Some(2.0), None, None, shift),
            row("std", Some(2.0), None, Some(0.0), shift),
            row("gtd", Some(2.0), Some(1.0), None, shift),
            row("sgtd", Some(2.0), Some(1.0), Some(0.0), shift),
        ] {
            assert_eq!(other, ggx);
        }
        let beckmann = row("beckmann", None, None, None, shift);
        for other in [
            row("snd", None, None, Some(0.0), shift),
            row("gnd", None, Some(1.0), None, shift),
            row("sgnd", None, Some(1.0), Some(0.0), shift),
            row("student", Some(INF), None, None, shift),
            row("sgtd", Some(INF), Some(1.0), Some(0.0), shift),
        ] {
            assert_eq!(other, beckmann);
        }
    }
}

//! Does a profile given by points keep what the trait promises?

mod cases;

use cases::Random;
use cases::second_moment::second_moment;
use cases::tables::{KINDS, Points, random_table};
use rayon::prelude::*;
use sgtd_core::masking::{MaskingIntegral, Rule};
use sgtd_core::ndf::Ndf;
use sgtd_core::profile::tabulated::{Quantity, TableTail};
use sgtd_core::profile::{Profile, TabulatedProfile};

/// Numbers of nodes from 2 to 1000.
const COUNTS: [usize; 8] = [2, 3, 5, 12, 40, 100, 333, 1000];

/// Tables of all kinds and lengths.
fn tables(what: &str) -> Vec<Points> {
    let mut random = Random::seeded(what);
    (0..KINDS)
        .flat_map(|kind| COUNTS.map(|count| (kind, count)))
        .flat_map(|(kind, count)| [0, 1, 2].map(|_| random_table(&mut random, kind, count)))
        .collect()
}

#[test]
fn inverses_undo_what_they_invert() {
    let worst = tables("inverses")
        .par_iter()
        .map(|points| {
            let profile = points.profile();
            let mut random = Random::new(7);
            let mut worst = 0.0_f64;
            for k in 0..2000 {
                let u = if k % 3 == 0 { random.log_between(1e-300, 1.0) } else { random.unit() };
                let (low, high) = (profile.quantile(u), profile.isf(u));
                for (got, x, what) in [(profile.cdf(low), low, "cdf"), (profile.sf(high), high, "sf")] {
                    let value = |x: f64| if what == "cdf" { profile.cdf(x) } else { profile.sf(x) };
                    // no double lies closer to the end of a cut table, or to the start of a ring with an empty middle
                    let ends = [value(x.next_down()), value(x.next_up())];
                    let between = ends[0].min(ends[1]) <= u && u <= ends[0].max(ends[1]);
                    let error = if between { 0.0 } else { (got - u).abs() / u };
                    assert!(error < 1e-11, "{what}({x:e}) = {got:e} is not {u:e}: {error:e} in {points:?}");
                    worst = worst.max(error);
                }
            }
            worst
        })
        .reduce(|| 0.0, f64::max);
    println!("worst {worst:e}");
}

#[test]
fn slopes_come_back() {
    // from slopes, where the density of slopes allows: an error of eps in F moves x by eps F/(x F')
    let worst = tables("slopes")
        .par_iter()
        .map(|points| {
            let profile = points.profile();
            let mut random = Random::new(9);
            let mut worst = 0.0_f64;
            let end = profile.breaks(20.0).pop().unwrap_or(1.0);
            for _ in 0..2000 {
                let x = random.between(0.0, 1.2 * end);
                let density = 2.0 * profile.normalization() * x * x * profile.f(x);
                for (value, back) in
                    [(profile.cdf(x), profile.quantile(profile.cdf(x))), (profile.sf(x), profile.isf(profile.sf(x)))]
                {
                    let condition = value / density;
                    if condition < 1e3 && value < 0.5 {
                        let error = (back - x).abs() / x / condition.max(1.0);
                        assert!(error < 1e-11, "{x:e} comes back as {back:e}: {error:e} in {points:?}");
                        worst = worst.max(error);
                    }
                }
            }
            worst
        })
        .reduce(|| 0.0, f64::max);
    println!("worst {worst:e}");
}

#[test]
fn both_sides_make_one() {
    tables("sides").par_iter().for_each(|points| {
        let profile = points.profile();
        let mut random = Random::new(8);
        for _ in 0..1000 {
            let x = random.log_between(1e-6, 1e6);
            let (cdf, sf) = (profile.cdf(x), profile.sf(x));
            assert!((cdf + sf - 1.0).abs() < 1e-12, "F = {cdf}, 1 − F = {sf} at {x:e} in {points:?}");
        }
    });
}

/// A table from its definition: f by powers, integrals by the tanh-sinh rule, piece by piece.
struct Definition {
    nodes: Vec<(f64, f64)>,
    square: f64,
    tail: Option<f64>,
}

impl Definition {
    fn of(profile: &TabulatedProfile) -> Self {
        let knee = profile.knee();
        Self { nodes: profile.nodes().collect(), square: knee * knee, tail: profile.tail_power() }
    }

    fn f(&self, k: usize, x: f64) -> f64 {
        let (x0, f0) = self.nodes[k];
        let w = |x: f64| self.square + x * x;
        let Some(&(x1, f1)) = self.nodes.get(k + 1) else {
            return self.tail.map_or(0.0, |power| f0 * (w(x) / w(x0)).powf(-0.5 * power));
        };
        let share = (x * x - x0 * x0) / (x1 * x1 - x0 * x0);
        match (f0 > 0.0, f1 > 0.0) {
            (true, true) => f0 * (f1 / f0).powf((w(x) / w(x0)).ln() / (w(x1) / w(x0)).ln()),
            (false, true) => f1 * share,
            (true, false) => f0 * (1.0 - share),
            (false, false) => 0.0,
        }
    }

    /// `∫_q^∞ f g dρ`
    fn integral(&self, q: f64, g: &dyn Fn(f64) -> f64) -> f64 {
        let mut sum = 0.0;
        let count = self.nodes.len();
        for k in 0..count - 1 {
            let (left, right) = (self.nodes[k].0.max(q), self.nodes[k + 1].0);
            if left >= right || self.nodes[k].1 + self.nodes[k + 1].1 == 0.0 {
                continue;
            }
            let w = |x: f64| self.square + x * x;
            // pieces over which neither f nor w changes much
            let change = (self.f(k, right).max(1e-300) / self.f(k, left).max(1e-300)).ln().abs().min(700.0);
            let pieces = (change / 8.0 + (w(right) / w(left)).ln()).ceil().max(1.0);
            let end = |j: f64| {
                let x = (w(left) * (w(right) / w(left)).powf(j / pieces) - self.square).max(0.0).sqrt();
                if j == 0.0 {
                    left
                } else if j == pieces {
                    right
                } else {
                    x.clamp(left, right)
                }
            };
            for j in 0..pieces as usize {
                // ρ = q + v²: the kernels begin like a power of the root
                let root = |x: f64| (x - q).sqrt();
                let (from, to) = (root(end(j as f64)), root(end(j as f64 + 1.0)));
                sum += tanh_sinh(from, to, |v| 2.0 * v * self.f(k, q + v * v) * g(q + v * v));
            }
        }
        if let Some(power) = self.tail {
            let start = self.nodes[count - 1].0.max(q);
            let e = power - 3.0;
            // ρ = start·v^(−1/e), and a power of v that ends the singularity at 1
            sum += tanh_sinh(0.0, 1.0, |v| {
                let rho = start * v.powf(-1.0 / e);
                if rho < 1e100 { self.f(count - 1, rho) * g(rho) * rho / (e * v) } else { 0.0 }
            });
        }
        sum
    }
}

/// The tanh-sinh rule (Takahasi & Mori 1974).
fn tanh_sinh(a: f64, b: f64, g: impl Fn(f64) -> f64) -> f64 {
    const STEP: f64 = 1.0 / 32.0;
    let mut sum = 0.0;
    for k in -130..=130 {
        let t = STEP * f64::from(k);
        let u = 0.5 * std::f64::consts::PI * t.sinh();
        // distance from the nearer end, without cancellation
        let near = 1.0 / (1.0 + (2.0 * u.abs()).exp());
        let x = if u < 0.0 { a + (b - a) * near } else { b - (b - a) * near };
        let weight = 0.5 * std::f64::consts::PI * t.cosh() * 2.0 * near * (1.0 - near);
        if x > a && x < b && weight > 1e-40 {
            sum += weight * g(x);
        }
    }
    sum * STEP * (b - a)
}

#[test]
fn everything_is_what_the_definition_says() {
    let mut random = Random::seeded("definition");
    let cases: Vec<(Points, u64)> = (0..10 * KINDS)
        .map(|k| (random_table(&mut random, k % KINDS, [2, 3, 5, 9, 17, 40][(k % 6) as usize]), u64::from(k)))
        .collect();
    let worst = cases
        .par_iter()
        .map(|(points, seed)| {
            let mut random = Random::new(*seed);
            let profile = points.profile();
            let definition = Definition::of(&profile);
            let masking = MaskingIntegral::new(&profile, Rule::REFERENCE);
            let a = profile.normalization();
            let mut worst = [0.0_f64; 5];
            let mut check = |k: usize, what: &str, got: f64, want: f64| {
                let error = (got - want).abs() / want.abs().max(1e-250);
                assert!(error < 1e-12, "{what} = {got:e} is not {want:e}: {error:e} in {points:?}");
                worst[k] = worst[k].max(error);
            };
            check(0, "1/(2A)", 0.5 / a, definition.integral(0.0, &|t| t));
            check(1, "mean", profile.mean(), 2.0 * a * definition.integral(0.0, &|t| t * t));
            let end = profile.breaks(20.0).pop().unwrap_or(1.0);
            for _ in 0..12 {
                let q = random.log_between(1e-3, end.min(1e3));
                check(2, "sf", profile.sf(q), 2.0 * a * definition.integral(q, &|t| t));
                let factor = 2.0 * a / std::f64::consts::PI;
                // H + a is what G1 is made of; far out in a light tail the kernel of this reference has lost H alone
                let h = factor
                    * definition.integral(q, &|t| {
                        let height = ((t - q) * (t + q)).sqrt();
                        t * if height > 0.05 * q {
                            height - q * height.atan2(q)
                        } else {
                            let w = (height / q).powi(2);
                            height
                                * w
                                * (1.0 / 3.0
                                    - w * (0.2 - w * (1.0 / 7.0 - w * (1.0 / 9.0 - w * (1.0 / 11.0 - w / 13.0)))))
                        }
                    });
                let s = factor * definition.integral(q, &|t| t * ((t - q) * (t + q)).sqrt().atan2(q));
                let got = masking.at(&profile, q);
                check(3, "H", got.h, h);
                check(4, "S", got.s, s);
            }
            worst
        })
        .reduce(|| [0.0; 5], |a, b| std::array::from_fn(|k| a[k].max(b[k])));
    println!("worst {worst:?}");
}

#[test]
fn visible_sampling_has_little_variance() {
    let worst = tables("variance")
        .par_iter()
        .map(|points| {
            let ndf = Ndf::new(Box::new(points.profile()), 1e-5).unwrap_or_else(|error| panic!("{error}"));
            let scale = ndf.visible_table().scale();
            let mut worst = (0.0, 0.0);
            for position in [0.02, 0.1, 0.25, 0.5, 0.63, 0.8, 0.93, 0.98] {
                let a = scale * position / (1.0 - position);
                let second = second_moment(&ndf, a);
                if !(second < worst.0) {
                    worst = (second, a);
                }
            }
            worst.0
        })
        .reduce(|| 0.0, f64::max);
    println!("worst {worst}");
    assert!(worst <= 1.002, "E[w²] = {worst}");
}

/// `cargo test --release --test tabulated build -- --ignored --nocapture`
#[test]
#[ignore = "a measurement"]
fn build_times() {
    let mut random = Random::new(11);
    for count in [16, 64, 250, 1000] {
        for kind in [0, 1, 3] {
            let points = random_table(&mut random, kind, count);
            let (mut least, mut parts) = (f64::INFINITY, [f64::INFINITY; 3]);
            for _ in 0..9 {
                let start = std::time::Instant::now();
                let profile = points.profile();
                parts[0] = parts[0].min(start.elapsed().as_secs_f64());
                let from = std::time::Instant::now();
                let masking = MaskingIntegral::new(&profile, Rule::TABLE);
                parts[1] = parts[1].min(from.elapsed().as_secs_f64());
                let from = std::time::Instant::now();
                let table = sgtd_core::masking::table::LambdaTable::new(&profile, &masking, 1e-5);
                assert!(table.reached() < 1e-4);
                parts[2] = parts[2].min(from.elapsed().as_secs_f64());
                let start = std::time::Instant::now();
                let ndf = Ndf::new(Box::new(points.profile()), 1e-5).unwrap_or_else(|error| panic!("{error}"));
                assert!(ndf.accuracy_reached() < 1e-4);
                least = least.min(start.elapsed().as_secs_f64());
            }
            let [profile, integral, table] = parts.map(|t| 1e3 * t);
            println!(
                "{count} kind {kind}: {:.2} ms (profile {profile:.2}, integral {integral:.2}, Λ {table:.2}, {} breaks)",
                1e3 * least,
                points.profile().breaks(50.0).len()
            );
        }
    }
}

/// D by angle, D cos by slope and slope density by slope describe one profile.
#[test]
fn quantities_and_angles_say_the_same() {
    let slopes: Vec<f64> = (0..40).map(|k| 0.05 * f64::from(k)).collect();
    let f: Vec<f64> = slopes.iter().map(|x| (1.0 + 3.0 * x * x).powf(-2.4)).collect();
    let sec = |x: f64| x.hypot(1.0);
    let by = |power: i32| -> Vec<f64> { slopes.iter().zip(&f).map(|(&x, f)| f * sec(x).powi(power)).collect() };
    let degrees: Vec<f64> = slopes.iter().map(|x| x.atan().to_degrees()).collect();
    let named = |name: &str| Quantity::named(name).unwrap_or_else(|error| panic!("{error}"));
    let made = [
        TabulatedProfile::new(&slopes, &f, TableTail::Cut),
        TabulatedProfile::of(&slopes, &f, named("slope"), None, TableTail::Cut),
        TabulatedProfile::of(&slopes, &by(3), named("D_cos"), None, TableTail::Cut),
        TabulatedProfile::from_angles(&degrees, &by(4), named("D"), None, TableTail::Cut),
    ]
    .map(|profile| profile.unwrap_or_else(|error| panic!("{error}")));
    for profile in &made[1..] {
        assert!((profile.width() / made[0].width() - 1.0).abs() < 1e-12);
        for k in 0..100 {
            let x = 0.03 * f64::from(k);
            let (found, expected) = (profile.f(x) * profile.normalization(), made[0].f(x) * made[0].normalization());
            assert!((found - expected).abs() <= 1e-11 * expected, "x = {x}: {found:e}, not {expected:e}");
        }
    }
    assert!(Quantity::named("height").is_err());
}

/// Rows whose slopes round to one another are named as the user counts them, whether the table begins at 0 or a node is added there.
#[test]
fn rows_that_are_one_are_named() {
    for first in [0.0, 1e-3] {
        // neighbors that divided by the mean slope may be one number
        let errors: Vec<String> = (0..200)
            .map(|k| 0.5 + 0.01 * f64::from(k))
            .filter_map(|x| {
                let slopes = [first, x, x.next_up(), 4.0];
                TabulatedProfile::new(&slopes, &[1.0, 0.5, 0.4, 0.1], TableTail::Cut).err()
            })
            .map(|error| error.to_string())
            .collect();
        assert!(errors.len() > 2, "{}", errors.len());
        for error in errors {
            assert!(error.contains("\"slopes\" in row 3") && error.contains("more than rounding"), "{error}");
        }
    }
}

//! The cases that renderers were reported to get wrong, and those that this family makes hard: one test and one reason
//! each.
//!
//! The same names run again through the plugin, in single precision.

mod cases;
mod oracle;

use cases::{Case, LIST, direction};
use glam::DVec3;
use oracle::Oracle;
use sgtd_core::family::shape::Shape;
use sgtd_core::family::skewed_t::SkewedT;
use sgtd_core::ndf::{Ndf, NormalSample, Roughness, Shadowing};
use sgtd_core::profile::Profile;
use std::f64::consts::{FRAC_PI_2, PI};

const INF: f64 = f64::INFINITY;

const fn case(gamma: f64, p: f64, lambda: f64, shift: f64) -> Case {
    Case { gamma, p, lambda, shift }
}

fn ndf(case: Case, accuracy: f64) -> Ndf {
    Ndf::new(Box::new(case.profile()), accuracy).unwrap_or_else(|error| panic!("{case:?}: {error}"))
}

fn isotropic(alpha: f64) -> Roughness {
    Roughness { u: alpha, v: alpha }
}

/// Both modes of masking.
const ACCURACIES: [f64; 2] = [0.0, 1e-3];
/// Random numbers: both ends of what a single-precision sampler draws, and the middle.
const NUMBERS: [f64; 5] = [0.0, 5.9604644775390625e-8, 0.5, 0.9, 1.0 - 5.9604644775390625e-8];

/// Finite, not negative, bounded by 1 where it must be: for one view, everything that can be asked.
fn assert_good(ndf: &Ndf, alpha: Roughness, wi: DVec3, what: &str) {
    let finite = |x: f64| (0.0..=f64::MAX).contains(&x);
    let (lambda, g1) = (ndf.lambda(alpha, wi), ndf.g1(alpha, wi));
    assert!(finite(lambda) && (0.0..=1.0).contains(&g1), "{what}: Λ = {lambda}, G1 = {g1}");
    for u1 in NUMBERS {
        for u2 in NUMBERS {
            for sample in [ndf.sample_visible(alpha, wi, (u1, u2)), ndf.sample_projected(alpha, (u1, u2))] {
                let NormalSample { m, pdf, d_over_pdf } = sample;
                assert!(finite(pdf) && finite(d_over_pdf), "{what}: {sample:?} of {u1} {u2}");
                assert!((m.length() - 1.0).abs() < 1e-9 && m.z >= 0.0, "{what}: {m:?}");
                let d = ndf.d(alpha, m);
                let visible = ndf.pdf_visible(alpha, wi, m);
                assert!(
                    finite(d) && finite(visible) && finite(ndf.pdf_projected(alpha, m)),
                    "{what}: D = {d}, pdf {visible}"
                );
                let wo = 2.0 * wi.dot(m) * m - wi;
                let g2 = ndf.g2(alpha, wi, wo, Shadowing::HeightCorrelated);
                assert!(g2 >= 0.0 && g2 <= g1.min(ndf.g1(alpha, wo)), "{what}: G2 = {g2}");
            }
        }
    }
}

/// A roughness of exactly 0, or a texture with zeros in it, divides by zero in every formula: it is refused here, and
/// floored at 1e-4 by the caller, where everything must be finite.
#[test]
fn roughness_of_zero() {
    for (u, v) in [(0.0, 0.0), (0.0, 0.3), (0.3, 0.0), (-0.0, 0.1)] {
        assert!(Roughness::new(u, v).is_err(), "{u} {v}");
    }
    for shape in LIST {
        for (u, v) in [(1e-4, 1e-4), (1e-4, 0.3), (0.3, 1e-4)] {
            assert_good(&ndf(shape, 1e-3), Roughness { u, v }, direction(0.6, 0.8), &format!("{shape:?} {u} {v}"));
        }
    }
}

/// As the roughness vanishes the surface must become the smooth conductor: normals at the pole, nothing masked.
#[test]
fn roughness_towards_zero_is_a_mirror() {
    for shape in [case(2.0, 1.0, 0.0, 0.0), case(INF, 1.0, 0.3, 0.5), case(3.0, 2.0, 0.0, 1.0)] {
        let (ndf, alpha) = (ndf(shape, 1e-4), isotropic(1e-6));
        for theta in [0.0f64, 0.5, 1.2, 1.5] {
            let wi = direction(theta, 0.3);
            assert!(ndf.g1(alpha, wi) > 1.0 - 1e-4 && ndf.g2(alpha, wi, wi, Shadowing::HeightCorrelated) > 1.0 - 1e-4);
            for u in [0.01, 0.3, 0.7, 0.99] {
                let sample = ndf.sample_visible(alpha, wi, (u, 0.3));
                assert!(sample.m.z > 1.0 - 1e-8, "{shape:?} {theta}: {sample:?}");
                // the weight of a mirror, D G1 (wi·m)/(cos θ pdf), is 1
                let weight = sample.d_over_pdf * ndf.g1(alpha, wi) * wi.dot(sample.m) / wi.z;
                assert!((weight - 1.0).abs() < 0.05, "{shape:?} {theta} {u}: weight {weight}");
            }
        }
    }
}

/// Away from its narrow peak D underflows at small roughness; 0/0 and ∞·0 lurk in its quotients.
#[test]
fn underflow_at_small_roughness() {
    for shape in LIST {
        let (ndf, alpha) = (ndf(shape, 1e-3), isotropic(1e-4));
        let peak = ndf.d(alpha, direction((1e-4 * shape.shift).atan(), 0.0));
        assert!(peak > 1.0 && peak < INF, "{shape:?}: peak {peak:e}");
        for theta in [0.3, 0.8, 1.5, FRAC_PI_2 - 1e-9] {
            let m = direction(theta, 0.2);
            let (d, pdf) = (ndf.d(alpha, m), ndf.pdf_visible(alpha, direction(0.4, 1.0), m));
            assert!(
                (0.0..INF).contains(&d) && (0.0..INF).contains(&pdf),
                "{shape:?} {theta}: D = {d:e}, pdf = {pdf:e}"
            );
        }
    }
    assert_eq!(ndf(case(INF, 1.0, 0.0, 0.0), 0.0).d(isotropic(1e-4), direction(0.8, 0.0)), 0.0);
}

/// At cos θ = 0 the cotangent is 0, Λ infinite and the view's azimuth all that is left.
#[test]
fn exact_grazing() {
    for accuracy in ACCURACIES {
        for shape in LIST {
            let ndf = ndf(shape, accuracy);
            let (alpha, wi) = (Roughness { u: 0.3, v: 0.1 }, DVec3::new(0.6, 0.8, 0.0));
            assert_eq!(ndf.g1(alpha, wi), 0.0, "{shape:?}");
            assert_eq!(ndf.g2(alpha, wi, DVec3::Z, Shadowing::Separable), 0.0);
            assert_eq!(ndf.sample_visible(alpha, wi, (0.3, 0.4)).pdf, 0.0);
            assert_eq!((ndf.d(alpha, wi), ndf.pdf_visible(alpha, wi, DVec3::Z)), (0.0, 0.0));
            assert!(ndf.lambda(alpha, wi) > 1e300);
            for z in [1e-3, 1e-8, 1e-30, 1e-300, 5e-324] {
                assert_good(&ndf, alpha, DVec3::new(0.6, 0.8, z), &format!("{shape:?}, cos {z:e}"));
            }
            // next to the horizon Λ = M₁/a − ½
            let (a, near) = (1e-9, DVec3::new(1.0, 0.0, 1e-9 * 0.3));
            let want = ndf.profile().mean() / PI / a - 0.5;
            assert!((ndf.lambda(alpha, near) / want - 1.0).abs() < 2.0 * ndf.accuracy_reached() + 1e-9, "{shape:?}");
        }
    }
}

/// Exactly along the normal the azimuth is undefined, a infinite, and nothing is masked.
#[test]
fn exact_normal_incidence() {
    for accuracy in ACCURACIES {
        for shape in LIST {
            let (ndf, alpha) = (ndf(shape, accuracy), Roughness { u: 0.05, v: 2.0 });
            assert_eq!((ndf.lambda(alpha, DVec3::Z), ndf.g1(alpha, DVec3::Z)), (0.0, 1.0));
            assert_good(&ndf, alpha, DVec3::Z, &format!("{shape:?}"));
            // seen along the normal, D cos is what is seen
            for theta in [0.01, 0.3, 1.0] {
                let m = direction(theta, 0.4);
                let (visible, projected) = (ndf.pdf_visible(alpha, DVec3::Z, m), ndf.pdf_projected(alpha, m));
                let spline = if accuracy == 0.0 { 0.2 } else { 1e-5 };
                assert!(
                    (visible / projected - 1.0).abs() < spline || projected < 1e-6,
                    "{shape:?}: {visible:e} {projected:e}"
                );
            }
            // a rounding away from it the azimuth comes from a denormal vector
            for tiny in [1e-17, 1e-160, 1e-310, 5e-324] {
                assert_good(&ndf, alpha, DVec3::new(tiny, -tiny, 1.0), &format!("{shape:?}, {tiny:e} off the normal"));
            }
        }
    }
}

/// The ends of the range of roughness, where α² leaves the comfort of single precision.
#[test]
fn roughness_of_a_ten_thousandth_and_of_ten() {
    for shape in LIST {
        let ndf = ndf(shape, 1e-3);
        for alpha in [1e-4, 10.0] {
            for theta in [0.0f64, 0.7, 1.5, 1.57] {
                assert_good(&ndf, isotropic(alpha), direction(theta, 2.0), &format!("{shape:?} {alpha} {theta}"));
            }
        }
    }
}

/// With α_u/α_v = 10⁴ the stretched view points along one tangent for nearly every direction.
#[test]
fn anisotropy_of_ten_thousand() {
    for shape in LIST {
        let ndf = ndf(shape, 1e-3);
        for alpha in [Roughness { u: 1.0, v: 1e-4 }, Roughness { u: 1e-3, v: 10.0 }] {
            for phi in [0.0, 1e-5, 1e-4, 0.5, FRAC_PI_2 - 1e-4, FRAC_PI_2] {
                assert_good(&ndf, alpha, direction(1.2, phi), &format!("{shape:?} {alpha:?} {phi}"));
            }
        }
    }
}

/// tan⁴θ overflows single precision at 89.999997°, double precision 10⁻⁷⁷ from the horizon; D itself is finite there.
#[test]
fn tangents_to_the_fourth_overflow() {
    let ndf = ndf(case(2.0, 1.0, 0.0, 0.0), 0.0);
    for alpha in [0.01, 0.5, 1.0, 5.0] {
        for z in [1e-5, 1e-10, 1e-20, 1e-77, 1e-100, 1e-150, 1e-200, 1e-308, 5e-324] {
            // GGX: 1/(π α² (sin²/α² + cos²)²), whose cos² is gone
            let want = alpha * alpha / PI;
            let got = ndf.d(isotropic(alpha), DVec3::new(0.6, 0.8, z));
            let exact = z > 1e-70;
            // beyond that f itself has underflowed
            assert!(
                (got / want - 1.0).abs() < 1e-8 || (!exact && (0.0..=want * 1.01).contains(&got)),
                "{alpha} {z:e}: {got:e}, not {want:e}"
            );
        }
    }
}

/// 0 must not draw a pole that has no azimuth, 1 − 2⁻²⁴ must not draw infinity.
#[test]
fn random_numbers_zero_and_almost_one() {
    for accuracy in ACCURACIES {
        for shape in LIST {
            let ndf = ndf(shape, accuracy);
            for theta in [0.0, 0.4, 1.3, 1.56] {
                assert_good(&ndf, Roughness { u: 0.2, v: 0.6 }, direction(theta, 1.0), &format!("{shape:?} {theta}"));
            }
            for u in [0.0, 5e-324, 1e-300, 1.0f64.next_down(), 1.0] {
                let sample = ndf.sample_visible(isotropic(0.3), direction(0.9, 0.1), (u, u));
                assert!(sample.m.is_finite() && sample.pdf.is_finite(), "{shape:?} {u}: {sample:?}");
                let sample = ndf.sample_projected(isotropic(0.3), (u, u));
                assert!(sample.m.is_finite() && sample.pdf.is_finite(), "{shape:?} {u}: {sample:?}");
            }
        }
    }
}

/// A ring of radius 1000 and width 1 keeps three digits less of x − m, and 10⁻³ less of its rim if it is skewed.
#[test]
fn ring_of_radius_one_thousand() {
    for (gamma, p, lambda) in [(2.0, 1.0, 0.0), (INF, 1.0, 0.999), (1.7, 1.0, -0.999), (INF, 50.0, 0.0)] {
        let shape = case(gamma, p, lambda, 1000.0);
        let ndf = ndf(shape, 0.0);
        let alpha = isotropic(0.01);
        let oracle = Oracle { gamma, p, lambda, m: 1000.0 };
        let a = oracle.normalization();
        for offset in [-3.0, -1.0, -0.5, -1e-3, 0.0, 1e-3, 0.5, 1.0, 3.0] {
            let x = 1000.0 + offset;
            let want = a * oracle.f(x);
            let got = ndf.profile().normalization() * ndf.profile().f(x);
            assert!((got / want - 1.0).abs() < 1e-13 || want < 1e-290, "{shape:?} at {x}: {got:e}, not {want:e}");
        }
        // seen along the normal the whole ring is at 45° and more: half of it on either side of its radius, about
        let sample = ndf.sample_visible(alpha, DVec3::Z, (0.5, 0.2));
        let slope = (1.0 / sample.m.z.powi(2) - 1.0).sqrt() / 0.01;
        assert!((slope - 1000.0).abs() < 5.0, "{shape:?}: {slope}");
        assert_good(&ndf, alpha, direction(1.0, 0.5), &format!("{shape:?}"));
    }
}

/// With p = 50 the profile is a box whose edge bends within 1 %: quadrature that does not know the edge misses it.
#[test]
fn box_of_p_fifty() {
    for gamma in [2.0, 40.0, INF] {
        let shape = case(gamma, 50.0, 0.0, 0.0);
        let ndf = ndf(shape, 0.0);
        let oracle = Oracle { gamma, p: 50.0, lambda: 0.0, m: 0.0 };
        assert!((ndf.profile().normalization() / oracle.normalization() - 1.0).abs() < 1e-13);
        for a in [0.3, 0.95, 0.99, 1.0, 1.01, 1.05] {
            let want = 2.0 / PI * oracle.normalization() * oracle.bracket_integral(a) / a;
            let got = ndf.lambda(isotropic(1.0), DVec3::new(1.0, 0.0, a));
            assert!((got / want - 1.0).abs() < 1e-12, "{shape:?} a = {a}: {got:e}, not {want:e}");
        }
        assert_good(&ndf, isotropic(0.3), direction(1.2, 0.5), &format!("{shape:?}"));
    }
}

/// As 2pγ → 3 the mean slope, and with it masking, becomes infinite: nothing may jump, overflow or lose its digits on
/// the way.
#[test]
fn gamma_at_its_limit() {
    let mut before = 0.0;
    for excess in [1.0, 1e-1, 1e-2, 1e-3, 1e-6, 1e-9, 1e-12] {
        let shape = Shape::new(1.5 + 0.5 * excess, 1.0, 0.0, 0.0).unwrap_or_else(|error| panic!("{error}"));
        let profile = SkewedT::new(shape);
        let mean = profile.mean();
        // M₁ → 1/(2pγ−3) times a constant
        assert!(mean > before && mean < INF && mean * excess < 2.0, "excess {excess:e}: mean {mean:e}");
        before = mean;
        for accuracy in ACCURACIES {
            let ndf = Ndf::new(Box::new(SkewedT::new(shape)), accuracy).unwrap_or_else(|error| panic!("{error}"));
            for theta in [0.3, 1.2, 1.55] {
                assert_good(&ndf, isotropic(0.5), direction(theta, 0.2), &format!("excess {excess:e}"));
            }
        }
    }
    assert!(Shape::new(1.5, 1.0, 0.0, 0.0).is_err());
}

/// At |λ| = 0.999 one side is two thousand times narrower than the other, and its width 1 − λ has lost three digits.
#[test]
fn skew_of_999_thousandths() {
    for lambda in [0.999, -0.999] {
        for (gamma, p, shift) in [(2.0, 1.0, 0.3), (INF, 1.0, 0.3), (1.8, 1.2, 4.0), (INF, 10.0, 3.0), (3.0, 1.0, 0.0)]
        {
            let shape = case(gamma, p, lambda, shift);
            let ndf = ndf(shape, 0.0);
            let oracle = Oracle { gamma, p, lambda, m: shift };
            let a = oracle.normalization();
            assert!((ndf.profile().normalization() / a - 1.0).abs() < 1e-13, "{shape:?}");
            for x in [0.5 * shift + 0.01, shift + 1e-3, shift + 1e-4, (shift - 1e-3).max(1e-3), 2.0 * shift + 1.0] {
                let (want, got) = (oracle.f(x), ndf.profile().f(x));
                assert!((got - want).abs() <= 1e-13 * want + 1e-300, "{shape:?} at {x}: {got:e}, not {want:e}");
            }
            assert_good(&ndf, isotropic(0.4), direction(1.3, 1.5), &format!("{shape:?}"));
        }
    }
}

/// Where a broad side meets one a thousand times narrower, the logarithmic slope of sf jumps by as much, and Newton's
/// steps go to and fro across the rim, hardly closer each time.
#[test]
fn quantiles_across_a_rim_of_two_widths() {
    for (p, lambda, shift) in
        [(0.301, -0.9993, 0.4509), (0.169, -0.999, 0.0958), (0.25, 0.999, 0.3), (1.0, -0.999, 2.0)]
    {
        let profile = case(INF, p, lambda, shift).profile();
        for k in 1..1000 {
            let u = f64::from(k) / 1000.0;
            let (cdf, sf) = (profile.cdf(profile.quantile(u)), profile.sf(profile.isf(u)));
            assert!(
                (cdf / u - 1.0).abs() < 1e-11 && (sf / u - 1.0).abs() < 1e-11,
                "p = {p}, λ = {lambda}, u = {u}: {cdf} {sf}"
            );
        }
    }
}

/// Back-reflection has m = wi exactly, where halfway vectors and polarization frames degenerate.
#[test]
fn light_and_view_coincide() {
    for shape in LIST {
        let (ndf, alpha) = (ndf(shape, 1e-3), Roughness { u: 0.2, v: 0.5 });
        for theta in [0.0, 0.5, 1.2, 1.57] {
            let w = direction(theta, 0.9);
            let lambda = ndf.lambda(alpha, w);
            let g2 = ndf.g2(alpha, w, w, Shadowing::HeightCorrelated);
            assert!((g2 * (1.0 + 2.0 * lambda) - 1.0).abs() < 1e-12, "{shape:?} {theta}");
            let (d, pdf) = (ndf.d(alpha, w), ndf.pdf_visible(alpha, w, w));
            assert!(
                d.is_finite() && pdf.is_finite() && (pdf > 0.0 || d < 1e-3),
                "{shape:?} {theta}: D = {d:e}, pdf = {pdf:e}"
            );
        }
    }
}

/// Denormal numbers lose digits without a sign of it, and their reciprocals overflow.
#[test]
fn denormals() {
    for shape in LIST {
        let profile = shape.profile();
        let tiny = f64::from_bits(1);
        for x in [tiny, 1e-310, f64::MIN_POSITIVE] {
            assert!(profile.f(x).is_finite() && profile.f(x) >= 0.0);
            let (cdf, sf) = (profile.cdf(x), profile.sf(x));
            assert!((0.0..=1e-280).contains(&cdf) && (sf - 1.0).abs() < 1e-15, "{shape:?}: cdf {cdf:e}, sf {sf}");
            assert!(profile.quantile(x).is_finite() && profile.isf(x).is_finite(), "{shape:?}: {x:e}");
        }
        let ndf = ndf(shape, 0.0);
        assert!(ndf.lambda(isotropic(1.0), DVec3::new(1.0, 0.0, tiny)).is_finite());
        assert_eq!(ndf.lambda(isotropic(1e-4), DVec3::new(tiny, 0.0, 1.0)), 0.0);
    }
    let profile = case(2.0, 1.0, 0.0, 5e-324).profile();
    assert!((profile.normalization() - 1.0).abs() < 1e-15, "a shift of a denormal: A = {}", profile.normalization());
}

/// At the cusp x = m the profile's formula has 0 to a power below 1; at a cusp in the pole, too.
#[test]
fn limits_where_formulas_say_zero_over_zero() {
    for (gamma, p) in [(INF, 0.25), (8.0, 0.25), (2.0, 50.0), (INF, 1.0)] {
        for (lambda, shift) in [(0.0, 0.0), (0.5, 0.0), (-0.5, 2.0)] {
            let shape = case(gamma, p, lambda, shift);
            let profile = shape.profile();
            assert_eq!(profile.f(shift), 1.0, "{shape:?}");
            assert_eq!((profile.cdf(0.0), profile.sf(0.0)), (0.0, 1.0), "{shape:?}");
            assert_eq!((profile.sf(INF), profile.f(INF)), (0.0, 0.0), "{shape:?}");
            assert!((profile.cdf(INF) - 1.0).abs() < 1e-15, "{shape:?}");
            assert_eq!((profile.quantile(0.0), profile.isf(1.0)), (0.0, 0.0), "{shape:?}");
            let ndf = ndf(shape, 0.0);
            let want = profile.normalization() * profile.f(0.0) / (PI * 0.06);
            assert!((ndf.d(Roughness { u: 0.2, v: 0.3 }, DVec3::Z) / want - 1.0).abs() < 1e-14, "{shape:?}");
        }
    }
}

/// The rational fit of 2017 gave Λ = −0.0044 and G1 = 1.0045 at γ = 2.5: light from nowhere.
#[test]
fn masking_never_brightens() {
    for accuracy in ACCURACIES {
        for gamma in [1.51, 1.6, 2.05, 2.5, 3.0, 4.0, 10.0, 40.0, INF] {
            let ndf = ndf(case(gamma, 1.0, 0.0, 0.0), accuracy);
            for k in 0..=2000 {
                let w = direction(FRAC_PI_2 * f64::from(k) / 2000.0, 0.0);
                let (lambda, g1) = (ndf.lambda(isotropic(0.5), w), ndf.g1(isotropic(0.5), w));
                assert!(lambda >= 0.0 && (0.0..=1.0).contains(&g1), "γ = {gamma} k = {k}: Λ = {lambda}, G1 = {g1}");
            }
        }
    }
}

/// Bounded sampling leaves out normals whose reflection goes below the horizon, but refraction needs them: all that
/// face the view must be drawn.
#[test]
fn visible_normals_are_not_bounded_by_reflection() {
    for shape in [case(2.0, 1.0, 0.0, 0.0), case(INF, 1.0, 0.0, 0.5), case(3.0, 2.0, 0.5, 1.0)] {
        let (ndf, alpha, wi) = (ndf(shape, 1e-3), isotropic(0.8), direction(1.45, 0.0));
        let below = (0..4000)
            .map(|k| {
                ndf.sample_visible(
                    alpha,
                    wi,
                    ((f64::from(k) + 0.5) / 4000.0, (f64::from(k) * 0.618_033_988_75).fract()),
                )
            })
            .filter(|sample| sample.pdf > 0.0 && (2.0 * wi.dot(sample.m) * sample.m - wi).z < 0.0)
            .count();
        assert!(below > 20, "{shape:?}: only {below} of 4000 normals reflect below the horizon");
    }
}

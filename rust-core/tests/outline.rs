//! Does a profile tell the truth about its outline: break points, cusps, tail and steepness? Quadrature and tables rely
//! on it.

mod cases;

use cases::{Case, LIST, Random};
use sgtd_core::ndf::Ndf;
use sgtd_core::numerics::quadrature::gauss;
use sgtd_core::profile::{Profile, Tail};

fn all_shapes() -> Vec<Case> {
    let mut shapes = LIST.to_vec();
    shapes.extend(cases::edge_shapes());
    shapes.extend(cases::spaced_shapes());
    shapes.extend(cases::random_shapes(&mut Random::seeded("outline"), 60));
    shapes
}

/// Ascending, and no further apart than ln f changes by 10, down to where the depth asked for is reached.
#[test]
fn break_points_divide_the_profile_evenly() {
    for case in all_shapes() {
        let profile = case.profile();
        for depth in [40.0, 745.0] {
            let breaks = profile.breaks(depth);
            assert!(!breaks.is_empty() && breaks[0] > 0.0, "{case:?}: {breaks:?}");
            assert!(breaks.windows(2).all(|pair| pair[0] < pair[1]), "{case:?}: not ascending");
            assert!(breaks.len() < 600, "{case:?}: {} break points", breaks.len());
            for pair in breaks.windows(2) {
                let (left, right) = (profile.f(pair[0]), profile.f(pair[1]));
                if left.min(right) > 1e-300 {
                    let change = (right / left).ln().abs();
                    assert!(change < 10.0, "{case:?}: ln f changes by {change} from {} to {}", pair[0], pair[1]);
                }
            }
            let last = breaks[breaks.len() - 1];
            let power = match profile.tail() {
                Tail::Power { exact_from, .. } => last >= exact_from,
                Tail::Exponential => false,
            };
            let spent = profile.f(last).ln() + 3.0 * (last / (case.shift + 1.0)).ln().max(0.0) < -depth + 15.0;
            assert!(power || spent || last > 1e99, "{case:?}: ends at {last:e}, f = {:e}", profile.f(last));
        }
    }
}

/// A ring's rim is a break point wherever it is in the table of cusps; no cusp is announced for analytic profiles.
#[test]
fn cusps_are_where_the_profile_is_not_smooth() {
    for case in all_shapes() {
        let profile = case.profile();
        let smooth = case.shift == 0.0 || (case.lambda == 0.0 && case.p.fract() == 0.0);
        assert_eq!(profile.cusps(), if smooth { vec![] } else { vec![case.shift] }, "{case:?}");
        let breaks = profile.breaks(745.0);
        assert!(profile.cusps().iter().all(|cusp| breaks.contains(cusp)), "{case:?}: cusp is no break point");
    }
}

/// From `exact_from` on, f falls by 2^(3+excess) when x doubles, to rounding; exponential tails have none left.
#[test]
fn tails_are_what_they_say() {
    for case in all_shapes() {
        let profile = case.profile();
        match profile.tail() {
            Tail::Exponential => {
                assert!(case.gamma.is_infinite(), "{case:?}");
                let breaks = profile.breaks(745.0);
                assert!(profile.f(2.0 * breaks[breaks.len() - 1]) < 1e-300, "{case:?}");
            }
            Tail::Power { exact_from, excess } => {
                assert!((excess - case.excess()).abs() <= 1e-15 * excess.max(1.0), "{case:?}: excess {excess}");
                // sf = c x^(−1−excess): where f is denormal and its powers overflow, too
                let mut x = exact_from;
                while x < 1e290 && profile.sf(2.0 * x) > 1e-290 {
                    let fall = (profile.sf(x) / profile.sf(2.0 * x)).log2();
                    assert!((fall - 1.0 - excess).abs() < 2e-12, "{case:?}: sf falls by 2^{fall} from {x:e}");
                    x *= 32.0;
                }
                let (near, far) = (profile.f(exact_from), profile.f(2.0 * exact_from));
                if far > 1e-290 {
                    let fall = (near / far).log2();
                    assert!((fall - 3.0 - excess).abs() < 1e-12 * (3.0 + excess), "{case:?}: falls by 2^{fall}");
                }
            }
        }
    }
}

/// |d ln f/d ln x| of a power tail tends to 2pγ, which it reaches where 1e-7 of the peak is left; for exp(−x²) it is
/// 2x² there.
#[test]
fn steepness_of_known_profiles() {
    let steepness = |case: Case| match Ndf::new(Box::new(case.profile()), 1e-3) {
        Ok(ndf) => ndf.steepness(),
        Err(error) => panic!("{error}"),
    };
    let case = |gamma, p, shift| Case { gamma, p, lambda: 0.0, shift };
    let ggx = steepness(case(2.0, 1.0, 0.0));
    assert!((3.7..4.01).contains(&ggx), "GGX: {ggx}");
    let beckmann = steepness(case(f64::INFINITY, 1.0, 0.0));
    let want = 2.0 * 1e7f64.ln();
    assert!((0.7 * want..1.05 * want).contains(&beckmann), "Beckmann: {beckmann}, not about {want}");
    // the flank of a ring of radius m is m times as steep as it is wide
    let ring = steepness(case(f64::INFINITY, 1.0, 1000.0));
    let want = 2.0 * 1000.0 * 1e7f64.ln().sqrt();
    assert!((0.7 * want..1.05 * want).contains(&ring), "ring: {ring}, not about {want}");
    for case in LIST {
        let steepness = steepness(case);
        assert!(steepness.is_finite() && steepness > 1.0, "{case:?}: {steepness}");
    }
}

#[test]
fn nodes_are_ascending_and_weights_sum_to_one() {
    for n in 1..=64 {
        let nodes = gauss(n).nodes();
        assert_eq!(nodes.len(), n);
        assert!(nodes.windows(2).all(|pair| pair[0].0 < pair[1].0), "{n} points: not ascending");
        assert!(nodes.iter().all(|&(t, weight)| t > 0.0 && t < 1.0 && weight > 0.0), "{n} points: {nodes:?}");
        let sum: f64 = nodes.iter().map(|&(_, weight)| weight).sum();
        assert!((sum - 1.0).abs() < 1e-14, "{n} points: weights sum to {sum}");
    }
}

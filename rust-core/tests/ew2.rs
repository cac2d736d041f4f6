//! tmp
use sgtd_core::{masking::*, profile::Profile, quadrature::gauss, shape::Shape, skewed_t::SkewedT, visible_table::*};
#[test]
fn ew2() {
    for (g, p, l, m) in [
        (2., 1., 0., 0.),
        (f64::INFINITY, 1., 0., 0.),
        (1.6, 1., 0., 0.),
        (1.8, 1., 0., 0.),
        (3., 1.3, 0.4, 0.7),
        (2., 1., 0., 5.),
        (f64::INFINITY, 1., 0., 5.),
        (f64::INFINITY, 1., 0., 100.),
        (2., 1., 0., 100.),
        (1.501, 1., 0., 0.),
        (2., 50., 0., 0.),
        (f64::INFINITY, 50., 0., 0.),
        (f64::INFINITY, 0.5, 0., 0.),
        (f64::INFINITY, 0.25, 0., 0.5),
        (6.1, 0.25, 0., 0.5),
        (40., 1., -0.9, 2.),
        (4., 1.2, 0.9, 1.),
        (1.55, 1., 0.3, 0.5),
        (f64::INFINITY, 1., 0.999, 1000.),
    ] {
        let pr = SkewedT::new(Shape::new(g, p, l, m).unwrap());
        let tm = std::time::Instant::now();
        let mi = MaskingIntegral::new(&pr, Rule::TABLE);
        let tm = tm.elapsed();
        let mr = MaskingIntegral::new(&pr, Rule::REFERENCE);
        let t0 = std::time::Instant::now();
        let t = VisibleTable::new(&pr, &mi);
        let dt = t0.elapsed();
        let ks = t.flat()[..CELLS].iter().map(|y| (*y as f64).sqrt()).collect::<Vec<_>>();
        let mut worst = (0., 0.);
        let mut list = vec![];
        let n = 91;
        for i in 0..n {
            let th = if i == n - 1 { 89.99f64 } else { i as f64 }.to_radians(); // unit roughness angle
            for al in [1.0, 0.1] {
                let (s, c) = (th.sin() * al, th.cos());
                let l = (s * s + c * c).sqrt();
                let (s, c) = (s / l, c / l);
                let a = c / s;
                let mix = t.mixture(c, s);
                let norm = if a.is_finite() && a < 1e9 { a + mr.at(&pr, a).h } else { 0. };
                if norm == 0. {
                    continue;
                }
                let mut e = 0.;
                let mut tot = 0.;
                for w in ks.windows(2) {
                    let f = |r: f64| {
                        let k = if r > a { ((r - a) * (r + a)).sqrt() - a * (a / r).acos() } else { 0. };
                        let tr =
                            pr.normalization() / std::f64::consts::PI * pr.f(r) * (std::f64::consts::PI * a + k) / norm;
                        let d = t.density(mix, r * r);
                        if d > 0. { tr * tr / d * 2. * r } else { 0. }
                    };
                    let g2 = |r: f64| t.density(mix, r * r) * 2. * r;
                    e += gauss(24).integrate(w[0].max(1e-300), w[1], f);
                    tot += gauss(24).integrate(w[0], w[1], g2);
                }
                list.push((e * tot, a));
                if e > worst.0 {
                    worst = (e, a);
                }
            }
        }
        println!(
            "{g} {p} {l} {m}: worst {:.5} at a={:.3e}  knots {:.3e}..{:.3e} mean/pi {:.3e} {tm:?} {dt:?}",
            worst.0,
            worst.1,
            ks[1],
            ks[CELLS - 1],
            pr.mean() / 3.14159
        );
    }
}

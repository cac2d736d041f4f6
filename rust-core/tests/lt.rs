//! tmp
use sgtd_core::{azimuth::Azimuth, lambda_table::*, masking::*, shape::Shape, skewed_t::SkewedT};
#[test]
fn lt() {
    for (g, p, l, m) in [
        (2., 1., 0., 0.),
        (f64::INFINITY, 1., 0., 0.),
        (1.6, 1., 0., 0.),
        (3., 1.3, 0.4, 0.7),
        (2., 1., 0., 5.),
        (f64::INFINITY, 1., 0., 5.),
        (f64::INFINITY, 1., 0., 100.),
        (2., 1., 0., 1000.),
        (1.501, 1., 0., 0.),
        (1.50001, 1., 0., 0.),
        (2., 50., 0., 0.),
        (f64::INFINITY, 50., 0., 0.),
        (f64::INFINITY, 0.5, 0., 0.),
        (f64::INFINITY, 0.25, 0., 0.5),
        (6.1, 0.25, 0., 0.5),
        (40., 1., -0.9, 2.),
        (4., 1.2, 0.9, 1.),
        (1.55, 1., 0.3, 0.5),
        (f64::INFINITY, 1., 0.999, 1000.),
        (f64::INFINITY, 100., 0., 0.),
    ] {
        let pr = SkewedT::new(Shape::new(g, p, l, m).unwrap());
        for acc in [1e-2, 1e-5, 1e-7] {
            let tm = std::time::Instant::now();
            let mi = MaskingIntegral::new(&pr, Rule::TABLE);
            let tm = tm.elapsed();
            let mr = MaskingIntegral::new(&pr, Rule::REFERENCE);

            let t0 = std::time::Instant::now();
            let t = LambdaTable::new(&pr, &mi, acc);
            let dt = t0.elapsed();
            let mut worst = (0., 0.);
            let t1 = std::time::Instant::now();
            let n = 2000;
            for i in 0..n {
                let a = 10f64.powf(-8. + 16. * i as f64 / n as f64);
                let h = mr.at(&pr, a).h;
                let e = ((a / (a + t.h(a))) / (a / (a + h)) - 1.).abs();
                if e > worst.0 {
                    worst = (e, a)
                }
            }
            println!(
                "{g} {p} {l} {m} acc {acc:.0e}: reached {:.1e} true {:.1e} at {:.2e}; cells {} shift {} build {tm:?} {dt:?}; masking {:?}",
                t.reached(),
                worst.0,
                worst.1,
                t.cells(),
                t.shift(),
                t1.elapsed() / n
            );
        }
    }
    let mut most = 0.;
    for i in 0..=400 {
        let rho = 10f64.powf(-6. + i as f64 / 400. * 12.);
        for j in 0..=400 {
            let az = Azimuth::new(0.5f64.sqrt(), 0.5f64.sqrt(), rho);
            let ph = az.sample(0.5 + 0.5 * j as f64 / 400.);
            let k = rho / (1. + rho);
            let lim = if rho > 1. { (-1. / rho).acos() } else { std::f64::consts::PI };
            let v = |x: f64| (1. - k) * x + k * x.sin();
            let e = (v(ph) - j as f64 / 400. * v(lim)).abs();
            if e > most {
                most = e;
            }
        }
    }
    println!("kepler {most:e}");
}

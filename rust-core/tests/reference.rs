//! tmp
use sgtd_core::{masking::*, profile::Profile, shape::Shape, skewed_t::SkewedT};
#[test]
fn visible() {
    let text = std::fs::read_to_string(std::env::var("REF").unwrap()).unwrap();
    let mut worst: std::collections::BTreeMap<String, (f64, String)> = Default::default();
    let bound = |q: &str| match q {
        "A" | "Af" => 1e-13,
        _ => 1e-12,
    };
    let mut bad = 0;
    for line in text.lines().skip(1) {
        let c: Vec<&str> = line.split(',').collect();
        let n = |i: usize| c[i].parse::<f64>().unwrap();
        let shape = match Shape::new(n(0), n(1), n(2), n(3)) {
            Ok(s) => s,
            Err(e) => {
                println!("{e}");
                continue;
            }
        };
        let pr = SkewedT::new(shape);
        let want = n(6);
        let got = match c[4] {
            "A" => pr.normalization(),
            "Af" => pr.normalization() * pr.f(n(5)),
            "cdf" => pr.cdf(n(5)),
            "sf" => pr.sf(n(5)),
            "Lambda" => MaskingIntegral::new(&pr, Rule::REFERENCE).at(&pr, n(5)).h / n(5),
            _ => continue,
        };
        let err = (got / want - 1.0).abs();
        let e = worst.entry(c[4].into()).or_default();
        if err > e.0 || err.is_nan() {
            *e = (err, line.into());
        }
        if !(err < bound(c[4])) {
            bad += 1;
            if bad < 60 {
                println!("{err:.1e} {line} got {got:e}");
            }
        }
    }
    println!("{worst:#?} bad {bad}");
}

//! Time per call of every public function that renderers or fits call often, with criterion's statistics.
//!
//! `cargo bench -p sgtd-benches --bench functions`; ratios against peers are in `ratios`.

use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;
use sgtd_core::family::shape::Shape;
use sgtd_core::family::skewed_t::SkewedT;
use sgtd_core::ndf::{Ndf, Roughness, Shadowing};
use std::hint::black_box;

fn functions(criterion: &mut Criterion) {
    let alpha = Roughness { u: 0.3, v: 0.2 };
    let (wi, wo) = (DVec3::new(0.8, 0.0, 0.6), DVec3::new(-0.36, 0.48, 0.8));
    let m = (wi + wo).normalize();
    for (name, gamma, p, lambda, shift) in
        [("full SGTD", 2.7, 1.3, 0.3, 0.4), ("student", 1.6, 1.0, 0.0, 0.0), ("beckmann", f64::INFINITY, 1.0, 0.0, 0.0)]
    {
        let shape = Shape::new(gamma, p, lambda, shift).expect("shapes of this bench are valid");
        let ndf = Ndf::new(Box::new(SkewedT::new(shape)), 1e-5).expect("valid");
        let exact = Ndf::new(Box::new(SkewedT::new(shape)), 0.0).expect("valid");
        let mut group = criterion.benchmark_group(name);
        group.bench_function("d", |b| b.iter(|| ndf.d(alpha, black_box(m))));
        group.bench_function("lambda, table", |b| b.iter(|| ndf.lambda(alpha, black_box(wi))));
        group.bench_function("lambda, quadrature", |b| b.iter(|| exact.lambda(alpha, black_box(wi))));
        group.bench_function("g2", |b| {
            b.iter(|| ndf.g2(alpha, black_box(wi), black_box(wo), Shadowing::HeightCorrelated));
        });
        group.bench_function("pdf_visible", |b| b.iter(|| ndf.pdf_visible(alpha, black_box(wi), black_box(m))));
        group.bench_function("sample_visible", |b| b.iter(|| ndf.sample_visible(alpha, black_box(wi), (0.3, 0.6))));
        group.bench_function("sample_projected", |b| b.iter(|| ndf.sample_projected(alpha, black_box((0.3, 0.6)))));
        group.bench_function("cdf", |b| b.iter(|| ndf.profile().cdf(black_box(1.2))));
        group.bench_function("quantile", |b| b.iter(|| ndf.profile().quantile(black_box(0.3))));
        group.bench_function("construction, 1e-5", |b| {
            b.iter(|| Ndf::new(Box::new(SkewedT::new(black_box(shape))), 1e-5).is_ok());
        });
        group.finish();
    }
}

criterion_group!(benches, functions);
criterion_main!(benches);

//! tmp
use sgtd_core::{masking::*, profile::Profile, shape::Shape, skewed_t::SkewedT};
#[test]
fn dbg() {
    let pr = SkewedT::new(Shape::new(1.05, 30., 0.4, 0.5).unwrap());
    println!("{:?} {:?} {} {}", pr.tail(), pr.breaks(745.), pr.mean(), pr.normalization());
    let mi = MaskingIntegral::new(&pr, Rule::REFERENCE);
    println!("{:?}", mi.at(&pr, 0.1));
}

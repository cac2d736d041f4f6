//! Does every shape run at the lowest node that its numbers allow, and is it the same distribution there?

mod cases;

use cases::{Case, LIST, direction};
use sgtd_core::family::shape::{Row, Shape};
use sgtd_core::family::skewed_t::SkewedT;
use sgtd_core::family::tree::{Node, nodes};
use sgtd_core::ndf::{Ndf, Roughness};
use sgtd_core::profile::Profile;
use std::collections::BTreeSet;

const INF: f64 = f64::INFINITY;

fn node(gamma: f64, p: f64, lambda: f64, shift: f64) -> Node {
    Node::lowest(&Case { gamma, p, lambda, shift }.shape())
}

/// Every corner of the lattice, each with its neighbor that lies just outside.
#[test]
fn every_corner_of_the_lattice_has_its_node() {
    for (name, [gamma, p, lambda, shift], scale) in [
        ("ggx", [2.0, 1.0, 0.0, 0.0], 1.0),
        ("ggx", [2.0, 1.0, 0.0, 0.5], 1.0),
        ("student", [2.0 + 4.5e-16, 1.0, 0.0, 0.0], 1.0),
        ("student", [2.0 - 2.3e-16, 1.0, 0.0, 0.0], 1.0),
        ("beckmann", [INF, 1.0, 0.0, 0.0], 1.0),
        ("beckmann", [1e25, 1.0, 0.0, 3.0], 1.0),
        ("student", [1e24, 1.0, 0.0, 0.0], 1.0),
        ("gtd", [2.0, 1.0 + 2.3e-16, 0.0, 0.0], 1.0),
        ("gnd", [INF, 1.0 - 1.2e-16, 0.0, 0.0], 1.0),
        ("std", [2.0, 1.0, 1e-300, 1e-300], 1.0),
        ("std", [2.0, 1.0, -0.4, 0.2], 1.0),
        ("snd", [INF, 1.0, 0.4, 0.2], 1.0),
        ("sgnd", [INF, 1.5, 0.4, 0.2], 1.0),
        ("sgtd", [2.0, 1.5, 0.4, 0.2], 1.0),
        // without a shift a skew is a roughness
        ("ggx", [2.0, 1.0, 0.4, 0.0], 1.4),
        ("beckmann", [INF, 1.0, -0.25, 0.0], 0.75),
        ("student", [1.8, 1.0, 0.4, 0.0], 1.4),
        ("gnd", [INF, 1.5, 0.4, 0.0], 1.4),
        ("gtd", [2.0, 1.5, 0.4, 0.0], 1.4),
        ("ggx", [2.0, 1.0, -0.0, -0.0], 1.0),
    ] {
        let found = node(gamma, p, lambda, shift);
        assert_eq!((found.row.name, found.alpha_scale), (name, scale), "{gamma} {p} {lambda} {shift}");
        assert_eq!(found.is_closed_form(), shift == 0.0 && name == "ggx", "{found:?}");
    }
}

/// The name under which a shape was written does not count, but for the scale of `hyper_cauchy`.
#[test]
fn the_name_of_the_row_does_not_count() {
    for (row, gamma, p) in [
        ("sgtd", Some(2.0), Some(1.0)),
        ("gtd", Some(2.0), Some(1.0)),
        ("std", Some(2.0), None),
        ("student", Some(2.0), None),
        ("hyper_cauchy", Some(2.0), None),
        ("ggx", None, None),
    ] {
        let row = Row::named(row).unwrap_or_else(|error| panic!("{error}"));
        let shape = row.shape(gamma, p, None, None).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(Node::lowest(&shape).row.name, "ggx", "{row:?}");
    }
}

/// D and masking of the node at its roughness are those of the shape: over the list, and where a skew is only a scale.
#[test]
fn a_node_is_the_shape_it_stands_for() {
    let skewed = LIST.map(|case| Case { shift: 0.0, lambda: 0.37 - 0.1 * case.p.min(8.0), ..case });
    for case in LIST.into_iter().chain(skewed) {
        let shape = case.shape();
        let Node { row, shape: reduced, alpha_scale } = Node::lowest(&shape);
        assert!(row.allows(&reduced));
        let tabulate =
            |shape: Shape| Ndf::new(Box::new(SkewedT::new(shape)), 0.0).unwrap_or_else(|error| panic!("{error}"));
        let (written, lowest) = (tabulate(shape), tabulate(reduced));
        let alpha = Roughness { u: 0.3, v: 0.2 };
        let scaled = Roughness { u: 0.3 * alpha_scale, v: 0.2 * alpha_scale };
        for degrees in [0.5, 5.0, 20.0, 45.0, 70.0, 88.0] {
            let w = direction(f64::to_radians(degrees), 0.7);
            // steep profiles magnify the rounding of the scaled slope
            let d = written.d(alpha, w);
            let tolerance = 1e-13 * (1.0 + 4.0 * case.p * shape.shift().max(1.0)) * (1.0 + d.ln().abs());
            assert!((lowest.d(scaled, w) / d - 1.0).abs() < tolerance || d < 1e-280, "{case:?} at {degrees}");
            let (g, want) = (lowest.g1(scaled, w), written.g1(alpha, w));
            assert!((g / want - 1.0).abs() < 1e-12, "{case:?} at {degrees}: {g} {want}");
        }
    }
}

/// Each node holds what lies below it, in shapes as in names, and a shape belongs to a node and to all nodes above that one.
#[test]
fn the_lattice_is_closed() {
    let edges: usize = nodes().map(|row| row.children().count()).sum();
    assert_eq!((nodes().count(), edges), (9, 13));
    let names = |rows: Vec<&Row>| rows.iter().map(|row| row.name).collect::<BTreeSet<_>>();
    let of = |name| Row::named(name).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(names(of("ggx").parents().collect()), BTreeSet::from(["student"]));
    assert_eq!(names(of("beckmann").parents().collect()), BTreeSet::from(["student", "gnd", "snd"]));
    assert_eq!(names(of("std").children().collect()), BTreeSet::from(["student", "snd"]));
    assert_eq!(of("sgtd").parents().count(), 0);
    for row in nodes() {
        assert!(row.includes(row));
        assert!(row.children().all(|below| below.parents().any(|above| above == row)));
    }
    for case in LIST {
        let lowest = Node::lowest(&case.shape());
        for row in nodes() {
            assert_eq!(row.allows(&lowest.shape), row.includes(lowest.row), "{case:?} {}", row.name);
        }
    }
}

/// A parent's formula meets the child's as its free parameter nears the value that the child fixes.
#[test]
fn a_parent_tends_to_its_child() {
    // the member of a row at 0.3 whose free parameters are so near to those of GGX
    let member = |row: &Row, near: f64| {
        let free = |gamma, p, lambda| row.shape(gamma, p, lambda, None).is_ok();
        let gamma = Some(2.0 + near).filter(|&gamma| free(Some(gamma), None, None));
        let p = Some(1.0 + near).filter(|&p| free(None, Some(p), None));
        let lambda = Some(near).filter(|&lambda| free(None, None, Some(lambda)));
        row.shape(gamma, p, lambda, Some(0.3)).unwrap_or_else(|error| panic!("{error}"))
    };
    for row in nodes() {
        let at = SkewedT::new(member(row, 0.0));
        for near in [1e-4, 1e-7, 1e-10] {
            let beside = SkewedT::new(member(row, near));
            for x in [0.0, 0.1, 0.3, 1.0, 3.0] {
                let (a, b) = (beside.normalization() * beside.f(x), at.normalization() * at.f(x));
                assert!((a / b - 1.0).abs() < 60.0 * near, "{} {near} at {x}: {a} {b}", row.name);
            }
        }
    }
}

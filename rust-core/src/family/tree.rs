//! The tree of special cases: at which node a shape runs, whatever the row is called that it was written as.
//!
//! Nodes are the rows of [`ROWS`] at its own scale (so not `hyper_cauchy`, which is Student's at another roughness). A node lies
//! below another if it fixes the same parameters and more:
//!
//! | node | below it |
//! |---|---|
//! | `sgtd` | `gtd` (λ = 0), `std` (p = 1), `sgnd` (γ = ∞) |
//! | `gtd` | `student` (p = 1), `gnd` (γ = ∞) |
//! | `std` | `student` (λ = 0), `snd` (γ = ∞) |
//! | `sgnd` | `gnd` (λ = 0), `snd` (p = 1) |
//! | `student` | `ggx` (γ = 2), `beckmann` (γ = ∞) |
//! | `gnd`, `snd` | `beckmann` (p = 1, λ = 0) |
//!
//! Source: Ribardière et al. 2019, Figure 1 and Table 1.
//!
//! ```
//! use sgtd_core::family::shape::Shape;
//! use sgtd_core::family::tree::Node;
//!
//! // a skew without a shift is a roughness, and the rest is GGX
//! let node = Node::lowest(&Shape::new(2.0, 1.0, 0.5, 0.0)?);
//! assert_eq!((node.row.name, node.alpha_scale), ("ggx", 1.5));
//! # Ok::<(), sgtd_core::error::ParameterError>(())
//! ```

use crate::family::shape::{INFINITE_GAMMA, ROWS, Row, Shape};

/// A shape with everything taken out of it that another node says with fewer parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// The lowest row that allows the shape.
    pub row: &'static Row,
    /// The shape as that row has it.
    pub shape: Shape,
    /// Factor on every roughness, which makes up for a skew that was none.
    pub alpha_scale: f64,
}

/// The nodes, from the root downwards.
pub fn nodes() -> impl Iterator<Item = &'static Row> {
    ROWS.iter().filter(|row| row.name != "hyper_cauchy")
}

impl Node {
    /// The lowest node that allows a shape: every parameter counts by its value, not by the row that it was given with.
    ///
    /// Without a shift there is no inner side: `f(x) = g(x/(1+λ))` is the same profile without skew at a roughness of `1 + λ`
    /// times as much. A γ from 10²⁵ on is infinite to every digit.
    ///
    /// D and Λ of the node at the scaled roughness are those of the shape (test `a_node_is_the_shape_it_stands_for`).
    pub fn lowest(shape: &Shape) -> Self {
        let skew = if shape.shift() == 0.0 { 0.0 } else { shape.lambda() };
        let gamma = if shape.gamma() < INFINITE_GAMMA { shape.gamma() } else { f64::INFINITY };
        let reduced = shape.with(gamma, skew);
        let row = nodes().filter(|row| row.allows(&reduced)).min_by_key(|row| row.freedom()).unwrap_or(&ROWS[0]);
        let alpha_scale = if skew == shape.lambda() { 1.0 } else { 1.0 + shape.lambda() };
        Self { row, shape: reduced, alpha_scale }
    }

    /// Is it GGX without shift: the one node where D, masking and the drawing of visible normals are all closed forms?
    ///
    /// Beckmann's masking needs erfc, and its visible normals an inverse that has none.
    pub fn is_closed_form(&self) -> bool {
        self.row.name == "ggx" && self.shape.shift() == 0.0
    }
}

impl Row {
    /// The nodes that have one parameter more.
    pub fn parents(&'static self) -> impl Iterator<Item = &'static Row> {
        nodes().filter(|above| above.freedom() == self.freedom() + 1 && above.includes(self))
    }

    /// The nodes that have one parameter less.
    pub fn children(&'static self) -> impl Iterator<Item = &'static Row> {
        nodes().filter(|below| below.freedom() + 1 == self.freedom() && self.includes(below))
    }
}

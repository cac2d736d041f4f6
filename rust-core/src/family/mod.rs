//! The SGTD family: its parameters and rows, the tree of special cases, and its profile in closed form.

mod derivatives;
#[doc(hidden)]
pub mod partial_moment;
pub mod shape;
pub mod skewed_t;
#[doc(hidden)]
pub mod student;
pub mod tree;

//! Drawing visible normals: the radius from a table, the azimuth from an equation.

pub mod azimuth;
pub mod bounded;
pub(crate) mod coordinate;
pub mod visible_table;

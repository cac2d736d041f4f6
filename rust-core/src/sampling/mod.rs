//! Drawing visible normals: the radius from a table, the azimuth from an equation.

pub mod azimuth;
pub mod bounded;
pub mod visible_table;

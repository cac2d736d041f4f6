//! Hermite's cubics: values and slopes at both ends of a cell.

/// The coefficients, the constant first, of the cubic in the distance from the left end that has the given (value, slope) at
/// both ends.
pub(crate) fn cubic([y0, s0]: [f64; 2], [y1, s1]: [f64; 2], width: f64) -> [f64; 4] {
    let chord = (y1 - y0) / width;
    [y0, s0, (3.0 * chord - 2.0 * s0 - s1) / width, (s0 + s1 - 2.0 * chord) / (width * width)]
}

/// A cubic at the distance `d`.
#[inline]
pub(crate) fn value([c0, c1, c2, c3]: [f64; 4], d: f64) -> f64 {
    d.mul_add(d.mul_add(d.mul_add(c3, c2), c1), c0)
}

/// By how much the (value, slope times width) at both ends count at the share t of a cell.
pub(crate) fn weights(t: f64) -> [[f64; 2]; 2] {
    let rest = 1.0 - t;
    [[rest * rest * (1.0 + 2.0 * t), t * rest * rest], [t * t * (1.0 + 2.0 * rest), -t * t * rest]]
}

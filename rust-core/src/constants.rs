//! Numbers that traced code has to share with the core: `build.rs` writes them into the C++ header `sgtd_constants.h`.
//!
//! Nothing is imported here, because the build script reads this file as well. The rooms export the numbers that are theirs.

/// Mitsuba's renderers take a lower roughness as this one.
pub const LEAST_ALPHA: f64 = 1e-4;
/// What a material asks for if nothing is said: the permitted relative error of G1.
pub const DEFAULT_ACCURACY: f64 = 1e-5;

/// Entries in front of a masking table: one for each exponent of single precision.
pub const MASKING_ENTRIES: usize = 256;

/// Cells in y of the table of visible normals.
pub const CELLS: usize = 64;
/// Its rows in a/(a + b), one for each view that is tabulated.
pub const VIEW_ROWS: usize = 15;
/// Values of it that are compared at a time: every eighth knot selects a block of eight.
pub const BLOCK: usize = 8;
/// Masses are counted from above in single precision, so that a share below this would be made of few numbers: a ring that lies beyond the horizon
/// as a whole.
pub const LEAST_SHARE: f64 = 1.0 / 256.0;

/// By how much the disc of the azimuths is enlarged. A smaller disc makes densities of single precision uncertain (1e-7 divided by this), a
/// larger one draws in vain (about this share).
pub const HORIZON_MARGIN: f64 = 1.0 / 512.0;

/// Fits of the azimuth's start, for b ≤ c and b > c: three for the share of the first two limits, three for the angle.
pub const AZIMUTH_FITS: [[f64; 6]; 2] =
    [[-0.5565, 0.6426, -1.3483, 0.0237, -0.0115, -0.0108], [-0.0062, -0.3535, -0.0915, 0.0235, 0.0006, 0.0247]];
/// The c, in units of c + b, beyond which the bounded azimuth ends below π at every radius.
pub const AZIMUTH_STEEP: f64 = 2.0 / 3.0;
/// q of the bounded azimuth's start beyond it, by powers of 1 − c.
pub const AZIMUTH_STEEP_FIT: [f64; 3] = [0.0389, 0.0958, 1.2201];
/// And below it, by powers of c.
pub const AZIMUTH_FLAT_FIT: [f64; 2] = [0.0822, -0.2256];

/// Nodes of the average missing energy over the roughness.
pub const AVERAGE: usize = 512;
/// Numbers at every node of a table of missing energy.
pub const PACKET: usize = 4;

/// Octaves of a table of a rough interface, by the distance of a cosine from 0, 1 and that of total reflection: what is nearer than 2^-14 is as there.
pub const INTERFACE_OCTAVES: usize = 14;
/// Cells of each.
pub const INTERFACE_CELLS: usize = 8;

//! Rays on a periodic surface.
//!
//! A ray is followed from edge to edge of the triangulation. Of each crossing one number is kept, the gap between ray and edge, and it
//! is the same number for the triangles on both sides: a hit is a change of its sign, so no ray slips through an edge. A ray that starts on a
//! triangle leaves it before anything is tested, so nothing is moved off the surface by an epsilon. Blocks of cells that lie below the ray
//! are skipped.

use super::pyramid::Pyramid;
use super::surface::Surface;
use glam::{DVec2, DVec3};

/// The side of the surface that a ray is on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Outside.
    Above,
    /// Inside the material.
    Below,
}

impl Side {
    /// The other one.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::Above => Self::Below,
            Self::Below => Self::Above,
        }
    }

    fn sign(self) -> f64 {
        match self {
            Self::Above => 1.0,
            Self::Below => -1.0,
        }
    }
}

/// A point of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    i: usize,
    j: usize,
    upper: bool,
    /// inside the cell, 0 to 1 along both sides
    within: DVec2,
}

impl Point {
    /// The facet, as counted by [`Surface::slopes`] of a surface that is `nx` points wide.
    pub fn facet(&self, nx: usize) -> usize {
        2 * (self.j * nx + self.i) + usize::from(self.upper)
    }
}

/// Where a ray ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum End {
    /// On a facet.
    Hit(Point),
    /// Away from the surface.
    Away,
    /// Nowhere within ten million crossings.
    Lost,
}

/// Crossings after which a ray is given up; a horizontal ray along a valley has no end.
const MOST_CROSSINGS: u32 = 10_000_000;

/// A surface that rays can be sent to.
pub struct Tracer<'a> {
    surface: &'a Surface,
    pyramid: Pyramid,
}

/// Which edge a ray leaves a triangle by.
#[derive(Clone, Copy)]
enum Edge {
    X,
    Y,
    Diagonal,
}

/// A ray on its way, in units of cells.
struct Flight<'a> {
    tracer: &'a Tracer<'a>,
    sign: f64,
    d: DVec3,
    inverse: DVec2,
    inverse_sum: f64,
    origin: DVec3,
    t: f64,
    i: usize,
    j: usize,
    upper: bool,
    /// distance to the surface at t, upwards for rays above
    gap: f64,
}

impl<'a> Tracer<'a> {
    /// Prepares a surface.
    pub fn new(surface: &'a Surface) -> Self {
        Self { surface, pyramid: Pyramid::new(surface) }
    }

    /// The surface.
    pub fn surface(&self) -> &Surface {
        self.surface
    }

    /// The point that a ray from above, in this direction and evenly distributed over the tile by `at` in [0, 1)², meets first.
    pub fn first(&self, direction: DVec3, at: (f64, f64)) -> End {
        let (nx, ny) = (self.surface.nx(), self.surface.ny());
        let (x, y) = (at.0 * nx as f64, at.1 * ny as f64);
        let (i, j) = ((x as usize).min(nx - 1), (y as usize).min(ny - 1));
        let within = DVec2::new(x - i as f64, y - j as f64);
        let point = Point { i, j, upper: within.x + within.y > 1.0, within };
        let top = f64::from(self.pyramid.all().high);
        Flight::new(self, &point, top, direction, Side::Above).run(false)
    }

    /// The point that a ray which leaves `from` on this side meets next.
    pub fn next(&self, from: &Point, direction: DVec3, side: Side) -> End {
        Flight::new(self, from, self.height(from), direction, side).run(true)
    }

    /// Slopes of the facet that a point is on.
    #[inline]
    pub fn slope(&self, point: &Point) -> DVec2 {
        self.surface.cell_slopes(point.i, point.j)[usize::from(point.upper)]
    }

    /// Height of a point.
    pub fn height(&self, point: &Point) -> f64 {
        let [a, b, c, d] = self.surface.corners(point.i, point.j);
        let DVec2 { x, y } = point.within;
        if point.upper {
            (1.0 - y).mul_add(b - d, (1.0 - x).mul_add(c - d, d))
        } else {
            y.mul_add(c - a, x.mul_add(b - a, a))
        }
    }
}

impl<'a> Flight<'a> {
    fn new(tracer: &'a Tracer<'a>, from: &Point, z: f64, direction: DVec3, side: Side) -> Self {
        let spacing = tracer.surface.spacing();
        let d = DVec3::new(direction.x / spacing.x, direction.y / spacing.y, direction.z);
        let origin = DVec3::new(from.i as f64 + from.within.x, from.j as f64 + from.within.y, z);
        Self {
            tracer,
            sign: side.sign(),
            d,
            inverse: DVec2::new(1.0 / d.x, 1.0 / d.y),
            inverse_sum: 1.0 / (d.x + d.y),
            origin,
            t: 0.0,
            i: from.i,
            j: from.j,
            upper: from.upper,
            gap: (side.sign() * (z - tracer.height(from))).max(0.0),
        }
    }

    fn run(mut self, on_surface: bool) -> End {
        let all = self.tracer.pyramid.all();
        let bound = if self.sign > 0.0 { f64::from(all.high) } else { f64::from(-all.low) };
        let leaves = self.sign * self.d.z >= 0.0;
        // from outside, the whole tile may be out of reach
        let mut level = if on_surface { 0 } else { self.tracer.pyramid.top() };
        if on_surface {
            self.cross(true);
        }
        for _ in 0..MOST_CROSSINGS {
            if leaves && self.sign * self.z(self.t) >= bound {
                return End::Away;
            }
            if let Some(entered) = self.skip(level) {
                // a larger block is worth a look where the ray enters one
                level = entered.min(self.tracer.pyramid.top());
            } else if level > 0 {
                level -= 1;
            } else {
                // the triangles of one cell
                let cell = (self.i, self.j);
                while (self.i, self.j) == cell {
                    if let Some(point) = self.cross(false) {
                        return End::Hit(point);
                    }
                    if !self.t.is_finite() {
                        // straight up
                        return End::Away;
                    }
                }
            }
        }
        End::Lost
    }

    #[inline]
    fn z(&self, t: f64) -> f64 {
        t.mul_add(self.d.z, self.origin.z)
    }

    /// Leaves the block of this level that the ray is in, if nothing of it is in the way; the result is the level to go on with.
    #[inline]
    fn skip(&mut self, level: usize) -> Option<usize> {
        let (nx, ny) = (self.tracer.surface.nx(), self.tracer.surface.ny());
        let (i0, j0) = ((self.i >> level) << level, (self.j >> level) << level);
        let (i1, j1) = ((i0 + (1 << level)).min(nx), (j0 + (1 << level)).min(ny));
        let tx = crossing(if self.d.x > 0.0 { i1 } else { i0 } as f64 - self.origin.x, self.inverse.x);
        let ty = crossing(if self.d.y > 0.0 { j1 } else { j0 } as f64 - self.origin.y, self.inverse.y);
        let end = tx.min(ty).max(self.t);
        let bounds = self.tracer.pyramid.bounds(level, self.i, self.j);
        let bound = if self.sign > 0.0 { f64::from(bounds.high) } else { f64::from(-bounds.low) };
        let least = if self.sign * self.d.z < 0.0 { end } else { self.t };
        // straight down, `end` is infinite and so is what is left of the height
        if !(self.sign * self.z(least) > bound) || !end.is_finite() {
            return None;
        }
        self.t = end;
        let (edge, entered) = if tx <= ty {
            let y = end.mul_add(self.d.y, self.origin.y);
            self.j = (y.max(0.0) as usize).clamp(j0, j1 - 1);
            self.enter_x(if self.d.x > 0.0 { i1 - 1 } else { i0 });
            (Edge::X, if self.d.x > 0.0 { self.i } else { self.i + 1 })
        } else {
            let x = end.mul_add(self.d.x, self.origin.x);
            self.i = (x.max(0.0) as usize).clamp(i0, i1 - 1);
            self.enter_y(if self.d.y > 0.0 { j1 - 1 } else { j0 });
            (Edge::Y, if self.d.y > 0.0 { self.j } else { self.j + 1 })
        };
        // the edge that was crossed is that of the triangle just entered
        self.gap = (self.sign * (self.z(end) - self.edge_height(edge, end))).max(0.0);
        Some(if entered >> level & 1 == 0 { level + 1 } else { level })
    }

    /// Leaves the triangle, or hits it if it is to be tested. Beyond the last triangle of a straight ray t is infinite.
    #[inline]
    fn cross(&mut self, starts: bool) -> Option<Point> {
        let (i, j) = (self.i as f64 - self.origin.x, self.j as f64 - self.origin.y);
        let (dx, dy) = (self.d.x, self.d.y);
        // towards the legs of a lower triangle on the left and below, of an upper one on the right and above
        let (far, legs) = if self.upper { (1.0, (dx > 0.0, dy > 0.0)) } else { (0.0, (dx < 0.0, dy < 0.0)) };
        let tx = if legs.0 { (i + far) * self.inverse.x } else { f64::INFINITY };
        let ty = if legs.1 { (j + far) * self.inverse.y } else { f64::INFINITY };
        let towards = if self.upper { dx + dy < 0.0 } else { dx + dy > 0.0 };
        let tk = if towards { (i + j + 1.0) * self.inverse_sum } else { f64::INFINITY };
        let (edge, end) = if tk <= tx && tk <= ty {
            (Edge::Diagonal, tk)
        } else if tx <= ty {
            (Edge::X, tx)
        } else {
            (Edge::Y, ty)
        };
        let end = end.max(self.t);
        if !end.is_finite() {
            let falls = self.sign * self.d.z < 0.0 && !starts;
            let t = if falls { self.t + self.gap / self.d.z.abs() } else { f64::INFINITY };
            let point = falls.then(|| self.point(t));
            self.t = t;
            return point;
        }
        let gap = self.sign * (self.z(end) - self.edge_height(edge, end));
        if gap < 0.0 && !starts {
            let t = (end - self.t).mul_add(self.gap / (self.gap - gap), self.t);
            return Some(self.point(t));
        }
        self.gap = gap.max(0.0);
        self.t = end;
        match edge {
            Edge::Diagonal => self.upper = !self.upper,
            Edge::X => self.enter_x(self.i),
            Edge::Y => self.enter_y(self.j),
        }
        None
    }

    /// Height of an edge of the triangle where the ray is at t.
    #[inline]
    fn edge_height(&self, edge: Edge, t: f64) -> f64 {
        let along = |origin: f64, d: f64, first: usize| (t.mul_add(d, origin) - first as f64).clamp(0.0, 1.0);
        let x = || along(self.origin.x, self.d.x, self.i);
        let y = || along(self.origin.y, self.d.y, self.j);
        let (from, to, share) = match (edge, self.upper) {
            (Edge::X, false) => ((0, 0), (0, 1), y()),
            (Edge::X, true) => ((1, 0), (1, 1), y()),
            (Edge::Y, false) => ((0, 0), (1, 0), x()),
            (Edge::Y, true) => ((0, 1), (1, 1), x()),
            (Edge::Diagonal, _) => ((1, 0), (0, 1), y()),
        };
        let [from, to] = [from, to].map(|(right, above)| self.tracer.surface.corner(self.i + right, self.j + above));
        share.mul_add(to - from, from)
    }

    /// The point of the triangle at t.
    fn point(&self, t: f64) -> Point {
        let at = |origin: f64, d: f64, first: usize| (t.mul_add(d, origin) - first as f64).clamp(0.0, 1.0);
        let within = DVec2::new(at(self.origin.x, self.d.x, self.i), at(self.origin.y, self.d.y, self.j));
        Point { i: self.i, j: self.j, upper: self.upper, within }
    }

    /// Into the cell beside column `i`, in the direction of the ray; a tile has no end.
    #[inline]
    fn enter_x(&mut self, i: usize) {
        let nx = self.tracer.surface.nx();
        if self.d.x > 0.0 {
            self.upper = false;
            self.i = i + 1;
            if self.i == nx {
                self.i = 0;
                self.origin.x -= nx as f64;
            }
        } else {
            self.upper = true;
            if i == 0 {
                self.i = nx - 1;
                self.origin.x += nx as f64;
            } else {
                self.i = i - 1;
            }
        }
    }

    /// The same along y.
    #[inline]
    fn enter_y(&mut self, j: usize) {
        let ny = self.tracer.surface.ny();
        if self.d.y > 0.0 {
            self.upper = false;
            self.j = j + 1;
            if self.j == ny {
                self.j = 0;
                self.origin.y -= ny as f64;
            }
        } else {
            self.upper = true;
            if j == 0 {
                self.j = ny - 1;
                self.origin.y += ny as f64;
            } else {
                self.j = j - 1;
            }
        }
    }
}

/// When a distance has been covered; never, where nothing is covered.
#[inline]
fn crossing(distance: f64, inverse: f64) -> f64 {
    if inverse.is_finite() { distance * inverse } else { f64::INFINITY }
}

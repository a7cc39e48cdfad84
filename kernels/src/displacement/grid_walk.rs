//! The grid walk of Smits, Shirley and Stark, "Direct Ray Tracing of Displacement Mapped Triangles", Rendering
//! Techniques 2000: from cell to cell along the ray's path through the prism over a base triangle.
//!
//! # The path
//! Over the point w (barycentric) of the base triangle stands the line p(w) + g n(w). The ray o + t v meets it where
//! the *flag* f(w) = (v x n(w)) . (o - p(w)) vanishes; its sign says on which side of the ray the line stands.
//! p and n are linear in w, so f is a quadratic form w^T Q w: the path is a conic, and a straight line where the
//! three normals are parallel. A cell is left across the edge whose end vertices, counter-clockwise, have the
//! signs (-, +).
//!
//! # Where it is exact
//! A ray that hits the micro-triangle over a cell with barycentrics b_i satisfies
//!   sum_i b_i f_i = sum_{i<j} b_i b_j [ -det(v, n_j - n_i, p_j - p_i) + (g_j - g_i) det(v, n_i, n_j) ],
//! so that some flag of the cell is above -e and some below e, where e is a third of the greatest bracket (`Conic`
//! bounds it) plus rounding. Cells that satisfy this are *candidates*. Where normals are parallel the bracket is
//! zero, and the walk, which visits every cell with mixed signs, finds every hit. Where they are not, the path can
//! cross a grid line twice between two equal signs, and a micro-triangle can lean out of its cell's column. The walk
//! sees that coming: such a thing happens across an edge only where a flag at its ends is within a quarter of the
//! edge's bracket of zero, across a vertex only where its flag is within a third. Then, and where signs are within
//! rounding of zero (a ray through a micro-vertex, along a grid line, along the normal), and where the steps' cap is
//! met, it gives up and scans every candidate of the prism row by row. Scans and cap hits are
//! counted. One assumption is not proven: that lifts beyond a cell's vertices differ by at most twice what they do in
//! it. Tests against brute force bound what it costs.
//!
//! Deviations from the paper: the flags come from Q instead of a cross product a step; the exit edge follows from
//! the three signs alone, [`LastChange`](super::cell::LastChange) being the result, not the guide; all entries into
//! the prism are walked, nearest first; one cell before a cap's entry and one after a hit or exit is tested too.

use crate::barycentric::grid_point;
use crate::bilinear_patch::{BilinearPatch, PatchHit};
use crate::counters::Counts;
use crate::displacement::cell::Cell;
use crate::displacement::surface::{BaseTriangle, HeightField, MicroVertex};
use crate::hit::Hit;
use crate::math::{UNIT_ROUNDOFF, cross, dot, max_abs, sum_abs};
use crate::ray::TraversalRay;
use glam::{Vec3, Vec4};

/// The nearer of `nearest` and the ray's hit on the micro-triangles of `base`, found by walking the grid.
#[inline]
pub fn intersect(
    field: &HeightField<'_>,
    base: &BaseTriangle,
    ray: &TraversalRay,
    nearest: Hit,
    counts: &mut Counts,
) -> Hit {
    counts.prisms += 1;
    let conic = Conic::new(field, base, ray);
    let entries = Entries::find(&conic, base, ray);
    let mut found = nearest;
    let mut doubtful = entries.doubtful || conic.folds(base);
    let mut walked = f32::NEG_INFINITY;
    let mut rounds = 0;
    while !doubtful && rounds < MAX_EVENTS {
        let entry = entries.next_after(walked);
        if entry.is_some() && conic.t_origin + entry.t - conic.reach <= found.t {
            walked = entry.t;
            let exit = entries.exit_after(entry.t);
            // An interval wholly behind the ray's origin is left out, with room for a leaning micro-triangle.
            if conic.t_origin + exit.t + conic.reach >= 0.0 {
                let walk = walk(&conic, field, base, ray, entry, exit.cell, found, counts);
                found = walk.nearest;
                doubtful = walk.doubtful;
            }
            rounds += 1;
        } else {
            rounds = MAX_EVENTS;
        }
    }
    if doubtful { conic.scan(field, base, ray, nearest, counts) } else { found }
}

/// A line meets each cap once and each wall twice at most.
const MAX_EVENTS: u32 = 8;
/// [`Event::cell`] of an exit through a wall.
const NO_CELL: u32 = u32::MAX;

/// The flag as a quadratic form over the triangle, and bounds on what it does not see.
#[derive(Clone, Copy)]
struct Conic {
    /// Q's diagonal.
    q_diagonal: Vec3,
    /// Q_12, Q_20, Q_01: the entry of index e belongs to edge e.
    q_mixed: Vec3,
    /// Per edge direction: |det(v, dn, dp)| over a micro-edge.
    bend: Vec3,
    /// Per edge direction: bound on |det(v, n_i, n_j)| over a micro-edge.
    twist: Vec3,
    /// Bound on the bracket of any micro-edge in the prism.
    bracket: f32,
    /// +1 where the stored vertices are counter-clockwise seen along the normals, else -1.
    orientation: f32,
    /// Bound on a flag's rounding error.
    rounding: f32,
    /// The ray's point nearest to the triangle's centroid: where the geometry is computed from.
    origin: Vec3,
    /// Its distance along the ray.
    t_origin: f32,
    /// Bound on what rounding moves a point of the surface by, relative to the ray.
    shift: f32,
    /// How far a micro-triangle reaches beyond the path's stay in its column: at most a cell.
    reach: f32,
    /// Ends of the lift's range, a little beyond what the surface reaches.
    lift_min: f32,
    /// See `lift_min`.
    lift_max: f32,
    /// No bound on lifts is proven.
    wild: bool,
    /// N.
    n: u32,
}

impl Conic {
    #[inline]
    fn new(field: &HeightField<'_>, base: &BaseTriangle, ray: &TraversalRay) -> Self {
        let n = field.subdivisions;
        let v = ray.direction;
        // Normals that spread over a third of the sphere have no proven length: any lift is possible then, the prism
        // counts as folded, and its scan takes every cell.
        let shortest = base.shortest_normal();
        let wild = shortest == 0.0;
        let (low, high) = base.lift_range(field, if wild { 1.0 } else { shortest });

        // Move the origin along the ray to the prism, so that differences are of the prism's size.
        let centroid = (base.p0 + base.p1 + base.p2) * (1.0 / 3.0);
        let t_origin = dot(centroid - ray.origin, v);
        let origin = ray.origin + v * t_origin;
        let extent = max_abs(base.p1 - base.p0) + max_abs(base.p2 - base.p0) + low.abs().max(high.abs());

        // Q_il = (v x n_i) . (o - p_l), symmetrised.
        let (m0, m1, m2) = (cross(v, base.n0), cross(v, base.n1), cross(v, base.n2));
        let (r0, r1, r2) = (origin - base.p0, origin - base.p1, origin - base.p2);
        let facing = cross(base.p1 - base.p0, base.p2 - base.p0).dot(base.n0 + base.n1 + base.n2);
        let orientation = if facing < 0.0 { -1.0 } else { 1.0 };
        let q_diagonal = Vec3::new(dot(m0, r0), dot(m1, r1), dot(m2, r2)) * orientation;
        let q_mixed =
            Vec3::new(dot(m1, r2) + dot(m2, r1), dot(m2, r0) + dot(m0, r2), dot(m0, r1) + dot(m1, r0))
                * (0.5 * orientation);

        // What bends the path and leans micro-edges out of their walls, per micro-edge of each direction.
        let per_edge = 1.0 / n as f32;
        let (d0, d1, d2) = (base.n2 - base.n1, base.n0 - base.n2, base.n1 - base.n0);
        let bend = Vec3::new(
            dot(v, cross(d0, base.p2 - base.p1)),
            dot(v, cross(d1, base.p0 - base.p2)),
            dot(v, cross(d2, base.p1 - base.p0)),
        )
        .abs()
            * (per_edge * per_edge);
        let twist = greatest_dots([m0, m1, m2], [d0, d1, d2]) * per_edge;

        // What rounding moves a micro-vertex by, relative to the ray: interpolation (3 fused operations on weights that
        // Vulkan's division leaves off by 3 u) and lift, 8 u of the largest coordinate; translation, shear and its
        // division in the triangle test, 6 u of the distance; the moved origin, 2 u of itself.
        let coordinate = max_abs(base.p0).max(max_abs(base.p1)).max(max_abs(base.p2)) + extent;
        let shift =
            UNIT_ROUNDOFF * (8.0 * coordinate + 6.0 * (t_origin.abs() + extent) + 2.0 * max_abs(origin));
        // A flag is m . (o - p): off by |m| times that shift, by 16 roundings of its own, and by the triangle test's
        // direction, whose shear is off by 4 u.
        let steepness = sum_abs(m0).max(sum_abs(m1)).max(sum_abs(m2));
        let offset = max_abs(r0).max(max_abs(r1)).max(max_abs(r2)) + extent;
        let rounding = steepness * (shift + 16.0 * UNIT_ROUNDOFF * offset) + 4.0 * UNIT_ROUNDOFF * offset;

        let margin = 1e-3 * (high - low) + shift;
        let (lift_min, lift_max) = (low - margin, high + margin);
        Conic {
            q_diagonal,
            q_mixed,
            bend,
            twist,
            bracket: bend.max_element() + (lift_max - lift_min) * twist.max_element(),
            orientation,
            rounding,
            origin,
            t_origin,
            shift,
            reach: extent * per_edge + shift,
            lift_min,
            lift_max,
            wild,
            n,
        }
    }

    /// The flag at barycentric coordinates `w`.
    #[inline]
    fn flag(&self, w: Vec3) -> f32 {
        let mixed = Vec3::new(w.y * w.z, w.z * w.x, w.x * w.y);
        dot(self.q_diagonal, w * w) + 2.0 * dot(self.q_mixed, mixed)
    }

    /// The flag at grid point (j, k).
    #[inline]
    fn grid_flag(&self, j: u32, k: u32) -> f32 {
        self.flag(grid_point(j, k, self.n))
    }

    /// The flags at the vertices of a cell.
    #[inline]
    fn cell_flags(&self, cell: Cell) -> Vec3 {
        let (j0, k0) = cell.vertex(0);
        let (j1, k1) = cell.vertex(1);
        let (j2, k2) = cell.vertex(2);
        Vec3::new(self.grid_flag(j0, k0), self.grid_flag(j1, k1), self.grid_flag(j2, k2))
    }

    /// Half-width of the band of flags that are near zero for a micro-edge of direction `e` whose lifts differ by
    /// `lift_difference`: outside it the path does not cross the edge twice, nor does the edge lean across it.
    #[inline]
    fn doubt(&self, e: u32, lift_difference: f32) -> f32 {
        0.25 * (component(self.bend, e) + lift_difference.abs() * component(self.twist, e)) + self.rounding
    }

    /// The bracket of micro-edges near a cell whose lifts differ by `lift_difference`: twice that is assumed of its
    /// neighbours, at most the prism's.
    #[inline]
    fn bracket_nearby(&self, lift_difference: f32) -> f32 {
        (self.bend.max_element() + 2.0 * lift_difference * self.twist.max_element()).min(self.bracket)
    }

    /// Whether the ray can hit the cell that lies across a vertex from one on the path, having no edge in common with
    /// it. `at_vertex`, `a`, `b`: the flags of the cell on the path; `bracket`: bound on the other cell's.
    ///
    /// The other cell is the reflection of this one in the vertex, so its flags are 2 f - a and 2 f - b to within twice
    /// the bend. In the identity above, with all three of one sign, sum b_i f_i is at least the share of the two far
    /// vertices times their flags, and at most that share times the bracket: no hit where both are beyond it, nor
    /// where the vertex itself is beyond a third of it. With mixed signs the path itself comes to that cell.
    #[inline]
    fn opposite_cell_in_reach(&self, bracket: f32, at_vertex: f32, a: f32, b: f32) -> bool {
        let sign = if at_vertex < 0.0 { -1.0 } else { 1.0 };
        let nearest_far = (2.0 * at_vertex * sign - a * sign).min(2.0 * at_vertex * sign - b * sign);
        let error = 2.0 * self.bend.max_element() + self.rounding;
        at_vertex.abs() <= bracket * (1.0 / 3.0) + self.rounding
            && nearest_far >= -error
            && nearest_far <= bracket + error
    }

    /// Whether columns over the triangle may overlap within the prism, so that signs no longer tell left from right.
    ///
    /// The Jacobian of (w, g) -> p(w) + g n(w) is (e1(g) x e2(g)) . n(w), e1 and e2 the edges at lift g: linear in w,
    /// quadratic in g. It is positive throughout where its three Bernstein coefficients over the lift's range are,
    /// at each corner.
    #[inline]
    fn folds(&self, base: &BaseTriangle) -> bool {
        let (p1, p2) = (base.p1 - base.p0, base.p2 - base.p0);
        let (d1, d2) = (base.n1 - base.n0, base.n2 - base.n0);
        let (low1, low2) = (p1 + d1 * self.lift_min, p2 + d2 * self.lift_min);
        let (high1, high2) = (p1 + d1 * self.lift_max, p2 + d2 * self.lift_max);
        let ends = self
            .least_along_normals(base, cross(low1, low2))
            .min(self.least_along_normals(base, cross(high1, high2)));
        let middle = self.least_along_normals(base, cross(low1, high2) + cross(high1, low2));
        self.wild || !(ends.min(middle) > 0.0)
    }

    #[inline]
    fn least_along_normals(&self, base: &BaseTriangle, area: Vec3) -> f32 {
        let area = area * self.orientation;
        area.dot(base.n0).min(area.dot(base.n1)).min(area.dot(base.n2))
    }

    /// The nearer of `nearest` and the hits on every candidate cell of the prism, row by row: O(N) rows and what
    /// lies on the path. On a row the flag is a quadratic, so its band around zero is at most two intervals. Where the
    /// ray runs along the normals flags are near zero everywhere; there [`Slabs`] say which cells it can meet.
    fn scan(
        &self,
        field: &HeightField<'_>,
        base: &BaseTriangle,
        ray: &TraversalRay,
        nearest: Hit,
        counts: &mut Counts,
    ) -> Hit {
        counts.scans += 1;
        let widest = self.bend.max_element() + (self.lift_max - self.lift_min) * self.twist.max_element();
        let band = if self.wild { f32::INFINITY } else { widest * (1.0 / 3.0) + self.rounding };
        let slabs = Slabs::new(self, base, ray);
        let mut nearest = nearest;
        let mut j = 0;
        while j < self.n {
            // The cells of a strip in a row: lower and upper by turns.
            let end = self.n - j;
            let reached = slabs.reach(
                grid_point(j, 0, self.n),
                grid_point(j, end, self.n),
                grid_point(j + 1, 0, self.n),
                grid_point(j + 1, end - 1, self.n),
            );
            let (first, last) = if reached { self.candidates_of_strip(j, band) } else { (self.n, 0) };
            let mut i = 2 * first;
            while i <= (2 * last + 1).min(2 * (self.n - 1 - j)) {
                let cell = Cell { j, k: i >> 1, upper: i & 1 != 0 };
                if self.is_candidate(cell, band) && slabs.reach_cell(cell, self.n) {
                    let [a, b, c] = base.micro_triangle(field, cell);
                    nearest = base.intersect_cell(ray, cell, a.position, b.position, c.position, nearest);
                    counts.triangles += 1;
                }
                i += 1;
            }
            j += 1;
        }
        nearest
    }

    /// Whether the flags of a cell are neither all above `band` nor all below `-band`.
    #[inline]
    fn is_candidate(&self, cell: Cell, band: f32) -> bool {
        let flags = self.cell_flags(cell);
        !(flags.min_element() > band || flags.max_element() < -band)
    }

    /// First and last k of the cells between rows j and j + 1 that can be candidates; first > last where none can.
    #[inline]
    fn candidates_of_strip(&self, j: u32, band: f32) -> (u32, u32) {
        let n = self.n as f32;
        let mut range = Range { min: f32::INFINITY, max: f32::NEG_INFINITY };
        let mut row = j;
        while row <= j + 1 {
            // f on the row, as a polynomial in gamma, from its ends and its middle (Bernstein coefficients).
            let beta = row as f32 / n;
            let length = 1.0 - beta;
            let start = self.flag(Vec3::new(length, beta, 0.0));
            let end = self.flag(Vec3::new(0.0, beta, length));
            let middle = self.flag(Vec3::new(0.5 * length, beta, 0.5 * length));
            let control = 2.0 * middle - 0.5 * (start + end);
            range = range.with_roots(start - band, control - band, end - band, length);
            range = range.with_roots(start + band, control + band, end + band, length);
            if start.abs() <= band {
                range = range.with(0.0);
            }
            if end.abs() <= band {
                range = range.with(length);
            }
            row += 1;
        }
        // The path can also come and go through the strip's two ends.
        let last = self.n - 1 - j;
        if crosses(self.grid_flag(j, 0), self.grid_flag(j + 1, 0), band) {
            range = range.with(0.0);
        }
        if crosses(self.grid_flag(j, last + 1), self.grid_flag(j + 1, last), band) {
            range = range.with(1.0);
        }
        if range.min > range.max {
            return (self.n, 0);
        }
        // One cell more on either side, for the roots' rounding.
        let first = (range.min * n - 2.0).max(0.0) as u32;
        let end = ((range.max * n + 1.0).max(0.0) as u32).min(last);
        (first, end)
    }
}

/// Distances from two planes through the ray, of the prism's six corners: a micro-triangle whose hull lies on one side
/// of either is not met. Sharp where flags are blunt, for rays along the normals: the two ends of a column then
/// have nearly the same distance.
struct Slabs {
    /// From the first plane, at the lower and at the upper cap.
    first: (Vec3, Vec3),
    /// From the second plane, perpendicular to the first.
    second: (Vec3, Vec3),
    /// What rounding can move a distance by.
    margin: f32,
}

impl Slabs {
    #[inline]
    fn new(conic: &Conic, base: &BaseTriangle, ray: &TraversalRay) -> Self {
        let (a, b) = ray.direction.any_orthonormal_pair();
        let at = |lift: f32, plane: Vec3| {
            let distance = |p: Vec3, n: Vec3| (p - conic.origin + n * lift).dot(plane);
            Vec3::new(distance(base.p0, base.n0), distance(base.p1, base.n1), distance(base.p2, base.n2))
        };
        let (low, high) = (conic.lift_min, conic.lift_max);
        let slabs =
            Slabs { first: (at(low, a), at(high, a)), second: (at(low, b), at(high, b)), margin: 0.0 };
        // Positions are off by `shift` in each coordinate, distances by 8 roundings of their own size and by the
        // rounded planes' 4 u. Without a bound on lifts nothing is excluded.
        let size = max_abs(slabs.first.0)
            .max(max_abs(slabs.first.1))
            .max(max_abs(slabs.second.0))
            .max(max_abs(slabs.second.1));
        let margin = 2.0 * conic.shift + 16.0 * UNIT_ROUNDOFF * size;
        Slabs { margin: if conic.wild { f32::INFINITY } else { margin }, ..slabs }
    }

    /// Whether the ray can meet the hull of what stands over four points.
    #[inline]
    fn reach(&self, w0: Vec3, w1: Vec3, w2: Vec3, w3: Vec3) -> bool {
        self.straddle(self.first, w0, w1, w2, w3) && self.straddle(self.second, w0, w1, w2, w3)
    }

    /// Whether the ray can meet the micro-triangle of a cell.
    #[inline]
    fn reach_cell(&self, cell: Cell, n: u32) -> bool {
        let (j0, k0) = cell.vertex(0);
        let (j1, k1) = cell.vertex(1);
        let (j2, k2) = cell.vertex(2);
        let last = grid_point(j2, k2, n);
        self.reach(grid_point(j0, k0, n), grid_point(j1, k1, n), last, last)
    }

    #[inline]
    fn straddle(&self, plane: (Vec3, Vec3), w0: Vec3, w1: Vec3, w2: Vec3, w3: Vec3) -> bool {
        let low = Vec4::new(plane.0.dot(w0), plane.0.dot(w1), plane.0.dot(w2), plane.0.dot(w3));
        let high = Vec4::new(plane.1.dot(w0), plane.1.dot(w1), plane.1.dot(w2), plane.1.dot(w3));
        !(low.min(high).min_element() > self.margin || low.max(high).max_element() < -self.margin)
    }
}

/// Whether the flag can vanish between two neighbours.
#[inline]
fn crosses(a: f32, b: f32, band: f32) -> bool {
    !(a.min(b) > band || a.max(b) < -band)
}

/// An interval of gamma that grows.
#[derive(Clone, Copy)]
struct Range {
    min: f32,
    max: f32,
}

impl Range {
    #[inline]
    fn with(self, x: f32) -> Self {
        Range { min: self.min.min(x), max: self.max.max(x) }
    }

    /// Includes the roots in [0, length] of the quadratic with Bernstein coefficients a, b, c.
    #[inline]
    fn with_roots(self, a: f32, b: f32, c: f32, length: f32) -> Self {
        let (square, linear) = (a - 2.0 * b + c, 2.0 * (b - a));
        let discriminant = crate::math::difference_of_products(linear, linear, 4.0 * square, a);
        if discriminant < 0.0 {
            return self;
        }
        let root = crate::math::sqrt(discriminant);
        let q = -0.5 * (linear + if linear < 0.0 { -root } else { root });
        self.with_root(q / square, length).with_root(a / q, length)
    }

    #[inline]
    fn with_root(self, s: f32, length: f32) -> Self {
        if s >= 0.0 && s <= 1.0 { self.with(s * length) } else { self }
    }
}

/// Where the ray's line enters or leaves the prism.
#[derive(Clone, Copy)]
struct Event {
    /// Distance from [`Conic::origin`]; NaN for none.
    t: f32,
    /// Packed cell, or [`NO_CELL`] for an exit through a wall.
    cell: u32,
    /// Whether the cell before it in the path is inside the grid: an entry through a cap.
    through_cap: bool,
}

impl Event {
    const NONE: Event = Event { t: f32::NAN, cell: NO_CELL, through_cap: false };

    #[inline]
    fn is_some(&self) -> bool {
        !self.t.is_nan()
    }
}

/// All meetings of the line with the prism's boundary.
struct Entries {
    t: [f32; MAX_EVENTS as usize],
    cell: [u32; MAX_EVENTS as usize],
    /// Bit i: event i is an entry.
    entering: u32,
    /// Bit i: event i is on a cap.
    on_cap: u32,
    count: u32,
    /// The line passes too near to a corner's or a wall's tangent to say how it enters.
    doubtful: bool,
}

impl Entries {
    #[inline]
    fn find(conic: &Conic, base: &BaseTriangle, ray: &TraversalRay) -> Self {
        let mut entries = Entries {
            t: [0.0; MAX_EVENTS as usize],
            cell: [0; MAX_EVENTS as usize],
            entering: 0,
            on_cap: 0,
            count: 0,
            doubtful: false,
        };
        entries.add_cap(conic, base, ray, conic.lift_max, conic.orientation);
        entries.add_cap(conic, base, ray, conic.lift_min, -conic.orientation);
        entries.add_wall(conic, ray, 0, base.p1, base.n1, base.p2, base.n2);
        entries.add_wall(conic, ray, 1, base.p2, base.n2, base.p0, base.n0);
        entries.add_wall(conic, ray, 2, base.p0, base.n0, base.p1, base.n1);
        entries
    }

    #[inline]
    fn push(&mut self, t: f32, cell: u32, entering: bool, on_cap: bool) {
        let bit = 1 << self.count;
        self.t[self.count as usize] = t;
        self.cell[self.count as usize] = cell;
        self.entering |= if entering { bit } else { 0 };
        self.on_cap |= if on_cap { bit } else { 0 };
        self.count += 1;
    }

    /// The cap at `lift`, a flat triangle whose barycentric coordinates are those of the base; `outward` is the sign
    /// of its stored order seen from outside the prism.
    #[inline]
    fn add_cap(&mut self, conic: &Conic, base: &BaseTriangle, ray: &TraversalRay, lift: f32, outward: f32) {
        let a = base.p0 + base.n0 * lift;
        let e1 = base.p1 + base.n1 * lift - a;
        let e2 = base.p2 + base.n2 * lift - a;
        let p = cross(ray.direction, e2);
        let det = dot(e1, p);
        if det == 0.0 {
            return;
        }
        let s = conic.origin - a;
        let q = cross(s, e1);
        let (b1, b2) = (dot(s, p) / det, dot(ray.direction, q) / det);
        // Accepted beyond the rim by what rounding can move it: a second entry there costs a short walk, none a hole.
        let size = max_abs(e1).max(max_abs(e2));
        let tolerance = 1e-6 + conic.shift * size / det.abs();
        if b1 >= -tolerance && b2 >= -tolerance && b1 + b2 <= 1.0 + tolerance {
            // A cell that is not known to within its neighbours is no place to start from.
            self.doubtful = self.doubtful || tolerance * conic.n as f32 > 0.5;
            let cell = Cell::containing(b1, b2, conic.n).pack();
            self.push(dot(e2, q) / det, cell, det * outward > 0.0, true);
        }
    }

    /// Wall `e` from vertex a to vertex b (counter-clockwise seen along the normals where the orientation is
    /// positive): the ruled surface over the edge, cut off at the caps.
    #[inline]
    #[expect(clippy::too_many_arguments, reason = "a wall is two vertices, each a point and a direction")]
    fn add_wall(
        &mut self,
        conic: &Conic,
        ray: &TraversalRay,
        e: u32,
        pa: Vec3,
        na: Vec3,
        pb: Vec3,
        nb: Vec3,
    ) {
        // The flag along the edge: fa (1-s)² + 2 fm s (1-s) + fb s².
        let fa = component(conic.q_diagonal, (e + 1) % 3);
        let fb = component(conic.q_diagonal, (e + 2) % 3);
        let fm = component(conic.q_mixed, e);
        let band = conic.doubt(e, conic.lift_max - conic.lift_min);
        let square = fa - 2.0 * fm + fb;
        let extremum = (fa - fm) / square;
        let touches = extremum > 0.0 && extremum < 1.0 && (fa + (fm - fa) * extremum).abs() <= band;
        self.doubtful = self.doubtful || touches || fa.abs() <= band || fb.abs() <= band;
        let patch = BilinearPatch { q00: pa, q10: pb, q01: pa + na, q11: pb + nb };
        let (first, second) = patch.intersect_line(conic.origin, ray.direction);
        let length = max_abs(pb - pa);
        self.add_wall_hit(conic, e, first, fm - fa, square, length);
        self.add_wall_hit(conic, e, second, fm - fa, square, length);
    }

    #[inline]
    fn add_wall_hit(
        &mut self,
        conic: &Conic,
        e: u32,
        hit: PatchHit,
        half_slope: f32,
        square: f32,
        length: f32,
    ) {
        // Half the flag's derivative along the edge, which is also the ray's speed across the wall, per lift, times
        // the edge's length. A ray that runs along the wall within rounding of it may cross it beyond a cap only.
        let crossing = half_slope + square * hit.u;
        let tolerance = conic.shift * length / crossing.abs();
        if !hit.is_some() || hit.v < conic.lift_min - tolerance || hit.v > conic.lift_max + tolerance {
            return;
        }
        if hit.v < conic.lift_min || hit.v > conic.lift_max {
            self.doubtful = true;
            return;
        }
        let last = conic.n - 1;
        let along = ((hit.u * conic.n as f32) as u32).min(last);
        let cell = if e == 0 {
            Cell { j: last - along, k: along, upper: false }
        } else if e == 1 {
            Cell { j: 0, k: last - along, upper: false }
        } else {
            Cell { j: along, k: 0, upper: false }
        };
        // Falling flags, (+, -) counter-clockwise, lead into the prism.
        let entering = crossing < 0.0;
        self.push(hit.t, if entering { cell.pack() } else { NO_CELL }, entering, false);
    }

    /// The first entry after `t`.
    #[inline]
    fn next_after(&self, t: f32) -> Event {
        self.first_after(t, self.entering)
    }

    /// The first exit after `t`; an endless one where rounding lost it.
    #[inline]
    fn exit_after(&self, t: f32) -> Event {
        let exit = self.first_after(t, !self.entering);
        if exit.is_some() { exit } else { Event { t: f32::INFINITY, ..Event::NONE } }
    }

    #[inline]
    fn first_after(&self, t: f32, mask: u32) -> Event {
        let mut first = Event::NONE;
        let mut i = 0;
        while i < self.count {
            let ti = self.t[i as usize];
            if mask >> i & 1 != 0 && ti > t && !(ti >= first.t) {
                first = Event { t: ti, cell: self.cell[i as usize], through_cap: self.on_cap >> i & 1 != 0 };
            }
            i += 1;
        }
        first
    }
}

/// What a walk brought.
struct Walk {
    nearest: Hit,
    /// It met something that signs cannot decide; its result is void.
    doubtful: bool,
}

/// Walks from an entry until the path leaves the grid, the exit's cell or the cell of a hit is passed, or doubt.
#[inline]
#[expect(clippy::too_many_arguments, reason = "a walk needs the prism, the ray and both ends")]
fn walk(
    conic: &Conic,
    field: &HeightField<'_>,
    base: &BaseTriangle,
    ray: &TraversalRay,
    entry: Event,
    exit_cell: u32,
    nearest: Hit,
    counts: &mut Counts,
) -> Walk {
    let n = conic.n;
    let mut cell = Cell::unpack(entry.cell);
    if entry.through_cap {
        // Known to within a cell: start at the one before.
        let back = edge_to_negative(conic.cell_flags(cell));
        if back < 3 && !cell.leaves_grid(cell.change_across(back), n) {
            cell = cell.step(cell.change_across(back));
        }
    }
    let [a, b, c] = base.micro_triangle(field, cell);
    let mut corners = Corners { a, b, c, flags: conic.cell_flags(cell) };

    // A quadratic crosses each of the 3 (N+1) grid lines at most twice, and each step crosses one.
    let cap = 6 * (n + 1);
    let mut found = nearest;
    let mut doubtful = corners.doubtful(conic);
    let mut passed = false;
    let mut going = true;
    let mut steps = 0;
    while going && !doubtful && steps < cap {
        counts.cells += 1;
        counts.triangles += 1;
        let before = found;
        let (a, b, c) = (corners.a.position, corners.b.position, corners.c.position);
        found = base.intersect_cell(ray, cell, a, b, c, found);
        let e = edge_to_negative(-corners.flags);
        let change = cell.change_across(e);
        going = !(passed || cell.leaves_grid(change, n));
        passed = found != before || cell.pack() == exit_cell;
        if going {
            cell = cell.step(change);
            corners = corners.stepped(conic, field, base, cell, e);
            doubtful = corners.doubtful(conic);
        }
        steps += 1;
    }
    let capped = going && steps == cap;
    counts.cap_hits += capped as u32;
    Walk { nearest: found, doubtful: doubtful || capped }
}

/// The vertices of the current cell with their flags.
#[derive(Clone, Copy)]
struct Corners {
    a: MicroVertex,
    b: MicroVertex,
    c: MicroVertex,
    flags: Vec3,
}

impl Corners {
    /// The corners of `cell`, entered across edge `e`: a new vertex at place e, the other two change places.
    #[inline]
    fn stepped(
        self,
        conic: &Conic,
        field: &HeightField<'_>,
        base: &BaseTriangle,
        cell: Cell,
        e: u32,
    ) -> Self {
        let (j, k) = cell.vertex(e);
        let new = base.micro_vertex(field, j, k);
        let flag = conic.grid_flag(j, k);
        let Corners { a, b, c, flags } = self;
        if e == 0 {
            Corners { a: new, b: c, c: b, flags: Vec3::new(flag, flags.z, flags.y) }
        } else if e == 1 {
            Corners { a: c, b: new, c: a, flags: Vec3::new(flags.z, flag, flags.x) }
        } else {
            Corners { a: b, b: a, c: new, flags: Vec3::new(flags.y, flags.x, flag) }
        }
    }

    /// Whether signs cannot decide what the ray can hit here: all are equal, one is within rounding of zero, or a
    /// micro-triangle across the edge of equal signs, or across a vertex, is in reach.
    #[inline]
    fn doubtful(&self, conic: &Conic) -> bool {
        let flags = self.flags;
        let (x, y, z) = (flags.x >= 0.0, flags.y >= 0.0, flags.z >= 0.0);
        let magnitude = flags.abs();
        let lifts =
            Vec3::new(self.b.lift - self.c.lift, self.c.lift - self.a.lift, self.a.lift - self.b.lift);
        // The edge of equal signs lies across the vertex of the odd one.
        let (edge, near) = if y == z {
            (0, magnitude.y.min(magnitude.z))
        } else if x == z {
            (1, magnitude.x.min(magnitude.z))
        } else {
            (2, magnitude.x.min(magnitude.y))
        };
        let bracket = conic.bracket_nearby(max_abs(lifts));
        x == y && y == z
            || magnitude.min_element() <= conic.rounding
            || near <= conic.doubt(edge, component(lifts, edge))
            || conic.opposite_cell_in_reach(bracket, flags.x, flags.y, flags.z)
            || conic.opposite_cell_in_reach(bracket, flags.y, flags.z, flags.x)
            || conic.opposite_cell_in_reach(bracket, flags.z, flags.x, flags.y)
    }
}

/// The edge that, counter-clockwise, goes from a vertex whose flag is not negative to one whose flag is: where the
/// path comes in. With all flags negated, where it goes out: a zero, which counts as positive here and there, is
/// in doubt before it is asked for. 3 where there is none.
#[inline]
fn edge_to_negative(flags: Vec3) -> u32 {
    if flags.y >= 0.0 && flags.z < 0.0 {
        0
    } else if flags.z >= 0.0 && flags.x < 0.0 {
        1
    } else if flags.x >= 0.0 && flags.y < 0.0 {
        2
    } else {
        3
    }
}

/// Component 0, 1 or 2.
#[inline]
fn component(v: Vec3, i: u32) -> f32 {
    if i == 0 {
        v.x
    } else if i == 1 {
        v.y
    } else {
        v.z
    }
}

/// Per direction d_e: the greatest |m_i . d_e|, over the triangle's linear m.
#[inline]
fn greatest_dots(m: [Vec3; 3], d: [Vec3; 3]) -> Vec3 {
    let along = |d: Vec3| dot(m[0], d).abs().max(dot(m[1], d).abs()).max(dot(m[2], d).abs());
    Vec3::new(along(d[0]), along(d[1]), along(d[2]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::displacement::brute_force;
    use crate::displacement::test_prism::{FEATURES, Prism, random_ray};
    use crate::math::tests::Numbers;

    /// Both methods' hits and the walk's counts.
    fn both(prism: &Prism, ray: &TraversalRay) -> (Hit, Hit, Counts) {
        let view = prism.view();
        let field = HeightField::new(&view, FEATURES);
        let mut counts = Counts::default();
        let walked = intersect(&field, &prism.base(), ray, Hit::NONE, &mut counts);
        let exact = brute_force::intersect(&field, &prism.base(), ray, Hit::NONE, &mut Counts::default());
        (walked, exact, counts)
    }

    /// Walks and brute force on `count` prisms with 20 rays each, a fifth aimed at micro-vertices and micro-edges, a
    /// tenth exactly along a normal: those are scanned. `most_scans`: share of prisms that may be.
    fn compare(seed: u32, count: u32, spread: f32, relief: f32, most_scans: f64) {
        let mut numbers = Numbers::new(seed);
        let (mut hits, mut differ, mut total) = (0u64, 0u64, Counts::default());
        let mut first = String::new();
        for _ in 0..count {
            let n = 1 + (numbers.unit() * numbers.unit() * 24.0) as u32;
            let prism = Prism::random(&mut numbers, n, spread, relief);
            for _ in 0..20 {
                let ray = random_ray(&prism, &mut numbers);
                let (walked, exact, counts) = both(&prism, &ray);
                total.prisms += counts.prisms;
                total.scans += counts.scans;
                total.cap_hits += counts.cap_hits;
                hits += u64::from(exact.is_some());
                if walked != exact {
                    if differ == 0 {
                        first = format!("N = {n}\n{walked:?}\n{exact:?}\n{ray:?}\n{:?}", prism.base());
                    }
                    differ += 1;
                }
            }
        }
        assert!(hits > u64::from(count), "the rays are no test: {hits} hits");
        assert_eq!(differ, 0, "first: {first}");
        // A walk that always gave up would be exact too.
        assert!(f64::from(total.scans) < most_scans * f64::from(total.prisms), "{total:?}");
    }

    #[test]
    fn parallel_normals() {
        compare(1, 20_000, 0.0, 0.3, 0.25);
    }

    #[test]
    fn leaning_normals() {
        compare(2, 20_000, 0.3, 0.3, 0.3);
    }

    #[test]
    fn gently_leaning_normals() {
        compare(3, 20_000, 0.05, 0.1, 0.25);
    }

    #[test]
    fn wild_normals() {
        compare(4, 10_000, 1.5, 1.0, 1.0);
    }
}

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
//! # What it misses
//! A ray that hits the micro-triangle over a cell with barycentrics b_i satisfies
//!   sum_i b_i f_i = sum_{i<j} b_i b_j [ -det(v, n_j - n_i, p_j - p_i) + (g_j - g_i) det(v, n_i, n_j) ].
//! Where normals are parallel the bracket is zero, and the walk, which visits every cell with mixed signs, finds every
//! hit, but for signs within rounding of zero: rays through micro-vertices, along grid lines, along the normal. Where
//! they are not, the path can cross a grid line twice between two equal signs, a micro-triangle can lean out of its
//! cell's column, and columns can overlap where normals converge: hits there are missed. So are those on edges that
//! [`Seams`](crate::interface::Seams) displace along other directions. Walks that signs leave without a way on
//! are counted, and so are those that meet their cap on steps; `docs/EXACTNESS.md` has the share of rays that all this
//! costs. The exact method is the [quadtree](super::quadtree).
//!
//! Deviations from the paper: the flags come from Q instead of a cross product a step; the exit edge follows from
//! the three signs alone, [`LastChange`](super::cell::LastChange) being the result, not the guide; all entries into
//! the prism are walked, nearest first; one cell before a cap's entry and one after a hit or exit is tested too.

use crate::barycentric::grid_point;
use crate::bilinear_patch::{BilinearPatch, PatchHit};
use crate::counters::Counts;
use crate::displacement::cell::Cell;
use crate::displacement::surface::{BaseTriangle, HeightField};
use crate::hit::Hit;
use crate::math::{MinMax, UNIT_ROUNDOFF, cross, dot, max_abs};
use crate::ray::TraversalRay;
use glam::Vec3;

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
    let mut walked = f32::NEG_INFINITY;
    let mut rounds = 0;
    while rounds < MAX_EVENTS {
        let entry = entries.next_after(walked);
        if entry.is_some() && conic.t_origin + entry.t - conic.reach <= found.t {
            walked = entry.t;
            let exit = entries.exit_after(entry.t);
            // An interval wholly behind the ray's origin is left out, with room for a leaning micro-triangle.
            if conic.t_origin + exit.t + conic.reach >= 0.0 {
                found = walk(&conic, field, base, ray, entry, exit.cell, found, counts);
            }
            rounds += 1;
        } else {
            rounds = MAX_EVENTS;
        }
    }
    found
}

/// A line meets each cap once and each wall twice at most.
const MAX_EVENTS: u32 = 8;
/// [`Event::cell`] of an exit through a wall.
const NO_CELL: u32 = u32::MAX;

/// The flag as a quadratic form over the triangle.
#[derive(Clone, Copy)]
struct Conic {
    /// Q's diagonal.
    q_diagonal: Vec3,
    /// Q_12, Q_20, Q_01: the entry of index e belongs to edge e.
    q_mixed: Vec3,
    /// +1 where the stored vertices are counter-clockwise seen along the normals, else -1.
    orientation: f32,
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
    /// N.
    n: u32,
}

impl Conic {
    #[inline]
    fn new(field: &HeightField<'_>, base: &BaseTriangle, ray: &TraversalRay) -> Self {
        let n = field.subdivisions;
        let v = ray.direction;
        // Normals that spread over a third of the sphere have no proven length, and lifts no bound: heights stand in.
        let shortest = base.shortest_normal();
        let (low, high) = base.lift_range(field, if shortest > 0.0 { shortest } else { 1.0 });

        // Move the origin along the ray to the prism, so that differences are of the prism's size.
        let centroid = (base.p0 + base.p1 + base.p2) * (1.0 / 3.0);
        let t_origin = dot(centroid - ray.origin, v);
        let origin = ray.origin + v * t_origin;
        let extent = max_abs(base.p1 - base.p0) + max_abs(base.p2 - base.p0) + low.abs().max_num(high.abs());

        // Q_il = (v x n_i) . (o - p_l), symmetrised.
        let (m0, m1, m2) = (cross(v, base.n0), cross(v, base.n1), cross(v, base.n2));
        let (r0, r1, r2) = (origin - base.p0, origin - base.p1, origin - base.p2);
        let facing = cross(base.p1 - base.p0, base.p2 - base.p0).dot(base.n0 + base.n1 + base.n2);
        let orientation = if facing < 0.0 { -1.0 } else { 1.0 };
        let q_diagonal = Vec3::new(dot(m0, r0), dot(m1, r1), dot(m2, r2)) * orientation;
        let q_mixed =
            Vec3::new(dot(m1, r2) + dot(m2, r1), dot(m2, r0) + dot(m0, r2), dot(m0, r1) + dot(m1, r0))
                * (0.5 * orientation);

        // What rounding moves a micro-vertex by, relative to the ray: interpolation (3 fused operations on weights that
        // Vulkan's division leaves off by 3 u) and lift, 8 u of the largest coordinate; translation, shear and its
        // division in the triangle test, 6 u of the distance; the moved origin, 2 u of itself.
        let coordinate = max_abs(base.p0).max_num(max_abs(base.p1)).max_num(max_abs(base.p2)) + extent;
        let shift =
            UNIT_ROUNDOFF * (8.0 * coordinate + 6.0 * (t_origin.abs() + extent) + 2.0 * max_abs(origin));
        let margin = 1e-3 * (high - low) + shift;
        Conic {
            q_diagonal,
            q_mixed,
            orientation,
            origin,
            t_origin,
            shift,
            reach: extent / n as f32 + shift,
            lift_min: low - margin,
            lift_max: high + margin,
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
        let size = max_abs(e1).max_num(max_abs(e2));
        let tolerance = 1e-6 + conic.shift * size / det.abs();
        if b1 >= -tolerance && b2 >= -tolerance && b1 + b2 <= 1.0 + tolerance {
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
        let square = fa - 2.0 * fm + fb;
        let patch = BilinearPatch { q00: pa, q10: pb, q01: pa + na, q11: pb + nb };
        let (first, second) = patch.intersect_line(conic.origin, ray.direction);
        self.add_wall_hit(conic, e, first, fm - fa, square);
        self.add_wall_hit(conic, e, second, fm - fa, square);
    }

    #[inline]
    fn add_wall_hit(&mut self, conic: &Conic, e: u32, hit: PatchHit, half_slope: f32, square: f32) {
        if !hit.is_some() || hit.v < conic.lift_min || hit.v > conic.lift_max {
            return;
        }
        // Half the flag's derivative along the edge: which way the ray crosses the wall.
        let crossing = half_slope + square * hit.u;
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

/// The nearer of `nearest` and the hits on a walk from an entry until the path leaves the grid, the exit's cell or the
/// cell of a hit is passed, or signs tell no way on.
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
) -> Hit {
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
    let mut passed = false;
    let mut going = true;
    let mut steps = 0;
    while going && steps < cap {
        counts.cells += 1;
        counts.triangles += 1;
        let before = found;
        found = base.intersect_cell(ray, cell, corners.a, corners.b, corners.c, found);
        let e = edge_to_negative(-corners.flags);
        counts.lost_walks += (e == 3) as u32;
        going = !passed && e < 3 && !cell.leaves_grid(cell.change_across(e), n);
        passed = found != before || cell.pack() == exit_cell;
        if going {
            cell = cell.step(cell.change_across(e));
            corners = corners.stepped(conic, field, base, cell, e);
        }
        steps += 1;
    }
    counts.cap_hits += (going && steps == cap) as u32;
    found
}

/// The vertices of the current cell with their flags.
#[derive(Clone, Copy)]
struct Corners {
    a: Vec3,
    b: Vec3,
    c: Vec3,
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
}

/// The edge that, counter-clockwise, goes from a vertex whose flag is not negative to one whose flag is: where the
/// path comes in. With all flags negated, where it goes out. 3 where there is none.
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

    /// Walks and brute force on `count` prisms with 20 rays each. The walk may miss hits, at most the share
    /// `most_misses` of them, and find others behind what it missed; it must find none that is not there.
    fn compare(seed: u32, count: u32, spread: f32, adversarial: bool, most_misses: f64) {
        let mut numbers = Numbers::new(seed);
        let (mut hits, mut misses) = (0, 0);
        for _ in 0..count {
            let n = 1 + (numbers.unit() * numbers.unit() * 24.0) as u32;
            let prism = Prism::random(&mut numbers, n, spread, 0.3);
            let view = prism.view();
            let field = HeightField::new(&view, FEATURES);
            for _ in 0..20 {
                let ray = random_ray(&prism, &field, &mut numbers, adversarial);
                let (walked, exact, _) = both(&prism, &ray);
                hits += u32::from(exact.is_some());
                misses += u32::from(walked != exact);
                assert!(
                    walked == exact || walked.t > exact.t || walked.t == exact.t && walked.cell > exact.cell
                );
            }
        }
        assert!(hits > count, "the rays are no test: {hits} hits");
        assert!(f64::from(misses) < most_misses * f64::from(hits), "{misses} of {hits} missed");
    }

    /// Where signs decide everything, but for those within rounding of zero.
    #[test]
    fn parallel_normals() {
        compare(1, 10_000, 0.0, false, 1e-4);
    }

    /// Flags vanish everywhere along the normal, and at micro-vertices where three or more cells are one too many.
    #[test]
    fn parallel_normals_and_rays_along_them_and_through_micro_vertices() {
        compare(1, 10_000, 0.0, true, 0.04);
    }

    #[test]
    fn leaning_normals() {
        compare(2, 10_000, 0.3, false, 0.002);
    }
}

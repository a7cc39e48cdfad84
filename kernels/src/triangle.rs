//! The watertight ray/triangle test.
//!
//! # Which triangles a ray leaves
//! A ray that [leaves](TraversalRay::leaving) a plane to one side rises above it. Rounding can make it hit, at a
//! distance that is 0 but for its own error, what lies in that plane: the triangle beside the one that it leaves, a
//! face that was written twice, turned round or cut along the other diagonal, a decal, a coincident face of another
//! model. So a hit of such a ray does not count
//! - where no corner of the triangle is above the ray's start, as seen along the plane's normal, by more than rounding:
//!   what the ray rises from it cannot meet;
//! - where the triangle is parallel to the plane, but for an angle of `MOST_TURN`, and its own plane passes the ray's
//!   start within rounding: a hit that is closer than its error in t is none.
//!
//! The first alone lets go a wall beside a floor only where that rises from the floor by no more than rounding, so that
//! corners stay closed. The second is for planes through vertices so close together that their rounding tilts them.
//!
//! A hit counts all the same where the ray comes down on the triangle, from the side to which it leaves, and the two
//! make an angle of `CREASE` at most: such a ray has started in front of the triangle. Were the hit let go, light would
//! enter a room along every crease of its walls that is flatter than `MOST_TURN`, or narrower than rounding / `CREASE`.
//! Where planes coincide only rays that graze them by less than rounding tilts them come down.
//!
//! *Rounding* is `ROUNDINGS` u (s + r): s is the greatest sheared coordinate of the triangle's corners, r that of the
//! ray's start. In detail: a coordinate of a corner relative to the start is at most 2 s, across the ray it is off by 5
//! u s (its difference to the start, that of the third axis, a product, a sum), along it by 2 u s. An edge function
//! whose products are not fused is off by as much as moves of a corner by 3 u s; weights divided as Vulkan allows are
//! off by 5 u, and their sum with depths by 3 u: 8 u s. So the plane, as the test sees it from the start, is off by
//! (7 + 3 + 2 + 8) u s = 20 u s along its normal, a corner's height above the start by 16 u s. Corners themselves are
//! off by 28 u of their coordinates, at most 2 s + r, against a surface that coincides with the one left, as are those
//! of the latter, here at most r: 76 u s + 56 u r together.

use crate::math::{
    MinMax, UNIT_ROUNDOFF, cross, difference_of_products, dot, fma, max_abs, resolve_sign, sqrt, unit,
};
use crate::ray::{TraversalRay, permute};
use glam::Vec3;

/// What rounding can make of the distance between a ray's start and a plane that coincides with the one left, in unit
/// roundoffs of the coordinates that it is computed from: see the head of this file.
const ROUNDINGS: f32 = 96.0;
/// The sine of the angle between planes up to which they may be one that rounding has tilted. Those of micro-triangles
/// that are 12 u / 2^-6 = 1/20,000 of their coordinates wide are tilted by less.
const MOST_TURN: f32 = 1.0 / 64.0;

/// The sine of the angle between a triangle and the plane left up to which a ray that comes down on the triangle hits
/// it. Steeper triangles that rise by no more than rounding are 8 times as wide as that at most.
const CREASE: f32 = 1.0 / 8.0;

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleHit {
    /// Distance; infinite on a miss.
    pub t: f32,
    /// Barycentric coordinate of the second vertex.
    pub b1: f32,
    /// Barycentric coordinate of the third vertex.
    pub b2: f32,
}

impl TriangleHit {
    /// No hit.
    pub const NONE: TriangleHit = TriangleHit { t: f32::INFINITY, b1: 0.0, b2: 0.0 };
}

/// Meets the triangle (p0, p1, p2) from either side at a distance in [0, `t_max`]; edges belong to it.
///
/// Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013: the edge functions are signs of
/// sheared 2-D determinants, which both triangles at an edge compute from the same bits with opposite roles, so
/// that no ray passes between them. Where the paper falls back to doubles, [`resolve_sign`] tells the sign exactly, on
/// devices whose `Fma` rounds twice too, for the range of [`difference_of_products`] (below it signs are still
/// opposite). A triangle seen edge-on or of zero area is missed. `t` carries a relative error of at most
/// gamma(12) of the greatest vertex depth. It depends on where the corners are and not on
/// their order: a face that is stored twice, whichever way round, is hit at the same distance to the bit.
#[inline]
pub fn intersect(ray: &TraversalRay, p0: Vec3, p1: Vec3, p2: Vec3, t_max: f32) -> TriangleHit {
    intersect_sheared(ray, ray.shear_point(p0), ray.shear_point(p1), ray.shear_point(p2), t_max)
}

/// [`intersect`] with vertices that are [sheared](TraversalRay::shear_point) already.
#[inline]
pub fn intersect_sheared(ray: &TraversalRay, a: Vec3, b: Vec3, c: Vec3, t_max: f32) -> TriangleHit {
    let [e0, e1, e2] = edge_functions(a, b, c);
    let any_negative = e0 < 0.0 || e1 < 0.0 || e2 < 0.0;
    let any_positive = e0 > 0.0 || e1 > 0.0 || e2 > 0.0;
    let det = e0 + e1 + e2;
    if any_negative && any_positive || det == 0.0 {
        return TriangleHit::NONE;
    }
    let hit = distance_and_weights(a, b, c);
    if !(hit.t >= 0.0 && hit.t <= t_max) || ray.left_reach >= 0.0 && is_left(ray, a, b, c, hit.t) {
        TriangleHit::NONE
    } else {
        hit
    }
}

/// The edge functions of a sheared triangle, with exact signs: twice the areas of the triangles that the ray makes with
/// its sides.
#[inline]
fn edge_functions(a: Vec3, b: Vec3, c: Vec3) -> [f32; 3] {
    let mut e0 = difference_of_products(c.x, b.y, c.y, b.x);
    let mut e1 = difference_of_products(a.x, c.y, a.y, c.x);
    let mut e2 = difference_of_products(b.x, a.y, b.y, a.x);
    // Few rays come so near to an edge: a branch for all three, so that others pay for no more than the question.
    if e0 == 0.0 || e1 == 0.0 || e2 == 0.0 {
        e0 = resolve_sign(e0, c.x, b.y, c.y, b.x);
        e1 = resolve_sign(e1, a.x, c.y, a.y, c.x);
        e2 = resolve_sign(e2, b.x, a.y, b.y, a.x);
    }
    [e0, e1, e2]
}

/// Where a ray that meets the triangle (a, b, c) does so. Computed with the corners in an order that is their own, so
/// that it is the same to the bit in whatever order they come.
#[inline]
fn distance_and_weights(a: Vec3, b: Vec3, c: Vec3) -> TriangleHit {
    let (first, second) = in_order((a, 0), (b, 1));
    let (second, third) = in_order(second, (c, 2));
    let (first, second) = in_order(first, second);
    let ((a, at_first), (b, at_second), (c, _)) = (first, second, third);
    let [e0, e1, e2] = edge_functions(a, b, c);
    let det = e0 + e1 + e2;
    // Divided first: the edge functions are areas, and an area times a depth may be less than a float can hold.
    let (b0, b1, b2) = (e0 / det, e1 / det, e2 / det);
    let t = fma(b2, c.z, fma(b1, b.z, b0 * a.z));
    let weight = |corner: u32| {
        if at_first == corner {
            b0
        } else if at_second == corner {
            b1
        } else {
            b2
        }
    };
    TriangleHit { t, b1: weight(1), b2: weight(2) }
}

/// Two corners with their numbers, the one of lesser coordinates first.
#[inline]
fn in_order(one: (Vec3, u32), other: (Vec3, u32)) -> ((Vec3, u32), (Vec3, u32)) {
    let (a, b) = (one.0, other.0);
    let swapped = b.x < a.x || b.x == a.x && (b.y < a.y || b.y == a.y && b.z < a.z);
    if swapped { (other, one) } else { (one, other) }
}

/// Whether the triangle of these sheared corners, met at distance `t`, is one that the ray leaves, which must leave a
/// plane: see the head of this file.
///
/// A point q relative to the ray's start is (x, y, 0) + z d in sheared coordinates x, y, z, d the direction. So its
/// height is n · q = n_x x + n_y y + (n · d) z, and a plane whose normal in sheared coordinates is m has the normal
/// (m_x, m_y, (m_z - m_x d_x - m_y d_y) / d_z).
#[inline]
pub(crate) fn is_left(ray: &TraversalRay, a: Vec3, b: Vec3, c: Vec3, t: f32) -> bool {
    let (n, d) = (permute(ray.left_normal, ray.major_axis), permute(ray.direction, ray.major_axis));
    let size = max_abs(a).max_num(max_abs(b)).max_num(max_abs(c));
    let error = ROUNDINGS * UNIT_ROUNDOFF * (size + ray.left_reach);
    let up = Vec3::new(n.x, n.y, dot(n, d));
    let highest = dot(up, a).max_num(dot(up, b)).max_num(dot(up, c));
    let m = unit(cross(b - a, c - a));
    let normal = Vec3::new(m.x, m.y, (m.z - m.x * d.x - m.y * d.y) * ray.shear.z);
    let length = sqrt(dot(normal, normal));
    let turn = cross(normal, n);
    let squared_sine = dot(turn, turn) / (length * length);
    // The ray runs along the third axis of sheared coordinates.
    let comes_down = m.z * dot(normal, n) < 0.0 && squared_sine <= CREASE * CREASE;
    let passes_start = squared_sine <= MOST_TURN * MOST_TURN && t * m.z.abs() <= error * length;
    !comes_down && (highest <= error || passes_start)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hit::Hit;
    use crate::math::tests::Numbers;

    fn ray(origin: Vec3, towards: Vec3) -> TraversalRay {
        TraversalRay::new(origin, (towards - origin).normalize(), f32::INFINITY)
    }

    const P: [Vec3; 3] = [Vec3::ZERO, Vec3::X, Vec3::Y];

    #[test]
    fn hit_has_distance_and_barycentrics() {
        let hit =
            intersect(&ray(Vec3::new(0.25, 0.5, 2.0), Vec3::new(0.25, 0.5, 0.0)), P[0], P[1], P[2], 10.0);
        assert_eq!((hit.t, hit.b1, hit.b2), (2.0, 0.25, 0.5));
    }

    #[test]
    fn triangle_is_met_from_both_sides_and_not_behind_or_beyond() {
        let from_below = ray(Vec3::new(0.25, 0.25, -1.0), Vec3::new(0.25, 0.25, 0.0));
        assert_eq!(intersect(&from_below, P[0], P[1], P[2], 10.0).t, 1.0);
        assert_eq!(intersect(&from_below, P[0], P[1], P[2], 0.5), TriangleHit::NONE);
        let away = TraversalRay::new(Vec3::new(0.25, 0.25, -1.0), -Vec3::Z, f32::INFINITY);
        assert_eq!(intersect(&away, P[0], P[1], P[2], 10.0), TriangleHit::NONE);
    }

    #[test]
    fn edge_on_and_zero_area_triangles_are_missed() {
        let in_plane = ray(Vec3::new(-1.0, 0.2, 0.0), Vec3::new(0.0, 0.2, 0.0));
        assert_eq!(intersect(&in_plane, P[0], P[1], P[2], 10.0), TriangleHit::NONE);
        let across = ray(Vec3::new(0.5, 0.0, 1.0), Vec3::new(0.5, 0.0, 0.0));
        assert_eq!(intersect(&across, P[0], P[1], Vec3::X * 2.0, 10.0), TriangleHit::NONE);
    }

    #[test]
    fn edges_and_vertices_belong_to_the_triangle() {
        for target in [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(0.5, 0.0, 0.0), Vec3::new(0.0, 0.25, 0.0)] {
            // Edge functions are positive in one order of the vertices and negative in the other.
            for (p1, p2) in [(P[1], P[2]), (P[2], P[1])] {
                let hit = intersect(&ray(target + Vec3::Z, target), P[0], p1, p2, 10.0);
                assert_eq!(hit.t, 1.0);
            }
        }
    }

    /// The same corners in every order: the same distance to the bit, and each corner its weight.
    #[test]
    fn order_of_the_corners_does_not_tell() {
        let mut numbers = Numbers::new(5);
        for _ in 0..20_000 {
            let p = [numbers.vec3(), numbers.vec3(), numbers.vec3()];
            let (b, c) = (0.5 * numbers.unit(), 0.5 * numbers.unit());
            let ray = ray(numbers.vec3() * 4.0, p[0] + (p[1] - p[0]) * b + (p[2] - p[0]) * c);
            let hit = intersect(&ray, p[0], p[1], p[2], 100.0);
            let weights = [1.0 - hit.b1 - hit.b2, hit.b1, hit.b2];
            for [i, j, k] in [[0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
                let other = intersect(&ray, p[i], p[j], p[k], 100.0);
                assert_eq!(hit.t.to_bits(), other.t.to_bits(), "{ray:?} {p:?}");
                if hit.t.is_finite() {
                    // The first weight is what the others leave of 1, three roundings.
                    assert!((other.b1 - weights[j]).abs() <= 4.0 * UNIT_ROUNDOFF);
                    assert!((other.b2 - weights[k]).abs() <= 4.0 * UNIT_ROUNDOFF);
                }
            }
        }
    }

    /// What is in the plane that a ray leaves, or behind it, is not hit, though t may come out above 0; what rises from
    /// it at its edge is, however near.
    #[test]
    fn ray_leaves_its_plane_and_nothing_else() {
        let mut numbers = Numbers::new(6);
        let (mut grazed, mut met) = (0, 0);
        for round in 0..200_000 {
            let scale = [1e-6, 1.0, 1e6][round % 3];
            // A frame, and a huge triangle around the start in its first plane. Its corners are rounded.
            let x = numbers.vec3().normalize();
            let n = x.any_orthogonal_vector().normalize();
            let y = n.cross(x);
            let at = numbers.vec3() * scale;
            let size = scale * [0.1, 1.0, 100.0][round / 3 % 3];
            let [a, b, c] = [(-1.0, -1.1), (1.2, -0.9), (0.1, 1.0)].map(|(u, v)| at + (x * u + y * v) * size);
            let to = numbers.vec3();
            let to = (to.reject_from(n) + n * (to.dot(n).abs() + 0.01)).normalize();
            let left = Hit { primitive: 7, ..Hit::NONE };
            let ray = TraversalRay::new(at, to, f32::INFINITY);
            grazed += usize::from(intersect(&ray, a, b, c, f32::INFINITY).t.is_finite());
            assert_eq!(
                intersect(&ray.leaving(left, n), a, b, c, f32::INFINITY),
                TriangleHit::NONE,
                "{ray:?}"
            );
            // A wall of the same size, at right angles to the plane, a thousandth of it away.
            let foot = at + to.reject_from(n).normalize() * (1e-3 * size);
            let along = n.cross(to).normalize();
            let (d, e) = (foot - along * size - n * size, foot + along * size - n * size);
            let wall = [d, e, foot + n * (3.0 * size)];
            let hit = intersect(&ray, wall[0], wall[1], wall[2], f32::INFINITY);
            let again = intersect(&ray.leaving(left, n), wall[0], wall[1], wall[2], f32::INFINITY);
            met += usize::from(again.t.is_finite());
            assert_eq!(hit, again, "{ray:?}");
        }
        assert!(grazed > 20_000 && met > 50_000, "{grazed} {met}");
    }

    /// Rays aimed at the edges and at the centre of a fan must hit some triangle of it.
    #[test]
    fn fan_is_watertight() {
        let mut numbers = Numbers::new(3);
        for _ in 0..20_000 {
            let scale = (numbers.unit() * 40.0 - 20.0).exp2();
            let centre = numbers.vec3() * scale;
            let rim: Vec<Vec3> = (0..7)
                .map(|i| {
                    let angle = i as f32 / 7.0 * std::f32::consts::TAU;
                    centre + Vec3::new(angle.cos(), angle.sin(), 0.3 * numbers.unit()) * scale
                })
                .collect();
            let s = if numbers.unit() < 0.3 { 0.0 } else { numbers.unit() * 0.9 };
            let spoke = (numbers.unit() * 7.0) as usize;
            let target = centre + (rim[spoke] - centre) * s;
            let eye = centre + (Vec3::Z + numbers.vec3() * 0.5) * scale * 10.0;
            let ray = ray(eye, target);
            let hit = (0..7).any(|i| intersect(&ray, centre, rim[i], rim[(i + 1) % 7], 1e30).t.is_finite());
            assert!(hit, "{ray:?} between the triangles at {centre} and {}", rim[spoke]);
        }
    }

    /// Against Cramer's rule in f64, on rays well inside the triangle. The bound: gamma(12) of the greatest
    /// depth, as the doc says, plus the error of the rounded direction, u per unit of distance. The least scale is that
    /// of micro-triangles at the greatest N on the smallest model that the host accepts, the greatest that of the
    /// largest.
    #[test]
    fn distance_agrees_with_f64() {
        let mut numbers = Numbers::new(4);
        for round in 0..300_000 {
            let scale = [1e-12 / 4096.0, 1.0, 1e12][round % 3];
            let mut point = |reach: f32| numbers.vec3() * (reach * scale);
            let (p, origin) = ([point(1.0), point(1.0), point(1.0)], point(8.0));
            let (b1, b2) = (0.1 + 0.4 * numbers.unit(), 0.1 + 0.4 * numbers.unit());
            let ray = ray(origin, p[0] + (p[1] - p[0]) * b1 + (p[2] - p[0]) * b2);
            let (e1, e2) = ((p[1] - p[0]).as_dvec3(), (p[2] - p[0]).as_dvec3());
            let n = e1.cross(e2);
            let d = ray.direction.as_dvec3();
            let cosine = (d.dot(n) / n.length()).abs();
            if cosine < 0.1 || n.length() < 0.05 * f64::from(scale).powi(2) {
                continue;
            }
            let exact = (p[0].as_dvec3() - origin.as_dvec3()).dot(n) / d.dot(n);
            let hit = intersect(&ray, p[0], p[1], p[2], f32::INFINITY);
            // Depths reach |origin| + |p| < 16; the plane's slope divides the error by the cosine.
            let bound = 16.0 * f64::from(scale) * f64::from(crate::math::gamma(12)) / cosine;
            assert!((f64::from(hit.t) - exact).abs() <= bound, "{} {exact} {bound}", hit.t);
        }
    }

    /// Creases that are flatter than `MOST_TURN`, or beyond which the surface rises by less than rounding: a ray which
    /// starts beside one, below the other triangle's far corner, and comes down on that triangle hits it, however near.
    #[test]
    fn flat_creases_stay_closed() {
        let mut numbers = Numbers::new(7);
        let mut met = 0;
        for round in 0..100_000 {
            let scale = [1e-6, 1.0, 1e6][round % 3];
            // A frame: the crease runs along y, the plane that is left lies in z = 0, x < 0.
            let y = numbers.vec3().normalize();
            let z = y.any_orthogonal_vector().normalize();
            let x = y.cross(z);
            let is_narrow = round % 2 == 1;
            let (away, size) = if is_narrow { (numbers.vec3() * 4.0, 2e-3) } else { (Vec3::ZERO, 1.0) };
            let at = |u: f32, v: f32, w: f32| (away + (x * u + y * v + z * w) * size) * scale;
            let rise = 0.002 + 0.01 * numbers.unit();
            let other = [at(0.0, -1.0, 0.0), at(0.0, 1.0, 0.0), at(1.0, 0.0, rise)];
            // Beside a wide triangle by so little that its plane passes the start within rounding.
            let beside = if is_narrow { 0.3 } else { 1e-4 * (1.0 + numbers.unit()) };
            let start = at(-beside, 0.1 * numbers.vec3().x, 0.0);
            let towards = at(0.5, 0.0, 0.25 * rise);
            let ray = TraversalRay::new(start, (towards - start).normalize(), f32::INFINITY);
            let hit = intersect(&ray, other[0], other[1], other[2], f32::INFINITY);
            met += usize::from(hit.t.is_finite());
            let left = Hit { primitive: 7, ..Hit::NONE };
            let again = intersect(&ray.leaving(left, z), other[0], other[1], other[2], f32::INFINITY);
            assert_eq!(hit, again, "{ray:?}");
        }
        // Rounding may take a narrow one out of a ray's way.
        assert!(met > 99_000, "{met}");
    }
}

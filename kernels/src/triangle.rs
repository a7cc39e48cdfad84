//! The watertight ray/triangle test.

use crate::math::{difference_of_products, resolve_sign};
use crate::ray::TraversalRay;
use glam::Vec3;

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
/// gamma(12) of the greatest vertex depth.
#[inline]
pub fn intersect(ray: &TraversalRay, p0: Vec3, p1: Vec3, p2: Vec3, t_max: f32) -> TriangleHit {
    intersect_sheared(ray.shear_point(p0), ray.shear_point(p1), ray.shear_point(p2), t_max)
}

/// [`intersect`] with vertices that are [sheared](TraversalRay::shear_point) already.
#[inline]
pub fn intersect_sheared(a: Vec3, b: Vec3, c: Vec3, t_max: f32) -> TriangleHit {
    let mut e0 = difference_of_products(c.x, b.y, c.y, b.x);
    let mut e1 = difference_of_products(a.x, c.y, a.y, c.x);
    let mut e2 = difference_of_products(b.x, a.y, b.y, a.x);
    // Few rays come so near to an edge: a branch for all three, so that others pay for no more than the question.
    if e0 == 0.0 || e1 == 0.0 || e2 == 0.0 {
        e0 = resolve_sign(e0, c.x, b.y, c.y, b.x);
        e1 = resolve_sign(e1, a.x, c.y, a.y, c.x);
        e2 = resolve_sign(e2, b.x, a.y, b.y, a.x);
    }
    let any_negative = e0 < 0.0 || e1 < 0.0 || e2 < 0.0;
    let any_positive = e0 > 0.0 || e1 > 0.0 || e2 > 0.0;
    let det = e0 + e1 + e2;
    if any_negative && any_positive || det == 0.0 {
        return TriangleHit::NONE;
    }
    // Divided first: the edge functions are areas, and an area times a depth may be less than a float can hold.
    let (b0, b1, b2) = (e0 / det, e1 / det, e2 / det);
    let t = b0 * a.z + b1 * b.z + b2 * c.z;
    if t >= 0.0 && t <= t_max { TriangleHit { t, b1, b2 } } else { TriangleHit::NONE }
}

#[cfg(test)]
mod tests {
    use super::*;
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
}

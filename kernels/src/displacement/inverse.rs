//! Inverse displacement mapping: Patterson, Hoggar and Logie, "Inverse Displacement Mapping", Computer Graphics Forum
//! 10(2), 1991. Rather than displace the surface towards the ray, the ray is taken back to where the surface is flat:
//! a point of it has barycentric coordinates and a lift over the base triangle, those of the prism's own map
//!
//!   P(b) + l n(b) = o + s d,
//!
//! and its height is compared with what the map has there. N steps between where the ray enters the prism's bound and
//! where it leaves it, each a few iterations of Newton's method from the coordinates of the step before; at the first
//! change of sign eight bisections and one false position.
//!
//! The surface is the bilinear height field, of which micro-triangles are the limit for a great N; it is seen in the
//! silhouette. Where the steps find a crossing its distance is off by rounding alone, whatever N.
//!
//! Cost: N solutions of three equations, each with a reading of the map, for every prism that the ray enters; ten
//! more where it hits.
//!
//! Artefacts. A ray that crosses the surface twice between two steps passes through: the share of rays that do falls
//! with the square of N on a smooth map, since a chord is as long as the root of what the ray grazes it by (as N
//! where steps are shorter than texels, whose borders are creases). The surface cracks at seams, where each triangle
//! has its own field. A ray that leaves a triangle meets nothing of it within the first step. Deviations: the paper's
//! surfaces are bilinear patches and its steps those of the texture; where prisms fold back over themselves (as far
//! from a hollow base as its radius) Newton's method may find the wrong fold.

use crate::barycentric::interpolate;
use crate::counters::Counts;
use crate::displacement::surface::{BaseTriangle, HeightField};
use crate::hit::Hit;
use crate::interface::normals;
use crate::math::{cross, dot, max_abs, sqrt, unit};
use crate::ray::TraversalRay;
use crate::triangle::is_left;
use glam::Vec3;

/// Most iterations of Newton's method for a point. It begins one step away, at most a diameter of the prism / N; from
/// there two find the point to rounding unless the prism is very curved.
const MOST_ITERATIONS: u32 = 4;
/// Bisections before the false position: 1/256 of a step, where a bilinear patch is straight but for rounding.
const BISECTIONS: u32 = 8;
/// How far beyond the base triangle's edge, in barycentric coordinates, a crossing is still the triangle's: neighbours
/// compute it on their own, each to some 1e-6.
const EDGE: f32 = 1e-5;

/// A point in the space of a prism.
#[derive(Clone, Copy)]
struct Place {
    /// Barycentric coordinates of vertices 1 and 2, and the lift.
    at: Vec3,
    /// How far it is above the relief, in heights; NaN where the prism's map has no inverse.
    above: f32,
}

/// The nearer of `nearest` and the ray's hit on the height field over a base triangle. The hit's cell is 0, its
/// barycentric coordinates are those of the base triangle.
#[inline]
pub fn intersect(
    field: &HeightField<'_>,
    base: &BaseTriangle,
    ray: &TraversalRay,
    nearest: Hit,
    counts: &mut Counts,
) -> Hit {
    counts.prisms += 1;
    let (near, far) = span(field, base, ray, ray.t_max.min(nearest.t));
    let n = field.subdivisions;
    let leaves = base.primitive == ray.left_primitive;
    // A ray that leaves the triangle is on the relief: whether above or below it is known after a step.
    let mut step = leaves as u32;
    let mut t = near;
    let mut place = Place { at: Vec3::ZERO, above: 0.0 };
    // The ends of the interval that is searched, and how often it was cut.
    let (mut low, mut high) = (near, near);
    let (mut above_low, mut above_high) = (0.0, 0.0);
    let mut before = Vec3::ZERO;
    let mut cuts = 0;
    let mut known = false;
    let mut found = false;
    let mut going = near < far;
    // One loop for steps and cuts, so that the code of a step stands in a kernel once.
    while going {
        if cuts == 0 {
            t = near + (far - near) * (step as f32 / n as f32);
        } else if cuts <= BISECTIONS {
            t = 0.5 * (low + high);
        } else {
            t = low + (high - low) * (above_low / (above_low - above_high));
        }
        place = solve(field, base, ray.origin + ray.direction * t, place.at);
        counts.cells += 1;
        if cuts == 0 {
            let crosses = known
                && (above_low > 0.0) != (place.above > 0.0)
                && place.above.is_finite()
                && may_be_inside(before, place.at);
            if crosses {
                high = t;
                above_high = place.above;
                cuts = 1;
            } else {
                known = place.above.is_finite();
                low = t;
                above_low = place.above;
                before = place.at;
                step += 1;
                going = step <= n;
            }
        } else if cuts <= BISECTIONS {
            if (above_low > 0.0) != (place.above > 0.0) {
                high = t;
                above_high = place.above;
            } else {
                low = t;
                above_low = place.above;
            }
            cuts += 1;
        } else {
            found = is_inside(place.at, if leaves { 0.0 } else { EDGE });
            // Beyond an edge: the search goes on from this step.
            known = false;
            cuts = 0;
            going = !found;
        }
    }
    let counts = found && t >= 0.0 && t <= ray.t_max;
    if counts && !(ray.left_reach >= 0.0 && touches_left(field, base, ray, place.at, t)) {
        nearest.nearer(Hit { t, primitive: base.primitive, b1: place.at.x, b2: place.at.y, ..Hit::NONE })
    } else {
        nearest
    }
}

/// Where the ray is in the bound of the prism: the box of its six points, and what is between their planes along the
/// base triangle. `far` is below `near` where it is nowhere.
#[inline]
fn span(field: &HeightField<'_>, base: &BaseTriangle, ray: &TraversalRay, t_max: f32) -> (f32, f32) {
    let shortest = base.shortest_normal();
    let is_hull = shortest > 0.0 || field.normals == normals::LINEAR;
    let (low, high) = if is_hull { base.lift_range(field, shortest) } else { (0.0, 0.0) };
    // Where normals cancel directions are anywhere.
    let reach = if is_hull { 0.0 } else { base.reach(field) };
    let across = unit(cross(base.p1 - base.p0, base.p2 - base.p0));
    // A thousandth of the prism's size more, so that the relief's extremes are between the first step and the last,
    // also where it is flat.
    let size = max_abs(base.p1 - base.p0).max(max_abs(base.p2 - base.p0));
    let more = 1e-3 * (size + low.abs().max(high.abs()) + reach);
    let (mut near, mut far) = (0.0_f32, t_max);
    let mut axis = 0;
    while axis < 4 {
        let a = if axis == 0 {
            Vec3::X
        } else if axis == 1 {
            Vec3::Y
        } else if axis == 2 {
            Vec3::Z
        } else {
            across
        };
        let (p0, p1, p2) = (0.0, dot(a, base.p1 - base.p0), dot(a, base.p2 - base.p0));
        let (n0, n1, n2) = (dot(a, base.n0), dot(a, base.n1), dot(a, base.n2));
        let least = least_of(p0 + low * n0, p1 + low * n1, p2 + low * n2).min(least_of(
            p0 + high * n0,
            p1 + high * n1,
            p2 + high * n2,
        ));
        let most = -least_of(-p0 - low * n0, -p1 - low * n1, -p2 - low * n2).min(least_of(
            -p0 - high * n0,
            -p1 - high * n1,
            -p2 - high * n2,
        ));
        let margin = reach + more;
        let (from, rate) = (dot(a, ray.origin - base.p0), dot(a, ray.direction));
        let (first, last) = ((least - margin - from) / rate, (most + margin - from) / rate);
        let within = from >= least - margin && from <= most + margin;
        if rate != 0.0 {
            near = near.max(first.min(last));
            far = far.min(first.max(last));
        } else if !within {
            far = -1.0;
        }
        axis += 1;
    }
    (near, far)
}

#[inline]
fn least_of(a: f32, b: f32, c: f32) -> f32 {
    a.min(b).min(c)
}

/// The coordinates of `point`, by Newton's method from `from`.
#[inline]
fn solve(field: &HeightField<'_>, base: &BaseTriangle, point: Vec3, from: Vec3) -> Place {
    let (e1, e2) = (base.p1 - base.p0, base.p2 - base.p0);
    let (m1, m2) = (base.n1 - base.n0, base.n2 - base.n0);
    let x = point - base.p0;
    // NaN once is NaN for ever.
    let mut at = if from.is_finite() { from } else { Vec3::ZERO };
    let mut i = 0;
    while i < MOST_ITERATIONS {
        let n = base.n0 + m1 * at.x + m2 * at.y;
        let (c1, c2) = (e1 + m1 * at.z, e2 + m2 * at.z);
        let rest = x - e1 * at.x - e2 * at.y - n * at.z;
        // Cramer's rule for c1 x + c2 y + n z = rest.
        let volume = dot(c1, cross(c2, n));
        at += Vec3::new(dot(rest, cross(c2, n)), dot(c1, cross(rest, n)), dot(c1, cross(c2, rest))) / volume;
        i += 1;
    }
    let w = Vec3::new(1.0 - at.x - at.y, at.x, at.y);
    let mut above = f32::NAN;
    if at.is_finite() {
        let n = interpolate(w, base.n0, base.n1, base.n2);
        let height = if field.normals == normals::LINEAR { at.z } else { at.z * sqrt(dot(n, n)) };
        above = height - field.height(&base.map, base.uv(w), base.pixel(field, w));
    }
    Place { at, above }
}

/// Whether the surface that is met at coordinates `at` and distance `t` lies in the plane which the ray leaves, by the
/// rule of [`triangle`](crate::triangle) for the plane that touches it there.
#[inline]
fn touches_left(field: &HeightField<'_>, base: &BaseTriangle, ray: &TraversalRay, at: Vec3, t: f32) -> bool {
    let [a, b, c] = base.tangent_triangle(field, Vec3::new(1.0 - at.x - at.y, at.x, at.y));
    is_left(ray, ray.shear_point(a), ray.shear_point(b), ray.shear_point(c), t)
}

/// Whether the triangle may lie between two points, given by barycentric coordinates 1 and 2: unless both are beyond
/// one edge.
#[inline]
fn may_be_inside(a: Vec3, b: Vec3) -> bool {
    a.x.max(b.x) >= -EDGE && a.y.max(b.y) >= -EDGE && (a.x + a.y).min(b.x + b.y) <= 1.0 + EDGE
}

/// Whether a point is in the triangle, or no farther beyond an edge than `beyond`.
#[inline]
fn is_inside(a: Vec3, beyond: f32) -> bool {
    a.x >= -beyond && a.y >= -beyond && a.x + a.y <= 1.0 + beyond
}

impl BaseTriangle {
    /// A triangle in the plane that touches the height field over barycentric coordinates `w`: its first corner is
    /// the point of the surface there, its sides are the derivatives from vertex 0 to 1 and to 2. The base triangle's
    /// own sides where these span no plane.
    #[inline]
    pub fn tangent_triangle(&self, field: &HeightField<'_>, w: Vec3) -> [Vec3; 3] {
        let n = interpolate(w, self.n0, self.n1, self.n2);
        let surface = self.derivatives(field, w);
        let point = interpolate(w, self.p0, self.p1, self.p2) + n * field.lift(surface.height, n);
        let (s1, s2) = (surface.a + surface.d * surface.h1, surface.b + surface.d * surface.h2);
        let across = cross(s1, s2);
        if dot(across, across) > 0.0 && across.is_finite() {
            [point, point + s1, point + s2]
        } else {
            [point, point + (self.p1 - self.p0), point + (self.p2 - self.p0)]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interface::{Intersection, MISS, Ray, method};
    use crate::math::tests::Numbers;
    use crate::render::trace_ray;
    use crate::scene::Features;
    use crate::test_scene::{FLAT, TestScene};

    fn traced(scene: &TestScene, normals: u32, ray: Ray) -> Intersection {
        let features = Features { method: method::INVERSE, normals, ..FLAT };
        trace_ray(&scene.view(), features, ray, &mut Counts::default())
    }

    fn ray(origin: Vec3, target: Vec3) -> Ray {
        Ray { origin, t_max: f32::INFINITY, direction: (target - origin).normalize(), padding: 0 }
    }

    /// One octant of the unit sphere under a constant height: an eighth of an octahedron, with the sphere's normals.
    fn octant(height: f32) -> TestScene {
        let mut scene = TestScene::squares(&[0.0]);
        scene.triangles.truncate(1);
        for (vertex, axis) in scene.vertices.iter_mut().zip([Vec3::X, Vec3::Y, Vec3::Z]) {
            (vertex.position, vertex.normal) = (axis, axis);
        }
        scene.height_texels = vec![1.0_f32.to_bits()];
        scene.displacements[0].scale = height;
        (scene.triangles[0].height_min, scene.triangles[0].height_max) = (height, height);
        (scene.frame.triangle_count, scene.primitives, scene.nodes[0].count) = (1, vec![0], 1);
        scene.frame.subdivisions = 16;
        scene
    }

    /// Along unit normals a constant height h lifts a point p of the plane x + y + z = 1 to p + h p / |p|: the
    /// surface is
    /// |x| = 1 / (s (1, 1, 1)) + h in each direction s. Along normals as they are it is the plane x + y + z = 1 + h.
    #[test]
    fn constant_heights_over_a_curved_prism_are_found() {
        let mut numbers = Numbers::new(8);
        for height in [0.3_f32, -0.2] {
            let scene = octant(height);
            let mut hits = 0;
            for _ in 0..500 {
                let target = Vec3::ONE / 3.0 + numbers.vec3() * 0.15;
                let ray = ray(Vec3::ONE * 2.0 + numbers.vec3(), target);
                for normals in [normals::NORMALIZED, normals::LINEAR] {
                    let hit = traced(&scene, normals, ray);
                    if hit.primitive == MISS {
                        continue;
                    }
                    hits += 1;
                    let x = ray.origin.as_dvec3() + ray.direction.as_dvec3() * f64::from(hit.t);
                    let h = f64::from(height);
                    let off = if normals == normals::LINEAR {
                        x.element_sum() - 1.0 - h
                    } else {
                        x.length() - 1.0 / (x / x.length()).element_sum() - h
                    };
                    // Coordinates of 4 at most, 20 roundings.
                    assert!(off.abs() < 5e-6, "{off} {ray:?} {hit:?}");
                    assert!(x.distance(hit.point.as_dvec3()) < 1e-5, "{x} {hit:?}");
                    if normals == normals::LINEAR {
                        assert!(hit.normal.distance(Vec3::ONE.normalize()) < 1e-5, "{hit:?}");
                    }
                }
            }
            assert!(hits > 800, "{hits} hits");
        }
    }

    /// A square under a slope, and rays that miss it beyond its border.
    #[test]
    fn a_slope_is_found_where_it_is() {
        let mut scene = TestScene::squares(&[0.0]);
        let map = &mut scene.displacements[0];
        (map.map_width, map.scale, map.height_max) = (2, 0.25, 0.25);
        scene.height_texels = vec![0.0_f32.to_bits(), 1.0_f32.to_bits()];
        scene.vertices.iter_mut().for_each(|vertex| vertex.u = 0.5 + vertex.position.x * 0.25);
        scene.triangles.iter_mut().for_each(|triangle| triangle.height_max = 0.25);
        scene.frame.subdivisions = 4;
        let mut numbers = Numbers::new(9);
        for _ in 0..1000 {
            let target = numbers.vec3() * Vec3::new(1.5, 1.5, 0.0);
            let ray = ray(target + numbers.vec3() + Vec3::Z * 3.0, target);
            let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
            // z = (1 + x) / 8.
            let t = (0.125 * (1.0 + o.x) - o.z) / (d.z - 0.125 * d.x);
            let p = o + d * t;
            let hit = traced(&scene, normals::NORMALIZED, ray);
            if p.x.abs().max(p.y.abs()) < 0.9999 {
                assert!((f64::from(hit.t) - t).abs() < 4e-6, "{t} {hit:?}");
                assert!(hit.normal.distance(Vec3::new(-0.125, 0.0, 1.0).normalize()) < 1e-6, "{hit:?}");
            } else if p.x.abs().max(p.y.abs()) > 1.0001 {
                assert_eq!(hit.primitive, MISS, "{p}");
            }
        }
    }

    /// Rays that leave the slope do not meet it again; below it they meet nothing on their way down.
    #[test]
    fn what_leaves_a_slope_does_not_come_back() {
        let scene = octant(0.2);
        let view = scene.view();
        let features = Features { method: method::INVERSE, ..FLAT };
        let field = HeightField::new(&view, features);
        let base = BaseTriangle::load(&view, 0);
        let mut numbers = Numbers::new(10);
        for _ in 0..500 {
            let (b1, b2) = (0.1 + 0.4 * numbers.unit(), 0.1 + 0.4 * numbers.unit());
            let hit = Hit { primitive: 0, b1, b2, ..Hit::NONE };
            let [point, a, b] = base.tangent_triangle(&field, Vec3::new(1.0 - b1 - b2, b1, b2));
            let normal = cross(a - point, b - point).normalize();
            let up = numbers.vec3();
            let up = (up + normal * (0.3 - up.dot(normal).min(0.0))).normalize();
            let ray = TraversalRay::new(point, up, 10.0).leaving(hit, normal);
            let found = intersect(&field, &base, &ray, Hit::NONE, &mut Counts::default());
            assert!(!found.is_some(), "{found:?}");
        }
    }
}

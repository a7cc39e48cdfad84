//! The smooth surface that a base triangle stands for, as light sees it under [`Features::smooth`].
//!
//! A base triangle is a chord of the surface that its vertex normals tell of. Light that grazes that surface comes from
//! behind some of its triangles: lit by where these face, they would show as blocks along the shadow's terminator.
//!
//! [`Features::smooth`]: crate::scene::Features::smooth

use crate::barycentric::interpolate;
use crate::displacement::surface::BaseTriangle;
use crate::interface::Instance;
use crate::math::{cross, dot, unit};
use glam::Vec3;

/// The base under a hit, flat and smooth.
///
/// Light that comes lower over the flat base than over the smooth one is looked for from further up: from the hit
/// moved along [`lift`](Self::lift), by the share that [`raised`](Self::raised) says. With n_i the vertex normals and
/// p_i the vertices the lift of the base's point p is
///
///   sum over i of b_i max(0, (p_i - p) · n_i) n_i,
///
/// how far p is below the tangent planes at the vertices: Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems
/// II, 2021, whose origin is always moved by all of it. No length is chosen: it is 0 at the vertices, everywhere on a
/// triangle with parallel normals, and where the base is hollow. Where each vertex's plane has the two others below it,
/// a ray that leaves the lifted point above the plane of the interpolated normal passes the triangle, to first order
/// of the normals' lean: over a point q of the triangle it is sum over i of b_i n_i · (p_i - q) high, or higher.
///
/// Nothing that rays hit is moved.
#[derive(Clone, Copy, Debug, Default)]
pub struct SmoothBase {
    /// Unit normal of the base triangle, to the outside of the mesh.
    pub ng: Vec3,
    /// The interpolated vertex normal, a unit vector on the side of `ng`. Where there is none, or the triangle is a
    /// sliver, both are the normal of what was hit.
    pub ns: Vec3,
    /// From the hit to the smooth surface; zero where that is not on the side that it was computed for.
    pub lift: Vec3,
}

impl SmoothBase {
    /// The base at barycentric coordinates `w` of `base`, in the space of its mesh; `ng` is the normal of what was hit.
    /// The lift is towards the outside of the mesh, or where `from_inside`, towards the inside.
    #[inline]
    pub fn new(base: &BaseTriangle, w: Vec3, ng: Vec3, from_inside: bool) -> Self {
        let (e1, e2) = (base.p1 - base.p0, base.p2 - base.p0);
        let n = unit(cross(e1, e2));
        let flat = if base.flipped { -n } else { n };
        // Negated so that NaN counts.
        if !(dot(flat, flat) > 0.5) {
            return SmoothBase { ng, ns: ng, lift: Vec3::ZERO };
        }
        let side = if from_inside { -1.0 } else { 1.0 };
        // From the point to the vertices: differences alone, so that they are the same wherever the mesh is.
        let back = -(e1 * w.y + e2 * w.z);
        let rise = |n: Vec3, to_vertex: Vec3| {
            let height = dot(n, to_vertex) * side;
            // Normals that point to the other side tell nothing of this one.
            if height > 0.0 && dot(n, flat) > 0.0 { n * (height * side) } else { Vec3::ZERO }
        };
        let (r0, r1, r2) = (rise(base.n0, back), rise(base.n1, back + e1), rise(base.n2, back + e2));
        SmoothBase { ng: flat, ns: base.vertex_normal(w, flat), lift: interpolate(w, r0, r1, r2) }
    }

    /// The same of an instance in the world.
    #[inline]
    pub fn placed(self, instance: &Instance) -> Self {
        SmoothBase {
            ng: instance.world_normal(self.ng),
            ns: instance.world_normal(self.ns),
            lift: instance.world_vector(self.lift),
        }
    }

    /// The base as it is seen from behind, where `behind`.
    #[inline]
    pub fn turned(self, behind: bool) -> Self {
        if behind { SmoothBase { ng: -self.ng, ns: -self.ns, ..self } } else { self }
    }

    /// The share of the lift that light from the unit direction `wi` asks for: 1 from where it would come from behind
    /// the flat base on, 0 from where it comes as high over the flat base as over the smooth one. Not above 0 where
    /// there is no lift.
    #[inline]
    pub fn raised(&self, wi: Vec3) -> f32 {
        let (flat, smooth) = (dot(wi, self.ng), dot(wi, self.ns));
        let lower = smooth - flat;
        let all = smooth.abs();
        if !(dot(self.lift, self.lift) > 0.0 && lower > 0.0) {
            0.0
        } else if lower < all {
            lower / all
        } else {
            1.0
        }
    }

    /// A direction that stands to the flat base as the result stands to the smooth one: turned as `ng` is turned to
    /// `ns`, the shortest way.
    #[inline]
    pub fn smoothed(&self, v: Vec3) -> Vec3 {
        let both = self.ng + self.ns;
        // |both|² / 2, at least 1 since `ns` is on the side of `ng`.
        let half = 1.0 + dot(self.ng, self.ns);
        v - both * (dot(both, v) / half) + self.ns * (2.0 * dot(self.ng, v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scene::TestScene;

    const W: Vec3 = Vec3::new(0.5, 0.25, 0.25);

    /// A square's triangle, its normals leaning outwards by as much as its vertices are from the middle, or inwards.
    fn bulging(factor: f32) -> BaseTriangle {
        let mut scene = TestScene::squares(&[0.0]);
        for vertex in &mut scene.vertices {
            vertex.normal = (Vec3::Z + vertex.position * Vec3::new(factor, factor, 0.0)).normalize();
        }
        BaseTriangle::load(&scene.view(), 0)
    }

    #[test]
    fn turning_takes_the_flat_normal_to_the_smooth_one_and_keeps_angles() {
        let base = SmoothBase::new(&bulging(0.5), W, Vec3::X, false);
        assert!(base.smoothed(base.ng).distance(base.ns) < 1e-6, "{base:?}");
        let (a, b) = (Vec3::new(0.3, -0.5, 0.8), Vec3::new(-0.2, 0.1, 0.4));
        assert!((base.smoothed(a).dot(base.smoothed(b)) - a.dot(b)).abs() < 1e-6);
        let axis = base.ng.cross(base.ns).normalize();
        assert!(base.smoothed(axis).distance(axis) < 1e-6, "the shortest way leaves the axis");
    }

    /// By hand: normals at the square's corners are (x, y, 2) / sqrt(6), so that p is below their planes by
    /// (p_i - p) · n_i.
    #[test]
    fn lift_leads_to_the_tangent_planes() {
        let base = bulging(0.5);
        let p = base.p0 * W.x + base.p1 * W.y + base.p2 * W.z;
        let by_hand: Vec3 = [(base.p0, base.n0, 0.5), (base.p1, base.n1, 0.25), (base.p2, base.n2, 0.25)]
            .into_iter()
            .map(|(corner, n, b)| n * (corner - p).dot(n).max(0.0) * b)
            .sum();
        let lift = SmoothBase::new(&base, W, Vec3::X, false).lift;
        assert!(lift.distance(by_hand) < 1e-6 && lift.z > 0.1, "{lift} {by_hand}");
        assert_eq!(SmoothBase::new(&base, W, Vec3::X, true).lift, Vec3::ZERO, "hollow from inside");
        let hollow = bulging(-0.5);
        assert_eq!(SmoothBase::new(&hollow, W, Vec3::X, false).lift, Vec3::ZERO);
        assert!(SmoothBase::new(&hollow, W, Vec3::X, true).lift.z < -0.1);
        let flat = SmoothBase::new(&bulging(0.0), W, Vec3::X, false);
        assert_eq!((flat.ng, flat.ns, flat.lift), (Vec3::Z, Vec3::Z, Vec3::ZERO));
        assert_eq!(SmoothBase::new(&base, Vec3::X, Vec3::X, false).lift, Vec3::ZERO, "at a vertex");
    }

    #[test]
    fn slivers_have_the_normal_of_what_was_hit() {
        let mut scene = TestScene::squares(&[0.0]);
        scene.vertices.iter_mut().for_each(|vertex| vertex.position.y = vertex.position.x);
        let base = SmoothBase::new(&BaseTriangle::load(&scene.view(), 0), W, Vec3::Y, false);
        assert_eq!((base.ng, base.ns, base.lift), (Vec3::Y, Vec3::Y, Vec3::ZERO));
        assert_eq!(base.smoothed(Vec3::X), Vec3::X);
    }

    #[test]
    fn light_asks_for_as_much_of_the_lift_as_the_flat_base_is_lower() {
        let base = SmoothBase { ng: Vec3::Z, ns: Vec3::new(0.6, 0.0, 0.8), lift: Vec3::Z };
        assert_eq!(base.raised(Vec3::Z), 0.0);
        assert_eq!(base.raised(Vec3::X), 1.0);
        assert_eq!(base.raised(-Vec3::X), 0.0, "higher over the flat one");
        // 0.36 over the flat one; 0.6 (1 - 0.36²)^½ + 0.8 · 0.36 over the smooth one.
        let wi = Vec3::new(0.9329523, 0.0, 0.36);
        let smooth = 0.6 * wi.x + 0.8 * 0.36;
        assert!((base.raised(wi) - (smooth - 0.36) / smooth).abs() < 1e-6);
        assert_eq!(SmoothBase { lift: Vec3::ZERO, ..base }.raised(Vec3::X), 0.0);
    }

    /// Light from behind the flat base alone asks for the whole lift, light from behind both for the rest of it.
    #[test]
    fn light_asks_for_no_more_than_the_lift() {
        let base = SmoothBase { ng: Vec3::Z, ns: Vec3::new(0.6, 0.0, 0.8), lift: Vec3::Z };
        assert_eq!(base.raised(Vec3::new(0.96, 0.0, -0.28)), 1.0);
        assert!((base.raised(-Vec3::Z) - 0.25).abs() < 1e-6, "1 and 0.8 deep");
    }

    #[test]
    fn turning_and_placing_keep_the_lift_where_it_leads() {
        let base = SmoothBase { ng: Vec3::Z, ns: Vec3::new(0.6, 0.0, 0.8), lift: Vec3::Z };
        let behind = base.turned(true);
        assert_eq!((behind.ng, behind.ns, behind.lift), (-base.ng, -base.ns, base.lift));
        assert_eq!(base.turned(false).ng, base.ng);
        let placed = base.placed(&Instance {
            world_from_object: [[2.0, 0.0, 0.0, 5.0], [0.0, 2.0, 0.0, 6.0], [0.0, 0.0, 2.0, 7.0]],
            object_from_world: [[0.5, 0.0, 0.0, -2.5], [0.0, 0.5, 0.0, -3.0], [0.0, 0.0, 0.5, -3.5]],
            ..Instance::default()
        });
        assert_eq!((placed.ng, placed.lift), (Vec3::Z, Vec3::Z * 2.0));
    }

    #[test]
    fn lift_is_none_where_a_normal_is_on_the_other_side() {
        let mut opposite = bulging(0.5);
        opposite.n1 = -opposite.n1;
        assert_eq!(SmoothBase::new(&opposite, W, Vec3::X, true).lift, Vec3::ZERO);
    }

    #[test]
    fn base_is_the_same_whichever_way_a_triangle_is_stored() {
        let scene = TestScene::squares(&[0.0]).flipped();
        let flipped = SmoothBase::new(&BaseTriangle::load(&scene.view(), 0), W, Vec3::X, false);
        assert_eq!((flipped.ng, flipped.ns), (Vec3::Z, Vec3::Z));
    }
}

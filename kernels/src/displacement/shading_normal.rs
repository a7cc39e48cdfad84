//! Shading normals: those of the relief over the smooth surface that the base mesh stands for, so that a few
//! micro-triangles shade like many, and a few base triangles like a smooth base.

use crate::barycentric::interpolate;
use crate::displacement::surface::{BaseTriangle, HeightField, NO_DIRECTION};
use crate::displacement::vector;
use crate::interface::{displacement_kind, normals};
use crate::math::{cross, dot, sqrt, unit};
use glam::Vec3;

/// How a height field goes on around a point: A + h'_1 d and B + h'_2 d in [`BaseTriangle::shading_normal`].
#[derive(Clone, Copy)]
pub(super) struct Derivatives {
    /// The height there.
    pub(super) height: f32,
    /// A.
    pub(super) a: Vec3,
    /// B.
    pub(super) b: Vec3,
    /// What heights are along.
    pub(super) d: Vec3,
    /// The interpolated vertex normal as a unit vector: d, but of linear directions d / |d|. NaN where normals cancel.
    pub(super) n: Vec3,
    /// h'_1.
    pub(super) h1: f32,
    /// h'_2.
    pub(super) h2: f32,
    /// Whether there is a direction to displace in.
    is_displaced: bool,
}

impl BaseTriangle {
    /// Unit normal, to the outside of the base mesh, of the displaced smooth surface at barycentric coordinates `w`;
    /// `ng`, the micro-triangle's there, where there is none: where the two derivatives are parallel or not finite, and
    /// where interpolated normals cancel, so that there is no direction to displace in.
    ///
    /// The surface that is traced is S = P + h d with d = n / |n| for normalised directions, d = n for linear ones, P
    /// and n interpolated, h the filtered height at the interpolated texture coordinates t. Its derivative along a
    /// barycentric direction, from vertex 0 to vertex 1 or 2, is
    ///
    ///   S' = P' + h d' + h' d,  h' = grad h · t',  d' = (n' - d (d · n')) / |n| or n',
    ///
    /// exactly, where the filter has no kink. Its normal is the cross product of the two, of which d × d drops out:
    ///
    ///   A × B + h'_1 (d × B) + h'_2 (A × d),  A = P'_1 + h d'_1,  B = P'_2 + h d'_2.
    ///
    /// P is flat over a base triangle, where the surface that the mesh stands for has the normal N = n / |n|. So only
    /// what of A × B is along N is taken, which is the cross product of the parts of A and B in the plane across N: the
    /// sum is then Blinn's ("Simulation of Wrinkled Surfaces", SIGGRAPH 1978), of a base with these tangents, normal N
    /// and relief h; Blinn drops h d' as well. It is N where h' is 0, and the normal of S where N is that of the
    /// triangle. Hoetzlein's N + (n_S - n_P), the unit normals of S and P, is the same to first order of the slopes.
    ///
    /// N points to the side of the triangle's own normal: it is turned round where vertex normals point inside.
    ///
    /// Where maps are filtered by their levels, h' leaves out that the level changes along the surface: by less than
    /// 0.7 times the angle of a pixel, since levels differ by less than half a pixel.
    ///
    /// It is that of the triangle's own height field, also where a seam decides heights and directions at its border.
    /// A triangle of no extent in the map has h' = 0. `ng` may lie on the other side, or more than a right angle away,
    /// where a micro-triangle spans a relief too steep for it.
    #[inline]
    pub fn shading_normal(&self, field: &HeightField<'_>, w: Vec3, ng: Vec3) -> Vec3 {
        if field.kind != displacement_kind::HEIGHT {
            return vector::shading_normal(field, self, w, ng);
        }
        let surface = self.derivatives(field, w);
        let Derivatives { a, b, d, n, h1, h2, .. } = surface;
        let across = n * dot(n, cross(a, b));
        let normal = unit(across + cross(d, b) * h1 + cross(a, d) * h2);
        let outward = if self.flipped { -normal } else { normal };
        if surface.is_displaced { or_geometric(outward, ng) } else { ng }
    }

    /// The derivatives of the surface of the triangle's own height field at barycentric coordinates `w`: see
    /// [`shading_normal`](Self::shading_normal).
    #[inline]
    pub(super) fn derivatives(&self, field: &HeightField<'_>, w: Vec3) -> Derivatives {
        let n = interpolate(w, self.n0, self.n1, self.n2);
        let (n1, n2) = (self.n1 - self.n0, self.n2 - self.n0);
        let length = sqrt(dot(n, n));
        let linear = field.normals == normals::LINEAR;
        let (d, d1, d2) = if linear {
            (n, n1, n2)
        } else {
            let d = n / length;
            (d, (n1 - d * dot(d, n1)) / length, (n2 - d * dot(d, n2)) / length)
        };
        let uv = self.uv(w);
        let pixel = self.pixel(field, w);
        let h = field.height(&self.map, uv, pixel);
        let gradient = field.height_gradient(&self.map, uv, pixel);
        let (h1, h2) = (gradient.dot(self.t1 - self.t0), gradient.dot(self.t2 - self.t0));
        Derivatives {
            height: h,
            a: self.p1 - self.p0 + d1 * h,
            b: self.p2 - self.p0 + d2 * h,
            d,
            n: n / length,
            h1,
            h2,
            is_displaced: linear || length > NO_DIRECTION,
        }
    }

    /// The interpolated vertex normal at `w` as a unit vector on the side of `ng`, or `ng` where there is none.
    #[inline]
    pub fn vertex_normal(&self, w: Vec3, ng: Vec3) -> Vec3 {
        let n = interpolate(w, self.n0, self.n1, self.n2);
        let normal = if dot(n, n) > NO_DIRECTION * NO_DIRECTION { unit(n) } else { ng };
        or_geometric(if dot(normal, ng) < 0.0 { -normal } else { normal }, ng)
    }
}

/// `normal` where it is a unit vector, `ng` where it is none but NaN.
#[inline]
pub(super) fn or_geometric(normal: Vec3, ng: Vec3) -> Vec3 {
    if dot(normal, normal) > 0.5 { normal } else { ng }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Features;
    use crate::test_scene::{FLAT, TestScene};

    const W: Vec3 = Vec3::new(0.5, 0.25, 0.25);
    /// None that any surface of these tests has.
    const NG: Vec3 = Vec3::new(0.0, -0.6, 0.8);

    /// The shading normal of a scene's first triangle at [`W`], or [`NG`].
    fn at_w(scene: &TestScene, normals: u32) -> Vec3 {
        let view = scene.view();
        let field = HeightField::new(&view, Features { normals, smooth: 1, ..FLAT });
        BaseTriangle::load(&view, 0).shading_normal(&field, W, NG)
    }

    /// Heights that rise by a half for a unit of u, which is x: h = (u + 1) / 2 between texel centres 0.25 and 0.75.
    fn ramp() -> TestScene {
        let mut scene = TestScene::squares(&[0.0]);
        let map = &mut scene.displacements[0];
        (map.map_width, map.map_height, map.scale) = (2, 1, 0.25);
        scene.height_texels = vec![0.0_f32.to_bits(), 1.0_f32.to_bits()];
        scene.vertices.iter_mut().for_each(|vertex| vertex.u = 0.5 + vertex.position.x * 0.25);
        scene
    }

    #[test]
    fn ramp_leans_by_its_slope() {
        // A texel step of 0.25 for 0.5 of u, for 2 of x: the surface rises by 1/8 for 1.
        let expected = Vec3::new(-0.125, 0.0, 1.0).normalize();
        for scene in [ramp(), ramp().flipped()] {
            for normals in [normals::NORMALIZED, normals::LINEAR] {
                let normal = at_w(&scene, normals);
                assert!(normal.distance(expected) < 1e-6, "{normal} {expected}");
            }
        }
    }

    /// On a flat triangle whose vertex normals lean, the interpolated normal; with a ramp, Blinn's normal by hand.
    #[test]
    fn base_normals_are_the_interpolated_ones() {
        for normals in [normals::NORMALIZED, normals::LINEAR] {
            let mut scene = ramp();
            for vertex in &mut scene.vertices {
                vertex.normal = (Vec3::Z + vertex.position * 0.4).normalize();
            }
            let [n0, n1, n2] = scene.triangles[0].vertices.map(|v| scene.vertices[v as usize].normal);
            let n = n0 * W.x + n1 * W.y + n2 * W.z;
            let unit = n.normalize();
            // Heights of 1/8 for a unit of x, along n or a unit vector; that slope in the plane across n, where a step
            // of x is as long as what of it lies there.
            let slope = if normals == normals::LINEAR { n.length() } else { 1.0 } / 8.0;
            let h = at_w(&scene, normals);
            scene.displacements[0].scale = 0.0;
            assert!(at_w(&scene, normals).distance(unit) < 1e-6);
            // The base alone bends A and B: heights there are below 1/8 of it, and their share of A and B is 0.4 h.
            let (a, b) = (Vec3::X - unit * unit.x, Vec3::Y - unit * unit.y);
            let by_hand = (a + unit * slope).cross(b).normalize();
            assert!(h.distance(by_hand) < 0.125 * 0.4 * 0.125, "{h} {by_hand}");
        }
    }

    #[test]
    fn triangle_without_extent_in_the_map_has_the_normal_of_its_level() {
        let mut scene = ramp();
        scene.vertices.iter_mut().for_each(|vertex| vertex.u = 0.5);
        assert_eq!(at_w(&scene, normals::NORMALIZED), Vec3::Z);
    }

    #[test]
    fn surface_without_a_normal_takes_the_geometric_one() {
        // Normals cancel at W: half of vertex 0 against a quarter of each of the others.
        let mut cancelling = ramp();
        cancelling.vertices[0].normal = -Vec3::Z;
        assert_eq!(at_w(&cancelling, normals::NORMALIZED), NG);
        // All points displaced onto one: P + h n with n = -P / h.
        let mut collapsed = TestScene::squares(&[1.0]);
        (collapsed.displacements[0].scale, collapsed.displacements[0].zero) = (1.0, -1.0);
        collapsed.vertices.iter_mut().for_each(|vertex| vertex.normal = -vertex.position);
        assert_eq!(at_w(&collapsed, normals::LINEAR), NG);
        // Heights beyond what a float holds.
        let mut endless = ramp();
        endless.displacements[0].scale = f32::MAX;
        endless.vertices.iter_mut().for_each(|vertex| vertex.u *= 1e9);
        assert_eq!(at_w(&endless, normals::NORMALIZED), NG);
    }
}

//! Vector displacement: P' = P + F d (Volovar 2016, formula (4)), where the columns of F are the tangent, the bitangent
//! and the normal, or x, y and z. So the surface may hang over, and fold back under itself.
//!
//! Tangents, bitangents and normals are given at vertices and interpolated linearly, each for itself. What becomes of
//! normals under heights becomes of all three here (formula (4) leaves it open): where directions are normalised they
//! are unit vectors again, so that components keep their meaning as lengths, and a vector is no longer than its
//! components together, also where normals cancel. So a vector along the normal alone gives the micro-vertex of the
//! same height to the bit.
//!
//! On seams the vectors of all sides are averaged, each along the axes that its side interpolates.

use crate::barycentric::{interpolate, interpolate2};
use crate::displacement::shading_normal::or_geometric;
use crate::displacement::surface::{
    BaseTriangle, HeightField, Pixel, along_edge, component, corner_at, edge_at,
};
use crate::interface::{SeamSide, Seams, displacement_kind, normals};
use crate::math::{cross, dot, fma3, unit};
use glam::{Vec2, Vec3};

/// A triangle, or an edge of one, as its map is read.
#[derive(Clone, Copy)]
pub(super) struct Source {
    /// Index of the first of its map's three.
    pub(super) displacement: u32,
    /// Its vertices. Of an edge the last one counts for nothing.
    pub(super) vertices: [u32; 3],
}

/// What is known of a vertex.
#[derive(Clone, Copy)]
pub(super) struct Corner {
    /// Its texture coordinates.
    pub(super) uv: Vec2,
    tangent: Vec3,
    bitangent: Vec3,
    normal: Vec3,
}

impl Source {
    /// A whole base triangle.
    #[inline]
    pub(super) fn of_triangle(base: &BaseTriangle) -> Source {
        Source { displacement: base.displacement, vertices: base.vertices }
    }

    /// A side of a seam.
    #[inline]
    pub(super) fn of_side(side: &SeamSide) -> Source {
        let [start, end] = side.vertices;
        Source { displacement: side.displacement, vertices: [start, end, end] }
    }

    /// Its vertices, one after the other.
    #[inline]
    pub(super) fn corners(&self, field: &HeightField<'_>) -> [Corner; 3] {
        let [a, b, c] = self.vertices;
        [Corner::load(field, a), Corner::load(field, b), Corner::load(field, c)]
    }
}

impl Corner {
    #[inline]
    fn load(field: &HeightField<'_>, i: u32) -> Corner {
        let vertex = field.vertex(i);
        let uv = Vec2::new(vertex.u, vertex.v);
        if field.kind == displacement_kind::OBJECT {
            return Corner { uv, tangent: Vec3::X, bitangent: Vec3::Y, normal: Vec3::Z };
        }
        let tangent = field.tangent(i);
        let bitangent = cross(vertex.normal, tangent.direction) * tangent.sign;
        Corner { uv, tangent: tangent.direction, bitangent, normal: vertex.normal }
    }

    /// Axis 0, 1 or 2.
    #[inline]
    pub(super) fn axis(&self, i: u32) -> Vec3 {
        component([self.tangent, self.bitangent, self.normal], i)
    }
}

/// The sides that decide a place on a triangle's border.
#[derive(Clone, Copy)]
pub(super) struct Sides {
    /// The first one's place in the table.
    pub(super) first: u32,
    /// How many there are; none where the triangle decides alone.
    pub(super) count: u32,
}

impl Sides {
    pub(super) const NONE: Sides = Sides { first: 0, count: 0 };

    /// Those of corner `e`.
    #[inline]
    pub(super) fn of_corner(seams: &Seams, e: u32) -> Sides {
        let decided = seams.flags >> e & 1 != 0;
        let count = if decided { component(seams.reading_count, e) } else { 0 };
        Sides { first: component(seams.first_reading, e), count }
    }

    /// Those of edge `e`.
    #[inline]
    pub(super) fn of_edge(seams: &Seams, e: u32) -> Sides {
        let decided = seams.flags >> (3 + e) & 1 != 0;
        let count = if decided { component(seams.side_count, e) } else { 0 };
        Sides { first: component(seams.first_side, e), count }
    }
}

/// The micro-vertex of `base` at barycentric coordinates `w`, a point of its grid, over the point `p` of the base
/// triangle. `on_seam`: whether `w` is on the border and some of that is decided with neighbours.
///
/// As with heights every operation is fused or fixed in order, and what decides a place on the border is the same for
/// all triangles there.
#[inline]
pub(super) fn micro_vertex(
    field: &HeightField<'_>,
    base: &BaseTriangle,
    w: Vec3,
    p: Vec3,
    on_seam: bool,
) -> Vec3 {
    let (mut sides, mut along) = (Sides::NONE, w);
    if on_seam {
        let seams = base.seams(field);
        let corner = corner_at(w);
        if corner < 3 {
            // A reading is a side of no length.
            (sides, along) = (Sides::of_corner(&seams, corner), Vec3::X);
        } else {
            let edge = edge_at(w);
            (sides, along) = (Sides::of_edge(&seams, edge), along_edge(w, edge));
        }
    }
    let alone = sides.count == 0;
    let count = if alone { 1 } else { sides.count };
    let mut point = if alone { p } else { Vec3::ZERO };
    let mut i = 0;
    while i < count {
        let (source, w) = if alone {
            (Source::of_triangle(base), w)
        } else {
            (Source::of_side(&field.seam_side(sides.first + i)), along)
        };
        point = displaced(field, source, w, field.pixel_at(p, w, source.vertices), point);
        i += 1;
    }
    if alone { point } else { fma3(1.0 / count as f32, point, p) }
}

/// `start` displaced by the vector that `source` gives at barycentric coordinates `w`, to the `pixel` there.
#[inline]
fn displaced(field: &HeightField<'_>, source: Source, w: Vec3, pixel: Pixel, start: Vec3) -> Vec3 {
    let [a, b, c] = source.corners(field);
    let uv = interpolate2(w, a.uv, b.uv, c.uv);
    let mut point = start;
    // A loop, so that the code of a filter stands in a kernel once.
    let mut i = 0;
    while i < 3 {
        let height = field.height(&field.displacement(source.displacement + i), uv, pixel);
        if field.kind == displacement_kind::OBJECT {
            point = fma3(height, a.axis(i), point);
        } else {
            let axis = interpolate(w, a.axis(i), b.axis(i), c.axis(i));
            point = fma3(field.lift(height, axis), axis, point);
        }
        i += 1;
    }
    point
}

/// [`BaseTriangle::shading_normal`] of a surface that vectors displace: S = P + sum over axes of h a / |a|, or h a for
/// linear directions and in object space, whose derivatives add h' a / |a| + h (a' - a (a · a') / |a|²) / |a| for each.
/// The normal is their cross product; `ng` where they are parallel or not finite, and an axis that vanishes adds
/// nothing.
///
/// As with heights P' has only what is across the interpolated vertex normal N, and so has the derivative of the axis
/// that is the normal; P' is whole where normals cancel. N points to the side of the triangle's own normal.
#[inline]
pub fn shading_normal(field: &HeightField<'_>, base: &BaseTriangle, w: Vec3, ng: Vec3) -> Vec3 {
    let source = Source::of_triangle(base);
    let [a, b, c] = source.corners(field);
    let uv = interpolate2(w, a.uv, b.uv, c.uv);
    let pixel = base.pixel(field, w);
    let n = or_zero(unit(interpolate(w, base.n0, base.n1, base.n2)));
    let (e1, e2) = (base.p1 - base.p0, base.p2 - base.p0);
    let (mut s1, mut s2) = (e1 - n * dot(n, e1), e2 - n * dot(n, e2));
    let mut i = 0;
    while i < 3 {
        let map = field.displacement(source.displacement + i);
        let (height, gradient) = (field.height(&map, uv, pixel), field.height_gradient(&map, uv, pixel));
        let (h1, h2) = (gradient.dot(b.uv - a.uv), gradient.dot(c.uv - a.uv));
        let axis = interpolate(w, a.axis(i), b.axis(i), c.axis(i));
        let (mut a1, mut a2) = (b.axis(i) - a.axis(i), c.axis(i) - a.axis(i));
        let mut shrink = 1.0;
        if field.kind != displacement_kind::OBJECT && field.normals != normals::LINEAR {
            shrink = field.lift(1.0, axis);
            let unit_axis = axis * shrink;
            a1 -= unit_axis * dot(unit_axis, a1);
            a2 -= unit_axis * dot(unit_axis, a2);
        } else if i == 2 {
            // Of normalised normals that is done. In object space the axis is z, and these are 0.
            a1 -= n * dot(n, a1);
            a2 -= n * dot(n, a2);
        }
        s1 += (axis * h1 + a1 * height) * shrink;
        s2 += (axis * h2 + a2 * height) * shrink;
        i += 1;
    }
    let normal = unit(cross(s1, s2));
    or_geometric(if base.flipped { -normal } else { normal }, ng)
}

/// `v`, or zero where it is NaN.
#[inline]
fn or_zero(v: Vec3) -> Vec3 {
    if dot(v, v) > 0.5 { v } else { Vec3::ZERO }
}

/// The components of the vector that the map at `displacement` has at texture coordinates `uv`, to the `pixel` there.
#[inline]
pub fn components(field: &HeightField<'_>, displacement: u32, uv: Vec2, pixel: Pixel) -> Vec3 {
    let mut components = Vec3::ZERO;
    let mut i = 0;
    while i < 3 {
        let height = field.height(&field.displacement(displacement + i), uv, pixel);
        components += height * component([Vec3::X, Vec3::Y, Vec3::Z], i);
        i += 1;
    }
    components
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interface::{Displacement, Tangent, Vertex};
    use crate::math::tests::Numbers;
    use crate::scene::Features;
    use crate::test_scene::{FLAT, TestScene};

    /// A triangle with leaning normals and tangents, whose vectors are linear in u and v but for kinks on texel
    /// centres.
    fn bent(numbers: &mut Numbers) -> TestScene {
        let mut scene = TestScene::squares(&[0.0]);
        let lean = |numbers: &mut Numbers, v: Vec3| (v + numbers.vec3() * 0.3).normalize();
        scene.vertices = (0..3)
            .map(|_| Vertex {
                position: numbers.vec3(),
                normal: lean(numbers, Vec3::Z),
                // Between the centres of the map's four texels.
                u: 0.3 + 0.4 * numbers.unit(),
                v: 0.3 + 0.4 * numbers.unit(),
            })
            .collect();
        scene.tangents = scene
            .vertices
            .iter()
            .map(|vertex| Tangent {
                direction: vertex.normal.cross(lean(numbers, Vec3::X)).normalize(),
                sign: if numbers.unit() < 0.5 { -1.0 } else { 1.0 },
            })
            .collect();
        scene.height_texels = (0..12).map(|_| numbers.unit().to_bits()).collect();
        let map = |first_word| Displacement {
            map_width: 2,
            map_height: 2,
            scale: 0.3,
            zero: 0.4,
            first_word,
            ..scene.displacements[0]
        };
        scene.displacements = vec![map(0), map(4), map(8)];
        scene
    }

    /// Against central differences of the points themselves, which the oracle judges elsewhere; what of them is the
    /// base triangle's slope along the interpolated normal, and of linear directions the slope of the normal's own
    /// length, is taken out.
    #[test]
    fn shading_normals_are_at_right_angles_to_the_surface() {
        const STEP: f32 = 1.0 / 256.0;
        let mut numbers = Numbers::new(71);
        for round in 0..2000 {
            let scene = bent(&mut numbers);
            let features = Features {
                displacement: [displacement_kind::TANGENT, displacement_kind::OBJECT][round % 2],
                normals: [normals::NORMALIZED, normals::LINEAR][round / 2 % 2],
                ..FLAT
            };
            let view = scene.view();
            let (field, base) = (HeightField::new(&view, features), BaseTriangle::load(&view, 0));
            let w = Vec3::new(0.4, 0.3, 0.3);
            let point = |w: Vec3| {
                let p = interpolate(w, base.p0, base.p1, base.p2);
                displaced(&field, Source::of_triangle(&base), w, Pixel::NONE, p)
            };
            let slope = |along: Vec3| (point(w + along * STEP) - point(w - along * STEP)) / (2.0 * STEP);
            let n = interpolate(w, base.n0, base.n1, base.n2).normalize();
            let is_linear = features.normals == normals::LINEAR;
            let along_normal = is_linear && features.displacement == displacement_kind::TANGENT;
            let h = if along_normal {
                components(&field, base.displacement, base.uv(w), Pixel::NONE).z
            } else {
                0.0
            };
            let smooth = |along, edge: Vec3, turn: Vec3| slope(along) - n * n.dot(edge + turn * h);
            let s1 = smooth(Vec3::new(-1.0, 1.0, 0.0), base.p1 - base.p0, base.n1 - base.n0);
            let s2 = smooth(Vec3::new(-1.0, 0.0, 1.0), base.p2 - base.p0, base.n2 - base.n0);
            let area = s1.cross(s2).length();
            if area < 0.1 {
                continue;
            }
            let normal = shading_normal(&field, &base, w, Vec3::ZERO);
            // Points are of size 2 and off by some 10 u: the slopes by 3e-4; third derivatives of unit vectors that
            // lean so little are below 10, which the square of the step makes as much.
            let off = normal.dot(s1).abs().max(normal.dot(s2).abs());
            assert!(off < 1e-3 && (normal.length() - 1.0).abs() < 1e-5, "{off} in round {round}: {normal}");
        }
    }
}

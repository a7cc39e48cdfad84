//! Vector displacement: P' = P + F d (Volovar 2016, formula (4)), where the columns of F are the tangent, the bitangent
//! and the normal, or x, y and z. So the surface may hang over, and fold back under itself.
//!
//! Tangents, bitangents and normals are given at vertices and interpolated linearly, each for itself. What becomes of
//! normals under heights becomes of all three here (formula (4) leaves it open): where directions are normalised they are
//! unit vectors again, so that components keep their meaning as lengths, and a vector is no longer than its components
//! together, also where normals cancel. So a vector along the normal alone gives the micro-vertex of the same
//! height to the bit.
//!
//! On seams the vectors of all sides are averaged, each along the axes that its side interpolates.

use crate::barycentric::{interpolate, interpolate2};
use crate::displacement::surface::{BaseTriangle, HeightField, along_edge, component, corner_at, edge_at};
use crate::interface::{SeamSide, Seams, displacement_kind};
use crate::math::{cross, fma3};
use glam::{Vec2, Vec3};

/// A triangle, or an edge of one, as its map is read.
#[derive(Clone, Copy)]
pub(super) struct Source {
    /// Index of the first of its map's three.
    pub(super) displacement: u32,
    /// Its vertices. Of an edge the last one counts for nothing.
    vertices: [u32; 3],
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
        point = displaced(field, source, w, point);
        i += 1;
    }
    if alone { point } else { fma3(1.0 / count as f32, point, p) }
}

/// `start` displaced by the vector that `source` gives at barycentric coordinates `w`.
#[inline]
fn displaced(field: &HeightField<'_>, source: Source, w: Vec3, start: Vec3) -> Vec3 {
    let [a, b, c] = source.corners(field);
    let uv = interpolate2(w, a.uv, b.uv, c.uv);
    let mut point = start;
    // A loop, so that the code of a filter stands in a kernel once.
    let mut i = 0;
    while i < 3 {
        let height = field.height(&field.displacement(source.displacement + i), uv);
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

/// The components of the vector that the map at `displacement` has at texture coordinates `uv`.
#[inline]
pub fn components(field: &HeightField<'_>, displacement: u32, uv: Vec2) -> Vec3 {
    let mut components = Vec3::ZERO;
    let mut i = 0;
    while i < 3 {
        let height = field.height(&field.displacement(displacement + i), uv);
        components += height * component([Vec3::X, Vec3::Y, Vec3::Z], i);
        i += 1;
    }
    components
}

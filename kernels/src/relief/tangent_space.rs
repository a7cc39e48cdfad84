//! The tangent space of a base triangle: texture coordinates and heights over its plane, and rays in it.

use crate::barycentric::interpolate;
use crate::displacement::height_pyramid::{texel_coordinates, top_level};
use crate::displacement::surface::{BaseTriangle, HeightField, Pixel};
use crate::interface::Displacement;
use crate::math::{cross, dot, unit};
use glam::{Vec2, Vec3};

/// The plane of a base triangle with the height field over it, as seen from a point of the triangle: heights are
/// along one axis, the interpolated normal of that point. (Published methods take the tangents of vertices, so that
/// rays bend at no edge of a map that is stretched; the triangle's own are exact where it is planar with parallel
/// normals.)
#[derive(Clone, Copy)]
pub struct TangentSpace<'a> {
    field: HeightField<'a>,
    base: BaseTriangle,
    pixel: Pixel,
    /// Unit vector that heights are along.
    axis: Vec3,
    /// Unit normal of the triangle in its stored order.
    normal: Vec3,
    /// Twice the triangle's area.
    area: f32,
}

/// A ray in tangent space, by its distance t in the space that its direction was given in.
#[derive(Clone, Copy, Debug)]
pub struct TangentRay {
    /// Texture coordinates at t = 0.
    start: Vec2,
    /// Their growth.
    rate: Vec2,
    /// Height at t = 0, in model units.
    height: f32,
    /// Its growth.
    climb: f32,
}

/// Where a ray is between the least and the greatest height of a map.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    /// Where it comes in.
    pub near: f32,
    /// Where it leaves; not below `near` if there is a span.
    pub far: f32,
    is_some: bool,
}

/// Where the interpolated normal is so flat on a triangle that this is its height over a unit, the triangle's own is
/// taken.
const LEAST_HEIGHT: f32 = 0.1;

impl<'a> TangentSpace<'a> {
    /// That of `base` at barycentric coordinates `w`.
    #[inline]
    pub fn new(field: &HeightField<'a>, base: &BaseTriangle, w: Vec3) -> Self {
        let across = cross(base.p1 - base.p0, base.p2 - base.p0);
        let normal = unit(across);
        let outward = if base.flipped { -normal } else { normal };
        let axis = unit(interpolate(w, base.n0, base.n1, base.n2));
        // Negated so that NaN counts.
        let axis = if !(dot(axis, normal).abs() > LEAST_HEIGHT) { outward } else { axis };
        let area = dot(across, normal);
        TangentSpace { field: *field, base: *base, pixel: base.pixel(field, w), axis, normal, area }
    }

    /// The ray from texture coordinates `uv` at `height` along `direction`, of any length, in the space of the mesh.
    ///
    /// With a the axis and n the triangle's normal the direction is d = a (d·n / a·n) + q, q in the plane; what of q
    /// is along the triangle's sides e1 and e2 are its growths of barycentric coordinates, which texture coordinates
    /// follow.
    #[inline]
    pub fn ray(&self, uv: Vec2, height: f32, direction: Vec3) -> TangentRay {
        let base = &self.base;
        let (e1, e2) = (base.p1 - base.p0, base.p2 - base.p0);
        let climb = dot(direction, self.normal) / dot(self.axis, self.normal);
        let q = direction - self.axis * climb;
        let b1 = dot(cross(q, e2), self.normal) / self.area;
        let b2 = dot(cross(e1, q), self.normal) / self.area;
        TangentRay { start: uv, rate: (base.t1 - base.t0) * b1 + (base.t2 - base.t0) * b2, height, climb }
    }

    /// The height at texture coordinates, which must be finite: as large a pixel as that of the point of the triangle.
    #[inline]
    pub fn height(&self, uv: Vec2) -> f32 {
        self.field.height(&self.base.map, uv, self.pixel)
    }

    /// The growth of heights along the triangle's first and its second side, from end to end.
    #[inline]
    pub fn slopes(&self, uv: Vec2) -> Vec2 {
        self.along_sides(self.field.height_gradient(&self.base.map, uv, self.pixel))
    }

    /// What grows by `gradient` for a unit of u and of v does along the triangle's first and its second side.
    #[inline]
    pub fn along_sides(&self, gradient: Vec2) -> Vec2 {
        let base = &self.base;
        Vec2::new(gradient.dot(base.t1 - base.t0), gradient.dot(base.t2 - base.t0))
    }

    /// Height of a texel step from 0 to 1.
    #[inline]
    pub fn scale(&self) -> f32 {
        self.base.map.scale
    }

    /// Interpolated tangent and bitangent at barycentric coordinates `w`, not normalised.
    #[inline]
    pub fn tangents(&self, w: Vec3) -> (Vec3, Vec3) {
        let [a, b, c] = self.base.vertices;
        let (a, b, c) = (self.field.tangent(a), self.field.tangent(b), self.field.tangent(c));
        let base = &self.base;
        let bitangents = (
            cross(base.n0, a.direction) * a.sign,
            cross(base.n1, b.direction) * b.sign,
            cross(base.n2, c.direction) * c.sign,
        );
        let tangent = interpolate(w, a.direction, b.direction, c.direction);
        (tangent, interpolate(w, bitangents.0, bitangents.1, bitangents.2))
    }

    /// Least and greatest height of the map.
    #[inline]
    pub fn heights(&self) -> (f32, f32) {
        (self.base.map.height_min, self.base.map.height_max)
    }

    /// The map's index, and how it goes on beyond its borders.
    #[inline]
    pub fn map(&self) -> (u32, u32) {
        (self.base.displacement, self.field.pyramid(self.base.map).wrap)
    }

    /// The level of the map's pyramid that is one entry.
    #[inline]
    pub fn top_level(&self) -> u32 {
        top_level(self.base.map.map_width, self.base.map.map_height)
    }

    /// Bounds on the heights between two points given in texel coordinates, by the map's pyramid.
    #[inline]
    pub fn heights_between(&self, low: Vec2, high: Vec2) -> (f32, f32) {
        let map = self.base.map;
        let range = self.field.pyramid(map).range_between(low, high);
        Displacement::height_range(range.min, range.max, map.zero, map.scale)
    }

    /// The normal of the relief where heights have these [`slopes`](Self::slopes): Blinn's formulas (2) and (3),
    ///
    ///   n' = n + (h_u (a × p_v) - h_v (a × p_u)),  a = n / |n|,
    ///
    /// with the triangle's sides for p_u and p_v, which gives the same for any parameters of a plane. n has the
    /// length of p_u × p_v and the direction of `ns`, the triangle's own normal or a smooth one, to the outside. To
    /// the bit `ns` where slopes are 0, and `ns` where there is no normal.
    #[inline]
    pub fn normal(&self, slopes: Vec2, ns: Vec3) -> Vec3 {
        let (e1, e2) = (self.base.p1 - self.base.p0, self.base.p2 - self.base.p0);
        let side = if self.base.flipped { -1.0 } else { 1.0 };
        let change = cross(self.axis, e2) * slopes.x - cross(self.axis, e1) * slopes.y;
        let normal = unit(ns * self.area + change * side);
        let is_one = dot(normal, normal) > 0.5 && (slopes.x != 0.0 || slopes.y != 0.0);
        if is_one { normal } else { ns }
    }
}

impl TangentRay {
    /// Texture coordinates at distance `t`.
    #[inline]
    pub fn uv(&self, t: f32) -> Vec2 {
        self.start + self.rate * t
    }

    /// Texel coordinates at distance `t`, and their growth.
    #[inline]
    pub fn texels(&self, space: &TangentSpace<'_>, t: f32) -> (Vec2, Vec2) {
        let map = &space.base.map;
        let size = Vec2::new(map.map_width as f32, -(map.map_height as f32));
        (texel_coordinates(map, self.uv(t)), self.rate * size)
    }

    /// It in cells of a distance map: where it starts and how it grows, with so many cells along each `side` of the
    /// map, and `depth` of them for a unit of height from `low` on.
    #[inline]
    pub fn cells(&self, side: f32, low: f32, depth: f32) -> (Vec3, Vec3) {
        let start = Vec3::new(self.start.x * side, side - self.start.y * side, (self.height - low) * depth);
        (start, Vec3::new(self.rate.x * side, -self.rate.y * side, self.climb * depth))
    }

    /// How far beyond distance `from` it comes to the first of heights `low` and `high` from its side; negative where
    /// it is between them.
    #[inline]
    pub fn time_to(&self, (low, high): (f32, f32), from: f32) -> f32 {
        let first = if self.climb < 0.0 { high } else { low };
        (first - self.height) / self.climb - from
    }

    /// How far it is at distance `t` from the height field on the side that it comes from, in heights: above 0 while
    /// a ray that goes down is above the relief, or one that goes up below it.
    #[inline]
    pub fn clearance(&self, space: &TangentSpace<'_>, t: f32) -> f32 {
        let above = self.height + self.climb * t - space.height(self.uv(t));
        if self.climb < 0.0 { above } else { -above }
    }

    /// How fast its height grows.
    #[inline]
    pub fn climb(&self) -> f32 {
        self.climb
    }

    /// Where from distance `least` on it is between heights `low` and `high`; none where it keeps its height, or
    /// would run beyond what floats hold.
    #[inline]
    pub fn span(&self, (low, high): (f32, f32), least: f32) -> Span {
        let (first, last) = if self.climb < 0.0 { (high, low) } else { (low, high) };
        let near = ((first - self.height) / self.climb).max(least);
        let far = ((last - self.height) / self.climb).max(near);
        let is_some = self.uv(near).is_finite() && self.uv(far).is_finite() && self.climb != 0.0;
        Span { near, far, is_some }
    }
}

impl Span {
    /// Whether there is one.
    #[inline]
    pub fn is_some(&self) -> bool {
        self.is_some
    }

    /// What of it is no farther than `most`; its beginning where all of it is.
    #[inline]
    pub fn up_to(&self, most: f32) -> Span {
        Span { far: self.far.min(most).max(self.near), ..*self }
    }

    /// The distance at share `s` of it.
    #[inline]
    pub fn at(&self, s: f32) -> f32 {
        self.near + (self.far - self.near) * s
    }
}

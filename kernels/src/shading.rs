//! From a hit to a colour.

use crate::barycentric::{grid_point, interpolate};
use crate::bvh::traverse::{Query, traverse};
use crate::counters::Counts;
use crate::displacement::cell::Cell;
use crate::displacement::surface::{BaseTriangle, HeightField};
use crate::hit::Hit;
use crate::interface::{color_format, method, shade};
use crate::math::{at, cross, dot, gamma, next_down, next_up};
use crate::ray::TraversalRay;
use crate::sampler::pcg4d;
use crate::scene::{Features, SceneView};
use crate::texture::sample_color;
use glam::{UVec4, Vec2, Vec3};

/// A hit with what shading needs to know of the surface there.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceInteraction {
    /// The hit point, from the micro-triangle's barycentrics.
    pub point: Vec3,
    /// Bound on the error of each coordinate of `point`, as a distance from the micro-triangle's plane.
    pub point_error: Vec3,
    /// Unit geometric normal, to the outside of the base mesh.
    pub ng: Vec3,
    /// Texture coordinates.
    pub uv: Vec2,
    /// Height of the displacement there, in model units; 0 where nothing is displaced.
    pub height: f32,
}

impl SurfaceInteraction {
    /// The surface at `hit`, which must be one.
    ///
    /// The error of the point is that of a sum of three products of rounded barycentrics: gamma(7) |b_i p_i| in
    /// pbrt-v4 (section 6.8.5), gamma(12) here, since Vulkan's division may be off by 2.5 ulp.
    #[inline]
    pub fn new(scene: &SceneView<'_>, features: Features, hit: Hit) -> Self {
        let base = BaseTriangle::load(scene.vertices, at(scene.triangles, hit.primitive), hit.primitive);
        let (b1, b2) = (hit.b1, hit.b2);
        let b = Vec3::new(1.0 - b1 - b2, b1, b2);
        let field = HeightField::new(scene, features);
        let (p, w) = if features.method == method::NONE {
            ([base.p0, base.p1, base.p2], b)
        } else {
            let cell = Cell::unpack(hit.cell);
            let [q0, q1, q2] = base.micro_triangle(&field, cell);
            let n = field.displacement.subdivisions;
            let corner = |e: u32| {
                let (j, k) = cell.vertex(e);
                grid_point(j, k, n)
            };
            ([q0.position, q1.position, q2.position], interpolate(b, corner(0), corner(1), corner(2)))
        };
        let n = cross(p[1] - p[0], p[2] - p[0]).normalize();
        let uv = base.uv(w);
        SurfaceInteraction {
            point: interpolate(b, p[0], p[1], p[2]),
            point_error: interpolate(b.abs(), p[0].abs(), p[1].abs(), p[2].abs()) * gamma(12),
            ng: if base.flipped { -n } else { n },
            uv,
            height: if features.method == method::NONE { 0.0 } else { field.height(uv) },
        }
    }

    /// Where a ray towards `direction` can start so that rounding does not put it behind the surface: the point moved
    /// along the normal to the edge of its error box, then rounded away (pbrt-v4, section 6.8.6).
    #[inline]
    pub fn spawn_origin(&self, direction: Vec3) -> Vec3 {
        let n = if dot(direction, self.ng) < 0.0 { -self.ng } else { self.ng };
        let offset = n * dot(n.abs(), self.point_error);
        let origin = self.point + offset;
        Vec3::new(
            round_along(origin.x, offset.x),
            round_along(origin.y, offset.y),
            round_along(origin.z, offset.z),
        )
    }
}

/// The neighbour of `x` in the direction of `offset`.
#[inline]
fn round_along(x: f32, offset: f32) -> f32 {
    if offset > 0.0 {
        next_up(x)
    } else if offset < 0.0 {
        next_down(x)
    } else {
        x
    }
}

/// What the hit of a primary ray shows, as [`shade`] says: linear RGB. `steps` is what finding it cost.
#[inline]
pub fn shade_hit(
    scene: &SceneView<'_>,
    features: Features,
    ray: &TraversalRay,
    hit: Hit,
    steps: u32,
    counts: &mut Counts,
) -> Vec3 {
    if features.shade == shade::CELL {
        return cell_color(hit);
    }
    if features.shade == shade::STEPS {
        return heat(steps as f32 / scene.frame.steps_scale.max(1) as f32);
    }
    let surface = SurfaceInteraction::new(scene, features, hit);
    if features.shade == shade::NORMAL {
        surface.ng * 0.5 + Vec3::splat(0.5)
    } else if features.shade == shade::HEIGHT {
        let d = &scene.frame.displacement;
        let range = d.height_max - d.height_min;
        Vec3::splat(if range > 0.0 { (surface.height - d.height_min) / range } else { 0.0 })
    } else if features.shade == shade::UV {
        let uv = surface.uv - surface.uv.floor();
        Vec3::new(uv.x, uv.y, 0.0)
    } else {
        lit(scene, features, ray, hit, &surface, counts)
    }
}

/// Lambert and ambient light on a two-sided surface: albedo (ambient + sum over lights of I / d² cos), each light
/// seen through one shadow ray where shadows are on.
#[inline]
fn lit(
    scene: &SceneView<'_>,
    features: Features,
    ray: &TraversalRay,
    hit: Hit,
    surface: &SurfaceInteraction,
    counts: &mut Counts,
) -> Vec3 {
    let frame = scene.frame;
    let albedo = if features.color_format == color_format::NONE {
        frame.albedo
    } else {
        let (width, height) = (frame.color_width, frame.color_height);
        let (format, wrap) = (features.color_format, features.color_wrap);
        sample_color(scene.color_texels, format, wrap, width, height, surface.uv)
    };
    let facing = if dot(ray.direction, surface.ng) > 0.0 { -surface.ng } else { surface.ng };
    let mut light = Vec3::splat(frame.ambient);
    let mut i = 0;
    while i < frame.light_count {
        let source = at(scene.lights, i);
        let to_light = source.position - surface.point;
        let squared = to_light.dot(to_light);
        let distance = crate::math::sqrt(squared);
        let wi = to_light / distance;
        let cosine = wi.dot(facing);
        if cosine > 0.0 && !(features.shadows != 0 && occluded(scene, features, hit, surface, wi, source.position, counts))
        {
            light += source.color * (source.intensity * cosine / squared);
        }
        i += 1;
    }
    albedo * light
}

/// Whether the displaced surface stands between a hit and a light.
#[inline]
fn occluded(
    scene: &SceneView<'_>,
    features: Features,
    hit: Hit,
    surface: &SurfaceInteraction,
    wi: Vec3,
    light: Vec3,
    counts: &mut Counts,
) -> bool {
    counts.shadow_rays += 1;
    let origin = surface.spawn_origin(wi);
    let to_light = light - origin;
    let distance = to_light.length();
    let shadow_ray = TraversalRay::new(origin, to_light / distance, distance).leaving(hit);
    traverse(scene, features, &shadow_ray, Query::Any, counts).is_some()
}

/// A colour of its own for each micro-triangle.
#[inline]
fn cell_color(hit: Hit) -> Vec3 {
    let bits = pcg4d(UVec4::new(hit.primitive, hit.cell, 0, 0));
    let channel = |x: u32| 0.15 + 0.8 * (x >> 24) as f32 / 255.0;
    Vec3::new(channel(bits.x), channel(bits.y), channel(bits.z))
}

/// Blue at 0, green at a half, red at 1 and above.
#[inline]
fn heat(x: f32) -> Vec3 {
    let x = x.clamp(0.0, 1.0);
    Vec3::new((2.0 * x - 1.0).max(0.0), 1.0 - (2.0 * x - 1.0).abs(), (1.0 - 2.0 * x).max(0.0))
}

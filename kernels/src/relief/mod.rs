//! Surface relief in image space: methods that trace the base triangles and look for the relief in texture space, from
//! where a ray meets one of them, each in the file of its paper.
//!
//! None of them can change a silhouette, since a ray that misses the base triangles sees nothing, and none knows what
//! lies beyond a triangle's edges: there the relief goes on as if the triangle did. What they see is the bilinear
//! height field h(u, v), of which the micro-triangles of exact methods are the limit for a great N.
//!
//! A further method of this kind is an id in [`method`] between `BUMP` and `SPHERE`, a file here, and a branch in
//! [`surface()`] that says how far along the ray it finds the relief (in [`light_seen`] what it sees of a light, if
//! it has shadows of its own); on the host a variant of `settings::Method`.

pub mod binary;
pub mod bump;
pub mod bump_offset;
pub mod distance_map;
pub mod layers;
pub mod normal_map;
pub mod normal_texels;
pub mod occlusion;
pub mod parallax;
pub mod pyramid;
pub mod sphere_trace;
pub mod steep;
pub mod tangent_space;
#[cfg(test)]
pub(crate) mod test_ramp;

use crate::displacement::surface::{BaseTriangle, HeightField};
use crate::hit::Hit;
use crate::interface::{method, normal_space};
use crate::math::at;
use crate::ray::TraversalRay;
use crate::scene::{Features, SceneView};
use crate::shading::SurfaceInteraction;
use glam::{Vec2, Vec3};
use normal_texels::NormalTexels;
use tangent_space::{TangentRay, TangentSpace};

/// What a method shows of the relief where a ray meets a base triangle, in the space of its mesh. `flat` is the base
/// triangle there, at barycentric coordinates `w`.
#[inline]
#[expect(clippy::too_many_arguments, reason = "what was hit, as it is known already")]
pub fn surface(
    scene: &SceneView<'_>,
    features: Features,
    field: &HeightField<'_>,
    base: &BaseTriangle,
    w: Vec3,
    ray: &TraversalRay,
    hit: Hit,
    flat: SurfaceInteraction,
) -> SurfaceInteraction {
    let space = TangentSpace::new(field, base, w);
    let direction = object_vector(scene, features, hit, ray.direction);
    let tangent_ray = space.ray(flat.uv, 0.0, direction);
    let mut offset = 0.0;
    if method::searches_relief(features.method) {
        offset = searched(scene, features, &space, &tangent_ray, hit.t);
    } else if features.method == method::PARALLAX {
        offset = parallax::offset(&space, &tangent_ray).max(-hit.t);
    } else if features.method == method::PARALLAX_LIMITED {
        offset = parallax::limited_offset(&space, &tangent_ray, direction.length()).max(-hit.t);
    }
    let uv = tangent_ray.uv(offset);
    let mut ns = flat.ns;
    if features.method == method::NORMAL_MAP {
        let map = NormalTexels::load(scene.normal_texels, base.displacement);
        ns = normal_map::normal(&space, &map, w, uv, ns);
        if map.space == normal_space::WORLD && features.instances != 0 {
            // It goes back from there with the rest.
            ns = at(scene.instances, hit.instance).object_normal(ns);
        }
    } else {
        let slopes = if features.method == method::BUMP_OFFSET {
            let map = NormalTexels::load(scene.normal_texels, base.displacement);
            bump_offset::slopes(&space, &map, uv)
        } else {
            space.slopes(uv)
        };
        ns = space.normal(slopes, ns);
    }
    SurfaceInteraction { uv, ns, height: space.height(uv), offset, ..flat }
}

/// How far behind its hit on the base triangle a ray meets the relief, by a search; negative where it does before, at
/// most by `t_hit`. In the world's lengths, as `ray` is.
#[inline]
fn searched(
    scene: &SceneView<'_>,
    features: Features,
    space: &TangentSpace<'_>,
    ray: &TangentRay,
    t_hit: f32,
) -> f32 {
    let span = ray.span(space.heights(), -t_hit);
    if !span.is_some() {
        return 0.0;
    }
    let n = scene.frame.subdivisions;
    if features.method == method::PYRAMID {
        pyramid::search(space, ray, span, n)
    } else if features.method == method::SPHERE {
        sphere_trace::search(scene.distances, space, ray, span, n)
    } else {
        let bracket = layers::search(space, ray, span, n);
        if features.method == method::STEEP {
            steep::refine(bracket)
        } else if features.method == method::RELIEF {
            binary::refine(space, ray, bracket)
        } else {
            occlusion::refine(bracket)
        }
    }
}

/// How much the relief lets through, by a method that searches, of the light at the end of `toward`, the world's way
/// to it: 0 to 1, where [`surface()`] gave these texture coordinates and this height for the hit. Methods without
/// shadows of their own take layers for it.
///
/// A ray towards the light starts on the relief itself, wherever the method found it.
#[inline]
pub fn light_seen(
    scene: &SceneView<'_>,
    features: Features,
    hit: Hit,
    uv: Vec2,
    height: f32,
    toward: Vec3,
) -> f32 {
    let field = HeightField::new(scene, features).of_triangle(scene, hit.primitive, hit.instance);
    let base = BaseTriangle::load(scene, hit.primitive);
    let w = Vec3::new(1.0 - hit.b1 - hit.b2, hit.b1, hit.b2);
    let space = TangentSpace::new(&field, &base, w);
    let distance = toward.length();
    let ray = space.ray(uv, height, object_vector(scene, features, hit, toward / distance));
    // What lies behind the light does not shadow it.
    let span = ray.span(space.heights(), 0.0).up_to(distance);
    if !span.is_some() {
        return 1.0;
    }
    let n = scene.frame.subdivisions;
    if features.method == method::OCCLUSION {
        let (low, high) = space.heights();
        occlusion::light_seen(&space, &ray, span, high - low, n)
    } else {
        layers::light_seen(&space, &ray, span, n)
    }
}

/// A vector of the world in the space of the mesh that was hit.
#[inline]
fn object_vector(scene: &SceneView<'_>, features: Features, hit: Hit, v: Vec3) -> Vec3 {
    if features.instances != 0 { at(scene.instances, hit.instance).object_vector(v) } else { v }
}

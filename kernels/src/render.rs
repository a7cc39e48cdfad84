//! A pixel's sample, from the camera to the film; a ray's intersection, for tests and tools.

use crate::bvh::traverse::{Query, traverse};
use crate::counters::Counts;
use crate::film::Sample;
use crate::interface::{Intersection, MISS, Ray, method};
use crate::ray::TraversalRay;
use crate::sampler::sample_2d;
use crate::scene::{Features, SceneView};
use crate::shading::{SurfaceInteraction, shade_hit};
use glam::Vec2;

/// Sample number `sample` of pixel (x, y): one jittered camera ray, shaded. Nothing is hit: zero, transparent.
#[inline]
pub fn sample_pixel(
    scene: &SceneView<'_>,
    features: Features,
    x: u32,
    y: u32,
    sample: u32,
    counts: &mut Counts,
) -> Sample {
    let frame = scene.frame;
    let jitter = sample_2d(x, y, sample, frame.seed);
    let film =
        Vec2::new((x as f32 + jitter.x) / frame.width as f32, (y as f32 + jitter.y) / frame.height as f32);
    let ray = TraversalRay::new(frame.camera.eye, frame.camera.ray_direction(film), f32::INFINITY);
    counts.primary_rays += 1;
    let hit = traverse(scene, features, &ray, Query::Nearest, counts);
    if !hit.is_some() {
        return Sample::default();
    }
    counts.hits += 1;
    let steps = counts.triangles;
    Sample { radiance: shade_hit(scene, features, &ray, hit, steps, counts), alpha: 1.0 }
}

/// The nearest hit of a ray, with everything a shader needs to know of it.
#[inline]
pub fn trace_ray(scene: &SceneView<'_>, features: Features, ray: Ray, counts: &mut Counts) -> Intersection {
    let (traversal_ray, length) = TraversalRay::from_ray(ray);
    counts.primary_rays += 1;
    let hit = traverse(scene, features, &traversal_ray, Query::Nearest, counts);
    if !hit.is_some() {
        return Intersection { t: f32::INFINITY, primitive: MISS, ..Intersection::default() };
    }
    counts.hits += 1;
    let surface = SurfaceInteraction::new(scene, features, &traversal_ray, hit);
    let in_image_space = method::is_image_space(features.method);
    Intersection {
        point: surface.shown_point(features, &traversal_ray),
        t: if in_image_space { hit.t + surface.offset } else { hit.t } / length,
        normal: if in_image_space { surface.ns } else { surface.ng },
        primitive: hit.primitive,
        point_error: surface.point_error,
        cell: hit.cell,
        b1: hit.b1,
        b2: hit.b2,
        u: surface.uv.x,
        v: surface.uv.y,
        instance: hit.instance,
        padding: [0; 3],
    }
}

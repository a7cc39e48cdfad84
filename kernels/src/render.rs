//! A pixel's sample, from the camera to the film; a ray's intersection, for tests and tools.

use crate::bvh::traverse::{Query, traverse};
use crate::counters::Counts;
use crate::film::Sample;
use crate::interface::{Intersection, MISS, Ray, method};
use crate::lighting::DirectLighting;
use crate::ray::TraversalRay;
use crate::sampler::sample_2d;
use crate::scene::{Features, SceneView};
use crate::shading::{SurfaceInteraction, shade_hit};
use glam::{Vec2, Vec3};

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
    let direction = frame.camera.ray_direction(film);
    sample_ray(scene, features, TraversalRay::new(frame.camera.eye, direction, f32::INFINITY), counts)
}

/// What a primary ray shows. Nothing is hit: zero, transparent.
#[inline]
pub fn sample_ray(
    scene: &SceneView<'_>,
    features: Features,
    primary_ray: TraversalRay,
    counts: &mut Counts,
) -> Sample {
    let mut ray = primary_ray;
    let mut query = Query::Nearest;
    let mut lighting = DirectLighting::unlit(Vec3::ZERO);
    let mut alpha = 0.0;
    counts.primary_rays += 1;
    // The primary ray, then a shadow ray a turn. Left from its end: see `texture.rs`.
    loop {
        let hit = traverse(scene, features, &ray, query, counts);
        if query == Query::Any {
            lighting.add_unless_occluded(scene, features, hit);
        } else if hit.is_some() {
            counts.hits += 1;
            lighting = shade_hit(scene, features, &ray, hit, counts.triangles);
            alpha = 1.0;
        }
        let (shadow_ray, found) = lighting.next_shadow_ray(scene, features, counts);
        if features.shadows == 0 || !found {
            break;
        }
        ray = shadow_ray;
        query = Query::Any;
    }
    Sample { radiance: lighting.radiance(), alpha }
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

//! A pixel's sample, from the camera to the film; a ray's intersection, for tests and tools.

use crate::bvh::traverse::{Query, traverse};
use crate::counters::Counts;
use crate::film::Sample;
use crate::interface::{Intersection, MISS, Ray, method, shade};
use crate::lighting::DirectLighting;
use crate::ray::TraversalRay;
use crate::sampler::sample_2d;
use crate::scene::{Features, SceneView};
use crate::shading::{SurfaceInteraction, error_shown, shade_hit};
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
///
/// For [`shade::ERROR`] it is followed twice, by the method that the features name and by the exact one.
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
    let shows_error = features.shade == shade::ERROR;
    let mut is_exact = false;
    let mut by_method = Sample::default();
    counts.primary_rays += 1;
    // The primary ray, then a shadow ray a turn; to show errors both once more. Left from its end: see `texture.rs`.
    loop {
        // What is stored has a tree of its own, and is exact.
        let other = shows_error && is_exact && features.method != method::TESSELLATE;
        let method = if other { method::QUADTREE } else { features.method };
        let by = Features { method, ..features };
        let hit = traverse(scene, by, &ray, query, counts);
        if query == Query::Any {
            lighting.add_unless_occluded(scene, by, hit);
        } else if hit.is_some() {
            counts.hits += 1;
            lighting = shade_hit(scene, by, &ray, hit, counts.triangles);
            alpha = 1.0;
        }
        let (shadow_ray, found) = lighting.next_shadow_ray(scene, by, counts);
        let goes_on = features.shadows != 0 && found;
        let again = shows_error && !is_exact && !goes_on;
        ray = shadow_ray;
        query = Query::Any;
        if again {
            by_method = Sample { radiance: lighting.radiance(), alpha };
            is_exact = true;
            ray = primary_ray;
            query = Query::Nearest;
            lighting = DirectLighting::unlit(Vec3::ZERO);
            alpha = 0.0;
        }
        if !goes_on && !again {
            break;
        }
    }
    let sample = Sample { radiance: lighting.radiance(), alpha };
    if shows_error { error_shown(by_method, sample) } else { sample }
}

/// The nearest hit of a ray, with everything a shader needs to know of it.
#[inline]
pub fn trace_ray(scene: &SceneView<'_>, features: Features, ray: Ray, counts: &mut Counts) -> Intersection {
    let (traversal_ray, stretch) = TraversalRay::from_ray(ray);
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
        t: stretch.parameter(if in_image_space { hit.t + surface.offset } else { hit.t }),
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

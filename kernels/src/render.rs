//! A pixel's sample, from the camera to the film.

use crate::counters::Counts;
use crate::film::Sample;
use crate::interface::{Intersection, MISS, Ray};
use crate::sampler::sample_2d;
use crate::scene::{Features, SceneView};
use glam::{Vec2, Vec3};

/// Sample number `sample` of pixel (x, y): one jittered camera ray, shaded.
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
    let film = Vec2::new(
        (x as f32 + jitter.x) / frame.width as f32,
        (y as f32 + jitter.y) / frame.height as f32,
    );
    let direction = frame.camera.ray_direction(film);
    counts.primary_rays += 1;
    let _ = features;
    Sample {
        radiance: direction * 0.5 + Vec3::splat(0.5),
        alpha: 1.0,
    }
}

/// The nearest hit of a ray, with everything a shader needs to know of it.
#[inline]
pub fn trace_ray(_scene: &SceneView<'_>, _features: Features, ray: Ray, counts: &mut Counts) -> Intersection {
    counts.primary_rays += 1;
    Intersection {
        t: ray.t_max,
        primitive: MISS,
        ..Intersection::default()
    }
}

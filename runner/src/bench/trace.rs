//! What tracing costs: the time of a steady sample by the device's own clock, the first one apart, and memory.

use crate::backend::{Backend, BackendError, PipelineCode};
use crate::render::{Job, RenderError, Scene, load, prepare};
use crate::settings::{Bounds, Method, Settings, Subdivisions};
use crate::stats::Bytes;
use emboss_kernels::interface::{counter, method, shade};
use emboss_kernels::scene::Features;
use serde::Serialize;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// How long samples are taken before any is measured: a graphics card raises its clock within a second of work.
const WARM_UP: Duration = Duration::from_millis(300);
/// Fewest samples that are measured of each stage.
const LEAST_SAMPLES: usize = 5;

/// What is measured of one method with one N and one limit of memory.
#[derive(Clone, Debug, Serialize)]
pub struct Measurement {
    /// How displaced triangles are intersected.
    pub method: Method,
    /// N.
    pub n: Subdivisions,
    /// How much memory stored bounds may take.
    pub bounds: Bounds,
    /// Bytes of everything but film and colour maps.
    pub bytes: u64,
    /// Packing and loading, by the host's clock, in milliseconds, without the compilation of pipelines.
    pub load_ms: f64,
    /// The first sample, in milliseconds.
    pub first_ms: f64,
    /// The median of the samples after it, in milliseconds: as it was asked for.
    pub sample_ms: f64,
    /// The same without shadow rays.
    pub primary_ms: f64,
    /// The same without shading: a colour by the number of triangles that primary rays are tested against. What is left
    /// is intersection, and the film.
    pub intersection_ms: f64,
    /// Primary and shadow rays of a sample.
    pub rays: u64,
    /// Work for each primary ray without shading: boxes of the BVH.
    pub boxes: f64,
    /// Sub-triangles.
    pub sub_triangles: f64,
    /// Micro-triangles, or base triangles.
    pub triangles: f64,
    /// The pipelines that were made for it; none on the CPU.
    pub pipelines: Vec<PipelineCode>,
}

/// Measures a scene. `time`: how long each of the three stages is measured, behind a warm-up. `progress` is asked
/// between samples whether to go on; `None` where it is not.
///
/// # Errors
/// [`RenderError`] where the scene cannot be traced in that way.
pub fn measure(
    backend: &mut dyn Backend,
    scene: &Scene,
    settings: &Settings,
    time: Duration,
    progress: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<Option<Measurement>, RenderError> {
    let (start, compiled) = (Instant::now(), backend.compile_time());
    let mut job = prepare(scene.clone(), settings)?;
    load(backend, &mut job)?;
    let load_time = start.elapsed().saturating_sub(backend.compile_time().saturating_sub(compiled));
    let pipelines = backend.pipelines();
    let mut ended = false;
    let mut is_ended = || {
        ended = ended || progress().is_break();
        ended
    };
    let first_ms = sample(backend, 0, 0.0)?;
    let sample_ms = steady(backend, job.features, time, &mut is_ended)?;
    let primary = Features { shadows: 0, ..job.features };
    let primary_ms = steady(backend, primary, time, &mut is_ended)?;
    let bare = Features { shade: shade::STEPS, ..primary };
    let intersection_ms = steady(backend, bare, time, &mut is_ended)?;
    let counted = counts(backend, &job, bare)?;
    let shadows = counts(backend, &job, Features { counters: 1, ..job.features })?;
    if is_ended() {
        return Ok(None);
    }
    let rays = counted[counter::PRIMARY_RAYS as usize] as f64;
    let per_ray = |counter: u32| counted[counter as usize] as f64 / rays;
    Ok(Some(Measurement {
        method: settings.method,
        n: Subdivisions::of(settings, scene),
        bounds: if job.features.method == method::QUADTREE { settings.bounds } else { Bounds::None },
        bytes: Bytes::new(&job, backend.build_report()).without_pictures(),
        load_ms: load_time.as_secs_f64() * 1e3,
        first_ms,
        sample_ms,
        primary_ms,
        intersection_ms,
        rays: shadows[counter::PRIMARY_RAYS as usize] + shadows[counter::SHADOW_RAYS as usize],
        boxes: per_ray(counter::BOXES),
        sub_triangles: per_ray(counter::SUB_TRIANGLES),
        triangles: per_ray(counter::TRIANGLES),
        pipelines,
    }))
}

/// What a sample takes in milliseconds, by the device's clock where it has one. `before`: what those before it took
/// since the film was cleared.
fn sample(backend: &mut dyn Backend, number: u32, before: f64) -> Result<f64, BackendError> {
    let start = Instant::now();
    let _ = backend.add_sample(number, &mut |_| ControlFlow::Continue(()))?;
    let elapsed = start.elapsed().as_secs_f64() * 1e3;
    Ok(backend.device_ms().map_or(elapsed, |all| all - before))
}

/// The median time of samples with those features.
fn steady(
    backend: &mut dyn Backend,
    features: Features,
    time: Duration,
    is_ended: &mut dyn FnMut() -> bool,
) -> Result<f64, BackendError> {
    backend.set_features(features)?;
    let (start, mut number, mut times) = (Instant::now(), 0, Vec::new());
    while !is_ended() && (times.len() < LEAST_SAMPLES || start.elapsed() < WARM_UP + time) {
        let before = backend.device_ms().unwrap_or(0.0);
        let ms = sample(backend, number, before)?;
        number += 1;
        if start.elapsed() >= WARM_UP {
            times.push(ms);
        }
    }
    times.sort_by(f64::total_cmp);
    Ok(times.get(times.len() / 2).copied().unwrap_or(f64::NAN))
}

/// The work of a sample with those features.
fn counts(
    backend: &mut dyn Backend,
    job: &Job,
    features: Features,
) -> Result<crate::backend::Totals, BackendError> {
    backend.set_features(Features { counters: 1, ..features })?;
    let _ = backend.add_sample(0, &mut |_| ControlFlow::Continue(()))?;
    let totals = backend.totals();
    backend.set_features(job.features)?;
    totals
}

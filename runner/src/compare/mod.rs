//! `emboss compare`: what each method costs and what it gets wrong, measured on the user's own scene.
//!
//! Every configuration (a method with its N) is looked at from the same cameras as the [reference](mod@reference): the
//! user's, one that [grazes](cameras::grazing) the surface, and those of a [path](cameras::orbit). Then all are timed
//! in turns, round after round, so that what slows a machine down for a while slows all of them.

pub mod about;
pub mod cameras;
pub mod charts;
mod csv;
pub mod flip;
pub mod heat;
pub mod markdown;
pub mod metrics;
pub mod quality;
pub mod reference;
pub mod report;
pub mod results;
pub mod subject;

use crate::backend::{Backend, BackendError};
use crate::picture::{Destination, Picture, PictureError};
use crate::render::{RenderError, Scene};
use crate::settings::{Method, Settings, Subdivisions};
use clap::ValueEnum;
use emboss_kernels::interface::Camera;
use glam::Vec3;
use metrics::{Capture, errors};
use reference::{Reason, Summary};
use results::{Measurement, ResultsError, Skipped, Store, ViewErrors};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};
use subject::{Configuration, Stage, Subject, Watch, milliseconds};

/// What is to be compared.
pub struct Plan {
    /// The scene.
    pub scene: Scene,
    /// How it is looked at; the method is not read.
    pub settings: Settings,
    /// Samples of a pixel. The pictures of the path have one.
    pub samples: u32,
    /// What is compared.
    pub configurations: Vec<Configuration>,
    /// N of the reference where the user names it.
    pub reference: Option<u32>,
    /// How long to measure; each configuration has a round at least.
    pub time: Duration,
}

/// N of those methods that have one, unless the user names others.
pub const NS: [u32; 4] = [4, 16, 64, 256];

/// The methods that are compared where the user names none: all but that which tests every micro-triangle, for which
/// minutes pass where others take milliseconds.
pub fn usual_methods() -> Vec<Method> {
    Method::value_variants().iter().copied().filter(|&method| method != Method::BruteForce).collect()
}

/// Why a comparison ended.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// The user broke it off.
    #[error("interrupted; what is measured is kept, and the same command goes on from there")]
    Interrupted,
    /// The backend failed when something was measured already.
    #[error("{source}; what is measured is kept, and the same command goes on from there")]
    Failed {
        /// How.
        source: BackendError,
    },
    /// The scene cannot be rendered, or the backend failed before anything was measured.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A picture could not be written.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// The results could not be written or read.
    #[error(transparent)]
    Results(#[from] ResultsError),
}

impl From<BackendError> for CompareError {
    fn from(error: BackendError) -> Self {
        CompareError::Render(error.into())
    }
}

/// Is told the share done, from 0 to 1, and says whether to go on.
pub type Progress<'a> = &'a mut dyn FnMut(f64) -> ControlFlow<()>;

/// Share of the work that the first round is, for the progress bar: it takes the pictures, and times are half as long
/// then as later where there is time for that.
const FIRST_SHARE: f64 = 0.6;

/// Measures what `store` does not have yet, and keeps it there after each measurement.
///
/// # Errors
/// [`CompareError`]. What was measured until then is kept.
pub fn run(
    plan: &Plan,
    backend: &mut dyn Backend,
    store: &mut Store,
    progress: Progress<'_>,
) -> Result<(), CompareError> {
    measure_all(plan, backend, store, progress).map_err(|error| match error {
        CompareError::Render(RenderError::Backend(source)) if !store.results.configurations.is_empty() => {
            CompareError::Failed { source }
        }
        error => error,
    })
}

fn measure_all(
    plan: &Plan,
    backend: &mut dyn Backend,
    store: &mut Store,
    progress: Progress<'_>,
) -> Result<(), CompareError> {
    let begin = Instant::now();
    let before = store.results.seconds;
    let mut share = 0.0;
    let set = Setting::new(plan, backend, store, &mut || progress(share))?;
    let count = plan.configurations.len().max(1);
    for (i, &configuration) in plan.configurations.iter().enumerate() {
        share = FIRST_SHARE * (i + 1) as f64 / (count + 1) as f64;
        if store.results.knows(configuration) {
            continue;
        }
        match set.measure(plan, backend, store, configuration, &mut || progress(share)) {
            Ok(measurement) => store.results.configurations.push(measurement),
            Err(error) => store.results.skipped.push(skipped(configuration, error)?),
        }
        store.results.seconds = before + begin.elapsed().as_secs_f64();
        store.save()?;
    }
    let rounds = rounds(plan, backend, store, &set.stage, progress);
    store.results.complete = rounds.is_ok();
    store.save()?;
    rounds
}

/// Takes times in turns until there is no more time.
fn rounds(
    plan: &Plan,
    backend: &mut dyn Backend,
    store: &mut Store,
    stage: &Stage,
    progress: Progress<'_>,
) -> Result<(), CompareError> {
    let (begin, first, total) = (Instant::now(), store.results.seconds, plan.time.as_secs_f64());
    while store.results.seconds < total && !store.results.configurations.is_empty() {
        for measured in &mut store.results.configurations {
            let now = (store.results.seconds - first) / (total - first);
            let share = FIRST_SHARE + (1.0 - FIRST_SHARE) * now.min(1.0);
            let mut watch = || progress(share);
            let (scene, settings) = (&plan.scene, &plan.settings);
            let mut subject = Subject::load(backend, scene, settings, measured.configuration, Some(stage))?;
            measured.add(Times::take(&mut subject, plan.samples, &mut watch)?);
            store.results.seconds = first + begin.elapsed().as_secs_f64();
        }
        store.save()?;
    }
    Ok(())
}

/// Why a configuration is left out: what its method cannot take, or has no room for. The reference was prepared from
/// the same scene, so that only what befalls the device itself ends the comparison.
fn skipped(configuration: Configuration, error: CompareError) -> Result<Skipped, CompareError> {
    match &error {
        CompareError::Render(RenderError::Backend(
            BackendError::DeviceLost { .. }
            | BackendError::NoDevice { .. }
            | BackendError::NoValidation
            | BackendError::Vulkan { .. },
        )) => Err(error),
        CompareError::Render(_) => Ok(Skipped { configuration, reason: error.to_string() }),
        _ => Err(error),
    }
}

/// A round's times in milliseconds.
pub struct Times {
    frames: Vec<f64>,
    preparation: f64,
    edit: f64,
}

impl Times {
    fn take(subject: &mut Subject<'_>, samples: u32, watch: Watch<'_>) -> Result<Times, CompareError> {
        let preparation = milliseconds(subject.preparation);
        let frames = subject.frame_ms(samples, watch)?;
        // Last, since other heights stay.
        Ok(Times { frames, preparation, edit: subject.edit_ms(watch)? })
    }
}

/// The cameras, and what the reference shows there.
struct Setting {
    stage: Stage,
    views: Vec<View>,
    path: Vec<Camera>,
    /// For each step of the path how the reference changes.
    changes: Vec<Vec<f32>>,
    /// In render space, as what rays hit is.
    edge_length: f64,
}

/// A camera, and what the reference shows there.
struct View {
    name: &'static str,
    camera: Camera,
    capture: Capture,
}

impl Setting {
    fn new(
        plan: &Plan,
        backend: &mut dyn Backend,
        store: &mut Store,
        watch: Watch<'_>,
    ) -> Result<Setting, CompareError> {
        let (scene, settings) = (&plan.scene, &plan.settings);
        let compared = plan.configurations.iter().filter_map(|configuration| match configuration.n {
            Some(Subdivisions::Fixed(n)) => Some(n),
            _ => None,
        });
        let least = compared.max().unwrap_or(NS[NS.len() - 1]);
        let request = reference::Request { given: plan.reference, least, time: plan.time / 4 };
        let stage = reference::stage(backend, scene, settings, request)?;
        // More time may find a better one, but what was measured was measured against this one.
        let is_kept =
            |known: &Summary| known.reason != Reason::Time || !store.results.configurations.is_empty();
        let summary = match store.results.reference.filter(is_kept) {
            Some(known) => known,
            None => reference::find(backend, scene, settings, &stage, request, watch)?,
        };
        let exact = reference::configuration(summary.n);
        let mut subject = Subject::load(backend, scene, settings, exact, Some(&stage))?;
        let lift = subject.lift();
        let mut views = vec![View {
            name: "own",
            camera: stage.camera,
            capture: subject.capture(stage.camera, plan.samples, watch)?,
        }];
        let path = cameras::orbit(&stage.camera, stage.target);
        let changes = changes(&pictures(&mut subject, &path, watch)?, settings.width);
        if let Some(camera) = reference::grazing_camera(backend, scene, settings, &stage, lift)? {
            let mut subject = Subject::load(backend, scene, settings, exact, Some(&stage))?;
            let capture = subject.capture(camera, plan.samples, watch)?;
            views.push(View { name: "grazing", camera, capture });
        }
        for view in &views {
            let name = format!("{}-reference", view.name);
            write(store, &name, &view.capture.colors, settings)?;
        }
        store.results.reference = Some(summary);
        store.save()?;
        let edge_length = scene.mesh.space.length(summary.edge_length);
        Ok(Setting { stage, views, path, changes, edge_length })
    }

    /// Everything about a configuration, with a first round of times.
    fn measure(
        &self,
        plan: &Plan,
        backend: &mut dyn Backend,
        store: &Store,
        configuration: Configuration,
        watch: Watch<'_>,
    ) -> Result<Measurement, CompareError> {
        let settings = &plan.settings;
        let mut subject = Subject::load(backend, &plan.scene, settings, configuration, Some(&self.stage))?;
        let mut views = Vec::new();
        for View { name, camera, capture } in &self.views {
            let test = subject.capture(*camera, plan.samples, watch)?;
            let (errors, map) = errors(capture, &test, self.edge_length);
            let file = format!("{name}-{}", configuration.file_name());
            write(store, &file, &test.colors, settings)?;
            let heat: Vec<Vec3> = map.iter().map(|&error| heat::color(error)).collect();
            write(store, &format!("{file}-flip"), &heat, settings)?;
            views.push(ViewErrors { view: (*name).to_owned(), errors });
        }
        let test_changes = changes(&pictures(&mut subject, &self.path, watch)?, settings.width);
        let code = subject.code();
        let rays = subject.rays(plan.samples, watch)?;
        let memory = subject.memory();
        let flicker = flicker(&self.changes, &test_changes);
        let mut measurement = Measurement::new(configuration, views, flicker, memory, code, rays);
        measurement.add(Times::take(&mut subject, plan.samples, watch)?);
        Ok(measurement)
    }
}

/// The pictures of a path.
fn pictures(
    subject: &mut Subject<'_>,
    path: &[Camera],
    watch: Watch<'_>,
) -> Result<Vec<Vec<Vec3>>, CompareError> {
    path.iter().map(|&camera| subject.picture(camera, 1, watch)).collect()
}

/// How each picture differs from the one before.
fn changes(pictures: &[Vec<Vec3>], width: u32) -> Vec<Vec<f32>> {
    pictures.windows(2).map(|pair| flip::flip(&pair[0], &pair[1], width as usize)).collect()
}

/// Flicker: the mean difference, over all pixels and steps of a path, of what changes from picture to picture (ꟻLIP
/// between neighbours) from what changes in the reference. What is wrong in the same way in all pictures does not
/// count.
///
/// It is tLP of Chu, Xie, Mayer, Leal-Taixé and Thuerey (*Learning Temporal Coherence via Self-Supervision for
/// GAN-based Video Generation*, ACM TOG 39(4), 2020) with ꟻLIP in place of LPIPS, and taken pixel by pixel, so that too
/// much change in one place does not make up for too little in another.
fn flicker(reference: &[Vec<f32>], test: &[Vec<f32>]) -> f64 {
    let differences = reference.iter().flatten().zip(test.iter().flatten());
    metrics::mean(&differences.map(|(a, b)| f64::from((a - b).abs())).collect::<Vec<_>>())
}

/// Writes a picture of opaque linear colours.
fn write(store: &Store, name: &str, colors: &[Vec3], settings: &Settings) -> Result<(), CompareError> {
    let pixels = colors.iter().map(|color| color.extend(1.0)).collect();
    let picture = Picture { width: settings.width, height: settings.height, pixels };
    let destination = Destination::new(store.picture(name))?;
    Ok(destination.write(&picture, &store.results.identity.command)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What stands still and what moves alike does not flicker; a pixel that blinks does.
    #[test]
    fn flicker_is_change_that_the_reference_does_not_have() {
        let reference = [vec![0.1, 0.5], vec![0.1, 0.5]];
        assert_eq!(flicker(&reference, &reference), 0.0);
        let blinking = [vec![0.1, 0.5], vec![0.9, 0.5]];
        assert!((flicker(&reference, &blinking) - 0.8 / 4.0).abs() < 1e-6);
    }

    /// A constant error: each picture is wrong, and none changes.
    #[test]
    fn what_is_always_wrong_does_not_flicker() {
        let wrong = vec![vec![Vec3::X; 4]; 3];
        let right = vec![vec![Vec3::Y; 4]; 3];
        assert_eq!(flicker(&changes(&right, 2), &changes(&wrong, 2)), 0.0);
        // From each picture to the next.
        let once = changes(&[wrong[0].clone(), right[0].clone(), right[1].clone()], 2);
        assert!(once[0].iter().all(|&change| change > 0.1) && once[1] == [0.0; 4], "{once:?}");
    }

    #[test]
    fn what_a_method_cannot_take_is_skipped_and_a_lost_device_is_not() {
        let configuration = Configuration { method: Method::GridWalk, n: None };
        let of_vectors = RenderError::MethodOfVectors { method: Method::GridWalk };
        let refused = skipped(configuration, of_vectors.into()).expect("skipped");
        assert!(refused.reason.contains("grid-walk"));
        let most =
            BackendError::TooManyMicroTriangles { triangles: 2, subdivisions: 4096, count: 1, most: 1 };
        assert!(skipped(configuration, most.into()).is_ok());
        assert!(skipped(configuration, BackendError::TooManyDistanceMaps { count: 1 }.into()).is_ok());
        let lost = BackendError::DeviceLost { device: String::new(), what: "" };
        assert!(skipped(configuration, lost.into()).is_err());
        assert!(skipped(configuration, CompareError::Interrupted).is_err());
    }
}

//! The cheapest configuration whose error on the user's scene is within a budget.

use super::CompareError;
use super::flip;
use super::reference;
use super::subject::{Configuration, Subject, Watch};
use super::{NS, skipped, usual_methods};
use crate::backend::Backend;
use crate::render::Scene;
use crate::settings::{Settings, Subdivisions};
use std::time::Duration;

/// Rows of the picture that is measured, at most.
const ROWS: u32 = 180;
/// Samples of its pixels.
const SAMPLES: u32 = 2;
/// How long N of the reference may be doubled.
const REFERENCE_TIME: Duration = Duration::from_secs(10);

/// A configuration that was tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Which.
    pub configuration: Configuration,
    /// Mean ꟻLIP.
    pub error: f64,
    /// The least time of a frame of the small picture, in milliseconds: what else the machine does only adds to it.
    pub frame_ms: f64,
}

/// The settings of a picture that is as the user's but small.
fn small(settings: &Settings) -> Settings {
    let height = settings.height.min(ROWS);
    let width = u64::from(settings.width) * u64::from(height) / u64::from(settings.height);
    Settings { width: u32::try_from(width).unwrap_or(u32::MAX).max(1), height, ..settings.clone() }
}

/// Measures what could be chosen: the methods that are usually [compared](super::usual_methods) with the usual N, and the
/// quadtree with the N of the reference, whose error is 0.
pub fn candidates(
    backend: &mut dyn Backend,
    scene: &Scene,
    settings: &Settings,
    watch: Watch<'_>,
) -> Result<Vec<Candidate>, CompareError> {
    let settings = small(settings);
    let request = reference::Request { given: None, least: NS[NS.len() - 1], time: REFERENCE_TIME };
    let stage = reference::stage(backend, scene, &settings, request)?;
    let summary = reference::find(backend, scene, &settings, &stage, request, watch)?;
    let exact = reference::configuration(summary.n);
    let mut configurations = Configuration::all(&usual_methods(), &NS.map(Subdivisions::Fixed));
    if !configurations.contains(&exact) {
        configurations.push(exact);
    }
    let mut measure = |configuration: Configuration, right: Option<&[glam::Vec3]>| {
        let mut subject = Subject::load(backend, scene, &settings, configuration, Some(&stage))?;
        let colors = subject.picture(stage.camera, SAMPLES, watch)?;
        let error =
            right.map_or(0.0, |right| flip::mean(&flip::flip(right, &colors, settings.width as usize)));
        let frame_ms = subject.frame_ms(SAMPLES, watch)?.into_iter().fold(f64::INFINITY, f64::min);
        Ok((Candidate { configuration, error, frame_ms }, colors))
    };
    let (_, right) = measure(exact, None)?;
    let mut candidates = Vec::new();
    for configuration in configurations {
        match measure(configuration, Some(&right)) {
            Ok((candidate, _)) => candidates.push(candidate),
            // What cannot take the scene is no choice.
            Err(error) => drop(skipped(configuration, error)?),
        }
    }
    Ok(candidates)
}

/// The quickest of those whose error is within the budget; of those that are as quick the better one. The exact one always is.
pub fn choose(candidates: &[Candidate], budget: f64) -> Option<Candidate> {
    let within = candidates.iter().filter(|candidate| candidate.error <= budget);
    within.min_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms).then(a.error.total_cmp(&b.error))).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Method;

    #[test]
    fn the_quickest_within_the_budget_is_chosen() {
        let candidate = |n, error, frame_ms| Candidate {
            configuration: Configuration { method: Method::Quadtree, n: Some(Subdivisions::Fixed(n)) },
            error,
            frame_ms,
        };
        let all = [
            candidate(4, 0.3, 1.0),
            candidate(16, 0.02, 2.0),
            candidate(64, 0.02, 3.0),
            candidate(256, 0.0, 9.0),
        ];
        assert_eq!(choose(&all, 1.0), Some(all[0]));
        assert_eq!(choose(&all, 0.02), Some(all[1]));
        assert_eq!(choose(&all, 0.019), Some(all[3]));
        assert_eq!(choose(&all, 0.0), Some(all[3]));
    }

    #[test]
    fn small_pictures_keep_their_shape_and_others_stay() {
        let size = |width, height| {
            let small = small(&Settings { width, height, ..Settings::default() });
            (small.width, small.height)
        };
        assert_eq!((size(1920, 1080), size(100, 90), size(1, 4000)), ((320, 180), (100, 90), (1, 180)));
    }
}

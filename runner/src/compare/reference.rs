//! The surface that methods are measured against: the quadtree's, which is exact, with an N from which on nothing changes
//! that the picture could show.

use super::CompareError;
use super::cameras::grazing;
use super::metrics::{Capture, mean};
use super::subject::{Configuration, Stage, Subject, Watch};
use crate::backend::Backend;
use crate::render::Scene;
use crate::settings::{Method, Settings, Subdivisions};
use emboss_kernels::interface::{Camera, MAX_SUBDIVISIONS, MISS};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// N is converged where twice as many parts move what a pixel shows by no more than this share of its width, in the mean.
pub const BOUND: f64 = 0.05;

/// Why N was not doubled any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reason {
    /// The residual is below [`BOUND`].
    Converged,
    /// N is the greatest there is.
    Greatest,
    /// There was no more time.
    Time,
    /// The user named it.
    Given,
}

/// How good the reference is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Its N.
    #[serde(rename = "N")]
    pub n: u32,
    /// How far the surface moved, in pixels, when N came to this from half of it: see [`residual`]. `None` where N is 1.
    pub residual_pixels: Option<f64>,
    /// Why it is no greater.
    pub reason: Reason,
    /// The mean edge length of the base mesh, in model units: what depth errors are measured in.
    pub edge_length: f64,
}

/// The mean distance, in widths of a pixel, between what two captures see through the centres of pixels that either hits. What
/// one hits alone counts as a pixel, and so does what lies farther apart.
pub fn residual(a: &Capture, b: &Capture, pixel_side: f32) -> f64 {
    let moved = a.hits.iter().zip(&b.hits).filter_map(|(a, b)| match (a.primitive, b.primitive) {
        (MISS, MISS) => None,
        (MISS, _) | (_, MISS) => Some(1.0),
        _ => Some((f64::from((a.t - b.t).abs()) / f64::from(a.t * pixel_side)).min(1.0)),
    });
    mean(&moved.collect::<Vec<_>>())
}

/// The reference with N parts.
pub fn configuration(n: u32) -> Configuration {
    Configuration { method: Method::Quadtree, n: Some(Subdivisions::Fixed(n)) }
}

/// What is asked of the reference.
#[derive(Clone, Copy, Debug)]
pub struct Request {
    /// N where the user names it.
    pub given: Option<u32>,
    /// The least N to try: the greatest that is compared.
    pub least: u32,
    /// How long N may be doubled.
    pub time: Duration,
}

impl Request {
    /// The N whose displaced model the user's camera frames.
    fn framed(&self) -> u32 {
        self.given.unwrap_or(self.least)
    }
}

/// Where the camera and the lights are, for all configurations.
pub fn stage(
    backend: &mut dyn Backend,
    scene: &Scene,
    settings: &Settings,
    request: Request,
) -> Result<Stage, CompareError> {
    Ok(Subject::load(backend, scene, settings, configuration(request.framed()), None)?.stage)
}

/// Doubles N until it is converged.
pub fn find(
    backend: &mut dyn Backend,
    scene: &Scene,
    settings: &Settings,
    stage: &Stage,
    request: Request,
    watch: Watch<'_>,
) -> Result<Summary, CompareError> {
    let start = Instant::now();
    let pixel_side = 2.0 * stage.camera.up.length() / settings.height as f32;
    let mut seen = |n: u32| {
        if watch().is_break() {
            return Err(CompareError::Interrupted);
        }
        let mut subject = Subject::load(backend, scene, settings, configuration(n), Some(stage))?;
        Ok((subject.hits(stage.camera)?, subject.edge_length()))
    };
    let mut n = request.framed();
    let (mut hits, edge_length) = seen(n)?;
    if request.given.is_some() {
        let residual_pixels = match n / 2 {
            0 => None,
            half => Some(residual(&seen(half)?.0, &hits, pixel_side)),
        };
        return Ok(Summary { n, residual_pixels, reason: Reason::Given, edge_length });
    }
    let mut residual_pixels = None;
    let reason = loop {
        if residual_pixels.is_some_and(|moved| moved <= BOUND) {
            break Reason::Converged;
        } else if n == MAX_SUBDIVISIONS {
            break Reason::Greatest;
        } else if start.elapsed() > request.time {
            break Reason::Time;
        }
        n = (2 * n).min(MAX_SUBDIVISIONS);
        let (finer, _) = seen(n)?;
        residual_pixels = Some(residual(&hits, &finer, pixel_side));
        hits = finer;
    };
    Ok(Summary { n, residual_pixels, reason, edge_length })
}

/// The camera that looks low over the surface, where the stage's sees any.
pub fn grazing_camera(
    backend: &mut dyn Backend,
    scene: &Scene,
    settings: &Settings,
    stage: &Stage,
    lift: f32,
) -> Result<Option<Camera>, CompareError> {
    let flat = Configuration { method: Method::None, n: None };
    let mut subject = Subject::load(backend, scene, settings, flat, Some(stage))?;
    let base = subject.hits(stage.camera)?;
    let distance = stage.camera.eye.distance(stage.target);
    Ok(grazing(&stage.camera, &base.hits, subject.size().0, lift, distance))
}

#[cfg(test)]
mod tests {
    use super::*;
    use emboss_kernels::interface::Intersection;

    fn capture(depths: [f32; 4]) -> Capture {
        let hit = |t: f32| {
            let primitive = if t.is_finite() { 0 } else { MISS };
            Intersection { t, primitive, ..Intersection::default() }
        };
        Capture { colors: vec![], hits: depths.map(hit).to_vec(), width: 2 }
    }

    /// A pixel is 0.1 wide at distance 1: at 2 half of one is 0.1. The last pixel misses in both.
    #[test]
    fn residuals_are_in_pixels() {
        let far = f32::INFINITY;
        let a = capture([2.0, 2.0, 2.0, far]);
        assert_eq!(residual(&a, &a, 0.1), 0.0);
        assert!((residual(&a, &capture([2.1, 2.0, 2.0, far]), 0.1) - 0.5 / 3.0).abs() < 1e-6);
        assert!((residual(&a, &capture([far, 9.0, 2.0, far]), 0.1) - 2.0 / 3.0).abs() < 1e-6);
    }
}

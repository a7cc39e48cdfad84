//! The surface that methods are measured against: the quadtree's, which is exact, with an N from which on nothing
//! changes that the picture could show.

use super::CompareError;
use super::cameras::grazing;
use super::metrics::{Capture, degrees_between, mean};
use super::subject::{Configuration, Stage, Subject, Watch};
use crate::backend::Backend;
use crate::render::Scene;
use crate::settings::{Method, Settings, Subdivisions};
use emboss_kernels::interface::{Camera, MAX_SUBDIVISIONS, MISS};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// N is converged where twice as many parts move what a pixel shows by no more than this share of its width, in the
/// mean...
pub const BOUND: f64 = 0.05;
/// ...and turn the normals there by no more than so many degrees. That takes longer: half as wide micro-triangles are
/// four times as near to a smooth surface, but their normals are only twice as near to its own.
pub const BOUND_DEGREES: f64 = 2.0;

/// Why N was not doubled any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reason {
    /// The residuals are within [`BOUND`] and [`BOUND_DEGREES`].
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
    /// By how much the surface changed when N came to this from half of it; `None` where N was not doubled, or is 1.
    pub residual: Option<Residual>,
    /// Why it is no greater.
    pub reason: Reason,
    /// The mean edge length of the base mesh, in model units: what depth errors are measured in.
    pub edge_length: f64,
}

/// By how much two surfaces differ in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Residual {
    /// The mean distance, in widths of a pixel, between what they show through the centres of pixels that either shows.
    /// What one shows alone counts as a pixel, and so does what lies farther apart.
    pub pixels: f64,
    /// The mean angle between their normals where both are.
    pub degrees: f64,
}

impl Residual {
    /// Of two captures of one view, whose pixels are `pixel_side` wide at distance 1.
    pub fn between(a: &Capture, b: &Capture, pixel_side: f32) -> Residual {
        let pairs = || a.hits.iter().zip(&b.hits);
        let moved = pairs().filter_map(|(a, b)| match (a.primitive, b.primitive) {
            (MISS, MISS) => None,
            (MISS, _) | (_, MISS) => Some(1.0),
            _ => Some((f64::from((a.t - b.t).abs()) / f64::from(a.t * pixel_side)).min(1.0)),
        });
        let both = pairs().filter(|(a, b)| a.primitive != MISS && b.primitive != MISS);
        let turned = both.map(|(a, b)| degrees_between(a.normal, b.normal));
        Residual { pixels: mean(&moved.collect::<Vec<_>>()), degrees: mean(&turned.collect::<Vec<_>>()) }
    }

    /// Whether more parts would not show.
    pub fn is_converged(self) -> bool {
        self.pixels <= BOUND && self.degrees <= BOUND_DEGREES
    }
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
        // In units of the model, as it is reported.
        let edge_length = subject.space().world_length(subject.edge_length());
        Ok((subject.hits(stage.camera)?, edge_length))
    };
    let mut n = request.framed();
    let (mut hits, edge_length) = seen(n)?;
    if request.given.is_some() {
        let residual = match n / 2 {
            0 => None,
            half => Some(Residual::between(&seen(half)?.0, &hits, pixel_side)),
        };
        return Ok(Summary { n, residual, reason: Reason::Given, edge_length });
    }
    let mut residual: Option<Residual> = None;
    let reason = loop {
        if residual.is_some_and(Residual::is_converged) {
            break Reason::Converged;
        } else if n == MAX_SUBDIVISIONS {
            break Reason::Greatest;
        } else if start.elapsed() > request.time {
            break Reason::Time;
        }
        n = (2 * n).min(MAX_SUBDIVISIONS);
        let (finer, _) = seen(n)?;
        residual = Some(Residual::between(&hits, &finer, pixel_side));
        hits = finer;
    };
    Ok(Summary { n, residual, reason, edge_length })
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
    use glam::Vec3;

    fn capture(depths: [f32; 4]) -> Capture {
        let hit = |t: f32| {
            let primitive = if t.is_finite() { 0 } else { MISS };
            Intersection { t, primitive, normal: Vec3::Z, ..Intersection::default() }
        };
        Capture { colors: vec![], hits: depths.map(hit).to_vec(), width: 2 }
    }

    /// A pixel is 0.1 wide at distance 1: at 2 half of one is 0.1. The last pixel misses in both.
    #[test]
    fn residuals_are_in_pixels() {
        let far = f32::INFINITY;
        let a = capture([2.0, 2.0, 2.0, far]);
        let pixels = |b: [f32; 4]| Residual::between(&a, &capture(b), 0.1).pixels;
        assert_eq!(pixels([2.0, 2.0, 2.0, far]), 0.0);
        assert!((pixels([2.1, 2.0, 2.0, far]) - 0.5 / 3.0).abs() < 1e-6);
        assert!((pixels([far, 9.0, 2.0, far]) - 2.0 / 3.0).abs() < 1e-6);
    }

    /// One of three normals is turned by 3 degrees, another by 4.5, which is too much; where one misses there is none.
    #[test]
    fn residuals_are_in_degrees_too() {
        let a = capture([2.0, 2.0, 2.0, f32::INFINITY]);
        let mut b = a.clone();
        let turned = |degrees: f32| glam::Quat::from_rotation_x(degrees.to_radians()) * Vec3::Z;
        b.hits[0].normal = turned(3.0);
        let residual = Residual::between(&a, &b, 0.1);
        assert!((residual.degrees - 1.0).abs() < 1e-4 && residual.is_converged(), "{residual:?}");
        b.hits[1].normal = turned(4.5);
        assert!(!Residual::between(&a, &b, 0.1).is_converged());
    }
}

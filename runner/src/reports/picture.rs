//! Pictures that show nothing of what was meant: no ray meets the model, the camera is inside of it, no light reaches
//! what is seen.

use super::crossings;
use crate::backend::{Backend, BackendError};
use crate::bvh::HostAabb;
use crate::compare::cameras::centre_rays;
use crate::instances;
use crate::render::{Job, Scene};
use emboss_kernels::aabb::Aabb;
use emboss_kernels::interface::{Frame, Instance, MISS, PointLight, Triangle, Vertex, color_format, shade};
use glam::{DVec3, Vec3, Vec4};
use serde::Serialize;
use std::fmt;
use std::ops::ControlFlow;

/// Columns and rows of the rays that look whether the camera sees back faces.
const GRID: (u32, u32) = (16, 12);
/// The share of them that meet back faces where a camera is taken to be inside.
const BACK_FACES: f32 = 0.95;
/// How many rays around the camera decide on which side of the surface it is.
const AROUND: u32 = 64;
/// The share of them that leave a surface which is taken for closed: it may have a small hole.
const CLOSED: f32 = 0.9;
/// Pixels of a row, and rows, of the picture that is looked at first for whether any light reaches anything.
const SMALL: (u32, u32) = (64, 48);

/// What of a scene is to be known beside what a backend holds of it.
#[derive(Clone, Copy, Debug)]
pub struct Ground<'a> {
    /// Corners of the base mesh.
    pub vertices: &'a [Vertex],
    /// Its triangles.
    pub triangles: &'a [Triangle],
    /// Where its parts stand; none where it stands as it is.
    pub instances: &'a [Instance],
    /// What no surface reflects more of in any channel; infinite where that is not known.
    pub brightest: f32,
}

impl Ground<'_> {
    /// That of a job with all its buffers.
    pub fn of_job(job: &Job) -> Ground<'_> {
        let brightest = job.buffers.materials.iter().map(|material| match material.color_format {
            color_format::NONE => material.albedo.max_element(),
            color_format::SRGB8 => 1.0,
            _ => f32::INFINITY,
        });
        Ground {
            vertices: &job.buffers.vertices,
            triangles: &job.buffers.triangles,
            instances: &job.buffers.instances,
            brightest: brightest.fold(0.0, f32::max),
        }
    }

    /// That of a scene whose `instances` are prepared.
    pub fn of_scene<'a>(scene: &'a Scene, instances: &'a [Instance]) -> Ground<'a> {
        let brightest = scene.materials.iter().map(|material| match &material.color {
            None => material.albedo.max_element(),
            Some(map) if map.format == color_format::SRGB8 => 1.0,
            Some(_) => f32::INFINITY,
        });
        Ground {
            vertices: &scene.mesh.vertices,
            triangles: &scene.mesh.triangles,
            instances,
            brightest: brightest.fold(0.0, f32::max),
        }
    }
}

/// Why a picture shows nothing of what was meant.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Useless {
    /// No primary ray meets the displaced model.
    NothingHit {
        /// Lower corner of the box around the displaced model, in world units.
        min: [f64; 3],
        /// Upper corner.
        max: [f64; 3],
        /// Where that box is in the camera's view.
        seen: Whereabouts,
        /// Whether the camera's place or target was chosen, so that it need not show the model.
        is_placed: bool,
    },
    /// The camera is behind the displaced surface.
    CameraInside {
        /// Where it is, in world units.
        eye: [f64; 3],
        /// Whether it is between the base mesh and the surface that this is displaced to; else it is inside the closed
        /// surface.
        in_relief: bool,
        /// Lower corner of the box around the displaced model, in world units.
        min: [f64; 3],
        /// Upper corner.
        max: [f64; 3],
    },
    /// No light adds anything to any sample: there is ambient light at most.
    NoLight {
        /// The lights, but for black ones.
        lights: Vec<DarkLight>,
        /// Lower corner of the box around the displaced model, in world units.
        min: [f64; 3],
        /// Upper corner.
        max: [f64; 3],
    },
}

/// A light that reaches nothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DarkLight {
    /// Where it is, in world units.
    pub position: [f64; 3],
    /// Whether it would reach nothing however it stood there: its intensity over the squared distance is 0 in floats,
    /// or the square has no room in them.
    pub too_far: bool,
}

/// Where a model is that no ray meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Whereabouts {
    /// There is none.
    Nowhere,
    /// Behind the camera.
    Behind,
    /// Beside what the picture shows.
    Beside,
    /// Within the picture, between its rays.
    BetweenRays,
}

/// What looking at a picture gave.
#[derive(Clone, Debug, PartialEq)]
pub struct Findings {
    /// What is wrong, where something is: of several the first in the order of [`Useless`].
    pub useless: Option<Useless>,
    /// Whether the film was cleared.
    pub film_is_cleared: bool,
}

/// A point as options take it.
fn point(p: [f64; 3]) -> String {
    let [x, y, z] =
        p.map(|x| if x != 0.0 && !(1e-5..1e7).contains(&x.abs()) { format!("{x:e}") } else { x.to_string() });
    format!("{x},{y},{z}")
}

/// A box for users.
struct Shown {
    min: [f64; 3],
    max: [f64; 3],
}

impl Shown {
    /// A point to a thousandth of the box's size: it is a little wider than the model, by the room for rounding.
    fn point(&self, p: [f64; 3]) -> String {
        let size = [0, 1, 2].map(|i| self.max[i] - self.min[i]).into_iter().fold(f64::MIN_POSITIVE, f64::max);
        #[expect(clippy::cast_possible_truncation, reason = "from -305 to 311")]
        let digits = 3 - size.log10().floor() as i32;
        let step = 10.0_f64.powi(-digits);
        let places = usize::try_from(digits).unwrap_or(0);
        let rounded = |x: f64| {
            let whole = (x / step).round() * step;
            // A product of a power of ten has digits behind those.
            format!("{whole:.places$}").parse().unwrap_or(whole) + 0.0
        };
        point(p.map(rounded))
    }

    fn middle(&self) -> String {
        self.point([0, 1, 2].map(|i| 0.5 * self.min[i] + 0.5 * self.max[i]))
    }
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "between {} and {}", self.point(self.min), self.point(self.max))
    }
}

impl fmt::Display for Useless {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Useless::NothingHit { seen: Whereabouts::Nowhere, .. } => {
                f.write_str("the picture is empty: the model has no surface; check the file")
            }
            Useless::NothingHit { min, max, seen, is_placed } => {
                let seen = match seen {
                    Whereabouts::Behind => "behind the camera",
                    Whereabouts::Beside => "beside the picture",
                    _ => "too small, or seen from too flat an angle, for any ray",
                };
                write!(
                    f,
                    "the picture is empty: the model is {seen}; it lies {}; ",
                    Shown { min: *min, max: *max }
                )?;
                if *is_placed {
                    let middle = Shown { min: *min, max: *max }.middle();
                    write!(f, "leave --eye and --target out to see all of it, or look at --target {middle}")
                } else {
                    f.write_str("look from another side with --eye, or with more --samples")
                }
            }
            Useless::CameraInside { eye, in_relief, min, max } => {
                let place = if *in_relief {
                    "inside the relief, between the base mesh and the displaced surface"
                } else {
                    "inside the model"
                };
                write!(
                    f,
                    "the camera is {place}, at {}, and sees it from behind; the model lies {}: leave --eye out to see \
                        all of it, or choose one on the outside",
                    point(*eye),
                    Shown { min: *min, max: *max }
                )
            }
            Useless::NoLight { lights, min, max } => {
                let far: Vec<_> =
                    lights.iter().filter(|light| light.too_far).map(|light| point(light.position)).collect();
                let reasons = match (far.len() == lights.len(), &far[..]) {
                    (true, _) => format!("so far away ({}) that floats leave nothing of it", far.join("; ")),
                    (false, []) => "behind what is seen, inside the model or in its shadow".to_owned(),
                    (false, _) => format!(
                        "too far away for floats ({}), or behind what is seen, inside the model or in its shadow",
                        far.join("; ")
                    ),
                };
                let noun = if lights.len() == 1 { "the light is" } else { "each light is" };
                write!(
                    f,
                    "no light reaches what the picture shows: {noun} {reasons}; the model lies {}: move --light \
                        nearer or to the side that is seen, or leave it out for one over the viewer's shoulder",
                    Shown { min: *min, max: *max }
                )
            }
        }
    }
}

/// Whether a picture shows nothing of what was meant. `pixels` are those of the job's film, with `samples` samples
/// each; the job is [framed](Job::frame_view), and the backend has its scene and view. `watch` is asked whether to go
/// on; where it breaks there is no finding. The film is cleared where the picture alone does not tell.
///
/// - *Nothing is hit* where all pixels are the background; where that is opaque, a picture without it tells whether
///   something looks just like it.
/// - *The camera is inside* where its place or target was chosen, it is within the box of the model, at least 95 % of
///   192 rays through the picture that hit anything meet back faces, and of 64 rays around the camera either most pass
///   through the displaced surface once more outwards than through the base mesh (it is between the two), or 90 % leave
///   the displaced surface. So a camera behind an open sheet is not, nor one in a hollow of the relief, nor one in a
///   room whose faces look inwards. Where the base mesh is too large to be tested in a moment, the first of the two is
///   not found.
/// - *No light reaches anything* where the picture is the same to the bit without lights. Pictures with a pixel that is
///   brighter than ambient light makes any surface are not looked at further; of others a small one decides whether to
///   look at all of it.
///
/// # Errors
/// [`BackendError`], as rendering the picture would end.
pub fn useless(
    backend: &mut dyn Backend,
    job: &Job,
    ground: &Ground<'_>,
    pixels: &[Vec4],
    samples: u32,
    watch: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<Findings, BackendError> {
    let mut look = Look { backend, job, film_is_cleared: false, watch };
    let useless = look.find(ground, pixels, samples);
    let film_is_cleared = look.film_is_cleared;
    if film_is_cleared {
        backend.set_view(&job.frame, &job.buffers.lights)?;
    }
    Ok(Findings { useless: useless?, film_is_cleared })
}

struct Look<'a> {
    backend: &'a mut dyn Backend,
    job: &'a Job,
    film_is_cleared: bool,
    watch: &'a mut dyn FnMut() -> ControlFlow<()>,
}

impl Look<'_> {
    fn find(
        &mut self,
        ground: &Ground<'_>,
        pixels: &[Vec4],
        samples: u32,
    ) -> Result<Option<Useless>, BackendError> {
        let frame = self.job.frame;
        let background = (frame.background * frame.background_alpha).extend(frame.background_alpha);
        let is_background = pixels.iter().all(|&pixel| pixel == background);
        if is_background && self.is_nothing_hit(samples)? {
            let bounds = self.bounds(ground)?;
            return Ok(Some(self.nothing_hit(bounds)));
        }
        // A camera whose place was not chosen has all of the model before it.
        if self.is_placed() {
            let (bounds, eye) = (self.bounds(ground)?, frame.camera.eye);
            if let Some(Aabb { min, max }) = bounds
                && min.cmple(eye).all()
                && eye.cmple(max).all()
                && let Some(in_relief) = self.side_of_camera(ground)?
            {
                let eye = self.job.view.eye.unwrap_or_else(|| self.world(eye)).to_array();
                let [min, max] = [min, max].map(|corner| self.world(corner).to_array());
                return Ok(Some(Useless::CameraInside { eye, in_relief, min, max }));
            }
        }
        if self.may_be_dark(ground, pixels) && self.is_dark(pixels, samples)? {
            // What is hit has a box.
            let Aabb { min, max } = self.bounds(ground)?.unwrap_or(Aabb { min: Vec3::ZERO, max: Vec3::ZERO });
            let lights = self.lights().map(|(light, position)| DarkLight {
                position: position.to_array(),
                too_far: is_too_far(light, min, max),
            });
            let lights = lights.collect();
            let [min, max] = [min, max].map(|corner| self.world(corner).to_array());
            return Ok(Some(Useless::NoLight { lights, min, max }));
        }
        Ok(None)
    }

    /// Whether the camera's place or target was chosen.
    fn is_placed(&self) -> bool {
        self.job.view.eye.is_some() || self.job.view.target.is_some()
    }

    /// A point of the job's render space in world units.
    fn world(&self, point: Vec3) -> DVec3 {
        self.job.space.world(point.as_dvec3())
    }

    /// The box of the displaced model in the job's render space.
    fn bounds(&mut self, ground: &Ground<'_>) -> Result<Option<Aabb>, BackendError> {
        let mut boxes = self.backend.prism_boxes()?;
        if !ground.instances.is_empty() {
            boxes = instances::world_boxes(ground.instances, &boxes);
        }
        boxes.retain(|bounds| bounds.min.is_finite() && bounds.max.is_finite());
        Ok(boxes.into_iter().reduce(Aabb::union))
    }

    /// The picture with another frame of the same camera; `None` where it is broken off.
    fn picture(&mut self, frame: &Frame, samples: u32) -> Result<Option<Vec<Vec4>>, BackendError> {
        self.film_is_cleared = true;
        self.backend.set_view(frame, &self.job.buffers.lights)?;
        for sample in 0..samples {
            if self.backend.add_sample(sample, &mut |_| (self.watch)())?.is_break() {
                return Ok(None);
            }
        }
        self.backend.resolve().map(Some)
    }

    /// Whether a picture that is all background is so since nothing is hit.
    fn is_nothing_hit(&mut self, samples: u32) -> Result<bool, BackendError> {
        if self.job.frame.background_alpha == 0.0 {
            return Ok(true);
        }
        let frame = Frame { background_alpha: 0.0, light_count: 0, ..self.job.frame };
        let pixels = self.picture(&frame, samples)?;
        Ok(pixels.is_some_and(|pixels| pixels.iter().all(|pixel| pixel.w == 0.0)))
    }

    fn nothing_hit(&self, bounds: Option<Aabb>) -> Useless {
        let is_placed = self.is_placed();
        let Some(bounds) = bounds else {
            let seen = Whereabouts::Nowhere;
            return Useless::NothingHit { min: [0.0; 3], max: [0.0; 3], seen, is_placed };
        };
        let [min, max] = [bounds.min, bounds.max].map(|corner| self.world(corner).to_array());
        let seen = self.whereabouts(bounds);
        Useless::NothingHit { min, max, seen, is_placed }
    }

    /// Where a box is, as far as its corners tell: beside the picture where all are beyond one edge.
    fn whereabouts(&self, bounds: Aabb) -> Whereabouts {
        let camera = &self.job.frame.camera;
        let corners = bounds.corners().map(|corner| corner.as_dvec3() - camera.eye.as_dvec3());
        let [right, up, forward] = [camera.right, camera.up, camera.forward].map(|axis| axis.as_dvec3());
        if corners.iter().all(|corner| corner.dot(forward) <= 0.0) {
            return Whereabouts::Behind;
        }
        let is_beyond = |axis: glam::DVec3, sign: f64| {
            let edge = axis / axis.length_squared() * sign;
            corners.iter().all(|corner| corner.dot(edge) > corner.dot(forward))
        };
        let is_beside = [(right, 1.0), (right, -1.0), (up, 1.0), (up, -1.0)];
        let is_beside = is_beside.into_iter().any(|(axis, sign)| is_beyond(axis, sign));
        if is_beside { Whereabouts::Beside } else { Whereabouts::BetweenRays }
    }

    /// Whether the camera is inside, and then whether it is in the relief.
    fn side_of_camera(&mut self, ground: &Ground<'_>) -> Result<Option<bool>, BackendError> {
        let camera = self.job.frame.camera;
        let rays = centre_rays(&camera, GRID.0, GRID.1);
        let hits = self.backend.trace_rays(&rays)?;
        let hits: Vec<bool> = rays
            .iter()
            .zip(&hits)
            .filter(|(_, hit)| hit.primitive != MISS)
            .map(|(ray, hit)| hit.normal.dot(ray.direction) > 0.0)
            .collect();
        let back = hits.iter().filter(|is_back| **is_back).count();
        if hits.is_empty() || (back as f32) < BACK_FACES * hits.len() as f32 {
            return Ok(None);
        }
        let directions = crossings::directions(AROUND);
        let surface = crossings::of_surface(self.backend, camera.eye, &directions)?;
        let base = crossings::of_base(ground, camera.eye, &directions);
        let in_relief = base.is_some_and(|base| {
            let between = surface.iter().zip(&base).filter(|(surface, base)| *surface - *base >= 1);
            2 * between.count() > directions.len()
        });
        let leaving = surface.iter().filter(|&&count| count >= 1).count();
        let is_inside = in_relief || leaving as f32 >= CLOSED * directions.len() as f32;
        Ok(is_inside.then_some(in_relief))
    }

    /// The lights that are meant to give light, and where they are in world units.
    fn lights(&self) -> impl Iterator<Item = (&PointLight, DVec3)> {
        let lights = self.job.buffers.lights.iter().take(self.job.frame.light_count as usize);
        let lights = lights.enumerate().filter(|(_, l)| l.intensity > 0.0 && l.color.max_element() > 0.0);
        // As they were asked for, where they were: the key light is none of these.
        lights.map(|(i, light)| {
            let given = self.job.lights.get(i).map(|given| given.position);
            (light, given.unwrap_or_else(|| self.world(light.position)))
        })
    }

    /// Whether nothing in a picture is brighter than ambient light could make it.
    fn may_be_dark(&self, ground: &Ground<'_>, pixels: &[Vec4]) -> bool {
        let Frame { ambient, background, background_alpha, .. } = self.job.frame;
        if self.job.features.shade != shade::LIT || self.lights().next().is_none() {
            return false;
        }
        // A pixel is a mean of samples and of the background; of the transparent one alpha has the share.
        let mut most = ambient * ground.brightest * (1.0 + 1e-4);
        if background_alpha > 0.0 {
            most = most.max(background.max_element() * (1.0 + 1e-4));
        }
        !pixels.iter().any(|pixel| pixel.truncate().max_element() > most * pixel.w)
    }

    /// Whether the picture is the same without lights.
    fn is_dark(&mut self, pixels: &[Vec4], samples: u32) -> Result<bool, BackendError> {
        let frame = self.job.frame;
        let part = |length: u32, most: u32| length.div_ceil(length.div_ceil(most));
        let (width, height) = (part(frame.width, SMALL.0), part(frame.height, SMALL.1));
        let small = Frame { width, height, ..frame };
        let Some(with) = self.picture(&small, 1)? else { return Ok(false) };
        let without = self.picture(&Frame { light_count: 0, ..small }, 1)?;
        if !without.is_some_and(|without| is_same(&with, &without)) {
            return Ok(false);
        }
        let without = self.picture(&Frame { light_count: 0, ..frame }, samples)?;
        Ok(without.is_some_and(|without| is_same(pixels, &without)))
    }
}

/// Whether two pictures are the same to the bit; 0 and -0 are the same.
fn is_same(a: &[Vec4], b: &[Vec4]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a == b)
}

/// Whether a light gives nothing in floats at the point of a box that is nearest to it.
fn is_too_far(light: &PointLight, min: Vec3, max: Vec3) -> bool {
    let toward = light.position - light.position.clamp(min, max);
    let squared = toward.length_squared();
    let brightest = light.color.max_element() * light.intensity;
    !squared.is_finite() || squared > 0.0 && brightest > 0.0 && brightest / squared == 0.0
}

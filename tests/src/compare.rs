//! Whether two pictures show the same surface.
//!
//! Two backends round differently, so their pictures agree in two senses. Where a ray meets the same micro-triangle,
//! colours differ by rounding only. Where it passes a silhouette, a shadow's edge or the edge of a micro-triangle
//! within the rounding errors, it may fall on the other side, and the pixel shows something else entirely: a *flip*.
//! A flip is not taken on trust, nor are flips allowed for by number alone: the pixel must be what the reference shows
//! when its camera is turned by as much as rounding can turn it ([`against_cpu`]). So a wrong pixel in the middle of
//! a face stays a *stray*, and one stray fails the comparison.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::picture::Picture;
use emboss::render::{Job, render};
use emboss_kernels::interface::Triangle;
use emboss_kernels::math::{UNIT_ROUNDOFF, max_abs};
use std::ops::ControlFlow;

/// Half a step of an 8-bit code: two pictures that differ by less look alike.
pub const VISIBLE: f32 = 0.5 / 255.0;

/// By how much rounding can turn a ray, as a share of half the film's width. Film coordinates and direction take some
/// 8 roundings of u, of which Vulkan allows the division and the inverse root 2.5 and 2 ulp: 16 u. The surface
/// is off by 24 u of coordinates that are at most as large as the distance to the camera, over half the film's width
/// at distance 1, 0.3 and more: 80 u. Together below 2^-17, some 1/2700 of a pixel in a row of 96.
const TURN: f32 = 1.0 / 131_072.0;

/// Directions in which [`against_cpu`] turns the camera: however an edge runs, one of them crosses it almost squarely.
const TURNS: [(f32, f32); 8] =
    [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (0.7, 0.7), (-0.7, -0.7), (0.7, -0.7), (-0.7, 0.7)];

/// Greatest share of flips. A pixel flips where an edge passes within [`TURN`] of one of its rays. With four rays a
/// pixel and a micro-edge's length of ten pixels in each, the widest case of these tests, that is
/// 4 x 10 x 2/2700 = 3 % were every ray off by the whole bound; typical errors are a tenth of it.
const MOST_FLIPS: f64 = 0.003;

/// How a picture differs from a reference of the same size.
#[derive(Clone, Debug)]
#[must_use = "a comparison proves nothing until it is asserted"]
pub struct Comparison {
    width: u32,
    pixels: usize,
    tolerance: f32,
    strays: Vec<Stray>,
    flips: usize,
    greatest: f32,
}

/// A pixel that differs, for messages.
#[derive(Clone, Copy, Debug)]
struct Stray {
    index: usize,
    difference: f32,
}

impl Comparison {
    /// Compares pixel by pixel: those whose channels (linear, premultiplied, alpha too) differ by more than
    /// `tolerance` (times the reference's brightness, where that is above 1) are strays, and so is any that is not a
    /// number.
    ///
    /// # Panics
    /// Where the pictures differ in size.
    pub fn new(picture: &Picture, reference: &Picture, tolerance: f32) -> Comparison {
        assert_eq!((picture.width, picture.height), (reference.width, reference.height), "sizes differ");
        let mut comparison = Comparison {
            width: picture.width,
            pixels: picture.pixels.len(),
            tolerance,
            strays: Vec::new(),
            flips: 0,
            greatest: 0.0,
        };
        for index in 0..picture.pixels.len() {
            let difference = difference(picture, reference, index);
            if difference <= tolerance {
                comparison.greatest = comparison.greatest.max(difference);
            } else {
                comparison.strays.push(Stray { index, difference });
            }
        }
        comparison
    }

    /// Counts strays that agree with another reference as flips.
    pub fn excusing(mut self, picture: &Picture, other: &Picture) -> Comparison {
        let strays = self.strays.len();
        self.strays.retain(|stray| {
            let agrees = difference(picture, other, stray.index) <= self.tolerance;
            !agrees
        });
        self.flips += strays - self.strays.len();
        self
    }

    /// How many pixels nothing explains.
    #[must_use]
    pub fn strays(&self) -> usize {
        self.strays.len()
    }

    /// How many pixels agree only with another reference.
    #[must_use]
    pub fn flips(&self) -> usize {
        self.flips
    }

    /// The greatest difference of a channel among the pixels that agree.
    #[must_use]
    pub fn greatest(&self) -> f32 {
        self.greatest
    }

    /// Whether no pixel is a stray, and flips are few.
    #[must_use]
    pub fn is_same(&self) -> bool {
        self.strays.is_empty() && self.flips as f64 <= (MOST_FLIPS * self.pixels as f64).ceil()
    }

    /// Fails unless [`is_same`](Self::is_same).
    ///
    /// # Panics
    /// With `what` and the first strays.
    pub fn assert_same(&self, what: &str) {
        assert!(self.is_same(), "{what}: {self}");
    }
}

impl std::fmt::Display for Comparison {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Comparison { pixels, strays, flips, greatest, .. } = self;
        write!(
            f,
            "{} strays and {flips} flips of {pixels} pixels, the rest within {greatest:e}",
            strays.len()
        )?;
        for Stray { index, difference } in strays.iter().take(8) {
            let (x, y) = (index % self.width as usize, index / self.width as usize);
            write!(f, "; pixel ({x}, {y}) differs by {difference}")?;
        }
        Ok(())
    }
}

/// The greatest difference of a channel, as a share of the reference's brightness where that is above 1; NaN where a
/// channel is.
fn difference(picture: &Picture, reference: &Picture, index: usize) -> f32 {
    let (pixel, expected) = (picture.pixels[index], reference.pixels[index]);
    let channels = ((pixel - expected).abs() / expected.max_element().max(1.0)).to_array();
    channels.into_iter().fold(0.0, |greatest, d| if d > greatest || d.is_nan() { d } else { greatest })
}

/// Compares `picture` with what the CPU makes of the same job. Pixels that differ by more than `rounding` must
/// agree with the CPU's picture through a camera turned by `TURN` in one of eight directions.
pub fn against_cpu(job: &Job, samples: u32, picture: &Picture) -> Comparison {
    let mut comparison =
        Comparison::new(picture, &rendered(&mut CpuBackend::new(), job, samples), rounding(job));
    for (x, y) in TURNS {
        if comparison.strays() == 0 {
            break;
        }
        let turned = rendered(&mut CpuBackend::new(), &turned(job, x, y), samples);
        comparison = comparison.excusing(picture, &turned);
    }
    comparison
}

/// The greatest difference of a channel that rounding explains where both rays meet the same micro-triangle, as a share
/// of the pixel's brightness.
///
/// What is shown of a surface is brightness times something that changes about as fast as the normal, or slower. A
/// micro-vertex is off by 24 u of its coordinates (see `BaseTriangle::bounds`; u = 2^-24), the normal of a
/// micro-triangle by that divided by its height (a sliver turns round its longest side), and two backends by twice
/// that. Taken for the base triangle that is the median in height against its coordinates: rounding seldom reaches an
/// eighth of its bound, which leaves room for triangles of an eighth of that height. Maps add the rounding of
/// texture coordinates, 4 u of the map's side in texels on either backend, times the step from texel to texel, at
/// most 1.
fn rounding(job: &Job) -> f32 {
    let frame = &job.frame;
    let mut slopes: Vec<f32> = job.buffers.triangles.iter().map(|&t| inverse_height(job, t)).collect();
    let middle = slopes.len() / 2;
    let (_, &mut median, _) = slopes.select_nth_unstable_by(middle, f32::total_cmp);
    let colors = job.buffers.materials.iter().map(|map| map.color_width.max(map.color_height));
    let heights = job.buffers.displacements.iter().map(|map| map.map_width.max(map.map_height));
    let map_side = colors.chain(heights).fold(0, u32::max) as f32;
    UNIT_ROUNDOFF * (48.0 * median * frame.subdivisions as f32 + 8.0 * map_side)
}

/// The greatest coordinate of a base triangle divided by its height over its longest side.
fn inverse_height(job: &Job, triangle: Triangle) -> f32 {
    let [a, b, c] = triangle.vertices.map(|v| job.buffers.vertices[v as usize].position);
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let height = (b - a).cross(c - a).length() / longest;
    max_abs(a).max(max_abs(b)).max(max_abs(c)) / height
}

/// Root of the mean square difference of a channel, over pixels that both pictures cover.
pub fn rmse(picture: &Picture, reference: &Picture) -> f64 {
    let pairs = picture.pixels.iter().zip(&reference.pixels);
    let covered: Vec<f64> = pairs
        .filter(|(a, b)| a.w == 1.0 && b.w == 1.0)
        .map(|(a, b)| f64::from((a.truncate() - b.truncate()).length_squared() / 3.0))
        .collect();
    (covered.iter().sum::<f64>() / covered.len() as f64).sqrt()
}

/// A backend's picture of a job whose view is framed.
///
/// # Panics
/// Where the backend fails: the jobs of tests fit.
pub fn rendered(backend: &mut dyn Backend, job: &Job, samples: u32) -> Picture {
    let rendering = backend
        .load(&job.buffers, &job.frame, job.features)
        .and_then(|()| render(backend, job, samples, &mut |_| ControlFlow::Continue(())));
    rendering.unwrap_or_else(|error| panic!("{error}")).picture
}

/// The job with its camera turned by (x, y) times [`TURN`].
fn turned(job: &Job, x: f32, y: f32) -> Job {
    let mut job = job.clone();
    let camera = &mut job.frame.camera;
    let half_width = camera.right.length();
    camera.forward += (camera.right * x + camera.up.normalize() * (y * half_width)) * TURN;
    job
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec4;

    /// A disc of a colour that changes from pixel to pixel by some 8-bit steps, on a transparent ground.
    fn disc() -> Picture {
        let (width, height) = (48u32, 32u32);
        let pixel = |i: u32| {
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            let inside = (x - 24.0).powi(2) + (y - 16.0).powi(2) < 144.0;
            if inside { Vec4::new(x / 48.0, y / 32.0, 0.25, 1.0) } else { Vec4::ZERO }
        };
        Picture { width, height, pixels: (0..width * height).map(pixel).collect() }
    }

    fn is_same(picture: &Picture) -> bool {
        Comparison::new(picture, &disc(), VISIBLE).is_same()
    }

    /// A pixel in the middle of the disc.
    const MIDDLE: usize = 16 * 48 + 24;

    #[test]
    fn picture_is_the_same_as_itself() {
        assert!(is_same(&disc()));
    }

    #[test]
    fn picture_within_rounding_is_the_same() {
        let mut picture = disc();
        picture.pixels.iter_mut().for_each(|pixel| *pixel += Vec4::splat(0.9 * VISIBLE));
        assert!(is_same(&picture));
        assert!(Comparison::new(&picture, &disc(), VISIBLE).greatest() > 0.8 * VISIBLE);
    }

    #[test]
    fn bright_pixels_differ_by_a_share_of_their_brightness() {
        let (mut picture, mut reference) = (disc(), disc());
        reference.pixels[MIDDLE] = Vec4::new(3.0, 1.0, 1.0, 1.0);
        picture.pixels[MIDDLE] = Vec4::new(3.0 + 2.0 * VISIBLE, 1.0, 1.0, 1.0);
        assert!(Comparison::new(&picture, &reference, VISIBLE).is_same());
        picture.pixels[MIDDLE].x = 3.0 + 4.0 * VISIBLE;
        assert!(!Comparison::new(&picture, &reference, VISIBLE).is_same());
    }

    #[test]
    fn one_changed_pixel_shows() {
        for channel in 0..4 {
            let mut picture = disc();
            picture.pixels[MIDDLE][channel] -= 1.5 / 255.0;
            assert!(!is_same(&picture), "channel {channel}");
        }
    }

    #[test]
    fn pixel_that_is_no_number_shows() {
        for channel in 0..4 {
            let mut picture = disc();
            picture.pixels[MIDDLE][channel] = f32::NAN;
            assert!(!is_same(&picture), "channel {channel}");
        }
    }

    #[test]
    fn two_swapped_pixels_show() {
        let mut picture = disc();
        picture.pixels.swap(MIDDLE, MIDDLE + 1);
        assert!(!is_same(&picture));
    }

    #[test]
    fn picture_shifted_by_a_pixel_shows() {
        for pixels in [1, 48] {
            let mut picture = disc();
            picture.pixels.rotate_right(pixels);
            assert!(!is_same(&picture), "by {pixels}");
        }
    }

    #[test]
    fn swapped_channels_show() {
        let mut picture = disc();
        picture.pixels.iter_mut().for_each(|pixel| *pixel = Vec4::new(pixel.y, pixel.x, pixel.z, pixel.w));
        assert!(!is_same(&picture));
    }

    #[test]
    fn flips_are_excused_pixel_by_pixel() {
        let (mut picture, mut other) = (disc(), disc());
        picture.pixels[MIDDLE] = Vec4::ONE;
        picture.pixels[MIDDLE + 5] = Vec4::ONE;
        other.pixels[MIDDLE] = Vec4::ONE;
        let comparison = Comparison::new(&picture, &disc(), VISIBLE).excusing(&picture, &other);
        assert_eq!((comparison.strays(), comparison.flips()), (1, 1));
        assert!(!comparison.is_same());
        picture.pixels[MIDDLE + 5] = disc().pixels[MIDDLE + 5];
        assert!(Comparison::new(&picture, &disc(), VISIBLE).excusing(&picture, &other).is_same());
    }

    #[test]
    fn many_flips_are_no_rounding() {
        let other = disc();
        let mut reference = disc();
        reference.pixels.iter_mut().take(10).for_each(|pixel| *pixel = Vec4::ONE);
        let comparison = Comparison::new(&other, &reference, VISIBLE).excusing(&other, &other);
        assert_eq!((comparison.strays(), comparison.flips()), (0, 10));
        assert!(!comparison.is_same());
    }

    /// The cube through cameras turned by less than rounding could, and by as much as a twentieth of a pixel.
    #[test]
    fn only_what_rounding_turns_is_excused() {
        let (scene, settings) = crate::scenes::builtin_scene("builtin:cube", 8, 96, 72);
        let job = crate::scenes::job(scene, &settings);
        assert!(rounding(&job) < VISIBLE);
        let through = |turns: f32| {
            let picture = rendered(&mut CpuBackend::new(), &turned(&job, turns, 0.4 * turns), 2);
            against_cpu(&job, 2, &picture)
        };
        assert!(through(0.5).is_same());
        assert!(!through(128.0).is_same());
    }

    #[test]
    #[should_panic(expected = "pixel (24, 16) differs by")]
    fn message_names_the_pixel() {
        let mut picture = disc();
        picture.pixels[MIDDLE] = Vec4::ZERO;
        Comparison::new(&picture, &disc(), VISIBLE).assert_same("disc");
    }
}

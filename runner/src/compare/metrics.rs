//! By how much a picture and its hits differ from those of the reference.

use super::flip;
use emboss_kernels::interface::{Intersection, MISS};
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// What one view shows: its picture, and what the rays through the centres of its pixels hit.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// Opaque linear RGB, row-major.
    pub colors: Vec<Vec3>,
    /// A hit or a miss for each pixel; distances in model units.
    pub hits: Vec<Intersection>,
    /// Pixels of a row.
    pub width: usize,
}

/// The differences between two captures of one view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Mean [ꟻLIP](flip::flip) over all pixels, from 0 to 1.
    pub flip: f64,
    /// Peak signal to noise ratio of sRGB values in decibels; `None` where the pictures are equal.
    pub psnr_db: Option<f64>,
    /// Mean difference of distances in edge lengths of the base mesh, over pixels that both hit.
    pub depth_mean: f64,
    /// The difference that 99.9 % of these pixels do not exceed.
    pub depth_p999: f64,
    /// Mean angle between the normals in degrees, over the same pixels.
    pub normal_mean_degrees: f64,
    /// The angle that 99.9 % of these pixels do not exceed.
    pub normal_p999_degrees: f64,
    /// Pixels that the reference hits.
    pub reference_pixels: u64,
    /// Pixels that one of the two hits alone, without those that are missing: they lie on the wrong side of the
    /// silhouette.
    pub silhouette_pixels: u64,
    /// Pixels that only the reference hits, and that lie within its silhouette: holes.
    pub missing_pixels: u64,
}

/// How `test` differs from `reference`, a capture of the same view; `edge` is the length of an edge of the base mesh.
/// Returns the ꟻLIP map too.
pub fn errors(reference: &Capture, test: &Capture, edge: f64) -> (Errors, Vec<f32>) {
    let map = flip::flip(&reference.colors, &test.colors, reference.width);
    let both = || {
        let pairs = reference.hits.iter().zip(&test.hits);
        pairs.filter(|(a, b)| a.primitive != MISS && b.primitive != MISS)
    };
    let depths: Vec<f64> = both().map(|(a, b)| (f64::from(a.t) - f64::from(b.t)).abs() / edge).collect();
    let angles: Vec<f64> = both().map(|(a, b)| degrees_between(a.normal, b.normal)).collect();
    let (reference_hits, test_hits) = (is_hit(reference), is_hit(test));
    let (silhouette_pixels, missing_pixels) = outline(&reference_hits, &test_hits, reference.width);
    let errors = Errors {
        flip: flip::mean(&map),
        psnr_db: psnr(&reference.colors, &test.colors),
        depth_mean: mean(&depths),
        depth_p999: percentile(depths, 0.999),
        normal_mean_degrees: mean(&angles),
        normal_p999_degrees: percentile(angles, 0.999),
        reference_pixels: reference_hits.iter().filter(|&&hit| hit).count() as u64,
        silhouette_pixels,
        missing_pixels,
    };
    (errors, map)
}

fn is_hit(capture: &Capture) -> Vec<bool> {
    capture.hits.iter().map(|hit| hit.primitive != MISS).collect()
}

/// The angle between directions, exactly 0 between equal ones: a cosine alone would be off by up to 0.02 degrees there.
pub fn degrees_between(a: Vec3, b: Vec3) -> f64 {
    let (a, b) = (a.as_dvec3(), b.as_dvec3());
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// 0 of no values.
pub fn mean(values: &[f64]) -> f64 {
    if values.is_empty() { 0.0 } else { values.iter().sum::<f64>() / values.len() as f64 }
}

/// The least of the values that `share` of them do not exceed; 0 of no values.
pub fn percentile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to the number of values")]
    let rank = (share * values.len() as f64).ceil() as usize;
    values.get(rank.max(1) - 1).copied().unwrap_or(0.0)
}

/// The middle value; 0 of no values.
pub fn median(values: &[f64]) -> f64 {
    percentile(values.to_vec(), 0.5)
}

/// 10 log10(1 / mean square error) of sRGB values from 0 to 1.
fn psnr(reference: &[Vec3], test: &[Vec3]) -> Option<f64> {
    let code = |rgb: Vec3| rgb.map(crate::picture::srgb_from_linear).as_dvec3();
    let squares: Vec<f64> =
        reference.iter().zip(test).map(|(&a, &b)| (code(a) - code(b)).length_squared() / 3.0).collect();
    let error = mean(&squares);
    (error > 0.0).then(|| -10.0 * error.log10())
}

/// How many pixels are on the wrong side of the silhouette, and how many are missing within it: a region of misses that
/// holds no miss of the reference is a hole in the surface, however large. Regions grow across pixels' edges.
fn outline(reference: &[bool], test: &[bool], width: usize) -> (u64, u64) {
    let mut seen: Vec<bool> = test.to_vec();
    let mut missing = 0;
    for start in 0..test.len() {
        if seen[start] {
            continue;
        }
        let (mut region, mut next) = (vec![start], 0);
        seen[start] = true;
        while let Some(&pixel) = region.get(next) {
            next += 1;
            let x = pixel % width;
            let neighbours = [
                (x > 0).then(|| pixel - 1),
                (x + 1 < width).then_some(pixel + 1),
                pixel.checked_sub(width),
                (pixel + width < test.len()).then_some(pixel + width),
            ];
            for neighbour in neighbours.into_iter().flatten() {
                if !seen[neighbour] {
                    seen[neighbour] = true;
                    region.push(neighbour);
                }
            }
        }
        if region.iter().all(|&pixel| reference[pixel]) {
            missing += region.len() as u64;
        }
    }
    let different = reference.iter().zip(test).filter(|(a, b)| a != b).count() as u64;
    (different - missing, missing)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disc of hits, at distance 2 and facing +z.
    fn disc(centre: (f32, f32), radius: f32) -> Capture {
        let hit = |i: usize| {
            let (x, y) = ((i % 16) as f32 - centre.0, (i / 16) as f32 - centre.1);
            let primitive = if x * x + y * y <= radius * radius { 0 } else { MISS };
            Intersection { primitive, t: 2.0, normal: Vec3::Z, ..Intersection::default() }
        };
        let hits: Vec<_> = (0..256).map(hit).collect();
        let colors = hits.iter().map(|hit| if hit.primitive == MISS { Vec3::ZERO } else { Vec3::ONE });
        Capture { colors: colors.collect(), hits, width: 16 }
    }

    #[test]
    fn equal_captures_have_no_error() {
        let disc = disc((8.0, 8.0), 5.0);
        let (errors, map) = errors(&disc, &disc, 1.0);
        let reference_pixels = errors.reference_pixels;
        assert_eq!(errors, Errors { reference_pixels, ..Errors::default() });
        // The lattice points in a circle of radius 5: Gauss's circle problem.
        assert_eq!((reference_pixels, flip::mean(&map)), (81, 0.0));
    }

    /// Each of the disc's 11 rows moves by a pixel: one of each row is hit anew, one no longer.
    #[test]
    fn a_shifted_disc_is_off_by_a_pixel_on_both_sides() {
        let (errors, _) = errors(&disc((8.0, 8.0), 5.0), &disc((9.0, 8.0), 5.0), 1.0);
        assert_eq!((errors.silhouette_pixels, errors.missing_pixels), (22, 0));
        assert_eq!(errors.depth_mean, 0.0);
    }

    #[test]
    fn holes_are_missing_and_bites_are_of_the_silhouette() {
        let whole = disc((8.0, 8.0), 5.0);
        let mut torn = whole.clone();
        // Two pixels within, and one at the right end of the middle row.
        for pixel in [8 * 16 + 8, 8 * 16 + 9, 8 * 16 + 13] {
            torn.hits[pixel].primitive = MISS;
        }
        let (errors, _) = errors(&whole, &torn, 1.0);
        assert_eq!((errors.silhouette_pixels, errors.missing_pixels), (1, 2));
    }

    /// One pixel of the 81 is off by 3 units, which are 6 edges, and turned by 90 degrees.
    #[test]
    fn depths_are_in_edges_and_normals_in_degrees() {
        let near = disc((8.0, 8.0), 5.0);
        let mut far = near.clone();
        (far.hits[8 * 16 + 8].t, far.hits[8 * 16 + 8].normal) = (5.0, Vec3::X);
        let (errors, _) = errors(&near, &far, 0.5);
        assert!((errors.depth_mean - 6.0 / 81.0).abs() < 1e-12);
        assert!((errors.normal_mean_degrees - 90.0 / 81.0).abs() < 1e-12);
        assert_eq!((errors.depth_p999, errors.normal_p999_degrees), (6.0, 90.0));
    }

    #[test]
    fn percentiles_are_values_that_are_there() {
        let thousand = || (1..=1000).map(f64::from).collect::<Vec<_>>();
        assert_eq!(percentile(thousand(), 0.999), 999.0);
        assert_eq!(percentile(thousand(), 1.0), 1000.0);
        assert_eq!((percentile(vec![], 0.999), median(&[])), (0.0, 0.0));
        assert_eq!(median(&[9.0, 1.0, 5.0]), 5.0);
    }

    /// Half of the pixels are off by the code 0.5 in one channel of three: an error of 0.25 / 3 / 2, 13.8 dB.
    #[test]
    fn psnr_is_of_srgb_values() {
        let half = crate::picture::linear_from_srgb(0.5);
        let (black, red) = (Vec3::ZERO, Vec3::new(half, 0.0, 0.0));
        let db = psnr(&[black; 2], &[black, red]).expect("they differ");
        assert!((db - 10.0 * 24.0_f64.log10()).abs() < 1e-5, "{db}");
        assert_eq!(psnr(&[red], &[red]), None);
    }
}

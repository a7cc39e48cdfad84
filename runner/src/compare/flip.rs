//! ꟻLIP: how different two pictures look to someone who flips between them.
//!
//! Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild: *FLIP: A Difference Evaluator for Alternating
//! Images*, HPG 2020, with the constants of its published code. Written anew, since the published library would ask
//! users for a C++ compiler; a test compares it with what that library (the crate `nv-flip` 0.1.2) gives.

use glam::{Mat3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

/// Pixels of a degree of the viewer's sight: those of a screen that is 0.7 m wide, has 3840 pixels, and is 0.7 m away,
/// as the published library has it.
pub const PIXELS_PER_DEGREE: f32 = 67.0;

/// Exponent that compresses colour differences.
const COLOR_EXPONENT: f32 = 0.7;
/// Up to this share of the greatest colour difference errors are told apart finely...
const FINE_SHARE: f32 = 0.4;
/// ...on this part of the scale.
const FINE_RANGE: f32 = 0.95;
/// Width of the features that are looked for, in degrees.
const FEATURE_WIDTH: f32 = 0.082;
/// Exponent that stresses small differences of features.
const FEATURE_EXPONENT: f32 = 0.5;

/// The error of each pixel of `test`, from 0 (looks alike) to 1. Both are linear RGB, row-major, `width` pixels a row,
/// and as large; values are clamped to the range from 0 to 1.
pub fn flip(reference: &[Vec3], test: &[Vec3], width: usize) -> Vec<f32> {
    let (reference, test) = (Seen::new(reference, width), Seen::new(test, width));
    let most = most_color_difference();
    let pixels = reference.colors.par_iter().zip(&test.colors);
    let features = reference.features.par_iter().zip(&test.features);
    let error = |((&color_r, &color_t), (&feature_r, &feature_t)): ((&Vec3, &Vec3), (&Vec2, &Vec2))| {
        let color = redistributed(hyab(color_r, color_t).powf(COLOR_EXPONENT), most);
        let feature = (feature_r - feature_t).abs().max_element();
        let feature = (feature * std::f32::consts::FRAC_1_SQRT_2).powf(FEATURE_EXPONENT);
        color.powf(1.0 - feature)
    };
    pixels.zip(features).map(error).collect()
}

/// The mean of an error map; 0 of an empty one.
pub fn mean(map: &[f32]) -> f64 {
    let sum: f64 = map.iter().map(|&error| f64::from(error)).sum();
    if map.is_empty() { 0.0 } else { sum / map.len() as f64 }
}

/// What a viewer sees of a picture.
struct Seen {
    /// L*a*b* of what is left when the eye has blurred it, Hunt-adjusted.
    colors: Vec<Vec3>,
    /// How much of an edge and of a point each pixel is.
    features: Vec<Vec2>,
}

impl Seen {
    fn new(picture: &[Vec3], width: usize) -> Seen {
        let opponent: Vec<Vec3> =
            picture.par_iter().map(|rgb| opponent_from_linear(rgb.clamp(Vec3::ZERO, Vec3::ONE))).collect();
        Seen { colors: colors(&opponent, width), features: features(&opponent, width) }
    }
}

/// Section 4.1: contrast sensitivity as a blur of each opponent channel, then the colours that a screen can show. The
/// blur of blue and yellow is the sum of two Gaussians: there it is blurred by each, in the last two channels.
fn colors(opponent: &[Vec3], width: usize) -> Vec<Vec3> {
    const SPREAD: Vec4 = Vec4::new(0.0047, 0.0053, 0.04, 0.025);
    const BLUE_YELLOW: (f32, f32) = (34.1, 13.5);
    let pi = std::f32::consts::PI;
    let radius = (3.0 * (SPREAD.max_element() / (2.0 * pi * pi)).sqrt() * PIXELS_PER_DEGREE).ceil();
    let gauss = |x: f32| {
        let squared = (x / PIXELS_PER_DEGREE).powi(2) * pi * pi;
        Vec4::from(SPREAD.to_array().map(|b| (-squared / b).exp()))
    };
    let kernel = kernel(radius, gauss);
    let sum: Vec4 = kernel.iter().sum();
    let kernel: Vec<Vec4> = kernel.into_iter().map(|weight| weight / sum).collect();
    // Shares of the two Gaussians, whose kernels have the sum 1 by now.
    let (first, second) = (
        BLUE_YELLOW.0 * (pi / SPREAD.z).sqrt() * sum.z * sum.z,
        BLUE_YELLOW.1 * (pi / SPREAD.w).sqrt() * sum.w * sum.w,
    );
    let split: Vec<Vec4> = opponent.iter().map(|c| c.extend(c.z)).collect();
    let blurred = along_y(&along_x(&split, width, &kernel), width, &kernel);
    let seen = |c: &Vec4| {
        let blue_yellow = (first * c.z + second * c.w) / (first + second);
        let rgb = linear_from_opponent(Vec3::new(c.x, c.y, blue_yellow));
        hunt_adjusted(lab_from_linear(rgb.clamp(Vec3::ZERO, Vec3::ONE)))
    };
    blurred.par_iter().map(seen).collect()
}

/// Section 4.2: lengths of the first and the second derivative of luminance. Kernels are normalised so that the
/// positive and the negative weights have the sum 1 each.
fn features(opponent: &[Vec3], width: usize) -> Vec<Vec2> {
    let deviation = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
    let gauss = |x: f32| (-x * x / (2.0 * deviation * deviation)).exp();
    // Edge, point, none, none.
    let shape = |x: f32| {
        let g = gauss(x);
        Vec4::new(-x * g, (x * x / (deviation * deviation) - 1.0) * g, g, g)
    };
    let kernel = kernel((3.0 * deviation).ceil(), shape);
    let positive: Vec4 = kernel.iter().map(|weight| weight.max(Vec4::ZERO)).sum();
    let negative: Vec4 = kernel.iter().map(|weight| -weight.min(Vec4::ZERO)).sum();
    let normalized = |weight: &Vec4| {
        let sums = Vec4::select(weight.cmplt(Vec4::ZERO), negative, positive);
        *weight / sums
    };
    let across: Vec<Vec4> = kernel.iter().map(normalized).collect();
    let down: Vec<Vec4> = across.iter().map(|w| Vec4::new(w.z, w.z, w.x, w.y)).collect();
    let luminance: Vec<Vec4> = opponent.iter().map(|c| Vec4::splat((c.x + 16.0) / 116.0)).collect();
    let derivatives = along_y(&along_x(&luminance, width, &across), width, &down);
    derivatives.iter().map(|d| Vec2::new(d.x.hypot(d.z), d.y.hypot(d.w))).collect()
}

/// The weights of a kernel at whole pixels up to `radius`.
#[expect(clippy::cast_possible_truncation, reason = "a few tens")]
fn kernel(radius: f32, weight: impl Fn(f32) -> Vec4) -> Vec<Vec4> {
    let radius = radius as i32;
    (-radius..=radius).map(|x| weight(x as f32)).collect()
}

/// Filters rows; what is beyond the border is like the border.
fn along_x(picture: &[Vec4], width: usize, kernel: &[Vec4]) -> Vec<Vec4> {
    let radius = kernel.len() / 2;
    let filtered = |row: &[Vec4]| {
        let at = |x: usize, i: usize| row[(x + i).saturating_sub(radius).min(width - 1)];
        let sum = |x: usize| kernel.iter().enumerate().map(|(i, &weight)| weight * at(x, i)).sum();
        (0..row.len()).map(sum).collect::<Vec<Vec4>>()
    };
    picture.par_chunks(width.max(1)).flat_map_iter(filtered).collect()
}

/// Filters columns likewise.
fn along_y(picture: &[Vec4], width: usize, kernel: &[Vec4]) -> Vec<Vec4> {
    let (radius, height) = (kernel.len() / 2, picture.len() / width.max(1));
    let filtered = |y: usize| {
        let mut row = vec![Vec4::ZERO; width];
        for (i, &weight) in kernel.iter().enumerate() {
            let from = (y + i).saturating_sub(radius).min(height - 1) * width;
            row.iter_mut().zip(&picture[from..]).for_each(|(sum, &pixel)| *sum += weight * pixel);
        }
        row
    };
    (0..height).into_par_iter().flat_map_iter(filtered).collect()
}

/// The distance of colours: city block between lightness and colour, Euclidean within colour.
fn hyab(a: Vec3, b: Vec3) -> f32 {
    let d = a - b;
    d.x.abs() + d.y.hypot(d.z)
}

/// The greatest distance of colours on a screen, that of green and blue, compressed.
fn most_color_difference() -> f32 {
    let seen = |rgb| hunt_adjusted(lab_from_linear(rgb));
    hyab(seen(Vec3::Y), seen(Vec3::Z)).powf(COLOR_EXPONENT)
}

/// Section 4.1.3: gives most of the range from 0 to 1 to the smaller errors.
fn redistributed(error: f32, most: f32) -> f32 {
    let fine = FINE_SHARE * most;
    if error < fine {
        FINE_RANGE / fine * error
    } else {
        FINE_RANGE + (error - fine) / (most - fine) * (1.0 - FINE_RANGE)
    }
}

/// The white of D65.
const WHITE: Vec3 = Vec3::new(0.950_428_54, 1.0, 1.088_900_4);

/// XYZ from linear sRGB.
const XYZ: Mat3 = Mat3::from_cols(
    Vec3::new(10_135_552.0 / 24_577_794.0, 2_613_072.0 / 12_288_897.0, 1_425_312.0 / 73_733_382.0),
    Vec3::new(8_788_810.0 / 24_577_794.0, 8_788_810.0 / 12_288_897.0, 8_788_810.0 / 73_733_382.0),
    Vec3::new(4_435_075.0 / 24_577_794.0, 887_015.0 / 12_288_897.0, 70_074_185.0 / 73_733_382.0),
);

/// YCxCz: linear opponent colours.
fn opponent_from_linear(rgb: Vec3) -> Vec3 {
    let xyz = XYZ * rgb / WHITE;
    Vec3::new(116.0 * xyz.y - 16.0, 500.0 * (xyz.x - xyz.y), 200.0 * (xyz.y - xyz.z))
}

fn linear_from_opponent(c: Vec3) -> Vec3 {
    let y = (c.x + 16.0) / 116.0;
    XYZ.inverse() * (Vec3::new(y + c.y / 500.0, y, y - c.z / 200.0) * WHITE)
}

fn lab_from_linear(rgb: Vec3) -> Vec3 {
    const DELTA: f32 = 6.0 / 29.0;
    let curve = |t: f32| {
        if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
    };
    let f = (XYZ * rgb / WHITE).map(curve);
    Vec3::new(116.0 * f.y - 16.0, 500.0 * (f.x - f.y), 200.0 * (f.y - f.z))
}

/// Colours look paler where it is darker.
fn hunt_adjusted(lab: Vec3) -> Vec3 {
    Vec3::new(lab.x, 0.01 * lab.x * lab.y, 0.01 * lab.x * lab.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::linear_from_srgb;

    const WIDTH: usize = 64;
    const HEIGHT: usize = 36;

    /// Ramps with a chequered blue; the test picture has a patch of another red, a white pixel, a band of less green
    /// and stripes of another blue.
    #[expect(clippy::cast_possible_truncation, reason = "codes of 8 bits")]
    fn picture(test: bool) -> Vec<Vec3> {
        let pixel = |i: usize| {
            let (x, y) = (i % WIDTH, i / WIDTH);
            let mut code = [x * 255 / (WIDTH - 1), y * 255 / (HEIGHT - 1), (x * 7 + y * 13) % 256];
            if test {
                if (20..28).contains(&x) && (10..18).contains(&y) {
                    code[0] = 255 - code[0];
                }
                if (x, y) == (40, 24) {
                    code = [255; 3];
                }
                if y >= 28 {
                    code[1] = code[1].saturating_sub(20);
                }
                if (50..56).contains(&x) && x % 2 == 0 {
                    code[2] = (code[2] + 90) % 256;
                }
            }
            Vec3::from(code.map(|code| linear_from_srgb(f32::from(code as u8) / 255.0)))
        };
        (0..WIDTH * HEIGHT).map(pixel).collect()
    }

    #[test]
    fn equal_pictures_have_no_error() {
        let picture = picture(true);
        assert!(flip(&picture, &picture, WIDTH).iter().all(|&error| error == 0.0));
    }

    /// As the paper says, the greatest colour difference is 1; of white and black lightness alone differs by 100, which
    /// is less than that of green and blue.
    #[test]
    fn the_greatest_difference_is_one() {
        let all = |color| vec![color; 4];
        let error = |a, b| flip(&all(a), &all(b), 2)[0];
        assert!((error(Vec3::Y, Vec3::Z) - 1.0).abs() < 1e-3);
        let by_hand = redistributed(100.0_f32.powf(0.7), most_color_difference());
        assert!((error(Vec3::ONE, Vec3::ZERO) - by_hand).abs() < 1e-3);
    }

    /// What `nv-flip` 0.1.2, the published library, gives for these pictures; it prints six digits. Both compute in
    /// f32, where roots of small differences keep some four digits.
    #[test]
    fn the_published_library_agrees() {
        let map = flip(&picture(false), &picture(true), WIDTH);
        let expected = [
            (0, 0, 0.0),
            (24, 14, 0.482_129),
            (20, 10, 0.439_168),
            (40, 24, 0.386_036),
            (41, 24, 0.313_460),
            (10, 32, 0.503_256),
            (52, 5, 0.135_780),
            (63, 35, 0.475_834),
            (30, 27, 0.330_173),
        ];
        for (x, y, error) in expected {
            let ours = map[y * WIDTH + x];
            assert!((ours - error).abs() < 2e-4, "at {x}, {y}: {ours} instead of {error}");
        }
        assert!((mean(&map) - 0.182_425_6).abs() < 2e-5, "{}", mean(&map));
    }
}

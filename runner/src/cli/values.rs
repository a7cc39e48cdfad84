//! Values of arguments and options: text in, checked value or a message with a remedy out.

use super::inputs::{MapArgument, ModelArgument};
use crate::picture::{PictureFormat, linear_from_srgb};
use crate::settings::{Light, Subdivisions};
use clap::builder::{OsStringValueParser, TypedValueParser};
use emboss_kernels::interface::MAX_PRIMITIVES;
use glam::{DVec3, Vec3};
use std::path::PathBuf;
use std::time::Duration;

/// What stands for an argument that is left out before one that is given.
const LEFT_OUT: &str = "-";

/// The value of an argument that may be left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum OrDefault<T> {
    Default,
    Given(T),
}

impl<T> OrDefault<T> {
    pub(super) fn given(self) -> Option<T> {
        match self {
            OrDefault::Default => None,
            OrDefault::Given(value) => Some(value),
        }
    }
}

fn or_default<T>(text: &str, parse: fn(&str) -> Result<T, String>) -> Result<OrDefault<T>, String> {
    if text == LEFT_OUT { Ok(OrDefault::Default) } else { parse(text).map(OrDefault::Given) }
}

/// A file or `builtin:NAME`; a scene file where its name ends in `.toml`. File names need not be UTF-8.
pub(super) fn model() -> impl TypedValueParser<Value = ModelArgument> {
    OsStringValueParser::new().map(|text| match text.to_str() {
        Some(LEFT_OUT) => ModelArgument::default(),
        Some(name) if name.starts_with("builtin:") => ModelArgument::Builtin(name.to_owned()),
        _ => {
            let path = PathBuf::from(text);
            let is_scene = path.extension().is_some_and(|suffix| suffix.eq_ignore_ascii_case("toml"));
            if is_scene { ModelArgument::Scene(path) } else { ModelArgument::File(path) }
        }
    })
}

/// A file or `none`.
pub(super) fn map() -> impl TypedValueParser<Value = MapArgument> {
    OsStringValueParser::new().map(|text| match text.to_str() {
        Some(LEFT_OUT) => MapArgument::Default,
        Some("none") => MapArgument::None,
        _ => MapArgument::File(PathBuf::from(text)),
    })
}

pub(super) fn finite_or_default(text: &str) -> Result<OrDefault<f32>, String> {
    or_default(text, finite)
}

pub(super) fn subdivisions_or_default(text: &str) -> Result<OrDefault<Subdivisions>, String> {
    or_default(text, str::parse)
}

/// A number of parts.
pub(super) fn fixed_subdivisions(text: &str) -> Result<u32, String> {
    match text.parse()? {
        Subdivisions::Fixed(n) => Ok(n),
        Subdivisions::Auto { .. } => {
            Err("the reference has one N; write a whole number such as 512".to_owned())
        }
    }
}

/// A number that is neither NaN nor infinite, also not by rounding to `f32`.
pub(super) fn finite(text: &str) -> Result<f32, String> {
    let number =
        text.trim().parse::<f32>().map_err(|_| format!("`{text}` is no number; write one such as 0.5"))?;
    if number.is_finite() {
        Ok(number)
    } else {
        Err(format!("`{text}` is not finite; write a number such as 0.5"))
    }
}

pub(super) fn not_negative(text: &str) -> Result<f32, String> {
    let number = finite(text)?;
    if number >= 0.0 { Ok(number) } else { Err(format!("`{text}` is below 0; light is 0 or more")) }
}

pub(super) fn fov(text: &str) -> Result<f32, String> {
    let degrees = finite(text)?;
    // Between these the half angle's tangent is finite and not 0 in f32.
    if (0.01..=179.0).contains(&degrees) {
        Ok(degrees)
    } else {
        Err("the field of view is an angle from 0.01 to 179 degrees; try 35".to_owned())
    }
}

/// `on` or `off`.
pub(super) fn switch(text: &str) -> Result<bool, String> {
    match text {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err(format!("`{text}` is neither on nor off")),
    }
}

pub(super) fn samples(text: &str) -> Result<u32, String> {
    let count = text.parse().ok().filter(|&count: &u32| count > 0);
    count.ok_or_else(|| format!("a pixel has from 1 to {} samples; try 4", u32::MAX))
}

/// A budget of mean ꟻLIP.
pub(super) fn flip(text: &str) -> Result<f32, String> {
    finite(text).ok().filter(|budget| (0.0..=1.0).contains(budget)).ok_or_else(|| {
        format!("`{text}` is no budget; write a mean FLIP error from 0 (exact) to 1, such as 0.02")
    })
}

/// A number of primitives, also as 1e6.
pub(super) fn primitives(text: &str) -> Result<u32, String> {
    let wrong =
        || format!("`{text}` is no size; write a whole number from 1 to {MAX_PRIMITIVES}, such as 1e6");
    let number = text.trim().parse::<f64>().map_err(|_| wrong())?;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number in range")]
    if number.fract() == 0.0 && (1.0..=f64::from(MAX_PRIMITIVES)).contains(&number) {
        Ok(number as u32)
    } else {
        Err(wrong())
    }
}

/// A time in seconds, up to an hour.
pub(super) fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = not_negative(text).ok().filter(|&seconds| seconds <= 3600.0);
    seconds
        .map(Duration::from_secs_f32)
        .ok_or_else(|| format!("`{text}` is no time; write seconds from 0 to 3600, such as 1"))
}

/// A bandwidth in GB/s.
pub(super) fn bandwidth(text: &str) -> Result<f32, String> {
    finite(text)
        .ok()
        .filter(|&bandwidth| bandwidth > 0.0)
        .ok_or_else(|| format!("`{text}` is no bandwidth; write GB/s above 0, such as 50"))
}

/// `WIDTHxHEIGHT`. Kernels address pixels by a `u32`, and PNG allows 2^31 - 1 pixels a side.
pub(super) fn size(text: &str) -> Result<(u32, u32), String> {
    let sides = text.split_once(['x', 'X']);
    let (width, height) = sides
        .and_then(|(width, height)| Some((width.parse::<u64>().ok()?, height.parse::<u64>().ok()?)))
        .ok_or("a size is written as WIDTHxHEIGHT in pixels, such as 1920x1080")?;
    if width == 0 || height == 0 {
        return Err("a picture has at least 1x1 pixels".to_owned());
    }
    let longest = u64::from(i32::MAX.unsigned_abs());
    if width.max(height) > longest {
        return Err(format!("a side of a picture has at most {longest} pixels; choose a smaller size"));
    }
    let pixels = width.checked_mul(height).filter(|&pixels| pixels <= u64::from(u32::MAX));
    match (u32::try_from(width), u32::try_from(height), pixels) {
        (Ok(width), Ok(height), Some(_)) => Ok((width, height)),
        _ => Err(format!("a picture has at most {} pixels; choose a smaller size", u32::MAX)),
    }
}

pub(super) fn png_format(text: &str) -> Result<PictureFormat, String> {
    match text {
        "8" => Ok(PictureFormat::Png8),
        "16" => Ok(PictureFormat::Png16),
        _ => Err("a PNG has 8 or 16 bits a channel; for floats name the output .exr".to_owned()),
    }
}

/// Three numbers, `X,Y,Z`, with all their digits; finite also as `f32`.
pub(super) fn point(text: &str) -> Result<DVec3, String> {
    vector(text)?;
    let number = |word: &str| word.trim().parse().unwrap_or(f64::NAN);
    let numbers: Vec<f64> = text.split(',').map(number).collect();
    Ok(DVec3::from_slice(&numbers))
}

/// Three numbers, `X,Y,Z`.
pub(super) fn vector(text: &str) -> Result<Vec3, String> {
    match text.split(',').collect::<Vec<_>>()[..] {
        [x, y, z] => Ok(Vec3::new(finite(x)?, finite(y)?, finite(z)?)),
        _ => Err(format!("`{text}` is not of three numbers; write X,Y,Z without spaces, such as 0,1,-2.5")),
    }
}

/// An sRGB colour in [0,1]; returned linear.
pub(super) fn background(text: &str) -> Result<Vec3, String> {
    let code = vector(text)?;
    if code.cmpge(Vec3::ZERO).all() && code.cmple(Vec3::ONE).all() {
        Ok(code.map(linear_from_srgb))
    } else {
        Err("a colour's parts are from 0 to 1; divide codes such as 128 by 255".to_owned())
    }
}

/// `X,Y,Z[:R,G,B[:I]]`.
pub(super) fn light(text: &str) -> Result<Light, String> {
    let mut parts = text.split(':');
    let position = point(parts.next().unwrap_or_default())?;
    let color = parts.next().map_or(Ok(Vec3::ONE), vector)?;
    let intensity = parts.next().map(not_negative).transpose()?;
    if color.min_element() < 0.0 {
        return Err(format!("the colour of `{text}` has a part below 0; light is 0 or more"));
    }
    match parts.next() {
        None => Ok(Light { position, color, intensity }),
        Some(_) => {
            Err(format!("`{text}` has too many parts; write X,Y,Z, X,Y,Z:R,G,B or X,Y,Z:R,G,B:INTENSITY"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes() {
        assert_eq!(size("1920x1080"), Ok((1920, 1080)));
        assert_eq!(size("1X1"), Ok((1, 1)));
        assert!(size("0x5").expect_err("empty").contains("at least 1x1"));
        for wrong in ["5", "x", "axb", "-1x5", "1.5x2", ""] {
            assert!(size(wrong).expect_err(wrong).contains("WIDTHxHEIGHT"), "{wrong}");
        }
        for large in ["65536x65536", "4294967295x1", "99999999999x99999999999"] {
            assert!(size(large).expect_err(large).contains("smaller size"), "{large}");
        }
        assert_eq!(size("65535x65537"), Ok((65535, 65537)));
    }

    #[test]
    fn numbers() {
        assert_eq!(finite("-1.5e3"), Ok(-1500.0));
        for wrong in ["nan", "inf", "1e39", "", "1,5"] {
            assert!(finite(wrong).is_err(), "{wrong}");
        }
        assert!(not_negative("-0.1").is_err());
        assert!(fov("0").is_err() && fov("180").is_err() && fov("90") == Ok(90.0));
        assert!(samples("0").is_err() && samples("1") == Ok(1));
    }

    #[test]
    fn subdivisions() {
        let given = |n| Ok(OrDefault::Given(n));
        assert_eq!(subdivisions_or_default("4096"), given(Subdivisions::Fixed(4096)));
        assert_eq!(subdivisions_or_default("auto"), given(Subdivisions::Auto { pixels: 1.0 }));
        assert_eq!(subdivisions_or_default("auto:0.5"), given(Subdivisions::Auto { pixels: 0.5 }));
        assert_eq!(subdivisions_or_default("-"), Ok(OrDefault::Default));
        for wrong in ["0", "4097", "-1", "8.0", "auto:", "auto:0.05", "auto:65", "auto:nan", "automatic"] {
            assert!(subdivisions_or_default(wrong).expect_err(wrong).contains("from 1 to 4096"));
        }
    }

    #[test]
    fn primitive_counts() {
        assert_eq!(
            (primitives("1e6"), primitives("1000"), primitives("2.5e3")),
            (Ok(1_000_000), Ok(1000), Ok(2500))
        );
        for wrong in ["0", "-1", "1.5", "1e9", "nan", "", "x"] {
            assert!(primitives(wrong).expect_err(wrong).contains("such as 1e6"), "{wrong}");
        }
    }

    #[test]
    fn times_and_bandwidths() {
        assert_eq!(seconds("0.5"), Ok(Duration::from_millis(500)));
        assert!(seconds("-1").is_err() && seconds("1e9").is_err() && seconds("x").is_err());
        assert!(bandwidth("4300") == Ok(4300.0) && bandwidth("0").is_err() && bandwidth("inf").is_err());
    }

    #[test]
    fn vectors() {
        assert_eq!(vector("1,-2,0.5"), Ok(Vec3::new(1.0, -2.0, 0.5)));
        for wrong in ["1,2", "1,2,3,4", "a,b,c", "1,nan,2"] {
            assert!(vector(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn lights() {
        let plain = Light { position: DVec3::new(1.0, 2.0, 3.0), color: Vec3::ONE, intensity: None };
        assert_eq!(light("1,2,3"), Ok(plain));
        let red = Light { color: Vec3::X, intensity: Some(9.0), ..plain };
        assert_eq!(light("1,2,3:1,0,0:9"), Ok(red));
        for wrong in ["1,2", "1,2,3:1", "1,2,3:1,1,-1", "1,2,3:1,1,1:-1", "1,2,3:1,1,1:1:1", "1,2,3:1,1,1:"] {
            assert!(light(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn backgrounds_are_srgb() {
        assert_eq!(background("0,0,1"), Ok(Vec3::Z));
        let grey = background("0.5,0.5,0.5").expect("a colour");
        // The six digits of the published value.
        assert!((grey - Vec3::splat(0.214_041)).abs().max_element() < 1e-6, "{grey}");
        assert!(background("255,0,0").expect_err("codes").contains("255"));
    }
}

//! The finished picture and its way into a file.

use crate::whole_file;
use glam::{Vec3, Vec4};
use image::codecs::openexr::OpenExrEncoder;
use image::error::EncodingError;
use image::{ExtendedColorType, ImageEncoder, ImageError, ImageFormat, ImageResult};
use rayon::prelude::*;
use std::io::{BufWriter, Seek, Write};
use std::path::PathBuf;

/// A rectangle of pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels of a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Linear RGB premultiplied by alpha, row-major, top row first.
    pub pixels: Vec<Vec4>,
}

/// How a picture is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureFormat {
    /// PNG with 8 bits a channel: sRGB-encoded, not premultiplied.
    Png8,
    /// The same with 16 bits.
    Png16,
    /// OpenEXR with 32-bit floats: linear, premultiplied.
    Exr,
}

/// Why a picture cannot be stored. Messages name the file and what helps.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PictureError {
    /// The file's name tells no format.
    #[error("{}: pictures are stored as .png or .exr; give the file one of these endings", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// The file's folder is not there.
    #[error("{}: there is no folder {}; create it, or choose another --output", path.display(), folder.display())]
    NoFolder {
        /// The file.
        path: PathBuf,
        /// Its folder.
        folder: PathBuf,
    },
    /// Something stands where the file should be, and cannot be replaced.
    #[error("{}: this is no regular file; choose another --output", path.display())]
    NotAFile {
        /// The file.
        path: PathBuf,
    },
    /// The folder takes no files.
    #[error("{}: cannot write into {} ({reason}); choose another --output", path.display(), folder.display())]
    NotWritable {
        /// The file.
        path: PathBuf,
        /// Its folder.
        folder: PathBuf,
        /// What the system said.
        reason: std::io::Error,
    },
    /// Writing failed half-way: what was at the path before is still there.
    #[error("{}: the picture could not be written ({reason}); make room or choose another --output", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the encoder or the system said.
        reason: image::ImageError,
    },
}

/// Where a picture goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Destination {
    /// The file.
    pub path: PathBuf,
    /// How it is stored.
    pub format: PictureFormat,
}

impl Destination {
    /// The destination whose format the file's ending tells: `.exr`, or `.png` with 8 bits a channel.
    pub fn new(path: PathBuf) -> Result<Destination, PictureError> {
        let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
        let format = match ending.as_ref().and_then(|ending| ending.to_str()) {
            Some("png") => PictureFormat::Png8,
            Some("exr") => PictureFormat::Exr,
            _ => return Err(PictureError::UnknownFormat { path }),
        };
        Ok(Destination { path, format })
    }

    /// Finds out whether a picture could be written, before the work that makes one: the folder has to exist and to
    /// take a file. What is at the path stays untouched.
    pub fn check(&self) -> Result<(), PictureError> {
        let folder = whole_file::folder(&self.path);
        if !folder.is_dir() {
            return Err(PictureError::NoFolder { path: self.path.clone(), folder: folder.to_owned() });
        }
        if self.path.exists() && !self.path.is_file() {
            return Err(PictureError::NotAFile { path: self.path.clone() });
        }
        self.temporary().map(drop)
    }

    /// Writes the picture to a temporary file beside its place, then renames it: whatever fails on the way, an older
    /// file at the path is kept and no half-written one is left. `command` is what makes the picture again: a PNG has
    /// it in a text chunk.
    pub fn write(&self, picture: &Picture, command: &str) -> Result<(), PictureError> {
        let failed = |reason| PictureError::Write { path: self.path.clone(), reason };
        let mut file = self.temporary()?;
        let mut writer = BufWriter::new(file.as_file_mut());
        encode(picture, self.format, command, &mut writer).map_err(failed)?;
        let flushed = writer.flush();
        drop(writer);
        flushed.and_then(|()| whole_file::keep(file, &self.target())).map_err(|e| failed(e.into()))
    }

    /// What the rename replaces: behind a symbolic link the file that it leads to, so that the link survives.
    fn target(&self) -> PathBuf {
        self.path.canonicalize().unwrap_or_else(|_| self.path.clone())
    }

    /// A new file beside the picture's place, gone when dropped.
    fn temporary(&self) -> Result<tempfile::NamedTempFile, PictureError> {
        let target = self.target();
        whole_file::temporary(&target).map_err(|reason| PictureError::NotWritable {
            path: self.path.clone(),
            folder: whole_file::folder(&target).to_owned(),
            reason,
        })
    }
}

/// Writes a picture in a format; a PNG with `command` in a text chunk.
fn encode(
    picture: &Picture,
    format: PictureFormat,
    command: &str,
    writer: impl Write + Seek,
) -> ImageResult<()> {
    match format {
        PictureFormat::Png8 => {
            let texels: Vec<[u8; 4]> = picture.pixels.par_iter().map(|&pixel| quantized8(pixel)).collect();
            encode_png(picture, png::BitDepth::Eight, texels.as_flattened(), command, writer)
        }
        PictureFormat::Png16 => {
            let quantized = |&pixel| quantized16(pixel).map(u16::to_be_bytes);
            let texels: Vec<[[u8; 2]; 4]> = picture.pixels.par_iter().map(quantized).collect();
            let bytes = texels.as_flattened().as_flattened();
            encode_png(picture, png::BitDepth::Sixteen, bytes, command, writer)
        }
        PictureFormat::Exr => {
            let bytes = bytemuck::cast_slice(&picture.pixels);
            let (width, height) = (picture.width, picture.height);
            OpenExrEncoder::new(writer).write_image(bytes, width, height, ExtendedColorType::Rgba32F)
        }
    }
}

/// The keyword of the text chunk that holds the command.
pub const COMMAND_KEYWORD: &str = "Command";

fn encode_png(
    picture: &Picture,
    depth: png::BitDepth,
    bytes: &[u8],
    command: &str,
    writer: impl Write,
) -> ImageResult<()> {
    let failed = |error| match error {
        png::EncodingError::IoError(error) => ImageError::IoError(error),
        error => ImageError::Encoding(EncodingError::new(ImageFormat::Png.into(), error)),
    };
    let mut encoder = png::Encoder::new(writer, picture.width, picture.height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(depth);
    let software = concat!("emboss ", env!("CARGO_PKG_VERSION"));
    encoder.add_text_chunk("Software".to_owned(), software.to_owned()).map_err(failed)?;
    // Files may have names of any script, for which a plain text chunk has no letters.
    encoder.add_itxt_chunk(COMMAND_KEYWORD.to_owned(), command.to_owned()).map_err(failed)?;
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(bytes).map_err(failed)?;
    writer.finish().map_err(failed)
}

/// A pixel as PNG wants it: divided by alpha, sRGB-encoded, in [0,1]. Colour without coverage is black; NaN is 0.
fn encoded(pixel: Vec4) -> [f32; 4] {
    let alpha = pixel.w;
    let color = if alpha > 0.0 { pixel.truncate() / alpha } else { Vec3::ZERO };
    [srgb_from_linear(color.x), srgb_from_linear(color.y), srgb_from_linear(color.z), alpha.clamp(0.0, 1.0)]
}

/// Nearest of 256 codes. The cast saturates and takes NaN to 0.
#[expect(clippy::cast_possible_truncation, reason = "the cast saturates")]
fn quantized8(pixel: Vec4) -> [u8; 4] {
    encoded(pixel).map(|channel| (channel * 255.0 + 0.5) as u8)
}

/// Nearest of 65536 codes.
#[expect(clippy::cast_possible_truncation, reason = "the cast saturates")]
fn quantized16(pixel: Vec4) -> [u16; 4] {
    encoded(pixel).map(|channel| (channel * 65535.0 + 0.5) as u16)
}

/// The sRGB transfer function (IEC 61966-2-1) on `[0, 1]`; what is outside is clamped.
pub fn srgb_from_linear(linear: f32) -> f32 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`srgb_from_linear`].
pub fn linear_from_srgb(code: f32) -> f32 {
    let code = code.clamp(0.0, 1.0);
    if code <= 0.040_45 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;
    use std::path::Path;

    fn picture() -> Picture {
        let pixels = vec![
            Vec4::new(1.0, 0.0, 0.0, 1.0),
            // Half covered by white.
            Vec4::splat(0.5),
            Vec4::ZERO,
            // Linear 0.215861 is the sRGB code 128 of 255; brighter than white is clamped.
            Vec4::new(0.215_861, 2.0, f32::NAN, 1.0),
        ];
        Picture { width: 2, height: 2, pixels }
    }

    fn decoded(format: PictureFormat) -> image::DynamicImage {
        let mut bytes = Cursor::new(Vec::new());
        encode(&picture(), format, "emboss render", &mut bytes).expect("encodes");
        image::load_from_memory(&bytes.into_inner()).expect("decodes")
    }

    #[test]
    fn png_is_srgb_and_not_premultiplied() {
        let image = decoded(PictureFormat::Png8);
        assert_eq!(image.color(), image::ColorType::Rgba8);
        let texels = image.to_rgba8().into_raw();
        let expected = [255, 0, 0, 255, 255, 255, 255, 128, 0, 0, 0, 0, 128, 255, 0, 255];
        assert_eq!(texels, expected);
    }

    #[test]
    fn png_tells_the_command_in_any_script() {
        for format in [PictureFormat::Png8, PictureFormat::Png16] {
            let mut bytes = Cursor::new(Vec::new());
            encode(&picture(), format, "emboss render жаба.obj", &mut bytes).expect("encodes");
            bytes.set_position(0);
            let reader = png::Decoder::new(bytes).read_info().expect("a PNG");
            let info = reader.info();
            let chunk = &info.utf8_text[0];
            assert_eq!(chunk.keyword, COMMAND_KEYWORD);
            assert_eq!(chunk.get_text().expect("plain"), "emboss render жаба.obj");
            assert!(info.uncompressed_latin1_text[0].text.starts_with("emboss "));
        }
    }

    #[test]
    fn png16_has_all_its_bits() {
        let image = decoded(PictureFormat::Png16);
        assert_eq!(image.color(), image::ColorType::Rgba16);
        let texels = image.to_rgba16().into_raw();
        assert_eq!(texels[..8], [65535, 0, 0, 65535, 65535, 65535, 65535, 32768]);
        // 128 * 257; the input has six digits, half a unit of the last moves the code by 0.04.
        assert_eq!(texels[12], 32896);
    }

    #[test]
    fn exr_is_linear_and_premultiplied() {
        let image = decoded(PictureFormat::Exr);
        let texels = image.as_rgba32f().expect("floats with alpha").as_raw().clone();
        assert_eq!(texels[..14], bytemuck::cast_slice::<Vec4, f32>(&picture().pixels)[..14]);
        assert!(texels[14].is_nan());
    }

    #[test]
    fn the_ending_tells_the_format() {
        let format = |name: &str| Destination::new(PathBuf::from(name)).map(|d| d.format).ok();
        assert_eq!(format("a.png"), Some(PictureFormat::Png8));
        assert_eq!(format("a.EXR"), Some(PictureFormat::Exr));
        assert_eq!(format("a.jpg"), None);
        assert_eq!(format("png"), None);
    }

    #[test]
    fn transfer_functions_are_inverse() {
        for i in 0..=100 {
            let linear = i as f32 / 100.0;
            // The curve's slope is at most 12.92 and its inverse's at most 2.3: rounding of the code (6e-8) and of
            // powf (a few ulp) grows to less than 1e-6.
            assert!((linear_from_srgb(srgb_from_linear(linear)) - linear).abs() < 1e-6);
        }
        assert!((srgb_from_linear(0.5) - 0.735_357).abs() < 1e-6);
    }

    fn destination(folder: &Path) -> Destination {
        Destination::new(folder.join("picture.png")).expect("a known ending")
    }

    #[test]
    fn a_missing_folder_is_found_before_rendering() {
        let folder = tempfile::tempdir().expect("a folder");
        let error = destination(&folder.path().join("none")).check().expect_err("missing");
        assert!(matches!(error, PictureError::NoFolder { .. }), "{error}");
    }

    #[test]
    fn a_folder_at_the_path_is_found_before_rendering() {
        let folder = tempfile::tempdir().expect("a folder");
        let destination = destination(folder.path());
        std::fs::create_dir(&destination.path).expect("a folder");
        assert!(matches!(destination.check(), Err(PictureError::NotAFile { .. })));
    }

    #[test]
    fn checking_leaves_nothing_behind() {
        let folder = tempfile::tempdir().expect("a folder");
        destination(folder.path()).check().expect("writable");
        assert_eq!(std::fs::read_dir(folder.path()).expect("readable").count(), 0);
    }

    #[test]
    fn writing_replaces_the_old_picture() {
        let folder = tempfile::tempdir().expect("a folder");
        let destination = destination(folder.path());
        std::fs::write(&destination.path, "old").expect("writable");
        destination.write(&picture(), "").expect("writable");
        assert!(image::open(&destination.path).is_ok());
        assert_eq!(std::fs::read_dir(folder.path()).expect("readable").count(), 1);
    }

    /// A writer that takes 10 bytes.
    struct Full(Cursor<Vec<u8>>);

    impl Write for Full {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            if self.0.position() + bytes.len() as u64 > 10 {
                return Err(std::io::ErrorKind::StorageFull.into());
            }
            self.0.write(bytes)
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    impl Seek for Full {
        fn seek(&mut self, position: std::io::SeekFrom) -> std::io::Result<u64> {
            self.0.seek(position)
        }
    }

    #[test]
    fn a_full_disk_is_an_error_in_every_format() {
        for format in [PictureFormat::Png8, PictureFormat::Png16, PictureFormat::Exr] {
            assert!(encode(&picture(), format, "", Full(Cursor::default())).is_err(), "{format:?}");
        }
    }
}

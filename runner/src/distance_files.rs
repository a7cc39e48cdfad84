//! Distance maps in files beside the height maps that they are of, so that each is computed once.
//!
//! `stones.png` has its own in `stones.png.repeat.cpu.emboss-distances`: how the map goes on beyond its borders, and
//! the backend that computed it; before that `.inverted` where texels are turned upside down, and `.negative` where
//! the scale is negative. What such a file was made of is in its key, so that one that is out of date is replaced.
//! Maps of built-in scenes are in no file, and neither are their distances.
//!
//! A file has, little endian: eight bytes that say so, the last one its version; the number of floats, 32 bits; the
//! key; SHA-256 of the floats; the floats, as [`distance_map`](emboss_kernels::relief::distance_map) orders them.

use crate::backend::{Backend, BackendError, DeviceInfo, kernels_hash};
use crate::render::Job;
use crate::whole_file;
use emboss_kernels::interface::{Displacement, height_format, method, wrap};
use emboss_kernels::relief::distance_map::{WORDS, is_turned};
use sha2::{Digest, Sha256};
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// How a file begins; its last byte is the version of what follows.
const MAGIC: [u8; 8] = *b"EMBDIST\x01";
/// Bytes before the floats.
const HEADER_BYTES: usize = MAGIC.len() + 4 + 32 + 32;
/// Bytes of a whole file.
const FILE_BYTES: usize = HEADER_BYTES + 4 * WORDS as usize;

/// The file of a distance map.
struct DistanceFile {
    path: PathBuf,
    key: Key,
}

/// SHA-256 of all that a distance map depends on: the texels as they are stored with their size, format and wrap,
/// whether great ones are low, the kernels' sources, and the device with its driver. Devices divide and take roots by
/// rules of their own, so that no other one's floats are the same to the bit.
type Key = [u8; 32];

/// Loads a job's buffers into a backend: distance maps out of their files as far as they are there, and writes the
/// others there once they are computed. A file that cannot be read or written is a warning.
///
/// # Errors
/// What the backend says.
pub fn load(backend: &mut dyn Backend, job: &mut Job) -> Result<(), BackendError> {
    let files = files(job, backend.device());
    job.buffers.distances = files.iter().map(|file| file.as_ref().and_then(DistanceFile::read)).collect();
    backend.load(&job.buffers, &job.frame, job.features)?;
    let known = std::mem::take(&mut job.buffers.distances);
    let missing = |i: usize| files[i].as_ref().filter(|_| known[i].is_none());
    if (0..files.len()).all(|i| missing(i).is_none()) {
        return Ok(());
    }
    let computed = backend.distance_maps()?;
    for (i, floats) in computed.chunks_exact(WORDS as usize).enumerate() {
        // Maps that differ in zero or scale alone share a file.
        let is_first =
            |file: &&DistanceFile| !files[..i].iter().flatten().any(|other| other.path == file.path);
        if let Some(file) = missing(i).filter(is_first) {
            file.write(floats);
        }
    }
    Ok(())
}

/// Where the distance maps of a job are kept on this device; none where its method reads none.
fn files(job: &Job, device: &DeviceInfo) -> Vec<Option<DistanceFile>> {
    if job.features.method != method::SPHERE || job.frame.triangle_count == 0 {
        return Vec::new();
    }
    let file = |(map, stem): (&Displacement, &Option<PathBuf>)| {
        let mut path = stem.clone()?.into_os_string();
        path.push(suffix(map, device));
        Some(DistanceFile { path: path.into(), key: key(map, &job.buffers.height_texels, device) })
    };
    job.buffers.displacements.iter().zip(&job.stems).map(file).collect()
}

/// What comes behind a map's own name, for what users of one map change often: these have files of their own.
fn suffix(map: &Displacement, device: &DeviceInfo) -> OsString {
    let sign = if is_turned(map) { ".negative" } else { "" };
    let wrap = match map.wrap {
        wrap::REPEAT => "repeat",
        wrap::CLAMP => "clamp",
        _ => "mirror",
    };
    format!("{sign}.{wrap}.{}.emboss-distances", device.backend).into()
}

fn key(map: &Displacement, texels: &[u32], device: &DeviceInfo) -> Key {
    let count = map.map_width as usize * map.map_height as usize;
    let words = match map.format {
        height_format::UNORM8 => count.div_ceil(4),
        height_format::UNORM16 => count.div_ceil(2),
        _ => count,
    };
    let first = map.first_word as usize;
    // What computes is compiled from these sources, for the CPU as for a device.
    // How many threads the processor has changes nothing.
    let driver = if device.backend == "cpu" { std::env::consts::ARCH } else { &device.details };
    let mut hash = Sha256::new();
    for text in [&kernels_hash(), device.backend, &device.name, driver] {
        hash.update((text.len() as u64).to_le_bytes());
        hash.update(text);
    }
    let turned = u32::from(is_turned(map));
    for word in [map.map_width, map.map_height, map.format, map.wrap, turned] {
        hash.update(word.to_le_bytes());
    }
    hash.update(bytes_of(texels[first..first + words].iter().map(|word| word.to_le_bytes())));
    hash.finalize().into()
}

fn bytes_of(words: impl Iterator<Item = [u8; 4]>) -> Vec<u8> {
    words.flatten().collect()
}

impl DistanceFile {
    /// The floats, if the file is there, is whole, and is of this key.
    fn read(&self) -> Option<Vec<f32>> {
        let shown = self.path.display();
        let bytes = match read_at_most(&self.path, FILE_BYTES + 1) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return None,
            Err(error) => {
                tracing::warn!("{shown}: cannot be read ({error}); distances are computed");
                return None;
            }
        };
        match self.parse(&bytes) {
            Ok(Some(floats)) => {
                tracing::debug!("{shown}: distances read");
                Some(floats)
            }
            Ok(None) => {
                tracing::debug!("{shown}: is of another map, device or version; distances are computed");
                None
            }
            Err(what) => {
                tracing::warn!("{shown}: {what}; distances are computed, and the file is replaced");
                None
            }
        }
    }

    /// The floats in a file; `None` where its key is another one.
    fn parse(&self, bytes: &[u8]) -> Result<Option<Vec<f32>>, &'static str> {
        let begins = |magic: &[u8]| bytes.len() >= magic.len() && bytes[..magic.len()] == *magic;
        if !begins(&MAGIC[..MAGIC.len() - 1]) {
            return Err("is no distance map");
        } else if !begins(&MAGIC) {
            return Ok(None);
        } else if bytes.len() != FILE_BYTES {
            return Err("has been cut off, or goes on too far");
        }
        let (header, floats) = bytes.split_at(HEADER_BYTES);
        let (count, hashes) = header[MAGIC.len()..].split_at(4);
        let (key, sum) = hashes.split_at(32);
        if *key != self.key {
            return Ok(None);
        } else if *count != WORDS.to_le_bytes() || *sum != Sha256::digest(floats)[..] {
            return Err("is damaged");
        }
        let (words, _) = floats.as_chunks();
        Ok(Some(words.iter().map(|word| f32::from_le_bytes(*word)).collect()))
    }

    /// Keeps the floats, if that can be.
    fn write(&self, floats: &[f32]) {
        let shown = self.path.display();
        match self.try_write(floats) {
            Ok(()) => tracing::debug!("{shown}: distances computed and kept"),
            Err(error) => tracing::warn!(
                "{shown}: distances cannot be kept ({error}), and will be computed again; --no-cache keeps none"
            ),
        }
    }

    /// Writes a temporary file and renames it, so that no other program sees half of one.
    fn try_write(&self, floats: &[f32]) -> io::Result<()> {
        let floats = bytes_of(floats.iter().map(|float| float.to_le_bytes()));
        let mut file = whole_file::temporary(&self.path)?;
        file.write_all(&MAGIC)?;
        file.write_all(&WORDS.to_le_bytes())?;
        file.write_all(&self.key)?;
        file.write_all(&Sha256::digest(&floats))?;
        file.write_all(&floats)?;
        whole_file::keep(file, &self.path)
    }
}

/// What a file has, cut off where it is longer than any that was written here.
fn read_at_most(path: &Path, bytes: usize) -> io::Result<Vec<u8>> {
    let mut content = Vec::with_capacity(bytes);
    File::open(path)?.take(bytes as u64).read_to_end(&mut content)?;
    Ok(content)
}

#[cfg(test)]
mod tests;

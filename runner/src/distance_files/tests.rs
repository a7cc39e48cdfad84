use super::*;
use crate::backend::cpu::CpuBackend;
use crate::render::{Scene, prepare};
use crate::scene::{Material, Relief, builtin};
use crate::settings::{Method, Settings, Wrap};
use std::fs;
use tempfile::TempDir;

/// A name in a folder of its own.
fn place() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let stem = folder.path().join("stones.png");
    (folder, stem)
}

/// The cube under `method`, whose relief is changed, as if its map were in the file.
fn job(stem: &Path, method: Method, change: impl FnOnce(&mut Relief)) -> Job {
    let cube = builtin::load("builtin:cube").expect("built in");
    let mut relief = Relief { stem: Some(stem.into()), ..Relief::new(cube.height, cube.zero, cube.scale) };
    change(&mut relief);
    let scene = Scene {
        mesh: cube.mesh,
        reliefs: vec![relief],
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions: 4,
    };
    prepare(scene, &Settings { method, width: 1, height: 1, ..Settings::default() }).expect("sound")
}

/// The distance maps of a job once it is loaded.
fn loaded(mut job: Job) -> Vec<f32> {
    let mut backend = CpuBackend::new();
    load(&mut backend, &mut job).expect("a small scene fits");
    assert!(job.buffers.distances.is_empty());
    backend.distance_maps().expect("the CPU does not fail")
}

fn sphere(stem: &Path, change: impl FnOnce(&mut Relief)) -> Vec<f32> {
    loaded(job(stem, Method::Sphere, change))
}

fn names(folder: &TempDir) -> Vec<String> {
    let entries = fs::read_dir(folder.path()).expect("readable").map(|entry| entry.expect("readable"));
    let mut names: Vec<_> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Puts another float into a file that is sound otherwise.
fn mark(path: &Path) {
    let mut bytes = fs::read(path).expect("written");
    bytes[FILE_BYTES - 4..].copy_from_slice(&0.125_f32.to_le_bytes());
    let sum = Sha256::digest(&bytes[HEADER_BYTES..]);
    bytes[HEADER_BYTES - 32..HEADER_BYTES].copy_from_slice(&sum);
    fs::write(path, bytes).expect("writable");
}

const FILE: &str = "stones.png.repeat.cpu.emboss-distances";

/// What is read is what was computed, to the bit; and it is read.
#[test]
fn distances_are_computed_once() {
    let (folder, stem) = place();
    let computed = sphere(&stem, |_| {});
    assert_eq!(names(&folder), [FILE]);
    assert_eq!(sphere(&stem, |_| {}), computed);
    mark(&folder.path().join(FILE));
    let read = sphere(&stem, |_| {});
    assert_eq!(read.last(), Some(&0.125));
    assert_eq!(read[..read.len() - 1], computed[..computed.len() - 1]);
    assert_ne!(computed.last(), Some(&0.125));
    // Zero, and how far it displaces, change nothing; without the name it is computed.
    let change = |relief: &mut Relief| (relief.zero, relief.scale) = (0.25, 7.0 * relief.scale);
    assert_eq!(sphere(&stem, change).last(), Some(&0.125));
    assert_eq!(sphere(&stem, |relief| relief.stem = None), computed);
    assert_eq!(names(&folder), [FILE]);
}

#[test]
fn only_the_method_that_reads_distances_has_files() {
    let (folder, stem) = place();
    let steep = || job(&stem, Method::Steep, |_| {});
    assert!(loaded(steep()).is_empty());
    assert_eq!(names(&folder), [""; 0]);
    // Nor does it look for any.
    assert!(files(&steep(), CpuBackend::new().device()).is_empty());
}

#[test]
fn what_distances_depend_on_has_other_files_or_replaces_them() {
    let (folder, stem) = place();
    let computed = sphere(&stem, |_| {});
    let negative = sphere(&stem, |relief| relief.scale = -relief.scale);
    let clamped = sphere(&stem, |relief| relief.wrap = Some(Wrap::Clamp));
    assert!(negative != computed && clamped != computed);
    let others =
        ["stones.png.clamp.cpu.emboss-distances", "stones.png.negative.repeat.cpu.emboss-distances", FILE];
    assert_eq!(names(&folder), others);
    mark(&folder.path().join(FILE));
    let edited = |relief: &mut Relief| {
        let mut map = (*relief.map).clone();
        map.texels[0] ^= 0xff;
        relief.map = map.into();
    };
    let fresh = sphere(&stem, |relief| {
        edited(relief);
        relief.stem = None;
    });
    assert_ne!(fresh.last(), Some(&0.125));
    assert_eq!(sphere(&stem, edited), fresh);
    // It was replaced: the old map's is computed again.
    assert_eq!(sphere(&stem, |_| {}), computed);
    assert_eq!(names(&folder), others);
}

#[test]
fn files_that_cannot_be_read_are_replaced() {
    let (folder, stem) = place();
    let path = folder.path().join(FILE);
    let computed = sphere(&stem, |_| {});
    let sound = fs::read(&path).expect("written");
    assert_eq!(sound.len(), FILE_BYTES);
    let changed = |at: usize| {
        let mut bytes = sound.clone();
        bytes[at] ^= 1;
        bytes
    };
    let broken = [
        vec![],
        b"not a map of distances".to_vec(),
        sound[..FILE_BYTES - 1].to_vec(),
        [&sound[..], &[0]].concat(),
        // The version, the count, the key, the sum, a float.
        changed(7),
        changed(8),
        changed(12),
        changed(44),
        changed(HEADER_BYTES + 2),
    ];
    for bytes in broken {
        fs::write(&path, &bytes).expect("writable");
        assert_eq!(sphere(&stem, |_| {}), computed);
        assert_eq!(fs::read(&path).expect("written"), sound);
    }
}

/// As on a full disk or in a folder of somebody else: there is no folder at all, or there is one at the file's place.
#[test]
fn files_that_cannot_be_written_are_none() {
    let (folder, stem) = place();
    let computed = sphere(&folder.path().join("missing").join("stones.png"), |_| {});
    assert_eq!(names(&folder), [""; 0]);
    fs::create_dir(folder.path().join(FILE)).expect("writable");
    assert_eq!(sphere(&stem, |_| {}), computed);
    assert!(names(&folder) == [FILE] && folder.path().join(FILE).is_dir());
}

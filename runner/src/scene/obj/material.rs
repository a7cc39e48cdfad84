//! The materials of a model's libraries (MTL files).
//!
//! Read here rather than by tobj, which keeps options in the file names, mixes up `bump` and normal maps, and gives
//! up a whole library for one unusual line.

use super::survey::Survey;
use crate::scene::{MapFile, ModelMaterial};
use crate::settings::Wrap;
use glam::Vec3;
use std::fs;
use std::path::{Path, PathBuf};
use tracing::warn;

/// A material of a library.
#[derive(Clone, Debug, Default)]
struct Material {
    name: String,
    albedo: Option<Vec3>,
    color: Option<MapFile>,
    /// `disp`, then `map_disp`, then `bump`: the first that is given counts.
    heights: [Option<MapFile>; 3],
    normal: Option<MapFile>,
}

/// The materials that a model uses, in the order of [`Survey::materials`]. Where it names none at all its libraries'
/// first map of each kind counts, and their first `Kd`. The files that were read are returned with them.
pub(super) fn load(model: &Path, survey: &Survey) -> (Vec<ModelMaterial>, Vec<PathBuf>) {
    let (library, files) = load_libraries(model, survey);
    if survey.materials.iter().all(String::is_empty) {
        return (vec![first_of_all(&library)], files);
    }
    let find = |name: &String| {
        let found = library.iter().find(|material| material.name == *name);
        if found.is_none() && !name.is_empty() && !library.is_empty() {
            warn!("{}: its libraries have no material `{name}`; going on without its maps", model.display());
        }
        ModelMaterial { name: name.clone(), ..found.cloned().map(ModelMaterial::from).unwrap_or_default() }
    };
    (survey.materials.iter().map(find).collect(), files)
}

/// What the materials of a library come to where nothing tells which of them counts.
fn first_of_all(library: &[Material]) -> ModelMaterial {
    let first = |map: fn(&Material) -> Option<&MapFile>| library.iter().find_map(map).cloned();
    ModelMaterial {
        name: String::new(),
        albedo: library.iter().find_map(|material| material.albedo),
        color: first(|material| material.color.as_ref()),
        height: first(|material| material.heights.iter().flatten().next()),
        normal: first(|material| material.normal.as_ref()),
    }
}

impl From<Material> for ModelMaterial {
    fn from(Material { name, albedo, color, heights, normal }: Material) -> Self {
        Self { name, albedo, color, height: heights.into_iter().flatten().next(), normal }
    }
}

/// The materials in all of a model's libraries, and those of the libraries' files that could be read. One that cannot
/// is a warning.
fn load_libraries(model: &Path, survey: &Survey) -> (Vec<Material>, Vec<PathBuf>) {
    let folder = model.parent().unwrap_or(Path::new(""));
    let (mut materials, mut files) = (Vec::new(), Vec::new());
    for (line, name) in &survey.libraries {
        for path in library_paths(folder, name) {
            match fs::read(&path) {
                Ok(bytes) => {
                    materials.extend(parse(&String::from_utf8_lossy(&bytes), &path));
                    files.push(path);
                }
                Err(error) => warn!(
                    "{}:{line}: material library {} cannot be read: {error}; going on without its maps",
                    model.display(),
                    path.display()
                ),
            }
        }
    }
    (materials, files)
}

/// The files that a `mtllib` line names: one whose name may hold spaces, or several.
fn library_paths(folder: &Path, names: &str) -> Vec<PathBuf> {
    let whole = join(folder, names);
    if whole.exists() || !names.contains(".mtl ") {
        return vec![whole];
    }
    names.split_whitespace().map(|name| join(folder, name)).collect()
}

/// The materials of a library. Lines that are not understood are passed over.
fn parse(text: &str, path: &Path) -> Vec<Material> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut materials: Vec<Material> = Vec::new();
    for line in text.lines().map(str::trim) {
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        if keyword == "newmtl" {
            materials.push(Material { name: rest.trim().into(), ..Material::default() });
        } else if let Some(material) = materials.last_mut() {
            material.set(&keyword.to_ascii_lowercase(), folder, rest);
        }
    }
    materials
}

impl Material {
    /// Takes a line that names a map or the colour; others are passed over.
    fn set(&mut self, keyword: &str, folder: &Path, rest: &str) {
        let slot = match keyword {
            "kd" => {
                self.albedo = color(rest);
                return;
            }
            "map_kd" => &mut self.color,
            "disp" => &mut self.heights[0],
            "map_disp" => &mut self.heights[1],
            "bump" | "map_bump" => &mut self.heights[2],
            "norm" | "map_norm" | "map_kn" => &mut self.normal,
            _ => return,
        };
        let (map, name) = map_options(rest);
        if !name.is_empty() {
            *slot = Some(MapFile { path: join(folder, name), ..map });
        }
    }
}

/// The colour of a `Kd` line: one number, or three. None where it is given otherwise (as a spectrum), or is no colour.
fn color(rest: &str) -> Option<Vec3> {
    let numbers: Vec<f32> = rest.split_whitespace().map(|word| word.parse().ok()).collect::<Option<_>>()?;
    let color = match numbers[..] {
        [grey] => Vec3::splat(grey),
        [r, g, b] => Vec3::new(r, g, b),
        _ => return None,
    };
    (color.is_finite() && color.min_element() >= 0.0).then_some(color)
}

/// What a map's options such as `-clamp on` or `-mm 0 1` say, and the file name after them.
fn map_options(rest: &str) -> (MapFile, &str) {
    let mut map = MapFile::default();
    let mut rest = rest.trim();
    while let Some((option, mut after)) = rest.starts_with('-').then(|| split_word(rest)) {
        let (least, most) = argument_count(option);
        let mut arguments = Vec::new();
        for i in 0..most {
            let (argument, beyond) = split_word(after);
            // The last word is the file, and optional arguments are numbers.
            if beyond.is_empty() || (i >= least && argument.parse::<f32>().is_err()) {
                break;
            }
            arguments.push(argument);
            after = beyond;
        }
        map.set(&option.to_ascii_lowercase(), &arguments);
        rest = after;
    }
    (map, rest.trim_matches('"'))
}

impl MapFile {
    /// Takes an option of a map; those that are not understood are passed over.
    fn set(&mut self, option: &str, arguments: &[&str]) {
        match (option, arguments) {
            ("-clamp", ["on"]) => self.wrap = Some(Wrap::Clamp),
            ("-clamp", ["off"]) => self.wrap = Some(Wrap::Repeat),
            ("-mm", [base, gain]) => {
                let finite = |text: &str| text.parse().ok().filter(|x: &f32| x.is_finite());
                self.base_and_gain = finite(base).zip(finite(gain));
            }
            _ => {}
        }
    }
}

/// How many arguments an option of a map takes, at least and at most.
fn argument_count(option: &str) -> (usize, usize) {
    match option.to_ascii_lowercase().as_str() {
        "-o" | "-s" | "-t" => (1, 3),
        "-mm" => (2, 2),
        _ => (1, 1),
    }
}

/// The first word and what follows it, without the space between.
fn split_word(text: &str) -> (&str, &str) {
    text.split_once(char::is_whitespace).map_or((text, ""), |(word, after)| (word, after.trim_start()))
}

/// A path relative to a folder; Windows' separators are understood everywhere.
fn join(folder: &Path, name: &str) -> PathBuf {
    folder.join(name.replace('\\', "/"))
}

//! The maps that a model's material libraries (MTL files) name.
//!
//! Read here rather than by tobj, which keeps options in the file names, mixes up `bump` and normal maps, and gives
//! up a whole library for one unusual line.

use super::survey::Survey;
use crate::scene::MaterialMaps;
use std::fs;
use std::path::{Path, PathBuf};
use tracing::warn;

/// A material.
#[derive(Debug, Default, PartialEq, Eq)]
struct Material {
    name: String,
    color: Option<PathBuf>,
    /// `disp`, then `map_disp`, then `bump`: the first that is given counts.
    heights: [Option<PathBuf>; 3],
    normal: Option<PathBuf>,
}

/// The maps of the materials that a model uses. Where several materials name different maps, the first map of
/// each kind counts, and a warning names the others.
pub(super) fn load_maps(model: &Path, survey: &Survey) -> MaterialMaps {
    let materials = used(load_libraries(model, survey), &survey.materials);
    let pick = |kind: &str, map: fn(&Material) -> Option<&PathBuf>| {
        first(model, kind, materials.iter().filter_map(map))
    };
    MaterialMaps {
        color: pick("colour", |m| m.color.as_ref()),
        height: pick("height", |m| m.heights.iter().flatten().next()),
        normal: pick("normal", |m| m.normal.as_ref()),
    }
}

/// The materials in all of a model's libraries. One that cannot be read is a warning.
fn load_libraries(model: &Path, survey: &Survey) -> Vec<Material> {
    let folder = model.parent().unwrap_or(Path::new(""));
    let mut materials = Vec::new();
    for (line, name) in &survey.libraries {
        for path in library_paths(folder, name) {
            match fs::read(&path) {
                Ok(bytes) => materials.extend(parse(&String::from_utf8_lossy(&bytes), &path)),
                Err(error) => warn!(
                    "{}:{line}: material library {} cannot be read: {error}; going on without its maps",
                    model.display(),
                    path.display()
                ),
            }
        }
    }
    materials
}

/// The files that a `mtllib` line names: one whose name may hold spaces, or several.
fn library_paths(folder: &Path, names: &str) -> Vec<PathBuf> {
    let whole = join(folder, names);
    if whole.exists() || !names.contains(".mtl ") {
        return vec![whole];
    }
    names.split_whitespace().map(|name| join(folder, name)).collect()
}

/// The materials of `names` in their order, or all of them where faces name none.
fn used(mut materials: Vec<Material>, names: &[String]) -> Vec<Material> {
    if !names.is_empty() {
        materials.retain(|material| names.contains(&material.name));
        materials.sort_by_key(|material| names.iter().position(|name| *name == material.name));
    }
    materials
}

/// The first of some maps; a warning names those that differ from it.
fn first<'a>(model: &Path, kind: &str, mut maps: impl Iterator<Item = &'a PathBuf>) -> Option<PathBuf> {
    let first = maps.next()?;
    let mut unused: Vec<&PathBuf> = maps.filter(|&map| map != first).collect();
    unused.sort();
    unused.dedup();
    for map in unused {
        warn!(
            "{}: its materials name several {kind} maps; {} is used everywhere, {} is not",
            model.display(),
            first.display(),
            map.display()
        );
    }
    Some(first.clone())
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
            material.set_map(&keyword.to_ascii_lowercase(), folder, rest);
        }
    }
    materials
}

impl Material {
    /// Takes a line that names a map; others are passed over.
    fn set_map(&mut self, keyword: &str, folder: &Path, rest: &str) {
        let slot = match keyword {
            "map_kd" => &mut self.color,
            "disp" => &mut self.heights[0],
            "map_disp" => &mut self.heights[1],
            "bump" | "map_bump" => &mut self.heights[2],
            "norm" | "map_norm" | "map_kn" => &mut self.normal,
            _ => return,
        };
        let name = skip_options(rest);
        if !name.is_empty() {
            *slot = Some(join(folder, name));
        }
    }
}

/// The file name of a map, after options such as `-bm 0.5`, `-o 0 0 0` or `-clamp on`.
fn skip_options(rest: &str) -> &str {
    let mut rest = rest.trim();
    while let Some((option, mut after)) = rest.starts_with('-').then(|| split_word(rest)) {
        let (least, most) = argument_count(option);
        for i in 0..most {
            let (argument, beyond) = split_word(after);
            // The last word is the file, and optional arguments are numbers.
            if beyond.is_empty() || (i >= least && argument.parse::<f32>().is_err()) {
                break;
            }
            after = beyond;
        }
        rest = after;
    }
    rest.trim_matches('"')
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

//! Materials as the arguments, a scene file and a model's own libraries describe them.

use super::choices::{BUILTIN, DEFAULT, GIVEN, MATERIAL, NORMAL_MAP, SCENE_FILE};
use super::{MapArgument, Request};
use crate::normal_maps::NormalSpace;
use crate::scene::assembly::{MapSource, MaterialSource, NormalSource};
use crate::scene::scene_file::{SceneColor, SceneMaterial};
use crate::scene::{MapFile, ModelMaterial};
use crate::settings::DisplacementKind;
use std::path::{Path, PathBuf};

/// A material, and where what it says comes from.
pub(super) struct Described {
    /// What the model calls it; empty where it has no name.
    pub(super) name: String,
    /// Where a scene file describes it.
    pub(super) line: Option<usize>,
    pub(super) source: MaterialSource,
    pub(super) color: &'static str,
    pub(super) height: &'static str,
    pub(super) zero: &'static str,
    pub(super) scale: &'static str,
    pub(super) normal: &'static str,
    /// Maps that it names and that are not there.
    pub(super) missing: Vec<PathBuf>,
}

impl Described {
    /// Takes what the command line says of all materials.
    pub(super) fn change(&mut self, request: &Request<'_>) {
        let source = &mut self.source;
        match &request.color {
            MapArgument::Default => {}
            MapArgument::None => (source.color, self.color) = (None, GIVEN),
            MapArgument::File(path) => {
                (source.color, self.color) = (Some(MapSource::File(path.clone())), GIVEN);
            }
        }
        match &request.height {
            MapArgument::Default => {}
            MapArgument::None => (source.height, self.height) = (None, GIVEN),
            MapArgument::File(path) => {
                (source.height, self.height) = (Some(MapSource::File(path.clone())), GIVEN);
                // The zero of a vector map is that of its own format.
                if request.displacement.is_some_and(|kind| kind != DisplacementKind::Height)
                    && self.zero == BUILTIN
                {
                    (source.zero, self.zero) = (None, DEFAULT);
                }
            }
        }
        if let Some(zero) = request.zero {
            (source.zero, self.zero) = (Some(zero), GIVEN);
        }
        if let Some(scale) = request.scale {
            (source.scale, self.scale) = (scale, GIVEN);
        }
        source.scale *= request.exaggeration;
        if !request.reads_normals || request.normal_map.is_some() {
            source.normal = None;
        } else if let Some(NormalSource { path, .. }) = &source.normal
            && self.normal == MATERIAL
            && !path.is_file()
        {
            warn_of_missing(path);
            (source.normal, self.normal) = (None, DEFAULT);
        }
        if let Some(wrap) = request.wrap {
            source.set_wrap(wrap);
        }
        source.invert |= request.invert;
    }

    /// Takes what a scene file says of it.
    pub(super) fn choose(&mut self, material: &SceneMaterial) {
        let source = &mut self.source;
        self.line = Some(material.line);
        match &material.color {
            None => {}
            Some(SceneColor::None) => (source.color, self.color) = (None, SCENE_FILE),
            Some(SceneColor::Plain(albedo)) => {
                (source.color, source.albedo, self.color) = (None, Some(*albedo), SCENE_FILE);
            }
            Some(SceneColor::Map(path)) => {
                (source.color, self.color) = (Some(MapSource::File(path.clone())), SCENE_FILE);
            }
        }
        if let Some(height) = &material.height {
            (source.height, self.height) = (height.clone().map(MapSource::File), SCENE_FILE);
        }
        if let Some(zero) = material.zero {
            (source.zero, self.zero) = (Some(zero), SCENE_FILE);
        }
        if let Some(scale) = material.scale {
            (source.scale, self.scale) = (scale, SCENE_FILE);
        }
        if let Some(normal) = &material.normal {
            let space = material.normal_space;
            source.normal = normal.clone().map(|path| NormalSource { path, space, wrap: None });
            self.normal = SCENE_FILE;
        }
        if let Some(wrap) = material.wrap {
            source.set_wrap(wrap);
        }
        source.invert = material.invert.unwrap_or(source.invert);
    }

    /// A material of a model's file; `scale` is the height that its maps have where it says nothing of that.
    pub(super) fn of_model(material: ModelMaterial, scale: f32) -> Described {
        let named = [&material.color, &material.normal, &material.height].into_iter().flatten();
        let missing = named.map(|map| map.path.clone()).filter(|path| !path.is_file()).collect();
        let mut normal = material.normal;
        let mut color = existing(material.color).map(|map| (map, MATERIAL));
        if color.is_none() {
            // Where it is not there it was warned of now, and is not looked for again.
            normal = existing(normal);
            color = normal.clone().map(|map| (map, NORMAL_MAP));
        }
        let height = existing(material.height);
        // base + gain t = gain (t + base / gain)
        let range = height.as_ref().and_then(|map| map.base_and_gain);
        let is_usable = |&(base, gain): &(f32, f32)| (base / gain).is_finite();
        if let (Some(map), Some((base, gain))) = (&height, range.filter(|range| !is_usable(range))) {
            tracing::warn!(
                "{}: -mm {base} {gain} leaves no relief; the scale is chosen as if it were not there",
                map.path.display()
            );
        }
        let range = range.filter(is_usable);
        let color_origin = match (&color, material.albedo) {
            (Some((_, origin)), _) => origin,
            (None, Some(_)) => MATERIAL,
            (None, None) => DEFAULT,
        };
        Described {
            name: material.name,
            line: None,
            height: if height.is_some() { MATERIAL } else { DEFAULT },
            color: color_origin,
            zero: if range.is_some() { MATERIAL } else { DEFAULT },
            scale: if range.is_some() { MATERIAL } else { DEFAULT },
            normal: if normal.is_some() { MATERIAL } else { DEFAULT },
            missing,
            source: MaterialSource {
                albedo: material.albedo,
                color_wrap: color.as_ref().and_then(|(map, _)| map.wrap),
                color: color.map(|(map, _)| MapSource::File(map.path)),
                height_wrap: height.as_ref().and_then(|map| map.wrap),
                height: height.map(|map| MapSource::File(map.path)),
                sideways: None,
                zero: range.map(|(base, gain)| -base / gain),
                scale: range.map_or(scale, |(_, gain)| gain),
                invert: false,
                normal: normal.map(|MapFile { path, wrap, .. }| NormalSource {
                    path,
                    space: NormalSpace::Tangent,
                    wrap,
                }),
            },
        }
    }
}

/// A map that materials name, where it is there. Materials often come without their maps: that is worth a warning,
/// not an end.
fn existing(map: Option<MapFile>) -> Option<MapFile> {
    let map = map?;
    if !map.path.is_file() {
        warn_of_missing(&map.path);
        return None;
    }
    Some(map)
}

fn warn_of_missing(map: &Path) {
    tracing::warn!(
        "{}: the materials name this map, but it is not there; going on without it",
        map.display()
    );
}

//! Models: files, those of a scene file in their places, and built-in ones.

use super::choices::{BUILTIN, DEFAULT};
use super::materials::Described;
use super::{InputError, ModelArgument, USUAL_MODEL};
use crate::scene::assembly::{MapSource, MaterialSource};
use crate::scene::builtin::{self, BuiltinScene};
use crate::scene::error::SceneFileProblem;
use crate::scene::obj::{ObjModel, load_obj, load_subdivided_obj};
use crate::scene::scene_file::{MaterialChoice, ModelSource, SceneFile, SceneModel};
use crate::scene::subdivide::{Cage, Subdivide};
use crate::scene::{Mesh, SceneError};
use crate::settings::Light;
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The scale unless said otherwise, as a share of the diagonal of the model's box.
const SCALE_SHARE: f32 = 0.05;

/// A model before the arguments are settled.
pub(super) struct Model {
    pub(super) name: String,
    /// Where it was read from: itself, and its libraries of materials.
    pub(super) files: Vec<PathBuf>,
    pub(super) mesh: Mesh,
    /// At least one; the mesh's triangles name theirs.
    pub(super) materials: Vec<Described>,
    pub(super) builtin: Option<Recommended>,
    /// The line of a scene file that gives it other axes: turns it, mirrors it or stretches it.
    pub(super) turned: Option<usize>,
    /// Where its instances stand; none: it stands once.
    pub(super) places: Vec<DAffine3>,
}

/// What a built-in scene brings beside its mesh and its material.
pub(super) struct Recommended {
    pub(super) subdivisions: u32,
    pub(super) view: (Vec3, Vec3),
    pub(super) lights: Vec<Light>,
}

pub(super) fn load_model(
    argument: &ModelArgument,
    subdivide: Option<Subdivide>,
) -> Result<Model, InputError> {
    match argument {
        ModelArgument::File(path) | ModelArgument::Scene(path) => Ok(load_file(path, subdivide)?),
        ModelArgument::Builtin(name) => load_builtin(name, subdivide),
        ModelArgument::Default => load_builtin(USUAL_MODEL, subdivide),
    }
}

/// A model of a scene file in its place, with its materials; `subdivide` goes before what the file says.
pub(super) fn load_scene_model(
    scene: &SceneFile,
    model: &SceneModel,
    subdivide: Option<Subdivide>,
) -> Result<Model, InputError> {
    let subdivide = subdivide.or(model.subdivide);
    let wrong = |problem| SceneError::SceneFile { path: scene.path.clone(), line: model.line, problem };
    let mut loaded = match &model.source {
        ModelSource::Builtin(name) => load_builtin(name, subdivide)?,
        ModelSource::File(path) => {
            load_file(path, subdivide).map_err(|error| named_by(scene, model.line, error))?
        }
    };
    loaded.places.clone_from(&model.places);
    if model.world_from_model != DAffine3::IDENTITY {
        let moved = loaded.mesh.transformed(model.world_from_model);
        loaded.mesh = moved.ok_or_else(|| wrong(SceneFileProblem::Transform))?;
        let matrix = model.world_from_model.matrix3;
        let scale = matrix.x_axis.x;
        if scale <= 0.0 || matrix != DMat3::from_diagonal(DVec3::splat(scale)) {
            loaded.turned = Some(model.line);
        }
    }
    let known = || loaded.materials.iter().map(|material| material.name.clone());
    if let MaterialChoice::ByName(names) = &model.materials
        && let Some(name) = names.keys().find(|name| !known().any(|known| known == **name))
    {
        let known = known().filter(|name| !name.is_empty()).collect();
        return Err(wrong(SceneFileProblem::UnknownModelMaterial { name: name.clone(), known }).into());
    }
    // Heights that the scene file does not give keep their share of the model's size.
    #[expect(clippy::cast_possible_truncation, reason = "rounded")]
    let growth = model.world_from_model.matrix3.determinant().abs().cbrt() as f32;
    for material in &mut loaded.materials {
        material.source.scale *= growth;
        let chosen = match &model.materials {
            MaterialChoice::Own => None,
            MaterialChoice::All(name) => Some(name),
            MaterialChoice::ByName(names) => names.get(&material.name),
        };
        if let Some(chosen) = chosen {
            material.choose(&scene.materials[chosen]);
        }
    }
    Ok(loaded)
}

/// What is wrong with a file that a line of a scene file names.
pub(super) fn named_by(scene: &SceneFile, line: usize, source: SceneError) -> SceneError {
    SceneError::NamedBySceneFile { path: scene.path.clone(), line, source: Box::new(source) }
}

fn load_file(path: &Path, subdivide: Option<Subdivide>) -> Result<Model, SceneError> {
    let ObjModel { mesh, materials, libraries } = match &subdivide {
        Some(subdivide) => load_subdivided_obj(path, subdivide)?,
        None => load_obj(path)?,
    };
    let scale = SCALE_SHARE * diagonal(&mesh);
    let materials = materials.into_iter().map(|m| Described::of_model(m, scale)).collect();
    let (name, files) = (path.display().to_string(), [vec![path.to_owned()], libraries].concat());
    Ok(Model { name, files, mesh, materials, builtin: None, turned: None, places: vec![] })
}

fn load_builtin(name: &str, subdivide: Option<Subdivide>) -> Result<Model, InputError> {
    let unknown = || InputError::UnknownBuiltin { name: name.to_owned() };
    let BuiltinScene { mesh, height, sideways, color, zero, scale, subdivisions, view, up, lights } =
        builtin::load(name).ok_or_else(unknown)?;
    let mesh = match subdivide {
        Some(subdivide) if subdivide.levels > 0 => subdivide.mesh(Path::new(name), Cage::of_mesh(&mesh))?,
        _ => mesh,
    };
    let light = |light: emboss_kernels::interface::PointLight| Light {
        position: light.position,
        color: light.color,
        intensity: Some(light.intensity),
    };
    let source = MaterialSource {
        albedo: None,
        color: color.map(|map| MapSource::Made { name: name.to_owned(), map: Arc::new(map) }),
        color_wrap: None,
        height: Some(MapSource::Made { name: name.to_owned(), map: Arc::new(height) }),
        height_wrap: None,
        sideways: sideways.map(|maps| maps.map(Arc::new)),
        zero: Some(zero),
        scale,
        invert: false,
        normal: None,
    };
    let color = if source.color.is_some() { BUILTIN } else { DEFAULT };
    let material = Described {
        name: String::new(),
        line: None,
        source,
        color,
        height: BUILTIN,
        zero: BUILTIN,
        scale: BUILTIN,
        normal: DEFAULT,
        missing: vec![],
    };
    let lights = lights.into_iter().map(light).collect();
    let recommended = Recommended { subdivisions, view: (view, up), lights };
    Ok(Model {
        name: name.to_owned(),
        files: vec![],
        mesh,
        materials: vec![material],
        builtin: Some(recommended),
        turned: None,
        places: vec![],
    })
}

/// The diagonal of the mesh's box; 0 for an empty mesh.
#[expect(clippy::cast_possible_truncation, reason = "rounded, not cut off")]
fn diagonal(mesh: &Mesh) -> f32 {
    // In f64: squares of coordinates overflow before the coordinates do.
    mesh.bounds().map_or(0.0, |(min, max)| min.as_dvec3().distance(max.as_dvec3()) as f32)
}

//! Models: files, those of a scene file in their places, and built-in ones.

use super::choices::{BUILTIN, DEFAULT};
use super::materials::Described;
use super::{InputError, ModelArgument, USUAL_MODEL};
use crate::reports::repeated_triangles;
use crate::scene::assembly::{MapSource, MaterialSource};
use crate::scene::builtin::{self, BuiltinScene};
use crate::scene::error::SceneFileProblem;
use crate::scene::obj::{ObjModel, load_obj, load_subdivided_obj};
use crate::scene::precise::bounds;
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
    /// Parts of it that stand far from that mesh, with origins of their own.
    pub(super) apart: Vec<Mesh>,
    /// How many of its triangles repeat others.
    pub(super) repeats: Repeats,
    /// At least one; the mesh's triangles name theirs.
    pub(super) materials: Vec<Described>,
    pub(super) builtin: Option<Recommended>,
    /// The line of a scene file that gives it other axes: turns it, mirrors it or stretches it.
    pub(super) turned: Option<usize>,
    /// Where its instances stand; none: it stands once.
    pub(super) places: Vec<DAffine3>,
}

/// Repeated triangles of a model, before it is subdivided: what is made of one face is to be counted once.
#[derive(Clone, Copy, Debug)]
pub(super) struct Repeats {
    /// How many triangles lie on others.
    pub(super) repeated: u64,
    /// How many there are.
    pub(super) triangles: usize,
}

impl Repeats {
    /// The counts of meshes that stand apart, and so share no corner.
    fn of<'a>(meshes: impl Iterator<Item = &'a Mesh> + Clone) -> Repeats {
        let triangles = meshes.clone().map(|mesh| mesh.triangles.len()).sum();
        Repeats { repeated: meshes.map(repeated_triangles).sum(), triangles }
    }
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
        for mesh in std::iter::once(&mut loaded.mesh).chain(&mut loaded.apart) {
            let moved = mesh.placed(model.world_from_model);
            *mesh = moved.ok_or_else(|| wrong(SceneFileProblem::Transform))?;
        }
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
    let ObjModel { mesh, apart, control, materials, libraries } = match &subdivide {
        Some(subdivide) => load_subdivided_obj(path, subdivide)?,
        None => load_obj(path)?,
    };
    let scale = SCALE_SHARE * diagonal(std::iter::once(&mesh).chain(&apart));
    std::iter::once(&mesh).chain(&apart).for_each(|mesh| warn_of_place(path, mesh));
    let repeats = match &control[..] {
        [] => Repeats::of(std::iter::once(&mesh).chain(&apart)),
        control => Repeats::of(control.iter()),
    };
    let materials = materials.into_iter().map(|m| Described::of_model(m, scale)).collect();
    let (name, files) = (path.display().to_string(), [vec![path.to_owned()], libraries].concat());
    Ok(Model { name, files, mesh, apart, repeats, materials, builtin: None, turned: None, places: vec![] })
}

fn load_builtin(name: &str, subdivide: Option<Subdivide>) -> Result<Model, InputError> {
    let unknown = || InputError::UnknownBuiltin { name: name.to_owned() };
    let BuiltinScene { mesh, height, sideways, color, zero, scale, subdivisions, view, up, lights } =
        builtin::load(name).ok_or_else(unknown)?;
    let repeats = Repeats::of(std::iter::once(&mesh));
    let (mesh, apart) = match subdivide {
        Some(subdivide) if subdivide.levels > 0 => {
            let mut meshes = subdivide.meshes(Path::new(name), Cage::of_mesh(&mesh))?;
            (meshes.remove(0), meshes)
        }
        _ => (mesh, vec![]),
    };
    let light = |light: emboss_kernels::interface::PointLight| Light {
        position: light.position.as_dvec3(),
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
        apart,
        repeats,
        materials: vec![material],
        builtin: Some(recommended),
        turned: None,
        places: vec![],
    })
}

/// Farther from the origin than so many times a mesh's size, doubles have fewer digits of it than its relief needs:
/// 2^-20 of its size.
const FARTHEST: f64 = 8_589_934_592.0;

/// One line where the file's numbers cannot have had the digits that the mesh needs.
fn warn_of_place(path: &Path, mesh: &Mesh) {
    let far = mesh.space.origin.abs().max_element();
    let size = diagonal([mesh].into_iter());
    if far > FARTHEST * f64::from(size) {
        tracing::warn!(
            "{}: stands {far:e} from the origin, where double precision has too few digits for a model of size \
                {size:e}; move it nearer",
            path.display()
        );
    }
}

/// The diagonal of the box around meshes; 0 where they are empty.
#[expect(clippy::cast_possible_truncation, reason = "rounded, not cut off")]
fn diagonal<'a>(meshes: impl Iterator<Item = &'a Mesh>) -> f32 {
    // In f64: squares of coordinates overflow before the coordinates do.
    let corners = meshes.filter_map(Mesh::world_bounds).flat_map(|(min, max)| [min, max]);
    bounds(corners).map_or(0.0, |(min, max)| min.distance(max) as f32)
}

//! The six arguments: model, maps and relief, and what stands in for those that are left out.

mod choices;
mod materials;
mod models;

use super::reports::RepeatedFaces;
use crate::render::Scene;
use crate::reports::repeated_in;
use crate::scene::SceneError;
use crate::scene::assembly::{Assembly, MapSource, MaterialSource, ZERO};
use crate::scene::builtin;
use crate::scene::error::SceneFileProblem;
use crate::scene::scene_file::SceneFile;
use crate::scene::subdivide::Subdivide;
use crate::settings::{ChannelOrder, DisplacementKind, Light, Subdivisions, Wrap};
use crate::stats::agreed;
use choices::{BUILTIN, Choice, DEFAULT, GIVEN, SCENE_FILE, color_name, map_name, normal_name};
use glam::Vec3;
use materials::Described;
use models::{Model, load_model, load_scene_model, named_by};
use std::path::{Path, PathBuf};

/// N unless said otherwise: 256 micro-triangles for each triangle.
const SUBDIVISIONS: u32 = 16;

/// MODEL.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) enum ModelArgument {
    /// Left out.
    #[default]
    Default,
    /// A scene made by code, with `builtin:` before its name.
    Builtin(String),
    /// An OBJ file.
    File(PathBuf),
    /// A scene file.
    Scene(PathBuf),
}

/// COLOR or HEIGHT.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) enum MapArgument {
    /// Left out.
    #[default]
    Default,
    /// No map, though the model may name one.
    None,
    /// An image.
    File(PathBuf),
}

/// The six arguments as given, and the options that concern all maps.
pub(super) struct Request<'a> {
    pub(super) model: &'a ModelArgument,
    /// What the scene file says, where the model is one.
    pub(super) scene: Option<&'a SceneFile>,
    pub(super) color: MapArgument,
    pub(super) height: MapArgument,
    pub(super) zero: Option<f32>,
    pub(super) scale: Option<f32>,
    /// What the scales of all materials are multiplied by.
    pub(super) exaggeration: f32,
    pub(super) subdivisions: Option<Subdivisions>,
    /// How all models are subdivided, whatever a scene file says.
    pub(super) subdivide: Option<Subdivide>,
    pub(super) invert: bool,
    /// `--normal-map`: of all materials.
    pub(super) normal_map: Option<&'a Path>,
    /// Whether a method may read normal maps: those of materials are not read otherwise.
    pub(super) reads_normals: bool,
    /// Whether what is computed of maps is kept beside them.
    pub(super) cache: bool,
    /// `--wrap`: of all maps, whatever their materials say.
    pub(super) wrap: Option<Wrap>,
    pub(super) displacement: Option<DisplacementKind>,
    pub(super) channels: Option<ChannelOrder>,
}

impl Request<'_> {
    fn channels(&self) -> Option<ChannelOrder> {
        self.channels.or(self.scene.and_then(|scene| scene.channels))
    }
}

/// What the arguments come to.
pub(super) struct Inputs {
    pub(super) scene: Scene,
    /// What the height maps' texels displace along.
    pub(super) displacement: DisplacementKind,
    /// N.
    pub(super) subdivisions: Subdivisions,
    /// For the user: each argument's value and where it comes from.
    pub(super) choices: Vec<Choice>,
    /// The direction to the camera of a built-in scene that is alone, and what is up.
    pub(super) view: Option<(Vec3, Vec3)>,
    /// Its lights.
    pub(super) lights: Vec<Light>,
    /// Whether any material has a height map.
    pub(super) is_displaced: bool,
    /// The scale of all materials that have one, where it is one.
    pub(super) scale: Option<f32>,
    /// The files that were read.
    pub(super) files: Vec<PathBuf>,
    /// Maps that materials name and that are not there.
    pub(super) missing: Vec<PathBuf>,
    /// Whether N is what a built-in scene brings.
    pub(super) has_own_subdivisions: bool,
    /// Faces that lie on others.
    pub(super) repeated: RepeatedFaces,
}

/// The six arguments cannot be used.
#[derive(Debug, thiserror::Error)]
pub(super) enum InputError {
    /// No built-in scene has this name.
    #[error("there is no built-in scene `{name}`; choose {}", builtin::NAMES.join(", "))]
    UnknownBuiltin {
        /// The name, with `builtin:`.
        name: String,
    },
    /// Vectors are asked of a scene that has none.
    #[error("the relief of {name} is a height map; name a vector map as HEIGHT, or leave --displacement out")]
    NoVectors {
        /// The scene.
        name: String,
    },
    /// `--invert` with vectors.
    #[error(
        "--invert turns heights upside down; of a vector map choose the signs with --channels, as -r-b-g"
    )]
    InvertVectors,
    /// `--channels` without a vector map in a file.
    #[error(
        "--channels says which channels of a vector map are along which axes; name one as HEIGHT, with --displacement \
            tangent or object"
    )]
    ChannelsOfNothing,
    /// A file cannot be used.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

impl InputError {
    /// The file that cannot be used, where it is one.
    pub(super) fn file(&self) -> Option<&Path> {
        match self {
            InputError::Scene(error) => Some(error.file()),
            _ => None,
        }
    }
}

impl ModelArgument {
    /// What users know it by.
    pub(super) fn name(&self) -> String {
        match self {
            ModelArgument::Default => USUAL_MODEL.to_owned(),
            ModelArgument::Builtin(name) => name.clone(),
            ModelArgument::File(path) | ModelArgument::Scene(path) => {
                path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
            }
        }
    }
}

/// The model of those that name none.
const USUAL_MODEL: &str = "builtin:knot";

/// Loads what the arguments name, and fills in what they leave out.
pub(super) fn load(request: &Request<'_>) -> Result<Inputs, InputError> {
    let mut models = match request.scene {
        None => vec![load_model(request.model, request.subdivide)?],
        Some(scene) => {
            let load = |model| load_scene_model(scene, model, request.subdivide);
            scene.models.iter().map(load).collect::<Result<_, _>>()?
        }
    };
    if let Some(scene) = request.scene {
        for (name, line) in scene.idle_materials() {
            tracing::warn!("{}:{line}: no model has the material `{name}`", scene.path.display());
        }
    }
    let materials = models.iter_mut().flat_map(|model| &mut model.materials);
    materials.for_each(|material| material.change(request));
    let displacement = displacement_kind(request, &models)?;
    for model in &models {
        let has_vectors = |m: &Described| m.source.height.is_some() && m.source.sideways.is_some();
        if displacement == DisplacementKind::Height && model.materials.iter().any(has_vectors) {
            tracing::warn!(
                "{}: of its vectors only what is along the normal displaces, since other maps are of heights; \
                    --displacement tangent takes vectors from all",
                model.name
            );
        }
    }
    let recommended = models.iter().filter_map(|model| model.builtin.as_ref()).map(|b| b.subdivisions).max();
    let in_scene = request.scene.and_then(|scene| scene.subdivisions);
    let (subdivisions, n_origin) = match (request.subdivisions, in_scene, recommended) {
        (Some(n), ..) => (n, GIVEN),
        (None, Some(n), _) => (n, SCENE_FILE),
        (None, None, Some(n)) => (Subdivisions::Fixed(n), BUILTIN),
        (None, None, None) => (Subdivisions::Fixed(SUBDIVISIONS), DEFAULT),
    };
    let name = request.scene.map_or_else(|| models[0].name.clone(), |scene| scene.path.display().to_string());
    let model_origin = if *request.model == ModelArgument::Default { DEFAULT } else { GIVEN };
    let all = |name, of: fn(&Described) -> (String, &'static str)| {
        Choice::of_all(name, models.iter().flat_map(|model| &model.materials).map(of))
    };
    let mut choices = vec![
        Choice { name: "model", value: name, origin: model_origin },
        all("color", |m| (color_name(&m.source), m.color)),
        all("height", |m| (map_name(m.source.height.as_ref()), m.height)),
        all("zero", if displacement == DisplacementKind::Height { zero_of_heights } else { zero_of_vectors }),
        all("scale", |m| (m.source.scale.to_string(), m.scale)),
        Choice { name: "N", value: subdivisions.to_string(), origin: n_origin },
    ];
    let has_normals = |m: &Described| m.source.normal.is_some();
    if let Some(path) = request.normal_map {
        choices.push(Choice { name: "normal", value: path.display().to_string(), origin: GIVEN });
    } else if models.iter().flat_map(|model| &model.materials).any(has_normals) {
        choices.push(all("normal", |m| (normal_name(&m.source), m.normal)));
    }
    let (mut view, mut lights) = (None, Vec::new());
    if let (None, [Model { builtin: Some(builtin), .. }]) = (request.scene, &models[..]) {
        (view, lights) = (Some(builtin.view), builtin.lights.clone());
    }
    let sources = || models.iter().flat_map(|model| &model.materials).map(|material| &material.source);
    let displaced = || sources().filter(|source| source.height.is_some());
    let (scale, is_displaced) =
        (agreed(displaced().map(|source| source.scale)), displaced().next().is_some());
    let mut files: Vec<_> = request.scene.map(|scene| scene.path.clone()).into_iter().collect();
    files.extend(models.iter().flat_map(|model| model.files.clone()));
    files.extend(
        sources()
            .flat_map(|source| {
                let normal = source.normal.as_ref().map(|normal| normal.path.clone());
                [file(source.color.as_ref()), file(source.height.as_ref()), normal]
            })
            .flatten(),
    );
    let described = models.iter().flat_map(|model| &model.materials);
    let missing = described.flat_map(|material| material.missing.clone()).collect();
    let channels = request.channels().unwrap_or(match displacement {
        DisplacementKind::Object => ChannelOrder::Custom([(0, false), (1, false), (2, false)]),
        DisplacementKind::Height | DisplacementKind::Tangent => ChannelOrder::Blender,
    });
    let mut repeated = RepeatedFaces::default();
    for Model { name, repeats, .. } in &models {
        repeated.add_model(name, repeats.repeated, repeats.triangles);
    }
    let is_one = models.len() == 1 && models[0].places.len() <= 1;
    let mut assembly = Assembly::new(displacement, channels);
    for Model { mesh, apart, materials, places, .. } in models {
        let ids = materials.iter().map(|material| {
            let is_named = [material.color, material.height, material.normal].contains(&SCENE_FILE);
            assembly.material(&material.source).map_err(|error| match (request.scene, material.line) {
                (Some(scene), Some(line)) if is_named => named_by(scene, line, error),
                _ => error,
            })
        });
        let ids = ids.collect::<Result<Vec<_>, _>>()?;
        for mesh in std::iter::once(mesh).chain(apart) {
            if places.is_empty() {
                assembly.add(mesh, &ids);
            } else {
                assembly.add_placed(mesh, &ids, places.clone());
            }
        }
    }
    let mut scene = assembly.finish(subdivisions.most());
    if !is_one {
        repeated.add_scene(request.scene.map(|scene| scene.path.as_path()), repeated_in(&scene));
    }
    if !request.cache {
        scene.reliefs.iter_mut().for_each(|relief| relief.stem = None);
    }
    Ok(Inputs {
        scene,
        displacement,
        subdivisions,
        choices,
        view,
        lights,
        is_displaced,
        scale,
        files,
        missing,
        has_own_subdivisions: n_origin == BUILTIN,
        repeated,
    })
}

fn zero_of_heights(material: &Described) -> (String, &'static str) {
    (material.source.zero.unwrap_or(ZERO).to_string(), material.zero)
}

fn zero_of_vectors(material: &Described) -> (String, &'static str) {
    let by_format = || "0 of floats, 0.5 of integers".to_owned();
    (material.source.zero.map_or_else(by_format, |zero| zero.to_string()), material.zero)
}

/// What texels displace along: as given, else what the map of a built-in scene is for, else heights.
fn displacement_kind(request: &Request<'_>, models: &[Model]) -> Result<DisplacementKind, InputError> {
    let made = |source: &MaterialSource| matches!(source.height, Some(MapSource::Made { .. }));
    let sources = || models.iter().flat_map(|model| &model.materials).map(|material| &material.source);
    let with_maps = || sources().filter(|source| source.height.is_some());
    let all_vectors =
        with_maps().next().is_some() && with_maps().all(|source| made(source) && source.sideways.is_some());
    let own = if all_vectors { DisplacementKind::Tangent } else { DisplacementKind::Height };
    let kind = request.displacement.or(request.scene.and_then(|scene| scene.displacement)).unwrap_or(own);
    let is_vector = kind != DisplacementKind::Height;
    let of_heights = |model: &&Model| {
        model.materials.iter().any(|material| made(&material.source) && material.source.sideways.is_none())
    };
    if let (true, Some(model)) = (is_vector, models.iter().find(of_heights)) {
        return Err(InputError::NoVectors { name: model.name.clone() });
    }
    let from_file = is_vector && with_maps().any(|source| !made(source));
    if let (DisplacementKind::Object, Some(scene), Some(model)) =
        (kind, request.scene, models.iter().find(|model| model.turned.is_some()))
    {
        let (path, line) = (scene.path.clone(), model.turned.unwrap_or(1));
        Err(SceneError::SceneFile { path, line, problem: SceneFileProblem::TurnedVectors }.into())
    } else if is_vector && sources().any(|source| source.invert) {
        Err(InputError::InvertVectors)
    } else if request.channels().is_some() && !from_file {
        Err(InputError::ChannelsOfNothing)
    } else {
        Ok(kind)
    }
}

fn file<T>(map: Option<&MapSource<T>>) -> Option<PathBuf> {
    match map {
        Some(MapSource::File(path)) => Some(path.clone()),
        _ => None,
    }
}

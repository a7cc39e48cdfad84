//! The six arguments: model, maps and relief, and what stands in for those that are left out.

use crate::render::Scene;
use crate::scene::builtin::{self, BuiltinScene};
use crate::scene::image::{load_color_map, load_height_map};
use crate::scene::obj::load_obj;
use crate::scene::{ColorMap, HeightMap, MaterialMaps, Mesh, Relief, SceneError};
use crate::settings::Light;
use emboss_kernels::interface::height_format;
use glam::Vec3;
use std::fmt;
use std::path::{Path, PathBuf};

/// The texel value of no displacement unless said otherwise: mid-grey, so that a model keeps its size.
const ZERO: f32 = 0.5;
/// The scale unless said otherwise, as a share of the diagonal of the model's box.
const SCALE_SHARE: f32 = 0.05;
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

/// The six arguments as given, and `--invert`.
pub(super) struct Request {
    pub(super) model: ModelArgument,
    pub(super) color: MapArgument,
    pub(super) height: MapArgument,
    pub(super) zero: Option<f32>,
    pub(super) scale: Option<f32>,
    pub(super) subdivisions: Option<u32>,
    pub(super) invert: bool,
}

/// What the arguments come to.
pub(super) struct Inputs {
    pub(super) scene: Scene,
    /// For the user: each argument's value and where it comes from.
    pub(super) choices: [Choice; 6],
    /// A built-in scene's direction to the camera, and what is up.
    pub(super) view: Option<(Vec3, Vec3)>,
    /// A built-in scene's lights.
    pub(super) lights: Vec<Light>,
}

/// An argument's value and where it comes from.
pub(super) struct Choice {
    name: &'static str,
    value: String,
    origin: &'static str,
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
    /// A file cannot be used.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<7}{}  ({})", self.name, self.value, self.origin)
    }
}

const GIVEN: &str = "given";
const BUILTIN: &str = "built-in";
const MATERIAL: &str = "from the materials";
/// The geometry carries the relief, so a normal map has nothing to add to the shading; but where materials have no
/// other picture of the surface, it shows which part is which, as the program did that Emboss follows.
const NORMAL_MAP: &str = "from the materials: their normal map, for want of a map_Kd";
const DEFAULT: &str = "default";

/// A model before its arguments are settled: what stands in for those left out.
struct Model {
    name: String,
    mesh: Mesh,
    maps: MaterialMaps,
    builtin: Option<Recommended>,
}

/// What a built-in scene brings beside its mesh.
struct Recommended {
    height: HeightMap,
    color: Option<ColorMap>,
    zero: f32,
    scale: f32,
    subdivisions: u32,
    view: (Vec3, Vec3),
    lights: Vec<Light>,
}

/// A value, how it is shown, and where it comes from.
struct Settled<T> {
    value: T,
    shown: String,
    origin: &'static str,
}

impl<T> Settled<T> {
    fn new(value: T, shown: impl fmt::Display, origin: &'static str) -> Settled<T> {
        Settled { value, shown: shown.to_string(), origin }
    }

    fn choice(&self, name: &'static str) -> Choice {
        Choice { name, value: self.shown.clone(), origin: self.origin }
    }
}

/// Loads what the arguments name, and fills in what they leave out.
pub(super) fn load(request: &Request) -> Result<Inputs, InputError> {
    let mut model = load_model(&request.model)?;
    let builtin = model.builtin.as_ref();
    let zero = number(request.zero, builtin.map(|b| b.zero), || ZERO);
    let scale = number(request.scale, builtin.map(|b| b.scale), || SCALE_SHARE * diagonal(&model.mesh));
    let subdivisions = number(request.subdivisions, builtin.map(|b| b.subdivisions), || SUBDIVISIONS);
    let color = color_map(&request.color, &mut model)?;
    let height = height_map(request, zero.value, &mut model)?;
    warn_of_map(&height);

    let model_origin = if request.model == ModelArgument::Default { DEFAULT } else { GIVEN };
    let choices = [
        Choice { name: "model", value: model.name, origin: model_origin },
        color.choice("color"),
        height.choice("height"),
        zero.choice("zero"),
        scale.choice("scale"),
        subdivisions.choice("N"),
    ];
    let scene = Scene {
        mesh: model.mesh,
        reliefs: vec![Relief { map: height.value, zero: zero.value, scale: scale.value }],
        color_map: color.value,
        subdivisions: subdivisions.value,
    };
    let (view, lights) = model.builtin.map_or((None, Vec::new()), |b| (Some(b.view), b.lights));
    Ok(Inputs { scene, choices, view, lights })
}

fn load_model(argument: &ModelArgument) -> Result<Model, InputError> {
    match argument {
        ModelArgument::File(path) => {
            let (mesh, maps) = load_obj(path)?;
            Ok(Model { name: path.display().to_string(), mesh, maps, builtin: None })
        }
        ModelArgument::Builtin(name) => load_builtin(name),
        ModelArgument::Default => load_builtin("builtin:knot"),
    }
}

fn load_builtin(name: &str) -> Result<Model, InputError> {
    let unknown = || InputError::UnknownBuiltin { name: name.to_owned() };
    let BuiltinScene { mesh, height, color, zero, scale, subdivisions, view, up, lights } =
        builtin::load(name).ok_or_else(unknown)?;
    let light = |light: emboss_kernels::interface::PointLight| Light {
        position: light.position,
        color: light.color,
        intensity: Some(light.intensity),
    };
    let lights = lights.into_iter().map(light).collect();
    let recommended = Recommended { height, color, zero, scale, subdivisions, view: (view, up), lights };
    Ok(Model { name: name.to_owned(), mesh, maps: MaterialMaps::default(), builtin: Some(recommended) })
}

/// A number as given, else the built-in scene's, else the default.
fn number<T: fmt::Display>(given: Option<T>, builtin: Option<T>, default: impl FnOnce() -> T) -> Settled<T> {
    let (value, origin) = match (given, builtin) {
        (Some(value), _) => (value, GIVEN),
        (None, Some(value)) => (value, BUILTIN),
        (None, None) => (default(), DEFAULT),
    };
    let shown = value.to_string();
    Settled { value, shown, origin }
}

/// The diagonal of the mesh's box; 0 for an empty mesh.
#[expect(clippy::cast_possible_truncation, reason = "rounded, not cut off")]
fn diagonal(mesh: &Mesh) -> f32 {
    // In f64: squares of coordinates overflow before the coordinates do.
    mesh.bounds().map_or(0.0, |(min, max)| min.as_dvec3().distance(max.as_dvec3()) as f32)
}

fn color_map(argument: &MapArgument, model: &mut Model) -> Result<Settled<Option<ColorMap>>, InputError> {
    let load = |path: &Path, origin| -> Result<_, InputError> {
        Ok(Settled::new(Some(load_color_map(path)?), path.display(), origin))
    };
    match argument {
        MapArgument::File(path) => load(path, GIVEN),
        MapArgument::None => Ok(Settled::new(None, "none", GIVEN)),
        MapArgument::Default => match (&mut model.builtin, existing(model.maps.color.as_deref())) {
            (Some(builtin), _) if builtin.color.is_some() => {
                Ok(Settled::new(builtin.color.take(), &model.name, BUILTIN))
            }
            (None, Some(path)) => load(path, MATERIAL),
            _ => match existing(model.maps.normal.as_deref()) {
                Some(path) => load(path, NORMAL_MAP),
                None => Ok(Settled::new(None, "none", DEFAULT)),
            },
        },
    }
}

fn height_map(request: &Request, zero: f32, model: &mut Model) -> Result<Settled<HeightMap>, InputError> {
    let load = |path: &Path, origin| -> Result<_, InputError> {
        Ok(Settled::new(load_height_map(path, zero, request.invert)?, path.display(), origin))
    };
    match &request.height {
        MapArgument::File(path) => load(path, GIVEN),
        MapArgument::None => Ok(Settled::new(HeightMap::flat(zero), "none", GIVEN)),
        MapArgument::Default => match (&mut model.builtin, existing(model.maps.height.as_deref())) {
            (Some(builtin), _) => {
                let map = std::mem::replace(&mut builtin.height, HeightMap::flat(zero));
                let map = if request.invert { inverted(map) } else { map };
                Ok(Settled::new(map, &model.name, BUILTIN))
            }
            (None, Some(path)) => load(path, MATERIAL),
            _ => Ok(Settled::new(HeightMap::flat(zero), "none", DEFAULT)),
        },
    }
}

/// The map with each texel t replaced by 1 - t: for integer codes, packed in words, the complement of all bits.
fn inverted(map: HeightMap) -> HeightMap {
    let invert = |word: u32| match map.format {
        height_format::FLOAT32 => (1.0 - f32::from_bits(word)).to_bits(),
        _ => !word,
    };
    let texels = map.texels.into_iter().map(invert).collect();
    HeightMap { texels, range: (1.0 - map.range.1, 1.0 - map.range.0), ..map }
}

/// A map that materials name, where it is there. Materials often come without their maps: that is worth a warning,
/// not an end.
fn existing(path: Option<&Path>) -> Option<&Path> {
    let path = path?;
    if !path.is_file() {
        tracing::warn!(
            "{}: the materials name this map, but it is not there; going on without it",
            path.display()
        );
    }
    path.is_file().then_some(path)
}

/// One line for each thing about a height map that may surprise in the picture.
fn warn_of_map(height: &Settled<HeightMap>) {
    let Settled { value: map, shown, .. } = height;
    if map.has_steps() {
        tracing::warn!(
            "{shown}: has 8 bits, so that slopes come in 256 steps; a map of 16 bits or floats is smooth"
        );
    }
    if map.replaced > 0 {
        tracing::warn!("{shown}: {} texels are NaN or infinite; they do not displace", map.replaced);
    }
}

//! The six arguments: model, maps and relief, and what stands in for those that are left out.

use crate::render::Scene;
use crate::scene::builtin::{self, BuiltinScene};
use crate::scene::image::{load_color_map, load_height_map, load_vector_map};
use crate::scene::obj::load_obj;
use crate::scene::{ColorMap, HeightMap, MaterialMaps, Mesh, Relief, SceneError};
use crate::settings::{ChannelOrder, DisplacementKind, Light};
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

/// The six arguments as given, and the options that say how the height map is read.
pub(super) struct Request {
    pub(super) model: ModelArgument,
    pub(super) color: MapArgument,
    pub(super) height: MapArgument,
    pub(super) zero: Option<f32>,
    pub(super) scale: Option<f32>,
    pub(super) subdivisions: Option<u32>,
    pub(super) invert: bool,
    pub(super) displacement: Option<DisplacementKind>,
    pub(super) channels: Option<ChannelOrder>,
}

/// What the arguments come to.
pub(super) struct Inputs {
    pub(super) scene: Scene,
    /// What the height map's texels displace along.
    pub(super) displacement: DisplacementKind,
    /// The texel value of no displacement.
    pub(super) zero: f32,
    /// Height of a texel step from 0 to 1, in model units.
    pub(super) scale: f32,
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
        "--channels says which channels of a vector map are along which axes; name one as HEIGHT, with --displacement tangent or object"
    )]
    ChannelsOfNothing,
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
    sideways: Option<[HeightMap; 2]>,
    color: Option<ColorMap>,
    zero: f32,
    scale: f32,
    subdivisions: u32,
    view: (Vec3, Vec3),
    lights: Vec<Light>,
}

/// A height map, or the three of a vector map, each with the sign that its scale takes.
type Maps = Vec<(HeightMap, f32)>;

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
    let displacement = displacement_kind(request, &model)?;
    let builtin = model.builtin.as_ref();
    let scale = number(request.scale, builtin.map(|b| b.scale), || SCALE_SHARE * diagonal(&model.mesh));
    let subdivisions = number(request.subdivisions, builtin.map(|b| b.subdivisions), || SUBDIVISIONS);
    let color = color_map(&request.color, &mut model)?;
    let (height, zero) = height_maps(request, displacement, &mut model)?;
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
    let relief = |(map, sign): (HeightMap, f32)| Relief { map, zero: zero.value, scale: sign * scale.value };
    let scene = Scene {
        mesh: model.mesh,
        reliefs: height.value.into_iter().map(relief).collect(),
        color_map: color.value,
        subdivisions: subdivisions.value,
    };
    let (view, lights) = model.builtin.map_or((None, Vec::new()), |b| (Some(b.view), b.lights));
    Ok(Inputs { scene, displacement, zero: zero.value, scale: scale.value, choices, view, lights })
}

/// What texels displace along: as given, else what the built-in scene's own map is for, else heights.
fn displacement_kind(request: &Request, model: &Model) -> Result<DisplacementKind, InputError> {
    let builtin = model.builtin.as_ref().filter(|_| request.height == MapArgument::Default);
    let own = builtin.map_or(DisplacementKind::Height, |builtin| match builtin.sideways {
        Some(_) => DisplacementKind::Tangent,
        None => DisplacementKind::Height,
    });
    let kind = request.displacement.unwrap_or(own);
    let is_vector = kind != DisplacementKind::Height;
    if is_vector && own == DisplacementKind::Height && builtin.is_some() {
        return Err(InputError::NoVectors { name: model.name.clone() });
    }
    let from_file = is_vector && builtin.is_none();
    match (is_vector && request.invert, from_file || request.channels.is_none()) {
        (true, _) => Err(InputError::InvertVectors),
        (_, false) => Err(InputError::ChannelsOfNothing),
        _ => Ok(kind),
    }
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
    let BuiltinScene { mesh, height, sideways, color, zero, scale, subdivisions, view, up, lights } =
        builtin::load(name).ok_or_else(unknown)?;
    let light = |light: emboss_kernels::interface::PointLight| Light {
        position: light.position,
        color: light.color,
        intensity: Some(light.intensity),
    };
    let lights = lights.into_iter().map(light).collect();
    let recommended =
        Recommended { height, sideways, color, zero, scale, subdivisions, view: (view, up), lights };
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

/// The maps, and the texel value of no displacement.
fn height_maps(
    request: &Request,
    kind: DisplacementKind,
    model: &mut Model,
) -> Result<(Settled<Maps>, Settled<f32>), InputError> {
    if kind != DisplacementKind::Height {
        return vector_map(request, kind, model);
    }
    let zero = number(request.zero, model.builtin.as_ref().map(|b| b.zero), || ZERO);
    let Settled { value, shown, origin } = height_map(request, zero.value, model)?;
    Ok((Settled { value: vec![(value, 1.0)], shown, origin }, zero))
}

/// [`height_maps`] of vectors.
fn vector_map(
    request: &Request,
    kind: DisplacementKind,
    model: &mut Model,
) -> Result<(Settled<Maps>, Settled<f32>), InputError> {
    let order = request.channels.unwrap_or(match kind {
        DisplacementKind::Object => ChannelOrder::Custom([(0, false), (1, false), (2, false)]),
        DisplacementKind::Height | DisplacementKind::Tangent => ChannelOrder::Blender,
    });
    let load = |path: &Path, origin| -> Result<_, InputError> {
        let map = load_vector_map(path, request.zero)?;
        let maps = order.axes(kind).map(|(channel, sign)| (map.channels[channel].clone(), sign));
        let zero = number(request.zero, None, || map.zero);
        Ok((Settled::new(maps.into(), path.display(), origin), zero))
    };
    let none = |origin| {
        let zero = number(request.zero, None, || 0.0);
        let flat = (HeightMap::flat(zero.value), 1.0);
        (Settled::new(vec![flat; 3], "none", origin), zero)
    };
    match &request.height {
        MapArgument::File(path) => load(path, GIVEN),
        MapArgument::None => Ok(none(GIVEN)),
        MapArgument::Default => match &mut model.builtin {
            Some(builtin) => {
                let normal = std::mem::replace(&mut builtin.height, HeightMap::flat(0.0));
                // Its own axes; those of a built-in scene without vectors are not asked for.
                let maps = builtin.sideways.take().into_iter().flatten().chain([normal]);
                let maps = maps.map(|map| (map, 1.0)).collect();
                let zero = number(request.zero, Some(builtin.zero), || 0.0);
                Ok((Settled::new(maps, &model.name, BUILTIN), zero))
            }
            None => match existing(model.maps.height.as_deref()) {
                Some(path) => load(path, MATERIAL),
                None => Ok(none(DEFAULT)),
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
fn warn_of_map(height: &Settled<Maps>) {
    let Settled { value: maps, shown, .. } = height;
    // The channels of a vector map are alike in this.
    let Some((map, _)) = maps.first() else { return };
    if map.has_steps() {
        tracing::warn!(
            "{shown}: has 8 bits, so that slopes come in 256 steps; a map of 16 bits or floats is smooth"
        );
    }
    if map.replaced > 0 {
        tracing::warn!("{shown}: {} texels are NaN or infinite; they do not displace", map.replaced);
    }
}

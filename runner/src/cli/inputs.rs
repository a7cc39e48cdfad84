//! The six arguments: model, maps and relief, and what stands in for those that are left out.

use crate::normal_maps::NormalSpace;
use crate::render::Scene;
use crate::scene::assembly::{Assembly, MapSource, MaterialSource, NormalSource, ZERO};
use crate::scene::builtin::{self, BuiltinScene};
use crate::scene::error::SceneFileProblem;
use crate::scene::obj::{ObjModel, load_obj};
use crate::scene::scene_file::{
    MaterialChoice, ModelSource, SceneColor, SceneFile, SceneMaterial, SceneModel,
};
use crate::scene::{MapFile, Mesh, ModelMaterial, SceneError};
use crate::settings::{ChannelOrder, DisplacementKind, Light, Subdivisions, Wrap};
use crate::stats::agreed;
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

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
const SCENE_FILE: &str = "from the scene file";
const DEFAULT: &str = "default";
const SEVERAL: &str = "several origins";

/// A model before the arguments are settled.
struct Model {
    name: String,
    /// Where it was read from: itself, and its libraries of materials.
    files: Vec<PathBuf>,
    mesh: Mesh,
    /// At least one; the mesh's triangles name theirs.
    materials: Vec<Described>,
    builtin: Option<Recommended>,
    /// The line of a scene file that gives it other axes: turns it, mirrors it or stretches it.
    turned: Option<usize>,
    /// Where its instances stand; none: it stands once.
    places: Vec<DAffine3>,
}

/// What a built-in scene brings beside its mesh and its material.
struct Recommended {
    subdivisions: u32,
    view: (Vec3, Vec3),
    lights: Vec<Light>,
}

/// A material, and where what it says comes from.
struct Described {
    /// What the model calls it; empty where it has no name.
    name: String,
    /// Where a scene file describes it.
    line: Option<usize>,
    source: MaterialSource,
    color: &'static str,
    height: &'static str,
    zero: &'static str,
    scale: &'static str,
    normal: &'static str,
    /// Maps that it names and that are not there.
    missing: Vec<PathBuf>,
}

/// Loads what the arguments name, and fills in what they leave out.
pub(super) fn load(request: &Request<'_>) -> Result<Inputs, InputError> {
    let mut models = match request.scene {
        None => vec![load_model(request.model)?],
        Some(scene) => {
            scene.models.iter().map(|model| load_scene_model(scene, model)).collect::<Result<_, _>>()?
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
    let mut assembly = Assembly::new(displacement, channels);
    for Model { mesh, materials, places, .. } in models {
        let ids = materials.iter().map(|material| {
            let is_named = [material.color, material.height, material.normal].contains(&SCENE_FILE);
            assembly.material(&material.source).map_err(|error| match (request.scene, material.line) {
                (Some(scene), Some(line)) if is_named => named_by(scene, line, error),
                _ => error,
            })
        });
        let ids = ids.collect::<Result<Vec<_>, _>>()?;
        if places.is_empty() {
            assembly.add(mesh, &ids);
        } else {
            assembly.add_placed(mesh, &ids, places);
        }
    }
    let mut scene = assembly.finish(subdivisions.most());
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

/// What is wrong with a file that a line of a scene file names.
fn named_by(scene: &SceneFile, line: usize, source: SceneError) -> SceneError {
    SceneError::NamedBySceneFile { path: scene.path.clone(), line, source: Box::new(source) }
}

/// A model of a scene file in its place, with its materials.
fn load_scene_model(scene: &SceneFile, model: &SceneModel) -> Result<Model, InputError> {
    let wrong = |problem| SceneError::SceneFile { path: scene.path.clone(), line: model.line, problem };
    let mut loaded = match &model.source {
        ModelSource::Builtin(name) => load_builtin(name)?,
        ModelSource::File(path) => load_file(path).map_err(|error| named_by(scene, model.line, error))?,
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

impl Choice {
    /// What all materials have; where they differ each value once.
    fn of_all(name: &'static str, values: impl Iterator<Item = (String, &'static str)>) -> Choice {
        let (mut shown, mut origins) = (Vec::new(), Vec::new());
        for (value, origin) in values {
            if !shown.contains(&value) {
                shown.push(value);
            }
            if !origins.contains(&origin) {
                origins.push(origin);
            }
        }
        let more = shown.len().saturating_sub(MOST_SHOWN);
        shown.truncate(MOST_SHOWN);
        let mut value = shown.join(", ");
        if more > 0 {
            value = format!("{value} and {more} more");
        }
        Choice { name, value, origin: if let [origin] = origins[..] { origin } else { SEVERAL } }
    }
}

/// How many different values of materials are named.
const MOST_SHOWN: usize = 4;

fn map_name<T>(map: Option<&MapSource<T>>) -> String {
    match map {
        None => "none".to_owned(),
        Some(MapSource::File(path)) => path.display().to_string(),
        Some(MapSource::Made { name, .. }) => name.clone(),
    }
}

fn file<T>(map: Option<&MapSource<T>>) -> Option<PathBuf> {
    match map {
        Some(MapSource::File(path)) => Some(path.clone()),
        _ => None,
    }
}

fn normal_name(source: &MaterialSource) -> String {
    source
        .normal
        .as_ref()
        .map_or("made from the height map".to_owned(), |normal| normal.path.display().to_string())
}

fn color_name(source: &MaterialSource) -> String {
    match (&source.color, source.albedo) {
        (None, Some(albedo)) => {
            let [r, g, b] = albedo.to_array().map(|part| (1000.0 * part).round() / 1000.0);
            format!("{r},{g},{b}")
        }
        (map, _) => map_name(map.as_ref()),
    }
}

impl Described {
    /// Takes what the command line says of all materials.
    fn change(&mut self, request: &Request<'_>) {
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
    fn choose(&mut self, material: &SceneMaterial) {
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
    fn of_model(material: ModelMaterial, scale: f32) -> Described {
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

fn load_model(argument: &ModelArgument) -> Result<Model, InputError> {
    match argument {
        ModelArgument::File(path) | ModelArgument::Scene(path) => Ok(load_file(path)?),
        ModelArgument::Builtin(name) => load_builtin(name),
        ModelArgument::Default => load_builtin(USUAL_MODEL),
    }
}

fn load_file(path: &Path) -> Result<Model, SceneError> {
    let ObjModel { mesh, materials, libraries } = load_obj(path)?;
    let scale = SCALE_SHARE * diagonal(&mesh);
    let materials = materials.into_iter().map(|m| Described::of_model(m, scale)).collect();
    let (name, files) = (path.display().to_string(), [vec![path.to_owned()], libraries].concat());
    Ok(Model { name, files, mesh, materials, builtin: None, turned: None, places: vec![] })
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

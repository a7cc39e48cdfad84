//! Scene files: TOML that names models and their materials, the camera, lights and settings. `docs/SCENE.md` says what
//! each key means.

use super::SceneError;
use super::error::SceneFileProblem;
use super::subdivide::{NoSubdivision, Subdivide};
use crate::instances;
use crate::normal_maps::NormalSpace;
use crate::picture::linear_from_srgb;
use crate::settings::{
    ChannelOrder, DisplacementKind, Filter, Light, Method, Normals, Settings, Shade, Subdivisions, Weld, Wrap,
};
use glam::{DAffine3, DMat3, DVec3, EulerRot, Vec3};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// A scene file, read and checked; the files that it names are not read.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// Where it is.
    pub path: PathBuf,
    /// `samples`.
    pub samples: Option<u32>,
    /// `n`.
    pub subdivisions: Option<Subdivisions>,
    /// `displacement`.
    pub displacement: Option<DisplacementKind>,
    /// `channels`.
    pub channels: Option<ChannelOrder>,
    /// The materials by their names.
    pub materials: BTreeMap<String, SceneMaterial>,
    /// The models, at least one.
    pub models: Vec<SceneModel>,
    render: RenderTable,
    camera: CameraTable,
    lights: Vec<LightTable>,
}

/// A material of a scene file. What it does not say the model's own material decides.
#[derive(Clone, Debug)]
pub struct SceneMaterial {
    /// The line where it begins, from 1.
    pub line: usize,
    /// A colour map, `None` for none; or linear RGB.
    pub color: Option<SceneColor>,
    /// A height map, `None` for none.
    pub height: Option<Option<PathBuf>>,
    /// The texel value of no displacement.
    pub zero: Option<f32>,
    /// Height of a texel step from 0 to 1, in scene units.
    pub scale: Option<f32>,
    /// How all its maps are read outside [0,1).
    pub wrap: Option<Wrap>,
    /// Whether the height map is turned upside down.
    pub invert: Option<bool>,
    /// A normal map, `None` for none.
    pub normal: Option<Option<PathBuf>>,
    /// What its components are along.
    pub normal_space: NormalSpace,
}

/// The colour of a [`SceneMaterial`].
#[derive(Clone, Debug, PartialEq)]
pub enum SceneColor {
    /// An image.
    Map(PathBuf),
    /// Linear RGB everywhere.
    Plain(Vec3),
    /// No map, whatever the model's own material says.
    None,
}

/// A model of a scene file.
#[derive(Clone, Debug)]
pub struct SceneModel {
    /// The line where it begins, from 1.
    pub line: usize,
    /// What is loaded.
    pub source: ModelSource,
    /// Its materials.
    pub materials: MaterialChoice,
    /// How it is subdivided.
    pub subdivide: Option<Subdivide>,
    /// Where it stands; of instances how it is before they place it.
    pub world_from_model: DAffine3,
    /// Where its instances stand; none: it stands once.
    pub places: Vec<DAffine3>,
}

/// Where a model comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ModelSource {
    /// An OBJ file.
    File(PathBuf),
    /// A built-in scene, by its name with `builtin:`.
    Builtin(String),
}

/// Which of a scene file's materials a model has. The names are there.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "the name of a material, or a table { \"of the model\" = \"of this file\" }")]
pub enum MaterialChoice {
    /// All of it this one.
    All(String),
    /// Its material of the first name the second one. Names that the model does not have are errors of what loads it.
    ByName(BTreeMap<String, String>),
    /// Its own.
    #[default]
    #[serde(skip)]
    Own,
}

impl SceneFile {
    /// Reads a scene file and checks all that can be checked without the files that it names.
    ///
    /// # Errors
    /// [`SceneError::Unreadable`], or [`SceneError::SceneFile`] with the line.
    pub fn read(path: &Path) -> Result<SceneFile, SceneError> {
        let bytes = fs::read(path).map_err(|source| SceneError::Unreadable { path: path.into(), source })?;
        let text = String::from_utf8(bytes).map_err(|error| {
            let line = line_at(error.as_bytes(), error.utf8_error().valid_up_to());
            SceneError::SceneFile { path: path.into(), line, problem: SceneFileProblem::NotUtf8 }
        })?;
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        parse(path, text).map_err(|(at, problem)| SceneError::SceneFile {
            path: path.into(),
            line: line_at(text.as_bytes(), at),
            problem,
        })
    }

    /// The materials that no model has, with their lines: most likely a name that is not spelled the same twice.
    pub fn idle_materials(&self) -> impl Iterator<Item = (&str, usize)> {
        let is_used =
            |name: &str| self.models.iter().flat_map(|model| model.materials.names()).any(|n| n == name);
        let named = self.materials.iter().map(|(name, material)| (name.as_str(), material.line));
        named.filter(move |(name, _)| !is_used(name))
    }

    /// What it says of the picture, the rest by default.
    pub fn settings(&self) -> Settings {
        let (render, camera, mut settings) = (&self.render, &self.camera, Settings::default());
        let change = |value: &mut u32, side: Option<Side>| *value = side.map_or(*value, |side| side.0);
        change(&mut settings.width, render.width);
        change(&mut settings.height, render.height);
        settings.method = render.method.unwrap_or(settings.method);
        settings.normals = render.normals.unwrap_or(settings.normals);
        settings.weld = render.weld.unwrap_or(settings.weld);
        settings.shade = render.shade.unwrap_or(settings.shade);
        settings.displacement = render.displacement.unwrap_or(settings.displacement);
        settings.smooth = render.smooth.unwrap_or(settings.smooth);
        settings.filter = render.filter.unwrap_or(settings.filter);
        settings.shadows = render.shadows.unwrap_or(settings.shadows);
        settings.ambient = render.ambient.map_or(settings.ambient, |share| share.0);
        settings.background = render.background.map(linear);
        settings.seed = render.seed.unwrap_or(settings.seed);
        settings.view.eye = camera.eye.map(vector);
        settings.view.target = camera.target.map(vector);
        settings.view.up = camera.up.map(vector);
        settings.view.fov = camera.fov.map_or(settings.view.fov, |fov| fov.0);
        settings.lights = self.lights.iter().map(LightTable::light).collect();
        settings
    }
}

/// Where in the text something is wrong, in bytes, and what.
type Problem = (usize, SceneFileProblem);

fn parse(path: &Path, text: &str) -> Result<SceneFile, Problem> {
    let document: Document = toml::from_str(text).map_err(|error| {
        let message = error.message().trim().replace('\n', ", ");
        (error.span().map_or(0, |span| span.start), SceneFileProblem::Toml { message })
    })?;
    let Document { render, camera, light, material, model, instance } = document;
    let usual_subdivide = render.subdivide.map(|subdivide| subdivide.0);
    let sides = [(render.width, Settings::default().width), (render.height, Settings::default().height)];
    let [width, height] = sides.map(|(side, usual)| u64::from(side.map_or(usual, |side| side.0)));
    if width * height > u32::MAX.into() {
        return Err((0, SceneFileProblem::TooManyPixels { width, height }));
    }
    if model.is_empty() {
        return Err((text.len(), SceneFileProblem::NoModel));
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let line = |at: usize| line_at(text.as_bytes(), at);
    let named = |(name, table): (String, Spanned<MaterialTable>)| {
        let at = table.span().start;
        (name, table.into_inner().material(folder, line(at)))
    };
    let materials: BTreeMap<_, _> = material.into_iter().map(named).collect();
    let mut names: Vec<Option<String>> = Vec::new();
    let mut models: Vec<SceneModel> = Vec::new();
    for table in model {
        let at = table.span().start;
        let mut table = table.into_inner();
        let name = table.name.take();
        if let Some(name) = &name
            && names.iter().flatten().any(|other| other == name.as_ref())
        {
            let at = name.span().start;
            return Err((at, SceneFileProblem::TwoModels { name: name.as_ref().clone() }));
        }
        names.push(name.map(Spanned::into_inner));
        let model = table.model(folder, at, line(at), &materials)?;
        models.push(SceneModel { subdivide: model.subdivide.or(usual_subdivide), ..model });
    }
    for table in instance {
        let at = table.span().start;
        let InstanceTable { model, translate, rotate, scale } = table.into_inner();
        let place = transform(scale.as_ref(), rotate, translate)?;
        let Some(of) = names.iter().position(|name| name.as_ref() == Some(model.as_ref())) else {
            let (name, known) = (model.as_ref().clone(), names.into_iter().flatten().collect());
            return Err((model.span().start, SceneFileProblem::UnknownModel { name, known }));
        };
        if instances::placed(place).is_none() {
            return Err((at, SceneFileProblem::InstanceTransform));
        }
        models[of].places.push(place);
    }
    Ok(SceneFile {
        path: path.into(),
        samples: render.samples.map(|samples| samples.0),
        subdivisions: render.n.map(|n| n.0),
        displacement: render.displacement,
        channels: render.channels,
        materials,
        models,
        render,
        camera,
        lights: light,
    })
}

/// The line of a byte, from 1.
fn line_at(text: &[u8], at: usize) -> usize {
    1 + text.iter().take(at).filter(|&&byte| byte == b'\n').count()
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    #[serde(default)]
    render: RenderTable,
    #[serde(default)]
    camera: CameraTable,
    #[serde(default)]
    light: Vec<LightTable>,
    #[serde(default)]
    material: BTreeMap<String, Spanned<MaterialTable>>,
    #[serde(default)]
    model: Vec<Spanned<ModelTable>>,
    #[serde(default)]
    instance: Vec<Spanned<InstanceTable>>,
}

/// `[render]`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct RenderTable {
    width: Option<Side>,
    height: Option<Side>,
    samples: Option<Samples>,
    n: Option<NValue>,
    subdivide: Option<SubdivideValue>,
    method: Option<Method>,
    displacement: Option<DisplacementKind>,
    channels: Option<ChannelOrder>,
    normals: Option<Normals>,
    weld: Option<Weld>,
    shade: Option<Shade>,
    smooth: Option<bool>,
    filter: Option<Filter>,
    shadows: Option<bool>,
    ambient: Option<NotNegative>,
    background: Option<[Share; 3]>,
    seed: Option<u32>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "NumberOrText")]
struct NValue(Subdivisions);

#[derive(Deserialize)]
#[serde(untagged, expecting = "a whole number from 1 to 4096, \"auto\" or \"auto:PIXELS\"")]
enum NumberOrText {
    Number(i64),
    Text(String),
}

impl TryFrom<NumberOrText> for NValue {
    type Error = String;

    fn try_from(given: NumberOrText) -> Result<NValue, String> {
        match given {
            NumberOrText::Number(n) => n.to_string().parse(),
            NumberOrText::Text(text) => text.parse(),
        }
        .map(NValue)
    }
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "LevelsOrText")]
struct SubdivideValue(Subdivide);

#[derive(Deserialize)]
#[serde(untagged, expecting = "levels from 0 to 12, or a text such as \"2:loop,crease=30\"")]
enum LevelsOrText {
    Levels(i64),
    Text(String),
}

impl TryFrom<LevelsOrText> for SubdivideValue {
    type Error = NoSubdivision;

    fn try_from(given: LevelsOrText) -> Result<Self, NoSubdivision> {
        match given {
            LevelsOrText::Levels(levels) => levels.to_string().parse(),
            LevelsOrText::Text(text) => text.parse(),
        }
        .map(SubdivideValue)
    }
}

/// `[camera]`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct CameraTable {
    eye: Option<[Double; 3]>,
    target: Option<[Double; 3]>,
    up: Option<[Double; 3]>,
    fov: Option<Fov>,
}

/// `[[light]]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LightTable {
    position: [Double; 3],
    color: Option<[NotNegative; 3]>,
    intensity: Option<NotNegative>,
}

/// `[material.NAME]`.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct MaterialTable {
    color: Option<ColorValue>,
    height: Option<String>,
    zero: Option<Number>,
    scale: Option<Number>,
    wrap: Option<Wrap>,
    invert: Option<bool>,
    normal: Option<String>,
    normal_space: Option<NormalSpace>,
}

#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "the name of an image, \"none\", or three numbers from 0 to 1")]
enum ColorValue {
    Map(String),
    Plain([Share; 3]),
}

/// `[[model]]`.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct ModelTable {
    name: Option<Spanned<String>>,
    path: Option<String>,
    builtin: Option<Spanned<String>>,
    material: Option<Spanned<MaterialChoice>>,
    subdivide: Option<SubdivideValue>,
    translate: Option<[Double; 3]>,
    rotate: Option<[Double; 3]>,
    scale: Option<Spanned<Scale>>,
}

/// `[[instance]]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct InstanceTable {
    model: Spanned<String>,
    translate: Option<[Double; 3]>,
    rotate: Option<[Double; 3]>,
    scale: Option<Spanned<Scale>>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged, expecting = "a number, or three numbers for x, y and z")]
enum Scale {
    Uniform(Double),
    Axes([Double; 3]),
}

impl LightTable {
    fn light(&self) -> Light {
        let color = self.color.map_or(Vec3::ONE, |color| Vec3::from(color.map(|part| part.0)));
        Light { position: vector(self.position), color, intensity: self.intensity.map(|i| i.0) }
    }
}

impl MaterialTable {
    fn material(self, folder: &Path, line: usize) -> SceneMaterial {
        let map = |name: String| (name != NONE).then(|| folder.join(name));
        let color = self.color.map(|color| match color {
            ColorValue::Plain(color) => SceneColor::Plain(linear(color)),
            ColorValue::Map(name) if name == NONE => SceneColor::None,
            ColorValue::Map(name) => SceneColor::Map(folder.join(name)),
        });
        SceneMaterial {
            line,
            color,
            height: self.height.map(map),
            zero: self.zero.map(|zero| zero.0),
            scale: self.scale.map(|scale| scale.0),
            wrap: self.wrap,
            invert: self.invert,
            normal: self.normal.map(map),
            normal_space: self.normal_space.unwrap_or_default(),
        }
    }
}

/// What stands for no map in the place of a file.
const NONE: &str = "none";

impl ModelTable {
    /// The model of a table that begins at byte `at`.
    fn model(
        self,
        folder: &Path,
        at: usize,
        line: usize,
        materials: &BTreeMap<String, SceneMaterial>,
    ) -> Result<SceneModel, Problem> {
        let world_from_model = transform(self.scale.as_ref(), self.rotate, self.translate)?;
        let source = match (self.path, self.builtin) {
            (Some(path), None) => ModelSource::File(folder.join(path)),
            (None, Some(name)) => {
                let (at, name) = (name.span().start, format!("builtin:{}", name.as_ref()));
                if !super::builtin::NAMES.contains(&name.as_str()) {
                    let name = name.trim_start_matches("builtin:").to_owned();
                    return Err((at, SceneFileProblem::UnknownBuiltin { name }));
                }
                ModelSource::Builtin(name)
            }
            _ => return Err((at, SceneFileProblem::ModelSource)),
        };
        let at = self.material.as_ref().map_or(at, |choice| choice.span().start);
        let choice = self.material.map(Spanned::into_inner).unwrap_or_default();
        let unknown = choice.names().find(|name| !materials.contains_key(*name));
        if let Some(name) = unknown {
            let known = materials.keys().cloned().collect();
            return Err((at, SceneFileProblem::UnknownMaterial { name: name.to_owned(), known }));
        }
        let subdivide = self.subdivide.map(|subdivide| subdivide.0);
        Ok(SceneModel { line, source, materials: choice, subdivide, world_from_model, places: Vec::new() })
    }
}

/// Scaled along a model's axes, then turned about x, then y, then z, then moved.
fn transform(
    scale: Option<&Spanned<Scale>>,
    rotate: Option<[Double; 3]>,
    translate: Option<[Double; 3]>,
) -> Result<DAffine3, Problem> {
    let factors = match scale.map(Spanned::as_ref) {
        None => DVec3::ONE,
        Some(Scale::Uniform(factor)) => DVec3::splat(factor.0),
        Some(&Scale::Axes(axes)) => vector(axes),
    };
    if let Some(table) = scale
        && factors.cmpeq(DVec3::ZERO).any()
    {
        return Err((table.span().start, SceneFileProblem::ZeroScale));
    }
    let [x, y, z] = rotate.unwrap_or_default().map(|degrees| degrees.0.to_radians());
    let rotation = DMat3::from_euler(EulerRot::ZYX, z, y, x);
    let translation = vector(translate.unwrap_or_default());
    Ok(DAffine3::from_mat3_translation(rotation * DMat3::from_diagonal(factors), translation))
}

impl MaterialChoice {
    /// The names of this file's materials in it.
    fn names(&self) -> impl Iterator<Item = &str> {
        let (all, by_name) = match self {
            MaterialChoice::All(name) => (Some(name), None),
            MaterialChoice::ByName(names) => (None, Some(names.values())),
            MaterialChoice::Own => (None, None),
        };
        all.into_iter().chain(by_name.into_iter().flatten()).map(String::as_str)
    }
}

fn vector(numbers: [Double; 3]) -> DVec3 {
    numbers.map(|number| number.0).into()
}

/// Linear RGB from sRGB.
fn linear(color: [Share; 3]) -> Vec3 {
    color.map(|share| linear_from_srgb(share.0)).into()
}

/// A type whose values are checked as they are read, so that a message has the line of the value.
macro_rules! checked {
    ($(
        #[doc = $doc:literal]
        $name:ident($inner:ty) from $source:literal $given:ty: $check:expr, $message:expr;
    )*) => {$(
        #[doc = $doc]
        #[derive(Clone, Copy, Debug, Default, Deserialize)]
        #[serde(try_from = $source)]
        struct $name($inner);

        impl TryFrom<$given> for $name {
            type Error = String;

            fn try_from(given: $given) -> Result<Self, String> {
                let check: fn($given) -> Option<$inner> = $check;
                check(given).map(Self).ok_or_else(|| format!($message, given = given))
            }
        }
    )*};
}

checked! {
    #[doc = "A number that is finite as an `f32`."]
    Number(f32) from "f64" f64: finite, "`{given}` is not finite; write a number such as 0.5";
    #[doc = "A number with all its digits, finite also as an `f32`."]
    Double(f64) from "f64" f64: |x| finite(x).map(|_| x), "`{given}` is not finite; write a number such as 0.5";
    #[doc = "A number that is 0 or more."]
    NotNegative(f32) from "f64" f64: |x| finite(x).filter(|x| *x >= 0.0),
        "`{given}` is not a number from 0 on; light is 0 or more";
    #[doc = "A part of a colour."]
    Share(f32) from "f64" f64: |x| finite(x).filter(|x| (0.0..=1.0).contains(x)),
        "`{given}` is not from 0 to 1, as a colour's parts are; divide codes such as 128 by 255";
    #[doc = "A field of view in degrees. Between these the half angle's tangent is finite and not 0 in f32."]
    Fov(f32) from "f64" f64: |x| finite(x).filter(|x| (0.01..=179.0).contains(x)),
        "`{given}` is no field of view; that is an angle from 0.01 to 179 degrees, try 35";
    #[doc = "Pixels of a picture's side."]
    Side(u32) from "i64" i64: |x| u32::try_from(x).ok().filter(|x| (1..=i32::MAX.unsigned_abs()).contains(x)),
        "a side of {given} pixels is not possible; write a number from 1 on, such as 960";
    #[doc = "Samples of a pixel."]
    Samples(u32) from "i64" i64: |x| u32::try_from(x).ok().filter(|x| *x > 0),
        "{given} is no number of samples; write one from 1 on, such as 4";
}

/// A number as an `f32`, where it is one.
#[expect(clippy::cast_possible_truncation, reason = "rounded, and checked")]
fn finite(x: f64) -> Option<f32> {
    Some(x as f32).filter(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> SceneFile {
        parse(Path::new("folder/scene.toml"), text).expect("sound")
    }

    const CUBE: &str = "[[model]]\nbuiltin = \"cube\"\n";

    #[test]
    fn every_key_of_the_picture_reaches_the_settings() {
        let scene = parsed(&format!(
            "[render]\nwidth = 3\nheight = 5\nsamples = 7\nn = 9\nmethod = \"grid-walk\"\n\
             displacement = \"object\"\nchannels = \"-b+r+g\"\nnormals = \"linear\"\n\
             weld = \"off\"\nshade = \"uv\"\nsmooth = true\nfilter = \"trilinear\"\nshadows = false\nambient = \
             0.25\nbackground = [0, 1, 0.5]\nseed = 11\n\
             [camera]\neye = [1, 2, 3]\ntarget = [4, 5, 6.5]\nup = [0, 0, 1]\nfov = 50\n\
             [[light]]\nposition = [7, 8, 9]\n[[light]]\nposition = [0, 0, 0]\ncolor = [2, 1, 0]\nintensity = 3\n{CUBE}"
        ));
        assert_eq!((scene.samples, scene.subdivisions), (Some(7), Some(Subdivisions::Fixed(9))));
        assert_eq!(scene.displacement, Some(DisplacementKind::Object));
        assert_eq!(scene.channels, "-b+r+g".parse().ok());
        let Settings { view, lights, background, .. } = scene.settings();
        let grey = linear_from_srgb(0.5);
        let expected = Settings {
            width: 3,
            height: 5,
            method: Method::GridWalk,
            displacement: DisplacementKind::Object,
            normals: Normals::Linear,
            weld: Weld::Off,
            shade: Shade::Uv,
            smooth: true,
            filter: Filter::Trilinear,
            shadows: false,
            ambient: 0.25,
            seed: 11,
            view,
            lights: lights.clone(),
            background,
            ..Settings::default()
        };
        assert_eq!(scene.settings(), expected);
        assert_eq!(background, Some(Vec3::new(0.0, 1.0, grey)));
        let vectors = [view.eye, view.target, view.up].map(Option::unwrap);
        assert_eq!(vectors, [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.5), DVec3::Z]);
        assert_eq!(view.fov, 50.0);
        let plain = Light { position: DVec3::new(7.0, 8.0, 9.0), color: Vec3::ONE, intensity: None };
        let second = Light { position: DVec3::ZERO, color: Vec3::new(2.0, 1.0, 0.0), intensity: Some(3.0) };
        assert_eq!(lights, [plain, second]);
    }

    #[test]
    fn what_is_left_out_is_the_default() {
        let scene = parsed(CUBE);
        assert_eq!(scene.settings(), Settings::default());
        assert_eq!((scene.samples, scene.subdivisions, scene.models[0].line), (None, None, 1));
        assert_eq!(scene.models[0].world_from_model, DAffine3::IDENTITY);
        assert_eq!(scene.models[0].materials, MaterialChoice::Own);
        assert_eq!(scene.models[0].subdivide, None);
    }

    #[test]
    fn models_are_subdivided_as_they_say_else_as_the_picture_says() {
        let scene = parsed(&format!(
            "[render]\nsubdivide = 2\n{CUBE}{CUBE}subdivide = 0\n{CUBE}subdivide = \"3:loop,crease=30\"\n"
        ));
        let texts: Vec<_> = scene
            .models
            .iter()
            .map(|model| model.subdivide.map(|s| s.to_string()).unwrap_or_default())
            .collect();
        assert_eq!(texts, ["2", "0", "3:loop,crease=30"]);
        for bad in ["-1", "13", "\"2:lop\"", "2.5", "true"] {
            let (_, problem) =
                parse(Path::new(""), &format!("{CUBE}subdivide = {bad}\n")).expect_err("no subdivision");
            let message = problem.to_string();
            assert!(message.contains("levels") && message.contains("2:loop"), "{bad}: {message}");
        }
    }

    #[test]
    fn materials_say_what_stands_there_and_nothing_else() {
        let scene = parsed(&format!(
            "\n[material.a]\ncolor = \"c.png\"\nheight = \"sub/h.png\"\nzero = 0\nscale = -2\nwrap = \"mirror\"\n\
             invert = true\nnormal = \"n.png\"\nnormal_space = \"world\"\n\
             [material.b]\ncolor = [1, 0, 0]\nheight = \"none\"\nnormal = \"none\"\n[material.c]\ncolor = \"none\"\n\
             [material.d]\n{CUBE}material = \"a\"\n"
        ));
        let [a, b, c, d] = ["a", "b", "c", "d"].map(|name| &scene.materials[name]);
        assert_eq!(a.color, Some(SceneColor::Map("folder/c.png".into())));
        assert_eq!((a.height.clone(), a.wrap), (Some(Some("folder/sub/h.png".into())), Some(Wrap::Mirror)));
        assert_eq!((a.zero, a.scale, a.invert, a.line), (Some(0.0), Some(-2.0), Some(true), 2));
        assert_eq!(
            (a.normal.clone(), a.normal_space),
            (Some(Some("folder/n.png".into())), NormalSpace::World)
        );
        assert_eq!((b.normal.clone(), c.normal.clone()), (Some(None), None));
        assert_eq!((b.color.clone(), b.height.clone()), (Some(SceneColor::Plain(Vec3::X)), Some(None)));
        assert_eq!(
            (c.color.clone(), c.height.clone(), d.color.clone()),
            (Some(SceneColor::None), None, None)
        );
        let idle: Vec<_> = scene.idle_materials().map(|(name, _)| name).collect();
        assert_eq!(idle, ["b", "c", "d"]);
    }

    /// Scaled first, then turned about x, y, z in this order, then moved.
    #[test]
    fn transforms_are_applied_in_order() {
        let moved = |keys: &str, point: DVec3| {
            parsed(&format!("{CUBE}{keys}")).models[0].world_from_model.transform_point3(point).as_vec3()
        };
        // y gets 4, x turns it to z, y that to x.
        let keys = "scale = [1, 4, 1]\nrotate = [90, 90, 0]\ntranslate = [1, 0, 0]\n";
        // Sines and cosines of f64 are off by 1e-16 or so.
        assert!(moved(keys, DVec3::Y).abs_diff_eq(Vec3::new(5.0, 0.0, 0.0), 1e-6));
        // x turns y to z, where z leaves it.
        assert!(moved("rotate = [90, 0, 90]\n", DVec3::Y).abs_diff_eq(Vec3::Z, 1e-6));
        assert_eq!(moved("scale = -2\n", DVec3::ONE), Vec3::splat(-2.0));
    }

    /// Instances stand by their model, in their order; the model's own transform stays its own.
    #[test]
    fn instances_find_their_models() {
        let named = |name: &str| format!("[[model]]\nname = \"{name}\"\nbuiltin = \"cube\"\nscale = 2\n");
        let at = |model: &str, x: f32| {
            format!("[[instance]]\nmodel = \"{model}\"\ntranslate = [{x}, 0, 0]\nscale = [1, -1, 3]\n")
        };
        let scene =
            parsed(&[named("a"), at("b", 1.0), at("a", 2.0), named("b"), CUBE.into(), at("b", 3.0)].concat());
        let place = |x: f64| {
            let scale = DMat3::from_diagonal(DVec3::new(1.0, -1.0, 3.0));
            DAffine3::from_mat3_translation(scale, DVec3::X * x)
        };
        let places: Vec<_> = scene.models.iter().map(|model| model.places.clone()).collect();
        assert_eq!(places, [vec![place(2.0)], vec![place(1.0), place(3.0)], vec![]]);
        assert_eq!(scene.models[0].world_from_model, DAffine3::from_scale(DVec3::splat(2.0)));
    }

    /// The reader names all keys of a table where it meets another; the document has a row for each, and no others.
    #[test]
    fn every_key_is_documented() {
        const DOCUMENT: &str = include_str!("../../../docs/SCENE.md");
        for (heading, other) in [
            ("[render]", "[render]\nother = 1"),
            ("[camera]", "[camera]\nother = 1"),
            ("[[light]]", "[[light]]\nother = 1"),
            ("[material.NAME]", "[material.m]\nother = 1"),
            ("[[model]]", "[[model]]\nother = 1"),
            ("[[instance]]", "[[instance]]\nother = 1"),
        ] {
            let (_, problem) = parse(Path::new(""), other).expect_err("no such key");
            let message = problem.to_string();
            let listed = message.split(';').next().unwrap_or("");
            let mut keys: Vec<&str> = listed.split('`').skip(3).step_by(2).collect();
            let section =
                DOCUMENT.split("\n## ").find(|s| s.starts_with(&format!("`{heading}`"))).expect(heading);
            let rows = section.lines().filter_map(|line| line.strip_prefix("| `"));
            let cells = rows.filter_map(|row| row.split(" | ").next());
            let mut documented: Vec<&str> =
                cells.flat_map(|cell| cell.split("`, `")).map(|key| key.trim_end_matches('`')).collect();
            keys.sort_unstable();
            documented.sort_unstable();
            assert_eq!(documented, keys, "{heading}: {message}");
        }
    }
}

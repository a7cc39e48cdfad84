//! What can be wrong with a scene's files: each message names the file, the line where there is one, and a remedy.

use emboss_kernels::interface::MAX_PRIMITIVES;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// A model or a map that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The file is missing or may not be read.
    #[error("{}: cannot be read: {source}; check the path and its permissions", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system answered.
        source: io::Error,
    },
    /// A model is not text.
    #[error("{}:{line}: not UTF-8 text; save the model as UTF-8, and check that it is an OBJ file", path.display())]
    NotUtf8 {
        /// The model.
        path: PathBuf,
        /// The line of the first byte that is not UTF-8, from 1.
        line: usize,
    },
    /// A line of a model is wrong.
    #[error("{}:{line}: {problem}", path.display())]
    Obj {
        /// The model.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        problem: ObjProblem,
    },
    /// A scene file says what cannot be.
    #[error("{}:{line}: {problem}", path.display())]
    SceneFile {
        /// The scene file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        problem: SceneFileProblem,
    },
    /// A file that a scene file names cannot be used.
    #[error("{}:{line}: {source}", path.display())]
    NamedBySceneFile {
        /// The scene file.
        path: PathBuf,
        /// The line of the model or the material that names it, from 1.
        line: usize,
        /// What is wrong with it.
        source: Box<SceneError>,
    },
    /// A model has no face.
    #[error("{}: has no faces; export the mesh with its polygons, and check that it is an OBJ file", path.display())]
    NoFaces {
        /// The model.
        path: PathBuf,
    },
    /// A model has faces, but none of three different corners.
    #[error("{}: none of its {dropped} triangles has three different corners; check the scale of the \
        export", path.display())]
    NoTriangles {
        /// The model.
        path: PathBuf,
        /// How many triangles there are.
        dropped: usize,
    },
    /// A model would have more triangles than a BVH holds, once it is subdivided.
    #[error(
        "{}: {levels} levels of subdivision make {triangles} triangles of its {faces} faces, more than the \
            {MAX_PRIMITIVES} of a BVH; subdivide it at most {most} times", path.display()
    )]
    TooFine {
        /// The model.
        path: PathBuf,
        /// The levels that were asked for.
        levels: u32,
        /// How many triangles that would make.
        triangles: u64,
        /// How many faces it has.
        faces: usize,
        /// The most levels that fit.
        most: u32,
    },
    /// The OBJ reader refused what this module's own checks let pass.
    #[error("{}: cannot be read as OBJ: {source}; check the export", path.display())]
    Tobj {
        /// The model.
        path: PathBuf,
        /// What the reader said.
        source: tobj::LoadError,
    },
    /// A map is not an image, or of a format that is not read.
    #[error("{}: not an image that can be read; use PNG, JPEG, BMP, GIF, TIFF, EXR or HDR", path.display())]
    NotAnImage {
        /// The map.
        path: PathBuf,
    },
    /// A map is damaged, or of a variety of its format that is not read.
    #[error("{}: cannot be decoded: {source}; open it in an image editor and save it anew", path.display())]
    Decode {
        /// The map.
        path: PathBuf,
        /// What the decoder said.
        source: ::image::ImageError,
    },
    /// A map has no texels.
    #[error("{}: has no texels ({width}x{height}); use a map of at least 1x1", path.display())]
    NoTexels {
        /// The map.
        path: PathBuf,
        /// Texels of a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A picture has fewer channels than a vector has components.
    #[error("{}: has one channel, but vectors have three; use a picture in red, green and blue, or --displacement \
        height", path.display())]
    NoVectors {
        /// The map.
        path: PathBuf,
    },
    /// A map is larger than the kernels can address.
    #[error("{}: {width}x{height} texels are too many; scale it down to at most {limit}x{limit}", path.display())]
    TooManyTexels {
        /// The map.
        path: PathBuf,
        /// Texels of a row.
        width: u32,
        /// Rows.
        height: u32,
        /// The greatest width and height.
        limit: u32,
    },
}

impl SceneError {
    /// The file that cannot be used.
    pub fn file(&self) -> &Path {
        match self {
            SceneError::NamedBySceneFile { source, .. } => source.file(),
            SceneError::Unreadable { path, .. }
            | SceneError::NotUtf8 { path, .. }
            | SceneError::Obj { path, .. }
            | SceneError::SceneFile { path, .. }
            | SceneError::NoFaces { path }
            | SceneError::NoTriangles { path, .. }
            | SceneError::Tobj { path, .. }
            | SceneError::NotAnImage { path }
            | SceneError::Decode { path, .. }
            | SceneError::NoTexels { path, .. }
            | SceneError::NoVectors { path }
            | SceneError::TooFine { path, .. }
            | SceneError::TooManyTexels { path, .. } => path,
        }
    }
}

/// What is wrong with a scene file, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneFileProblem {
    /// It is not text.
    #[error("not UTF-8 text; save the scene file as UTF-8")]
    NotUtf8,
    /// It is no TOML, or has a key or a value that a scene file has not.
    #[error("{message}; docs/SCENE.md lists the keys and their values")]
    Toml {
        /// What the reader said.
        message: String,
    },
    /// There is nothing to see.
    #[error("the scene has no model; add one, such as [[model]] with path = \"model.obj\"")]
    NoModel,
    /// More pixels than kernels can number.
    #[error("a picture of {width}x{height} has more than {} pixels; choose a smaller size", u32::MAX)]
    TooManyPixels {
        /// Pixels of a row.
        width: u64,
        /// Rows.
        height: u64,
    },
    /// A model comes from nowhere, or from two places.
    #[error("a model has either a path or a builtin; write one of them, such as path = \"model.obj\"")]
    ModelSource,
    /// Vectors along x, y and z, and a model whose own axes are others.
    #[error(
        "vectors in object space are along the scene's axes, but this model is turned, mirrored or stretched; use \
            displacement = \"tangent\", or leave rotate out and give scale one positive number"
    )]
    TurnedVectors,
    /// No built-in scene has this name.
    #[error("there is no built-in scene `{name}`; choose {}", builtin_names())]
    UnknownBuiltin {
        /// The name.
        name: String,
    },
    /// A model has a material that the file does not have.
    #[error("there is no [material.{name}]; add it, or choose {}", listed(known))]
    UnknownMaterial {
        /// What the model names.
        name: String,
        /// The file's materials.
        known: Vec<String>,
    },
    /// A table of materials names one that the model's file does not use.
    #[error("the model has no material `{name}`; it has {}", listed(known))]
    UnknownModelMaterial {
        /// What the table names.
        name: String,
        /// The model's materials.
        known: Vec<String>,
    },
    /// Two models have one name.
    #[error("there is another model `{name}`; give each model that has instances a name of its own")]
    TwoModels {
        /// The name.
        name: String,
    },
    /// An instance is of a model that the file does not have.
    #[error(
        "there is no model `{name}`; write name = \"{name}\" in its [[model]], or choose {}",
        listed(known)
    )]
    UnknownModel {
        /// What the instance names.
        name: String,
        /// The names of the file's models.
        known: Vec<String>,
    },
    /// An instance's transform leaves too few digits.
    #[error(
        "the instance is too small, too large or too far away for floats to compute with; change scale or translate"
    )]
    InstanceTransform,
    /// A model is scaled to nothing.
    #[error("a scale of 0 leaves nothing of the model; write another number, or leave scale out")]
    ZeroScale,
    /// A model's coordinates do not fit into floats.
    #[error(
        "the model's coordinates become too large, or it too small, to compute with; change scale or translate"
    )]
    Transform,
}

/// Names as a user reads them.
fn listed(names: &[String]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

/// What is wrong with a line of an OBJ file, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ObjProblem {
    /// A number is missing or is none.
    #[error("a {element} needs {needed} numbers, but here stands `{found}`; check the export")]
    Numbers {
        /// What the line defines.
        element: Element,
        /// How many numbers it needs at least.
        needed: usize,
        /// What stands after the keyword.
        found: String,
    },
    /// A vertex has the homogeneous weight 0.
    #[error("this vertex has the weight 0, so that it lies at infinity; leave the fourth number out")]
    ZeroWeight,
    /// A number is NaN or infinite.
    #[error("this {element} is NaN or infinite; repair the mesh before exporting it")]
    NotFinite {
        /// What the line defines.
        element: Element,
    },
    /// A face without corners.
    #[error("this face has no corners; check the export")]
    NoCorners,
    /// A corner of a face is not of the form `vertex/texture/normal`.
    #[error(
        "`{corner}` is no corner of a face; write it as vertex/texture or vertex/texture/normal, in whole numbers"
    )]
    Corner {
        /// What stands there.
        corner: String,
    },
    /// A face uses index 0.
    #[error("face points to {element} 0, but OBJ counts from 1; check the export")]
    ZeroIndex {
        /// What it points to.
        element: Element,
    },
    /// A face points beyond the last element.
    #[error("face points to {element} {index}, but the file has {}; check the export", element.count(*count))]
    BeyondEnd {
        /// What it points to.
        element: Element,
        /// Which one, from 1.
        index: usize,
        /// How many the file has.
        count: usize,
    },
    /// A negative index counts back beyond the first element.
    #[error("face points to {element} {index}, but only {} stand above it; check the export", element.count(*count))]
    BeforeStart {
        /// What it points to.
        element: Element,
        /// Which one: -1 is the last above the face.
        index: isize,
        /// How many stand above the face.
        count: usize,
    },
    /// A face's corner has no texture coordinates.
    #[error("{object} has a face without texture coordinates; unwrap its UVs and export them")]
    NoTextureCoordinates {
        /// The object, as "object `name`", or a word for the whole file where it names none.
        object: String,
    },
}

/// What a face's corner points to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// A position, `v`.
    Vertex,
    /// Texture coordinates, `vt`.
    TextureCoordinate,
    /// A normal, `vn`.
    Normal,
}

impl Element {
    /// "1 vertex", "8 vertices".
    fn count(self, count: usize) -> String {
        match (self, count) {
            (_, 1) => format!("1 {self}"),
            (Self::Vertex, _) => format!("{count} vertices"),
            _ => format!("{count} {self}s"),
        }
    }
}

impl fmt::Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Vertex => "vertex",
            Self::TextureCoordinate => "texture coordinate",
            Self::Normal => "normal",
        })
    }
}

/// What a scene file calls the built-in scenes.
fn builtin_names() -> String {
    super::builtin::NAMES.map(|name| name.trim_start_matches("builtin:")).join(", ")
}

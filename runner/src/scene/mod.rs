//! Scenes: meshes, maps and where they come from.

pub mod assembly;
pub mod builtin;
pub mod error;
pub mod image;
mod mesh;
pub mod mip_levels;
mod noise;
pub mod obj;
pub mod precise;
pub mod scene_file;
pub mod seams;
pub mod subdivide;
mod tangents;

use crate::normal_maps::NormalMap;
use crate::settings::Wrap;
use crate::space::RenderSpace;
use emboss_kernels::interface::{Triangle, Vertex};
use glam::{DVec2, Vec3};
use std::path::PathBuf;
use std::sync::Arc;

pub use error::SceneError;

/// A base mesh in the layout of the kernels.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Its corners; unit normals (zero where [`Mesh::from_triangles`] says so), finite everything.
    pub vertices: Vec<Vertex>,
    /// Its triangles, each of three different positions (which may lie in a line), vertices in ascending order with
    /// [`Triangle::flags`] keeping the winding.
    pub triangles: Vec<Triangle>,
    /// How many triangles of the source had two corners at one position, or fewer than three, and were left out.
    pub dropped: usize,
    /// How many triangles had three different corners in the source, but not in `f32` about the mesh's own origin, and
    /// were left out: see [`precise`].
    pub collapsed: usize,
    /// The first vertex of each mesh that was [appended](Mesh::append): those before it have nothing in common with it.
    pub starts: Vec<u32>,
    /// Whole tiles that were subtracted from each vertex's texture coordinates, even numbers; empty where none were.
    /// See [`Mesh::with_whole_coordinates`].
    pub tiles: Vec<DVec2>,
    /// The space that its positions are in. Of a [scene](crate::render::Scene) it is the render space.
    pub space: RenderSpace,
}

/// What a model's file says of one of its materials.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ModelMaterial {
    /// Its name; empty where the model names no material.
    pub name: String,
    /// `Kd`: linear RGB where there is no colour map.
    pub albedo: Option<Vec3>,
    /// `map_Kd`.
    pub color: Option<MapFile>,
    /// `disp`, else `map_disp`, else `bump`.
    pub height: Option<MapFile>,
    /// `norm`: a tangent-space normal map.
    pub normal: Option<MapFile>,
}

/// A map as a material names it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapFile {
    /// The image, which exists or not.
    pub path: PathBuf,
    /// How it is read outside [0,1), where the file says it: `-clamp`.
    pub wrap: Option<Wrap>,
    /// What is added to its texels once they are multiplied by the second number: `-mm`.
    pub base_and_gain: Option<(f32, f32)>,
}

/// A scalar map, packed as the kernels read it, top row first.
#[derive(Clone, Debug)]
pub struct HeightMap {
    /// Texels of a row, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
    /// One of [`height_format`](emboss_kernels::interface::height_format).
    pub format: u32,
    /// The packed texels.
    pub texels: Vec<u32>,
    /// Least and greatest texel value.
    pub range: (f32, f32),
    /// How many NaN or infinite texels were replaced by the value of no displacement.
    pub replaced: usize,
}

/// A height map and what it does: the height over texel t is `scale (t - zero)`.
#[derive(Clone, Debug)]
pub struct Relief {
    /// The map; those that share one keep it in memory once.
    pub map: Arc<HeightMap>,
    /// The texel value of no displacement.
    pub zero: f32,
    /// Height of a texel step from 0 to 1, in the units of the mesh's positions: see [`Mesh::space`].
    pub scale: f32,
    /// How the map is read outside [0,1); `None`: as the settings say.
    pub wrap: Option<Wrap>,
    /// How the names of the files begin that keep what is computed of the map: with its own; `None`: nothing is kept.
    /// See [`distance_files`](crate::distance_files).
    pub stem: Option<PathBuf>,
    /// What users know the map by: its file, or the built-in scene that made it; `None` where there is no map.
    pub name: Option<String>,
    /// What `--method normal-map` lights it by; `None`: as the settings say, else by a map that is made from this one.
    pub normal_map: Option<NormalMap>,
}

impl Relief {
    /// A relief that is wrapped as the settings say, of which nothing is kept, and that has no normal map.
    pub fn new(map: impl Into<Arc<HeightMap>>, zero: f32, scale: f32) -> Self {
        Self { map: map.into(), zero, scale, wrap: None, stem: None, name: None, normal_map: None }
    }
}

/// What a surface looks like.
#[derive(Clone, Debug)]
pub struct Material {
    /// Linear RGB without a colour map.
    pub albedo: Vec3,
    /// The colour map; materials that share one keep it in memory once.
    pub color: Option<Arc<ColorMap>>,
    /// How the map is read outside [0,1); `None`: as the settings say.
    pub wrap: Option<Wrap>,
}

/// A light grey, so that both light and shade show.
impl Default for Material {
    fn default() -> Self {
        Self { albedo: Vec3::splat(0.8), color: None, wrap: None }
    }
}

impl From<Option<ColorMap>> for Material {
    fn from(map: Option<ColorMap>) -> Self {
        Self { color: map.map(Arc::new), ..Self::default() }
    }
}

/// A colour map, packed as the kernels read it, top row first.
#[derive(Clone, Debug)]
pub struct ColorMap {
    /// Texels of a row, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
    /// One of [`color_format`](emboss_kernels::interface::color_format), not `NONE`.
    pub format: u32,
    /// The packed texels.
    pub texels: Vec<u32>,
}

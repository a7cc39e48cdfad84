//! Scenes: meshes, maps and where they come from.

pub mod builtin;
pub mod error;
pub mod image;
mod mesh;
pub mod mip_levels;
mod noise;
pub mod obj;
pub mod seams;

use emboss_kernels::interface::{Triangle, Vertex};
use std::path::PathBuf;

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
}

/// Maps that a model's materials name, as paths that exist or not; the command line's take precedence.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MaterialMaps {
    /// `map_Kd`.
    pub color: Option<PathBuf>,
    /// `disp`, else `map_disp`, else `bump`.
    pub height: Option<PathBuf>,
    /// `norm`: a tangent-space normal map.
    pub normal: Option<PathBuf>,
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
    /// The map.
    pub map: HeightMap,
    /// The texel value of no displacement.
    pub zero: f32,
    /// Height of a texel step from 0 to 1, in model units.
    pub scale: f32,
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

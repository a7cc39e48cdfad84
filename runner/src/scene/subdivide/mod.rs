//! Subdivision surfaces: a base mesh replaced by a finer one on the smooth surface that it is the control mesh of,
//! before anything displaces it.
//!
//! - *Catmull-Clark* (Catmull and Clark, "Recursively generated B-spline surfaces on arbitrary topological meshes", CAD
//!   10(6), 1978) of the polygons of a file as they are, before they are cut into triangles.
//! - *Loop* (Loop, "Smooth subdivision surfaces based on triangles", 1987) of its triangles; polygons are cut into fans
//!   first.
//!
//! Creases and borders follow Hoppe and others, "Piecewise smooth surface reconstruction", SIGGRAPH 1994, and DeRose,
//! Kass and Truong, "Subdivision surfaces in character animation", SIGGRAPH 1998, with creases that are sharp for good:
//! two of them make a vertex follow the cubic B-spline along them, three or more hold it. So do edges of one face, of
//! three and more, and of two whose windings disagree.
//!
//! The vertices of the last level are moved to their limit positions, and normals are those of the limit surface there
//! (`limit`): more levels give more points of one and the same surface. At creases each side has normals of its own.
//!
//! Texture coordinates are subdivided for themselves. Inside they follow the rule of the positions, so that the map
//! moves with the surface; at seams and borders they stay linear along the edges (what OpenSubdiv calls
//! `FVAR_LINEAR_BOUNDARIES`), so that the borders of charts stay where they were painted.
//!
//! All of it is computed in `f64`, in an order that the input fixes: the same file gives the same mesh.

mod cage;
mod limit;
mod refine;
mod topology;

use crate::scene::precise::{PreciseVertex, bounds};
use crate::scene::{Mesh, SceneError};
use crate::space::origin_of;
use emboss_kernels::interface::MAX_PRIMITIVES;
use glam::DVec3;
use std::fmt;
use std::path::Path;
use std::str::FromStr;

pub(crate) use cage::{Cage, CageBuilder};
use topology::Topology;

/// How a mesh is subdivided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Subdivide {
    /// How often each face is cut in four; 0 leaves the mesh as it is.
    pub levels: u32,
    /// By which rules.
    pub scheme: Scheme,
    /// Edges whose faces' normals are more than this many degrees apart are creases, 0 to 180; `None`: none are for
    /// that.
    pub crease_angle: Option<f64>,
    /// What becomes of the borders of open meshes.
    pub boundary: Boundary,
}

/// The rules of a subdivision.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// Catmull-Clark, of polygons.
    #[default]
    CatmullClark,
    /// Loop, of triangles.
    Loop,
}

/// The borders of an open mesh, which follow a cubic B-spline.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Boundary {
    /// But for vertices of a single face, which stay: a square keeps its corners.
    #[default]
    Corners,
    /// Everywhere: a square becomes round.
    Edges,
}

/// The most levels that can be asked for; there a triangle is sixteen million.
pub const MOST_LEVELS: u32 = 12;

/// A text that names no subdivision.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is no subdivision; write the levels, 0 to {MOST_LEVELS}, and what differs from Catmull-Clark without \
        creases, as 2 or 2:loop or 2:crease=30,edges"
)]
pub struct NoSubdivision(String);

/// LEVELS, or LEVELS:WORDS with words between commas: `catmull-clark`, `loop`, `crease=DEGREES`, `corners`, `edges`.
impl FromStr for Subdivide {
    type Err = NoSubdivision;

    fn from_str(text: &str) -> Result<Self, NoSubdivision> {
        let wrong = || NoSubdivision(text.to_owned());
        let (levels, words) =
            text.split_once(':').map_or((text, None), |(levels, words)| (levels, Some(words)));
        let levels = levels.parse().ok().filter(|levels| *levels <= MOST_LEVELS).ok_or_else(wrong)?;
        let mut subdivide = Subdivide {
            levels,
            scheme: Scheme::default(),
            crease_angle: None,
            boundary: Boundary::default(),
        };
        for word in words.into_iter().flat_map(|words| words.split(',')) {
            match word {
                "catmull-clark" => subdivide.scheme = Scheme::CatmullClark,
                "loop" => subdivide.scheme = Scheme::Loop,
                "corners" => subdivide.boundary = Boundary::Corners,
                "edges" => subdivide.boundary = Boundary::Edges,
                _ => {
                    let degrees = word.strip_prefix("crease=").and_then(|degrees| degrees.parse().ok());
                    let degrees = degrees.filter(|degrees| (0.0..=180.0).contains(degrees));
                    subdivide.crease_angle = Some(degrees.ok_or_else(wrong)?);
                }
            }
        }
        Ok(subdivide)
    }
}

impl fmt::Display for Subdivide {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.levels)?;
        let words = [
            (self.scheme == Scheme::Loop).then(|| "loop".to_owned()),
            self.crease_angle.map(|degrees| format!("crease={degrees}")),
            (self.boundary == Boundary::Edges).then(|| "edges".to_owned()),
        ];
        for (i, word) in words.into_iter().flatten().enumerate() {
            write!(f, "{}{word}", if i == 0 { ':' } else { ',' })?;
        }
        Ok(())
    }
}

impl Subdivide {
    /// How many triangles a control mesh becomes by so many levels.
    fn triangles(&self, cage: &Cage, levels: u32) -> u64 {
        let Some(finer) = levels.checked_sub(1) else { return cage.fan_triangles() };
        let first = match self.scheme {
            // A quad for each corner, of two triangles.
            Scheme::CatmullClark => 2 * cage.corner_count(),
            Scheme::Loop => 4 * cage.fan_triangles(),
        };
        first << (2 * finer)
    }

    /// The meshes of a control mesh of the model at `path`, at least one, as of [`Mesh::apart_from_precise`]. What that
    /// left out counts as dropped, of the first.
    ///
    /// # Errors
    /// [`SceneError::TooFine`], before anything is subdivided.
    pub(crate) fn meshes(&self, path: &Path, mut cage: Cage) -> Result<Vec<Mesh>, SceneError> {
        let triangles = self.triangles(&cage, self.levels);
        let fits = |levels: &u32| self.triangles(&cage, *levels) <= MAX_PRIMITIVES.into();
        if !fits(&self.levels) {
            return Err(SceneError::TooFine {
                path: path.into(),
                levels: self.levels,
                triangles,
                faces: cage.faces.len(),
                most: (0..self.levels).rev().find(fits).unwrap_or(0),
            });
        }
        // About an origin of its own, so that it is the same wherever it stands.
        let (min, max) = bounds(cage.positions.iter().copied()).unwrap_or_default();
        let origin = origin_of(min, max);
        cage.positions.iter_mut().for_each(|position| *position -= origin);
        let (cage, normals) = self.limit(cage);
        let vertices: Vec<PreciseVertex> =
            cage.corners.iter().zip(normals).map(|(c, n)| cage.vertex(*c, n)).collect();
        let mut meshes = Mesh::apart_from_precise(&vertices, cage.fans());
        meshes.iter_mut().for_each(|mesh| mesh.space.origin += origin);
        meshes[0].dropped += cage.dropped;
        Ok(meshes)
    }

    /// The control mesh of the last level, its vertices moved to the limit, and the normals of its corners: zero where
    /// there are no levels, to be computed.
    fn limit(&self, mut cage: Cage) -> (Cage, Vec<DVec3>) {
        if self.levels == 0 {
            let none = vec![DVec3::ZERO; cage.corners.len()];
            return (cage, none);
        }
        cage.mark_creases(self.crease_angle);
        cage.hold_corners(self.boundary);
        if self.scheme == Scheme::Loop {
            cage = cage.cut_into_fans();
        }
        for _ in 0..self.levels {
            cage = refine::refined(&cage, &Topology::new(&cage), self.scheme);
        }
        let topology = Topology::new(&cage);
        let normals = limit::normals(&cage, &topology, self.scheme);
        (cage.positions, cage.uvs) = limit::points(&cage, &topology, self.scheme);
        (cage, normals)
    }
}

#[cfg(test)]
mod tests;

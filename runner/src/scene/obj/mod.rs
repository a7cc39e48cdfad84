//! Wavefront OBJ models and the maps that their materials name.
//!
//! tobj reads the numbers and triangulates the polygons. It names no line in its errors, takes polylines for faces
//! and fills gaps in the normals with whatever came before, so `survey` checks the text first and hands it over
//! reduced to what a mesh needs.

mod material;
mod polygons;
mod survey;

use super::precise::PreciseVertex;
use super::subdivide::Subdivide;
use super::{Mesh, ModelMaterial, SceneError};
use glam::{DVec2, DVec3};
use std::fs;
use std::path::{Path, PathBuf};
use survey::Survey;

/// What an OBJ file holds.
#[derive(Clone, Debug)]
pub struct ObjModel {
    /// All its objects and groups, about an origin of its own: see [`Mesh::from_precise`].
    pub mesh: Mesh,
    /// Parts of it that stand so far from that mesh, and from each other, that they have origins of their own: see
    /// [`groups`](super::precise::groups).
    pub apart: Vec<Mesh>,
    /// All these before they were subdivided; empty where they were not.
    pub control: Vec<Mesh>,
    /// At least one; triangles name theirs by its index.
    pub materials: Vec<ModelMaterial>,
    /// The files of materials that were read.
    pub libraries: Vec<PathBuf>,
}

/// Loads a model.
///
/// Polygons are cut into a fan from their first corner; that of a concave one may reach outside it. Normals that
/// are missing or zero are computed, see [`Mesh::from_triangles`], whose welding and dropping of triangles with corners
/// that coincide applies. Positions and texture coordinates are read in double precision ([`Mesh::from_precise`]). A
/// face with fewer than three corners counts as dropped, too. A material library that cannot be read is a warning.
pub fn load_obj(path: &Path) -> Result<ObjModel, SceneError> {
    load(path, None)
}

/// Loads a model and subdivides it: the polygons as they stand in the file, whose corners at one position are one
/// vertex, with creases between its smoothing groups. Its normals play no part.
///
/// # Errors
/// As of [`load_obj`]; [`SceneError::TooFine`].
pub fn load_subdivided_obj(path: &Path, subdivide: &Subdivide) -> Result<ObjModel, SceneError> {
    load(path, Some(subdivide))
}

fn load(path: &Path, subdivide: Option<&Subdivide>) -> Result<ObjModel, SceneError> {
    let text = read_text(path)?;
    let text = text.trim_start_matches('\u{feff}');
    let survey =
        Survey::of(text).map_err(|(line, problem)| SceneError::Obj { path: path.into(), line, problem })?;
    if survey.faces == 0 {
        return Err(SceneError::NoFaces { path: path.into() });
    }
    let reduced = survey.reduce(text);
    let cut = || triangulate(path, &reduced, &survey.runs);
    let (mut meshes, control) = match subdivide {
        Some(subdivide) if subdivide.levels > 0 => {
            let cage = polygons::read(path, &reduced, &survey.polygons)?;
            (subdivide.meshes(path, cage)?, cut()?)
        }
        _ => (cut()?, Vec::new()),
    };
    let mut mesh = meshes.remove(0);
    let apart = meshes;
    mesh.dropped += survey.thin_faces;
    if mesh.triangles.is_empty() {
        return Err(SceneError::NoTriangles { path: path.into(), dropped: mesh.dropped + mesh.collapsed });
    }
    let (materials, libraries) = material::load(path, &survey);
    Ok(ObjModel { mesh, apart, control, materials, libraries })
}

/// The file as UTF-8.
fn read_text(path: &Path) -> Result<String, SceneError> {
    let bytes = fs::read(path).map_err(|source| SceneError::Unreadable { path: path.into(), source })?;
    String::from_utf8(bytes).map_err(|error| {
        let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = 1 + valid.iter().filter(|&&byte| byte == b'\n').count();
        SceneError::NotUtf8 { path: path.into(), line }
    })
}

/// The meshes of a text that [`Survey::reduce`] gave, their triangles of the materials that [`Survey::runs`] tells.
fn triangulate(path: &Path, text: &str, runs: &[(u32, usize)]) -> Result<Vec<Mesh>, SceneError> {
    let options = tobj::LoadOptions { single_index: true, triangulate: true, ..Default::default() };
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, no_materials)
        .map_err(|source| SceneError::Tobj { path: path.into(), source })?;
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for tobj::Model { mesh, .. } in &models {
        debug_assert!(vertices.is_empty(), "the reduced text has one object, so indices need no offset");
        vertices.extend(corners(mesh));
        triangles.extend_from_slice(mesh.indices.as_chunks().0);
    }
    let materials: Vec<u32> =
        runs.iter().flat_map(|&(material, count)| std::iter::repeat_n(material, count)).collect();
    debug_assert_eq!(
        materials.len(),
        triangles.len(),
        "a polygon is a fan of two triangles fewer than corners"
    );
    Ok(Mesh::apart_from_precise(&vertices, triangles.into_iter().zip(materials)))
}

/// The vertices of a model, each of which has all three attributes.
fn corners(mesh: &tobj::Mesh) -> impl Iterator<Item = PreciseVertex> {
    let positions = mesh.positions.as_chunks::<3>().0;
    let texture_coordinates = mesh.texcoords.as_chunks::<2>().0;
    let normals = mesh.normals.as_chunks::<3>().0;
    positions.iter().zip(texture_coordinates).zip(normals).map(|((&position, &uv), &normal)| PreciseVertex {
        position: position.into(),
        normal: DVec3::from(normal).as_vec3(),
        uv: DVec2::from(uv),
    })
}

#[cfg(test)]
mod tests;

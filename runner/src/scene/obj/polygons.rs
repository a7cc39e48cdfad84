//! The polygons of a model, as subdivision takes them.

use super::survey::PolygonRun;
use crate::scene::SceneError;
use crate::scene::subdivide::{Cage, CageBuilder};
use glam::{DVec2, DVec3};
use std::path::Path;

/// The polygons of a text that [`Survey::reduce`](super::Survey::reduce) gave, of the materials and groups of `runs`.
pub(super) fn read(path: &Path, text: &str, runs: &[PolygonRun]) -> Result<Cage, SceneError> {
    let options = tobj::LoadOptions::default();
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, no_materials)
        .map_err(|source| SceneError::Tobj { path: path.into(), source })?;
    let mut builder = CageBuilder::default();
    let mut kinds = runs.iter().flat_map(|run| std::iter::repeat_n((run.material, run.group), run.count));
    for tobj::Model { mesh, .. } in &models {
        let (positions, uvs) = (mesh.positions.as_chunks::<3>().0, mesh.texcoords.as_chunks::<2>().0);
        let corner = |(&v, &vt): (&u32, &u32)| -> (DVec3, DVec2) {
            (positions[v as usize].into(), uvs[vt as usize].into())
        };
        // None are given where all are triangles.
        let triangles =
            std::iter::repeat_n(3, if mesh.face_arities.is_empty() { mesh.indices.len() / 3 } else { 0 });
        let mut first = 0;
        for count in mesh.face_arities.iter().copied().chain(triangles) {
            let range = first..first + count as usize;
            first = range.end;
            let corners = mesh.indices[range.clone()].iter().zip(&mesh.texcoord_indices[range]).map(corner);
            let (material, group) = kinds.next().unwrap_or_default();
            builder.polygon(corners, material, group);
        }
    }
    debug_assert_eq!(kinds.next(), None, "the survey counts what is read");
    Ok(builder.finish())
}

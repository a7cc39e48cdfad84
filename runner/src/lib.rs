//! Emboss renders displacement-mapped triangle meshes without tessellating them.

pub mod backend;
pub mod bvh;
pub mod scene;

//! Emboss renders displacement-mapped triangle meshes without tessellating them.

pub mod backend;
pub mod bvh;
pub mod framing;
pub mod picture;
pub mod scene;

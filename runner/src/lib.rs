//! Emboss renders displacement-mapped triangle meshes without tessellating them.
#![deny(unsafe_code)]

pub mod backend;
pub mod bvh;
pub mod scene;

//! Emboss renders displacement-mapped triangle meshes without tessellating them.
#![deny(unsafe_code)]

pub mod backend;
pub mod bench;
pub mod bvh;
pub mod check;
pub mod cli;
pub mod colors;
pub mod compare;
pub mod distance_files;
pub mod framing;
pub mod height_levels;
pub mod heights;
pub mod instances;
pub mod normal_maps;
pub mod picture;
pub mod render;
pub mod reports;
pub mod scene;
pub mod settings;
pub mod space;
pub mod stats;
pub mod view;
mod whole_file;

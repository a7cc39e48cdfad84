//! Everything of Emboss that runs on the GPU, and on the CPU from the same source.
//!
//! A kernel is a plain function over slices and `repr(C)` structs. [`entry`] wraps the ones that Vulkan
//! dispatches; the CPU backend and the tests call the same functions.
#![cfg_attr(target_arch = "spirv", no_std, feature(asm_experimental_arch))]
#![deny(unsafe_code)]
#![allow(
    clippy::cast_possible_truncation,
    reason = "kernels turn coordinates into texel and cell indices; sizes from files are checked by the host"
)]
#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "a comparison is negated where NaN must take that way too"
)]
#![allow(
    clippy::manual_range_contains,
    reason = "comparisons compile to what the GPU runs; ranges are structs"
)]

pub mod aabb;
pub mod barycentric;
pub mod bilinear_patch;
pub mod bvh;
pub mod camera;
pub mod counters;
pub mod displacement;
pub mod entry;
pub mod film;
pub mod hit;
pub mod instance;
pub mod interface;
pub mod lighting;
pub mod math;
pub mod parallel;
pub mod prism_tree;
pub mod probe;
pub mod ray;
pub mod relief;
pub mod render;
pub mod sampler;
pub mod scene;
pub mod shading;
pub mod smooth_base;
#[cfg(test)]
mod test_scene;
pub mod texture;
pub mod triangle;

//! Measurements that the program makes of itself.

pub mod build;
pub mod scene;
pub mod trace;

//! The displaced surface and the methods that intersect it.

pub mod brute_force;
pub mod cell;
pub mod grid_walk;
pub mod height_bounds;
pub mod surface;

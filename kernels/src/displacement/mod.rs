//! The displaced surface and the methods that intersect it.

pub mod brute_force;
pub mod cell;
pub mod grid_walk;
pub mod height_pyramid;
pub mod inverse;
pub mod quadtree;
pub mod seams;
pub mod shading_normal;
pub mod subdivisions;
pub mod surface;
pub mod tessellate;
#[cfg(test)]
pub(crate) mod test_prism;
pub mod vector;
pub(crate) mod vector_bounds;

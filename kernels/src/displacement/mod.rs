//! The displaced surface and the methods that intersect it.

pub mod surface;

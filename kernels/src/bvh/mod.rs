//! The bounding volume hierarchy over the prisms.

pub mod traverse;

//! The bounding volume hierarchy over the prisms.

pub mod scan;
pub mod traverse;

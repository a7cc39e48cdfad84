//! The bounding volume hierarchy over the prisms.

pub mod radix_sort;
pub mod scan;
pub mod traverse;

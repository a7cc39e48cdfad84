//! Whole-program tests of Emboss, and what they share.

pub mod bounds;
pub mod boxes;
pub mod changes;
pub mod compare;
pub mod exact;
pub mod far;
pub mod flat;
pub mod instances;
mod lavapipe;
pub mod long;
pub mod meshes;
mod numbers;
pub mod oracle;
pub mod planes;
mod rays;
pub mod reports;
pub mod scenes;
pub mod views;

pub use lavapipe::{finish, lavapipe};
pub use numbers::Numbers;
pub use rays::{HardRays, Hardship, LeakRays, RaySource};

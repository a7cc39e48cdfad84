//! Whole-program tests of Emboss, and what they share.

pub mod compare;
mod lavapipe;
mod numbers;
mod scenes;

pub use lavapipe::{finish, lavapipe};
pub use numbers::Numbers;
pub use scenes::{builtin_scene, job};

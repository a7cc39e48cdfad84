//! Whole-program tests of Emboss, and what they share.

mod lavapipe;

pub use lavapipe::{finish, lavapipe};

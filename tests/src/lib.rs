//! Whole-program tests of Emboss.

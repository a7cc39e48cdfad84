//! Emboss.
fn main() {}

//! `cargo xtask pictures`: renders the pictures that the README shows.

use crate::process::{cargo, run, say};
use anyhow::Result;

/// Every picture: its file, and the arguments of `emboss` that make it.
const PICTURES: &[(&str, &[&str])] = &[
    ("assets/knot.png", &["render", "builtin:knot", "--size", "960x720", "--samples", "64"]),
    (
        "assets/knot-undisplaced.png",
        &["render", "builtin:knot", "--size", "960x720", "--samples", "64", "--method", "none"],
    ),
];

/// Renders them all.
pub(crate) fn render() -> Result<()> {
    for (file, arguments) in PICTURES {
        say(&format!("{file}: emboss {}", arguments.join(" ")));
        let emboss = ["run", "--release", "--quiet", "--package", "emboss", "--"];
        run(cargo().args(emboss).args(*arguments).args(["--output", file]))?;
    }
    Ok(())
}

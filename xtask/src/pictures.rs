//! `cargo xtask pictures`: renders the pictures that the documents show.

use crate::process::{cargo, run, say};
use anyhow::Result;

/// Every picture: its file, and what `emboss render` is asked for.
const PICTURES: &[(&str, &[&str])] = &[
    ("assets/knot.png", &["builtin:knot", "--size", "960x720"]),
    ("assets/knot-undisplaced.png", &["builtin:knot", "--size", "960x720", "--method", "none"]),
    ("assets/mushroom.png", &["builtin:mushroom", "--size", "720x360"]),
    ("assets/rings.png", &["docs/scenes/rings.toml"]),
    ("assets/smooth-off.png", &["builtin:cube", "-", "-", "-", "0.05", "4", "--size", "400x300"]),
    ("assets/smooth-on.png", &["builtin:cube", "-", "-", "-", "0.05", "4", "--size", "400x300", "--smooth"]),
    ("assets/weld-on.png", &["builtin:cube", "--size", "480x360"]),
    ("assets/weld-off.png", &["builtin:cube", "--size", "480x360", "--weld", "off"]),
];

/// What they have in common. The CPU gives the same picture on every machine.
const COMMON: &[&str] = &["--samples", "16", "--backend", "cpu"];

/// Renders them all.
pub(crate) fn render() -> Result<()> {
    for (file, arguments) in PICTURES {
        say(&format!("{file}: emboss render {}", arguments.join(" ")));
        let emboss = ["run", "--release", "--quiet", "--package", "emboss", "--", "render"];
        run(cargo().args(emboss).args(*arguments).args(COMMON).args(["--output", file]))?;
    }
    Ok(())
}

//! `cargo xtask methods`: measures every method and writes docs/METHODS.md from the results.

use crate::process::{cargo, run, say};
use anyhow::{Context, Result, ensure};
use std::path::PathBuf;
use std::process::Command;
use xtask::workspace;

/// The scenes.
const SCENES: [&str; 3] = ["knot", "cube", "quilt"];
/// What the comparisons have in common: larger pictures would take hours on a processor.
const COMMON: [&str; 4] = ["--size", "320x240", "--samples", "4"];

/// Compares on each scene, for at least `seconds` each, and writes the page.
pub(crate) fn write(seconds: u32) -> Result<()> {
    let folder = |scene: &str| workspace().join("target/methods").join(scene);
    for scene in SCENES {
        // `emboss compare` would go on from the results of an older program there.
        if folder(scene).exists() {
            std::fs::remove_dir_all(folder(scene)).with_context(|| folder(scene).display().to_string())?;
        }
        say(&format!("{scene}: emboss compare builtin:{scene} {}", COMMON.join(" ")));
        let mut compare = emboss();
        compare.args(["compare", &format!("builtin:{scene}")]).args(COMMON);
        run(compare.args(["--time", &seconds.to_string(), "--output"]).arg(folder(scene)))?;
    }
    let folders: Vec<PathBuf> = SCENES.into_iter().map(folder).collect();
    let page = emboss().arg("methods").args(folders).output().context("cannot start emboss")?;
    ensure!(page.status.success(), "{}", String::from_utf8_lossy(&page.stderr));
    let file = workspace().join("docs/METHODS.md");
    std::fs::write(&file, page.stdout).with_context(|| file.display().to_string())
}

/// The program, as users have it.
fn emboss() -> Command {
    let mut emboss = cargo();
    emboss.args(["run", "--release", "--quiet", "--package", "emboss", "--"]);
    emboss
}

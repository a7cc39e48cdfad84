//! `cargo xtask methods`: measures every method and writes docs/METHODS.md from the results.

use crate::process::{emboss, run, say};
use anyhow::{Context, Result, ensure};
use std::path::PathBuf;
use std::process::Command;
use xtask::workspace;

/// The scenes; the last one is of a vector map.
const SCENES: [&str; 4] = ["knot", "cube", "quilt", "mushroom"];

/// How to measure.
#[derive(clap::Args)]
pub(crate) struct Measuring {
    /// How long each scene is measured at least
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    time: u32,
    /// Pixels of the pictures: larger ones would take hours on a processor
    #[arg(long, value_name = "WxH", default_value = "320x240")]
    size: String,
    /// Samples of a pixel
    #[arg(long, value_name = "COUNT", default_value_t = 4)]
    samples: u32,
    /// Other options of `emboss compare`, such as `--backend cpu` or `--n 4`
    #[arg(last = true, value_name = "OPTION")]
    others: Vec<String>,
    /// The page to write
    #[arg(long, value_name = "FILE", default_value = "docs/METHODS.md")]
    output: PathBuf,
    /// Folder for the comparisons; what is there already is deleted
    #[arg(long, value_name = "DIR", default_value = "target/methods")]
    folder: PathBuf,
    /// An `emboss` that is built already, instead of one that cargo builds
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
}

/// Compares on each scene and writes the page.
pub(crate) fn write(measuring: &Measuring) -> Result<()> {
    let Measuring { time, size, samples, others, .. } = measuring;
    let folder = |scene: &str| workspace().join(&measuring.folder).join(scene);
    let program = || measuring.program.as_ref().map_or_else(emboss, Command::new);
    for scene in SCENES {
        // `emboss compare` would go on from the results of an older program there.
        if folder(scene).exists() {
            std::fs::remove_dir_all(folder(scene)).with_context(|| folder(scene).display().to_string())?;
        }
        say(&format!("\n== {scene}"));
        let mut compare = program();
        compare.args(["compare", &format!("builtin:{scene}"), "--size", size, "--samples"]);
        compare.arg(samples.to_string()).args(others).args(["--time", &time.to_string()]);
        run(compare.arg("--output").arg(folder(scene)))?;
    }
    let folders: Vec<PathBuf> = SCENES.into_iter().map(folder).collect();
    let page = program().arg("methods").args(folders).output().context("cannot start emboss")?;
    ensure!(page.status.success(), "{}", String::from_utf8_lossy(&page.stderr));
    let file = workspace().join(&measuring.output);
    std::fs::write(&file, page.stdout).with_context(|| file.display().to_string())
}

//! `cargo xtask pictures`: renders the pictures that the documents show.

use crate::process::{cargo, run, say};
use crate::test::has_program;
use anyhow::{Context, Result, ensure};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use xtask::workspace;

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

/// The picture of the viewer, and what it is asked for.
const VIEWER: (&str, &[&str]) = ("assets/viewer.png", &["builtin:knot", "--size", "960x720"]);

/// Renders them all.
pub(crate) fn render() -> Result<()> {
    for (file, arguments) in PICTURES {
        say(&format!("{file}: emboss render {}", arguments.join(" ")));
        run(emboss("render", arguments).args(["--output", file]))?;
    }
    view()
}

/// `emboss` with arguments and what pictures have in common.
fn emboss(command: &str, arguments: &[&str]) -> Command {
    let mut emboss = cargo();
    emboss.args(["run", "--release", "--quiet", "--package", "emboss", "--", command]);
    emboss.args(arguments).args(COMMON);
    emboss
}

/// Takes the picture of the viewer, on a display in memory.
fn view() -> Result<()> {
    let (file, arguments) = VIEWER;
    say(&format!("{file}: emboss view {}", arguments.join(" ")));
    ensure!(has_program("Xvfb"), "Xvfb is missing; run `cargo xtask test packages`");
    let script = workspace().join("target/viewer-picture.txt");
    std::fs::write(&script, format!("samples 16\ngrab {file}\nquit\n"))?;
    let mut xvfb = Command::new("Xvfb");
    xvfb.args(["-displayfd", "1", "-screen", "0", "1280x1024x24", "-nolisten", "tcp"]);
    let mut display = xvfb.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().context("Xvfb")?;
    let taken = take(&mut display, arguments, &script);
    display.kill()?;
    display.wait()?;
    taken
}

fn take(display: &mut Child, arguments: &[&str], script: &Path) -> Result<()> {
    let mut number = String::new();
    let told = display.stdout.take().context("Xvfb tells its number")?;
    BufReader::new(told).read_line(&mut number)?;
    let name = format!(":{}", number.trim());
    run(emboss("view", arguments).arg("--script").arg(script).env("DISPLAY", name))
}

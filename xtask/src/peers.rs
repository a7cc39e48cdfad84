//! `cargo xtask peers`: measures Emboss beside another ray tracer that stores the same micro-triangles.

use crate::process::{cargo, emboss, output, run, say};
use anyhow::{Context, Result, ensure};
use serde::Deserialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use xtask::workspace;

/// Packages from PyPI.
const PACKAGES: [&str; 2] = ["mitsuba==3.9.1", "numpy==2.4.6"];
/// The scenes and their N; 0 is the base mesh.
const CASES: [(&str, &[u32]); 3] = [("cube", &[0, 16, 64]), ("quilt", &[16, 64]), ("knot", &[0, 16, 64])];

/// The other ray tracer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Peer {
    /// On the CPU, by Mitsuba's LLVM variant, which traces packets
    Embree,
    /// On an NVIDIA card, by Mitsuba's CUDA variant
    Optix,
}

/// How to measure.
#[derive(clap::Args)]
pub(crate) struct Measuring {
    /// The other ray tracer
    #[arg(value_enum)]
    peer: Peer,
    /// Pixels of the pictures
    #[arg(long, value_name = "WxH", default_value = "800x600")]
    size: String,
    /// How long each tracer is measured in each round
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0)]
    time: f64,
    /// Rounds, in which the two are measured in turns
    #[arg(long, value_name = "COUNT", default_value_t = 2)]
    rounds: u32,
    /// A Python that has Mitsuba, instead of one that is made in target/peers
    #[arg(long, value_name = "FILE")]
    python: Option<PathBuf>,
    /// An `emboss` that is built already
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
    /// A `peer_scene` that is built already
    #[arg(long, value_name = "FILE")]
    exporter: Option<PathBuf>,
}

/// The output of `peers.py`.
#[derive(Deserialize)]
struct Theirs {
    triangles: u64,
    build_s: f64,
    ms: f64,
    hit: f64,
    only_ours: u64,
    only_theirs: u64,
    far_apart: u64,
    version: String,
}

/// A row of `emboss bench trace --json`.
#[derive(Deserialize)]
struct Ours {
    intersection_ms: f64,
    primary_ms: f64,
    load_ms: f64,
    bytes: u64,
}

/// Measures, and prints a table in Markdown.
pub(crate) fn measure(measuring: &Measuring) -> Result<()> {
    let folder = workspace().join("target/peers");
    let python = match &measuring.python {
        Some(python) => python.clone(),
        None => environment(&folder)?,
    };
    std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let script = folder.join("peers.py");
    std::fs::write(&script, include_str!("peers.py")).with_context(|| script.display().to_string())?;
    let mut table = String::from(
        "| scene | N | triangles | Emboss, ms | shaded, ms | MB | load, ms | peer, ms | build, ms | ratio | differ |\n\
         |---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    let mut version = String::new();
    for (scene, ns) in CASES {
        for &n in ns {
            say(&format!("== {scene}, N = {n}"));
            let case = folder.join("case");
            let mut exporter = measuring.exporter.as_ref().map_or_else(built_exporter, Command::new);
            run(exporter.args([scene, &n.to_string(), &measuring.size]).arg(&case))?;
            let (mut ours, mut theirs) = (Vec::new(), Vec::new());
            for _ in 0..measuring.rounds.max(1) {
                ours.push(trace(measuring, scene, n, &folder)?);
                theirs.push(trace_theirs(measuring, &python, &script, &case)?);
            }
            let ours = best(ours, |one| one.intersection_ms)?;
            let theirs = best(theirs, |one| one.ms)?;
            let differ = theirs.only_ours + theirs.only_theirs + theirs.far_apart;
            ensure!(theirs.hit > 0.0, "no ray hit anything: is the peer's mesh empty?");
            writeln!(
                table,
                "| {scene} | {n} | {} | {:.3} | {:.3} | {:.1} | {:.0} | {:.3} | {:.0} | **{:.2}** | {differ} |",
                theirs.triangles,
                ours.intersection_ms,
                ours.primary_ms,
                ours.bytes as f64 / 1e6,
                ours.load_ms,
                theirs.ms,
                theirs.build_s * 1e3,
                ours.intersection_ms / theirs.ms,
            )?;
            version = theirs.version;
        }
    }
    say(&format!("\n{:?} by Mitsuba {version}, {}:\n\n{table}", measuring.peer, measuring.size));
    Ok(())
}

/// The quickest of the rounds: what else a machine does only adds to it.
fn best<T>(rounds: Vec<T>, time: impl Fn(&T) -> f64) -> Result<T> {
    rounds.into_iter().min_by(|a, b| time(a).total_cmp(&time(b))).context("nothing was measured")
}

/// Emboss's exact method on a scene, or for N = 0 its base mesh.
fn trace(measuring: &Measuring, scene: &str, n: u32, folder: &Path) -> Result<Ours> {
    let backend = if measuring.peer == Peer::Embree { "cpu" } else { "vulkan" };
    let method = if n == 0 { "none" } else { "quadtree" };
    let json = folder.join("ours.json");
    let mut trace = measuring.program.as_ref().map_or_else(emboss, Command::new);
    trace.args(["bench", "trace", &format!("builtin:{scene}"), "--backend", backend, "--quiet"]);
    trace.args(["--methods", method, "--n", &n.max(1).to_string(), "--size", &measuring.size]);
    trace.args(["--time", &measuring.time.to_string(), "--json"]).arg(&json);
    output(&mut trace)?;
    let text = std::fs::read_to_string(&json).with_context(|| json.display().to_string())?;
    let rows: Vec<Ours> = serde_json::from_str(&text).context("emboss wrote other JSON than is expected")?;
    rows.into_iter().next().context("emboss measured nothing")
}

/// The peer on the same triangles and rays.
fn trace_theirs(measuring: &Measuring, python: &Path, script: &Path, case: &Path) -> Result<Theirs> {
    let variant = if measuring.peer == Peer::Embree { "llvm_ad_rgb" } else { "cuda_ad_rgb" };
    let mut peer = Command::new(python);
    peer.arg(script).arg(variant).arg(case).arg(measuring.time.to_string());
    let text = output(&mut peer).context(
        "Mitsuba did not run; Embree needs LLVM's library (Debian: libllvm15; DRJIT_LIBLLVM_PATH names its file)",
    )?;
    let line = text.lines().last().unwrap_or_default();
    serde_json::from_str(line).with_context(|| format!("peers.py printed {line:?}"))
}

/// A virtual environment with the peer in `folder`.
fn environment(folder: &Path) -> Result<PathBuf> {
    let venv = folder.join("venv");
    let python = venv.join("bin/python");
    if !python.exists() {
        run(Command::new("python3").args(["-m", "venv"]).arg(&venv))?;
    }
    // Each time: an installation may have been broken off. Where the packages are there already it does nothing.
    run(Command::new(&python).args(["-m", "pip", "install", "--quiet"]).args(PACKAGES))?;
    Ok(python)
}

/// The program that writes the peer's input.
fn built_exporter() -> Command {
    let mut exporter = cargo();
    exporter.args([
        "run",
        "--release",
        "--quiet",
        "--package",
        "emboss-tests",
        "--example",
        "peer_scene",
        "--",
    ]);
    exporter
}

//! Emboss's own build steps, run as `cargo xtask`.
#![forbid(unsafe_code)]

mod debian;
mod methods;
mod peers;
mod pictures;
mod process;
mod spirv;
mod test;
mod toolchain;
mod width;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Emboss's own build steps.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

/// What to do.
#[derive(Subcommand)]
enum Command {
    /// Compile the kernels to assets/kernels, a module for each entry point, and write their manifest
    Spirv {
        /// Write nothing; fail where the committed files are not what the sources give
        #[arg(long, conflicts_with = "debug")]
        check: bool,
        /// Write target/kernels-debug with names and source lines instead
        #[arg(long)]
        debug: bool,
    },
    /// Find the SPIR-V toolchain, or get it
    Toolchain {
        /// Do not build it from Debian's packages where rustup has none
        #[arg(long)]
        rustup_only: bool,
    },
    /// Run the tests and checks: all of them, as CI does, or those named
    Test {
        /// Which, in any order
        #[arg(value_enum)]
        steps: Vec<test::Step>,
    },
    /// Render the README's pictures into assets
    Pictures,
    /// Measure every method on the built-in scenes, and write docs/METHODS.md from that
    Methods(methods::Measuring),
    /// Measure Emboss beside Embree or OptiX on the same micro-triangles and rays, and print a table
    Peers(peers::Measuring),
    /// A part of `spirv` that needs its own environment
    #[command(hide = true)]
    CompileKernels(spirv::Compilation),
}

fn main() -> ExitCode {
    match run(Arguments::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            process::complain(&format!("error: {error:#}"));
            ExitCode::FAILURE
        }
    }
}

/// Does what was asked for.
fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Spirv { check: true, .. } => spirv::check(),
        Command::Spirv { debug: true, .. } => spirv::build_debug(),
        Command::Spirv { .. } => spirv::build(),
        Command::Toolchain { rustup_only } => toolchain::provide(rustup_only),
        Command::Test { steps } => test::run(&steps),
        Command::Pictures => pictures::render(),
        Command::Methods(measuring) => methods::write(&measuring),
        Command::Peers(measuring) => peers::measure(&measuring),
        Command::CompileKernels(compilation) => spirv::compile(compilation),
    }
}

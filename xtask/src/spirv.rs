//! `cargo xtask spirv`: compiles the kernels to SPIR-V.

use crate::process::{run, say};
use crate::toolchain;
use anyhow::{Context, Result, bail, ensure};
use spirv_builder::{Capability, ShaderPanicStrategy, SpirvBuilder, SpirvMetadata};
use std::path::{Path, PathBuf};
use std::process::Command;
use xtask::manifest::Manifest;
use xtask::{MANIFEST_PATH, MODULE_PATH, REMEDY, module, settings, sources, workspace};

/// A compiled module with its manifest, as they are committed.
struct Compiled {
    module: Vec<u8>,
    manifest: String,
}

/// What [`compile`] is told on the command line of its process.
#[derive(clap::Args)]
pub(crate) struct Compilation {
    /// The name by which rustup knows the toolchain
    toolchain: String,
    /// The code generator that its rustc loads
    code_generator: PathBuf,
    /// Where to write the module
    output: PathBuf,
    /// With names and lines
    #[arg(long)]
    debug: bool,
}

/// Writes the module and its manifest.
pub(crate) fn build() -> Result<()> {
    let compiled = compile_release()?;
    write(MODULE_PATH, &compiled.module)?;
    write(MANIFEST_PATH, compiled.manifest.as_bytes())?;
    say(&format!("{MODULE_PATH}: {} bytes", compiled.module.len()));
    Ok(())
}

/// Compares the committed files with what the sources give.
pub(crate) fn check() -> Result<()> {
    let compiled = compile_release()?;
    compare(MODULE_PATH, &compiled.module)?;
    compare(MANIFEST_PATH, compiled.manifest.as_bytes())?;
    say(&format!("{MODULE_PATH} is what the sources give ({} bytes)", compiled.module.len()));
    Ok(())
}

/// Writes a module with names and lines where nobody commits it.
pub(crate) fn build_debug() -> Result<()> {
    let path = workspace().join("target/kernels-debug.spv");
    spawn_compiler(&path, true)?;
    say(&format!("{}: read it with spirv-dis", path.display()));
    Ok(())
}

/// Compiles what is to be committed.
fn compile_release() -> Result<Compiled> {
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let path = folder.path().join("kernels.spv");
    spawn_compiler(&path, false)?;
    let module = std::fs::read(&path).with_context(|| path.display().to_string())?;
    let manifest = Manifest {
        source_hash: sources::source_hash(&workspace())?,
        rust_gpu: settings::RUST_GPU.into(),
        target: settings::TARGET.into(),
        size_bytes: module.len(),
        contents: module::contents(&module::parse(&module)?),
    };
    Ok(Compiled { manifest: manifest.to_json()?, module })
}

/// Runs [`compile`] in a process of its own: spirv-builder hands its own environment on to cargo, and a running
/// process cannot change its environment safely.
fn spawn_compiler(output: &Path, debug: bool) -> Result<()> {
    let toolchain = toolchain::find().context("`cargo xtask toolchain` gets what is missing")?;
    let mut command = Command::new(std::env::current_exe().context("cannot find this program")?);
    command.args(["compile-kernels", toolchain.name]).arg(toolchain.code_generator).arg(output);
    // Building `core` takes unstable options of cargo, which a release of Rust only takes with this.
    command.env("RUSTC_BOOTSTRAP", "1");
    if debug {
        command.arg("--debug").envs(settings::DEBUG.iter().copied());
    } else {
        command.envs(settings::RELEASE.iter().copied());
        for personal in ["RUSTGPU_CODEGEN_ARGS", "RUSTGPU_RUSTFLAGS", "RUSTGPU_CARGOFLAGS"] {
            command.env_remove(personal);
        }
    }
    run(&mut command)
}

/// Compiles the kernels in the environment that [`spawn_compiler`] made.
pub(crate) fn compile(compilation: Compilation) -> Result<()> {
    let Compilation { toolchain, code_generator, output, debug } = compilation;
    let mut builder = SpirvBuilder::new(workspace().join("kernels"), settings::TARGET);
    builder.toolchain_overwrite = Some(toolchain);
    builder.rustc_codegen_spirv_location = Some(code_generator);
    for name in settings::CAPABILITIES {
        let Ok(capability) = name.parse::<Capability>() else { bail!("SPIR-V has no capability {name}") };
        builder.capabilities.push(capability);
    }
    if debug {
        builder.spirv_metadata = SpirvMetadata::Full;
        builder.shader_panic_strategy =
            ShaderPanicStrategy::DebugPrintfThenExit { print_inputs: true, print_backtrace: true };
    }
    let result = builder.build().context("the kernels do not compile to SPIR-V")?;
    std::fs::copy(result.module.unwrap_single(), &output).with_context(|| output.display().to_string())?;
    Ok(())
}

/// Fails where a committed file is not what was made.
fn compare(path: &str, made: &[u8]) -> Result<()> {
    let committed = std::fs::read(workspace().join(path)).with_context(|| format!("{path}: {REMEDY}"))?;
    let same = committed.iter().zip(made).take_while(|(a, b)| a == b).count();
    ensure!(
        committed == made,
        "{path} is not what the sources give: they differ from byte {same} on ({} bytes committed, {} made); {REMEDY}",
        committed.len(),
        made.len(),
    );
    Ok(())
}

/// Writes a file of the workspace.
fn write(path: &str, bytes: &[u8]) -> Result<()> {
    std::fs::write(workspace().join(path), bytes).with_context(|| format!("cannot write {path}"))
}

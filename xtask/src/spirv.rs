//! `cargo xtask spirv`: compiles the kernels to SPIR-V.

use crate::process::{run, say};
use crate::toolchain;
use anyhow::{Context, Result, bail, ensure};
use rspirv::binary::Assemble;
use spirv_builder::{Capability, ShaderPanicStrategy, SpirvBuilder, SpirvMetadata};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use xtask::manifest::{Manifest, describe};
use xtask::{
    MANIFEST_PATH, MODULES_PATH, REMEDY, contraction, module, module_path, settings, sources, workspace,
};

/// The compiled modules by entry point, with their manifest, as they are committed.
struct Compiled {
    modules: BTreeMap<String, Vec<u8>>,
    manifest: String,
}

/// What [`compile`] is told on the command line of its process.
#[derive(clap::Args)]
pub(crate) struct Compilation {
    /// The name by which rustup knows the toolchain
    toolchain: String,
    /// The code generator that its rustc loads
    code_generator: PathBuf,
    /// The folder to write the modules to
    output: PathBuf,
    /// With names and lines
    #[arg(long)]
    debug: bool,
}

/// Writes the modules and their manifest.
pub(crate) fn build() -> Result<()> {
    let compiled = compile_release()?;
    empty(&workspace().join(MODULES_PATH))?;
    for (entry_point, module) in &compiled.modules {
        write(&module_path(entry_point), module)?;
    }
    write(MANIFEST_PATH, compiled.manifest.as_bytes())?;
    say(&format!("{MODULES_PATH}: {}", compiled.size()));
    Ok(())
}

/// Compares the committed files with what the sources give.
pub(crate) fn check() -> Result<()> {
    let compiled = compile_release()?;
    let committed = module::read_all(&workspace().join(MODULES_PATH)).context(REMEDY)?;
    for (entry_point, module) in &compiled.modules {
        compare(&module_path(entry_point), module)?;
    }
    for entry_point in committed.keys() {
        let path = module_path(entry_point);
        ensure!(
            compiled.modules.contains_key(entry_point),
            "{path} has no entry point in the sources; {REMEDY}"
        );
    }
    compare(MANIFEST_PATH, compiled.manifest.as_bytes())?;
    say(&format!("{MODULES_PATH} is what the sources give ({})", compiled.size()));
    Ok(())
}

/// Writes modules with names and lines where nobody commits them.
pub(crate) fn build_debug() -> Result<()> {
    let folder = workspace().join("target/kernels-debug");
    empty(&folder)?;
    spawn_compiler(&folder, true)?;
    say(&format!("{}: read them with spirv-dis", folder.display()));
    Ok(())
}

/// Compiles what is to be committed.
fn compile_release() -> Result<Compiled> {
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    spawn_compiler(folder.path(), false)?;
    let modules = module::read_all(folder.path())?;
    let manifest = Manifest {
        source_hash: sources::source_hash(&workspace())?,
        rust_gpu: settings::RUST_GPU.into(),
        target: settings::TARGET.into(),
        modules: describe(&modules)?,
    };
    Ok(Compiled { manifest: manifest.to_json()?, modules })
}

impl Compiled {
    /// How much it is, for messages.
    fn size(&self) -> String {
        let bytes: usize = self.modules.values().map(Vec::len).sum();
        format!("{} modules, {bytes} bytes", self.modules.len())
    }
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
    // One module for all would have each pipeline read, and the validation layers check, the code of every kernel.
    builder.multimodule = true;
    let result = builder.build().context("the kernels do not compile to SPIR-V")?;
    for (entry_point, made) in result.module.unwrap_multi() {
        let path = output.join(format!("{entry_point}.spv"));
        let bytes = std::fs::read(made).with_context(|| made.display().to_string())?;
        std::fs::write(&path, without_contraction(&bytes)?).with_context(|| path.display().to_string())?;
    }
    Ok(())
}

/// A module whose arithmetic no driver may contract.
fn without_contraction(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut module = module::parse(bytes)?;
    contraction::forbid(&mut module);
    Ok(module.assemble().into_iter().flat_map(u32::to_le_bytes).collect())
}

/// Makes an empty folder: a module whose entry point is gone does not stay behind.
fn empty(folder: &Path) -> Result<()> {
    if folder.exists() {
        std::fs::remove_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())
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

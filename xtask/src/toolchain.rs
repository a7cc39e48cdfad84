//! `cargo xtask toolchain`: the compiler that turns the kernels into SPIR-V.
//!
//! rust-gpu is a code generator that rustc loads, built against the internals of one version of rustc. A toolchain
//! is therefore two things: a rustc that rustup knows by name, and `librustc_codegen_spirv` in its `lib` folder.

use crate::debian;
use crate::process::{output, run, say};
use anyhow::{Context, Result, anyhow, bail};
use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::path::{Path, PathBuf};
use std::process::Command;
use xtask::settings::RUST_GPU;

/// The toolchain built from Debian's packages, or brought along ready-made.
pub(crate) const LINKED: &str = "rust-gpu-1.96";
/// The nightly that rust-gpu was released for.
pub(crate) const NIGHTLY: &str = "nightly-2026-04-11";
/// Its parts beyond rustc and cargo: the sources of `core`, rustc's own crates, and LLVM to link them.
const COMPONENTS: &str = "rust-src,rustc-dev,llvm-tools";

/// A toolchain that compiles to SPIR-V.
pub(crate) struct Toolchain {
    /// The name by which rustup knows it.
    pub(crate) name: &'static str,
    /// The code generator.
    pub(crate) code_generator: PathBuf,
}

/// The toolchain that is there.
pub(crate) fn find() -> Result<Toolchain> {
    inspect(LINKED).or_else(|linked| {
        inspect(NIGHTLY).map_err(|nightly| anyhow!("no SPIR-V toolchain: {linked:#}; {nightly:#}"))
    })
}

/// Prints the toolchain that is there, or gets one: from rustup, else from Debian's packages.
pub(crate) fn provide(rustup_only: bool) -> Result<()> {
    let toolchain = match find() {
        Ok(found) => found,
        Err(missing) => {
            say(&format!("{missing:#}; getting one"));
            obtain(rustup_only)?
        }
    };
    say(&format!("{}: {}", toolchain.name, toolchain.code_generator.display()));
    Ok(())
}

/// Gets a toolchain.
fn obtain(rustup_only: bool) -> Result<Toolchain> {
    match from_rustup() {
        Ok(toolchain) => Ok(toolchain),
        Err(reason) if rustup_only => Err(reason),
        Err(reason) => {
            say(&format!("rustup gives no toolchain: {reason:#}"));
            debian::build(LINKED)?;
            inspect(LINKED)
        }
    }
}

/// Looks at the toolchain that rustup knows as `name`.
fn inspect(name: &'static str) -> Result<Toolchain> {
    let sysroot = sysroot(name)?;
    let code_generator = sysroot.join("lib").join(code_generator_file());
    if !code_generator.is_file() {
        bail!("toolchain {name} has no code generator at {}", code_generator.display());
    }
    Ok(Toolchain { name, code_generator })
}

/// The folder of a toolchain, which must start.
fn sysroot(name: &str) -> Result<PathBuf> {
    let installed = output(Command::new("rustup").args(["toolchain", "list"]))?;
    if !installed.lines().any(|line| names(line, name)) {
        bail!("rustup has no toolchain {name}");
    }
    let print = ["run", name, "rustc", "--print", "sysroot"];
    let folder = output(Command::new("rustup").args(print))
        .with_context(|| format!("toolchain {name} does not start; a linked one needs Debian's libllvm22"))?;
    Ok(folder.into())
}

/// Whether a line of `rustup toolchain list` means the toolchain `name`: alone, or followed by the host's triple.
fn names(line: &str, name: &str) -> bool {
    let listed = line.split(' ').next().unwrap_or_default();
    listed.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
}

/// `librustc_codegen_spirv.so` or what the host calls it.
fn code_generator_file() -> String {
    format!("{DLL_PREFIX}rustc_codegen_spirv{DLL_SUFFIX}")
}

/// Installs the nightly through rustup and builds the code generator with it.
fn from_rustup() -> Result<Toolchain> {
    let install = ["toolchain", "install", NIGHTLY, "--profile", "minimal", "--no-self-update"];
    run(Command::new("rustup").args(install).args(["--component", COMPONENTS]))?;
    say(&format!("building rustc_codegen_spirv {RUST_GPU}, about 10 minutes on 2 cores"));
    let work = tempfile::tempdir().context("cannot make a temporary folder")?;
    let library = build_code_generator(work.path())?;
    let place = sysroot(NIGHTLY)?.join("lib").join(code_generator_file());
    std::fs::copy(&library, &place).with_context(|| format!("cannot write {}", place.display()))?;
    inspect(NIGHTLY)
}

/// Builds the code generator, as the dependency of an empty package. Returns the library.
fn build_code_generator(work: &Path) -> Result<PathBuf> {
    let manifest = format!(
        "[package]\nname = \"backend\"\nedition = \"2021\"\n[workspace]\n\
         [dependencies]\nrustc_codegen_spirv = \"={RUST_GPU}\"\n"
    );
    std::fs::create_dir(work.join("src"))?;
    std::fs::write(work.join("src/lib.rs"), "")?;
    std::fs::write(work.join("Cargo.toml"), manifest)?;
    // Not the cargo that runs this program: rustup's, which picks the one of the toolchain.
    let mut command = Command::new("rustup");
    command.args(["run", NIGHTLY, "cargo", "build", "--release", "--target-dir", "target"]);
    command.current_dir(work).env_remove("CARGO").env_remove("RUSTC").env_remove("RUSTUP_TOOLCHAIN");
    run(&mut command)?;
    newest_code_generator(&work.join("target/release/deps"))
}

/// The code generator in the folder where cargo puts dependencies, under a name with a hash.
fn newest_code_generator(folder: &Path) -> Result<PathBuf> {
    let prefix = format!("{DLL_PREFIX}rustc_codegen_spirv");
    for entry in std::fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.starts_with(&prefix) && name.ends_with(DLL_SUFFIX) {
            return Ok(path);
        }
    }
    bail!("cargo built no {prefix}*{DLL_SUFFIX} in {}", folder.display())
}

#[cfg(test)]
mod tests {
    use super::names;

    #[test]
    fn a_listed_toolchain_is_known_by_its_whole_name() {
        assert!(names("rust-gpu-1.96", "rust-gpu-1.96"));
        assert!(names("nightly-2026-04-11-x86_64-unknown-linux-gnu (active)", "nightly-2026-04-11"));
        assert!(!names("rust-gpu-1.961", "rust-gpu-1.96"));
        assert!(!names("nightly-x86_64-unknown-linux-gnu", "nightly-2026-04-11"));
    }
}

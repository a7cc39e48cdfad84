//! The SPIR-V toolchain from Debian's and cargo's packages, for machines where rustup can install nothing.

use crate::process::{output, run, say};
use crate::toolchain::NIGHTLY;
use anyhow::{Context, Result, ensure};
use std::path::{Path, PathBuf};
use std::process::Command;
use xtask::settings::RUST_GPU;
use xtask::workspace;

/// Builds the toolchain in the user's data folder and links it into rustup as `name`.
pub(crate) fn build(name: &str) -> Result<()> {
    ensure!(
        cfg!(all(target_os = "linux", target_arch = "x86_64")) && is_root()? && has_apt(),
        "it can be built from packages only on Debian bookworm for x86_64, as root; elsewhere let rustup install \
            {NIGHTLY}"
    );
    say("building it from Debian's packages, about 20 minutes on 2 cores");
    let destination = data_folder()?.join(name);
    let mut recipe = Command::new("bash");
    recipe.arg(workspace().join("xtask/debian-toolchain.sh")).arg(&destination).arg(RUST_GPU);
    run(&mut recipe)?;
    run(Command::new("rustup").args(["toolchain", "link", name]).arg(&destination))
}

/// Whether this is a Debian-like system.
pub(crate) fn has_apt() -> bool {
    Path::new("/usr/bin/apt-get").exists()
}

/// Whether packages may be installed.
pub(crate) fn is_root() -> Result<bool> {
    Ok(output(Command::new("id").arg("-u"))? == "0")
}

/// Where programs keep their data: `$XDG_DATA_HOME` or `~/.local/share`.
fn data_folder() -> Result<PathBuf> {
    if let Some(folder) = std::env::var_os("XDG_DATA_HOME").filter(|folder| !folder.is_empty()) {
        return Ok(folder.into());
    }
    Ok(std::env::home_dir().context("no home folder: set XDG_DATA_HOME")?.join(".local/share"))
}

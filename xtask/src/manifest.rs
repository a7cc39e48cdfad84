//! `assets/kernels.json`: where the committed SPIR-V modules come from and what they hold.

use crate::module::{self, Contents, ModuleError};
use crate::sources;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The manifest of the SPIR-V modules.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Manifest {
    /// [`source_hash`](sources::source_hash) of the sources they were made from.
    pub source_hash: String,
    /// Version of rust-gpu that compiled them.
    pub rust_gpu: String,
    /// The target they were compiled for.
    pub target: String,
    /// What lies at the [`module_path`](crate::module_path) of each entry point.
    pub modules: BTreeMap<String, ModuleFile>,
}

/// What the manifest says of a module.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct ModuleFile {
    /// SHA-256 of the file, as `sha256:` and 64 hexadecimal digits.
    pub hash: String,
    /// Size of the file in bytes.
    pub size_bytes: usize,
    /// What the module itself says.
    pub contents: Contents,
}

/// What keeps a manifest from being read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ManifestError {
    /// The file could not be read.
    #[error("{path}: {source}; {}", crate::REMEDY)]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system answered.
        source: std::io::Error,
    },
    /// The file is not a manifest.
    #[error("{path}: {source}; {}", crate::REMEDY)]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line and column.
        source: serde_json::Error,
    },
}

impl ModuleFile {
    /// Describes the module of an entry point.
    pub fn of(entry_point: &str, bytes: &[u8]) -> Result<Self, ModuleError> {
        Ok(ModuleFile {
            hash: sources::spelled(&Sha256::digest(bytes)),
            size_bytes: bytes.len(),
            contents: module::contents(&module::parse(bytes)?, entry_point)?,
        })
    }
}

/// Describes modules, by their entry points.
pub fn describe(modules: &BTreeMap<String, Vec<u8>>) -> Result<BTreeMap<String, ModuleFile>, ModuleError> {
    let described = modules.iter().map(|(name, bytes)| Ok((name.clone(), ModuleFile::of(name, bytes)?)));
    described.collect()
}

impl Manifest {
    /// Reads the manifest at `path`.
    pub fn read(path: &Path) -> Result<Self, ManifestError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| ManifestError::Read { path: path.to_path_buf(), source })?;
        serde_json::from_str(&text).map_err(|source| ManifestError::Json { path: path.to_path_buf(), source })
    }

    /// The text that is committed.
    pub fn to_json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again() {
        let module = ModuleFile {
            hash: "sha256:01".into(),
            size_bytes: 20,
            contents: Contents {
                workgroup: [8, 8, 1],
                spec_constants: [(7, 2)].into(),
                bindings: [0, 9].into(),
            },
        };
        let manifest = Manifest {
            source_hash: "sha256:00".into(),
            rust_gpu: "0.10.0".into(),
            target: "spirv-unknown-vulkan1.2".into(),
            modules: [("render".into(), module)].into(),
        };
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), manifest.to_json().unwrap()).unwrap();
        assert_eq!(Manifest::read(file.path()).unwrap(), manifest);
    }

    #[test]
    fn errors_name_file_line_and_remedy() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "{\n1").unwrap();
        let message = Manifest::read(file.path()).unwrap_err().to_string();
        let name = file.path().to_str().unwrap();
        assert!(
            message.contains(name) && message.contains("line 2") && message.contains(crate::REMEDY),
            "{message}"
        );
    }
}

//! `assets/kernels.json`: where the committed SPIR-V module comes from and what it holds.

use crate::module::Contents;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The manifest of a SPIR-V module.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Manifest {
    /// [`source_hash`](crate::sources::source_hash) of the sources it was made from.
    pub source_hash: String,
    /// Version of rust-gpu that compiled it.
    pub rust_gpu: String,
    /// The target it was compiled for.
    pub target: String,
    /// Size of the module in bytes.
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
    use crate::module::EntryPoint;

    #[test]
    fn what_is_written_is_read_again() {
        let manifest = Manifest {
            source_hash: "sha256:00".into(),
            rust_gpu: "0.10.0".into(),
            target: "spirv-unknown-vulkan1.2".into(),
            size_bytes: 20,
            contents: Contents {
                entry_points: [("render".into(), EntryPoint { workgroup: [8, 8, 1] })].into(),
                spec_constants: [(7, 2)].into(),
                bindings: [0, 9].into(),
            },
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

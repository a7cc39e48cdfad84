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
    #[serde(flatten)]
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

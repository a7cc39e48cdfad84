//! The source hash: one number for everything that decides the bytes of the SPIR-V modules.
//!
//! It lets a test tell, without the SPIR-V toolchain, that the committed modules are older than the kernels.

use crate::settings;
use serde::Deserialize;
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The package whose sources are compiled to SPIR-V.
const KERNELS: &str = "emboss-kernels";

/// What keeps the source hash from being computed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// A file or folder could not be read.
    #[error("{path}: {source}")]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system answered.
        source: std::io::Error,
    },
    /// A TOML file is not what cargo writes.
    #[error("{path}: {source}")]
    Toml {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line and column.
        source: Box<toml::de::Error>,
    },
    /// The kernels' package is not in the lock file.
    #[error("{path}: no package {KERNELS}; run `cargo generate-lockfile`")]
    NotLocked {
        /// The lock file.
        path: PathBuf,
    },
}

/// The hash of what decides the modules' bytes in the workspace at `root`, as `sha256:` and 64 hexadecimal digits:
/// - the text of every Rust file below `kernels`, with its path there (line endings do not count);
/// - `kernels/Cargo.toml`, and what it takes from the workspace's;
/// - name, version and checksum of every package that the kernels depend on, from `Cargo.lock`;
/// - the [`settings`] of the compiler.
pub fn source_hash(root: &Path) -> Result<String, SourceError> {
    let mut hash = Sha256::new();
    for file in kernel_files(&root.join("kernels"))? {
        let name = file.strip_prefix(root).unwrap_or(&file);
        add(&mut hash, &slashed(name), &read(&file)?);
    }
    add(&mut hash, "workspace", &inherited(root)?);
    for package in locked_packages(&root.join("Cargo.lock"))? {
        add(&mut hash, &package.name, &format!("{} {}", package.version, package.checksum));
    }
    add(&mut hash, "settings", &format!("{:?}", compiler_settings()));
    Ok(spelled(&hash.finalize()))
}

/// Adds a named text. Lengths go first, so that no text can pass for a part of its neighbour.
fn add(hash: &mut Sha256, name: &str, text: &str) {
    for part in [name, &text.replace("\r\n", "\n")] {
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part.as_bytes());
    }
}

/// Everything of [`settings`] that reaches the compiler of the committed modules.
fn compiler_settings() -> impl std::fmt::Debug {
    let linked = (settings::RUST_GPU, settings::TARGET, settings::CAPABILITIES, settings::RELEASE);
    (linked, settings::DECORATION)
}

/// The manifest of the kernels and every Rust file below `folder`, in the order of their paths.
fn kernel_files(folder: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let mut files = BTreeSet::from([folder.join("Cargo.toml")]);
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        let at = |source| SourceError::Read { path: folder.clone(), source };
        for entry in std::fs::read_dir(&folder).map_err(at)? {
            let path = entry.map_err(at)?.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                files.insert(path);
            }
        }
    }
    Ok(files.into_iter().collect())
}

/// What `kernels/Cargo.toml` takes from the workspace's manifest: the edition, and versions and features of its
/// dependencies.
fn inherited(root: &Path) -> Result<String, SourceError> {
    let kernels: Manifest = parse(&root.join("kernels/Cargo.toml"))?;
    let workspace = parse::<Manifest>(&root.join("Cargo.toml"))?.workspace;
    let mut dependencies = workspace.dependencies;
    dependencies.retain(|name, _| kernels.dependencies.contains_key(name));
    let edition = workspace.package.get("edition").map(ToString::to_string).unwrap_or_default();
    Ok(dependencies.iter().fold(edition, |text, (name, value)| format!("{text}\n{name} = {value}")))
}

/// The packages that the kernels depend on, themselves left out, directly or through others, by name and version.
fn locked_packages(path: &Path) -> Result<BTreeSet<LockedPackage>, SourceError> {
    let lock: LockFile = parse(path)?;
    let mut found = BTreeSet::new();
    let mut wanted = vec![KERNELS];
    while let Some(dependency) = wanted.pop() {
        for package in lock.package.iter().filter(|package| package.answers(dependency)) {
            if found.insert(package) {
                wanted.extend(package.dependencies.iter().map(String::as_str));
            }
        }
    }
    if found.is_empty() {
        return Err(SourceError::NotLocked { path: path.to_path_buf() });
    }
    Ok(found.into_iter().filter(|package| package.name != KERNELS).cloned().collect())
}

/// The parts of a manifest that are read.
#[derive(Deserialize)]
struct Manifest {
    #[serde(default)]
    dependencies: BTreeMap<String, serde_json::Value>,
    #[serde(default)]
    workspace: Workspace,
}

/// The `workspace` table of a manifest.
#[derive(Default, Deserialize)]
struct Workspace {
    #[serde(default)]
    package: BTreeMap<String, serde_json::Value>,
    #[serde(default)]
    dependencies: BTreeMap<String, serde_json::Value>,
}

/// `Cargo.lock`.
#[derive(Deserialize)]
struct LockFile {
    package: Vec<LockedPackage>,
}

/// A package of `Cargo.lock`.
#[derive(Clone, Deserialize, PartialEq, Eq, PartialOrd, Ord)]
struct LockedPackage {
    name: String,
    version: String,
    #[serde(default)]
    checksum: String,
    #[serde(default)]
    dependencies: Vec<String>,
}

impl LockedPackage {
    /// Whether an entry of a `dependencies` list means this package: `name`, or `name version` where the lock file
    /// has several versions.
    fn answers(&self, dependency: &str) -> bool {
        let mut words = dependency.split(' ');
        words.next() == Some(&self.name) && words.next().is_none_or(|version| version == self.version)
    }
}

/// Reads a text file.
fn read(path: &Path) -> Result<String, SourceError> {
    std::fs::read_to_string(path).map_err(|source| SourceError::Read { path: path.to_path_buf(), source })
}

/// Reads a TOML file.
fn parse<T: for<'a> Deserialize<'a>>(path: &Path) -> Result<T, SourceError> {
    toml::from_str(&read(path)?)
        .map_err(|source| SourceError::Toml { path: path.to_path_buf(), source: Box::new(source) })
}

/// A path with `/` between its parts on every system.
fn slashed(path: &Path) -> String {
    path.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/")
}

/// A digest of SHA-256 as manifests have it: two lower-case digits a byte.
pub(crate) fn spelled(digest: &[u8]) -> String {
    digest.iter().fold("sha256:".to_owned(), |text, byte| format!("{text}{byte:02x}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A workspace small enough to change one thing after the other.
    fn workspace() -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(root.path().join("kernels/src/bvh")).unwrap();
        for (path, text) in [
            ("kernels/Cargo.toml", "[dependencies]\nglam.workspace = true\n"),
            ("kernels/src/lib.rs", "pub mod bvh;\n"),
            ("kernels/src/bvh/mod.rs", "pub fn build() {}\n"),
            (
                "Cargo.toml",
                "[workspace.package]\nedition = \"2024\"\n[workspace.dependencies]\nglam = \"1\"\nash = \"1\"\n",
            ),
            (
                "Cargo.lock",
                "[[package]]\nname = \"emboss-kernels\"\nversion = \"0.1.0\"\ndependencies = [\"glam 1.0.0\"]\n\
                 [[package]]\nname = \"glam\"\nversion = \"1.0.0\"\nchecksum = \"1a\"\ndependencies = [\"libm\"]\n\
                 [[package]]\nname = \"glam\"\nversion = \"2.0.0\"\nchecksum = \"2a\"\n\
                 [[package]]\nname = \"libm\"\nversion = \"0.2.0\"\nchecksum = \"3a\"\n",
            ),
        ] {
            std::fs::write(root.path().join(path), text).unwrap();
        }
        root
    }

    /// The hash before and after replacing `from` by `to` in a file.
    fn hashes(file: &str, from: &str, to: &str) -> (String, String) {
        let root = workspace();
        let before = source_hash(root.path()).unwrap();
        let path = root.path().join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(from));
        std::fs::write(&path, text.replace(from, to)).unwrap();
        (before, source_hash(root.path()).unwrap())
    }

    #[test]
    fn everything_that_decides_the_bytes_changes_the_hash() {
        for (file, from, to) in [
            ("kernels/src/lib.rs", "bvh", "hvb"),
            ("kernels/src/bvh/mod.rs", "build", "refit"),
            ("kernels/Cargo.toml", "glam", "ash"),
            ("Cargo.toml", "glam = \"1\"", "glam = \"2\""),
            ("Cargo.toml", "2024", "2021"),
            ("Cargo.lock", "glam 1.0.0", "glam 2.0.0"),
            ("Cargo.lock", "3a", "3b"),
        ] {
            let (before, after) = hashes(file, from, to);
            assert_ne!(before, after, "{file}: {from} -> {to}");
        }
    }

    #[test]
    fn nothing_else_does() {
        for (file, from, to) in [
            ("kernels/src/lib.rs", "\n", "\r\n"),
            ("Cargo.toml", "ash = \"1\"", "ash = \"2\""),
            ("Cargo.lock", "2a", "2b"),
        ] {
            let (before, after) = hashes(file, from, to);
            assert_eq!(before, after, "{file}: {from} -> {to}");
        }
    }

    #[test]
    fn a_renamed_file_changes_the_hash() {
        let root = workspace();
        let before = source_hash(root.path()).unwrap();
        let source = root.path().join("kernels/src");
        std::fs::rename(source.join("bvh/mod.rs"), source.join("bvh.rs")).unwrap();
        assert_ne!(before, source_hash(root.path()).unwrap());
    }

    #[test]
    fn errors_name_the_file() {
        let root = workspace();
        let lock = root.path().join("Cargo.lock");
        std::fs::write(&lock, "package = 1").unwrap();
        let message = source_hash(root.path()).unwrap_err().to_string();
        assert!(message.contains("Cargo.lock") && message.contains("line 1"), "{message}");
        std::fs::write(&lock, "package = []").unwrap();
        let message = source_hash(root.path()).unwrap_err().to_string();
        assert!(message.contains("no package emboss-kernels"), "{message}");
    }
}

//! Files that are written whole, or not at all.

use std::io::{self, Write};
use std::path::Path;
use tempfile::NamedTempFile;

/// The folder that holds the file at `path`.
pub(crate) fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

/// A new file beside `path`, on the same file system so that it can be renamed to that; gone when dropped.
pub(crate) fn temporary(path: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".emboss-").suffix(".part");
    // Temporary files are private by default; what is written is as public as the user's umask says.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder(path))
}

/// Gives a [`temporary`] file its name: what had it before is replaced.
pub(crate) fn keep(file: NamedTempFile, path: &Path) -> io::Result<()> {
    // A full disk may show only when the data leave the cache; the rename must not come before.
    file.as_file().sync_all()?;
    file.persist(path).map(drop).map_err(|error| error.error)
}

/// Writes a file of `content`.
pub(crate) fn write(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut file = temporary(path)?;
    file.write_all(content)?;
    keep(file, path)
}

//! `cargo xtask test width`: no line of Rust is wider than a window beside another. rustfmt leaves comments and strings
//! as they are.

use anyhow::{Context, Result, ensure};
use std::path::{Path, PathBuf};
use xtask::workspace;

/// Characters of a line at the most.
const WIDEST: usize = 120;
/// The folders whose sources are looked at, with all below them.
const FOLDERS: [&str; 4] = ["kernels", "runner", "tests", "xtask"];

/// Fails where a line is too wide, naming all of them. Returns how many files were looked at.
pub(crate) fn check() -> Result<usize> {
    let mut files = Vec::new();
    for folder in FOLDERS {
        collect(&workspace().join(folder), &mut files)?;
    }
    files.sort();
    let mut wide = Vec::new();
    for file in &files {
        let text = std::fs::read_to_string(file).with_context(|| file.display().to_string())?;
        let name = file.strip_prefix(workspace()).unwrap_or(file).display();
        wide.extend(too_wide(&text).map(|(line, width)| format!("{name}:{line}: {width} characters")));
    }
    ensure!(wide.is_empty(), "lines of more than {WIDEST} characters; break them:\n{}", wide.join("\n"));
    Ok(files.len())
}

/// All Rust sources below a folder.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    for entry in std::fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        if path.is_dir() {
            collect(&path, files)?;
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    Ok(())
}

/// The numbers of lines that are too wide, with their widths. A comment of one address alone is not: there is no place
/// to break it.
fn too_wide(text: &str) -> impl Iterator<Item = (usize, usize)> {
    let widths = text.lines().enumerate().map(|(i, line)| (i + 1, line, line.chars().count()));
    let wide = widths.filter(|&(_, line, width)| width > WIDEST && !is_address(line));
    wide.map(|(line, _, width)| (line, width))
}

/// Whether a line is a comment of one address alone.
fn is_address(line: &str) -> bool {
    let Some(comment) = line.trim_start().strip_prefix("//") else { return false };
    let text = comment.trim_start_matches(['/', '!']).trim().trim_start_matches('<');
    text.starts_with("http") && text.contains("://") && !text.contains(' ')
}

#[cfg(test)]
mod tests {
    use super::too_wide;

    #[test]
    fn what_is_too_wide_is_named() {
        let line = |width: usize| format!("// {}", "°".repeat(width - 3));
        let text = [line(120), line(121), String::new(), line(200)].join("\n");
        assert_eq!(too_wide(&text).collect::<Vec<_>>(), [(2, 121), (4, 200)]);
    }

    #[test]
    fn addresses_cannot_be_broken() {
        let address = format!("https://example.org/{}", "a".repeat(120));
        let count = |text: String| too_wide(&text).count();
        assert_eq!(count(format!("    /// <{address}>")), 0);
        assert_eq!(count(format!("//! {address}")), 0);
        assert_eq!(count(format!("/// See {address}")), 1);
        assert_eq!(count(format!("let address = \"{address}\";")), 1);
    }
}

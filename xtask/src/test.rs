//! `cargo xtask test`: everything that CI checks, step by step.

use crate::debian::{has_apt, is_root};
use crate::process::{cargo, run as run_command, run_listening, say};
use crate::{spirv, toolchain};
use anyhow::{Context, Result, ensure};
use clap::ValueEnum;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// What marks tests that dispatch on a Vulkan device: unit tests have it in the path of their module, files of
/// `tests/tests` begin with it.
const VULKAN: &str = "vulkan";

/// A step, in the order in which CI takes them: what is quick and often wrong comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub(crate) enum Step {
    /// Lavapipe, the Vulkan loader, the validation layers, SPIRV-Tools and a display are there, or are installed
    Packages,
    /// Every file is formatted
    Fmt,
    /// No line of Rust is wider than 120 characters
    Width,
    /// No lint speaks up
    Clippy,
    /// The documentation builds, its links lead somewhere
    Docs,
    /// Tests that need no Vulkan
    Unit,
    /// Tests of pipelines, most of which dispatch kernels on lavapipe
    Vulkan,
    /// The committed SPIR-V is what the sources give
    Spirv,
}

/// Runs the named steps, or all.
pub(crate) fn run(steps: &[Step]) -> Result<()> {
    let mut steps = if steps.is_empty() { Step::value_variants().to_vec() } else { steps.to_vec() };
    steps.sort();
    steps.dedup();
    let mut summary = Vec::new();
    for step in steps {
        let name = step.name();
        say(&format!("\n== {name}"));
        let start = Instant::now();
        let result = step.run().with_context(|| format!("step {name} failed"))?;
        summary.push(format!("{name:<10}{:>5} s   {result}", start.elapsed().as_secs()));
    }
    say(&format!("\n{}", summary.join("\n")));
    Ok(())
}

impl Step {
    /// How the command line spells it.
    fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }

    /// Runs it. Returns what to say of it in the summary.
    fn run(self) -> Result<String> {
        match self {
            Self::Packages => install_packages(),
            Self::Fmt => passes(cargo().args(["fmt", "--all", "--check"])),
            Self::Width => crate::width::check().map(|files| format!("{files} files")),
            Self::Clippy => {
                let clippy = ["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"];
                passes(cargo().args(clippy))
            }
            Self::Docs => {
                let docs = ["doc", "--workspace", "--no-deps"];
                passes(cargo().args(docs).env("RUSTDOCFLAGS", "-D warnings"))
            }
            Self::Unit => unit_tests(),
            Self::Vulkan => vulkan_tests(),
            Self::Spirv => check_spirv(),
        }
    }
}

/// Runs a command that passes or fails.
fn passes(command: &mut Command) -> Result<String> {
    run_command(command)?;
    Ok("ok".into())
}

/// Runs the tests that need no Vulkan device.
fn unit_tests() -> Result<String> {
    let mut units = cargo();
    units.args(["test", "--workspace", "--exclude", "emboss-tests", "--", "--skip", VULKAN]);
    let mut whole = cargo();
    whole.args(["test", "--package", "emboss-tests", "--lib"]);
    for name in test_programs()?.iter().filter(|name| !name.starts_with(VULKAN)) {
        whole.args(["--test", name]);
    }
    cargo_test([units, whole])
}

/// Runs the tests on lavapipe, whatever other drivers the machine has.
fn vulkan_tests() -> Result<String> {
    let driver = lavapipe().context("lavapipe is missing; run `cargo xtask test packages`")?;
    let mut units = cargo();
    units.args(["test", "--package", "emboss", "--", VULKAN]);
    let mut whole = cargo();
    whole.args(["test", "--package", "emboss-tests", "--test", &format!("{VULKAN}*")]);
    for command in [&mut units, &mut whole] {
        // Loaders before 1.3.207 know the first name, later ones prefer the second.
        command.env("VK_ICD_FILENAMES", &driver).env("VK_DRIVER_FILES", &driver);
    }
    cargo_test([units, whole])
}

/// The names of the whole-program tests: the files of `tests/tests`.
fn test_programs() -> Result<Vec<String>> {
    let folder = xtask::workspace().join("tests/tests");
    let mut names = Vec::new();
    for entry in std::fs::read_dir(&folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        if let (Some(name), true) =
            (path.file_stem(), path.extension().is_some_and(|extension| extension == "rs"))
        {
            names.push(name.to_string_lossy().into_owned());
        }
    }
    names.sort();
    Ok(names)
}

/// Compares the committed modules with the sources, where a toolchain is there to compile them.
fn check_spirv() -> Result<String> {
    match toolchain::find() {
        Ok(_) => spirv::check().map(|()| "ok".into()),
        Err(missing) => {
            say(&format!("{missing:#}"));
            Ok("NOT CHECKED, no SPIR-V toolchain (that the sources' hash is the manifest's is a unit test)"
                .into())
        }
    }
}

/// Runs commands of `cargo test`. Returns the totals over all test programs.
fn cargo_test(commands: [Command; 2]) -> Result<String> {
    let mut totals = Totals::default();
    for mut command in commands {
        let before = totals.passed;
        run_listening(&mut command, |line| totals.add(line))?;
        ensure!(totals.passed > before, "no test ran");
    }
    Ok(totals.to_string())
}

/// Test results, summed over test programs.
#[derive(Debug, Default, PartialEq, Eq)]
struct Totals {
    passed: usize,
    failed: usize,
    ignored: usize,
}

impl Totals {
    /// Adds a line such as `test result: ok. 3 passed; 0 failed; 1 ignored; …`; other lines say nothing.
    fn add(&mut self, line: &str) {
        let Some((_, counts)) = line.strip_prefix("test result: ").and_then(|rest| rest.split_once(". "))
        else {
            return;
        };
        for (number, word) in counts.split("; ").filter_map(|count| count.split_once(' ')) {
            let number: usize = number.parse().unwrap_or(0);
            match word {
                "passed" => self.passed += number,
                "failed" => self.failed += number,
                "ignored" => self.ignored += number,
                _ => {}
            }
        }
    }
}

impl std::fmt::Display for Totals {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} passed; {} failed; {} ignored", self.passed, self.failed, self.ignored)
    }
}

/// A Debian package that tests need, and how to see that it is there.
struct Package {
    name: &'static str,
    is_there: fn() -> bool,
}

/// The packages, by their names in Debian and Ubuntu.
const PACKAGES: &[Package] = &[
    Package { name: "mesa-vulkan-drivers", is_there: || lavapipe().is_some() },
    Package { name: "libvulkan1", is_there: || has_library("libvulkan.so.1") },
    Package { name: "vulkan-validationlayers", is_there: has_validation_layer },
    Package { name: "xvfb", is_there: || has_program("Xvfb") },
    Package { name: "xdotool", is_there: || has_program("xdotool") },
    Package { name: "openbox", is_there: || has_program("openbox") },
    Package { name: "sway", is_there: || has_program("sway") },
    Package { name: "grim", is_there: || has_program("grim") },
    // What a window loads when it opens.
    Package { name: "libxcursor1", is_there: || has_library("libXcursor.so.1") },
    Package { name: "libxi6", is_there: || has_library("libXi.so.6") },
    Package { name: "libxkbcommon-x11-0", is_there: || has_library("libxkbcommon-x11.so.0") },
];

/// Installs what is missing, or says what to install.
fn install_packages() -> Result<String> {
    let missing = missing_packages();
    if missing.is_empty() {
        return Ok("all there".into());
    }
    let names = missing.join(" ");
    ensure!(
        has_apt(),
        "missing: what Debian calls {names} (lavapipe, the Vulkan loader, the validation layers, a display for the \
            viewer); install it"
    );
    ensure!(is_root()?, "missing: {names}; run `sudo apt-get install {names}`");
    run_command(Command::new("apt-get").args(["update", "-qq"]))?;
    let install = ["install", "--yes", "-qq", "--no-install-recommends"];
    run_command(
        Command::new("apt-get").args(install).args(&missing).env("DEBIAN_FRONTEND", "noninteractive"),
    )?;
    ensure!(
        missing_packages().is_empty(),
        "apt-get installed {names}, but they are not where they should be"
    );
    Ok(format!("installed {names}"))
}

/// The names of the packages that are not there.
fn missing_packages() -> Vec<&'static str> {
    PACKAGES.iter().filter(|package| !(package.is_there)()).map(|package| package.name).collect()
}

/// Folders in which drivers and layers are registered.
const REGISTRIES: [&str; 3] = ["/usr/share/vulkan", "/usr/local/share/vulkan", "/etc/vulkan"];

/// The registration of lavapipe, Mesa's Vulkan driver that runs on the CPU.
fn lavapipe() -> Option<PathBuf> {
    let folders = REGISTRIES.iter().filter_map(|root| std::fs::read_dir(Path::new(root).join("icd.d")).ok());
    let mut drivers = folders.flatten().filter_map(|entry| Some(entry.ok()?.path()));
    drivers.find(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("lvp_icd")))
}

/// Whether programs find a library.
fn has_library(name: &str) -> bool {
    let libraries = Command::new("/sbin/ldconfig").arg("-p").output();
    libraries.is_ok_and(|output| String::from_utf8_lossy(&output.stdout).contains(name))
}

/// Whether a program is where programs are looked for.
pub(crate) fn has_program(name: &str) -> bool {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&folders).any(|folder| folder.join(name).is_file())
}

/// Whether the Khronos validation layer is registered.
fn has_validation_layer() -> bool {
    let file = "explicit_layer.d/VkLayer_khronos_validation.json";
    REGISTRIES.iter().any(|root| Path::new(root).join(file).exists())
}

#[cfg(test)]
mod tests {
    use super::Totals;

    #[test]
    fn totals_sum_what_test_programs_report() {
        let mut totals = Totals::default();
        totals.add("running 3 tests");
        totals.add(
            "test result: ok. 3 passed; 0 failed; 1 ignored; 0 measured; 2 filtered out; finished in 0.10s",
        );
        totals.add(
            "test result: FAILED. 4 passed; 2 failed; 0 ignored; 0 measured; 0 filtered out; finished in 1s",
        );
        assert_eq!(totals, Totals { passed: 7, failed: 2, ignored: 1 });
        assert_eq!(totals.to_string(), "7 passed; 2 failed; 1 ignored");
    }
}

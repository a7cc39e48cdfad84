//! `emboss devices`: what can render, and whether it renders exactly.

use super::{CliError, description, say};
use crate::backend::DeviceInfo;
use crate::backend::select::{BackendChoice, devices, open_backend};
use crate::check::{Finding, Verdict, check};

/// `emboss devices`.
#[derive(Debug, clap::Args)]
pub(super) struct DevicesArgs {
    /// Measure whether the device renders exactly: its floats, its loops, and rays on a small scene
    ///
    /// Without --device that is what `emboss render` would render on. Takes seconds. The exit code is 0 where exactness
    /// holds as far as was looked, 1 where it does not.
    #[arg(long)]
    check: bool,
    /// The backend to check
    #[arg(long, value_enum, default_value_t = BackendChoice::Auto, requires = "check")]
    backend: BackendChoice,
    /// The Vulkan device to check, by its number or a part of its name
    #[arg(long, value_name = "DEVICE", requires = "check")]
    device: Option<String>,
}

impl DevicesArgs {
    pub(super) fn run(self) -> Result<(), CliError> {
        if self.check { self.check() } else { list() }
    }

    fn check(self) -> Result<(), CliError> {
        if self.backend == BackendChoice::Cpu && self.device.is_some() {
            return Err(CliError::DeviceWithCpu);
        }
        let mut backend = open_backend(self.backend, self.device.as_deref(), false)?;
        say(line(backend.device(), None));
        let findings = check(backend.as_mut())?;
        findings.iter().for_each(say);
        if !findings.iter().any(Finding::fails) {
            say("Emboss is exact here, as far as this looked.");
            return Ok(());
        }
        Err(CliError::NotExact { device: backend.device().name.clone(), failures: failures(&findings) })
    }
}

/// The matters that fail, and the remedy for each.
fn failures(findings: &[Finding]) -> String {
    let failure = |finding: &Finding| match finding.verdict {
        Verdict::Fails(remedy) => Some(format!("\n  {} {}; {remedy}", finding.matter, finding.found)),
        Verdict::Holds | Verdict::Noted => None,
    };
    findings.iter().filter_map(failure).collect()
}

/// One line a device; the number is what `--device` takes.
fn list() -> Result<(), CliError> {
    let mut vulkan = 0_u32..;
    for device in devices() {
        let number = if device.backend == "vulkan" { vulkan.next() } else { None };
        say(line(&device, number));
    }
    Ok(())
}

fn line(device: &DeviceInfo, number: Option<u32>) -> String {
    let number = number.map_or_else(String::new, |number| number.to_string());
    format!("{:<8}{number:<3}{}", device.backend, description(device))
}

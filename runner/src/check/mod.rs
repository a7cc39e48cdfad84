//! Whether exactness holds on the device at hand: what `docs/EXACTNESS.md` assumes of floats and loops, measured on
//! that device with that driver, then rays that must not leak and rays that must hit what they hit on the CPU.
//!
//! It proves nothing that it does not look at; what it finds to be otherwise than assumed is certain.

mod floats;
mod items;
mod traces;

use crate::backend::{Backend, BackendError};
use crate::render::RenderError;
use std::fmt;

/// Why a device could not be checked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckError {
    /// An error of the device.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// The built-in scene cannot be traced.
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// The meaning of a finding for exactness.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It is as the bounds on errors assume.
    Holds,
    /// It is otherwise, so that pictures may be wrong; this is to be done.
    Fails(&'static str),
    /// Exactness does not depend on it.
    Noted,
}

/// A matter, as it was found to be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The matter, in a word.
    pub matter: &'static str,
    /// How it is on this device.
    pub found: String,
    /// Whether exactness holds with that.
    pub verdict: Verdict,
}

impl Finding {
    fn new(matter: &'static str, found: impl Into<String>, verdict: Verdict) -> Finding {
        Finding { matter, found: found.into(), verdict }
    }

    /// One that holds or fails; what fails is nothing that a user can mend.
    fn test(matter: &'static str, found: impl Into<String>, holds: bool) -> Finding {
        Finding::new(matter, found, if holds { Verdict::Holds } else { Verdict::Fails(RENDER_ON_THE_CPU) })
    }

    /// Whether it is otherwise than exactness needs it.
    pub fn fails(&self) -> bool {
        matches!(self.verdict, Verdict::Fails(_))
    }
}

/// The remedy for what only another driver mends.
const RENDER_ON_THE_CPU: &str = "render with --backend cpu, or with another driver";

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = match self.verdict {
            Verdict::Holds => "holds",
            Verdict::Fails(_) => "FAILS",
            Verdict::Noted => "",
        };
        write!(f, "  {:<12}{verdict:<7}{}", self.matter, self.found)
    }
}

/// Checks the device of `backend`, which loses its scene. Takes seconds.
///
/// # Errors
/// Errors of the device, which may be lost.
pub fn check(backend: &mut dyn Backend) -> Result<Vec<Finding>, CheckError> {
    let mut findings = floats::findings(backend)?;
    findings.extend(traces::findings(backend)?);
    Ok(findings)
}

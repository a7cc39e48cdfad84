//! Why a command fails, and with which exit code.

use super::inputs::InputError;
use crate::backend::BackendError;
use crate::bench::build::BenchError;
use crate::check::CheckError;
use crate::compare::CompareError;
use crate::picture::PictureError;
use crate::render::RenderError;
use crate::scene::SceneError;
use crate::settings::Method;
use crate::stats::StatsError;
use crate::view::{ScriptError, Unread, ViewError};
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Why a command failed. Each message says what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(super) enum CliError {
    #[error("--depth chooses the bits of a PNG, but {} is none; leave --depth out or name the output \
        .png", .0.display())]
    DepthWithoutPng(PathBuf),
    #[error("--device chooses a Vulkan device, but --backend cpu uses none; leave one of them out")]
    DeviceWithCpu,
    #[error("--normal-map is read by --method normal-map alone, not by {0}; leave one of them out")]
    NormalMapOfNothing(Method),
    #[error("--offset-map is read by --method bump-offset alone, not by {0}; leave one of them out")]
    OffsetMapOfNothing(Method),
    #[error("--stats and --output name the same file, {}; give them different names", .0.display())]
    StatsOverPicture(PathBuf),
    #[error("--stats counts the work of a whole picture; leave it out, or use `emboss render`")]
    StatsOfView,
    #[error(transparent)]
    Script(#[from] ScriptError),
    #[error(transparent)]
    View(#[from] ViewError),
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Picture(#[from] PictureError),
    #[error(transparent)]
    Stats(#[from] StatsError),
    #[error(transparent)]
    Render(#[from] RenderError),
    #[error("{source}; {} was not written", path.display())]
    Unfinished { source: BackendError, path: PathBuf },
    #[error("--quality chooses the method and N; leave --method and N out, or --quality")]
    QualityWithChoice,
    #[error("no method can render this scene within the budget; name one with --method")]
    NoCandidate,
    #[error("{0} is not for `emboss compare`; leave it out (--methods and --n choose what is compared)")]
    NotOfCompare(&'static str),
    #[error(transparent)]
    Compare(#[from] CompareError),
    #[error("interrupted before there was anything to see; no picture was written")]
    InterruptedEarly,
    #[error("interrupted; the picture so far was written to {}", .0.display())]
    Interrupted(PathBuf),
    #[error("exactness does not hold on {device} with its driver:{failures}")]
    NotExact {
        device: String,
        /// A line for each.
        failures: String,
    },
    #[error(transparent)]
    Bench(#[from] BenchError),
    #[error(
        "no Vulkan device to measure; `emboss devices` lists what there is, --backend cpu measures the processor"
    )]
    NothingToMeasure,
    #[error("{}: the results could not be written ({reason}); choose another --json", path.display())]
    Results { path: PathBuf, reason: std::io::Error },
    #[error("interrupted; what was measured until then stands above")]
    BenchInterrupted,
}

impl CliError {
    /// The file of a scene that cannot be used, where it is one.
    pub(super) fn file(&self) -> Option<&Path> {
        match self {
            CliError::Input(error) => error.file(),
            _ => None,
        }
    }

    pub(super) fn exit_code(&self) -> u8 {
        match self {
            CliError::DepthWithoutPng(_)
            | CliError::DeviceWithCpu
            | CliError::NormalMapOfNothing(_)
            | CliError::OffsetMapOfNothing(_)
            | CliError::StatsOverPicture(_)
            | CliError::StatsOfView
            | CliError::QualityWithChoice
            | CliError::NotOfCompare(_)
            | CliError::Script(_)
            | CliError::Picture(PictureError::UnknownFormat { .. })
            | CliError::Input(
                InputError::UnknownBuiltin { .. }
                | InputError::NoVectors { .. }
                | InputError::InvertVectors
                | InputError::ChannelsOfNothing
                | InputError::Scene(SceneError::SceneFile { .. }),
            )
            | CliError::Render(
                RenderError::Framing(_)
                | RenderError::MethodOfVectors { .. }
                | RenderError::MethodOfAuto { .. }
                | RenderError::StoredOnce { .. },
            )
            | CliError::Compare(CompareError::Render(RenderError::Framing(_)))
            | CliError::View(ViewError::Render(
                RenderError::Framing(_)
                | RenderError::MethodOfVectors { .. }
                | RenderError::MethodOfAuto { .. }
                | RenderError::StoredOnce { .. },
            )) => 2,
            // What the arguments name is read by the viewer's own thread.
            CliError::View(ViewError::Source(Unread { error, .. })) => {
                error.downcast_ref::<CliError>().map_or(1, CliError::exit_code)
            }
            // 128 + SIGINT, what shells report of a program that ended by Ctrl-C.
            CliError::Interrupted(_)
            | CliError::InterruptedEarly
            | CliError::BenchInterrupted
            | CliError::Compare(CompareError::Interrupted) => 130,
            _ => 1,
        }
    }
}

impl From<SceneError> for CliError {
    fn from(error: SceneError) -> Self {
        CliError::Input(error.into())
    }
}

impl From<CheckError> for CliError {
    fn from(error: CheckError) -> Self {
        match error {
            CheckError::Backend(error) => error.into(),
            CheckError::Render(error) => error.into(),
        }
    }
}

impl From<BackendError> for CliError {
    fn from(error: BackendError) -> Self {
        CliError::Render(error.into())
    }
}

/// What a command failed with that writes what it has all the same. Where it cannot write that either it warns of it.
pub(super) fn first_error<E: Display>(worked: Result<(), E>, written: Result<(), E>) -> Result<(), E> {
    if let (Err(_), Err(error)) = (&worked, &written) {
        tracing::warn!("{error}");
    }
    worked.and(written)
}

/// The error of a file of measurements that could not be written.
pub(super) fn cannot_write(path: &Path, reason: std::io::Error) -> CliError {
    CliError::Results { path: path.to_owned(), reason }
}

#[cfg(test)]
mod tests {
    use super::first_error;

    #[test]
    fn what_ended_a_command_is_said_before_what_could_not_be_written() {
        assert_eq!(first_error(Err("lost"), Err("full")), Err("lost"));
        assert_eq!(first_error(Ok(()), Err("full")), Err("full"));
        assert_eq!(first_error(Err("lost"), Ok(())), Err("lost"));
        assert_eq!(first_error::<&str>(Ok(()), Ok(())), Ok(()));
    }
}

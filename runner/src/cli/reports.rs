//! What is said of pictures that are as they were asked for, but hardly as they were meant: see
//! [`reports`](crate::reports).

use crate::backend::{Backend, BackendError};
use crate::reports::{Findings, Repeated, Undersampled, Useless};
use std::path::Path;

/// Faces that lie on others, and what is said of them.
#[derive(Clone, Debug, Default)]
pub(super) struct RepeatedFaces {
    /// In the whole scene.
    pub(super) repeated: Repeated,
    /// A line for each model that has some, and one for those of several models.
    pub(super) lines: Vec<String>,
}

impl RepeatedFaces {
    /// Counts those of a model of that name, of so many triangles.
    pub(super) fn add_model(&mut self, name: &str, repeated: u64, triangles: usize) {
        if repeated > 0 {
            self.lines.push(format!(
                "{name}: {repeated} of its {triangles} triangles repeat others: they have the same corners, or cut the \
                    same quadrangle along its other diagonal; delete them where the model was made (surfaces are lit \
                    on both sides, and need no back of their own)"
            ));
        }
        self.repeated.triangles += repeated;
    }

    /// Takes the count of the whole scene, which `file` says.
    pub(super) fn add_scene(&mut self, file: Option<&Path>, repeated: Repeated) {
        if let (Some(file), 1..) = (file, repeated.across_models) {
            self.lines.push(format!(
                "{}: {} triangles of a model or an instance repeat those of another, in the same place; take one of \
                    the two out, or move it",
                file.display(),
                repeated.across_models
            ));
        }
        self.repeated = repeated;
    }
}

/// Says each of some lines.
pub(super) fn warn_of(lines: &[String]) {
    for line in lines {
        tracing::warn!("{line}");
    }
}

/// Says which maps have relief between micro-vertices. Where N is a built-in scene's own it is as its maker chose, and
/// said with --verbose.
pub(super) fn warn_of_undersampled(maps: &[Undersampled], is_own_n: bool) {
    for map in maps {
        if is_own_n {
            tracing::debug!("{map}");
        } else {
            tracing::warn!("{map}");
        }
    }
}

/// Says why a picture shows nothing, where that was found. The picture is there: that it could not be found out is no
/// failure.
pub(super) fn warn_of_useless(
    backend: &dyn Backend,
    found: Result<Findings, BackendError>,
) -> Option<Useless> {
    let found = found.inspect_err(|error| {
        tracing::warn!("{} did not tell whether the picture shows anything ({error})", backend.device().name);
    });
    let useless = found.ok().and_then(|findings| findings.useless);
    if let Some(useless) = &useless {
        tracing::warn!("{useless}");
    }
    useless
}

//! What a user should know of a picture that nothing is wrong with for the program: relief that falls between
//! micro-vertices, faces that are there twice, a picture that shows nothing.
//!
//! Each is a value here, and a line where a command says it. None of them is an error: the picture is what was asked
//! for.

mod crossings;
mod picture;
mod repeated;
mod undersampled;

pub use picture::{DarkLight, Findings, Ground, Useless, Whereabouts, useless};
pub use repeated::{Repeated, repeated_in, repeated_triangles};
pub use undersampled::{Undersampled, undersampled};

use crate::backend::Backend;
use crate::render::{RenderError, Scene, load, prepare, render};
use crate::settings::Settings;
use serde::Serialize;
use std::ops::ControlFlow;

/// All of it, of one picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Reports {
    /// Triangles that lie on others.
    pub repeated: Repeated,
    /// Height maps of which texels fall between micro-vertices, each once.
    pub undersampled: Vec<Undersampled>,
    /// Why the picture shows nothing, where that is so.
    pub useless: Option<Useless>,
}

impl Reports {
    /// The reports of a scene as `settings` look at it, by a picture of one sample a pixel.
    ///
    /// # Errors
    /// [`RenderError`], as rendering it would end.
    pub fn of(backend: &mut dyn Backend, scene: Scene, settings: &Settings) -> Result<Reports, RenderError> {
        let repeated = repeated_in(&scene);
        let mut job = prepare(scene, settings)?;
        load(backend, &mut job)?;
        let mut goes_on = || ControlFlow::Continue(());
        let pixels = render(backend, &job, 1, &mut |_| goes_on())?.picture.pixels;
        let findings = useless(backend, &job, &Ground::of_job(&job), &pixels, 1, &mut goes_on)?;
        Ok(Reports { repeated, undersampled: undersampled(&job), useless: findings.useless })
    }
}

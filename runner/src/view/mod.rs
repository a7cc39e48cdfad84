//! The viewer: a window in which a model is looked at from all sides, and its relief is tuned.
//!
//! Two threads. The main one has the window: it hears the user (`input`, `controls`), keeps the camera and the
//! settings (`state`, `camera`, `tuning`), puts text over the newest picture (`overlay`) and shows it (`present`). It
//! never waits for the other, which renders (`renderer`): passes of a sample each over all pixels, begun anew whenever
//! something changes, at first with fewer pixels so that there is something to see at once. `reload` watches the files,
//! and reads them on a thread of its own.
//!
//! What is shown is what `emboss render` renders with the same arguments, to the bit: cameras go through the same
//! [framing](crate::framing::frame), and scenes through the same [preparation](crate::render::prepare).

mod app;
mod camera;
mod canvas;
mod controls;
mod input;
mod overlay;
mod present;
mod reload;
mod renderer;
mod screen;
mod script;
mod state;
mod tuning;
mod zeros;

pub use script::{Script, ScriptError};
pub use tuning::{Pose, Tuning};

use crate::backend::BackendError;
use crate::backend::select::BackendChoice;
use crate::picture::Destination;
use crate::render::{RenderError, Scene};
use crate::settings::Settings;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Where the scene comes from, and how to ask for its picture again.
pub trait Source: Send + Sync {
    /// Reads the model and its maps as they are now. `zero` is the tuned one, which also stands for texels that are no
    /// numbers.
    ///
    /// # Errors
    /// What is wrong with them.
    fn read(&self, zero: Option<f32>) -> Result<Loaded, Unread>;

    /// The command line that makes the picture of `shot`.
    fn command(&self, shot: &Shot<'_>) -> String;
}

/// What a [`Source`] gives.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The model.
    pub scene: Scene,
    /// How it is looked at before anything is tuned. The size is that of the window at first.
    pub settings: Settings,
    /// Whether any material has a height map.
    pub is_displaced: bool,
    /// What the scales of the reliefs are still to be multiplied by, as `--exaggerate` says.
    pub exaggeration: f32,
    /// The scale of all height maps before that, where it is one.
    pub scale: Option<f32>,
    /// Whether N is what a built-in scene brings, as its maker chose.
    pub has_own_subdivisions: bool,
    /// The files that it was read from, and those that it would be if they were there. Libraries of an OBJ lie beside
    /// it.
    pub files: Vec<PathBuf>,
}

/// A scene could not be read.
#[derive(Debug, thiserror::Error)]
#[error("{error}")]
pub struct Unread {
    /// What is wrong.
    pub error: Box<dyn Error + Send + Sync>,
    /// The file that it is wrong with, which may be one that the scene names only now.
    pub file: Option<PathBuf>,
}

/// What renders, by the names that `--backend` and `--device` take.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Engine {
    /// Not [`BackendChoice::Auto`].
    pub backend: BackendChoice,
    /// Which Vulkan device; `None` of the CPU.
    pub device: Option<String>,
}

impl Engine {
    const CPU: Engine = Engine { backend: BackendChoice::Cpu, device: None };
}

/// A picture that could be rendered.
#[derive(Clone, Copy, Debug)]
pub struct Shot<'a> {
    /// What differs from the scene as it was loaded.
    pub tuning: &'a Tuning,
    /// The lights, the tuned one among them.
    pub lights: &'a [crate::settings::Light],
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// Samples of a pixel.
    pub samples: u32,
    /// What renders it.
    pub engine: &'a Engine,
    /// Where it is saved; `None` of one that is not.
    pub output: Option<&'a Path>,
}

/// What the viewer is asked for beside the scene.
#[derive(Clone, Debug)]
pub struct Options {
    /// What the window is called.
    pub title: String,
    /// Width and height of the window in pixels.
    pub size: (u32, u32),
    /// After how many samples of a pixel the picture is left as it is.
    pub samples: u32,
    /// What renders.
    pub backend: BackendChoice,
    /// The Vulkan device, by number or name.
    pub device: Option<String>,
    /// Whether the validation layers look on.
    pub validate: bool,
    /// Whether pictures are shown by a swapchain also where the device is software.
    pub by_swapchain: bool,
    /// Where pictures are saved: beside what is there already, with numbers.
    pub output: Destination,
    /// What is done in place of a user.
    pub script: Option<Script>,
    /// When the program was started.
    pub start: Instant,
}

/// Why the viewer ended.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ViewError {
    /// No window can be opened.
    #[error("there is no display to open a window on ({reason}); `emboss render` makes pictures without one")]
    NoDisplay {
        /// What the system said.
        reason: String,
    },
    /// There is no Vulkan device that renders.
    #[error("{source}; `emboss render` needs no window, and no Vulkan either with --backend cpu")]
    NoDevice {
        /// What is missing.
        source: BackendError,
    },
    /// The window's system failed.
    #[error("the window failed: {reason}; `emboss render` makes pictures without one")]
    Window {
        /// What it said.
        reason: String,
    },
    /// A script waits for what does not come.
    #[error("the script waits in vain for: {step}")]
    Stuck {
        /// The step.
        step: String,
    },
    /// The scene cannot be read.
    #[error("{0}")]
    Source(Unread),
    /// The scene cannot be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The renderer has ended while the window was open. So that nothing is lost, the message holds what was seen last.
    #[error("{failure}\nWhat was seen last is rendered again by: {command}")]
    Lost {
        /// What happened.
        failure: Failure,
        /// The command line of what was seen.
        command: String,
    },
}

/// Why a renderer ends that was not told to.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Failure {
    /// The device failed.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// A panic.
    #[error("the renderer ended by a defect of the program ({what}); please report it")]
    Defect {
        /// What the panic said.
        what: String,
    },
}

impl From<BackendError> for ViewError {
    fn from(error: BackendError) -> Self {
        ViewError::Render(error.into())
    }
}

/// Opens the window and stays until it is closed.
///
/// # Errors
/// [`ViewError::NoDisplay`] and [`ViewError::NoDevice`] where there is nothing to show pictures on or by; else what the
/// scene, the device or the window failed with.
pub fn run(source: Box<dyn Source>, options: Options) -> Result<(), ViewError> {
    app::run(source.into(), options)
}

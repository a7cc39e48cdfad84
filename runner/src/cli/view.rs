//! `emboss view`.

use super::values::OrDefault;
use super::{CliError, RenderArgs};
use crate::settings::{Light, Method};
use crate::view::{Loaded, Options, Pose, Script, Shot, Source, run};
use std::error::Error;
use std::path::PathBuf;

/// Samples of a pixel after which a picture is as good as it gets: noise is 1/64 of that of one sample.
const MOST_SAMPLES: u32 = 4096;

/// Takes the arguments of `emboss render`. The picture is refined up to --samples; P saves it as --output, C copies the
/// command line that renders it again.
#[derive(Debug, clap::Args)]
pub(super) struct ViewArgs {
    #[command(flatten)]
    pub(super) render: RenderArgs,
    /// Inputs and waits in place of a user: see `Script`
    #[arg(long, value_name = "FILE", hide = true)]
    script: Option<PathBuf>,
}

impl ViewArgs {
    pub(super) fn run(self) -> Result<(), CliError> {
        let mut args = self.render;
        if args.stats.is_some() {
            return Err(CliError::StatsOfView);
        }
        args.check_device()?;
        args.check_quality()?;
        let output = args.destination()?;
        output.check()?;
        if args.quality.is_some() {
            let (settings, inputs, _) = args.read()?;
            args.choose_quality(args.open_backend()?.as_mut(), &inputs.scene, &settings, None)?;
        }
        let script = self.script.as_deref().map(Script::read).transpose()?;
        // A scene file says how large the window is.
        let model = args.model.clone().unwrap_or_default();
        let scene_file = args.scene_file(&model)?;
        let settings = args.settings(scene_file.as_ref());
        let options = Options {
            title: format!("{} - emboss", model.name()),
            size: (settings.width, settings.height),
            samples: args.samples.unwrap_or(MOST_SAMPLES),
            backend: args.backend,
            device: args.device.clone(),
            validate: args.validate,
            output,
            script,
        };
        Ok(run(Box::new(Files { args }), options)?)
    }
}

/// What the arguments name.
struct Files {
    args: RenderArgs,
}

impl Source for Files {
    fn read(&self, zero: Option<f32>) -> Result<Loaded, Box<dyn Error + Send + Sync>> {
        let zero = zero.map(OrDefault::Given).or(self.args.zero);
        let (settings, inputs, _) = RenderArgs { zero, ..self.args.clone() }.read()?;
        let (scale, zero, mut files) = (inputs.scale, inputs.zero, inputs.files);
        files.extend(self.args.normal_map.clone());
        Ok(Loaded { scene: inputs.scene, settings, scale, zero, files })
    }

    fn command(&self, shot: &Shot<'_>) -> String {
        tuned(&self.args, shot).command_line()
    }
}

/// The arguments of a shot.
fn tuned(args: &RenderArgs, shot: &Shot<'_>) -> RenderArgs {
    let tuning = shot.tuning;
    let mut args = RenderArgs { size: Some(shot.size), samples: Some(shot.samples), ..args.clone() };
    if let Some(Pose { eye, target, up, fov }) = tuning.pose {
        (args.eye, args.target, args.up, args.fov) = (Some(eye), Some(target), Some(up), Some(fov));
    }
    if let Some(factor) = tuning.exaggeration {
        match shot.scale {
            Some(scale) => {
                // What was exaggerated before is part of the scale.
                args.scale = Some(OrDefault::Given(scale * factor));
                args.exaggerate = None;
            }
            None => args.exaggerate = Some(args.exaggerate.unwrap_or(1.0) * factor),
        }
    }
    let given = |value| OrDefault::Given(value);
    args.zero = tuning.zero.map(given).or(args.zero);
    args.subdivisions = tuning.subdivisions.map(OrDefault::Given).or(args.subdivisions);
    args.method = tuning.method.or(args.method);
    if args.method.is_some_and(|method| method != Method::NormalMap) {
        (args.normal_map, args.normal_space) = (None, None);
    }
    args.shade = tuning.shade.or(args.shade);
    args.smooth = tuning.smooth.or(args.smooth);
    if tuning.shadows.is_some() {
        (args.shadows, args.no_shadows) = (tuning.shadows, false);
    }
    args.wrap = tuning.wrap.or(args.wrap);
    if tuning.light.is_some() {
        args.lights = Vec::<Light>::from(shot.lights);
    }
    args
}

//! `emboss view`.

use super::CliError;
use super::arguments::RenderArgs;
use super::reports::warn_of;
use super::values::OrDefault;
use crate::settings::{Light, Method};
use crate::view::{Engine, Loaded, Options, Pose, Script, Shot, Source, Unread, run};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

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
    /// Shows pictures as hardware does, also where the device is software
    #[arg(long, hide = true)]
    by_swapchain: bool,
}

impl ViewArgs {
    pub(super) fn run(self) -> Result<(), CliError> {
        let start = Instant::now();
        let mut args = self.render;
        if args.stats.is_some() {
            return Err(CliError::StatsOfView);
        }
        args.check_device()?;
        args.check_quality()?;
        let output = args.destination()?;
        output.check()?;
        if args.quality.is_some() {
            let (settings, inputs, _) = args.read(false)?;
            args.choose_quality(args.open_backend()?.as_mut(), &inputs.scene, &settings, None, None)?;
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
            by_swapchain: self.by_swapchain,
            output,
            script,
            start,
        };
        Ok(run(Box::new(Files { args, said: Mutex::default() }), options)?)
    }
}

/// What the arguments name.
struct Files {
    args: RenderArgs,
    /// What was said last of faces that are there twice: a file that is read again says it again only where it differs.
    said: Mutex<Vec<String>>,
}

impl Source for Files {
    fn read(&self, zero: Option<f32>) -> Result<Loaded, Unread> {
        let zero = zero.map(OrDefault::Given).or(self.args.zero);
        // The scales are left as they are: the viewer multiplies them as this command line would.
        let args = RenderArgs { zero, exaggerate: None, ..self.args.clone() };
        // A normal map that only another method reads is no reason to show nothing.
        let read = args.read(true).or_else(|error| {
            args.read(false)
                .inspect(|_| tracing::warn!("{error}; --method normal-map reads the height map instead"))
        });
        let (settings, inputs, _) = read.map_err(|error| {
            let file = error.file().map(Path::to_owned);
            Unread { error: error.into(), file }
        })?;
        args.check_own_maps(settings.method).map_err(|error| Unread { error: error.into(), file: None })?;
        {
            let mut said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
            if *said != inputs.repeated.lines {
                warn_of(&inputs.repeated.lines);
                *said = inputs.repeated.lines;
            }
        }
        let mut files = inputs.files;
        // They may come.
        files.extend(inputs.missing);
        files.extend(self.args.normal_map.iter().chain(&self.args.offset_map).cloned());
        Ok(Loaded {
            scene: inputs.scene,
            settings,
            is_displaced: inputs.is_displaced,
            exaggeration: self.args.exaggerate.unwrap_or(1.0),
            scale: inputs.scale,
            has_own_subdivisions: inputs.has_own_subdivisions,
            files,
        })
    }

    fn command(&self, shot: &Shot<'_>) -> String {
        tuned(&self.args, shot).command_line()
    }
}

/// The arguments of a shot.
fn tuned(args: &RenderArgs, shot: &Shot<'_>) -> RenderArgs {
    let tuning = shot.tuning;
    let Engine { backend, device } = shot.engine.clone();
    let mut args =
        RenderArgs { size: Some(shot.size), samples: Some(shot.samples), backend, device, ..args.clone() };
    if let Some(output) = shot.output {
        args.output = output.to_owned();
    }
    if let Some(Pose { eye, target, up, fov }) = tuning.pose {
        (args.eye, args.target, args.up, args.fov) = (Some(eye), Some(target), Some(up), Some(fov));
    }
    args.exaggerate = tuning.exaggeration.or(args.exaggerate);
    args.zero = tuning.zero.map(OrDefault::Given).or(args.zero);
    args.subdivisions = tuning.subdivisions.map(OrDefault::Given).or(args.subdivisions);
    args.method = tuning.method.or(args.method);
    if args.method.is_some_and(|method| method != Method::NormalMap) {
        (args.normal_map, args.normal_space) = (None, None);
    }
    if args.method.is_some_and(|method| method != Method::BumpOffset) {
        args.offset_map = None;
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

#[cfg(test)]
mod tests {
    use super::super::{Cli, Command};
    use super::*;
    use crate::backend::select::BackendChoice;
    use crate::view::Tuning;
    use clap::Parser;

    fn command(given: &str, tuning: &Tuning, engine: &Engine, output: Option<&Path>) -> String {
        let cli = Cli::try_parse_from(given.split_whitespace()).expect("valid");
        let Command::View(view) = cli.command else { panic!("not view") };
        let shot = Shot { tuning, lights: &[], size: (3, 5), samples: 7, engine, output };
        tuned(&view.render, &shot).command_line()
    }

    /// What `auto` took is said, so that the picture is the same elsewhere, or there is an error.
    #[test]
    fn command_names_what_renders() {
        let view = |engine: &Engine| command("emboss view", &Tuning::default(), engine, None);
        let cpu = Engine { backend: BackendChoice::Cpu, device: None };
        let card = Engine { backend: BackendChoice::Vulkan, device: Some("Card 4".to_owned()) };
        let line =
            |engine: &str| format!("emboss render --output emboss.png --size 3x5 --samples 7 {engine}");
        assert_eq!(view(&cpu), line("--backend cpu"));
        assert_eq!(view(&card), line("--backend vulkan --device 'Card 4'"));
    }

    /// Run again it makes the picture that it is in, and no other is lost.
    #[test]
    fn command_writes_what_it_was_saved_as() {
        let cpu = Engine { backend: BackendChoice::Cpu, device: None };
        let saved = Some(Path::new("a-1.png"));
        let line = command("emboss view --output a.png", &Tuning::default(), &cpu, saved);
        assert!(line.contains("--output a-1.png") && !line.contains(" a.png"), "{line}");
    }

    /// The scale itself stays: the product would be rounded in another order.
    #[test]
    fn command_multiplies_as_the_viewer_does() {
        let cpu = Engine { backend: BackendChoice::Cpu, device: None };
        let tuning = Tuning { exaggeration: Some(0.33), ..Tuning::default() };
        let line = command("emboss view m.obj - - - 0.7 --exaggerate 0.3", &tuning, &cpu, None);
        assert!(line.contains("m.obj - - - 0.7") && line.contains("--exaggerate=0.33"), "{line}");
    }
}

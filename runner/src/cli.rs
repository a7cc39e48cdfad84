//! The command line: what can be asked, what stands in for what is not, and what is said about it.
//!
//! Results go to standard output, messages and the progress bar to standard error. Exit codes: 0 done, 1 failed,
//! 2 wrong usage, 130 interrupted (the picture so far is written where there is one).

mod bench;
mod command_line;
mod compare;
mod error;
mod inputs;
mod interrupt;
mod progress;
mod quality;
mod values;
mod view;

use crate::backend::select::{BackendChoice, devices, open_backend};
use crate::backend::{Backend, DeviceInfo, DeviceKind};
use crate::framing::View;
use crate::normal_maps::{NormalMap, NormalSpace, OffsetMap};
use crate::picture::{Destination, PictureFormat};
use crate::render::{Cuts, Rendering, check_memory, load, prepare, render};
use crate::scene::scene_file::SceneFile;
use crate::settings::{
    ChannelOrder, DisplacementKind, Filter, Light, Method, Normals, Settings, Shade, Subdivisions, Weld, Wrap,
};
use crate::stats::{SettingsUsed, Stats};
use clap::Parser;
use emboss_kernels::interface::counter;
use error::CliError;
use glam::Vec3;
use inputs::{Inputs, MapArgument, ModelArgument};
use interrupt::Interrupt;
use std::ffi::OsString;
use std::io::{IsTerminal, Write};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::process::ExitCode;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::EnvFilter;

/// Samples of a pixel unless said otherwise.
const SAMPLES: u32 = 4;

/// Ray tracer for displacement-mapped triangle meshes that never tessellates them
#[derive(Debug, Parser)]
#[command(name = "emboss", version)]
#[command(after_help = "Without a command, emboss renders builtin:knot to emboss.png.")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Render a model to a picture
    Render(Box<RenderArgs>),
    /// Look at a model from all sides and tune its relief
    View(Box<view::ViewArgs>),
    /// Measure what each method costs on a model, and what it gets wrong
    Compare(Box<compare::CompareArgs>),
    /// Write docs/METHODS.md to standard output, from the folders of comparisons
    #[command(hide = true)]
    Methods {
        /// Folders that `emboss compare` wrote
        #[arg(required = true)]
        folders: Vec<PathBuf>,
    },
    /// List what can render
    Devices,
    /// Measure how fast this machine is
    Bench {
        #[command(subcommand)]
        bench: bench::Bench,
    },
}

/// The first six arguments may be left out from the end; `-` stands for one that is left out before another. What
/// stands in for them is printed.
#[derive(Clone, Debug, clap::Args)]
struct RenderArgs {
    /// OBJ file, scene file (.toml, see docs/SCENE.md), or builtin:knot, builtin:cube, builtin:quilt,
    /// builtin:mushroom [default: builtin:knot]
    #[arg(value_parser = values::model())]
    model: Option<ModelArgument>,
    /// Colour map, or none [default: the built-in's, or the map_Kd of the OBJ's materials, their norm, their Kd; else
    /// light grey]
    #[arg(value_parser = values::map())]
    color: Option<MapArgument>,
    /// Height map, or none; colour images count by their luminance. With --displacement a vector map [default: the
    /// built-in's, or the disp, map_disp or bump of the OBJ's materials, else none]
    #[arg(value_parser = values::map())]
    height: Option<MapArgument>,
    /// Texel value of no displacement: 0 black, 0.5 mid-grey, 1 white [default: the built-in's, or what a
    /// material's -mm says, else 0.5; of a vector map of floats 0]
    #[arg(value_parser = values::finite_or_default, allow_negative_numbers = true)]
    zero: Option<values::OrDefault<f32>>,
    /// Height from black to white, in model units, may be negative [default: the built-in's, or what a material's -mm
    /// says, else 5 % of the diagonal of the model's box]
    #[arg(value_parser = values::finite_or_default, allow_negative_numbers = true)]
    scale: Option<values::OrDefault<f32>>,
    /// Subdivisions: parts of each triangle's side, 1 to 4096; or auto, auto:PIXELS: as many as leave micro-triangles a
    /// pixel, or PIXELS (0.1 to 64), from where the camera is [default: the built-in's, else 16]
    #[arg(value_name = "N", value_parser = values::subdivisions_or_default)]
    subdivisions: Option<values::OrDefault<Subdivisions>>,

    /// Picture to write: .png, or .exr (linear floats, premultiplied)
    #[arg(short, long, value_name = "FILE", default_value = "emboss.png")]
    output: PathBuf,
    /// Bits a channel of a PNG: 8 or 16 [default: 8]
    #[arg(long, value_name = "BITS", value_parser = values::png_format)]
    depth: Option<PictureFormat>,
    /// Size of the picture in pixels [default: 960x720]
    #[arg(long, value_name = "WxH", value_parser = values::size)]
    size: Option<(u32, u32)>,
    /// Samples of each pixel [default: 4]
    #[arg(long, value_name = "COUNT", value_parser = values::samples)]
    samples: Option<u32>,
    /// How displaced triangles are intersected [default: quadtree]
    #[arg(long, value_enum)]
    method: Option<Method>,
    /// Normal map that --method normal-map reads: red, green and blue from 0 to 1 are components from -1 to 1, green
    /// upwards [default: what each material's norm names, else one made from the height map]
    #[arg(long, value_name = "FILE")]
    normal_map: Option<PathBuf>,
    /// What the normal map's components are along [default: tangent]
    #[arg(long, value_enum, value_name = "SPACE", requires = "normal_map")]
    normal_space: Option<NormalSpace>,
    /// Offset map that --method bump-offset reads: red and green are by how much heights, in parts of SCALE, grow
    /// from one texel to the next, to the right and upwards; floats as they are, of integers mid-grey is 0 and white
    /// 1 [default: one made from the height map]
    #[arg(long, value_name = "FILE")]
    offset_map: Option<PathBuf>,
    /// Choose the quickest method and N whose error on this model, measured on a small picture, is within a budget:
    /// mean FLIP from 0 (exact) to 1 (nothing alike); 0.02 is hard to see
    #[arg(long, value_name = "BUDGET", value_parser = values::flip)]
    quality: Option<f32>,
    /// Direction in which heights are measured [default: normalized]
    #[arg(long, value_enum)]
    normals: Option<Normals>,
    /// What becomes of edges where neighbours disagree on normals or texture coordinates [default: on]
    #[arg(long, value_enum)]
    weld: Option<Weld>,
    /// What pixels show [default: lit]
    #[arg(long, value_enum)]
    shade: Option<Shade>,
    /// Light the surface by normals of its own instead of its micro-triangles': a small N shades like a large one
    #[arg(
        long,
        value_name = "on|off",
        value_parser = values::switch,
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "on"
    )]
    smooth: Option<bool>,
    /// What renders: auto takes a graphics card, else the CPU
    #[arg(long, value_enum, default_value_t = BackendChoice::Auto)]
    backend: BackendChoice,
    /// The Vulkan device to use, by its number or a part of its name as `emboss devices` lists them
    #[arg(long, value_name = "DEVICE")]
    device: Option<String>,
    /// Camera [default: sees the whole model]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    eye: Option<Vec3>,
    /// Middle of the picture [default: the middle of the model]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    target: Option<Vec3>,
    /// Direction that is up in the picture [default: 0,1,0]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    up: Option<Vec3>,
    /// Angle between the picture's upper and lower edge, in degrees [default: 35]
    #[arg(long, value_name = "DEGREES", value_parser = values::fov)]
    fov: Option<f32>,
    /// Point light: position, linear colour (white), intensity (irradiance times squared distance; as much as makes
    /// white look white in the middle of the picture). May be repeated [default: the built-in's, else one over the
    /// viewer's left shoulder]
    #[arg(
        long = "light",
        value_name = "X,Y,Z[:R,G,B[:I]]",
        value_parser = values::light,
        allow_hyphen_values = true
    )]
    lights: Vec<Light>,
    /// Whether lights cast shadows [default: on]
    #[arg(long, value_name = "on|off", value_parser = values::switch)]
    shadows: Option<bool>,
    /// The same as --shadows off
    #[arg(long, conflicts_with = "shadows")]
    no_shadows: bool,
    /// Multiply all heights by this
    #[arg(long, value_name = "FACTOR", value_parser = values::finite, allow_negative_numbers = true)]
    exaggerate: Option<f32>,
    /// What the height map's texels displace along: heights, or vectors in tangent or in object space [default: the
    /// built-in's, else height]
    #[arg(long, value_enum, value_name = "KIND")]
    displacement: Option<DisplacementKind>,
    /// Which channels of a vector map are along tangent, bitangent and normal, or along x, y and z: blender, mudbox,
    /// zbrush, or three of them with their signs, as +r+b-g [default: blender; in object space +r+g+b]
    #[arg(long, value_name = "ORDER", allow_hyphen_values = true)]
    channels: Option<ChannelOrder>,
    /// How all maps are read outside [0,1) [default: as their materials say, else repeat]
    #[arg(long, value_enum)]
    wrap: Option<Wrap>,
    /// How colour maps are read [default: bilinear]
    #[arg(long, value_enum)]
    filter: Option<Filter>,
    /// Keep nothing beside the maps, and read nothing kept there: --method sphere computes its distance maps each time
    #[arg(long)]
    no_cache: bool,
    /// Turn the height map upside down: white is low
    #[arg(long)]
    invert: bool,
    /// Seed of the random numbers: the same seed gives the same picture [default: 0]
    #[arg(long)]
    seed: Option<u32>,
    /// Write statistics as JSON; counting them takes a little time
    #[arg(long, value_name = "FILE")]
    stats: Option<PathBuf>,
    /// Check every Vulkan call with the validation layers, which have to be installed
    #[arg(long)]
    validate: bool,
    /// Fill the background with a colour: sRGB values from 0 to 1, as an image editor shows them divided by 255
    /// [default: transparent]
    #[arg(long, value_name = "R,G,B", value_parser = values::background, allow_hyphen_values = true)]
    background: Option<Vec3>,
    /// Light that reaches every point, as a share of full light [default: 0.1]
    #[arg(long, value_name = "SHARE", value_parser = values::not_negative)]
    ambient: Option<f32>,
    /// Say nothing but errors
    #[arg(short, long, conflicts_with = "verbose")]
    quiet: bool,
    /// Say more
    #[arg(short, long)]
    verbose: bool,
}

/// Runs the program with the process's arguments.
pub fn run() -> ExitCode {
    match Cli::try_parse_from(with_command(std::env::args_os().collect())) {
        Ok(cli) => finish(cli.command.run()),
        Err(usage) => {
            // Help and version come as errors too, with the code 0. A closed pipe is no reason to fail.
            let _ = usage.print();
            ExitCode::from(u8::try_from(usage.exit_code()).unwrap_or(2))
        }
    }
}

/// The arguments, with `render` as the command where there are none.
fn with_command(mut arguments: Vec<OsString>) -> Vec<OsString> {
    if arguments.len() < 2 {
        arguments.resize(1, "emboss".into());
        arguments.push("render".into());
    }
    arguments
}

/// Reports an error and turns the result into an exit code.
fn finish(result: Result<(), CliError>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}

impl Command {
    fn run(self) -> Result<(), CliError> {
        match self {
            Command::Render(args) => {
                start_log(args.log_level());
                args.run()
            }
            Command::View(args) => {
                start_log(args.render.log_level());
                args.run()
            }
            Command::Compare(args) => {
                start_log(args.render.log_level());
                args.run()
            }
            Command::Methods { folders } => compare::describe_methods(&folders),
            Command::Devices => {
                start_log(LevelFilter::INFO);
                list_devices();
                Ok(())
            }
            Command::Bench { bench } => {
                start_log(LevelFilter::INFO);
                bench.run()
            }
        }
    }
}

/// Sends messages of a level or above to standard error. Those of libraries are about their own business.
fn start_log(level: LevelFilter) {
    let log = tracing_subscriber::fmt()
        .with_env_filter(EnvFilter::new(format!("off,emboss={level}")))
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .without_time();
    // Only a second call could fail, and there is none.
    let _ = log.try_init();
}

/// Prints a line to standard output. A reader that has gone away (`emboss devices | head -1`) is no failure.
fn say(line: impl std::fmt::Display) {
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// One line a device; the number is what `--device` takes.
fn list_devices() {
    let mut vulkan = 0_u32..;
    for device in devices() {
        let number = if device.backend == "vulkan" { vulkan.next() } else { None };
        let number = number.map_or_else(String::new, |number| number.to_string());
        say(format_args!("{:<8}{number:<3}{}", device.backend, description(&device)));
    }
}

/// What a user is told of a device.
fn description(DeviceInfo { name, kind, details, .. }: &DeviceInfo) -> String {
    format!("{name} ({}, {details})", kind_name(*kind))
}

fn kind_name(kind: DeviceKind) -> &'static str {
    match kind {
        DeviceKind::Discrete => "graphics card",
        DeviceKind::Integrated => "integrated graphics",
        DeviceKind::Virtual => "virtual graphics",
        DeviceKind::Software => "software",
        DeviceKind::Cpu => "processor",
    }
}

impl RenderArgs {
    /// Renders: first everything that can be refused quickly, then the work.
    fn run(mut self) -> Result<(), CliError> {
        self.check_quality()?;
        if let Some(method) = self.method {
            self.check_own_maps(method)?;
        }
        let destination = self.destination()?;
        destination.check()?;
        if let Some(path) = &self.stats {
            if *path == destination.path {
                return Err(CliError::StatsOverPicture(path.clone()));
            }
            Stats::check(path)?;
        }
        let interrupt = Interrupt::install();
        let mut backend = self.open_backend()?;
        let (mut settings, mut inputs, samples) = self.read(false)?;
        let wanted = Some(samples);
        if self.choose_quality(backend.as_mut(), &inputs.scene, &settings, wanted, Some(&interrupt))? {
            (settings, inputs, _) = self.read(false)?;
        }
        self.check_own_maps(settings.method)?;
        self.report(&inputs);
        let scene = inputs.scene;
        let used = SettingsUsed::new(&settings, samples, &scene);
        let mut job = prepare(scene, &settings)?;
        load(backend.as_mut(), &mut job)?;
        let build = backend.build_report();
        tracing::debug!("BVH of {} nodes built in {:.1?}", build.nodes, build.duration);
        if build.left_out > 0 {
            tracing::warn!(
                "{} triangles have no finite box, or one too far away, and are left out",
                build.left_out
            );
        }
        if interrupt.requested() {
            return Err(CliError::InterruptedEarly);
        }

        tracing::debug!("rendering on {}", backend.device().name);
        let bar = progress::bar(self.quiet);
        let rendering = render(backend.as_mut(), &job, samples, &mut |share| {
            bar.set_position(progress::position(f64::from(share)));
            if interrupt.requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        bar.finish_and_clear();
        let rendering =
            rendering.map_err(|source| CliError::Unfinished { source, path: destination.path.clone() })?;

        warn_of_caps(&rendering);
        destination.write(&rendering.picture, &self.command_line())?;
        if let Some(path) = &self.stats {
            Stats::new(&job, &rendering, backend.as_ref(), used).write(path)?;
        }
        if rendering.interrupted {
            return Err(CliError::Interrupted(destination.path));
        }
        self.report_done(&destination, &rendering, samples, backend.device());
        if job.features.adaptive != 0 && !self.quiet {
            let Cuts { least, greatest, micro_triangles } = job.cuts();
            say(format_args!("N was {least} to {greatest}: {micro_triangles} micro-triangles"));
        }
        Ok(())
    }

    fn log_level(&self) -> LevelFilter {
        match (self.quiet, self.verbose) {
            (true, _) => LevelFilter::ERROR,
            (_, true) => LevelFilter::DEBUG,
            _ => LevelFilter::INFO,
        }
    }

    fn destination(&self) -> Result<Destination, CliError> {
        let mut destination = Destination::new(self.output.clone())?;
        match (self.depth, destination.format) {
            (Some(_), PictureFormat::Exr) => return Err(CliError::DepthWithoutPng(destination.path)),
            (Some(format), _) => destination.format = format,
            (None, _) => {}
        }
        Ok(destination)
    }

    /// What is to be rendered, how, and with how many samples a pixel. `by_any_method`: with the maps of all methods,
    /// not of the one alone that is asked for.
    fn read(&self, by_any_method: bool) -> Result<(Settings, Inputs, u32), CliError> {
        let model = self.model.clone().unwrap_or_default();
        let scene_file = self.scene_file(&model)?;
        let mut settings = self.settings(scene_file.as_ref());
        let samples = self.samples.or(scene_file.as_ref().and_then(|scene| scene.samples)).unwrap_or(SAMPLES);
        check_memory(&settings)?;
        if let Some(path) = &self.normal_map {
            settings.normal_map = Some(NormalMap::load(path, self.normal_space.unwrap_or_default(), None)?);
        }
        settings.offset_map = self.offset_map.as_deref().map(OffsetMap::load).transpose()?;
        let reads_normals = by_any_method || self.quality.is_some() || settings.method == Method::NormalMap;
        let inputs = self.inputs(&model, scene_file.as_ref(), &mut settings, reads_normals)?;
        Ok((settings, inputs, samples))
    }

    /// Refuses maps of normals and of offsets that nothing reads.
    fn check_own_maps(&self, method: Method) -> Result<(), CliError> {
        if self.normal_map.is_some() && method != Method::NormalMap {
            return Err(CliError::NormalMapOfNothing(method));
        } else if self.offset_map.is_some() && method != Method::BumpOffset {
            return Err(CliError::OffsetMapOfNothing(method));
        }
        Ok(())
    }

    fn scene_file(&self, model: &ModelArgument) -> Result<Option<SceneFile>, CliError> {
        Ok(match model {
            ModelArgument::Scene(path) => Some(SceneFile::read(path)?),
            _ => None,
        })
    }

    /// What is given here, else what a scene file says, else the defaults.
    fn settings(&self, scene_file: Option<&SceneFile>) -> Settings {
        let base = scene_file.map(SceneFile::settings).unwrap_or_default();
        let (width, height) = self.size.unwrap_or((base.width, base.height));
        let view = View {
            eye: self.eye.or(base.view.eye),
            target: self.target.or(base.view.target),
            up: self.up.or(base.view.up),
            fov: self.fov.unwrap_or(base.view.fov),
            ..base.view
        };
        Settings {
            width,
            height,
            method: self.method.unwrap_or(base.method),
            // Read later, since that may fail.
            normal_map: None,
            offset_map: None,
            displacement: self.displacement.unwrap_or(base.displacement),
            adaptive: base.adaptive,
            normals: self.normals.unwrap_or(base.normals),
            weld: self.weld.unwrap_or(base.weld),
            shade: self.shade.unwrap_or(base.shade),
            smooth: self.smooth.unwrap_or(base.smooth),
            shadows: self.shadows.unwrap_or(base.shadows && !self.no_shadows),
            wrap: self.wrap.unwrap_or(base.wrap),
            filter: self.filter.unwrap_or(base.filter),
            view,
            lights: if self.lights.is_empty() { base.lights } else { self.lights.clone() },
            ambient: self.ambient.unwrap_or(base.ambient),
            background: self.background.or(base.background),
            seed: self.seed.unwrap_or(base.seed),
            counting: self.stats.is_some(),
        }
    }

    fn check_device(&self) -> Result<(), CliError> {
        if self.backend == BackendChoice::Cpu && self.device.is_some() {
            return Err(CliError::DeviceWithCpu);
        }
        Ok(())
    }

    fn open_backend(&self) -> Result<Box<dyn Backend>, CliError> {
        self.check_device()?;
        Ok(open_backend(self.backend, self.device.as_deref(), self.validate)?)
    }

    /// Loads what the six arguments name; a built-in scene also brings its view and its lights.
    fn inputs(
        &self,
        model: &ModelArgument,
        scene: Option<&SceneFile>,
        settings: &mut Settings,
        reads_normals: bool,
    ) -> Result<Inputs, CliError> {
        let inputs = inputs::load(&inputs::Request {
            model,
            scene,
            color: self.color.clone().unwrap_or_default(),
            height: self.height.clone().unwrap_or_default(),
            zero: self.zero.and_then(values::OrDefault::given),
            scale: self.scale.and_then(values::OrDefault::given),
            exaggeration: self.exaggerate.unwrap_or(1.0),
            subdivisions: self.subdivisions.and_then(values::OrDefault::given),
            invert: self.invert,
            normal_map: self.normal_map.as_deref(),
            reads_normals,
            cache: !self.no_cache,
            wrap: self.wrap,
            displacement: self.displacement,
            channels: self.channels,
        })?;
        settings.displacement = inputs.displacement;
        settings.adaptive = inputs.subdivisions.pixels();
        if let Some((from, up)) = inputs.view {
            (settings.view.from, settings.view.usual_up) = (from, up);
        }
        if settings.lights.is_empty() {
            settings.lights.clone_from(&inputs.lights);
        }
        Ok(inputs)
    }

    /// Says what the six arguments are, and what was imported.
    fn report(&self, inputs: &Inputs) {
        if self.quiet {
            return;
        }
        inputs.choices.iter().for_each(say);
        let mesh = &inputs.scene.mesh;
        let dropped = match mesh.dropped {
            0 => String::new(),
            dropped => format!(", left out {dropped} without three different corners"),
        };
        say(format_args!("Imported {} triangles{dropped}", mesh.triangles.len()));
    }

    fn report_done(
        &self,
        destination: &Destination,
        rendering: &Rendering,
        samples: u32,
        device: &DeviceInfo,
    ) {
        if self.quiet {
            return;
        }
        say(format_args!(
            "Wrote {}: {}x{}, {} samples a pixel in {:.2} s on {} ({})",
            destination.path.display(),
            rendering.picture.width,
            rendering.picture.height,
            samples,
            rendering.elapsed.as_secs_f64(),
            device.name,
            device.backend
        ));
    }
}

/// A walk that meets its cap may have missed a hit: never silently.
fn warn_of_caps(rendering: &Rendering) {
    let hits = rendering.totals[counter::CAP_HITS as usize];
    if hits > 0 {
        tracing::warn!(
            "{hits} walks met their cap on steps and may have missed the surface; compare with --method quadtree"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::BackendError;
    use crate::view::ViewError;
    use clap::CommandFactory;

    #[test]
    fn the_definition_is_consistent() {
        Cli::command().debug_assert();
    }

    fn parsed(arguments: &[&str]) -> RenderArgs {
        let arguments = with_command(arguments.iter().map(OsString::from).collect());
        match Cli::try_parse_from(arguments).expect("valid").command {
            Command::Render(args) => *args,
            _ => panic!("not render"),
        }
    }

    #[test]
    fn no_arguments_render_the_default() {
        assert_eq!(parsed(&["emboss"]).output, PathBuf::from("emboss.png"));
        assert!(parsed(&[]).model.is_none());
    }

    #[test]
    fn six_arguments_come_in_their_order() {
        let args = parsed(&["emboss", "render", "frog.obj", "none", "-", "0.25", "-0.5", "8"]);
        assert_eq!(args.model, Some(ModelArgument::File("frog.obj".into())));
        assert_eq!(args.color, Some(MapArgument::None));
        assert_eq!(args.height, Some(MapArgument::Default));
        assert_eq!(args.zero.and_then(values::OrDefault::given), Some(0.25));
        assert_eq!(args.scale.and_then(values::OrDefault::given), Some(-0.5));
        let given = args.subdivisions.and_then(values::OrDefault::given);
        assert_eq!(given, Some(Subdivisions::Fixed(8)));
    }

    #[test]
    fn vectors_may_start_with_a_minus() {
        let args = parsed(&["emboss", "render", "--eye", "-1,2,3", "--light", "-1,0,0:1,1,0:5"]);
        assert_eq!(args.eye, Some(Vec3::new(-1.0, 2.0, 3.0)));
        assert_eq!(args.lights[0].intensity, Some(5.0));
    }

    #[test]
    fn lost_device_is_a_failure_that_tells_the_command() {
        let failure = BackendError::DeviceLost { device: "Card".to_owned(), what: "rendering" }.into();
        let error = CliError::View(ViewError::Lost { failure, command: "emboss render a.obj".to_owned() });
        assert_eq!(error.exit_code(), 1);
        let text = error.to_string();
        assert!(
            text.starts_with("Card was lost") && text.ends_with("again by: emboss render a.obj"),
            "{text}"
        );
    }

    #[test]
    fn depth_belongs_to_png() {
        let depth = |output| parsed(&["emboss", "render", "--depth", "16", "-o", output]).destination();
        assert_eq!(depth("a.png").expect("fits").format, PictureFormat::Png16);
        assert_eq!(depth("a.exr").expect_err("floats").exit_code(), 2);
    }
}

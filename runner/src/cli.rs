//! The command line: what can be asked, what stands in for what is not, and what is said about it.
//!
//! Results go to standard output, messages and the progress bar to standard error. Exit codes: 0 done, 1 failed,
//! 2 wrong usage, 130 interrupted (the picture so far is written where there is one).

mod arguments;
mod bench;
mod command_line;
mod compare;
mod devices;
mod error;
mod inputs;
mod interrupt;
mod progress;
mod quality;
mod render;
mod reports;
mod trace;
mod values;
mod view;

use crate::backend::{DeviceInfo, DeviceKind};
use arguments::RenderArgs;
use clap::Parser;
use error::CliError;
use std::ffi::OsString;
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::EnvFilter;

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
    /// List what can render, or check whether it is exact
    Devices(devices::DevicesArgs),
    /// Measure how fast this machine is
    Bench {
        #[command(subcommand)]
        bench: bench::Bench,
    },
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
            Command::Devices(args) => {
                start_log(LevelFilter::INFO);
                args.run()
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

#[cfg(test)]
mod tests {
    use super::inputs::{MapArgument, ModelArgument};
    use super::*;
    use crate::backend::BackendError;
    use crate::picture::PictureFormat;
    use crate::settings::Subdivisions;
    use crate::view::ViewError;
    use clap::CommandFactory;
    use glam::DVec3;

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
        assert_eq!(args.eye, Some(DVec3::new(-1.0, 2.0, 3.0)));
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

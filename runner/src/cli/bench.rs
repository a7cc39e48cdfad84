//! `emboss bench`: measurements, as tables on standard output.

use super::error::{cannot_write, first_error};
use super::interrupt::Interrupt;
use super::trace::TraceArgs;
use super::{CliError, description, progress, say, values};
use crate::backend::select::devices;
use crate::backend::vulkan::{Selection, VulkanBackend};
use crate::backend::{Backend, DeviceInfo, cpu};
use crate::bench::build::{
    BenchError, DeviceResults, DeviceSubject, HostSubject, Measurement, Phases, measure,
};
use crate::bench::scene;
use crate::stats::{check_file, write_json};
use indicatif::ProgressBar;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Duration;

/// What is measured where no sizes are given.
const SIZES: [u32; 5] = [1_000, 10_000, 100_000, 1_000_000, 10_000_000];

/// What can be measured.
#[derive(Debug, clap::Subcommand)]
pub(super) enum Bench {
    /// How fast a BVH is built, phase by phase
    ///
    /// It is built over the boxes of displaced triangles: 60 spheres of very different sizes and tessellations. The
    /// table shows what each phase took, in milliseconds, in the build whose total is the median. Below each row
    /// stand the bytes that the phases move at least, in MB, and, with --bandwidth, the milliseconds in which memory
    /// of that bandwidth moves them.
    Build(BuildArgs),
    /// What tracing costs: time of a sample, by the device's own clock, and memory
    ///
    /// Takes the arguments of `emboss render`. The table has the first sample, then medians of those after it, in
    /// milliseconds: as asked for; without shadow rays; and without shading, which is intersection alone (and the
    /// film). Then the memory of all but film and colours in MB, and for each primary ray the boxes of the BVH, the
    /// sub-triangles and the micro-triangles that it was tested against.
    Trace(Box<TraceArgs>),
}

/// What builds are measured on where no device is named.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Choice {
    /// Every Vulkan device, and the processor
    All,
    /// Every Vulkan device, or an error where there is none
    Vulkan,
    /// The processor
    Cpu,
}

/// `emboss bench build`.
#[derive(Debug, clap::Args)]
pub(super) struct BuildArgs {
    /// What builds
    #[arg(long, value_enum, default_value_t = Choice::All)]
    backend: Choice,
    /// The only device to measure, a Vulkan one, by its number or a part of its name as `emboss devices` lists them
    #[arg(long, value_name = "DEVICE")]
    device: Option<String>,
    /// Numbers of prisms [default: 1e3, 1e4, 1e5, 1e6 and 1e7]
    #[arg(long, value_name = "COUNT,...", value_delimiter = ',', value_parser = values::primitives)]
    sizes: Vec<u32>,
    /// How long each size is measured, behind a warm-up of 1.5 s; at least five builds are
    #[arg(long, value_name = "SECONDS", default_value = "1", value_parser = values::seconds)]
    time: Duration,
    /// Bandwidth of the device's memory in GB/s, to compare with
    #[arg(long, value_name = "GB/S", value_parser = values::bandwidth)]
    bandwidth: Option<f32>,
    /// Also write the results as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Print no progress
    #[arg(short, long)]
    quiet: bool,
}

impl Bench {
    pub(super) fn run(self) -> Result<(), CliError> {
        match self {
            Bench::Build(args) => args.run(),
            Bench::Trace(args) => args.run(),
        }
    }
}

/// What builds are measured on.
enum Builder {
    Cpu(DeviceInfo),
    Vulkan(Box<VulkanBackend>),
}

impl BuildArgs {
    fn run(self) -> Result<(), CliError> {
        if let Some(path) = &self.json {
            check_file(path).map_err(|reason| cannot_write(path, reason))?;
        }
        let builders = self.builders()?;
        let interrupt = Interrupt::install();
        let bar = progress::bar(self.quiet);
        let mut all = Vec::new();
        let measured = self.measure(builders, &bar, &interrupt, &mut all);
        bar.finish_and_clear();
        // Whatever has ended it: what was measured until then is known. Nothing takes no older file's place.
        let is_any = measured.is_ok() || all.iter().any(|device| !device.sizes.is_empty());
        let written = match &self.json {
            Some(path) if is_any => write_json(path, &all).map_err(|reason| cannot_write(path, reason)),
            _ => Ok(()),
        };
        first_error(measured, written)?;
        if interrupt.requested() { Err(CliError::BenchInterrupted) } else { Ok(()) }
    }

    /// Measures all sizes on all devices, as `all` has them then.
    fn measure(
        &self,
        builders: Vec<Builder>,
        bar: &ProgressBar,
        interrupt: &Interrupt,
        all: &mut Vec<DeviceResults>,
    ) -> Result<(), CliError> {
        let steps = (builders.len() * self.sizes().len()) as f64;
        let mut done = 0.0;
        for mut builder in builders {
            let device = builder.info();
            bar.suspend(|| say_heading(device));
            let results = all.push_mut(DeviceResults::new(device));
            for &count in self.sizes() {
                let watched = |share| {
                    bar.set_position(progress::position((done + share) / steps));
                    if interrupt.requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
                };
                if !interrupt.requested() {
                    let measured = builder.measure(count, self.time, watched);
                    results.sizes.extend(self.report(bar, count, measured)?);
                }
                done += 1.0;
            }
        }
        Ok(())
    }

    /// Everything that is to be measured, opened, so that it fails early if it does.
    fn builders(&self) -> Result<Vec<Builder>, CliError> {
        let open =
            |device| Ok(Builder::Vulkan(Box::new(VulkanBackend::new(&Selection::Named(device), false)?)));
        let processor = Builder::Cpu(cpu::device_info());
        match (&self.device, self.backend) {
            (Some(_), Choice::Cpu) => Err(CliError::DeviceWithCpu),
            (Some(device), _) => Ok(vec![open(device.clone())?]),
            (None, Choice::Cpu) => Ok(vec![processor]),
            (None, choice) => {
                let vulkan = devices().into_iter().filter(|device| device.backend == "vulkan").count();
                let mut builders = (0..vulkan)
                    .map(|number| open(number.to_string()))
                    .collect::<Result<Vec<_>, CliError>>()?;
                if choice == Choice::All {
                    builders.push(processor);
                }
                if builders.is_empty() { Err(CliError::NothingToMeasure) } else { Ok(builders) }
            }
        }
    }

    /// The sizes to measure.
    fn sizes(&self) -> &[u32] {
        if self.sizes.is_empty() { &SIZES } else { &self.sizes }
    }

    /// Prints a row of the table. A size that is too large for the device gets a line that says so.
    fn report(
        &self,
        bar: &ProgressBar,
        count: u32,
        measured: Result<Option<Measurement>, BenchError>,
    ) -> Result<Option<Measurement>, CliError> {
        match measured {
            Ok(Some(measurement)) => {
                bar.suspend(|| say_row(&measurement, self.bandwidth));
                Ok(Some(measurement))
            }
            Ok(None) => Ok(None),
            Err(error) if error.is_of_size() => {
                bar.suspend(|| say(format_args!("{count:>10}  {error}")));
                Ok(None)
            }
            Err(error) => Err(error.into()),
        }
    }
}

impl Builder {
    fn info(&self) -> &DeviceInfo {
        match self {
            Builder::Cpu(info) => info,
            Builder::Vulkan(backend) => backend.device(),
        }
    }

    fn measure(
        &mut self,
        count: u32,
        time: Duration,
        mut progress: impl FnMut(f64) -> ControlFlow<()>,
    ) -> Result<Option<Measurement>, BenchError> {
        let boxes = scene::boxes(count);
        match self {
            Builder::Cpu(_) => measure(&mut HostSubject::new(&boxes), &boxes, time, &mut progress),
            Builder::Vulkan(backend) => {
                let bvh = backend.bvh_over(&boxes)?;
                measure(&mut DeviceSubject { boxes: &boxes, bvh }, &boxes, time, &mut progress)
            }
        }
    }
}

/// The heading of a device's table.
fn say_heading(device: &DeviceInfo) {
    say(format_args!("{} on {}", device.backend, description(device)));
    say(format_args!(
        "{:>10} {:>9} {:>9} {:>9} {:>9} {:>9} {:>8} {:>9} {:>7} {:>5} {:>7}",
        "prisms", "codes", "sort", "treelets", "top", "total ms", "M/s", "refit ms", "SAH", "depth", "builds"
    ));
}

/// The rows of a size.
fn say_row(measured: &Measurement, bandwidth: Option<f32>) {
    let Measurement { primitives, builds, ms, refit_ms, sah_cost, depth, bytes } = measured;
    say(format_args!(
        "{primitives:>10} {} {:>8.1} {refit_ms:>9.3} {sah_cost:>7.2} {depth:>5} {builds:>7}",
        columns(*ms),
        measured.rate()
    ));
    say(format_args!("{:>10} {}", "MB", columns(bytes.scaled(1e-6))));
    if let Some(bandwidth) = bandwidth {
        // A GB/s is 10^6 bytes a millisecond.
        let ms = bytes.scaled(1e-6 / f64::from(bandwidth));
        say(format_args!("{:>10} {}", "allows ms", columns(ms)));
    }
}

fn columns(Phases { codes, sort, treelets, top, total }: Phases) -> String {
    format!("{codes:>9.3} {sort:>9.3} {treelets:>9.3} {top:>9.3} {total:>9.3}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::{Cli, Command};
    use clap::Parser;

    fn parsed(arguments: &[&str]) -> BuildArgs {
        let all = ["emboss", "bench", "build"].into_iter().chain(arguments.iter().copied());
        match Cli::try_parse_from(all).expect("valid").command {
            Command::Bench { bench: Bench::Build(args) } => args,
            _ => panic!("not bench build"),
        }
    }

    #[test]
    fn sizes_are_those_given_or_powers_of_ten() {
        assert_eq!(parsed(&["--sizes", "1e3,5,2e6"]).sizes(), [1000, 5, 2_000_000]);
        assert_eq!(parsed(&[]).sizes(), [1000, 10_000, 100_000, 1_000_000, 10_000_000]);
    }

    #[test]
    fn a_device_is_no_cpu() {
        let error = parsed(&["--backend", "cpu", "--device", "0"]).builders().err().expect("contradictory");
        assert_eq!(error.exit_code(), 2);
    }

    #[test]
    fn results_need_a_folder() {
        let error = parsed(&["--json", "/no/such/folder/a.json"]).run().expect_err("no folder");
        assert!(error.to_string().contains("choose another --json"), "{error}");
    }

    /// One size too large is a line of the table, anything else the end.
    #[test]
    fn errors_of_size_are_lines() {
        use crate::backend::BackendError;
        let bar = progress::bar(true);
        let report = |error: BackendError| parsed(&[]).report(&bar, 1, Err(error.into()));
        let reason = String::new();
        let full = BackendError::Allocation { name: "the BVH", bytes: 1, reason: reason.clone() };
        assert!(matches!(report(full), Ok(None)));
        assert!(report(BackendError::NoDevice { reason }).is_err());
    }
}

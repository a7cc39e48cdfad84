//! `emboss bench trace`: what tracing costs, as a table on standard output.

use super::arguments::RenderArgs;
use super::error::{cannot_write, first_error};
use super::interrupt::Interrupt;
use super::{CliError, description, say, values};
use crate::backend::{Backend, PipelineCode};
use crate::bench::trace;
use crate::render::Scene;
use crate::settings::{Bounds, Method, Settings, Subdivisions};
use crate::stats::{check_file, write_json};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Duration;

/// `emboss bench trace`.
#[derive(Debug, clap::Args)]
#[command(mut_arg("output", |output| output.hide(true)))]
#[command(mut_arg("size", |size| size.help("Size of the pictures in pixels [default: 1920x1080]")))]
#[command(mut_arg("method", |method| method.hide(true)))]
#[command(mut_arg("bounds", |bounds| bounds.hide(true)))]
#[command(mut_arg("quality", |quality| quality.hide(true)))]
#[command(mut_arg("stats", |stats| stats.hide(true)))]
#[command(mut_arg("depth", |depth| depth.hide(true)))]
pub(super) struct TraceArgs {
    #[command(flatten)]
    render: RenderArgs,
    /// Methods to measure [default: quadtree, or --method]
    #[arg(long, value_enum, value_name = "METHOD,...", value_delimiter = ',')]
    methods: Vec<Method>,
    /// N to measure [default: that of the scene]
    #[arg(long = "n", value_name = "N,...", value_delimiter = ',', value_parser = str::parse::<Subdivisions>)]
    ns: Vec<Subdivisions>,
    /// Limits of memory for stored bounds to measure the quadtree with [default: auto, or --bounds]
    #[arg(long, value_name = "none|auto|MIB,...", value_delimiter = ',', value_parser = str::parse::<Bounds>)]
    limits: Vec<Bounds>,
    /// How long each of a row's three stages is measured
    #[arg(long, value_name = "SECONDS", default_value = "1", value_parser = values::seconds)]
    time: Duration,
    /// Also write the results as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl TraceArgs {
    pub(super) fn run(self) -> Result<(), CliError> {
        if let Some(path) = &self.json {
            check_file(path).map_err(|reason| cannot_write(path, reason))?;
        }
        let interrupt = Interrupt::install();
        let mut backend = self.render.open_backend()?;
        let args = RenderArgs { size: self.render.size.or(Some((1920, 1080))), ..self.render.clone() };
        let (settings, inputs, _) = args.read(self.methods.contains(&Method::NormalMap))?;
        args.report(&inputs);
        let mut all = Vec::new();
        let measured = self.measure(backend.as_mut(), &settings, &inputs.scene, &interrupt, &mut all);
        // Whatever has ended it: what was measured until then is known.
        let written = match &self.json {
            Some(path) if !all.is_empty() => {
                write_json(path, &all).map_err(|reason| cannot_write(path, reason))
            }
            _ => Ok(()),
        };
        first_error(measured, written)?;
        if interrupt.requested() { Err(CliError::BenchInterrupted) } else { Ok(()) }
    }

    /// Measures each method with each N and each limit, as `all` has them then.
    fn measure(
        &self,
        backend: &mut dyn Backend,
        settings: &Settings,
        scene: &Scene,
        interrupt: &Interrupt,
        all: &mut Vec<trace::Measurement>,
    ) -> Result<(), CliError> {
        let or = |given: &[_], one| if given.is_empty() { vec![one] } else { given.to_vec() };
        let methods = or(&self.methods, settings.method);
        let ns = if self.ns.is_empty() { vec![Subdivisions::of(settings, scene)] } else { self.ns.clone() };
        let limits = if self.limits.is_empty() { vec![settings.bounds] } else { self.limits.clone() };
        let device = backend.device();
        say(format_args!(
            "{} on {}, {}x{}",
            device.backend,
            description(device),
            settings.width,
            settings.height
        ));
        say(format_args!(
            "{:<16} {:>8} {:>6} {:>9} {:>9} {:>9} {:>9} {:>9} {:>8} {:>9} {:>6} {:>6} {:>6}",
            "method",
            "N",
            "bounds",
            "load",
            "first",
            "sample",
            "primary",
            "bare ms",
            "Mray/s",
            "MB",
            "boxes",
            "subs",
            "tris"
        ));
        for &method in &methods {
            for &n in if method.parameter().is_some() { &ns[..] } else { &ns[..1] } {
                for &bounds in if method == Method::Quadtree { &limits[..] } else { &limits[..1] } {
                    let settings = Settings { method, adaptive: n.pixels(), bounds, ..settings.clone() };
                    let scene = Scene { subdivisions: n.most(), ..scene.clone() };
                    let going_on = || {
                        if interrupt.requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
                    };
                    let measured = trace::measure(backend, &scene, &settings, self.time, &mut { going_on })?;
                    let Some(row) = measured else { return Ok(()) };
                    say(format_args!(
                        "{:<16} {:>8} {:>6} {:>9.2} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>8.1} {:>9.2} {:>6.1} {:>6.1} \
                         {:>6.1}",
                        row.method,
                        row.n.to_string(),
                        row.bounds.to_string(),
                        row.load_ms,
                        row.first_ms,
                        row.sample_ms,
                        row.primary_ms,
                        row.intersection_ms,
                        row.rays as f64 / row.sample_ms / 1e3,
                        row.bytes as f64 / 1e6,
                        row.boxes,
                        row.sub_triangles,
                        row.triangles
                    ));
                    say_pipelines(&row.pipelines);
                    all.push(row);
                }
            }
        }
        Ok(())
    }
}

/// Prints the driver's statistics of the pipeline that traces, if it has any.
fn say_pipelines(pipelines: &[PipelineCode]) {
    for code in pipelines.iter().filter(|code| code.kernel == "render" && !code.statistics.is_empty()) {
        let told: Vec<String> =
            code.statistics.iter().map(|one| format!("{} {}", one.name, one.value)).collect();
        say(format_args!(
            "  {}: {} instructions of SPIR-V; {}",
            code.kernel,
            code.instructions,
            told.join(", ")
        ));
    }
}

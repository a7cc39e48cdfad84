//! `emboss compare`.

use super::arguments::RenderArgs;
use super::error::first_error;
use super::interrupt::Interrupt;
use super::{CliError, progress, say, values};
use crate::backend::{Backend, kernels_hash};
use crate::compare::results::{FileStamp, Identity, Results, Store};
use crate::compare::subject::Configuration;
use crate::compare::{CompareError, NS, Plan, markdown, report, run, usual_methods};
use crate::reports::Reports;
use crate::settings::{Method, Shade, Subdivisions};
use clap::ValueEnum;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Duration;

/// Pixels of a comparison's pictures unless said otherwise: enough to see what is wrong.
const SIZE: (u32, u32) = (480, 360);

/// Takes the arguments of `emboss render`. Writes report.html, results.csv, results.json and the charts into the folder
/// --output. When it is broken off, the same command goes on from there.
#[derive(Debug, clap::Args)]
#[command(mut_arg("output", |output| output
    .value_name("DIR")
    .default_value("emboss-compare")
    .help("Folder for the report, the results, the charts and the pictures")))]
#[command(mut_arg("size", |size| size.help("Size of the pictures in pixels [default: 480x360]")))]
#[command(mut_arg("method", |method| method.hide(true)))]
#[command(mut_arg("quality", |quality| quality.hide(true)))]
#[command(mut_arg("stats", |stats| stats.hide(true)))]
#[command(mut_arg("depth", |depth| depth.hide(true)))]
pub(super) struct CompareArgs {
    #[command(flatten)]
    pub(super) render: RenderArgs,
    /// Methods to compare [default: all but brute-force]
    #[arg(long, value_enum, value_name = "METHOD,...", value_delimiter = ',')]
    methods: Vec<Method>,
    /// N to compare, for those methods that have one [default: 4,16,64,256, or auto where the argument N is]
    #[arg(long = "n", value_name = "N,...", value_delimiter = ',', value_parser = str::parse::<Subdivisions>)]
    ns: Vec<Subdivisions>,
    /// N of the reference, the quadtree [default: as many as the picture can show]
    #[arg(long, value_name = "N", value_parser = values::fixed_subdivisions)]
    reference: Option<u32>,
    /// How long to measure; each method has a round at least
    #[arg(long, value_name = "SECONDS", default_value = "60", value_parser = values::seconds)]
    time: Duration,
}

impl CompareArgs {
    pub(super) fn run(self) -> Result<(), CliError> {
        self.check()?;
        let folder = &self.render.output;
        Store::check(folder).map_err(CompareError::from)?;
        let interrupt = Interrupt::install();
        let mut backend = self.render.open_backend()?;
        let args = RenderArgs { size: self.render.size.or(Some(SIZE)), ..self.render.clone() };
        let (settings, inputs, samples) =
            args.read(self.methods.is_empty() || self.methods.contains(&Method::NormalMap))?;
        args.report(&inputs);
        let device = backend.device();
        let identity = Identity {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            command: self.command_line(),
            backend: device.backend.to_owned(),
            device: device.name.clone(),
            details: device.details.clone(),
            kernels: kernels_hash(),
            files: inputs
                .files
                .iter()
                .chain(&args.normal_map)
                .chain(&args.offset_map)
                .map(|path| FileStamp::of(path))
                .collect(),
        };
        let ns = self.ns(inputs.subdivisions);
        let methods = if self.methods.is_empty() { usual_methods() } else { self.methods.clone() };
        let plan = Plan {
            scene: inputs.scene,
            configurations: Configuration::all(&methods, &ns),
            reference: self.reference,
            time: self.time,
            samples,
            settings,
        };
        let new = Results::new(identity, plan.settings.width, plan.settings.height, samples);
        let mut store = Store::open(folder, new).map_err(CompareError::from)?;
        if store.resumed && !args.quiet {
            let done = store.results.configurations.len() + store.results.skipped.len();
            say(format_args!(
                "Going on in {}: {done} of {} measured in {:.0} s",
                folder.display(),
                plan.configurations.len(),
                store.results.seconds
            ));
        }
        let bar = progress::bar(args.quiet);
        let measured = run(&plan, backend.as_mut(), &mut store, &mut |share| {
            bar.set_position(progress::position(share));
            if interrupt.requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        bar.finish_and_clear();
        // What is measured can be looked at before the rest is.
        let is_any =
            matches!(measured, Ok(()) | Err(CompareError::Interrupted | CompareError::Failed { .. }));
        let reported = if is_any { report::write(&store).map_err(CompareError::from) } else { Ok(()) };
        let is_measured = measured.is_ok();
        first_error(measured, reported)?;
        if let (true, Some(reference)) = (is_measured, store.results.reference) {
            warn_of_reference(backend.as_mut(), plan, reference.n);
        }
        if !args.quiet {
            say_results(&store);
        }
        Ok(())
    }

    /// Refuses options of `emboss render` that say nothing here.
    fn check(&self) -> Result<(), CliError> {
        let render = &self.render;
        if render.shade == Some(Shade::Error) {
            return Err(CliError::NotOfCompare("--shade error"));
        }
        let given = [
            ("--method", render.method.is_some()),
            ("--quality", render.quality.is_some()),
            ("--stats", render.stats.is_some()),
            ("--depth", render.depth.is_some()),
        ];
        match given.into_iter().find(|(_, given)| *given) {
            Some((option, _)) => Err(CliError::NotOfCompare(option)),
            None => render.check_device(),
        }
    }

    /// The N to compare: as many as triangles need where that is what the six arguments say.
    fn ns(&self, argument: Subdivisions) -> Vec<Subdivisions> {
        match (self.ns.is_empty(), argument) {
            (false, _) => self.ns.clone(),
            (true, Subdivisions::Auto { .. }) => vec![argument],
            (true, Subdivisions::Fixed(_)) => NS.map(Subdivisions::Fixed).to_vec(),
        }
    }

    /// `emboss compare` with these arguments, without the folder and the time: with more time there are more
    /// rounds, and a reference whose N was cut by time is sought anew unless something was measured against it.
    fn command_line(&self) -> String {
        let mut words = vec![self.render.command_line_of("compare", None)];
        let mut list = |name: &str, values: Vec<String>| {
            if !values.is_empty() {
                words.push(format!("{name} {}", values.join(",")));
            }
        };
        let name = |method: &Method| method.to_possible_value().map(|value| value.get_name().to_owned());
        list("--methods", self.methods.iter().filter_map(name).collect());
        list("--n", self.ns.iter().map(Subdivisions::to_string).collect());
        list("--reference", self.reference.iter().map(u32::to_string).collect());
        words.join(" ")
    }
}

/// Says what is wrong with the picture that all others are measured against. They are: that it could not be found out
/// is no failure.
fn warn_of_reference(backend: &mut dyn Backend, plan: Plan, n: u32) {
    let Plan { mut scene, mut settings, .. } = plan;
    scene.subdivisions = n;
    (settings.method, settings.adaptive) = (Method::Quadtree, None);
    let found = Reports::of(backend, scene, &settings).unwrap_or_else(|error| {
        tracing::warn!("whether the pictures show anything could not be found out ({error})");
        Reports::default()
    });
    for map in &found.undersampled {
        tracing::warn!("the reference itself: {map}");
    }
    if let Some(useless) = &found.useless {
        tracing::warn!("{useless}");
    }
}

/// Writes the page of all methods.
pub(super) fn describe_methods(folders: &[PathBuf]) -> Result<(), CliError> {
    let all = folders.iter().map(|folder| Results::read(folder)).collect::<Result<Vec<_>, _>>();
    say(markdown::page(&all.map_err(CompareError::from)?).trim_end());
    Ok(())
}

/// Says in short what was measured.
fn say_results(store: &Store) {
    say(format_args!("{:<24} {:>10} {:>10} {:>9} {:>9}", "", "frame ms", "KiB", "FLIP", "flicker"));
    for measured in &store.results.configurations {
        say(format_args!(
            "{:<24} {:>10.3} {:>10.1} {:>9.5} {:>9.5}",
            measured.configuration.to_string(),
            measured.frame_ms,
            measured.memory.all as f64 / 1024.0,
            measured.own().flip,
            measured.flicker
        ));
    }
    for skipped in &store.results.skipped {
        say(format_args!("{:<24} left out: {}", skipped.configuration.to_string(), skipped.reason));
    }
    say(format_args!("Wrote {}", store.folder().join("report.html").display()));
}

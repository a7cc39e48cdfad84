//! `--quality` of the commands that show a picture: a budget in place of a method and N.

use super::arguments::RenderArgs;
use super::interrupt::Interrupt;
use super::values::OrDefault;
use super::{CliError, progress, say};
use crate::backend::Backend;
use crate::compare::CompareError;
use crate::compare::quality::{Candidate, Candidates, Wanted, candidates, choose};
use crate::render::Scene;
use crate::settings::{Method, Settings, Subdivisions};
use std::ops::ControlFlow;

impl RenderArgs {
    /// Refuses a budget together with what it chooses.
    pub(super) fn check_quality(&self) -> Result<(), CliError> {
        let n = self.subdivisions.and_then(OrDefault::given);
        if self.quality.is_some() && (self.method.is_some() || n.is_some()) {
            return Err(CliError::QualityWithChoice);
        }
        Ok(())
    }

    /// Where there is a budget, measures what is quickest within it, says so, and has it from then on as if it had been
    /// given. `samples` are those of a pixel where one picture is wanted, `None` where frame after frame is. Whether
    /// there was a budget.
    pub(super) fn choose_quality(
        &mut self,
        backend: &mut dyn Backend,
        scene: &Scene,
        settings: &Settings,
        samples: Option<u32>,
        interrupt: Option<&Interrupt>,
    ) -> Result<bool, CliError> {
        let Some(budget) = self.quality.take() else { return Ok(false) };
        let wanted = Wanted { budget: f64::from(budget), samples };
        if !self.quiet {
            say(format_args!("Measuring which methods have a mean FLIP of {budget} at most here..."));
        }
        let bar = progress::bar(self.quiet);
        let measured = candidates(backend, scene, settings, wanted, &mut |share| {
            bar.set_position(progress::position(share));
            let stop = interrupt.is_some_and(Interrupt::requested);
            if stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        bar.finish_and_clear();
        let Candidates { tried, size } = measured.map_err(|error| match error {
            CompareError::Interrupted => CliError::InterruptedEarly,
            error => error.into(),
        })?;
        let chosen = choose(&tried, wanted.budget).ok_or(CliError::NoCandidate)?;
        if !self.quiet {
            say(format_args!(
                "On {}x{} pixels; times are those of {}",
                size.0,
                size.1,
                if samples.is_some() {
                    "your picture, estimated, with preparation"
                } else {
                    "a frame of these"
                }
            ));
            let shown = |candidate: &&Candidate| self.verbose || is_within(candidate, wanted.budget);
            let rows = tried.iter().filter(shown);
            rows.for_each(|candidate| say(row(candidate, candidate == &chosen, wanted.budget)));
            if let Some(others) = others(&tried, wanted.budget).filter(|_| !self.verbose) {
                say(others);
            }
            say(reason(&chosen, &tried, budget));
        }
        self.take(chosen, settings);
        Ok(true)
    }

    /// Has a choice as if it had been given.
    fn take(&mut self, chosen: Candidate, settings: &Settings) {
        let Candidate { configuration, .. } = chosen;
        self.method = Some(configuration.method);
        if configuration.method != Method::NormalMap {
            (self.normal_map, self.normal_space) = (None, None);
        }
        if configuration.method != Method::BumpOffset {
            self.offset_map = None;
        }
        // A method that has no use for N may have none for `auto` either, which a scene file may say.
        let unused = settings.adaptive.map(|_| Subdivisions::Fixed(1));
        if let Some(n) = configuration.n.or(unused) {
            self.subdivisions = Some(OrDefault::Given(n));
        }
    }
}

fn is_within(candidate: &Candidate, budget: f64) -> bool {
    candidate.error.is_some_and(|error| error <= budget)
}

/// What became of those that are not worth a row, and the one of them that comes nearest to the budget.
fn others(tried: &[Candidate], budget: f64) -> Option<String> {
    let given_up = tried.iter().filter(|candidate| candidate.error.is_none()).count();
    let over = || {
        tried.iter().filter_map(|candidate| Some((candidate, candidate.error?))).filter(|(_, e)| *e > budget)
    };
    let nearest = over().min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(candidate, error)| {
        let configuration = candidate.configuration;
        format!("{} over the budget (least of all {configuration}: {error:.5})", over().count())
    });
    let slower = (given_up > 0).then(|| format!("{given_up} given up, since slower"));
    let parts: Vec<_> = nearest.into_iter().chain(slower).collect();
    (!parts.is_empty()).then(|| format!("   not shown: {}; --verbose shows all", parts.join(", ")))
}

fn row(candidate: &Candidate, is_chosen: bool, budget: f64) -> String {
    let Candidate { configuration, error, cost_ms } = candidate;
    let mark = if is_chosen { "->" } else { "" };
    let seconds = cost_ms * 1e-3;
    let found = match error {
        None => format!("              {seconds:>9.3} s  given up: slower than one within the budget"),
        Some(error) if *error > budget => format!("FLIP {error:.5}  {seconds:>9.3} s  over the budget"),
        Some(error) => format!("FLIP {error:.5}  {seconds:>9.3} s"),
    };
    format!("{mark:<3}{:<22} {found}", configuration.to_string())
}

/// Why it was chosen. The first of those that were tried is the exact one.
fn reason(chosen: &Candidate, tried: &[Candidate], budget: f32) -> String {
    let exact = tried.first().filter(|exact| *exact != chosen);
    let gain = exact.map_or_else(
        || "nothing else is both within it and quicker".to_owned(),
        |exact| {
            let times = exact.cost_ms / chosen.cost_ms;
            format!("{times:.1} times as quick as {}, which has no error", exact.configuration)
        },
    );
    let Candidate { configuration, error, .. } = chosen;
    let error = error.unwrap_or_default();
    format!("Chose {configuration}: the quickest with FLIP {budget} at most (it has {error:.5}); {gain}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::{Cli, Command};
    use crate::compare::subject::Configuration;
    use clap::Parser;

    /// A scene file asks for adaptive N, which the chosen method cannot have and has no use for.
    #[test]
    fn choices_go_before_what_a_scene_file_says() {
        let parsed = Cli::try_parse_from(["emboss", "render", "s.toml", "--quality=1"]).expect("valid");
        let Command::Render(mut args) = parsed.command else { panic!("not render") };
        let settings = Settings { adaptive: Some(1.0), ..Settings::default() };
        let mut chosen = |method, n: Option<u32>| {
            let configuration = Configuration { method, n: n.map(Subdivisions::Fixed) };
            args.take(Candidate { configuration, error: Some(0.0), cost_ms: 1.0 }, &settings);
            (args.method, args.subdivisions.and_then(OrDefault::given))
        };
        assert_eq!(chosen(Method::Bump, None), (Some(Method::Bump), Some(Subdivisions::Fixed(1))));
        assert_eq!(chosen(Method::Steep, Some(16)), (Some(Method::Steep), Some(Subdivisions::Fixed(16))));
    }

    #[test]
    fn what_has_no_row_is_told() {
        let candidate = |n, error| Candidate {
            configuration: Configuration { method: Method::Steep, n: Some(Subdivisions::Fixed(n)) },
            error,
            cost_ms: 2000.0,
        };
        let tried =
            [candidate(1, Some(0.0)), candidate(4, Some(0.3)), candidate(16, Some(0.2)), candidate(64, None)];
        let told = others(&tried, 0.1).expect("three");
        assert!(told.contains("2 over the budget (least of all steep N=16: 0.20000), 1 given up"), "{told}");
        assert_eq!(others(&tried[..1], 0.1), None);
        let why = reason(&tried[0], &tried, 0.1);
        assert!(why.contains("nothing else is both"), "{why}");
        let quick = Candidate { cost_ms: 500.0, ..tried[1] };
        assert!(reason(&quick, &tried, 0.5).contains("4.0 times as quick as steep N=1,"));
    }
}

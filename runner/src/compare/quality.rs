//! The cheapest configuration whose error on the user's scene is within a budget.

use super::flip;
use super::reference;
use super::subject::{Configuration, Stage, Subject, milliseconds};
use super::{CompareError, NS, Progress, skipped, usual_methods};
use crate::backend::Backend;
use crate::render::Scene;
use crate::settings::{Settings, Subdivisions};
use glam::Vec3;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// Rows of the picture that is measured, at most.
const ROWS: u32 = 180;
/// Samples of its pixels.
const SAMPLES: u32 = 2;
/// How long N of the reference may be doubled.
const REFERENCE_TIME: Duration = Duration::from_secs(10);
/// A configuration is given up that takes so many times as long as the best one so far: one time alone may be off by
/// some.
const PATIENCE: f64 = 2.0;

/// What is to be chosen for.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// The greatest mean ꟻLIP.
    pub budget: f64,
    /// Samples of a pixel where one picture is wanted, for which the scene is prepared once; `None` where frames follow
    /// each other, so that only they count.
    pub samples: Option<u32>,
}

/// A configuration that was tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Which.
    pub configuration: Configuration,
    /// Mean ꟻLIP; `None` where it was given up before its picture was done, since another is within the budget and
    /// quicker.
    pub error: Option<f64>,
    /// How long the user's picture takes, or a frame of the small one, in milliseconds: see [`Wanted::samples`]. It is
    /// made from the least time that was taken, since what else the machine does only adds to it. At least so long
    /// where it was given up.
    pub cost_ms: f64,
}

/// What was tried.
#[derive(Clone, Debug)]
pub struct Candidates {
    /// What errors are against, first of all, then the others in the order in which they were tried.
    pub tried: Vec<Candidate>,
    /// Pixels of a row of the small picture, and its rows.
    pub size: (u32, u32),
}

/// The settings of a picture that is as the user's but small.
fn small(settings: &Settings) -> Settings {
    let height = settings.height.min(ROWS);
    let width = u64::from(settings.width) * u64::from(height) / u64::from(settings.height);
    Settings { width: u32::try_from(width).unwrap_or(u32::MAX).max(1), height, ..settings.clone() }
}

/// How times of the small picture become costs.
#[derive(Clone, Copy)]
struct Price {
    /// Of what preparation takes.
    preparation: f64,
    /// Of a frame.
    frame: f64,
}

impl Price {
    fn new(user: &Settings, small: &Settings, wanted: Wanted) -> Price {
        let pixels = |settings: &Settings| f64::from(settings.width) * f64::from(settings.height);
        match wanted.samples {
            Some(samples) => Price {
                preparation: 1.0,
                frame: pixels(user) * f64::from(samples) / (pixels(small) * f64::from(SAMPLES)),
            },
            None => Price { preparation: 0.0, frame: 1.0 },
        }
    }

    /// What both come to.
    fn of(self, preparation_ms: f64, frame_ms: f64) -> f64 {
        self.preparation * preparation_ms + self.frame * frame_ms
    }
}

/// Measures what could be chosen, from the least N to the greatest: the methods that are usually
/// [compared](super::usual_methods) with the usual N, and the quadtree with the N of the reference, whose error is 0.
///
/// What cannot be chosen is not measured to the end: of a method no N that is greater than one within the budget, and
/// nothing that takes longer than what is within it already.
pub fn candidates(
    backend: &mut dyn Backend,
    scene: &Scene,
    user: &Settings,
    wanted: Wanted,
    progress: Progress<'_>,
) -> Result<Candidates, CompareError> {
    let settings = &small(user);
    let request = reference::Request { given: None, least: NS[NS.len() - 1], time: REFERENCE_TIME };
    let stage = &reference::stage(backend, scene, settings, request)?;
    let summary = reference::find(backend, scene, settings, stage, request, &mut || progress(0.0))?;
    let exact = reference::configuration(summary.n);
    let mut configurations = Configuration::all(&usual_methods(), &NS.map(Subdivisions::Fixed));
    configurations.retain(|&configuration| configuration != exact);
    configurations.sort_by_key(|configuration| configuration.n.map_or(0, Subdivisions::most));

    let price = Price::new(user, settings, wanted);
    let mut trial = Trial { scene, settings, stage, price, watch: &mut || progress(0.0) };
    let (right, cost_ms) = trial.reference(backend, exact)?;
    let mut tried = vec![Candidate { configuration: exact, error: Some(0.0), cost_ms }];
    let mut least_ms = cost_ms;
    let mut settled = Vec::new();
    let count = (configurations.len() + 1) as f64;
    for (i, configuration) in configurations.into_iter().enumerate() {
        if settled.contains(&configuration.method) {
            continue;
        }
        let mut watch = || progress((i + 1) as f64 / count);
        let mut trial = Trial { scene, settings, stage, price, watch: &mut watch };
        match trial.run(backend, configuration, &right, wanted.budget, PATIENCE * least_ms) {
            Ok(candidate) => {
                let is_within = candidate.error.is_some_and(|error| error <= wanted.budget);
                if is_within {
                    least_ms = least_ms.min(candidate.cost_ms);
                }
                if is_within || candidate.error.is_none() {
                    settled.push(configuration.method);
                }
                tried.push(candidate);
            }
            // What cannot take the scene is no choice.
            Err(error) => drop(skipped(configuration, error)?),
        }
    }
    Ok(Candidates { tried, size: (settings.width, settings.height) })
}

/// What is the same for all configurations.
struct Trial<'a> {
    scene: &'a Scene,
    settings: &'a Settings,
    stage: &'a Stage,
    price: Price,
    watch: &'a mut dyn FnMut() -> ControlFlow<()>,
}

impl Trial<'_> {
    /// The right picture, and what it costs.
    fn reference(
        &mut self,
        backend: &mut dyn Backend,
        configuration: Configuration,
    ) -> Result<(Vec<Vec3>, f64), CompareError> {
        let mut subject = Subject::load(backend, self.scene, self.settings, configuration, Some(self.stage))?;
        let right = subject.picture(self.stage.camera, SAMPLES, self.watch)?;
        let frames = subject.frame_ms(SAMPLES, self.watch)?;
        Ok((right, self.price.of(milliseconds(subject.preparation), least(&frames))))
    }

    /// A configuration's error, and its cost unless that is more than `most_ms`.
    fn run(
        &mut self,
        backend: &mut dyn Backend,
        configuration: Configuration,
        right: &[Vec3],
        budget: f64,
        most_ms: f64,
    ) -> Result<Candidate, CompareError> {
        let mut subject = Subject::load(backend, self.scene, self.settings, configuration, Some(self.stage))?;
        let preparation_ms = milliseconds(subject.preparation);
        let (begin, price) = (Instant::now(), self.price);
        let cost_ms = || price.of(preparation_ms, milliseconds(begin.elapsed()));
        let mut gave_up = None;
        let colors = subject.picture(self.stage.camera, SAMPLES, &mut || {
            let so_far = cost_ms();
            if so_far > most_ms {
                gave_up = Some(so_far);
                return ControlFlow::Break(());
            }
            (self.watch)()
        });
        if let Some(cost_ms) = gave_up {
            return Ok(Candidate { configuration, error: None, cost_ms });
        }
        let whole_ms = cost_ms();
        let error = flip::mean(&flip::flip(right, &colors?, self.settings.width as usize));
        // Only what may be chosen is worth more frames.
        let cost_ms = if error > budget {
            whole_ms
        } else {
            price.of(preparation_ms, least(&subject.frame_ms(SAMPLES, self.watch)?))
        };
        Ok(Candidate { configuration, error: Some(error), cost_ms })
    }
}

/// The least of some times.
fn least(times: &[f64]) -> f64 {
    times.iter().copied().fold(f64::INFINITY, f64::min)
}

/// The quickest of those whose error is within the budget; of those that are as quick the better one. The exact one
/// always is.
pub fn choose(candidates: &[Candidate], budget: f64) -> Option<Candidate> {
    let within = candidates.iter().filter_map(|candidate| {
        let error = candidate.error.filter(|&error| error <= budget)?;
        Some((candidate, error))
    });
    let best = within.min_by(|(a, a_error), (b, b_error)| {
        a.cost_ms.total_cmp(&b.cost_ms).then(a_error.total_cmp(b_error))
    });
    best.map(|(candidate, _)| *candidate)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Method;

    #[test]
    fn the_quickest_within_the_budget_is_chosen() {
        let candidate = |n, error, cost_ms| Candidate {
            configuration: Configuration { method: Method::Quadtree, n: Some(Subdivisions::Fixed(n)) },
            error,
            cost_ms,
        };
        let all = [
            candidate(4, Some(0.3), 1.0),
            candidate(16, Some(0.02), 2.0),
            candidate(64, Some(0.02), 3.0),
            candidate(256, Some(0.0), 9.0),
            candidate(1, None, 0.5),
        ];
        assert_eq!(choose(&all, 1.0), Some(all[0]));
        assert_eq!(choose(&all, 0.02), Some(all[1]));
        assert_eq!(choose(&all, 0.019), Some(all[3]));
        assert_eq!(choose(&all, 0.0), Some(all[3]));
    }

    /// A picture of four times as many pixels, each with four times as many samples, is prepared once; of frames that
    /// is past.
    #[test]
    fn pictures_cost_their_preparation_too() {
        let [user, small] =
            [(40, 20), (20, 10)].map(|(width, height)| Settings { width, height, ..Settings::default() });
        let cost = |samples| Price::new(&user, &small, Wanted { budget: 0.0, samples }).of(100.0, 2.0);
        assert_eq!((cost(Some(4 * SAMPLES)), cost(None)), (100.0 + 16.0 * 2.0, 2.0));
    }

    #[test]
    fn small_pictures_keep_their_shape_and_others_stay() {
        let size = |width, height| {
            let small = small(&Settings { width, height, ..Settings::default() });
            (small.width, small.height)
        };
        assert_eq!((size(1920, 1080), size(100, 90), size(1, 4000)), ((320, 180), (100, 90), (1, 180)));
    }
}

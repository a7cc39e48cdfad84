//! The CPU backend: the kernels as plain functions, spread over the processor's threads by rayon.

use super::host_scene::HostScene;
use super::{Backend, BackendError, BuildReport, DeviceInfo, DeviceKind, SceneBuffers, Totals, reserved};
use crate::bvh::Bvh;
use emboss_kernels::aabb::Aabb;
use emboss_kernels::counters::Counts;
use emboss_kernels::interface::{
    Displacement, FilmPixel, Frame, Intersection, PointLight, Ray, counter, method, shade,
};
use emboss_kernels::probe;
use emboss_kernels::render::{sample_pixel, trace_ray};
use emboss_kernels::scene::{Features, SceneView};
use glam::Vec4;
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

/// Pixels of a tile, a run of the film in row-major order. Small enough that threads end together, large enough that
/// handing out tiles costs nothing beside tracing them; between 256 and 4096 there is no difference to measure.
const TILE_PIXELS: usize = 1024;
/// In the place of a method: the pixel loop that has the code of all.
const ANY: u32 = u32::MAX;
/// How long a tile may keep `progress` waiting, which is where Ctrl-C is heard.
const PATIENCE: Duration = Duration::from_millis(50);

/// Runs the kernels on the processor.
pub struct CpuBackend {
    device: DeviceInfo,
    scene: HostScene,
    film: Vec<FilmPixel>,
    totals: Totals,
}

impl CpuBackend {
    /// The loaded scene.
    pub fn scene(&self) -> &HostScene {
        &self.scene
    }

    /// The backend on all threads of rayon's global pool, without a scene.
    pub fn new() -> CpuBackend {
        CpuBackend {
            device: device_info(),
            scene: HostScene::default(),
            film: Vec::new(),
            totals: Totals::default(),
        }
    }

    /// Makes an empty film for the present frame, and clears the counters.
    fn clear_film(&mut self) -> Result<(), BackendError> {
        self.totals = Totals::default();
        // The old film goes first, so that two need not fit side by side.
        self.film = Vec::new();
        self.film = cleared_film(self.scene.view().frame)?;
        Ok(())
    }
}

impl Default for CpuBackend {
    fn default() -> Self {
        CpuBackend::new()
    }
}

/// What `emboss devices` says of the processor.
pub fn device_info() -> DeviceInfo {
    DeviceInfo {
        backend: "cpu",
        name: processor_name().unwrap_or_else(|| std::env::consts::ARCH.to_owned()),
        kind: DeviceKind::Cpu,
        details: format!("{} threads", rayon::current_num_threads()),
    }
}

/// The processor's name where the system tells it in a file.
fn processor_name() -> Option<String> {
    let cpuinfo = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = cpuinfo.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

impl Backend for CpuBackend {
    fn device(&self) -> &DeviceInfo {
        &self.device
    }

    fn load(&mut self, scene: &SceneBuffers, frame: &Frame, features: Features) -> Result<(), BackendError> {
        // The old scene goes first, so that two need not fit side by side.
        self.scene = HostScene::default();
        self.clear_film()?;
        let scene = HostScene::new(scene, frame, features)?;
        self.film = cleared_film(frame)?;
        self.scene = scene;
        Ok(())
    }

    fn build_report(&self) -> BuildReport {
        self.scene.report()
    }

    fn prism_boxes(&mut self) -> Result<Vec<Aabb>, BackendError> {
        Ok(self.scene.boxes().to_vec())
    }

    fn bvh(&mut self) -> Result<Bvh, BackendError> {
        Ok(self.scene.bvh().clone())
    }

    fn distance_maps(&mut self) -> Result<Vec<f32>, BackendError> {
        Ok(self.scene.view().distances.to_vec())
    }

    fn set_view(&mut self, frame: &Frame, lights: &[PointLight]) -> Result<(), BackendError> {
        self.scene.set_view(frame, lights)?;
        self.clear_film()
    }

    fn set_displacements(&mut self, displacements: &[Displacement]) -> Result<(), BackendError> {
        self.scene.set_displacements(displacements)?;
        self.clear_film()
    }

    fn set_features(&mut self, features: Features) -> Result<(), BackendError> {
        self.scene.set_features(features)?;
        self.clear_film()
    }

    fn add_sample(
        &mut self,
        sample: u32,
        progress: &mut dyn FnMut(f32) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>, BackendError> {
        let features = self.scene.features();
        let pass = Pass { scene: self.scene.view(), features, sample };
        // One copy of the pixel loop for each method, so that the compiler leaves out the others' code.
        let film = &mut self.film;
        // Errors are shown of two methods.
        let method = if features.shade == shade::ERROR { ANY } else { features.method };
        let (flow, totals) = match method {
            ANY => pass.run::<ANY>(film, progress),
            method::NONE => pass.run::<{ method::NONE }>(film, progress),
            method::BRUTE_FORCE => pass.run::<{ method::BRUTE_FORCE }>(film, progress),
            method::GRID_WALK => pass.run::<{ method::GRID_WALK }>(film, progress),
            method::TESSELLATE => pass.run::<{ method::TESSELLATE }>(film, progress),
            method::INVERSE => pass.run::<{ method::INVERSE }>(film, progress),
            method::PYRAMID => pass.run::<{ method::PYRAMID }>(film, progress),
            method::BUMP => pass.run::<{ method::BUMP }>(film, progress),
            method::BUMP_OFFSET => pass.run::<{ method::BUMP_OFFSET }>(film, progress),
            method::NORMAL_MAP => pass.run::<{ method::NORMAL_MAP }>(film, progress),
            method::PARALLAX => pass.run::<{ method::PARALLAX }>(film, progress),
            method::PARALLAX_LIMITED => pass.run::<{ method::PARALLAX_LIMITED }>(film, progress),
            method::SPHERE => pass.run::<{ method::SPHERE }>(film, progress),
            method::STEEP => pass.run::<{ method::STEEP }>(film, progress),
            method::RELIEF => pass.run::<{ method::RELIEF }>(film, progress),
            method::OCCLUSION => pass.run::<{ method::OCCLUSION }>(film, progress),
            _ => pass.run::<{ method::QUADTREE }>(film, progress),
        };
        add_totals(&mut self.totals, &totals, features.counters != 0);
        Ok(flow)
    }

    fn resolve(&mut self) -> Result<Vec<Vec4>, BackendError> {
        let mut picture = reserved("the picture", self.film.len())?;
        let frame = self.scene.view().frame;
        self.film.par_iter().map(|pixel| pixel.resolve(frame)).collect_into_vec(&mut picture);
        Ok(picture)
    }

    fn totals(&mut self) -> Result<Totals, BackendError> {
        Ok(self.totals)
    }

    fn device_ms(&mut self) -> Option<f64> {
        None
    }

    fn trace_rays(&mut self, rays: &[Ray]) -> Result<Vec<Intersection>, BackendError> {
        let mut hits = reserved("intersections", rays.len())?;
        let (scene, features) = (self.scene.view(), self.scene.features());
        rays.par_iter()
            .map(|&ray| {
                let mut counts = Counts::default();
                (trace_ray(&scene, features, ray, &mut counts), counts)
            })
            .collect_into_vec(&mut hits);
        let mut totals = Totals::default();
        hits.iter().for_each(|(_, counts)| add_counts(&mut totals, *counts));
        add_totals(&mut self.totals, &totals, features.counters != 0);
        Ok(hits.into_iter().map(|(hit, _)| hit).collect())
    }

    fn probe(&mut self, kernel: u32, input: &[u32], count: u32) -> Result<Vec<u32>, BackendError> {
        let words = count as usize * probe::OUT_STRIDE as usize;
        let mut output = reserved("probe results", words)?;
        output.resize(words, 0);
        (0..count).for_each(|i| probe::run(kernel, input, &mut output, i));
        Ok(output)
    }
}

/// One sample of every pixel.
#[derive(Clone, Copy)]
struct Pass<'a> {
    scene: SceneView<'a>,
    features: Features,
    sample: u32,
}

impl Pass<'_> {
    /// Adds the sample to `film`, tile by tile on the threads of the pool. This thread hands out the tiles and then
    /// waits for them one by one to call `progress`, which need not be `Send`; it must not be a thread of the pool.
    fn run<const METHOD: u32>(
        self,
        film: &mut [FilmPixel],
        progress: &mut dyn FnMut(f32) -> ControlFlow<()>,
    ) -> (ControlFlow<()>, Totals) {
        let tiles = film.len().div_ceil(TILE_PIXELS);
        let stopped = AtomicBool::new(false);
        let (mut flow, mut totals) = (ControlFlow::Continue(()), Totals::default());
        rayon::in_place_scope(|scope| {
            let (sender, finished) = mpsc::channel();
            for (tile, pixels) in film.chunks_mut(TILE_PIXELS).enumerate() {
                let (sender, stopped) = (sender.clone(), &stopped);
                scope.spawn(move |_| {
                    if !stopped.load(Ordering::Relaxed) {
                        let counts = self.tile::<METHOD>(tile * TILE_PIXELS, pixels, stopped);
                        // The receiver outlives the scope's tiles; were it gone, no one would want the counts.
                        let _ = sender.send(counts);
                    }
                });
            }
            drop(sender);
            let mut done = 0;
            loop {
                match finished.recv_timeout(PATIENCE) {
                    Ok(counts) => {
                        add(&mut totals, &counts);
                        done += 1;
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => break,
                }
                if flow.is_continue() {
                    flow = progress(done as f32 / tiles as f32);
                    stopped.store(flow.is_break(), Ordering::Relaxed);
                }
            }
        });
        (flow, totals)
    }

    /// Adds the sample to the pixels from number `first` on, until it is stopped; returns the work it took.
    fn tile<const METHOD: u32>(self, first: usize, pixels: &mut [FilmPixel], stopped: &AtomicBool) -> Totals {
        let features = if METHOD == ANY {
            self.features
        } else {
            // The least does nothing, but to the compiler, which leaves out what shows errors.
            let shade = self.features.shade.min(shade::ERROR - 1);
            Features { method: METHOD, shade, ..self.features }
        };
        let width = self.scene.frame.width as usize;
        let mut totals = Totals::default();
        for (i, pixel) in (first..).zip(pixels) {
            if stopped.load(Ordering::Relaxed) {
                break;
            }
            let mut counts = Counts::default();
            let sample = sample_pixel(
                &self.scene,
                features,
                word(i % width),
                word(i / width),
                self.sample,
                &mut counts,
            );
            *pixel = pixel.plus(sample);
            add_counts(&mut totals, counts);
        }
        totals
    }
}

/// Adds a pixel's counts.
fn add_counts(totals: &mut Totals, counts: Counts) {
    for (total, count) in totals.iter_mut().zip(counts.to_array()) {
        *total += u64::from(count);
    }
}

/// Adds a tile's totals.
fn add(totals: &mut Totals, more: &Totals) {
    totals.iter_mut().zip(more).for_each(|(total, count)| *total += count);
}

/// Adds a pass's totals as the Vulkan entry points do: cap hits always, the rest where counting is asked for.
fn add_totals(totals: &mut Totals, more: &Totals, counted: bool) {
    if counted {
        add(totals, more);
    } else {
        totals[counter::CAP_HITS as usize] += more[counter::CAP_HITS as usize];
    }
}

/// A film coordinate; a frame's width and height are `u32`.
#[expect(clippy::cast_possible_truncation, reason = "a coordinate is below the frame's width or height")]
fn word(coordinate: usize) -> u32 {
    coordinate as u32
}

/// An empty film of the frame's size.
fn cleared_film(frame: &Frame) -> Result<Vec<FilmPixel>, BackendError> {
    let pixels = u64::from(frame.width) * u64::from(frame.height);
    let len = usize::try_from(pixels).unwrap_or(usize::MAX);
    let mut film = reserved("the film", len)?;
    film.resize(len, FilmPixel::default());
    Ok(film)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{Job, Scene, load, prepare};
    use crate::scene::{Relief, builtin};
    use crate::settings::{Method, Settings};

    const GOING_ON: ControlFlow<()> = ControlFlow::Continue(());

    fn loaded(width: u32, height: u32, features: Features) -> CpuBackend {
        let camera = emboss_kernels::interface::Camera {
            right: glam::Vec3::X,
            up: glam::Vec3::Y,
            forward: glam::Vec3::NEG_Z,
            ..Default::default()
        };
        let frame = Frame { camera, width, height, seed: 7, ..Frame::default() };
        let mut backend = CpuBackend::new();
        backend.load(&SceneBuffers::default(), &frame, features).expect("fits");
        backend
    }

    fn counting() -> Features {
        Features { counters: 1, method: method::NONE, ..Features::default() }
    }

    #[test]
    fn every_pixel_gets_every_sample() {
        // Wider than a tile, and no multiple of one.
        let mut backend = loaded(1500, 3, counting());
        for sample in 0..4 {
            assert_eq!(backend.add_sample(sample, &mut |_| GOING_ON).expect("runs"), GOING_ON);
        }
        assert!(backend.film.iter().all(|pixel| pixel.samples == 4));
        let totals = backend.totals().expect("counted");
        assert_eq!(totals[counter::PRIMARY_RAYS as usize], 1500 * 3 * 4);
    }

    /// The relief of a built-in scene, framed, brute force.
    fn cube(subdivisions: u32, width: u32, height: u32) -> Job {
        let cube = builtin::load("builtin:cube").expect("built in");
        let scene = Scene {
            mesh: cube.mesh,
            reliefs: vec![Relief::new(cube.height, cube.zero, cube.scale)],
            materials: vec![cube.color.into()],
            parts: vec![],
            subdivisions,
        };
        let method = Method::BruteForce;
        let settings = Settings { width, height, method, counting: true, ..Settings::default() };
        let mut job = prepare(scene, &settings).expect("sound maps");
        load(&mut CpuBackend::new(), &mut job).expect("framed");
        job
    }

    /// Neither tiles nor threads show: the film is what one loop over its pixels gives.
    #[test]
    fn the_film_equals_that_of_a_plain_loop() {
        // Tiles end within rows, the last one early.
        let job = cube(2, 200, 111);
        let mut backend = CpuBackend::new();
        backend.load(&job.buffers, &job.frame, job.features).expect("fits");
        let _ = backend.add_sample(5, &mut |_| GOING_ON);
        let scene = backend.scene.view();
        for (i, pixel) in backend.film.iter().enumerate() {
            let (x, y) = (word(i % 200), word(i / 200));
            let sample = sample_pixel(&scene, job.features, x, y, 5, &mut Counts::default());
            assert_eq!(*pixel, FilmPixel::default().plus(sample), "pixel ({x}, {y})");
        }
        assert!(backend.film.iter().any(|pixel| pixel.alpha > 0.0));
    }

    #[test]
    fn progress_grows_to_one() {
        let mut backend = loaded(640, 48, counting());
        let mut shares = Vec::new();
        let _ = backend.add_sample(0, &mut |share| {
            shares.push(share);
            GOING_ON
        });
        assert_eq!(shares.len(), 30);
        assert!(shares.is_sorted());
        assert_eq!(shares.last(), Some(&1.0));
    }

    /// Tiles here take tens of milliseconds each, far longer than this thread needs to hear of the first: the
    /// break comes while most of the 64 are still to do.
    #[test]
    fn a_break_ends_the_pass_and_keeps_the_film() {
        let job = cube(64, 256, 256);
        let mut backend = CpuBackend::new();
        backend.load(&job.buffers, &job.frame, job.features).expect("fits");
        let flow = backend.add_sample(0, &mut |_| ControlFlow::Break(())).expect("runs");
        assert_eq!(flow, ControlFlow::Break(()));
        let done = backend.film.iter().filter(|pixel| pixel.samples == 1).count();
        assert!(done >= TILE_PIXELS && done < backend.film.len(), "{done} pixels done");
        assert_eq!(backend.totals().expect("counted")[counter::PRIMARY_RAYS as usize], done as u64);
    }

    #[test]
    fn loading_clears_film_and_counters() {
        let mut backend = loaded(16, 16, counting());
        let _ = backend.add_sample(0, &mut |_| GOING_ON);
        let frame = *backend.scene.view().frame;
        backend.load(&SceneBuffers::default(), &frame, counting()).expect("fits");
        assert!(backend.film.iter().all(|pixel| pixel.samples == 0));
        assert_eq!(backend.totals().expect("counted"), Totals::default());
    }

    #[test]
    fn without_counting_only_cap_hits_are_kept() {
        let mut totals = Totals::default();
        add_totals(&mut totals, &[3; counter::COUNT], false);
        let expected = std::array::from_fn(|i| if i == counter::CAP_HITS as usize { 3 } else { 0 });
        assert_eq!(totals, expected);
    }

    #[test]
    fn probes_run_the_kernel_on_each_item() {
        let mut input = vec![0; 2 * probe::IN_STRIDE as usize];
        input[probe::IN_STRIDE as usize] = 5;
        let output = CpuBackend::new().probe(probe::PCG4D, &input, 2).expect("fits");
        let expected = emboss_kernels::sampler::pcg4d(glam::UVec4::new(5, 0, 0, 0)).to_array();
        assert_eq!(output[probe::OUT_STRIDE as usize..][..4], expected);
    }
}

//! A method with its parameter, loaded into a backend: what it shows, and what it takes.

use super::CompareError;
use super::cameras::centre_rays;
use super::metrics::Capture;
use crate::backend::{Backend, BackendError};
use crate::heights::set_heights;
use crate::picture::{linear_from_srgb, srgb_from_linear};
use crate::render::{Job, RenderError, Scene, prepare};
use crate::scene::Relief;
use crate::settings::{Method, Settings, Subdivisions};
use crate::space::RenderSpace;
use crate::stats::Bytes;
use clap::ValueEnum;
use emboss_kernels::interface::{Camera, PointLight, counter};
use emboss_kernels::scene::Features;
use glam::{DMat3, Vec3, Vec4};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// A method with its parameter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Configuration {
    /// The method.
    pub method: Method,
    /// N; `None` where the method has no use for one.
    #[serde(rename = "N")]
    pub n: Option<Subdivisions>,
}

impl Configuration {
    /// Each method with each N, but once where N does not matter.
    pub fn all(methods: &[Method], ns: &[Subdivisions]) -> Vec<Configuration> {
        let of_method = |&method: &Method| match method.parameter() {
            Some(_) => ns.iter().map(|&n| Configuration { method, n: Some(n) }).collect(),
            None => vec![Configuration { method, n: None }],
        };
        methods.iter().flat_map(of_method).collect()
    }

    /// The command line's name of the method.
    pub fn method_name(&self) -> String {
        self.method.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// A name that can be part of a file's.
    pub fn file_name(&self) -> String {
        match self.n {
            Some(n) => format!("{}-{}", self.method_name(), n.to_string().replace(':', "-")),
            None => self.method_name(),
        }
    }
}

impl fmt::Display for Configuration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.n {
            Some(n) => write!(f, "{} N={n}", self.method_name()),
            None => f.write_str(&self.method_name()),
        }
    }
}

/// Where the user's camera and the lights are in render space, whatever is loaded.
#[derive(Clone, Debug)]
pub struct Stage {
    /// The camera.
    pub camera: Camera,
    /// What is in the middle of its picture.
    pub target: Vec3,
    /// The lights.
    pub lights: Vec<PointLight>,
}

/// Is asked between parts of a pass whether to go on.
pub type Watch<'a> = &'a mut dyn FnMut() -> ControlFlow<()>;

/// A configuration in a backend.
pub struct Subject<'a> {
    backend: &'a mut dyn Backend,
    job: Job,
    reliefs: Vec<Relief>,
    /// Whether heights are read at all.
    displaces: bool,
    /// From the scene to what rays can be traced in: maps, heights, the BVH. Pipelines are not part of it: those of the
    /// configuration before may be there still.
    pub preparation: Duration,
    /// Where the camera is.
    pub stage: Stage,
}

/// Memory in bytes, by what it is for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Memory {
    /// The BVH.
    pub bvh: u64,
    /// What is made of the height maps for rays to skip what they cannot meet: min/max pyramids, distance maps.
    pub trees: u64,
    /// Height maps, and maps of normals or of offsets.
    pub maps: u64,
    /// Everything that a frame needs but the film and the colour maps, these three included.
    pub all: u64,
}

/// The code of the pipeline that traces a configuration's rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Code {
    /// Instructions of SPIR-V.
    pub instructions: u32,
    /// The whole module.
    pub bytes: u64,
}

impl<'a> Subject<'a> {
    /// Loads a configuration of a scene. Without a stage the camera is as `settings` ask.
    pub fn load(
        backend: &'a mut dyn Backend,
        scene: &Scene,
        settings: &Settings,
        configuration: Configuration,
        stage: Option<&Stage>,
    ) -> Result<Subject<'a>, RenderError> {
        let mut settings = Settings { method: configuration.method, ..settings.clone() };
        let mut scene = scene.clone();
        if let Some(n) = configuration.n {
            (settings.adaptive, scene.subdivisions) = (n.pixels(), n.most());
        } else {
            settings.adaptive = None;
        }
        let reliefs = scene.reliefs.clone();
        let (start, compiled) = (Instant::now(), backend.compile_time());
        let mut job = prepare(scene, &settings)?;
        backend.load(&job.buffers, &job.frame, job.features)?;
        let preparation = start.elapsed().saturating_sub(backend.compile_time() - compiled);
        let stage = match stage {
            Some(stage) => stage.clone(),
            None => {
                let framing = job.frame_view(&backend.prism_boxes()?)?;
                let lights = job.buffers.lights.clone();
                Stage { camera: framing.camera, target: framing.target, lights }
            }
        };
        job.frame.light_count = u32::try_from(stage.lights.len()).unwrap_or(u32::MAX);
        job.buffers.lights.clone_from(&stage.lights);
        let displaces = settings.displaces();
        let mut subject = Subject { backend, job, reliefs, displaces, preparation, stage };
        subject.look(subject.stage.camera)?;
        Ok(subject)
    }

    /// Clears the film for a camera.
    fn look(&mut self, camera: Camera) -> Result<(), BackendError> {
        self.job.frame.camera = camera;
        self.backend.set_view(&self.job.frame, &self.job.buffers.lights)
    }

    /// How high the relief rises, at most.
    pub fn lift(&self) -> f32 {
        self.job.frame.height_max.max(0.0)
    }

    /// Width and height of the film in pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.job.frame.width, self.job.frame.height)
    }

    /// The picture that a camera takes, as a PNG of 8 bits has it: so anyone can compare the files with other tools,
    /// and what rounding alone makes different is not. Where nothing is hit it is grey: black would hide what is
    /// missing from shadows, white what is missing from lights.
    pub fn picture(
        &mut self,
        camera: Camera,
        samples: u32,
        watch: Watch<'_>,
    ) -> Result<Vec<Vec3>, CompareError> {
        self.look(camera)?;
        self.add_samples(samples, watch)?;
        let quantized = |linear: f32| linear_from_srgb((srgb_from_linear(linear) * 255.0).round() / 255.0);
        let pixel = |pixel: Vec4| (pixel.truncate() + BACKGROUND * (1.0 - pixel.w)).map(quantized);
        Ok(self.backend.resolve()?.into_iter().map(pixel).collect())
    }

    /// What the rays through the centres of a camera's pixels hit.
    pub fn hits(&mut self, camera: Camera) -> Result<Capture, CompareError> {
        self.look(camera)?;
        let (width, height) = self.size();
        let hits = self.backend.trace_rays(&centre_rays(&camera, width, height))?;
        Ok(Capture { colors: Vec::new(), hits, width: width as usize })
    }

    /// Both.
    pub fn capture(
        &mut self,
        camera: Camera,
        samples: u32,
        watch: Watch<'_>,
    ) -> Result<Capture, CompareError> {
        let colors = self.picture(camera, samples, watch)?;
        Ok(Capture { colors, ..self.hits(camera)? })
    }

    fn add_samples(&mut self, samples: u32, watch: Watch<'_>) -> Result<(), CompareError> {
        for sample in 0..samples {
            if self.backend.add_sample(sample, &mut |_| watch())?.is_break() {
                return Err(CompareError::Interrupted);
            }
        }
        Ok(())
    }

    /// Milliseconds of frames from the stage's camera, by the device's clock where it has one, after one that warms
    /// caches: at least three in a twentieth of a second, unless they take more than a quarter.
    pub fn frame_ms(&mut self, samples: u32, watch: Watch<'_>) -> Result<Vec<f64>, CompareError> {
        const FRAMES: usize = 3;
        const ENOUGH: Duration = Duration::from_millis(50);
        const MOST: Duration = Duration::from_millis(250);
        self.look(self.stage.camera)?;
        self.add_samples(1, watch)?;
        let (begin, mut frames) = (Instant::now(), Vec::new());
        let goes_on = |frames: usize| {
            let elapsed = begin.elapsed();
            frames == 0 || elapsed < ENOUGH || (frames < FRAMES && elapsed < MOST)
        };
        while goes_on(frames.len()) {
            self.look(self.stage.camera)?;
            let start = Instant::now();
            self.add_samples(samples, watch)?;
            let elapsed = milliseconds(start.elapsed());
            frames.push(self.backend.device_ms().unwrap_or(elapsed));
        }
        Ok(frames)
    }

    /// Rays of a frame from the stage's camera, those to lights included.
    pub fn rays(&mut self, samples: u32, watch: Watch<'_>) -> Result<u64, CompareError> {
        let features = self.job.features;
        self.backend.set_features(Features { counters: 1, ..features })?;
        self.look(self.stage.camera)?;
        self.add_samples(samples, watch)?;
        let totals = self.backend.totals()?;
        self.backend.set_features(features)?;
        Ok(totals[counter::PRIMARY_RAYS as usize] + totals[counter::SHADOW_RAYS as usize])
    }

    /// Milliseconds from other heights, all scales a tenth greater, to the first correct frame. The subject has them
    /// from then on.
    pub fn edit_ms(&mut self, watch: Watch<'_>) -> Result<f64, CompareError> {
        for (displacement, relief) in self.job.buffers.displacements.iter_mut().zip(&self.reliefs) {
            let relief = Relief { scale: EDIT_FACTOR * relief.scale, ..relief.clone() };
            set_heights(displacement, &relief, self.displaces);
        }
        let start = Instant::now();
        self.backend.set_displacements(&self.job.buffers.displacements)?;
        self.add_samples(1, watch)?;
        self.backend.resolve()?;
        Ok(milliseconds(start.elapsed()))
    }

    /// What it has in memory.
    pub fn memory(&self) -> Memory {
        let bytes = Bytes::new(&self.job, self.backend.build_report());
        let (trees, maps) = (bytes.trees(), bytes.maps());
        Memory { bvh: bytes.bvh(), trees, maps, all: bytes.without_pictures() }
    }

    /// The code that makes its pictures; `None` on the CPU backend.
    pub fn code(&self) -> Option<Code> {
        let code = self.backend.pipelines().into_iter().find(|code| code.kernel == "render")?;
        Some(Code { instructions: code.instructions, bytes: code.bytes })
    }

    /// The space that its cameras, its lights and what rays hit are in.
    pub fn space(&self) -> RenderSpace {
        self.job.space
    }

    /// The mean length of the base mesh's edges, in its places, in render space; above 0 even where all are points,
    /// since errors are divided by it.
    pub fn edge_length(&self) -> f64 {
        let buffers = &self.job.buffers;
        let lengths = buffers.triangles.iter().flat_map(|triangle| {
            let [a, b, c] = triangle.vertices.map(|v| buffers.vertices[v as usize].position.as_dvec3());
            [a.distance(b), b.distance(c), c.distance(a)]
        });
        let mean = super::metrics::mean(&lengths.collect::<Vec<_>>());
        let scales = buffers.instances.iter().map(|instance| {
            let columns = instance.world_from_object.map(|row| Vec3::from_slice(&row).as_dvec3());
            DMat3::from_cols(columns[0], columns[1], columns[2]).determinant().abs().cbrt()
        });
        let scale = super::metrics::mean(&scales.collect::<Vec<_>>());
        let edge = if buffers.instances.is_empty() { mean } else { mean * scale };
        edge.max(f64::MIN_POSITIVE)
    }
}

/// What an edit multiplies all scales by.
pub const EDIT_FACTOR: f32 = 1.1;

/// What is behind the surface: the sRGB code 128 of 255, in linear RGB.
const BACKGROUND: Vec3 = Vec3::splat(0.215_861);

/// A time in milliseconds.
pub fn milliseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_without_a_parameter_stand_once() {
        let ns = [4, 16].map(Subdivisions::Fixed);
        let all = Configuration::all(&[Method::GridWalk, Method::None], &ns);
        let names: Vec<_> = all.iter().map(Configuration::to_string).collect();
        assert_eq!(names, ["grid-walk N=4", "grid-walk N=16", "none"]);
        let auto = Configuration { method: Method::Quadtree, n: Some(Subdivisions::Auto { pixels: 0.5 }) };
        assert_eq!(auto.file_name(), "quadtree-auto-0.5");
    }
}

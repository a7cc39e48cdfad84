use super::*;
use crate::backend::select::BackendChoice;
use crate::backend::{BuildReport, DeviceInfo, SceneBuffers, Totals};
use crate::bvh::Bvh;
use crate::render::Scene;
use crate::scene::{HeightMap, Mesh, Relief};
use crate::settings::{Settings, Shade, Wrap};
use crate::view::{Loaded, Pose};
use emboss_kernels::interface::{Displacement, Intersection, NO_SEAMS, PointLight, Ray, Triangle, Vertex};
use emboss_kernels::scene::Features;
use glam::{DVec3, Vec2, Vec3, Vec4};
use std::sync::mpsc::{Receiver, channel};

/// Long enough for a busy machine; only a failure takes it.
const LONG: Duration = Duration::from_secs(60);

/// Where a [`Faulty`] backend fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    Nowhere,
    Load,
    /// The sample of this number.
    Sample(u32),
    Resolve,
    Heights,
    /// Loading a scene of this N, for want of memory.
    LargeN(u32),
    /// Other heights, for want of memory.
    MoreHeights,
    /// Smooth shading, which the driver does not compile.
    Smooth,
    /// A panic in the sample of this number.
    Panic(u32),
}

/// The CPU, with a fault.
struct Faulty {
    cpu: CpuBackend,
    fault: Fault,
}

impl Faulty {
    fn refused_if(&self, is_refused: bool) -> Result<(), BackendError> {
        let reason = "a fault".to_owned();
        let refused = BackendError::Allocation { name: "what is new", bytes: 1, reason };
        if is_refused { Err(refused) } else { Ok(()) }
    }

    fn lost_if(&self, is_lost: bool) -> Result<(), BackendError> {
        let lost = BackendError::DeviceLost { device: "Card".to_owned(), what: "tracing" };
        if is_lost { Err(lost) } else { Ok(()) }
    }
}

impl Backend for Faulty {
    fn device(&self) -> &DeviceInfo {
        self.cpu.device()
    }

    fn load(&mut self, scene: &SceneBuffers, frame: &Frame, features: Features) -> Result<(), BackendError> {
        self.lost_if(self.fault == Fault::Load)?;
        self.refused_if(self.fault == Fault::LargeN(frame.subdivisions))?;
        self.cpu.load(scene, frame, features)
    }

    fn build_report(&self) -> BuildReport {
        self.cpu.build_report()
    }

    fn prism_boxes(&mut self) -> Result<Vec<Aabb>, BackendError> {
        self.cpu.prism_boxes()
    }

    fn bvh(&mut self) -> Result<Bvh, BackendError> {
        self.cpu.bvh()
    }

    fn distance_maps(&mut self) -> Result<Vec<f32>, BackendError> {
        self.cpu.distance_maps()
    }

    fn set_view(&mut self, frame: &Frame, lights: &[PointLight]) -> Result<(), BackendError> {
        self.cpu.set_view(frame, lights)
    }

    fn set_displacements(&mut self, displacements: &[Displacement]) -> Result<(), BackendError> {
        self.lost_if(self.fault == Fault::Heights)?;
        if self.fault == Fault::MoreHeights {
            // As a device that loses the scene on the way.
            self.cpu = CpuBackend::new();
        }
        self.refused_if(self.fault == Fault::MoreHeights)?;
        self.cpu.set_displacements(displacements)
    }

    fn set_features(&mut self, features: Features) -> Result<(), BackendError> {
        self.refused_if(self.fault == Fault::Smooth && features.smooth != 0)?;
        self.cpu.set_features(features)
    }

    fn add_sample(
        &mut self,
        sample: u32,
        progress: &mut dyn FnMut(f32) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>, BackendError> {
        self.lost_if(self.fault == Fault::Sample(sample))?;
        assert_ne!(self.fault, Fault::Panic(sample), "a fault");
        self.cpu.add_sample(sample, progress)
    }

    fn resolve(&mut self) -> Result<Vec<Vec4>, BackendError> {
        self.lost_if(self.fault == Fault::Resolve)?;
        self.cpu.resolve()
    }

    fn totals(&mut self) -> Result<Totals, BackendError> {
        self.cpu.totals()
    }

    fn device_ms(&mut self) -> Option<f64> {
        self.cpu.device_ms()
    }

    fn trace_rays(&mut self, rays: &[Ray]) -> Result<Vec<Intersection>, BackendError> {
        self.cpu.trace_rays(rays)
    }

    fn probe(&mut self, kernel: u32, input: &[u32], count: u32) -> Result<Vec<u32>, BackendError> {
        self.cpu.probe(kernel, input, count)
    }
}

/// A triangle under a map, one of whose texels was no number; it cannot be read with the zero [`UNREADABLE`].
struct OneTriangle;

const UNREADABLE: f32 = 0.125;

impl Source for OneTriangle {
    fn read(&self, zero: Option<f32>) -> Result<Loaded, Unread> {
        if zero == Some(UNREADABLE) {
            return Err(Unread { error: "a wrong file".into(), file: None });
        }
        let corner = |uv: Vec2| Vertex { position: uv.extend(0.0), normal: Vec3::Z, u: uv.x, v: uv.y };
        let mut mesh = Mesh::default();
        mesh.vertices.extend([Vec2::ZERO, Vec2::X, Vec2::Y].map(corner));
        mesh.triangles.push(Triangle { vertices: [0, 1, 2], seams: NO_SEAMS, ..Triangle::default() });
        let map = HeightMap { replaced: 1, ..HeightMap::flat(0.5) };
        let reliefs = vec![Relief::new(map, zero.unwrap_or(0.5), 0.1)];
        let scene =
            Scene { mesh, reliefs, materials: vec![Default::default()], parts: vec![], subdivisions: 4 };
        let settings = Settings::default();
        let (exaggeration, scale, files) = (1.0, None, vec![]);
        let has_own_subdivisions = false;
        Ok(Loaded { scene, settings, is_displaced: true, exaggeration, scale, has_own_subdivisions, files })
    }

    fn command(&self, shot: &Shot<'_>) -> String {
        format!("{:?} {:?}", shot.engine.backend, shot.output)
    }
}

/// The same triangle in another place, as an instance.
struct Elsewhere;

impl Source for Elsewhere {
    fn read(&self, zero: Option<f32>) -> Result<Loaded, Unread> {
        let mut loaded = OneTriangle.read(zero)?;
        let places = vec![glam::DAffine3::from_translation(glam::DVec3::new(10.0, 20.0, 30.0))];
        loaded.scene.parts = vec![crate::instances::Part { triangle_count: 1, places }];
        Ok(loaded)
    }

    fn command(&self, _: &Shot<'_>) -> String {
        String::new()
    }
}

/// A thread, and what it tells.
struct Thread {
    handle: Handle,
    reports: Receiver<Report>,
    serial: u64,
}

impl Thread {
    fn start(start: Start, is_replaceable: bool) -> Thread {
        Thread::of(Arc::new(OneTriangle), start, is_replaceable)
    }

    fn of(source: Arc<dyn Source>, start: Start, is_replaceable: bool) -> Thread {
        let (sender, reports) = channel();
        let handle = Handle::start(Setup {
            start,
            engine: Engine { backend: BackendChoice::Vulkan, device: None },
            is_replaceable,
            reading: Reading::start(&source),
            source,
            samples: 2,
            output: Destination::new("a.png".into()).expect("a picture"),
            report: Arc::new(move |report| drop(sender.send(report))),
        });
        Thread { handle, reports, serial: 0 }
    }

    fn with(fault: Fault) -> Thread {
        Thread::start(Box::new(move || Ok(Box::new(Faulty { cpu: CpuBackend::new(), fault }))), false)
    }

    fn want(&mut self, tuning: &Tuning, size: (u32, u32)) {
        self.serial += 1;
        self.handle.want(Wanted { serial: self.serial, tuning: tuning.clone(), size });
    }

    /// Waits for a report that `is_it` takes.
    fn hear<T>(&self, mut is_it: impl FnMut(Report) -> Option<T>) -> T {
        let end = Instant::now() + LONG;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            if let Some(it) = is_it(self.reports.recv_timeout(left).expect("a report")) {
                return it;
            }
        }
    }

    /// Waits until all samples of what was wanted last are seen.
    fn see(&self) -> Box<Seen> {
        self.hear(|report| match report {
            Report::Seen(seen) if seen.serial == self.serial && seen.samples == 2 => Some(seen),
            Report::Refused(error) => panic!("{error}"),
            Report::Lost(failure) => panic!("{failure}"),
            _ => None,
        })
    }

    fn lost(&self) -> Failure {
        self.hear(|report| if let Report::Lost(failure) = report { Some(*failure) } else { None })
    }

    fn kept(&self) -> [Tuning; 2] {
        self.hear(|report| if let Report::Kept(tunings) = report { Some(*tunings) } else { None })
    }
}

#[test]
fn slow_devices_begin_with_fewer_pixels() {
    assert_eq!(level(1e-9, (1000, 1000)), 0);
    // 1 s for all: a quarter of a quarter of a quarter is 16 ms.
    assert_eq!(level(1e-6, (1000, 1000)), 3);
    assert_eq!(level(1.0, (1000, 1000)), LEAST_LEVEL);
}

/// As `emboss render` frames them.
#[test]
fn instances_are_framed_in_their_places() {
    let mut thread = Thread::of(Arc::new(Elsewhere), Box::new(|| Ok(Box::new(CpuBackend::new()))), false);
    thread.want(&Tuning::default(), (16, 12));
    let framing = thread.see().framing;
    let loaded = Elsewhere.read(None).expect("made by code");
    let settings = Settings { width: 16, height: 12, ..loaded.settings };
    let mut job = crate::render::prepare(loaded.scene, &settings).expect("sound");
    let mut backend = CpuBackend::new();
    crate::render::load(&mut backend, &mut job).expect("it fits");
    assert_eq!(framing.camera, job.frame.camera);
}

/// A picture that shows nothing is told of once, until there was another one.
#[test]
fn useless_pictures_are_told_once() {
    let mut thread = Thread::start(Box::new(|| Ok(Box::new(CpuBackend::new()))), false);
    // The messages until the picture is whole and was looked at, and a setting has come after it.
    let told = |thread: &mut Thread, target: DVec3, fov: f32| {
        let pose = Pose { eye: DVec3::new(0.2, 0.2, 5.0), target, up: DVec3::Y, fov };
        thread.want(&Tuning { pose: Some(pose), ..Tuning::default() }, (16, 12));
        let mut messages = 0;
        thread.hear(|report| match report {
            Report::Message(message) => {
                messages +=
                    u32::from(message.contains("the picture is empty: the model is behind the camera"));
                None
            }
            Report::Seen(seen) if seen.serial == thread.serial && seen.samples == 2 => Some(()),
            _ => None,
        });
        messages
    };
    let (at, away) = (DVec3::new(0.2, 0.2, 0.0), DVec3::new(0.2, 0.2, 9.0));
    let views = [(at, 30.0), (away, 30.0), (away, 40.0), (at, 30.0), (at, 40.0), (away, 30.0), (at, 30.0)];
    let counts = views.map(|(target, fov)| told(&mut thread, target, fov));
    // What a picture is told of comes after it.
    assert_eq!(counts, [0, 0, 1, 0, 0, 0, 1]);
}

#[test]
fn pictures_never_replace_each_other() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.png");
    let mut names = vec![];
    for _ in 0..3 {
        let name = free_name(&path);
        std::fs::write(&name, "").expect("writable");
        names.push(name.file_name().expect("a file").to_owned());
    }
    assert_eq!(names, ["a.png", "a-1.png", "a-2.png"]);
}

/// Wherever it happens: while the scene is loaded, in the first pass, later, and when heights change.
#[test]
fn lost_device_ends_with_one_message() {
    for fault in [Fault::Load, Fault::Sample(0), Fault::Sample(1), Fault::Resolve, Fault::Heights] {
        let mut thread = Thread::with(fault);
        thread.want(&Tuning::default(), (16, 12));
        if fault == Fault::Heights {
            thread.see();
            thread.want(&Tuning { exaggeration: Some(2.0), ..Tuning::default() }, (16, 12));
        }
        let failure = thread.lost().to_string();
        assert!(failure.starts_with("Card was lost while tracing"), "{fault:?}: {failure}");
        assert!(thread.reports.recv_timeout(LONG).is_err(), "{fault:?}: it has ended");
    }
}

/// A defect of the renderer closes the window too.
#[test]
fn panic_is_told() {
    let mut thread = Thread::with(Fault::Panic(1));
    thread.want(&Tuning::default(), (16, 12));
    let failure = thread.lost().to_string();
    assert!(failure.contains("a fault") && failure.contains("report it"), "{failure}");
}

#[test]
fn cpu_stands_for_a_device_that_was_not_asked_for() {
    let unusable = || -> Start { Box::new(|| Err(BackendError::NoDevice { reason: "a fault".to_owned() })) };
    let mut thread = Thread::start(unusable(), true);
    thread.want(&Tuning::default(), (16, 12));
    thread.hear(|report| matches!(report, Report::Replaced).then_some(()));
    thread.see();
    let mut thread = Thread::start(unusable(), false);
    thread.want(&Tuning::default(), (16, 12));
    thread.hear(|report| matches!(report, Report::Refused(_)).then_some(()));
}

/// The window learns what is no longer wanted, the camera goes on, and the next picture has the old N.
#[test]
fn what_cannot_be_loaded_is_taken_back() {
    let mut thread = Thread::with(Fault::LargeN(64));
    let before = Tuning { wrap: Some(Wrap::Clamp), ..Tuning::default() };
    thread.want(&before, (16, 12));
    thread.see();
    let refused =
        Tuning { subdivisions: Some(Subdivisions::Fixed(64)), shade: Some(Shade::Normal), ..before.clone() };
    thread.want(&refused, (16, 12));
    let kept = before.with_colors_of(&refused);
    assert_eq!(thread.kept(), [refused.clone(), kept.clone()]);
    thread.see();
    let mut tuning = refused.clone();
    tuning.take_back(&refused, &kept);
    assert_eq!(tuning, Tuning { shade: Some(Shade::Normal), ..before });
    thread.want(&tuning, (16, 12));
    thread.see();
    assert!(
        thread.reports.try_iter().all(|report| !matches!(report, Report::Kept(_))),
        "it is not tried again"
    );
}

/// So are a scale and a way to shade that the device refuses: the picture is again what it was, and the window shows
/// the settings that it has.
#[test]
fn refused_settings_are_taken_back() {
    let kept = Tuning { exaggeration: Some(1.5), shadows: Some(false), ..Tuning::default() };
    let taller = Tuning { exaggeration: Some(2.0), ..kept.clone() };
    let smooth = Tuning { smooth: Some(true), ..kept.clone() };
    for (fault, refused) in [(Fault::MoreHeights, taller), (Fault::Smooth, smooth)] {
        let mut thread = Thread::with(fault);
        thread.want(&kept, (16, 12));
        let before = thread.see();
        thread.want(&refused, (16, 12));
        let message =
            thread.hear(|report| if let Report::Message(text) = report { Some(text) } else { None });
        assert!(message.starts_with("the scene stays as it was: "), "{fault:?}: {message}");
        let mut tuning = refused.clone();
        let [refused, again] = thread.kept();
        tuning.take_back(&refused, &again);
        assert_eq!(tuning, kept, "{fault:?}");
        assert!(thread.see().canvas.texels == before.canvas.texels, "{fault:?}");
    }
}

/// Another size and another zero at once, with which the files cannot be read: the picture has the new size all the
/// same.
#[test]
fn size_is_taken_though_files_cannot_be_read() {
    let mut thread = Thread::with(Fault::Nowhere);
    thread.want(&Tuning::default(), (16, 12));
    thread.see();
    thread.want(&Tuning { zero: Some(UNREADABLE), ..Tuning::default() }, (40, 30));
    assert_eq!(thread.kept()[1].zero, None);
    let seen = thread.see();
    assert_eq!((seen.canvas.width, seen.canvas.height, seen.canvas.texels.len()), (40, 30, 1200));
}

/// Nobody sees it: no sample is added, and none is lost.
#[test]
fn hidden_picture_waits() {
    let mut thread = Thread::with(Fault::Nowhere);
    thread.handle.hide(true);
    thread.want(&Tuning::default(), (16, 12));
    // The first picture is made ready, and waits for the next order.
    thread.hear(|report| matches!(report, Report::Loaded(_)).then_some(()));
    assert!(thread.reports.recv_timeout(Duration::from_millis(200)).is_err());
    thread.handle.hide(false);
    thread.see();
}

/// The scene comes when its files have changed, and a thread that reads it does not keep the viewer from ending.
#[test]
fn viewer_ends_while_the_scene_is_read() {
    struct Never;
    impl Source for Never {
        fn read(&self, _: Option<f32>) -> Result<Loaded, Unread> {
            std::thread::sleep(LONG);
            Err(Unread { error: "too late".into(), file: None })
        }

        fn command(&self, _: &Shot<'_>) -> String {
            String::new()
        }
    }
    let (started, is_started) = channel();
    let source: Arc<dyn Source> = Arc::new(Never);
    let mut thread = Thread::with(Fault::Nowhere);
    thread.handle = Handle::start(Setup {
        start: Box::new(move || {
            started.send(()).expect("heard");
            Ok(Box::new(CpuBackend::new()))
        }),
        engine: Engine::CPU,
        is_replaceable: false,
        reading: Reading::start(&source),
        source,
        samples: 1,
        output: Destination::new("a.png".into()).expect("a picture"),
        report: Arc::new(|_| {}),
    });
    thread.want(&Tuning::default(), (16, 12));
    // From here on it waits for the scene.
    is_started.recv_timeout(LONG).expect("a start");
    let start = Instant::now();
    drop(thread);
    assert!(start.elapsed() < LONG / 2);
}

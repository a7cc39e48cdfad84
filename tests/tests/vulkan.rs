//! The Vulkan backend on lavapipe. In each test any message of the validation layers is a failure.

use emboss::backend::vulkan::{Selection, VulkanBackend, devices};
use emboss::backend::{Backend, BackendError, DeviceInfo, DeviceKind, SceneBuffers};
use emboss_kernels::interface::{
    Camera, Displacement, Frame, MISS, Material, PointLight, Ray, SeamSide, Seams, Tangent, Triangle, Vertex,
    counter,
};
use emboss_kernels::probe::{IN_STRIDE, OUT_STRIDE, PCG4D};
use emboss_kernels::sampler::pcg4d;
use emboss_kernels::scene::Features;
use emboss_tests::{finish, lavapipe};
use glam::{UVec4, Vec3, Vec4};
use std::ops::ControlFlow;
use std::time::Instant;

/// Index of the primary rays in the totals.
const PRIMARY_RAYS: usize = counter::PRIMARY_RAYS as usize;

/// A frame over an empty scene, with a camera that looks along -z.
fn frame(width: u32, height: u32) -> Frame {
    let camera = Camera { right: Vec3::X, up: Vec3::Y, forward: Vec3::NEG_Z, ..Camera::default() };
    Frame { camera, width, height, ..Frame::default() }
}

/// With work counted.
fn counting() -> Features {
    Features { counters: 1, ..Features::default() }
}

/// The devices of this machine, lavapipe among them.
fn devices_with_lavapipe() -> Vec<DeviceInfo> {
    let remedy = "`cargo xtask test` installs lavapipe";
    let devices = devices().expect(remedy);
    assert!(devices.iter().any(|device| device.name.contains("llvmpipe")), "{remedy}: {devices:?}");
    devices
}

/// Adds sample number `sample` to all of the film.
fn add_sample(backend: &mut VulkanBackend, sample: u32) {
    let flow = backend.add_sample(sample, &mut |_| ControlFlow::Continue(())).unwrap();
    assert_eq!(flow, ControlFlow::Continue(()));
}

/// Asserts that each pixel of the film has `samples` samples.
fn assert_samples(backend: &mut VulkanBackend, samples: u32) {
    for (pixel, sum) in backend.film().unwrap().iter().enumerate() {
        assert_eq!(sum.samples, samples, "pixel {pixel}");
    }
}

#[test]
fn every_pixel_gets_each_sample_once() {
    let mut backend = lavapipe();
    for (width, height) in [(1, 1), (7, 3), (8, 8), (257, 129), (600, 500)] {
        backend.load(&SceneBuffers::default(), &frame(width, height), counting()).unwrap();
        // The first pass is cut into parts, the later ones by what was measured.
        for sample in 0..3 {
            add_sample(&mut backend, sample);
        }
        let pixels = u64::from(width * height);
        assert_eq!(backend.film().unwrap().len() as u64, pixels);
        assert_samples(&mut backend, 3);
        assert_eq!(backend.totals().unwrap()[PRIMARY_RAYS], 3 * pixels, "{width}x{height}");
    }
    finish(backend);
}

#[test]
fn first_pass_begins_with_a_small_part() {
    let mut backend = lavapipe();
    backend.load(&SceneBuffers::default(), &frame(600, 500), counting()).unwrap();
    let mut shares = Vec::new();
    let flow = backend.add_sample(0, &mut |share| {
        shares.push(share);
        ControlFlow::Continue(())
    });
    assert_eq!(flow.unwrap(), ControlFlow::Continue(()));
    // Parts grow eight times at the most: 16 tiles, 128, 1024, and so on to 8192.
    assert!(shares.len() >= 4 && shares[0] < 0.01, "{shares:?}");
    assert!(shares.is_sorted() && shares.last() == Some(&1.0), "{shares:?}");
    finish(backend);
}

#[test]
fn device_time_is_that_of_the_samples_since_load() {
    let mut backend = lavapipe();
    backend.load(&SceneBuffers::default(), &frame(600, 500), counting()).unwrap();
    assert_eq!(backend.device_ms(), Some(0.0));
    let start = Instant::now();
    add_sample(&mut backend, 0);
    let first_ms = backend.device_ms().unwrap();
    add_sample(&mut backend, 1);
    let both_ms = backend.device_ms().unwrap();
    let elapsed_ms = start.elapsed().as_secs_f64() * 1e3;
    assert!(0.0 < first_ms && first_ms < both_ms, "{first_ms} {both_ms}");
    assert!(both_ms < elapsed_ms, "{both_ms} of {elapsed_ms}");
    backend.resolve().unwrap();
    assert_eq!(backend.device_ms(), Some(both_ms), "resolving is not part of the samples");
    backend.load(&SceneBuffers::default(), &frame(8, 8), counting()).unwrap();
    assert_eq!(backend.device_ms(), Some(0.0));
    finish(backend);
}

#[test]
fn break_keeps_the_tiles_so_far() {
    let mut backend = lavapipe();
    backend.load(&SceneBuffers::default(), &frame(256, 128), counting()).unwrap();
    let flow = backend.add_sample(0, &mut |_| ControlFlow::Break(()));
    assert_eq!(flow.unwrap(), ControlFlow::Break(()));
    let samples: Vec<_> = backend.film().unwrap().iter().map(|sum| sum.samples).collect();
    assert!(samples.iter().all(|&n| n <= 1));
    // The first part's 16 tiles are spread: one in each square of 32 x 64 pixels.
    let mut squares = [0; 16];
    samples.iter().enumerate().for_each(|(i, n)| squares[i / 256 / 64 * 8 + i % 256 / 32] += n);
    assert_eq!(squares, [64; 16]);
    finish(backend);
}

#[test]
fn resolve_is_the_mean_of_the_film_over_the_background() {
    let mut backend = lavapipe();
    let background = Vec3::new(0.25, 0.5, 0.75);
    // The film, 10 MiB, is longer than the staging buffer.
    let frame = Frame { background, background_alpha: 1.0, ..frame(1024, 512) };
    backend.load(&SceneBuffers::default(), &frame, counting()).unwrap();
    let unlit = backend.resolve().unwrap();
    assert!(unlit.iter().all(|&pixel| pixel == background.extend(1.0)), "no sample: the background");
    add_sample(&mut backend, 0);
    add_sample(&mut backend, 1);
    let expected: Vec<Vec4> = backend.film().unwrap().iter().map(|sum| sum.resolve(&frame)).collect();
    let picture = backend.resolve().unwrap();
    assert_eq!(picture.len(), expected.len());
    for (pixel, (&device, &host)) in picture.iter().zip(&expected).enumerate() {
        // Two products and two sums of values in [0, 1], of which the device may contract some: each rounds by
        // at most half an ulp of 2, which is one epsilon.
        assert!((device - host).abs().max_element() <= 4.0 * f32::EPSILON, "{pixel}: {device} {host}");
    }
    finish(backend);
}

#[test]
fn samples_are_the_same_after_a_second_load() {
    let mut backend = lavapipe();
    let film = |backend: &mut VulkanBackend| {
        backend.load(&SceneBuffers::default(), &frame(40, 30), Features::default()).unwrap();
        assert_samples(backend, 0);
        add_sample(backend, 7);
        backend.film().unwrap()
    };
    let first = film(&mut backend);
    // Another size and other features in between: buffers and pipelines are made anew.
    backend.load(&SceneBuffers::default(), &frame(100, 10), counting()).unwrap();
    add_sample(&mut backend, 0);
    assert_eq!(backend.totals().unwrap()[PRIMARY_RAYS], 1000);
    assert_eq!(film(&mut backend), first);
    assert_eq!(backend.totals().unwrap()[PRIMARY_RAYS], 0, "load clears the counters");
    finish(backend);
}

#[test]
fn scene_with_every_buffer_loads() {
    let mut backend = lavapipe();
    let scene = SceneBuffers {
        vertices: vec![Vertex::default(); 3],
        triangles: vec![Triangle { vertices: [0, 1, 2], ..Triangle::default() }],
        displacements: vec![Displacement::default()],
        seams: vec![Seams::default()],
        seam_sides: vec![SeamSide::default()],
        // 20 MiB: more than one piece of the staging buffer.
        height_texels: vec![0; 5 << 20],
        color_texels: vec![0; 1024],
        materials: vec![Material::default()],
        normal_texels: vec![],
        distances: vec![],
        instances: vec![],
        lights: vec![PointLight::default()],
        tangents: vec![Tangent::default(); 3],
        texel_scales: vec![],
    };
    // `triangle_count` stays 0, so that nothing of this is read.
    backend.load(&scene, &frame(16, 16), Features::default()).unwrap();
    add_sample(&mut backend, 0);
    assert_samples(&mut backend, 1);
    finish(backend);
}

#[test]
fn new_backend_holds_an_empty_film() {
    let mut backend = lavapipe();
    add_sample(&mut backend, 0);
    assert!(backend.resolve().unwrap().is_empty());
    assert!(backend.film().unwrap().is_empty());
    assert!(backend.totals().unwrap().iter().all(|&total| total == 0));
    assert!(backend.trace_rays(&[]).unwrap().is_empty());
    assert!(backend.probe(PCG4D, &[], 0).unwrap().is_empty());
    finish(backend);
}

#[test]
fn rays_through_an_empty_scene_all_miss() {
    let mut backend = lavapipe();
    backend.load(&SceneBuffers::default(), &frame(1, 1), counting()).unwrap();
    // More than are on the device at a time, and no multiple of a workgroup.
    let ray = Ray { direction: Vec3::Z, t_max: 1.0, ..Ray::default() };
    let rays = vec![ray; (1 << 18) + 1001];
    let hits = backend.trace_rays(&rays).unwrap();
    assert_eq!(hits.len(), rays.len());
    assert!(hits.iter().all(|hit| hit.primitive == MISS));
    assert_eq!(backend.totals().unwrap()[PRIMARY_RAYS], rays.len() as u64);
    finish(backend);
}

#[test]
fn pcg4d_gives_the_bits_of_the_cpu() {
    let mut backend = lavapipe();
    // 12.8 MB of input: more than one piece of the staging buffer.
    let count: u32 = 100_003;
    let argument = |i: u32| pcg4d(UVec4::new(i, !i, i << 7, 1));
    let mut input = vec![0; (count * IN_STRIDE) as usize];
    for (i, words) in (0..count).zip(input.chunks_mut(IN_STRIDE as usize)) {
        words[..4].copy_from_slice(&argument(i).to_array());
    }
    let output = backend.probe(PCG4D, &input, count).unwrap();
    assert_eq!(output.len(), (count * OUT_STRIDE) as usize);
    for (i, words) in (0..count).zip(output.chunks(OUT_STRIDE as usize)) {
        assert_eq!(words[..4], pcg4d(argument(i)).to_array(), "item {i}");
        assert_eq!(words[4..], [0; 4], "item {i} has four results");
    }
    finish(backend);
}

#[test]
fn film_beyond_the_device_is_too_large() {
    let mut backend = lavapipe();
    for (width, height) in [(1 << 16, 1 << 16), (u32::MAX, u32::MAX)] {
        let error = backend.load(&SceneBuffers::default(), &frame(width, height), counting()).unwrap_err();
        let BackendError::TooLarge { name, bytes, limit, .. } = &error else { panic!("{error}") };
        assert_eq!(*name, "the film");
        assert!(bytes > limit, "{error}");
        assert!(error.to_string().contains("--size"), "{error}");
    }
    // The backend goes on with an empty film, and takes the next scene.
    assert!(backend.resolve().unwrap().is_empty());
    backend.load(&SceneBuffers::default(), &frame(4, 4), counting()).unwrap();
    add_sample(&mut backend, 0);
    assert_samples(&mut backend, 1);
    finish(backend);
}

#[test]
fn map_beyond_the_device_is_too_large() {
    let mut backend = lavapipe();
    // A word more than lavapipe's 128 MiB. (Zeros that are never touched take no memory of the host.)
    let scene = SceneBuffers { height_texels: vec![0; (128 << 18) + 1], ..SceneBuffers::default() };
    let error = backend.load(&scene, &frame(4, 4), counting()).unwrap_err();
    assert!(matches!(error, BackendError::TooLarge { name: "the height maps", .. }), "{error}");
    assert!(error.to_string().contains("scale the map down"), "{error}");
    finish(backend);
}

#[test]
#[should_panic(expected = "probe needs 32 words an item")]
fn probe_with_too_few_words_is_refused() {
    let mut backend = lavapipe();
    let _ = backend.probe(PCG4D, &[0; 63], 2);
}

#[test]
fn auto_never_takes_a_software_device() {
    devices_with_lavapipe();
    match VulkanBackend::new(&Selection::Auto, false) {
        Ok(backend) => assert!(backend.device().kind < DeviceKind::Software, "{:?}", backend.device()),
        Err(error) => {
            assert!(matches!(error, BackendError::NoDevice { .. }), "{error}");
            assert!(error.to_string().contains("llvmpipe"), "names what --device can ask for: {error}");
        }
    }
}

#[test]
fn devices_lists_lavapipe_as_software() {
    let devices = devices_with_lavapipe();
    let lavapipe = devices.iter().find(|device| device.name.contains("llvmpipe")).unwrap();
    assert_eq!((lavapipe.backend, lavapipe.kind), ("vulkan", DeviceKind::Software));
    assert!(lavapipe.details.contains("Vulkan 1.") && lavapipe.details.contains("Mesa"), "{lavapipe:?}");
}

#[test]
fn device_can_be_asked_for_by_index() {
    for (index, device) in devices_with_lavapipe().iter().enumerate() {
        let backend = VulkanBackend::new(&Selection::Named(index.to_string()), false).unwrap();
        assert_eq!(backend.device(), device);
    }
}

#[test]
fn unknown_device_is_named_in_the_error() {
    devices_with_lavapipe();
    let error = VulkanBackend::new(&Selection::Named("voodoo".to_owned()), false).err().unwrap();
    let message = error.to_string();
    assert!(message.contains("voodoo") && message.contains("llvmpipe"), "{message}");
}

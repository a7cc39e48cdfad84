//! What a backend makes of changes to a loaded scene: the same as of the changed scene, loaded. For each backend.

use crate::compare::rendered;
use crate::scenes::{builtin_scene, checkered_sheet, job};
use emboss::backend::{Backend, BackendError};
use emboss::bvh::Bvh;
use emboss::framing::View;
use emboss::picture::Picture;
use emboss::render::{Job, render};
use emboss::scene::{HeightMap, Relief};
use emboss::settings::{Light, Method, Settings, Shade};
use emboss_kernels::interface::counter;
use emboss_kernels::relief::distance_map::WORDS;
use emboss_kernels::scene::Features;
use glam::{DVec3, Vec3};
use std::ops::ControlFlow;

/// Samples of a pixel.
const SAMPLES: u32 = 2;

/// A built-in scene with seams.
fn cube(change: impl FnOnce(&mut Relief, &mut Settings)) -> Job {
    let (mut scene, mut settings) = builtin_scene("builtin:cube", 8, 48, 32);
    settings.counting = true;
    change(&mut scene.reliefs[0], &mut settings);
    (*job(scene, &settings)).clone()
}

/// The picture of what is loaded, and the work it took.
fn picture(backend: &mut dyn Backend, job: &Job) -> Picture {
    let rendering =
        render(backend, job, SAMPLES, &mut |_| ControlFlow::Continue(())).expect("no device fails");
    let pixels = u64::from(job.frame.width) * u64::from(job.frame.height);
    assert_eq!(rendering.totals[counter::PRIMARY_RAYS as usize], pixels * u64::from(SAMPLES));
    rendering.picture
}

/// Other cameras, sizes of the film, seeds, backgrounds and numbers of lights.
///
/// # Panics
/// Where pictures differ.
pub fn assert_views_change(backend: &mut dyn Backend) {
    let first = cube(|_, _| {});
    backend.load(&first.buffers, &first.frame, first.features).expect("the cube fits");
    let before = picture(backend, &first);
    let light = Light { position: DVec3::new(3.0, 4.0, 5.0), color: Vec3::X, intensity: None };
    let bvh = backend.bvh().expect("no device fails");
    for (width, height, lights) in [(48, 32, 1), (30, 50, 3), (7, 5, 0), (48, 32, 2)] {
        let second = cube(|_, settings| {
            (settings.width, settings.height, settings.seed) = (width, height, 9);
            settings.view = View { from: Vec3::new(-1.0, 0.5, 0.3), ..settings.view };
            settings.background = Some(Vec3::Y);
            settings.lights = vec![light; lights];
        });
        backend.set_view(&second.frame, &second.buffers.lights).expect("the view is sound");
        let seen = picture(backend, &second);
        assert_eq!(backend.bvh().expect("no device fails"), bvh, "nothing is built");
        backend.load(&second.buffers, &second.frame, second.features).expect("the cube fits");
        assert!(seen == picture(backend, &second), "{width}x{height}, {lights} lights");
        assert!(seen != before);
    }
    // Without a change the film is cleared all the same.
    backend.set_view(&first.frame, &first.buffers.lights).expect("the view is sound");
    assert!(picture(backend, &first) == before);

    let mut frame = first.frame;
    frame.light_count = 2;
    let error = backend.set_view(&frame, &first.buffers.lights).expect_err("there is one light");
    assert!(matches!(error, BackendError::Unsound { .. }), "{error}");
    backend.set_view(&first.frame, &first.buffers.lights).expect("the view is sound");
    assert!(picture(backend, &first) == before, "an unsound view changes nothing");
}

/// Other scales and zeros.
///
/// # Panics
/// Where pictures or boxes differ.
pub fn assert_heights_change(backend: &mut dyn Backend) {
    let first = cube(|_, _| {});
    backend.load(&first.buffers, &first.frame, first.features).expect("the cube fits");
    let before = picture(backend, &first);
    for (scale, zero) in [(0.02, 0.5), (-0.3, 0.1), (0.0, 0.0), (0.4, 0.9)] {
        let mut second = cube(|relief, _| (relief.scale, relief.zero) = (scale, zero));
        (second.frame.camera, second.frame.light_count) = (first.frame.camera, first.frame.light_count);
        second.buffers.lights.clone_from(&first.buffers.lights);
        backend.set_displacements(&second.buffers.displacements).expect("the heights are sound");
        let seen = picture(backend, &second);
        let (boxes, bvh) = (backend.prism_boxes().expect("kept"), backend.bvh().expect("kept"));
        assert_eq!(backend.build_report().nodes as usize, bvh.nodes.len());
        bvh.validate(&boxes).expect("the tree holds the new boxes");
        backend.load(&second.buffers, &second.frame, second.features).expect("the cube fits");
        assert_eq!(boxes, backend.prism_boxes().expect("kept"));
        assert!(seen == picture(backend, &second), "scale {scale}, zero {zero}");
        assert!(seen != before);
    }
    // Little by little the tree keeps its nodes; from flat to as high as can be it does not.
    backend.load(&first.buffers, &first.frame, first.features).expect("the cube fits");
    for scale in [0.101, 0.102] {
        let second = cube(|relief, _| relief.scale *= scale / 0.1);
        backend.set_displacements(&second.buffers.displacements).expect("the heights are sound");
        assert!(backend.build_report().refitted, "scale {scale}");
        let (boxes, bvh) = (backend.prism_boxes().expect("kept"), backend.bvh().expect("kept"));
        assert_eq!(bvh.validate(&boxes).err(), None);
    }
    backend.load(&first.buffers, &first.frame, first.features).expect("the cube fits");
    let mut wider = first.buffers.displacements.clone();
    wider[0].map_width += 1;
    for unsound in [&wider[..], &[]] {
        let error = backend.set_displacements(unsound).expect_err("the map is another");
        assert!(matches!(error, BackendError::Unsound { .. }), "{error}");
    }
    backend.set_displacements(&first.buffers.displacements).expect("the heights are sound");
    assert!(picture(backend, &first) == before);
}

/// Distance maps that are known are taken as they are; those that are not are computed, and again where a scale
/// changes its sign. Nothing else changes them.
///
/// # Panics
/// Where they are others.
pub fn assert_distances_are_kept(backend: &mut dyn Backend) {
    let sphere = |scale: f32| {
        let (mut scene, mut settings) = builtin_scene("builtin:cube", 8, 48, 32);
        settings.method = Method::Sphere;
        let other = Relief::new(HeightMap::flat(0.5), 0.5, 1.0);
        scene.reliefs.push(other);
        scene.reliefs[0].scale *= scale;
        (*job(scene, &settings)).clone()
    };
    let maps = |backend: &mut dyn Backend, job: &Job| {
        backend.load(&job.buffers, &job.frame, job.features).expect("the cube fits");
        backend.distance_maps().expect("no device fails")
    };
    let (mut first, turned) = (sphere(1.0), sphere(-1.0));
    let (computed, downwards) = (maps(backend, &first), maps(backend, &turned));
    let (of_first, of_second) = computed.split_at(WORDS as usize);
    assert_eq!(of_second.len(), WORDS as usize);
    assert!(of_first.iter().any(|&x| x > 1.0) && of_first != &downwards[..WORDS as usize]);
    let known: Vec<f32> = of_first.iter().map(|x| x + 0.5).collect();
    for second_is_known in [false, true] {
        let second = second_is_known.then(|| of_second.to_vec());
        first.buffers.distances = vec![Some(known.clone()), second];
        let taken = maps(backend, &first);
        assert!(taken[..WORDS as usize] == known && &taken[WORDS as usize..] == of_second);
    }
    let mut change = |displaced: &Job| {
        backend.set_displacements(&displaced.buffers.displacements).expect("the heights are sound");
        backend.distance_maps().expect("no device fails")
    };
    let mut higher = sphere(3.0);
    higher.buffers.displacements[0].zero += 0.25;
    assert!(change(&higher)[..WORDS as usize] == known);
    assert!(change(&turned) == downwards);
    assert!(change(&first) == computed);
    first.buffers.distances = vec![Some(vec![0.0; 3])];
    let error = backend.load(&first.buffers, &first.frame, first.features).expect_err("three floats");
    assert!(error.to_string().contains("a distance map"), "{error}");
}

/// Other methods, ways to shade, shadows or none.
///
/// # Panics
/// Where pictures differ.
pub fn assert_code_changes(backend: &mut dyn Backend) {
    let first = cube(|_, _| {});
    backend.load(&first.buffers, &first.frame, first.features).expect("the cube fits");
    let before = picture(backend, &first);
    for (method, shade, shadows, smooth) in
        [(Method::None, Shade::Lit, false, true), (Method::Quadtree, Shade::Normal, true, false)]
    {
        let mut second = cube(|_, settings| {
            (settings.method, settings.shade) = (method, shade);
            (settings.shadows, settings.smooth) = (shadows, smooth);
        });
        (second.frame.camera, second.frame.light_count) = (first.frame.camera, first.frame.light_count);
        second.buffers.lights.clone_from(&first.buffers.lights);
        backend.set_features(second.features).expect("the scene is packed for it");
        backend.set_displacements(&second.buffers.displacements).expect("the heights are sound");
        backend.set_view(&second.frame, &second.buffers.lights).expect("the view is sound");
        let seen = picture(backend, &second);
        assert!(seen != before, "{method:?}");
        backend.load(&second.buffers, &second.frame, second.features).expect("the cube fits");
        assert!(seen == picture(backend, &second), "{method:?}");
    }
    let error = backend.set_features(Features { seams: 0, ..first.features }).expect_err("it has seams");
    assert!(matches!(error, BackendError::Unsound { .. }), "{error}");
}

/// From flat to as high as the sheet is wide: a tree over two layers, instead of one whose every node spans them.
///
/// # Panics
/// Where the tree is not the one that is built over the new boxes.
pub fn assert_costly_trees_are_built_anew(backend: &mut dyn Backend) {
    let sheet = |scale: f32| {
        let mut scene = checkered_sheet();
        scene.reliefs[0].scale = scale;
        job(scene, &Settings { width: 8, height: 8, ..Settings::default() })
    };
    let (flat, steep) = (sheet(1e-3), sheet(100.0));
    backend.load(&flat.buffers, &flat.frame, flat.features).expect("the sheet fits");
    let before = backend.bvh().expect("kept");
    backend.set_displacements(&steep.buffers.displacements).expect("the heights are sound");
    assert!(!backend.build_report().refitted, "the tree over the flat sheet costs three times as much");
    let built = backend.bvh().expect("kept");
    backend.load(&steep.buffers, &steep.frame, steep.features).expect("the sheet fits");
    assert!(built == backend.bvh().expect("kept"));
    let links = |tree: &Bvh| tree.nodes.iter().map(|node| (node.first, node.count)).collect::<Vec<_>>();
    assert!(links(&built) != links(&before), "the control: heights make no other tree");
}

/// A triangle with a corner that is no number is left out, and reported; the others are where they were.
///
/// # Panics
/// Where it is not.
pub fn assert_what_is_not_finite_is_left_out(backend: &mut dyn Backend) {
    let mut job = cube(|_, _| {});
    let before = rendered(backend, &job, SAMPLES);
    assert_eq!(backend.build_report().left_out, 0);
    // A triangle more, of three corners of its own.
    for broken in [Vec3::NAN, Vec3::new(0.0, f32::INFINITY, 0.0)] {
        let mut with_broken = job.clone();
        let first = u32::try_from(job.buffers.vertices.len()).expect("few");
        for i in 0..3 {
            let mut vertex = job.buffers.vertices[i];
            vertex.position = if i == 1 { broken } else { vertex.position };
            with_broken.buffers.vertices.push(vertex);
        }
        let triangle = job.buffers.triangles[0];
        with_broken.buffers.triangles.push(emboss_kernels::interface::Triangle {
            vertices: [first, first + 1, first + 2],
            seams: emboss_kernels::interface::NO_SEAMS,
            ..triangle
        });
        with_broken.frame.triangle_count += 1;
        assert!(rendered(backend, &with_broken, SAMPLES) == before, "{broken}");
        assert_eq!(backend.build_report().left_out, 1, "{broken}");
        let (boxes, bvh) = (backend.prism_boxes().expect("kept"), backend.bvh().expect("kept"));
        assert!(!boxes[boxes.len() - 1].min.is_finite());
        // It is in no leaf, every other triangle in one.
        assert_eq!(bvh.validate(&boxes).err(), None);
    }
    // Nothing but such triangles: nothing is hit.
    job.buffers.vertices.iter_mut().for_each(|vertex| vertex.position = Vec3::NAN);
    let nothing = rendered(backend, &job, SAMPLES);
    assert_eq!(backend.build_report().left_out, job.frame.triangle_count);
    assert!(nothing.pixels.iter().all(|pixel| pixel.w == 0.0));
}

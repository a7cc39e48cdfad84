//! Pictures that show nothing of what was meant, and some that nearly do, for each backend.

use crate::instances::placed;
use crate::scenes::builtin_scene;
use emboss::backend::Backend;
use emboss::framing::View;
use emboss::render::{Job, Scene, load, prepare, render};
use emboss::reports::{Findings, Ground, Useless, Whereabouts, useless};
use emboss::scene::{HeightMap, Material, Mesh, Relief};
use emboss::settings::{DisplacementKind, Light, Method, Settings};
use emboss_kernels::interface::{Vertex, height_format};
use glam::{DAffine3, DVec3, Vec3};
use std::ops::ControlFlow;

/// Samples of a pixel.
const SAMPLES: u32 = 2;

/// A level square from -1 to 1 under a round hill, 1 in its middle times `scale`, and 0 at its border.
fn hill(scale: f32) -> Scene {
    const SIDE: u16 = 33;
    let vertex = |x: f32, y: f32| Vertex {
        position: Vec3::new(2.0 * x - 1.0, 2.0 * y - 1.0, 0.0),
        normal: Vec3::Z,
        u: x,
        v: y,
    };
    let corners = [vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(1.0, 1.0), vertex(0.0, 1.0)];
    let along = |i: u16| 2.0 * (f32::from(i) + 0.5) / f32::from(SIDE) - 1.0;
    let texel = |x: u16, y: u16| (1.0 - along(x).powi(2)) * (1.0 - along(y).powi(2));
    let texels = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| texel(x, y).to_bits())).collect();
    let (width, height) = (SIDE.into(), SIDE.into());
    let map =
        HeightMap { width, height, format: height_format::FLOAT32, texels, range: (0.0, 1.0), replaced: 0 };
    Scene {
        mesh: Mesh::from_triangles(&corners, &[[0, 1, 2], [0, 2, 3]]),
        reliefs: vec![Relief::new(map, 0.0, scale)],
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions: 32,
    }
}

fn settings(view: View) -> Settings {
    Settings { width: 40, height: 30, view, ..Settings::default() }
}

/// The view from `eye` to `target`.
fn view(eye: Vec3, target: Vec3) -> View {
    View { eye: Some(eye.as_dvec3()), target: Some(target.as_dvec3()), ..View::default() }
}

/// What is found of a scene's picture.
fn found(backend: &mut dyn Backend, scene: Scene, settings: &Settings) -> Findings {
    let mut job = prepare(scene, settings).expect("sound maps");
    load(backend, &mut job).expect("it fits");
    let pixels = sampled(backend, &job);
    let mut goes_on = || ControlFlow::Continue(());
    let found = useless(backend, &job, &Ground::of_job(&job), &pixels, SAMPLES, &mut goes_on);
    let found = found.expect("no device fails");
    // What was asked for is there again, or still.
    if found.film_is_cleared {
        assert!(sampled(backend, &job) == pixels);
    } else {
        assert!(backend.resolve().expect("no device fails") == pixels);
    }
    found
}

fn sampled(backend: &mut dyn Backend, job: &Job) -> Vec<glam::Vec4> {
    let rendering = render(backend, job, SAMPLES, &mut |_| ControlFlow::Continue(()));
    rendering.expect("no device fails").picture.pixels
}

/// Models behind the camera, beside the picture and between its rays, before a transparent and a coloured background.
///
/// # Panics
/// Where they are not found, or others are.
pub fn assert_empty_pictures_are_found(backend: &mut dyn Backend) {
    for background in [None, Some(Vec3::new(0.2, 0.4, 0.6)), Some(Vec3::ZERO)] {
        let mut seen = |view: View| {
            let settings = Settings { background, ..settings(view) };
            match found(backend, hill(0.5), &settings).useless {
                None => None,
                Some(Useless::NothingHit { min, max, seen, is_placed }) => {
                    assert!(min[0] <= -1.0 && min[2] <= 0.01 && max[1] >= 1.0 && max[2] >= 0.49);
                    assert!(min[0] > -1.1 && max[2] < 0.6 && is_placed, "{min:?} {max:?}");
                    Some(seen)
                }
                Some(other) => panic!("{other:?}"),
            }
        };
        let eye = Vec3::new(0.0, -4.0, 2.0);
        assert_eq!(seen(view(eye, Vec3::ZERO)), None, "{background:?}");
        assert_eq!(seen(view(eye, 2.0 * eye)), Some(Whereabouts::Behind));
        assert_eq!(seen(view(eye, Vec3::new(9.0, 0.0, 0.0))), Some(Whereabouts::Beside));
        assert_eq!(seen(view(1e4 * eye, Vec3::ZERO)), Some(Whereabouts::BetweenRays));
    }
    // Black before black: its outline cannot be seen, but it is hit.
    let black = Settings {
        background: Some(Vec3::ZERO),
        ambient: 0.0,
        lights: vec![Light { position: DVec3::NEG_Z, color: Vec3::ONE, intensity: None }],
        ..settings(view(Vec3::new(0.0, -4.0, 2.0), Vec3::ZERO))
    };
    let found = found(backend, hill(0.0), &black).useless;
    assert!(matches!(found, Some(Useless::NoLight { .. })), "{found:?}");
}

/// Whether the camera is found inside, and then whether in the relief.
fn inside(backend: &mut dyn Backend, scene: Scene, settings: &Settings) -> Option<bool> {
    match found(backend, scene, settings).useless {
        None | Some(Useless::NoLight { .. }) => None,
        Some(Useless::CameraInside { in_relief, .. }) => Some(in_relief),
        Some(other) => panic!("{other:?}"),
    }
}

fn looking(eye: Vec3, target: Vec3) -> Settings {
    settings(view(eye, target))
}

/// Under the hill, and what a camera there looks at.
const LOW: Vec3 = Vec3::new(0.1, -0.1, 0.2);
const NORTH: Vec3 = Vec3::new(0.1, 5.0, 0.2);

/// Cameras inside a hill, over it, in a hollow, and behind a sheet.
///
/// # Panics
/// Where what is found is not what is so.
pub fn assert_cameras_in_relief_are_found(backend: &mut dyn Backend) {
    let mut inside = |scene, settings: &Settings| inside(backend, scene, settings);
    let (low, north) = (LOW, NORTH);
    // The hill is 0.5 high there.
    assert_eq!(inside(hill(0.5), &looking(low, north)), Some(true));
    assert_eq!(inside(hill(0.5), &looking(Vec3::new(0.1, -0.9, 0.3), north)), None, "over its foot");
    assert_eq!(inside(hill(-0.5), &looking(-low, -north)), None, "in a hollow");
    // An open sheet from behind, within its box: the corner of the box is below the base.
    let up = Vec3::new(0.0, 0.0, 5.0);
    let both = |scene: Scene| {
        let texels =
            scene.reliefs[0].map.texels.iter().map(|&t| (f32::from_bits(t) - 0.5).to_bits()).collect();
        let map = HeightMap { texels, range: (-0.5, 0.5), ..(*scene.reliefs[0].map).clone() };
        Scene { reliefs: vec![Relief::new(map, 0.0, scene.reliefs[0].scale)], ..scene }
    };
    assert_eq!(
        inside(both(hill(1.0)), &looking(Vec3::new(0.9, 0.0, -0.45), up)),
        None,
        "a sheet from behind"
    );
    assert_eq!(inside(both(hill(1.0)), &looking(low, north)), Some(true), "its hill");
}

/// Cameras under a hill of vectors, and of an instance; in closed models and in a room.
///
/// # Panics
/// Where what is found is not what is so.
pub fn assert_cameras_inside_are_found(backend: &mut dyn Backend) {
    let mut inside = |scene, settings: &Settings| inside(backend, scene, settings);
    let (low, north) = (LOW, NORTH);
    // By the methods that trace base triangles the hill is not there.
    let flat = |method| Settings { method, ..looking(low, Vec3::new(0.0, 0.0, -5.0)) };
    assert_eq!(inside(hill(0.5), &flat(Method::None)), None);
    assert_eq!(inside(hill(0.5), &flat(Method::Bump)), None);
    // The same hill as a vector map, and in a place of its own, mirrored.
    let mut vectors = hill(0.5);
    vectors.reliefs = vec![Relief { scale: 0.0, ..vectors.reliefs[0].clone() }; 2];
    vectors.reliefs.push(hill(0.5).reliefs[0].clone());
    let tangent = Settings { displacement: DisplacementKind::Tangent, ..looking(low, north) };
    assert_eq!(inside(vectors, &tangent), Some(true));
    let place = DAffine3::from_scale_rotation_translation(
        DVec3::new(-3.0, 3.0, 3.0),
        glam::DQuat::from_rotation_z(1.0),
        DVec3::new(10.0, 20.0, 30.0),
    );
    let moved = |p: Vec3| place.transform_point3(p.as_dvec3()).as_vec3();
    let away = DAffine3::from_translation(DVec3::new(-50.0, 0.0, 0.0));
    let in_place = |at: Vec3| looking(moved(at), moved(north));
    assert_eq!(inside(placed(hill(0.5), vec![away, place]), &in_place(low)), Some(true));
    let over = Vec3::new(0.1, -0.9, 0.3);
    assert_eq!(inside(placed(hill(0.5), vec![away, place]), &in_place(over)), None);

    // A cube from -1 to 1 under a relief that rises by up to 0.2.
    let cube = || builtin_scene("builtin:cube", 8, 40, 30).0;
    let height = cube().reliefs[0].scale;
    assert!(height > 0.1);
    assert_eq!(inside(cube(), &looking(Vec3::splat(0.3), Vec3::X)), Some(false));
    // sin(5 pi u) is 1 at u = 0.3: the top of a bump over the base.
    let in_bump = Vec3::new(2.0 * 0.3 - 1.0, 2.0 * 0.3 - 1.0, 1.0 + 0.3 * height);
    assert_eq!(inside(cube(), &looking(in_bump, in_bump + Vec3::X)), Some(true));
    // The same cube around another one, whose faces are seen from their front.
    let mut sky = cube();
    let small = DAffine3::from_scale_rotation_translation(
        DVec3::splat(0.3),
        glam::DQuat::IDENTITY,
        DVec3::new(-0.3, 0.0, 0.0),
    );
    sky.mesh.append(cube().mesh.transformed(small).expect("finite"));
    assert_eq!(inside(sky, &looking(Vec3::new(0.6, 0.0, 0.0), Vec3::ZERO)), None, "something is in the sky");
    let mut room = cube();
    for triangle in &mut room.mesh.triangles {
        triangle.flags ^= emboss_kernels::interface::FLIPPED;
    }
    room.mesh.vertices.iter_mut().for_each(|vertex| vertex.normal = -vertex.normal);
    assert_eq!(inside(room, &looking(Vec3::splat(0.3), Vec3::X)), None, "a room");
}

/// Lights too far away, behind, inside and shadowed; lights that reach little.
///
/// # Panics
/// Where what is found is not what is so, or a picture is taken again that need not be.
pub fn assert_darkness_is_found(backend: &mut dyn Backend) {
    let above = view(Vec3::new(0.0, -4.0, 3.0), Vec3::ZERO);
    let at = |position: Vec3| Light { position: position.as_dvec3(), color: Vec3::ONE, intensity: None };
    let mut dark = |lights: Vec<Light>, change: &dyn Fn(&mut Settings)| {
        let mut settings = Settings { lights, ..settings(above) };
        change(&mut settings);
        let found = found(backend, hill(0.3), &settings);
        let far = match found.useless {
            None => None,
            Some(Useless::NoLight { lights, .. }) => Some(lights.iter().map(|light| light.too_far).collect()),
            Some(other) => panic!("{other:?}"),
        };
        (far, found.film_is_cleared)
    };
    let keep = |_: &mut Settings| {};
    // The key light, and one that is 10^11 away: what is bright tells by itself.
    assert_eq!(dark(vec![], &keep), (None, false));
    assert_eq!(dark(vec![at(Vec3::new(-1e11, 0.0, 1e11))], &keep), (None, false));
    let far = at(Vec3::new(-1e20, 0.0, 1e20));
    assert_eq!(dark(vec![far], &keep), (Some(vec![true]), true));
    let (under, within) = (at(Vec3::new(0.0, 0.0, -3.0)), at(Vec3::new(0.0, 0.0, 0.1)));
    assert_eq!(dark(vec![under, far], &keep), (Some(vec![false, true]), true));
    assert_eq!(dark(vec![within], &keep).0, Some(vec![false]));
    assert_eq!(dark(vec![within, at(Vec3::new(-2.0, 0.0, 2.0))], &keep), (None, false));
    let no_shadows = |settings: &mut Settings| settings.shadows = false;
    assert_eq!(dark(vec![under], &no_shadows).0, Some(vec![false]));
    let off = Light { color: Vec3::ZERO, ..under };
    assert_eq!(dark(vec![off], &keep), (None, false), "it was turned off");
    // Of colours without light there is nothing to say, nor of no light at all.
    let colors = |settings: &mut Settings| settings.shade = emboss::settings::Shade::Normal;
    assert_eq!(dark(vec![under], &colors), (None, false));
    // Little light, beside full ambient light: it is there, whatever a glance says.
    let dim = Light { intensity: Some(1e-4), ..at(Vec3::new(0.0, 0.0, 2.0)) };
    let ambient = |settings: &mut Settings| settings.ambient = 1.0;
    assert_eq!(dark(vec![dim], &ambient).0, None);
    assert_eq!(dark(vec![under], &ambient).0, Some(vec![false]));
}

/// One triangle of thousands is lit, and that one is smaller than a pixel of the small picture.
///
/// # Panics
/// Where it is overlooked.
pub fn assert_a_lit_speck_is_seen(backend: &mut dyn Backend) {
    let mut scene = hill(0.0);
    // A fin that faces the light, which is under the sheet's plane, where that ends.
    let fin = [Vec3::new(1.0, 0.0, 0.0), Vec3::new(1.0, 0.02, 0.0), Vec3::new(1.0, 0.0, 0.02)];
    let vertices: Vec<Vertex> =
        fin.map(|position| Vertex { position, normal: Vec3::X, ..Vertex::default() }).to_vec();
    scene.mesh.append(Mesh::from_triangles(&vertices, &[[0, 1, 2]]));
    let light = Light { position: DVec3::new(3.0, 0.0, -0.1), color: Vec3::ONE, intensity: Some(2.0) };
    // A material that nothing has, so bright that what is lit might be its ambient light.
    scene.materials.push(Material { albedo: Vec3::splat(10.0), ..Material::default() });
    let view = view(Vec3::new(4.0, -2.0, 3.0), Vec3::ZERO);
    let lit = Settings { lights: vec![light], width: 400, height: 300, ..settings(view) };
    let seen = found(backend, scene.clone(), &lit);
    assert_eq!(seen, Findings { useless: None, film_is_cleared: true });
    scene.mesh.triangles.pop();
    let dark = found(backend, scene, &lit).useless;
    assert!(matches!(dark, Some(Useless::NoLight { .. })), "{dark:?}");
}

//! Wherever a model stands, and however large it is, its picture is the same: docs/EXACTNESS.md, section 9.

use emboss::backend::cpu::CpuBackend;
use emboss::backend::{Backend, Totals};
use emboss::picture::Picture;
use emboss::render::Scene;
use emboss::scene::{Material, Relief};
use emboss::settings::{Light, Method, Settings, Wrap};
use emboss_kernels::interface::counter;
use emboss_tests::Numbers;
use emboss_tests::far::{Model, Moved, assembled, differing, pixel_rays, seen};
use emboss_tests::instances::rotation;
use emboss_tests::oracle::Oracle;
use emboss_tests::scenes::{IMAGE_SPACE, ReadyJob, WildMap};
use glam::{DAffine3, DVec3};

fn at(far: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(far, 0.0, -far))
}

fn on_cpu(scene: Scene, settings: &Settings) -> (Picture, Totals) {
    seen(&mut CpuBackend::new(), scene, settings)
}

/// A third of the picture shows the model.
fn assert_shown(totals: &Totals) {
    assert!(3 * totals[counter::HITS as usize] > totals[counter::PRIMARY_RAYS as usize], "{totals:?}");
}

/// A patch of 4 units, 10^3, 10^6 and 10^9 of them away: each bit of the picture, and all the work.
#[test]
fn pictures_are_the_same_wherever_the_model_stands() {
    let patch = Model::patch(&mut Numbers::new(1));
    let here = on_cpu(assembled(&[(&patch, vec![])], Wrap::Repeat, 16), &patch.settings(at(0.0), 1.0));
    assert_shown(&here.1);
    for extents in [1e3, 1e6, 1e9] {
        // A multiple of the grid of origins, 8.
        let far = at(8.0 * (extents / 2.0_f64).round());
        let scene = assembled(&[(&patch.moved(far), vec![])], Wrap::Repeat, 16);
        let there = on_cpu(scene, &patch.settings(far, 1.0));
        assert_eq!((differing(&here.0, &there.0), here.1), (0, there.1), "{extents} extents away");
        // As an instance there of a model that stands here.
        let [here, there] = [at(0.0), far].map(|place| {
            on_cpu(assembled(&[(&patch, vec![place])], Wrap::Repeat, 16), &patch.settings(place, 1.0))
        });
        assert_eq!((differing(&here.0, &there.0), here.1), (0, there.1), "{extents} extents away");
    }
}

/// Where doubles do not hold all digits of the file, or the model's origin moves otherwise, rays cost as much.
#[test]
fn work_is_the_same_wherever_the_model_stands() {
    let mut numbers = Numbers::new(2);
    let patch = Model::patch(&mut numbers);
    let work = |motion: DAffine3| {
        let scene = assembled(&[(&patch.moved(motion), vec![])], Wrap::Repeat, 16);
        on_cpu(scene, &patch.settings(motion, 1.0)).1
    };
    let here = work(at(0.0));
    for far in [412_345.25, 5_123_456.789, 4e9 + 0.3] {
        let there = work(at(far));
        for what in [counter::BOXES, counter::PRISMS, counter::SUB_TRIANGLES, counter::TRIANGLES] {
            let [a, b] = [&here, &there].map(|totals| totals[what as usize]);
            // A few rays near edges go another way.
            assert!(b.abs_diff(a) * 100 <= a, "{a} becomes {b} of {what} at {far}");
        }
    }
}

/// Turned anyhow and moved by up to 10^9 extents: each hit is one of the unmoved model's surface within the bound.
#[test]
fn rigid_motions_move_the_picture() {
    let mut numbers = Numbers::new(3);
    let (mut clear, mut all) = (0, 0);
    for round in 0..16 {
        let model = if round % 2 == 0 { Model::patch(&mut numbers) } else { Model::solid(&mut numbers) };
        let (_, extent) = model.middle_and_extent();
        let far = extent * 10_f64.powf(f64::from(numbers.between(0.0, 9.0)));
        let translation = numbers.direction().as_dvec3() * far;
        let motion = DAffine3::from_rotation_translation(rotation(&mut numbers), translation);
        let oracle = |job: &ReadyJob| Oracle::new(&job.buffers, &job.frame, job.features);
        let moved = Moved::new(&model, motion, [3, 16][round % 2], oracle);
        let ([start, turn], bound) = moved.rays_apart();
        // Three roundings and a root for each component; the camera's axes are rounded too, and as long as 1.2.
        assert!(start <= bound && turn < 16.0 * 2_f64.powi(-24), "{start} {bound} {turn}");
        let mut backend = CpuBackend::new();
        let job = &moved.there;
        backend.load(&job.buffers, &job.frame, job.features).expect("fits");
        let rays = pixel_rays(job);
        clear += moved.assert_right(&rays, &backend.trace_rays(&rays).expect("the CPU traces"));
        all += rays.len();
    }
    // The judgement has teeth where it could only say yes or no.
    assert!(2 * clear > all, "{clear} of {all}");
}

/// Two patches 10^9 extents apart, each seen from near: as if it were alone.
#[test]
fn models_of_a_scene_may_stand_far_from_each_other() {
    let mut numbers = Numbers::new(4);
    let (a, b) = (Model::patch(&mut numbers), Model::patch(&mut numbers));
    let far = at(8.0 * 5e8);
    // Alone but for something behind the camera, so that it is an instance too.
    let behind = at(-4096.0);
    let alone = |model: &Model| {
        let scene = assembled(&[(model, vec![]), (&a.moved(behind), vec![])], Wrap::Repeat, 16);
        on_cpu(scene, &model.settings(at(0.0), 1.0))
    };
    let together = assembled(&[(&a, vec![]), (&b.moved(far), vec![])], Wrap::Repeat, 16);
    assert_eq!(together.parts.len(), 2);
    for (model, place) in [(&a, at(0.0)), (&b, far)] {
        let (expected, found) = (alone(model), on_cpu(together.clone(), &model.settings(place, 1.0)));
        assert_shown(&found.1);
        let apart = differing_much(&expected.0, &found.0);
        // Rays that pass within rounding of an edge.
        assert!(apart * 50 <= expected.0.pixels.len(), "{apart} pixels differ");
    }
    // Near models share their mesh.
    let near = assembled(&[(&a, vec![]), (&b.moved(at(64.0)), vec![])], Wrap::Repeat, 16);
    assert!(near.parts.is_empty() && near.mesh.starts.len() == 1);
    // Farther than digits go, though no triangle vanishes.
    let middling = at(8e4);
    let apart = assembled(&[(&a, vec![]), (&b.moved(middling), vec![])], Wrap::Repeat, 16);
    // Each has its own relief, wherever its mesh was moved to.
    for (scene, place) in [(&near, at(64.0)), (&apart, middling)] {
        for (model, place) in [(&a, at(0.0)), (&b, place)] {
            let (expected, found) = (alone(model), on_cpu(scene.clone(), &model.settings(place, 1.0)));
            assert!(differing_much(&expected.0, &found.0) * 50 <= expected.0.pixels.len());
        }
    }
}

/// How many pixels differ by more than a step of 8 bits.
fn differing_much(a: &Picture, b: &Picture) -> usize {
    let differs = |(a, b): (&glam::Vec4, &glam::Vec4)| (*a - *b).abs().max_element() > 1.0 / 255.0;
    a.pixels.iter().zip(&b.pixels).filter(|&pair| differs(pair)).count()
}

/// From 2^-39 to 2^38 times as large, 10^-12 to 10^12 units: each bit of the picture, and all the work.
#[test]
fn pictures_are_the_same_at_each_power_of_two() {
    let patch = Model::patch(&mut Numbers::new(5));
    let seen_at = |method: Method, exponent: i32| {
        let factor = 2_f64.powi(exponent);
        let scene = assembled(&[(&patch.scaled(factor), vec![])], Wrap::Repeat, 4096);
        let settings = Settings { method, ..patch.settings(at(0.0), factor) };
        (scene.mesh.space, on_cpu(scene, &settings))
    };
    for method in [Method::Quadtree, Method::GridWalk] {
        let (space, here) = seen_at(method, 0);
        assert_shown(&here.1);
        for exponent in [-39, -20, -1, 20, 37] {
            let (other, there) = seen_at(method, exponent);
            assert_eq!(other.exponent, space.exponent - exponent);
            assert_eq!((differing(&here.0, &there.0), here.1), (0, there.1), "2^{exponent}");
        }
    }
}

/// Kernels have no length of their own: where the host leaves a scene as it is, a power of two changes nothing either,
/// whatever the method. But for the grid walk, whose prisms' walls are ruled by normals as long as 1.
#[test]
fn no_method_has_a_length_of_its_own() {
    let patch = Model::patch(&mut Numbers::new(6));
    let methods = [Method::Quadtree, Method::Tessellate, Method::BruteForce, Method::Inverse, Method::None];
    for method in methods.into_iter().chain(IMAGE_SPACE) {
        let seen_at = |exponent: i32| {
            let (factor, scale) = (2_f64.powi(exponent), 0.25 * 2_f32.powi(exponent));
            let scaled = patch.scaled(factor);
            let relief = Relief::new(WildMap::Noise.map(&mut Numbers::new(7)), 0.5, scale);
            let scene = Scene {
                mesh: scaled.mesh(),
                reliefs: vec![relief],
                materials: vec![Material::default()],
                parts: vec![],
                subdivisions: 8,
            };
            let settings = Settings { method, ..patch.settings(at(0.0), factor) };
            on_cpu(scene, &settings)
        };
        let here = seen_at(0);
        for exponent in [-15, 15] {
            let there = seen_at(exponent);
            assert_eq!((differing(&here.0, &there.0), here.1), (0, there.1), "{method} at 2^{exponent}");
        }
    }
}

/// Maps that go on are the same whole tiles away; of one that does not, the border is shown there.
#[test]
fn whole_tiles_change_nothing() {
    let patch = Model::patch(&mut Numbers::new(8));
    let settings = patch.settings(at(0.0), 1.0);
    let seen_with =
        |tiles: f64, wrap: Wrap| on_cpu(assembled(&[(&patch.shifted(tiles), vec![])], wrap, 16), &settings);
    for wrap in [Wrap::Repeat, Wrap::Mirror] {
        let here = seen_with(0.0, wrap);
        for tiles in [4.0, 1e4, 4e8] {
            let there = seen_with(tiles, wrap);
            assert_eq!((differing(&here.0, &there.0), here.1), (0, there.1), "{wrap:?} {tiles}");
        }
    }
    // Mirrored maps tell odd tiles from even ones.
    let [one, odd] = [1.0, 5.0].map(|tiles| seen_with(tiles, Wrap::Mirror).0);
    assert!(differing_much(&one, &odd) * 50 <= one.pixels.len());
    let [border, inside] = [4.0, 0.0].map(|tiles| seen_with(tiles, Wrap::Clamp).0);
    assert_eq!(differing(&border, &seen_with(4e8, Wrap::Clamp).0), 0);
    assert!(differing(&border, &inside) > border.pixels.len() / 4);
}

/// A light as far as it is bright, in units of any size.
#[test]
fn intensities_are_those_of_the_users_units() {
    let patch = Model::patch(&mut Numbers::new(9));
    let lit = |far: f64, intensity: f32| {
        let settings = patch.settings(at(far), 1.0);
        let lights: Vec<Light> =
            settings.lights.iter().map(|light| Light { intensity: Some(intensity), ..*light }).collect();
        let scene = assembled(&[(&patch.moved(at(far)), vec![])], Wrap::Repeat, 4);
        assert_ne!(scene.mesh.space.exponent, 0, "a power of two is at work");
        on_cpu(scene, &Settings { lights, ambient: 0.0, ..settings }).0
    };
    let brightest = |picture: &Picture| picture.pixels.iter().map(|pixel| pixel.x).fold(0.0, f32::max);
    let (one, two) = (lit(0.0, 8.0), lit(8e6, 16.0));
    // Doubled to the bit, the light as far; and 8 over the least squared distance, some 20, times 0.8 / pi or 0.8.
    assert_eq!(2.0 * brightest(&one), brightest(&two));
    assert!((0.05..0.8).contains(&brightest(&one)), "{}", brightest(&one));
}

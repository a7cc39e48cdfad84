//! Far from the origin on lavapipe: what `far.rs` asks of the CPU, by fewer pictures and rays.

use emboss::backend::Backend;
use emboss::settings::Wrap;
use emboss_tests::Numbers;
use emboss_tests::far::{Model, Moved, assembled, differing, pixel_rays, seen};
use emboss_tests::instances::rotation;
use emboss_tests::long::on_device;
use emboss_tests::oracle::Oracle;
use emboss_tests::scenes::ReadyJob;
use glam::{DAffine3, DVec3};

#[test]
fn pictures_are_the_same_wherever_the_model_stands_and_however_large() {
    on_device(|backend| {
        let patch = Model::patch(&mut Numbers::new(1));
        let mut at = |far: f64, factor: f64, places: bool| {
            let place = DAffine3::from_translation(DVec3::new(far, 0.0, -far));
            let model = if places { patch.clone() } else { patch.moved(place).scaled(factor) };
            let places = if places { vec![place] } else { vec![] };
            let scene = assembled(&[(&model, places)], Wrap::Repeat, 8);
            seen(backend, scene, &patch.settings(place, factor))
        };
        for (is_instance, others) in
            [(false, &[(4e9, 1.0), (0.0, 2_f64.powi(-39)), (0.0, 2_f64.powi(37))][..]), (true, &[(4e9, 1.0)])]
        {
            let here = at(0.0, 1.0, is_instance);
            for &(far, factor) in others {
                let there = at(far, factor, is_instance);
                assert_eq!((differing(&here.0, &there.0), here.1), (0, there.1), "{far} {factor}");
            }
        }
    });
}

#[test]
fn rigid_motions_move_the_picture() {
    on_device(|backend| {
        let mut numbers = Numbers::new(3);
        let (mut clear, mut all) = (0, 0);
        for far in [1e2, 1e6, 4e9] {
            let translation = numbers.direction().as_dvec3() * far;
            let motion = DAffine3::from_rotation_translation(rotation(&mut numbers), translation);
            let oracle = |job: &ReadyJob| Oracle::of_vulkan(&job.buffers, &job.frame, job.features);
            let moved = Moved::new(&Model::patch(&mut numbers), motion, 8, oracle);
            let (job, rays) = (&moved.there, pixel_rays(&moved.there));
            backend.load(&job.buffers, &job.frame, job.features).expect("fits");
            clear += moved.assert_right(&rays, &backend.trace_rays(&rays).expect("the device traces"));
            all += rays.len();
        }
        assert!(2 * clear > all, "{clear} of {all}");
    });
}

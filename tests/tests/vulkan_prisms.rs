//! What lavapipe makes of a scene before it traces it, against the CPU's: heights, seams, boxes; and changes to it.

use emboss::backend::Backend;
use emboss::settings::{Normals, Settings, Wrap};
use emboss_kernels::interface::{Displacement, NO_SEAMS, Triangle, height_format, method};
use emboss_kernels::math::UNIT_ROUNDOFF;
use emboss_kernels::scene::Features;
use emboss_tests::exact::patchwork;
use emboss_tests::scenes::{ReadyJob, builtin, job};
use emboss_tests::{changes, finish, lavapipe};
use glam::Vec3;

/// Most of what texels of these scenes' maps are worth: all are between 0 and 1, and so is `zero`.
fn magnitude(map: &Displacement) -> f32 {
    (1.0 + map.zero) * map.scale.abs()
}

/// Asserts that heights and boxes on the device are the CPU's, but for rounding.
fn assert_alike(job: &ReadyJob) {
    let mut backend = lavapipe();
    // What is prepared does not depend on the method; this one compiles fastest.
    let features = Features { method: method::NONE, ..job.features };
    backend.load(&job.buffers, &job.frame, features).unwrap();
    let host = job.view();
    let (triangles, seams) = backend.heights(host.triangles.len(), host.seams.len()).unwrap();

    // A texel's conversion may be off by 2.5 ulp (5 u), then come a difference, a product and the sum with the margin:
    // 8 u on either side. Texel coordinates are rounded too; these scenes have none on the border of a texel.
    let own_tolerance = |triangle: &Triangle| {
        16.0 * UNIT_ROUNDOFF * magnitude(&host.displacements[triangle.displacement as usize])
    };
    for (device, cpu) in triangles.iter().zip(host.triangles) {
        let worst = own_tolerance(cpu);
        assert!((device.height_min - cpu.height_min).abs() <= worst, "{device:?} {cpu:?}");
        assert!((device.height_max - cpu.height_max).abs() <= worst, "{device:?} {cpu:?}");
        assert!(cpu.height_min < cpu.height_max);
    }
    // Means of bilinear readings: 17 u and at most 3 + 4 u on the device, and the texel coordinates, off by 32 u of
    // |uv| + 1 times the map's side, at most 4 times 512 here, times steps of at most 1 from texel to texel.
    let side = host.displacements.iter().map(|map| map.map_width.max(map.map_height)).max().unwrap() as f32;
    let scale = host.displacements.iter().map(magnitude).fold(0.0, f32::max);
    let tolerance = UNIT_ROUNDOFF * (64.0 + 32.0 * 4.0 * side) * scale;
    for (device, cpu) in seams.iter().zip(host.seams) {
        assert_eq!((device.flags, device.directions), (cpu.flags, cpu.directions));
        for e in 0..3 {
            let pairs = [
                (device.heights[e], cpu.heights[e]),
                (device.height_min[e], cpu.height_min[e]),
                (device.height_max[e], cpu.height_max[e]),
            ];
            assert!(pairs.iter().all(|(a, b)| (a - b).abs() <= tolerance), "{device:?} {cpu:?}");
        }
    }
    let decided =
        |e: usize| host.seams.iter().any(|seams| seams.flags >> e & 1 != 0 && seams.heights[e] != 0.0);
    assert!(host.seams.is_empty() || (0..3).any(decided), "nothing is decided");

    // A corner is computed by no more operations than a micro-vertex, for which boxes are padded by 28 u of coordinate
    // and height: less than three times a box's greatest coordinate. What its height is off by comes on top.
    for ((device, cpu), triangle) in
        backend.prism_boxes().unwrap().iter().zip(job.boxes()).zip(host.triangles)
    {
        let greatest = cpu.min.abs().max(cpu.max.abs()).max_element();
        let height = if triangle.seams == NO_SEAMS { own_tolerance(triangle) } else { tolerance };
        let bound = Vec3::splat(3.0 * 28.0 * UNIT_ROUNDOFF * greatest + 2.0 * height);
        assert!((device.min - cpu.min).abs().cmple(bound).all(), "{device:?} {cpu:?}");
        assert!((device.max - cpu.max).abs().cmple(bound).all(), "{device:?} {cpu:?}");
    }
    let (boxes, bvh) = (backend.prism_boxes().unwrap(), backend.bvh().unwrap());
    assert_eq!(bvh.validate(&boxes).unwrap().nodes, backend.build_report().nodes as usize);
    finish(backend);
}

fn settings(normals: Normals, wrap: Wrap) -> Settings {
    Settings { normals, wrap, width: 1, height: 1, ..Settings::default() }
}

#[test]
fn knot_is_prepared_alike() {
    assert_alike(&job(builtin("builtin:knot"), &settings(Normals::Normalized, Wrap::Repeat)));
}

#[test]
fn quilt_is_prepared_alike() {
    assert_alike(&job(builtin("builtin:quilt"), &settings(Normals::Linear, Wrap::Clamp)));
}

#[test]
fn patchwork_is_prepared_alike() {
    let formats = [height_format::UNORM16, height_format::FLOAT32];
    assert_alike(&job(patchwork(3, formats, 4), &settings(Normals::Normalized, Wrap::Mirror)));
}

#[test]
fn views_change_without_a_build() {
    let mut backend = lavapipe();
    changes::assert_views_change(&mut backend);
    finish(backend);
}

#[test]
fn heights_change_with_their_boxes() {
    let mut backend = lavapipe();
    changes::assert_heights_change(&mut backend);
    finish(backend);
}

#[test]
fn code_changes_without_a_build() {
    let mut backend = lavapipe();
    changes::assert_code_changes(&mut backend);
    finish(backend);
}

#[test]
fn costly_trees_are_built_anew() {
    let mut backend = lavapipe();
    changes::assert_costly_trees_are_built_anew(&mut backend);
    finish(backend);
}

#[test]
fn what_is_not_finite_is_left_out() {
    let mut backend = lavapipe();
    changes::assert_what_is_not_finite_is_left_out(&mut backend);
    finish(backend);
}

//! A closed mesh stays closed: rays from within hit the surface, whatever displaces it.
//!
//! That they must: every point of the surface is displaced by no more than the greatest height, so while it moves in a
//! straight line from its place on the base mesh it stays away from a ray's origin that is farther from the base mesh.
//! Hence the surface goes round the origin as often as the base mesh does, once, and a ray to infinity crosses it.
//!
//! In the [long mode](emboss_tests::long) it is 10^9 rays, 2 x 10^8 a test.

use emboss::backend::Backend;
use emboss::backend::cpu::CpuBackend;
use emboss::render::Scene;
use emboss::scene::{Material, Relief};
use emboss::settings::{DisplacementKind, Filter, Normals, Settings, Weld, Wrap};
use emboss_kernels::interface::MISS;
use emboss_tests::long::{self, Cases};
use emboss_tests::meshes::{self, Placed, Solid, euler_characteristic, winding_number};
use emboss_tests::scenes::{self, ReadyJob, WildMap, job};
use emboss_tests::{LeakRays, Numbers};

const SCALES: [f64; 3] = [1e-6, 1.0, 1e6];
/// Distances from the origin, in extents.
const OFFSETS: [f64; 3] = [0.0, 1e2, 1e5];
const SUBDIVISIONS: [u32; 7] = [1, 2, 3, 7, 64, 1000, 4096];
const NORMALS: [Normals; 2] = [Normals::Normalized, Normals::Linear];
const WRAPS: [Wrap; 3] = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror];
/// Greatest height, as a share of the distance from origins of rays to the base mesh.
const RELIEF: f64 = 0.5;
/// The same for N of 1000 and more: still hundreds of micro-triangles' sides.
const FINE_RELIEF: f64 = 0.02;

/// How a placed solid is displaced.
#[derive(Clone, Copy, Debug)]
struct Displaced {
    map: WildMap,
    /// Of every second triangle, where that is another.
    second: Option<WildMap>,
    displacement: DisplacementKind,
    /// 0: outwards. 1: inwards.
    zero: f32,
    normals: Normals,
    weld: Weld,
    wrap: Wrap,
    filter: Filter,
    subdivisions: u32,
}

/// The scene, ready for rays.
fn displaced(placed: &Placed, how: Displaced, numbers: &mut Numbers) -> ReadyJob {
    let mut mesh = placed.mesh.clone();
    let share = if how.subdivisions < 1000 { RELIEF } else { FINE_RELIEF };
    // A vector's three components together are as long as a height.
    let components = if how.displacement == DisplacementKind::Height { 1_u8 } else { 3 };
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
    let scale = (share * placed.room / f64::from(components).sqrt()) as f32;
    let relief = |map: WildMap, numbers: &mut Numbers| Relief::new(map.map(numbers), how.zero, scale);
    let mut reliefs: Vec<Relief> = (0..components).map(|_| relief(how.map, numbers)).collect();
    if let Some(second) = how.second {
        reliefs.extend((0..components).map(|_| relief(second, numbers)));
        let others = mesh.triangles.iter_mut().skip(1).step_by(2);
        others.for_each(|triangle| triangle.displacement = u32::from(components));
    }
    let Displaced { displacement, normals, weld, wrap, filter, subdivisions, .. } = how;
    let settings =
        Settings { displacement, normals, weld, wrap, filter, width: 1, height: 1, ..Settings::default() };
    let mut job = job(
        Scene { mesh, reliefs, materials: vec![Material::default()], parts: vec![], subdivisions },
        &settings,
    );
    if filter == Filter::Trilinear {
        job.look_from_near();
    }
    job
}

/// Traces `count` rays; how many of them leak.
fn leaks(job: &ReadyJob, placed: &Placed, seed: u64, count: usize) -> usize {
    const BATCH: usize = 1 << 16;
    let source = LeakRays::new(job, &placed.inside, seed);
    let mut backend = CpuBackend::new();
    backend.load(&job.buffers, &job.frame, job.features).expect("a small scene fits");
    let mut leaks = 0;
    for first in (0..count).step_by(BATCH) {
        let rays = source.rays(first as u64, BATCH.min(count - first));
        let hits = backend.trace_rays(&rays).expect("the CPU does not fail");
        leaks += hits.iter().filter(|hit| hit.primitive == MISS).count();
    }
    leaks
}

/// Asserts that rays from within must hit.
fn assert_surrounded(placed: &Placed) {
    euler_characteristic(&placed.mesh);
    for p in &placed.inside {
        assert!((winding_number(&placed.mesh, p.as_dvec3()) - 1.0).abs() < 1e-6, "{p} is not inside");
    }
    assert!(placed.room > 0.0);
}

/// Rays of each N in a thousand: the finer, the dearer.
const SHARES: [usize; 7] = [350, 230, 248, 150, 20, 1, 1];

/// Rays of a solid.
fn rays_a_solid() -> usize {
    long::rays(500_000, 200_000_000)
}

/// Micro-triangles that the rays of a scene may be tested against at the greatest distance from the origin, for each
/// ray of the solid. There
/// rounding moves a micro-vertex by a tenth of the mesh, no bound tells micro-triangles apart, and each ray is tested
/// against most of them.
const TESTS: usize = 3;

/// At least `rays` rays through a solid at every scale and place, for every N, both directions, all maps and wraps.
fn assert_closed(solid: &Solid, seed: u64, second_map: bool, rays: usize) {
    assert_closed_under(&[DisplacementKind::Height], Filter::Bilinear, solid, seed, second_map, rays);
}

/// The same for several kinds of displacement, by turns.
fn assert_closed_under(
    kinds: &[DisplacementKind],
    filter: Filter,
    solid: &Solid,
    seed: u64,
    second_map: bool,
    rays: usize,
) {
    let each = (rays + rays / 2).div_ceil(1000 * SCALES.len() * OFFSETS.len() * NORMALS.len());
    let mut cases = Cases::new();
    // Maps, wraps and signs go round at lengths of 5, 3 and 2, which have no factor in common, along with the rest.
    let (mut turn, mut total) = (0, 0);
    for scale in SCALES {
        for offset in OFFSETS {
            let placed = solid.placed(scale, offset);
            assert_surrounded(&placed);
            // Where pixels are wider than micro-triangles, heights are known to half a pixel only, and each ray is
            // tested against all of those around it.
            let most = if filter == Filter::Bilinear { 4096 } else { 7 };
            let numbers_and_shares = SUBDIVISIONS.into_iter().zip(SHARES).filter(|&(n, _)| n <= most);
            for (n, share) in numbers_and_shares {
                for normals in NORMALS {
                    let how = Displaced {
                        map: WildMap::ALL[turn % 5],
                        second: second_map.then_some(WildMap::ALL[(turn + 1 + turn / 5 % 3) % 5]),
                        displacement: kinds[turn % kinds.len()],
                        zero: [0.0, 1.0][turn / 5 % 2],
                        normals,
                        weld: Weld::On,
                        wrap: WRAPS[turn % 3],
                        filter,
                        subdivisions: n,
                    };
                    let mut count = each * share;
                    if offset > 1e4 {
                        let tests = placed.mesh.triangles.len() * (n * n) as usize;
                        count = count.min(TESTS * rays / tests);
                    }
                    let what = format!("scale {scale}, offset {offset}, {how:?}");
                    cases.run(&what, || {
                        let mut numbers = Numbers::new(1000 * seed + turn as u64);
                        let job = displaced(&placed, how, &mut numbers);
                        assert_eq!(leaks(&job, &placed, numbers.bits(), count), 0, "{what}");
                        format!("{count} rays, none leaks")
                    });
                    (turn, total) = (turn + 1, total + count);
                }
            }
        }
    }
    cases.finish();
    assert!(total >= rays, "{total} rays");
}

/// The greatest N at the greatest distance from the origin, where each ray is tested against most of 10^8
/// micro-triangles.
#[test]
fn cube_is_closed_far_away_at_the_greatest_n() {
    let placed = meshes::cube().placed(1.0, 1e5);
    let how = Displaced {
        map: WildMap::Noise,
        second: None,
        displacement: DisplacementKind::Height,
        zero: 0.0,
        normals: Normals::Normalized,
        weld: Weld::On,
        wrap: Wrap::Repeat,
        filter: Filter::Bilinear,
        subdivisions: 4096,
    };
    assert_eq!(leaks(&displaced(&placed, how, &mut Numbers::new(6)), &placed, 7, 8), 0);
}

/// Asserts that the same rays leak where edges are not decided: that they find cracks.
fn assert_cracked(solid: &Solid, second_map: bool) {
    assert_cracked_under(DisplacementKind::Height, solid, second_map);
}

/// The same for a kind of displacement.
fn assert_cracked_under(displacement: DisplacementKind, solid: &Solid, second_map: bool) {
    let placed = solid.placed(1.0, 0.0);
    for normals in NORMALS {
        let how = Displaced {
            map: WildMap::Noise,
            second: second_map.then_some(WildMap::Odd),
            displacement,
            zero: 0.0,
            normals,
            weld: Weld::Off,
            wrap: Wrap::Clamp,
            filter: Filter::Bilinear,
            subdivisions: 7,
        };
        let leaks = leaks(&displaced(&placed, how, &mut Numbers::new(3)), &placed, 4, 20_000);
        assert!(leaks > 20, "{leaks} leaks, {how:?}");
    }
}

#[test]
fn sphere_is_closed() {
    let solid = meshes::icosphere(2);
    assert_cracked(&solid, false);
    assert_closed(&solid, 1, false, rays_a_solid());
}

#[test]
fn cube_is_closed() {
    assert_cracked(&meshes::cube(), false);
    assert_closed(&meshes::cube(), 2, false, rays_a_solid());
}

#[test]
fn knot_is_closed() {
    let solid = meshes::knot();
    assert_cracked(&solid, false);
    assert_closed(&solid, 3, false, rays_a_solid());
}

#[test]
fn solid_of_genus_three_is_closed() {
    let solid = meshes::genus_three(1);
    assert_cracked(&solid, false);
    assert_closed(&solid, 4, false, rays_a_solid());
}

/// All vertices are shared but those at the seams of the sphere: elsewhere it is the maps that disagree.
#[test]
fn sphere_of_two_maps_is_closed() {
    let solid = meshes::icosphere(1);
    assert_cracked(&solid, true);
    assert_closed(&solid, 5, true, rays_a_solid());
}

/// Three solids under vectors in tangent and in object space, of which one has two maps.
#[test]
fn solids_that_vectors_displace_are_closed() {
    let solids = [(meshes::cube(), false), (meshes::icosphere(1), true), (meshes::knot(), false)];
    for ((solid, second_map), seed) in solids.into_iter().zip(11..) {
        for kind in scenes::VECTORS {
            assert_cracked_under(kind, &solid, second_map);
        }
        // Their nodes are dearer than those of heights.
        assert_closed_under(
            &scenes::VECTORS,
            Filter::Bilinear,
            &solid,
            seed,
            second_map,
            rays_a_solid() / 10,
        );
    }
}

/// Three solids under maps that are filtered by their levels, of which one has two maps, by heights and vectors.
#[test]
fn solids_under_filtered_maps_are_closed() {
    let kinds = [DisplacementKind::Height, DisplacementKind::Tangent, DisplacementKind::Object];
    let solids = [(meshes::cube(), false), (meshes::icosphere(1), true), (meshes::knot(), false)];
    for ((solid, second_map), seed) in solids.into_iter().zip(21..) {
        assert_closed_under(&kinds, Filter::Trilinear, &solid, seed, second_map, rays_a_solid() / 400);
    }
}

//! How good the HLBVH is: against a builder that takes its time, and against Morton splits alone.

use emboss::bench::scene;
use emboss::bvh::sort::sort_pairs;
use emboss::bvh::{Bvh, BvhStats, Hlbvh, HostAabb};
use emboss::render::Scene;
use emboss::scene::{HeightMap, Material, Relief};
use emboss::settings::{Bounds, Method, Settings};
use emboss_kernels::aabb::Aabb;
use emboss_kernels::bvh::morton::{self, center_bounds, encode, split_level};
use emboss_kernels::bvh::radix_sort::result_half;
use emboss_kernels::bvh::{header, node::is_sound};
use emboss_kernels::counters::Counts;
use emboss_kernels::interface::{BuildStep, BvhNode};
use emboss_kernels::parallel::{Word, Workgroup};
use emboss_kernels::render::sample_pixel;
use emboss_kernels::scene::SceneView;
use emboss_tests::scenes::{self, ReadyJob};
use rayon::prelude::*;

/// The bound of the HLBVH's SAH cost and of the boxes that a ray tests in it, as a multiple of the binned builder's:
/// the promise, not what was measured, which this prints.
const MOST: f64 = 1.10;
/// The picture whose primary rays are counted.
const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;
/// Bits of the codes of [`morton_splits`]: those of the HLBVH up to 2^20 primitives.
const KEY_BITS: u32 = 32;

/// Boxes that a primary ray tests in a tree, in the mean.
fn steps(job: &ReadyJob, bvh: &Bvh) -> f64 {
    let view = SceneView { nodes: &bvh.nodes, primitives: &bvh.primitives, ..job.view() };
    let boxes = |i: u32| {
        let mut counts = Counts::default();
        sample_pixel(&view, job.features, i % WIDTH, i / WIDTH, 0, &mut counts);
        u64::from(counts.boxes)
    };
    (0..WIDTH * HEIGHT).into_par_iter().map(boxes).sum::<u64>() as f64 / f64::from(WIDTH * HEIGHT)
}

/// The tree whose every split is that of the kernels' sorted Morton codes at the highest bit in which they differ: what
/// the HLBVH is without its top.
fn morton_splits(boxes: &[Aabb]) -> Bvh {
    assert!(boxes.iter().all(|&bounds| is_sound(bounds)) && !boxes.is_empty());
    let count = u32::try_from(boxes.len()).expect("a test's scene");
    let words = |count: u32| (0..count).map(|_| Word::default()).collect::<Vec<_>>();
    let floats: Vec<f32> =
        boxes.iter().flat_map(|b| [b.min.to_array(), b.max.to_array()]).flatten().collect();
    let step = BuildStep { count, limbs: 1, ..BuildStep::default() };
    let (state, keys, order) = (words(header::WORDS), words(2 * count), words(2 * count));
    for id in 0..count.div_ceil(morton::BLOCK) {
        let mut shared = [0; size_of::<morton::BoundsShared>() / 4];
        center_bounds(Workgroup::new(id), &mut shared, &step, &floats, &state);
    }
    (0..count).for_each(|i| encode(&step, &floats, &state, &keys, &order, i));
    sort_pairs(&keys, &order, count, KEY_BITS);
    let sorted = (result_half(KEY_BITS) * count) as usize;
    let primitives: Vec<u32> = order[sorted..].iter().take(boxes.len()).map(Word::get).collect();
    let levels: Vec<u32> = (0..count - 1).map(|i| split_level(&step, &keys[sorted..], i)).collect();
    let mut bvh = Bvh { nodes: vec![BvhNode::default()], primitives };
    subtree(&mut bvh, boxes, &levels, 0, 0, boxes.len() - 1);
    bvh
}

/// Fills `node` with the tree over the sorted positions `first` to `last`.
fn subtree(bvh: &mut Bvh, boxes: &[Aabb], levels: &[u32], node: usize, first: usize, last: usize) -> Aabb {
    let word = |i: usize| u32::try_from(i).expect("a test's scene");
    if first == last {
        let Aabb { min, max } = boxes[bvh.primitives[first] as usize];
        bvh.nodes[node] = BvhNode { min, max, first: word(first), count: 1 };
        return Aabb { min, max };
    }
    let child = bvh.nodes.len();
    bvh.nodes.extend([BvhNode::default(); 2]);
    let split = (first..last).max_by_key(|&i| levels[i]).unwrap_or(first);
    let left = subtree(bvh, boxes, levels, child, first, split);
    let Aabb { min, max } = left.union(subtree(bvh, boxes, levels, child + 1, split + 1, last));
    bvh.nodes[node] = BvhNode { min, max, first: word(child), count: 0 };
    Aabb { min, max }
}

/// Holds the HLBVH of a scene to its promise, and prints what there is to know. Returns SAH cost and steps of Morton
/// splits, as multiples of the binned builder's.
#[expect(clippy::print_stdout, reason = "the figures are what the test is run by hand for")]
fn check(name: &str, job: &ReadyJob, boxes: &[Aabb]) -> (f64, f64) {
    let measured = |bvh: &Bvh| {
        let BvhStats { sah_cost, depth, .. } = bvh.validate(boxes).expect("a valid tree");
        (sah_cost, steps(job, bvh), depth)
    };
    let binned = measured(&Bvh::binned(boxes));
    let ours = measured(&Hlbvh::build(boxes).tree());
    let morton = measured(&morton_splits(boxes));
    println!("{name}, {} prisms:", boxes.len());
    for (builder, (cost, steps, depth)) in
        [("binned SAH", binned), ("HLBVH", ours), ("Morton splits", morton)]
    {
        let (relative_cost, relative_steps) = (cost / binned.0, steps / binned.1);
        println!(
            "  {builder:<13} SAH cost {cost:>7.2} ({relative_cost:.3}), boxes a ray {steps:>7.2} \
             ({relative_steps:.3}), depth {depth}"
        );
    }
    assert!(ours.0 <= MOST * binned.0, "{name}: SAH cost {} against {}", ours.0, binned.0);
    assert!(ours.1 <= MOST * binned.1, "{name}: {} boxes a ray against {}", ours.1, binned.1);
    (morton.0 / binned.0, morton.1 / binned.1)
}

fn check_builtin(name: &str) {
    let n = emboss::scene::builtin::load(name).expect("built in").subdivisions;
    let (scene, settings) = scenes::builtin_scene(name, n, WIDTH, HEIGHT);
    // The trees are put in the place of the scene's own, which stored bounds would be collapsed from.
    let settings = Settings { bounds: Bounds::None, ..settings };
    let job = scenes::job(scene, &Settings { shadows: false, ..settings });
    check(name, &job, job.boxes());
}

#[test]
fn knot() {
    check_builtin("builtin:knot");
}

#[test]
fn cube() {
    check_builtin("builtin:cube");
}

#[test]
fn quilt() {
    check_builtin("builtin:quilt");
}

/// The scene of `emboss bench build`, its base triangles traced by themselves.
#[test]
fn spheres() {
    let count = 1_000_000;
    let flat = Relief::new(HeightMap::flat(0.0), 0.0, 0.0);
    let scene = Scene {
        mesh: scene::mesh(count),
        reliefs: vec![flat],
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions: 1,
    };
    let settings = Settings {
        method: Method::None,
        shadows: false,
        width: WIDTH,
        height: HEIGHT,
        ..Settings::default()
    };
    let job = scenes::job(scene, &settings);
    let (cost, steps) = check("spheres", &job, &scene::boxes(count));
    // The control: without the top the promise would not be kept.
    assert!(cost > MOST && steps > MOST, "Morton splits are as good: {cost}, {steps}");
}

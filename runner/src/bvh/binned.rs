//! The reference: a tree built top-down with the surface area heuristic (SAH) evaluated at bins (Wald, "On fast
//! Construction of SAH-based Bounding Volume Hierarchies", 2007), on one thread of the host. What the
//! [HLBVH](emboss_kernels::bvh)'s quality is measured against.

use super::{Bvh, HostAabb};
use emboss_kernels::aabb::Aabb;
use emboss_kernels::bvh::node::is_sound;
use emboss_kernels::interface::{BvhNode, MAX_BVH_DEPTH};
use glam::Vec3;

/// Primitives of a leaf. A primitive is a prism, and to trace it costs tens of box tests (a walk over its cells):
/// so each gets a box of its own. Larger leaves would save nodes and lose time.
const LEAF_SIZE: usize = 1;

/// Candidate planes per axis are one fewer. From 8 to 32 bins the SAH cost of our scenes differs by less than 2 %,
/// so the number is not critical; fewer than 8 misses good planes.
const BINS: usize = 16;

impl Bvh {
    /// Builds the reference tree over `boxes`, which may be empty, equal or flat; those that are not [sound](is_sound)
    /// are left out. The same boxes give the same tree.
    ///
    /// # Panics
    /// If there are more than `u32::MAX / 2` boxes: their nodes would have no index.
    pub fn binned(boxes: &[Aabb]) -> Bvh {
        assert!(boxes.len() <= (u32::MAX / 2) as usize, "a mesh has at most 2^31 triangles");
        let mut primitives: Vec<u32> = (0..index(boxes.len())).collect();
        primitives.retain(|&primitive| is_sound(boxes[primitive as usize]));
        if primitives.is_empty() {
            return Bvh::default();
        }
        let mut builder = Builder {
            boxes,
            centers: boxes.iter().map(|b| b.center()).collect(),
            nodes: Vec::with_capacity(2 * boxes.len() - 1),
        };
        builder.nodes.push(BvhNode::default());
        builder.subtree(0, &mut primitives, 0, 0);
        Bvh { nodes: builder.nodes, primitives }
    }
}

/// State of a build.
struct Builder<'a> {
    boxes: &'a [Aabb],
    centers: Vec<Vec3>,
    nodes: Vec<BvhNode>,
}

/// A plane between two bins.
#[derive(Clone, Copy)]
struct Split {
    axis: usize,
    /// The first bin behind the plane.
    bin: usize,
    /// Sum over both sides of area times number of primitives.
    cost: f64,
    /// Primitives on the fuller side.
    larger: usize,
}

impl Split {
    /// Cheaper, or as cheap and more even: boxes in a line have no area, so that all their costs are 0.
    fn is_better_than(self, other: Split) -> bool {
        self.cost < other.cost || (self.cost == other.cost && self.larger < other.larger)
    }
}

/// The bins of one axis: where a centre falls.
struct Binning {
    axis: usize,
    low: f64,
    bins_per_unit: f64,
}

impl Binning {
    /// `None` where all centres share one coordinate: no plane parts them.
    fn new(centers: Aabb, axis: usize) -> Option<Binning> {
        let (low, high) = (f64::from(centers.min[axis]), f64::from(centers.max[axis]));
        (high > low).then(|| Binning { axis, low, bins_per_unit: BINS as f64 / (high - low) })
    }

    fn bin(&self, center: Vec3) -> usize {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to BINS, saturating")]
        let bin = ((f64::from(center[self.axis]) - self.low) * self.bins_per_unit) as usize;
        bin.min(BINS - 1)
    }
}

impl Builder<'_> {
    /// Fills node `node`, `depth` edges below the root, with the tree over `primitives`, which start at `first` in
    /// the whole list.
    ///
    /// Depth: let `levels(n)` = ceil(log2 n), what n primitives need when halved again and again. The invariant is
    /// `depth + levels(n) <= MAX_BVH_DEPTH`. It holds at the root (at most 31). A SAH split is taken only where it
    /// holds for the larger child; a median split has children of at most ceil(n/2), one level less, so there it
    /// always holds. A leaf is reached at the latest when `levels` is 0: no leaf is deeper than the limit.
    fn subtree(&mut self, node: usize, primitives: &mut [u32], first: usize, depth: u32) {
        let bounds = self.bounds(primitives);
        let (min, max) = (bounds.min, bounds.max);
        if primitives.len() <= LEAF_SIZE {
            self.nodes[node] = BvhNode { min, max, first: index(first), count: index(primitives.len()) };
            return;
        }
        let child = self.nodes.len();
        self.nodes[node] = BvhNode { min, max, first: index(child), count: 0 };
        self.nodes.extend([BvhNode::default(); 2]);
        let middle = self.partition(primitives, depth);
        let (left, right) = primitives.split_at_mut(middle);
        self.subtree(child, left, first, depth + 1);
        self.subtree(child + 1, right, first + middle, depth + 1);
    }

    /// Sorts `primitives` into two parts, neither empty; returns where the second starts.
    fn partition(&self, primitives: &mut [u32], depth: u32) -> usize {
        let centers = primitives.iter().fold(Aabb::EMPTY, |all, &p| all.including(self.center(p)));
        if let Some(split) = self.best_split(primitives, centers)
            && depth + 1 + levels(split.larger) <= MAX_BVH_DEPTH
            && let Some(binning) = Binning::new(centers, split.axis)
        {
            return partition_by(primitives, |p| binning.bin(self.center(p)) < split.bin);
        }
        self.halve(primitives, centers)
    }

    /// Splits at the median along the axis on which the centres spread most, equal centres by index.
    fn halve(&self, primitives: &mut [u32], centers: Aabb) -> usize {
        let size = centers.max.as_dvec3() - centers.min.as_dvec3();
        let axis = size.max_position();
        let middle = primitives.len() / 2;
        primitives.select_nth_unstable_by(middle, |&a, &b| {
            self.center(a)[axis].total_cmp(&self.center(b)[axis]).then(a.cmp(&b))
        });
        middle
    }

    /// The plane of least SAH cost. `None` where no plane parts the centres or no cost is finite.
    fn best_split(&self, primitives: &[u32], centers: Aabb) -> Option<Split> {
        (0..3)
            .filter_map(|axis| Binning::new(centers, axis))
            .flat_map(|binning| self.splits(primitives, &binning))
            .filter(|split| split.cost.is_finite())
            .reduce(|best, split| if split.is_better_than(best) { split } else { best })
    }

    /// The planes of an axis that leave neither side empty.
    fn splits(&self, primitives: &[u32], binning: &Binning) -> impl Iterator<Item = Split> + use<> {
        let mut bins = [(Aabb::EMPTY, 0_usize); BINS];
        for &p in primitives {
            let (bounds, count) = &mut bins[binning.bin(self.center(p))];
            *bounds = bounds.union(self.boxes[p as usize]);
            *count += 1;
        }
        let merge = |a: (Aabb, usize), b: (Aabb, usize)| (a.0.union(b.0), a.1 + b.1);
        let mut above = [(Aabb::EMPTY, 0); BINS + 1];
        for bin in (0..BINS).rev() {
            above[bin] = merge(above[bin + 1], bins[bin]);
        }
        let (axis, mut below) = (binning.axis, (Aabb::EMPTY, 0));
        (1..BINS).filter_map(move |bin| {
            below = merge(below, bins[bin - 1]);
            let weight = |side: (Aabb, usize)| side.0.half_area() * side.1 as f64;
            let cost = weight(below) + weight(above[bin]);
            let larger = below.1.max(above[bin].1);
            (below.1 > 0 && above[bin].1 > 0).then_some(Split { axis, bin, cost, larger })
        })
    }

    fn bounds(&self, primitives: &[u32]) -> Aabb {
        primitives.iter().fold(Aabb::EMPTY, |all, &p| all.union(self.boxes[p as usize]))
    }

    fn center(&self, primitive: u32) -> Vec3 {
        self.centers[primitive as usize]
    }
}

/// Levels below a node over `n` primitives when every split halves: ceil(log2 n).
fn levels(n: usize) -> u32 {
    n.next_power_of_two().trailing_zeros()
}

/// An index as the nodes store it. [`Bvh::binned`] has checked that they all fit.
fn index(i: usize) -> u32 {
    u32::try_from(i).expect("binned() bounds the number of nodes")
}

/// Moves the items that satisfy `first` to the front, keeping their order; returns how many there are.
fn partition_by(items: &mut [u32], first: impl Fn(u32) -> bool) -> usize {
    let (front, back): (Vec<u32>, Vec<u32>) = items.iter().partition(|&&item| first(item));
    items[..front.len()].copy_from_slice(&front);
    items[front.len()..].copy_from_slice(&back);
    front.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::BvhStats;
    use emboss_kernels::bvh::node::LARGEST;
    use emboss_kernels::sampler::{pcg4d, unit_float};
    use glam::UVec4;

    fn random_boxes(count: u32) -> Vec<Aabb> {
        (0..count)
            .map(|i| {
                let bits = pcg4d(UVec4::new(i, 1, 2, 3));
                let min = Vec3::new(unit_float(bits.x), unit_float(bits.y), unit_float(bits.z));
                Aabb { min, max: min + 0.02 * unit_float(bits.w) }
            })
            .collect()
    }

    fn built(boxes: &[Aabb]) -> BvhStats {
        Bvh::binned(boxes).validate(boxes).expect("a built tree is valid")
    }

    fn point(x: f32) -> Aabb {
        Aabb { min: Vec3::new(x, 0.0, 0.0), max: Vec3::new(x, 0.0, 0.0) }
    }

    #[test]
    fn an_empty_scene_has_no_nodes() {
        assert_eq!(Bvh::binned(&[]), Bvh::default());
        assert_eq!(built(&[]), BvhStats::default());
    }

    #[test]
    fn every_primitive_has_a_leaf_of_its_own() {
        for count in [1, 2, 3, 7, 1000] {
            let stats = built(&random_boxes(count));
            assert_eq!((stats.leaves, stats.largest_leaf), (count as usize, 1));
            assert_eq!(stats.nodes, 2 * count as usize - 1);
        }
    }

    /// The heuristic has to pay: a tree of 1000 small boxes in the unit cube costs less than half of a tree whose
    /// splits ignore where the boxes are.
    #[test]
    fn sah_beats_splits_by_index() {
        let boxes = random_boxes(1000);
        let by_index = Bvh::build_by_index(&boxes).validate(&boxes).expect("valid").sah_cost;
        let sah = built(&boxes).sah_cost;
        assert!(2.0 * sah < by_index, "{sah} against {by_index}");
    }

    impl Bvh {
        /// A reference without any heuristic: halves by index.
        fn build_by_index(boxes: &[Aabb]) -> Bvh {
            let equal = vec![boxes[0]; boxes.len()];
            let mut bvh = Bvh::binned(&equal);
            for i in (0..bvh.nodes.len()).rev() {
                let node = bvh.nodes[i];
                let bounds = if node.count > 0 {
                    boxes[bvh.primitives[node.first as usize] as usize]
                } else {
                    let child = |c: u32| bvh.nodes[(node.first + c) as usize];
                    let bounds = |n: BvhNode| Aabb { min: n.min, max: n.max };
                    bounds(child(0)).union(bounds(child(1)))
                };
                (bvh.nodes[i].min, bvh.nodes[i].max) = (bounds.min, bounds.max);
            }
            bvh
        }
    }

    #[test]
    fn equal_centers_are_halved() {
        let stats = built(&vec![Aabb { min: Vec3::ZERO, max: Vec3::ONE }; 1000]);
        assert_eq!(stats.depth, 10);
    }

    /// On each of two axes, each point is 16 times as far as the one before: of the 16 bins the last holds the last
    /// point, the first all others, so that every SAH split takes one point off. Unlimited, the tree of 120 points
    /// would be 119 deep.
    #[test]
    fn geometric_progressions_keep_the_depth_limit() {
        let on_axis = |i: i32, axis: Vec3| axis * 2.0_f32.powi(4 * i - 120);
        let points = (0..60).flat_map(|i| [on_axis(i, Vec3::X), on_axis(i, Vec3::Y)]);
        let boxes: Vec<Aabb> = points.map(|p| Aabb { min: p, max: p }).collect();
        let stats = built(&boxes);
        assert!(stats.depth <= MAX_BVH_DEPTH, "depth {}", stats.depth);
        // The limit, not balance, is what ends it: SAH is followed as long as it may be.
        assert!(stats.depth > MAX_BVH_DEPTH - 8, "depth {}", stats.depth);
    }

    #[test]
    fn huge_boxes_are_sorted_and_unbounded_ones_left_out() {
        let mut boxes = random_boxes(100);
        boxes.push(Aabb { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY });
        boxes.push(Aabb { min: Vec3::ZERO, max: Vec3::NAN });
        boxes.push(Aabb { min: Vec3::splat(-LARGEST), max: Vec3::splat(LARGEST) });
        assert_eq!(built(&boxes).leaves, 101);
    }

    #[test]
    fn lines_and_points_are_sorted() {
        let boxes: Vec<Aabb> = (0..1000).map(|i| point(i as f32)).collect();
        // As even as bins allow: 16 bins of 62 or 63 points, halved.
        assert_eq!(built(&boxes).depth, 10);
        built(&[point(1.0); 3]);
    }

    #[test]
    fn the_same_boxes_give_the_same_tree() {
        let boxes = random_boxes(500);
        assert_eq!(Bvh::binned(&boxes), Bvh::binned(&boxes));
    }

    #[test]
    fn levels_are_the_rounded_up_logarithm() {
        let expected = [(1, 0), (2, 1), (3, 2), (4, 2), (5, 3), (1 << 20, 20), ((1 << 20) + 1, 21)];
        for (n, l) in expected {
            assert_eq!(levels(n), l, "n = {n}");
        }
    }
}

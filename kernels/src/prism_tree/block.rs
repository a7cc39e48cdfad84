//! Blocks: the leaves of a heap, 4 x 4 micro-triangles that share 15 micro-vertices.

use crate::barycentric::{exact_weight, grid_point, grid_weight, interpolate};
use crate::counters::Counts;
use crate::displacement::cell::Cell;
use crate::displacement::surface::{BaseTriangle, HeightField, intersect_micro_triangle};
use crate::hit::Hit;
use crate::interface::{NO_SEAMS, bounds, displacement_kind};
use crate::math::{at, difference_of_products, fma3};
use crate::prism_tree::corners::Corners;
use crate::prism_tree::layout::{BLOCK_SIDE, Layout, heap_nodes, levels};
use crate::ray::TraversalRay;
use crate::scene::{Features, SceneView};
use glam::Vec3;

/// A block of a triangle's grid. Points and cells of it that lie beyond the grid are not there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Least j of its grid points.
    pub j: u32,
    /// Least k of its grid points.
    pub k: u32,
    /// Upright: the grid points from (j, k) on with j' + k' <= j + k + 4. Inverted: those up to (j + 4, k + 4) with
    /// j' + k' >= j + k + 4.
    pub inverted: bool,
}

/// Points of a block.
pub const POINTS: u32 = (BLOCK_SIDE + 1) * (BLOCK_SIDE + 2) / 2;

impl Block {
    /// The block that is child number `i` of a heap over sides of `n` parts: blocks are numbered on from the heap's
    /// nodes.
    ///
    /// The digits of its number, two bits each from the root on, say which child was taken: 0, 1 and 2 are those at the
    /// corners, 3 is the turned one between them.
    #[inline]
    pub fn of_heap(n: u32, i: u32) -> Block {
        let levels = levels(n);
        let digits = i - heap_nodes(levels);
        let mut block = Block { j: 0, k: 0, inverted: false };
        let mut level = levels;
        while level > 0 {
            level -= 1;
            let digit = digits >> (2 * level) & 3;
            let side = BLOCK_SIDE << level;
            let middle = digit == 3;
            let to_j = if middle { block.inverted } else { (digit == 1) != block.inverted };
            let to_k = if middle { block.inverted } else { (digit == 2) != block.inverted };
            block = Block {
                j: block.j + if to_j { side } else { 0 },
                k: block.k + if to_k { side } else { 0 },
                inverted: block.inverted != middle,
            };
        }
        block
    }

    /// Grid point number (a, b), a + b <= 4: of an upright block it lies at (j + a, k + b), of an inverted one
    /// opposite.
    #[inline]
    pub fn point(&self, a: u32, b: u32) -> (u32, u32) {
        if self.inverted {
            (self.j + BLOCK_SIDE - a, self.k + BLOCK_SIDE - b)
        } else {
            (self.j + a, self.k + b)
        }
    }

    /// The same point where it lies in the grid of sides of `n` parts, else another one that does.
    #[inline]
    fn point_within(&self, a: u32, b: u32, n: u32) -> (u32, u32) {
        let (j, k) = self.point(a, b);
        let j = j.min(n);
        (j, k.min(n - j))
    }

    /// Whether some of its points lie on the grid's border.
    #[inline]
    fn is_at_border(&self, n: u32) -> bool {
        let last = self.j + self.k + if self.inverted { 2 * BLOCK_SIDE } else { BLOCK_SIDE };
        self.j == 0 || self.k == 0 || last >= n
    }

    /// The cell whose first vertex is point (a, b), or where it is `turned` whose first vertex is (a + 1, b + 1) and
    /// whose others are those of the former: see [`Cell::vertex`].
    #[inline]
    fn cell(&self, a: u32, b: u32, turned: bool) -> Cell {
        if self.inverted {
            Cell { j: self.j + BLOCK_SIDE - 1 - a, k: self.k + BLOCK_SIDE - 1 - b, upper: !turned }
        } else {
            Cell { j: self.j + a, k: self.k + b, upper: turned }
        }
    }
}

/// Does something for each of a block's points: its place among them, a, and b.
macro_rules! for_each_point {
    ($do:ident) => {
        $do!(0, 0, 0);
        $do!(1, 0, 1);
        $do!(2, 0, 2);
        $do!(3, 0, 3);
        $do!(4, 0, 4);
        $do!(5, 1, 0);
        $do!(6, 1, 1);
        $do!(7, 1, 2);
        $do!(8, 1, 3);
        $do!(9, 2, 0);
        $do!(10, 2, 1);
        $do!(11, 2, 2);
        $do!(12, 3, 0);
        $do!(13, 3, 1);
        $do!(14, 4, 0);
    };
}

/// Does something for each cell that is not turned: its number, a, b, and the places of points (a, b), (a, b + 1) and
/// (a + 1, b), its corners.
macro_rules! for_each_cell {
    ($do:ident) => {
        $do!(0, 0, 0, 0, 1, 5);
        $do!(1, 0, 1, 1, 2, 6);
        $do!(2, 0, 2, 2, 3, 7);
        $do!(3, 0, 3, 3, 4, 8);
        $do!(4, 1, 0, 5, 6, 9);
        $do!(5, 1, 1, 6, 7, 10);
        $do!(6, 1, 2, 7, 8, 11);
        $do!(7, 2, 0, 9, 10, 12);
        $do!(8, 2, 1, 10, 11, 13);
        $do!(9, 3, 0, 12, 13, 14);
    };
}

/// Does something for each turned cell: the number of cell (a, b) beside it, a, b, and the numbers of cells (a, b + 1)
/// and (a + 1, b), which are beside it too.
macro_rules! for_each_turned_cell {
    ($do:ident) => {
        $do!(0, 0, 0, 1, 4);
        $do!(1, 0, 1, 2, 5);
        $do!(2, 0, 2, 3, 6);
        $do!(4, 1, 0, 5, 7);
        $do!(5, 1, 1, 6, 8);
        $do!(7, 2, 0, 8, 9);
    };
}

/// Does something for each of a block's five grid lines in a direction.
macro_rules! for_each_line {
    ($do:ident) => {
        $do!(0);
        $do!(1);
        $do!(2);
        $do!(3);
        $do!(4);
    };
}

/// Grid lines of a block in each direction.
const LINES: usize = BLOCK_SIDE as usize + 1;

/// The [weights](grid_weight) of a block's grid lines: of j by a, of k by b, of what is left by a + b. Lines beyond the
/// grid have some weight.
struct Weights {
    along_j: [f32; LINES],
    along_k: [f32; LINES],
    rest: [f32; LINES],
}

impl Weights {
    #[inline]
    fn new(block: Block, n: u32) -> Weights {
        let mut weights = Weights { along_j: [0.0; LINES], along_k: [0.0; LINES], rest: [0.0; LINES] };
        if n & (n - 1) == 0 {
            // As `grid_weight` does, but with one branch for all.
            macro_rules! weigh {
                ($line:literal) => {
                    let (j, k) = block.point($line, $line);
                    let (j0, k0) = block.point(0, $line);
                    weights.along_j[$line] = exact_weight(j, n);
                    weights.along_k[$line] = exact_weight(k, n);
                    weights.rest[$line] = exact_weight(n - (j0 + k0).min(n), n);
                };
            }
            for_each_line!(weigh);
        } else {
            macro_rules! weigh {
                ($line:literal) => {
                    let (j, k) = block.point($line, $line);
                    let (j0, k0) = block.point(0, $line);
                    weights.along_j[$line] = grid_weight(j, n);
                    weights.along_k[$line] = grid_weight(k, n);
                    weights.rest[$line] = grid_weight(n - (j0 + k0).min(n), n);
                };
            }
            for_each_line!(weigh);
        }
        weights
    }
}

/// The micro-vertices of a block, in the order of its points. What stands for points that are not there is not read.
pub type Points = [Vec3; POINTS as usize];

/// What micro-vertices of triangles are read from.
#[derive(Clone, Copy)]
pub struct MicroVertices<'a> {
    scene: SceneView<'a>,
    features: Features,
    layout: Layout,
}

impl<'a> MicroVertices<'a> {
    /// Those of a scene.
    #[inline]
    pub fn new(scene: &SceneView<'a>, features: Features) -> MicroVertices<'a> {
        MicroVertices {
            scene: *scene,
            features,
            layout: Layout::new(scene.frame.triangle_count, scene.frame.subdivisions),
        }
    }

    /// The micro-vertices of a block: bit for bit those of
    /// [`BaseTriangle::micro_vertex`], from what is stored of the triangle.
    #[inline]
    pub fn of_block(&self, triangle: u32, block: Block) -> Points {
        // No early return: see `micro_vertex`.
        if self.features.bounds != bounds::ALL {
            self.computed(triangle, block)
        } else if self.features.displacement != displacement_kind::HEIGHT {
            self.stored(triangle, block)
        } else {
            self.lifted(triangle, block)
        }
    }

    /// Those of a block of which nothing is stored.
    #[inline]
    fn computed(&self, triangle: u32, block: Block) -> Points {
        let field = HeightField::new(&self.scene, self.features);
        let base = BaseTriangle::load(&self.scene, triangle);
        let mut points = [Vec3::ZERO; POINTS as usize];
        // A loop: the code of a micro-vertex is large.
        let (mut i, mut a, mut b) = (0, 0, 0);
        while i < POINTS {
            let (j, k) = block.point(a, b);
            if j + k <= field.subdivisions {
                points[i as usize] = base.micro_vertex(&field, j, k);
            }
            b += 1;
            if a + b > BLOCK_SIDE {
                a += 1;
                b = 0;
            }
            i += 1;
        }
        points
    }

    /// Those of vectors, which are stored themselves.
    #[inline]
    fn stored(&self, triangle: u32, block: Block) -> Points {
        let n = self.scene.frame.subdivisions;
        let mut points = [Vec3::ZERO; POINTS as usize];
        macro_rules! read {
            ($i:literal, $a:literal, $b:literal) => {
                let (j, k) = block.point_within($a, $b, n);
                let first = 3 * self.layout.micro_vertex(triangle, j, k);
                points[$i] = point_at(self.scene.micro_vertices, first);
            };
        }
        for_each_point!(read);
        points
    }

    /// Those of heights, of which the lifts are stored.
    #[inline]
    fn lifted(&self, triangle: u32, block: Block) -> Points {
        let n = self.scene.frame.subdivisions;
        let corners = Corners::load(self.scene.prism_tree, self.layout.record(triangle));
        let Weights { along_j, along_k, rest } = Weights::new(block, n);
        // What points of equal a + b have of the first corner.
        let (mut p0, mut n0) = ([Vec3::ZERO; LINES], [Vec3::ZERO; LINES]);
        macro_rules! weigh {
            ($line:literal) => {
                (p0[$line], n0[$line]) = (corners.p[0] * rest[$line], corners.n[0] * rest[$line]);
            };
        }
        for_each_line!(weigh);
        let mut points = [Vec3::ZERO; POINTS as usize];
        macro_rules! lift {
            ($i:literal, $a:literal, $b:literal) => {
                // As `interpolate` does.
                let p = fma3(along_k[$b], corners.p[2], fma3(along_j[$a], corners.p[1], p0[$a + $b]));
                let direction = fma3(along_k[$b], corners.n[2], fma3(along_j[$a], corners.n[1], n0[$a + $b]));
                let (j, k) = block.point_within($a, $b, n);
                let lift = at(self.scene.micro_vertices, self.layout.micro_vertex(triangle, j, k));
                points[$i] = fma3(lift, direction, p);
            };
        }
        for_each_point!(lift);
        if self.features.seams != 0 && corners.seams != NO_SEAMS && block.is_at_border(n) {
            macro_rules! put_on_seam {
                ($i:literal, $a:literal, $b:literal) => {
                    let (j, k) = block.point_within($a, $b, n);
                    let on_border = j == 0 || k == 0 || j + k == n;
                    // Of other points something is read.
                    let place = self.layout.border(corners.seams, j, if on_border { k } else { 0 });
                    let seam = point_at(self.scene.micro_vertices, place);
                    points[$i] = if on_border { seam } else { points[$i] };
                };
            }
            for_each_point!(put_on_seam);
        }
        points
    }

    /// The micro-vertex over grid point (j, k) of which something is stored: the same bits.
    #[inline]
    fn stored_one(&self, triangle: u32, j: u32, k: u32) -> Vec3 {
        let (n, floats) = (self.scene.frame.subdivisions, self.scene.micro_vertices);
        let place = self.layout.micro_vertex(triangle, j, k);
        if self.features.displacement != displacement_kind::HEIGHT {
            point_at(floats, 3 * place)
        } else {
            let corners = Corners::load(self.scene.prism_tree, self.layout.record(triangle));
            let on_border = j == 0 || k == 0 || j + k == n;
            if self.features.seams != 0 && corners.seams != NO_SEAMS && on_border {
                point_at(floats, self.layout.border(corners.seams, j, k))
            } else {
                let w = grid_point(j, k, n);
                let p = interpolate(w, corners.p[0], corners.p[1], corners.p[2]);
                fma3(at(floats, place), interpolate(w, corners.n[0], corners.n[1], corners.n[2]), p)
            }
        }
    }

    /// The nearer of `nearest` and the ray's hits on the micro-triangles of a block.
    ///
    /// First the signs of edge functions, which neighbours share, tell those that the ray may meet: mostly one or none.
    /// They alone go through the whole test.
    #[inline]
    pub fn intersect(
        &self,
        triangle: u32,
        ray: &TraversalRay,
        block: Block,
        nearest: Hit,
        counts: &mut Counts,
    ) -> Hit {
        let n = self.scene.frame.subdivisions;
        let mut points = self.of_block(triangle, block);
        macro_rules! shear {
            ($i:literal, $a:literal, $b:literal) => {
                points[$i] = ray.shear_point(points[$i]);
            };
        }
        for_each_point!(shear);
        // Of cell (a, b): the edge functions from point (a, b) to (a, b + 1) and to (a + 1, b), and between these two.
        let (mut along, mut across, mut between) = ([0.0; CELLS], [0.0; CELLS], [0.0; CELLS]);
        macro_rules! measure {
            ($cell:literal, $a:literal, $b:literal, $p:literal, $along:literal, $across:literal) => {
                along[$cell] = edge_function(points[$p], points[$along]);
                across[$cell] = edge_function(points[$p], points[$across]);
                between[$cell] = edge_function(points[$along], points[$across]);
            };
        }
        for_each_cell!(measure);
        let mut met = 0;
        macro_rules! judge {
            ($cell:literal, $a:literal, $b:literal, $p:literal, $along:literal, $across:literal) => {
                let cell = block.cell($a, $b, false);
                let is_there = cell.j + cell.k + (cell.upper as u32) < n;
                counts.triangles += is_there as u32;
                let may_be = is_there && !are_mixed(across[$cell], -between[$cell], -along[$cell]);
                met |= (may_be as u32) << $cell;
            };
        }
        for_each_cell!(judge);
        macro_rules! judge_turned {
            ($cell:literal, $a:literal, $b:literal, $right:literal, $below:literal) => {
                let cell = block.cell($a, $b, true);
                let is_there = cell.j + cell.k + (cell.upper as u32) < n;
                counts.triangles += is_there as u32;
                let may_be = is_there && !are_mixed(between[$cell], along[$below], -across[$right]);
                met |= (may_be as u32) << ($cell + FIRST_TURNED);
            };
        }
        for_each_turned_cell!(judge_turned);
        let mut nearest = nearest;
        while met != 0 {
            let bit = met.trailing_zeros();
            met &= met - 1;
            let turned = bit >= FIRST_TURNED;
            let (a, b) = place_of_cell(if turned { bit - FIRST_TURNED } else { bit });
            let mut corners = [Vec3::ZERO; 3];
            let mut e = 0;
            // A loop, so that the code of a micro-vertex stands here once.
            while e < 3 {
                let to_a = ((e == 1) != turned) as u32;
                let to_b = ((e == 2) != turned) as u32;
                corners[e as usize] = if self.features.bounds == bounds::ALL {
                    let (j, k) = block.point(a + to_a, b + to_b);
                    ray.shear_point(self.stored_one(triangle, j, k))
                } else {
                    points[place_of_point(a + to_a, b + to_b) as usize]
                };
                e += 1;
            }
            let cell = block.cell(a, b, turned);
            nearest = intersect_micro_triangle(triangle, ray, cell, corners, nearest);
        }
        nearest
    }
}

/// The edge function of a side between two sheared points: twice the area of its triangle with the ray. Between the
/// points the other way round it has the other sign.
#[inline]
fn edge_function(from: Vec3, to: Vec3) -> f32 {
    difference_of_products(to.x, from.y, to.y, from.x)
}

/// Whether some are positive and some negative: then the ray passes the triangle.
#[inline]
fn are_mixed(e0: f32, e1: f32, e2: f32) -> bool {
    (e0 < 0.0 || e1 < 0.0 || e2 < 0.0) && (e0 > 0.0 || e1 > 0.0 || e2 > 0.0)
}

/// How many of a block's cells are not turned. Their bits come first.
const CELLS: usize = 10;
/// The bit of the turned cell beside cell 0.
const FIRST_TURNED: u32 = 16;

/// a and b of cell number `cell`.
#[inline]
fn place_of_cell(cell: u32) -> (u32, u32) {
    let a = (cell >= 4) as u32 + (cell >= 7) as u32 + (cell >= 9) as u32;
    (a, cell + a * a.wrapping_sub(1) / 2 - 4 * a)
}

/// The number of point (a, b).
#[inline]
fn place_of_point(a: u32, b: u32) -> u32 {
    // a (a - 1) / 2 for a up to 4, three bits each.
    5 * a + b - (0o63100 >> (3 * a) & 7)
}

#[inline]
fn point_at(floats: &[f32], first: u32) -> Vec3 {
    Vec3::new(at(floats, first), at(floats, first + 1), at(floats, first + 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_those_of_the_lists() {
        macro_rules! check_point {
            ($i:literal, $a:literal, $b:literal) => {
                assert_eq!(place_of_point($a, $b), $i);
            };
        }
        for_each_point!(check_point);
        macro_rules! check_cell {
            ($cell:literal, $a:literal, $b:literal, $p:literal, $along:literal, $across:literal) => {
                assert_eq!(place_of_cell($cell), ($a, $b));
                let places = [($a, $b), ($a, $b + 1), ($a + 1, $b)].map(|(a, b)| place_of_point(a, b));
                assert_eq!(places, [$p, $along, $across]);
            };
        }
        for_each_cell!(check_cell);
        macro_rules! check_turned {
            ($cell:literal, $a:literal, $b:literal, $right:literal, $below:literal) => {
                let places = [$cell, $right, $below].map(place_of_cell);
                assert_eq!(places, [($a, $b), ($a, $b + 1), ($a + 1, $b)]);
            };
        }
        for_each_turned_cell!(check_turned);
    }

    /// Blocks of a heap tile the grid: each cell of it lies in one of them, once.
    #[test]
    fn blocks_tile_the_grid() {
        for n in [1, 3, 4, 5, 8, 13, 16, 64] {
            let mut taken = vec![0; 2 * (n * n) as usize];
            let first = heap_nodes(levels(n));
            for i in 0..1 << (2 * levels(n)) {
                let block = Block::of_heap(n, first + i);
                for (a, b, turned) in (0..4)
                    .flat_map(|a| (0..4 - a).map(move |b| (a, b)))
                    .flat_map(|(a, b)| [(a, b, false), (a, b, true)])
                    .filter(|&(a, b, turned)| !turned || a + b < 3)
                {
                    let cell = block.cell(a, b, turned);
                    if cell.j + cell.k + u32::from(cell.upper) < n {
                        taken[(2 * (cell.j * n + cell.k) + u32::from(cell.upper)) as usize] += 1;
                    }
                }
            }
            assert_eq!(taken.iter().sum::<i32>(), (n * n) as i32, "N = {n}");
            assert!(taken.iter().all(|&count| count <= 1), "N = {n}");
        }
    }
}

//! Meshes out of positions and texture coordinates in doubles: each stored about an origin of its own, in `f32`.

use super::Mesh;
use crate::space::{RenderSpace, origin_of};
use emboss_kernels::interface::Vertex;
use glam::{DAffine3, DVec2, DVec3, Vec3};
use std::collections::HashMap;

/// A corner with all the digits of its file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PreciseVertex {
    /// Where it is, in world units; finite, also as `f32`.
    pub position: DVec3,
    /// Its normal, of any length; zero where it is to be computed.
    pub normal: Vec3,
    /// Texture coordinates; finite, also as `f32`.
    pub uv: DVec2,
}

impl Mesh {
    /// Builds a mesh about its own origin ([`origin_of`] the box of the corners that triangles use), each triangle with
    /// the index of its material; else as [`Mesh::from_triangles`].
    ///
    /// Of texture coordinates whole tiles are subtracted where a *chart*, triangles that share corners of one position
    /// and texture coordinates, lies outside [-1, 2]: so many that it is about 0, the same for all of the chart, and an
    /// even number, so that maps which repeat, mirrored or not, are read as before. [`Mesh::tiles`] keeps them for maps
    /// that do not.
    ///
    /// Triangles of which corners coincide as they are given are [dropped](Mesh::dropped); those whose corners come to
    /// coincide by rounding, closer than 2^-23 of the mesh's size, are [collapsed](Mesh::collapsed).
    pub fn from_precise(
        vertices: &[PreciseVertex],
        triangles: impl ExactSizeIterator<Item = ([u32; 3], u32)>,
    ) -> Mesh {
        let triangles: Vec<([u32; 3], u32)> = triangles.collect();
        let at = |v: u32| vertices[v as usize].position;
        let coincide = |[a, b, c]: [u32; 3]| at(a) == at(b) || at(b) == at(c) || at(c) == at(a);
        let given = triangles.len();
        let triangles: Vec<_> = triangles.into_iter().filter(|&(triangle, _)| !coincide(triangle)).collect();
        let used = || triangles.iter().flat_map(|(triangle, _)| *triangle).map(at);
        let origin = match (used().reduce(DVec3::min), used().reduce(DVec3::max)) {
            (Some(min), Some(max)) => origin_of(min, max),
            _ => DVec3::ZERO,
        };
        let tiles = tiles(vertices, &triangles);
        let rounded = |(i, vertex): (usize, &PreciseVertex)| {
            let uv = (vertex.uv - tiles.get(i).copied().unwrap_or_default()).as_vec2();
            let position = (vertex.position - origin).as_vec3();
            Vertex { position, normal: vertex.normal, u: uv.x, v: uv.y }
        };
        let rounded: Vec<Vertex> = vertices.iter().enumerate().map(rounded).collect();
        let dropped = given - triangles.len();
        let mesh = Mesh::with_tiles(&rounded, &tiles, triangles.into_iter());
        let collapsed = mesh.dropped;
        Mesh { dropped, collapsed, space: RenderSpace { origin, exponent: 0 }, ..mesh }
    }

    /// [`from_precise`](Self::from_precise) of each of the [`groups`] that the triangles are in, at least one mesh;
    /// what is left out of groups that come to nothing is counted with the first.
    pub fn apart_from_precise(
        vertices: &[PreciseVertex],
        triangles: impl Iterator<Item = ([u32; 3], u32)>,
    ) -> Vec<Mesh> {
        let groups = groups(vertices, triangles);
        let meshes = groups.into_iter().map(|group| Mesh::from_precise(vertices, group.into_iter()));
        let (mut meshes, empty): (Vec<Mesh>, Vec<Mesh>) = meshes.partition(|mesh| !mesh.triangles.is_empty());
        if meshes.is_empty() {
            meshes.push(Mesh::default());
        }
        for Mesh { dropped, collapsed, .. } in empty {
            meshes[0].dropped += dropped;
            meshes[0].collapsed += collapsed;
        }
        meshes
    }

    /// The mesh in another place, about an origin that it has there; `None` as of [`Mesh::transformed`].
    pub fn placed(&self, world_from_model: DAffine3) -> Option<Mesh> {
        let world =
            |vertex: &Vertex| world_from_model.transform_point3(self.space.world(vertex.position.as_dvec3()));
        let (min, max) = bounds(self.vertices.iter().map(world))?;
        let space = RenderSpace { origin: origin_of(min, max), ..self.space };
        self.carried(world_from_model, space)
    }

    /// The mesh with its positions in another space, rounded once; `None` where nothing is left there.
    pub fn in_space(&self, space: RenderSpace) -> Option<Mesh> {
        if self.space == space { Some(self.clone()) } else { self.carried(DAffine3::IDENTITY, space) }
    }

    /// The corners of its box in the world, least first; `None` where it has no vertex.
    pub fn world_bounds(&self) -> Option<(DVec3, DVec3)> {
        let (min, max) = self.bounds()?;
        Some((self.space.world(min.as_dvec3()), self.space.world(max.as_dvec3())))
    }

    /// Adds the subtracted [tiles](Mesh::tiles) again to all charts of which a triangle `reads_clamped`: a map that
    /// does not repeat. A chart that lay outside 0 to 1 does so again, so that its clamped maps show their borders,
    /// which do not depend on digits.
    pub fn with_whole_coordinates(
        &mut self,
        reads_clamped: impl Fn(&emboss_kernels::interface::Triangle) -> bool,
    ) {
        if self.tiles.is_empty() {
            return;
        }
        let key = |v: usize| {
            let Vertex { position, u, v: w, .. } = self.vertices[v];
            let tile = self.tiles[v];
            let mesh = self.starts.partition_point(|&start| start as usize <= v) as u64;
            let [x, y, z] = position.to_array().map(|x| u64::from((x + 0.0).to_bits()));
            let [u, w] = [u, w].map(|x| u64::from((x + 0.0).to_bits()));
            [mesh, x, y, z, u, w, tile.x.to_bits(), tile.y.to_bits()]
        };
        let count = self.vertices.len();
        let charts = Charts::of((0..count).map(key), self.triangles.iter().map(|t| t.vertices));
        let mut is_clamped = vec![false; count];
        for triangle in self.triangles.iter().filter(|triangle| reads_clamped(triangle)) {
            is_clamped[charts.of_vertex(triangle.vertices[0])] = true;
        }
        for (v, vertex) in (0_u32..).zip(&mut self.vertices) {
            if is_clamped[charts.of_vertex(v)] {
                let uv = DVec2::new(vertex.u.into(), vertex.v.into()) + self.tiles[v as usize];
                [vertex.u, vertex.v] = uv.as_vec2().to_array();
            }
        }
        self.tiles.clear();
    }
}

/// Groups of triangles that stand so far apart that they cannot share an origin: one of each two of them lies farther
/// from the other than [`APART`] times its own size. There are at most [`MOST_GROUPS`]; no two share a corner.
///
/// A group is divided where none of its triangles is, in the middle of the widest gap along the longest side of its
/// box. Gaps below 1/1000 of that side are not looked for.
pub fn groups(
    vertices: &[PreciseVertex],
    triangles: impl Iterator<Item = ([u32; 3], u32)>,
) -> Vec<Vec<([u32; 3], u32)>> {
    let mut undivided = vec![triangles.collect::<Vec<_>>()];
    let mut groups = Vec::new();
    while let Some(group) = undivided.pop() {
        let is_full = groups.len() + undivided.len() + 1 >= MOST_GROUPS;
        match gap(vertices, &group).filter(|_| !is_full) {
            None => groups.push(group),
            Some((axis, place)) => {
                let is_below =
                    |&(triangle, _): &([u32; 3], u32)| vertices[triangle[0] as usize].position[axis] < place;
                let (below, above) = group.into_iter().partition(is_below);
                undivided.extend([above, below]);
            }
        }
    }
    groups
}

/// See [`groups`]: nearer than that a group keeps at least 12 bits of its size.
pub const APART: f64 = 4096.0;
/// See [`groups`].
pub const MOST_GROUPS: usize = 64;

/// The axis along which triangles are to be divided, and where; `None` where they are not.
fn gap(vertices: &[PreciseVertex], triangles: &[([u32; 3], u32)]) -> Option<(usize, f64)> {
    const BINS: usize = 2048;
    let corners = |triangle: &[u32; 3]| triangle.map(|v| vertices[v as usize].position);
    let (min, max) = bounds(triangles.iter().flat_map(|(triangle, _)| corners(triangle)))?;
    let axis = (max - min).max_position();
    let (start, length) = (min[axis], max[axis] - min[axis]);
    if !length.is_normal() {
        return None;
    }
    // How many triangles begin in each bin, less those that have ended before it.
    let mut covered = vec![0_i64; BINS + 1];
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "from 0 to the number of bins"
    )]
    let bin = |x: f64| (((x - start) / length * BINS as f64) as usize).min(BINS - 1);
    for (triangle, _) in triangles {
        let ends = corners(triangle).map(|p| bin(p[axis]));
        covered[ends.into_iter().min()?] += 1;
        covered[ends.into_iter().max()? + 1] -= 1;
    }
    let (mut widest, mut run, mut sum) = (0..0, 0..0, 0);
    for (i, change) in covered[..BINS].iter().enumerate() {
        sum += change;
        run = if sum > 0 { i + 1..i + 1 } else { run.start..i + 1 };
        if run.len() > widest.len() {
            widest = run.clone();
        }
    }
    if widest.len() < 2 {
        return None;
    }
    let place = start + length * ((widest.start + widest.end) as f64 / (2 * BINS) as f64);
    let side = |is_below: bool| {
        let of_side = triangles.iter().map(|(triangle, _)| corners(triangle));
        bounds(of_side.filter(|corners| (corners[0][axis] < place) == is_below).flatten())
    };
    let ((low_min, low_max), (high_min, high_max)) = (side(true)?, side(false)?);
    let smaller = (low_max - low_min).max_element().min((high_max - high_min).max_element());
    (high_min[axis] - low_max[axis] > APART * smaller).then_some((axis, place))
}

/// The box around points, least corner first; `None` around none.
pub(crate) fn bounds(points: impl Iterator<Item = DVec3>) -> Option<(DVec3, DVec3)> {
    points.fold(None, |bounds, p| match bounds {
        None => Some((p, p)),
        Some((min, max)) => Some((min.min(p), max.max(p))),
    })
}

/// What to subtract from each vertex's texture coordinates; empty where that is nothing.
fn tiles(vertices: &[PreciseVertex], triangles: &[([u32; 3], u32)]) -> Vec<DVec2> {
    let is_far = |uv: DVec2| uv.min_element() < -1.0 || uv.max_element() > 2.0;
    if !vertices.iter().any(|vertex| is_far(vertex.uv)) {
        return Vec::new();
    }
    let key = |vertex: &PreciseVertex| {
        let PreciseVertex { position, uv, .. } = vertex;
        [position.x, position.y, position.z, uv.x, uv.y].map(|x| (x + 0.0).to_bits())
    };
    let charts = Charts::of(vertices.iter().map(key), triangles.iter().map(|&(triangle, _)| triangle));
    let mut boxes: Vec<Option<(DVec2, DVec2)>> = vec![None; vertices.len()];
    for &v in triangles.iter().flat_map(|(triangle, _)| triangle) {
        let uv = vertices[v as usize].uv;
        let bounds = &mut boxes[charts.of_vertex(v)];
        *bounds = Some(bounds.map_or((uv, uv), |(min, max)| (min.min(uv), max.max(uv))));
    }
    let tile_of = |bounds: Option<(DVec2, DVec2)>| {
        let (min, max) = bounds.unwrap_or_default();
        DVec2::new(tile(min.x, max.x), tile(min.y, max.y))
    };
    let of_chart: Vec<DVec2> = boxes.into_iter().map(tile_of).collect();
    let tiles: Vec<_> = (0..vertices.len()).map(|v| of_chart[charts.of_vertex(index(v))]).collect();
    if tiles.iter().all(|&tile| tile == DVec2::ZERO) { Vec::new() } else { tiles }
}

/// The even number that is subtracted from coordinates from `min` to `max`.
fn tile(min: f64, max: f64) -> f64 {
    if min <= 2.0 && max >= -1.0 {
        return 0.0;
    }
    // At least 2.
    let one = DVec3::X;
    origin_of(one * min, one * max.max(min + 1.0)).x
}

/// Which vertices are of one chart.
struct Charts {
    /// For each vertex the first of its chart.
    first: Vec<u32>,
}

impl Charts {
    /// Vertices of one key, and those of one triangle, are of one chart.
    fn of<K: Eq + std::hash::Hash>(
        keys: impl Iterator<Item = K>,
        triangles: impl Iterator<Item = [u32; 3]>,
    ) -> Charts {
        let mut first_of = HashMap::new();
        let mut first: Vec<u32> =
            keys.zip(0_u32..).map(|(key, v)| *first_of.entry(key).or_insert(v)).collect();
        for [a, b, c] in triangles {
            for (a, b) in [(a, b), (a, c)] {
                let (a, b) = (root(&mut first, a), root(&mut first, b));
                first[a.max(b) as usize] = a.min(b);
            }
        }
        // Each points to one before it, which points to its chart's first already.
        for v in 0..first.len() {
            first[v] = first[first[v] as usize];
        }
        Charts { first }
    }

    /// The vertex that stands for the chart of `v`.
    fn of_vertex(&self, v: u32) -> usize {
        self.first[v as usize] as usize
    }
}

/// The vertex that the chart of `v` leads to; paths are halved on the way.
fn root(first: &mut [u32], mut v: u32) -> u32 {
    while first[v as usize] != v {
        first[v as usize] = first[first[v as usize] as usize];
        v = first[v as usize];
    }
    v
}

fn index(v: usize) -> u32 {
    u32::try_from(v).expect("a mesh has at most 2^32 - 1 vertices")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(x: f64, y: f64, u: f64, v: f64) -> PreciseVertex {
        PreciseVertex { position: DVec3::new(x, y, 0.25), normal: Vec3::ZERO, uv: DVec2::new(u, v) }
    }

    /// A grid of two by two cells with its texture coordinates along it, from so far.
    fn patch(far: f64, tiles: f64) -> (Vec<PreciseVertex>, Vec<([u32; 3], u32)>) {
        let at = |i: u32| {
            let (x, y) = (f64::from(i % 3) * 0.5, f64::from(i / 3) * 0.5);
            corner(far + x, y - far, tiles + x, y - tiles)
        };
        let cells = [0, 1, 3, 4].into_iter().flat_map(|a| [([a, a + 1, a + 4], 0), ([a, a + 4, a + 3], 0)]);
        ((0..9).map(at).collect(), cells.collect())
    }

    fn mesh(patch: &(Vec<PreciseVertex>, Vec<([u32; 3], u32)>)) -> Mesh {
        Mesh::from_precise(&patch.0, patch.1.iter().copied())
    }

    /// Offsets are multiples of the grid, 2, and such that all digits are in doubles.
    #[test]
    fn meshes_are_the_same_wherever_they_stand() {
        let near = mesh(&patch(0.0, 0.0));
        assert_eq!((near.space, near.dropped, near.collapsed), (RenderSpace::default(), 0, 0));
        for far in [1e3, 1e6, 1e9, 2_f64.powi(50)] {
            let there = mesh(&patch(far, 0.0));
            assert_eq!(there.space.origin, DVec3::new(far, -far, 0.0));
            assert_eq!((&there.vertices, &there.triangles), (&near.vertices, &near.triangles));
            assert_eq!(there.world_bounds().expect("not empty").0, DVec3::new(far, -far, 0.25));
        }
    }

    #[test]
    fn whole_tiles_are_subtracted_and_come_back() {
        let near = mesh(&patch(0.0, 0.0));
        for tiles in [4.0, 1e6, 1e12] {
            let there = mesh(&patch(0.0, tiles));
            assert_eq!(there.vertices, near.vertices);
            assert!(there.tiles.iter().all(|tile| *tile == DVec2::new(tiles, -tiles)));
            let (mut kept, mut whole) = (there.clone(), there);
            kept.with_whole_coordinates(|_| false);
            assert_eq!((&kept.vertices, kept.tiles.len()), (&near.vertices, 0));
            whole.with_whole_coordinates(|_| true);
            #[expect(clippy::cast_possible_truncation, reason = "rounded, as it is to be")]
            let expected = |vertex: &Vertex| (f64::from(vertex.u) + tiles) as f32;
            assert!(whole.vertices.iter().zip(&near.vertices).all(|(a, b)| a.u == expected(b)));
        }
    }

    /// A chart is one piece, so that no seam appears within it; one that reaches the map itself stays as it is.
    #[test]
    fn charts_are_moved_as_a_whole() {
        let one = |i: u32, u: f64| corner(f64::from(i % 8), f64::from(i * i), u, 0.5);
        let us = [1.5, 2.5, 3.5, 901.25, 902.25, 1903.5, 300_007.75, 4e5, 5.5e5];
        let vertices: Vec<_> = (0..).zip(us).map(|(i, u)| one(i, u)).collect();
        let triangles = [([0, 1, 2], 0), ([3, 4, 5], 0), ([6, 7, 8], 1)];
        let mesh = Mesh::from_precise(&vertices, triangles.into_iter());
        let us: Vec<f32> = mesh.vertices.iter().map(|vertex| vertex.u).collect();
        // Charts 1002 and 2.5e5 long: multiples of 1024 and 2^18.
        assert_eq!(us[..6], [1.5, 2.5, 3.5, -122.75, -121.75, 879.5]);
        assert_eq!(us[6..], [-224_280.25, -124_288.0, 25_712.0]);
        // One triangle that reads a clamped map takes all of its chart with it.
        let mut clamped = mesh.clone();
        clamped.with_whole_coordinates(|triangle| triangle.material() == 1);
        let us: Vec<f32> = clamped.vertices.iter().map(|vertex| vertex.u).collect();
        assert_eq!((us[3], us[6], us[8]), (-122.75, 300_007.75, 5.5e5));
    }

    /// Corners that the file tells apart are not dropped, far from the origin either; what `f32` cannot tell apart in a
    /// mesh of that size is counted for itself.
    #[test]
    fn what_is_left_out_is_counted_by_its_cause() {
        let vertices: Vec<_> =
            [0.0, 1e-6, 2e-6, 1.0, 1.0].map(|x| corner(1e6 + x, 1e6 + x * x, x, 0.0)).into();
        let triangles = [([0, 1, 3], 0), ([1, 2, 3], 0), ([0, 3, 4], 0)];
        let mesh = Mesh::from_precise(&vertices, triangles.into_iter());
        assert_eq!((mesh.triangles.len(), mesh.dropped, mesh.collapsed), (2, 1, 0));
        let wide = [triangles.to_vec(), vec![([0, 3, 5], 0)]].concat();
        let vertices = [vertices, vec![corner(9e7, 0.0, 0.0, 0.0)]].concat();
        let mesh = Mesh::from_precise(&vertices, wide.into_iter());
        assert_eq!((mesh.triangles.len(), mesh.dropped, mesh.collapsed), (1, 1, 2));
    }

    /// A marker left at the origin, a patch far away, and another one: three origins. Near ones share theirs.
    #[test]
    fn what_stands_far_apart_is_in_groups_of_its_own() {
        let together = |places: &[f64]| {
            let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
            for &far in places {
                let first = index(vertices.len());
                let (corners, faces) = patch(far, 0.0);
                vertices.extend(corners);
                triangles
                    .extend(faces.into_iter().map(|(face, material)| (face.map(|v| first + v), material)));
            }
            let groups = groups(&vertices, triangles.into_iter());
            let meshes = groups.into_iter().map(|group| Mesh::from_precise(&vertices, group.into_iter()));
            meshes.map(|mesh| (mesh.space.origin.x, mesh.vertices)).collect::<Vec<_>>()
        };
        let near = mesh(&patch(0.0, 0.0)).vertices;
        let expected: Vec<_> = [0.0, 5e5, 4e9].map(|far| (far, near.clone())).into();
        assert_eq!(together(&[0.0, 5e5, 4e9]), expected);
        assert_eq!(together(&[4e9, 0.0, 5e5]), expected);
        assert_eq!(together(&[0.0, 1000.0]).len(), 1);
        // As many as there may be, and no more: the widest gap is before the last one of them.
        let many: Vec<f64> = (0..100).map(|i| 1e6 * 1.2_f64.powi(i)).collect();
        assert_eq!(together(&many).len(), MOST_GROUPS);
    }

    #[test]
    fn placed_meshes_have_an_origin_there() {
        let near = mesh(&patch(0.0, 0.0));
        let far = DVec3::new(3e9, 0.0, -1e6);
        let placed = near.placed(DAffine3::from_translation(far)).expect("finite");
        assert_eq!((placed.space.origin, &placed.vertices), (far, &near.vertices));
        let back = placed.placed(DAffine3::from_translation(-far)).expect("finite");
        assert_eq!((back.space, back.vertices), (near.space, near.vertices.clone()));
        let other = RenderSpace { origin: DVec3::X * 2.0, exponent: 3 };
        let moved = near.in_space(other).expect("finite");
        assert_eq!(moved.vertices[0].position, (near.vertices[0].position - Vec3::X * 2.0) * 8.0);
        assert_eq!(moved.world_bounds(), near.world_bounds());
    }
}

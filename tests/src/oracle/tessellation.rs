//! The micro-triangle surface in f64, stored: what the kernels never do.

use super::cutting::{Cut, Cutting};
use super::relief::{Cover, Relief};
use super::rounding::{Rounding, UNIT_ROUNDOFF};
use super::vectors::{Axes, End, Moved};
use super::welding::{Decided, Side, Welding, texel_scale, uv};
use emboss::backend::SceneBuffers;
use emboss_kernels::interface::{FLIPPED, Frame, displacement_kind, filter, normals};
use emboss_kernels::scene::Features;
use glam::{DVec2, DVec3};

/// A micro-triangle within its piece, by the grid points (j, k) of its three vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Cell {
    pub(super) j: u32,
    pub(super) k: u32,
    pub(super) upper: bool,
}

impl Cell {
    /// The cell of a packed word as `Intersection::cell` documents it: j in 13 bits, k in 13 bits, a bit for upper.
    pub(super) fn unpack(word: u32) -> Cell {
        Cell { j: word % 8192, k: word / 8192 % 8192, upper: word / 8192 / 8192 % 2 == 1 }
    }

    /// The other way round.
    pub(super) fn pack(self) -> u32 {
        self.j + 8192 * (self.k + 8192 * u32::from(self.upper))
    }

    /// The grid points of its vertices, in the order of the base triangle's.
    pub(super) fn grid_points(self) -> [(u32, u32); 3] {
        let Cell { j, k, upper } = self;
        if upper { [(j + 1, k + 1), (j, k + 1), (j + 1, k)] } else { [(j, k), (j + 1, k), (j, k + 1)] }
    }
}

/// Squares a side of a [`Block`], two cells each. From 2 to 6 times at N = 17 differ by no more than they do from run
/// to run, and larger blocks make a smaller tree.
pub(super) const BLOCK: u32 = 4;

/// The cells of a piece with j and k from these on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Block {
    /// Index of the base triangle.
    pub(super) piece: u32,
    pub(super) j: u32,
    pub(super) k: u32,
}

/// Which micro-vertices are one and the same: those of an edge belong to all triangles that share it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum VertexKey {
    /// At a junction.
    Corner(u32),
    /// On the base edge between two junctions, ascending, so many steps from the first.
    Edge(u32, u32, u32),
    /// Inside a base triangle, at grid point (j, k).
    Inside(u32, u32, u32),
}

/// What all pieces are made from.
pub(super) struct Base<'a> {
    buffers: &'a SceneBuffers,
    reliefs: Vec<Relief>,
    welding: Welding,
    /// One of [`displacement_kind`].
    pub(super) kind: u32,
    /// Whether directions stay as long as interpolation makes them.
    pub(super) linear: bool,
    pub(super) rounding: Rounding,
    /// From where pixels are seen, where maps are filtered by their levels.
    sight: Option<Sight>,
    cutting: Cutting,
}

/// From where pixels are seen.
struct Sight {
    eye: DVec3,
    /// Side of a pixel at distance 1.
    pixel: f64,
    /// The greatest height, up or down.
    reach: f64,
}

/// A place on the base mesh or an edge of it, where maps are read.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub(super) point: DVec3,
    /// Sums of the magnitudes of the terms of `point`.
    pub(super) magnitude: DVec3,
}

impl<'a> Base<'a> {
    /// Decides what the triangles of `frame` share.
    pub(super) fn new(
        buffers: &'a SceneBuffers,
        frame: &Frame,
        features: Features,
        rounding: Rounding,
    ) -> Base<'a> {
        let filtered = features.filter != filter::BILINEAR;
        let reliefs: Vec<Relief> =
            buffers.displacements.iter().map(|map| Relief::new(buffers, map, filtered)).collect();
        let welding = Welding::new(buffers, &reliefs, frame.triangle_count, features.seams != 0, rounding);
        let linear = features.normals == normals::LINEAR;
        let sight = filtered.then(|| Sight {
            eye: frame.camera.eye.as_dvec3(),
            pixel: 2.0 * frame.camera.up.as_dvec3().length() / f64::from(frame.height),
            reach: f64::from(frame.height_min.abs().max(frame.height_max.abs())),
        });
        let (kind, cutting) = (features.displacement, Cutting::new(frame, features));
        Base { buffers, reliefs, welding, kind, linear, rounding, sight, cutting }
    }

    /// What a map gives at texture coordinates `uv`, the magnitudes of whose terms add up to `terms`, at a place where
    /// texels are of the size `texels.x` and no more than `texels.y` are covered; and how far an f32 evaluation may be
    /// off.
    pub(super) fn height(
        &self,
        relief: &Relief,
        uv: DVec2,
        terms: DVec2,
        place: Place,
        texels: DVec2,
    ) -> (f64, f64) {
        let Some(sight) = &self.sight else {
            return (relief.height(uv), relief.height_error(terms, self.rounding));
        };
        let distance = place.point.distance(sight.eye);
        let (side, finest) = (sight.pixel * (distance - sight.reach).max(0.0), relief.finest(texels.x));
        // The point is off by its interpolation; difference, root, sums and products take less than 24 u.
        let off =
            (self.rounding.interpolation() * place.magnitude).length() + 24.0 * (distance + sight.reach);
        let covered = (side / finest).min(texels.y);
        let error = UNIT_ROUNDOFF * (sight.pixel * off / finest + 32.0 * covered);
        let cover = if covered.is_finite() { Cover { texels: covered, error } } else { Cover::ONE };
        (relief.height_seen(uv, cover), relief.height_seen_error(terms, cover, self.rounding))
    }

    /// The maps of a vector's components, the first of them at `map`.
    pub(super) fn components(&self, map: u32) -> &[Relief] {
        &self.reliefs[map as usize..][..3]
    }
}

/// Where and how a micro-vertex is displaced.
struct Site {
    point: DVec3,
    /// Sums of the magnitudes of the terms of `point`.
    magnitude: DVec3,
    direction: DVec3,
    /// Error of `direction`, in u.
    direction_error: f64,
    height: f64,
    height_error: f64,
}

impl Site {
    /// The micro-vertex.
    fn vertex(&self, linear: bool) -> DVec3 {
        let direction = if linear { self.direction } else { self.direction.normalize_or_zero() };
        self.point + self.height * direction
    }

    /// How far f32 arithmetic may move it.
    ///
    /// Two vectors within d of each other, one of them of length l, differ in direction by at most 2 d / l; finding the
    /// length and dividing the height by it add to the displacement's length. A direction, however wrong, is no longer
    /// than 1, so that two are at most 2 apart. The last fused operation rounds the coordinate, and its product.
    fn error(&self, linear: bool, rounding: Rounding) -> f64 {
        let direction = if linear {
            UNIT_ROUNDOFF * self.direction_error
        } else {
            let turned = 2.0 * self.direction_error / self.direction.length();
            (UNIT_ROUNDOFF * (turned + rounding.by_length())).min(2.0)
        };
        let lift = self.height.abs() * direction + self.height_error;
        let magnitude = (rounding.interpolation() + 1.0) * self.magnitude;
        let lifted = DVec3::splat((1.0 + rounding.product) * self.height.abs());
        lift + UNIT_ROUNDOFF * (magnitude + lifted).length()
    }
}

/// The displaced grid over one base triangle.
pub(super) struct Piece {
    /// Index of the base triangle.
    pub(super) base: u32,
    /// Least corner of the box around its micro-vertices.
    pub(super) min: DVec3,
    /// Greatest corner.
    pub(super) max: DVec3,
    /// Its micro-vertices, row by row: (0,0), (0,1), .. (0,N), (1,0), ..
    vertices: Vec<DVec3>,
    /// Texture coordinates of the base triangle's vertices.
    pub(super) uv: [DVec2; 3],
    /// Whether the stored order is clockwise seen from outside.
    pub(super) flipped: bool,
    /// Greatest distance by which f32 arithmetic may move one of its micro-vertices.
    pub(super) error: f64,
    junctions: [u32; 3],
    cut: Cut,
}

impl Piece {
    /// Displaces the grid of base triangle `triangle`: P + h n / |n|, all interpolated linearly, or P + h n where
    /// directions are linear. Where the interpolated normal vanishes there is no direction to displace in, and the
    /// vertex stays.
    pub(super) fn new(base: &Base<'_>, triangle: u32) -> Self {
        let border = Border::new(base, triangle);
        let cut = base.cutting.of(border.positions);
        let n = cut.n;
        let mut piece = Piece {
            base: triangle,
            min: DVec3::INFINITY,
            max: DVec3::NEG_INFINITY,
            vertices: Vec::with_capacity((n as usize + 1) * (n as usize + 2) / 2),
            uv: border.uv,
            flipped: base.buffers.triangles[triangle as usize].flags & FLIPPED != 0,
            error: 0.0,
            junctions: border.junctions,
            cut,
        };
        for (j, k) in (0..=n).flat_map(|j| (0..=n - j).map(move |k| (j, k))) {
            let w = piece.weights(j, k);
            let (vertex, error) = if base.kind == displacement_kind::HEIGHT {
                let site = border.site(base, w);
                (site.vertex(base.linear), site.error(base.linear, base.rounding))
            } else {
                border.moved(base, w)
            };
            piece.error = piece.error.max(error);
            piece.min = piece.min.min(vertex);
            piece.max = piece.max.max(vertex);
            piece.vertices.push(vertex);
        }
        piece
    }

    /// The blocks that its cells fall into.
    pub(super) fn blocks(&self) -> impl Iterator<Item = Block> + use<> {
        let (piece, n) = (self.base, self.cut.n);
        let starts = move |from| (0..n - from).step_by(BLOCK as usize);
        starts(0).flat_map(move |j| starts(j).map(move |k| Block { piece, j, k }))
    }

    /// The micro-vertices of a block's cells, row by row.
    pub(super) fn block_rows(&self, block: Block) -> impl Iterator<Item = &[DVec3]> {
        let (n, Block { j, k, .. }) = (self.cut.n, block);
        (j..=(j + BLOCK).min(n - k)).map(move |j| {
            let (first, last) = (self.index((j, k)), self.index((j, (k + BLOCK).min(n - j))));
            &self.vertices[first..=last]
        })
    }

    /// The cells of a block.
    pub(super) fn block_cells(&self, block: Block) -> impl Iterator<Item = Cell> + use<> {
        let (n, Block { j, k, .. }) = (self.cut.n, block);
        (j..(j + BLOCK).min(n)).flat_map(move |j| {
            (k..(k + BLOCK).min(n - j)).flat_map(move |k| {
                let lower = Cell { j, k, upper: false };
                let upper = Cell { j, k, upper: true };
                std::iter::once(lower).chain((j + k + 1 < n).then_some(upper))
            })
        })
    }

    /// The box around a block's micro-vertices.
    pub(super) fn block_bounds(&self, block: Block) -> (DVec3, DVec3) {
        let points = self.block_rows(block).flatten();
        points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), &p| (min.min(p), max.max(p)))
    }

    /// Place of grid point (j, k) among the vertices: rows 0 to j - 1 have N + 1, N, .. of them.
    fn index(&self, (j, k): (u32, u32)) -> usize {
        let (n, j, k) = (self.cut.n as usize, j as usize, k as usize);
        j * (n + 1) - j * (j.max(1) - 1) / 2 + k
    }

    /// The micro-vertex over grid point (j, k).
    pub(super) fn vertex(&self, point: (u32, u32)) -> DVec3 {
        self.vertices[self.index(point)]
    }

    /// The micro-vertices of a cell.
    pub(super) fn corners(&self, cell: Cell) -> [DVec3; 3] {
        cell.grid_points().map(|point| self.vertex(point))
    }

    /// Barycentric coordinates on the base triangle of the place over which the micro-vertex of grid point (j, k)
    /// stands.
    pub(super) fn weights(&self, j: u32, k: u32) -> [f64; 3] {
        self.cut.place((j, k)).map(|m| f64::from(m) / f64::from(self.cut.n))
    }

    /// What the micro-vertex at a grid point shares with those of other base triangles.
    pub(super) fn key(&self, (j, k): (u32, u32)) -> VertexKey {
        let steps = self.cut.common_place((j, k));
        let present: Vec<(u32, u32)> =
            self.junctions.into_iter().zip(steps).filter(|&(_, steps)| steps > 0).collect();
        match present[..] {
            [(junction, _)] => VertexKey::Corner(junction),
            [(a, _), (b, from_a)] if a < b => VertexKey::Edge(a, b, from_a),
            [(a, from_b), (b, _)] => VertexKey::Edge(b, a, from_b),
            _ => VertexKey::Inside(self.base, j, k),
        }
    }
}

/// A base triangle with what is decided along its border.
struct Border<'a> {
    positions: [DVec3; 3],
    normals: [DVec3; 3],
    uv: [DVec2; 3],
    axes: [Axes; 3],
    texels: [DVec2; 3],
    map: u32,
    junctions: [u32; 3],
    corners: [Option<&'a Decided>; 3],
    /// What vectors at corners are the mean of, where triangles disagree.
    readings: [Option<&'a [Side]>; 3],
    /// The sides of the edge across from each corner, where it is a seam.
    sides: [Option<&'a [Side]>; 3],
}

impl<'a> Border<'a> {
    fn new(base: &'a Base<'_>, triangle: u32) -> Border<'a> {
        let triangle = base.buffers.triangles[triangle as usize];
        let vertices = triangle.vertices.map(|v| base.buffers.vertices[v as usize]);
        let junctions = triangle.vertices.map(|v| base.welding.junction(v, triangle.displacement));
        let sides = [0, 1, 2].map(|e| {
            let (a, b) = (junctions[(e + 1) % 3], junctions[(e + 2) % 3]);
            base.welding.sides(a.min(b), a.max(b))
        });
        Border {
            positions: vertices.map(|v| v.position.as_dvec3()),
            normals: vertices.map(|v| v.normal.as_dvec3()),
            uv: vertices.map(|v| uv(&v)),
            axes: triangle.vertices.map(|v| Axes::of_vertex(base.buffers, v)),
            texels: triangle.vertices.map(|v| texel_scale(base.buffers, v)),
            map: triangle.displacement,
            junctions,
            corners: junctions.map(|junction| base.welding.decided(junction)),
            readings: junctions.map(|junction| base.welding.readings(junction)),
            sides,
        }
    }

    /// The micro-vertex over barycentric coordinates `w` of a grid point, displaced by a vector, and how far f32
    /// arithmetic may move it.
    fn moved(&self, base: &Base<'_>, w: [f64; 3]) -> (DVec3, f64) {
        let (point, magnitude) = (mixed(w, self.positions), mixed(w, self.positions.map(DVec3::abs)));
        let corner = (0..3).find(|&e| w[e] == 1.0);
        let edge = (0..3).find(|&e| w[e] == 0.0);
        let (sides, weights) = match (corner, edge) {
            (Some(corner), _) => (self.readings[corner], [1.0, 0.0]),
            (None, Some(edge)) => {
                let (a, b) = ((edge + 1) % 3, (edge + 2) % 3);
                let (from, to) = if self.junctions[a] < self.junctions[b] { (a, b) } else { (b, a) };
                (self.sides[edge], [w[from], w[to]])
            }
            (None, None) => (None, [0.0; 2]),
        };
        let end = |weight, uv, axes, texels| End { weight, uv, axes, texels };
        let place = Place { point, magnitude };
        let vectors: Vec<Moved> = match sides {
            Some(sides) => sides
                .iter()
                .map(|side| {
                    let [start, last] = side.axes;
                    let [from, to] = side.texels;
                    let ends =
                        [end(weights[0], side.start, start, from), end(weights[1], side.end, last, to)];
                    Moved::new(base, side.map, place, &ends)
                })
                .collect(),
            None => {
                let ends = [0, 1, 2].map(|e| end(w[e], self.uv[e], self.axes[e], self.texels[e]));
                vec![Moved::new(base, self.map, place, &ends)]
            }
        };
        let mean = Moved::mean(&vectors, base.rounding);
        let rounded = (base.rounding.interpolation() + 3.0) * magnitude;
        (point + mean.vector, mean.error + UNIT_ROUNDOFF * rounded.length())
    }

    /// The micro-vertex over barycentric coordinates `w` of a grid point.
    fn site(&self, base: &Base<'_>, w: [f64; 3]) -> Site {
        let relief = &base.reliefs[self.map as usize];
        let place =
            Place { point: mixed(w, self.positions), magnitude: mixed(w, self.positions.map(DVec3::abs)) };
        let terms = mixed(w, self.uv.map(DVec2::abs));
        let (height, height_error) =
            base.height(relief, mixed(w, self.uv), terms, place, mixed(w, self.texels));
        let inner = Site {
            point: place.point,
            magnitude: place.magnitude,
            direction: mixed(w, self.normals),
            // Normals add up to a vector no longer than 1.
            direction_error: base.rounding.interpolation(),
            height,
            height_error,
        };
        // Decided directions come rounded.
        let direction_error = inner.direction_error + 1.0;
        if let Some(corner) = (0..3).find(|&e| w[e] == 1.0) {
            return match (self.corners[corner], self.readings[corner]) {
                (Some(&Decided { direction, .. }), Some(readings)) if base.sight.is_some() => {
                    let (height, height_error) = mean_height(base, readings, [1.0, 0.0], place);
                    Site { direction, direction_error, height, height_error, ..inner }
                }
                (Some(&Decided { direction, height, height_error }), _) => {
                    Site { direction, direction_error, height, height_error, ..inner }
                }
                (None, _) => inner,
            };
        }
        let Some((edge, sides)) = (0..3).filter(|&e| w[e] == 0.0).find_map(|e| Some((e, self.sides[e]?)))
        else {
            return inner;
        };
        let direction = |e: usize| self.corners[e].map_or(self.normals[e], |decided| decided.direction);
        let (a, b) = ((edge + 1) % 3, (edge + 2) % 3);
        let (from, to) = if self.junctions[a] < self.junctions[b] { (a, b) } else { (b, a) };
        let (height, height_error) = mean_height(base, sides, [w[from], w[to]], place);
        Site {
            direction: direction(a) * w[a] + direction(b) * w[b],
            direction_error,
            height,
            height_error,
            ..inner
        }
    }
}

/// The mean of the heights of sides where their ends have these weights, and how far an f32 evaluation may be off.
fn mean_height(base: &Base<'_>, sides: &[Side], [from, to]: [f64; 2], place: Place) -> (f64, f64) {
    let count = sides.len() as f64;
    let (mut height, mut magnitude, mut error) = (0.0, 0.0, 0.0);
    for side in sides {
        let mix = |ends: [DVec2; 2]| ends[0] * from + ends[1] * to;
        let ends = [side.start, side.end];
        let relief = &base.reliefs[side.map as usize];
        let (h, h_error) = base.height(relief, mix(ends), mix(ends.map(DVec2::abs)), place, mix(side.texels));
        height += h / count;
        magnitude += h.abs() / count;
        error += h_error / count;
    }
    (height, error + UNIT_ROUNDOFF * base.rounding.mean(sides.len()) * magnitude)
}

/// The weighted sum of three values.
pub(super) fn mixed<T>(w: [f64; 3], v: [T; 3]) -> T
where
    T: std::ops::Mul<f64, Output = T> + std::ops::Add<Output = T>,
{
    let [a, b, c] = v;
    a * w[0] + b * w[1] + c * w[2]
}

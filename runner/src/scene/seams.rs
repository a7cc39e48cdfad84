//! Where the triangles at an edge or a vertex disagree on normals, texture coordinates or height maps: what they share
//! there instead, so that the displaced surface has no crack. See [`Seams`].

use super::Mesh;
use emboss_kernels::displacement::height_pyramid::uv_box_bounds;
use emboss_kernels::displacement::surface::HeightField;
use emboss_kernels::interface::{NO_SEAMS, SeamSide, Seams, Triangle, Vertex};
use emboss_kernels::math::UNIT_ROUNDOFF;
use glam::{DVec3, Vec2, Vec3};
use std::collections::HashMap;

/// The seams of a mesh. Empty where all neighbours share their vertices.
#[derive(Clone, Debug, Default)]
pub struct SeamTable {
    /// One for each triangle that has some; heights are left for [`decide_heights`].
    pub seams: Vec<Seams>,
    /// What seams read their heights from.
    pub sides: Vec<SeamSide>,
}

/// An edge of a triangle, as seen from it.
#[derive(Clone, Copy)]
struct Side {
    triangle: u32,
    /// The number of the corner across from it.
    edge: usize,
}

impl SeamTable {
    /// Finds the seams of `mesh` and notes in its triangles which are theirs.
    ///
    /// Vertices are at the same place where their positions are equal. The direction there is the normalised mean of
    /// their different normals; where these cancel, that of the first. Vertices at a place must have neighbouring
    /// indices, as [`Mesh::from_triangles`] gives them, so that all sides of an edge start at the same end.
    pub fn find(mesh: &mut Mesh) -> SeamTable {
        let place_of = places(&mesh.vertices);
        let directions = decided_directions(mesh, &place_of);
        let edges = edges(mesh, &place_of);
        let mut table = SeamTable::default();
        // The seam on each edge of each triangle: its first side, and how many it has.
        let mut seam_of: HashMap<(u32, usize), (u32, u32)> = HashMap::new();
        let mut keys: Vec<_> = edges.keys().copied().collect();
        keys.sort_unstable();
        for key in keys {
            let sides = &edges[&key];
            if sides.iter().all(|&side| meeting(mesh, side) == meeting(mesh, sides[0])) {
                continue;
            }
            let first = index(table.sides.len());
            for &side in sides {
                let read = seam_side(mesh, side);
                if !table.sides[first as usize..].contains(&read) {
                    table.sides.push(read);
                }
            }
            let count = index(table.sides.len()) - first;
            for side in sides {
                seam_of.insert((side.triangle, side.edge), (first, count));
            }
        }
        for i in 0..mesh.triangles.len() {
            let seams = seams_of(mesh, index(i), &place_of, &directions, &seam_of);
            mesh.triangles[i].seams = NO_SEAMS;
            if seams.flags != 0 {
                mesh.triangles[i].seams = index(table.seams.len());
                table.seams.push(seams);
            }
        }
        table
    }
}

/// The seams of one triangle, its heights not decided.
fn seams_of(
    mesh: &Mesh,
    triangle: u32,
    place_of: &[u32],
    directions: &HashMap<u32, Vec3>,
    seam_of: &HashMap<(u32, usize), (u32, u32)>,
) -> Seams {
    let mut seams = Seams::default();
    for (e, vertex) in mesh.triangles[triangle as usize].vertices.into_iter().enumerate() {
        let decided = directions.get(&place_of[vertex as usize]);
        let direction = decided.copied().unwrap_or(mesh.vertices[vertex as usize].normal);
        seams.directions[e] = direction.to_array();
        seams.flags |= u32::from(decided.is_some()) << e;
        if let Some(&(first, count)) = seam_of.get(&(triangle, e)) {
            seams.flags |= 8 << e;
            (seams.first_side[e], seams.side_count[e]) = (first, count);
        }
    }
    seams
}

/// For each vertex the number of its place.
fn places(vertices: &[Vertex]) -> Vec<u32> {
    let mut numbers = HashMap::new();
    vertices
        .iter()
        .map(|vertex| {
            let next = index(numbers.len());
            *numbers.entry(key(vertex.position)).or_insert(next)
        })
        .collect()
}

/// The direction at each place where several vertices, or triangles of several height maps, meet.
fn decided_directions(mesh: &Mesh, place_of: &[u32]) -> HashMap<u32, Vec3> {
    // In order of first use, each once.
    let mut corners: HashMap<u32, Vec<(u32, u32)>> = HashMap::new();
    for triangle in &mesh.triangles {
        for vertex in triangle.vertices {
            let at_place = corners.entry(place_of[vertex as usize]).or_default();
            if !at_place.contains(&(vertex, triangle.displacement)) {
                at_place.push((vertex, triangle.displacement));
            }
        }
    }
    corners
        .into_iter()
        .filter(|(_, corners)| corners.len() > 1)
        .map(|(place, mut corners)| {
            corners.sort_unstable();
            let normals: Vec<Vec3> = corners.iter().map(|&(v, _)| mesh.vertices[v as usize].normal).collect();
            (place, mean_direction(&normals))
        })
        .collect()
}

/// The direction of the mean of different unit vectors: the first's where they cancel, to the bit where all are equal.
fn mean_direction(normals: &[Vec3]) -> Vec3 {
    let mut different: Vec<Vec3> = Vec::new();
    for &normal in normals {
        if !different.contains(&normal) {
            different.push(normal);
        }
    }
    if different.len() == 1 {
        return different[0];
    }
    let sum: DVec3 = different.iter().map(|n| n.as_dvec3()).sum();
    // Unit vectors of f32 cancel to some 1e-7 of each; what is left then points nowhere.
    let cancelled = sum.length() < 1e-6 * different.len() as f64;
    if cancelled { different[0] } else { sum.normalize().as_vec3() }
}

/// The sides of each edge, in order of their triangles, by the places of its ends.
fn edges(mesh: &Mesh, place_of: &[u32]) -> HashMap<(u32, u32), Vec<Side>> {
    let mut edges: HashMap<_, Vec<Side>> = HashMap::new();
    for (i, triangle) in mesh.triangles.iter().enumerate() {
        for edge in 0..3 {
            let [a, b] = ends(triangle, edge).map(|v| place_of[v as usize]);
            debug_assert!(a != b, "two corners at one place");
            edges.entry((a.min(b), a.max(b))).or_default().push(Side { triangle: index(i), edge });
        }
    }
    edges
}

/// The vertices at the ends of a triangle's edge, the lower one first.
fn ends(triangle: &Triangle, edge: usize) -> [u32; 2] {
    let [a, b, c] = triangle.vertices;
    [[b, c], [a, c], [a, b]][edge]
}

/// What sides have to agree on.
fn meeting(mesh: &Mesh, side: Side) -> ([u32; 2], u32) {
    let triangle = &mesh.triangles[side.triangle as usize];
    (ends(triangle, side.edge), triangle.displacement)
}

/// What a side reads its heights from.
fn seam_side(mesh: &Mesh, side: Side) -> SeamSide {
    let triangle = &mesh.triangles[side.triangle as usize];
    let [start, end] = ends(triangle, side.edge).map(|v| {
        let vertex = &mesh.vertices[v as usize];
        [vertex.u, vertex.v]
    });
    SeamSide { start, end, displacement: triangle.displacement }
}

/// Decides the heights that depend on maps: at each decided corner the mean of what its different texture coordinates
/// give, along each seam the range.
pub fn decide_heights(
    field: &HeightField<'_>,
    vertices: &[Vertex],
    triangles: &[Triangle],
    seams: &mut [Seams],
    sides: &[SeamSide],
) {
    type Reading = ([u32; 2], u32);
    // The decided corners, each with its triangle.
    let with_seams = triangles.iter().filter(|triangle| triangle.seams != NO_SEAMS);
    let corners: Vec<(&Triangle, usize)> = with_seams
        .flat_map(|triangle| (0..3).map(move |e| (triangle, e)))
        .filter(|(triangle, e)| seams[triangle.seams as usize].flags >> e & 1 != 0)
        .collect();
    let mut readings: HashMap<[u32; 3], Vec<Reading>> = HashMap::new();
    for &(triangle, e) in &corners {
        let Vertex { position, u, v, .. } = vertices[triangle.vertices[e] as usize];
        // As with positions, -0 counts as 0.
        let reading = ([u, v].map(|x| (x + 0.0).to_bits()), triangle.displacement);
        let at_place = readings.entry(key(position)).or_default();
        if !at_place.contains(&reading) {
            at_place.push(reading);
        }
    }
    let height = |(uv, map): &Reading| {
        let uv = Vec2::from_array(uv.map(f32::from_bits));
        f64::from(field.height(&field.displacement(*map), uv))
    };
    let means: HashMap<[u32; 3], f32> =
        readings.iter().map(|(&place, readings)| (place, mean(readings.iter().map(height)))).collect();
    for &(triangle, e) in &corners {
        let place = key(vertices[triangle.vertices[e] as usize].position);
        seams[triangle.seams as usize].heights[e] = means[&place];
    }
    for seams in seams {
        for e in (0..3).filter(|e| seams.flags >> (3 + e) & 1 != 0) {
            let first = seams.first_side[e] as usize;
            let sides = &sides[first..first + seams.side_count[e] as usize];
            let ranges: Vec<(f32, f32)> = sides
                .iter()
                .map(|side| {
                    let ends = [Vec2::from_array(side.start), Vec2::from_array(side.end)];
                    uv_box_bounds(field, side.displacement, &ends)
                })
                .collect();
            let low = mean(ranges.iter().map(|range| f64::from(range.0)));
            let high = mean(ranges.iter().map(|range| f64::from(range.1)));
            // A kernel's mean takes a rounding for each side and 2.5 ulp for the division.
            let magnitude =
                ranges.iter().fold(0.0, |most: f32, range| most.max(range.0.abs()).max(range.1.abs()));
            let error = magnitude * UNIT_ROUNDOFF * (6 + sides.len()) as f32;
            (seams.height_min[e], seams.height_max[e]) = (low - error, high + error);
        }
    }
}

/// The mean of some numbers, at least one.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
fn mean(numbers: impl ExactSizeIterator<Item = f64>) -> f32 {
    let count = numbers.len() as f64;
    (numbers.sum::<f64>() / count) as f32
}

/// A position's bits, equal where its coordinates are: -0 counts as 0.
fn key(position: Vec3) -> [u32; 3] {
    position.to_array().map(|x| (x + 0.0).to_bits())
}

/// A count as an index; meshes have 32-bit indices.
fn index(count: usize) -> u32 {
    u32::try_from(count).expect("a mesh has at most 2^32 - 1 triangles")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{Job, Scene, prepare};
    use crate::scene::{HeightMap, Relief};
    use crate::settings::{Normals, Settings, Weld, Wrap};
    use emboss_kernels::displacement::surface::BaseTriangle;
    use emboss_kernels::interface::height_format;

    /// A number in [-1, 1) that looks random.
    fn noise(seed: u32) -> f32 {
        let bits = emboss_kernels::sampler::pcg4d(glam::UVec4::new(seed, 1, 2, 3)).x;
        2.0 * emboss_kernels::sampler::unit_float(bits) - 1.0
    }

    /// An octahedron whose eight faces share positions, and by `split` neither normals nor texture coordinates, or only
    /// one of them; with `maps` different maps by turns.
    fn octahedron(split_normals: bool, split_uv: bool, maps: u32) -> Scene {
        let axes = [Vec3::X, Vec3::Y, -Vec3::X, -Vec3::Y, Vec3::Z, -Vec3::Z];
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for side in 0..4_usize {
            for face in [[side, (side + 1) % 4, 4], [(side + 1) % 4, side, 5]] {
                let first = index(vertices.len());
                triangles.push([first, first + 1, first + 2]);
                let flat = (axes[face[0]] + axes[face[1]] + axes[face[2]]).normalize();
                for corner in face {
                    let seed = if split_uv { vertices.len() } else { corner };
                    let position = axes[corner] * (1.0 + 0.2 * noise(index(corner)));
                    let normal = if split_normals { flat } else { axes[corner] };
                    let (u, v) = (noise(100 + index(seed)), noise(200 + index(seed)));
                    vertices.push(Vertex { position, normal, u, v });
                }
            }
        }
        let mut mesh = Mesh::from_triangles(&vertices, &triangles);
        for (i, triangle) in mesh.triangles.iter_mut().enumerate() {
            triangle.displacement = index(i) % maps;
        }
        let relief = |seed: u32| Relief {
            map: HeightMap {
                width: 5,
                height: 4,
                format: height_format::FLOAT32,
                texels: (0..20).map(|i| noise(1000 * seed + i).to_bits()).collect(),
                range: (-1.0, 1.0),
                replaced: 0,
            },
            zero: 0.1,
            scale: 0.3 + 0.1 * seed as f32,
        };
        Scene { mesh, reliefs: (0..maps).map(relief).collect(), color_map: None, subdivisions: 1 }
    }

    fn job(scene: &Scene, subdivisions: u32, normals: Normals, weld: Weld) -> Job {
        let settings =
            Settings { width: 1, height: 1, wrap: Wrap::Mirror, normals, weld, ..Settings::default() };
        prepare(Scene { subdivisions, ..scene.clone() }, &settings).expect("framed")
    }

    /// Where a micro-vertex stands on the base mesh: the positions of an edge's ends, and how far along it.
    type Place = ([u32; 3], [u32; 3], u32);

    /// The positions that triangles give the micro-vertices on their borders.
    fn border(job: &Job) -> HashMap<Place, Vec<[u32; 3]>> {
        let view = job.buffers.view(&job.frame);
        let field = HeightField::new(&view, job.features);
        let n = job.frame.subdivisions;
        let mut border: HashMap<_, Vec<_>> = HashMap::new();
        for primitive in 0..job.frame.triangle_count {
            let base = BaseTriangle::load(&view, primitive);
            for (j, k) in (0..=n).flat_map(|j| (0..=n - j).map(move |k| (j, k))) {
                let weights = [(n - j - k, base.p0), (j, base.p1), (k, base.p2)];
                let ends: Vec<_> = weights.into_iter().filter(|&(weight, _)| weight > 0).collect();
                let place = match ends[..] {
                    [(_, p)] => (key(p), key(p), 0),
                    [(_, p), (m, q)] => (key(p), key(q), m),
                    _ => continue,
                };
                let position = base.micro_vertex(&field, j, k);
                border.entry(place).or_default().push(key(position));
            }
        }
        border
    }

    fn cracks(job: &Job) -> usize {
        let border = border(job);
        assert!(border.values().all(|positions| positions.len() >= 2), "the mesh is closed");
        border.values().filter(|positions| positions.iter().any(|p| *p != positions[0])).count()
    }

    #[test]
    fn all_triangles_at_a_border_have_its_micro_vertices_to_the_bit() {
        for (split_normals, split_uv, maps) in
            [(true, false, 1), (false, true, 1), (true, true, 1), (false, false, 2), (true, true, 3)]
        {
            let scene = octahedron(split_normals, split_uv, maps);
            for n in [1, 2, 3, 7, 16] {
                for normals in [Normals::Normalized, Normals::Linear] {
                    assert_eq!(cracks(&job(&scene, n, normals, Weld::On)), 0, "N = {n}");
                    let raw = job(&scene, n, normals, Weld::Off);
                    assert!(cracks(&raw) > 0, "without welding there is nothing to test");
                    assert_eq!(raw.features.seams, 0);
                }
            }
        }
    }

    #[test]
    fn neighbours_that_agree_have_no_seams() {
        let job = job(&octahedron(false, false, 1), 4, Normals::Normalized, Weld::On);
        assert!(job.buffers.seams.is_empty() && job.buffers.seam_sides.is_empty());
        assert_eq!(job.features.seams, 0);
        assert_eq!(cracks(&job), 0);
    }

    /// A tetrahedron with a T-junction: a vertex halfway along one edge belongs to one face there, which is cut in
    /// two, and not to the other. A sliver lies between them.
    #[test]
    fn a_sliver_closes_a_t_junction() {
        let positions = [
            Vec3::new(-1.0, 0.0, 0.0),
            Vec3::new(1.0, 0.0, 0.0),
            Vec3::new(0.0, -1.0, 1.0),
            Vec3::new(0.0, 1.0, 1.0),
            Vec3::ZERO,
        ];
        // The whole face, the two halves of its neighbour, the sliver, and the two faces across.
        let faces: [[usize; 3]; 6] = [[0, 2, 1], [0, 4, 3], [4, 1, 3], [0, 1, 4], [0, 3, 2], [1, 2, 3]];
        for (split_normals, split_uv) in [(false, false), (false, true), (true, false), (true, true)] {
            let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
            for (i, face) in faces.iter().enumerate() {
                let first = index(vertices.len());
                triangles.push([first, first + 1, first + 2]);
                for &corner in face {
                    let seed = index(if split_uv { vertices.len() } else { corner });
                    let (u, v) = (noise(300 + seed), noise(400 + seed));
                    // Zero normals are computed from the faces with an area.
                    let axis = [Vec3::X, Vec3::Y, Vec3::Z][i % 3];
                    let normal = if split_normals { axis } else { Vec3::ZERO };
                    vertices.push(Vertex { position: positions[corner], normal, u, v });
                }
            }
            let mesh = Mesh::from_triangles(&vertices, &triangles);
            assert_eq!((mesh.triangles.len(), mesh.dropped), (6, 0));
            let scene = Scene { mesh, ..octahedron(false, false, 1) };
            for n in [1, 3, 8] {
                for normals in [Normals::Normalized, Normals::Linear] {
                    let job = job(&scene, n, normals, Weld::On);
                    assert_eq!(job.features.seams, u32::from(split_normals || split_uv));
                    assert_eq!(cracks(&job), 0, "N = {n}");
                }
            }
        }
    }

    /// Two triangles folded along the x axis, with normals +z and +y, each with its own map: heights 1 and 3.
    #[test]
    fn seams_are_displaced_by_the_mean_of_heights_along_the_mean_of_normals() {
        let vertex =
            |position: [f32; 3], normal| Vertex { position: position.into(), normal, u: 0.5, v: 0.5 };
        let vertices = [
            vertex([0.0, 0.0, 0.0], Vec3::Z),
            vertex([4.0, 0.0, 0.0], Vec3::Z),
            vertex([0.0, 4.0, 0.0], Vec3::Z),
            vertex([4.0, 0.0, 0.0], Vec3::Y),
            vertex([0.0, 0.0, 0.0], Vec3::Y),
            vertex([0.0, 0.0, -4.0], Vec3::Y),
        ];
        let mut mesh = Mesh::from_triangles(&vertices, &[[0, 1, 2], [3, 4, 5]]);
        mesh.triangles[1].displacement = 1;
        let relief = |height: f32| Relief { map: HeightMap::flat(height), zero: 0.0, scale: 1.0 };
        let scene = Scene { mesh, reliefs: vec![relief(1.0), relief(3.0)], color_map: None, subdivisions: 4 };
        let job = job(&scene, 4, Normals::Normalized, Weld::On);
        let view = job.buffers.view(&job.frame);
        let field = HeightField::new(&view, job.features);
        let base = BaseTriangle::load(&view, 0);
        let half = 2.0 * std::f32::consts::FRAC_1_SQRT_2;
        // On the fold both ends and the middle are lifted by 2 towards (0, 1, 1); the corner across by its own 1.
        for (j, x) in [(0, 0.0), (2, 2.0), (4, 4.0)] {
            let position = base.micro_vertex(&field, j, 0);
            assert!(position.abs_diff_eq(Vec3::new(x, half, half), 4e-7), "{position}");
        }
        assert_eq!(base.micro_vertex(&field, 0, 4), Vec3::new(0.0, 4.0, 1.0));
        assert_eq!(base.micro_vertex(&field, 1, 1), Vec3::new(1.0, 1.0, 1.0));
        // Ranges hold what they are of.
        let seams = job.buffers.seams[0];
        assert_eq!((seams.flags & 7, seams.heights), (3, [2.0, 2.0, 0.0]));
        assert!(seams.height_min[2] <= 2.0 && seams.height_max[2] >= 2.0 && seams.height_max[2] < 2.001);
    }

    #[test]
    fn opposite_normals_leave_the_first_ones_direction() {
        assert_eq!(mean_direction(&[Vec3::Y, -Vec3::Y]), Vec3::Y);
        assert_eq!(mean_direction(&[Vec3::Y, Vec3::Y]), Vec3::Y);
        let mean = mean_direction(&[Vec3::Y, Vec3::X, Vec3::X]);
        assert!(mean.abs_diff_eq(Vec3::new(1.0, 1.0, 0.0).normalize(), 1e-7), "{mean}");
    }
}

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
            debug_assert!(a != b, "a triangle of zero area");
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
    let decided = |seams: &[Seams]| -> Vec<(u32, usize, u32)> {
        let with_seams = triangles.iter().filter(|triangle| triangle.seams != NO_SEAMS);
        with_seams
            .flat_map(|triangle| (0..3).map(move |e| (triangle.seams, e, triangle.vertices[e])))
            .filter(|&(number, e, _)| seams[number as usize].flags >> e & 1 != 0)
            .collect()
    };
    let corners = decided(seams);
    let maps: HashMap<u32, u32> = triangles.iter().map(|t| (t.seams, t.displacement)).collect();
    let mut readings: HashMap<[u32; 3], Vec<Reading>> = HashMap::new();
    for &(number, _, vertex) in &corners {
        let Vertex { position, u, v, .. } = vertices[vertex as usize];
        let reading = ([u, v].map(f32::to_bits), maps[&number]);
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
    for &(number, e, vertex) in &corners {
        seams[number as usize].heights[e] = means[&key(vertices[vertex as usize].position)];
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

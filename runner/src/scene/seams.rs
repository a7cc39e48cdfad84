//! Where the triangles at an edge or a vertex disagree on normals, texture coordinates or height maps: what they share
//! there instead, so that the displaced surface has no crack. See [`Seams`].

use super::Mesh;
use crate::settings::DisplacementKind;
use emboss_kernels::interface::{NO_SEAMS, SeamSide, Seams, Triangle, Vertex};
use glam::{DVec3, Vec3};
use std::collections::HashMap;

/// The seams of a mesh. Empty where all neighbours share their vertices.
#[derive(Clone, Debug, Default)]
pub struct SeamTable {
    /// One for each triangle that has some; heights are left for backends
    /// ([`decide_seams`](emboss_kernels::displacement::seams::decide_seams)).
    pub seams: Vec<Seams>,
    /// What seams and decided corners read their heights from.
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
    /// Vertices are at the same place where their positions are equal, and they are of one mesh (see [`Mesh::starts`]).
    /// The direction there is the normalised mean of their different normals; where these cancel, that of the first.
    /// Vertices at a place must have neighbouring indices, as [`Mesh::from_triangles`] gives them, so that all sides of
    /// an edge start at the same end.
    ///
    /// Sides that read the same are one; vectors along other axes are not the same.
    pub fn find(mesh: &mut Mesh, kind: DisplacementKind) -> SeamTable {
        let place_of = places(mesh);
        let directions = decided_directions(mesh, &place_of);
        let edges = edges(mesh, &place_of);
        let mut table = SeamTable::default();
        // The seam on each edge of each triangle.
        let mut seam_of: HashMap<(u32, usize), Run> = HashMap::new();
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
                if !table.sides[first as usize..].iter().any(|other| is_same(other, &read, kind)) {
                    table.sides.push(read);
                }
            }
            let run = Run { first, count: index(table.sides.len()) - first };
            for side in sides {
                seam_of.insert((side.triangle, side.edge), run);
            }
        }
        let corner_at = decided_corners(mesh, &place_of, directions, kind, &mut table.sides);
        for i in 0..mesh.triangles.len() {
            let seams = seams_of(mesh, index(i), &place_of, &corner_at, &seam_of);
            mesh.triangles[i].seams = NO_SEAMS;
            if seams.flags != 0 {
                mesh.triangles[i].seams = index(table.seams.len());
                table.seams.push(seams);
            }
        }
        table
    }
}

/// Entries of the table of sides, one behind the other.
#[derive(Clone, Copy)]
struct Run {
    first: u32,
    count: u32,
}

/// What is decided at a place: the direction, and what its height is read from.
#[derive(Clone, Copy)]
struct Corner {
    direction: Vec3,
    readings: Run,
}

/// Adds the different readings at each place that has a direction to `sides`, as sides of no length, in the order of
/// their triangles.
fn decided_corners(
    mesh: &Mesh,
    place_of: &[u32],
    directions: HashMap<u32, Vec3>,
    kind: DisplacementKind,
    sides: &mut Vec<SeamSide>,
) -> HashMap<u32, Corner> {
    let mut readings: HashMap<u32, Vec<SeamSide>> = HashMap::new();
    for triangle in &mesh.triangles {
        for vertex in triangle.vertices {
            let place = place_of[vertex as usize];
            if directions.contains_key(&place) {
                let Vertex { u, v, .. } = mesh.vertices[vertex as usize];
                let reading = SeamSide {
                    start: [u, v],
                    end: [u, v],
                    displacement: triangle.displacement,
                    vertices: [vertex; 2],
                };
                let at_place = readings.entry(place).or_default();
                if !at_place.iter().any(|other| is_same(other, &reading, kind)) {
                    at_place.push(reading);
                }
            }
        }
    }
    let mut places: Vec<_> = directions.into_iter().collect();
    places.sort_unstable_by_key(|&(place, _)| place);
    let corner = |(place, direction): (u32, Vec3)| {
        let first = index(sides.len());
        sides.extend(&readings[&place]);
        (place, Corner { direction, readings: Run { first, count: index(sides.len()) - first } })
    };
    places.into_iter().map(corner).collect()
}

/// The seams of one triangle, its heights not decided.
fn seams_of(
    mesh: &Mesh,
    triangle: u32,
    place_of: &[u32],
    corner_at: &HashMap<u32, Corner>,
    seam_of: &HashMap<(u32, usize), Run>,
) -> Seams {
    let mut seams = Seams::default();
    for (e, vertex) in mesh.triangles[triangle as usize].vertices.into_iter().enumerate() {
        seams.directions[e] = mesh.vertices[vertex as usize].normal.to_array();
        if let Some(corner) = corner_at.get(&place_of[vertex as usize]) {
            seams.flags |= 1 << e;
            seams.directions[e] = corner.direction.to_array();
            (seams.first_reading[e], seams.reading_count[e]) = (corner.readings.first, corner.readings.count);
        }
        if let Some(side) = seam_of.get(&(triangle, e)) {
            seams.flags |= 8 << e;
            (seams.first_side[e], seams.side_count[e]) = (side.first, side.count);
        }
    }
    seams
}

/// For each vertex the number of its place.
fn places(mesh: &Mesh) -> Vec<u32> {
    let mut numbers = HashMap::new();
    let mut place = |(i, vertex): (u32, &Vertex)| {
        let mesh_number = mesh.starts.partition_point(|&start| start <= i);
        let next = index(numbers.len());
        *numbers.entry((mesh_number, key(vertex.position))).or_insert(next)
    };
    (0..).zip(&mesh.vertices).map(&mut place).collect()
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
    let vertices = ends(triangle, side.edge);
    let [start, end] = vertices.map(|v| {
        let vertex = &mesh.vertices[v as usize];
        [vertex.u, vertex.v]
    });
    SeamSide { start, end, displacement: triangle.displacement, vertices }
}

/// Whether two sides of a seam read the same, and so count as one in its mean.
fn is_same(a: &SeamSide, b: &SeamSide, kind: DisplacementKind) -> bool {
    let alike = (a.start, a.end, a.displacement) == (b.start, b.end, b.displacement);
    alike && (kind != DisplacementKind::Tangent || a.vertices == b.vertices)
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
    use crate::backend::host_scene::HostScene;
    use crate::render::{Scene, prepare};
    use crate::scene::{HeightMap, Material, Relief};
    use crate::settings::{Normals, Settings, Weld, Wrap};
    use emboss_kernels::displacement::surface::{BaseTriangle, HeightField};
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
        let map = |seed: u32| HeightMap {
            width: 5,
            height: 4,
            format: height_format::FLOAT32,
            texels: (0..20).map(|i| noise(1000 * seed + i).to_bits()).collect(),
            range: (-1.0, 1.0),
            replaced: 0,
        };
        let relief = |seed: u32| Relief::new(map(seed), 0.1, 0.3 + 0.1 * seed as f32);
        Scene {
            mesh,
            reliefs: (0..maps).map(relief).collect(),
            materials: vec![Material::default()],
            parts: vec![],
            subdivisions: 1,
        }
    }

    /// The octahedron with a vector map for each of its maps.
    fn octahedron_of_vectors(split_normals: bool, split_uv: bool, maps: u32) -> Scene {
        let mut scene = octahedron(split_normals, split_uv, 3 * maps);
        for (i, triangle) in scene.mesh.triangles.iter_mut().enumerate() {
            triangle.displacement = 3 * (index(i) % maps);
        }
        scene
    }

    fn host_scene(scene: &Scene, subdivisions: u32, normals: Normals, weld: Weld) -> HostScene {
        displaced_scene(scene, subdivisions, DisplacementKind::Height, normals, weld)
    }

    fn displaced_scene(
        scene: &Scene,
        subdivisions: u32,
        displacement: DisplacementKind,
        normals: Normals,
        weld: Weld,
    ) -> HostScene {
        let (width, height, wrap) = (1, 1, Wrap::Mirror);
        let settings = Settings { width, height, wrap, displacement, normals, weld, ..Settings::default() };
        let job = prepare(Scene { subdivisions, ..scene.clone() }, &settings).expect("sound maps");
        HostScene::new(&job.buffers, &job.frame, job.features).expect("a small scene fits")
    }

    /// Where a micro-vertex stands on the base mesh: the positions of an edge's ends, and how far along it.
    type Place = ([u32; 3], [u32; 3], u32);

    /// The positions that triangles give the micro-vertices on their borders.
    fn border(scene: &HostScene) -> HashMap<Place, Vec<[u32; 3]>> {
        let view = scene.view();
        let field = HeightField::new(&view, scene.features());
        let n = field.subdivisions;
        let mut border: HashMap<_, Vec<_>> = HashMap::new();
        for primitive in 0..view.frame.triangle_count {
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

    fn cracks(scene: &HostScene) -> usize {
        let border = border(scene);
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
                    assert_eq!(cracks(&host_scene(&scene, n, normals, Weld::On)), 0, "N = {n}");
                    let raw = host_scene(&scene, n, normals, Weld::Off);
                    assert!(cracks(&raw) > 0, "without welding there is nothing to test");
                    assert_eq!(raw.features().seams, 0);
                }
            }
        }
    }

    /// The same of vectors. In object space split normals alone change nothing.
    #[test]
    fn all_triangles_at_a_border_have_the_vectors_there_to_the_bit() {
        for (split_normals, split_uv, maps) in
            [(true, false, 1), (false, true, 1), (true, true, 1), (false, false, 2), (true, true, 3)]
        {
            let scene = octahedron_of_vectors(split_normals, split_uv, maps);
            for kind in [DisplacementKind::Tangent, DisplacementKind::Object] {
                let agree = kind == DisplacementKind::Object && !split_uv && maps == 1;
                for n in [1, 2, 3, 7, 16] {
                    for normals in [Normals::Normalized, Normals::Linear] {
                        let closed = displaced_scene(&scene, n, kind, normals, Weld::On);
                        assert_eq!(cracks(&closed), 0, "{kind:?}, N = {n}");
                        let raw = displaced_scene(&scene, n, kind, normals, Weld::Off);
                        assert_eq!(cracks(&raw) > 0, !agree, "{kind:?}, N = {n}");
                    }
                }
            }
        }
    }

    #[test]
    fn neighbours_that_agree_have_no_seams() {
        let scene = host_scene(&octahedron(false, false, 1), 4, Normals::Normalized, Weld::On);
        assert!(scene.view().seams.is_empty() && scene.view().seam_sides.is_empty());
        assert_eq!(scene.features().seams, 0);
        assert_eq!(cracks(&scene), 0);
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
                    let scene = host_scene(&scene, n, normals, Weld::On);
                    assert_eq!(scene.features().seams, u32::from(split_normals || split_uv));
                    assert_eq!(cracks(&scene), 0, "N = {n}");
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
        let relief = |height: f32| Relief::new(HeightMap::flat(height), 0.0, 1.0);
        let scene = Scene {
            mesh,
            reliefs: vec![relief(1.0), relief(3.0)],
            materials: vec![Material::default()],
            parts: vec![],
            subdivisions: 4,
        };
        let scene = host_scene(&scene, 4, Normals::Normalized, Weld::On);
        let view = scene.view();
        let field = HeightField::new(&view, scene.features());
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
        let seams = view.seams[0];
        assert_eq!((seams.flags & 7, seams.heights), (3, [2.0, 2.0, 0.0]));
        assert!(seams.height_min[2] <= 2.0 && seams.height_max[2] >= 2.0 && seams.height_max[2] < 2.001);
    }

    /// Each of two meshes in one place has the seams that it has alone, with sides of its own.
    #[test]
    fn appended_meshes_do_not_weld() {
        let mut alone = octahedron(true, true, 1).mesh;
        let mut both = alone.clone();
        both.append(alone.clone());
        let find = |mesh: &mut Mesh| SeamTable::find(mesh, DisplacementKind::Height);
        let (one, two) = (find(&mut alone), find(&mut both));
        assert!(!one.seams.is_empty());
        assert_eq!((two.seams.len(), two.sides.len()), (2 * one.seams.len(), 2 * one.sides.len()));
        let directions = |table: &SeamTable, i: usize| (table.seams[i].flags, table.seams[i].directions);
        for i in 0..one.seams.len() {
            assert_eq!(directions(&two, i), directions(&one, i));
            assert_eq!(directions(&two, one.seams.len() + i), directions(&one, i));
            assert_eq!(two.seams[i].side_count, one.seams[i].side_count);
        }
    }

    #[test]
    fn opposite_normals_leave_the_first_ones_direction() {
        assert_eq!(mean_direction(&[Vec3::Y, -Vec3::Y]), Vec3::Y);
        assert_eq!(mean_direction(&[Vec3::Y, Vec3::Y]), Vec3::Y);
        let mean = mean_direction(&[Vec3::Y, Vec3::X, Vec3::X]);
        assert!(mean.abs_diff_eq(Vec3::new(1.0, 1.0, 0.0).normalize(), 1e-7), "{mean}");
    }
}

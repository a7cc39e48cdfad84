//! Relief that falls between micro-vertices: how many texels lie between two neighbours, and which N reads them all.
//!
//! Heights are read at micro-vertices alone. Two neighbours on an edge of s texels (along the axis of the map on which
//! it has more) are s / N apart. Where that is at most 1 for all three edges, each texel whose centre lies in the
//! triangle has a micro-vertex in its square. For let p be a point of a micro-triangle whose corners differ by 1 at
//! most along each axis, and suppose that each corner is farther than 1/2 from p along an axis. Corners that are so
//! along x lie on one side of p, since others would be more than 1 away from them; say above it. So do those along y.
//! If only one axis has such corners, all three lie on one side of p, which they surround. If both have, a corner that
//! is above p by more than 1/2 along one axis is within 1 of one that is so along the other, hence less than 1/2 below
//! p there: x + y is above that of p at all three, and p is a mean of them.

use crate::framing;
use crate::render::Job;
use emboss_kernels::displacement::subdivisions::Viewpoint;
use emboss_kernels::interface::{
    Displacement, Instance, MAX_SUBDIVISIONS, Triangle, displacement_kind, method, shade, wrap,
};
use emboss_kernels::scene::Features;
use emboss_kernels::texture::height_texel;
use glam::DVec2;
use rayon::prelude::*;
use serde::Serialize;
use std::fmt;

/// As many texels between neighbours are not reported: of a wave that is longer than twice that both its crests and its
/// troughs are read.
const MOST_TEXELS: f64 = 2.0;
/// Relief is lost where it has a slope of more than so much. What has less turns a normal by half a degree, which
/// changes Lambert's cosine by 1 % of full light at most, and lifts no point by more than half a percent of the
/// distance between micro-vertices.
const LEAST_SLOPE: f64 = 0.01;

/// A height map of which texels fall between micro-vertices.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Undersampled {
    /// What users know the map by: its file, or the built-in scene that made it.
    pub map: Option<String>,
    /// N of the triangle that is worst off.
    #[serde(rename = "N")]
    pub n: u32,
    /// How many texels lie between two neighbouring micro-vertices there, along the axis of the map that has more;
    /// above 2.
    pub texels: f64,
    /// In how many triangles it is more than 2; those of a mesh that has instances count once.
    pub triangles: u64,
    /// How many triangles with an area have the map.
    pub of: u64,
    /// The least N with which each texel has a micro-vertex in its square, whatever the triangle; `None` where it is
    /// above 4096, the greatest there is.
    pub needed: Option<u32>,
    /// How many texels N = 4096 leaves between two neighbours.
    pub texels_of_greatest: f64,
    /// Whether N was adaptive.
    pub adaptive: bool,
    /// Whether it can be: most methods take one N.
    pub can_adapt: bool,
}

impl fmt::Display for Undersampled {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Undersampled { map, n, texels, triangles, of, needed, texels_of_greatest, adaptive, can_adapt } =
            self;
        let map = map.as_deref().unwrap_or("a height map");
        write!(
            f,
            "{map}: {texels:.1} texels lie between neighbouring micro-vertices at N = {n} (in {triangles} of {of} \
                triangles it is more than two), so that relief between them is lost or misread; "
        )?;
        match (needed, adaptive) {
            (Some(needed), true) => {
                write!(f, "N = {needed} reads all texels, N = auto what a pixel can show")
            }
            (Some(needed), false) if *can_adapt => {
                write!(f, "N = {needed} reads all texels, N = auto as many as pixels can show")
            }
            (Some(needed), false) => write!(f, "N = {needed} reads all texels"),
            (None, _) => write!(
                f,
                "even N = {MAX_SUBDIVISIONS}, the greatest, leaves {texels_of_greatest:.1} between them: cut the base \
                    mesh finer, repeat the map less often, or scale it down"
            ),
        }
    }
}

/// What the triangles of a map ask of N.
#[derive(Clone, Copy, Default)]
struct Usage {
    /// The map's displacement.
    displacement: u32,
    /// Texels along an edge, at most.
    side: f64,
    /// Texels between neighbours, at most, and the N with which.
    texels: f64,
    n: u32,
    triangles: u64,
    of: u64,
    /// The most texels of a unit of length, times the scale: what a slope in texels is multiplied by.
    steepness: f64,
}

/// The height maps of a job of which more than two texels lie between neighbouring micro-vertices of a triangle, in the
/// order of the job's displacements, each map once. Slivers without an area do not count. Nor do maps that lose nothing
/// by it: their relief between micro-vertices is flat to half a degree.
///
/// Where N is adaptive, the job must be [framed](Job::frame_view). Then a triangle counts where a part of its side may
/// be wider than a pixel: because N would be above 4096, or because wider ones were asked for. Methods that read
/// heights elsewhere than at micro-vertices have no such maps.
pub fn undersampled(job: &Job) -> Vec<Undersampled> {
    let features = job.features;
    if !reads_at_micro_vertices(features) {
        return Vec::new();
    }
    let mut usages = usages(job);
    usages.retain(|usage| usage.texels > MOST_TEXELS && loses_relief(job, usage));
    let report = |usage: &Usage| {
        // Texture coordinates are rounded to 2^-24 of themselves.
        let needed = (usage.side * (1.0 - 1e-6)).ceil().max(1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the limit")]
        let needed = (needed <= f64::from(MAX_SUBDIVISIONS)).then_some(needed as u32);
        Undersampled {
            map: job.names.get(usage.displacement as usize).cloned().flatten(),
            n: usage.n,
            texels: usage.texels,
            triangles: usage.triangles,
            of: usage.of,
            needed,
            texels_of_greatest: usage.side / f64::from(MAX_SUBDIVISIONS),
            adaptive: features.adaptive != 0,
            can_adapt: method::takes_any_scene(features.method),
        }
    };
    usages.iter().map(report).collect()
}

/// Whether what rays meet, or what errors are shown against, is made of micro-triangles.
fn reads_at_micro_vertices(features: Features) -> bool {
    matches!(features.method, method::QUADTREE | method::GRID_WALK | method::TESSELLATE | method::BRUTE_FORCE)
        || features.shade == shade::ERROR
}

/// How many maps a displacement has.
fn parts(features: Features) -> usize {
    if features.displacement == displacement_kind::HEIGHT { 1 } else { 3 }
}

/// What each map's triangles ask for.
fn usages(job: &Job) -> Vec<Usage> {
    let displacements = &job.buffers.displacements;
    let place = |map: &Displacement| (map.first_word, map.map_width, map.map_height, map.format);
    // Which usage is whose: that of the first displacement with the same map.
    let group = |i: usize| displacements[..i].iter().position(|map| place(map) == place(&displacements[i]));
    let groups: Vec<usize> = (0..displacements.len()).map(|i| group(i).unwrap_or(i)).collect();
    let mut usages: Vec<Usage> = (0..)
        .zip(displacements)
        .map(|(displacement, _)| Usage { displacement, ..Usage::default() })
        .collect();
    let cuts = Cutting::new(job);
    let mut first = 0;
    let meshes: Vec<&[Instance]> = if job.buffers.instances.is_empty() {
        vec![&[]]
    } else {
        job.buffers.instances.chunk_by(|a, b| a.first_node == b.first_node).collect()
    };
    for instances in meshes {
        let range = match instances.first() {
            Some(instance) => {
                first = instance.first_triangle as usize;
                first..first + instance.triangle_count as usize
            }
            None => first..job.buffers.triangles.len(),
        };
        for triangle in &job.buffers.triangles[range] {
            let map = triangle.displacement as usize;
            let Some(sides) = Sides::of(job, triangle) else { continue };
            let usage = &mut usages[groups[map]];
            usage.of += 1;
            usage.side = usage.side.max(sides.texels);
            let Some(n) = cuts.least(job, triangle, instances, sides.texels) else { continue };
            let texels = sides.texels / f64::from(n);
            if texels > MOST_TEXELS {
                usage.triangles += 1;
                let scales = displacements[map..].iter().take(parts(job.features)).map(|map| map.scale.abs());
                let steepness = sides.density * f64::from(scales.fold(0.0, f32::max));
                usage.steepness = usage.steepness.max(steepness);
                if texels > usage.texels {
                    (usage.texels, usage.n, usage.displacement) = (texels, n, triangle.displacement);
                }
            }
        }
    }
    usages
}

/// The edges of a triangle on its map.
struct Sides {
    /// Texels of the longest, along the axis of the map that has more of them.
    texels: f64,
    /// Texels of a unit of length of the edge where that is most.
    density: f64,
}

impl Sides {
    /// `None` of a sliver.
    fn of(job: &Job, triangle: &Triangle) -> Option<Sides> {
        let map = &job.buffers.displacements[triangle.displacement as usize];
        let size = DVec2::new(map.map_width.into(), map.map_height.into());
        let corners = triangle.vertices.map(|v| job.buffers.vertices[v as usize]);
        let [a, b, c] = corners.map(|corner| corner.position.as_dvec3());
        if (b - a).cross(c - a) == glam::DVec3::ZERO {
            return None;
        }
        let on_map = corners.map(|corner| DVec2::new(corner.u.into(), corner.v.into()) * size);
        let mut sides = Sides { texels: 0.0, density: 0.0 };
        for (e, length) in [(b - c).length(), (c - a).length(), (a - b).length()].into_iter().enumerate() {
            let texels = (on_map[(e + 1) % 3] - on_map[(e + 2) % 3]).abs().max_element();
            sides.texels = sides.texels.max(texels);
            sides.density = sides.density.max(texels / length);
        }
        Some(sides)
    }
}

/// How triangles are cut.
enum Cutting {
    /// All alike.
    Fixed(u32),
    /// As the camera asks for.
    Adaptive {
        viewpoint: Viewpoint,
        most: u32,
        /// Whether parts that are wider than a pixel were asked for.
        is_coarse: bool,
    },
}

impl Cutting {
    fn new(job: &Job) -> Cutting {
        let most = job.frame.subdivisions;
        if job.features.adaptive == 0 {
            return Cutting::Fixed(most);
        }
        let of_a_pixel = framing::detail(&job.view, job.frame.width, job.frame.height, 1.0);
        Cutting::Adaptive {
            viewpoint: Viewpoint::new(&job.frame),
            most,
            is_coarse: job.frame.detail < of_a_pixel,
        }
    }

    /// The least N that a triangle has where a part of its side may be wider than a pixel, in any of its places. `None`
    /// where there is no such place, or where `texels` along an edge are too few for it to matter.
    fn least(&self, job: &Job, triangle: &Triangle, instances: &[Instance], texels: f64) -> Option<u32> {
        let (viewpoint, most, is_coarse) = match *self {
            Cutting::Fixed(n) => return Some(n),
            Cutting::Adaptive { viewpoint, most, is_coarse } => (viewpoint, most, is_coarse),
        };
        if texels <= MOST_TEXELS || !is_coarse && texels <= MOST_TEXELS * f64::from(most) {
            return None;
        }
        let [a, b, c] = triangle.vertices.map(|v| job.buffers.vertices[v as usize].position);
        let n_in = |viewpoint: Viewpoint| viewpoint.subdivisions(a, b, c).triangle;
        let places: Vec<u32> = if instances.is_empty() {
            vec![n_in(viewpoint)]
        } else {
            instances.iter().map(|instance| n_in(viewpoint.within(instance))).collect()
        };
        places.into_iter().filter(|&n| is_coarse || n == most).min()
    }
}

/// Whether straight lines between micro-vertices leave out what a map shows: whether a texel is off the mean of two
/// that lie on both sides of it, as far away as 1, 2, 4... up to half the distance of micro-vertices, by a slope that
/// counts.
///
/// A wave of p texels is off by its whole amplitude at a distance between p / 4 and p / 2, so that no wave shorter than
/// the distance of micro-vertices passes. On a longer one, and on a crest, it is what a straight line is off by.
fn loses_relief(job: &Job, usage: &Usage) -> bool {
    let first = usage.displacement as usize;
    let maps = &job.buffers.displacements[first..first + parts(job.features)];
    let loses = |map: &Displacement| {
        let (width, height) = (i64::from(map.map_width), i64::from(map.map_height));
        let texel = |x: i64, y: i64| {
            let index = wrapped(y, height, map.wrap) * width + wrapped(x, width, map.wrap);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "an index of a texel"
            )]
            let index = index as u32;
            f64::from(height_texel(&job.buffers.height_texels, map.format, map.first_word, index))
        };
        let distances =
            || (0..22).map(|e| 1_i64 << e).take_while(|&r| r == 1 || r as f64 <= usage.texels * 0.5);
        let is_lost = |x: i64, y: i64| {
            let here = texel(x, y);
            let off = |r: i64, (dx, dy): (i64, i64)| {
                (here - 0.5 * (texel(x - r * dx, y - r * dy) + texel(x + r * dx, y + r * dy))).abs()
                    / r as f64
            };
            let is_steep = |r: i64, along| off(r, along) * usage.steepness > LEAST_SLOPE;
            distances().any(|r| [(1, 0), (0, 1), (1, 1)].into_iter().any(|along| is_steep(r, along)))
        };
        (0..height).into_par_iter().any(|y| (0..width).any(|x| is_lost(x, y)))
    };
    maps.iter().any(loses)
}

/// A texel of a row of `n`, wherever it is outside.
fn wrapped(i: i64, n: i64, mode: u32) -> i64 {
    if mode == wrap::REPEAT {
        i.rem_euclid(n)
    } else if mode == wrap::MIRROR {
        let i = i.rem_euclid(2 * n);
        i.min(2 * n - 1 - i)
    } else {
        i.clamp(0, n - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::cpu::CpuBackend;
    use crate::framing::View;
    use crate::render::{Scene, load, prepare};
    use crate::scene::{HeightMap, Material, Mesh, Relief};
    use crate::settings::{DisplacementKind, Method, Settings, Shade};
    use emboss_kernels::interface::{Vertex, height_format};
    use glam::Vec3;

    /// A map of floats.
    fn map(width: u32, height: u32, texel: impl Fn(u32, u32) -> f32) -> HeightMap {
        let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let texels: Vec<f32> = texels.map(|(x, y)| texel(x, y)).collect();
        let (low, high) = texels.iter().fold((f32::MAX, f32::MIN), |(l, h), &t| (l.min(t), h.max(t)));
        let texels = texels.into_iter().map(f32::to_bits).collect();
        HeightMap { width, height, format: height_format::FLOAT32, texels, range: (low, high), replaced: 0 }
    }

    /// So many stripes along x.
    fn stripes(size: u32, stripes: u32) -> HeightMap {
        map(size, 4, |x, _| {
            let turns = x as f32 / size as f32 * stripes as f32;
            0.5 - 0.5 * (turns * std::f32::consts::TAU).cos()
        })
    }

    fn vertex(x: f32, y: f32, repeats: f32) -> Vertex {
        Vertex { position: Vec3::new(2.0 * x, 2.0 * y, 0.0), normal: Vec3::Z, u: repeats * x, v: repeats * y }
    }

    /// Two triangles that make a square, their map repeated along each side.
    fn square(repeats: f32) -> Mesh {
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        Mesh::from_triangles(&corners.map(|(x, y)| vertex(x, y, repeats)), &[[0, 1, 2], [0, 2, 3]])
    }

    fn scene(mesh: Mesh, relief: Relief, subdivisions: u32) -> Scene {
        let (reliefs, materials) = (vec![relief], vec![Material::default()]);
        Scene { mesh, reliefs, materials, parts: vec![], subdivisions }
    }

    fn reports(scene: Scene, settings: &Settings) -> Vec<Undersampled> {
        undersampled(&prepare(scene, settings).expect("sound maps"))
    }

    fn of(map: HeightMap, repeats: f32, n: u32) -> Vec<Undersampled> {
        let relief = Relief { name: Some("map.png".to_owned()), ..Relief::new(map, 0.5, 0.1) };
        reports(scene(square(repeats), relief, n), &Settings::default())
    }

    #[test]
    fn sixteen_stripes_at_sixteen_parts_are_reported() {
        let reports = of(stripes(256, 16), 1.0, 16);
        let [report] = &reports[..] else { panic!("{reports:?}") };
        assert_eq!((report.texels, report.n, report.needed), (16.0, 16, Some(256)));
        assert_eq!((report.triangles, report.of), (2, 2));
        let text = report.to_string();
        assert!(text.contains("map.png: 16.0 texels") && text.contains("N = 256 reads all texels"), "{text}");
        // Two texels between neighbours are few enough.
        assert_eq!(of(stripes(256, 16), 1.0, 128), []);
        assert_eq!(of(stripes(256, 16), 1.0, 127).len(), 1);
    }

    #[test]
    fn maps_that_no_n_reads_are_told() {
        let reports = of(stripes(256, 16), 250.0, 16);
        assert_eq!((reports[0].texels, reports[0].needed), (4000.0, None));
        let text = reports[0].to_string();
        assert!(text.contains("even N = 4096, the greatest, leaves 15.6"), "{text}");
        // The greatest N itself.
        assert_eq!(of(stripes(256, 16), 16.0, 16)[0].needed, Some(4096));
        assert_eq!(of(stripes(256, 16), 16.01, 16)[0].needed, None);
    }

    /// Waves shorter than the distance of micro-vertices, of whatever length, are not taken for something flat.
    #[test]
    fn no_wave_passes() {
        for count in 1..=128 {
            assert_eq!(of(stripes(256, count), 1.0, 16).len(), 1, "{count} stripes");
        }
    }

    #[test]
    fn maps_that_lose_nothing_are_not_reported() {
        let clamped = |map: HeightMap, scale| {
            let wrap = Some(crate::settings::Wrap::Clamp);
            let relief = Relief { wrap, ..Relief::new(map, 0.5, scale) };
            reports(scene(square(1.0), relief, 4), &Settings::default()).len()
        };
        assert_eq!(clamped(map(64, 64, |_, _| 0.7), 1.0), 0);
        assert_eq!(clamped(stripes(64, 16), 0.0), 0);
        // A plane, but for rounding; at its clamped border it has a kink that is half a texel wide.
        assert_eq!(clamped(map(64, 64, |x, y| (x + 2 * y) as f32 / 256.0), 0.01), 0);
        assert_eq!(clamped(stripes(64, 16), 0.01), 1);
    }

    #[test]
    fn only_methods_of_micro_vertices_are_concerned() {
        for (method, shade, count) in [
            (Method::Quadtree, Shade::Lit, 1),
            (Method::GridWalk, Shade::Lit, 1),
            (Method::Tessellate, Shade::Lit, 1),
            (Method::BruteForce, Shade::Lit, 1),
            (Method::Relief, Shade::Lit, 0),
            (Method::Inverse, Shade::Lit, 0),
            (Method::None, Shade::Lit, 0),
            (Method::Relief, Shade::Error, 1),
        ] {
            let settings = Settings { method, shade, ..Settings::default() };
            let scene = scene(square(1.0), Relief::new(stripes(64, 16), 0.5, 0.1), 4);
            assert_eq!(reports(scene, &settings).len(), count, "{method}");
        }
    }

    /// One of the two triangles has the map on it a hundred times, and a sliver a thousand times.
    #[test]
    fn the_worst_triangle_counts_and_slivers_do_not() {
        let mut vertices =
            [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| vertex(x, y, 1.0)).to_vec();
        vertices.push(Vertex { v: 100.0, ..vertex(0.0, 1.0, 1.0) });
        vertices.push(Vertex { u: 1000.0, ..vertex(0.5, 0.0, 1.0) });
        let mesh = Mesh::from_triangles(&vertices, &[[0, 1, 2], [0, 2, 4], [0, 5, 1]]);
        let relief = Relief::new(map(8, 8, |x, y| ((x + y) % 4) as f32), 0.5, 0.1);
        let reports = reports(scene(mesh, relief, 4), &Settings::default());
        let [report] = &reports[..] else { panic!("{reports:?}") };
        assert_eq!((report.texels, report.triangles, report.of, report.needed), (200.0, 1, 2, Some(800)));
    }

    /// With an adaptive N there is something to say where a part is wider than a pixel: from so near that N is the
    /// greatest, or where wider ones were asked for.
    #[test]
    fn adaptive_n_falls_short_where_parts_are_wider_than_pixels() {
        let adaptive = |repeats: f32, distance: f32, pixels: f32| {
            let view = View {
                eye: Some(Vec3::new(1.3, 0.8, distance).as_dvec3()),
                target: Some(Vec3::new(1.3, 0.8, 0.0).as_dvec3()),
                ..View::default()
            };
            let (width, height) = (1200, 1000);
            let settings = Settings { adaptive: Some(pixels), view, width, height, ..Settings::default() };
            let relief = Relief::new(stripes(256, 16), 0.5, 0.001);
            let mut job =
                prepare(scene(square(repeats), relief, MAX_SUBDIVISIONS), &settings).expect("sound");
            load(&mut CpuBackend::new(), &mut job).expect("framed");
            undersampled(&job)
        };
        // At a distance of 0.1 a pixel is 6.3e-5 wide, and the longest side 2.8: 45,000 pixels.
        let near = adaptive(64.0, 0.1, 1.0);
        let [report] = &near[..] else { panic!("{near:?}") };
        assert_eq!((report.n, report.texels, report.needed), (4096, 4.0, None));
        assert_eq!(adaptive(64.0, 10.0, 1.0), [], "parts are narrower than pixels");
        assert_eq!(adaptive(32.0, 0.1, 1.0), [], "N = 4096 leaves two texels");
        let coarse = adaptive(1.0, 10.0, 64.0);
        let [report] = &coarse[..] else { panic!("{coarse:?}") };
        // 448 pixels at the least distance of 9.9995 or so: at least 7 parts.
        assert_eq!((report.n, report.needed, report.adaptive), (8, Some(256), true));
    }

    /// Three maps of one vector map are one, and so are two reliefs of one map.
    #[test]
    fn each_map_is_reported_once() {
        let wave = std::sync::Arc::new(stripes(64, 16));
        let relief = |scale| Relief::new(std::sync::Arc::clone(&wave), 0.5, scale);
        let mut two = scene(square(1.0), relief(0.1), 4);
        two.reliefs.push(relief(0.2));
        two.mesh.triangles[1].displacement = 1;
        assert_eq!(reports(two, &Settings::default()).len(), 1);
        let flat = std::sync::Arc::new(map(64, 64, |_, _| 0.5));
        let vectors = |last: &std::sync::Arc<HeightMap>| {
            let mut scene = scene(square(1.0), Relief::new(std::sync::Arc::clone(&flat), 0.5, 1.0), 4);
            scene.reliefs.push(Relief::new(std::sync::Arc::clone(&flat), 0.5, 1.0));
            scene.reliefs.push(Relief::new(std::sync::Arc::clone(last), 0.5, 1.0));
            let displacement = DisplacementKind::Tangent;
            reports(scene, &Settings { displacement, ..Settings::default() }).len()
        };
        assert_eq!((vectors(&wave), vectors(&flat)), (1, 0));
    }

    /// What the head of this file derives: every square of a texel within a triangle has a micro-vertex.
    #[test]
    fn needed_n_has_a_micro_vertex_in_each_texel() {
        let mut state = 7_u32;
        let mut unit = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 24)
        };
        let mut tested = 0;
        for _ in 0..300 {
            let corners = [(); 3].map(|()| DVec2::new(unit() * 24.0, unit() * 24.0));
            let edge = |e: usize| (corners[(e + 1) % 3] - corners[(e + 2) % 3]).abs().max_element();
            let n = (0..3).map(edge).fold(1.0, f64::max).ceil();
            let at = |j: f64, k: f64| {
                corners[0] + (corners[1] - corners[0]) * (j / n) + (corners[2] - corners[0]) * (k / n)
            };
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small and whole")]
            let parts = n as u32;
            let points: Vec<DVec2> = (0..=parts)
                .flat_map(|j| (0..=parts - j).map(move |k| (f64::from(j), f64::from(k))))
                .map(|(j, k)| at(j, k))
                .collect();
            for (x, y) in (0..24).flat_map(|x| (0..24).map(move |y| (x, y))) {
                let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let sides =
                    [0, 1, 2].map(|e| (corners[(e + 1) % 3] - corners[e]).perp_dot(centre - corners[e]));
                let is_inside = sides.iter().all(|&s| s >= 0.0) || sides.iter().all(|&s| s <= 0.0);
                if is_inside {
                    tested += 1;
                    let is_read = points.iter().any(|p| (*p - centre).abs().max_element() <= 0.5 + 1e-9);
                    assert!(is_read, "{corners:?} {centre}");
                }
            }
        }
        assert!(tested > 10_000, "{tested}");
    }
}

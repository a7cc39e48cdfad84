//! From a hit to a colour.

use crate::barycentric::interpolate;
use crate::displacement::cell::Cell;
use crate::displacement::surface::{BaseTriangle, HeightField};
use crate::displacement::vector;
use crate::film::Sample;
use crate::hit::Hit;
use crate::interface::{Instance, Material, color_format, filter, method, shade, wrap};
use crate::lighting::DirectLighting;
use crate::math::{MinMax, at, clamp, cross, dot, gamma, max_abs, next_down, next_up, sqrt, unit};
use crate::ray::TraversalRay;
use crate::relief;
use crate::sampler::pcg4d;
use crate::scene::{Features, SceneView};
use crate::smooth_base::SmoothBase;
use crate::texture::{ColorTexels, Level};
use glam::{UVec4, Vec2, Vec3};

/// A hit with what shading needs to know of the surface there.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceInteraction {
    /// The hit point, from the micro-triangle's barycentrics; in the world, as everything here.
    pub point: Vec3,
    /// Bound on the error of each coordinate of `point`, as a distance from the micro-triangle's plane and from that of
    /// any other in which the ray may as well have ended. In an instance what rays lose on their way into its space is
    /// part of it.
    pub point_error: Vec3,
    /// Where rays leave from before they are moved by the error: `point`, taken so far into its micro-triangle that
    /// rounding does not put them behind the neighbour across an edge, where the surface bends towards them.
    pub inner_point: Vec3,
    /// Unit geometric normal, to the outside of the base mesh.
    pub ng: Vec3,
    /// Unit normal that light is reflected by. Without [`Features::smooth`] it is `ng`; with it that of the relief over
    /// the smooth base ([`BaseTriangle::shading_normal`]), or where nothing is displaced the interpolated vertex normal
    /// on the side of `ng`.
    pub ns: Vec3,
    /// The base there; without [`Features::smooth`] all zero.
    pub base: SmoothBase,
    /// Texture coordinates.
    pub uv: Vec2,
    /// Index of its [`Material`].
    pub material: u32,
    /// How much of the map a unit of length shows: the root of the micro-triangle's area in texture coordinates over
    /// its area. 0 where it has no extent in the map.
    pub uv_density: f32,
    /// Height that the triangle's own map gives there, in the mesh's units (seams may decide another), or the vector's
    /// length; 0 where nothing is displaced.
    pub height: f32,
    /// Of methods in image space how far the relief is behind `point`, which is the base triangle's, along the ray that
    /// hit it; of others 0. See [`relief`].
    pub offset: f32,
}

impl SurfaceInteraction {
    /// The surface at `hit`, which must be one of `ray`.
    ///
    /// The error of the point has two parts, neither of which vanishes where a coordinate does.
    /// - Its own: a sum of three products, of weights that add up to 1 within 3 u, is off the plane by gamma(7) of the
    ///   greatest coordinate M of the micro-triangle (pbrt-v4, section 6.8.5); `OF_COORDINATE` leaves room for the
    ///   move along a rounded normal.
    /// - The error of the ray's end: of two surfaces which are as far from the ray's start within rounding, either may
    ///   be found, and a ray that leaves it has to start in front of both. The plane of a triangle, as the test sees it
    ///   from the ray's start, is off by 20 u of a corner's greatest depth ([`triangle`](crate::triangle) counts), two
    ///   planes by 40 u. A corner is no deeper than the distance travelled, t, and twice the greatest component of a
    ///   side: `OF_DEPTH`.
    #[inline]
    pub fn new(scene: &SceneView<'_>, features: Features, ray: &TraversalRay, hit: Hit) -> Self {
        let base = BaseTriangle::load(scene, hit.primitive);
        let (b1, b2) = (hit.b1, hit.b2);
        let b = Vec3::new(1.0 - b1 - b2, b1, b2);
        let field = HeightField::new(scene, features).of_triangle(scene, hit.primitive, hit.instance);
        let is_flat = method::traces_base_mesh(features.method);
        let is_smooth = features.method == method::INVERSE;
        let (p, w) = if is_flat {
            ([base.p0, base.p1, base.p2], b)
        } else if is_smooth {
            (base.tangent_triangle(&field, b), b)
        } else {
            let cell = Cell::unpack(hit.cell);
            let corner = |e: u32| {
                let (j, k) = cell.vertex(e);
                field.weights(j, k)
            };
            (base.micro_triangle(&field, cell), interpolate(b, corner(0), corner(1), corner(2)))
        };
        // A tangent triangle has its corner there.
        let on_triangle = if is_smooth { Vec3::X } else { b };
        let (e1, e2) = (p[1] - p[0], p[2] - p[0]);
        let area = cross(e1, e2);
        let n = unit(area);
        let ng = if base.flipped { -n } else { n };
        let ns = if features.smooth == 0 {
            ng
        } else if is_flat {
            base.vertex_normal(w, ng)
        } else {
            base.shading_normal(&field, w, ng)
        };
        let uv = base.uv(w);
        let parts = if is_flat || is_smooth { 1.0 } else { field.parts(Cell::unpack(hit.cell)) };
        let uv_area = (base.t1 - base.t0).perp_dot(base.t2 - base.t0).abs();
        let coordinate = max_abs(p[0]).max_num(max_abs(p[1])).max_num(max_abs(p[2]));
        let mut surface = SurfaceInteraction {
            point: interpolate(on_triangle, p[0], p[1], p[2]),
            point_error: Vec3::splat(gamma(OF_COORDINATE) * coordinate),
            inner_point: Vec3::ZERO,
            ng,
            ns,
            base: SmoothBase::default(),
            uv,
            material: base.material,
            uv_density: sqrt(uv_area / dot(area, n)) / parts,
            height: if is_flat { 0.0 } else { height(&field, &base, w) },
            offset: 0.0,
        };
        if method::is_image_space(features.method) {
            surface = relief::surface(scene, features, &field, &base, w, ray, hit, surface);
        }
        if features.smooth != 0 {
            let direction = if features.instances != 0 {
                at(scene.instances, hit.instance).object_vector(ray.direction)
            } else {
                ray.direction
            };
            surface.base = SmoothBase::new(&base, w, ng, dot(direction, ng) > 0.0);
        }
        let (mut side1, mut side2, mut area) = (e1, e2, dot(area, n));
        if features.instances != 0 {
            let instance = at(scene.instances, hit.instance);
            surface = surface.placed(&instance);
            if features.smooth != 0 {
                surface.base = surface.base.placed(&instance);
            }
            (side1, side2) = (instance.world_vector(e1), instance.world_vector(e2));
            area = dot(cross(side1, side2), surface.ng).abs();
            surface.uv_density = sqrt(uv_area / area) / parts;
        }
        let longest = max_abs(side1).max_num(max_abs(side2)).max_num(max_abs(side2 - side1));
        surface.point_error += Vec3::splat(gamma(OF_DEPTH) * (hit.t + 2.0 * longest));
        surface.inner_point = surface.point;
        if !is_smooth {
            let offset = dot(surface.ng.abs(), surface.point_error);
            let inner = interpolate(moved_inwards(b, offset, longest, area), p[0], p[1], p[2]);
            surface.inner_point = if features.instances != 0 {
                at(scene.instances, hit.instance).world_point(inner)
            } else {
                inner
            };
        }
        surface
    }

    /// The same of an instance, where this is in its object space; but for `uv_density`.
    #[inline]
    fn placed(self, instance: &Instance) -> Self {
        SurfaceInteraction {
            point: instance.world_point(self.point),
            point_error: instance.point_error(self.point, self.point_error),
            ng: instance.world_normal(self.ng),
            ns: instance.world_normal(self.ns),
            ..self
        }
    }

    /// The point that `ray`, which hit the surface, shows: that of the relief where it was found in image space, else
    /// `point`.
    #[inline]
    pub fn shown_point(&self, features: Features, ray: &TraversalRay) -> Vec3 {
        if method::is_image_space(features.method) {
            self.point + ray.direction * self.offset
        } else {
            self.point
        }
    }

    /// Where a ray towards `direction` can start so that rounding does not put it behind the surface: the inner point
    /// moved along the normal to the edge of its error box, then rounded away (pbrt-v4, section 6.8.6).
    #[inline]
    pub fn spawn_origin(&self, direction: Vec3) -> Vec3 {
        let n = if dot(direction, self.ng) < 0.0 { -self.ng } else { self.ng };
        let offset = n * dot(n.abs(), self.point_error);
        let origin = self.inner_point + offset;
        Vec3::new(
            round_along(origin.x, offset.x),
            round_along(origin.y, offset.y),
            round_along(origin.z, offset.z),
        )
    }
}

/// How many roundings of the greatest coordinate are in [`SurfaceInteraction::point_error`].
const OF_COORDINATE: u32 = 8;
/// How many of the greatest depth.
const OF_DEPTH: u32 = 48;
/// How far from each side of its micro-triangle a ray starts, in lengths of what it is moved by along the normal: so
/// that it is in front of a neighbour too with which the surface makes an angle of 10 degrees.
const FROM_SIDES: f32 = 8.0;
/// How far it is moved along the micro-triangle at most, in the same lengths: needles, where more would be far, come
/// less close to [`FROM_SIDES`].
const MOST_MOVED: f32 = 64.0;

/// Barycentric coordinates moved towards the triangle's middle until they are [`FROM_SIDES`] `offset` from each side,
/// or have moved by [`MOST_MOVED`] of it. `longest` is the greatest component of a side, `area` twice the triangle's.
///
/// With the share s of the way the distance to a side is at least s / 3 of the height on it, which is at least `area`
/// over sqrt(3) `longest`; the way is less than sqrt(3) `longest`.
#[inline]
fn moved_inwards(b: Vec3, offset: f32, longest: f32, area: f32) -> Vec3 {
    const ROOT_OF_3: f32 = 1.733;
    let length = ROOT_OF_3 * longest;
    let share =
        (3.0 * FROM_SIDES * offset * length / area).min_num(MOST_MOVED * offset / length).min_num(1.0);
    b + (Vec3::splat(1.0 / 3.0) - b) * share
}

/// The height that a triangle's own map gives at barycentric coordinates `w`, or the length of the vector.
#[inline]
fn height(field: &HeightField<'_>, base: &BaseTriangle, w: Vec3) -> f32 {
    let (uv, pixel) = (base.uv(w), base.pixel(field, w));
    if field.is_vector() {
        vector::components(field, base.displacement, uv, pixel).length()
    } else {
        field.height(&base.map, uv, pixel)
    }
}

/// The [neighbour](next_up) of `x` in the direction of `offset`: also of 0 one that devices do not take for 0.
#[inline]
fn round_along(x: f32, offset: f32) -> f32 {
    if offset > 0.0 {
        next_up(x)
    } else if offset < 0.0 {
        next_down(x)
    } else {
        x
    }
}

/// What the hit of a primary ray shows, as [`shade`] says: a colour, and the light that it is to be multiplied by.
/// `steps` is what finding it cost.
#[inline]
pub fn shade_hit(
    scene: &SceneView<'_>,
    features: Features,
    ray: &TraversalRay,
    hit: Hit,
    steps: u32,
) -> DirectLighting {
    if features.shade == shade::CELL {
        return DirectLighting::unlit(cell_color(hit));
    }
    if features.shade == shade::STEPS {
        return DirectLighting::unlit(heat(steps as f32 / scene.frame.steps_scale.max(1) as f32));
    }
    let surface = SurfaceInteraction::new(scene, features, ray, hit);
    if features.shade == shade::NORMAL {
        DirectLighting::unlit(surface.ns * 0.5 + Vec3::splat(0.5))
    } else if features.shade == shade::HEIGHT {
        let d = scene.frame;
        let range = d.height_max - d.height_min;
        let share = if range > 0.0 { (surface.height - d.height_min) / range } else { 0.0 };
        DirectLighting::unlit(Vec3::splat(share))
    } else if features.shade == shade::UV {
        let uv = surface.uv - surface.uv.floor();
        DirectLighting::unlit(Vec3::new(uv.x, uv.y, 0.0))
    } else {
        let albedo = albedo(scene, features, ray, hit, &surface);
        DirectLighting::new(scene.frame, features, albedo, ray, hit, &surface)
    }
}

/// Linear RGB of the surface at a hit of a primary ray.
#[inline]
fn albedo(
    scene: &SceneView<'_>,
    features: Features,
    ray: &TraversalRay,
    hit: Hit,
    surface: &SurfaceInteraction,
) -> Vec3 {
    let material = at(scene.materials, surface.material);
    let per_material = features.color_format == color_format::PER_MATERIAL;
    let format = if per_material { material.color_format } else { features.color_format };
    let wrap = if features.color_wrap == wrap::PER_MAP { material.color_wrap } else { features.color_wrap };
    let map = ColorTexels { texels: scene.color_texels, format, wrap, first_word: material.first_word };
    let finest = Level::finest(material.color_width, material.color_height);
    if format == color_format::NONE {
        material.albedo
    } else if features.filter == filter::BILINEAR {
        map.sample(finest, surface.uv)
    } else {
        let side = footprint_texels(scene, &material, ray, hit, surface);
        map.sample_levels(finest, surface.uv, side)
    }
}

/// How many texels of the colour map a pixel's side covers at a hit of a primary ray, where it covers most.
///
/// The pixel is a cone around the ray: Akenine-Möller, Crassin, Boksansky, Belcour, Panteleev and Wright, "Improved
/// Shader and Texture Level of Detail Using Ray Cones", JCGT 10(1), 2021. Its width at distance t is t times the
/// pixel's side at distance 1, and on the surface that over the cosine; the density of texels is that of the
/// micro-triangle where the paper has a triangle's. Not finite where the ray runs along the micro-triangle.
#[inline]
fn footprint_texels(
    scene: &SceneView<'_>,
    material: &Material,
    ray: &TraversalRay,
    hit: Hit,
    surface: &SurfaceInteraction,
) -> f32 {
    let frame = scene.frame;
    let density = surface.uv_density * sqrt(material.color_width as f32 * material.color_height as f32);
    hit.t * frame.pixel_side() * density / dot(ray.direction, surface.ng).abs()
}

/// A colour of its own for each micro-triangle of each instance.
#[inline]
fn cell_color(hit: Hit) -> Vec3 {
    let bits = pcg4d(UVec4::new(hit.primitive, hit.cell, hit.instance, 0));
    let channel = |x: u32| 0.15 + 0.8 * (x >> 24) as f32 / 255.0;
    Vec3::new(channel(bits.x), channel(bits.y), channel(bits.z))
}

/// Two samples' difference as [`shade::ERROR`] shows it: of luminances (Rec. 709), where nothing is hit black;
/// transparent where neither hits.
#[inline]
pub fn error_shown(a: Sample, b: Sample) -> Sample {
    let difference = dot(a.radiance - b.radiance, Vec3::new(0.2126, 0.7152, 0.0722)).abs();
    let alpha = a.alpha.max(b.alpha);
    Sample { radiance: heat(difference / RED_ERROR) * alpha, alpha }
}

/// The difference that is shown red: a quarter of full light.
const RED_ERROR: f32 = 0.25;

/// Blue at 0 and for NaN, green at a half, red at 1 and above.
#[inline]
fn heat(x: f32) -> Vec3 {
    let x = clamp(x, 0.0, 1.0);
    Vec3::new((2.0 * x - 1.0).max(0.0), 1.0 - (2.0 * x - 1.0).abs(), (1.0 - 2.0 * x).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counters::Counts;
    use crate::interface::{MISS, Material, Ray};
    use crate::render::{sample_pixel, trace_ray};
    use crate::test_scene::{FLAT, TestScene};

    fn sample(scene: &TestScene, features: Features) -> Sample {
        sample_pixel(&scene.view(), features, 0, 0, 0, &mut Counts::default())
    }

    #[test]
    fn full_ambient_light_shows_the_albedo() {
        let mut scene = TestScene::squares(&[0.0]);
        scene.frame.ambient = 1.0;
        assert_eq!(sample(&scene, FLAT), Sample { radiance: scene.materials[0].albedo, alpha: 1.0 });
    }

    /// With what is known of all materials, and where each is asked.
    #[test]
    fn a_triangle_shows_its_own_material() {
        let mut scene = TestScene::squares(&[0.0]);
        scene.frame.ambient = 1.0;
        scene.color_texels = [9.0_f32, 0.25, 0.5, 0.75].map(f32::to_bits).to_vec();
        let (color_format, color_wrap) = (color_format::FLOAT32, wrap::MIRROR);
        scene.materials.push(Material { albedo: Vec3::X, ..Material::default() });
        scene.materials.push(Material {
            color_format,
            color_wrap,
            color_width: 1,
            color_height: 1,
            first_word: 1,
            ..Material::default()
        });
        let mut shown = |material, features| {
            scene.triangles.iter_mut().for_each(|triangle| *triangle = triangle.with_material(material));
            sample(&scene, features).radiance
        };
        assert_eq!(shown(1, FLAT), Vec3::X);
        let of_texel = Vec3::new(0.25, 0.5, 0.75);
        assert_eq!(shown(2, Features { color_format, color_wrap, ..FLAT }), of_texel);
        let asked = Features { color_format: color_format::PER_MATERIAL, color_wrap: wrap::PER_MAP, ..FLAT };
        assert_eq!([0, 1, 2].map(|i| shown(i, asked)), [Vec3::new(0.5, 0.25, 1.0), Vec3::X, of_texel]);
    }

    #[test]
    fn nothing_hit_is_black_and_transparent() {
        let mut scene = TestScene::squares(&[0.0]);
        scene.frame.camera.forward = Vec3::Z;
        assert_eq!(sample(&scene, FLAT), Sample::default());
        scene.frame.camera.forward = -Vec3::Z;
        scene.frame.triangle_count = 0;
        assert_eq!(sample(&scene, FLAT), Sample::default());
    }

    /// E = I cos / d² in closed form at the hit's own point.
    #[test]
    fn light_falls_off_with_the_square_of_distance_and_the_cosine() {
        for position in [Vec3::new(0.0, 0.0, 2.0), Vec3::new(3.0, -1.0, 2.0)] {
            let scene = TestScene::squares(&[0.0]).with_light(position, 7.0);
            let jitter = crate::sampler::sample_2d(0, 0, 0, 0);
            let direction = scene.frame.camera.ray_direction(jitter);
            let point = scene.frame.camera.eye - direction * (5.0 / direction.z);
            let to_light = (position - point).as_dvec3();
            let expected =
                scene.materials[0].albedo.as_dvec3() * 7.0 * (to_light.z / to_light.length().powi(3));
            let got = sample(&scene, FLAT).radiance.as_dvec3();
            // Some 20 roundings, none amplified.
            assert!(
                (got - expected).abs().max_element() < 20.0 * 6e-8 * expected.max_element(),
                "{got} {expected}"
            );
        }
    }

    #[test]
    fn surface_is_lit_on_the_side_that_the_viewer_sees() {
        let above = TestScene::squares(&[0.0]).with_light(Vec3::Z, 1.0);
        let below = TestScene::squares(&[0.0]).with_light(-Vec3::Z, 1.0);
        // The hit lies within 0.5 of the light's foot: 0.5 / (1 + 0.5)^1.5 = 0.27 at the least.
        assert!(sample(&above, FLAT).radiance.x > 0.27);
        assert_eq!(sample(&below, FLAT).radiance, Vec3::ZERO);
        let mut seen_from_below = below;
        seen_from_below.frame.camera.eye.z = -5.0;
        seen_from_below.frame.camera.forward = Vec3::Z;
        assert!(sample(&seen_from_below, FLAT).radiance.x > 0.27);
    }

    #[test]
    fn shadow_falls_only_from_what_is_between_hit_and_light() {
        let shadows = Features { shadows: 1, ..FLAT };
        // The camera at z = 5 sees the square at 0; the light stands at z = 8 or z = 6, the second square at 7.
        let lit_at = |light: f32| {
            let scene = TestScene::squares(&[0.0, 7.0]).with_light(Vec3::new(0.0, 0.0, light), 100.0);
            (sample(&scene, shadows).radiance.x, sample(&scene, FLAT).radiance.x)
        };
        let (shadowed, unshadowed) = lit_at(8.0);
        assert_eq!(shadowed, 0.0);
        assert!(unshadowed > 0.5);
        let (before, same) = lit_at(6.0);
        assert_eq!(before, same);
    }

    #[test]
    fn normal_points_out_of_the_base_mesh_whichever_way_it_is_stored() {
        let down =
            Ray { origin: Vec3::new(0.3, 0.1, 5.0), t_max: 1e9, direction: -Vec3::Z * 2.0, padding: 0 };
        for scene in [TestScene::squares(&[0.0]), TestScene::squares(&[0.0]).flipped()] {
            for m in [method::NONE, method::BRUTE_FORCE, method::GRID_WALK] {
                let features = Features { method: m, ..FLAT };
                let hit = trace_ray(&scene.view(), features, down, &mut Counts::default());
                assert_eq!(hit.normal, Vec3::Z);
                // The distance is a quotient of sums of rounded products: gamma(12), as triangle.rs says.
                assert!((hit.t - 2.5).abs() <= 2.5 * gamma(12), "{}", hit.t);
                assert_eq!((hit.point.z, hit.primitive != MISS), (0.0, true));
            }
        }
    }

    #[test]
    fn t_max_is_in_lengths_of_the_direction() {
        let scene = TestScene::squares(&[0.0]);
        let ray = |t_max| Ray { origin: Vec3::Z * 5.0, t_max, direction: -Vec3::Z * 2.0, padding: 0 };
        let primitive = |r| trace_ray(&scene.view(), FLAT, r, &mut Counts::default()).primitive;
        assert_ne!(primitive(ray(2.5)), MISS);
        assert_eq!(primitive(ray(2.4)), MISS);
    }

    #[test]
    fn spawned_origin_clears_the_error_box_on_the_side_of_the_direction() {
        let surface = SurfaceInteraction {
            point: Vec3::new(100.0, -3.0, 1.0),
            inner_point: Vec3::new(100.0, -3.0, 1.0),
            point_error: Vec3::new(1e-5, 1e-6, 1e-6),
            ng: Vec3::new(0.6, 0.0, 0.8),
            ns: Vec3::Z,
            base: SmoothBase::default(),
            uv: Vec2::ZERO,
            material: 0,
            uv_density: 0.0,
            height: 0.0,
            offset: 0.0,
        };
        for direction in [surface.ng, -surface.ng] {
            let moved = (surface.spawn_origin(direction) - surface.point).as_dvec3();
            let along = moved.dot(direction.as_dvec3());
            assert!(along > 0.6 * 1e-5 + 0.8 * 1e-6, "{along}");
        }
    }

    /// By closed form: an equilateral triangle's corner is moved to where both sides are far enough away. A needle's
    /// point is not moved far.
    #[test]
    fn inner_point_keeps_off_the_sides() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::new(0.5, 0.75_f32.sqrt(), 0.0)];
        let offset = 1e-4;
        for b in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(0.5, 0.5, 0.0), Vec3::splat(1.0 / 3.0)] {
            let moved = moved_inwards(b, offset, 1.0, 0.75_f32.sqrt());
            // The weight of a corner is the distance to the side across, in heights of the triangle.
            assert!(moved.min_element() * 0.75_f32.sqrt() > FROM_SIDES * offset, "{moved}");
            let way = |w: Vec3| corners[0] * w.x + corners[1] * w.y + corners[2] * w.z;
            assert!(way(moved).distance(way(b)) < MOST_MOVED * offset, "{moved}");
        }
        let along_needle = moved_inwards(Vec3::X, 1e-4, 1.0, 1e-6) - Vec3::X;
        assert!(along_needle.abs().max_element() < MOST_MOVED * 1e-4);
    }

    /// A level square whose vertex normals lean outwards.
    fn pillow() -> TestScene {
        let mut scene = TestScene::squares(&[0.0]);
        for vertex in &mut scene.vertices {
            vertex.normal = (vertex.position + Vec3::Z).normalize();
        }
        scene
    }

    #[test]
    fn undisplaced_surface_is_smooth_by_its_vertex_normals() {
        let ray = TraversalRay::new(Vec3::Z * 5.0, -Vec3::Z, f32::INFINITY);
        let hit = Hit { t: 5.0, primitive: 0, b1: 0.25, b2: 0.5, ..Hit::NONE };
        let smooth = Features { smooth: 1, ..FLAT };
        for scene in [pillow(), pillow().flipped()] {
            let surface = SurfaceInteraction::new(&scene.view(), smooth, &ray, hit);
            let expected =
                (surface.point * 3.0_f32.sqrt().recip() + Vec3::Z * 3.0_f32.sqrt().recip()).normalize();
            assert_eq!(surface.ng, Vec3::Z);
            assert!(surface.ns.distance(expected) < 1e-6, "{} {expected}", surface.ns);
            assert_eq!(SurfaceInteraction::new(&scene.view(), FLAT, &ray, hit).ns, surface.ng);
        }
        // Vertex normals of a mesh that is stored inside out point away from the side that shows.
        let mut inside_out = pillow();
        inside_out.vertices.iter_mut().for_each(|vertex| vertex.normal = -vertex.normal);
        assert!(SurfaceInteraction::new(&inside_out.view(), smooth, &ray, hit).ns.z > 0.5);
        let mut bare = pillow();
        bare.vertices.iter_mut().for_each(|vertex| vertex.normal = Vec3::ZERO);
        assert_eq!(SurfaceInteraction::new(&bare.view(), smooth, &ray, hit).ns, Vec3::Z);
    }

    #[test]
    fn shading_modes_show_what_they_say() {
        let mut scene = TestScene::squares(&[0.0]);
        (scene.frame.height_min, scene.frame.height_max) = (-1.0, 3.0);
        scene.displacements[0].scale = 1.0;
        let mode = |shade| sample(&scene, Features { shade, method: method::GRID_WALK, ..FLAT }).radiance;
        assert_eq!(mode(shade::NORMAL), Vec3::new(0.5, 0.5, 1.0));
        assert_eq!(mode(shade::HEIGHT), Vec3::splat(0.25));
        let uv = mode(shade::UV);
        assert!(uv.x >= 0.0 && uv.x < 1.0 && uv.z == 0.0);
        assert!(mode(shade::CELL).min_element() >= 0.15);
        scene.frame.steps_scale = 2;
        let steps = sample(&scene, Features { shade: shade::STEPS, ..FLAT }).radiance;
        assert_eq!(steps, Vec3::X, "two triangles tested of two: red");
    }

    /// A triangle that is smaller than what a ray's start is moved by: to its middle and no farther.
    #[test]
    fn inner_point_of_a_tiny_triangle_is_its_middle() {
        let tiny = moved_inwards(Vec3::X, 1.0, 1e-3, 1e-6);
        assert!(tiny.distance(Vec3::splat(1.0 / 3.0)) < 1e-6, "{tiny}");
    }
}

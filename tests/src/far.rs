//! Models in doubles, in places far from the origin.

use crate::Numbers;
use crate::oracle::{Clarity, Oracle, WideRay};
use crate::scenes::{self, ReadyJob};
use emboss::backend::{Backend, Totals};
use emboss::framing::View;
use emboss::picture::Picture;
use emboss::render::{Scene, load, prepare, render};
use emboss::scene::assembly::{Assembly, MapSource, MaterialSource};
use emboss::scene::precise::PreciseVertex;
use emboss::scene::{HeightMap, Material, Mesh, Relief};
use emboss::settings::{ChannelOrder, DisplacementKind, Light, Settings, Wrap};
use emboss_kernels::interface::{FLIPPED, Intersection, Ray, height_format};
use emboss_kernels::math::UNIT_ROUNDOFF;
use glam::{DAffine3, DVec2, DVec3, Vec2, Vec3};
use std::ops::ControlFlow;
use std::sync::Arc;

/// A mesh in doubles under a height map.
#[derive(Clone, Debug)]
pub struct Model {
    /// Its corners.
    pub vertices: Vec<PreciseVertex>,
    /// Its triangles, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    map: Arc<HeightMap>,
    zero: f32,
    scale: f32,
}

impl Model {
    /// A patch of 4 by 4 squares, from 0 to 4 along x and z, with hills and a relief of noise. Normals are given.
    pub fn patch(numbers: &mut Numbers) -> Model {
        let corner = |i: u32| {
            let (x, z) = (f64::from(i % 5), f64::from(i / 5));
            let lean = DVec3::new(numbers.between(-0.3, 0.3).into(), 1.0, numbers.between(-0.3, 0.3).into());
            // A multiple of 2^-10, so that doubles hold it 2^42 units away.
            let y = f64::from(numbers.below(512)) / 1024.0;
            PreciseVertex {
                position: DVec3::new(x, y, z),
                normal: lean.normalize().as_vec3(),
                uv: DVec2::new(x, z) / 4.0,
            }
        };
        let vertices = (0..25).map(corner).collect();
        let squares = (0..20).filter(|a| a % 5 < 4);
        let triangles = squares.flat_map(|a| [[a, a + 5, a + 6], [a, a + 6, a + 1]]).collect();
        let texels = (0..64).map(|_| numbers.unit().to_bits()).collect();
        let format = height_format::FLOAT32;
        let map = HeightMap { width: 8, height: 8, format, texels, range: (0.0, 1.0), replaced: 0 };
        Model { vertices, triangles, map: Arc::new(map), zero: 0.5, scale: 0.25 }
    }

    /// One of [`scenes::random_solid`].
    pub fn solid(numbers: &mut Numbers) -> Model {
        let scene = scenes::random_solid(numbers, height_format::FLOAT32, 0.3);
        let relief = &scene.reliefs[0];
        let corner = |v: &emboss_kernels::interface::Vertex| PreciseVertex {
            position: v.position.as_dvec3(),
            normal: v.normal,
            uv: DVec2::new(v.u.into(), v.v.into()),
        };
        let triangle = |t: &emboss_kernels::interface::Triangle| {
            let [a, b, c] = t.vertices;
            if t.flags & FLIPPED == 0 { [a, b, c] } else { [a, c, b] }
        };
        Model {
            vertices: scene.mesh.vertices.iter().map(corner).collect(),
            triangles: scene.mesh.triangles.iter().map(triangle).collect(),
            map: Arc::clone(&relief.map),
            zero: relief.zero,
            scale: relief.scale,
        }
    }

    /// The same in another place; a rotation and a translation.
    #[must_use]
    pub fn moved(&self, motion: DAffine3) -> Model {
        let moved = |v: &PreciseVertex| PreciseVertex {
            position: motion.transform_point3(v.position),
            normal: motion.transform_vector3(v.normal.as_dvec3()).as_vec3(),
            ..*v
        };
        Model { vertices: self.vertices.iter().map(moved).collect(), ..self.clone() }
    }

    /// The same, all lengths so many times as long.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Model {
        let scaled = |v: &PreciseVertex| PreciseVertex { position: v.position * factor, ..*v };
        #[expect(clippy::cast_possible_truncation, reason = "by a power of two")]
        let scale = (f64::from(self.scale) * factor) as f32;
        Model { vertices: self.vertices.iter().map(scaled).collect(), scale, ..self.clone() }
    }

    /// The same, its texture coordinates so many tiles away.
    #[must_use]
    pub fn shifted(&self, tiles: f64) -> Model {
        let shifted = |v: &PreciseVertex| PreciseVertex { uv: v.uv + DVec2::new(tiles, -tiles), ..*v };
        Model { vertices: self.vertices.iter().map(shifted).collect(), ..self.clone() }
    }

    /// The middle of its box, and the greatest side.
    pub fn middle_and_extent(&self) -> (DVec3, f64) {
        let positions = || self.vertices.iter().map(|v| v.position);
        let min = positions().fold(DVec3::INFINITY, DVec3::min);
        let max = positions().fold(DVec3::NEG_INFINITY, DVec3::max);
        ((min + max) * 0.5, (max - min).max_element())
    }

    /// Its mesh about its own origin.
    pub fn mesh(&self) -> Mesh {
        let mesh = Mesh::from_precise(&self.vertices, self.triangles.iter().map(|&triangle| (triangle, 0)));
        assert_eq!((mesh.dropped, mesh.collapsed), (0, 0), "no triangle is lost");
        mesh
    }

    fn material(&self) -> MaterialSource {
        MaterialSource {
            albedo: None,
            color: None,
            color_wrap: None,
            height: Some(MapSource::Made { name: "noise".to_owned(), map: Arc::clone(&self.map) }),
            sideways: None,
            height_wrap: None,
            zero: Some(self.zero),
            scale: self.scale,
            invert: false,
            normal: None,
        }
    }

    /// The settings that look at it from one side, with a light of its own: all lengths of `view` are taken by
    /// `motion` and then multiplied by `factor`.
    pub fn settings(&self, motion: DAffine3, factor: f64) -> Settings {
        let (middle, extent) = self.middle_and_extent();
        // Short numbers, so that they are the same however far they are moved.
        let short = |p: DVec3| (p * 1024.0).map(f64::round) / 1024.0;
        let at = |offset: DVec3| motion.transform_point3(short(middle + offset * extent)) * factor;
        let view = View {
            eye: Some(at(DVec3::new(0.7, 0.9, 1.1))),
            target: Some(at(DVec3::ZERO)),
            up: Some(motion.transform_vector3(DVec3::Y)),
            ..View::default()
        };
        #[expect(clippy::cast_possible_truncation, reason = "rounded")]
        let intensity = (4.0 * extent * extent * factor * factor) as f32;
        let position = at(DVec3::new(-0.8, 1.5, 0.4));
        let light = Light { position, color: Vec3::ONE, intensity: Some(intensity) };
        Settings { width: 40, height: 30, view, lights: vec![light], counting: true, ..Settings::default() }
    }
}

/// The scene of models as the command line puts it together, each where it stands or in places of its own.
///
/// # Panics
/// Never: no file is read.
pub fn assembled(models: &[(&Model, Vec<DAffine3>)], wrap: Wrap, n: u32) -> Scene {
    let mut assembly = Assembly::new(DisplacementKind::Height, ChannelOrder::Blender);
    for (model, places) in models {
        let source = MaterialSource { height_wrap: Some(wrap), ..model.material() };
        let material = assembly.material(&source).expect("made by code");
        if places.is_empty() {
            assembly.add(model.mesh(), &[material]);
        } else {
            assembly.add_placed(model.mesh(), &[material], places.clone());
        }
    }
    assembly.finish(n)
}

/// What a backend makes of a scene: its picture of one sample, and the work it took where that is counted.
///
/// # Panics
/// Where it cannot.
pub fn seen(backend: &mut dyn Backend, scene: Scene, settings: &Settings) -> (Picture, Totals) {
    let mut job = prepare(scene, settings).expect("sound");
    load(backend, &mut job).expect("framed");
    let rendering = render(backend, &job, 1, &mut |_| ControlFlow::Continue(())).expect("renders");
    (rendering.picture, rendering.totals)
}

/// How many pixels of two pictures differ in any bit.
///
/// # Panics
/// Where they are not of a size.
pub fn differing(a: &Picture, b: &Picture) -> usize {
    assert_eq!((a.width, a.height), (b.width, b.height));
    a.pixels
        .iter()
        .zip(&b.pixels)
        .filter(|(a, b)| a.to_array().map(f32::to_bits) != b.to_array().map(f32::to_bits))
        .count()
}

/// The rays through the centres of a job's pixels.
pub fn pixel_rays(job: &ReadyJob) -> Vec<Ray> {
    let (camera, width, height) = (&job.frame.camera, job.frame.width, job.frame.height);
    let ray = |i: u32| {
        let (x, y) = ((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
        let direction = camera.ray_direction(Vec2::new(x / width as f32, y / height as f32));
        Ray { origin: camera.eye, t_max: f32::INFINITY, direction, padding: 0 }
    };
    (0..width * height).map(ray).collect()
}

/// A scene and the same one moved, both ready for rays.
///
/// The moved one's hits are what the unmoved one's surface explains, within this bound. With u = 2^-24, p a coordinate
/// of either mesh about its own origin, up to R and R', h the greatest height, T the way moved:
/// - positions are rounded to doubles where they stand, 2^-53 (T + R'), and to floats about the origins, u R and u R';
/// - unit normals are rounded in both, u each, and the sum that is renormalised is at least half as long:
///   together they turn by 4 u, which moves a point by 4 u h;
/// - what f32 makes of the moved surface and of its rays is off as its own oracle counts: across the ray by
///   [`Answer::lateral_error`](crate::oracle::Answer::lateral_error), along it by less than 3 times that (26 u of the
///   reach for 12.7 u across where all is correctly rounded, 61 u for 48 u on Vulkan).
///
/// What f32 makes of the unmoved surface is what its oracle allows anyway.
pub struct Moved {
    still: ReadyJob,
    /// The moved one.
    pub there: ReadyJob,
    motion: DAffine3,
    oracles: [Oracle; 2],
    /// The first three lines of the bound.
    surface_error: f64,
}

impl Moved {
    /// A model, and a motion: a rotation and a translation.
    pub fn new(model: &Model, motion: DAffine3, n: u32, oracle: impl Fn(&ReadyJob) -> Oracle) -> Moved {
        // Without a power of two: lengths are the world's.
        let ready = |shape: &Model, motion: DAffine3| {
            let scene = Scene {
                mesh: shape.mesh(),
                reliefs: vec![Relief::new(Arc::clone(&model.map), model.zero, model.scale)],
                materials: vec![Material::default()],
                parts: vec![],
                subdivisions: n,
            };
            scenes::job(scene, &model.settings(motion, 1.0))
        };
        let (still, there) = (ready(model, DAffine3::IDENTITY), ready(&model.moved(motion), motion));
        let reach = |job: &ReadyJob| {
            let positions = job.buffers.vertices.iter().map(|v| f64::from(v.position.abs().max_element()));
            positions.fold(0.0, f64::max)
        };
        let u = f64::from(UNIT_ROUNDOFF);
        let height = f64::from(still.frame.height_min.abs().max(still.frame.height_max.abs()));
        let far = motion.translation.abs().max_element() + reach(&there);
        let each = u * (reach(&still) + reach(&there)) + 2_f64.powi(-53) * far;
        Moved {
            surface_error: 3_f64.sqrt() * each + 4.0 * u * height,
            oracles: [oracle(&still), oracle(&there)],
            still,
            there,
            motion,
        }
    }

    /// Whether the moved scene's hits are those of the unmoved one within the bound; how many had but one right answer.
    ///
    /// # Panics
    /// Where one is not.
    pub fn assert_right(&self, rays: &[Ray], hits: &[Intersection]) -> usize {
        let back = self.motion.matrix3.transpose();
        let mut clear = 0;
        for (ray, hit) in rays.iter().zip(hits) {
            // Origins are subtracted before anything is turned, so that doubles lose nothing.
            let from_pivot = ray.origin.as_dvec3() + (self.there.space.origin - self.motion.translation);
            let own = self.oracles[1].trace(ray).lateral_error;
            let wide = WideRay {
                origin: self.still.space.point(back * from_pivot),
                direction: back * ray.direction.as_dvec3(),
                t_max: ray.t_max.into(),
                start_error: self.surface_error + 3.0 * own,
                slope_error: 0.0,
            };
            match self.oracles[0].trace_wide(&wide).judge(hit) {
                Ok(Clarity::Clear) => clear += 1,
                Ok(Clarity::Close) => {}
                Err(wrong) => panic!("{wrong:?} of {ray:?}, {hit:?}, moved by {}", self.motion),
            }
        }
        clear
    }

    /// By how much the moved scene's rays through pixels differ from the unmoved one's: at their origins, and in their
    /// directions; the first with its bound.
    pub fn rays_apart(&self) -> ([f64; 2], f64) {
        let back = self.motion.matrix3.transpose();
        let (mut start, mut turn) = (0.0_f64, 0.0_f64);
        let pairs = pixel_rays(&self.still).into_iter().zip(pixel_rays(&self.there));
        let mut reach = 0.0_f64;
        for (a, b) in pairs {
            let from_pivot = b.origin.as_dvec3() + (self.there.space.origin - self.motion.translation);
            start = start.max((back * from_pivot - self.still.space.world(a.origin.as_dvec3())).length());
            turn = turn.max((back * b.direction.as_dvec3() - a.direction.as_dvec3()).length());
            reach = reach.max(f64::from(a.origin.abs().max_element() + b.origin.abs().max_element()));
        }
        // An ulp of what stands in the command line, and half of one of each float.
        let far = self.motion.translation.abs().max_element() + reach;
        let bound = 3_f64.sqrt() * (f64::from(UNIT_ROUNDOFF) * reach + 2_f64.powi(-52) * far);
        ([start, turn], bound)
    }
}

//! Planes that lie in one another, which cast no shadow there, and closed rooms, which no light enters.
//!
//! Both need no tolerance in scene units. A plane is lit from one side by lights that nothing is in the way of: so a
//! picture with shadows is the picture without. A camera within a closed mesh and lights outside of it: so every pixel
//! shows the surface, in black.

use crate::Numbers;
use crate::compare::rendered;
use crate::meshes::Placed;
use crate::scenes::{ReadyJob, WildMap, job};
use emboss::backend::Backend;
use emboss::compare::usual_methods;
use emboss::framing::View;
use emboss::instances::Part;
use emboss::render::Scene;
use emboss::scene::{HeightMap, Material, Mesh, Relief};
use emboss::settings::{Light, Method, Settings};
use emboss_kernels::interface::{Vertex, counter};
use glam::{DAffine3, DVec2, DVec3, Vec3, Vec4};

/// Where a plane lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plane {
    /// In x = 0, wherever it is moved.
    X,
    /// In y = 0.
    Y,
    /// In z = 0.
    Z,
    /// In none of them. Moved out of its plane, too.
    Tilted,
}

impl Plane {
    /// All of them.
    pub const ALL: [Plane; 4] = [Plane::X, Plane::Y, Plane::Z, Plane::Tilted];

    /// Two unit vectors in it and its normal, which they span.
    pub fn axes(self) -> [DVec3; 3] {
        match self {
            Plane::X => [DVec3::Y, DVec3::Z, DVec3::X],
            Plane::Y => [DVec3::Z, DVec3::X, DVec3::Y],
            Plane::Z => [DVec3::X, DVec3::Y, DVec3::Z],
            Plane::Tilted => {
                let right = DVec3::new(1.0, 0.31, -0.2).normalize();
                let normal = right.cross(DVec3::new(0.1, -0.17, 1.0)).normalize();
                [right, normal.cross(right), normal]
            }
        }
    }
}

/// What lies in a square's plane with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pair {
    /// Nothing: its two triangles are coplanar.
    Alone,
    /// The square once more, on the same vertices.
    Same,
    /// Turned round, on the same vertices.
    Reversed,
    /// On vertices of its own with the opposite normal, turned round: a card with a front and a back.
    Back,
    /// Cut along the other diagonal.
    OtherDiagonal,
    /// Turned round and cut along the other diagonal, on vertices of its own.
    BackOtherDiagonal,
    /// A smaller square, turned in the plane: a decal.
    Decal,
    /// A strip of squares beside it, so long that its far corners are a hundred times as far away.
    Neighbours,
    /// The square of another model that does not weld with it.
    Models,
    /// Two instances of one mesh.
    Instances,
    /// An instance and a model whose vertices are those of another place.
    InstanceAndModel,
}

impl Pair {
    /// All of them.
    pub const ALL: [Pair; 11] = [
        Pair::Alone,
        Pair::Same,
        Pair::Reversed,
        Pair::Back,
        Pair::OtherDiagonal,
        Pair::BackOtherDiagonal,
        Pair::Decal,
        Pair::Neighbours,
        Pair::Models,
        Pair::Instances,
        Pair::InstanceAndModel,
    ];

    /// Whether it is made of instances.
    pub fn is_of_instances(self) -> bool {
        matches!(self, Pair::Instances | Pair::InstanceAndModel)
    }

    /// Whether the second surface has the corners of the first one's triangles, to the bit, in any order.
    pub fn has_the_same_corners(self) -> bool {
        matches!(self, Pair::Same | Pair::Reversed | Pair::Back | Pair::Models | Pair::Instances)
    }
}

/// A square of side 2 and what lies in its plane.
#[derive(Clone, Copy, Debug)]
pub struct Planes {
    /// Where.
    pub plane: Plane,
    /// With what.
    pub pair: Pair,
    /// Times so much.
    pub scale: f64,
    /// So many of its extents away from the origin.
    pub offset: f64,
}

/// The square's corners in its plane, counter-clockwise.
const SQUARE: [DVec2; 4] =
    [DVec2::new(-1.0, -1.0), DVec2::new(1.0, -1.0), DVec2::new(1.0, 1.0), DVec2::new(-1.0, 1.0)];

impl Planes {
    /// How far it is moved.
    fn away(&self) -> DVec3 {
        let [right, up, normal] = self.plane.axes();
        let aside = if self.plane == Plane::Tilted { 0.41 } else { 0.0 };
        (right - up * 0.73 + normal * aside) * (2.0 * self.scale * self.offset)
    }

    /// A point by its coordinates in the plane and above it, in f64.
    fn point(&self, p: DVec3) -> DVec3 {
        let [right, up, normal] = self.plane.axes();
        (right * p.x + up * p.y + normal * p.z) * self.scale + self.away()
    }

    /// The same rounded: what the program is given.
    fn single(&self, x: f64, y: f64, z: f64) -> Vec3 {
        self.point(DVec3::new(x, y, z)).as_vec3()
    }

    /// Vertices at places in the plane, `side` being 1 on its front and -1 on its back.
    fn vertices(&self, corners: &[DVec2], side: f64) -> Vec<Vertex> {
        let normal = (self.plane.axes()[2] * side).as_vec3();
        let vertex = |c: &DVec2| {
            let uv = (*c * 0.5 + 0.5).as_vec2();
            Vertex { position: self.single(c.x, c.y, 0.0), normal, u: uv.x, v: uv.y }
        };
        corners.iter().map(vertex).collect()
    }

    /// The mesh, and where its parts stand if they are instances.
    fn mesh(&self) -> (Mesh, Vec<Part>) {
        let mut vertices = self.vertices(&SQUARE, 1.0);
        let mut triangles = vec![[0, 1, 2], [0, 2, 3]];
        let mut parts = Vec::new();
        let mut other = None;
        match self.pair {
            Pair::Alone => {}
            Pair::Same => triangles.extend([[0, 1, 2], [0, 2, 3]]),
            Pair::Reversed => triangles.extend([[2, 1, 0], [3, 2, 0]]),
            Pair::Back => {
                vertices.extend(self.vertices(&SQUARE, -1.0));
                triangles.extend([[6, 5, 4], [7, 6, 4]]);
            }
            Pair::OtherDiagonal => triangles.extend([[1, 2, 3], [1, 3, 0]]),
            Pair::BackOtherDiagonal => {
                vertices.extend(self.vertices(&SQUARE, -1.0));
                triangles.extend([[7, 6, 5], [4, 7, 5]]);
            }
            Pair::Decal => {
                let turn = DVec2::from_angle(0.4) * 0.45;
                vertices.extend(self.vertices(&SQUARE.map(|c| turn.rotate(c)), 1.0));
                triangles.extend([[4, 5, 6], [4, 6, 7]]);
            }
            Pair::Neighbours => {
                let strip = [DVec2::new(200.0, -1.0), DVec2::new(200.0, 1.0)];
                let far = [DVec2::new(-200.0, 1.0), DVec2::new(-200.0, -1.0)];
                vertices.extend(self.vertices(&strip, 1.0));
                vertices.extend(self.vertices(&far, 1.0));
                triangles.extend([[1, 4, 5], [1, 5, 2], [3, 6, 7], [3, 7, 0]]);
            }
            Pair::Models => other = Some(Mesh::from_triangles(&vertices, &triangles)),
            Pair::Instances => {
                parts.push(Part { triangle_count: 2, places: vec![DAffine3::IDENTITY; 2] });
            }
            Pair::InstanceAndModel => {
                let home = Planes { offset: 0.0, ..*self };
                other = Some(Mesh::from_triangles(&home.vertices(&SQUARE, 1.0), &triangles));
                parts.push(Part { triangle_count: 2, places: vec![DAffine3::IDENTITY] });
                let place = DAffine3::from_translation(self.away());
                parts.push(Part { triangle_count: 2, places: vec![place] });
            }
        }
        let mut mesh = Mesh::from_triangles(&vertices, &triangles);
        if let Some(other) = other {
            mesh.append(other);
        }
        (mesh, parts)
    }

    /// The job by a method: `shadows` or none; a light that stands high and one that stands low above the front.
    pub fn job(
        &self,
        method: Method,
        relief: Relief,
        subdivisions: u32,
        size: (u32, u32),
        shadows: bool,
    ) -> ReadyJob {
        let (mesh, parts) = self.mesh();
        let light = |x: f64, y: f64, z: f64| Light {
            position: self.single(x, y, z).as_dvec3(),
            color: Vec3::ONE,
            intensity: None,
        };
        let up = self.plane.axes()[1].as_vec3();
        let view = View {
            eye: Some(self.single(0.9, -1.3, 2.6).as_dvec3()),
            target: Some(self.single(0.0, 0.0, 0.0).as_dvec3()),
            up: Some(up.as_dvec3()),
            ..View::default()
        };
        let scene =
            Scene { mesh, reliefs: vec![relief], materials: vec![Material::default()], parts, subdivisions };
        let settings = Settings {
            method,
            shadows,
            view,
            lights: vec![light(-0.3, 0.4, 3.0), light(2.5, 1.1, 0.25)],
            ambient: 0.0,
            width: size.0,
            height: size.1,
            counting: true,
            ..Settings::default()
        };
        job(scene, &settings)
    }
}

/// A map that displaces nothing, though its texels are neither 0 nor what zero usually is.
pub fn level() -> Relief {
    Relief::new(HeightMap::flat(0.25), 0.25, 0.3)
}

/// Every method.
pub fn methods() -> Vec<Method> {
    let mut methods = usual_methods();
    methods.push(Method::BruteForce);
    methods
}

/// Pictures that are checked, and how many shadow rays that took.
#[derive(Debug, Default)]
pub struct Tally {
    /// Pictures.
    pub pictures: u64,
    /// Shadow rays.
    pub shadow_rays: u64,
}

/// By how much, relative to its value, a pixel of `samples` samples may differ whether shadows are looked for or not.
/// A device may sum up the same light in another order, some ten roundings; a light that one sample misses takes at
/// least a hundredth of that sample's light.
fn most_difference(samples: u32) -> f32 {
    0.25 * 0.01 / samples as f32
}

/// Asserts that shadows change nothing of the planes.
///
/// # Panics
/// Where one does, or there is nothing to be seen.
pub fn assert_unshadowed(
    backend: &mut dyn Backend,
    planes: &Planes,
    method: Method,
    subdivisions: u32,
    size: (u32, u32),
    samples: u32,
    tally: &mut Tally,
) {
    let what = format!("{planes:?} by {method}, N = {subdivisions}");
    let [with, without] = [true, false].map(|shadows| {
        let job = planes.job(method, level(), subdivisions, size, shadows);
        let picture = rendered(backend, &job, samples);
        if shadows {
            let totals = backend.totals().expect("work was counted");
            tally.shadow_rays += totals[counter::SHADOW_RAYS as usize];
        }
        picture
    });
    tally.pictures += 1;
    let lit = without.pixels.iter().filter(|pixel| pixel.truncate().min_element() > 0.0).count();
    assert!(4 * lit > without.pixels.len(), "{what}: {lit} pixels are lit");
    let differs = |(a, b): (&Vec4, &Vec4)| {
        let difference = (a - b).abs().max_element();
        difference.is_nan() || difference > most_difference(samples) * b.max_element()
    };
    let shadowed = with.pixels.iter().zip(&without.pixels).filter(|&pair| differs(pair)).count();
    assert!(shadowed == 0, "{what}: {shadowed} of {} pixels are in shadow", with.pixels.len());
}

/// Asserts that no light from outside reaches a camera within a solid, which looks along every axis.
///
/// # Panics
/// Where some does, or a pixel shows no surface.
pub fn assert_dark(
    backend: &mut dyn Backend,
    (what, solid): (&str, &Placed),
    (map, height): (WildMap, f64),
    subdivisions: u32,
    size: (u32, u32),
    samples: u32,
    tally: &mut Tally,
) {
    let [min, max] = [Vec3::min, Vec3::max].map(|pick| {
        solid.mesh.vertices.iter().map(|v| v.position).reduce(pick).expect("a solid has vertices")
    });
    let (middle, extent) = ((min + max) * 0.5, (max - min).max_element());
    let lights = [Vec3::new(1.3, 0.4, 0.2), Vec3::new(-0.5, -1.1, -0.9), Vec3::new(0.2, 1.2, -1.0)];
    let light =
        |to: Vec3| Light { position: (middle + to * extent).as_dvec3(), color: Vec3::ONE, intensity: None };
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest f32")]
    let relief = Relief::new(map.map(&mut Numbers::new(9)), 0.0, (height * solid.room) as f32);
    for (i, forward) in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z].into_iter().enumerate() {
        let eye = solid.inside[i % solid.inside.len()];
        let view = View {
            eye: Some(eye.as_dvec3()),
            target: Some((eye + forward * extent * 0.2).as_dvec3()),
            up: Some(Vec3::new(forward.y, forward.z, forward.x).as_dvec3()),
            fov: 100.0,
            ..View::default()
        };
        let settings = Settings {
            view,
            lights: lights.map(light).to_vec(),
            ambient: 0.0,
            width: size.0,
            height: size.1,
            counting: true,
            ..Settings::default()
        };
        let scene = Scene {
            mesh: solid.mesh.clone(),
            reliefs: vec![relief.clone()],
            materials: vec![Material::default()],
            parts: vec![],
            subdivisions,
        };
        let picture = rendered(backend, &job(scene, &settings), samples);
        let totals = backend.totals().expect("work was counted");
        tally.shadow_rays += totals[counter::SHADOW_RAYS as usize];
        tally.pictures += 1;
        let wrong = picture.pixels.iter().filter(|&&pixel| pixel != Vec4::new(0.0, 0.0, 0.0, 1.0)).count();
        assert!(
            wrong == 0,
            "{what}, {map:?}, N = {subdivisions}, towards {forward}: light on {wrong} pixels"
        );
    }
}

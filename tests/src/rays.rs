//! Rays of every kind that makes trouble.

use crate::Numbers;
use crate::scenes::ReadyJob;
use emboss_kernels::barycentric::interpolate;
use emboss_kernels::displacement::cell::Cell;
use emboss_kernels::displacement::surface::{BaseTriangle, HeightField};
use emboss_kernels::interface::{Intersection, NO_SEAMS, Ray, Vertex, displacement_kind};
use emboss_kernels::scene::SceneView;
use emboss_kernels::shading::SurfaceInteraction;
use emboss_kernels::smooth_base::SmoothBase;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

/// Makes rays at random for a scene.
pub struct RaySource<'a> {
    job: &'a ReadyJob,
    numbers: Numbers,
    centre: Vec3,
    /// Half the diagonal of the box around the displaced model.
    radius: f32,
}

impl<'a> RaySource<'a> {
    /// Rays for the scene of `job`, which is not empty, as `seed` decides.
    pub fn new(job: &'a ReadyJob, seed: u64) -> Self {
        let root = job.bounds();
        let (centre, radius) = ((root.min + root.max) * 0.5, 0.5 * (root.max - root.min).length());
        RaySource { job, numbers: Numbers::new(seed), centre, radius }
    }

    /// So many rays of each kind: from outside, from inside the relief, grazing, along normals, towards edges.
    pub fn of_each_kind(&mut self, count: usize) -> Vec<Ray> {
        let five = |_| {
            [
                self.from_outside(),
                self.from_inside(),
                self.grazing(),
                self.along_normal(),
                self.towards_edge(3.0),
            ]
        };
        (0..count).flat_map(five).collect()
    }

    /// From outside, two to ten radii away, towards the model; the direction has a length between 1/4 and 4.
    pub fn from_outside(&mut self) -> Ray {
        let distance = self.radius * self.numbers.between(2.0, 10.0);
        let origin = self.centre + self.numbers.direction() * distance;
        let target = self.near_surface();
        let length = self.numbers.between(-2.0, 2.0).exp2();
        ray(origin, (target - origin).normalize() * length)
    }

    /// From within the relief, anywhere.
    pub fn from_inside(&mut self) -> Ray {
        ray(self.near_surface(), self.numbers.direction())
    }

    /// Through the relief, nearly along its base triangle.
    pub fn grazing(&mut self) -> Ray {
        let (primitive, w) = self.place();
        let [a, b, c] = self.corners(primitive).map(|v| v.position);
        let normal = (b - a).cross(c - a).normalize();
        let along = normal.cross(self.numbers.direction()).normalize();
        let steepness = self.numbers.between(-0.1, 0.1);
        let direction = (along + normal * steepness).normalize();
        let target = self.point(primitive, w);
        ray(target - direction * (self.radius * self.numbers.between(0.0, 2.0)), direction)
    }

    /// Down or up along the interpolated normal at a grid point: through a micro-vertex, or nearly so.
    pub fn along_normal(&mut self) -> Ray {
        let primitive = self.numbers.below(self.job.frame.triangle_count);
        let n = self.n_of(primitive);
        let j = self.numbers.below(n + 1);
        let k = self.numbers.below(n + 1 - j);
        let w = Vec3::new((n - j - k) as f32, j as f32, k as f32) / n as f32;
        let (mut p, normal) = self.base(primitive, w);
        if self.job.features.displacement != displacement_kind::HEIGHT {
            p = self.micro_vertex(primitive, j, k);
        }
        let side = if self.numbers.unit() < 0.5 { self.radius } else { -self.radius };
        ray(p + normal * side, normal * -side.signum())
    }

    /// Towards a corner or a point of an edge of the base mesh, displaced to some height: where base triangles meet.
    /// From a distance of so many radii.
    pub fn towards_edge(&mut self, radii: f32) -> Ray {
        let primitive = self.numbers.below(self.job.frame.triangle_count);
        let s = if self.numbers.unit() < 0.2 { 0.0 } else { self.numbers.unit() };
        let w = [Vec3::new(1.0 - s, s, 0.0), Vec3::new(0.0, 1.0 - s, s), Vec3::new(s, 0.0, 1.0 - s)];
        let w = w[self.numbers.below(3) as usize];
        let target = self.point(primitive, w);
        let origin = self.centre + self.numbers.direction() * (radii * self.radius);
        ray(origin, (target - origin).normalize())
    }

    /// Away from a hit, on the outer side of it or on the inner one, as shadow rays start.
    pub fn leaving(&mut self, hit: &Intersection) -> Ray {
        let direction = self.numbers.direction();
        ray(spawn_origin(hit, direction), direction)
    }

    /// Away from a hit on its outer side. Some directions graze the surface.
    pub fn leaving_outwards(&mut self, hit: &Intersection) -> Ray {
        let direction = self.numbers.direction();
        let sine = direction.dot(hit.normal);
        let flat = direction - hit.normal * sine;
        let lifted = sine.abs() * if self.numbers.unit() < 0.5 { 1.0 } else { 1e-3 };
        let direction = (flat + hit.normal * lifted).normalize();
        ray(spawn_origin(hit, direction), direction)
    }

    /// A point near the relief: over a random place, at a height a little beyond its range at most.
    fn near_surface(&mut self) -> Vec3 {
        let (primitive, w) = self.place();
        self.point(primitive, w)
    }

    fn place(&mut self) -> (u32, Vec3) {
        (self.numbers.below(self.job.frame.triangle_count), self.numbers.barycentric())
    }

    fn point(&mut self, primitive: u32, w: Vec3) -> Vec3 {
        let displacement = &self.job.frame;
        let range = displacement.height_max - displacement.height_min;
        if self.job.features.displacement != displacement_kind::HEIGHT {
            // Vectors displace anywhere.
            return self.on_surface(primitive, w) + self.numbers.in_cube() * (0.05 * range);
        }
        let (p, normal) = self.base(primitive, w);
        p + normal * (displacement.height_min + range * self.numbers.between(-0.1, 1.1))
    }

    /// The point of the surface over barycentric coordinates `w`.
    fn on_surface(&self, primitive: u32, w: Vec3) -> Vec3 {
        let n = self.n_of(primitive);
        let scaled = w * n as f32;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and N - 1")]
        let (j, k) = {
            let j = (scaled.y as u32).min(n - 1);
            (j, (scaled.z as u32).min(n - 1 - j))
        };
        let (s, t) = (scaled.y - j as f32, scaled.z - k as f32);
        let upper = s + t > 1.0 && j + k + 2 <= n;
        let cell = Cell { j, k, upper };
        let points = [0, 1, 2].map(|e| {
            let (j, k) = cell.vertex(e);
            self.micro_vertex(primitive, j, k)
        });
        let weights =
            if upper { Vec3::new(s + t - 1.0, 1.0 - s, 1.0 - t) } else { Vec3::new(1.0 - s - t, s, t) };
        points[0] * weights.x + points[1] * weights.y + points[2] * weights.z
    }

    fn micro_vertex(&self, primitive: u32, j: u32, k: u32) -> Vec3 {
        let view = self.job.view();
        let field = HeightField::new(&view, self.job.features).of_triangle(&view, primitive, 0);
        BaseTriangle::load(&view, primitive).micro_vertex(&field, j, k)
    }

    /// N of a triangle.
    fn n_of(&self, primitive: u32) -> u32 {
        let view = self.job.view();
        HeightField::new(&view, self.job.features).of_triangle(&view, primitive, 0).subdivisions
    }

    /// Point and unit normal of the base mesh.
    fn base(&self, primitive: u32, w: Vec3) -> (Vec3, Vec3) {
        let [a, b, c] = self.corners(primitive);
        let p = a.position * w.x + b.position * w.y + c.position * w.z;
        (p, (a.normal * w.x + b.normal * w.y + c.normal * w.z).normalize_or(Vec3::Z))
    }

    fn corners(&self, primitive: u32) -> [Vertex; 3] {
        let buffers = &self.job.buffers;
        buffers.triangles[primitive as usize].vertices.map(|v| buffers.vertices[v as usize])
    }
}

/// Rays from within a closed surface, towards where it could leak.
pub struct LeakRays<'a> {
    view: SceneView<'a>,
    field: HeightField<'a>,
    inside: &'a [Vec3],
    seed: u64,
}

/// A micro-vertex on an edge of the base mesh.
#[derive(Clone, Copy)]
struct BorderVertex {
    /// As the kernels compute it.
    position: Vec3,
    /// The point nearest to it on the line that f64 arithmetic displaces it along.
    exact: DVec3,
}

impl<'a> LeakRays<'a> {
    /// Rays of those made as `seed` decides that are generated at a time.
    const CHUNK: usize = 1 << 12;

    /// Rays for the scene of `job` from some points, at least one.
    pub fn new(job: &'a ReadyJob, inside: &'a [Vec3], seed: u64) -> Self {
        let view = job.view();
        LeakRays { view, field: HeightField::new(&view, job.features), inside, seed }
    }

    /// Rays number `first` to `first + count`, made in parallel. They take edge after edge of the base mesh's
    /// triangles, so that 24 rays for each triangle (8 kinds for 3 edges) come to all.
    pub fn rays(&self, first: u64, count: usize) -> Vec<Ray> {
        (0..count.div_ceil(Self::CHUNK))
            .into_par_iter()
            .flat_map_iter(|chunk| {
                let start = chunk * Self::CHUNK;
                let mut numbers = Numbers::new(self.seed ^ (first + start as u64).wrapping_mul(0x9e37_79b9));
                let items = start..(start + Self::CHUNK).min(count);
                items.map(move |i| self.ray(first + i as u64, &mut numbers)).collect::<Vec<_>>()
            })
            .collect()
    }

    /// Ray number `i`.
    fn ray(&self, i: u64, numbers: &mut Numbers) -> Ray {
        let origin = self.inside[numbers.below(index(self.inside.len() as u64)) as usize];
        let edges = 3 * self.view.triangles.len() as u64;
        let edge = index(i / 8 % edges);
        let m = numbers.below(self.field(edge / 3).subdivisions);
        let along = f64::from(numbers.unit());
        let direction = match i % 8 {
            0 => numbers.direction().as_dvec3(),
            1 => axis_or_plane(numbers).as_dvec3(),
            // The base mesh: a vertex, and any point of an edge.
            2 => self.base_point(edge, 0.0) - origin.as_dvec3(),
            3 => self.base_point(edge, along) - origin.as_dvec3(),
            // The surface over an edge: micro-vertices by the kernels and in f64, points between two of them.
            4 => (self.border_vertex(edge, 0).position - origin).as_dvec3(),
            5 => (self.border_vertex(edge, m).position - origin).as_dvec3(),
            6 => self.border_vertex(edge, m).exact - origin.as_dvec3(),
            _ => {
                let [a, b] = [m, m + 1].map(|m| self.border_vertex(edge, m).position.as_dvec3());
                a + (b - a) * along - origin.as_dvec3()
            }
        };
        ray(origin, direction.as_vec3())
    }

    /// The heights over a triangle, as it is cut.
    fn field(&self, primitive: u32) -> HeightField<'a> {
        self.field.of_triangle(&self.view, primitive, 0)
    }

    /// The point of an edge of the base mesh that is a share `s` away from its start.
    fn base_point(&self, edge: u32, s: f64) -> DVec3 {
        let base = BaseTriangle::load(&self.view, edge / 3);
        let [a, b] = [1, 2].map(|e| base.position((edge + e) % 3).as_dvec3());
        a + (b - a) * s
    }

    /// Micro-vertex number `m`, 0 to N, on an edge.
    fn border_vertex(&self, edge: u32, m: u32) -> BorderVertex {
        let field = self.field(edge / 3);
        let n = field.subdivisions;
        let base = BaseTriangle::load(&self.view, edge / 3);
        let (j, k) = [(n - m, m), (0, n - m), (m, 0)][edge as usize % 3];
        let position = base.micro_vertex(&field, j, k);
        let w = field.weights(j, k).to_array().map(f64::from);
        let mixed = |v: [Vec3; 3]| (0..3).map(|e| v[e].as_dvec3() * w[e]).sum::<DVec3>();
        let mut directions = [base.n0, base.n1, base.n2];
        if base.seams != NO_SEAMS {
            directions = base.seams(&self.field).directions.map(Vec3::from_array);
        }
        let (start, direction) = (mixed([base.p0, base.p1, base.p2]), mixed(directions));
        let displaced = position.as_dvec3() - start;
        if self.field.is_vector() {
            // Along no line that is known beforehand.
            return BorderVertex { position, exact: position.as_dvec3() };
        }
        BorderVertex {
            position,
            exact: start + displaced.project_onto_normalized(direction.normalize_or_zero()),
        }
    }
}

/// Rays that have every reason to go wrong.
pub struct HardRays<'a> {
    view: SceneView<'a>,
    field: HeightField<'a>,
    numbers: Numbers,
    /// Half the diagonal of the box around the displaced model.
    radius: f32,
}

/// What makes a ray hard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hardship {
    /// It runs along the interpolated normal.
    AlongNormal,
    /// It runs through two micro-vertices of a grid line.
    AlongGridLine,
    /// It is aimed at a micro-vertex or the middle of a micro-edge.
    ThroughMicroVertex,
    /// It lies in the plane of a micro-triangle.
    InPlane,
    /// It starts on the base triangle.
    FromBase,
    /// It starts between base and greatest height.
    FromPrism,
    /// It starts at the least or the greatest height, and runs along it or anywhere.
    FromCap,
    /// It starts on a micro-triangle, on its border or at its corner.
    FromSurface,
    /// It comes to a micro-triangle at 0.01 degree.
    Grazing,
    /// Components of its direction are 0, or so small that floats have fewer digits for them.
    Axis,
}

impl Hardship {
    /// All of them.
    pub const ALL: [Hardship; 10] = [
        Hardship::AlongNormal,
        Hardship::AlongGridLine,
        Hardship::ThroughMicroVertex,
        Hardship::InPlane,
        Hardship::FromBase,
        Hardship::FromPrism,
        Hardship::FromCap,
        Hardship::FromSurface,
        Hardship::Grazing,
        Hardship::Axis,
    ];
}

impl<'a> HardRays<'a> {
    /// Rays for the scene of `job`, which is not empty, as `seed` decides.
    pub fn new(job: &'a ReadyJob, seed: u64) -> Self {
        let root = job.bounds();
        let view = job.view();
        let field = HeightField::new(&view, job.features);
        HardRays { view, field, numbers: Numbers::new(seed), radius: 0.5 * (root.max - root.min).length() }
    }

    /// A ray.
    pub fn ray(&mut self, hardship: Hardship) -> Ray {
        let base = BaseTriangle::load(&self.view, self.numbers.below(self.view.frame.triangle_count));
        let corners = self.micro_triangle(&base);
        let [a, b, c] = corners;
        let anywhere = self.numbers.direction();
        let distance = self.radius * self.numbers.between(0.0, 3.0);
        let w = self.numbers.barycentric();
        let point = interpolate(w, a, b, c);
        let (origin, direction) = match hardship {
            Hardship::AlongNormal => {
                let (p, n) = (interpolate(w, base.p0, base.p1, base.p2), self.normal(&base, w));
                let side = [0.0, 1.0, -1.0][self.numbers.below(3) as usize];
                (p + n * (side * distance), if self.numbers.unit() < 0.5 { n } else { -n })
            }
            Hardship::AlongGridLine => {
                let along = b - a;
                (a - along * self.numbers.between(0.0, 3.0), along)
            }
            Hardship::ThroughMicroVertex => {
                let target = [a, (a + b) * 0.5][self.numbers.below(2) as usize];
                let origin = target + anywhere * distance;
                (origin, target - origin)
            }
            Hardship::InPlane => {
                let along =
                    (b - a) * self.numbers.between(-1.0, 1.0) + (c - a) * self.numbers.between(-1.0, 1.0);
                (point - along * self.numbers.between(0.0, 5.0), along)
            }
            Hardship::FromBase => (interpolate(w, base.p0, base.p1, base.p2), anywhere),
            Hardship::FromPrism | Hardship::FromCap => {
                let s = self.numbers.unit();
                let on_cap = hardship == Hardship::FromCap;
                let s = if on_cap { s.round() } else { s };
                let height = base.height_min + (base.height_max - base.height_min) * s;
                let n = self.normal(&base, w);
                let level = on_cap && self.numbers.unit() < 0.5;
                let direction = if level { base.p1 - base.p0 } else { anywhere };
                (interpolate(w, base.p0, base.p1, base.p2) + n * height, direction)
            }
            Hardship::FromSurface => {
                let origin = [point, a, (a + b) * 0.5, a + (b - a) * w.x][self.numbers.below(4) as usize];
                let inside = (b - a) * w.y + (c - a) * w.z;
                (origin, if self.numbers.unit() < 0.7 { anywhere } else { inside })
            }
            Hardship::Grazing => {
                let normal = (b - a).cross(c - a).normalize_or(anywhere);
                let along = normal.cross(anywhere).normalize_or(anywhere);
                let direction = along - normal * 0.01_f32.to_radians();
                (point - direction * distance, direction)
            }
            Hardship::Axis => {
                // One component is left as it is: in lengths of a direction that is all but zero, distances overflow.
                let mut direction = anywhere;
                let kept = self.numbers.below(3) as usize;
                for axis in [kept + 1, kept + 2] {
                    direction[axis % 3] *= [1.0, 0.0, -0.0, 1e-40, 1e-30][self.numbers.below(5) as usize];
                }
                let target = [point, a][self.numbers.below(2) as usize];
                (target - direction.normalize_or(anywhere) * distance, direction)
            }
        };
        // Where a triangle has no extent there is no line to run along.
        let usable = direction.is_finite() && direction != Vec3::ZERO;
        ray(origin, if usable { direction } else { anywhere })
    }

    /// The corners of a micro-triangle, in any order.
    fn micro_triangle(&mut self, base: &BaseTriangle) -> [Vec3; 3] {
        let field = self.field.of_triangle(&self.view, base.primitive, 0);
        let n = field.subdivisions;
        let j = self.numbers.below(n);
        let k = self.numbers.below(n - j);
        let upper = j + k + 2 <= n && self.numbers.unit() < 0.5;
        let corners = base.micro_triangle(&field, Cell { j, k, upper });
        let first = self.numbers.below(3) as usize;
        [0, 1, 2].map(|e| corners[(first + e) % 3])
    }

    /// The unit normal at barycentric coordinates; any where there is none.
    fn normal(&mut self, base: &BaseTriangle, w: Vec3) -> Vec3 {
        interpolate(w, base.n0, base.n1, base.n2).normalize_or(self.numbers.direction())
    }
}

/// A number of points or edges; scenes of tests are small.
fn index(i: u64) -> u32 {
    u32::try_from(i).expect("fewer than 2^32")
}

/// A direction along an axis, or across one.
fn axis_or_plane(numbers: &mut Numbers) -> Vec3 {
    let mut direction = numbers.direction();
    let axis = numbers.below(3) as usize;
    if numbers.unit() < 0.5 {
        direction[axis] = 0.0;
        return direction;
    }
    Vec3::AXES[axis] * direction[axis].signum()
}

/// Where the program lets a ray start that leaves a hit.
fn spawn_origin(hit: &Intersection, direction: Vec3) -> Vec3 {
    let Intersection { point, point_error, normal, u, v, .. } = *hit;
    let surface = SurfaceInteraction {
        point,
        inner_point: point,
        point_error,
        ng: normal,
        ns: normal,
        base: SmoothBase::default(),
        uv: Vec2::new(u, v),
        material: 0,
        uv_density: 0.0,
        height: 0.0,
        offset: 0.0,
    };
    surface.spawn_origin(direction)
}

fn ray(origin: Vec3, direction: Vec3) -> Ray {
    Ray { origin, t_max: f32::INFINITY, direction, padding: 0 }
}

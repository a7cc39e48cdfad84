//! Instances: a mesh that stands in several places, each under a transform of its own, stored once.
//!
//! A ray is taken into the space of an instance's mesh, its *object space*, and traced there as in a scene of that mesh
//! alone: all of the mesh's triangles meet the same ray, so that what holds of one mesh (no cracks, the nearest hit)
//! holds of it in its place. What rounding adds is where the ray runs: see [`MARGIN`] and [`Instance::point_error`].
//!
//! Below, W and O are the matrices of `world_from_object` and `object_from_world`, T and T' their translations, |M| a
//! matrix of magnitudes, u the unit roundoff. The host gives O as the inverse of W, rounded once, and keeps to
//! [`Instance::MOST_SHEAR`].

use crate::hit::Hit;
use crate::interface::{Instance, MISS, Ray};
use crate::math::{fma, gamma, max_abs, unit};
use crate::ray::TraversalRay;
use glam::Vec3;

/// By how much rounding can move a ray in the world when it is taken into object space, relative to the greatest
/// coordinate of its origin, of the instance's box and of the instance's translation.
///
/// The origin in object space is off by 6 u (|O||o| + |T'|): four products and sums, fused or not. The direction is by
/// 16 u |O||d|: products and sums (6 u), then a quotient (5 u, Vulkan's; by what length it is divided changes no line,
/// and distances are taken back by the same). In the world, times
/// |W|, that is 6 u s |o| and 16 u s t, s = [`MOST_SHEAR`](Instance::MOST_SHEAR), t the distance of what is hit, at
/// most sqrt(3) (|o| + |box|): 34 u s = 136 u in all. What is left covers the rounding of t (4 u), of the products here
/// and of the ray/triangle test, 6 u of the distance.
pub const MARGIN: f32 = gamma(160);

impl Instance {
    /// The greatest row sum of |W||O| that the host accepts. It is at most 3 where a mesh is scaled along its axes,
    /// then turned and moved; transforms that shear a mesh to a sliver have more.
    pub const MOST_SHEAR: f64 = 4.0;

    /// A point of object space in the world, off by 4 u (|W||p| + |T|).
    #[inline]
    pub fn world_point(&self, p: Vec3) -> Vec3 {
        point(&self.world_from_object, p)
    }

    /// A vector of object space in the world.
    #[inline]
    pub fn world_vector(&self, v: Vec3) -> Vec3 {
        vector(&self.world_from_object, v)
    }

    /// A point of the world in object space.
    #[inline]
    pub fn object_point(&self, p: Vec3) -> Vec3 {
        point(&self.object_from_world, p)
    }

    /// A vector of the world in object space.
    #[inline]
    pub fn object_vector(&self, v: Vec3) -> Vec3 {
        vector(&self.object_from_world, v)
    }

    /// A direction at right angles to a surface, as a unit vector in the world: by the inverse's transpose, so that it
    /// stays on its side of the surface in a mirror too. NaN where it is zero.
    #[inline]
    pub fn world_normal(&self, n: Vec3) -> Vec3 {
        unit(transposed(&self.object_from_world, n))
    }

    /// A bound on the error of each coordinate in the world of a point `p` of object space, whose own is bounded by
    /// `error` there. It is so wide that a ray from outside of it, taken back into object space, starts outside too.
    ///
    /// Let n be a plane's unit normal in object space, v = O^T n, and the ray start at the world point plus K v / |v|,
    /// K |v| = |v|·E, E the bound given here. There and back, with the sum and its last rounding, a point is off by
    /// (4 + 1 + 2) u |O| a, a = |W||p| + |T|, on the way there; by 4 u (|O| a + |T'|) on the way back, |T'| <= |O||T|;
    /// and by 3 u |O| a since O is rounded: 32 u |O| a leaves room for second orders. Along n the ray's start has moved
    /// by |v|·E; since n = W^T v up to rounding, |n| <= |W|^T |v|, so that E = |W| (error + 32 u |O| a) is enough. What
    /// rounding makes of the move itself and of its direction is relative to it, at most 30 u times the greatest of
    /// |O|^T |n| / |v|, below 3 where a mesh is scaled, turned and moved.
    #[inline]
    pub fn point_error(&self, p: Vec3, error: Vec3) -> Vec3 {
        let (w, o) = (magnitudes(self.world_from_object), magnitudes(self.object_from_world));
        let there_and_back = vector(&o, point(&w, p.abs())) * gamma(32);
        vector(&w, error + there_and_back) * (1.0 + gamma(256))
    }

    /// A direction at right angles to a surface of the world as a vector in object space: what
    /// [`world_normal`](Self::world_normal) takes there.
    #[inline]
    pub fn object_normal(&self, n: Vec3) -> Vec3 {
        transposed(&self.world_from_object, n)
    }

    /// A ray of the world in object space, up to the distance `t_max` of the world, and the length of a unit of its
    /// distances there. `index` is the instance's own.
    #[inline]
    pub fn object_ray(&self, ray: &TraversalRay, t_max: f32, index: u32) -> (TraversalRay, f32) {
        let (object_ray, stretch) = TraversalRay::from_ray(Ray {
            origin: self.object_point(ray.origin),
            t_max,
            direction: self.object_vector(ray.direction),
            padding: 0,
        });
        let left_primitive = if ray.left_instance == index { ray.left_primitive } else { MISS };
        let left_cell = ray.left_cell;
        // Whatever instance it leaves: this one may stand in the same plane.
        let (mut left_normal, mut left_reach) = (ray.left_normal, ray.left_reach);
        if left_reach >= 0.0 {
            left_normal = unit(self.object_normal(left_normal));
            left_reach = max_abs(point(&magnitudes(self.object_from_world), ray.origin.abs()));
        }
        (TraversalRay { left_primitive, left_cell, left_normal, left_reach, ..object_ray }, stretch.length())
    }
}

/// Where a traversal is.
#[derive(Clone, Copy)]
pub struct Place {
    /// Whether that is an instance's mesh. The other fields are 0 where it is the tree over the instances or there are
    /// none.
    pub inside: bool,
    /// The root of the mesh's tree. Nodes count from there on.
    pub first_node: u32,
    /// The first triangle of the mesh, and the first entry of its leaves' order. Both count from there on.
    pub first_triangle: u32,
    /// The index of the instance.
    pub instance: u32,
    /// The length of a unit of the world's distances.
    length: f32,
    /// What was nearest in the world.
    nearest: Hit,
}

impl Place {
    /// In the world.
    pub const WORLD: Place = Place {
        inside: false,
        first_node: 0,
        first_triangle: 0,
        instance: 0,
        length: 1.0,
        nearest: Hit::NONE,
    };

    /// In instance number `index`. `nearest` is the nearest hit so far, `length` what
    /// [`object_ray`](Instance::object_ray) gave.
    #[inline]
    pub fn inside(instance: &Instance, index: u32, length: f32, nearest: Hit) -> Place {
        Place {
            inside: true,
            first_node: instance.first_node,
            first_triangle: instance.first_triangle,
            instance: index,
            length,
            nearest,
        }
    }

    /// The nearest hit in the world, once `nearest` is the nearest one here.
    ///
    /// Distances are compared in the world alone, so that of equally near hits of several instances the lowest instance
    /// wins, whichever was entered first.
    #[inline]
    pub fn nearest_in_world(&self, nearest: Hit) -> Hit {
        if nearest.is_some() {
            self.nearest.nearer(Hit { t: nearest.t / self.length, instance: self.instance, ..nearest })
        } else {
            self.nearest
        }
    }
}

/// The margin of boxes of instances for a ray from `origin`.
#[inline]
pub fn ray_margin(origin: Vec3) -> f32 {
    MARGIN * max_abs(origin)
}

#[inline]
fn point(rows: &[[f32; 4]; 3], p: Vec3) -> Vec3 {
    let [a, b, c] = *rows;
    let row = |r: [f32; 4]| fma(r[2], p.z, fma(r[1], p.y, fma(r[0], p.x, r[3])));
    Vec3::new(row(a), row(b), row(c))
}

#[inline]
fn vector(rows: &[[f32; 4]; 3], v: Vec3) -> Vec3 {
    let [a, b, c] = *rows;
    let row = |r: [f32; 4]| fma(r[2], v.z, fma(r[1], v.y, r[0] * v.x));
    Vec3::new(row(a), row(b), row(c))
}

/// The product of the transposed matrix.
#[inline]
fn transposed(rows: &[[f32; 4]; 3], v: Vec3) -> Vec3 {
    let [a, b, c] = *rows;
    let column = |x: f32, y: f32, z: f32| fma(z, v.z, fma(y, v.y, x * v.x));
    Vec3::new(column(a[0], b[0], c[0]), column(a[1], b[1], c[1]), column(a[2], b[2], c[2]))
}

#[inline]
fn magnitudes(rows: [[f32; 4]; 3]) -> [[f32; 4]; 3] {
    let [a, b, c] = rows;
    let row = |r: [f32; 4]| [r[0].abs(), r[1].abs(), r[2].abs(), r[3].abs()];
    [row(a), row(b), row(c)]
}

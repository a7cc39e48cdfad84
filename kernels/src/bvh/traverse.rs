//! Traversal of the binary BVH.

use crate::aabb::Aabb;
use crate::counters::Counts;
use crate::displacement::surface::{BaseTriangle, HeightField};
use crate::displacement::{brute_force, grid_walk, inverse, quadtree, tessellate};
use crate::hit::Hit;
use crate::instance::{Place, ray_margin};
use crate::interface::{BvhNode, MAX_BVH_DEPTH, method};
use crate::math::{at, gamma};
use crate::ray::TraversalRay;
use crate::scene::{Features, SceneView};
use crate::triangle;

/// What a traversal looks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Query {
    /// The nearest hit.
    Nearest,
    /// Any hit: the first one found ends the search.
    Any,
}

/// A hit of the ray, or [`Hit::NONE`].
///
/// Depth first, nearer child first, with a stack of one entry a level: builders keep [`MAX_BVH_DEPTH`]. Of equally
/// near hits the lower (instance, triangle, cell) wins, whatever the trees.
///
/// With instances the tree over them comes first. At a leaf of it the ray is taken into the instance's mesh, whose tree
/// has the stack to itself, until that is empty: then the traversal goes on in the world.
#[inline]
pub fn traverse(
    scene: &SceneView<'_>,
    features: Features,
    world_ray: &TraversalRay,
    query: Query,
    counts: &mut Counts,
) -> Hit {
    let field = HeightField::new(scene, features);
    let mut nearest = Hit::NONE;
    if scene.frame.triangle_count == 0 {
        return nearest;
    }
    let instanced = features.instances != 0;
    let mut place = Place::WORLD;
    let mut ray = *world_ray;
    let tessellated = features.method == method::TESSELLATE;
    let has_margin = instanced || tessellated;
    let margin = if tessellated {
        tessellate::ray_margin(world_ray.origin)
    } else if instanced {
        ray_margin(world_ray.origin)
    } else {
        0.0
    };
    let mut stack = [0u32; MAX_BVH_DEPTH as usize];
    let mut stack_distances = [0.0f32; MAX_BVH_DEPTH as usize];
    let mut depth = 0;
    // Those of the tree over instances.
    let mut world_stack = [0u32; MAX_BVH_DEPTH as usize];
    let mut world_distances = [0.0f32; MAX_BVH_DEPTH as usize];
    let mut world_depth = 0;
    let mut node = at(scene.nodes, 0);
    let mut distance = node.entry_distance(&ray, ray.t_max, has_margin, margin);
    counts.boxes += 1;
    // Each node is visited once at most (that of a mesh once an instance). Two loops, one to the next leaf and one over
    // leaves, so that the rays of a subgroup test prisms together: with one loop each leaf of one ray would keep the others
    // waiting (Aila and Laine, "Understanding the Efficiency of Ray Traversal on GPUs", HPG 2009).
    let mut going = true;
    while going {
        let mut at_leaf = false;
        while going && !at_leaf {
            let mut pop = true;
            let in_world = instanced && !place.inside;
            if distance <= farthest(&ray, nearest) && distance.is_finite() {
                if node.count > 0 {
                    pop = false;
                    if in_world {
                        let index = node.first;
                        let instance = at(scene.instances, index);
                        let (object_ray, length) =
                            instance.object_ray(world_ray, farthest(world_ray, nearest), index);
                        place = Place::inside(&instance, index, length, nearest);
                        nearest = Hit::NONE;
                        ray = object_ray;
                        node = at(scene.nodes, place.first_node);
                        // Its box was that of the leaf.
                        distance = 0.0;
                    } else {
                        at_leaf = true;
                    }
                } else {
                    // Go to the nearer child, keep the other for later.
                    // A branch of a constant where there are no instances.
                    let first = if instanced { place.first_node + node.first } else { node.first };
                    let (left, right) = (at(scene.nodes, first), at(scene.nodes, first + 1));
                    let limit = farthest(&ray, nearest);
                    let margin = if in_world || tessellated { margin } else { 0.0 };
                    let (to_left, to_right) = (
                        left.entry_distance(&ray, limit, has_margin, margin),
                        right.entry_distance(&ray, limit, has_margin, margin),
                    );
                    counts.boxes += 2;
                    let left_first = to_left <= to_right;
                    let (near, far) = if left_first { (to_left, to_right) } else { (to_right, to_left) };
                    if far.is_finite() {
                        let later = first + left_first as u32;
                        if in_world {
                            world_stack[world_depth as usize] = later;
                            world_distances[world_depth as usize] = far;
                            world_depth += 1;
                        } else {
                            stack[depth as usize] = later;
                            stack_distances[depth as usize] = far;
                            depth += 1;
                        }
                    }
                    if near.is_finite() {
                        node = if left_first { left } else { right };
                        distance = near;
                        pop = false;
                    }
                }
            }
            if pop {
                going = depth > 0;
                if going {
                    depth -= 1;
                    distance = stack_distances[depth as usize];
                    node = at(scene.nodes, stack[depth as usize]);
                } else if instanced {
                    if place.inside {
                        nearest = place.nearest_in_world(nearest);
                        place = Place::WORLD;
                        ray = *world_ray;
                    }
                    going = world_depth > 0;
                    if going {
                        world_depth -= 1;
                        distance = world_distances[world_depth as usize];
                        node = at(scene.nodes, world_stack[world_depth as usize]);
                    }
                }
            }
        }
        if at_leaf {
            let mut i = 0;
            while i < node.count {
                let first = if instanced { place.first_triangle } else { 0 };
                let primitive = first + at(scene.primitives, first + node.first + i);
                nearest = intersect_primitive(
                    scene,
                    features,
                    &field,
                    &ray,
                    query,
                    primitive,
                    place.instance,
                    nearest,
                    counts,
                );
                i += 1;
            }
            // What is left is popped above.
            distance = f32::INFINITY;
            going = !(query == Query::Any && nearest.is_some());
        }
    }
    // Any hit ends the search where it is.
    if instanced && place.inside { place.nearest_in_world(nearest) } else { nearest }
}

/// Beyond this distance a box can hold no hit that counts: hits at equal distances must all be found, and a hit's
/// computed distance can fall short of its box's by the rounding of both.
#[inline]
fn farthest(ray: &TraversalRay, nearest: Hit) -> f32 {
    ray.t_max.min(nearest.t * (1.0 + 4.0 * gamma(12)))
}

impl BvhNode {
    /// See [`Aabb::entry_distance`]; the box is grown by `margin` where it `has_margin`.
    #[inline]
    fn entry_distance(&self, ray: &TraversalRay, t_max: f32, has_margin: bool, margin: f32) -> f32 {
        let bounds = Aabb { min: self.min, max: self.max };
        let bounds = if has_margin { bounds.padded(margin) } else { bounds };
        bounds.entry_distance(ray, t_max)
    }
}

/// The nearer of `nearest` and the ray's hits on one base triangle, in the space of instance number `instance`, by the method that the features name.
#[inline]
#[expect(clippy::too_many_arguments, reason = "the scene, the ray, the query and what it found so far")]
fn intersect_primitive(
    scene: &SceneView<'_>,
    features: Features,
    field: &HeightField<'_>,
    ray: &TraversalRay,
    query: Query,
    primitive: u32,
    instance: u32,
    nearest: Hit,
    counts: &mut Counts,
) -> Hit {
    if features.method == method::TESSELLATE {
        counts.triangles += 1;
        return tessellate::intersect(scene, ray, primitive, nearest);
    }
    let field = &field.of_triangle(scene, primitive, instance);
    if features.method == method::QUADTREE {
        return quadtree::intersect(scene, field, primitive, ray, nearest, query == Query::Any, counts);
    }
    let base = BaseTriangle::load(scene, primitive);
    if features.method == method::GRID_WALK {
        grid_walk::intersect(field, &base, ray, nearest, counts)
    } else if features.method == method::INVERSE {
        inverse::intersect(field, &base, ray, nearest, counts)
    } else if features.method == method::BRUTE_FORCE {
        counts.prisms += 1;
        brute_force::intersect(field, &base, ray, nearest, counts)
    } else {
        counts.triangles += 1;
        let hit = triangle::intersect(ray, base.p0, base.p1, base.p2, ray.t_max);
        if hit.t.is_finite() && primitive != ray.left_primitive {
            nearest.nearer(Hit { t: hit.t, primitive, b1: hit.b1, b2: hit.b2, ..Hit::NONE })
        } else {
            nearest
        }
    }
}

//! Traversal of the binary BVH.

use crate::aabb::Aabb;
pub use crate::bvh::query::Query;
use crate::bvh::query::farthest;
use crate::counters::Counts;
use crate::displacement::quadtree::Descent;
use crate::displacement::surface::{BaseTriangle, HeightField};
use crate::displacement::{brute_force, grid_walk, inverse, tessellate};
use crate::hit::Hit;
use crate::instance::{Place, ray_margin};
use crate::interface::{BvhNode, MAX_BVH_DEPTH, bounds, method};
use crate::math::{at, scratch};
use crate::prism_tree;
use crate::ray::TraversalRay;
use crate::scene::{Features, SceneView};
use crate::triangle;

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
    ray: &TraversalRay,
    query: Query,
    counts: &mut Counts,
) -> Hit {
    if features.bounds != bounds::NONE && features.method == method::QUADTREE {
        prism_tree::traverse::traverse(scene, features, ray, query, counts)
    } else {
        traverse_binary(scene, features, ray, query, counts)
    }
}

/// The same where no tree is stored.
#[inline]
fn traverse_binary(
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
    let mut stack: [u32; MAX_BVH_DEPTH as usize] = scratch();
    let mut stack_distances: [f32; MAX_BVH_DEPTH as usize] = scratch();
    let mut depth = 0;
    // Those of the tree over instances.
    let mut world_stack: [u32; MAX_BVH_DEPTH as usize] = scratch();
    let mut world_distances: [f32; MAX_BVH_DEPTH as usize] = scratch();
    let mut world_depth = 0;
    // The node to be visited next. Its contents would take registers while prisms are tested.
    let mut next_node = 0;
    let mut distance = at(scene.nodes, 0).entry_distance(&ray, ray.t_max, has_margin, margin);
    counts.boxes += 1;
    // The leaf at hand: its next entry, and how many are left.
    let mut entry = 0;
    let mut entries_left = 0;
    let by_quadtree = features.method == method::QUADTREE;
    let mut descent = Descent::DONE;
    let any = query == Query::Any;
    // Each node is visited once at most (that of a mesh once an instance). A loop to the next leaf of its own, so that
    // the rays of a subgroup test prisms together: without it each leaf of one ray would keep the others waiting (Aila
    // and Laine, "Understanding the Efficiency of Ray Traversal on GPUs", HPG 2009). Within quadtrees rays go a few
    // nodes at a time: else they would wait at each prism for the one that has the most to do in its own.
    let mut going = true;
    while going {
        let idle = descent.is_done();
        let mut searching = idle;
        while searching && entries_left == 0 {
            let mut pop = true;
            let in_world = instanced && !place.inside;
            if distance <= farthest(&ray, nearest) && distance.is_finite() {
                let node = at(scene.nodes, next_node);
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
                        next_node = place.first_node;
                        // Its box was that of the leaf.
                        distance = 0.0;
                    } else {
                        (entry, entries_left) = (node.first, node.count);
                        // What is left is popped.
                        distance = f32::INFINITY;
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
                        next_node = first + !left_first as u32;
                        distance = near;
                        pop = false;
                    }
                }
            }
            if pop {
                searching = depth > 0;
                if searching {
                    depth -= 1;
                    distance = stack_distances[depth as usize];
                    next_node = stack[depth as usize];
                } else if instanced {
                    if place.inside {
                        nearest = place.nearest_in_world(nearest);
                        place = Place::WORLD;
                        ray = *world_ray;
                    }
                    searching = world_depth > 0;
                    if searching {
                        world_depth -= 1;
                        distance = world_distances[world_depth as usize];
                        next_node = world_stack[world_depth as usize];
                    }
                }
            }
        }
        if idle && entries_left > 0 {
            let first = if instanced { place.first_triangle } else { 0 };
            let primitive = first + at(scene.primitives, first + entry);
            entry += 1;
            entries_left -= 1;
            if by_quadtree {
                counts.prisms += 1;
                let field = field.of_triangle(scene, primitive, place.instance);
                descent = Descent::new(&field, &BaseTriangle::load(scene, primitive), &ray);
            } else {
                nearest = intersect_primitive(
                    scene,
                    features,
                    &field,
                    &ray,
                    primitive,
                    place.instance,
                    nearest,
                    counts,
                );
            }
        }
        if by_quadtree {
            let field = field.of_cut_triangle(scene, descent.cut(), place.instance);
            nearest = descent.advance(scene, &field, &ray, nearest, any, counts);
        }
        going = (!idle || searching) && !(any && nearest.is_some());
    }
    // Any hit ends the search where it is.
    if instanced && place.inside { place.nearest_in_world(nearest) } else { nearest }
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

/// The nearer of `nearest` and the ray's hits on one base triangle, in the space of instance number `instance`, by the
/// method that the features name.
#[inline]
#[expect(clippy::too_many_arguments, reason = "the scene, the ray and what it found so far")]
fn intersect_primitive(
    scene: &SceneView<'_>,
    features: Features,
    field: &HeightField<'_>,
    ray: &TraversalRay,
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

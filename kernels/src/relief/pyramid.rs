//! Pyramidal displacement mapping: Oh, Ki and Lee, "Pyramidal Displacement Mapping: A GPU based Artifacts-free Ray
//! Tracing Through an Image Pyramid", VRST 2006.
//!
//! From the pyramid's top the ray goes to whichever is nearer of its cell's border and the least height, as seen from
//! the ray's side, that bounds the relief in the cell: in the first case on to the next cell, and a level up where
//! that is another one's; in the second down to the cell's quarters. In the lowest cells, between four texels, the
//! relief is a bilinear patch, which the ray meets where a quadratic equation has its first root.
//!
//! Cost: some two readings of the pyramid (4 to 9 words each) for each of its levels where the relief is smooth, and
//! three readings of the map for each lowest cell. A ray visits at most N cells for each level.
//!
//! What the paper has trouble with. It descends and never comes up again, so that rays that graze visit all texels:
//! here they rise at each border of a cell above. It takes texels for flat, and so shows steps, or interpolates
//! between hits: here patches are solved. Its rays stop at a fixed number of steps, as these do: one that is not done
//! by then shows a place in front of the relief. Silhouettes are the base mesh's. With `--filter trilinear` cells of
//! a coarser level overlap those of the map, and hits are off by what a patch bends in them. The pyramid is the
//! quadtree's, whose entries overlap: bounds are a little wider than the paper's, and hold at all wraps and sizes.

use super::tangent_space::{Span, TangentRay, TangentSpace};
use crate::math::{clamp, floor, sqrt};
use glam::Vec2;

/// Texel coordinates beyond this are not followed: whole numbers and halves are no longer told apart there.
const FARTHEST: f32 = 4_194_304.0;

/// The distance at which the ray meets the relief in `span`; where it comes to its end first, that.
#[inline]
pub fn search(space: &TangentSpace<'_>, ray: &TangentRay, span: Span, n: u32) -> f32 {
    let top = space.top_level();
    let (start, rate) = ray.texels(space, span.near);
    let length = span.far - span.near;
    let first = Vec2::new(clamp(start.x, -FARTHEST, FARTHEST), clamp(start.y, -FARTHEST, FARTHEST));
    let mut level = top;
    let (mut x, mut y) = (floor(first.x) as i32 >> top, floor(first.y) as i32 >> top);
    // Distances count from where the span begins.
    let mut t = 0.0;
    let mut steps = n * (top + 1);
    let mut going = true;
    while going && steps > 0 {
        steps -= 1;
        let size = (1 << level) as f32;
        let low = Vec2::new(x as f32, y as f32) * size;
        let high = low + Vec2::splat(size);
        let across = exit(start.x, rate.x, low.x, high.x);
        let along = exit(start.y, rate.y, low.y, high.y);
        let end = across.min(along).min(length).max(t);
        let stays;
        if level == 0 {
            let share = first_root(space, ray, span.near + t, end - t);
            stays = share <= 1.0;
            going = !stays;
            if stays {
                t += share * (end - t);
            }
        } else {
            let plane = ray.time_to(space.heights_between(low, high), span.near);
            stays = plane < end;
            if stays {
                t = t.max(plane);
                level -= 1;
                let at = start + rate * t;
                let half = 0.5 * size;
                x = (floor(at.x / half) as i32).clamp(2 * x, 2 * x + 1);
                y = (floor(at.y / half) as i32).clamp(2 * y, 2 * y + 1);
            }
        }
        if !stays {
            t = end;
            going = end < length;
            let (parent_x, parent_y) = (x >> 1, y >> 1);
            if across <= along {
                x += if rate.x < 0.0 { -1 } else { 1 };
            } else {
                y += if rate.y < 0.0 { -1 } else { 1 };
            }
            if level < top && (parent_x != x >> 1 || parent_y != y >> 1) {
                level += 1;
                x >>= 1;
                y >>= 1;
            }
        }
    }
    span.near + t
}

/// When a coordinate leaves the interval from `low` to `high`; never where it stays.
#[inline]
fn exit(start: f32, rate: f32, low: f32, high: f32) -> f32 {
    if rate > 0.0 {
        (high - start) / rate
    } else if rate < 0.0 {
        (low - start) / rate
    } else {
        f32::INFINITY
    }
}

/// At which share of the distances from `near` to `near` + `length`, all in one lowest cell, the ray is first not
/// outside the relief; above 1 where it is outside all along.
///
/// Along the ray a bilinear patch is quadratic: c + b s + a s², which three values tell.
#[inline]
fn first_root(space: &TangentSpace<'_>, ray: &TangentRay, near: f32, length: f32) -> f32 {
    let mut values = [0.0f32; 3];
    let mut i = 0;
    while i < 3 {
        values[i] = ray.clearance(space, near + length * (0.5 * i as f32));
        i += 1;
    }
    let [c, middle, end] = values;
    let a = 2.0 * (c + end - 2.0 * middle);
    let b = 4.0 * middle - 3.0 * c - end;
    let discriminant = b * b - 4.0 * a * c;
    // Both roots without cancellation; where there are none they are NaN, and not less than anything.
    let q = -0.5 * (b + if b < 0.0 { -sqrt(discriminant) } else { sqrt(discriminant) });
    let (r1, r2) = (q / a, c / q);
    let mut root = if end <= 0.0 { 1.0 } else { 2.0 };
    if discriminant >= 0.0 && r1 >= 0.0 && r1 < root {
        root = r1;
    }
    if discriminant >= 0.0 && r2 >= 0.0 && r2 < root {
        root = r2;
    }
    if c <= 0.0 { 0.0 } else { root }
}

#[cfg(test)]
mod tests {
    use crate::interface::method;
    use crate::relief::test_ramp::{assert_on_ray, exact, found, ramp, rays, with_pyramid};

    /// A slope is met where it is, whatever N allows for more than the descent.
    #[test]
    fn finds_a_slope() {
        let scene = with_pyramid(ramp(16));
        for ray in rays() {
            let hit = found(&scene, method::PYRAMID, &ray);
            // Distances of 4 at most, some ten roundings, in a slope of at most 60 degrees.
            assert!((f64::from(hit.t) - exact(&ray)).abs() < 4e-6, "{hit:?} {}", exact(&ray));
            assert_on_ray(&hit, &ray);
        }
    }
}

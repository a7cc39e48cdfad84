//! Per-pixel displacement mapping with distance functions: Donnelly, GPU Gems 2, chapter 8, 2005. The ray goes on by
//! as much as a [map of distances](super::distance_map) says is free, at most N times: Hart's sphere tracing in
//! texture space.
//!
//! Cost: up to N readings of the distance map and as many of the height map a ray, ten more of the latter at its end;
//! 272 KiB a map, computed once and kept in a file beside it, and computed again when its scale changes sign.
//!
//! Artefacts. A ray that is not done after N steps shows a place in front of the relief; along a crest rays take
//! many. Where the distance is 0, next to the columns that the relief is taken for, a step is an eighth of a cell,
//! 1/512 of the map: what is thinner along the ray may be missed. Silhouettes are the base mesh's. Deviations: the
//! paper looks at distances alone, and stays a part of a cell off the relief; here each step asks the height map
//! whether the ray is still outside, and the place is then cut out by bisection, so that it is the relief's own.
//! Distances are not filtered, which could make them too large. Rays from below the relief, of which the map tells
//! nothing, go through N layers, and so do those to lights. With `--filter trilinear` distances are those of the
//! finest level: crests that stand out by up to half a pixel more may be passed.

use super::distance_map::{DEPTH, SIDE, distance_at};
use super::tangent_space::{Span, TangentRay, TangentSpace};
use crate::math::sqrt;

/// The least step in cells.
const LEAST_STEP: f32 = 0.125;
/// Bisections: 1/256 of a step.
const BISECTIONS: u32 = 8;

/// The distance at which the ray meets the relief in `span`, by `distances`.
#[inline]
pub fn search(distances: &[f32], space: &TangentSpace<'_>, ray: &TangentRay, span: Span, n: u32) -> f32 {
    let (low, high) = space.heights();
    let is_flat = !(high > low);
    let from_above = ray.climb() < 0.0;
    let (start, rate) = ray.cells(SIDE as f32, low, DEPTH as f32 / (high - low));
    let speed = sqrt(rate.x * rate.x + rate.y * rate.y + rate.z * rate.z);
    let (map, mode) = space.map();
    let mut before = span.near;
    let mut t = span.near;
    let mut i = 0;
    let mut outside = !is_flat;
    // The last step is a look alone.
    while outside && i <= n {
        outside = ray.clearance(space, t) > 0.0;
        if outside && i < n {
            let free = if from_above { distance_at(distances, map, mode, start + rate * t) } else { 0.0 };
            let layer = (span.far - span.near) / n as f32;
            before = t;
            t += if from_above { free.max(LEAST_STEP) / speed } else { layer };
            t = t.min(span.far);
        }
        i += 1;
    }
    // Outside still: it is not done. Else cut.
    let mut cuts = if outside || is_flat { BISECTIONS } else { 0 };
    while cuts < BISECTIONS {
        let middle = 0.5 * (before + t);
        if ray.clearance(space, middle) > 0.0 {
            before = middle;
        } else {
            t = middle;
        }
        cuts += 1;
    }
    t
}

#[cfg(test)]
mod tests {
    use crate::displacement::surface::HeightField;
    use crate::interface::method;
    use crate::relief::distance_map::{CELLS, COLUMNS, WORDS, column, distance};
    use crate::relief::test_ramp::{assert_on_ray, exact, found, ramp, rays, with_pyramid};
    use crate::test_scene::{FLAT, TestScene};

    fn with_distances(mut scene: TestScene) -> TestScene {
        let mut distances = vec![0.0; WORDS as usize];
        let view = scene.view();
        let field = HeightField::new(&view, FLAT);
        let pyramid = field.pyramid(field.displacement(0));
        for i in 0..COLUMNS {
            distances[i as usize] = column(&pyramid, i);
        }
        for i in 0..CELLS {
            distances[(COLUMNS + i) as usize] = distance(&distances, 0, FLAT.height_wrap, i);
        }
        scene.distances = distances;
        scene
    }

    /// A slope is met where it is, but for what eight bisections leave of a step.
    #[test]
    fn finds_a_slope() {
        // Its map has one row, of which columns are as high as its greatest texel: all steps are the least ones.
        let scene = with_distances(with_pyramid(ramp(400)));
        for ray in rays() {
            let hit = found(&scene, method::SPHERE, &ray);
            let off = (f64::from(hit.t) - exact(&ray)).abs();
            // At most 16 cells along the square, half its side, from above; 1/400 of the way through the slope from
            // below.
            assert!(off < 1.0 / 256.0, "{off} {hit:?}");
            assert_on_ray(&hit, &ray);
        }
    }
}

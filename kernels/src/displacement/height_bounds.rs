//! Bounds on the heights over a base triangle: what makes prisms and boxes tight.

use crate::displacement::surface::HeightField;
use crate::interface::{Displacement, Triangle, Vertex, wrap};
use crate::math::{at, floor};
use glam::Vec2;

/// Footprints of more texels than this take the whole map's range instead, so that a mesh of N triangles is bounded in
/// at most N times this many reads. Triangles that large have prisms that a tighter range would hardly shrink.
const MOST_TEXELS: f32 = 16_384.0;

/// Bounds on the height of every micro-vertex of `triangle`, whatever N is: the range of the texels in the box of its
/// texture coordinates, bilinear support included, rounded outward by [`Displacement::height_range`].
pub fn height_bounds(field: &HeightField<'_>, vertices: &[Vertex], triangle: Triangle) -> (f32, f32) {
    let d = field.displacement;
    let corner = |i: u32| {
        let vertex = at(vertices, i);
        Vec2::new(vertex.u, vertex.v)
    };
    let (a, b, c) =
        (corner(triangle.vertices[0]), corner(triangle.vertices[1]), corner(triangle.vertices[2]));
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    // Texel centres are at half-integers; v runs upwards. One texel more on each side than the filter reads, for the
    // rounding of interpolated coordinates: far more than the few ulp that it takes, up to 2^20 periods of the map.
    let (width, height) = (d.map_width as f32, d.map_height as f32);
    let (left, right) = (floor(low.x * width - 0.5) - 1.0, floor(high.x * width - 0.5) + 2.0);
    let (top, bottom) =
        (floor(-high.y * height + height - 0.5) - 1.0, floor(-low.y * height + height - 0.5) + 2.0);
    let texels = (right - left + 1.0).max(1.0) * (bottom - top + 1.0).max(1.0);
    let farthest = left.abs().max(right.abs()).max(top.abs()).max(bottom.abs());
    let whole = texels > MOST_TEXELS.min(width * height) || farthest > 16_777_216.0 / 4.0;
    if whole {
        return (d.height_min, d.height_max);
    }
    let (mut lowest, mut highest) = (f32::INFINITY, f32::NEG_INFINITY);
    let mut y = top as i32;
    while y <= bottom as i32 {
        let row = unwrapped_index(y, d.map_height, field.wrap) * d.map_width;
        let mut x = left as i32;
        while x <= right as i32 {
            let texel = field.texel(row + unwrapped_index(x, d.map_width, field.wrap));
            lowest = lowest.min(texel);
            highest = highest.max(texel);
            x += 1;
        }
        y += 1;
    }
    Displacement::height_range(lowest, highest, d.zero, d.scale)
}

/// The texel that index `i` of the endless map stands for.
fn unwrapped_index(i: i32, size: u32, mode: u32) -> u32 {
    let size = size as i32;
    let index = if mode == wrap::REPEAT {
        i.rem_euclid(size)
    } else if mode == wrap::MIRROR {
        let folded = i.rem_euclid(2 * size);
        if folded < size { folded } else { 2 * size - 1 - folded }
    } else {
        i.clamp(0, size - 1)
    };
    index as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::barycentric::grid_point;
    use crate::displacement::surface::BaseTriangle;
    use crate::math::tests::Numbers;
    use crate::scene::Features;
    use crate::test_scene::{FLAT, TestScene};

    /// A map of random texels with a few peaks, and a triangle with texture coordinates of up to `reach`.
    fn random_scene(numbers: &mut Numbers, reach: f32) -> TestScene {
        let mut scene = TestScene::squares(&[0.0]);
        let (width, height) = (1 + (numbers.unit() * 40.0) as u32, 1 + (numbers.unit() * 40.0) as u32);
        scene.height_texels = (0..width * height)
            .map(|_| if numbers.unit() < 0.05 { numbers.unit() } else { 0.01 * numbers.unit() })
            .map(f32::to_bits)
            .collect();
        let origin = numbers.vec3() * 3.0;
        for vertex in &mut scene.vertices {
            let offset = numbers.vec3() * reach;
            (vertex.u, vertex.v) = (origin.x + offset.x, origin.y + offset.y);
        }
        let d = &mut scene.frame.displacement;
        (d.map_width, d.map_height, d.scale, d.zero) = (width, height, 1.0, 0.25);
        (d.height_min, d.height_max) = Displacement::height_range(0.0, 1.0, d.zero, d.scale);
        scene
    }

    #[test]
    fn bounds_hold_every_height_over_the_triangle() {
        let mut numbers = Numbers::new(31);
        let mut tighter = 0;
        for round in 0..6_000 {
            let scene = random_scene(&mut numbers, [0.02, 0.2, 1.0][round % 3]);
            let features = Features { height_wrap: round as u32 / 3 % 3, ..FLAT };
            let view = scene.view();
            let field = HeightField::new(&view, features);
            let (low, high) = height_bounds(&field, &scene.vertices, scene.triangles[0]);
            tighter += u32::from(high - low < 0.9);
            let base = BaseTriangle::load(&scene.vertices, scene.triangles[0], 0);
            for j in 0..=24 {
                for k in 0..=24 - j {
                    let h = field.height(base.uv(grid_point(j, k, 24)));
                    assert!(
                        h >= low && h <= high,
                        "{h} outside [{low}, {high}], wrap {}",
                        features.height_wrap
                    );
                }
            }
        }
        assert!(tighter > 1_000, "the bounds are no better than the map's: {tighter}");
    }

    #[test]
    fn small_footprint_does_not_see_a_far_peak() {
        let mut scene = TestScene::squares(&[0.0]);
        scene.height_texels = vec![0; 64 * 64];
        scene.height_texels[64 * 32 + 32] = 1.0_f32.to_bits();
        for vertex in &mut scene.vertices {
            (vertex.u, vertex.v) = (0.1 + 0.01 * vertex.position.x, 0.1 + 0.01 * vertex.position.y);
        }
        let d = &mut scene.frame.displacement;
        (d.map_width, d.map_height, d.scale, d.height_max) = (64, 64, 1.0, 1.0);
        let view = scene.view();
        let field = HeightField::new(&view, FLAT);
        assert_eq!(height_bounds(&field, &scene.vertices, scene.triangles[0]), (0.0, 0.0));
    }
}

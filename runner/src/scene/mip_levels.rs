//! The levels of a map: itself, and ever smaller ones down to a single texel, for pixels that cover many texels. Here
//! those of colour maps.

use super::ColorMap;
use super::image::SRGB_CODES;
use crate::settings::Filter;
use emboss_kernels::interface::color_format;
use glam::Vec3;
use std::sync::Arc;

/// How many texels the levels of a map have together, one with the sides halved (rounded down, at least 1) after the
/// other.
pub fn texels(width: u32, height: u32) -> u64 {
    sizes(width, height)
        .map(|(width, height)| u64::from(width) * u64::from(height))
        .fold(0, u64::saturating_add)
}

/// The sizes of the levels of a map, its own first.
pub(crate) fn sizes(width: u32, height: u32) -> impl Iterator<Item = (u32, u32)> {
    let smaller = |&(w, h): &(u32, u32)| (w > 1 || h > 1).then(|| ((w / 2).max(1), (h / 2).max(1)));
    std::iter::successors(Some((width, height)), smaller)
}

/// The words of a map as `filter` reads it.
pub fn packed(map: Arc<ColorMap>, filter: Filter) -> Vec<u32> {
    let map = Arc::unwrap_or_clone(map);
    match filter {
        Filter::Bilinear => map.texels,
        Filter::Trilinear => with_levels(map),
    }
}

/// How many they are.
pub fn words(map: &ColorMap, filter: Filter) -> u64 {
    let own = map.texels.len() as u64;
    let others = texels(map.width, map.height) - u64::from(map.width) * u64::from(map.height);
    match (filter, map.format) {
        (Filter::Bilinear, _) => own,
        (Filter::Trilinear, color_format::SRGB8) => own + others,
        (Filter::Trilinear, _) => own + 3 * others,
    }
}

/// The words of a map with those of its other levels behind them, in its format. Each texel is the mean, in linear
/// colours, of what it covers of the level before, which with odd sides is parts of texels too.
fn with_levels(map: ColorMap) -> Vec<u32> {
    let ColorMap { width, height, format, texels: mut words } = map;
    let mut colors = linear(&words, format);
    for ((from_width, from_height), (to_width, to_height)) in
        sizes(width, height).zip(sizes(width, height).skip(1))
    {
        colors = halved(&colors, from_width, from_height, to_width, to_height);
        append(&mut words, &colors, format);
    }
    words
}

/// The linear colours of a packed map.
fn linear(words: &[u32], format: u32) -> Vec<Vec3> {
    let float = |word: u32| f32::from_bits(word);
    if format == color_format::SRGB8 {
        let (table, texels) = words.split_at(SRGB_CODES);
        let channel = |code: u8| float(table[usize::from(code)]);
        let color = |word: &u32| {
            let [r, g, b, _] = word.to_le_bytes();
            Vec3::new(channel(r), channel(g), channel(b))
        };
        texels.iter().map(color).collect()
    } else {
        words.chunks_exact(3).map(|rgb| Vec3::new(float(rgb[0]), float(rgb[1]), float(rgb[2]))).collect()
    }
}

/// Appends colours to a packed map.
fn append(words: &mut Vec<u32>, colors: &[Vec3], format: u32) {
    if format == color_format::SRGB8 {
        let table: Vec<f32> = words[..SRGB_CODES].iter().map(|&word| f32::from_bits(word)).collect();
        let code = |value: f32| {
            // The table ascends: the code whose value is nearest is the last one below, or the next.
            let above = table.partition_point(|&entry| entry < value).clamp(1, SRGB_CODES - 1);
            let nearest = if value - table[above - 1] < table[above] - value { above - 1 } else { above };
            u8::try_from(nearest).unwrap_or(u8::MAX)
        };
        words.extend(colors.iter().map(|c| u32::from_le_bytes([code(c.x), code(c.y), code(c.z), u8::MAX])));
    } else {
        words.extend(colors.iter().flat_map(|color| color.to_array().map(f32::to_bits)));
    }
}

/// A level from the one before.
fn halved(colors: &[Vec3], width: u32, height: u32, to_width: u32, to_height: u32) -> Vec<Vec3> {
    let (columns, rows) = (covered(width, to_width), covered(height, to_height));
    let mut smaller = Vec::with_capacity(columns.len() * rows.len());
    for row in &rows {
        for column in &columns {
            let mut mean = Vec3::ZERO;
            for (y, y_weight) in row {
                for (x, x_weight) in column {
                    mean += colors[y * width as usize + x] * (x_weight * y_weight);
                }
            }
            smaller.push(mean);
        }
    }
    smaller
}

/// Of `from` texels in a row, which ones each of `to` covers, and with what share of it.
pub(crate) fn covered(from: u32, to: u32) -> Vec<Vec<(usize, f32)>> {
    let side = f64::from(from) / f64::from(to);
    let covered = |i: u32| {
        let (start, end) = (f64::from(i) * side, f64::from(i + 1) * side);
        let share = |x: u32| (end.min(f64::from(x + 1)) - start.max(f64::from(x))) / side;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "shares are rounded to the texels' precision, places lie within the row"
        )]
        let shares = (start as u32..from.min(end.ceil() as u32)).map(|x| (x as usize, share(x) as f32));
        // A share that is only rounding is none.
        shares.filter(|(_, share)| *share > 1e-6).collect()
    };
    (0..to).map(covered).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_halve_down_to_a_single_texel() {
        assert_eq!(sizes(5, 2).collect::<Vec<_>>(), [(5, 2), (2, 1), (1, 1)]);
        assert_eq!((texels(1, 1), texels(5, 2), texels(1024, 1024)), (1, 13, 1_398_101));
    }

    #[test]
    fn texels_are_means_of_what_they_cover() {
        // Each of two texels covers two and a half of five.
        assert_eq!(covered(5, 2), [vec![(0, 0.4), (1, 0.4), (2, 0.2)], vec![(2, 0.2), (3, 0.4), (4, 0.4)]]);
        let floats = [1.0_f32, 2.0, 3.0, 4.0, 5.0].into_iter().flat_map(|x| [x, -x, 0.0]).map(f32::to_bits);
        let map = ColorMap { width: 5, height: 1, format: color_format::FLOAT32, texels: floats.collect() };
        let words: Vec<f32> = with_levels(map).into_iter().map(f32::from_bits).collect();
        let near = |a: f32, b: f32| (a - b).abs() < 1e-6;
        assert_eq!(words.len(), 3 * 8);
        assert!(
            near(words[15], 1.8) && near(words[16], -1.8) && near(words[18], 4.2) && near(words[21], 3.0)
        );
    }

    #[test]
    fn eight_bit_levels_take_the_nearest_codes() {
        let table = (0..256_u16).map(|code| (f32::from(code) / 255.0).powi(2).to_bits());
        let map = ColorMap {
            width: 2,
            height: 1,
            format: color_format::SRGB8,
            texels: table
                .chain([u32::from_le_bytes([255, 0, 10, 0]), u32::from_le_bytes([0, 0, 10, 0])])
                .collect(),
        };
        // The root of a half is 180.3 codes.
        assert_eq!(with_levels(map)[258].to_le_bytes(), [180, 0, 10, 255]);
    }
}

use super::*;
use ::image::{GrayImage, ImageBuffer, Luma, LumaA, Rgb, Rgb32FImage, RgbImage};
use std::path::PathBuf;
use tempfile::TempDir;

/// A file name in a new folder.
fn file(name: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    (folder, path)
}

/// Saves an image in the format of the name's ending and loads it as a height map.
fn height_of(image: impl Into<DynamicImage>, name: &str, zero: f32, invert: bool) -> HeightMap {
    let (_folder, path) = file(name);
    image.into().save(&path).unwrap();
    load_height_map(&path, zero, invert).unwrap()
}

/// Saves an image in the format of the name's ending and loads it as a colour map.
fn color_of(image: impl Into<DynamicImage>, name: &str) -> ColorMap {
    let (_folder, path) = file(name);
    image.into().save(&path).unwrap();
    load_color_map(&path).unwrap()
}

fn texels(map: &HeightMap) -> Vec<f32> {
    (0..map.height).flat_map(|y| (0..map.width).map(move |x| map.texel(x, y))).collect()
}

/// An image of 3x2 pixels, in rows.
fn three_by_two<P: ::image::Pixel>(pixels: [P; 6]) -> ImageBuffer<P, Vec<P::Subpixel>> {
    ImageBuffer::from_fn(3, 2, |x, y| pixels[(3 * y + x) as usize])
}

#[test]
fn eight_bits_stay_eight_bits_whatever_the_format() {
    let codes = [0u8, 1, 127, 128, 254, 255];
    for name in ["map.png", "map.bmp", "map.gif", "map.tiff"] {
        let image = DynamicImage::from(three_by_two(codes.map(|c| Luma([c]))));
        // The GIF encoder takes no grey images.
        let image = if name.ends_with("gif") { DynamicImage::from(image.to_rgba8()) } else { image };
        let map = height_of(image, name, 0.0, false);
        assert_eq!((map.width, map.height, map.format), (3, 2, height_format::UNORM8), "{name}");
        assert_eq!(texels(&map), codes.map(|c| f32::from(c) / 255.0), "{name}");
        assert_eq!(map.texels, [0x807f_0100, 0x0000_fffe], "{name}");
        assert_eq!((map.range, map.replaced, map.has_steps()), ((0.0, 1.0), 0, true), "{name}");
    }
}

#[test]
fn a_jpeg_is_read() {
    let map = height_of(GrayImage::from_pixel(16, 8, Luma([77])), "map.jpg", 0.0, false);
    assert_eq!((map.width, map.height, map.format), (16, 8, height_format::UNORM8));
    // A block of one value has one coefficient, which quantisation rounds to within a code or so.
    assert!(texels(&map).iter().all(|t| (t * 255.0 - 77.0).abs() <= 1.0), "{:?}", map.range);
}

#[test]
fn sixteen_bits_stay_sixteen_bits() {
    let codes = [0u16, 1, 255, 32_768, 65_534, 65_535];
    for name in ["map.png", "map.tiff"] {
        let map = height_of(three_by_two(codes.map(|c| Luma([c]))), name, 0.0, false);
        assert_eq!(map.format, height_format::UNORM16);
        assert_eq!(texels(&map), codes.map(|c| f32::from(c) / 65_535.0));
        assert_eq!(map.texels, [0x0001_0000, 0x8000_00ff, 0xffff_fffe]);
        assert!(!map.has_steps());
    }
}

#[test]
fn equal_channels_are_exact_and_alpha_is_not_read() {
    let codes = [0u8, 1, 127, 128, 254, 255];
    let map = height_of(three_by_two(codes.map(|c| Rgb([c; 3]))), "map.png", 0.0, false);
    assert_eq!(
        (map.format, texels(&map)),
        (height_format::UNORM8, codes.map(|c| f32::from(c) / 255.0).to_vec())
    );
    let map = height_of(three_by_two(codes.map(|c| LumaA([c, 3]))), "map.png", 0.0, false);
    assert_eq!(
        (map.format, texels(&map)),
        (height_format::UNORM8, codes.map(|c| f32::from(c) / 255.0).to_vec())
    );
}

#[test]
fn colours_become_their_luminance() {
    let red = RgbImage::from_pixel(1, 1, Rgb([255, 0, 0]));
    let map = height_of(red, "map.png", 0.0, false);
    assert_eq!((map.format, texels(&map)), (height_format::FLOAT32, vec![0.2126]));
    let blend = ImageBuffer::<Rgb<u16>, _>::from_pixel(1, 1, Rgb([65_535u16, 13_107, 0]));
    let map = height_of(blend, "map.png", 0.0, true);
    // 1 - (0.2126 + 0.2 * 0.7152), with two roundings of f32.
    assert!((texels(&map)[0] - 0.644_36).abs() < f32::EPSILON, "{:?}", texels(&map));
}

#[test]
fn inverting_integers_is_exact() {
    let codes: Vec<u8> = (0..=255).collect();
    let image = GrayImage::from_raw(16, 16, codes).unwrap();
    let map = height_of(image, "map.png", 0.0, true);
    let expected: Vec<f32> = (0..=255u8).map(|c| f32::from(255 - c) / 255.0).collect();
    assert_eq!((map.format, texels(&map)), (height_format::UNORM8, expected));
    let deep = ImageBuffer::<Luma<u16>, _>::from_pixel(1, 1, Luma([1u16]));
    assert_eq!(height_of(deep, "map.png", 0.0, true).texels, [65_534]);
}

#[test]
fn floats_are_kept_as_they_are() {
    let values = [-2.5, 0.0, 0.1, 1.0, 3.0e4, 1.0e-30];
    let image = || three_by_two(values.map(|x| Rgb([x; 3])));
    for name in ["map.exr", "map.tiff"] {
        let map = height_of(image(), name, 0.0, false);
        assert_eq!(
            (map.format, texels(&map), map.range),
            (height_format::FLOAT32, values.to_vec(), (-2.5, 3.0e4))
        );
        assert_eq!(texels(&height_of(image(), name, 0.0, true)), values.map(|x| 1.0 - x));
    }
    // Powers of two have an exact mantissa in HDR's shared exponents.
    let map = height_of(Rgb32FImage::from_pixel(2, 2, Rgb([0.25; 3])), "map.hdr", 0.0, false);
    assert_eq!((map.format, texels(&map)), (height_format::FLOAT32, vec![0.25; 4]));
}

#[test]
fn a_single_channel_of_floats_is_read() {
    let values = [-2.5f32, 0.0, 0.1, 1.0, f32::NAN, 1.0e-30];
    let (_folder, path) = file("map.tiff");
    let mut encoder = tiff::encoder::TiffEncoder::new(File::create(&path).unwrap()).unwrap();
    encoder.write_image::<tiff::encoder::colortype::Gray32Float>(3, 2, &values).unwrap();
    let from_tiff = load_height_map(&path, 0.5, false).unwrap();

    let (_folder, path) = file("map.exr");
    write_exr(&path, &["Y"], &values);
    let from_exr = load_height_map(&path, 0.5, false).unwrap();
    for map in [&from_tiff, &from_exr] {
        assert_eq!((map.width, map.height, map.format), (3, 2, height_format::FLOAT32));
        assert_eq!(texels(map), [-2.5, 0.0, 0.1, 1.0, 0.5, 1.0e-30]);
        assert_eq!((map.range, map.replaced), ((-2.5, 1.0), 1));
    }
    write_exr(&path, &["U", "V"], &values);
    let message = load_height_map(&path, 0.5, false).unwrap_err().to_string();
    assert!(message.contains("map.exr: cannot be decoded: "), "{message}");
}

/// Writes an EXR of 3x2 pixels whose channels all have the same values.
fn write_exr(path: &Path, channels: &[&str], values: &[f32]) {
    use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};
    let channels = channels.iter().map(|&name| AnyChannel::new(name, FlatSamples::F32(values.to_vec())));
    Image::from_channels((3, 2), AnyChannels::sort(channels.collect())).write().to_file(path).unwrap();
}

#[test]
fn nan_and_infinity_become_no_displacement() {
    let values = [f32::NAN, f32::INFINITY, 0.25, f32::NEG_INFINITY, 0.5, 0.75];
    for invert in [false, true] {
        let map = height_of(three_by_two(values.map(|x| Rgb([x; 3]))), "map.exr", 0.6, invert);
        let rest = if invert { [0.75, 0.5, 0.25] } else { [0.25, 0.5, 0.75] };
        assert_eq!(texels(&map), [0.6, 0.6, rest[0], 0.6, rest[1], rest[2]]);
        assert_eq!((map.replaced, map.range), (3, (0.25, 0.75)));
    }
    let one_bad_channel = Rgb32FImage::from_pixel(1, 1, Rgb([0.5, f32::NAN, 0.5]));
    assert_eq!(height_of(one_bad_channel, "map.exr", 0.0, false).replaced, 1);
}

#[test]
fn a_single_texel_is_a_map() {
    let map = height_of(GrayImage::from_pixel(1, 1, Luma([51])), "map.png", 0.0, false);
    assert_eq!((map.width, map.height, texels(&map), map.range), (1, 1, vec![0.2], (0.2, 0.2)));
    let flat = HeightMap::flat(0.3);
    assert_eq!((flat.width, flat.height, texels(&flat), flat.range), (1, 1, vec![0.3], (0.3, 0.3)));
}

#[test]
fn sixteen_thousand_texels_a_side_are_read() {
    const SIDE: u32 = 16_384;
    // A BMP of one bit a pixel, whose 32 MiB decode to 768 MiB: more than the decoder's own limit of 512.
    let pixels = SIDE * SIDE / 8;
    let mut bytes = b"BM".to_vec();
    for word in
        [62 + pixels, 0, 62, 40, SIDE, SIDE, 1 | 1 << 16, 0, pixels, 0, 0, 2, 0, 0x0033_3333, 0x00ff_ffff]
    {
        bytes.extend(word.to_le_bytes());
    }
    bytes.resize(62 + pixels as usize, 0);
    bytes[62] = 0x80;
    let (_folder, path) = file("map.bmp");
    std::fs::write(&path, bytes).unwrap();
    let map = load_height_map(&path, 0.0, false).unwrap();
    assert_eq!((map.width, map.height, map.format), (SIDE, SIDE, height_format::UNORM8));
    // BMP starts with the bottom row.
    assert_eq!((map.texel(0, SIDE - 1), map.texel(1, SIDE - 1), map.range), (1.0, 0.2, (0.2, 1.0)));
}

#[test]
fn srgb_colours_keep_their_codes_beside_the_linear_table() {
    let map = color_of(RgbImage::from_pixel(1, 1, Rgb([1, 128, 255])), "map.png");
    assert_eq!((map.width, map.height, map.format, map.texels.len()), (1, 1, color_format::SRGB8, 257));
    assert_eq!(map.texels[256], 0xffff_8001);
    let linear = |code: usize| f32::from_bits(map.texels[code]);
    assert_eq!([linear(0), linear(255)], [0.0, 1.0]);
    // Code 128 by the formula of IEC 61966-2-1 in more digits; powf is within some units of the last place.
    assert!((linear(128) - 0.215_860_5).abs() < 4.0 * f32::EPSILON, "{}", linear(128));
    assert!((0..255).all(|code| linear(code) < linear(code + 1)));
}

#[test]
fn grey_colours_have_three_equal_channels() {
    let map = color_of(GrayImage::from_pixel(1, 1, Luma([7])), "map.png");
    assert_eq!(map.texels[256], 0xff07_0707);
}

#[test]
fn deep_colours_are_decoded_to_linear_floats() {
    let map = color_of(ImageBuffer::<Rgb<u16>, _>::from_pixel(1, 1, Rgb([0u16, 32_896, 65_535])), "map.png");
    let [r, g, b]: [f32; 3] = [0, 1, 2].map(|i| f32::from_bits(map.texels[i]));
    assert_eq!((map.format, map.texels.len(), r, b), (color_format::FLOAT32, 3, 0.0, 1.0));
    // 32896 = 128 * 257 stands for the same number as 128 of 8 bits.
    assert!((g - 0.215_860_5).abs() < 4.0 * f32::EPSILON, "{g}");
}

#[test]
fn float_colours_are_linear_and_finite() {
    let image = Rgb32FImage::from_fn(2, 1, |x, _| Rgb([x as f32 * 7.5, f32::NAN, -0.25]));
    let map = color_of(image, "map.exr");
    let values: Vec<f32> = map.texels.iter().map(|&word| f32::from_bits(word)).collect();
    assert_eq!((map.format, values), (color_format::FLOAT32, vec![0.0, 0.0, -0.25, 7.5, 0.0, -0.25]));
}

#[test]
fn maps_made_by_code_round_to_the_nearest_code() {
    let values = [-1.0, 0.0, 0.5, 1.0, 2.0, f32::NAN];
    let map = HeightMap::from_unit(3, 2, values.into_iter());
    assert_eq!((map.format, map.texels.clone()), (height_format::UNORM16, vec![0, 0xffff_8000, 0x0000_ffff]));
    let color = ColorMap::from_linear(1, 1, [Vec3::new(0.0, 0.215_860_5, 3.0)].into_iter());
    assert_eq!((color.format, color.texels[256]), (color_format::SRGB8, 0xffff_8000));
}

#[test]
fn texels_are_evaluated_at_their_centres_from_the_top_left() {
    let centers = per_texel(2, 2, |u, v| (u, v));
    assert_eq!(centers, [(0.25, 0.75), (0.75, 0.75), (0.25, 0.25), (0.75, 0.25)]);
}

/// The message of a file that cannot be loaded, after the folder's name; both loaders say the same.
fn message(name: &str, content: &[u8]) -> String {
    let (folder, path) = file(name);
    std::fs::write(&path, content).unwrap();
    let [height, color] = [load_height_map(&path, 0.0, false).map(drop), load_color_map(&path).map(drop)]
        .map(|result| {
            let message = result.expect_err("the map is broken").to_string();
            let prefix = format!("{}/", folder.path().display());
            message.strip_prefix(&prefix).unwrap_or_else(|| panic!("{message} names no file")).to_owned()
        });
    assert_eq!(height, color);
    height
}

/// The bytes of a black image in PNG.
fn png(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    GrayImage::new(width, height).write_to(&mut bytes, ::image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

#[test]
fn broken_maps_are_named_with_a_remedy() {
    let (folder, missing) = file("missing.png");
    for path in [missing.as_path(), folder.path()] {
        let message = load_height_map(path, 0.0, false).unwrap_err().to_string();
        assert!(message.starts_with(&format!("{}: cannot be read: ", path.display())), "{message}");
        assert!(message.ends_with("; check the path and its permissions"), "{message}");
    }
    let no_image = "not an image that can be read; use PNG, JPEG, BMP, GIF, TIFF, EXR or HDR";
    assert_eq!(message("map.png", b"v 0 0 0\n"), format!("map.png: {no_image}"));
    assert_eq!(message("map.png", b""), format!("map.png: {no_image}"));
    assert_eq!(message("map.webp", b"RIFF\x04\0\0\0WEBPVP8 "), format!("map.webp: {no_image}"));
    let cut = message("map.png", &png(64, 64)[..60]);
    assert!(cut.starts_with("map.png: cannot be decoded: "), "{cut}");
    assert!(cut.ends_with("; open it in an image editor and save it anew"), "{cut}");
    assert_eq!(
        message("map.png", &png(32_769, 1)),
        "map.png: 32769x1 texels are too many; scale it down to at most 32768x32768"
    );
}

#[test]
fn maps_without_texels_are_refused() {
    // A GIF is the format in which a decoder lets this pass.
    assert_eq!(
        message("map.gif", b"GIF89a\0\0\x01\0\0\0\0,\0\0\0\0\0\0\x01\0\0\x02\x01\0\0;"),
        "map.gif: has no texels (0x1); use a map of at least 1x1"
    );
}

#[test]
fn the_monster_frogs_maps_and_the_chesterfield_load() {
    let data = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data"));
    if !data.exists() {
        skip(data);
        return;
    }
    let map = load_height_map(&data.join("monsterfrog/monsterfrog-d.bmp"), 0.5, false).unwrap();
    assert_eq!((map.width, map.height, map.has_steps()), (512, 512, true));
    let map = load_color_map(&data.join("monsterfrog/monsterfrog-n.bmp")).unwrap();
    assert_eq!((map.width, map.height, map.format), (1024, 1024, color_format::SRGB8));
    let map = load_height_map(&data.join("chesterfield-height.jpg"), 0.0, false).unwrap();
    assert_eq!((map.width, map.height, map.has_steps()), (256, 256, true));
}

#[expect(clippy::print_stderr, reason = "a skipped test says so")]
fn skip(path: &Path) {
    eprintln!("skipped: {} is not there", path.display());
}

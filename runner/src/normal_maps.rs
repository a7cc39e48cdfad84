//! The maps that two methods read beside height maps, of normals and of Blinn's offsets: made from the height maps
//! where none is given, and only for these methods.

use crate::heights::grown;
use crate::render::RenderError;
use crate::scene::image::{VectorMap, load_vector_map};
use crate::scene::{HeightMap, Mesh, Relief, SceneError};
use crate::settings::{Method, Settings, Wrap};
use emboss_kernels::interface::{height_format, normal_space, wrap};
use emboss_kernels::relief::normal_texels::HEADER_WORDS;
use glam::{Vec2, Vec3};
use std::path::Path;
use std::sync::Arc;

/// The space of a normal map.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum NormalSpace {
    /// Tangent, bitangent and normal of the surface (those of MikkTSpace), green upwards
    #[default]
    Tangent,
    /// The model's x, y and z
    Object,
    /// The scene's x, y and z, wherever the model stands
    World,
}

/// A normal map, packed as kernels read it.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalMap {
    space: NormalSpace,
    texels: OwnTexels,
    /// How it is read outside [0,1), where a material names it; `None`: as the settings say.
    pub(crate) wrap: Option<Wrap>,
}

/// A map of Blinn's offsets, packed as kernels read it.
#[derive(Clone, Debug, PartialEq)]
pub struct OffsetMap(OwnTexels);

/// Texels of two words.
#[derive(Clone, Debug)]
struct OwnTexels {
    width: u32,
    height: u32,
    words: Arc<Vec<u32>>,
}

/// Whether they are in memory once.
impl PartialEq for OwnTexels {
    fn eq(&self, other: &OwnTexels) -> bool {
        Arc::ptr_eq(&self.words, &other.words)
    }
}

impl NormalSpace {
    /// Its value for the kernels.
    fn id(self) -> u32 {
        match self {
            NormalSpace::Tangent => normal_space::TANGENT,
            NormalSpace::Object => normal_space::OBJECT,
            NormalSpace::World => normal_space::WORLD,
        }
    }
}

impl NormalMap {
    /// Reads a picture whose red, green and blue, from 0 to 1, are the components of a normal from -1 to 1. Outside
    /// [0,1) that of a relief is read as `wrap` says, for want of that as the settings say; that of the settings as
    /// the height map.
    ///
    /// # Errors
    /// Where the file cannot be read, or has fewer than three channels.
    pub fn load(path: &Path, space: NormalSpace, wrap: Option<Wrap>) -> Result<NormalMap, SceneError> {
        let map = load_vector_map(path, Some(0.5))?;
        let texels = OwnTexels::of(&map, |channels| normal_words(channels * 2.0 - Vec3::ONE));
        Ok(NormalMap { space, texels, wrap })
    }
}

impl OffsetMap {
    /// Reads a picture whose red and green are Blinn's b_u and b_v: by how much texels of the height map that it
    /// stands for grow from one of its own texels to the next, along u (to the right) and along v (upwards). Floats
    /// are taken as they are. Of integers the middle code, 128 of 8 bits and 32768 of 16, is 0, and the greatest is
    /// 1; code 0 counts as -1.
    ///
    /// # Errors
    /// Where the file cannot be read, or has fewer than three channels.
    pub fn load(path: &Path) -> Result<OffsetMap, SceneError> {
        let map = load_vector_map(path, Some(0.0))?;
        let [x, ..] = &map.channels;
        let size = Vec2::new(x.width as f32, x.height as f32);
        let middle = match x.format {
            height_format::UNORM8 => Some(128.0),
            height_format::UNORM16 => Some(32768.0),
            _ => None,
        };
        let offset = |texel: f32| match middle {
            // Codes are whole numbers again once they are rounded.
            Some(middle) => (((texel * (2.0 * middle - 1.0)).round() - middle) / (middle - 1.0)).max(-1.0),
            None => texel,
        };
        let words = |channels: Vec3| {
            let growth = Vec2::new(offset(channels.x), offset(channels.y)) * size;
            [growth.x.to_bits(), growth.y.to_bits()]
        };
        Ok(OffsetMap(OwnTexels::of(&map, words)))
    }
}

impl OwnTexels {
    /// The texels of a picture, each by what its first three channels come to.
    fn of(map: &VectorMap, words: impl Fn(Vec3) -> [u32; 2]) -> OwnTexels {
        let [x, y, z] = &map.channels;
        let (width, height) = (x.width, x.height);
        let texel = |i: u32| {
            let (column, row) = (i % width, i / width);
            words(Vec3::new(x.texel(column, row), y.texel(column, row), z.texel(column, row)))
        };
        OwnTexels { width, height, words: Arc::new((0..width * height).flat_map(texel).collect()) }
    }
}

/// What stands in a header, and the texels.
struct Own {
    texels: OwnTexels,
    wrap: u32,
    /// What normals were made for, 0 where they lean as they are.
    scale: f32,
    space: NormalSpace,
}

/// The words of the maps that the settings' method reads, one for each of the reliefs; none where it reads none.
/// Those that several reliefs have stand there once.
///
/// # Errors
/// [`RenderError::MapsTooLarge`] where they are more than 32 bits can number.
pub fn pack(settings: &Settings, mesh: &Mesh, reliefs: &[Relief]) -> Result<Vec<u32>, RenderError> {
    if !matches!(settings.method, Method::BumpOffset | Method::NormalMap) {
        return Ok(Vec::new());
    }
    let mut words = 0;
    grown(&mut words, u64::from(HEADER_WORDS) * reliefs.len() as u64)?;
    let mut headers: Vec<u32> = Vec::new();
    let mut placed: Vec<(OwnTexels, u32)> = Vec::new();
    for (index, relief) in (0..).zip(reliefs) {
        let Own { texels, wrap, scale, space } = own(settings, mesh, index, relief);
        let first = match placed.iter().find(|(other, _)| *other == texels) {
            Some((_, first)) => *first,
            None => grown(&mut words, texels.words.len() as u64)?,
        };
        headers.extend([first, texels.width, texels.height, wrap, scale.to_bits(), space.id()]);
        placed.push((texels, first));
    }
    for (texels, first) in placed {
        // Of those that stand there once the first.
        if first as usize == headers.len() {
            headers.extend_from_slice(&texels.words);
        }
    }
    Ok(headers)
}

/// The map of relief number `index`: as the settings say, else its own, else one that is made from the height map.
fn own(settings: &Settings, mesh: &Mesh, index: u32, relief: &Relief) -> Own {
    let usual = relief.wrap.unwrap_or(settings.wrap);
    if settings.method == Method::BumpOffset {
        let texels = match &settings.offset_map {
            Some(OffsetMap(texels)) => texels.clone(),
            None => offsets_of(&relief.map, usual.id()),
        };
        return Own { texels, wrap: usual.id(), scale: 0.0, space: NormalSpace::Tangent };
    }
    let given = |map: &NormalMap, wrap: Wrap| Own {
        texels: map.texels.clone(),
        wrap: wrap.id(),
        scale: 0.0,
        space: map.space,
    };
    match (&settings.normal_map, &relief.normal_map) {
        (Some(map), _) => given(map, usual),
        (None, Some(map)) => given(map, map.wrap.unwrap_or(settings.wrap)),
        (None, None) => {
            // Normals of height maps lean as the scale says, which may change.
            let scale = if relief.scale == 0.0 { 1.0 } else { relief.scale };
            let texels = normals_of(&relief.map, mean_lengths(mesh, index), scale, usual.id());
            Own { texels, wrap: usual.id(), scale, space: NormalSpace::Tangent }
        }
    }
}

/// Whether the settings' method reads normals that are along the tangents of vertices.
pub fn needs_tangents(settings: &Settings, reliefs: &[Relief]) -> bool {
    let is_tangent = |relief: &Relief| {
        let given = settings.normal_map.as_ref().or(relief.normal_map.as_ref());
        given.is_none_or(|map| map.space == NormalSpace::Tangent)
    };
    settings.method == Method::NormalMap && reliefs.iter().any(is_tangent)
}

/// The derivatives of a height map.
fn offsets_of(map: &HeightMap, wrap: u32) -> OwnTexels {
    from_heights(map, wrap, |gradient| [gradient.x.to_bits(), gradient.y.to_bits()])
}

/// The normals of a height map's slopes, where a unit of u and of v is so long on the surface.
fn normals_of(map: &HeightMap, lengths: Vec2, scale: f32, wrap: u32) -> OwnTexels {
    from_heights(map, wrap, |gradient| normal_words((-gradient * scale / lengths).extend(1.0).normalize()))
}

fn from_heights(map: &HeightMap, wrap: u32, words: impl Fn(Vec2) -> [u32; 2]) -> OwnTexels {
    let (width, height) = (map.width, map.height);
    let texels = (0..width * height).flat_map(|i| words(gradient(map, i % width, i / width, wrap)));
    OwnTexels { width, height, words: Arc::new(texels.collect()) }
}

/// Growth of texels for a unit of u and of v, by central differences.
fn gradient(map: &HeightMap, x: u32, y: u32, mode: u32) -> Vec2 {
    let next = |i: u32, n: u32| {
        if i + 1 < n {
            i + 1
        } else if mode == wrap::REPEAT {
            0
        } else {
            i
        }
    };
    let before = |i: u32, n: u32| {
        if i > 0 {
            i - 1
        } else if mode == wrap::REPEAT {
            n - 1
        } else {
            i
        }
    };
    let (width, height) = (map.width, map.height);
    let along_row = map.texel(next(x, width), y) - map.texel(before(x, width), y);
    // Rows are counted downwards, v upwards.
    let up = map.texel(x, before(y, height)) - map.texel(x, next(y, height));
    Vec2::new(along_row * width as f32, up * height as f32) * 0.5
}

/// Lengths on the mesh of a unit of u and of v of relief number `index`: the mean over the map.
fn mean_lengths(mesh: &Mesh, index: u32) -> Vec2 {
    let (mut sum, mut whole) = (Vec2::ZERO, 0.0);
    for triangle in mesh.triangles.iter().filter(|triangle| triangle.displacement == index) {
        let [a, b, c] = triangle.vertices.map(|v| mesh.vertices[v as usize]);
        let (e1, e2) = (b.position - a.position, c.position - a.position);
        let (d1, d2) = (Vec2::new(b.u - a.u, b.v - a.v), Vec2::new(c.u - a.u, c.v - a.v));
        let area = d1.perp_dot(d2).abs();
        // Times the area that they would be divided by.
        let lengths = Vec2::new((e1 * d2.y - e2 * d1.y).length(), (e2 * d1.x - e1 * d2.x).length());
        if lengths.is_finite() && area.is_finite() {
            sum += lengths;
            whole += area;
        }
    }
    let mean = sum / whole;
    if mean.is_finite() && mean.min_element() > 0.0 { mean } else { Vec2::ONE }
}

/// A normal's components from -1 to 1, in 16 bits each.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 1 to 65535")]
fn normal_words(normal: Vec3) -> [u32; 2] {
    let code = |x: f32| ((x.clamp(-1.0, 1.0) * 32767.0).round() + 32768.0) as u32;
    [code(normal.x) | code(normal.y) << 16, code(normal.z)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;

    #[test]
    fn pictures_are_components_from_minus_one_to_one() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("n.png");
        let picture = image::RgbImage::from_raw(2, 1, vec![0, 255, 51, 255, 102, 0]).expect("six codes");
        picture.save(&path).expect("the folder is writable");
        let map = NormalMap::load(&path, NormalSpace::World, None).expect("a picture of three channels");
        assert_eq!((map.texels.width, map.texels.height), (2, 1));
        // -1, 1, -0.6; 1, -0.2, -1: in steps of 1 / 32767 from 32768, rounded.
        let words = [1 | 65535 << 16, 13108, 65535 | 26215 << 16, 1];
        assert_eq!(map.texels.words[..], words);
    }

    /// Two floats a texel, and per texel of the map's own: of three columns and two rows.
    #[test]
    fn pictures_are_offsets_about_their_middle() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let loaded = |name: &str, save: &dyn Fn(&Path)| {
            let path = folder.path().join(name);
            save(&path);
            let OffsetMap(texels) = OffsetMap::load(&path).expect("a picture of three channels");
            assert_eq!((texels.width, texels.height), (3, 2));
            let floats: Vec<f32> = texels.words.iter().map(|&word| f32::from_bits(word)).collect();
            floats[..6].to_vec()
        };
        let eight = [128, 128, 7, 255, 0, 7, 1, 64, 7].repeat(2);
        let eight = image::RgbImage::from_raw(3, 2, eight).expect("18 codes");
        let of_eight = loaded("8.png", &|path| eight.save(path).expect("writable"));
        assert_eq!(of_eight, [0.0, 0.0, 3.0, -2.0, -3.0, 2.0 * (-64.0 / 127.0)]);
        let sixteen: Vec<u16> = [32768, 32767, 7, 65535, 0, 7, 1, 49152, 7].repeat(2);
        let sixteen = image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(3, 2, sixteen).expect("18 codes");
        let of_sixteen = loaded("16.png", &|path| sixteen.save(path).expect("writable"));
        let expected = [0.0, -2.0 / 32767.0, 3.0, -2.0, -3.0, 2.0 * (16384.0 / 32767.0)];
        assert_eq!(of_sixteen, expected);
        let floats: Vec<f32> = [0.0, 0.25, 7.0, -2.0, 1.5, 7.0, 0.5, -0.5, 7.0].repeat(2);
        let floats = image::Rgb32FImage::from_raw(3, 2, floats).expect("18 floats");
        let of_floats = loaded("f.exr", &|path| floats.save(path).expect("writable"));
        assert_eq!(of_floats, [0.0, 0.5, -6.0, 3.0, 1.5, -1.0]);
    }

    /// Of one picture for all, or of a height map's own one.
    fn given(width: u32, height: u32) -> NormalMap {
        let words = Arc::new(vec![7; 2 * (width * height) as usize]);
        let texels = OwnTexels { width, height, words };
        NormalMap { space: NormalSpace::World, texels, wrap: None }
    }

    /// Each relief has a map, of which a given one stands in the buffer once; methods that read none have none.
    #[test]
    fn only_methods_that_read_them_have_maps() {
        let cube = builtin::load("builtin:cube").expect("built in");
        let relief = Relief::new(cube.height, cube.zero, cube.scale);
        let reliefs = [relief.clone(), relief.clone()];
        let words = |method, normal_map: Option<NormalMap>| {
            let settings = Settings { method, normal_map, ..Settings::default() };
            let words = pack(&settings, &cube.mesh, &reliefs).expect("small").len();
            assert_eq!(
                needs_tangents(&settings, &reliefs),
                method == Method::NormalMap && settings.normal_map.is_none()
            );
            words
        };
        let texels = (relief.map.width * relief.map.height) as usize;
        assert_eq!(words(Method::NormalMap, None), 2 * (6 + 2 * texels));
        assert_eq!(words(Method::BumpOffset, None), 2 * (6 + 2 * texels));
        assert_eq!(words(Method::NormalMap, Some(given(3, 2))), 2 * 6 + 12);
        assert_eq!(
            [Method::Quadtree, Method::Bump, Method::Relief].map(|method| words(method, None)),
            [0; 3]
        );
    }

    /// What is asked for goes before a relief's own map, and that before one that is made.
    #[test]
    fn reliefs_have_normal_maps_of_their_own() {
        let cube = builtin::load("builtin:cube").expect("built in");
        let bare = Relief { wrap: Some(Wrap::Clamp), ..Relief::new(HeightMap::flat(0.0), 0.0, 1.0) };
        let (a, b) = (given(3, 2), NormalMap { wrap: Some(Wrap::Mirror), ..given(1, 1) });
        let with = |map: &NormalMap| Relief { normal_map: Some(map.clone()), ..bare.clone() };
        let reliefs = [with(&a), bare.clone(), with(&b), with(&a)];
        let settings = Settings { method: Method::NormalMap, ..Settings::default() };
        let words = pack(&settings, &cube.mesh, &reliefs).expect("small");
        let header = |i: usize| words[6 * i..6 * i + 4].to_vec();
        let of =
            |map| [0, 1, 2, 3].map(|i| (header(i)[0], header(i)[1], header(i)[3], words[6 * i + 5])) == map;
        let (clamp, mirror, repeat) = (wrap::CLAMP, wrap::MIRROR, wrap::REPEAT);
        let (world, tangent) = (normal_space::WORLD, normal_space::TANGENT);
        let lit = (24, 3, repeat, world);
        assert!(of([lit, (36, 1, clamp, tangent), (38, 1, mirror, world), lit]));
        assert_eq!(words.len(), 40);
        assert!(needs_tangents(&settings, &reliefs) && !needs_tangents(&settings, &[with(&a)]));
        let all = Settings { normal_map: Some(b), ..settings };
        assert_eq!(pack(&all, &cube.mesh, &reliefs).expect("small").len(), 24 + 2);
    }
}

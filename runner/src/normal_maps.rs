//! The maps that two methods read beside height maps, of normals and of Blinn's offsets: made from the height maps
//! where none is given, and only for these methods.

use crate::heights::grown;
use crate::render::RenderError;
use crate::scene::image::{VectorMap, load_vector_map};
use crate::scene::{HeightMap, Mesh, Relief, SceneError};
use crate::settings::{Method, Settings};
use emboss_kernels::interface::{normal_space, wrap};
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
    width: u32,
    height: u32,
    texels: Arc<Vec<u32>>,
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
    /// Reads a picture whose red, green and blue, from 0 to 1, are the components of a normal from -1 to 1.
    ///
    /// # Errors
    /// Where the file cannot be read, or has fewer than three channels.
    pub fn load(path: &Path, space: NormalSpace) -> Result<NormalMap, SceneError> {
        let VectorMap { channels: [x, y, z], .. } = load_vector_map(path, Some(0.5))?;
        let (width, height) = (x.width, x.height);
        let texel = |i: u32| {
            let (column, row) = (i % width, i / width);
            let channels = Vec3::new(x.texel(column, row), y.texel(column, row), z.texel(column, row));
            normal_words(channels * 2.0 - Vec3::ONE)
        };
        let texels = (0..width * height).flat_map(texel).collect();
        Ok(NormalMap { space, width, height, texels: Arc::new(texels) })
    }
}

/// The words of the maps that the settings' method reads, one for each of the reliefs; none where it reads none.
///
/// # Errors
/// [`RenderError::MapsTooLarge`] where they are more than 32 bits can number.
pub fn pack(settings: &Settings, mesh: &Mesh, reliefs: &[Relief]) -> Result<Vec<u32>, RenderError> {
    let mut texels = Vec::new();
    if !matches!(settings.method, Method::BumpOffset | Method::NormalMap) {
        return Ok(texels);
    }
    let given = settings.normal_map.as_ref().filter(|_| settings.method == Method::NormalMap);
    let mut words = 0;
    grown(&mut words, u64::from(HEADER_WORDS) * reliefs.len() as u64)?;
    let mut headers: Vec<u32> = Vec::with_capacity(words as usize);
    for (index, relief) in (0..).zip(reliefs) {
        let wrap = relief.wrap.unwrap_or(settings.wrap).id();
        let (width, height) =
            given.map_or((relief.map.width, relief.map.height), |map| (map.width, map.height));
        let is_first = index == 0 || given.is_none();
        let size = 2 * u64::from(width) * u64::from(height);
        let first = if is_first { grown(&mut words, size)? } else { headers[0] };
        // Normals of height maps lean as the scale says, which may change; those that are given lean as they are.
        let made_for = if relief.scale == 0.0 { 1.0 } else { relief.scale };
        let scale = if given.is_some() { 0.0 } else { made_for };
        let space = given.map_or(normal_space::TANGENT, |map| map.space.id());
        headers.extend([first, width, height, wrap, scale.to_bits(), space]);
        match given {
            Some(map) if is_first => texels.extend_from_slice(&map.texels),
            Some(_) => {}
            None => texels.extend(derived(settings.method, mesh, index, relief, scale, wrap)),
        }
    }
    headers.append(&mut texels);
    Ok(headers)
}

/// Whether the settings' method reads normals that are along the tangents of vertices.
pub fn needs_tangents(settings: &Settings) -> bool {
    let space = settings.normal_map.as_ref().map_or(NormalSpace::Tangent, |map| map.space);
    settings.method == Method::NormalMap && space == NormalSpace::Tangent
}

/// A map made of a height map: its derivatives, or the normals of its slopes on a surface with the mean size of texels.
fn derived(method: Method, mesh: &Mesh, index: u32, relief: &Relief, scale: f32, wrap: u32) -> Vec<u32> {
    let map = &relief.map;
    let lengths = mean_lengths(mesh, index);
    let words = |i: u32| {
        let gradient = gradient(map, i % map.width, i / map.width, wrap);
        if method == Method::BumpOffset {
            [gradient.x.to_bits(), gradient.y.to_bits()]
        } else {
            normal_words((-gradient * scale / lengths).extend(1.0).normalize())
        }
    };
    (0..map.width * map.height).flat_map(words).collect()
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
        let map = NormalMap::load(&path, NormalSpace::World).expect("a picture of three channels");
        assert_eq!((map.width, map.height), (2, 1));
        // -1, 1, -0.6; 1, -0.2, -1: in steps of 1 / 32767 from 32768, rounded.
        let words = [1 | 65535 << 16, 13108, 65535 | 26215 << 16, 1];
        assert_eq!(map.texels[..], words);
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
                needs_tangents(&settings),
                method == Method::NormalMap && settings.normal_map.is_none()
            );
            words
        };
        let texels = (relief.map.width * relief.map.height) as usize;
        assert_eq!(words(Method::NormalMap, None), 2 * (6 + 2 * texels));
        assert_eq!(words(Method::BumpOffset, None), 2 * (6 + 2 * texels));
        let given =
            NormalMap { space: NormalSpace::World, width: 3, height: 2, texels: Arc::new(vec![0; 12]) };
        assert_eq!(words(Method::NormalMap, Some(given)), 2 * 6 + 12);
        assert_eq!(
            [Method::Quadtree, Method::Bump, Method::Relief].map(|method| words(method, None)),
            [0; 3]
        );
    }
}

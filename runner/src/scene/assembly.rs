//! Models and their materials put together to a scene: each image is read once, however many materials name it.

use super::image::{VectorMap, load_color_map, load_height_map, load_vector_map};
use super::precise::bounds;
use super::{ColorMap, HeightMap, Material, Mesh, Relief, SceneError};
use crate::instances::Part;
use crate::normal_maps::{NormalMap, NormalSpace};
use crate::settings::{ChannelOrder, DisplacementKind, Wrap};
use crate::space::{RenderSpace, exponent_of, origin_of};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Where a map comes from.
#[derive(Clone, Debug)]
pub enum MapSource<T> {
    /// An image file.
    File(PathBuf),
    /// A map made by code.
    Made {
        /// What users know it by.
        name: String,
        /// The map.
        map: Arc<T>,
    },
}

impl<T> MapSource<T> {
    /// What users know it by.
    pub fn name(&self) -> String {
        match self {
            MapSource::File(path) => path.display().to_string(),
            MapSource::Made { name, .. } => name.clone(),
        }
    }
}

/// A material before its files are read.
#[derive(Clone, Debug)]
pub struct MaterialSource {
    /// Linear RGB without a colour map; `None`: light grey.
    pub albedo: Option<Vec3>,
    /// The colour map.
    pub color: Option<MapSource<ColorMap>>,
    /// How it is read outside [0,1); `None`: as the settings say.
    pub color_wrap: Option<Wrap>,
    /// The height map; in a scene of vectors a file is a vector map.
    pub height: Option<MapSource<HeightMap>>,
    /// What a vector map made by code has along tangent and bitangent; `height` is along the normal.
    pub sideways: Option<[Arc<HeightMap>; 2]>,
    /// How it is read outside [0,1); `None`: as the settings say.
    pub height_wrap: Option<Wrap>,
    /// The texel value of no displacement; `None`: mid-grey, so that a model keeps its size, and of vector maps of
    /// floats 0.
    pub zero: Option<f32>,
    /// Height of a texel step from 0 to 1, in scene units.
    pub scale: f32,
    /// Whether each texel t of the height map is replaced by 1 - t.
    pub invert: bool,
    /// The normal map of `--method normal-map`; not read in a scene of vectors.
    pub normal: Option<NormalSource>,
}

/// A normal map before its file is read.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalSource {
    /// The image.
    pub path: PathBuf,
    /// What its components are along.
    pub space: NormalSpace,
    /// How it is read outside [0,1); `None`: as the settings say.
    pub wrap: Option<Wrap>,
}

impl MaterialSource {
    /// Reads all its maps outside [0,1) that way.
    pub fn set_wrap(&mut self, wrap: Wrap) {
        (self.color_wrap, self.height_wrap) = (Some(wrap), Some(wrap));
        if let Some(normal) = &mut self.normal {
            normal.wrap = Some(wrap);
        }
    }

    /// The texel value of no displacement of a height map.
    fn zero(&self) -> f32 {
        self.zero.unwrap_or(ZERO)
    }
}

/// The texel value of no displacement of height maps unless said otherwise.
pub const ZERO: f32 = 0.5;

/// A material of a scene that is being put together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaterialId {
    relief: u32,
    material: u32,
}

/// A scene that is being put together.
#[derive(Debug)]
pub struct Assembly {
    kind: DisplacementKind,
    /// Which channels of vector maps are along which axes.
    channels: ChannelOrder,
    /// Meshes that stand as they are.
    meshes: Vec<Mesh>,
    /// Meshes that stand in places of their own.
    placed: Vec<(Mesh, Vec<DAffine3>)>,
    /// Of vectors three each.
    reliefs: Vec<Relief>,
    materials: Vec<Material>,
    /// Which relief, or which three from there on, is that of materials without a height map.
    flat: Option<u32>,
    /// The reliefs of those that have a normal map in its place.
    flat_normals: Vec<u32>,
    colors: HashMap<PathBuf, Arc<ColorMap>>,
    /// By file, and whether they are inverted.
    heights: HashMap<(PathBuf, bool), LoadedHeight>,
    vectors: HashMap<PathBuf, LoadedVectors>,
    normals: Vec<(NormalSource, NormalMap)>,
}

/// A height map out of a file.
#[derive(Clone, Debug)]
struct LoadedHeight {
    map: Arc<HeightMap>,
    /// What stands for texels that are NaN or infinite.
    zero: f32,
}

/// A vector map out of a file.
#[derive(Clone, Debug)]
struct LoadedVectors {
    channels: [Arc<HeightMap>; 3],
    /// The texel value of no displacement, also of texels that are NaN or infinite.
    zero: f32,
    /// What was asked for.
    asked: Option<f32>,
}

impl Assembly {
    /// A scene of nothing. `channels` is read where texels are vectors.
    pub fn new(kind: DisplacementKind, channels: ChannelOrder) -> Assembly {
        Assembly {
            kind,
            channels,
            meshes: Vec::new(),
            placed: Vec::new(),
            reliefs: Vec::new(),
            materials: Vec::new(),
            flat: None,
            flat_normals: Vec::new(),
            colors: HashMap::new(),
            heights: HashMap::new(),
            vectors: HashMap::new(),
            normals: Vec::new(),
        }
    }

    /// Adds a material, or finds the same one. Its files are read if they are new.
    ///
    /// # Errors
    /// What is wrong with a file.
    pub fn material(&mut self, source: &MaterialSource) -> Result<MaterialId, SceneError> {
        let material = Material {
            albedo: source.albedo.unwrap_or(Material::default().albedo),
            color: source.color.as_ref().map(|map| self.color_map(map)).transpose()?,
            wrap: source.color_wrap,
        };
        let relief = self.relief(source)?;
        let is_same = |other: &Material| {
            let same_map = match (&other.color, &material.color) {
                (Some(other), Some(map)) => Arc::ptr_eq(other, map),
                (None, None) => true,
                _ => false,
            };
            same_map && (other.albedo, other.wrap) == (material.albedo, material.wrap)
        };
        let known = self.materials.iter().position(is_same);
        Ok(MaterialId { relief, material: place(&mut self.materials, known, [material]) })
    }

    /// Adds a mesh that does not weld with those before it. Its triangles name their materials by indices into
    /// `materials`.
    ///
    /// # Panics
    /// Where they name one that is not there.
    pub fn add(&mut self, mesh: Mesh, materials: &[MaterialId]) {
        self.meshes.push(with_materials(mesh, materials));
    }

    /// Adds a mesh that stands in `places` and is stored once; as [`add`](Self::add).
    ///
    /// # Panics
    /// As that.
    pub fn add_placed(&mut self, mesh: Mesh, materials: &[MaterialId], places: Vec<DAffine3>) {
        self.placed.push((with_materials(mesh, materials), places));
    }

    /// The scene, in a render space of its own ([`RenderSpace`]): about its middle ([`origin_of`]), and such that the
    /// greatest coordinate of its mesh is from 1 to 2. Where meshes have places of their own, that is the one of the
    /// smallest mesh, unless the scene then reaches beyond 2^21.
    ///
    /// A mesh that lies farther from the middle of all than [`MOST_EXTENTS`] times its own size is given a place of its
    /// own, so that it keeps its digits.
    pub fn finish(self, subdivisions: u32) -> crate::render::Scene {
        let parts = self.parts();
        let Assembly { meshes, placed, mut reliefs, materials, flat, flat_normals, .. } = self;
        let (mut mesh, mut instanced) = joined(meshes, placed);
        rescale(&mut mesh, &mut instanced, &mut reliefs);
        // A single texel 0 is the same in all formats and under all wraps: it takes those of a real map, so that
        // pipelines need not know of two.
        let with_parts = |flat: u32| flat as usize..flat as usize + parts;
        let mut flats: Vec<usize> = flat.into_iter().flat_map(with_parts).collect();
        flats.extend(flat_normals.into_iter().map(|flat| flat as usize));
        let real = reliefs.iter().enumerate().find(|(i, _)| !flats.contains(i));
        if let Some((format, wrap)) = real.map(|(_, relief)| (relief.map.format, relief.wrap)) {
            let map = Arc::new(HeightMap { format, ..HeightMap::flat(0.0) });
            for flat in flats {
                let Relief { scale, normal_map, .. } = reliefs[flat].clone();
                reliefs[flat] = Relief { wrap, normal_map, ..Relief::new(Arc::clone(&map), 0.0, scale) };
            }
        }
        crate::render::Scene { mesh, reliefs, materials, parts: instanced, subdivisions }
    }

    /// How many reliefs a displacement takes.
    fn parts(&self) -> usize {
        if self.kind == DisplacementKind::Height { 1 } else { 3 }
    }

    /// The index of a material's relief, or of the first of its three, added where they are new.
    fn relief(&mut self, source: &MaterialSource) -> Result<u32, SceneError> {
        let &MaterialSource { scale, height_wrap: wrap, .. } = source;
        let name = source.height.as_ref().map(MapSource::name);
        let relief = |map: Arc<HeightMap>, zero, scale| Relief {
            wrap,
            name: name.clone(),
            ..Relief::new(map, zero, scale)
        };
        let normal_map = source.normal.as_ref().filter(|_| self.kind == DisplacementKind::Height);
        let normal_map = normal_map.map(|normal| self.normal_map(normal)).transpose()?;
        if let (None, Some(_)) = (&source.height, &normal_map) {
            let flat = Relief::new(HeightMap::flat(source.zero()), source.zero(), scale);
            let is_same = |&flat: &u32| self.reliefs[flat as usize].normal_map == normal_map;
            let known = self.flat_normals.iter().copied().find(is_same);
            let flat = Relief { normal_map, ..flat };
            let flat = place(&mut self.reliefs, known.map(|flat| flat as usize), [flat]);
            self.flat_normals.push(flat);
            return Ok(flat);
        }
        let Some(height) = &source.height else {
            let flat = Relief::new(HeightMap::flat(source.zero()), source.zero(), scale);
            let (known, flats) = (self.flat.map(|flat| flat as usize), vec![flat; self.parts()]);
            let flat = place(&mut self.reliefs, known, flats);
            self.flat = Some(flat);
            return Ok(flat);
        };
        let reliefs = if self.kind == DisplacementKind::Height {
            let map = self.height_map(height, source)?;
            vec![Relief {
                stem: stem(height, source.invert),
                normal_map,
                ..relief(map, source.zero(), scale)
            }]
        } else if let MapSource::File(path) = height {
            let LoadedVectors { channels, zero, .. } = self.vector_map(path, source.zero)?;
            let axes = self.channels.axes(self.kind);
            axes.map(|(channel, sign)| relief(Arc::clone(&channels[channel]), zero, sign * scale)).into()
        } else {
            let normal = self.height_map(height, source)?;
            // A map of heights displaces along the normal alone.
            let (sideways, share) = match &source.sideways {
                Some(maps) => (maps.clone(), scale),
                None => ([Arc::clone(&normal), Arc::clone(&normal)], 0.0),
            };
            let [tangent, bitangent] = sideways.map(|map| relief(map, source.zero(), share));
            vec![tangent, bitangent, relief(normal, source.zero(), scale)]
        };
        let is_same = |(other, relief): (&Relief, &Relief)| {
            Arc::ptr_eq(&other.map, &relief.map)
                && (other.zero, other.scale, other.wrap) == (relief.zero, relief.scale, relief.wrap)
                && other.normal_map == relief.normal_map
        };
        let known = self.reliefs.windows(reliefs.len()).step_by(reliefs.len());
        let known = known.map(|window| window.iter().zip(&reliefs).all(is_same)).position(|same| same);
        Ok(place(&mut self.reliefs, known.map(|group| group * reliefs.len()), reliefs))
    }

    fn normal_map(&mut self, source: &NormalSource) -> Result<NormalMap, SceneError> {
        let key = NormalSource { path: identity(&source.path), ..source.clone() };
        if let Some((_, map)) = self.normals.iter().find(|(known, _)| *known == key) {
            return Ok(map.clone());
        }
        let map = NormalMap::load(&source.path, source.space, source.wrap)?;
        self.normals.push((key, map.clone()));
        Ok(map)
    }

    fn vector_map(&mut self, path: &Path, asked: Option<f32>) -> Result<LoadedVectors, SceneError> {
        let key = identity(path);
        // What stands for bad texels is the material's own.
        if let Some(known) = self.vectors.get(&key).filter(|known| known.asked == asked) {
            return Ok(known.clone());
        }
        let VectorMap { channels, zero } = load_vector_map(path, asked)?;
        // The channels of a vector map are alike in what is warned of.
        warn_of_map(path, &channels[0]);
        let loaded = LoadedVectors { channels: channels.map(Arc::new), zero, asked };
        self.vectors.insert(key, loaded.clone());
        Ok(loaded)
    }

    fn color_map(&mut self, source: &MapSource<ColorMap>) -> Result<Arc<ColorMap>, SceneError> {
        let path = match source {
            MapSource::Made { map, .. } => return Ok(Arc::clone(map)),
            MapSource::File(path) => path,
        };
        let key = identity(path);
        if let Some(map) = self.colors.get(&key) {
            return Ok(Arc::clone(map));
        }
        let map = Arc::new(load_color_map(path)?);
        self.colors.insert(key, Arc::clone(&map));
        Ok(map)
    }

    fn height_map(
        &mut self,
        source: &MapSource<HeightMap>,
        material: &MaterialSource,
    ) -> Result<Arc<HeightMap>, SceneError> {
        let (zero, invert) = (material.zero(), material.invert);
        let path = match source {
            MapSource::Made { map, .. } if invert => return Ok(Arc::new(map.inverted())),
            MapSource::Made { map, .. } => return Ok(Arc::clone(map)),
            MapSource::File(path) => path,
        };
        let key = (identity(path), invert);
        // What stands for bad texels is the material's own.
        let known = self.heights.get(&key).filter(|known| known.map.replaced == 0 || known.zero == zero);
        if let Some(known) = known {
            return Ok(Arc::clone(&known.map));
        }
        let map = Arc::new(load_height_map(path, zero, invert)?);
        warn_of_map(path, &map);
        self.heights.insert(key, LoadedHeight { map: Arc::clone(&map), zero });
        Ok(map)
    }
}

/// The index of items: the known one, or that of the first of `new`, added.
fn place<T>(items: &mut Vec<T>, known: Option<usize>, new: impl IntoIterator<Item = T>) -> u32 {
    let index = known.unwrap_or_else(|| {
        let first = items.len();
        items.extend(new);
        first
    });
    u32::try_from(index).expect("materials are fewer than the lines of the files that name them")
}

/// How the files begin that keep what is computed of a map.
fn stem(map: &MapSource<HeightMap>, invert: bool) -> Option<PathBuf> {
    let MapSource::File(path) = map else { return None };
    let mut stem = path.clone().into_os_string();
    stem.push(if invert { ".inverted" } else { "" });
    Some(stem.into())
}

/// What two names of one file have in common.
fn identity(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_owned())
}

/// One line for each thing about a height map that may surprise in the picture.
fn warn_of_map(path: &Path, map: &HeightMap) {
    let shown = path.display();
    if map.has_steps() {
        tracing::warn!(
            "{shown}: has 8 bits, so that slopes come in 256 steps; a map of 16 bits or floats is smooth"
        );
    }
    if map.replaced > 0 {
        tracing::warn!("{shown}: {} texels are NaN or infinite; they do not displace", map.replaced);
    }
}

/// The mesh with its triangles' own materials in the place of indices into `materials`.
fn with_materials(mesh: Mesh, materials: &[MaterialId]) -> Mesh {
    mesh.with_ids(|i| {
        let MaterialId { relief, material } = materials[i as usize];
        (relief, material)
    })
}

/// Farther from the middle of all meshes than so many times its size, a mesh has a place of its own: its coordinates
/// keep at least 16 bits of its size otherwise.
pub const MOST_EXTENTS: f64 = 256.0;

/// All meshes one behind the other, and where each stands in the world less the mesh's origin; nowhere else than it is
/// where none is placed.
fn joined(meshes: Vec<Mesh>, placed: Vec<(Mesh, Vec<DAffine3>)>) -> (Mesh, Vec<Part>) {
    let (near, far) = split(meshes);
    let far = far.into_iter().map(|mesh| (mesh, vec![DAffine3::IDENTITY]));
    let mut placed: Vec<_> = far.chain(placed).collect();
    let as_it_is = near.unwrap_or_default();
    if placed.is_empty() {
        return (as_it_is, Vec::new());
    }
    if !as_it_is.triangles.is_empty() {
        placed.insert(0, (as_it_is, vec![DAffine3::IDENTITY]));
    }
    let world = placed.iter().filter_map(|(mesh, places)| Some((mesh.world_bounds()?, places)));
    let corners = world.flat_map(|((min, max), places)| {
        places.iter().flat_map(move |place| corners(min, max).map(|corner| place.transform_point3(corner)))
    });
    let origin = bounds(corners).map_or(DVec3::ZERO, |(min, max)| origin_of(min, max));
    let (mut whole, mut parts) = (Mesh::default(), Vec::new());
    for (mesh, places) in placed {
        // Meshes have 32-bit indices.
        let triangle_count = u32::try_from(mesh.triangles.len()).unwrap_or(u32::MAX);
        let of_mesh = |place: DAffine3| {
            let translation = place.transform_point3(mesh.space.origin) - origin;
            DAffine3::from_mat3_translation(place.matrix3, translation)
        };
        parts.push(Part { triangle_count, places: places.into_iter().map(of_mesh).collect() });
        whole.append(Mesh { space: RenderSpace::default(), ..mesh });
    }
    whole.space.origin = origin;
    (whole, parts)
}

/// The meshes that can share an origin, joined about it to one, where there are any; and the others.
fn split(meshes: Vec<Mesh>) -> (Option<Mesh>, Vec<Mesh>) {
    let box_of_all = |meshes: &[Mesh]| {
        let corners = meshes.iter().filter_map(Mesh::world_bounds).flat_map(|(min, max)| [min, max]);
        bounds(corners).map_or(DVec3::ZERO, |(min, max)| origin_of(min, max))
    };
    let origin = box_of_all(&meshes);
    let is_far = |mesh: &Mesh| {
        mesh.world_bounds().is_some_and(|(min, max)| {
            let reach = (min - origin).abs().max((max - origin).abs()).max_element();
            reach > MOST_EXTENTS * (max - min).max_element()
        })
    };
    if meshes.len() < 2 {
        return (meshes.into_iter().next(), Vec::new());
    }
    let (mut far, near): (Vec<Mesh>, Vec<Mesh>) = meshes.into_iter().partition(is_far);
    let space = RenderSpace { origin: box_of_all(&near), exponent: 0 };
    let mut joined: Option<Mesh> = None;
    for mesh in near {
        let kept = mesh.in_space(space).filter(|moved| moved.collapsed == mesh.collapsed);
        match (kept, &mut joined) {
            // Its triangles are so small that some would vanish.
            (None, _) => far.push(mesh),
            (Some(moved), None) => joined = Some(moved),
            (Some(moved), Some(joined)) => joined.append(moved),
        }
    }
    (joined, far)
}

/// The corners of a box.
fn corners(min: DVec3, max: DVec3) -> [DVec3; 8] {
    std::array::from_fn(|i| DVec3::select(glam::BVec3::new(i & 1 != 0, i & 2 != 0, i & 4 != 0), max, min))
}

/// How far a scene with places reaches in its render space, as an exponent, where its smallest mesh can reach 1.
const MOST_REACH: i32 = 20;

/// Multiplies all lengths of a scene by a power of two: see [`Assembly::finish`].
#[expect(
    clippy::cast_possible_truncation,
    reason = "of a power of two times a float, which is rounded if it is tiny"
)]
fn rescale(mesh: &mut Mesh, parts: &mut [Part], reliefs: &mut [Relief]) {
    let reach = |vertices: &mut dyn Iterator<Item = Vec3>| {
        f64::from(vertices.fold(0.0_f32, |reach, p| reach.max(p.abs().max_element())))
    };
    let mut rest = &mesh.triangles[..];
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    for part in &*parts {
        let triangles;
        (triangles, rest) = rest.split_at((part.triangle_count as usize).min(rest.len()));
        let positions = triangles.iter().flat_map(|t| t.vertices).map(|v| mesh.vertices[v as usize].position);
        let own = reach(&mut positions.into_iter());
        least = least.min(own);
        let far = |place: &DAffine3| place.translation.abs().max_element() + own * row_sum(place.matrix3);
        most = part.places.iter().map(far).fold(most.max(own), f64::max);
    }
    if parts.is_empty() {
        least = reach(&mut mesh.vertices.iter().map(|vertex| vertex.position));
        most = least;
    }
    if !(least.is_finite() && most.is_finite() && least > 0.0) {
        return;
    }
    let exponent = (-exponent_of(least)).min(MOST_REACH - exponent_of(most));
    let factor = 2_f64.powi(exponent);
    let scaled = |x: f32| (f64::from(x) * factor) as f32;
    for vertex in &mut mesh.vertices {
        vertex.position = vertex.position.map(scaled);
    }
    for relief in reliefs {
        relief.scale = scaled(relief.scale);
    }
    for place in parts.iter_mut().flat_map(|part| &mut part.places) {
        place.translation *= factor;
    }
    mesh.space.exponent += exponent;
}

/// The greatest sum of magnitudes in a row: no coordinate grows by more.
fn row_sum(m: DMat3) -> f64 {
    (m.x_axis.abs() + m.y_axis.abs() + m.z_axis.abs()).max_element()
}

#[cfg(test)]
mod tests {
    use super::*;
    use emboss_kernels::interface::{Vertex, height_format};

    fn source(height: Option<&Path>) -> MaterialSource {
        MaterialSource {
            albedo: None,
            color: None,
            color_wrap: None,
            height: height.map(|path| MapSource::File(path.to_owned())),
            height_wrap: None,
            sideways: None,
            zero: Some(0.5),
            scale: 1.0,
            invert: false,
            normal: None,
        }
    }

    fn heights() -> Assembly {
        Assembly::new(DisplacementKind::Height, ChannelOrder::Blender)
    }

    /// A folder with two images of eight bits.
    fn images() -> (tempfile::TempDir, PathBuf, PathBuf) {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [a, b] = ["a.png", "b.png"].map(|name| folder.path().join(name));
        for path in [&a, &b] {
            image::GrayImage::from_pixel(3, 2, image::Luma([9])).save(path).expect("written");
        }
        (folder, a, b)
    }

    #[test]
    fn an_image_is_read_once_whatever_it_is_called() {
        let (folder, a, _) = images();
        std::fs::create_dir(folder.path().join("sub")).expect("writable");
        let same = folder.path().join("sub/../a.png");
        let color = |path: &Path| Some(MapSource::File(path.to_owned()));
        let mut assembly = heights();
        let first = MaterialSource { color: color(&a), ..source(Some(&a)) };
        let sources = [
            first.clone(),
            MaterialSource { color: color(&same), ..source(Some(&same)) },
            MaterialSource { zero: Some(0.25), ..first.clone() },
            MaterialSource { invert: true, color_wrap: Some(Wrap::Clamp), ..first },
        ];
        let ids = sources.map(|source| assembly.material(&source).expect("an image"));
        assert_eq!(ids[0], ids[1]);
        assert_ne!(ids[0], ids[2]);
        assert_eq!((assembly.reliefs.len(), assembly.materials.len()), (3, 2));
        let reliefs = &assembly.reliefs;
        assert!(
            Arc::ptr_eq(&reliefs[0].map, &reliefs[1].map) && !Arc::ptr_eq(&reliefs[0].map, &reliefs[2].map)
        );
        let [one, other] = [0, 1].map(|i| assembly.materials[i].color.clone().expect("a map"));
        assert!(Arc::ptr_eq(&one, &other));
    }

    /// Bad texels count as the material's zero, so that there are as many maps as zeros.
    #[test]
    fn images_with_bad_texels_are_read_for_each_zero() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("bad.exr");
        image::Rgb32FImage::from_pixel(1, 1, image::Rgb([f32::NAN; 3])).save(&path).expect("written");
        let mut assembly = heights();
        for zero in [0.5, 0.25, 0.25] {
            assembly.material(&MaterialSource { zero: Some(zero), ..source(Some(&path)) }).expect("an image");
        }
        let texels: Vec<_> = assembly.reliefs.iter().map(|relief| relief.map.texel(0, 0)).collect();
        assert_eq!(texels, [0.5, 0.25]);
    }

    /// Materials without a height map cost no second format.
    #[test]
    fn flat_materials_are_stored_as_the_others() {
        let (_folder, a, _) = images();
        let mut assembly = heights();
        let mapped = MaterialSource { height_wrap: Some(Wrap::Mirror), ..source(Some(&a)) };
        for source in [source(None), mapped, MaterialSource { scale: 7.0, ..source(None) }] {
            assembly.material(&source).expect("sound");
        }
        let scene = assembly.finish(1);
        assert_eq!(scene.reliefs.len(), 2);
        let flat = &scene.reliefs[0];
        assert_eq!((flat.map.format, flat.wrap), (height_format::UNORM8, Some(Wrap::Mirror)));
        assert_eq!(flat.map.texel(0, 0) - flat.zero, 0.0);
    }

    /// A height map that two materials light differently is there once, but displaces twice; so does none at all.
    #[test]
    fn materials_have_normal_maps_of_their_own() {
        let (folder, a, b) = images();
        let normals = folder.path().join("n.png");
        image::RgbImage::from_pixel(1, 1, image::Rgb([128, 128, 255])).save(&normals).expect("writable");
        let lit_by = |height, wrap| MaterialSource {
            normal: Some(NormalSource { path: normals.clone(), space: NormalSpace::Tangent, wrap }),
            ..source(height)
        };
        let clamp = Some(Wrap::Clamp);
        let sources = [
            source(Some(&a)),
            lit_by(Some(&a), None),
            lit_by(Some(&a), clamp),
            lit_by(Some(&a), None),
            source(None),
            lit_by(None, None),
            lit_by(None, clamp),
            lit_by(None, None),
        ];
        let mut assembly = heights();
        let reliefs = sources.map(|source| assembly.material(&source).expect("images").relief);
        assert_eq!(reliefs, [0, 1, 2, 1, 3, 4, 5, 4]);
        let reliefs = assembly.finish(1).reliefs;
        assert!(Arc::ptr_eq(&reliefs[0].map, &reliefs[2].map));
        let normals: Vec<_> = reliefs.iter().map(|relief| relief.normal_map.is_some()).collect();
        assert_eq!(normals, [false, true, true, false, true, true]);
        assert!(
            reliefs[1].normal_map == reliefs[4].normal_map && reliefs[1].normal_map != reliefs[2].normal_map
        );
        assert!(reliefs.iter().all(|relief| relief.map.format == height_format::UNORM8));
        // Vectors have no use for it, and do not read it.
        let missing = NormalSource { path: b.with_extension("no"), space: NormalSpace::Tangent, wrap: None };
        let missing = MaterialSource { normal: Some(missing), ..source(None) };
        assert!(heights().material(&missing).is_err());
        let mut vectors = Assembly::new(DisplacementKind::Object, ChannelOrder::Blender);
        assert!(vectors.material(&missing).is_ok());
    }

    /// Three reliefs a vector map, in the order of axes, with its own zero.
    #[test]
    fn vector_maps_are_three_reliefs() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("v.exr");
        image::Rgb32FImage::from_pixel(1, 1, image::Rgb([1.0, 2.0, 3.0])).save(&path).expect("written");
        let mut assembly = Assembly::new(DisplacementKind::Tangent, ChannelOrder::Blender);
        let of_file = MaterialSource { zero: None, ..source(Some(&path)) };
        let wrapped = MaterialSource { height_wrap: Some(Wrap::Clamp), ..of_file.clone() };
        let sources = [source(None), of_file.clone(), wrapped, of_file, source(None)];
        let ids = sources.map(|source| assembly.material(&source).expect("sound").relief);
        assert_eq!(ids, [0, 3, 6, 3, 0]);
        let reliefs = assembly.finish(1).reliefs;
        let texels: Vec<_> = reliefs.iter().map(|relief| relief.map.texel(0, 0)).collect();
        assert_eq!(texels, [0.0, 0.0, 0.0, 1.0, 3.0, 2.0, 1.0, 3.0, 2.0]);
        assert!(reliefs.iter().all(|relief| relief.zero == 0.0));
        assert!(Arc::ptr_eq(&reliefs[3].map, &reliefs[6].map));
    }

    /// Three maps of one size, as the backend asks, of which one displaces.
    #[test]
    fn heights_made_by_code_are_vectors_along_the_normal() {
        let map = Arc::new(HeightMap { width: 2, texels: vec![0; 2], ..HeightMap::flat(0.0) });
        let height = Some(MapSource::Made { name: "code".into(), map: Arc::clone(&map) });
        let mut assembly = Assembly::new(DisplacementKind::Tangent, ChannelOrder::Blender);
        assembly.material(&MaterialSource { height, ..source(None) }).expect("no file");
        let reliefs = assembly.finish(1).reliefs;
        assert_eq!(reliefs.iter().map(|relief| relief.scale).collect::<Vec<_>>(), [0.0, 0.0, 1.0]);
        assert!(reliefs.iter().all(|relief| relief.map.width == 2));
    }

    #[test]
    fn triangles_name_what_their_materials_became() {
        let (_folder, a, b) = images();
        let corner = |x, y| Vertex { position: Vec3::new(x, y, 0.0), ..Vertex::default() };
        let vertices = [corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0)];
        let mesh = Mesh::with_materials(&vertices, [([0, 1, 2], 1), ([2, 1, 0], 0)].into_iter());
        let mut assembly = heights();
        let sources = [source(Some(&b)), MaterialSource { albedo: Some(Vec3::X), ..source(Some(&a)) }];
        let ids: Vec<_> = sources.iter().map(|source| assembly.material(source).expect("an image")).collect();
        assembly.add(mesh, &[ids[1], ids[0]]);
        let triangles = assembly.finish(1).mesh.triangles;
        let named: Vec<_> = triangles.iter().map(|t| (t.material(), t.displacement, t.flags & 1)).collect();
        assert_eq!(named, [(0, 0, 0), (1, 1, 1)]);
    }
}

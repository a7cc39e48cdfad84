//! Scenes for tests, made ready for a backend.

use crate::Numbers;
use emboss::backend::host_scene::HostScene;
use emboss::bvh::Bvh;
use emboss::framing::View;
use emboss::render::{Job, Scene, prepare};
use emboss::scene::builtin::{self, BuiltinScene};
use emboss::scene::{HeightMap, Material, Mesh, Relief};
use emboss::settings::{Bounds, DisplacementKind, Light, Method, Settings, Wrap};
use emboss_kernels::aabb::Aabb;
use emboss_kernels::interface::{Camera, PointLight, Vertex, height_format};
use emboss_kernels::scene::{Features, SceneView};
use glam::{Quat, Vec3};
use std::ops::Deref;

/// The methods in image space.
pub const IMAGE_SPACE: [Method; 10] = [
    Method::Bump,
    Method::BumpOffset,
    Method::NormalMap,
    Method::Parallax,
    Method::ParallaxLimited,
    Method::Steep,
    Method::Relief,
    Method::Occlusion,
    Method::Pyramid,
    Method::Sphere,
];

/// A scene whose only relief is displaced by `scale`.
pub fn scaled(mut scene: Scene, scale: f32) -> Scene {
    scene.reliefs[0].scale = scale;
    scene
}

/// A built-in scene without its colours, subdivided N times and displaced by `scale`.
///
/// # Panics
/// Where there is no scene of that name.
pub fn builtin(name: &str) -> Scene {
    let Some(BuiltinScene { mesh, height, zero, scale, subdivisions, .. }) = builtin::load(name) else {
        panic!("{name} is no built-in scene")
    };
    Scene {
        mesh,
        reliefs: vec![Relief::new(height, zero, scale)],
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions,
    }
}

/// `builtin:mushroom` without its colours, subdivided N times: its vector map's three reliefs.
///
/// # Panics
/// Never: there is such a scene.
pub fn mushroom(subdivisions: u32) -> Scene {
    let builtin = builtin::load("builtin:mushroom").expect("a built-in scene");
    let maps = builtin.sideways.expect("its map is of vectors").into_iter().chain([builtin.height]);
    let reliefs = maps.map(|map| Relief::new(map, builtin.zero, builtin.scale)).collect();
    Scene { mesh: builtin.mesh, reliefs, materials: vec![Material::default()], parts: vec![], subdivisions }
}

/// The scene with vector maps for its height maps: two more of random texels to each, of its size and format, and of
/// the same zero and scale.
pub fn with_vectors(mut scene: Scene, numbers: &mut Numbers) -> Scene {
    let reliefs = std::mem::take(&mut scene.reliefs);
    for relief in reliefs {
        let sideways = [(); 2].map(|()| {
            let texels = relief.map.texels.iter().map(|_| match relief.map.format {
                height_format::FLOAT32 => numbers.unit().to_bits(),
                _ => numbers.word(),
            });
            let map = HeightMap { texels: texels.collect(), range: (0.0, 1.0), ..*relief.map };
            Relief { map: map.into(), ..relief.clone() }
        });
        scene.reliefs.extend(sideways);
        scene.reliefs.push(relief);
    }
    scene.mesh.triangles.iter_mut().for_each(|triangle| triangle.displacement *= 3);
    scene
}

/// Both kinds of vector displacement.
pub const VECTORS: [DisplacementKind; 2] = [DisplacementKind::Tangent, DisplacementKind::Object];

/// Built-in scene `name` in its colours with N = `subdivisions`, and the settings that show it as the command line
/// does, `width` by `height` pixels large.
///
/// # Panics
/// Where there is none of that name.
pub fn builtin_scene(name: &str, subdivisions: u32, width: u32, height: u32) -> (Scene, Settings) {
    let Some(builtin) = builtin::load(name) else { panic!("{name} is no built-in scene") };
    let scene = Scene {
        mesh: builtin.mesh,
        reliefs: vec![Relief::new(builtin.height, builtin.zero, builtin.scale)],
        materials: vec![builtin.color.into()],
        parts: vec![],
        subdivisions,
    };
    let view = View { from: builtin.view, usual_up: builtin.up, ..View::default() };
    let light = |light: PointLight| Light {
        position: light.position.as_dvec3(),
        color: light.color,
        intensity: Some(light.intensity),
    };
    let lights = builtin.lights.into_iter().map(light).collect();
    (scene, Settings { width, height, view, lights, ..Settings::default() })
}

/// A job with what the host makes of its scene. The view is framed by that, so that all backends have the same.
#[derive(Clone, Debug)]
pub struct ReadyJob {
    job: Job,
    scene: HostScene,
}

impl ReadyJob {
    /// The scene as the CPU's kernels see it.
    pub fn view(&self) -> SceneView<'_> {
        self.scene.view()
    }

    /// Takes the job's lights away; only ambient light is left.
    pub fn leave_no_light(&mut self) {
        self.job.buffers.lights.clear();
        self.job.frame.light_count = 0;
        self.scene.set_view(&self.job.frame, &[]).expect("the frame counts no light");
    }

    /// Puts the job's only light elsewhere.
    ///
    /// # Panics
    /// Where it has none.
    pub fn move_light(&mut self, position: Vec3) {
        self.job.buffers.lights[0].position = position;
        self.scene.set_view(&self.job.frame, &self.job.buffers.lights).expect("the light is the frame's");
    }

    /// Looks from so near, by pixels so wide, that where maps are filtered some places are read from the maps
    /// themselves and others from their levels: over the middle of the model a pixel covers four texels, or what is not
    /// too rough for that.
    ///
    /// # Panics
    /// Where maps are not filtered.
    pub fn look_from_near(&mut self) {
        let bounds = self.bounds();
        let (middle, extent) = ((bounds.min + bounds.max) * 0.5, bounds.max - bounds.min);
        let mut sizes: Vec<f32> = self.job.buffers.texel_scales.iter().map(|scale| scale.size).collect();
        sizes.sort_by(f32::total_cmp);
        let map = self.job.buffers.displacements[0];
        let texel = sizes[sizes.len() / 2].max(2.2 * (map.scale * map.roughness).abs());
        let frame = &mut self.job.frame;
        frame.camera.eye = middle + extent * Vec3::new(0.45, -0.3, 0.6);
        let reach = frame.height_min.abs().max(frame.height_max.abs());
        let distance = frame.camera.eye.distance(middle) - reach;
        frame.camera.up = Vec3::Y * (0.5 * frame.height as f32 * 4.0 * texel / distance);
        self.scene.set_view(&self.job.frame, &self.job.buffers.lights).expect("only the camera is another");
    }

    /// Looks from elsewhere at the origin, as wide as before.
    ///
    /// # Panics
    /// From straight above or below.
    pub fn look_from(&mut self, eye: Vec3) {
        let camera = &mut self.job.frame.camera;
        let forward = -eye.normalize();
        let right = forward.cross(Vec3::Y).normalize() * camera.right.length();
        let up = right.cross(forward).normalize() * camera.up.length();
        *camera = Camera { eye, right, up, forward, ..*camera };
        self.scene.set_view(&self.job.frame, &self.job.buffers.lights).expect("only the camera is another");
    }

    /// The same job by other code, with what the host makes of it then.
    ///
    /// # Panics
    /// Where that cannot be loaded.
    #[must_use]
    pub fn with_features(&self, features: Features) -> ReadyJob {
        let job = Job { features, ..self.job.clone() };
        let scene = HostScene::new(&job.buffers, &job.frame, features).expect("a sound scene");
        ReadyJob { job, scene }
    }

    /// The box of each prism.
    pub fn boxes(&self) -> &[Aabb] {
        self.scene.boxes()
    }

    /// The tree over them, or the trees.
    pub fn bvh(&self) -> &Bvh {
        self.scene.bvh()
    }

    /// The box around the displaced model.
    pub fn bounds(&self) -> Aabb {
        self.scene.bvh().bounds()
    }
}

impl Deref for ReadyJob {
    type Target = Job;

    fn deref(&self) -> &Job {
        &self.job
    }
}

/// What bounds may take where a test leaves it to the program: those of small meshes and N are stored, those of others
/// are not, so that tests see both, and none waits for millions of micro-triangles.
const BOUNDS: Bounds = Bounds::Mib(2);

/// A scene as a job.
///
/// # Panics
/// Where it cannot be framed: those of tests can.
pub fn job(scene: Scene, settings: &Settings) -> ReadyJob {
    let bounds = if settings.bounds == Bounds::Auto { BOUNDS } else { settings.bounds };
    let settings = &Settings { bounds, ..settings.clone() };
    let mut job = prepare(scene, settings).expect("sound maps");
    let mut scene = HostScene::new(&job.buffers, &job.frame, job.features)
        .unwrap_or_else(|error| panic!("the scene cannot be loaded: {error}"));
    job.frame_view(scene.boxes()).unwrap_or_else(|error| panic!("the scene cannot be framed: {error}"));
    scene.set_view(&job.frame, &job.buffers.lights).expect("the lights are the frame's");
    ReadyJob { job, scene }
}

/// Makes a scene ready for rays, its height map wrapped that way.
///
/// # Panics
/// Where it cannot be framed.
pub fn ready(scene: Scene, wrap: Wrap) -> ReadyJob {
    job(scene, &Settings { wrap, width: 1, height: 1, ..Settings::default() })
}

/// The same scene turned and moved.
pub fn moved(mut scene: Scene, rotation: Quat, translation: Vec3) -> Scene {
    for vertex in &mut scene.mesh.vertices {
        vertex.position = rotation * vertex.position + translation;
        vertex.normal = (rotation * vertex.normal).normalize();
    }
    scene
}

/// A level sheet of 4 x 4 squares with edges along the axes, all vertices shared, under a map of 7 x 7 random texels.
pub fn tiles() -> Scene {
    const SIDE: u16 = 4;
    let grid = (0..=SIDE).flat_map(|j| (0..=SIDE).map(move |i| (f32::from(i), f32::from(j))));
    let vertices: Vec<Vertex> = grid
        .map(|(x, y)| Vertex { position: Vec3::new(x, y, 0.0), normal: Vec3::Z, u: x / 4.0, v: y / 4.0 })
        .collect();
    let width = u32::from(SIDE) + 1;
    let squares = (0..u32::from(SIDE)).flat_map(|j| (0..u32::from(SIDE)).map(move |i| j * width + i));
    let triangles: Vec<[u32; 3]> =
        squares.flat_map(|a| [[a, a + 1, a + width + 1], [a, a + width + 1, a + width]]).collect();
    let mut numbers = Numbers::new(4);
    let texels: Vec<u32> = (0..49).map(|_| numbers.unit().to_bits()).collect();
    let format = height_format::FLOAT32;
    Scene {
        mesh: Mesh::from_triangles(&vertices, &triangles),
        reliefs: vec![Relief::new(
            HeightMap { width: 7, height: 7, format, texels, range: (0.0, 1.0), replaced: 0 },
            0.0,
            0.1,
        )],
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions: 1,
    }
}

/// A level sheet of 16 x 16 squares that do not touch under a map of two texels: squares lie on the one or the other by
/// turns, so that a scale lifts them into two layers.
pub fn checkered_sheet() -> Scene {
    const SIDE: u16 = 16;
    let corner = |i: u16, j: u16, x: u16, y: u16| Vertex {
        position: Vec3::new(f32::from(i) + 0.75 * f32::from(x), f32::from(j) + 0.75 * f32::from(y), 0.0),
        normal: Vec3::Z,
        // The middle of a texel.
        u: 0.25 + 0.5 * f32::from((i + j) % 2),
        v: 0.5,
    };
    let squares = (0..SIDE).flat_map(|j| (0..SIDE).map(move |i| (i, j)));
    let vertices: Vec<Vertex> = squares
        .flat_map(|(i, j)| [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| corner(i, j, x, y)))
        .collect();
    let triangles: Vec<[u32; 3]> = (0..u32::from(SIDE * SIDE))
        .flat_map(|square| [[0, 1, 2], [0, 2, 3]].map(|corners| corners.map(|corner| 4 * square + corner)))
        .collect();
    let texels = [0.0_f32, 1.0].map(f32::to_bits).to_vec();
    let format = height_format::FLOAT32;
    Scene {
        mesh: Mesh::from_triangles(&vertices, &triangles),
        reliefs: vec![Relief::new(
            HeightMap { width: 2, height: 1, format, texels, range: (0.0, 1.0), replaced: 0 },
            0.5,
            0.1,
        )],
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions: 1,
    }
}

/// A closed mesh of eight triangles, an octahedron with its vertices, normals (leaning by up to `spread`, as a
/// tangent) and texture coordinates at random, somewhere within 100 units of the origin and of a size between 1/8
/// and 8; half of them are inside out. The map has up to 8 x 8 random texels in the given format.
pub fn random_solid(numbers: &mut Numbers, format: u32, spread: f32) -> Scene {
    let size = numbers.between(-3.0, 3.0).exp2();
    let centre = numbers.in_cube() * if numbers.unit() < 0.5 { 0.0 } else { 100.0 };
    let axes = [Vec3::X, Vec3::Y, -Vec3::X, -Vec3::Y, Vec3::Z, -Vec3::Z];
    let vertices = axes.map(|axis| Vertex {
        position: centre + (axis + numbers.in_cube() * 0.3) * size,
        normal: (axis + numbers.in_cube() * spread).normalize(),
        u: numbers.between(-2.0, 3.0),
        v: numbers.between(-2.0, 3.0),
    });
    let inside_out = numbers.unit() < 0.5;
    let triangles: Vec<[u32; 3]> = (0..4)
        .flat_map(|side| [[side, (side + 1) % 4, 4], [(side + 1) % 4, side, 5]])
        .map(|[a, b, c]| if inside_out { [b, a, c] } else { [a, b, c] })
        .collect();
    Scene {
        mesh: Mesh::from_triangles(&vertices, &triangles),
        reliefs: vec![Relief::new(
            random_map(numbers, format),
            numbers.unit(),
            size * numbers.between(-0.4, 0.4),
        )],
        materials: vec![Material::default()],
        parts: vec![],
        subdivisions: 1 + numbers.below(6),
    }
}

/// A map that is not smooth anywhere, or too small to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WildMap {
    /// 64 x 32 texels of 8 bits, each at random.
    Noise,
    /// 31 x 17 floats, 0 and 1 in turns.
    Checkerboard,
    /// 128 x 128 texels of 16 bits, 0 but for one in a hundred, which is 1.
    Spikes,
    /// A single texel.
    Single,
    /// 3 x 5 floats at random.
    Odd,
}

impl WildMap {
    /// All of them.
    pub const ALL: [WildMap; 5] =
        [WildMap::Noise, WildMap::Checkerboard, WildMap::Spikes, WildMap::Single, WildMap::Odd];

    /// The map, of texels in [0, 1].
    pub fn map(self, numbers: &mut Numbers) -> HeightMap {
        let (width, height, format) = match self {
            WildMap::Noise => (64, 32, height_format::UNORM8),
            WildMap::Checkerboard => (31, 17, height_format::FLOAT32),
            WildMap::Spikes => (128, 128, height_format::UNORM16),
            WildMap::Single => (1, 1, height_format::FLOAT32),
            WildMap::Odd => (3, 5, height_format::FLOAT32),
        };
        let mut texel = |i: u32| match self {
            WildMap::Noise | WildMap::Odd => numbers.unit(),
            WildMap::Checkerboard => ((i % width + i / width) % 2) as f32,
            WildMap::Spikes => f32::from(numbers.below(100) == 0),
            WildMap::Single => 0.75,
        };
        let texels: Vec<f32> = (0..width * height).map(&mut texel).collect();
        let texels = match format {
            height_format::UNORM8 => packed(&texels, 4, 255.0),
            height_format::UNORM16 => packed(&texels, 2, 65535.0),
            _ => texels.into_iter().map(f32::to_bits).collect(),
        };
        HeightMap { width, height, format, texels, range: (0.0, 1.0), replaced: 0 }
    }
}

/// Texels in [0, 1] as codes up to `most`, so many a word.
fn packed(texels: &[f32], per_word: usize, most: f32) -> Vec<u32> {
    let bits = 32 / per_word;
    let word = |word: &[f32]| {
        #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest code")]
        let codes = word.iter().map(|t| (t * most + 0.5) as u32).enumerate();
        codes.fold(0, |packed, (lane, code)| packed | code << (lane * bits))
    };
    texels.chunks(per_word).map(word).collect()
}

/// A map of 1 x 1 to 8 x 8 random texels.
fn random_map(numbers: &mut Numbers, format: u32) -> HeightMap {
    let (width, height) = (1 + numbers.below(8), 1 + numbers.below(8));
    let texels_per_word = match format {
        height_format::UNORM8 => 4,
        height_format::UNORM16 => 2,
        _ => 1,
    };
    let mut word = || {
        let bits = numbers.below(u32::MAX);
        if format == height_format::FLOAT32 { (bits as f32 / 4_294_967_296.0).to_bits() } else { bits }
    };
    let texels = (0..(width * height).div_ceil(texels_per_word)).map(|_| word()).collect();
    HeightMap { width, height, format, texels, range: (0.0, 1.0), replaced: 0 }
}

//! The arguments of a rendering, which most commands take, and what they come to.

use super::inputs::{self, Inputs, MapArgument, ModelArgument};
use super::reports::warn_of;
use super::{CliError, say, values};
use crate::backend::Backend;
use crate::backend::select::{BackendChoice, open_backend};
use crate::framing::View;
use crate::normal_maps::{NormalMap, NormalSpace, OffsetMap};
use crate::picture::{Destination, PictureFormat};
use crate::render::check_memory;
use crate::scene::scene_file::SceneFile;
use crate::scene::subdivide::Subdivide;
use crate::settings::{
    Bounds, ChannelOrder, DisplacementKind, Filter, Light, Method, Normals, Settings, Shade, Subdivisions,
    Weld, Wrap,
};
use glam::{DVec3, Vec3};
use std::path::PathBuf;
use tracing::level_filters::LevelFilter;

/// Samples of a pixel unless said otherwise.
pub(super) const SAMPLES: u32 = 4;

/// The first six arguments may be left out from the end; `-` stands for one that is left out before another. What
/// stands in for them is printed.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct RenderArgs {
    /// OBJ file, scene file (.toml, see docs/SCENE.md), or builtin:knot, builtin:cube, builtin:quilt,
    /// builtin:mushroom [default: builtin:knot]
    #[arg(value_parser = values::model())]
    pub(super) model: Option<ModelArgument>,
    /// Colour map, or none [default: the built-in's, or the map_Kd of the OBJ's materials, their norm, their Kd; else
    /// light grey]
    #[arg(value_parser = values::map())]
    pub(super) color: Option<MapArgument>,
    /// Height map, or none; colour images count by their luminance. With --displacement a vector map [default: the
    /// built-in's, or the disp, map_disp or bump of the OBJ's materials, else none]
    #[arg(value_parser = values::map())]
    pub(super) height: Option<MapArgument>,
    /// Texel value of no displacement: 0 black, 0.5 mid-grey, 1 white [default: the built-in's, or what a
    /// material's -mm says, else 0.5; of a vector map of floats 0]
    #[arg(value_parser = values::finite_or_default, allow_negative_numbers = true)]
    pub(super) zero: Option<values::OrDefault<f32>>,
    /// Height from black to white, in model units, may be negative [default: the built-in's, or what a material's -mm
    /// says, else 5 % of the diagonal of the model's box]
    #[arg(value_parser = values::finite_or_default, allow_negative_numbers = true)]
    pub(super) scale: Option<values::OrDefault<f32>>,
    /// Subdivisions: parts of each triangle's side, 1 to 4096; or auto, auto:PIXELS: as many as leave micro-triangles a
    /// pixel, or PIXELS (0.1 to 64), from where the camera is [default: the built-in's, else 16]
    #[arg(value_name = "N", value_parser = values::subdivisions_or_default)]
    pub(super) subdivisions: Option<values::OrDefault<Subdivisions>>,

    /// Picture to write: .png, or .exr (linear floats, premultiplied)
    #[arg(short, long, value_name = "FILE", default_value = "emboss.png")]
    pub(super) output: PathBuf,
    /// Bits a channel of a PNG: 8 or 16 [default: 8]
    #[arg(long, value_name = "BITS", value_parser = values::png_format)]
    pub(super) depth: Option<PictureFormat>,
    /// Size of the picture in pixels [default: 960x720]
    #[arg(long, value_name = "WxH", value_parser = values::size)]
    pub(super) size: Option<(u32, u32)>,
    /// Samples of each pixel [default: 4]
    #[arg(long, value_name = "COUNT", value_parser = values::samples)]
    pub(super) samples: Option<u32>,
    /// How displaced triangles are intersected [default: quadtree]
    #[arg(long, value_enum)]
    pub(super) method: Option<Method>,
    /// Normal map that --method normal-map reads: red, green and blue from 0 to 1 are components from -1 to 1, green
    /// upwards [default: what each material's norm names, else one made from the height map]
    #[arg(long, value_name = "FILE")]
    pub(super) normal_map: Option<PathBuf>,
    /// What the normal map's components are along [default: tangent]
    #[arg(long, value_enum, value_name = "SPACE", requires = "normal_map")]
    pub(super) normal_space: Option<NormalSpace>,
    /// Offset map that --method bump-offset reads: red and green are by how much heights, in parts of SCALE, grow
    /// from one texel to the next, to the right and upwards; floats as they are, of integers mid-grey is 0 and white
    /// 1 [default: one made from the height map]
    #[arg(long, value_name = "FILE")]
    pub(super) offset_map: Option<PathBuf>,
    /// Choose the quickest method and N whose error on this model, measured on a small picture, is within a budget:
    /// mean FLIP from 0 (exact) to 1 (nothing alike); 0.02 is hard to see
    #[arg(long, value_name = "BUDGET", value_parser = values::flip)]
    pub(super) quality: Option<f32>,
    /// Subdivide the base mesh before it is displaced: LEVELS times, by Catmull-Clark; after a colon, between commas,
    /// what differs: loop, crease=DEGREES (edges that are bent by more are creases), edges (corners of open meshes
    /// become round) [default: the scene file's, else 0]
    #[arg(long, value_name = "LEVELS[:WORDS]")]
    pub(super) subdivide: Option<Subdivide>,
    /// Direction in which heights are measured [default: normalized]
    #[arg(long, value_enum)]
    pub(super) normals: Option<Normals>,
    /// What becomes of edges where neighbours disagree on normals or texture coordinates [default: on]
    #[arg(long, value_enum)]
    pub(super) weld: Option<Weld>,
    /// Memory in MiB for stored bounds of --method quadtree, which make it faster and change no pixel; auto is 256,
    /// none computes bounds for each ray anew [default: auto]
    #[arg(long, value_name = "none|auto|MIB")]
    pub(super) bounds: Option<Bounds>,
    /// What pixels show [default: lit]
    #[arg(long, value_enum)]
    pub(super) shade: Option<Shade>,
    /// Light the surface by normals of its own instead of its micro-triangles': a small N shades like a large one
    #[arg(
        long,
        value_name = "on|off",
        value_parser = values::switch,
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "on"
    )]
    pub(super) smooth: Option<bool>,
    /// What renders: auto takes a graphics card, else the CPU
    #[arg(long, value_enum, default_value_t = BackendChoice::Auto)]
    pub(super) backend: BackendChoice,
    /// The Vulkan device to use, by its number or a part of its name as `emboss devices` lists them
    #[arg(long, value_name = "DEVICE")]
    pub(super) device: Option<String>,
    /// Camera [default: sees the whole model]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::point, allow_hyphen_values = true)]
    pub(super) eye: Option<DVec3>,
    /// Middle of the picture [default: the middle of the model]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::point, allow_hyphen_values = true)]
    pub(super) target: Option<DVec3>,
    /// Direction that is up in the picture [default: 0,1,0]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::point, allow_hyphen_values = true)]
    pub(super) up: Option<DVec3>,
    /// Angle between the picture's upper and lower edge, in degrees [default: 35]
    #[arg(long, value_name = "DEGREES", value_parser = values::fov)]
    pub(super) fov: Option<f32>,
    /// Point light: position, linear colour (white), intensity (irradiance times squared distance; as much as makes
    /// white look white in the middle of the picture). May be repeated [default: the built-in's, else one over the
    /// viewer's left shoulder]
    #[arg(
        long = "light",
        value_name = "X,Y,Z[:R,G,B[:I]]",
        value_parser = values::light,
        allow_hyphen_values = true
    )]
    pub(super) lights: Vec<Light>,
    /// Whether lights cast shadows [default: on]
    #[arg(long, value_name = "on|off", value_parser = values::switch)]
    pub(super) shadows: Option<bool>,
    /// The same as --shadows off
    #[arg(long, conflicts_with = "shadows")]
    pub(super) no_shadows: bool,
    /// Multiply all heights by this
    #[arg(long, value_name = "FACTOR", value_parser = values::finite, allow_negative_numbers = true)]
    pub(super) exaggerate: Option<f32>,
    /// What the height map's texels displace along: heights, or vectors in tangent or in object space [default: the
    /// built-in's, else height]
    #[arg(long, value_enum, value_name = "KIND")]
    pub(super) displacement: Option<DisplacementKind>,
    /// Which channels of a vector map are along tangent, bitangent and normal, or along x, y and z: blender, mudbox,
    /// zbrush, or three of them with their signs, as +r+b-g [default: blender; in object space +r+g+b]
    #[arg(long, value_name = "ORDER", allow_hyphen_values = true)]
    pub(super) channels: Option<ChannelOrder>,
    /// How all maps are read outside [0,1) [default: as their materials say, else repeat]
    #[arg(long, value_enum)]
    pub(super) wrap: Option<Wrap>,
    /// How colour maps are read [default: bilinear]
    #[arg(long, value_enum)]
    pub(super) filter: Option<Filter>,
    /// Keep nothing beside the maps, and read nothing kept there: --method sphere computes its distance maps each time
    #[arg(long)]
    pub(super) no_cache: bool,
    /// Turn the height map upside down: white is low
    #[arg(long)]
    pub(super) invert: bool,
    /// Seed of the random numbers: the same seed gives the same picture [default: 0]
    #[arg(long)]
    pub(super) seed: Option<u32>,
    /// Write statistics as JSON; counting them takes a little time
    #[arg(long, value_name = "FILE")]
    pub(super) stats: Option<PathBuf>,
    /// Check every Vulkan call with the validation layers, which have to be installed
    #[arg(long)]
    pub(super) validate: bool,
    /// Fill the background with a colour: sRGB values from 0 to 1, as an image editor shows them divided by 255
    /// [default: transparent]
    #[arg(long, value_name = "R,G,B", value_parser = values::background, allow_hyphen_values = true)]
    pub(super) background: Option<Vec3>,
    /// Light that reaches every point, as a share of full light [default: 0.1]
    #[arg(long, value_name = "SHARE", value_parser = values::not_negative)]
    pub(super) ambient: Option<f32>,
    /// Say nothing but errors
    #[arg(short, long, conflicts_with = "verbose")]
    pub(super) quiet: bool,
    /// Say more
    #[arg(short, long)]
    pub(super) verbose: bool,
}

impl RenderArgs {
    pub(super) fn log_level(&self) -> LevelFilter {
        match (self.quiet, self.verbose) {
            (true, _) => LevelFilter::ERROR,
            (_, true) => LevelFilter::DEBUG,
            _ => LevelFilter::INFO,
        }
    }

    pub(super) fn destination(&self) -> Result<Destination, CliError> {
        let mut destination = Destination::new(self.output.clone())?;
        match (self.depth, destination.format) {
            (Some(_), PictureFormat::Exr) => return Err(CliError::DepthWithoutPng(destination.path)),
            (Some(format), _) => destination.format = format,
            (None, _) => {}
        }
        Ok(destination)
    }

    /// What is to be rendered, how, and with how many samples a pixel. `by_any_method`: with the maps of all methods,
    /// not of the one alone that is asked for.
    pub(super) fn read(&self, by_any_method: bool) -> Result<(Settings, Inputs, u32), CliError> {
        let model = self.model.clone().unwrap_or_default();
        let scene_file = self.scene_file(&model)?;
        let mut settings = self.settings(scene_file.as_ref());
        let samples = self.samples.or(scene_file.as_ref().and_then(|scene| scene.samples)).unwrap_or(SAMPLES);
        check_memory(&settings)?;
        if let Some(path) = &self.normal_map {
            settings.normal_map = Some(NormalMap::load(path, self.normal_space.unwrap_or_default(), None)?);
        }
        settings.offset_map = self.offset_map.as_deref().map(OffsetMap::load).transpose()?;
        let reads_normals = by_any_method || self.quality.is_some() || settings.method == Method::NormalMap;
        let inputs = self.inputs(&model, scene_file.as_ref(), &mut settings, reads_normals)?;
        Ok((settings, inputs, samples))
    }

    /// Refuses maps of normals and of offsets that nothing reads.
    pub(super) fn check_own_maps(&self, method: Method) -> Result<(), CliError> {
        if self.normal_map.is_some() && method != Method::NormalMap {
            return Err(CliError::NormalMapOfNothing(method));
        } else if self.offset_map.is_some() && method != Method::BumpOffset {
            return Err(CliError::OffsetMapOfNothing(method));
        }
        Ok(())
    }

    pub(super) fn scene_file(&self, model: &ModelArgument) -> Result<Option<SceneFile>, CliError> {
        Ok(match model {
            ModelArgument::Scene(path) => Some(SceneFile::read(path)?),
            _ => None,
        })
    }

    /// What is given here, else what a scene file says, else the defaults.
    pub(super) fn settings(&self, scene_file: Option<&SceneFile>) -> Settings {
        let base = scene_file.map(SceneFile::settings).unwrap_or_default();
        let (width, height) = self.size.unwrap_or((base.width, base.height));
        let view = View {
            eye: self.eye.or(base.view.eye),
            target: self.target.or(base.view.target),
            up: self.up.or(base.view.up),
            fov: self.fov.unwrap_or(base.view.fov),
            ..base.view
        };
        Settings {
            width,
            height,
            method: self.method.unwrap_or(base.method),
            // Read later, since that may fail.
            normal_map: None,
            offset_map: None,
            displacement: self.displacement.unwrap_or(base.displacement),
            adaptive: base.adaptive,
            normals: self.normals.unwrap_or(base.normals),
            weld: self.weld.unwrap_or(base.weld),
            bounds: self.bounds.unwrap_or(base.bounds),
            shade: self.shade.unwrap_or(base.shade),
            smooth: self.smooth.unwrap_or(base.smooth),
            shadows: self.shadows.unwrap_or(base.shadows && !self.no_shadows),
            wrap: self.wrap.unwrap_or(base.wrap),
            filter: self.filter.unwrap_or(base.filter),
            view,
            lights: if self.lights.is_empty() { base.lights } else { self.lights.clone() },
            ambient: self.ambient.unwrap_or(base.ambient),
            background: self.background.or(base.background),
            seed: self.seed.unwrap_or(base.seed),
            counting: self.stats.is_some(),
        }
    }

    pub(super) fn check_device(&self) -> Result<(), CliError> {
        if self.backend == BackendChoice::Cpu && self.device.is_some() {
            return Err(CliError::DeviceWithCpu);
        }
        Ok(())
    }

    pub(super) fn open_backend(&self) -> Result<Box<dyn Backend>, CliError> {
        self.check_device()?;
        Ok(open_backend(self.backend, self.device.as_deref(), self.validate)?)
    }

    /// Loads what the six arguments name; a built-in scene also brings its view and its lights.
    fn inputs(
        &self,
        model: &ModelArgument,
        scene: Option<&SceneFile>,
        settings: &mut Settings,
        reads_normals: bool,
    ) -> Result<Inputs, CliError> {
        let inputs = inputs::load(&inputs::Request {
            model,
            scene,
            color: self.color.clone().unwrap_or_default(),
            height: self.height.clone().unwrap_or_default(),
            zero: self.zero.and_then(values::OrDefault::given),
            scale: self.scale.and_then(values::OrDefault::given),
            exaggeration: self.exaggerate.unwrap_or(1.0),
            subdivisions: self.subdivisions.and_then(values::OrDefault::given),
            subdivide: self.subdivide,
            invert: self.invert,
            normal_map: self.normal_map.as_deref(),
            reads_normals,
            cache: !self.no_cache,
            wrap: self.wrap,
            displacement: self.displacement,
            channels: self.channels,
        })?;
        settings.displacement = inputs.displacement;
        settings.adaptive = inputs.subdivisions.pixels();
        if let Some((from, up)) = inputs.view {
            (settings.view.from, settings.view.usual_up) = (from, up);
        }
        if settings.lights.is_empty() {
            settings.lights.clone_from(&inputs.lights);
        }
        Ok(inputs)
    }

    /// Says what the six arguments are, what was imported, and what of it is there twice.
    pub(super) fn report(&self, inputs: &Inputs) {
        warn_of(&inputs.repeated.lines);
        if self.quiet {
            return;
        }
        inputs.choices.iter().for_each(say);
        let mesh = &inputs.scene.mesh;
        let left_out = |count: usize, why: &str| match count {
            0 => String::new(),
            count => format!(", left out {count} {why}"),
        };
        let dropped = left_out(mesh.dropped, "without three different corners");
        let collapsed =
            left_out(mesh.collapsed, "that are smaller than floats tell apart in a model of this size");
        say(format_args!("Imported {} triangles{dropped}{collapsed}", mesh.triangles.len()));
    }
}

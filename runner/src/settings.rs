//! What a user can choose about a picture, apart from the model.

use crate::framing::View;
use crate::normal_maps::{NormalMap, OffsetMap};
use crate::render::Scene;
use clap::ValueEnum;
use emboss_kernels::interface::{MAX_SUBDIVISIONS, displacement_kind, filter, method, normals, shade, wrap};
use glam::{DVec3, Vec3};
use std::fmt;
use std::str::FromStr;

/// How displaced triangles are intersected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Bounded descent through sub-triangles: exact
    Quadtree,
    /// The grid walk of Smits, Shirley and Stark 2000
    GridWalk,
    /// The N² micro-triangles stored, in a BVH of their own (vertex displacement): exact
    Tessellate,
    /// Every one of the N² micro-triangles, the slow reference
    BruteForce,
    /// Inverse displacement mapping (Patterson 1991): N steps along the ray through each prism
    Inverse,
    /// Bump mapping (Blinn 1978): normals of the relief. Outlines stay those of the base mesh, as with all that follow
    Bump,
    /// Blinn's other form of it: a map of slopes between texels
    BumpOffset,
    /// Normal mapping (Cohen 1998): --normal-map, else one made from the height map
    NormalMap,
    /// Parallax mapping (Kaneko 2001): moves the maps by the height over a hit
    Parallax,
    /// Parallax mapping with offset limiting (Welsh 2004)
    ParallaxLimited,
    /// Steep parallax mapping (McGuire 2005): the first of N layers inside the relief
    Steep,
    /// Relief mapping (Policarpo 2005): N layers, then a binary search
    Relief,
    /// Parallax occlusion mapping (Tatarchuk 2006): N layers, then a straight line; soft shadows
    Occlusion,
    /// Pyramidal displacement mapping (Oh 2006): down the min/max pyramid, at most N visits a level
    Pyramid,
    /// Sphere tracing by a distance map (Donnelly 2005): at most N steps
    Sphere,
    /// The base triangles, undisplaced
    None,
}

impl Method {
    /// Its value for the kernels.
    pub fn id(self) -> u32 {
        match self {
            Method::Quadtree => method::QUADTREE,
            Method::GridWalk => method::GRID_WALK,
            Method::Tessellate => method::TESSELLATE,
            Method::BruteForce => method::BRUTE_FORCE,
            Method::Inverse => method::INVERSE,
            Method::Bump => method::BUMP,
            Method::BumpOffset => method::BUMP_OFFSET,
            Method::NormalMap => method::NORMAL_MAP,
            Method::Parallax => method::PARALLAX,
            Method::ParallaxLimited => method::PARALLAX_LIMITED,
            Method::Steep => method::STEEP,
            Method::Relief => method::RELIEF,
            Method::Occlusion => method::OCCLUSION,
            Method::Pyramid => method::PYRAMID,
            Method::Sphere => method::SPHERE,
            Method::None => method::NONE,
        }
    }

    /// The number of triangles tested by a primary ray that `--shade steps` shows red: two prisms' worth of the longest
    /// walks (6N) or of all micro-triangles, 32 leaves of a quadtree, or 64 base triangles or stored micro-triangles.
    pub fn many_steps(self, subdivisions: u32) -> u32 {
        match self {
            Method::Quadtree => 128,
            Method::GridWalk => 12 * subdivisions,
            Method::BruteForce => (2 * subdivisions).saturating_mul(subdivisions),
            _ => 64,
        }
    }

    /// Whether something is stored for it that other methods do without, so that a scene is loaded for it alone.
    pub fn has_own_store(self) -> bool {
        matches!(self, Method::Tessellate | Method::Sphere) || method::has_own_map(self.id())
    }

    /// Whether it intersects what is stored for one view and one place of each triangle.
    pub fn is_stored(self) -> bool {
        self == Method::Tessellate
    }

    /// What N is to it, in a few words; `None` where it has no say.
    pub fn parameter(self) -> Option<&'static str> {
        match self {
            Method::Quadtree | Method::GridWalk | Method::Tessellate | Method::BruteForce => {
                Some("parts of each triangle's side")
            }
            Method::Inverse => Some("steps through each prism"),
            Method::Pyramid => Some("visits for each level of the pyramid"),
            Method::Sphere => Some("most steps of a ray"),
            Method::Steep | Method::Relief | Method::Occlusion => Some("layers of the relief"),
            Method::Bump
            | Method::BumpOffset
            | Method::NormalMap
            | Method::Parallax
            | Method::ParallaxLimited
            | Method::None => None,
        }
    }

    /// Whether every ray hits the micro-triangle surface as exact arithmetic would have it, but for rounding.
    pub fn is_exact(self) -> bool {
        matches!(self, Method::Quadtree | Method::Tessellate | Method::BruteForce)
    }

    /// Whether it looks for the relief in texture space, from where a ray meets a base triangle.
    pub fn is_image_space(self) -> bool {
        method::is_image_space(self.id())
    }

    /// Whether the relief can be seen in the model's outline.
    pub fn changes_silhouette(self) -> bool {
        !method::traces_base_mesh(self.id())
    }

    /// Whether it takes vector displacement, and an N that follows the camera.
    pub fn takes_any_scene(self) -> bool {
        method::takes_any_scene(self.id())
    }

    /// Whether it takes vector displacement.
    pub fn takes_vectors(self) -> bool {
        method::takes_vectors(self.id())
    }
}

/// Its name on the command line.
impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = self.to_possible_value();
        f.write_str(value.as_ref().map_or("", |value| value.get_name()))
    }
}

/// N: into how many parts each side of a triangle is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Subdivisions {
    /// Into so many, 1 to [`MAX_SUBDIVISIONS`].
    Fixed(u32),
    /// Into as many as its distance to the camera asks for: see [`Settings::adaptive`].
    Auto {
        /// Least and greatest are 0.1 and 64.
        pixels: f32,
    },
}

impl Subdivisions {
    /// The greatest number of parts.
    pub fn most(self) -> u32 {
        match self {
            Subdivisions::Fixed(n) => n,
            Subdivisions::Auto { .. } => MAX_SUBDIVISIONS,
        }
    }

    /// What settings and a scene say of N.
    pub fn of(settings: &Settings, scene: &Scene) -> Subdivisions {
        match settings.adaptive {
            Some(pixels) => Subdivisions::Auto { pixels },
            None => Subdivisions::Fixed(scene.subdivisions),
        }
    }

    /// [`Settings::adaptive`].
    pub fn pixels(self) -> Option<f32> {
        match self {
            Subdivisions::Fixed(_) => None,
            Subdivisions::Auto { pixels } => Some(pixels),
        }
    }
}

/// A number, or text as it is read.
impl serde::Serialize for Subdivisions {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Subdivisions::Fixed(n) => serializer.serialize_u32(*n),
            Subdivisions::Auto { .. } => serializer.collect_str(self),
        }
    }
}

/// Reads what is written so.
impl<'de> serde::Deserialize<'de> for Subdivisions {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Subdivisions, D::Error> {
        #[derive(serde::Deserialize)]
        #[serde(untagged)]
        enum Written {
            Number(u32),
            Text(String),
        }
        let text = match Written::deserialize(deserializer)? {
            Written::Number(n) => n.to_string(),
            Written::Text(text) => text,
        };
        text.parse().map_err(serde::de::Error::custom)
    }
}

/// Reads a number, `auto` (a pixel) or `auto:PIXELS`.
impl FromStr for Subdivisions {
    type Err = String;

    fn from_str(text: &str) -> Result<Subdivisions, String> {
        let pixels = match text {
            "auto" => Some("1"),
            _ => text.strip_prefix("auto:"),
        };
        let read = match pixels {
            Some(pixels) => {
                let pixels = pixels.parse().ok().filter(|pixels| (0.1..=64.0).contains(pixels));
                pixels.map(|pixels| Subdivisions::Auto { pixels })
            }
            None => {
                let n = text.parse().ok().filter(|n| (1..=MAX_SUBDIVISIONS).contains(n));
                n.map(Subdivisions::Fixed)
            }
        };
        read.ok_or_else(|| {
            format!(
                "{text} is no N; write a whole number from 1 to {MAX_SUBDIVISIONS} such as 16, auto, or auto:PIXELS \
                    with 0.1 to 64 pixels"
            )
        })
    }
}

impl fmt::Display for Subdivisions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Subdivisions::Fixed(n) => write!(f, "{n}"),
            Subdivisions::Auto { pixels } => write!(f, "auto:{pixels}"),
        }
    }
}

/// What the texels of height maps displace along.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DisplacementKind {
    /// Heights, along the normal
    Height,
    /// Vectors, along tangent, bitangent and normal (those of MikkTSpace)
    Tangent,
    /// Vectors, along the model's x, y and z
    Object,
}

impl DisplacementKind {
    /// Its value for the kernels.
    pub fn id(self) -> u32 {
        match self {
            DisplacementKind::Height => displacement_kind::HEIGHT,
            DisplacementKind::Tangent => displacement_kind::TANGENT,
            DisplacementKind::Object => displacement_kind::OBJECT,
        }
    }
}

/// Which channels of a vector map are along which axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(try_from = "String")]
pub enum ChannelOrder {
    /// As Blender writes and reads them.
    Blender,
    /// As Mudbox writes them.
    Mudbox,
    /// As ZBrush writes them with its `TangentFlipAndSwitch` (or `FlipAndSwitch`) at 25.
    Zbrush,
    /// The channel (0 to 2) of each axis, and whether it is turned round.
    Custom([(usize, bool); 3]),
}

impl ChannelOrder {
    /// Channels for tangent, bitangent and normal, or for x, y and z, each with the sign that it takes.
    ///
    /// In tangent space the three programs agree: red along the tangent, green along the normal, blue along the
    /// bitangent. Blender's manual says so of its Vector Displacement node, Maya's of the maps of Mudbox (with
    /// *Absolute Tangent*); of ZBrush it is what importers take 25 for, the setting that is advised for Maya. (It has
    /// 48.) In object space they are x, y and z, where Blender's z is up: the OBJ files that it writes have its z as y,
    /// and its y as -z, unless told otherwise.
    pub fn axes(self, kind: DisplacementKind) -> [(usize, f32); 3] {
        let sign = |(channel, negative)| (channel, if negative { -1.0 } else { 1.0 });
        match (self, kind) {
            (ChannelOrder::Custom(axes), _) => axes.map(sign),
            (ChannelOrder::Blender, DisplacementKind::Object) => [(0, 1.0), (2, 1.0), (1, -1.0)],
            (_, DisplacementKind::Object) => [(0, 1.0), (1, 1.0), (2, 1.0)],
            _ => [(0, 1.0), (2, 1.0), (1, 1.0)],
        }
    }
}

/// Reads `blender`, `mudbox`, `zbrush`, or three different channels with their signs such as `+r+b-g`.
impl FromStr for ChannelOrder {
    type Err = String;

    fn from_str(text: &str) -> Result<ChannelOrder, String> {
        match text {
            "blender" => return Ok(ChannelOrder::Blender),
            "mudbox" => return Ok(ChannelOrder::Mudbox),
            "zbrush" => return Ok(ChannelOrder::Zbrush),
            _ => {}
        }
        let wrong = || {
            format!(
                "`{text}` is no order; write blender, mudbox, zbrush, or three different channels such as +r+b-g"
            )
        };
        let [s0, c0, s1, c1, s2, c2] = text.as_bytes() else { return Err(wrong()) };
        let negative = |sign: u8| match sign {
            b'+' => Ok(false),
            b'-' => Ok(true),
            _ => Err(wrong()),
        };
        let channel = |name: u8| b"rgb".iter().position(|&c| c == name).ok_or_else(wrong);
        let axes = [
            (channel(*c0)?, negative(*s0)?),
            (channel(*c1)?, negative(*s1)?),
            (channel(*c2)?, negative(*s2)?),
        ];
        if c0 == c1 || c1 == c2 || c2 == c0 {
            return Err(wrong());
        }
        Ok(ChannelOrder::Custom(axes))
    }
}

impl TryFrom<String> for ChannelOrder {
    type Error = String;

    fn try_from(text: String) -> Result<ChannelOrder, String> {
        text.parse()
    }
}

/// How much memory [`Method::Quadtree`] may take to store bounds on what it traces. Pictures are the same, to the bit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bounds {
    /// None: each ray computes bounds anew from the height map.
    None,
    /// Up to [`Bounds::AUTO_MIB`].
    #[default]
    Auto,
    /// Up to so many MiB.
    Mib(u32),
}

impl Bounds {
    /// The limit of [`Bounds::Auto`], in MiB: 2,584 triangles take 36 of them at N = 64, 131 at N = 128.
    pub const AUTO_MIB: u32 = 256;

    /// The limit in bytes.
    pub fn bytes(self) -> u64 {
        let mib = match self {
            Bounds::None => 0,
            Bounds::Auto => Bounds::AUTO_MIB,
            Bounds::Mib(mib) => mib,
        };
        u64::from(mib) << 20
    }
}

/// Its name on the command line.
impl fmt::Display for Bounds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Bounds::None => f.write_str("none"),
            Bounds::Auto => f.write_str("auto"),
            Bounds::Mib(mib) => mib.fmt(f),
        }
    }
}

/// Reads `none`, `auto`, or a number of MiB.
impl FromStr for Bounds {
    type Err = String;

    fn from_str(text: &str) -> Result<Bounds, String> {
        match text {
            "none" => Ok(Bounds::None),
            "auto" => Ok(Bounds::Auto),
            _ => text.parse().map(Bounds::Mib).map_err(|_| {
                format!("`{text}` is no limit; write none, auto, or a number of MiB such as 64")
            }),
        }
    }
}

/// It is written as text.
impl serde::Serialize for Bounds {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Along which direction heights are measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Normals {
    /// The interpolated normal, renormalised: heights keep their meaning on curved bases
    Normalized,
    /// The interpolated normal as it is: heights shrink where it is shorter than 1
    Linear,
}

impl Normals {
    /// Its value for the kernels.
    pub fn id(self) -> u32 {
        match self {
            Normals::Normalized => normals::NORMALIZED,
            Normals::Linear => normals::LINEAR,
        }
    }
}

/// What becomes of edges and vertices where neighbours disagree on normals, texture coordinates or height maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Weld {
    /// They are decided once for all neighbours: the surface has no crack
    On,
    /// Each triangle goes its own way: seams crack
    Off,
}

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shade {
    /// Lambert and ambient light, times the colour map
    Lit,
    /// The normal that light is reflected by, from -1 to 1 mapped to black to white
    Normal,
    /// The height, its range mapped to black-white; of vectors the length
    Height,
    /// Texture coordinates in red and green
    Uv,
    /// A colour per micro-triangle
    Cell,
    /// Work of the primary ray, from blue (little) to red (much)
    Steps,
    /// By how much light differs from what the exact method shows: blue not at all, red by a quarter of white and more
    Error,
}

impl Shade {
    /// Its value for the kernels.
    pub fn id(self) -> u32 {
        match self {
            Shade::Lit => shade::LIT,
            Shade::Normal => shade::NORMAL,
            Shade::Height => shade::HEIGHT,
            Shade::Uv => shade::UV,
            Shade::Cell => shade::CELL,
            Shade::Steps => shade::STEPS,
            Shade::Error => shade::ERROR,
        }
    }
}

/// How texture coordinates outside [0,1) are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Wrap {
    /// Maps repeat
    Repeat,
    /// Border texels go on outwards
    Clamp,
    /// Maps repeat, each second copy mirrored
    Mirror,
}

impl Wrap {
    /// Its value for the kernels.
    pub fn id(self) -> u32 {
        match self {
            Wrap::Repeat => wrap::REPEAT,
            Wrap::Clamp => wrap::CLAMP,
            Wrap::Mirror => wrap::MIRROR,
        }
    }
}

/// How maps are read where a pixel covers many texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Filter {
    /// Between the four texels around a point: from afar that needs many samples
    Bilinear,
    /// Between levels of the maps, as large as the pixel is on the surface; of heights so that silhouettes stay
    Trilinear,
}

impl Filter {
    /// Its value for the kernels.
    pub fn id(self) -> u32 {
        match self {
            Filter::Bilinear => filter::BILINEAR,
            Filter::Trilinear => filter::TRILINEAR,
        }
    }
}

/// A point light as the user gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Where it is, in world units.
    pub position: DVec3,
    /// Linear RGB.
    pub color: Vec3,
    /// Irradiance times squared distance in world units. `None`: as much as gives full light (1) at the camera's
    /// target.
    pub intensity: Option<f32>,
}

/// A picture's settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Pixels of a row, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
    /// How displaced triangles are intersected.
    pub method: Method,
    /// What [`Method::NormalMap`] reads. `None`: what is made from the height maps.
    pub normal_map: Option<NormalMap>,
    /// The offset map of [`Method::BumpOffset`]; `None`: it is made from the height map.
    pub offset_map: Option<OffsetMap>,
    /// What the texels of height maps displace along. Of vectors [`Scene::reliefs`] has three for each map, an axis
    /// each (tangent, bitangent, normal; x, y, z), and triangles name the first.
    ///
    /// [`Scene::reliefs`]: crate::render::Scene::reliefs
    pub displacement: DisplacementKind,
    /// Where N of each triangle follows its distance to the camera: how many pixels the parts of its sides may be long
    /// where they are not displaced. N is the least power of two that does it, up to [`Scene::subdivisions`], itself
    /// one. `None`: that is N everywhere. See [`detail`](crate::framing::detail).
    ///
    /// [`Scene::subdivisions`]: crate::render::Scene::subdivisions
    pub adaptive: Option<f32>,
    /// Along which direction heights are measured.
    pub normals: Normals,
    /// Whether neighbours that disagree at an edge or a vertex meet without a crack.
    pub weld: Weld,
    /// How much memory the bounds of [`Method::Quadtree`] may take.
    pub bounds: Bounds,
    /// What a pixel shows.
    pub shade: Shade,
    /// Whether light is reflected by the displaced surface's own normals instead of its micro-triangles': a small N
    /// then shades like a large one.
    pub smooth: bool,
    /// Whether lights cast shadows.
    pub shadows: bool,
    /// How maps are read outside [0,1) unless they say it themselves.
    pub wrap: Wrap,
    /// How maps are read.
    pub filter: Filter,
    /// Where the camera is.
    pub view: View,
    /// The lights. Empty: the key light of the camera ([`key_light`](crate::framing::key_light)).
    pub lights: Vec<Light>,
    /// Light that reaches every point, as a share of full light.
    pub ambient: f32,
    /// Linear RGB behind the surface. `None`: transparent.
    pub background: Option<Vec3>,
    /// Seed of the random numbers.
    pub seed: u32,
    /// Whether rays, boxes, cells and triangles are counted; it costs a little time.
    pub counting: bool,
}

impl Settings {
    /// Whether heights are read at all: without that they are all zero.
    pub fn displaces(&self) -> bool {
        self.method != Method::None || self.shade == Shade::Error
    }

    /// What the boxes of triangles hold: see [`method::boxes`].
    pub fn boxes(&self) -> u32 {
        method::boxes(self.method.id(), self.shade.id())
    }

    /// Pixels of a picture. Fits: each side is a `u32`.
    pub fn pixels(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            width: 960,
            height: 720,
            method: Method::Quadtree,
            normal_map: None,
            offset_map: None,
            displacement: DisplacementKind::Height,
            adaptive: None,
            normals: Normals::Normalized,
            weld: Weld::On,
            bounds: Bounds::Auto,
            shade: Shade::Lit,
            smooth: false,
            shadows: true,
            wrap: Wrap::Repeat,
            filter: Filter::Bilinear,
            view: View::default(),
            lights: Vec::new(),
            ambient: 0.1,
            background: None,
            seed: 0,
            counting: false,
        }
    }
}

//! Every struct, binding number and specialisation constant that the host and the kernels share.
//!
//! The structs are declared once, here: the host fills them, the CPU backend and the shader read them. Offsets
//! are those of `repr(C)` with 4-byte alignment throughout (glam's `Vec3` is 12 bytes, aligned to 4), which is
//! also what rust-gpu decorates; `tests/tests/layout.rs` compares both with the compiled module.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Descriptor bindings of set 0. `entry.rs` repeats them as literals, because attributes take no constants; the
/// layout test compares the two.
pub mod binding {
    /// [`Frame`](super::Frame), read.
    pub const FRAME: u32 = 0;
    /// `[Vertex]`, read.
    pub const VERTICES: u32 = 1;
    /// `[Triangle]`; their heights are written by `bound_heights`, the rest reads them.
    pub const TRIANGLES: u32 = 2;
    /// `[BvhNode]`, written by the BVH's build, read by the rest.
    pub const NODES: u32 = 3;
    /// `[u32]`: triangle indices in the order of the BVH's leaves, written by its build, read by the rest.
    pub const PRIMITIVES: u32 = 4;
    /// `[Displacement]`, one for each height map, read.
    pub const DISPLACEMENTS: u32 = 5;
    /// `[u32]`: texels of the height maps, each in its [`height_format`](super::height_format), read.
    pub const HEIGHT_TEXELS: u32 = 6;
    /// `[u32]`: the height maps' min/max pyramids, see [`height_pyramid`](crate::displacement::height_pyramid);
    /// written by `height_pyramid`, read by the rest.
    pub const HEIGHT_RANGES: u32 = 7;
    /// `[Seams]`; their heights are written by `decide_seams`, the rest reads them.
    pub const SEAMS: u32 = 8;
    /// `[SeamSide]`, read.
    pub const SEAM_SIDES: u32 = 9;
    /// `[u32]`: texels of the colour maps, each in its [`color_format`](super::color_format), read.
    pub const COLOR_TEXELS: u32 = 10;
    /// `[PointLight]`, read.
    pub const LIGHTS: u32 = 11;
    /// `[FilmPixel]`, row-major, top row first: the sum of samples, read and written.
    pub const FILM: u32 = 12;
    /// `[Vec4]`: the resolved picture, written by `resolve`.
    pub const PICTURE: u32 = 13;
    /// `[Counter; counter::COUNT]`, added to atomically.
    pub const COUNTERS: u32 = 14;
    /// `[Ray]`, read by `trace_rays`.
    pub const RAYS: u32 = 15;
    /// `[Intersection]`, written by `trace_rays`.
    pub const INTERSECTIONS: u32 = 16;
    /// `[u32]`, the arguments of `probe`, read.
    pub const PROBE_IN: u32 = 17;
    /// `[u32]`, the results of `probe`, written.
    pub const PROBE_OUT: u32 = 18;
    /// `[Word]`: the keys of a [`radix_sort`](crate::bvh::radix_sort), read and written.
    pub const SORT_KEYS: u32 = 19;
    /// `[Word]`: the values of a sort, read and written.
    pub const SORT_VALUES: u32 = 20;
    /// `[Word]`: how many pairs of each digit each block has, written by `count_digits`, read by `scatter_pairs`.
    pub const SORT_COUNTS: u32 = 21;
    /// `[Word]`: what a [`scan`](crate::bvh::scan) works on, read and written.
    pub const SCAN_VALUES: u32 = 22;
    /// `[Word]`: the sums of a scan's blocks, written by `sum_blocks`, read by `scan_blocks`.
    pub const SCAN_SUMS: u32 = 23;
    /// `[f32]`: six for each primitive, its box's lower corner and its upper one; written by `prism_bounds`.
    pub const BOXES: u32 = 24;
    /// `[u32]`: the state of a build, see [`header`](crate::bvh::header).
    pub const BUILD_STATE: u32 = 25;
    /// `[u32]`, one for each primitive: where the sorted order splits.
    pub const SPLIT_LEVELS: u32 = 26;
    /// `[u32]`, one for each pair of siblings: what the first one left for the second, else all ones.
    pub const ARRIVALS: u32 = 27;
    /// `[u32]`, one for each pair of siblings: the node above them.
    pub const PARENTS: u32 = 28;
    /// `[u32]`: the treelets, see [`hlbvh`](crate::bvh::hlbvh).
    pub const TREELETS: u32 = 29;
    /// `[u32]`: the tasks of the tree's top, see [`top`](crate::bvh::top).
    pub const TASKS: u32 = 30;
    /// `[u32]`: their bins.
    pub const BINS: u32 = 31;
    /// `[u32]`: the task of each treelet.
    pub const TREELET_TASKS: u32 = 32;
    /// `[u32]`: the tasks of a level, those of the next.
    pub const TASK_QUEUES: u32 = 33;
    /// `[u32]`: partial sums of the SAH cost, floats as words.
    pub const COSTS: u32 = 34;
    /// `[u32]`: small tasks, see [`small`](crate::bvh::small).
    pub const SMALL_TASKS: u32 = 35;
    /// `[u32]`: the treelets of small tasks.
    pub const TREELET_LISTS: u32 = 36;
    /// `[Material]`, read.
    pub const MATERIALS: u32 = 37;
    /// `[Tangent]`, one for each vertex where vector displacement is in tangent space, else none; read.
    pub const TANGENTS: u32 = 38;
    /// `[TexelScale]`, one for each vertex where maps are filtered by their levels, else none; read.
    pub const TEXEL_SCALES: u32 = 39;
    /// `[Instance]`, read.
    pub const INSTANCES: u32 = 40;
    /// `[u32]`: maps of normals or of offsets, see [`normal_texels`](crate::relief::normal_texels); none unless the
    /// method reads them; read.
    pub const NORMAL_TEXELS: u32 = 41;
    /// `[f32]`: three for each micro-vertex of a tessellation, see [`tessellate`](crate::displacement::tessellate);
    /// none unless that is the method. Written by `tessellate`, read by the rest.
    pub const MICRO_VERTICES: u32 = 42;
    /// `[f32]`: a [distance map](crate::relief::distance_map) for each [`Displacement`](super::Displacement); none
    /// unless [`SPHERE`](super::method::SPHERE) is the method. Written by `distance_columns` and `distance_map`, read
    /// by the rest.
    pub const DISTANCES: u32 = 43;
    /// `[UVec4]`: the nodes of a stored tree, see [`prism_tree`](crate::prism_tree); none unless there is one. Written
    /// by its build, read by the rest.
    pub const PRISM_TREE: u32 = 44;
    /// How many bindings set 0 has.
    pub const COUNT: u32 = 45;
}

/// Ids of the specialisation constants, and their meaning. A feature that a scene does not use is absent from
/// its pipeline. Each is a `u32`; defaults stand in `entry.rs`.
pub mod spec {
    /// How displaced triangles are intersected: [`method`](super::method).
    pub const METHOD: u32 = 0;
    /// What a pixel shows: [`shade`](super::shade).
    pub const SHADE: u32 = 1;
    /// 1 where lights cast shadows.
    pub const SHADOWS: u32 = 2;
    /// How the height maps' texels are stored: [`height_format`](super::height_format).
    pub const HEIGHT_FORMAT: u32 = 3;
    /// How the colour maps' texels are stored: [`color_format`](super::color_format).
    pub const COLOR_FORMAT: u32 = 4;
    /// How texture coordinates outside [0,1) of the height maps are read: [`wrap`](super::wrap).
    pub const HEIGHT_WRAP: u32 = 5;
    /// The same for the colour maps.
    pub const COLOR_WRAP: u32 = 6;
    /// 1 where work is counted, as in [`counter`](super::counter). Cap hits are counted regardless.
    pub const COUNTERS: u32 = 7;
    /// Along which direction heights are measured: [`normals`](super::normals).
    pub const NORMALS: u32 = 8;
    /// 1 where some triangle has [`Seams`](super::Seams).
    pub const SEAMS: u32 = 9;
    /// 1 where light is reflected by the displaced surface's own normals, 0 where by those of its micro-triangles.
    pub const SMOOTH: u32 = 10;
    /// What the height maps' texels displace along: [`displacement_kind`](super::displacement_kind).
    pub const DISPLACEMENT: u32 = 11;
    /// How maps are read: [`filter`](super::filter).
    pub const FILTER: u32 = 12;
    /// 1 where N of each triangle follows its distance to the camera: [`Frame::detail`](super::Frame::detail).
    pub const ADAPTIVE: u32 = 13;
    /// 1 where meshes stand in the places of [`Instance`](super::Instance)s.
    pub const INSTANCES: u32 = 14;
    /// What is stored for the exact method: [`bounds`](super::bounds).
    pub const BOUNDS: u32 = 15;
    /// How many specialisation constants there are.
    pub const COUNT: u32 = 16;
}

/// Values of [`spec::METHOD`].
pub mod method {
    /// The base triangles, undisplaced.
    pub const NONE: u32 = 0;
    /// Every one of the N² micro-triangles of a prism.
    pub const BRUTE_FORCE: u32 = 1;
    /// The grid walk of Smits, Shirley and Stark 2000.
    pub const GRID_WALK: u32 = 2;
    /// Bounded descent through an implicit quadtree of sub-triangles: the exact method.
    pub const QUADTREE: u32 = 3;
    /// Vertex displacement: the micro-triangles are stored, in a BVH of their own:
    /// [`tessellate`](crate::displacement::tessellate). Exact.
    pub const TESSELLATE: u32 = 4;
    /// Inverse displacement mapping (Patterson, Hoggar and Logie 1991): the ray is followed through the prism:
    /// [`inverse`](crate::displacement::inverse).
    pub const INVERSE: u32 = 5;
    /// Bump mapping (Blinn 1978): [`bump`](crate::relief::bump).
    pub const BUMP: u32 = 6;
    /// Blinn's other form of it, by a map of offsets: [`bump_offset`](crate::relief::bump_offset).
    pub const BUMP_OFFSET: u32 = 7;
    /// Normal mapping (Cohen 1998): [`normal_map`](crate::relief::normal_map).
    pub const NORMAL_MAP: u32 = 8;
    /// Parallax mapping (Kaneko and others 2001): [`parallax`](crate::relief::parallax).
    pub const PARALLAX: u32 = 9;
    /// Parallax mapping with offset limiting (Welsh 2004).
    pub const PARALLAX_LIMITED: u32 = 10;
    /// Steep parallax mapping (McGuire and McGuire 2005): [`steep`](crate::relief::steep).
    pub const STEEP: u32 = 11;
    /// Relief mapping (Policarpo, Oliveira and Comba 2005): [`binary`](crate::relief::binary).
    pub const RELIEF: u32 = 12;
    /// Parallax occlusion mapping (Tatarchuk 2006): [`occlusion`](crate::relief::occlusion).
    pub const OCCLUSION: u32 = 13;
    /// Pyramidal displacement mapping (Oh, Ki and Lee 2006): [`pyramid`](crate::relief::pyramid).
    pub const PYRAMID: u32 = 14;
    /// Sphere tracing by a distance map (Donnelly 2005): [`sphere_trace`](crate::relief::sphere_trace).
    pub const SPHERE: u32 = 15;

    /// Whether a method traces the base triangles and works in texture space from where a ray meets them:
    /// see [`relief`](crate::relief).
    #[inline]
    pub const fn is_image_space(method: u32) -> bool {
        method >= BUMP && method <= SPHERE
    }

    /// Whether a method reads a map of its own beside the height map.
    #[inline]
    pub const fn has_own_map(method: u32) -> bool {
        method == BUMP_OFFSET || method == NORMAL_MAP
    }

    /// Whether a method looks for the relief along the ray, and from there for lights.
    #[inline]
    pub const fn searches_relief(method: u32) -> bool {
        method >= STEEP && method <= SPHERE
    }

    /// Whether rays meet the base triangles themselves.
    #[inline]
    pub const fn traces_base_mesh(method: u32) -> bool {
        method == NONE || is_image_space(method)
    }

    /// What the boxes of triangles hold for a method and a [`shade`](super::shade): 0 what is displaced (where nothing
    /// is to be, the host's heights are 0), 1 the base triangles, 2 both.
    #[inline]
    pub const fn boxes(method: u32, shade: u32) -> u32 {
        if shade == super::shade::ERROR && traces_base_mesh(method) {
            2
        } else if is_image_space(method) {
            1
        } else {
            0
        }
    }

    /// Whether a method takes vector displacement, and an N that follows the camera.
    #[inline]
    pub const fn takes_any_scene(method: u32) -> bool {
        method == NONE || method == BRUTE_FORCE || method == QUADTREE
    }

    /// Whether a method takes vector displacement.
    #[inline]
    pub const fn takes_vectors(method: u32) -> bool {
        takes_any_scene(method) || method == TESSELLATE
    }
}

/// Values of [`spec::BOUNDS`]: what is stored for [`QUADTREE`](method::QUADTREE).
pub mod bounds {
    /// Nothing: bounds follow from the height map, for each ray anew.
    pub const NONE: u32 = 0;
    /// The boxes of a [tree](crate::prism_tree); micro-vertices follow from the height map.
    pub const BOXES: u32 = 1;
    /// The boxes, and what micro-vertices follow from.
    pub const ALL: u32 = 2;
}

/// The space of a map of normals.
pub mod normal_space {
    /// Tangent, bitangent and normal.
    pub const TANGENT: u32 = 0;
    /// The mesh's x, y and z.
    pub const OBJECT: u32 = 1;
    /// The scene's.
    pub const WORLD: u32 = 2;
}

/// Values of [`spec::NORMALS`].
pub mod normals {
    /// The interpolated normal, renormalised: height keeps its meaning on curved bases.
    pub const NORMALIZED: u32 = 0;
    /// The interpolated normal as it is (Smits, Shirley and Stark 2000): prism walls are bilinear patches.
    pub const LINEAR: u32 = 1;
}

/// Values of [`spec::DISPLACEMENT`]. A vector map is three scalar ones of one size, one behind the other, an axis
/// each: a triangle names the first of them.
pub mod displacement_kind {
    /// Heights along the interpolated normal.
    pub const HEIGHT: u32 = 0;
    /// Vectors in tangent space: along the interpolated tangent, bitangent and normal.
    pub const TANGENT: u32 = 1;
    /// Vectors in object space: along x, y and z.
    pub const OBJECT: u32 = 2;
}

/// Values of [`spec::SHADE`].
pub mod shade {
    /// Lambert and ambient light, times the colour map.
    pub const LIT: u32 = 0;
    /// The normal that light is reflected by, [-1, 1] mapped to [0, 1]: see [`spec::SMOOTH`](super::spec::SMOOTH).
    pub const NORMAL: u32 = 1;
    /// The height, its range mapped to black-white; of vector displacement the length, black where there is none.
    pub const HEIGHT: u32 = 2;
    /// The texture coordinates' fractional parts in red and green.
    pub const UV: u32 = 3;
    /// A colour per micro-triangle.
    pub const CELL: u32 = 4;
    /// Triangles that the primary ray was tested against, from blue (few) to red (many).
    pub const STEPS: u32 = 5;
    /// By how much the luminance of [`LIT`] differs from that of the exact method, from blue (not at all) over green
    /// (1/8 of full light) to red (1/4 and more).
    pub const ERROR: u32 = 6;
}

/// Values of [`spec::HEIGHT_FORMAT`] and, but for the last one, of [`Displacement::format`].
pub mod height_format {
    /// Four 8-bit unsigned texels a word, the first in the lowest byte; 255 is 1.
    pub const UNORM8: u32 = 0;
    /// Two 16-bit unsigned texels a word, the first in the lower half; 65535 is 1.
    pub const UNORM16: u32 = 1;
    /// One 32-bit float a word.
    pub const FLOAT32: u32 = 2;
    /// Maps differ: each is stored as its [`Displacement::format`](super::Displacement::format) says.
    pub const PER_MAP: u32 = 3;
}

/// Values of [`spec::COLOR_FORMAT`] and, but for the last one, of [`Material::color_format`].
pub mod color_format {
    /// No colour map: the surface has its [`Material::albedo`](super::Material::albedo).
    pub const NONE: u32 = 0;
    /// The first 256 words are linear intensities (floats) of the 256 sRGB codes; then a word a texel, R in the
    /// lowest byte, then G, B, A. Alpha is not read.
    pub const SRGB8: u32 = 1;
    /// Three words a texel: R, G, B as 32-bit floats, linear.
    pub const FLOAT32: u32 = 2;
    /// Materials differ: each says it in [`Material::color_format`](super::Material::color_format).
    pub const PER_MATERIAL: u32 = 3;
}

/// Values of [`spec::FILTER`].
pub mod filter {
    /// Between the four texels around a point.
    pub const BILINEAR: u32 = 0;
    /// Between the eight texels around a point on the two levels whose texels are next in size to a pixel there. Behind
    /// the texels stand those of the other levels, each half as wide and high as the one before (rounded down, at least
    /// 1) down to a single texel. Of height maps see [`TexelScale`](super::TexelScale).
    pub const TRILINEAR: u32 = 1;
}

/// Values of [`spec::HEIGHT_WRAP`], [`spec::COLOR_WRAP`] and, but for the last one, of [`Displacement::wrap`] and
/// [`Material::color_wrap`].
pub mod wrap {
    /// The map repeats.
    pub const REPEAT: u32 = 0;
    /// The map's border texels go on outwards.
    pub const CLAMP: u32 = 1;
    /// The map repeats, each second copy mirrored.
    pub const MIRROR: u32 = 2;
    /// Maps differ: each says it itself.
    pub const PER_MAP: u32 = 3;
}

/// Indices into the counter buffer.
pub mod counter {
    /// Primary rays.
    pub const PRIMARY_RAYS: u32 = 0;
    /// Shadow rays.
    pub const SHADOW_RAYS: u32 = 1;
    /// Primary rays that hit.
    pub const HITS: u32 = 2;
    /// Ray/box tests.
    pub const BOXES: u32 = 3;
    /// Prisms whose boxes rays entered.
    pub const PRISMS: u32 = 4;
    /// Cells walked by the grid walk.
    pub const CELLS: u32 = 5;
    /// Micro-triangles tested.
    pub const TRIANGLES: u32 = 6;
    /// Walks that met their cap on steps.
    pub const CAP_HITS: u32 = 7;
    /// Walks that ended inside the grid because signs told no way on.
    pub const LOST_WALKS: u32 = 8;
    /// Sub-triangles of quadtrees that rays were tested against.
    pub const SUB_TRIANGLES: u32 = 9;
    /// How many counters there are.
    pub const COUNT: usize = 10;
}

/// Threads of a workgroup of `render` and `resolve` along x and along y.
pub const TILE_GROUP_SIZE: u32 = 8;
/// Threads of a workgroup of the kernels that run over a list: rays, words, triangles, seams, probes.
pub const BATCH_GROUP_SIZE: u32 = 64;
/// Most workgroups of a row of a dispatch over many items; what is left goes to further rows. Every Vulkan device takes
/// 65,535 along an axis.
pub const MOST_ROW_GROUPS: u32 = 1 << 13;
/// Largest number of subdivisions N of a triangle's side.
pub const MAX_SUBDIVISIONS: u32 = 4096;
/// Largest number of edges from the BVH's root to a leaf: builders keep it, and the traversal stack has one entry
/// for each.
pub const MAX_BVH_DEPTH: u32 = 64;
/// Largest number of primitives of a BVH, a block less than 2^25. So no dispatch over blocks of 1024 of them, or of
/// nodes, has more than 65,535 workgroups, and a position fits in a word with a height.
pub const MAX_PRIMITIVES: u32 = (1 << 25) - 1024;
/// [`Hit::primitive`](crate::hit::Hit) and [`Intersection::primitive`] of a ray that hits nothing.
pub const MISS: u32 = u32::MAX;
/// [`Triangle::flags`]: the stored order of vertices is clockwise seen from outside.
pub const FLIPPED: u32 = 1;
/// [`Triangle::flags`]: the lowest bit of the index of the triangle's [`Material`].
const MATERIAL_SHIFT: u32 = 1;
/// How many materials a scene can have.
pub const MAX_MATERIALS: u32 = 1 << (32 - MATERIAL_SHIFT);
/// [`Triangle::seams`] of a triangle whose neighbours agree with it all around.
pub const NO_SEAMS: u32 = u32::MAX;

/// A corner of the base mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Vertex {
    /// Where it is, in model units.
    pub position: Vec3,
    /// First texture coordinate, growing to the right of the map.
    pub u: f32,
    /// Unit normal.
    pub normal: Vec3,
    /// Second texture coordinate, growing upwards from the map's bottom row.
    pub v: f32,
}

/// The tangent of a vertex: the direction in which its first texture coordinate grows. The bitangent is `sign` times
/// normal x tangent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Tangent {
    /// Unit vector.
    pub direction: Vec3,
    /// 1, or -1 where the map is mirrored.
    pub sign: f32,
}

/// How large the texels of height maps are at a vertex, where these are filtered by their levels. Interpolated over
/// base triangles, so that both triangles at an edge read the same level there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct TexelScale {
    /// Side of a texel on the base mesh, in model units: the largest of the triangles at the vertex; finite, and so
    /// large that no level is read where one has no extent in its map.
    pub size: f32,
    /// How many texels a side a pixel is taken to cover at the most, a power of two. Boxes hold the surface as far as
    /// that.
    pub span: f32,
}

/// A base triangle. Its vertices are stored in ascending order of index, so that the two triangles at an edge
/// interpolate along it in the same order of operations and get the same bits; [`FLIPPED`] keeps its orientation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Triangle {
    /// Indices of its three vertices, ascending.
    pub vertices: [u32; 3],
    /// [`FLIPPED`] or 0, and above that bit the index of its [`Material`]. Only shading needs that, so that it takes no
    /// words of what traversal reads.
    pub flags: u32,
    /// Least height of its own field over it, rounded down:
    /// [`height_bounds`](crate::displacement::height_pyramid::height_bounds), which backends compute. Seams may have
    /// others. Of vector displacement minus the greatest length that its components allow.
    pub height_min: f32,
    /// Greatest height, rounded up. Computed with `height_min`.
    pub height_max: f32,
    /// Index of its [`Displacement`], of vector displacement the first of three.
    pub displacement: u32,
    /// Index of its [`Seams`], or [`NO_SEAMS`].
    pub seams: u32,
}

/// What a base triangle's border has in common with neighbours that disagree with it on normals, texture
/// coordinates or height maps. The edges and corners concerned are decided here, once for all triangles at them, so
/// that these compute the same micro-vertices and the surface has no crack.
///
/// A corner is *decided* where several vertices stand at its position, or triangles of several maps: direction and
/// height are then those given here. An edge is a *seam* where its triangles do not all share its two vertices and the
/// height map: its micro-vertices are displaced along the directions given here, interpolated, by the mean of the
/// heights that its different sides read.
///
/// Of vector displacement decided corners and seams are displaced by the mean of the vectors that their different sides
/// give, each along its own axes: directions are not read, and heights are bounds on lengths, as in [`Triangle`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Seams {
    /// Displacement direction at each corner, a unit vector (or zero): the normalised mean of the normals there, or
    /// the vertex's own normal where the corner is not decided.
    pub directions: [[f32; 3]; 3],
    /// Height at each decided corner: the mean over the different readings of maps there. Like the ranges below,
    /// what backends compute ([`decide_seams`](crate::displacement::seams::decide_seams)).
    pub heights: [f32; 3],
    /// Bit e: corner e is decided. Bit 3 + e: the edge across from corner e is a seam.
    pub flags: u32,
    /// Each seam's first entry in the buffer of sides.
    pub first_side: [u32; 3],
    /// How many sides each seam has, 2 on a manifold.
    pub side_count: [u32; 3],
    /// Least height along each seam, rounded down.
    pub height_min: [f32; 3],
    /// Greatest height along each seam, rounded up.
    pub height_max: [f32; 3],
    /// Each decided corner's first entry in the buffer of sides: a reading is a side of no length.
    pub first_reading: [u32; 3],
    /// How many different readings each decided corner has.
    pub reading_count: [u32; 3],
}

/// What one triangle at a seam, or at a decided corner, reads its heights from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SeamSide {
    /// Texture coordinates at the seam's end of the lower vertex index.
    pub start: [f32; 2],
    /// Texture coordinates at its other end.
    pub end: [f32; 2],
    /// Index of the triangle's [`Displacement`].
    pub displacement: u32,
    /// The triangle's vertices at both ends, along whose axes vectors are, and whose
    /// [`TexelScale`]s filtered maps are read by.
    pub vertices: [u32; 2],
}

/// A node of the binary BVH. Inner nodes have their two children side by side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct BvhNode {
    /// Lower corner of its box.
    pub min: Vec3,
    /// Leaf: first index into the primitives. Inner node: index of the first child; the second follows it. Both count
    /// from where those of the tree begin: see [`Instance`]. A leaf of the tree over instances: the index of its only
    /// one.
    pub first: u32,
    /// Upper corner of its box.
    pub max: Vec3,
    /// Leaf: how many primitives. Inner node: 0.
    pub count: u32,
}

/// A mesh in a place. Several may place the same one.
///
/// With instances the buffer of nodes holds the tree over them, then those of the meshes, each by itself; the buffer of
/// primitives holds what their leaves point to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Instance {
    /// Takes points of the mesh, its *object space*, to the world: three rows, each of three factors and what is added.
    pub world_from_object: [[f32; 4]; 3],
    /// The inverse, rounded.
    pub object_from_world: [[f32; 4]; 3],
    /// The root of the mesh's tree in the buffer of nodes.
    pub first_node: u32,
    /// The mesh's first triangle; in the buffer of primitives what its leaves point to begins at the same place.
    pub first_triangle: u32,
    /// How many triangles the mesh has. Traversal does not read it.
    pub triangle_count: u32,
    /// The greatest length to which the transform takes a unit vector over the least one, or more where it shears: for
    /// what judges by distances in object space. 1 where it keeps shapes.
    pub stretch: f32,
}

/// A point light whose irradiance at distance d is `intensity / d²` (facing it).
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PointLight {
    /// Where it is, in model units.
    pub position: Vec3,
    /// Strength, in model units squared.
    pub intensity: f32,
    /// Linear RGB.
    pub color: Vec3,
    /// Unused.
    pub padding: u32,
}

/// A pinhole camera: the ray through film coordinates (x, y) in [0, 1]², y down, has the direction
/// `forward + (2x-1) right + (1-2y) up`, normalised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Camera {
    /// The pinhole.
    pub eye: Vec3,
    /// Unused.
    pub padding0: u32,
    /// Half the film's width at distance 1.
    pub right: Vec3,
    /// Unused.
    pub padding1: u32,
    /// Half the film's height at distance 1.
    pub up: Vec3,
    /// Unused.
    pub padding2: u32,
    /// Unit view direction.
    pub forward: Vec3,
    /// Unused.
    pub padding3: u32,
}

/// What a surface looks like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Material {
    /// Linear RGB without a colour map.
    pub albedo: Vec3,
    /// How its colour map's texels are stored: [`color_format`].
    pub color_format: u32,
    /// Width of the colour map in texels.
    pub color_width: u32,
    /// Height of the colour map in texels.
    pub color_height: u32,
    /// How the colour map goes on beyond its borders: [`wrap`].
    pub color_wrap: u32,
    /// The colour map's first word in the buffer of colour texels.
    pub first_word: u32,
}

/// A height map and what it does: height = `scale * (texel - zero)`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Displacement {
    /// Height of a texel step from 0 to 1, in model units; may be negative.
    pub scale: f32,
    /// The texel value of no displacement.
    pub zero: f32,
    /// Width of the height map in texels, at least 1.
    pub map_width: u32,
    /// Height of the height map in texels, at least 1.
    pub map_height: u32,
    /// Least height of the map, rounded down.
    pub height_min: f32,
    /// Greatest height of the map, rounded up.
    pub height_max: f32,
    /// Word of its first texel in the buffer of height texels.
    pub first_word: u32,
    /// Word of its pyramid's first range in the buffer of height ranges.
    pub first_range: u32,
    /// How its texels are stored: [`height_format`].
    pub format: u32,
    /// How the map goes on beyond its borders: [`wrap`].
    pub wrap: u32,
    /// What its levels differ from it by: level l, filtered, at most by `roughness` 2^l, in texels' values. 0 where it
    /// has no levels.
    pub roughness: f32,
}

/// What all pixels of a picture share.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Frame {
    /// The camera.
    pub camera: Camera,
    /// Width of the film in pixels.
    pub width: u32,
    /// Height of the film in pixels.
    pub height: u32,
    /// Seed of the random numbers.
    pub seed: u32,
    /// How many lights.
    pub light_count: u32,
    /// Linear RGB behind the surface.
    pub background: Vec3,
    /// 1 where the background is opaque, 0 where it is transparent.
    pub background_alpha: f32,
    /// Light that reaches every point, as a share of full light.
    pub ambient: f32,
    /// How many triangles; the BVH is not read where there are none.
    pub triangle_count: u32,
    /// [`shade::STEPS`]: the count that is shown red.
    pub steps_scale: u32,
    /// N: parts of each side of a triangle, 1 to [`MAX_SUBDIVISIONS`]. Where N is adaptive the most parts, a power of
    /// two.
    pub subdivisions: u32,
    /// Least height of all maps, rounded down.
    pub height_min: f32,
    /// Greatest height of all maps, rounded up.
    pub height_max: f32,
    /// Where N is adaptive: 1 / l², l the length that a part of an edge may have at distance 1 from the eye. Above 0.
    pub detail: f32,
    /// Unused.
    pub padding: u32,
}

impl Frame {
    /// Side of a pixel at distance 1.
    #[inline]
    pub fn pixel_side(&self) -> f32 {
        2.0 * self.camera.up.length() / self.height as f32
    }
}

impl Triangle {
    /// Index of its [`Material`].
    #[inline]
    pub fn material(&self) -> u32 {
        self.flags >> MATERIAL_SHIFT
    }

    /// The same triangle of another material, below [`MAX_MATERIALS`].
    #[inline]
    pub fn with_material(self, material: u32) -> Triangle {
        Triangle { flags: self.flags & FLIPPED | material << MATERIAL_SHIFT, ..self }
    }
}

impl Displacement {
    /// How the map's texels are stored, `known` being what a pipeline knows of all maps.
    #[inline]
    pub fn known_format(&self, known: u32) -> u32 {
        if known == height_format::PER_MAP { self.format } else { known }
    }

    /// How the map goes on beyond its borders, `known` being what a pipeline knows of all maps.
    #[inline]
    pub fn known_wrap(&self, known: u32) -> u32 {
        if known == wrap::PER_MAP { self.wrap } else { known }
    }
}

/// Which tiles of a film a dispatch of `render` or `resolve` covers, as push constants: squares of [`TILE_GROUP_SIZE`]
/// pixels, a workgroup each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Tiles {
    /// Number of the first.
    pub first: u32,
    /// How many.
    pub count: u32,
    /// Whether they are numbered so that any part of them is [spread](crate::film::tile) over the film: 1, or else 0.
    pub spread: u32,
    /// Index of the sample to add.
    pub sample: u32,
}

/// How many items (rays, triangles, seams, probes) a batch dispatch covers, as push constants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Batch {
    /// Index of the first item.
    pub first: u32,
    /// How many items.
    pub count: u32,
    /// `probe`: which kernel, one of [`probe`](crate::probe). `tree_nodes`: which level of the heaps.
    pub kernel: u32,
}

/// Which words of a height map's pyramid one dispatch of `height_pyramid` builds, as push constants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct PyramidPart {
    /// Index of the [`Displacement`].
    pub displacement: u32,
    /// The level, at least 1.
    pub level: u32,
    /// Index of the first word within the level.
    pub first: u32,
    /// How many words.
    pub count: u32,
}

/// What one dispatch of the BVH's build does, as push constants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct BuildStep {
    /// How many primitives there are, sound or not.
    pub count: u32,
    /// Words of a sort key: 1 or 2.
    pub limbs: u32,
    /// `bvh_choose`, `bvh_move`: the level of the tree's top, from 0. `bvh_treelets`: 0, or 1 to do again what came
    /// out too deep.
    pub level: u32,
    /// How many levels the tree's top may have below its root.
    pub level_limit: u32,
}

/// One pass of a [`radix_sort`](crate::bvh::radix_sort), as push constants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct SortPass {
    /// How many pairs.
    pub count: u32,
    /// Words of a key, 1 or 2.
    pub limbs: u32,
    /// Lowest bit of the digit to sort by: a multiple of 8 below 32 `limbs`.
    pub shift: u32,
    /// In which half of the buffers the pairs stand, 0 or 1; they go to the other one.
    pub from: u32,
}

/// The sum of the samples of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FilmPixel {
    /// Linear RGB, premultiplied by coverage. (An array, since a `Vec3` would ask for a stride of 32 bytes.)
    pub radiance: [f32; 3],
    /// Coverage.
    pub alpha: f32,
    /// How many samples.
    pub samples: u32,
}

/// A 64-bit counter made of two words, since 64-bit atomics are not in Vulkan 1.2's core.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Counter {
    /// Lower word.
    pub low: u32,
    /// Upper word: how often the lower one overflowed.
    pub high: u32,
}

/// A ray for `trace_rays`: hits at `origin + t * direction` with `0 <= t <= t_max` count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Ray {
    /// Where it starts.
    pub origin: Vec3,
    /// Its end, in lengths of `direction`; may be infinite.
    pub t_max: f32,
    /// Where it goes; any finite length above zero.
    pub direction: Vec3,
    /// Unused.
    pub padding: u32,
}

/// What `trace_rays` reports of a ray's nearest hit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Intersection {
    /// The hit point.
    pub point: Vec3,
    /// Its distance in lengths of the ray's direction; infinite on a miss.
    pub t: f32,
    /// Unit geometric normal of the micro-triangle, to the outside of the base mesh.
    pub normal: Vec3,
    /// Index of the base triangle, or [`MISS`].
    pub primitive: u32,
    /// Bound on the error of each coordinate of `point`.
    pub point_error: Vec3,
    /// The micro-triangle: a packed [`Cell`](crate::displacement::cell::Cell).
    pub cell: u32,
    /// Barycentric coordinates on the micro-triangle of its second and third vertex.
    pub b1: f32,
    /// See `b1`.
    pub b2: f32,
    /// Texture coordinates.
    pub u: f32,
    /// See `u`.
    pub v: f32,
    /// The [`Instance`] whose triangle it is; 0 where there are none.
    pub instance: u32,
    /// Unused.
    pub padding: [u32; 3],
}

const _: () = {
    assert!(size_of::<Vertex>() == 32);
    assert!(size_of::<Triangle>() == 32);
    assert!(size_of::<Seams>() == 124);
    assert!(size_of::<SeamSide>() == 28);
    assert!(size_of::<Tangent>() == 16);
    assert!(size_of::<BvhNode>() == 32);
    assert!(size_of::<Instance>() == 112);
    assert!(size_of::<PointLight>() == 32);
    assert!(size_of::<Camera>() == 64);
    assert!(size_of::<Material>() == 32);
    assert!(size_of::<Displacement>() == 44);
    assert!(size_of::<TexelScale>() == 8);
    assert!(size_of::<Frame>() == 128);
    assert!(size_of::<Tiles>() == 16);
    assert!(size_of::<Batch>() == 12);
    assert!(size_of::<PyramidPart>() == 16);
    assert!(size_of::<BuildStep>() == 16);
    assert!(size_of::<SortPass>() == 16);
    assert!(size_of::<FilmPixel>() == 20);
    assert!(size_of::<Counter>() == 8);
    assert!(size_of::<Ray>() == 32);
    assert!(size_of::<Intersection>() == 80);
};

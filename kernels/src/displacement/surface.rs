//! The micro-triangle surface: what every method intersects.

use crate::aabb::Aabb;
use crate::barycentric::{exact_weight, grid_point, interpolate, interpolate2};
use crate::displacement::cell::Cell;
use crate::displacement::height_pyramid::Pyramid;
use crate::displacement::quadtree::{Node, RayFrame};
use crate::displacement::subdivisions::{Subdivisions, Viewpoint};
use crate::displacement::{vector, vector_bounds};
use crate::hit::Hit;
use crate::interface::{
    Displacement, FLIPPED, NO_SEAMS, SeamSide, Seams, Tangent, TexelScale, Triangle, Vertex,
    displacement_kind, filter, method, normals,
};
use crate::math::{MinMax, UNIT_ROUNDOFF, at, cross, dot, fma3, max_abs, sqrt};
use crate::ray::TraversalRay;
use crate::scene::{Features, SceneView};
use crate::texture::{HeightTexels, Level, LevelOfDetail};
use crate::triangle;
use glam::{Vec2, Vec3};

/// The height field over the base mesh: h(t) = scale (texel(t) - zero), each base triangle by its own map. Of vector
/// displacement three of them, an axis each.
#[derive(Clone, Copy)]
pub struct HeightField<'a> {
    /// The maps' texels.
    pub texels: &'a [u32],
    /// The maps' min/max pyramids.
    pub ranges: &'a [u32],
    displacements: &'a [Displacement],
    seams: &'a [Seams],
    seam_sides: &'a [SeamSide],
    vertices: &'a [Vertex],
    tangents: &'a [Tangent],
    /// What heights are along: see [`displacement_kind`].
    pub kind: u32,
    /// How texels are stored: see [`height_format`](crate::interface::height_format).
    format: u32,
    /// How maps go on beyond their borders: see [`wrap`](crate::interface::wrap).
    wrap: u32,
    /// Whether directions are unit vectors: see [`normals`].
    pub normals: u32,
    /// N: parts of each side of a base triangle. Where it is adaptive that of one, see
    /// [`of_triangle`](Self::of_triangle).
    pub subdivisions: u32,
    /// [`Subdivisions::steps`] of that triangle; not read unless N is adaptive.
    steps: [u32; 3],
    /// What N follows where it is adaptive.
    pub viewpoint: Viewpoint,
    /// Whether N is adaptive.
    is_adaptive: bool,
    /// Whether meshes are seen in places of their own.
    is_placed: bool,
    /// Whether any triangle has seams.
    welded: bool,
    /// How maps are read: see [`filter`].
    filter: u32,
    texel_scales: &'a [TexelScale],
    /// Least and greatest height of all maps.
    heights: (f32, f32),
}

/// A pixel where a map is read, in model units.
#[derive(Clone, Copy)]
pub struct Pixel {
    /// Its side.
    side: f32,
    /// How large texels are.
    texels: TexelScale,
}

impl Pixel {
    /// One for fields that are not filtered by levels, and for what is read of the map itself.
    pub const NONE: Pixel = Pixel { side: 0.0, texels: TexelScale { size: 0.0, span: 0.0 } };

    /// How many texels of `map` it covers a side: so many that what they differ by is less than half of it.
    #[inline]
    fn texels_across(&self, map: &Displacement) -> f32 {
        (self.side / finest(map, self.texels.size)).min_num(self.texels.span)
    }
}

/// The side of a pixel from which on levels of `map` are read, in model units: that of a texel, or more where the
/// relief is so rough that levels would be off by half a pixel.
#[inline]
fn finest(map: &Displacement, texel: f32) -> f32 {
    texel.max_num(ROUGHNESS_SIDES * (map.scale * map.roughness).abs())
}

/// How many times its roughness a pixel must be wide: then a level's filtered heights, which differ from the map's by
/// the roughness times the texels that the pixel covers, differ by less than [`MOST_ERROR`] pixels.
const ROUGHNESS_SIDES: f32 = 2.2;
/// What levels change heights by, in pixels: above 1 / [`ROUGHNESS_SIDES`] by a tenth, for what is rounded.
const MOST_ERROR: f32 = 0.5;

impl<'a> HeightField<'a> {
    /// The height field of a scene.
    #[inline]
    pub fn new(scene: &SceneView<'a>, features: Features) -> Self {
        HeightField {
            texels: scene.height_texels,
            ranges: scene.height_ranges,
            displacements: scene.displacements,
            seams: scene.seams,
            seam_sides: scene.seam_sides,
            vertices: scene.vertices,
            tangents: scene.tangents,
            kind: features.displacement,
            format: features.height_format,
            wrap: features.height_wrap,
            normals: features.normals,
            subdivisions: scene.frame.subdivisions,
            steps: [1, 1, 1],
            viewpoint: Viewpoint::new(scene.frame),
            is_adaptive: features.adaptive != 0,
            is_placed: features.instances != 0,
            welded: features.seams != 0,
            filter: features.filter,
            texel_scales: scene.texel_scales,
            heights: (scene.frame.height_min, scene.frame.height_max),
        }
    }

    /// Whether maps are filtered by their levels.
    #[inline]
    pub fn is_filtered(&self) -> bool {
        self.filter != filter::BILINEAR
    }

    /// How large texels are at vertex number `i`, where maps are filtered by their levels: size, span.
    #[inline]
    pub fn texel_scale(&self, i: u32) -> Vec2 {
        let scale = at(self.texel_scales, i);
        Vec2::new(scale.size, scale.span)
    }

    /// How many texels a side pixels cover at vertex number `i` at the most; 1 where maps are not filtered by their
    /// levels.
    #[inline]
    pub(super) fn span(&self, i: u32) -> f32 {
        if self.filter == filter::BILINEAR { 1.0 } else { self.texel_scale(i).y }
    }

    /// The least size of texels at three vertices, where maps are filtered by their levels.
    #[inline]
    pub(super) fn least_texel(&self, vertices: [u32; 3]) -> f32 {
        let [a, b, c] = vertices;
        self.texel_scale(a).x.min_num(self.texel_scale(b).x).min_num(self.texel_scale(c).x)
    }

    /// A bound on the side of pixels on the displaced surface over points at `distance` from the eye, from below: one
    /// that is displaced towards it is as much nearer.
    #[inline]
    fn pixel_side(&self, distance: f32) -> f32 {
        self.viewpoint.pixel * (distance - self.viewpoint.reach).max_num(0.0)
    }

    /// The pixel over the point `p` of a base triangle or of its edge, with barycentric coordinates `w` and these
    /// vertices: from what both triangles at an edge know.
    #[inline]
    pub(super) fn pixel_at(&self, p: Vec3, w: Vec3, vertices: [u32; 3]) -> Pixel {
        if self.filter == filter::BILINEAR {
            return Pixel::NONE;
        }
        let [a, b, c] = vertices;
        let texels = interpolate2(w, self.texel_scale(a), self.texel_scale(b), self.texel_scale(c));
        let to_eye = p - self.viewpoint.eye;
        let distance = sqrt(dot(to_eye, to_eye));
        // Weights may add up to more than 1 by an ulp, and boxes hold levels up to the greatest span.
        let span = texels.y.min_num(self.span(a).max_num(self.span(b)).max_num(self.span(c)));
        Pixel { side: self.pixel_side(distance), texels: TexelScale { size: texels.x, span } }
    }

    /// By how much filtered heights of `map` can differ from those of the map itself over points that are no farther
    /// from the eye than `distance`; 0 where no level is read there. `texel` is the least size of texels there.
    #[inline]
    pub(super) fn filter_error(&self, map: &Displacement, distance: f32, texel: f32) -> f32 {
        // Distances are computed in other ways than a micro-vertex's own, off by some 20 u.
        let side = self.pixel_side(distance * (1.0 + 1e-5)) * (1.0 + 1e-5);
        // Negated so that NaN counts.
        if !(side <= finest(map, texel)) { MOST_ERROR * side } else { 0.0 }
    }

    /// The height field as base triangle `primitive` is cut and seen in instance number `instance`, which is not read
    /// where there are none. What concerns micro-triangles takes this one.
    #[inline]
    pub fn of_triangle(self, scene: &SceneView<'_>, primitive: u32, instance: u32) -> Self {
        let field = self.within(scene, instance);
        let mut cut = Subdivisions::uniform(field.subdivisions);
        if field.is_adaptive {
            let [a, b, c] = at(scene.triangles, primitive).vertices;
            let position = |i: u32| at(scene.vertices, i).position;
            cut = field.viewpoint.subdivisions(position(a), position(b), position(c));
        }
        field.cut(cut)
    }

    /// The height field of [`of_triangle`](Self::of_triangle) for one whose cut is known; not read unless N is
    /// adaptive.
    #[inline]
    pub fn of_cut_triangle(self, scene: &SceneView<'_>, cut: Subdivisions, instance: u32) -> Self {
        let field = self.within(scene, instance);
        let uniform = Subdivisions::uniform(field.subdivisions);
        field.cut(if field.is_adaptive { cut } else { uniform })
    }

    /// The height field as it is seen in instance number `instance`.
    #[inline]
    fn within(self, scene: &SceneView<'_>, instance: u32) -> Self {
        // Not a choice between two height fields: what is copied as a whole is not known field by field, constants
        // among it.
        let mut viewpoint = self.viewpoint;
        if self.is_placed && (self.is_adaptive || self.is_filtered()) {
            viewpoint = viewpoint.within(&at(scene.instances, instance));
        }
        HeightField { viewpoint, ..self }
    }

    /// The height field of a base triangle that is cut in this way; N must be adaptive unless it is cut the same
    /// everywhere.
    #[inline]
    pub fn cut(self, cut: Subdivisions) -> Self {
        HeightField { subdivisions: cut.triangle, steps: cut.steps, ..self }
    }

    /// How the base triangle is cut.
    #[inline]
    pub fn cutting(&self) -> Subdivisions {
        Subdivisions {
            triangle: self.subdivisions,
            steps: if self.is_adaptive { self.steps } else { [1, 1, 1] },
        }
    }

    /// Barycentric coordinates of the point over which grid point (j, k) is displaced: its own, but for those on edges
    /// of fewer parts than the triangle ([`Subdivisions::snapped`]).
    #[inline]
    pub fn weights(&self, j: u32, k: u32) -> Vec3 {
        let n = self.subdivisions;
        if self.is_adaptive {
            let (j, k) = self.cutting().snapped(j, k);
            Vec3::new(exact_weight(n - j - k, n), exact_weight(j, n), exact_weight(k, n))
        } else {
            grid_point(j, k, n)
        }
    }

    /// The root of how many times the base triangle is as large as a cell in barycentric coordinates: N, but for cells
    /// at edges of fewer parts. Infinite where such a cell has no area.
    #[inline]
    pub fn parts(&self, cell: Cell) -> f32 {
        let n = self.subdivisions as f32;
        if self.is_adaptive { n / sqrt(self.cutting().cells(cell) as f32) } else { n }
    }

    /// Whether N is that of each triangle.
    #[inline]
    pub fn is_adaptive(&self) -> bool {
        self.is_adaptive
    }

    /// Whether any triangle has seams.
    #[inline]
    pub fn is_welded(&self) -> bool {
        self.welded
    }

    /// Whether displacement is by vectors.
    #[inline]
    pub fn is_vector(&self) -> bool {
        self.kind != displacement_kind::HEIGHT
    }

    /// Vertex number `i`.
    #[inline]
    pub fn vertex(&self, i: u32) -> Vertex {
        at(self.vertices, i)
    }

    /// Tangent of vertex number `i`, where displacement is in tangent space.
    #[inline]
    pub fn tangent(&self, i: u32) -> Tangent {
        at(self.tangents, i)
    }

    /// Map number `i`.
    #[inline]
    pub fn displacement(&self, i: u32) -> Displacement {
        at(self.displacements, i)
    }

    /// Side number `i` of the seams.
    #[inline]
    pub fn seam_side(&self, i: u32) -> SeamSide {
        at(self.seam_sides, i)
    }

    /// A map of its with the map's pyramid.
    #[inline]
    pub fn pyramid(&self, map: Displacement) -> Pyramid<'a> {
        let (format, wrap) = (map.known_format(self.format), map.known_wrap(self.wrap));
        Pyramid { texels: self.texels, ranges: self.ranges, map, format, wrap }
    }

    /// Height in model units that a map gives at texture coordinates `uv`, which must be finite, to the `pixel` there.
    #[inline]
    pub fn height(&self, map: &Displacement, uv: Vec2, pixel: Pixel) -> f32 {
        let (texels, finest) = self.map_texels(map);
        let texel = texels.sample(finest, uv, self.detail(map, pixel));
        map.scale * (texel - map.zero)
    }

    /// Between which levels of `map` a pixel is read.
    #[inline]
    fn detail(&self, map: &Displacement, pixel: Pixel) -> LevelOfDetail {
        if self.filter == filter::BILINEAR {
            LevelOfDetail::FINEST
        } else {
            LevelOfDetail::new(pixel.texels_across(map))
        }
    }

    /// The texels of a map of its, and their finest level.
    #[inline]
    fn map_texels(&self, map: &Displacement) -> (HeightTexels<'a>, Level) {
        let texels = HeightTexels {
            texels: self.texels,
            format: map.known_format(self.format),
            wrap: map.known_wrap(self.wrap),
            first_word: map.first_word,
        };
        (texels, Level::finest(map.map_width, map.map_height))
    }

    /// Growth of [`height`](Self::height) for a unit of each texture coordinate and a constant pixel.
    #[inline]
    pub fn height_gradient(&self, map: &Displacement, uv: Vec2, pixel: Pixel) -> Vec2 {
        let (texels, finest) = self.map_texels(map);
        texels.gradient(finest, uv, self.detail(map, pixel)) * map.scale
    }

    /// By what a direction interpolated between unit vectors is multiplied to displace by `height`: the height itself
    /// for linear directions. For normalised ones it is the height divided by the direction's length, and 0 where that
    /// is zero or all but, since there is no direction to displace in.
    #[inline]
    pub fn lift(&self, height: f32, direction: Vec3) -> f32 {
        if self.normals == normals::LINEAR {
            height
        } else {
            let length = sqrt(dot(direction, direction));
            if length > NO_DIRECTION { height / length } else { 0.0 }
        }
    }
}

impl Displacement {
    /// Bounds on every height that filtered texels in [`lowest`, `highest`] can give: rounded outward by the errors of
    /// the filter (4 ulp, see [`HeightTexels::sample`]), of the two operations after it, and of a filter that the range
    /// may come from (3 ulp).
    #[inline]
    pub fn height_range(lowest: f32, highest: f32, zero: f32, scale: f32) -> (f32, f32) {
        let (a, b) = (scale * (lowest - zero), scale * (highest - zero));
        let magnitude = lowest.abs().max_num(highest.abs()) + zero.abs();
        let error = 20.0 * UNIT_ROUNDOFF * magnitude * scale.abs();
        (a.min_num(b) - error, a.max_num(b) + error)
    }
}

/// A base triangle with its vertices' attributes, in the stored (ascending) order.
#[derive(Clone, Copy, Debug)]
pub struct BaseTriangle {
    /// Its index.
    pub primitive: u32,
    /// Whether the stored order is clockwise seen from outside.
    pub flipped: bool,
    /// Position of vertex 0.
    pub p0: Vec3,
    /// Position of vertex 1.
    pub p1: Vec3,
    /// Position of vertex 2.
    pub p2: Vec3,
    /// Unit normal of vertex 0.
    pub n0: Vec3,
    /// Unit normal of vertex 1.
    pub n1: Vec3,
    /// Unit normal of vertex 2.
    pub n2: Vec3,
    /// Texture coordinates of vertex 0.
    pub t0: Vec2,
    /// Texture coordinates of vertex 1.
    pub t1: Vec2,
    /// Texture coordinates of vertex 2.
    pub t2: Vec2,
    /// Least height of its own field over it.
    pub height_min: f32,
    /// Greatest height of its own field.
    pub height_max: f32,
    /// Indices of its vertices.
    pub vertices: [u32; 3],
    /// Its height map, of vector displacement the first of three.
    pub map: Displacement,
    /// Index of its [`Material`](crate::interface::Material).
    pub material: u32,
    /// The map's index.
    pub displacement: u32,
    /// Index of its [`Seams`], or [`NO_SEAMS`].
    pub seams: u32,
}

/// An interpolated normal no longer than this has no direction: its square is near what floats can hold, or rounding.
pub(super) const NO_DIRECTION: f32 = 1e-15;

/// Along which direction a micro-vertex is displaced, and how far.
#[derive(Clone, Copy)]
struct Site {
    direction: Vec3,
    /// The height, unless it is the triangle's own map's.
    height: f32,
    /// Whether it is.
    own: bool,
}

impl BaseTriangle {
    /// Reads base triangle `primitive`.
    #[inline]
    pub fn load(scene: &SceneView<'_>, primitive: u32) -> Self {
        let triangle: Triangle = at(scene.triangles, primitive);
        let a = at(scene.vertices, triangle.vertices[0]);
        let b = at(scene.vertices, triangle.vertices[1]);
        let c = at(scene.vertices, triangle.vertices[2]);
        BaseTriangle {
            primitive,
            flipped: triangle.flags & FLIPPED != 0,
            p0: a.position,
            p1: b.position,
            p2: c.position,
            n0: a.normal,
            n1: b.normal,
            n2: c.normal,
            t0: Vec2::new(a.u, a.v),
            t1: Vec2::new(b.u, b.v),
            t2: Vec2::new(c.u, c.v),
            height_min: triangle.height_min,
            height_max: triangle.height_max,
            vertices: triangle.vertices,
            map: at(scene.displacements, triangle.displacement),
            material: triangle.material(),
            displacement: triangle.displacement,
            seams: triangle.seams,
        }
    }

    /// Texture coordinates at barycentric coordinates `w`.
    #[inline]
    pub fn uv(&self, w: Vec3) -> Vec2 {
        interpolate2(w, self.t0, self.t1, self.t2)
    }

    /// The pixel at barycentric coordinates `w`.
    #[inline]
    pub fn pixel(&self, field: &HeightField<'_>, w: Vec3) -> Pixel {
        field.pixel_at(interpolate(w, self.p0, self.p1, self.p2), w, self.vertices)
    }

    /// Whether positions, normals and texture coordinates are numbers, none of them infinite.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.p0.is_finite()
            && self.p1.is_finite()
            && self.p2.is_finite()
            && self.n0.is_finite()
            && self.n1.is_finite()
            && self.n2.is_finite()
            && self.t0.is_finite()
            && self.t1.is_finite()
            && self.t2.is_finite()
    }

    /// Whether some of its border is decided with its neighbours.
    #[inline]
    pub fn has_seams(&self, field: &HeightField<'_>) -> bool {
        field.welded && self.seams != NO_SEAMS
    }

    /// Its seams; there must be some.
    #[inline]
    pub fn seams(&self, field: &HeightField<'_>) -> Seams {
        at(field.seams, self.seams)
    }

    /// The micro-vertex over grid point (j, k), at `p + lift * n`, p and n interpolated linearly over the base
    /// triangle. The lift is the [height's](HeightField::lift). Vectors displace it as [`vector`] says.
    ///
    /// Every operation is fused or fixed in order, and [`interpolate`] drops the vertex across an edge, so both
    /// base triangles at an edge compute its micro-vertices to the same bits: from the vertices where they share them,
    /// from [`Seams`] where they do not.
    #[inline]
    pub fn micro_vertex(&self, field: &HeightField<'_>, j: u32, k: u32) -> Vec3 {
        let n = field.subdivisions;
        let w = field.weights(j, k);
        let p = interpolate(w, self.p0, self.p1, self.p2);
        let on_seam = self.has_seams(field) && (j == 0 || k == 0 || j + k == n);
        // No early return: spirv-opt keeps what follows one, though a constant decides.
        if field.is_vector() {
            vector::micro_vertex(field, self, w, p, on_seam)
        } else {
            self.lifted(field, w, p, on_seam)
        }
    }

    /// [`micro_vertex`](Self::micro_vertex) by a height, at barycentric coordinates `w` over the point `p`. `on_seam`:
    /// whether `w` is on the border and some of that is decided with neighbours.
    #[inline]
    fn lifted(&self, field: &HeightField<'_>, w: Vec3, p: Vec3, on_seam: bool) -> Vec3 {
        let mut site = Site { direction: interpolate(w, self.n0, self.n1, self.n2), height: 0.0, own: true };
        if on_seam {
            site = self.site_on_border(field, w, p, site);
        }
        let h = if site.own {
            field.height(&self.map, self.uv(w), field.pixel_at(p, w, self.vertices))
        } else {
            site.height
        };
        fma3(field.lift(h, site.direction), site.direction, p)
    }

    /// The lift of the micro-vertex over grid point (j, k) where its height is the triangle's own map's: what
    /// [`micro_vertex`](Self::micro_vertex) multiplies its direction by.
    #[inline]
    pub fn own_lift(&self, field: &HeightField<'_>, j: u32, k: u32) -> f32 {
        let w = field.weights(j, k);
        let p = interpolate(w, self.p0, self.p1, self.p2);
        let h = field.height(&self.map, self.uv(w), field.pixel_at(p, w, self.vertices));
        field.lift(h, interpolate(w, self.n0, self.n1, self.n2))
    }

    /// What decides the micro-vertex at `w`, a point of the triangle's border over `p`; `inner` where that is the
    /// triangle itself.
    fn site_on_border(&self, field: &HeightField<'_>, w: Vec3, p: Vec3, inner: Site) -> Site {
        let seams = self.seams(field);
        let corner = corner_at(w);
        let at_corner = corner < 3;
        let edge = edge_at(w);
        let decided = seams.flags >> (if at_corner { corner } else { 3 + edge }) & 1 != 0;
        if !decided {
            return inner;
        }
        let direction = if at_corner {
            seams.direction(corner)
        } else {
            interpolate(w, seams.direction(0), seams.direction(1), seams.direction(2))
        };
        if at_corner && !field.is_filtered() {
            return Site { direction, height: component(seams.heights, corner), own: false };
        }
        // A reading at a corner is a side of no length.
        let (first, count, along) = if at_corner {
            (component(seams.first_reading, corner), component(seams.reading_count, corner), Vec3::X)
        } else {
            (component(seams.first_side, edge), component(seams.side_count, edge), along_edge(w, edge))
        };
        let mut sum = 0.0;
        let mut i = 0;
        while i < count {
            let side = field.seam_side(first + i);
            let (start, end) = (Vec2::from_array(side.start), Vec2::from_array(side.end));
            let uv = interpolate2(along, start, end, Vec2::ZERO);
            let [a, b] = side.vertices;
            let pixel = field.pixel_at(p, along, [a, b, b]);
            sum += field.height(&field.displacement(side.displacement), uv, pixel);
            i += 1;
        }
        Site { direction, height: sum / count as f32, own: false }
    }

    /// The three micro-vertices of a cell, in its order.
    #[inline]
    pub fn micro_triangle(&self, field: &HeightField<'_>, cell: Cell) -> [Vec3; 3] {
        // A loop, so that the code of a micro-vertex stands in a kernel once and not three times.
        let mut corners = [Vec3::ZERO; 3];
        let mut e = 0;
        while e < 3 {
            let (j, k) = cell.vertex(e);
            corners[e as usize] = self.micro_vertex(field, j, k);
            e += 1;
        }
        corners
    }

    /// The nearer of `nearest` and the ray's hit on the micro-triangle (a, b, c) of `cell`.
    #[inline]
    pub fn intersect_cell(
        &self,
        ray: &TraversalRay,
        cell: Cell,
        a: Vec3,
        b: Vec3,
        c: Vec3,
        nearest: Hit,
    ) -> Hit {
        let corners = [ray.shear_point(a), ray.shear_point(b), ray.shear_point(c)];
        intersect_micro_triangle(self.primitive, ray, cell, corners, nearest)
    }

    /// A lower bound on the length of the interpolated normal over the triangle; 0 where the normals spread so far
    /// that none above 0.1 is proven, and where one is zero.
    ///
    /// It is the distance from 0 to the triangle (n0, n1, n2): to its plane where the foot lies inside, else to the
    /// nearest edge, that of two unit vectors of cosine c being sqrt((1 + c) / 2).
    #[inline]
    pub fn shortest_normal(&self) -> f32 {
        let (n0, n1, n2) = (self.n0, self.n1, self.n2);
        let c = dot(n0, n1).min_num(dot(n1, n2)).min_num(dot(n2, n0));
        let to_edges = (0.5 + 0.5 * c).max_num(0.0);
        // The foot of the perpendicular is inside where no edge sees it from outside.
        let m = cross(n1 - n0, n2 - n0);
        let (w0, w1, w2) = (dot(m, cross(n1, n2)), dot(m, cross(n2, n0)), dot(m, cross(n0, n1)));
        let inside = w0 > 0.0 && w1 > 0.0 && w2 > 0.0;
        let to_plane = dot(m, n0) * dot(m, n0) / dot(m, m);
        let squared = if inside { to_plane.min_num(to_edges) } else { to_edges };
        // All of that is of unit vectors; a vertex without a normal leaves none.
        let whole = dot(n0, n0).min_num(dot(n1, n1)).min_num(dot(n2, n2)) > 0.5;
        let squared = if whole { squared } else { 0.0 };
        // Stored unit normals are off by some 1e-7, and so is all that follows from them; above the threshold that is
        // a relative 1e-5.
        if squared > 0.01 { sqrt(squared) * (1.0 - 2e-5) } else { 0.0 }
    }

    /// Bounds on the lift of every micro-vertex whose height is its own field's: heights as they are for linear
    /// directions, widened by 1 / min |n| for normalised ones (DESIGN's hull). `shortest` is a positive
    /// [`shortest_normal`](Self::shortest_normal).
    #[inline]
    pub fn lift_range(&self, field: &HeightField<'_>, shortest: f32) -> (f32, f32) {
        let (low, high) = (self.height_min, self.height_max);
        if field.normals == normals::LINEAR {
            (low, high)
        } else {
            (low.min_num(low / shortest), high.max_num(high / shortest))
        }
    }

    /// A box that holds every micro-triangle.
    ///
    /// Of vector displacement the bound that the quadtree has of the whole triangle, and the base triangle's box grown
    /// by the greatest length (axes are no longer than unit vectors).
    ///
    /// For its own field two bounds, both valid, intersected: the hull of the six points p_i + lift n_i at the ends of
    /// the lift's range (every displaced point is a convex combination of them), and the base triangle's box grown by
    /// the greatest height (directions are no longer than unit vectors). Seams add the hulls of four points each, or
    /// their base edge's box grown by their greatest height. Padded by what rounding can move a micro-vertex.
    pub fn bounds(&self, field: &HeightField<'_>) -> Aabb {
        let reach = self.height_min.abs().max_num(self.height_max.abs());
        let flat = Aabb::EMPTY.including(self.p0).including(self.p1).including(self.p2);
        let magnitude = max_abs(self.p0).max_num(max_abs(self.p1)).max_num(max_abs(self.p2));
        if field.is_vector() {
            return self.vector_bounds(field, flat, magnitude);
        }
        let grown = flat.padded(reach);
        let shortest = self.shortest_normal();
        let mut bounds = grown;
        if shortest > 0.0 || field.normals == normals::LINEAR {
            let (low, high) = self.lift_range(field, shortest);
            let hull = Aabb::EMPTY
                .including(self.p0 + self.n0 * low)
                .including(self.p1 + self.n1 * low)
                .including(self.p2 + self.n2 * low)
                .including(self.p0 + self.n0 * high)
                .including(self.p1 + self.n1 * high)
                .including(self.p2 + self.n2 * high);
            bounds = hull.intersection(grown);
        }
        if self.has_seams(field) {
            let seams = self.seams(field);
            let mut e = 0;
            while e < 3 {
                let (a, b) = (self.position((e + 1) % 3), self.position((e + 2) % 3));
                if seams.flags >> e & 1 != 0 {
                    let (low, high) = seams.corner_range(field, e);
                    bounds = bounds
                        .including(self.position(e) + seams.direction(e) * low)
                        .including(self.position(e) + seams.direction(e) * high);
                }
                if seams.flags >> (3 + e) & 1 != 0 {
                    let (low, high) = seams.lift_range(field, e);
                    let (from, to) = (seams.direction((e + 1) % 3), seams.direction((e + 2) % 3));
                    let hull = Aabb::EMPTY
                        .including(a + from * low)
                        .including(b + to * low)
                        .including(a + from * high)
                        .including(b + to * high);
                    let wide = low.abs().max_num(high.abs());
                    let grown = Aabb::EMPTY.including(a).including(b).padded(wide);
                    let seam = if seams.directions_spread(field, e) { grown } else { hull };
                    bounds = bounds.including(seam.min).including(seam.max);
                }
                e += 1;
            }
        }
        // Position and direction of a micro-vertex are interpolated: weights are off by 5 u (Vulkan's division) and
        // sums of three products by 3 u. Its lift is off by 16 u: half of a dot product's 3 u, 9 u for the root (see
        // `sqrt`), 5 u for the division. A product and a sum put them together, and the corners of the hull too. That
        // is 11 u of positions and 28 u of the reach, and a rounding here.
        bounds.padded(32.0 * UNIT_ROUNDOFF * (magnitude + self.reach(field)))
    }

    /// A box that holds the base triangle itself, padded as [`bounds`](Self::bounds) are.
    #[inline]
    pub fn flat_bounds(&self) -> Aabb {
        let flat = Aabb::EMPTY.including(self.p0).including(self.p1).including(self.p2);
        let magnitude = max_abs(self.p0).max_num(max_abs(self.p1)).max_num(max_abs(self.p2));
        flat.padded(32.0 * UNIT_ROUNDOFF * magnitude)
    }

    /// [`bounds`](Self::bounds) of vector displacement. `flat`: the box of the base triangle. `magnitude`: of its
    /// greatest coordinate.
    fn vector_bounds(&self, field: &HeightField<'_>, flat: Aabb, magnitude: f32) -> Aabb {
        let reach = self.reach(field);
        // Two more products and sums than heights take, and 3 u of a bitangent; the mean of a seam's sides is in its
        // bound.
        let error = 40.0 * UNIT_ROUNDOFF * (magnitude + reach);
        let grown = flat.padded(reach + error);
        // Levels change heights by what depends on the view, which boxes do not.
        if field.is_filtered() {
            return grown;
        }
        let frame = RayFrame::along_axes(self.p0);
        let node = Node::root(field.subdivisions);
        let local = vector_bounds::of_node(field, self, &frame, &node, self.has_seams(field), 0, 0.0);
        // As in the quadtree, but for the frame's axes, which are exact, and its origin, which is added again.
        let size = max_abs(self.p1 - self.p0).max_num(max_abs(self.p2 - self.p0)) + reach;
        let of_bound =
            UNIT_ROUNDOFF * (64.0 * size + vector_bounds::ROUNDINGS_OF_REACH * reach + 2.0 * magnitude);
        let whole = Aabb { min: local.min + self.p0, max: local.max + self.p0 };
        whole.padded(error + of_bound).intersection(grown)
    }

    /// The greatest height of any micro-vertex, up or down.
    #[inline]
    pub fn reach(&self, field: &HeightField<'_>) -> f32 {
        let mut reach = self.height_min.abs().max_num(self.height_max.abs());
        if self.has_seams(field) {
            let seams = self.seams(field);
            let mut e = 0;
            while e < 3 {
                let seam = component(seams.height_min, e).abs().max_num(component(seams.height_max, e).abs());
                let corner = seams.corner_range(field, e);
                reach = reach.max_num(seam).max_num(corner.0.abs()).max_num(corner.1.abs());
                e += 1;
            }
        }
        reach
    }

    /// Position of vertex e = 0, 1 or 2.
    #[inline]
    pub fn position(&self, e: u32) -> Vec3 {
        if e == 0 {
            self.p0
        } else if e == 1 {
            self.p1
        } else {
            self.p2
        }
    }
}

/// The nearer of `nearest` and the ray's hit on the micro-triangle of `cell` of base triangle `primitive`. Its corners
/// are [sheared](TraversalRay::shear_point) for the ray.
#[inline]
pub(crate) fn intersect_micro_triangle(
    primitive: u32,
    ray: &TraversalRay,
    cell: Cell,
    [a, b, c]: [Vec3; 3],
    nearest: Hit,
) -> Hit {
    let packed = cell.pack();
    let hit = triangle::intersect_sheared(ray, a, b, c, ray.t_max);
    let left = primitive == ray.left_primitive && packed == ray.left_cell;
    if left || !hit.t.is_finite() {
        return nearest;
    }
    nearest.nearer(Hit { t: hit.t, primitive, cell: packed, b1: hit.b1, b2: hit.b2, ..Hit::NONE })
}

/// The corner whose barycentric coordinates `w` are, or 3.
#[inline]
pub(super) fn corner_at(w: Vec3) -> u32 {
    if w.x == 1.0 {
        0
    } else if w.y == 1.0 {
        1
    } else if w.z == 1.0 {
        2
    } else {
        3
    }
}

/// The edge on which `w`, a point of the border, lies.
#[inline]
pub(super) fn edge_at(w: Vec3) -> u32 {
    if w.x == 0.0 {
        0
    } else if w.y == 0.0 {
        1
    } else {
        2
    }
}

/// Weights of a seam's start and end at `w`, a point of edge `edge`: it starts at the lower of its vertices, which is
/// stored first.
#[inline]
pub(super) fn along_edge(w: Vec3, edge: u32) -> Vec3 {
    if edge == 0 {
        Vec3::new(w.y, w.z, 0.0)
    } else if edge == 1 {
        Vec3::new(w.x, w.z, 0.0)
    } else {
        Vec3::new(w.x, w.y, 0.0)
    }
}

impl Seams {
    /// Displacement direction at corner e = 0, 1 or 2.
    #[inline]
    pub fn direction(&self, e: u32) -> Vec3 {
        Vec3::from_array(if e == 0 {
            self.directions[0]
        } else if e == 1 {
            self.directions[1]
        } else {
            self.directions[2]
        })
    }

    /// Bounds on the height at corner `e`, which must be decided: of filtered maps those of all heights.
    #[inline]
    pub fn corner_range(&self, field: &HeightField<'_>, e: u32) -> (f32, f32) {
        let height = component(self.heights, e);
        if field.filter == filter::BILINEAR || field.is_vector() { (height, height) } else { field.heights }
    }

    /// Square of a lower bound on the length of directions interpolated along edge `e`: two unit vectors of cosine c
    /// leave sqrt((1 + c) / 2). Zero directions leave less: their bound is not above the threshold below either.
    #[inline]
    fn shortest_squared(&self, e: u32) -> f32 {
        let (a, b) = (self.direction((e + 1) % 3), self.direction((e + 2) % 3));
        let whole = dot(a, a).min_num(dot(b, b));
        if whole < 0.5 { 0.0 } else { 0.5 + 0.5 * dot(a, b) }
    }

    /// Whether directions along edge `e` may vanish, so that lifts are not bounded.
    #[inline]
    pub fn directions_spread(&self, field: &HeightField<'_>, e: u32) -> bool {
        field.normals != normals::LINEAR && !(self.shortest_squared(e) > 0.01)
    }

    /// Bounds on the lift of every micro-vertex on edge `e`, a seam; its range of heights where directions spread.
    #[inline]
    pub fn lift_range(&self, field: &HeightField<'_>, e: u32) -> (f32, f32) {
        let (low, high) = (component(self.height_min, e), component(self.height_max, e));
        if field.normals == normals::LINEAR || self.directions_spread(field, e) {
            return (low, high);
        }
        // As in `BaseTriangle::shortest_normal`, what rounding takes is a relative 1e-5.
        let shortest = sqrt(self.shortest_squared(e)) * (1.0 - 2e-5);
        (low.min_num(low / shortest), high.max_num(high / shortest))
    }
}

/// Component 0, 1 or 2.
#[inline]
pub(super) fn component<T: Copy>(v: [T; 3], i: u32) -> T {
    if i == 0 {
        v[0]
    } else if i == 1 {
        v[1]
    } else {
        v[2]
    }
}

/// [`BaseTriangle::bounds`] of a base triangle. One that is not finite has no bounds: its box is the empty one, whose
/// corners are infinite, since a box that takes in NaN may be any.
pub fn prism_bounds(scene: &SceneView<'_>, features: Features, primitive: u32) -> Aabb {
    let base = BaseTriangle::load(scene, primitive);
    let boxes = method::boxes(features.method, features.shade);
    let mut bounds = base.flat_bounds();
    if boxes != 1 {
        let displaced = base.bounds(&HeightField::new(scene, features));
        bounds = if boxes == 0 { displaced } else { displaced.including(bounds.min).including(bounds.max) };
    }
    if base.is_finite() { bounds } else { Aabb::EMPTY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::displacement::test_prism::Prism;
    use crate::interface::Vertex;
    use crate::math::tests::Numbers;
    use crate::test_scene::{FLAT, TestScene};

    /// One triangle with normals that lean by up to `spread`, a random 8x8 map, somewhere up to 1000 units away.
    fn random_scene(numbers: &mut Numbers, spread: f32) -> TestScene {
        let mut scene = TestScene::squares(&[0.0]);
        let offset = numbers.vec3() * if numbers.unit() < 0.5 { 0.0 } else { 1000.0 };
        let size = (numbers.unit() * 20.0 - 10.0).exp2();
        scene.vertices = (0..3)
            .map(|_| Vertex {
                position: offset + numbers.vec3() * size,
                normal: (Vec3::Z + numbers.vec3() * spread).normalize(),
                u: numbers.unit() * 5.0,
                v: numbers.unit() * 5.0,
            })
            .collect();
        let texels: Vec<f32> = (0..64).map(|_| numbers.unit()).collect();
        scene.frame.subdivisions = 1 + (numbers.unit() * 16.0) as u32;
        let d = &mut scene.displacements[0];
        (d.map_width, d.map_height) = (8, 8);
        (d.scale, d.zero) = (numbers.wide().clamp(-2.0, 2.0) * size, numbers.unit());
        (d.height_min, d.height_max) = Displacement::height_range(0.0, 1.0, d.zero, d.scale);
        for t in &mut scene.triangles {
            (t.height_min, t.height_max) = (d.height_min, d.height_max);
        }
        scene.height_texels = texels.into_iter().map(f32::to_bits).collect();
        scene
    }

    #[test]
    fn every_micro_vertex_lies_in_the_bounds() {
        let mut numbers = Numbers::new(21);
        for round in 0..20_000 {
            let scene = random_scene(&mut numbers, [0.0, 0.1, 0.5, 2.0, 100.0][round % 5]);
            let view = scene.view();
            let field = HeightField::new(&view, FLAT);
            let base = BaseTriangle::load(&scene.view(), 0);
            let bounds = base.bounds(&field);
            let n = scene.frame.subdivisions;
            for j in 0..=n {
                for k in 0..=n - j {
                    let q = base.micro_vertex(&field, j, k);
                    assert!(
                        q.cmpge(bounds.min).all() && q.cmple(bounds.max).all(),
                        "{q} {bounds:?} {base:?}"
                    );
                }
            }
        }
    }

    /// The same where vectors displace it.
    #[test]
    fn every_micro_vertex_that_vectors_displace_lies_in_the_bounds() {
        let mut numbers = Numbers::new(25);
        for round in 0..10_000 {
            let spread = [0.0, 0.1, 0.5, 2.0, 100.0][round % 5];
            let n = 1 + (numbers.unit() * 16.0) as u32;
            let kind = [displacement_kind::TANGENT, displacement_kind::OBJECT][round / 5 % 2];
            let relief = numbers.wide().clamp(-2.0, 2.0);
            let prism =
                Prism::random(&mut numbers, n, spread, relief).with_vectors(&mut numbers, kind, spread);
            let view = prism.view();
            for normals in [normals::NORMALIZED, normals::LINEAR] {
                let field = HeightField::new(&view, Features { normals, ..prism.features() });
                let base = prism.base();
                let bounds = base.bounds(&field);
                for j in 0..=n {
                    for k in 0..=n - j {
                        let q = base.micro_vertex(&field, j, k);
                        let inside = q.cmpge(bounds.min).all() && q.cmple(bounds.max).all();
                        assert!(inside, "{q} {bounds:?} {base:?}");
                    }
                }
            }
        }
    }

    /// The same where maps are filtered by their levels. From no eye a level changes a height, or a vector's component,
    /// by more than half a pixel, and from some it does change it.
    #[test]
    fn every_filtered_micro_vertex_lies_in_the_bounds_and_near_the_map() {
        let mut numbers = Numbers::new(27);
        let (mut same, mut changed) = (0, 0);
        for round in 0..4_000 {
            let spread = [0.0, 0.1, 0.5][round % 3];
            let n = 1 + (numbers.unit() * 16.0) as u32;
            let prism = Prism::random(&mut numbers, n, spread, 0.3);
            let vectors = round % 4 == 0;
            let prism = if vectors {
                prism.with_vectors(&mut numbers, displacement_kind::TANGENT, spread)
            } else {
                prism
            };
            let prism = prism.filtered(&mut numbers);
            let view = prism.view();
            let field = HeightField::new(&view, prism.features());
            let unfiltered = HeightField { filter: filter::BILINEAR, ..field };
            let base = prism.base();
            let bounds = base.bounds(&field);
            for j in 0..=n {
                for k in 0..=n - j {
                    let q = base.micro_vertex(&field, j, k);
                    let inside = q.cmpge(bounds.min).all() && q.cmple(bounds.max).all();
                    assert!(inside, "{q} {bounds:?} {base:?}");
                    let moved = q.distance(base.micro_vertex(&unfiltered, j, k));
                    let to_eye = q.distance(view.frame.camera.eye);
                    // Micro-vertices are off by some 30 u of coordinates and heights up to 2.
                    let pixel = view.frame.pixel_side() * to_eye;
                    // Of each of three components.
                    let most = if vectors { 0.87 } else { 0.5 };
                    assert!(moved <= most * pixel + 4e-6, "{moved} {pixel} {base:?}");
                    if moved > 0.01 * pixel { changed += 1 } else { same += 1 }
                }
            }
        }
        assert!(same > 40_000 && changed > 40_000, "{same} {changed}");
    }

    /// A vector along the normal alone displaces as its height does, to the bit.
    #[test]
    fn vectors_along_normals_are_heights() {
        let mut numbers = Numbers::new(26);
        for round in 0..2_000 {
            let spread = [0.0, 0.3, 3.0][round % 3];
            let n = 1 + (numbers.unit() * 16.0) as u32;
            let prism = Prism::random(&mut numbers, n, spread, 0.3);
            let mut vectors = Prism::random(&mut numbers, n, spread, 0.3);
            vectors.scene = prism.scene.clone();
            let mut vectors = vectors.with_vectors(&mut numbers, displacement_kind::TANGENT, spread);
            let maps = &mut vectors.scene.displacements;
            (maps[0].scale, maps[1].scale, maps[2]) = (0.0, 0.0, prism.scene.displacements[0]);
            let (view, vector_view) = (prism.view(), vectors.view());
            for normals in [normals::NORMALIZED, normals::LINEAR] {
                let field = HeightField::new(&view, Features { normals, ..prism.features() });
                let vector_field = HeightField::new(&vector_view, Features { normals, ..vectors.features() });
                for j in 0..=n {
                    for k in 0..=n - j {
                        let height = prism.base().micro_vertex(&field, j, k);
                        let vector = vectors.base().micro_vertex(&vector_field, j, k);
                        assert_eq!(height, vector, "{:?}", prism.base());
                    }
                }
            }
        }
    }

    #[test]
    fn interpolated_normals_are_no_shorter_than_the_bound() {
        let mut numbers = Numbers::new(22);
        let mut proven = 0;
        for _ in 0..20_000 {
            let mut scene = random_scene(&mut numbers, 3.0);
            if numbers.unit() < 0.1 {
                scene.vertices[(numbers.unit() * 3.0) as usize].normal = Vec3::ZERO;
            }
            let base = BaseTriangle::load(&scene.view(), 0);
            let shortest = base.shortest_normal();
            proven += u32::from(shortest > 0.0);
            for _ in 0..20 {
                let (b, c) = (numbers.unit(), numbers.unit());
                let (b, c) = if b + c > 1.0 { (1.0 - b, 1.0 - c) } else { (b, c) };
                let n = interpolate(Vec3::new(1.0 - b - c, b, c), base.n0, base.n1, base.n2);
                assert!(n.length() >= shortest, "{n} {shortest} {base:?}");
            }
        }
        assert!(proven > 5_000, "{proven}");
    }

    #[test]
    fn opposite_normals_do_not_displace_where_they_cancel() {
        let mut scene = TestScene::squares(&[0.0]);
        (scene.vertices[0].normal, scene.vertices[1].normal) = (Vec3::Z, -Vec3::Z);
        scene.frame.subdivisions = 2;
        scene.displacements[0].scale = -1.0;
        scene.displacements[0].zero = 1.0;
        let view = scene.view();
        let field = HeightField::new(&view, FLAT);
        let base = BaseTriangle::load(&scene.view(), 0);
        assert_eq!(base.shortest_normal(), 0.0);
        // Halfway along the edge from vertex 0 to vertex 1.
        assert_eq!(base.micro_vertex(&field, 1, 0), Vec3::new(0.0, -1.0, 0.0));
        assert_eq!(base.micro_vertex(&field, 0, 0), Vec3::new(-1.0, -1.0, 1.0));
    }

    #[test]
    fn height_range_holds_every_filtered_height() {
        let mut numbers = Numbers::new(23);
        for _ in 0..20_000 {
            let scene = random_scene(&mut numbers, 0.0);
            let view = scene.view();
            let field = HeightField::new(&view, FLAT);
            let texels = scene.height_texels.iter().map(|&t| f32::from_bits(t));
            let (low, high) = texels.fold((1.0_f32, 0.0_f32), |(a, b), t| (a.min(t), b.max(t)));
            let d = &scene.displacements[0];
            let (min, max) = Displacement::height_range(low, high, d.zero, d.scale);
            for _ in 0..20 {
                let h = field.height(d, Vec2::new(numbers.wide(), numbers.unit()), Pixel::NONE);
                assert!(h >= min && h <= max, "{h} {min} {max}");
            }
        }
    }
}

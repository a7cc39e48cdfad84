//! The stored form of the exact method: one four-wide tree from the scene to blocks of micro-triangles.
//!
//! [`quadtree`](crate::displacement::quadtree) bounds a sub-triangle anew for each ray that comes to it, from a few
//! reads of the height map. Here the same quadtree is stored, once for all rays: below each base triangle hangs a
//! *heap* of [nodes](node) of four children, whose boxes lie in that triangle's own affine [frame], and above the
//! triangles the binary BVH is collapsed into nodes of the same kind. A ray goes through both by one [loop](traverse).
//! Leaves are [blocks](block) of 4 x 4 micro-triangles.
//!
//! Boxes hold the micro-vertices themselves, as [`BaseTriangle::micro_vertex`] computes them, so that one form of node
//! serves heights and vectors, seams and both directions of displacement. What a ray may miss a box by in `f32` is
//! counted in [`frame`]; the triangle test is that of all other methods. Hence the hits are those of the quadtree and
//! of brute force, bit for bit.
//!
//! # Memory
//! A base triangle whose sides have N parts has (P² / 16 - 1) / 3 nodes of 48 bytes, P the next power of two: a byte
//! for each micro-triangle. With [`bounds::ALL`](crate::interface::bounds) the micro-vertices' lifts are stored too, 2
//! bytes more for each micro-triangle (vectors: 6); else a leaf computes micro-vertices from the height map.
//!
//! # Sources
//! Quantised boxes: Ylitie, Karras and Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide
//! BVHs", HPG 2017. Displaced micro-meshes keep triangles in the base triangle's frame too. TFDM
//! (Thonat and others 2021), RMIP (Thonat and others 2023) and Ogaki (2023) bound texels, for any triangle that lies
//! over them, and find the surface in texture space; here each triangle has its own boxes around its micro-triangles.
//!
//! [`BaseTriangle::micro_vertex`]: crate::displacement::surface::BaseTriangle::micro_vertex

pub mod block;
pub mod build;
pub mod corners;
pub mod frame;
pub mod layout;
pub mod node;
pub mod traverse;

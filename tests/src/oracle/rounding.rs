//! How often, and by how much, floating-point operations round.

/// Unit roundoff of f32, written u below.
pub(super) const UNIT_ROUNDOFF: f64 = 1.0 / 16_777_216.0;

/// What the operations of a kind of device may be off by, relative to their results and in u.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rounding {
    /// A quotient.
    pub(super) quotient: f64,
    /// A square root.
    pub(super) root: f64,
    /// The product within `fma`; 0 where it is fused.
    pub(super) product: f64,
}

impl Rounding {
    /// The CPU: all correctly rounded.
    pub(super) const IEEE: Rounding = Rounding { quotient: 1.0, root: 1.0, product: 0.0 };

    /// What Vulkan allows ("Precision and Operation of SPIR-V Instructions"): quotients 2.5 ulp, of which each is up to
    /// 2 u; `Fma` is a product and a sum, roots are 1 / `InverseSqrt`, which has 2 ulp.
    pub(super) const VULKAN: Rounding = Rounding { quotient: 5.0, root: 9.0, product: 1.0 };

    /// Of `w.x a + w.y b + w.z c`, w a point of the grid, relative to the sum of the terms' magnitudes: weight, product
    /// (the first is never fused) and two sums.
    pub(super) fn interpolation(self) -> f64 {
        self.quotient + 3.0
    }

    /// Of the length of a vector, and of dividing by it: three terms' product and sums under the root, half of 3 u;
    /// the root and the quotient.
    pub(super) fn by_length(self) -> f64 {
        2.0 + self.root + self.quotient
    }

    /// Of bilinear interpolation, relative to the greatest texel M. Each of its three interpolations has its
    /// difference (of two texels of either sign, so of 2 M), its product and its result rounded, 3 u or 5 u; they are
    /// two deep. The weights' fractional parts add 1 u M each, the texel's own conversion a quotient.
    pub(super) fn bilinear(self) -> f64 {
        2.0 * (3.0 + 2.0 * self.product) + 2.0 + self.quotient
    }

    /// Of a mean of `count` heights relative to the mean of their magnitudes: all sums but the first, and the quotient.
    pub(super) fn mean(self, count: usize) -> f64 {
        count as f64 - 1.0 + self.quotient
    }

    /// By how much the ray/triangle test moves a vertex across the ray, relative to the greatest coordinate
    /// difference D to the origin.
    ///
    /// In each of two coordinates: the difference to the origin 1 u, twice, since the shear takes one from the other;
    /// the shear, a quotient of two components of the direction that are two quotients each; its product, and the sum,
    /// at most 2 D. An edge function whose products are not fused is off by what moves an end of the edge by 2 u of
    /// a difference of at most 2 D.
    pub(super) fn across(self) -> f64 {
        let coordinate = 4.0 + 5.0 * self.quotient + self.product + 4.0 * self.product;
        2.0_f64.sqrt() * coordinate
    }

    /// Of a distance, relative to the greatest depth, apart from what follows of [`across`](Self::across): difference
    /// and product of the vertices' depths, and their division by a component of the direction (two quotients, and its
    /// reciprocal); the weighted sum 7 u and its quotient; the scale by the direction's length, and that quotient.
    pub(super) fn along(self) -> f64 {
        (2.0 + 3.0 * self.quotient) + (7.0 + self.quotient) + (1.0 + self.quotient)
    }
}

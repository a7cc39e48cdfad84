//! Parallax mapping, plain and with offset limiting.
//!
//! Kaneko, Takahei, Inami, Kawakami, Yanagida, Maeda and Tachi, "Detailed Shape Representation with Parallax
//! Mapping", ICAT 2001: the height over the hit is taken for that of a level plane, and the map is read where the ray
//! meets this. Welsh, "Parallax Mapping with Offset Limiting", Infiscape 2004, leaves out the division by the ray's
//! fall, so that texture coordinates move at most by the height. No parameter.
//!
//! Cost: one reading of the map a ray.
//!
//! Artefacts: right only where the relief is level between the two places; it swims where that is steep, plain
//! parallax the more the flatter the ray, and the limited one flattens there instead. Nothing hides anything, and
//! nothing casts a shadow but the base mesh. The silhouette is the base mesh's.

use super::tangent_space::{TangentRay, TangentSpace};

/// Where the ray is at the height over its hit.
#[inline]
pub fn offset(space: &TangentSpace<'_>, ray: &TangentRay) -> f32 {
    let t = space.height(ray.uv(0.0)) / ray.climb();
    // A ray that keeps its height meets no level plane.
    if t.is_finite() && ray.uv(t).is_finite() { t } else { 0.0 }
}

/// [`offset`] times the sine of the ray's angle with the triangle, `length` being that of its direction.
#[inline]
pub fn limited_offset(space: &TangentSpace<'_>, ray: &TangentRay, length: f32) -> f32 {
    let height = space.height(ray.uv(0.0));
    (if ray.climb() < 0.0 { -height } else { height }) / length
}

#[cfg(test)]
mod tests {
    use crate::interface::method;
    use crate::relief::test_ramp::{SLOPE, assert_on_ray, found, ramp, rays};

    /// By hand: over a hit at x the ramp has the height SLOPE (1 + x); the ray is there that much earlier.
    #[test]
    fn takes_the_ramp_for_level() {
        let scene = ramp(1);
        for ray in rays() {
            let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
            let t = -o.z / d.z;
            let height = SLOPE * (1.0 + o.x + d.x * t);
            for (method, fall) in
                [(method::PARALLAX, d.z), (method::PARALLAX_LIMITED, d.length() * d.z.signum())]
            {
                let hit = found(&scene, method, &ray);
                assert!((f64::from(hit.t) - (t + height / fall)).abs() < 2e-6, "{hit:?} {ray:?}");
                assert_on_ray(&hit, &ray);
            }
        }
    }
}

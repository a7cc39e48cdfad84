//! Bump mapping.
//!
//! Blinn, "Simulation of Wrinkled Surfaces", SIGGRAPH 1978: the surface stays where it is, and light is reflected by
//! the normal that it would have if it were displaced, formulas (2) and (3) as in [`TangentSpace::normal`], of the
//! height field's own derivatives. No parameter.
//!
//! Cost: one reading of the map's gradient a ray.
//!
//! Artefacts: relief hides nothing, moves nothing and casts no shadow; it looks flat from aside. Where it is steep
//! light reaches what should be hidden from it. The silhouette is the base mesh's.
//!
//! [`TangentSpace::normal`]: super::tangent_space::TangentSpace::normal

#[cfg(test)]
mod tests {
    use crate::interface::method;
    use crate::relief::test_ramp::{SLOPE, found, ramp, rays};
    use glam::DVec3;

    /// The square's own hit, with the ramp's normal.
    #[test]
    fn leans_the_normal_alone() {
        let (scene, normal) = (ramp(1), DVec3::new(-SLOPE, 0.0, 1.0).normalize());
        for ray in rays() {
            let (flat, hit) = (found(&scene, method::NONE, &ray), found(&scene, method::BUMP, &ray));
            assert_eq!((hit.t, hit.point, hit.u, hit.v), (flat.t, flat.point, flat.u, flat.v));
            assert!(normal.distance(hit.normal.as_dvec3()) < 1e-6, "{hit:?}");
        }
    }
}

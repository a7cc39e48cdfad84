//! The light that reaches a hit.

use crate::counters::Counts;
use crate::hit::Hit;
use crate::interface::{Frame, PointLight, method, shade};
use crate::math::{at, dot, gamma, max_abs, sqrt, unit};
use crate::ray::TraversalRay;
use crate::relief;
use crate::scene::{Features, SceneView};
use crate::shading::SurfaceInteraction;
use crate::smooth_base::SmoothBase;
use glam::{Vec2, Vec3};

/// What a sample shows: a colour times the light that reaches it, summed up light after light.
///
/// Who traces the sample's rays asks for [one shadow ray after the other](Self::next_shadow_ray) and says what each one
/// met. So the code of a traversal stands in a kernel once, for primary and shadow rays alike: it is nearly all of a
/// kernel.
///
/// The light is Lambert's and ambient, on a two-sided surface: ambient + the sum over lights of I / d² cos. The
/// viewer's side is that of the micro-triangle, and a light on its other side gives nothing, whatever the shading
/// normal; but for [smooth bases](SmoothBase), where the micro-triangle counts as if it stood on the smooth surface,
/// and its light is looked for from there, by two rays: up to the smooth surface, and from there to the light. Where
/// both are free, light and viewer are on one side of whatever the mesh encloses.
///
/// All of it takes registers while shadow rays are traced, so it is little: what a light gives is computed again once
/// its shadow ray has come through.
#[derive(Clone, Copy, Debug)]
pub struct DirectLighting {
    /// Linear RGB of the surface.
    color: Vec3,
    /// What light has reached it so far.
    light: Vec3,
    /// The first light that was not looked at.
    next_light: u32,
    /// What shadow rays leave.
    hit: Hit,
    /// Where they start: beyond the error of the hit point, on the viewer's side.
    origin: Vec3,
    /// Where light arrives: at the hit point, of methods in image space where the relief was found.
    shown: Vec3,
    /// Texture coordinates and height there, which methods in image space take.
    uv: Vec2,
    height: f32,
    /// How much of the light that is looked at comes through the relief; 1 but of methods in image space.
    seen: f32,
    /// Unit geometric normal on that side.
    ng: Vec3,
    /// Unit normal that light is reflected by, turned as `ng` is.
    ns: Vec3,
    /// The base, turned as `ng` is; its lift is zero where it is within the point's error, or behind `ng`.
    base: SmoothBase,
    /// What the shadow ray that was asked for last is.
    way: Way,
}

/// A part of the way from a hit to a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
enum Way {
    /// From the hit to the light.
    Direct,
    /// From the hit along the lift.
    Rising,
    /// From where the lift led to the light.
    Lifted,
}

impl DirectLighting {
    /// A colour that is shown as it is.
    #[inline]
    pub fn unlit(color: Vec3) -> Self {
        DirectLighting {
            color,
            light: Vec3::ONE,
            next_light: u32::MAX,
            hit: Hit::NONE,
            origin: Vec3::ZERO,
            shown: Vec3::ZERO,
            uv: Vec2::ZERO,
            height: 0.0,
            seen: 1.0,
            ng: Vec3::ZERO,
            ns: Vec3::ZERO,
            base: SmoothBase::default(),
            way: Way::Direct,
        }
    }

    /// A surface of that albedo, before any of the lights is looked at. `ray` is the primary one.
    #[inline]
    pub fn new(
        frame: &Frame,
        features: Features,
        albedo: Vec3,
        ray: &TraversalRay,
        hit: Hit,
        surface: &SurfaceInteraction,
    ) -> Self {
        let behind = dot(ray.direction, surface.ng) > 0.0;
        let (ng, ns) = if behind { (-surface.ng, -surface.ns) } else { (surface.ng, surface.ns) };
        let origin = surface.spawn_origin(ng);
        let mut base = surface.base.turned(behind);
        // Negated so that NaN counts.
        if features.smooth != 0 && !(dot(base.lift, ng) > dot(ng.abs(), surface.point_error)) {
            base.lift = Vec3::ZERO;
        }
        DirectLighting {
            color: albedo,
            light: Vec3::splat(frame.ambient),
            next_light: 0,
            hit,
            origin,
            shown: surface.shown_point(features, ray),
            uv: surface.uv,
            height: surface.height,
            seen: 1.0,
            ng,
            ns,
            base,
            way: Way::Direct,
        }
    }

    /// Adds the lights that need no shadow ray, up to the next one that does: the ray towards that, or the first of two
    /// on the way to it, and whether there is one.
    #[inline]
    pub fn next_shadow_ray(
        &mut self,
        scene: &SceneView<'_>,
        features: Features,
        counts: &mut Counts,
    ) -> (TraversalRay, bool) {
        let mut light = Vec3::ZERO;
        let mut found = false;
        let is_lit = features.shade == shade::LIT || features.shade == shade::ERROR;
        // Constants first, so that pipelines which need none of it have no code for it.
        let goes_on = is_lit && features.shadows != 0 && features.smooth != 0 && self.way == Way::Lifted;
        if goes_on {
            light = at(scene.lights, self.next_light - 1).position;
            found = true;
        }
        while is_lit && !found && self.next_light < scene.frame.light_count {
            let source = at(scene.lights, self.next_light);
            light = source.position;
            let cosine = self.cosine(features, light - self.shown);
            if method::searches_relief(features.method) && features.shadows != 0 && cosine > 0.0 {
                let toward = light - self.shown;
                self.seen = relief::light_seen(scene, features, self.hit, self.uv, self.height, toward);
            }
            let lit = cosine * self.seen > 0.0;
            found = features.shadows != 0 && lit;
            if lit && !found {
                self.add(&source, cosine);
            }
            self.next_light += 1;
        }
        counts.shadow_rays += found as u32;
        let ray = if features.smooth == 0 {
            ray_between(self.origin, light, 0.0).leaving(self.hit, self.ng)
        } else {
            self.smooth_shadow_ray(light, goes_on)
        };
        (ray, found)
    }

    /// The ray towards `light`, or along the lift where that comes first; `goes_on`: the lift is behind it.
    #[inline]
    fn smooth_shadow_ray(&mut self, light: Vec3, goes_on: bool) -> TraversalRay {
        // By the share of the way that `cosine` asked for.
        let wi = unit(light - self.shown);
        let share = self.base.raised(wi);
        let raised = self.origin + self.base.lift * share;
        let rises = share > 0.0 && !goes_on;
        let start = if goes_on { raised } else { self.origin };
        let end = if rises { raised } else { light };
        self.way = if rises {
            Way::Rising
        } else if goes_on {
            Way::Lifted
        } else {
            Way::Direct
        };
        // The second ray starts where the first one ends. Rounding may end that before: by what a coordinate of the
        // start, of the way and of their sum is rounded by, and as much of the way for its direction and length.
        let slack = if rises { gamma(8) * (max_abs(raised) + max_abs(self.origin)) } else { 0.0 };
        let ray = ray_between(start, end, slack);
        // Light from behind the micro-triangle has to pass it. A ray from the lifted point leaves no plane: what passes
        // that point within rounding may be where the first ray ended.
        let leaves = rises || !goes_on && dot(wi, self.ng) > 0.0;
        if leaves { ray.leaving(self.hit, self.ng) } else { ray }
    }

    /// Takes what the last shadow ray met.
    #[inline]
    pub fn add_unless_occluded(&mut self, scene: &SceneView<'_>, features: Features, met: Hit) {
        let rose = features.smooth != 0 && self.way == Way::Rising;
        if !met.is_some() && !rose {
            let source = at(scene.lights, self.next_light - 1);
            let cosine = self.cosine(features, source.position - self.shown);
            self.add(&source, cosine);
        }
        self.way = if rose && !met.is_some() { Way::Lifted } else { Way::Direct };
    }

    /// Adds a light that reaches the surface.
    #[inline]
    fn add(&mut self, source: &PointLight, cosine: f32) {
        let toward = source.position - self.shown;
        self.light += source.color * (source.intensity * (cosine * self.seen) / toward.dot(toward));
    }

    /// The cosine by which light from the direction `toward`, of any length, is reflected: not above 0 from behind.
    #[inline]
    fn cosine(&self, features: Features, toward: Vec3) -> f32 {
        let wi = toward / sqrt(toward.dot(toward));
        let geometric = wi.dot(self.ng);
        let shading = wi.dot(self.ns);
        if features.smooth != 0 {
            self.smooth_cosine(features, wi, geometric, shading)
        } else if method::is_image_space(features.method) {
            // What is behind the base triangle gives it no light either.
            if geometric > 0.0 { shading } else { 0.0 }
        } else {
            geometric
        }
    }

    /// The same where shading is smooth: `wi` is a unit vector, `geometric` and `shading` are its cosines at `ng` and
    /// `ns`.
    ///
    /// Light is in front where it is for the micro-triangle as it would stand on the smooth base, and also for the
    /// micro-triangle itself, unless the base has a lift for it.
    #[inline]
    fn smooth_cosine(&self, features: Features, wi: Vec3, geometric: f32, shading: f32) -> f32 {
        let smoothed = self.base.smoothed(self.ng);
        let on_smooth = wi.dot(smoothed);
        let is_less = geometric < on_smooth && !(self.base.raised(wi) > 0.0);
        let front = if is_less { geometric } else { on_smooth };
        if !(front > 0.0) {
            0.0
        } else if method::is_image_space(features.method) {
            shading
        } else {
            softened_cosine(front, shading, smoothed.dot(self.ns))
        }
    }

    /// Linear RGB of the sample, once there is no further shadow ray.
    #[inline]
    pub fn radiance(&self) -> Vec3 {
        self.color * self.light
    }
}

/// The ray from `start` to `end`, and `slack` farther.
#[inline]
fn ray_between(start: Vec3, end: Vec3, slack: f32) -> TraversalRay {
    let toward = end - start;
    let distance = toward.length();
    TraversalRay::new(start, toward / distance, distance + slack)
}

/// Lambert's cosine at the shading normal, brought down to 0 towards where light begins to come from behind the flat
/// micro-triangle: without that, a micro-triangle would be lit up to there and black beyond, and show its outline.
///
/// The factor is that of Chiang, Li and Burley, "Taming the Shadow Terminator", SIGGRAPH 2019 Talks: with
/// G = min(1, (ng·wi) / ((ns·wi) (ng·ns))) it is G + G² - G³, which has the slope 0 where it meets 1. The paper takes
/// ng·ns above 0; where it is not, the product is not above `geometric` either, and G is 1.
///
/// `geometric` is ng·wi, above 0; `shading` is ns·wi, `between` is ng·ns; ng is that of the micro-triangle as it would
/// stand on the smooth base. The result is at most `shading`, and not
/// above 0 where that is not.
#[inline]
fn softened_cosine(geometric: f32, shading: f32, between: f32) -> f32 {
    let whole = shading * between;
    let g = if geometric < whole { geometric / whole } else { 1.0 };
    shading * (g * (1.0 + g * (1.0 - g)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The paper's factor by hand: it has slope 1 at 0, slope 0 where it meets 1, and G = 1 wherever the facet sees the
    /// light at least as steeply as the shading normal does.
    #[test]
    fn softened_cosine_leads_from_lambert_to_nothing() {
        assert_eq!(softened_cosine(0.5, 0.5, 1.0), 0.5);
        assert_eq!(softened_cosine(0.9, 0.5, 1.0), 0.5);
        // G = 1/2: 1/2 + 1/4 - 1/8.
        assert_eq!(softened_cosine(0.25, 0.5, 1.0), 0.5 * 0.625);
        assert_eq!(softened_cosine(0.0625, 0.5, 0.25), 0.5 * 0.625);
        let low = 1e-3;
        assert!((softened_cosine(low, 1.0, 1.0) - low).abs() < 2.0 * low * low);
        assert!(softened_cosine(1.0 - low, 1.0, 1.0) > 1.0 - 3.0 * low * low);
        // More than a right angle between the normals; a light behind the shading normal.
        assert_eq!(softened_cosine(0.1, 0.5, -0.2), 0.5);
        assert!(softened_cosine(0.1, -0.5, 0.9) <= 0.0);
    }

    /// Light from behind a facet that is lifted is the smooth surface's; behind a base that is hollow there is none.
    #[test]
    fn light_from_behind_a_facet_needs_a_lift() {
        let features = Features { smooth: 1, ..crate::test_scene::FLAT };
        let (wi, ns) = (Vec3::new(0.96, 0.0, -0.28), Vec3::new(0.6, 0.0, 0.8));
        let cosine = |lift| {
            let base = SmoothBase { ng: Vec3::Z, ns, lift };
            DirectLighting { ng: Vec3::Z, ns, base, ..DirectLighting::unlit(Vec3::ONE) }.cosine(features, wi)
        };
        assert_eq!(cosine(Vec3::ZERO), 0.0, "behind a hollow base");
        // Lambert's cosine at the smooth normal: 0.96 0.6 - 0.28 0.8.
        assert!((cosine(Vec3::Z) - 0.352).abs() < 1e-6);
    }
}

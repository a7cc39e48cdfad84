//! What a user changes while looking.

use super::Loaded;
use crate::framing::View;
use crate::render::Scene;
use crate::scene::Relief;
use crate::settings::{DisplacementKind, Filter, Light, Method, Settings, Shade, Subdivisions, Wrap};
use clap::ValueEnum;
use emboss_kernels::interface::{MAX_SUBDIVISIONS, method};
use glam::DVec3;

/// What differs from the scene as it was loaded; `None` where nothing does.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tuning {
    /// The camera.
    pub pose: Option<Pose>,
    /// What all scales are multiplied by, in place of what `--exaggerate` says.
    pub exaggeration: Option<f32>,
    /// The texel value of no displacement of all height maps.
    pub zero: Option<f32>,
    /// N.
    pub subdivisions: Option<Subdivisions>,
    /// How displaced triangles are intersected.
    pub method: Option<Method>,
    /// What pixels show.
    pub shade: Option<Shade>,
    /// Whether the surface is lit by its own normals.
    pub smooth: Option<bool>,
    /// Whether lights cast shadows.
    pub shadows: Option<bool>,
    /// How all maps are read outside [0,1).
    pub wrap: Option<Wrap>,
    /// What stands for the first light.
    pub light: Option<Light>,
}

/// Where a camera is and what it looks at: all that `--eye`, `--target`, `--up` and `--fov` say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The pinhole, in world units.
    pub eye: DVec3,
    /// The middle of the picture, in world units.
    pub target: DVec3,
    /// What is up in the picture.
    pub up: DVec3,
    /// Angle between the picture's upper and lower edge, in degrees.
    pub fov: f32,
}

/// How much a step of the scale multiplies it by: seven double it.
const SCALE_STEP: f32 = 1.1;
/// The most that scales grow to, as a multiple of what they were loaded with. Reaches beyond 1e12 are not loaded, so
/// that heights stay within a float's range.
const MOST_SCALE: f32 = 1e6;
/// Least and greatest side of micro-triangles in pixels: see [`Subdivisions::Auto`].
const LEAST_PIXELS: f32 = 0.1;
const MOST_PIXELS: f32 = 64.0;
/// N where it no longer follows the camera, and was never another.
const USUAL_SUBDIVISIONS: u32 = 16;

impl Tuning {
    /// The settings with this tuning, for a film of `size`.
    pub fn settings(&self, base: &Settings, size: (u32, u32)) -> Settings {
        let view = match self.pose {
            None => base.view,
            Some(Pose { eye, target, up, fov }) => {
                View { eye: Some(eye), target: Some(target), up: Some(up), fov, ..base.view }
            }
        };
        let mut lights = base.lights.clone();
        if let Some(light) = self.light {
            lights.truncate(lights.len().max(1));
            match lights.first_mut() {
                Some(first) => *first = light,
                None => lights.push(light),
            }
        }
        Settings {
            width: size.0,
            height: size.1,
            method: self.method.unwrap_or(base.method),
            shade: self.shade.unwrap_or(base.shade),
            smooth: self.smooth.unwrap_or(base.smooth),
            shadows: self.shadows.unwrap_or(base.shadows),
            wrap: self.wrap.unwrap_or(base.wrap),
            adaptive: self.subdivisions.map_or(base.adaptive, Subdivisions::pixels),
            view,
            lights,
            ..base.clone()
        }
    }

    /// The scene with this tuning.
    pub fn scene(&self, loaded: &Loaded) -> Scene {
        let mut scene = Scene { reliefs: self.reliefs(loaded), ..loaded.scene.clone() };
        if let Some(wrap) = self.wrap {
            scene.reliefs.iter_mut().for_each(|relief| relief.wrap = Some(wrap));
            scene.materials.iter_mut().for_each(|material| material.wrap = Some(wrap));
        }
        scene.subdivisions = self.subdivisions.map_or(scene.subdivisions, Subdivisions::most);
        scene
    }

    /// The reliefs with this tuning's heights. Where no material has a map there is nothing to tune: what stands for it
    /// is a texel of its own zero.
    pub fn reliefs(&self, loaded: &Loaded) -> Vec<Relief> {
        let reliefs = &loaded.scene.reliefs;
        if !loaded.is_displaced {
            return reliefs.clone();
        }
        let exaggeration = self.exaggeration.unwrap_or(loaded.exaggeration);
        let tuned = |relief: &Relief| Relief {
            scale: relief.scale * exaggeration,
            zero: self.zero.unwrap_or(relief.zero),
            ..relief.clone()
        };
        reliefs.iter().map(tuned).collect()
    }

    /// Whether the scene has to be packed and built anew for another tuning; else it is enough to change what is
    /// loaded.
    pub fn needs_other_scene(&self, other: &Tuning, base: &Settings) -> bool {
        // Height maps have their levels only where something is displaced.
        let levels = base.filter == Filter::Trilinear && self.is_flat(base) != other.is_flat(base);
        // Boxes are those of what rays meet: displaced or not.
        let boxes_of =
            |tuning: &Tuning| method::boxes(tuning.method_of(base).id(), tuning.shade_of(base).id());
        let boxes = boxes_of(self) != boxes_of(other);
        // Those that store something are loaded with it.
        let (method, others) = (self.method_of(base), other.method_of(base));
        let stored = method != others && (method.has_own_store() || others.has_own_store());
        levels || boxes || stored || (self.subdivisions, self.wrap) != (other.subdivisions, other.wrap)
    }

    /// Whether heights differ, or whether there are any.
    pub fn needs_other_heights(&self, other: &Tuning, base: &Settings) -> bool {
        (self.exaggeration, self.zero, self.is_flat(base))
            != (other.exaggeration, other.zero, other.is_flat(base))
    }

    /// Whether nothing is displaced.
    fn is_flat(&self, base: &Settings) -> bool {
        self.method_of(base) == Method::None && self.shade_of(base) != Shade::Error
    }

    fn shade_of(&self, base: &Settings) -> Shade {
        self.shade.unwrap_or(base.shade)
    }

    fn method_of(&self, base: &Settings) -> Method {
        self.method.unwrap_or(base.method)
    }

    /// Takes back what cannot be had: what of it is still as it was `refused` is again as it is `kept`. Camera and
    /// light stay.
    pub(super) fn take_back(&mut self, refused: &Tuning, kept: &Tuning) {
        fn one<T: Copy + PartialEq>(value: &mut T, refused: T, kept: T) {
            if *value == refused {
                *value = kept;
            }
        }
        one(&mut self.exaggeration, refused.exaggeration, kept.exaggeration);
        one(&mut self.zero, refused.zero, kept.zero);
        one(&mut self.subdivisions, refused.subdivisions, kept.subdivisions);
        one(&mut self.method, refused.method, kept.method);
        one(&mut self.wrap, refused.wrap, kept.wrap);
        one(&mut self.shade, refused.shade, kept.shade);
        one(&mut self.smooth, refused.smooth, kept.smooth);
        one(&mut self.shadows, refused.shadows, kept.shadows);
    }

    /// The same with another one's colours, which are not why its scene is refused. Errors are: they are loaded with
    /// the boxes of what they are shown against.
    pub(super) fn with_colors_of(&self, other: &Tuning) -> Tuning {
        let shade = if other.shade == Some(Shade::Error) { self.shade } else { other.shade };
        Tuning { shade, smooth: other.smooth, shadows: other.shadows, ..self.clone() }
    }

    /// Multiplies the scales by some steps; they are multiplied by `loaded` at first, and by `MOST_SCALE` times that
    /// at most.
    pub fn step_scale(&mut self, steps: i32, loaded: f32) {
        let most = (MOST_SCALE * loaded).abs();
        let factor = self.exaggeration.unwrap_or(loaded) * SCALE_STEP.powi(steps);
        let factor = factor.max(-most).min(most);
        // Up and down again is where it was, though floats round.
        let is_loaded = (factor - loaded).abs() < 1e-4 * loaded.abs();
        self.exaggeration = (!is_loaded && factor.is_finite()).then_some(factor);
    }

    /// Doubles or halves N, which is `loaded` at first; where that follows the camera, micro-triangles halve or double.
    pub fn step_subdivisions(&mut self, steps: i32, loaded: Subdivisions) {
        self.subdivisions = Some(match self.subdivisions.unwrap_or(loaded) {
            Subdivisions::Fixed(n) => {
                let n = if steps > 0 { n.saturating_mul(2) } else { n / 2 };
                Subdivisions::Fixed(n.clamp(1, MAX_SUBDIVISIONS))
            }
            Subdivisions::Auto { pixels } => {
                let pixels = if steps > 0 { 0.5 * pixels } else { 2.0 * pixels };
                Subdivisions::Auto { pixels: pixels.clamp(LEAST_PIXELS, MOST_PIXELS) }
            }
        });
    }

    /// Has N follow the camera, or no longer: then it is what it was `loaded` with.
    pub fn toggle_auto(&mut self, settings: &Settings, loaded: Subdivisions) {
        let subdivisions = match (self.subdivisions.unwrap_or(loaded), loaded) {
            (Subdivisions::Fixed(_), _) => Subdivisions::Auto { pixels: 1.0 },
            (Subdivisions::Auto { .. }, Subdivisions::Fixed(n)) => Subdivisions::Fixed(n),
            (Subdivisions::Auto { .. }, Subdivisions::Auto { .. }) => Subdivisions::Fixed(USUAL_SUBDIVISIONS),
        };
        self.subdivisions = Some(subdivisions);
        // Most methods take one N for all triangles.
        if subdivisions.pixels().is_some() && !self.method_of(settings).takes_any_scene() {
            self.method = Some(Method::Quadtree);
        }
    }

    /// The next method that takes the scene's maps, and N as it is. It follows the one that was `refused`, where one
    /// was: what else a scene is refused for shows only when it is loaded.
    pub fn next_method(&mut self, settings: &Settings, refused: Option<Method>) {
        let auto = self.subdivisions.map_or(settings.adaptive, Subdivisions::pixels).is_some();
        let vectors = settings.displacement != DisplacementKind::Height;
        let is_refused = |method: Method| {
            auto && !method.takes_any_scene()
                || vectors && !method.takes_vectors()
                || method.is_stored() && settings.filter == Filter::Trilinear
        };
        let mut method = next(refused.unwrap_or_else(|| self.method_of(settings)));
        while is_refused(method) {
            method = next(method);
        }
        self.method = Some(method);
    }

    /// The next way to shade.
    pub fn next_shade(&mut self, settings: &Settings) {
        self.shade = Some(next(self.shade.unwrap_or(settings.shade)));
    }

    /// The next way to wrap maps.
    pub fn next_wrap(&mut self, settings: &Settings) {
        self.wrap = Some(next(self.wrap.unwrap_or(settings.wrap)));
    }
}

/// The value after this one, in the order in which they are declared; after the last the first.
fn next<T: ValueEnum + PartialEq>(value: T) -> T {
    let all = T::value_variants();
    let place = all.iter().position(|other| *other == value).unwrap_or(0);
    all[(place + 1) % all.len()].clone()
}

/// What the command line calls a value.
pub(super) fn name_of(value: &impl ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{HeightMap, Mesh};

    /// A scene of one map of a texel.
    fn loaded(is_displaced: bool) -> Loaded {
        let reliefs = vec![Relief::new(HeightMap::flat(0.5), 0.5, -0.25)];
        let (mesh, settings) = (Mesh::default(), Settings::default());
        let scene = Scene { mesh, reliefs, materials: vec![], parts: vec![], subdivisions: 1 };
        Loaded {
            scene,
            settings,
            is_displaced,
            exaggeration: 0.1,
            scale: None,
            has_own_subdivisions: false,
            files: vec![],
        }
    }

    #[test]
    fn scale_goes_up_and_down_to_where_it_was() {
        let mut tuning = Tuning::default();
        for steps in [1, 1, 1, -1, -1] {
            tuning.step_scale(steps, 0.1);
        }
        assert!((tuning.exaggeration.expect("a step is left") - 0.11).abs() < 1e-6);
        tuning.step_scale(-1, 0.1);
        assert_eq!(tuning, Tuning::default());
    }

    /// However long the key is held: heights of the largest scale that is loaded are numbers still.
    #[test]
    fn scale_ends_before_heights_overflow() {
        for loaded in [0.1, -3e7] {
            let (mut tuning, largest) = (Tuning::default(), 1e12 / loaded);
            for _ in 0..2000 {
                tuning.step_scale(1, loaded);
            }
            assert_eq!(tuning.exaggeration, Some(MOST_SCALE * loaded));
            assert!((tuning.exaggeration.unwrap_or(loaded) * largest).is_finite());
        }
    }

    /// The one product that `emboss render` computes: the scale of the material times --exaggerate.
    #[test]
    fn exaggeration_is_that_of_the_command_line() {
        assert_eq!(Tuning::default().reliefs(&loaded(true))[0].scale, -0.25 * 0.1);
        let tuning = Tuning { exaggeration: Some(0.3), ..Tuning::default() };
        assert_eq!(tuning.reliefs(&loaded(true))[0].scale, -0.25 * 0.3);
    }

    /// Another zero of a height map moves the surface, be it of one texel; where there is no map there is nothing to
    /// move.
    #[test]
    fn what_has_no_map_stays_flat() {
        let tuning = Tuning { zero: Some(0.0), exaggeration: Some(2.0), ..Tuning::default() };
        let tuned = |is_displaced| {
            let reliefs = tuning.reliefs(&loaded(is_displaced));
            (reliefs[0].zero, reliefs[0].scale)
        };
        assert_eq!((tuned(false), tuned(true)), ((0.5, -0.25), (0.0, -0.5)));
    }

    /// What the user has changed since stays, and so does what concerns no scene.
    #[test]
    fn only_what_was_refused_is_taken_back() {
        let n = |n| Some(Subdivisions::Fixed(n));
        let kept = Tuning { subdivisions: n(8), wrap: Some(Wrap::Clamp), ..Tuning::default() };
        let refused = Tuning { subdivisions: n(4096), zero: Some(0.25), ..kept.clone() };
        let mut now = Tuning { zero: Some(0.5), smooth: Some(true), ..refused.clone() };
        now.take_back(&refused, &kept);
        assert_eq!(now, Tuning { zero: Some(0.5), smooth: Some(true), ..kept.clone() });
        // Errors need boxes of their own, colours do not.
        for (shade, left) in [(Shade::Error, None), (Shade::Uv, Some(Shade::Uv))] {
            let refused = Tuning { shade: Some(shade), ..kept.clone() };
            let mut now = refused.clone();
            now.take_back(&refused, &kept.with_colors_of(&refused));
            assert_eq!(now.shade, left);
        }
    }

    #[test]
    fn steps_end_at_the_limits() {
        let mut tuning = Tuning::default();
        let one = Subdivisions::Fixed(1);
        tuning.step_subdivisions(-1, one);
        assert_eq!(tuning.subdivisions, Some(one));
        tuning.subdivisions = Some(Subdivisions::Fixed(3000));
        tuning.step_subdivisions(1, one);
        assert_eq!(tuning.subdivisions, Some(Subdivisions::Fixed(MAX_SUBDIVISIONS)));
        tuning.subdivisions = Some(Subdivisions::Auto { pixels: 0.15 });
        tuning.step_subdivisions(1, one);
        assert_eq!(tuning.subdivisions, Some(Subdivisions::Auto { pixels: LEAST_PIXELS }));
    }

    /// There and back; the grid walk, which takes no such N, makes way.
    #[test]
    fn n_follows_the_camera_and_no_longer() {
        let settings = Settings { method: Method::GridWalk, ..Settings::default() };
        let (mut tuning, loaded) = (Tuning::default(), Subdivisions::Fixed(5));
        tuning.toggle_auto(&settings, loaded);
        assert_eq!(tuning.subdivisions, Some(Subdivisions::Auto { pixels: 1.0 }));
        assert_eq!(
            (tuning.settings(&settings, (1, 1)).adaptive, tuning.method),
            (Some(1.0), Some(Method::Quadtree))
        );
        let mut methods = vec![];
        for _ in 0..3 {
            tuning.next_method(&settings, None);
            methods.extend(tuning.method);
        }
        assert!(!methods.contains(&Method::GridWalk), "{methods:?}");
        tuning.toggle_auto(&settings, loaded);
        assert_eq!(tuning.subdivisions, Some(loaded));
    }

    #[test]
    fn methods_come_round_and_leave_out_the_walk_of_vectors() {
        let round = |displacement| {
            let (settings, mut tuning) =
                (Settings { displacement, ..Settings::default() }, Tuning::default());
            let mut methods = vec![];
            while tuning.method != Some(Method::Quadtree) {
                tuning.next_method(&settings, None);
                methods.extend(tuning.method);
            }
            methods
        };
        assert_eq!(round(DisplacementKind::Height).len(), Method::value_variants().len());
        let of_vectors = round(DisplacementKind::Tangent);
        assert_eq!(of_vectors, [Method::Tessellate, Method::BruteForce, Method::None, Method::Quadtree]);
    }

    /// What cannot be loaded is no dead end for the key: it goes on from there, once.
    #[test]
    fn next_method_follows_the_refused_one() {
        let settings = Settings { method: Method::GridWalk, ..Settings::default() };
        let mut tuning = Tuning::default();
        tuning.next_method(&settings, Some(Method::Tessellate));
        assert_eq!(tuning.method, Some(Method::BruteForce));
    }

    #[test]
    fn tuned_light_stands_for_the_first() {
        let light =
            |x: f32| Light { position: DVec3::X * f64::from(x), color: glam::Vec3::ONE, intensity: Some(x) };
        let tuning = Tuning { light: Some(light(5.0)), ..Tuning::default() };
        let lights = |lights| tuning.settings(&Settings { lights, ..Settings::default() }, (1, 1)).lights;
        assert_eq!(lights(vec![]), [light(5.0)]);
        assert_eq!(lights(vec![light(1.0), light(2.0)]), [light(5.0), light(2.0)]);
    }
}

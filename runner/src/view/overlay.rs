//! The panel over the picture: what is seen, how fast, and which key changes what.

use super::canvas::{Canvas, Font};
use super::state::{SceneInfo, State};
use super::tuning::{Pose, name_of};
use crate::framing::key_light;
use glam::DVec3;

/// What is said of the rendering.
#[derive(Clone, Debug, Default)]
pub(super) struct Status {
    /// Samples of a pixel that are seen; 0 of a picture with fewer pixels.
    pub(super) samples: u32,
    /// What a pass over all pixels takes.
    pub(super) frame_ms: f64,
    /// Primary rays in a second.
    pub(super) rays_per_second: f64,
    /// The device.
    pub(super) device: String,
}

const TEXT: [u8; 3] = [236, 236, 236];
const KEYS: [u8; 3] = [255, 200, 96];
/// Width of the columns of keys and of names, in letters.
const COLUMNS: (usize, usize) = (12, 10);

/// A line of the panel: keys, name and value.
type Line = (&'static str, &'static str, String);

/// One line for the window's title: what stands in the panel's first lines.
pub(super) fn title(name: &str, state: &State, status: &Status) -> String {
    let scene = state.scene.as_ref();
    let method = scene.map_or_else(String::new, |scene| {
        let method = state.tuning.method.unwrap_or(scene.settings.method);
        let n = state.tuning.subdivisions.unwrap_or(scene.subdivisions);
        format!(" - {}, N {n}", name_of(&method))
    });
    format!("{name}{method} - {} - {}", speed(status), status.device)
}

fn speed(status: &Status) -> String {
    format!(
        "{} samples, {:.1} ms/frame, {:.1} M rays/s",
        status.samples,
        status.frame_ms,
        status.rays_per_second * 1e-6
    )
}

/// Draws the panel.
pub(super) fn draw(canvas: &mut Canvas, font: Font, state: &State, status: &Status) {
    let lines = lines(state, status);
    let (letter, row, margin) = (font.width(), font.height() + 2, font.height() / 2);
    let width_of = |(keys, name, value): &Line| {
        let value = value.chars().count();
        if keys.is_empty() && name.is_empty() { value } else { COLUMNS.0 + COLUMNS.1 + value }
    };
    let width = lines.iter().map(width_of).max().unwrap_or(0);
    canvas.shade(margin / 2, margin / 2, width * letter + margin, lines.len() * row + margin);
    for (i, (keys, name, value)) in lines.iter().enumerate() {
        let top = margin + i * row;
        if keys.is_empty() && name.is_empty() {
            canvas.text(margin, top, font, value, TEXT);
            continue;
        }
        canvas.text(margin, top, font, keys, KEYS);
        canvas.text(margin + COLUMNS.0 * letter, top, font, name, TEXT);
        canvas.text(margin + (COLUMNS.0 + COLUMNS.1) * letter, top, font, value, TEXT);
    }
}

fn lines(state: &State, status: &Status) -> Vec<Line> {
    let mut lines = vec![("", "", status.device.clone()), ("", "", speed(status))];
    if let Some(scene) = &state.scene {
        lines.extend(settings(state, scene));
    }
    lines.extend([
        ("W A S D", "fly", format!("Q E down, up  Shift fast  speed {:.2}", state.speed())),
        ("drag", "orbit", "or arrows; click and Esc: mouse look".to_owned()),
        ("R", "reset", "the camera; Backspace: all else, as loaded".to_owned()),
        ("P", "picture", "C command  Tab panel  Esc quit".to_owned()),
    ]);
    if !state.message.is_empty() {
        lines.extend(state.message.lines().map(|line| ("", "", line.chars().take(100).collect())));
    }
    lines
}

/// The settings with their keys.
fn settings(state: &State, scene: &SceneInfo) -> Vec<Line> {
    let (tuning, base) = (&state.tuning, &scene.settings);
    let settings = tuning.settings(base, (1, 1));
    let factor = tuning.exaggeration.unwrap_or(scene.exaggeration);
    let scale = match scene.scale {
        Some(scale) => format!("{} (x{factor:.2})", scale * factor),
        None => format!("x{factor:.2}"),
    };
    let zero =
        tuning.zero.or(scene.zeros.loaded).map_or_else(|| "several".to_owned(), |zero| zero.to_string());
    let n = tuning.subdivisions.unwrap_or(scene.subdivisions);
    let switch = |is_on| if is_on { "on" } else { "off" }.to_owned();
    let fov = tuning.pose.map_or(base.view.fov, |Pose { fov, .. }| fov);
    vec![
        ("- =", "scale", scale),
        ("[ ]", "zero", zero),
        ("N PgDn PgUp", "N", format!("{n}, {} triangles", scene.triangles)),
        ("M", "method", name_of(&settings.method)),
        ("V", "shading", name_of(&settings.shade)),
        ("H", "shadows", switch(settings.shadows)),
        ("O", "smooth", switch(settings.smooth)),
        ("X", "wrap", tuning.wrap.map_or_else(|| "as loaded".to_owned(), |wrap| name_of(&wrap))),
        (", . L K", "light", light(state)),
        ("wheel", "view", format!("{fov:.1} degrees")),
    ]
}

fn light(state: &State) -> String {
    let lights = state.lights();
    let place = |DVec3 { x, y, z }: DVec3| format!("{x:.2},{y:.2},{z:.2}");
    match (&lights[..], state.framing) {
        ([], Some(framing)) => {
            format!("{} (camera's)", place(framing.space.world(key_light(&framing).position.as_dvec3())))
        }
        ([], None) => String::new(),
        ([only], _) => place(only.position),
        ([first, ..], _) => format!("{} and {} more", place(first.position), lights.len() - 1),
    }
}

#[cfg(test)]
mod tests {
    use super::super::zeros::Zeros;
    use super::*;
    use crate::settings::{Method, Settings, Subdivisions};

    fn state() -> State {
        let settings = Settings { method: Method::GridWalk, ..Settings::default() };
        let subdivisions = Subdivisions::Fixed(8);
        let zeros = Zeros::of(&[]);
        let scene =
            SceneInfo { settings, triangles: 3, subdivisions, exaggeration: 2.0, scale: Some(0.25), zeros };
        let mut state = State::new();
        state.scene = Some(scene);
        state.tuning.step_scale(1, 2.0);
        state
    }

    #[test]
    fn every_setting_is_shown_with_its_key() {
        let lines = lines(&state(), &Status { device: "Card".to_owned(), ..Status::default() });
        let value = |name| {
            let found = lines.iter().find(|line| line.1 == name).expect(name);
            assert!(!found.0.is_empty(), "{name} has a key");
            found.2.as_str()
        };
        assert_eq!(value("scale"), "0.55 (x2.20)");
        assert_eq!(value("zero"), "several");
        assert_eq!((value("N"), value("method")), ("8, 3 triangles", "grid-walk"));
        for name in
            ["shading", "shadows", "smooth", "wrap", "light", "view", "fly", "orbit", "reset", "picture"]
        {
            value(name);
        }
        assert_eq!(lines[0].2, "Card");
    }

    #[test]
    fn title_has_what_the_panel_has() {
        let status =
            Status { samples: 5, frame_ms: 12.34, rays_per_second: 5.6e6, device: "Card".to_owned() };
        let title = title("knot", &state(), &status);
        assert_eq!(title, "knot - grid-walk, N 8 - 5 samples, 12.3 ms/frame, 5.6 M rays/s - Card");
    }

    /// Whatever a pixel's size, the panel keeps its own on the screen.
    #[test]
    fn panel_is_twice_as_large_where_pixels_are_dense() {
        let of_scale = |scale| {
            let (width, height) = (2000, 1200);
            let mut canvas = Canvas { width, height, texels: vec![0xFF_FFFF; (width * height) as usize] };
            draw(&mut canvas, Font::for_scale(scale), &state(), &Status::default());
            let is_drawn = |row: &&[u32]| row.iter().any(|texel| *texel != 0xFF_FFFF);
            canvas.texels.chunks(width as usize).filter(is_drawn).count()
        };
        let (usual, dense) = (of_scale(1.0), of_scale(2.0));
        assert!(dense > usual * 9 / 5 && dense <= usual * 2, "{usual} {dense}");
    }

    #[test]
    fn panel_is_drawn_on_any_canvas() {
        for (width, height) in [(1, 1), (400, 300)] {
            let mut canvas = Canvas { width, height, texels: vec![0xFF_FFFF; (width * height) as usize] };
            draw(&mut canvas, Font::for_scale(1.0), &state(), &Status::default());
        }
    }
}

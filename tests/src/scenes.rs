//! The built-in scenes as jobs.

use emboss::framing::View;
use emboss::render::{Job, Scene, prepare};
use emboss::scene::builtin;
use emboss::settings::{Light, Settings};
use emboss_kernels::interface::PointLight;

/// Built-in scene `name` with N = `subdivisions`, and the settings that show it as the command line does, `width` by
/// `height` pixels large.
///
/// # Panics
/// Where there is none of that name.
pub fn builtin_scene(name: &str, subdivisions: u32, width: u32, height: u32) -> (Scene, Settings) {
    let Some(builtin) = builtin::load(name) else { panic!("no scene {name}") };
    let scene = Scene {
        mesh: builtin.mesh,
        height_map: builtin.height,
        color_map: builtin.color,
        zero: builtin.zero,
        scale: builtin.scale,
        subdivisions,
    };
    let view = View { from: builtin.view, usual_up: builtin.up, ..View::default() };
    let lights = builtin.lights.into_iter().map(light).collect();
    (scene, Settings { width, height, view, lights, ..Settings::default() })
}

/// A scene as a job.
///
/// # Panics
/// Where it cannot be framed: those of tests can.
pub fn job(scene: Scene, settings: &Settings) -> Job {
    prepare(scene, settings).unwrap_or_else(|error| panic!("{error}"))
}

fn light(light: PointLight) -> Light {
    Light { position: light.position, color: light.color, intensity: Some(light.intensity) }
}

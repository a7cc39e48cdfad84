//! The viewer in a window of a display of its own (Xvfb, and in `screens` sway): what it shows, what it hears, and how
//! it ends. Those tests that run on lavapipe are in modules called `vulkan`.
#![cfg(target_os = "linux")]

mod harness;
mod screens;
mod sway;
mod timing;
mod x11;

use harness::{Display, Viewer, command_in, emboss, shows};
use image::RgbaImage;
use std::path::Path;

/// A quick scene that fills its background, so that a picture is what a screen shows.
const QUICK: [&str; 8] = ["builtin:cube", "-", "-", "-", "-", "4", "--seed=1", "--background=0.25,0.5,1"];

/// Has software show pictures as hardware does.
const BY_SWAPCHAIN: &str = "--by-swapchain";

/// What the command line in a PNG renders, and the PNG.
fn rendered_again(folder: &Path, name: &str) -> (RgbaImage, RgbaImage) {
    let path = folder.join(name);
    let command = command_in(&path);
    let saved = image::open(&path).expect("a PNG").to_rgba8();
    assert!(command.contains(&format!("--output {name} ")), "{command}");
    // No word of it is quoted.
    let words: Vec<_> = command.split(' ').collect();
    assert_eq!(words[..2], ["emboss", "render"]);
    let output = emboss(folder).args(&words[1..]).output().expect("the program starts");
    assert!(output.status.success(), "{command}: {output:?}");
    let output = words.iter().position(|word| *word == "--output").expect("it is named");
    (image::open(folder.join(words[output + 1])).expect("a PNG").to_rgba8(), saved)
}

/// Moves the camera, changes settings, saves; what is saved, what the command line renders and what the screen shows
/// are one picture, to the bit: same kernels, same camera, same samples.
fn assert_screen_is_what_render_renders(backend: &[&str]) {
    let Some(display) = Display::start() else { return };
    let script = "samples 1\nkey tab\nhold right\nhold w\nframes 3\nrelease right\nrelease w\n\
        drag 20 30\nwheel 2\nkey equal\nkey v\nkey h\nkey period\nkey o\n\
        samples 2\nkey p\nmessage wrote\nkey c\nsamples 2\nframes 1\nsay SEEN\nmessage never";
    let arguments = [&QUICK[..], backend, &["--size=120x90", "--samples=2"]].concat();
    let mut viewer = Viewer::start(&display, &arguments, script);
    let copied = viewer.line();
    assert_eq!(viewer.hears("SEEN"), 2);
    let screen = display.screen();
    // Real input: the window has the keyboard when it is given to it, and Escape closes it.
    viewer.focus(&display);
    display.xdotool(&["key", "Escape"]);
    let place = viewer.ends_well();
    let (rendered, saved) = rendered_again(place.path(), "a.png");
    assert_eq!(saved.dimensions(), (120, 90));
    assert!(rendered == saved, "what the command line renders is what was saved");
    assert!(shows(&screen, &saved), "the screen shows what was saved");
    for option in
        ["--eye=", "--target=", "--fov", "--shade normal", "--shadows off", "--smooth=on", "--light="]
    {
        assert!(copied.contains(option), "{option}: {copied}");
    }
    let first = emboss(place.path())
        .args(["render"])
        .args(arguments.iter().filter(|argument| **argument != BY_SWAPCHAIN))
        .args(["--output=first.png"])
        .output()
        .expect("the program starts");
    assert!(first.status.success());
    let first = image::open(place.path().join("first.png")).expect("a PNG").to_rgba8();
    assert!(first != saved, "the camera has moved");
}

/// The window takes sizes one after the other, down to a pixel, and shows the last one as it is rendered.
fn assert_resizes(backend: &[&str]) {
    let Some(display) = Display::start() else { return };
    let mut script = String::from("samples 1\n");
    for (width, height) in [(200, 40), (1, 1), (64, 300), (333, 77), (100, 75), (101, 75), (100, 76)] {
        script += &format!("size {width} {height}\nframes 1\n");
    }
    // As though the window's system had taken back what pictures are shown by.
    script += "renew\nframes 2\nrenew\nsize 80 60\nframes 1\n";
    script += "size 96 72\nsamples 1\nkey p\nmessage wrote\nquit\n";
    let arguments = [&QUICK[..], backend, &["--size=48x36", "--samples=1"]].concat();
    let place = Viewer::start(&display, &arguments, &script).ends_well();
    let (rendered, saved) = rendered_again(place.path(), "a.png");
    assert_eq!(saved.dimensions(), (96, 72));
    assert!(rendered == saved);
}

/// Of 1,000 pictures of a moving camera none is kept. A single one of each frame, be it the film's or the window's,
/// would be 1000 x 160 x 120 x 4 bytes = 77 MB; the allocator's own moods are allowed a tenth of that.
fn assert_memory_is_stable(backend: &[&str]) {
    let Some(display) = Display::start() else { return };
    let script = "samples 1\nhold right\nframes 100\nsay EARLY\nframes 1000\nsay LATE\nrelease right\nquit";
    let arguments = [&["builtin:cube", "-", "-", "-", "-", "1", "--size=160x120"], backend].concat();
    let mut viewer = Viewer::start(&display, &arguments, script);
    viewer.hears("EARLY");
    let early = viewer.memory();
    viewer.hears("LATE");
    let late = viewer.memory();
    viewer.ends_well();
    assert!(late < early + 7_700_000, "{early} bytes have become {late}");
}

#[test]
fn screen_shows_what_render_renders() {
    assert_screen_is_what_render_renders(&["--backend=cpu"]);
}

#[test]
fn window_takes_any_size() {
    assert_resizes(&["--backend=cpu"]);
}

#[test]
fn memory_is_stable() {
    assert_memory_is_stable(&["--backend=cpu"]);
}

/// The numbers of an option of a command line.
fn numbers(command: &str, option: &str) -> Vec<f64> {
    let after = command.split(option).nth(1).unwrap_or_else(|| panic!("{option}: {command}"));
    let value = after.split(' ').next().expect("a value");
    value.split(',').map(|number| number.parse().expect("a number")).collect()
}

/// What a user does, by the display: keys, the mouse, another size and another place of the window, all at once, and
/// the window hidden and shown again. The picture is then that of the last camera and size.
fn assert_hears(backend: &[&str]) {
    let Some(display) = Display::start() else { return };
    let arguments = [&QUICK[..], backend, &["--size=120x90", "--samples=2"]].concat();
    let script =
        "key tab\nsamples 2\nsay READY\nmessage wrote\nsamples 2\nframes 1\nsay SAVED\nmessage never";
    let mut viewer = Viewer::start(&display, &arguments, script);
    viewer.hears("READY");
    let window = viewer.focus(&display);
    let mut copied = |keys: &[&str]| {
        display.xdotool(keys);
        display.xdotool(&["key", "c"]);
        viewer.line()
    };
    let turned = copied(&["key", "--delay", "200", "Right"]);
    let (eye, target) = (numbers(&turned, "--eye="), numbers(&turned, "--target="));
    let flown = copied(&["keydown", "w", "sleep", "0.2", "keyup", "w"]);
    let (flown_eye, flown_target) = (numbers(&flown, "--eye="), numbers(&flown, "--target="));
    // It flies straight ahead: eye and target move alike, the way that leads from one to the other.
    let moved: Vec<_> = (0..3).map(|i| flown_eye[i] - eye[i]).collect();
    let ahead: Vec<_> = (0..3).map(|i| target[i] - eye[i]).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let length = |a: &[f64]| dot(a, a).sqrt();
    assert!(dot(&moved, &ahead) > 0.999 * length(&moved) * length(&ahead) && length(&moved) > 0.0, "{flown}");
    let target_moved: Vec<_> = (0..3).map(|i| flown_target[i] - target[i]).collect();
    // Floats of six digits.
    assert!((0..3).all(|i| (target_moved[i] - moved[i]).abs() < 1e-5), "{flown}");
    let drag = [
        "mousemove",
        "--window",
        &window,
        "40",
        "40",
        "mousedown",
        "1",
        "mousemove",
        "--window",
        &window,
        "60",
        "50",
        "mousemove",
        "--window",
        &window,
        "80",
        "50",
        "mouseup",
        "1",
    ];
    let dragged = copied(&drag);
    assert_eq!(numbers(&dragged, "--target="), flown_target, "it goes round");
    assert_ne!(numbers(&dragged, "--eye="), flown_eye);
    let zoomed = copied(&["click", "4"]);
    assert!(numbers(&zoomed, "--fov ") < numbers(&dragged, "--fov "), "{zoomed}");
    // 40 sizes and places without a pause, and out of sight.
    let mut storm = vec![];
    for i in 0..40_u32 {
        let (width, height) = ((20 + 37 * i % 300).to_string(), (20 + 53 * i % 200).to_string());
        let place = (i % 7 * 20).to_string();
        storm.extend(["windowsize".to_owned(), window.clone(), width, height]);
        storm.extend(["windowmove".to_owned(), window.clone(), place.clone(), place]);
    }
    display.xdotool(&storm.iter().map(String::as_str).collect::<Vec<_>>());
    display.xdotool(&["windowunmap", &window, "sleep", "0.3", "windowmap", &window]);
    display.xdotool(&["windowmove", &window, "0", "0", "windowsize", "--sync", &window, "96", "72"]);
    viewer.focus(&display);
    // The viewer hears of the size before it hears of the key, and saves what it has all samples of.
    display.xdotool(&["sleep", "0.5", "key", "p"]);
    viewer.hears("SAVED");
    let screen = display.screen();
    display.xdotool(&["key", "Escape"]);
    let place = viewer.ends_well();
    let (rendered, saved) = rendered_again(place.path(), "a.png");
    assert_eq!(saved.dimensions(), (96, 72));
    assert!(rendered == saved);
    assert!(shows(&screen, &saved), "the screen shows what was saved");
}

#[test]
fn window_hears_the_display() {
    assert_hears(&["--backend=cpu"]);
}

#[test]
fn settings_go_back_to_what_was_loaded() {
    let Some(display) = Display::start() else { return };
    let script = "samples 1\nkey n\nsamples 1\nkey backspace\nsamples 1\nkey c\nquit";
    let arguments = [&QUICK[..], &["--backend=cpu", "--size=32x24", "--samples=1"]].concat();
    let mut viewer = Viewer::start(&display, &arguments, script);
    let copied = viewer.line();
    assert!(copied.contains("builtin:cube - - - - 4 "), "{copied}");
    viewer.ends_well();
}

/// A map that is half written leaves the scene as it was; one that is whole is seen.
#[test]
fn files_are_read_again_when_they_change() {
    let Some(display) = Display::start() else { return };
    let place = tempfile::tempdir().expect("a folder");
    let model = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
    std::fs::write(place.path().join("model.obj"), model).expect("writable");
    let map = |name: &str, bright: bool| {
        let texel = |x: u32, _| image::Luma([if bright { 255 } else { [0, 60, 120, 180][x as usize] }]);
        image::GrayImage::from_fn(4, 4, texel).save(place.path().join(name)).expect("writable");
    };
    map("color.png", false);
    map("new.png", true);
    let whole = std::fs::read(place.path().join("new.png")).expect("a file");
    let script = "samples 1\nkey p\nmessage wrote\nsay FIRST\nmessage the files have changed, but\nsay BROKEN\n\
        message read again\nsamples 1\nkey p\nmessage wrote\nsay SECOND\nquit";
    let arguments = ["model.obj", "color.png", "--backend=cpu", "--size=32x24", "--samples=1"];
    let mut viewer = Viewer::start_in(place, &display, &arguments, script);
    viewer.hears("FIRST");
    std::fs::write(viewer.path("color.png"), &whole[..whole.len() / 2]).expect("writable");
    viewer.hears("BROKEN");
    std::fs::write(viewer.path("color.png"), &whole).expect("writable");
    viewer.hears("SECOND");
    let place = viewer.ends_well();
    let first = image::open(place.path().join("a.png")).expect("a PNG").to_rgba8();
    let (rendered, second) = rendered_again(place.path(), "a-1.png");
    assert!(rendered == second && first != second);
}

/// A map that the model names comes later, and is painted over: what is seen is what is rendered from the files.
#[test]
fn relief_is_seen_when_its_map_comes_and_when_it_changes() {
    let Some(display) = Display::start() else { return };
    let place = tempfile::tempdir().expect("a folder");
    let model =
        "mtllib model.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
    std::fs::write(place.path().join("model.obj"), model).expect("writable");
    std::fs::write(place.path().join("model.mtl"), "newmtl m\ndisp relief.png\n").expect("writable");
    let step = "message read again\nsamples 1\nkey p\nmessage wrote\n";
    let script = format!("samples 1\nkey p\nmessage wrote\nsay FIRST\n{step}say SECOND\n{step}quit");
    let arguments = ["model.obj", "--backend=cpu", "--size=32x24", "--samples=1"];
    let mut viewer = Viewer::start_in(place, &display, &arguments, &script);
    for (word, width) in [("FIRST", 8), ("SECOND", 3)] {
        viewer.hears(word);
        let texel = |x, y| image::Luma([if (x / width + y / width) % 2 == 0 { 255_u8 } else { 40 }]);
        image::GrayImage::from_fn(24, 24, texel).save(viewer.path("relief.png")).expect("writable");
    }
    let (ended, place) = viewer.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(ended.stderr.contains("it is not there"), "{}", ended.stderr);
    let seen = |name: &str| image::open(place.path().join(name)).expect("a PNG").to_rgba8();
    assert!(seen("a.png") != seen("a-1.png"), "the map has come");
    assert!(seen("a-1.png") != seen("a-2.png"), "it was painted over");
    let (rendered, last) = rendered_again(place.path(), "a-2.png");
    assert!(rendered == last);
}

#[test]
fn no_display_points_to_render() {
    let place = tempfile::tempdir().expect("a folder");
    let output = emboss(place.path()).arg("view").output().expect("the program starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("no display") && stderr.contains("`emboss render`"), "{stderr}");
    assert!(!stderr.contains(".rs"), "no line of any source: {stderr}");
}

#[test]
fn what_the_arguments_name_wrongly_ends_the_viewer() {
    let Some(display) = Display::start() else { return };
    for (arguments, code) in [(["builtin:moon", "--backend=cpu"], 2), (["no.obj", "--backend=cpu"], 1)] {
        let (ended, _) = Viewer::start(&display, &arguments, "").end();
        assert_eq!(ended.code, Some(code), "{}", ended.stderr);
        assert!(ended.stderr.starts_with("error: "), "{}", ended.stderr);
    }
    let place = tempfile::tempdir().expect("a folder");
    let output = emboss(place.path()).args(["view", "--stats=a.json"]).output().expect("the program starts");
    assert_eq!(output.status.code(), Some(2), "{output:?}");
}

mod vulkan {
    use super::*;
    use crate::timing::{SLOW, assert_answers, assert_starts_within_two_seconds, delays};

    const LAVAPIPE: [&str; 3] = ["--backend=vulkan", "--device=llvmpipe", "--validate"];
    /// As on hardware.
    pub(crate) const SWAPCHAIN: [&str; 4] = [LAVAPIPE[0], LAVAPIPE[1], LAVAPIPE[2], BY_SWAPCHAIN];

    #[test]
    fn screen_shows_what_render_renders() {
        assert_screen_is_what_render_renders(&LAVAPIPE);
    }

    /// As users start it, without the layers.
    #[test]
    fn starts_within_two_seconds() {
        assert_starts_within_two_seconds(&LAVAPIPE[..2]);
    }

    #[test]
    fn swapchain_shows_what_render_renders() {
        assert_screen_is_what_render_renders(&SWAPCHAIN);
    }

    #[test]
    fn window_takes_any_size() {
        assert_resizes(&SWAPCHAIN);
    }

    /// 1,100 frames under the validation layers, which are silent.
    #[test]
    fn memory_is_stable() {
        assert_memory_is_stable(&SWAPCHAIN);
    }

    #[test]
    fn window_answers_while_a_pass_takes_long() {
        assert_answers(&LAVAPIPE);
    }

    /// To present to a swapchain of lavapipe is to wait until the submission under way has ended, which is what it is
    /// where an item takes long. What the user does is heard all the same.
    #[test]
    fn window_answers_while_a_picture_waits_for_the_device() {
        if let Some((answers, ..)) = delays(&[&SLOW[..], &SWAPCHAIN, &["--size=640x480"]].concat()) {
            answers.assert_prompt("answers");
        }
    }

    #[test]
    fn window_hears_the_display() {
        assert_hears(&SWAPCHAIN);
    }

    #[test]
    fn without_a_device_it_points_to_render() {
        let Some(display) = Display::start() else { return };
        let place = tempfile::tempdir().expect("a folder");
        let none = place.path().join("none.json");
        let output = emboss(place.path())
            .args(["view", "--backend=vulkan"])
            .envs(display.environment.clone())
            .env("VK_DRIVER_FILES", &none)
            .env("VK_ICD_FILENAMES", &none)
            .output()
            .expect("the program starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{stderr}");
        assert!(stderr.contains("`emboss render`") && stderr.contains("--backend cpu"), "{stderr}");
    }
}

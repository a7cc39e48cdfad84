//! Windows on screens of other densities, on several screens, and out of sight.

use crate::harness::{Display, Viewer, shows};
use crate::x11::Desktop;
use crate::{QUICK, numbers, rendered_again};
use image::RgbaImage;
use std::time::{Duration, Instant};

/// All samples take seconds on whatever machine, so that it is minimised before they are done.
const ONE_THREAD: [(&str, &str); 2] = [("RAYON_NUM_THREADS", "1"), ("LP_NUM_THREADS", "1")];

/// Passes are over, and nothing goes round.
fn assert_falls_idle(viewer: &Viewer) {
    let start = Instant::now();
    // A script that waits looks 200 times a second whether it still has to.
    while viewer.load(Duration::from_millis(300)) > 0.15 {
        assert!(start.elapsed() < Duration::from_secs(20), "it goes on");
    }
}

/// The screen shows soon what the window was given: its system takes that when it draws next.
#[track_caller]
fn assert_comes(is_there: impl Fn() -> bool) {
    let start = Instant::now();
    while !is_there() {
        assert!(start.elapsed() < Duration::from_secs(20), "the screen does not show it");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// What was saved is what its command line renders, in that size. Returns it.
fn saved(viewer: &Viewer, name: &str, size: (u32, u32)) -> RgbaImage {
    let (rendered, saved) = rendered_again(viewer.folder(), name);
    assert_eq!(saved.dimensions(), size, "{name}");
    assert!(rendered == saved, "{name} is what the command line renders");
    saved
}

/// Whether the screen shows the picture with a panel whose first row is where it is for that density: a quarter of a
/// letter's height from the top, which is 16 pixels of the usual density.
fn is_with_panel_for(density: u32, screen: &impl Fn(usize, usize) -> u32, without: &RgbaImage) -> bool {
    let is_changed = |y: &u32| {
        (0..without.width()).any(|x| {
            let [r, g, b, _] = without.get_pixel(x, *y).0.map(u32::from);
            screen(x as usize, *y as usize) != r << 16 | g << 8 | b
        })
    };
    (0..without.height()).find(is_changed) == Some(4 * density)
}

/// Drags so many pixels to the right from where all is seen. Returns where the eye is then.
fn eye_after_drag(viewer: &mut Viewer, display: &Display, window: &str, pixels: u32) -> Vec<f64> {
    let columns = [40, 40 + pixels / 2, 40 + pixels].map(|column| column.to_string());
    let [start, half, end] = &columns;
    let to = |column| ["mousemove", "--window", window, column, "40"];
    display.xdotool(&[&["key", "r"], &to(start)[..], &["mousedown", "1"]].concat());
    display.xdotool(&[&to(half)[..], &to(end), &["mouseup", "1", "key", "c"]].concat());
    let command = viewer.line();
    display.xdotool(&["key", "r"]);
    numbers(&command, "--eye=")
}

/// On a screen that becomes twice as dense the window has twice as many columns and rows, the picture and the panel
/// too, and the same way of the hand turns the model as far.
fn assert_follows_density(backend: &[&str]) {
    let Some(display) = Display::start() else { return };
    let desktop = Desktop::of(&display);
    let script = "key tab\nsamples 2\nsay READY\ndensity 2\nsamples 2\nkey p\nmessage wrote a.png\nsamples 2\n\
        frames 1\nsay DENSE\ndensity 1\nsamples 2\nkey p\nmessage wrote a-1.png\nsamples 2\nframes 1\nsay USUAL\n\
        message never";
    let arguments = [&QUICK[..], backend, &["--size=120x90", "--samples=2"]].concat();
    let mut viewer = Viewer::start(&display, &arguments, script);
    viewer.hears("READY");
    let window = viewer.focus(&display);
    desktop.set_density(2);
    viewer.hears("DENSE");
    let dense = saved(&viewer, "a.png", (240, 180));
    assert_comes(|| shows(&display.screen(), &dense));
    display.xdotool(&["key", "Tab"]);
    assert_comes(|| is_with_panel_for(2, &display.screen(), &dense));
    display.xdotool(&["key", "Tab"]);
    desktop.tell_place(&window, 240, 180);
    let eye = eye_after_drag(&mut viewer, &display, &window, 40);
    let size = display.xdotool(&["getwindowgeometry", &window]);
    assert!(size.contains("240x180"), "a window that is moved does not grow again: {size}");
    desktop.set_density(1);
    viewer.hears("USUAL");
    let usual = saved(&viewer, "a-1.png", (120, 90));
    assert_comes(|| shows(&display.screen(), &usual));
    assert_eq!(eye_after_drag(&mut viewer, &display, &window, 20), eye);
    display.xdotool(&["key", "Escape"]);
    viewer.ends_well();
}

#[test]
fn window_follows_density() {
    assert_follows_density(&["--backend=cpu"]);
}

/// The same on Wayland, whose screens differ: the window goes to another one and comes back. Before that it is resized,
/// and what shows its pictures is made anew; after it nobody sees the window for a time, in which it neither waits for
/// the screen nor goes round, and is right when it is back.
fn assert_follows_screens(backend: &[&str]) {
    let Some(display) = Display::sway() else { return };
    let save = |name: &str, word: &str| {
        format!("samples 2\nkey p\nmessage wrote {name}.png\nsamples 2\nframes 1\nsay {word}\n")
    };
    let script = [
        "samples 2\nsize 96 72\nframes 1\nrenew\nframes 1\nsize 121 91\nframes 1\nsay READY\n",
        &format!("density 2\n{}density 1\nkey tab\n", save("a", "DENSE")),
        &format!("{}density 2\n{}", save("a-1", "OTHER"), save("a-2", "BACK")),
        "hold right\nframes 60\nsay EARLY\nframes 60\nrelease right\n",
        &format!("{}message never", save("a-3", "HIDDEN")),
    ];
    let arguments = [&QUICK[..], backend, &["--size=121x91", "--samples=2"]].concat();
    let mut viewer = Viewer::start(&display, &arguments, &script.concat());
    viewer.hears("READY");
    display.sway_does("output HEADLESS-1 scale 2");
    display.sway_puts_window_into_corner();
    viewer.hears("DENSE");
    let dense = saved(&viewer, "a.png", (242, 182));
    assert_comes(|| is_with_panel_for(2, &display.sway_screen("HEADLESS-1"), &dense));
    display.sway_does("create_output");
    display.sway_moves_window("move to output HEADLESS-2");
    display.sway_puts_window_into_corner();
    viewer.hears("OTHER");
    let other = saved(&viewer, "a-1.png", (121, 91));
    assert_comes(|| shows(&display.sway_screen("HEADLESS-2"), &other));
    display.sway_moves_window("move to output HEADLESS-1");
    viewer.hears("BACK");
    saved(&viewer, "a-2.png", (242, 182));
    viewer.hears("EARLY");
    display.sway_moves_window("move scratchpad");
    viewer.hears("HIDDEN");
    assert_falls_idle(&viewer);
    let last = saved(&viewer, "a-3.png", (242, 182));
    display.sway_moves_window("scratchpad show");
    display.sway_puts_window_into_corner();
    assert_comes(|| shows(&display.sway_screen("HEADLESS-1"), &last));
    display.sway_moves_window("kill");
    viewer.ends_well();
}

#[test]
fn window_follows_screens() {
    assert_follows_screens(&["--backend=cpu"]);
}

/// Nobody sees a minimised window: nothing is rendered, no processor is busy, and when it is back the picture goes on
/// from where it was.
fn assert_waits_while_minimised(backend: &[&str], samples: u32) {
    let Some(mut display) = Display::managed() else { return };
    display.environment.extend(ONE_THREAD.map(|(name, one)| (name, one.into())));
    let script = format!(
        "key tab\nsamples 2\nsay READY\nsamples {samples}\nkey p\nmessage wrote\nsamples {samples}\nframes 1\n\
         say SAVED\nmessage never"
    );
    let samples_option = format!("--samples={samples}");
    let arguments = [&QUICK[..], backend, &["--size=200x150", &samples_option]].concat();
    let mut viewer = Viewer::start(&display, &arguments, &script);
    viewer.hears("READY");
    let window = display.xdotool(&["search", "--name", "emboss"]);
    display.xdotool(&["windowminimize", &window]);
    assert_falls_idle(&viewer);
    let load = viewer.load(Duration::from_secs(1));
    assert!(load < 0.15, "{load} of a processor");
    let before = viewer.processor_time();
    display.xdotool(&["windowactivate", &window]);
    assert_eq!(viewer.hears("SAVED"), samples);
    let rendering = viewer.processor_time() - before;
    assert!(rendering > 0.3, "it had not rendered all before: {rendering} s");
    // Within the frame that the manager gives it, wherever that is, and as soon as the screen has it.
    let saved = image::open(viewer.path("a.png")).expect("a PNG").to_rgba8();
    let is_shown = || {
        let screen = display.screen();
        let mut places = (0..440).flat_map(|x| (0..330).map(move |y| (x, y)));
        places.any(|(left, top)| shows(&|x, y| screen(left + x, top + y), &saved))
    };
    assert_comes(|| {
        // The pointer would be seen too, and the manager may not leave it where it was put.
        display.xdotool(&["mousemove", "639", "479"]);
        is_shown()
    });
    viewer.focus(&display);
    display.xdotool(&["key", "Escape"]);
    let place = viewer.ends_well();
    let (rendered, saved) = rendered_again(place.path(), "a.png");
    assert!(rendered == saved);
}

#[test]
fn minimised_window_waits() {
    assert_waits_while_minimised(&["--backend=cpu"], 80);
}

/// On some desktops a minimised window is as it was but for its state. It is back when that says so, of which nothing
/// tells, whatever told before that it is seen.
#[test]
fn window_that_is_minimised_without_a_word_waits() {
    let Some(mut display) = Display::start() else { return };
    display.environment.extend(ONE_THREAD.map(|(name, one)| (name, one.into())));
    let desktop = Desktop::of(&display);
    let script = "key tab\nsamples 1\nsay READY\nsamples 60\nsay DONE\nmessage never";
    let arguments = [&QUICK[..], &["--backend=cpu", "--size=200x150", "--samples=60"]].concat();
    let mut viewer = Viewer::start(&display, &arguments, script);
    viewer.hears("READY");
    let window = display.xdotool(&["search", "--name", "emboss"]);
    desktop.set_minimized(&window, true);
    assert_falls_idle(&viewer);
    display.xdotool(&["windowunmap", "--sync", &window, "windowmap", "--sync", &window]);
    assert_falls_idle(&viewer);
    let before = viewer.processor_time();
    desktop.set_minimized(&window, false);
    assert_eq!(viewer.hears("DONE"), 60);
    let rendering = viewer.processor_time() - before;
    assert!(rendering > 0.3, "it had not rendered all before: {rendering} s");
    viewer.focus(&display);
    display.xdotool(&["key", "Escape"]);
    viewer.ends_well();
}

mod vulkan {
    use super::*;
    use crate::vulkan::SWAPCHAIN;

    #[test]
    fn window_follows_density() {
        assert_follows_density(&SWAPCHAIN);
    }

    #[test]
    fn window_follows_screens() {
        assert_follows_screens(&SWAPCHAIN);
    }

    #[test]
    fn minimised_window_waits() {
        assert_waits_while_minimised(&SWAPCHAIN, 30);
    }
}

use crate::harness::{Display, Ended, Viewer, command_in, emboss, shows};
use ash::vk;
use emboss_faults::{Fault, Faults};
use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const LAVAPIPE: [&str; 3] = ["--backend=vulkan", "--device=llvmpipe", "--validate"];
/// A quick scene.
const CUBE: [&str; 7] = ["builtin:cube", "-", "-", "-", "-", "4", "--seed=1"];
const SUBMIT: &str = "vkQueueSubmit";
const WAIT: &str = "vkWaitForFences";
const ALLOCATE: &str = "vkAllocateMemory";
const ACQUIRE: &str = "vkAcquireNextImageKHR";
const PRESENT: &str = "vkQueuePresentKHR";
const LOST: vk::Result = vk::Result::ERROR_DEVICE_LOST;
const SURFACE_LOST: vk::Result = vk::Result::ERROR_SURFACE_LOST_KHR;

/// A folder to run in, and the layer in another.
struct Place {
    folder: TempDir,
    faults: Faults,
    _layer: TempDir,
}

impl Place {
    fn new() -> Place {
        let [folder, layer] = [(); 2].map(|()| tempfile::tempdir().expect("a folder"));
        let faults = Faults::new(layer.path()).expect("writable");
        Place { folder, faults, _layer: layer }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn plan(&self, faults: &[Fault]) {
        self.faults.plan(faults).expect("writable");
    }

    /// The program under the layer.
    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = emboss(self.folder.path());
        command.envs(self.faults.environment()).args(arguments);
        command
    }

    /// How the program ends that runs under the layer, and what it says on standard output.
    fn run(&self, arguments: &[&str]) -> (Ended, String) {
        let output = self.command(arguments).output().expect("the program starts");
        let [stdout, stderr] =
            [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
        (Ended { code: output.status.code(), stderr }, stdout)
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).expect("it was written")
    }

    fn results(&self) -> serde_json::Value {
        serde_json::from_str(&self.read("out/results.json")).expect("JSON")
    }

    /// Its files, of which none is a part of one.
    fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder.path()).expect("readable");
        let mut names: Vec<_> = entries
            .map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }
}

impl Ended {
    /// With exit code 1 and one message, which has `parts`; neither the validation layers nor a panic says more.
    #[track_caller]
    fn failed(&self, parts: &[&str]) {
        assert_eq!(self.code, Some(1), "{}", self.stderr);
        assert_eq!(self.stderr.matches("error: ").count(), 1, "{}", self.stderr);
        for part in parts {
            assert_eq!(self.stderr.matches(part).count(), 1, "`{part}` once in: {}", self.stderr);
        }
        for word in ["WARN", "ERROR ", "alidation", "VUID", "panicked"] {
            assert!(!self.stderr.contains(word), "{}", self.stderr);
        }
    }
}

/// A viewer under the layer, on a display of its own.
fn view(place: &Place, display: &mut Display, arguments: &[&str], script: &str) -> Viewer {
    display.environment.extend(place.faults.environment());
    let arguments = [&CUBE[..], &LAVAPIPE, &["--size=120x90"], arguments].concat();
    Viewer::start(display, &arguments, script)
}

/// The command line that a viewer leaves when it fails.
fn last_command(ended: &Ended) -> &str {
    let (_, command) = ended.stderr.split_once("is rendered again by: ").expect("a command line");
    command.trim_end()
}

/// The words of a command line, none of which is quoted, but for how many samples there were.
fn without_samples(command: &str) -> Vec<&str> {
    let mut words: Vec<_> = command.split(' ').collect();
    let samples = words.iter().position(|word| *word == "--samples").expect("it is said");
    words.remove(samples + 1);
    words
}

/// Wherever it is noticed: by what is submitted or waited for, by the thread that renders or the one that shows. What
/// was saved stays, and the last words are the command line of what was seen, which renders it.
#[test]
fn lost_device_ends_the_viewer_with_what_was_seen() {
    let cases: [(&str, &[&str]); 4] = [
        (SUBMIT, &[]),
        (WAIT, &["--by-swapchain"]),
        (PRESENT, &["--by-swapchain"]),
        (ACQUIRE, &["--by-swapchain"]),
    ];
    for (call, option) in cases {
        let Some(mut display) = Display::start() else { return };
        let place = Place::new();
        let script =
            "samples 2\nkey h\nkey v\ndrag 20 30\nsamples 2\nkey p\nmessage wrote\nsay SEEN\nmessage never";
        let mut viewer = view(&place, &mut display, &[&["--samples=100000"], option].concat(), script);
        viewer.hears("SEEN");
        place.plan(&[Fault::from(call, 1, LOST)]);
        let (ended, folder) = viewer.end();
        ended.failed(&["llvmpipe (", "was lost while ", "--backend cpu"]);
        let saved = command_in(&folder.path().join("a.png"));
        assert_eq!(without_samples(last_command(&ended)), without_samples(&saved), "{call}");
        for option in ["--eye=", "--shadows off", "--shade normal"] {
            assert!(saved.contains(option), "{option}: {saved}");
        }
        assert_eq!(place.faults.failed().expect("it failed")[0], format!("{call} ERROR_DEVICE_LOST"));
    }
}

/// What a viewer says last can be run.
#[test]
fn lost_devices_command_renders() {
    let Some(mut display) = Display::start() else { return };
    let place = Place::new();
    place.plan(&[Fault::from(SUBMIT, 1, LOST)]);
    let (ended, folder) = view(&place, &mut display, &["--samples=2"], "message never").end();
    ended.failed(&["was lost while "]);
    let words: Vec<_> = last_command(&ended).split(' ').collect();
    assert_eq!(words[..2], ["emboss", "render"]);
    let output = emboss(folder.path()).args(&words[1..]).output().expect("the program starts");
    assert!(output.status.success(), "{output:?}");
    assert_eq!(image::image_dimensions(folder.path().join("a.png")).expect("a picture"), (120, 90));
}

/// A viewer of a few pictures, whose screen shows the last one whatever fails. It is told to end.
fn is_shown_all_the_same(place: &Place, display: &mut Display) -> Viewer {
    let script = "samples 1\nframes 3\nkey tab\nkey v\nsamples 4\nframes 3\nkey p\nmessage wrote\nsay SHOWN\n\
        message never";
    let arguments = ["--by-swapchain", "--samples=4", "--background=0.25,0.5,1"];
    let mut viewer = view(place, display, &arguments, script);
    assert_eq!(viewer.hears("SHOWN"), 4);
    let saved = image::open(viewer.path("a.png")).expect("a PNG").to_rgba8();
    assert!(shows(&display.screen(), &saved));
    viewer.focus(display);
    display.xdotool(&["key", "Escape"]);
    viewer
}

/// A window's system may take back its surface, and change the window, at any time.
#[test]
fn lost_surfaces_and_stale_swapchains_are_made_anew() {
    let Some(mut display) = Display::start() else { return };
    let place = Place::new();
    let stale = vk::Result::ERROR_OUT_OF_DATE_KHR;
    let fault = |call: &str, number, answer| Fault { call: call.into(), numbers: number..=number, answer };
    // The first picture, two in succession, and one after the other.
    let faults = [
        fault(ACQUIRE, 1, SURFACE_LOST),
        fault(ACQUIRE, 2, stale),
        fault(PRESENT, 1, stale),
        fault(PRESENT, 2, SURFACE_LOST),
        fault(PRESENT, 4, SURFACE_LOST),
        fault(ACQUIRE, 8, SURFACE_LOST),
        fault(PRESENT, 6, stale),
    ];
    place.plan(&faults);
    let viewer = is_shown_all_the_same(&place, &mut display);
    viewer.ends_well();
    let failed = place.faults.failed().expect("they failed");
    assert_eq!(failed.len(), faults.len(), "{failed:?}");
}

/// Where a surface is lost as often as it is made, the window's system shows the pictures without one.
#[test]
fn surface_that_cannot_be_had_is_done_without() {
    let Some(mut display) = Display::start() else { return };
    let place = Place::new();
    place.plan(&[Fault::from(PRESENT, 3, SURFACE_LOST)]);
    let viewer = is_shown_all_the_same(&place, &mut display);
    let (ended, _) = viewer.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let said = "INFO pictures are shown by the window's system: Vulkan: presenting a picture failed: ";
    // The cube's relief asks for a larger N, which is said too.
    let is_other = |line: &&str| !line.is_empty() && !line.contains("texels lie between");
    let lines: Vec<_> = ended.stderr.lines().map(str::trim).filter(is_other).collect();
    assert!(lines[0].starts_with(said) && lines[1..] == ["INFO wrote a.png"], "{}", ended.stderr);
    let failed = place.faults.failed().expect("it failed");
    assert!(failed.iter().all(|call| call.starts_with(PRESENT)), "{failed:?}");
}

/// Memory that is not there for what is asked next: the picture stays, and what is asked then is had.
#[test]
fn viewer_goes_on_without_memory_for_more() {
    let Some(mut display) = Display::start() else { return };
    let place = Place::new();
    let script = "samples 1\nsay SEEN\nmessage the scene stays as it was: no memory for\nsamples 1\nkey pageup\n\
        samples 1\nkey p\nmessage wrote\nquit";
    let mut viewer = view(&place, &mut display, &["--samples=1"], script);
    viewer.hears("SEEN");
    let full = vk::Result::ERROR_OUT_OF_DEVICE_MEMORY;
    place.plan(&[Fault { call: ALLOCATE.into(), numbers: 1..=1, answer: full }]);
    viewer.focus(&display);
    display.xdotool(&["key", "Page_Up"]);
    let folder = viewer.ends_well();
    // Of two steps the first was taken back.
    let command = command_in(&folder.path().join("a.png"));
    assert!(command.contains("builtin:cube - - - - 8 "), "{command}");
    assert_eq!(place.faults.failed().expect("it failed").len(), 1);
}

/// A message, and nothing of what was there is touched.
#[test]
fn failed_rendering_leaves_what_was_there() {
    let full = vk::Result::ERROR_OUT_OF_DEVICE_MEMORY;
    // So many submissions are made for a scene that is loaded, and for some of its samples.
    for (fault, parts) in [
        (Fault::from(SUBMIT, 200, LOST), ["was lost while rendering", "out.png was not written"]),
        (Fault::from(WAIT, 200, LOST), ["was lost while rendering", "out.png was not written"]),
        (Fault::from(ALLOCATE, 3, full), ["no memory for ", "smaller maps"]),
    ] {
        let place = Place::new();
        std::fs::write(place.path("out.png"), "older").expect("writable");
        place.plan(&[fault]);
        // Quiet, since the cube's relief asks for a larger N than this.
        let more = ["--size=32x24", "--samples=1000", "--output=out.png", "--stats=stats.json", "--quiet"];
        let (ended, _) = place.run(&[&["render"], &CUBE[..], &LAVAPIPE, &more].concat());
        ended.failed(&parts);
        assert_eq!((place.files(), place.read("out.png")), (vec!["out.png".to_owned()], "older".to_owned()));
    }
}

/// What was measured is kept, and can be looked at; the same command goes on from there.
#[test]
fn comparison_goes_on_after_a_lost_device() {
    let place = Place::new();
    let command = |time| {
        let quick = ["compare", "builtin:quilt", "--size=24x18", "--samples=1", "--n=2,8", "--reference=8"];
        let more = ["--methods=quadtree,none", "--output=out", time];
        [&quick[..], &LAVAPIPE, &more].concat()
    };
    // Longer than anyone waits.
    let mut program = place.command(&command("--time=600"));
    let mut program =
        program.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the program starts");
    let start = Instant::now();
    let is_measured = || {
        std::fs::read_to_string(place.path("out/results.json")).is_ok_and(|text| text.contains("frame_ms"))
    };
    while !is_measured() {
        if start.elapsed() > Duration::from_secs(300) {
            let _ = program.kill();
            panic!("nothing is measured");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    place.plan(&[Fault::from(SUBMIT, 1, LOST)]);
    let mut stderr = String::new();
    program.stderr.take().expect("piped").read_to_string(&mut stderr).expect("text");
    let ended = Ended { code: program.wait().expect("it ends").code(), stderr };
    ended.failed(&["was lost while ", "what is measured is kept, and the same command goes on from there"]);
    assert!(place.read("out/report.html").contains("quadtree"), "a report of what is there");
    let before = place.results();
    assert_eq!(before["complete"], false);

    std::fs::remove_file(place.faults.environment()[2].1.as_os_str()).expect("there was a plan");
    let (ended, stdout) = place.run(&command("--time=0"));
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(stdout.contains("Going on in out: "), "{stdout}");
    let after = place.results();
    assert_eq!(
        (&after["complete"], after["configurations"].as_array().map(Vec::len)),
        (&true.into(), Some(3))
    );
    // Not measured again.
    let kept = before["configurations"].as_array().expect("measurements");
    for (i, measured) in kept.iter().enumerate() {
        assert_eq!(after["configurations"][i], *measured);
    }
}

/// The sizes before the one under which a device is lost.
#[test]
fn benchmark_keeps_what_was_measured() {
    let place = Place::new();
    let bench =
        ["bench", "build", "--device=llvmpipe", "--sizes=1000,2000,4000", "--time=0", "--json=bench.json"];
    let mut program = place.command(&bench);
    let mut program =
        program.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts");
    // A heading of two lines, and the row of the first size. Each of the others is warmed up for longer than a second.
    let mut rows = BufReader::new(program.stdout.take().expect("piped")).lines();
    assert!(rows.nth(2).is_some_and(|row| row.expect("text").trim_start().starts_with("1000 ")));
    place.plan(&[Fault::from(SUBMIT, 1, LOST)]);
    let mut stderr = String::new();
    program.stderr.take().expect("piped").read_to_string(&mut stderr).expect("text");
    Ended { code: program.wait().expect("it ends").code(), stderr }.failed(&["was lost while "]);
    let results: serde_json::Value = serde_json::from_str(&place.read("bench.json")).expect("JSON");
    assert!(results[0]["sizes"].as_array().is_some_and(|sizes| (1..3).contains(&sizes.len())), "{results}");
    assert_eq!(results[0]["sizes"][0]["primitives"], 1000);
}

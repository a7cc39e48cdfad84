//! The viewer in a window of a display of its own (Xvfb): what it shows, what it hears, and how it ends. Those tests that run
//! on lavapipe are in `vulkan`.

use image::RgbaImage;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use tempfile::TempDir;

/// A quick scene that fills its background, so that a picture is what a screen shows.
const QUICK: [&str; 8] = ["builtin:cube", "-", "-", "-", "-", "4", "--seed=1", "--background=0.25,0.5,1"];

/// A display, with a folder in which it keeps what its screen shows.
struct Display {
    server: Child,
    name: String,
    folder: TempDir,
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

impl Display {
    /// A display, or nothing on a machine without Xvfb that is not CI.
    fn start() -> Option<Display> {
        let folder = tempfile::tempdir().expect("a folder");
        let mut xvfb = Command::new("Xvfb");
        xvfb.args(["-displayfd", "1", "-screen", "0", "640x480x24", "-nolisten", "tcp", "-fbdir"]);
        let started = xvfb.arg(folder.path()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let mut server = match started {
            Ok(server) => server,
            Err(error) if std::env::var_os("CI").is_none() => {
                let remedy = "`cargo xtask test packages` installs it";
                let _ = writeln!(std::io::stderr(), "NOT TESTED: Xvfb is missing ({error}); {remedy}");
                return None;
            }
            Err(error) => panic!("Xvfb is missing ({error}); `cargo xtask test packages` installs it"),
        };
        let mut number = String::new();
        let told = server.stdout.take().expect("piped");
        BufReader::new(told).read_line(&mut number).expect("Xvfb tells its number");
        Some(Display { server, name: format!(":{}", number.trim()), folder })
    }

    /// What its screen shows: `0x00RRGGBB`, by column and row. The file is an X window dump: a header of words with their
    /// highest byte first, a table of colours, and texels.
    fn screen(&self) -> impl Fn(usize, usize) -> u32 {
        let dump = std::fs::read(self.folder.path().join("Xvfb_screen0")).expect("the screen's file");
        let word =
            |i: usize| u32::from_be_bytes(dump[4 * i..4 * i + 4].try_into().expect("four bytes")) as usize;
        let (header, row_bytes, colors) = (word(0), word(12), word(19));
        let texels = header + 12 * colors;
        move |x, y| {
            let at = texels + y * row_bytes + 4 * x;
            u32::from_le_bytes(dump[at..at + 4].try_into().expect("four bytes")) & 0xFF_FFFF
        }
    }

    fn xdotool(&self, arguments: &[&str]) -> String {
        let output = Command::new("xdotool").args(arguments).env("DISPLAY", &self.name).output();
        let output = output.expect("xdotool, which `cargo xtask test packages` installs");
        assert!(output.status.success(), "xdotool {arguments:?}: {output:?}");
        String::from_utf8_lossy(&output.stdout).trim().to_owned()
    }
}

/// A viewer that runs.
struct Viewer {
    program: Child,
    said: BufReader<ChildStdout>,
    place: TempDir,
}

/// How it ended.
#[derive(Debug)]
struct Ended {
    code: Option<i32>,
    stderr: String,
}

fn emboss(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_emboss"));
    command.current_dir(folder);
    command
}

impl Viewer {
    /// `emboss view` in an empty folder, following a script.
    fn start(display: &Display, arguments: &[&str], script: &str) -> Viewer {
        Viewer::start_in(tempfile::tempdir().expect("a folder"), display, arguments, script)
    }

    fn start_in(place: TempDir, display: &Display, arguments: &[&str], script: &str) -> Viewer {
        std::fs::write(place.path().join("script"), script).expect("writable");
        let mut command = emboss(place.path());
        command.arg("view").args(arguments).args(["--script=script", "--output=a.png"]);
        command.env("DISPLAY", &display.name).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut program = command.spawn().expect("the program starts");
        let said = BufReader::new(program.stdout.take().expect("piped"));
        Viewer { program, said, place }
    }

    /// The next line that it says.
    fn line(&mut self) -> String {
        let mut line = String::new();
        self.said.read_line(&mut line).expect("text");
        if line.is_empty() {
            let mut stderr = String::new();
            self.program.stderr.take().expect("piped").read_to_string(&mut stderr).expect("text");
            panic!("the viewer ended: {stderr}");
        }
        line.trim_end().to_owned()
    }

    /// Waits until the script says `word`; returns the number of samples that are seen then.
    fn hears(&mut self, word: &str) -> u32 {
        let line = self.line();
        let samples = line.strip_prefix(word).unwrap_or_else(|| panic!("`{line}` is not {word}"));
        samples.trim().parse().expect("a number of samples")
    }

    /// Bytes of memory that it holds.
    fn memory(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.program.id())).expect("it runs");
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("its memory");
        line.trim().trim_end_matches("kB").trim().parse::<u64>().expect("a number") * 1024
    }

    fn path(&self, name: &str) -> PathBuf {
        self.place.path().join(name)
    }

    fn end(mut self) -> (Ended, TempDir) {
        let mut stderr = String::new();
        self.program.stderr.take().expect("piped").read_to_string(&mut stderr).expect("text");
        let code = self.program.wait().expect("it ends").code();
        (Ended { code, stderr }, self.place)
    }

    /// Waits for its end, which has to be a good one. Returns its folder.
    fn ends_well(self) -> TempDir {
        let (ended, place) = self.end();
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        assert!(!ended.stderr.contains("alidation"), "{}", ended.stderr);
        place
    }
}

/// What the command line in a PNG renders, and the PNG.
fn rendered_again(folder: &Path, name: &str) -> (RgbaImage, RgbaImage) {
    let path = folder.join(name);
    let file = BufReader::new(std::fs::File::open(&path).expect("a picture"));
    let reader = png::Decoder::new(file).read_info().expect("a PNG");
    let chunk = reader.info().utf8_text.iter().find(|chunk| chunk.keyword == "Command").expect("a command");
    let command = chunk.get_text().expect("text");
    let saved = image::open(&path).expect("a PNG").to_rgba8();
    // No word of it is quoted.
    let words: Vec<_> = command.split(' ').collect();
    assert_eq!(words[..2], ["emboss", "render"]);
    let output = emboss(folder).args(&words[1..]).output().expect("the program starts");
    assert!(output.status.success(), "{command}: {output:?}");
    let output = words.iter().position(|word| *word == "--output").expect("it is named");
    (image::open(folder.join(words[output + 1])).expect("a PNG").to_rgba8(), saved)
}

/// Moves the camera, changes settings, saves; what is saved, what the command line renders and what the screen shows are
/// one picture, to the bit: same kernels, same camera, same samples.
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
    let window = display.xdotool(&["search", "--name", "emboss"]);
    display.xdotool(&["windowfocus", "--sync", &window]);
    display.xdotool(&["key", "Escape"]);
    let place = viewer.ends_well();
    let (rendered, saved) = rendered_again(place.path(), "a.png");
    assert_eq!(saved.dimensions(), (120, 90));
    assert!(rendered == saved, "what the command line renders is what was saved");
    let shown = saved.enumerate_pixels().filter(|(x, y, texel)| {
        let [r, g, b, _] = texel.0.map(u32::from);
        screen(*x as usize, *y as usize) == r << 16 | g << 8 | b
    });
    assert_eq!(shown.count(), 120 * 90, "the screen shows what was saved");
    for option in
        ["--eye=", "--target=", "--fov", "--shade normal", "--shadows off", "--smooth=on", "--light="]
    {
        assert!(copied.contains(option), "{option}: {copied}");
    }
    let first = emboss(place.path())
        .args(["render"])
        .args(&arguments)
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
    script += "size 96 72\nsamples 1\nkey p\nmessage wrote\nquit\n";
    let arguments = [&QUICK[..], backend, &["--size=48x36", "--samples=1"]].concat();
    let place = Viewer::start(&display, &arguments, &script).ends_well();
    let (rendered, saved) = rendered_again(place.path(), "a.png");
    assert_eq!(saved.dimensions(), (96, 72));
    assert!(rendered == saved);
}

/// Of 1,000 pictures of a moving camera none is kept. A single one of each frame, be it the film's or the window's, would be
/// 1000 x 160 x 120 x 4 bytes = 77 MB; the allocator's own moods are allowed a tenth of that.
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

/// While a pass takes longer than all that, the window is redrawn 30 times.
#[test]
fn window_answers_while_a_pass_takes_long() {
    let Some(display) = Display::start() else { return };
    let arguments =
        ["builtin:cube", "-", "-", "-", "-", "64", "--method=brute-force", "--backend=cpu", "--size=320x240"];
    let script = "hold right\nframes 30\nrelease right\nkey equal\nframes 2\nsay SEEN\nquit";
    let mut viewer = Viewer::start(&display, &arguments, script);
    assert_eq!(viewer.hears("SEEN"), 0, "no pass over all pixels is done by then");
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

#[test]
fn no_display_points_to_render() {
    let place = tempfile::tempdir().expect("a folder");
    let output =
        emboss(place.path()).arg("view").env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output();
    let output = output.expect("the program starts");
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

    const LAVAPIPE: [&str; 3] = ["--backend=vulkan", "--device=llvmpipe", "--validate"];

    #[test]
    fn screen_shows_what_render_renders() {
        assert_screen_is_what_render_renders(&LAVAPIPE);
    }

    #[test]
    fn window_takes_any_size() {
        assert_resizes(&LAVAPIPE);
    }

    /// 1,100 frames under the validation layers, which are silent.
    #[test]
    fn memory_is_stable() {
        assert_memory_is_stable(&LAVAPIPE);
    }

    #[test]
    fn device_that_cannot_present_points_to_render() {
        let Some(display) = Display::start() else { return };
        let place = tempfile::tempdir().expect("a folder");
        let none = place.path().join("none.json");
        let output = emboss(place.path())
            .args(["view", "--backend=vulkan"])
            .env("DISPLAY", &display.name)
            .env("VK_DRIVER_FILES", &none)
            .env("VK_ICD_FILENAMES", &none)
            .output()
            .expect("the program starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{stderr}");
        assert!(stderr.contains("`emboss render`") && stderr.contains("--backend cpu"), "{stderr}");
    }
}

//! A display of its own, and a viewer in it.

use image::RgbaImage;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use std::time::Duration;
use tempfile::TempDir;

/// Whoever measures times has the machine to itself, as far as these tests go; the others share it.
static MACHINE: RwLock<()> = RwLock::new(());

pub(crate) enum Machine {
    Shared { _guard: RwLockReadGuard<'static, ()> },
    Alone { _guard: RwLockWriteGuard<'static, ()> },
}

/// A display, with a folder in which it keeps what is its own.
pub(crate) struct Display {
    /// What minimises windows, where there is one. It ends before the server.
    pub(crate) manager: Option<Child>,
    pub(crate) server: Child,
    pub(crate) _machine: Machine,
    /// How programs find it.
    pub(crate) environment: Vec<(&'static str, OsString)>,
    pub(crate) folder: TempDir,
}

impl Drop for Display {
    fn drop(&mut self) {
        for child in self.manager.iter_mut().chain([&mut self.server]) {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// The server that a command starts, or nothing on a machine without it that is not CI.
pub(crate) fn started(command: &mut Command) -> Option<Child> {
    match command.stderr(Stdio::null()).spawn() {
        Ok(server) => Some(server),
        Err(error) => {
            let missing =
                format!("{command:?} is missing ({error}); `cargo xtask test packages` installs it");
            assert!(std::env::var_os("CI").is_none(), "{missing}");
            let _ = writeln!(std::io::stderr(), "NOT TESTED: {missing}");
            None
        }
    }
}

impl Machine {
    pub(crate) fn shared() -> Machine {
        Machine::Shared { _guard: MACHINE.read().unwrap_or_else(PoisonError::into_inner) }
    }
}

impl Display {
    /// One of X11, in memory.
    pub(crate) fn start() -> Option<Display> {
        Self::x11(Machine::shared())
    }

    /// The same, while no other test has a display.
    pub(crate) fn alone() -> Option<Display> {
        let guard = MACHINE.write().unwrap_or_else(PoisonError::into_inner);
        Self::x11(Machine::Alone { _guard: guard })
    }

    /// One with a manager of windows.
    pub(crate) fn managed() -> Option<Display> {
        let mut display = Self::start()?;
        let mut openbox = Command::new("openbox");
        openbox.envs(display.environment.clone()).stdout(Stdio::null());
        display.manager = Some(started(&mut openbox)?);
        Some(display)
    }

    fn x11(machine: Machine) -> Option<Display> {
        let folder = tempfile::tempdir().expect("a folder");
        let mut xvfb = Command::new("Xvfb");
        xvfb.args(["-displayfd", "1", "-screen", "0", "640x480x24", "-nolisten", "tcp", "-fbdir"]);
        let mut server = started(xvfb.arg(folder.path()).stdout(Stdio::piped()))?;
        let mut number = String::new();
        let told = server.stdout.take().expect("piped");
        BufReader::new(told).read_line(&mut number).expect("Xvfb tells its number");
        let environment = vec![("DISPLAY", format!(":{}", number.trim()).into())];
        Some(Display { manager: None, server, _machine: machine, environment, folder })
    }

    /// What its screen shows: `0x00RRGGBB`, by column and row. The file is an X window dump: a header of words with
    /// their highest byte first, a table of colours, and texels.
    pub(crate) fn screen(&self) -> impl Fn(usize, usize) -> u32 {
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

    pub(crate) fn xdotool(&self, arguments: &[&str]) -> String {
        let output = Command::new("xdotool").args(arguments).envs(self.environment.clone()).output();
        let output = output.expect("xdotool, which `cargo xtask test packages` installs");
        assert!(output.status.success(), "xdotool {arguments:?}: {output:?}");
        String::from_utf8_lossy(&output.stdout).trim().to_owned()
    }
}

/// A viewer that runs.
pub(crate) struct Viewer {
    program: Child,
    said: BufReader<ChildStdout>,
    place: TempDir,
}

/// How it ended.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) code: Option<i32>,
    pub(crate) stderr: String,
}

pub(crate) fn emboss(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_emboss"));
    // Displays are the tests' own.
    command
        .current_dir(folder)
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET");
    command
}

impl Viewer {
    /// `emboss view` in an empty folder, following a script.
    pub(crate) fn start(display: &Display, arguments: &[&str], script: &str) -> Viewer {
        Viewer::start_in(tempfile::tempdir().expect("a folder"), display, arguments, script)
    }

    pub(crate) fn start_in(place: TempDir, display: &Display, arguments: &[&str], script: &str) -> Viewer {
        std::fs::write(place.path().join("script"), script).expect("writable");
        let mut command = emboss(place.path());
        command.arg("view").args(arguments).args(["--script=script", "--output=a.png"]);
        command.envs(display.environment.clone()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut program = command.spawn().expect("the program starts");
        let said = BufReader::new(program.stdout.take().expect("piped"));
        Viewer { program, said, place }
    }

    /// The next line that it says.
    pub(crate) fn line(&mut self) -> String {
        let mut line = String::new();
        self.said.read_line(&mut line).expect("text");
        if line.is_empty() {
            let mut stderr = String::new();
            self.program.stderr.take().expect("piped").read_to_string(&mut stderr).expect("text");
            panic!("the viewer ended: {stderr}");
        }
        line.trim_end().to_owned()
    }

    /// The window, which has the keyboard from now on.
    pub(crate) fn focus(&self, display: &Display) -> String {
        let window = display.xdotool(&["search", "--name", "emboss"]);
        display.xdotool(&["windowfocus", "--sync", &window]);
        window
    }

    /// Waits until the script says `word`; returns the number of samples that are seen then.
    pub(crate) fn hears(&mut self, word: &str) -> u32 {
        let line = self.line();
        let samples = line.strip_prefix(word).unwrap_or_else(|| panic!("`{line}` is not {word}"));
        samples.trim().parse().expect("a number of samples")
    }

    /// Seconds of all processors that it has used.
    pub(crate) fn processor_time(&self) -> f64 {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.program.id())).expect("it runs");
        // After the program's name in parentheses; those in user mode and in the kernel's, in hundredths on Linux.
        let fields = stat.rsplit(')').next().expect("fields").split_whitespace();
        let ticks = fields.skip(11).take(2).map(|ticks| ticks.parse::<f64>().expect("a number"));
        ticks.sum::<f64>() / 100.0
    }

    /// The share of a processor that it uses for some time.
    pub(crate) fn load(&self, time: Duration) -> f64 {
        let before = self.processor_time();
        std::thread::sleep(time);
        (self.processor_time() - before) / time.as_secs_f64()
    }

    /// Bytes of memory that it holds.
    pub(crate) fn memory(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.program.id())).expect("it runs");
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("its memory");
        line.trim().trim_end_matches("kB").trim().parse::<u64>().expect("a number") * 1024
    }

    pub(crate) fn folder(&self) -> &Path {
        self.place.path()
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.place.path().join(name)
    }

    pub(crate) fn end(mut self) -> (Ended, TempDir) {
        let mut stderr = String::new();
        self.program.stderr.take().expect("piped").read_to_string(&mut stderr).expect("text");
        let code = self.program.wait().expect("it ends").code();
        (Ended { code, stderr }, self.place)
    }

    /// Waits for its end, which has to be a good one. Returns its folder.
    pub(crate) fn ends_well(self) -> TempDir {
        let (ended, place) = self.end();
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        // Neither the validation layers nor anything else has to complain.
        let complaints = ["WARN", "ERROR", "error", "alidation", "VUID", "panicked"];
        let complains = complaints.iter().any(|word| ended.stderr.contains(word));
        assert!(!complains, "{}", ended.stderr);
        place
    }
}

/// Whether a picture stands in the screen's upper left corner.
pub(crate) fn shows(screen: &impl Fn(usize, usize) -> u32, picture: &RgbaImage) -> bool {
    picture.enumerate_pixels().all(|(x, y, texel)| {
        let [r, g, b, _] = texel.0.map(u32::from);
        screen(x as usize, y as usize) == r << 16 | g << 8 | b
    })
}

/// The command line in a PNG.
pub(crate) fn command_in(path: &Path) -> String {
    let file = BufReader::new(std::fs::File::open(path).expect("a picture"));
    let reader = png::Decoder::new(file).read_info().expect("a PNG");
    let chunk = reader.info().utf8_text.iter().find(|chunk| chunk.keyword == "Command").expect("a command");
    chunk.get_text().expect("text")
}

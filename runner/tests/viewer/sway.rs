//! A display of Wayland: sway, with screens in memory.

use crate::harness::{Display, Machine, started};
use std::fs::{metadata, write};
use std::os::unix::fs::{MetadataExt, chown};
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Windows are as large as they ask for, and nothing is drawn round them.
const CONFIG: &str = "xwayland disable\nfocus_follows_mouse no\n\
    for_window [title=\".*\"] floating enable, border none\n";
/// Sway does not run as root.
const NOBODY: u32 = 65534;
/// The window, as sway is told.
const WINDOW: &str = "[title=\"emboss\"]";

impl Display {
    /// One of Wayland. Its first screen is called `HEADLESS-1`.
    pub(crate) fn sway() -> Option<Display> {
        let machine = Machine::shared();
        let folder = tempfile::tempdir().expect("a folder");
        let (config, control) = (folder.path().join("config"), folder.path().join("control"));
        write(&config, CONFIG).expect("writable");
        let mut sway = Command::new("sway");
        sway.arg("-c").arg(&config).stdout(Stdio::null());
        sway.env("XDG_RUNTIME_DIR", folder.path()).env("SWAYSOCK", &control);
        sway.envs([
            ("WLR_BACKENDS", "headless"),
            ("WLR_RENDERER", "pixman"),
            ("WLR_LIBINPUT_NO_DEVICES", "1"),
        ]);
        if metadata(folder.path()).expect("a folder").uid() == 0 {
            chown(folder.path(), Some(NOBODY), Some(NOBODY)).expect("root may");
            sway.uid(NOBODY).gid(NOBODY);
        }
        let server = started(&mut sway)?;
        let environment = vec![
            ("WAYLAND_DISPLAY", "wayland-1".into()),
            ("XDG_RUNTIME_DIR", folder.path().into()),
            ("SWAYSOCK", control.into_os_string()),
        ];
        let display = Display { manager: None, server, _machine: machine, environment, folder };
        let start = Instant::now();
        while !display.try_swaymsg(&["-t", "get_outputs"]).contains("HEADLESS-1") {
            assert!(start.elapsed() < Duration::from_secs(30), "sway has no screen");
            std::thread::sleep(Duration::from_millis(20));
        }
        Some(display)
    }

    /// What sway answers; nothing where it does not.
    fn try_swaymsg(&self, arguments: &[&str]) -> String {
        let output = Command::new("swaymsg").args(arguments).envs(self.environment.clone()).output();
        let output = output.expect("swaymsg, which comes with sway");
        if output.status.success() {
            String::from_utf8_lossy(&output.stdout).into_owned()
        } else {
            String::new()
        }
    }

    /// Has sway do something.
    pub(crate) fn sway_does(&self, command: &str) {
        assert!(!self.try_swaymsg(&["--", command]).is_empty(), "sway does not {command}");
    }

    /// Has sway do something with the window.
    pub(crate) fn sway_moves_window(&self, command: &str) {
        self.sway_does(&format!("{WINDOW} {command}"));
    }

    /// Has the window in its screen's corner.
    pub(crate) fn sway_puts_window_into_corner(&self) {
        self.sway_moves_window("move position 0 0");
    }

    /// What one of its screens shows: `0x00RRGGBB`, by column and row.
    pub(crate) fn sway_screen(&self, screen: &str) -> impl Fn(usize, usize) -> u32 {
        let output = Command::new("grim").args(["-o", screen, "-"]).envs(self.environment.clone()).output();
        let output = output.expect("grim, which `cargo xtask test packages` installs");
        assert!(output.status.success(), "{output:?}");
        let shown = image::load_from_memory(&output.stdout).expect("a PNG").to_rgb8();
        let width = shown.width() as usize;
        move |x, y| {
            let [r, g, b] = [0, 1, 2].map(|channel| u32::from(shown.as_raw()[3 * (y * width + x) + channel]));
            r << 16 | g << 8 | b
        }
    }
}

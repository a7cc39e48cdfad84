//! Watches the files of a scene, so that what is painted or modelled elsewhere is seen here.

use notify::event::ModifyKind;
use notify::{Event, EventKind, RecommendedWatcher, RecursiveMode, Watcher as _};
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

/// How long files have to be left alone before they are read: programs write large ones in pieces.
const QUIET: Duration = Duration::from_millis(250);
/// How long is waited for that at most. What is written all the time may be read in the middle of it.
const PATIENCE: Duration = Duration::from_secs(3);
/// How many links are followed from one to the next; more are taken for a circle.
const MOST_LINKS: usize = 40;

/// Calls back when watched files have changed.
pub(super) struct Watcher {
    orders: Sender<Heard>,
}

/// What the thread hears.
enum Heard {
    Event(notify::Result<Event>),
    /// These files from now on; told when that is so.
    Watch(Vec<PathBuf>, Sender<()>),
    End,
}

impl Watcher {
    /// Watches nothing as yet. `changed` is called on another thread. It tells of the file where what it reads is
    /// wrong: that is watched too, since it may be a new one.
    pub(super) fn new(changed: impl FnMut() -> Option<PathBuf> + Send + 'static) -> notify::Result<Watcher> {
        let (orders, heard) = channel();
        let events = orders.clone();
        let watcher = notify::recommended_watcher(move |event| {
            // Nobody listens any more when the viewer ends.
            let _ = events.send(Heard::Event(event));
        })?;
        let watched = Watched { watcher, folders: BTreeSet::new(), files: BTreeSet::new() };
        std::thread::spawn(move || listen(&heard, watched, changed));
        Ok(Watcher { orders })
    }

    /// Watches these files, and libraries of materials beside them. What is returned hears when that has begun.
    pub(super) fn watch(&self, files: &[PathBuf]) -> Receiver<()> {
        let (begun, told) = channel();
        // The thread ends only when the watcher does.
        let _ = self.orders.send(Heard::Watch(files.to_vec(), begun));
        told
    }
}

impl Drop for Watcher {
    fn drop(&mut self) {
        let _ = self.orders.send(Heard::End);
    }
}

/// What is watched.
struct Watched {
    watcher: RecommendedWatcher,
    /// Programs often write a new file and give it the old one's name, which a watch of the file itself would not see.
    folders: BTreeSet<PathBuf>,
    files: BTreeSet<PathBuf>,
}

impl Watched {
    fn set(&mut self, files: &[PathBuf]) {
        self.files = files.iter().flat_map(|file| names(file)).collect();
        let folders: BTreeSet<_> =
            self.files.iter().filter_map(|file| file.parent()).map(Path::to_owned).collect();
        for folder in self.folders.difference(&folders) {
            // It may be gone, and with it the watch.
            let _ = self.watcher.unwatch(folder);
        }
        self.folders.retain(|folder| folders.contains(folder));
        for folder in folders {
            self.watch(folder);
        }
    }

    fn watch(&mut self, folder: PathBuf) {
        if self.folders.contains(&folder) {
            return;
        }
        match self.watcher.watch(&folder, RecursiveMode::NonRecursive) {
            Ok(()) => drop(self.folders.insert(folder)),
            Err(error) => {
                tracing::warn!("{}: changes of files there will not be seen ({error})", folder.display());
            }
        }
    }

    fn add(&mut self, file: &Path) {
        for name in names(file) {
            if let Some(folder) = name.parent() {
                self.watch(folder.to_owned());
            }
            self.files.insert(name);
        }
    }

    /// Whether an event is a change of one of the files, or of a library of materials.
    fn concerns(&self, event: &Event) -> bool {
        let is_library = |path: &Path| path.extension() == Some(OsStr::new("mtl"));
        let is_change = match event.kind {
            // Who may read it, and when it was read.
            EventKind::Modify(ModifyKind::Metadata(_)) => false,
            kind => matches!(kind, EventKind::Any | EventKind::Create(_) | EventKind::Modify(_)),
        };
        is_change && event.paths.iter().any(|path| self.files.contains(path) || is_library(path))
    }
}

/// A file as it is named, each link on the way from there, and the file itself.
fn names(file: &Path) -> Vec<PathBuf> {
    let mut name = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let mut names: Vec<_> = std::fs::canonicalize(&name).into_iter().collect();
    for _ in 0..MOST_LINKS {
        let next = std::fs::read_link(&name).ok();
        let next = next.and_then(|link| name.parent().map(|folder| folder.join(link)));
        names.push(name);
        match next {
            Some(next) => name = next,
            None => break,
        }
    }
    names
}

/// Waits for changes until it is told to end.
fn listen(heard: &Receiver<Heard>, mut watched: Watched, mut changed: impl FnMut() -> Option<PathBuf>) {
    // Of what was not read yet: when it changed first, and last.
    let mut change: Option<(Instant, Instant)> = None;
    loop {
        let due = change.map(|(first, last)| (last + QUIET).min(first + PATIENCE));
        let next = match due {
            Some(due) => heard.recv_timeout(due.saturating_duration_since(Instant::now())),
            None => heard.recv().map_err(|_| RecvTimeoutError::Disconnected),
        };
        match next {
            Ok(Heard::Event(Ok(event))) if watched.concerns(&event) => {
                let now = Instant::now();
                change = Some((change.map_or(now, |(first, _)| first), now));
            }
            Ok(Heard::Event(Err(error))) => tracing::debug!("watching files: {error}"),
            Ok(Heard::Event(Ok(_))) => {}
            Ok(Heard::Watch(files, begun)) => {
                watched.set(&files);
                // It may be that nobody wants to know.
                let _ = begun.send(());
            }
            Ok(Heard::End) | Err(RecvTimeoutError::Disconnected) => return,
            Err(RecvTimeoutError::Timeout) => {}
        }
        if due.is_some_and(|due| due <= Instant::now()) {
            change = None;
            if let Some(file) = changed() {
                watched.add(&file);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;
    use tempfile::TempDir;

    /// Long enough for a busy machine; only a failure takes it.
    const LONG: Duration = Duration::from_secs(20);

    /// A folder, and a watcher that tells of changes, each time of a wrong file.
    fn watcher(wrong: Option<&str>) -> (TempDir, Watcher, mpsc::Receiver<()>) {
        let folder = tempfile::tempdir().expect("a folder");
        let wrong = wrong.map(|name| folder.path().join(name));
        let (sender, receiver) = mpsc::channel();
        let changed = move || {
            sender.send(()).expect("heard");
            wrong.clone()
        };
        (folder, Watcher::new(changed).expect("a watcher"), receiver)
    }

    fn write(file: &Path, text: &str) {
        std::fs::write(file, text).expect("writable");
    }

    #[test]
    fn changes_are_heard_once_and_those_of_other_files_are_not() {
        let (folder, watcher, receiver) = watcher(None);
        let file = |name: &str| folder.path().join(name);
        write(&file("a.png"), "old");
        watcher.watch(&[file("a.png")]).recv().expect("it begins");
        write(&file("b.png"), "new");
        assert!(receiver.recv_timeout(2 * QUIET).is_err());
        // In two pieces, then by another file that takes its name.
        write(&file("a.png"), "half");
        write(&file("a.png"), "whole");
        receiver.recv_timeout(LONG).expect("a change");
        assert!(receiver.recv_timeout(2 * QUIET).is_err(), "both at once");
        std::fs::rename(file("b.png"), file("a.png")).expect("renamed");
        receiver.recv_timeout(LONG).expect("a change");
        write(&file("x.mtl"), "newmtl");
        receiver.recv_timeout(LONG).expect("a library");
    }

    /// What else is written there all the time delays nothing, nor does what is never done being written for long.
    #[test]
    fn busy_folder_is_heard_of() {
        let (folder, watcher, receiver) = watcher(None);
        let file = |name: &str| folder.path().join(name);
        write(&file("a.png"), "old");
        watcher.watch(&[file("a.png")]).recv().expect("it begins");
        for busy in ["b.png", "a.png"] {
            write(&file("a.png"), "new");
            let start = Instant::now();
            while receiver.try_recv().is_err() {
                assert!(start.elapsed() < LONG, "{busy}");
                write(&file(busy), "more");
                std::thread::sleep(QUIET / 10);
            }
            let _ = receiver.recv_timeout(2 * QUIET);
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed() {
        let (folder, watcher, receiver) = watcher(None);
        let elsewhere = tempfile::tempdir().expect("a folder");
        let (file, link) = (elsewhere.path().join("a.png"), folder.path().join("a.png"));
        write(&file, "old");
        std::os::unix::fs::symlink(&file, &link).expect("a link");
        watcher.watch(&[link]).recv().expect("it begins");
        write(&file, "new");
        receiver.recv_timeout(LONG).expect("a change of what the link leads to");
    }

    /// A model that names a map which is not there yet.
    #[test]
    fn what_was_wrong_is_watched() {
        let (folder, watcher, receiver) = watcher(Some("maps/new.png"));
        let file = |name: &str| folder.path().join(name);
        std::fs::create_dir(file("maps")).expect("a folder");
        write(&file("a.obj"), "old");
        watcher.watch(&[file("a.obj")]).recv().expect("it begins");
        write(&file("a.obj"), "new");
        receiver.recv_timeout(LONG).expect("a change");
        // The thread has to have heard of the file.
        std::thread::sleep(QUIET);
        write(&file("maps/new.png"), "whole");
        receiver.recv_timeout(LONG).expect("a change of the file that was wrong");
    }
}

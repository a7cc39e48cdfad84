//! Watches the files of a scene, so that what is painted or modelled elsewhere is seen here.

use notify::{Event, EventKind, RecommendedWatcher, RecursiveMode, Watcher as _};
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// How long files have to be left alone before they are read: programs write large ones in pieces.
const QUIET: Duration = Duration::from_millis(250);

/// Calls back when watched files have changed.
pub(super) struct Watcher {
    watcher: RecommendedWatcher,
    /// Which folders are watched: programs often write a new file and give it the old one's name, which a watch of the file
    /// itself would not see.
    folders: BTreeSet<PathBuf>,
    files: Sender<BTreeSet<PathBuf>>,
}

/// What the thread that waits hears.
type Heard = Result<Event, notify::Error>;

impl Watcher {
    /// Watches nothing as yet. `changed` is called from another thread.
    pub(super) fn new(changed: impl Fn() + Send + 'static) -> notify::Result<Watcher> {
        let (events, heard) = channel::<Heard>();
        let (files, new_files) = channel();
        let watcher = notify::recommended_watcher(move |event| {
            // The other end is there for as long as there are events.
            let _ = events.send(event);
        })?;
        std::thread::spawn(move || listen(&heard, &new_files, &changed));
        Ok(Watcher { watcher, folders: BTreeSet::new(), files })
    }

    /// Watches these files from now on, and libraries of materials beside them.
    pub(super) fn watch(&mut self, files: &[PathBuf]) {
        let files: BTreeSet<_> = files.iter().map(|file| absolute(file)).collect();
        let folders: BTreeSet<_> =
            files.iter().filter_map(|file| file.parent()).map(Path::to_owned).collect();
        for folder in folders.difference(&self.folders) {
            if let Err(error) = self.watcher.watch(folder, RecursiveMode::NonRecursive) {
                tracing::warn!("{}: changes of files there will not be seen ({error})", folder.display());
            }
        }
        for folder in self.folders.difference(&folders) {
            // It may be gone, and with it the watch.
            let _ = self.watcher.unwatch(folder);
        }
        self.folders = folders;
        // The thread ends only when the watcher does.
        let _ = self.files.send(files);
    }
}

fn absolute(file: &Path) -> PathBuf {
    std::path::absolute(file).unwrap_or_else(|_| file.to_owned())
}

/// Waits for changes until the watcher is dropped.
fn listen(heard: &Receiver<Heard>, new_files: &Receiver<BTreeSet<PathBuf>>, changed: &impl Fn()) {
    let mut files = BTreeSet::new();
    let mut is_changed = false;
    loop {
        let event = if is_changed {
            heard.recv_timeout(QUIET)
        } else {
            heard.recv().map_err(|_| RecvTimeoutError::Disconnected)
        };
        if let Some(newest) = new_files.try_iter().last() {
            files = newest;
        }
        match event {
            Ok(Ok(event)) => is_changed |= concerns(&event, &files),
            Ok(Err(error)) => tracing::debug!("watching files: {error}"),
            Err(RecvTimeoutError::Timeout) => {
                is_changed = false;
                changed();
            }
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

/// Whether an event is a change of one of the files, or of a library of materials.
fn concerns(event: &Event, files: &BTreeSet<PathBuf>) -> bool {
    let is_library = |path: &Path| path.extension() == Some(OsStr::new("mtl"));
    let is_change = matches!(event.kind, EventKind::Any | EventKind::Create(_) | EventKind::Modify(_));
    is_change && event.paths.iter().any(|path| files.contains(path) || is_library(path))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    /// Long enough for a busy machine; only a failure takes it.
    const PATIENCE: Duration = Duration::from_secs(20);

    #[test]
    fn changes_are_heard_once_and_those_of_other_files_are_not() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = |name: &str| folder.path().join(name);
        std::fs::write(file("a.png"), "old").expect("writable");
        let (sender, receiver) = mpsc::channel();
        let mut watcher = Watcher::new(move || sender.send(()).expect("heard")).expect("a watcher");
        watcher.watch(&[file("a.png")]);
        std::fs::write(file("b.png"), "new").expect("writable");
        assert!(receiver.recv_timeout(2 * QUIET).is_err());
        // In two pieces, then by another file that takes its name.
        std::fs::write(file("a.png"), "half").expect("writable");
        std::fs::write(file("a.png"), "whole").expect("writable");
        receiver.recv_timeout(PATIENCE).expect("a change");
        assert!(receiver.recv_timeout(2 * QUIET).is_err(), "both at once");
        std::fs::rename(file("b.png"), file("a.png")).expect("renamed");
        receiver.recv_timeout(PATIENCE).expect("a change");
        std::fs::write(file("x.mtl"), "newmtl").expect("writable");
        receiver.recv_timeout(PATIENCE).expect("a library");
    }
}

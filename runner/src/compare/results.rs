//! What was measured, and the folder that keeps it: `results.json` after each measurement, so that a comparison that
//! was broken off goes on from there, and `results.csv` for other programs.

use super::Times;
use super::metrics::{Errors, median};
use super::reference::Summary;
use super::subject::{Code, Configuration, Memory};
use crate::whole_file;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::io;
use std::path::{Path, PathBuf};

/// What has to be the same for measurements to stand side by side.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// The program's version.
    pub version: String,
    /// The command line, without the folder and the time.
    pub command: String,
    /// `vulkan` or `cpu`.
    pub backend: String,
    /// The device's name.
    pub device: String,
    /// Its driver and API version, or the number of threads.
    pub details: String,
    /// The hash of the kernels' sources.
    pub kernels: String,
    /// The files of the scene.
    pub files: Vec<FileStamp>,
}

/// A file as it was.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileStamp {
    /// Where it is.
    pub path: PathBuf,
    /// The SHA-256 of its bytes in hexadecimal digits; `None` where it cannot be read.
    pub sha256: Option<String>,
}

impl FileStamp {
    /// A file as it is now.
    pub fn of(path: &Path) -> FileStamp {
        let digits =
            |bytes: Vec<u8>| Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        FileStamp { path: path.to_owned(), sha256: std::fs::read(path).ok().map(digits) }
    }
}

/// All that is known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// What it is about.
    pub identity: Identity,
    /// Whether the time is over and each configuration has its round.
    pub complete: bool,
    /// Pixels of a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples of a pixel.
    pub samples: u32,
    /// Seconds that were spent.
    pub seconds: f64,
    /// What everything is compared with.
    pub reference: Option<Summary>,
    /// What was measured, in the order in which it was asked for.
    pub configurations: Vec<Measurement>,
    /// What was left out.
    pub skipped: Vec<Skipped>,
}

/// A configuration that was left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Skipped {
    /// Which.
    #[serde(flatten)]
    pub configuration: Configuration,
    /// Why.
    pub reason: String,
}

/// The errors of a view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewErrors {
    /// `own` or `grazing`.
    pub view: String,
    /// By how much it differs from the reference.
    #[serde(flatten)]
    pub errors: Errors,
}

/// What is known of a configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// Which it is.
    #[serde(flatten)]
    pub configuration: Configuration,
    /// Median time of a frame of the user's camera, in milliseconds.
    pub frame_ms: f64,
    /// Primary and shadow rays a second.
    pub rays_per_second: f64,
    /// Median time from the scene to what rays can be traced in.
    pub preparation_ms: f64,
    /// Median time from other heights to the first frame.
    pub edit_ms: f64,
    /// Bytes.
    pub memory: Memory,
    /// The code of the pipeline that makes pictures; `None` on the CPU backend, where the code for all is in the
    /// program.
    pub pipeline: Option<Code>,
    /// The errors of each view.
    pub views: Vec<ViewErrors>,
    /// Change from picture to picture that the reference does not have: mean ꟻLIP.
    pub flicker: f64,
    /// Rays of a frame.
    pub rays: u64,
    /// Every time that was taken.
    pub rounds: Rounds,
}

/// Times in milliseconds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rounds {
    /// Of frames: several a round.
    pub frame_ms: Vec<f64>,
    /// Of preparations.
    pub preparation_ms: Vec<f64>,
    /// Of edits.
    pub edit_ms: Vec<f64>,
}

impl Measurement {
    /// Without times as yet.
    pub(super) fn new(
        configuration: Configuration,
        views: Vec<ViewErrors>,
        flicker: f64,
        memory: Memory,
        pipeline: Option<Code>,
        rays: u64,
    ) -> Measurement {
        let (frame_ms, rays_per_second, preparation_ms, edit_ms) = (0.0, 0.0, 0.0, 0.0);
        let rounds = Rounds::default();
        Measurement {
            configuration,
            frame_ms,
            rays_per_second,
            preparation_ms,
            edit_ms,
            memory,
            pipeline,
            views,
            flicker,
            rays,
            rounds,
        }
    }

    /// Adds a round.
    pub(super) fn add(&mut self, times: Times) {
        let rounds = &mut self.rounds;
        rounds.frame_ms.extend(times.frames);
        rounds.preparation_ms.push(times.preparation);
        rounds.edit_ms.push(times.edit);
        self.frame_ms = median(&rounds.frame_ms);
        self.preparation_ms = median(&rounds.preparation_ms);
        self.edit_ms = median(&rounds.edit_ms);
        self.rays_per_second = if self.frame_ms > 0.0 { self.rays as f64 / self.frame_ms * 1e3 } else { 0.0 };
    }

    /// The errors of the user's camera.
    pub fn own(&self) -> Errors {
        self.views.first().map(|view| view.errors).unwrap_or_default()
    }
}

impl Results {
    /// Of nothing as yet.
    pub fn new(identity: Identity, width: u32, height: u32, samples: u32) -> Results {
        Results {
            identity,
            complete: false,
            width,
            height,
            samples,
            seconds: 0.0,
            reference: None,
            configurations: Vec::new(),
            skipped: Vec::new(),
        }
    }

    /// Those that a folder keeps.
    pub fn read(folder: &Path) -> Result<Results, ResultsError> {
        let path = folder.join(JSON);
        let read = || Ok(serde_json::from_str(&std::fs::read_to_string(&path)?)?);
        read().map_err(|reason| ResultsError::Unreadable { path: path.clone(), reason })
    }

    /// Whether a configuration was measured or left out.
    pub fn knows(&self, configuration: Configuration) -> bool {
        self.configurations.iter().any(|measured| measured.configuration == configuration)
            || self.skipped.iter().any(|skipped| skipped.configuration == configuration)
    }
}

/// Why results could not be kept. Messages name the file and what helps.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ResultsError {
    /// The folder is not there and cannot be made, or takes no files.
    #[error("{}: cannot write into this folder ({reason}); choose another --output", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        reason: io::Error,
    },
    /// A file could not be written.
    #[error("{}: the results could not be written ({reason}); make room or choose another --output, and run the \
        command again: what is measured is kept", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        reason: io::Error,
    },
    /// There are results that this program did not write, or that are damaged.
    #[error("{}: this file has no results of this version ({reason}); choose another folder, or delete the \
        file", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: io::Error,
    },
    /// There are results of another comparison.
    #[error(
        "{} has the results of another comparison: {what} was `{there}` and is `{here}`; choose another --output, or \
            delete that folder",
        path.display()
    )]
    Other {
        /// The folder.
        path: PathBuf,
        /// What differs.
        what: &'static str,
        /// What it was.
        there: String,
        /// What it is.
        here: String,
    },
}

/// The folder, and what is in it.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    /// What is known.
    pub results: Results,
    /// Whether there were results before.
    pub resumed: bool,
}

/// The results' file.
pub const JSON: &str = "results.json";
/// The folder of pictures.
const PICTURES: &str = "pictures";

impl Store {
    /// Finds out whether a folder takes files, and makes it where it is not there.
    pub fn check(folder: &Path) -> Result<(), ResultsError> {
        let failed = |reason| ResultsError::Folder { path: folder.to_owned(), reason };
        std::fs::create_dir_all(folder.join(PICTURES)).map_err(failed)?;
        tempfile::tempfile_in(folder).map_err(failed).map(drop)
    }

    /// Opens a folder that takes files. What it has of the same comparison goes on, of another one is refused.
    pub fn open(folder: &Path, new: Results) -> Result<Store, ResultsError> {
        let (old, folder) = (Results::read(folder), folder.to_owned());
        let old = match old {
            Err(ResultsError::Unreadable { reason, .. }) if reason.kind() == io::ErrorKind::NotFound => {
                return Ok(Store { folder, results: new, resumed: false });
            }
            old => old?,
        };
        let other = |what, there: &str, here: &str| ResultsError::Other {
            path: folder.clone(),
            what,
            there: there.to_owned(),
            here: here.to_owned(),
        };
        let (there, here) = (&old.identity, &new.identity);
        if there.version != here.version {
            Err(other("the version", &there.version, &here.version))
        } else if there.command != here.command {
            Err(other("the command", &there.command, &here.command))
        } else if (&there.backend, &there.device) != (&here.backend, &here.device) {
            Err(other("the device", &there.device, &here.device))
        } else if there.details != here.details {
            Err(other("the device's driver, or the number of threads,", &there.details, &here.details))
        } else if there.kernels != here.kernels {
            Err(other("the kernels' sources", &there.kernels, &here.kernels))
        } else if there.files != here.files {
            Err(other("a file of the scene", &stamps(&there.files), &stamps(&here.files)))
        } else {
            Ok(Store { folder, results: Results { complete: false, ..old }, resumed: true })
        }
    }

    /// The file of a picture.
    pub fn picture(&self, name: &str) -> PathBuf {
        self.folder.join(PICTURES).join(format!("{name}.png"))
    }

    /// Keeps the results.
    pub fn save(&self) -> Result<(), ResultsError> {
        let json = serde_json::to_string_pretty(&self.results);
        let json = json.map_err(|error| self.failed(JSON, error.into()))?;
        self.write(JSON, &(json + "\n"))?;
        self.write("results.csv", &self.results.csv())
    }

    /// Writes a file beside its place and renames it then: what is there is whole, whenever the program ends.
    pub fn write(&self, name: &str, text: &str) -> Result<(), ResultsError> {
        let written = whole_file::write(&self.folder.join(name), text.as_bytes());
        written.map_err(|error| self.failed(name, error))
    }

    fn failed(&self, name: &str, reason: io::Error) -> ResultsError {
        ResultsError::Write { path: self.folder.join(name), reason }
    }

    /// Where everything is.
    pub fn folder(&self) -> &Path {
        &self.folder
    }
}

/// Files in a message.
fn stamps(files: &[FileStamp]) -> String {
    let stamp = |file: &FileStamp| {
        // So many digits tell any two files apart.
        let hash = file.sha256.as_deref().map_or("gone", |digits| digits.get(..12).unwrap_or(digits));
        format!("{} ({hash})", file.path.display())
    };
    files.iter().map(stamp).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Method, Subdivisions};

    fn results(command: &str) -> Results {
        Results::new(Identity { command: command.to_owned(), ..Identity::default() }, 4, 3, 1)
    }

    fn measurement() -> Measurement {
        let n = Some(Subdivisions::Auto { pixels: 0.5 });
        let views =
            ["own", "grazing"].map(|view| ViewErrors { view: view.into(), errors: Errors::default() });
        let configuration = Configuration { method: Method::GridWalk, n };
        let code = Some(Code { instructions: 1234, bytes: 5678 });
        let mut measurement =
            Measurement::new(configuration, views.into(), 0.25, Memory::default(), code, 600);
        measurement.add(Times { frames: vec![4.0, 2.0, 3.0], preparation: 7.0, edit: 5.0 });
        measurement
    }

    #[test]
    fn medians_are_over_all_rounds() {
        let mut measured = measurement();
        assert_eq!((measured.frame_ms, measured.rays_per_second), (3.0, 2e5));
        measured.add(Times { frames: vec![1.0, 1.0], preparation: 8.0, edit: 1.0 });
        assert_eq!((measured.frame_ms, measured.preparation_ms, measured.edit_ms), (2.0, 7.0, 1.0));
    }

    #[test]
    fn what_is_kept_is_what_was_measured() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut store = Store::open(folder.path(), results("a")).expect("new");
        assert!(!store.resumed);
        store.results.configurations.push(measurement());
        let skipped = Configuration { method: Method::None, n: None };
        store.results.skipped.push(Skipped { configuration: skipped, reason: "no".into() });
        store.save().expect("writable");
        let again = Store::open(folder.path(), results("a")).expect("the same");
        assert!(again.resumed && again.results.knows(skipped));
        assert_eq!(again.results, store.results);
        let error = Store::open(folder.path(), results("b")).expect_err("another").to_string();
        assert!(error.contains("`a`") && error.contains("choose another --output"), "{error}");
    }

    /// Whoever may read what a user writes may read them.
    #[cfg(unix)]
    #[test]
    fn files_are_as_public_as_others() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("other"), "").expect("writable");
        let store = Store::open(folder.path(), results("a")).expect("new");
        store.save().expect("writable");
        let mode = |name: &str| {
            let found = std::fs::metadata(folder.path().join(name)).expect("written");
            found.permissions().mode()
        };
        for name in [JSON, "results.csv"] {
            assert_eq!(format!("{:o}", mode(name)), format!("{:o}", mode("other")), "{name}");
        }
    }

    /// Of everything that measurements depend on.
    #[test]
    fn what_was_measured_otherwise_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let scene = folder.path().join("scene.obj");
        std::fs::write(&scene, "v 0").expect("writable");
        let kept = || {
            let mut kept = results("a");
            kept.identity.files = vec![FileStamp::of(&scene)];
            kept
        };
        Store::open(folder.path(), kept()).expect("new").save().expect("writable");
        type Change = fn(&mut Identity);
        let changes: [(&str, Change); 6] = [
            ("the version", |identity| identity.version = "2".into()),
            ("the command", |identity| identity.command = "b".into()),
            ("the device", |identity| identity.device = "another".into()),
            ("driver", |identity| identity.details = "newer".into()),
            ("the kernels", |identity| identity.kernels = "newer".into()),
            ("a file", |identity| identity.files.clear()),
        ];
        for (told, change) in changes {
            let mut other = kept();
            change(&mut other.identity);
            let error = Store::open(folder.path(), other).expect_err(told).to_string();
            assert!(error.contains(told), "{error}");
        }
        // As long as before, and written within the same tick of the file system's clock.
        std::fs::write(&scene, "v 1").expect("writable");
        let error = Store::open(folder.path(), kept()).expect_err("another file").to_string();
        assert!(error.contains("a file of the scene was") && error.contains("scene.obj"), "{error}");
    }

    #[test]
    fn other_files_of_that_name_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join(JSON), "{}").expect("writable");
        let error = Store::open(folder.path(), results("a")).expect_err("no results").to_string();
        assert!(error.contains("results.json") && error.contains("delete the file"), "{error}");
    }

    #[test]
    fn rows_have_as_many_columns_as_the_heading() {
        let mut all = results("a");
        // The one on a device, the other on the CPU backend.
        all.configurations = vec![measurement(), Measurement { pipeline: None, ..measurement() }];
        let csv = all.csv();
        let counts: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
        assert_eq!(counts, [32; 3]);
        assert!(csv.lines().nth(1).is_some_and(|row| row.starts_with("grid-walk,auto:0.5,3,")), "{csv}");
        assert!(csv.contains("grazing_psnr_db") && csv.contains(",inf,"));
        assert!(csv.contains(",1234,5678,0.25,1,") && csv.contains(",0,,,0.25,1,"), "{csv}");
    }
}

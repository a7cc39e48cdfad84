//! How fast a BVH is built, phase by phase, and how good it is.

use crate::backend::vulkan::DeviceBvh;
use crate::backend::{BackendError, DeviceInfo};
use crate::bvh::{BuildTimes, Bvh, BvhError, Hlbvh, key_bits};
use emboss_kernels::aabb::Aabb;
use emboss_kernels::bvh::hlbvh::{MAX_TREELETS, TREELET_WORDS, has_single_treelets};
use emboss_kernels::bvh::node::{BOX_FLOATS, NODE_WORDS};
use emboss_kernels::bvh::radix_sort::{count_words, limbs, passes};
use emboss_kernels::bvh::small::MOST_SMALL;
use serde::Serialize;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// How long a size is built before anything is measured: a graphics card takes about a second of work until its clock
/// has risen, and what is measured before is up to several times too slow.
const WARM_UP: Duration = Duration::from_millis(1500);
/// Fewest builds that are measured, and how many refits: a median of five outlives two interruptions.
const LEAST_BUILDS: usize = 5;

/// What builds and refits one tree.
pub trait Subject {
    /// Builds it. Returns what the phases took.
    fn build(&mut self) -> Result<BuildTimes, BackendError>;

    /// Gives it the boxes that it has. Returns what that took, in milliseconds.
    fn refit(&mut self) -> Result<f64, BackendError>;

    /// The tree.
    fn tree(&mut self) -> Result<Bvh, BackendError>;
}

/// A tree built by the processor, timed by its clock. A build's time is that of its kernels, without the memory for
/// what they leave; a refit's has the copying of the boxes.
pub struct HostSubject<'a> {
    boxes: &'a [Aabb],
    bvh: Hlbvh,
}

impl<'a> HostSubject<'a> {
    /// The tree over `boxes`.
    pub fn new(boxes: &'a [Aabb]) -> HostSubject<'a> {
        HostSubject { boxes, bvh: Hlbvh::build(boxes) }
    }
}

impl Subject for HostSubject<'_> {
    fn build(&mut self) -> Result<BuildTimes, BackendError> {
        self.bvh = Hlbvh::build(self.boxes);
        Ok(self.bvh.times())
    }

    fn refit(&mut self) -> Result<f64, BackendError> {
        let start = Instant::now();
        self.bvh.refit(self.boxes);
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    fn tree(&mut self) -> Result<Bvh, BackendError> {
        Ok(self.bvh.tree())
    }
}

/// A tree built by a Vulkan device, timed by its own clock.
pub struct DeviceSubject<'a> {
    /// What it is over.
    pub boxes: &'a [Aabb],
    /// The tree.
    pub bvh: DeviceBvh<'a>,
}

impl Subject for DeviceSubject<'_> {
    fn build(&mut self) -> Result<BuildTimes, BackendError> {
        self.bvh.build()
    }

    fn refit(&mut self) -> Result<f64, BackendError> {
        self.bvh.refit(self.boxes)
    }

    fn tree(&mut self) -> Result<Bvh, BackendError> {
        self.bvh.read()
    }
}

/// What is known of a device when all sizes are through.
#[derive(Clone, Debug, Serialize)]
pub struct DeviceResults {
    /// `vulkan` or `cpu`.
    pub backend: &'static str,
    /// The device's name.
    pub device: String,
    /// Driver and API version, or the number of threads.
    pub details: String,
    /// One for each size that was measured.
    pub sizes: Vec<Measurement>,
}

impl DeviceResults {
    /// Of a device on which nothing was measured yet.
    pub fn new(device: &DeviceInfo) -> DeviceResults {
        let DeviceInfo { backend, name, details, .. } = device.clone();
        DeviceResults { backend, device: name, details, sizes: Vec::new() }
    }
}

/// What was measured of one size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Measurement {
    /// How many prisms the tree is over.
    pub primitives: u32,
    /// How many builds were measured.
    pub builds: usize,
    /// The phases of the build whose total is the median, in milliseconds.
    pub ms: Phases,
    /// The median of refits, in milliseconds.
    pub refit_ms: f64,
    /// [`BvhStats::sah_cost`](crate::bvh::BvhStats::sah_cost).
    pub sah_cost: f64,
    /// Edges on the longest path from the root to a leaf.
    pub depth: u32,
    /// What [`bytes_moved`] says, in bytes.
    pub bytes: Phases,
}

impl Measurement {
    /// Millions of primitives in a second.
    pub fn rate(&self) -> f64 {
        f64::from(self.primitives) / self.ms.total / 1e3
    }
}

/// A number for each phase of a build: see [`BuildTimes`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Phases {
    /// The box of centres and the codes.
    pub codes: f64,
    /// The radix sort.
    pub sort: f64,
    /// Splits, treelets and their numbers.
    pub treelets: f64,
    /// The tree over the treelets.
    pub top: f64,
    /// All of it.
    pub total: f64,
}

impl Phases {
    fn new(codes: f64, sort: f64, treelets: f64, top: f64) -> Phases {
        Phases { codes, sort, treelets, top, total: codes + sort + treelets + top }
    }

    /// Each number times `factor`.
    pub fn scaled(self, factor: f64) -> Phases {
        let Phases { codes, sort, treelets, top, .. } = self;
        Phases::new(codes * factor, sort * factor, treelets * factor, top * factor)
    }
}

impl From<BuildTimes> for Phases {
    fn from(BuildTimes { codes, sort, treelets, top }: BuildTimes) -> Phases {
        Phases::new(codes, sort, treelets, top)
    }
}

/// Why a size could not be measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// The build failed.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// The build gave a tree that is none.
    #[error(
        "the tree over {primitives} prisms is wrong: {source}; this is a defect of emboss or of the driver"
    )]
    Invalid {
        /// How many there are.
        primitives: u32,
        /// What is wrong.
        source: BvhError,
    },
}

impl BenchError {
    /// Whether the size is at fault, so that a smaller one can be measured.
    pub fn is_of_size(&self) -> bool {
        matches!(self, BenchError::Backend(BackendError::TooLarge { .. } | BackendError::Allocation { .. }))
    }
}

/// Measures builds over `boxes`, at least five and for `time`, after a warm-up, then refits, and looks at the
/// tree. Calls `progress` with the share done (0 to 1) between builds; `Break` ends it: with what is measured, or
/// `None` where that is nothing.
///
/// # Errors
/// What the subject fails with, [`BenchError::Invalid`] where it builds a tree that is not valid.
///
/// # Panics
/// Where there are more than 2^32 boxes.
pub fn measure(
    subject: &mut dyn Subject,
    boxes: &[Aabb],
    time: Duration,
    progress: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<Option<Measurement>, BenchError> {
    let share = |spent: Duration| (spent.as_secs_f64() / (WARM_UP + time).as_secs_f64()).min(1.0);
    let start = Instant::now();
    let mut flow = ControlFlow::Continue(());
    while flow.is_continue() && start.elapsed() < WARM_UP {
        subject.build()?;
        flow = progress(share(start.elapsed().min(WARM_UP)));
    }
    let start = Instant::now();
    let mut builds = Vec::new();
    while flow.is_continue() && (builds.len() < LEAST_BUILDS || start.elapsed() < time) {
        builds.push(subject.build()?);
        flow = progress(share(WARM_UP + start.elapsed()));
    }
    let Some(build) = median(&mut builds, |times| times.total()) else { return Ok(None) };
    let mut refits = vec![subject.refit()?];
    while flow.is_continue() && refits.len() < LEAST_BUILDS {
        refits.push(subject.refit()?);
        flow = progress(1.0);
    }
    let primitives = u32::try_from(boxes.len()).expect("primitives have 32-bit numbers");
    let stats =
        subject.tree()?.validate(boxes).map_err(|source| BenchError::Invalid { primitives, source })?;
    Ok(Some(Measurement {
        primitives,
        builds: builds.len(),
        ms: build.into(),
        refit_ms: median(&mut refits, |&ms| ms).unwrap_or(0.0),
        sah_cost: stats.sah_cost,
        depth: stats.depth,
        bytes: bytes_moved(primitives),
    }))
}

/// The item whose key is in the middle, of two the greater one.
fn median<T: Copy>(items: &mut [T], key: impl Fn(&T) -> f64) -> Option<T> {
    items.sort_by(|a, b| key(a).total_cmp(&key(b)));
    items.get(items.len() / 2).copied()
}

/// Bytes that a build over `count` primitives reads from memory and writes to it, at the least: each dispatch reads
/// each item that it needs once, and writes each that it changes. What stays in caches (a neighbour's key or split
/// level, the bins and tasks of the top, a sibling's box, as it was just written) counts once or not at all. So does
/// what there are thousands of, not millions: sums of scans.
///
/// Per primitive, with boxes of 24 bytes, nodes of 32, and keys of 4 or 8:
/// - codes: boxes are read twice, once for the box of centres; key and number are written;
/// - sort: each pass of eight bits reads one word of the key to count digits, then reads and writes key and number; for
///   four pairs there is a count, which is written, scanned (read twice and written), and read;
/// - treelets: arrivals are cleared; keys are read and split levels written; these become flags, whose
///   scan reads twice and writes; then number, treelet, levels and box are read, and the place in the order, two nodes,
///   the arrival (twice) and the parent written;
/// - top, per treelet: clearing, start, each level of a balanced tree reads its root, its task's number and writes
///   this; in the end it is read once more, and two nodes are written with a parent.
///
/// Where each primitive is a treelet nothing is sorted: codes write the treelets themselves.
pub fn bytes_moved(count: u32) -> Phases {
    const WORD: f64 = 4.0;
    let (bounds, node) = (WORD * f64::from(BOX_FLOATS), WORD * f64::from(NODE_WORDS));
    let treelet = WORD * f64::from(TREELET_WORDS);
    let bits = key_bits(count);
    let key = WORD * f64::from(limbs(bits));
    let treelets = f64::from(count.min(MAX_TREELETS));
    let levels = (treelets / f64::from(MOST_SMALL)).max(1.0).log2().ceil();
    // Two words for a treelet's task: read, and written.
    let top = treelets * (treelet + (1.0 + levels) * (treelet + 2.0 * WORD) + treelet + 2.0 * node + WORD);
    if has_single_treelets(count) {
        let codes = 2.0 * bounds + WORD + treelet;
        return Phases::new(f64::from(count) * codes, 0.0, f64::from(count) * WORD, top);
    }
    let codes = 2.0 * bounds + key + WORD;
    let counts = 5.0 * WORD * f64::from(count_words(count)) / f64::from(count);
    let pass = WORD + 2.0 * (key + WORD) + counts;
    let flags = 2.0 * WORD + 3.0 * WORD;
    let climb = 3.0 * WORD + bounds + WORD + 2.0 * node + 2.0 * WORD + WORD;
    let phase = |bytes: f64| f64::from(count) * bytes;
    Phases::new(
        phase(codes),
        phase(f64::from(passes(bits)) * pass),
        phase(WORD + key + WORD + flags + climb),
        top,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::scene;

    /// A subject whose builds take 3, 1, 2, 3, 1, 2 ... milliseconds by their own account.
    struct Fake {
        boxes: Vec<Aabb>,
        builds: u32,
    }

    impl Subject for Fake {
        fn build(&mut self) -> Result<BuildTimes, BackendError> {
            let sort = f64::from(3 - (self.builds + 1) % 3);
            self.builds += 1;
            std::thread::sleep(Duration::from_millis(1));
            Ok(BuildTimes { sort, ..BuildTimes::default() })
        }

        fn refit(&mut self) -> Result<f64, BackendError> {
            Ok(7.0)
        }

        fn tree(&mut self) -> Result<Bvh, BackendError> {
            Ok(Bvh::binned(&self.boxes))
        }
    }

    fn fake() -> Fake {
        Fake { boxes: scene::boxes(100), builds: 0 }
    }

    #[test]
    fn medians_are_taken_behind_the_warm_up() {
        let mut subject = fake();
        let boxes = subject.boxes.clone();
        let start = Instant::now();
        let mut shares = Vec::new();
        let measured = measure(&mut subject, &boxes, Duration::from_millis(30), &mut |share| {
            shares.push(share);
            ControlFlow::Continue(())
        });
        let measured = measured.expect("valid").expect("not stopped");
        assert!(start.elapsed() >= WARM_UP + Duration::from_millis(30));
        assert!(measured.builds < subject.builds as usize && measured.builds >= LEAST_BUILDS);
        assert_eq!((measured.ms.sort, measured.ms.total, measured.refit_ms), (2.0, 2.0, 7.0));
        assert!(shares.is_sorted() && shares.last() == Some(&1.0));
        assert!((measured.rate() - 100.0 / 2.0e-3 * 1e-6).abs() < 1e-9);
    }

    /// A break while the subject warms up leaves nothing, one behind it what was measured till then.
    #[test]
    fn a_break_keeps_what_is_measured() {
        let mut subject = fake();
        let boxes = subject.boxes.clone();
        let time = Duration::from_secs(60);
        let nothing = measure(&mut subject, &boxes, time, &mut |_| ControlFlow::Break(()));
        assert_eq!(nothing.expect("valid"), None);
        let behind_warm_up = WARM_UP.as_secs_f64() / (WARM_UP + time).as_secs_f64();
        let measured = measure(&mut subject, &boxes, time, &mut |share| {
            if share > behind_warm_up { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        let builds = measured.expect("valid").expect("one build").builds;
        assert!((1..LEAST_BUILDS).contains(&builds), "{builds}");
    }

    #[test]
    fn a_wrong_tree_is_no_result() {
        let mut subject = fake();
        let mut boxes = subject.boxes.clone();
        boxes[50].max.x += 100.0;
        let error = measure(&mut subject, &boxes, Duration::ZERO, &mut |_| ControlFlow::Continue(()));
        assert!(matches!(error, Err(BenchError::Invalid { primitives: 100, .. })), "{error:?}");
    }

    /// By hand for keys of a word, four passes: codes 48 + 8; a pass 4 + 16, and 256 counts of 20 for each of 977
    /// blocks; treelets 4 + 8 + 20 + 116.
    #[test]
    fn bytes_are_those_of_the_algorithm() {
        let bytes = bytes_moved(1_000_000).scaled(1e-6);
        assert!((bytes.codes - 56.0).abs() < 1e-9, "{bytes:?}");
        assert!((bytes.sort - (80.0 + 20.00896)).abs() < 1e-9, "{bytes:?}");
        assert!((bytes.treelets - 148.0).abs() < 1e-9, "{bytes:?}");
        assert_eq!(bytes_moved(10_000).sort, 0.0);
        // Two words and twice the passes above 2^20.
        let counts = 8.0 * 20.0 * 256.0 * 9766.0;
        assert!((bytes_moved(10_000_000).sort - (8.0 * 28.0 * 1e7 + counts)).abs() < 1.0);
    }
}

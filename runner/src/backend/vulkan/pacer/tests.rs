//! Whole passes on simulated devices.

use super::*;
use crate::backend::vulkan::tiles::Parts;
use emboss_kernels::film::pixel;
use emboss_kernels::interface::Frame;

/// What no submission should exceed.
const LIMIT_MS: f64 = 50.0;
/// What a submission costs however little it does.
const OVERHEAD_MS: f64 = 0.05;

/// What pixels cost: `work` adds up, `tail` is how long a pixel takes at least, however many run beside it.
struct Device<W: Fn(u32, u32) -> f64, T: Fn(u32, u32) -> f64> {
    work_ms: W,
    tail_ms: T,
}

/// How a pass went.
#[derive(Debug)]
struct Pass {
    submissions: usize,
    longest_ms: f64,
    total_ms: f64,
}

/// A device without tails.
fn even<W: Fn(u32, u32) -> f64>(work_ms: W) -> Device<W, impl Fn(u32, u32) -> f64> {
    Device { work_ms, tail_ms: |_, _| 0.0 }
}

impl<W: Fn(u32, u32) -> f64, T: Fn(u32, u32) -> f64> Device<W, T> {
    /// A pass over a film.
    fn pass(&self, pacer: &mut Pacer, width: u32, height: u32) -> Pass {
        let frame = Frame { width, height, ..Frame::default() };
        let mut parts = Parts::new(width, height);
        pacer.begin_pass(parts.pixels());
        let mut pass = Pass { submissions: 0, longest_ms: 0.0, total_ms: 0.0 };
        while let Some((tiles, counted)) = parts.next(pacer.items(), 0) {
            let (mut work, mut tail) = (0.0, 0.0_f64);
            for group in 0..tiles.count {
                for i in 0..64 {
                    let (x, y, is_one) = pixel(&frame, &tiles, group, i % 8, i / 8);
                    if is_one {
                        work += (self.work_ms)(x, y);
                        tail = tail.max((self.tail_ms)(x, y));
                    }
                }
            }
            let ms = OVERHEAD_MS + work + tail;
            pacer.record(counted, ms);
            pass.submissions += 1;
            pass.longest_ms = pass.longest_ms.max(ms);
            pass.total_ms += ms;
        }
        pass
    }
}

#[test]
fn even_work_ends_in_submissions_of_the_target() {
    let mut pacer = Pacer::new(false);
    // 2^20 pixels of 0.2 µs: 210 ms, eleven submissions of 20 ms at the most.
    let device = even(|_, _| 2e-4);
    for pass in 0..6 {
        let went = device.pass(&mut pacer, 1024, 1024);
        assert!(went.longest_ms < TARGET_MS * 1.1, "pass {pass}: {went:?}");
        assert!(went.submissions <= if pass == 0 { 16 } else { 12 }, "pass {pass}: {went:?}");
    }
}

/// A first pass on a quick device is over before it has been cut often: each part takes as long as the slowest ray.
#[test]
fn a_first_pass_of_cheap_items_has_three_parts() {
    let device = Device { work_ms: |_, _| 1e-6, tail_ms: |_, _| 0.15 };
    let went = device.pass(&mut Pacer::new(false), 800, 600);
    assert!(went.submissions <= 3, "{went:?}");
}

#[test]
fn a_window_gets_submissions_of_half_the_length() {
    let mut pacer = Pacer::new(true);
    // What lavapipe takes on two cores: the first 256 take 26 ms.
    let device = even(|_, _| 0.1);
    for pass in 0..3 {
        let went = device.pass(&mut pacer, 128, 128);
        let most = if pass == 0 { 26.0 } else { 1.1 * TARGET_MS_OF_WINDOW };
        assert!(went.longest_ms < most, "pass {pass}: {went:?}");
    }
}

#[test]
fn dear_work_is_cut_to_the_target_and_stays_so() {
    let mut pacer = Pacer::new(false);
    // A slow device: 20 µs a pixel, 3.9 s in all.
    let device = even(|_, _| 2e-2);
    for pass in 0..6 {
        let went = device.pass(&mut pacer, 512, 384);
        assert!(went.longest_ms < LIMIT_MS, "pass {pass}: {went:?}");
        // A film of 512 x 512, as far as numbers of tiles go: parts of 20 differ in how many lie beyond it, 5 or 1 more
        // or less, so that what one of them says of the next is off by up to a quarter. Never are they crumbs.
        assert!((157..=270).contains(&went.submissions), "pass {pass}: {went:?}");
    }
}

#[test]
fn a_surface_of_a_thousand_times_the_backgrounds_cost_is_no_surprise() {
    // Less than a tenth of the film, at its lower edge: a sweep from the top would have grown long over the sky.
    let mut pacer = Pacer::new(false);
    let device = even(|_, y| if y < 700 { 1e-6 } else { 1e-3 });
    for pass in 0..4 {
        let went = device.pass(&mut pacer, 1024, 768);
        assert!(went.longest_ms < LIMIT_MS, "pass {pass}: {went:?}");
        assert!(went.submissions <= 8, "pass {pass}: {went:?}");
    }
}

#[test]
fn one_slow_ray_does_not_cut_the_picture_to_crumbs() {
    let mut pacer = Pacer::new(false);
    // 480,000 pixels that take 4 ms together, and one of 30 ms.
    let device = Device {
        work_ms: |_, _| 4.0 / 480_000.0,
        tail_ms: |x, y| if (x, y) == (211, 263) { 30.0 } else { 0.0 },
    };
    for pass in 0..10 {
        let went = device.pass(&mut pacer, 800, 600);
        assert!(went.total_ms < 40.0, "pass {pass}: {went:?}");
        assert!(went.submissions <= if pass == 0 { 6 } else { 2 }, "pass {pass}: {went:?}");
    }
}

#[test]
fn slow_rays_everywhere_run_side_by_side() {
    // Short tails, tails beyond the target, and such as exceed every limit.
    for slowest_ms in [4.0, 15.0, 30.0, 100.0] {
        let mut pacer = Pacer::new(false);
        let device = Device {
            work_ms: |_, _| 4.0 / 480_000.0,
            tail_ms: |x, y| if (x * 7 + y * 13) % 500 == 0 { slowest_ms } else { 0.0 },
        };
        for pass in 0..10 {
            let went = device.pass(&mut pacer, 800, 600);
            // 2^20 pixels are eight times eight times eight times 2048.
            assert!(went.submissions <= if pass == 0 { 8 } else { 1 }, "{slowest_ms} ms: {went:?}");
        }
    }
}

#[test]
fn work_is_told_from_tails_that_come_with_it() {
    // 30 ms of tail, and 120 ms of work: four submissions with as much work as tail.
    let mut pacer = Pacer::new(false);
    let device = Device {
        work_ms: |_, _| 120.0 / 262_144.0,
        tail_ms: |x, y| if (x * 7 + y * 13) % 500 == 0 { 30.0 } else { 0.0 },
    };
    for _ in 0..4 {
        device.pass(&mut pacer, 512, 512);
    }
    let went = device.pass(&mut pacer, 512, 512);
    assert!((4..=5).contains(&went.submissions) && went.longest_ms < 66.0, "{went:?}");
}

#[test]
fn a_change_that_makes_all_dearer_costs_one_long_submission() {
    let mut pacer = Pacer::new(false);
    for _ in 0..4 {
        even(|_, _| 1e-5).pass(&mut pacer, 1024, 1024);
    }
    pacer.beware();
    // Thirty times dearer: 315 ms in all.
    let device = even(|_, _| 3e-4);
    let first = device.pass(&mut pacer, 1024, 1024);
    // Ten milliseconds were all of the film, of which a quarter of what makes twenty is now half: 30 times 5 ms.
    assert!(first.longest_ms < 30.0 * TARGET_MS / CAUTION * 1.1, "{first:?}");
    let second = device.pass(&mut pacer, 1024, 1024);
    assert!(second.longest_ms < LIMIT_MS, "{second:?}");
}

#[test]
fn a_change_does_not_forget_tails() {
    let mut pacer = Pacer::new(false);
    let device =
        Device { work_ms: |_, _| 1e-6, tail_ms: |x, y| if (x * 7 + y * 13) % 500 == 0 { 30.0 } else { 0.0 } };
    for _ in 0..3 {
        device.pass(&mut pacer, 512, 512);
    }
    for _ in 0..3 {
        pacer.beware();
        let went = device.pass(&mut pacer, 512, 512);
        assert!(went.submissions <= 2, "{went:?}");
    }
}

/// A submission more is a tail more.
#[test]
fn passes_have_as_many_parts_as_are_planned() {
    for (width, height, items) in
        [(1024, 1024, 95_326.0), (512, 384, 300.0), (800, 600, 1000.5), (9, 9, 64.0)]
    {
        let mut pacer = Pacer { items, ..Pacer::new(false) };
        let mut parts = Parts::new(width, height);
        let all = parts.pixels();
        pacer.begin_pass(all);
        let mut counts = Vec::new();
        while let Some((_, counted)) = parts.next(pacer.items(), 0) {
            assert!(f64::from(counted) <= items, "{counted} of {items}");
            pacer.left -= counted;
            counts.push(counted);
        }
        let planned = (f64::from(all / 64) / (items / 64.0).floor()).ceil();
        assert_eq!(counts.len() as f64, planned, "{width}x{height} by {items}");
        // To a workgroup they are equal: none is a remainder.
        assert!(counts.iter().max() <= counts.iter().min().map(|least| least + 64).as_ref(), "{counts:?}");
    }
}

#[test]
fn passes_of_any_size_are_covered() {
    let mut pacer = Pacer::new(false);
    for (total, ms) in
        [(0, 0.0), (1, 0.0), (63, 100.0), (u32::MAX, 0.0), (u32::MAX, 1e9), (1000, f64::MIN_POSITIVE)]
    {
        pacer.begin_pass(total);
        let (mut left, mut submissions) = (total, 0);
        while left > 0 && submissions < 100 {
            let items = pacer.items();
            assert!(items >= FEWEST_ITEMS);
            let items = items.min(left);
            pacer.record(items, ms);
            left -= items;
            submissions += 1;
        }
        assert!(pacer.items.is_finite() && pacer.items >= f64::from(FEWEST_ITEMS), "{total}: {pacer:?}");
    }
}

//! The long mode: many more rays than CI has time for, case by case, on whatever machine there is time.
//!
//! | Environment | Meaning |
//! |---|---|
//! | `EMBOSS_LONG=1` | the long mode; each test says how many rays it has then |
//! | `EMBOSS_LONG_FROM=K` | the cases of each test before its case number K are left out |
//! | `EMBOSS_RAYS=COUNT` | so many rays a case (or a test, where it shares them out), in either mode |
//! | `EMBOSS_DEVICE=NAME` | the Vulkan device of the long mode, for want of it the first hardware one |
//!
//! Each case ends with a line on standard output, which a test program shows with `--nocapture`. A test program reads
//! no file, so that it can be taken to another machine; cases of several tests are told apart by running one test at
//! a time: `EMBOSS_LONG=1 EMBOSS_LONG_FROM=2 ./exact --nocapture --exact knot_is_exact`.

use crate::{finish, lavapipe};
use emboss::backend::vulkan::{Selection, VulkanBackend};
use std::env;
use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::str::FromStr;
use std::time::Instant;

/// Whether this is the long mode.
pub fn is_long() -> bool {
    number::<u32>("EMBOSS_LONG").is_some_and(|long| long != 0)
}

/// How many rays are wanted: `usual` ones, `long` ones in the long mode, or what the environment says.
pub fn rays(usual: usize, long: usize) -> usize {
    number("EMBOSS_RAYS").unwrap_or(if is_long() { long } else { usual })
}

/// Hands a Vulkan device to `test`: lavapipe under the validation layers, which must have nothing to say; in the long
/// mode the device that the environment names, at its full speed.
///
/// # Panics
/// Where there is no such device.
#[expect(clippy::print_stdout, reason = "the long mode says which device it runs on")]
pub fn on_device(test: impl FnOnce(&mut VulkanBackend)) {
    if !is_long() {
        let mut backend = lavapipe();
        test(&mut backend);
        finish(backend);
        return;
    }
    let selection = env::var("EMBOSS_DEVICE").map_or(Selection::Auto, Selection::Named);
    let mut backend = VulkanBackend::new(&selection, false).expect("the long mode needs a Vulkan device");
    println!("{}", emboss::backend::Backend::device(&backend).name);
    test(&mut backend);
}

/// The cases of a test, numbered from 0 in the order in which they come.
#[derive(Debug)]
pub struct Cases {
    next: usize,
    first: usize,
    start: Instant,
    failed: Vec<usize>,
}

impl Cases {
    /// None has run yet. Those before the number that the environment names will not.
    pub fn new() -> Cases {
        Cases {
            next: 0,
            first: number("EMBOSS_LONG_FROM").unwrap_or(0),
            start: Instant::now(),
            failed: Vec::new(),
        }
    }

    /// Runs the next case, unless it is left out, and prints what `case` says of it. In the long mode a case that
    /// panics does not end the others: see [`finish`](Cases::finish).
    #[expect(clippy::print_stdout, reason = "the long mode takes hours and says how far it is")]
    pub fn run<R: Display>(&mut self, name: impl Display, case: impl FnOnce() -> R) {
        let number = self.next;
        self.next += 1;
        if number < self.first {
            return;
        }
        let result = if is_long() { catch_unwind(AssertUnwindSafe(case)) } else { Ok(case()) };
        let seconds = self.start.elapsed().as_secs_f64();
        if let Ok(result) = result {
            println!("case {number}, {name}: {result}; {seconds:.0} s");
        } else {
            println!("case {number}, {name}: FAILED; {seconds:.0} s");
            self.failed.push(number);
        }
    }

    /// Ends the test.
    ///
    /// # Panics
    /// Where a case failed.
    pub fn finish(self) {
        assert!(self.failed.is_empty(), "cases {:?} failed", self.failed);
    }
}

impl Default for Cases {
    fn default() -> Self {
        Cases::new()
    }
}

/// A number in the environment.
///
/// # Panics
/// Where it is none.
fn number<T: FromStr>(name: &str) -> Option<T> {
    let value = env::var(name).ok()?;
    Some(value.parse().unwrap_or_else(|_| panic!("{name}={value} is no number")))
}

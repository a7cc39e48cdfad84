//! What is to fail, and what became of it.

use ash::vk;
use std::fmt;
use std::fs::File;
use std::io::Write;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::sync::{Mutex, OnceLock, PoisonError};

/// This does not say that a device is lost, which has memory all the same.
pub(crate) const ALLOCATE: &str = "vkAllocateMemory";

/// Calls that fail.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// A function: one of those that the layer has, as `vkQueueSubmit`.
    pub call: String,
    /// Which calls of it, the first of which is number 1.
    pub numbers: RangeInclusive<u32>,
    /// What it answers. A device that is lost stays so: all calls that can say it do, from then on.
    pub answer: vk::Result,
}

impl Fault {
    /// All calls, from number `first` on.
    pub fn from(call: &str, first: u32, answer: vk::Result) -> Fault {
        Fault { call: call.to_owned(), numbers: first..=u32::MAX, answer }
    }

    fn read(line: &str) -> Option<Fault> {
        let mut words = line.split(' ');
        let call = words.next()?.to_owned();
        let mut number = || words.next()?.parse::<i64>().ok();
        let mut count = || u32::try_from(number()?).ok();
        let numbers = count()?..=count()?;
        Some(Fault { call, numbers, answer: vk::Result::from_raw(i32::try_from(number()?).ok()?) })
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Fault { call, numbers, answer } = self;
        write!(f, "{call} {} {} {}", numbers.start(), numbers.end(), answer.as_raw())
    }
}

/// A plan, and how far it has come.
struct Plan {
    /// With the number of calls so far.
    faults: Vec<(Fault, u32)>,
    is_lost: bool,
}

impl Plan {
    /// Counts a call. What it is to answer, where that is an error.
    fn answer(&mut self, call: &str) -> Option<vk::Result> {
        let is_lost = self.is_lost && call != ALLOCATE;
        let mut answer = is_lost.then_some(vk::Result::ERROR_DEVICE_LOST);
        for (fault, count) in self.faults.iter_mut().filter(|(fault, _)| fault.call == call) {
            *count += 1;
            if fault.numbers.contains(count) {
                answer = answer.or(Some(fault.answer));
            }
        }
        self.is_lost |= answer == Some(vk::Result::ERROR_DEVICE_LOST);
        answer
    }
}

/// Counts a call of the program. What it is to answer, where that is an error.
pub(crate) fn answer(call: &str) -> Option<vk::Result> {
    static PLAN: OnceLock<Mutex<Plan>> = OnceLock::new();
    let path = PathBuf::from(std::env::var_os(crate::PLAN)?);
    let plan = match PLAN.get() {
        Some(plan) => plan,
        None => {
            let text = std::fs::read_to_string(&path).ok()?;
            let fault = |line| (Fault::read(line).unwrap_or_else(|| panic!("`{line}` is no fault")), 0);
            let faults = text.lines().map(fault).collect();
            PLAN.get_or_init(|| Mutex::new(Plan { faults, is_lost: false }))
        }
    };
    // Held until it is noted, so that calls of other threads are noted behind the one that made them fail.
    let mut plan = plan.lock().unwrap_or_else(PoisonError::into_inner);
    let answer = plan.answer(call)?;
    let failed = File::options().create(true).append(true).open(path.with_file_name(crate::FAILED));
    let noted = failed.and_then(|mut file| file.write_all(format!("{call} {answer:?}\n").as_bytes()));
    noted.expect("the folder takes files");
    Some(answer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_read_as_they_are_written() {
        let fault = Fault::from("vkQueueSubmit", 3, vk::Result::ERROR_DEVICE_LOST);
        assert_eq!(fault.to_string(), "vkQueueSubmit 3 4294967295 -4");
        assert_eq!(Fault::read(&fault.to_string()), Some(fault));
        assert_eq!(Fault::read("vkQueueSubmit 3"), None);
    }

    #[test]
    fn lost_devices_stay_lost_and_other_errors_pass() {
        let (lost, full) = (vk::Result::ERROR_DEVICE_LOST, vk::Result::ERROR_OUT_OF_DEVICE_MEMORY);
        let second = Fault { call: "b".into(), numbers: 2..=2, answer: full };
        let mut plan = Plan { faults: vec![(Fault::from("a", 2, lost), 0), (second, 0)], is_lost: false };
        let answers = ["b", "b", "b", "a", "a", "c", ALLOCATE].map(|call| plan.answer(call));
        assert_eq!(answers, [None, Some(full), None, None, Some(lost), Some(lost), None]);
    }
}

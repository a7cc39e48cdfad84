//! What kernels with barriers are written in: words that all invocations share, and phases of a workgroup.
//!
//! Together with `math`'s accessors the only code in which the two targets differ. On SPIR-V a [`Word`] lies in a
//! storage buffer and a [`Workgroup`] is the invocation's own; on the CPU a word is an atomic, so that workgroups can
//! run on several threads, and a workgroup runs each phase for all its invocations in turn.

#[cfg(target_arch = "spirv")]
use core::cell::UnsafeCell;
#[cfg(not(target_arch = "spirv"))]
use core::sync::atomic::{AtomicU32, Ordering};
#[cfg(target_arch = "spirv")]
use spirv_std::memory::{Scope, Semantics};

/// A word that several invocations may write.
#[cfg(not(target_arch = "spirv"))]
#[derive(Debug, Default)]
#[repr(transparent)]
pub struct Word(AtomicU32);

/// A word that several invocations may write.
#[cfg(target_arch = "spirv")]
#[repr(transparent)]
pub struct Word(UnsafeCell<u32>);

#[cfg(not(target_arch = "spirv"))]
impl Clone for Word {
    fn clone(&self) -> Word {
        Word::new(self.get())
    }
}

#[cfg(not(target_arch = "spirv"))]
impl Word {
    /// A word that holds `value`.
    pub const fn new(value: u32) -> Word {
        Word(AtomicU32::new(value))
    }

    /// Its value, once no one shares it any more.
    pub fn into_inner(self) -> u32 {
        self.0.into_inner()
    }

    /// Its value, which no other invocation of the dispatch (or, between barriers, of the workgroup) writes.
    #[inline]
    pub fn get(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }

    /// Replaces its value, which no other invocation of the dispatch (or, between barriers, of the workgroup) reads or
    /// writes.
    #[inline]
    pub fn set(&self, value: u32) {
        self.0.store(value, Ordering::Relaxed);
    }

    /// Its value as the last invocation left it that [`hand_over`](Self::hand_over) orders before this one.
    #[inline]
    pub fn load(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }

    /// Replaces its value for invocations of other workgroups that [`hand_over`](Self::hand_over) orders after this
    /// one.
    #[inline]
    pub fn store(&self, value: u32) {
        self.0.store(value, Ordering::Relaxed);
    }

    /// Adds atomically; returns what was there.
    #[inline]
    pub fn add(&self, value: u32) -> u32 {
        self.0.fetch_add(value, Ordering::Relaxed)
    }

    /// Keeps the greater, atomically.
    #[inline]
    pub fn max(&self, value: u32) {
        // Mostly it has the greater already, and a processor reads much faster than it swaps.
        if self.0.load(Ordering::Relaxed) < value {
            self.0.fetch_max(value, Ordering::Relaxed);
        }
    }

    /// Swaps in `value` atomically and returns what was there. What this invocation stored before is there for the
    /// one that takes `value` out; what the one that put the returned value in stored before is there for this one.
    #[inline]
    pub fn hand_over(&self, value: u32) -> u32 {
        self.0.swap(value, Ordering::AcqRel)
    }
}

#[cfg(target_arch = "spirv")]
const SCOPE: u32 = Scope::QueueFamily as u32;
#[cfg(target_arch = "spirv")]
const RELAXED: u32 = Semantics::NONE.bits();
#[cfg(target_arch = "spirv")]
const ACQUIRE_RELEASE: u32 = Semantics::ACQUIRE_RELEASE.bits()
    | Semantics::UNIFORM_MEMORY.bits()
    | Semantics::MAKE_AVAILABLE.bits()
    | Semantics::MAKE_VISIBLE.bits();

#[cfg(target_arch = "spirv")]
#[expect(missing_docs, reason = "documented above, where the CPU has the same")]
#[expect(
    unsafe_code,
    reason = "atomics and cells are unsafe; the CPU build of the same source uses safe atomics"
)]
impl Word {
    #[inline]
    pub fn get(&self) -> u32 {
        // SAFETY: the caller's promise: no other invocation writes it now.
        unsafe { *self.0.get() }
    }

    #[inline]
    pub fn set(&self, value: u32) {
        // SAFETY: the caller's promise: no other invocation reads or writes it now.
        unsafe { *self.0.get() = value }
    }

    #[inline]
    pub fn load(&self) -> u32 {
        // SAFETY: atomic.
        unsafe { spirv_std::arch::atomic_load::<u32, SCOPE, RELAXED>(&*self.0.get()) }
    }

    #[inline]
    pub fn store(&self, value: u32) {
        // SAFETY: atomic.
        unsafe { spirv_std::arch::atomic_store::<u32, SCOPE, RELAXED>(&mut *self.0.get(), value) }
    }

    #[inline]
    pub fn add(&self, value: u32) -> u32 {
        // SAFETY: atomic.
        unsafe { spirv_std::arch::atomic_i_add::<u32, SCOPE, RELAXED>(&mut *self.0.get(), value) }
    }

    #[inline]
    pub fn max(&self, value: u32) {
        // SAFETY: atomic.
        unsafe { spirv_std::arch::atomic_u_max::<u32, SCOPE, RELAXED>(&mut *self.0.get(), value) };
    }

    #[inline]
    pub fn hand_over(&self, value: u32) -> u32 {
        // SAFETY: atomic.
        unsafe { spirv_std::arch::atomic_exchange::<u32, SCOPE, ACQUIRE_RELEASE>(&mut *self.0.get(), value) }
    }
}

/// Word `i` of a buffer; `i` is below its length, which CPU builds check.
#[inline]
pub fn word(buffer: &[Word], i: u32) -> &Word {
    #[cfg(not(target_arch = "spirv"))]
    {
        &buffer[i as usize]
    }
    #[cfg(target_arch = "spirv")]
    #[expect(unsafe_code, reason = "unchecked load; the CPU build of the same source checks the index")]
    // SAFETY: as in `math::at`.
    unsafe {
        spirv_std::arch::IndexUnchecked::index_unchecked(buffer, i as usize)
    }
}

/// The invocations of a workgroup, `SIZE` of them.
///
/// A kernel with barriers is a sequence of phases (`phase!`). What one invocation needs from its own earlier phase
/// it keeps in shared memory or computes again: registers do not outlive a phase.
#[derive(Clone, Copy, Debug)]
pub struct Workgroup<const SIZE: u32> {
    /// Its number among the workgroups of the dispatch.
    pub id: u32,
    #[cfg(target_arch = "spirv")]
    local: u32,
}

impl<const SIZE: u32> Workgroup<SIZE> {
    /// Workgroup number `id`, all of whose invocations the caller stands for.
    #[cfg(not(target_arch = "spirv"))]
    pub fn new(id: u32) -> Self {
        Workgroup { id }
    }

    /// Workgroup number `id`, of whose invocations the caller is number `local`. For entry points, which the CPU does
    /// not call: it has no such invocations.
    pub(crate) fn of_invocation(id: u32, local: u32) -> Self {
        #[cfg(not(target_arch = "spirv"))]
        {
            debug_assert!(local < SIZE);
            Workgroup { id }
        }
        #[cfg(target_arch = "spirv")]
        {
            Workgroup { id, local }
        }
    }

    /// How many invocations it has.
    #[cfg(not(target_arch = "spirv"))]
    pub(crate) fn size(self) -> u32 {
        SIZE
    }

    /// The number of this invocation in it.
    #[cfg(target_arch = "spirv")]
    pub(crate) fn local(self) -> u32 {
        self.local
    }

    /// The same invocations at the work of workgroup number `id`.
    #[inline]
    pub fn at(mut self, id: u32) -> Self {
        self.id = id;
        self
    }
}

/// `phase!(group, |local| { ... })` runs the block for each invocation of a [`Workgroup`], given its number in it; none
/// goes on before all are through, and then each sees what the others wrote to shared memory. Which phases a workgroup
/// runs must not depend on the invocation.
///
/// A macro, since rust-gpu does not always take closures apart that hold references.
macro_rules! phase {
    ($group:expr, |$local:ident| $body:block) => {
        #[cfg(not(target_arch = "spirv"))]
        for $local in 0..$group.size() $body
        #[cfg(target_arch = "spirv")]
        {
            {
                let $local = $group.local();
                $body
            }
            $crate::math::workgroup_barrier();
        }
    };
}
pub(crate) use phase;

/// `shared[i]`; see [`math::at`](crate::math::at).
#[inline]
pub fn shared_at<const N: usize>(shared: &[u32; N], i: u32) -> u32 {
    #[cfg(not(target_arch = "spirv"))]
    {
        shared[i as usize]
    }
    #[cfg(target_arch = "spirv")]
    #[expect(unsafe_code, reason = "a checked index could end an invocation in front of a barrier")]
    // SAFETY: as in `math::at`.
    unsafe {
        *spirv_std::arch::IndexUnchecked::index_unchecked(shared, i as usize)
    }
}

/// `shared[i] = value`; see [`math::put`](crate::math::put).
#[inline]
pub fn shared_put<const N: usize>(shared: &mut [u32; N], i: u32, value: u32) {
    #[cfg(not(target_arch = "spirv"))]
    {
        shared[i as usize] = value;
    }
    #[cfg(target_arch = "spirv")]
    #[expect(unsafe_code, reason = "a checked index could end an invocation in front of a barrier")]
    // SAFETY: as in `math::at`.
    unsafe {
        *spirv_std::arch::IndexUnchecked::index_unchecked_mut(shared, i as usize) = value;
    }
}

/// Adds to `shared[i]`, which other invocations of the workgroup add to in the same phase.
#[inline]
pub fn shared_add<const N: usize>(shared: &mut [u32; N], i: u32, value: u32) {
    #[cfg(not(target_arch = "spirv"))]
    {
        shared[i as usize] += value;
    }
    #[cfg(target_arch = "spirv")]
    #[expect(
        unsafe_code,
        reason = "atomics are unsafe in spirv-std; no index may fail in front of a barrier"
    )]
    // SAFETY: as in `math::at`, and in this phase every access to the word goes through here.
    unsafe {
        let word = spirv_std::arch::IndexUnchecked::index_unchecked_mut(shared, i as usize);
        spirv_std::arch::atomic_i_add::<u32, { Scope::Workgroup as u32 }, RELAXED>(word, value);
    }
}

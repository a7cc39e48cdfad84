//! Submissions: recorded, timed and waited for, one at a time.

use super::buffer::Buffer;
use super::device::{Device, Owned};
use super::pipeline::Pipeline;
use crate::backend::BackendError;
use ash::vk;
use std::cell::Cell;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long one wait for a submission lasts. It is repeated for as long as the submission runs: a software device
/// may take minutes, and a hung one is reset by its driver, which ends the wait with a lost device.
const WAIT: Duration = Duration::from_secs(1);
/// A submission that takes longer than this is mentioned to the user, once.
const LONG_WAIT: Duration = Duration::from_secs(20);

/// One command buffer that is recorded, submitted and waited for again and again.
///
/// A second submission in flight would hide the time between two (some 50 µs), which is 0.3 % of a submission of
/// the length aimed at; one in flight makes every resource free to change between two.
pub(super) struct Commands {
    buffer: vk::CommandBuffer,
    /// Owns the memory of `buffer`.
    _pool: Owned<vk::CommandPool>,
    fence: Owned<vk::Fence>,
    stopwatch: Option<Stopwatch>,
    device: Arc<Device>,
}

/// Timestamps around a submission's work, and within.
struct Stopwatch {
    queries: Owned<vk::QueryPool>,
    period_ns: f64,
    /// Selects the bits of a timestamp that count.
    mask: u64,
}

/// A command buffer being recorded. Commands run in order; between two of which one reads or writes what the other
/// wrote, [`barrier`](Self::barrier) must stand.
pub(super) struct Recorder<'a> {
    buffer: vk::CommandBuffer,
    device: &'a ash::Device,
    /// `None` where the queue writes no timestamps.
    queries: Option<vk::QueryPool>,
    /// How many [marks](Self::mark) there are so far.
    marks: Cell<u32>,
}

/// Most timestamps of a submission, with those of its beginning and its end.
const MOST_STAMPS: u32 = 16;

impl Commands {
    pub(super) fn new(device: &Arc<Device>) -> Result<Self, BackendError> {
        let info = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER)
            .queue_family_index(device.queue_family());
        // SAFETY: the device has a queue of this family.
        let made = unsafe { device.raw().create_command_pool(&info, None) };
        let pool = Owned::new(device, "creating a command pool", made)?;
        // SAFETY: the device lives.
        let made = unsafe { device.raw().create_fence(&vk::FenceCreateInfo::default(), None) };
        let fence = Owned::new(device, "creating a fence", made)?;
        Ok(Commands {
            buffer: allocate_buffer(&pool)?,
            _pool: pool,
            fence,
            stopwatch: Stopwatch::new(device)?,
            device: Arc::clone(device),
        })
    }

    /// Records with `record`, runs it and waits until it is done. Everything that earlier runs wrote is visible to
    /// it. Returns its duration in milliseconds: the device's where it has timestamps, else the host's. `what` is
    /// named where the device fails.
    pub(super) fn run(
        &self,
        what: &'static str,
        record: impl FnOnce(&Recorder<'_>),
    ) -> Result<f64, BackendError> {
        Ok(self.run_marked(what, record)?.into_iter().sum())
    }

    /// As [`run`](Self::run), but returns the duration of each part between two [marks](Recorder::mark), of which there
    /// is one more than marks. Where the device has no timestamps everything counts as the last part.
    pub(super) fn run_marked(
        &self,
        what: &'static str,
        record: impl FnOnce(&Recorder<'_>),
    ) -> Result<Vec<f64>, BackendError> {
        self.begin(what)?;
        let recorder = Recorder {
            buffer: self.buffer,
            device: self.device.raw(),
            queries: self.stopwatch.as_ref().map(|stopwatch| stopwatch.queries.raw()),
            marks: Cell::new(0),
        };
        recorder.barrier();
        recorder.write_timestamp(0, vk::PipelineStageFlags::TOP_OF_PIPE);
        record(&recorder);
        let last = recorder.marks.get() + 1;
        recorder.write_timestamp(last, vk::PipelineStageFlags::BOTTOM_OF_PIPE);
        recorder.barrier_to_host();
        // SAFETY: the buffer is being recorded.
        unsafe { self.device.raw().end_command_buffer(self.buffer) }
            .map_err(|e| self.device.error(what, e))?;
        let submitted = Instant::now();
        self.submit(what)?;
        self.wait(what)?;
        let host_ms = submitted.elapsed().as_secs_f64() * 1e3;
        if let Some(stopwatch) = &self.stopwatch {
            return stopwatch.read_ms(what, last as usize + 1);
        }
        let mut parts = vec![0.0; last as usize];
        parts[last as usize - 1] = host_ms;
        Ok(parts)
    }

    fn begin(&self, what: &'static str) -> Result<(), BackendError> {
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the last submission was waited for, and beginning resets the buffer.
        unsafe { self.device.raw().begin_command_buffer(self.buffer, &info) }
            .map_err(|e| self.device.error(what, e))?;
        if let Some(stopwatch) = &self.stopwatch {
            let queries = stopwatch.queries.raw();
            // SAFETY: the buffer is being recorded, and the pool has as many queries.
            unsafe { self.device.raw().cmd_reset_query_pool(self.buffer, queries, 0, MOST_STAMPS) };
        }
        Ok(())
    }

    fn submit(&self, what: &'static str) -> Result<(), BackendError> {
        let fences = [self.fence.raw()];
        // SAFETY: no submission that signals the fence is pending.
        unsafe { self.device.raw().reset_fences(&fences) }.map_err(|e| self.device.error(what, e))?;
        let buffers = [self.buffer];
        let submits = [vk::SubmitInfo::default().command_buffers(&buffers)];
        let (queue, _turn) = self.device.queue();
        // SAFETY: the buffer is recorded and not pending; `wait` follows before anything it uses is dropped.
        unsafe { self.device.raw().queue_submit(queue, &submits, fences[0]) }
            .map_err(|e| self.device.error(what, e))
    }

    fn wait(&self, what: &'static str) -> Result<(), BackendError> {
        let (start, mut mentioned) = (Instant::now(), false);
        loop {
            // SAFETY: the fence is of this device.
            match unsafe { self.device.raw().wait_for_fences(&[self.fence.raw()], true, nanoseconds(WAIT)) } {
                Ok(()) => return Ok(()),
                Err(vk::Result::TIMEOUT) => {
                    if !mentioned && start.elapsed() > LONG_WAIT {
                        mentioned = true;
                        let seconds = LONG_WAIT.as_secs();
                        tracing::warn!("{} has been {what} for {seconds} s", self.device.info().name);
                    }
                }
                Err(error) => {
                    // The submission must have ended before what it uses is dropped.
                    let idle = self.device.wait_idle();
                    tracing::debug!("waiting failed with {error}, then for the idle device: {idle:?}");
                    return Err(self.device.error(what, error));
                }
            }
        }
    }
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

pub(super) fn allocate_buffer(pool: &Owned<vk::CommandPool>) -> Result<vk::CommandBuffer, BackendError> {
    let device = pool.device();
    let info = vk::CommandBufferAllocateInfo::default()
        .command_pool(pool.raw())
        .level(vk::CommandBufferLevel::PRIMARY)
        .command_buffer_count(1);
    // SAFETY: the pool is of this device, and frees the buffer when it is destroyed.
    let buffers = unsafe { device.raw().allocate_command_buffers(&info) }
        .map_err(|source| device.error("allocating a command buffer", source))?;
    Ok(buffers[0])
}

impl Stopwatch {
    /// `None` where the queue writes no timestamps.
    fn new(device: &Arc<Device>) -> Result<Option<Self>, BackendError> {
        let limits = device.limits();
        if limits.timestamp_bits == 0 || limits.timestamp_period_ns <= 0.0 {
            return Ok(None);
        }
        let info =
            vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(MOST_STAMPS);
        // SAFETY: the device lives.
        let made = unsafe { device.raw().create_query_pool(&info, None) };
        Ok(Some(Stopwatch {
            queries: Owned::new(device, "creating timestamp queries", made)?,
            period_ns: limits.timestamp_period_ns,
            mask: u64::MAX >> (64 - limits.timestamp_bits.min(64)),
        }))
    }

    /// Milliseconds between each two of the first `count` timestamps of a submission that is done.
    fn read_ms(&self, what: &'static str, count: usize) -> Result<Vec<f64>, BackendError> {
        let device = self.queries.device();
        let mut stamps = vec![0_u64; count];
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        // SAFETY: these queries were written by the submission, which is done.
        unsafe { device.raw().get_query_pool_results(self.queries.raw(), 0, &mut stamps, flags) }
            .map_err(|source| device.error(what, source))?;
        Ok(stamps.windows(2).map(|two| elapsed_ms([two[0], two[1]], self.mask, self.period_ns)).collect())
    }
}

/// Milliseconds from the first stamp to the second, of which `mask` are the bits that count: they may have
/// overflowed once in between.
fn elapsed_ms(stamps: [u64; 2], mask: u64, period_ns: f64) -> f64 {
    let ticks = (stamps[1] & mask).wrapping_sub(stamps[0] & mask) & mask;
    ticks as f64 * period_ns * 1e-6
}

impl Recorder<'_> {
    /// Runs `groups` workgroups of a kernel, with the buffers that are bound to it.
    pub(super) fn dispatch(&self, pipeline: &Pipeline, push_constants: &[u8], groups: [u32; 2]) {
        self.bind(pipeline, push_constants);
        // SAFETY: everything that the pipeline needs is bound.
        unsafe { self.device.cmd_dispatch(self.buffer, groups[0], groups[1], 1) };
    }

    fn bind(&self, pipeline: &Pipeline, push_constants: &[u8]) {
        let (bind_point, layout) = (vk::PipelineBindPoint::COMPUTE, pipeline.layout());
        // SAFETY: the buffer is being recorded, and the pipeline outlives the submission.
        unsafe { self.device.cmd_bind_pipeline(self.buffer, bind_point, pipeline.raw()) };
        // SAFETY: the set has this layout, and every binding was written.
        unsafe {
            self.device.cmd_bind_descriptor_sets(self.buffer, bind_point, layout, 0, &[pipeline.set()], &[]);
        };
        if !push_constants.is_empty() {
            let stage = vk::ShaderStageFlags::COMPUTE;
            // SAFETY: the layout has push constants of this size for this stage.
            unsafe { self.device.cmd_push_constants(self.buffer, layout, stage, 0, push_constants) };
        }
    }

    /// Copies `region` from one buffer to another. It must lie within both.
    pub(super) fn copy(&self, from: &Buffer, to: &Buffer, region: vk::BufferCopy) {
        assert!(region.src_offset + region.size <= from.bytes(), "{region:?} leaves its source");
        assert!(region.dst_offset + region.size <= to.bytes(), "{region:?} leaves its destination");
        // SAFETY: the region lies within both, as asserted, and both outlive the submission.
        unsafe { self.device.cmd_copy_buffer(self.buffer, from.raw(), to.raw(), &[region]) };
    }

    /// Runs a kernel with the buffers that are bound to it, on as many workgroups along x, y and z as three words of
    /// `groups` say, the first of which is number `word`.
    pub(super) fn dispatch_indirect(
        &self,
        pipeline: &Pipeline,
        push_constants: &[u8],
        groups: &Buffer,
        word: u32,
    ) {
        let offset = u64::from(word) * size_of::<u32>() as u64;
        assert!(offset + 12 <= groups.bytes(), "word {word} is not there");
        self.bind(pipeline, push_constants);
        // SAFETY: everything that the pipeline needs is bound, and the three words lie in the buffer, which outlives
        // the submission and may be read as a command's arguments.
        unsafe { self.device.cmd_dispatch_indirect(self.buffer, groups.raw(), offset) };
    }

    /// Fills a buffer with a word.
    pub(super) fn fill(&self, buffer: &Buffer, word: u32) {
        // SAFETY: the buffer outlives the submission, and may be a destination.
        unsafe { self.device.cmd_fill_buffer(self.buffer, buffer.raw(), 0, vk::WHOLE_SIZE, word) };
    }

    /// Writes a word of a buffer.
    pub(super) fn put_word(&self, buffer: &Buffer, place: u32, word: u32) {
        let offset = u64::from(place) * size_of::<u32>() as u64;
        assert!(offset + 4 <= buffer.bytes(), "word {place} is not there");
        // SAFETY: the word lies in the buffer, which outlives the submission and may be a destination.
        unsafe { self.device.cmd_fill_buffer(self.buffer, buffer.raw(), offset, 4, word) };
    }

    /// Notes the time at which everything recorded so far is done: [`Commands::run_marked`] tells it.
    pub(super) fn mark(&self) {
        let number = self.marks.get() + 1;
        assert!(number + 1 < MOST_STAMPS, "a submission has at most {} marks", MOST_STAMPS - 2);
        self.marks.set(number);
        self.write_timestamp(number, vk::PipelineStageFlags::BOTTOM_OF_PIPE);
    }

    fn write_timestamp(&self, number: u32, stage: vk::PipelineStageFlags) {
        if let Some(queries) = self.queries {
            // SAFETY: the buffer is being recorded, and `begin` reset the query.
            unsafe { self.device.cmd_write_timestamp(self.buffer, stage, queries, number) };
        }
    }

    /// What kernels and copies before it wrote is there for those after it.
    pub(super) fn barrier(&self) {
        let work = vk::PipelineStageFlags::COMPUTE_SHADER | vk::PipelineStageFlags::TRANSFER;
        let written = vk::AccessFlags::SHADER_WRITE | vk::AccessFlags::TRANSFER_WRITE;
        let read = vk::AccessFlags::SHADER_READ | vk::AccessFlags::TRANSFER_READ;
        self.memory_barrier(work, written, work, written | read);
    }

    /// What kernels before it wrote is there for indirect dispatches after it to take their numbers of workgroups from,
    /// which a device reads before their shader runs.
    pub(super) fn barrier_for_arguments(&self) {
        let (work, written) = (vk::PipelineStageFlags::COMPUTE_SHADER, vk::AccessFlags::SHADER_WRITE);
        let arguments = vk::PipelineStageFlags::DRAW_INDIRECT;
        self.memory_barrier(work, written, arguments, vk::AccessFlags::INDIRECT_COMMAND_READ);
    }

    /// What copies before it wrote can be read by the host once the submission is done.
    fn barrier_to_host(&self) {
        self.memory_barrier(
            vk::PipelineStageFlags::TRANSFER,
            vk::AccessFlags::TRANSFER_WRITE,
            vk::PipelineStageFlags::HOST,
            vk::AccessFlags::HOST_READ,
        );
    }

    fn memory_barrier(
        &self,
        from_stage: vk::PipelineStageFlags,
        from: vk::AccessFlags,
        to_stage: vk::PipelineStageFlags,
        to: vk::AccessFlags,
    ) {
        let barrier = [vk::MemoryBarrier::default().src_access_mask(from).dst_access_mask(to)];
        let flags = vk::DependencyFlags::empty();
        // SAFETY: the buffer is being recorded, and a compute queue has these stages.
        unsafe {
            self.device.cmd_pipeline_barrier(self.buffer, from_stage, to_stage, flags, &barrier, &[], &[]);
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timestamps_are_differences_in_milliseconds() {
        // 2 million ticks of 0.5 ns are 1 ms.
        assert_eq!(elapsed_ms([5, 2_000_005], u64::MAX, 0.5), 1.0);
    }

    #[test]
    fn timestamps_may_overflow_and_carry_junk_above_their_bits() {
        let mask = 0xFFFF;
        assert_eq!(elapsed_ms([0xABCD_FFF0, 0x1234_0010], mask, 1e6), 32.0);
    }
}

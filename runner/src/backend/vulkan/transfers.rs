//! Copies between the host and the device's own memory.

use super::buffer::Buffer;
use super::commands::Commands;
use super::device::Device;
use crate::backend::BackendError;
use ash::vk;
use bytemuck::{Pod, cast_slice_mut};
use std::sync::Arc;

/// Size of the staging buffers in bytes. Whatever is larger goes in pieces, so that the size of a scene is limited
/// by the device's memory alone. 8 MiB take about 1 ms over PCIe, twenty times what a submission costs.
const STAGING_BYTES: usize = 8 << 20;

/// The two mapped buffers that everything goes through.
pub(super) struct Transfers {
    upload: Buffer,
    download: Buffer,
}

impl Transfers {
    pub(super) fn new(device: &Arc<Device>) -> Result<Self, BackendError> {
        Ok(Transfers {
            upload: Buffer::for_upload(device, STAGING_BYTES as u64)?,
            download: Buffer::for_download(device, STAGING_BYTES as u64)?,
        })
    }

    /// Copies `bytes` to the beginning of `to`, which is at least that long.
    pub(super) fn write(
        &mut self,
        commands: &Commands,
        to: &Buffer,
        bytes: &[u8],
    ) -> Result<(), BackendError> {
        self.write_at(commands, to, 0, bytes)
    }

    /// Copies `bytes` to byte `offset` of `to` and on, which is at least that long.
    pub(super) fn write_at(
        &mut self,
        commands: &Commands,
        to: &Buffer,
        mut offset: u64,
        bytes: &[u8],
    ) -> Result<(), BackendError> {
        for piece in bytes.chunks(STAGING_BYTES) {
            let size = piece.len() as u64;
            self.upload.mapped_mut()[..piece.len()].copy_from_slice(piece);
            let region = vk::BufferCopy { src_offset: 0, dst_offset: offset, size };
            commands.run("uploading", |recorder| recorder.copy(&self.upload, to, region))?;
            offset += size;
        }
        Ok(())
    }

    /// The first `count` values in `from`, which is at least that long.
    pub(super) fn read<T: Pod>(
        &self,
        commands: &Commands,
        from: &Buffer,
        count: usize,
    ) -> Result<Vec<T>, BackendError> {
        let mut values = vec![T::zeroed(); count];
        let mut offset = 0;
        for piece in cast_slice_mut::<T, u8>(&mut values).chunks_mut(STAGING_BYTES) {
            let size = piece.len() as u64;
            let region = vk::BufferCopy { src_offset: offset, dst_offset: 0, size };
            commands.run("downloading", |recorder| recorder.copy(from, &self.download, region))?;
            piece.copy_from_slice(&self.download.mapped()[..piece.len()]);
            offset += size;
        }
        Ok(values)
    }
}

//! Pictures in a window: made by the host, copied to the images of a swapchain.

use super::buffer::Buffer;
use super::commands::allocate_buffer;
use super::device::{Device, Owned};
use super::surface::Surface;
use crate::backend::BackendError;
use ash::vk;
use std::sync::Arc;

/// How long an image of the swapchain is waited for. A picture that finds none is shown at the next chance, unless a
/// newer one has come.
const PATIENCE_NS: u64 = 5_000_000;
/// How often the surface may be lost before a picture is shown.
const MOST_LOSSES: u32 = 10;

/// What became of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// It is on its way to the screen.
    Yes,
    /// The window has changed its size, or no image is free: to be tried again.
    NotYet,
}

/// Shows pictures in a window. Used by one thread, beside the one that renders on the same device. All that it does may
/// wait for the device: it is not for the thread that hears the user.
pub struct Swapchain {
    /// `None` while the window has no area, and before the first picture. Dropped before the surface.
    chain: Option<Chain>,
    /// Whether the window does not go with the chain any more.
    is_stale: bool,
    staging: Option<Buffer>,
    commands: vk::CommandBuffer,
    /// Owns the memory of `commands`.
    _pool: Owned<vk::CommandPool>,
    /// Signalled by the last copy; signalled at first.
    copied: Owned<vk::Fence>,
    /// Signalled when the image to copy to is free.
    acquired: Owned<vk::Semaphore>,
    surface: Surface,
    /// Whether the surface is of no more use: the window's system has taken it back.
    is_surface_lost: bool,
    /// How often that was so since a picture was shown.
    losses: u32,
    functions: ash::khr::swapchain::Device,
    device: Arc<Device>,
}

/// A swapchain for a size of the window.
struct Chain {
    raw: vk::SwapchainKHR,
    images: Vec<vk::Image>,
    /// For each image: signalled when it may be presented.
    drawn: Vec<Owned<vk::Semaphore>>,
    extent: vk::Extent2D,
    /// Whether red is the lowest byte of a texel, instead of blue.
    is_rgba: bool,
    functions: ash::khr::swapchain::Device,
    device: Arc<Device>,
}

impl Drop for Chain {
    fn drop(&mut self) {
        // Images may still be on their way to the screen. Where the device is lost they are not.
        let _ = self.device.wait_idle();
        // SAFETY: made in `Swapchain::renew`, destroyed once, nothing uses it any more.
        unsafe { self.functions.destroy_swapchain(self.raw, None) };
    }
}

impl Swapchain {
    /// Prepares to show pictures in the window of `surface`, which the device presents to.
    pub(super) fn new(device: &Arc<Device>, surface: Surface) -> Result<Self, BackendError> {
        let info = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER)
            .queue_family_index(device.queue_family());
        // SAFETY: the device has a queue of this family.
        let made = unsafe { device.raw().create_command_pool(&info, None) };
        let pool = Owned::new(device, "creating a command pool", made)?;
        let info = vk::FenceCreateInfo::default().flags(vk::FenceCreateFlags::SIGNALED);
        // SAFETY: the device lives.
        let made = unsafe { device.raw().create_fence(&info, None) };
        let copied = Owned::new(device, "creating a fence", made)?;
        Ok(Swapchain {
            chain: None,
            is_stale: false,
            staging: None,
            commands: allocate_buffer(&pool)?,
            _pool: pool,
            copied,
            acquired: semaphore(device)?,
            functions: ash::khr::swapchain::Device::new(surface.instance().raw(), device.raw()),
            surface,
            is_surface_lost: false,
            losses: 0,
            device: Arc::clone(device),
        })
    }

    /// Width and height of the pictures that the window takes now; `usual` where it is the pictures that decide. `None`
    /// where it has no area, as when it is minimised.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], or another error of the driver.
    pub fn size(&mut self, usual: (u32, u32)) -> Result<Option<(u32, u32)>, BackendError> {
        loop {
            match self.try_size(usual) {
                Err(error) if self.is_lost_by(&error) => {}
                size => return size,
            }
        }
    }

    fn try_size(&mut self, usual: (u32, u32)) -> Result<Option<(u32, u32)>, BackendError> {
        if self.is_surface_lost {
            self.renew_surface()?;
        }
        let capabilities = self.surface.capabilities(&self.device)?;
        let extent = extent(&capabilities, usual);
        if extent.width == 0 || extent.height == 0 {
            self.chain = None;
            return Ok(None);
        }
        if self.is_stale || self.chain.as_ref().is_none_or(|chain| chain.extent != extent) {
            self.renew(&capabilities, extent)?;
        }
        Ok(Some((extent.width, extent.height)))
    }

    /// Shows a picture of the [size](Self::size) that the window takes: texels `0x00RRGGBB` in sRGB, row by row from
    /// the top.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], or another error of the driver.
    ///
    /// # Panics
    /// Where there are not `width * height` texels.
    pub fn show(&mut self, (width, height): (u32, u32), texels: &[u32]) -> Result<Shown, BackendError> {
        assert_eq!(texels.len() as u64, u64::from(width) * u64::from(height));
        let is_for_it = |chain: &Chain| (chain.extent.width, chain.extent.height) == (width, height);
        if self.is_stale || self.is_surface_lost || !self.chain.as_ref().is_some_and(is_for_it) {
            return Ok(Shown::NotYet);
        }
        match self.try_show(texels) {
            Err(error) if self.is_lost_by(&error) => Ok(Shown::NotYet),
            Ok(Shown::Yes) => {
                self.losses = 0;
                Ok(Shown::Yes)
            }
            other => other,
        }
    }

    fn try_show(&mut self, texels: &[u32]) -> Result<Shown, BackendError> {
        // Behind a long submission of the renderer the last copy may have to wait.
        if !self.is_copy_done(PATIENCE_NS)? {
            return Ok(Shown::NotYet);
        }
        let Some(index) = self.acquire()? else { return Ok(Shown::NotYet) };
        self.stage(texels)?;
        self.record(index)?;
        let device = Arc::clone(&self.device);
        // Both in one turn: a driver that presents by the host waits until all that was submitted is done, and would
        // wait for the renderer's next submission too.
        let (queue, _turn) = device.queue();
        self.submit(queue, index)?;
        self.present(queue, index)
    }

    /// The surface is of no more use: the next [`size`](Self::size) makes another.
    pub fn lose_surface(&mut self) {
        self.is_surface_lost = true;
    }

    /// Whether an error says no more than that the surface is lost, as it may be a few times.
    fn is_lost_by(&mut self, error: &BackendError) -> bool {
        let is_lost = is_surface_lost(error) && self.losses < MOST_LOSSES;
        if is_lost {
            self.losses += 1;
            self.lose_surface();
        }
        is_lost
    }

    fn renew_surface(&mut self) -> Result<(), BackendError> {
        // Swapchains go before their surface, and copies to their images before them.
        self.wait_for_copy()?;
        self.chain = None;
        self.surface.renew()?;
        let (physical, family) = (self.device.physical().raw, self.device.queue_family());
        // Also the new one may be lost already, which is no reason to end.
        let is_presented = self.surface.is_presented_by(physical, family).map_err(|source| {
            self.device.error("asking whether the device presents to the window", source)
        })?;
        if !is_presented {
            return Err(unfit("the device does not present to the window any more"));
        }
        self.is_surface_lost = false;
        Ok(())
    }

    /// Makes a swapchain for the window as it is now, in place of the present one.
    fn renew(
        &mut self,
        capabilities: &vk::SurfaceCapabilitiesKHR,
        extent: vk::Extent2D,
    ) -> Result<(), BackendError> {
        let device = Arc::clone(&self.device);
        let format = format(&self.surface.formats(&device)?)?;
        if !capabilities.supported_usage_flags.contains(vk::ImageUsageFlags::TRANSFER_DST) {
            return Err(unfit("the window's images cannot be copied to"));
        }
        let most = if capabilities.max_image_count == 0 { u32::MAX } else { capabilities.max_image_count };
        let opaque = vk::CompositeAlphaFlagsKHR::OPAQUE;
        let alpha = if capabilities.supported_composite_alpha.contains(opaque) {
            opaque
        } else {
            vk::CompositeAlphaFlagsKHR::INHERIT
        };
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(self.surface.raw())
            .min_image_count((capabilities.min_image_count + 1).min(most))
            .image_format(format.format)
            .image_color_space(format.color_space)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::TRANSFER_DST)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(capabilities.current_transform)
            .composite_alpha(alpha)
            .present_mode(present_mode(&self.surface.present_modes(&device)?))
            .clipped(true)
            .old_swapchain(self.chain.as_ref().map_or(vk::SwapchainKHR::null(), |chain| chain.raw));
        // SAFETY: the surface and the old chain live, and what is asked for is within what the surface offers.
        let raw = unsafe { self.functions.create_swapchain(&info, None) }
            .map_err(|source| device.error("making a swapchain", source))?;
        let functions = self.functions.clone();
        let is_rgba = is_rgba(format.format);
        let mut chain =
            Chain { raw, images: vec![], drawn: vec![], extent, is_rgba, functions, device: device.clone() };
        // SAFETY: the chain was just made.
        chain.images = unsafe { self.functions.get_swapchain_images(raw) }
            .map_err(|source| device.error("asking for a swapchain's images", source))?;
        chain.drawn = chain.images.iter().map(|_| semaphore(&device)).collect::<Result<_, _>>()?;
        // The copy that was submitted last is to an image of the old one.
        self.wait_for_copy()?;
        self.chain = Some(chain);
        self.is_stale = false;
        Ok(())
    }

    fn wait_for_copy(&self) -> Result<(), BackendError> {
        while !self.is_copy_done(1_000_000_000)? {}
        Ok(())
    }

    /// Whether the last copy is done within a time in nanoseconds.
    fn is_copy_done(&self, patience: u64) -> Result<bool, BackendError> {
        // SAFETY: the fence is of this device.
        match unsafe { self.device.raw().wait_for_fences(&[self.copied.raw()], true, patience) } {
            Ok(()) => Ok(true),
            Err(vk::Result::TIMEOUT) => Ok(false),
            Err(source) => Err(self.device.error("showing a picture", source)),
        }
    }

    /// The next image to copy to, if there is one soon.
    fn acquire(&mut self) -> Result<Option<u32>, BackendError> {
        let Some(chain) = &self.chain else { return Ok(None) };
        let semaphore = self.acquired.raw();
        // SAFETY: nothing waits for the semaphore: the submission that did is done.
        let acquired = unsafe {
            self.functions.acquire_next_image(chain.raw, PATIENCE_NS, semaphore, vk::Fence::null())
        };
        match acquired {
            Ok((index, suboptimal)) => {
                self.is_stale |= suboptimal;
                Ok(Some(index))
            }
            Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => Ok(None),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => {
                self.is_stale = true;
                Ok(None)
            }
            Err(source) => Err(self.device.error("asking for an image of the window", source)),
        }
    }

    /// Writes texels where the device copies them from. The last copy is done.
    fn stage(&mut self, texels: &[u32]) -> Result<(), BackendError> {
        let is_rgba = self.chain.as_ref().is_some_and(|chain| chain.is_rgba);
        let bytes = size_of_val(texels);
        if self.staging.as_ref().is_none_or(|staging| staging.mapped().len() < bytes) {
            self.staging = None;
        }
        let staging = match self.staging.take() {
            Some(staging) => staging,
            None => Buffer::for_upload(&self.device, bytes as u64)?,
        };
        let staging = self.staging.insert(staging);
        for (to, texel) in staging.mapped_mut().chunks_exact_mut(4).zip(texels) {
            let [blue, green, red, _] = texel.to_le_bytes();
            to.copy_from_slice(&if is_rgba { [red, green, blue, 255] } else { [blue, green, red, 255] });
        }
        Ok(())
    }

    fn record(&self, index: u32) -> Result<(), BackendError> {
        let (Some(chain), Some(staging)) = (&self.chain, &self.staging) else { return Ok(()) };
        let (device, image) = (self.device.raw(), chain.images[index as usize]);
        let failed = |source| self.device.error("showing a picture", source);
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the last submission was waited for, and beginning resets the buffer.
        unsafe { device.begin_command_buffer(self.commands, &info) }.map_err(failed)?;
        let (undefined, to_copy, to_show) = (
            vk::ImageLayout::UNDEFINED,
            vk::ImageLayout::TRANSFER_DST_OPTIMAL,
            vk::ImageLayout::PRESENT_SRC_KHR,
        );
        let (copy, end) = (vk::PipelineStageFlags::TRANSFER, vk::PipelineStageFlags::BOTTOM_OF_PIPE);
        let (none, write) = (vk::AccessFlags::empty(), vk::AccessFlags::TRANSFER_WRITE);
        // The copy's stage is the one that waits until the image is free.
        self.transition(image, (undefined, to_copy), (copy, copy), (none, write));
        let region = vk::BufferImageCopy::default()
            .image_subresource(
                vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1),
            )
            .image_extent(chain.extent.into());
        // SAFETY: the buffer holds as many texels as the image has, and the image is in this layout.
        unsafe {
            device.cmd_copy_buffer_to_image(self.commands, staging.raw(), image, to_copy, &[region]);
        };
        self.transition(image, (to_copy, to_show), (copy, end), (write, none));
        // SAFETY: the buffer is being recorded.
        unsafe { device.end_command_buffer(self.commands) }.map_err(failed)
    }

    fn transition(
        &self,
        image: vk::Image,
        (old, new): (vk::ImageLayout, vk::ImageLayout),
        (before, after): (vk::PipelineStageFlags, vk::PipelineStageFlags),
        (written, access): (vk::AccessFlags, vk::AccessFlags),
    ) {
        let all = vk::ImageSubresourceRange::default()
            .aspect_mask(vk::ImageAspectFlags::COLOR)
            .level_count(1)
            .layer_count(1);
        let barrier = [vk::ImageMemoryBarrier::default()
            .src_access_mask(written)
            .dst_access_mask(access)
            .old_layout(old)
            .new_layout(new)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(image)
            .subresource_range(all)];
        let flags = vk::DependencyFlags::empty();
        let device = self.device.raw();
        // SAFETY: the command buffer is being recorded, and the image is acquired.
        unsafe { device.cmd_pipeline_barrier(self.commands, before, after, flags, &[], &[], &barrier) };
    }

    fn submit(&self, queue: vk::Queue, index: u32) -> Result<(), BackendError> {
        let Some(chain) = &self.chain else { return Ok(()) };
        let failed = |source| self.device.error("showing a picture", source);
        let fences = [self.copied.raw()];
        // SAFETY: no submission that signals the fence is pending.
        unsafe { self.device.raw().reset_fences(&fences) }.map_err(failed)?;
        let (buffers, acquired) = ([self.commands], [self.acquired.raw()]);
        let drawn = [chain.drawn[index as usize].raw()];
        let submits = [vk::SubmitInfo::default()
            .wait_semaphores(&acquired)
            .wait_dst_stage_mask(&[vk::PipelineStageFlags::TRANSFER])
            .command_buffers(&buffers)
            .signal_semaphores(&drawn)];
        // SAFETY: the buffer is recorded and not pending, and what it uses lives until the fence is signalled.
        unsafe { self.device.raw().queue_submit(queue, &submits, fences[0]) }.map_err(failed)
    }

    fn present(&mut self, queue: vk::Queue, index: u32) -> Result<Shown, BackendError> {
        let Some(chain) = &self.chain else { return Ok(Shown::NotYet) };
        let (drawn, chains, indices) = ([chain.drawn[index as usize].raw()], [chain.raw], [index]);
        let info =
            vk::PresentInfoKHR::default().wait_semaphores(&drawn).swapchains(&chains).image_indices(&indices);
        // SAFETY: the image is acquired and in the layout to be presented; no one else uses the queue.
        let presented = unsafe { self.functions.queue_present(queue, &info) };
        let (shown, is_stale) =
            after_present(presented).map_err(|source| self.device.error("presenting a picture", source))?;
        self.is_stale |= is_stale;
        Ok(shown)
    }
}

/// What became of a picture, and whether the chain is to be made anew.
fn after_present(presented: ash::prelude::VkResult<bool>) -> ash::prelude::VkResult<(Shown, bool)> {
    match presented {
        Ok(is_suboptimal) => Ok((Shown::Yes, is_suboptimal)),
        // The screen has not seen it.
        Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok((Shown::NotYet, true)),
        Err(error) => Err(error),
    }
}

fn is_surface_lost(error: &BackendError) -> bool {
    matches!(error, BackendError::Vulkan { source: vk::Result::ERROR_SURFACE_LOST_KHR, .. })
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        // The chain waits too, but there may be none any more, or not yet.
        let _ = self.device.wait_idle();
    }
}

fn semaphore(device: &Arc<Device>) -> Result<Owned<vk::Semaphore>, BackendError> {
    // SAFETY: the device lives.
    let made = unsafe { device.raw().create_semaphore(&vk::SemaphoreCreateInfo::default(), None) };
    Owned::new(device, "creating a semaphore", made)
}

fn unfit(reason: &str) -> BackendError {
    BackendError::CannotPresent { reason: reason.to_owned() }
}

/// The size of a swapchain's images: the window's, or what the pictures are, as near as it may be.
fn extent(capabilities: &vk::SurfaceCapabilitiesKHR, (width, height): (u32, u32)) -> vk::Extent2D {
    let (min, max) = (capabilities.min_image_extent, capabilities.max_image_extent);
    match capabilities.current_extent {
        vk::Extent2D { width: u32::MAX, .. } => vk::Extent2D {
            width: width.max(min.width).min(max.width),
            height: height.max(min.height).min(max.height),
        },
        decided => decided,
    }
}

/// A format of four bytes. Texels are copied as they are, so that it does not matter whether it is for sRGB or not.
fn format(formats: &[vk::SurfaceFormatKHR]) -> Result<vk::SurfaceFormatKHR, BackendError> {
    let wanted = [
        vk::Format::B8G8R8A8_UNORM,
        vk::Format::B8G8R8A8_SRGB,
        vk::Format::R8G8B8A8_UNORM,
        vk::Format::R8G8B8A8_SRGB,
    ];
    let is_srgb = |format: &&vk::SurfaceFormatKHR| format.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR;
    let found = wanted
        .iter()
        .find_map(|&wanted| formats.iter().filter(is_srgb).find(|format| format.format == wanted));
    found.copied().ok_or_else(|| unfit("the window has no format of 8 bits a channel"))
}

fn is_rgba(format: vk::Format) -> bool {
    matches!(format, vk::Format::R8G8B8A8_UNORM | vk::Format::R8G8B8A8_SRGB)
}

/// Without tearing and without waiting for the screen, where the driver has that.
fn present_mode(modes: &[vk::PresentModeKHR]) -> vk::PresentModeKHR {
    let mailbox = vk::PresentModeKHR::MAILBOX;
    if modes.contains(&mailbox) { mailbox } else { vk::PresentModeKHR::FIFO }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn window_decides_its_size_unless_the_pictures_do() {
        let least = vk::Extent2D { width: 1, height: 1 };
        let most = vk::Extent2D { width: 4096, height: 100 };
        let capabilities = vk::SurfaceCapabilitiesKHR {
            current_extent: vk::Extent2D { width: 640, height: 480 },
            min_image_extent: least,
            max_image_extent: most,
            ..Default::default()
        };
        assert_eq!(extent(&capabilities, (7, 7)), vk::Extent2D { width: 640, height: 480 });
        let by_pictures = vk::Extent2D { width: u32::MAX, height: u32::MAX };
        let capabilities = vk::SurfaceCapabilitiesKHR { current_extent: by_pictures, ..capabilities };
        assert_eq!(extent(&capabilities, (800, 600)), vk::Extent2D { width: 800, height: 100 });
    }

    #[test]
    fn picture_for_another_size_was_not_shown() {
        assert_eq!(after_present(Ok(false)), Ok((Shown::Yes, false)));
        assert_eq!(after_present(Ok(true)), Ok((Shown::Yes, true)));
        assert_eq!(after_present(Err(vk::Result::ERROR_OUT_OF_DATE_KHR)), Ok((Shown::NotYet, true)));
        let (lost, gone) = (vk::Result::ERROR_SURFACE_LOST_KHR, vk::Result::ERROR_DEVICE_LOST);
        assert_eq!(after_present(Err(gone)), Err(gone));
        let error = |source| BackendError::Vulkan { what: "presenting a picture", source };
        assert!(is_surface_lost(&error(lost)) && !is_surface_lost(&error(gone)));
    }

    #[test]
    fn formats_are_of_four_bytes_in_srgb() {
        let of = |format, color_space| vk::SurfaceFormatKHR { format, color_space };
        let srgb = vk::ColorSpaceKHR::SRGB_NONLINEAR;
        let rgba = of(vk::Format::R8G8B8A8_UNORM, srgb);
        let wide = of(vk::Format::B8G8R8A8_UNORM, vk::ColorSpaceKHR::DISPLAY_P3_NONLINEAR_EXT);
        let ten = of(vk::Format::A2B10G10R10_UNORM_PACK32, srgb);
        assert_eq!(format(&[ten, wide, rgba]).unwrap(), rgba);
        assert!(is_rgba(rgba.format) && !is_rgba(wide.format));
        assert!(format(&[ten, wide]).unwrap_err().to_string().contains("8 bits a channel"));
    }
}

//! What a driver says of the code that it made of a pipeline, by VK_KHR_pipeline_executable_properties: registers,
//! spills and the like, under the driver's own names.

use super::device::Device;
use crate::backend::PipelineStatistic;
use ash::vk;

/// The statistics of a pipeline that was compiled with [`flags`], in the driver's order; none where the driver has
/// none to give, or fails to.
pub(super) fn of_pipeline(device: &Device, pipeline: vk::Pipeline) -> Vec<PipelineStatistic> {
    let Some(functions) = device.executable_properties() else { return Vec::new() };
    let info = vk::PipelineInfoKHR::default().pipeline(pipeline);
    // SAFETY: the extension and its feature are on, the pipeline is of this device.
    let executables = unsafe { functions.get_pipeline_executable_properties(&info) }.unwrap_or_default();
    let mut statistics = Vec::new();
    for (index, _) in (0..).zip(executables) {
        let info = vk::PipelineExecutableInfoKHR::default().pipeline(pipeline).executable_index(index);
        // SAFETY: as above, the pipeline has an executable of that number, and it captures statistics.
        let found = unsafe { functions.get_pipeline_executable_statistics(&info) }.unwrap_or_default();
        statistics.extend(found.iter().filter_map(|one| {
            let name = one.name_as_c_str().ok()?.to_string_lossy().into_owned();
            Some(PipelineStatistic { name, value: value(one)? })
        }));
    }
    statistics
}

/// What a pipeline has to be made with so that it has statistics.
pub(super) fn flags(device: &Device) -> vk::PipelineCreateFlags {
    if device.executable_properties().is_some() {
        vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR
    } else {
        vk::PipelineCreateFlags::empty()
    }
}

fn value(statistic: &vk::PipelineExecutableStatisticKHR<'_>) -> Option<f64> {
    use vk::PipelineExecutableStatisticFormatKHR as Format;
    let value = statistic.value;
    match statistic.format {
        // SAFETY: the format says that the driver wrote this member of the union.
        Format::BOOL32 => Some(f64::from(unsafe { value.b32 })),
        // SAFETY: as above.
        Format::INT64 => Some(unsafe { value.i64 } as f64),
        // SAFETY: as above.
        Format::UINT64 => Some(unsafe { value.u64 } as f64),
        // SAFETY: as above.
        Format::FLOAT64 => Some(unsafe { value.f64 }),
        _ => None,
    }
}

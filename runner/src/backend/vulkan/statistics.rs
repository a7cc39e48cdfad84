//! Statistics of compiled pipelines, by VK_KHR_pipeline_executable_properties: registers, spills and the like, under
//! the driver's own names.

use crate::backend::PipelineStatistic;
use ash::khr::pipeline_executable_properties as extension;
use ash::vk;

/// The statistics of a pipeline of the device that `functions` are of, in the driver's order; none where the driver
/// fails to give them. The pipeline must have been made with `CAPTURE_STATISTICS_KHR`.
pub(super) fn of_pipeline(functions: &extension::Device, pipeline: vk::Pipeline) -> Vec<PipelineStatistic> {
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

/// The number in a statistic; `None` where it is of a format that Vulkan did not have yet.
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

//! Compute pipelines: the compiled modules, a pipeline for each, and what is bound to it.

use super::buffer::Buffer;
use super::device::{Device, Owned};
use super::specialize::{instructions, let_contract, specialize};
use super::statistics;
use crate::backend::{BackendError, PipelineCode, PipelineStatistic};
use ash::vk;
use emboss_kernels::interface::{Batch, BuildStep, PyramidPart, SortPass, Tiles, binding, spec};
use emboss_kernels::scene::Features;
use std::ffi::CString;
use std::io::Cursor;
use std::sync::Arc;

/// How many storage buffers the hungriest kernel, `trace_rays`, binds.
pub(super) const MOST_BINDINGS: u32 = 23;

/// The bindings of a scene, which kernels that look at it have all of, and more.
macro_rules! scene_and {
    [$($more:expr),*] => {
        &[
            FRAME,
            VERTICES,
            TRIANGLES,
            NODES,
            PRIMITIVES,
            DISPLACEMENTS,
            HEIGHT_TEXELS,
            HEIGHT_RANGES,
            SEAMS,
            SEAM_SIDES,
            COLOR_TEXELS,
            LIGHTS,
            MATERIALS,
            TANGENTS,
            TEXEL_SCALES,
            INSTANCES,
            NORMAL_TEXELS,
            MICRO_VERTICES,
            DISTANCES,
            PRISM_TREE,
            $($more),*
        ]
    };
}

/// Declares [`Kernel`] from entry points and their names.
macro_rules! kernels {
    ($($kernel:ident: $entry_point:literal,)*) => {
        /// An entry point of the kernels, compiled by rust-gpu into a module of its own: what is made of a module takes
        /// a time that grows with all that is in it.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(super) enum Kernel {
            $($kernel,)*
        }

        impl Kernel {
            #[cfg(test)]
            const ALL: &[Kernel] = &[$(Kernel::$kernel,)*];

            fn entry_point(self) -> &'static str {
                match self {
                    $(Kernel::$kernel => $entry_point,)*
                }
            }

            fn module(self) -> &'static [u8] {
                match self {
                    $(Kernel::$kernel => {
                        include_bytes!(concat!("../../../../assets/kernels/", $entry_point, ".spv"))
                    })*
                }
            }
        }
    };
}

kernels! {
    Render: "render",
    Resolve: "resolve",
    TraceRays: "trace_rays",
    HeightPyramid: "height_pyramid",
    BoundHeights: "bound_heights",
    DecideSeams: "decide_seams",
    PrismBounds: "prism_bounds",
    Tessellate: "tessellate",
    TessellateBounds: "tessellate_bounds",
    TreeMicroVertices: "tree_micro_vertices",
    TreeFrames: "tree_frames",
    TreeBlocks: "tree_blocks",
    TreeNodes: "tree_nodes",
    TreeUpperNodes: "tree_upper_nodes",
    DistanceColumns: "distance_columns",
    DistanceMap: "distance_map",
    Probe: "probe",
    SumBlocks: "sum_blocks",
    ScanSerially: "scan_serially",
    ScanBlocks: "scan_blocks",
    CountDigits: "count_digits",
    ScatterPairs: "scatter_pairs",
    BvhCenters: "bvh_centers",
    BvhCodes: "bvh_codes",
    BvhLevels: "bvh_levels",
    BvhThreshold: "bvh_threshold",
    BvhSingles: "bvh_singles",
    BvhFlags: "bvh_flags",
    BvhTreelets: "bvh_treelets",
    BvhStart: "bvh_start",
    BvhChoose: "bvh_choose",
    BvhMove: "bvh_move",
    BvhSmall: "bvh_small",
    BvhRefit: "bvh_refit",
    BvhCosts: "bvh_costs",
}

impl Kernel {
    /// What the device is doing while it runs, for messages.
    pub(super) fn activity(self) -> &'static str {
        match self {
            Kernel::Render => "rendering",
            Kernel::Resolve => "resolving the picture",
            Kernel::TraceRays => "tracing rays",
            Kernel::HeightPyramid => "bounding the height maps",
            Kernel::BoundHeights => "bounding the triangles' heights",
            Kernel::DecideSeams => "deciding the seams",
            Kernel::PrismBounds => "bounding the displaced triangles",
            Kernel::Tessellate => "displacing micro-vertices",
            Kernel::TessellateBounds => "bounding micro-triangles",
            Kernel::TreeMicroVertices
            | Kernel::TreeFrames
            | Kernel::TreeBlocks
            | Kernel::TreeNodes
            | Kernel::TreeUpperNodes => "storing bounds",
            Kernel::DistanceColumns | Kernel::DistanceMap => "mapping distances",
            Kernel::Probe => "probing a kernel",
            Kernel::SumBlocks | Kernel::ScanSerially | Kernel::ScanBlocks => "scanning",
            Kernel::CountDigits | Kernel::ScatterPairs => "sorting",
            Kernel::BvhCenters
            | Kernel::BvhCodes
            | Kernel::BvhLevels
            | Kernel::BvhThreshold
            | Kernel::BvhFlags
            | Kernel::BvhTreelets
            | Kernel::BvhStart
            | Kernel::BvhChoose
            | Kernel::BvhSingles
            | Kernel::BvhSmall
            | Kernel::BvhMove => "building the BVH",
            Kernel::BvhRefit => "refitting the BVH",
            Kernel::BvhCosts => "measuring the BVH",
        }
    }

    /// The bindings of its parameters in `entry.rs`. Each kernel has a layout of its own, since a device need not
    /// offer all of them at once.
    fn bindings(self) -> &'static [u32] {
        use binding::*;
        match self {
            Kernel::Render => scene_and![FILM, COUNTERS],
            Kernel::Resolve => &[FRAME, FILM, PICTURE],
            Kernel::TraceRays => scene_and![RAYS, INTERSECTIONS, COUNTERS],
            Kernel::HeightPyramid => &[DISPLACEMENTS, HEIGHT_TEXELS, HEIGHT_RANGES],
            Kernel::BoundHeights
            | Kernel::DecideSeams
            | Kernel::Tessellate
            | Kernel::TreeMicroVertices
            | Kernel::TreeFrames
            | Kernel::TreeBlocks => scene_and![],
            Kernel::TreeNodes => &[FRAME, PRISM_TREE],
            Kernel::TreeUpperNodes => &[FRAME, NODES, PRIMITIVES, PRISM_TREE],
            Kernel::DistanceColumns => &[DISPLACEMENTS, HEIGHT_TEXELS, HEIGHT_RANGES, DISTANCES],
            Kernel::DistanceMap => &[DISPLACEMENTS, DISTANCES],
            Kernel::TessellateBounds => &[FRAME, MICRO_VERTICES, BOXES],
            Kernel::PrismBounds => scene_and![BOXES],
            Kernel::Probe => &[PROBE_IN, PROBE_OUT],
            Kernel::ScanSerially => &[SCAN_VALUES],
            Kernel::SumBlocks | Kernel::ScanBlocks => &[SCAN_VALUES, SCAN_SUMS],
            Kernel::CountDigits => &[SORT_KEYS, SORT_COUNTS],
            Kernel::ScatterPairs => &[SORT_KEYS, SORT_VALUES, SORT_COUNTS],
            Kernel::BvhCenters => &[BOXES, BUILD_STATE],
            Kernel::BvhCodes => &[BOXES, BUILD_STATE, SORT_KEYS, SORT_VALUES],
            Kernel::BvhLevels => &[BUILD_STATE, SORT_KEYS, SPLIT_LEVELS],
            Kernel::BvhSingles => &[BOXES, TREELETS, PRIMITIVES],
            Kernel::BvhThreshold
            | Kernel::BvhStart
            | Kernel::BvhChoose
            | Kernel::BvhMove
            | Kernel::BvhSmall => &[
                BUILD_STATE,
                TREELETS,
                TREELET_TASKS,
                TASKS,
                TASK_QUEUES,
                BINS,
                SMALL_TASKS,
                TREELET_LISTS,
                NODES,
                PARENTS,
            ],
            Kernel::BvhFlags => &[BUILD_STATE, SPLIT_LEVELS, SCAN_VALUES],
            Kernel::BvhTreelets => &[
                BOXES,
                BUILD_STATE,
                SORT_VALUES,
                SPLIT_LEVELS,
                SCAN_VALUES,
                ARRIVALS,
                PARENTS,
                TREELETS,
                NODES,
                PRIMITIVES,
            ],
            Kernel::BvhRefit => &[BOXES, BUILD_STATE, ARRIVALS, PARENTS, NODES, PRIMITIVES],
            Kernel::BvhCosts => &[BUILD_STATE, NODES, COSTS],
        }
    }

    fn push_constant_bytes(self) -> usize {
        match self {
            Kernel::Render | Kernel::Resolve => size_of::<Tiles>(),
            Kernel::TraceRays
            | Kernel::BoundHeights
            | Kernel::DecideSeams
            | Kernel::PrismBounds
            | Kernel::Tessellate
            | Kernel::TessellateBounds
            | Kernel::TreeMicroVertices
            | Kernel::TreeFrames
            | Kernel::TreeBlocks
            | Kernel::TreeNodes
            | Kernel::TreeUpperNodes
            | Kernel::DistanceColumns
            | Kernel::DistanceMap
            | Kernel::Probe => size_of::<Batch>(),
            Kernel::HeightPyramid => size_of::<PyramidPart>(),
            Kernel::SumBlocks | Kernel::ScanSerially | Kernel::ScanBlocks => size_of::<u32>(),
            Kernel::CountDigits | Kernel::ScatterPairs => size_of::<SortPass>(),
            Kernel::BvhCenters
            | Kernel::BvhCodes
            | Kernel::BvhLevels
            | Kernel::BvhFlags
            | Kernel::BvhTreelets
            | Kernel::BvhChoose
            | Kernel::BvhThreshold
            | Kernel::BvhSingles
            | Kernel::BvhSmall
            | Kernel::BvhMove => size_of::<BuildStep>(),
            Kernel::BvhStart | Kernel::BvhRefit | Kernel::BvhCosts => 0,
        }
    }

    /// Its module for those features: see [`specialize`].
    fn specialized(self, features: Features) -> Result<Vec<u32>, String> {
        // The bytes of a file have no alignment; words do.
        let words =
            ash::util::read_spv(&mut Cursor::new(self.module())).map_err(|error| error.to_string())?;
        if self.spec_constants().is_empty() {
            return Ok(words);
        }
        specialize(&words, &features.to_array()).map_err(|error| error.to_string())
    }

    /// What is to be said of its module, specialised.
    fn code(self, words: &[u32], statistics: Vec<PipelineStatistic>) -> PipelineCode {
        let code = PipelineCode {
            kernel: self.entry_point(),
            instructions: instructions(words),
            bytes: size_of_val(words) as u64,
            bytes_of_all: self.module().len() as u64,
            statistics,
        };
        tracing::debug!(
            "{}: {} of {} bytes of SPIR-V are left for these features, {} instructions",
            code.kernel,
            code.bytes,
            code.bytes_of_all,
            code.instructions
        );
        code
    }

    /// Ids of the specialisation constants that it has.
    fn spec_constants(self) -> &'static [u32] {
        use spec::*;
        match self {
            Kernel::Render => &[
                METHOD,
                SHADE,
                SHADOWS,
                HEIGHT_FORMAT,
                COLOR_FORMAT,
                HEIGHT_WRAP,
                COLOR_WRAP,
                COUNTERS,
                NORMALS,
                SEAMS,
                SMOOTH,
                DISPLACEMENT,
                FILTER,
                ADAPTIVE,
                INSTANCES,
                BOUNDS,
            ],
            Kernel::TraceRays => &[
                METHOD,
                HEIGHT_FORMAT,
                HEIGHT_WRAP,
                COUNTERS,
                NORMALS,
                SEAMS,
                DISPLACEMENT,
                FILTER,
                ADAPTIVE,
                INSTANCES,
                BOUNDS,
            ],
            Kernel::HeightPyramid | Kernel::DistanceColumns => &[HEIGHT_FORMAT, HEIGHT_WRAP],
            Kernel::DistanceMap => &[HEIGHT_WRAP],
            Kernel::BoundHeights | Kernel::DecideSeams => &[HEIGHT_FORMAT, HEIGHT_WRAP, DISPLACEMENT, FILTER],
            Kernel::PrismBounds => {
                &[METHOD, SHADE, HEIGHT_FORMAT, HEIGHT_WRAP, NORMALS, SEAMS, DISPLACEMENT, FILTER]
            }
            Kernel::Tessellate | Kernel::TreeMicroVertices => {
                &[HEIGHT_FORMAT, HEIGHT_WRAP, NORMALS, SEAMS, DISPLACEMENT]
            }
            Kernel::TreeFrames => &[SEAMS],
            Kernel::TreeBlocks => &[HEIGHT_FORMAT, HEIGHT_WRAP, NORMALS, SEAMS, DISPLACEMENT, BOUNDS],
            _ => &[],
        }
    }

    /// Whether its code is the same for both features.
    pub(super) fn is_alike(self, a: Features, b: Features) -> bool {
        let (a, b) = (a.to_array(), b.to_array());
        self.spec_constants().iter().all(|&id| a[id as usize] == b[id as usize])
    }
}

/// A kernel ready to be dispatched, compiled for some features, with one descriptor set.
pub(super) struct Pipeline {
    kernel: Kernel,
    code: PipelineCode,
    raw: Owned<vk::Pipeline>,
    layout: Owned<vk::PipelineLayout>,
    set: vk::DescriptorSet,
    /// Owns the memory of `set`.
    _pool: Owned<vk::DescriptorPool>,
    /// Not used after `set` is made, but some drivers look at it while a set of this layout is written.
    _set_layout: Owned<vk::DescriptorSetLayout>,
}

impl Pipeline {
    /// Compiles `kernel` with the specialisation constants that `features` give.
    pub(super) fn new(
        device: &Arc<Device>,
        kernel: Kernel,
        features: Features,
    ) -> Result<Self, BackendError> {
        Pipeline::of_words(device, kernel, kernel.specialized(features))
    }

    /// The same, which the driver may contract: see [`let_contract`].
    pub(super) fn contractible(
        device: &Arc<Device>,
        kernel: Kernel,
        features: Features,
    ) -> Result<Self, BackendError> {
        let words = kernel.specialized(features);
        let words = words.and_then(|words| let_contract(&words).map_err(|error| error.to_string()));
        Pipeline::of_words(device, kernel, words)
    }

    /// The pipeline of a specialised module, which may have been found to be damaged.
    fn of_words(
        device: &Arc<Device>,
        kernel: Kernel,
        words: Result<Vec<u32>, String>,
    ) -> Result<Self, BackendError> {
        let words = words.map_err(|reason| {
            tracing::error!("the built-in kernel {} is damaged: {reason}", kernel.entry_point());
            let source = vk::Result::ERROR_INITIALIZATION_FAILED;
            BackendError::Vulkan { what: "reading the kernels", source }
        })?;
        let set_layout = set_layout(device, kernel)?;
        let layout = pipeline_layout(&set_layout, kernel)?;
        let raw = compile(&layout, kernel, &words)?;
        let pool = descriptor_pool(device, kernel)?;
        let set = allocate_set(&pool, &set_layout)?;
        let statistics = device
            .executable_properties()
            .map_or_else(Vec::new, |functions| statistics::of_pipeline(functions, raw.raw()));
        let code = kernel.code(&words, statistics);
        Ok(Pipeline { kernel, code, raw, layout, set, _pool: pool, _set_layout: set_layout })
    }

    /// Binds the buffer that `buffer_at` gives for each binding of the kernel. No submission may be pending, which
    /// holds between two runs of `Commands`.
    pub(super) fn bind<'a>(&self, buffer_at: impl Fn(u32) -> &'a Buffer) {
        let bindings = self.kernel.bindings();
        let infos: Vec<_> = bindings
            .iter()
            .map(|&binding| {
                let buffer = buffer_at(binding);
                [vk::DescriptorBufferInfo::default().buffer(buffer.raw()).range(vk::WHOLE_SIZE)]
            })
            .collect();
        let writes: Vec<_> = bindings
            .iter()
            .zip(&infos)
            .map(|(&binding, info)| {
                vk::WriteDescriptorSet::default()
                    .dst_set(self.set)
                    .dst_binding(binding)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .buffer_info(info)
            })
            .collect();
        // SAFETY: set and buffers are of this device, and no submission that uses the set is pending.
        unsafe { self.raw.device().raw().update_descriptor_sets(&writes, &[]) };
    }

    /// What it runs.
    pub(super) fn code(&self) -> PipelineCode {
        self.code.clone()
    }

    pub(super) fn raw(&self) -> vk::Pipeline {
        self.raw.raw()
    }

    pub(super) fn layout(&self) -> vk::PipelineLayout {
        self.layout.raw()
    }

    pub(super) fn set(&self) -> vk::DescriptorSet {
        self.set
    }
}

fn set_layout(device: &Arc<Device>, kernel: Kernel) -> Result<Owned<vk::DescriptorSetLayout>, BackendError> {
    let bindings: Vec<_> = kernel
        .bindings()
        .iter()
        .map(|&binding| {
            vk::DescriptorSetLayoutBinding::default()
                .binding(binding)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                .descriptor_count(1)
                .stage_flags(vk::ShaderStageFlags::COMPUTE)
        })
        .collect();
    let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
    // SAFETY: `info` is complete and the device lives.
    let made = unsafe { device.raw().create_descriptor_set_layout(&info, None) };
    Owned::new(device, "creating a descriptor set layout", made)
}

fn pipeline_layout(
    set_layout: &Owned<vk::DescriptorSetLayout>,
    kernel: Kernel,
) -> Result<Owned<vk::PipelineLayout>, BackendError> {
    let device = set_layout.device();
    let sets = [set_layout.raw()];
    let push_constants = [vk::PushConstantRange::default()
        .stage_flags(vk::ShaderStageFlags::COMPUTE)
        .size(small(kernel.push_constant_bytes()))];
    // An empty range is not allowed.
    let ranges = if kernel.push_constant_bytes() > 0 { &push_constants[..] } else { &[] };
    let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(ranges);
    // SAFETY: the set layout is of this device.
    let made = unsafe { device.raw().create_pipeline_layout(&info, None) };
    Owned::new(device, "creating a pipeline layout", made)
}

fn compile(
    layout: &Owned<vk::PipelineLayout>,
    kernel: Kernel,
    words: &[u32],
) -> Result<Owned<vk::Pipeline>, BackendError> {
    let device = layout.device();
    let module = shader_module(device, words)?;
    let name = CString::new(kernel.entry_point()).unwrap_or_default();
    let stage = vk::PipelineShaderStageCreateInfo::default()
        .stage(vk::ShaderStageFlags::COMPUTE)
        .module(module.raw())
        .name(&name);
    let flags = match device.executable_properties() {
        Some(_) => vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR,
        None => vk::PipelineCreateFlags::empty(),
    };
    let info = vk::ComputePipelineCreateInfo::default().layout(layout.raw()).stage(stage).flags(flags);
    // SAFETY: module and layout are of this device, and `info` lives through the call.
    let made = unsafe { device.raw().create_compute_pipelines(vk::PipelineCache::null(), &[info], None) };
    // One pipeline was asked for: an error brings a single null handle, which needs no destruction.
    let made = made.map(|pipelines| pipelines[0]).map_err(|(_, error)| error);
    Owned::new(device, "compiling a kernel", made)
}

fn shader_module(device: &Arc<Device>, words: &[u32]) -> Result<Owned<vk::ShaderModule>, BackendError> {
    let info = vk::ShaderModuleCreateInfo::default().code(words);
    // SAFETY: the module is what rust-gpu compiled, and spirv-val accepted, specialised.
    let made = unsafe { device.raw().create_shader_module(&info, None) };
    Owned::new(device, "creating the shader module", made)
}

fn descriptor_pool(device: &Arc<Device>, kernel: Kernel) -> Result<Owned<vk::DescriptorPool>, BackendError> {
    let sizes = [vk::DescriptorPoolSize::default()
        .ty(vk::DescriptorType::STORAGE_BUFFER)
        .descriptor_count(small(kernel.bindings().len()))];
    let info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
    // SAFETY: `info` is complete and the device lives.
    let made = unsafe { device.raw().create_descriptor_pool(&info, None) };
    Owned::new(device, "creating a descriptor pool", made)
}

fn allocate_set(
    pool: &Owned<vk::DescriptorPool>,
    layout: &Owned<vk::DescriptorSetLayout>,
) -> Result<vk::DescriptorSet, BackendError> {
    let device = pool.device();
    let layouts = [layout.raw()];
    let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool.raw()).set_layouts(&layouts);
    // SAFETY: pool and layout are of this device, and the pool has room for one such set.
    let sets = unsafe { device.raw().allocate_descriptor_sets(&info) }
        .map_err(|source| device.error("allocating a descriptor set", source))?;
    Ok(sets[0])
}

/// A count of a few dozen as `u32`.
fn small(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::super::device::tests::validated_lavapipe;
    use super::super::specialize::tests::choices;
    use super::*;
    use serde_json::Value;
    use std::collections::BTreeSet;

    #[test]
    fn no_kernel_binds_more_than_is_asked_of_a_device() {
        let most = Kernel::ALL.iter().map(|kernel| kernel.bindings().len()).max();
        assert_eq!(most, Some(MOST_BINDINGS as usize));
    }

    /// What is left of a kernel is sound SPIR-V, for all methods: the validation layers look at each module with
    /// spirv-val.
    #[test]
    fn specialised_modules_are_sound() {
        let device = validated_lavapipe();
        let log = device.instance().log().clone();
        let mut seen: Vec<(Kernel, Features)> = Vec::new();
        // Each method once, with other features than its neighbours.
        let choices = choices();
        for features in (0..16).map(|method| choices[method + 16 * (method % 3)]) {
            for &kernel in Kernel::ALL {
                if seen.iter().any(|&(other, had)| other == kernel && kernel.is_alike(had, features)) {
                    continue;
                }
                seen.push((kernel, features));
                let words = kernel.specialized(features).unwrap();
                let made = shader_module(&device, &words);
                assert!(made.is_ok() && log.messages().is_empty(), "{kernel:?}: {features:?}");
            }
        }
        assert!(seen.iter().any(|(kernel, features)| *kernel == Kernel::Render && features.method == 15));
    }

    /// The numbers in a JSON array, or those that the keys of an object are.
    fn numbers(json: &Value) -> BTreeSet<u32> {
        let array = json.as_array().into_iter().flatten().map(Value::to_string);
        let keys = json.as_object().into_iter().flat_map(serde_json::Map::keys).cloned();
        array.chain(keys).map(|number| number.parse().unwrap()).collect()
    }

    #[test]
    fn kernels_are_the_entry_points_of_the_manifest() {
        let manifest: Value = serde_json::from_str(include_str!("../../../../assets/kernels.json")).unwrap();
        let modules = manifest["modules"].as_object().unwrap();
        let names: BTreeSet<_> = Kernel::ALL.iter().map(|kernel| kernel.entry_point()).collect();
        assert_eq!(names, modules.keys().map(String::as_str).collect());
        for kernel in Kernel::ALL {
            let module = &modules[kernel.entry_point()];
            assert_eq!(module["size_bytes"], kernel.module().len(), "{kernel:?}");
            let ids = numbers(&module["contents"]["spec_constants"]);
            assert_eq!(ids, kernel.spec_constants().iter().copied().collect(), "{kernel:?}");
            // A parameter that the compiler found unused is not in the module.
            let bindings = kernel.bindings().iter().copied().collect();
            assert!(numbers(&module["contents"]["bindings"]).is_subset(&bindings), "{kernel:?}");
        }
    }
}

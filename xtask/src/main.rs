//! Emboss's own build steps.
use spirv_builder::{Capability, SpirvBuilder};

fn main() {
    let mut builder = SpirvBuilder::new("kernels", "spirv-unknown-vulkan1.2");
    builder.toolchain_overwrite = Some("rust-gpu-1.96".into());
    let home = std::env::var("HOME").unwrap();
    builder.rustc_codegen_spirv_location =
        Some(format!("{home}/.local/share/rust-gpu-1.96/lib/librustc_codegen_spirv.so").into());
    builder
        .capabilities
        .push(Capability::VulkanMemoryModelDeviceScope);
    let module = builder.build().unwrap();
    std::fs::copy(module.module.unwrap_single(), "assets/kernels.spv").unwrap();
}

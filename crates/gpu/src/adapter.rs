//! The adapters of a machine, and the choice among them.

use crate::GpuError;
#[cfg(not(target_arch = "wasm32"))]
use crate::wait::block_on;

/// Which adapter a device is made from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Choice {
    /// The first hardware adapter that lacks nothing, discrete before integrated; never a software one.
    #[default]
    Hardware,
    /// Hardware if there is any, else a software one.
    Any,
    /// The first adapter whose name or driver holds this text, in any case.
    Named(String),
}

impl Choice {
    fn phrase(&self) -> String {
        match self {
            Self::Hardware => "in hardware".into(),
            Self::Any => "of any kind".into(),
            Self::Named(name) => format!("whose name holds \"{name}\""),
        }
    }
}

/// What kind of device an adapter is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdapterKind {
    /// A card with memory of its own.
    Discrete,
    /// Part of the processor.
    Integrated,
    /// Hardware behind a virtual machine.
    Virtual,
    /// The processor, through a software driver.
    Software,
    /// The driver does not say.
    Other,
}

impl AdapterKind {
    fn of(kind: wgpu::DeviceType) -> Self {
        match kind {
            wgpu::DeviceType::DiscreteGpu => Self::Discrete,
            wgpu::DeviceType::IntegratedGpu => Self::Integrated,
            wgpu::DeviceType::VirtualGpu => Self::Virtual,
            wgpu::DeviceType::Cpu => Self::Software,
            wgpu::DeviceType::Other => Self::Other,
        }
    }

    /// Lower is preferred.
    fn rank(self) -> u32 {
        match self {
            Self::Discrete => 0,
            Self::Integrated => 1,
            Self::Virtual => 2,
            Self::Other => 3,
            Self::Software => 4,
        }
    }
}

/// What is known of an adapter.
#[derive(Clone, Debug, PartialEq)]
pub struct AdapterReport {
    /// Name by the driver.
    pub name: String,
    /// Kind of device.
    pub kind: AdapterKind,
    /// Vulkan, Metal, DirectX 12, or WebGPU in a browser.
    pub backend: String,
    /// Driver and its version.
    pub driver: String,
    /// Largest buffer that a kernel can bind, in bytes.
    pub largest_binding: u64,
    /// Largest buffer at all, in bytes.
    pub largest_buffer: u64,
    /// Storage buffers that a kernel can bind.
    pub storage_buffers: u32,
    /// Shared memory of a workgroup, in bytes.
    pub workgroup_memory: u32,
    /// Smallest and largest size of a subgroup.
    pub subgroups: [u32; 2],
    /// What the adapter lacks of what kernels or profiles use.
    pub lacks: Vec<String>,
}

/// Most storage buffers that a kernel binds; WebGPU promises 8.
pub(crate) const STORAGE_BUFFERS: u32 = 9;
/// What an adapter may lack.
const TIMESTAMPS: &str = "timestamps (profiles only)";
const WIDE: &str = "additions of 64-bit words (sums take longer)";
/// What a device must have to add words of 64 bits in memory.
pub(crate) const WIDE_WORDS: wgpu::Features =
    wgpu::Features::SHADER_INT64.union(wgpu::Features::SHADER_INT64_ATOMIC_ALL_OPS);
const WORKGROUP_MEMORY: u32 = 16 << 10;

impl AdapterReport {
    /// The first thing missing without which no kernel runs.
    pub fn missing(&self) -> Option<&str> {
        self.lacks.iter().map(String::as_str).find(|l| ![TIMESTAMPS, WIDE].contains(l))
    }

    fn new(adapter: &wgpu::Adapter) -> Self {
        let (info, limits) = (adapter.get_info(), adapter.limits());
        let mut lacks = Vec::new();
        if limits.max_storage_buffers_per_shader_stage < STORAGE_BUFFERS {
            lacks.push(format!("{STORAGE_BUFFERS} storage buffers a kernel"));
        }
        if limits.max_compute_workgroup_storage_size < WORKGROUP_MEMORY {
            lacks.push(format!("{WORKGROUP_MEMORY} bytes of workgroup memory"));
        }
        if limits.max_compute_invocations_per_workgroup < 256 {
            lacks.push("256 lanes a workgroup".into());
        }
        if !adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            lacks.push(TIMESTAMPS.into());
        }
        if !adapter.features().contains(WIDE_WORDS) {
            lacks.push(WIDE.into());
        }
        Self {
            kind: AdapterKind::of(info.device_type),
            backend: info.backend.to_string(),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            // Browsers tell none.
            name: if info.name.is_empty() { "an adapter without a name".into() } else { info.name },
            largest_binding: limits.max_storage_buffer_binding_size,
            largest_buffer: limits.max_buffer_size,
            storage_buffers: limits.max_storage_buffers_per_shader_stage,
            workgroup_memory: limits.max_compute_workgroup_storage_size,
            subgroups: [info.subgroup_min_size, info.subgroup_max_size],
            lacks,
        }
    }
}

/// Drivers that are asked for adapters, by the flags that they need. OpenGL is left out: it lacks what kernels need.
const ASKED: [wgpu::Backends; 2] =
    [wgpu::Backends::PRIMARY.difference(wgpu::Backends::DX12), wgpu::Backends::DX12];

/// The flags of an instance for some backends. The numbers of workgroups that kernels count are within the limits by
/// construction; checking them would cost a dispatch and three barriers before each. But without that check
/// `num_workgroups` is 0 in indirect dispatches of DirectX 12, by which kernels number their groups and step.
fn flags(backends: wgpu::Backends) -> wgpu::InstanceFlags {
    let all = wgpu::InstanceFlags::default();
    if backends.contains(wgpu::Backends::DX12) {
        return all | wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL;
    }
    all - wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL
}

/// What a driver checks while kernels run. Loops of kernels count up to a bound and are not counted once more, but with
/// DirectX 12: their steps are numbers of groups, which are right there by [`flags`] alone.
pub(crate) fn checks(backend: wgpu::Backend) -> wgpu::ShaderRuntimeChecks {
    wgpu::ShaderRuntimeChecks {
        force_loop_bounding: backend == wgpu::Backend::Dx12,
        ..wgpu::ShaderRuntimeChecks::default()
    }
}

async fn enumerate() -> Vec<(AdapterReport, wgpu::Adapter)> {
    let mut found = Vec::new();
    let here = wgpu::Instance::enabled_backend_features();
    for backends in ASKED.into_iter().filter(|b| b.intersects(here)) {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends,
            flags: flags(backends),
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let adapters = instance.enumerate_adapters(wgpu::Backends::all()).await;
        found.extend(adapters.into_iter().map(|a| (AdapterReport::new(&a), a)));
    }
    found.sort_by_key(|(report, _)| report.kind.rank());
    found
}

/// All adapters, the preferred kinds first. A browser is asked by [`adapters_found`].
#[cfg(not(target_arch = "wasm32"))]
pub fn adapters() -> Vec<AdapterReport> {
    block_on(adapters_found())
}

/// [`adapters()`] without blocking the thread.
pub async fn adapters_found() -> Vec<AdapterReport> {
    enumerate().await.into_iter().map(|(report, _)| report).collect()
}

/// The adapter of a choice.
pub(crate) async fn choose(choice: &Choice) -> Result<(AdapterReport, wgpu::Adapter), GpuError> {
    let all = enumerate().await;
    let names: Vec<_> = all.iter().map(|(r, _)| format!("{} ({:?})", r.name, r.kind)).collect();
    let fits = |r: &AdapterReport| match choice {
        Choice::Hardware => r.kind != AdapterKind::Software,
        Choice::Any => true,
        Choice::Named(text) => {
            let text = text.to_lowercase();
            r.name.to_lowercase().contains(&text) || r.driver.to_lowercase().contains(&text)
        }
    };
    let mut fitting: Vec<_> = all.into_iter().filter(|(r, _)| fits(r)).collect();
    // Who lacks something is refused by name where there is nobody else.
    fitting.sort_by_key(|(r, _)| r.missing().is_some());
    fitting.into_iter().next().ok_or_else(|| GpuError::NoAdapter {
        wanted: choice.phrase(),
        found: if names.is_empty() { "none".into() } else { names.join(", ") },
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use wgpu::{Backend, Backends, InstanceFlags};

    #[test]
    fn numbers_of_groups_are_right_in_indirect_dispatches_of_every_backend() {
        let all = ASKED.into_iter().fold(Backends::empty(), |all, b| all | b);
        assert_eq!(all, Backends::PRIMARY, "each primary backend is asked");
        for backends in ASKED {
            let validated = flags(backends).contains(InstanceFlags::VALIDATION_INDIRECT_CALL);
            assert_eq!(validated, backends == Backends::DX12, "{backends:?}: that one alone");
            assert!(backends == Backends::DX12 || !backends.contains(Backends::DX12), "{backends:?}");
        }
        assert!(checks(Backend::Dx12).force_loop_bounding);
        for backend in [Backend::Vulkan, Backend::Metal, Backend::BrowserWebGpu] {
            assert!(!checks(backend).force_loop_bounding && checks(backend).bounds_checks, "{backend:?}");
        }
    }
}

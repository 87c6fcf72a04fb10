//! A device with its queue and its compiled kernels.

use crate::GpuError;
use crate::adapter::{AdapterReport, Choice, choose};
use crate::kernel::{Kernel, Reflection};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// A device; clones share it.
#[derive(Clone, Debug)]
pub struct Gpu(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    device: wgpu::Device,
    queue: wgpu::Queue,
    report: AdapterReport,
    timestamps: bool,
    /// Compiled kernels by name and entry point.
    compiled: Mutex<HashMap<(&'static str, &'static str), Compiled>>,
    /// The first error that no call could return.
    failure: Arc<Mutex<Option<GpuError>>>,
}

/// A kernel on a device.
#[derive(Clone, Debug)]
pub(crate) struct Compiled {
    pub(crate) pipeline: wgpu::ComputePipeline,
    pub(crate) layout: wgpu::BindGroupLayout,
    pub(crate) reflection: Reflection,
}

impl Gpu {
    /// Opens a device.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] or [`GpuError::NoDevice`].
    pub fn new(choice: &Choice) -> Result<Self, GpuError> {
        let (report, adapter) = choose(choice)?;
        let no_device = |reason: String| GpuError::NoDevice { adapter: report.name.clone(), reason };
        if let Some(lack) = report.missing() {
            return Err(no_device(format!("it lacks {lack}")));
        }
        let timestamps = adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let features = if timestamps { wgpu::Features::TIMESTAMP_QUERY } else { wgpu::Features::empty() };
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("photofit"),
            required_features: features,
            required_limits: adapter.limits(),
            ..wgpu::DeviceDescriptor::default()
        });
        let (device, queue) = pollster::block_on(request).map_err(|e| no_device(e.to_string()))?;
        let failure = Arc::new(Mutex::new(None));
        let keep = |failure: &Arc<Mutex<Option<GpuError>>>, error: GpuError| {
            failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        };
        let kept = failure.clone();
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| {
            keep(&kept, GpuError::Device(e.to_string()))
        }));
        let kept = failure.clone();
        device.set_device_lost_callback(move |reason, message| {
            if reason != wgpu::DeviceLostReason::Destroyed {
                keep(&kept, GpuError::Lost(message));
            }
        });
        Ok(Self(Arc::new(Shared { device, queue, report, timestamps, compiled: Mutex::default(), failure })))
    }

    /// The adapter behind the device.
    pub fn report(&self) -> &AdapterReport {
        &self.0.report
    }

    /// Waits until everything submitted is done.
    ///
    /// # Errors
    /// If a command was refused or the device is lost.
    pub fn wait(&self) -> Result<(), GpuError> {
        let polled = self.0.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        polled.map(|_| ()).map_err(|e| GpuError::Device(e.to_string()))
    }

    /// The first failure that no call could return.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        let failure = self.0.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure.clone().map_or(Ok(()), Err)
    }

    pub(crate) fn device(&self) -> &wgpu::Device {
        &self.0.device
    }

    pub(crate) fn queue(&self) -> &wgpu::Queue {
        &self.0.queue
    }

    pub(crate) fn has_timestamps(&self) -> bool {
        self.0.timestamps
    }

    /// The kernel on this device, compiled at its first use.
    pub(crate) fn compiled(&self, kernel: &Kernel) -> Result<Compiled, GpuError> {
        let key = (kernel.name, kernel.entry);
        let mut compiled = self.0.compiled.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = compiled.get(&key) {
            return Ok(found.clone());
        }
        let made = self.compile(kernel)?;
        compiled.insert(key, made.clone());
        Ok(made)
    }

    fn compile(&self, kernel: &Kernel) -> Result<Compiled, GpuError> {
        let reflection = kernel.reflect()?;
        let refuse = |reason: String| GpuError::Kernel { kernel: kernel.name.into(), reason };
        let limits = self.0.device.limits();
        let (bound, most) = (reflection.storage.len(), limits.max_storage_buffers_per_shader_stage);
        if bound > most as usize {
            return Err(refuse(format!(
                "binds {bound} storage buffers; {} takes {most}",
                self.report().name
            )));
        }
        let uniform = wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: true,
            min_binding_size: None,
        };
        let storage = |written: bool| wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only: !written },
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let entry = |binding: u32, ty: wgpu::BindingType| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty,
            count: None,
        };
        let params = (reflection.params > 0).then(|| entry(0, uniform));
        let buffers = reflection.storage.iter().map(|(binding, written)| entry(*binding, storage(*written)));
        let entries: Vec<_> = params.into_iter().chain(buffers).collect();
        let device = &self.0.device;
        let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(kernel.name),
            entries: &entries,
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(kernel.name),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(kernel.name),
            source: wgpu::ShaderSource::Wgsl(kernel.text().into()),
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(kernel.name),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some(kernel.entry),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        match pollster::block_on(scope.pop()) {
            Some(e) => Err(refuse(e.to_string())),
            None => Ok(Compiled { pipeline, layout, reflection }),
        }
    }
}

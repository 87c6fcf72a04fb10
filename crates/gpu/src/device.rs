//! A device with its queue and its compiled kernels.

use crate::GpuError;
use crate::adapter::{AdapterReport, Choice, WIDE_WORDS, checks, choose};
use crate::kernel::{Kernel, Reflection, WordsAdded};
use crate::memory::{Caps, Memory};
use crate::wait::{Answer, refused, refused_in_time};
use std::collections::{HashMap, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Submissions that the device may have before it: while it works on one, the next one is made.
const IN_FLIGHT: usize = 2;

/// A device; clones share it.
#[derive(Clone, Debug)]
pub struct Gpu(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    device: wgpu::Device,
    queue: wgpu::Queue,
    report: AdapterReport,
    timestamps: bool,
    words: WordsAdded,
    checks: wgpu::ShaderRuntimeChecks,
    memory: Memory,
    /// Compiled kernels by name and entry point.
    compiled: Mutex<HashMap<(&'static str, &'static str), Compiled>>,
    /// The first error that no call could return.
    failure: Arc<Mutex<Option<GpuError>>>,
    /// The latest submissions, oldest first; the device may still work on them.
    in_flight: Mutex<VecDeque<wgpu::SubmissionIndex>>,
    submissions: AtomicU64,
    uploaded: AtomicU64,
    read: AtomicU64,
}

/// What has gone to a device and come back since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Lists of commands that were submitted.
    pub submissions: u64,
    /// Bytes written to buffers, parameters of kernels among them.
    pub uploaded: u64,
    /// Bytes read back.
    pub read: u64,
}

/// A kernel on a device.
#[derive(Clone, Debug)]
pub(crate) struct Compiled {
    pub(crate) pipeline: wgpu::ComputePipeline,
    pub(crate) layout: wgpu::BindGroupLayout,
    pub(crate) reflection: Reflection,
}

impl Gpu {
    /// Opens a device. In a browser, [`Self::open`] does.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] or [`GpuError::NoDevice`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn new(choice: &Choice) -> Result<Self, GpuError> {
        Self::within(choice, Caps::NONE)
    }

    /// [`Self::new`] for a device that is to be used in part, as if it had no more.
    ///
    /// # Errors
    /// As [`Self::new`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn within(choice: &Choice, caps: Caps) -> Result<Self, GpuError> {
        crate::wait::block_on(Self::open(choice, caps))
    }

    /// [`Self::within`] without blocking the thread.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub async fn open(choice: &Choice, caps: Caps) -> Result<Self, GpuError> {
        let (mut report, adapter) = choose(choice).await?;
        let no_device = |reason: String| GpuError::NoDevice { adapter: report.name.clone(), reason };
        if let Some(lack) = report.missing() {
            return Err(no_device(format!("it lacks {lack}")));
        }
        let timestamps = adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let mut features = if timestamps { wgpu::Features::TIMESTAMP_QUERY } else { wgpu::Features::empty() };
        let wide = caps.wide_words && adapter.features().contains(WIDE_WORDS);
        if wide {
            features |= WIDE_WORDS;
        }
        let mut limits = adapter.limits();
        let binding = &mut limits.max_storage_buffer_binding_size;
        *binding = caps.binding.min(*binding);
        report.largest_binding = *binding;
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("photofit"),
            required_features: features,
            required_limits: limits,
            ..wgpu::DeviceDescriptor::default()
        });
        let (device, queue) = request.await.map_err(|e| no_device(e.to_string()))?;
        let failure = Arc::new(Mutex::new(None));
        let keep = |failure: &Arc<Mutex<Option<GpuError>>>, error: GpuError| {
            failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        };
        let kept = failure.clone();
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| {
            keep(&kept, GpuError::Device(e.to_string()))
        }));
        let kept = failure.clone();
        device.set_device_lost_callback(move |_, message| keep(&kept, GpuError::Lost(message)));
        Ok(Self(Arc::new(Shared {
            device,
            queue,
            report,
            timestamps,
            words: if wide { WordsAdded::Bits64 } else { WordsAdded::Bits32 },
            checks: checks(adapter.get_info().backend),
            memory: Memory::new(caps.memory),
            compiled: Mutex::default(),
            failure,
            in_flight: Mutex::default(),
            submissions: AtomicU64::new(0),
            uploaded: AtomicU64::new(0),
            read: AtomicU64::new(0),
        })))
    }

    /// Ends the device for all that share it: what is asked of it later is [`GpuError::Lost`], as after a reset of the
    /// driver.
    pub fn destroy(&self) {
        let mut failure = self.0.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure.get_or_insert(GpuError::Lost("it was ended".into()));
        drop(failure);
        self.0.device.destroy();
    }

    /// Submissions and bytes so far.
    pub fn traffic(&self) -> Traffic {
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let Shared { submissions, uploaded, read, .. } = &*self.0;
        Traffic { submissions: of(submissions), uploaded: of(uploaded), read: of(read) }
    }

    /// Submits commands. Waits until the device has no more than the latest [`IN_FLIGHT`] submissions before it: whoever
    /// records faster than the device works does not fill the memory with what waits.
    pub(crate) fn submit(&self, encoder: wgpu::CommandEncoder) -> Result<(), GpuError> {
        self.check()?;
        let index = self.0.queue.submit([encoder.finish()]);
        self.0.submissions.fetch_add(1, Ordering::Relaxed);
        let mut in_flight = self.0.in_flight.lock().unwrap_or_else(PoisonError::into_inner);
        in_flight.push_back(index);
        let oldest = if in_flight.len() > IN_FLIGHT { in_flight.pop_front() } else { None };
        drop(in_flight);
        let polled = oldest.map(|index| {
            self.0.device.poll(wgpu::PollType::Wait { submission_index: Some(index), timeout: None })
        });
        self.check()?;
        polled.transpose().map_or_else(|e| Err(GpuError::Device(e.to_string())), |_| Ok(()))
    }

    /// Writes bytes to the beginning of a buffer, before what is submitted next.
    pub(crate) fn upload_bytes(&self, buffer: &wgpu::Buffer, offset: u64, bytes: &[u8]) {
        self.0.uploaded.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        self.0.queue.write_buffer(buffer, offset, bytes);
    }

    /// Submissions that the device may still work on.
    #[cfg(test)]
    pub(crate) fn waiting(&self) -> usize {
        self.0.in_flight.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    pub(crate) fn count_read(&self, bytes: u64) {
        self.0.read.fetch_add(bytes, Ordering::Relaxed);
    }

    pub(crate) fn memory(&self) -> &Memory {
        &self.0.memory
    }

    /// The adapter behind the device, with the limits that the device was opened with.
    pub fn report(&self) -> &AdapterReport {
        &self.0.report
    }

    /// Waits until everything submitted is done. In a browser, [`Self::done`] does.
    ///
    /// # Errors
    /// If a command was refused or the device is lost.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn wait(&self) -> Result<(), GpuError> {
        self.poll()
    }

    /// [`Self::wait`] as a future, which blocks the thread outside of browsers only.
    ///
    /// # Errors
    /// As [`Self::wait`].
    pub async fn done(&self) -> Result<(), GpuError> {
        let answer = Answer::new();
        let send = answer.sender();
        self.0.queue.on_submitted_work_done(move || send(()));
        self.poll()?;
        answer.value().await;
        self.check()
    }

    /// Lets the driver do everything submitted and call back; browsers do that by themselves, and this returns at once.
    pub(crate) fn poll(&self) -> Result<(), GpuError> {
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
        self.check()?;
        let reflection = self.fitting(kernel)?;
        let make = || self.compile(kernel, reflection);
        let made = refused(&self.0.device, wgpu::ErrorFilter::Validation, make)
            .map_err(|e| kernel.error(e.to_string()))?;
        compiled.insert(key, made.clone());
        Ok(made)
    }

    /// Compiles a kernel before its first use. In a browser, what is wrong with it is told by name here alone: at its first use
    /// it would be [`GpuError::Device`] of a later call.
    ///
    /// # Errors
    /// If the kernel does not compile.
    pub async fn prepare(&self, kernel: &Kernel) -> Result<(), GpuError> {
        self.check()?;
        let reflection = self.fitting(kernel)?;
        let make = || self.compile(kernel, reflection);
        let made = refused_in_time(&self.0.device, wgpu::ErrorFilter::Validation, make).await;
        let made = made.map_err(|e| kernel.error(e.to_string()))?;
        let mut compiled = self.0.compiled.lock().unwrap_or_else(PoisonError::into_inner);
        compiled.entry((kernel.name, kernel.entry)).or_insert(made);
        Ok(())
    }

    /// The bindings of a kernel, which the device can hold.
    fn fitting(&self, kernel: &Kernel) -> Result<Reflection, GpuError> {
        let reflection = kernel.reflect(self.0.words)?;
        let limits = self.0.device.limits();
        let (bound, most) = (reflection.storage.len(), limits.max_storage_buffers_per_shader_stage);
        if bound > most as usize {
            let device = &self.report().name;
            return Err(kernel.error(format!("binds {bound} storage buffers; {device} takes {most}")));
        }
        Ok(reflection)
    }

    fn compile(&self, kernel: &Kernel, reflection: Reflection) -> Compiled {
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
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(kernel.name),
            entries: &entries,
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(kernel.name),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let descriptor = wgpu::ShaderModuleDescriptor {
            label: Some(kernel.name),
            source: wgpu::ShaderSource::Wgsl(kernel.text(self.0.words).into()),
        };
        #[expect(unsafe_code, reason = "loops that count up to a bound are not counted once more")]
        // SAFETY: all other checks stay; kernels are constants of this program, and each of their loops ends, since the
        // numbers of groups that they step by are not 0 (`crate::adapter`).
        let module = unsafe { device.create_shader_module_trusted(descriptor, self.0.checks) };
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(kernel.name),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some(kernel.entry),
            // Kernels write workgroup memory before they read it.
            compilation_options: wgpu::PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..wgpu::PipelineCompilationOptions::default()
            },
            cache: None,
        });
        Compiled { pipeline, layout, reflection }
    }
}

//! Lists of commands that are recorded once and run many times.

use crate::kernel::Kernel;
use crate::memory::Raw;
use crate::wait::refused;
use crate::{Bind, Buffer, Gpu, GpuError};
use std::ops::Range;

/// Offsets of parameters are multiples of this.
const ALIGNMENT: usize = 256;
/// Workgroups in one dimension of a dispatch.
const GROUPS: u32 = 65_535;

/// A copy whose source is named before each run, by [`Recording::set_source`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CopySlot {
    command: usize,
    bytes: u64,
}

/// The parameters of a dispatch, to be changed by [`Recording::set`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    offset: usize,
    bytes: usize,
}

#[derive(Debug)]
pub(crate) enum Groups {
    Counted([u32; 2]),
    /// Read from a buffer at an offset in bytes.
    Indirect(Raw, u64),
}

#[derive(Debug)]
pub(crate) enum Command {
    Dispatch {
        name: &'static str,
        pipeline: wgpu::ComputePipeline,
        layout: wgpu::BindGroupLayout,
        buffers: Vec<(u32, Bind)>,
        params: Option<Slot>,
        /// Made when the recording is finished.
        group: Option<wgpu::BindGroup>,
        groups: Groups,
        /// Invocations of a workgroup.
        lanes: u32,
    },
    Clear(Raw),
    Copy {
        /// Source and where it is read from, in bytes; none until a [`CopySlot`] is set.
        from: Option<(Raw, u64)>,
        /// Destination and where it is written to, in bytes.
        to: (Raw, u64),
        bytes: u64,
        /// Most of them.
        room: u64,
    },
}

/// Collects commands.
#[derive(Debug)]
pub struct Recorder {
    gpu: Gpu,
    name: String,
    commands: Vec<Command>,
    params: Vec<u8>,
}

impl Gpu {
    /// Begins a list of commands.
    pub fn record(&self, name: &str) -> Recorder {
        Recorder { gpu: self.clone(), name: name.into(), commands: Vec::new(), params: Vec::new() }
    }
}

impl Recorder {
    /// Adds a kernel with at least `threads` invocations. `buffers` are those of the storage bindings that the entry
    /// point uses, in ascending order. Commands see what earlier ones wrote.
    ///
    /// # Errors
    /// If the kernel does not compile, or parameters or buffers do not fit it.
    pub fn dispatch<P: bytemuck::Pod>(
        &mut self,
        kernel: &Kernel,
        params: &P,
        buffers: &[Bind],
        threads: usize,
    ) -> Result<Slot, GpuError> {
        let lanes = self.gpu.compiled(kernel)?.reflection.lanes as usize;
        let groups = u32::try_from(threads.div_ceil(lanes)).ok().filter(|g| g.div_ceil(GROUPS) <= GROUPS);
        let groups = groups.ok_or_else(|| GpuError::Dispatch {
            kernel: kernel.name.into(),
            rule: format!("{threads} invocations are more than a dispatch takes"),
        })?;
        let rows = groups.div_ceil(GROUPS).max(1);
        // Rows of one length waste less than a row of groups.
        self.push(kernel, params, buffers, Groups::Counted([groups.div_ceil(rows), rows]))
    }

    /// [`Self::dispatch`] with the numbers of workgroups (x, y, z) in a buffer, from element `at` on.
    ///
    /// # Errors
    /// As [`Self::dispatch`], and if three words do not lie at that place.
    pub fn dispatch_indirect<P: bytemuck::Pod>(
        &mut self,
        kernel: &Kernel,
        params: &P,
        buffers: &[Bind],
        groups: &Buffer<u32>,
        at: usize,
    ) -> Result<Slot, GpuError> {
        if at + 3 > groups.len() {
            return Err(groups.error(format!("has no three words at {at}")));
        }
        self.push(kernel, params, buffers, Groups::Indirect(groups.raw.clone(), 4 * at as u64))
    }

    fn push<P: bytemuck::Pod>(
        &mut self,
        kernel: &Kernel,
        params: &P,
        buffers: &[Bind],
        groups: Groups,
    ) -> Result<Slot, GpuError> {
        let compiled = self.gpu.compiled(kernel)?;
        let refuse = |rule: String| GpuError::Dispatch { kernel: kernel.name.into(), rule };
        let (wanted, bytes) = (compiled.reflection.params as usize, bytemuck::bytes_of(params));
        if wanted > 0 && wanted != bytes.len() {
            return Err(refuse(format!("parameters take {wanted} bytes, not {}", bytes.len())));
        }
        let storage = &compiled.reflection.storage;
        if storage.len() != buffers.len() {
            let numbers: Vec<_> = storage.iter().map(|s| s.0).collect();
            return Err(refuse(format!(
                "uses the storage bindings {numbers:?}; {} are given",
                buffers.len()
            )));
        }
        let slot = Slot { offset: self.params.len(), bytes: bytes.len() };
        if wanted > 0 {
            self.params.extend_from_slice(bytes);
            self.params.resize(self.params.len().next_multiple_of(ALIGNMENT), 0);
        }
        self.commands.push(Command::Dispatch {
            name: kernel.name,
            pipeline: compiled.pipeline,
            layout: compiled.layout,
            buffers: storage.iter().map(|s| s.0).zip(buffers.iter().cloned()).collect(),
            params: (wanted > 0).then_some(slot),
            group: None,
            groups,
            lanes: compiled.reflection.lanes,
        });
        Ok(slot)
    }

    /// Sets a buffer to zero.
    pub fn clear<T: bytemuck::Pod>(&mut self, buffer: &Buffer<T>) {
        self.commands.push(Command::Clear(buffer.raw.clone()));
    }

    /// Copies a buffer to the beginning of another.
    ///
    /// # Errors
    /// If the other one is shorter, both are one, or the elements do not fill words of 4 bytes.
    pub fn copy<T: bytemuck::Pod>(&mut self, from: &Buffer<T>, to: &Buffer<T>) -> Result<(), GpuError> {
        self.copy_range(from, to, 0..from.len())
    }

    /// Copies some elements of a buffer to the same place in another.
    ///
    /// # Errors
    /// If they lie outside of one of them, both are one, or the elements do not fill words of 4 bytes.
    pub fn copy_range<T: bytemuck::Pod>(
        &mut self,
        from: &Buffer<T>,
        to: &Buffer<T>,
        range: Range<usize>,
    ) -> Result<(), GpuError> {
        let [offset, bytes] = [range.start, range.len()].map(|n| (n * size_of::<T>()) as u64);
        let words = offset.is_multiple_of(4) && bytes.is_multiple_of(4);
        if range.end > from.len().min(to.len()) || from.raw == to.raw || !words {
            return Err(to.error(format!(
                "has {} elements; {range:?} of the {} of {} cannot be copied to it",
                to.len(),
                from.len(),
                from.name()
            )));
        }
        if bytes > 0 {
            let (from, to) = (Some((from.raw.clone(), offset)), (to.raw.clone(), offset));
            self.commands.push(Command::Copy { from, to, bytes, room: bytes });
        }
        Ok(())
    }

    /// Fills a buffer from one that [`Recording::set_source`] names before each run; nothing is copied before it has named
    /// one.
    ///
    /// # Errors
    /// If the elements do not fill words of 4 bytes.
    pub fn copy_in<T: bytemuck::Pod>(&mut self, to: &Buffer<T>) -> Result<CopySlot, GpuError> {
        let bytes = to.bytes();
        if !bytes.is_multiple_of(4) {
            return Err(to.error("elements that are copied fill words of 4 bytes".into()));
        }
        let slot = CopySlot { command: self.commands.len(), bytes };
        self.commands.push(Command::Copy { from: None, to: (to.raw.clone(), 0), bytes, room: bytes });
        Ok(slot)
    }

    /// Ends the list.
    ///
    /// # Errors
    /// If the device refuses a binding, or has no room for the parameters.
    pub fn finish(self) -> Result<Recording, GpuError> {
        let Self { gpu, name, mut commands, params } = self;
        let device = gpu.device();
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let uniforms = gpu.create(&name, params.len().max(ALIGNMENT) as u64, usage)?;
        for command in &mut commands {
            let Command::Dispatch { name, layout, buffers, params, group, .. } = command else { continue };
            let of = |buffer, offset, bytes| {
                wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer,
                    offset,
                    size: std::num::NonZero::new(bytes),
                })
            };
            let uniform = params.map(|slot| wgpu::BindGroupEntry {
                binding: 0,
                resource: of(&uniforms, 0, slot.bytes as u64),
            });
            let storage = buffers.iter().map(|(binding, b)| wgpu::BindGroupEntry {
                binding: *binding,
                resource: of(&b.raw, b.offset, b.bytes),
            });
            let entries: Vec<_> = uniform.into_iter().chain(storage).collect();
            let descriptor =
                wgpu::BindGroupDescriptor { label: Some(*name), layout: &*layout, entries: &entries };
            let make = || device.create_bind_group(&descriptor);
            let made = refused(device, wgpu::ErrorFilter::Validation, make)
                .map_err(|e| GpuError::Dispatch { kernel: (*name).into(), rule: e.to_string() })?;
            *group = Some(made);
        }
        Ok(Recording { gpu, name, commands, params, uniforms, changed: true })
    }
}

/// A finished list of commands.
#[derive(Debug)]
pub struct Recording {
    pub(crate) gpu: Gpu,
    pub(crate) name: String,
    pub(crate) commands: Vec<Command>,
    params: Vec<u8>,
    uniforms: Raw,
    changed: bool,
}

impl Recording {
    /// Changes the parameters of a dispatch for the next runs.
    ///
    /// # Panics
    /// If their size is another one, or the slot belongs to another recording.
    pub fn set<P: bytemuck::Pod>(&mut self, slot: Slot, params: &P) {
        let bytes = bytemuck::bytes_of(params);
        assert_eq!(bytes.len(), slot.bytes, "parameters of the same size");
        self.params[slot.offset..slot.offset + slot.bytes].copy_from_slice(bytes);
        self.changed = true;
    }

    /// Names the buffer that a copy reads in the next runs, and which of its elements: no more than the one that it fills
    /// has.
    ///
    /// # Errors
    /// If they are too many, outside of the buffer, or of the buffer that is filled.
    ///
    /// # Panics
    /// If the copy belongs to another recording.
    pub fn set_source<T: bytemuck::Pod>(
        &mut self,
        slot: CopySlot,
        source: &Buffer<T>,
        elements: Range<usize>,
    ) -> Result<(), GpuError> {
        let Some(Command::Copy { from, to, bytes, room }) = self.commands.get_mut(slot.command) else {
            panic!("a copy of this recording");
        };
        assert_eq!(*room, slot.bytes, "a copy of this recording");
        let size = size_of::<T>();
        let [offset, length] = [elements.start, elements.len()].map(|n| (n * size) as u64);
        if elements.end > source.len() || length > slot.bytes || source.raw == to.0 {
            return Err(source.error(format!(
                "has {} elements of {size} bytes; of a copy of at most {} bytes {elements:?} cannot be read, or it is the \
                 buffer that is filled",
                source.len(),
                slot.bytes
            )));
        }
        (*from, *bytes) = (Some((source.raw.clone(), offset)), length);
        Ok(())
    }

    /// Submits the list in one submission. Waits for none but that of the run before the last one, so that the work of
    /// two at most waits for the device (see [`Gpu::traffic`]).
    ///
    /// # Errors
    /// If the device refuses it or is lost.
    pub fn run(&mut self) -> Result<(), GpuError> {
        self.upload();
        let mut encoder = self.encoder();
        let mut commands = self.commands.iter().peekable();
        while let Some(command) = commands.peek() {
            if !matches!(command, Command::Dispatch { .. }) {
                copy(command, &mut encoder);
                commands.next();
                continue;
            }
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            while let Some(dispatch) = commands.next_if(|c| matches!(c, Command::Dispatch { .. })) {
                encode(dispatch, &mut pass);
            }
        }
        self.gpu.submit(encoder)
    }

    pub(crate) fn upload(&mut self) {
        if std::mem::take(&mut self.changed) && !self.params.is_empty() {
            self.gpu.upload_bytes(&self.uniforms, 0, &self.params);
        }
    }

    pub(crate) fn encoder(&self) -> wgpu::CommandEncoder {
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some(&self.name) };
        self.gpu.device().create_command_encoder(&descriptor)
    }
}

pub(crate) fn copy(command: &Command, encoder: &mut wgpu::CommandEncoder) {
    match command {
        Command::Clear(buffer) => encoder.clear_buffer(buffer, 0, None),
        Command::Copy { from: Some((from, at)), to, bytes, .. } if *bytes > 0 => {
            encoder.copy_buffer_to_buffer(from, *at, &to.0, to.1, *bytes);
        }
        Command::Copy { .. } | Command::Dispatch { .. } => {}
    }
}

pub(crate) fn encode(command: &Command, pass: &mut wgpu::ComputePass<'_>) {
    let Command::Dispatch { pipeline, params, group, groups, .. } = command else { return };
    let offset = params.map(|p| p.offset as u32);
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, group.as_ref(), offset.as_slice());
    match groups {
        Groups::Counted([0, _]) => {}
        Groups::Counted([x, y]) => pass.dispatch_workgroups(*x, *y, 1),
        Groups::Indirect(buffer, offset) => pass.dispatch_workgroups_indirect(buffer, *offset),
    }
}

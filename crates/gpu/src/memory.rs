//! What buffers take of a device's memory, and how much they may.

use crate::wait::refused;
use crate::{Gpu, GpuError};
use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// How much of a device is used, where that is less than it has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Caps {
    /// Largest buffer that a kernel binds, in bytes.
    pub binding: u64,
    /// All buffers together, in bytes.
    pub memory: u64,
    /// Words of 64 bits are added in memory where the device can.
    pub wide_words: bool,
}

impl Caps {
    /// All that the device has.
    pub const NONE: Self = Self { binding: u64::MAX, memory: u64::MAX, wide_words: true };
}

/// A buffer of the driver. Clones share it; its bytes count as long as one of them lives, those in recordings among them.
#[derive(Clone, Debug)]
pub(crate) struct Raw(Arc<Taken>);

#[derive(Debug)]
struct Taken {
    buffer: wgpu::Buffer,
    bytes: u64,
    held: Arc<AtomicU64>,
}

impl Drop for Taken {
    fn drop(&mut self) {
        self.held.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}

impl Deref for Raw {
    type Target = wgpu::Buffer;

    fn deref(&self) -> &wgpu::Buffer {
        &self.0.buffer
    }
}

impl PartialEq for Raw {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Gpu {
    /// Bytes of all buffers that there are on the device now.
    pub fn held(&self) -> u64 {
        self.memory().held.load(Ordering::Relaxed)
    }

    /// A buffer of the driver, or that there is no room for it. One to be read is memory of the processor: it does not count.
    pub(crate) fn create(&self, name: &str, bytes: u64, usage: wgpu::BufferUsages) -> Result<Raw, GpuError> {
        self.check()?;
        let memory = self.memory();
        let full = || GpuError::OutOfMemory { name: name.into(), bytes };
        let counted = if usage.contains(wgpu::BufferUsages::MAP_READ) { 0 } else { bytes };
        let given_back = || memory.held.fetch_sub(counted, Ordering::Relaxed);
        if memory.held.fetch_add(counted, Ordering::Relaxed).saturating_add(counted) > memory.most {
            given_back();
            return Err(full());
        }
        let descriptor =
            wgpu::BufferDescriptor { label: Some(name), size: bytes, usage, mapped_at_creation: false };
        let make = || self.device().create_buffer(&descriptor);
        let Ok(buffer) = refused(self.device(), wgpu::ErrorFilter::OutOfMemory, make) else {
            given_back();
            return Err(full());
        };
        Ok(Raw(Arc::new(Taken { buffer, bytes: counted, held: memory.held.clone() })))
    }
}

/// Bytes of the buffers of a device, and the most that they may take.
#[derive(Debug)]
pub(crate) struct Memory {
    held: Arc<AtomicU64>,
    most: u64,
}

impl Memory {
    pub(crate) fn new(most: u64) -> Self {
        Self { held: Arc::default(), most }
    }
}

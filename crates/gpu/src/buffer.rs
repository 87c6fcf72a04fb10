//! Buffers of one element type.

use crate::memory::Raw;
use crate::wait::Answer;
use crate::{Gpu, GpuError};
use std::marker::PhantomData;
use std::ops::Range;

/// Bytes of a buffer without elements: as many as the largest element type of a kernel's array.
const EMPTY: u64 = 16;

/// A storage buffer of `T` on a device.
#[derive(Clone, Debug)]
pub struct Buffer<T> {
    pub(crate) raw: Raw,
    name: String,
    len: usize,
    element: PhantomData<T>,
}

/// A buffer, or part of it, as a kernel sees it.
#[derive(Clone, Debug)]
pub struct Bind {
    pub(crate) raw: Raw,
    pub(crate) offset: u64,
    pub(crate) bytes: u64,
}

impl<T: bytemuck::Pod> Buffer<T> {
    /// Elements.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Label in messages.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Bytes of the elements.
    pub fn bytes(&self) -> u64 {
        (self.len * size_of::<T>()) as u64
    }

    /// The whole buffer, for a dispatch.
    pub fn bind(&self) -> Bind {
        Bind { raw: self.raw.clone(), offset: 0, bytes: self.raw.size() }
    }

    /// Part of the buffer, for a dispatch: it must start at a multiple of 256 bytes.
    ///
    /// # Errors
    /// If the range lies outside of the buffer, is empty, or starts elsewhere.
    pub fn bind_range(&self, range: Range<usize>) -> Result<Bind, GpuError> {
        let (offset, bytes) = ((range.start * size_of::<T>()) as u64, (range.len() * size_of::<T>()) as u64);
        if range.end > self.len || range.is_empty() || !offset.is_multiple_of(256) {
            return Err(self.error(format!(
                "{range:?} of {} cannot be bound; a range is inside, not empty, and starts at a multiple of 256 bytes",
                self.len
            )));
        }
        Ok(Bind { raw: self.raw.clone(), offset, bytes })
    }

    pub(crate) fn error(&self, rule: String) -> GpuError {
        GpuError::Buffer { name: self.name.clone(), rule }
    }
}

impl Gpu {
    /// A buffer with the elements of a slice.
    ///
    /// # Errors
    /// If the device cannot hold or bind it.
    pub fn upload<T: bytemuck::Pod>(&self, name: &str, data: &[T]) -> Result<Buffer<T>, GpuError> {
        let buffer = self.zeros(name, data.len())?;
        self.write(&buffer, data)?;
        Ok(buffer)
    }

    /// A buffer of zeros. Without elements it still takes a few bytes, so that it can be bound.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub fn zeros<T: bytemuck::Pod>(&self, name: &str, len: usize) -> Result<Buffer<T>, GpuError> {
        self.made(name, len, Some((self.report().largest_binding, "maxStorageBufferBindingSize")))
    }

    /// [`Self::zeros`] to copy from, that no kernel binds: it may be larger than what can be bound.
    ///
    /// # Errors
    /// If the device cannot hold it.
    pub fn store<T: bytemuck::Pod>(&self, name: &str, len: usize) -> Result<Buffer<T>, GpuError> {
        self.made(name, len, None)
    }

    /// A buffer below a limit of its own, if there is one, and that of all buffers.
    fn made<T: bytemuck::Pod>(
        &self,
        name: &str,
        len: usize,
        own: Option<(u64, &'static str)>,
    ) -> Result<Buffer<T>, GpuError> {
        let bytes = (len as u64).saturating_mul(size_of::<T>() as u64);
        let mut all = own.into_iter().chain([(self.report().largest_buffer, "maxBufferSize")]);
        if let Some((limit, which)) = all.find(|(limit, _)| bytes > *limit) {
            let device = self.report().name.clone();
            return Err(GpuError::TooLarge { name: name.into(), bytes, limit, which, device });
        }
        let size = if bytes == 0 { EMPTY } else { bytes.next_multiple_of(4) };
        let usage = wgpu::BufferUsages::STORAGE
            | wgpu::BufferUsages::COPY_SRC
            | wgpu::BufferUsages::COPY_DST
            | wgpu::BufferUsages::INDIRECT;
        let raw = self.create(name, size, usage)?;
        Ok(Buffer { raw, name: name.into(), len, element: PhantomData })
    }

    /// Overwrites the beginning of a buffer; what was submitted before still sees the old elements.
    ///
    /// # Errors
    /// If there are more elements than the buffer holds, or they do not fill whole words.
    pub fn write<T: bytemuck::Pod>(&self, buffer: &Buffer<T>, data: &[T]) -> Result<(), GpuError> {
        self.write_from(buffer, 0, data)
    }

    /// [`Self::write`] from element `first` on.
    ///
    /// # Errors
    /// As [`Self::write`], and if `first` does not begin a word of 4 bytes.
    pub fn write_from<T: bytemuck::Pod>(
        &self,
        buffer: &Buffer<T>,
        first: usize,
        data: &[T],
    ) -> Result<(), GpuError> {
        let (offset, bytes) = (first.saturating_mul(size_of::<T>()), bytemuck::cast_slice::<T, u8>(data));
        if first.saturating_add(data.len()) > buffer.len {
            let rule = format!("{} elements are written into {} from {first} on", data.len(), buffer.len);
            return Err(buffer.error(rule));
        }
        if !(bytes.len().is_multiple_of(4) && offset.is_multiple_of(4)) {
            return Err(buffer.error("elements fill words of 4 bytes".into()));
        }
        if !bytes.is_empty() {
            self.check()?;
            self.upload_bytes(&buffer.raw, offset as u64, bytes);
        }
        self.check()
    }

    /// Waits for what was submitted and copies the elements back. A browser is asked by [`Self::fetch`].
    ///
    /// # Errors
    /// If a submitted command was refused or the device is lost.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn read<T: bytemuck::Pod>(&self, buffer: &Buffer<T>) -> Result<Vec<T>, GpuError> {
        crate::wait::block_on(self.fetch(buffer))
    }

    /// [`Self::read`] of some elements.
    ///
    /// # Errors
    /// As [`Self::read`]; if the range lies outside of the buffer or does not begin a word of 4 bytes.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn read_range<T: bytemuck::Pod>(
        &self,
        buffer: &Buffer<T>,
        range: Range<usize>,
    ) -> Result<Vec<T>, GpuError> {
        crate::wait::block_on(self.fetch_range(buffer, range))
    }

    /// [`Self::read`] as a future. It blocks the thread nowhere but outside of browsers, where drivers move on only when they
    /// are waited for.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub async fn fetch<T: bytemuck::Pod>(&self, buffer: &Buffer<T>) -> Result<Vec<T>, GpuError> {
        self.fetch_range(buffer, 0..buffer.len).await
    }

    async fn fetch_range<T: bytemuck::Pod>(
        &self,
        buffer: &Buffer<T>,
        range: Range<usize>,
    ) -> Result<Vec<T>, GpuError> {
        let [offset, bytes] = [range.start, range.len()].map(|n| (n * size_of::<T>()) as u64);
        if range.end > buffer.len || !offset.is_multiple_of(4) {
            return Err(buffer.error(format!("has {} elements; {range:?} cannot be read", buffer.len)));
        }
        if bytes == 0 {
            return Ok(Vec::new());
        }
        let padded = bytes.next_multiple_of(4);
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
        let staging = self.create("readback", padded, usage)?;
        let mut encoder = self.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(&buffer.raw, offset, &staging, 0, padded);
        self.submit(encoder)?;
        let mut out = vec![T::zeroed(); range.len()];
        self.map(&staging, |data| {
            bytemuck::cast_slice_mut::<T, u8>(&mut out).copy_from_slice(&data[..bytes as usize]);
        })
        .await?;
        Ok(out)
    }

    /// Waits for the device and hands over the bytes of a staging buffer.
    pub(crate) async fn map(&self, staging: &wgpu::Buffer, take: impl FnOnce(&[u8])) -> Result<(), GpuError> {
        let answer = Answer::new();
        staging.slice(..).map_async(wgpu::MapMode::Read, answer.sender());
        self.poll()?;
        let mapped = answer.value().await;
        self.check()?;
        mapped.map_err(|e| GpuError::Device(e.to_string()))?;
        let view = staging.slice(..).get_mapped_range().map_err(|e| GpuError::Device(e.to_string()))?;
        take(&view);
        self.count_read(view.len() as u64);
        Ok(())
    }
}

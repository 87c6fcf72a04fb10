//! Times and counted work of the dispatches of a recording.

use crate::record::{Command, Groups, copy, encode};
#[cfg(not(target_arch = "wasm32"))]
use crate::wait::block_on;
use crate::{GpuError, Recording};

/// What the dispatches of one kernel in a list of commands do.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KernelReport {
    /// Name of the kernel.
    pub kernel: &'static str,
    /// Its dispatches.
    pub dispatches: usize,
    /// Invocations of those whose number is known when they are recorded.
    pub invocations: u64,
    /// Dispatches whose number of workgroups the device counts.
    pub indirect: usize,
    /// Bytes of the buffers that they bind, added up: each is read or written once at most where a kernel touches no
    /// element twice.
    pub bytes: u64,
    /// Time on the device; `None` where it has no timestamps.
    pub milliseconds: Option<f64>,
}

impl Recording {
    /// Runs the list with a timestamp around each dispatch: kernels and milliseconds, in order. Empty where the device
    /// has no timestamps.
    ///
    /// # Errors
    /// As [`Self::run`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn profile(&mut self) -> Result<Vec<(&'static str, f64)>, GpuError> {
        block_on(self.fetch_profile())
    }

    /// [`Self::profile`] as a future, as [`crate::Gpu::fetch`] is one.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub async fn fetch_profile(&mut self) -> Result<Vec<(&'static str, f64)>, GpuError> {
        if !self.gpu.has_timestamps() {
            self.run()?;
            return Ok(Vec::new());
        }
        self.upload();
        let names: Vec<&'static str> = self
            .commands
            .iter()
            .filter_map(|c| if let Command::Dispatch { name, .. } = c { Some(*name) } else { None })
            .collect();
        let mut out = Vec::with_capacity(names.len());
        // A query set holds at most 4096 timestamps: long lists are split.
        let mut commands = self.commands.iter().peekable();
        while commands.peek().is_some() {
            let queries = self.gpu.device().create_query_set(&wgpu::QuerySetDescriptor {
                label: Some(&self.name),
                ty: wgpu::QueryType::Timestamp,
                count: wgpu::QUERY_SET_MAX_QUERIES,
            });
            let mut encoder = self.encoder();
            let mut count = 0;
            while count < wgpu::QUERY_SET_MAX_QUERIES {
                let Some(command) = commands.next() else { break };
                if !matches!(command, Command::Dispatch { .. }) {
                    copy(command, &mut encoder);
                    continue;
                }
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                    label: None,
                    timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
                        query_set: &queries,
                        beginning_of_pass_write_index: Some(count),
                        end_of_pass_write_index: Some(count + 1),
                    }),
                });
                encode(command, &mut pass);
                count += 2;
            }
            let times = self.resolve(encoder, &queries, count).await?;
            out.extend(
                times.into_iter().zip(&names[out.len()..]).map(|(ms, name)| (*name, ms)).collect::<Vec<_>>(),
            );
        }
        Ok(out)
    }

    /// Runs the list as [`Self::profile`], and tells the work of each kernel in the order in which they come first.
    ///
    /// # Errors
    /// As [`Self::run`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn report(&mut self) -> Result<Vec<KernelReport>, GpuError> {
        block_on(self.fetch_report())
    }

    /// [`Self::report`] as a future, as [`crate::Gpu::fetch`] is one.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub async fn fetch_report(&mut self) -> Result<Vec<KernelReport>, GpuError> {
        let mut times = self.fetch_profile().await?.into_iter().map(|(_, ms)| ms);
        let mut out: Vec<KernelReport> = Vec::new();
        for command in &self.commands {
            let Command::Dispatch { name, buffers, groups, lanes, .. } = command else { continue };
            let at = out.iter().position(|r| r.kernel == *name).unwrap_or_else(|| {
                out.push(KernelReport { kernel: name, ..KernelReport::default() });
                out.len() - 1
            });
            let report = &mut out[at];
            report.dispatches += 1;
            report.bytes += buffers.iter().map(|(_, b)| b.bytes).sum::<u64>();
            match groups {
                Groups::Counted([x, y]) => {
                    report.invocations += u64::from(*x) * u64::from(*y) * u64::from(*lanes);
                }
                Groups::Indirect(..) => report.indirect += 1,
            }
            if let Some(ms) = times.next() {
                *report.milliseconds.get_or_insert_default() += ms;
            }
        }
        Ok(out)
    }

    /// Milliseconds between pairs of timestamps.
    async fn resolve(
        &self,
        mut encoder: wgpu::CommandEncoder,
        queries: &wgpu::QuerySet,
        count: u32,
    ) -> Result<Vec<f64>, GpuError> {
        let size = u64::from(count.max(1)) * 8;
        let buffer = |label, usage| {
            self.gpu.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
        let resolved = buffer("timestamps", usage);
        let staging =
            buffer("timestamps read back", wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ);
        if count > 0 {
            encoder.resolve_query_set(queries, 0..count, &resolved, 0);
            encoder.copy_buffer_to_buffer(&resolved, 0, &staging, 0, size);
        }
        self.gpu.submit(encoder)?;
        let ns = f64::from(self.gpu.queue().get_timestamp_period());
        let mut out = Vec::new();
        self.gpu
            .map(&staging, |bytes| {
                let ticks: &[u64] = bytemuck::cast_slice(bytes);
                let pairs = ticks.chunks_exact(2).take(count as usize / 2);
                out.extend(pairs.map(|t| t[1].saturating_sub(t[0]) as f64 * ns * 1e-6));
            })
            .await?;
        Ok(out)
    }
}

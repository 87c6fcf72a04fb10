//! Twins of operations on a device that run in a browser, too: each against its CPU operation, without blocking the thread.
//!
//! `cargo xtask web --browser` runs [`check`] in headless Chromium; the test of this crate runs it on the machine's own
//! device.
#![cfg(feature = "gpu")]

mod denoised;
mod mips;
mod normals;

#[cfg(target_arch = "wasm32")]
pub mod browser;

use photofit_gpu::{Gpu, GpuError, Kernel};

/// How far a twin is from the CPU.
#[derive(Clone, Debug)]
pub struct Twin {
    /// The operation.
    pub what: &'static str,
    /// The largest difference over the largest magnitude.
    pub error: f64,
    /// What it may be.
    pub bound: f64,
    /// What the error is when the largest number of the device's side is made larger by four bounds.
    pub bent: f64,
}

impl Twin {
    /// Of arrays of both sides.
    fn new(what: &'static str, cpu: &[f32], device: &[f32], bound: f64) -> Self {
        let mut bent = device.to_vec();
        let largest = (0..cpu.len()).max_by(|a, b| cpu[*a].abs().total_cmp(&cpu[*b].abs())).unwrap_or(0);
        bent[largest] *= 1.0 + 4.0 * bound as f32;
        Self { what, error: difference(cpu, device), bound, bent: difference(cpu, &bent) }
    }

    /// Whether the twin is within its bound, and a broken one would not be.
    pub fn agrees(&self) -> bool {
        self.error <= self.bound && self.bent > self.bound
    }
}

/// The largest difference over the largest magnitude; infinite where a number is not finite or arrays differ in length.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    let finite = a.iter().chain(b).all(|x| x.is_finite());
    if !finite || a.len() != b.len() {
        return f64::INFINITY;
    }
    let most = |x: &mut dyn Iterator<Item = f32>| f64::from(x.fold(0.0, |m: f32, x| m.max(x.abs())));
    most(&mut a.iter().zip(b).map(|(a, b)| a - b))
        / most(&mut a.iter().copied()).max(f64::from(f32::MIN_POSITIVE))
}

/// The kernels of all crates that a browser runs. That of the longest rows of the denoiser takes 32 KiB of workgroup memory, which
/// many browsers do not give; the crate does not use it there.
fn kernels(gpu: &Gpu) -> impl Iterator<Item = &'static Kernel> + use<> {
    let long = gpu.report().workgroup_memory >= 1 << 15;
    let all = [
        photofit_denoise::KERNELS,
        photofit_geometry::gpu::KERNELS,
        photofit_optim::gpu::KERNELS,
        photofit_raster::gpu::KERNELS,
        photofit_texture::gpu::KERNELS,
    ];
    all.into_iter().flatten().filter(move |k| long || k.name != "strip: rows up to 2048")
}

/// Compiles all kernels and runs all twins. Gives the number of kernels, and the twins.
///
/// # Errors
/// If a kernel does not compile, or the device refuses a command.
pub async fn check(gpu: &Gpu) -> Result<(usize, Vec<Twin>), GpuError> {
    let (mut compiled, mut refused) = (0, Vec::new());
    for kernel in kernels(gpu) {
        match gpu.prepare(kernel).await {
            Ok(()) => compiled += 1,
            Err(e) => refused.push((kernel.name, e.to_string())),
        }
    }
    if !refused.is_empty() {
        let (names, reasons): (Vec<_>, Vec<_>) = refused.into_iter().unzip();
        return Err(GpuError::Kernel { kernel: names.join(", "), reason: reasons.join("\n") });
    }
    let mut out = Vec::new();
    for twins in [normals::twins(gpu).await?, mips::twins(gpu).await?] {
        out.extend(twins);
    }
    out.extend(denoised::twins(gpu).await?);
    Ok((compiled, out))
}

/// Numbers from -1 to 1 without a pattern that an operation could know.
fn wave(n: usize, seed: u32) -> Vec<f32> {
    let hash = |k: u32| {
        let x = (k ^ seed.wrapping_mul(0x9e37_79b9)).wrapping_mul(0x85eb_ca6b);
        ((x ^ (x >> 15)).wrapping_mul(0xc2b2_ae35) >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    (0..n as u32).map(hash).collect()
}

#[cfg(all(test, not(target_arch = "wasm32")))]
mod tests;

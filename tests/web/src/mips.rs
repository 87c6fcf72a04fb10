//! Mip chains and their adjoint.

use crate::{Twin, wave};
use photofit_gpu::{Gpu, GpuError};
use photofit_texture::gpu::{CHANNELS, MipBuffers};
use photofit_texture::{MipAdjoint, Pyramid, Texture};

/// Up to nine products a texel, whose weights are rounded from `f64` on the CPU, over all levels of a chain.
const LEVELS: f64 = 2e-6;
const SIZE: (usize, usize) = (37, 21);

pub(crate) async fn twins(gpu: &Gpu) -> Result<[Twin; 2], GpuError> {
    let base = |seed| Texture {
        width: SIZE.0,
        height: SIZE.1,
        texels: bytemuck::cast_slice(&wave(CHANNELS * SIZE.0 * SIZE.1, seed)).to_vec(),
    };
    let values = Pyramid::new(base(2));
    let mut gradient = Pyramid::new(base(3));
    let mut start = values.clone();
    start.levels[1..].iter_mut().for_each(|l| l.texels.fill([0.0; CHANNELS]));
    let maps = MipBuffers::new(gpu, &start, [true; CHANNELS])?;
    gpu.write(&maps.gradient, bytemuck::cast_slice(&flat(&gradient)))?;
    values.collapse_vjp(&mut gradient, MipAdjoint::Exact);

    let mut r = gpu.record("mips");
    maps.record_rebuild(&mut r)?;
    maps.record_collapse_vjp(&mut r, MipAdjoint::Exact)?;
    r.finish()?.run()?;
    let (levels, d_levels) = (maps.fetch(gpu).await?, gpu.fetch(&maps.gradient).await?);
    // Of the gradient, the base: what the coarser levels hold has been passed down.
    let d_base = gradient.levels[0].texels.as_flattened();
    let d_found = &d_levels.as_flattened()[..d_base.len()];
    Ok([
        Twin::new("mip chain", &flat(&values), &flat(&levels), LEVELS),
        Twin::new("adjoint of the mip chain", d_base, d_found, LEVELS),
    ])
}

fn flat(p: &Pyramid<f32, CHANNELS>) -> Vec<f32> {
    p.levels.iter().flat_map(|l| l.texels.as_flattened()).copied().collect()
}

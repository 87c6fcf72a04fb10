//! Each kernel against its operation on the CPU.

mod picture;

use super::{FrameParams, KERNELS, MeshBuffers, PictureBuffers, Shot};
use crate::antialias::Topology;
use crate::deferred::Passes;
use crate::rasterize::NONE;
use photofit_gpu::Gpu;
use photofit_scalar::Vec4f;
use photofit_shading::Sides;

#[test]
fn tests_on_a_device_pass_where_there_is_one() {
    photofit_gpu::run_device_tests();
}

#[test]
fn kernels_are_valid() {
    for kernel in KERNELS {
        if let Err(e) = photofit_gpu::validate(kernel) {
            panic!("{e}");
        }
    }
}

/// Units of sums in one.
pub(crate) const SCALE: f32 = (1_u64 << 40) as f32;

/// Parameters of a picture without a camera.
pub(crate) fn params(mesh: &MeshBuffers, width: usize, height: usize, samples: usize) -> FrameParams {
    let shot = Shot { view_projection: [[0.0; 4]; 4], width, height, samples, scale: SCALE };
    FrameParams::new(&shot, mesh.vertices(), mesh.triangles(), &Passes::default(), false)
}

/// A mesh whose triangles have no neighbours.
pub(crate) fn soup(gpu: &Gpu, vertices: usize, triangles: &[[u32; 3]], sides: &[Sides]) -> MeshBuffers {
    let none = vec![[NONE; 3]; triangles.len()];
    let topology = Topology { triangles, opposite: &none, neighbour: &none };
    MeshBuffers::new(gpu, &vec![[0.0; 2]; vertices], &topology, &[], sides).expect("uploaded")
}

/// Room for a picture with its clip-space positions.
pub(crate) fn picture(
    gpu: &Gpu,
    mesh: &MeshBuffers,
    clip: &[Vec4f],
    samples: usize,
    layers: usize,
) -> PictureBuffers {
    let picture = PictureBuffers::new(gpu, mesh, samples, samples, layers, true).expect("made");
    gpu.write(&picture.clip, bytemuck::cast_slice(clip)).expect("written");
    picture
}

/// Value of a fixed-point sum.
pub(crate) fn sum_of(words: &[u32], at: usize) -> f64 {
    let bits = u64::from(words[2 * at]) | u64::from(words[2 * at + 1]) << 32;
    bits.cast_signed() as f64 / f64::from(SCALE)
}

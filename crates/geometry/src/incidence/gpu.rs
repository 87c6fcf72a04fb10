//! The gather lists on a device.

use super::Incidence;
use crate::Csr;
use photofit_gpu::{Bind, Buffer, Gpu, GpuError};

/// Declarations of the lists, for kernels; after [`photofit_gpu::INDEX`].
pub(crate) const LISTS: &str = include_str!("incidence.wgsl");

/// Where the lists begin in their buffer, in words.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Params {
    pub(crate) vertices: u32,
    pub(crate) welds: u32,
    pub(crate) triangles: u32,
    ids: u32,
    vertex_corners: u32,
    weld_corners: u32,
    members: u32,
    unused: u32,
}

/// The triangles and lists of an [`Incidence`] on a device.
#[derive(Clone, Debug)]
pub struct Lists {
    pub(crate) params: Params,
    words: Buffer<u32>,
}

impl Lists {
    /// Uploads them.
    ///
    /// # Errors
    /// If the device cannot hold them.
    pub fn new(gpu: &Gpu, incidence: &Incidence) -> Result<Self, GpuError> {
        let mut words: Vec<u32> = incidence.triangles.as_flattened().to_vec();
        let ids = words.len();
        words.extend_from_slice(&incidence.weld.ids);
        let mut add = |list: &Csr| {
            let at = words.len();
            words.extend_from_slice(&list.offsets);
            words.extend_from_slice(&list.items);
            at
        };
        let vertex_corners = add(&incidence.corners_of_vertex);
        let weld_corners =
            if incidence.weld.is_identity() { vertex_corners } else { add(&incidence.corners_of_weld) };
        let members = add(&incidence.members());
        let words = gpu.upload("incidence", &words)?;
        // What a device can bind has far fewer than 2^32 words.
        let [ids, vertex_corners, weld_corners, members] =
            [ids, vertex_corners, weld_corners, members].map(|n| n as u32);
        let [vertices, welds, triangles] =
            [incidence.vertices(), incidence.weld.count(), incidence.triangles.len()].map(|n| n as u32);
        let params =
            Params { vertices, welds, triangles, ids, vertex_corners, weld_corners, members, unused: 0 };
        Ok(Self { params, words })
    }

    /// Number of (unwelded) vertices.
    pub fn vertices(&self) -> usize {
        self.params.vertices as usize
    }

    /// Number of welded ids.
    pub fn welds(&self) -> usize {
        self.params.welds as usize
    }

    pub(crate) fn bind(&self) -> Bind {
        self.words.bind()
    }
}

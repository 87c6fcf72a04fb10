//! What of a surface stays on a device from step to step: parameters, what follows from them, and their gradients.

use super::room::NoRoom;
use crate::engine::cpu::Chain;
use crate::engine::surface::{POSITIONS, Surface};
use photofit_geometry::Incidence;
use photofit_geometry::gpu::{Lists, VertexNormals, VertexTangents, expand, expand_vjp};
use photofit_geometry::weld::Weld;
use photofit_gpu::{Buffer, Gpu, GpuError, INDEX, Kernel, Recorder, Slot};
use photofit_raster::antialias::Topology;
use photofit_raster::deferred::{Masks, Passes};
use photofit_raster::gpu::{GradientBuffers, MeshBuffers};
use photofit_raster::texture::MipAdjoint;
use photofit_raster::texture::gpu::{MipBuffers, SUM_SCALE};
use photofit_raster::{CHANNELS, channel};
use std::ops::Range;

const SOURCE: &[&str] = &[INDEX, include_str!("fit.wgsl")];
/// Holds a column of the gradient of some texels at zero.
pub(super) const HOLD: Kernel = Kernel { name: "fit.hold", source: SOURCE, entry: "hold" };
/// Puts locked vertices back.
pub(super) const PUT_BACK: Kernel = Kernel { name: "fit.put_back", source: SOURCE, entry: "put_back" };
/// The loss of a batch.
pub(super) const ADD_LOSSES: Kernel = Kernel { name: "fit.add_losses", source: SOURCE, entry: "add_losses" };

/// Class of texels of opaque triangles, and that of masked ones.
const SOLID: u32 = 1;
const MASKED: u32 = 2;

/// Parameters and topology of a surface on a device.
#[derive(Debug)]
pub(super) struct Resident {
    pub(super) mesh: MeshBuffers,
    /// Welded positions, and their gradient.
    pub(super) welded: Buffer<[f32; 3]>,
    pub(super) d_welded: Buffer<[f32; 3]>,
    pub(super) maps: MipBuffers,
    /// Texels that are parameters: those of the base of the maps, or of all levels.
    fitted: usize,
    /// The best positions and maps.
    pub(super) best: (Buffer<[f32; 3]>, Buffer<[f32; 4]>),
    weld: Lists,
    /// Normals of welded vertices, which guide filters, where one is guided, and what computes them.
    guide: Option<(VertexNormals, Buffer<[f32; 3]>)>,
    normals: VertexNormals,
    tangents: VertexTangents,
    mip_adjoint: MipAdjoint,
    /// Classes of the texels whose alpha is no parameter, where there are any.
    held: Option<Buffer<u32>>,
    /// Locked vertices and where they stay, where there are any.
    locked: Option<(Buffer<u32>, Buffer<[f32; 3]>)>,
}

impl Resident {
    /// Uploads the candidate of a surface.
    pub(super) fn new(gpu: &Gpu, surface: &Surface) -> Result<Self, NoRoom> {
        let c = &surface.candidate;
        let uvs: Vec<[f32; 2]> = c.uvs.iter().map(|uv| uv.to_array()).collect();
        let topology = Topology { triangles: &c.triangles, opposite: &c.opposite, neighbour: &c.neighbour };
        let mesh = MeshBuffers::new(gpu, &uvs, &topology, &c.alpha, &c.sides).map_err(NoRoom::mesh)?;
        let [weld, smooth, unique] = [&Incidence::new(&c.triangles, &c.weld), &c.smooth, &c.unique]
            .map(|incidence| Lists::new(gpu, incidence).map_err(NoRoom::mesh));
        let (weld, smooth, unique) = (weld?, smooth?, unique?);
        let positions: &[[f32; 3]] = bytemuck::cast_slice(&c.positions);
        // Levels of their own may fit samples that are constant in the base.
        let of_levels = surface.groups().into_iter().filter(|g| g.name != POSITIONS);
        let mut moves = [false; CHANNELS];
        for group in of_levels {
            moves.iter_mut().zip(group.rates).for_each(|(m, rate)| *m |= rate > 0.0);
        }
        let maps = MipBuffers::new(gpu, &c.maps, moves).map_err(NoRoom::maps)?;
        let best_maps = gpu.zeros("best maps", maps.texels.len()).map_err(NoRoom::maps)?;
        let levels = c.maps.levels.iter().take(c.fitted_levels()).enumerate();
        let held: Vec<u32> = levels
            .flat_map(|(level, l)| {
                let [solid, masked] = c.held(level);
                let of = |held: &[bool], i, class: u32| if held.get(i) == Some(&true) { class } else { 0 };
                (0..l.texels.len()).map(move |i| of(solid, i, SOLID) | of(masked, i, MASKED))
            })
            .collect();
        let some = held.iter().any(|h| *h != 0);
        let (vertices, places): (Vec<u32>, Vec<[f32; 3]>) =
            c.locked.iter().map(|(v, p)| (*v, p.to_array())).unzip();
        let upload = || -> Result<_, GpuError> {
            let vertices = gpu.upload("locked vertices", &vertices)?;
            Ok((vertices, gpu.upload("places of locked vertices", &places)?))
        };
        let locked = (!vertices.is_empty()).then(upload).transpose().map_err(NoRoom::mesh)?;
        let round = || -> Result<_, GpuError> {
            let welded = Weld::identity(positions.len());
            let lists = Lists::new(gpu, &Incidence::new(&c.weld.triangles(&c.triangles), &welded))?;
            Ok((VertexNormals::new(gpu, &lists)?, gpu.zeros("normals of welded vertices", positions.len())?))
        };
        let guided = surface.moves && surface.optimizer.needs_normals();
        Ok(Self {
            guide: guided.then(round).transpose().map_err(NoRoom::mesh)?,
            welded: gpu.upload("welded positions", positions).map_err(NoRoom::mesh)?,
            d_welded: gpu.zeros("gradient of welded positions", positions.len()).map_err(NoRoom::mesh)?,
            best: (gpu.upload("best positions", positions).map_err(NoRoom::mesh)?, best_maps),
            normals: VertexNormals::new(gpu, &smooth).map_err(NoRoom::mesh)?,
            tangents: VertexTangents::new(gpu, &unique, &c.frames).map_err(NoRoom::mesh)?,
            held: some.then(|| gpu.upload("held texels", &held)).transpose().map_err(NoRoom::maps)?,
            mip_adjoint: c.mip_adjoint,
            locked,
            fitted: held.len(),
            weld,
            maps,
            mesh,
        })
    }

    /// Records the vertex arrays for the present positions: twin of `Candidate::vertices`.
    pub(super) fn record_vertices(&self, r: &mut Recorder) -> Result<(), GpuError> {
        let MeshBuffers { positions, normals, tangents, .. } = &self.mesh;
        expand(r, &self.weld, &self.welded, positions)?;
        self.normals.forward(r, positions, normals)?;
        self.tangents.forward(r, positions, normals, tangents)
    }

    /// Records the normals that guide filters, for the present positions: twin of `Candidate::round_normals`.
    pub(super) fn record_guide(&self, r: &mut Recorder) -> Result<Option<&Buffer<[f32; 3]>>, GpuError> {
        let Some((round, normals)) = &self.guide else { return Ok(None) };
        round.forward(r, &self.welded, normals)?;
        Ok(Some(normals))
    }

    /// The texels of a level in the buffers of the maps.
    pub(super) fn texels_of(&self, level: usize) -> Range<usize> {
        let l = self.maps.layout().levels()[level];
        let first = l.offset as usize;
        first..first + (l.width * l.height) as usize
    }

    /// Records that locked vertices are put back after a move: twin of `Candidate::hold_locked`.
    pub(super) fn record_locked(&self, r: &mut Recorder) -> Result<(), GpuError> {
        let Some((vertices, places)) = &self.locked else { return Ok(()) };
        let count = vertices.len();
        r.dispatch(
            &PUT_BACK,
            &[count as u32, 0, 0, 0],
            &[self.welded.bind(), vertices.bind(), places.bind()],
            count,
        )?;
        Ok(())
    }

    /// Records that all gradients are zero; those of the maps are written anew by [`Self::record_vjp`].
    pub(super) fn record_clear(&self, r: &mut Recorder, g: &GradientBuffers) {
        r.clear(&self.d_welded);
        r.clear(&g.positions);
        r.clear(&g.normals);
        r.clear(&g.tangents);
    }

    /// Records how the gradients of pictures return to the parameters: twin of the end of `Candidate::pull_back`. Where
    /// there are gradients of maps, the slot takes the parameters of [`MipBuffers::record_collect`].
    pub(super) fn record_vjp(
        &self,
        r: &mut Recorder,
        g: &GradientBuffers,
        passes: &Passes,
    ) -> Result<Option<Slot>, GpuError> {
        if passes.position_gradients {
            let MeshBuffers { positions, normals, .. } = &self.mesh;
            self.tangents.vjp(r, positions, normals, &g.tangents, &g.positions, &g.normals)?;
            self.normals.vjp(r, positions, &g.normals, &g.positions)?;
            expand_vjp(r, &self.weld, &g.positions, &self.d_welded)?;
        }
        let mut collected = None;
        if passes.map_gradients {
            // Each run sets the scale of its batch.
            collected = Some(self.maps.record_collect(r, SUM_SCALE)?);
            self.maps.record_collapse_vjp(r, self.mip_adjoint)?;
            if let Some(held) = &self.held {
                // The outline of a mask that is cut has no gradient; what weighs colours must not move it.
                let which = if passes.masks == Masks::Cut { SOLID | MASKED } else { SOLID };
                let params = [self.fitted as u32, which, CHANNELS as u32, channel::ALPHA as u32];
                r.dispatch(&HOLD, &params, &[self.maps.gradient.bind(), held.bind()], self.fitted)?;
            }
        }
        Ok(collected)
    }
}

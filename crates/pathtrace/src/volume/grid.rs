//! A medium on a grid, and the coarse grid of upper bounds that its tracking walks.

use super::field::Lookup;
use super::{Field, emission};
use crate::PathtraceError;
use crate::error::invalid;
use glam::{Affine3A, DAffine3, DVec3};
use photofit_scalar::{Vec3f, vec3};

/// Voxels per side of a cell of upper bounds.
const BLOCK: usize = 4;
/// Largest number of voxels.
pub(super) const MAX_VOXELS: usize = 1 << 30;

/// A box of a medium whose density varies.
///
/// Density values sit at the centres of voxels, are interpolated linearly and continued to the walls; outside of the box
/// there is nothing. Extinction is `scale * density` per unit of length in the world, scattering is `albedo` times that; what
/// makes the longest side of the box more than [`Self::THICKEST`] mean free paths long counts as that much.
#[derive(Clone, Debug)]
pub struct Volume {
    /// Voxels along x, y and z.
    pub size: [usize; 3],
    /// Density of every voxel, x fastest.
    pub density: Vec<f32>,
    /// Extinction of density 1, per unit of length.
    pub scale: f32,
    /// Part of the extinction that scatters, in `[0, 1]` per channel.
    pub albedo: Vec3f,
    /// Albedo of every voxel, multiplied with [`Self::albedo`]; empty: none.
    pub albedos: Vec<Vec3f>,
    /// Mean cosine of scattering, in `(-1, 1)`; positive scatters forward.
    pub g: f32,
    /// Light that it emits per unit of length, W/(m^3 sr), in the part of its box that the field covers, whatever the density
    /// is there. `None`: none, and its derivative is not known.
    pub emission: Option<Field>,
    /// The unit cube to the world.
    pub transform: DAffine3,
}

impl Volume {
    /// Largest optical thickness of the longest side of a grid: a voxel of more is as opaque, and tracking takes as many steps as
    /// the thickest voxel near by is thick.
    pub const THICKEST: f32 = 1e5;

    /// The same density everywhere in a box.
    pub fn homogeneous(min: DVec3, max: DVec3, extinction: f32, albedo: Vec3f, g: f32) -> Self {
        Self {
            size: [1; 3],
            density: vec![1.0],
            scale: extinction,
            albedo,
            albedos: Vec::new(),
            g,
            emission: None,
            transform: DAffine3::from_translation(min) * DAffine3::from_scale(max - min),
        }
    }
}

/// A volume ready to be walked.
#[derive(Debug)]
pub(crate) struct Medium {
    size: [usize; 3],
    /// Extinction of density 1.
    scale: f32,
    /// The unit cube to the world.
    transform: DAffine3,
    /// Extinction per unit of length.
    extinction: Vec<f32>,
    /// Density as it was given, where it is not the extinction.
    given: Vec<f32>,
    albedo: Vec3f,
    albedos: Vec<Vec3f>,
    pub(crate) g: f32,
    pub(super) emission: Option<Lookup>,
    /// Render frame to the unit cube.
    pub(super) inward: Affine3A,
    /// Cells of upper bounds along each axis.
    pub(super) cells: [usize; 3],
    /// Upper bound of the extinction in each cell.
    pub(super) majorants: Vec<f32>,
    pub(super) bounds: [DVec3; 2],
}

impl Medium {
    pub(crate) fn new(
        index: usize,
        volume: Volume,
        origin: DVec3,
        factor: f32,
    ) -> Result<Self, PathtraceError> {
        let fail = |rule: String| Err(invalid(format!("volume {index}"), rule));
        let [nx, ny, nz] = volume.size;
        let voxels = nx.checked_mul(ny).and_then(|n| n.checked_mul(nz)).filter(|n| *n <= MAX_VOXELS);
        if voxels.is_none_or(|n| n == 0 || n != volume.density.len()) {
            let found = volume.density.len();
            return fail(format!(
                "there are {found} densities for {nx} x {ny} x {nz} voxels; there must be one for each of 1 to {MAX_VOXELS}"
            ));
        }
        if !volume.albedos.is_empty() && volume.albedos.len() != volume.density.len() {
            return fail(format!(
                "there are {} albedos; there must be none, or one a voxel",
                volume.albedos.len()
            ));
        }
        if !(volume.scale >= 0.0 && volume.scale.is_finite()) {
            return fail(format!("its scale is {}; it must be finite and not negative", volume.scale));
        }
        if let Some(a) = std::iter::once(&volume.albedo).chain(&volume.albedos).find(|a| !is_share(a)) {
            return fail(format!("an albedo is {:?}; it must lie in [0, 1]", a.to_array()));
        }
        if volume.g.is_nan() || volume.g.abs() >= 1.0 {
            return fail(format!("its anisotropy is {}; it must lie in (-1, 1)", volume.g));
        }
        if let Some(rule) = volume.emission.as_ref().and_then(|e| e.fault("emission", emission::RULE)) {
            return fail(rule);
        }
        let transform = DAffine3::from_translation(-origin) * volume.transform;
        let inverse = transform.inverse();
        if !(transform.is_finite() && inverse.is_finite() && transform.matrix3.determinant() != 0.0) {
            return fail("its transform flattens space or has a number that is not finite; it must be finite and keep three dimensions".into());
        }
        let mut out = Self {
            size: volume.size,
            scale: volume.scale,
            transform: volume.transform,
            extinction: Vec::new(),
            given: Vec::new(),
            albedo: volume.albedo,
            albedos: volume.albedos,
            g: volume.g,
            emission: volume.emission.map(|e| Lookup::new(e, origin)),
            inward: Affine3A::IDENTITY,
            cells: volume.size.map(|n| n.div_ceil(BLOCK)),
            majorants: Vec::new(),
            bounds: [DVec3::ZERO; 2],
        };
        out.set_density(index, &volume.density, factor)?;
        out.see_from(origin);
        Ok(out)
    }

    /// Replaces the density of every voxel; on an error everything is as it was.
    pub(crate) fn set_density(
        &mut self,
        index: usize,
        density: &[f32],
        factor: f32,
    ) -> Result<(), PathtraceError> {
        let fail = |rule: String| Err(invalid(format!("volume {index}"), rule));
        let [nx, ny, nz] = self.size;
        if density.len() != nx * ny * nz {
            return fail(format!(
                "there are {} densities for {nx} x {ny} x {nz} voxels; there must be one a voxel",
                density.len()
            ));
        }
        if let Some(i) = density.iter().position(|d| !(d.is_finite() && *d >= 0.0)) {
            let (x, y, z) = (i % nx, i / nx % ny, i / nx / ny);
            let found = density[i];
            return fail(format!(
                "density of voxel ({x}, {y}, {z}) is {found}; it must be finite and not negative"
            ));
        }
        let mut extinction: Vec<f32> = density.iter().map(|d| d * self.scale).collect();
        if extinction.iter().any(|e| !(e * factor).is_finite()) {
            return fail(format!(
                "density times the scale, {}, and the majorant factor, {factor}, overflows; it must be finite",
                self.scale
            ));
        }
        let thickest = self.thickest();
        let same = self.scale == 1.0 && extinction.iter().all(|e| *e <= thickest);
        extinction.iter_mut().for_each(|e| *e = e.min(thickest));
        self.majorants = majorants(&extinction, self.size, self.cells);
        self.majorants.iter_mut().for_each(|m| *m = m.max((*m * factor).min(thickest)));
        self.extinction = extinction;
        self.given = if same { Vec::new() } else { density.to_vec() };
        Ok(())
    }

    /// Extinction beyond which nothing changes.
    pub(super) fn thickest(&self) -> f32 {
        Volume::THICKEST / self.extent()
    }

    /// Extinction of density 1.
    pub(super) fn scale(&self) -> f32 {
        self.scale
    }

    /// The longest side of its box in the world.
    pub(super) fn extent(&self) -> f32 {
        let sides = self.transform.matrix3;
        [sides.x_axis, sides.y_axis, sides.z_axis].map(|s| s.length() as f32).into_iter().fold(0.0, f32::max)
    }

    /// Density of every voxel, as it was given.
    pub(crate) fn density(&self) -> &[f32] {
        if self.given.is_empty() { &self.extinction } else { &self.given }
    }

    /// Extinction of every voxel.
    pub(super) fn extinctions(&self) -> &[f32] {
        &self.extinction
    }

    /// Albedo of every voxel; without those the one of all.
    pub(crate) fn albedos(&self) -> &[Vec3f] {
        if self.albedos.is_empty() { std::slice::from_ref(&self.albedo) } else { &self.albedos }
    }

    /// What multiplies [`Self::albedos`].
    pub(super) fn factor_of_albedos(&self) -> Vec3f {
        if self.albedos.is_empty() { vec3(1.0, 1.0, 1.0) } else { self.albedo }
    }

    /// Replaces what [`Self::albedos`] says; on an error everything is as it was.
    pub(crate) fn set_albedos(&mut self, index: usize, albedos: &[Vec3f]) -> Result<(), PathtraceError> {
        if let Some(i) = albedos.iter().position(|a| !is_share(a)) {
            let found = albedos[i].to_array();
            let rule = format!("albedo of voxel {i} is {found:?}; it must lie in [0, 1]");
            return Err(invalid(format!("volume {index}"), rule));
        }
        match self.albedos.is_empty() {
            true => self.albedo = albedos[0],
            false => self.albedos.copy_from_slice(albedos),
        }
        Ok(())
    }

    /// Takes the render frame at an origin.
    pub(crate) fn see_from(&mut self, origin: DVec3) {
        let transform = DAffine3::from_translation(-origin) * self.transform;
        self.inward = crate::world::affine(&transform.inverse());
        self.bounds = crate::world::moved_box([DVec3::ZERO, DVec3::ONE], &transform);
        self.emission.iter_mut().for_each(|e| e.see_from(origin));
    }

    /// A point of the render frame in the unit cube.
    #[inline]
    pub(crate) fn to_unit(&self, p: Vec3f) -> Vec3f {
        let q = self.inward.transform_point3a(crate::world::to_glam(p));
        vec3(q.x, q.y, q.z)
    }

    /// The voxels around a point of the unit cube.
    #[inline]
    pub(super) fn taps(&self, q: Vec3f) -> Taps {
        taps(self.size, q)
    }

    /// Extinction at a point of the unit cube.
    #[inline]
    pub(crate) fn extinction(&self, q: Vec3f) -> f32 {
        match self.extinction[..] {
            [constant] => constant,
            _ => self.extinction_among(&self.taps(q)),
        }
    }

    /// [`Self::extinction`] at the point whose voxels these are.
    #[inline]
    pub(super) fn extinction_among(&self, (at, weight): &Taps) -> f32 {
        match self.extinction[..] {
            [constant] => constant,
            _ => (0..8).map(|i| self.extinction[at[i]] * weight[i]).sum(),
        }
    }

    /// Adjoint of [`Self::extinction_among`] with respect to the density of voxels, for its gradient `g`: `add` gets voxels and
    /// gradients.
    #[inline]
    pub(super) fn extinction_vjp(&self, (at, weight): &Taps, g: f32, mut add: impl FnMut(usize, f32)) {
        let g = g * self.scale;
        // More density than counts changes nothing.
        let is_most = |i: usize| self.given.get(i).is_some_and(|d| d * self.scale > self.extinction[i]);
        if self.extinction.len() == 1 {
            if !is_most(0) {
                add(0, g);
            }
            return;
        }
        (0..8).filter(|i| weight[*i] != 0.0 && !is_most(at[*i])).for_each(|i| add(at[i], g * weight[i]));
    }

    /// Albedo at a point of the unit cube.
    #[inline]
    pub(crate) fn albedo(&self, q: Vec3f) -> Vec3f {
        if self.albedos.is_empty() { self.albedo } else { self.albedo_among(&self.taps(q)) }
    }

    /// [`Self::albedo`] at the point whose voxels these are.
    #[inline]
    pub(super) fn albedo_among(&self, (at, weight): &Taps) -> Vec3f {
        if self.albedos.is_empty() {
            return self.albedo;
        }
        let sum = (0..8).fold(vec3(0.0, 0.0, 0.0), |s, i| s + self.albedos[at[i]] * weight[i]);
        sum.mul(self.factor_of_albedos())
    }

    /// Adjoint of [`Self::albedo_among`] with respect to [`Self::albedos`], for its gradient `g`.
    #[inline]
    pub(super) fn albedo_vjp(&self, (at, weight): &Taps, g: Vec3f, mut add: impl FnMut(usize, Vec3f)) {
        if self.albedos.is_empty() {
            return add(0, g);
        }
        let g = g.mul(self.factor_of_albedos());
        (0..8).filter(|i| weight[*i] != 0.0).for_each(|i| add(at[i], g * weight[i]));
    }
}

/// Whether all channels lie in [0, 1].
pub(super) fn is_share(a: &Vec3f) -> bool {
    a.to_array().iter().all(|x| (0.0..=1.0).contains(x))
}

/// The eight voxels around a point, and their weights.
pub(super) type Taps = ([usize; 8], [f32; 8]);

/// The voxels around a point of the unit cube.
#[inline(always)]
pub(super) fn taps(size: [usize; 3], q: Vec3f) -> Taps {
    let mut at = [[0_usize; 2]; 3];
    let mut share = [[0.0_f32; 2]; 3];
    for k in 0..3 {
        let n = size[k];
        let x = (q[k] * n as f32 - 0.5).clamp(0.0, (n - 1) as f32);
        let lower = (x as usize).min(n - 1);
        at[k] = [lower, (lower + 1).min(n - 1)];
        let f = x - lower as f32;
        share[k] = [1.0 - f, f];
    }
    let index = |i: usize| {
        let (x, y, z) = (at[0][i & 1], at[1][i >> 1 & 1], at[2][i >> 2]);
        (z * size[1] + y) * size[0] + x
    };
    let weight = |i: usize| share[0][i & 1] * share[1][i >> 1 & 1] * share[2][i >> 2];
    (std::array::from_fn(index), std::array::from_fn(weight))
}

/// The largest extinction that interpolation can give in each cell: its voxels and their neighbours.
fn majorants(extinction: &[f32], size: [usize; 3], cells: [usize; 3]) -> Vec<f32> {
    let most = |a: f32, b: f32| if b > a { b } else { a };
    let range = |c: usize, n: usize| (c * BLOCK).saturating_sub(1)..((c + 1) * BLOCK + 1).min(n);
    // Along x, then y, then z; rows of cells along x stay together.
    let along_x: Vec<f32> = extinction
        .chunks_exact(size[0])
        .flat_map(|row| (0..cells[0]).map(|c| row[range(c, size[0])].iter().copied().fold(0.0, most)))
        .collect();
    let along = |of: &[f32], rows: usize, length: usize, k: usize| -> Vec<f32> {
        let mut out = vec![0.0; rows * cells[k] * length];
        for (place, out) in out.chunks_exact_mut(length).enumerate() {
            let (row, c) = (place / cells[k], place % cells[k]);
            for y in range(c, size[k]) {
                let values = &of[(row * size[k] + y) * length..][..length];
                out.iter_mut().zip(values).for_each(|(m, v)| *m = most(*m, *v));
            }
        }
        out
    };
    let along_y = along(&along_x, size[2], cells[0], 1);
    let mut out = along(&along_y, 1, cells[0] * cells[1], 2);
    // Above the rounding of the weights.
    out.iter_mut().for_each(|m| *m *= 1.0 + 1e-5);
    out
}

impl Medium {
    /// Cells per side of the unit cube along axis `k`.
    #[inline(always)]
    pub(super) fn cells_per_unit(&self, k: usize) -> f32 {
        self.size[k] as f32 / BLOCK as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    #[test]
    fn bounds_are_the_largest_of_their_voxels_and_neighbours() {
        let size = [9, 5, 13];
        let mut rng = Rng::new(3, 0);
        let values: Vec<f32> = (0..size.iter().product()).map(|_| rng.uniform(0.0, 2.0)).collect();
        let cells = size.map(|n: usize| n.div_ceil(BLOCK));
        let found = majorants(&values, size, cells);
        assert_eq!(found.len(), cells.iter().product::<usize>());
        let near = |cell: usize, voxel: usize| voxel + 1 >= cell * BLOCK && voxel <= (cell + 1) * BLOCK;
        for (i, found) in found.iter().enumerate() {
            let cell = [i % cells[0], i / cells[0] % cells[1], i / cells[0] / cells[1]];
            let mut most = 0.0_f32;
            for (v, value) in values.iter().enumerate() {
                let voxel = [v % size[0], v / size[0] % size[1], v / size[0] / size[1]];
                if (0..3).all(|k| near(cell[k], voxel[k])) {
                    most = most.max(*value);
                }
            }
            assert_eq!(*found, most * (1.0 + 1e-5), "cell {cell:?}");
        }
    }
}

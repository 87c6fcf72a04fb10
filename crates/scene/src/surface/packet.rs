//! Forward lookup of one material at several points at once: the same numbers as one by one, but what no texel decides is
//! computed in loops that the compiler turns into vectors.

use super::address::Address;
use super::{Compiled, Slot, SurfaceLibrary, SurfaceSample, UvDerivatives, decode_normal};
use photofit_scalar::{Vec4f, vec2, vec3, vec4};
use photofit_texture::{LevelOfDetail, Lookup, Taps};

/// `N` points of one material, number by number.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePacket<const N: usize> {
    /// Texture coordinates: u and v of set 0, u and v of set 1.
    pub uv: [[f32; N]; 4],
    /// Their derivatives along X, per pixel.
    pub dx: [[f32; N]; 4],
    /// Their derivatives along Y, per pixel.
    pub dy: [[f32; N]; 4],
    /// Linear colour of the vertices (white where a mesh has none).
    pub color: [[f32; N]; 4],
}

impl<const N: usize> SurfacePacket<N> {
    /// White points at the origin of both sets of texture coordinates.
    pub const WHITE: Self =
        Self { uv: [[0.0; N]; 4], dx: [[0.0; N]; 4], dy: [[0.0; N]; 4], color: [[1.0; N]; 4] };

    #[inline(always)]
    fn footprint(&self, l: usize) -> UvDerivatives {
        let pair = |d: &[[f32; N]; 4], k: usize| vec2(d[k][l], d[k + 1][l]);
        UvDerivatives {
            dx: [pair(&self.dx, 0), pair(&self.dx, 2)],
            dy: [pair(&self.dy, 0), pair(&self.dy, 2)],
        }
    }
}

impl SurfaceLibrary {
    /// [`Self::lookup`] at the first `n` of `N` points; the others of `out` mean nothing.
    ///
    /// # Panics
    /// If there is no such material, or `n` is more than `N`.
    #[inline(always)]
    pub fn lookup_packet<const N: usize>(
        &self,
        material: usize,
        points: &SurfacePacket<N>,
        n: usize,
        out: &mut [SurfaceSample; N],
    ) {
        let m = &self.materials[material];
        let mut alpha = [0.0; N];
        for l in 0..N {
            let [r, g, b, a] = points.color;
            out[l] = m.constant;
            out[l].base_color = out[l].base_color.mul(vec3(r[l], g[l], b[l]));
            alpha[l] = m.base_alpha * a[l];
        }
        if !m.addresses.is_empty() {
            let mut reader = Reader { library: self, material: m, points, n, last: None };
            if let Some(slot) = m.base_color {
                let texels = reader.read(slot);
                for l in 0..n {
                    out[l].base_color = out[l].base_color.mul(texels[l].xyz());
                    alpha[l] *= texels[l].w;
                }
            }
            if let Some(slot) = m.metallic_roughness {
                let texels = reader.read(slot);
                for l in 0..n {
                    out[l].roughness *= texels[l].y;
                    out[l].metallic *= texels[l].z;
                }
            }
            if let Some(slot) = m.normal {
                let texels = reader.read(slot);
                for l in 0..n {
                    out[l].normal = decode_normal(texels[l], m.normal_scale);
                }
            }
            if let Some(slot) = m.emissive {
                let texels = reader.read(slot);
                for l in 0..n {
                    out[l].emissive = out[l].emissive.mul(texels[l].xyz());
                }
            }
        }
        for l in 0..n {
            out[l].alpha = m.alpha_mode.coverage(alpha[l]);
        }
    }
}

/// Reads the textures of a packet; slots at the same address share their taps.
struct Reader<'a, const N: usize> {
    library: &'a SurfaceLibrary,
    material: &'a Compiled,
    points: &'a SurfacePacket<N>,
    n: usize,
    last: Option<(usize, [Lookup<f32>; N])>,
}

impl<const N: usize> Reader<'_, N> {
    #[inline(always)]
    fn read(&mut self, slot: Slot) -> [Vec4f; N] {
        if self.last.is_none_or(|(address, _)| address != slot.address) {
            let at = lookups(&self.material.addresses[slot.address], self.points, self.n);
            self.last = Some((slot.address, at));
        }
        let mut out = [vec4(0.0, 0.0, 0.0, 0.0); N];
        let texture = &self.library.textures[slot.texture];
        if let Some((_, at)) = &self.last {
            for l in 0..self.n {
                out[l] = Vec4f::from_array(texture.read(&at[l]));
            }
        }
        out
    }
}

/// The lookups of the first `n` points.
#[inline(always)]
fn lookups<const N: usize>(address: &Address, points: &SurfacePacket<N>, n: usize) -> [Lookup<f32>; N] {
    let nowhere = Taps { index: [0; 4], fx: 0.0, fy: 0.0 };
    let mut out = [Lookup { level: 0, fine: nowhere, coarse: None }; N];
    let trilinear = address.is_trilinear();
    let mut levels = [0.0; N];
    if trilinear {
        for l in 0..N {
            levels[l] = address.level(&points.footprint(l)).level;
        }
    }
    for l in 0..n {
        let [u0, v0, u1, v1] = points.uv;
        let uv = [vec2(u0[l], v0[l]), vec2(u1[l], v1[l])];
        let level = LevelOfDetail { level: levels[l] };
        out[l] = address.lookup_at(uv, if trilinear { Some(&level) } else { None });
    }
    out
}

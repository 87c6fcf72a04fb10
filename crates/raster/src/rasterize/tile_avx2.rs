//! Drawing a triangle into a tile eight pixels at a time, to the same bits as [`Setup::draw`].

use super::NONE;
use super::tile::{Layer, Setup, TILE};
use bytemuck::cast;
use std::arch::x86_64::{
    __m256, __m256i, _CMP_GE_OQ, _CMP_LE_OQ, _CMP_LT_OQ, _mm256_add_ps, _mm256_and_ps, _mm256_blendv_epi8,
    _mm256_blendv_ps, _mm256_castps_si256, _mm256_cmp_ps, _mm256_movemask_ps, _mm256_mul_ps,
    _mm256_set1_epi32, _mm256_set1_ps, _mm256_setr_ps, _mm256_setzero_ps,
};

/// Pixels drawn at once; a tile's rows are whole groups of them.
const LANES: usize = 8;

impl Setup {
    /// Draws eight pixels at a time; a pixel without a triangle has an infinite depth.
    #[target_feature(enable = "avx2,fma")]
    #[inline]
    pub(super) fn draw_avx2(&self, id: u32, front: Option<&Layer>, out: &mut Layer) {
        let [e0, e1, e2] = [splat(&self.edge[0]), splat(&self.edge[1]), splat(&self.edge[2])];
        let (limit, d) = (splat(&self.limit), splat(&self.depth));
        let (zero, one) = (_mm256_setzero_ps(), _mm256_set1_ps(1.0));
        let ids = _mm256_set1_epi32(id as i32);
        let iota = _mm256_setr_ps(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0);
        let first = self.range[0] / LANES * LANES;
        for y in self.range[1]..=self.range[3] {
            let fy = _mm256_set1_ps(y as f32);
            let row = [_mm256_mul_ps(e0[1], fy), _mm256_mul_ps(e1[1], fy), _mm256_mul_ps(e2[1], fy)];
            let row_depth = _mm256_mul_ps(d[1], fy);
            for x in (first..=self.range[2]).step_by(LANES) {
                let fx = _mm256_add_ps(_mm256_set1_ps(x as f32), iota);
                let inside = _mm256_and_ps(
                    _mm256_and_ps(
                        _mm256_cmp_ps::<_CMP_GE_OQ>(line(&e0, row[0], fx), limit[0]),
                        _mm256_cmp_ps::<_CMP_GE_OQ>(line(&e1, row[1], fx), limit[1]),
                    ),
                    _mm256_cmp_ps::<_CMP_GE_OQ>(line(&e2, row[2], fx), limit[2]),
                );
                if _mm256_movemask_ps(inside) == 0 {
                    continue;
                }
                let at = y * TILE + x;
                let depths: &mut [f32; LANES] = lanes(&mut out.depth, at);
                let old: __m256 = cast(*depths);
                let z = line(&d, row_depth, fx);
                let near = _mm256_and_ps(
                    _mm256_and_ps(_mm256_cmp_ps::<_CMP_GE_OQ>(z, zero), _mm256_cmp_ps::<_CMP_LE_OQ>(z, one)),
                    _mm256_cmp_ps::<_CMP_LT_OQ>(z, old),
                );
                let mut hit = _mm256_and_ps(inside, near);
                if let Some(f) = front {
                    hit = _mm256_and_ps(hit, behind(f, at, z, id));
                }
                if _mm256_movemask_ps(hit) == 0 {
                    continue;
                }
                *depths = cast(_mm256_blendv_ps(old, z, hit));
                let triangles: &mut [u32; LANES] = lanes(&mut out.triangle, at);
                let old: __m256i = cast(*triangles);
                *triangles = cast(_mm256_blendv_epi8(old, ids, _mm256_castps_si256(hit)));
            }
        }
    }
}

#[target_feature(enable = "avx2,fma")]
#[inline]
fn splat(x: &[f32; 3]) -> [__m256; 3] {
    [_mm256_set1_ps(x[0]), _mm256_set1_ps(x[1]), _mm256_set1_ps(x[2])]
}

/// `(a x + b y) + c`, with `b y` given.
#[target_feature(enable = "avx2,fma")]
#[inline]
fn line(e: &[__m256; 3], row: __m256, fx: __m256) -> __m256 {
    _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(e[0], fx), row), e[2])
}

/// Lanes that lie behind a layer's fragments.
#[target_feature(enable = "avx2,fma")]
#[inline]
fn behind(front: &Layer, at: usize, z: __m256, id: u32) -> __m256 {
    let z: [f32; LANES] = cast(z);
    let mut mask = [0u32; LANES];
    for (k, m) in mask.iter_mut().enumerate() {
        let (t, d) = (front.triangle[at + k], front.depth[at + k]);
        *m = if t != NONE && (z[k] > d || (z[k] == d && id > t)) { u32::MAX } else { 0 };
    }
    cast(mask)
}

/// Eight neighbouring entries of a tile.
#[inline(always)]
fn lanes<T, const N: usize>(tile: &mut [T; N], at: usize) -> &mut [T; LANES] {
    tile[at..at + LANES].first_chunk_mut().expect("a tile's rows are whole groups of lanes")
}

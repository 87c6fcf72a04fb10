//! Which instructions a traversal uses: the same steps with vectors of four or of eight numbers.
//!
//! Both ways compute the same bits (a subtraction and a product for each plane, nothing fused), hence visit the same
//! nodes in the same order.

use super::walk::{Slabs, walk_with};
use super::wide::{Lanes, Node, WIDTH};
use glam::Vec4;

/// Instructions of a traversal. A value proves that the machine has them.
pub(crate) trait Width: Copy {
    /// Visits the leaves of a tree that the ray's boxes lead to, with the limit so far; `leaf` returns the new limit or
    /// ends the walk. `ORDERED`: near ones first.
    fn walk<const ORDERED: bool>(
        self,
        nodes: &[Node],
        ray: &Slabs,
        limit: f32,
        leaf: impl FnMut(u32, f32) -> Option<f32>,
    );

    /// Runs a job that is compiled for these instructions as far as it is inlined.
    fn run<R>(self, job: impl FnOnce() -> R) -> R;
}

/// What every machine has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl Width for Portable {
    #[inline(always)]
    fn walk<const ORDERED: bool>(
        self,
        nodes: &[Node],
        ray: &Slabs,
        limit: f32,
        leaf: impl FnMut(u32, f32) -> Option<f32>,
    ) {
        let splat = |v: [f32; 3]| v.map(Vec4::splat);
        let (near, far, inverse) = (splat(ray.near_origin), splat(ray.far_origin), splat(ray.inverse));
        let test = |node: &Node, limit: f32| {
            let mut nears = [Vec4::ZERO; 2];
            let mut mask = 0;
            for half in 0..2 {
                let enter = |k: usize| {
                    let plane = node.planes[k][usize::from(ray.negative[k])].0[half];
                    (plane - near[k]) * inverse[k]
                };
                let leave = |k: usize| {
                    let plane = node.planes[k][usize::from(!ray.negative[k])].0[half];
                    (plane - far[k]) * inverse[k]
                };
                nears[half] = Vec4::splat(ray.t_min).max(enter(0)).max(enter(1).max(enter(2)));
                let fars = Vec4::splat(limit).min(leave(0)).min(leave(1).min(leave(2)));
                mask |= nears[half].cmple(fars).bitmask() << (4 * half);
            }
            (mask, Lanes(nears).to_array())
        };
        walk_with::<ORDERED>(nodes, limit, test, leaf);
    }

    #[inline(always)]
    fn run<R>(self, job: impl FnOnce() -> R) -> R {
        job()
    }
}

/// Vectors of eight numbers on x86.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2(());

#[cfg(target_arch = "x86_64")]
impl Avx2 {
    /// `None` where the machine lacks them.
    #[inline(always)]
    pub(crate) fn detect() -> Option<Self> {
        is_x86_feature_detected!("avx2").then_some(Self(()))
    }
}

#[cfg(target_arch = "x86_64")]
impl Width for Avx2 {
    #[inline(always)]
    fn walk<const ORDERED: bool>(
        self,
        nodes: &[Node],
        ray: &Slabs,
        limit: f32,
        leaf: impl FnMut(u32, f32) -> Option<f32>,
    ) {
        #[expect(unsafe_code, reason = "a value of this type exists only where the instructions do")]
        unsafe {
            avx2::walk::<ORDERED>(nodes, ray, limit, leaf);
        }
    }

    #[inline(always)]
    fn run<R>(self, job: impl FnOnce() -> R) -> R {
        #[expect(unsafe_code, reason = "a value of this type exists only where the instructions do")]
        unsafe {
            avx2::run(job)
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{Node, Slabs, WIDTH, walk_with};
    use crate::accel::wide::Lanes;
    use std::arch::x86_64::{
        __m256, _CMP_LE_OQ, _mm256_castps256_ps128, _mm256_cmp_ps, _mm256_extractf128_ps, _mm256_max_ps,
        _mm256_min_ps, _mm256_movemask_ps, _mm256_mul_ps, _mm256_set_m128, _mm256_set1_ps, _mm256_sub_ps,
    };

    #[target_feature(enable = "avx2")]
    pub(super) fn run<R>(job: impl FnOnce() -> R) -> R {
        job()
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    pub(super) fn walk<const ORDERED: bool>(
        nodes: &[Node],
        ray: &Slabs,
        limit: f32,
        leaf: impl FnMut(u32, f32) -> Option<f32>,
    ) {
        let splat = |v: [f32; 3]| [_mm256_set1_ps(v[0]), _mm256_set1_ps(v[1]), _mm256_set1_ps(v[2])];
        let (near, far, inverse) = (splat(ray.near_origin), splat(ray.far_origin), splat(ray.inverse));
        let t_min = _mm256_set1_ps(ray.t_min);
        let test = |node: &Node, limit: f32| {
            let enter = |k: usize| {
                let plane = load(&node.planes[k][usize::from(ray.negative[k])]);
                _mm256_mul_ps(_mm256_sub_ps(plane, near[k]), inverse[k])
            };
            let leave = |k: usize| {
                let plane = load(&node.planes[k][usize::from(!ray.negative[k])]);
                _mm256_mul_ps(_mm256_sub_ps(plane, far[k]), inverse[k])
            };
            let limit = _mm256_set1_ps(limit);
            // In pairs: a shorter chain than one after the other.
            let nears = _mm256_max_ps(_mm256_max_ps(t_min, enter(0)), _mm256_max_ps(enter(1), enter(2)));
            let fars = _mm256_min_ps(_mm256_min_ps(limit, leave(0)), _mm256_min_ps(leave(1), leave(2)));
            let mask = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(nears, fars));
            (mask as u32, store(nears))
        };
        walk_with::<ORDERED>(nodes, limit, test, leaf);
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn load(lanes: &Lanes) -> __m256 {
        _mm256_set_m128(lanes.0[1].into(), lanes.0[0].into())
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn store(v: __m256) -> [f32; WIDTH] {
        Lanes([_mm256_castps256_ps128(v).into(), _mm256_extractf128_ps::<1>(v).into()]).to_array()
    }
}

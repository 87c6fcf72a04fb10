//! Vectors of eight numbers on x86.

use super::Width;
use crate::walk::Slabs;
use crate::wide::Node;

/// Vectors of eight numbers on x86.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2(());

impl Avx2 {
    /// `None` where the machine lacks them.
    #[inline(always)]
    pub(crate) fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1")).then_some(Self(()))
    }
}

impl Avx2 {
    /// Runs a job that is compiled for these instructions as far as it is inlined.
    #[inline(always)]
    pub(crate) fn run<R>(self, job: impl FnOnce() -> R) -> R {
        #[expect(unsafe_code, reason = "a value of this type exists only where the instructions do")]
        unsafe {
            wide::run(job)
        }
    }
}

impl Width for Avx2 {
    #[inline(always)]
    fn walk_near<L>(
        self,
        nodes: &[Node],
        leaves: &[L],
        ray: &Slabs,
        limit: f32,
        leaf: impl FnMut(u32, f32) -> Option<f32>,
    ) {
        #[expect(unsafe_code, reason = "a value of this type exists only where the instructions do")]
        unsafe {
            wide::walk_near(nodes, leaves, ray, limit, leaf);
        }
    }

    #[inline(always)]
    fn walk_any<L>(
        self,
        nodes: &[Node],
        leaves: &[L],
        ray: &Slabs,
        limit: f32,
        leaf: impl FnMut(u32) -> bool,
    ) {
        #[expect(unsafe_code, reason = "a value of this type exists only where the instructions do")]
        unsafe {
            wide::walk_any(nodes, leaves, ray, limit, leaf);
        }
    }
}

/// Functions that are compiled for these instructions.
mod wide {
    use crate::stack::Stack;
    use crate::walk::{Slabs, any_order, near_first};
    use crate::wide::{LEAF, Lanes, Node, WIDTH};
    use glam::Vec3A;
    use std::arch::x86_64::{
        __m256, _CMP_LE_OQ, _MM_HINT_T0, _mm_cvtsi64_si128, _mm_prefetch, _mm256_cmp_ps,
        _mm256_cvtepu8_epi32, _mm256_max_ps, _mm256_min_ps, _mm256_movemask_ps, _mm256_mul_ps,
        _mm256_permutevar8x32_epi32, _mm256_set_m128, _mm256_set1_ps, _mm256_sub_ps,
    };

    #[target_feature(enable = "avx2,bmi1")]
    pub(super) fn run<R>(job: impl FnOnce() -> R) -> R {
        job()
    }

    #[target_feature(enable = "avx2,bmi1")]
    #[inline]
    pub(super) fn walk_near<L>(
        nodes: &[Node],
        leaves: &[L],
        ray: &Slabs,
        limit: f32,
        leaf: impl FnMut(u32, f32) -> Option<f32>,
    ) {
        let boxes = Boxes::new(ray);
        let test = |node: &Node, limit: f32| {
            let (mask, nears) = boxes.test(node, _mm256_set1_ps(limit));
            (mask, bytemuck::cast(nears))
        };
        near_first(nodes, limit, test, |child| fetch(nodes, leaves, child), leaf);
    }

    #[target_feature(enable = "avx2,bmi1")]
    #[inline]
    pub(super) fn walk_any<L>(
        nodes: &[Node],
        leaves: &[L],
        ray: &Slabs,
        limit: f32,
        leaf: impl FnMut(u32) -> bool,
    ) {
        let boxes = Boxes::new(ray);
        let limit = _mm256_set1_ps(limit);
        let test = |node: &Node| boxes.test(node, limit).0;
        let push = |stack: &mut Stack<u32>, len: usize, child: &[u32; WIDTH], mask: u32| {
            let lanes = LANES[mask as usize % LANES.len()];
            let order = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(lanes.cast_signed()));
            let chosen = _mm256_permutevar8x32_epi32(bytemuck::cast(*child), order);
            stack.set_all(len, bytemuck::cast(chosen));
            len + mask.count_ones() as usize
        };
        any_order(nodes, test, push, |child| fetch(nodes, leaves, child), leaf);
    }

    /// For each mask the lanes that are in it, a byte each.
    static LANES: [u64; 1 << WIDTH] = {
        let mut all = [0; 1 << WIDTH];
        let mut mask = 0;
        while mask < all.len() {
            let (mut lane, mut count) = (0, 0);
            while lane < WIDTH {
                if mask >> lane & 1 != 0 {
                    all[mask] |= (lane as u64) << (8 * count);
                    count += 1;
                }
                lane += 1;
            }
            mask += 1;
        }
        all
    };

    /// A ray against the boxes of a node.
    struct Boxes {
        near: [__m256; 3],
        far: [__m256; 3],
        inverse: [__m256; 3],
        t_min: __m256,
        sides: [usize; 3],
    }

    impl Boxes {
        #[target_feature(enable = "avx2,bmi1")]
        #[inline]
        fn new(ray: &Slabs) -> Self {
            let splat = |v: Vec3A| [_mm256_set1_ps(v.x), _mm256_set1_ps(v.y), _mm256_set1_ps(v.z)];
            let (near, far, inverse) = (splat(ray.near_origin), splat(ray.far_origin), splat(ray.inverse));
            Self { near, far, inverse, t_min: _mm256_set1_ps(ray.t_min), sides: ray.sides() }
        }

        /// The children whose boxes the ray passes up to the limit, one bit each, and where it enters them.
        #[target_feature(enable = "avx2,bmi1")]
        #[inline]
        fn test(&self, node: &Node, limit: __m256) -> (u32, __m256) {
            let plane = |k: usize, side: usize| {
                let Lanes([low, high]) = node.planes[k][side];
                _mm256_set_m128(high.into(), low.into())
            };
            let enter = |k: usize| {
                _mm256_mul_ps(_mm256_sub_ps(plane(k, self.sides[k]), self.near[k]), self.inverse[k])
            };
            let leave = |k: usize| {
                _mm256_mul_ps(_mm256_sub_ps(plane(k, 1 - self.sides[k]), self.far[k]), self.inverse[k])
            };
            // In pairs: a shorter chain than one after the other.
            let nears = _mm256_max_ps(_mm256_max_ps(self.t_min, enter(0)), _mm256_max_ps(enter(1), enter(2)));
            let fars = _mm256_min_ps(_mm256_min_ps(limit, leave(0)), _mm256_min_ps(leave(1), leave(2)));
            let mask = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(nears, fars));
            (mask.cast_unsigned(), nears)
        }
    }

    /// Starts to load a child.
    #[target_feature(enable = "avx2,bmi1")]
    #[inline]
    fn fetch<L>(nodes: &[Node], leaves: &[L], child: u32) {
        let index = (child & !LEAF) as usize;
        let (table, size) = if child & LEAF == 0 {
            (nodes.as_ptr().cast::<i8>(), size_of::<Node>())
        } else {
            (leaves.as_ptr().cast::<i8>(), size_of::<L>())
        };
        let start = table.wrapping_add(index * size);
        for line in 0..4 {
            _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add((64 * line).min(size.saturating_sub(1))));
        }
    }
}

//! Which instructions a traversal uses: the same steps with vectors of four or of eight numbers.
//!
//! Both ways compute the same bits (a subtraction and a product for each plane, nothing fused), hence visit the same
//! nodes in the same order.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod portable;

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::Avx2;
pub(crate) use portable::Portable;

use super::walk::Slabs;
use super::wide::Node;

/// Instructions of a traversal. A value proves that the machine has them.
///
/// A walk gets what leaves index, for to fetch it ahead; it may be empty.
pub(crate) trait Width: Copy {
    /// Visits the leaves of a tree that the ray's boxes lead to, near ones first, with the limit so far;
    /// `leaf` returns the new limit or ends the walk.
    fn walk_near<L>(
        self,
        nodes: &[Node],
        leaves: &[L],
        ray: &Slabs,
        limit: f32,
        leaf: impl FnMut(u32, f32) -> Option<f32>,
    );

    /// Visits the leaves of a tree that the ray's boxes up to the limit lead to, in any order, until `leaf`
    /// returns false.
    fn walk_any<L>(
        self,
        nodes: &[Node],
        leaves: &[L],
        ray: &Slabs,
        limit: f32,
        leaf: impl FnMut(u32) -> bool,
    );
}

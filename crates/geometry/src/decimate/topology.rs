//! Triangles around vertices as linked lists of corners; any soup is representable.

pub(super) use crate::NONE;

/// Triangles that can die, with the corners of each vertex in a singly linked list.
#[derive(Debug)]
pub(super) struct Topology {
    /// Vertices of each triangle; the first is [`NONE`] where the triangle is dead.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Live triangles.
    pub(super) live: usize,
    next: Vec<u32>,
    head: Vec<u32>,
}

impl Topology {
    pub(super) fn new(triangles: Vec<[u32; 3]>, vertices: usize) -> Self {
        let (live, next) = (triangles.len(), vec![NONE; triangles.len() * 3]);
        let mut all = Self { live, triangles, next, head: vec![NONE; vertices] };
        all.relink();
        all
    }

    /// Makes the lists anew from the triangles.
    pub(super) fn relink(&mut self) {
        self.head.fill(NONE);
        // Backwards, so that every list runs in increasing order.
        for (t, corners) in self.triangles.iter().enumerate().rev().filter(|(_, c)| c[0] != NONE) {
            for k in 0..3 {
                let v = corners[k] as usize;
                self.next[3 * t + k] = self.head[v];
                self.head[v] = (3 * t + k) as u32;
            }
        }
    }

    #[inline]
    pub(super) fn is_live(&self, t: u32) -> bool {
        self.triangles[t as usize][0] != NONE
    }

    /// Corners `3 t + k` of live triangles at `v`, into `out`; unlinks dead ones on the way.
    #[inline]
    pub(super) fn corners(&mut self, v: u32, out: &mut Vec<u32>) {
        out.clear();
        let mut last = NONE;
        let mut c = self.head[v as usize];
        while c != NONE {
            let after = self.next[c as usize];
            if self.is_live(c / 3) {
                if last == NONE {
                    self.head[v as usize] = c;
                } else {
                    self.next[last as usize] = c;
                }
                last = c;
                out.push(c);
            }
            c = after;
        }
        if last == NONE {
            self.head[v as usize] = NONE;
        } else {
            self.next[last as usize] = NONE;
        }
    }

    /// Corners at `v` of lists without dead triangles ([`Self::relink`]).
    pub(super) fn around(&self, v: u32) -> impl Iterator<Item = u32> {
        let step = |c: u32| (c != NONE).then_some(c);
        std::iter::successors(step(self.head[v as usize]), move |&c| step(self.next[c as usize]))
    }

    /// The other two vertices of the triangle of a corner, in its orientation.
    #[inline]
    pub(super) fn others(&self, corner: u32) -> (u32, u32) {
        let t = &self.triangles[corner as usize / 3];
        match corner % 3 {
            0 => (t[1], t[2]),
            1 => (t[2], t[0]),
            _ => (t[0], t[1]),
        }
    }

    /// Removes a triangle.
    #[inline]
    pub(super) fn kill(&mut self, t: u32) {
        if self.is_live(t) {
            self.triangles[t as usize][0] = NONE;
            self.live -= 1;
        }
    }

    /// Hands the corners `of_v` over to `u` and puts them behind `of_u`.
    pub(super) fn merge(&mut self, u: u32, of_u: &[u32], of_v: &[u32]) {
        let mut last = NONE;
        for &c in of_u.iter().chain(of_v) {
            if !self.is_live(c / 3) {
                continue;
            }
            self.triangles[c as usize / 3][c as usize % 3] = u;
            if last == NONE {
                self.head[u as usize] = c;
            } else {
                self.next[last as usize] = c;
            }
            last = c;
        }
        if last == NONE {
            self.head[u as usize] = NONE;
        } else {
            self.next[last as usize] = NONE;
        }
    }

    /// All edges of live triangles with the triangle: sorted by `(smaller vertex, larger vertex, triangle)`.
    pub(super) fn edges(&self) -> Vec<(u64, u32)> {
        let mut edges = Vec::with_capacity(self.live * 3);
        for (t, c) in self.triangles.iter().enumerate().filter(|(_, c)| c[0] != NONE) {
            for k in 0..3 {
                let (a, b) = (c[k], c[(k + 1) % 3]);
                edges.push(((u64::from(a.min(b)) << 32) | u64::from(a.max(b)), t as u32));
            }
        }
        edges.sort_unstable();
        edges
    }
}

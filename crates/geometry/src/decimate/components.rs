//! Connected components over welded vertices.

/// Disjoint sets over `0..n`; the representative is always the smallest member.
#[derive(Debug)]
pub(super) struct Sets {
    parent: Vec<u32>,
}

impl Sets {
    pub(super) fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect() }
    }

    pub(super) fn find(&mut self, mut i: u32) -> u32 {
        while self.parent[i as usize] != i {
            let up = self.parent[self.parent[i as usize] as usize];
            self.parent[i as usize] = up;
            i = up;
        }
        i
    }

    pub(super) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    /// Compact set index of every member, in the order of the smallest members, and the number of sets.
    pub(super) fn compact(mut self) -> (Vec<u32>, usize) {
        let mut label = vec![0; self.parent.len()];
        let mut count = 0;
        for i in 0..self.parent.len() as u32 {
            let root = self.find(i);
            if root == i {
                label[i as usize] = count;
                count += 1;
            } else {
                label[i as usize] = label[root as usize];
            }
        }
        (label, count as usize)
    }
}

/// Component of each triangle, and the number of components: triangles that share a vertex index are connected.
///
/// Components are numbered in the order of their smallest vertex; vertices without triangles count for nothing.
///
/// # Panics
/// If a triangle names a vertex `>= vertices`.
pub fn components(triangles: &[[u32; 3]], vertices: usize) -> (Vec<u32>, usize) {
    let mut sets = Sets::new(vertices);
    for t in triangles {
        sets.join(t[0], t[1]);
        sets.join(t[0], t[2]);
    }
    let (label, count) = sets.compact();
    let mut used = vec![u32::MAX; count];
    for t in triangles {
        used[label[t[0] as usize] as usize] = 0;
    }
    let mut next = 0;
    for u in used.iter_mut().filter(|u| **u == 0) {
        *u = next;
        next += 1;
    }
    (triangles.iter().map(|t| used[label[t[0] as usize] as usize]).collect(), next as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_ignore_loose_vertices() {
        let (label, n) = components(&[[5, 6, 7], [1, 2, 3], [3, 4, 2], [7, 8, 9]], 12);
        assert_eq!(label, [1, 0, 0, 1]);
        assert_eq!(n, 2);
    }
}

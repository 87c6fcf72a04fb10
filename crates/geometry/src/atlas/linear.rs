//! Sparse `L D L^T` factorisation with a nested-dissection order for plane meshes.
//!
//! The up-looking factorisation follows Davis, "Algorithm 849: a concise sparse Cholesky factorization package"
//! (2005); the order is George's nested dissection (1973) with coordinate bisection, O(n log n) fill.

use super::topology::{NONE, positive};
use photofit_scalar::Vec2;

/// A symmetric matrix: diagonal and, per row, the entries of all other columns.
pub(super) struct Symmetric {
    pub(super) diagonal: Vec<f64>,
    pub(super) start: Vec<u32>,
    pub(super) column: Vec<u32>,
    pub(super) value: Vec<f64>,
}

impl Symmetric {
    /// Sums `(row, column, value)` entries with `row > column` into both triangles.
    pub(super) fn new(diagonal: Vec<f64>, mut lower: Vec<(u32, u32, f64)>) -> Self {
        let n = diagonal.len();
        lower.sort_by_key(|e| (e.0, e.1));
        lower.dedup_by(|b, a| {
            let same = (a.0, a.1) == (b.0, b.1);
            if same {
                a.2 += b.2;
            }
            same
        });
        let mut start = vec![0_u32; n + 1];
        for e in &lower {
            start[e.0 as usize + 1] += 1;
            start[e.1 as usize + 1] += 1;
        }
        for i in 0..n {
            start[i + 1] += start[i];
        }
        let mut fill = start.clone();
        let mut column = vec![0; lower.len() * 2];
        let mut value = vec![0.0; lower.len() * 2];
        for &(i, j, x) in &lower {
            for (i, j) in [(i, j), (j, i)] {
                let at = fill[i as usize] as usize;
                column[at] = j;
                value[at] = x;
                fill[i as usize] += 1;
            }
        }
        Self { diagonal, start, column, value }
    }

    #[inline]
    fn row(&self, i: u32) -> impl Iterator<Item = (u32, f64)> + '_ {
        let range = self.start[i as usize] as usize..self.start[i as usize + 1] as usize;
        self.column[range.clone()].iter().copied().zip(self.value[range].iter().copied())
    }
}

/// The factor of a positive definite matrix.
pub(super) struct Factor {
    order: Vec<u32>,
    start: Vec<usize>,
    row: Vec<u32>,
    value: Vec<f64>,
    diagonal: Vec<f64>,
}

impl Factor {
    /// Factors `a`; `points` (one per row) guide the order. `None` when a pivot is not positive.
    pub(super) fn new(a: &Symmetric, points: &[Vec2<f64>]) -> Option<Self> {
        let n = a.diagonal.len();
        let order = dissect(a, points);
        let mut place = vec![0_u32; n];
        for (k, &i) in order.iter().enumerate() {
            place[i as usize] = k as u32;
        }
        let (parent, count) = elimination_tree(a, &order, &place);
        let mut start = vec![0; n + 1];
        for k in 0..n {
            start[k + 1] = start[k] + count[k] as usize;
        }
        let mut f =
            Self { row: vec![0; start[n]], value: vec![0.0; start[n]], diagonal: vec![0.0; n], order, start };
        f.numeric(a, &place, &parent)?;
        Some(f)
    }

    fn numeric(&mut self, a: &Symmetric, place: &[u32], parent: &[u32]) -> Option<()> {
        let n = place.len();
        let mut end = self.start[..n].to_vec();
        let mut y = vec![0.0; n];
        let mut flag = vec![NONE; n];
        let mut pattern = vec![0_u32; n];
        let mut path = Vec::with_capacity(n);
        for k in 0..n {
            flag[k] = k as u32;
            let mut top = n;
            for (j, x) in a.row(self.order[k]) {
                let mut i = place[j as usize] as usize;
                if i >= k {
                    continue;
                }
                y[i] += x;
                while flag[i] != k as u32 {
                    path.push(i as u32);
                    flag[i] = k as u32;
                    i = parent[i] as usize;
                }
                while let Some(i) = path.pop() {
                    top -= 1;
                    pattern[top] = i;
                }
            }
            let mut d = a.diagonal[self.order[k] as usize];
            for &i in &pattern[top..n] {
                let i = i as usize;
                let yi = std::mem::take(&mut y[i]);
                let range = self.start[i]..end[i];
                for (&r, &l) in self.row[range.clone()].iter().zip(&self.value[range]) {
                    y[r as usize] -= l * yi;
                }
                let l = yi / self.diagonal[i];
                d -= l * yi;
                self.row[end[i]] = k as u32;
                self.value[end[i]] = l;
                end[i] += 1;
            }
            if !positive(d) || !d.is_finite() {
                return None;
            }
            self.diagonal[k] = d;
        }
        Some(())
    }

    /// Solves for one right-hand side of plane vectors, in place; `work` is scratch.
    pub(super) fn solve(&self, b: &mut [Vec2<f64>], work: &mut Vec<Vec2<f64>>) {
        let n = self.order.len();
        work.clear();
        work.extend(self.order.iter().map(|&i| b[i as usize]));
        for k in 0..n {
            let x = work[k];
            let range = self.start[k]..self.start[k + 1];
            for (&r, &l) in self.row[range.clone()].iter().zip(&self.value[range]) {
                work[r as usize] -= x * l;
            }
        }
        for k in (0..n).rev() {
            let mut x = work[k] * (1.0 / self.diagonal[k]);
            let range = self.start[k]..self.start[k + 1];
            for (&r, &l) in self.row[range.clone()].iter().zip(&self.value[range]) {
                x -= work[r as usize] * l;
            }
            work[k] = x;
        }
        for (k, &i) in self.order.iter().enumerate() {
            b[i as usize] = work[k];
        }
    }
}

fn elimination_tree(a: &Symmetric, order: &[u32], place: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let n = order.len();
    let mut parent = vec![NONE; n];
    let mut count = vec![0; n];
    let mut flag = vec![NONE; n];
    for k in 0..n {
        flag[k] = k as u32;
        for (j, _) in a.row(order[k]) {
            let mut i = place[j as usize] as usize;
            while i < k && flag[i] != k as u32 {
                if parent[i] == NONE {
                    parent[i] = k as u32;
                }
                count[i] += 1;
                flag[i] = k as u32;
                i = parent[i] as usize;
            }
        }
    }
    (parent, count)
}

/// Nested dissection: halves first, the separating vertices last.
fn dissect(a: &Symmetric, points: &[Vec2<f64>]) -> Vec<u32> {
    let n = points.len();
    // A vertex with very many neighbours would pull half of the mesh into a separator: those come last of all.
    let crowded = 16 + 10 * n.isqrt();
    let degree = |i: u32| (a.start[i as usize + 1] - a.start[i as usize]) as usize;
    let mut order: Vec<u32> = (0..n as u32).collect();
    order.sort_by_key(|&i| degree(i) > crowded);
    let plain = order.partition_point(|&i| degree(i) <= crowded);
    let mut side = vec![0_u32; n];
    let mut stamp = 0;
    let mut spare = Vec::new();
    let mut stack = vec![(0, plain)];
    while let Some((lo, hi)) = stack.pop() {
        if hi - lo <= 24 {
            continue;
        }
        let part = &mut order[lo..hi];
        let (mut low, mut high) = (points[part[0] as usize], points[part[0] as usize]);
        for &i in part.iter() {
            low = low.min(points[i as usize]);
            high = high.max(points[i as usize]);
        }
        let along_x = high.x - low.x >= high.y - low.y;
        let key = |i: u32| if along_x { points[i as usize].x } else { points[i as usize].y };
        let half = part.len() / 2;
        part.select_nth_unstable_by(half, |&i, &j| key(i).total_cmp(&key(j)).then(i.cmp(&j)));
        // The order inside the halves depends on the selection algorithm alone, never on threads or time.
        stamp += 1;
        for &i in &part[half..] {
            side[i as usize] = stamp;
        }
        spare.clear();
        let mut kept = 0;
        for k in 0..half {
            let i = part[k];
            if a.row(i).any(|(j, _)| side[j as usize] == stamp) {
                spare.push(i);
            } else {
                part[kept] = i;
                kept += 1;
            }
        }
        part.copy_within(half.., kept);
        let separator = part.len() - spare.len();
        part[separator..].copy_from_slice(&spare);
        if kept > 0 {
            stack.push((lo, lo + kept));
        }
        if separator > kept && hi - lo > separator - kept {
            stack.push((lo + kept, lo + separator));
        }
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_scalar::vec2;

    #[test]
    fn factor_solves_a_grid_laplacian() {
        let side = 23_u32;
        let n = (side * side) as usize;
        let mut diagonal = vec![0.01; n];
        let mut lower = Vec::new();
        for y in 0..side {
            for x in 0..side {
                let i = y * side + x;
                for j in [(x > 0).then(|| i - 1), (y > 0).then(|| i - side)].into_iter().flatten() {
                    let w = 1.0 + f64::from((i * 7 + j) % 5);
                    lower.push((i, j, -0.5 * w));
                    lower.push((i, j, -0.5 * w));
                    diagonal[i as usize] += w;
                    diagonal[j as usize] += w;
                }
            }
        }
        let a = Symmetric::new(diagonal, lower);
        let points: Vec<_> = (0..n as u32).map(|i| vec2(f64::from(i % side), f64::from(i / side))).collect();
        let f = Factor::new(&a, &points).unwrap();
        let want: Vec<Vec2<f64>> = points.iter().map(|p| vec2(p.x.sin(), (p.y * 0.7 + p.x).cos())).collect();
        let mut b: Vec<Vec2<f64>> = (0..n as u32)
            .map(|i| {
                a.row(i).fold(want[i as usize] * a.diagonal[i as usize], |s, (j, x)| s + want[j as usize] * x)
            })
            .collect();
        f.solve(&mut b, &mut Vec::new());
        let worst = b.iter().zip(&want).map(|(x, y)| (*x - *y).length()).fold(0.0, f64::max);
        assert!(worst < 1e-9, "largest difference {worst}");
        // Row after row, the factor would hold `side` numbers in each row.
        assert!(f.row.len() < 2 * n * side as usize / 3, "fill {} of {n} rows", f.row.len());
    }

    #[test]
    fn a_hub_does_not_fill_the_factor() {
        let n = 4000_u32;
        let mut diagonal = vec![4.0; n as usize];
        diagonal[0] = f64::from(2 * n);
        let ring = (1..n).map(|i| (i.max(i % (n - 1) + 1), i.min(i % (n - 1) + 1), -1.0));
        let a = Symmetric::new(diagonal, ring.chain((1..n).map(|i| (i, 0, -1.0))).collect());
        let at = |i: u32| (f64::from(i) * 0.001).sin_cos();
        let points: Vec<_> =
            (0..n).map(|i| if i == 0 { vec2(0.0, 0.0) } else { vec2(at(i).0, at(i).1) }).collect();
        let f = Factor::new(&a, &points).unwrap();
        assert!(f.row.len() < 20 * n as usize, "fill {}", f.row.len());
    }

    #[test]
    fn factor_refuses_an_indefinite_matrix() {
        let a = Symmetric::new(vec![1.0, 1.0], vec![(1, 0, 2.0)]);
        assert!(Factor::new(&a, &[vec2(0.0, 0.0), vec2(1.0, 0.0)]).is_none());
    }
}

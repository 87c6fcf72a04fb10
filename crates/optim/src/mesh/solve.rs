//! Triangular solves with a supernodal Cholesky factor, for up to four right-hand sides at once.
//!
//! Subtrees of the elimination tree depend on each other through their common ancestors only: each is swept by a thread
//! of its own, with a buffer for what it adds to its ancestors. Which subtrees depends on the factor alone, so the results
//! do not depend on the number of threads.

use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use rayon::prelude::*;
use std::ops::Range;

/// Right-hand sides side by side: a vector register full.
pub(super) type Lanes = [f64; 4];

#[inline(always)]
fn subtract(y: &mut Lanes, a: f64, x: &Lanes) {
    for k in 0..4 {
        y[k] -= a * x[k];
    }
}

#[inline(always)]
fn divide(y: &mut Lanes, a: f64) {
    y.iter_mut().for_each(|y| *y /= a);
}

/// The columns of supernode `s` (each of `size + pattern` rows), its first row, its size and its lower rows.
fn supernode<'a>(
    symbolic: &'a SymbolicSupernodalCholesky<u32>,
    values: &'a [f64],
    s: usize,
) -> (&'a [f64], usize, usize, &'a [u32]) {
    let (begin, end) = (symbolic.supernode_begin()[s], symbolic.supernode_end()[s]);
    let of_values = symbolic.col_ptr_for_val();
    let block = &values[of_values[s] as usize..of_values[s + 1] as usize];
    (block, begin as usize, (end - begin) as usize, symbolic.supernode(s).pattern())
}

/// A subtree of the elimination tree: its supernodes, and so its rows, are consecutive.
#[derive(Clone, Debug)]
struct Subtree {
    nodes: Range<usize>,
    rows: Range<usize>,
    /// Rows of ancestors that it touches, ascending.
    outside: Vec<u32>,
    /// For each supernode, one after the other, the places in `outside` of the rows of its pattern that lie there.
    places: Vec<u32>,
}

/// Which supernodes are swept together.
#[derive(Clone, Debug, Default)]
pub(super) struct Schedule {
    subtrees: Vec<Subtree>,
    /// The common ancestors, ascending.
    top: Vec<usize>,
}

/// A subtree holds at most this share of the factor, and at least a hundredth of that.
const SHARE: f64 = 0.1;

impl Schedule {
    pub(super) fn new(symbolic: &SymbolicSupernodalCholesky<u32>) -> Self {
        let nodes = symbolic.n_supernodes();
        let (begin, end) = (symbolic.supernode_begin(), symbolic.supernode_end());
        let node_of = |row: u32| end.partition_point(|e| *e <= row);
        let parents: Vec<Option<usize>> =
            (0..nodes).map(|s| symbolic.supernode(s).pattern().iter().min().map(|r| node_of(*r))).collect();
        let of_values = symbolic.col_ptr_for_val();
        let mut work: Vec<f64> =
            (0..nodes).map(|s| f64::from(of_values[s + 1]) - f64::from(of_values[s])).collect();
        let mut first: Vec<usize> = (0..nodes).collect();
        let mut size = vec![1_usize; nodes];
        for s in 0..nodes {
            if let Some(p) = parents[s].filter(|p| *p > s) {
                work[p] += work[s];
                first[p] = first[p].min(first[s]);
                size[p] += size[s];
            }
        }
        let sorted = (0..nodes).all(|s| symbolic.supernode(s).pattern().is_sorted());
        let most = if sorted { SHARE * f64::from(of_values[nodes]) } else { 0.0 };
        let mut schedule = Self::default();
        let mut s = nodes;
        while s > 0 {
            let root = s - 1;
            // Whatever is not one stretch of supernodes (the order is a postorder: all are) stays at the top.
            let whole = first[root] + size[root] == s;
            if whole && (0.01 * most..=most).contains(&work[root]) {
                let rows = begin[first[root]] as usize..end[root] as usize;
                schedule.subtrees.push(Subtree::new(symbolic, first[root]..s, rows));
                s = first[root];
            } else {
                schedule.top.push(root);
                s = root;
            }
        }
        schedule.subtrees.reverse();
        schedule.top.reverse();
        schedule
    }

    /// Overwrites `x` with the solution of `L L^T y = x`, rows in the factor's order; one sweep down, one up.
    pub(super) fn solve(&self, symbolic: &SymbolicSupernodalCholesky<u32>, values: &[f64], x: &mut [Lanes]) {
        let factor = Factor { symbolic, values };
        let outside: Vec<Vec<Lanes>> = self
            .split(x)
            .into_par_iter()
            .map(|(tree, x)| {
                let mut outside = vec![[0.0; 4]; tree.outside.len()];
                factor.sweep(Sweep::Down, tree.nodes.clone(), tree.rows.start, x, &mut outside, &tree.places);
                outside
            })
            .collect();
        for (tree, sums) in self.subtrees.iter().zip(&outside) {
            for (&row, sum) in tree.outside.iter().zip(sums) {
                add(&mut x[row as usize], sum);
            }
        }
        factor.sweep(Sweep::Down, self.top.iter().copied(), 0, x, &mut [], &[]);
        factor.sweep(Sweep::Up, self.top.iter().rev().copied(), 0, x, &mut [], &[]);
        let mut above = outside;
        for (tree, above) in self.subtrees.iter().zip(&mut above) {
            above.iter_mut().zip(&tree.outside).for_each(|(a, row)| *a = x[*row as usize]);
        }
        self.split(x).into_par_iter().zip(above).for_each(|((tree, x), mut above)| {
            factor.sweep(Sweep::Up, tree.nodes.clone().rev(), tree.rows.start, x, &mut above, &tree.places);
        });
    }

    /// The subtrees with their rows.
    fn split<'a>(&'a self, mut x: &'a mut [Lanes]) -> Vec<(&'a Subtree, &'a mut [Lanes])> {
        let mut at = 0;
        let mut parts = Vec::with_capacity(self.subtrees.len());
        for tree in &self.subtrees {
            let (own, rest) = x[tree.rows.start - at..].split_at_mut(tree.rows.len());
            parts.push((tree, own));
            (x, at) = (rest, tree.rows.end);
        }
        parts
    }
}

impl Subtree {
    fn new(symbolic: &SymbolicSupernodalCholesky<u32>, nodes: Range<usize>, rows: Range<usize>) -> Self {
        let beyond = |s: usize| symbolic.supernode(s).pattern().iter().filter(|r| **r as usize >= rows.end);
        let mut outside: Vec<u32> = nodes.clone().flat_map(beyond).copied().collect();
        outside.sort_unstable();
        outside.dedup();
        let place = |r: &u32| outside.partition_point(|o| o < r) as u32;
        let places = nodes.clone().flat_map(beyond).map(place).collect();
        Self { nodes, rows, outside, places }
    }
}

#[inline(always)]
fn add(y: &mut Lanes, x: &Lanes) {
    for k in 0..4 {
        y[k] += x[k];
    }
}

/// Direction of a substitution: `L y = x` or `L^T y = x`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sweep {
    Down,
    Up,
}

/// A factor.
#[derive(Clone, Copy)]
struct Factor<'a> {
    symbolic: &'a SymbolicSupernodalCholesky<u32>,
    values: &'a [f64],
}

impl Factor<'_> {
    /// Substitutes along `nodes`, whose rows are `x` from row `first` of the factor on; rows beyond are `outside`, in
    /// the order of `places`. The same operations on all instruction sets, so the same bits.
    fn sweep(
        self,
        sweep: Sweep,
        nodes: impl Iterator<Item = usize>,
        first: usize,
        x: &mut [Lanes],
        outside: &mut [Lanes],
        places: &[u32],
    ) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            #[expect(unsafe_code, reason = "calling a function compiled for AVX2")]
            // SAFETY: the feature was just detected.
            unsafe {
                self.sweep_avx2(sweep, nodes, first, x, outside, places);
            }
            return;
        }
        self.substitute(sweep, nodes, first, x, outside, places);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn sweep_avx2(
        self,
        sweep: Sweep,
        nodes: impl Iterator<Item = usize>,
        first: usize,
        x: &mut [Lanes],
        outside: &mut [Lanes],
        places: &[u32],
    ) {
        self.substitute(sweep, nodes, first, x, outside, places);
    }

    #[inline(always)]
    fn substitute(
        self,
        sweep: Sweep,
        nodes: impl Iterator<Item = usize>,
        first: usize,
        x: &mut [Lanes],
        outside: &mut [Lanes],
        mut places: &[u32],
    ) {
        let mut below: Vec<Lanes> = Vec::new();
        let end = first + x.len();
        for s in nodes {
            let (block, start, size, pattern) = supernode(self.symbolic, self.values, s);
            let (inside, beyond) = pattern.split_at(pattern.partition_point(|r| (*r as usize) < end));
            let own;
            below.clear();
            if sweep == Sweep::Down {
                (own, places) = places.split_at(beyond.len());
                below.resize(pattern.len(), [0.0; 4]);
                down(block, &mut x[start - first..][..size], &mut below);
                for (&row, sum) in inside.iter().zip(&below) {
                    add(&mut x[row as usize - first], sum);
                }
                for (&place, sum) in own.iter().zip(&below[inside.len()..]) {
                    add(&mut outside[place as usize], sum);
                }
            } else {
                (places, own) = places.split_at(places.len() - beyond.len());
                below.extend(inside.iter().map(|&row| x[row as usize - first]));
                below.extend(own.iter().map(|&place| outside[place as usize]));
                up(block, &mut x[start - first..][..size], &below);
            }
        }
    }
}

/// One supernode of `L y = x`: its own rows, and what it takes off the rows below.
///
/// A general dense kernel per supernode spends most of its time on dispatch, as most blocks have a few columns; here
/// each value of the factor is read once per sweep, in storage order.
#[inline(always)]
fn down(block: &[f64], top: &mut [Lanes], below: &mut [Lanes]) {
    let (size, rows) = (top.len(), top.len() + below.len());
    for (c, column) in block.chunks_exact(rows).enumerate() {
        divide(&mut top[c], column[c]);
        let pivot = top[c];
        for (y, a) in top[c + 1..].iter_mut().zip(&column[c + 1..size]) {
            subtract(y, *a, &pivot);
        }
        for (y, a) in below.iter_mut().zip(&column[size..]) {
            subtract(y, *a, &pivot);
        }
    }
}

/// One supernode of `L^T y = x`.
#[inline(always)]
fn up(block: &[f64], top: &mut [Lanes], below: &[Lanes]) {
    let (size, rows) = (top.len(), top.len() + below.len());
    for (c, column) in block.chunks_exact(rows).enumerate().rev() {
        let (own, rest) = top[c..].split_at_mut(1);
        // Four accumulators hide the latency of the additions; their order is fixed.
        let mut sums = [own[0], [0.0; 4], [0.0; 4], [0.0; 4]];
        for (y, a) in rest.iter().zip(&column[c + 1..size]) {
            subtract(&mut sums[0], *a, y);
        }
        let (fours, last) = below.as_chunks::<4>();
        let (fours_of_values, last_values) = column[size..].as_chunks::<4>();
        for (y, a) in fours.iter().zip(fours_of_values) {
            for k in 0..4 {
                subtract(&mut sums[k], a[k], &y[k]);
            }
        }
        for (y, a) in last.iter().zip(last_values) {
            subtract(&mut sums[0], *a, y);
        }
        for k in 0..4 {
            own[0][k] = ((sums[0][k] + sums[1][k]) + (sums[2][k] + sums[3][k])) / column[c];
        }
    }
}

//! Triangular solves with a supernodal Cholesky factor, for three right-hand sides at once.

use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;

/// Three right-hand sides side by side; the fourth lane fills the vector register.
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

/// Overwrites `x` with the solution of `L L^T y = x`, rows in the factor's order; one sweep down, one up.
///
/// A general dense kernel per supernode spends most of its time on dispatch, as most blocks have a few columns; here
/// each value of the factor is read once per sweep, in storage order.
pub(super) fn solve(symbolic: &SymbolicSupernodalCholesky<u32>, values: &[f64], x: &mut [Lanes]) {
    let nodes = symbolic.n_supernodes();
    let mut below: Vec<Lanes> = Vec::new();
    for s in 0..nodes {
        let (block, start, size, pattern) = supernode(symbolic, values, s);
        let rows = size + pattern.len();
        below.clear();
        below.resize(pattern.len(), [0.0; 4]);
        let top = &mut x[start..start + size];
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
        for (&row, sum) in pattern.iter().zip(&below) {
            let y = &mut x[row as usize];
            for k in 0..4 {
                y[k] += sum[k];
            }
        }
    }
    for s in (0..nodes).rev() {
        let (block, start, size, pattern) = supernode(symbolic, values, s);
        let rows = size + pattern.len();
        below.clear();
        below.extend(pattern.iter().map(|&row| x[row as usize]));
        let top = &mut x[start..start + size];
        for (c, column) in block.chunks_exact(rows).enumerate().rev() {
            let (own, rest) = top[c..].split_at_mut(1);
            // Two accumulators hide the latency of the additions; their order is fixed.
            let mut sums = [own[0], [0.0; 4]];
            for (y, a) in rest.iter().zip(&column[c + 1..size]) {
                subtract(&mut sums[0], *a, y);
            }
            let (pairs, last) = below.as_chunks::<2>();
            let (pairs_of_values, last_value) = column[size..].as_chunks::<2>();
            for (y, a) in pairs.iter().zip(pairs_of_values) {
                subtract(&mut sums[0], a[0], &y[0]);
                subtract(&mut sums[1], a[1], &y[1]);
            }
            for (y, a) in last.iter().zip(last_value) {
                subtract(&mut sums[0], *a, y);
            }
            for k in 0..4 {
                own[0][k] = (sums[0][k] + sums[1][k]) / column[c];
            }
        }
    }
}

//! `M = I + lambda L` on a graph: construction, factorisation and solves.

use super::solve::{Lanes, Schedule};
use crate::error::OptimError;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Par, Side};
use photofit_scalar::Real;
use rayon::prelude::*;

/// `M = I + lambda L`, `L` the Laplacian of a graph with edge weights, and its Cholesky factor. An M-matrix: the
/// inverse is non-negative with rows of sum one, and substitution adds terms of one sign only, so filtered squares
/// cannot turn negative.
#[derive(Debug)]
pub(super) struct Screened {
    pub(super) lambda: f64,
    /// Neighbours of each vertex, ascending, in compressed rows.
    pub(super) offsets: Vec<u32>,
    pub(super) neighbours: Vec<u32>,
    cholesky: Cholesky,
}

/// The factor, with rows in its own order.
#[derive(Debug)]
enum Cholesky {
    /// `M = I`: a graph without edges.
    Identity {
        order: Vec<u32>,
    },
    Factor {
        symbolic: Box<SymbolicCholesky<u32>>,
        values: Vec<f64>,
        schedule: Schedule,
    },
}

impl Screened {
    /// Factorises for `vertices` vertices joined by `edges` (undirected; repeats and loops count once and not at
    /// all) of weight one; `name` is that of the operator in messages.
    pub(super) fn new(
        name: &str,
        vertices: usize,
        edges: &[[u32; 2]],
        lambda: f64,
    ) -> Result<Self, OptimError> {
        let good = lambda >= 0.0 && lambda.is_finite();
        OptimError::setting(name, "lambda", lambda, "finite and not negative", good)?;
        let count = edges.len() as f64;
        OptimError::setting(name, "edge count", count, "below 2^29", edges.len() < 1 << 29)?;
        OptimError::setting(name, "vertex count", vertices as f64, "below 2^30", vertices < 1 << 30)?;
        let mut pairs = Vec::with_capacity(2 * edges.len());
        for (edge, &[a, b]) in edges.iter().enumerate() {
            if a.max(b) as usize >= vertices {
                return Err(OptimError::EdgeOutOfRange { edge, vertex: a.max(b), vertices });
            }
            if a != b {
                pairs.extend([[a, b], [b, a]]);
            }
        }
        pairs.par_sort_unstable();
        pairs.dedup();
        let mut offsets = vec![0_u32; vertices + 1];
        for [a, _] in &pairs {
            offsets[*a as usize + 1] += 1;
        }
        for i in 0..vertices {
            offsets[i + 1] += offsets[i];
        }
        let neighbours: Vec<u32> = pairs.into_iter().map(|[_, b]| b).collect();
        let mut matrix = Lower::default();
        matrix.fill(&offsets, &neighbours, lambda, |_, _| 1.0);
        let fail = |reason| OptimError::Factorization { vertices, reason };
        if neighbours.is_empty() {
            let cholesky = Cholesky::Identity { order: (0..vertices as u32).collect() };
            return Ok(Self { lambda, offsets, neighbours, cholesky });
        }
        let symbolic = matrix.analyse().map_err(fail)?;
        let mut values = Vec::new();
        values.try_reserve_exact(symbolic.len_val()).map_err(|e| fail(e.to_string()))?;
        values.resize(symbolic.len_val(), 0.0);
        matrix.factorize(&symbolic, &mut values).map_err(fail)?;
        let schedule = match symbolic.raw() {
            SymbolicCholeskyRaw::Supernodal(symbolic) => Schedule::new(symbolic),
            // `Lower::analyse` refuses a factor of any other kind.
            SymbolicCholeskyRaw::Simplicial(_) => Schedule::default(),
        };
        Ok(Self {
            lambda,
            offsets,
            neighbours,
            cholesky: Cholesky::Factor { symbolic: Box::new(symbolic), values, schedule },
        })
    }

    pub(super) fn vertices(&self) -> usize {
        self.offsets.len() - 1
    }

    pub(super) fn factor_bytes(&self) -> usize {
        match &self.cholesky {
            Cholesky::Identity { .. } => 0,
            Cholesky::Factor { values, .. } => size_of_val(values.as_slice()),
        }
    }

    /// Factorises anew for symmetric edge weights, which must not be negative; the pattern is kept.
    pub(super) fn reweigh(&mut self, weight: impl Fn(usize, usize) -> f64) -> Result<(), OptimError> {
        let vertices = self.vertices();
        let Cholesky::Factor { symbolic, values, .. } = &mut self.cholesky else { return Ok(()) };
        let mut matrix = Lower::default();
        matrix.fill(&self.offsets, &self.neighbours, self.lambda, weight);
        let fail = |reason| OptimError::Factorization { vertices, reason };
        matrix.factorize(symbolic, values).map_err(fail)
    }

    /// Old index of each row of the factor, and row of each old index.
    pub(super) fn order(&self) -> (&[u32], &[u32]) {
        match &self.cholesky {
            Cholesky::Identity { order } => (order, order),
            // `Lower::analyse` refuses a factor without order.
            Cholesky::Factor { symbolic, .. } => symbolic.perm().map_or((&[], &[]), |order| order.arrays()),
        }
    }

    /// Overwrites right-hand sides, in the factor's order, with the solutions.
    pub(super) fn solve(&self, lanes: &mut [Lanes]) {
        let Cholesky::Factor { symbolic, values, schedule } = &self.cholesky else { return };
        // `Lower::analyse` refuses a factor of any other kind.
        if let SymbolicCholeskyRaw::Supernodal(symbolic) = symbolic.raw() {
            schedule.solve(symbolic, values, lanes);
        }
    }

    /// `M^-1` of every channel of every field (rows of one or more samples per vertex), four channels to a solve.
    pub(super) fn apply<T: Real>(&self, fields: &[&[T]], out: &mut [&mut [T]], lanes: &mut Vec<Lanes>) {
        let n = self.vertices();
        if n == 0 {
            return;
        }
        let widths: Vec<usize> = fields.iter().map(|f| f.len() / n).collect();
        let planes: Vec<[usize; 2]> =
            widths.iter().enumerate().flat_map(|(f, w)| (0..*w).map(move |c| [f, c])).collect();
        let (forward, inverse) = self.order();
        for group in planes.chunks(4) {
            forward
                .par_iter()
                .with_min_len(4096)
                .map(|&i| {
                    let mut lane = [0.0; 4];
                    for (lane, &[f, c]) in lane.iter_mut().zip(group) {
                        *lane = fields[f][widths[f] * i as usize + c].f64();
                    }
                    lane
                })
                .collect_into_vec(lanes);
            self.solve(lanes);
            for (f, out) in out.iter_mut().enumerate() {
                let mine: Vec<[usize; 2]> =
                    group.iter().enumerate().filter(|(_, p)| p[0] == f).map(|(k, p)| [k, p[1]]).collect();
                if mine.is_empty() {
                    continue;
                }
                out.par_chunks_mut(widths[f]).with_min_len(4096).zip(inverse).for_each(|(row, &i)| {
                    for &[k, c] in &mine {
                        row[c] = T::of(lanes[i as usize][k]);
                    }
                });
            }
        }
    }
}

/// Lower triangle of `M` by columns.
#[derive(Debug, Default)]
struct Lower {
    starts: Vec<u32>,
    rows: Vec<u32>,
    values: Vec<f64>,
}

impl Lower {
    fn fill(
        &mut self,
        offsets: &[u32],
        neighbours: &[u32],
        lambda: f64,
        weight: impl Fn(usize, usize) -> f64,
    ) {
        let n = offsets.len() - 1;
        self.starts.reserve(n + 1);
        self.rows.reserve(n + neighbours.len() / 2);
        self.values.reserve(n + neighbours.len() / 2);
        self.starts.push(0);
        for j in 0..n {
            let diagonal = self.rows.len();
            self.rows.push(j as u32);
            self.values.push(0.0);
            let mut sum = 0.0;
            for &i in &neighbours[offsets[j] as usize..offsets[j + 1] as usize] {
                let w = weight(i as usize, j);
                sum += w;
                if i as usize > j {
                    self.rows.push(i);
                    self.values.push(-lambda * w);
                }
            }
            self.values[diagonal] = 1.0 + lambda * sum;
            self.starts.push(self.rows.len() as u32);
        }
    }

    fn structure(&self) -> SymbolicSparseColMatRef<'_, u32> {
        let n = self.starts.len() - 1;
        SymbolicSparseColMatRef::new_checked(n, n, &self.starts, None, &self.rows)
    }

    /// Order by AMD and pattern of the factor.
    fn analyse(&self) -> Result<SymbolicCholesky<u32>, String> {
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..CholeskySymbolicParams::default()
        };
        let symbolic =
            factorize_symbolic_cholesky(self.structure(), Side::Lower, SymmetricOrdering::Amd, params)
                .map_err(|e| e.to_string())?;
        let supernodal = matches!(symbolic.raw(), SymbolicCholeskyRaw::Supernodal(_));
        if supernodal && symbolic.perm().is_some() {
            Ok(symbolic)
        } else {
            Err("the factor is not the ordered, supernodal one that was asked for".to_owned())
        }
    }

    /// The factor's values, in one thread.
    fn factorize(&self, symbolic: &SymbolicCholesky<u32>, factor: &mut [f64]) -> Result<(), String> {
        let matrix = SparseColMatRef::new(self.structure(), &self.values);
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let mut memory = MemBuffer::try_new(scratch).map_err(|e| format!("out of memory ({e:?})"))?;
        symbolic
            .factorize_numeric_llt(
                factor,
                matrix,
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                Default::default(),
            )
            .map_err(|e| e.to_string())?;
        Ok(())
    }
}

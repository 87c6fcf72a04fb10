//! The filters `M^-1`, `M = I + lambda L`, of Large Steps and of edge-aware diffusion on a device.

use crate::OptimError;
use photofit_gpu::{Bind, Buffer, Gpu, GpuError, INDEX, Kernel, Recorder};

const SOURCE: &[&str] = &[INDEX, include_str!("../mesh/large_steps.wgsl")];
pub(super) const ITERATE: Kernel = Kernel { name: "large_steps", source: SOURCE, entry: "iterate" };
pub(super) const ITERATE_WEIGHTED: Kernel =
    Kernel { name: "edge_aware", source: SOURCE, entry: "iterate_weighted" };
pub(super) const WEIGH: Kernel = Kernel { name: "edge_aware.weigh", source: SOURCE, entry: "weigh" };

/// Name in messages.
const NAME: &str = "large steps";
/// The error that iterations leave, relative to the solution: below the rounding of single precision.
const ERROR: f64 = 3e-8;
/// Iterations of the power method for the bound of the spectrum.
const POWER: usize = 40;
/// Most iterations of a solve.
const MOST: f64 = 2000.0;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Params {
    vertices: u32,
    begins: u32,
    lambda: f32,
    omega: f32,
    sigma: f32,
    unused: [u32; 3],
}

/// Edges that weigh less, the farther the normals of their ends are apart.
#[derive(Clone, Debug)]
struct Creases {
    weights: Buffer<f32>,
    sigma: f64,
}

/// Solves `M x = b` for vectors of three on a device, by Chebyshev's semi-iteration with Jacobi's preconditioner.
///
/// It needs no sums over the mesh: bounds of the spectrum are computed once on the CPU, and their ratio (the condition
/// number) says how many iterations bring the error below single precision. Every solve begins at zero, so that a fit that
/// goes on from a checkpoint finds the same bits.
///
/// [`Self::edge_aware`] makes it the twin of [`EdgeAware`](crate::EdgeAware), whose weights are computed for each step.
#[derive(Clone, Debug)]
pub struct LargeStepsSolver {
    rings: Buffer<u32>,
    other: Buffer<f32>,
    vertices: usize,
    lambda: f64,
    bound: f64,
    iterations: usize,
    creases: Option<Creases>,
}

impl LargeStepsSolver {
    /// For the graph with these neighbours, in compressed rows (symmetric); `lambda` is the
    /// weight of the Laplacian.
    ///
    /// # Errors
    /// [`OptimError::Setting`] for `lambda` or neighbours out of range, and [`OptimError::Device`].
    pub fn new(gpu: &Gpu, offsets: &[u32], neighbours: &[u32], lambda: f64) -> Result<Self, OptimError> {
        OptimError::setting(
            NAME,
            "lambda",
            lambda,
            "finite and not negative",
            lambda >= 0.0 && lambda.is_finite(),
        )?;
        let vertices = offsets.len().saturating_sub(1);
        let rows = offsets.first().is_some_and(|o| *o == 0)
            && offsets.is_sorted()
            && offsets.last().is_some_and(|o| *o as usize == neighbours.len());
        let rule = "the length of the neighbours, after ascending ones from 0";
        let last = f64::from(offsets.last().copied().unwrap_or(0));
        OptimError::setting(NAME, "last offset", last, rule, rows)?;
        let outside = neighbours.iter().find(|n| **n as usize >= vertices).copied();
        let rule = "a vertex";
        OptimError::setting(NAME, "neighbour", f64::from(outside.unwrap_or(0)), rule, outside.is_none())?;
        let bound = jacobi_bound(offsets, neighbours, lambda);
        let rings = gpu.upload("neighbours", &[offsets, neighbours].concat())?;
        let other = gpu.zeros("iterate of large steps", 3 * vertices)?;
        Ok(Self { rings, other, vertices, lambda, bound, iterations: iterations(bound), creases: None })
    }

    /// [`Self::new`] where the edge between vertices `i` and `j` weighs `exp(-|n_i - n_j| / sigma)`, `sigma` positive, by the
    /// normals of [`DeviceOptimizer::record_guide`](super::DeviceOptimizer::record_guide).
    ///
    /// # Errors
    /// As [`Self::new`], and [`OptimError::Setting`] for `sigma`.
    pub fn edge_aware(
        gpu: &Gpu,
        offsets: &[u32],
        neighbours: &[u32],
        lambda: f64,
        sigma: f64,
    ) -> Result<Self, OptimError> {
        OptimError::setting("edge-aware diffusion", "sigma", sigma, "positive", sigma > 0.0)?;
        let mut made = Self::new(gpu, offsets, neighbours, lambda)?;
        // For weights of at most one, whatever they are: the largest sum of a row of Jacobi's matrix.
        let most = offsets.windows(2).map(|o| f64::from(o[1] - o[0])).fold(0.0, f64::max);
        made.bound = lambda * most / (1.0 + lambda * most);
        made.iterations = iterations(made.bound);
        made.creases = Some(Creases { weights: gpu.zeros("weights of edges", neighbours.len())?, sigma });
        Ok(made)
    }

    /// Computes the weights of [`Self::edge_aware`] for the solves that follow; others have none.
    pub(super) fn weigh<N: bytemuck::Pod>(
        &self,
        r: &mut Recorder,
        normals: &Buffer<N>,
    ) -> Result<(), GpuError> {
        let Some(creases) = &self.creases else { return Ok(()) };
        let buffers = [self.rings.bind(), creases.weights.bind(), normals.bind()];
        r.dispatch(&WEIGH, &self.params(0, 1.0), &buffers, self.vertices)?;
        Ok(())
    }

    fn params(&self, iteration: usize, omega: f64) -> Params {
        Params {
            vertices: self.vertices as u32,
            begins: u32::from(iteration == 0),
            lambda: self.lambda as f32,
            omega: omega as f32,
            sigma: self.creases.as_ref().map_or(1.0, |c| c.sigma as f32),
            unused: [0; 3],
        }
    }

    /// Iterations of a solve.
    pub fn iterations(&self) -> usize {
        self.iterations
    }

    /// Bound of the condition number of the preconditioned matrix.
    pub fn condition(&self) -> f64 {
        (1.0 + self.bound) / (1.0 - self.bound)
    }

    /// Vertices of the graph.
    pub fn vertices(&self) -> usize {
        self.vertices
    }

    /// Writes to `x` the solution for the right-hand sides `b`.
    ///
    /// # Errors
    /// If the device refuses the kernel.
    pub fn solve(&self, r: &mut Recorder, b: &Bind, x: &Buffer<f32>) -> Result<(), GpuError> {
        r.clear(x);
        let mut omega = 1.0;
        for k in 0..self.iterations {
            omega = match k {
                0 => 1.0,
                1 => 1.0 / (1.0 - 0.5 * self.bound * self.bound),
                _ => 1.0 / (1.0 - 0.25 * self.bound * self.bound * omega),
            };
            let (present, next) = if k % 2 == 0 { (x, &self.other) } else { (&self.other, x) };
            let buffers = [self.rings.bind(), b.clone(), present.bind(), next.bind()];
            let weights = self.creases.as_ref().map(|c| c.weights.bind());
            let kernel = if weights.is_some() { &ITERATE_WEIGHTED } else { &ITERATE };
            let buffers: Vec<Bind> = buffers.into_iter().chain(weights).collect();
            r.dispatch(kernel, &self.params(k, omega), &buffers, self.vertices)?;
        }
        Ok(())
    }
}

/// A bound of the spectral radius of Jacobi's iteration matrix `J = lambda D^-1 A`, `D = 1 + lambda degree`: for a positive
/// vector `w` and a matrix without negative entries, it is at most the largest `(J w)_i / w_i` (Collatz 1942). The power
/// method brings `w` near the vector for which it is the radius.
fn jacobi_bound(offsets: &[u32], neighbours: &[u32], lambda: f64) -> f64 {
    let rows = || offsets.windows(2).map(|o| &neighbours[o[0] as usize..o[1] as usize]);
    let mut w = vec![1.0_f64; offsets.len().saturating_sub(1)];
    let mut best = f64::INFINITY;
    for _ in 0..POWER {
        let around = |row: &[u32]| row.iter().map(|j| w[*j as usize]).sum::<f64>();
        let product: Vec<f64> =
            rows().map(|row| lambda * around(row) / (1.0 + lambda * row.len() as f64)).collect();
        best = product.iter().zip(&w).map(|(p, w)| p / w).fold(0.0, f64::max).min(best);
        // The mean with w itself keeps entries positive and dampens what swings.
        w.iter_mut().zip(&product).for_each(|(w, p)| *w = 0.5 * (*w + *p));
    }
    // Room for rounding; below 1, as diagonals dominate.
    (best * (1.0 + 1e-9)).min(1.0 - 1e-12)
}

/// Iterations after which the error is [`ERROR`] of the first: it falls by `2 s^k / (1 + s^2k)`,
/// `s = bound / (1 + sqrt(1 - bound^2))`. An even number: the solution then lies where it is asked for.
fn iterations(bound: f64) -> usize {
    let s = bound / (1.0 + (1.0 - bound * bound).sqrt());
    if s <= 0.0 {
        return 2;
    }
    (((2.0 / ERROR).ln() / -s.ln()).ceil().min(MOST) as usize).next_multiple_of(2)
}

//! The conditioning network: affine layers with leaky rectifiers, forward and vector-Jacobian product on plain slices.
//!
//! Weights are stored input by input, `(1 + inputs) x outputs` with the bias first, so that one input multiplies a run
//! of consecutive weights: the loops over outputs become vector instructions without reordering a sum, and one vertex
//! needs no batch to be fast.

use photofit_scalar::Real;

/// Units of a hidden layer.
pub const HIDDEN: usize = 32;
/// Outputs come in multiples of this.
pub const LANES: usize = 16;
/// Slope of the rectifier below zero.
const LEAK: f64 = 0.01;
/// Vertices that are answered side by side, one in each lane of a vector.
pub const PACKET: usize = 16;
/// Outputs that are summed side by side then, each for a whole vector of vertices.
const BLOCK: usize = 4;

/// Two hidden layers of [`HIDDEN`] units between `inputs` numbers and `outputs` numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Network {
    /// Inputs.
    pub inputs: usize,
    /// Outputs, a multiple of [`LANES`].
    pub outputs: usize,
}

/// What the vector-Jacobian product needs: the values of the hidden layers.
#[derive(Clone, Debug)]
pub struct Hidden<T>([[T; HIDDEN]; 2]);

impl<T: Real> Default for Hidden<T> {
    fn default() -> Self {
        Self([[T::zero(); HIDDEN]; 2])
    }
}

impl Network {
    /// Number of weights.
    pub fn len(self) -> usize {
        let [a, b, c] = self.parts();
        a + b + c
    }

    /// Whether there are no weights: never.
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    fn parts(self) -> [usize; 3] {
        [(1 + self.inputs) * HIDDEN, (1 + HIDDEN) * HIDDEN, (1 + HIDDEN) * self.outputs]
    }

    /// Weights before training: He's normal variance in uniform numbers of `random` in `[-1, 1)`; the last layer is zero,
    /// so that an untrained network gives zeros.
    pub fn init<T: Real>(self, weights: &mut [T], mut random: impl FnMut() -> T) {
        weights.fill(T::zero());
        let [first, second, _] = self.parts();
        for (range, inputs) in [(0..first, self.inputs), (first..first + second, HIDDEN)] {
            let bound = T::of((6.0 / inputs as f64).sqrt());
            for w in &mut weights[range][HIDDEN..] {
                *w = random() * bound;
            }
        }
    }

    /// Outputs at `x` into `y`.
    #[inline(always)]
    pub fn forward<T: Real>(self, weights: &[T], x: &[T], hidden: &mut Hidden<T>, y: &mut [T]) {
        let first = self.first(weights, x);
        self.rest(weights, &first, &[], hidden, y);
    }

    /// What the first inputs bring to the first layer, bias included: for [`Self::rest`].
    #[inline(always)]
    pub fn first<T: Real>(self, weights: &[T], x: &[T]) -> [T; HIDDEN] {
        let (bias, rows) = weights[..(1 + self.inputs) * HIDDEN].split_at(HIDDEN);
        let mut sum = [T::zero(); HIDDEN];
        sum.copy_from_slice(bias);
        add(sum, rows, HIDDEN, x)
    }

    /// Outputs into `y` where `first` stands for the first inputs and `x` for the last.
    #[inline(always)]
    pub fn rest<T: Real>(
        self,
        weights: &[T],
        first: &[T; HIDDEN],
        x: &[T],
        hidden: &mut Hidden<T>,
        y: &mut [T],
    ) {
        let [a, b, _] = self.parts();
        let [one, two] = &mut hidden.0;
        *one = add(*first, &weights[a - x.len() * HIDDEN..a], HIDDEN, x);
        rectify(one);
        affine(&weights[a..a + b], one, two);
        rectify(two);
        affine(&weights[a + b..], two, &mut y[..self.outputs]);
    }

    /// [`Self::rest`] for many vertices, one in each lane, to the same bits. `first` becomes the first hidden layer.
    #[inline(always)]
    pub fn rest_of_packet<T: Real>(
        self,
        weights: &[T],
        first: &mut [[T; PACKET]; HIDDEN],
        x: &[[T; PACKET]],
        y: &mut [[T; PACKET]],
    ) {
        let [a, b, _] = self.parts();
        let mut second = [[T::zero(); PACKET]; HIDDEN];
        add_packet(first, &weights[a - x.len() * HIDDEN..a], x);
        rectify(first.as_flattened_mut());
        affine_packet(&weights[a..a + b], first, &mut second);
        rectify(second.as_flattened_mut());
        affine_packet(&weights[a + b..], &second, &mut y[..self.outputs]);
    }

    /// Adds to the gradients of the weights and of `x` for those of the outputs.
    #[inline(always)]
    pub fn forward_vjp<T: Real>(
        self,
        weights: &[T],
        x: &[T],
        hidden: &Hidden<T>,
        g_y: &[T],
        g_weights: &mut [T],
        g_x: &mut [T],
    ) {
        let [a, b, _] = self.parts();
        let [first, second] = &hidden.0;
        let (mut g_first, mut g_second) = ([T::zero(); HIDDEN], [T::zero(); HIDDEN]);
        affine_vjp(&weights[a + b..], second, &g_y[..self.outputs], &mut g_weights[a + b..], &mut g_second);
        rectify_vjp(second, &mut g_second);
        affine_vjp(&weights[a..a + b], first, &g_second, &mut g_weights[a..a + b], &mut g_first);
        rectify_vjp(first, &mut g_first);
        affine_vjp(&weights[..a], x, &g_first, &mut g_weights[..a], g_x);
    }
}

/// `sum + weights^T x` for so many outputs, the first of each row of `outputs` weights from `weights` on.
#[inline(always)]
fn add<T: Real, const N: usize>(mut sum: [T; N], weights: &[T], outputs: usize, x: &[T]) -> [T; N] {
    let rows = weights.chunks(outputs).filter_map(|row| row.first_chunk::<N>());
    for (row, x) in rows.zip(x) {
        for k in 0..N {
            sum[k] += row[k] * *x;
        }
    }
    sum
}

/// `y = bias + weights^T x`.
#[inline(always)]
fn affine<T: Real>(weights: &[T], x: &[T], y: &mut [T]) {
    let outputs = y.len();
    let (bias, rows) = weights.split_at(outputs);
    // As many sums side by side as registers hold: each waits for its last addition.
    let (blocks, rest) = y.as_chunks_mut::<HIDDEN>();
    let done = blocks.len() * HIDDEN;
    for (c, y) in blocks.iter_mut().enumerate() {
        y.copy_from_slice(&bias[c * HIDDEN..][..HIDDEN]);
        *y = add(*y, &rows[c * HIDDEN..], outputs, x);
    }
    for (c, y) in rest.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
        y.copy_from_slice(&bias[done + c * LANES..][..LANES]);
        *y = add(*y, &rows[done + c * LANES..], outputs, x);
    }
}

/// [`affine`] of a vector in each lane.
#[inline(always)]
fn affine_packet<T: Real>(weights: &[T], x: &[[T; PACKET]], y: &mut [[T; PACKET]]) {
    let (bias, rows) = weights.split_at(y.len());
    for (y, bias) in y.iter_mut().zip(bias) {
        *y = [*bias; PACKET];
    }
    add_packet(y, rows, x);
}

/// [`add`] of a vector in each lane, whose outputs come in blocks.
#[inline(always)]
fn add_packet<T: Real>(y: &mut [[T; PACKET]], weights: &[T], x: &[[T; PACKET]]) {
    let outputs = y.len();
    for (c, block) in y.as_chunks_mut::<BLOCK>().0.iter_mut().enumerate() {
        // One name for each sum: with an array of them, which does not stay in registers, answers take three times as long.
        let [mut s, mut t, mut u, mut v] = *block;
        let rows = weights[c * BLOCK..].chunks(outputs).filter_map(|row| row.first_chunk::<BLOCK>());
        for (row, x) in rows.zip(x) {
            for l in 0..PACKET {
                s[l] += row[0] * x[l];
            }
            for l in 0..PACKET {
                t[l] += row[1] * x[l];
            }
            for l in 0..PACKET {
                u[l] += row[2] * x[l];
            }
            for l in 0..PACKET {
                v[l] += row[3] * x[l];
            }
        }
        *block = [s, t, u, v];
    }
}

/// Adds to the gradients of weights and input.
#[inline(always)]
fn affine_vjp<T: Real>(weights: &[T], x: &[T], g_y: &[T], g_weights: &mut [T], g_x: &mut [T]) {
    let outputs = g_y.len();
    let (bias, rest) = g_weights.split_at_mut(outputs);
    for (b, g) in bias.iter_mut().zip(g_y) {
        *b += *g;
    }
    let rows = weights[outputs..].chunks_exact(outputs).zip(rest.chunks_exact_mut(outputs));
    for ((row, g_row), (x, g_x)) in rows.zip(x.iter().zip(g_x)) {
        let mut sum = [T::zero(); LANES];
        let lanes = row.as_chunks::<LANES>().0.iter().zip(g_row.as_chunks_mut::<LANES>().0);
        for ((w, g_w), g) in lanes.zip(g_y.as_chunks::<LANES>().0) {
            for k in 0..LANES {
                g_w[k] += *x * g[k];
                sum[k] += w[k] * g[k];
            }
        }
        *g_x += photofit_scalar::halved_sum(sum);
    }
}

#[inline(always)]
fn rectify<T: Real>(x: &mut [T]) {
    for v in x {
        *v = v.max(*v * T::of(LEAK));
    }
}

/// The rectifier keeps signs: its output tells the slope.
#[inline(always)]
fn rectify_vjp<T: Real>(output: &[T], g: &mut [T]) {
    for (g, o) in g.iter_mut().zip(output) {
        if *o < T::zero() {
            *g *= T::of(LEAK);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_gradcheck::{Uniform, check};

    #[test]
    fn gradients_agree_with_differences() {
        let mut random = Uniform::new(1);
        let network = Network { inputs: 5, outputs: LANES };
        let mut at = random.vec(network.len(), -0.5, 0.5);
        at.extend(random.vec(5, -1.0, 1.0));
        let g_y = random.vec(LANES, -1.0, 1.0);
        let n = network.len();
        let value = |v: &[f64]| {
            let mut y = [0.0; LANES];
            network.forward(&v[..n], &v[n..], &mut Hidden::default(), &mut y);
            y.iter().zip(&g_y).map(|(y, g)| y * g).sum::<f64>()
        };
        let (mut hidden, mut y) = (Hidden::default(), [0.0; LANES]);
        network.forward(&at[..n], &at[n..], &mut hidden, &mut y);
        let mut gradient = vec![0.0; n + 5];
        let (g_w, g_x) = gradient.split_at_mut(n);
        network.forward_vjp(&at[..n], &at[n..], &hidden, &g_y, g_w, g_x);
        check("network", &at, &gradient, 1e-6, 1e-6, value);
    }

    #[test]
    fn untrained_networks_give_zeros() {
        let network = Network { inputs: 3, outputs: 32 };
        let mut weights = vec![1.0_f32; network.len()];
        let mut random = Uniform::new(2);
        network.init(&mut weights, || random.range(-1.0, 1.0) as f32);
        let mut y = [1.0; 32];
        network.forward(&weights, &[0.3, -2.0, 5.0], &mut Hidden::default(), &mut y);
        assert_eq!(y, [0.0; 32]);
    }
}

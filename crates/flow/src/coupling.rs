//! A stack of coupling layers on the unit square, conditioned on features: each layer keeps one coordinate and warps the
//! other with a spline whose logits a network makes from the features and the kept coordinate.

mod packet;

pub use packet::Asked;

use crate::elementary::sin_cos_pi;
use crate::network::{HIDDEN, Hidden, LANES, Network};
use crate::spline::{BINS_MAX, Family, Spline};
use photofit_scalar::Real;
use photofit_scalar::wide::{Kernel, Width, run_up_to};

/// Numbers that encode the kept coordinate: itself, sines and cosines of three octaves.
const KEPT: usize = 7;
/// Most features of a condition.
pub const CONDITION_MAX: usize = 32;
/// Most inputs and outputs of a layer's network.
const INPUTS_MAX: usize = CONDITION_MAX + KEPT;
const OUTPUTS_MAX: usize = (3 * BINS_MAX + 1).next_multiple_of(LANES);
/// Most layers.
const LAYERS_MAX: usize = 4;

/// The shape of a flow: data `x` to latent `z`, both in the unit square, `q(x) = |dz/dx|` for uniform `z`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Couplings {
    /// Layers, at most 4; even ones keep the first coordinate.
    pub layers: usize,
    /// Bins of a spline, at most [`BINS_MAX`].
    pub bins: usize,
    /// The splines.
    pub family: Family,
    /// Features that condition all layers, at most [`CONDITION_MAX`].
    pub condition: usize,
}

/// What a condition brings to the first hidden layers of the networks.
#[derive(Clone, Copy, Debug)]
pub struct Conditioned<T>([[T; HIDDEN]; LAYERS_MAX]);

/// What the vector-Jacobian product needs of a layer.
#[derive(Clone, Debug)]
struct Saved<T> {
    kept: T,
    warped: T,
    input: [T; INPUTS_MAX],
    hidden: Hidden<T>,
    spline: Spline<T>,
}

impl Couplings {
    /// The network of each layer.
    pub fn network(&self) -> Network {
        Network {
            inputs: self.condition + KEPT,
            outputs: self.family.logits(self.bins).next_multiple_of(LANES),
        }
    }

    /// Number of weights of all layers.
    pub fn len(&self) -> usize {
        self.layers * self.network().len()
    }

    /// Whether there are no weights.
    pub fn is_empty(&self) -> bool {
        self.layers == 0
    }

    /// Whether the limits are kept.
    pub fn is_valid(&self) -> bool {
        (1..=LAYERS_MAX).contains(&self.layers)
            && (1..=BINS_MAX).contains(&self.bins)
            && self.condition <= CONDITION_MAX
    }

    /// Weights of an identity: see [`Network::init`].
    pub fn init<T: Real>(&self, weights: &mut [T], mut random: impl FnMut() -> T) {
        let network = self.network();
        for layer in weights.chunks_exact_mut(network.len()) {
            network.init(layer, &mut random);
        }
    }

    /// What all answers under one condition share.
    #[inline]
    pub fn under<T: Real>(&self, weights: &[T], condition: &[T]) -> Conditioned<T> {
        run_up_to(Width::Avx512, Under { couplings: self, weights, condition })
    }

    /// The spline of a layer.
    #[inline(always)]
    fn spline<T: Real>(&self, weights: &[T], layer: usize, at: &Conditioned<T>, kept: T) -> Spline<T> {
        let network = self.network();
        let (mut hidden, mut logits) = (Hidden::default(), [T::zero(); OUTPUTS_MAX]);
        let weights = &weights[layer * network.len()..][..network.len()];
        network.rest(weights, &at.0[layer], &encode(kept), &mut hidden, &mut logits);
        Spline::new(self.family, self.bins, &logits[..network.outputs])
    }

    /// `(z, q(x))`.
    #[inline]
    pub fn forward<T: Real>(&self, weights: &[T], at: &Conditioned<T>, x: [T; 2]) -> ([T; 2], T) {
        self.warp::<T, true>(weights, at, x)
    }

    /// `(x, q(x))` for `z`: a sample where `z` is uniform.
    #[inline]
    pub fn inverse<T: Real>(&self, weights: &[T], at: &Conditioned<T>, z: [T; 2]) -> ([T; 2], T) {
        self.warp::<T, false>(weights, at, z)
    }

    /// [`Self::forward`] or [`Self::inverse`].
    #[inline]
    fn warp<T: Real, const FORWARD: bool>(
        &self,
        weights: &[T],
        at: &Conditioned<T>,
        x: [T; 2],
    ) -> ([T; 2], T) {
        run_up_to(Width::Avx512, Warp::<T, FORWARD> { couplings: self, weights, at, x })
    }

    /// A layer with all that its vector-Jacobian product needs.
    #[inline(always)]
    fn layer<T: Real>(&self, weights: &[T], layer: usize, condition: &[T], kept: T) -> Saved<T> {
        let network = self.network();
        let mut input = [T::zero(); INPUTS_MAX];
        input[..self.condition].copy_from_slice(&condition[..self.condition]);
        input[self.condition..network.inputs].copy_from_slice(&encode(kept));
        let mut hidden = Hidden::default();
        let mut logits = [T::zero(); OUTPUTS_MAX];
        let weights = &weights[layer * network.len()..][..network.len()];
        network.forward(weights, &input[..network.inputs], &mut hidden, &mut logits);
        let spline = Spline::new(self.family, self.bins, &logits[..network.outputs]);
        Saved { kept, warped: T::zero(), input, hidden, spline }
    }

    /// `ln q(x)`, and its vector-Jacobian product for the gradient that `g` gives to it: adds to the gradients of weights
    /// and condition.
    ///
    /// # Panics
    /// If the shape is not valid or a slice is too short.
    #[inline(always)]
    pub fn log_density_vjp<T: Real>(
        &self,
        weights: &[T],
        condition: &[T],
        x: [T; 2],
        g: impl FnOnce(T) -> T,
        g_weights: &mut [T],
        g_condition: &mut [T],
    ) -> T {
        let network = self.network();
        let (mut at, mut log) = (x, T::zero());
        let mut saved: [Option<Saved<T>>; LAYERS_MAX] = std::array::from_fn(|_| None);
        for (layer, slot) in saved.iter_mut().enumerate().take(self.layers) {
            let (kept, warped) = (layer % 2, 1 - layer % 2);
            let mut state = self.layer(weights, layer, condition, at[kept]);
            state.warped = at[warped];
            let (u, slope) = state.spline.forward(at[warped]);
            at[warped] = u;
            log += slope.ln();
            *slot = Some(state);
        }
        let g_log = g(log);
        let mut g_at = [T::zero(); 2];
        for (layer, state) in saved.iter().enumerate().take(self.layers).rev() {
            let Some(state) = state else { continue };
            let (kept, warped) = (layer % 2, 1 - layer % 2);
            let mut g_logits = [T::zero(); OUTPUTS_MAX];
            g_at[warped] = state.spline.forward_vjp(state.warped, [g_at[warped], g_log], &mut g_logits);
            let mut g_input = [T::zero(); INPUTS_MAX];
            let range = layer * network.len()..(layer + 1) * network.len();
            let input = &state.input[..network.inputs];
            let (w, g_w) = (&weights[range.clone()], &mut g_weights[range]);
            network.forward_vjp(w, input, &state.hidden, &g_logits, g_w, &mut g_input[..network.inputs]);
            for (to, from) in g_condition.iter_mut().zip(&g_input[..self.condition]) {
                *to += *from;
            }
            g_at[kept] += encode_vjp(state.kept, &g_input[self.condition..]);
        }
        log
    }
}

/// The kept coordinate, sines and cosines of `pi`, `2 pi` and `4 pi` times it.
#[inline(always)]
fn encode<T: Real>(x: T) -> [T; KEPT] {
    let mut out = [x * T::of(2.0) - T::one(); KEPT];
    let (mut s, mut c) = sin_cos_pi(x);
    for octave in 0..3 {
        (out[1 + 2 * octave], out[2 + 2 * octave]) = (s, c);
        (s, c) = (T::of(2.0) * s * c, c * c - s * s);
    }
    out
}

/// Gradient of the coordinate for those of its encoding.
#[inline(always)]
fn encode_vjp<T: Real>(x: T, g: &[T]) -> T {
    let out = encode(x);
    (0..3).fold(T::of(2.0) * g[0], |sum, octave| {
        let rate = T::of(std::f64::consts::PI * f64::from(1 << octave));
        let (s, c) = (out[1 + 2 * octave], out[2 + 2 * octave]);
        sum + rate * (g[1 + 2 * octave] * c - g[2 + 2 * octave] * s)
    })
}

/// [`Couplings::under`], for one width.
struct Under<'a, T> {
    couplings: &'a Couplings,
    weights: &'a [T],
    condition: &'a [T],
}

impl<T: Real> Kernel for Under<'_, T> {
    type Output = Conditioned<T>;

    #[inline(always)]
    fn run(self) -> Conditioned<T> {
        let Self { couplings, weights, condition } = self;
        let network = couplings.network();
        let mut first = [[T::zero(); HIDDEN]; LAYERS_MAX];
        for (first, weights) in
            first.iter_mut().zip(weights.chunks_exact(network.len())).take(couplings.layers)
        {
            *first = network.first(weights, &condition[..couplings.condition]);
        }
        Conditioned(first)
    }
}

/// [`Couplings::warp`], for one width.
struct Warp<'a, T, const FORWARD: bool> {
    couplings: &'a Couplings,
    weights: &'a [T],
    at: &'a Conditioned<T>,
    x: [T; 2],
}

impl<T: Real, const FORWARD: bool> Kernel for Warp<'_, T, FORWARD> {
    type Output = ([T; 2], T);

    #[inline(always)]
    fn run(self) -> ([T; 2], T) {
        let Self { couplings, weights, at, mut x } = self;
        let mut density = T::one();
        for step in 0..couplings.layers {
            let layer = if FORWARD { step } else { couplings.layers - 1 - step };
            let (kept, warped) = (layer % 2, 1 - layer % 2);
            let spline = couplings.spline(weights, layer, at, x[kept]);
            let (to, slope) = if FORWARD { spline.forward(x[warped]) } else { spline.inverse(x[warped]) };
            x[warped] = to;
            density *= slope;
        }
        (x, density)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use photofit_gradcheck::{Uniform, check};

    pub(crate) fn shapes() -> [Couplings; 3] {
        let quadratic = Couplings { layers: 2, bins: 15, family: Family::Quadratic, condition: 6 };
        [
            quadratic,
            Couplings { layers: 3, bins: 6, ..quadratic },
            Couplings { family: Family::Rational, bins: 10, ..quadratic },
        ]
    }

    pub(crate) fn weights(shape: &Couplings, random: &mut Uniform) -> Vec<f64> {
        random.vec(shape.len(), -0.35, 0.35)
    }

    #[test]
    fn flows_and_their_inverses_are_round_trips() {
        let mut random = Uniform::new(1);
        for shape in shapes() {
            for _ in 0..10 {
                let wide = weights(&shape, &mut random);
                let narrow: Vec<f32> = wide.iter().map(|w| *w as f32).collect();
                let condition = random.vec(6, -1.0, 1.0);
                let single: Vec<f32> = condition.iter().map(|w| *w as f32).collect();
                let (condition, single) = (shape.under(&wide, &condition), shape.under(&narrow, &single));
                for _ in 0..100 {
                    let z = [random.range(0.0, 1.0), random.range(0.0, 1.0)];
                    let (x, density) = shape.inverse(&wide, &condition, z);
                    let (back, forward) = shape.forward(&wide, &condition, x);
                    assert!((back[0] - z[0]).abs().max((back[1] - z[1]).abs()) < 1e-9, "{z:?} {back:?}");
                    assert!((density / forward - 1.0).abs() < 1e-6);
                    let z = z.map(|z| z as f32);
                    let (x, density) = shape.inverse(&narrow, &single, z);
                    let (back, forward) = shape.forward(&narrow, &single, x);
                    assert!((back[0] - z[0]).abs().max((back[1] - z[1]).abs()) < 1e-5, "{z:?} {back:?}");
                    assert!((density / forward - 1.0).abs() < 1e-3);
                }
            }
        }
    }

    #[test]
    fn vectors_of_all_widths_give_the_same_bits() {
        let mut random = Uniform::new(4);
        for shape in shapes() {
            let w: Vec<f32> = weights(&shape, &mut random).iter().map(|w| *w as f32).collect();
            for _ in 0..200 {
                let c: Vec<f32> = random.vec(6, -1.0, 1.0).iter().map(|c| *c as f32).collect();
                let x = [random.range(0.0, 1.0) as f32, random.range(0.0, 1.0) as f32];
                let answers = |width| {
                    let (couplings, weights) = (&shape, &w[..]);
                    let at = run_up_to(width, Under { couplings, weights, condition: &c });
                    let forward = run_up_to(width, Warp::<_, true> { couplings, weights, at: &at, x });
                    let inverse = run_up_to(width, Warp::<_, false> { couplings, weights, at: &at, x });
                    bits(&at, [forward, inverse])
                };
                let plain = answers(Width::Base);
                // Where the machine lacks a width, a narrower one answers.
                for width in Width::ALL {
                    assert_eq!(plain, answers(width), "{width:?}");
                }
                let at = shape.under(&w, &c);
                assert_eq!(plain, bits(&at, [shape.forward(&w, &at, x), shape.inverse(&w, &at, x)]));
            }
        }
    }

    /// Bits of what a width answers.
    fn bits(at: &Conditioned<f32>, answers: [([f32; 2], f32); 2]) -> Vec<u32> {
        let answers = answers.into_iter().flat_map(|(x, density)| [x[0], x[1], density]);
        at.0.iter().flatten().copied().chain(answers).map(f32::to_bits).collect()
    }

    #[test]
    fn gradients_in_single_precision_are_near_those_in_double() {
        let mut random = Uniform::new(5);
        let narrow = |v: &[f64]| v.iter().map(|v| *v as f32).collect::<Vec<f32>>();
        let wide = |v: &[f32]| v.iter().map(|v| f64::from(*v)).collect::<Vec<f64>>();
        for shape in shapes() {
            for _ in 0..20 {
                let (w, c) = (narrow(&weights(&shape, &mut random)), narrow(&random.vec(6, -1.0, 1.0)));
                let x = [random.range(0.0, 1.0) as f32, random.range(0.0, 1.0) as f32];
                let (mut g_w, mut g_c) = (vec![0.0_f32; shape.len()], vec![0.0_f32; 6]);
                let log = shape.log_density_vjp(&w, &c, x, |_| 0.7, &mut g_w, &mut g_c);
                let (mut d_w, mut d_c) = (vec![0.0; shape.len()], vec![0.0; 6]);
                let (w, c, x) = (wide(&w), wide(&c), x.map(f64::from));
                let exact = shape.log_density_vjp(&w, &c, x, |_| 0.7, &mut d_w, &mut d_c);
                assert!((f64::from(log) - exact).abs() < 1e-4, "{log} {exact}");
                for (name, g, d) in [("weights", wide(&g_w), d_w), ("condition", wide(&g_c), d_c)] {
                    let error = g.iter().zip(&d).map(|(g, d)| (g - d).powi(2)).sum::<f64>().sqrt();
                    let size = d.iter().map(|d| d * d).sum::<f64>().sqrt();
                    assert!(error < 1e-3 * size, "{shape:?}, {name}: {error:.1e} of {size:.1e}");
                }
            }
        }
    }

    #[test]
    fn densities_are_determinants() {
        let mut random = Uniform::new(2);
        for shape in shapes() {
            let (w, c) = (weights(&shape, &mut random), random.vec(6, -1.0, 1.0));
            for _ in 0..100 {
                let x = [random.range(0.01, 0.99), random.range(0.01, 0.99)];
                let (h, c) = (1e-7, shape.under(&w, &c));
                let at = |dx: f64, dy: f64| shape.forward(&w, &c, [x[0] + dx, x[1] + dy]).0;
                let column =
                    |a: [f64; 2], b: [f64; 2]| [(a[0] - b[0]) / (2.0 * h), (a[1] - b[1]) / (2.0 * h)];
                let (p, q) = (column(at(h, 0.0), at(-h, 0.0)), column(at(0.0, h), at(0.0, -h)));
                let determinant = (p[0] * q[1] - p[1] * q[0]).abs();
                let density = shape.forward(&w, &c, x).1;
                assert!((determinant / density - 1.0).abs() < 1e-4, "{determinant} {density}");
            }
        }
    }

    #[test]
    fn gradients_agree_with_differences() {
        let mut random = Uniform::new(3);
        for shape in shapes() {
            let x = [random.range(0.0, 1.0), random.range(0.0, 1.0)];
            let (w, c) = (weights(&shape, &mut random), random.vec(6, -1.0, 1.0));
            let (mut g_w, mut g_c) = (vec![0.0; shape.len()], vec![0.0; 6]);
            let log = shape.log_density_vjp(&w, &c, x, |_| 0.7, &mut g_w, &mut g_c);
            let value = |w: &[f64], c: &[f64]| 0.7 * shape.forward(w, &shape.under(w, c), x).1.ln();
            assert!((0.7 * log - value(&w, &c)).abs() < 1e-12);
            check("weights", &w, &g_w, 1e-6, 1e-5, |w| value(w, &c));
            check("condition", &c, &g_c, 1e-6, 1e-5, |c| value(&w, c));
        }
    }
}

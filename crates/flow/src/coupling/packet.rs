//! Answers under many conditions at once: each weight is read once for the vertices in all lanes of a vector.

use super::{Conditioned, Couplings, KEPT, OUTPUTS_MAX, encode};
use crate::network::{HIDDEN, PACKET};
use crate::spline::warp_packet;
use photofit_scalar::Real;
use photofit_scalar::wide::{Kernel, Width, run_up_to};

/// A point under a condition.
pub type Asked<'a, T> = (&'a Conditioned<T>, [T; 2]);

impl Couplings {
    /// [`Self::forward`] of each, to the same bits.
    ///
    /// # Panics
    /// If there are not as many answers as points.
    pub fn forward_all<T: Real>(&self, weights: &[T], asked: &[Asked<'_, T>], answers: &mut [([T; 2], T)]) {
        self.warp_all::<T, true>(weights, asked, answers);
    }

    /// [`Self::inverse`] of each, to the same bits.
    ///
    /// # Panics
    /// As [`Self::forward_all`].
    pub fn inverse_all<T: Real>(&self, weights: &[T], asked: &[Asked<'_, T>], answers: &mut [([T; 2], T)]) {
        self.warp_all::<T, false>(weights, asked, answers);
    }

    fn warp_all<T: Real, const FORWARD: bool>(
        &self,
        weights: &[T],
        asked: &[Asked<'_, T>],
        answers: &mut [([T; 2], T)],
    ) {
        assert_eq!(asked.len(), answers.len(), "answers");
        run_up_to(Width::Avx512, WarpAll::<T, FORWARD> { couplings: self, weights, asked, answers });
    }
}

/// [`Couplings::warp_all`], for one width.
struct WarpAll<'a, T, const FORWARD: bool> {
    couplings: &'a Couplings,
    weights: &'a [T],
    asked: &'a [Asked<'a, T>],
    answers: &'a mut [([T; 2], T)],
}

impl<T: Real, const FORWARD: bool> Kernel for WarpAll<'_, T, FORWARD> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { couplings, weights, asked, answers } = self;
        for (asked, answers) in asked.chunks(PACKET).zip(answers.chunks_mut(PACKET)) {
            packet::<T, FORWARD>(couplings, weights, asked, answers);
        }
    }
}

/// At most [`PACKET`] answers; lanes without a question hold zeros.
#[inline(always)]
fn packet<T: Real, const FORWARD: bool>(
    couplings: &Couplings,
    weights: &[T],
    asked: &[Asked<'_, T>],
    answers: &mut [([T; 2], T)],
) {
    let network = couplings.network();
    for ((_, x), (to, density)) in asked.iter().zip(answers.iter_mut()) {
        (*to, *density) = (*x, T::one());
    }
    for step in 0..couplings.layers {
        let layer = if FORWARD { step } else { couplings.layers - 1 - step };
        let (kept, warped) = (layer % 2, 1 - layer % 2);
        let mut first = [[T::zero(); PACKET]; HIDDEN];
        let (mut at, mut encoded) = ([T::zero(); PACKET], [[T::zero(); PACKET]; KEPT]);
        for (l, ((condition, _), (x, _))) in asked.iter().zip(answers.iter()).enumerate() {
            at[l] = x[kept];
            for (to, from) in first.iter_mut().zip(&condition.0[layer]) {
                to[l] = *from;
            }
        }
        for l in 0..PACKET {
            let numbers = encode(at[l]);
            for k in 0..KEPT {
                encoded[k][l] = numbers[k];
            }
        }
        let mut logits = [[T::zero(); PACKET]; OUTPUTS_MAX];
        let weights = &weights[layer * network.len()..][..network.len()];
        network.rest_of_packet(weights, &mut first, &encoded, &mut logits);
        let mut x = [T::zero(); PACKET];
        for (x, (from, _)) in x.iter_mut().zip(answers.iter()) {
            *x = from[warped];
        }
        let logits = &logits[..network.outputs];
        let slopes = warp_packet::<T, FORWARD>(couplings.family, couplings.bins, logits, &mut x);
        for ((to, density), (x, slope)) in answers.iter_mut().zip(x.iter().zip(slopes)) {
            to[warped] = *x;
            *density *= slope;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{shapes, weights};
    use super::*;
    use photofit_gradcheck::Uniform;

    #[test]
    fn answers_of_packets_have_the_bits_of_single_ones() {
        let mut random = Uniform::new(6);
        for shape in shapes() {
            let w: Vec<f32> = weights(&shape, &mut random).iter().map(|w| *w as f32).collect();
            let conditions: Vec<Conditioned<f32>> = (0..2 * PACKET + 3)
                .map(|_| {
                    let c: Vec<f32> = random.vec(6, -1.0, 1.0).iter().map(|c| *c as f32).collect();
                    shape.under(&w, &c)
                })
                .collect();
            let asked: Vec<Asked<'_, f32>> = conditions
                .iter()
                .map(|c| (c, [random.range(0.0, 1.0) as f32, random.range(0.0, 1.0) as f32]))
                .collect();
            let bits = |answers: &[([f32; 2], f32)]| -> Vec<[u32; 3]> {
                answers.iter().map(|(x, q)| [x[0], x[1], *q].map(f32::to_bits)).collect()
            };
            let single = |forward: bool| -> Vec<([f32; 2], f32)> {
                let one = |(c, x): &Asked<'_, f32>| match forward {
                    true => shape.forward(&w, c, *x),
                    false => shape.inverse(&w, c, *x),
                };
                asked.iter().map(one).collect()
            };
            for width in Width::ALL {
                for count in [0, 1, PACKET, asked.len()] {
                    let mut answers = vec![([0.0; 2], 0.0); count];
                    let (couplings, weights, asked) = (&shape, &w[..], &asked[..count]);
                    let forward = WarpAll::<_, true> { couplings, weights, asked, answers: &mut answers };
                    run_up_to(width, forward);
                    assert_eq!(bits(&answers), bits(&single(true)[..count]), "{shape:?}, {width:?}");
                    let inverse = WarpAll::<_, false> { couplings, weights, asked, answers: &mut answers };
                    run_up_to(width, inverse);
                    assert_eq!(bits(&answers), bits(&single(false)[..count]), "{shape:?}, {width:?}");
                }
            }
        }
    }
}

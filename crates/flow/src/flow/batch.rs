//! Training: one step on a batch of records.

use super::{FlowGuide, Parameters, SHARE};
use crate::FlowError;
use crate::coupling::CONDITION_MAX;
use crate::guide::{Guide, Record};
use photofit_sampling::Rng;
use photofit_scalar::wide::{Kernel, Width, run_up_to};
use rayon::prelude::*;

/// Records of a chunk: gradients are summed within chunks, then over chunks in order, whatever the number of threads.
const CHUNK: usize = 64;
/// Largest weight of a record in units of the batch's mean: one bright sample does not move the flow alone.
const WEIGHT_MAX: f32 = 20.0;
/// Share of the loss that looks at the flow alone; the rest looks at the mixture that is sampled. (With the mixture alone
/// a share that once is small keeps the flow from learning; Müller et al. 2019.)
const ALONE: f32 = 0.5;

/// A record as a step needs it.
#[derive(Clone, Copy)]
pub(super) struct Example {
    record: Record,
    /// The density of the scattering function, and of the integrand over what was sampled.
    pub(super) other: f32,
    weight: f32,
}

/// Gradients of a chunk.
struct Gradient {
    network: Vec<f32>,
    /// Of the features of positions, record by record.
    features: Vec<[f32; CONDITION_MAX]>,
}

impl FlowGuide {
    /// Goes through the useful records in random order.
    pub(super) fn train(&mut self, records: &[Record]) -> Result<(), FlowError> {
        let mut examples: Vec<Example> =
            records.par_iter().filter(|r| r.is_useful()).map(|r| self.example(r)).collect();
        self.began = true;
        // Batches of one size: each is a step as long as any other.
        let batches = examples.len().div_ceil(self.options.batch).max(1);
        let size = examples.len().div_ceil(batches).max(1);
        for pass in 0..self.options.passes {
            Rng::new(self.options.seed ^ self.steps, 0x0b47 + u64::from(pass)).shuffle(&mut examples);
            for batch in examples.chunks(size) {
                self.step(batch)?;
            }
        }
        self.refresh()
    }

    /// What the scattering function alone would have done: the guide's part is taken out of the density of the mixture.
    pub(super) fn example(&self, r: &Record) -> Example {
        let local = self.local(&r.query);
        let (share, guide) = (self.share(&local), self.pdf(&local, r.wi));
        // A record of another sampler (no guide in its density) may leave less than nothing.
        let other = if !self.began { r.pdf } else { (r.pdf - share * guide).max(0.0) / (1.0 - share) };
        Example { record: *r, other, weight: r.value / r.pdf }
    }

    fn step(&mut self, batch: &[Example]) -> Result<(), FlowError> {
        let mean = batch.iter().map(|e| f64::from(e.weight)).sum::<f64>() / batch.len() as f64;
        let scale = (1.0 / mean) as f32;
        if !(scale.is_finite() && scale > 0.0) {
            return Ok(());
        }
        let gradient = self.gradient_of(batch, scale);
        let Parameters { network, table } = &mut self.live;
        self.optimizers[0].step(network, &gradient.network, self.options.rates[0])?;
        if self.options.spatial {
            self.optimizers[1].step(table, &gradient.table, self.options.rates[1])?;
        }
        self.steps += 1;
        Ok(())
    }

    /// Gradient of the loss of a batch, whose weights are scaled by this.
    fn gradient_of(&self, batch: &[Example], scale: f32) -> Parameters {
        let chunks: Vec<Gradient> =
            batch.par_chunks(CHUNK).map(|chunk| self.gradient(chunk, scale, batch.len())).collect();
        let mut network = vec![0.0; self.live.network.len()];
        let mut table = vec![0.0; self.live.table.len()];
        let count = self.options.encoding.features();
        for (gradient, examples) in chunks.iter().zip(batch.chunks(CHUNK)) {
            for (sum, g) in network.iter_mut().zip(&gradient.network) {
                *sum += *g;
            }
            if self.options.spatial {
                for (g, e) in gradient.features.iter().zip(examples) {
                    let place = self.place(e.record.query.position);
                    self.options.encoding.forward_vjp(&self.live.table, place, &g[..count], &mut table);
                }
            }
        }
        Parameters { network, table }
    }

    /// Gradient of `-w ln q / n` with `w` detached: half of it for the flow, half for its mixture.
    fn gradient(&self, chunk: &[Example], scale: f32, n: usize) -> Gradient {
        run_up_to(Width::Avx512, OfChunk { guide: self, chunk, scale, n })
    }
}

/// [`FlowGuide::gradient`], for one width.
struct OfChunk<'a> {
    guide: &'a FlowGuide,
    chunk: &'a [Example],
    scale: f32,
    n: usize,
}

impl Kernel for OfChunk<'_> {
    type Output = Gradient;

    #[inline(always)]
    fn run(self) -> Gradient {
        let Self { guide, chunk, scale, n } = self;
        let couplings = &guide.couplings;
        let mut out = Gradient {
            network: vec![0.0; guide.live.network.len()],
            features: vec![[0.0; CONDITION_MAX]; chunk.len()],
        };
        let (g_network, g_head) = out.network.split_at_mut(couplings.len());
        let (network, head) = guide.live.network.split_at(couplings.len());
        for (e, g_features) in chunk.iter().zip(&mut out.features) {
            let weight = (e.weight * scale).min(WEIGHT_MAX) / n as f32;
            let local = guide.features(&guide.live, &e.record.query);
            let share = local.share;
            let flow = local.chart.point(e.record.wi).map_or(0.0, |(x, density)| {
                let towards = |log: f32| {
                    let part = share * log.exp() * density;
                    let mixture = part + (1.0 - share) * e.other;
                    let responsible = if mixture > 0.0 { part / mixture } else { 0.0 };
                    -weight * (ALONE + (1.0 - ALONE) * responsible)
                };
                let log =
                    couplings.log_density_vjp(network, &local.condition, x, towards, g_network, g_features);
                log.exp() * density
            });
            let mixture = share * flow + (1.0 - share) * e.other;
            if mixture > 0.0 && mixture.is_finite() {
                let part = (share - SHARE[0]) / (SHARE[1] - SHARE[0]);
                let slope = (SHARE[1] - SHARE[0]) * part * (1.0 - part);
                let g_logit = -weight * (1.0 - ALONE) * (flow - e.other) / mixture * slope;
                g_head[0] += g_logit;
                for (k, g) in g_head[1..].iter_mut().enumerate() {
                    *g += g_logit * local.condition[k];
                    g_features[k] += g_logit * head[1 + k];
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{records, trained};
    use super::*;
    use crate::flow::FlowOptions;
    use crate::spline::Family;

    /// The loss of which [`FlowGuide::gradient_of`] is the gradient, by the answers of the guide.
    fn loss(guide: &FlowGuide, batch: &[Example], scale: f32) -> f64 {
        let of = |e: &Example| {
            let local = guide.local(&e.record.query);
            let (share, other) = (f64::from(guide.share(&local)), f64::from(e.other));
            let q = f64::from(guide.pdf(&local, e.record.wi));
            let mixture = share * q + (1.0 - share) * other;
            let alone = f64::from(ALONE);
            -f64::from((e.weight * scale).min(WEIGHT_MAX)) * (alone * q.ln() + (1.0 - alone) * mixture.ln())
        };
        batch.iter().map(of).sum::<f64>() / batch.len() as f64
    }

    #[test]
    fn gradients_are_differences_of_the_loss() {
        for (family, bins) in [(Family::Quadratic, 15), (Family::Rational, 10)] {
            let data = records(300, 3);
            let mut guide =
                trained(FlowOptions { family, bins, ..FlowOptions::default() }, &records(4000, 4));
            let batch: Vec<Example> = data.iter().map(|r| guide.example(r)).collect();
            let gradient = guide.gradient_of(&batch, 0.7);
            let layers = guide.couplings.len();
            let largest = |g: &[f32], from: usize, n: usize| {
                let mut order: Vec<usize> = (from..g.len()).collect();
                order.sort_by(|a, b| g[*b].abs().total_cmp(&g[*a].abs()));
                order.truncate(n);
                order
            };
            // Weights of the layers, all of the share, and features of positions.
            let all = (0..).take_while(|k| layers + k < gradient.network.len()).map(|k| (0, layers + k));
            let weights = largest(&gradient.network[..layers], 0, 40).into_iter().map(|k| (0, k));
            let places = largest(&gradient.table, 0, 40).into_iter().map(|k| (1, k));
            let places: Vec<(usize, usize)> = all.chain(weights).chain(places).collect();
            let scales = [&gradient.network[layers..], &gradient.network[..layers], &gradient.table]
                .map(|g| g.iter().fold(0.0_f32, |m, v| m.max(v.abs())));
            for (part, k) in places {
                let h = 1e-2;
                let mut at = |offset: f32| {
                    let own = if part == 0 { &mut guide.frozen.network } else { &mut guide.frozen.table };
                    let before = own[k];
                    own[k] += offset;
                    let found = loss(&guide, &batch, 0.7);
                    let own = if part == 0 { &mut guide.frozen.network } else { &mut guide.frozen.table };
                    own[k] = before;
                    found
                };
                let difference = (at(h) - at(-h)) / f64::from(2.0 * h);
                let (own, scale) = match part {
                    0 if k >= layers => (gradient.network[k], scales[0]),
                    0 => (gradient.network[k], scales[1]),
                    _ => (gradient.table[k], scales[2]),
                };
                let off = (f64::from(own) - difference).abs();
                assert!(off < 0.03 * f64::from(scale), "{family:?}, {part} {k}: {own} and {difference}");
            }
        }
    }

    #[test]
    fn batches_are_of_one_size() {
        let steps =
            |n: usize| trained(FlowOptions { batch: 100, ..FlowOptions::default() }, &records(n, 3)).steps();
        assert_eq!([steps(100), steps(101), steps(299), steps(301)], [1, 2, 3, 4]);
    }

    fn bits(g: &Gradient) -> Vec<u32> {
        g.network.iter().chain(g.features.iter().flatten()).map(|v| v.to_bits()).collect()
    }

    #[test]
    fn gradients_of_all_widths_have_the_same_bits() {
        for (family, bins) in [(Family::Quadratic, 15), (Family::Rational, 10)] {
            let data = records(2000, 3);
            let guide = trained(FlowOptions { family, bins, ..FlowOptions::default() }, &data);
            let chunk: Vec<Example> = data[..CHUNK].iter().map(|r| guide.example(r)).collect();
            let of = |width| {
                bits(&run_up_to(width, OfChunk { guide: &guide, chunk: &chunk, scale: 0.5, n: CHUNK }))
            };
            let plain = of(Width::Base);
            assert!(plain.iter().any(|b| f32::from_bits(*b) != 0.0));
            // Where the machine lacks a width, a narrower one answers.
            for width in Width::ALL {
                assert!(plain == of(width), "{family:?}, {width:?}");
            }
            assert!(plain == bits(&guide.gradient(&chunk, 0.5, CHUNK)), "{family:?}");
        }
    }
}

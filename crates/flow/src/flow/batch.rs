//! Training: one step on a batch of records.

use super::{FlowGuide, Parameters, SHARE};
use crate::FlowError;
use crate::coupling::CONDITION_MAX;
use crate::guide::{Guide, Record};
use photofit_optim::OptimError;
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

/// Least part of the last step in the mean of the parameters that answers; before 1,981 steps that is one over the last twentieth of
/// them. (A longer one lags behind what few records taught: in rooms of `bench flow` with a hundred steps a mean over the last third
/// of them had a quarter more variance than the last parameters, over four seeds; after 1,500 steps it had 15% less.)
const LATEST: f32 = 0.01;

/// [`LATEST`] after so many steps.
fn part_of_last(steps: u64) -> f32 {
    LATEST.max(20.0 / (steps + 19) as f32)
}

/// A record as a step needs it.
#[derive(Clone, Copy)]
pub(super) struct Example {
    record: Record,
    /// The density of the scattering function, and of the integrand over what was sampled.
    pub(super) other: f32,
    weight: f32,
}

/// Where so many records are cut into batches of at most `most` whose sizes hardly differ: each is as large a step as any other.
fn cuts(records: usize, most: usize) -> Vec<usize> {
    let batches = records.div_ceil(most);
    (0..=batches).map(|k| k * records / batches.max(1)).collect()
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
        let cuts = cuts(examples.len(), self.options.batch);
        for pass in 0..self.options.passes {
            Rng::new(self.options.seed ^ self.steps, 0x0b47 + u64::from(pass)).shuffle(&mut examples);
            for pair in cuts.windows(2) {
                self.step(&examples[pair[0]..pair[1]])?;
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
        let steps = self.steps;
        let told = |e| match e {
            OptimError::NonFiniteGradient { .. } => FlowError::Diverged { steps },
            e => e.into(),
        };
        self.optimizers[0].step(network, &gradient.network, self.options.rates[0]).map_err(told)?;
        if self.options.spatial {
            self.optimizers[1].step(table, &gradient.table, self.options.rates[1]).map_err(told)?;
        }
        self.steps += 1;
        let part = part_of_last(self.steps);
        for (mean, live) in [(&mut self.mean.network, &*network), (&mut self.mean.table, &*table)] {
            mean.iter_mut().zip(live).for_each(|(m, v)| *m += part * (v - *m));
        }
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
        for family in [Family::Quadratic, Family::Rational] {
            let data = records(300, 3);
            let mut guide = trained(FlowOptions::of(family), &records(4000, 4));
            guide.frozen.clone_from(&guide.live);
            let batch: Vec<Example> = data.iter().map(|r| guide.example(r)).collect();
            let gradient = guide.gradient_of(&batch, 0.7);
            let layers = guide.couplings.len();
            let largest = |g: &[f32]| {
                let mut order: Vec<usize> = (0..g.len()).collect();
                order.sort_by(|a, b| g[*b].abs().total_cmp(&g[*a].abs()));
                order.truncate(40);
                order
            };
            let share = (layers..gradient.network.len()).collect();
            let parts =
                [(0, share), (0, largest(&gradient.network[..layers])), (1, largest(&gradient.table))];
            for (k, of) in parts {
                let own: Vec<f32> = of.iter().map(|i| [&gradient.network, &gradient.table][k][*i]).collect();
                let scale = own.iter().fold(0.0_f32, |most, g| most.max(g.abs()));
                for (i, own) in of.into_iter().zip(own) {
                    let mut at = |offset: f32| {
                        let Parameters { network, table } = &mut guide.frozen;
                        let value = &mut [network, table][k][i];
                        let before = std::mem::replace(value, *value + offset);
                        let found = loss(&guide, &batch, 0.7);
                        let Parameters { network, table } = &mut guide.frozen;
                        [network, table][k][i] = before;
                        found
                    };
                    let h = 1e-2;
                    let difference = (at(h) - at(-h)) / f64::from(2.0 * h);
                    let off = (f64::from(own) - difference).abs();
                    assert!(off < 0.03 * f64::from(scale), "{family:?}, {k} {i}: {own} and {difference}");
                }
            }
        }
    }

    #[test]
    fn sizes_of_batches_differ_by_one_record_at_most() {
        for (records, most, batches) in
            [(1, 256, 1), (256, 256, 1), (257, 256, 2), (65_281, 256, 256), (139_810, 256, 547)]
        {
            let cuts = cuts(records, most);
            let sizes: Vec<usize> = cuts.windows(2).map(|c| c[1] - c[0]).collect();
            assert_eq!((sizes.len(), sizes.iter().sum::<usize>()), (batches, records));
            let (least, largest) = (sizes.iter().min().unwrap(), sizes.iter().max().unwrap());
            assert!(*largest <= most && largest - least <= 1, "{records}: {least} to {largest}");
        }
        assert_eq!(cuts(0, 256), [0]);
        let guide =
            trained(FlowOptions { batch: 100, passes: 2, ..FlowOptions::default() }, &records(301, 3));
        assert_eq!(guide.steps(), 8);
    }

    #[test]
    fn what_answers_is_the_mean_of_the_last_steps() {
        // The same training, of which every step is seen: calls of one step each.
        let batches: Vec<Vec<Record>> = (0..230).map(|k| records(16, k)).collect();
        let mut guide = trained(FlowOptions::default(), &[]);
        let (mut seen, mut weights): (Vec<Parameters>, Vec<f64>) = (Vec::new(), Vec::new());
        for (k, batch) in batches.iter().enumerate() {
            guide.train(batch).unwrap();
            seen.push(guide.live.clone());
            let part = f64::from(part_of_last(k as u64 + 1));
            weights.iter_mut().for_each(|w| *w *= 1.0 - part);
            weights.push(part);
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            if ![0, 1, 30, 229].contains(&k) {
                continue;
            }
            let parts: [fn(&Parameters) -> &Vec<f32>; 2] = [|p| &p.network, |p| &p.table];
            for part in parts {
                for i in (0..part(&guide.live).len()).step_by(101) {
                    let mean: f64 = seen.iter().zip(&weights).map(|(p, w)| f64::from(part(p)[i]) * w).sum();
                    let own = f64::from(part(&guide.frozen)[i]);
                    assert!((own - mean).abs() < 1e-5, "{k}, {i}: {own} {mean}");
                }
            }
            assert_eq!(guide.frozen.network == guide.live.network, k == 0);
            assert_eq!(guide.frozen.table == guide.live.table, k == 0);
        }
        assert_eq!([1, 381, 1981, 1 << 40].map(part_of_last), [1.0, 0.05, LATEST, LATEST]);
        assert_eq!(guide.steps(), 230);
    }

    fn bits(g: &Gradient) -> Vec<u32> {
        g.network.iter().chain(g.features.iter().flatten()).map(|v| v.to_bits()).collect()
    }

    #[test]
    fn gradients_of_all_widths_have_the_same_bits() {
        for family in [Family::Quadratic, Family::Rational] {
            let data = records(2000, 3);
            let guide = trained(FlowOptions::of(family), &data);
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

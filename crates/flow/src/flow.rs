//! The flow as a guide: features of a vertex, coupling layers on a chart of its directions, and online training.

mod batch;

use crate::FlowError;
use crate::coupling::{Asked, CONDITION_MAX, Conditioned, Couplings};
use crate::domain::{Chart, Domain};
use crate::elementary::exp;
use crate::encoding::Encoding;
use crate::guide::{Guide, Learn, Query, Record, SHARE};
use crate::network::PACKET;
use crate::spline::Family;
use photofit_optim::{Optimizer, Temporal};
use photofit_sampling::Rng;
use photofit_scalar::Vec3f;

/// Features of the directions: the viewer in the frame, the normal, the roughness.
const DIRECTIONS: usize = 7;
/// Logit of the share that an untrained guide has, one half.
const SHARE_LOGIT: f32 = 0.18;

/// How a flow is made and trained.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlowOptions {
    /// What the unit square stands for.
    pub domain: Domain,
    /// The splines.
    pub family: Family,
    /// Bins of a spline, at most 31; 15 and 31 (quadratic), 5 and 10 (rational) fill the network's outputs best.
    pub bins: usize,
    /// Coupling layers, 1 to 4.
    pub layers: usize,
    /// The features of positions.
    pub encoding: Encoding,
    /// Whether the density depends on the position, and whether on directions and roughness.
    pub spatial: bool,
    /// See [`Self::spatial`].
    pub directional: bool,
    /// Learning rates of the networks and of the features of positions.
    pub rates: [f32; 2],
    /// Records of a step.
    pub batch: usize,
    /// Times that [`Learn::learn`] goes through its records.
    pub passes: u32,
    /// Seed of the weights and of the order of records.
    pub seed: u64,
}

impl Default for FlowOptions {
    /// [`Self::of`] the quadratic family.
    fn default() -> Self {
        Self::of(Family::Quadratic)
    }
}

impl FlowOptions {
    /// Two layers on the hemisphere, of 15 quadratic or 10 rational bins. (By 5e-3 in place of 3e-3 rational splines end anywhere: the
    /// cross entropy of `training_lowers_the_cross_entropy_and_every_condition_helps` was .62 to .85 over six seeds, with 3e-3 .65 to .70, by a longer mean than that of now.)
    pub fn of(family: Family) -> Self {
        let (bins, rate) = match family {
            Family::Quadratic => (15, 5e-3),
            Family::Rational => (10, 3e-3),
        };
        Self {
            domain: Domain::Hemisphere,
            family,
            bins,
            layers: 2,
            encoding: Encoding::default(),
            spatial: true,
            directional: true,
            rates: [rate, 2e-2],
            batch: 256,
            passes: 1,
            seed: 0,
        }
    }

    /// The coupling layers of such a flow.
    pub fn couplings(&self) -> Couplings {
        let condition = self.encoding.features() + DIRECTIONS;
        Couplings { layers: self.layers, bins: self.bins, family: self.family, condition }
    }
}

/// A normalizing flow over directions, conditioned on position, normal, viewer and roughness.
///
/// Training moves one copy of the parameters; answers come from another, which is replaced by their mean over the last
/// twentieth of the steps, at most a hundred or so, at the end of [`Learn::learn`] (as in Müller
/// et al. 2021, "Real-time Neural Radiance Caching for Path Tracing").
#[derive(Debug)]
pub struct FlowGuide {
    options: FlowOptions,
    couplings: Couplings,
    /// Lower corner of the scene's box and one over its edges.
    corner: Vec3f,
    scale: Vec3f,
    /// Parameters in training, their mean over the last steps, and those that answer.
    live: Parameters,
    mean: Parameters,
    frozen: Parameters,
    optimizers: [Optimizer<f32>; 2],
    steps: u64,
    /// Whether [`Learn::learn`] was called: directions were chosen without a guide before.
    began: bool,
}

/// Weights of the couplings followed by those of the share's affine map; the table of the features of positions.
#[derive(Clone, Debug)]
struct Parameters {
    network: Vec<f32>,
    table: Vec<f32>,
}

/// The features of a vertex and the chart of its directions.
#[derive(Clone, Copy, Debug)]
pub struct FlowLocal {
    chart: Chart,
    condition: Conditioned<f32>,
    share: f32,
}

/// What a vertex gives to the networks.
struct Features {
    chart: Chart,
    condition: [f32; CONDITION_MAX],
    share: f32,
}

/// What rates must be.
const RATE: &str = "finite and at least 0";

fn is_rate(rate: f32) -> bool {
    rate.is_finite() && rate >= 0.0
}

impl FlowGuide {
    /// An untrained guide for positions in the box from `lo` to `hi` (clamped to it): uniform points on its domain.
    ///
    /// # Errors
    /// [`FlowError::Setting`] for options outside their ranges.
    pub fn new(lo: Vec3f, hi: Vec3f, options: FlowOptions) -> Result<Self, FlowError> {
        options.encoding.check()?;
        let couplings = options.couplings();
        let rules = [
            ("number of bins", options.bins as f64, "1 to 31", (1..=31).contains(&options.bins)),
            ("number of layers", options.layers as f64, "1 to 4", couplings.is_valid()),
            ("rate of the networks", f64::from(options.rates[0]), RATE, is_rate(options.rates[0])),
            ("rate of the features", f64::from(options.rates[1]), RATE, is_rate(options.rates[1])),
            ("records of a step", options.batch as f64, "at least 1", options.batch >= 1),
        ];
        if let Some((setting, value, rule, _)) = rules.into_iter().find(|r| !r.3) {
            return Err(FlowError::Setting { setting, value, rule });
        }
        let mut random = Rng::new(options.seed, 0xf10);
        let mut network = vec![0.0; couplings.len() + 1 + options.encoding.features()];
        couplings.init(&mut network[..couplings.len()], || random.uniform(-1.0, 1.0));
        network[couplings.len()] = SHARE_LOGIT;
        let mut table = vec![0.0; options.encoding.len()];
        options.encoding.init(&mut table, || random.uniform(-1.0, 1.0));
        let optimizers = [
            Optimizer::new("network", network.len(), Temporal::adam())?,
            Optimizer::new("positions", table.len(), Temporal::adam())?,
        ];
        let live = Parameters { network, table };
        let size = hi - lo;
        let scale = size.map(|v| if v > 0.0 && v.is_finite() { 1.0 / v } else { 0.0 });
        let (mean, frozen) = (live.clone(), live.clone());
        let (steps, began) = (0, false);
        Ok(Self { options, couplings, corner: lo, scale, live, mean, frozen, optimizers, steps, began })
    }

    /// The options.
    pub fn options(&self) -> &FlowOptions {
        &self.options
    }

    /// Steps of training so far.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Number of parameters.
    pub fn parameters(&self) -> usize {
        self.live.network.len() + self.live.table.len()
    }

    /// Gives the weights of the network of an untrained guide random values of this spread: a flow far from an identity, for tests
    /// and measurements without training.
    pub fn randomize(&mut self, spread: f32, seed: u64) {
        let mut random = Rng::new(seed, 0xf11);
        for w in &mut self.live.network {
            *w = random.uniform(-spread, spread);
        }
        (self.mean, self.frozen) = (self.live.clone(), self.live.clone());
    }

    /// Lets the mean of the parameters in training answer, if all of them are numbers.
    ///
    /// # Errors
    /// [`FlowError::Diverged`]; the copy that answers is unchanged then.
    fn refresh(&mut self) -> Result<(), FlowError> {
        let Parameters { network, table } = &self.mean;
        if !network.iter().chain(table).all(|p| p.is_finite()) {
            return Err(FlowError::Diverged { steps: self.steps });
        }
        self.frozen.clone_from(&self.mean);
        Ok(())
    }

    /// Mean of `-ln q` over records with the weights `value / pdf`, for the density that answers; records that it cannot
    /// represent are left out. Not a number where no record counts.
    pub fn cross_entropy(&self, records: &[Record]) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for r in records.iter().filter(|r| r.is_useful()) {
            let q = f64::from(self.pdf(&self.local(&r.query), r.wi));
            if q > 0.0 {
                let w = f64::from(r.value / r.pdf);
                (sum, weights) = (sum - w * q.ln(), weights + w);
            }
        }
        sum / weights
    }

    #[inline]
    fn place(&self, p: Vec3f) -> [f32; 3] {
        (p - self.corner).mul(self.scale).to_array()
    }

    /// Features and chart of a vertex by the given parameters.
    #[inline]
    fn features(&self, parameters: &Parameters, at: &Query) -> Features {
        let roughness = at.roughness.clamp(0.0, 1.0);
        let chart = Chart::new(self.options.domain, at.normal, at.wo, roughness * roughness);
        let mut condition = [0.0; CONDITION_MAX];
        let features = self.options.encoding.features();
        if self.options.spatial {
            let place = self.place(at.position);
            self.options.encoding.forward(&parameters.table, place, &mut condition[..features]);
        }
        let head = &parameters.network[self.couplings.len()..];
        let logit = head[0] + head[1..].iter().zip(&condition).map(|(w, f)| w * f).sum::<f32>();
        if self.options.directional {
            let (wo, n) = (chart.wo(), at.normal);
            condition[features..features + DIRECTIONS]
                .copy_from_slice(&[wo.x, wo.y, wo.z, n.x, n.y, n.z, roughness]);
            for v in &mut condition[features..] {
                // Degenerate directions must not poison the network.
                *v = if v.is_finite() { v.clamp(-1.0, 1.0) } else { 0.0 };
            }
        }
        Features { chart, condition, share: share(logit) }
    }
}

/// The share of a logit: [`SHARE`] apart.
#[inline]
fn share(logit: f32) -> f32 {
    // NaN stays NaN, as it would not by `min`.
    let x = if logit < -80.0 { 80.0 } else { -logit };
    SHARE[0] + (SHARE[1] - SHARE[0]) / (1.0 + exp(x))
}

impl Guide for FlowGuide {
    type Local = FlowLocal;

    #[inline]
    fn local(&self, at: &Query) -> FlowLocal {
        let Features { chart, condition, share } = self.features(&self.frozen, at);
        FlowLocal { chart, condition: self.couplings.under(&self.frozen.network, &condition), share }
    }

    #[inline]
    fn share(&self, local: &FlowLocal) -> f32 {
        local.share
    }

    #[inline]
    fn sample(&self, local: &FlowLocal, u: [f32; 2]) -> Option<(Vec3f, f32)> {
        let (x, q) = self.couplings.inverse(&self.frozen.network, &local.condition, u);
        let (wi, density) = local.chart.direction(x)?;
        Some((wi, q * density))
    }

    #[inline]
    fn pdf(&self, local: &FlowLocal, wi: Vec3f) -> f32 {
        let Some((x, density)) = local.chart.point(wi) else { return 0.0 };
        self.couplings.forward(&self.frozen.network, &local.condition, x).1 * density
    }

    fn sample_all(&self, asked: &[(&FlowLocal, [f32; 2])], answers: &mut [Option<(Vec3f, f32)>]) {
        for (asked, answers) in asked.chunks(PACKET).zip(answers.chunks_mut(PACKET)) {
            let [first, ..] = asked else { continue };
            let mut points: [Asked<'_, f32>; PACKET] = [(&first.0.condition, first.1); PACKET];
            for (point, (local, u)) in points.iter_mut().zip(asked) {
                *point = (&local.condition, *u);
            }
            let mut warped = [([0.0; 2], 0.0); PACKET];
            let n = asked.len();
            self.couplings.inverse_all(&self.frozen.network, &points[..n], &mut warped[..n]);
            for ((answer, (local, _)), (x, q)) in answers.iter_mut().zip(asked).zip(warped) {
                *answer = local.chart.direction(x).map(|(wi, density)| (wi, q * density));
            }
        }
    }

    fn pdf_all(&self, asked: &[(&FlowLocal, Vec3f)], answers: &mut [f32]) {
        for (asked, answers) in asked.chunks(PACKET).zip(answers.chunks_mut(PACKET)) {
            let [first, ..] = asked else { continue };
            let mut points: [Asked<'_, f32>; PACKET] = [(&first.0.condition, [0.0; 2]); PACKET];
            // Directions that the chart does not make keep a density of 0.
            let mut densities = [0.0; PACKET];
            for ((point, density), (local, wi)) in points.iter_mut().zip(&mut densities).zip(asked) {
                point.0 = &local.condition;
                if let Some((x, own)) = local.chart.point(*wi) {
                    (point.1, *density) = (x, own);
                }
            }
            let mut warped = [([0.0; 2], 0.0); PACKET];
            let n = asked.len();
            self.couplings.forward_all(&self.frozen.network, &points[..n], &mut warped[..n]);
            for ((answer, own), (_, q)) in answers.iter_mut().zip(densities).zip(warped) {
                *answer = if own > 0.0 { q * own } else { 0.0 };
            }
        }
    }
}

impl Learn for FlowGuide {
    fn learn(&mut self, records: &[Record]) -> Result<(), FlowError> {
        self.train(records)
    }
}

#[cfg(test)]
mod tests;

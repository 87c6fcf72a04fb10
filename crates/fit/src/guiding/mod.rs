//! Guided path tracing: a guide of `photofit-flow` learns from paths of the scene, a pilot run judges whether it pays, and
//! the picture is rendered with it or without.
//!
//! Training is a function of the scene, the options and the seed: it has a fixed number of paths, none of which is in the
//! picture, and reads no clock unless it is given a limit of time. That leaves out rounds, and the report tells how many there
//! were ([`GuidingReport::rounds`]). A render that goes on later trains again with as many ([`GuidingOptions::with_rounds`]), to the
//! same bits.
//!
//! Rounds of training double in length; each walks paths with what the rounds before it learned. Whether the guide pays is
//! judged by variance times work on paths of their own, where work is counted in path vertices, weighted by the costs of
//! [`Guiding::cost`], so that the decision does not depend on the machine.

mod clock;
mod pilot;
mod report;

use crate::FitError;
use clock::Clock;
use photofit_flow::{FlowGuide, FlowOptions, Guide, Guided, LobeGuide, LobeOptions, Record};
use photofit_image::Image;
use photofit_pathtrace::{
    Adjoint, Gradient, GradientSamples, Integrator, PathtraceError, Progress, RenderOptions, Renderer,
    Strategy,
};
use photofit_sampling::ScatteringSampler;
use photofit_scalar::Vec3f;
use pilot::{Pilot, Trial};
pub use report::GuidingReport;
use std::ops::RangeInclusive;
use std::time::{Duration, Instant};

/// Tells the seeds of training and pilot run from that of the picture.
const SEED: u64 = 0x6_u64.rotate_left(56) ^ 0x9a1d;

/// Paths of a picture for one of training.
const TRAINING: f64 = 10.0;
/// Paths of a picture for one record that a flow learns from, which takes as long as a few paths.
const LEARNING: f64 = 48.0;
/// The first look of the pilot run takes this part of its paths.
const LOOK: u32 = 2;

/// Which guide.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Guiding {
    /// None.
    #[default]
    Off,
    /// A normalizing flow.
    Flow,
    /// Lobes in a spatial tree.
    Lobes,
}

impl Guiding {
    /// Cost of a path vertex with the guide over that of one without: rounded from
    /// times a sample in scenes with short paths (`cargo xtask bench flow` measures them).
    pub fn cost(self) -> f64 {
        match self {
            Self::Off => 1.0,
            Self::Flow => 5.0,
            Self::Lobes => 1.6,
        }
    }

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Flow => "flow",
            Self::Lobes => "lobes",
        }
    }
}

/// How a guide is trained and judged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuidingOptions {
    /// Which guide.
    pub guiding: Guiding,
    /// Largest side of the pictures that are trained on, pixels.
    pub side: usize,
    /// Most rounds of training; round `r` walks `2^r` paths a pixel.
    pub rounds: u32,
    /// Most time of training and pilot run: what takes longer is given up. A round after the third is walked where it and the
    /// pilot run are expected to end in half of it, judged by the round before. `None`: as long as it takes.
    pub limit: Option<Duration>,
    /// Paths a pixel of the pilot run, with the guide and without.
    pub pilot: u32,
    /// Least gain (variance times work without the guide over that with it) for which the guide is used; 0 uses it always.
    pub least_gain: f64,
    /// Most records that a round learns from.
    pub records: usize,
    /// The flow.
    pub flow: FlowOptions,
    /// The lobes.
    pub lobes: LobeOptions,
}

impl GuidingOptions {
    /// 5 rounds and a pilot run of 16 paths at 96 pixels a side; a gain of 1.15 is asked for.
    pub fn new(guiding: Guiding) -> Self {
        Self {
            guiding,
            side: 96,
            rounds: 5,
            limit: None,
            pilot: 16,
            least_gain: 1.15,
            records: 1 << 18,
            flow: FlowOptions::default(),
            lobes: LobeOptions::default(),
        }
    }
}

impl GuidingOptions {
    /// Rounds that [`Self::for_picture`] chooses among; a limit of time leaves out none of the first ones.
    pub const ROUNDS: RangeInclusive<u32> = 3..=7;

    /// So many rounds, whatever time they take, and the pilot run that belongs to them: 8 paths a pixel, from five rounds on 16,
    /// as [`Self::new`] and [`Self::for_picture`] have, and training within a limit after so many rounds.
    pub fn with_rounds(self, rounds: u32) -> Self {
        Self { rounds, limit: None, pilot: pilot_of(rounds), ..self }
    }

    /// As [`Self::new`] for a picture of known samples: training walks at most a tenth as many paths as the picture, in
    /// 3 to 7 rounds, where a tenth is enough for three. The pilot run walks 8 paths a pixel with the guide and 8 without
    /// it, from 5 rounds on 16.
    ///
    /// A guide that loses clearly has walked the paths of its training and of half of its pilot run: less than an eighth of the
    /// paths of the picture from 256 samples a pixel at 96 pixels a side on, less than a quarter with 64 samples. Guided paths take
    /// longer than plain ones ([`Guiding::cost`]). A flow learns from one record for 48 paths of the picture at most, but from up to
    /// 1,024 in each round.
    pub fn for_picture(guiding: Guiding, options: &RenderOptions) -> Self {
        let own = Self::new(guiding);
        let (width, height) = (options.width.max(1) as f64, options.height.max(1) as f64);
        let scale = (own.side as f64 / width.max(height)).min(1.0);
        let share = f64::from(options.spp) / (TRAINING * scale * scale);
        // Rounds up to r walk 2^r - 1 paths a pixel.
        let [least, most] = [*Self::ROUNDS.start(), *Self::ROUNDS.end()].map(f64::from);
        let rounds = (share + 1.0).log2().clamp(least, most) as u32;
        let learned = width * height * f64::from(options.spp) / (LEARNING * f64::from(rounds));
        let records = match guiding {
            Guiding::Flow => (learned as usize).clamp(1 << 10, own.records),
            Guiding::Off | Guiding::Lobes => own.records,
        };
        Self { records, ..own.with_rounds(rounds) }
    }
}

/// Paths a pixel of the pilot run after so many rounds, with the guide and without.
fn pilot_of(rounds: u32) -> u32 {
    if rounds < 5 { 8 } else { 16 }
}

/// A guide that has learned.
#[derive(Debug)]
enum Trained {
    Flow(Box<FlowGuide>),
    Lobes(LobeGuide),
}

/// What directions of paths are chosen by.
#[derive(Debug, Default)]
pub struct Guidance {
    trained: Option<Trained>,
    report: Option<GuidingReport>,
    seconds: f64,
}

impl Guidance {
    /// No guide.
    pub fn off() -> Self {
        Self::default()
    }

    /// Trains and judges a guide for the render that `renderer` begins; its film stays as it is.
    ///
    /// `stop` is asked before every picture of training and of the pilot run; once it says true, or the time of
    /// [`GuidingOptions::limit`] is over, there is no guide and no report.
    ///
    /// # Errors
    /// [`FitError::PathTrace`] and [`FitError::Guide`] for options that do not work.
    pub fn train(
        renderer: &Renderer<'_>,
        options: &GuidingOptions,
        stop: impl Fn() -> bool,
    ) -> Result<Self, FitError> {
        Self::train_over(std::slice::from_ref(renderer), options, stop)
    }

    /// The same for renders of one world by several cameras, whose pictures are of one size: the guide learns from the paths
    /// of all of them, and the pilot run judges it by all.
    ///
    /// # Errors
    /// As [`Self::train`].
    pub fn train_over(
        renderers: &[Renderer<'_>],
        options: &GuidingOptions,
        stop: impl Fn() -> bool,
    ) -> Result<Self, FitError> {
        let began = Instant::now();
        let trained = Self::train_by(&|| began.elapsed(), renderers, options, stop)?;
        Ok(Self { seconds: began.elapsed().as_secs_f64(), ..trained })
    }

    /// The same, by a clock that tells how long it has been going on.
    fn train_by(
        now: &dyn Fn() -> Duration,
        renderers: &[Renderer<'_>],
        options: &GuidingOptions,
        stop: impl Fn() -> bool,
    ) -> Result<Self, FitError> {
        let Some(one) = renderers.first().filter(|_| options.guiding != Guiding::Off) else {
            return Ok(Self::off());
        };
        let mut clock = Clock { now, limit: options.limit, last: Duration::ZERO };
        let mut paths = 0;
        let stage = |round: u64| -> Result<Vec<Renderer<'_>>, FitError> {
            renderers.iter().map(|r| small_view(r, options, round)).collect()
        };
        // `None` where it is stopped.
        let all = |clock: &Clock<'_>,
                   stage: &[Renderer<'_>],
                   run: &dyn Fn(&Renderer<'_>) -> Trial|
         -> Option<Trial> {
            let mut trial = Trial::default();
            for (k, renderer) in stage.iter().enumerate() {
                if stop() || clock.is_over() {
                    return None;
                }
                trial = if k == 0 { run(renderer) } else { trial.beside(run(renderer)) };
            }
            Some(trial)
        };
        let first = all(&clock, &stage(0)?, &|r| Pilot::new(r, 0, 1).run(&ScatteringSampler));
        let Some(first) = first else { return Ok(Self::off()) };
        paths += first.paths;
        let (lo, hi) = first.bounds();
        let mut state = match options.guiding {
            Guiding::Off => return Ok(Self::off()),
            Guiding::Lobes => Trained::Lobes(LobeGuide::new(options.lobes)),
            Guiding::Flow => {
                let seed = options.flow.seed ^ one.options().seed;
                let flow = FlowOptions { seed, ..options.flow };
                Trained::Flow(Box::new(FlowGuide::new(lo, hi, flow)?))
            }
        };
        let mut records = state.learn(first, options.records)?;
        let mut rounds = 1;
        while rounds < options.rounds && clock.allows(rounds, options.pilot) {
            let before = now();
            let trial =
                all(&clock, &stage(u64::from(rounds))?, &|r| state.run(&Pilot::new(r, 0, 1 << rounds)));
            let Some(trial) = trial else { return Ok(Self::off()) };
            paths += trial.paths;
            records += state.learn(trial, options.records)?;
            clock.last = now().saturating_sub(before);
            rounds += 1;
        }
        // Both trials take the same numbers where their paths agree, and none of training.
        let stage = stage(u64::from(rounds))?;
        let pilot = if rounds < options.rounds { options.pilot.min(pilot_of(rounds)) } else { options.pilot };
        let most = pilot.max(2);
        let look = if options.least_gain > 0.0 { (most / LOOK).max(2) } else { most };
        let (mut plain, mut guided) = (Trial::default(), Trial::default());
        let mut judged = None;
        for (first, count) in [(0, look), (look, most - look)] {
            let lost = judged.as_ref().is_some_and(|j: &GuidingReport| j.is_lost(options));
            if count == 0 || lost {
                break;
            }
            let one = all(&clock, &stage, &|r| part(r, first, count).run(&ScatteringSampler));
            let Some(one) = one else { return Ok(Self::off()) };
            plain = plain.then(one, first, count);
            let one = all(&clock, &stage, &|r| state.run(&part(r, first, count)));
            let Some(one) = one else { return Ok(Self::off()) };
            guided = guided.then(one, first, count);
            let half = first + count < most;
            judged = Some(GuidingReport { half, ..GuidingReport::judge(&plain, &guided, options) });
        }
        let report = judged.map(|judged| GuidingReport {
            rounds,
            paths: paths + plain.paths + guided.paths,
            records,
            ..judged
        });
        let used = report.as_ref().is_some_and(|r| r.used);
        Ok(Self { trained: used.then_some(state), report, seconds: 0.0 })
    }

    /// Seconds of training and pilot run, also where they were given up (by the clock: for reports alone).
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// What training came to; `None` where no guide was wanted, or training was given up.
    pub fn report(&self) -> Option<&GuidingReport> {
        self.report.as_ref()
    }

    /// Whether directions are chosen by a guide.
    pub fn is_on(&self) -> bool {
        self.trained.is_some()
    }

    /// Makes all passes that are left, as [`Renderer::finish`].
    pub fn finish(&self, renderer: &mut Renderer<'_>) {
        match &self.trained {
            None => renderer.finish(),
            Some(_) => while !self.pass(renderer, || false).done {},
        }
    }

    /// The gradient of a loss as [`Adjoint::render_vjp`], along paths whose directions the guide chooses. It is that of the
    /// picture, whatever the guide has learned: densities are exact, and the guide itself has no derivative.
    ///
    /// # Errors
    /// As [`Adjoint::render_vjp`].
    pub fn gradient(
        &self,
        adjoint: &Adjoint<'_>,
        loss: &Image,
        samples: GradientSamples,
    ) -> Result<Gradient, PathtraceError> {
        match &self.trained {
            None => adjoint.render_vjp(loss, samples),
            Some(Trained::Flow(guide)) => adjoint.render_vjp_with(&Guided(&**guide), loss, samples),
            Some(Trained::Lobes(guide)) => adjoint.render_vjp_with(&Guided(guide), loss, samples),
        }
    }

    /// Adds samples to the picture as [`Renderer::pass`].
    pub fn pass(&self, renderer: &mut Renderer<'_>, stop: impl Fn() -> bool + Sync) -> Progress {
        match &self.trained {
            None => renderer.pass(stop),
            Some(Trained::Flow(guide)) => renderer.pass_with(&Guided(&**guide), stop),
            Some(Trained::Lobes(guide)) => renderer.pass_with(&Guided(guide), stop),
        }
    }
}

impl Trained {
    fn run(&self, pilot: &Pilot<'_>) -> Trial {
        match self {
            Self::Flow(guide) => pilot.run(&Guided(&**guide)),
            Self::Lobes(guide) => pilot.run(&Guided(guide)),
        }
    }

    /// Learns from at most `most` useful records of the trial; gives their number.
    fn learn(&mut self, trial: Trial, most: usize) -> Result<u64, FitError> {
        let records = thinned(trial.records, most);
        match self {
            Self::Flow(guide) => guide.learn(&records)?,
            Self::Lobes(guide) => guide.learn(&records)?,
        }
        Ok(records.len() as u64)
    }
}

/// The useful records if there are at most `most`, else so many of them: one of each of equal parts, at a place that is
/// hashed. (A fixed step would fall into step with the vertices of paths and the columns of the picture.)
fn thinned(mut records: Vec<Record>, most: usize) -> Vec<Record> {
    records.retain(Record::is_useful);
    let n = records.len();
    if n <= most {
        return records;
    }
    let bound = |part: usize| (part as u128 * n as u128 / most as u128) as usize;
    (0..most)
        .map(|part| {
            let (from, to) = (bound(part), bound(part + 1));
            let place = photofit_sampling::hash(SEED, part as u64, n as u64) % (to - from) as u64;
            records[from + place as usize]
        })
        .collect()
}

/// Paths of the pilot run.
fn part<'a>(renderer: &'a Renderer<'a>, first: u32, count: u32) -> Pilot<'a> {
    Pilot::new(renderer, first, count).without_records()
}

/// A small render of the same view with numbers of its own.
fn small_view<'a>(
    renderer: &Renderer<'a>,
    options: &GuidingOptions,
    round: u64,
) -> Result<Renderer<'a>, FitError> {
    let own = renderer.options();
    let scale = (options.side.max(1) as f64 / own.width.max(own.height) as f64).min(1.0);
    let size = |n: usize| ((n as f64 * scale).round() as usize).max(1);
    Ok(renderer.again(RenderOptions {
        width: size(own.width),
        height: size(own.height),
        seed: photofit_sampling::hash(own.seed, SEED, round),
        aovs: Vec::new(),
        noise: None,
        previous: None,
        integrator: Integrator::Path,
        path: photofit_pathtrace::PathOptions { strategy: Strategy::Mis, ..own.path },
        ..own.clone()
    })?)
}

/// The box around points; a unit cube without any.
fn box_of(points: impl Iterator<Item = Vec3f>) -> (Vec3f, Vec3f) {
    let start = (Vec3f::splat(f32::INFINITY), Vec3f::splat(f32::NEG_INFINITY));
    let (lo, hi) = points.fold(start, |(lo, hi), p| (lo.min(p), hi.max(p)));
    if lo.is_finite() && hi.is_finite() { (lo, hi) } else { (Vec3f::zero(), Vec3f::splat(1.0)) }
}

#[cfg(test)]
mod tests;

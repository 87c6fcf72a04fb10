//! Guided path tracing: a guide of `photofit-flow` learns from paths of the scene, a pilot run judges whether it pays, and
//! the picture is rendered with it or without.
//!
//! Training is a function of the scene, the options and the seed: it has a fixed number of paths, none of which is in the
//! picture, and reads no clock unless it is given a limit of time. That makes training pictures smaller and leaves out rounds, and the
//! report tells of what size they were and how many ([`GuidingReport::side`], [`GuidingReport::rounds`]). A render that goes on later
//! trains again as the report tells ([`GuidingOptions::as_trained`]), to the same bits.
//!
//! Rounds of training double in length; each walks paths with what the rounds before it learned. Whether the guide pays is
//! judged by variance times work on paths of their own, where work is counted in path vertices, weighted by the costs of
//! [`GuidingOptions::cost`], so that the decision does not depend on the machine.

mod clock;
mod pilot;
mod report;
mod training;

use crate::FitError;
use clock::Clock;
use photofit_flow::{
    FlowError, FlowGuide, FlowOptions, Guided, Learn, LobeGuide, LobeOptions, Record, Waves,
};
use photofit_image::Image;
use photofit_pathtrace::{
    Adjoint, Gradient, GradientSamples, Integrator, PathtraceError, Progress, RenderOptions, Renderer,
    Strategy,
};
use photofit_sampling::ScatteringSampler;
use pilot::{Chooser, Trial};
pub use report::GuidingReport;
use std::ops::RangeInclusive;
use std::time::{Duration, Instant};
use training::Lesson;

/// Tells the seeds of training and pilot run from that of the picture.
const SEED: u64 = 0x6_u64.rotate_left(56) ^ 0x9a1d;

/// Most work of training and pilot run over that of the picture.
const PART: f64 = 0.1;
/// Paths a pixel of the pilot run, with the guide and without, at least: beside each, two are left to tell how uncertain their mean is.
const LEAST_PILOT: u32 = 3;
/// Paths of a picture for one record that a flow learns from, which takes as long as a few paths.
const LEARNING: f64 = 96.0;

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
    /// Cost of a path vertex of a picture with the guide over that of one without: rounded from
    /// times a sample in scenes with short paths (`cargo xtask bench flow` measures them).
    pub fn cost(self) -> f64 {
        match self {
            Self::Off => 1.0,
            Self::Flow => 4.0,
            Self::Lobes => 1.6,
        }
    }

    /// The same where paths are not walked side by side: in training, pilot runs and gradients.
    pub fn single_cost(self) -> f64 {
        match self {
            Self::Flow => 5.0,
            Self::Off | Self::Lobes => self.cost(),
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
    /// Most time of training and pilot run: what takes longer is given up. Pictures are trained on that are as small as three rounds and the pilot
    /// run in half of it ask for, of [`Self::SIDES`], judged by a path a pixel of the smallest; what learning takes is not counted. A round after the third is walked where it and the
    /// pilot run are expected to end in half of it, judged by the round before. `None`: as long as it takes.
    pub limit: Option<Duration>,
    /// Paths a pixel of the pilot run, with the guide and without; at least 3 are walked.
    pub pilot: u32,
    /// Cost of a path vertex of what is guided over that of one without a guide: [`Guiding::cost`] for pictures,
    /// [`Guiding::single_cost`] for gradients.
    pub cost: f64,
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
    /// 5 rounds and a pilot run of 8 paths at 96 pixels a side; a gain of 1.15 is asked for.
    pub fn new(guiding: Guiding) -> Self {
        Self {
            guiding,
            side: 96,
            rounds: 5,
            limit: None,
            pilot: pilot_of(5),
            cost: guiding.cost(),
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
    /// Sides that it chooses among, pixels; there are more than the least number of rounds at the last one alone.
    pub const SIDES: [usize; 5] = [24, 32, 48, 64, 96];

    /// [`Self::side`] and [`Self::rounds`] that it chooses among, and that a limit of time leaves of them.
    pub fn stages() -> impl Iterator<Item = (usize, u32)> {
        let least = *Self::ROUNDS.start();
        let [.., largest] = Self::SIDES;
        Self::SIDES
            .into_iter()
            .map(move |side| (side, least))
            .chain(Self::ROUNDS.skip(1).map(move |r| (largest, r)))
    }

    /// So many rounds, whatever time they take, and the pilot run that belongs to them: 4 paths a pixel, from five rounds on 8,
    /// as [`Self::new`] and [`Self::for_picture`] have, and training within a limit after so many rounds.
    pub fn with_rounds(self, rounds: u32) -> Self {
        Self { rounds, limit: None, pilot: pilot_of(rounds), ..self }
    }

    /// So many rounds at most and the pilot run that belongs to them, in pictures of this size.
    fn cut(self, side: usize, rounds: u32) -> Self {
        let rounds = rounds.min(self.rounds);
        let pilot = if rounds < self.rounds { self.pilot.min(pilot_of(rounds)) } else { self.pilot };
        Self { side, rounds, pilot, ..self }
    }

    /// Those of a training that came to this report, whatever time it takes.
    pub fn as_trained(self, report: &GuidingReport) -> Self {
        Self { limit: None, ..self.cut(report.side, report.rounds) }
    }

    /// As [`Self::new`] for a picture of known samples: training and pilot run are at most a tenth of the work of
    /// the picture. Training walks 3 rounds in a picture that is as small as that asks for, down to 24 pixels a
    /// side, or more rounds where they fit at 96 pixels. The pilot run walks 4 paths a pixel with the guide and 4 without it, from 5
    /// rounds on 8.
    ///
    /// Work is counted in paths of the picture, those that ask a guide for [`Guiding::single_cost`]; what learning from them takes is not counted. A flow learns from one record for 96
    /// paths of the picture at most, but from up to 1,024 in each round.
    pub fn for_picture(guiding: Guiding, options: &RenderOptions) -> Self {
        let (width, height) = (options.width.max(1) as f64, options.height.max(1) as f64);
        let fits = |(side, rounds): &(usize, u32)| {
            let part = (*side as f64 / width.max(height)).min(1.0).powi(2);
            part * work(*rounds, guiding) <= PART * f64::from(options.spp)
        };
        let (side, rounds) =
            Self::stages().filter(fits).last().unwrap_or((Self::SIDES[0], *Self::ROUNDS.start()));
        let own = Self { side, ..Self::new(guiding) };
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
    if rounds < 5 { 4 } else { 8 }
}

/// Work of so many rounds and their pilot run, in paths a pixel without a guide, of which the first round is.
fn work(rounds: u32, guiding: Guiding) -> f64 {
    let guided = f64::from(rounds).exp2() - 2.0 + 2.0 * f64::from(pilot_of(rounds));
    1.0 + guided * guiding.single_cost()
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
    diverged: bool,
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
    /// [`GuidingOptions::limit`] is over, there is no guide and no report. There is none where training diverges either
    /// ([`Self::has_diverged`]).
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
        let Some(options) = within_limit(renderers, options, &clock, &stop)? else { return Ok(Self::off()) };
        let options = &GuidingOptions { pilot: options.pilot.max(LEAST_PILOT), ..options };
        let stage = |round: u64| -> Result<Vec<Renderer<'_>>, FitError> {
            renderers.iter().map(|r| small_view(r, options, round)).collect()
        };
        let first =
            over_views(&stage(0)?, &clock, &stop, Lesson::beside, |r| Lesson::walk(r, 1, &ScatteringSampler));
        let Some(first) = first else { return Ok(Self::off()) };
        let mut paths = first.paths;
        let mut state = match options.guiding {
            Guiding::Off => return Ok(Self::off()),
            Guiding::Lobes => Trained::Lobes(LobeGuide::new(options.lobes)),
            Guiding::Flow => {
                let seed = options.flow.seed ^ one.options().seed;
                let flow = FlowOptions { seed, ..options.flow };
                let (lo, hi) = first.bounds();
                Trained::Flow(Box::new(FlowGuide::new(lo, hi, flow)?))
            }
        };
        let diverged = || Ok(Self { diverged: true, ..Self::off() });
        let Some(mut records) = state.learn(first, options.records)? else { return diverged() };
        let mut rounds = 1;
        while rounds < options.rounds && clock.allows(rounds, options.pilot) {
            let before = now();
            let views = stage(u64::from(rounds))?;
            let lesson = over_views(&views, &clock, &stop, Lesson::beside, |r| state.walk(r, 1 << rounds));
            let Some(lesson) = lesson else { return Ok(Self::off()) };
            paths += lesson.paths;
            let Some(more) = state.learn(lesson, options.records)? else { return diverged() };
            records += more;
            clock.last = now().saturating_sub(before);
            rounds += 1;
        }
        let pilot = options.cut(options.side, rounds).pilot;
        // Both trials take numbers of their own: each is part of both variances.
        let trial = |chooser, number: u32| -> Result<Option<Trial>, FitError> {
            let views = stage(u64::from(rounds + number))?;
            let run = |r: &Renderer<'_>| state.trial(r, pilot, chooser);
            Ok(over_views(&views, &clock, &stop, Trial::beside, run))
        };
        let Some(plain) = trial(Chooser::Scattering, 0)? else { return Ok(Self::off()) };
        let Some(guided) = trial(Chooser::Guide, 1)? else { return Ok(Self::off()) };
        let paths = paths + (plain.paths.len() + guided.paths.len()) as u64;
        let report =
            GuidingReport { rounds, paths, records, ..GuidingReport::judge(&plain, &guided, options) };
        let trained = report.used.then_some(state);
        Ok(Self { trained, report: Some(report), ..Self::off() })
    }

    /// Seconds of training and pilot run, also where they were given up (by the clock: for reports alone).
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Whether there is no guide because its training diverged.
    pub fn has_diverged(&self) -> bool {
        self.diverged
    }

    /// What training came to; `None` where no guide was wanted, or training was given up or diverged.
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
            Some(Trained::Flow(guide)) => renderer.pass_side_by_side(&Waves(&**guide), stop),
            Some(Trained::Lobes(guide)) => renderer.pass_with(&Guided(guide), stop),
        }
    }
}

impl Trained {
    /// Paths to learn from.
    fn walk(&self, renderer: &Renderer<'_>, count: u32) -> Lesson {
        match self {
            Self::Flow(guide) => Lesson::walk(renderer, count, &Guided(&**guide)),
            Self::Lobes(guide) => Lesson::walk(renderer, count, &Guided(guide)),
        }
    }

    /// Paths of the pilot run.
    fn trial(&self, renderer: &Renderer<'_>, samples: u32, chooser: Chooser) -> Trial {
        match self {
            Self::Flow(guide) => Trial::run(renderer, samples, &**guide, chooser),
            Self::Lobes(guide) => Trial::run(renderer, samples, guide, chooser),
        }
    }

    /// Learns from at most `most` useful records; gives their number, or `None` where training diverges.
    fn learn(&mut self, lesson: Lesson, most: usize) -> Result<Option<u64>, FitError> {
        let records = thinned(lesson.records, most);
        let learned = match self {
            Self::Flow(guide) => guide.learn(&records),
            Self::Lobes(guide) => guide.learn(&records),
        };
        match learned {
            Ok(()) => Ok(Some(records.len() as u64)),
            Err(FlowError::Diverged { .. }) => Ok(None),
            Err(e) => Err(e.into()),
        }
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

/// What all views come to; `None` where it is stopped.
fn over_views<T>(
    views: &[Renderer<'_>],
    clock: &Clock<'_>,
    stop: &impl Fn() -> bool,
    join: impl Fn(T, T) -> T,
    run: impl Fn(&Renderer<'_>) -> T,
) -> Option<T> {
    let mut all = None;
    for view in views {
        if stop() || clock.is_over() {
            return None;
        }
        let one = run(view);
        all = Some(match all {
            None => one,
            Some(all) => join(all, one),
        });
    }
    all
}

/// Three rounds in a smaller picture where those in the wanted one would take more than half of the limit of time; `None` where it
/// is stopped.
fn within_limit(
    renderers: &[Renderer<'_>],
    options: &GuidingOptions,
    clock: &Clock<'_>,
    stop: &impl Fn() -> bool,
) -> Result<Option<GuidingOptions>, FitError> {
    let picture = renderers.iter().map(|r| r.options().width.max(r.options().height)).max().unwrap_or(0);
    let [smallest, ..] = GuidingOptions::SIDES.map(|side| side.min(picture));
    let Some(limit) = options.limit.filter(|_| options.side.min(picture) > smallest) else {
        return Ok(Some(*options));
    };
    let small = GuidingOptions { side: smallest, ..*options };
    let views = renderers.iter().map(|r| small_view(r, &small, 0)).collect::<Result<Vec<_>, _>>()?;
    let before = (clock.now)();
    let walk = |r: &Renderer<'_>| Lesson::walk(r, 1, &ScatteringSampler);
    if over_views(&views, clock, stop, Lesson::beside, walk).is_none() {
        return Ok(None);
    }
    let took = (clock.now)().saturating_sub(before);
    let least = options.rounds.min(*GuidingOptions::ROUNDS.start());
    let fits = |side: usize| {
        let part = (side.min(picture) as f64 / smallest as f64).powi(2);
        took.as_secs_f64() * part * work(least, options.guiding) <= 0.5 * limit.as_secs_f64()
    };
    if fits(options.side) {
        return Ok(Some(*options));
    }
    let smaller = |side: &usize| *side < options.side && fits(*side);
    let side = GuidingOptions::SIDES.into_iter().rev().find(smaller).unwrap_or(smallest);
    Ok(Some(options.cut(side, least)))
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

#[cfg(test)]
mod tests;

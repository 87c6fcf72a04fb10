//! The renderer: passes over the tiles of a film until enough samples are taken.

mod side_by_side;

use crate::PathtraceError;
use crate::camera::{Prepared, View};
use crate::error::invalid;
use crate::film::{Aov, Film, Filter, Key, Observer, Recorder, TILE, Tile};
use crate::integrator::path::{trace_with, walk};
use crate::integrator::{Kernel, PathOptions, PathSample, Sink, Strategy, uniform};
use crate::plan::{self, Features, RenderPlan};
use crate::random::{PathRandom, PixelRandom};
use crate::world::{World, WorldRay};
use photofit_image::Image;
use photofit_sampling::{DirectionSampler, SideBySide, SobolPoint};
use photofit_scalar::vec2;
use rayon::prelude::*;

/// Samples before the noise of a tile is believed.
const SAMPLES_BEFORE_NOISE: u32 = 32;
/// Largest number of samples that one pass adds.
const PASS_MAX: u32 = 32;
/// Share of the mean luminance added to a pixel's when its noise is judged: darkness may be noisier.
const DARKNESS: f64 = 0.1;

/// Which estimator runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Integrator {
    /// The path tracer.
    #[default]
    Path,
    /// The minimal path tracer: plain recursion, uniform directions. For tests and comparisons.
    Uniform,
}

/// What is rendered.
#[derive(Clone, Debug)]
pub struct RenderOptions {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples per pixel, at most.
    pub spp: u32,
    /// Tiles stop when their noise is below this: root mean square of the standard error relative to the luminance. What
    /// stops so is too dark by a little (.2 % at most in tests).
    pub noise: Option<f32>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The pixel filter.
    pub filter: Filter,
    /// Auxiliary images to keep.
    pub aovs: Vec<Aov>,
    /// The estimator.
    pub integrator: Integrator,
    /// Bounds of paths.
    pub path: PathOptions,
    /// The previous camera, for [`Aov::Motion`].
    pub previous: Option<View>,
    /// Features to compile in beside what the scene needs.
    pub further: Features,
}

impl Default for RenderOptions {
    /// 512 x 512 pixels, 64 samples.
    fn default() -> Self {
        Self {
            width: 512,
            height: 512,
            spp: 64,
            noise: None,
            seed: 0,
            filter: Filter::Box,
            aovs: Vec::new(),
            integrator: Integrator::Path,
            path: PathOptions::default(),
            previous: None,
            further: Features::default(),
        }
    }
}

/// How far a render is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Samples taken, over all pixels.
    pub samples: u64,
    /// Samples that will be taken at most.
    pub total: u64,
    /// Noise of the picture so far ([`RenderOptions::noise`] over all pixels); not finite before the second sample.
    pub noise: f64,
    /// Contributions that were left out so far because they were not finite: a sign of a faulty scene.
    pub not_finite: u64,
    /// Pixels without a sample so far.
    pub unsampled: u64,
    /// Nothing is left to do.
    pub done: bool,
}

/// A picture on its way.
///
/// ```
/// use photofit_pathtrace::{EnvironmentMap, Parts, Renderer, RenderOptions, View, World};
/// use photofit_scalar::Vec3;
/// use photofit_scene::Camera;
/// let mut parts = Parts::default();
/// parts.environment = Some(EnvironmentMap::constant(Vec3::splat(0.5)));
/// let world = World::new(parts)?;
/// let camera = Camera::look_at(glam::Vec3::Z, glam::Vec3::ZERO, glam::Vec3::Y, 0.8, 1.0, 0.1, 10.0);
/// let options = RenderOptions { width: 8, height: 8, spp: 4, ..RenderOptions::default() };
/// let mut renderer = Renderer::new(&world, &View::pinhole(&camera), options)?;
/// renderer.finish();
/// assert!((renderer.picture().pixel(3, 3)[0] - 0.5).abs() < 1e-6);
/// # Ok::<(), photofit_pathtrace::PathtraceError>(())
/// ```
#[derive(Debug)]
pub struct Renderer<'a> {
    world: &'a World,
    view: View,
    options: RenderOptions,
    plan: RenderPlan,
    film: Film,
}

impl<'a> Renderer<'a> {
    /// A render of `world` that has not begun.
    ///
    /// # Errors
    /// If the camera cannot make rays, the picture has no pixels or its film would take more than 8 GiB, a filter has no width, nothing gives light, movement is
    /// wanted without a previous camera, or light sampling alone would miss light of a compensated environment.
    pub fn new(world: &'a World, view: &View, options: RenderOptions) -> Result<Self, PathtraceError> {
        view.check()?;
        if let Some(previous) = &options.previous {
            previous.check()?;
        }
        if options.width == 0 || options.height == 0 || options.width.max(options.height) > 1 << 16 {
            let found = format!("{} x {}", options.width, options.height);
            return Err(invalid("picture", format!("has {found} pixels; there must be 1 to 65536 a side")));
        }
        let (pixels, each) = (options.width as u64 * options.height as u64, Film::pixel_bytes(&options.aovs));
        if pixels * each > Film::MAX_BYTES {
            let (w, h, most) = (options.width, options.height, Film::MAX_BYTES);
            let rule = format!(
                "has {w} x {h} pixels of {each} bytes on the film, {}; there may be {most}",
                pixels * each
            );
            return Err(invalid("picture", rule));
        }
        if !options.filter.is_valid() {
            return Err(invalid(
                "filter",
                format!("is {:?}; its width must be positive and at most 100 pixels", options.filter),
            ));
        }
        if let Some(e) = options.noise.filter(|e| e.is_nan() || *e <= 0.0) {
            return Err(invalid("noise", format!("is {e}; it must be positive")));
        }
        if options.aovs.contains(&Aov::Motion) && options.previous.is_none() {
            return Err(invalid("motion", "is wanted without a previous camera; there must be one"));
        }
        let plan = RenderPlan::with_at_least(world, options.further);
        let unlit = plan.needs.contains(Features(plan::EMITTERS));
        if world.lights.is_dark() && !unlit && !world.media.emits() {
            return Err(PathtraceError::NoLight);
        }
        if options.path.strategy == Strategy::Light && world.lights.misses_environment() {
            let rule = "light sampling alone misses what lies below the mean of a compensated environment: \
                        EnvironmentMap::compensate must be false";
            return Err(invalid("strategy", rule));
        }
        let film = Film::new(options.width, options.height, &options.aovs);
        Ok(Self { world, view: *view, options, plan, film })
    }

    /// What is rendered.
    pub fn options(&self) -> &RenderOptions {
        &self.options
    }

    /// A render of the same world by the same camera with other options, that has not begun.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn again(&self, options: RenderOptions) -> Result<Self, PathtraceError> {
        Self::new(self.world, &self.view, options)
    }

    /// The integrator that was chosen for [`Self::pass`].
    pub fn plan(&self) -> &RenderPlan {
        &self.plan
    }

    /// That of [`Self::pass_with`], [`Self::pass_side_by_side`] and [`Self::walk`].
    pub fn sampled_plan(&self) -> RenderPlan {
        RenderPlan::sampled(self.world)
    }

    /// Adds samples to all tiles that want more, on all threads, and says how far the render is.
    ///
    /// `stop` is asked before every tile; once it says true the pass ends soon, and the next one goes on where it
    /// ended. The picture depends on the number of samples alone, not on how passes were cut.
    pub fn pass(&mut self, stop: impl Fn() -> bool + Sync) -> Progress {
        let kernel = self.kernel();
        self.pass_by(kernel, stop)
    }

    /// Makes all passes that are left: the same picture, sooner where nobody looks at it in between.
    pub fn finish(&mut self) {
        if self.options.noise.is_none() {
            self.pass_to(self.options.spp, self.kernel(), || false);
        }
        while self.film.tiles.iter().any(|t| t.active) {
            self.pass(|| false);
        }
    }

    /// As [`Self::pass`], with directions of `sampler` at surfaces, whatever integrator the options name. Passes of any
    /// samplers may follow each other: the estimate stays unbiased as long as a sampler knows nothing of the samples of
    /// this film that are still to come.
    pub fn pass_with<D: DirectionSampler + Sync>(
        &mut self,
        sampler: &D,
        stop: impl Fn() -> bool + Sync,
    ) -> Progress {
        let aovs = !self.options.aovs.is_empty();
        if self.plan.needs.contains(Features(plan::VOLUMES)) {
            return self.pass_by(
                |world: &World, ray: &WorldRay, random: &PathRandom, options: &PathOptions| {
                    trace_with::<{ plan::ALL }, D>(world, ray, random, options, sampler, aovs)
                },
                stop,
            );
        }
        self.pass_by(
            |world: &World, ray: &WorldRay, random: &PathRandom, options: &PathOptions| {
                trace_with::<{ plan::SAMPLED }, D>(world, ray, random, options, sampler, aovs)
            },
            stop,
        )
    }

    /// As [`Self::pass_with`], to the same bits, with paths that are walked side by side: what they ask of their sampler is
    /// answered together.
    pub fn pass_side_by_side<W: SideBySide + Sync>(
        &mut self,
        walker: &W,
        stop: impl Fn() -> bool + Sync,
    ) -> Progress {
        let aovs = !self.options.aovs.is_empty();
        if self.plan.needs.contains(Features(plan::VOLUMES)) {
            self.pass_of(self.target(), stop, |job, tile| {
                side_by_side::tile::<{ plan::ALL }, W>(job, tile, walker, aovs);
            });
        } else {
            self.pass_of(self.target(), stop, |job, tile| {
                side_by_side::tile::<{ plan::SAMPLED }, W>(job, tile, walker, aovs);
            });
        }
        self.progress()
    }

    fn pass_by(
        &mut self,
        kernel: impl Fn(&World, &WorldRay, &PathRandom, &PathOptions) -> PathSample + Sync,
        stop: impl Fn() -> bool + Sync,
    ) -> Progress {
        self.pass_to(self.target(), kernel, stop);
        self.progress()
    }

    /// Adds samples to all tiles that have fewer than `target`.
    fn pass_to(
        &mut self,
        target: u32,
        kernel: impl Fn(&World, &WorldRay, &PathRandom, &PathOptions) -> PathSample + Sync,
        stop: impl Fn() -> bool + Sync,
    ) {
        self.pass_of(target, stop, |job, tile| job.tile(tile, &kernel));
    }

    /// Adds samples by `work` to all tiles that have fewer than `target`.
    fn pass_of(
        &mut self,
        target: u32,
        stop: impl Fn() -> bool + Sync,
        work: impl Fn(&Job<'_>, &mut Tile) + Sync,
    ) {
        let observer = self.observer();
        let recorder = self.film.recorder(&observer);
        let mut tiles = std::mem::take(&mut self.film.tiles);
        let job = Job { renderer: self, camera: observer.camera, recorder: &recorder, target };
        tiles.par_iter_mut().filter(|t| t.active && t.count < target).for_each(|tile| {
            if !stop() {
                work(&job, tile);
                tile.count = target;
            }
        });
        self.film.tiles = tiles;
        self.retire();
    }

    /// Walks the path of one sample of a pixel with directions of `sampler` and reports it to `sink`: the random numbers
    /// are those of the picture, and with [`photofit_sampling::ScatteringSampler`] the path is too. The film stays as it is.
    ///
    /// # Panics
    /// If the pixel lies outside of the picture.
    pub fn walk<S: Sink, D: DirectionSampler>(
        &self,
        [x, y]: [usize; 2],
        sample: u32,
        sampler: &D,
        sink: &mut S,
    ) {
        let options = &self.options;
        assert!(
            x < options.width && y < options.height,
            "pixel ({x}, {y}) of {} x {}",
            options.width,
            options.height
        );
        let mut pixel = PixelRandom::new(options.seed, (y * options.width + x) as u64);
        let random = pixel.sample(sample);
        let ray = primary_ray(options, &self.view.prepare(self.world), [x, y], &random);
        if self.plan.needs.contains(Features(plan::VOLUMES)) {
            walk::<{ plan::ALL }, _, _>(self.world, &ray, &random, &options.path, sampler, sink);
        } else {
            walk::<{ plan::SAMPLED }, _, _>(self.world, &ray, &random, &options.path, sampler, sink);
        }
    }

    /// How far the render is.
    pub fn progress(&self) -> Progress {
        let pixels = (self.options.width * self.options.height) as u64;
        let floor = DARKNESS * self.film.mean_luminance();
        let (mut sum, mut weight, mut unsampled) = (0.0, 0.0, 0);
        for tile in &self.film.tiles {
            let n = (tile.width * tile.height) as f64;
            unsampled += if tile.count == 0 { tile.width * tile.height } else { 0 };
            sum += n * self.film.tile_error(tile, floor).powi(2);
            weight += n;
        }
        Progress {
            samples: self.film.samples(),
            total: pixels * u64::from(self.options.spp),
            noise: (sum / weight).sqrt(),
            not_finite: self.film.not_finite(),
            unsampled: unsampled as u64,
            done: self.film.tiles.iter().all(|t| !t.active),
        }
    }

    /// The picture so far: linear colour with alpha, premultiplied.
    pub fn picture(&self) -> Image {
        self.film.picture()
    }

    /// Unbiased variance of the single samples of every pixel, three channels.
    pub fn sample_variance(&self) -> Image {
        self.film.sample_variance()
    }

    /// An auxiliary image; `None` if the options do not ask for it.
    pub fn aov(&self, aov: Aov) -> Option<Image> {
        self.options.aovs.contains(&aov).then(|| self.film.aov(aov)).flatten()
    }

    /// Everything that is needed to go on later; `scene` names what is rendered, and `guide` what chooses directions
    /// (empty for [`Self::pass`]).
    pub fn save(&self, scene: &str, guide: &str) -> Vec<u8> {
        self.film.to_bytes(&[&self.keys(scene)[..], &[guide_key(guide)]].concat())
    }

    /// Bytes that [`Self::save`] returns.
    pub fn state_bytes(&self) -> usize {
        self.film.state_bytes(self.keys("").len() + 1)
    }

    /// Goes on from what [`Self::save`] returned for the scene and one of `guides`, whose index it gives, to the same bits as a render that
    /// was never stopped.
    ///
    /// # Errors
    /// If there are no `guides`, or the bytes are damaged, or belong to another scene, guide, camera, or other options (more samples are allowed).
    pub fn resume<G: AsRef<str>>(
        &mut self,
        scene: &str,
        guides: &[G],
        bytes: &[u8],
    ) -> Result<usize, PathtraceError> {
        let guides: Vec<Key> = guides.iter().map(|g| guide_key(g.as_ref())).collect();
        let guide = self.film.restore(bytes, &self.keys(scene), &guides)?;
        for tile in &mut self.film.tiles {
            // More samples may be wanted than when the state was saved.
            tile.active |= self.options.noise.is_none();
        }
        self.retire();
        Ok(guide)
    }

    /// Everything that the pixels depend on, except for their number, that of the samples and what chooses directions.
    fn keys(&self, scene: &str) -> [Key; 9] {
        let o = &self.options;
        [
            ("scene or light", scene.to_owned()),
            ("camera", format!("{:?}", self.view)),
            ("noise", format!("{:?}", o.noise)),
            ("seed", format!("{:?}", o.seed)),
            ("filter", format!("{:?}", o.filter)),
            ("list of auxiliary images", format!("{:?}", o.aovs)),
            ("integrator", format!("{:?}", o.integrator)),
            ("depth, clamping or strategy", format!("{:?}", o.path)),
            ("camera before", format!("{:?}", o.previous)),
        ]
        .map(|(name, text)| Key::new(name, &text))
    }

    fn kernel(&self) -> Kernel {
        match self.options.integrator {
            Integrator::Path => self.plan.kernels[usize::from(!self.options.aovs.is_empty())],
            Integrator::Uniform => uniform::trace,
        }
    }

    fn observer(&self) -> Observer<'a> {
        Observer {
            world: self.world,
            camera: self.view.prepare(self.world),
            previous: self.options.previous.map(|p| p.prepare(self.world)),
            size: [self.options.width as f32, self.options.height as f32],
        }
    }

    /// Samples that every active tile has after this pass. Powers of two first, then steps of [`PASS_MAX`].
    fn target(&self) -> u32 {
        let done = self.film.tiles.iter().filter(|t| t.active).map(|t| t.count).min().unwrap_or(0);
        let next = if done == 0 { 1 } else { done.saturating_add(done.min(PASS_MAX)) };
        next.min(self.options.spp)
    }

    /// Ends the tiles that have enough samples or little noise. Noise is judged when all active tiles have the same
    /// number of samples: the decision does not depend on how passes were cut. A tile goes on as long as a neighbour
    /// does, so that one that missed a bright spot by chance is not left behind.
    fn retire(&mut self) {
        let spp = self.options.spp;
        let mut counts = self.film.tiles.iter().filter(|t| t.active).map(|t| t.count);
        let first = counts.next().unwrap_or(0);
        let even = counts.all(|c| c == first);
        if let Some(noise) = self.options.noise
            && even
            && first >= SAMPLES_BEFORE_NOISE
        {
            let floor = DARKNESS * self.film.mean_luminance();
            let film = &self.film;
            let noisy: Vec<bool> =
                film.tiles.iter().map(|t| t.active && film.tile_error(t, floor) > f64::from(noise)).collect();
            let (columns, rows) = (film.columns() as isize, film.height.div_ceil(TILE) as isize);
            for i in 0..noisy.len() {
                let (x, y) = (i as isize % columns, i as isize / columns);
                let near = |d: isize| {
                    let (nx, ny) = (x + d % 3 - 1, y + d / 3 - 1);
                    let inside = (0..columns).contains(&nx) && (0..rows).contains(&ny);
                    inside && noisy[(ny * columns + nx) as usize]
                };
                self.film.tiles[i].active &= (0..9).any(near);
            }
        }
        for tile in &mut self.film.tiles {
            tile.active &= tile.count < spp;
        }
    }
}

/// What chooses directions, as a part of what a picture depends on.
fn guide_key(guide: &str) -> Key {
    Key::new("guide or training of a guide", guide)
}

/// One pass.
struct Job<'a> {
    renderer: &'a Renderer<'a>,
    camera: Prepared,
    recorder: &'a Recorder<'a>,
    target: u32,
}

impl Job<'_> {
    /// Pixel `i` of a tile, and its random numbers.
    #[inline(always)]
    fn pixel(&self, tile: &Tile, i: usize) -> ([usize; 2], PixelRandom) {
        let options = &self.renderer.options;
        let (x, y) = (tile.x + i % tile.width, tile.y + i / tile.width);
        ([x, y], PixelRandom::new(options.seed, (y * options.width + x) as u64))
    }

    #[inline(always)]
    fn tile(
        &self,
        tile: &mut Tile,
        kernel: impl Fn(&World, &WorldRay, &PathRandom, &PathOptions) -> PathSample,
    ) {
        let options = &self.renderer.options;
        for i in 0..tile.width * tile.height {
            let (at, mut pixel) = self.pixel(tile, i);
            let first = tile.count;
            let samples = (first..self.target).map(|index| {
                let random = pixel.sample(index);
                let ray = primary_ray(options, &self.camera, at, &random);
                kernel(self.renderer.world, &ray, &random, &options.path)
            });
            self.recorder.add(tile, i, first, samples);
        }
    }
}

/// The camera ray of a sample.
#[inline(always)]
pub(crate) fn primary_ray(
    options: &RenderOptions,
    camera: &Prepared,
    pixel: [usize; 2],
    random: &PathRandom,
) -> WorldRay {
    let numbers = random.camera();
    ray_through(options, camera, film_point(options, pixel, &numbers), &numbers)
}

/// Where a sample of a pixel lies, in pixels from the upper left corner.
#[inline(always)]
pub(crate) fn film_point(options: &RenderOptions, [x, y]: [usize; 2], numbers: &SobolPoint) -> [f32; 2] {
    let [dx, dy] = numbers.pair().map(|u| 0.5 + options.filter.offset(u));
    [x as f32 + dx, y as f32 + dy]
}

/// The camera's ray through such a place.
#[inline(always)]
pub(crate) fn ray_through(
    options: &RenderOptions,
    camera: &Prepared,
    [x, y]: [f32; 2],
    numbers: &SobolPoint,
) -> WorldRay {
    let at = vec2(x / options.width as f32, y / options.height as f32);
    camera.ray(at, || [numbers.get(2), numbers.get(3)])
}

//! Recovering a cloud from pictures with cameras and known light: density and albedo on a grid, through the path tracer.
//!
//! Coarse grids first, each finer one from what the last one found: a voxel of a coarse grid is seen by more samples, so
//! that large shapes are found from few of them. Each grid is a fit of [`recover_scene`](mod@crate::recover_scene) of its own.

use crate::engine::NotFinite;
use crate::engine::chain::{FitChain, OfPart};
use crate::engine::plan::PlanRows;
use crate::engine::reference::path_lights;
use crate::engine::traced::{Smoothing, Traced, TracedParameter};
use crate::engine::trainer::{Checkpointing, HistoryPoint};
use crate::engine::views::ViewLights;
use crate::recover_scene::{self, RecoverSceneOptions};
use crate::{FitError, Progress};
use glam::{DAffine3, DMat3, DVec3};
use photofit_image::Image;
use photofit_pathtrace::{
    EnvironmentMap, Field, LightSource, MediumRef, MediumValue, Parameter, Parts, RenderOptions, View,
    Volume, World,
};
use photofit_sampling::hash;
use photofit_scalar::Vec3f;
use std::sync::Mutex;

/// Ends of the grids, coarse to fine, as shares of all steps: three halvings at most.
const ENDS: [f64; 4] = [0.16, 0.36, 0.64, 1.0];
/// Most voxels along the longest side of the coarsest grid.
const COARSEST: usize = 8;
/// Voxels along the longest side.
const SIZES: core::ops::RangeInclusive<usize> = 1..=512;
/// Albedo and optical thickness across the box that the fit starts from.
const ALBEDO: f32 = 0.6;
const THICKNESS: f64 = 0.5;
/// Largest extinction and emission, per unit of length or per longest side of the box, whichever is shorter.
const MOST: f32 = 1e6;
/// Tells the random numbers of grids from one another.
const GRID: u64 = 0x6772_6964;

/// The light around a cloud.
#[derive(Clone, Debug, Default)]
pub struct Surroundings {
    /// Lights without extent.
    pub lights: Vec<LightSource>,
    /// Light from all around, which pictures show behind the cloud.
    pub environment: Option<EnvironmentMap>,
}

impl From<&ViewLights> for Surroundings {
    fn from(lights: &ViewLights) -> Self {
        let (lights, environment) = path_lights(&lights.lights());
        Self { lights, environment }
    }
}

/// Options of [`recover_volume`].
#[derive(Clone, Debug)]
pub struct RecoverVolumeOptions {
    /// Corners of the box that holds the cloud; `None`: [`seen_by`] the cameras.
    pub bounds: Option<[DVec3; 2]>,
    /// Voxels along the longest side of the box, 1 to 512.
    pub size: usize,
    /// Begins with grids of an eighth, a quarter and half as many voxels along each side, of 8 at least.
    pub coarse_to_fine: bool,
    /// Albedo where it is known, 0 to 1; `None`: it is found too.
    pub albedo: Option<[f32; 3]>,
    /// Light that the cloud emits itself is found, too; there may be no other light then.
    pub emission: bool,
    /// Mean cosine of scattering, in (-1, 1).
    pub anisotropy: f32,
    /// Steps of all grids together.
    pub steps: u64,
    /// Peak rate, see [`RecoverSceneOptions::rate`].
    pub rate: f64,
    /// Samples per pixel of the pictures of a step.
    pub spp: u32,
    /// Samples per pixel of its gradients.
    pub gradient_spp: u32,
    /// Most scattering events of a path.
    pub max_depth: u32,
    /// How steps are smoothed.
    pub smoothing: Smoothing,
    /// Seed of all random choices.
    pub seed: u64,
    /// Checkpoints, one for each grid ([`part_folder`](crate::engine::chain::part_folder)), and limits.
    pub checkpointing: Checkpointing,
}

impl Default for RecoverVolumeOptions {
    fn default() -> Self {
        Self {
            bounds: None,
            size: 64,
            coarse_to_fine: true,
            albedo: None,
            emission: false,
            anisotropy: 0.0,
            steps: 200,
            rate: 0.05,
            spp: 8,
            gradient_spp: 4,
            max_depth: 16,
            smoothing: Smoothing::Bilateral,
            seed: 0,
            checkpointing: Checkpointing::default(),
        }
    }
}

/// A cloud that was found.
#[derive(Debug)]
pub struct RecoveredVolume {
    /// The world with the cloud; density, then albedo and emission where they were found.
    pub model: Traced,
    /// Voxels along x, y and z.
    pub size: [usize; 3],
    /// Corners of the box.
    pub bounds: [DVec3; 2],
    /// Extinction per length, x fastest.
    pub extinction: Vec<f32>,
    /// Albedo, three channels of each voxel.
    pub albedo: Vec<f32>,
    /// Radiance that it emits per length, three channels of each voxel; empty where it was not looked for.
    pub emission: Vec<f32>,
    /// The course over all grids.
    pub history: Vec<HistoryPoint>,
    /// Steps after which a grid began, and its longest side.
    pub grids: Vec<(u64, usize)>,
    /// The picture that was held out.
    pub held_out: Option<usize>,
    /// Steps made.
    pub steps: u64,
    /// Steps that were made before this run.
    pub resumed: u64,
    /// Ended by the user or the time limit.
    pub stopped: bool,
    /// What ran on the last grid that was fitted, and what was skipped; the phases of all grids.
    pub plan: PlanRows,
}

/// The cube around the ball that all cameras see whole: about the point that their optical axes pass closest to.
///
/// # Errors
/// If they look in one direction, so that there is no such point, or away from it.
pub fn seen_by(views: &[View]) -> Result<[DVec3; 2], FitError> {
    let wrong = |rule: &str| FitError::Setting { field: "bounds", rule: rule.into() };
    let (mut sum, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for view in views {
        let d = -view.axes[2].as_dvec3().normalize();
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        sum += across;
        right += across * view.eye;
    }
    let scale = views.len().max(1) as f64;
    if (sum * (1.0 / scale)).determinant().abs() < 1e-4 {
        return Err(wrong("cannot be told from cameras that look in one direction; they must be given"));
    }
    let center = sum.inverse() * right;
    let mut radius = f64::INFINITY;
    for view in views {
        let depth = (center - view.eye).dot(-view.axes[2].as_dvec3().normalize());
        let half = f64::from(view.half[0].min(view.half[1]));
        radius = radius.min(depth * half / half.hypot(1.0));
    }
    if !(radius > 0.0 && radius.is_finite()) {
        return Err(wrong("cannot be told from cameras that look away from each other; they must be given"));
    }
    Ok([center - radius, center + radius])
}

/// Finds the cloud, and where [`RecoverVolumeOptions::emission`] says so its own light, in a box that `pictures` show (linear, one for each of `views`, all of one size; their alpha is not
/// looked at) under the light of `surroundings`.
///
/// # Errors
/// See [`FitError`]: options out of their ranges, no light, pictures of another number, values that are not finite.
pub fn recover_volume(
    surroundings: &Surroundings,
    views: &[View],
    pictures: &[Image],
    options: &RecoverVolumeOptions,
    progress: &dyn Progress,
) -> Result<RecoveredVolume, FitError> {
    options.check()?;
    if surroundings.environment.is_none() && surroundings.lights.is_empty() && !options.emission {
        let rule = "have no light; they must have some".into();
        return Err(FitError::Setting { field: "surroundings", rule });
    }
    let Some(first) = pictures.first() else {
        let rule = format!("are 0; they must be {}, one per view", views.len().max(1));
        return Err(FitError::Setting { field: "pictures", rule });
    };
    let bounds = options.bounds.map_or_else(|| seen_by(views), Ok)?;
    let longest = options.longest_sides();
    let mut grid = Grid::start(size_of(&bounds, longest[0]), &bounds, options);
    let (mut grids, mut plan) = (Vec::new(), PlanRows::default());
    let (mut made, mut resumed) = (0, 0);
    let mut chain = FitChain::new(&options.checkpointing, progress);
    let (told, not_finite) = (Mutex::default(), NotFinite::default());
    let _told = not_finite.told_at_the_end(progress);
    let model_of = |grid: &Grid| -> Result<Traced, FitError> {
        let mut model = grid.model(surroundings, &bounds, options, [first.width, first.height])?;
        model.not_finite = not_finite.clone();
        Ok(model)
    };
    for (level, side) in longest.iter().enumerate() {
        grid = grid.resampled(size_of(&bounds, *side));
        let done = chain.steps();
        let end = (options.steps as f64 * ENDS[ENDS.len() - longest.len() + level]).round() as u64;
        let [x, y, z] = grid.size;
        let name = format!("{x} x {y} x {z} voxels");
        let shown = OfPart { progress, done, steps: options.steps, name, told: &told };
        let r = chain.fit(1, &shown, |checkpointing| {
            let mut model = model_of(&grid)?;
            // Grids have noise of their own: values follow that of the grid before.
            let seed = seed_of(options.seed, level);
            model.options.seed = seed;
            let (rate, checkpointing) = (options.rate, checkpointing.clone());
            let own = RecoverSceneOptions { steps: end - done, rate, seed, checkpointing };
            recover_scene::fit(model, views, pictures, &own, &shown)
        })?;
        grids.push((done, *side));
        plan.phases.extend(r.plan.phases.iter().map(|p| p.of_part(&format!("{side} voxels"))));
        if r.steps > 0 || plan.items.is_empty() {
            plan.items.clone_from(&r.plan.items);
        }
        chain.add(&r.history, end - done);
        grid.extinction.copy_from_slice(r.model.of(0));
        let mut next = 1..;
        for (found, values) in
            [(options.albedo.is_none(), &mut grid.albedo), (options.emission, &mut grid.emission)]
        {
            if found && let Some(k) = next.next() {
                values.copy_from_slice(r.model.of(k));
            }
        }
        (made, resumed) = (made + r.steps, resumed + r.resumed);
        if level + 1 == longest.len() || r.stopped {
            let whole = size_of(&bounds, options.size);
            let mut model = r.model;
            if grid.size != whole {
                let [a, b, c] = whole;
                progress.note(&format!(
                    "the fit ended on a grid of {x} x {y} x {z} voxels, of which the course tells; the result has {a} x {b} x {c}, interpolated linearly"
                ));
                grid = grid.resampled(whole);
                model = model_of(&grid)?;
            }
            model.options.seed = options.seed;
            return Ok(RecoveredVolume {
                size: grid.size,
                bounds,
                extinction: grid.extinction,
                albedo: grid.albedo,
                emission: grid.emission,
                history: chain.into_history(),
                grids,
                held_out: r.held_out,
                steps: made,
                resumed,
                stopped: r.stopped,
                plan,
                model,
            });
        }
    }
    unreachable!("there is a grid")
}

/// Smallest side and largest coordinate of a box: far from them, transforms and squares of lengths leave single precision.
const SIDE_LEAST: f64 = 1e-9;
const COORDINATE_MOST: f64 = 1e9;

/// Why a grid cannot fill a box, from corner to corner; `None` where it can.
pub fn bounds_fault([lo, hi]: [DVec3; 2]) -> Option<String> {
    let usable = lo.abs().max(hi.abs()).max_element() <= COORDINATE_MOST
        && (hi - lo).min_element() >= SIDE_LEAST
        && lo.is_finite()
        && hi.is_finite();
    let rule = || {
        format!(
            "are {lo} to {hi}; they must be finite and have a volume, with sides of {SIDE_LEAST:e} or more within \
             {COORDINATE_MOST:e}"
        )
    };
    (!usable).then(rule)
}

impl RecoverVolumeOptions {
    /// Checks the ranges of the options.
    ///
    /// # Errors
    /// [`FitError::Setting`] names the field, what it is and what it must be.
    pub fn check(&self) -> Result<(), FitError> {
        let wrong = |field, rule| Err(FitError::Setting { field, rule });
        if !SIZES.contains(&self.size) {
            return wrong(
                "size",
                format!("is {}; it must be {} to {}", self.size, SIZES.start(), SIZES.end()),
            );
        }
        if let Some(rule) = self.bounds.and_then(bounds_fault) {
            return wrong("bounds", rule);
        }
        if let Some(a) = self.albedo.filter(|a| !a.iter().all(|v| (0.0..=1.0).contains(v))) {
            return wrong("albedo", format!("is {a:?}; it must be 0 to 1"));
        }
        if !(self.anisotropy > -1.0 && self.anisotropy < 1.0) {
            return wrong(
                "anisotropy",
                format!("is {}; it must be more than -1 and less than 1", self.anisotropy),
            );
        }
        Ok(())
    }

    /// Voxels along the axes of the grid that is found from these cameras.
    ///
    /// # Errors
    /// As [`seen_by`], where there are no bounds.
    pub fn voxels(&self, views: &[View]) -> Result<[usize; 3], FitError> {
        Ok(size_of(&self.bounds.map_or_else(|| seen_by(views), Ok)?, self.size))
    }

    /// Values of each voxel that are found.
    pub fn values_per_voxel(&self) -> usize {
        1 + if self.albedo.is_none() { 3 } else { 0 } + if self.emission { 3 } else { 0 }
    }

    /// Longest sides of the grids, coarse to fine.
    pub fn longest_sides(&self) -> Vec<usize> {
        let mut sides = vec![self.size];
        while self.coarse_to_fine && sides.len() < ENDS.len() && sides[0] >= 2 * COARSEST {
            sides.insert(0, sides[0].div_ceil(2));
        }
        sides
    }
}

/// Voxels along the axes of a box whose longest side has so many.
fn size_of([lo, hi]: &[DVec3; 2], longest: usize) -> [usize; 3] {
    let sides = *hi - *lo;
    (sides / sides.max_element() * longest as f64).to_array().map(|n| (n.round() as usize).max(1))
}

/// A cloud in a box.
struct Grid {
    size: [usize; 3],
    extinction: Vec<f32>,
    albedo: Vec<f32>,
    /// Empty: none.
    emission: Vec<f32>,
}

impl Grid {
    fn start(size: [usize; 3], [lo, hi]: &[DVec3; 2], options: &RecoverVolumeOptions) -> Self {
        let voxels = size.iter().product();
        let extinction = (THICKNESS / (*hi - *lo).max_element()) as f32;
        Self {
            size,
            extinction: vec![extinction; voxels],
            albedo: options.albedo.unwrap_or([ALBEDO; 3]).repeat(voxels),
            emission: if options.emission { vec![0.0; 3 * voxels] } else { Vec::new() },
        }
    }

    /// The same on another grid, linearly between the centres of voxels.
    fn resampled(self, size: [usize; 3]) -> Self {
        if size == self.size {
            return self;
        }
        let of = |values: &[f32], channels| resample(values, self.size, channels, size);
        let emission = if self.emission.is_empty() { Vec::new() } else { of(&self.emission, 3) };
        Self { size, extinction: of(&self.extinction, 1), albedo: of(&self.albedo, 3), emission }
    }

    fn model(
        &self,
        surroundings: &Surroundings,
        bounds: &[DVec3; 2],
        options: &RecoverVolumeOptions,
        [width, height]: [usize; 2],
    ) -> Result<Traced, FitError> {
        let [lo, hi] = *bounds;
        let colors =
            |values: &[f32]| values.as_chunks::<3>().0.iter().map(|a| Vec3f::from_array(*a)).collect();
        let (size, transform) = (self.size, DAffine3::from_translation(lo) * DAffine3::from_scale(hi - lo));
        let emits = !self.emission.is_empty();
        let volume = Volume {
            size,
            density: self.extinction.clone(),
            scale: 1.0,
            albedo: Vec3f::splat(1.0),
            albedos: colors(&self.albedo),
            g: options.anisotropy,
            emission: emits.then(|| Field { size, values: colors(&self.emission), transform }),
            transform,
        };
        let Surroundings { lights, environment } = surroundings.clone();
        let world = World::new(Parts { lights, environment, volumes: vec![volume], ..Parts::default() })?;
        let [x, y, z] = self.size;
        let of = |name: &str, value, channels, high| TracedParameter {
            name: name.into(),
            parameter: Parameter::Medium { medium: MediumRef::Volume(0), value },
            shape: [z, y, x, channels],
            range: [0.0, high],
        };
        // In small boxes densities are large.
        let most = MOST.max(MOST / (hi - lo).max_element() as f32);
        let mut parameters = vec![of("extinction", MediumValue::Extinction, 1, most)];
        if options.albedo.is_none() {
            parameters.push(of("albedo", MediumValue::Albedo, 3, 1.0));
        }
        if emits {
            parameters.push(of("emission", MediumValue::Emission, 3, most));
        }
        let render =
            RenderOptions { width, height, spp: options.spp, seed: options.seed, ..RenderOptions::default() };
        let mut model = Traced::new(world, render, parameters)?;
        model.options.path.max_depth = options.max_depth;
        model.gradient_spp = options.gradient_spp;
        model.smoothing = options.smoothing;
        Ok(model)
    }
}

/// The seed of a grid of the chain.
fn seed_of(seed: u64, level: usize) -> u64 {
    if level > 0 { hash(seed, GRID, level as u64) } else { seed }
}

/// Values of a grid, x fastest, on another grid over the same box.
fn resample(values: &[f32], from: [usize; 3], channels: usize, to: [usize; 3]) -> Vec<f32> {
    // For each axis and each new voxel: the two old ones around its centre, and the weight of the second.
    let axis = |k: usize| {
        let taps = |i: usize| {
            let at =
                ((i as f64 + 0.5) / to[k] as f64 * from[k] as f64 - 0.5).clamp(0.0, (from[k] - 1) as f64);
            let low = at as usize;
            (low, (low + 1).min(from[k] - 1), (at - low as f64) as f32)
        };
        (0..to[k]).map(taps).collect::<Vec<_>>()
    };
    let [xs, ys, zs] = [0, 1, 2].map(axis);
    let mut out = Vec::with_capacity(to.iter().product::<usize>() * channels);
    for &(z0, z1, w) in &zs {
        for &(y0, y1, v) in &ys {
            for &(x0, x1, u) in &xs {
                for c in 0..channels {
                    let at = |x, y, z| values[((z * from[1] + y) * from[0] + x) * channels + c];
                    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
                    let row = |y, z| mix(at(x0, y, z), at(x1, y, z), u);
                    out.push(mix(mix(row(y0, z0), row(y1, z0), v), mix(row(y0, z1), row(y1, z1), v), w));
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests;

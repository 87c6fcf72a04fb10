//! A mesh with material maps: its groups of parameters, the stages from them to pictures, and the same stages reversed.

use super::cpu::Chain;
use super::loss::PictureLoss;
use super::model::{Group, GroupName, ModelError};
use super::plan::rows::Work;
use super::plan::{SurfacePlan, held};
use super::views::Shot;
use crate::FitError;
use crate::candidate::{Candidate, ParameterGradients};
use photofit_optim::{EdgeAware, LargeSteps, OptimError, Optimizer, Placement, Temporal};
use photofit_raster::deferred::{Masks, Passes};
use photofit_raster::texture::Pyramid;
use photofit_raster::{CHANNELS, channel};

/// Groups of a [`Surface`].
pub const POSITIONS: &str = "positions";
/// See [`POSITIONS`].
pub const MAPS: &str = "maps";

/// Name of the group of a mip level, where each has texels of its own: that of the base is [`MAPS`].
pub(crate) fn group_of_level(level: usize) -> GroupName {
    if level == 0 { MAPS.into() } else { format!("mip level {level}").into() }
}

/// The samples of all levels of maps that are parameters, one level after the other.
pub(crate) fn samples_of(candidate: &Candidate, maps: &Pyramid<f32, CHANNELS>) -> Vec<f32> {
    let fitted = maps.levels.iter().take(candidate.fitted_levels());
    fitted.flat_map(|l| l.texels.as_flattened()).copied().collect()
}

/// Smoothness of steps from a start that is close.
pub(crate) const SMOOTHNESS: f64 = 0.3;

/// Weight of the Laplacians for a mesh that the paper of Large Steps fits, and its vertices.
const LAMBDA_OF_PAPER: f64 = 19.0;
/// See [`LAMBDA_OF_PAPER`].
const VERTICES: f64 = 10_000.0;
/// Distance of normals at which the bilateral filter shares steps no more.
pub(super) const SIGMA: f64 = 0.5;

/// How steps of positions are made from their gradients. All that differs between them stands here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PositionOptimizer {
    /// Large Steps ([`LargeSteps`]).
    #[default]
    LargeSteps,
    /// The gradient is diffused ([`LargeSteps`]), the first moment is diffused over the surface but not over its creases
    /// ([`EdgeAware`], guided by the present vertex normals), and the second moment is the largest of all.
    Bilateral,
    /// Adam for each coordinate by itself.
    Adam,
}

impl PositionOptimizer {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::LargeSteps, Self::Bilateral, Self::Adam];

    /// Its name in lists of options.
    pub fn name(self) -> &'static str {
        match self {
            Self::LargeSteps => "large-steps",
            Self::Bilateral => "bilateral",
            Self::Adam => "adam",
        }
    }

    /// What it does, in one sentence for people.
    pub fn about(self) -> &'static str {
        match self {
            Self::LargeSteps => "Steps diffused over the surface",
            Self::Bilateral => "The same, but not over creases",
            Self::Adam => "Each coordinate by itself",
        }
    }

    /// The smoothness, a weight of Laplacians, of a mesh of so many vertices: with their number, so that steps are shared
    /// over the same part of the surface whatever that is.
    pub fn for_vertices(n: usize) -> f64 {
        LAMBDA_OF_PAPER * n as f64 / VERTICES
    }

    /// Peak rate for a shape that starts from far away, in radii of what the cameras see.
    pub fn peak_rate(self) -> f64 {
        match self {
            Self::LargeSteps | Self::Bilateral => 0.03,
            // Its steps are as long at every vertex.
            Self::Adam => 0.003,
        }
    }

    /// Whether its filters are guided by the present vertex normals.
    pub fn needs_normals(self) -> bool {
        self == Self::Bilateral
    }

    /// How the moments of the positions are kept.
    pub(super) fn temporal(self) -> Temporal {
        if self == Self::Adam { Temporal::adam() } else { temporal(POSITIONS) }
    }

    /// An optimizer for the positions of a candidate.
    fn of(self, candidate: &Candidate, smoothness: f64) -> Result<Optimizer<f32>, OptimError> {
        let (vertices, edges) = (candidate.positions.len(), &candidate.edges);
        let made = || Optimizer::new(POSITIONS, 3 * vertices, self.temporal());
        match self {
            Self::LargeSteps => {
                made()?.with_filter(Placement::VARIABLE, LargeSteps::new(vertices, edges, smoothness)?)
            }
            Self::Bilateral => made()?
                .with_filter(Placement::PRE, LargeSteps::new(vertices, edges, smoothness)?)?
                .with_filter(Placement::FIRST, EdgeAware::new(vertices, edges, smoothness, SIGMA)?),
            Self::Adam => made(),
        }
    }
}

/// A mesh with material maps: welded positions and a group of texels of [`CHANNELS`] samples, or one for each mip level that
/// has texels of its own.
#[derive(Clone, Debug)]
pub struct Surface {
    /// The parameters and the chain.
    pub candidate: Candidate,
    /// Which parts of the chain run.
    pub passes: Passes,
    /// Which samples of a texel are fitted, as relative rates.
    pub rates: [f32; CHANNELS],
    /// Whether the positions are a group; else the shape is fixed and the maps are the only group.
    pub moves: bool,
    /// How they move.
    pub optimizer: PositionOptimizer,
    /// How smooth their steps are: weight of Laplacians; [`PositionOptimizer::Adam`] has none.
    pub smoothness: f64,
    /// How masks are drawn in steps; pictures of evaluations cut them.
    pub masks: Masks,
}

/// Relative rates of the samples of a texel of which these are fitted.
pub(super) fn rates_of(fitted: [bool; CHANNELS]) -> [f32; CHANNELS] {
    let mut rates = fitted.map(|f| if f { 1.0 } else { 0.0 });
    rates[channel::METALLIC] *= 0.5;
    rates
}

/// Rates of coarse mip levels that are free, relative to the base: they start farther from where they go, and only some pictures
/// read each of them. Chosen on one ball (docs/crates/fit.md).
pub(super) const COARSE_RATE: f32 = 5.0;

/// Relative rates of the samples of coarse mip levels that are free, from those of the base. They lose normals, which roughness
/// takes up, also where that of the base is constant.
pub(super) fn coarse_rates(mut rates: [f32; CHANNELS]) -> [f32; CHANNELS] {
    if rates[channel::NORMAL] > 0.0 {
        rates[channel::ROUGHNESS] = 1.0;
    }
    rates.map(|r| r * COARSE_RATE)
}

/// Slopes of masks that fade, at the first and after the last step of a fit (docs/crates/fit.md).
const FADE: [f32; 2] = [2.0, 8.0];

/// Slopes of masks over these shares of a fit, in between geometrically; `None` where none fades.
pub(crate) fn fade_over(fades: bool, shares: [f32; 2]) -> Option<[f32; 2]> {
    fades.then(|| shares.map(|t| FADE[0] * (FADE[1] / FADE[0]).powf(t)))
}

/// Peak rate of maps that start from a bake: relative to the error of the start, whose PSNR is given.
pub(crate) fn rate_of_maps(start_psnr: f64) -> f64 {
    (0.04 * 10f64.powf(-start_psnr / 20.0)).clamp(2e-4, 5e-3)
}

/// Peak rate of positions that start from a shape at this mean distance of the reference, in the unit of the frame.
pub(crate) fn rate_of_positions(distance: f64) -> f64 {
    distance.clamp(1e-4, 1.5e-2)
}

/// The temporal filter of a group's optimizer.
pub(super) fn temporal(group: &str) -> Temporal {
    if group == POSITIONS {
        Temporal::uniform_adam().betas(0.9, 0.99)
    } else {
        Temporal { beta1: 0.8, beta2: 0.98, relative_epsilon: 0.5, ..Temporal::adam() }
    }
}

impl Surface {
    /// A candidate that is fitted as a plan says.
    pub fn new(candidate: Candidate, plan: &SurfacePlan) -> Self {
        Self {
            candidate,
            passes: plan.passes,
            rates: rates_of(plan.fitted),
            moves: true,
            optimizer: PositionOptimizer::default(),
            smoothness: SMOOTHNESS,
            masks: Masks::Cut,
        }
    }

    /// What a fit of so many steps does with it.
    pub(crate) fn work(&self, steps: u64) -> Work {
        let coarse = (self.candidate.fitted_levels() > 1).then(|| coarse_rates(self.rates));
        let held = held(&self.candidate, self.rates.map(|r| r > 0.0));
        Work { passes: self.passes, rates: self.rates, coarse, held, moves: self.moves, steps: steps > 0 }
    }

    /// Whether the positions are fitted too. Silhouettes are blended for their gradients alone.
    #[must_use]
    pub fn moving(mut self, moves: bool) -> Self {
        self.moves = moves;
        self.passes.position_gradients = moves;
        self.passes.antialias = moves;
        self
    }

    /// The passes of a step that moves these groups.
    pub(super) fn moving_passes(&self, moving: &[bool]) -> Passes {
        Passes {
            masks: self.masks,
            position_gradients: self.group(POSITIONS).is_some_and(|g| moving[g]),
            map_gradients: self.passes.map_gradients && moving[usize::from(self.moves)..].contains(&true),
            ..self.passes
        }
    }

    /// Brings up to date what follows from the samples of a group: mip levels; puts locked vertices back.
    pub(crate) fn update(&mut self, group: usize) {
        if self.is_positions(group) {
            self.candidate.hold_locked();
        } else {
            self.candidate.maps.rebuild();
        }
    }

    /// Number of the group of a name.
    pub(crate) fn group(&self, name: &str) -> Option<usize> {
        let levels = (0..self.candidate.fitted_levels()).map(group_of_level);
        let positions = self.moves.then(|| POSITIONS.into());
        positions.into_iter().chain(levels).position(|n: GroupName| n == name)
    }

    /// Whether a group is that of the positions, which comes first.
    pub(super) fn is_positions(&self, group: usize) -> bool {
        self.moves && group == 0
    }

    /// The mip level whose texels are a group.
    pub(super) fn level_of(&self, group: usize) -> usize {
        group - usize::from(self.moves)
    }
}

impl Chain for Surface {
    type Gradients = ParameterGradients;

    fn groups(&self) -> Vec<Group> {
        let positions = Group {
            name: POSITIONS.into(),
            rows: self.candidate.positions.len(),
            columns: 3,
            ranges: Vec::new(),
            unit: None,
            rates: Vec::new(),
        };
        let level = |k: usize| {
            let rates = if k == 0 { self.rates } else { coarse_rates(self.rates) };
            Group {
                name: group_of_level(k),
                rows: self.candidate.maps.levels[k].texels.len(),
                columns: CHANNELS,
                ranges: RANGES.to_vec(),
                unit: Some(channel::NORMAL),
                rates: rates.to_vec(),
            }
        };
        let positions = self.moves.then_some(positions);
        positions.into_iter().chain((0..self.candidate.fitted_levels()).map(level)).collect()
    }

    fn optimizer(&self, group: &Group) -> Result<Optimizer<f32>, FitError> {
        let length = group.rows * group.columns;
        if group.name == POSITIONS {
            return self.optimizer.of(&self.candidate, self.smoothness).map_err(FitError::Preconditioner);
        }
        Optimizer::new(&group.name, length, temporal(MAPS)).map_err(FitError::Preconditioner)
    }

    fn step_masks(&mut self, masks: Masks) {
        self.masks = masks;
    }

    fn guide(&self, group: usize) -> Vec<f32> {
        if !self.optimizer.needs_normals() || !self.is_positions(group) {
            return Vec::new();
        }
        let normals = self.candidate.weld.pick(&self.candidate.round_normals());
        bytemuck::cast_slice(&normals).to_vec()
    }

    fn values(&self, group: usize) -> &[f32] {
        if self.is_positions(group) {
            bytemuck::cast_slice(&self.candidate.positions)
        } else {
            self.candidate.maps.levels[self.level_of(group)].texels.as_flattened()
        }
    }

    fn values_mut(&mut self, group: usize) -> &mut [f32] {
        if self.is_positions(group) {
            bytemuck::cast_slice_mut(&mut self.candidate.positions)
        } else {
            let level = self.level_of(group);
            self.candidate.maps.levels[level].texels.as_flattened_mut()
        }
    }

    fn changed(&mut self, group: usize) -> Result<(), ModelError> {
        self.update(group);
        Ok(())
    }

    fn gradients(&self) -> ParameterGradients {
        self.candidate.gradients()
    }

    fn moved<'a>(
        &'a mut self,
        gradients: &'a ParameterGradients,
        group: usize,
    ) -> (&'a mut [f32], &'a [f32]) {
        let g = if self.is_positions(group) {
            bytemuck::cast_slice(&gradients.positions)
        } else {
            gradients.rendered.maps.levels[self.level_of(group)].texels.as_flattened()
        };
        (self.values_mut(group), g)
    }

    fn step(
        &self,
        shots: &[Shot],
        loss: PictureLoss,
        moving: &[bool],
        gradients: &mut ParameterGradients,
    ) -> Result<f64, ModelError> {
        Ok(self.candidate.step(shots, loss, &self.moving_passes(moving), gradients))
    }

    fn pictures(&self, shots: &[Shot]) -> Result<Vec<Vec<[f32; 4]>>, ModelError> {
        Ok(pictures(&self.candidate, shots, &self.passes))
    }
}

/// The pictures of a candidate.
pub(crate) fn pictures(candidate: &Candidate, shots: &[Shot], passes: &Passes) -> Vec<Vec<[f32; 4]>> {
    let vertices = candidate.vertices();
    let picture = |shot: &Shot| candidate.render(&vertices, shot, passes).color;
    shots.iter().map(picture).collect()
}

/// Range of each sample of a texel.
const RANGES: [[f32; 2]; CHANNELS] = {
    let mut r = [[0.0, 1.0]; CHANNELS];
    r[channel::ROUGHNESS] = [photofit_shading::ROUGHNESS_MIN as f32, 1.0];
    r[channel::NORMAL] = [-1.0, 1.0];
    r[channel::NORMAL + 1] = [-1.0, 1.0];
    r[channel::NORMAL + 2] = [0.02, 1.0];
    r[channel::EMISSIVE] = [0.0, 1e4];
    r[channel::EMISSIVE + 1] = [0.0, 1e4];
    r[channel::EMISSIVE + 2] = [0.0, 1e4];
    r
};

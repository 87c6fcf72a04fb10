//! Parameters of a path-traced world: materials, textures, lights, media, with derivatives by path replay. The shape stays.
//!
//! Picture and gradient of a step take separate random numbers, so that the gradient of the squared error has no bias
//! from their covariance; both follow from the number of the shot. Both walk paths whose directions a guide may choose,
//! which is frozen as long as the model is: gradients have the same expectation with it and without.

mod correction;
pub(crate) mod filters;

use super::cpu::Chain;
use super::loss::PictureLoss;
use super::model::{Group, ModelError};
use super::not_finite::NotFinite;
use super::reference::path_lights;
use super::views::Shot;
use crate::FitError;
use crate::guiding::Guidance;
use correction::{Correction, Motion};
pub use filters::Smoothing;
use filters::{levels, narrowed, optimizer};
use photofit_image::Image;
use photofit_optim::{Optimizer, clamp_channels};
use photofit_pathtrace::{Adjoint, GradientSamples, Parameter, RenderOptions, Renderer, View, World};
use photofit_sampling::hash;
use std::borrow::Cow;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Tell the random numbers of pictures and gradients from one another.
const PICTURE: u64 = 0x7069_6374;
const GRADIENT: u64 = 0x6772_6164;

/// A parameter that is fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct TracedParameter {
    /// Its name, for messages and checkpoints.
    pub name: String,
    /// Where it is in the world.
    pub parameter: Parameter,
    /// Slices, rows, columns and channels, as they follow each other in memory from slow to fast; one slice for textures,
    /// one row and one column too for values.
    pub shape: [usize; 4],
    /// Lowest and highest value; a fit keeps within [`World::effective_range`], too.
    pub range: [f32; 2],
}

impl TracedParameter {
    /// Number of values.
    pub fn cells(&self) -> usize {
        self.shape[0] * self.shape[1] * self.shape[2]
    }

    /// Channels of a value.
    pub fn channels(&self) -> usize {
        self.shape[3]
    }
}

/// Which pixels are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ComparedPixels {
    /// All, whatever covers them.
    #[default]
    All,
    /// Those that model and reference both cover whole: where one shape is seen beside the other, the difference says
    /// nothing of the parameters.
    Covered,
}

/// Coverage of a pixel that is covered whole.
pub(crate) const WHOLE: f32 = 0.99;

/// A world as a function of parameters.
#[derive(Debug)]
pub struct Traced {
    /// The world with the present values; behind a lock, since shots may bring lights of their own.
    world: Mutex<World>,
    /// Samples and depth of the pictures of a step; their size is that of the shots.
    pub options: RenderOptions,
    /// Samples per pixel of its gradients.
    pub gradient_spp: u32,
    /// Samples per pixel of evaluations.
    pub evaluation_spp: u32,
    /// What is fitted.
    pub parameters: Vec<TracedParameter>,
    /// How steps of textures and grids are smoothed.
    pub smoothing: Smoothing,
    /// Which pixels of a shot are compared.
    pub compared: ComparedPixels,
    /// What directions of the paths of a step are chosen by; evaluations have no guide.
    pub guidance: Guidance,
    /// What pictures and gradients leave out.
    pub(crate) not_finite: NotFinite,
    values: Vec<Vec<f32>>,
    /// [`World::effective_range`] of each parameter in the world that the model was made of.
    effective: Vec<[[f32; 2]; 3]>,
    /// What moves of each parameter.
    motions: Vec<Motion>,
    /// How much of the phase was made when a step was last begun.
    share: f64,
}

impl Traced {
    /// Starts from the values that the world has.
    ///
    /// # Errors
    /// If the world has no such parameter with derivatives, or one of another shape.
    pub fn new(
        world: World,
        options: RenderOptions,
        parameters: Vec<TracedParameter>,
    ) -> Result<Self, FitError> {
        let mut values = Vec::new();
        for p in &parameters {
            let read = world.parameter(&p.parameter)?;
            let cells = p.cells();
            let held = read.len() / cells.max(1);
            if cells * held != read.len() || !(1..=held).contains(&p.channels()) {
                let rule = format!("of {} is {:?}; the world has {} values", p.name, p.shape, read.len());
                return Err(FitError::Setting { field: "shape", rule });
            }
            values.push(read.chunks_exact(held).flat_map(|v| v[..p.channels()].to_vec()).collect());
        }
        let (gradient_spp, evaluation_spp, smoothing) = (1, 64, Smoothing::default());
        let effective = parameters.iter().map(|p| world.effective_range(&p.parameter)).collect();
        let (world, compared) = (Mutex::new(world), ComparedPixels::default());
        let motions = parameters.iter().map(|_| Motion::Values).collect();
        let guidance = Guidance::off();
        let mut made = Self {
            effective,
            guidance,
            not_finite: NotFinite::default(),
            motions,
            world,
            options,
            gradient_spp,
            evaluation_spp,
            parameters,
            smoothing,
            compared,
            values,
            share: 0.0,
        };
        // The world keeps values as it reads them to rounding; from here on it has those that a checkpoint gives back.
        for k in 0..made.parameters.len() {
            made.update(k)?;
        }
        Ok(made)
    }

    /// The world with the present values, under the lights that it was seen under last.
    pub fn world(&self) -> MutexGuard<'_, World> {
        self.world.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The same, to be changed.
    pub fn world_mut(&mut self) -> &mut World {
        self.world.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    /// The same without the rest.
    pub fn into_world(self) -> World {
        self.world.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    /// Works with the world under the lights of a shot; where it has none, under those of the world.
    fn under<R>(&self, shot: &Shot, work: impl FnOnce(&World) -> Result<R, FitError>) -> Result<R, FitError> {
        let mut world = self.world();
        if !shot.lights.0.is_empty() {
            let lights = shot.lights.lights();
            let (sources, environment) = path_lights(&lights);
            world.relight(&sources, environment)?;
        }
        work(&world)
    }

    /// Whether pictures and derivatives can be had from a camera.
    ///
    /// # Errors
    /// If the path tracer refuses the camera or a parameter.
    pub fn check(&self, view: &View) -> Result<(), FitError> {
        let places: Vec<Parameter> = self.parameters.iter().map(|p| p.parameter.clone()).collect();
        Adjoint::new(&self.world(), view, self.options.clone(), &places)?;
        Ok(())
    }

    /// The values of a parameter, channel by channel.
    pub fn of(&self, parameter: usize) -> &[f32] {
        &self.values[parameter]
    }

    /// Replaces the values of a parameter.
    ///
    /// # Errors
    /// If the world refuses them.
    ///
    /// # Panics
    /// If their number is another one.
    pub fn replace(&mut self, parameter: usize, values: &[f32]) -> Result<(), FitError> {
        self.values[parameter].copy_from_slice(values);
        match &mut self.motions[parameter] {
            Motion::Values => {}
            Motion::Logarithms(logarithms) => {
                logarithms.iter_mut().zip(values).for_each(|(l, v)| *l = v.ln());
            }
            Motion::Correction(c) => c.restart(values),
        }
        Ok(self.update(parameter)?)
    }

    /// From now on a parameter moves in the logarithms of its values, which a range above 0 bounds: a step is a factor, so
    /// that what spans decades (light from all around) moves as fast where it is dark as where it is bright. Values are moved
    /// into the range.
    ///
    /// # Errors
    /// If the range is not positive, or the world refuses the values.
    pub fn move_in_logarithms(&mut self, parameter: usize) -> Result<(), FitError> {
        let TracedParameter { name, range: [low, high], .. } = &self.parameters[parameter];
        if !(*low > 0.0 && high.is_finite()) {
            let rule = format!("of {name} is {low} to {high}; it must be above 0 and finite");
            return Err(FitError::Setting { field: "range", rule });
        }
        let values: Vec<f32> = self.values[parameter].iter().map(|v| v.clamp(*low, *high)).collect();
        self.motions[parameter] = Motion::Logarithms(vec![0.0; values.len()]);
        self.replace(parameter, &values)
    }

    /// From now on a texture moves by a correction that is linear between the centres of cells of `side` x `side` texels, a factor of
    /// each texel or an addition to it: what its texels hold among themselves stays, and pictures that show several texels in a pixel
    /// cannot write their noise into them.
    ///
    /// # Panics
    /// If the parameter is no texture, or `side` is 0.
    pub fn correct(&mut self, parameter: usize, side: usize, is_factor: bool) {
        let [depth, height, width, _] = self.parameters[parameter].shape;
        assert!(depth == 1 && side > 0, "a texture, and cells of a texel or more");
        let start = self.values[parameter].clone();
        self.motions[parameter] =
            Motion::Correction(Correction::none([width, height], side, is_factor, start));
    }

    /// Whether a parameter moves in the logarithms of its values.
    pub fn moves_in_logarithms(&self, parameter: usize) -> bool {
        matches!(self.motions[parameter], Motion::Logarithms(_))
    }

    /// Texels along the side of the cells by which a texture moves; `None` where it has no correction.
    pub fn cell_of_correction(&self, parameter: usize) -> Option<usize> {
        match &self.motions[parameter] {
            Motion::Correction(c) => Some(c.side()),
            _ => None,
        }
    }

    /// What the optimizer moves of a parameter.
    fn moving(&self, parameter: usize) -> &[f32] {
        match &self.motions[parameter] {
            Motion::Values => &self.values[parameter],
            Motion::Logarithms(l) => l,
            Motion::Correction(c) => &c.grid,
        }
    }

    fn moving_mut(&mut self, parameter: usize) -> &mut [f32] {
        match &mut self.motions[parameter] {
            Motion::Values => &mut self.values[parameter],
            Motion::Logarithms(l) => l,
            Motion::Correction(c) => &mut c.grid,
        }
    }

    /// Lowest and highest value of each channel of a parameter: its range within [`World::effective_range`].
    pub(crate) fn ranges(&self, parameter: usize) -> Vec<[f32; 2]> {
        let (p, effective) = (&self.parameters[parameter], self.effective[parameter]);
        let [low, high] = p.range;
        let of = |[from, to]: [f32; 2]| [from.clamp(low, high), to.clamp(low, high)];
        (0..p.channels()).map(|c| effective.get(c).map_or(p.range, |e| of(*e))).collect()
    }

    /// The values of a parameter, moved into the ranges of their channels.
    pub(crate) fn within(&self, parameter: usize) -> Vec<f32> {
        let mut values = self.of(parameter).to_vec();
        clamp_channels(&mut values, &self.ranges(parameter));
        values
    }

    /// Slices, rows and columns of what moves of a parameter, and the lowest and highest value of each channel.
    fn moving_shape(&self, parameter: usize) -> ([usize; 3], Vec<[f32; 2]>) {
        let [depth, height, width, _] = self.parameters[parameter].shape;
        let mut ranges = self.ranges(parameter);
        let shape = match &self.motions[parameter] {
            Motion::Values => [depth, height, width],
            Motion::Logarithms(_) => {
                ranges.iter_mut().for_each(|r| *r = r.map(f32::ln));
                [depth, height, width]
            }
            Motion::Correction(c) => {
                let [columns, rows] = c.cells();
                ranges.iter_mut().for_each(|r| *r = c.range(*r));
                [1, rows, columns]
            }
        };
        (shape, ranges)
    }

    /// Whether steps of the parameter of this number are smoothed: of environments of at least 16 rows, and of textures and grids
    /// in space with at least 16 cells that move along some side, where that is asked for.
    pub fn is_smoothed(&self, parameter: usize) -> bool {
        self.levels(parameter) > 0 && self.smoothing != Smoothing::None
    }

    fn levels(&self, parameter: usize) -> u32 {
        levels(&self.parameters[parameter].parameter, self.moving_shape(parameter).0)
    }

    /// Whether the filter of a parameter loses its levels over the steps: of textures, where that is asked for.
    pub fn narrows(&self, parameter: usize) -> bool {
        let is_texture = matches!(
            self.parameters[parameter].parameter,
            Parameter::Texels { .. } | Parameter::Graph { .. }
        );
        is_texture && self.smoothing == Smoothing::Narrowing && self.is_smoothed(parameter)
    }

    /// Levels of the bilateral filter of a parameter after a share of a phase.
    fn levels_after(&self, parameter: usize, share: f64) -> u32 {
        let all = self.levels(parameter);
        if self.narrows(parameter) { narrowed(all, share) } else { all }
    }

    fn update(&mut self, parameter: usize) -> Result<(), photofit_pathtrace::PathtraceError> {
        let p = &self.parameters[parameter];
        let (channels, values) = (p.channels(), &self.values[parameter]);
        let world = self.world.get_mut().unwrap_or_else(PoisonError::into_inner);
        // Numbers that are kept as colours are the same in all channels.
        world.spread_parameter(&p.parameter, channels, values)
    }

    /// The picture of a camera, of the size that the options say: linear, premultiplied RGBA.
    ///
    /// # Errors
    /// If it cannot be rendered.
    pub fn picture(&self, view: &View, spp: u32, seed: u64) -> Result<Image, FitError> {
        self.sized(view, (self.options.width, self.options.height), spp, seed)
    }

    /// The same of another size.
    ///
    /// # Errors
    /// As [`Self::picture`].
    pub fn sized(
        &self,
        view: &View,
        (width, height): (usize, usize),
        spp: u32,
        seed: u64,
    ) -> Result<Image, FitError> {
        self.render(&self.world(), view, (width, height), (spp, seed), &Guidance::off())
    }

    fn render(
        &self,
        world: &World,
        view: &View,
        (width, height): (usize, usize),
        (spp, seed): (u32, u64),
        guidance: &Guidance,
    ) -> Result<Image, FitError> {
        let options = RenderOptions { width, height, spp, seed, ..self.options.clone() };
        let mut renderer = Renderer::new(world, view, options)?;
        guidance.finish(&mut renderer);
        self.not_finite.add(renderer.progress().not_finite);
        Ok(renderer.picture())
    }

    /// The pixels of a picture that a reference is compared with. Coverage has no derivative here: it is left out, and what is
    /// not compared is as the reference has it.
    fn light(&self, picture: &Image, reference: &[[f32; 4]]) -> Vec<[f32; 4]> {
        let one = |(p, r): (&[f32], &[f32; 4])| match self.compared {
            ComparedPixels::Covered if p[3] < WHOLE || r[3] < WHOLE => [r[0], r[1], r[2], 1.0],
            _ => [p[0], p[1], p[2], 1.0],
        };
        picture.data.chunks_exact(4).zip(reference).map(one).collect()
    }

    /// Loss of one shot, and the gradients of the moving parameters, which are added.
    fn one(
        &self,
        shot: &Shot,
        loss: PictureLoss,
        weight: f64,
        moving: &[bool],
        out: &mut [Vec<f32>],
    ) -> Result<f64, FitError> {
        let (view, size) = (shot.camera.view(), (shot.width, shot.height));
        let seed = |key| hash(self.options.seed, key, shot.number);
        let reference = shot.over_noise().reference;
        self.under(shot, |world| {
            let sampled = (self.options.spp, seed(PICTURE));
            let picture = self.render(world, &view, size, sampled, &self.guidance)?;
            let pixels = self.light(&picture, &reference);
            let mut g = vec![[0.0; 4]; pixels.len()];
            let value = loss.value_and_gradient(size, &pixels, &reference, weight, &mut g);
            let which: Vec<usize> = (0..self.parameters.len()).filter(|k| moving[*k]).collect();
            if which.is_empty() || !value.is_finite() {
                return Ok(value);
            }
            let (width, height) = size;
            let g = Image::from_fn(width, height, 3, |x, y, c| g[y * width + x][c]);
            let places: Vec<Parameter> =
                which.iter().map(|k| self.parameters[*k].parameter.clone()).collect();
            let options = RenderOptions { width, height, ..self.options.clone() };
            let adjoint = Adjoint::new(world, &view, options, &places)?;
            let samples = GradientSamples { spp: self.gradient_spp, seed: Some(seed(GRADIENT)) };
            let gradient = self.guidance.gradient(&adjoint, &g, samples)?;
            self.not_finite.add(gradient.not_finite);
            for (k, found) in which.into_iter().zip(&gradient.parameters) {
                let of = found.first_channels(self.parameters[k].channels());
                let rows = out[k].iter_mut().zip(of.iter()).zip(&self.values[k]);
                match &self.motions[k] {
                    Motion::Values => rows.for_each(|((o, g), _)| *o += *g as f32),
                    Motion::Logarithms(_) => rows.for_each(|((o, g), v)| *o += (*g * f64::from(*v)) as f32),
                    Motion::Correction(c) => {
                        c.apply_vjp(&self.ranges(k), &self.values[k], |i| of[i], &mut out[k]);
                    }
                }
            }
            Ok(value)
        })
    }
}

impl Chain for Traced {
    type Gradients = Vec<Vec<f32>>;

    fn groups(&self) -> Vec<Group> {
        let group = |(k, p): (usize, &TracedParameter)| {
            let (shape, ranges) = self.moving_shape(k);
            Group {
                name: Cow::Owned(p.name.clone()),
                rows: shape.iter().product(),
                columns: p.channels(),
                ranges,
                unit: None,
                rates: Vec::new(),
            }
        };
        self.parameters.iter().enumerate().map(group).collect()
    }

    fn optimizer(&self, group: &Group) -> Result<Optimizer<f32>, FitError> {
        let index = self.parameters.iter().position(|p| p.name == group.name);
        let smoothed = index.filter(|k| self.is_smoothed(*k));
        let filter = smoothed.map(|k| filters::Filter {
            cells: self.moving_shape(k).0,
            levels: self.levels_after(k, self.share),
            is_value: matches!(self.motions[k], Motion::Values),
        });
        optimizer(group, self.smoothing, filter).map_err(FitError::Preconditioner)
    }

    fn phase_share(&mut self, share: f64) -> bool {
        let before = std::mem::replace(&mut self.share, share);
        let narrows = |k| self.levels_after(k, before) != self.levels_after(k, share);
        (0..self.parameters.len()).any(narrows)
    }

    fn values(&self, group: usize) -> &[f32] {
        self.moving(group)
    }

    fn values_mut(&mut self, group: usize) -> &mut [f32] {
        self.moving_mut(group)
    }

    fn changed(&mut self, group: usize) -> Result<(), ModelError> {
        let ranges = self.ranges(group);
        let values = &mut self.values[group];
        match &self.motions[group] {
            Motion::Values => {}
            Motion::Logarithms(logarithms) => {
                values.iter_mut().zip(logarithms).for_each(|(v, l)| *v = l.exp());
            }
            Motion::Correction(c) => c.apply(&ranges, values),
        }
        self.update(group).map_err(|e| ModelError::Picture(Box::new(e.into())))
    }

    fn gradients(&self) -> Self::Gradients {
        (0..self.values.len()).map(|k| vec![0.0; self.moving(k).len()]).collect()
    }

    fn moved<'a>(&'a mut self, gradients: &'a Self::Gradients, group: usize) -> (&'a mut [f32], &'a [f32]) {
        (self.moving_mut(group), &gradients[group])
    }

    fn step(
        &self,
        shots: &[Shot],
        loss: PictureLoss,
        moving: &[bool],
        gradients: &mut Self::Gradients,
    ) -> Result<f64, ModelError> {
        gradients.iter_mut().for_each(|g| g.fill(0.0));
        let weight = 1.0 / shots.len().max(1) as f64;
        let one = |shot| self.one(shot, loss, weight, moving, gradients);
        shots.iter().map(one).sum::<Result<f64, FitError>>().map_err(|e| ModelError::Picture(Box::new(e)))
    }

    fn pictures(&self, shots: &[Shot]) -> Result<Vec<Vec<[f32; 4]>>, ModelError> {
        let one = |shot: &Shot| {
            let seed = hash(self.options.seed, PICTURE, u64::MAX);
            let size = (shot.width, shot.height);
            let picture = self.under(shot, |world| {
                let sampled = (self.evaluation_spp, seed);
                self.render(world, &shot.camera.view(), size, sampled, &Guidance::off())
            });
            picture
                .map(|p| self.light(&p, &shot.over_noise().reference))
                .map_err(|e| ModelError::Picture(Box::new(e)))
        };
        shots.iter().map(one).collect()
    }
}

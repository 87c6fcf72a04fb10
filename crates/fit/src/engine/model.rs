//! Models: what a fit moves. A model owns its parameters, their best state so far and their optimizers, wherever these
//! live; the trainer says when to step, to evaluate and to go back, and reads numbers only when it evaluates.

use super::loss::PictureLoss;
use super::views::Shot;
use crate::FitError;
use photofit_optim::{OptimError, State};
use photofit_raster::deferred::Masks;
use std::borrow::Cow;

/// Name of a group.
pub type GroupName = Cow<'static, str>;

/// A named group of parameters: `rows` x `columns` samples, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// Name, which checkpoints and phases use.
    pub name: GroupName,
    /// Rows: vertices, texels.
    pub rows: usize,
    /// Samples of a row.
    pub columns: usize,
    /// Lowest and highest value of each column; empty: no bounds.
    pub ranges: Vec<[f32; 2]>,
    /// First column of a vector of three that is kept at unit length.
    pub unit: Option<usize>,
    /// Rate of each column relative to the phase's, 0 where it is not fitted; empty: one rate for the whole group.
    pub rates: Vec<f32>,
}

impl Group {
    /// Samples of the group.
    pub fn len(&self) -> usize {
        self.rows * self.columns
    }

    /// Whether it has no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Rates of the columns when that of the phase is `rate`; one entry where the group has one rate.
    pub fn rates_at(&self, rate: f64) -> Vec<f32> {
        let rate = rate as f32;
        if self.rates.is_empty() { vec![rate] } else { self.rates.iter().map(|r| r * rate).collect() }
    }
}

/// Why a model can take no step.
#[derive(Debug)]
pub enum ModelError {
    /// The loss of the step that was asked for is not finite.
    Loss(f64),
    /// An optimizer refused its input.
    Optim {
        /// Which of the steps asked for, counted back from the latest: 0 is that one.
        ago: u64,
        /// What the optimizer says.
        source: OptimError,
    },
    /// The device that the model lives on failed.
    Device(Box<dyn std::error::Error + Send + Sync>),
    /// The present values have no picture or no derivatives.
    Picture(Box<FitError>),
}

/// A group as checkpoints keep it.
#[derive(Debug)]
pub struct Snapshot<'a> {
    /// Present values.
    pub values: Cow<'a, [f32]>,
    /// The best values so far.
    pub best: Cow<'a, [f32]>,
    /// State of the optimizer.
    pub optimizer: Cow<'a, State<f32>>,
}

/// Groups of parameters with a way to pictures and back, that move by gradients.
pub trait Model: Sized {
    /// What the parameters belong to, in main memory: what a task starts from and gets back.
    type Asset;

    /// The groups, always in one order.
    fn groups(&self) -> &[Group];

    /// How alpha masks are drawn in the steps that follow; [`Self::pictures`] cut them.
    fn step_masks(&mut self, _masks: Masks) {}

    /// How much of a phase was made before the steps that follow, 0 to 1: filters may narrow by it.
    ///
    /// # Errors
    /// If a filter cannot be set up.
    fn phase_share(&mut self, _share: f64) -> Result<(), FitError> {
        Ok(())
    }

    /// Takes the loss of a batch against its references (mean over the shots) and moves every group against its gradient
    /// by this rate (0: not at all). Values stay in their ranges.
    ///
    /// # Errors
    /// [`ModelError`]; a model on a device may tell it at a later call.
    fn step(&mut self, shots: &[Shot], loss: PictureLoss, rates: &[f64]) -> Result<(), ModelError>;

    /// The losses of the steps since the last call, oldest first.
    ///
    /// # Errors
    /// [`ModelError`], of one of these steps.
    fn losses(&mut self) -> Result<Vec<f64>, ModelError>;

    /// What the user should know of the steps whose losses were told, each thing once.
    fn notes(&mut self) -> Vec<String> {
        Vec::new()
    }

    /// The pictures of shots: linear RGBA over their backgrounds, the mean over the samples of each pixel.
    ///
    /// # Errors
    /// [`ModelError::Device`], [`ModelError::Picture`].
    fn pictures(&mut self, shots: &[Shot]) -> Result<Vec<Vec<[f32; 4]>>, ModelError>;

    /// The samples of group number `group`.
    ///
    /// # Errors
    /// [`ModelError::Device`].
    fn values(&self, group: usize) -> Result<Cow<'_, [f32]>, ModelError>;

    /// Replaces the samples of a group; its optimizer stays as it is.
    ///
    /// # Errors
    /// [`ModelError::Device`], [`ModelError::Picture`].
    fn set(&mut self, group: usize, values: &[f32]) -> Result<(), ModelError>;

    /// Makes the present values of all groups the best ones; at first the best are those of the start.
    ///
    /// # Errors
    /// [`ModelError::Device`].
    fn keep_best(&mut self) -> Result<(), ModelError>;

    /// Goes back to the best values of a group; its optimizer stays as it is.
    ///
    /// # Errors
    /// [`ModelError::Device`].
    fn go_to_best(&mut self, group: usize) -> Result<(), ModelError>;

    /// Starts the optimizer of a group anew.
    ///
    /// # Errors
    /// If it cannot be set up.
    fn reset_optimizer(&mut self, group: usize) -> Result<(), FitError>;

    /// A group as checkpoints keep it.
    ///
    /// # Errors
    /// [`ModelError::Device`].
    fn snapshot(&self, group: usize) -> Result<Snapshot<'_>, ModelError>;

    /// Goes on from a snapshot of a group.
    ///
    /// # Errors
    /// [`ModelError::Optim`] when the state is not one of this group.
    fn restore(&mut self, group: usize, saved: Snapshot<'_>) -> Result<(), ModelError>;

    /// The asset with the present values.
    ///
    /// # Errors
    /// [`ModelError::Device`].
    fn asset(&mut self) -> Result<&Self::Asset, ModelError>;

    /// The asset with the present values, for good.
    ///
    /// # Errors
    /// [`ModelError::Device`].
    fn into_asset(self) -> Result<Self::Asset, ModelError>;
}

//! Models in main memory: any chain of stages from parameters to a loss and back, moved by the optimizers of `optim`.

use super::loss::PictureLoss;
use super::model::{Group, Model, ModelError, Snapshot};
use super::views::Shot;
use crate::FitError;
use photofit_optim::{OptimError, Optimizer, Rows, clamp_channels, normalize_vectors};
use photofit_raster::deferred::Masks;
use std::borrow::Cow;

/// Parameters in main memory with a way to pictures and back.
pub trait Chain {
    /// Gradients of all groups, with room for the work.
    type Gradients;

    /// The groups, always in one order.
    fn groups(&self) -> Vec<Group>;

    /// A fresh optimizer for a group, its filters included.
    ///
    /// # Errors
    /// If a filter cannot be set up.
    fn optimizer(&self, group: &Group) -> Result<Optimizer<f32>, FitError>;

    /// How alpha masks are drawn in the steps that follow, where there are some; see [`Model::step_masks`].
    fn step_masks(&mut self, _masks: Masks) {}

    /// How much of a phase was made, 0 to 1; true where optimizers have other filters from here on.
    fn phase_share(&mut self, _share: f64) -> bool {
        false
    }

    /// What the filters of a group's optimizer are guided by, such as vertex normals; empty where they need nothing.
    fn guide(&self, _group: usize) -> Vec<f32> {
        Vec::new()
    }

    /// The samples of group number `group`.
    fn values(&self, group: usize) -> &[f32];

    /// The same, to be changed; [`Self::changed`] follows.
    fn values_mut(&mut self, group: usize) -> &mut [f32];

    /// Brings up to date what follows from the samples of a group (mip levels).
    ///
    /// # Errors
    /// [`ModelError::Picture`] where the samples are not valid.
    fn changed(&mut self, group: usize) -> Result<(), ModelError>;

    /// Zero gradients.
    fn gradients(&self) -> Self::Gradients;

    /// The samples of group number `group`, to be changed, and their gradients.
    fn moved<'a>(&'a mut self, gradients: &'a Self::Gradients, group: usize) -> (&'a mut [f32], &'a [f32]);

    /// Loss of a batch against its references (mean over the shots) and its gradients, which are overwritten. `moving`
    /// says which groups need theirs.
    ///
    /// # Errors
    /// [`ModelError::Picture`].
    fn step(
        &self,
        shots: &[Shot],
        loss: PictureLoss,
        moving: &[bool],
        gradients: &mut Self::Gradients,
    ) -> Result<f64, ModelError>;

    /// The pictures of shots: linear RGBA over their backgrounds, the mean over the samples of each pixel.
    ///
    /// # Errors
    /// [`ModelError::Picture`].
    fn pictures(&self, shots: &[Shot]) -> Result<Vec<Vec<[f32; 4]>>, ModelError>;
}

/// A chain with its gradients, optimizers and best values.
#[derive(Debug)]
pub struct Cpu<C: Chain> {
    chain: C,
    groups: Vec<Group>,
    gradients: C::Gradients,
    optimizers: Vec<Optimizer<f32>>,
    best: Vec<Vec<f32>>,
    losses: Vec<f64>,
}

impl<C: Chain> Cpu<C> {
    /// A chain at its start.
    ///
    /// # Errors
    /// If an optimizer cannot be set up.
    pub fn new(chain: C) -> Result<Self, FitError> {
        let groups = chain.groups();
        Ok(Self {
            gradients: chain.gradients(),
            optimizers: groups.iter().map(|g| chain.optimizer(g)).collect::<Result<_, _>>()?,
            best: (0..groups.len()).map(|g| chain.values(g).to_vec()).collect(),
            losses: Vec::new(),
            groups,
            chain,
        })
    }
}

impl<C: Chain> Model for Cpu<C> {
    type Asset = C;

    fn groups(&self) -> &[Group] {
        &self.groups
    }

    fn step_masks(&mut self, masks: Masks) {
        self.chain.step_masks(masks);
    }

    fn phase_share(&mut self, share: f64) -> Result<(), FitError> {
        if self.chain.phase_share(share) {
            for (optimizer, group) in self.optimizers.iter_mut().zip(&self.groups) {
                let mut made = self.chain.optimizer(group)?;
                made.restore(optimizer.state().clone()).map_err(FitError::Preconditioner)?;
                *optimizer = made;
            }
        }
        Ok(())
    }

    fn step(&mut self, shots: &[Shot], loss: PictureLoss, rates: &[f64]) -> Result<(), ModelError> {
        let moving: Vec<bool> = rates.iter().map(|r| *r > 0.0).collect();
        let value = self.chain.step(shots, loss, &moving, &mut self.gradients)?;
        if !value.is_finite() {
            return Err(ModelError::Loss(value));
        }
        self.losses.push(value);
        for (k, group) in self.groups.iter().enumerate().filter(|(k, _)| moving[*k]) {
            let guide = self.chain.guide(k);
            let (x, g) = self.chain.moved(&self.gradients, k);
            let rates = group.rates_at(rates[k]);
            let moved = match rates[..] {
                [rate] if group.rates.is_empty() => self.optimizers[k].step_guided(x, g, rate, &guide),
                _ if guide.is_empty() => {
                    self.optimizers[k].step_rows(x, g, &Rows { rates: &rates, touched: None })
                }
                _ => Err(OptimError::Combination {
                    group: group.name.to_string(),
                    what: "rates of columns",
                    with: "filters that are guided",
                }),
            };
            moved.map_err(|source| ModelError::Optim { ago: 0, source })?;
            if !group.ranges.is_empty() {
                clamp_channels(x, &group.ranges);
            }
            if let Some(at) = group.unit {
                normalize_vectors(x, group.columns, at);
            }
            self.chain.changed(k)?;
        }
        Ok(())
    }

    fn losses(&mut self) -> Result<Vec<f64>, ModelError> {
        Ok(std::mem::take(&mut self.losses))
    }

    fn pictures(&mut self, shots: &[Shot]) -> Result<Vec<Vec<[f32; 4]>>, ModelError> {
        self.chain.pictures(shots)
    }

    fn values(&self, group: usize) -> Result<Cow<'_, [f32]>, ModelError> {
        Ok(self.chain.values(group).into())
    }

    fn set(&mut self, group: usize, values: &[f32]) -> Result<(), ModelError> {
        self.chain.values_mut(group).copy_from_slice(values);
        self.chain.changed(group)
    }

    fn keep_best(&mut self) -> Result<(), ModelError> {
        for (k, best) in self.best.iter_mut().enumerate() {
            best.copy_from_slice(self.chain.values(k));
        }
        Ok(())
    }

    fn go_to_best(&mut self, group: usize) -> Result<(), ModelError> {
        self.chain.values_mut(group).copy_from_slice(&self.best[group]);
        self.chain.changed(group)
    }

    fn reset_optimizer(&mut self, group: usize) -> Result<(), FitError> {
        self.optimizers[group] = self.chain.optimizer(&self.groups[group])?;
        Ok(())
    }

    fn snapshot(&self, group: usize) -> Result<Snapshot<'_>, ModelError> {
        Ok(Snapshot {
            values: self.chain.values(group).into(),
            best: self.best[group][..].into(),
            optimizer: Cow::Borrowed(self.optimizers[group].state()),
        })
    }

    fn restore(&mut self, group: usize, saved: Snapshot<'_>) -> Result<(), ModelError> {
        let restored = self.optimizers[group].restore(saved.optimizer.into_owned());
        restored.map_err(|source| ModelError::Optim { ago: 0, source })?;
        self.set(group, &saved.values)?;
        self.best[group] = saved.best.into_owned();
        Ok(())
    }

    fn asset(&mut self) -> Result<&C, ModelError> {
        Ok(&self.chain)
    }

    fn into_asset(self) -> Result<C, ModelError> {
        Ok(self.chain)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_optim::Temporal;

    /// Two numbers with rates of their own, whose optimizer is guided.
    struct Guided([f32; 2]);

    impl Chain for Guided {
        type Gradients = [f32; 2];

        fn groups(&self) -> Vec<Group> {
            let (ranges, rates) = (Vec::new(), vec![1.0, 0.5]);
            vec![Group { name: "pair".into(), rows: 1, columns: 2, ranges, unit: None, rates }]
        }

        fn optimizer(&self, _: &Group) -> Result<Optimizer<f32>, FitError> {
            Optimizer::new("pair", 2, Temporal::adam()).map_err(FitError::Preconditioner)
        }

        fn guide(&self, _: usize) -> Vec<f32> {
            vec![0.0; 6]
        }

        fn values(&self, _: usize) -> &[f32] {
            &self.0
        }

        fn values_mut(&mut self, _: usize) -> &mut [f32] {
            &mut self.0
        }

        fn changed(&mut self, _: usize) -> Result<(), ModelError> {
            Ok(())
        }

        fn gradients(&self) -> [f32; 2] {
            [1.0; 2]
        }

        fn moved<'a>(&'a mut self, gradients: &'a [f32; 2], _: usize) -> (&'a mut [f32], &'a [f32]) {
            (&mut self.0, gradients)
        }

        fn step(&self, _: &[Shot], _: PictureLoss, _: &[bool], _: &mut [f32; 2]) -> Result<f64, ModelError> {
            Ok(1.0)
        }

        fn pictures(&self, _: &[Shot]) -> Result<Vec<Vec<[f32; 4]>>, ModelError> {
            Ok(Vec::new())
        }
    }

    #[test]
    fn a_guide_is_never_dropped() {
        let mut model = Cpu::new(Guided([0.0; 2])).unwrap();
        let step = model.step(&[], PictureLoss::RELATIVE_SQUARES, &[0.1]);
        let Err(ModelError::Optim { source, .. }) = step else { panic!("taken: {step:?}") };
        assert!(source.to_string().contains("rates of columns"), "{source}");
        assert_eq!(model.chain.0, [0.0; 2]);
    }
}

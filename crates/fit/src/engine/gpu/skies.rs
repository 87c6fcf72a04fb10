//! The environments that light pictures on a device, each uploaded once.

use crate::engine::views::{ViewLight, ViewLights};
use photofit_gpu::{Gpu, GpuError};
use photofit_shading::Environment;
use photofit_shading::gpu::ShadingTables;
use std::sync::Arc;

/// The environments of the views so far, with the tables of shading.
#[derive(Debug)]
pub(crate) struct Skies {
    environments: Vec<Arc<Environment>>,
    /// Tables and environments.
    pub(crate) tables: ShadingTables,
}

impl Skies {
    /// Without environments.
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self { environments: Vec::new(), tables: ShadingTables::new(gpu, &[])? })
    }

    /// Uploads the environments of views that are not there yet; whether there were any.
    pub(crate) fn add<'l>(
        &mut self,
        gpu: &Gpu,
        views: impl IntoIterator<Item = &'l ViewLights>,
    ) -> Result<bool, GpuError> {
        let mut environments = self.environments.clone();
        for light in views.into_iter().flat_map(|l| &l.0) {
            if let ViewLight::Environment { map, .. } = light
                && !environments.iter().any(|e| Arc::ptr_eq(e, map))
            {
                environments.push(map.clone());
            }
        }
        let new = environments.len() > self.environments.len();
        if new {
            // Where there is no room for the tables, those before still belong to their list.
            let all: Vec<&Environment> = environments.iter().map(|e| &**e).collect();
            self.tables = ShadingTables::new(gpu, &all)?;
            self.environments = environments;
        }
        Ok(new)
    }

    /// Which of the environments a map is, for the tables.
    pub(crate) fn number(&self, map: &Environment) -> usize {
        // `add` has seen every environment that is drawn.
        self.environments.iter().position(|e| std::ptr::eq(&**e, map)).unwrap_or(0)
    }
}

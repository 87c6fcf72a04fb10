//! The light of `--light` and `--env`.

use crate::args::{FitLight, FitLighting};
use anyhow::{Result, anyhow};
use photofit_fit::views::Lighting;
use photofit_scene::load_environment;
use photofit_shading::Environment;
use std::path::Path;
use std::sync::Arc;

/// Radiance that a white diffuse sphere shows on average.
pub(crate) const MEAN: f32 = 0.7;

/// Loads an equirectangular environment and scales it to a mean of [`MEAN`].
///
/// # Errors
/// If the file is no such image.
pub(crate) fn environment(path: &Path) -> Result<Arc<Environment>> {
    let image = load_environment(path)?;
    let map = Environment::from_equirectangular(image.width, image.height, &image.data)
        .map_err(|e| anyhow!("{}: {e}", path.display()))?;
    Ok(Arc::new(map.normalised(MEAN)))
}

/// The light of a fit.
///
/// # Errors
/// If the file is no environment.
pub(crate) fn lighting(asked: &FitLighting) -> Result<Lighting> {
    Ok(match (asked.light, &asked.env) {
        (FitLight::Env, Some(file)) => Lighting::Environment(environment(file)?),
        (FitLight::Point, _) => Lighting::Point,
        _ => Lighting::Mixed,
    })
}

//! Animations that the command line names.

use anyhow::{Result, anyhow};
use photofit_scene::Scene;
use std::path::Path;

/// The index of an animation that is named, or given by its number.
///
/// # Errors
/// If the asset of this file has none such.
pub(crate) fn index(file: &Path, scene: &Scene, wanted: &str) -> Result<usize> {
    let animations = scene.hierarchy.as_deref().map_or(&[][..], |h| &h.animations);
    let named = animations.iter().position(|n| n.name == wanted);
    let number = || wanted.parse().ok().filter(|n: &usize| *n < animations.len());
    named.or_else(number).ok_or_else(|| {
        let names: Vec<String> = animations.iter().map(|n| format!("\"{}\"", n.name)).collect();
        let file = file.display();
        match names.len() {
            0 => anyhow!("{file}: has no animations, and --animation must not be given"),
            n => {
                let names = names.join(", ");
                anyhow!(
                    "{file}: has {n} animations: {names}; --animation is \"{wanted}\", it must be one of them"
                )
            }
        }
    })
}

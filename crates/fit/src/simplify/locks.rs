//! Vertices that stay where they are, to the bit: those on open borders, where parts of a larger asset meet, and those that an
//! attribute of the asset marks.

use super::{Normalised, SimplifyOptions, options};
use crate::engine::asset::bits;
use crate::{FitError, Progress};
use photofit_geometry::Mesh;
use photofit_geometry::decimate::{Decimated, Options};
use photofit_scalar::Vec3f;
use photofit_scene::Scene;
use std::collections::{BTreeSet, HashMap, HashSet};

impl SimplifyOptions {
    /// Whether any vertex stays where it is.
    pub(super) fn locks(&self) -> bool {
        self.lock_borders || self.lock.is_some()
    }
}

/// The rule that whoever locks vertices must keep.
pub(super) fn rule(options: &SimplifyOptions, holds: bool, must: &str) -> Result<(), FitError> {
    match &options.lock {
        Some(name) => options::rule("lock", name, holds, must),
        None => options::rule("lock_borders", options.lock_borders, holds || !options.lock_borders, must),
    }
}

/// Refuses a name that no attribute of the asset has; warns where it marks no vertex.
pub(crate) fn check(
    scene: &Scene,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<(), FitError> {
    let Some(name) = &options.lock else { return Ok(()) };
    let mut of = scene.vertex_attributes.iter().filter(|a| a.name.eq_ignore_ascii_case(name)).peekable();
    if of.peek().is_none() {
        let read = scene.vertex_attributes.iter().map(|a| a.name.as_str());
        let there: BTreeSet<&str> =
            read.chain(scene.ignored_attributes.iter().filter_map(|name| name.strip_prefix('_'))).collect();
        let has = match there.len() {
            0 => "the asset has none".to_owned(),
            _ => format!("the asset has {}", there.into_iter().take(8).collect::<Vec<_>>().join(", ")),
        };
        let rule =
            format!("is {name:?}; it must be an attribute of one number per vertex (_NAME in glTF): {has}");
        return Err(FitError::Setting { field: "lock", rule });
    }
    if !of.any(|a| a.values.iter().any(|x| *x > 0.5)) {
        progress.warn(&format!("no vertex is locked: the attribute {name:?} is above one half nowhere"));
    }
    Ok(())
}

/// `how`, with the vertices of `mesh` locked that the options name.
pub(super) fn locking(how: Options, mesh: &Mesh, n: &Normalised, options: &SimplifyOptions) -> Options {
    let marked = options.lock.as_deref().and_then(|name| n.marked(name));
    let locked = marked.map(|set| mesh.positions.iter().map(|p| set.contains(&bits(*p))).collect());
    Options { lock_border: options.lock_borders, locked: locked.unwrap_or_default(), ..how }
}

/// The positions that a decimation has locked.
pub(super) fn locked(d: &Decimated) -> HashSet<[u32; 3]> {
    d.mesh.positions.iter().zip(&d.locked).filter(|(_, locked)| **locked).map(|(p, _)| bits(*p)).collect()
}

/// Gives the vertices of a light asset that did not move the positions of the asset: the way to the frame of the fit and back
/// rounds them.
pub(super) fn restore(light: &mut Scene, scene: &Scene, n: &Normalised) {
    let own = scene.flatten().mesh.positions;
    let back = |p: &Vec3f| bits(n.frame().to_world(*p));
    let mut exact: HashMap<[u32; 3], Vec3f> =
        n.flat.mesh.positions.iter().map(back).zip(own.iter().copied()).collect();
    // Where vertices round to one, what is marked is meant.
    let marked = n.flat.mesh.positions.iter().zip(own).filter(|(p, _)| n.is_marked(**p));
    exact.extend(marked.map(|(p, own)| (back(p), own)));
    for p in light.primitives.iter_mut().flat_map(|p| &mut p.mesh.positions) {
        *p = exact.get(&bits(*p)).copied().unwrap_or(*p);
    }
}

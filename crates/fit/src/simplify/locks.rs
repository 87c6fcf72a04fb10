//! Vertices that stay where they are, to the bit: those on open borders, where parts of a larger asset meet, and those that an
//! attribute of the asset marks.

use super::{Normalised, SimplifyOptions, options};
use crate::FitError;
use crate::engine::asset::bits;
use photofit_geometry::Mesh;
use photofit_geometry::decimate::{Decimated, Options};
use photofit_scalar::Vec3f;
use photofit_scene::Scene;
use std::collections::{HashMap, HashSet};

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

/// Refuses a name that no attribute of the asset has.
pub(super) fn check(n: &Normalised, options: &SimplifyOptions) -> Result<(), FitError> {
    let Some(name) = options.lock.as_deref().filter(|name| n.marked(name).is_none()) else { return Ok(()) };
    let has = match n.marks().as_slice() {
        [] => "the asset's vertices have none".to_owned(),
        names => format!("it must be one of {}", names.join(", ")),
    };
    let rule = format!("is {name:?}, no attribute of one number per vertex (_NAME in glTF); {has}");
    Err(FitError::Setting { field: "lock", rule })
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
    let exact: HashMap<[u32; 3], Vec3f> = n.flat.mesh.positions.iter().map(back).zip(own).collect();
    for p in light.primitives.iter_mut().flat_map(|p| &mut p.mesh.positions) {
        *p = exact.get(&bits(*p)).copied().unwrap_or(*p);
    }
}

//! The backs of single-sided surfaces, where cameras see them: glTF leaves them out, path tracers and viewers that know no
//! sides draw them. A light asset is fitted to views of both kinds, so that it suits renderers of both kinds.

use super::SimplifyOptions;
use crate::FitError;
use crate::engine::Normalised;
use crate::engine::reference::{Rasterized, Reference, ReferenceKind};
use crate::engine::views::{Lighting, Moment, Orbit, Set, Setup, Views};
use photofit_shading::Sides;

/// Share of the views of a fit that show backs, where they are seen.
const SHARE: f32 = 0.25;
/// Share of an asset's pixels that backs change, from which on they are seen.
const NOTICED: f64 = 1e-3;
/// Views in which that is measured, and the side of their pictures.
const VIEWS: u64 = 12;
const SIZE: usize = 128;
/// Difference of a sample that counts.
const DIFFERENCE: f32 = 1.0 / 64.0;

/// What backs do to pictures of an asset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Backs {
    /// Share of its pixels that they change, in [0, 1], where that is measured.
    pub(super) seen: Option<f64>,
    /// Share of the views of the fit that show them, in [0, 1].
    pub(super) share: f32,
}

impl Backs {
    /// What they do to the fit of an asset to pictures of a kind, which may show fronts alone.
    pub(super) fn of(n: &Normalised, kind: ReferenceKind, steps: u64) -> Result<Self, FitError> {
        if steps == 0 || !kind.draws_backs {
            return Ok(Self { seen: None, share: 0.0 });
        }
        let single = n.used_classes().iter().any(|c| c.sides == Sides::Front);
        let seen = if single { seen(n)? } else { 0.0 };
        Ok(Self { seen: Some(seen), share: if seen >= NOTICED { SHARE } else { 0.0 } })
    }
}

/// The views of a fit at a moment, of which a share shows backs where these are seen.
pub(super) fn views(
    n: &Normalised,
    reference: &dyn Reference,
    moment: Moment,
    options: &SimplifyOptions,
) -> Result<(Orbit, Backs), FitError> {
    let backs = Backs::of(n, reference.kind(), options.steps)?;
    let (bounds, orbit) = (reference.bounds(moment), options.orbit(options.picture_size()));
    Ok((Orbit { bounds, moment, backs: backs.share, ..orbit }, backs))
}

/// Share of the pixels of an asset that are others once backs are drawn.
fn seen(n: &Normalised) -> Result<f64, FitError> {
    let reference = Rasterized::new(&n.flat, &n.library).sampled(1);
    let views = Orbit::new(0, &Lighting::Point, SIZE);
    let (mut changed, mut covered) = (0_usize, 0_usize);
    for k in 0..VIEWS {
        let fronts = views.setup(Set::HeldOut, k, VIEWS);
        let all = Setup { backs: true, ..fronts.clone() };
        let [fronts, all] = [reference.picture(&fronts)?.image, reference.picture(&all)?.image];
        for (a, b) in fronts.data.chunks_exact(4).zip(all.data.chunks_exact(4)) {
            let is_there = a[3] > 0.0 || b[3] > 0.0;
            covered += usize::from(is_there);
            changed += usize::from(is_there && a.iter().zip(b).any(|(a, b)| (a - b).abs() > DIFFERENCE));
        }
    }
    Ok(changed as f64 / covered.max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::super::tests::of;
    use super::*;
    use photofit_geometry::{Mesh, shapes};
    use photofit_scene::Material;

    #[test]
    fn backs_are_seen_of_open_single_sided_surfaces_alone() {
        let backs = |mesh: Mesh, double_sided, kind, steps| {
            let scene = of(mesh, Material { double_sided, ..Material::clay() });
            Backs::of(&Normalised::new(&scene).unwrap(), kind, steps).unwrap()
        };
        let (raster, traced) = (ReferenceKind::RASTERIZED, ReferenceKind::path_traced(1));
        let none = Backs { seen: Some(0.0), share: 0.0 };
        assert_eq!(backs(shapes::icosphere(8), false, raster, 9), none);
        // From half of all directions the back of a sheet is seen.
        let sheet = || shapes::quad_grid(4, 4);
        let Backs { seen, share } = backs(sheet(), false, raster, 9);
        assert!(
            seen.is_some_and(|s| (0.35..0.65).contains(&s)) && (share - SHARE).abs() < 1e-6,
            "{seen:?} {share}"
        );
        assert_eq!(backs(sheet(), true, raster, 9), none);
        // Whatever the pictures are called, what they show counts.
        let other = ReferenceKind { name: "of another kind", ..raster };
        assert_eq!(backs(sheet(), false, other, 9), Backs { seen, share });
        let unknown = Backs { seen: None, share: 0.0 };
        assert_eq!(backs(sheet(), false, traced, 9), unknown);
        assert_eq!(backs(sheet(), false, raster, 0), unknown);
    }
}

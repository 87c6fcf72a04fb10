//! The filters of the steps of textures and grids that are fitted through the path tracer.

use crate::engine::model::Group;
use photofit_optim::{
    Bilateral, Grid, GridBilateral, GuideMap, OptimError, Optimizer, Placement, ScreenedPoisson, Sigma,
    Temporal,
};
use photofit_pathtrace::Parameter;

/// Most levels of the bilateral filter: those that average in the code of Belhe et al. (2025), of five; its taps are wider.
const LEVELS: u32 = 4;
/// Smoothness of the Laplacian filter: as wide as three levels of the bilateral one.
const LAPLACIAN: f64 = 10.5;
/// Decays of the moments: a short memory of the first keeps rates large while gradients of few samples are averaged over space.
const BETAS: [f64; 2] = [0.2, 0.999];
/// Width of the bilateral filter in values, in units of their spread.
const WIDTH: f64 = 2.0;
/// How messages call what [`rule`] says.
pub(crate) const RULED: &str = "rule of the filters of steps";

/// What checkpoints say of all filters: with other levels, widths or decays a fit is another one.
pub(crate) fn rule() -> String {
    format!("{LEVELS} levels by size, width {WIDTH}, of moments; {LAPLACIAN} of gradients; {BETAS:?}")
}

/// What steps of textures and grids are smoothed by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Smoothing {
    /// Nothing: Adam.
    None,
    /// Gradients by a low-pass filter.
    Laplacian,
    /// Both moments, of grids in space gradients, too, by a filter that keeps the edges of the values as they are so far.
    Bilateral,
    /// The same, but of textures the filter loses a level after equal parts of a phase and is gone in the last: finds patterns narrower
    /// than the filter, which would stay even, and leaves more noise of others.
    #[default]
    Narrowing,
}

impl Smoothing {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::None, Self::Laplacian, Self::Bilateral, Self::Narrowing];

    /// What it does, in one sentence for people.
    pub fn about(self) -> &'static str {
        match self {
            Self::None => "Nothing: Adam alone",
            Self::Laplacian => "A low-pass filter of gradients",
            Self::Bilateral => "A filter of both moments that keeps the edges of the texture as it is so far",
            Self::Narrowing => {
                "The same, which of textures narrows over the steps until it is gone: finds patterns narrower than the filter, leaves \
                 more noise of others"
            }
        }
    }

    /// Its name, as users ask for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "adam",
            Self::Laplacian => "laplacian",
            Self::Bilateral => "bilateral",
            Self::Narrowing => "narrowing",
        }
    }
}

/// Levels of the filter of these slices, rows and columns of what moves, by the longest side, of an environment by its rows: one for
/// 16, one more for each doubling, at most four of textures and environments and three of grids in space. Wider ones would
/// smooth over what they hold.
pub(super) fn levels(parameter: &Parameter, [depth, height, width]: [usize; 3]) -> u32 {
    let side =
        if matches!(parameter, Parameter::Environment) { height } else { depth.max(height).max(width) };
    let most = if depth > 1 { LEVELS - 1 } else { LEVELS };
    side.max(1).ilog2().saturating_sub(3).min(most)
}

/// The levels that are left of so many after a share of a phase: each, and none at last, has an equal part of it.
pub(super) fn narrowed(all: u32, share: f64) -> u32 {
    all - (share.clamp(0.0, 1.0) * f64::from(all + 1)).min(f64::from(all)) as u32
}

/// What a filter is of.
pub(super) struct Filter {
    /// Slices, rows and columns of what moves.
    pub(super) cells: [usize; 3],
    /// Levels that the bilateral filter has at present.
    pub(super) levels: u32,
    /// Whether the values themselves move.
    pub(super) is_value: bool,
}

/// The optimizer of a group, with its filter if it has one.
pub(super) fn optimizer(
    group: &Group,
    smoothing: Smoothing,
    filter: Option<Filter>,
) -> Result<Optimizer<f32>, OptimError> {
    let adam = Temporal::adam().betas(BETAS[0], BETAS[1]);
    let start = |temporal| Optimizer::new(&group.name, group.len(), temporal);
    let Some(Filter { cells: [depth, height, width], levels, is_value }) = filter else {
        return start(adam);
    };
    let grid = Grid::volume(width, height, depth);
    // Grids in space are found better where gradients and moments are averaged, with a long memory of squares; others where
    // both moments are, with the decay of squares that belongs to it (Belhe et al. 2025). It stays so when the last level is
    // gone: a sum of squares of one decay has no meaning for another.
    let (temporal, placement) = match depth {
        1 => (adam.paired(adam.beta1), Placement::POST),
        _ => (adam, Placement::BOTH),
    };
    match (smoothing, levels) {
        (Smoothing::None, _) => start(adam),
        (Smoothing::Bilateral | Smoothing::Narrowing, 0) => start(temporal),
        (Smoothing::Laplacian, _) => {
            let filter = ScreenedPoisson::new(&group.name, grid, LAPLACIAN)?;
            start(adam)?.with_filter(Placement::PRE, filter)
        }
        (Smoothing::Bilateral | Smoothing::Narrowing, levels) => {
            let map = if is_value { GuideMap::Log } else { GuideMap::Linear };
            let settings = Bilateral { levels, map, sigma: Sigma::Auto(WIDTH), ..Bilateral::default() };
            let filter = GridBilateral::new(&group.name, grid, group.columns, settings)?;
            start(temporal)?.with_filter(placement, filter)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_of_filters_follow_from_the_size() {
        let texture = Parameter::Graph { places: vec![[0, 0]] };
        let of = |shape| levels(&texture, shape);
        let of_textures = [[1, 15, 15], [1, 16, 16], [1, 1, 64], [1, 128, 40], [1, 4096, 4096]].map(of);
        assert_eq!(of_textures, [0, 1, 3, 4, 4]);
        assert_eq!([[8, 8, 8], [16, 16, 16], [9, 40, 9], [256, 256, 256]].map(of), [0, 1, 2, 3]);
        let of_skies =
            [[1, 8, 16], [1, 16, 4096], [1, 256, 512]].map(|shape| levels(&Parameter::Environment, shape));
        assert_eq!(of_skies, [0, 1, 4]);
    }

    #[test]
    fn levels_are_lost_one_by_one() {
        let left: Vec<u32> = (0..10).map(|k| narrowed(4, (f64::from(k) + 0.5) / 10.0)).collect();
        assert_eq!(left, [4, 4, 3, 3, 2, 2, 1, 1, 0, 0]);
        assert_eq!([0.0, 0.49, 0.5, 1.0].map(|share| narrowed(1, share)), [1, 1, 0, 0]);
        assert_eq!(narrowed(0, 0.3), 0);
    }

    #[test]
    fn textures_of_scenes_narrow_and_other_fits_stay() {
        use crate::{recover_material::RecoverMaterialOptions, recover_volume::RecoverVolumeOptions};
        assert_eq!(Smoothing::default(), Smoothing::Narrowing);
        assert_eq!(RecoverVolumeOptions::default().smoothing, Smoothing::Bilateral);
        assert_eq!(RecoverMaterialOptions::default().smoothing, Smoothing::Laplacian);
    }
}

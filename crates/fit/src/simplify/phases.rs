//! The phases of the fit, coarse to fine.

use super::{Mips, SimplifyOptions};
use crate::engine::surface::{
    POSITIONS, Surface, fade_over, group_of_level, rate_of_maps, rate_of_positions,
};
use crate::engine::trainer::{self, Phase};

/// Rate of the positions in the last phase, relative to the first.
const LAST_POSITION_RATE: f64 = 0.4;

/// Coarse to fine: half resolution (all sizes where mip levels are free), then, with maps baked anew on the moved shape, full
/// resolution. The maps have `levels` groups.
pub(super) fn phases<'a>(
    options: &SimplifyOptions,
    (distance, fades): (f64, bool),
    (start_psnr, levels): (f64, usize),
    rebake: trainer::Initialiser<'a, Surface>,
) -> Vec<Phase<'a, Surface>> {
    let n = options.steps;
    let a = n * 4 / 10;
    let share = a as f32 / n.max(1) as f32;
    let rate = rate_of_positions(distance);
    let map_rate = rate_of_maps(start_psnr);
    let maps = || (0..levels).map(group_of_level);
    let rates = |positions: f64| {
        let moving = std::iter::once((POSITIONS.into(), positions));
        moving.chain(maps().map(|level| (level, map_rate))).collect()
    };
    let halved = options.resolution.is_multiple_of(2) && options.resolution >= 256;
    let shrink = if halved && options.mips == Mips::Classic { 2 } else { 1 };
    let coarse = Phase {
        name: "coarse",
        first: 0,
        steps: a,
        shrink,
        rates: rates(rate),
        fade: fade_over(fades, [0.0, share]),
        reinitialised: None,
    };
    let fine = Phase {
        name: "fine",
        first: a,
        steps: n - a,
        shrink: 1,
        rates: rates(LAST_POSITION_RATE * rate),
        fade: fade_over(fades, [share, 1.0]),
        reinitialised: Some((maps().collect(), rebake)),
    };
    vec![coarse, fine]
}

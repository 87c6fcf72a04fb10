//! How much is seen when one level of detail takes the place of another.

use super::{Stage, view_quality};
use crate::FitError;
use crate::engine::LightAsset;
use crate::engine::reference::Reference as _;
use crate::engine::views::{Lighting, Orbit, Set, Views as _};

/// Views in which neighbouring levels of detail are compared.
const POPPING_VIEWS: u64 = 16;

/// What a viewer sees when one level of detail takes the place of another.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Popping {
    /// Mean FLIP over the foreground.
    pub flip: f64,
    /// Share of the pixels that either covers, in [0, 1], that one of the two alone covers: how much the outline jumps.
    pub outline: f64,
}

/// The change between two stages as an engine shows them, with one sample a pixel, in pictures of `size` pixels a side.
///
/// # Errors
/// If a picture cannot be made.
pub fn popping(
    light: &LightAsset,
    stages: [&Stage; 2],
    lighting: &Lighting,
    size: usize,
    seed: u64,
) -> Result<Popping, FitError> {
    let [a, b] = stages.map(|s| s.drawn(light));
    let [a, b] = [&a, &b].map(|d| d.sampled(1));
    let orbit = Orbit::new(seed, lighting, size);
    let (mut flip, mut changed, mut covered) = (0.0, 0.0, 0.0);
    for i in 0..POPPING_VIEWS {
        let s = orbit.setup(Set::Report, i, POPPING_VIEWS);
        let (a, b) = (a.picture(&s)?.image, b.picture(&s)?.image);
        flip += view_quality(&a, &b).quality.flip;
        for (a, b) in a.data.chunks_exact(4).zip(b.data.chunks_exact(4)) {
            let (a, b) = (f64::from(a[3]), f64::from(b[3]));
            changed += (a - b).abs();
            covered += a.max(b);
        }
    }
    let outline = if covered > 0.0 { changed / covered } else { 0.0 };
    Ok(Popping { flip: flip / POPPING_VIEWS as f64, outline })
}

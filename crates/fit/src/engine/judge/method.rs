//! Who draws the pictures of a judgement, and why.

use super::{JudgeRenderer, Judged};
use crate::engine::reference::ReferenceKind;
use std::collections::BTreeSet;

/// How pictures of an asset and of what is compared with it are made, and why, where `renderer` is asked for, the fit
/// compared with pictures of the kind `reference`, and the rasterizer lacks `beyond` of the materials.
pub(crate) fn method(
    renderer: JudgeRenderer,
    reference: ReferenceKind,
    beyond: &BTreeSet<&'static str>,
) -> (Judged, String) {
    let names = || beyond.iter().copied().collect::<Vec<_>>().join(", ");
    let not_drawn = || if beyond.is_empty() { String::new() } else { format!("; not drawn: {}", names()) };
    match renderer {
        JudgeRenderer::Path if reference.indirect_light => {
            (Judged::PathTraced, "as asked; shadows that fitted maps hold count twice".into())
        }
        JudgeRenderer::Path => (Judged::PathTraced, "as asked".into()),
        JudgeRenderer::Raster => (Judged::Rasterized, format!("as asked{}", not_drawn())),
        // The maps of what is fitted to shadows hold them.
        JudgeRenderer::Auto if reference.indirect_light => {
            let why = "pictures of the asset alone are, as in the fit: fitted maps hold their shadows";
            (Judged::RasterizedAgainst(reference), format!("{why}{}", not_drawn()))
        }
        JudgeRenderer::Auto if !beyond.is_empty() => {
            (Judged::PathTraced, format!("the rasterizer does not draw {}", names()))
        }
        JudgeRenderer::Auto => (Judged::Rasterized, "the rasterizer draws all materials".into()),
    }
}

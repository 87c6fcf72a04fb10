//! How the result is judged, and what that costs.

use crate::engine::judge::JudgeRenderer;
use crate::engine::plan::Item;
use crate::engine::reference::ReferenceKind;

/// Who draws the pictures of a judgement, why, and how many there are.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// All pictures are path traced.
    pub traced: bool,
    /// What the options ask for.
    pub renderer: JudgeRenderer,
    /// What pictures of the asset are in the fit.
    pub reference: ReferenceKind,
    /// A fit of the maps through the path tracer is asked for.
    pub traced_maps: bool,
    /// What of the asset's materials the rasterizer lacks.
    pub beyond: Vec<&'static str>,
    /// Pictures of all views, of the asset and of what is compared with it, at most.
    pub pictures: u64,
    /// Width and height of each where it is path traced, pixels.
    pub side: usize,
    /// Samples of a path traced pixel.
    pub spp: u32,
}

impl Judgement {
    /// Whether the path tracer draws, and why, with the samples that it takes at most.
    pub fn item(&self) -> Item {
        let Self { pictures, side, spp, .. } = self;
        let names = self.beyond.join(", ");
        let shadows = self.reference.indirect_light;
        let million = (pictures * (side * side) as u64 * u64::from(*spp)) as f64 / 1e6;
        let why = match (self.traced, self.renderer) {
            (true, JudgeRenderer::Path) if shadows => {
                "as asked; shadows that the fitted maps hold count twice".to_owned()
            }
            (true, JudgeRenderer::Path) => "as asked".to_owned(),
            (true, _) if self.traced_maps => "maps fitted through the path tracer are asked for".to_owned(),
            (true, _) => format!("the rasterizer does not draw {names}"),
            (false, JudgeRenderer::Raster) if self.traced_maps => {
                "as asked; shadows, which the path tracer fits maps to, are not in these pictures".to_owned()
            }
            (false, JudgeRenderer::Raster) if !self.beyond.is_empty() => {
                format!("as asked; {names} are not drawn")
            }
            (false, JudgeRenderer::Raster) => "as asked".to_owned(),
            (false, _) if shadows && !self.beyond.is_empty() => {
                format!(
                    "but for pictures of the asset, as in the fit, whose shadows the maps hold; {names} are not drawn"
                )
            }
            (false, _) if shadows => "but for pictures of the asset, as in the fit".to_owned(),
            (false, _) => "the rasterizer draws all materials".to_owned(),
        };
        let cost = format!(
            "at most {pictures} pictures of {side} x {side} pixels, {spp} samples each, {million:.0} million samples"
        );
        let cost = if self.traced { format!(": {cost}") } else { format!("; saved: {cost}") };
        Item { what: "path traced judgement", runs: self.traced.into(), why: why + &cost }
    }
}

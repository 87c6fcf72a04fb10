//! How the result is judged, and what that costs.

use crate::engine::judge::Judged;
use crate::engine::plan::Item;

/// How the pictures of a judgement are made, why, and how many there are.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// Who draws them: what [`crate::engine::judge::Judge::method`] will say.
    pub judged: Judged,
    /// Why.
    pub why: String,
    /// Pictures of all views that the path tracer makes, or would make, of the asset and of what is compared with it, at most;
    /// without those of the asset where they are path traced in any case.
    pub pictures: u64,
    /// Width and height of each where it is path traced, pixels.
    pub side: usize,
    /// Samples of a path traced pixel.
    pub spp: u32,
}

impl Judgement {
    /// Whether all pictures are path traced.
    pub fn is_traced(&self) -> bool {
        self.judged == Judged::PathTraced
    }

    /// Whether the path tracer draws, and why, with the samples that it takes or that are saved, at most.
    pub fn item(&self) -> Item {
        let Self { why, pictures, side, spp, .. } = self;
        let million = (pictures * (side * side) as u64 * u64::from(*spp)) as f64 / 1e6;
        let cost = if self.is_traced() { ":" } else { "; saved:" };
        let why = format!(
            "{why}{cost} at most {pictures} pictures of {side} x {side} pixels, {spp} samples each, {million:.0} million samples"
        );
        Item { what: "path traced judgement", runs: self.is_traced().into(), why }
    }
}

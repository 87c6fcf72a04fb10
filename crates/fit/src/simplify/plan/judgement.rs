//! How the result is judged, and what the report costs.

use crate::engine::judge::Judged;
use crate::engine::plan::Item;

/// How the pictures of a judgement are made, why, and how many a report has.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// Who draws them: what [`crate::engine::judge::Judge::method`] will say.
    pub judged: Judged,
    /// Why.
    pub why: String,
    /// Pictures of all views of the report that the path tracer makes, or would make, of the asset and of what is compared with
    /// it; without those of the asset where they are path traced in any case.
    pub pictures: u64,
    /// Whether there may be fewer: what was fitted may be what is written, and then stands once.
    pub at_most: bool,
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

    /// The same of a report that shows so many assets beside the asset itself in so many views.
    #[must_use]
    pub(crate) fn made(self, views: usize, stages: usize) -> Self {
        let pictures = views as u64 * (self.pictures_of_asset() + stages as u64);
        Self { pictures, at_most: false, ..self }
    }

    /// Pictures of the asset in each view: one that shows what noise alone makes, beside the one that all are compared with.
    fn pictures_of_asset(&self) -> u64 {
        1 + u64::from(!matches!(self.judged, Judged::RasterizedAgainst(_)))
    }

    /// Whether the path tracer draws, and why, with the samples of the report that it takes or that are saved; pictures by
    /// which what is written is chosen do not count.
    pub fn item(&self) -> Item {
        let Self { why, pictures, side, spp, .. } = self;
        let million = (pictures * (side * side) as u64 * u64::from(*spp)) as f64 / 1e6;
        let digits = if million < 10.0 { 1 } else { 0 };
        let cost = if self.is_traced() { ": the report takes" } else { "; the report saves" };
        let most = if self.at_most { " up to" } else { "" };
        let beside =
            if self.is_traced() { "; pictures that choices are made by are not among them" } else { "" };
        let why = format!(
            "{why}{cost}{most} {pictures} pictures of {side} x {side} pixels, {spp} samples each, {million:.digits$} million samples\
             {beside}"
        );
        Item { what: "path traced judgement", runs: self.is_traced().into(), why }
    }
}

//! What steers a fit: the options and the shape that a checkpoint is checked against.

use super::{Mips, SimplifyOptions};
use crate::candidate::Candidate;
use crate::engine::checkpoint;
use crate::engine::fingerprint::Fingerprint;
use photofit_geometry::decimate::Target;

/// The options and the topology that steer a fit, a share of whose views shows `backs`, and which may end far behind a `rival`.
pub(super) fn of_fit(o: &SimplifyOptions, (backs, rival): (f32, bool), start: &Candidate) -> Fingerprint {
    let mut digest = checkpoint::Digest::new();
    digest.add(start.triangles.as_flattened());
    digest.add(&start.uvs);
    let all = of_options(o).option("single-sided backs", backs);
    let all = all.digest("whether the asset's own materials may end the fit", rival);
    all.digest("shape that the fit starts from", digest)
}

/// The options that steer a fit.
pub(super) fn of_options(o: &SimplifyOptions) -> Fingerprint {
    let all = match o.target {
        // Triangles follow from them, and from the asset.
        _ if o.triangles_by_bytes => Fingerprint::default()
            .option("max_bytes", o.max_bytes.unwrap_or_default())
            .option("compress", o.compression.name())
            .option("textures", format!("{:?}", o.texture_encoding)),
        Target::Triangles(n) => Fingerprint::default().option("triangles", n),
        Target::Ratio(r) => Fingerprint::default().option("ratio", r),
        Target::Error(e) => Fingerprint::default().option("error", e),
        Target::ScreenSize(p) => Fingerprint::default().option("screen_size", p),
    };
    all.option("init", format!("{:?}", o.init).to_lowercase())
        .option("resolution", o.resolution)
        .option("as_engine", o.as_engine)
        .option("batch", o.batch)
        .option("texture_size", o.texture_size)
        .option("mips", o.mips.name())
        .option("smallest_size", if o.mips == Mips::Free { o.smallest_size } else { 0 })
        .option("lock_borders", o.lock_borders)
        .option("lock", o.lock.as_deref().unwrap_or_default())
        .option("effort", o.effort.name())
        .option("seed", o.seed)
        .option("lighting", o.lighting.name())
        .option("occlusion", o.occlusion.name())
        .option("reference", format!("{:?}", o.reference).to_lowercase())
}

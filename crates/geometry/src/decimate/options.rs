//! What to decimate to, how, and what came out.

use crate::Mesh;

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// At most this many triangles (at least 1); more where [`Options::lock_border`] or [`Options::locked`] leaves no choice, or
    /// would leave what is not locked less than half of its share.
    Triangles(usize),
    /// At most this share of the input triangles, in `(0, 1]`; never fewer than one.
    Ratio(f64),
    /// As few triangles as possible while the estimated error stays below this share of the bounding diagonal.
    Error(f64),
    /// As few triangles as possible while the estimated error stays below half a pixel when the bounding diagonal
    /// spans this many pixels.
    ScreenSize(f64),
}

/// How to decimate; [`Options::new`] gives the measured defaults.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// When to stop.
    pub target: Target,
    /// Carries normals, uvs and colours through and keeps their seams as long as possible; what differs by rounding alone (components of
    /// normals by .006, uvs by 1e-5, colours by 1e-4) is no seam, and is given one of its values. Without it the topology is
    /// that of the welded positions alone and the output has positions only (the atlas is made anew).
    pub keep_uvs: bool,
    /// Weight of a unit of normal difference against a distance of one bounding diagonal (`keep_uvs` only).
    pub normal_weight: f64,
    /// Weight of a unit of uv difference against a distance of one bounding diagonal (`keep_uvs` only).
    pub uv_weight: f64,
    /// Weight of the planes that hold open borders.
    pub border_weight: f64,
    /// Weight of the planes that hold attribute seams (`keep_uvs` only).
    pub seam_weight: f64,
    /// Weight of the planes that hold edges between groups.
    pub group_weight: f64,
    /// Weight of lost or gained area times squared displacement: keeps ends of tubes, corners of cards, silhouettes.
    pub area_weight: f64,
    /// Isotropic part of every quadric: prefers even triangles where the surface is flat.
    pub regularity: f64,
    /// Factor on the cost of collapses that pinch the surface (flatten a tube, close a hole); see `keep_manifold`.
    pub pinch_weight: f64,
    /// Factor on the cost of dropping a whole component against collapsing it onto its axis.
    pub removal_weight: f64,
    /// Power of (thickness of the thickest component / thickness of the component) by which triangles of thin
    /// components count more: what a thin part loses shows in its silhouette. 0 is plain surface error.
    pub thin_power: f64,
    /// Never pinches the surface while the budget can be reached otherwise.
    pub keep_manifold: bool,
    /// Never moves open borders while the budget can be reached otherwise.
    pub keep_border: bool,
    /// Never moves or drops vertices on open borders of the cleaned input, whatever the budget is: where they leave no
    /// room, the result has more triangles. Nothing unseen is dropped then, which would open new borders.
    pub lock_border: bool,
    /// Vertices of the input that are neither moved nor dropped, whatever the budget is, as `true`: one entry each, or empty. Of
    /// vertices that are welded a locked one gives the position (the first of several). Unseen triangles that touch none are dropped.
    pub locked: Vec<bool>,
    /// Smallest cosine between a triangle's normals before and after a collapse.
    pub min_normal_cosine: f64,
    /// Smallest `4 sqrt(3) area / (sum of squared edges)` (1 for an equilateral triangle) that a collapse may make.
    pub min_compactness: f64,
    /// Collapses with a larger estimated error, relative to the bounding diagonal, are not made while the budget can
    /// be reached otherwise.
    pub max_error: Option<f64>,
    /// Vertices closer than this share of the bounding diagonal are one.
    pub merge_tolerance: f64,
    /// Drops triangles of importance zero (but for those that touch a visible one) before anything else.
    pub drop_unseen: bool,
    /// Groups whose triangles are seen from both sides: two triangles back to back become one. Indexed by group,
    /// missing entries are `false`.
    pub double_sided: Vec<bool>,
    /// Rounds of least-squares refinement of the positions against the input surface after the collapses.
    pub refine_rounds: u32,
}

impl Options {
    /// The defaults for a target.
    pub fn new(target: Target) -> Self {
        Self {
            target,
            keep_uvs: false,
            normal_weight: 0.01,
            uv_weight: 0.02,
            border_weight: 1.0,
            seam_weight: 0.5,
            group_weight: 1.0,
            area_weight: 0.05,
            regularity: 1e-6,
            pinch_weight: 4.0,
            removal_weight: 16.0,
            thin_power: 0.5,
            keep_manifold: false,
            keep_border: false,
            lock_border: false,
            locked: Vec::new(),
            min_normal_cosine: 0.2,
            min_compactness: 0.01,
            max_error: None,
            merge_tolerance: 1e-6,
            drop_unseen: true,
            double_sided: Vec::new(),
            refine_rounds: 8,
        }
    }
}

/// Triangles after each stage, and what the stages did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Triangles of the input.
    pub input_triangles: usize,
    /// Vertices of the input.
    pub input_vertices: usize,
    /// Distinct positions.
    pub welded_vertices: usize,
    /// Connected components of the cleaned input.
    pub components: usize,
    /// Degenerate and duplicate triangles removed by cleaning.
    pub cleaned: usize,
    /// Triangles dropped because nobody sees them.
    pub unseen: usize,
    /// Triangles left after collapses under full checks.
    pub after_checked: usize,
    /// Triangles left after collapses with relaxed shape checks.
    pub after_relaxed: usize,
    /// Triangles left after collapses without checks.
    pub after_forced: usize,
    /// Collapses made.
    pub collapses: usize,
    /// Components dropped as a whole.
    pub removed_components: usize,
}

/// The decimated mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Decimated {
    /// The mesh.
    pub mesh: Mesh,
    /// Group of each triangle.
    pub group: Vec<u32>,
    /// For each triangle the input triangle that it descends from.
    pub source: Vec<u32>,
    /// Vertices that [`Options::lock_border`] and [`Options::locked`] kept, as `true`; empty without them.
    pub locked: Vec<bool>,
    /// Largest estimated error of a collapse (root mean square plane distance), in the units of the positions.
    pub error: f64,
    /// The same, relative to the bounding diagonal.
    pub relative_error: f64,
    /// What the stages did.
    pub stats: Stats,
}

/// Why a mesh cannot be decimated.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum DecimateError {
    /// Positions are empty or there is no triangle.
    #[error("the mesh has no triangles")]
    Empty,
    /// The budget is zero.
    #[error("a budget of zero triangles")]
    ZeroBudget,
    /// Stopped by the progress callback.
    #[error("decimation was stopped")]
    Stopped,
    /// A number of the options is not finite or out of its range.
    #[error("option {0} is not finite or out of range")]
    Option(&'static str),
    /// A position is NaN or infinite.
    #[error("position {0} is not finite")]
    Position(usize),
    /// An attribute is NaN or infinite.
    #[error("{0} {1} is not finite")]
    Attribute(&'static str, usize),
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex} of {vertices}")]
    Index {
        /// Triangle.
        triangle: usize,
        /// Its vertex index.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// An array has the wrong length.
    #[error("{name} has {found} entries, {expected} are needed")]
    Length {
        /// Array.
        name: &'static str,
        /// Its length.
        found: usize,
        /// The length it must have.
        expected: usize,
    },
    /// An importance is negative, NaN or infinite.
    #[error("importance of triangle {0} is negative or not finite")]
    Importance(usize),
    /// More vertices or corners than 32-bit indices can name.
    #[error("more than 2^29 vertices or triangles")]
    TooLarge,
}

//! How far an image may lie from its golden file, each bound with its reason.

/// A bound on the difference of two images.
///
/// Every sample must lie within `sample` of its golden value; a share `outliers` of the pixels is exempt. There is
/// no mean in it: a mean lets one wrong region hide in many right pixels.
#[derive(Clone, Copy, Debug)]
pub struct Tolerance {
    /// Largest absolute difference of a sample; half an 8-bit step is added for PNG files.
    pub sample: f32,
    /// Share of pixels in `[0, 1]` that may exceed `sample`.
    pub outliers: f64,
    /// Why the bound is what it is.
    pub reason: &'static str,
}

/// Arithmetic in a fixed order without library functions.
pub const EXACT: Tolerance = Tolerance {
    sample: 1e-6,
    outliers: 0.0,
    reason: "additions and products in a fixed order: only fused multiply-adds may differ, a few units in the \
             last place of values up to one",
};

/// Arithmetic through `powf`, `exp`, `ln`, `sin` or `cos`.
pub const LIBRARY_FUNCTIONS: Tolerance = Tolerance {
    sample: 1e-4,
    outliers: 0.0,
    reason: "the standard library leaves the last bits of transcendental functions to the platform; smooth \
             formulas amplify them by far less than this",
};

/// Error maps of images.
pub const METRICS: Tolerance = Tolerance {
    sample: 1e-3,
    outliers: 0.0,
    reason: "variances are differences of nearly equal sums, and FLIP raises its colour difference to the power 0.7, \
             whose slope grows without bound towards zero: rounding of 1e-6 may show as 1e-4",
};

/// Pictures with visibility edges: a last bit decides which triangle covers a pixel centre.
pub const EDGES: Tolerance = Tolerance {
    sample: 2e-3,
    outliers: 2e-3,
    reason: "pixel centres that lie on an edge to the last bit may fall to either side: a few pixels of a small \
             picture, not more; inside faces the bound is that of 16-bit interpolation",
};

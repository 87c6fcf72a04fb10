//! What a reconstruction can be told; the defaults need no tuning.

use super::{BlendOptions, SplatRadius, SurfaceError};

/// How holes are filled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Pull-push, then a few steps on the filled and on the raw map, blended: 20 steps in all.
    Fast,
    /// Two full solutions, with the squared and with the absolute data term, blended.
    Blend,
    /// One full solution whose absolute term fades where the surface is rough.
    Hybrid,
}

/// Weights of the energy in ln z. Lengths are pixels, values are relative depths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// Total variation of depth.
    pub alpha: f32,
    /// Curvature of depth.
    pub beta: f32,
    /// Distance of the slope of depth from that of the normals.
    pub gamma: f32,
    /// Absolute data term, beside a squared one of weight 1.
    pub absolute: f32,
    /// Penalties of the splits, as the change of relative depth that one step shrinks away.
    pub threshold: f32,
    /// A sample this far behind the estimate (relative depth) is taken for hidden and pulls no harder.
    pub delta: f32,
}

/// What a reconstruction can be told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceOptions {
    /// How holes are filled.
    pub method: Method,
    /// Steps of the solver; for [`Method::Fast`] of each of its two passes.
    pub iterations: usize,
    /// Reach of a sample: what lies behind it is hidden, and where it ends is the outline.
    pub reach: SplatRadius,
    /// Samples farther behind the splats than this share of their depth are removed.
    pub tolerance: f32,
    /// Pull-push keeps the nearest surface up to this level; from the spacing of the samples when `None`.
    pub max_level: Option<usize>,
    /// Weights of the energy.
    pub weights: Weights,
    /// Where the two solutions are used.
    pub blend: BlendOptions,
    /// Strength of the vectorial total variation of the colours; 0 leaves them as interpolated.
    pub texture: f32,
    /// Fill the whole picture, also where no surface is near.
    pub fill: bool,
}

impl SurfaceOptions {
    /// The defaults of a method.
    pub fn new(method: Method) -> Self {
        let fast = method == Method::Fast;
        Self {
            method,
            iterations: if fast { 10 } else { 100 },
            reach: SplatRadius::Spacing(1.5),
            tolerance: 0.03,
            max_level: None,
            weights: Weights {
                alpha: 0.0,
                beta: 5e-4,
                gamma: 5e-4,
                absolute: 5e-3,
                threshold: if fast { 0.02 } else { 2e-3 },
                delta: 0.005,
            },
            blend: BlendOptions::default(),
            texture: if fast { 0.0 } else { 0.03 },
            fill: false,
        }
    }

    pub(super) fn check(&self) -> Result<(), SurfaceError> {
        let reach = match self.reach {
            SplatRadius::Pixels(r) | SplatRadius::Spacing(r) => r,
        };
        let w = &self.weights;
        let numbers = [
            ("reach", reach),
            ("tolerance", self.tolerance),
            ("alpha", w.alpha),
            ("beta", w.beta),
            ("gamma", w.gamma),
            ("absolute", w.absolute),
            ("delta", w.delta),
            ("texture", self.texture),
        ];
        for (name, value) in numbers {
            if !(value.is_finite() && value >= 0.0) {
                return Err(SurfaceError::Option {
                    rule: format!("{name} is {value}; it must be finite and not negative"),
                });
            }
        }
        if w.threshold <= 0.0 || !w.threshold.is_finite() {
            return Err(SurfaceError::Option {
                rule: format!("threshold is {}; it must be finite and more than 0", w.threshold),
            });
        }
        if self.blend.window.is_multiple_of(2) {
            let rule = format!("the window of the blend is {}; it must be odd", self.blend.window);
            return Err(SurfaceError::Option { rule });
        }
        Ok(())
    }
}

impl Default for SurfaceOptions {
    fn default() -> Self {
        Self::new(Method::Fast)
    }
}

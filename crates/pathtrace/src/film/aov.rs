//! Auxiliary images: what the camera sees first, and parts of the light.
//!
//! Where it sees through blended surfaces, albedo is the mean of all by what is seen of them, and *the first surface* is
//! that of which most is seen (the background counts): nothing of it is left to chance.

use std::fmt;

/// An auxiliary image (arbitrary output variable).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Aov {
    /// Part of uniform light that the first surface reflects.
    Albedo,
    /// Shading normal of the first surface, in the world, on the viewer's side.
    Normal,
    /// Geometric normal of the first surface, in the world, on the viewer's side.
    GeometricNormal,
    /// Distance of the first surface along the axis of the camera; 1e10 where there is none.
    Depth,
    /// World position of the first surface; 0 where there is none.
    Position,
    /// Index of the instance seen by the first sample, counted from 1; 0 where there is none.
    Instance,
    /// Movement of the first surface in the picture since the previous camera, pixels.
    Motion,
    /// Variance of the pixel's mean.
    Variance,
    /// Emission and light scattered once.
    Direct,
    /// Light scattered more than once.
    Indirect,
    /// Samples of the pixel.
    Samples,
}

impl Aov {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Albedo,
        Self::Normal,
        Self::GeometricNormal,
        Self::Depth,
        Self::Position,
        Self::Instance,
        Self::Motion,
        Self::Variance,
        Self::Direct,
        Self::Indirect,
        Self::Samples,
    ];

    /// The name of the layer.
    pub fn name(self) -> &'static str {
        match self {
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::GeometricNormal => "geometric_normal",
            Self::Depth => "depth",
            Self::Position => "position",
            Self::Instance => "instance",
            Self::Motion => "motion",
            Self::Variance => "variance",
            Self::Direct => "direct",
            Self::Indirect => "indirect",
            Self::Samples => "samples",
        }
    }

    /// The one of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|a| a.name() == name)
    }

    /// Names of its channels in a file.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Albedo | Self::Variance | Self::Direct | Self::Indirect => &["R", "G", "B"],
            Self::Normal | Self::GeometricNormal | Self::Position => &["X", "Y", "Z"],
            Self::Depth => &["Z"],
            Self::Motion => &["X", "Y"],
            Self::Instance => &["ID"],
            Self::Samples => &["N"],
        }
    }

    /// Sums that it keeps per pixel.
    pub(crate) fn sums(self) -> usize {
        match self {
            Self::Albedo | Self::Normal | Self::GeometricNormal | Self::Position | Self::Direct => 3,
            Self::Motion => 2,
            Self::Depth => 1,
            // From other sums.
            Self::Instance | Self::Variance | Self::Indirect | Self::Samples => 0,
        }
    }
}

impl fmt::Display for Aov {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

//! Stages that can be left out, to see what each brings.

use super::pipeline::Model;
use std::fmt;

/// An input or a stage of [`super::denoise`] that [`super::Settings::without`] may leave out. Fireflies have a switch of
/// their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// The albedo, and with it demodulation and all that rests on it.
    Albedo,
    /// The normals.
    Normal,
    /// The positions and depths. (A sequence needs them.)
    Position,
    /// The variance layer.
    Variance,
    /// Keeping pixels without noise as they are.
    Noiseless,
    /// Division by the albedo.
    Demodulation,
    /// The choice of a filter bandwidth for each cell: all cells take the middle one.
    Bandwidth,
    /// The blur that replaces linear models at highlights.
    Highlights,
    /// Filtering pixels without diffuse reflectance by themselves.
    ZeroAlbedo,
    /// What the regression left over, brought back.
    Detail,
    /// The smoothing of edges that one sample a pixel leaves jagged.
    Antialiasing,
    /// The correction of edges.
    Edges,
    /// The map of the guides' edges in the weights of the convex models.
    Coherence,
}

impl Stage {
    /// All of them.
    pub const ALL: [Self; 13] = [
        Self::Albedo,
        Self::Normal,
        Self::Position,
        Self::Variance,
        Self::Noiseless,
        Self::Demodulation,
        Self::Bandwidth,
        Self::Highlights,
        Self::ZeroAlbedo,
        Self::Detail,
        Self::Antialiasing,
        Self::Edges,
        Self::Coherence,
    ];

    /// The name, lower case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Position => "position",
            Self::Variance => "variance",
            Self::Noiseless => "noiseless",
            Self::Demodulation => "demodulation",
            Self::Bandwidth => "bandwidth",
            Self::Highlights => "highlights",
            Self::ZeroAlbedo => "zero-albedo",
            Self::Detail => "detail",
            Self::Antialiasing => "antialiasing",
            Self::Edges => "edges",
            Self::Coherence => "coherence",
        }
    }

    /// Whether a model has this input or stage. Leaving it out of one that has not changes nothing.
    pub fn is_of(self, model: Model) -> bool {
        match self {
            Self::Bandwidth | Self::Highlights | Self::Detail | Self::Antialiasing | Self::Edges => {
                model == Model::Auto
            }
            Self::Coherence => matches!(model, Model::Variational(_)),
            _ => true,
        }
    }
}

/// Some stages, each there or not.
///
/// ```
/// use photofit_denoise::mc::{Stage, Stages};
/// let some = Stages::from_iter([Stage::Detail, Stage::Edges]);
/// assert!(some.has(Stage::Edges) && !some.has(Stage::Albedo));
/// assert_eq!(Stages::from(Stage::Edges), Stages::from_iter([Stage::Edges; 2]));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stages(u16);

impl Stages {
    /// Whether a stage is among them.
    pub fn has(self, stage: Stage) -> bool {
        self.0 & (1 << stage as u16) != 0
    }
}

impl From<Stage> for Stages {
    fn from(stage: Stage) -> Self {
        Self(1 << stage as u16)
    }
}

impl FromIterator<Stage> for Stages {
    fn from_iter<I: IntoIterator<Item = Stage>>(stages: I) -> Self {
        Self(stages.into_iter().fold(0, |all, stage| all | Self::from(stage).0))
    }
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

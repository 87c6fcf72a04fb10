//! What can go wrong.

/// Why levels cannot be encoded, or a file not be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Ktx2Error {
    /// There is nothing to encode.
    #[error("the number of mip levels is 0; it must be at least 1")]
    NoLevels,
    /// More levels than halvings of the first.
    #[error("the number of mip levels is {count}; it must be at most {most} for {width}x{height} texels")]
    TooManyLevels {
        /// Levels given.
        count: usize,
        /// Levels down to one texel.
        most: usize,
        /// Width of the first level.
        width: u32,
        /// Height of the first level.
        height: u32,
    },
    /// A level's size is not the halved size of the one before.
    #[error("the size of mip level {level} is {found:?}; it must be {expected:?}")]
    LevelSize {
        /// Place of the level, 0 the largest.
        level: usize,
        /// Width and height given.
        found: (u32, u32),
        /// Width and height by the rule `max(1, size >> level)`.
        expected: (u32, u32),
    },
    /// A level's texels do not fill its size.
    #[error("the number of texels of mip level {level} is {found}; it must be {expected}")]
    TexelCount {
        /// Place of the level.
        level: usize,
        /// Texels given.
        found: usize,
        /// Width times height.
        expected: u64,
    },
    /// A number that options do not allow.
    #[error("the Zstandard level is {0}; it must be in 1..=22")]
    ZstandardLevel(i32),
    /// A weight of rate against distortion that is not one.
    #[error("the lambda of rate-distortion optimization is {0}; it must be finite and not negative")]
    Lambda(f32),
    /// The file is damaged, or no KTX 2.0 file.
    #[error("{place} {rule}")]
    Invalid {
        /// What is wrong.
        place: &'static str,
        /// The rule that it breaks.
        rule: String,
    },
    /// A KTX 2.0 file of a kind that is not read.
    #[error("{0} are not read; KTX 2.0 textures must be two-dimensional, of UASTC LDR 4x4 or ETC1S")]
    Unsupported(String),
}

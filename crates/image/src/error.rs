//! The error of this crate.

/// What can go wrong with image files; every message names the file and the rule.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The file system refused.
    #[error("{place}: {source}")]
    Io {
        /// File, or what was being read.
        place: String,
        /// The refusal.
        source: std::io::Error,
    },
    /// The bytes are no valid image, or of a kind that is not read.
    #[error("{place}: {rule}")]
    Invalid {
        /// File, or what was being read.
        place: String,
        /// The rule that is broken.
        rule: String,
    },
    /// The image claims more memory than the limits or its own file size allow.
    #[error("{place}: {width} x {height} with {channels} channels is too large: {rule}")]
    TooLarge {
        /// File, or what was being read.
        place: String,
        /// Claimed columns.
        width: u64,
        /// Claimed rows.
        height: u64,
        /// Claimed samples per pixel.
        channels: u64,
        /// The rule that is broken.
        rule: String,
    },
}

impl ImageError {
    /// The same error about another place, for callers that know better where the bytes came from.
    ///
    /// ```
    /// use photofit_image::{Limits, decode_texture};
    /// let error = decode_texture(b"", &Limits::default()).unwrap_err().at("ship.glb, image 3");
    /// assert!(error.to_string().starts_with("ship.glb, image 3: "));
    /// ```
    #[must_use]
    pub fn at(mut self, new_place: impl Into<String>) -> Self {
        match &mut self {
            Self::Io { place, .. } | Self::Invalid { place, .. } | Self::TooLarge { place, .. } => {
                *place = new_place.into();
            }
        }
        self
    }

    pub(crate) fn invalid(place: &str, rule: impl Into<String>) -> Self {
        Self::Invalid { place: place.to_owned(), rule: rule.into() }
    }

    pub(crate) fn io(place: &std::path::Path, source: std::io::Error) -> Self {
        Self::Io { place: place.display().to_string(), source }
    }
}

//! What can go wrong with asset files.

use std::path::{Path, PathBuf};

/// An error of this crate; the message is one line that names the file, the place and the rule.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A file cannot be read.
    #[error("{}: cannot be read: {cause}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// A file cannot be written.
    #[error("{}: cannot be written: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// The contents of a file break a rule.
    #[error("{}: {place}: {rule}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Where in the file: accessor, bufferView, line, byte.
        place: String,
        /// The rule that is broken.
        rule: String,
    },
    /// A scene has parts that cannot be rendered.
    #[error("{}: not supported: {}", path.display(), elements.join("; "))]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The place and the name of each.
        elements: Vec<String>,
    },
    /// A scene in memory breaks a rule.
    #[error("{place}: {rule}")]
    Scene {
        /// Where in the scene.
        place: String,
        /// The rule that is broken.
        rule: String,
    },
    /// An environment image cannot be loaded.
    #[error("{}: {rule}", path.display())]
    Environment {
        /// The file.
        path: PathBuf,
        /// The rule that is broken.
        rule: String,
    },
}

/// A broken rule before the name of the file is added.
#[derive(Debug)]
pub(crate) struct Fault {
    pub(crate) place: String,
    pub(crate) rule: String,
    pub(crate) kind: FaultKind,
}

/// What a broken rule is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FaultKind {
    /// What a file says.
    Content,
    /// The file that it names cannot be read.
    Unreadable,
    /// The file that it names lies outside of the asset's folder.
    Outside,
}

impl Fault {
    pub(crate) fn in_file(self, path: &Path) -> SceneError {
        SceneError::Invalid { path: path.to_owned(), place: self.place, rule: self.rule }
    }

    pub(crate) fn in_scene(self) -> SceneError {
        SceneError::Scene { place: self.place, rule: self.rule }
    }
}

/// A broken rule at a place.
pub(crate) fn fault(place: impl Into<String>, rule: impl Into<String>) -> Fault {
    Fault { place: place.into(), rule: rule.into(), kind: FaultKind::Content }
}

/// A file that cannot be read, named at a place.
pub(crate) fn unreadable(place: impl Into<String>, name: &str, cause: impl std::fmt::Display) -> Fault {
    let rule = format!("the file `{}` cannot be read: {cause}", crate::load::clip(name));
    Fault { kind: FaultKind::Unreadable, ..fault(place, rule) }
}

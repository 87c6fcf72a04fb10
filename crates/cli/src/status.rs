//! How the program ends: exit statuses and the errors that choose them.

use std::fmt;

/// An input that cannot be used, or a failure while working.
pub(crate) const FAILED: u8 = 1;
/// A wrong command line.
pub(crate) const MISUSED: u8 = 2;
/// Ended early by a signal, with what was reached written.
pub(crate) const STOPPED: u8 = 3;
/// Ended by Ctrl-C or SIGTERM before there was anything to write, or at once by a second signal.
pub(crate) const INTERRUPTED: u8 = 130;

/// How a command that wrote its files ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ending {
    /// All was done, or as much as the options ask for.
    Done,
    /// A signal ended the work early; what was reached is written.
    Stopped,
}

/// A command line that contradicts itself: status [`MISUSED`].
#[derive(Debug)]
pub(crate) struct Misuse(pub(crate) String);

impl fmt::Display for Misuse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Misuse {}

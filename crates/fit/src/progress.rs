//! How long work tells what it is doing, and how it is asked to stop.

/// Receives progress; implementations must be cheap.
pub trait Progress: Sync {
    /// `done` of `total` units of a stage are finished.
    fn report(&self, stage: &'static str, done: u64, total: u64, note: &str);
    /// Something that the user should know and that ends nothing.
    fn warn(&self, text: &str) {
        let _ = text;
    }
    /// Something that the user should know and that is as it should be.
    fn note(&self, text: &str) {
        let _ = text;
    }
    /// True once the user asked to stop.
    fn is_cancelled(&self) -> bool;
}

/// Progress of work as one stage of a larger one.
pub(crate) struct AsStage<'a> {
    pub(crate) progress: &'a dyn Progress,
    pub(crate) stage: &'static str,
    /// What is told beside it, of the stage that the work is in and its note.
    pub(crate) note: for<'n> fn(&'static str, &'n str) -> &'n str,
}

impl Progress for AsStage<'_> {
    fn report(&self, stage: &'static str, done: u64, total: u64, note: &str) {
        self.progress.report(self.stage, done, total, (self.note)(stage, note));
    }

    fn warn(&self, text: &str) {
        self.progress.warn(text);
    }

    fn note(&self, text: &str) {
        self.progress.note(text);
    }

    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}

/// Says nothing and never stops.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn report(&self, _: &'static str, _: u64, _: u64, _: &str) {}
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Keeps the warnings.
#[cfg(test)]
#[derive(Default)]
pub(crate) struct Heard(pub(crate) std::sync::Mutex<Vec<String>>);

#[cfg(test)]
impl Progress for Heard {
    fn report(&self, _: &'static str, _: u64, _: u64, _: &str) {}
    fn warn(&self, text: &str) {
        self.0.lock().unwrap().push(text.into());
    }
    fn is_cancelled(&self) -> bool {
        false
    }
}

//! What runs, what is skipped and why; how long each stage took.

use std::fmt;
use std::time::Instant;

/// The time; none where the standard library has no clock, as in a browser.
pub(crate) fn now() -> Option<Instant> {
    (!cfg!(all(target_family = "wasm", target_os = "unknown"))).then(Instant::now)
}

/// One line of a [`Plan`].
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Guide or stage.
    pub name: &'static str,
    /// Whether it takes part.
    pub runs: bool,
    /// What it does, or why it is skipped.
    pub why: String,
    /// Seconds, for stages that ran where there is a clock.
    pub seconds: Option<f64>,
}

/// The work on one picture: printable, and a value that tests look at.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// Guides, then stages in the order in which they ran.
    pub steps: Vec<Step>,
}

impl Plan {
    pub(crate) fn run(&mut self, name: &'static str, why: impl Into<String>) {
        self.steps.push(Step { name, runs: true, why: why.into(), seconds: None });
    }

    pub(crate) fn skip(&mut self, name: &'static str, why: impl Into<String>) {
        self.steps.push(Step { name, runs: false, why: why.into(), seconds: None });
    }

    /// Runs and times a stage; `work` returns its result and what it did.
    pub(crate) fn stage<R, W: Into<String>>(
        &mut self,
        name: &'static str,
        work: impl FnOnce() -> (R, W),
    ) -> R {
        let began = now();
        let (result, why) = work();
        self.timed(name, why, began);
        result
    }

    /// A stage that ran since `began`.
    pub(crate) fn timed(&mut self, name: &'static str, why: impl Into<String>, began: Option<Instant>) {
        let seconds = began.map(|began| began.elapsed().as_secs_f64());
        self.steps.push(Step { name, runs: true, why: why.into(), seconds });
    }

    /// Says anew what a stage that ran did, where later work changed it.
    pub(crate) fn restate(&mut self, name: &str, why: impl Into<String>) {
        if let Some(step) = self.steps.iter_mut().find(|s| s.name == name) {
            step.why = why.into();
        }
    }

    /// The line of a guide or stage.
    pub fn step(&self, name: &str) -> Option<&Step> {
        self.steps.iter().find(|s| s.name == name)
    }

    /// Whether a guide or stage took part.
    pub fn runs(&self, name: &str) -> bool {
        self.step(name).is_some_and(|s| s.runs)
    }

    /// Sum of the stages' times.
    pub fn seconds(&self) -> f64 {
        self.steps.iter().filter_map(|s| s.seconds).sum()
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for s in &self.steps {
            let state = if s.runs { "runs" } else { "skipped" };
            write!(f, "{:<14} {state:<8} {}", s.name, s.why)?;
            match s.seconds {
                Some(seconds) => writeln!(f, " ({:.1} ms)", 1e3 * seconds)?,
                None => writeln!(f)?,
            }
        }
        Ok(())
    }
}

//! Progress on the terminal.

use crate::interrupt;
use indicatif::{ProgressBar, ProgressStyle};
use photofit_fit::Progress;
use photofit_scene::Scene;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time between two lines when stderr is no terminal.
const PLAIN_INTERVAL: Duration = Duration::from_secs(10);

/// A line on stderr.
pub(crate) fn say(text: &str) {
    // Nobody is left to tell when stderr is gone.
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// What was found wrong with an asset and left out, on stderr.
pub(crate) fn say_warnings(file: &Path, scene: &Scene) {
    scene.warnings.iter().for_each(|w| say(&format!("warning: {}: {w}", file.display())));
}

/// Shows progress: a bar on a terminal, else a line at each stage and every ten seconds.
pub(crate) struct Terminal {
    steps: &'static [&'static [&'static str]],
    /// The steps are gone through several times.
    rounds: bool,
    state: Mutex<State>,
    warnings: Mutex<Vec<String>>,
}

struct State {
    bar: Option<ProgressBar>,
    stage: &'static str,
    /// The number of the step that the stage belongs to; 0 where steps are not counted.
    step: usize,
    began: Instant,
    spoke: Instant,
    /// When the count of units began, how many were done then (a resumed fit does not begin at 0), how many are by now, and of how many:
    /// a stage may count several times.
    counting: Instant,
    first: u64,
    done: u64,
    total: u64,
}

impl Terminal {
    /// Progress of work whose stages are not known beforehand.
    pub(crate) fn new() -> Self {
        Self::with_steps(&[])
    }

    /// Progress of work that goes through steps in order; each step lists the names of its stages.
    pub(crate) fn with_steps(steps: &'static [&'static [&'static str]]) -> Self {
        Self::over(steps, false)
    }

    /// The same where the steps are gone through several times: after the last one of them an earlier one begins another round.
    pub(crate) fn with_rounds(steps: &'static [&'static [&'static str]]) -> Self {
        Self::over(steps, true)
    }

    fn over(steps: &'static [&'static [&'static str]], rounds: bool) -> Self {
        let now = Instant::now();
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(1);
            let template = "{msg:<19} {wide_bar} {pos}/{len} {prefix} {elapsed} eta {eta}";
            if let Ok(style) = ProgressStyle::with_template(template) {
                bar.set_style(style.progress_chars("=> "));
            }
            bar.enable_steady_tick(Duration::from_millis(500));
            bar
        });
        Self {
            steps,
            rounds,
            state: Mutex::new(State {
                bar,
                stage: "",
                step: 0,
                began: now,
                spoke: now,
                counting: now,
                first: 0,
                done: 0,
                total: 0,
            }),
            warnings: Mutex::default(),
        }
    }

    /// The step of a stage that follows on the step `before`; 0 where steps are not counted.
    fn step_of(&self, stage: &str, before: usize) -> usize {
        let step = self.steps.iter().position(|s| s.contains(&stage)).map_or(0, |k| k + 1);
        let again = self.rounds && step > 0 && before == self.steps.len();
        // A later step may repeat a stage of an earlier one.
        if again { step } else { before.max(step) }
    }

    /// What was warned of so far.
    pub(crate) fn warned(&self) -> Vec<String> {
        self.warnings.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Ends the last stage.
    pub(crate) fn finish(&self) {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.end_stage(self.steps.len());
        if let Some(bar) = &state.bar {
            bar.finish_and_clear();
        }
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        if let Some(bar) = &self.state.get_mut().unwrap_or_else(PoisonError::into_inner).bar {
            bar.finish_and_clear();
        }
    }
}

impl State {
    /// The number of the step, where steps are counted, and the stage.
    fn name(&self, steps: usize) -> String {
        match self.step {
            0 => format!("{:<12}", self.stage),
            step => format!("{step} of {steps} {:<12}", self.stage),
        }
    }

    fn end_stage(&self, steps: usize) {
        if self.stage.is_empty() {
            return;
        }
        let line = format!("{} {:.1} s", self.name(steps), self.began.elapsed().as_secs_f64());
        match &self.bar {
            Some(bar) => bar.suspend(|| say(&line)),
            None => say(&line),
        }
    }

    fn plain_line(&mut self, steps: usize, done: u64, total: u64, note: &str) {
        if self.spoke.elapsed() < PLAIN_INTERVAL {
            return;
        }
        self.spoke = Instant::now();
        let elapsed = self.began.elapsed().as_secs_f64();
        let made = done.saturating_sub(self.first);
        let left = match made {
            0 => String::new(),
            n => {
                let counted = self.counting.elapsed().as_secs_f64();
                format!(", {:.0} s left at most", counted / n as f64 * total.saturating_sub(done) as f64)
            }
        };
        let note = if note.is_empty() { String::new() } else { format!(", {note}") };
        say(&format!("{} {done}/{total}{note}, {elapsed:.0} s{left}", self.name(steps)));
    }
}

impl Progress for Terminal {
    fn report(&self, stage: &'static str, done: u64, total: u64, note: &str) {
        // Written between two steps of the fit, in no time.
        if stage == "checkpoint" {
            return;
        }
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if stage != state.stage {
            state.end_stage(self.steps.len());
            (state.stage, state.began) = (stage, Instant::now());
            (state.counting, state.first) = (state.began, done);
            state.step = self.step_of(stage, state.step);
            if let Some(bar) = &state.bar {
                bar.reset();
                bar.set_message(state.name(self.steps.len()));
            }
        }
        // Reports of threads may come out of order.
        if total != state.total || done < state.first || (done == 0 && state.done > 0) {
            (state.counting, state.first) = (Instant::now(), done);
            if let Some(bar) = &state.bar {
                bar.reset_eta();
            }
        }
        (state.done, state.total) = (done, total);
        match &state.bar {
            Some(bar) => {
                bar.set_length(total);
                bar.set_position(done);
                bar.set_prefix(note.to_owned());
            }
            None => state.plain_line(self.steps.len(), done, total, note),
        }
    }

    fn warn(&self, text: &str) {
        self.warnings.lock().unwrap_or_else(PoisonError::into_inner).push(text.to_owned());
        self.note(&format!("warning: {text}"));
    }

    fn note(&self, text: &str) {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        match &state.bar {
            Some(bar) => bar.suspend(|| say(text)),
            None => say(text),
        }
    }

    fn is_cancelled(&self) -> bool {
        interrupt::is_stopping()
    }
}

#[cfg(test)]
mod tests {
    use super::Terminal;

    #[test]
    fn steps_rise_and_begin_again_with_a_round() {
        const STEPS: &[&[&str]] = &[&["see"], &["cut"], &["bake"], &["fit"], &["report"]];
        let steps = |terminal: &Terminal, stages: &[&str]| {
            let mut step = 0;
            let next = |stage: &&str| {
                step = terminal.step_of(stage, step);
                step
            };
            stages.iter().map(next).collect::<Vec<usize>>()
        };
        let stages = ["see", "cut", "bake", "fit", "bake", "report", "cut", "bake", "fit", "other", "report"];
        let once = steps(&Terminal::with_steps(STEPS), &stages);
        assert_eq!(once, [1, 2, 3, 4, 4, 5, 5, 5, 5, 5, 5]);
        let rounds = steps(&Terminal::with_rounds(STEPS), &stages);
        assert_eq!(rounds, [1, 2, 3, 4, 4, 5, 2, 3, 4, 4, 5]);
        assert_eq!(steps(&Terminal::new(), &stages), [0; 11]);
    }
}

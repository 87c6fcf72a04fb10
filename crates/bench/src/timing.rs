//! Wall-clock times as a median with its spread.

use std::time::Instant;

/// Repeated wall-clock times of one piece of work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Timing {
    /// Median, seconds.
    pub(crate) median: f64,
    /// Distance of the quartiles over the median.
    pub(crate) spread: f64,
    /// Number of repetitions.
    pub(crate) runs: usize,
}

impl Timing {
    /// Sums up times in seconds.
    ///
    /// # Panics
    /// Without times.
    pub(crate) fn of(mut seconds: Vec<f64>) -> Self {
        assert!(!seconds.is_empty(), "at least one time");
        seconds.sort_unstable_by(f64::total_cmp);
        let at = |q: f64| seconds[((seconds.len() - 1) as f64 * q).round() as usize];
        let median = at(0.5);
        Self { median, spread: (at(0.75) - at(0.25)) / median.max(1e-12), runs: seconds.len() }
    }
}

/// Runs `work` once to warm up, then 5 times or for about a second, whichever is more, and at most 200 times;
/// work that takes longer than 5 seconds is run 3 times.
///
/// Returns the last result, so that the error is measured on what was timed.
pub(crate) fn time<T>(mut work: impl FnMut() -> T) -> (Timing, T) {
    let start = Instant::now();
    let mut result = std::hint::black_box(work());
    let first = start.elapsed().as_secs_f64();
    let runs = if first > 5.0 { 3 } else { ((1.0 / first.max(1e-9)) as usize).clamp(5, 200) };
    let seconds = (0..runs)
        .map(|_| {
            let start = Instant::now();
            result = std::hint::black_box(work());
            start.elapsed().as_secs_f64()
        })
        .collect();
    (Timing::of(seconds), result)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_ignores_one_slow_run() {
        let timing = Timing::of(vec![1.0, 1.1, 50.0, 0.9, 1.0]);
        assert_eq!((timing.median, timing.runs), (1.0, 5));
        assert!((timing.spread - 0.1).abs() < 1e-9, "{}", timing.spread);
    }

    #[test]
    fn work_is_repeated_and_its_result_kept() {
        let mut calls = 0;
        let (timing, last) = time(|| {
            calls += 1;
            calls
        });
        assert_eq!(last, timing.runs + 1, "one warm-up run");
        assert!(timing.runs >= 5);
    }
}

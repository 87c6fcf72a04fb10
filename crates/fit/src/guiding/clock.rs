//! How many rounds of training the clock allows.

use super::{GuidingOptions, pilot_of};
use std::time::Duration;

/// Time since training began, and its limit.
pub(super) struct Clock<'a> {
    /// Reads the clock.
    pub(super) now: &'a dyn Fn() -> Duration,
    pub(super) limit: Option<Duration>,
    /// How long the last round took.
    pub(super) last: Duration,
}

impl Clock<'_> {
    /// Whether training takes too long to go on.
    pub(super) fn is_over(&self) -> bool {
        self.limit.is_some_and(|limit| (self.now)() >= limit)
    }

    /// Whether there may be a round after these many, and a pilot run of at most so many paths a pixel.
    pub(super) fn allows(&self, rounds: u32, pilot: u32) -> bool {
        let Some(limit) = self.limit else { return true };
        rounds < *GuidingOptions::ROUNDS.start()
            || (self.now)() + expected(self.last, rounds, pilot.min(pilot_of(rounds + 1))) <= limit / 2
    }
}

/// Time of a round after so many and of the pilot run behind it, by how long the last one took: a path of the pilot run takes as
/// long as one of that round (in truth it learns nothing), and there are as many without the guide as with it.
fn expected(last: Duration, rounds: u32, pilot: u32) -> Duration {
    let per_path = f64::from(rounds.saturating_sub(1)).exp2().recip();
    last.mul_f64(2.0 + 2.0 * f64::from(pilot) * per_path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_are_allowed_by_the_time_that_they_are_expected_to_take() {
        let seconds = Duration::from_secs;
        // Four paths a pixel in a second, after three rounds: eight more, and twice as many of the pilot run.
        assert_eq!(expected(seconds(1), 3, 8), seconds(6));
        // After five rounds, 16: twice as many, and twice 16.
        assert_eq!(expected(seconds(4), 5, 16), seconds(16));
        let allows = |now: u64, last: u64, limit: Option<u64>, rounds: u32, pilot: u32| {
            let now = || seconds(now);
            Clock { now: &now, last: seconds(last), limit: limit.map(seconds) }.allows(rounds, pilot)
        };
        assert!(allows(1 << 30, 1 << 20, None, 6, 16), "no limit");
        assert!(allows(9, 1000, Some(10), 2, 16), "the least number of rounds");
        assert!(allows(9, 1, Some(26), 3, 16) && !allows(10, 1, Some(26), 3, 16));
        assert!(allows(10, 1, Some(26), 3, 2), "of a shorter pilot run");
    }
}

//! How many rounds of training the clock allows.

use super::{GuidingOptions, pilot_of};
use std::time::{Duration, Instant};

/// Time since training began, and its limit.
#[derive(Debug)]
pub(super) struct Clock {
    pub(super) began: Instant,
    /// How long the last round took.
    pub(super) last: Duration,
    limit: Option<Duration>,
}

impl Clock {
    pub(super) fn new(limit: Option<Duration>) -> Self {
        Self { began: Instant::now(), last: Duration::ZERO, limit }
    }

    /// Whether there may be a round after these many.
    pub(super) fn allows(&self, rounds: u32) -> bool {
        let Some(limit) = self.limit else { return true };
        rounds < *GuidingOptions::ROUNDS.start()
            || self.began.elapsed() + expected(self.last, rounds) <= limit / 2
    }
}

/// Time of a round after so many and of the pilot run behind it, by how long the last one took: a path of the pilot run takes as
/// long as one of that round, and there are as many without the guide as with it.
fn expected(last: Duration, rounds: u32) -> Duration {
    let pilot = 2.0 * f64::from(pilot_of(rounds + 1));
    let per_path = f64::from(rounds.saturating_sub(1)).exp2().recip();
    last.mul_f64(2.0 + pilot * per_path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_are_allowed_by_the_time_that_they_are_expected_to_take() {
        // Four paths a pixel in a second, after three rounds: eight more, and twice eight of the pilot run.
        assert_eq!(expected(Duration::from_secs(1), 3), Duration::from_secs(6));
        // After five rounds, 16: twice as many, and twice 16.
        assert_eq!(expected(Duration::from_secs(4), 5), Duration::from_secs(16));
        let clock = |last: u64, limit: Option<u64>| Clock {
            last: Duration::from_secs(last),
            ..Clock::new(limit.map(Duration::from_secs))
        };
        let hour = 3600;
        assert!(clock(1000 * hour, None).allows(6), "no clock is read");
        assert!(clock(1000 * hour, Some(1)).allows(2), "the least number of rounds");
        assert!(clock(hour, Some(13 * hour)).allows(3));
        assert!(!clock(hour, Some(11 * hour)).allows(3));
    }
}

//! Mutants of valid files for tests of readers: each is read or refused, without a panic, within a time.
//!
//! Files are mutated in their [`Shape`]: JSON values, lines and numbers of text, attributes of XML, words of binary data
//! inside of valid containers. Most mutants of bytes alone are refused at the door. What a mutant is follows from the
//! target's name and its number.
//!
//! ```
//! use photofit_mutants::{Shape, Target};
//!
//! let seeds = [br#"{"width": 3}"#.to_vec()];
//! let target = Target { name: "width", shape: Shape::Json, seeds: &seeds };
//! let seen = target.run(|n| n == 100, |bytes| {
//!     let value: serde_json::Value = serde_json::from_slice(bytes).map_err(|e| e.to_string())?;
//!     let width = value["width"].as_u64().ok_or("width must be a number")?;
//!     if width < 100 { Ok(()) } else { Err("width must be below 100".into()) }
//! });
//! assert!(seen.read > 5 && seen.rules.contains("width must be a number"));
//! ```

mod rng;
mod shape;

pub use rng::Rng;
pub use shape::{Packing, Shape, glb};

use std::collections::BTreeSet;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// Time that a reader may take for a file of some kilobytes, on a machine that has other work.
const TIME: Duration = Duration::from_secs(20);
/// Time after which one that has not come back ends the process: it may never come back.
const AT_MOST: Duration = Duration::from_secs(120);

/// A reader's files.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// Mutants follow from it.
    pub name: &'a str,
    /// How the files are built.
    pub shape: Shape,
    /// Valid files.
    pub seeds: &'a [Vec<u8>],
}

/// What became of mutants.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// Mutants that were tried.
    pub count: u64,
    /// Those that were read.
    pub read: u64,
    /// Why the others were not: what is said of them, without names and numbers.
    pub rules: BTreeSet<String>,
}

impl Target<'_> {
    /// Hands mutants to `read`, which returns why it refuses one, until `enough(number)`.
    ///
    /// # Panics
    /// When a seed is refused, or when a mutant makes the reader panic or takes more than 20 seconds; the mutant is kept in
    /// the folder for temporary files, which is told. A reader that has not come back after two minutes ends the process.
    pub fn run(
        &self,
        enough: impl Fn(u64) -> bool,
        mut read: impl FnMut(&[u8]) -> Result<(), String>,
    ) -> Seen {
        for (k, seed) in self.seeds.iter().enumerate() {
            assert_eq!(read(seed), Ok(()), "{}: seed {k} is valid", self.name);
        }
        let mut seen = Seen::default();
        while !enough(seen.count) {
            let mut rng = Rng::new(self.name, seen.count);
            let mut bytes = self.seeds[rng.below(self.seeds.len())].clone();
            for _ in 0..1 + rng.below(3) {
                bytes = self.shape.mutate(&bytes, &mut rng);
            }
            let start = Instant::now();
            let outcome = {
                let _watched = self.watched(&bytes, seen.count, AT_MOST);
                catch_unwind(AssertUnwindSafe(|| read(&bytes)))
            };
            match outcome {
                Ok(_) if start.elapsed() > TIME => self.fail(&bytes, seen.count, "takes too long"),
                Ok(Ok(())) => seen.read += 1,
                Ok(Err(why)) => drop(seen.rules.insert(rule(&why))),
                Err(_) => self.fail(&bytes, seen.count, "panics, as told above"),
            }
            seen.count += 1;
        }
        seen
    }

    fn fail(&self, bytes: &[u8], number: u64, what: &str) -> ! {
        panic!("{} mutant {number}, {}: {what}", self.name, kept(self.name, bytes, number));
    }

    /// Ends the process unless what it returns is dropped within a time.
    #[expect(clippy::print_stderr, reason = "nothing else hears of it: the process ends")]
    fn watched(&self, bytes: &[u8], number: u64, at_most: Duration) -> mpsc::Sender<()> {
        let (watched, ended) = mpsc::channel::<()>();
        let (name, bytes) = (self.name.to_owned(), bytes.to_vec());
        std::thread::spawn(move || {
            if ended.recv_timeout(at_most) == Err(mpsc::RecvTimeoutError::Timeout) {
                eprintln!("{name} mutant {number}, {}: hangs", kept(&name, &bytes, number));
                std::process::abort();
            }
        });
        watched
    }
}

/// Keeps a mutant, and says where.
fn kept(name: &str, bytes: &[u8], number: u64) -> String {
    let path = std::env::temp_dir().join(format!("photofit-mutant-{name}-{number}"));
    match std::fs::write(&path, bytes) {
        Ok(()) => format!("kept as {}", path.display()),
        Err(e) => format!("which cannot be kept: {e}"),
    }
}

impl Seen {
    /// Neither all nor none are read, and the others break at least `rules` different rules: mutants that change nothing,
    /// or that all end at the first byte, test nothing.
    ///
    /// # Panics
    /// Where that is not so.
    pub fn assert_deep(&self, name: &str, rules: usize) {
        let Self { count, read, .. } = *self;
        assert!(read * 50 > count && read * 50 < count * 49, "{name}: {read} of {count} are read");
        assert!(
            self.rules.len() >= rules,
            "{name}: {} rules of at least {rules} are reached",
            self.rules.len()
        );
    }
}

impl fmt::Display for Seen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { count, read, rules } = self;
        write!(f, "{read} of {count} mutants are read, the others break {} rules", rules.len())
    }
}

/// The words of a message: what names files, fields, places and numbers differs from mutant to mutant.
fn rule(message: &str) -> String {
    let is_word = |w: &&str| {
        let w = w.trim_end_matches([',', ':', ';', '.']);
        !w.is_empty() && w.chars().all(|c| c.is_ascii_alphabetic() || c == '-')
    };
    message.split_whitespace().filter(is_word).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEED: &[u8] = br#"{"a": [1, 2, 3], "b": {"c": "text", "d": 4}}"#;

    fn target(seeds: &[Vec<u8>]) -> Target<'_> {
        Target { name: "test", shape: Shape::Json, seeds }
    }

    #[test]
    fn mutants_are_the_same_each_time_and_most_are_json() {
        let seeds = [SEED.to_vec()];
        let all = || {
            let mut all = Vec::new();
            let seen = target(&seeds).run(
                |n| n == 200,
                |bytes| {
                    all.push(bytes.to_vec());
                    serde_json::from_slice::<serde_json::Value>(bytes).map(drop).map_err(|e| e.to_string())
                },
            );
            (all, seen.read)
        };
        let (first, read) = all();
        assert_eq!(first, all().0);
        assert!((120..200).contains(&read), "{read}");
    }

    #[test]
    #[should_panic(expected = "panics, as told above")]
    fn a_reader_that_panics_is_told() {
        let seeds = [SEED.to_vec()];
        target(&seeds).run(
            |n| n == 200,
            |bytes| {
                let value: serde_json::Value = serde_json::from_slice(bytes).map_err(|e| e.to_string())?;
                assert!(value["a"].is_array(), "a is an array");
                Ok(())
            },
        );
    }

    #[test]
    #[should_panic(expected = "rules of at least 3 are reached")]
    fn mutants_that_end_at_one_door_are_told() {
        let seeds = [SEED.to_vec()];
        let door = |b: &[u8]| if b.len() > SEED.len() { Ok(()) } else { Err("is too short".to_owned()) };
        let mut first = true;
        let seen =
            target(&seeds).run(|n| n == 200, |b| if std::mem::take(&mut first) { Ok(()) } else { door(b) });
        seen.assert_deep("test", 3);
    }

    #[test]
    fn rules_are_told_without_names_and_numbers() {
        assert_eq!(rule("a/b.glb: node 3: is 7; it must be \"x\" or 1e5"), "node is it must be or");
    }
}

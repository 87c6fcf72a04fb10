//! The fingerprint of a fit: the options and digests that a checkpoint must share with the fit that goes on from it.

use crate::Difference;
use serde::{Deserialize, Serialize};
use std::fmt::Display;

/// Options by name, then digests of what a fit starts from and looks at.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    options: Vec<(String, String)>,
    digests: Vec<(String, String)>,
}

impl Fingerprint {
    /// Adds an option with its value.
    #[must_use]
    pub fn option(mut self, name: &str, value: impl Display) -> Self {
        self.options.push((name.into(), value.to_string()));
        self
    }

    /// Adds a digest of something that has no value for people.
    #[must_use]
    pub fn digest(mut self, name: &str, value: impl Display) -> Self {
        self.digests.push((name.into(), value.to_string()));
        self
    }

    /// Which of these options are others in `saved`, whatever else it has.
    pub(crate) fn other_options(&self, saved: &Self) -> Vec<Difference> {
        let asked = |o: &&(String, String)| self.options.iter().any(|own| own.0 == o.0);
        let was: Vec<_> = saved.options.iter().filter(asked).cloned().collect();
        differing(&was, &self.options, false)
    }

    /// What is another than in `saved`: options, or, where all of them agree, digests, which follow from options too.
    pub(crate) fn differences(&self, saved: &Self) -> Vec<Difference> {
        let options = differing(&saved.options, &self.options, false);
        if options.is_empty() { differing(&saved.digests, &self.digests, true) } else { options }
    }
}

fn differing(was: &[(String, String)], is: &[(String, String)], digest: bool) -> Vec<Difference> {
    let value =
        |list: &[(String, String)], name: &str| list.iter().find(|o| o.0 == name).map(|o| o.1.clone());
    let added = is.iter().filter(|o| value(was, &o.0).is_none());
    was.iter()
        .chain(added)
        .map(|(name, _)| Difference {
            field: name.clone(),
            was: value(was, name),
            is: value(is, name),
            digest,
        })
        .filter(|d| d.was != d.is)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_named_with_both_values_and_come_before_digests() {
        let told = |saved: &Fingerprint, now: &Fingerprint| {
            now.differences(saved).iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        let base = Fingerprint::default().option("ratio", 0.1).option("batch", 2).digest("asset", "a");
        assert!(told(&base, &base.clone()).is_empty());
        let other = Fingerprint::default().option("triangles", 50).option("batch", 3).digest("asset", "b");
        let expected =
            ["ratio was 0.1 and is not given", "batch was 2 and is 3", "triangles was not given and is 50"];
        assert_eq!(told(&base, &other), expected);
        let early =
            |now: Fingerprint| now.other_options(&base).iter().map(ToString::to_string).collect::<Vec<_>>();
        assert!(early(Fingerprint::default().option("batch", 2)).is_empty());
        assert_eq!(early(Fingerprint::default().option("batch", 3)), ["batch was 2 and is 3"]);
        let moved = Fingerprint::default().option("ratio", 0.1).option("batch", 2).digest("asset", "b");
        assert_eq!(told(&base, &moved), ["asset is not the same"]);
    }
}

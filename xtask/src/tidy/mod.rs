//! Rules about the workspace that the compiler does not check.

mod architecture;
mod layers;
pub(crate) mod metadata;
mod sources;

use std::path::Path;

use anyhow::{Result, bail};

use crate::shell::{cargo_output, run_cargo};
use metadata::Workspace;

/// What the rules found: each line names the place and the rule.
#[derive(Debug, Default)]
struct Findings {
    errors: Vec<String>,
    warnings: Vec<String>,
}

impl Findings {
    fn error(&mut self, place: impl std::fmt::Display, rule: impl std::fmt::Display) {
        self.errors.push(format!("{place}: {rule}"));
    }

    fn warning(&mut self, place: impl std::fmt::Display, rule: impl std::fmt::Display) {
        self.warnings.push(format!("{place}: {rule}"));
    }
}

/// Checks formatting and all rules; lists everything found before it fails.
pub(crate) fn run() -> Result<()> {
    let formatted = run_cargo(&["fmt", "--all", "--check"]);
    let workspace = Workspace::read()?;
    let root = Path::new(".");
    let mut findings = Findings::default();
    layers::check(&workspace.crates, &mut findings);
    sources::check(root, &mut findings)?;
    architecture::check(root, &workspace.crates, &mut findings)?;
    one_glam(&cargo_output(&["tree", "--workspace", "--target", "all", "--prefix", "none"])?, &mut findings);
    for warning in &findings.warnings {
        println!("warning: {warning}");
    }
    for error in &findings.errors {
        println!("error: {error}");
    }
    println!("tidy: {} errors, {} warnings", findings.errors.len(), findings.warnings.len());
    formatted?;
    if !findings.errors.is_empty() {
        bail!("tidy: {} errors", findings.errors.len());
    }
    Ok(())
}

/// Two versions of glam make two incompatible `Vec3`.
///
/// The compiled tree counts: the lock file also lists versions that nalgebra could convert to.
fn one_glam(tree: &str, findings: &mut Findings) {
    let mut versions: Vec<&str> = tree
        .lines()
        .filter_map(|line| line.strip_prefix("glam v"))
        .filter_map(|rest| rest.split_whitespace().next())
        .collect();
    versions.sort_unstable();
    versions.dedup();
    if versions.len() > 1 {
        findings.error("cargo tree", format_args!("one glam in the tree, found {}", versions.join(", ")));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_glam_is_an_error() {
        let mut findings = Findings::default();
        one_glam("photofit v0.1.0 (/w)\nglam v0.34.2\nglam v0.34.2 (*)\nglamour v1.0.0", &mut findings);
        assert!(findings.errors.is_empty(), "{:?}", findings.errors);
        one_glam("glam v0.34.2\nglam v0.33.12", &mut findings);
        assert_eq!(findings.errors, ["cargo tree: one glam in the tree, found 0.33.12, 0.34.2"]);
    }
}

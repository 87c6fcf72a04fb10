//! Rules about single source files: opening sentence, length, names, unfinished code.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::Findings;

/// Lines above which a file draws a warning, and an error.
const LONG: usize = 300;
const TOO_LONG: usize = 600;

/// Names that say nothing about what is inside.
const EMPTY_NAMES: &[&str] = &["utils", "util", "common", "helpers", "misc"];

/// Assembled, so that this file does not find itself.
const UNFINISHED: &[&str] = &[concat!("todo", "!("), concat!("unimplemented", "!(")];

/// An ignored test that does not say why.
const SILENT_SKIP: &str = "#[ignore]";

/// Rules that messages state as if they held; with "must" beside them they say what must be.
const RULES: &[&str] =
    &["is finite", "are finite", "is positive", "are positive", "is not negative", "lies in", "is one of"];

pub(super) fn check(root: &Path, findings: &mut Findings) -> Result<()> {
    for folder in ["crates", "tests", "xtask"] {
        let mut files = Vec::new();
        walk(&root.join(folder), &mut files)?;
        files.sort_unstable();
        for path in files {
            let shown = path.strip_prefix(root).unwrap_or(&path).to_path_buf();
            if let Some(name) = empty_name(&shown) {
                findings.error(shown.display(), format_args!("`{name}` says nothing, name what is inside"));
            }
            let is_rust = path.extension().is_some_and(|e| e == "rs");
            if is_rust || path.extension().is_some_and(|e| e == "wgsl") {
                let text =
                    fs::read_to_string(&path).with_context(|| format!("{}: cannot read", path.display()))?;
                check_text(&shown, &text, is_rust, findings);
            }
        }
    }
    Ok(())
}

fn walk(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    for entry in fs::read_dir(folder).with_context(|| format!("{}: cannot list", folder.display()))? {
        let entry = entry?;
        let path = entry.path();
        if !entry.file_type()?.is_dir() {
            files.push(path);
        } else if entry.file_name() != "target" {
            walk(&path, files)?;
        }
    }
    Ok(())
}

/// A part of the path (extension aside) that is no name.
fn empty_name(path: &Path) -> Option<String> {
    path.iter().find_map(|part| {
        let stem = part.to_str()?.split('.').next()?;
        let last = stem.rsplit('_').next()?;
        EMPTY_NAMES.contains(&last).then(|| stem.to_owned())
    })
}

fn check_text(path: &Path, text: &str, is_rust: bool, findings: &mut Findings) {
    let lines = text.lines().count();
    if lines > TOO_LONG {
        findings.error(path.display(), format_args!("{lines} lines, at most {TOO_LONG}"));
    } else if lines > LONG {
        findings.warning(path.display(), format_args!("{lines} lines, more than {LONG}"));
    }
    if !is_rust {
        return;
    }
    if !text.starts_with("//!") {
        findings.error(path.display(), "does not open with a `//!` sentence");
    }
    stated_rules(path, text, findings);
    for (number, line) in text.lines().enumerate() {
        let code = line.split("//").next().unwrap_or(line);
        if code.trim() == SILENT_SKIP {
            findings
                .error(format_args!("{}:{}", path.display(), number + 1), "an ignored test gives its reason");
        }
        if let Some(found) = UNFINISHED.iter().find(|word| code.contains(**word)) {
            findings.error(
                format_args!("{}:{}", path.display(), number + 1),
                format_args!("unfinished: {found}"),
            );
        }
    }
}

/// Lines of messages that state a rule without saying that it must hold. Assertions and tests may.
fn stated_rules(path: &Path, text: &str, findings: &mut Findings) {
    let place = path.to_string_lossy();
    if !(place.starts_with("crates/") && place.contains("/src/"))
        || ["/tests", "/validation/"].iter().any(|part| place.contains(part))
    {
        return;
    }
    let code = text.split("#[cfg(test)]").next().unwrap_or(text);
    for (number, _) in code.lines().enumerate().filter(|(_, line)| states_rule(line)) {
        let at = format!("{}:{}", path.display(), number + 1);
        let rule = "a message says that a rule holds; it must say what is and what must be";
        findings.error(at, rule);
    }
}

/// Whether a string of a line, which is no comment and no reason of an assertion, states one of [`RULES`].
fn states_rule(line: &str) -> bool {
    let line = line.trim();
    let aside = ["//", "assert", "debug_assert", ".expect(", "reason ="];
    if aside.iter().any(|a| line.starts_with(a)) || line.contains("expect(\"") || line.contains("must") {
        return false;
    }
    // Every second part between quotes is a string.
    line.split('"').skip(1).step_by(2).any(|text| RULES.iter().any(|rule| text.contains(rule)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn findings(path: &str, text: &str) -> (usize, usize) {
        let mut findings = Findings::default();
        check_text(Path::new(path), text, true, &mut findings);
        (findings.errors.len(), findings.warnings.len())
    }

    #[test]
    fn file_rules() {
        let long = |n: usize| format!("//! Long.\n{}", "\n".repeat(n - 1));
        assert_eq!(findings("a.rs", "//! Good.\nfn f() {}\n"), (0, 0));
        assert_eq!(findings("a.rs", "fn f() {}\n"), (1, 0));
        assert_eq!(findings("a.rs", &long(300)), (0, 0));
        assert_eq!(findings("a.rs", &long(301)), (0, 1));
        assert_eq!(findings("a.rs", &long(601)), (1, 0));
        let unfinished = format!("//! Half.\nfn f() {{ {}) }}\n", UNFINISHED[0]);
        assert_eq!(findings("a.rs", &unfinished), (1, 0));
        assert_eq!(findings("a.rs", &format!("//! Skips.\n    {SILENT_SKIP}\n")), (1, 0));
        assert_eq!(findings("a.rs", "//! Skips.\n#[ignore = \"takes a minute\"]\n"), (0, 0));
        let mentioned = format!("//! Whole.\n// no {}) here\n", UNFINISHED[0]);
        assert_eq!(findings("a.rs", &mentioned), (0, 0));
    }

    #[test]
    fn messages_say_what_must_be() {
        let of = |line: &str| findings("crates/rays/src/a.rs", &format!("//! A file.\n{line}\n"));
        let stated = concat!("    fail(\"the scale is ", "finite\")");
        assert_eq!(of(stated), (1, 0));
        assert_eq!(of(concat!("    return Err(\"g lies ", "in [0, 1], found 2\".into());")), (1, 0));
        assert_eq!(of("    fail(format!(\"the scale is {s}; it must be finite\"))"), (0, 0));
        assert_eq!(of(concat!("    // the scale is ", "finite")), (0, 0));
        assert_eq!(of(concat!("    assert!(x, \"the scale is ", "finite\");")), (0, 0));
        assert_eq!(findings("crates/rays/src/tests/a.rs", &format!("//! A file.\n{stated}\n")), (0, 0));
    }

    #[test]
    fn names_that_say_nothing() {
        for (path, found) in [
            ("crates/raster/src/common/mod.rs", true),
            ("crates/raster/src/mesh_utils.rs", true),
            ("crates/util/src/lib.rs", true),
            ("crates/raster/src/interpolate/mod.rs", false),
            ("crates/raster/src/commonness.rs", false),
        ] {
            assert_eq!(empty_name(Path::new(path)).is_some(), found, "{path}");
        }
    }
}

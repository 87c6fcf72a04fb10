//! ARCHITECTURE.md and docs/ against the tree: no path, crate or source that is gone or missing.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use super::Findings;
use super::metadata::Crate;

const BIBLIOGRAPHY: &str = "docs/references.bib";

pub(super) fn check(root: &Path, crates: &[Crate], findings: &mut Findings) -> Result<()> {
    let text = read(root, "ARCHITECTURE.md")?;
    for path in paths(&text) {
        if !root.join(&path).exists() {
            findings.error("ARCHITECTURE.md", format_args!("`{path}` does not exist"));
        }
    }
    for folder in crates.iter().filter_map(|c| crate_folder(&c.folder)) {
        if !text.contains(&format!("`crates/{folder}`")) {
            findings.error("ARCHITECTURE.md", format_args!("the code map lacks `crates/{folder}`"));
        }
        let page = format!("docs/crates/{folder}.md");
        if !root.join(&page).is_file() {
            findings.error(&page, "every crate has a page");
        }
    }
    let bibliography = read(root, BIBLIOGRAPHY)?;
    let known = bibliography_keys(&bibliography);
    let mut pages = vec!["README.md".to_owned(), "ARCHITECTURE.md".to_owned(), "CONTRIBUTING.md".to_owned()];
    markdown_files(root, "docs", &mut pages)?;
    for page in pages {
        let text = read(root, &page)?;
        for key in citations(&text).filter(|key| !known.contains(*key)) {
            findings.error(&page, format_args!("[@{key}] is not in {BIBLIOGRAPHY}"));
        }
        let folder = Path::new(&page).parent().unwrap_or(Path::new(""));
        for link in links(&text).filter(|link| !root.join(folder).join(link).exists()) {
            findings.error(&page, format_args!("links to {link}, which does not exist"));
        }
    }
    Ok(())
}

fn read(root: &Path, name: &str) -> Result<String> {
    fs::read_to_string(root.join(name)).with_context(|| format!("{name}: cannot read"))
}

/// `raster` for `.../crates/raster`.
fn crate_folder(folder: &Path) -> Option<&str> {
    let inside = folder.parent()?.file_name()? == "crates";
    inside.then(|| folder.file_name()?.to_str()).flatten()
}

fn markdown_files(root: &Path, folder: &str, pages: &mut Vec<String>) -> Result<()> {
    let list = fs::read_dir(root.join(folder)).with_context(|| format!("{folder}: cannot list"))?;
    for entry in list {
        let entry = entry?;
        let name = format!("{folder}/{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            markdown_files(root, &name, pages)?;
        } else if name.ends_with(".md") {
            pages.push(name);
        }
    }
    Ok(())
}

/// Words in backticks that look like a path of the repository; what is generated or a pattern is left out.
fn paths(text: &str) -> BTreeSet<String> {
    let inline = text.lines().filter(|line| !line.starts_with("    ") && !line.starts_with("```"));
    inline
        .flat_map(|line| line.split('`').skip(1).step_by(2))
        .filter(|word| looks_like_path(word))
        .map(str::to_owned)
        .collect()
}

fn looks_like_path(word: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '/' | '.' | '-' | '_');
    let generated = ["target/", "out/", "/"].iter().any(|start| word.starts_with(start));
    let named = [".md", ".rs", ".toml", ".bib", ".wgsl"]
        .iter()
        .any(|end| word.len() > end.len() && word.ends_with(end));
    word.chars().all(plain) && !generated && (word.contains('/') || named)
}

/// Keys of `@kind{key,` entries.
fn bibliography_keys(text: &str) -> BTreeSet<&str> {
    let entries = text.lines().filter(|line| line.starts_with('@'));
    entries.filter_map(|line| line.split_once('{')?.1.strip_suffix(',')).collect()
}

/// Keys of `[@key]` citations.
fn citations(text: &str) -> impl Iterator<Item = &str> {
    text.split("[@")
        .skip(1)
        .filter_map(|rest| Some(rest.split_once(']')?.0))
        .flat_map(|keys| keys.split("; @"))
}

/// Relative targets of Markdown links, without their anchor.
fn links(text: &str) -> impl Iterator<Item = &str> {
    text.split("](")
        .skip(1)
        .filter_map(|rest| Some(rest.split_once(')')?.0))
        .map(|target| target.split('#').next().unwrap_or(target))
        .filter(|target| !target.is_empty() && !target.contains(':'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_in_backticks() {
        let text = "See `crates/raster/src/lib.rs`, `deny.toml`, `out/bench`, `wi/wo ratio`, `Vec<T>`, `a::b`, `.ci/run`,\n\
                    `crates/*/src` and `photofit`.\n    `crates/in/a/code/block`\n";
        let found: Vec<String> = paths(text).into_iter().collect();
        assert_eq!(found, [".ci/run", "crates/raster/src/lib.rs", "deny.toml"]);
    }

    #[test]
    fn citations_and_keys() {
        let keys = bibliography_keys("@article{laine2020,\n title={A},\n}\n@misc{x,\n}\n");
        assert_eq!(keys.into_iter().collect::<Vec<_>>(), ["laine2020", "x"]);
        let cited: Vec<&str> = citations("as in [@laine2020] and [@a; @b].").collect();
        assert_eq!(cited, ["laine2020", "a", "b"]);
    }

    #[test]
    fn relative_links_only() {
        let found: Vec<&str> = links("[a](docs/a.md#part) [b](https://b.org/c) [c](#here)").collect();
        assert_eq!(found, ["docs/a.md"]);
    }
}

//! The release archive: program, readme, changelog, licences of all dependencies.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;
use std::{env, fs};

use anyhow::{Context, Result, bail};
use serde_json::Value;

use crate::shell::{cargo_output, run_cargo};
use crate::tidy::metadata::Workspace;

/// Builds the program and packs it into `out/dist`.
pub(crate) fn run() -> Result<()> {
    run_cargo(&["build", "--profile", "dist", "-p", "photofit-cli"])?;
    let workspace = Workspace::read()?;
    let name =
        format!("photofit-{}-{}-{}", workspace.version("photofit-cli")?, env::consts::ARCH, env::consts::OS);
    let dist = Path::new("out/dist");
    let folder = dist.join(&name);
    if folder.exists() {
        fs::remove_dir_all(&folder).with_context(|| format!("{}: cannot clear", folder.display()))?;
    }
    fs::create_dir_all(&folder).with_context(|| format!("{}: cannot create", folder.display()))?;
    let program = format!("photofit{}", env::consts::EXE_SUFFIX);
    copy(&workspace.target_directory.join("dist").join(&program), &folder.join(&program))?;
    for file in ["README.md", "CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE"] {
        copy(Path::new(file), &folder.join(file))?;
    }
    third_party_licences(&folder)?;
    let archive = format!("{name}.tar.gz");
    let status = Command::new("tar")
        .args(["-czf", &archive, &name])
        .current_dir(dist)
        .status()
        .context("tar: cannot start")?;
    if !status.success() {
        bail!("tar: {status}");
    }
    println!("{}", dist.join(archive).display());
    Ok(())
}

fn copy(from: &Path, to: &Path) -> Result<()> {
    fs::copy(from, to).with_context(|| format!("{} -> {}: cannot copy", from.display(), to.display()))?;
    Ok(())
}

/// Copies the licence texts of each crate compiled into the program to `licences/NAME-VERSION`, and lists them.
fn third_party_licences(folder: &Path) -> Result<()> {
    let tree = cargo_output(&["tree", "-p", "photofit-cli", "--edges", "normal", "--prefix", "none"])?;
    let compiled: BTreeSet<(&str, &str)> = tree.lines().filter_map(name_and_version).collect();
    let json = cargo_output(&["metadata", "--format-version", "1"])?;
    let json: Value = serde_json::from_str(&json).context("cargo metadata: not JSON")?;
    let mut list = String::from("Crates compiled into the program and their licences\n\n");
    for package in json["packages"].as_array().context("cargo metadata: no packages")? {
        let text = |key: &str| package[key].as_str().unwrap_or_default();
        let (name, version) = (text("name"), text("version"));
        if package["source"].is_null() || !compiled.contains(&(name, version)) {
            continue;
        }
        writeln!(list, "{name} {version}: {}", text("license"))?;
        let source = Path::new(text("manifest_path")).parent().unwrap_or(Path::new("."));
        let target = folder.join("licences").join(format!("{name}-{version}"));
        fs::create_dir_all(&target).with_context(|| format!("{}: cannot create", target.display()))?;
        for entry in fs::read_dir(source).with_context(|| format!("{}: cannot list", source.display()))? {
            let entry = entry?;
            if entry.file_type()?.is_file() && is_licence(&entry.file_name().to_string_lossy()) {
                copy(&entry.path(), &target.join(entry.file_name()))?;
            }
        }
    }
    fs::write(folder.join("licences/LIST.txt"), list).context("licences/LIST.txt: cannot write")
}

/// `("glam", "0.34.2")` from a line `glam v0.34.2 (*)`.
fn name_and_version(line: &str) -> Option<(&str, &str)> {
    let mut words = line.split_whitespace();
    Some((words.next()?, words.next()?.strip_prefix('v')?))
}

fn is_licence(file: &str) -> bool {
    let upper = file.to_ascii_uppercase();
    ["LICENSE", "LICENCE", "COPYING", "COPYRIGHT", "NOTICE", "UNLICENSE"]
        .iter()
        .any(|start| upper.starts_with(start))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_cargo_tree() {
        assert_eq!(name_and_version("glam v0.34.2 (*)"), Some(("glam", "0.34.2")));
        assert_eq!(name_and_version(""), None);
        assert!(is_licence("LICENSE-MIT") && is_licence("license.txt") && !is_licence("lib.rs"));
    }
}

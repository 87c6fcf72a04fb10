//! Judges glTF files by the validator and the asset auditor of Khronos, which node runs.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::shell::is_installed;

/// The script and the list of its packages.
const SOURCES: &str = "crates/bench/peers/judge";
/// Where node finds both, packages beside them.
const INSTALLED: &str = "target/judge";
const FILES: [&str; 2] = ["package.json", "judge.mjs"];

/// `judge FILE...`, paths from the folder `here` on: an error where the validator finds an error or a warning.
pub(crate) fn run(files: &[String], here: &Path) -> Result<()> {
    if files.is_empty() {
        bail!("expected `judge FILE...`, .glb or .gltf");
    }
    for program in ["node", "npm"] {
        if !is_installed(program, &[]) {
            bail!("{program}: is not on the path; `apt-get install nodejs npm` brings it");
        }
    }
    let script = install()?;
    let files = files.iter().map(|file| here.join(file));
    let status = Command::new("node").arg(script).args(files).status().context("node: cannot start")?;
    if !status.success() {
        bail!("judge: a file is not clean");
    }
    Ok(())
}

/// Copies the script and installs its packages where they are not those of the list; the path of the script.
fn install() -> Result<PathBuf> {
    let (sources, installed) = (Path::new(SOURCES), Path::new(INSTALLED));
    fs::create_dir_all(installed).with_context(|| format!("{INSTALLED}: cannot create"))?;
    let list = |folder: &Path| fs::read(folder.join(FILES[0])).ok();
    let current = list(sources) == list(installed) && installed.join("node_modules").is_dir();
    for name in FILES {
        let from = sources.join(name);
        fs::copy(&from, installed.join(name)).with_context(|| format!("{}: cannot copy", from.display()))?;
    }
    if !current {
        // No scripts of packages run: what is needed comes built.
        let install = ["install", "--ignore-scripts", "--no-audit", "--no-fund", "--prefix", INSTALLED];
        let status = Command::new("npm").args(install).status().context("npm: cannot start")?;
        if !status.success() {
            // The next try installs again.
            fs::remove_file(installed.join(FILES[0]))
                .with_context(|| format!("{INSTALLED}: cannot remove"))?;
            bail!("npm install: {status}");
        }
    }
    Ok(installed.join(FILES[1]))
}

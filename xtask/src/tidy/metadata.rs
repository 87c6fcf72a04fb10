//! The workspace as `cargo metadata` describes it.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde_json::Value;

use crate::shell::cargo_output;

/// The packages of the workspace.
#[derive(Debug)]
pub(crate) struct Workspace {
    pub(crate) crates: Vec<Crate>,
    pub(crate) target_directory: PathBuf,
}

/// One package of the workspace.
#[derive(Debug)]
pub(crate) struct Crate {
    /// Package name.
    pub(crate) name: String,
    pub(crate) version: String,
    /// Folder of its manifest.
    pub(crate) folder: PathBuf,
    /// Sorted.
    pub(crate) features: Vec<String>,
    /// All direct dependencies, those outside the workspace included.
    pub(crate) dependencies: Vec<Dependency>,
}

/// One direct dependency.
#[derive(Clone, Debug)]
pub(crate) struct Dependency {
    pub(crate) name: String,
    pub(crate) dev: bool,
    pub(crate) optional: bool,
}

impl Workspace {
    /// Asks cargo.
    pub(crate) fn read() -> Result<Self> {
        let text = cargo_output(&["metadata", "--format-version", "1", "--no-deps"])?;
        let json: Value = serde_json::from_str(&text).context("cargo metadata: not JSON")?;
        Self::from_json(&json)
    }

    fn from_json(json: &Value) -> Result<Self> {
        let packages = json["packages"].as_array().context("cargo metadata: no packages")?;
        Ok(Self {
            crates: packages.iter().map(Crate::from_json).collect::<Result<_>>()?,
            target_directory: PathBuf::from(text(&json["target_directory"], "target_directory")?),
        })
    }

    /// Version of a package.
    pub(crate) fn version(&self, package: &str) -> Result<&str> {
        self.find(package)
            .map(|found| found.version.as_str())
            .with_context(|| format!("no package {package}"))
    }

    fn find(&self, package: &str) -> Option<&Crate> {
        self.crates.iter().find(|c| c.name == package)
    }
}

impl Crate {
    fn from_json(json: &Value) -> Result<Self> {
        let manifest = PathBuf::from(text(&json["manifest_path"], "manifest_path")?);
        let mut features: Vec<String> =
            json["features"].as_object().map(|map| map.keys().cloned().collect()).unwrap_or_default();
        features.sort_unstable();
        let dependencies = json["dependencies"].as_array().context("cargo metadata: no dependencies")?;
        Ok(Self {
            name: text(&json["name"], "name")?,
            version: text(&json["version"], "version")?,
            folder: manifest.parent().unwrap_or(Path::new(".")).to_path_buf(),
            features,
            dependencies: dependencies.iter().map(Dependency::from_json).collect::<Result<_>>()?,
        })
    }
}

impl Dependency {
    fn from_json(json: &Value) -> Result<Self> {
        Ok(Self {
            name: text(&json["name"], "name")?,
            dev: json["kind"].as_str() == Some("dev"),
            optional: json["optional"].as_bool().unwrap_or(false),
        })
    }
}

fn text(value: &Value, key: &str) -> Result<String> {
    value.as_str().map(str::to_owned).with_context(|| format!("cargo metadata: no {key}"))
}

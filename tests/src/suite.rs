//! Running cases against a folder of golden files.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use photofit_image::Image;

use crate::cases::Case;
use crate::compare::{Difference, compare};
use crate::store;

/// What became of one case.
#[derive(Debug)]
pub struct Outcome {
    /// The case.
    pub case: &'static Case,
    /// What the code makes now.
    pub actual: Image,
    /// The golden image, where it can be read.
    pub expected: Option<Image>,
    /// The comparison, or why there is none.
    pub result: Result<Difference, String>,
}

impl Outcome {
    /// Whether the image lies within its tolerance.
    pub fn passed(&self) -> bool {
        self.result.as_ref().is_ok_and(|difference| difference.within)
    }

    /// One line for a person.
    pub fn summary(&self) -> String {
        let name = self.case.name;
        match &self.result {
            Ok(d) if d.within => {
                format!("{name}: largest difference {:.2e}, bound {:.2e}", d.largest, d.bound)
            }
            Ok(d) => format!(
                "{name}: {} of {} pixels outside {:.2e}, largest difference {:.2e} at ({}, {})",
                d.outliers, d.pixels, d.bound, d.largest, d.at.0, d.at.1
            ),
            Err(why) => format!("{name}: {why}"),
        }
    }
}

/// The folder of the golden files.
pub fn golden_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden")
}

/// Where the report goes: `target/golden/report.html`.
pub fn report_path() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| PathBuf::from("target"), PathBuf::from);
    root.join(target).join("golden/report.html")
}

/// Makes each case's image and compares it with its file; writes nothing.
pub fn run(cases: &'static [Case], folder: &Path) -> Vec<Outcome> {
    cases.iter().map(|case| run_one(case, folder)).collect()
}

fn run_one(case: &'static Case, folder: &Path) -> Outcome {
    let actual = (case.make)();
    let (expected, result) = match store::read(&store::path(folder, case.name, case.format), case.format) {
        Ok(expected) => {
            let result = compare(&actual, &expected, case.format.step(), &case.tolerance);
            (Some(expected), result)
        }
        Err(error) => {
            (None, Err(format!("{error:#}; after a look: cargo xtask golden accept {}", case.name)))
        }
    };
    Outcome { case, actual, expected, result }
}

/// Writes the golden files of the cases named.
///
/// # Errors
/// If a name is no case (nothing is written then) or a file cannot be written.
pub fn accept(cases: &'static [Case], folder: &Path, names: &[String]) -> Result<Vec<PathBuf>> {
    let mut chosen = Vec::new();
    for name in names {
        match cases.iter().find(|case| case.name == name) {
            Some(case) => chosen.push(case),
            None => bail!("no golden case `{name}`; there are: {}", list(cases)),
        }
    }
    fs::create_dir_all(folder).with_context(|| format!("{}: cannot create", folder.display()))?;
    let mut written = Vec::new();
    for case in chosen {
        let path = store::path(folder, case.name, case.format);
        store::write(&path, case.format, &(case.make)())?;
        written.push(path);
    }
    Ok(written)
}

fn list(cases: &[Case]) -> String {
    cases.iter().map(|case| case.name).collect::<Vec<_>>().join(", ")
}

/// Golden files that belong to no case, sorted.
///
/// # Errors
/// If the folder cannot be listed.
pub fn orphans(cases: &[Case], folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).with_context(|| format!("{}: cannot list", folder.display()))? {
        let path = entry?.path();
        let known = cases.iter().any(|case| store::path(folder, case.name, case.format) == path);
        let image = ["png", "exr", "tmp"].iter().any(|e| path.extension() == Some(OsStr::new(e)));
        if image && !known {
            found.push(path);
        }
    }
    found.sort_unstable();
    Ok(found)
}

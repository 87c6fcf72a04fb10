//! Checks of the places that a command will write to, before it starts work.

use anyhow::{Result, bail};
use std::ffi::OsStr;
use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};

/// Checks a file that will be written: its ending, its folder, and that it is no folder itself.
///
/// # Errors
/// The rule that is broken.
pub(crate) fn file(path: &Path, endings: &[&str]) -> Result<()> {
    let shown = path.display();
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    if !endings.is_empty() && !endings.contains(&ending.as_str()) {
        let list: Vec<String> = endings.iter().map(|e| format!(".{e}")).collect();
        bail!("{shown}: the name of the output ends in {}", list.join(" or "));
    }
    if path.file_name().is_none() || path.is_dir() {
        bail!("{shown}: the output is a file, not a folder");
    }
    let folder = parent(path);
    if !folder.exists() {
        bail!("{shown}: cannot be written: the folder {} does not exist", folder.display());
    }
    if !folder.is_dir() {
        bail!("{shown}: cannot be written: {} is not a folder", folder.display());
    }
    writable(&folder).map_err(|e| anyhow::anyhow!("{shown}: cannot be written: {}: {e}", folder.display()))
}

/// Checks a folder that will be made when it does not exist.
///
/// # Errors
/// The rule that is broken.
pub(crate) fn folder(path: &Path) -> Result<()> {
    let shown = path.display();
    let mut existing = path.to_owned();
    while !existing.exists() {
        existing = parent(&existing);
    }
    if !existing.is_dir() {
        bail!("{shown}: cannot be made: {} is not a folder", existing.display());
    }
    writable(&existing)
        .map_err(|e| anyhow::anyhow!("{shown}: cannot be written: {}: {e}", existing.display()))
}

/// Checks that an output is not the input.
///
/// # Errors
/// When it is.
pub(crate) fn distinct(input: &Path, output: &Path) -> Result<()> {
    if let (Ok(a), Ok(b)) = (input.canonicalize(), output.canonicalize())
        && a == b
    {
        bail!("{}: the output is another file than the input", output.display());
    }
    Ok(())
}

fn parent(path: &Path) -> PathBuf {
    match path.parent() {
        Some(p) if p.as_os_str() != OsStr::new("") => p.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// Makes and removes a file.
fn writable(folder: &Path) -> std::io::Result<()> {
    let probe = folder.join(format!(".photofit-{}.probe", std::process::id()));
    let made: std::io::Result<File> = OpenOptions::new().write(true).create_new(true).open(&probe);
    made?;
    std::fs::remove_file(&probe)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_checked_and_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        let d = dir.path();
        std::fs::write(d.join("plain"), b"x").unwrap();
        let rule = |r: Result<()>| r.err().map(|e| e.to_string()).unwrap_or_default();
        assert_eq!(rule(file(&d.join("a.glb"), &["glb"])), "");
        assert_eq!(rule(file(&d.join("a.GLB"), &["glb"])), "");
        assert!(rule(file(&d.join("a.txt"), &["png", "exr"])).contains("ends in .png or .exr"));
        assert!(rule(file(&d.join("no/a.glb"), &["glb"])).contains("does not exist"));
        assert!(rule(file(&d.join("plain/a.glb"), &["glb"])).contains("is not a folder"));
        assert!(rule(file(d, &[])).contains("is a file"));
        assert_eq!(rule(folder(&d.join("new/deep"))), "");
        assert!(rule(folder(&d.join("plain/deep"))).contains("is not a folder"));
        assert!(rule(distinct(&d.join("plain"), &d.join("./plain"))).contains("another file"));
        assert_eq!(std::fs::read_dir(d).unwrap().count(), 1, "nothing was left behind");
    }
}

//! Writing a file under a temporary name and renaming it.

use crate::ImageError;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Writes `bytes` to a temporary name in the folder of `path` and renames it, so that `path` holds either its old
/// content or all of the new one, and a failure leaves nothing behind. Where `path` is a symbolic link, the file that it leads to
/// is replaced, and the link stays.
///
/// # Errors
/// If the folder does not exist, or the file system refuses.
pub fn write_atomically(path: impl AsRef<Path>, bytes: &[u8]) -> Result<(), ImageError> {
    let path = path.as_ref();
    write_with(path, |file| file.write_all(bytes)).map_err(|e| ImageError::io(path, e))
}

/// Renames a file to the same name with `.bak` behind it, or, where files of that name are kept already, with `.bak2`,
/// `.bak3` and so on: none of them is replaced. The new name, or `None` where there is no such file.
///
/// # Errors
/// If the file system refuses.
pub fn set_aside(path: impl AsRef<Path>) -> Result<Option<PathBuf>, ImageError> {
    let path = path.as_ref();
    let mut kept = named(path, ".bak");
    let mut number = 2_u64;
    while kept.symlink_metadata().is_ok() {
        kept = named(path, &format!(".bak{number}"));
        number += 1;
    }
    match std::fs::rename(path, &kept) {
        Ok(()) => Ok(Some(kept)),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        Err(e) => Err(ImageError::io(path, e)),
    }
}

/// A path with something behind its name.
fn named(path: &Path, more: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(more);
    name.into()
}

/// Removes the temporary file unless it was renamed.
struct Temporary {
    path: PathBuf,
    renamed: bool,
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if !self.renamed {
            // Nothing more can be done about a file that refuses to go.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

fn create_beside(path: &Path) -> std::io::Result<(File, Temporary)> {
    static COUNTER: AtomicU64 = AtomicU64::new(0);
    let name = path
        .file_name()
        .ok_or_else(|| std::io::Error::new(ErrorKind::InvalidInput, "a path without file name"))?;
    loop {
        let mut temporary = std::ffi::OsString::from(".");
        temporary.push(name);
        let n = COUNTER.fetch_add(1, Ordering::Relaxed);
        temporary.push(format!(".{}-{n}.tmp", std::process::id()));
        let temporary = path.with_file_name(temporary);
        match OpenOptions::new().write(true).read(true).create_new(true).open(&temporary) {
            Ok(file) => return Ok((file, Temporary { path: temporary, renamed: false })),
            Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
            Err(e) => return Err(e),
        }
    }
}

/// Most links that lead from one to the next, as systems have it.
const MOST_LINKS: usize = 40;

/// What a path leads to when symbolic links in its last part are followed; it need not exist. That is what is written where
/// the path is an output.
///
/// # Errors
/// If the links lead in a circle, or there are more than a system follows.
pub fn link_target(path: impl AsRef<Path>) -> std::io::Result<PathBuf> {
    let mut at = path.as_ref().to_owned();
    for _ in 0..=MOST_LINKS {
        let Ok(link) = std::fs::read_link(&at) else { return Ok(at) };
        // Relative to the folder of the link.
        at = at.parent().unwrap_or(Path::new("")).join(link);
    }
    Err(std::io::Error::other("too many symbolic links lead from one to the next"))
}

pub(crate) fn write_with<E: From<std::io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
) -> Result<(), E> {
    let path = &link_target(path)?;
    let (file, mut temporary) = create_beside(path)?;
    let mut writer = BufWriter::new(file);
    write(&mut writer)?;
    // Closed before the rename, which other systems demand.
    drop(writer.into_inner().map_err(std::io::IntoInnerError::into_error)?);
    std::fs::rename(&temporary.path, path)?;
    temporary.renamed = true;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = std::fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn files_that_are_set_aside_replace_no_earlier_ones() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("a.state");
        assert_eq!(set_aside(&file).unwrap(), None);
        for text in ["first", "second", "third"] {
            std::fs::write(&file, text).unwrap();
            let kept = set_aside(&file).unwrap().unwrap();
            assert_eq!(std::fs::read_to_string(kept).unwrap(), text);
        }
        assert_eq!(names(dir.path()), ["a.state.bak", "a.state.bak2", "a.state.bak3"]);
        assert_eq!(std::fs::read(dir.path().join("a.state.bak")).unwrap(), b"first");
    }

    #[cfg(unix)]
    #[test]
    fn links_stay_and_what_they_lead_to_is_replaced() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("there")).unwrap();
        std::fs::write(at("there/real"), b"old").unwrap();
        symlink("there/real", at("link")).unwrap();
        symlink("link", at("second")).unwrap();
        symlink("there/new", at("dangling")).unwrap();
        symlink("loop", at("loop")).unwrap();
        write_atomically(at("second"), b"one").unwrap();
        write_atomically(at("dangling"), b"two").unwrap();
        assert_eq!(std::fs::read(at("there/real")).unwrap(), b"one");
        assert_eq!(std::fs::read(at("there/new")).unwrap(), b"two");
        assert!(["link", "second", "dangling"].iter().all(|l| at(l).is_symlink()));
        assert!(write_atomically(at("loop"), b"").unwrap_err().to_string().contains("links"));
        assert_eq!(names(&at("there")), ["new", "real"]);
    }

    #[test]
    fn replaces_whole_files_and_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        write_atomically(&path, b"one").unwrap();
        write_atomically(&path, b"two").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
        let failed: Result<(), std::io::Error> = write_with(&path, |file| {
            file.write_all(b"half")?;
            Err(std::io::Error::other("stop"))
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"two", "the old content stays");
        let taken = folder.path().join("folder");
        std::fs::create_dir_all(taken.join("x")).unwrap();
        assert!(write_atomically(&taken, b"no").is_err(), "a folder is not replaced");
        assert_eq!(names(folder.path()), ["a.bin", "folder"]);
        let missing = folder.path().join("no/such/file.png");
        let message = write_atomically(&missing, b"").unwrap_err().to_string();
        assert!(message.contains("no/such/file.png"), "{message}");
    }
}

//! What a command reads and writes, checked before it starts work: every output can be written, and none of them is an
//! input or another output.

use crate::status::Misuse;
use anyhow::{Result, anyhow, bail};
use photofit_image::link_target;
use std::ffi::OsStr;
use std::fs::{File, OpenOptions};
use std::path::{Component, Path, PathBuf};

/// The files of a command.
#[derive(Debug, Default)]
pub(crate) struct Places {
    inputs: Vec<Place>,
    outputs: Vec<Place>,
    folders: Vec<Place>,
}

/// One file or folder, and the option that names it.
#[derive(Debug)]
struct Place {
    option: &'static str,
    path: PathBuf,
    identity: Identity,
    /// Whether it stands in a folder of the command, which may not exist yet.
    inside: bool,
    /// Whether an earlier file there is kept beside it, with `.bak` and a number behind its name.
    keeps: bool,
}

impl Place {
    fn new(option: &'static str, path: &Path) -> Self {
        Self { option, path: path.to_owned(), identity: Identity::of(path), inside: false, keeps: false }
    }
}

impl Places {
    /// Adds a file that is read, where the option is given.
    pub(crate) fn reads(mut self, option: &'static str, path: Option<&Path>) -> Self {
        self.inputs.extend(path.map(|p| Place::new(option, p)));
        self
    }

    /// Adds a file that is written, where the option is given.
    pub(crate) fn writes(mut self, option: &'static str, path: Option<&Path>) -> Self {
        self.outputs.extend(path.map(|p| Place::new(option, p)));
        self
    }

    /// As [`Self::writes`], where an earlier file is kept under another name.
    pub(crate) fn sets_aside(mut self, option: &'static str, path: Option<&Path>) -> Self {
        self.outputs.extend(path.map(|p| Place { keeps: true, ..Place::new(option, p) }));
        self
    }

    /// Adds a folder that is made where it does not exist, and the files in it that are written.
    pub(crate) fn fills(mut self, option: &'static str, folder: Option<&Path>, files: &[&str]) -> Self {
        if let Some(folder) = folder {
            self.folders.push(Place::new(option, folder));
            let inside =
                |f: &&str| Place { inside: true, keeps: true, ..Place::new(option, &folder.join(f)) };
            self.outputs.extend(files.iter().map(inside));
        }
        self
    }

    /// Checks that every output can be written and that no output is an input or another output.
    ///
    /// # Errors
    /// [`Misuse`] names two paths that are one file; other errors name the output and what keeps it from being
    /// written.
    pub(crate) fn check(&self) -> Result<()> {
        for output in &self.outputs {
            if let Some(input) = self.inputs.iter().find(|i| i.identity.is(&output.identity)) {
                let (option, path) = (input.option, input.path.display());
                return Err(clash(output, &format!("{option}, {path}, which is read")));
            }
        }
        for (k, output) in self.outputs.iter().enumerate() {
            if let Some(other) = self.outputs[..k].iter().find(|o| o.identity.is_written_as(&output.identity))
            {
                let (option, path) = (other.option, other.path.display());
                return Err(clash(output, &format!("{option}, {path}, which is written too")));
            }
        }
        // Also where the file system does not tell capitals from small letters.
        let kept = |keeper: &Place, o: &Place| {
            let folded = |p: &Place| p.identity.path.as_os_str().as_encoded_bytes().to_ascii_lowercase();
            let (of, path) = (folded(keeper), folded(o));
            o.option != keeper.option
                && path.strip_prefix(&of[..]).is_some_and(|more| more.starts_with(b".bak"))
        };
        for keeper in self.outputs.iter().filter(|o| o.keeps) {
            if let Some(output) = self.outputs.iter().find(|o| kept(keeper, o)) {
                let (option, path) = (keeper.option, keeper.path.display());
                return Err(clash(output, &format!("an earlier {path} that {option} may keep")));
            }
        }
        for folder in &self.folders {
            if let Some(input) =
                self.inputs.iter().find(|i| i.identity.is(&folder.identity) && i.path.is_file())
            {
                let (option, path) = (input.option, input.path.display());
                return Err(clash(folder, &format!("{option}, {path}, which is read")));
            }
            if let Some(file) =
                self.outputs.iter().find(|o| folder.identity.path.starts_with(&o.identity.path))
            {
                let (option, path) = (file.option, file.path.display());
                return Err(clash(folder, &format!("{option}, {path}, which is a file")));
            }
            check_folder(&folder.path)?;
        }
        self.outputs.iter().try_for_each(|o| if o.inside { check_kind(&o.path) } else { check_file(&o.path) })
    }

    /// Checks the outputs against files that are known once an input is read: the textures and buffers of an asset,
    /// the frames of a sequence.
    ///
    /// # Errors
    /// As [`Places::check`].
    pub(crate) fn check_against<'a>(
        &self,
        owner: &'static str,
        files: impl IntoIterator<Item = &'a PathBuf>,
    ) -> Result<()> {
        for file in files {
            let identity = Identity::of(file);
            if let Some(output) = self.outputs.iter().find(|o| o.identity.is(&identity)) {
                return Err(clash(output, &format!("{}, a file of {owner}", file.display())));
            }
        }
        Ok(())
    }
}

fn clash(output: &Place, other: &str) -> anyhow::Error {
    let path = output.path.display();
    Misuse(format!("{path}: {} names the file of {other}; it must be another file", output.option)).into()
}

/// What tells whether two paths are one file.
#[derive(Debug)]
struct Identity {
    /// Device and number of a file that exists, where the system has them: the same for all hard links.
    number: Option<(u64, u64)>,
    /// The path without links, `.` and `..`.
    path: PathBuf,
}

impl Identity {
    fn of(path: &Path) -> Self {
        // Links that lead nowhere yet are followed, too: what they lead to is what will be written.
        let target = link_target(path).unwrap_or_else(|_| path.to_owned());
        Self { number: number(path), path: resolved(&target) }
    }

    /// Whether both are one file now.
    fn is(&self, other: &Self) -> bool {
        (self.number.is_some() && self.number == other.number) || self.path == other.path
    }

    /// Whether both would be one file on some system: many take names that differ in case for one.
    fn is_written_as(&self, other: &Self) -> bool {
        let folded = |i: &Self| i.path.to_string_lossy().to_lowercase();
        self.is(other) || folded(self) == folded(other)
    }
}

#[cfg(unix)]
fn number(path: &Path) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    std::fs::metadata(path).ok().map(|m| (m.dev(), m.ino()))
}

#[cfg(not(unix))]
fn number(_: &Path) -> Option<(u64, u64)> {
    None
}

/// The longest part of a path that exists with its links followed, and the rest without dots.
fn resolved(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let existing = absolute.ancestors().find_map(|a| Some((a, a.canonicalize().ok()?)));
    let Some((existing, mut out)) = existing else { return absolute };
    for part in absolute.strip_prefix(existing).unwrap_or(Path::new("")).components() {
        match part {
            Component::ParentDir => {
                out.pop();
            }
            Component::CurDir => {}
            part => out.push(part),
        }
    }
    out
}

/// Checks that a file can be written: its folder exists and takes files, and no folder or device has its name.
fn check_file(path: &Path) -> Result<()> {
    let shown = path.display();
    check_kind(path)?;
    // `check_kind` has seen that links end.
    let folder = parent(&link_target(path).unwrap_or_else(|_| path.to_owned()));
    if !folder.exists() {
        bail!("{shown}: cannot be written: the folder {} does not exist", folder.display());
    }
    if !folder.is_dir() {
        bail!("{shown}: cannot be written: {} is not a folder", folder.display());
    }
    writable(&folder).map_err(|e| anyhow!("{shown}: cannot be written: {}: {e}", folder.display()))
}

/// Checks that what has the name of an output, if anything, is a regular file: it will be replaced.
fn check_kind(path: &Path) -> Result<()> {
    let shown = path.display();
    link_target(path).map_err(|e| anyhow!("{shown}: cannot be written: {e}"))?;
    if path.file_name().is_none() || path.is_dir() {
        bail!("{shown}: is a folder; the output must be a file, not a folder");
    }
    if path.exists() && !path.is_file() {
        bail!("{shown}: is a device or a pipe; the output must be a regular file");
    }
    Ok(())
}

/// Checks that a folder exists or can be made, and takes files.
fn check_folder(path: &Path) -> Result<()> {
    let shown = path.display();
    let mut existing = path.to_owned();
    while !existing.exists() {
        existing = parent(&existing);
    }
    if !existing.is_dir() {
        bail!("{shown}: cannot be made: {} is not a folder", existing.display());
    }
    writable(&existing).map_err(|e| anyhow!("{shown}: cannot be written: {}: {e}", existing.display()))
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

    fn rule(places: &Places) -> String {
        places.check().err().map(|e| e.to_string()).unwrap_or_default()
    }

    #[test]
    fn places_are_checked_and_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        let d = dir.path();
        std::fs::write(d.join("plain"), b"x").unwrap();
        let file = |name: &str| rule(&Places::default().writes("--output", Some(&d.join(name))));
        let folder =
            |name: &str| rule(&Places::default().fills("--report", Some(&d.join(name)), &["index.html"]));
        assert_eq!(file("a.glb"), "");
        assert!(file("no/a.glb").contains("does not exist"));
        assert!(file("plain/a.glb").contains("is not a folder"));
        assert!(file("").contains("must be a file"));
        assert_eq!(folder("new/deep"), "");
        assert!(folder("plain/deep").contains("is not a folder"));
        std::fs::create_dir_all(d.join("full/index.html")).unwrap();
        assert!(folder("full").contains("must be a file"), "a folder has the name of the page");
        assert_eq!(std::fs::read_dir(d).unwrap().count(), 2, "nothing was left behind");
        assert_eq!(std::fs::read_dir(d.join("full")).unwrap().count(), 1, "nothing was left behind");
    }

    #[test]
    fn an_output_is_no_input_under_any_name() {
        let dir = tempfile::tempdir().unwrap();
        let d = dir.path();
        std::fs::create_dir(d.join("sub")).unwrap();
        std::fs::write(d.join("in.glb"), b"x").unwrap();
        std::fs::hard_link(d.join("in.glb"), d.join("hard.json")).unwrap();
        let mut names = vec!["in.glb", "./in.glb", "sub/../in.glb"];
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(d.join("in.glb"), d.join("soft.json")).unwrap();
            std::os::unix::fs::symlink(d, d.join("sub/up")).unwrap();
            names.extend(["hard.json", "soft.json", "sub/up/in.glb"]);
        }
        for name in names {
            let places =
                Places::default().reads("IN", Some(&d.join("in.glb"))).writes("--json", Some(&d.join(name)));
            let error = places.check().expect_err(name);
            assert!(error.is::<Misuse>(), "{name}: a wrong command line");
            let text = error.to_string();
            assert!(
                text.contains("--json") && text.contains("IN") && text.contains("another file"),
                "{text}"
            );
        }
        let fine = Places::default()
            .reads("IN", Some(&d.join("in.glb")))
            .writes("--json", Some(&d.join("sub/in.glb")))
            .writes("--output", Some(&d.join("out.glb")));
        assert_eq!(rule(&fine), "");
        let files = [d.join("sub/../out.glb")];
        let text = fine.check_against("IN", &files).expect_err("a texture").to_string();
        assert!(text.contains("--output") && text.contains("a file of IN"), "{text}");
    }

    #[test]
    fn outputs_are_files_of_their_own() {
        let dir = tempfile::tempdir().unwrap();
        let d = dir.path();
        for (json, report) in [
            ("o.glb", "r"),
            ("./o.glb", "r"),
            ("O.GLB", "r"),
            ("no/../o.glb", "r"),
            ("r/index.html", "r"),
            ("f.json", "o.glb"),
            ("f.json", "o.glb/r"),
        ] {
            let places = Places::default()
                .writes("--output", Some(&d.join("o.glb")))
                .writes("--json", Some(&d.join(json)))
                .fills("--report", Some(&d.join(report)), &["index.html"]);
            assert!(places.check().expect_err(json).is::<Misuse>(), "{json} {report}");
        }
        assert_eq!(std::fs::read_dir(d).unwrap().count(), 0, "nothing was made");
    }

    #[test]
    fn what_a_folder_keeps_of_earlier_files_is_no_output() {
        let dir = tempfile::tempdir().unwrap();
        let d = dir.path();
        let places = |json: &str| {
            let folder = d.join("ck");
            Places::default()
                .fills("--checkpoint", Some(&folder), &["fit.ckpt"])
                .writes("--json", Some(&d.join(json)))
        };
        std::fs::create_dir(d.join("ck")).unwrap();
        for kept in ["ck/fit.ckpt.bak", "ck/fit.ckpt.bak2", "ck/FIT.ckpt.BAK"] {
            let rule = rule(&places(kept));
            assert!(rule.contains("--json") && rule.contains("--checkpoint may keep"), "{rule}");
        }
        places("ck/fit.json").check().unwrap();
        places("fit.ckpt.bak").check().unwrap();
        let state = |json: &str| {
            let state = Places::default().sets_aside("the state", Some(&d.join("o.png.state")));
            state.writes("--json", Some(&d.join(json)))
        };
        assert!(
            rule(&state("o.png.state.bak")).contains("an earlier"),
            "{}",
            rule(&state("o.png.state.bak"))
        );
        state("o.png.json").check().unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn links_are_checked_where_they_lead() {
        use std::os::unix::fs::symlink;
        let dir = tempfile::tempdir().unwrap();
        let d = dir.path();
        std::fs::create_dir(d.join("sub")).unwrap();
        let json = |name: &str| {
            let places = Places::default().writes("--output", Some(&d.join("o.glb")));
            rule(&places.writes("--json", Some(&d.join(name))))
        };
        symlink("o.glb", d.join("f.json")).unwrap();
        assert!(json("f.json").contains("another file"), "{}", json("f.json"));
        symlink("sub/g.json", d.join("g.json")).unwrap();
        assert_eq!(json("g.json"), "");
        symlink(d.join("no/h.json"), d.join("h.json")).unwrap();
        assert!(json("h.json").contains("does not exist"), "{}", json("h.json"));
        symlink("i.json", d.join("i.json")).unwrap();
        assert!(json("i.json").contains("links"), "{}", json("i.json"));
    }

    #[cfg(unix)]
    #[test]
    fn devices_are_not_replaced() {
        let places = Places::default().writes("--json", Some(Path::new("/dev/null")));
        assert!(rule(&places).contains("must be a regular file"), "{}", rule(&places));
    }
}

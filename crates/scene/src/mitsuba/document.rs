//! The XML layer: elements with their lines, `default` parameters, includes, search paths, references.

use super::MitsubaOptions;
use crate::SceneError;
use crate::error::{Fault, fault};
use crate::load::{clip, read_file};
use roxmltree::ParsingOptions;
use std::cell::RefCell;
use std::collections::{BTreeSet, HashMap, HashSet};
use std::path::{Component, Path, PathBuf};

/// Bytes of one XML file.
const XML_BYTES: u64 = 64 << 20;
/// Elements of all files together.
const ELEMENTS: usize = 2_000_000;
/// Nesting of elements.
const DEPTH: usize = 64;
/// Files that include each other, and files in all.
const INCLUDE_DEPTH: usize = 15;
const FILES: usize = 1024;
/// Names of files that are looked for at the end of a scene.
const MOST_NAMED: usize = 4096;
/// Folders named by `path` elements.
const FOLDERS: usize = 64;
/// Attributes of one element: the parser compares each with the others.
const ATTRIBUTES: usize = 64;
/// Characters of a value after parameters are put in.
const VALUE: usize = 16 << 20;

/// Where an element stands.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    file: usize,
    line: u32,
}

/// An element with its parameters put in.
#[derive(Debug)]
pub(super) struct Element {
    pub(super) tag: String,
    /// The plugin.
    pub(super) kind: String,
    pub(super) name: String,
    pub(super) id: String,
    pub(super) attributes: Vec<(String, String)>,
    pub(super) children: Vec<usize>,
    pub(super) line: Line,
}

impl Element {
    /// An attribute, if it is there.
    pub(super) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|a| a.0 == name).map(|a| a.1.as_str())
    }
}

/// All files of a scene.
#[derive(Debug)]
pub(super) struct Document {
    pub(super) elements: Vec<Element>,
    /// Children of the `scene` elements of all files, in order.
    pub(super) top: Vec<usize>,
    ids: HashMap<String, usize>,
    aliases: HashMap<String, String>,
    parameters: HashMap<String, String>,
    /// The major version of the format that the scene is written in.
    pub(super) version: u32,
    files: Vec<PathBuf>,
    /// Meshes, pictures and grids that were asked for.
    resources: RefCell<Vec<PathBuf>>,
    folders: Vec<PathBuf>,
    /// The folder that files must lie in, resolved; `None` where they may lie above it.
    within: Option<PathBuf>,
    /// Values of parameters that something asked for.
    used: HashSet<String>,
}

impl Document {
    /// Reads a scene and everything that it includes.
    pub(super) fn read(path: &Path, options: &MitsubaOptions) -> Result<Self, SceneError> {
        let folder = match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p.to_owned(),
            _ => PathBuf::from("."),
        };
        let within = match options.allow_parent_paths {
            true => None,
            false => {
                let resolved = folder.canonicalize();
                Some(resolved.map_err(|cause| SceneError::Read { path: path.to_owned(), cause })?)
            }
        };
        let mut out = Self {
            elements: Vec::new(),
            top: Vec::new(),
            ids: HashMap::new(),
            aliases: HashMap::new(),
            parameters: options.parameters.iter().cloned().collect(),
            version: 3,
            files: Vec::new(),
            resources: RefCell::default(),
            within,
            folders: vec![folder],
            used: HashSet::new(),
        };
        out.file(path, 0).map_err(|e| match e {
            Stop::Scene(e) => e,
            Stop::Fault(f) => f.in_file(path),
        })?;
        let unknown: Vec<&str> =
            options.parameters.iter().map(|p| p.0.as_str()).filter(|p| !out.used.contains(*p)).collect();
        if !unknown.is_empty() {
            let rule = format!("has no parameter {}", unknown.join(", "));
            return Err(fault("the scene", rule).in_file(path));
        }
        Ok(out)
    }

    /// The place of an element in words.
    pub(super) fn place(&self, line: Line) -> String {
        match line.file {
            0 => format!("line {}", line.line),
            i => format!("{} line {}", self.files[i].display(), line.line),
        }
    }

    /// The XML files, the scene itself first.
    pub(super) fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// The element that an id names.
    pub(super) fn find(&self, id: &str) -> Option<usize> {
        let mut id = id;
        // A chain of aliases is no longer than their number.
        for _ in 0..=self.aliases.len() {
            if let Some(&found) = self.ids.get(id) {
                return Some(found);
            }
            id = self.aliases.get(id)?;
        }
        None
    }

    /// The file that a `filename` names: relative to the scene's folder or to a `path`.
    pub(super) fn resolve(&self, name: &str, place: &str) -> Result<PathBuf, Fault> {
        let name = relative(name, place)?;
        // Collections keep their scenes in a folder beside those of the meshes: the folder above comes last.
        let above = self.within.is_none().then(|| self.folders[0].join(".."));
        let mut folders = self.folders.iter().chain(&above).map(|f| f.join(&name));
        let found = folders.find(|p| p.is_file()).ok_or_else(|| {
            let name = clip(&name.to_string_lossy());
            fault(
                place,
                format!("the file `{name}` does not exist; it must lie in the scene's folder or a `path`"),
            )
        })?;
        let found = self.contained(found, place)?;
        self.resources.borrow_mut().push(found.clone());
        Ok(found)
    }

    /// The files that [`Self::resolve`] found, and those that elements name which nothing uses.
    pub(super) fn named_files(&self) -> Vec<PathBuf> {
        let of = |e: &'_ Element| {
            let value = e.attribute("value").filter(|_| e.name == "filename");
            e.attribute("filename").into_iter().chain(value).map(str::to_owned).collect::<Vec<_>>()
        };
        let names: BTreeSet<String> = self.elements.iter().flat_map(of).collect();
        for name in names.iter().take(MOST_NAMED) {
            // What is not there is nothing that could be lost.
            let _ = self.resolve(name, "");
        }
        let mut all = self.resources.borrow().clone();
        all.sort();
        all.dedup();
        all
    }

    /// The path, if scenes may read there.
    fn contained(&self, path: PathBuf, place: &str) -> Result<PathBuf, Fault> {
        let Some(within) = &self.within else { return Ok(path) };
        if path.canonicalize().is_ok_and(|real| real.starts_with(within)) {
            return Ok(path);
        }
        let name = clip(&path.to_string_lossy());
        let rule = format!(
            "`{name}` lies outside of the scene's folder; allow_parent_paths is false and must be true"
        );
        Err(fault(place, rule))
    }

    fn file(&mut self, path: &Path, depth: usize) -> Result<(), Stop> {
        if self.files.len() >= FILES {
            return Err(fault(
                path.display().to_string(),
                format!("is one file more than the {FILES} that may be read"),
            )
            .into());
        }
        let index = self.files.len();
        self.files.push(path.to_owned());
        let bytes = read_file(path, XML_BYTES)?;
        let text = std::str::from_utf8(&bytes).map_err(|e| {
            let rule = "is not UTF-8; the file must be";
            fault(format!("byte {}", e.valid_up_to()), rule).in_file(path)
        })?;
        check_nesting(text).map_err(|f| f.in_file(path))?;
        let options = ParsingOptions { nodes_limit: 4 * ELEMENTS as u32, ..ParsingOptions::default() };
        let xml = roxmltree::Document::parse_with_options(text, options).map_err(|e| {
            let at = e.pos();
            fault(format!("line {} column {}", at.row, at.col), clip(&format!("is not XML: {e}")))
                .in_file(path)
        })?;
        let lines: Vec<usize> =
            std::iter::once(0).chain(text.match_indices('\n').map(|(i, _)| i + 1)).collect();
        let root = xml.root_element();
        let mut job = Reading { document: self, file: index, lines: &lines, depth };
        if root.has_tag_name("scene") {
            let version = root.attribute("version").and_then(|v| v.split('.').next()?.trim().parse().ok());
            if let (0, Some(v)) = (index, version) {
                job.document.version = v;
            }
            for child in root.children().filter(roxmltree::Node::is_element) {
                if let Some(i) = job.element(child)? {
                    job.document.top.push(i);
                }
            }
            return Ok(());
        }
        let place = job.document.place(job.line(root));
        let rule = format!(
            "the file begins with <{}>; a scene must begin with <scene>",
            clip(root.tag_name().name())
        );
        Err(fault(place, rule).into())
    }
}

/// Either kind of error on the way.
#[derive(Debug)]
enum Stop {
    Scene(SceneError),
    Fault(Fault),
}

impl From<SceneError> for Stop {
    fn from(e: SceneError) -> Self {
        Self::Scene(e)
    }
}

impl From<Fault> for Stop {
    fn from(e: Fault) -> Self {
        Self::Fault(e)
    }
}

/// A path that does not begin at the root of a file system.
fn relative(name: &str, place: &str) -> Result<PathBuf, Fault> {
    let name = name.replace('\\', "/");
    let path = PathBuf::from(&name);
    let plain = path
        .components()
        .all(|c| matches!(c, Component::Normal(_) | Component::CurDir | Component::ParentDir));
    let scheme = name.split('/').next().is_some_and(|first| first.contains(':'));
    if name.is_empty() || !plain || scheme || name.contains('\0') {
        return Err(fault(
            place,
            format!("`{}` is not relative; paths must be relative to the scene", clip(&name)),
        ));
    }
    Ok(path)
}

/// The XML parser goes down once per level: too many levels are refused before it begins.
fn check_nesting(text: &str) -> Result<(), Fault> {
    let (mut depth, mut line) = (0_usize, 1_usize);
    let bytes = text.as_bytes();
    let mut i = 0;
    while i < bytes.len() {
        let rest = &bytes[i..];
        let skip_to = |end: &str| text[i..].find(end).map_or(bytes.len(), |k| i + k + end.len());
        let next = if rest.starts_with(b"<!--") {
            skip_to("-->")
        } else if rest.starts_with(b"<![CDATA[") {
            skip_to("]]>")
        } else if rest.starts_with(b"<?") {
            skip_to("?>")
        } else if rest.starts_with(b"</") {
            depth = depth.saturating_sub(1);
            i + 2
        } else if rest[0] == b'<' {
            let (end, values) = end_of_tag(bytes, i);
            if values > ATTRIBUTES {
                let rule = format!("an element has {values} attributes; it may have {ATTRIBUTES}");
                return Err(fault(format!("line {line}"), rule));
            }
            if end < 2 || bytes.get(end - 2) != Some(&b'/') {
                depth += 1;
            }
            if depth > DEPTH {
                return Err(fault(
                    format!("line {line}"),
                    format!("elements are nested {depth} deep; they may be nested {DEPTH} deep"),
                ));
            }
            end
        } else {
            i + 1
        };
        line += bytes[i..next].iter().filter(|b| **b == b'\n').count();
        i = next;
    }
    Ok(())
}

/// The byte after the `>` of a tag, and the number of its quoted texts, which do not end it.
fn end_of_tag(bytes: &[u8], from: usize) -> (usize, usize) {
    let (mut quote, mut values) = (None, 0);
    for (k, &b) in bytes.iter().enumerate().skip(from) {
        match (quote, b) {
            (None, b'"' | b'\'') => quote = Some(b),
            (Some(q), b) if q == b => (quote, values) = (None, values + 1),
            (None, b'>') => return (k + 1, values),
            _ => {}
        }
    }
    (bytes.len(), values)
}

/// One file on its way into a document.
struct Reading<'a> {
    document: &'a mut Document,
    file: usize,
    lines: &'a [usize],
    depth: usize,
}

impl Reading<'_> {
    fn line(&self, node: roxmltree::Node<'_, '_>) -> Line {
        let at = node.range().start;
        Line { file: self.file, line: self.lines.partition_point(|l| *l <= at) as u32 }
    }

    /// Takes an element over; `None` for those that only say how to read others.
    fn element(&mut self, node: roxmltree::Node<'_, '_>) -> Result<Option<usize>, Stop> {
        let line = self.line(node);
        let tag = node.tag_name().name().to_owned();
        let mut attributes = Vec::new();
        for a in node.attributes() {
            attributes.push((a.name().to_owned(), self.substituted(a.value(), line)?));
        }
        let get = |name: &str| attributes.iter().find(|a| a.0 == name).map(|a| a.1.clone());
        let need = |document: &Document, name: &str| {
            get(name).ok_or_else(|| {
                fault(document.place(line), format!("<{tag}> has no attribute {name}; it must have one"))
            })
        };
        match tag.as_str() {
            "default" => {
                let (name, value) = (need(self.document, "name")?, need(self.document, "value")?);
                self.document.used.insert(name.clone());
                self.document.parameters.entry(name).or_insert(value);
                return Ok(None);
            }
            "path" => {
                self.folder(&need(self.document, "value")?, line)?;
                return Ok(None);
            }
            "alias" => {
                let (id, alias) = (need(self.document, "id")?, need(self.document, "as")?);
                self.document.aliases.insert(alias, id);
                return Ok(None);
            }
            "include" => {
                self.include(&need(self.document, "filename")?, line)?;
                return Ok(None);
            }
            _ => {}
        }
        if self.document.elements.len() >= ELEMENTS {
            return Err(fault(
                self.document.place(line),
                format!("is one element more than the {ELEMENTS} that may be read"),
            )
            .into());
        }
        let index = self.document.elements.len();
        let (kind, name, id) = (get("type"), get("name"), get("id"));
        let id = id.unwrap_or_default();
        if !id.is_empty() && tag != "ref" && self.document.ids.insert(id.clone(), index).is_some() {
            let rule = format!("the id `{}` is given twice; it must be given once", clip(&id));
            return Err(fault(self.document.place(line), rule).into());
        }
        self.document.elements.push(Element {
            tag,
            kind: kind.unwrap_or_default(),
            name: snake(&name.unwrap_or_default()),
            id,
            attributes,
            children: Vec::new(),
            line,
        });
        let mut children = Vec::new();
        for child in node.children().filter(roxmltree::Node::is_element) {
            children.extend(self.element(child)?);
        }
        self.document.elements[index].children = children;
        Ok(Some(index))
    }

    /// Adds a folder in which files are looked for.
    fn folder(&mut self, value: &str, line: Line) -> Result<(), Stop> {
        let place = self.document.place(line);
        let name = relative(value, &place)?;
        let folders = &mut self.document.folders;
        if folders.len() >= FOLDERS {
            return Err(fault(place, format!("is one path more than the {FOLDERS} that there may be")).into());
        }
        let base = self.document.files[self.file].parent().unwrap_or(Path::new("")).to_owned();
        let found = folders
            .iter()
            .map(|f| f.join(&name))
            .chain(std::iter::once(base.join(&name)))
            .find(|f| f.is_dir())
            .ok_or_else(|| fault(place, format!("the folder `{}` does not exist", clip(value))))?;
        if !folders.contains(&found) {
            folders.push(found);
        }
        Ok(())
    }

    fn include(&mut self, name: &str, line: Line) -> Result<(), Stop> {
        let place = self.document.place(line);
        if self.depth >= INCLUDE_DEPTH {
            let rule =
                format!("files include each other more than {INCLUDE_DEPTH} deep; that many are accepted");
            return Err(fault(place, rule).into());
        }
        let beside = self.document.files[self.file].parent().map(|p| p.join(name)).filter(|p| p.is_file());
        let path = match (self.document.resolve(name, &place), beside) {
            (Ok(path), _) | (Err(_), Some(path)) => path,
            (Err(e), None) => return Err(e.into()),
        };
        let path = self.document.contained(path, &place)?;
        self.document.file(&path, self.depth + 1)
    }

    /// A value with `$name` replaced by the parameter.
    fn substituted(&mut self, value: &str, line: Line) -> Result<String, Fault> {
        if !value.contains('$') {
            return Ok(value.to_owned());
        }
        let document = &mut *self.document;
        let place = |d: &Document| d.place(line);
        let mut out = String::new();
        let mut rest = value;
        while let Some(at) = rest.find('$') {
            out.push_str(&rest[..at]);
            let tail = &rest[at + 1..];
            let end = tail.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(tail.len());
            let name = &tail[..end];
            let Some(found) = document.parameters.get(name) else {
                return Err(fault(
                    place(document),
                    format!("the parameter `${}` has no value; it must have one", clip(name)),
                ));
            };
            out.push_str(found);
            document.used.insert(name.to_owned());
            if out.len() > VALUE {
                return Err(fault(
                    place(document),
                    format!("a value has more than {VALUE} characters; it may have that many"),
                ));
            }
            rest = &tail[end..];
        }
        out.push_str(rest);
        Ok(out)
    }
}

/// Names of old scenes, `toWorld`, as they are written today: `to_world`.
fn snake(name: &str) -> String {
    let mut out = String::with_capacity(name.len() + 2);
    let mut lower = false;
    for c in name.chars() {
        if c.is_ascii_uppercase() && lower {
            out.push('_');
        }
        lower = c.is_ascii_lowercase();
        out.push(if out.ends_with('_') { c.to_ascii_lowercase() } else { c });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_names_and_paths() {
        assert_eq!(snake("toWorld"), "to_world");
        assert_eq!(snake("int_ior"), "int_ior");
        for bad in ["", "/etc/passwd", "http://a/b", "C:\\x", "a\0b"] {
            assert!(relative(bad, "here").is_err(), "{bad}");
        }
        assert!(relative("../meshes/a.obj", "here").is_ok());
        assert!(check_nesting(&"<a>".repeat(65)).is_err());
        assert!(check_nesting(&"<a b='>'/>".repeat(1000)).is_ok());
        let attributes = |n: usize| format!("<a {}/>", "b='1' ".repeat(n));
        assert!(check_nesting(&attributes(64)).is_ok());
        assert!(check_nesting(&attributes(100_000)).unwrap_err().rule.contains("100000 attributes"));
    }
}

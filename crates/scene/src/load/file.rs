//! Reading files, and finding the files that an asset names without leaving its folder.

use crate::SceneError;
use crate::error::{Fault, FaultKind, fault, unreadable};
use base64::Engine;
use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Reads a regular file of at most `limit` bytes.
pub(crate) fn read(path: &Path, limit: u64) -> Result<Vec<u8>, SceneError> {
    let cannot = |cause| SceneError::Read { path: path.to_owned(), cause };
    let size = size_of_regular(path).map_err(cannot)?;
    if size > limit {
        return Err(fault("the file's size", format!("is {size} bytes; it may be at most {limit} bytes"))
            .in_file(path));
    }
    let mut bytes = Vec::with_capacity(size as usize);
    File::open(path).and_then(|f| f.take(limit).read_to_end(&mut bytes)).map_err(cannot)?;
    Ok(bytes)
}

fn size_of_regular(path: &Path) -> std::io::Result<u64> {
    let metadata = std::fs::metadata(path)?;
    if metadata.is_file() { Ok(metadata.len()) } else { Err(std::io::Error::other("not a regular file")) }
}

/// The folder of an asset: the only place that its references may reach.
#[derive(Debug, Default)]
pub(crate) struct Folder {
    /// `None`: the asset is no file, and may refer to none.
    path: Option<PathBuf>,
    /// Bytes read from it so far.
    bytes: AtomicU64,
    /// The files that were read from it or that the asset names.
    files: Mutex<Vec<PathBuf>>,
    /// Names that were asked for, and whether their files are there.
    named: Mutex<HashMap<String, bool>>,
}

/// Names of files that are looked for without being read, at most: each costs some questions to the system.
const MOST_NAMED: usize = 4096;

impl Folder {
    pub(crate) fn of(asset: &Path) -> Self {
        let path = match asset.parent() {
            Some(p) if !p.as_os_str().is_empty() => p.to_owned(),
            _ => PathBuf::from("."),
        };
        Self { path: Some(path), ..Self::default() }
    }

    /// Bytes of the files that were read from it.
    pub(crate) fn bytes_read(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// The files that were read from it or that the asset names, each once, in the order of their names.
    pub(crate) fn into_files(self) -> Vec<PathBuf> {
        let mut files = self.files.into_inner().unwrap_or_else(PoisonError::into_inner);
        files.sort();
        files.dedup();
        files
    }

    /// Contents of a glTF URI: percent-encoded relative path or base64 data.
    pub(crate) fn read_uri(&self, uri: &str, limit: u64, place: &str) -> Result<Vec<u8>, Fault> {
        if let Some(data) = uri.strip_prefix("data:") {
            return decode_data(data, place);
        }
        let name = percent_decode(uri)
            .ok_or_else(|| fault(place, format!("the URI `{}` is not percent-encoded UTF-8", clip(uri))))?;
        self.read_name(&name, limit, place)
    }

    /// Contents of a file by its path relative to the folder.
    pub(crate) fn read_name(&self, name: &str, limit: u64, place: &str) -> Result<Vec<u8>, Fault> {
        let path = self.resolve(name, place)?;
        let bytes = read(&path, limit).map_err(|e| match e {
            SceneError::Read { cause, .. } => unreadable(place, name, cause),
            other => fault(place, other.to_string()),
        })?;
        self.bytes.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        self.files.lock().unwrap_or_else(PoisonError::into_inner).push(path);
        Ok(bytes)
    }

    /// Takes note of a file that the asset names, read or not; whether it is there. Of very many names the first ones count.
    pub(crate) fn notes(&self, name: &str) -> bool {
        let mut named = self.named.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(there) = named.get(name) {
            return *there;
        }
        if named.len() >= MOST_NAMED || name.len() > MOST_NAMED {
            return false;
        }
        let found = self.resolve(name, "").ok().filter(|path| path.is_file());
        let there = found.is_some();
        named.insert(name.to_owned(), there);
        self.files.lock().unwrap_or_else(PoisonError::into_inner).extend(found);
        there
    }

    /// The same of a glTF URI.
    pub(crate) fn notes_uri(&self, uri: &str) -> bool {
        !uri.starts_with("data:") && percent_decode(uri).is_some_and(|name| self.notes(&name))
    }

    fn resolve(&self, name: &str, place: &str) -> Result<PathBuf, Fault> {
        let Some(folder) = &self.path else {
            let rule = format!(
                "`{}` is a file; an asset that is read from memory must have all of its data",
                clip(name)
            );
            return Err(Fault { kind: FaultKind::Outside, ..fault(place, rule) });
        };
        let rule = format!("`{}` is not a path inside of the asset's folder; it must be one", clip(name));
        let leaves = || Fault { kind: FaultKind::Outside, ..fault(place, rule.clone()) };
        // Exporters on Windows write backslashes; both separate folders here.
        let name = name.replace('\\', "/");
        if name.is_empty() || name.starts_with('/') || name.contains('\0') || has_scheme(&name) {
            return Err(leaves());
        }
        let mut depth = 0_i64;
        for part in name.split('/') {
            depth += match part {
                "" | "." => 0,
                ".." => -1,
                _ => 1,
            };
            if depth < 0 {
                return Err(leaves());
            }
        }
        let path = folder.join(&name);
        let missing = |e: std::io::Error| unreadable(place, &name, e);
        let real = path.canonicalize().map_err(missing)?;
        let folder = folder.canonicalize().map_err(missing)?;
        if real.starts_with(&folder) { Ok(real) } else { Err(leaves()) }
    }
}

fn has_scheme(name: &str) -> bool {
    name.split('/').next().is_some_and(|first| first.contains(':'))
}

/// The first characters of a text from a file, for messages on one line.
pub(crate) fn clip(text: &str) -> String {
    let short: String = text.chars().take(80).map(|c| if c.is_control() { '?' } else { c }).collect();
    if short.len() < text.len() { short + "..." } else { short }
}

fn percent_decode(uri: &str) -> Option<String> {
    let mut out = Vec::with_capacity(uri.len());
    let mut bytes = uri.bytes();
    while let Some(b) = bytes.next() {
        if b == b'%' {
            let hex = [bytes.next()?, bytes.next()?];
            out.push(u8::from_str_radix(std::str::from_utf8(&hex).ok()?, 16).ok()?);
        } else {
            out.push(b);
        }
    }
    String::from_utf8(out).ok()
}

fn decode_data(data: &str, place: &str) -> Result<Vec<u8>, Fault> {
    let (kind, body) =
        data.split_once(',').ok_or_else(|| fault(place, "the data URI has no comma; it must have one"))?;
    if !kind.ends_with(";base64") {
        return Err(fault(place, "the data URI is not base64; it must be"));
    }
    base64::engine::GeneralPurpose::new(
        &base64::alphabet::STANDARD,
        base64::engine::GeneralPurposeConfig::new()
            .with_decode_padding_mode(base64::engine::DecodePaddingMode::Indifferent),
    )
    .decode(body)
    .map_err(|e| fault(place, format!("the data URI is not base64: {e}")))
}

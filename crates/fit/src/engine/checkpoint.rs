//! Checkpoints: everything that a fit needs to go on to the same bits.
//!
//! One file, written under a temporary name and renamed: a magic word, a checksum of all that follows, the length of a
//! JSON header, the header (counters, what steers the fit, names and sizes of the groups), then per group its
//! values, its best values and the state of its optimizer as little-endian numbers.

use super::fingerprint::Fingerprint;
use super::model::Group;
use super::trainer::HistoryPoint;
use crate::{Difference, FitError, Progress};
use photofit_image::write_atomically;
use photofit_optim::State;
use serde::{Deserialize, Serialize};
use std::io::Read as _;
use std::path::Path;

const MAGIC: &[u8; 8] = b"PHOTOFT3";
/// Name of the file in its folder.
pub(crate) const FILE: &str = "fit.ckpt";

/// Keeps the state of an earlier fit under another name and tells it: who forgot to go on can still do so. What cannot be
/// moved is told when the next state cannot be saved.
pub(crate) fn set_aside(folder: &Path, progress: &dyn Progress) {
    if let Ok(Some(kept)) = photofit_image::set_aside(folder.join(FILE)) {
        progress.note(&format!("an earlier fit is kept as {}", kept.display()));
    }
}

/// Counters and curves of a fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Course {
    /// Step of the schedule.
    pub step: u64,
    /// Steps of the schedule that were left out, since phases ended early.
    pub skipped: u64,
    /// Phases begun: what happens once at the beginning of a phase has happened for these.
    pub begun: usize,
    /// Quality of the best values.
    pub best_quality: f64,
    /// Evaluations of the held-out views.
    pub history: Vec<HistoryPoint>,
    /// Losses since the last evaluation.
    pub loss: Vec<f64>,
}

/// One group, as it is written.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Saved<'a> {
    pub group: &'a Group,
    pub values: &'a [f32],
    pub best: &'a [f32],
    pub optimizer: &'a State<f32>,
}

/// One group, as it is read.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Loaded {
    pub values: Vec<f32>,
    pub best: Vec<f32>,
    pub optimizer: State<f32>,
}

#[derive(Debug, Serialize, Deserialize)]
struct GroupHeader {
    name: String,
    rows: usize,
    columns: usize,
    m: usize,
    v: usize,
    row_steps: usize,
    optimizer_step: u64,
    scale_exponent: i32,
    mean_square_bits: u64,
}

impl GroupHeader {
    fn new(s: &Saved<'_>) -> Self {
        Self {
            name: s.group.name.to_string(),
            rows: s.group.rows,
            columns: s.group.columns,
            m: s.optimizer.m.len(),
            v: s.optimizer.v.len(),
            row_steps: s.optimizer.row_steps.len(),
            optimizer_step: s.optimizer.step,
            scale_exponent: s.optimizer.scale_exponent,
            mean_square_bits: s.optimizer.mean_square.to_bits(),
        }
    }
}

#[derive(Debug, Serialize, Deserialize)]
struct Header {
    #[serde(rename = "steering")]
    fingerprint: Fingerprint,
    step: u64,
    skipped: u64,
    begun: usize,
    best_quality_bits: u64,
    groups: Vec<GroupHeader>,
    /// Step, then seconds, loss and quality as bits.
    history: Vec<[u64; 4]>,
    loss: Vec<u64>,
}

/// FNV-1a (Fowler, Noll, Vo) over words: a change of any single word changes it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Digest(u64);

impl Digest {
    pub(crate) fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    fn word(&mut self, word: u64) {
        self.0 = (self.0 ^ word).wrapping_mul(0x0100_0000_01b3);
    }

    /// Adds numbers, one 32-bit word after the other.
    pub(crate) fn add<A: bytemuck::NoUninit>(&mut self, values: &[A]) {
        bytemuck::cast_slice::<A, u32>(values).iter().for_each(|w| self.word(u64::from(*w)));
    }

    /// Adds bytes and their number.
    pub(crate) fn add_bytes(&mut self, bytes: &[u8]) {
        let (words, rest) = bytes.as_chunks::<8>();
        words.iter().for_each(|w| self.word(u64::from_le_bytes(*w)));
        rest.iter().for_each(|b| self.word(u64::from(*b)));
        self.word(bytes.len() as u64);
    }

    pub(crate) fn value(self) -> u64 {
        self.0
    }
}

impl std::fmt::Display for Digest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

/// Writes the checkpoint of a folder, replacing the one before.
///
/// # Errors
/// If the file system refuses; the one before is then unchanged.
pub(crate) fn save(
    folder: &Path,
    course: &Course,
    groups: &[Saved<'_>],
    fingerprint: &Fingerprint,
) -> Result<(), FitError> {
    std::fs::create_dir_all(folder).map_err(|source| FitError::Io { path: folder.into(), source })?;
    let path = folder.join(FILE);
    let bytes = encode(course, groups, fingerprint)
        .map_err(|e| FitError::Checkpoint { path: path.clone(), rule: e.to_string() })?;
    Ok(write_atomically(path, &bytes)?)
}

fn encode(
    course: &Course,
    groups: &[Saved<'_>],
    fingerprint: &Fingerprint,
) -> Result<Vec<u8>, serde_json::Error> {
    let header = Header {
        fingerprint: fingerprint.clone(),
        step: course.step,
        skipped: course.skipped,
        begun: course.begun,
        best_quality_bits: course.best_quality.to_bits(),
        groups: groups.iter().map(GroupHeader::new).collect(),
        history: course
            .history
            .iter()
            .map(|h| [h.step, h.seconds.to_bits(), h.loss.to_bits(), h.quality.to_bits()])
            .collect(),
        loss: course.loss.iter().map(|l| l.to_bits()).collect(),
    };
    let json = serde_json::to_vec(&header)?;
    let mut out = MAGIC.to_vec();
    out.extend_from_slice(&[0; 8]);
    out.extend_from_slice(&(json.len() as u64).to_le_bytes());
    out.extend_from_slice(&json);
    for g in groups {
        for part in [g.values, g.best, &g.optimizer.m, &g.optimizer.v] {
            out.reserve(part.len() * 4);
            part.iter().for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
        }
        g.optimizer.row_steps.iter().for_each(|r| out.extend_from_slice(&r.to_le_bytes()));
    }
    let mut digest = Digest::new();
    digest.add_bytes(&out[16..]);
    out[8..16].copy_from_slice(&digest.value().to_le_bytes());
    Ok(out)
}

/// Reads the checkpoint of a folder, if there is one.
///
/// # Errors
/// If it cannot be read, is damaged, or belongs to another fit.
pub(crate) fn load(
    folder: &Path,
    groups: &[Group],
    fingerprint: &Fingerprint,
) -> Result<Option<(Course, Vec<Loaded>)>, FitError> {
    let path = folder.join(FILE);
    let io = |source| FitError::Io { path: path.clone(), source };
    if !path.try_exists().map_err(io)? {
        return Ok(None);
    }
    let bytes = photofit_image::file_bytes(&path, most_bytes(groups))?;
    decode(&bytes, groups, fingerprint).map(Some).map_err(|refusal| match refusal {
        Refusal::ModelError(rule) => FitError::Checkpoint { path, rule },
        Refusal::Other(differences) => FitError::OtherFit { path, differences },
    })
}

/// Refuses the checkpoint of a folder where these options are others in it, before there is anything else to compare. Only its head
/// is read: what is damaged is told by [`load`].
///
/// # Errors
/// [`FitError::OtherFit`].
pub(crate) fn check_options(folder: &Path, options: &Fingerprint) -> Result<(), FitError> {
    let path = folder.join(FILE);
    let head = |path: &Path| -> Option<Header> {
        let mut file = std::fs::File::open(path).ok()?;
        let mut start = [0; 24];
        file.read_exact(&mut start).ok()?;
        let length = u64::from_le_bytes(*start.last_chunk()?);
        let mut json = Vec::new();
        (start.starts_with(MAGIC) && length <= HEADER_MOST).then_some(())?;
        file.take(length).read_to_end(&mut json).ok()?;
        serde_json::from_slice(&json).ok()
    };
    let differences = head(&path).map_or_else(Vec::new, |h| options.other_options(&h.fingerprint));
    if differences.is_empty() { Ok(()) } else { Err(FitError::OtherFit { path, differences }) }
}

/// Largest header that is read before a fit, bytes.
const HEADER_MOST: u64 = 64 << 20;

/// Largest checkpoint that is read, bytes: values, the best ones, two moments and a count of steps for each row, and room for
/// the history and for another fit, whose differences are told.
fn most_bytes(groups: &[Group]) -> u64 {
    let own = groups.iter().map(|g| 4 * g.rows as u64 * (4 * g.columns as u64 + 1)).sum::<u64>();
    own.saturating_add(1 << 30)
}

/// Why a checkpoint is not taken.
#[derive(Debug)]
enum Refusal {
    /// It is no whole checkpoint.
    ModelError(String),
    /// It belongs to another fit.
    Other(Vec<Difference>),
}

impl<S: Into<String>> From<S> for Refusal {
    fn from(rule: S) -> Self {
        Self::ModelError(rule.into())
    }
}

/// Numbers from the rest of a file.
struct Rest<'a>(&'a [u8]);

impl Rest<'_> {
    fn words(&mut self, n: usize) -> Result<Vec<[u8; 4]>, String> {
        let size = n.checked_mul(4).filter(|s| *s <= self.0.len()).ok_or("the file ends too early")?;
        let (head, tail) = self.0.split_at(size);
        self.0 = tail;
        Ok(head.as_chunks::<4>().0.to_vec())
    }

    fn floats(&mut self, n: usize) -> Result<Vec<f32>, String> {
        Ok(self.words(n)?.into_iter().map(f32::from_le_bytes).collect())
    }

    fn group(&mut self, h: &GroupHeader, g: &Group) -> Result<Loaded, String> {
        let length = g.rows * g.columns;
        Ok(Loaded {
            values: self.floats(length)?,
            best: self.floats(length)?,
            optimizer: State {
                m: self.floats(h.m)?,
                v: self.floats(h.v)?,
                step: h.optimizer_step,
                scale_exponent: h.scale_exponent,
                mean_square: f64::from_bits(h.mean_square_bits),
                row_steps: self.words(h.row_steps)?.into_iter().map(u32::from_le_bytes).collect(),
            },
        })
    }
}

fn decode(
    bytes: &[u8],
    groups: &[Group],
    fingerprint: &Fingerprint,
) -> Result<(Course, Vec<Loaded>), Refusal> {
    if !bytes.starts_with(MAGIC) {
        return Err("it is no checkpoint of this version of photofit; remove it to begin anew".into());
    }
    let word = |at: usize| bytes.get(at..at + 8).and_then(|b| b.try_into().ok()).map(u64::from_le_bytes);
    let (Some(checksum), Some(length)) = (word(8), word(16)) else {
        return Err("the file ends too early".into());
    };
    let mut digest = Digest::new();
    digest.add_bytes(&bytes[16..]);
    if digest.value() != checksum {
        return Err("it is damaged: its checksum does not match; remove it to begin anew".into());
    }
    let json = usize::try_from(length).ok().and_then(|l| bytes.get(24..l.checked_add(24)?));
    let json = json.ok_or("the file ends too early")?;
    let h: Header = serde_json::from_slice(json).map_err(|e| format!("its header is broken: {e}"))?;
    let same =
        |(h, g): (&GroupHeader, &Group)| h.name == g.name && (h.rows, h.columns) == (g.rows, g.columns);
    let differences = fingerprint.differences(&h.fingerprint);
    if !differences.is_empty() {
        return Err(Refusal::Other(differences));
    }
    if h.groups.len() != groups.len() || !h.groups.iter().zip(groups).all(same) {
        return Err("its groups of parameters are those of another fit".into());
    }
    let mut rest = Rest(&bytes[24 + json.len()..]);
    let loaded = h.groups.iter().zip(groups).map(|(h, g)| rest.group(h, g)).collect::<Result<_, _>>()?;
    if !rest.0.is_empty() {
        return Err(format!("{} bytes follow its end", rest.0.len()).into());
    }
    let history = h.history.iter().map(|[step, seconds, loss, psnr]| HistoryPoint {
        step: *step,
        seconds: f64::from_bits(*seconds),
        loss: f64::from_bits(*loss),
        quality: f64::from_bits(*psnr),
    });
    let course = Course {
        step: h.step,
        skipped: h.skipped,
        begun: h.begun,
        best_quality: f64::from_bits(h.best_quality_bits),
        history: history.collect(),
        loss: h.loss.iter().map(|l| f64::from_bits(*l)).collect(),
    };
    Ok((course, loaded))
}

#[cfg(test)]
mod tests;

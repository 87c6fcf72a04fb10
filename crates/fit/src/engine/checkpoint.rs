//! Checkpoints: everything that a fit needs to go on to the same bits.
//!
//! One file, written under a temporary name and renamed: a magic word, the length of a JSON header, the header (sizes,
//! counters, a fingerprint of the options and the asset), then the arrays as little-endian numbers.

use super::trainer::HistoryPoint;
use crate::FitError;
use crate::candidate::Candidate;
use crate::simplify::SimplifyOptions;
use crate::views::Shot;
use photofit_image::write_atomically;
use photofit_optim::State;
use photofit_raster::{CHANNELS, Maps};
use photofit_scalar::Vec3f;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"PHOTOFT1";
const FILE: &str = "fit.ckpt";

/// What is written.
pub(crate) struct Checkpoint<'a> {
    pub step: u64,
    pub best_psnr: f64,
    pub positions: &'a [Vec3f],
    pub maps: &'a Maps,
    pub best_positions: &'a [Vec3f],
    pub best_maps: &'a Maps,
    pub shape: &'a State<f32>,
    pub adam: &'a State<f32>,
    pub history: &'a [HistoryPoint],
    pub loss: &'a [f64],
}

/// What is read.
pub(crate) struct Loaded {
    pub step: u64,
    pub best_psnr: f64,
    pub positions: Vec<Vec3f>,
    pub maps: Maps,
    pub best_positions: Vec<Vec3f>,
    pub best_maps: Maps,
    pub shape: State<f32>,
    pub adam: State<f32>,
    pub history: Vec<HistoryPoint>,
    pub loss: Vec<f64>,
}

#[derive(Debug, Serialize, Deserialize)]
struct StateHeader {
    m: usize,
    v: usize,
    step: u64,
    scale_exponent: i32,
    mean_square_bits: u64,
    rows: usize,
}

#[derive(Debug, Serialize, Deserialize)]
struct Header {
    fingerprint: String,
    step: u64,
    best_psnr_bits: u64,
    vertices: usize,
    width: usize,
    height: usize,
    shape: StateHeader,
    adam: StateHeader,
    /// step, then seconds, loss and quality as bits.
    history: Vec<[u64; 4]>,
    loss: Vec<u64>,
}

fn state_header(s: &State<f32>) -> StateHeader {
    StateHeader {
        m: s.m.len(),
        v: s.v.len(),
        step: s.step,
        scale_exponent: s.scale_exponent,
        mean_square_bits: s.mean_square.to_bits(),
        rows: s.row_steps.len(),
    }
}

/// What must agree between the run that wrote a checkpoint and the one that reads it: the options that steer the fit,
/// the candidate it starts from (which follows from the asset), and a held-out view (which follows from the asset and
/// the light).
pub(crate) fn fingerprint(options: &SimplifyOptions, start: &Candidate, view: &Shot) -> String {
    let mut digest = Digest(0xcbf2_9ce4_8422_2325);
    digest.add(start.triangles.as_flattened());
    digest.add(&start.positions);
    digest.add(&start.uvs);
    digest.add(start.maps.levels[0].texels.as_flattened());
    digest.add(view.reference.as_flattened());
    format!(
        "{:?} {:?} {} {} {} {} {} {:016x}",
        options.target,
        options.init,
        options.resolution,
        options.batch,
        options.steps,
        options.texture_size,
        options.seed,
        digest.0
    )
}

/// FNV-1a (Fowler, Noll, Vo), word by word.
struct Digest(u64);

impl Digest {
    fn add<A: bytemuck::NoUninit>(&mut self, values: &[A]) {
        for word in bytemuck::cast_slice::<A, u32>(values) {
            self.0 = (self.0 ^ u64::from(*word)).wrapping_mul(0x0100_0000_01b3);
        }
    }
}

/// Writes the checkpoint of a folder, replacing the one before.
pub(crate) fn save(folder: &Path, c: &Checkpoint<'_>, fingerprint: &str) -> Result<(), FitError> {
    std::fs::create_dir_all(folder).map_err(|source| FitError::Io { path: folder.into(), source })?;
    let header = Header {
        fingerprint: fingerprint.to_owned(),
        step: c.step,
        best_psnr_bits: c.best_psnr.to_bits(),
        vertices: c.positions.len(),
        width: c.maps.width,
        height: c.maps.height,
        shape: state_header(c.shape),
        adam: state_header(c.adam),
        history: c
            .history
            .iter()
            .map(|h| [h.step, h.seconds.to_bits(), h.loss.to_bits(), h.held_out_psnr.to_bits()])
            .collect(),
        loss: c.loss.iter().map(|l| l.to_bits()).collect(),
    };
    let json = serde_json::to_vec(&header)
        .map_err(|e| FitError::Checkpoint { path: folder.join(FILE), rule: e.to_string() })?;
    let mut out = Vec::new();
    out.extend_from_slice(MAGIC);
    out.extend_from_slice(&(json.len() as u64).to_le_bytes());
    out.extend_from_slice(&json);
    for part in [c.positions, c.best_positions] {
        push(&mut out, bytemuck::cast_slice(part));
    }
    for maps in [c.maps, c.best_maps] {
        push(&mut out, maps.texels.as_flattened());
    }
    for s in [c.shape, c.adam] {
        push(&mut out, &s.m);
        push(&mut out, &s.v);
        s.row_steps.iter().for_each(|r| out.extend_from_slice(&r.to_le_bytes()));
    }
    Ok(write_atomically(folder.join(FILE), &out)?)
}

fn push(out: &mut Vec<u8>, values: &[f32]) {
    out.reserve(values.len() * 4);
    values.iter().for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
}

/// Reads numbers from the rest of a file.
struct Rest<'a> {
    bytes: &'a [u8],
    path: &'a Path,
}

impl Rest<'_> {
    fn words(&mut self, n: usize) -> Result<Vec<[u8; 4]>, FitError> {
        let broken =
            || FitError::Checkpoint { path: self.path.into(), rule: "the file ends too early".into() };
        let size = n.checked_mul(4).filter(|s| *s <= self.bytes.len()).ok_or_else(broken)?;
        let (head, tail) = self.bytes.split_at(size);
        self.bytes = tail;
        Ok(head.chunks_exact(4).map(|b| [b[0], b[1], b[2], b[3]]).collect())
    }

    fn floats(&mut self, n: usize) -> Result<Vec<f32>, FitError> {
        Ok(self.words(n)?.into_iter().map(f32::from_le_bytes).collect())
    }

    fn vectors(&mut self, n: usize) -> Result<Vec<Vec3f>, FitError> {
        Ok(bytemuck::cast_slice(&self.floats(n * 3)?).to_vec())
    }

    fn maps(&mut self, width: usize, height: usize) -> Result<Maps, FitError> {
        let flat = self.floats(width * height * CHANNELS)?;
        Ok(Maps { width, height, texels: bytemuck::cast_slice(&flat).to_vec() })
    }

    fn state(&mut self, h: &StateHeader) -> Result<State<f32>, FitError> {
        Ok(State {
            m: self.floats(h.m)?,
            v: self.floats(h.v)?,
            step: h.step,
            scale_exponent: h.scale_exponent,
            mean_square: f64::from_bits(h.mean_square_bits),
            row_steps: self.words(h.rows)?.into_iter().map(u32::from_le_bytes).collect(),
        })
    }
}

/// Reads the checkpoint if the options ask for it and there is one.
pub(crate) fn load(
    options: &SimplifyOptions,
    candidate: &Candidate,
    fingerprint: &str,
) -> Result<Option<Loaded>, FitError> {
    let Some(path) = options.checkpoint.as_ref().filter(|_| options.resume).map(|f| f.join(FILE)) else {
        return Ok(None);
    };
    if !path.exists() {
        return Ok(None);
    }
    let bytes = std::fs::read(&path).map_err(|source| FitError::Io { path: path.clone(), source })?;
    parse(&path, &bytes, candidate, fingerprint).map(Some)
}

fn parse(path: &PathBuf, bytes: &[u8], candidate: &Candidate, fingerprint: &str) -> Result<Loaded, FitError> {
    let broken = |rule: &str| FitError::Checkpoint { path: path.clone(), rule: rule.into() };
    let length = bytes.get(8..16).and_then(|b| b.try_into().ok()).map(u64::from_le_bytes);
    let (Some(length), true) = (length, bytes.starts_with(MAGIC)) else {
        return Err(broken("it is not a checkpoint of photofit"));
    };
    let json = usize::try_from(length).ok().and_then(|l| bytes.get(16..l.checked_add(16)?));
    let json = json.ok_or_else(|| broken("the file ends too early"))?;
    let h: Header =
        serde_json::from_slice(json).map_err(|e| broken(&format!("the header is broken: {e}")))?;
    let base = &candidate.maps.levels[0];
    let same_sizes =
        h.vertices == candidate.positions.len() && (h.width, h.height) == (base.width, base.height);
    if h.fingerprint != fingerprint || !same_sizes {
        return Err(broken("it belongs to a fit with other options or another asset or light"));
    }
    let mut rest = Rest { bytes: &bytes[16 + json.len()..], path };
    let (positions, best_positions) = (rest.vectors(h.vertices)?, rest.vectors(h.vertices)?);
    let (maps, best_maps) = (rest.maps(h.width, h.height)?, rest.maps(h.width, h.height)?);
    let (shape, adam) = (rest.state(&h.shape)?, rest.state(&h.adam)?);
    let history = h.history.iter().map(|[step, seconds, loss, psnr]| HistoryPoint {
        step: *step,
        seconds: f64::from_bits(*seconds),
        loss: f64::from_bits(*loss),
        held_out_psnr: f64::from_bits(*psnr),
    });
    Ok(Loaded {
        step: h.step,
        best_psnr: f64::from_bits(h.best_psnr_bits),
        positions,
        maps,
        best_positions,
        best_maps,
        shape,
        adam,
        history: history.collect(),
        loss: h.loss.iter().map(|l| f64::from_bits(*l)).collect(),
    })
}

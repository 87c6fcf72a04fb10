//! Paths beside the picture: records to learn from, and the variance and the work of a sampler.

use super::box_of;
use photofit_flow::{Query, Record};
use photofit_image::luminance;
use photofit_pathtrace::{
    Contribution, PathVertex, PictureSink, Renderer, Sink, TrainingSink, TrainingVertex,
};
use photofit_sampling::DirectionSampler;
use photofit_scalar::Vec3f;
use rayon::prelude::*;

/// Pixels along the side of a block whose mean luminance scales the variance of its pixels.
const BLOCK: usize = 4;
/// Share of the mean luminance of the picture added to that of a block: darkness may be noisier.
const DARKNESS: f64 = 0.1;

/// Paths of every pixel of a small picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pilot<'a> {
    renderer: &'a Renderer<'a>,
    first: u32,
    count: u32,
    records: bool,
}

/// What the paths of a sampler came to.
#[derive(Debug, Default)]
pub(super) struct Trial {
    pub(super) records: Vec<Record>,
    pub(super) paths: u64,
    /// Path vertices, and rays without one.
    pub(super) work: u64,
    pub(super) columns: usize,
    /// Mean luminance and variance of single samples, pixel by pixel.
    pub(super) pixels: Vec<[f64; 2]>,
}

/// Reports to the picture and to training.
#[derive(Default)]
struct Observer {
    picture: PictureSink,
    training: Option<TrainingSink>,
    vertices: u64,
}

impl Sink for Observer {
    fn vertex(&mut self, vertex: &PathVertex) {
        self.vertices += 1;
        if let Some(training) = &mut self.training {
            training.vertex(vertex);
        }
    }

    fn attenuate(&mut self, factor: Vec3f) {
        if let Some(training) = &mut self.training {
            training.attenuate(factor);
        }
    }

    fn contribution(&mut self, light: &Contribution) {
        self.picture.contribution(light);
        if let Some(training) = &mut self.training {
            training.contribution(light);
        }
    }

    fn not_finite(&mut self) {
        self.picture.not_finite();
    }
}

impl<'a> Pilot<'a> {
    /// `count` samples of every pixel from sample `first` on.
    pub(super) fn new(renderer: &'a Renderer<'a>, first: u32, count: u32) -> Self {
        Self { renderer, first, count, records: true }
    }

    /// Keeps variance and work alone.
    pub(super) fn without_records(self) -> Self {
        Self { records: false, ..self }
    }

    /// Walks all paths with directions of `sampler`; rows run on all threads and are joined in order.
    pub(super) fn run<D: DirectionSampler + Sync>(&self, sampler: &D) -> Trial {
        let options = self.renderer.options();
        let (columns, rows) = (options.width, options.height);
        let parts: Vec<Trial> = (0..rows).into_par_iter().map(|y| self.row(y, columns, sampler)).collect();
        let mut all = Trial { columns, ..Trial::default() };
        for part in parts {
            all.records.extend(part.records);
            all.pixels.extend(part.pixels);
            all.paths += part.paths;
            all.work += part.work;
        }
        all
    }

    fn row<D: DirectionSampler>(&self, y: usize, columns: usize, sampler: &D) -> Trial {
        let mut out = Trial::default();
        let training = self.records.then(TrainingSink::weighted);
        let mut sink = Observer { training, ..Observer::default() };
        for x in 0..columns {
            let (mut sum, mut squares) = (0.0, 0.0);
            for sample in self.first..self.first + self.count {
                sink.picture = PictureSink::default();
                if let Some(training) = &mut sink.training {
                    training.begin();
                }
                self.renderer.walk([x, y], sample, sampler, &mut sink);
                let value = f64::from(luminance(sink.picture.radiance.to_array()));
                (sum, squares) = (sum + value, squares + value * value);
            }
            let n = f64::from(self.count);
            let variance = (squares - sum * sum / n).max(0.0) / (n - 1.0).max(1.0);
            out.pixels.push([sum / n, variance]);
        }
        out.paths = columns as u64 * u64::from(self.count);
        out.work = out.paths + sink.vertices;
        let vertices = sink.training.map(|t| t.vertices).unwrap_or_default();
        out.records = vertices.iter().filter_map(record).collect();
        out
    }
}

/// What a guide learns from a vertex of a surface.
fn record(v: &TrainingVertex) -> Option<Record> {
    let e = &v.event;
    if e.delta || e.normal == Vec3f::zero() {
        return None;
    }
    let query = Query { position: e.position, normal: e.normal, wo: e.wo, roughness: 1.0 };
    let value = luminance(e.weight.mul(v.radiance).to_array()) * e.pdf;
    Some(Record { query, wi: e.wi, pdf: e.pdf, value, incident: luminance(v.radiance.to_array()) })
}

impl Trial {
    /// Both, of pictures of one width: the rows of the other follow.
    pub(super) fn beside(mut self, other: Self) -> Self {
        self.records.extend(other.records);
        self.pixels.extend(other.pixels);
        self.paths += other.paths;
        self.work += other.work;
        self
    }

    /// Both, of one picture: this one's `n` samples a pixel and the other's `m`, without records.
    pub(super) fn then(self, other: Self, n: u32, m: u32) -> Self {
        if n == 0 {
            return other;
        }
        let (n, m) = (f64::from(n), f64::from(m));
        // The sum of squares around the mean of all (Chan et al. 1983).
        let pixel = |(a, b): (&[f64; 2], &[f64; 2])| {
            let step = b[0] - a[0];
            let squares = (n - 1.0) * a[1] + (m - 1.0) * b[1] + step * step * n * m / (n + m);
            [a[0] + step * m / (n + m), squares / (n + m - 1.0)]
        };
        Self {
            pixels: self.pixels.iter().zip(&other.pixels).map(pixel).collect(),
            paths: self.paths + other.paths,
            work: self.work + other.work,
            ..self
        }
    }

    /// The box around the vertices.
    pub(super) fn bounds(&self) -> (Vec3f, Vec3f) {
        box_of(self.records.iter().map(|r| r.query.position))
    }

    /// Whether any path brought light.
    pub(super) fn found_light(&self) -> bool {
        self.pixels.iter().any(|[mean, _]| *mean > 0.0)
    }

    /// Mean over the pixels of the variance of single samples over the squared luminance around, which both trials tell.
    pub(super) fn variance(&self, other: &Self) -> f64 {
        let both: Vec<f64> =
            self.pixels.iter().zip(&other.pixels).map(|(a, b)| 0.5 * (a[0] + b[0])).collect();
        let n = both.len().max(1) as f64;
        let mean = both.iter().sum::<f64>() / n;
        let width = self.columns.div_ceil(BLOCK);
        let block = |i: usize| i / self.columns / BLOCK * width + i % self.columns / BLOCK;
        let mut blocks = vec![[0.0_f64; 2]; width * (both.len() / self.columns.max(1)).div_ceil(BLOCK)];
        for (i, v) in both.iter().enumerate() {
            let sum = &mut blocks[block(i)];
            *sum = [sum[0] + v, sum[1] + 1.0];
        }
        let relative = self.pixels.iter().enumerate().map(|(i, [_, variance])| {
            let [sum, count] = blocks[block(i)];
            variance / (sum / count + DARKNESS * mean).powi(2)
        });
        relative.sum::<f64>() / n
    }
}

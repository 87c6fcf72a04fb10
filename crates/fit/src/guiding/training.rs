//! Paths beside the picture, and what a guide learns from them.

use super::box_of;
use photofit_flow::{Query, Record};
use photofit_image::luminance;
use photofit_pathtrace::{Renderer, TrainingSink, TrainingVertex};
use photofit_sampling::DirectionSampler;
use photofit_scalar::Vec3f;
use rayon::prelude::*;

/// Paths of every pixel of a small picture.
#[derive(Debug, Default)]
pub(super) struct Lesson {
    pub(super) records: Vec<Record>,
    pub(super) paths: u64,
}

impl Lesson {
    /// Walks `count` paths of every pixel with directions of `sampler`; rows run on all threads and are joined in order.
    pub(super) fn walk<D: DirectionSampler + Sync>(renderer: &Renderer<'_>, count: u32, sampler: &D) -> Self {
        let options = renderer.options();
        let row = |y: usize| -> Vec<Record> {
            let mut sink = TrainingSink::weighted();
            for x in 0..options.width {
                for sample in 0..count {
                    sink.begin();
                    renderer.walk([x, y], sample, sampler, &mut sink);
                }
            }
            sink.vertices.iter().filter_map(record).collect()
        };
        let rows: Vec<Vec<Record>> = (0..options.height).into_par_iter().map(row).collect();
        let paths = (options.width * options.height) as u64 * u64::from(count);
        Self { records: rows.concat(), paths }
    }

    /// Both.
    pub(super) fn beside(mut self, other: Self) -> Self {
        self.records.extend(other.records);
        self.paths += other.paths;
        self
    }

    /// The box around the vertices.
    pub(super) fn bounds(&self) -> (Vec3f, Vec3f) {
        box_of(self.records.iter().map(|r| r.query.position))
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

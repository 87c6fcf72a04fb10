//! Paths beside the picture, and what a guide learns from them.

use photofit_flow::{Query, Record};
use photofit_image::luminance;
use photofit_pathtrace::{Renderer, TrainingSink, TrainingVertex};
use photofit_sampling::DirectionSampler;
use photofit_scalar::{Vec3f, vec3};
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

    /// A box around the vertices, but for few that are far from all others: a grid over all of them would see the others as one
    /// place. It reaches beyond nine tenths of them along each axis by half of the longest side of those, so that it holds all of a room
    /// and what stands on a floor (what is further away counts as at its border); a unit cube without any.
    pub(super) fn bounds(&self) -> (Vec3f, Vec3f) {
        let along = |axis: usize| {
            let mut values: Vec<f32> = self.records.iter().map(|r| r.query.position[axis]).collect();
            values.retain(|v| v.is_finite());
            values.sort_unstable_by(f32::total_cmp);
            let last = values.len().checked_sub(1)?;
            Some([0, last / 20, last - last / 20, last].map(|k| values[k]))
        };
        let (Some(x), Some(y), Some(z)) = (along(0), along(1), along(2)) else {
            return (Vec3f::zero(), Vec3f::splat(1.0));
        };
        let beyond = [x, y, z].iter().map(|v| 0.5 * (v[2] - v[1])).fold(0.0, f32::max);
        let of = |v: [f32; 4]| [v[0].max(v[1] - beyond), v[3].min(v[2] + beyond)];
        let [x, y, z] = [of(x), of(y), of(z)];
        (vec3(x[0], y[0], z[0]), vec3(x[1], y[1], z[1]))
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

#[cfg(test)]
mod tests {
    use super::*;

    fn lesson(positions: impl Iterator<Item = Vec3f>) -> Lesson {
        let of = |position| {
            let query = Query { position, normal: Vec3f::zero(), wo: Vec3f::zero(), roughness: 1.0 };
            Record { query, wi: Vec3f::zero(), pdf: 1.0, value: 1.0, incident: 1.0 }
        };
        Lesson { records: positions.map(of).collect(), paths: 0 }
    }

    #[test]
    fn a_few_vertices_far_away_do_not_widen_the_box() {
        let near = |i: usize| vec3((i % 10) as f32 / 9.0, 0.0, (i / 10 % 10) as f32 / 9.0);
        let far = |i: usize| vec3(0.0, -7.0, if i.is_multiple_of(2) { -1e4 } else { 1e4 });
        let at = |i: usize| if i % 25 == 24 { far(i) } else { near(i) };
        let (lo, hi) = lesson((0..1000).map(at)).bounds();
        assert_eq!((lo, hi), (vec3(0.0, -0.5, -0.5), vec3(1.0, 0.0, 1.5)));
        // A floor with few things on it: the box holds these.
        let on_it = |i: usize| vec3((i % 10) as f32, if i.is_multiple_of(40) { 2.0 } else { 0.0 }, 0.0);
        let (lo, hi) = lesson((0..1000).map(on_it)).bounds();
        assert!((lo.y, hi.y) == (0.0, 2.0), "{lo:?} {hi:?}");
        assert_eq!(lesson(std::iter::empty()).bounds(), (Vec3f::zero(), Vec3f::splat(1.0)));
        let (lo, hi) = lesson(std::iter::once(vec3(1.0, 2.0, 3.0))).bounds();
        assert_eq!((lo, hi), (vec3(1.0, 2.0, 3.0), vec3(1.0, 2.0, 3.0)));
    }
}

//! Walks side by side: each path once, the bits of one after another, panics that reach the caller.

use super::*;
use crate::spline::Family;
use crate::{Domain, FlowGuide, FlowLocal, FlowOptions, LobeGuide, LobeOptions, Query};
use photofit_sampling::{DirectionSample, DirectionSampler, Rng, Scattering, Vertex};
use photofit_sampling::{cosine_hemisphere, cosine_hemisphere_pdf, uniform_sphere};
use photofit_scalar::{Vec3f, vec3};
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Lambert's surface.
struct Matte;

impl Scattering for Matte {
    fn sample(&self, _: f32, u: [f32; 2]) -> Option<DirectionSample> {
        let wi = cosine_hemisphere(u);
        let (weight, pdf) = (Vec3f::splat(0.5), cosine_hemisphere_pdf(wi.z));
        Some(DirectionSample { wi, weight, pdf, delta: false, transmitted: false, eta: 1.0, preference: 1.0 })
    }

    fn eval_pdf(&self, wi: Vec3f) -> (Vec3f, f32) {
        let pdf = cosine_hemisphere_pdf(wi.z);
        (Vec3f::splat(0.5 * pdf), pdf)
    }

    fn eta(&self, _: Vec3f) -> f32 {
        1.0
    }

    fn is_delta(&self) -> bool {
        false
    }

    fn has_lobes(&self) -> bool {
        false
    }
}

/// Walks of different lengths on an endless floor, which sum up what they are told; one of them may fail.
struct Walks {
    sums: Vec<Cell<f32>>,
    visits: Vec<Cell<u32>>,
    failing: Option<usize>,
}

impl Walks {
    fn new(count: usize, failing: Option<usize>) -> Self {
        Self { sums: vec![Cell::new(0.0); count], visits: vec![Cell::new(0); count], failing }
    }

    fn bits(&self) -> Vec<u32> {
        self.sums.iter().map(|s| s.get().to_bits()).collect()
    }
}

impl Paths for Walks {
    fn walk<D: DirectionSampler>(&self, path: usize, sampler: &D) {
        let mut rng = Rng::new(1, path as u64);
        self.visits[path].set(self.visits[path].get() + 1);
        let mut position = vec3(rng.next_f32(), rng.next_f32(), 0.5);
        for step in 0..path % 7 {
            let normal = vec3(0.0, 0.0, 1.0);
            let at = Vertex { position, normal, wo: vec3(0.6, 0.0, 0.8), scattering: &Matte };
            let local = sampler.local(&at);
            let wi = cosine_hemisphere([rng.next_f32(), 0.5]);
            let (value, own) = Matte.eval_pdf(wi);
            let pdf = sampler.pdf(&at, &local, wi, own);
            assert!(self.failing != Some(path) || step < 2, "path {path} fails");
            let (lobe, u) = (rng.next_f32(), [rng.next_f32(), rng.next_f32()]);
            let Some(sample) = sampler.sample(&at, &local, lobe, u) else { return };
            self.sums[path].set(self.sums[path].get() + value.x + pdf + sample.pdf * sample.wi.x);
            position += sample.wi * 0.1;
        }
    }
}

fn flow() -> FlowGuide {
    let mut guide = FlowGuide::new(Vec3f::zero(), Vec3f::splat(1.0), FlowOptions::default()).unwrap();
    guide.randomize(0.3, 1);
    guide
}

#[test]
fn walks_side_by_side_have_the_bits_of_one_after_another() {
    let (flow, lobes) = (flow(), LobeGuide::new(LobeOptions::default()));
    for count in [0, 1, 2, 95, 96, 483] {
        let single = Walks::new(count, None);
        (0..count).for_each(|path| single.walk(path, &Guided(&flow)));
        let together = Walks::new(count, None);
        Waves(&flow).walk_all(count, &together);
        assert!(together.visits.iter().all(|v| v.get() == 1), "{count}: each path once");
        assert_eq!(single.bits(), together.bits(), "{count}");
        let (single, together) = (Walks::new(count, None), Walks::new(count, None));
        (0..count).for_each(|path| single.walk(path, &Guided(&lobes)));
        Waves(&lobes).walk_all(count, &together);
        assert_eq!(single.bits(), together.bits(), "{count}, lobes");
    }
}

/// Counts the answers that are given one by one, and the rounds and the most of those that are given together.
struct Counting<'a> {
    guide: &'a FlowGuide,
    alone: Cell<usize>,
    rounds: Cell<usize>,
    most: Cell<usize>,
}

impl Counting<'_> {
    fn round(&self, answers: usize) {
        self.rounds.set(self.rounds.get() + 1);
        self.most.set(self.most.get().max(answers));
    }
}

impl Guide for Counting<'_> {
    type Local = FlowLocal;

    fn local(&self, at: &Query) -> FlowLocal {
        self.guide.local(at)
    }

    fn share(&self, local: &FlowLocal) -> f32 {
        self.guide.share(local)
    }

    fn sample(&self, local: &FlowLocal, u: [f32; 2]) -> Option<(Vec3f, f32)> {
        self.alone.set(self.alone.get() + 1);
        self.guide.sample(local, u)
    }

    fn pdf(&self, local: &FlowLocal, wi: Vec3f) -> f32 {
        self.alone.set(self.alone.get() + 1);
        self.guide.pdf(local, wi)
    }

    fn sample_all(&self, asked: &[(&FlowLocal, [f32; 2])], answers: &mut [Option<(Vec3f, f32)>]) {
        self.round(asked.len());
        self.guide.sample_all(asked, answers);
    }

    fn pdf_all(&self, asked: &[(&FlowLocal, Vec3f)], answers: &mut [f32]) {
        self.round(asked.len());
        self.guide.pdf_all(asked, answers);
    }
}

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "riscv64"))]
#[test]
fn questions_are_answered_together() {
    let flow = flow();
    let guide = Counting { guide: &flow, alone: Cell::new(0), rounds: Cell::new(0), most: Cell::new(0) };
    Waves(&guide).walk_all(700, &Walks::new(700, None));
    assert_eq!(guide.alone.get(), 0, "none alone");
    // 700 paths of 3 steps in the mean, two questions each, in rounds of up to 96: at least 44, of two kinds.
    assert!(guide.most.get() > 80 && guide.rounds.get() < 130, "{} {}", guide.most.get(), guide.rounds.get());
}

#[test]
fn answers_together_have_the_bits_of_single_ones() {
    let mut rng = Rng::new(4, 0);
    for domain in [Domain::Hemisphere, Domain::Sphere, Domain::HalfVector, Domain::Visible] {
        for (family, bins) in [(Family::Quadratic, 15), (Family::Quadratic, 31), (Family::Rational, 10)] {
            let options = FlowOptions { domain, family, bins, ..FlowOptions::default() };
            let mut guide = FlowGuide::new(Vec3f::zero(), Vec3f::splat(1.0), options).unwrap();
            guide.randomize(0.3, 2);
            let mut next = || rng.next_f32();
            let asked: Vec<(FlowLocal, [f32; 2], Vec3f)> = (0..35)
                .map(|_| {
                    let normal = uniform_sphere([next(), next()]);
                    let position = vec3(next(), next(), next());
                    let wo = uniform_sphere([next(), next()]);
                    let local = guide.local(&Query { position, normal, wo, roughness: next() });
                    (local, [next(), next()], uniform_sphere([next(), next()]))
                })
                .collect();
            for n in [0, 1, 16, 35] {
                let points: Vec<_> = asked[..n].iter().map(|(l, u, _)| (l, *u)).collect();
                let directions: Vec<_> = asked[..n].iter().map(|(l, _, wi)| (l, *wi)).collect();
                let (mut samples, mut densities) = (vec![None; n], vec![f32::NAN; n]);
                guide.sample_all(&points, &mut samples);
                guide.pdf_all(&directions, &mut densities);
                let single: Vec<_> = points.iter().map(|(l, u)| guide.sample(l, *u)).collect();
                assert_eq!(samples, single, "{domain:?}, {family:?}");
                let single: Vec<f32> = directions.iter().map(|(l, wi)| guide.pdf(l, *wi)).collect();
                assert_eq!(densities, single, "{domain:?}, {family:?}");
                // Both kinds of answers are there.
                let none = densities.iter().filter(|d| **d == 0.0).count();
                assert!(n < 35 || domain == Domain::Sphere || (1..n).contains(&none), "{domain:?}: {none}");
            }
        }
    }
}

#[test]
fn a_walk_that_panics_ends_the_wave_with_its_message() {
    let guide = flow();
    for _ in 0..3 {
        let walks = Walks::new(300, Some(104));
        let payload = catch_unwind(AssertUnwindSafe(|| Waves(&guide).walk_all(300, &walks))).unwrap_err();
        let message = payload.downcast_ref::<String>().unwrap();
        assert_eq!(message, "path 104 fails");
        // What comes after is whole.
        let (single, together) = (Walks::new(300, None), Walks::new(300, None));
        (0..300).for_each(|path| single.walk(path, &Guided(&guide)));
        Waves(&guide).walk_all(300, &together);
        assert_eq!(single.bits(), together.bits());
    }
}

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "riscv64"))]
#[test]
fn a_walk_that_asks_at_an_earlier_vertex_is_told() {
    struct Early;
    impl Paths for Early {
        fn walk<D: DirectionSampler>(&self, path: usize, sampler: &D) {
            let normal = vec3(0.0, 0.0, 1.0);
            let at = |x: f32| {
                let position = vec3(x, 0.0, 0.0);
                Vertex { position, normal, wo: vec3(0.6, 0.0, 0.8), scattering: &Matte }
            };
            let first = sampler.local(&at(0.1));
            let second = sampler.local(&at(0.9));
            sampler.pdf(&at(0.9), &second, normal, 0.3);
            if path == 5 {
                sampler.pdf(&at(0.1), &first, normal, 0.3);
            }
        }
    }
    let guide = flow();
    let payload = catch_unwind(AssertUnwindSafe(|| Waves(&guide).walk_all(40, &Early))).unwrap_err();
    let message = payload.downcast_ref::<String>().unwrap();
    assert!(message.contains("the vertex that it prepared last"), "{message}");
}

#[test]
fn waves_within_waves_work() {
    struct Outer<'a>(&'a FlowGuide, Vec<Cell<u32>>);
    impl Paths for Outer<'_> {
        fn walk<D: DirectionSampler>(&self, path: usize, sampler: &D) {
            let own = Walks::new(7, None);
            own.walk(6, sampler);
            let inner = Walks::new(7, None);
            Waves(self.0).walk_all(7, &inner);
            assert_eq!(own.sums[6], inner.sums[6]);
            self.1[path].set(1);
        }
    }
    let guide = flow();
    let outer = Outer(&guide, vec![Cell::new(0); 5]);
    Waves(&guide).walk_all(5, &outer);
    assert!(outer.1.iter().all(|v| v.get() == 1));
}

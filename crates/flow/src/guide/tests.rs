//! The mixture with the scattering function estimates what the scattering function alone estimates.

use super::*;
use crate::{FlowGuide, FlowOptions, LobeGuide, LobeOptions};
use photofit_sampling::{
    Rng, ScatteringSampler, chi_square, cosine_hemisphere, cosine_hemisphere_pdf, uniform_sphere,
    uniform_sphere_pdf,
};
use photofit_scalar::vec3;

/// Lambert's surface with +z as its normal, and a mirror of probability `mirror` on it; what lies below is of index 1.5.
struct Plastic {
    mirror: f32,
}

const WO: Vec3f = Vec3f { x: 0.6, y: 0.0, z: 0.8 };

impl Scattering for Plastic {
    fn sample(&self, lobe: f32, u: [f32; 2]) -> Option<DirectionSample> {
        let delta = lobe < self.mirror;
        let wi = if delta { vec3(-WO.x, -WO.y, WO.z) } else { cosine_hemisphere(u) };
        let weight = Vec3f::splat(if delta { 1.0 } else { 0.5 });
        let pdf = if delta { 1.0 } else { (1.0 - self.mirror) * cosine_hemisphere_pdf(wi.z) };
        Some(DirectionSample { wi, weight, pdf, delta, transmitted: false, eta: 1.0, preference: 1.0 })
    }

    fn eval_pdf(&self, wi: Vec3f) -> (Vec3f, f32) {
        let pdf = (1.0 - self.mirror) * cosine_hemisphere_pdf(wi.z);
        (Vec3f::splat(0.5 * pdf), pdf)
    }

    fn eta(&self, wi: Vec3f) -> f32 {
        if wi.z < 0.0 { 1.5 } else { 1.0 }
    }

    fn is_delta(&self) -> bool {
        self.mirror >= 1.0
    }

    fn has_lobes(&self) -> bool {
        self.mirror > 0.0
    }
}

fn light(wi: Vec3f) -> f32 {
    0.1 + 20.0 * (100.0 * (vec3(0.0, 0.8, 0.6).dot(wi) - 1.0)).exp()
}

/// Mean, its standard error and the records of an estimate of the reflected light.
fn estimate<D: DirectionSampler>(sampler: &D, mirror: f32, seed: u64) -> (f64, f64, Vec<Record>) {
    let surface = Plastic { mirror };
    let normal = vec3(0.0, 0.0, 1.0);
    let at = Vertex { position: Vec3f::splat(0.5), normal, wo: WO, scattering: &surface };
    let (n, mut sum, mut squares, mut records) = (40_000, 0.0, 0.0, Vec::new());
    for i in 0..n {
        let mut rng = Rng::new(seed, i);
        let (lobe, u) = (rng.next_f32(), [rng.next_f32(), rng.next_f32()]);
        let Some(s) = sampler.sample(&at, &sampler.local(&at), lobe, u) else { continue };
        let value = s.weight.x * light(s.wi);
        (sum, squares) = (sum + f64::from(value), squares + f64::from(value * value));
        if !s.delta {
            let own = surface.eval_pdf(s.wi).1;
            let pdf = sampler.pdf(&at, &sampler.local(&at), s.wi, own);
            assert!((pdf / s.pdf - 1.0).abs() < 2e-2 || s.weight.x == 0.0, "one density: {pdf} {}", s.pdf);
            let query = Query { position: at.position, normal, wo: WO, roughness: 1.0 };
            records.push(Record { query, wi: s.wi, pdf: s.pdf, value: value * s.pdf, incident: light(s.wi) });
        }
    }
    let n = n as f64;
    let mean = sum / n;
    (mean, ((squares / n - mean * mean) / n).sqrt(), records)
}

fn stays_unbiased<G: Learn>(name: &str, mut guide: G) {
    for mirror in [0.0, 0.3, 1.0] {
        let (expected, error, _) = estimate(&ScatteringSampler, mirror, 1);
        for stage in 0..5 {
            let (mean, guided, records) = estimate(&Guided(&guide), mirror, 2 + stage);
            let z = (mean - expected) / (error * error + guided * guided).sqrt().max(1e-9);
            assert!(z.abs() < 4.0, "{name}, mirror {mirror}, stage {stage}: {mean} {expected}, z {z}");
            if stage == 4 && mirror < 1.0 {
                assert!(guided < 0.6 * error, "{name}: standard error {guided}, unguided {error}");
            }
            guide.learn(&records).unwrap();
        }
    }
}

#[test]
fn guided_estimates_are_unbiased_at_every_stage_of_training() {
    let flow = FlowGuide::new(Vec3f::zero(), Vec3f::splat(1.0), FlowOptions::default()).unwrap();
    stays_unbiased("flow", flow);
    stays_unbiased("lobes", LobeGuide::new(LobeOptions::default()));
}

/// Knows nothing: all directions alike, with a given share.
struct Uniform(f32);

impl Guide for Uniform {
    type Local = ();

    fn local(&self, _: &Query) {}

    fn share(&self, _: &()) -> f32 {
        self.0
    }

    fn sample(&self, _: &(), u: [f32; 2]) -> Option<(Vec3f, f32)> {
        Some((uniform_sphere(u), uniform_sphere_pdf()))
    }

    fn pdf(&self, _: &(), _: Vec3f) -> f32 {
        uniform_sphere_pdf()
    }
}

fn matte(scattering: &Plastic) -> Vertex<'_, Plastic> {
    Vertex { position: Vec3f::zero(), normal: vec3(0.0, 0.0, 1.0), wo: WO, scattering }
}

#[test]
fn mixtures_have_the_density_that_they_state() {
    const N: u64 = 200_000;
    const CELLS: [usize; 2] = [12, 8];
    let surface = Plastic { mirror: 0.0 };
    for share in [0.0, 0.3, 0.9] {
        let guide = Uniform(share);
        let (mixture, at) = (Guided(&guide), matte(&surface));
        let mut counts = vec![0_u64; CELLS[0] * CELLS[1]];
        for i in 0..N {
            let mut rng = Rng::new(5, i);
            let (lobe, u) = (rng.next_f32(), [rng.next_f32(), rng.next_f32()]);
            let sample = mixture.sample(&at, &mixture.local(&at), lobe, u).unwrap();
            let (value, own) = surface.eval_pdf(sample.wi);
            let pdf = mixture.pdf(&at, &mixture.local(&at), sample.wi, own);
            if sample.wi.z > 0.0 {
                assert!((sample.pdf - pdf).abs() <= 1e-6 * pdf, "one density for both ways");
            }
            assert!((sample.weight.x * sample.pdf - value.x).abs() <= 1e-5 * value.x.max(1e-3));
            assert!(sample.transmitted == (sample.wi.z < 0.0));
            assert_eq!(sample.eta, if sample.transmitted { 1.5 } else { 1.0 }, "roulette sees refraction");
            let turn = 0.5 + sample.wi.y.atan2(sample.wi.x) / std::f32::consts::TAU;
            let row = ((0.5 - 0.5 * sample.wi.z) * CELLS[0] as f32) as usize;
            let column = (turn * CELLS[1] as f32) as usize;
            counts[row.min(CELLS[0] - 1) * CELLS[1] + column.min(CELLS[1] - 1)] += 1;
        }
        // The integral over a ring between two heights: half the difference, and of the cosine lobe that of their squares.
        let expected: Vec<f64> = (0..counts.len())
            .map(|i| {
                let height = |row: usize| 1.0 - 2.0 * row as f64 / CELLS[0] as f64;
                let (top, bottom) = (height(i / CELLS[1]), height(i / CELLS[1] + 1));
                let lambert = top.max(0.0).powi(2) - bottom.max(0.0).powi(2);
                let share = f64::from(share);
                (share * 0.5 * (top - bottom) + (1.0 - share) * lambert) / CELLS[1] as f64
            })
            .collect();
        let z = chi_square::deviation(&counts, &expected);
        assert!(z < chi_square::bound(3), "share {share}: {z:.1} deviations");
    }
}

#[test]
fn mixtures_keep_the_energy_of_delta_lobes() {
    const N: u64 = 100_000;
    for (mirror, share) in [(0.4, 0.3), (0.0, 0.5), (1.0, 0.5)] {
        let (surface, guide) = (Plastic { mirror }, Uniform(share));
        let (mixture, at) = (Guided(&guide), matte(&surface));
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in 0..N {
            let mut rng = Rng::new(5, i);
            let (lobe, u) = (rng.next_f32(), [rng.next_f32(), rng.next_f32()]);
            let sample = mixture.sample(&at, &mixture.local(&at), lobe, u);
            let weight = sample.map_or(0.0, |s| f64::from(s.weight.x));
            (sum, squares) = (sum + weight, squares + weight * weight);
        }
        let n = N as f64;
        let mean = sum / n;
        let error = ((squares / n - mean * mean).max(0.0) / n).sqrt();
        let expected = f64::from(mirror + (1.0 - mirror) * 0.5);
        assert!((mean - expected).abs() < 4.0 * error + 1e-6, "{mean} +- {error}, expected {expected}");
    }
}

//! The mixture with the scattering function estimates what the scattering function alone estimates.

use super::*;
use crate::{FlowGuide, FlowOptions, LobeGuide, LobeOptions};
use photofit_sampling::{Rng, ScatteringSampler, cosine_hemisphere, cosine_hemisphere_pdf};
use photofit_scalar::vec3;

/// Lambert's surface with +z as its normal, and a mirror of probability `mirror` on it.
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
            let (_, pdf) = sampler.eval_pdf(&at, &sampler.local(&at), s.wi);
            assert!((pdf / s.pdf - 1.0).abs() < 2e-2 || s.weight.x == 0.0, "one density: {pdf} {}", s.pdf);
            let query = Query { position: at.position, normal, wo: WO, roughness: 1.0 };
            records.push(Record { query, wi: s.wi, pdf: s.pdf, value: value * s.pdf, incident: light(s.wi) });
        }
    }
    let n = n as f64;
    let mean = sum / n;
    (mean, ((squares / n - mean * mean) / n).sqrt(), records)
}

fn stays_unbiased<G: Guide>(name: &str, mut guide: G) {
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

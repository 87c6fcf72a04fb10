//! The small problems of `assets/optima.py`, by the same formulas.

use photofit_sampling::hash;

use crate::Shape;
use crate::admm::{DataTerm, Problem, Weight};

pub(crate) const SIZE: usize = 32;
const PIXELS: usize = SIZE * SIZE;

pub(crate) fn uniform(stream: u64, index: usize) -> f64 {
    (hash(7, stream, index as u64) >> 11) as f64 / (1_u64 << 53) as f64
}

pub(crate) fn clean(channel: usize) -> Vec<f64> {
    let c = channel as f64;
    (0..PIXELS)
        .map(|k| {
            let (i, j) = ((k / SIZE) as f64, (k % SIZE) as f64);
            let disc = if (i - 15.0).powi(2) + (j - 13.0).powi(2) < 81.0 { 1.0 } else { 0.0 };
            let ramp = 0.3 * j / 31.0 + 0.1 * i / 31.0;
            let step = if i + j > 44.0 { 0.25 } else { 0.0 };
            0.2 + ramp * (1.0 - 0.2 * c) + (0.4 - 0.01 * i) * disc + step * (1.0 + 0.3 * c)
        })
        .collect()
}

pub(crate) fn noisy(channel: usize) -> Vec<f64> {
    let amplitude = 0.1 * 12.0_f64.sqrt();
    let noise = |k| amplitude * (uniform(channel as u64, k) - 0.5);
    clean(channel).iter().enumerate().map(|(k, v)| v + noise(k)).collect()
}

pub(crate) fn seen(weight: f64) -> Weight<f64> {
    Weight::Map((0..PIXELS).map(|k| if uniform(10, k) >= 0.4 { weight } else { 0.0 }).collect())
}

/// A named problem with its target, guide and probe.
pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) shape: Shape,
    pub(crate) target: Vec<f64>,
    pub(crate) guide: Vec<f64>,
    pub(crate) probe: Vec<f64>,
    make: fn(Problem<'_, f64>) -> Problem<'_, f64>,
    guided: bool,
}

impl Case {
    pub(crate) fn problem(&self) -> Problem<'_, f64> {
        let lambda = Weight::Uniform(0.0);
        let problem = (self.make)(Problem::new(self.shape, &self.target, DataTerm::L2 { lambda }));
        if self.guided { problem.with_guide(1.0, &self.guide) } else { problem }
    }
}

fn guide() -> Vec<f64> {
    let u = clean(0);
    let mut g = crate::operators::gradient(crate::operators::Boundary::Neumann, SIZE, SIZE, &u);
    for (k, v) in g.iter_mut().enumerate() {
        *v += 0.02 * (uniform(20 + (k / PIXELS) as u64, k % PIXELS) - 0.5);
    }
    g
}

fn with_data<'a>(mut p: Problem<'a, f64>, data: DataTerm<f64>) -> Problem<'a, f64> {
    p.data = data;
    p
}

pub(crate) fn cases() -> Vec<Case> {
    let gray = |name, make: fn(Problem<'_, f64>) -> Problem<'_, f64>, guided: bool, outliers: bool| {
        let mut target = noisy(0);
        if outliers {
            for (k, v) in target.iter_mut().enumerate() {
                if uniform(11, k) < 0.05 {
                    *v = 1.0;
                }
            }
        }
        Case { name, shape: Shape::new(SIZE, SIZE, 1), target, guide: guide(), probe: clean(0), make, guided }
    };
    let rgb = |name, make: fn(Problem<'_, f64>) -> Problem<'_, f64>| Case {
        name,
        shape: Shape::new(SIZE, SIZE, 3),
        target: (0..3).flat_map(noisy).collect(),
        guide: Vec::new(),
        probe: (0..3).flat_map(clean).collect(),
        make,
        guided: false,
    };
    vec![
        gray("rof", |p| with_data(p, DataTerm::L2 { lambda: 8.0.into() }).with_gradient(1.0), false, false),
        gray(
            "rof_holes",
            |p| with_data(p, DataTerm::L2 { lambda: seen(8.0) }).with_gradient(1.0),
            false,
            false,
        ),
        gray("tv_l1", |p| with_data(p, DataTerm::L1 { lambda: 1.2.into() }).with_gradient(1.0), false, false),
        gray(
            "tv_l1_holes",
            |p| with_data(p, DataTerm::L1 { lambda: seen(1.2) }).with_gradient(1.0),
            false,
            false,
        ),
        gray(
            "htv_l2_holes",
            |p| with_data(p, DataTerm::L2 { lambda: seen(8.0) }).with_gradient(0.5).with_hessian(1.0),
            false,
            false,
        ),
        gray(
            "htv_l2_n_holes",
            |p| with_data(p, DataTerm::L2 { lambda: seen(8.0) }).with_gradient(0.1).with_hessian(0.5),
            true,
            false,
        ),
        gray(
            "htv_l1_n_holes",
            |p| with_data(p, DataTerm::L1 { lambda: seen(1.2) }).with_gradient(0.1).with_hessian(0.5),
            true,
            true,
        ),
        gray(
            "hybrid_n_holes",
            |p| {
                with_data(p, DataTerm::Hybrid { l1: seen(0.6), l2: seen(4.0) })
                    .with_gradient(0.1)
                    .with_hessian(0.5)
            },
            true,
            true,
        ),
        gray(
            "huber_holes",
            |p| {
                with_data(p, DataTerm::Huber { lambda: seen(8.0), delta: 0.05.into() })
                    .with_gradient(0.2)
                    .with_hessian(0.5)
            },
            false,
            true,
        ),
        rgb("mc_hybrid", |p| {
            let alpha = (0..PIXELS).map(|k| 0.1 * (0.2 + 0.8 * (k % SIZE) as f64 / 31.0)).collect::<Vec<_>>();
            with_data(p, DataTerm::Hybrid { l1: 0.1.into(), l2: 0.5.into() }).with_gradient(alpha).vectorial()
        }),
        rgb("rof_vectorial", |p| {
            with_data(p, DataTerm::L2 { lambda: 8.0.into() }).with_gradient(1.0).vectorial()
        }),
    ]
}

/// Optimum and probe energy from the stored results.
pub(crate) fn stored(name: &str) -> [f64; 2] {
    let text = include_str!("../../../../../assets/optima.json");
    let json: serde_json::Value = serde_json::from_str(text).expect("stored optima");
    ["optimum", "probe"].map(|key| json[name][key].as_f64().expect(name))
}

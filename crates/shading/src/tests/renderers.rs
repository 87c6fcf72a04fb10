//! The rasterizer's shading against what the path tracer integrates, for every kind of light.

use super::lighting::{MAP, radiance};
use super::{at_cosine, unit};
use crate::bsdf::{MetallicRoughness, Scatter};
use crate::{Energy, Light, Surface, Yaw, shade};
use photofit_gradcheck::Uniform;
use photofit_sampling::Sobol;
use photofit_scalar::{Vec3, vec3};
use std::fmt::Write as _;

const ROUGHNESSES: [f64; 6] = [0.0, 0.03, 0.1, 0.3, 0.6, 1.0];
const METALNESSES: [f64; 3] = [0.0, 0.5, 1.0];
const ANGLES: [f64; 3] = [0.0, 45.0, 80.0];
/// Samples of the path tracer's integral.
const SAMPLES: u32 = 1 << 13;

/// A point seen by a viewer: the material, the axes of its frame, and the direction in the world.
struct Point {
    surface: Surface<f64>,
    bsdf: MetallicRoughness<f64>,
    axes: [Vec3<f64>; 3],
    wo: Vec3<f64>,
}

impl Point {
    fn new(surface: Surface<f64>, energy: Energy, degrees: f64, random: &mut Uniform) -> Self {
        let n = unit(random);
        let (s, t) = n.orthonormal_pair();
        let wo = at_cosine(random, n, degrees.to_radians().cos());
        Self { surface, bsdf: MetallicRoughness::new(&surface, energy), axes: [s, t, n], wo }
    }

    fn local(&self, d: Vec3<f64>) -> Vec3<f64> {
        Vec3::from_array(self.axes.map(|a| a.dot(d)))
    }

    fn world(&self, d: Vec3<f64>) -> Vec3<f64> {
        self.axes[0] * d.x + self.axes[1] * d.y + self.axes[2] * d.z
    }

    fn rasterized(&self, light: Light<'_, f64>) -> Vec3<f64> {
        shade(&self.surface, self.bsdf.energy, Vec3::zero(), self.axes[2], self.wo, &[light])
    }

    /// The path tracer's value for light from one direction.
    fn traced(&self, wi: Vec3<f64>) -> Vec3<f64> {
        self.bsdf.eval(self.local(self.wo), self.local(wi))
    }

    /// The path tracer's integral over light from everywhere.
    fn integrated(&self, light: impl Fn(Vec3<f64>) -> Vec3<f64>) -> Vec3<f64> {
        let (points, wo) = (Sobol::new(3, 0), self.local(self.wo));
        let mut sum = Vec3::zero();
        for i in 0..SAMPLES {
            let lobe = f64::from(points.sample(i, 0));
            if let Some(s) = self.bsdf.sample(wo, lobe, points.sample_2d(i, 1).map(f64::from)) {
                sum += s.weight.mul(light(self.world(s.wi)));
            }
        }
        sum / f64::from(SAMPLES)
    }

    /// Largest relative difference for light from single directions: the mirror direction, beside it, anywhere.
    fn single_direction(&self, random: &mut Uniform, point: bool) -> f64 {
        let n = self.axes[2];
        let mirror = n * (2.0 * n.dot(self.wo)) - self.wo;
        let mut worst = 0.0_f64;
        for k in 0..12 {
            let spread = if k < 8 { 1e-4 * 4_f64.powi(k) } else { 4.0 };
            let wi = (mirror + unit(random) * spread).normalize_or_zero();
            let light = if point {
                Light::Point { position: wi * 2.0, intensity: Vec3::splat(4.0) }
            } else {
                Light::Directional { direction: wi, irradiance: Vec3::splat(1.0) }
            };
            let (a, b) = (self.rasterized(light), self.traced(wi));
            if b.length() > 0.0 || a.length() > 0.0 {
                worst = worst.max((a - b).length() / a.length().max(b.length()));
            }
        }
        worst
    }

    fn ambient(&self) -> f64 {
        let light = Light::Ambient { radiance: Vec3::splat(1.0) };
        (self.rasterized(light) - self.integrated(|_| Vec3::splat(1.0))).length() / 3_f64.sqrt()
    }
}

/// Points of one row and one angle of the table: always the same.
fn points(surface: Surface<f64>, energy: Energy, row: usize, angle: usize) -> Vec<Point> {
    let mut random = Uniform::new(51 + (row * ANGLES.len() + angle) as u64);
    (0..16).map(|_| Point::new(surface, energy, ANGLES[angle], &mut random)).collect()
}

/// Relative rms difference under the sky, over several points; the rasterizer's sky is `scale` times as bright, and turned.
fn environment(points: &[Point], scale: f64, rotation: Yaw<f64>) -> f64 {
    let map = MAP.cast();
    let (mut error, mut size) = (0.0, 0.0);
    for p in points {
        let light = Light::Environment { map: &map, rotation, scale };
        let exact = p.integrated(radiance);
        error += (p.rasterized(light) - exact).length_squared();
        size += exact.length_squared();
    }
    (error / size).sqrt()
}

/// What [`environment`] says of each roughness and metalness (rows) and angle, in percent, with single scattering and with
/// multiple: the split sum's own error. At grazing angles the lobe of the prefiltered map, which is isotropic, has another
/// shape, and a sun of 500 times the sky's radiance shows it.
const MEASURED: [[[f64; 3]; 18]; 2] = [
    [
        [1.2, 1.6, 3.5],
        [1.4, 1.9, 3.0],
        [0.4, 0.2, 0.4],
        [2.2, 1.1, 3.5],
        [1.7, 1.1, 3.0],
        [0.4, 0.7, 0.3],
        [1.0, 2.3, 2.9],
        [4.0, 2.1, 2.4],
        [8.1, 1.4, 1.7],
        [2.0, 2.2, 34.8],
        [6.6, 3.0, 22.9],
        [2.7, 6.2, 9.3],
        [4.0, 2.2, 3.0],
        [8.8, 7.2, 12.6],
        [14.9, 17.7, 51.1],
        [1.3, 1.8, 2.8],
        [3.7, 3.0, 10.4],
        [5.9, 8.9, 15.8],
    ],
    [
        [2.6, 3.5, 2.1],
        [1.3, 2.2, 4.2],
        [0.4, 0.2, 0.4],
        [4.2, 2.6, 2.1],
        [2.3, 1.6, 4.2],
        [0.4, 0.7, 0.3],
        [2.5, 4.3, 1.7],
        [5.2, 3.3, 3.9],
        [8.1, 1.4, 1.8],
        [2.9, 2.7, 48.1],
        [8.3, 4.9, 28.6],
        [3.6, 6.6, 12.4],
        [3.9, 2.9, 3.0],
        [10.2, 8.4, 15.2],
        [13.8, 15.8, 45.5],
        [1.8, 1.5, 1.7],
        [2.9, 3.4, 9.2],
        [3.4, 2.1, 9.0],
    ],
];

/// Largest relative difference that is accepted in a cell of the table.
fn bound(energy: Energy, row: usize, angle: usize) -> f64 {
    let of = usize::from(energy == Energy::Compensated);
    0.01 * (1.3 * MEASURED[of][row][angle] + 0.2)
}

fn surface(row: usize) -> Surface<f64> {
    let (roughness, metallic) = (ROUGHNESSES[row / METALNESSES.len()], METALNESSES[row % METALNESSES.len()]);
    Surface { base_color: vec3(0.9, 0.6, 0.3), roughness, metallic, gamma: 0.0 }
}

fn compare(energy: Energy) {
    let mut random = Uniform::new(51);
    let mut table = String::from(
        "| roughness | metalness | point, sun | ambient 0°, 45°, 80° | environment 0°, 45°, 80° |\n",
    );
    let (mut worst_ambient, mut worst_environment) = (0.0_f64, 0.0_f64);
    let mut faults = Vec::new();
    for row in 0..ROUGHNESSES.len() * METALNESSES.len() {
        let surface = surface(row);
        let mut single = 0.0_f64;
        let (mut ambient, mut sky) = ([0.0; 3], [0.0; 3]);
        for k in 0..ANGLES.len() {
            let points = points(surface, energy, row, k);
            for p in &points {
                single = single.max(p.single_direction(&mut random, true));
                single = single.max(p.single_direction(&mut random, false));
            }
            ambient[k] = points[0].ambient();
            sky[k] = environment(&points, 1.0, Yaw::default());
            worst_ambient = worst_ambient.max(ambient[k]);
            worst_environment = worst_environment.max(sky[k]);
            if sky[k] > bound(energy, row, k) {
                faults.push(format!("row {row}, angle {k}: an environment differs by {}", sky[k]));
            }
            if ambient[k] > 6e-3 {
                faults.push(format!("row {row}, angle {k}: ambient light differs by {}", ambient[k]));
            }
        }
        if single > 1e-10 {
            faults.push(format!("row {row}: light from one direction differs by {single:.1e}"));
        }
        let [a, b, c] = ambient.map(|x| format!("{x:.4}"));
        let [d, e, f] = sky.map(|x| format!("{:.1}", 100.0 * x));
        let Surface { roughness, metallic, .. } = surface;
        writeln!(table, "| {roughness} | {metallic} | {single:.0e} | {a}, {b}, {c} | {d}, {e}, {f} |")
            .expect("a string takes anything");
    }
    println!("{energy:?}\n{table}worst: ambient {worst_ambient:.4}, environment {worst_environment:.3}");
    assert!(faults.is_empty(), "{energy:?}: {faults:#?}");
}

#[test]
fn both_renderers_show_the_same_with_single_scattering() {
    compare(Energy::Single);
}

#[test]
fn both_renderers_show_the_same_with_multiple_scattering() {
    compare(Energy::Compensated);
}

#[test]
fn single_precision_agrees_too() {
    let mut random = Uniform::new(52);
    for energy in [Energy::Single, Energy::Compensated] {
        for _ in 0..3000 {
            let roughness = random.range(0.0, 1.0);
            let surface = super::material(&mut random, roughness);
            let (a, b) = (random.range(0.01, 1.0), random.range(0.01, 1.0));
            let up = vec3(0.0_f32, 0.0, 1.0);
            let (wo, wi) = (at_cosine(&mut random, up.cast(), a), at_cosine(&mut random, up.cast(), b));
            let (wo, wi) = (wo.cast::<f32>(), wi.cast::<f32>());
            let sun = Light::Directional { direction: wi, irradiance: Vec3::splat(1.0) };
            let rasterized = shade(&surface.cast::<f32>(), energy, Vec3::zero(), up, wo, &[sun]);
            let traced = MetallicRoughness::new(&surface.cast::<f32>(), energy).eval(wo, wi);
            assert_eq!(rasterized, traced, "{surface:?} {wo:?} {wi:?}");
        }
    }
}

#[test]
fn a_difference_would_be_noticed() {
    let mut random = Uniform::new(53);
    let surface = Surface { base_color: vec3(0.9, 0.6, 0.3), roughness: 0.3, metallic: 1.0, gamma: 0.0 };
    let mut point = Point::new(surface, Energy::Single, 45.0, &mut random);
    assert!(point.ambient() < 6e-3 && point.single_direction(&mut random, false) < 1e-10);
    point.bsdf.lobes.roughness = 0.303;
    assert!(point.single_direction(&mut random, false) > 1e-3);
    let rough = Surface { roughness: 1.0, ..surface };
    let mut point = Point::new(rough, Energy::Single, 45.0, &mut random);
    point.bsdf.energy = Energy::Compensated;
    let light = Light::Ambient { radiance: Vec3::splat(1.0) };
    let single = shade(&rough, Energy::Single, Vec3::zero(), point.axes[2], point.wo, &[light]);
    let compensated = point.integrated(|_| Vec3::splat(1.0));
    assert!((single - compensated).length() > 0.05, "{single:?} {compensated:?}");
    // Under the sky: another brightness, and another direction, each by little, are more than any cell's bound.
    for (row, angle) in [(2, 0), (5, 0), (8, 1), (11, 0), (11, 1)] {
        let energy = Energy::Single;
        let points = points(super::renderers::surface(row), energy, row, angle);
        let most = bound(energy, row, angle);
        let right = environment(&points, 1.0, Yaw::default());
        assert!(right < most, "row {row}, angle {angle}: {right} {most}");
        for (what, scale, turn) in [("brighter", 1.0 + 2.0 * most, 0.0), ("turned", 1.0, 0.3)] {
            let wrong = environment(&points, scale, Yaw::new(turn));
            assert!(wrong > most, "row {row}, angle {angle}, {what}: {wrong} within {most}");
        }
    }
}

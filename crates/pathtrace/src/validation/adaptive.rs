//! What stopping by noise does to means: tiles end by a measure of the samples that are shown.

use super::scenes::{cornell, cornell_view, square};
use crate::{Material, Parts, RenderOptions, Renderer, Shape, View, World};
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::{Bsdf, Dielectric, TransportMode};

/// Independent renders of one tile, and samples of each pixel at which a render may stop.
const SEEDS: u64 = 800;
const STOPS: [u32; 4] = [32, 64, 96, 128];

/// Mean luminance and noise of a tile at every stop.
fn courses(parts: Parts, view: &View) -> Vec<[(f64, f64); STOPS.len()]> {
    let world = World::new(parts).unwrap();
    let course = |seed| {
        let options = RenderOptions { seed, ..square(16, STOPS[STOPS.len() - 1]) };
        let mut renderer = Renderer::new(&world, view, options).unwrap();
        let mut at = Vec::new();
        loop {
            let progress = renderer.pass(|| false);
            if STOPS.iter().any(|n| u64::from(*n) * 256 == progress.samples) {
                let picture = renderer.picture();
                let mean = picture
                    .data
                    .chunks(4)
                    .map(|p| f64::from(crate::light::luminance(vec3(p[0], p[1], p[2]))));
                at.push((mean.sum::<f64>() / 256.0, progress.noise));
            }
            if progress.done {
                return at.try_into().expect("a pass ends at every stop");
            }
        }
    };
    (0..SEEDS).map(course).collect()
}

/// Relative difference, with its standard error, of the mean where each render stops at the first noise below `noise` from
/// the mean of the same renders with all samples; and samples per pixel that were taken.
fn bias(courses: &[[(f64, f64); STOPS.len()]], noise: f64) -> (f64, f64, f64) {
    let last = STOPS.len() - 1;
    let stop = |c: &[(f64, f64); STOPS.len()]| c.iter().position(|at| at.1 <= noise).unwrap_or(last);
    let n = courses.len() as f64;
    let whole = courses.iter().map(|c| c[last].0).sum::<f64>() / n;
    let differences: Vec<f64> = courses.iter().map(|c| (c[stop(c)].0 - c[last].0) / whole).collect();
    let mean = differences.iter().sum::<f64>() / n;
    let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let samples = courses.iter().map(|c| f64::from(STOPS[stop(c)])).sum::<f64>() / n;
    (mean, (variance / n).sqrt(), samples)
}

/// The box with a ball of glass: light that it gathers is found by rare paths.
fn caustic() -> Parts {
    let mut parts = cornell();
    let glass = Dielectric {
        ior: 1.5,
        reflectance: Vec3f::splat(1.0),
        transmittance: Vec3f::splat(1.0),
        mode: TransportMode::Radiance,
    };
    let ball = Shape::Sphere { center: vec3(0.2, 0.5, 0.15), radius: 0.14 };
    parts.add(ball, Material::new(Bsdf::Dielectric(glass)));
    parts
}

#[test]
#[ignore = "slow: 1600 renders of 128 samples"]
fn stopping_by_noise_darkens_by_little() {
    for (name, parts) in [("box", cornell()), ("caustic", caustic())] {
        // A tile of the floor and the short block alone: all of a small picture is one tile.
        let courses = courses(parts, &View { half: [0.2, 0.2], ..cornell_view() });
        let mut first: Vec<f64> = courses.iter().map(|c| c[0].1).collect();
        first.sort_by(f64::total_cmp);
        for share in [0.25, 0.5, 0.75] {
            // The worst bounds: a share of the renders stops at the first look.
            let noise = first[(share * first.len() as f64) as usize];
            let (bias, error, samples) = bias(&courses, noise);
            println!(
                "{name:<8} noise {noise:.3}: {samples:>5.1} samples, bias {:+.3} % +- {:.3} %",
                100.0 * bias,
                100.0 * error
            );
            assert!(error < 1e-3 && bias.abs() < 4e-3, "{name} {noise}: {bias} +- {error}");
        }
    }
}

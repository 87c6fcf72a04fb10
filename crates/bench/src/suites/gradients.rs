//! Position gradients at silhouettes against central differences of a picture of 4096 samples a pixel, with random
//! weights: error against time for each number of samples.

use super::colors::{Model, PASSES};
use crate::context::Context;
use anyhow::Result;
use photofit_geometry::{Mesh, shapes};
use photofit_raster::deferred::{Frame, Passes};
use photofit_raster::project::{Matrix4, matrix_rows};
use photofit_scalar::{Vec3f, vec3};

const SIZE: usize = 32;
const TRUTH: usize = 64;
const DIRECTIONS: usize = 6;
const WEIGHTS: usize = 8;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let eye = photofit_scene::Camera::look_at(
        glam::vec3(0.1, 0.2, 3.0),
        glam::Vec3::ZERO,
        glam::Vec3::Y,
        0.8,
        1.0,
        0.1,
        10.0,
    );
    let camera = matrix_rows(&eye.view_projection());
    for (name, mesh) in cases() {
        let mut model = Model::new(&mesh);
        let truth = truth(&mut model, &camera);
        let (mut frame, mut reverse) = (Frame::default(), model.gradients());
        let seeds: Vec<Vec<[f32; 4]>> =
            (0..WEIGHTS).map(|w| (0..SIZE * SIZE).map(|i| weight(w, i)).collect()).collect();
        for samples in [1_usize, 2, 4, 8] {
            ctx.measure(
                name,
                &format!("{samples} x {samples} samples"),
                samples * samples,
                || {
                    model.render(&camera, SIZE, samples, &PASSES, &mut frame);
                    let gradients: Vec<Vec<Vec3f>> = seeds
                        .iter()
                        .map(|g| {
                            reverse.clear();
                            model.render_vjp(&camera, SIZE, samples, &frame, g, &mut reverse);
                            reverse.positions.clone()
                        })
                        .collect();
                    gradients
                },
                |g| compare(&mesh, g, &truth),
            );
        }
    }
    ctx.note("Error: norm of the difference over the norm of the truth, over 6 random directions of motion and 8 random weightings of a 32 x 32 picture. Cosine: between the two. The truth is a central difference of pictures of 64 x 64 samples a pixel. Time: one forward and 8 reverse passes. Intersections of surfaces have no gradient in this operator: `crossing` shows what that costs.");
    Ok(())
}

/// The five kinds of visibility of the specification.
fn cases() -> Vec<(&'static str, Mesh)> {
    let at = |mesh: &Mesh, f: &dyn Fn(Vec3f) -> Vec3f| Mesh {
        positions: mesh.positions.iter().map(|p| f(*p)).collect(),
        triangles: mesh.triangles.clone(),
        ..Mesh::default()
    };
    let join = |a: Mesh, b: Mesh| {
        let n = a.positions.len() as u32;
        let mut out = a;
        out.positions.extend(b.positions);
        out.triangles.extend(b.triangles.iter().map(|t| t.map(|i| i + n)));
        out
    };
    let quad = at(&shapes::quad_grid(1, 1), &|p| vec3(0.7 * p.x - 0.2 * p.y, 0.7 * p.y + 0.2 * p.x, 0.0));
    let dense = at(&shapes::displaced_sphere(40, 0.1, 3, 3), &|p| p * 0.9);
    let thin = at(&shapes::quad_grid(1, 1), &|p| vec3(p.x, 0.021 * p.y + 0.3 * p.x, 0.0));
    let tilted = at(&shapes::quad_grid(1, 1), &|p| vec3(0.9 * p.x, 0.9 * p.y, 0.5 * p.x));
    let crossing = join(quad.clone(), tilted);
    let fold = at(&shapes::torus(24, 12, 0.7, 0.3), &|p| vec3(p.x, 0.6 * p.y + 0.5 * p.z, p.z * 0.8));
    vec![("quad", quad), ("dense", dense), ("thin", thin), ("crossing", crossing), ("fold", fold)]
}

fn hash(mut x: u64) -> f32 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 40) as f32 / (1u64 << 23) as f32 - 1.0
}

/// Weights of a pixel's colour; its coverage has none.
fn weight(w: usize, pixel: usize) -> [f32; 4] {
    let at = |c: usize| hash(((w * 4096 + pixel) * 3 + c) as u64 * 0x9e37_79b9_7f4a_7c15 + 1);
    [at(0), at(1), at(2), 0.0]
}

/// Smooth random motions: a translation and a linear map each.
fn motion(d: usize, p: Vec3f) -> Vec3f {
    let h = |k: usize| hash((d * 31 + k) as u64 * 0x9e37_79b9_7f4a_7c15 + 7);
    vec3(
        h(0) + h(1) * p.x + h(2) * p.y + h(3) * p.z,
        h(4) + h(5) * p.x + h(6) * p.y + h(7) * p.z,
        0.5 * (h(8) + h(9) * p.x + h(10) * p.y),
    )
}

/// Directional derivatives of every weighting, direction by direction.
fn truth(model: &mut Model, camera: &Matrix4<f32>) -> Vec<f64> {
    let start = model.positions.clone();
    let step = 0.01;
    let passes = Passes { antialias: false, position_gradients: false, map_gradients: false, ..PASSES };
    let mut out = Vec::new();
    for d in 0..DIRECTIONS {
        let [plus, minus] = [step, -step].map(|s| {
            model.positions = start.iter().map(|p| *p + motion(d, *p) * s).collect();
            let mut frame = Frame::default();
            model.render(camera, SIZE, TRUTH, &passes, &mut frame);
            frame.color
        });
        for w in 0..WEIGHTS {
            let dot = |(i, (a, b)): (usize, (&[f32; 4], &[f32; 4]))| {
                let k = weight(w, i);
                (0..3).map(|c| f64::from(k[c]) * (f64::from(a[c]) - f64::from(b[c]))).sum::<f64>()
            };
            out.push(plus.iter().zip(&minus).enumerate().map(dot).sum::<f64>() / (2.0 * f64::from(step)));
        }
    }
    model.positions = start;
    out
}

fn compare(mesh: &Mesh, gradients: &[Vec<Vec3f>], truth: &[f64]) -> Vec<(&'static str, f64)> {
    let along = |d: usize, g: &[Vec3f]| -> f64 {
        mesh.positions.iter().zip(g).map(|(p, g)| f64::from(motion(d, *p).dot(*g))).sum()
    };
    let ours: Vec<f64> = (0..DIRECTIONS).flat_map(|d| gradients.iter().map(move |g| along(d, g))).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let difference: Vec<f64> = ours.iter().zip(truth).map(|(a, b)| a - b).collect();
    let (n, t) = (dot(&ours, &ours).sqrt(), dot(truth, truth).sqrt());
    vec![("error", dot(&difference, &difference).sqrt() / t), ("cosine", dot(&ours, truth) / (n * t))]
}

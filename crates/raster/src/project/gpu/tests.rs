//! Projection on a device against the CPU's.

use super::*;
use crate::gpu::tests::{SCALE, params, picture, soup};
use crate::gpu::tolerances::CLIP;
use crate::gpu::{FrameParams, VERTEX_SUMS, vertex_sum};
use crate::project::{Matrix4, project as project_cpu, project_vjp};
use photofit_gpu::{Gpu, fixed_words};
use photofit_gpu::{assert_twin, test_device};
use photofit_gradcheck::Uniform;
use photofit_scalar::{Vec3f, Vec4f, vec3, vec4};

fn matrix(rng: &mut Uniform) -> Matrix4<f32> {
    std::array::from_fn(|_| std::array::from_fn(|_| rng.range(-2.0, 2.0) as f32))
}

fn clip_by_device(gpu: &Gpu, m: &Matrix4<f32>, positions: &[Vec3f]) -> Vec<Vec4f> {
    let mesh = soup(gpu, positions.len(), &[], &[]);
    gpu.write(&mesh.positions, bytemuck::cast_slice(positions)).expect("written");
    let picture = picture(gpu, &mesh, &[], 1, 1);
    let mut r = gpu.record("project");
    let mut s = Steps::new(&mut r, &FrameParams { rows: *m, ..params(&mesh, 1, 1, 1) });
    project(&mut s, &mesh, &picture).expect("recorded");
    r.finish().expect("recorded").run().expect("runs");
    gpu.read(&picture.clip).expect("read").into_iter().map(|c| vec4(c[0], c[1], c[2], c[3])).collect()
}

/// Largest error relative to the sum of the terms' magnitudes.
fn worst(m: &Matrix4<f32>, positions: &[Vec3f], found: &[Vec4f]) -> f32 {
    let mut expected = vec![vec4(0.0, 0.0, 0.0, 0.0); positions.len()];
    project_cpu(m, positions, &mut expected);
    let mut worst = 0.0_f32;
    for ((p, e), f) in positions.iter().zip(&expected).zip(found) {
        for (k, r) in m.iter().enumerate() {
            let size = (r[0] * p.x).abs() + (r[1] * p.y).abs() + (r[2] * p.z).abs() + r[3].abs();
            worst = worst.max((e[k] - f[k]).abs() / size.max(f32::MIN_POSITIVE));
        }
    }
    worst
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn clip_space_positions_are_those_of_the_cpu() {
    let gpu = test_device();
    let mut rng = Uniform::new(1);
    for scale in [1e-6, 1.0, 1e6] {
        let m = matrix(&mut rng);
        let mut point = || {
            vec3(rng.range(-1.0, 1.0) as f32, rng.range(-1.0, 1.0) as f32, rng.range(-1.0, 1.0) as f32)
                * scale
        };
        let positions: Vec<Vec3f> = (0..1000).map(|_| point()).collect();
        let mut found = clip_by_device(gpu, &m, &positions);
        let error = worst(&m, &positions, &found);
        assert_twin("CLIP", format!("clip positions of size {scale:e}"), error.into(), CLIP.into());
        found[500].y += 1e-3 * scale.max(1.0);
        assert!(worst(&m, &positions, &found) > CLIP, "a moved position is noticed");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn sums_become_gradients() {
    let gpu = test_device();
    let mut rng = Uniform::new(2);
    let m = matrix(&mut rng);
    let n = 300;
    // Sums of either sign and of all sizes, and what an earlier picture left.
    let mut number = || (rng.range(-1.0, 1.0) * 10f64.powf(rng.range(-9.0, 3.0))) as f32;
    let sums: Vec<f32> = (0..VERTEX_SUMS * n).map(|_| number()).collect();
    let before: Vec<f32> = (0..3 * n).map(|_| number()).collect();
    let mut words: Vec<u32> = Vec::new();
    for x in &sums {
        let bits = ((f64::from(*x) * f64::from(SCALE)).round() as i64).cast_unsigned();
        words.extend([bits as u32, (bits >> 32) as u32]);
    }
    // What counts large terms, and the status.
    words.resize(fixed_words(VERTEX_SUMS * n), 0);
    let mesh = soup(gpu, n, &[], &[]);
    let g = GradientBuffers::new(gpu, &mesh, 1, 1).expect("made");
    let mut r = gpu.record("gather");
    let mut s = Steps::new(&mut r, &FrameParams { rows: m, ..params(&mesh, 1, 1, 1) });
    gather(&mut s, &mesh, &g).expect("recorded");
    let mut recording = r.finish().expect("recorded");
    for b in [&g.positions, &g.normals, &g.tangents] {
        gpu.write(b, bytemuck::cast_slice(&before)).expect("written");
    }
    gpu.write(&g.sums, &words).expect("written");
    recording.run().expect("runs");
    let at = |v: usize, c: usize| sums[VERTEX_SUMS * v + c];
    let clip: Vec<Vec4f> = (0..n)
        .map(|v| std::array::from_fn::<f32, 4, _>(|k| at(v, vertex_sum::CLIP + k)))
        .map(|c| vec4(c[0], c[1], c[2], c[3]))
        .collect();
    let mut positions: Vec<Vec3f> = bytemuck::cast_slice(&before).to_vec();
    project_vjp(&m, &clip, &mut positions);
    let read = |b| gpu.read::<[f32; 3]>(b).expect("read");
    let found = [read(&g.positions), read(&g.normals), read(&g.tangents)];
    for v in 0..n {
        for k in 0..3 {
            let own = [vertex_sum::POSITION, vertex_sum::NORMAL, vertex_sum::TANGENT].map(|c| at(v, c + k));
            let old = before[3 * v + k];
            let expected = [positions[v][k] + own[0], old + own[1], old + own[2]];
            let size =
                clip[v].to_array().iter().map(|c| 2.0 * c.abs()).sum::<f32>() + own[0].abs() + old.abs();
            for (j, e) in expected.into_iter().enumerate() {
                let error = (e - found[j][v][k]).abs();
                assert!(
                    error <= 1e-12 + CLIP * if j == 0 { size } else { e.abs() },
                    "{j} {v} {k}: {error:e}"
                );
            }
        }
    }
    assert_eq!(gpu.read(&g.status).expect("read"), [0]);
    // A lost term is told.
    *words.last_mut().expect("not empty") = 1;
    gpu.write(&g.sums, &words).expect("written");
    recording.run().expect("runs");
    assert_eq!(gpu.read(&g.status).expect("read"), [1]);
}

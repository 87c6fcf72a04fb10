//! Rasterization on a device against the CPU's, and by itself.

use super::*;
use crate::gpu::FrameParams;
use crate::gpu::tests::{params, picture, soup};
use crate::gpu::tolerances::{DEPTH, EDGE, FEW, OTHER_TRIANGLES, ROUNDING, TILE_ROUNDING};
use crate::rasterize::{NONE, Visibility, rasterize_into};
use photofit_gpu::test_device;
use photofit_gradcheck::Uniform;
use photofit_scalar::{Vec3f, Vec4f, vec4};
use photofit_shading::Sides;

/// Layers by the device, each strictly behind the whole of the one before.
fn peel(
    gpu: &Gpu,
    input: (&[Vec4f], &[[u32; 3]], &[Sides]),
    size: (usize, usize),
    layers: usize,
) -> Vec<Visibility> {
    peel_with(gpu, input, size, layers, false)
}

/// The same; `backs`: also those of single-sided triangles.
fn peel_with(
    gpu: &Gpu,
    (clip, triangles, sides): (&[Vec4f], &[[u32; 3]], &[Sides]),
    (width, height): (usize, usize),
    layers: usize,
    backs: bool,
) -> Vec<Visibility> {
    let mesh = soup(gpu, clip.len(), triangles, sides);
    let picture = picture(gpu, &mesh, clip, width * height, layers.max(2));
    gpu.write(&picture.live, &vec![1; layers]).expect("written");
    let mut r = gpu.record("layers");
    let params = FrameParams { backs: u32::from(backs), ..params(&mesh, width, height, 1) };
    let mut s = Steps::new(&mut r, &params);
    bin(&mut s, &mesh, &picture).expect("recorded");
    for k in 0..layers {
        rasterize(&mut s, &mesh, &picture, k).expect("recorded");
        s.recorder.copy(&picture.layers[k].triangle, &picture.front).expect("recorded");
    }
    r.finish().expect("recorded").run().expect("runs");
    let layer = |l: &LayerBuffers| {
        let (triangle, depth) = (gpu.read(&l.triangle).expect("read"), gpu.read(&l.depth).expect("read"));
        Visibility { width, height, triangle, depth }
    };
    picture.layers[..layers].iter().map(layer).collect()
}

/// A triangle at a pixel centre, in double precision.
#[derive(Debug)]
struct Measure {
    /// Distance from the nearest edge, in multiples of what rounding moves that edge by.
    edge: f64,
    /// z/w, and what rounding changes it by.
    depth: f64,
    error: f64,
}

fn measure(clip: &[Vec4f], triangle: [u32; 3], v: &Visibility, pixel: usize) -> Measure {
    let size = [v.width as f64 * 0.5, v.height as f64 * 0.5];
    let centre = [(pixel % v.width) as f64 + 0.5, (pixel / v.width) as f64 + 0.5];
    let c = triangle.map(|i| clip[i as usize].cast::<f64>());
    let q = c.map(|c| [(c.x + c.w) * size[0] - centre[0] * c.w, (c.w - c.y) * size[1] - centre[1] * c.w]);
    // What the rounding of a corner's place is relative to.
    let rounded = c.map(|c| (c.x * size[0]).abs() + (c.y * size[1]).abs() + c.w.abs() * (size[0] + size[1]));
    let (mut edge, mut sums, mut errors) = (f64::INFINITY, [0.0; 2], [0.0; 2]);
    for k in 0..3 {
        let (s, t) = ((k + 1) % 3, (k + 2) % 3);
        let e = q[s][0] * q[t][1] - q[s][1] * q[t][0];
        let gradient = (c[t].w * q[s][1] - c[s].w * q[t][1]).hypot(q[t][0] * c[s].w - q[s][0] * c[t].w);
        let length = |q: [f64; 2]| q[0].abs() + q[1].abs();
        let error = ROUNDING * (rounded[s] * length(q[t]) + length(q[s]) * rounded[t]);
        edge = edge.min(e.abs() / (error + TILE_ROUNDING * gradient));
        for (j, c) in [c[k].w, c[k].z].into_iter().enumerate() {
            sums[j] += e * c;
            errors[j] += (error + TILE_ROUNDING * gradient + ROUNDING * e.abs()) * c.abs();
        }
    }
    let depth = sums[1] / sums[0];
    Measure { edge, depth, error: (errors[1] + depth.abs() * errors[0]) / sums[0].abs() + ROUNDING }
}

/// Asserts that layers agree but for pixels on edges or at equal depths; returns the number of pixels that show a triangle
/// and of those that differ.
fn compare(
    name: &str,
    (clip, triangles): (&[Vec4f], &[[u32; 3]]),
    cpu: &[Visibility],
    gpu: &[Visibility],
) -> (usize, usize) {
    let mut same = vec![true; cpu[0].triangle.len()];
    let (mut covered, mut other) = (0, 0);
    let mut worst = [0.0_f64; 2];
    for (layer, (c, g)) in cpu.iter().zip(gpu).enumerate() {
        for i in 0..same.len() {
            // Behind a difference others follow.
            if !same[i] {
                continue;
            }
            let (a, b) = (c.triangle[i], g.triangle[i]);
            covered += usize::from(a != NONE);
            let of = |t: u32| (t != NONE).then(|| measure(clip, triangles[t as usize], c, i));
            let shown: Vec<Measure> = [a, b].into_iter().filter_map(of).collect();
            if a == b {
                let exact = shown.first().map_or((1.0, ROUNDING), |m| (m.depth, m.error));
                let errors = [c.depth[i], g.depth[i]].map(|d| (f64::from(d) - exact.0).abs() / exact.1);
                assert!(
                    errors[1] <= DEPTH,
                    "{name}, layer {layer}, pixel {i}: depth {} of {exact:?}",
                    g.depth[i]
                );
                worst = [worst[0].max(errors[0]), worst[1].max(errors[1])];
                continue;
            }
            (same[i], other) = (false, other + 1);
            let near = |z: f64, m: &Measure| (m.depth - z).abs() < 2.0 * DEPTH * m.error;
            let excuse = shown.iter().any(|m| {
                // What lies strictly behind a layer may be as deep as it.
                let in_front = layer > 0 && near(f64::from(cpu[layer - 1].depth[i]), m);
                m.edge < EDGE || near(0.0, m) || near(1.0, m) || in_front
            });
            let tie =
                shown.len() == 2 && (near(shown[0].depth, &shown[1]) || near(shown[1].depth, &shown[0]));
            assert!(
                excuse || tie,
                "{name}, layer {layer}, pixel {i}: {a} {b} of {} {} without a reason: {shown:?}",
                c.depth[i],
                g.depth[i]
            );
        }
    }
    let allowed = FEW + (OTHER_TRIANGLES * covered as f64) as usize;
    assert!(other <= allowed, "{name}: {other} of {covered} pixels differ");
    println!(
        "{name}: {other} of {covered} samples show another triangle; errors of depth by rounding: CPU {:.2}, GPU {:.2}",
        worst[0], worst[1]
    );
    (covered, other)
}

fn peel_cpu(
    (clip, triangles, sides): (&[Vec4f], &[[u32; 3]], &[Sides]),
    (width, height): (usize, usize),
    layers: usize,
) -> Vec<Visibility> {
    let mut out: Vec<Visibility> = Vec::new();
    for _ in 0..layers {
        let mut v = Visibility::default();
        rasterize_into(clip, triangles, sides, width, height, out.last(), &mut v);
        out.push(v);
    }
    out
}

/// Triangles of all sizes in perspective, some through the plane of the camera.
fn random_soup(n: u32, size: f64, seed: u64) -> (Vec<Vec4f>, Vec<[u32; 3]>) {
    let mut rng = Uniform::new(seed);
    let mut clip = Vec::new();
    for _ in 0..n {
        let (x, y) = (rng.range(-1.2, 1.2), rng.range(-1.2, 1.2));
        let extent = size * 10f64.powf(rng.range(-2.0, 0.0));
        for _ in 0..3 {
            let w = if rng.range(0.0, 1.0) < 0.05 { rng.range(-0.5, 0.1) } else { rng.range(0.3, 2.0) };
            let (dx, dy, dz) = (rng.range(-extent, extent), rng.range(-extent, extent), rng.range(-0.1, 0.1));
            let z = 1.03 * w - 0.1 + dz * w;
            clip.push(vec4(((x + dx) * w) as f32, ((y + dy) * w) as f32, z as f32, w as f32));
        }
    }
    (clip, (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

/// A closed bumpy surface in perspective.
pub(crate) fn sphere(frequency: u32) -> (Vec<Vec4f>, Vec<[u32; 3]>) {
    let mesh = photofit_geometry::shapes::displaced_sphere(frequency, 0.3, 3, 5);
    let camera =
        [[2.0_f32, 0.0, 0.3, 0.1], [0.0, 2.0, -0.2, 0.0], [0.0, 0.0, -1.02, 2.5], [0.0, 0.0, -1.0, 3.0]];
    let row = |r: [f32; 4], p: Vec3f| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3];
    let clip =
        |p: &Vec3f| vec4(row(camera[0], *p), row(camera[1], *p), row(camera[2], *p), row(camera[3], *p));
    (mesh.positions.iter().map(clip).collect(), mesh.triangles)
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn layers_are_those_of_the_cpu() {
    let gpu = test_device();
    for (name, (clip, triangles), size, layers) in [
        ("small and large", random_soup(300, 1.0, 1), (150, 90), 4),
        ("many small ones", random_soup(20_000, 0.1, 2), (333, 257), 3),
        ("large ones", random_soup(40, 3.0, 3), (128, 128), 4),
        ("a large picture", random_soup(40, 3.0, 7), (700, 500), 2),
        ("coarse sphere", sphere(3), (200, 160), 3),
        ("fine sphere", sphere(40), (200, 160), 3),
        ("a wide picture", random_soup(200, 1.0, 4), (1500, 3), 2),
        ("one pixel", random_soup(2000, 3.0, 5), (1, 1), 2),
    ] {
        for sides in [vec![], vec![Sides::Front; triangles.len()]] {
            let input = (&clip[..], &triangles[..], &sides[..]);
            let (c, g) = (peel_cpu(input, size, layers), peel(gpu, input, size, layers));
            let (covered, _) = compare(name, (&clip, &triangles), &c, &g);
            assert!(covered > 0, "{name} shows something");
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn backs_of_single_sided_triangles_are_drawn_where_they_are_asked_for() {
    let gpu = test_device();
    let (clip, mut triangles) = sphere(10);
    // Every third triangle looks inwards.
    triangles.iter_mut().step_by(3).for_each(|t| t.swap(1, 2));
    let sides = vec![Sides::Front; triangles.len()];
    let c = peel_cpu((&clip, &triangles, &[]), (200, 160), 3);
    let g = peel_with(gpu, (&clip, &triangles, &sides), (200, 160), 3, true);
    compare("backs", (&clip, &triangles), &c, &g);
    let culled = peel(gpu, (&clip, &triangles, &sides), (200, 160), 3);
    let seen = std::panic::catch_unwind(|| compare("fronts alone", (&clip, &triangles), &c, &culled));
    assert!(seen.is_err(), "fronts alone are another picture");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_moved_corner_is_noticed() {
    let gpu = test_device();
    let (mut clip, triangles) = sphere(10);
    let input = (&clip[..], &triangles[..], &[][..]);
    let g = peel(gpu, input, (200, 160), 1);
    clip.iter_mut().step_by(7).for_each(|c| c.x += 0.003 * c.w);
    let c = peel_cpu((&clip, &triangles, &[]), (200, 160), 1);
    let result = std::panic::catch_unwind(|| compare("moved", (&clip, &triangles), &c, &g));
    assert!(result.is_err(), "the comparison sees a third of a pixel");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_closed_surface_is_watertight() {
    let gpu = test_device();
    // Each line of sight enters a closed surface as often as it leaves it. Coarse triangles are large in the finer
    // picture and small in the coarser one.
    let mut odd = 0;
    for (frequency, size) in [(4, (301, 203)), (12, (301, 203)), (12, (64, 64)), (60, (301, 203))] {
        let (clip, triangles) = sphere(frequency);
        let layers = peel(gpu, (&clip, &triangles, &[]), size, 10);
        assert!(layers[9].triangle.iter().all(|t| *t == NONE), "ten layers are enough");
        let mut covered = 0;
        for i in 0..size.0 * size.1 {
            let hits = layers.iter().filter(|l| l.triangle[i] != NONE).count();
            covered += usize::from(hits > 0);
            odd += hits % 2;
        }
        assert!(covered > 1000, "{covered}");
    }
    assert_eq!(odd, 0, "lines of sight that enter and do not leave");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_fan_has_neither_holes_nor_double_hits() {
    let gpu = test_device();
    let mut rng = Uniform::new(5);
    for case in 0..20 {
        // Corners on pixel centres and corners, so that many centres lie exactly on edges; a part of them large.
        let (width, height) = (128, 64);
        let at = |x: f64, y: f64, w: f64| {
            let (x, y) = (x * 2.0 / 128.0 - 1.0, 1.0 - y * 2.0 / 64.0);
            vec4((x * w) as f32, (y * w) as f32, (0.5 * w) as f32, w as f32)
        };
        let mut clip = vec![];
        let n = 9 + case % 4;
        for i in 0..n {
            let a = f64::from(i) / f64::from(n) * std::f64::consts::TAU;
            let w = if case < 10 { 1.0 } else { rng.range(0.5, 3.0) };
            clip.push(at((64.0 + 200.0 * a.cos()).round() + 0.5, (32.0 + 200.0 * a.sin()).round() + 0.5, w));
        }
        clip.push(at(rng.range(30.0, 90.0).round() + 0.5, rng.range(10.0, 50.0).round() + 0.5, 1.0));
        // A small fan in the middle of one triangle of the large one: its triangles are drawn one by one.
        let tris: Vec<[u32; 3]> = (0..n).map(|i| [i, (i + 1) % n, n]).collect();
        let layers = peel(gpu, (&clip, &tris, &[]), (width, height), 2);
        assert!(layers[0].triangle.iter().all(|t| *t != NONE), "case {case}: a crack");
        assert!(layers[1].triangle.iter().all(|t| *t == NONE), "case {case}: an overlap");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn small_and_large_neighbours_share_their_edge() {
    let gpu = test_device();
    // A grid of cells of 1 to 40 pixels with jittered corners, each cell two triangles: all pixels once.
    let mut rng = Uniform::new(9);
    for case in 0..6 {
        let lines = |rng: &mut Uniform| {
            let mut x = vec![-1.3];
            while x[x.len() - 1] < 1.3 {
                let last = x[x.len() - 1];
                x.push(last + 0.01 * 10f64.powf(rng.range(0.0, 1.5)));
            }
            x
        };
        let (xs, ys) = (lines(&mut rng), lines(&mut rng));
        let columns = xs.len() as u32;
        let mut clip = vec![];
        for y in &ys {
            for x in &xs {
                let w = rng.range(0.9, 1.1) * if case < 3 { 1.0 } else { 1e-3 };
                let (x, y) = (x + rng.range(-0.003, 0.003), y + rng.range(-0.003, 0.003));
                clip.push(vec4((x * w) as f32, (y * w) as f32, (0.5 * w) as f32, w as f32));
            }
        }
        let mut tris = vec![];
        for r in 0..ys.len() as u32 - 1 {
            for c in 0..columns - 1 {
                let i = r * columns + c;
                tris.extend([[i, i + 1, i + columns + 1], [i, i + columns + 1, i + columns]]);
            }
        }
        let layers = peel(gpu, (&clip, &tris, &[]), (333, 301), 2);
        assert!(layers[0].triangle.iter().all(|t| *t != NONE), "case {case}: a crack");
        assert!(layers[1].triangle.iter().all(|t| *t == NONE), "case {case}: an overlap");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn duplicates_come_in_the_order_of_their_numbers() {
    let gpu = test_device();
    let quad =
        |z: f32| [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(x, y)| vec4(x, y, z, 1.0_f32));
    let clip: Vec<Vec4f> = [quad(0.5), quad(0.5), quad(0.7)].concat();
    let tris: Vec<[u32; 3]> =
        (0..3).flat_map(|k| [[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|i| i + 4 * k))).collect();
    for size in [8, 32] {
        let layers = peel(gpu, (&clip, &tris, &[]), (size, size), 4);
        for (g, c) in layers.iter().zip(peel_cpu((&clip, &tris, &[]), (size, size), 4)) {
            assert_eq!(g.triangle, c.triangle, "exact at this size");
        }
        let at = size / 2 * size + size / 2 - 1;
        assert_eq!([0, 1, 2].map(|k: usize| layers[k].triangle[at] / 2), [0, 1, 2]);
        assert!(layers[3].triangle.iter().all(|t| *t == NONE));
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn pictures_of_many_workgroups() {
    let gpu = test_device();
    // More than 65,535 workgroups of samples; the second layer's are counted on the device.
    let (clip, triangles) = random_soup(60, 6.0, 8);
    let size = (2100, 2050);
    let input = (&clip[..], &triangles[..], &[][..]);
    for (c, g) in peel_cpu(input, size, 2).iter().zip(peel(gpu, input, size, 2)) {
        let differ = c.triangle.iter().zip(&g.triangle).filter(|(c, g)| c != g).count();
        let last = &c.triangle[size.0 * (size.1 - 100)..];
        assert!(last.iter().any(|t| *t != NONE), "the end of the picture shows something");
        assert!(differ <= FEW + (OTHER_TRIANGLES * (size.0 * size.1) as f64) as usize, "{differ} differ");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn runs_give_the_same_bits() {
    let gpu = test_device();
    let (clip, triangles) = random_soup(2000, 1.0, 6);
    let input = (&clip[..], &triangles[..], &[][..]);
    let first = peel(gpu, input, (150, 90), 3);
    assert!(first[2].triangle.iter().any(|t| *t != NONE));
    for _ in 0..3 {
        assert!(peel(gpu, input, (150, 90), 3) == first);
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn broken_input_shows_nothing() {
    let gpu = test_device();
    let empty = peel(gpu, (&[], &[], &[]), (5, 4), 1);
    assert!(empty[0].triangle.iter().all(|t| *t == NONE) && empty[0].depth.iter().all(|d| *d == 1.0));
    let fine = [vec4(1.0, 0.0, 0.5, 1.0), vec4(0.0, 1.0, 0.5, 1.0_f32)];
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for k in 0..4 {
            let mut p = vec4(0.0, 0.0, 0.5, 1.0_f32);
            p[k] = bad;
            let v = peel(gpu, (&[p, fine[0], fine[1]], &[[0, 1, 2]], &[]), (8, 8), 1);
            assert!(v[0].triangle.iter().all(|t| *t == NONE), "{bad} in place {k}");
        }
    }
    let flat = [vec4(0.1, 0.1, 0.5, 1.0_f32); 3];
    assert!(peel(gpu, (&flat, &[[0, 1, 2]], &[]), (8, 8), 1)[0].triangle.iter().all(|t| *t == NONE));
}

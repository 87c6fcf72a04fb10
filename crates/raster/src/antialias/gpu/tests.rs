//! Antialiasing on a device against the CPU's.

use super::*;
use crate::antialias::{MeshTopology, Pair, silhouettes as silhouettes_cpu};
use crate::gpu::tests::{params, picture, sum_of};
use crate::gpu::tolerances::{ANTIALIASED, ANTIALIASED_VJP, FEW, OTHER_SILHOUETTES};
use crate::gpu::{VERTEX_SUMS, vertex_sum};
use crate::rasterize::{NONE, Visibility, rasterize};
use photofit_geometry::{Mesh, shapes};
use photofit_gpu::Gpu;
use photofit_gpu::{assert_twin, test_device};
use photofit_gradcheck::Uniform;
use photofit_scalar::{Vec3f, Vec4f, vec4};

/// A mesh as seen by a camera, with what the CPU finds.
struct Scene {
    clip: Vec<Vec4f>,
    topology: MeshTopology,
    visibility: Visibility,
    pairs: Vec<Pair<f32>>,
    color: Vec<[f32; 4]>,
}

impl Scene {
    fn new(mesh: &Mesh, (width, height): (usize, usize), seed: u64) -> Self {
        let camera =
            [[1.9_f32, 0.1, 0.3, 0.1], [0.0, 2.0, -0.2, 0.0], [0.0, 0.0, -1.02, 2.5], [0.0, 0.0, -1.0, 3.0]];
        let row = |r: [f32; 4], p: &Vec3f| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3];
        let clip: Vec<Vec4f> = mesh
            .positions
            .iter()
            .map(|p| vec4(row(camera[0], p), row(camera[1], p), row(camera[2], p), row(camera[3], p)))
            .collect();
        let topology = MeshTopology::new(&mesh.triangles, &mesh.positions);
        let visibility = rasterize(&clip, &mesh.triangles, width, height, None);
        let pairs = silhouettes_cpu(&visibility, &clip, &topology.topology());
        let mut rng = Uniform::new(seed);
        let color =
            (0..width * height).map(|_| std::array::from_fn(|_| rng.range(-0.1, 2.0) as f32)).collect();
        Self { clip, topology, visibility, pairs, color }
    }

    /// What the device computes: pairs, colours, gradients of colours and of clip-space positions for the gradient `g`.
    fn on_device(&self, gpu: &Gpu, g_out: &[[f32; 4]]) -> Found {
        let (width, height) = (self.visibility.width, self.visibility.height);
        let n = width * height;
        let uvs = vec![[0.0; 2]; self.clip.len()];
        let mesh = MeshBuffers::new(gpu, &uvs, &self.topology.topology(), &[], &[]).expect("uploaded");
        let picture = picture(gpu, &mesh, &self.clip, n, 1);
        let layer = &picture.layers[0];
        gpu.write(&layer.triangle, &self.visibility.triangle).expect("written");
        gpu.write(&layer.depth, &self.visibility.depth).expect("written");
        gpu.write(&layer.blended, &self.color).expect("written");
        let g = GradientBuffers::new(gpu, &mesh, n, n).expect("made");
        gpu.write(&g.samples[0], g_out).expect("written");
        let mut r = gpu.record("antialias");
        let mut s = Steps::new(&mut r, &params(&mesh, width, height, 1));
        fold(&mut s, &mesh, &picture).expect("recorded");
        silhouettes(&mut s, &mesh, &picture, 0).expect("recorded");
        antialias(&mut s, &mesh, &picture, 0, &picture.color).expect("recorded");
        let turns = [&g.samples[0], &g.samples[1]];
        antialias_vjp(&mut s, &mesh, &picture, 0, &g, turns, true).expect("recorded");
        r.finish().expect("recorded").run().expect("runs");
        let words = gpu.read(&g.sums).expect("read");
        assert_eq!(words.last(), Some(&0), "no term is lost");
        let clip =
            |v: usize| std::array::from_fn(|k| sum_of(&words, VERTEX_SUMS * v + vertex_sum::CLIP + k) as f32);
        Found {
            pairs: gpu.read(&layer.pairs).expect("read"),
            color: gpu.read(&picture.color).expect("read"),
            g_color: gpu.read(&g.samples[1]).expect("read"),
            g_clip: (0..self.clip.len()).map(clip).collect(),
        }
    }
}

struct Found {
    pairs: Vec<u32>,
    color: Vec<[f32; 4]>,
    g_color: Vec<[f32; 4]>,
    g_clip: Vec<[f32; 4]>,
}

/// Largest difference relative to the largest number.
fn worst(found: &[[f32; 4]], expected: &[[f32; 4]], skipped: &[bool]) -> f32 {
    let size = expected.as_flattened().iter().fold(0.0_f32, |m, x| m.max(x.abs()));
    let differences = found.iter().zip(expected).zip(skipped).filter(|(_, s)| !**s);
    let worst = differences.flat_map(|((f, e), _)| (0..4).map(move |k| (f[k] - e[k]).abs()));
    worst.fold(0.0_f32, |m, d| if d.is_nan() { f32::INFINITY } else { m.max(d) })
        / size.max(f32::MIN_POSITIVE)
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn silhouettes_colours_and_gradients_are_those_of_the_cpu() {
    let gpu = test_device();
    for (name, mesh, size) in [
        ("coarse", shapes::displaced_sphere(3, 0.3, 3, 5), (120, 90)),
        ("fine", shapes::displaced_sphere(30, 0.3, 3, 5), (120, 90)),
        ("finer than samples", shapes::displaced_sphere(90, 0.5, 4, 6), (61, 67)),
        ("open", shapes::quad_grid(7, 7), (100, 100)),
        ("a row", shapes::displaced_sphere(8, 0.3, 3, 5), (200, 1)),
        ("a column", shapes::displaced_sphere(8, 0.3, 3, 5), (1, 200)),
    ] {
        let scene = Scene::new(&mesh, size, 3);
        let mut rng = Uniform::new(4);
        let g: Vec<[f32; 4]> =
            scene.color.iter().map(|_| std::array::from_fn(|_| rng.range(-1.0, 1.0) as f32)).collect();
        let found = scene.on_device(gpu, &g);
        // Edges of the pairs, by place; those of a blend factor of zero are none on the CPU.
        let triangles = scene.topology.topology().triangles;
        let vertices = |word: u32| {
            let id = (word & 0x7fff_ffff) as usize;
            (word != NONE).then(|| [triangles[id / 3][id % 3], triangles[id / 3][(id + 1) % 3]])
        };
        let mut expected = vec![None; 2 * scene.color.len()];
        for p in &scene.pairs {
            let below = size.0 == 1 || p.second != p.first + 1;
            expected[2 * p.first as usize + usize::from(below)] = Some(p.crossing.vertices);
        }
        let mut other = 0;
        let mut touched = vec![false; scene.color.len()];
        let mut moved = vec![false; scene.clip.len()];
        for (at, (f, e)) in found.pairs.iter().map(|w| vertices(*w)).zip(&expected).enumerate() {
            if f != *e {
                other += 1;
                touched[at / 2] = true;
                touched[at / 2 + if at % 2 == 1 { size.0 } else { 1 }] = true;
                f.iter().chain(e).flatten().for_each(|v| moved[*v as usize] = true);
            }
        }
        let allowed = FEW + (OTHER_SILHOUETTES * scene.pairs.len() as f64) as usize;
        assert!(other <= allowed, "{name}: {other} of {} silhouettes differ", scene.pairs.len());
        let mut color = scene.color.clone();
        crate::antialias::antialias(&scene.pairs, &scene.color, &mut color);
        let (mut g_color, mut g_clip) = (g.clone(), vec![vec4(0.0, 0.0, 0.0, 0.0); scene.clip.len()]);
        crate::antialias::antialias_vjp(
            &scene.pairs,
            &scene.clip,
            size,
            &scene.color,
            &mut g_color,
            Some(&mut g_clip),
        );
        let g_clip: Vec<[f32; 4]> = g_clip.iter().map(|g| g.to_array()).collect();
        let errors = [
            worst(&found.color, &color, &touched),
            worst(&found.g_color, &g_color, &touched),
            worst(&found.g_clip, &g_clip, &moved),
        ];
        println!("{name}: {other} of {} silhouettes differ; errors {errors:?}", scene.pairs.len());
        let errors = errors.map(f64::from);
        assert_twin("ANTIALIASED", name, errors[0], f64::from(ANTIALIASED));
        for error in &errors[1..] {
            assert_twin("ANTIALIASED_VJP", name, *error, f64::from(ANTIALIASED_VJP));
        }
        // Edges as seen in a single row or column are too flat.
        assert!(scene.pairs.len() > 20 || size.0.min(size.1) == 1, "{name} has silhouettes");
        if scene.pairs.is_empty() {
            continue;
        }
        // The same bits again; and a perturbed gradient is noticed.
        assert!(scene.on_device(gpu, &g).g_clip == found.g_clip, "{name}: runs differ");
        let mut off = found.g_clip;
        off.iter_mut().for_each(|g| g[0] *= 1.001);
        assert!(worst(&off, &g_clip, &moved) > ANTIALIASED_VJP, "{name}: the comparison can fail");
    }
}

//! Twins against the CPU, on a smooth mesh, on random ones and on what is degenerate.

mod tolerances;

use super::{KERNELS, Lists, VertexNormals, VertexTangents, expand, expand_vjp};
use crate::normals::{Weighting, vertex_normals, vertex_normals_vjp};
use crate::tangents::{UvFrames, vertex_tangents, vertex_tangents_vjp};
use crate::weld::{Weld, weld_exact, weld_rows};
use crate::{Incidence, Mesh, shapes};
use photofit_gpu::{Gpu, GpuError, assert_twin, test_device, validate};
use photofit_gradcheck::Uniform;
use photofit_scalar::{Vec3f, Vec4f, vec2, vec3};
use tolerances::{EXACT, FORWARD, GRADIENT, SLIVER};

fn random(rng: &mut Uniform, n: usize) -> Vec<f32> {
    (0..n).map(|_| rng.range(-1.0, 1.0) as f32).collect()
}

/// A torus with wavy, unevenly spaced uvs whose vertices are shaken.
fn wavy(shake: f64) -> Mesh {
    let mut mesh = shapes::torus(48, 31, 1.0, 0.4);
    let mut rng = Uniform::new(11);
    for (uv, p) in mesh.uvs.iter_mut().zip(&mut mesh.positions) {
        *uv = vec2(uv.x + 0.03 * (7.0 * p.y).sin() + 0.2 * uv.y, uv.y + 0.02 * (5.0 * p.x).cos());
        *p = p.map(|x| x + rng.range(-shake, shake) as f32);
    }
    mesh
}

/// Triangles between random points.
fn soup(seed: u64) -> Mesh {
    let mut rng = Uniform::new(seed);
    let n = 300;
    let mut mesh = Mesh::default();
    for _ in 0..n {
        mesh.positions.push(vec3(0.0, 0.0, 0.0_f32).map(|_: f32| rng.range(-1.0, 1.0) as f32));
        mesh.uvs.push(vec2(rng.range(0.0, 1.0) as f32, rng.range(0.0, 1.0) as f32));
    }
    let mut vertex = || (rng.range(0.0, n as f64) as u32).min(n as u32 - 1);
    mesh.triangles = (0..500).map(|_| [vertex(), vertex(), vertex()]).collect();
    mesh
}

/// No area, slivers, equal and far points, tiny and huge triangles, and a vertex that is no number.
fn degenerate() -> Mesh {
    let mut mesh = wavy(0.0);
    let n = mesh.positions.len() as u32;
    let mut add = |p: [f32; 3], uv: [f32; 2]| {
        mesh.positions.push(Vec3f::from_array(p));
        mesh.uvs.push(vec2(uv[0], uv[1]));
    };
    add([0.0; 3], [0.0; 2]);
    add([1.0, 0.0, 0.0], [1.0, 0.0]);
    add([2.0, 0.0, 0.0], [0.0, 1.0]);
    add([0.5, 1e-3, 0.0], [0.3, 0.6]);
    for s in [1e-6_f32, 1e6, 1e18] {
        add([s, s, 0.0], [0.0, 0.0]);
        add([2.0 * s, s, 0.0], [0.5, 0.0]);
        add([s, 2.0 * s, s], [0.0, 0.5]);
    }
    add([f32::NAN, 0.0, 0.0], [0.1, 0.1]);
    add([7.0, 7.0, 7.0], [0.1, 0.1]);
    let extra = [[0, 1, 2], [0, 1, 3], [0, 0, 3], [4, 5, 6], [7, 8, 9], [10, 11, 12], [13, 1, 3]];
    mesh.triangles.extend(extra.map(|t| t.map(|v: u32| n + v)));
    mesh
}

/// What the CPU and the device make of a mesh: names, and both arrays.
type Twins = Vec<(&'static str, Vec<f32>, Vec<f32>)>;

fn cpu_and_gpu(gpu: &Gpu, mesh: &Mesh, smooth: &Weld, unique: &Weld) -> Result<Twins, GpuError> {
    let (smooth, unique) = (Incidence::new(&mesh.triangles, smooth), Incidence::new(&mesh.triangles, unique));
    let frames = UvFrames::new(&unique, &mesh.uvs);
    let n = mesh.positions.len();
    let mut rng = Uniform::new(5);
    let [d_normals, d_tangents, start] = [0; 3].map(|_| random(&mut rng, 3 * n));
    // The CPU.
    let p = &mesh.positions;
    let normals = vertex_normals(&smooth, p, Weighting::Angle);
    let tangents = vertex_tangents(&unique, &frames, p, &normals);
    let rows = |x: &[f32]| bytemuck::cast_slice::<f32, Vec3f>(x).to_vec();
    let d4: Vec<Vec4f> = rows(&d_tangents).iter().map(|t| t.extend(0.0)).collect();
    let (mut dp, mut dn) = (rows(&start), rows(&d_normals));
    vertex_tangents_vjp(&unique, &frames, p, &normals, &d4, &mut dp, &mut dn);
    let (after_tangents, mut both) = (dp.clone(), dp);
    vertex_normals_vjp(&smooth, p, Weighting::Angle, &dn, &mut both);
    // The device; the adjoint of normals starts from the CPU's values, so that errors do not add up.
    let up = |name: &str, x: &[Vec3f]| gpu.upload::<[f32; 3]>(name, bytemuck::cast_slice(x));
    let flat = |x: &[Vec3f]| bytemuck::cast_slice::<Vec3f, f32>(x).to_vec();
    let (smooth, unique) = (Lists::new(gpu, &smooth)?, Lists::new(gpu, &unique)?);
    let (of_normals, of_tangents) =
        (VertexNormals::new(gpu, &smooth)?, VertexTangents::new(gpu, &unique, &frames)?);
    let positions = up("positions", p)?;
    let (n_out, t_out) = (gpu.zeros::<[f32; 3]>("normals", n)?, gpu.zeros::<[f32; 4]>("tangents", n)?);
    let (n_in, t_in) = (up("normals", &normals)?, up("d tangents", &rows(&d_tangents))?);
    let (dp_t, dn_t) = (up("d positions", &rows(&start))?, up("d normals", &rows(&d_normals))?);
    let (dn_n, dp_n) = (up("d normals", &dn)?, up("d positions", &after_tangents)?);
    let mut r = gpu.record("twins");
    of_normals.forward(&mut r, &positions, &n_out)?;
    of_tangents.forward(&mut r, &positions, &n_in, &t_out)?;
    of_tangents.vjp(&mut r, &positions, &n_in, &t_in, &dp_t, &dn_t)?;
    of_normals.vjp(&mut r, &positions, &dn_n, &dp_n)?;
    r.finish()?.run()?;
    Ok(vec![
        ("normals", flat(&normals), gpu.read(&n_out)?.into_flattened()),
        ("tangents", bytemuck::cast_slice(&tangents).to_vec(), gpu.read(&t_out)?.into_flattened()),
        ("positions by tangents", flat(&after_tangents), gpu.read(&dp_t)?.into_flattened()),
        ("normals by tangents", flat(&dn), gpu.read(&dn_t)?.into_flattened()),
        ("positions by normals", flat(&both), gpu.read(&dp_n)?.into_flattened()),
    ])
}

/// Largest difference of a row of three or four samples over its largest magnitude, or over the median of these where that is
/// larger (a row may be what cancelled); infinite where one side is finite and the other is not.
fn error(cpu: &[f32], gpu: &[f32], width: usize) -> f64 {
    assert_eq!(cpu.len(), gpu.len());
    let size =
        |r: &[f32]| r.iter().filter(|x| x.is_finite()).fold(1e-30, |a, b| f64::max(a, f64::from(b.abs())));
    let mut sizes: Vec<f64> = cpu.chunks_exact(width).map(size).collect();
    sizes.sort_by(f64::total_cmp);
    let median = sizes[sizes.len() / 2];
    let one = |(a, b): (&f32, &f32)| match (a.is_finite(), b.is_finite()) {
        (true, true) => f64::from(a - b).abs(),
        (false, false) => 0.0,
        _ => f64::INFINITY,
    };
    let row = |(a, b): (&[f32], &[f32])| a.iter().zip(b).map(one).fold(0.0, f64::max) / size(a).max(median);
    cpu.chunks_exact(width).zip(gpu.chunks_exact(width)).map(row).fold(0.0, f64::max)
}

fn check(name: &str, mesh: &Mesh, smooth: &Weld, unique: &Weld, gradient: (&str, f64)) {
    let gpu = test_device();
    for (what, a, b) in cpu_and_gpu(gpu, mesh, smooth, unique).unwrap() {
        let (of, bound) = if what.contains("by") { gradient } else { ("FORWARD", FORWARD) };
        let width = if what == "tangents" { 4 } else { 3 };
        let worst = error(&a, &b, width);
        assert_twin(of, format!("{name}: {what}"), worst, bound);
        let size = a.iter().filter(|x| x.is_finite()).fold(0.0, |a, x| f32::max(a, x.abs()));
        let mut bent = b.clone();
        let k = a.iter().position(|x| x.abs() == size).unwrap();
        bent[k] *= 1.0 + 4.0 * bound as f32;
        assert!(error(&a, &bent, width) > bound, "a broken side is noticed");
    }
}

fn identity(mesh: &Mesh) -> Weld {
    Weld::identity(mesh.positions.len())
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn smooth_meshes_agree() {
    let mesh = wavy(0.0);
    check("torus", &mesh, &weld_exact(&mesh.positions), &identity(&mesh), ("GRADIENT", GRADIENT));
    let mesh = wavy(0.004);
    check("shaken torus", &mesh, &identity(&mesh), &identity(&mesh), ("GRADIENT", GRADIENT));
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn welded_tangents_agree() {
    let mesh = wavy(0.0);
    let rows: Vec<f32> =
        mesh.positions.iter().zip(&mesh.uvs).flat_map(|(p, uv)| [p.x, p.y, p.z, uv.x.fract()]).collect();
    check("welded", &mesh, &weld_exact(&mesh.positions), &weld_rows(&rows, 4), ("GRADIENT", GRADIENT));
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn random_triangles_agree() {
    for seed in 0..4 {
        let mesh = soup(seed);
        check("soup", &mesh, &identity(&mesh), &identity(&mesh), ("SLIVER", SLIVER));
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn degenerate_triangles_agree() {
    let mesh = degenerate();
    check("degenerate", &mesh, &weld_exact(&mesh.positions), &identity(&mesh), ("SLIVER", SLIVER));
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn welding_agrees_and_runs_repeat_to_the_bit() {
    let gpu = test_device();
    let mesh = wavy(0.0);
    let weld = weld_exact(&mesh.positions);
    assert!(!weld.is_identity());
    let lists = Lists::new(gpu, &Incidence::new(&mesh.triangles, &weld)).unwrap();
    let mut rng = Uniform::new(9);
    let (welded, g) = (random(&mut rng, 3 * weld.count()), random(&mut rng, 3 * weld.vertices()));
    let mut sums = bytemuck::cast_slice::<f32, Vec3f>(&welded).to_vec();
    weld.expand_vjp(bytemuck::cast_slice(&g), &mut sums);
    let of_cpu: Vec<f32> = bytemuck::cast_vec(weld.expand(bytemuck::cast_slice::<f32, [f32; 3]>(&welded)));
    let run = || {
        let rows = |x: &[f32]| bytemuck::cast_slice::<f32, [f32; 3]>(x).to_vec();
        let (w, v) = (gpu.upload("welded", &rows(&welded))?, gpu.zeros("vertices", g.len() / 3)?);
        let (d, dw) = (gpu.upload("gradients", &rows(&g))?, gpu.upload("sums", &rows(&welded))?);
        let mut r = gpu.record("weld");
        expand(&mut r, &lists, &w, &v)?;
        expand_vjp(&mut r, &lists, &d, &dw)?;
        r.finish()?.run()?;
        Ok::<_, GpuError>((gpu.read(&v)?.into_flattened(), gpu.read(&dw)?.into_flattened()))
    };
    let (expanded, summed) = run().unwrap();
    assert_twin("EXACT", "welded", error(&of_cpu, &expanded, 3), EXACT);
    assert_twin("EXACT", "sums", error(bytemuck::cast_slice(&sums), &summed, 3), EXACT);
    assert_eq!(run().unwrap(), (expanded, summed));
    let twice = || cpu_and_gpu(gpu, &mesh, &weld, &identity(&mesh)).unwrap();
    assert!(twice().iter().zip(&twice()).all(|(a, b)| a.2 == b.2), "the same bits in two runs");
}

#[test]
fn tests_on_a_device_pass_where_there_is_one() {
    photofit_gpu::run_device_tests();
}

#[test]
fn kernels_are_valid() {
    KERNELS.iter().for_each(|k| validate(k).unwrap());
}

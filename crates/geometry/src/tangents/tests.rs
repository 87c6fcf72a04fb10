//! Tests of this operation: known values, gradients, determinism.

use super::*;
use crate::weld::{Weld, weld_exact, weld_rows};
use crate::{Mesh, shapes};
use photofit_gradcheck::{Uniform, check};
use photofit_scalar::{Vec3f, Vec4f, vec2};

/// The reference implementation, run on `(u, 1 - v)`; one tangent per corner.
struct Oracle<'a> {
    mesh: &'a Mesh,
    corners: Vec<[f32; 4]>,
}

impl mikktspace::Geometry for Oracle<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.triangles.len()
    }
    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }
    fn position(&self, face: usize, k: usize) -> [f32; 3] {
        self.mesh.positions[self.mesh.triangles[face][k] as usize].to_array()
    }
    fn normal(&self, face: usize, k: usize) -> [f32; 3] {
        self.mesh.normals[self.mesh.triangles[face][k] as usize].to_array()
    }
    fn tex_coord(&self, face: usize, k: usize) -> [f32; 2] {
        let uv = self.mesh.uvs[self.mesh.triangles[face][k] as usize];
        [uv.x, 1.0 - uv.y]
    }
    fn set_tangent_encoded(&mut self, tangent: [f32; 4], face: usize, k: usize) {
        self.corners[3 * face + k] = tangent;
    }
}

fn oracle(mesh: &Mesh) -> Vec<Vec4f> {
    let mut run = Oracle { mesh, corners: vec![[0.0; 4]; 3 * mesh.triangles.len()] };
    assert!(mikktspace::generate_tangents(&mut run), "the reference accepts the mesh");
    run.corners.into_iter().map(Vec4::from_array).collect()
}

fn tangents(mesh: &Mesh) -> Vec<Vec4f> {
    let incidence = Incidence::new(&mesh.triangles, &Weld::identity(mesh.positions.len()));
    let frames = UvFrames::new(&incidence, &mesh.uvs);
    vertex_tangents(&incidence, &frames, &mesh.positions, &mesh.normals)
}

/// A torus with wavy, unevenly spaced uvs.
fn wavy() -> Mesh {
    let mut mesh = shapes::torus(16, 12, 1.0, 0.4);
    for (uv, p) in mesh.uvs.iter_mut().zip(&mesh.positions) {
        *uv = vec2(uv.x + 0.03 * (7.0 * p.y).sin() + 0.2 * uv.y, uv.y + 0.02 * (5.0 * p.x).cos());
    }
    mesh
}

/// Compares at the corners whose faces have an area in uv.
fn compare(name: &str, mesh: &Mesh) {
    let (ours, theirs) = (tangents(mesh), oracle(mesh));
    let mut worst = 0.0_f32;
    for (c, b) in theirs.iter().enumerate() {
        let triangle = mesh.triangles[c / 3];
        if FaceUv::new(triangle.map(|v| mesh.uvs[v as usize])).handedness == 0 {
            continue;
        }
        let a = ours[triangle[c % 3] as usize];
        assert_eq!(a.w, b.w, "{name}: handedness at corner {c}");
        worst = worst.max((a.xyz() - b.xyz()).length());
    }
    assert!(worst < 2e-4, "{name}: tangents differ by {worst}");
}

#[test]
fn agrees_with_the_reference_implementation() {
    compare("wavy torus", &wavy());
    compare("cube", &shapes::cube());
    compare("grid", &shapes::quad_grid(5, 3));
    let mut mirrored = wavy();
    mirrored.uvs.iter_mut().for_each(|uv| uv.x = -uv.x);
    compare("mirrored torus", &mirrored);
}

#[test]
fn agrees_where_uvs_fold_over() {
    // u = |x|: the two halves of the grid are mirror images, their border is shared.
    let mut mesh = shapes::quad_grid(8, 6);
    for (uv, p) in mesh.uvs.iter_mut().zip(&mut mesh.positions) {
        *uv = vec2(p.x.abs(), 0.5 * p.y + 0.1 * p.x.abs());
        p.z = 0.3 * (2.0 * p.x + p.y).sin();
    }
    mesh.normals = crate::normals::mesh_normals(&mesh);
    let fold = mirrored_vertices(&mesh.triangles, &mesh.uvs);
    assert_eq!(fold.len(), 7);
    let split = split_mirrored(&mesh.triangles, &mesh.uvs);
    let mesh = split.apply(&mesh);
    assert!(mirrored_vertices(&mesh.triangles, &mesh.uvs).is_empty());
    compare("folded grid", &mesh);
}

#[test]
fn agrees_with_degenerate_uvs_and_faces() {
    let mut mesh = wavy();
    // A patch whose uvs collapse to a point, and one collapsed to a line.
    for v in [40, 41, 57, 58] {
        mesh.uvs[v] = vec2(0.25, 0.25);
    }
    for v in [100, 101, 117, 118] {
        mesh.uvs[v].y = 0.5;
    }
    // Collapsing turned some neighbours over.
    let mut mesh = split_mirrored(&mesh.triangles, &mesh.uvs).apply(&mesh);
    compare("degenerate uvs", &mesh);
    // A face with two equal positions, joined to the rest by its own vertices.
    let n = mesh.positions.len() as u32;
    for (p, uv) in [(0, vec2(0.1, 0.9)), (0, vec2(0.3, 0.7)), (1, vec2(0.2, 0.1))] {
        mesh.positions.push(mesh.positions[p]);
        mesh.normals.push(mesh.normals[p]);
        mesh.uvs.push(uv);
    }
    mesh.triangles.push([n, n + 1, n + 2]);
    let all = tangents(&mesh);
    for (t, normal) in all.iter().zip(&mesh.normals) {
        assert!((t.xyz().length() - 1.0).abs() < 1e-5 && t.w.abs() == 1.0, "{t:?}");
        assert!(t.xyz().dot(*normal).abs() < 1e-5, "{t:?} leaves the plane of {normal:?}");
    }
}

#[test]
fn vjp_agrees_with_central_differences() {
    let torus = shapes::torus(6, 5, 1.0, 0.4);
    // Vertices equal in position, normal and uv share a tangent; jitter afterwards moves them apart.
    let rows: Vec<f32> = torus
        .positions
        .iter()
        .zip(&torus.uvs)
        .flat_map(|(p, uv)| [p.x, p.y, p.z, uv.x % 1.0, uv.y % 1.0])
        .collect();
    let welds = [Weld::identity(torus.positions.len()), weld_rows(&rows, 5), weld_exact(&torus.positions)];
    for (case, weld) in welds.iter().enumerate() {
        let incidence = Incidence::new(&torus.triangles, weld);
        let frames = UvFrames::new(&incidence, &torus.uvs);
        let mut rng = Uniform::new(case as u64 + 2);
        let n = torus.positions.len();
        let jitter = |v: &Vec3f, rng: &mut Uniform| v.cast::<f64>().map(|x| x + rng.range(-0.05, 0.05));
        let mut x: Vec<f64> = torus.positions.iter().flat_map(|p| jitter(p, &mut rng).to_array()).collect();
        x.extend(torus.normals.iter().flat_map(|v| jitter(v, &mut rng).normalize_or_zero().to_array()));
        let seeds = rng.vec(4 * n, -1.0, 1.0);
        let seeds: &[Vec4<f64>] = bytemuck::cast_slice(&seeds);
        let split = |x: &[f64]| -> (Vec<Vec3<f64>>, Vec<Vec3<f64>>) {
            let all: &[Vec3<f64>] = bytemuck::cast_slice(x);
            (all[..n].to_vec(), all[n..].to_vec())
        };
        let (positions, normals) = split(&x);
        let (mut dp, mut dn) = (vec![Vec3::zero(); n], vec![Vec3::zero(); n]);
        vertex_tangents_vjp(&incidence, &frames, &positions, &normals, seeds, &mut dp, &mut dn);
        let gradient: Vec<f64> = dp.iter().chain(&dn).flat_map(|d| d.to_array()).collect();
        check(&format!("tangents, weld {case}"), &x, &gradient, 1e-5, 1e-6, |x| {
            let (positions, normals) = split(x);
            let t = vertex_tangents(&incidence, &frames, &positions, &normals);
            t.iter().zip(seeds).map(|(t, g)| t.xyz().dot(g.xyz())).sum()
        });
    }
}

#[test]
fn the_gradient_is_zero_without_contributions() {
    let mut mesh = shapes::quad_grid(2, 2);
    mesh.uvs.fill(vec2(0.5, 0.5));
    let incidence = Incidence::new(&mesh.triangles, &Weld::identity(9));
    let frames = UvFrames::new(&incidence, &mesh.uvs);
    let (mut dp, mut dn) = (vec![Vec3::zero(); 9], vec![Vec3::zero(); 9]);
    let seeds = vec![Vec4::splat(1.0_f32); 9];
    vertex_tangents_vjp(&incidence, &frames, &mesh.positions, &mesh.normals, &seeds, &mut dp, &mut dn);
    assert!(dp.iter().chain(&dn).all(|d| *d == Vec3::zero()));
    let t = vertex_tangents(&incidence, &frames, &mesh.positions, &mesh.normals);
    assert!(t.iter().all(|t| (t.xyz().length() - 1.0).abs() < 1e-6 && t.z == 0.0));
}

#[test]
#[ignore = "measurement"]
fn time_of_ten_thousand_triangles() {
    let mesh = shapes::torus(100, 50, 1.0, 0.4);
    let incidence = Incidence::new(&mesh.triangles, &Weld::identity(mesh.positions.len()));
    let frames = UvFrames::new(&incidence, &mesh.uvs);
    let (mut dp, mut dn) =
        (vec![Vec3::zero(); mesh.positions.len()], vec![Vec3::zero(); mesh.positions.len()]);
    let mut best = [f64::INFINITY; 2];
    for _ in 0..50 {
        let start = std::time::Instant::now();
        let t = vertex_tangents(&incidence, &frames, &mesh.positions, &mesh.normals);
        let forward = start.elapsed().as_secs_f64();
        vertex_tangents_vjp(&incidence, &frames, &mesh.positions, &mesh.normals, &t, &mut dp, &mut dn);
        best = [best[0].min(forward), best[1].min(start.elapsed().as_secs_f64() - forward)];
    }
    println!(
        "{} triangles: forward {:.3} ms, vjp {:.3} ms",
        mesh.triangles.len(),
        best[0] * 1e3,
        best[1] * 1e3
    );
}

//! Normals of vertices and their gradient.

use crate::{Twin, wave};
use photofit_geometry::gpu::{Lists, VertexNormals};
use photofit_geometry::normals::{Weighting, vertex_normals, vertex_normals_vjp};
use photofit_geometry::{Incidence, Weld, shapes};
use photofit_gpu::{Gpu, GpuError};
use photofit_scalar::Vec3f;

/// Unit vectors: a few roundings, and angles of polynomials within 2e-8.
const FORWARD: f64 = 3e-6;
/// As above, divided by lengths twice.
const GRADIENT: f64 = 4e-6;

pub(crate) async fn twins(gpu: &Gpu) -> Result<[Twin; 2], GpuError> {
    let mesh = shapes::displaced_sphere(12, 0.3, 3, 5);
    let incidence = Incidence::new(&mesh.triangles, &Weld::identity(mesh.positions.len()));
    let n = mesh.positions.len();
    let seed: Vec<Vec3f> = bytemuck::cast_slice(&wave(3 * n, 1)).to_vec();
    let normals = vertex_normals(&incidence, &mesh.positions, Weighting::Angle);
    let mut gradient = vec![Vec3f::zero(); n];
    vertex_normals_vjp(&incidence, &mesh.positions, Weighting::Angle, &seed, &mut gradient);

    let lists = Lists::new(gpu, &incidence)?;
    let twin = VertexNormals::new(gpu, &lists)?;
    let up = |name: &str, x: &[Vec3f]| gpu.upload::<[f32; 3]>(name, bytemuck::cast_slice(x));
    let (positions, d_normals) = (up("positions", &mesh.positions)?, up("gradient of normals", &seed)?);
    let (out, d_positions) = (gpu.zeros("normals", n)?, gpu.zeros("gradient of positions", n)?);
    let mut r = gpu.record("normals");
    twin.forward(&mut r, &positions, &out)?;
    twin.vjp(&mut r, &positions, &d_normals, &d_positions)?;
    r.finish()?.run()?;
    let (found, d_found) = (gpu.fetch(&out).await?, gpu.fetch(&d_positions).await?);
    Ok([
        Twin::new("normals", bytemuck::cast_slice(&normals), found.as_flattened(), FORWARD),
        Twin::new("gradient of normals", bytemuck::cast_slice(&gradient), d_found.as_flattened(), GRADIENT),
    ])
}

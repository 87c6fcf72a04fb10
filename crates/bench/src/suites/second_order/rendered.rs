//! The tasks of Wang et al. (2025) that need a renderer: a mug's rotation, a hidden sphere's shadow, a shape's pose, a
//! texture.
//!
//! The renderers are used as black boxes, without antialiasing: their true derivatives are zero almost everywhere.

use std::f32::consts::PI;

use anyhow::{Context as _, Result};
use photofit_geometry::{Mesh, shapes};
use photofit_raster::interpolate::interpolate;
use photofit_raster::project::{Matrix4, matrix_rows, project};
use photofit_raster::rasterize::{NONE, PixelGrid, barycentrics, rasterize};
use photofit_rays::{Accel, Ray};
use photofit_scalar::{Vec3f, Vec4f, vec3};

use super::tasks::{FOUR, Task, uniform};

/// Pixels along a side.
const SIZE: usize = 64;

/// Mean squared difference of two images.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len() as f64
}

/// A grey shape under a light from the upper left, rotated before it is seen.
#[derive(Clone, Debug)]
pub(super) struct Posed {
    mesh: Mesh,
    camera: Matrix4<f32>,
}

impl Posed {
    pub(super) fn new(mesh: Mesh) -> Self {
        let camera = photofit_scene::Camera::look_at(
            glam::vec3(0.0, 1.2, 4.2),
            glam::Vec3::ZERO,
            glam::Vec3::Y,
            0.7,
            1.0,
            0.5,
            10.0,
        );
        Self { mesh, camera: matrix_rows(&camera.view_projection()) }
    }

    /// The picture after a rotation by `|r|` about `r`.
    pub(super) fn render(&self, r: [f64; 3]) -> Vec<f32> {
        let turn = glam::Quat::from_scaled_axis(glam::DVec3::from(r).as_vec3());
        let rotate = |p: &Vec3f| {
            let q = turn * glam::Vec3::from(p.to_array());
            vec3(q.x, q.y, q.z)
        };
        let positions: Vec<Vec3f> = self.mesh.positions.iter().map(rotate).collect();
        let light = vec3(-0.5, 0.7, 0.5).normalize_or_zero();
        let shade = |n: &Vec3f| [0.15 + 0.85 * rotate(n).dot(light).max(0.0)];
        let shades: Vec<[f32; 1]> = self.mesh.normals.iter().map(shade).collect();
        let mut clip = vec![Vec4f::zero(); positions.len()];
        project(&self.camera, &positions, &mut clip);
        let seen = rasterize(&clip, &self.mesh.triangles, SIZE, SIZE, None);
        let grid = PixelGrid::new(SIZE, SIZE);
        let pixel = |(i, id): (usize, &u32)| {
            if *id == NONE {
                return 0.0;
            }
            let t = self.mesh.triangles[*id as usize].map(|v| v as usize);
            let b = barycentrics(&t.map(|v| clip[v]), grid.ndc(i % SIZE, i / SIZE), &grid);
            interpolate(t.map(|v| &shades[v]), &b)[0]
        };
        seen.triangle.iter().enumerate().map(pixel).collect()
    }
}

/// A thick cylinder, open at the top, with a handle.
pub(super) fn mug() -> Mesh {
    let mut mesh = Mesh::default();
    let mut add = |part: Mesh, place: &dyn Fn(Vec3f) -> Vec3f| {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(part.positions.iter().map(|p| place(*p)));
        mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|v| v + first)));
    };
    // The walls are grids bent round, the inner one the other way; rim and floor are rings.
    let ring = |p: Vec3f, turn: f32, r: f32, y: f32| {
        let (sin, cos) = (turn * PI * p.x).sin_cos();
        vec3(r * sin, y, r * cos)
    };
    add(shapes::quad_grid(48, 6), &|p| ring(p, 1.0, 0.7, 0.9 * p.y));
    add(shapes::quad_grid(48, 6), &|p| ring(p, -1.0, 0.6, 0.05 + 0.84 * p.y));
    add(shapes::quad_grid(48, 1), &|p| ring(p, 1.0, 0.65 - 0.049 * p.y, 0.905));
    add(shapes::quad_grid(48, 2), &|p| ring(p, 1.0, 0.295 * (1.0 - p.y), -0.785));
    // The handle: a ring that stands upright at +x.
    add(shapes::torus(32, 12, 0.45, 0.1), &|p| vec3(0.75 + p.x, p.z, p.y));
    mesh.normals = photofit_geometry::normals::mesh_normals(&mesh);
    mesh
}

fn pose_task(name: &'static str, mesh: Mesh, axes: usize) -> Task {
    let posed = Posed::new(mesh);
    let pose = |theta: &[f64]| match theta {
        [y] => [0.0, *y, 0.0],
        _ => [theta[0], theta[1], theta[2]],
    };
    let target: Vec<f64> = match axes {
        1 => vec![-0.4],
        _ => vec![0.5, -0.3, 0.2],
    };
    let reference = posed.render(pose(&target));
    let at = target.clone();
    Task {
        name,
        f: Box::new(move |theta, _| difference(&posed.render(pose(theta)), &reference)),
        target,
        start: Box::new(move |seed| {
            at.iter().zip(offset(&uniform(5, seed, axes))).map(|(x, d)| x + d).collect()
        }),
        sigma: [0.3, 0.01],
        rate: 0.05,
        adam: (150, FOUR),
        parallel: true,
        budget: 3000,
        known: [None, None],
    }
}

/// A turn of a start from its answer: 0.6 to 1.2 to either side about one axis, 0.6 about an axis in space.
fn offset(u: &[f64]) -> Vec<f64> {
    match u {
        [u] => vec![u.signum() * (0.9 + 0.3 * (2.0 * u.abs() - 1.0))],
        _ => {
            let length = u.iter().map(|u| u * u).sum::<f64>().sqrt();
            u.iter().map(|u| 0.6 * u / length).collect()
        }
    }
}

/// MUG: a rotation about the upright axis. Some starts hide the handle behind the mug, from where values say nothing
/// of the direction but through the blur.
///
/// The answer shows the handle in profile. At the brim of the hidden angles, from 0.7 to 2.4, it could not be found:
/// there the least value of the blurred loss lies among the hidden angles, for any method.
pub(super) fn mug_task() -> Task {
    Task { sigma: [0.6, 0.01], rate: 0.1, budget: 1500, adam: (100, FOUR), ..pose_task("MUG", mug(), 1) }
}

/// BUNNY: three rotations of a shape: a file named by `PHOTOFIT_BENCH_MESH`, or a bumpy sphere.
pub(super) fn bunny_task() -> Result<Task> {
    let mesh = match std::env::var_os("PHOTOFIT_BENCH_MESH") {
        None => shapes::displaced_sphere(12, 0.5, 2, 4),
        Some(path) => unit(photofit_scene::load(&path).with_context(|| format!("{}", path.display()))?)?,
    };
    Ok(pose_task("BUNNY", mesh, 3))
}

/// All of a scene in one mesh, moved into the unit sphere.
fn unit(scene: photofit_scene::Scene) -> Result<Mesh> {
    let mut mesh = scene.flatten().mesh;
    let (lo, hi) = mesh.bounds().context("a mesh with vertices")?;
    let (centre, scale) = ((lo + hi) * 0.5, 2.2 / (hi - lo).length().max(f32::MIN_POSITIVE));
    mesh.positions.iter_mut().for_each(|p| *p = (*p - centre) * scale);
    mesh.normals = photofit_geometry::normals::mesh_normals(&mesh);
    Ok(mesh)
}

/// Where the floor of [-2, 2]^2 sees the lamp at (0, 4, 0), with a sphere of radius 0.5 in between.
pub(super) fn shadow(sphere: &Accel, centre: &[f64]) -> Vec<f32> {
    let radius = 0.5;
    let centre = vec3(centre[0], centre[1], centre[2]).cast::<f32>();
    let lamp = vec3(0.0, 4.0, 0.0);
    let pixel = |i: usize| {
        let place = |k: usize| (k as f32 + 0.5) * (4.0 / SIZE as f32) - 2.0;
        let floor = vec3(place(i % SIZE), 0.0, place(i / SIZE));
        // Rays are moved, not the sphere.
        let to = |p: Vec3f| (p - centre) * (1.0 / radius);
        let ray = Ray::new(to(floor), to(lamp) - to(floor)).within(0.0, 1.0);
        f32::from(u8::from(!sphere.occluded(&ray)))
    };
    (0..SIZE * SIZE).map(pixel).collect()
}

/// SHADOW: where a sphere is that only its shadow on the floor tells of.
pub(super) fn shadow_task() -> Result<Task> {
    let ball = shapes::icosphere(8);
    let sphere = Accel::build(&ball.positions, &ball.triangles)?;
    let target = vec![0.3, 1.5, -0.2];
    let reference = shadow(&sphere, &target);
    let at = target.clone();
    Ok(Task {
        name: "SHADOW",
        f: Box::new(move |theta, _| difference(&shadow(&sphere, theta), &reference)),
        target,
        start: Box::new(move |seed| at.iter().zip(uniform(6, seed, 3)).map(|(x, u)| x + 0.6 * u).collect()),
        sigma: [0.3, 0.01],
        rate: 0.1,
        adam: (300, FOUR),
        parallel: true,
        budget: 4000,
        known: [None, None],
    })
}

/// Texels along a side.
const TEXELS: usize = 32;

/// TEXTURE: 32^2 texels of a tilted square, seen in perspective; bilinear filtering.
pub(super) fn texture_task() -> Task {
    let quad = shapes::quad_grid(1, 1);
    let tilt = |p: &Vec3f| vec3(1.3 * p.x, 1.3 * p.y, 0.4 * p.x);
    let positions: Vec<Vec3f> = quad.positions.iter().map(tilt).collect();
    let camera = Posed::new(Mesh::default()).camera;
    let mut clip = vec![Vec4f::zero(); positions.len()];
    project(&camera, &positions, &mut clip);
    let size = 64;
    let seen = rasterize(&clip, &quad.triangles, size, size, None);
    let grid = PixelGrid::new(size, size);
    // What each pixel reads: nothing of it depends on the texels.
    let mut taps: Vec<[(usize, f64); 4]> = Vec::new();
    for (i, id) in seen.triangle.iter().enumerate().filter(|(_, id)| **id != NONE) {
        let t = quad.triangles[*id as usize].map(|v| v as usize);
        let b = barycentrics(&t.map(|v| clip[v]), grid.ndc(i % size, i / size), &grid);
        let corners = t.map(|v| quad.uvs[v].to_array());
        let uv = interpolate(corners.each_ref(), &b);
        let at = uv.map(|c| (f64::from(c) * TEXELS as f64 - 0.5).clamp(0.0, TEXELS as f64 - 1.001));
        let [x, y] = at.map(|c| c as usize);
        let [fx, fy] = at.map(f64::fract);
        let index = y * TEXELS + x;
        taps.push([
            (index, (1.0 - fx) * (1.0 - fy)),
            (index + 1, fx * (1.0 - fy)),
            (index + TEXELS, (1.0 - fx) * fy),
            (index + TEXELS + 1, fx * fy),
        ]);
    }
    let read = |theta: &[f64], tap: &[(usize, f64); 4]| tap.iter().map(|(i, w)| w * theta[*i]).sum::<f64>();
    let wave = |i: usize| 0.5 + 0.3 * (0.7 * (i % TEXELS) as f64).sin() * (0.4 * (i / TEXELS) as f64).cos();
    let target: Vec<f64> = (0..TEXELS * TEXELS).map(wave).collect();
    let reference: Vec<f64> = taps.iter().map(|tap| read(&target, tap)).collect();
    let f = move |theta: &[f64], _| {
        let pairs = taps.iter().zip(&reference);
        pairs.map(|(tap, r)| (read(theta, tap) - r).powi(2)).sum::<f64>() / reference.len() as f64
    };
    Task {
        name: "TEXTURE",
        f: Box::new(f),
        target,
        start: Box::new(|seed| uniform(7, seed, TEXELS * TEXELS).iter().map(|u| 0.5 + 0.5 * u).collect()),
        sigma: [0.5, 0.1],
        rate: 0.05,
        adam: (70, FOUR),
        parallel: true,
        budget: 300_000,
        known: [None, None],
    }
}

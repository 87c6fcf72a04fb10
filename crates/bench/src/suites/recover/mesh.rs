//! Shapes found again from pictures with outlines, from a ball, by optimizer of positions: distances against steps and time.
//!
//! `PHOTOFIT_BENCH_MESHES` adds mesh files, separated by `:`, such as scans with thin parts.

use std::path::Path;

use anyhow::{Context as _, Result, bail};
use photofit_fit::Silent;
use photofit_fit::engine::surface::PositionOptimizer;
use photofit_fit::recover_mesh::{PictureSource, RecoverMeshOptions, recover_mesh};
use photofit_geometry::adjacency::Edges;
use photofit_geometry::weld::weld_exact;
use photofit_geometry::{Mesh, shapes};
use photofit_rays::{Accel, Ray};
use photofit_sampling::Rng;
use photofit_scalar::Vec3f;
use photofit_scene::{Instance, Material, Primitive, Scene};

use crate::context::Context;
use crate::plot::Axis;
use crate::points::{area, chosen, on_triangle};
use crate::timing::Timing;

/// Pictures of an asset, and pixels along the side of one.
const VIEWS: usize = 24;
const PIXELS: usize = 96;
/// Steps of runs, each a whole one from the same start: rates and levels go with the number of steps.
const STEPS: [u64; 3] = [75, 150, 300];
/// Runs whose distances are averaged.
const SEEDS: u64 = 3;
/// Points on creases and thin parts.
const POINTS: usize = 20_000;
/// Cosine of the angle of normals that makes an edge a crease (30 degrees).
const CREASE: f32 = 0.866;
/// What is thinner than this share of the bounding radius is a thin part.
const THIN: f32 = 0.1;

const METHODS: [(&str, PositionOptimizer); 3] = [
    ("Large Steps", PositionOptimizer::LargeSteps),
    ("bilateral", PositionOptimizer::Bilateral),
    ("Adam", PositionOptimizer::Adam),
];

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let mut meshes = vec![("cube".to_owned(), shapes::cube()), ("spikes".to_owned(), spikes())];
    for file in
        std::env::var("PHOTOFIT_BENCH_MESHES").unwrap_or_default().split(':').filter(|f| !f.is_empty())
    {
        let name = Path::new(file).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        meshes.push((name, photofit_scene::load(file)?.flatten().mesh));
    }
    for (name, mesh) in meshes {
        let asset = Scene {
            name: name.clone(),
            instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
            materials: vec![Material { roughness: 0.9, ..Material::clay() }],
            primitives: vec![Primitive { mesh: mesh.clone(), material: 0 }],
            ..Scene::default()
        };
        let parts = Parts::of(&mesh)?;
        let mut curves: Vec<(String, Vec<(f64, f64)>)> = Vec::new();
        for (method, optimizer) in METHODS {
            let mut curve = Vec::new();
            for steps in STEPS {
                let (seconds, figures) = runs(&asset, &parts, optimizer, steps)?;
                curve.push((seconds, figures[0].1));
                let timing = Timing { median: seconds, spread: 0.0, runs: SEEDS as usize };
                ctx.record(method, &format!("{name}, {steps} steps"), steps as usize, timing, figures);
            }
            curves.push((method.to_owned(), curve));
        }
        let title = format!("{name}: mean distance against time");
        ctx.plot(&name, &title, [Axis("seconds of the steps"), Axis("percent of the radius")], &curves)?;
    }
    ctx.note(format!(
        "{VIEWS} pictures of {PIXELS} x {PIXELS} pixels, from a ball, up to 5120 triangles; means over {SEEDS} seeds, in percent of the \
         bounding radius. Worst: the largest of the means of the seeds. Edges: mean distance to the shape that was found, of points on edges of more than 30 degrees; thin: of points where the \
         body is thinner than {:.0}% of the radius.",
        100.0 * THIN
    ));
    Ok(())
}

/// Mean seconds and figures of runs with several seeds.
fn runs(
    asset: &Scene,
    parts: &Parts,
    optimizer: PositionOptimizer,
    steps: u64,
) -> Result<(f64, Vec<(&'static str, f64)>)> {
    let dir = tempfile::tempdir()?;
    let output = dir.path().join("shape.glb");
    let (mut seconds, mut worst, mut sums) = (0.0, 0.0_f64, [0.0; 5]);
    for seed in 0..SEEDS {
        let options =
            RecoverMeshOptions { optimizer, steps, seed, texture_size: 64, ..RecoverMeshOptions::default() };
        let source = PictureSource::Asset { asset, views: VIEWS, size: PIXELS };
        let found = recover_mesh(source, None, &output, &options, &Silent)?;
        seconds += found.seconds_per_iteration * found.steps as f64 / SEEDS as f64;
        let [_, error] = found.shape_error.context("the shape of an asset is known")?;
        worst = worst.max(error.mean);
        let mesh = photofit_scene::load(&output)?.flatten().mesh;
        let [edges, thin] = parts.distances(&mesh)?;
        for (sum, value) in sums.iter_mut().zip([error.mean, error.p95, error.normals, edges, thin]) {
            *sum += value / SEEDS as f64;
        }
    }
    let [mean, p95, normals, edges, thin] = sums;
    let mut figures = vec![("mean", mean), ("worst", worst), ("95%", p95), ("normals, degrees", normals)];
    figures.extend((!parts.edges.is_empty()).then_some(("edges", edges)));
    figures.extend((!parts.thin.is_empty()).then_some(("thin", thin)));
    Ok((seconds, figures))
}

/// Points of the truth that are hard to find.
struct Parts {
    edges: Vec<Vec3f>,
    thin: Vec<Vec3f>,
    radius: f32,
}

impl Parts {
    fn of(mesh: &Mesh) -> Result<Self> {
        let Some((lo, hi)) = mesh.bounds() else { bail!("a mesh without vertices") };
        // That of the frame of the fit, which the other distances are in percent of.
        let center = (lo + hi) * 0.5;
        let radius = mesh.positions.iter().map(|p| (*p - center).length()).fold(0.0, f32::max);
        let mut rng = Rng::new(11, 0);
        let edges = Edges::new(&mesh.triangles, &weld_exact(&mesh.positions));
        let normal = |t: u32| {
            let [a, b, c] = mesh.corners(t as usize);
            (b - a).cross(c - a).normalize_or_zero()
        };
        let creases: Vec<[Vec3f; 2]> = (0..edges.len())
            .filter_map(|e| {
                let [Some(a), Some(b)] = edges.triangles(e) else { return None };
                if normal(a).dot(normal(b)) > CREASE {
                    return None;
                }
                let k = edges.of_triangle[a as usize].iter().position(|of| *of as usize == e)?;
                let corners = mesh.corners(a as usize);
                Some([corners[k], corners[(k + 1) % 3]])
            })
            .collect();
        let lengths = |e: &[Vec3f; 2]| f64::from((e[1] - e[0]).length());
        let along = chosen(&creases, lengths, POINTS, &mut rng, |[a, b], rng| a + (b - a) * rng.next_f32());
        let accel = Accel::build(&mesh.positions, &mesh.triangles)?;
        let faces: Vec<[Vec3f; 3]> = (0..mesh.triangles.len()).map(|t| mesh.corners(t)).collect();
        let inside = chosen(&faces, area, POINTS, &mut rng, |[a, b, c], rng| {
            let inward = (c - a).cross(b - a).normalize_or_zero();
            let p = on_triangle([a, b, c], rng);
            let ray = Ray::new(p, inward).within(1e-4 * radius, THIN * radius);
            accel.occluded(&ray).then_some(p)
        });
        Ok(Self { edges: along, thin: inside.into_iter().flatten().collect(), radius })
    }

    /// Mean distances of the points on edges and on thin parts from a mesh, percent of the radius.
    fn distances(&self, mesh: &Mesh) -> Result<[f64; 2]> {
        let accel = Accel::build(&mesh.positions, &mesh.triangles)?;
        let mean = |points: &[Vec3f]| {
            let far = |p: &Vec3f| {
                accel.closest_point(*p, f32::INFINITY).map_or(f64::NAN, |n| f64::from(n.distance))
            };
            100.0 * points.iter().map(far).sum::<f64>()
                / (points.len().max(1) as f64 * f64::from(self.radius))
        };
        Ok([mean(&self.edges), mean(&self.thin)])
    }
}

/// A ball with nine thin spikes.
fn spikes() -> Mesh {
    let mut mesh = shapes::icosphere(64);
    let directions: Vec<Vec3f> = (0..9)
        .map(|k| {
            let y = 1.0 - 2.0 * (k as f32 + 0.5) / 9.0;
            let (a, r) = (2.4 * k as f32, (1.0 - y * y).sqrt());
            Vec3f { x: r * a.cos(), y, z: r * a.sin() }
        })
        .collect();
    for p in &mut mesh.positions {
        let near = directions.iter().map(|d| d.dot(*p)).fold(-1.0, f32::max);
        let angle = near.clamp(-1.0, 1.0).acos();
        *p *= 0.35 + 0.65 * (-(angle / 0.12).powi(2)).exp();
    }
    Mesh { positions: mesh.positions, triangles: mesh.triangles, ..Mesh::default() }
}

//! Surfaces from points: meshes before a wall are sampled, reconstructed and compared with ray-cast depth.
//!
//! `PHOTOFIT_BENCH_MESHES` adds mesh files (separated by `:`); `PHOTOFIT_BENCH_PICTURES` is a folder for sheets of
//! raw, reconstructed and true maps.

mod scene;
pub(super) mod steps;

use anyhow::{Context as _, Result};
use glam::{Vec3, vec3};
use photofit_denoise::surface::{
    Cloud, Maps, Method, Pinhole, SurfaceOptions, before_after_sheet, reconstruct,
};
use photofit_geometry::{Mesh, shapes};
use photofit_image::{Image, write_png};
use photofit_rays::{Accel, Ray};
use photofit_sampling::Rng;
use photofit_scalar::Vec3f;
use std::path::Path;

use crate::context::Context;
use crate::points::{area, chosen, on_triangle};

/// Size of the pictures.
const SIZE: (usize, usize) = (480, 360);
/// Points of the object; the wall has twice as many.
const DENSITIES: [usize; 3] = [10_000, 60_000, 360_000];
/// Pixels around a step of depth that count as edge.
const EDGE: usize = 3;
/// Relative step of depth that is an edge.
const STEP: f32 = 0.05;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let mut meshes = vec![("rock".to_owned(), shapes::displaced_sphere(96, 0.25, 5, 7))];
    for file in
        std::env::var("PHOTOFIT_BENCH_MESHES").unwrap_or_default().split(':').filter(|f| !f.is_empty())
    {
        let scene = photofit_scene::load(file)?;
        let name = Path::new(file).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        meshes.push((name, scene.flatten().mesh));
    }
    for (name, mesh) in &mut meshes {
        object(ctx, name, mesh)?;
    }
    full_hd(ctx)?;
    ctx.note(
        "Two threads or more, the cloud prepared. Front, back, edge: relative rms errors of depth on the object, on the \
        wall, and within 3 pixels of a step of depth. The object is sampled with the points of the case, the wall with \
        twice as many; normals are estimated.",
    );
    Ok(())
}

/// All views, densities and methods of one object.
fn object(ctx: &mut Context, name: &str, mesh: &mut Mesh) -> Result<()> {
    normalize(mesh);
    let wall_from = mesh.triangles.len();
    add_wall(mesh);
    let accel = Accel::build(&mesh.positions, &mesh.triangles)?;
    for (view, distance) in [("far", 4.2), ("near", 2.0)] {
        let camera = camera(distance, SIZE);
        let truth = Truth::new(&accel, mesh, wall_from, &camera);
        for points in DENSITIES {
            let cloud = sampled(mesh, wall_from, points)?;
            for (method, options) in methods(ctx.baseline()) {
                let surface = ctx.measure(
                    &format!("{name} {view} {method}"),
                    &format!("{points} points"),
                    points,
                    || reconstruct(&cloud, &camera, &options, |_, _, _| true),
                    |surface| surface.as_ref().map_or(vec![], |s| truth.figures(&s.maps)),
                )?;
                picture(&format!("{name}-{view}-{points}-{method}"), &surface.raw, &surface.maps, &camera)?;
            }
        }
    }
    Ok(())
}

/// The methods by name; the baseline is what the solver starts from.
fn methods(baseline: bool) -> Vec<(&'static str, SurfaceOptions)> {
    let mut all = vec![
        ("fast", SurfaceOptions::new(Method::Fast)),
        ("blend", SurfaceOptions::new(Method::Blend)),
        ("hybrid", SurfaceOptions::new(Method::Hybrid)),
    ];
    if baseline {
        all.insert(0, ("start", SurfaceOptions { iterations: 0, ..SurfaceOptions::default() }));
    }
    all
}

/// The fast pipeline at 1920 x 1080.
fn full_hd(ctx: &mut Context) -> Result<()> {
    let mut mesh = shapes::displaced_sphere(96, 0.25, 5, 7);
    normalize(&mut mesh);
    let wall_from = mesh.triangles.len();
    add_wall(&mut mesh);
    let cloud = sampled(&mesh, wall_from, 333_333)?;
    let camera = camera(2.6, (1920, 1080));
    let options = SurfaceOptions::new(Method::Fast);
    ctx.measure(
        "fast, 1920 x 1080",
        "1000000 points",
        1920 * 1080,
        || reconstruct(&cloud, &camera, &options, |_, _, _| true).is_ok(),
        |_| vec![],
    );
    let positions = cloud.positions().to_vec();
    ctx.measure(
        "normals of the cloud",
        "1000000 points",
        positions.len(),
        || Cloud::new(positions.clone(), vec![], vec![]).is_ok(),
        |_| vec![],
    );
    Ok(())
}

/// Moves a mesh into the unit sphere.
fn normalize(mesh: &mut Mesh) {
    let Some((lo, hi)) = mesh.bounds() else { return };
    let (center, size) = ((lo + hi) * 0.5, (hi - lo).length() * 0.5);
    mesh.positions.iter_mut().for_each(|p| *p = (*p - center) * (1.0 / size));
}

/// Adds a tilted wall behind the unit sphere.
fn add_wall(mesh: &mut Mesh) {
    let base = mesh.positions.len() as u32;
    let corner = |x: f32, y: f32| Vec3f { x, y, z: -2.2 + 0.15 * x - 0.1 * y };
    mesh.positions.extend([corner(-9.0, -9.0), corner(9.0, -9.0), corner(9.0, 9.0), corner(-9.0, 9.0)]);
    mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
}

fn camera(distance: f64, (width, height): (usize, usize)) -> Pinhole {
    let (s, c) = 0.35_f64.sin_cos();
    let eye = [distance * s, 0.2 * distance, distance * c];
    Pinhole::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.7, width, height)
}

/// A pattern of the position: the truth of colours.
fn color(p: Vec3f) -> Vec3f {
    let wave = |v: f32, f: f32| 0.5 + 0.4 * (f * v).sin();
    Vec3f { x: wave(p.x + 0.3 * p.y, 11.0), y: wave(p.y - 0.2 * p.z, 13.0), z: wave(p.z + p.x, 7.0) }
}

/// Points spread evenly over the object, and twice as many over the wall.
fn sampled(mesh: &Mesh, wall_from: usize, points: usize) -> Result<Cloud> {
    let mut rng = Rng::new(17, points as u64);
    let triangles: Vec<[Vec3f; 3]> = (0..mesh.triangles.len()).map(|t| mesh.corners(t)).collect();
    let mut positions = Vec::with_capacity(3 * points);
    for (part, count) in [(&triangles[..wall_from], points), (&triangles[wall_from..], 2 * points)] {
        positions.extend(chosen(part, area, count, &mut rng, on_triangle));
    }
    let colors = positions.iter().map(|p| color(*p)).collect();
    Ok(Cloud::new(positions, vec![], colors)?)
}

/// True maps, and what each pixel shows.
struct Truth {
    z: Vec<f32>,
    normal: Vec<Vec3f>,
    color: Vec<Vec3f>,
    kind: Vec<Kind>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Front,
    Back,
    Edge,
    Nothing,
}

impl Truth {
    fn new(accel: &Accel, mesh: &Mesh, wall_from: usize, camera: &Pinhole) -> Self {
        let (w, h) = (camera.width, camera.height);
        let v = |a: [f64; 3]| vec3(a[0] as f32, a[1] as f32, a[2] as f32);
        let [right, down, forward] = camera.axes.map(v);
        let eye = v(camera.eye);
        let plain = |p: Vec3| Vec3f { x: p.x, y: p.y, z: p.z };
        let n = w * h;
        let mut truth = Self {
            z: vec![0.0; n],
            normal: vec![Vec3f::zero(); n],
            color: vec![Vec3f::zero(); n],
            kind: vec![Kind::Nothing; n],
        };
        for i in 0..n {
            let x = ((i % w) as f64 + 0.5 - camera.cx) / camera.fx;
            let y = ((i / w) as f64 + 0.5 - camera.cy) / camera.fy;
            let direction = right * x as f32 + down * y as f32 + forward;
            let Some(hit) = accel.closest_hit(&Ray::new(plain(eye), plain(direction))) else { continue };
            let t = hit.triangle as usize;
            truth.z[i] = hit.t;
            truth.kind[i] = if t < wall_from { Kind::Front } else { Kind::Back };
            truth.color[i] = color(plain(eye + direction * hit.t));
            let [a, b, c] = mesh.corners(t);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            truth.normal[i] = if normal.dot(plain(direction)) > 0.0 { -normal } else { normal };
        }
        let edges: Vec<bool> = (0..n).map(|i| truth.near_edge(i % w, i / w, w, h)).collect();
        for (kind, edge) in truth.kind.iter_mut().zip(edges) {
            if edge && *kind != Kind::Nothing {
                *kind = Kind::Edge;
            }
        }
        truth
    }

    fn near_edge(&self, x: usize, y: usize, w: usize, h: usize) -> bool {
        let (mut lo, mut hi) = (f32::INFINITY, 0.0_f32);
        for v in y.saturating_sub(EDGE)..(y + EDGE + 1).min(h) {
            for u in x.saturating_sub(EDGE)..(x + EDGE + 1).min(w) {
                let z = self.z[v * w + u];
                lo = lo.min(z);
                hi = hi.max(z);
            }
        }
        hi > lo * (1.0 + STEP) * (1.0 + 2.0 * EDGE as f32 * 0.01)
    }

    fn figures(&self, maps: &Maps) -> Vec<(&'static str, f64)> {
        let z = &maps.depth.data;
        let seen = |i: &usize, kind: Kind| self.kind[*i] == kind && z[*i] > 0.0;
        let rms = |kind: Kind| {
            let errors: Vec<f64> = (0..z.len())
                .filter(|i| seen(i, kind))
                .map(|i| f64::from(z[i] / self.z[i] - 1.0).powi(2))
                .collect();
            (errors.iter().sum::<f64>() / errors.len().max(1) as f64).sqrt()
        };
        let median = |kind: Kind| {
            let mut errors: Vec<f64> = (0..z.len())
                .filter(|i| seen(i, kind))
                .map(|i| f64::from(z[i] / self.z[i] - 1.0).abs())
                .collect();
            errors.sort_by(f64::total_cmp);
            errors.get(errors.len() / 2).copied().unwrap_or(0.0)
        };
        let front: Vec<usize> = (0..z.len()).filter(|i| seen(i, Kind::Front)).collect();
        let of = |image: &Image, i: usize| Vec3f {
            x: image.data[3 * i],
            y: image.data[3 * i + 1],
            z: image.data[3 * i + 2],
        };
        let mean =
            |f: &dyn Fn(usize) -> f64| front.iter().map(|i| f(*i)).sum::<f64>() / front.len().max(1) as f64;
        let angle = mean(&|i| {
            f64::from(of(&maps.normal, i).dot(self.normal[i])).clamp(-1.0, 1.0).acos().to_degrees()
        });
        let colour = maps.albedo.as_ref().map_or(0.0, |a| {
            -10.0 * mean(&|i| f64::from((of(a, i) - self.color[i]).length_squared()) / 3.0).log10()
        });
        let missed = (0..z.len()).filter(|i| self.kind[*i] != Kind::Nothing && z[*i] <= 0.0).count();
        vec![
            ("front", rms(Kind::Front)),
            ("front median", median(Kind::Front)),
            ("back", rms(Kind::Back)),
            ("edge", rms(Kind::Edge)),
            ("normal deg", angle),
            ("albedo dB", colour),
            ("missed %", 100.0 * missed as f64 / z.len() as f64),
        ]
    }
}

fn picture(name: &str, raw: &Maps, maps: &Maps, camera: &Pinhole) -> Result<()> {
    let Ok(folder) = std::env::var("PHOTOFIT_BENCH_PICTURES") else { return Ok(()) };
    let path = Path::new(&folder).join(format!("{name}.png"));
    std::fs::create_dir_all(&folder).with_context(|| format!("{folder}: cannot be made"))?;
    write_png(path, &before_after_sheet(raw, maps, camera))?;
    Ok(())
}

//! Ray casting: closest hits through the hierarchy against a test of every triangle in double precision.
//!
//! With `PHOTOFIT_BENCH_RAYS`, a folder of meshes `M.ply`, rays `rays_M_KIND.bin` (8 little-endian f32 each: origin,
//! direction, smallest and largest distance) and the hits of another tracer `hits_M_KIND.bin` (f32 distance, i32
//! triangle, -1 for a miss), the same rays are cast that the other program cast.

use anyhow::{Context as _, Result, bail};
use photofit_geometry::{Mesh, shapes};
use photofit_rays::{Accel, Builder, Ray};
use photofit_scalar::{Vec3, Vec3f, vec3};

use crate::context::Context;
use rayon::prelude::*;
use std::path::Path;

/// Rays per timed pass, and how many of them are compared with the exhaustive test.
const RAYS: usize = 1 << 16;
const COMPARED: usize = 256;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    if let Ok(folder) = std::env::var("PHOTOFIT_BENCH_RAYS") {
        return foreign(ctx, Path::new(&folder));
    }
    builders(ctx)?;
    for frequency in [16, 71, 158] {
        let mesh = shapes::displaced_sphere(frequency, 0.2, 4, 1);
        let count = mesh.triangles.len();
        let case = format!("{count} triangles");
        let accel = Accel::build(&mesh.positions, &mesh.triangles)?;
        ctx.measure(
            "build",
            &case,
            count,
            || Accel::build(&mesh.positions, &mesh.triangles).is_ok(),
            |_| vec![],
        );
        let rays = chords();
        let exact: Vec<Option<f64>> = rays[..COMPARED].iter().map(|ray| exhaustive(&mesh, ray)).collect();
        let hits = |rays: &[Ray]| -> Vec<Option<f32>> {
            rays.iter().map(|ray| accel.closest_hit(ray).map(|hit| hit.t)).collect()
        };
        ctx.measure(
            "closest hit, 65536 rays",
            &case,
            count,
            || hits(&rays),
            |found| vec![("largest error of t", worst(&exact, found))],
        );
        ctx.measure(
            "occlusion, 65536 rays",
            &case,
            count,
            || rays.iter().filter(|ray| accel.occluded(ray)).count(),
            |_| vec![],
        );
        if ctx.baseline() && count < 10_000 {
            let sample = &rays[..COMPARED];
            ctx.measure(
                "every triangle, 256 rays",
                &case,
                count,
                || sample.iter().filter(|ray| exhaustive(&mesh, ray).is_some()).count(),
                |_| vec![],
            );
        }
    }
    ctx.note("One thread. Chords of the sphere of radius 2; the shape has detail at four scales.");
    Ok(())
}

/// Build time, cost and trace rates of each builder: builds on one thread and on all, rays on one.
fn builders(ctx: &mut Context) -> Result<()> {
    let rays = chords();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let even = |frequency| ("even", shapes::displaced_sphere(frequency, 0.2, 4, 1));
    for (kind, mesh) in [even(71), even(158), ("on ground", on_ground()), ("slivers", slivers())] {
        let count = mesh.triangles.len();
        for (name, builder) in [
            ("binned", Builder::Binned),
            ("obvhs clustered", Builder::Clustered),
            ("obvhs reinserted", Builder::Reinserted),
        ] {
            let case = format!("{kind}, {count} triangles, {name}");
            let build = || Accel::build_with(&mesh.positions, &mesh.triangles, builder);
            let (timing, accel) = pool.install(|| crate::timing::time(build));
            let accel = accel?;
            let bytes = accel.bytes() as f64 / count as f64;
            let [nodes, leaves] = accel.cost();
            let figures = vec![("bytes per triangle", bytes), ("nodes met", nodes), ("leaves met", leaves)];
            ctx.record("builder: build, one thread", &case, count, timing, figures);
            ctx.measure("builder: build, all threads", &case, count, || build().is_ok(), |_| vec![]);
            let closest = || rays.iter().filter(|ray| accel.closest_hit(ray).is_some()).count();
            ctx.measure("builder: closest hit, 65536 rays", &case, count, closest, |_| vec![]);
            let occluded = || rays.iter().filter(|ray| accel.occluded(ray)).count();
            ctx.measure("builder: occlusion, 65536 rays", &case, count, occluded, |_| vec![]);
        }
    }
    Ok(())
}

/// A small sphere of many triangles and four large ones below it.
fn on_ground() -> Mesh {
    let mut mesh = shapes::displaced_sphere(71, 0.2, 4, 1);
    mesh.positions.iter_mut().for_each(|p| *p *= 0.2);
    let first = mesh.positions.len() as u32;
    let ground = shapes::quad_grid(2, 1);
    mesh.positions.extend(ground.positions.iter().map(|p| vec3(4.0 * p.x, -0.3, 4.0 * p.y)));
    mesh.triangles.extend(ground.triangles.iter().map(|t| t.map(|v| v + first)));
    mesh
}

/// A sphere of triangles that are a thousand times as long as wide.
fn slivers() -> Mesh {
    shapes::uv_sphere(12_500, 5)
}

/// Rays that another program cast, in its order.
fn foreign(ctx: &mut Context, folder: &Path) -> Result<()> {
    let mut meshes: Vec<_> = std::fs::read_dir(folder)?
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| p.extension().is_some_and(|e| e == "ply"))
        .collect();
    meshes.sort_by_key(|p| std::fs::metadata(p).map_or(0, |m| m.len()));
    for path in meshes {
        let name = path.file_stem().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        if !folder.join(format!("rays_{name}_camera.bin")).exists() {
            continue;
        }
        let mesh = photofit_scene::load(&path)?.flatten().mesh;
        let count = mesh.triangles.len();
        let accel = ctx.measure(
            "build, all threads",
            &format!("{count} triangles"),
            count,
            || Accel::build(&mesh.positions, &mesh.triangles),
            |built| built.iter().map(|a| ("bytes per triangle", a.bytes() as f64 / count as f64)).collect(),
        )?;
        for kind in ["camera", "bounce", "chord"] {
            let rays: Vec<Ray> = words(&folder.join(format!("rays_{name}_{kind}.bin")))?
                .chunks_exact(8)
                .map(|r| Ray::new(vec3(r[0], r[1], r[2]), vec3(r[3], r[4], r[5])).within(r[6], r[7]))
                .collect();
            let hits = words(&folder.join(format!("hits_{name}_{kind}.bin")))?;
            cast(ctx, &accel, &format!("{count}, {kind}"), &rays, &hits)?;
        }
    }
    ctx.note("Rays and expected hits of another program; Mray/s is the rate of the median.");
    Ok(())
}

/// Closest hits and occlusion on one thread and two.
fn cast(ctx: &mut Context, accel: &Accel, case: &str, rays: &[Ray], hits: &[f32]) -> Result<()> {
    if hits.len() != 2 * rays.len() {
        bail!("{case}: {} rays, but {} hits", rays.len(), hits.len() / 2);
    }
    const BLOCK: usize = 4096;
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        let rate = |seconds: f64| rays.len() as f64 / seconds / 1e6;
        let (timing, found) = pool.install(|| {
            crate::timing::time(|| {
                let distance = |r: &Ray| accel.closest_hit(r).map_or(-1.0, |h| h.t);
                rays.par_chunks(BLOCK).flat_map_iter(|c| c.iter().map(distance)).collect::<Vec<f32>>()
            })
        });
        let same = |(a, b): &(&f32, &[f32])| {
            (**a < 0.0) == (b[0] < 0.0) && (**a - b[0]).abs() <= 1e-4 * b[0].abs().max(1.0)
        };
        let other = found.iter().zip(hits.chunks_exact(2)).filter(|p| !same(p)).count();
        let figures = vec![("rays with another hit", other as f64), ("Mray/s", rate(timing.median))];
        ctx.record(&format!("closest, {threads} thread(s)"), case, rays.len(), timing, figures);
        let (timing, found) = pool.install(|| {
            crate::timing::time(|| {
                let count = |c: &[Ray]| c.iter().filter(|r| accel.occluded(r)).count();
                rays.par_chunks(BLOCK).map(count).sum::<usize>()
            })
        });
        let expected = hits.chunks_exact(2).filter(|h| h[0] >= 0.0).count();
        let figures =
            vec![("rays with another hit", found.abs_diff(expected) as f64), ("Mray/s", rate(timing.median))];
        ctx.record(&format!("occlusion, {threads} thread(s)"), case, rays.len(), timing, figures);
    }
    Ok(())
}

/// Little-endian words of a file.
fn words(path: &Path) -> Result<Vec<f32>> {
    let bytes = std::fs::read(path).with_context(|| path.display().to_string())?;
    Ok(bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
}

/// Rays between points of a sphere of radius 2 around the origin, spread evenly by an additive recurrence.
fn chords() -> Vec<Ray> {
    let share = |i: usize, step: f64| (0.5 + i as f64 * step).fract();
    let point = |z: f64, turn: f64| -> Vec3f {
        let (z, angle) = (2.0 * z - 1.0, std::f64::consts::TAU * turn);
        let ring = (1.0 - z * z).max(0.0).sqrt();
        (vec3(ring * angle.cos(), ring * angle.sin(), z) * 2.0).cast()
    };
    // Powers of the root of x^5 = x + 1, which no small integers relate.
    let g = 1.167_303_978_261_418_7_f64;
    let ray = |i: usize| {
        let a = point(share(i, 1.0 / g), share(i, g.powi(-2)));
        let b = point(share(i, g.powi(-3)), share(i, g.powi(-4)));
        Ray::new(a, b - a)
    };
    (0..RAYS).map(ray).collect()
}

/// Moeller and Trumbore (1997) on every triangle, in double precision.
fn exhaustive(mesh: &Mesh, ray: &Ray) -> Option<f64> {
    let (o, d): (Vec3<f64>, Vec3<f64>) = (ray.origin.cast(), ray.direction.cast());
    let mut best = f64::INFINITY;
    for t in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(t).map(|p| p.cast::<f64>());
        let (e1, e2) = (b - a, c - a);
        let p = d.cross(e2);
        let det = e1.dot(p);
        let s = o - a;
        let q = s.cross(e1);
        let (u, v, t) = (s.dot(p) / det, d.dot(q) / det, e2.dot(q) / det);
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0 && t < best {
            best = t;
        }
    }
    best.is_finite().then_some(best)
}

/// Largest difference of distances; a hit that only one side finds counts as 1.
fn worst(exact: &[Option<f64>], found: &[Option<f32>]) -> f64 {
    let pairs = exact.iter().zip(found).map(|(a, b)| match (a, b) {
        (Some(a), Some(b)) => (a - f64::from(*b)).abs(),
        (None, None) => 0.0,
        _ => 1.0,
    });
    pairs.fold(0.0, f64::max)
}

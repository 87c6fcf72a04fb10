//! Ray casting: closest hits through the hierarchy against a test of every triangle in double precision.

use anyhow::Result;
use photofit_geometry::{Mesh, shapes};
use photofit_pathtrace::{Accel, Ray};
use photofit_scalar::{Vec3, Vec3f, vec3};

use crate::context::Context;

/// Rays per timed pass, and how many of them are compared with the exhaustive test.
const RAYS: usize = 1 << 16;
const COMPARED: usize = 256;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
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

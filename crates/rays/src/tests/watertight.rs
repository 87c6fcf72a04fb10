//! Closed meshes do not let a ray out: many rays.

use super::{Random, Soup};
use crate::{Accel, Ray};
use photofit_geometry::{Mesh, shapes};
use photofit_scalar::{Vec3f, vec3};
use rayon::prelude::*;

/// Rays for each mesh and offset.
const RAYS: usize = 1 << 22;
const BLOCK: usize = 1 << 12;
/// Distance from the axis to the middle of the tube of the torus.
const MAJOR: f32 = 1.0;

/// Rays from inside a mesh that meet nothing: aimed at vertices, at points of edges, and anywhere.
fn leaks(mesh: &Soup, offset: Vec3f, scale: f32, middle: impl Fn(&mut Random) -> Vec3f + Sync) -> usize {
    let positions: Vec<Vec3f> = mesh.0.iter().map(|&p| p * scale + offset).collect();
    let accel = Accel::build(&positions, &mesh.1).unwrap();
    let block = |block: usize| {
        let mut random = Random(block as u64);
        let escapes = |i: &usize| {
            let corners = mesh.1[random.below(mesh.1.len())].map(|c| positions[c as usize]);
            let origin = (middle(&mut random) + random.point(0.1)) * scale + offset;
            let aim = match i % 3 {
                0 => corners[0],
                1 => corners[0] + (corners[1] - corners[0]) * random.unit(),
                _ => origin + random.point(scale),
            };
            !accel.occluded(&Ray::new(origin, aim - origin))
        };
        (0..BLOCK).filter(escapes).count()
    };
    (0..RAYS / BLOCK).into_par_iter().map(block).sum()
}

/// The surface of a box, each side a grid of `n` by `n` quads; `n` a power of two, so that edges have the same bits on
/// both sides.
fn grids(n: u32) -> Soup {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let base = positions.len() as u32;
            let line = |i: u32| 2.0 * i as f32 / n as f32 - 1.0;
            for (y, x) in (0..=n).flat_map(|y| (0..=n).map(move |x| (y, x))) {
                let mut p = [side; 3];
                (p[(axis + 1) % 3], p[(axis + 2) % 3]) = (line(x), line(y));
                positions.push(vec3(p[0], p[1], p[2]));
            }
            for (y, x) in (0..n).flat_map(|y| (0..n).map(move |x| (y, x))) {
                let a = base + y * (n + 1) + x;
                triangles.extend([[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]);
            }
        }
    }
    (positions, triangles)
}

#[test]
#[ignore = "slow: 10 seconds"]
fn no_ray_of_many_escapes() {
    let soup = |mesh: Mesh| (mesh.positions, mesh.triangles);
    let center = |_: &mut Random| Vec3f::zero();
    let tube = |random: &mut Random| {
        let angle = std::f32::consts::TAU * random.unit();
        vec3(angle.cos(), 0.0, angle.sin()) * MAJOR
    };
    for (offset, scale) in [(0.0, 1.0), (1e6, 4000.0)] {
        let offset = vec3(offset, -offset, 0.5 * offset);
        let sphere = leaks(&soup(shapes::icosphere(30)), offset, scale, center);
        let bumpy = leaks(&soup(shapes::displaced_sphere(40, 0.2, 4, 1)), offset, scale, center);
        let torus = leaks(&soup(shapes::torus(96, 40, MAJOR, 0.4)), offset, scale, tube);
        let cube = leaks(&grids(8), offset, scale, center);
        assert_eq!([sphere, bumpy, torus, cube], [0; 4], "of {RAYS} rays each, offset {offset:?}");
    }
}

//! The instructions that the machine has against those that every machine has: the same answers to the last bit.

use super::{Random, Soup, bumpy_sphere, corners, soup};
use crate::width::Portable;
use crate::{Accel, BoxRay, BoxTree, Hit, Ray};
use glam::DVec3;
use photofit_scalar::{Vec3f, vec3};

/// Asks both ways; the number of rays that hit.
fn check(mesh: &Soup, random: &mut Random) -> usize {
    let accel = Accel::build(&mesh.0, &mesh.1).unwrap();
    let mut hits = 0;
    for i in 0..4000 {
        let [a, b, c] = corners(mesh, random.below(mesh.1.len()));
        let origin = random.point(2.0);
        // At corners, at edges, along axes, anywhere.
        let direction = match i % 4 {
            0 => a - origin,
            1 => a + (b - a) * random.unit() - origin,
            2 => [vec3(1.0, 0.0, 0.0), vec3(0.0, -1.0, -0.0), vec3(-0.0, 0.0, 1.0)][random.below(3)],
            _ => a + (c - a) * random.unit() * 2.0 - origin,
        };
        let ray = Ray::new(origin, direction).within([0.0, -0.5][i % 2], [f32::INFINITY, 1.0, 0.9][i % 3]);
        let (fast, portable) = (accel.closest_hit(&ray), accel.closest_with(Portable, &ray, |_| true));
        assert_eq!(fast, portable, "{ray:?}");
        assert_eq!(accel.occluded(&ray), accel.occluded_with(Portable, &ray, |_| true), "{ray:?}");
        let (mut all, mut portable): (Vec<Hit>, Vec<Hit>) = (Vec::new(), Vec::new());
        accel.for_each_hit(&ray, |hit| all.push(hit));
        accel.visit_with(Portable, &ray, |hit| {
            portable.push(hit);
            true
        });
        assert_eq!(all, portable, "{ray:?}");
        hits += usize::from(fast.is_some());
    }
    hits
}

#[test]
fn both_ways_answer_the_same() {
    let mut random = Random(11);
    for (count, size) in [(1, 0.9), (3, 0.5), (40, 0.4), (900, 0.2), (3000, 0.05)] {
        let mesh = soup(count, size, &mut random);
        assert!(check(&mesh, &mut random) > 300, "rays are aimed");
    }
    assert!(check(&bumpy_sphere(20), &mut random) > 2000);
    // Every triangle twice, slivers of no width, points, a far offset, and all of them flat.
    let (positions, mut triangles) = soup(300, 0.3, &mut random);
    triangles.extend(triangles.clone());
    triangles.extend((0..200).map(|t| [3 * t, 3 * t + 1, 3 * t]));
    triangles.extend((0..50).map(|t| [t, t, t]));
    let moved = |f: fn(Vec3f) -> Vec3f| positions.iter().map(|&p| f(p)).collect::<Vec<_>>();
    let needles = moved(|p| vec3(p.x, p.y * 1e-6, p.z * 1e-3));
    for positions in [moved(|p| p), needles, moved(|p| vec3(p.x, 0.25, p.z))] {
        assert!(check(&(positions, triangles.clone()), &mut random) > 100);
    }
    check(&(moved(|p| p + vec3(1e6, -1e6, 0.0)), triangles), &mut random);
}

#[test]
fn both_ways_visit_the_same_boxes() {
    let mut random = Random(12);
    let boxes: Vec<[DVec3; 2]> = (0..300)
        .map(|_| {
            let [p, q] =
                [random.point(1.0), random.point(0.4)].map(|p| DVec3::from(p.to_array().map(f64::from)));
            [p - q.abs(), p + q.abs()]
        })
        .collect();
    let tree = BoxTree::build(&boxes);
    let mut visits = 0;
    for _ in 0..2000 {
        let ray = BoxRay::new(&tree, random.point(2.0), random.point(1.0));
        let (mut seen, mut portable) = (Vec::new(), Vec::new());
        tree.walk(&ray, 5.0, |entry, limit| {
            seen.push((entry, limit));
            Some(limit * 0.9)
        });
        tree.walk_with(Portable, &ray, 5.0, |entry, limit| {
            portable.push((entry, limit));
            Some(limit * 0.9)
        });
        assert_eq!(seen, portable);
        visits += seen.len();
    }
    assert!(visits > 2000, "{visits} boxes");
}

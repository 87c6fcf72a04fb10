//! Known answers, brute-force oracles, leaks, stress.

mod trees;
mod watertight;
mod widths;

use super::{Accel, AccelError, Hit, Ray};
use photofit_scalar::{Vec3, Vec3f, vec3};

/// A small counter-based generator, uniform in [0, 1).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
    fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1 << 24) as f32
    }
    fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }
    fn point(&mut self, scale: f32) -> Vec3f {
        vec3(self.unit() - 0.5, self.unit() - 0.5, self.unit() - 0.5) * (2.0 * scale)
    }
}

type Soup = (Vec<Vec3f>, Vec<[u32; 3]>);

/// A closed bumpy sphere with shared vertices: `rows` by `2 rows` quads and two fans.
fn bumpy_sphere(rows: u32) -> Soup {
    let columns = 2 * rows;
    let mut positions = vec![vec3(0.0, 1.0, 0.0)];
    for i in 1..rows {
        for j in 0..columns {
            let theta = std::f32::consts::PI * i as f32 / rows as f32;
            let phi = std::f32::consts::TAU * j as f32 / columns as f32;
            let r = 1.0 + 0.2 * (5.0 * phi).sin() * (4.0 * theta).sin();
            positions.push(vec3(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()) * r);
        }
    }
    positions.push(vec3(0.0, -1.0, 0.0));
    let last = positions.len() as u32 - 1;
    let at = |i: u32, j: u32| 1 + (i - 1) * columns + j % columns;
    let mut triangles = Vec::new();
    for j in 0..columns {
        triangles.push([0, at(1, j + 1), at(1, j)]);
        triangles.push([last, at(rows - 1, j), at(rows - 1, j + 1)]);
        for i in 1..rows - 1 {
            triangles.push([at(i, j), at(i, j + 1), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i + 1, j)]);
        }
    }
    (positions, triangles)
}

fn soup(count: usize, size: f32, random: &mut Random) -> Soup {
    let mut positions = Vec::new();
    for _ in 0..count {
        let center = random.point(1.0);
        for _ in 0..3 {
            positions.push(center + random.point(size));
        }
    }
    let triangles = (0..count as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    (positions, triangles)
}

/// Moeller and Trumbore 1997 in double precision, a little too large on all sides: `(t, u, v, front)`.
fn oracle(o: Vec3f, d: Vec3f, [a, b, c]: [Vec3f; 3]) -> Option<(f64, f64, f64, bool)> {
    let [o, d, a, b, c]: [Vec3<f64>; 5] = [o, d, a, b, c].map(Vec3f::cast);
    let (e1, e2) = (b - a, c - a);
    let p = d.cross(e2);
    let det = e1.dot(p);
    let s = o - a;
    let q = s.cross(e1);
    let (u, v, t) = (s.dot(p) / det, d.dot(q) / det, e2.dot(q) / det);
    let least = u.min(v).min(1.0 - u - v).min(t);
    (det != 0.0 && least >= -1e-4).then_some((t, u, v, det > 0.0))
}

fn corners((positions, triangles): &Soup, t: usize) -> [Vec3f; 3] {
    triangles[t].map(|i| positions[i as usize])
}

#[test]
fn closest_hits_agree_with_brute_force() {
    let mut random = Random(1);
    for (count, size) in [(1, 0.9), (2, 0.5), (5, 0.5), (60, 0.3), (700, 0.1)] {
        let mesh = soup(count, size, &mut random);
        let accel = Accel::build(&mesh.0, &mesh.1).unwrap();
        let (mut hits, mut compared) = (0, 0);
        for _ in 0..600 {
            let o = random.point(2.0);
            // Some rays are aimed at a triangle, some go anywhere.
            let [a, b, c] = corners(&mesh, random.below(count));
            let (u, v) = (random.unit(), random.unit());
            let d = a + (b - a) * u + (c - a) * v - o;
            let mut all: Vec<(f64, f64, f64, bool, usize)> = (0..count)
                .filter_map(|t| oracle(o, d, corners(&mesh, t)).map(|(s, u, v, f)| (s, u, v, f, t)))
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            // Rays that graze an edge within single precision may differ: leave them to the leak test.
            let grazes = all.iter().any(|h| h.1.min(h.2).min(1.0 - h.1 - h.2).min(h.0) < 1e-4);
            let hit = accel.closest_hit(&Ray::new(o, d));
            let mut count_along = 0;
            accel.for_each_hit(&Ray::new(o, d), |_| count_along += 1);
            if grazes {
                continue;
            }
            compared += 1;
            assert_eq!(accel.occluded(&Ray::new(o, d)), hit.is_some(), "occlusion is a hit");
            assert_eq!(count_along, all.len(), "hits along the ray");
            match (hit, all.first()) {
                (None, None) => {}
                (Some(h), Some(&(t, u, v, front, triangle))) => {
                    hits += 1;
                    let tied = all.get(1).is_some_and(|n| (n.0 - t).abs() < 1e-5 * (1.0 + t));
                    assert!((f64::from(h.t) - t).abs() < 1e-4 * (1.0 + t), "{} against {t}", h.t);
                    if !tied {
                        assert_eq!(h.triangle as usize, triangle, "nearest triangle");
                        assert_eq!(h.front, front, "side");
                        // Slivers and triangles seen from the side have determinants of few digits.
                        let [a, b, c] = corners(&mesh, triangle).map(Vec3f::cast::<f64>);
                        let (e1, e2, along) = (b - a, c - a, d.cast::<f64>());
                        let volume = e1.cross(e2).dot(along).abs();
                        let sine = volume / (e1.length() * e2.length() * along.length());
                        let most = 1e-3 + 4e-7 / sine;
                        let apart = (f64::from(h.u) - u).abs().max((f64::from(h.v) - v).abs());
                        assert!(apart < most, "{h:?}: {apart} of {most}");
                    }
                }
                (hit, first) => panic!("{hit:?} against {first:?}"),
            }
        }
        assert!(compared > 450, "{compared} rays of {count} triangles compared");
        assert!(hits > 20, "{hits} hits on {count} triangles");
    }
}

#[test]
fn filters_and_ranges_select_hits() {
    // Three parallel sheets at z = 0, 1, 2, the middle one turned round.
    let mut positions = Vec::new();
    for z in [0.0, 1.0, 2.0] {
        positions.extend([vec3(-1.0, -1.0, z), vec3(3.0, -1.0, z), vec3(-1.0, 3.0, z)]);
    }
    let accel = Accel::build(&positions, &[[0, 1, 2], [3, 5, 4], [6, 7, 8]]).unwrap();
    let ray = Ray::new(vec3(0.1, 0.2, 3.0), vec3(0.0, 0.0, -1.0));
    let first = |h: Option<Hit>| h.map(|h| h.triangle);
    assert_eq!(first(accel.closest_hit(&ray)), Some(2));
    assert_eq!(first(accel.closest_hit_where(&ray, |h| !h.front)), Some(1));
    assert_eq!(first(accel.closest_hit_where(&ray, |h| h.triangle == 0)), Some(0));
    assert_eq!(first(accel.closest_hit_where(&ray, |_| false)), None);
    assert_eq!(first(accel.closest_hit(&ray.within(1.5, 10.0))), Some(1));
    assert_eq!(first(accel.closest_hit(&ray.within(2.25, 2.75))), None);
    assert_eq!(first(accel.closest_hit(&ray.within(1.0, 1.0))), Some(2), "both ends count");
    assert!(accel.occluded_where(&ray, |h| h.t > 2.5));
    assert!(!accel.occluded_where(&ray, |h| h.t > 3.5));
    let mut seen = Vec::new();
    accel.for_each_hit(&ray, |h| seen.push((h.triangle, h.front)));
    seen.sort_unstable();
    assert_eq!(seen, [(0, true), (1, false), (2, true)]);
}

/// Shoots rays from inside at vertices and points of edges; counts those that hit nothing.
fn leaks(mesh: &Soup, origin: Vec3f, rays: usize, random: &mut Random) -> usize {
    let accel = Accel::build(&mesh.0, &mesh.1).unwrap();
    let mut escaped = 0;
    for i in 0..rays {
        let [a, b, _] = corners(mesh, random.below(mesh.1.len()));
        let s = if i % 4 == 0 { 0.0 } else { random.unit() };
        let start = origin + random.point(0.2);
        let aim = a + (b - a) * s;
        escaped += usize::from(!accel.occluded(&Ray::new(start, aim - start)));
    }
    escaped
}

#[test]
fn closed_meshes_do_not_leak() {
    let mut random = Random(3);
    let mesh = bumpy_sphere(24);
    assert_eq!(leaks(&mesh, Vec3::zero(), 1 << 20, &mut random), 0);
    // A missing triangle must be noticed.
    let mut holed = mesh.clone();
    holed.1.swap_remove(100);
    assert!(leaks(&holed, Vec3::zero(), 1 << 16, &mut random) > 0);
}

#[test]
fn offset_and_scaled_meshes_do_not_leak_alone_or_beside_far_parts() {
    let mut random = Random(4);
    let cases = [
        (1.0, 1e6, None),
        (4000.0, 1e6, None),
        (1e-6, 0.0, None),
        (1e15, 0.0, None),
        (1e-30, 0.0, None),
        (1.0, 0.0, Some(vec3(3.0, 511.3, 10.0))),
        (1e-3, 0.0, Some(vec3(-40.0, 3e3, 1e3))),
        (1.0, 50.0, Some(vec3(-1e4, 3e4, 2e4))),
    ];
    for (scale, offset, far) in cases {
        let (positions, mut triangles) = bumpy_sphere(16);
        let shift = vec3(offset, -offset, 0.5 * offset);
        let mut moved: Vec<Vec3f> = positions.iter().map(|&p| p * scale + shift).collect();
        let vertices = moved.len();
        if let Some(far) = far {
            moved.extend([far, far + vec3(1.0, 0.0, 0.0), far + vec3(0.0, 0.0, 1.0)]);
            triangles.push([vertices, vertices + 1, vertices + 2].map(|i| i as u32));
        }
        let accel = Accel::build(&moved, &triangles).unwrap();
        for _ in 0..1 << 15 {
            // Aim in the rounded coordinates themselves, exactly at a vertex.
            let d = random.point(1.0).normalize_or_zero();
            let start = shift + random.point(0.3 * scale);
            let vertex = moved[random.below(vertices)] - start;
            let case = format!("scale {scale}, offset {offset}, far part at {far:?}: {start:?}");
            assert!(accel.occluded(&Ray::new(start, d)), "{case} {d:?}");
            // Directions of 1e-31 are outside of the accepted range: bring them to unit length.
            let aim = (vertex.cast::<f64>() * (1.0 / f64::from(scale))).cast();
            assert!(accel.occluded(&Ray::new(start, aim)), "{case} {aim:?}");
        }
    }
}

#[test]
fn far_parts_do_not_move_near_ones() {
    let floor = [vec3(-2.1, 0.0, 2.3), vec3(2.2, 0.0, 2.3), vec3(2.2, 0.0, -2.7), vec3(-2.1, 0.0, -2.7)];
    let near = Accel::build(&floor, &[[0, 1, 2], [0, 2, 3]]).unwrap();
    let mut random = Random(9);
    for far in [vec3(3.0, 511.3, 10.0), vec3(-3.0, -700.7, 10.0), vec3(1e4, 3e4, -2e4)] {
        let mut positions = floor.to_vec();
        positions.extend([far, far + vec3(1.0, 0.0, 0.0), far + vec3(0.0, 0.0, 1.0)]);
        let both = Accel::build(&positions, &[[0, 1, 2], [0, 2, 3], [4, 5, 6]]).unwrap();
        for _ in 0..1 << 12 {
            let below = random.point(2.0);
            let start = vec3(below.x, 1e-6, below.z);
            let up = random.point(1.0);
            let up = vec3(up.x, up.y.abs() + 0.01, up.z).normalize_or_zero();
            assert!(!both.occluded(&Ray::new(start, up).within(0.0, 100.0)), "{far:?}: {start:?} {up:?}");
            let down = Ray::new(start + up, up * -1.0);
            assert_eq!(both.closest_hit(&down), near.closest_hit(&down), "{far:?}: {down:?}");
        }
    }
}

#[test]
fn what_coordinates_are_moved_by_loses_no_digit() {
    let mut moved = 0;
    let mut check = |near: f32, far: f32, random: &mut Random| {
        for sign in [1.0, -1.0] {
            let mut bounds = [f64::from(sign * near), f64::from(sign * far)];
            bounds.sort_by(f64::total_cmp);
            let center = crate::exact_center(bounds);
            moved += u32::from(center != 0.0);
            let is_far = f64::from(near) >= 0.5 * (f64::from(far) - f64::from(near));
            assert_eq!(center != 0.0, is_far, "{near} {far}: {center}");
            // Neighbours of the bounds, and values between.
            let mut values = vec![near, far, near.next_up().min(far), far.next_down().max(near)];
            values.extend((0..20).map(|_| (near + random.unit() * (far - near)).clamp(near, far)));
            for x in values.into_iter().map(|x| sign * x) {
                let exact = f64::from(x) - center;
                assert_eq!(f64::from(exact as f32), exact, "{near} {far}: {x} by {center}");
            }
        }
    };
    let mut random = Random(11);
    for _ in 0..1 << 12 {
        let near = (random.unit() * 20.0 - 10.0).exp2();
        let far = near * (1.0 + 2.5 * random.unit());
        check(near, far, &mut random);
    }
    for near in [0.5_f32, 1.0, 1.0 + f32::EPSILON, 1.5, 4.0_f32.next_down()] {
        for far in [(3.0 * near).next_down(), 3.0 * near, (3.0 * near).next_up()] {
            check(near, far, &mut random);
        }
    }
    assert!(moved > 1 << 12, "{moved}");
}

#[test]
fn axis_aligned_rays_on_grid_lines_hit() {
    let n = 16_u32;
    let positions: Vec<Vec3f> =
        (0..=n).flat_map(|y| (0..=n).map(move |x| vec3(x as f32, y as f32, 0.0))).collect();
    let at = |x: u32, y: u32| y * (n + 1) + x;
    let triangles: Vec<[u32; 3]> = (0..n)
        .flat_map(|y| {
            (0..n).flat_map(move |x| {
                [[at(x, y), at(x + 1, y), at(x + 1, y + 1)], [at(x, y), at(x + 1, y + 1), at(x, y + 1)]]
            })
        })
        .collect();
    let accel = Accel::build(&positions, &triangles).unwrap();
    for y in 0..=2 * n {
        for x in 0..=2 * n {
            let o = vec3(0.5 * x as f32, 0.5 * y as f32, 5.0);
            for z in [-1.0, -2.5] {
                let hit = accel.closest_hit(&Ray::new(o, vec3(0.0, -0.0, z)));
                assert!(hit.is_some_and(|h| (h.t * -z - 5.0).abs() < 1e-6 && h.front), "{o:?}: {hit:?}");
            }
        }
    }
    // Within the plane nothing can be met; beside it neither.
    assert_eq!(accel.closest_hit(&Ray::new(vec3(-1.0, 3.0, 0.0), vec3(1.0, 0.0, 0.0))), None);
    assert_eq!(accel.closest_hit(&Ray::new(vec3(-0.01, 3.0, 5.0), vec3(0.0, 0.0, -1.0))), None);
}

/// Closest point by dense sampling in double precision: an upper bound that converges from above.
fn sampled_distance(p: Vec3f, [a, b, c]: [Vec3f; 3]) -> f64 {
    let [p, a, b, c]: [Vec3<f64>; 4] = [p, a, b, c].map(Vec3f::cast);
    let mut best = f64::INFINITY;
    let n = 120;
    for i in 0..=n {
        for j in 0..=n - i {
            let (u, v) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
            best = best.min((a + (b - a) * u + (c - a) * v - p).length());
        }
    }
    best
}

#[test]
fn closest_points_agree_with_dense_sampling() {
    let mut random = Random(5);
    let mut mesh = soup(40, 0.4, &mut random);
    // A needle, a segment and a point.
    let n = mesh.0.len() as u32;
    mesh.0.extend([vec3(1.0, 1.0, 1.0), vec3(-1.0, 1.0, 1.0), vec3(0.0, 1.0 + 1e-6, 1.0)]);
    mesh.1.extend([[n, n + 1, n + 2], [n, n + 1, n], [n, n, n]]);
    let accel = Accel::build(&mesh.0, &mesh.1).unwrap();
    for _ in 0..150 {
        let p = random.point(2.0);
        let nearest = accel.closest_point(p, f32::INFINITY).unwrap();
        let expected =
            (0..mesh.1.len()).map(|t| sampled_distance(p, corners(&mesh, t))).fold(f64::INFINITY, f64::min);
        let d = f64::from(nearest.distance);
        assert!(d <= expected + 1e-5 && d >= expected - 0.01, "{d} against {expected}");
        let [a, b, c] = corners(&mesh, nearest.triangle as usize);
        let q = a + (b - a) * nearest.u + (c - a) * nearest.v;
        assert!(((q - p).length() - nearest.distance).abs() < 1e-5, "weights give the point");
        assert_eq!(accel.closest_point(p, nearest.distance * 0.999), None);
        assert!(accel.closest_point(p, nearest.distance * 1.001).is_some());
        let other = accel.closest_point_where(p, f32::INFINITY, |c| c.triangle != nearest.triangle).unwrap();
        assert!(other.triangle != nearest.triangle && other.distance >= nearest.distance);
    }
}

#[test]
fn answers_do_not_depend_on_threads() {
    // Every triangle three times: ties everywhere.
    let mut random = Random(6);
    let (positions, mut triangles) = soup(400, 0.2, &mut random);
    let once = triangles.clone();
    triangles.extend(&once);
    triangles.extend(&once);
    let rays: Vec<Ray> = (0..4000).map(|_| Ray::new(random.point(2.0), random.point(1.0))).collect();
    let ask = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let accel = pool.install(|| Accel::build(&positions, &triangles).unwrap());
        rays.iter()
            .map(|r| (accel.closest_hit(r), accel.closest_point(r.origin, f32::INFINITY)))
            .collect::<Vec<_>>()
    };
    let one = ask(1);
    assert!(one == ask(3), "answers differ");
    assert!(one.iter().all(|(h, p)| h.is_none_or(|h| h.triangle < 400) && p.unwrap().triangle < 400));
}

#[test]
fn bad_input_is_refused_and_degenerate_input_answers() {
    let p = [vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0)];
    let with = |x: f32| [p[0], vec3(0.0, x, 0.0), p[2]];
    let t = [[0, 1, 2]];
    assert_eq!(Accel::build(&with(f32::NAN), &t).unwrap_err(), AccelError::NonFinite { vertex: 1 });
    assert_eq!(Accel::build(&with(f32::INFINITY), &t).unwrap_err(), AccelError::NonFinite { vertex: 1 });
    assert_eq!(Accel::build(&with(-1e19), &t).unwrap_err(), AccelError::TooFar { vertex: 1 });
    assert_eq!(
        Accel::build(&p, &[[0, 1, 2], [0, 3, 1]]).unwrap_err(),
        AccelError::Index { triangle: 1, index: 3, vertices: 3 }
    );
    // The first fault counts; vertices that no triangle names do not.
    let bad = [p[0], p[1], p[2], vec3(f32::NAN, 0.0, 0.0), vec3(0.0, 0.0, -2e18)];
    for (second, error) in [
        ([0, 4, 3], AccelError::TooFar { vertex: 4 }),
        ([3, 4, 9], AccelError::NonFinite { vertex: 3 }),
        ([0, 9, 3], AccelError::Index { triangle: 1, index: 9, vertices: 5 }),
    ] {
        assert_eq!(Accel::build(&bad, &[[0, 1, 2], second]).unwrap_err(), error);
    }
    let down = Ray::new(vec3(0.2, 0.2, 1.0), vec3(0.0, 0.0, -1.0));
    let hit = |positions: &[Vec3f]| Accel::build(positions, &t).unwrap().closest_hit(&down).unwrap();
    assert_eq!(hit(&bad), hit(&p));
    let empty = Accel::build(&with(f32::NAN), &[]).unwrap();
    assert!(empty.closest_hit(&down).is_none() && empty.closest_point(p[0], f32::INFINITY).is_none());
    // Many equal triangles, triangles without area, one point.
    let flat: Vec<[u32; 3]> = (0..300).map(|i| if i % 2 == 0 { [0, 1, 1] } else { [2, 2, 2] }).collect();
    let accel = Accel::build(&p, &flat).unwrap();
    assert!(accel.closest_hit(&down).is_none());
    assert!((accel.closest_point(vec3(0.5, -2.0, 0.0), 10.0).unwrap().distance - 2.0).abs() < 1e-6);
    let point = Accel::build(&p, &[[1, 1, 1]]).unwrap();
    assert!(point.closest_hit(&Ray::new(p[0], vec3(1.0, 0.0, 0.0))).is_none());
    assert!((point.closest_point(p[0], 2.0).unwrap().distance - 1.0).abs() < 1e-6);
    // Rays and queries that make no sense.
    let accel = Accel::build(&p, &t).unwrap();
    assert!(accel.closest_hit(&down).is_some());
    for bad in [
        Ray::new(down.origin, Vec3::zero()),
        Ray::new(down.origin, vec3(0.0, f32::NAN, -1.0)),
        Ray::new(down.origin, vec3(0.0, 0.0, f32::NEG_INFINITY)),
        Ray::new(vec3(f32::NAN, 0.0, 0.0), down.direction),
        down.within(f32::NAN, 2.0),
        down.within(2.0, 1.0),
    ] {
        assert_eq!(accel.closest_hit(&bad), None, "{bad:?}");
    }
    assert!(accel.closest_point(vec3(f32::NAN, 0.0, 0.0), 1.0).is_none());
    assert!(accel.closest_point(p[0], f32::NAN).is_none() && accel.closest_point(p[0], -1.0).is_none());
    assert!(
        accel.closest_hit(&Ray::new(vec3(0.2, 0.2, 3e38), down.direction)).is_none_or(|h| h.t.is_finite())
    );
}

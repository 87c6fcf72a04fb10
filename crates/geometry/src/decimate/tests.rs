//! Quality and robustness on procedural meshes.

mod locked;
mod refit;
mod seams;
mod tiles;

use super::*;
use photofit_scalar::{Vec3f, vec2, vec3};

/// Octahedron subdivided `n` times per edge and pushed to the unit sphere: `8 n^2` triangles, every face split.
fn sphere(n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for face in 0..8 {
        let s = |b: u32| if face & b == 0 { 1.0_f32 } else { -1.0 };
        let corners: [Vec3f; 3] = [vec3(s(1), 0.0, 0.0), vec3(0.0, s(2), 0.0), vec3(0.0, 0.0, s(4))];
        let flip = s(1) * s(2) * s(4) < 0.0;
        let base = mesh.positions.len() as u32;
        for i in 0..=n {
            for j in 0..=n - i {
                let (a, b) = (i as f32 / n as f32, j as f32 / n as f32);
                let p = corners[0] * (1.0 - a - b) + corners[1] * a + corners[2] * b;
                mesh.positions.push(p.normalize_or_zero());
            }
        }
        let row = |i: u32| base + i * (n + 1) - i * i.saturating_sub(1) / 2;
        let at = |i: u32, j: u32| row(i) + j;
        for i in 0..n {
            for j in 0..n - i {
                let mut push = |t: [u32; 3]| mesh.triangles.push(if flip { [t[0], t[2], t[1]] } else { t });
                push([at(i, j), at(i + 1, j), at(i, j + 1)]);
                if j + 1 < n - i {
                    push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
    }
    mesh
}

/// Grid of `n x n` cells over the unit square with heights `f` and uvs equal to (x, y).
fn grid(n: u32, f: impl Fn(f32, f32) -> f32) -> Mesh {
    let mut mesh = Mesh::default();
    for j in 0..=n {
        for i in 0..=n {
            let (x, y) = (i as f32 / n as f32, j as f32 / n as f32);
            mesh.positions.push(vec3(x, y, f(x, y)));
            mesh.uvs.push(vec2(x, y));
        }
    }
    for j in 0..n {
        for i in 0..n {
            let k = j * (n + 1) + i;
            mesh.triangles.push([k, k + 1, k + n + 2]);
            mesh.triangles.push([k, k + n + 2, k + n + 1]);
        }
    }
    mesh
}

/// Appends `other`, scaled and moved.
fn append(mesh: &mut Mesh, other: &Mesh, scale: Vec3f, shift: Vec3f) {
    let base = mesh.positions.len() as u32;
    mesh.positions.extend(other.positions.iter().map(|&p| p.mul(scale) + shift));
    mesh.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + base)));
}

/// Closed tube of `sides` and `rings` along x from 0 to `length`.
fn tube(sides: u32, rings: u32, radius: f32, length: f32) -> Mesh {
    let mut mesh = Mesh::default();
    for r in 0..=rings {
        for s in 0..sides {
            let a = s as f32 / sides as f32 * std::f32::consts::TAU;
            mesh.positions.push(vec3(length * r as f32 / rings as f32, radius * a.cos(), radius * a.sin()));
        }
    }
    for r in 0..rings {
        for s in 0..sides {
            let (a, b) = (r * sides + s, r * sides + (s + 1) % sides);
            mesh.triangles.push([a, b, b + sides]);
            mesh.triangles.push([a, b + sides, a + sides]);
        }
    }
    for s in 1..sides - 1 {
        let e = rings * sides;
        mesh.triangles.push([0, s + 1, s]);
        mesh.triangles.push([e, e + s, e + s + 1]);
    }
    mesh
}

fn volume(mesh: &Mesh) -> f64 {
    (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t).map(|p| p.cast::<f64>());
            a.dot(b.cross(c)) / 6.0
        })
        .sum()
}

fn area(mesh: &Mesh) -> f64 {
    (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t).map(|p| p.cast::<f64>());
            0.5 * (b - a).cross(c - a).length()
        })
        .sum()
}

/// Decimates to a count and checks what must hold for every result.
fn to(mesh: &Mesh, n: usize, change: impl Fn(&mut Options)) -> Decimated {
    let mut options = Options::new(Target::Triangles(n));
    change(&mut options);
    let d = decimate(mesh, &[], &[], &options).expect("valid mesh");
    let out = &d.mesh;
    assert!(out.triangles.len() <= n && !out.triangles.is_empty(), "{} of {n}", out.triangles.len());
    assert_eq!(d.group.len(), out.triangles.len());
    assert_eq!(d.source.len(), out.triangles.len());
    assert!(out.positions.iter().all(|p| p.is_finite()));
    let mut used = vec![false; out.positions.len()];
    for t in &out.triangles {
        assert!(t[0] != t[1] && t[1] != t[2] && t[2] != t[0], "{t:?}");
        t.iter().for_each(|&i| used[i as usize] = true);
    }
    assert!(used.iter().all(|u| *u), "unused vertices");
    d
}

/// Edges with one, two and more faces.
fn edge_faces(mesh: &Mesh) -> [usize; 3] {
    let mut edges: Vec<_> = mesh
        .triangles
        .iter()
        .flat_map(|t| (0..3).map(|k| (t[k].min(t[(k + 1) % 3]), t[k].max(t[(k + 1) % 3]))))
        .collect();
    edges.sort_unstable();
    let mut count = [0; 3];
    for run in edges.chunk_by(|a, b| a == b) {
        count[(run.len() - 1).min(2)] += 1;
    }
    count
}

#[test]
fn sphere_keeps_radius_volume_and_manifold() {
    let mesh = sphere(50);
    assert_eq!(mesh.triangles.len(), 20_000);
    let d = to(&mesh, 500, |_| {});
    assert!(d.mesh.triangles.len() >= 498, "{}", d.mesh.triangles.len());
    assert_eq!(edge_faces(&d.mesh), [0, 750, 0]);
    // 500 even triangles on a unit sphere sag by 0.0101 between vertices; a good fit spreads that over both sides.
    let mut worst = 0.0_f32;
    for t in 0..d.mesh.triangles.len() {
        let [a, b, c] = d.mesh.corners(t);
        for p in [a, b, c, (a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5, (a + b + c) / 3.0] {
            worst = worst.max((p.length() - 1.0).abs());
        }
    }
    assert!(worst < 0.0135, "radial error {worst}");
    let v = volume(&d.mesh) / volume(&mesh);
    assert!((v - 1.0).abs() < 0.003, "volume ratio {v}");
    assert!(d.relative_error > 0.0 && d.relative_error < 0.01, "{}", d.relative_error);
    assert!((d.error / d.relative_error - 12.0_f64.sqrt()).abs() < 1e-3, "diagonal of the cube around it");
}

#[test]
fn seamed_cube_is_exact_at_twelve_triangles() {
    // Six separate faces, each with its own vertices.
    let mut mesh = Mesh::default();
    let face = grid(8, |_, _| 0.0);
    for axis in 0..3 {
        for side in 0..2 {
            let base = mesh.positions.len() as u32;
            for p in &face.positions {
                let (x, y) = if side == 0 { (p.y, p.x) } else { (p.x, p.y) };
                let mut q = [0.0; 3];
                (q[axis], q[(axis + 1) % 3], q[(axis + 2) % 3]) = (side as f32, x, y);
                mesh.positions.push(Vec3f::from_array(q));
            }
            mesh.triangles.extend(face.triangles.iter().map(|t| t.map(|i| i + base)));
        }
    }
    assert!((volume(&mesh) - 1.0).abs() < 1e-6, "the input is closed and faces outwards");
    let d = to(&mesh, 12, |_| {});
    assert_eq!(d.mesh.positions.len(), 8);
    assert!(
        d.mesh.positions.iter().all(|p| p.to_array().iter().all(|x| *x == 0.0 || *x == 1.0)),
        "{:?}",
        d.mesh
    );
    assert!((volume(&d.mesh) - 1.0).abs() < 1e-6);
    assert!((area(&d.mesh) - 6.0).abs() < 1e-6);
    assert!(d.relative_error < 1e-3);
}

#[test]
fn open_borders_hold() {
    let mesh = grid(30, |x, y| 0.1 * (6.0 * x).sin() * (5.0 * y).cos());
    let d = to(&mesh, 400, |o| o.keep_border = true);
    let border = |m: &Mesh| {
        let mut b: Vec<_> = m
            .positions
            .iter()
            .filter(|p| p.x == 0.0 || p.x == 1.0 || p.y == 0.0 || p.y == 1.0)
            .map(|p| p.to_array().map(f32::to_bits))
            .collect();
        b.sort_unstable();
        b
    };
    assert_eq!(border(&d.mesh), border(&mesh), "every border vertex, bit by bit");
    // A flat grid needs two triangles, and free borders reach them at the corners.
    let flat = to(&grid(20, |_, _| 0.0), 2, |_| {});
    assert_eq!(flat.mesh.triangles.len(), 2);
    assert!((area(&flat.mesh) - 1.0).abs() < 1e-5, "{:?}", flat.mesh);
    // The budget wins over the border.
    let few = to(&mesh, 20, |o| o.keep_border = true);
    assert!(few.mesh.triangles.len() >= 16, "{}", few.mesh.triangles.len());
    assert!(area(&few.mesh) > 0.95);
}

#[test]
fn nearly_equal_positions_are_one() {
    let mut mesh = Mesh::default();
    let half = grid(10, |_, _| 0.0);
    append(&mut mesh, &half, vec3(1.0, 1.0, 1.0), vec3(0.0, 0.0, 0.0));
    append(&mut mesh, &half, vec3(1.0, 1.0, 1.0), vec3(1.0, 4e-7, -3e-7));
    let d = to(&mesh, 400, |_| {});
    assert_eq!((d.stats.welded_vertices, d.stats.components), (231, 1));
    let exact = to(&mesh, 400, |o| o.merge_tolerance = 0.0);
    assert_eq!((exact.stats.welded_vertices, exact.stats.components), (242, 2));
    let flat = to(&mesh, 2, |_| {});
    assert!((area(&flat.mesh) - 2.0).abs() < 1e-4, "one rectangle of two squares");
}

#[test]
fn groups_stay_apart() {
    let mesh = grid(24, |_, _| 0.0);
    let centre = |t: usize| (mesh.corners(t)[0] + mesh.corners(t)[1] + mesh.corners(t)[2]) / 3.0;
    let group: Vec<u32> = (0..mesh.triangles.len()).map(|t| u32::from(centre(t).x > 0.5) * 7).collect();
    let d = decimate(&mesh, &group, &[], &Options::new(Target::Triangles(8))).expect("valid");
    let mut areas = [0.0; 2];
    for (t, &g) in d.group.iter().enumerate() {
        let [a, b, c] = d.mesh.corners(t);
        areas[usize::from(g == 7)] += 0.5 * (b - a).cross(c - a).length();
        assert!(
            [a, b, c].iter().all(|p| if g == 7 { p.x > 0.499 } else { p.x < 0.501 }),
            "triangle {t} crosses"
        );
    }
    assert!(areas.iter().all(|a| (a - 0.5).abs() < 1e-4), "{areas:?}");
}

#[test]
fn uv_seams_are_carried() {
    // Two charts with different uvs along x = 0.5; uv is linear in each, so it must stay exact.
    let left = grid(16, |x, y| 0.05 * (4.0 * x + 3.0 * y).sin());
    let mut mesh = Mesh::default();
    append(&mut mesh, &left, vec3(0.5, 1.0, 0.0), vec3(0.0, 0.0, 0.0));
    append(&mut mesh, &left, vec3(0.5, 1.0, 0.0), vec3(0.5, 0.0, 0.0));
    let half = left.positions.len();
    mesh.uvs = mesh
        .positions
        .iter()
        .enumerate()
        .map(|(i, p)| if i < half { vec2(p.x * 0.8, p.y * 0.9) } else { vec2(1.0 - p.y * 0.4, p.x * 0.7) })
        .collect();
    mesh.normals = vec![vec3(0.0, 0.0, 1.0); mesh.positions.len()];
    let d = to(&mesh, 40, |o| o.keep_uvs = true);
    let out = &d.mesh;
    assert_eq!((out.uvs.len(), out.normals.len()), (out.positions.len(), out.positions.len()));
    for t in &out.triangles {
        let on_left = t.iter().map(|&i| out.positions[i as usize].x).sum::<f32>() < 1.5;
        for &i in t {
            let (p, uv) = (out.positions[i as usize], out.uvs[i as usize]);
            let want = if on_left { vec2(p.x * 0.8, p.y * 0.9) } else { vec2(1.0 - p.y * 0.4, p.x * 0.7) };
            assert!((uv - want).length() < 2e-3, "{p:?}: {uv:?}, expected {want:?}");
        }
    }
    assert!(out.normals.iter().all(|n| (n.z - 1.0).abs() < 1e-6));
    let free = to(&mesh, 40, |_| {});
    assert!(free.mesh.uvs.is_empty() && free.mesh.normals.is_empty());
}

#[test]
fn tubes_keep_length_and_width() {
    let mut mesh = Mesh::default();
    append(&mut mesh, &sphere(24), vec3(0.5, 0.5, 0.5), vec3(0.0, 0.0, 2.0));
    for k in 0..12 {
        append(&mut mesh, &tube(10, 40, 0.01, 4.0), vec3(1.0, 1.0, 1.0), vec3(-2.0, 0.2 * k as f32, 0.0));
    }
    let d = to(&mesh, 240, |_| {});
    let (part, count) = components(&d.mesh.triangles, d.mesh.positions.len());
    assert_eq!(count, 13, "every tube is there");
    for c in 0..count as u32 {
        let of = |t: usize| part[t] == c;
        let ends: Vec<Vec3f> = (0..part.len())
            .filter(|&t| of(t))
            .flat_map(|t| d.mesh.corners(t))
            .filter(|p| p.z < 1.0)
            .collect();
        if ends.is_empty() {
            continue;
        }
        let lo = ends.iter().fold(f32::MAX, |a, p| a.min(p.x));
        let hi = ends.iter().fold(f32::MIN, |a, p| a.max(p.x));
        assert!(lo < -1.98 && hi > 1.98, "tube {c} from {lo} to {hi}");
        let surface: f64 = (0..part.len())
            .filter(|&t| of(t))
            .map(|t| {
                let [a, b, c] = d.mesh.corners(t);
                f64::from(0.5 * (b - a).cross(c - a).length())
            })
            .sum();
        let share = surface / (std::f64::consts::TAU * 0.01 * 4.0);
        assert!((0.4..1.3).contains(&share), "surface of tube {c}: {share}");
    }
}

#[test]
fn many_parts_reach_the_budget_by_dropping_the_small() {
    let mut mesh = Mesh::default();
    let ball = sphere(3);
    for k in 0..300 {
        let s = 0.02 + 0.2 * (k as f32 / 300.0).powi(4);
        append(&mut mesh, &ball, vec3(s, s, s), vec3((k % 20) as f32, (k / 20) as f32, 0.0));
    }
    for n in [2000, 500, 7, 1] {
        let d = to(&mesh, n, |_| {});
        assert!(d.mesh.triangles.len() * 10 >= n * 7, "{} of {n}", d.mesh.triangles.len());
        if n == 500 {
            assert!(d.stats.removed_components > 100, "{:?}", d.stats);
            let far = d.mesh.positions.iter().any(|p| (*p - vec3(19.0, 14.0, 0.0)).length() < 0.3);
            assert!(far, "the largest part stays");
        }
    }
}

#[test]
fn importance_steers_and_unseen_triangles_go_first() {
    let mesh = grid(40, |x, y| 0.05 * (20.0 * x).sin() * (20.0 * y).sin());
    let centre = |m: &Mesh, t: usize| (m.corners(t)[0] + m.corners(t)[1] + m.corners(t)[2]) / 3.0;
    let weight = |w: f32| -> Vec<f32> {
        (0..mesh.triangles.len()).map(|t| if centre(&mesh, t).x < 0.5 { w } else { 1.0 }).collect()
    };
    let left = |d: &Decimated| (0..d.group.len()).filter(|&t| centre(&d.mesh, t).x < 0.5).count();
    let o = Options::new(Target::Triangles(400));
    let even = decimate(&mesh, &[], &weight(1.0), &o).expect("valid");
    let low = decimate(&mesh, &[], &weight(0.01), &o).expect("valid");
    let none = decimate(&mesh, &[], &weight(0.0), &o).expect("valid");
    assert!((150..250).contains(&left(&even)), "{}", left(&even));
    assert!(left(&low) < left(&even) * 2 / 3, "{} against {}", left(&low), left(&even));
    assert!(left(&none) < 60, "{}", left(&none));
    assert!(none.stats.unseen > 1000, "{:?}", none.stats);
}

#[test]
fn large_offsets_and_small_scales_change_nothing() {
    let mesh = sphere(20);
    let plain = to(&mesh, 300, |_| {});
    let mut tiny = mesh.clone();
    tiny.positions.iter_mut().for_each(|p| *p *= 1e-6);
    let d = to(&tiny, 300, |_| {});
    let v = volume(&d.mesh) * 1e18 / volume(&plain.mesh);
    assert!((v - 1.0).abs() < 1e-3, "{v}");
    let mut far = mesh;
    far.positions.iter_mut().for_each(|p| *p = *p * 1000.0 + vec3(1e6, -1e6, 1e6));
    let d = to(&far, 300, |_| {});
    let mut back = d.mesh;
    back.positions.iter_mut().for_each(|p| *p = (*p - vec3(1e6, -1e6, 1e6)) * 1e-3);
    let v = volume(&back) / volume(&plain.mesh);
    assert!((v - 1.0).abs() < 5e-3, "{v}");
}

#[test]
fn broken_meshes_are_handled() {
    let mut fan = Mesh::default();
    // Forty half planes around one edge, each a strip of cells.
    for k in 0..40 {
        let a = k as f32 / 40.0 * std::f32::consts::TAU;
        let base = fan.positions.len() as u32;
        for r in 0..4 {
            for z in 0..4 {
                fan.positions.push(vec3(r as f32 * a.cos(), r as f32 * a.sin(), z as f32));
            }
        }
        for r in 0..3 {
            for z in 0..3 {
                let i = base + r * 4 + z;
                fan.triangles.push([i, i + 1, i + 5]);
                fan.triangles.push([i, i + 5, i + 4]);
            }
        }
    }
    let mut slivers = Mesh::default();
    for i in 0..500_u32 {
        slivers.positions.push(vec3(i as f32 * 0.01, if i % 2 == 0 { 0.0 } else { 1e-7 }, 0.0));
        if i >= 2 {
            slivers.triangles.push([i - 2, i - 1, i]);
        }
    }
    let mut doubled = sphere(10);
    let copy: Vec<_> = doubled.triangles.clone();
    doubled.triangles.extend(copy.iter().map(|t| [t[1], t[2], t[0]]));
    doubled.triangles.extend(copy.iter().map(|t| [t[1], t[0], t[2]]));
    doubled.triangles.push([0, 0, 1]);
    let mut star = Mesh { positions: vec![vec3(0.0, 0.0, 0.0)], ..Mesh::default() };
    for i in 1..=300_u32 {
        let a = i as f32 * 0.0209;
        star.positions.push(vec3(a.cos(), a.sin(), (i % 7) as f32 * 0.1));
        star.triangles.push([0, i, i % 300 + 1]);
    }
    for (name, mesh) in [("fan", &fan), ("slivers", &slivers), ("doubled", &doubled), ("star", &star)] {
        for n in [200, 20, 1] {
            for keep_uvs in [false, true] {
                let mut m = mesh.clone();
                m.uvs = m.positions.iter().map(|p| vec2(p.x, p.y)).collect();
                let d = to(&m, n, |o| o.keep_uvs = keep_uvs);
                assert!(n < 20 || d.mesh.triangles.len() * 2 >= n, "{name} {n}: {}", d.mesh.triangles.len());
            }
        }
    }
    let d = to(&doubled, 10_000, |o| o.double_sided = vec![true]);
    assert_eq!(d.mesh.triangles.len(), 800);
    assert_eq!(d.stats.cleaned, 1601);
}

#[test]
fn huge_fans_take_linear_time() {
    let mut star = Mesh { positions: vec![vec3(0.0, 0.0, 0.0)], ..Mesh::default() };
    let n = 30_000;
    for i in 1..=n {
        let a = i as f32 / n as f32 * std::f32::consts::TAU;
        star.positions.push(vec3(a.cos(), a.sin(), 0.0));
        star.triangles.push([0, i, i % n + 1]);
    }
    star.uvs = star.positions.iter().map(|p| vec2(p.x, p.y)).collect();
    // Quadratic time would be minutes.
    let d = to(&star, 500, |_| {});
    assert!((area(&d.mesh) - std::f64::consts::PI).abs() < 0.2, "{}", area(&d.mesh));
    to(&star, 500, |o| o.keep_uvs = true);
}

#[test]
fn enough_budget_returns_the_welded_input() {
    let mesh = sphere(6);
    let d = to(&mesh, mesh.triangles.len(), |_| {});
    assert_eq!(d.mesh.triangles.len(), mesh.triangles.len());
    assert_eq!(d.mesh.positions.len(), mesh.triangles.len() / 2 + 2, "Euler: a closed sphere");
    for t in 0..mesh.triangles.len() {
        let (a, b) = (d.mesh.corners(t), mesh.corners(d.source[t] as usize));
        assert!((0..3).all(|k| (a[k] - b[k]).length() < 1e-6), "triangle {t}");
    }
    assert_eq!((d.error, d.stats.collapses), (0.0, 0));
}

#[test]
fn error_and_screen_targets_stop_early() {
    let mesh = sphere(24);
    let run = |t| decimate(&mesh, &[], &[], &Options::new(t)).expect("valid");
    let (coarse, fine) = (run(Target::Error(5e-3)), run(Target::Error(5e-4)));
    assert!(coarse.relative_error <= 5e-3 && fine.relative_error <= 5e-4);
    assert!(coarse.mesh.triangles.len() * 4 < fine.mesh.triangles.len(), "error of order h^2");
    assert!(fine.mesh.triangles.len() < mesh.triangles.len() / 2);
    assert_eq!(run(Target::ScreenSize(0.5 / 5e-3)).mesh, coarse.mesh);
    assert!(run(Target::Ratio(0.1)).mesh.triangles.len().abs_diff(460) <= 2);
}

#[test]
fn same_input_same_bits() {
    let mesh = sphere(16);
    let a = to(&mesh, 111, |_| {});
    assert_eq!(a, to(&mesh, 111, |_| {}));
}

#[test]
fn bad_input_is_refused() {
    let mesh = sphere(2);
    let with = |change: &dyn Fn(&mut Mesh, &mut Options)| {
        let (mut m, mut o) = (mesh.clone(), Options::new(Target::Triangles(4)));
        change(&mut m, &mut o);
        decimate(&m, &[], &[], &o)
    };
    assert_eq!(with(&|_, o| o.target = Target::Triangles(0)), Err(DecimateError::ZeroBudget));
    assert_eq!(with(&|_, o| o.target = Target::Ratio(1.5)), Err(DecimateError::Option("target")));
    assert_eq!(with(&|_, o| o.target = Target::ScreenSize(f64::NAN)), Err(DecimateError::Option("target")));
    assert_eq!(with(&|_, o| o.area_weight = f64::NAN), Err(DecimateError::Option("area_weight")));
    assert_eq!(with(&|m, _| m.positions[3].y = f32::NAN), Err(DecimateError::Position(3)));
    assert_eq!(with(&|m, _| m.triangles.clear()), Err(DecimateError::Empty));
    assert_eq!(with(&|m, _| m.positions.fill(vec3(1.0, 2.0, 3.0))), Err(DecimateError::Empty));
    assert!(matches!(with(&|m, _| m.triangles[1][2] = 999), Err(DecimateError::Index { triangle: 1, .. })));
    assert!(matches!(
        with(&|m, _| m.uvs.push(vec2(0.0, 0.0))),
        Err(DecimateError::Length { name: "uvs", .. })
    ));
    let weights = vec![-1.0; mesh.triangles.len()];
    let o = Options::new(Target::Triangles(4));
    assert_eq!(decimate(&mesh, &[], &weights, &o), Err(DecimateError::Importance(0)));
    assert!(matches!(decimate(&mesh, &[1], &[], &o), Err(DecimateError::Length { name: "group", .. })));
}

#[test]
fn reports_rise_and_can_stop_the_work() {
    use std::cell::{Cell, RefCell};
    use std::ops::ControlFlow;
    let mesh = sphere(40);
    let options = Options::new(Target::Triangles(200));
    let shares = RefCell::new(Vec::new());
    let hear = |share: f32| {
        shares.borrow_mut().push(share);
        ControlFlow::Continue(())
    };
    let whole = decimate_reporting(&mesh, &[], &[], &options, &hear).unwrap();
    assert_eq!(whole, decimate(&mesh, &[], &[], &options).unwrap());
    let shares = shares.into_inner();
    assert!(
        shares.is_sorted() && shares[0] == 0.0 && (0.9..=1.0).contains(shares.last().unwrap()),
        "{shares:?}"
    );

    // Within the collapses, and within the refinement.
    for after in [1, shares.len() - 2] {
        let heard = Cell::new(0);
        let stop = |_| {
            heard.set(heard.get() + 1);
            if heard.get() > after { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        assert_eq!(decimate_reporting(&mesh, &[], &[], &options, &stop), Err(DecimateError::Stopped));
    }
}

/// Small components that are dropped as a whole take no more than the budget asks for.
#[test]
fn a_budget_is_used_up_by_many_parts() {
    // A collapse of a closed surface takes two triangles; of more parts than the budget has room for, tetrahedra go whole.
    for (parts, frequency, short) in [(10, 1, 1), (12, 4, 1), (40, 2, 3)] {
        let mut mesh = Mesh::default();
        for i in 0..parts {
            let size = Vec3f::splat(0.3 + 0.05 * i as f32);
            append(&mut mesh, &sphere(frequency), size, vec3(3.0 * i as f32, 0.0, 0.0));
        }
        for budget in 60..80 {
            let left = to(&mesh, budget, |_| {}).mesh.triangles.len();
            assert!(left <= budget && left + short >= budget, "{parts} parts: {left} of {budget}");
        }
    }
}

//! Tests of this operation: known values, gradients, determinism.

use super::*;
use crate::{Guidance, Optimizer, Placement, SpatialFilter, Temporal};
use photofit_gradcheck::Uniform;

/// Edges of a triangulated torus of `a x b` vertices.
fn torus(a: u32, b: u32) -> (usize, Vec<[u32; 2]>) {
    let id = |i: u32, j: u32| (i % a) * b + j % b;
    let around = |i, j| [[id(i, j), id(i + 1, j)], [id(i, j), id(i, j + 1)], [id(i, j), id(i + 1, j + 1)]];
    ((a * b) as usize, (0..a).flat_map(|i| (0..b).flat_map(move |j| around(i, j))).collect())
}

fn worst(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn solving_undoes_multiplying() {
    let (n, edges) = torus(40, 25);
    for lambda in [0.0, 1.0, 19.0, 1e4] {
        let m = LargeSteps::new(n, &edges, lambda).unwrap();
        let b = Uniform::new(1).vec(3 * n, -1.0, 1.0);
        let residual = worst(&m.to_u(&m.to_x(&b).unwrap()).unwrap(), &b);
        assert!(residual < 1e-9, "lambda {lambda}: {residual}");
        let b32: Vec<f32> = b.iter().map(|b| *b as f32).collect();
        let x = m.to_x(&b32).unwrap();
        let residual = worst(&m.to_u(&x.iter().map(|x| f64::from(*x)).collect::<Vec<_>>()).unwrap(), &b);
        assert!(residual < 1e-6 * (1.0 + 12.0 * lambda), "lambda {lambda} in f32: {residual}");
    }
}

#[test]
fn the_matrix_is_the_dense_one() {
    // A square with one diagonal, a repeated edge, a loop, and a vertex on its own.
    let m = LargeSteps::new(5, &[[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [2, 0], [3, 3]], 2.0).unwrap();
    let degrees = [3.0, 2.0, 3.0, 2.0, 0.0];
    for j in 0..5 {
        let mut unit = vec![0.0; 15];
        unit[3 * j] = 1.0;
        let column = m.to_u(&unit).unwrap();
        assert_eq!(column[3 * j], 1.0 + 2.0 * degrees[j], "diagonal {j}");
        let apart = |i: usize| i != j && (i == 4 || j == 4 || [i.min(j), i.max(j)] == [1, 3]);
        for i in (0..5).filter(|&i| i != j) {
            assert_eq!(column[3 * i], if apart(i) { 0.0 } else { -2.0 }, "entry {i} {j}");
        }
    }
}

/// 50 steps of a nonlinear fit, in u and as filters in x, against the textbook written out.
#[test]
fn the_forms_in_u_and_in_x_agree() {
    let (n, edges) = torus(12, 9);
    let m = LargeSteps::new(n, &edges, 19.0).unwrap();
    let mut rng = Uniform::new(6);
    let (start, target) = (rng.vec(3 * n, -1.0, 1.0), rng.vec(3 * n, -1.0, 1.0));
    let gradient =
        |x: &[f64]| -> Vec<f64> { x.iter().zip(&target).map(|(x, t)| (x - t).powi(3) + x.sin()).collect() };
    let optimizer = || Optimizer::new("x", 3 * n, Temporal::uniform_adam()).unwrap();
    let mut in_u = optimizer().with_filter(Placement::VARIABLE, m.clone()).unwrap();
    let mut in_x = optimizer()
        .with_filter(Placement::PRE, m.clone())
        .unwrap()
        .with_filter(Placement::FIRST, m.clone())
        .unwrap();
    let (mut a, mut b, mut u) = (start.clone(), start.clone(), m.to_u(&start).unwrap());
    let (mut first, mut second) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
    for t in 1..=50 {
        let g = gradient(&a);
        in_u.step(&mut a, &g, 0.05).unwrap();
        let g = gradient(&b);
        in_x.step(&mut b, &g, 0.05).unwrap();
        let g = m.to_x(&gradient(&m.to_x(&u).unwrap())).unwrap();
        for i in 0..3 * n {
            first[i] = 0.9 * first[i] + 0.1 * g[i];
            second[i] = 0.999 * second[i] + 0.001 * g[i] * g[i];
        }
        let largest = second.iter().fold(0.0_f64, |a, b| a.max(*b)) / (1.0 - 0.999_f64.powi(t));
        for i in 0..3 * n {
            u[i] -= 0.05 * first[i] / (1.0 - 0.9_f64.powi(t)) / largest.sqrt();
        }
    }
    assert!(worst(&a, &b) < 1e-12, "u against x: {:e}", worst(&a, &b));
    let textbook = worst(&m.to_x(&u).unwrap(), &a);
    assert!(textbook < 1e-12, "textbook: {textbook:e}");
    assert!(worst(&a, &start) > 0.05, "the fit moved");
}

#[test]
fn the_bound_survives_the_filter() {
    // |M^-1 m| <= C sqrt(M^-1 v): the rows of M^-1 are non-negative and sum to one.
    let (n, edges) = torus(10, 8);
    let m = LargeSteps::new(n, &edges, 5.0).unwrap();
    for b1 in [0.0, 0.2, 0.5, 0.9_f64] {
        let bound = ((2.0 - b1) / (2.0 * (1.0 - b1))).sqrt();
        let b2 = 1.0 - (1.0 - b1) * (1.0 - b1);
        let mut rng = Uniform::new(12);
        let (mut first, mut second) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
        for step in 0..30 {
            for i in 0..3 * n {
                let g = rng.range(-1.0, 1.5).powi(3);
                first[i] = b1 * first[i] + (1.0 - b1) * g;
                second[i] = b2 * second[i] + (1.0 - b2) * g * g;
            }
            let (f, s) = (m.to_x(&first).unwrap(), m.to_x(&second).unwrap());
            let ratio = f.iter().zip(&s).map(|(f, s)| f.abs() / s.sqrt()).fold(0.0, f64::max);
            assert!(ratio <= bound * (1.0 + 1e-9), "b1 {b1} step {step}: {ratio} above {bound}");
        }
    }
}

#[test]
fn bad_input_is_refused() {
    let error = LargeSteps::new(2, &[[0, 1], [1, 2]], 1.0).unwrap_err();
    assert_eq!(error.to_string(), "edge 1 names vertex 2, but there are 2 vertices");
    assert!(LargeSteps::new(2, &[], f64::NAN).is_err());
    assert!(LargeSteps::new(2, &[], 1.0).unwrap().to_x(&[1.0_f32]).is_err());
    assert_eq!(LargeSteps::new(0, &[], 1.0).unwrap().to_x::<f32>(&[]).unwrap(), []);
}

#[test]
fn threads_do_not_change_a_bit() {
    let (n, edges) = torus(50, 40);
    let b = Uniform::new(1).vec(3 * n, -1.0, 1.0);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let m = LargeSteps::new(n, &edges, 19.0).unwrap();
            (m.to_x(&b).unwrap(), m.to_u(&b).unwrap())
        })
    };
    assert_eq!(run(1), run(4));
}

#[test]
#[ignore = "measurement"]
fn time_of_a_hundred_thousand_vertices() {
    let (n, edges) = torus(400, 250);
    let b: Vec<f32> = Uniform::new(1).vec(3 * n, -1.0, 1.0).iter().map(|b| *b as f32).collect();
    for _ in 0..3 {
        let start = std::time::Instant::now();
        let m = LargeSteps::new(n, &edges, 19.0).unwrap();
        let made = start.elapsed();
        let x = m.to_x(&b).unwrap();
        let solved = start.elapsed() - made;
        let mega = m.factor_bytes() as f64 / 1e6;
        println!("{} vertices: factor {made:?}, solve {solved:?}, {mega:.0} MB", x.len() / 3);
    }
}

/// What a filter sees of a step at unit rate.
fn guided<'a>(params: &'a [f64], guide: &'a [f64]) -> Guidance<'a, f64> {
    Guidance { group: "positions", params, grads: params, rate: 1.0, guide }
}

fn filtered(filter: &mut dyn SpatialFilter<f64>, field: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; field.len()];
    filter.apply(&[field], &mut [&mut out]);
    out
}

/// Normals of a torus whose tube is a square: four directions, in turn along the second index.
fn square_tube(a: u32, b: u32) -> Vec<f64> {
    let side =
        |j: u32| [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]][(4 * j / b) as usize];
    (0..a).flat_map(|_| (0..b).flat_map(side)).collect()
}

#[test]
fn edge_aware_weights_are_an_average_that_stops_at_creases() {
    let (a, b) = (12, 16);
    let (n, edges) = torus(a, b);
    let normals = square_tube(a, b);
    let mut filter = EdgeAware::new(n, &edges, 30.0, 0.1).unwrap();
    SpatialFilter::<f64>::prepare(&mut filter, &guided(&[], &normals)).unwrap();
    let mut plain = LargeSteps::new(n, &edges, 30.0).unwrap();
    let ones = filtered(&mut filter, &vec![1.0; n]);
    assert!(ones.iter().all(|x| (x - 1.0).abs() < 1e-12), "rows sum to one");
    let mut impulse = vec![0.0; n];
    impulse[(5 * b + 1) as usize] = 1.0;
    let (sharp, smooth) = (filtered(&mut filter, &impulse), filtered(&mut plain, &impulse));
    let outside = |x: &[f64]| (0..n).filter(|i| normals[3 * i + 2] < 0.5).map(|i| x[i]).sum::<f64>();
    assert!(sharp.iter().all(|x| *x >= 0.0));
    assert!(outside(&sharp) < 1e-3, "{}", outside(&sharp));
    assert!(outside(&smooth) > 0.3, "the comparison can fail: {}", outside(&smooth));
    // Equal normals: Large Steps.
    let flat = [0.0, 0.0, 1.0].repeat(n);
    SpatialFilter::<f64>::prepare(&mut filter, &guided(&[], &flat)).unwrap();
    assert!(worst(&filtered(&mut filter, &impulse), &smooth) < 1e-12);
}

/// Two vertices so strongly joined that only the normals part them: the range weight can be read off.
fn range_weight(angle: f64, samples: usize, turn: f64) -> f64 {
    let config = SampledNormalsConfig { lambda: 1e9, samples, ..SampledNormalsConfig::default() };
    let mut filter = SampledNormals::new(2, &[[0, 1]], config).unwrap();
    let (a, b) = (turn, turn + angle);
    let normals = [a.cos() * 0.6, a.sin(), a.cos() * 0.8, b.cos() * 0.6, b.sin(), b.cos() * 0.8];
    SpatialFilter::<f64>::prepare(&mut filter, &guided(&[], &normals)).unwrap();
    1.0 / filtered(&mut filter, &[1.0, 0.0])[0] - 1.0
}

#[test]
fn sampled_normals_have_the_closed_form_as_range_weight() {
    let closed = |angle: f64| {
        let (a, b) = (0.5, 0.4);
        let r = (1.0 / (a * a) + 1.0 / (b * b) + 2.0 * angle.cos() / (a * b)).sqrt();
        let largest = 1.0 / a + 1.0 / b;
        (r.sinh() / r) / (largest.sinh() / largest)
    };
    for (degrees, stated) in [(30.0_f64, 0.89), (90.0, 0.38), (180.0, 0.10)] {
        let angle = degrees.to_radians();
        assert!((closed(angle) - stated).abs() < 0.006, "{degrees}: {}", closed(angle));
        let many = range_weight(angle, 4000, 0.3);
        assert!((many / closed(angle) - 1.0).abs() < 0.01, "{degrees}: {many} against {}", closed(angle));
    }
    // 32 samples, turned over the lattice.
    let errors: Vec<f64> =
        (0..40).map(|k| range_weight(1.2, 32, 0.157 * f64::from(k)) / closed(1.2) - 1.0).collect();
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / 40.0).sqrt();
    assert!(rms < 0.12, "rms error {rms} of 32 samples");
}

#[test]
fn sampled_normals_average_and_survive_tiny_widths_and_degenerate_normals() {
    let (n, edges) = torus(9, 8);
    let mut normals = square_tube(9, 8);
    normals[..6].fill(0.0);
    for (splat, blend) in [(0.5, 0.4), (1e-2, 1e-2), (1e-9, 1e-9), (1e9, 1e9)] {
        let config = SampledNormalsConfig { sigma_splat: splat, sigma_blend: blend, ..Default::default() };
        let mut filter = SampledNormals::new(n, &edges, config).unwrap();
        SpatialFilter::<f64>::prepare(&mut filter, &guided(&[], &normals)).unwrap();
        let out = filtered(&mut filter, &vec![2.5; n * 5]);
        assert!(out.iter().all(|x| (x - 2.5).abs() < 1e-9), "widths {splat} {blend}");
        let field = Uniform::new(8).vec(n, 0.0, 1.0);
        let out = filtered(&mut filter, &field);
        assert!(out.iter().all(|x| (0.0..=1.0).contains(x)), "widths {splat} {blend}");
    }
}

/// Steps of a fit to noise, relative to the rate, by a filter on the second moment too.
#[test]
fn steps_stay_bounded_behind_every_mesh_filter() {
    // Two components, isolated vertices, degenerate normals.
    let (n, mut edges) = torus(8, 6);
    let (more, others) = torus(5, 5);
    edges.extend(others.iter().map(|e| e.map(|v| v + n as u32)));
    let n = n + more + 3;
    let mut rng = Uniform::new(4);
    let mut normals: Vec<f64> = rng.vec(3 * n, -1.0, 1.0);
    normals[30..60].fill(0.0);
    let bound = Temporal::adam().paired(0.5).bound();
    let exact = Temporal { relative_epsilon: 0.0, bias_correction: false, ..Temporal::adam() };
    for which in 0..3 {
        for temporal in [exact, Temporal { second: crate::SecondMoment::PerVector(3), ..exact }] {
            let optimizer = Optimizer::new("x", 3 * n, temporal.paired(0.5)).unwrap();
            let place = Placement::POST;
            let mut optimizer = match which {
                0 => optimizer.with_filter(place, LargeSteps::new(n, &edges, 19.0).unwrap()),
                1 => optimizer.with_filter(place, EdgeAware::new(n, &edges, 19.0, 0.4).unwrap()),
                _ => {
                    optimizer.with_filter(place, SampledNormals::new(n, &edges, Default::default()).unwrap())
                }
            }
            .unwrap();
            let mut x = vec![0.0; 3 * n];
            let mut longest = 0.0_f64;
            for t in 0..12 {
                let g: Vec<f64> =
                    (0..3 * n).map(|i| rng.range(-1.0, 1.5).powi(1 + ((i + t) % 7) as i32)).collect();
                let before = x.clone();
                optimizer.step_guided(&mut x, &g, 1.0, &normals).unwrap();
                longest = longest.max(worst(&x, &before));
            }
            assert!(longest <= bound * (1.0 + 1e-9), "filter {which}: {longest} above {bound}");
            assert!(longest > 0.5, "filter {which} moves");
        }
    }
}

#[test]
fn guiding_normals_are_checked() {
    let (n, edges) = torus(4, 4);
    let filter = EdgeAware::new(n, &edges, 1.0, 0.5).unwrap();
    let mut optimizer = Optimizer::new("hull", 3 * n, Temporal::uniform_adam())
        .unwrap()
        .with_filter(Placement::FIRST, filter)
        .unwrap();
    let (mut x, g) = (vec![0.0_f64; 3 * n], vec![1.0; 3 * n]);
    let error = optimizer.step(&mut x, &g, 0.1).unwrap_err();
    assert_eq!(error.to_string(), "guiding normals of `hull` has 0 entries, expected 48");
    let mut normals = vec![1.0; 3 * n];
    normals[7] = f64::NAN;
    assert!(optimizer.step_guided(&mut x, &g, 0.1, &normals).is_err());
    assert_eq!((optimizer.state().step, x[0]), (0, 0.0));
    assert!(EdgeAware::new(n, &edges, 1.0, 0.0).is_err());
    let none = SampledNormalsConfig { samples: 0, ..Default::default() };
    assert!(SampledNormals::new(n, &edges, none).is_err());
}

#[test]
fn a_mesh_without_edges_is_left_alone() {
    let m = LargeSteps::new(4, &[[2, 2]], 19.0).unwrap();
    let x = Uniform::new(3).vec(12, -1.0, 1.0);
    assert_eq!(m.to_x(&x).unwrap(), x);
    assert_eq!(m.to_u(&x).unwrap(), x);
    let mut filter = SampledNormals::new(4, &[], Default::default()).unwrap();
    SpatialFilter::<f64>::prepare(&mut filter, &guided(&[], &x)).unwrap();
    assert!(worst(&filtered(&mut filter, &x), &x) < 1e-12);
}

#[test]
fn solves_by_subtrees_are_exact_on_chains_trees_and_separate_parts() {
    let chain = |n: u32| (1..n).map(|i| [i - 1, i]).collect::<Vec<_>>();
    let star = |n: u32| (1..n).map(|i| [0, i]).collect::<Vec<_>>();
    let binary = |n: u32| (1..n).map(|i| [(i - 1) / 2, i]).collect::<Vec<_>>();
    let (grid_size, grid) = torus(70, 60);
    let mut parts = grid.clone();
    parts.extend(chain(900).iter().map(|e| e.map(|v| v + grid_size as u32)));
    for (name, n, edges) in [
        ("chain", 1000, chain(1000)),
        ("star", 500, star(500)),
        ("tree", 2000, binary(2000)),
        ("grid", grid_size, grid),
        ("parts", grid_size + 950, parts),
    ] {
        let m = LargeSteps::new(n, &edges, 19.0).unwrap();
        let x = Uniform::new(2).vec(3 * n, -1.0, 1.0);
        let off = worst(&m.to_x(&m.to_u(&x).unwrap()).unwrap(), &x);
        assert!(off < 1e-12, "{name}: {off:e}");
    }
}

//! Tests of this operation: known values, gradients, determinism.

use super::*;
use crate::{AdamConfig, Optimizer, UniformAdam};
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

/// 50 steps of a nonlinear fit, in u and as filters in x.
#[test]
fn the_forms_in_u_and_in_x_agree() {
    let (n, edges) = torus(12, 9);
    let m = LargeSteps::new(n, &edges, 19.0).unwrap();
    let mut rng = Uniform::new(6);
    let (start, target) = (rng.vec(3 * n, -1.0, 1.0), rng.vec(3 * n, -1.0, 1.0));
    let gradient =
        |x: &[f64]| -> Vec<f64> { x.iter().zip(&target).map(|(x, t)| (x - t).powi(3) + x.sin()).collect() };
    let config = AdamConfig::default();
    let mut in_u = UniformAdam::new("u", 3 * n, config).unwrap();
    let mut in_x = UniformAdam::new("x", 3 * n, config).unwrap();
    let mut u = m.to_u(&start).unwrap();
    let mut x = start.clone();
    for _ in 0..50 {
        let g = m.gradient(&gradient(&m.to_x(&u).unwrap())).unwrap();
        in_u.step(&mut u, &g, 0.05).unwrap();
        let g = m.gradient(&gradient(&x)).unwrap();
        let factor = in_x.accumulate(&g).unwrap().unwrap();
        let filtered = m.gradient(&in_x.state().m).unwrap();
        x.iter_mut().zip(&filtered).for_each(|(x, m)| *x -= 0.05 * factor * m);
    }
    let difference = worst(&m.to_x(&u).unwrap(), &x);
    assert!(difference < 1e-12, "{difference:e}");
    assert!(worst(&x, &start) > 0.05, "the fit moved");
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
            let (f, s) = (m.gradient(&first).unwrap(), m.gradient(&second).unwrap());
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

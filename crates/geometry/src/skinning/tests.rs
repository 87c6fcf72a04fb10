//! Tests of this operation: known values, gradients, what flattens.

use super::*;
use photofit_gradcheck::{Uniform, check};
use photofit_scalar::vec3;

fn affine(rng: &mut Uniform) -> Affine<f64> {
    let mut axes = Affine::identity().axes;
    axes.iter_mut()
        .for_each(|a| *a += vec3(rng.range(-0.4, 0.4), rng.range(-0.4, 0.4), rng.range(-0.4, 0.4)));
    Affine { axes, translation: vec3(rng.range(-2.0, 2.0), 0.3, -0.7) }
}

fn vectors(rng: &mut Uniform, count: usize) -> Vec<Vec3<f64>> {
    bytemuck::cast_slice(&rng.vec(3 * count, -1.0, 1.0)).to_vec()
}

/// With and without what each part of a deformation does; one map turns handedness around.
fn deformations(rng: &mut Uniform, count: usize) -> [Deformation<f64>; 4] {
    let mut moves: Vec<Affine<f64>> = (0..count).map(|_| affine(rng)).collect();
    moves[1].axes[0] = -moves[1].axes[0];
    let offsets =
        Deformation { positions: vectors(rng, count), normals: vectors(rng, count), moves: Vec::new() };
    let both = Deformation { moves: moves.clone(), ..offsets.clone() };
    [offsets, both, Deformation { moves, ..Deformation::default() }, Deformation::default()]
}

#[test]
fn vjp_agrees_with_central_differences() {
    let (mut rng, count) = (Uniform::new(3), 7);
    for (i, deformation) in deformations(&mut rng, count).iter().enumerate() {
        let seeds = vectors(&mut rng, count);
        let along = |v: &[Vec3<f64>]| v.iter().zip(&seeds).map(|(v, s)| v.dot(*s)).sum::<f64>();
        let (positions, normals) = (vectors(&mut rng, count), vectors(&mut rng, count));
        let mut g = vec![Vec3::zero(); count];
        deformation.positions_vjp(&seeds, &mut g);
        let flat = |v: &[Vec3<f64>]| -> Vec<f64> { bytemuck::cast_slice(v).to_vec() };
        check(&format!("positions of {i}"), &flat(&positions), &flat(&g), 1e-5, 1e-9, |x| {
            along(&deformation.positions(bytemuck::cast_slice(x)))
        });
        let mut g = vec![Vec3::zero(); count];
        deformation.normals_vjp(&normals, &seeds, &mut g);
        check(&format!("normals of {i}"), &flat(&normals), &flat(&g), 1e-5, 1e-8, |x| {
            along(&deformation.normals(bytemuck::cast_slice(x)))
        });
        let once = g.clone();
        deformation.normals_vjp(&normals, &seeds, &mut g);
        assert!(once.iter().zip(&g).all(|(a, b)| (*a * 2.0 - *b).length() < 1e-12), "adjoints accumulate");
    }
}

#[test]
fn normals_stay_normal_to_what_moves() {
    let mut rng = Uniform::new(5);
    for mirrored in [false, true] {
        let mut a = affine(&mut rng);
        if mirrored {
            a.axes[2] = -a.axes[2];
        }
        let (s, t) = (vec3(0.4, 0.9, -0.2), vec3(-0.7, 0.1, 0.6));
        let n = a.normals().apply(s.cross(t).normalize_or_zero());
        let [s, t] = [s, t].map(|d| a.direction(d));
        assert!(n.dot(s).abs() < 1e-12 && n.dot(t).abs() < 1e-12 && (n.length() - 1.0).abs() < 1e-12);
        // Triangles are turned around where handedness is.
        assert!((n.dot(s.cross(t)) > 0.0) != mirrored);
        assert_eq!(a.normals().mirrored, mirrored);
    }
}

#[test]
fn maps_are_taken_back() {
    let mut rng = Uniform::new(8);
    let (a, b) = (affine(&mut rng), affine(&mut rng));
    let p = vec3(0.3, -0.8, 2.0);
    let back = a.then(&b).inverse().unwrap();
    assert!((back.point(b.point(a.point(p))) - p).length() < 1e-12);
    let tiny = Affine { axes: a.axes.map(|x| x * 1e-20), translation: Vec3::zero() };
    assert!((tiny.inverse().unwrap().point(tiny.point(p)) - p).length() < 1e-12);
    let mut flat = a;
    flat.axes[1] = flat.axes[0] * 2.0 + flat.axes[2] * 1e-7;
    assert!(flat.inverse().is_none());
    flat.axes[1] = Vec3::splat(f64::NAN);
    assert!(flat.inverse().is_none());
}

#[test]
fn joints_are_averaged_and_targets_added() {
    let at = |x: f32| Affine { translation: vec3(x, 0.0, 0.0), ..Affine::identity() };
    let joints = [at(1.0), at(5.0)];
    let blended = |w: [f32; 2]| blend([(0, w[0]), (1, w[1])].into_iter(), &joints);
    assert_eq!(blended([0.5, 1.5]), at(4.0), "weights are divided by their sum");
    assert_eq!(blended([0.0; 2]), at(1.0), "without weights: the first joint");
    assert_eq!(blend([(9, 0.0)].into_iter(), &[]), Affine::identity());
    let target = [vec3(1.0, 0.0, 0.0), vec3(0.0, 2.0, 0.0)];
    let sum = morph(2, [(&target[..], 0.5), (&[][..], 1.0), (&target[..], 0.25)].into_iter());
    assert_eq!(sum, [vec3(0.75, 0.0, 0.0), vec3(0.0, 1.5, 0.0)]);
    assert!(morph(2, [(&target[..], 0.0)].into_iter()).is_empty());
}

#[test]
fn what_flattens_keeps_its_normals() {
    let flat = Affine { axes: [Vec3::zero(); 3], translation: vec3(1.0, 2.0, 3.0) };
    let up = vec3(0.0, 1.0, 0.0);
    let squashed = Deformation { moves: vec![flat], ..Deformation::default() };
    let away = Deformation { normals: vec![-up], ..Deformation::default() };
    for deformation in [squashed, away] {
        assert_eq!(deformation.normals(&[up]), [up]);
        let mut g = vec![Vec3::zero()];
        deformation.normals_vjp(&[up], &[vec3(1.0, 1.0, 1.0)], &mut g);
        assert_eq!(g, [Vec3::zero()]);
    }
}

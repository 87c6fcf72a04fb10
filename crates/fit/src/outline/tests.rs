//! Lengths of outlines that are known, and what hides them.

use super::*;
use crate::bake::tests::{World, moved};
use photofit_geometry::{Mesh, shapes};
use photofit_scalar::vec3;
use photofit_scene::Material;
use std::sync::Mutex;

/// Mean length of all contours of a body, of which those before the body itself count `inner`.
fn length(mesh: &Mesh, material: Material, inner: f32) -> f32 {
    let mut world = World::default();
    world.add(mesh, material);
    let settings = OutlineSettings { inner, ..OutlineSettings::default() };
    world.with(|r| outline(r, &settings)).iter().sum()
}

fn check(name: &str, is: f32, must: f32, within: f32) {
    assert!((is / must - 1.0).abs() < within, "{name}: {is}, not {must}");
}

#[test]
fn outlines_have_the_mean_perimeter_of_a_convex_body() {
    // Pi times the mean width: 1.5 of a unit cube, 2 of a unit sphere.
    let side = (shapes::cube().positions[0] - shapes::cube().positions[1]).length();
    check("cube", length(&shapes::cube(), Material::clay(), 0.0), 1.5 * PI * side, 0.01);
    check("sphere", length(&shapes::icosphere(16), Material::clay(), 0.0), TAU, 0.02);
    // The mean of sin over the sphere is pi / 4; from behind a single-sided sheet there is nothing.
    let sheet = shapes::quad_grid(4, 4);
    let border = {
        let (lo, hi) = sheet
            .positions
            .iter()
            .fold((sheet.positions[0], sheet.positions[0]), |(a, b), p| (a.min(*p), b.max(*p)));
        2.0 * ((hi.x - lo.x) + (hi.y - lo.y))
    };
    let both = Material { double_sided: true, ..Material::clay() };
    check("sheet", length(&sheet, both, 0.0), border * 0.25 * PI, 0.03);
    check("front", length(&sheet, Material::clay(), 0.0), border * 0.125 * PI, 0.05);
}

#[test]
fn what_is_hidden_shows_no_outline_and_what_lies_before_the_asset_counts_less() {
    let mut world = World::default();
    let (ball, inside) = (shapes::icosphere(8), moved(&shapes::cube(), 0.2, Vec3f::zero()));
    world.add(&ball, Material::clay()).add(&inside, Material::clay());
    let lengths = world.with(|r| outline(r, &OutlineSettings::default()));
    assert!(lengths[ball.triangles.len()..].iter().all(|l| *l == 0.0), "a cube within a ball");
    // The inner half of a ring is a contour before the ring alone.
    let ring = shapes::torus(64, 24, 1.0, 0.3);
    let [none, all] = [0.0, 1.0].map(|inner| length(&ring, Material::clay(), inner));
    assert!(all > 1.05 * none, "{none} before the background, {all} with those before the ring");
    let mut world = World::default();
    world.add(&ring, Material::clay());
    let lengths = world.with(|r| smoothed(r, &outline(r, &OutlineSettings::default()), 1));
    let mean = |outer: bool| {
        let at = |t: &usize| {
            let [a, b, c] = ring.corners(*t);
            let p = (a + b + c) * (1.0 / 3.0);
            let r = (p.x * p.x + p.y * p.y + p.z * p.z).sqrt();
            if outer { r > 1.25 } else { r < 0.75 }
        };
        let of: Vec<f32> = (0..lengths.len()).filter(at).map(|t| lengths[t]).collect();
        of.iter().sum::<f32>() / of.len() as f32
    };
    assert!(mean(true) > 1.3 * mean(false), "{} outside, {} inside", mean(true), mean(false));
}

#[test]
fn lengths_are_the_same_on_any_number_of_threads_and_can_be_stopped() {
    let mut world = World::default();
    let bumpy = shapes::displaced_sphere(16, 0.3, 4, 2);
    world.add(&bumpy, Material::clay());
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| world.with(|r| outline(r, &OutlineSettings::default())))
    };
    assert_eq!(on(1), on(5));
    let shares = Mutex::new(Vec::new());
    let heard = |share| {
        shares.lock().unwrap().push(share);
        ControlFlow::Continue(())
    };
    assert!(world.with(|r| outline_reporting(r, &OutlineSettings::default(), &heard)).is_some());
    let shares = shares.into_inner().unwrap();
    assert!(shares.len() > 3 && shares.iter().all(|s| (0.0..=1.0).contains(s)));
    let stop = |_| ControlFlow::Break(());
    assert!(world.with(|r| outline_reporting(r, &OutlineSettings::default(), &stop)).is_none());
    // Nothing without area or length is counted.
    let mut flat = bumpy.clone();
    flat.positions.iter_mut().for_each(|p| *p = vec3(p.x, 0.0, 0.0));
    assert!(length(&flat, Material::clay(), 1.0) == 0.0);
}

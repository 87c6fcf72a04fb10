//! Density and albedo of a cloud on a grid, from views around it.

use super::*;
use photofit_pathtrace::{LightSource, MediumRef, MediumValue, Volume};

/// The cube from -1 to 1.
fn unit_box() -> glam::DAffine3 {
    glam::DAffine3::from_translation(glam::DVec3::splat(-1.0))
        * glam::DAffine3::from_scale(glam::DVec3::splat(2.0))
}

/// Two puffs of different colour in `side` voxels per side.
fn puffs(side: usize) -> Volume {
    let at = |i: usize| (i as f32 + 0.5) / side as f32 * 2.0 - 1.0;
    let puff = |p: [f32; 3], center: [f32; 3], radius: f32| {
        let d: f32 = p.iter().zip(center).map(|(a, b)| (a - b) * (a - b)).sum();
        (1.5 - d / (radius * radius)).clamp(0.0, 1.0)
    };
    let (mut density, mut albedos) = (Vec::new(), Vec::new());
    for z in 0..side {
        for y in 0..side {
            for x in 0..side {
                let p = [at(x), at(y), at(z)];
                let (a, b) = (puff(p, [-0.3, 0.1, 0.2], 0.5), puff(p, [0.4, -0.2, -0.2], 0.4));
                density.push(4.0 * a + 3.0 * b);
                albedos.push(if a >= b { vec3(0.9, 0.6, 0.3) } else { vec3(0.3, 0.5, 0.9) });
            }
        }
    }
    let (size, scale, albedo) = ([side; 3], 1.0, Vec3f::splat(1.0));
    Volume { size, density, scale, albedo, albedos, g: 0.0, emission: None, transform: unit_box() }
}

/// The puffs in the sun before a sky of light and dark fields, seen from around.
fn clouds(side: usize, pixels: usize) -> Traced {
    // Light and dark behind the cloud tell density from albedo, which light from all around alone would not.
    let sky = Image::from_fn(8, 4, 3, |x, y, _| if (x + y) % 2 == 0 { 0.9 } else { 0.1 });
    let environment = Some(EnvironmentMap::new(sky));
    let sun = LightSource::Directional { direction: vec3(0.3, 1.0, 0.4), irradiance: Vec3f::splat(6.0) };
    let (volumes, lights) = (vec![puffs(side)], vec![sun]);
    let world = World::new(Parts { environment, volumes, lights, ..Parts::default() }).expect("valid");
    let of = |name: &str, value, channels, high| TracedParameter {
        name: name.into(),
        parameter: Parameter::Medium { medium: MediumRef::Volume(0), value },
        shape: [side, side, side, channels],
        range: [0.0, high],
    };
    let parameters =
        vec![of("density", MediumValue::Extinction, 1, 1e6), of("albedo", MediumValue::Albedo, 3, 1.0)];
    let mut options = RenderOptions { width: pixels, height: pixels, spp: 16, ..RenderOptions::default() };
    options.path.max_depth = 6;
    let mut model = Traced::new(world, options, parameters).expect("valid");
    (model.gradient_spp, model.evaluation_spp) = (4, 64);
    model
}

/// Views around the puffs.
fn views(count: usize) -> Vec<View> {
    let view = |k: usize| {
        let (turn, height) = (2.4 * k as f32, [0.8, -0.6, 0.1][k % 3]);
        let eye = glam::vec3(3.4 * turn.sin(), 1.8 * height, 3.4 * turn.cos());
        View::pinhole(&Camera::look_at(eye, Vec3::ZERO, Vec3::Y, 0.7, 1.0, 0.1, 20.0))
    };
    (0..count).map(view).collect()
}

/// Recovers the puffs from an even haze: errors of density and albedo (where there is density) before and after, and of
/// the picture that was held out.
fn recovered(mut model: Traced, count: usize, steps: u64) -> (RecoveredScene, [[f64; 2]; 3]) {
    let views = views(count);
    let targets: Vec<Image> = views.iter().map(|v| model.picture(v, 512, 99).expect("rendered")).collect();
    let truth = [model.of(0).to_vec(), model.of(1).to_vec()];
    let voxels = truth[0].len();
    model.replace(0, &vec![0.2; voxels]).expect("valid");
    model.replace(1, &vec![0.6; 3 * voxels]).expect("valid");
    let errors = |m: &Traced| {
        let dense: Vec<usize> = (0..3 * voxels).filter(|i| truth[0][i / 3] > 1.0).collect();
        let of = |v: &[f32]| dense.iter().map(|i| v[*i]).collect::<Vec<_>>();
        [rmse(m.of(0), &truth[0]), rmse(&of(m.of(1)), &of(&truth[1]))]
    };
    let before = errors(&model);
    let options = RecoverSceneOptions { steps, ..RecoverSceneOptions::default() };
    let r = recover_scene(model, &views, &targets, &options, &Silent).expect("fits");
    let after = errors(&r.model);
    let errors = r.history.iter().map(|h| relative_error(h.quality));
    let (first, best) = (relative_error(r.history[0].quality), errors.fold(f64::INFINITY, f64::min));
    println!(
        "density {:?}, albedo {:?}, picture {:?}",
        [before[0], after[0]],
        [before[1], after[1]],
        [first, best]
    );
    (r, [[before[0], after[0]], [before[1], after[1]], [first, best]])
}

#[test]
fn a_cloud_is_found_from_views_around_it() {
    let (r, [density, albedo, picture]) = recovered(clouds(8, 16), 6, 60);
    assert_eq!(r.held_out, Some(5));
    assert!(density[1] < 0.7 * density[0], "density {density:?}");
    assert!(albedo[1] < 0.8 * albedo[0], "albedo {albedo:?}");
    assert!(picture[1] < 0.12 * picture[0], "picture {picture:?}");
}

#[test]
#[ignore = "slow: more voxels, views and steps"]
fn a_finer_cloud_is_found() {
    let (_, [density, albedo, picture]) = recovered(clouds(16, 32), 12, 200);
    assert!(density[1] < 0.55 * density[0], "density {density:?}");
    assert!(albedo[1] < 0.75 * albedo[0], "albedo {albedo:?}");
    assert!(picture[1] < 0.05 * picture[0], "picture {picture:?}");
}

//! Media that emit light: derivatives of emission, extinction and albedo.

use super::*;

/// A cloud whose light is half its own.
fn emitting(kind: Kind, density: f32) -> Cloud {
    let voxels = if matches!(kind, Kind::Even | Kind::Around) { 1 } else { 12 };
    let emission = |i: u64| vec3(noise(i, 20), noise(i, 21), 0.0) * 2.0;
    Cloud { emission: (0..voxels).map(emission).collect(), ..Cloud::uniform(kind, density) }
}

fn moved(cloud: &Cloud, value: MediumValue, x: f64) -> Cloud {
    let mut out = cloud.clone();
    match value {
        MediumValue::Extinction => out.density.iter_mut().for_each(|d| *d += x as f32),
        MediumValue::Albedo => out.albedo.iter_mut().for_each(|a| *a = a.map(|a| a + x as f32)),
        MediumValue::Emission => out.emission.iter_mut().for_each(|e| *e = e.map(|e| e + x as f32)),
    }
    out
}

fn check(cloud: &Cloud, values: &[(MediumValue, f64)], spp: [u32; 2], resolved: f64) {
    for (value, step) in values {
        let extinction = *value == MediumValue::Extinction;
        let a = cloud.replayed(*value, spp[0], |_, c| if extinction { cloud.tint[c].into() } else { 1.0 });
        let from_above = *value == MediumValue::Emission || cloud.density.contains(&0.0);
        let b = differences(|x| moved(cloud, *value, x), *step, from_above, spp[1]);
        compare(&format!("{:?} {:?}, emitting", cloud.kind, value), a, b, resolved);
    }
}

const VALUES: [(MediumValue, f64); 3] =
    [(MediumValue::Extinction, 0.04), (MediumValue::Albedo, 0.05), (MediumValue::Emission, 0.2)];

#[test]
fn derivatives_of_emitting_media_are_those_of_differences() {
    check(&emitting(Kind::Bounded, 0.6), &VALUES, [64, 256], 0.1);
}

#[test]
#[ignore = "slow: many samples"]
fn derivatives_of_all_emitting_media_are_those_of_differences() {
    for kind in [Kind::Even, Kind::Bounded, Kind::Box, Kind::Around] {
        for density in [0.0, 0.6, 1.5] {
            let none = density == 0.0 || kind == Kind::Around;
            let mut cloud = emitting(kind, density);
            let values = if none && density == 0.0 { vec![VALUES[0], VALUES[2]] } else { VALUES.to_vec() };
            if kind == Kind::Around && density == 0.0 {
                continue;
            }
            check(&cloud, &values, [512, 1024], 0.1);
            // Flights are chosen by colour, and absorbed alone.
            if kind == Kind::Even {
                cloud.tint = vec3(1.6, 0.8, 0.2);
                check(&cloud, &values, [512, 1024], 0.1);
                cloud.albedo = vec![Vec3f::zero()];
                check(&cloud, &[VALUES[0], VALUES[2]], [512, 1024], 0.1);
            }
        }
    }
}

/// A view along x through four voxels that absorb and emit light, before nothing: the light of a voxel is dimmed by
/// those in front of it.
#[test]
fn own_light_has_its_closed_form() {
    let (density, emission) = (0.7_f32, [0.5_f32, 2.0]);
    let view = looking([4.0, 0.0, 0.0], [0.0; 3], 1e-4);
    let weights = Image::from_fn(4, 4, 3, |_, _, _| 1.0 / 48.0);
    let s = f64::from(density);
    // Of e (1 - exp(-2 s)) / s, by e and by s.
    let by_emission = (1.0 - (-2.0 * s).exp()) / s;
    let by_density = |e: f64| e * (2.0 * s * (-2.0 * s).exp() - (1.0 - (-2.0 * s).exp())) / (s * s);
    for kind in [Kind::Even, Kind::Bounded, Kind::Box] {
        for emission in emission {
            let mut c = Cloud::uniform(kind, density);
            (c.albedo, c.emission) = (vec![Vec3f::zero()], vec![Vec3f::splat(emission)]);
            let mut world = c.world();
            world.set_sources(&[]).unwrap();
            world.relight(&[], None).unwrap();
            let options = RenderOptions { width: 4, height: 4, ..c.options(1, 0) };
            let parameters = [MediumValue::Extinction, MediumValue::Emission].map(|v| kind.parameter(v));
            let adjoint = Adjoint::new(&world, &view, options, &parameters).unwrap();
            let samples = GradientSamples { spp: 4096, seed: None };
            let one = |seed| {
                let g =
                    adjoint.render_vjp(&weights, GradientSamples { seed: Some(seed), ..samples }).unwrap();
                [0, 1].map(|p| g.parameters[p].values.iter().sum::<f64>())
            };
            let found: Vec<[f64; 2]> = (0..REPLICATES).map(one).collect();
            let expected = [by_density(f64::from(emission)), by_emission];
            for (p, expected) in expected.into_iter().enumerate() {
                let (mean, error) = statistics(&found.iter().map(|f| f[p]).collect::<Vec<_>>());
                let bound = 4.0 * error + 1e-6;
                assert!((mean - expected).abs() < bound, "{kind:?} {p}: {mean} +- {error}, not {expected}");
                assert!(error < 0.02 * expected.abs(), "{kind:?} {p}: {error} of {expected}");
            }
        }
    }
}

#[test]
fn emission_without_values_has_no_derivative() {
    let world = Cloud::uniform(Kind::Box, 1.0).world();
    let parameter = Kind::Box.parameter(MediumValue::Emission);
    let error = Adjoint::new(&world, &view(), RenderOptions::default(), &[parameter]).unwrap_err();
    assert!(error.to_string().contains("has no emission; it must have one, if only of zeros"), "{error}");
    // Zeros have one.
    let mut cloud = Cloud::uniform(Kind::Box, 1.0);
    cloud.emission = vec![Vec3f::zero()];
    let (found, error) = cloud.replayed(MediumValue::Emission, 16, |_, _| 1.0);
    assert!(found.abs() > 10.0 * error, "{found} +- {error}");
}

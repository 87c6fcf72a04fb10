//! Gradients along paths that take directions of another sampler.

use super::*;
use crate::validation::sinks::Uniform;
use crate::{MediumRef, MediumValue, Volume};
use photofit_flow::Guided;
use photofit_sampling::ScatteringSampler;

/// The box with a cloud in it.
fn cloudy() -> World {
    let mut parts = cornell();
    let (lo, hi) = (DVec3::new(-0.3, 0.3, -0.3), DVec3::new(0.3, 0.8, 0.3));
    parts.volumes.push(Volume::homogeneous(lo, hi, 2.0, Vec3f::splat(0.7), 0.3));
    World::new(parts).unwrap()
}

#[test]
fn other_direction_samplers_give_the_same_gradients() {
    let medium = |value| Parameter::Medium { medium: MediumRef::Volume(0), value };
    let floor = of(FLOOR, MaterialValue::Reflectance);
    let lamp = of(LAMP, MaterialValue::Emission);
    let cases = [
        ("room", room(), vec![floor.clone(), lamp.clone(), Parameter::Environment]),
        ("cloud", cloudy(), vec![floor, lamp, medium(MediumValue::Extinction), medium(MediumValue::Albedo)]),
    ];
    let guide = Uniform(0.35);
    for (name, world, parameters) in &cases {
        let mut options = square(SIDE, 1);
        options.path.max_depth = 4;
        let adjoint = Adjoint::new(world, &cornell_view(), options, parameters).unwrap();
        // The mean of each parameter's values, over independent estimates.
        let estimates = |sampler: &dyn Fn(GradientSamples) -> crate::Gradient, first: u64| -> Vec<Vec<f64>> {
            (0..12)
                .map(|k| {
                    let gradient = sampler(GradientSamples { spp: 32, seed: Some(first + k) });
                    assert!(
                        gradient.residual < 1e-9 && gradient.not_finite == 0,
                        "{name}: {}",
                        gradient.residual
                    );
                    gradient.parameters.iter().map(|p| p.values.iter().sum()).collect()
                })
                .collect()
        };
        let own = estimates(&|s| adjoint.render_vjp(&weights(), s).unwrap(), 0);
        let with = |sampler: &Guided<'_, Uniform>| {
            estimates(&|s| adjoint.render_vjp_with(sampler, &weights(), s).unwrap(), 1000)
        };
        let mixed = with(&Guided(&guide));
        for p in 0..parameters.len() {
            let of = |all: &[Vec<f64>]| statistics(&all.iter().map(|g| g[p]).collect::<Vec<_>>());
            let ((a, sa), (b, sb)) = (of(&own), of(&mixed));
            let sigma = sa.hypot(sb);
            assert!((a - b).abs() <= 4.5 * sigma, "{name} {p}: {a} +- {sa}, {b} +- {sb}");
            assert!(sigma < 0.15 * a.abs(), "{name} {p}: {a} +- {sa}, {b} +- {sb} say nothing");
        }
        // The scattering functions' own sampling is the default, to the bit; the mixture takes other directions.
        let same = |sampler: &ScatteringSampler| {
            let samples = GradientSamples { spp: 2, seed: Some(5) };
            let [a, b] = [
                adjoint.render_vjp(&weights(), samples).unwrap(),
                adjoint.render_vjp_with(sampler, &weights(), samples).unwrap(),
            ];
            a == b
        };
        assert!(same(&ScatteringSampler), "{name}");
        assert!(own[0] != mixed[0], "{name}");
    }
}

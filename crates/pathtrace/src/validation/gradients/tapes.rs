//! What is kept of a path tells its replay the same as a second walk.

use super::*;
use crate::{Filter, Gradient};

#[test]
fn gradients_have_the_same_bits_whatever_is_kept_of_paths() {
    let light = |light| Parameter::Light { light };
    let room = room();
    let is_metal = |m: &Material| matches!(m.scattering, BsdfSource::Uniform(Bsdf::RoughConductor(_)));
    let ball = room.given.iter().position(is_metal).unwrap();
    let of_room = vec![
        of(FLOOR, MaterialValue::Reflectance),
        of(LAMP, MaterialValue::Emission),
        of(ball, MaterialValue::Alpha),
        light(0),
        light(1),
        light(2),
        Parameter::Environment,
    ];
    let of_maps = (0..4).map(|texture| Parameter::Texels { texture }).collect();
    let of_body = vec![of(0, MaterialValue::Absorption), of(1, MaterialValue::Reflectance)];
    let of_metal = vec![
        of(FLOOR, MaterialValue::Reflectance),
        of(BALL, MaterialValue::Alpha),
        of(BALL, MaterialValue::SpecularReflectance),
        Parameter::Environment,
    ];
    let near = looking([0.0, 0.8, 3.2], [0.0, -0.1, 0.0], 0.7);
    for (name, world, view, parameters) in [
        ("room", room, cornell_view(), of_room),
        ("maps", mapped(false), near, of_maps),
        ("coated maps", mapped(true), near, (0..4).map(|texture| Parameter::Texels { texture }).collect()),
        ("metals", metals(Distribution::Ggx), looking([0.0, 0.6, 2.6], [-0.3, 0.0, 0.0], 0.6), of_metal),
        ("body", clear_body(), near, of_body),
    ] {
        for filter in [Filter::Box, Filter::Gaussian { sigma: 0.5 }] {
            let options = RenderOptions { filter, ..square(SIDE, 1) };
            let mut adjoint = Adjoint::new(&world, &view, options, &parameters).unwrap();
            let found = same_whatever_is_kept(name, &mut adjoint, &weights(), &[0, 1, 7]);
            assert!(found.residual < 1e-6, "{name}, {filter:?}: {}", found.residual);
        }
    }
}

/// Demands a gradient of every parameter, and the same bits with so many reports of a path; returns it with as many as usual.
pub(in crate::validation) fn same_whatever_is_kept(
    name: &str,
    adjoint: &mut Adjoint<'_>,
    weights: &Image,
    reports: &[usize],
) -> Gradient {
    let gradient =
        |adjoint: &Adjoint<'_>| adjoint.render_vjp(weights, GradientSamples { spp: 8, seed: None }).unwrap();
    let found = gradient(adjoint);
    for (i, p) in found.parameters.iter().enumerate() {
        assert!(p.values.iter().any(|v| *v != 0.0), "{name}: parameter {i} has no gradient");
    }
    for kept in reports {
        adjoint.kept = *kept;
        assert!(gradient(adjoint) == found, "{name}, {kept} reports of a path");
    }
    found
}

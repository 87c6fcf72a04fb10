//! Media that emit light: closed forms, and a furnace in which they balance what they absorb.

use super::scenes::{looking, render, square};
use super::statistics::mean_of;
use crate::{
    Adjoint, Boundary, BoundedMedium, EnvironmentMap, Field, GradientSamples, Material, MaterialValue,
    Parameter, Parts, PathOptions, PathtraceError, RenderOptions, Renderer, Shape, View, Volume, World,
};
use glam::{DAffine3, DVec3};
use photofit_image::Image;
use photofit_sampling::{hash, unit_f32};
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::{Bsdf, Null};

const EXTINCTION: Vec3f = Vec3f { x: 1.5, y: 0.5, z: 0.0 };
const EMISSION: Vec3f = Vec3f { x: 3.0, y: 2.0, z: 0.25 };

/// The box from -1 to 1.
fn cube() -> DAffine3 {
    DAffine3::from_translation(DVec3::splat(-1.0)) * DAffine3::from_scale(DVec3::splat(2.0))
}

/// A ball of radius 1 with a medium in it.
fn ball(medium: BoundedMedium, bsdf: Bsdf<f32>) -> Parts {
    let mut parts = Parts { media: vec![medium], ..Parts::default() };
    let shape = Shape::Sphere { center: Vec3f::zero(), radius: 1.0 };
    let instance = parts.add(shape, Material::new(bsdf));
    parts.boundaries.push(Boundary { instance, interior: Some(0), exterior: None });
    parts
}

/// Almost one ray along z, through the middle.
fn ray() -> View {
    looking([0.0, 0.0, 4.0], [0.0; 3], 1e-3)
}

/// Light of `emission` along 2 units of an extinction, and of 1 behind it.
fn closed_form(extinction: f32, emission: f32) -> f64 {
    let (s, e) = (f64::from(extinction), f64::from(emission));
    let own = if s == 0.0 { 2.0 * e } else { e / s * (1.0 - (-2.0 * s).exp()) };
    own + (-2.0 * s).exp()
}

#[test]
fn light_of_media_that_absorb_has_its_closed_form() {
    let even = BoundedMedium {
        emission: Some(Field::constant(EMISSION)),
        ..BoundedMedium::homogeneous(EXTINCTION, Vec3f::zero(), 0.0)
    };
    let grid = |value: Vec3f| Field { size: [3, 4, 5], values: vec![value; 60], transform: cube() };
    let extinction = Field { size: [2, 2, 2], values: vec![Vec3f::splat(1.5); 8], transform: cube() };
    let gridded = BoundedMedium { extinction, emission: Some(grid(EMISSION)), ..even.clone() };
    let grey = [EXTINCTION, Vec3f::splat(1.5), Vec3f::splat(1.5)];
    let mut boxed = Volume::homogeneous(DVec3::splat(-1.0), DVec3::ONE, 1.5, Vec3f::zero(), 0.0);
    boxed.emission = Some(grid(EMISSION));
    let null = Bsdf::Null(Null);
    let cases = [
        ("even", ball(even, null)),
        ("grid", ball(gridded, null)),
        ("box", Parts { volumes: vec![boxed], ..Parts::default() }),
    ];
    for ((name, mut parts), extinction) in cases.into_iter().zip(grey) {
        parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
        let world = World::new(parts).unwrap();
        for depth in [0, 3] {
            let path = PathOptions { max_depth: depth, ..PathOptions::default() };
            let spp = 4096;
            let (picture, variance) = render(&world, &ray(), RenderOptions { path, ..square(4, spp) });
            for c in 0..3 {
                let (found, error) = mean_of(&picture, &variance, spp, c);
                let wanted = closed_form(extinction[c], EMISSION[c]);
                let bound = 4.0 * error + 1e-5;
                assert!((found - wanted).abs() < bound, "{name} {c}: {found}, not {wanted} +- {bound}");
                assert!(error < 0.01 * wanted, "{name} {c}: {error} of {wanted}");
            }
        }
    }
}

#[test]
fn light_within_a_solid_that_absorbs_is_dimmed_on_its_way() {
    let medium = BoundedMedium {
        emission: Some(Field::constant(EMISSION)),
        ..BoundedMedium::homogeneous(Vec3f::zero(), Vec3f::zero(), 0.0)
    };
    let mut parts = ball(medium, Bsdf::Null(Null));
    parts.materials[0].absorption = EXTINCTION;
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
    let world = World::new(parts).unwrap();
    let spp = 256;
    let (picture, variance) = render(&world, &ray(), square(4, spp));
    for c in 0..3 {
        let (found, error) = mean_of(&picture, &variance, spp, c);
        let wanted = closed_form(EXTINCTION[c], EMISSION[c]);
        assert!((found - wanted).abs() < 4.0 * error + 1e-5, "{c}: {found} +- {error}, not {wanted}");
    }
}

/// A medium that emits what it absorbs, in light of radiance 1 from everywhere, cannot be seen.
#[test]
fn media_in_equilibrium_vanish() {
    let albedo = vec3(0.7, 0.4, 0.0);
    let lost = albedo.map(|a| 1.0 - a);
    let homogeneous = |extinction: Vec3f| BoundedMedium {
        emission: Some(Field::constant(extinction.mul(lost))),
        ..BoundedMedium::homogeneous(extinction, albedo, 0.4)
    };
    // Emission and extinction are interpolated alike.
    let density: Vec<f32> =
        (0..60).map(|i| 4.0 * unit_f32((hash(7, i, 0) >> 32) as u32)).map(|d| (d - 1.0).max(0.0)).collect();
    let field = |values| Field { size: [3, 4, 5], values, transform: cube() };
    let emission = field(density.iter().map(|d| lost * *d).collect());
    let grid = BoundedMedium {
        extinction: field(density.iter().map(|d| Vec3f::splat(*d)).collect()),
        emission: Some(emission.clone()),
        ..homogeneous(EXTINCTION)
    };
    let boxed = Volume {
        size: [3, 4, 5],
        density,
        emission: Some(emission),
        ..Volume::homogeneous(DVec3::splat(-1.0), DVec3::ONE, 1.0, albedo, -0.3)
    };
    let null = Bsdf::Null(Null);
    let mut both = ball(homogeneous(vec3(0.9, 0.6, 0.3)), null);
    both.volumes.push(boxed.clone());
    let mut around = Parts { media: vec![homogeneous(vec3(0.5, 0.8, 0.3))], ..Parts::default() };
    around.medium_around_camera = Some(0);
    let cases = [
        ("grey", ball(homogeneous(Vec3f::splat(1.2)), null)),
        ("coloured", ball(homogeneous(EXTINCTION), null)),
        ("grid", ball(grid, null)),
        ("box", Parts { volumes: vec![boxed], ..Parts::default() }),
        ("a box in a coloured ball", both),
        ("everywhere", around),
    ];
    for (name, mut parts) in cases {
        parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
        let world = World::new(parts).unwrap();
        let path = PathOptions { max_depth: 200, ..PathOptions::default() };
        let spp = 1024;
        let view = looking([0.3, 0.2, 3.0], [0.0; 3], 0.8);
        let (picture, variance) = render(&world, &view, RenderOptions { path, ..square(8, spp) });
        for c in 0..3 {
            let (found, error) = mean_of(&picture, &variance, spp, c);
            assert!((found - 1.0).abs() < 4.0 * error + 1e-5, "{name} {c}: {found} +- {error}");
            assert!(error < 0.01, "{name} {c}: {error}");
        }
    }
}

/// A ray on which one colour of the medium never ends.
#[test]
fn colours_without_extinction_leave_the_others_their_light() {
    let emission = Some(Field::constant(vec3(1.0, 2.0, 0.0)));
    let medium = BoundedMedium::homogeneous(vec3(1.0, 0.5, 0.0), Vec3f::zero(), 0.0);
    let mut parts = Parts { media: vec![BoundedMedium { emission, ..medium }], ..Parts::default() };
    parts.medium_around_camera = Some(0);
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
    let world = World::new(parts).unwrap();
    let spp = 4096;
    let mut renderer = Renderer::new(&world, &ray(), square(4, spp)).unwrap();
    renderer.finish();
    let (picture, variance) = render(&world, &ray(), square(4, spp));
    for (c, wanted) in [1.0, 4.0, 1.0].into_iter().enumerate() {
        let (found, error) = mean_of(&picture, &variance, spp, c);
        assert!((found - wanted).abs() < 4.0 * error + 1e-5, "{c}: {found} +- {error}, not {wanted}");
        assert!(error < 0.02 * wanted, "{c}: {error}");
    }
    assert_eq!(renderer.progress().not_finite, 0);
}

/// Grids of emission end where their boxes do, and media in boxes where theirs do.
#[test]
fn emission_is_looked_up_in_its_box_alone() {
    let placed = |turn: f64, [from, to]: [f64; 2]| {
        DAffine3::from_rotation_z(turn)
            * DAffine3::from_translation(DVec3::new(-1.0, -1.0, from))
            * DAffine3::from_scale(DVec3::new(2.0, 2.0, to - from))
    };
    let emission = |transform| Some(Field { size: [2, 1, 1], values: vec![EMISSION; 2], transform });
    let extinction = 1.5_f64;
    let even = BoundedMedium::homogeneous(Vec3f::splat(extinction as f32), Vec3f::zero(), 0.0);
    let field = Field { size: [2, 2, 2], values: vec![Vec3f::splat(1.5); 8], transform: cube() };
    let inner = emission(placed(0.7, [-0.5, 0.25]));
    let boxed = Volume {
        emission: emission(placed(0.7, [0.0, 3.0])),
        ..Volume::homogeneous(DVec3::splat(-1.0), DVec3::ONE, extinction as f32, Vec3f::zero(), 0.0)
    };
    let null = Bsdf::Null(Null);
    // The ray comes down from above; depth of the first and the last emission in the medium.
    for (name, parts, [from, to]) in [
        ("even", ball(BoundedMedium { emission: inner.clone(), ..even.clone() }, null), [0.75, 1.5]),
        ("grid", ball(BoundedMedium { emission: inner, extinction: field, ..even }, null), [0.75, 1.5]),
        ("box", Parts { volumes: vec![boxed], ..Parts::default() }, [0.0, 1.0]),
    ] {
        let world = World::new(parts).unwrap();
        let spp = 4096;
        let (picture, variance) = render(&world, &ray(), square(4, spp));
        let part = ((-extinction * from).exp() - (-extinction * to).exp()) / extinction;
        for c in 0..3 {
            let (found, error) = mean_of(&picture, &variance, spp, c);
            let wanted = part * f64::from(EMISSION[c]);
            assert!(
                (found - wanted).abs() < 4.0 * error + 1e-5,
                "{name} {c}: {found} +- {error}, not {wanted}"
            );
            assert!(error < 0.02 * wanted, "{name} {c}: {error}");
        }
    }
}

/// The derivative of `e (1 - exp(-2 a)) / a` by the absorption `a` of the solid.
#[test]
fn absorption_of_a_solid_dims_the_light_within_it_in_derivatives() {
    let (absorption, emission) = (0.8_f64, 2.0_f64);
    let medium = BoundedMedium {
        emission: Some(Field::constant(Vec3f::splat(emission as f32))),
        ..BoundedMedium::homogeneous(Vec3f::zero(), Vec3f::zero(), 0.0)
    };
    let mut parts = ball(medium, Bsdf::Null(Null));
    parts.materials[0].absorption = Vec3f::splat(absorption as f32);
    let world = World::new(parts).unwrap();
    let parameter = Parameter::Material { materials: vec![0], value: MaterialValue::Absorption };
    let adjoint = Adjoint::new(&world, &ray(), square(4, 1), &[parameter]).unwrap();
    let weights = Image::from_fn(4, 4, 3, |_, _, _| 1.0 / 16.0);
    let samples = GradientSamples { spp: 4096, seed: None };
    let (g, error) = adjoint.render_vjp_with_error(&weights, samples).unwrap();
    let left = (-2.0 * absorption).exp();
    let wanted = emission * (2.0 * absorption * left - (1.0 - left)) / (absorption * absorption);
    for c in 0..3 {
        let (found, error) = (g.parameters[0].values[c], error.parameters[0].values[c]);
        assert!((found - wanted).abs() < 4.0 * error + 1e-5, "{c}: {found} +- {error}, not {wanted}");
        assert!(error < 0.02 * wanted.abs(), "{c}: {error}");
    }
}

/// Nothing else gives light.
#[test]
fn light_of_media_is_enough_for_a_scene() {
    let with =
        |emission| BoundedMedium { emission, ..BoundedMedium::homogeneous(EXTINCTION, Vec3f::zero(), 0.0) };
    let world = World::new(ball(with(Some(Field::constant(EMISSION))), Bsdf::Null(Null))).unwrap();
    let (picture, _) = render(&world, &ray(), square(2, 1));
    assert!(picture.pixel(0, 0)[0] > 0.1);
    let dark = World::new(ball(with(None), Bsdf::Null(Null))).unwrap();
    let error = Renderer::new(&dark, &ray(), square(2, 1)).unwrap_err();
    assert_eq!(error, PathtraceError::NoLight);
}

#[test]
fn emission_of_media_is_checked_by_its_rule() {
    let bad = |values: Vec<Vec3f>, size| Some(Field { size, values, transform: cube() });
    let negative = bad(vec![Vec3f::zero(), vec3(0.0, -1.0, 0.0)], [2, 1, 1]);
    for (emission, told) in [
        (negative, "emission of voxel (1, 0, 0) is [0.0, -1.0, 0.0]; it must be finite and not negative"),
        (bad(vec![Vec3f::splat(f32::NAN)], [1; 3]), "finite"),
        (bad(vec![Vec3f::zero()], [2, 1, 1]), "emission has 1 values for 2 x 1 x 1 voxels"),
    ] {
        let medium = BoundedMedium {
            emission: emission.clone(),
            ..BoundedMedium::homogeneous(EXTINCTION, EXTINCTION, 0.0)
        };
        let medium = BoundedMedium { albedo: Field::constant(Vec3f::zero()), ..medium };
        let boxed =
            Volume { emission, ..Volume::homogeneous(DVec3::ZERO, DVec3::ONE, 1.0, Vec3f::zero(), 0.0) };
        for parts in [ball(medium, Bsdf::Null(Null)), Parts { volumes: vec![boxed], ..Parts::default() }] {
            let error = World::new(parts).unwrap_err().to_string();
            assert!(error.contains(told), "{error}");
        }
    }
}

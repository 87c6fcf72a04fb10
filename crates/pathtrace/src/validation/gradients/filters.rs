//! Samples that count for every pixel whose filter reaches them.

use super::*;
use crate::Filter;

const WIDE: [Filter; 2] = [Filter::Tent { radius: 1.5 }, Filter::Gaussian { sigma: 0.5 }];

/// Nothing but a grey sky of so many texels.
fn empty(texels: usize) -> World {
    let environment = Some(EnvironmentMap::new(Image::from_fn(2 * texels, texels, 3, |_, _, _| 0.5)));
    World::new(Parts { environment, ..Parts::default() }).unwrap()
}

/// Estimates of the derivative of a weighted sum of pixels with respect to the environment, all values of one after the other.
fn estimates(world: &World, filter: Filter, weights: &Image, spp: u32, count: u64) -> Vec<Vec<f64>> {
    estimates_of(world, &Parameter::Environment, filter, (weights, spp), count)
}

/// The same of another parameter.
fn estimates_of(
    world: &World,
    parameter: &Parameter,
    filter: Filter,
    (weights, spp): (&Image, u32),
    count: u64,
) -> Vec<Vec<f64>> {
    let view = cornell_view();
    let mut options = RenderOptions { filter, ..square(SIDE, spp) };
    options.path.max_depth = 4;
    let adjoint = Adjoint::new(world, &view, options, std::slice::from_ref(parameter)).unwrap();
    let one = |seed| {
        let mut gradient = adjoint.render_vjp(weights, GradientSamples { spp, seed: Some(seed) }).unwrap();
        gradient.parameters.swap_remove(0).values
    };
    (0..count).map(one).collect()
}

/// Sums of the derivatives by the red of all texels.
fn red(found: &[Vec<f64>]) -> Vec<f64> {
    found.iter().map(|values| values.iter().step_by(3).sum()).collect()
}

#[test]
fn light_of_one_value_that_is_seen_has_no_noise() {
    let mut lamp = Parts::default();
    let mesh = shapes::parallelogram(vec3(-50.0, -50.0, -3.0), vec3(100.0, 0.0, 0.0), vec3(0.0, 100.0, 0.0));
    let black = Material::new(diffuse(0.0, 0.0, 0.0));
    lamp.add(Shape::Mesh(mesh), Material { emission: Vec3f::splat(2.0), ..black });
    let lamp = World::new(lamp).unwrap();
    let environment = Some(EnvironmentMap::constant(Vec3f::splat(0.5)));
    let sky = World::new(Parts { environment, ..Parts::default() }).unwrap();
    let emission = Parameter::Material { materials: vec![0], value: MaterialValue::Emission };
    let signs = Image::from_fn(SIDE, SIDE, 3, |x, y, c| noise((y * SIDE + x) as u64, 9 + c as u64) - 0.5);
    let sum: f64 = signs.data.iter().step_by(3).map(|w| f64::from(*w)).sum();
    for filter in WIDE {
        for (world, parameter) in [(&lamp, &emission), (&sky, &Parameter::Environment)] {
            let found = estimates_of(world, parameter, filter, (&signs, 2), 4);
            assert!(
                found.iter().all(|v| (v[0] - sum).abs() < 1e-4),
                "{filter:?}, {parameter:?}: {found:?}, {sum}"
            );
        }
    }
}

#[test]
fn equal_weights_count_whole() {
    let even = Image::from_fn(SIDE, SIDE, 3, |_, _, _| 1.0);
    for filter in WIDE {
        let found = red(&estimates(&empty(2), filter, &even, 4, 1));
        let pixels = (SIDE * SIDE) as f64;
        assert!(found.iter().all(|v| (v - pixels).abs() < 1e-4 * pixels), "{filter:?}: {found:?}");
    }
}

#[test]
fn every_pixel_has_its_filter_at_borders_too() {
    for filter in WIDE {
        for place in [[0, 0], [SIDE - 1, 3], [7, 8]] {
            let one = Image::from_fn(SIDE, SIDE, 3, |x, y, _| f32::from(u8::from([x, y] == place)));
            let (mean, error) = statistics(&red(&estimates(&empty(2), filter, &one, 64, 32)));
            assert!((mean - 1.0).abs() < 4.0 * error + 1e-4, "{filter:?} at {place:?}: {mean} +- {error}");
            // With samples that count for their own pixel alone there is no spread at all.
            assert!(error > 1e-6 && error < 0.02, "{filter:?} at {place:?}: {error}");
        }
    }
}

#[test]
fn gradients_are_those_of_filtered_pictures() {
    let view = cornell_view();
    for filter in WIDE {
        let (step, options) = (0.1, |seed| {
            let mut options = RenderOptions { seed, filter, ..square(SIDE, SPP) };
            options.path.max_depth = 4;
            options
        });
        let lit = |scale: f32| {
            let mut world = room();
            let value = world.parameter(&Parameter::Environment).unwrap();
            let moved: Vec<f32> = value.iter().map(|v| v * scale).collect();
            world.set_parameter(&Parameter::Environment, &moved).unwrap();
            world
        };
        let (world, plus, minus) = (room(), lit(1.0 + step), lit(1.0 - step));
        let value = world.parameter(&Parameter::Environment).unwrap();
        let replayed: Vec<f64> = estimates(&world, filter, &weights(), SPP, REPLICATES)
            .iter()
            .map(|g| g.iter().zip(&value).map(|(g, v)| g * f64::from(*v)).sum())
            .collect();
        let difference = |seed| {
            (loss(&plus, &view, options(seed)) - loss(&minus, &view, options(seed))) / (2.0 * f64::from(step))
        };
        let differences: Vec<f64> = (100..100 + REPLICATES).map(difference).collect();
        let ((a, sa), (b, sb)) = (statistics(&replayed), statistics(&differences));
        let sigma = sa.hypot(sb);
        println!("{filter:?}: replay {a:.4} +- {sa:.4}, differences {b:.4} +- {sb:.4}");
        assert!((a - b).abs() < 4.0 * sigma, "{filter:?}: {a} +- {sa} and {b} +- {sb}");
        assert!(sigma < 0.05 * b.abs(), "{filter:?}: {sigma} of {b} says nothing");
    }
}

#[test]
fn shared_samples_have_less_noise() {
    let signs = Image::from_fn(SIDE, SIDE, 3, |x, y, c| noise((y * SIDE + x) as u64, 9 + c as u64) - 0.5);
    let variance = |filter| {
        let found = estimates(&room(), filter, &signs, 4, 16);
        let values = found[0].len();
        let of = |i| statistics(&found.iter().map(|f: &Vec<f64>| f[i]).collect::<Vec<f64>>()).1.powi(2);
        (0..values).map(of).sum::<f64>()
    };
    let (own, shared) = (variance(Filter::Box), variance(Filter::Gaussian { sigma: 0.5 }));
    println!("variance with boxes {own:.4}, with shared Gaussians {shared:.4}: {:.2}", shared / own);
    assert!(shared < 0.8 * own, "{shared} and {own}");
}

//! Samples that count for every pixel whose filter reaches them.

use super::*;
use crate::Filter;

const WIDE: [Filter; 2] = [Filter::Tent { radius: 1.5 }, Filter::Gaussian { sigma: 0.5 }];

/// Nothing but a grey sky.
fn empty() -> World {
    let environment = Some(EnvironmentMap::constant(Vec3f::splat(0.5)));
    World::new(Parts { environment, ..Parts::default() }).unwrap()
}

/// Estimates of the derivative of a weighted sum of pixels, all values of one after the other.
fn estimates(
    world: &World,
    (view, parameter): (&View, &Parameter),
    filter: Filter,
    (weights, spp): (&Image, u32),
    count: u64,
) -> Vec<Vec<f64>> {
    let mut options = RenderOptions { filter, ..square(SIDE, spp) };
    options.path.max_depth = 4;
    let adjoint = Adjoint::new(world, view, options, std::slice::from_ref(parameter)).unwrap();
    let one = |seed| {
        let mut gradient = adjoint.render_vjp(weights, GradientSamples { spp, seed: Some(seed) }).unwrap();
        gradient.parameters.swap_remove(0).values
    };
    (0..count).map(one).collect()
}

/// The same by the environment of the room.
fn by_sky(world: &World, filter: Filter, weights: (&Image, u32), count: u64) -> Vec<Vec<f64>> {
    estimates(world, (&cornell_view(), &Parameter::Environment), filter, weights, count)
}

#[test]
fn equal_weights_count_whole() {
    let even = Image::from_fn(SIDE, SIDE, 3, |_, _, _| 1.0);
    for filter in WIDE {
        let found = by_sky(&empty(), filter, (&even, 4), 1);
        let pixels = (SIDE * SIDE) as f64;
        assert!(found[0].iter().all(|v| (v - pixels).abs() < 1e-4 * pixels), "{filter:?}: {found:?}");
    }
}

#[test]
fn every_pixel_has_its_filter_at_borders_too() {
    for filter in WIDE {
        for place in [[0, 0], [SIDE - 1, 3], [7, 8]] {
            let one = Image::from_fn(SIDE, SIDE, 3, |x, y, _| f32::from(u8::from([x, y] == place)));
            let found: Vec<f64> = by_sky(&empty(), filter, (&one, 64), 32).iter().map(|v| v[0]).collect();
            let (mean, error) = statistics(&found);
            assert!((mean - 1.0).abs() < 4.0 * error + 1e-4, "{filter:?} at {place:?}: {mean} +- {error}");
            // With samples that count for their own pixel alone there is no spread at all.
            assert!(error > 1e-6 && error < 0.02, "{filter:?} at {place:?}: {error}");
        }
    }
}

#[test]
fn gradients_are_those_of_filtered_pictures() {
    // The sky of many texels, a lamp that is seen, a sky of one that is seen past and through a clear body.
    let room: fn() -> World = room;
    let near = looking([0.0, 0.5, 3.0], [0.0; 3], 0.9);
    for (world, view, parameter) in [
        (room, cornell_view(), Parameter::Environment),
        (room, cornell_view(), of(LAMP, MaterialValue::Emission)),
        (clear_body, near, Parameter::Environment),
    ] {
        of_filtered_pictures(world, &view, &parameter);
    }
}

fn of_filtered_pictures(world: fn() -> World, view: &View, parameter: &Parameter) {
    for filter in WIDE {
        let (step, options) = (0.1, |seed| {
            let mut options = RenderOptions { seed, filter, ..square(SIDE, SPP) };
            options.path.max_depth = 4;
            options
        });
        let lit = |scale: f32| {
            let mut world = world();
            let value = world.parameter(parameter).unwrap();
            let moved: Vec<f32> = value.iter().map(|v| v * scale).collect();
            world.set_parameter(parameter, &moved).unwrap();
            world
        };
        let (world, plus, minus) = (world(), lit(1.0 + step), lit(1.0 - step));
        let value = world.parameter(parameter).unwrap();
        let replayed: Vec<f64> = estimates(&world, (view, parameter), filter, (&weights(), SPP), REPLICATES)
            .iter()
            .map(|g| g.iter().zip(&value).map(|(g, v)| g * f64::from(*v)).sum())
            .collect();
        let difference = |seed| {
            (loss(&plus, view, options(seed)) - loss(&minus, view, options(seed))) / (2.0 * f64::from(step))
        };
        let differences: Vec<f64> = (100..100 + REPLICATES).map(difference).collect();
        let ((a, sa), (b, sb)) = (statistics(&replayed), statistics(&differences));
        let sigma = sa.hypot(sb);
        println!("{filter:?}, {parameter:?}: replay {a:.4} +- {sa:.4}, differences {b:.4} +- {sb:.4}");
        assert!((a - b).abs() < 4.0 * sigma, "{filter:?}, {parameter:?}: {a} +- {sa} and {b} +- {sb}");
        assert!(sigma < 0.05 * b.abs(), "{filter:?}: {sigma} of {b} says nothing");
    }
}

#[test]
fn shared_samples_have_less_noise() {
    let signs = Image::from_fn(SIDE, SIDE, 3, |x, y, c| noise((y * SIDE + x) as u64, 9 + c as u64) - 0.5);
    let variance = |filter| {
        let found = by_sky(&room(), filter, (&signs, 4), 16);
        let values = found[0].len();
        let of = |i| statistics(&found.iter().map(|f: &Vec<f64>| f[i]).collect::<Vec<f64>>()).1.powi(2);
        (0..values).map(of).sum::<f64>()
    };
    let (own, shared) = (variance(Filter::Box), variance(Filter::Gaussian { sigma: 0.5 }));
    println!("variance with boxes {own:.4}, with shared Gaussians {shared:.4}: {:.2}", shared / own);
    assert!(shared < 0.8 * own, "{shared} and {own}");
}

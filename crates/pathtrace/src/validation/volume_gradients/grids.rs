//! Grids of density and albedo: groups of voxels against differences, a closed form, bits, faults.

use super::*;
use rayon::ThreadPoolBuilder;

/// A grid of random density and albedo, with empty voxels.
fn random(kind: Kind, size: [usize; 3]) -> Cloud {
    let voxels = size.iter().product::<usize>() as u64;
    let density = |i: u64| if i.is_multiple_of(5) { 0.0 } else { 2.5 * noise(i, 10) };
    let albedo = |i: u64| vec3(noise(i, 11), 0.3 + 0.7 * noise(i, 12), noise(i, 13) * noise(i, 14)) * 0.9;
    Cloud {
        size,
        density: (0..voxels).map(density).collect(),
        albedo: (0..voxels).map(albedo).collect(),
        scale: 0.8,
        g: -0.2,
        factor: 1.5,
        depth: 8,
        ..Cloud::uniform(kind, 0.0)
    }
}

/// A smooth cloud with bright voxels: what light does in it depends on several events.
fn cloud(kind: Kind, size: [usize; 3]) -> Cloud {
    let smooth = random(kind, size);
    let density = smooth.density.iter().map(|d| 0.3 + d).collect();
    let albedo = smooth.albedo.iter().map(|a| a.map(|x| 0.5 + 0.45 * x)).collect();
    Cloud { density, albedo, ..smooth }
}

/// Which of `groups` slabs along z a voxel is in.
fn group(size: [usize; 3], groups: usize, voxel: usize) -> usize {
    voxel / (size[0] * size[1]) * groups / size[2]
}

fn densities(name: &str, c: &Cloud, groups: usize, spp: [u32; 2], resolved: f64) {
    for k in 0..groups {
        let inside = |i: usize| if group(c.size, groups, i) == k { 1.0 } else { 0.0 };
        let at = |x: f64| {
            let moved = |(i, d): (usize, &f32)| (d + (x * inside(i)) as f32).max(0.0);
            Cloud { density: c.density.iter().enumerate().map(moved).collect(), ..c.clone() }
        };
        let from_above = c.density.contains(&0.0);
        let b = differences(at, 0.25, from_above, spp[1]);
        let a = c.replayed(MediumValue::Extinction, spp[0], |voxel, _| inside(voxel));
        compare(&format!("{name}, density of slab {k}"), a, b, resolved);
    }
}

fn albedos(name: &str, c: &Cloud, groups: usize, spp: [u32; 2], resolved: f64) {
    for k in 0..groups {
        let inside = |i: usize| if group(c.size, groups, i) == k { 1.0 } else { 0.0 };
        let at = |x: f64| {
            let moved = |(i, a): (usize, &Vec3f)| a.map(|a| a + (x * inside(i)) as f32);
            Cloud { albedo: c.albedo.iter().enumerate().map(moved).collect(), ..c.clone() }
        };
        let b = differences(at, 0.04, true, spp[1]);
        let a = c.replayed(MediumValue::Albedo, spp[0], |voxel, _| inside(voxel));
        compare(&format!("{name}, albedo of slab {k}"), a, b, resolved);
    }
}

#[test]
fn voxels_of_a_cloud() {
    let c = cloud(Kind::Bounded, [3, 4, 4]);
    densities("cloud", &c, 2, [32, 256], 0.25);
    albedos("cloud", &c, 1, [16, 128], 0.25);
}

#[test]
#[ignore = "slow: many samples"]
fn voxels_of_random_grids() {
    for kind in [Kind::Bounded, Kind::Box] {
        for (name, c) in [("cloud", cloud(kind, [5, 4, 6])), ("random", random(kind, [5, 4, 6]))] {
            let name = format!("{name} {kind:?}");
            densities(&name, &c, 3, [256, 1024], 0.1);
            albedos(&name, &c, 3, [256, 1024], 0.1);
        }
    }
}

/// A view along x through the middle of a box of four voxels that only absorb, before a sky of radiance 1: the picture is
/// `exp(-h (d0 + d1 + d2 + d3))` with `h` the length of a voxel, and so are its derivatives but for the factor `-h`.
#[test]
fn absorption_has_its_closed_form() {
    let density = [0.3_f32, 0.0, 1.1, 0.6];
    let (scale, h) = (1.5_f64, 0.5_f64);
    let expected = -scale * h * (-scale * h * density.iter().map(|d| f64::from(*d)).sum::<f64>()).exp();
    let view = looking([4.0, 0.0, 0.0], [0.0; 3], 1e-4);
    let weights = Image::from_fn(4, 4, 3, |_, _, _| 1.0 / 48.0);
    for kind in [Kind::Bounded, Kind::Box, Kind::Even] {
        let mut c = Cloud::uniform(kind, 0.0);
        (c.size, c.density, c.albedo) = ([4, 1, 1], density.to_vec(), vec![Vec3f::zero()]);
        c.scale = scale as f32;
        if kind == Kind::Even {
            (c.size, c.density) = ([1; 3], vec![density.iter().sum::<f32>() / 4.0]);
        }
        let mut world = c.world();
        world.set_sources(&[]).unwrap();
        world.relight(&[], Some(EnvironmentMap::constant(Vec3f::splat(1.0)))).unwrap();
        let options = RenderOptions { width: 4, height: 4, ..c.options(1, 0) };
        let parameter = kind.parameter(MediumValue::Extinction);
        let adjoint = Adjoint::new(&world, &view, options, &[parameter]).unwrap();
        let samples = GradientSamples { spp: 4096, seed: None };
        let (g, error) = adjoint.render_vjp_with_error(&weights, samples).unwrap();
        if kind == Kind::Even {
            let found: f64 = g.parameters[0].values.iter().sum();
            assert!((found - 4.0 * expected).abs() < 1e-5, "{found}, not {}", 4.0 * expected);
            continue;
        }
        for (g, e) in g.parameters[0].values.iter().zip(&error.parameters[0].values) {
            assert!((g - expected).abs() < 4.5 * e, "{kind:?}: {g} +- {e}, not {expected}");
            assert!(*e < 0.02 * expected.abs(), "{kind:?}: {g} +- {e} says nothing");
        }
    }
}

#[test]
fn gradients_of_grids_have_the_same_bits_on_one_thread_and_two() {
    // Small grids are summed densely, large ones in pages of the voxels that are touched; in more tasks than are reduced at a time.
    for size in [[4, 3, 5], [40, 30, 32]] {
        let c = random(Kind::Box, size);
        let world = c.world();
        let parameters = [MediumValue::Extinction, MediumValue::Albedo].map(|v| c.kind.parameter(v));
        let swapped = [parameters[1].clone(), parameters[0].clone()];
        let bits = |adjoint: &Adjoint<'_>, threads| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let samples = GradientSamples { spp: 300, seed: Some(4) };
            let g = pool.install(|| adjoint.render_vjp(&weights(), samples)).unwrap();
            assert!(g.parameters.iter().all(|p| p.values.iter().any(|v| *v != 0.0)), "there are some");
            let of = |p: &ParameterGradient| p.values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            g.parameters.iter().map(of).collect::<Vec<_>>()
        };
        let of =
            |parameters: &[Parameter]| Adjoint::new(&world, &view(), c.options(1, 0), parameters).unwrap();
        let mut adjoint = of(&parameters);
        let one = bits(&adjoint, 1);
        assert!(one == bits(&adjoint, 2), "{size:?}");
        adjoint.sum_densely_up_to(0, &parameters);
        assert!(one == bits(&adjoint, 2), "{size:?} in pages");
        adjoint.sum_densely_up_to(usize::MAX, &parameters);
        assert!(one == bits(&adjoint, 2), "{size:?} densely");
        let mut other = of(&swapped);
        let turned = [one[1].clone(), one[0].clone()];
        assert!(turned[..] == bits(&other, 2), "{size:?} in the other order");
        other.sum_densely_up_to(0, &swapped);
        assert!(turned[..] == bits(&other, 2), "{size:?} in the other order, in pages");
    }
}

#[test]
fn values_are_read_and_replaced() {
    for kind in [Kind::Even, Kind::Bounded, Kind::Box] {
        let mut c = random(kind, [3, 2, 4]);
        if kind == Kind::Even {
            c.size = [1; 3];
        }
        c.emission = vec![vec3(0.5, 0.1, 0.0)];
        let mut world = c.world();
        for value in [MediumValue::Extinction, MediumValue::Albedo, MediumValue::Emission] {
            let parameter = kind.parameter(value);
            let old = world.parameter(&parameter).unwrap();
            let channels = if value == MediumValue::Extinction && kind != Kind::Even { 1 } else { 3 };
            assert_eq!(old.len(), channels * c.voxels());
            let new: Vec<f32> = old.iter().map(|v| 0.9 * v + 0.05).collect();
            world.set_parameter(&parameter, &new).unwrap();
            assert_eq!(world.parameter(&parameter).unwrap(), new);
            match value {
                MediumValue::Extinction => c.density = new.iter().step_by(channels).copied().collect(),
                MediumValue::Albedo => c.albedo = new.chunks(3).map(|v| vec3(v[0], v[1], v[2])).collect(),
                MediumValue::Emission => {
                    c.emission = new.chunks(3).map(|v| vec3(v[0], v[1], v[2])).collect();
                }
            }
        }
        // Upper bounds follow: an edited world is a new one, bit by bit.
        let picture = |world: &World| {
            let mut renderer = Renderer::new(world, &view(), c.options(4, 1)).unwrap();
            while !renderer.pass(|| false).done {}
            renderer.picture().data
        };
        assert!(picture(&world) == picture(&c.world()), "{kind:?}");
    }
}

#[test]
fn bad_values_of_media_are_refused() {
    let emission = vec![vec3(0.5, 0.1, 0.0)];
    let mut world = Cloud { emission, ..random(Kind::Box, [3, 2, 4]) }.world();
    let of = |index, value| Parameter::Medium { medium: MediumRef::Volume(index), value };
    let (density, albedo) = (of(0, MediumValue::Extinction), of(0, MediumValue::Albedo));
    let before = world.parameter(&density).unwrap();
    let mut fails = |parameter: &Parameter, values: &[f32]| {
        world.set_parameter(parameter, values).unwrap_err().to_string()
    };
    let with = |x: f32| {
        let mut values = before.clone();
        values[7] = x;
        values
    };
    for (text, words) in [
        (fails(&of(1, MediumValue::Albedo), &[]), "volume 1 is not there; the index must be below 1"),
        (fails(&density, &[1.0; 5]), "are 5; they must be 24"),
        (fails(&density, &with(f32::NAN)), "value 7: is NaN; it must be finite"),
        (
            fails(&density, &with(-0.5)),
            "density of voxel (1, 0, 1) is -0.5; it must be finite and not negative",
        ),
        (
            fails(&of(0, MediumValue::Emission), &[-0.5; 72]),
            "volume 0: emission of voxel 0 is [-0.5, -0.5, -0.5]; it must be finite and not negative",
        ),
        (fails(&albedo, &[1.5; 72]), "albedo of voxel 0 is [1.5, 1.5, 1.5]; it must lie in [0, 1]"),
    ] {
        assert!(text.contains(words), "{text}");
    }
    assert_eq!(world.parameter(&density).unwrap(), before, "everything is as it was");
    let twice = [density.clone(), density];
    let text = Adjoint::new(&world, &view(), square(SIDE, 1), &twice).unwrap_err().to_string();
    assert!(text.contains("given twice"), "{text}");
}

#[test]
fn values_of_fewer_channels_stand_for_the_further_ones() {
    let mut world = random(Kind::Box, [3, 2, 4]).world();
    let of = |value| Parameter::Medium { medium: MediumRef::Volume(0), value };
    let (density, albedo) = (of(MediumValue::Extinction), of(MediumValue::Albedo));
    let values: Vec<f32> = (0..48).map(|i| i as f32 / 48.0).collect();
    for (channels, of) in [(1, [0, 0, 0]), (2, [0, 1, 1])] {
        let values = &values[..24 * channels];
        world.spread_parameter(&albedo, channels, values).unwrap();
        let expected: Vec<f32> = values.chunks(channels).flat_map(|v| of.map(|c| v[c])).collect();
        assert_eq!(world.parameter(&albedo).unwrap(), expected);
    }
    world.spread_parameter(&density, 1, &values[..24]).unwrap();
    assert_eq!(world.parameter(&density).unwrap(), values[..24]);
    for (channels, count, words) in [
        (0, 24, "channels: are 0; they must be 1 to 3"),
        (4, 96, "channels: are 4; they must be 1 to 3"),
        (2, 49, "values: are 49; they must be 48"),
        (2, 72, "values: are 72; they must be 48"),
    ] {
        let text = world.spread_parameter(&albedo, channels, &vec![0.5; count]).unwrap_err().to_string();
        assert!(text.contains(words), "{text}");
    }
    let gradient = ParameterGradient { channels: 3, values: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0] };
    assert_eq!(gradient.first_channels(1)[..], [1.0, 4.0]);
    assert_eq!(gradient.first_channels(2)[..], [1.0, 2.0, 4.0, 5.0]);
    assert_eq!(gradient.first_channels(3)[..], gradient.values);
}

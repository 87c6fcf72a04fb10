//! Thick media: gradients against differences, and their noise, to which light gathered along flights must not add where
//! collisions tell enough.

use super::*;

const N: usize = 6;

/// A grid whose voxels differ at random, of a thickness of about 10.
fn smoke() -> Cloud {
    let n = N.pow(3) as u64;
    let density = (0..n).map(|i| 0.05 + 0.95 * noise(i, 10)).collect();
    let albedo = (0..n).map(|i| vec3(0.9, 0.7, 0.5) + Vec3f::splat(0.09 * noise(i, 11))).collect();
    Cloud { size: [N; 3], density, albedo, scale: 10.0, depth: 24, ..Cloud::uniform(Kind::Bounded, 1.0) }
}

/// Variance of the gradient over its square, each summed over the values.
fn relative_variance(cloud: &Cloud, value: MediumValue, channels: usize) -> f64 {
    const RUNS: u64 = 24;
    let world = cloud.world();
    let adjoint = Adjoint::new(&world, &view(), cloud.options(1, 0), &[cloud.kind.parameter(value)]).unwrap();
    let ones = Image::from_fn(SIDE, SIDE, 3, |_, _, _| 1.0);
    let run = |seed| {
        let found = adjoint.render_vjp(&ones, GradientSamples { spp: 16, seed: Some(seed) }).unwrap();
        found.parameters[0].first_channels(channels).into_owned()
    };
    let runs: Vec<Vec<f64>> = (0..RUNS).map(|k| run(700 + k)).collect();
    let mut sums = [0.0; 2];
    for i in 0..runs[0].len() {
        let (mean, error) = statistics(&runs.iter().map(|r| r[i]).collect::<Vec<f64>>());
        sums[0] += error * error * RUNS as f64;
        sums[1] += mean * mean;
    }
    sums[0] / sums[1]
}

#[test]
fn noise_in_thick_media() {
    let cloud = smoke();
    let [albedo, extinction] = [(MediumValue::Albedo, 3), (MediumValue::Extinction, 1)]
        .map(|(value, channels)| relative_variance(&cloud, value, channels));
    println!("variance over the square: albedo {albedo:.4}, extinction {extinction:.4}");
    // Where flights are chosen by throughput and length alone, .037 and 1.6.
    assert!(albedo < 0.028 && extinction < 1.0, "{albedo:.4}, {extinction:.4}");
}

/// [`smoke`] with empty voxels, and with albedos down to 0 in one colour.
fn broken_smoke(kind: Kind) -> Cloud {
    let smoke = smoke();
    let density = smoke.density.iter().enumerate().map(|(i, d)| if i % 7 == 3 { 0.0 } else { *d }).collect();
    let dark = |(i, a): (usize, &Vec3f)| vec3(a.x, a.y, 0.3 * noise(i as u64, 12));
    let albedo = smoke.albedo.iter().enumerate().map(dark).collect();
    Cloud { kind, density, albedo, ..smoke }
}

/// A thin grid with a few thick voxels.
fn sparse(kind: Kind) -> Cloud {
    let density = (0..N.pow(3) as u64).map(|i| if i % 29 == 0 { 5.0 } else { 0.01 * noise(i, 10) }).collect();
    Cloud { kind, density, ..smoke() }
}

/// Extinction and albedo, asked for at once, along one direction each, against differences.
fn check(name: &str, cloud: &Cloud, [spp, reference]: [u32; 2], resolved: f64) {
    let values = [MediumValue::Extinction, MediumValue::Albedo];
    let upper = |voxel: usize| if voxel >= N.pow(3) / 2 { 1.0 } else { 0.0 };
    let found = cloud.replayed_at_once(values, spp, |voxel, _| upper(voxel));
    for (k, value) in values.into_iter().enumerate() {
        let at = |x: f64| {
            let mut moved = cloud.clone();
            for i in 0..N.pow(3) {
                match value {
                    MediumValue::Extinction => moved.density[i] += (x * upper(i)) as f32,
                    _ => moved.albedo[i] = moved.albedo[i].map(|a| a + (x * upper(i)) as f32),
                }
            }
            moved
        };
        let step = if k == 0 { 0.02 } else { 0.004 };
        let b = differences(at, step, true, reference);
        compare(&format!("{name} {:?}, {value:?}", cloud.kind), found[k], b, resolved);
    }
}

#[test]
fn derivatives_of_thick_media_are_those_of_differences() {
    check("smoke", &broken_smoke(Kind::Bounded), [16, 160], 0.3);
}

#[test]
#[ignore = "slow: many samples"]
fn derivatives_of_thick_media_are_those_of_differences_closely() {
    for kind in [Kind::Bounded, Kind::Box] {
        check("smoke", &broken_smoke(kind), [256, 2048], 0.1);
        check("sparse smoke", &sparse(kind), [256, 2048], 0.1);
    }
}

/// Where extinction is beyond all bounds in one colour, the others have the derivatives that they have beside a thick one.
#[test]
fn thickness_without_bounds() {
    let colored = |red: f32| {
        let tint = vec3(red, 0.0, 0.1);
        Cloud { tint, albedo: vec![vec3(0.0, 0.4, 0.4)], depth: 3, ..Cloud::uniform(Kind::Even, 1.0) }
    };
    let step = 0.05;
    let at = |x: f64| Cloud { tint: vec3(5.0, x as f32, 0.1), ..colored(5.0) };
    let green = differences(at, step, true, 512);
    let direction = |_, k| f64::from(u8::from(k == 1));
    let replayed = colored(5.0).replayed(MediumValue::Extinction, 64, direction);
    compare("green beside red of 5", replayed, green, 0.1);
    for c in 1..3 {
        let of =
            |red| colored(red).replayed(MediumValue::Extinction, 256, |_, k| f64::from(u8::from(k == c)));
        let (a, b) = (of(1e20), of(1e3));
        compare(&format!("colour {c} beside red of 1e20 and 1e3"), a, b, 0.2);
    }
    let grid = |thick: f32| {
        let mut density = vec![0.1; N.pow(3)];
        density[N.pow(3) - 1] = thick;
        Cloud { size: [N; 3], density, depth: 3, ..Cloud::uniform(Kind::Bounded, 1.0) }
    };
    let far = |voxel: usize, _: usize| f64::from(u8::from(voxel < 100));
    let of = |thick| grid(thick).replayed(MediumValue::Extinction, 64, far);
    compare("voxels beside one of 1e22 and 1e3", of(1e22), of(1e3), 0.2);
    let own = |thick| {
        let last = |voxel: usize, _: usize| f64::from(u8::from(voxel == N.pow(3) - 1));
        grid(thick).replayed(MediumValue::Extinction, 64, last)
    };
    assert!(own(1e22) == (0.0, 0.0) && own(1.0).0 != 0.0, "more than the most changes nothing");
}

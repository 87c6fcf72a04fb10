//! The step of the product, which takes shots and runs in f32, against the chain in f64 on the same pictures, put together
//! here from what a shot holds.

use super::*;
use crate::engine::views::{Moment, Setup, ViewLight, ViewLights};
use photofit_image::Image;

/// How the environment is turned, radians.
const YAW: f32 = 0.7;

/// Two views of the candidate: from other places, with other lights, the second with backs and under an environment.
fn shots(sampling: Sampling, rng: &mut Uniform) -> [Shot; 2] {
    let eyes = [glam::vec3(0.35, 0.4, 3.6), glam::vec3(-0.6, 0.3, 3.4)];
    let lights = [
        ViewLight::Point { position: vec3(1.0, 1.5, 4.0), intensity: vec3(30.0, 28.0, 25.0) },
        ViewLight::Directional {
            direction: vec3(-0.6, 0.3, 0.74).normalize_or_zero(),
            irradiance: vec3(1.0, 1.1, 1.3),
        },
    ];
    let sky: Vec<f32> = (0..16 * 8 * 3).map(|_| rng.range(0.1, 0.9) as f32).collect();
    let map = std::sync::Arc::new(Environment::from_equirectangular(16, 8, &sky).unwrap());
    std::array::from_fn(|i| {
        let camera = Camera::look_at(eyes[i], glam::Vec3::ZERO, glam::Vec3::Y, 0.62, 1.0, 0.1, 10.0);
        let around = match i {
            0 => ViewLight::Ambient { radiance: vec3(0.2, 0.25, 0.3) },
            _ => ViewLight::Environment { map: map.clone(), yaw: YAW },
        };
        let setup = Setup {
            camera: camera.into(),
            lights: ViewLights(vec![around, lights[i].clone()]),
            moment: Moment::default(),
            width: SIZE,
            height: SIZE,
            picture: None,
            backs: i == 1,
        };
        let shown = Image::from_fn(SIZE, SIZE, 4, |_, _, _| rng.range(0.0, 1.0) as f32);
        Shot::new(&setup, shown, sampling, 5, i as u64)
    })
}

/// The norm of what two lists differ by, over that of the second.
fn difference(found: impl Iterator<Item = f32>, wanted: impl Iterator<Item = f64>) -> f64 {
    let sums =
        found.zip(wanted).fold((0.0, 0.0), |(d, w), (a, b)| (d + (f64::from(a) - b).powi(2), w + b * b));
    (sums.0 / sums.1).sqrt()
}

#[test]
fn the_step_of_the_product_is_the_chain_over_its_shots() {
    for sampling in [Sampling::SUPERSAMPLED, Sampling::ENGINE] {
        check(sampling);
    }
}

fn check(sampling: Sampling) {
    let mut rng = Uniform::new(4);
    let (mut mesh, class) = mesh();
    // The last sheet shows its back, which is seen in one of the views alone.
    let turned = mesh.triangles.iter_mut().zip(&class).filter(|(_, c)| **c == 2);
    turned.for_each(|(t, _)| t.swap(1, 2));
    let smoothing = weld_exact(&mesh.positions);
    let double = maps(Content::Random, &mut rng);
    let single = Maps {
        width: TEXELS,
        height: TEXELS,
        texels: double.texels.iter().map(|t| t.map(|x| x as f32)).collect(),
    };
    let sides = [Sides::Front, Sides::Both, Sides::Front];
    let classes = sides.map(|sides| SurfaceClass { sides, ..SurfaceClass::default() }).to_vec();
    let product = Candidate::<f32>::new(&mesh, &smoothing, class.clone(), classes.clone(), single);
    let chain = Candidate::<f64>::new(&mesh, &smoothing, class, classes, double);
    let (shots, passes) = (shots(sampling, &mut rng), Passes { max_layers: 1, ..Passes::default() });
    let loss = PictureLoss::from(Loss::LogSrgbL1);
    let mut found = product.gradients();
    let value = product.step(&shots, loss, &passes, &mut found);
    let culled = shots.clone().map(|shot| Shot { backs: false, ..shot });
    let other = product.step(&culled, loss, &passes, &mut product.gradients());
    assert!((value / other - 1.0).abs() > 1e-3, "backs are seen: {value} {other}");

    let maps: [Option<Environment<f64>>; 2] = std::array::from_fn(|i| {
        shots[i].lights.0.iter().find_map(|l| match l {
            ViewLight::Environment { map, .. } => Some(map.cast()),
            _ => None,
        })
    });
    let lights: [Vec<Light<'_, f64>>; 2] = std::array::from_fn(|i| {
        let cast = |l: &Light<'_, f32>| match *l {
            Light::Ambient { radiance } => Light::Ambient { radiance: radiance.cast() },
            Light::Point { position, intensity } => {
                Light::Point { position: position.cast(), intensity: intensity.cast() }
            }
            Light::Directional { direction, irradiance } => {
                Light::Directional { direction: direction.cast(), irradiance: irradiance.cast() }
            }
            Light::Environment { .. } => Light::Environment {
                map: maps[i].as_ref().expect("the one of the shot"),
                rotation: Yaw::new(f64::from(YAW)),
                scale: 1.0,
            },
        };
        shots[i].lights.lights().iter().map(cast).collect()
    });
    let backgrounds: [Vec<[f64; 3]>; 2] =
        std::array::from_fn(|i| shots[i].background().iter().map(|b| b.map(f64::from)).collect());
    let picture = |i: usize| {
        let camera = shots[i].camera.pinhole();
        let view = View {
            view_projection: matrix_rows(&camera.view_projection()),
            eye: vec3(f64::from(camera.eye.x), f64::from(camera.eye.y), f64::from(camera.eye.z)),
            lights: &lights[i],
            width: SIZE * sampling.per_axis,
            height: SIZE * sampling.per_axis,
            samples: sampling.per_axis,
            shade_per_pixel: sampling.shade_per_pixel,
            lod_bias: 0.0,
        };
        let (background, vertices) = (&backgrounds[i][..], VertexSource::SHAPE);
        CandidateView { view, background, vertices, backs: i == 1 }
    };
    let compared = |i: usize, pixels: &[[f64; 4]], g: &mut [[f64; 4]]| {
        let over = |(p, b): (&[f32], &[f64; 3])| {
            let [r, g, b2, a] = [p[0], p[1], p[2], p[3]].map(f64::from);
            [r + (1.0 - a) * b[0], g + (1.0 - a) * b[1], b2 + (1.0 - a) * b[2], a]
        };
        let shown = shots[i].shown.data.chunks_exact(4);
        let reference: Vec<[f64; 4]> = shown.zip(&backgrounds[i]).map(over).collect();
        loss.value_and_gradient((SIZE, SIZE), pixels, &reference, 0.5, g)
    };
    let mut wanted = chain.gradients();
    let true_value = chain.pull_back([0, 1].map(picture), compared, &passes, &mut wanted);

    assert!((value / true_value - 1.0).abs() < 1e-5, "{sampling:?}: {value} against {true_value}");
    let texels = |g: &ParameterGradients<f32>| g.rendered.maps.levels[0].texels.clone();
    let maps = difference(
        texels(&found).into_iter().flatten(),
        wanted.rendered.maps.levels[0].texels.as_flattened().iter().copied(),
    );
    let positions = difference(
        found.positions.iter().flat_map(|p| p.to_array()),
        wanted.positions.iter().flat_map(|p| p.to_array()),
    );
    assert!(maps < 1e-3 && positions < 1e-3, "{sampling:?}: maps {maps:.1e}, positions {positions:.1e}");
}

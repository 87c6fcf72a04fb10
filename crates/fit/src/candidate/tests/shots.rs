//! The step of the product, which takes shots and runs in f32, against the chain in f64 on the same pictures, put together
//! here from what a shot holds.

use super::*;
use crate::engine::views::{Moment, Setup, ViewLight, ViewLights};
use photofit_image::Image;

/// Two views of the candidate: from other places, with other lights, the second with backs.
fn shots(rng: &mut Uniform) -> [Shot; 2] {
    let eyes = [glam::vec3(0.35, 0.4, 3.6), glam::vec3(-0.6, 0.3, 3.4)];
    let lights = [
        ViewLight::Point { position: vec3(1.0, 1.5, 4.0), intensity: vec3(30.0, 28.0, 25.0) },
        ViewLight::Directional {
            direction: vec3(-0.6, 0.3, 0.74).normalize_or_zero(),
            irradiance: vec3(1.0, 1.1, 1.3),
        },
    ];
    std::array::from_fn(|i| {
        let camera = Camera::look_at(eyes[i], glam::Vec3::ZERO, glam::Vec3::Y, 0.62, 1.0, 0.1, 10.0);
        let ambient = ViewLight::Ambient { radiance: vec3(0.2, 0.25, 0.3) };
        let setup = Setup {
            camera: camera.into(),
            lights: ViewLights(vec![ambient, lights[i].clone()]),
            moment: Moment::default(),
            width: SIZE,
            height: SIZE,
            picture: None,
            backs: i == 1,
        };
        let shown = Image::from_fn(SIZE, SIZE, 4, |_, _, _| rng.range(0.0, 1.0) as f32);
        Shot::new(&setup, shown, Sampling::SUPERSAMPLED, 5, i as u64)
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
    let mut rng = Uniform::new(4);
    let (mesh, class) = mesh();
    let smoothing = weld_exact(&mesh.positions);
    let double = maps(Content::Random, &mut rng);
    let single = Maps {
        width: TEXELS,
        height: TEXELS,
        texels: double.texels.iter().map(|t| t.map(|x| x as f32)).collect(),
    };
    let classes = vec![SurfaceClass { sides: Sides::Both, ..SurfaceClass::default() }; 3];
    let product = Candidate::<f32>::new(&mesh, &smoothing, class.clone(), classes.clone(), single);
    let chain = Candidate::<f64>::new(&mesh, &smoothing, class, classes, double);
    let (shots, passes) = (shots(&mut rng), Passes { max_layers: 1, ..Passes::default() });
    let loss = PictureLoss::from(Loss::LogSrgbL1);
    let mut found = product.gradients();
    let value = product.step(&shots, loss, &passes, &mut found);

    let lights: [Vec<Light<'_, f64>>; 2] = std::array::from_fn(|i| {
        let cast = |l: &Light<'_, f32>| match *l {
            Light::Ambient { radiance } => Light::Ambient { radiance: radiance.cast() },
            Light::Point { position, intensity } => {
                Light::Point { position: position.cast(), intensity: intensity.cast() }
            }
            Light::Directional { direction, irradiance } => {
                Light::Directional { direction: direction.cast(), irradiance: irradiance.cast() }
            }
            _ => panic!("no shot has another light"),
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
            width: SIZE * SAMPLES,
            height: SIZE * SAMPLES,
            samples: SAMPLES,
            shade_per_pixel: false,
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

    assert!((value / true_value - 1.0).abs() < 1e-5, "{value} against {true_value}");
    let texels = |g: &ParameterGradients<f32>| g.rendered.maps.levels[0].texels.clone();
    let maps = difference(
        texels(&found).into_iter().flatten(),
        wanted.rendered.maps.levels[0].texels.as_flattened().iter().copied(),
    );
    let positions = difference(
        found.positions.iter().flat_map(|p| p.to_array()),
        wanted.positions.iter().flat_map(|p| p.to_array()),
    );
    assert!(maps < 1e-3 && positions < 1e-3, "maps {maps:.1e}, positions {positions:.1e}");
}

//! A box whose walls, lamp and picture on the wall are found again from a picture of it.

mod parameters;
mod resume;
mod volume;

use super::*;
use crate::Silent;
use crate::engine::cpu::Chain;
use crate::engine::loss::PictureLoss;
use crate::engine::traced::{Smoothing, TracedParameter};
use crate::engine::views::Shot;
use crate::progress::Heard;
use glam::Vec3;
use photofit_geometry::shapes;
use photofit_pathtrace::{
    EnvironmentMap, LightSource, Material, MaterialValue, Parameter, Parts, RenderOptions, Shape, View, World,
};
use photofit_scalar::{Vec3f, vec2, vec3};
use photofit_scene::Camera;
use photofit_scene::graph::{Bitmap, SurfaceGraph, SurfaceNode, Texture};
use photofit_scene::{Filter, Wrap};
use photofit_shading::bsdf::{Bsdf, Diffuse};
use std::sync::Arc;
use std::time::Duration;

const SIDE: usize = 24;
const TEXELS: usize = 16;

/// A floor, a wall with a picture, a lamp, under a weak sky.
fn room() -> World {
    let mut parts = Parts::default();
    let gray = |r, g, b| Bsdf::Diffuse(Diffuse { reflectance: vec3(r, g, b) });
    let mut add = |corner, u, v, material| {
        let mut mesh = shapes::parallelogram(corner, u, v);
        mesh.uvs = vec![vec2(0.0, 0.0), vec2(1.0, 0.0), vec2(1.0, 1.0), vec2(0.0, 1.0)];
        parts.add(Shape::Mesh(mesh), material);
    };
    add(vec3(-1.0, 0.0, -1.0), vec3(0.0, 0.0, 2.0), vec3(2.0, 0.0, 0.0), Material::new(gray(0.7, 0.3, 0.2)));
    let picture = Image::from_fn(TEXELS, TEXELS, 3, |x, y, c| {
        if (x / 4 + y / 4) % 2 == 0 { [0.8, 0.2, 0.1][c] } else { [0.15, 0.3, 0.7][c] }
    });
    let image = Arc::new(Bitmap::new(&picture, Wrap::ClampToEdge, Filter::Bilinear));
    let to_uv = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let reflectance = Texture::Bitmap { image, to_uv, scale: 1.0 };
    let wall = SurfaceGraph { root: SurfaceNode::Diffuse { reflectance }, emission: None };
    add(vec3(-1.0, 0.0, -1.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 2.0, 0.0), Material::from_graph(wall));
    let lamp = Material { emission: Vec3f::splat(6.0), ..Material::new(gray(0.0, 0.0, 0.0)) };
    add(vec3(-0.5, 1.9, -0.5), vec3(1.0, 0.0, 0.0), vec3(0.0, 0.0, 1.0), lamp);
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(0.3)));
    World::new(parts).expect("valid")
}

fn view() -> View {
    View::pinhole(&Camera::look_at(
        glam::vec3(0.0, 1.1, 3.2),
        glam::vec3(0.0, 0.9, 0.0),
        Vec3::Y,
        0.75,
        1.0,
        0.1,
        10.0,
    ))
}

fn model(smoothing: Smoothing) -> Traced {
    let value = |material, value| Parameter::Material { materials: vec![material], value };
    let of = |name: &str, parameter, [h, w, c]: [usize; 3], range| TracedParameter {
        name: name.into(),
        parameter,
        shape: [1, h, w, c],
        range,
    };
    let parameters = vec![
        of("floor", value(0, MaterialValue::Reflectance), [1, 1, 3], [0.0, 1.0]),
        of("wall", Parameter::Graph { places: vec![[1, 0]] }, [TEXELS, TEXELS, 3], [0.0, 1.0]),
        of("lamp", value(2, MaterialValue::Emission), [1, 1, 3], [0.0, 1e6]),
    ];
    let mut options = RenderOptions { width: SIDE, height: SIDE, spp: 8, ..RenderOptions::default() };
    options.path.max_depth = 3;
    let mut model = Traced::new(room(), options, parameters).expect("valid");
    model.smoothing = smoothing;
    model
}

fn rmse(a: &[f32], b: &[f32]) -> f64 {
    (a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

/// The target, and the errors of the parameters before and after a fit from grey.
fn run(smoothing: Smoothing, threads: usize) -> (RecoveredScene, Vec<[f64; 2]>) {
    let mut model = model(smoothing);
    let target = model.picture(&view(), 512, 99).expect("rendered");
    let truth: Vec<Vec<f32>> = (0..3).map(|k| model.of(k).to_vec()).collect();
    for (k, start) in [0.5, 0.5, 3.0].into_iter().enumerate() {
        model.replace(k, &vec![start; truth[k].len()]).expect("valid");
    }
    let start: Vec<f64> = (0..3).map(|k| rmse(model.of(k), &truth[k])).collect();
    let options = RecoverSceneOptions { steps: 120, ..RecoverSceneOptions::default() };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let r = pool.install(|| recover_scene(model, &[view()], &[target], &options, &Silent)).expect("fits");
    let errors = (0..3).map(|k| [start[k], rmse(r.model.of(k), &truth[k])]).collect();
    (r, errors)
}

#[test]
fn colours_light_and_texture_are_found_again() {
    let (r, errors) = run(Smoothing::Bilateral, 2);
    println!("{errors:?}, {:?}", r.history.iter().map(|h| h.quality).collect::<Vec<_>>());
    assert_eq!(r.held_out, None, "of one picture none is held out");
    // Colour and light of the room, and the picture on the wall as far as 24 pixels show 16 texels.
    assert!(errors[0][1] < 0.3 * errors[0][0], "floor {errors:?}");
    assert!(errors[1][1] < 0.65 * errors[1][0], "wall {errors:?}");
    assert!(errors[2][1] < 0.35 * errors[2][0], "lamp {errors:?}");
    let first = r.history.first().expect("an evaluation").quality;
    let best = r.history.iter().map(|h| h.quality).fold(first, f64::max);
    assert!(best > first + 6.0, "{first} {best}");
}

#[test]
fn the_plan_tells_the_steps_that_were_made() {
    let target = model(Smoothing::Laplacian).picture(&view(), 4, 99).expect("rendered");
    for (limit, made) in [(None, 2), (Some(Duration::ZERO), 0)] {
        let checkpointing = Checkpointing { time_limit: limit, ..Checkpointing::default() };
        let options = RecoverSceneOptions { steps: 2, checkpointing, ..RecoverSceneOptions::default() };
        let r = recover_scene(
            model(Smoothing::Laplacian),
            &[view()],
            std::slice::from_ref(&target),
            &options,
            &Silent,
        )
        .expect("fits");
        assert_eq!((r.steps, r.plan.phases.len()), (made, usize::from(made > 0)));
        for what in ["material gradients", "texture gradients", "smoothed steps"] {
            assert_eq!(r.plan.runs(what), Some((made > 0).into()), "{what}: {}", r.plan);
        }
    }
}

#[test]
fn the_plan_names_what_narrows_what_stays_and_what_is_too_small() {
    let model_of = |smoothing, rows: usize| {
        let mut world = room();
        let sky = Image::from_fn(2 * rows, rows, 3, |x, _, _| 0.2 + 0.01 * x as f32);
        world.relight(&[], Some(EnvironmentMap::new(sky))).expect("valid");
        let mut parameters = model(smoothing).parameters;
        parameters.pop();
        let (name, shape) = ("sky".into(), [1, rows, 2 * rows, 3]);
        parameters.push(TracedParameter {
            name,
            parameter: Parameter::Environment,
            shape,
            range: [1e-4, 1e6],
        });
        let mut model = Traced::new(world, RenderOptions::default(), parameters).expect("valid");
        model.smoothing = smoothing;
        model
    };
    let cases = [
        (Smoothing::Narrowing, 16, "narrowing: wall; bilateral: sky"),
        (Smoothing::Narrowing, 8, "narrowing: wall; too few cells for a filter: sky"),
        (Smoothing::Bilateral, 16, "bilateral: wall, sky"),
        (Smoothing::Laplacian, 8, "laplacian: wall; too few cells for a filter: sky"),
        (Smoothing::None, 16, "not asked for"),
    ];
    for (smoothing, rows, why) in cases {
        let item = smoothed(&model_of(smoothing, rows), true);
        assert_eq!((item.runs, &item.why[..]), ((smoothing != Smoothing::None).into(), why));
    }
}

#[test]
fn the_same_bits_on_one_thread_and_two() {
    let values = |threads| {
        let (r, _) = run(Smoothing::None, threads);
        (0..3).flat_map(|k| r.model.of(k).to_vec()).map(f32::to_bits).collect::<Vec<_>>()
    };
    assert_eq!(values(1), values(2));
}

/// A white picture that is to be reached.
fn white_shot() -> Shot {
    let image = Image::from_fn(SIDE, SIDE, 4, |_, _, _| 1.0);
    let given = GivenPicture { camera: ViewCamera::Traced(view()), lights: ViewLights::default(), image };
    Shot::new(&given.setup(0), given.image.clone(), Sampling::SUPERSAMPLED, 0, 0)
}

#[test]
fn a_corrected_texture_moves_in_cells_and_keeps_its_detail() {
    const PICTURE: usize = 1;
    let mut m = model(Smoothing::Bilateral);
    assert_eq!(m.parameters[PICTURE].cells(), TEXELS * TEXELS);
    let step = |m: &Traced| {
        let mut out = m.gradients();
        let shots = [white_shot()];
        m.step(&shots, PictureLoss::RELATIVE_SQUARES, &[true; 3], &mut out).expect("a step");
        out.swap_remove(PICTURE)
    };
    let (plain, detail) = (step(&m), m.of(PICTURE).to_vec());
    m.correct(PICTURE, TEXELS, true);
    let groups = Chain::groups(&m);
    assert_eq!((groups[PICTURE].rows, groups[PICTURE].columns), (1, 3));
    // One cell: the derivative of a factor of all texels is the sum over them.
    let found = step(&m);
    for c in 0..3 {
        let of = |k: &usize| k % 3 == c;
        let wanted: f64 =
            (0..detail.len()).filter(of).map(|k| f64::from(plain[k]) * f64::from(detail[k])).sum();
        assert!((f64::from(found[c]) - wanted).abs() <= 1e-4 * wanted.abs(), "{} {wanted}", found[c]);
    }
    m.values_mut(PICTURE).fill(0.9_f32.ln());
    m.changed(PICTURE).expect("valid");
    let held = m.world().parameter(&m.parameters[PICTURE].parameter).expect("there");
    for ((v, w), d) in m.of(PICTURE).iter().zip(&held).zip(&detail) {
        assert!((v - 0.9 * d).abs() < 1e-5 && (w - v).abs() < 1e-5, "{v} {w} of {d}");
    }
    // Values that are set begin anew.
    m.replace(PICTURE, &detail).expect("valid");
    assert!(Chain::values(&m, PICTURE).iter().all(|v| *v == 0.0) && m.of(PICTURE) == detail);
}

#[test]
fn narrowing_filters_find_the_room_too() {
    let (r, errors) = run(Smoothing::Narrowing, 2);
    println!("{errors:?}");
    assert!(errors.iter().zip([0.3, 0.65, 0.35]).all(|(e, most)| e[1] < most * e[0]), "{errors:?}");
    let mut model = r.model;
    assert!(model.phase_share(0.0), "filters were narrower at the end");
}

#[test]
fn moments_that_are_filtered_have_decays_that_belong_to_each_other() {
    let mut m = model(Smoothing::Bilateral);
    let groups = Chain::groups(&m);
    let mut longest = |smoothing, group: usize| {
        m.smoothing = smoothing;
        let mut optimizer = m.optimizer(&groups[group]).expect("made");
        let mut values = vec![0.5; groups[group].len()];
        for _ in 0..20 {
            optimizer.step(&mut values, &vec![1.0; groups[group].len()], 0.0).expect("a step");
        }
        let before = values.clone();
        optimizer.step(&mut values, &vec![1e3; groups[group].len()], 0.01).expect("a step");
        (values[0] - before[0]).abs() / 0.01
    };
    let (floor, wall) = (0, 1);
    // A gradient that is suddenly large moves by about the rate; with a long memory of squares by several times that.
    for smoothing in [Smoothing::Bilateral, Smoothing::Narrowing] {
        let (filtered, alone) = (longest(smoothing, wall), longest(smoothing, floor));
        assert!((0.9..1.07).contains(&filtered) && alone > 2.0, "{filtered} {alone}");
    }
    for smoothing in [Smoothing::None, Smoothing::Laplacian] {
        assert!(longest(smoothing, wall) > 2.0, "{smoothing:?}");
    }
}

#[test]
fn filters_of_textures_narrow_until_there_is_none() {
    let mut m = model(Smoothing::Narrowing);
    let mut changes = Vec::new();
    for step in 0..60 {
        if m.phase_share(f64::from(step) / 60.0) {
            changes.push(step);
        }
    }
    // One level of 16 texels, and none: two parts.
    assert_eq!(changes, [30]);
    assert!(!m.phase_share(1.0), "the last part is the end");
    assert!(m.phase_share(0.0), "and back");
    for other in [Smoothing::None, Smoothing::Laplacian, Smoothing::Bilateral] {
        m.smoothing = other;
        assert!(!m.phase_share(0.5) && !m.phase_share(0.0), "{other:?} stays as it is");
    }
}

#[test]
fn parameters_that_move_in_logarithms_have_their_derivatives() {
    const LAMP: usize = 2;
    let shot = white_shot();
    let gradient = |m: &Traced| {
        let mut out = m.gradients();
        m.step(std::slice::from_ref(&shot), PictureLoss::RELATIVE_SQUARES, &[true; 3], &mut out)
            .expect("a step");
        out
    };
    let mut m = model(Smoothing::None);
    let plain = gradient(&m);
    assert!(
        m.move_in_logarithms(LAMP).unwrap_err().to_string().contains("lamp is 0 to"),
        "0 has no logarithm"
    );
    m.parameters[LAMP].range = [0.5, 100.0];
    m.move_in_logarithms(LAMP).expect("a range above 0");
    assert!(m.moves_in_logarithms(LAMP) && !m.moves_in_logarithms(0));
    assert!(Chain::groups(&m)[LAMP].ranges.iter().all(|r| *r == [0.5_f32.ln(), 100.0_f32.ln()]));
    let value = m.of(LAMP)[0];
    assert_eq!(value, 6.0);
    let other = gradient(&m);
    assert!(other[0] == plain[0] && other[1] == plain[1], "the others move as they are");
    for (a, b) in plain[LAMP].iter().zip(&other[LAMP]) {
        assert!(*a != 0.0 && (b - a * value).abs() <= 1e-5 * b.abs(), "{a} {b}");
    }
    // A step of a logarithm is a factor, of the world too; values beyond the range come back into it.
    m.values_mut(LAMP).iter_mut().for_each(|v| *v += 0.5);
    m.changed(LAMP).expect("valid");
    let expected = 6.0 * 0.5_f32.exp();
    let held = m.world().parameter(&m.parameters[LAMP].parameter).expect("there");
    assert!(m.of(LAMP).iter().chain(&held).all(|v| (v - expected).abs() < 1e-4), "{held:?}");
    m.replace(LAMP, &[2.0; 3]).expect("valid");
    assert!(Chain::values(&m, LAMP).iter().all(|v| *v == 2.0_f32.ln()));
}

#[test]
fn pictures_that_do_not_fit_are_refused() {
    let m = || model(Smoothing::None);
    let fails = |pictures: &[Image]| {
        recover_scene(m(), &[view()], pictures, &RecoverSceneOptions::default(), &Silent)
            .unwrap_err()
            .to_string()
    };
    assert!(fails(&[]).contains("one per view"));
    assert!(fails(&[Image::new(8, 8, 4)]).contains("8 x 8"));
    let mut nan = Image::new(SIDE, SIDE, 4);
    nan.data[4 * 30 + 1] = f32::NAN;
    assert!(fails(&[nan]).contains("(6, 1)"));
}

#[test]
fn light_that_is_no_number_is_told_once() {
    let target = model(Smoothing::None).picture(&view(), 8, 99).expect("rendered");
    let told = |intensity: f32| {
        let mut model = model(Smoothing::None);
        let lamp = LightSource::Point {
            position: glam::DVec3::new(0.0, 0.1, 0.0),
            intensity: Vec3f::splat(intensity),
        };
        model.world_mut().relight(&[lamp], None).expect("valid");
        let options = RecoverSceneOptions { steps: 0, ..RecoverSceneOptions::default() };
        let heard = Heard::default();
        recover_scene(model, &[view()], std::slice::from_ref(&target), &options, &heard).expect("fits");
        heard.0.into_inner().expect("not poisoned")
    };
    assert_eq!(told(1.0), [""; 0]);
    let told = told(3e38);
    assert!(told.len() == 1 && told[0].contains("contributions were not finite"), "{told:?}");
}

//! Every kind of parameter, several views, high dynamic range, starts in the dark.

use super::*;
use photofit_pathtrace::LightSource;
use photofit_scene::{
    Instance, MapKind, Material as SceneMaterial, Primitive, Scene, TextureImage, TextureSlot,
};

/// Width and height of pictures and of the map.
const PIXELS: usize = 16;
const MAP: usize = 8;

/// A painted floor and a ball of the library under a point light and a sky that is turned and scaled.
pub(super) fn hall() -> World {
    let texel = |i: usize| {
        let (x, y) = (i % MAP, i / MAP);
        if (x / 4 + y / 4) % 2 == 0 { [210, 150, 90, 255] } else { [90, 130, 200, 255] }
    };
    let slot = TextureSlot::new(0);
    let floor = SceneMaterial { base_color_texture: Some(slot), ..SceneMaterial::clay() };
    hall_of(SceneMaterial { base_color: [1.0; 4], ..floor }, texel)
}

/// The same with this material and map of the floor.
fn hall_of(floor: SceneMaterial, texel: impl Fn(usize) -> [u8; 4]) -> World {
    let ball = SceneMaterial { roughness: 0.3, metallic: 1.0, ..SceneMaterial::clay() };
    let mut ground = shapes::parallelogram(vec3(-1.5, -0.5, 1.5), vec3(3.0, 0.0, 0.0), vec3(0.0, 0.0, -3.0));
    ground.uvs = vec![vec2(0.0, 0.0), vec2(1.0, 0.0), vec2(1.0, 1.0), vec2(0.0, 1.0)];
    let ball_mesh = shapes::uv_sphere(24, 12);
    let ball_at =
        glam::Affine3A::from_scale_rotation_translation(Vec3::splat(0.5), glam::Quat::IDENTITY, Vec3::ZERO);
    let scene = Scene {
        primitives: vec![Primitive { mesh: ground, material: 0 }, Primitive { mesh: ball_mesh, material: 1 }],
        instances: vec![
            Instance { primitive: 0, transform: glam::Affine3A::IDENTITY },
            Instance { primitive: 1, transform: ball_at },
        ],
        materials: vec![floor, ball],
        images: vec![TextureImage {
            width: MAP,
            height: MAP,
            texels: (0..MAP * MAP).map(texel).collect(),
            ..TextureImage::default()
        }],
        ..Scene::default()
    };
    let mut parts = Parts::from_scene(&scene);
    let position = glam::DVec3::new(1.0, 1.5, 1.2);
    parts.lights.push(LightSource::Point { position, intensity: vec3(15.0, 12.0, 9.0) });
    let sky = Image::from_fn(4, 2, 3, |x, y, c| 0.2 + if y == 0 { 0.1 * ((x + c) % 3) as f32 } else { 0.0 });
    let rotation = glam::Quat::from_rotation_y(0.7) * glam::Quat::from_rotation_x(0.3);
    parts.environment = Some(EnvironmentMap { scale: 1.37, rotation, ..EnvironmentMap::new(sky) });
    World::new(parts).expect("valid")
}

/// Cameras around the hall.
pub(super) fn around(count: usize) -> Vec<View> {
    let at = |k: usize| {
        let angle = 0.4 + 1.3 * k as f32;
        let eye = glam::vec3(2.6 * angle.sin(), 1.3, 2.6 * angle.cos());
        View::pinhole(&Camera::look_at(eye, glam::vec3(0.0, -0.1, 0.0), Vec3::Y, 0.8, 1.0, 0.1, 10.0))
    };
    (0..count).map(at).collect()
}

/// The hall with parameters of all kinds.
pub(super) fn hall_model() -> Traced {
    let world = hall();
    let library = world.library().expect("an asset");
    let texture = library.texture_of(0, MapKind::BaseColor).expect("a map");
    let factor = |material, value| Parameter::Material { materials: vec![material], value };
    let of = |name: &str, parameter, [h, w, c]: [usize; 3], range| TracedParameter {
        name: name.into(),
        parameter,
        shape: [1, h, w, c],
        range,
    };
    let parameters = vec![
        of("floor texels", Parameter::Texels { texture }, [MAP, MAP, 3], [1e-3, 1.0]),
        of("ball colour", factor(1, MaterialValue::BaseColor), [1, 1, 3], [1e-3, 1.0]),
        of("ball roughness", factor(1, MaterialValue::Roughness), [1, 1, 1], [0.03, 1.0]),
        of("light", Parameter::Light { light: 0 }, [1, 1, 3], [1e-4, 1e6]),
        of("sky", Parameter::Environment, [2, 4, 3], [1e-4, 1e6]),
    ];
    let mut options = RenderOptions { width: PIXELS, height: PIXELS, spp: 8, ..RenderOptions::default() };
    options.path.max_depth = 3;
    let mut model = Traced::new(world, options, parameters).expect("valid");
    (model.smoothing, model.gradient_spp) = (Smoothing::None, 2);
    model
}

/// Recovers from flat values: errors of the parameters before and after.
fn again(mut model: Traced, views: &[View], starts: &[f32], steps: u64) -> (RecoveredScene, Vec<[f64; 2]>) {
    let target = |v| model.picture(v, 512, 99).expect("rendered");
    let targets: Vec<Image> = views.iter().map(target).collect();
    let all = 0..model.parameters.len();
    let truth: Vec<Vec<f32>> = all.clone().map(|k| model.of(k).to_vec()).collect();
    for k in all.clone() {
        model.replace(k, &vec![starts[k]; truth[k].len()]).expect("valid");
    }
    let first: Vec<f64> = all.clone().map(|k| rmse(model.of(k), &truth[k])).collect();
    let options = RecoverSceneOptions { steps, ..RecoverSceneOptions::default() };
    let r = recover_scene(model, views, &targets, &options, &Silent).expect("fits");
    let errors = all.map(|k| [first[k], rmse(r.model.of(k), &truth[k])]).collect();
    (r, errors)
}

#[test]
fn texels_factors_numbers_lights_and_skies_are_found_from_two_views() {
    let (r, errors) = again(hall_model(), &around(2), &[0.4, 0.3, 0.6, 6.0, 0.5], 150);
    println!("{errors:?} {:?}", r.history.iter().map(|h| h.quality).collect::<Vec<_>>());
    assert_eq!(r.held_out, None, "of two pictures none is held out");
    // A brighter light over a darker floor looks nearly the same: what they are together is found first.
    let bounds = [0.75, 0.5, 0.5, 0.8, 0.75];
    for (k, bound) in bounds.into_iter().enumerate() {
        assert!(errors[k][1] < bound * errors[k][0], "{}: {:?}", r.model.parameters[k].name, errors[k]);
    }
    let error = |h: &HistoryPoint| relative_error(h.quality);
    let best = r.history.iter().map(error).fold(f64::INFINITY, f64::min);
    assert!(best < 0.1 * error(&r.history[0]), "{best} of {}", error(&r.history[0]));
}

/// Texels of a mirror have no derivative of their own below the least roughness: the fit starts there, and never leaves them below it.
#[test]
fn texels_of_a_mirror_become_rough() {
    let slot = TextureSlot::new(0);
    let floor = SceneMaterial { metallic_roughness_texture: Some(slot), ..SceneMaterial::clay() };
    let floor = SceneMaterial { base_color: [0.8, 0.8, 0.8, 1.0], roughness: 0.8, metallic: 1.0, ..floor };
    let world = || hall_of(floor.clone(), |_| [255, 150, 255, 255]);
    let texture = world().library().and_then(|l| l.texture_of(0, MapKind::MetallicRoughness)).expect("a map");
    let parameter = TracedParameter {
        name: "map".into(),
        parameter: Parameter::Texels { texture },
        shape: [1, MAP, MAP, 3],
        range: [0.0, 1.0],
    };
    let factor = Parameter::Material { materials: vec![0], value: MaterialValue::Roughness };
    for map in [MapKind::BaseColor, MapKind::Emissive, MapKind::Normal] {
        let parameter = Parameter::Texels { texture };
        let reads = SceneMaterial { metallic_roughness_texture: None, ..floor.clone() };
        let reads = match map {
            MapKind::BaseColor => SceneMaterial { base_color_texture: Some(slot), ..reads },
            MapKind::Emissive => SceneMaterial { emissive_texture: Some(slot), emissive: [1.0; 3], ..reads },
            _ => SceneMaterial { normal_texture: Some(slot), ..reads },
        };
        let range = hall_of(reads, |_| [0, 0, 0, 255]).effective_range(&parameter);
        assert_eq!(range, [[f32::NEG_INFINITY, f32::INFINITY]; 3], "{map:?}");
    }
    let faint = hall_of(SceneMaterial { roughness: 0.1, ..floor.clone() }, |_| [255, 150, 255, 255]);
    let [_, [least, _], _] = faint.effective_range(&Parameter::Texels { texture });
    assert!((least - 0.06).abs() < 1e-6, "at most twice the least roughness: {least}");
    let [least, _] = world().effective_range(&factor)[0];
    assert!((least * 150.0 / 255.0 - 0.03).abs() < 1e-6, "of the factor: {least}");
    let mut options = RenderOptions { width: PIXELS, height: PIXELS, spp: 8, ..RenderOptions::default() };
    options.path.max_depth = 3;
    for cell in [None, Some(2)] {
        let parameters = vec![parameter.clone()];
        let mut model = Traced::new(world(), options.clone(), parameters).expect("valid");
        (model.smoothing, model.gradient_spp) = (Smoothing::None, 4);
        let [red, [least, most], blue] = model.ranges(0)[..] else { panic!("three channels") };
        assert_eq!([red, blue, [0.0, most]], [[0.0, 1.0]; 3], "of roughness alone");
        assert!((least * 0.8 - 0.03).abs() < 1e-6 && least * 0.8 > 0.03, "with its factor: {least}");
        let targets: Vec<Image> =
            around(2).iter().map(|v| model.picture(v, 256, 99).expect("rendered")).collect();
        if let Some(side) = cell {
            model.correct(0, side, false);
        }
        model.replace(0, &[1.0, 0.0, 1.0].repeat(MAP * MAP)).expect("valid");
        let options = RecoverSceneOptions { steps: 120, ..RecoverSceneOptions::default() };
        let r = recover_scene(model, &around(2), &targets, &options, &Silent).expect("fits");
        let roughness: Vec<f32> = r.model.of(0).iter().skip(1).step_by(3).copied().collect();
        let error = |start: Option<f32>| {
            let off = |r: &f32| f64::from(start.unwrap_or(*r) - 150.0 / 255.0).powi(2);
            roughness.iter().map(off).sum::<f64>().sqrt()
        };
        assert!(error(None) < 0.75 * error(Some(0.0)), "{cell:?}: {roughness:?}");
    }
}

#[test]
fn the_last_of_four_views_is_held_out() {
    let target = |v| hall_model().picture(v, 64, 99).expect("rendered");
    let mut targets: Vec<Image> = around(4).iter().map(target).collect();
    let options = RecoverSceneOptions { steps: 4, ..RecoverSceneOptions::default() };
    let fit = |targets: &[Image]| {
        let mut m = hall_model();
        m.replace(1, &[0.2; 3]).expect("valid");
        recover_scene(m, &around(4), targets, &options, &Silent).expect("fits")
    };
    let a = fit(&targets);
    assert_eq!(a.held_out, Some(3));
    // What is held out changes what is told, and no step.
    targets[3].data.iter_mut().for_each(|v| *v *= 1.01);
    let b = fit(&targets);
    let losses = |r: &RecoveredScene| r.history.iter().map(|h| h.loss.to_bits()).collect::<Vec<_>>();
    assert_eq!(losses(&a), losses(&b), "no loss sees it");
    assert_ne!(a.history[0].quality.to_bits(), b.history[0].quality.to_bits(), "the evaluations see it");
    targets[1].data.iter_mut().for_each(|v| *v *= 1.01);
    assert_ne!(losses(&a), losses(&fit(&targets)), "the losses see the others");
}

#[test]
fn pictures_that_changed_places_are_told() {
    let mut targets: Vec<Image> =
        around(4).iter().map(|v| hall_model().picture(v, 64, 99).expect("rendered")).collect();
    let warned = |targets: &[Image]| {
        let mut m = hall_model();
        for (k, start) in [0.4, 0.3, 0.6, 6.0, 0.5].into_iter().enumerate() {
            let count = m.of(k).len();
            m.replace(k, &vec![start; count]).expect("valid");
        }
        let options = RecoverSceneOptions { steps: 0, ..RecoverSceneOptions::default() };
        let heard = Heard::default();
        recover_scene(m, &around(4), targets, &options, &heard).expect("fits");
        heard.0.into_inner().expect("not poisoned")
    };
    assert_eq!(warned(&targets), [""; 0]);
    targets.swap(0, 3);
    let text = warned(&targets).join("; ");
    assert!(text.contains("pictures 0 and 3 look like what cameras 3 and 0 see"), "{text}");
}

/// A room of which nothing is seen but a sky.
fn bright(radiance: f32) -> Traced {
    let parts =
        Parts { environment: Some(EnvironmentMap::constant(Vec3f::splat(radiance))), ..Parts::default() };
    let parameter = TracedParameter {
        name: "sky".into(),
        parameter: Parameter::Environment,
        shape: [1, 1, 1, 3],
        range: [0.0, 1e6],
    };
    let options = RenderOptions { width: 4, height: 4, spp: 1, ..RenderOptions::default() };
    Traced::new(World::new(parts).expect("valid"), options, vec![parameter]).expect("valid")
}

#[test]
fn light_above_white_is_told_apart() {
    // On a screen, 30 and 10 are the same white: the start would be the best state.
    let (_, errors) = again(bright(30.0), &[view()], &[10.0], 150);
    assert!(errors[0][1] < 0.1 * errors[0][0], "{errors:?}");
}

#[test]
fn what_is_black_at_the_start_is_found_where_its_range_begins_above_0() {
    let mut model = model(Smoothing::None);
    model.parameters.remove(1);
    let above = |p: &TracedParameter| TracedParameter { range: [1e-4, p.range[1]], ..p.clone() };
    let parameters = model.parameters.iter().map(above).collect();
    let options = model.options.clone();
    let model = Traced::new(model.into_world(), options, parameters).expect("valid");
    let (_, errors) = again(model, &[view()], &[0.5, 0.0], 400);
    assert!(errors[1][1] < 0.3 * errors[1][0], "lamp {errors:?}");
}

#[test]
fn light_that_starts_or_ends_at_0_is_an_error() {
    let target = bright(1.0).picture(&view(), 1, 0).expect("rendered");
    let mut dark = bright(1.0);
    dark.replace(0, &[0.0; 3]).expect("valid");
    let options = RecoverSceneOptions::default();
    let text = recover_scene(dark, &[view()], &[target], &options, &Silent).unwrap_err().to_string();
    assert!(text.contains("sky") && text.contains("start above"), "{text}");
    // The only light goes out during the fit: the target is black.
    let options = RecoverSceneOptions { rate: 1.0, steps: 100, ..RecoverSceneOptions::default() };
    let text = recover_scene(bright(0.5), &[view()], &[Image::new(4, 4, 4)], &options, &Silent)
        .unwrap_err()
        .to_string();
    assert!(text.contains("step") && text.contains("no light") && text.contains("checkpoint"), "{text}");
}

//! Names and quantities of keys.

use super::*;
use photofit_scene::mitsuba::{MitsubaOptions, load_mitsuba};
use photofit_scene::{Material, TextureImage, TextureSlot};

fn names(keys: &[Key]) -> Vec<&str> {
    keys.iter().map(|k| k.name.as_str()).collect()
}

#[test]
fn names_that_occur_often_get_numbers_that_no_other_has() {
    let list = |names: &[&str]| unique(&names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>());
    assert_eq!(list(&["a", "b"]), ["a", "b"]);
    assert_eq!(list(&["a", "a", "a_1"]), ["a_0", "a_1_", "a_1"]);
    assert_eq!(list(&["a_1", "a", "a", "a_1"]), ["a_1_0", "a_1", "a_2", "a_1_3"]);
}

#[test]
fn keys_of_assets_are_unique_and_stay_when_others_come() {
    let material = |name: &str| Material { name: name.into(), ..Material::clay() };
    let light = || PunctualLight {
        name: "lamp".into(),
        kind: LightKind::Point,
        intensity: [1.0; 3],
        position: glam::Vec3::Y,
        direction: glam::Vec3::NEG_Y,
        range: None,
        picture: None,
    };
    let mut scene = Scene {
        materials: ["a", "a", "a_1", ""].map(material).to_vec(),
        lights: vec![light(), light()],
        ..Scene::default()
    };
    let of = |scene: &Scene| of_asset(scene, &Parts::from_scene(scene));
    let keys = of(&scene);
    for key in ["a_0.base_color", "a_1_.base_color", "a_1.base_color", "material_3.base_color"] {
        assert!(names(&keys).contains(&key), "{key} in {:?}", names(&keys));
    }
    for key in ["lamp_0.intensity", "lamp_1.intensity"] {
        assert!(names(&keys).contains(&key), "{key} in {:?}", names(&keys));
    }
    let different: HashSet<&str> = names(&keys).into_iter().collect();
    assert_eq!(different.len(), keys.len(), "{:?}", names(&keys));
    let parameters: HashSet<&Parameter> = keys.iter().map(|k| &k.parameter).collect();
    assert_eq!(parameters.len(), keys.len(), "one key for each parameter");
    scene.materials.push(material("b"));
    let more = of(&scene);
    assert!(names(&keys).iter().all(|k| names(&more).contains(k)), "{:?}", names(&more));
}

#[test]
fn what_keys_are_follows_from_their_parameters_not_from_their_names() {
    let scene = Scene {
        materials: vec![Material { name: "x.alpha.radiance".into(), ..Material::clay() }],
        ..Scene::default()
    };
    let keys = of_asset(&scene, &Parts::from_scene(&scene));
    let of = |name: &str| keys.iter().find(|k| k.name == name).map(|k| (k.quantity, k.dark)).expect(name);
    assert_eq!(of("x.alpha.radiance.base_color"), (Quantity::Color, false));
    assert_eq!(of("x.alpha.radiance.roughness"), (Quantity::Roughness, false));
    assert_eq!(of("x.alpha.radiance.metallic"), (Quantity::Metallic, false));
    assert_eq!(of("x.alpha.radiance.emissive"), (Quantity::Radiance, true), "black at first");
}

/// A Mitsuba scene of spheres with these materials.
fn mitsuba(bsdfs: &str) -> Vec<Key> {
    let text = format!(
        "<scene version='3.0.0'><integrator type='path'/><sensor type='perspective'/>{bsdfs}
         <emitter type='constant' id='sky'/></scene>"
    );
    let dir = tempfile::tempdir().expect("a folder");
    let file = dir.path().join("s.xml");
    std::fs::write(&file, text).expect("written");
    of_mitsuba(&load_mitsuba(&file, &MitsubaOptions::default()).expect("a scene"))
}

fn sphere(id: &str, inside: &str) -> String {
    format!("<shape type='sphere' id='{id}'>{inside}</shape>")
}

#[test]
fn anisotropic_metals_never_share_one_alpha() {
    let alphas = "<float name='alpha_u' value='0.2'/><float name='alpha_v' value='0.4'/>";
    let metal = |values: &str| format!("<bsdf type='roughconductor' id='metal'>{values}</bsdf>");
    let keys = mitsuba(&sphere("a", &metal(alphas)));
    let found = names(&keys);
    // Without a texture it is a tree of one constant: its alphas are no parameter, least of all one for both.
    assert!(!found.iter().any(|k| k.contains(".alpha")), "{found:?}");
    let keys = mitsuba(&sphere("a", &metal("<float name='alpha' value='0.2'/>")));
    assert!(names(&keys).contains(&"metal.alpha.value"), "{:?}", names(&keys));
    // With a reflectance that varies the same metal is a tree.
    let checks = "<texture type='checkerboard' name='specular_reflectance'/>";
    let varied = |values: &str| mitsuba(&sphere("a", &metal(&format!("{checks}{values}"))));
    let keys = varied(alphas);
    let count = |keys: &[Key], end: &str| keys.iter().filter(|k| k.name.ends_with(end)).count();
    assert_eq!(
        [count(&keys, ".alpha_u.value"), count(&keys, ".alpha_v.value")],
        [1, 1],
        "{:?}",
        names(&keys)
    );
    let keys = varied("<float name='alpha' value='0.2'/>");
    let Some(Key { parameter: Parameter::Graph { places }, .. }) =
        keys.iter().find(|k| k.name.ends_with(".alpha.value"))
    else {
        panic!("{:?}", names(&keys));
    };
    assert_eq!(places.len(), 2, "one value in two places");
}

#[test]
fn black_emitters_are_keys_that_have_to_be_lifted() {
    let lamp = "<emitter type='area'><rgb name='radiance' value='0'/></emitter>";
    let keys = mitsuba(&sphere("ball", lamp));
    let key = keys.iter().find(|k| k.name == "ball.emitter.radiance.value").expect("a key");
    assert!(key.dark && key.quantity == Quantity::Radiance);
}

/// Libraries do not read maps that a factor of 0 hides, so that a raised factor would glow evenly.
#[test]
fn black_factors_of_maps_are_refused() {
    let keys = |emissive: f32, [roughness, metallic]: [f32; 2], unlit: bool| {
        let slot = Some(TextureSlot::new(0));
        let mapped = Material {
            name: "a".into(),
            emissive: [emissive; 3],
            emissive_texture: slot,
            roughness,
            metallic,
            unlit,
            metallic_roughness_texture: slot,
            ..Material::clay()
        };
        let image = TextureImage { width: 1, height: 1, texels: vec![[255; 4]], ..TextureImage::default() };
        let scene = Scene { materials: vec![mapped], images: vec![image], ..Scene::default() };
        of_asset(&scene, &Parts::from_scene(&scene))
    };
    let idle = |keys: &[Key]| {
        ["emissive", "roughness", "metallic"].map(|value| {
            let name = format!("a.{value}");
            keys.iter().any(|k| k.name == name && k.idle.is_some_and(|rule| rule.contains("not read")))
        })
    };
    let maps = |keys: &[Key]| names(keys).into_iter().filter(|n| n.ends_with("_texture")).count();
    for (emissive, factors, unlit, hidden, read) in [
        (1e-3, [0.5, 0.0], false, [false; 3], 2),
        (1e-3, [0.0, 0.5], false, [false; 3], 2),
        (0.0, [0.5, 0.0], false, [true, false, false], 1),
        (1e-3, [0.0, 0.0], false, [false, true, true], 1),
        (0.0, [0.0, 0.0], true, [false; 3], 0),
    ] {
        let keys = keys(emissive, factors, unlit);
        assert_eq!((idle(&keys), maps(&keys)), (hidden, read), "{emissive} {factors:?} {unlit}");
    }
}

#[test]
fn projectors_have_no_keys() {
    let lights = "<emitter type='projector' id='beam'/><emitter type='spot' id='lamp'>
        <texture type='checkerboard' name='texture'/></emitter>";
    let keys = mitsuba(&format!("{lights}{}", sphere("a", "")));
    let found = names(&keys);
    assert!(found.contains(&"lamp.intensity.value"), "{found:?}");
    assert!(found.iter().all(|k| !k.starts_with("beam")), "{found:?}");
    assert_eq!(keys.iter().filter(|k| k.parameter == Parameter::Light { light: 1 }).count(), 1);
}

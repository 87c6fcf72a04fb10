//! The parameters of a scene by their names.
//!
//! Those of Mitsuba scenes are called as Mitsuba calls them: `white.reflectance.value`, `lamp.emitter.radiance.value`, `.data`
//! for images. Those of assets: the material's name with `.base_color`, `.roughness`, `.metallic`, `.emissive`,
//! `.absorption` and their maps.

use photofit_pathtrace::{MaterialValue, Parameter, Parts};
use photofit_scalar::Vec3f;
use photofit_scene::graph::{SurfaceGraph, SurfaceNode, Texture};
use photofit_scene::mitsuba::MitsubaScene;
use photofit_scene::{LightKind, MapKind, PunctualLight, Scene, SurfaceLibrary};
use photofit_shading::bsdf::Bsdf;

/// A parameter with its name.
#[derive(Clone, Debug)]
pub(crate) struct Key {
    pub(crate) name: String,
    pub(crate) parameter: Parameter,
    /// Rows, columns, channels; one row and column for values.
    pub(crate) shape: [usize; 3],
}

/// Keys on their way.
#[derive(Default)]
struct Keys {
    list: Vec<Key>,
}

impl Keys {
    /// A value of a material; materials that share a name share the value.
    fn value(&mut self, name: String, material: usize, value: MaterialValue) {
        if let Some(key) = self.list.iter_mut().find(|k| k.name == name)
            && let Parameter::Material { materials, value: known } = &mut key.parameter
            && *known == value
        {
            materials.push(material);
            return;
        }
        let parameter = Parameter::Material { materials: vec![material], value };
        self.push(name, parameter, [1, 1, value.channels()]);
    }

    /// A texture of a tree.
    fn texture(&mut self, name: &str, place: [usize; 2], texture: &Texture, channels: usize) {
        let (name, shape) = match texture {
            Texture::Constant(_) => (format!("{name}.value"), [1, 1, channels]),
            Texture::Bitmap { image, .. } => {
                let [width, height] = image.size();
                (format!("{name}.data"), [height, width, if image.channels() == 1 { 1 } else { 3 }])
            }
            _ => return,
        };
        if let Some(key) = self.list.iter_mut().find(|k| k.name == name)
            && let Parameter::Graph { places } = &mut key.parameter
        {
            places.push(place);
            return;
        }
        self.push(name, Parameter::Graph { places: vec![place] }, shape);
    }

    fn push(&mut self, name: String, parameter: Parameter, shape: [usize; 3]) {
        self.list.push(Key { name, parameter, shape });
    }
}

/// The keys of a Mitsuba scene.
pub(super) fn of_mitsuba(scene: &MitsubaScene) -> Vec<Key> {
    let mut keys = Keys::default();
    for (i, (graph, names)) in scene.materials.iter().zip(&scene.names).enumerate() {
        let uniform = graph.root.constant().filter(|_| !graph.root.needs_partials());
        let dark = graph.emission.as_ref().is_none_or(|e| e.constant().is_some());
        match uniform {
            Some((bsdf, two_sided)) if dark => {
                let name = format!("{}{}", names.bsdf, if two_sided { ".brdf_0" } else { "" });
                constants(&mut keys, &name, i, &bsdf);
                if graph.emission.is_some() {
                    keys.value(format!("{}.radiance.value", names.emitter), i, MaterialValue::Emission);
                }
            }
            _ => of_graph(&mut keys, i, graph, [&names.bsdf, &names.emitter]),
        }
    }
    lights(&mut keys, &scene.lights, ["intensity.value", "irradiance.value"]);
    if let Some(e) = &scene.environment {
        let (w, h) = (e.image.width, e.image.height);
        // Mirrored maps are kept in another order.
        if e.to_world.determinant() > 0.0 {
            let name = if w * h == 1 { "radiance.value" } else { "data" };
            keys.push(format!("{}.{name}", e.name), Parameter::Environment, [h, w, 3]);
        }
    }
    keys.list
}

/// The values of a BSDF that is the same everywhere.
fn constants(keys: &mut Keys, name: &str, material: usize, bsdf: &Bsdf<f32>) {
    match bsdf {
        // Lamps without a surface of their own are black; what is black hides the light that it would scatter.
        Bsdf::Diffuse(d) if d.reflectance == Vec3f::zero() => {}
        Bsdf::Diffuse(_) => {
            keys.value(format!("{name}.reflectance.value"), material, MaterialValue::Reflectance);
        }
        Bsdf::RoughConductor(c) if c.surface.alpha_x == c.surface.alpha_y && !c.surface.is_smooth() => {
            keys.value(format!("{name}.alpha.value"), material, MaterialValue::Alpha);
            let specular = MaterialValue::SpecularReflectance;
            keys.value(format!("{name}.specular_reflectance.value"), material, specular);
        }
        _ => {}
    }
}

/// The textures of a tree.
fn of_graph(keys: &mut Keys, material: usize, graph: &SurfaceGraph, [bsdf, emitter]: [&str; 2]) {
    let mut index = 0;
    of_node(keys, material, &graph.root, bsdf, &mut index);
    if let Some(emission) = &graph.emission {
        keys.texture(&format!("{emitter}.radiance"), [material, index], emission, 3);
    }
}

/// The textures of a node; `index` counts them as [`SurfaceNode::textures`] does.
fn of_node(keys: &mut Keys, material: usize, node: &SurfaceNode, name: &str, index: &mut usize) {
    let first = *index;
    match node {
        SurfaceNode::TwoSided { front, back } => {
            of_node(keys, material, front, &format!("{name}.brdf_0"), index);
            if let Some(back) = back {
                of_node(keys, material, back, &format!("{name}.brdf_1"), index);
            }
        }
        SurfaceNode::Mask { inner, .. }
        | SurfaceNode::Bump { inner, .. }
        | SurfaceNode::NormalMap { inner, .. } => {
            *index += 1;
            of_node(keys, material, inner, &format!("{name}.nested_bsdf"), index);
        }
        SurfaceNode::Blend { inner, .. } => {
            *index += 1;
            for (k, inner) in inner.iter().enumerate() {
                of_node(keys, material, inner, &format!("{name}.bsdf_{k}"), index);
            }
        }
        leaf => {
            leaf.textures(&mut |_| *index += 1);
            match leaf {
                SurfaceNode::Diffuse { reflectance } => {
                    keys.texture(&format!("{name}.reflectance"), [material, first], reflectance, 3);
                }
                SurfaceNode::Conductor { reflectance, rough: Some(r), .. } => {
                    let specular = format!("{name}.specular_reflectance");
                    keys.texture(&specular, [material, first + 2], reflectance, 3);
                    keys.texture(&format!("{name}.alpha"), [material, first + 3], &r.alpha_u, 1);
                    keys.texture(&format!("{name}.alpha"), [material, first + 4], &r.alpha_v, 1);
                }
                _ => {}
            }
        }
    }
}

/// The lights without a surface.
fn lights(keys: &mut Keys, lights: &[PunctualLight], [intensity, irradiance]: [&str; 2]) {
    for (light, l) in lights.iter().enumerate() {
        let what = if matches!(l.kind, LightKind::Directional) { irradiance } else { intensity };
        let name = if l.name.is_empty() { format!("light_{light}") } else { l.name.clone() };
        keys.push(format!("{name}.{what}"), Parameter::Light { light }, [1, 1, 3]);
    }
}

/// The keys of an asset; `parts` is made of it.
pub(super) fn of_asset(scene: &Scene, parts: &Parts) -> Vec<Key> {
    let mut keys = Keys::default();
    let Some(library) = &parts.library else { return keys.list };
    for (i, m) in scene.materials.iter().enumerate() {
        let twice = |n: &str| scene.materials.iter().filter(|m| m.name == n).count() > 1;
        let name = match m.name.as_str() {
            "" => format!("material_{i}"),
            n if twice(n) => format!("{n}_{i}"),
            n => n.to_owned(),
        };
        let held = library.may_transmit(i) || library.may_be_anisotropic(i);
        let mut values = Vec::new();
        // Light that is not there is not traced, so that its derivative is not seen.
        if m.emissive != [0.0; 3] {
            values.push(("emissive", MaterialValue::Emissive));
        }
        if !held {
            values.push(("base_color", MaterialValue::BaseColor));
            if !m.unlit {
                values.push(("roughness", MaterialValue::Roughness));
                values.push(("metallic", MaterialValue::Metallic));
            }
        }
        if parts.materials[i].solid {
            values.push(("absorption", MaterialValue::Absorption));
        }
        for (value, which) in values {
            keys.value(format!("{name}.{value}"), i, which);
        }
        let maps = [
            ("base_color_texture", MapKind::BaseColor),
            ("metallic_roughness_texture", MapKind::MetallicRoughness),
            ("normal_texture", MapKind::Normal),
            ("emissive_texture", MapKind::Emissive),
        ];
        let known = |kind| match kind {
            MapKind::Emissive => true,
            MapKind::Normal => !held && !library.may_have_sheen(i),
            _ => !held,
        };
        for (map, kind) in maps.into_iter().filter(|m| known(m.1)) {
            if let Some(texture) = library.texture_of(i, kind) {
                let shape = size_of_texture(library, texture);
                keys.push(format!("{name}.{map}"), Parameter::Texels { texture }, shape);
            }
        }
    }
    lights(&mut keys, &scene.lights, ["intensity", "irradiance"]);
    if let Some(e) = &parts.environment {
        keys.push("environment".into(), Parameter::Environment, [e.image.height, e.image.width, 3]);
    }
    keys.list
}

fn size_of_texture(library: &SurfaceLibrary, texture: usize) -> [usize; 3] {
    let base = library.texture(texture).layout().levels()[0];
    [base.height as usize, base.width as usize, 3]
}

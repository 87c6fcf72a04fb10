//! The parameters of a scene by their names.
//!
//! Those of Mitsuba scenes are called as Mitsuba calls them: `white.reflectance.value`, `lamp.emitter.radiance.value`, `.data`
//! for images and grids; of media `cloud.interior_medium.sigma_t.data`, `.sigma_t.value.value`, `.albedo`, `.emission`. Those of assets: the material's name with `.base_color`, `.roughness`, `.metallic`, `.emissive`,
//! `.absorption` and their maps. Names that several materials or lights have get their numbers.

use super::Quantity;
use glam::DVec3;
use photofit_pathtrace::{MaterialValue, MediumRef, MediumValue, Parameter, Parts};
use photofit_scalar::Vec3f;
use photofit_scene::graph::{SurfaceGraph, SurfaceNode, Texture};
use photofit_scene::mitsuba::{MitsubaMedium, MitsubaScene};
use photofit_scene::{LightKind, MapKind, PunctualLight, Scene, SurfaceLibrary};
use photofit_shading::bsdf::Bsdf;
use std::collections::{HashMap, HashSet};

/// A parameter with its name.
#[derive(Clone, Debug)]
pub(crate) struct Key {
    pub(crate) name: String,
    pub(crate) parameter: Parameter,
    /// Slices, rows, columns, channels; one slice for textures, one row and column for values.
    pub(crate) shape: [usize; 4],
    /// The box that files of grids name, from corner to corner.
    pub(crate) bounds: [DVec3; 2],
    /// What its values are.
    pub(crate) quantity: Quantity,
    /// Its value is 0, where it has no derivative: it has to be lifted first.
    pub(crate) dark: bool,
    /// Why it cannot be told what it changes, where it cannot.
    pub(crate) idle: Option<&'static str>,
}

impl Key {
    /// What lists add to the name of a parameter that has no derivative now.
    pub(crate) fn zero(&self) -> &'static str {
        match self {
            Self { idle: Some(_), .. } => " (0 in this scene, so that its map is not read)",
            Self { dark: true, .. } => " (0 in this scene)",
            _ => "",
        }
    }
}

/// Keys on their way.
#[derive(Default)]
struct Keys {
    list: Vec<Key>,
    /// By name.
    known: HashMap<String, usize>,
    /// What textures of trees were when their key was made, by the number of the key.
    textures: HashMap<usize, Texture>,
}

impl Keys {
    /// A value of a material; materials that share a name share the value.
    fn value(&mut self, name: String, material: usize, value: MaterialValue, dark: bool) -> usize {
        if let Some(place) = self.known.get(&name).copied()
            && let key = &mut self.list[place]
            && let Parameter::Material { materials, value: known } = &mut key.parameter
            && *known == value
            && key.dark == dark
        {
            materials.push(material);
            return place;
        }
        let parameter = Parameter::Material { materials: vec![material], value };
        let key = self.push(name, parameter, [1, 1, 1, value.channels()], Quantity::of(value));
        self.list[key].dark = dark;
        key
    }

    /// A texture of a tree.
    fn texture(&mut self, name: &str, place: [usize; 2], texture: &Texture, quantity: Quantity) {
        let channels = if quantity == Quantity::Alpha { 1 } else { 3 };
        let (name, shape) = match texture {
            Texture::Constant(_) => (format!("{name}.value"), [1, 1, 1, channels]),
            Texture::Bitmap { image, .. } => {
                let [width, height] = image.size();
                (format!("{name}.data"), [1, height, width, if image.channels() == 1 { 1 } else { 3 }])
            }
            _ => return,
        };
        if let Some(&k) = self.known.get(&name)
            && let Parameter::Graph { places } = &mut self.list[k].parameter
            && self.textures.get(&k).is_some_and(|known| alike(known, texture))
        {
            places.push(place);
            return;
        }
        let key = self.push(name, Parameter::Graph { places: vec![place] }, shape, quantity);
        self.textures.insert(key, texture.clone());
    }

    /// Adds a key; its name gets a number where another key has it.
    fn push(&mut self, name: String, parameter: Parameter, shape: [usize; 4], quantity: Quantity) -> usize {
        let mut own = name.clone();
        let mut number = 2;
        while self.known.contains_key(&own) {
            own = format!("{name}_{number}");
            number += 1;
        }
        let key = self.list.len();
        self.known.insert(own.clone(), key);
        let bounds = [DVec3::ZERO, DVec3::ONE];
        self.list.push(Key { name: own, parameter, shape, bounds, quantity, dark: false, idle: None });
        key
    }
}

/// Whether two textures hold the same values in the same way.
fn alike(a: &Texture, b: &Texture) -> bool {
    match (a, b) {
        (Texture::Constant(a), Texture::Constant(b)) => a == b,
        (
            Texture::Bitmap { image: a, to_uv: p, scale: s },
            Texture::Bitmap { image: b, to_uv: q, scale: t },
        ) => a.size() == b.size() && p == q && s == t && a.texels() == b.texels(),
        _ => false,
    }
}

/// Names of which no two are the same: what occurs several times gets its number in the list.
fn unique(names: &[String]) -> Vec<String> {
    let mut count: HashMap<&str, usize> = HashMap::new();
    names.iter().for_each(|n| *count.entry(n).or_default() += 1);
    let mut taken: HashSet<String> = names.iter().filter(|n| count[n.as_str()] == 1).cloned().collect();
    let name = |(i, n): (usize, &String)| {
        if count[n.as_str()] == 1 {
            return n.clone();
        }
        let mut own = format!("{n}_{i}");
        while !taken.insert(own.clone()) {
            own.push('_');
        }
        own
    };
    names.iter().enumerate().map(name).collect()
}

/// The keys of a Mitsuba scene.
pub(super) fn of_mitsuba(scene: &MitsubaScene) -> Vec<Key> {
    let mut keys = Keys::default();
    for (i, (graph, names)) in scene.materials.iter().zip(&scene.names).enumerate() {
        let uniform = graph.root.constant().filter(|_| !graph.root.needs_partials());
        let constant = graph.emission.as_ref().is_none_or(|e| e.constant().is_some());
        match uniform {
            Some((bsdf, two_sided)) if constant => {
                let name = format!("{}{}", names.bsdf, if two_sided { ".brdf_0" } else { "" });
                constants(&mut keys, &name, i, &bsdf, graph.emission.is_some());
                if graph.emission.is_some() {
                    keys.value(
                        format!("{}.radiance.value", names.emitter),
                        i,
                        MaterialValue::Emission,
                        false,
                    );
                }
            }
            _ => of_graph(&mut keys, i, graph, [&names.bsdf, &names.emitter]),
        }
        // An emitter that is black is none.
        if graph.emission.is_none() && !names.emitter.is_empty() {
            keys.value(format!("{}.radiance.value", names.emitter), i, MaterialValue::Emission, true);
        }
    }
    for (i, m) in scene.media.iter().enumerate() {
        medium(&mut keys, i, m);
    }
    lights(&mut keys, &scene.lights, ["intensity.value", "irradiance.value"]);
    if let Some(e) = &scene.environment {
        let (w, h) = (e.image.width, e.image.height);
        // Mirrored maps are kept in another order.
        if e.to_world.determinant() > 0.0 {
            let name = if w * h == 1 { "radiance.value" } else { "data" };
            let dark = e.image.data.iter().all(|v| *v == 0.0);
            let key = keys.push(
                format!("{}.{name}", e.name),
                Parameter::Environment,
                [1, h, w, 3],
                Quantity::Radiance,
            );
            keys.list[key].dark = dark;
        }
    }
    keys.list
}

/// The values of a medium: `NAME.sigma_t` before its scale, `NAME.albedo`, `NAME.emission`.
fn medium(keys: &mut Keys, index: usize, medium: &MitsubaMedium) {
    for (name, volume, value) in [
        ("sigma_t", Some(&medium.extinction), MediumValue::Extinction),
        ("albedo", Some(&medium.albedo), MediumValue::Albedo),
        ("emission", medium.emission.as_ref(), MediumValue::Emission),
    ] {
        let Some(volume) = volume else { continue };
        let ([x, y, z], grid) = (volume.size, volume.values.len() > 1);
        let channels = if grid && value == MediumValue::Extinction { 1 } else { 3 };
        let end = if grid { "data" } else { "value.value" };
        let parameter = Parameter::Medium { medium: MediumRef::Bounded(index), value };
        let name = format!("{}.{name}.{end}", medium.name);
        let key = keys.push(name, parameter, [z, y, x, channels], Quantity::of_medium(value));
        keys.list[key].bounds = volume.bounds;
    }
}

/// The values of a BSDF that is the same everywhere.
fn constants(keys: &mut Keys, name: &str, material: usize, bsdf: &Bsdf<f32>, emits: bool) {
    match bsdf {
        // Lamps without a surface of their own are black.
        Bsdf::Diffuse(d) if d.reflectance == Vec3f::zero() && emits => {}
        Bsdf::Diffuse(d) => {
            // What is black hides the light that it would scatter.
            let dark = d.reflectance == Vec3f::zero();
            keys.value(format!("{name}.reflectance.value"), material, MaterialValue::Reflectance, dark);
        }
        Bsdf::RoughConductor(c) if !c.surface.is_smooth() => {
            if c.surface.alpha_x == c.surface.alpha_y {
                keys.value(format!("{name}.alpha.value"), material, MaterialValue::Alpha, false);
            } else {
                keys.value(format!("{name}.alpha_u.value"), material, MaterialValue::AlphaU, false);
                keys.value(format!("{name}.alpha_v.value"), material, MaterialValue::AlphaV, false);
            }
            let specular = MaterialValue::SpecularReflectance;
            let dark = c.metal.reflectance == Vec3f::zero();
            keys.value(format!("{name}.specular_reflectance.value"), material, specular, dark);
        }
        _ => {}
    }
}

/// The textures of a tree.
fn of_graph(keys: &mut Keys, material: usize, graph: &SurfaceGraph, [bsdf, emitter]: [&str; 2]) {
    let mut index = 0;
    of_node(keys, material, &graph.root, bsdf, &mut index);
    if let Some(emission) = &graph.emission {
        keys.texture(&format!("{emitter}.radiance"), [material, index], emission, Quantity::Radiance);
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
                    keys.texture(
                        &format!("{name}.reflectance"),
                        [material, first],
                        reflectance,
                        Quantity::Color,
                    );
                }
                SurfaceNode::Conductor { reflectance, rough: Some(r), .. } => {
                    let specular = format!("{name}.specular_reflectance");
                    keys.texture(&specular, [material, first + 2], reflectance, Quantity::Color);
                    let same = alike(&r.alpha_u, &r.alpha_v);
                    let [u, v] = if same { ["alpha"; 2] } else { ["alpha_u", "alpha_v"] };
                    let alpha = Quantity::Alpha;
                    keys.texture(&format!("{name}.{u}"), [material, first + 3], &r.alpha_u, alpha);
                    keys.texture(&format!("{name}.{v}"), [material, first + 4], &r.alpha_v, alpha);
                }
                _ => {}
            }
        }
    }
}

/// The lights without a surface; projectors, whose irradiance is a picture, have no keys.
fn lights(keys: &mut Keys, lights: &[PunctualLight], [intensity, irradiance]: [&str; 2]) {
    let named = |(i, l): (usize, &PunctualLight)| {
        if l.name.is_empty() { format!("light_{i}") } else { l.name.clone() }
    };
    let names: Vec<String> = lights.iter().enumerate().map(named).collect();
    let lit = |((_, l), _): &((usize, &PunctualLight), String)| l.kind != LightKind::Projector;
    for ((light, l), name) in lights.iter().enumerate().zip(unique(&names)).filter(lit) {
        let what = if matches!(l.kind, LightKind::Directional) { irradiance } else { intensity };
        let parameter = Parameter::Light { light };
        let key = keys.push(format!("{name}.{what}"), parameter, [1, 1, 1, 3], Quantity::Radiance);
        keys.list[key].dark = l.intensity == [0.0; 3];
    }
}

/// The keys of an asset; `parts` is made of it.
pub(super) fn of_asset(scene: &Scene, parts: &Parts) -> Vec<Key> {
    let mut keys = Keys::default();
    let Some(library) = &parts.library else { return keys.list };
    let named = |(i, m): (usize, &photofit_scene::Material)| {
        if m.name.is_empty() { format!("material_{i}") } else { m.name.clone() }
    };
    let names: Vec<String> = scene.materials.iter().enumerate().map(named).collect();
    for ((i, m), name) in scene.materials.iter().enumerate().zip(unique(&names)) {
        let held = library.may_transmit(i) || library.may_be_anisotropic(i);
        // Light that is not there is not traced, so that its derivative is not seen.
        let black = m.emissive == [0.0; 3];
        let mut values = vec![("emissive", MaterialValue::Emissive)];
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
            let dark = match which {
                MaterialValue::Emissive => black,
                MaterialValue::BaseColor => m.base_color[..3] == [0.0; 3],
                _ => false,
            };
            let key = keys.value(format!("{name}.{value}"), i, which, dark);
            let rule = match which {
                MaterialValue::Emissive if black && m.emissive_texture.is_some() => {
                    "is 0, so that its map is not read; it must be more than 0"
                }
                MaterialValue::Roughness | MaterialValue::Metallic
                    if m.roughness == 0.0 && m.metallic == 0.0 && m.metallic_roughness_texture.is_some() =>
                {
                    "is 0 and so is the other factor of its map, which is not read; one of them must be more than 0"
                }
                _ => continue,
            };
            if !m.unlit {
                keys.list[key].idle = Some(rule);
            }
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
                let quantity = Quantity::of_map(kind);
                keys.push(format!("{name}.{map}"), Parameter::Texels { texture }, shape, quantity);
            }
        }
    }
    lights(&mut keys, &scene.lights, ["intensity", "irradiance"]);
    if let Some(e) = &parts.environment {
        let shape = [1, e.image.height, e.image.width, 3];
        let key = keys.push("environment".into(), Parameter::Environment, shape, Quantity::Radiance);
        keys.list[key].dark = e.image.data.iter().all(|v| *v == 0.0);
    }
    keys.list
}

fn size_of_texture(library: &SurfaceLibrary, texture: usize) -> [usize; 4] {
    let base = library.texture(texture).layout().levels()[0];
    [1, base.height as usize, base.width as usize, 3]
}

#[cfg(test)]
mod tests;

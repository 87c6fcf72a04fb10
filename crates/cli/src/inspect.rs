//! `photofit inspect`: what an asset holds, and what a fit of it would run.

use crate::args::Inspect;
use crate::output::{self, bytes, counted, print};
use crate::preflight::Places;
use crate::status::Misuse;
use crate::{device, mitsuba};
use anyhow::Result;
use photofit_fit::simplify::{FitPlan, Runs};
use photofit_scene::{AlphaMode, LightKind, Material, PunctualLight, Scene};
use serde_json::{Value, json};
use std::path::Path;

pub(crate) fn run(a: &Inspect) -> Result<()> {
    let places = Places::default().reads("IN", a.input.as_deref()).writes("--json", a.json.as_deref());
    places.check()?;
    let Some(input) = &a.input else { return device::list(a.json.as_deref()) };
    if mitsuba::is_scene(input) {
        return mitsuba::inspect(a, input, &places);
    }
    if a.allow_parent_paths {
        return Err(Misuse("--allow-parent-paths needs an .xml scene".into()).into());
    }
    let scene = photofit_scene::load(input)?;
    places.check_against("IN", &scene.files)?;
    if let Some(file) = &a.json {
        output::write_json(file, &to_json(input, &scene))?;
    }
    print(&text(input, &scene))
}

/// The numbers of a material, which textures are multiplied with; roughness and metalness of what is lit, emission where there is any.
fn factors(m: &Material) -> String {
    let triple = |c: [f32; 3]| c.map(|x| format!("{x:.3}")).join(" ");
    let [r, g, b, _] = m.base_color;
    let mut out = format!("base colour {}", triple([r, g, b]));
    if !m.unlit {
        out += &format!(", roughness {:.2}, metalness {:.2}", m.roughness, m.metallic);
    }
    if !m.unlit && m.emissive != [0.0; 3] {
        out += &format!(", emission {}", triple(m.emissive));
    }
    out
}

fn alpha(m: &Material) -> String {
    match m.alpha_mode {
        AlphaMode::Opaque => "opaque".into(),
        AlphaMode::Mask { cutoff } => format!("mask at {cutoff}"),
        AlphaMode::Blend => "blend".into(),
    }
}

/// The slots of a material that have a texture, with the index of its image.
fn textures(m: &Material) -> Vec<(&'static str, usize)> {
    m.textures().map(|(name, slot)| (name, slot.image)).collect()
}

/// Names of the extensions that a material uses; the plan says what a fit does with them.
fn extensions(m: &Material) -> Vec<&'static str> {
    m.extensions.as_ref().map_or_else(Vec::new, |e| e.names())
}

/// What kind of light it is.
fn kind(light: &PunctualLight) -> &'static str {
    match light.kind {
        LightKind::Directional => "directional",
        LightKind::Point => "point",
        LightKind::Spot { .. } => "spot",
        LightKind::Projector => "projector",
    }
}

/// Names of the attributes that a primitive has in the file.
fn attributes(scene: &Scene, primitive: usize) -> Vec<&'static str> {
    let mesh = &scene.primitives[primitive].mesh;
    [
        ("normals", mesh.normals.is_empty() || has_computed_normals(scene, primitive)),
        ("tangents", mesh.tangents.is_empty()),
        ("uv 0", mesh.uvs.is_empty()),
        ("uv 1", mesh.uvs1.is_empty()),
        ("colours", mesh.colors.is_empty()),
    ]
    .into_iter()
    .filter_map(|(name, absent)| (!absent).then_some(name))
    .collect()
}

/// Whether the file has no normals for a primitive.
fn has_computed_normals(scene: &Scene, primitive: usize) -> bool {
    scene.computed_normals.binary_search(&primitive).is_ok()
}

fn named(name: &str) -> String {
    if name.is_empty() { String::new() } else { format!(" {name:?}") }
}

fn text(path: &Path, scene: &Scene) -> String {
    let mut out = format!("{}\n", path.display());
    out += &format!(
        "  {}, {} placed: {}, {}\n",
        counted(scene.primitives.len(), "primitive"),
        scene.instances.len(),
        counted(scene.triangle_count(), "triangle"),
        counted(scene.vertex_count(), "vertex")
    );
    if let Some((lo, hi)) = scene.bounds() {
        let d = hi - lo;
        out += &format!("  box of {:.4} x {:.4} x {:.4} units, area {:.4}\n", d.x, d.y, d.z, scene.area());
    }
    for (i, p) in scene.primitives.iter().enumerate() {
        let mut attributes = attributes(scene, i);
        attributes.extend(has_computed_normals(scene, i).then_some("normals are computed"));
        out += &format!(
            "  primitive {i}: {}, {}, material {}; {}\n",
            counted(p.mesh.triangles.len(), "triangle"),
            counted(p.mesh.positions.len(), "vertex"),
            p.material,
            attributes.join(", ")
        );
    }
    for (i, m) in scene.materials.iter().enumerate() {
        let kinds: Vec<String> =
            textures(m).iter().map(|(name, image)| format!("{name} from image {image}")).collect();
        let flags = [(m.double_sided, ", double-sided"), (m.unlit, ", unlit")];
        let flags: String = flags.iter().filter(|f| f.0).map(|f| f.1).collect();
        let kinds = if kinds.is_empty() { "no textures".into() } else { kinds.join(", ") };
        let factors = factors(m);
        out += &format!("  material {i}{}: {}{flags}; {factors}; {kinds}\n", named(&m.name), alpha(m));
        let extensions = extensions(m);
        if !extensions.is_empty() {
            out += &format!("    extensions: {}\n", extensions.join(", "));
        }
    }
    for (i, image) in scene.images.iter().enumerate() {
        out += &format!("  image {i}{}: {} x {}\n", named(&image.name), image.width, image.height);
    }
    for (i, mesh) in scene.hierarchy.iter().flat_map(|h| &h.meshes).enumerate() {
        if mesh.targets() > 0 {
            let targets = counted(mesh.targets(), "morph target");
            let names = mesh.target_names().map(|name| format!("{name:?}")).collect::<Vec<_>>().join(", ");
            let names = if names.is_empty() { names } else { format!(": {names}") };
            out += &format!("  mesh {i}{}: {targets}{names}\n", named(&mesh.name));
        }
    }
    for (i, skin) in scene.hierarchy.iter().flat_map(|h| &h.skins).enumerate() {
        out += &format!("  skin {i}{}: {}\n", named(&skin.name), counted(skin.joints.len(), "joint"));
    }
    for (i, a) in scene.hierarchy.iter().flat_map(|h| &h.animations).enumerate() {
        out += &format!("  animation {i}{}: {:.3} s\n", named(&a.name), a.duration());
    }
    if !scene.cameras.is_empty() {
        out += &format!("  {}\n", counted(scene.cameras.len(), "camera"));
    }
    for (i, light) in scene.lights.iter().enumerate() {
        let unit = if light.kind == LightKind::Directional { "lux" } else { "candela" };
        let [r, g, b] = light.intensity;
        out += &format!("  light {i}{}: {}, {r} {g} {b} {unit}\n", named(&light.name), kind(light));
    }
    if !scene.ignored_attributes.is_empty() {
        out += &format!("  vertex attributes that are not read: {}\n", scene.ignored_attributes.join(", "));
    }
    let m = scene.memory();
    let [geometry, images, flattened, surfaces] =
        [m.geometry, m.images, m.flattened, m.surfaces].map(|b| bytes(b as u64));
    out += &format!(
        "memory\n  geometry {geometry}, images {images}; when used: at most {flattened} and {surfaces}\n"
    );
    if !scene.warnings.is_empty() {
        out += "warnings\n";
        scene.warnings.iter().for_each(|w| out += &format!("  {w}\n"));
    }
    out += "a fit\n";
    match scene.validate_for_fit() {
        Ok(()) => out += &format!("{}\n", FitPlan::new(scene)),
        Err(e) => out += &format!("  is not possible: {e}\n"),
    }
    out
}

/// What a fit would run; `runs` is null where `kind` is `open` (options or baked maps decide) or `note` (told alone).
fn plan(scene: &Scene) -> Value {
    let runs = |r| match r {
        Runs::Yes => (json!(true), "decided"),
        Runs::No => (json!(false), "decided"),
        Runs::Open => (Value::Null, "open"),
        Runs::Note => (Value::Null, "note"),
    };
    FitPlan::new(scene)
        .items()
        .into_iter()
        .map(|i| {
            let (runs, kind) = runs(i.runs);
            json!({ "what": i.what, "runs": runs, "kind": kind, "why": i.why })
        })
        .collect()
}

fn to_json(path: &Path, scene: &Scene) -> Value {
    let m = scene.memory();
    let bounds = scene.bounds().map(|(lo, hi)| json!([lo.to_array(), hi.to_array()]));
    let primitives: Vec<Value> = scene
        .primitives
        .iter()
        .enumerate()
        .map(|(i, p)| {
            json!({
                "triangles": p.mesh.triangles.len(),
                "vertices": p.mesh.positions.len(),
                "material": p.material,
                "attributes": attributes(scene, i),
                "computed_normals": has_computed_normals(scene, i),
            })
        })
        .collect();
    let materials: Vec<Value> = scene
        .materials
        .iter()
        .map(|m| {
            let textures: serde_json::Map<String, Value> =
                textures(m).into_iter().map(|(k, i)| (k.to_owned(), json!(i))).collect();
            json!({
                "name": m.name,
                "alpha_mode": alpha(m),
                "double_sided": m.double_sided,
                "unlit": m.unlit,
                "base_color": m.base_color,
                "roughness": m.roughness,
                "metallic": m.metallic,
                "emissive": m.emissive,
                "extensions": extensions(m),
                "textures": textures,
            })
        })
        .collect();
    let images: Vec<Value> = scene
        .images
        .iter()
        .map(|i| json!({ "name": i.name, "width": i.width, "height": i.height }))
        .collect();
    let problem = scene.validate_for_fit().err().map(|e| e.to_string());
    let plan = if problem.is_none() { plan(scene) } else { Value::Null };
    json!({
        "input": path.display().to_string(),
        "meshes": scene.primitives.len(),
        "instances": scene.instances.len(),
        "triangles": scene.triangle_count(),
        "vertices": scene.vertex_count(),
        "area": scene.area(),
        "bounds": bounds,
        "primitives": primitives,
        "materials": materials,
        "images": images,
        "morph_targets": scene.hierarchy.iter().flat_map(|h| &h.meshes).map(|mesh| json!({
            "mesh": mesh.name, "count": mesh.targets(), "names": mesh.target_names().collect::<Vec<_>>(),
        })).filter(|mesh| mesh["count"] != 0).collect::<Vec<_>>(),
        "skins": scene.hierarchy.iter().flat_map(|h| &h.skins).map(|skin| json!({
            "name": skin.name, "joints": skin.joints.len(),
        })).collect::<Vec<_>>(),
        "animations": scene.hierarchy.iter().flat_map(|h| &h.animations).map(|a| json!({
            "name": a.name, "seconds": a.duration(),
        })).collect::<Vec<_>>(),
        "cameras": scene.cameras.len(),
        "lights": scene.lights.iter().map(|l| json!({
            "name": l.name, "kind": kind(l), "intensity": l.intensity,
        })).collect::<Vec<_>>(),
        "memory": {
            "geometry": m.geometry, "images": m.images, "flattened": m.flattened, "surfaces": m.surfaces,
        },
        "warnings": scene.warnings,
        "problem": problem,
        "plan": plan,
    })
}

//! Scenes of Mitsuba 3 on the command line: `photofit render scene.xml` and `photofit inspect scene.xml`.

use crate::args::{Inspect, Render};
use crate::output::{self, count, counted, print};
use crate::path_render;
use crate::preflight::Places;
use crate::progress::say;
use crate::status::Ending;
use anyhow::{Result, anyhow};
use photofit_pathtrace::{Parts, RenderOptions, Renderer, View, World};
use photofit_scene::SceneError;
use photofit_scene::mitsuba::{MitsubaOptions, MitsubaScene, MitsubaShape, load_mitsuba};
use serde_json::{Value, json};
use std::path::Path;

/// Whether a file is a scene of Mitsuba, by its name.
pub(crate) fn is_scene(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("xml"))
}

/// Loads a scene; what it may not name without an option is told with that option.
///
/// # Errors
/// As [`load_mitsuba`].
pub(crate) fn load(path: &Path, options: &MitsubaOptions) -> Result<MitsubaScene> {
    let named = |rule: &str| {
        rule.replace(
            "allow_parent_paths is false and must be true",
            "--allow-parent-paths must be given to let it",
        )
    };
    load_mitsuba(path, options).map_err(|e| match e {
        SceneError::Invalid { path, place, rule } => {
            SceneError::Invalid { path, place, rule: named(&rule) }.into()
        }
        e => e.into(),
    })
}

/// One picture, as the scene says where the command line does not.
pub(crate) fn render(a: &Render, places: &Places) -> Result<Ending> {
    let aovs = path_render::auxiliary(a)?;
    let named = |e: &dyn std::fmt::Display| anyhow!("{}: {e}", a.input.display());
    let options = MitsubaOptions {
        parameters: a.path.define.clone(),
        sensor: a.camera.unwrap_or(0),
        size: [a.width, a.height],
        allow_parent_paths: a.path.allow_parent_paths,
        ..MitsubaOptions::default()
    };
    let scene = load(&a.input, &options)?;
    places.check_against("IN", scene.files.iter().chain(&scene.resources))?;
    let own = RenderOptions::from_mitsuba(&scene);
    // What is left open follows the scene; the picture shows its environment.
    let mut resolved = a.clone();
    (resolved.width, resolved.height) = (Some(own.width as u32), Some(own.height as u32));
    resolved.path.max_depth = Some(a.path.max_depth.unwrap_or(own.path.max_depth));
    resolved.path.background = own.path.show_environment;
    let mut options = path_render::options(&resolved, aovs);
    (options.filter, options.path.roulette_depth) = (own.filter, own.path.roulette_depth);
    options.path.show_emitters = own.path.show_emitters;
    if a.spp.is_none() && !a.path.is_open() {
        options.spp = own.spp;
    }
    if scene.sensors > 1 && a.camera.is_none() {
        say(&format!(
            "the scene has {} sensors: the first one sees; --camera chooses another",
            scene.sensors
        ));
    }
    let view = View::from_mitsuba(&scene.sensor);
    let files = path_render::stamps(scene.files.iter().chain(&scene.resources))?;
    let key = format!("{files}|{:?}", a.path.define);
    let parts = Parts::from_mitsuba(scene);
    let world = World::new(parts).map_err(|e| named(&e))?;
    let renderer = Renderer::new(&world, &view, options).map_err(|e| named(&e))?;
    path_render::finish(&resolved, renderer, &view, &key)
}

/// What a scene holds.
pub(crate) fn inspect(a: &Inspect, input: &Path, places: &Places) -> Result<()> {
    let options = MitsubaOptions { allow_parent_paths: a.allow_parent_paths, ..MitsubaOptions::default() };
    let scene = load(input, &options)?;
    places.check_against("IN", scene.files.iter().chain(&scene.resources))?;
    if let Some(file) = &a.json {
        output::write_json(file, &to_json(input, &scene))?;
    }
    print(&text(input, &scene))
}

/// Triangles of the shapes as stored, and over all placements.
fn triangles(scene: &MitsubaScene) -> (usize, usize) {
    let of = |shape: &MitsubaShape| match shape {
        MitsubaShape::Mesh(m) => m.triangles.len(),
        MitsubaShape::Sphere { .. } | MitsubaShape::DistanceGrid { .. } => 0,
    };
    let stored = scene.shapes.iter().map(of).sum();
    (stored, scene.instances.iter().map(|i| of(&scene.shapes[i.shape])).sum())
}

fn text(path: &Path, scene: &MitsubaScene) -> String {
    let (stored, placed) = triangles(scene);
    let film = &scene.sensor.film;
    let emitting = scene.materials.iter().filter(|m| m.emission.is_some()).count();
    let environment = scene
        .environment
        .as_ref()
        .map_or("none".to_owned(), |e| format!("{} x {}", e.image.width, e.image.height));
    let mut out = format!("{}\n", path.display());
    out += &format!(
        "  {}, {} placed: {}, {} over all placements\n",
        counted(scene.shapes.len(), "shape"),
        scene.instances.len(),
        counted(stored, "triangle"),
        count(placed)
    );
    out += &format!(
        "  {}, {emitting} of them emit; {}\n",
        counted(scene.materials.len(), "material"),
        counted(scene.media.len(), "medium")
    );
    out += &format!(
        "  {} without a surface; environment: {environment}\n",
        counted(scene.lights.len(), "light")
    );
    out += &format!(
        "  picture: {} x {} pixels, {}, up to {}\n",
        film.crop_size[0],
        film.crop_size[1],
        counted(scene.sensor.samples as usize, "sample"),
        counted(scene.integrator.max_depth as usize, "scattering event")
    );
    if scene.sensors > 1 {
        out += &format!("  {} sensors: this is the first, --camera chooses another\n", scene.sensors);
    }
    for file in scene.files.iter().skip(1) {
        out += &format!("  includes {}\n", file.display());
    }
    out
}

fn to_json(path: &Path, scene: &MitsubaScene) -> Value {
    let (stored, placed) = triangles(scene);
    let film = &scene.sensor.film;
    json!({
        "file": path.display().to_string(),
        "format": "mitsuba",
        "shapes": scene.shapes.len(),
        "instances": scene.instances.len(),
        "triangles": stored,
        "placed_triangles": placed,
        "materials": scene.materials.len(),
        "lights": scene.lights.len(),
        "environment": scene.environment.is_some(),
        "media": scene.media.len(),
        "width": film.crop_size[0],
        "height": film.crop_size[1],
        "spp": scene.sensor.samples,
        "sensors": scene.sensors,
        "max_depth": scene.integrator.max_depth,
    })
}

//! Scenes whose path-traced picture has parameters that are known by name.

mod keys;
mod quantity;

pub(crate) use keys::Key;
pub(crate) use quantity::{FAINT, Quantity};

use crate::args::ParameterScene;
use crate::preflight::Places;
use crate::progress::say_warnings;
use crate::status::Misuse;
use crate::{mitsuba, path_render, render};
use anyhow::{Result, anyhow, bail};
use photofit_pathtrace::{
    EnvironmentMap, Parts, PathOptions, PathtraceError, RenderOptions, View, WorldOptions,
};
use photofit_scene::mitsuba::MitsubaOptions;

/// Words in the names of parameters that move edges.
const GEOMETRY: [&str; 6] =
    ["vertex_positions", "vertex_normals", "faces", "to_world", "positions", "opacity"];
/// Most keys that an error lists.
const LISTED: usize = 12;

/// A shape as files tell it: rows, columns and channels, of grids in space after their slices.
pub(crate) fn tensor(shape: &[usize; 4]) -> &[usize] {
    if shape[0] == 1 { &shape[1..] } else { shape }
}

/// A scene with what its picture is like.
pub(crate) struct Subject {
    pub(crate) keys: Vec<Key>,
    /// Names of the lights that throw pictures.
    throwing: Vec<String>,
    pub(crate) parts: Parts,
    /// One for each camera that is asked for.
    pub(crate) views: Vec<View>,
    pub(crate) options: RenderOptions,
    pub(crate) world: WorldOptions,
}

/// Whose cameras a scene is seen by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cameras {
    /// Its own.
    Own,
    /// Others, or none: its own are not looked at.
    Others,
}

impl Subject {
    /// Loads a scene; its files join the inputs that no output may replace.
    pub(crate) fn load(a: &ParameterScene, cameras: Cameras, places: &Places) -> Result<Self> {
        if mitsuba::is_scene(&a.input) { of_mitsuba(a, places) } else { of_asset(a, cameras, places) }
    }

    /// The parameter of a name.
    pub(crate) fn find(&self, a: &ParameterScene, name: &str) -> Result<&Key> {
        let keys = &self.keys;
        let file = a.input.display();
        if let Some(key) = keys.iter().find(|k| k.name == name) {
            return match &key.idle {
                None => Ok(key),
                Some(rule) => bail!("{file}: {name}: {rule}"),
            };
        }
        let thrown =
            |light: &String| name.strip_prefix(light.as_str()).is_some_and(|end| end.starts_with('.'));
        if self.throwing.iter().any(thrown) {
            bail!(
                "{file}: {name}: belongs to a light that throws a picture, whose texels have no derivatives; it must be a \
                 parameter of --list"
            );
        }
        if let Some(word) = GEOMETRY.iter().find(|w| name.rsplit('.').any(|part| part == **w)) {
            bail!(
                "{file}: {name}: a change of {word} moves edges, whose derivatives the path tracer does not see; \
             it must be a parameter of --list (shapes are fitted through the rasterizer)"
            );
        }
        let mut known: Vec<String> = keys.iter().take(LISTED).map(|k| k.name.clone() + k.zero()).collect();
        if keys.len() > LISTED {
            known.push("... (--list of photofit gradient shows all)".into());
        }
        bail!("{file}: has no parameter {name} with derivatives; it must be of {}", known.join(", "))
    }
}

/// An error of a scene, with the option that mends it.
pub(crate) fn explained(a: &ParameterScene, error: &PathtraceError) -> anyhow::Error {
    let file = a.input.display();
    let dark = *error == PathtraceError::NoLight && !mitsuba::is_scene(&a.input);
    anyhow!("{file}: {error}{}", if dark { ": --env FILE lights an asset" } else { "" })
}

fn of_mitsuba(a: &ParameterScene, places: &Places) -> Result<Subject> {
    if a.env.is_some() {
        bail!(Misuse("--env: belongs to an asset; an .xml scene has its own".into()));
    }
    let &[sensor] = &a.camera[..] else {
        bail!(Misuse("--camera: an .xml scene is seen by one sensor; it must be given once".into()));
    };
    let options = MitsubaOptions {
        parameters: a.define.clone(),
        sensor,
        size: [a.width, a.height],
        allow_parent_paths: a.allow_parent_paths,
        ..MitsubaOptions::default()
    };
    let scene = mitsuba::load(&a.input, &options)?;
    places.check_against("SCENE", scene.files.iter().chain(&scene.resources))?;
    let mut options = RenderOptions::from_mitsuba(&scene);
    options.path.max_depth = a.max_depth.unwrap_or(options.path.max_depth);
    options.seed = a.seed;
    let view = View::from_mitsuba(&scene.sensor);
    let world = WorldOptions::default();
    let throwing = scene.lights.iter().filter(|l| l.picture.is_some() && !l.name.is_empty());
    Ok(Subject {
        throwing: throwing.map(|l| l.name.clone()).collect(),
        keys: keys::of_mitsuba(&scene),
        parts: Parts::from_mitsuba(scene),
        views: vec![view],
        options,
        world,
    })
}

fn of_asset(a: &ParameterScene, cameras: Cameras, places: &Places) -> Result<Subject> {
    if !a.define.is_empty() || a.allow_parent_paths {
        let rule = "--define and --allow-parent-paths belong to .xml scenes; the input must be one";
        bail!(Misuse(rule.into()));
    }
    let file = a.input.display();
    let scene = photofit_scene::load(&a.input)?;
    places.check_against("SCENE", &scene.files)?;
    say_warnings(&a.input, &scene);
    scene.validate_for_fit().map_err(|e| anyhow!("{file}: {e}"))?;
    let (width, height) = (a.width.unwrap_or(512) as usize, a.height.unwrap_or(512) as usize);
    let view = |camera: &usize| path_render::camera_view(&a.input, &scene, *camera, [width, height]);
    let views = match cameras {
        Cameras::Others => Vec::new(),
        // As `render` shows it.
        Cameras::Own if scene.cameras.is_empty() && a.camera == [0] => {
            let framed = render::framing(&scene, width as f32 / height as f32);
            vec![View::pinhole(&framed.ok_or_else(|| anyhow!("{file}: the asset has no extent"))?)]
        }
        Cameras::Own => a.camera.iter().map(view).collect::<Result<_>>()?,
    };
    let mut parts = Parts::from_scene(&scene);
    if let Some(file) = &a.env {
        parts.environment = Some(EnvironmentMap::new(photofit_scene::load_environment(file)?));
    }
    let path = PathOptions::default();
    let path = PathOptions { max_depth: a.max_depth.unwrap_or(path.max_depth), ..path };
    let options = RenderOptions { width, height, seed: a.seed, path, ..RenderOptions::default() };
    let keys = keys::of_asset(&scene, &parts);
    Ok(Subject { keys, throwing: Vec::new(), parts, views, options, world: WorldOptions::default() })
}

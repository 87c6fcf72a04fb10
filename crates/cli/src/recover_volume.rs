//! `photofit recover volume`: a cloud on a grid from pictures with cameras.

use crate::args::RecoverVolume;
use crate::fields::{RECOVER_VOLUME, misuse, name_options};
use crate::output::{self, Results};
use crate::preflight::Places;
use crate::progress::{Terminal, say};
use crate::status::Ending;
use crate::traced_report::{
    Found, course, first_and_best, judged, self_test_pictures, sheet, tell_course, tell_doubts,
};
use crate::{interrupt, memory, threads};
use anyhow::{Context, Result, anyhow, bail};
use glam::{DAffine3, DVec3, Vec3};
use photofit_fit::FitError;
use photofit_fit::engine::chain::checkpoint_files;
use photofit_fit::pictures::{lit_world_pictures, named_files};
use photofit_fit::recover_volume::{
    RecoverVolumeOptions, RecoveredVolume, Surroundings, bounds_fault, recover_volume,
};
use photofit_fit::report::PAGE;
use photofit_fit::views::views_around;
use photofit_image::{Image, write_atomically};
use photofit_pathtrace::{
    EnvironmentMap, Field, LightSource, Parts, RenderOptions, Renderer, View, Volume, World,
};
use photofit_scalar::Vec3f;
use photofit_scene::mitsuba::{encode_grid, parse_grid};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;

/// Samples per pixel and seed of the targets of a self-test, and of the pictures that are written.
const TARGET_SPP: u32 = 256;
const TARGET_SEED: u64 = 0x7461_7267;
const SHOWN_SPP: u32 = 128;
const SHOWN_SEED: u64 = 0x7368_6f77;
/// Largest grid of a self-test, bytes: three channels of 512 x 512 x 512 voxels have 1.6e9.
const MOST_BYTES: u64 = 1 << 31;
/// Albedo of a self-test that names none.
const ALBEDO: [f32; 3] = [0.8, 0.6, 0.4];
/// Emission of a self-test over its extinction.
const EMISSION: [f32; 3] = [0.8, 0.4, 0.1];
/// Files of the output.
const FILES: [&str; 6] = ["extinction.vol", "albedo.vol", "views.png", "values.json", PAGE, "emission.vol"];

/// What is seen, from where, under which light.
struct Seen {
    surroundings: Surroundings,
    views: Vec<View>,
    pictures: Vec<Image>,
    /// The cloud, where it is known.
    truth: Option<Known>,
}

/// A cloud that is known.
struct Known {
    size: [usize; 3],
    extinction: Vec<f32>,
    /// Three channels a voxel; empty: none.
    emission: Vec<f32>,
    bounds: [DVec3; 2],
}

pub(crate) fn run(a: &RecoverVolume) -> Result<Ending> {
    let options = options(a);
    let checkpoints = checkpoint_files(options.longest_sides().len());
    let checkpoints: Vec<&str> = checkpoints.iter().map(String::as_str).collect();
    let places = Places::default()
        .reads("PICTURES", a.pictures.as_deref())
        .reads("--self-test", a.self_test.as_deref())
        .reads("--env", a.env.as_deref())
        .fills("--output", Some(&a.output), &FILES)
        .fills("--checkpoint", a.course.running.checkpoint.as_deref(), &checkpoints);
    places.check()?;
    if let Some(pictures) = &a.pictures {
        places.check_against("PICTURES", &named_files(pictures))?;
    }
    // What no picture could satisfy is told before one is read.
    options.check().map_err(|e| misuse(RECOVER_VOLUME, e))?;
    threads::set(a.course.running.threads)?;
    let seen = seen(a)?;
    let options =
        RecoverVolumeOptions { bounds: options.bounds.or(seen.truth.as_ref().map(|t| t.bounds)), ..options };
    let voxels = options.voxels(&seen.views).map_err(|e| failed(a, e))?;
    memory::check_grid(voxels, options.values_per_voxel())?;
    std::fs::create_dir_all(&a.output).with_context(|| a.output.display().to_string())?;
    interrupt::handle();
    let progress = Terminal::new();
    let began = Instant::now();
    let r = recover_volume(&seen.surroundings, &seen.views, &seen.pictures, &options, &progress)
        .map_err(|e| failed(a, e))?;
    let seconds = began.elapsed().as_secs_f64();
    progress.finish();
    tell_course(r.stopped, a.course.explain.then_some(&r.plan))?;
    write(a, &seen, &r, seconds)?;
    let stopped = r.stopped && interrupt::is_stopping();
    Ok(if stopped { Ending::Stopped } else { Ending::Done })
}

/// Options that no picture allows are a wrong command line.
fn failed(a: &RecoverVolume, error: FitError) -> anyhow::Error {
    match error {
        FitError::Setting { field: "bounds" | "size" | "anisotropy" | "albedo", .. } => {
            misuse(RECOVER_VOLUME, error)
        }
        FitError::Setting { field: "surroundings", .. } => {
            let list = a.pictures.as_deref().unwrap_or(Path::new("")).display();
            anyhow!("{list}: names no lights; it must, or --env or --emission must be given")
        }
        error => name_options(RECOVER_VOLUME, error).into(),
    }
}

fn options(a: &RecoverVolume) -> RecoverVolumeOptions {
    let corners = |b: &[f64]| [DVec3::from_slice(&b[..3]), DVec3::from_slice(&b[3..])];
    RecoverVolumeOptions {
        bounds: a.bounds.as_ref().map(|n| corners(&n.0)),
        size: a.size,
        coarse_to_fine: !a.one_grid,
        // That of a self-test is to be found.
        albedo: a.albedo.as_ref().filter(|_| a.self_test.is_none()).map(|n| three(&n.0)),
        emission: a.emission,
        anisotropy: a.anisotropy as f32,
        steps: a.traced.steps,
        rate: a.traced.rate,
        spp: a.traced.spp,
        gradient_spp: a.traced.gradient_spp,
        max_depth: a.max_depth,
        smoothing: a.traced.smoothing.unwrap_or(RecoverVolumeOptions::default().smoothing),
        seed: a.course.running.seed,
        checkpointing: a.course.checkpointing(),
    }
}

/// Three channels of one number or three.
fn three(v: &[f64]) -> [f32; 3] {
    [0, 1, 2].map(|c| v[c.min(v.len() - 1)] as f32)
}

fn seen(a: &RecoverVolume) -> Result<Seen> {
    let environment = match &a.env {
        Some(file) => Some(EnvironmentMap::new(photofit_scene::load_environment(file)?)),
        None => None,
    };
    if let Some(grid) = &a.self_test {
        return known(a, grid, environment);
    }
    let Some(list) = &a.pictures else { bail!("no pictures") };
    let (pictures, lights) = lit_world_pictures(list)?;
    let mut surroundings = Surroundings::from(&lights);
    surroundings.environment = environment.or(surroundings.environment);
    // Before nothing there is nothing behind the cloud.
    let dark = a.emission && surroundings.environment.is_none();
    if !dark && pictures.iter().any(|p| p.image.data.iter().skip(3).step_by(4).any(|alpha| *alpha < 0.99)) {
        say(
            "warning: pictures have alpha below 1, which is not looked at: they must show the light behind the cloud",
        );
    }
    let (views, pictures): (Vec<View>, Vec<Image>) =
        pictures.into_iter().map(|p| (p.camera.view(), p.image)).unzip();
    tell_doubts(&list.display().to_string(), &views, &pictures);
    Ok(Seen { surroundings, views, pictures, truth: None })
}

/// Pictures of a grid from around it.
fn known(a: &RecoverVolume, file: &Path, environment: Option<EnvironmentMap>) -> Result<Seen> {
    let bytes = photofit_image::file_bytes(file, MOST_BYTES)?;
    let (size, values, bounds) = parse_grid(&bytes).map_err(|rule| anyhow!("{}: {rule}", file.display()))?;
    let [lo, hi] = bounds;
    if let Some(rule) = bounds_fault(bounds) {
        bail!("{}: corners of its box {rule}", file.display());
    }
    if let Some(i) = values.iter().position(|v| v.x != v.y || v.x != v.z) {
        let v = values[i].to_array();
        bail!(
            "{}: voxel {i} holds {v:?}; the extinction of a self-test must be the same in all channels",
            file.display()
        );
    }
    let extinction: Vec<f32> = values.iter().map(|v| v.x).collect();
    let sun = LightSource::Directional {
        direction: Vec3f::from_array(Vec3::new(0.3, 1.0, 0.4).normalize().to_array()),
        irradiance: Vec3f::splat(3.0),
    };
    // Light and dark behind the cloud tell its density from its albedo.
    let sky =
        || EnvironmentMap::new(Image::from_fn(8, 4, 3, |x, y, _| if (x + y) % 2 == 0 { 0.9 } else { 0.1 }));
    let surroundings = match environment {
        Some(given) => Surroundings { lights: Vec::new(), environment: Some(given) },
        None => Surroundings { lights: vec![sun], environment: Some(sky()) },
    };
    let albedo = a.albedo.as_ref().map_or(ALBEDO, |n| three(&n.0));
    let transform = DAffine3::from_translation(lo) * DAffine3::from_scale(hi - lo);
    let glow = |e: &f32| Vec3f::from_array(EMISSION) * *e;
    let emission =
        a.emission.then(|| Field { size, values: extinction.iter().map(glow).collect(), transform });
    let emitted = emission.iter().flat_map(|e: &Field| &e.values).flat_map(|e| e.to_array()).collect();
    let volume = Volume {
        size,
        density: extinction.clone(),
        scale: 1.0,
        albedo: Vec3f::from_array(albedo),
        albedos: Vec::new(),
        emission,
        g: a.anisotropy as f32,
        transform,
    };
    let Surroundings { lights, environment } = surroundings.clone();
    let world = World::new(Parts { lights, environment, volumes: vec![volume], ..Parts::default() })
        .map_err(|e| anyhow!("{}: {e}", file.display()))?;
    let views = views_around((0.5 * (lo + hi)).as_vec3(), (0.5 * (hi - lo).length()) as f32, a.views);
    let mut options = RenderOptions {
        width: a.resolution,
        height: a.resolution,
        spp: TARGET_SPP,
        seed: TARGET_SEED,
        ..RenderOptions::default()
    };
    options.path.max_depth = a.max_depth;
    let picture = |view: &View| -> Result<Image> {
        let mut renderer = Renderer::new(&world, view, options.clone())?;
        renderer.finish();
        Ok(renderer.picture())
    };
    let pictures = self_test_pictures(&views, picture)?;
    Ok(Seen {
        surroundings,
        views,
        pictures,
        truth: Some(Known { size, extinction, emission: emitted, bounds }),
    })
}

/// Writes what was found and tells it.
fn write(a: &RecoverVolume, seen: &Seen, r: &RecoveredVolume, seconds: f64) -> Result<()> {
    let mut results = Results::default();
    let grids = [(FILES[0], &r.extinction), (FILES[1], &r.albedo), (FILES[5], &r.emission)];
    for (file, values) in grids.into_iter().filter(|g| !g.1.is_empty()) {
        let bytes = encode_grid(r.size, values, r.bounds);
        results.took(write_atomically(a.output.join(file).as_path(), &bytes).map_err(Into::into));
    }
    let left = a.output.join(FILES[5]);
    if r.emission.is_empty() && left.exists() {
        say(&format!(
            "warning: {}: is left from another run; this one looked for no emission",
            left.display()
        ));
    }
    let [first, best] = first_and_best(&r.history);
    let truth = seen.truth.as_ref().filter(|t| t.size == r.size && t.bounds == r.bounds);
    let extinction_errors = truth.map(|t| errors(&t.extinction, &r.extinction));
    let emission_errors = truth.filter(|t| !t.emission.is_empty()).map(|t| errors(&t.emission, &r.emission));
    let mut figures = figures(a, r, ([first, best], extinction_errors), seconds);
    figures["emission_error"] =
        json!(emission_errors.map(|[first, last]| json!({ "first": first, "last": last })));
    output::keep_json(&mut results, &a.output.join(FILES[3]), &figures)?;
    let sheet = sheet(&r.model, &seen.views, &seen.pictures, (SHOWN_SPP, SHOWN_SEED))?;
    results.took(photofit_image::write_png(a.output.join(FILES[2]), &sheet).map_err(Into::into));
    let [x, y, z] = r.size;
    let grids: Vec<String> = r.grids.iter().map(|(_, side)| side.to_string()).collect();
    let mut text = format!("{x} x {y} x {z} voxels, grids of {} along the longest side\n", grids.join(", "));
    if let Some([nothing, found]) = extinction_errors {
        text +=
            &format!("root mean square error of the extinction: {found:.4}; of an empty box {nothing:.4}\n");
    }
    if let Some([nothing, found]) = emission_errors {
        text += &format!("root mean square error of the emission: {found:.4}; of none {nothing:.4}\n");
    }
    let judged = judged(r.held_out, seen.views.len());
    let reached = output::traced_error(&judged, [first, best], (r.steps, seconds));
    let found = Found {
        title: format!("a cloud on {x} x {y} x {z} voxels"),
        reached: &reached,
        model: &r.model,
        views: &seen.views,
        targets: &seen.pictures,
        held_out: r.held_out,
        history: &r.history,
        plan: &r.plan,
        sampled: (SHOWN_SPP, SHOWN_SEED),
    };
    found.tell(&a.output, &text, results)
}

/// Root mean square errors of nothing and of what was found.
fn errors(truth: &[f32], found: &[f32]) -> [f64; 2] {
    let of = |v: &dyn Fn(usize) -> f32| {
        let squares = (0..truth.len()).map(|i| f64::from(v(i) - truth[i]).powi(2));
        (squares.sum::<f64>() / truth.len() as f64).sqrt()
    };
    [of(&|_| 0.0), of(&|i| found[i])]
}

fn figures(
    a: &RecoverVolume,
    r: &RecoveredVolume,
    ([first, best], errors): ([Option<f64>; 2], Option<[f64; 2]>),
    seconds: f64,
) -> Value {
    let own = r.steps.saturating_sub(r.resumed);
    json!({
        "pictures": a.pictures.as_ref().or(a.self_test.as_ref()).map(|p| p.display().to_string()),
        "voxels": r.size,
        "box": r.bounds.map(|p| p.to_array()),
        "grids": r.grids.iter().map(|(step, side)| json!({ "first_step": step, "side": side })).collect::<Vec<_>>(),
        "held_out": r.held_out,
        "steps": r.steps,
        "stopped": r.stopped,
        "seconds": seconds,
        "seconds_per_iteration": (own > 0).then(|| seconds / own as f64),
        "relative_error": { "first": first, "best": best },
        "parameter_error": errors.map(|[first, last]| json!({ "first": first, "last": last })),
        "course": course(&r.history),
    })
}

//! `photofit recover mesh`: a shape from pictures of it.

use crate::args::RecoverMesh;
use crate::fields::{RECOVER_MESH, name_options};
use crate::preflight::Places;
use crate::progress::{Terminal, say_warnings};
use crate::recovery::Recovery;
use crate::simplify::name;
use crate::status::Ending;
use crate::{device, interrupt, memory, output, threads};
use anyhow::Result;
use photofit_fit::engine::chain::checkpoint_files;
use photofit_fit::engine::trainer::HistoryPoint;
use photofit_fit::footprint::Task;
use photofit_fit::pictures::named_files;
use photofit_fit::recover_mesh::{
    MOST_LEVELS, PictureSource, RecoverMeshOptions, RecoveredMesh, ShapeError, recover_mesh,
};
use photofit_fit::report::PAGE as REPORT_PAGE;
use photofit_scene::Scene;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

pub(crate) fn run(a: &RecoverMesh) -> Result<Ending> {
    let levels = checkpoint_files(MOST_LEVELS as usize + 1);
    let states: Vec<&str> = levels.iter().map(String::as_str).collect();
    let places = Places::default()
        .reads("PICTURES", a.pictures.as_deref())
        .reads("--self-test", a.self_test.as_deref())
        .reads("--mesh", a.mesh.as_deref())
        .writes("--output", Some(&a.output))
        .writes("--json", a.course.json.as_deref())
        .fills("--report", a.course.report.as_deref(), &[REPORT_PAGE])
        .fills("--checkpoint", a.course.running.checkpoint.as_deref(), &states);
    places.check()?;
    if let Some(pictures) = &a.pictures {
        places.check_against("PICTURES", &named_files(pictures))?;
    }
    threads::set(a.course.running.threads)?;
    let device = device::choose(&a.course.device)?;
    let load = |option: &'static str, path: &Option<PathBuf>| {
        let scene = path.as_ref().map(photofit_scene::load).transpose()?;
        if let Some(scene) = &scene {
            places.check_against(option, &scene.files)?;
            path.iter().for_each(|file| say_warnings(file, scene));
        }
        anyhow::Ok(scene)
    };
    let (asset, mesh) = (load("--self-test", &a.self_test)?, load("--mesh", &a.mesh)?);
    let assets: Vec<&Scene> = asset.iter().chain(&mesh).collect();
    memory::check_fit(Task::Recover, a.texture_size, &a.output, &assets)?;
    let folder = a.pictures.as_deref().unwrap_or(Path::new("."));
    let source = match &asset {
        Some(asset) => PictureSource::Asset { asset, views: a.views, size: a.picture_size },
        None => PictureSource::Folder(folder),
    };
    let options = RecoverMeshOptions {
        optimizer: a.optimizer,
        device,
        triangles: a.triangles,
        texture_size: a.texture_size,
        steps: a.steps,
        batch: a.course.batch,
        seed: a.course.running.seed,
        checkpointing: a.course.checkpointing(),
    };
    interrupt::handle();
    let progress = Terminal::new();
    let r = recover_mesh(source, mesh.as_ref(), &a.output, &options, &progress)
        .map_err(|e| name_options(RECOVER_MESH, e))?;
    progress.finish();
    let [all, held_out] = r.pictures;
    let recovery = Recovery {
        title: format!("{} from pictures", name(&a.output)),
        stages: [("start", &r.start), ("recovered", &r.quality)],
        views: &r.views,
        judged: format!("{held_out} of {all} pictures, which were held out."),
        history: &r.history,
        measure: "held-out quality, dB",
        plan: &r.plan,
        left_out: (a.mesh.as_deref().unwrap_or(Path::new("")), &r.left_out),
        stopped: r.stopped,
    };
    recovery.tell(&a.course, &a.output, &told(a, &r), to_json(a, &r))
}

fn told(a: &RecoverMesh, r: &RecoveredMesh) -> String {
    let mut text = String::new();
    if let Some([first, last]) = &r.shape_error {
        let line = |name: &str, e: &ShapeError| {
            format!(
                "{name}: {:.2}% of the bounding radius away on average, 95% below {:.2}%, normals {:.1} degrees off\n",
                e.mean, e.p95, e.normals
            )
        };
        text += &format!("{}{}\n", line("start", first), line("recovered", last));
    }
    let [all, held_out] = r.pictures;
    let light = if r.lit { "known lights" } else { "no lights given: the colour is unlit" };
    text += &format!(
        "{all} pictures, {held_out} of them held out and judged by; {light}; {}; {}\nwrote {}\n",
        output::counted(r.steps as usize, "step"),
        output::counted(r.triangles[1], "triangle"),
        a.output.display()
    );
    text
}

fn to_json(a: &RecoverMesh, r: &RecoveredMesh) -> Value {
    let path = |p: &Option<PathBuf>| p.as_ref().map(|p| p.display().to_string());
    let error = |e: &ShapeError| json!({ "mean_percent": e.mean, "p95_percent": e.p95, "normals_degrees": e.normals });
    let losses: Vec<f64> = r.history.iter().filter_map(HistoryPoint::training_loss).collect();
    let history: Vec<Value> = r
        .history
        .iter()
        .map(|h| json!({ "step": h.step, "loss": h.training_loss(), "quality": h.quality }))
        .collect();
    json!({
        "pictures": path(&a.pictures),
        "self_test": path(&a.self_test),
        "mesh": path(&a.mesh),
        "output": a.output.display().to_string(),
        "loss": { "first": losses.first(), "last": losses.last() },
        "shape_error": r.shape_error.as_ref().map(|[first, last]| json!({ "first": error(first), "last": error(last) })),
        "history": history,
        "seconds_per_iteration": r.seconds_per_iteration,
        "pictures_read": r.pictures[0],
        "pictures_held_out": r.pictures[1],
        "lit": r.lit,
        "triangles": r.triangles[1],
        "device": r.device,
        "steps": r.steps,
    })
}

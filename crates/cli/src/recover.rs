//! `photofit recover`: parameters of an asset from pictures of it.

use crate::args::{Recover, RecoverTexture};
use crate::fields::{RECOVER_TEXTURE, name_options};
use crate::preflight::Places;
use crate::progress::{Terminal, say_warnings};
use crate::recovery::Recovery;
use crate::simplify::{CHECKPOINT_FILE, name};
use crate::status::Ending;
use crate::{device, interrupt, memory, output, threads};
use anyhow::Result;
use photofit_fit::footprint::Task;
use photofit_fit::pictures::named_files;
use photofit_fit::recover::{RecoverOptions, Recovered, recover_texture};
use photofit_fit::report::PAGE as REPORT_PAGE;
use serde_json::{Value, json};

pub(crate) fn run(a: &Recover) -> Result<Ending> {
    match a {
        Recover::Texture(a) => texture(a),
        Recover::Mesh(a) => crate::recover_mesh::run(a),
        Recover::Scene(a) => crate::recover_scene::run(a),
        Recover::Material(a) => crate::recover_material::run(a),
        Recover::Volume(a) => crate::recover_volume::run(a),
    }
}

fn texture(a: &RecoverTexture) -> Result<Ending> {
    let places = Places::default()
        .reads("PICTURES", Some(&a.pictures))
        .reads("--mesh", Some(&a.mesh))
        .writes("--output", Some(&a.output))
        .writes("--json", a.course.json.as_deref())
        .fills("--report", a.course.report.as_deref(), &[REPORT_PAGE])
        .fills("--checkpoint", a.course.running.checkpoint.as_deref(), &[CHECKPOINT_FILE]);
    places.check()?;
    places.check_against("PICTURES", &named_files(&a.pictures))?;
    threads::set(a.course.running.threads)?;
    let device = device::choose(&a.course.device)?;
    let options = RecoverOptions {
        texture_size: a.texture_size,
        steps: a.steps,
        batch: a.course.batch,
        loss: a.loss,
        device,
        seed: a.course.running.seed,
        checkpointing: a.course.checkpointing(),
    };
    let mesh = photofit_scene::load(&a.mesh)?;
    places.check_against("--mesh", &mesh.files)?;
    say_warnings(&a.mesh, &mesh);
    memory::check_fit(Task::Recover, a.texture_size, &a.mesh, &[&mesh])?;
    interrupt::handle();
    let progress = Terminal::new();
    let r = recover_texture(&a.pictures, &mesh, &a.output, &options, &progress)
        .map_err(|e| name_options(RECOVER_TEXTURE, e))?;
    progress.finish();
    let [all, held_out] = r.pictures;
    let light = if r.lit { "known lights" } else { "no lights given: the colour is unlit" };
    let text = format!(
        "{all} pictures, {held_out} of them held out and judged by; {light}; {}\nwrote {}\n",
        output::counted(r.steps as usize, "step"),
        a.output.display()
    );
    let recovery = Recovery {
        title: format!("{} from pictures", name(&a.mesh)),
        stages: [("start", &r.start), ("recovered", &r.quality)],
        views: &r.views,
        judged: format!("{held_out} of {all} pictures, which were held out; {light}."),
        history: &r.history,
        measure: "held-out quality, dB",
        plan: &r.plan,
        left_out: (&a.mesh, &r.left_out),
        stopped: r.stopped,
    };
    recovery.tell(&a.course, &a.output, &text, to_json(a, &r))
}

fn to_json(a: &RecoverTexture, r: &Recovered) -> Value {
    json!({
        "pictures": a.pictures.display().to_string(),
        "mesh": a.mesh.display().to_string(),
        "output": a.output.display().to_string(),
        "pictures_read": r.pictures[0],
        "pictures_held_out": r.pictures[1],
        "pictures_without_alpha": r.without_alpha,
        "lit": r.lit,
        "triangles": r.triangles,
        "device": r.device,
        "steps": r.steps,
    })
}

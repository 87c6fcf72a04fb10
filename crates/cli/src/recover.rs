//! `photofit recover`: parameters of an asset from pictures of it.

use crate::args::{Recover, RecoverTexture};
use crate::output::{self, print};
use crate::preflight::Places;
use crate::progress::{Terminal, say};
use crate::simplify::{CHECKPOINT_FILE, name_options};
use crate::status::Ending;
use crate::{interrupt, threads};
use anyhow::Result;
use photofit_fit::pictures::named_files;
use photofit_fit::recover::{RecoverOptions, Recovered, recover_texture};
use photofit_fit::report::{PAGE as REPORT_PAGE, RecoveryReport, write_recovery_report};
use photofit_fit::simplify::Quality;
use serde_json::{Value, json};

pub(crate) fn run(a: &Recover) -> Result<Ending> {
    match a {
        Recover::Texture(a) => texture(a),
        Recover::Mesh(a) => crate::recover_mesh::run(a),
        Recover::Scene(a) => crate::recover_scene::run(a),
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
    let options = RecoverOptions {
        texture_size: a.texture_size,
        steps: a.steps,
        batch: a.course.batch,
        seed: a.course.running.seed,
        keeping: a.course.keeping(),
    };
    let mesh = photofit_scene::load(&a.mesh)?;
    places.check_against("--mesh", &mesh.files)?;
    interrupt::handle();
    let progress = Terminal::new();
    let r = recover_texture(&a.pictures, &mesh, &a.output, &options, &progress).map_err(name_options)?;
    progress.finish();
    if r.stopped {
        say("the fit was ended early; what was reached is written");
    }
    if a.course.explain {
        print(&format!("what ran:\n{}\n\n", r.plan))?;
    }
    let [all, held_out] = r.pictures;
    let light = if r.lit { "known lights" } else { "no lights given: the colour is unlit" };
    let mut text = output::quality_table(&[("start", &r.start), ("recovered", &r.quality)]);
    text += &format!(
        "\n{all} pictures, {held_out} of them held out and judged by; {light}; {} steps\nwrote {}\n",
        r.steps,
        a.output.display()
    );
    if let Some(folder) = &a.course.report {
        let page = write_recovery_report(
            folder,
            &RecoveryReport {
                title: format!("{} from pictures", crate::simplify::name(&a.mesh)),
                summary: recovered(&r.start, &r.quality),
                stages: &["start", "recovered"],
                views: &r.views,
                judged: format!("{held_out} of {all} pictures, which were held out. {light}."),
                history: &r.history,
                measure: "held-out quality, dB",
                plan: r.plan.to_string(),
                command: output::command_line(),
            },
        )?;
        text += &format!("report: {}\n", page.display());
    }
    if let Some(path) = &a.course.json {
        output::write_json(path, &to_json(a, &r))?;
    }
    print(&text)?;
    let stopped = r.stopped && interrupt::is_stopping();
    Ok(if stopped { Ending::Stopped } else { Ending::Done })
}

/// What the figures of two stages say, in a sentence.
pub(crate) fn recovered(start: &Quality, end: &Quality) -> String {
    format!("PSNR {} -> {} dB, FLIP {:.3} -> {:.3}", start.decibels(1), end.decibels(1), start.flip, end.flip)
}

fn to_json(a: &RecoverTexture, r: &Recovered) -> Value {
    json!({
        "pictures": a.pictures.display().to_string(),
        "mesh": a.mesh.display().to_string(),
        "output": a.output.display().to_string(),
        "start": output::quality(&r.start),
        "recovered": output::quality(&r.quality),
        "views": r.views.iter().map(|v| output::quality(&v.quality[1].quality)).collect::<Vec<_>>(),
        "pictures_read": r.pictures[0],
        "pictures_held_out": r.pictures[1],
        "pictures_without_alpha": r.without_alpha,
        "lit": r.lit,
        "triangles": r.triangles,
        "steps": r.steps,
        "stopped": r.stopped,
    })
}

//! `photofit retexture`: maps of a light asset that make it look like a heavy one, at rest and in motion.

use crate::args::Retexture;
use crate::fields::{RETEXTURE, explain_error};
use crate::preflight::Places;
use crate::progress::{Terminal, say, say_warnings};
use crate::recovery::Recovery;
use crate::simplify::{CHECKPOINT_FILE, name};
use crate::status::Ending;
use crate::{animation, device, interrupt, light, memory, output, threads};
use anyhow::Result;
use photofit_fit::FitError;
use photofit_fit::engine::Normalised;
use photofit_fit::engine::animated::Animated;
use photofit_fit::engine::judge::{Judged, WIDEST_TRACED};
use photofit_fit::engine::reference::SAMPLES;
use photofit_fit::footprint::Task;
use photofit_fit::report::PAGE as REPORT_PAGE;
use photofit_fit::retexture::{RetextureOptions, Retextured, retexture};
use photofit_fit::simplify::Written;
use photofit_fit::views::Moment;
use photofit_scene::Scene;
use serde_json::{Value, json};

pub(crate) fn run(a: &Retexture) -> Result<Ending> {
    let places = Places::default()
        .reads("REFERENCE", Some(&a.reference))
        .reads("LIGHT", Some(&a.light_asset))
        .reads("--env", a.lighting.env.as_deref())
        .writes("--output", Some(&a.output))
        .writes("--json", a.course.json.as_deref())
        .fills("--report", a.course.report.as_deref(), &[REPORT_PAGE])
        .fills("--checkpoint", a.course.running.checkpoint.as_deref(), &[CHECKPOINT_FILE]);
    places.check()?;
    threads::set(a.course.running.threads)?;
    let device = device::choose(&a.course.device)?;
    let lighting = light::lighting(&a.lighting)?;
    let [reference, asset] = [("REFERENCE", &a.reference), ("LIGHT", &a.light_asset)].map(|(name, file)| {
        let scene = photofit_scene::load(file)?;
        places.check_against(name, &scene.files)?;
        say_warnings(file, &scene);
        Ok::<Scene, anyhow::Error>(scene)
    });
    let (reference, asset) = (reference?, asset?);
    for (file, scene) in [(&a.reference, &reference), (&a.light_asset, &asset)] {
        scene.validate_for_fit().map_err(|e| explain_error(RETEXTURE, file, e.into()))?;
    }
    memory::check_fit(Task::Retexture, a.texture_size, &a.reference, &[&reference, &asset])?;
    let options = RetextureOptions {
        moments: moments(a, &reference, &asset)?,
        resolution: a.resolution,
        texture_size: a.texture_size,
        steps: a.steps,
        fit_shape: a.fit_shape,
        batch: a.course.batch,
        lighting,
        seed: a.course.running.seed,
        device,
        checkpointing: a.course.checkpointing(),
        ..RetextureOptions::default()
    };
    interrupt::handle();
    let progress = Terminal::new();
    let r = retexture(&reference, &asset, &a.output, &options, &progress).map_err(|e| failed(a, e))?;
    progress.finish();
    for line in &r.not_fitted {
        say(&format!("{}: kept, but not drawn while fitting: {line}", a.reference.display()));
    }
    if r.written == Written::Baked && r.steps > 0 {
        say("no fit looked better than its start, baked maps, which is what was written");
    }
    let moments = match options.moments.len() {
        0 => "as both stand".to_owned(),
        n => format!("at {}", output::counted(n, "moment")),
    };
    let drawn = match r.judged {
        Judged::PathTraced => {
            format!("path traced at most {WIDEST_TRACED} pixels wide, with {SAMPLES} samples a pixel")
        }
        Judged::Rasterized | Judged::RasterizedAgainst(_) => "rasterized".to_owned(),
    };
    let views = output::counted(r.views.len(), "view");
    let text = format!(
        "{views}, {moments}, {drawn}; {}\nwrote {}: {}\n",
        output::counted(r.steps as usize, "step"),
        a.output.display(),
        output::counted(asset.triangle_count(), "triangle")
    );
    let recovery = Recovery {
        title: format!("{} in the look of {}", name(&a.light_asset), name(&a.reference)),
        stages: [("baked", &r.start), ("file", &r.quality)],
        views: &r.views,
        judged: format!("{views} that the fit never saw, {moments}, {drawn}."),
        history: &r.history,
        measure: "held-out PSNR, dB",
        plan: &r.plan,
        left_out: (&a.reference, &r.left_out),
        stopped: r.stopped,
    };
    recovery.tell(&a.course, &a.output, &text, to_json(a, &options, &r))
}

/// An error with the asset that it is about.
fn failed(a: &Retexture, error: FitError) -> anyhow::Error {
    let file = match &error {
        FitError::Setting { field: "reference_asset" | "asset", .. } => &a.reference,
        _ => &a.light_asset,
    };
    explain_error(RETEXTURE, file, error)
}

/// The moments that are compared, in animations of the reference.
fn moments(a: &Retexture, reference: &Scene, asset: &Scene) -> Result<Vec<Moment>> {
    let of = |scene: &Scene| scene.hierarchy.as_ref().map_or(0, |h| h.animations.len());
    if a.moments == 0 || of(reference) == 0 {
        let none = a.animation.first().map(|name| animation::index(&a.reference, reference, name));
        none.transpose()?;
        return Ok(Vec::new());
    }
    let n = Normalised::new(reference).map_err(|e| explain_error(RETEXTURE, &a.reference, e))?;
    let theirs = Animated::new(reference, &n);
    let own = Animated::new(asset, &n).playing(&n.light_asset.animations);
    let wanted: Vec<usize> = match &a.animation[..] {
        [] => (0..of(reference)).filter(|i| own.plays(*i)).collect(),
        names => {
            names.iter().map(|name| animation::index(&a.reference, reference, name)).collect::<Result<_>>()?
        }
    };
    if wanted.is_empty() && of(asset) > 0 {
        let names: Vec<String> = n.light_asset.animations.iter().map(|name| format!("\"{name}\"")).collect();
        say(&format!(
            "warning: {}: has none of the reference's animations, {}; both are compared as they stand",
            a.light_asset.display(),
            names.join(", ")
        ));
    }
    Ok(wanted.into_iter().flat_map(|i| theirs.moments(i, a.moments)).collect())
}

fn to_json(a: &Retexture, options: &RetextureOptions, r: &Retextured) -> Value {
    json!({
        "reference": a.reference.display().to_string(),
        "light": a.light_asset.display().to_string(),
        "output": a.output.display().to_string(),
        "moments": options.moments.iter().map(|m| json!({ "animation": m.animation, "time": m.time })).collect::<Vec<_>>(),
        "not_fitted": r.not_fitted,
        "judged": match r.judged {
            Judged::PathTraced => "path traced",
            Judged::Rasterized | Judged::RasterizedAgainst(_) => "rasterized",
        },
        "written": r.written.name(),
        "device": r.device,
        "fit_shape": a.fit_shape && r.steps > 0,
        "steps": r.steps,
    })
}

//! `photofit simplify --lod`: a chain of levels of detail.

use crate::args::Simplify;
use crate::fields::{SIMPLIFY, explain_error, misuse};
use crate::output::{self, print};
use crate::preflight::Places;
use crate::progress::{Terminal, say};
use crate::simplify::{CHECKPOINT_FILE, Job, SUITE, end, ending, load, name, options, steps, within};
use crate::status::Ending;
use crate::threads;
use anyhow::{Error, Result};
use photofit_fit::FitError;
use photofit_fit::engine::chain::part_folder;
use photofit_fit::engine::judge::Judged;
use photofit_fit::lod::{
    Blend, Level, LodChain, LodOptions, SurfaceDistance, combined_path, level_path, report_folder,
    simplify_chain, summary_path,
};
use photofit_fit::report::PAGE;
use photofit_fit::simplify::{TRACED_FOLDER, too_large_path};
use photofit_scene::Scene;
use serde_json::{Value, json};
use std::path::Path;

/// What a chain of `levels` levels reads and writes.
fn places(a: &Simplify, levels: usize) -> Places {
    let mut places = Places::default()
        .reads("IN", Some(&a.input))
        .reads("--env", a.lighting.env.as_deref())
        .writes("--lod", Some(&summary_path(&a.output)))
        .writes("--json", a.json.as_deref());
    if a.msft_lod {
        places = places.writes("--msft-lod", Some(&combined_path(&a.output)));
    }
    let traced = format!("{TRACED_FOLDER}/{CHECKPOINT_FILE}");
    for k in 0..levels {
        let report = a.report.as_ref().map(|f| report_folder(f, k));
        let checkpoint = a.running.checkpoint.as_ref().map(|f| part_folder(f, k));
        let level = level_path(&a.output, k);
        places = places
            .writes(if k == 0 { "--output" } else { "--lod" }, Some(&level))
            .writes("--max-bytes", a.max_bytes.map(|_| too_large_path(&level)).as_deref())
            .fills("--report", report.as_deref(), &[PAGE])
            .fills("--checkpoint", checkpoint.as_deref(), &[CHECKPOINT_FILE, &traced]);
    }
    places
}

pub(crate) fn run(a: &Simplify) -> Result<Ending> {
    // As many as the range of levels allows, so that a list that is too long is told as such.
    let places = places(a, a.lod.len().min(photofit_fit::lod::MOST_LEVELS));
    places.check()?;
    threads::set(a.running.threads)?;
    let options = LodOptions {
        sizes: a.lod.clone(),
        triangles: a.lod_triangles.clone(),
        combined: a.msft_lod,
        continuous: a.continuous,
        fit: options(a)?,
        texture_size: a.texture_size,
    };
    options.check(usize::MAX).map_err(|e| misuse(SIMPLIFY, of_command(e)))?;
    let scene = load(a)?;
    places.check_against("IN", &scene.files)?;
    let whole =
        Job { command: SIMPLIFY, input: &a.input, output: &a.output, report: None, explain: a.explain };
    let first = options.level(0);
    whole.check(&scene, &first)?;
    let told = |e| explain_error(SIMPLIFY, &a.input, of_command(e));
    options.check(scene.triangle_count()).map_err(told)?;
    whole.begin(&scene, &first, &first.resolved(&scene).map_err(told)?)?;
    let progress = Terminal::with_rounds(steps(options.fit.fit_with));
    let chain = simplify_chain(&scene, &a.output, &options, &progress).map_err(told)?;
    progress.finish();
    let summary = summary_path(&a.output);
    let (figures, unwritten) = tell(a, &scene, &chain, &progress.warned())?;
    if a.explain {
        output::name_suite(SUITE)?;
    }
    // What cannot be written keeps nothing else from being written.
    let summarised = output::write_json(&summary, &summarised(&chain));
    if summarised.is_ok() {
        print(&format!("wrote {}\n", summary.display()))?;
    }
    let written = a.json.as_ref().map_or(Ok(()), |path| output::write_json(path, &figures));
    let levels = chain.levels.iter().enumerate();
    let too_large: Vec<Error> =
        levels.filter_map(|(k, level)| within(a, &level_path(&a.output, k), &level.path).err()).collect();
    if a.msft_lod && !too_large.is_empty() {
        let combined = combined_path(&a.output);
        say(&format!("{}: is not written: a level has too many bytes", combined.display()));
    }
    let failed = chain.failed.map_or(Ok(()), |e| Err(told(e)));
    let failed = failed.and(unwritten.map_or(Ok(()), Err)).and(summarised).and(written);
    if let Err(e) = failed {
        too_large.iter().for_each(|e| say(&e.to_string()));
        return Err(e);
    }
    end(ending(chain.stopped), too_large)
}

/// An error with the options of a chain in place of the fields.
fn of_command(error: FitError) -> FitError {
    let option = |field: &str| match field {
        "sizes" => Some("lod"),
        "triangles" => Some("lod_triangles"),
        _ => None,
    };
    match error {
        FitError::Setting { field, rule } => {
            FitError::Setting { field: option(field).unwrap_or(field), rule }
        }
        FitError::OtherFit { path, mut differences } => {
            for d in &mut differences {
                d.field = option(&d.field).map_or_else(|| d.field.clone(), str::to_owned);
            }
            FitError::OtherFit { path, differences }
        }
        error => error,
    }
}

/// Reports every level, with the warnings of the chain; all figures as JSON, and why a report is not written.
fn tell(
    a: &Simplify,
    scene: &Scene,
    chain: &LodChain,
    warnings: &[String],
) -> Result<(Value, Option<Error>)> {
    let (mut levels, mut unwritten) = (Vec::new(), None);
    for (k, level) in chain.levels.iter().enumerate() {
        print(&format!("level {} of {}, for {} pixels\n", k + 1, a.lod.len(), level.size))?;
        let report = a.report.as_ref().map(|folder| report_folder(folder, k));
        let job = Job {
            command: SIMPLIFY,
            input: &a.input,
            output: &level.path,
            report: report.as_deref(),
            explain: a.explain,
        };
        // Those of the other levels begin with their names.
        let own = format!("level {} of ", k + 1);
        let warnings: Vec<String> =
            warnings.iter().filter(|w| !w.starts_with("level ") || w.starts_with(&own)).cloned().collect();
        let (mut figures, failed) = job.tell(scene, Some(level.size), &level.outcome, &warnings)?;
        unwritten = unwritten.or(failed);
        figures["size"] = json!(level.size);
        figures["switch_size"] = json!(level.switch_size);
        figures["popping_flip"] = json!(level.popping.map(|p| p.flip));
        figures["popping_outline"] = json!(level.popping.map(|p| p.outline));
        if let Some(blend) = &level.blend {
            figures["blend"] = blended(blend);
            print(&told(level, blend))?;
        }
        levels.push(figures);
        print("\n")?;
    }
    if let Some(path) = &chain.combined {
        print(&format!("wrote {}\n", path.display()))?;
    }
    if chain.levels.len() < a.lod.len() && chain.failed.is_none() {
        let made = chain.levels.len();
        say(&format!("{made} of {} levels are written: the chain was stopped", a.lod.len()));
    }
    let combined = chain.combined.as_deref().map(shown);
    Ok((json!({ "levels": levels, "stopped": chain.stopped, "combined": combined }), unwritten))
}

/// How a level becomes the next one.
fn blended(b: &Blend) -> Value {
    let distance = |a: &SurfaceDistance| {
        json!({
            "max": a.largest,
            "mean": a.mean,
            "max_back": a.largest_back,
            "mean_back": a.mean_back,
        })
    };
    json!({
        "target": b.target,
        "weight_0_size": b.sizes[0],
        "weight_1_size": b.sizes[1],
        "normals": b.normals,
        "popping_flip": b.popping.flip,
        "popping_outline": b.popping.outline,
        "distance_weight_0": distance(&b.before),
        "distance_weight_1": distance(&b.after),
        "turned_triangles": b.turned,
        "flattened_triangles": b.flattened,
    })
}

/// The same in a line.
fn told(level: &Level, b: &Blend) -> String {
    let (was, is) = (level.popping.unwrap_or_default(), b.popping);
    let mean = |a: &SurfaceDistance| 100.0 * a.mean.max(a.mean_back);
    format!(
        "turns into {} from {:.0} to {:.0} pixels; at the switch {:.1}% of the covered pixels change in place of {:.1}%, FLIP is {:.3} in \
         place of {:.3}, the mean distance {:.3}% of the diagonal in place of {:.3}%\n",
        b.target,
        b.sizes[0],
        b.sizes[1],
        100.0 * is.outline,
        100.0 * was.outline,
        is.flip,
        was.flip,
        mean(&b.after),
        mean(&b.before),
    )
}

fn shown(path: &Path) -> String {
    path.display().to_string()
}

/// What a program that shows the levels needs to know, and how good they are.
fn summarised(chain: &LodChain) -> Value {
    let level = |l: &Level| {
        let (q, original) = (l.quality(), l.outcome.stage("original"));
        json!({
            "file": name(&l.path),
            "triangles": l.outcome.triangles_out,
            "bytes": l.bytes,
            "size": l.size,
            "switch_size": l.switch_size,
            "judged": match l.outcome.judged {
                Judged::Rasterized => "rasterized, one sample a pixel".to_owned(),
                Judged::RasterizedAgainst(reference) => {
                    format!("rasterized against a {} original", reference.name)
                }
                Judged::PathTraced => "path traced, at most 256 pixels wide".to_owned(),
            },
            "psnr": q.psnr,
            "flip": q.flip,
            "luminance_ratio": q.luminance,
            "original_psnr": original.map(|q| q.psnr),
            "original_flip": original.map(|q| q.flip),
            "popping_flip": l.popping.map(|p| p.flip),
            "popping_outline": l.popping.map(|p| p.outline),
            "blend": l.blend.as_ref().map(blended),
            "seconds": l.outcome.seconds,
        })
    };
    json!({
        "levels": chain.levels.iter().map(level).collect::<Vec<_>>(),
        "combined": chain.combined.as_deref().map(name),
        "stopped": chain.stopped,
    })
}

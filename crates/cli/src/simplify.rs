//! `photofit simplify`: the main job.

use crate::args::{
    FitEffort, FitReference, FitWith, GeometryFormat, MipLevels, OcclusionMaps, Simplify, Start,
    TextureFormat,
};
use crate::fields::{Command, SIMPLIFY, explain_error, misuse};
use crate::output::{self, print};
use crate::preflight::Places;
use crate::progress::{Terminal, say, say_warnings};
use crate::status::Ending;
use crate::{device, interrupt, light, lod, memory, threads};
use anyhow::{Error, Result, anyhow, bail};
use photofit_fit::bake::{Occlusion, OcclusionRays};
use photofit_fit::engine::trainer::HistoryPoint;
use photofit_fit::footprint::Task;
use photofit_fit::report::{PAGE as REPORT_PAGE, ReportInfo, Verdict, write_report};
use photofit_fit::simplify::{
    Appearance, Effort, FitRenderer, Init, JudgeRenderer, Judged, Mips, Outcome, Quality, ReferenceRenderer,
    Resolved, SimplifyOptions, TRACED_FOLDER, Written, simplify_resolved, too_large_path,
};
use photofit_fit::traced_maps::MapsCourse;
use photofit_geometry::decimate::Target;
use photofit_scene::{Compression, Limits, Precision, Scene, TextureEncoding};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Share of the triangles that is kept when no budget is given.
const DEFAULT_RATIO: f64 = 0.03;
/// Quality of lossy textures when none is given.
const TEXTURE_QUALITY: u8 = 90;
/// Name of the state in the folder of --checkpoint.
pub(crate) const CHECKPOINT_FILE: &str = "fit.ckpt";
/// The benchmark that measures what the plan skips.
pub(crate) const SUITE: &str = "raster";
/// The steps of the job, each with the stages that it reports.
const STEPS: &[&[&str]] = &[
    &["visibility"],
    &["triangles", "decimate"],
    &["wrap"],
    &["atlas", "bake"],
    &["fit"],
    &["choose", "report"],
];
/// The same with maps that are fitted through the path tracer.
const STEPS_WITH_MAPS: &[&[&str]] = &[
    &["visibility"],
    &["triangles", "decimate"],
    &["wrap"],
    &["atlas", "bake"],
    &["fit"],
    &["choose", "maps"],
    &["report"],
];

/// The steps of the job.
pub(crate) fn steps(fit_with: FitRenderer) -> &'static [&'static [&'static str]] {
    match fit_with {
        FitRenderer::Raster => STEPS,
        FitRenderer::Path => STEPS_WITH_MAPS,
    }
}

pub(crate) fn run(a: &Simplify) -> Result<Ending> {
    if !a.lod.is_empty() {
        return lod::run(a);
    }
    let traced = format!("{TRACED_FOLDER}/{CHECKPOINT_FILE}");
    let places = Places::default()
        .reads("IN", Some(&a.input))
        .reads("--env", a.lighting.env.as_deref())
        .writes("--output", Some(&a.output))
        .writes("--max-bytes", a.max_bytes.map(|_| too_large_path(&a.output)).as_deref())
        .writes("--json", a.json.as_deref())
        .fills("--report", a.report.as_deref(), &[REPORT_PAGE])
        .fills("--checkpoint", a.running.checkpoint.as_deref(), &[CHECKPOINT_FILE, &traced]);
    places.check()?;
    threads::set(a.running.threads)?;
    let options = options(a)?;
    // What no asset could satisfy is told before one is read.
    options.check(usize::MAX).map_err(|e| misuse(SIMPLIFY, e))?;
    let scene = load(a)?;
    places.check_against("IN", &scene.files)?;
    let job = Job {
        command: SIMPLIFY,
        input: &a.input,
        output: &a.output,
        report: a.report.as_deref(),
        explain: a.explain,
    };
    let done = job.run(&scene, &options)?;
    // What cannot be written keeps nothing else from being written.
    let written = a.json.as_ref().map_or(Ok(()), |path| output::write_json(path, &done.json));
    done.unwritten.map_or(Ok(()), Err)?;
    written?;
    end(done.ending, within(a, &a.output, &done.outcome.file).err().into_iter().collect())
}

/// The ending of work with files that are `too_large`: all are told. A signal that ended it goes before them.
///
/// # Errors
/// The last of them, where no signal ended the work.
pub(crate) fn end(ending: Ending, mut too_large: Vec<Error>) -> Result<Ending> {
    let last = if ending == Ending::Stopped { None } else { too_large.pop() };
    too_large.iter().for_each(|e| say(&e.to_string()));
    last.map_or(Ok(ending), Err)
}

/// Whether anything but the bytes says how many triangles there are.
fn has_budget(a: &Simplify) -> bool {
    let budget = [a.triangles.is_some(), a.ratio.is_some(), a.error.is_some(), a.screen_size.is_some()];
    budget.contains(&true) || !a.lod.is_empty()
}

/// # Errors
/// If what was written to `file` has more bytes than `--max-bytes` asks for, so that it does not stand at `output`.
pub(crate) fn within(a: &Simplify, output: &Path, file: &Path) -> Result<()> {
    let Some(most) = a.max_bytes.filter(|_| file != output) else { return Ok(()) };
    let bytes = std::fs::metadata(file).map_or(0, |m| m.len());
    let before = if output.exists() { "; what was there is left as it was" } else { "" };
    let ways = [
        ("fewer triangles", has_budget(a)),
        ("--compress meshopt", matches!(a.compress, GeometryFormat::None)),
    ];
    let ways: Vec<&str> = ways.into_iter().filter(|(_, helps)| *helps).map(|(way, _)| way).collect();
    let lighter = match ways.join(" or ") {
        ways if ways.is_empty() => ways,
        ways => format!("; {ways} may make it lighter"),
    };
    bail!(
        "{}: is not written{before}: --max-bytes asks for at most {most} bytes, and the lightest file that was found has {bytes}: it \
         stands in {}; --max-bytes {bytes} would take it{lighter}",
        output.display(),
        file.display()
    )
}

/// The asset. Textures that are written as they were read keep their files, unless another encoding is asked for.
pub(crate) fn load(a: &Simplify) -> Result<Scene> {
    let keep_encoded = a.textures.is_none() && a.jpeg.is_none();
    let limits = Limits { keep_encoded, vertex_attribute: lock(a), ..Limits::default() };
    Ok(photofit_scene::load_with(&a.input, &limits)?)
}

/// The attribute of locked vertices, as glTF means its name.
fn lock(a: &Simplify) -> Option<String> {
    a.lock.as_ref().map(|name| name.strip_prefix('_').unwrap_or(name).to_owned())
}

pub(crate) fn options(a: &Simplify) -> Result<SimplifyOptions> {
    let target = match (a.triangles, a.ratio, a.error, a.screen_size) {
        (Some(n), ..) => Target::Triangles(n),
        (_, Some(r), ..) => Target::Ratio(r),
        (_, _, Some(e), _) => Target::Error(e),
        (.., Some(p)) => Target::ScreenSize(p),
        _ => Target::Ratio(DEFAULT_RATIO),
    };
    let lighting = light::lighting(&a.lighting)?;
    let mut default = SimplifyOptions::default().with_effort(match a.effort {
        FitEffort::Fast => Effort::Fast,
        FitEffort::Normal => Effort::Normal,
        FitEffort::Best => Effort::Best,
    });
    if let Target::ScreenSize(pixels) = target {
        default = default.for_screen_size(pixels);
    }
    Ok(SimplifyOptions {
        target,
        triangles_by_bytes: a.max_bytes.is_some() && !has_budget(a),
        init: match a.init {
            Start::Decimate => Init::Decimate,
            Start::Sphere => Init::Sphere,
        },
        resolution: a.resolution.unwrap_or(default.resolution),
        batch: a.batch,
        steps: a.steps.unwrap_or(default.steps),
        time_limit: a.time_limit,
        texture_size: a.texture_size.unwrap_or(default.texture_size),
        texture_encoding: texture_encoding(a),
        mips: match a.mips {
            MipLevels::Classic => Mips::Classic,
            MipLevels::Free => Mips::Free,
        },
        compression: match a.compress {
            GeometryFormat::None => Compression::None,
            GeometryFormat::Meshopt => Compression::Meshopt(Precision::Fine),
            GeometryFormat::MeshoptMedium => Compression::Meshopt(Precision::Medium),
            GeometryFormat::MeshoptCoarse => Compression::Meshopt(Precision::Coarse),
        },
        lighting,
        reference: match a.reference {
            FitReference::Raster => ReferenceRenderer::Raster,
            FitReference::Path => ReferenceRenderer::Path,
        },
        fit_with: match a.fit_with {
            FitWith::Raster => FitRenderer::Raster,
            FitWith::Path => FitRenderer::Path,
        },
        own_textures: !a.new_maps,
        whole_textures: a.texture_size.is_none() && a.screen_size.is_none() && a.lod.is_empty(),
        own_texture_size: a.texture_size,
        appearance: match a.textures {
            Some(TextureFormat::None) => Appearance::VertexColors,
            _ if a.keep_uvs => Appearance::Kept,
            _ => Appearance::Maps,
        },
        lock_borders: a.lock_borders,
        lock: lock(a),
        occlusion: match a.occlusion {
            OcclusionMaps::Keep => Occlusion::Maps,
            OcclusionMaps::Bake => Occlusion::Rays(OcclusionRays::default()),
            OcclusionMaps::None => Occlusion::None,
        },
        judge: a.judge.into(),
        judge_spp: a.judge_spp,
        seed: a.running.seed,
        max_bytes: a.max_bytes,
        checkpoint: a.running.checkpoint.clone(),
        resume: a.running.resume,
        device: device::choose(&a.device)?,
        ..default
    })
}

/// The fit of the maps through the path tracer.
fn traced_maps(course: &MapsCourse) -> Value {
    let point = |h: &HistoryPoint| json!({ "step": h.step, "seconds": h.seconds, "loss": h.training_loss(), "held_out_psnr": h.quality });
    json!({
        "steps": course.steps,
        "stopped": course.stopped,
        "history": course.history.iter().map(point).collect::<Vec<_>>(),
    })
}

/// One simplification with everything that is told about it.
pub(crate) struct Job<'a> {
    /// Whose options the fields of errors are.
    pub(crate) command: Command,
    pub(crate) input: &'a Path,
    pub(crate) output: &'a Path,
    pub(crate) report: Option<&'a Path>,
    pub(crate) explain: bool,
}

/// What a job leaves.
pub(crate) struct Done {
    pub(crate) outcome: Outcome,
    pub(crate) json: Value,
    pub(crate) ending: Ending,
    /// Why the report is not written.
    pub(crate) unwritten: Option<Error>,
}

impl Job<'_> {
    pub(crate) fn run(&self, scene: &Scene, options: &SimplifyOptions) -> Result<Done> {
        self.check(scene, options)?;
        let resolved = options.resolved(scene).map_err(|e| explain_error(self.command, self.input, e))?;
        self.begin(scene, options, &resolved)?;
        let progress = Terminal::with_steps(steps(options.fit_with));
        let outcome = simplify_resolved(scene, self.output, &resolved, &progress)
            .map_err(|e| explain_error(self.command, self.input, e))?;
        progress.finish();
        let screen_size = match options.target {
            Target::ScreenSize(pixels) => Some(pixels),
            _ => None,
        };
        let (json, unwritten) = self.tell(scene, screen_size, &outcome, &progress.warned())?;
        if self.explain {
            output::name_suite(SUITE)?;
        }
        Ok(Done { ending: ending(outcome.stopped), outcome, json, unwritten })
    }

    /// What comes before all else: what is wrong with the asset.
    pub(crate) fn check(&self, scene: &Scene, options: &SimplifyOptions) -> Result<()> {
        scene.validate_for_fit().map_err(|e| explain_error(self.command, self.input, e.into()))?;
        // Nothing is baked where the asset keeps its own textures.
        let side = if options.appearance == Appearance::Kept { 0 } else { options.texture_size };
        let task = match options.mips {
            Mips::Classic => Task::Simplify,
            Mips::Free => Task::SimplifyFreeMips,
        };
        memory::check_fit(task, side, self.input, &[scene])?;
        say_warnings(self.input, scene);
        Ok(())
    }

    /// What comes before the work: what options ask for, and what is made of them for the asset.
    pub(crate) fn begin(&self, scene: &Scene, options: &SimplifyOptions, resolved: &Resolved) -> Result<()> {
        if self.explain {
            let plan = resolved.options().plan(scene, options.rasterized_against().kind());
            let (effort, steps) = (options.effort, options.fit_steps());
            let asked = match options.appearance {
                Appearance::Kept => effort.about_choice(),
                _ => format!("{}; {steps} steps are asked for", effort.about()),
            };
            print(&format!("effort {}: {asked}\n", effort.name()))?;
            print(&format!("what the asset asks for:\n{plan}\n\n"))?;
        }
        let judgement = options.judgement(scene);
        if judgement.is_traced() && options.judge == JudgeRenderer::Auto {
            say(&format!(
                "the result will be judged by path tracing: {}; --judge raster takes no time, a smaller --judge-spp less",
                judgement.item().why
            ));
        }
        interrupt::handle();
        Ok(())
    }

    /// What comes after it: the plan, the report, the summary; and the figures as JSON.
    ///
    /// A report that cannot be written is given back as an error beside the figures, after all else was told.
    pub(crate) fn tell(
        &self,
        scene: &Scene,
        screen_size: Option<f64>,
        outcome: &Outcome,
        warnings: &[String],
    ) -> Result<(Value, Option<Error>)> {
        if let Some(how) = outcome.ended_early() {
            say(&format!("{how}; judged by {}", output::counted(outcome.views.len(), "view")));
        }
        if self.explain {
            print(&format!("what ran:\n{}\n\n", outcome.plan))?;
            if let Some(traced) = &outcome.traced_maps {
                print(&format!("maps through the path tracer:\n{}\n\n", traced.plan))?;
            }
        }
        for line in &outcome.left_out {
            say(&format!("warning: {}: left out: {line}", self.input.display()));
        }
        for line in &outcome.not_fitted {
            say(&format!("{}: kept, but not drawn while fitting: {line}", self.input.display()));
        }
        self.print_summary(scene, outcome)?;
        let (report, unwritten) = match self.write_report(scene, screen_size, outcome, warnings) {
            Ok(report) => (report, None),
            Err(e) => (None, Some(anyhow!("{e}: the report is not written; {} is", outcome.file.display()))),
        };
        if let Some(page) = &report {
            print(&format!("wrote {}\n", page.display()))?;
        }
        let mut json = self.json(scene, outcome, report.as_deref());
        json["warnings"] = scene.warnings.iter().chain(warnings).cloned().collect();
        json["stopped_by"] = match (outcome.stopped, ending(outcome.stopped)) {
            (false, _) => Value::Null,
            (true, Ending::Stopped) => json!("signal"),
            (true, Ending::Done) => json!("time limit"),
        };
        Ok((json, unwritten))
    }

    fn write_report(
        &self,
        scene: &Scene,
        screen_size: Option<f64>,
        outcome: &Outcome,
        warnings: &[String],
    ) -> Result<Option<PathBuf>> {
        let Some(folder) = self.report else { return Ok(None) };
        let info = ReportInfo {
            scene,
            light: &outcome.file,
            title: name(self.input),
            command: output::command_line(),
            bytes_in: Some(scene.source_bytes),
            warnings: warnings.to_vec(),
            screen_size,
        };
        Ok(Some(write_report(folder, outcome, &info)?))
    }

    fn print_summary(&self, scene: &Scene, o: &Outcome) -> Result<()> {
        let rows: Vec<(&str, Option<usize>, &Quality)> =
            o.stages.iter().map(|s| (s.name, Some(s.triangles), &s.quality)).collect();
        let mut text = output::quality_table(&rows);
        text += &format!(
            "\n{}\n{}\n{} -> {}, {} -> {}, {}, {:.1} s ({:.1} s of it until the file was written)\n",
            Verdict::of(o),
            o.judged_by(),
            output::count(o.triangles_in),
            output::counted(o.triangles_out, "triangle"),
            output::bytes(scene.source_bytes),
            bytes_of(o).map_or_else(|| "?".into(), output::bytes),
            output::counted(o.steps as usize, "step"),
            o.seconds,
            o.fit_seconds
        );
        let lighter = bytes_of(o).is_some_and(|b| b <= scene.source_bytes);
        let finer = scene.images.iter().map(|i| i.width * i.height).max()
            > Some(o.candidate.maps.levels[0].texels.len());
        // More texels help where there are more to take, and the file may still grow.
        let grows = o.max_bytes.is_none() && o.appearance == Appearance::Maps;
        if lighter && finer && grows && Verdict::of(o).better.is_some_and(|s| s.has_own_materials()) {
            text += "the asset's own materials with all their texels score better: a larger --texture-size may help\n";
        }
        if let Some(bytes) = bytes_of(o).filter(|b| *b > scene.source_bytes && scene.source_bytes > 0) {
            // In units that tell them apart.
            let (written, read) = match [bytes, scene.source_bytes].map(output::bytes) {
                [a, b] if a != b => (a, b),
                _ => (
                    output::counted(bytes as usize, "byte"),
                    output::counted(scene.source_bytes as usize, "byte"),
                ),
            };
            let ways = lighter_by(o).join(", ");
            text += &format!(
                "the written file is larger than the asset, {written} against {read}; {ways} may make it lighter\n"
            );
        }
        let geometry = match o.compression {
            Compression::None => String::new(),
            compressed => format!("; geometry: {}", compressed.name()),
        };
        text += &format!("wrote {}{geometry}; textures: {}\n", o.file.display(), o.textures);
        print(&text)
    }

    fn json(&self, scene: &Scene, o: &Outcome, report: Option<&Path>) -> Value {
        let views: Vec<Value> = o
            .views
            .iter()
            .map(|v| o.stages.iter().zip(&v.quality).map(|(s, q)| (key(s.name), output::quality(&q.quality))))
            .map(|stages| Value::Object(stages.collect()))
            .collect();
        let history: Vec<Value> = o
            .history
            .iter()
            .map(|h| json!({ "step": h.step, "seconds": h.seconds, "loss": h.training_loss(), "held_out_psnr": h.quality }))
            .collect();
        let mut out = json!({
            "input": self.input.display().to_string(),
            "output": o.file.display().to_string(),
            "report": report.map(|p| p.display().to_string()),
            "triangles_in": o.triangles_in,
            "triangles_out": o.triangles_out,
            "bytes_in": scene.source_bytes,
            "bytes_out": bytes_of(o),
            "max_bytes": o.max_bytes,
            "verdict": Verdict::of(o).likeness.to_string(),
            "written": key(o.written.name()),
            "compared": o.was_chosen(),
            "choice_cut": o.choice_cut,
            "textures": o.textures,
            "geometry": o.compression.name(),
            "seconds": o.seconds,
            "fit_seconds": o.fit_seconds,
            "seconds_to_half_db": o.seconds_to_half_db,
            "steps": o.steps,
            "effort": o.effort.name(),
            "stopped": o.stopped,
            "mpix_per_s": o.mpix_per_s,
            "peak_rss_mb": memory::peak_rss_mb(),
            "device": o.device,
            "threads": rayon::current_num_threads(),
            "views": views,
            "history": history,
            "traced_maps": o.traced_maps.as_ref().map(traced_maps),
            "left_out": o.left_out,
            "not_fitted": o.not_fitted,
            "judged": match o.judged {
                Judged::Rasterized => "rasterized".to_owned(),
                Judged::RasterizedAgainst(reference) => format!("reference {}", reference.name),
                Judged::PathTraced => "path traced".to_owned(),
            },
            "judge_spp": (o.judged != Judged::Rasterized).then_some(o.judge_spp),
        });
        for s in &o.stages {
            let mut quality = output::quality(&s.quality);
            quality["triangles"] = json!(s.triangles);
            out[key(s.name)] = quality;
        }
        if let Some(last) = o.stages.last() {
            out["file"] = out[key(last.name)].clone();
        }
        out
    }
}

/// The key of a stage in JSON.
fn key(stage: &str) -> String {
    stage.replace('-', "_")
}

/// Bytes of the written file.
fn bytes_of(o: &Outcome) -> Option<u64> {
    std::fs::metadata(&o.file).ok().map(|m| m.len())
}

/// What may make a written file lighter, of what it holds.
fn lighter_by(o: &Outcome) -> Vec<&'static str> {
    let textured = o.textures != "none";
    let ways = [
        ("--max-bytes", textured && o.max_bytes.is_none()),
        ("a smaller --texture-size", textured && o.written != Written::Kept),
        ("--jpeg", o.textures.contains("PNG") && o.max_bytes.is_none()),
        ("fewer triangles", true),
        ("--compress meshopt", !textured),
    ];
    ways.into_iter().filter(|(_, helps)| *helps).map(|(way, _)| way).collect()
}

/// How the program ends after work that was stopped early, or not.
pub(crate) fn ending(stopped: bool) -> Ending {
    if stopped && interrupt::is_stopping() { Ending::Stopped } else { Ending::Done }
}

pub(crate) fn name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned())
}

fn texture_encoding(a: &Simplify) -> TextureEncoding {
    let quality = a.jpeg.or(a.texture_quality).unwrap_or(TEXTURE_QUALITY);
    match (a.textures, a.jpeg) {
        (Some(TextureFormat::Webp), _) => TextureEncoding::WebP,
        (Some(TextureFormat::WebpLossy), _) => TextureEncoding::LossyWebP { quality },
        (Some(TextureFormat::Ktx2), _) => TextureEncoding::Ktx2 { quality },
        (Some(TextureFormat::Jpeg), _) | (None, Some(_)) => TextureEncoding::Jpeg { quality },
        (Some(TextureFormat::Png | TextureFormat::None) | None, _) => TextureEncoding::Png,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_goes_before_files_that_are_too_large() {
        let large = || vec![anyhow!("a: is not written"), anyhow!("b: is not written")];
        assert_eq!(end(Ending::Stopped, large()).unwrap(), Ending::Stopped);
        assert_eq!(end(Ending::Done, large()).unwrap_err().to_string(), "b: is not written");
        assert_eq!(end(Ending::Done, Vec::new()).unwrap(), Ending::Done);
    }
}

//! The command line.

mod denoise;
mod gradient;
mod recover;
mod render;
mod retexture;
mod simplify;
mod stored;
mod surface;
mod values;

pub(crate) use denoise::Denoise;
pub(crate) use gradient::{Gradient, ParameterScene};
pub(crate) use recover::{
    Recover, RecoverMaterial, RecoverMesh, RecoverScene, RecoverTexture, RecoverVolume,
};
pub(crate) use render::{Render, RenderGuiding, RenderIntegrator, RenderLight};
pub(crate) use retexture::Retexture;
pub(crate) use simplify::Simplify;
pub(crate) use stored::{GeometryFormat, MipLevels, TextureFormat};
pub(crate) use surface::{Surface, SurfaceMethod, UpAxis};

use clap::error::ErrorKind;
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use photofit_fit::engine::judge::JudgeRenderer;
use photofit_fit::engine::trainer::Checkpointing;
use std::path::PathBuf;
use std::time::Duration;
pub(crate) use values::Device;
use values::{device, ending, seconds, whole, with_negative_numbers};

/// What the help says about the end of the program.
const STATUSES: &str = "\
Exit status:
    0  done; also when --time-limit ended it
    1  an input cannot be used, or the work failed
    2  the command line is wrong
    3  Ctrl-C or SIGTERM ended it early; what was reached is written
  130  Ctrl-C or SIGTERM ended it before there was anything to write, or a second one ended it at once";

/// Fits 3D assets to images: a heavy asset in, a light one that looks the same out.
#[derive(Debug, Parser)]
#[command(name = "photofit", version, arg_required_else_help = true, after_help = STATUSES)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

impl Cli {
    /// The command line of the process; what is wrong with it ends the process with status 2.
    pub(crate) fn checked() -> Self {
        let command = with_negative_numbers(Self::command());
        let cli = Self::from_arg_matches(&command.get_matches()).unwrap_or_else(|e| e.exit());
        let (name, checked) = match &cli.command {
            Command::Render(render) => ("render", render.check()),
            Command::Simplify(simplify) => ("simplify", simplify.check()),
            Command::Retexture(retexture) => ("retexture", retexture.check()),
            Command::Compare(compare) => ("compare", compare.check()),
            Command::Denoise(denoise) => ("denoise", denoise.check()),
            _ => return cli,
        };
        if let Err(rule) = checked {
            let mut all = Self::command();
            // Names the program in the usage of its commands.
            all.build();
            let command = all.find_subcommand_mut(name).expect("a command of the program");
            command.error(ErrorKind::ArgumentConflict, rule).exit();
        }
        cli
    }
}

/// Whether a command, named by its words, has an option of this long name.
pub(crate) fn has_option(command: &[&str], name: &str) -> bool {
    let mut cli = Cli::command();
    // What a command shares with others is a part of it only then.
    cli.build();
    let within = command.iter().try_fold(&cli, |c, word| c.find_subcommand(word));
    within.is_some_and(|c| c.get_arguments().any(|a| a.get_long() == Some(name)))
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Make a light asset that looks like a heavy one.
    #[command(after_help = STATUSES)]
    Simplify(Simplify),
    /// Paint a light asset so that it looks like a heavy one, at rest and in motion.
    #[command(after_help = STATUSES)]
    Retexture(Retexture),
    /// Render a picture of an asset.
    #[command(after_help = STATUSES)]
    Render(Render),
    /// Compare two images, or two assets from shared views: PSNR, SSIM, FLIP, RMSE.
    #[command(after_help = STATUSES)]
    Compare(Compare),
    /// Show what an asset holds, what memory it takes, and what a fit of it would run and skip.
    #[command(after_help = STATUSES)]
    Inspect(Inspect),
    /// Make depth, normals and colours from a point cloud; small gaps between points are closed, larger ones by --fill.
    #[command(after_help = STATUSES)]
    Surface(Surface),
    /// Clean a noisy rendering; layers such as albedo and normal beside the colour are found and used.
    #[command(after_help = STATUSES)]
    Denoise(Denoise),
    /// Recover parameters of an asset from pictures of it.
    #[command(subcommand, after_help = STATUSES)]
    Recover(Recover),
    /// Differentiate a path-traced picture with respect to a parameter of its scene.
    #[command(after_help = STATUSES)]
    Gradient(Gradient),
    /// Run the main job on a generated asset and write pictures and a report.
    #[command(after_help = STATUSES)]
    Demo(Demo),
}

/// Where the light comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum FitLight {
    /// Every other view under a point light, the others in a studio: what holds up in most renderers.
    Mixed,
    /// A point light around the camera and a weak constant environment.
    Point,
    /// The environment map of --env, turned at random.
    Env,
}

// The light of a fit; a doc comment would become that of the command.
#[derive(Args, Debug)]
pub(crate) struct FitLighting {
    /// Light while fitting and judging.
    #[arg(
        long,
        value_enum,
        default_value = "mixed",
        default_value_if("env", clap::builder::ArgPredicate::IsPresent, "env")
    )]
    pub(crate) light: FitLight,
    /// Equirectangular environment (.hdr, .exr, .png, .jpg); implies --light env.
    #[arg(long, value_name = "FILE", required_if_eq("light", "env"))]
    pub(crate) env: Option<PathBuf>,
}

impl FitLighting {
    /// An environment that no view is lit by is a mistake.
    fn check(&self) -> Result<(), String> {
        match (self.light, &self.env) {
            (FitLight::Env, _) | (_, None) => Ok(()),
            (FitLight::Mixed, _) => Err("--env needs --light env; --light mixed lights by no map".into()),
            (FitLight::Point, _) => Err("--env needs --light env; --light point lights by no map".into()),
        }
    }
}

/// How pictures of the asset are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum FitReference {
    /// Rasterized: direct light without shadows, as the light asset is drawn.
    Raster,
    /// Path traced: with shadows and light between surfaces, which go into the maps of the light asset.
    Path,
}

/// What draws the light asset while its maps are fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum FitWith {
    /// The rasterizer: with --reference path, all shadows of the asset go into the maps.
    Raster,
    /// First the rasterizer, for shape and maps, then the path tracer, for the maps: shadows that the light shape casts itself
    /// stay out of them, those of lost crevices go in. Needs --reference path.
    Path,
}

/// Where the occlusion map of the light asset comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum OcclusionMaps {
    /// The asset's own maps, where it has any.
    Keep,
    /// Rays from the asset's surface: what stops them darkens the less, the farther it is, up to half of the diagonal of
    /// the asset's box. New maps are written then, as with --new-maps.
    Bake,
    /// There is none.
    None,
}

/// Who draws the pictures of the judgement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum FitJudge {
    /// The path tracer where materials need it (coats, sheen, glass and so on), else the rasterizer.
    Auto,
    /// The rasterizer, in no time; what it does not draw is not judged.
    Raster,
    /// The path tracer.
    Path,
}

impl From<FitJudge> for JudgeRenderer {
    fn from(judge: FitJudge) -> Self {
        match judge {
            FitJudge::Auto => Self::Auto,
            FitJudge::Raster => Self::Raster,
            FitJudge::Path => Self::Path,
        }
    }
}

/// How much work a fit does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum FitEffort {
    /// 250 steps from one start, pictures of the asset with a quarter of the samples, four views of the report.
    Fast,
    /// At most 1000 steps from the better of two starts, eight views of the report.
    Normal,
    /// At most 4000 steps, else as normal.
    Best,
}

/// What a fit starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Start {
    /// The decimated asset.
    Decimate,
    /// A sphere around it.
    Sphere,
}

// How a fit runs and goes on; a doc comment would become that of the command.
#[derive(Args, Debug)]
pub(crate) struct Running {
    /// Seed of all random choices [range: at least 0].
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = whole::<u64>(0..))]
    pub(crate) seed: u64,
    /// Threads; the result is the same for any number [range: 1 to 1024] [default: all cores].
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Folder in which the state of the fit is kept, for --resume.
    #[arg(long, value_name = "DIR")]
    pub(crate) checkpoint: Option<PathBuf>,
    /// Go on from the checkpoint, if there is one, to the same result as an uninterrupted run.
    #[arg(long, requires = "checkpoint")]
    pub(crate) resume: bool,
}

// How maps are fitted to pictures, and what is told of it; a doc comment would become that of the command.
#[derive(Args, Debug)]
pub(crate) struct Course {
    /// Where the fit runs: cpu, gpu (hardware), gpu:NAME (the first adapter whose name or driver holds NAME, also one in
    /// software), or auto: a GPU in hardware if there is one, else the CPU.
    #[arg(long, value_name = "DEVICE", default_value = "cpu", value_parser = device)]
    pub(crate) device: Device,
    /// Pictures per step [range: 1 to 64].
    #[arg(long, value_name = "B", default_value_t = 2, value_parser = whole::<usize>(1..=64))]
    pub(crate) batch: usize,
    /// End the fit after this many seconds and keep what was reached; reading, writing and judging take their time on top [range: more than 0,
    /// at most 1000000000] [default: no limit].
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) time_limit: Option<Duration>,
    #[command(flatten)]
    pub(crate) running: Running,
    /// Print what ran, what was skipped, and why.
    #[arg(long)]
    pub(crate) explain: bool,
    /// Folder for a report with pictures: index.html.
    #[arg(long, value_name = "DIR")]
    pub(crate) report: Option<PathBuf>,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

impl Course {
    pub(crate) fn checkpointing(&self) -> Checkpointing {
        let Running { checkpoint, resume, .. } = &self.running;
        Checkpointing { checkpoint: checkpoint.clone(), resume: *resume, time_limit: self.time_limit }
    }
}

#[derive(Args, Debug)]
pub(crate) struct Compare {
    /// The reference: an image (.png, .jpg, .exr, .hdr) or an asset (.glb, .gltf, .obj, .ply).
    #[arg(value_name = "A")]
    pub(crate) reference: PathBuf,
    /// What is compared with it: a file of the same kind.
    #[arg(value_name = "B")]
    pub(crate) candidate: PathBuf,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    /// Write the FLIP error as a picture (.png): black is no error, pale yellow is 1.
    #[arg(long, value_name = "FILE.png", value_parser = ending(&["png"]))]
    pub(crate) heatmap: Option<PathBuf>,
    /// Views of two assets [range: 1 to 256] [default: 8].
    #[arg(long, value_name = "N", value_parser = whole::<u64>(1..=256))]
    pub(crate) views: Option<u64>,
    /// Width and height of the views of two assets, pixels [range: 16 to 4096] [default: 512].
    #[arg(long, value_name = "PX", value_parser = whole::<u32>(16..=4096))]
    pub(crate) resolution: Option<u32>,
    /// Who draws two assets [default: auto].
    #[arg(long, value_enum, value_name = "RENDERER")]
    pub(crate) judge: Option<FitJudge>,
    /// Threads; the figures are the same for any number [range: 1 to 1024] [default: all cores].
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=1024))]
    pub(crate) threads: Option<u16>,
}

impl Compare {
    /// Whether the options belong to what is compared.
    fn check(&self) -> Result<(), String> {
        let given = [
            ("--views", self.views.is_some()),
            ("--resolution", self.resolution.is_some()),
            ("--judge", self.judge.is_some()),
        ];
        match given.into_iter().find(|g| g.1) {
            Some((name, _)) if !crate::compare::is_asset(&self.reference) => {
                Err(format!("{name} belongs to two assets; an image is compared as it is"))
            }
            _ => Ok(()),
        }
    }
}

#[derive(Args, Debug)]
pub(crate) struct Inspect {
    /// The asset: .glb, .gltf, .obj or .ply; or a Mitsuba 3 scene: .xml.
    #[arg(value_name = "IN", required_unless_present = "devices")]
    pub(crate) input: Option<PathBuf>,
    /// List the GPU adapters of this machine instead: what they are, and what they lack.
    #[arg(long, conflicts_with_all = ["input", "allow_parent_paths"])]
    pub(crate) devices: bool,
    /// Let an .xml scene name files above its folder, by `..` or in the folder right above it: only for scenes that you
    /// trust.
    #[arg(long)]
    pub(crate) allow_parent_paths: bool,
    /// Write what is shown as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

#[derive(Args, Debug)]
pub(crate) struct Demo {
    /// Folder for the assets, the pictures and the report.
    #[arg(long, value_name = "DIR", default_value = "photofit-demo")]
    pub(crate) out: PathBuf,
    /// Where the fit runs: cpu, gpu (hardware), gpu:NAME (the first adapter whose name or driver holds NAME, also one in
    /// software), or auto: a GPU in hardware if there is one, else the CPU.
    #[arg(long, value_name = "DEVICE", default_value = "cpu", value_parser = device)]
    pub(crate) device: Device,
    /// End the fit after this many seconds; making the asset, preparation and judging take their time on top [range: more
    /// than 0, at most 1000000000].
    #[arg(long, value_name = "S", default_value = "60", value_parser = seconds)]
    pub(crate) time_limit: Duration,
    /// Threads [range: 1 to 1024] [default: all cores].
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=1024))]
    pub(crate) threads: Option<u16>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Arg;
    use std::any::TypeId;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    /// The options of a command and of those below it that its row of the README leaves out.
    fn missing(readme: &str, path: &str, command: &clap::Command) -> Vec<String> {
        let subcommands: Vec<_> = command.get_subcommands().filter(|c| c.get_name() != "help").collect();
        if !subcommands.is_empty() {
            let below = |c: &&clap::Command| missing(readme, &format!("{path} {}", c.get_name()), c);
            return subcommands.iter().flat_map(below).collect();
        }
        let of = |path: &str| readme.lines().find(|l| l.starts_with(&format!("| `{path}")));
        let Some(row) = of(path) else { return vec![path.to_owned()] };
        // A row may name another one.
        let gradient = of("photofit gradient").filter(|_| row.contains("those of `gradient`"));
        let row = [row, gradient.unwrap_or_default()].concat();
        let options = command.get_arguments().filter(|a| !a.is_hide_set()).filter_map(Arg::get_long);
        let stands = |option: &str| {
            let option = format!("--{option}");
            row.split(&option)
                .skip(1)
                .any(|rest| !rest.starts_with(|c: char| c == '-' || c.is_ascii_lowercase()))
        };
        let unnamed = options.filter(|o| !["output", "help", "version"].contains(o) && !stands(o));
        unnamed.map(|o| format!("{path} --{o}")).collect()
    }

    #[test]
    fn the_readme_has_every_option() {
        let readme = include_str!("../../../README.md");
        let mut command = Cli::command();
        command.build();
        assert_eq!(missing(readme, "photofit", &command), Vec::<String>::new());
    }

    /// The options of all commands that take a value which is no path, with what the command needs to be parsed.
    fn valued() -> Vec<(Vec<&'static str>, Arg)> {
        let needed: [&[&str]; 14] = [
            &["simplify", "a.glb", "-o", "b.glb"],
            &["render", "a.glb", "-o", "b.png"],
            &["compare", "a.png", "b.png"],
            &["inspect", "a.glb"],
            &["surface", "a.ply", "-o", "b"],
            &["denoise", "a.exr", "-o", "b.exr"],
            &["recover", "texture", "pictures", "--mesh", "a.glb", "-o", "b.glb"],
            &["recover", "mesh", "--self-test", "a.glb", "-o", "b.glb"],
            &["recover", "scene", "a.xml", "--self-test", "--parameter", "k", "-o", "b"],
            &["recover", "volume", "--self-test", "a.vol", "-o", "b"],
            &["recover", "material", "--self-test", "a.glb", "-o", "b"],
            &["retexture", "a.glb", "b.glb", "-o", "c.glb"],
            &["gradient", "a.xml", "--parameter", "k"],
            &["demo"],
        ];
        let is_path = |a: &Arg| a.get_value_parser().type_id() == TypeId::of::<PathBuf>();
        let mut out = Vec::new();
        for needed in needed {
            let mut cli = Cli::command();
            cli.build();
            let mut command = cli.find_subcommand(needed[0]).expect("a command");
            if let Some(inner) = needed.get(1).and_then(|name| command.find_subcommand(name)) {
                command = inner;
            }
            let options = command.get_opts().filter(|a| !is_path(a)).cloned();
            out.extend(options.map(|a| (needed.to_vec(), a)));
        }
        assert!(out.len() > 80, "{} options", out.len());
        out
    }

    fn help(arg: &Arg) -> String {
        arg.get_help().map(ToString::to_string).unwrap_or_default()
    }

    #[test]
    fn help_shows_every_default() {
        for (needed, arg) in valued() {
            // What must be given has none.
            let shown = !arg.get_default_values().is_empty()
                || help(&arg).contains("[default: ")
                || needed.contains(&format!("--{}", arg.get_id()).as_str());
            assert!(shown, "{} --{}", needed[0], arg.get_id());
        }
    }

    #[test]
    fn help_shows_the_ranges_that_are_kept() {
        let mut ranges = 0;
        for (mut line, arg) in valued() {
            let option = format!("--{}=!", arg.get_long().expect("a long name"));
            line.insert(0, "photofit");
            line.push(&option);
            let Err(error) = Cli::try_parse_from(&line) else { continue };
            let text = error.to_string();
            let rule = text.lines().find_map(|l| l.split_once("number, "));
            let range =
                help(&arg).split_once("[range: ").and_then(|(_, r)| Some(r.split_once(']')?.0.to_owned()));
            assert_eq!(range.as_deref(), rule.map(|r| r.1), "{line:?}: {text}");
            ranges += usize::from(range.is_some());
        }
        assert!(ranges > 60, "{ranges} ranges");
    }
}

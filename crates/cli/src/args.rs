//! The command line.

mod denoise;
mod gradient;
mod recover;
mod render;
mod retexture;
mod stored;
mod surface;
mod values;

pub(crate) use denoise::Denoise;
pub(crate) use gradient::{Gradient, ParameterScene};
pub(crate) use recover::{
    Recover, RecoverMaterial, RecoverMesh, RecoverScene, RecoverTexture, RecoverVolume, TextureSmoothing,
};
pub(crate) use render::{Render, RenderGuiding, RenderIntegrator, RenderLight};
pub(crate) use retexture::Retexture;
pub(crate) use stored::{GeometryFormat, MipLevels, TextureFormat};
pub(crate) use surface::{Surface, SurfaceMethod, UpAxis};

use clap::error::ErrorKind;
use clap::{ArgGroup, Args, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use photofit_fit::engine::trainer::Keeping;
use photofit_fit::simplify::SimplifyOptions;
use std::path::PathBuf;
use std::time::Duration;
pub(crate) use values::Device;
use values::{above_to, between, device, ending, number, seconds, whole, with_negative_numbers};

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
    /// Make depth, normals and colours without holes from a point cloud.
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

/// How much work a fit does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum FitEffort {
    /// 250 steps from one start, pictures of the asset with a quarter of the samples, two views of the report.
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
    pub(crate) fn keeping(&self) -> Keeping {
        let Running { checkpoint, resume, .. } = &self.running;
        Keeping { checkpoint: checkpoint.clone(), resume: *resume, time_limit: self.time_limit }
    }
}

#[derive(Args, Debug)]
#[command(group = ArgGroup::new("budget").args(["triangles", "ratio", "error", "screen_size", "lod"]))]
pub(crate) struct Simplify {
    /// The asset: .glb, .gltf, .obj or .ply.
    #[arg(value_name = "IN")]
    pub(crate) input: PathBuf,
    /// The file to write.
    #[arg(short, long, value_name = "OUT.glb", value_parser = ending(&["glb"]))]
    pub(crate) output: PathBuf,
    /// Budget: at most N triangles, no more than the asset has [range: at least 1] [default: --ratio].
    #[arg(long, value_name = "N", value_parser = whole::<usize>(1..))]
    pub(crate) triangles: Option<usize>,
    /// Budget: at most this share of the asset's triangles, but no fewer than 64 of them [range: more than 0, at most 1]
    /// [default: 0.03 when no budget is given, nor --max-bytes].
    #[arg(long, value_name = "R", value_parser = number(above_to(0.0, 1.0)))]
    pub(crate) ratio: Option<f64>,
    /// Budget: as few triangles as keep the geometric error below this share of the bounding diagonal [range: more than
    /// 0, less than 1] [default: --ratio].
    #[arg(long, value_name = "E", value_parser = number(between(0.0, 1.0)))]
    pub(crate) error: Option<f64>,
    /// Budget: as few triangles as look right on a screen where the asset is this large, pixels. Cameras, pictures, textures
    /// and the judgement follow that size, from 16 to 1024 pixels: the light asset is fitted and judged as an engine shows
    /// it there, with one sample a pixel and mipmaps [range: 1 to 65536] [default: --ratio].
    #[arg(long, value_name = "PX", value_parser = number(1.0..=65536.0))]
    pub(crate) screen_size: Option<f64>,
    /// Write a chain of levels of detail for these sizes on screen, falling, each as --screen-size says: OUT.glb,
    /// OUT.lod1.glb, OUT.lod2.glb and so on, and OUT.lods.json with their figures. Each starts from the one before; --steps
    /// are those of the first, the others make half as many; --time-limit is for all fits together [range: 16 to 1024]
    /// [default: one asset].
    #[arg(long, value_name = "PX,PX", value_delimiter = ',', conflicts_with = "resolution", value_parser = number(16.0..=1024.0))]
    pub(crate) lod: Vec<f64>,
    /// Budgets of the levels of --lod, falling, one for each [range: at least 1] [default: as few as look right at the
    /// sizes].
    #[arg(long, value_name = "N,N", value_delimiter = ',', requires = "lod", value_parser = whole::<usize>(1..))]
    pub(crate) lod_triangles: Vec<usize>,
    /// Also write all levels of --lod as one file with `MSFT_lod` and `MSFT_screencoverage`: OUT.lods.glb.
    #[arg(long, requires = "lod")]
    pub(crate) msft_lod: bool,
    /// Give each level of --lod but the last a morph target that turns its shape into that of the next level: a viewer that raises
    /// the weight from 0 at the size of the level to 1 at the size of the switch (OUT.lods.json has both) sees no jump of the shape there.
    /// Needs two levels or more; does not go with --max-bytes.
    #[arg(long, requires = "lod")]
    pub(crate) continuous: bool,
    /// What the fit starts from.
    #[arg(long, value_enum, default_value = "decimate")]
    pub(crate) init: Start,
    /// Always write new maps, one set and one material for all. Else the asset's own textures and materials on fewer
    /// triangles are written where they look better than what was fitted.
    #[arg(long)]
    pub(crate) new_maps: bool,
    /// Keep the asset's texture coordinates, materials and textures, tiling ones too, all as they are: triangles alone are fewer,
    /// in the way that looks best of several, and nothing is fitted. Textures are stored as they were read unless --textures or
    /// --jpeg says otherwise. An asset without texture coordinates is refused.
    #[arg(long, conflicts_with_all = ["new_maps", "steps", "batch", "texture_size", "fit_with"])]
    pub(crate) keep_uvs: bool,
    /// Leave vertices on open borders where they are, to the bit, in the decimation and in the fit: parts of a larger asset that
    /// are simplified apart meet without cracks. Where borders leave no room for the budget there are more triangles. The fit
    /// runs on the CPU then.
    #[arg(long)]
    pub(crate) lock_borders: bool,
    /// Leave vertices where they are, to the bit, at which the attribute `_NAME` of a glTF file is above one half. Blender writes such
    /// attributes, and turns vertex groups into them. As with --lock-borders, there may be more triangles, and the fit runs on the CPU
    /// [default: none].
    #[arg(long, value_name = "NAME")]
    pub(crate) lock: Option<String>,
    /// Occlusion map of the light asset, the red channel beside roughness and metalness: it darkens indirect light in engines;
    /// the pictures of the fit and of the report do not show it.
    #[arg(long, value_enum, default_value = "keep")]
    pub(crate) occlusion: OcclusionMaps,
    /// Width and height of the report's pictures, pixels. The fit compares pictures of half that size with four samples
    /// per pixel, and of a quarter at first. With --screen-size and --lod that size says it [range: 16 to 4096] [default:
    /// 512, or the size on screen].
    #[arg(long, value_name = "PX", conflicts_with = "screen_size", value_parser = whole::<usize>(16..=4096))]
    pub(crate) resolution: Option<usize>,
    /// How much work is done; what --steps and other options say counts before it. With --keep-uvs, where nothing is fitted, it says in
    /// how many views and samples the decimation and textures are chosen, and how many views the report has; best is as normal there.
    #[arg(long, value_enum, default_value = "normal")]
    pub(crate) effort: FitEffort,
    /// Pictures per step [range: 1 to 64].
    #[arg(long, value_name = "B", default_value_t = SimplifyOptions::default().batch, value_parser = whole::<usize>(1..=64))]
    pub(crate) batch: usize,
    /// Steps of the fit; fewer are made when held-out views stop improving: a phase ends once 150 steps brought nothing
    /// better [range: at least 0] [default: 1000, or what --effort says].
    #[arg(long, value_name = "N", value_parser = whole::<u64>(0..))]
    pub(crate) steps: Option<u64>,
    /// End the fit after this many seconds and keep what was reached. Preparation before the fit, and judging and writing
    /// after it, take their time on top [range: more than 0, at most 1000000000] [default: no limit].
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) time_limit: Option<Duration>,
    /// Where the fit runs: cpu, gpu (hardware), gpu:NAME (the first adapter whose name or driver holds NAME, also one in
    /// software), or auto: a GPU in hardware if there is one, else the CPU.
    #[arg(long, value_name = "DEVICE", default_value = "cpu", value_parser = device)]
    pub(crate) device: Device,
    /// Width and height of new textures, texels (with --textures none: of the maps that are fitted and then become colours of
    /// vertices), and longest side of the asset's own where those are written. Those have together
    /// no more texels than four new ones, but for budgets of a quarter of the triangles and more, where they stay whole unless
    /// this is given [range: 16 to 8192] [default: 1024, or what the size on screen needs].
    #[arg(long, value_name = "N", value_parser = whole::<usize>(16..=8192))]
    pub(crate) texture_size: Option<usize>,
    /// How textures are stored; both kinds of webp are for readers that know `EXT_texture_webp` (three.js, Babylon.js, Blender
    /// and others), ktx2 for those that know `KHR_texture_basisu` (three.js, Babylon.js, Godot and others) [default: png,
    /// jpeg with --jpeg; the asset's own textures, where they are written, as they were read].
    #[arg(long, value_enum)]
    pub(crate) textures: Option<TextureFormat>,
    /// Mip levels of new textures. Free ones are fitted to pictures of all sizes from --screen-size or --resolution down to 16
    /// pixels, those of a level of --lod down to where the next one replaces it, as an engine draws them with one sample a pixel;
    /// needs --textures ktx2, which alone holds levels. The fit runs on the CPU then.
    #[arg(long, value_enum, default_value = "classic")]
    pub(crate) mips: MipLevels,
    /// Compress geometry: meshopt is `EXT_meshopt_compression`, which three.js, Babylon.js, Godot and others read.
    #[arg(long, value_enum, default_value = "none")]
    pub(crate) compress: GeometryFormat,
    /// Store opaque textures as JPEG of quality Q, 90 without a number: a third of the bytes [range: 1 to 100] [default:
    /// exact PNG].
    #[arg(long, value_name = "Q", num_args = 0..=1, default_missing_value = "90", value_parser = whole::<u8>(1..=100))]
    pub(crate) jpeg: Option<u8>,
    /// Quality of lossy textures [range: 1 to 100] [default: 90].
    #[arg(long, value_name = "Q", conflicts_with = "jpeg", value_parser = whole::<u8>(1..=100))]
    pub(crate) texture_quality: Option<u8>,
    /// Most bytes of the file, of each level of --lod: textures are halved and stored with loss as far as is needed, in the way
    /// that looks best in held-out views; as JPEG, or also as WebP with --textures webp, or as KTX 2.0 with --textures ktx2. Unless
    /// --new-maps is given, the asset's own textures on fewer triangles are made to fit, too, and written where they look better. Without
    /// another budget the asset keeps as many triangles as fit into half of the bytes, and its own textures are also tried with those of a
    /// quarter and of three quarters. Where the lightest file is larger, it is written to OUT.too-large.glb and OUT.glb stays as it
    /// was: status 1 [range: at least 1] [default: no limit].
    #[arg(long, value_name = "N", conflicts_with_all = ["jpeg", "texture_quality"], value_parser = whole::<u64>(1..))]
    pub(crate) max_bytes: Option<u64>,
    #[command(flatten)]
    pub(crate) lighting: FitLighting,
    /// How pictures of the asset are made, for the fit and for the report.
    #[arg(long, value_enum, default_value = "raster")]
    pub(crate) reference: FitReference,
    /// What draws the light asset while its maps are fitted.
    #[arg(long, value_enum, default_value = "raster")]
    pub(crate) fit_with: FitWith,
    /// Who draws the pictures by which the result is judged. They are no part of the fit; the plan of --explain says what
    /// they cost.
    #[arg(long, value_enum, default_value = "auto")]
    pub(crate) judge: FitJudge,
    /// Samples per pixel where the result is judged by path tracing, in pictures of at most 256 x 256 pixels; fewer take less
    /// time, and their noise counts as error [range: 1 to 65536].
    #[arg(long, value_name = "N", default_value_t = SimplifyOptions::default().judge_spp, value_parser = whole::<u32>(1..=65536))]
    pub(crate) judge_spp: u32,
    #[command(flatten)]
    pub(crate) running: Running,
    /// Folder for a report with pictures: index.html.
    #[arg(long, value_name = "DIR")]
    pub(crate) report: Option<PathBuf>,
    /// Print what runs and what is skipped, and why.
    #[arg(long)]
    pub(crate) explain: bool,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

impl Simplify {
    /// Whether the options go together.
    fn check(&self) -> Result<(), String> {
        if self.fit_with == FitWith::Path && self.reference != FitReference::Path {
            return Err("--fit-with is path, but --reference is raster; it must be path, too".into());
        }
        if self.continuous && self.max_bytes.is_some() {
            return Err("--continuous adds morph targets to a level once the next one is there, and --max-bytes bounds the file before; leave one of them out".into());
        }
        self.lighting.check()?;
        match (self.textures, self.jpeg.or(self.texture_quality)) {
            (Some(TextureFormat::None), Some(_)) => {
                Err("--textures none has no quality; leave one of them out".into())
            }
            (Some(TextureFormat::None), _) if self.keep_uvs => {
                Err("--keep-uvs keeps textures and --textures none has none; leave one of them out".into())
            }
            (Some(TextureFormat::Png | TextureFormat::Webp), Some(_)) => {
                Err("png and webp are exact: a quality belongs to --textures jpeg, webp-lossy or ktx2; leave one of them out".into())
            }
            (Some(TextureFormat::WebpLossy | TextureFormat::Ktx2), _) if self.jpeg.is_some() => {
                Err("--jpeg is the quality of --textures jpeg; that of webp-lossy and ktx2 is --texture-quality".into())
            }
            (None, Some(_)) if self.jpeg.is_none() => {
                Err("--texture-quality is for lossy textures: add --textures jpeg, webp-lossy or ktx2".into())
            }
            _ => Ok(()),
        }
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
    /// Threads; the figures are the same for any number [range: 1 to 1024] [default: all cores].
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=1024))]
    pub(crate) threads: Option<u16>,
}

impl Compare {
    /// Whether the options belong to what is compared.
    fn check(&self) -> Result<(), String> {
        let given = [("--views", self.views.is_some()), ("--resolution", self.resolution.is_some())];
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

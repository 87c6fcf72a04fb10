//! The command line.

use crate::mitsuba;
use clap::error::ErrorKind;
use clap::{ArgGroup, Args, CommandFactory, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;
use std::time::Duration;

/// Fits 3D assets to images: a heavy asset in, a light one that looks the same out.
#[derive(Debug, Parser)]
#[command(name = "photofit", version, arg_required_else_help = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

impl Cli {
    /// The command line of the process; what is wrong with it ends the process with status 2.
    pub(crate) fn checked() -> Self {
        let cli = Self::parse();
        if let Command::Render(render) = &cli.command
            && let Err(rule) = render.check()
        {
            Self::command().error(ErrorKind::ArgumentConflict, rule).exit();
        }
        cli
    }
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Make a light asset that looks like a heavy one.
    Simplify(Simplify),
    /// Render a picture of an asset.
    Render(Render),
    /// Compare two images, or two assets from shared views: PSNR, SSIM, FLIP, RMSE.
    Compare(Compare),
    /// Show what an asset holds, what memory it takes, and what a fit of it would run and skip.
    Inspect(Inspect),
    /// Make depth, normals and colours without holes from a point cloud.
    Surface(Surface),
    /// Clean a noisy rendering; layers such as albedo and normal beside the colour are found and used.
    Denoise(Denoise),
    /// Recover parameters of an asset from pictures of it.
    #[command(subcommand)]
    Recover(Recover),
    /// Run the main job on a generated asset and write pictures and a report.
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

/// How pictures of the asset are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum FitReference {
    /// Rasterized: direct light without shadows, as the light asset is drawn.
    Raster,
    /// Path traced: with shadows and light between surfaces, which go into the maps of the light asset.
    Path,
}

/// What a fit starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Start {
    /// The decimated asset.
    Decimate,
    /// A sphere around it.
    Sphere,
}

#[derive(Args, Debug)]
#[command(group = ArgGroup::new("budget").args(["triangles", "ratio", "error", "screen_size"]))]
pub(crate) struct Simplify {
    /// The asset: .glb, .gltf, .obj or .ply.
    #[arg(value_name = "IN")]
    pub(crate) input: PathBuf,
    /// The file to write.
    #[arg(short, long, value_name = "OUT.glb")]
    pub(crate) output: PathBuf,
    /// Budget: at most N triangles.
    #[arg(long, value_name = "N")]
    pub(crate) triangles: Option<usize>,
    /// Budget: at most this share of the asset's triangles; 0.03 when no budget is given.
    #[arg(long, value_name = "R")]
    pub(crate) ratio: Option<f64>,
    /// Budget: as few triangles as keep the geometric error below this share of the bounding diagonal.
    #[arg(long, value_name = "E")]
    pub(crate) error: Option<f64>,
    /// Budget: as few triangles as look right on a screen where the asset is this large.
    #[arg(long, value_name = "PX")]
    pub(crate) screen_size: Option<f64>,
    /// What the fit starts from.
    #[arg(long, value_enum, default_value = "decimate")]
    pub(crate) init: Start,
    /// Width and height of the training pictures, pixels.
    #[arg(long, value_name = "PX", default_value_t = 512)]
    pub(crate) resolution: usize,
    /// Pictures per step.
    #[arg(long, value_name = "B")]
    pub(crate) batch: Option<usize>,
    /// Steps of the fit; fewer are made when held-out views stop improving.
    #[arg(long, value_name = "N")]
    pub(crate) steps: Option<u64>,
    /// End the fit after this many seconds and keep what was reached.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) time_limit: Option<Duration>,
    /// Width and height of the textures, texels.
    #[arg(long, value_name = "N")]
    pub(crate) texture_size: Option<usize>,
    /// Store opaque textures as JPEG of quality Q, 90 when not given, instead of exact PNG: a third of the bytes.
    #[arg(
        long,
        value_name = "Q",
        num_args = 0..=1,
        default_missing_value = "90",
        value_parser = clap::value_parser!(u8).range(1..=100)
    )]
    pub(crate) jpeg: Option<u8>,
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
    /// How pictures of the asset are made, for the fit and for the report.
    #[arg(long, value_enum, default_value = "raster")]
    pub(crate) reference: FitReference,
    /// Seed of all random choices.
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Threads; the result is the same for any number. All cores when not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Folder in which the state of the fit is kept, for --resume.
    #[arg(long, value_name = "DIR")]
    pub(crate) checkpoint: Option<PathBuf>,
    /// Go on from the checkpoint, if there is one, to the same result as an uninterrupted run.
    #[arg(long, requires = "checkpoint")]
    pub(crate) resume: bool,
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

/// The light of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum RenderLight {
    /// A point light above the camera's left shoulder and a weak constant environment.
    Point,
    /// The environment map of --env.
    Env,
    /// A light at the camera.
    Headlight,
    /// What the asset itself holds (path only).
    Asset,
}

#[derive(Args, Clone, Debug)]
pub(crate) struct Render {
    /// The asset: .glb, .gltf, .obj or .ply; or a Mitsuba 3 scene: .xml.
    #[arg(value_name = "IN")]
    pub(crate) input: PathBuf,
    /// The picture: .png (sRGB, straight alpha, transparent background) or .exr (linear, premultiplied RGBA).
    #[arg(short, long, value_name = "OUT.png|.exr")]
    pub(crate) output: PathBuf,
    /// Width, pixels [default: 512, or what the scene says].
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub(crate) width: Option<u32>,
    /// Height, pixels [default: 512, or what the scene says].
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub(crate) height: Option<u32>,
    /// Turn of the camera around +y, from +z towards +x, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 30.0, value_parser = finite, allow_negative_numbers = true)]
    pub(crate) azimuth: f32,
    /// Lift of the camera towards +y, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 20.0, value_parser = finite, allow_negative_numbers = true)]
    pub(crate) elevation: f32,
    /// Distance of the camera from the centre, in radii of the bounding sphere; fills the picture when not given.
    #[arg(long, value_name = "RADII", value_parser = distance)]
    pub(crate) distance: Option<f32>,
    /// The light.
    #[arg(
        long,
        value_enum,
        default_value = "point",
        default_value_if("env", clap::builder::ArgPredicate::IsPresent, "env")
    )]
    pub(crate) light: RenderLight,
    /// Equirectangular environment (.hdr, .exr, .png, .jpg); implies --light env.
    #[arg(long, value_name = "FILE", required_if_eq("light", "env"))]
    pub(crate) env: Option<PathBuf>,
    /// Samples per pixel: 1, 4, 16 or 64 for raster (16 when not given); at most this many for path (64).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub(crate) spp: Option<u32>,
    /// How the picture is made [default: raster; path for .xml].
    #[arg(long, value_enum)]
    pub(crate) integrator: Option<RenderIntegrator>,
    #[command(flatten, next_help_heading = "Path tracing")]
    pub(crate) path: PathArgs,
}

impl Render {
    /// Columns.
    pub(crate) fn width(&self) -> u32 {
        self.width.unwrap_or(512)
    }

    /// Rows.
    pub(crate) fn height(&self) -> u32 {
        self.height.unwrap_or(512)
    }

    /// Whether the input is a scene of Mitsuba.
    pub(crate) fn is_mitsuba(&self) -> bool {
        mitsuba::is_scene(&self.input)
    }

    /// Whether the options belong to the integrator.
    fn check(&self) -> Result<(), String> {
        let p = &self.path;
        if self.is_mitsuba() {
            let given = [
                ("--integrator raster", self.integrator == Some(RenderIntegrator::Raster)),
                ("--camera", p.camera.is_some()),
                ("--light", self.light != RenderLight::Point),
                ("--env", self.env.is_some()),
                ("--distance", self.distance.is_some()),
            ];
            return match given.into_iter().find(|g| g.1) {
                Some((name, _)) => Err(format!("{name} does not go with an .xml, which has its own")),
                None => Ok(()),
            };
        }
        if !p.define.is_empty() {
            return Err("--define needs an .xml scene".into());
        }
        if self.integrator == Some(RenderIntegrator::Path) {
            return Ok(());
        }
        let given = [
            ("--noise", p.noise.is_some()),
            ("--time-limit", p.time_limit.is_some()),
            ("--aov", !p.aov.is_empty()),
            ("--resume", p.resume),
            ("--exposure", p.exposure != 0.0),
            ("--tone-map", p.tone_map),
            ("--background", p.background),
            ("--camera", p.camera.is_some()),
            ("--explain", p.explain),
            ("--light asset", self.light == RenderLight::Asset),
        ];
        if let Some((name, _)) = given.into_iter().find(|g| g.1) {
            return Err(format!("{name} needs --integrator path"));
        }
        match self.spp {
            None | Some(1 | 4 | 16 | 64) => Ok(()),
            Some(n) => {
                Err(format!("--spp {n}: raster takes 1, 4, 16 or 64; --integrator path takes any number"))
            }
        }
    }
}

/// How a picture is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum RenderIntegrator {
    /// Rasterized: direct light without shadows, fast.
    Raster,
    /// Path traced: all light, with noise that falls with the samples.
    Path,
}

/// Options of `render --integrator path`.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct PathArgs {
    /// Stop where the relative noise is below E (0.02 is clean); --spp still bounds the samples (4096 then).
    #[arg(long, value_name = "E", value_parser = positive)]
    pub(crate) noise: Option<f32>,
    /// Stop after this many seconds of rendering.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) time_limit: Option<Duration>,
    /// Auxiliary images, as layers of an .exr: albedo, normal, `geometric_normal`, depth, position, instance, variance,
    /// direct, indirect, samples; or all.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub(crate) aov: Vec<String>,
    /// Go on from the state that an interrupted render left beside the output, to the same bits.
    #[arg(long)]
    pub(crate) resume: bool,
    /// Seconds between two saved states.
    #[arg(long, value_name = "S", value_parser = seconds, default_value = "20")]
    pub(crate) save_every: Option<Duration>,
    /// Most scattering events of a path: 0 shows what glows, 1 direct light.
    /// [default: 16, or what the scene says].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    pub(crate) max_depth: Option<u32>,
    /// Brightness in stops: +1 is twice as bright (.png).
    #[arg(long, value_name = "EV", default_value_t = 0.0, value_parser = finite, allow_negative_numbers = true)]
    pub(crate) exposure: f32,
    /// Compress bright colours into the range of a display (.png; Khronos PBR Neutral).
    #[arg(long)]
    pub(crate) tone_map: bool,
    /// Show the environment behind the asset.
    #[arg(long)]
    pub(crate) background: bool,
    /// Give the parameter NAME (`$NAME`) of an .xml scene a value; may be repeated.
    #[arg(long, value_name = "NAME=VALUE", value_parser = definition)]
    pub(crate) define: Vec<(String, String)>,
    /// Use camera N of the asset, from 0.
    #[arg(long, value_name = "N")]
    pub(crate) camera: Option<usize>,
    /// Seed of the random numbers.
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Threads; the picture is the same for any number. All cores when not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Print what the integrator runs and skips, and why.
    #[arg(long)]
    pub(crate) explain: bool,
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
    #[arg(long, value_name = "FILE.png")]
    pub(crate) heatmap: Option<PathBuf>,
    /// Views of two assets.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u64).range(1..=256))]
    pub(crate) views: u64,
    /// Width and height of the views of two assets, pixels.
    #[arg(long, value_name = "PX", default_value_t = 512, value_parser = clap::value_parser!(u32).range(16..=4096))]
    pub(crate) resolution: u32,
}

#[derive(Args, Debug)]
pub(crate) struct Inspect {
    /// The asset: .glb, .gltf, .obj or .ply.
    #[arg(value_name = "IN")]
    pub(crate) input: PathBuf,
    /// Write what is shown as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

/// How holes between points are filled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SurfaceMethod {
    /// Pull-push and 20 steps.
    Fast,
    /// Two full solutions, blended.
    Blend,
    /// One full solution with both data terms.
    Hybrid,
}

/// The axis of a cloud that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum UpAxis {
    /// As in glTF.
    Y,
    /// As in surveys.
    Z,
    /// As in the frames of cameras.
    #[value(name = "-y")]
    NegativeY,
}

#[derive(Args, Debug)]
pub(crate) struct Surface {
    /// The cloud: .ply or .pcd, with or without normals and colours.
    #[arg(value_name = "POINTS")]
    pub(crate) input: PathBuf,
    /// The folder to write: surface.exr (depth, normal, albedo), previews, a sheet of before and after, camera.json.
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// The camera as JSON, see the guide.
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["azimuth", "elevation", "distance", "fov", "up"])]
    pub(crate) camera: Option<PathBuf>,
    /// Width, pixels; 960 when not given.
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub(crate) width: Option<u32>,
    /// Height, pixels; 720 when not given.
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub(crate) height: Option<u32>,
    /// Turn of the camera around the up axis, degrees; 30 when not given.
    #[arg(long, value_name = "DEG", value_parser = finite, allow_negative_numbers = true)]
    pub(crate) azimuth: Option<f32>,
    /// Lift of the camera, degrees; 20 when not given.
    #[arg(long, value_name = "DEG", value_parser = finite, allow_negative_numbers = true)]
    pub(crate) elevation: Option<f32>,
    /// Distance of the camera from the centre, in radii of the cloud; such that it fills the picture when not given.
    #[arg(long, value_name = "RADII", value_parser = point_distance)]
    pub(crate) distance: Option<f32>,
    /// Vertical field of view, degrees; 40 when not given.
    #[arg(long, value_name = "DEG", value_parser = field_of_view)]
    pub(crate) fov: Option<f32>,
    /// The axis that points up; y when not given.
    #[arg(long, value_enum, allow_hyphen_values = true)]
    pub(crate) up: Option<UpAxis>,
    /// How holes are filled.
    #[arg(long, value_enum, default_value = "fast")]
    pub(crate) method: SurfaceMethod,
    /// Steps of the solver; 10 for each pass of the fast method, else 100.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=10000))]
    pub(crate) iterations: Option<u16>,
    /// Strength of the smoothing of colours; 0 is none.
    #[arg(long, value_name = "S", value_parser = strength)]
    pub(crate) texture: Option<f32>,
    /// Fill the whole picture, also where no point is near.
    #[arg(long)]
    pub(crate) fill: bool,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

/// What removes the noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum DenoiseModel {
    /// Regression on the features, its widths chosen by estimated error: best quality per second.
    Auto,
    /// Total variation, quadratic data term.
    Rof,
    /// Total variation, absolute data term.
    Tvl1,
    /// Total variation, both data terms.
    Hybrid,
    /// Second-order total generalised variation, slower.
    Tgv,
    /// Edge-stopping wavelets (SVGF), for comparison.
    Atrous,
}

#[derive(Args, Debug)]
pub(crate) struct Denoise {
    /// The noisy picture: .exr (with feature layers, if there are any), .hdr, .png or .jpg.
    #[arg(value_name = "COLOR")]
    pub(crate) input: PathBuf,
    /// The picture to write: .exr (linear) or .png (sRGB).
    #[arg(short, long, value_name = "OUT.exr|.png")]
    pub(crate) output: PathBuf,
    /// Diffuse reflectance, linear (.png: sRGB).
    #[arg(long, value_name = "FILE")]
    pub(crate) albedo: Option<PathBuf>,
    /// Normals, in any frame; values in 0..1 are taken as (n+1)/2.
    #[arg(long, value_name = "FILE")]
    pub(crate) normal: Option<PathBuf>,
    /// Distance from the camera, 0 where nothing is hit.
    #[arg(long, value_name = "FILE")]
    pub(crate) depth: Option<PathBuf>,
    /// World positions.
    #[arg(long, value_name = "FILE")]
    pub(crate) position: Option<PathBuf>,
    /// Variance of the colour (of the mean over the samples).
    #[arg(long, value_name = "FILE")]
    pub(crate) variance: Option<PathBuf>,
    /// A second picture with as many samples of its own: the noise is then known.
    #[arg(long, value_name = "FILE")]
    pub(crate) half: Option<PathBuf>,
    /// Cameras of a rendered sequence (JSON): frames before COLOR are reprojected. Their files are named alike but
    /// for the number.
    #[arg(long, value_name = "cameras.json")]
    pub(crate) sequence: Option<PathBuf>,
    /// The model.
    #[arg(long, value_enum, default_value = "auto")]
    pub(crate) model: DenoiseModel,
    /// Leave the result of a total variation model as dark as the mean of logarithms is, instead of scaling it to the
    /// local mean of the noisy picture.
    #[arg(long)]
    pub(crate) keep_darkening: bool,
    /// Do not clamp rare huge samples.
    #[arg(long)]
    pub(crate) keep_fireflies: bool,
    /// A clean picture to compare with: PSNR, SSIM, FLIP, RMSE.
    #[arg(long, value_name = "REF")]
    pub(crate) compare: Option<PathBuf>,
    /// Print what runs and what is skipped, and why.
    #[arg(long)]
    pub(crate) explain: bool,
    /// Write figures, times and the plan as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Recover {
    /// Paint an asset's shape so that it looks like pictures with known cameras.
    Texture(RecoverTexture),
}

#[derive(Args, Debug)]
pub(crate) struct RecoverTexture {
    /// The pictures: a folder with transforms.json, or such a file.
    #[arg(value_name = "PICTURES")]
    pub(crate) pictures: PathBuf,
    /// The asset whose shape is painted: .glb, .gltf, .obj or .ply, in the world of the cameras.
    #[arg(long, value_name = "ASSET")]
    pub(crate) mesh: PathBuf,
    /// The file to write.
    #[arg(short, long, value_name = "OUT.glb")]
    pub(crate) output: PathBuf,
    /// Width and height of the textures, texels.
    #[arg(long, value_name = "N", default_value_t = 1024)]
    pub(crate) texture_size: usize,
    /// Steps of the fit; fewer are made when held-out pictures stop improving.
    #[arg(long, value_name = "N", default_value_t = 400)]
    pub(crate) steps: u64,
    /// Pictures per step.
    #[arg(long, value_name = "B", default_value_t = 2)]
    pub(crate) batch: usize,
    /// End the fit after this many seconds and keep what was reached.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) time_limit: Option<Duration>,
    /// Seed of all random choices.
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Threads; the result is the same for any number. All cores when not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Folder in which the state of the fit is kept, for --resume.
    #[arg(long, value_name = "DIR")]
    pub(crate) checkpoint: Option<PathBuf>,
    /// Go on from the checkpoint, if there is one, to the same result as an uninterrupted run.
    #[arg(long, requires = "checkpoint")]
    pub(crate) resume: bool,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

#[derive(Args, Debug)]
pub(crate) struct Demo {
    /// Folder for the assets, the pictures and the report.
    #[arg(long, value_name = "DIR", default_value = "photofit-demo")]
    pub(crate) out: PathBuf,
}

fn seconds(text: &str) -> Result<Duration, String> {
    let s: f64 = text.parse().map_err(|e| format!("a number of seconds: {e}"))?;
    if s > 0.0 {
        Duration::try_from_secs_f64(s).map_err(|e| e.to_string())
    } else {
        Err("more than 0 seconds".into())
    }
}

fn positive(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("a positive number".into()),
    }
}

fn finite(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err("a finite number".into()),
    }
}

fn distance(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if (1.0..=1000.0).contains(&x) => Ok(x),
        _ => Err("a number in 1..1000".into()),
    }
}

fn number_in(text: &str, range: std::ops::RangeInclusive<f32>) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if range.contains(&x) => Ok(x),
        _ => Err(format!("a number in {}..{}", range.start(), range.end())),
    }
}

fn point_distance(text: &str) -> Result<f32, String> {
    number_in(text, 0.01..=1000.0)
}

fn field_of_view(text: &str) -> Result<f32, String> {
    number_in(text, 0.1..=170.0)
}

fn strength(text: &str) -> Result<f32, String> {
    number_in(text, 0.0..=10.0)
}

/// A name and a value around the first `=`.
fn definition(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.is_empty() => Ok((name.to_owned(), value.to_owned())),
        _ => Err("has the form NAME=VALUE".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}

//! The options of `photofit render`.

use super::values::{above, definition, degrees, ending, number, seconds, single, whole};
use crate::mitsuba;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use std::time::Duration;

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
    #[arg(short, long, value_name = "OUT.png|.exr", value_parser = ending(&["png", "exr"]))]
    pub(crate) output: PathBuf,
    /// Width, pixels [range: 1 to 16384] [default: 512, or what the scene says].
    #[arg(long, value_name = "PX", value_parser = whole::<u32>(1..=16384))]
    pub(crate) width: Option<u32>,
    /// Height, pixels [range: 1 to 16384] [default: 512, or what the scene says].
    #[arg(long, value_name = "PX", value_parser = whole::<u32>(1..=16384))]
    pub(crate) height: Option<u32>,
    /// Turn of the camera around +y, from +z towards +x, degrees [range: -36000 to 36000] [default: 30].
    #[arg(long, value_name = "DEG", value_parser = degrees, allow_negative_numbers = true)]
    pub(crate) azimuth: Option<f32>,
    /// Lift of the camera towards +y, degrees [range: -36000 to 36000] [default: 20].
    #[arg(long, value_name = "DEG", value_parser = degrees, allow_negative_numbers = true)]
    pub(crate) elevation: Option<f32>,
    /// Distance of the camera from the centre, in radii of the bounding sphere [range: 1 to 1000] [default: the asset fills
    /// the picture].
    #[arg(long, value_name = "RADII", value_parser = single(1.0..=1000.0))]
    pub(crate) distance: Option<f32>,
    /// Use camera N of the asset, or sensor N of an .xml scene; the first is 0 [range: at least 0] [default: --azimuth,
    /// --elevation and --distance; the first sensor].
    #[arg(long, value_name = "N", value_parser = whole::<usize>(0..))]
    pub(crate) camera: Option<usize>,
    /// Show the asset as it is in this animation: its name, or its number, the first is 0 [default: as it stands].
    #[arg(long, value_name = "NAME|N")]
    pub(crate) animation: Option<String>,
    /// The time in the animation, seconds; before its first key and after its last these count [range: 0 to 1000000]
    /// [default: 0].
    #[arg(long, value_name = "S", requires = "animation", value_parser = single(0.0..=1e6))]
    pub(crate) time: Option<f32>,
    /// The light.
    #[arg(
        long,
        value_enum,
        default_value = "point",
        default_value_if("env", clap::builder::ArgPredicate::IsPresent, "env")
    )]
    pub(crate) light: RenderLight,
    /// Equirectangular environment (.hdr, .exr, .png, .jpg), scaled to a mean radiance of 0.7; implies --light env.
    #[arg(long, value_name = "FILE", required_if_eq("light", "env"))]
    pub(crate) env: Option<PathBuf>,
    /// Samples per pixel: 1, 4, 16 or 64 for raster, at most this many for path [range: 1 to 16777216] [default: 16 for
    /// raster, 64 for path, or what the scene says].
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=1 << 24))]
    pub(crate) spp: Option<u32>,
    /// How the picture is made [default: raster, path for .xml].
    #[arg(long, value_enum)]
    pub(crate) integrator: Option<RenderIntegrator>,
    /// Threads; the picture is the same for any number [range: 1 to 1024] [default: all cores].
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Write size, samples, times, the camera (with the keys of a frame of transforms.json), point lights and, path traced,
    /// noise as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    #[command(flatten, next_help_heading = "Path tracing")]
    pub(crate) path: PathArgs,
}

impl PathArgs {
    /// Whether noise or time, not a number of samples, ends the render.
    pub(crate) fn is_open(&self) -> bool {
        self.noise.is_some() || self.time_limit.is_some()
    }
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
    pub(super) fn check(&self) -> Result<(), String> {
        let p = &self.path;
        let placed = [
            ("--azimuth", self.azimuth.is_some()),
            ("--elevation", self.elevation.is_some()),
            ("--distance", self.distance.is_some()),
        ];
        let linear = self.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
        let shown = [("--exposure", p.exposure != 0.0), ("--tone-map", p.tone_map)];
        if let Some((name, _)) = shown.into_iter().find(|g| linear && g.1) {
            return Err(format!("{name} is for a display; it needs a .png, an .exr holds light as it is"));
        }
        if let Some((name, _)) = placed.into_iter().find(|g| self.camera.is_some() && g.1) {
            return Err(format!("{name} does not go with --camera, which stands where the asset says"));
        }
        if self.is_mitsuba() {
            let given = [
                ("--integrator raster", self.integrator == Some(RenderIntegrator::Raster)),
                ("--animation", self.animation.is_some()),
                ("--env", self.env.is_some()),
                ("--light", self.light != RenderLight::Point),
            ];
            return match given.into_iter().chain(placed).find(|g| g.1) {
                Some((name, _)) => Err(format!("{name} does not go with an .xml, which has its own")),
                None => Ok(()),
            };
        }
        if self.env.is_some() && self.light != RenderLight::Env {
            return Err("--env needs --light env: other lights take no map".into());
        }
        let given = [("--define", !p.define.is_empty()), ("--allow-parent-paths", p.allow_parent_paths)];
        if let Some((name, _)) = given.into_iter().find(|g| g.1) {
            return Err(format!("{name} needs an .xml scene"));
        }
        if self.integrator == Some(RenderIntegrator::Path) {
            return Ok(());
        }
        let given = [
            ("--noise", p.noise.is_some()),
            ("--time-limit", p.time_limit.is_some()),
            ("--guiding", p.guiding.is_some()),
            ("--aov", !p.aov.is_empty()),
            ("--resume", p.resume),
            ("--exposure", p.exposure != 0.0),
            ("--tone-map", p.tone_map),
            ("--background", p.background),
            ("--explain", p.explain),
            ("--seed", p.seed.is_some()),
            ("--max-depth", p.max_depth.is_some()),
            ("--save-every", p.save_every.is_some()),
            ("--light asset", self.light == RenderLight::Asset),
        ];
        if let Some((name, _)) = given.into_iter().find(|g| g.1) {
            return Err(format!("{name} needs --integrator path"));
        }
        match self.spp {
            None | Some(1 | 4 | 16 | 64) => Ok(()),
            Some(n) => Err(format!(
                "--spp is {n}; for raster it must be 1, 4, 16 or 64; --integrator path takes any number"
            )),
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

/// What learns where light comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum RenderGuiding {
    /// Nothing.
    #[default]
    Off,
    /// A normalizing flow.
    Flow,
    /// Lobes in a spatial tree.
    Lobes,
}

/// Options of `render --integrator path`.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct PathArgs {
    /// Stop where the relative noise is below E, 0.02 is clean; --spp still bounds the samples, 4096 without it [range:
    /// more than 0] [default: --spp alone ends the render].
    #[arg(long, value_name = "E", value_parser = single(above(0.0)))]
    pub(crate) noise: Option<f32>,
    /// Stop after this many seconds of rendering; loading and writing take their time on top [range: more than 0, at most
    /// 1000000000] [default: no limit].
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) time_limit: Option<Duration>,
    /// Learn where light comes from before rendering, and choose directions by it where that pays
    /// (experimental). The guide switches itself off where it does not pay, and says so [default: off].
    #[arg(long, value_enum)]
    pub(crate) guiding: Option<RenderGuiding>,
    /// Least gain of --guiding, variance times work without the guide over that with it, for which it stays on; 0 keeps every
    /// guide that was trained [range: at least 0] [default: 1.15].
    #[arg(long, value_name = "G", requires = "guiding", value_parser = number(0.0..))]
    pub(crate) least_gain: Option<f64>,
    /// Auxiliary images, as layers of an .exr: albedo, normal, `geometric_normal`, depth, position, instance, variance,
    /// direct, indirect, samples; or all [default: none].
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub(crate) aov: Vec<String>,
    /// Go on from the state that an interrupted render left beside the output, to the same bits.
    #[arg(long)]
    pub(crate) resume: bool,
    /// Seconds between two saved states, at least 0.01 [range: more than 0, at most 1000000000] [default: 20].
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) save_every: Option<Duration>,
    /// Most scattering events of a path: 0 shows what glows, 1 direct light [range: 0 to 1000000] [default: 16, or what
    /// the scene says].
    #[arg(long, value_name = "N", value_parser = whole::<u32>(0..=1_000_000))]
    pub(crate) max_depth: Option<u32>,
    /// Brightness in stops: +1 is twice as bright (.png) [range: -100 to 100].
    #[arg(long, value_name = "EV", default_value_t = 0.0, value_parser = single(-100.0..=100.0), allow_negative_numbers = true)]
    pub(crate) exposure: f32,
    /// Compress bright colours into the range of a display (.png; Khronos PBR Neutral).
    #[arg(long)]
    pub(crate) tone_map: bool,
    /// Show the environment behind the asset.
    #[arg(long)]
    pub(crate) background: bool,
    /// Give the parameter NAME (`$NAME`) of an .xml scene a value; may be repeated [default: what the scene says].
    #[arg(long, value_name = "NAME=VALUE", value_parser = definition)]
    pub(crate) define: Vec<(String, String)>,
    /// Let an .xml scene name files above its folder, by `..` or in the folder right above it: only for scenes that you
    /// trust.
    #[arg(long)]
    pub(crate) allow_parent_paths: bool,
    /// Seed of the random numbers [range: at least 0] [default: 0].
    #[arg(long, value_name = "S", value_parser = whole::<u64>(0..))]
    pub(crate) seed: Option<u64>,
    /// Print what the integrator runs and skips, and why.
    #[arg(long)]
    pub(crate) explain: bool,
}

//! The options of `photofit simplify`.

use super::values::{above_to, between, device, ending, number, seconds, whole};
use super::{
    Device, FitEffort, FitJudge, FitLighting, FitReference, FitWith, GeometryFormat, MipLevels,
    OcclusionMaps, Running, Start, TextureFormat,
};
use clap::{ArgGroup, Args};
use photofit_fit::simplify::SimplifyOptions;
use std::path::PathBuf;
use std::time::Duration;

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
    /// What the fit starts from. What is written is as ever what looks best, the asset's own materials included, unless --new-maps
    /// is given.
    #[arg(long, value_enum, default_value = "decimate")]
    pub(crate) init: Start,
    /// Always write new maps, in one set, and one material for each kind of surface (alpha mode, sides, extensions). Else the asset's own textures and materials on fewer
    /// triangles are written where they look better than what was fitted.
    #[arg(long)]
    pub(crate) new_maps: bool,
    /// Keep the asset's texture coordinates, materials and textures, tiling ones too, all as they are: triangles alone are fewer,
    /// in the way that looks best of several, and nothing is fitted. Textures are stored as they were read unless --textures or
    /// --jpeg says otherwise.
    #[arg(long, conflicts_with_all = ["new_maps", "steps", "batch", "texture_size", "fit_with", "checkpoint", "resume"])]
    pub(crate) keep_uvs: bool,
    /// Leave vertices on open borders where they are, to the bit, in the decimation and in the fit: parts of a larger asset that
    /// are simplified apart meet without cracks. Where borders leave no room for the budget there are more triangles.
    #[arg(long)]
    pub(crate) lock_borders: bool,
    /// Leave vertices where they are, to the bit, at which the attribute `_NAME` of a glTF file is above one half. Blender writes such
    /// attributes, and turns vertex groups into them. As with --lock-borders, there may be more triangles [default: none].
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
    /// Steps of the fit; fewer are made when held-out views stop improving: a phase goes on to its last quarter, then
    /// ends, once 150 steps brought nothing better, and a fit far behind the asset's own materials ends [range: at least 0] [default: 1000, or what --effort says].
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
    /// needs --textures ktx2, which alone holds levels.
    #[arg(long, value_enum, default_value = "classic")]
    pub(crate) mips: MipLevels,
    /// Compress geometry: all kinds of meshopt are `EXT_meshopt_compression`, which three.js, Babylon.js, Godot and others read;
    /// within --max-bytes those coarser than this one are tried, too, and the last line tells which was taken.
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
    /// another budget a quarter, a half, three quarters and nine tenths of the bytes are tried for triangles, both of new maps and of the
    /// asset's own surface, or, where nothing has textures, all of them. Where the lightest file is larger, it is written to OUT.too-large.glb and OUT.glb stays as it
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
    /// time, and their noise counts as error in SSIM and FLIP [range: 2 to 65536].
    #[arg(long, value_name = "N", default_value_t = SimplifyOptions::default().judge_spp, value_parser = whole::<u32>(2..=65536))]
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
    pub(super) fn check(&self) -> Result<(), String> {
        if self.fit_with == FitWith::Path && self.reference != FitReference::Path {
            return Err("--fit-with is path, but --reference is raster; it must be path, too".into());
        }
        // clap does not ask for --lod where another option rules it out.
        let of_lod = [
            ("--lod-triangles", !self.lod_triangles.is_empty()),
            ("--msft-lod", self.msft_lod),
            ("--continuous", self.continuous),
        ];
        if let Some((name, _)) = of_lod.iter().find(|(_, given)| *given && self.lod.is_empty()) {
            return Err(format!("{name} needs --lod, which does not go with other options that are given"));
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

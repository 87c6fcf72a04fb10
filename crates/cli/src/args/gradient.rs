//! The options of `photofit gradient`.

use super::values::{definition, ending, whole};
use clap::Args;
use std::path::PathBuf;

/// The gradient is that of `sum(W I)`: the pixels of the path-traced picture I, weighted by W.
#[derive(Args, Debug)]
#[command(
    override_usage = "photofit gradient [OPTIONS] --parameter <KEY> <SCENE>\n       photofit gradient --list <SCENE>"
)]
pub(crate) struct Gradient {
    #[command(flatten)]
    pub(crate) scene: ParameterScene,
    /// The parameter: a key of --list.
    #[arg(long, value_name = "KEY", required_unless_present = "list")]
    pub(crate) parameter: Option<String>,
    /// Print the keys that have derivatives, each with its shape, and do nothing else. Single colours and lights that are 0 have
    /// none here (media aside), but `photofit recover scene` finds them. Factors of 0 whose map is not read have none in either.
    #[arg(long, conflicts_with_all = ["parameter", "weights", "json", "image"])]
    pub(crate) list: bool,
    /// The weights W: an image of the size of the picture, linear [default: 1 everywhere].
    #[arg(long, value_name = "W.exr", value_parser = ending(&["exr"]))]
    pub(crate) weights: Option<PathBuf>,
    /// Samples per pixel, in up to 16 independent estimates that give the standard error [range: 2 to 16777216].
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = whole::<u32>(2..=1 << 24))]
    pub(crate) spp: u32,
    /// Threads; the gradient is the same for any number [range: 1 to 1024] [default: all cores].
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Write the gradient and its standard error as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    /// Write the gradient of a texture as a picture: R, G, B, and the layer `standard_error`.
    #[arg(long, value_name = "FILE.exr", value_parser = ending(&["exr"]))]
    pub(crate) image: Option<PathBuf>,
}

/// A scene whose path-traced picture has parameters.
#[derive(Args, Clone, Debug)]
pub(crate) struct ParameterScene {
    /// The scene: a Mitsuba 3 scene (.xml), or an asset (.glb, .gltf), seen by its camera or, without one, from where `photofit
    /// render` sees it; its light is its own, or that of --env.
    #[arg(value_name = "SCENE")]
    pub(crate) input: PathBuf,
    /// Most scattering events of a path: 1 is direct light [range: 0 to 1000000] [default: 16, or what the scene says].
    #[arg(long, value_name = "D", value_parser = whole::<u32>(0..=1_000_000))]
    pub(crate) max_depth: Option<u32>,
    /// Seed of the random numbers [range: at least 0].
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = whole::<u64>(0..))]
    pub(crate) seed: u64,
    /// Width of the picture, pixels [range: 1 to 16384] [default: 512, or what the scene or --picture says].
    #[arg(long, value_name = "PX", value_parser = whole::<u32>(1..=16384))]
    pub(crate) width: Option<u32>,
    /// Height of the picture, pixels [range: 1 to 16384] [default: 512, or what the scene or --picture says].
    #[arg(long, value_name = "PX", value_parser = whole::<u32>(1..=16384))]
    pub(crate) height: Option<u32>,
    /// Camera of an asset or sensor of an .xml scene, the first is 0; of an asset and `recover scene` several, one after the other [range: at least 0].
    #[arg(long, value_name = "N", default_value = "0", value_parser = whole::<usize>(0..))]
    pub(crate) camera: Vec<usize>,
    /// Equirectangular environment around an asset (.hdr, .exr, .png, .jpg), as bright as it is.
    #[arg(long, value_name = "FILE")]
    pub(crate) env: Option<PathBuf>,
    /// Give the parameter NAME (`$NAME`) of an .xml scene a value; may be repeated [default: what the scene says].
    #[arg(long, value_name = "NAME=VALUE", value_parser = definition)]
    pub(crate) define: Vec<(String, String)>,
    /// Let an .xml scene name files above its folder, by `..` or in the folder right above it: only for scenes that you
    /// trust.
    #[arg(long)]
    pub(crate) allow_parent_paths: bool,
}

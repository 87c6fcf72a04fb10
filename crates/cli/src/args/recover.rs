//! The options of `photofit recover`.

use super::Running;
use super::values::{ending, seconds, whole};
use clap::{Args, Subcommand};
use std::path::PathBuf;
use std::time::Duration;

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
    #[arg(short, long, value_name = "OUT.glb", value_parser = ending(&["glb"]))]
    pub(crate) output: PathBuf,
    /// Width and height of the textures, texels [range: 16 to 8192].
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = whole::<usize>(16..=8192))]
    pub(crate) texture_size: usize,
    /// Steps of the fit; fewer are made when held-out pictures stop improving [range: at least 0].
    #[arg(long, value_name = "N", default_value_t = 400, value_parser = whole::<u64>(0..))]
    pub(crate) steps: u64,
    /// Pictures per step [range: 1 to 64].
    #[arg(long, value_name = "B", default_value_t = 2, value_parser = whole::<usize>(1..=64))]
    pub(crate) batch: usize,
    /// End the fit after this many seconds and keep what was reached; reading and writing take their time on top [range:
    /// more than 0, at most 1000000000] [default: no limit].
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) time_limit: Option<Duration>,
    #[command(flatten)]
    pub(crate) running: Running,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

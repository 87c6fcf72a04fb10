//! The options of `photofit retexture`.

use super::values::{ending, whole};
use super::{Course, FitLighting};
use clap::Args;
use std::path::PathBuf;

/// Texture coordinates, nodes, skins and animations of LIGHT stay as they are, and so does its shape without --fit-shape; its
/// materials become one with new maps. Both assets must stand in the same place. What moves is compared at moments of the
/// animations that both have by name.
#[derive(Args, Debug)]
pub(crate) struct Retexture {
    /// The asset that shows what is wanted: .glb, .gltf, .obj or .ply.
    #[arg(value_name = "REFERENCE")]
    pub(crate) reference: PathBuf,
    /// The light asset, with texture coordinates in the unit square that do not overlap.
    #[arg(value_name = "LIGHT")]
    pub(crate) light_asset: PathBuf,
    /// The file to write.
    #[arg(short, long, value_name = "OUT.glb", value_parser = ending(&["glb"]))]
    pub(crate) output: PathBuf,
    /// An animation that is compared, by its name or its number in the reference, the first is 0; may be repeated
    /// [default: all that both assets have].
    #[arg(long, value_name = "NAME|N")]
    pub(crate) animation: Vec<String>,
    /// Moments of each animation, evenly spread; with 0 both are compared as they stand [range: 0 to 64].
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = whole::<usize>(0..=64))]
    pub(crate) moments: usize,
    /// Width and height of the textures, texels [range: 16 to 8192].
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = whole::<usize>(16..=8192))]
    pub(crate) texture_size: usize,
    /// Width and height of the pictures that are judged, pixels; the fit compares pictures of half that size with four
    /// samples per pixel [range: 16 to 4096].
    #[arg(long, value_name = "PX", default_value_t = 512, value_parser = whole::<usize>(16..=4096))]
    pub(crate) resolution: usize,
    /// Steps of the fit; fewer are made when held-out views stop improving [range: at least 0].
    #[arg(long, value_name = "N", default_value_t = 400, value_parser = whole::<u64>(0..))]
    pub(crate) steps: u64,
    /// Fit the shape, too: the vertices of LIGHT in its bind pose, which its skins, morph targets and nodes move as before.
    /// Vertex normals are computed anew from the shape. Runs on the CPU.
    #[arg(long)]
    pub(crate) fit_shape: bool,
    #[command(flatten)]
    pub(crate) lighting: FitLighting,
    #[command(flatten)]
    pub(crate) course: Course,
}

impl Retexture {
    /// Whether the options go together.
    pub(super) fn check(&self) -> Result<(), String> {
        self.lighting.check()
    }
}

//! The options of `photofit surface`.

use super::values::{degrees, single, whole};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

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
    /// Width, pixels [range: 1 to 16384] [default: 960, or what --camera says].
    #[arg(long, value_name = "PX", value_parser = whole::<u32>(1..=16384))]
    pub(crate) width: Option<u32>,
    /// Height, pixels [range: 1 to 16384] [default: 720, or what --camera says].
    #[arg(long, value_name = "PX", value_parser = whole::<u32>(1..=16384))]
    pub(crate) height: Option<u32>,
    /// Turn of the camera around the up axis, degrees [range: -36000 to 36000] [default: 30].
    #[arg(long, value_name = "DEG", value_parser = degrees, allow_negative_numbers = true)]
    pub(crate) azimuth: Option<f32>,
    /// Lift of the camera, degrees [range: -36000 to 36000] [default: 20].
    #[arg(long, value_name = "DEG", value_parser = degrees, allow_negative_numbers = true)]
    pub(crate) elevation: Option<f32>,
    /// Distance of the camera from the centre, in radii of the cloud [range: 0.01 to 1000] [default: the cloud fills the
    /// picture].
    #[arg(long, value_name = "RADII", value_parser = single(0.01..=1000.0))]
    pub(crate) distance: Option<f32>,
    /// Vertical field of view, degrees [range: 0.1 to 170] [default: 40].
    #[arg(long, value_name = "DEG", value_parser = single(0.1..=170.0))]
    pub(crate) fov: Option<f32>,
    /// The axis that points up [default: y].
    #[arg(long, value_enum, allow_hyphen_values = true)]
    pub(crate) up: Option<UpAxis>,
    /// How holes are filled.
    #[arg(long, value_enum, default_value = "fast")]
    pub(crate) method: SurfaceMethod,
    /// Steps of the solver [range: 1 to 10000] [default: 10 for each pass of the fast method, else 100].
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=10000))]
    pub(crate) iterations: Option<u16>,
    /// Strength of the smoothing of colours, 0 is none [range: 0 to 10] [default: 0 for the fast method, else 0.03].
    #[arg(long, value_name = "S", value_parser = single(0.0..=10.0))]
    pub(crate) texture: Option<f32>,
    /// Fill the whole picture, also where no point is near.
    #[arg(long)]
    pub(crate) fill: bool,
    /// Threads; the maps are the same for any number [range: 1 to 1024] [default: all cores].
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

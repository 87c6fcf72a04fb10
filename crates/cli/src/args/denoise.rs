//! The options of `photofit denoise`.

use super::Device;
use super::values::{device, ending, whole};
use clap::builder::PossibleValuesParser;
use clap::{Args, ValueEnum};
use photofit_denoise::mc::{Model, Stage, VariationalModel};
use std::path::PathBuf;

/// What removes the noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum DenoiseModel {
    /// Regression on the features, its widths chosen by estimated error.
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

impl DenoiseModel {
    pub(crate) fn model(self) -> Model {
        match self {
            Self::Auto => Model::Auto,
            Self::Rof => Model::Variational(VariationalModel::Rof),
            Self::Tvl1 => Model::Variational(VariationalModel::TvL1),
            Self::Hybrid => Model::Variational(VariationalModel::Hybrid),
            Self::Tgv => Model::Variational(VariationalModel::Tgv),
            Self::Atrous => Model::Atrous,
        }
    }

    /// As `--model` takes it.
    pub(crate) fn name(self) -> String {
        format!("{self:?}").to_ascii_lowercase()
    }
}

#[derive(Args, Debug)]
pub(crate) struct Denoise {
    /// The noisy picture: .exr (with feature layers, if there are any), .hdr, .png or .jpg.
    #[arg(value_name = "COLOR")]
    pub(crate) input: PathBuf,
    /// The picture to write: .exr (linear) or .png (sRGB).
    #[arg(short, long, value_name = "OUT.exr|.png", value_parser = ending(&["exr", "png"]))]
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
    /// Leave out inputs or stages, separated by commas, to see what they bring [default: none].
    #[arg(long, value_name = "STAGE", value_delimiter = ',', value_parser = PossibleValuesParser::new(Stage::ALL.map(Stage::name)))]
    pub(crate) without: Vec<String>,
    /// A clean picture to compare with: PSNR, SSIM, FLIP, RMSE.
    #[arg(long, value_name = "REF")]
    pub(crate) compare: Option<PathBuf>,
    /// Where it runs: cpu, gpu (hardware), gpu:NAME (the first adapter whose name or driver holds NAME, also one in
    /// software), or auto: a GPU in hardware if there is one, else the CPU. A GPU solves rof, tvl1 and hybrid; with auto,
    /// what it cannot do runs on the CPU, and the report says so.
    #[arg(long, value_name = "DEVICE", default_value = "cpu", value_parser = device)]
    pub(crate) device: Device,
    /// Threads; the picture is the same for any number [range: 1 to 1024] [default: all cores].
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Print what runs and what is skipped, and why.
    #[arg(long)]
    pub(crate) explain: bool,
    /// Write figures, times and the plan as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

impl Denoise {
    /// Whether the options belong to the model.
    pub(super) fn check(&self) -> Result<(), String> {
        if let Some(twice) = self.without.iter().enumerate().find(|(k, s)| self.without[..*k].contains(s)) {
            return Err(format!("--without names {} twice; each stage must be named once", twice.1));
        }
        let model = self.model.model();
        let none = |s: &&Stage| !s.is_of(model) && self.without.iter().any(|name| name == s.name());
        if let Some(stage) = Stage::ALL.iter().find(none) {
            let has: Vec<&str> = Stage::ALL.into_iter().filter(|s| s.is_of(model)).map(Stage::name).collect();
            return Err(format!(
                "--without {stage}: --model {} has no such stage; it has {}",
                self.model.name(),
                has.join(", ")
            ));
        }
        if matches!(self.device, Device::Gpu | Device::Named(_)) && !self.model.model().has_kernels() {
            let (device, model) = (&self.device, self.model.name());
            return Err(format!(
                "--device {device} needs --model hybrid, rof or tvl1: there are no kernels for {model}, which --device auto \
                 runs on the CPU"
            ));
        }
        match (self.keep_darkening, self.model) {
            (true, DenoiseModel::Auto | DenoiseModel::Atrous) => {
                Err("--keep-darkening needs --model rof, tvl1, hybrid or tgv: the others do not darken"
                    .into())
            }
            _ => Ok(()),
        }
    }
}

//! The options of `photofit recover`.

use super::values::{Numbers, above_to, between, ending, number, numbers, of_key, seconds, whole};
use super::{Course, ParameterScene, RenderGuiding, Running, STATUSES};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, Subcommand};
use photofit_fit::engine::loss::PictureLoss;
use photofit_fit::engine::surface::PositionOptimizer;
use photofit_fit::engine::traced::Smoothing;
use photofit_fit::engine::trainer::Checkpointing;
use photofit_fit::recover_mesh::MOST_TRIANGLES;
use std::path::PathBuf;
use std::time::Duration;

#[derive(Debug, Subcommand)]
pub(crate) enum Recover {
    /// Paint an asset's shape so that it looks like pictures with known cameras.
    #[command(after_help = STATUSES)]
    Texture(RecoverTexture),
    /// Find a shape and its colours from pictures with known cameras and alpha.
    #[command(after_help = STATUSES)]
    Mesh(RecoverMesh),
    /// Find materials, textures, lights and media of a scene again from path-traced pictures of it.
    #[command(after_help = STATUSES)]
    Scene(RecoverScene),
    /// Find the materials of a mesh and the light around it from pictures with known cameras.
    #[command(after_help = STATUSES)]
    Material(RecoverMaterial),
    /// Find a cloud, its density, albedo and own light on a grid, from pictures with known cameras and light.
    #[command(after_help = STATUSES)]
    Volume(RecoverVolume),
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
    /// How pictures are compared in the steps [default: squares, relative ones where pictures hold light above 1].
    #[arg(long, value_name = "HOW", value_parser = losses())]
    pub(crate) loss: Option<PictureLoss>,
    #[command(flatten)]
    pub(crate) course: Course,
}

/// One of `all` by its name, with what is said about it.
fn by_name<T: Copy + Send + Sync + 'static, const N: usize>(
    all: [T; N],
    name: fn(&T) -> &'static str,
    about: fn(&T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    let value = |t: T| PossibleValue::new(name(&t)).help(about(&t));
    PossibleValuesParser::new(all.map(value)).map(move |given| {
        let named = all.into_iter().find(|t| name(t) == given);
        named.expect("one of the possible values")
    })
}

/// The losses.
fn losses() -> impl TypedValueParser<Value = PictureLoss> {
    by_name(PictureLoss::ALL, PictureLoss::name, PictureLoss::about)
}

/// The optimizers of vertices.
fn optimizers() -> impl TypedValueParser<Value = PositionOptimizer> {
    by_name(PositionOptimizer::ALL, |o| o.name(), |o| o.about())
}

/// The filters of steps.
fn smoothings() -> impl TypedValueParser<Value = Smoothing> {
    by_name(Smoothing::ALL, |s| s.name(), |s| s.about())
}

#[derive(Args, Debug)]
pub(crate) struct RecoverMesh {
    /// The pictures: a folder with transforms.json, or such a file. All must have alpha, which is the outline.
    #[arg(value_name = "PICTURES", required_unless_present = "self_test")]
    pub(crate) pictures: Option<PathBuf>,
    /// Try it on pictures that are drawn of this asset under known lights; the distance of the shapes is told.
    #[arg(long, value_name = "ASSET", conflicts_with = "pictures")]
    pub(crate) self_test: Option<PathBuf>,
    /// Pictures of --self-test [range: 8 to 256].
    #[arg(long, value_name = "N", default_value_t = 24, conflicts_with = "pictures", value_parser = whole::<usize>(8..=256))]
    pub(crate) views: usize,
    /// Width and height of the pictures of --self-test, pixels [range: 16 to 2048].
    #[arg(long, value_name = "N", default_value_t = 192, conflicts_with = "pictures", value_parser = whole::<usize>(16..=2048))]
    pub(crate) picture_size: usize,
    /// The shape to begin with: .glb, .gltf, .obj or .ply, in the world of the cameras [default: a ball].
    #[arg(long, value_name = "START")]
    pub(crate) mesh: Option<PathBuf>,
    /// The file to write.
    #[arg(short, long, value_name = "OUT.glb", value_parser = ending(&["glb"]))]
    pub(crate) output: PathBuf,
    /// How vertices move.
    #[arg(long, value_name = "HOW", default_value = PositionOptimizer::default().name(), value_parser = optimizers())]
    pub(crate) optimizer: PositionOptimizer,
    /// Most triangles of the result; a --mesh of more keeps its own [range: 80 to 4194304].
    #[arg(long, value_name = "N", default_value_t = 5120, value_parser = whole::<usize>(80..=MOST_TRIANGLES as u64))]
    pub(crate) triangles: usize,
    /// Width and height of the textures, texels [range: 16 to 8192].
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = whole::<usize>(16..=8192))]
    pub(crate) texture_size: usize,
    /// Steps of the fit; fewer are made when held-out pictures stop improving [range: at least 0].
    #[arg(long, value_name = "N", default_value_t = 600, value_parser = whole::<u64>(0..))]
    pub(crate) steps: u64,
    #[command(flatten)]
    pub(crate) course: Course,
}

// How a fit through the path tracer goes; a doc comment would become that of the command.
#[derive(Args, Debug)]
pub(crate) struct TracedFit {
    /// How steps of textures and grids are smoothed [default: narrowing for scenes, laplacian for materials of a mesh, bilateral for volumes].
    #[arg(long, value_name = "HOW", value_parser = smoothings())]
    pub(crate) smoothing: Option<Smoothing>,
    /// Steps of the fit, all its parts together; fewer are made when the picture stops improving [range: at least 0].
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = whole::<u64>(0..))]
    pub(crate) steps: u64,
    /// Peak rate of the optimizer: of colours, roughness and the like as they are, of radiances relative to them or to the mean of
    /// their start, of densities relative to what is opaque [range: more than 0, at most 1].
    #[arg(long, value_name = "RATE", default_value_t = 0.05, value_parser = number(above_to(0.0, 1.0)))]
    pub(crate) rate: f64,
    /// Samples per pixel of the picture of a step [range: 1 to 65536].
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = whole::<u32>(1..=65536))]
    pub(crate) spp: u32,
    /// Samples per pixel of its gradient [range: 1 to 65536].
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = whole::<u32>(1..=65536))]
    pub(crate) gradient_spp: u32,
}

// How a fit in parts through the path tracer ends and goes on, and what is told of it.
#[derive(Args, Debug)]
pub(crate) struct TracedCourse {
    /// End the fit after this many seconds and keep what was reached; reading, work between the parts of the fit, and what is
    /// written take their time on top [range: more than 0, at most 1000000000] [default: no limit].
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) time_limit: Option<Duration>,
    #[command(flatten)]
    pub(crate) running: Running,
    /// Print what ran, what was skipped, and why.
    #[arg(long)]
    pub(crate) explain: bool,
}

impl TracedCourse {
    pub(crate) fn checkpointing(&self) -> Checkpointing {
        let Running { checkpoint, resume, .. } = &self.running;
        Checkpointing { checkpoint: checkpoint.clone(), resume: *resume, time_limit: self.time_limit }
    }
}

/// Parameters are named as by `photofit gradient SCENE --list`. Shapes and cameras stay as they are. Of four pictures or
/// more the last one is held out: the state that comes closest to it is kept. Fewer are all fitted, and the state that comes
/// closest to them is kept.
#[derive(Args, Debug)]
pub(crate) struct RecoverScene {
    #[command(flatten)]
    pub(crate) scene: ParameterScene,
    /// The picture that the scene is to look like: linear .exr of the picture's size; one for each --camera, in the same
    /// order. Or several pictures with their cameras in the world of the scene: a folder with transforms.json, or such a
    /// file, as `recover texture` reads it.
    #[arg(long, value_name = "REF.exr|PICTURES", required_unless_present = "self_test")]
    pub(crate) picture: Vec<PathBuf>,
    /// Try it on the scene itself: its own picture is the target, and the parameters start from flat values; the errors of
    /// the parameters are told.
    #[arg(long, conflicts_with = "picture")]
    pub(crate) self_test: bool,
    /// Pictures of --self-test: that of the scene's camera, and of cameras that go around what it looks at [range: 1 to
    /// 256].
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole::<usize>(1..=256))]
    pub(crate) views: usize,
    /// A parameter to fit; may be repeated.
    #[arg(long, value_name = "KEY", required = true)]
    pub(crate) parameter: Vec<String>,
    /// Value that all parameters start from, or KEY=X: that one of them starts from; may be repeated [range: 0 to 1000000]
    /// [default: what the scene says; with --self-test the middle of what has bounds, half the mean of densities, twice that of
    /// other values]. What is more than a parameter can be is refused, what is less moved into its range; normal maps start without bumps.
    #[arg(long, value_name = "X|KEY=X", value_parser = of_key(0.0..=1e6))]
    pub(crate) start: Vec<(Option<String>, f64)>,
    #[command(flatten)]
    pub(crate) traced: TracedFit,
    /// The folder to write: pictures before and after, textures (.exr, .png), grids (.vol), values.json,
    /// index.html.
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// End the fit after this many seconds and keep what was reached; reading, the pictures of --self-test, and those that are
    /// written take their time on top [range: more than 0, at most 1000000000] [default: no limit].
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) time_limit: Option<Duration>,
    /// Threads; the result is the same for any number [range: 1 to 1024] [default: all cores].
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Folder in which the state of the fit is kept, for --resume.
    #[arg(long, value_name = "DIR")]
    pub(crate) checkpoint: Option<PathBuf>,
    /// Go on from the checkpoint, if there is one, to the same result as an uninterrupted run.
    #[arg(long, requires = "checkpoint")]
    pub(crate) resume: bool,
    /// Print what ran, what was skipped, and why.
    #[arg(long)]
    pub(crate) explain: bool,
}

/// Lights are those of the pictures' list (`lights` in transforms.json), an environment (--env), or the cloud's own (--emission). Grids go from coarse to
/// fine. Of four pictures or more the last one is held out, and what comes closest to it is kept.
#[derive(Args, Debug)]
pub(crate) struct RecoverVolume {
    /// The pictures, all of one size, linear light as the path tracer shows it: a folder with transforms.json, or such a
    /// file.
    #[arg(value_name = "PICTURES", required_unless_present = "self_test")]
    pub(crate) pictures: Option<PathBuf>,
    /// Try it on a known cloud: the extinction of this grid, which must be the same in all channels, with --albedo, or one of .8, .6,
    /// .4, seen from around.
    #[arg(long, value_name = "GRID.vol", conflicts_with = "pictures", value_parser = ending(&["vol"]))]
    pub(crate) self_test: Option<PathBuf>,
    /// Pictures of --self-test [range: 1 to 256].
    #[arg(long, value_name = "N", default_value_t = 16, conflicts_with = "pictures", value_parser = whole::<usize>(1..=256))]
    pub(crate) views: usize,
    /// Width and height of the pictures of --self-test, pixels [range: 16 to 2048].
    #[arg(long, value_name = "PX", default_value_t = 128, conflicts_with = "pictures", value_parser = whole::<usize>(16..=2048))]
    pub(crate) resolution: usize,
    /// Equirectangular environment around the cloud (.hdr, .exr, .png, .jpg), as bright as it is.
    #[arg(long, value_name = "FILE")]
    pub(crate) env: Option<PathBuf>,
    /// Corners of the box that holds the cloud, in the units of the cameras [range: -1000000000 to 1000000000] [default: the box
    /// of --self-test, or the cube around what all cameras see].
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", allow_hyphen_values = true,
          value_parser = numbers(&[6], -1e9..=1e9))]
    pub(crate) bounds: Option<Numbers>,
    /// Voxels along the longest side of the box [range: 1 to 512].
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = whole::<usize>(1..=512))]
    pub(crate) size: usize,
    /// Begin with the finest grid.
    #[arg(long)]
    pub(crate) one_grid: bool,
    /// Albedo, one or three numbers, where it is known [range: 0 to 1] [default: it is found].
    #[arg(long, value_name = "R,G,B", value_parser = numbers(&[1, 3], 0.0..=1.0))]
    pub(crate) albedo: Option<Numbers>,
    /// Find the light that the cloud emits itself, too, as fire does: radiance per length. With --self-test the known cloud
    /// emits .8, .4 and .1 times its extinction.
    #[arg(long)]
    pub(crate) emission: bool,
    /// Mean cosine of scattering; positive scatters forward [range: more than -1, less than 1].
    #[arg(long, value_name = "G", default_value_t = 0.0, allow_hyphen_values = true,
          value_parser = number(between(-1.0, 1.0)))]
    pub(crate) anisotropy: f64,
    #[command(flatten)]
    pub(crate) traced: TracedFit,
    /// Most scattering events of a path [range: 0 to 1000000].
    #[arg(long, value_name = "D", default_value_t = 16, value_parser = whole::<u32>(0..=1_000_000))]
    pub(crate) max_depth: u32,
    /// The folder to write: extinction.vol, albedo.vol, with --emission emission.vol, views.png, values.json, index.html.
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) course: TracedCourse,
}

/// Base colour, roughness and metalness become textures of the mesh, light from all around an environment, through the path
/// tracer. What pictures tell of base colour is its product with the light; what they leave open the start decides, a base
/// colour of one half under an even, colourless sky. Of four pictures or more the last one is held out, and what comes closest to it is kept.
#[derive(Args, Debug)]
pub(crate) struct RecoverMaterial {
    /// The pictures, all of one size: a folder with transforms.json, or such a file. Linear .exr are best: what is white in a
    /// .png may be brighter. Where they have alpha, it says which pixels show the mesh.
    #[arg(value_name = "PICTURES", required_unless_present = "self_test", requires = "mesh")]
    pub(crate) pictures: Option<PathBuf>,
    /// The mesh: .glb, .gltf, .obj or .ply, in the world of the cameras. It keeps its texture coordinates; without some it gets
    /// new ones. Its materials are not read.
    #[arg(long, value_name = "ASSET", conflicts_with = "self_test")]
    pub(crate) mesh: Option<PathBuf>,
    /// Try it on pictures that are path traced of this asset: the errors of the materials are told, and how well the asset is
    /// shown under other light.
    #[arg(long, value_name = "ASSET", conflicts_with = "pictures")]
    pub(crate) self_test: Option<PathBuf>,
    /// Pictures of --self-test [range: 1 to 256].
    #[arg(long, value_name = "N", default_value_t = 12, conflicts_with = "pictures", value_parser = whole::<usize>(1..=256))]
    pub(crate) views: usize,
    /// Width and height of the pictures of --self-test, pixels [range: 16 to 2048].
    #[arg(long, value_name = "PX", default_value_t = 96, conflicts_with = "pictures", value_parser = whole::<usize>(16..=2048))]
    pub(crate) resolution: usize,
    /// Equirectangular environment (.hdr, .exr, .png, .jpg) that the fit starts from, as bright as it is; of --self-test the one
    /// in which the pictures are made [default: an even sky; of --self-test one with three windows].
    #[arg(long, value_name = "FILE")]
    pub(crate) env: Option<PathBuf>,
    /// Leave the environment as it is: that of --env or of --self-test, else an even sky.
    #[arg(long)]
    pub(crate) keep_environment: bool,
    /// Rows of the environment that is found, without --env; twice as many columns [range: 1 to 2048].
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = whole::<usize>(1..=2048))]
    pub(crate) environment_size: usize,
    /// Width and height of the textures, texels [range: 16 to 8192].
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = whole::<usize>(16..=8192))]
    pub(crate) texture_size: usize,
    /// Make new texture coordinates, also where the mesh has some.
    #[arg(long)]
    pub(crate) unwrap: bool,
    /// Find a normal map, too.
    #[arg(long)]
    pub(crate) normal_map: bool,
    /// The pictures show the environment behind the mesh: it is compared, too. Else pixels that the mesh covers whole alone are.
    #[arg(long)]
    pub(crate) background: bool,
    /// What learns where light comes from between the rounds and chooses directions of paths in the next one; it
    /// switches itself off where it does not pay, and says so.
    #[arg(long, value_enum, default_value = "off")]
    pub(crate) guiding: RenderGuiding,
    /// Rounds of the fit, with equal shares of the steps; the first has no guide [range: 1 to 8].
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = whole::<usize>(1..=8))]
    pub(crate) rounds: usize,
    #[command(flatten)]
    pub(crate) traced: TracedFit,
    /// Most scattering events of a path: 1 is direct light [range: 1 to 1000000].
    #[arg(long, value_name = "D", default_value_t = 4, value_parser = whole::<u32>(1..=1_000_000))]
    pub(crate) max_depth: u32,
    /// The folder to write: material.glb, environment.exr, views.png, relit.png (of --self-test), values.json, index.html.
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) course: TracedCourse,
}

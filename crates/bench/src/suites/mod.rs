//! The registry of suites.

mod atlas;
mod colors;
mod decimate;
mod denoise;
mod denoise_mc;
mod denoise_peer;
#[cfg(feature = "gpu")]
mod device;
mod effort;
mod flow;
mod gradients;
mod material;
mod metrics;
mod mips;
mod optim;
mod path_gradients;
mod pathtrace;
mod raster;
mod rays;
mod recover;
mod second_order;
mod surface;
mod ztest;

use anyhow::Result;

use crate::context::Context;

/// One suite.
pub(crate) struct Suite {
    pub(crate) name: &'static str,
    /// What is measured, one line.
    pub(crate) about: &'static str,
    pub(crate) run: fn(&mut Context) -> Result<()>,
}

/// All suites, in the order in which they run.
pub(crate) const SUITES: &[Suite] = &[
    Suite { name: "metrics", about: "image metrics, time against size", run: metrics::run },
    Suite {
        name: "raster",
        about: "differentiable rasterizer, time against pixels and triangles",
        run: raster::run,
    },
    #[cfg(feature = "gpu")]
    Suite {
        name: "device",
        about: "steps and whole fits on a GPU (PHOTOFIT_DEVICE=NAME, else any) beside the CPU, and the work of each kernel",
        run: device::run,
    },
    Suite {
        name: "colors",
        about: "coloured meshes without lights, the case that other differentiable rasterizers offer too",
        run: colors::run,
    },
    Suite {
        name: "gradients",
        about: "position gradients at silhouettes, error against time",
        run: gradients::run,
    },
    Suite {
        name: "rays",
        about: "ray casting through the hierarchy, time against triangles",
        run: rays::run,
    },
    Suite {
        name: "decimate",
        about: "decimation to 3%, time and error against triangles",
        run: decimate::run,
    },
    Suite {
        name: "denoise",
        about: "variational denoising, energy gap against time, time against size",
        run: denoise::run,
    },
    Suite {
        name: "denoise-mc",
        about: "Monte Carlo denoising, error by model, what each step brings, error against time",
        run: denoise_mc::run,
    },
    Suite {
        name: "surface",
        about: "surfaces from points, error against time by method and density",
        run: surface::run,
    },
    Suite {
        name: "surface-steps",
        about: "surfaces from points, each step beside a prototype in double precision",
        run: surface::steps::run,
    },
    Suite { name: "optim", about: "first-order optimizers, error against steps and time", run: optim::run },
    Suite {
        name: "filters",
        about: "spatial filters of the optimizers, time against size",
        run: optim::speed::run,
    },
    Suite {
        name: "second-order",
        about: "black boxes: sampled first and second derivatives, error against evaluations and time",
        run: second_order::run,
    },
    Suite {
        name: "path-gradients",
        about: "gradients by path replay, error against time by kind of parameter",
        run: path_gradients::run,
    },
    Suite {
        name: "recover",
        about: "a texture through the path tracer, error of texture and picture against time by optimizer",
        run: recover::plate::run,
    },
    Suite {
        name: "recover-cloud",
        about: "a volume through the path tracer, error of density, albedo and pictures against time by optimizer",
        run: recover::cloud::run,
    },
    Suite {
        name: "recover-samples",
        about: "a volume from steps of few and of many samples, error of parameters and pictures against time",
        run: recover::cloud::samples,
    },
    Suite {
        name: "recover-smoothing",
        about: "textures of many kinds by `recover scene`, errors by the smoothing of its steps",
        run: recover::smoothing::run,
    },
    Suite {
        name: "recover-steps",
        about: "one step of these recoveries, variance of its gradient and time by samples",
        run: recover::steps::run,
    },
    Suite {
        name: "recover-mesh",
        about: "shapes from pictures with outlines, distances against steps and time by optimizer of positions",
        run: recover::mesh::run,
    },
    Suite {
        name: "material",
        about: "materials and light of a mesh from pictures, errors by sampler at equal samples and equal time, ablations",
        run: material::run,
    },
    Suite {
        name: "material-filters",
        about: "materials and light of a mesh from pictures, errors by filter of the steps in two scenes",
        run: material::filters,
    },
    Suite { name: "ztest", about: "agreement of path tracing with published references", run: ztest::run },
    Suite { name: "flow", about: "learned importance sampling, variance times time", run: flow::run },
    Suite {
        name: "flow-cost",
        about: "learned importance sampling, nanoseconds of a sample, a density and their parts",
        run: flow::cost::run,
    },
    Suite { name: "pathtrace", about: "path tracing, error against time", run: pathtrace::run },
    Suite { name: "effort", about: "the main job at each effort, error against time", run: effort::run },
    Suite {
        name: "mips",
        about: "mip levels with texels of their own beside averages, error by size on screen",
        run: mips::run,
    },
    Suite { name: "atlas", about: "unwrapping, time and stretch against triangles", run: atlas::run },
];

//! Fits on a device beside the CPU: time of a step against pixels, the work of each kernel, whole fits by error and time.

use crate::context::Context;
use crate::timing::Timing;
use anyhow::{Result, bail};
use photofit_fit::Silent;
use photofit_fit::candidate::{Candidate, SurfaceClass};
use photofit_fit::engine::cpu::Cpu;
use photofit_fit::engine::device::Device;
use photofit_fit::engine::gpu::GpuSurface;
use photofit_fit::engine::model::Model;
use photofit_fit::engine::surface::{PositionOptimizer, Surface};
use photofit_fit::simplify::{SimplifyOptions, simplify};
use photofit_fit::views::{Lighting, Orbit, Sampling, Set, Shot, Views};
use photofit_geometry::atlas::{UnwrapOptions, unwrap};
use photofit_geometry::decimate::Target;
use photofit_geometry::shapes;
use photofit_geometry::weld::weld_exact;
use photofit_gpu::{AdapterKind, Choice, Gpu, INDEX, Kernel, KernelReport};
use photofit_image::Image;
use photofit_raster::deferred::{Masks, Passes};
use photofit_raster::loss::Loss;
use photofit_raster::{CHANNELS, Maps, channel};
use photofit_scalar::vec4;
use photofit_scene::{AlphaMode, Instance, Material, Primitive, Scene};
use photofit_shading::Sides;
use std::fmt::Write as _;
use std::time::Instant;

/// Rates of positions and maps.
const RATES: [f64; 2] = [0.001, 0.01];
/// Steps in flight before their losses are read, where a step takes less than a second.
const IN_FLIGHT: usize = 10;

/// Kernel that copies a buffer, 16 bytes an invocation: the bandwidth that others are compared with.
const STREAM: Kernel = Kernel {
    name: "stream",
    source: &[
        INDEX,
        "@group(0) @binding(1) var<storage, read> source: array<vec4<u32>>;
         @group(0) @binding(2) var<storage, read_write> copied: array<vec4<u32>>;
         @compute @workgroup_size(256)
         fn stream(
             @builtin(workgroup_id) group: vec3<u32>,
             @builtin(num_workgroups) groups: vec3<u32>,
             @builtin(local_invocation_index) lane: u32,
         ) {
             let i = index(group, groups, lane, 256u);
             if i < arrayLength(&copied) {
                 copied[i] = source[i];
             }
         }",
    ],
    entry: "stream",
};

/// What a step draws.
#[derive(Clone, Copy)]
struct Case {
    /// Pictures of a step.
    batch: u64,
    /// Pixels along a side, samples of a pixel along a side.
    size: usize,
    per_axis: usize,
    /// The body has 20 of these squared triangles.
    divisions: u32,
    /// Texels along a side of the maps.
    texels: usize,
}

/// What a software driver draws within minutes: batches as in the main job.
const fn small(size: usize) -> Case {
    Case { batch: 2, size, per_axis: 2, divisions: 9, texels: 512 }
}

/// Pictures of 9,680 triangles with maps of 2048 x 2048 texels.
const fn large(size: usize, per_axis: usize) -> Case {
    Case { batch: 8, size, per_axis, divisions: 22, texels: 2048 }
}

const SMALL: [Case; 3] = [small(64), small(128), small(256)];
/// By one sample a pixel (as nvdiffrec draws) and by four (as the main job does).
const LARGE: [Case; 4] = [large(512, 1), large(512, 2), large(2048, 1), large(2048, 2)];

impl std::fmt::Display for Case {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { batch, size, per_axis, .. } = self;
        write!(f, "{batch} x {size} x {size}, {}", per_axis * per_axis)
    }
}

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let choice = std::env::var("PHOTOFIT_DEVICE").map_or(Choice::Any, Choice::Named);
    let gpu = match Gpu::new(&choice) {
        Ok(gpu) => gpu,
        Err(e) => {
            bail!("{e}; a driver is needed (`apt-get install mesa-vulkan-drivers` has one in software)")
        }
    };
    let report = gpu.report();
    let hardware = report.kind != AdapterKind::Software;
    let bandwidth = bandwidth(&gpu)?;
    ctx.note(format!(
        "Device: {}, {}, driver {}; a copy of a buffer reads and writes {bandwidth:.0} GB a second (0: it has no \
         timestamps). {} threads on the CPU. Cases: pictures of a step x pixels, samples a pixel; a step is one submission, \
         and its time on the device includes its share of waiting for the losses. Errors: the difference of the losses of \
         the first step, relative; of whole fits the FLIP of the written file in unseen views.",
        report.name,
        report.backend,
        report.driver,
        rayon::current_num_threads(),
    ));
    for case in SMALL {
        steps(ctx, &gpu, case, bandwidth)?;
    }
    if hardware {
        for case in LARGE {
            steps(ctx, &gpu, case, bandwidth)?;
        }
    }
    whole(ctx, &gpu, hardware)
}

/// Bytes that a copy reads and writes in a nanosecond.
fn bandwidth(gpu: &Gpu) -> Result<f64> {
    let elements = (gpu.report().largest_binding.min(256 << 20) / 16) as usize;
    let buffers = [gpu.zeros::<[u32; 4]>("source", elements)?, gpu.zeros("copy", elements)?];
    let mut r = gpu.record("stream");
    for _ in 0..4 {
        r.dispatch(&STREAM, &(), &[buffers[0].bind(), buffers[1].bind()], elements)?;
    }
    let times = r.finish()?.profile()?;
    let best = times.iter().map(|t| t.1).fold(f64::INFINITY, f64::min);
    Ok(32e-6 * elements as f64 / best)
}

/// A body with maps.
fn surface(case: Case) -> Surface {
    let mesh = shapes::displaced_sphere(case.divisions, 0.2, 3, 5);
    let class = vec![0; mesh.triangles.len()];
    let options = UnwrapOptions { size: case.texels as u32, ..UnwrapOptions::default() };
    let atlas = unwrap(&mesh.positions, &mesh.triangles, &class, &options).expect("a body has an atlas");
    let (mesh, _) = atlas.build_mesh(&mesh.positions, &mesh.triangles);
    let mut texel = [0.0; CHANNELS];
    texel[..channel::USED].fill(0.5);
    (texel[channel::NORMAL], texel[channel::NORMAL + 1], texel[channel::NORMAL + 2]) = (0.0, 0.0, 1.0);
    let maps =
        Maps { width: case.texels, height: case.texels, texels: vec![texel; case.texels * case.texels] };
    let classes =
        vec![SurfaceClass { alpha: AlphaMode::Opaque, sides: Sides::Both, ..SurfaceClass::default() }];
    let class = vec![0; mesh.triangles.len()];
    let mut rates = [0.0; CHANNELS];
    rates[..channel::USED].fill(1.0);
    Surface {
        candidate: Candidate::new(&mesh, &weld_exact(&mesh.positions), class, classes, maps),
        passes: Passes::default(),
        rates,
        moves: true,
        optimizer: PositionOptimizer::default(),
        smoothness: PositionOptimizer::for_vertices(mesh.positions.len()),
        masks: Masks::Cut,
    }
}

/// A batch of pictures of waves.
fn shots(case: Case) -> Vec<Shot> {
    let Case { batch, size, per_axis, .. } = case;
    let sampling = Sampling { per_axis, shade_per_pixel: false };
    let views = Orbit::new(4, &Lighting::Mixed, size);
    let wave = |x: usize, y: usize, c: usize| {
        if c == 3 { 1.0 } else { 0.5 + 0.4 * ((x + 2 * y) as f32 / (7.0 + c as f32)).sin() }
    };
    (0..batch)
        .map(|i| {
            let setup = views.setup(Set::Train, i, 0);
            Shot::new(&setup, Image::from_fn(size, size, 4, wave), sampling, 1, i)
        })
        .collect()
}

/// Some steps, and the loss of the last.
fn steps_of(model: &mut impl Model, shots: &[Shot], count: usize) -> Result<f64> {
    let made = (0..count)
        .try_for_each(|_| model.step(shots, Loss::LogSrgbL1.into(), &RATES))
        .and_then(|()| model.losses());
    match made {
        Ok(losses) => Ok(losses.last().copied().unwrap_or(f64::NAN)),
        Err(e) => bail!("the step failed: {e:?}"),
    }
}

/// Steps on both, and the kernels of one.
fn steps(ctx: &mut Context, gpu: &Gpu, case: Case, bandwidth: f64) -> Result<()> {
    let (shots, surface, size) = (shots(case), surface(case), case.size);
    let name = case.to_string();
    let mut cpu = Cpu::new(surface.clone())?;
    let mut device = GpuSurface::new(gpu, surface, &shots)?;
    let began = Instant::now();
    let mut losses = [steps_of(&mut cpu, &shots, 1)?, 0.0];
    let long = began.elapsed().as_secs_f64() > 1.0;
    let began = Instant::now();
    losses[1] = steps_of(&mut device, &shots, 1)?;
    let in_flight = if began.elapsed().as_secs_f64() > 1.0 { 1 } else { IN_FLIGHT };
    let error = (losses[0] / losses[1] - 1.0).abs();
    let per_picture = |t: &Timing| 1e3 * t.median / case.batch as f64;
    let mut failed = None;
    let mut keep = |r: Result<f64>| failed = r.err().or(failed.take());
    let timing = if long {
        let began = Instant::now();
        keep(steps_of(&mut cpu, &shots, 1));
        Timing::of(vec![began.elapsed().as_secs_f64()])
    } else {
        crate::timing::time(|| keep(steps_of(&mut cpu, &shots, 1))).0
    };
    ctx.record(
        "step, CPU",
        &name,
        size,
        timing,
        vec![("error", 0.0), ("ms a picture", per_picture(&timing))],
    );
    let before = gpu.traffic();
    let mut made = 0;
    let (mut timing, ()) = crate::timing::time(|| {
        made += in_flight;
        keep(steps_of(&mut device, &shots, in_flight));
    });
    timing.median /= in_flight as f64;
    let uploaded = (gpu.traffic().uploaded - before.uploaded) as f64 / made.max(1) as f64;
    let figures = vec![
        ("error", error),
        ("ms a picture", per_picture(&timing)),
        ("kB uploaded", 1e-3 * uploaded),
        ("MB held", 1e-6 * gpu.held() as f64),
    ];
    ctx.record("step, device", &name, size, timing, figures);
    if let Some(e) = failed {
        return Err(e);
    }
    let kernels = device.report_step()?;
    if size >= 128 {
        ctx.note(table(&kernels, &name, bandwidth));
    }
    Ok(())
}

/// The work of kernels, those that take longest first.
fn table(kernels: &[KernelReport], case: &str, bandwidth: f64) -> String {
    let mut kernels: Vec<&KernelReport> = kernels.iter().collect();
    let ms = |k: &KernelReport| k.milliseconds.unwrap_or(0.0);
    kernels.sort_by(|a, b| ms(b).total_cmp(&ms(a)).then(b.invocations.cmp(&a.invocations)));
    let all = kernels.iter().map(|k| ms(k)).sum::<f64>();
    let mut text = format!(
        "Kernels of a step of {case}, {:.2} ms by the device's clock (0: it has none); bytes are those of the \
         buffers that they bind, and the bandwidth is these bytes over the time, as a share of a copy's. Kernels below a \
         hundredth of the time are summed up in the last row.\n\n\
         | kernel | dispatches | invocations | counted on the device | MB bound | ms | share | bandwidth |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|\n",
        all
    );
    let mut row = |name: &str, of: &[&KernelReport]| {
        let sum = |f: &dyn Fn(&KernelReport) -> f64| of.iter().map(|k| f(k)).sum::<f64>();
        let time = sum(&ms);
        let _ = writeln!(
            text,
            "| {name} | {} | {} | {} | {:.2} | {time:.3} | {:.0}% | {:.0}% |",
            sum(&|k| k.dispatches as f64),
            sum(&|k| k.invocations as f64),
            sum(&|k| k.indirect as f64),
            1e-6 * sum(&|k| k.bytes as f64),
            100.0 * time / all.max(1e-12),
            100e-6 * sum(&|k| k.bytes as f64) / (time * bandwidth).max(1e-12)
        );
    };
    let (large, small): (Vec<_>, Vec<_>) = kernels.into_iter().partition(|k| ms(k) >= 0.01 * all);
    large.iter().for_each(|k| row(k.kernel, &[k]));
    row("all others", &small);
    text
}

/// An asset of 20,000 triangles with colours at its vertices.
fn asset() -> Scene {
    let mut mesh = shapes::displaced_sphere(32, 0.25, 4, 3);
    let stripe = |p: &photofit_scalar::Vec3f| 0.5 + 0.4 * (9.0 * p.y + 3.0 * p.x).sin();
    mesh.colors = mesh.positions.iter().map(|p| vec4(stripe(p), 0.4, 1.0 - stripe(p), 1.0)).collect();
    Scene {
        name: "rock".into(),
        primitives: vec![Primitive { mesh, material: 0 }],
        instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
        materials: vec![Material { name: "stone".into(), ..Material::clay() }],
        ..Scene::default()
    }
}

/// Whole fits of several lengths on both.
fn whole(ctx: &mut Context, gpu: &Gpu, hardware: bool) -> Result<()> {
    let (folder, asset) = (tempfile::tempdir()?, asset());
    let ([triangles, resolution, texture_size], lengths) =
        if hardware { ([2000, 512, 1024], [50, 200, 800]) } else { ([600, 128, 256], [20, 60, 180]) };
    for steps in lengths {
        for (name, device) in
            [("fit, CPU", Device::cpu("")), ("fit, device", Device::gpu(gpu.clone(), true, ""))]
        {
            let options = SimplifyOptions {
                target: Target::Triangles(triangles),
                resolution,
                texture_size,
                steps,
                report_views: 8,
                own_textures: false,
                device,
                ..SimplifyOptions::default()
            };
            let began = Instant::now();
            let outcome = simplify(&asset, &folder.path().join("light.glb"), &options, &Silent)?;
            let seconds = began.elapsed().as_secs_f64();
            let Some(q) = outcome.shipped() else { bail!("the fit was not judged") };
            let figures = vec![("error", q.flip), ("PSNR dB", q.psnr)];
            ctx.record(name, &format!("{steps} steps"), steps as usize, Timing::of(vec![seconds]), figures);
        }
    }
    Ok(())
}

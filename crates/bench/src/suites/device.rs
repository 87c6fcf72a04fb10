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
use photofit_gpu::{Choice, Gpu, KernelReport};
use photofit_image::Image;
use photofit_raster::deferred::{Masks, Passes};
use photofit_raster::loss::Loss;
use photofit_raster::{CHANNELS, Maps, channel};
use photofit_scalar::vec4;
use photofit_scene::{AlphaMode, Instance, Material, Primitive, Scene};
use photofit_shading::Sides;
use std::fmt::Write as _;
use std::time::Instant;

/// Pictures of a step, as in the main job.
const BATCH: u64 = 2;
/// Texels along a side of the maps.
const TEXELS: usize = 512;
/// Rates of positions and maps.
const RATES: [f64; 2] = [0.001, 0.01];

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let choice = std::env::var("PHOTOFIT_DEVICE").map_or(Choice::Any, Choice::Named);
    let gpu = match Gpu::new(&choice) {
        Ok(gpu) => gpu,
        Err(e) => {
            bail!("{e}; a driver is needed (`apt-get install mesa-vulkan-drivers` has one in software)")
        }
    };
    let report = gpu.report();
    ctx.note(format!(
        "Device: {}, {}. Steps of {BATCH} pictures of 2 x 2 samples a pixel, maps of {TEXELS} x {TEXELS} texels, one \
         submission each; the time of a step on the device includes waiting for its loss. Errors: the difference of the \
         losses of the first step, relative; of whole fits the FLIP of the written file in unseen views.",
        report.name, report.backend
    ));
    let surface = surface();
    for size in [64, 128, 256] {
        steps(ctx, &gpu, &surface, size)?;
    }
    whole(ctx, &gpu)
}

/// A body of 1,620 triangles with maps.
fn surface() -> Surface {
    let mesh = shapes::displaced_sphere(9, 0.2, 3, 5);
    let class = vec![0; mesh.triangles.len()];
    let options = UnwrapOptions { size: TEXELS as u32, ..UnwrapOptions::default() };
    let atlas = unwrap(&mesh.positions, &mesh.triangles, &class, &options).expect("a body has an atlas");
    let (mesh, _) = atlas.build_mesh(&mesh.positions, &mesh.triangles);
    let mut texel = [0.0; CHANNELS];
    texel[..channel::USED].fill(0.5);
    (texel[channel::NORMAL], texel[channel::NORMAL + 1], texel[channel::NORMAL + 2]) = (0.0, 0.0, 1.0);
    let maps = Maps { width: TEXELS, height: TEXELS, texels: vec![texel; TEXELS * TEXELS] };
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
fn shots(size: usize) -> Vec<Shot> {
    let views = Orbit::new(4, &Lighting::Mixed, size);
    let wave = |x: usize, y: usize, c: usize| {
        if c == 3 { 1.0 } else { 0.5 + 0.4 * ((x + 2 * y) as f32 / (7.0 + c as f32)).sin() }
    };
    (0..BATCH)
        .map(|i| {
            let setup = views.setup(Set::Train, i, 0);
            Shot::new(&setup, Image::from_fn(size, size, 4, wave), Sampling::SUPERSAMPLED, 1, i)
        })
        .collect()
}

/// A step, and its loss.
fn step_of(model: &mut impl Model, shots: &[Shot]) -> Result<f64> {
    let made = model.step(shots, Loss::LogSrgbL1.into(), &RATES).and_then(|()| model.losses());
    match made {
        Ok(losses) => Ok(losses.last().copied().unwrap_or(f64::NAN)),
        Err(e) => bail!("the step failed: {e:?}"),
    }
}

/// Steps on both, and the kernels of one.
fn steps(ctx: &mut Context, gpu: &Gpu, surface: &Surface, size: usize) -> Result<()> {
    let (shots, case) = (shots(size), format!("{size} x {size}"));
    let mut cpu = Cpu::new(surface.clone())?;
    let mut device = GpuSurface::new(gpu, surface.clone(), &shots)?;
    let mut on_cpu = || step_of(&mut cpu, &shots);
    let mut on_device = || step_of(&mut device, &shots);
    let first = [on_cpu()?, on_device()?];
    let error = (first[0] / first[1] - 1.0).abs();
    let mut failed = None;
    let mut keep = |r: Result<f64>| failed = r.err().or(failed.take());
    ctx.measure("step, CPU", &case, size, || keep(on_cpu()), |()| vec![("error", 0.0)]);
    let before = gpu.traffic();
    let mut made = 0_u32;
    let work = || {
        made += 1;
        keep(on_device());
    };
    let uploaded = |made: u32| (gpu.traffic().uploaded - before.uploaded) as f64 / f64::from(made.max(1));
    let (timing, ()) = crate::timing::time(work);
    let held = 1e-6 * gpu.held() as f64;
    let figures = vec![("error", error), ("kB uploaded", 1e-3 * uploaded(made)), ("MB held", held)];
    ctx.record("step, device", &case, size, timing, figures);
    if let Some(e) = failed {
        return Err(e);
    }
    let kernels = device.report_step()?;
    if size == 128 {
        ctx.note(table(&kernels, &case));
    }
    Ok(())
}

/// The work of kernels, those that take longest first.
fn table(kernels: &[KernelReport], case: &str) -> String {
    let mut kernels: Vec<&KernelReport> = kernels.iter().collect();
    let ms = |k: &KernelReport| k.milliseconds.unwrap_or(0.0);
    kernels.sort_by(|a, b| ms(b).total_cmp(&ms(a)).then(b.invocations.cmp(&a.invocations)));
    let all = kernels.iter().map(|k| ms(k)).sum::<f64>();
    let mut text = format!(
        "Kernels of a step of {case} pixels, {:.1} ms by the device's clock (0: it has none); bytes are those of the \
         buffers that they bind. Kernels below a hundredth of the time are summed up in the last row.\n\n\
         | kernel | dispatches | invocations | counted on the device | MB bound | ms | share |\n\
         |---|---:|---:|---:|---:|---:|---:|\n",
        all
    );
    let mut row = |name: &str, of: &[&KernelReport]| {
        let sum = |f: &dyn Fn(&KernelReport) -> f64| of.iter().map(|k| f(k)).sum::<f64>();
        let time = sum(&ms);
        let _ = writeln!(
            text,
            "| {name} | {} | {} | {} | {:.2} | {time:.2} | {:.0}% |",
            sum(&|k| k.dispatches as f64),
            sum(&|k| k.invocations as f64),
            sum(&|k| k.indirect as f64),
            1e-6 * sum(&|k| k.bytes as f64),
            100.0 * time / all.max(1e-12)
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
fn whole(ctx: &mut Context, gpu: &Gpu) -> Result<()> {
    let (folder, asset) = (tempfile::tempdir()?, asset());
    for steps in [20, 60, 180] {
        for (name, device) in
            [("fit, CPU", Device::cpu("")), ("fit, device", Device::gpu(gpu.clone(), true, ""))]
        {
            let options = SimplifyOptions {
                target: Target::Triangles(600),
                resolution: 128,
                texture_size: 256,
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

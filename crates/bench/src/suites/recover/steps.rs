//! One step of a recovery (picture, gradient of the loss, Adam, values set in the world): the variance of its gradient and its
//! time, by samples of the picture and of the gradient. The scenes are written for other programs, too.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result};
use glam::DVec3;
use photofit_image::{Image, write_exr};
use photofit_optim::{Optimizer, Temporal};
use photofit_pathtrace::{
    Adjoint, GradientSamples, MediumRef, MediumValue, Parameter, Parts, RenderOptions, View, World,
};
use photofit_sampling::hash;
use photofit_scene::mitsuba::{MitsubaOptions, encode_grid, load_mitsuba};

use super::plate::Plate;
use super::{cloud, compare, picture, plate};
use crate::context::Context;
use crate::timing::Timing;

/// Samples of the picture of a step and of its gradient.
const SAMPLES: [[u32; 2]; 9] = [[16, 1], [8, 1], [4, 1], [2, 1], [1, 1], [2, 2], [4, 2], [4, 4], [8, 4]];
/// Steps of which variances and times are told, and one before them that is not counted.
const STEPS: u64 = 12;
/// Samples per pixel of the picture that values are fitted to.
const TARGET_SPP: u32 = 512;
/// Where scenes, the target and its weights are written.
const FOLDER: &str = "out/bench/recover-steps";
/// How far the values are from the start (0) to the truth (1).
const STATES: [(&str, f32); 2] = [("start", 0.0), ("halfway", 0.5)];

/// Values to be found, as both programs hold them.
struct Values {
    name: &'static str,
    /// What its row calls their variance.
    figure: &'static str,
    parameter: Parameter,
    channels: usize,
    start: Vec<f32>,
    truth: Vec<f32>,
}

struct Scene {
    name: &'static str,
    text: String,
    sky: Image,
    max_depth: u32,
    values: Vec<Values>,
    /// Writes the values `[k]` of a state to a file, whose name it returns.
    write: fn(&Values, &str, &[f32]) -> Result<String>,
}

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    fs::create_dir_all(FOLDER).with_context(|| format!("{FOLDER}: cannot create"))?;
    for scene in [plate_scene(), cloud_scene()] {
        let truth: Vec<Vec<f32>> = scene.values.iter().map(|v| v.truth.clone()).collect();
        let (world, view, options) = scene.load("truth", &truth)?;
        let target = RenderOptions { spp: TARGET_SPP, seed: 99, ..options };
        let target = picture(&world, &view, &target)?;
        save(&format!("{}_target", scene.name), &target)?;
        // The gradient where every value is 1 too high.
        let above = Image { data: target.data.iter().map(|v| v + 1.0).collect(), ..target.clone() };
        save(&format!("{}_weights", scene.name), &compare(&above, &target).1)?;
        for (state, share) in STATES {
            let between =
                |v: &Values| v.start.iter().zip(&v.truth).map(|(s, t)| s + share * (t - s)).collect();
            let values: Vec<Vec<f32>> = scene.values.iter().map(between).collect();
            for samples in SAMPLES {
                scene.measure(ctx, state, samples, &values, &target)?;
            }
        }
    }
    ctx.note(format!(
        "Medians of {STEPS} steps of Adam without filters. Variance: the sum over all values of the variance of the gradient of one step. The loss is that of the \
         suite `recover`, one picture of {TARGET_SPP} samples a pixel is fitted."
    ));
    Ok(())
}

fn save(name: &str, image: &Image) -> Result<()> {
    let image = Image::from_fn(image.width, image.height, 3, |x, y, c| image.pixel(x, y)[c]);
    Ok(write_exr(Path::new(FOLDER).join(format!("{name}.exr")), &[("", &image, &["R", "G", "B"])])?)
}

impl Scene {
    /// Writes the scene with these values and reads it.
    fn load(&self, state: &str, values: &[Vec<f32>]) -> Result<(World, View, RenderOptions)> {
        let mut text = self.text.clone();
        for (values, held) in values.iter().zip(&self.values) {
            let file = (self.write)(held, state, values)?;
            let ending = file.rsplit('.').next().unwrap_or_default();
            text = text.replace(&format!("{}.{ending}", held.name), &file);
        }
        save("sky", &self.sky)?;
        let file: PathBuf = Path::new(FOLDER).join(format!("{}_{state}.xml", self.name));
        fs::write(&file, text).with_context(|| format!("{}: cannot write", file.display()))?;
        let scene = load_mitsuba(&file, &MitsubaOptions::default())?;
        let (view, mut options) = (View::from_mitsuba(&scene.sensor), RenderOptions::from_mitsuba(&scene));
        options.path.max_depth = self.max_depth;
        Ok((World::new(Parts::from_mitsuba(scene))?, view, options))
    }

    /// Times steps from one state, and records the variance of their gradients.
    fn measure(
        &self,
        ctx: &mut Context,
        state: &str,
        [spp, gradient_spp]: [u32; 2],
        start: &[Vec<f32>],
        target: &Image,
    ) -> Result<()> {
        let (mut world, view, options) = self.load(state, start)?;
        let places: Vec<Parameter> = self.values.iter().map(|v| v.parameter.clone()).collect();
        let mut optimizers = self
            .values
            .iter()
            .map(|v| Optimizer::new(v.name, v.truth.len(), Temporal::adam()))
            .collect::<Result<Vec<Optimizer<f32>>, _>>()?;
        let mut seconds = Vec::new();
        // Means and sums of squared differences from them (Welford).
        let mut moments: Vec<[Vec<f64>; 2]> =
            start.iter().map(|v| [vec![0.0; v.len()], vec![0.0; v.len()]]).collect();
        for step in 0..=STEPS {
            let began = Instant::now();
            let options = RenderOptions { spp, seed: hash(1, 0, step), ..options.clone() };
            let (_, weights) = compare(&picture(&world, &view, &options)?, target);
            let samples = GradientSamples { spp: gradient_spp, seed: Some(hash(2, 0, step)) };
            let found = Adjoint::new(&world, &view, options, &places)?.render_vjp(&weights, samples)?;
            for ((held, optimizer), (one, values)) in
                self.values.iter().zip(&mut optimizers).zip(found.parameters.iter().zip(start))
            {
                let gradient: Vec<f32> =
                    one.first_channels(held.channels).iter().map(|g| *g as f32).collect();
                // Every step begins at the same values: the move costs what it costs in a recovery, and is taken back.
                let mut moved = values.clone();
                optimizer.step(&mut moved, &gradient, 1e-3)?;
                world.spread_parameter(&held.parameter, held.channels, values)?;
            }
            if step == 0 {
                continue;
            }
            seconds.push(began.elapsed().as_secs_f64());
            for (held, ([mean, squares], one)) in
                self.values.iter().zip(moments.iter_mut().zip(&found.parameters))
            {
                let entries = one.first_channels(held.channels);
                for ((m, s), v) in mean.iter_mut().zip(squares).zip(entries.iter()) {
                    let d = v - *m;
                    *m += d / step as f64;
                    *s += d * (v - *m);
                }
            }
        }
        let count = STEPS as f64;
        let variance = |s: &[f64]| s.iter().sum::<f64>() / (count - 1.0);
        let figures = self.values.iter().zip(&moments).map(|(v, [_, s])| (v.figure, variance(s))).collect();
        let (method, case) = (format!("{}, {state}", self.name), format!("{spp} + {gradient_spp} samples"));
        ctx.record(&method, &case, (spp + gradient_spp) as usize, Timing::of(seconds), figures);
        Ok(())
    }
}

fn plate_scene() -> Scene {
    let texels = plate::TEXELS * plate::TEXELS;
    let alpha = Values {
        name: "plate",
        figure: "variance",
        parameter: Parameter::Graph { places: vec![[0, 3], [0, 4]] },
        channels: 1,
        start: (0..texels).map(|i| plate::start(Plate::Judged, i)).collect(),
        truth: (0..texels)
            .map(|i| plate::alpha(Plate::Judged, i % plate::TEXELS, i / plate::TEXELS))
            .collect(),
    };
    Scene {
        name: "plate",
        text: plate::SCENE.replace("{PIXELS}", &plate::PIXELS.to_string()),
        sky: plate::sky(),
        max_depth: 3,
        values: vec![alpha],
        write: |held, state, values| {
            let image =
                Image { width: plate::TEXELS, height: plate::TEXELS, channels: 1, data: values.to_vec() };
            let file = format!("{}_{state}_values.exr", held.name);
            write_exr(Path::new(FOLDER).join(&file), &[("", &image, &["Y"])])?;
            Ok(file)
        },
    }
}

fn cloud_scene() -> Scene {
    let (mut density, albedo) = cloud::cloud();
    let voxels = density.len();
    // Mitsuba's derivatives are wrong where density is 0 or its upper bound: one corner alone holds that.
    density.iter_mut().for_each(|d| *d = d.max(0.002));
    let mut thin = vec![0.002; voxels];
    (thin[0], density[0]) = (0.01, 1.2);
    let of = |name, figure, value, channels, start, truth| {
        let parameter = Parameter::Medium { medium: MediumRef::Bounded(0), value };
        Values { name, figure, parameter, channels, start, truth }
    };
    Scene {
        name: "cloud",
        text: include_str!("cloud.xml").replace("{PIXELS}", &cloud::PIXELS.to_string()),
        sky: plate::sky(),
        max_depth: 15,
        values: vec![
            of("density", "variance", MediumValue::Extinction, 1, thin, density),
            of("albedo", "variance of albedo", MediumValue::Albedo, 3, vec![0.6; 3 * voxels], albedo),
        ],
        write: |held, state, values| {
            let file = format!("{}_{state}.vol", held.name);
            let bytes = encode_grid([cloud::VOXELS; 3], values, [DVec3::ZERO, DVec3::ONE]);
            fs::write(Path::new(FOLDER).join(&file), bytes)
                .with_context(|| format!("{file}: cannot write"))?;
            Ok(file)
        },
    }
}

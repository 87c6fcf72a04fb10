//! Textures of many kinds by `recover scene`, by the smoothing of its steps: the default is to be good for all of them. The filter was chosen on other tiles, smooth noise and a mixed alpha
//! of this kind, and on the fields of the last floor; that it narrows, on the checks here, whose squares are narrower than it.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result};
use photofit_fit::Silent;
use photofit_fit::engine::traced::{Smoothing, Traced, TracedParameter};
use photofit_fit::recover_scene::{RecoverSceneOptions, recover_scene, relative_error};
use photofit_image::{Image, contact_sheet, write_png};
use photofit_pathtrace::{Parameter, Parts, RenderOptions, View, World};
use photofit_scene::mitsuba::{MitsubaOptions, load_mitsuba};

use super::{FOLDER, TARGET_SPP, plate};
use crate::context::Context;
use crate::timing::Timing;

/// Texels along the side of a texture, and pixels of its picture.
const TEXELS: usize = 256;
const PIXELS: usize = 128;
const STEPS: u64 = 100;
/// Samples of the picture of a step and of its gradient: those of `recover scene`.
const SAMPLES: [u32; 2] = [8, 4];
/// The ways, the rate of `recover scene` for all, and another one that suits Adam alone better.
const WAYS: [(Smoothing, Option<f64>); 5] = [
    (Smoothing::None, None),
    (Smoothing::None, Some(0.02)),
    (Smoothing::Laplacian, None),
    (Smoothing::Bilateral, None),
    (Smoothing::Narrowing, None),
];

/// A texture of a floor: a colour that scatters evenly, or the alpha of a metal.
struct Floor {
    name: &'static str,
    channels: usize,
    texel: fn(usize, usize, usize) -> f32,
}

const FLOORS: [Floor; 9] = [
    Floor { name: "colours, tiles", channels: 3, texel: |x, y, c| tile(x, y, 16, [0.75, 0.1], c) },
    Floor { name: "colours, checks", channels: 3, texel: |x, y, c| tile(x, y, 8, [0.75, 0.1], c) },
    Floor { name: "colours, patches", channels: 3, texel: |x, y, c| patch(x, y, c) },
    Floor { name: "colours, smooth", channels: 3, texel: |x, y, c| 0.5 + 0.4 * wave(x, y, 5, 31 + c as u64) },
    Floor {
        name: "colours, noise",
        channels: 3,
        texel: |x, y, c| 0.5 + 0.9 * wave(x, y, TEXELS as u32, 34 + 9 * c as u64),
    },
    Floor { name: "alpha, tiles", channels: 1, texel: |x, y, c| tile(x, y, 32, [0.6, 0.15], c) },
    Floor { name: "alpha, checks", channels: 1, texel: |x, y, c| tile(x, y, 8, [0.6, 0.15], c) },
    Floor { name: "alpha, smooth", channels: 1, texel: |x, y, _| 0.4 + 0.3 * wave(x, y, 6, 35) },
    Floor {
        name: "alpha, fields",
        channels: 1,
        texel: |x, y, _| {
            let by = plate::TEXELS / TEXELS;
            plate::alpha(plate::Plate::Other, x * by, y * by)
        },
    },
];

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    for floor in &FLOORS {
        let truth: Vec<f32> = (0..TEXELS * TEXELS * floor.channels)
            .map(|i| {
                let (c, site) = (i % floor.channels, i / floor.channels);
                (floor.texel)(site % TEXELS, site / TEXELS, c).clamp(0.02, 0.98)
            })
            .collect();
        let mut shown = vec![truth.clone()];
        for way in WAYS {
            shown.push(found(ctx, floor, way, &truth)?);
        }
        let picture = |v: &Vec<f32>| {
            Image::from_fn(TEXELS, TEXELS, 3, |x, y, c| {
                v[(y * TEXELS + x) * floor.channels + c % floor.channels]
            })
        };
        let images: Vec<Image> = shown.iter().map(picture).collect();
        let refs: Vec<&Image> = images.iter().collect();
        let name = floor.name.replace(", ", "-");
        write_png(format!("{FOLDER}/smoothing-{name}.png"), &contact_sheet(&refs, 1 + WAYS.len(), 4))?;
    }
    ctx.note(format!(
        "Textures of {TEXELS} x {TEXELS} texels from one picture of {PIXELS} x {PIXELS} pixels and a flat start of .5, at most {STEPS} steps (fewer where the picture stops improving) of {} and {} \
         samples: relative squared error of the picture, root mean square error of the texture. `{FOLDER}/smoothing-*.png` show the truth \
         and what each way finds, in this order.",
        SAMPLES[0], SAMPLES[1]
    ));
    Ok(())
}

/// What one way finds of a floor.
fn found(
    ctx: &mut Context,
    floor: &Floor,
    (smoothing, rate): (Smoothing, Option<f64>),
    truth: &[f32],
) -> Result<Vec<f32>> {
    let (mut model, view) = model(floor, truth)?;
    model.smoothing = smoothing;
    let target = model.picture(&view, TARGET_SPP, 99)?;
    model.replace(0, &vec![0.5; truth.len()])?;
    let default = RecoverSceneOptions::default();
    let options = RecoverSceneOptions { steps: STEPS, rate: rate.unwrap_or(default.rate), ..default };
    let began = Instant::now();
    let r = recover_scene(model, &[view], &[target], &options, &Silent)?;
    let each = began.elapsed().as_secs_f64() / r.steps.max(1) as f64;
    let best = r.history.iter().map(|h| h.quality).fold(f64::NEG_INFINITY, f64::max);
    let values = r.model.of(0).to_vec();
    let squares: f64 = values.iter().zip(truth).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    let error = (squares / truth.len() as f64).sqrt();
    let timing = Timing { median: each, spread: 0.0, runs: r.steps as usize };
    let figures = vec![("picture", relative_error(best)), ("texture", error)];
    let way = rate.map_or(smoothing.name().into(), |r| format!("{}, rate {r}", smoothing.name()));
    ctx.record(&way, floor.name, r.steps as usize, timing, figures);
    Ok(values)
}

/// A floor under the sky of the plate, with the texture that is to be found.
fn model(floor: &Floor, truth: &[f32]) -> Result<(Traced, View)> {
    let folder = Path::new(FOLDER);
    std::fs::create_dir_all(folder).with_context(|| format!("{FOLDER}: cannot create"))?;
    photofit_image::write_exr(folder.join("sky.exr"), &[("", &plate::sky(), &["R", "G", "B"])])?;
    let channels = floor.channels;
    let texels = Image::from_fn(TEXELS, TEXELS, channels, |x, y, c| truth[(y * TEXELS + x) * channels + c]);
    let names: &[&str] = if channels == 1 { &["Y"] } else { &["R", "G", "B"] };
    photofit_image::write_exr(folder.join("floor.exr"), &[("", &texels, names)])?;
    let mut scene = plate::SCENE.replace("plate.exr", "floor.exr").replace("{PIXELS}", &PIXELS.to_string());
    let mut places = vec![[0, 3], [0, 4]];
    if channels == 3 {
        let (before, rest) = scene.split_once("<bsdf").context("the plate has a material")?;
        let (_, after) = rest.split_once("</bsdf>").context("it ends")?;
        scene = format!("{before}{DIFFUSE}{after}");
        places = vec![[0, 0]];
    }
    let file = folder.join("floor.xml");
    std::fs::write(&file, scene).with_context(|| format!("{}: cannot write", file.display()))?;
    let scene = load_mitsuba(&file, &MitsubaOptions::default())?;
    let view = View::from_mitsuba(&scene.sensor);
    let world = World::new(Parts::from_mitsuba(scene))?;
    let mut options =
        RenderOptions { width: PIXELS, height: PIXELS, spp: SAMPLES[0], ..RenderOptions::default() };
    options.path.max_depth = 3;
    let parameter = TracedParameter {
        name: floor.name.into(),
        parameter: Parameter::Graph { places },
        shape: [1, TEXELS, TEXELS, channels],
        range: [0.001, 1.0],
    };
    let mut model = Traced::new(world, options, vec![parameter])?;
    model.gradient_spp = SAMPLES[1];
    Ok((model, view))
}

/// A material that scatters evenly, in place of the metal.
const DIFFUSE: &str = r#"<bsdf type="diffuse"><texture type="bitmap" name="reflectance">
    <string name="filename" value="floor.exr"/><boolean name="raw" value="true"/></texture></bsdf>"#;

/// Tiles of so many texels of two values, which are nearer to each other in the last channels.
fn tile(x: usize, y: usize, side: usize, values: [f32; 2], channel: usize) -> f32 {
    let which = (x / side + y / side) % 2;
    values[which] + 0.1 * channel as f32 * (which as f32 - 0.5)
}

/// Patches with hard edges and a grain.
fn patch(x: usize, y: usize, channel: usize) -> f32 {
    let ground = if wave(x, y, 6, 36) > 0.0 { 0.7 } else { 0.15 };
    ground + 0.1 * wave(x, y, 40, 37 + channel as u64)
}

/// Smooth noise of so many cells in -1..=1.
fn wave(x: usize, y: usize, cells: u32, seed: u64) -> f32 {
    let at = |i: usize| (i as f32 + 0.5) / TEXELS as f32;
    plate::noise(at(x), at(y), cells, seed)
}

//! The roughness (GGX alpha) of a metal plate under an environment, from one picture.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use photofit_image::Image;
use photofit_optim::{Bilateral, Grid, GuideMap, Placement, Sigma};
use photofit_pathtrace::{Parameter, Parts, RenderOptions, View, World};
use photofit_scene::mitsuba::{MitsubaOptions, load_mitsuba};

use super::{FOLDER, Method, TARGET_SPP, Task, Unknown, best, picture, plot, race, sheet};
use crate::context::Context;

/// Texels along the side of the plate, and pixels of its picture.
pub(super) const TEXELS: usize = 512;
pub(super) const PIXELS: usize = 256;

/// What is to be found.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Plate {
    /// What tables are made of.
    Judged,
    /// Of other noise, and turned: settings are chosen on it.
    Other,
}

/// Alpha that all runs start from, texel by texel: nearly a mirror, as in the paper.
pub(super) fn start(plate: Plate, texel: usize) -> f32 {
    let seed = if plate == Plate::Judged { 7 } else { 8 };
    let bits = photofit_sampling::hash(seed, texel as u64, 0);
    0.02 + 0.2 * photofit_sampling::unit_f32((bits >> 32) as u32)
}

/// Steps of a run, and those at which it is looked at.
const LOOKS: [u64; 6] = [5, 10, 20, 33, 50, 100];
/// Those of a run of a third of the steps.
const SHORT_LOOKS: [u64; 4] = [5, 10, 20, 33];

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let [short_adam, short_bilateral] = in_a_third(ctx)?;
    let mut task = task(Plate::Judged)?;
    let cross = bilateral("bilateral", 0.1, four_levels(Sigma::Fixed(0.1)));
    let own = bilateral("bilateral, automatic width", 0.05, four_levels(Sigma::Auto(2.0)));
    // In a third of the steps.
    let short =
        [short_adam, short_bilateral.clone(), cross.clone(), cross.falling(), own.falling().narrowing()];
    let short = short.map(|m| Method { name: format!("{}, in a third", m.name), ..m });
    race(ctx, &mut task, &short, &SHORT_LOOKS)?;
    let mut adams = Vec::new();
    for rate in [0.001, 0.01, 0.05] {
        adams.extend([0.2, 0.5, 0.9].map(|b1| Method::adam(rate, b1).paired()));
    }
    adams.push(Method::adam(0.01, 0.9));
    adams.extend([0.01, 0.03].map(|rate| Method::adam(rate, 0.9).falling()));
    let last = &LOOKS[LOOKS.len() - 1..];
    let adam = best(&adams, &race(ctx, &mut task, &adams, last)?).clone();
    let before = Method::low_pass(0.02).falling();
    let after =
        Method::filtered("low-pass of moments", 0.1, Bilateral::low_pass(3), Placement::POST).paired();
    let low = [before.narrowing(), after.clone(), after.falling(), after.falling().narrowing()];
    let low = best(&low, &race(ctx, &mut task, &low, last)?).clone();
    let of = |name: &str, placement| Method {
        filter: cross.filter.map(|f| (f.0, placement)),
        ..cross.named(name)
    };
    let methods = [
        adam,
        low,
        Method::plain(0.1).paired(),
        cross.clone(),
        cross.falling(),
        cross.falling().narrowing(),
        short_bilateral,
        own.falling().narrowing(),
        of("bilateral of gradients alone", Placement::PRE),
        of("bilateral of gradients and moments", Placement::BOTH),
        Method { betas: [0.2, 0.999], ..cross.named("bilateral, b2 .999") },
        Method { betas: [0.0, 0.0], ..cross.named("bilateral, no memory") },
    ];
    let courses = race(ctx, &mut task, &methods, &LOOKS)?;
    plot(ctx, &task, &methods, &courses)?;
    let ends = task.ends()?;
    sheet(&task, &courses, 0, |v| Image::from_fn(TEXELS, TEXELS, 3, |x, y, _| v[y * TEXELS + x]))?;
    let goal = courses[0].loss();
    let mut text = format!(
        "{}: {TEXELS} x {TEXELS} texels from one picture of {PIXELS} x {PIXELS} pixels, 16 samples a pixel and 1 for \
         gradients; Adam and the low-pass filter are the best of the runs above them by the last loss; of the runs in a third of the steps \
         the first two are the best of their kind on another plate. Steps until the loss is below Adam's last one:",
        task.name
    );
    for (method, course) in methods.iter().zip(&courses).skip(1) {
        let step = course.looks.iter().find(|l| l.loss <= goal).map(|l| l.step.to_string());
        let _ = write!(text, " {} {};", method.name, step.unwrap_or_else(|| "never".into()));
    }
    ctx.note(format!("{ends} {text}"));
    Ok(())
}

/// The paper's filter of moments, with decays that belong to each other.
fn bilateral(name: &str, rate: f64, filter: Bilateral) -> Method {
    Method::filtered(name, rate, filter, Placement::POST).paired()
}

/// The levels of the paper's filter: it counts five, and the first of its code has a stride of 0 and passes all on.
fn four_levels(sigma: Sigma) -> Bilateral {
    Bilateral { levels: 4, sigma, map: GuideMap::Log, ..Bilateral::default() }
}

/// Adam and the bilateral filter for a third of the steps: of so many settings, all with rates that fall, those with the lowest
/// loss on the other plate. Levels and decays of the filter are those of the paper.
fn in_a_third(ctx: &mut Context) -> Result<[Method; 2]> {
    let mut other = task(Plate::Other)?;
    let (mut adams, mut filters) = (Vec::new(), Vec::new());
    for rate in [0.03, 0.05, 0.1] {
        adams.extend([Method::adam(rate, 0.2).paired(), Method::adam(rate, 0.9)].map(|m| m.falling()));
    }
    for rate in [0.1, 0.2] {
        for width in [0.1, 0.2, 0.4] {
            let name = format!("bilateral, rate {rate}, width {width}");
            filters.push(bilateral(&name, rate, four_levels(Sigma::Fixed(width))).falling());
        }
    }
    let mut chosen = |methods: &[Method]| -> Result<Method> {
        let courses = race(ctx, &mut other, methods, &SHORT_LOOKS[3..])?;
        Ok(best(methods, &courses).clone())
    };
    Ok([chosen(&adams)?, chosen(&filters)?])
}

/// Smooth noise in -1..=1 of so many cells.
pub(super) fn noise(x: f32, y: f32, cells: u32, seed: u64) -> f32 {
    let (x, y) = (x * cells as f32, y * cells as f32);
    let at = |i: u32, j: u32| {
        let bits = photofit_sampling::hash(seed, u64::from(i % cells), u64::from(j % cells));
        2.0 * photofit_sampling::unit_f32((bits >> 32) as u32) - 1.0
    };
    let (i, j) = (x as u32, y as u32);
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    let (u, v) = (smooth(x.fract()), smooth(y.fract()));
    let row = |j: u32| at(i, j) * (1.0 - u) + at(i + 1, j) * u;
    row(j) * (1.0 - v) + row(j + 1) * v
}

/// Alpha (GGX): fields of a board with noise, a disk and thin lines.
pub(super) fn alpha(plate: Plate, x: usize, y: usize) -> f32 {
    let (mut u, mut v) = ((x as f32 + 0.5) / TEXELS as f32, (y as f32 + 0.5) / TEXELS as f32);
    let [wide, fine] = if plate == Plate::Judged { [13, 14] } else { [23, 24] };
    let mut r = 0.42 + 0.17 * noise(u, v, 6, wide) + 0.06 * noise(u, v, 24, fine);
    if plate == Plate::Other {
        (u, v) = (0.6 + 0.8 * u - 0.6 * v, 0.6 * u + 0.8 * v);
    }
    if ((u * 8.0) as u32 + (v * 8.0) as u32) % 2 == 1 {
        r *= 0.55;
    }
    if (u - 0.5).hypot(v - 0.5) < 0.18 {
        r = 0.75;
    }
    let line = |t: f32| ((t * 16.0).fract() - 0.5).abs() < 0.04;
    if line(u) || line(v) {
        r = 0.12;
    }
    r.clamp(0.08, 0.95).powi(2)
}

/// A sky with windows of light.
pub(super) fn sky() -> Image {
    Image::from_fn(128, 64, 3, |x, y, c| {
        let height = 1.0 - y as f32 / 32.0;
        let ground = [0.12, 0.1, 0.08][c];
        let air = [0.3, 0.4, 0.55][c] * (0.4 + 0.6 * height.max(0.0));
        let lamp = (6..14).contains(&y) && x % 32 < 8 || (16..22).contains(&y) && (x + 16) % 40 < 5;
        if lamp {
            [9.0, 8.0, 6.5][c]
        } else if height > 0.0 {
            air
        } else {
            ground
        }
    })
}

/// Writes the scene with the alpha that is to be found as a Mitsuba file.
fn file(plate: Plate) -> Result<PathBuf> {
    let folder = Path::new(FOLDER);
    std::fs::create_dir_all(folder).with_context(|| format!("{FOLDER}: cannot create"))?;
    photofit_image::write_exr(folder.join("sky.exr"), &[("", &sky(), &["R", "G", "B"])])?;
    let name = if plate == Plate::Judged { "plate" } else { "other_plate" };
    let texels = Image::from_fn(TEXELS, TEXELS, 1, |x, y, _| alpha(plate, x, y));
    photofit_image::write_exr(folder.join(format!("{name}.exr")), &[("", &texels, &["Y"])])?;
    let file = folder.join(format!("{name}.xml"));
    std::fs::write(&file, scene(name)).with_context(|| format!("{}: cannot write", file.display()))?;
    Ok(file)
}

/// The scene, with `plate.exr` for the alpha and `{PIXELS}` for the side of its picture; the drivers of peers read it, too.
pub(super) const SCENE: &str = include_str!("plate.xml");

fn scene(name: &str) -> String {
    SCENE.replace("plate.exr", &format!("{name}.exr")).replace("{PIXELS}", &PIXELS.to_string())
}

fn task(plate: Plate) -> Result<Task> {
    let scene = load_mitsuba(&file(plate)?, &MitsubaOptions::default())?;
    let view = View::from_mitsuba(&scene.sensor);
    let world = World::new(Parts::from_mitsuba(scene))?;
    // Of the textures of a metal those after index of refraction, extinction and colour.
    let parameter = Parameter::Graph { places: vec![[0, 3], [0, 4]] };
    let held = world.parameter(&parameter)?;
    let truth: Vec<f32> = held.chunks_exact(held.len() / (TEXELS * TEXELS)).map(|v| v[0]).collect();
    let mut options = RenderOptions { width: PIXELS, height: PIXELS, spp: 16, ..RenderOptions::default() };
    options.path.max_depth = 3;
    let target = RenderOptions { spp: TARGET_SPP, seed: 99, ..options.clone() };
    let target = picture(&world, &view, &target)?;
    let unknown = Unknown {
        name: "alpha error",
        parameter,
        grid: Grid::plane(TEXELS, TEXELS),
        channels: 1,
        range: [0.001, 1.0],
        start: (0..truth.len()).map(|i| start(plate, i)).collect(),
        counts: vec![true; truth.len()],
        truth,
        rate: 1.0,
    };
    Ok(Task {
        name: if plate == Plate::Judged { "plate" } else { "other plate" },
        world,
        options,
        gradient_spp: 1,
        unknowns: vec![unknown],
        views: vec![(view, target)],
        batch: 1,
        held_out: Vec::new(),
        half_life: None,
    })
}

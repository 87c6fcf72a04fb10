//! Maps of a light asset fitted through the path tracer, so that shadows and light between surfaces are as in the heavy
//! asset: what the light shape casts itself stays out of its maps, and what its lost crevices cast goes into them.
//!
//! Base colour, roughness and metalness are fitted, on the texture coordinates that the light asset has; its shape,
//! normals, alpha and emission stay. Only pixels that both assets cover whole are compared.

use crate::engine::Normalised;
use crate::engine::cpu::Cpu;
use crate::engine::export::atlas_slot;
use crate::engine::fingerprint::Fingerprint;
use crate::engine::loss::{self, PictureLoss};
use crate::engine::plan::{Item, PlanRows, rows};
use crate::engine::reference::{self, ENERGY, MaterialFeatures, PathTraced, SAMPLES};
use crate::engine::traced::{ComparedPixels, Smoothing, Traced, TracedParameter, WHOLE, filters};
use crate::engine::trainer::{
    Batch, Checkpointing, HELD_OUT, HeldOut, HistoryPoint, Job, Measure, Phase, train,
};
use crate::engine::views::{Lighting, Orbit, Sampling};
use crate::progress::AsStage;
use crate::{FitError, Progress};
use photofit_image::linear_to_srgb_u8;
use photofit_pathtrace::{Parameter, PathOptions, RenderOptions, World};
use photofit_scene::{MapKind, Scene, TextureImage};

/// Least reflectance: what is black sends no light that could tell that it should be brighter.
const FAINT: f32 = 1e-4;

/// Texels along the side of a pixel's square from which textures move by corrections.
const MANY: usize = 4;
/// How the steps of maps are smoothed: the filter stays as wide as it is, for maps begin near what they end as.
const SMOOTHING: Smoothing = Smoothing::Bilateral;

/// Options of [`traced_maps`].
#[derive(Clone, Debug)]
pub struct TracedMapsOptions {
    /// Steps of the fit; 0 leaves the maps alone.
    pub steps: u64,
    /// Peak rate of the optimizer, 0 to 1.
    pub rate: f64,
    /// Width and height of the pictures, pixels.
    pub size: usize,
    /// Pictures of a step.
    pub batch: usize,
    /// Samples per pixel of the pictures of a step.
    pub spp: u32,
    /// Samples per pixel of their gradients.
    pub gradient_spp: u32,
    /// Samples per pixel of the pictures of the heavy asset, and of evaluations.
    pub reference_spp: u32,
    /// Width and height of a map of base colour for materials that have none, which is white times their factor; `None`:
    /// they stay without. Their texture coordinates must give each point of the surface a place of its own.
    pub new_map: Option<usize>,
    /// Where the light comes from.
    pub lighting: Lighting,
    /// Seed of all draws.
    pub seed: u64,
    /// Checkpoints and limits.
    pub checkpointing: Checkpointing,
}

impl Default for TracedMapsOptions {
    fn default() -> Self {
        Self {
            steps: 150,
            rate: 0.02,
            size: 192,
            batch: 2,
            spp: 16,
            gradient_spp: 4,
            reference_spp: SAMPLES,
            new_map: None,
            lighting: Lighting::default(),
            seed: 0,
            checkpointing: Checkpointing::default(),
        }
    }
}

/// What was made.
#[derive(Debug)]
pub struct TracedMaps {
    /// The light asset with the maps of the best evaluation.
    pub light: Scene,
    /// How it went.
    pub course: MapsCourse,
}

/// How a fit of maps through the path tracer went.
#[derive(Clone, Debug)]
pub struct MapsCourse {
    /// The course of the fit; evaluations are PSNR of held-out views as a screen shows them, dB, in which pixels that are
    /// not compared count as equal.
    pub history: Vec<HistoryPoint>,
    /// Steps made.
    pub steps: u64,
    /// Ended by the user or the time limit.
    pub stopped: bool,
    /// What ran and what was skipped.
    pub plan: PlanRows,
}

impl MapsCourse {
    /// Whether any evaluation was better than that of the start.
    pub fn gained(&self) -> bool {
        let start = self.history.first().map_or(f64::INFINITY, |h| h.quality);
        self.history.iter().any(|h| h.quality > start)
    }
}

/// A map that is fitted.
pub(crate) struct Map {
    kind: MapKind,
    texture: usize,
    /// Index of its image; maps of other encodings or of materials of another alpha mode may share it.
    pub(crate) image: usize,
}

/// Fits the maps of `light`, which stands where `scene` does, so that it looks like `scene` to a path tracer.
///
/// # Errors
/// See [`FitError`]: no map to fit, a scene that the path tracer refuses, options out of range.
pub fn traced_maps(
    scene: &Scene,
    n: &Normalised,
    light: &Scene,
    options: &TracedMapsOptions,
    progress: &dyn Progress,
) -> Result<TracedMaps, FitError> {
    options.check()?;
    let mut light = light.clone();
    if let Some(size) = options.new_map {
        add_maps(&mut light, size);
    }
    let world = reference::world(&MaterialFeatures::Core.of(&light), n.frame(), ENERGY)?;
    let mut maps = maps(&light, &world);
    maps.retain(|m| m.kind != MapKind::Normal);
    if maps.is_empty() {
        return Err(FitError::Setting {
            field: "light asset",
            rule: "has no map of base colour, roughness or metalness; one is needed".into(),
        });
    }
    let parameters = maps.iter().map(|m| m.parameter(&light)).collect();
    let mut model = model(world, parameters, options)?;
    model.not_finite = n.not_finite.clone();
    for (k, map) in maps.iter().enumerate() {
        let image = &light.images[map.image];
        let side = image.width.max(image.height).div_ceil(options.size).next_power_of_two();
        if side >= MANY {
            model.correct(k, side, map.kind == MapKind::BaseColor);
        }
    }
    let starts: Vec<Vec<f32>> = (0..maps.len()).map(|k| model.within(k)).collect();
    let target =
        PathTraced::new(scene, n, MaterialFeatures::Core, options.seed)?.sampled(options.reference_spp);
    let views = Orbit::new(options.seed, &options.lighting, options.size);
    let sampling = Sampling::SUPERSAMPLED;
    let held_out = HeldOut::new(&target, &views, sampling, HELD_OUT, options.seed)?;
    if !held_out.shots().iter().any(|s| s.shown.data.chunks_exact(4).any(|p| p[3] >= WHOLE)) {
        let rule = "covers no pixel whole in the held-out views, so that nothing can be compared".into();
        return Err(FitError::Setting { field: "asset", rule });
    }
    let rates = model.parameters.iter().map(|p| (p.name.clone().into(), options.rate)).collect();
    let (steps, fade, reinitialised) = (options.steps, None, None);
    let phase = Phase { name: "maps", first: 0, steps, shrink: 1, rates, fade, reinitialised };
    let phases = vec![phase];
    let fewer = f64::from(options.reference_spp) / f64::from(options.spp);
    let loss = loss::choose_for_noisy(&held_out, fewer.sqrt());
    let plan = PlanRows::new(Vec::new(), &phases);
    let job = Job {
        reference: &target,
        views: &views,
        held_out: &held_out,
        sampling,
        loss,
        seed: options.seed,
        batch: Batch::half_new(options.batch),
        steps: options.steps,
        rival: None,
        checkpointing: &options.checkpointing,
        fingerprint: fingerprint(options, &light),
    };
    // It may follow another fit.
    let as_maps = AsStage { progress, stage: "maps", note: |_, note| note };
    let trained = train(Cpu::new(model)?, &job, |_| phases, &as_maps)?;
    let mut moved: Vec<Vec<f32>> = vec![Vec::new(); light.images.len()];
    for (k, map) in maps.iter().enumerate() {
        map.write(&starts[k], trained.model.of(k), &mut light.images[map.image], &mut moved[map.image]);
    }
    let stopped = trained.stopped || progress.is_cancelled();
    let items = items(&maps, &trained.model, trained.steps > 0, loss, held_out.noise);
    let plan = PlanRows { items, ..plan }.ended(trained.reached());
    let course = MapsCourse { history: trained.history, steps: trained.steps, stopped, plan };
    Ok(TracedMaps { light, course })
}

impl TracedMapsOptions {
    fn check(&self) -> Result<(), FitError> {
        let spp = 1..=65536;
        crate::error::in_ranges([
            ("size", self.size, 16..=4096),
            ("batch", self.batch, 1..=64),
            ("spp", self.spp as usize, spp.clone()),
            ("gradient_spp", self.gradient_spp as usize, spp.clone()),
            ("reference_spp", self.reference_spp as usize, spp),
            ("new_map", self.new_map.unwrap_or(16), 16..=8192),
        ])?;
        if self.rate > 0.0 && self.rate <= 1.0 {
            return Ok(());
        }
        let rule = format!("is {}; it must be above 0 and at most 1", self.rate);
        Err(FitError::Setting { field: "rate", rule })
    }
}

fn model(
    world: World,
    parameters: Vec<TracedParameter>,
    options: &TracedMapsOptions,
) -> Result<Traced, FitError> {
    let rendering = RenderOptions {
        width: options.size,
        height: options.size,
        spp: options.spp,
        seed: options.seed,
        path: PathOptions { show_environment: false, ..PathOptions::default() },
        ..RenderOptions::default()
    };
    let mut model = Traced::new(world, rendering, parameters)?;
    model.smoothing = SMOOTHING;
    (model.gradient_spp, model.evaluation_spp) = (options.gradient_spp, options.reference_spp);
    model.compared = ComparedPixels::Covered;
    Ok(model)
}

/// The options and the start that steer a fit.
fn fingerprint(o: &TracedMapsOptions, light: &Scene) -> Fingerprint {
    let mut shape = crate::engine::checkpoint::Digest::new();
    for instance in &light.instances {
        let mesh = &light.primitives[instance.primitive].mesh;
        shape.add(mesh.triangles.as_flattened());
        shape.add(&mesh.positions);
        shape.add(&mesh.uvs);
        shape.add(&instance.transform.to_cols_array());
    }
    // Corrections are relative to these, which the values that move do not tell.
    let mut maps = crate::engine::checkpoint::Digest::new();
    light.images.iter().for_each(|i| maps.add_bytes(i.texels.as_flattened()));
    // Factors bound what they multiply.
    light.materials.iter().for_each(|m| maps.add_bytes(&m.roughness.to_le_bytes()));
    Fingerprint::default()
        .option("rate", o.rate)
        .option("size", o.size)
        .option("batch", o.batch)
        .option("spp", o.spp)
        .option("gradient_spp", o.gradient_spp)
        .option("reference_spp", o.reference_spp)
        .option("lighting", o.lighting.name())
        .option("seed", o.seed)
        .digest("shape of the light asset", shape)
        .digest("maps of the light asset", maps)
        .digest(filters::RULED, format!("{}, {}", SMOOTHING.name(), filters::rule()))
}

/// The rows of the plan.
fn items(maps: &[Map], model: &Traced, steps: bool, loss: PictureLoss, noise: Option<f64>) -> Vec<Item> {
    let row = |what, kind| {
        let of: Vec<usize> = (0..maps.len()).filter(|k| maps[*k].kind == kind).collect();
        let count = of.len();
        let mut why = format!("{count} maps, by path replay");
        let cells: Vec<usize> = of.iter().filter_map(|k| model.cell_of_correction(*k)).collect();
        if let Some(most) = cells.iter().max() {
            why += &format!(", {} of them moved in cells of up to {most} x {most} texels", cells.len());
        }
        let why_not = if steps { "no such map" } else { rows::NO_STEPS };
        Item::of(what, steps && count > 0, why, why_not)
    };
    vec![
        row("base colour gradients", MapKind::BaseColor),
        row("roughness gradients", MapKind::MetallicRoughness),
        Item::of("position gradients", false, "", "the shape stays"),
        rows::loss(loss, noise, steps),
        rows::evaluation(Measure::Psnr, "what a screen shows is compared"),
    ]
}

/// Gives materials without a map of base colour one, where their surfaces have texture coordinates.
fn add_maps(light: &mut Scene, size: usize) {
    let has_uvs = |m: usize| {
        let mut of = light.primitives.iter().filter(|p| p.material == m).peekable();
        of.peek().is_some() && of.all(|p| p.mesh.uvs.len() == p.mesh.positions.len())
    };
    let without = |m: &usize| light.materials[*m].base_color_texture.is_none() && !light.materials[*m].unlit;
    let wanted: Vec<usize> = (0..light.materials.len()).filter(without).filter(|m| has_uvs(*m)).collect();
    if wanted.is_empty() {
        return;
    }
    let mut made: Vec<([f32; 3], usize)> = Vec::new();
    for m in wanted {
        let [r, g, b, alpha] = light.materials[m].base_color;
        let color = [r, g, b];
        let image = made.iter().find(|(c, _)| *c == color).map_or(light.images.len(), |(_, image)| *image);
        if image == light.images.len() {
            let [r, g, b] = color.map(linear_to_srgb_u8);
            light.images.push(TextureImage {
                name: "base-color".into(),
                width: size,
                height: size,
                texels: vec![[r, g, b, 255]; size * size],
                ..TextureImage::default()
            });
            made.push((color, image));
        }
        let material = &mut light.materials[m];
        material.base_color = [1.0, 1.0, 1.0, alpha];
        material.base_color_texture = Some(atlas_slot(image));
    }
}

/// The maps of a scene that can be fitted, each once: base colours, roughness with metalness, and normals where there are
/// some.
pub(crate) fn maps(light: &Scene, world: &World) -> Vec<Map> {
    let mut out: Vec<Map> = Vec::new();
    let Some(library) = world.library() else { return out };
    for (i, m) in light.materials.iter().enumerate() {
        if m.unlit || library.may_transmit(i) || library.may_be_anisotropic(i) {
            continue;
        }
        let slots = [
            (MapKind::BaseColor, &m.base_color_texture),
            (MapKind::MetallicRoughness, &m.metallic_roughness_texture),
            (MapKind::Normal, &m.normal_texture),
        ];
        for (kind, slot) in slots {
            let Some((slot, texture)) = slot.as_ref().zip(library.texture_of(i, kind)) else { continue };
            if out.iter().all(|m| m.texture != texture) {
                out.push(Map { kind, texture, image: slot.image });
            }
        }
    }
    out
}

impl Map {
    pub(crate) fn parameter(&self, light: &Scene) -> TracedParameter {
        let image = &light.images[self.image];
        let (what, least) = match self.kind {
            MapKind::BaseColor => ("base colour", FAINT),
            MapKind::Normal => ("normals", 0.0),
            _ => ("roughness and metalness", 0.0),
        };
        TracedParameter {
            name: format!("{what} {}", self.texture),
            parameter: Parameter::Texels { texture: self.texture },
            shape: [1, image.height, image.width, 3],
            range: [least, 1.0],
        }
    }

    /// Writes linear values that moved from `start` as the image holds them; alpha and what no picture depends on stay. Of
    /// maps that share the image the one that moved a texel farthest has it: `moved` says how far each is so far.
    pub(crate) fn write(
        &self,
        start: &[f32],
        values: &[f32],
        image: &mut TextureImage,
        moved: &mut Vec<f32>,
    ) {
        let unorm = |x: f32| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        moved.resize(image.texels.len(), 0.0);
        let rows = start.chunks_exact(3).zip(values.chunks_exact(3));
        for ((texel, (s, v)), moved) in image.texels.iter_mut().zip(rows).zip(moved) {
            let far: f32 = s.iter().zip(v).map(|(s, v)| (v - s).abs()).sum();
            if far <= *moved {
                continue;
            }
            *moved = far;
            let number = |c: usize| if v[c] == s[c] { texel[c] } else { unorm(v[c]) };
            *texel = match self.kind {
                MapKind::BaseColor => {
                    [linear_to_srgb_u8(v[0]), linear_to_srgb_u8(v[1]), linear_to_srgb_u8(v[2]), texel[3]]
                }
                MapKind::Normal => [number(0), number(1), number(2), texel[3]],
                _ => [texel[0], number(1), number(2), texel[3]],
            };
        }
        image.encoded = None;
        image.texels16.clear();
        image.mips.clear();
    }
}

#[cfg(test)]
mod tests;

//! The asset's own texture coordinates, textures and materials on fewer triangles: what a plain decimation gives.

use super::byte_budget::{Shapes, bytes_without_textures, counted_in, others};
use super::options::MILD_RATIO;
use super::prepare::{decimated_only, importance};
use super::{Asset, DECIMATED, Normalised, SimplifyOptions, locks};
use crate::bake::Occlusion;
use crate::engine::judge::{self, Certainty, Stage, beyond_rasterizer};
use crate::engine::plan::Item;
use crate::engine::reference::Reference;
use crate::report::counted;
use crate::{FitError, Progress};
use photofit_geometry::decimate::{Options, Target};
use photofit_image::round_to_8_bits;
use photofit_raster::texture::{MipLayout, MipRule, MipTexture, Texels};
use photofit_scene::{AlphaMode, Scene, TextureEncoding, TextureImage, TextureSlot};
use rayon::prelude::*;

/// Textures of a fitted asset at most: base colour, roughness with metalness, normals, emission.
const MAPS: usize = 4;

/// Extensions that lie over a core which the rasterizer draws: it puts decimations in order that have no others.
const OVER_THE_CORE: [&str; 4] = ["specular", "clearcoat", "sheen", "anisotropy"];

/// How to decimate an asset with its own texture coordinates.
pub(super) fn own(target: Target, n: &Normalised, options: &SimplifyOptions) -> Options {
    let own = Options { keep_uvs: true, ..Options::new(target) };
    locks::locking(own, &n.flat.mesh, n, options)
}

/// What quadrics weigh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Weights {
    /// The measured defaults.
    #[default]
    Default,
    /// Where most triangles stay: quadrics of texture coordinates and normals keep what is there, and positions that are
    /// fitted to the surface alone would pull them off; no thin part is lost yet.
    Mild,
    /// Normals count more, as on smooth surfaces, where shading shows what outlines hide. The factor was found on one asset (bunny: 36.4
    /// dB without, 39.2 with it); what looks worse by it is not chosen.
    Shading,
}

/// How many times as much normals weigh then.
const SHADING: f64 = 5.0;

impl Weights {
    fn of(self, own: Options) -> Options {
        match self {
            Self::Default => own,
            Self::Mild => Options { normal_weight: 0.003, thin_power: 0.0, refine_rounds: 0, ..own },
            Self::Shading => Options { normal_weight: SHADING * own.normal_weight, ..own },
        }
    }
}

/// The asset with its own textures on fewer triangles.
pub(super) fn decimated(
    scene: &Scene,
    n: &Normalised,
    importance: &[f32],
    how: &Options,
) -> Result<Stage, FitError> {
    decimated_only(DECIMATED, scene, n, importance, how)
}

/// How decimations to the same number of triangles differ.
#[derive(Clone, Default)]
pub(super) struct Decimation {
    /// How much each triangle counts; empty: all alike.
    importance: Vec<f32>,
    weights: Weights,
    /// Among how many it was chosen and how surely, where others were tried.
    chosen: Option<(usize, Certainty)>,
}

impl Decimation {
    /// The row of the plan.
    pub(super) fn row(&self) -> Item {
        let weights = match self.weights {
            Weights::Default if !self.importance.is_empty() => {
                "default weights of quadrics, and triangles that are seen more weigh more".to_owned()
            }
            Weights::Default => "default weights of quadrics".to_owned(),
            Weights::Mild => {
                "weights of quadrics for mild budgets: normals weigh less, and thin parts as others"
                    .to_owned()
            }
            Weights::Shading => format!("quadrics of normals weigh {SHADING} times as much as by default"),
        };
        let chosen = match self.chosen {
            None => "; no others were compared".to_owned(),
            Some((of, Certainty { views, close })) => {
                let close = if close { ", and another may be better yet" } else { "" };
                format!("; the best of {of} in {}{close}", counted(views as usize, "view"))
            }
        };
        Item::note("decimation", format!("{weights}{chosen}"))
    }

    fn decimated(
        &self,
        asset: Asset<'_>,
        target: Target,
        options: &SimplifyOptions,
    ) -> Result<Stage, FitError> {
        let how = self.weights.of(own(target, asset.n, options));
        decimated(asset.scene, asset.n, &self.importance, &how)
    }
}

/// Of `first` and of decimations to as many triangles that other weights make (mild ones, of normals, and with what can be seen counting
/// more), the one that looks best, and how it was made; path traced where the rasterizer does not draw what they differ in. Other
/// budgets than of triangles mean other numbers under other weights: `first` alone counts then.
pub(super) fn best(
    asset: Asset<'_>,
    first: Stage,
    reference: &dyn Reference,
    target: Target,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<(Stage, Decimation), FitError> {
    let Asset { scene, n, visibility, .. } = asset;
    if !matches!(target, Target::Triangles(_) | Target::Ratio(_)) || progress.is_cancelled() {
        return Ok((first, Decimation::default()));
    }
    let weighted = |weights| Decimation { weights, ..Decimation::default() };
    let seen = Decimation { importance: importance(n, visibility), ..Decimation::default() };
    let mut others = vec![weighted(Weights::Mild), seen];
    if !n.flat.mesh.normals.is_empty() {
        others.push(weighted(Weights::Shading));
    }
    let made = others.par_iter().map(|how| how.decimated(asset, target, options));
    let mut stages = vec![first];
    stages.extend(made.collect::<Result<Vec<Stage>, FitError>>()?);
    let (count, samples) = (options.choice_views(), options.choice_samples());
    let ranking = if beyond_rasterizer(scene).iter().all(|name| OVER_THE_CORE.contains(name)) {
        let views = options.orbit(options.resolution);
        judge::ranking(&n.light_asset, reference, &stages, &views, count, samples, progress)?
    } else {
        let judge = options.judge_of(scene, n, reference);
        judge.ranking(&stages, (count, options.smallest_picture()), samples, progress)?
    };
    let best = ranking.best();
    others.insert(0, Decimation::default());
    let chosen = (ranking.views() > 0).then(|| (others.len(), ranking.certainty()));
    Ok((stages.swap_remove(best), Decimation { chosen, ..others.swap_remove(best) }))
}

/// The decimation that looks best, as it is written, and, where triangles follow from bytes, others made in the same way.
pub(super) fn shapes(
    asset: Asset<'_>,
    (best, decimation): &(Stage, Decimation),
    (options, progress): (&SimplifyOptions, &dyn Progress),
    written: &dyn Fn(&Stage) -> Scene,
) -> Result<Shapes, FitError> {
    let mut shapes = Shapes::new(written(best));
    // Where all triangles fit none is missing.
    let all = Target::Triangles(asset.scene.triangle_count());
    if let Some(most) = options.max_bytes.filter(|_| options.triangles_by_bytes && options.target != all) {
        let (first, all) = (shapes.scene(0), asset.scene.triangle_count());
        for compression in counted_in(options.compression, !first.images.is_empty()) {
            let bytes = |light: &Scene| {
                bytes_without_textures(&super::dressed(light.clone(), asset, options), *compression)
            };
            let decimated = |triangles: usize| {
                let light = written(&decimation.decimated(asset, Target::Triangles(triangles), options)?);
                bytes(&light).map(|bytes| (light, bytes))
            };
            let first = (&first, bytes(&first)?, all);
            others(first, most, &decimated, &|| progress.is_cancelled(), &mut |other| shapes.add(other))?;
        }
    }
    Ok(shapes)
}

/// The asset with all of its textures and materials as they are.
pub(super) fn kept(stage: &Stage, n: &Normalised, options: &SimplifyOptions) -> Scene {
    let mut light = stage.placed(&n.light_asset);
    if options.occlusion == Occlusion::None {
        light.materials.iter_mut().for_each(|m| m.occlusion_texture = None);
    }
    keep_used(&mut light);
    light
}

/// The asset with its own materials that may be written in place of a fitted one, if it may: the best of several
/// decimations, the first of which is `plain`.
pub(super) fn candidate(
    asset: Asset<'_>,
    plain: &Stage,
    reference: &dyn Reference,
    target: Target,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Option<Own>, FitError> {
    if !options.keeps_textures(asset.scene) {
        return Ok(None);
    }
    let best = best(asset, plain.clone(), reference, target, options, progress)?;
    let shapes = shapes(asset, &best, (options, progress), &|stage| written(stage, asset.n, options))?;
    let (stage, decimation) = (best.0, best.1.row());
    Ok(Some(Own { shapes, stage, decimation }))
}

/// The asset with its own materials that may be written in place of a fitted one.
pub(super) struct Own {
    /// As it is written.
    pub(super) shapes: Shapes,
    /// With all of its texels.
    pub(super) stage: Stage,
    /// How it was decimated.
    pub(super) decimation: Item,
}

/// The same as it may be written in place of a fitted asset: in the asset's frame, with textures that together have no
/// more texels than the maps of a fitted one; the largest are halved until they do, and each until its sides are no longer than
/// [`SimplifyOptions::own_texture_size`]. Where the budget is mild and textures may stay whole, they do; a budget of bytes, which
/// halves them as far as it needs, leaves them their texels, too.
pub(super) fn written(stage: &Stage, n: &Normalised, options: &SimplifyOptions) -> Scene {
    let mut light = kept(stage, n, options);
    if options.max_bytes.is_some() {
        drop_unread(&mut light);
    }
    if options.whole_textures
        && light.triangle_count() as f64 >= MILD_RATIO * n.flat.mesh.triangles.len() as f64
    {
        return light;
    }
    let most = match options.max_bytes {
        Some(_) => usize::MAX,
        None => MAPS * options.texture_size * options.texture_size,
    };
    let size = |i: &TextureImage| i.width * i.height;
    let mut halvings = vec![0_u32; light.images.len()];
    let left = |k: usize, h: u32| (size(&light.images[k]) >> (2 * h)).max(1);
    let longest = options.own_texture_size.unwrap_or(usize::MAX);
    for (h, i) in halvings.iter_mut().zip(&light.images) {
        while i.width.max(i.height) >> *h > longest {
            *h += 1;
        }
    }
    while (0..halvings.len()).map(|k| left(k, halvings[k])).sum::<usize>() > most {
        let largest = (0..halvings.len()).max_by_key(|k| (left(*k, halvings[*k]), usize::MAX - k));
        let Some(largest) = largest.filter(|k| left(*k, halvings[*k]) > 1) else { break };
        halvings[largest] += 1;
    }
    for (k, h) in halvings.into_iter().enumerate().filter(|(_, h)| *h > 0) {
        light.images[k] = reduced(&light, k, h as usize);
        if !matches!(options.texture_encoding, TextureEncoding::Ktx2 { .. }) {
            // They are judged as they are written.
            light.images[k].mips.clear();
        }
    }
    light
}

/// Drops texture coordinates and tangents of materials without textures, and colours that change nothing: where bytes are scarce. Else who
/// gave them may have a use for them.
fn drop_unread(scene: &mut Scene) {
    for primitive in &mut scene.primitives {
        if primitive.mesh.colors.iter().all(|c| c.to_array() == [1.0; 4]) {
            primitive.mesh.colors.clear();
        }
        let material = &scene.materials[primitive.material];
        if material.texture_slots().next().is_none() && !material.needs_tangents() {
            primitive.mesh.uvs.clear();
            primitive.mesh.uvs1.clear();
            primitive.mesh.tangents.clear();
        }
    }
}

/// Drops primitives without triangles, and materials and images that nothing shows.
fn keep_used(scene: &mut Scene) {
    let shown = |p: &usize| !scene.primitives[*p].mesh.triangles.is_empty();
    let kept: Vec<usize> = (0..scene.primitives.len()).filter(shown).collect();
    scene.instances.retain(|i| kept.contains(&i.primitive));
    for i in &mut scene.instances {
        i.primitive = kept.binary_search(&i.primitive).expect("kept");
    }
    scene.primitives = kept.iter().map(|p| scene.primitives[*p].clone()).collect();
    let mut materials: Vec<usize> = scene.primitives.iter().map(|p| p.material).collect();
    materials.sort_unstable();
    materials.dedup();
    for p in &mut scene.primitives {
        p.material = materials.binary_search(&p.material).expect("kept");
    }
    scene.materials = materials.iter().map(|m| scene.materials[*m].clone()).collect();
    let mut images: Vec<usize> =
        scene.materials.iter().flat_map(|m| m.texture_slots().map(|s| s.image)).collect();
    images.sort_unstable();
    images.dedup();
    for slot in scene.materials.iter_mut().flat_map(|m| m.texture_slots_mut()) {
        slot.image = images.binary_search(&slot.image).expect("kept");
    }
    scene.images = images.iter().map(|i| scene.images[*i].clone()).collect();
}

/// The textures of a material's core, and whether their colour is sRGB.
fn slots(m: &photofit_scene::Material) -> impl Iterator<Item = (&TextureSlot, bool)> {
    [
        (&m.base_color_texture, true),
        (&m.emissive_texture, true),
        (&m.metallic_roughness_texture, false),
        (&m.normal_texture, false),
        (&m.occlusion_texture, false),
    ]
    .into_iter()
    .filter_map(|(slot, srgb)| slot.as_ref().map(|s| (s, srgb)))
}

/// An image halved so many times, filtered as the cores of the materials read it; what extensions alone read is averaged
/// as it is stored. An image that has mip levels of its own becomes one of them, with those that follow.
pub(super) fn reduced(scene: &Scene, image: usize, halvings: usize) -> TextureImage {
    if let Some((level, coarser)) = scene.images[image].mips.split_at_checked(halvings)
        && let Some(texels) = level.last()
    {
        let old = &scene.images[image];
        let half = |n: usize| (n >> halvings).max(1);
        let (width, height) = (half(old.width), half(old.height));
        let own = TextureImage { width, height, texels: texels.clone(), ..TextureImage::default() };
        return TextureImage { name: old.name.clone(), mips: coarser.to_vec(), ..own };
    }
    let readers = || scene.materials.iter().flat_map(|m| slots(m).map(move |s| (m, s)));
    let srgb = readers().any(|(_, (slot, srgb))| slot.image == image && srgb);
    let coverage = scene.materials.iter().any(|m| {
        m.alpha_mode != AlphaMode::Opaque && m.base_color_texture.as_ref().is_some_and(|s| s.image == image)
    });
    let old = &scene.images[image];
    let layout = MipLayout::full(old.width, old.height);
    let whole = match srgb {
        true => Texels::Srgb8(old.texels.clone()),
        false if old.texels16.is_empty() => Texels::Unorm8(old.texels.clone()),
        false => Texels::Unorm16(old.texels16.clone()),
    };
    let rule = if coverage { MipTexture::COVERAGE } else { MipRule::Area };
    let chain = MipTexture::new(whole, layout, rule);
    let level = chain.layout().levels()[halvings.min(chain.layout().levels().len() - 1)];
    let (width, height, first) = (level.width as usize, level.height as usize, level.offset as usize);
    let here = first..first + width * height;
    let (texels, texels16) = match chain.texels() {
        Texels::Srgb8(t) | Texels::Unorm8(t) => (t[here].to_vec(), Vec::new()),
        Texels::Unorm16(t) => {
            (t[here.clone()].iter().map(|t| t.map(round_to_8_bits)).collect(), t[here].to_vec())
        }
        Texels::F32(_) => unreachable!("texels keep their type"),
    };
    TextureImage { name: old.name.clone(), width, height, texels, texels16, ..TextureImage::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_geometry::shapes;
    use photofit_scene::{Instance, Material, Primitive};

    #[test]
    fn an_image_with_levels_of_its_own_becomes_one_of_them() {
        let mips: Vec<Vec<[u8; 4]>> =
            [8, 2, 1].iter().enumerate().map(|(k, n)| vec![[k as u8; 4]; *n]).collect();
        let whole = TextureImage { width: 8, height: 4, texels: vec![[9; 4]; 32], ..TextureImage::default() };
        let scene = Scene { images: vec![TextureImage { mips, ..whole.clone() }], ..Scene::default() };
        let half = reduced(&scene, 0, 1);
        assert_eq!((half.width, half.height, &half.texels[..]), (4, 2, &[[0; 4]; 8][..]));
        assert_eq!(half.mips, [vec![[1; 4]; 2], vec![[2; 4]]]);
        let least = reduced(&scene, 0, 3);
        assert_eq!((least.width, least.texels, least.mips.len()), (1, vec![[2; 4]], 0));
        let plain = reduced(&Scene { images: vec![whole], ..Scene::default() }, 0, 1);
        assert_eq!(plain.texels, [[9; 4]; 8]);
    }

    #[test]
    fn what_nothing_reads_is_dropped() {
        let white = photofit_scalar::Vec4f::splat(1.0);
        let part = |colors, material| {
            let mesh = shapes::uv_sphere(6, 4);
            let colors = vec![colors; mesh.positions.len()];
            Primitive { mesh: photofit_geometry::Mesh { colors, ..mesh }, material }
        };
        let textured = Material { base_color_texture: Some(TextureSlot::new(0)), ..Material::clay() };
        let mut scene = Scene {
            primitives: vec![part(white, 0), part(white * 0.5, 1)],
            materials: vec![Material::clay(), textured],
            ..Scene::default()
        };
        drop_unread(&mut scene);
        let has = |k: usize| {
            let mesh = &scene.primitives[k].mesh;
            (!mesh.uvs.is_empty(), !mesh.colors.is_empty())
        };
        assert_eq!([has(0), has(1)], [(false, false), (true, true)]);
        // Each by itself: a textured part whose colours are white.
        let mut mixed = Scene { primitives: vec![part(white, 1), part(white * 0.5, 0)], ..scene.clone() };
        drop_unread(&mut mixed);
        scene = mixed;
        let has = |k: usize| {
            let mesh = &scene.primitives[k].mesh;
            (!mesh.uvs.is_empty(), !mesh.colors.is_empty())
        };
        assert_eq!([has(0), has(1)], [(true, false), (false, true)]);
    }

    /// Data in 16 bits are halved in 16, and in 8 beside them; colours in 8.
    #[test]
    fn data_of_16_bits_stay_so() {
        let texels16 = vec![[1000, 20_001, 3, 65_535], [1003, 20_002, 60_000, 65_535]];
        let texels = vec![[4, 78, 0, 255], [4, 78, 233, 255]];
        let image = TextureImage { width: 2, height: 1, texels, texels16, ..TextureImage::default() };
        let slot = Some(TextureSlot::new(0));
        let data = Material { normal_texture: slot, ..Material::clay() };
        let scene = Scene { images: vec![image], materials: vec![data], ..Scene::default() };
        scene.validate().unwrap();
        let half = reduced(&scene, 0, 1);
        // Means, either way from the middle.
        let near = |found: u16, twice: u16| (2 * found).abs_diff(twice) <= 1;
        let [r, g, b, a] = half.texels16[0];
        assert!(near(r, 2003) && near(g, 40_003) && near(b, 60_003) && a == 65_535, "{:?}", half.texels16);
        assert_eq!(half.texels, [[4, 78, 117, 255]]);
        Scene { images: vec![half], ..scene.clone() }.validate().unwrap();
        let color = Material { base_color_texture: slot, ..Material::clay() };
        let color = Scene { materials: vec![color], ..scene };
        assert!(reduced(&color, 0, 1).texels16.is_empty());
    }

    #[test]
    fn textures_are_reduced_to_the_texels_of_a_fitted_asset() {
        let image = |n: usize, texel: [u8; 4]| TextureImage {
            width: n,
            height: n,
            texels: vec![texel; n * n],
            ..TextureImage::default()
        };
        let slot = |image| Some(TextureSlot::new(image));
        let seen = Material { base_color_texture: slot(1), normal_texture: slot(3), ..Material::clay() };
        let unseen = Material { base_color_texture: slot(0), ..Material::clay() };
        let scene = Scene {
            primitives: vec![Primitive { mesh: shapes::uv_sphere(16, 8), material: 1 }],
            instances: vec![Instance {
                primitive: 0,
                transform: glam::Affine3A::from_scale(glam::Vec3::splat(3.0)),
            }],
            materials: vec![unseen, seen],
            images: vec![
                image(64, [9; 4]),
                image(64, [10, 20, 30, 255]),
                image(8, [1; 4]),
                image(32, [128, 128, 255, 255]),
            ],
            ..Scene::default()
        };
        let n = Normalised::new(&scene).unwrap();
        let stage = decimated(&scene, &n, &[], &own(Target::Triangles(100), &n, &SimplifyOptions::default()))
            .unwrap();
        let options = SimplifyOptions { texture_size: 16, ..SimplifyOptions::default() };
        let light = written(&stage, &n, &options);
        let sizes: Vec<(usize, usize)> = light.images.iter().map(|i| (i.width, i.height)).collect();
        assert_eq!(
            (light.materials.len(), &sizes[..]),
            (1, &[(16, 16), (16, 16)][..]),
            "4 x 16 x 16 texels at most"
        );
        assert!(light.images[0].texels.iter().all(|t| *t == [10, 20, 30, 255]));
        assert!(light.images[1].texels.iter().all(|t| *t == [128, 128, 255, 255]));
        let far = light.primitives[0].mesh.positions.iter().map(|p| p.length()).fold(0.0, f32::max);
        assert!((far - 3.0).abs() < 0.3, "in the asset's frame: {far}");
        assert!(light.triangle_count() <= 100);
        // They stay whole where that is wanted and the budget is mild: 100 of 224 triangles.
        let whole = written(&stage, &n, &SimplifyOptions { whole_textures: true, ..options.clone() });
        let sizes: Vec<usize> = whole.images.iter().map(|i| i.width).collect();
        assert_eq!(sizes, [64, 32]);
        let few =
            decimated(&scene, &n, &[], &own(Target::Triangles(40), &n, &SimplifyOptions::default())).unwrap();
        let few = written(&few, &n, &SimplifyOptions { whole_textures: true, ..options });
        assert_eq!(few.images[0].width, 16);
        // The texels of four maps in a single texture, unless a side is to be no longer than one of theirs.
        let mut single = scene.clone();
        single.images[1] = image(32, [10, 20, 30, 255]);
        single.materials[1].normal_texture = None;
        let stage = decimated(&single, &n, &[], &own(Target::Triangles(40), &n, &SimplifyOptions::default()))
            .unwrap();
        for (own_texture_size, side) in [(None, 32), (Some(16), 16), (Some(17), 16)] {
            let options =
                SimplifyOptions { own_texture_size, texture_size: 16, ..SimplifyOptions::default() };
            let light = written(&stage, &n, &options);
            assert_eq!((light.images[0].width, light.images.len()), (side, 1), "{own_texture_size:?}");
        }
    }
}

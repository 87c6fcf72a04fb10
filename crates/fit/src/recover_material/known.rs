//! An asset whose materials are known: pictures of it to recover them from, and how far what was recovered is from them.

use super::lit;
use crate::FitError;
use crate::engine::FitFrame;
use crate::engine::reference::{ENERGY, world};
use crate::engine::traced::WHOLE;
use crate::engine::views::views_around;
use photofit_image::{Image, psnr_from_mse, to_display};
use photofit_pathtrace::{PathOptions, RenderOptions, Renderer, View, World};
use photofit_sampling::hash;
use photofit_scene::{MapKind, Material, Scene};

/// Tells the numbers of the pictures from those of a fit.
const SEED: u64 = 0x6b6e_6f77;
/// Samples per pixel of pictures of a property.
const PROPERTY_SPP: u32 = 4;
/// Most views that are lit anew.
const MOST_RELIT: usize = 4;

/// An asset with known materials, pictures of it, and where they were taken from.
#[derive(Debug)]
pub struct KnownMaterial<'a> {
    asset: &'a Scene,
    /// The cameras.
    pub views: Vec<View>,
    /// One for each, linear premultiplied RGBA.
    pub pictures: Vec<Image>,
    options: RenderOptions,
}

/// How far found materials are from known ones, over the pixels that both cover whole in all views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaterialErrors {
    /// Mean absolute error of the linear base colour.
    pub albedo: f64,
    /// The same after the factor of each channel that makes the squared error least: what is left where a factor is taken
    /// for one of the light.
    pub scaled_albedo: f64,
    /// These factors.
    pub albedo_scale: [f64; 3],
    /// Mean absolute error of the perceptual roughness.
    pub roughness: f64,
    /// Mean absolute error of the metalness.
    pub metallic: f64,
    /// PSNR of the asset under another environment, of sRGB in [0, 1], dB, with base colours as they are.
    pub relit: f64,
    /// The same with base colours times [`Self::albedo_scale`].
    pub scaled_relit: f64,
}

/// `count` cameras on a Fibonacci sphere around an asset, which they see whole.
///
/// # Errors
/// An asset without a surface.
pub fn around(asset: &Scene, count: usize) -> Result<Vec<View>, FitError> {
    asset.validate_for_fit()?;
    let Some((middle, radius)) = asset.bounding_sphere() else { return Ok(Vec::new()) };
    let mut views = views_around(middle, radius, count);
    // The last picture judges a fit: one from the side, which sees what lies on a floor.
    if let Some(last) = count.checked_sub(1) {
        views.swap(count / 2, last);
    }
    Ok(views)
}

/// A sky with three windows of light of different colours, over a dark ground.
pub fn first_sky() -> Image {
    windows(
        &[(4, 6, [12.0, 10.0, 8.0]), (22, 9, [4.0, 7.0, 12.0]), (44, 4, [10.0, 9.0, 8.0])],
        [0.35, 0.4, 0.5],
    )
}

/// Another one: two windows elsewhere, under a warm sky.
pub fn second_sky() -> Image {
    windows(&[(14, 5, [14.0, 12.0, 9.0]), (54, 8, [6.0, 8.0, 11.0])], [0.5, 0.42, 0.35])
}

/// Windows of 8 x 6 texels with their upper left corners and radiances.
fn windows(all: &[(usize, usize, [f32; 3])], sky: [f32; 3]) -> Image {
    Image::from_fn(64, 32, 3, |x, y, c| {
        let lit = all.iter().find(|(u, v, _)| (*u..u + 8).contains(&x) && (*v..v + 6).contains(&y));
        let share = if y < 16 { 1.0 } else { 0.3 };
        lit.map_or(share * sky[c], |(_, _, radiance)| radiance[c])
    })
}

impl<'a> KnownMaterial<'a> {
    /// Renders pictures of `size` x `size` pixels of an asset under an environment with so many samples per pixel; the camera
    /// sees the environment where `background` says so. Lights of the asset's file and extensions of its materials are left
    /// out.
    ///
    /// # Errors
    /// An asset that the path tracer refuses, cameras that cannot make rays.
    pub fn new(
        asset: &'a Scene,
        environment: &Image,
        views: Vec<View>,
        (size, spp): (usize, u32),
        background: bool,
        seed: u64,
    ) -> Result<Self, FitError> {
        asset.validate_for_fit()?;
        let path = PathOptions { show_environment: background, ..PathOptions::default() };
        let (width, height, seed) = (size, size, hash(seed, SEED, 0));
        let options = RenderOptions { width, height, spp, seed, path, ..RenderOptions::default() };
        let world = lit(asset, environment)?;
        let pictures = pictures(&world, &views, &options)?;
        Ok(Self { asset, views, pictures, options })
    }

    /// The errors of an asset of the same shape, whose materials were found from the pictures.
    ///
    /// # Errors
    /// If the path tracer refuses it.
    pub fn errors(&self, found: &Scene) -> Result<MaterialErrors, FitError> {
        let color = self.compared(found, MapKind::BaseColor)?;
        let surface = self.compared(found, MapKind::MetallicRoughness)?;
        let error = |all: &Compared, c: usize, k: f64| {
            let sum: f64 = all.iter().map(|[t, f]| (f64::from(f[c]) * k - f64::from(t[c])).abs()).sum();
            sum / all.len().max(1) as f64
        };
        let scale = [0, 1, 2].map(|c| {
            let dot = |a: usize, b: usize| {
                color.iter().map(|p| f64::from(p[a][c]) * f64::from(p[b][c])).sum::<f64>()
            };
            let k = dot(0, 1) / dot(1, 1);
            if k.is_finite() { k } else { 1.0 }
        });
        let mean = |k: [f64; 3]| (0..3).map(|c| error(&color, c, k[c])).sum::<f64>() / 3.0;
        Ok(MaterialErrors {
            albedo: mean([1.0; 3]),
            scaled_albedo: mean(scale),
            albedo_scale: scale,
            roughness: error(&surface, 1, 1.0),
            metallic: error(&surface, 2, 1.0),
            relit: self.relit(found, [1.0; 3])?,
            scaled_relit: self.relit(found, scale)?,
        })
    }

    /// The asset and what was found under another environment, pictures of up to four views each.
    ///
    /// # Errors
    /// If the path tracer refuses it.
    pub fn under_another_sky(&self, found: &Scene, scale: [f64; 3]) -> Result<[Vec<Image>; 2], FitError> {
        let count = self.views.len().min(MOST_RELIT);
        let views: Vec<View> = (0..count).map(|k| self.views[k * self.views.len() / count]).collect();
        let mut options = self.options.clone();
        options.path.show_environment = false;
        let known = pictures(&lit(self.asset, &second_sky())?, &views, &options)?;
        let mut world = lit(found, &second_sky())?;
        scale_base_colors(&mut world, found, scale)?;
        options.seed = hash(options.seed, SEED, 1);
        Ok([known, pictures(&world, &views, &options)?])
    }

    fn relit(&self, found: &Scene, scale: [f64; 3]) -> Result<f64, FitError> {
        let [known, found] = self.under_another_sky(found, scale)?;
        let (mut sum, mut count) = (0.0, 0_usize);
        for (a, b) in known.iter().zip(&found) {
            for (a, b) in covered(&to_display(a), &to_display(b)) {
                sum += (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>();
                count += 3;
            }
        }
        Ok(psnr_from_mse(sum / count.max(1) as f64))
    }

    /// The pixels of a property of both, of all views.
    fn compared(&self, found: &Scene, kind: MapKind) -> Result<Compared, FitError> {
        let mut options = RenderOptions { spp: PROPERTY_SPP, ..self.options.clone() };
        options.path.show_environment = false;
        let of = |scene: &Scene| pictures(&property(scene, kind)?, &self.views, &options);
        let (known, found) = (of(self.asset)?, of(found)?);
        Ok(known.iter().zip(&found).flat_map(|(a, b)| covered(a, b)).map(|(a, b)| [a, b]).collect())
    }
}

/// Colours of pixels of two pictures.
type Compared = Vec<[[f32; 3]; 2]>;

/// Colours of the pixels that two pictures cover whole.
fn covered(a: &Image, b: &Image) -> Vec<([f32; 3], [f32; 3])> {
    let pixels = a.data.chunks_exact(4).zip(b.data.chunks_exact(4));
    let whole = pixels.filter(|(a, b)| a[3] >= WHOLE && b[3] >= WHOLE);
    whole.map(|(a, b)| ([a[0], a[1], a[2]], [b[0], b[1], b[2]])).collect()
}

fn pictures(world: &World, views: &[View], options: &RenderOptions) -> Result<Vec<Image>, FitError> {
    let picture = |view: &View| {
        let mut renderer = Renderer::new(world, view, options.clone())?;
        renderer.finish();
        Ok(renderer.picture())
    };
    views.iter().map(picture).collect()
}

/// A world that shows a property of surfaces as it is: base colour, or roughness in green and metalness in blue.
fn property(scene: &Scene, kind: MapKind) -> Result<World, FitError> {
    let mut shown = scene.clone();
    let is_color = kind == MapKind::BaseColor;
    for m in &mut shown.materials {
        let ([r, g, b, _], slot) = match is_color {
            true => (m.base_color, m.base_color_texture),
            false => ([0.0, m.roughness, m.metallic, 1.0], m.metallic_roughness_texture),
        };
        *m = Material {
            unlit: true,
            double_sided: m.double_sided,
            base_color: [r, g, b, 1.0],
            base_color_texture: slot,
            ..Material::default()
        };
    }
    if !is_color {
        shown.primitives.iter_mut().for_each(|p| p.mesh.colors.clear());
    }
    let mut world = world(&shown, FitFrame::WORLD, ENERGY)?;
    for (i, m) in shown.materials.iter().enumerate().filter(|_| !is_color) {
        // These images are linear, colours are not.
        let texture = world.library().and_then(|l| l.texture_of(i, MapKind::BaseColor));
        if let Some((texture, slot)) = texture.zip(m.base_color_texture) {
            world.set_texels(texture, &shown.images[slot.image].data())?;
        }
    }
    Ok(world)
}

/// Multiplies the maps of base colour, up to 1.
fn scale_base_colors(world: &mut World, scene: &Scene, scale: [f64; 3]) -> Result<(), FitError> {
    let mut done = Vec::new();
    for i in 0..scene.materials.len() {
        let Some(library) = world.library() else { return Ok(()) };
        let Some(texture) = library.texture_of(i, MapKind::BaseColor).filter(|t| !done.contains(t)) else {
            continue;
        };
        let texels = library.texture(texture).linear_base();
        let scaled = |t: [f32; 4]| {
            let of = |c: usize| (f64::from(t[c]) * scale[c]).min(1.0) as f32;
            [of(0), of(1), of(2), t[3]]
        };
        let texels: Vec<[f32; 4]> = texels.into_iter().map(scaled).collect();
        world.set_texels(texture, &texels)?;
        done.push(texture);
    }
    Ok(())
}

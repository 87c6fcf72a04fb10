//! Images as textures: the base level alone, in `f32`, read through the taps of [`photofit_texture`] (row 0 at `v = 0`).

use photofit_image::Image;
use photofit_scalar::{Vec2f, Vec3f, vec2, vec3};
use photofit_texture::{Filter, Level, Sampler, Taps, Texture, Wrap, taps};

/// An image of one or three channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Bitmap {
    texels: Texels,
    sampler: Sampler,
}

#[derive(Clone, Debug, PartialEq)]
enum Texels {
    Grey(Texture<f32, 1>),
    Color(Texture<f32, 3>),
}

/// Shares of the channels in the luminance.
pub(super) fn luminance_weights() -> [f32; 3] {
    let unit = |k: usize| std::array::from_fn(|c| f32::from(u8::from(c == k)));
    [0, 1, 2].map(|k| photofit_image::luminance(unit(k)))
}

fn texture<const C: usize>(image: &Image) -> Texture<f32, C> {
    let texels = image.data.chunks_exact(image.channels).map(|p| std::array::from_fn(|c| p[c])).collect();
    Texture { width: image.width, height: image.height, texels }
}

impl Bitmap {
    /// The colour of an image (a single channel stays single), without its alpha. There is one level: a trilinear filter
    /// is a bilinear one.
    ///
    /// # Panics
    /// If the image has no texels.
    pub fn new(image: &Image, wrap: Wrap, filter: Filter) -> Self {
        assert!(image.width > 0 && image.height > 0, "an image has texels");
        let texels =
            if image.channels >= 3 { Texels::Color(texture(image)) } else { Texels::Grey(texture(image)) };
        Self { texels, sampler: Sampler { wrap_u: wrap, wrap_v: wrap, filter } }
    }

    /// 1 or 3.
    pub fn channels(&self) -> usize {
        match self.texels {
            Texels::Grey(_) => 1,
            Texels::Color(_) => 3,
        }
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        match &self.texels {
            Texels::Grey(t) => [t.width, t.height],
            Texels::Color(t) => [t.width, t.height],
        }
    }

    /// All texels, row by row, three channels each; single channels are repeated.
    pub fn texels(&self) -> Vec<f32> {
        match &self.texels {
            Texels::Grey(t) => t.texels.iter().flat_map(|&[x]| [x; 3]).collect(),
            Texels::Color(t) => t.texels.as_flattened().to_vec(),
        }
    }

    /// Replaces all texels by three channels each, of which single channels take the first.
    ///
    /// # Panics
    /// If there are not three values for every texel.
    pub fn set_texels(&mut self, values: &[f32]) {
        let [width, height] = self.size();
        assert_eq!(values.len(), 3 * width * height, "three values a texel");
        match &mut self.texels {
            Texels::Grey(t) => t.texels.iter_mut().zip(values.chunks_exact(3)).for_each(|(t, v)| t[0] = v[0]),
            Texels::Color(t) => t.texels.as_flattened_mut().copy_from_slice(values),
        }
    }

    /// Largest value per channel.
    pub(super) fn largest(&self) -> Vec3f {
        match &self.texels {
            Texels::Grey(t) => Vec3f::splat(t.texels.iter().fold(0.0, |m, t| t[0].max(m))),
            Texels::Color(t) => t.texels.iter().fold(Vec3f::zero(), |m, &t| m.max(Vec3f::from_array(t))),
        }
    }

    #[inline]
    fn taps(&self, uv: Vec2f) -> Taps<f32> {
        let [width, height] = self.size();
        taps(uv, Level { offset: 0, width: width as u32, height: height as u32 }, &self.sampler)
    }

    /// Colour at texture coordinates.
    pub fn color(&self, uv: Vec2f) -> Vec3f {
        let at = self.taps(uv);
        match &self.texels {
            Texels::Grey(t) => Vec3f::splat(at.read(t)[0]),
            Texels::Color(t) => Vec3f::from_array(at.read(t)),
        }
    }

    /// Adjoint of [`Self::color`] for the gradient `g`: calls `add` with texels and their shares of it. That of a texel of
    /// one channel, which all three colours show, is in the first component.
    pub fn color_vjp(&self, uv: Vec2f, g: Vec3f, mut add: impl FnMut(usize, Vec3f)) {
        let g = if self.channels() == 1 { vec3(g.x + g.y + g.z, 0.0, 0.0) } else { g };
        let at = self.taps(uv);
        for (texel, weight) in at.index.into_iter().zip(at.weights()) {
            if weight != 0.0 {
                add(texel as usize, g * weight);
            }
        }
    }

    /// Derivative of the luminance with respect to the texture coordinates; zero without interpolation.
    pub(super) fn gradient(&self, uv: Vec2f) -> Vec2f {
        if self.sampler.filter == Filter::Nearest {
            return vec2(0.0, 0.0);
        }
        let at = self.taps(uv);
        match &self.texels {
            Texels::Grey(t) => at.uv_vjp(t, &[1.0]),
            Texels::Color(t) => at.uv_vjp(t, &luminance_weights()),
        }
    }
}

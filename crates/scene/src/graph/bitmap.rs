//! Images as textures, read the way Mitsuba reads them: row 0 at `v = 0`, texel centres at half texels.

use photofit_image::Image;
use photofit_scalar::{Vec2f, Vec3f, vec2, vec3};

/// What lies outside of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BitmapWrap {
    /// The image again.
    #[default]
    Repeat,
    /// The image mirrored, then again.
    Mirror,
    /// The texel at the border.
    Clamp,
}

/// How values between texels are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BitmapFilter {
    /// Bilinear interpolation.
    #[default]
    Bilinear,
    /// The texel that the point lies in.
    Nearest,
}

/// An image of one or three channels.
#[derive(Clone, Debug)]
pub struct Bitmap {
    width: usize,
    height: usize,
    channels: usize,
    texels: Vec<f32>,
    wrap: BitmapWrap,
    filter: BitmapFilter,
}

impl Bitmap {
    /// Takes the colour of an image over (a single channel stays single), without its alpha.
    ///
    /// # Panics
    /// If the image has no texels.
    pub fn new(image: &Image, wrap: BitmapWrap, filter: BitmapFilter) -> Self {
        assert!(image.width > 0 && image.height > 0, "an image has texels");
        let channels = if image.channels >= 3 { 3 } else { 1 };
        let texels =
            image.data.chunks_exact(image.channels).flat_map(|p| p[..channels].iter().copied()).collect();
        Self { width: image.width, height: image.height, channels, texels, wrap, filter }
    }

    /// 1 or 3.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// All texels, row by row, three channels each; single channels are repeated.
    pub fn texels(&self) -> Vec<f32> {
        (0..self.width * self.height).flat_map(|i| self.texel(i).to_array()).collect()
    }

    /// Replaces all texels by three channels each, of which single channels take the first.
    ///
    /// # Panics
    /// If there are not three values for every texel.
    pub fn set_texels(&mut self, values: &[f32]) {
        assert_eq!(values.len(), 3 * self.width * self.height, "three values a texel");
        for (t, v) in self.texels.chunks_exact_mut(self.channels).zip(values.chunks_exact(3)) {
            t.copy_from_slice(&v[..t.len()]);
        }
    }

    /// Largest value per channel.
    pub(super) fn largest(&self) -> Vec3f {
        (0..self.width * self.height).fold(Vec3f::zero(), |m, i| m.max(self.texel(i)))
    }

    #[inline]
    fn texel(&self, i: usize) -> Vec3f {
        if self.channels == 1 {
            Vec3f::splat(self.texels[i])
        } else {
            vec3(self.texels[3 * i], self.texels[3 * i + 1], self.texels[3 * i + 2])
        }
    }

    /// Index of a texel along an axis of `n`.
    #[inline]
    fn wrapped(&self, i: i64, n: usize) -> usize {
        let n = n as i64;
        let k = match self.wrap {
            BitmapWrap::Repeat => i.rem_euclid(n),
            BitmapWrap::Clamp => i.clamp(0, n - 1),
            BitmapWrap::Mirror => {
                let m = i.rem_euclid(2 * n);
                if m < n { m } else { 2 * n - 1 - m }
            }
        };
        k as usize
    }

    /// The four texels around a point and the fractions towards the right and lower ones.
    #[inline]
    fn corners(&self, uv: Vec2f) -> ([Vec3f; 4], [f32; 2]) {
        let (places, fractions) = self.places(uv);
        (places.map(|i| self.texel(i)), fractions)
    }

    /// Indices of these texels, and the fractions.
    #[inline]
    fn places(&self, uv: Vec2f) -> ([usize; 4], [f32; 2]) {
        let axis = |u: f32, n: usize| {
            let x = u * n as f32 - 0.5;
            let floor = x.floor();
            let fraction = x - floor;
            // A cast of what is not a number gives 0.
            let i = floor as i64;
            let i = i.clamp(-(1 << 40), 1 << 40);
            let fraction = if fraction.is_finite() { fraction } else { 0.0 };
            (self.wrapped(i, n), self.wrapped(i + 1, n), fraction)
        };
        let (x0, x1, fx) = axis(uv.x, self.width);
        let (y0, y1, fy) = axis(uv.y, self.height);
        let at = |x: usize, y: usize| y * self.width + x;
        ([at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1)], [fx, fy])
    }

    /// Adjoint of [`Self::color`] for the gradient `g`: calls `add` with texels and their shares of it. That of a texel of
    /// one channel, which all three colours show, is in the first component.
    pub fn color_vjp(&self, uv: Vec2f, g: Vec3f, mut add: impl FnMut(usize, Vec3f)) {
        let g = if self.channels() == 1 { Vec3f { x: g.x + g.y + g.z, y: 0.0, z: 0.0 } } else { g };
        if self.filter == BitmapFilter::Nearest {
            return add(self.nearest(uv), g);
        }
        let (corners, [fx, fy]) = self.places(uv);
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        for (texel, weight) in corners.into_iter().zip(weights) {
            if weight != 0.0 {
                add(texel, g * weight);
            }
        }
    }

    /// The texel that a point lies in.
    #[inline]
    fn nearest(&self, uv: Vec2f) -> usize {
        let index = |u: f32, n: usize| {
            let i = ((u * n as f32).floor() as i64).clamp(-(1 << 40), 1 << 40);
            self.wrapped(i, n)
        };
        index(uv.y, self.height) * self.width + index(uv.x, self.width)
    }

    /// Colour at texture coordinates.
    pub fn color(&self, uv: Vec2f) -> Vec3f {
        if self.filter == BitmapFilter::Nearest {
            return self.texel(self.nearest(uv));
        }
        let ([a, b, c, d], [fx, fy]) = self.corners(uv);
        (a * (1.0 - fx) + b * fx) * (1.0 - fy) + (c * (1.0 - fx) + d * fx) * fy
    }

    /// Derivative of the luminance with respect to the texture coordinates; zero without interpolation.
    pub(super) fn gradient(&self, uv: Vec2f) -> Vec2f {
        if self.filter == BitmapFilter::Nearest {
            return vec2(0.0, 0.0);
        }
        let (corners, [fx, fy]) = self.corners(uv);
        let [a, b, c, d] =
            corners.map(|p| if self.channels == 1 { p.x } else { photofit_image::luminance(p.to_array()) });
        let (w, h) = (self.width as f32, self.height as f32);
        vec2(w * ((b - a) * (1.0 - fy) + (d - c) * fy), h * ((c - a) * (1.0 - fx) + (d - b) * fx))
    }
}

//! Pictures that lights throw through their position.

use super::luminance;
use photofit_scalar::{Vec2f, Vec3f, vec2, vec3};
use photofit_scene::LightPicture;
use photofit_scene::graph::{SurfacePoint, Texture};

/// Most looks along a side that find out how bright a picture is on average.
const LOOKS: usize = 256;
/// Share of its brightest value that a picture counts with at least, so that light between the looks is found too.
const LEAST: f32 = 1e-3;

/// A picture with what sampling knows of it.
#[derive(Clone, Debug, PartialEq)]
pub struct ThrownPicture {
    given: LightPicture,
    mean: f32,
}

impl ThrownPicture {
    /// Takes a picture in world space.
    pub fn new(given: LightPicture) -> Self {
        let mean = mean(&given.texture);
        Self { given, mean }
    }

    /// The picture as it was given.
    pub fn given(&self) -> &LightPicture {
        &self.given
    }

    /// The rule that the picture breaks beside a light along `axis`, if it breaks one.
    pub(super) fn broken(&self, axis: Vec3f) -> Option<&'static str> {
        let (u, v) = self.frame();
        let unit = |d: Vec3f| (d.length_squared() - 1.0).abs() < 1e-3;
        let skew = u.dot(v).abs().max(u.dot(axis).abs()).max(v.dot(axis).abs());
        // Written so that NaN fails.
        if !(unit(u) && unit(v) && skew < 1e-3) {
            return Some("its picture has unit axes at right angles to each other and to its direction");
        }
        if !self.given.half.iter().all(|h| *h > 0.0 && h.is_finite()) {
            return Some("its picture has positive, finite sides");
        }
        (!self.mean.is_finite() || self.mean < 0.0).then_some(
            "its picture has values that are negative or not finite; they must be finite and not negative",
        )
    }

    fn frame(&self) -> (Vec3f, Vec3f) {
        let (u, v) = (self.given.u, self.given.v);
        (vec3(u.x, u.y, u.z), vec3(v.x, v.y, v.z))
    }

    /// Luminance of the whole picture on average, an estimate; never 0 where there is light.
    pub(super) fn mean(&self) -> f32 {
        self.mean
    }

    /// Area of the picture at distance 1.
    pub(super) fn area(&self) -> f32 {
        4.0 * self.given.half[0] * self.given.half[1]
    }

    /// What the picture leaves of light that goes in the unit direction `d`, whose cosine with the axis is `cosine`; `None`
    /// beside the picture.
    #[inline]
    pub(super) fn color(&self, d: Vec3f, cosine: f32) -> Option<Vec3f> {
        let (u, v) = self.frame();
        let [x, y] = self.given.half;
        let uv = vec2(0.5 + 0.5 * d.dot(u) / (cosine * x), 0.5 + 0.5 * d.dot(v) / (cosine * y));
        let inside = |t: f32| (0.0..=1.0).contains(&t);
        (cosine > 0.0 && inside(uv.x) && inside(uv.y)).then(|| texel_at(&self.given.texture, uv))
    }
}

fn texel_at(texture: &Texture, uv: Vec2f) -> Vec3f {
    texture.color(&SurfacePoint { uv, color: Default::default(), piece: 0 })
}

fn mean(texture: &Texture) -> f32 {
    if let Some(color) = texture.constant() {
        return luminance(color);
    }
    let size = match texture {
        Texture::Bitmap { image, .. } => image.size().map(|n| n.clamp(16, LOOKS)),
        _ => [LOOKS; 2],
    };
    let at = |i: usize, n: usize| (i as f32 + 0.5) / n as f32;
    let mut sum = 0.0_f64;
    for row in 0..size[1] {
        for column in 0..size[0] {
            sum += f64::from(luminance(texel_at(texture, vec2(at(column, size[0]), at(row, size[1])))));
        }
    }
    let mean = (sum / (size[0] * size[1]) as f64) as f32;
    let most = texture.largest().map_or(0.0, luminance);
    if mean.is_nan() { mean } else { mean.max(LEAST * most) }
}

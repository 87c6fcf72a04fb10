//! Textures as files hold them: four channels of 8 or 16 bits or floating point, with their mip chain in one array.

#[cfg(feature = "gpu")]
pub(crate) mod gpu;

use super::filter::downsample;
use super::{Lookup, MipLayout, MipRule};
use photofit_scalar::{linear_to_srgb_u8, srgb_table};
use rayon::prelude::*;
use std::sync::OnceLock;

/// Texels of one or more levels, red, green, blue and alpha; alpha is always linear.
#[derive(Clone, Debug, PartialEq)]
pub enum Texels {
    /// Colour in sRGB, 0 to 255.
    Srgb8(Vec<[u8; 4]>),
    /// Numbers of 0 to 1 in 255 steps.
    Unorm8(Vec<[u8; 4]>),
    /// Numbers of 0 to 1 in 65535 steps.
    Unorm16(Vec<[u16; 4]>),
    /// Linear numbers of any size: textures that are optimised.
    F32(Vec<[f32; 4]>),
}

impl Texels {
    /// Number of texels.
    pub fn len(&self) -> usize {
        match self {
            Self::Srgb8(t) | Self::Unorm8(t) => t.len(),
            Self::Unorm16(t) => t.len(),
            Self::F32(t) => t.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes of all texels.
    pub fn bytes(&self) -> usize {
        let texel = match self {
            Self::Srgb8(_) | Self::Unorm8(_) => 4,
            Self::Unorm16(_) => 8,
            Self::F32(_) => 16,
        };
        self.len() * texel
    }
}

/// A texture of four channels, read forward; the levels are rounded to the format of the texels, but averaged in linear
/// light and carried on in floating point.
#[derive(Clone, Debug)]
pub struct MipTexture {
    layout: MipLayout,
    rule: MipRule,
    texels: Texels,
    /// Bytes to linear light.
    decode: &'static [f32; 256],
    /// Worked out when it is asked for.
    mean: OnceLock<[f64; 4]>,
}

impl MipTexture {
    /// Colour in the first three channels, alpha in the last: the rule for textures whose alpha is coverage.
    pub const COVERAGE: MipRule = MipRule::Coverage { colors: 3, alpha: 3 };

    /// A texture from its base level, with the levels of `layout`.
    ///
    /// # Panics
    /// If there are not as many texels as the base level of `layout` has, or the rule is [`MipRule::Free`].
    pub fn new(base: Texels, layout: MipLayout, rule: MipRule) -> Self {
        let (level, decode) = (layout.levels()[0], srgb_table());
        assert_eq!(base.len(), level.width as usize * level.height as usize, "texels of the base level");
        assert!(rule != MipRule::Free, "levels that follow from the base");
        let unit = 1.0 / 255.0;
        let byte = |x: f32| (x * 255.0 + 0.5) as u8;
        let texels = match base {
            Texels::Srgb8(t) => Texels::Srgb8(build(
                t,
                &layout,
                rule,
                |[r, g, b, a]: [u8; 4]| {
                    [decode[r as usize], decode[g as usize], decode[b as usize], f32::from(a) * unit]
                },
                |[r, g, b, a]| [linear_to_srgb_u8(r), linear_to_srgb_u8(g), linear_to_srgb_u8(b), byte(a)],
            )),
            Texels::Unorm8(t) => Texels::Unorm8(build(
                t,
                &layout,
                rule,
                |t: [u8; 4]| t.map(|b| f32::from(b) * unit),
                |t| t.map(byte),
            )),
            Texels::Unorm16(t) => Texels::Unorm16(build(
                t,
                &layout,
                rule,
                |t: [u16; 4]| t.map(|b| f32::from(b) / 65535.0),
                |t| t.map(|x| (x * 65535.0 + 0.5) as u16),
            )),
            Texels::F32(t) => Texels::F32(build(t, &layout, rule, |t| t, |t| t)),
        };
        Self { layout, rule, texels, decode, mean: OnceLock::new() }
    }

    /// A texture whose levels, one after the other, are all given: those of a file that holds its own. `rule` is that by
    /// which [`Self::set_base`] averages.
    ///
    /// # Panics
    /// If there are not as many texels as `layout` has, or the rule is [`MipRule::Free`].
    pub fn with_levels(levels: Texels, layout: MipLayout, rule: MipRule) -> Self {
        assert_eq!(levels.len(), layout.texels(), "texels of all levels");
        assert!(rule != MipRule::Free, "a rule for new base levels");
        Self { layout, rule, texels: levels, decode: srgb_table(), mean: OnceLock::new() }
    }

    /// Sizes and places of the levels.
    pub fn layout(&self) -> &MipLayout {
        &self.layout
    }

    /// All texels, level by level.
    pub fn texels(&self) -> &Texels {
        &self.texels
    }

    /// Replaces the base level by linear texels, kept as [`Texels::F32`], and averages the coarse levels anew.
    ///
    /// # Panics
    /// If there are not as many texels as the base level has.
    pub fn set_base(&mut self, linear: &[[f32; 4]]) {
        *self = self.with_base(linear);
    }

    /// The same with another base level, as by [`Self::set_base`].
    ///
    /// # Panics
    /// As [`Self::set_base`].
    #[must_use]
    pub fn with_base(&self, linear: &[[f32; 4]]) -> Self {
        Self::new(Texels::F32(linear.to_vec()), self.layout.clone(), self.rule)
    }

    /// The base level in linear light.
    pub fn linear_base(&self) -> Vec<[f32; 4]> {
        let level = self.layout.levels()[0];
        (0..level.width as usize * level.height as usize).map(|i| self.texel(i)).collect()
    }

    /// The mean of the base level in linear light, all texels alike: exact where coarse levels are rounded. Worked out once.
    pub fn mean(&self) -> [f64; 4] {
        *self.mean.get_or_init(|| {
            let level = self.layout.levels()[0];
            let count = level.width as usize * level.height as usize;
            let mut sum = [0.0; 4];
            for i in 0..count {
                sum.iter_mut().zip(self.texel(i)).for_each(|(s, v)| *s += f64::from(v));
            }
            sum.map(|s| s / count as f64)
        })
    }

    /// A texel in linear light.
    fn texel(&self, i: usize) -> [f32; 4] {
        match &self.texels {
            Texels::Srgb8(t) => {
                let [r, g, b, a] = t[i];
                let color = [r, g, b].map(|b| self.decode[b as usize]);
                [color[0], color[1], color[2], f32::from(a) / 255.0]
            }
            Texels::Unorm8(t) => t[i].map(|b| f32::from(b) / 255.0),
            Texels::Unorm16(t) => t[i].map(|b| f32::from(b) / 65535.0),
            Texels::F32(t) => t[i],
        }
    }

    /// The filtered value, in linear light, of a lookup planned for [`Self::layout`].
    #[inline(always)]
    pub fn read(&self, at: &Lookup<f32>) -> [f32; 4] {
        const UNIT: f32 = 1.0 / 255.0;
        match &self.texels {
            Texels::Srgb8(t) => {
                let decode = self.decode;
                let [r, g, b, a] = at.blend(|_| {
                    |i: usize| {
                        let [r, g, b, a] = t[i];
                        [decode[r as usize], decode[g as usize], decode[b as usize], f32::from(a)]
                    }
                });
                [r, g, b, a * UNIT]
            }
            Texels::Unorm8(t) => at.blend(|_| |i: usize| t[i].map(f32::from)).map(|x| x * UNIT),
            Texels::Unorm16(t) => at.blend(|_| |i: usize| t[i].map(f32::from)).map(|x| x * (1.0 / 65535.0)),
            Texels::F32(t) => at.blend(|_| |i: usize| &t[i]),
        }
    }

    /// The filtered alpha alone.
    #[inline(always)]
    pub fn read_alpha(&self, at: &Lookup<f32>) -> f32 {
        let [alpha] = match &self.texels {
            Texels::Srgb8(t) | Texels::Unorm8(t) => {
                at.blend(|_| |i: usize| [f32::from(t[i][3]) * (1.0 / 255.0)])
            }
            Texels::Unorm16(t) => at.blend(|_| |i: usize| [f32::from(t[i][3]) * (1.0 / 65535.0)]),
            Texels::F32(t) => at.blend(|_| |i: usize| [t[i][3]]),
        };
        alpha
    }
}

/// The levels of `layout` one after the other.
fn build<P: Copy + Default + Send + Sync>(
    base: Vec<P>,
    layout: &MipLayout,
    rule: MipRule,
    decode: impl Fn(P) -> [f32; 4] + Sync,
    encode: impl Fn([f32; 4]) -> P + Sync,
) -> Vec<P> {
    let mut texels = base;
    texels.reserve_exact(layout.texels() - texels.len());
    let mut above: Vec<[f32; 4]> = Vec::new();
    for pair in layout.levels().windows(2) {
        let size = (pair[0].width as usize, pair[0].height as usize);
        let mut below = vec![[0.0; 4]; pair[1].width as usize * pair[1].height as usize];
        if above.is_empty() {
            downsample(|i| decode(texels[i]), size, rule, &mut below);
        } else {
            downsample(|i| &above[i], size, rule, &mut below);
        }
        let at = texels.len();
        texels.resize(at + below.len(), P::default());
        texels[at..]
            .par_iter_mut()
            .zip(&below)
            .with_min_len(1 << 12)
            .for_each(|(texel, linear)| *texel = encode(*linear));
        above = below;
    }
    texels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Filter, LevelOfDetail, Pyramid, Sampler, Texture, Wrap, lookup, sample};
    use photofit_gradcheck::Uniform;
    use photofit_scalar::vec2;

    fn bytes(n: usize) -> Vec<[u8; 4]> {
        (0..n).map(|i| [(i * 37 % 256) as u8, 9, (i * 91 % 256) as u8, (i * 5 % 256) as u8]).collect()
    }

    /// Every format and rule against a pyramid in floating point, at any level and place.
    #[test]
    fn reads_agree_with_the_pyramid_to_half_a_step() {
        let (width, height) = (13, 6);
        let sampler =
            Sampler { wrap_u: Wrap::MirroredRepeat, wrap_v: Wrap::Repeat, filter: Filter::Trilinear };
        for rule in [MipRule::Area, MipTexture::COVERAGE] {
            for (format, step) in
                [("srgb8", 0.5 / 255.0), ("unorm8", 0.5 / 255.0), ("unorm16", 0.5 / 65535.0), ("f32", 0.0)]
            {
                let layout = MipLayout::full(width, height);
                let base = bytes(width * height);
                let texels = match format {
                    "srgb8" => Texels::Srgb8(base),
                    "unorm8" => Texels::Unorm8(base),
                    "unorm16" => {
                        Texels::Unorm16(base.iter().map(|t| t.map(|b| u16::from(b) * 251)).collect())
                    }
                    _ => Texels::F32(
                        base.iter()
                            .map(|t| t.map(f32::from))
                            .map(|[r, g, b, a]| [r * 0.03 - 2.0, g, b * 0.01, a / 255.0])
                            .collect(),
                    ),
                };
                let stored = MipTexture::new(texels, layout, rule);
                let pyramid =
                    Pyramid::with_rule(Texture { width, height, texels: stored.linear_base() }, rule);
                let mut random = Uniform::new(9);
                for _ in 0..200 {
                    let uv = vec2(random.range(-2.0, 3.0) as f32, random.range(-2.0, 3.0) as f32);
                    let lod = LevelOfDetail { level: random.range(-0.5, 3.0) as f32 };
                    let at = lookup(stored.layout(), uv, Some(&lod), &sampler);
                    let got = stored.read(&at);
                    let expected = sample(&pyramid, &lookup(&pyramid, uv, Some(&lod), &sampler));
                    assert!((stored.read_alpha(&at) - got[3]).abs() < 1e-6, "{format} alpha alone");
                    for c in 0..4 {
                        // The steepest part of the transfer makes a step of sRGB 2.3 times as long.
                        let limit = if format == "srgb8" && c < 3 { 2.3 * step } else { step };
                        let error = (got[c] - expected[c]).abs();
                        assert!(
                            error <= limit + 2e-6,
                            "{format} {rule:?} channel {c} at {uv:?} {lod:?}: {error}"
                        );
                    }
                }
            }
        }
    }

    /// One white texel of 256 x 256: every coarse level beyond the first ones rounds it away.
    #[test]
    fn means_are_those_of_the_base_level() {
        let side = 256;
        let mut base = vec![[0, 0, 0, 255]; side * side];
        base[side * 77 + 200] = [255; 4];
        let mut texture = MipTexture::new(Texels::Srgb8(base), MipLayout::full(side, side), MipRule::Area);
        let one = 1.0 / (side * side) as f64;
        assert_eq!(texture.mean(), [one, one, one, 1.0]);
        texture.set_base(&vec![[0.25, 3.0, 0.0, 1.0]; side * side]);
        assert_eq!(texture.mean(), [0.25, 3.0, 0.0, 1.0], "another base has another mean");
    }

    #[test]
    fn hidden_colours_do_not_bleed() {
        let texels = vec![[200, 0, 0, 255], [0, 255, 0, 0], [0, 255, 0, 0], [0, 255, 0, 0]];
        let coarsest =
            |rule| match MipTexture::new(Texels::Srgb8(texels.clone()), MipLayout::full(2, 2), rule).texels {
                Texels::Srgb8(t) => t[4],
                other => unreachable!("{other:?}"),
            };
        assert_eq!(coarsest(MipTexture::COVERAGE), [200, 0, 0, 64]);
        assert!(coarsest(MipRule::Area)[1] > 200);
    }

    #[test]
    fn given_levels_are_read_as_they_are() {
        let layout = MipLayout::full(4, 4);
        let level = |k: usize| [[200, 0, 0, 255], [0, 100, 0, 255], [0, 0, 50, 255]][k];
        let texels = (0..3).flat_map(|k| vec![level(k); layout.levels()[k].width.pow(2) as usize]).collect();
        let mut own = MipTexture::with_levels(Texels::Unorm8(texels), layout, MipRule::Area);
        let read = |t: &MipTexture, level: f32| {
            let lod = LevelOfDetail { level };
            t.read(&lookup(t.layout(), vec2(0.4, 0.6), Some(&lod), &Sampler::default()))
        };
        for k in 0..3 {
            let expected = level(k).map(|b| f32::from(b) / 255.0);
            let got = read(&own, k as f32);
            assert!(got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "level {k}: {got:?}");
        }
        own.set_base(&[[0.5; 4]; 16]);
        assert_eq!(read(&own, 2.0), [0.5; 4], "another base has other levels");
    }

    #[test]
    fn replaced_texels_are_read_at_once() {
        let mut texture = MipTexture::new(Texels::Srgb8(bytes(16)), MipLayout::full(4, 4), MipRule::Area);
        assert_eq!(texture.texels().bytes(), 4 * 21);
        texture.set_base(&[[3.5, -1.0, 0.25, 0.5]; 16]);
        assert_eq!(texture.texels().bytes(), 16 * 21);
        for level in [0.0, 0.7, 2.0] {
            let at =
                lookup(texture.layout(), vec2(0.3, 0.9), Some(&LevelOfDetail { level }), &Sampler::default());
            assert_eq!(texture.read(&at), [3.5, -1.0, 0.25, 0.5]);
        }
    }
}

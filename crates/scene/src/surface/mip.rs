//! 8-bit mip chains, averaged in linear light.

use crate::TextureImage;
use photofit_image::{linear_to_srgb_u8, mip_levels, mip_size, srgb_u8_to_linear};
use rayon::prelude::*;

/// How the bytes of a texture are averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Encoding {
    /// The colour is sRGB (alpha never is).
    pub(super) srgb: bool,
    /// Colours count by their alpha, so that what cannot be seen does not bleed in.
    pub(super) weighted: bool,
}

/// A texture with all its levels, one after the other.
#[derive(Debug)]
pub(super) struct MipTexture {
    pub(super) srgb: bool,
    pub(super) texels: Vec<[u8; 4]>,
}

/// Offset and size of the levels of a texture of some size.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Levels(pub(super) Vec<Level>);

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Level {
    pub(super) offset: u32,
    pub(super) width: u32,
    pub(super) height: u32,
}

impl Levels {
    /// The first `count` levels, at least one.
    fn new(width: usize, height: usize, count: usize) -> Self {
        let (mut size, mut offset) = ((width, height), 0);
        let mut levels = Vec::with_capacity(count);
        for _ in 0..count.max(1) {
            levels.push(Level { offset: offset as u32, width: size.0 as u32, height: size.1 as u32 });
            offset += size.0 * size.1;
            size = mip_size(size.0, size.1);
        }
        Self(levels)
    }

    pub(super) fn full(width: usize, height: usize) -> Self {
        Self::new(width, height, mip_levels(width, height))
    }

    pub(super) fn base(width: usize, height: usize) -> Self {
        Self::new(width, height, 1)
    }

    fn texels(&self) -> usize {
        self.0.iter().map(|l| l.width as usize * l.height as usize).sum()
    }
}

/// The texels of an image on `levels`: the box filter of [`photofit_image::mip_down`], rounded to bytes on each level
/// but carried on in floating point.
pub(super) fn build(image: &TextureImage, levels: &Levels, encoding: Encoding) -> MipTexture {
    let mut texels = Vec::with_capacity(levels.texels());
    texels.extend_from_slice(&image.texels);
    let mut above: Vec<[f32; 4]> = Vec::new();
    for pair in levels.0.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        let (width, height) = (from.width as usize, from.height as usize);
        let fetch = |i: usize| match above.get(i) {
            Some(&t) => t,
            None => decode(image.texels[i], encoding.srgb),
        };
        let mut below = vec![[0.0_f32; 4]; to.width as usize * to.height as usize];
        below.par_chunks_mut(to.width as usize).enumerate().for_each(|(y, row)| {
            let (y0, wy) = taps(y, height);
            for (x, out) in row.iter_mut().enumerate() {
                let (x0, wx) = taps(x, width);
                *out = average(&fetch, width, (x0, wx), (y0, wy), encoding.weighted);
            }
        });
        let at = texels.len();
        texels.resize(at + below.len(), [0; 4]);
        texels[at..].par_iter_mut().zip(&below).with_min_len(1 << 12).for_each(|(byte, t)| {
            *byte = encode(*t, encoding.srgb);
        });
        above = below;
    }
    MipTexture { srgb: encoding.srgb, texels }
}

fn average(
    fetch: &impl Fn(usize) -> [f32; 4],
    width: usize,
    (x0, wx): (usize, [f32; 3]),
    (y0, wy): (usize, [f32; 3]),
    weighted: bool,
) -> [f32; 4] {
    let (mut plain, mut seen, mut alpha) = ([0.0; 3], [0.0; 3], 0.0);
    for (j, wy) in wy.iter().enumerate().filter(|w| *w.1 > 0.0) {
        for (i, wx) in wx.iter().enumerate().filter(|w| *w.1 > 0.0) {
            let t = fetch((y0 + j) * width + x0 + i);
            let w = wx * wy;
            alpha += w * t[3];
            for c in 0..3 {
                plain[c] += w * t[c];
                seen[c] += w * t[3] * t[c];
            }
        }
    }
    let rgb = if weighted && alpha > 0.0 { seen.map(|c| c / alpha) } else { plain };
    [rgb[0], rgb[1], rgb[2], alpha]
}

/// First texel and weights under output texel `i` of an axis of `n`; see [`photofit_image::mip_down`].
fn taps(i: usize, n: usize) -> (usize, [f32; 3]) {
    if n == 1 {
        return (0, [1.0, 0.0, 0.0]);
    }
    if n.is_multiple_of(2) {
        return (2 * i, [0.5, 0.5, 0.0]);
    }
    let (m, size) = ((n / 2) as f32, n as f32);
    (2 * i, [(m - i as f32) / size, m / size, (i as f32 + 1.0) / size])
}

fn decode(t: [u8; 4], srgb: bool) -> [f32; 4] {
    let unit = |b: u8| f32::from(b) / 255.0;
    let color = |b: u8| if srgb { srgb_u8_to_linear(b) } else { unit(b) };
    [color(t[0]), color(t[1]), color(t[2]), unit(t[3])]
}

fn encode(t: [f32; 4], srgb: bool) -> [u8; 4] {
    let unit = |x: f32| (x * 255.0 + 0.5) as u8;
    let color = |x: f32| if srgb { linear_to_srgb_u8(x) } else { unit(x) };
    [color(t[0]), color(t[1]), color(t[2]), unit(t[3])]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_agree_with_the_float_pyramid() {
        let (width, height) = (13, 6);
        let texels: Vec<[u8; 4]> =
            (0..width * height).map(|i| [(i * 37 % 256) as u8, 9, 200, (i % 256) as u8]).collect();
        let image = TextureImage { width, height, texels, ..TextureImage::default() };
        let levels = Levels::full(width, height);
        let built = build(&image, &levels, Encoding { srgb: true, weighted: false });
        assert_eq!(levels.0.last().map(|l| (l.width, l.height)), Some((1, 1)));
        let mut data: Vec<f32> = image.texels.iter().flat_map(|t| decode(*t, true)).collect();
        for pair in levels.0.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            let mut below = vec![0.0; 4 * (to.width * to.height) as usize];
            photofit_image::mip_down(&data, from.width as usize, from.height as usize, 4, &mut below);
            for (i, t) in below.as_chunks::<4>().0.iter().enumerate() {
                let byte = built.texels[to.offset as usize + i];
                let expected = encode(*t, true);
                for c in 0..4 {
                    assert!(byte[c].abs_diff(expected[c]) <= 1, "{to:?} texel {i}: {byte:?} {expected:?}");
                }
            }
            data = below;
        }
    }

    #[test]
    fn hidden_colours_do_not_bleed() {
        let texels = vec![[200, 0, 0, 255], [0, 255, 0, 0], [0, 255, 0, 0], [0, 255, 0, 0]];
        let image = TextureImage { width: 2, height: 2, texels, ..TextureImage::default() };
        let levels = Levels::full(2, 2);
        let seen = build(&image, &levels, Encoding { srgb: true, weighted: true });
        assert_eq!(seen.texels[4], [200, 0, 0, 64]);
        let plain = build(&image, &levels, Encoding { srgb: true, weighted: false });
        assert!(plain.texels[4][1] > 200, "{:?}", plain.texels[4]);
    }
}

//! The film: sums, sums of squares and counts per pixel, in double precision, tile by tile.
//!
//! A pixel's samples are added in the order of their index, whatever thread renders them and however the work is cut
//! into passes: a picture depends on the number of samples of its pixels alone.

mod aov;
mod filter;
mod state;

pub use aov::Aov;
pub use filter::Filter;
pub(crate) use state::Key;

use crate::camera::Prepared;
use crate::integrator::PathSample;
use crate::world::World;
use photofit_image::Image;
use photofit_scalar::Vec3f;

/// Pixels along the side of a tile.
pub(crate) const TILE: usize = 16;
/// Sums that every film keeps: colour, alpha, squares of the colour, samples with a surface.
const BASE: usize = 8;
const ALPHA: usize = 3;
const SQUARES: usize = 4;
const HITS: usize = 7;
/// Depth where there is no surface.
const FAR_AWAY: f32 = 1e10;

/// What the film keeps of the samples of a tile.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tile {
    /// Left and upper pixel.
    pub(crate) x: usize,
    pub(crate) y: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Samples of every pixel.
    pub(crate) count: u32,
    /// Samples are still wanted.
    pub(crate) active: bool,
    /// Contributions that were left out because they were not finite.
    pub(crate) not_finite: u64,
    /// `height * width` times the sums of a pixel.
    sums: Vec<f64>,
    /// Instance of the first sample, counted from 1.
    ids: Vec<u32>,
}

/// Pixels on their way to a picture.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Film {
    pub(crate) width: usize,
    pub(crate) height: usize,
    aovs: Vec<Aov>,
    stride: usize,
    pub(crate) tiles: Vec<Tile>,
}

/// What auxiliary sums are made of beside the sample: the world and its cameras.
pub(crate) struct Observer<'a> {
    pub(crate) world: &'a World,
    pub(crate) camera: Prepared,
    pub(crate) previous: Option<Prepared>,
    /// Size of the picture, for movements in pixels.
    pub(crate) size: [f32; 2],
}

impl Film {
    /// Most bytes that a film may have: 8 GiB, a picture of 7680 x 4320 pixels with all auxiliary images.
    pub(crate) const MAX_BYTES: u64 = 8 << 30;

    /// Bytes of each pixel.
    pub(crate) fn pixel_bytes(aovs: &[Aov]) -> u64 {
        let (aovs, stride) = kept(aovs);
        (stride * size_of::<f64>() + if aovs.contains(&Aov::Instance) { size_of::<u32>() } else { 0 }) as u64
    }

    pub(crate) fn new(width: usize, height: usize, aovs: &[Aov]) -> Self {
        let (aovs, stride) = kept(aovs);
        let ids = aovs.contains(&Aov::Instance);
        let mut tiles = Vec::new();
        for y in (0..height).step_by(TILE) {
            for x in (0..width).step_by(TILE) {
                let (w, h) = (TILE.min(width - x), TILE.min(height - y));
                tiles.push(Tile {
                    x,
                    y,
                    width: w,
                    height: h,
                    count: 0,
                    active: true,
                    not_finite: 0,
                    sums: vec![0.0; w * h * stride],
                    ids: if ids { vec![0; w * h] } else { Vec::new() },
                });
            }
        }
        Self { width, height, aovs, stride, tiles }
    }

    /// Tiles along x.
    pub(crate) fn columns(&self) -> usize {
        self.width.div_ceil(TILE)
    }

    /// How samples are added to a tile of this film.
    pub(crate) fn recorder<'a>(&self, observer: &'a Observer<'a>) -> Recorder<'a> {
        Recorder { observer, aovs: self.aovs.clone(), stride: self.stride }
    }

    /// Samples taken so far, over all pixels.
    pub(crate) fn samples(&self) -> u64 {
        self.tiles.iter().map(|t| u64::from(t.count) * (t.width * t.height) as u64).sum()
    }

    /// Contributions left out so far because they were not finite.
    pub(crate) fn not_finite(&self) -> u64 {
        self.tiles.iter().map(|t| t.not_finite).sum()
    }

    /// Linear colour and alpha, premultiplied.
    pub(crate) fn picture(&self) -> Image {
        self.image(4, |sums, _, count, out| {
            for c in 0..=ALPHA {
                out[c] = (sums[c] / count) as f32;
            }
        })
    }

    /// An auxiliary image that the film was asked to keep.
    pub(crate) fn aov(&self, aov: Aov) -> Option<Image> {
        if !self.aovs.contains(&aov) {
            return None;
        }
        let from = |wanted: Aov| {
            BASE + self.aovs.iter().take_while(|a| **a != wanted).map(|a| a.sums()).sum::<usize>()
        };
        let at = from(aov);
        let channels = aov.channels().len();
        Some(match aov {
            Aov::Samples => self.image(1, |_, _, count, out| out[0] = count as f32),
            Aov::Instance => self.image(1, |_, id, _, out| out[0] = id as f32),
            Aov::Variance => self.image(3, |sums, _, count, out| {
                for c in 0..3 {
                    out[c] = (variance(sums[c], sums[SQUARES + c], count) / count) as f32;
                }
            }),
            Aov::Indirect => {
                let direct = from(Aov::Direct);
                self.image(3, |sums, _, count, out| {
                    for c in 0..3 {
                        out[c] = ((sums[c] - sums[direct + c]) / count).max(0.0) as f32;
                    }
                })
            }
            Aov::Depth | Aov::Position => self.image(channels, |sums, _, _, out| {
                let hits = sums[HITS];
                for (c, o) in out.iter_mut().enumerate() {
                    let none = if aov == Aov::Depth { FAR_AWAY } else { 0.0 };
                    *o = if hits > 0.0 { (sums[at + c] / hits) as f32 } else { none };
                }
            }),
            _ => self.image(channels, |sums, _, count, out| {
                for (c, o) in out.iter_mut().enumerate() {
                    *o = (sums[at + c] / count) as f32;
                }
            }),
        })
    }

    /// Variance of the samples of every pixel, three channels.
    pub(crate) fn sample_variance(&self) -> Image {
        self.image(3, |sums, _, count, out| {
            for c in 0..3 {
                out[c] = variance(sums[c], sums[SQUARES + c], count) as f32;
            }
        })
    }

    /// An image of what `pixel` makes of sums, instance and count; pixels without samples stay 0.
    fn image(&self, channels: usize, pixel: impl Fn(&[f64], u32, f64, &mut [f32])) -> Image {
        let mut image = Image::new(self.width, self.height, channels);
        for tile in self.tiles.iter().filter(|t| t.count > 0) {
            for (i, sums) in tile.sums.chunks_exact(self.stride).enumerate() {
                let (x, y) = (tile.x + i % tile.width, tile.y + i / tile.width);
                let id = tile.ids.get(i).copied().unwrap_or(0);
                pixel(sums, id, f64::from(tile.count), image.pixel_mut(x, y));
            }
        }
        image
    }

    /// Mean luminance of the picture so far.
    pub(crate) fn mean_luminance(&self) -> f64 {
        let (mut sum, mut pixels) = (0.0, 0.0);
        for tile in self.tiles.iter().filter(|t| t.count > 0) {
            for sums in tile.sums.chunks_exact(self.stride) {
                sum += luminance(sums) / f64::from(tile.count);
                pixels += 1.0;
            }
        }
        if pixels > 0.0 { sum / pixels } else { 0.0 }
    }

    /// Root mean square over the pixels of a tile of the standard error of the luminance, relative to the luminance with
    /// `floor` added.
    pub(crate) fn tile_error(&self, tile: &Tile, floor: f64) -> f64 {
        let n = f64::from(tile.count);
        if tile.count < 2 {
            return f64::INFINITY;
        }
        let mut sum = 0.0;
        for sums in tile.sums.chunks_exact(self.stride) {
            // Standard deviations add up as if channels were fully correlated: an upper bound.
            let deviation: f64 =
                (0..3).map(|c| LUMINANCE[c] * variance(sums[c], sums[SQUARES + c], n).sqrt()).sum();
            let level = luminance(sums) / n + floor;
            if level > 0.0 {
                let e = deviation / (n.sqrt() * level);
                sum += e * e;
            }
        }
        (sum / (tile.width * tile.height) as f64).sqrt()
    }
}

/// The auxiliary images that a film keeps for those that are wanted, and sums of a pixel.
fn kept(aovs: &[Aov]) -> (Vec<Aov>, usize) {
    let mut aovs = aovs.to_vec();
    if aovs.contains(&Aov::Indirect) && !aovs.contains(&Aov::Direct) {
        aovs.push(Aov::Direct);
    }
    aovs.sort_unstable();
    aovs.dedup();
    let stride = BASE + aovs.iter().map(|a| a.sums()).sum::<usize>();
    (aovs, stride)
}

/// Weights of the channels in relative luminance (Rec.709).
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

fn luminance(sums: &[f64]) -> f64 {
    (0..3).map(|c| LUMINANCE[c] * sums[c]).sum()
}

/// Unbiased variance of single samples from sums.
fn variance(sum: f64, squares: f64, count: f64) -> f64 {
    if count < 2.0 { 0.0 } else { ((squares - sum * sum / count) / (count - 1.0)).max(0.0) }
}

/// Adds samples to pixels.
pub(crate) struct Recorder<'a> {
    observer: &'a Observer<'a>,
    aovs: Vec<Aov>,
    stride: usize,
}

impl Recorder<'_> {
    /// Adds samples to pixel `i` of a tile, from `first` on in the order of their indices.
    #[inline(always)]
    pub(crate) fn add(
        &self,
        tile: &mut Tile,
        i: usize,
        first: u32,
        samples: impl Iterator<Item = PathSample>,
    ) {
        let all = &mut tile.sums[i * self.stride..(i + 1) * self.stride];
        let (sums, further) = all.split_at_mut(BASE);
        // In registers meanwhile.
        let mut totals: [f64; BASE] = std::array::from_fn(|k| sums[k]);
        let mut not_finite = 0;
        for (index, sample) in (first..).zip(samples) {
            // A value that is not finite would make the pixel useless; it counts as black.
            let finite = sample.radiance.is_finite();
            let radiance = if finite { sample.radiance } else { Vec3f::zero() };
            not_finite += u64::from(sample.not_finite) + u64::from(!finite);
            for (c, v) in radiance.to_array().into_iter().enumerate() {
                let v = f64::from(v);
                totals[c] += v;
                totals[SQUARES + c] += v * v;
            }
            totals[ALPHA] += f64::from(sample.alpha);
            if self.aovs.is_empty() {
                continue;
            }
            let hit = sample.first.instance != u32::MAX;
            totals[HITS] += f64::from(u8::from(hit));
            if index == 0
                && let Some(id) = tile.ids.get_mut(i)
            {
                *id = sample.first.instance.wrapping_add(1);
            }
            self.auxiliary(further, &sample, hit);
        }
        sums.copy_from_slice(&totals);
        tile.not_finite += not_finite;
    }

    fn auxiliary(&self, sums: &mut [f64], sample: &PathSample, hit: bool) {
        let (first, observer) = (&sample.first, self.observer);
        let mut at = 0;
        let mut put = |values: &[f64]| {
            for v in values {
                sums[at] += if v.is_finite() { *v } else { 0.0 };
                at += 1;
            }
        };
        let three = |v: Vec3f| v.to_array().map(f64::from);
        for aov in &self.aovs {
            match aov {
                Aov::Albedo => put(&three(first.albedo)),
                Aov::Normal => put(&three(first.ns)),
                Aov::GeometricNormal => put(&three(first.ng)),
                Aov::Direct => put(&three(sample.direct)),
                Aov::Depth => put(&[if hit { f64::from(observer.camera.depth(first.p)) } else { 0.0 }]),
                Aov::Position => {
                    put(&if hit { observer.world.to_world(first.p).to_array() } else { [0.0; 3] })
                }
                Aov::Motion => put(&observer.motion(first.p)),
                Aov::Instance | Aov::Variance | Aov::Indirect | Aov::Samples => {}
            }
        }
    }
}

impl Observer<'_> {
    /// Movement of a point in the picture since the previous camera, pixels.
    fn motion(&self, p: Vec3f) -> [f64; 2] {
        let place = |c: &Prepared| c.project(p);
        match (p.is_finite(), self.previous.as_ref().and_then(place), place(&self.camera)) {
            (true, Some(then), Some(now)) => {
                let d = now - then;
                [f64::from(d.x * self.size[0]), f64::from(d.y * self.size[1])]
            }
            _ => [0.0; 2],
        }
    }
}

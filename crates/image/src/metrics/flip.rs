//! LDR-FLIP: the difference that an observer sees when flipping between two images (Andersson, Nilsson,
//! Akenine-Möller, Oskarsson, Åström and Fairchild 2020).
//!
//! 1. Both images go from sRGB to the opponent space `YCxCz` and through the contrast sensitivity filter of each channel,
//!    which removes what cannot be seen at the given number of pixels per degree.
//! 2. The colour difference is the `HyAB` distance in Hunt-adjusted `CIELab`, raised to 0.7 and mapped to `[0, 1]`.
//! 3. The feature difference compares the magnitudes of edges and points of the unfiltered luminance.
//! 4. `FLIP = colour difference ^ (1 - feature difference)`.

use super::{ErrorMap, assert_same_shape};
use crate::convolve::{Edge, Plane};
use crate::{Image, srgb_decode};
use photofit_scalar::Real;
use rayon::prelude::*;
use std::f64::consts::PI;
use std::sync::LazyLock;

/// Pixels per degree of visual angle at 0.7 m from a display 0.7 m wide with 3840 pixels.
pub const DEFAULT_PIXELS_PER_DEGREE: f32 = 67.020_64;

/// Exponent of the colour difference.
const QC: f32 = 0.7;
/// Below this fraction of the largest colour difference the mapping has slope `PT / PC`.
const PC: f32 = 0.4;
/// Value of the mapping at `PC`.
const PT: f32 = 0.95;
/// Pixels that are worked on at once.
const CHUNK: usize = 1 << 12;

/// FLIP of two RGB display images; every value lies in `[0, 1]`, 0 for equal pixels.
///
/// `pixels_per_degree` states how the images are looked at ([`DEFAULT_PIXELS_PER_DEGREE`]). Samples outside `[0, 1]`
/// are clamped, NaN counts as 0.
///
/// # Panics
/// If the shapes differ, the images have not three channels, or `pixels_per_degree` is not in `(0, 10000]`.
pub fn flip(reference: &Image, test: &Image, pixels_per_degree: f32) -> ErrorMap {
    assert_same_shape(reference, test);
    assert_eq!(reference.channels, 3, "RGB");
    assert!(pixels_per_degree > 0.0 && pixels_per_degree <= 1e4, "pixels per degree in (0, 10000]");
    let ppd = f64::from(pixels_per_degree);
    let (width, height) = (reference.width, reference.height);
    let contrast = Contrast::new(ppd);
    let feature = FeatureKernels::new(ppd);
    let ([ra, rb, rc], reference_features) = perceive(reference, &contrast, &feature);
    let ([ta, tb, tc], test_features) = perceive(test, &contrast, &feature);
    let cmax = max_color_difference();

    let mut out = vec![0.0_f32; width * height];
    out.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
        for (i, out) in out.iter_mut().enumerate() {
            let i = chunk * CHUNK + i;
            let hyab = (ra[i] - ta[i]).abs() + (rb[i] - tb[i]).hypot_fast(rc[i] - tc[i]);
            let color = redistribute(hyab.powf(QC), cmax);
            let ((re, rp), (te, tp)) = (reference_features.at(i), test_features.at(i));
            let difference = (re - te).abs().max((rp - tp).abs());
            let feature = (difference * std::f32::consts::FRAC_1_SQRT_2).sqrt();
            *out = color.powf(1.0 - feature);
        }
    });
    ErrorMap::new(width, height, out)
}

trait HypotFast {
    fn hypot_fast(self, other: Self) -> Self;
}

impl HypotFast for f32 {
    /// The values are far from overflow.
    #[inline(always)]
    fn hypot_fast(self, other: Self) -> Self {
        (self * self + other * other).sqrt()
    }
}

#[inline(always)]
fn redistribute(power: f32, cmax: f32) -> f32 {
    let knee = PC * cmax;
    if power < knee { PT / knee * power } else { PT + (power - knee) / (cmax - knee) * (1.0 - PT) }
}

/// The largest `HyAB` distance that occurs, between Hunt-adjusted green and blue, to the power `QC`.
fn max_color_difference() -> f32 {
    let (g, b) = (hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0]));
    ((g[0] - b[0]).abs() + (g[1] - b[1]).hypot_fast(g[2] - b[2])).powf(QC)
}

/// Linear Rec.709 RGB to XYZ relative to its white, and back. Dividing by the white once saves three divisions per
/// pixel, since both `YCxCz` and `CIELab` want the quotient.
struct Space {
    to_xyz: [[f32; 3]; 3],
    from_xyz: [[f32; 3]; 3],
}

static SPACE: LazyLock<Space> = LazyLock::new(|| {
    // Chromaticities of the primaries and of the white D65.
    let xy = [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06], [0.3127, 0.3290]];
    let xyz = xy.map(|[x, y]| [x / y, 1.0, (1.0 - x - y) / y]);
    let primaries: [[f64; 3]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| xyz[c][r]));
    let inverse = invert(&primaries);
    let scale: [f64; 3] = std::array::from_fn(|r| (0..3).map(|c| inverse[r][c] * xyz[3][c]).sum());
    let relative: [[f64; 3]; 3] =
        std::array::from_fn(|r| std::array::from_fn(|c| primaries[r][c] * scale[c] / xyz[3][r]));
    let single = |m: [[f64; 3]; 3]| m.map(|r| r.map(|v| v as f32));
    Space { to_xyz: single(relative), from_xyz: single(invert(&relative)) }
});

fn invert(m: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let cofactor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let det: f64 = (0..3).map(|c| m[0][c] * cofactor(0, c)).sum();
    std::array::from_fn(|r| std::array::from_fn(|c| cofactor(c, r) / det))
}

#[inline(always)]
fn apply(m: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|r| m[r][0] * v[0] + m[r][1] * v[1] + m[r][2] * v[2])
}

/// `CIELab` with chroma scaled by lightness (Hunt effect), from linear RGB.
#[inline(always)]
fn hunt_lab(rgb: [f32; 3]) -> [f32; 3] {
    const DELTA: f32 = 6.0 / 29.0;
    let f = apply(&SPACE.to_xyz, rgb)
        .map(|t| if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 });
    let lightness = 116.0 * f[1] - 16.0;
    let hunt = 0.01 * lightness;
    [lightness, 500.0 * (f[0] - f[1]) * hunt, 200.0 * (f[1] - f[2]) * hunt]
}

/// What the observer sees of one image: three planes of Hunt-adjusted `CIELab`, and edges and points.
fn perceive(image: &Image, contrast: &Contrast, kernels: &FeatureKernels) -> ([Vec<f32>; 3], Features) {
    let (width, height) = (image.width, image.height);
    let plane = |data: Vec<f32>| Plane { width, height, data };
    let (y, cx, cz) = opponent(image);
    let (y, cx, cz) = (plane(y), plane(cx), plane(cz));
    let features = kernels.features(&y);
    let mut a = y.separable(&contrast.achromatic, &contrast.achromatic, Edge::Clamp).data;
    let mut b = cx.separable(&contrast.red_green, &contrast.red_green, Edge::Clamp).data;
    let [narrow, wide] = &contrast.blue_yellow;
    let mut c = cz.separable(narrow, narrow, Edge::Clamp).data;
    let c2 = cz.separable(wide, wide, Edge::Clamp).data;
    let planes = a.par_chunks_mut(CHUNK).zip(b.par_chunks_mut(CHUNK)).zip(c.par_chunks_mut(CHUNK));
    planes.zip(c2.par_chunks(CHUNK)).for_each(|(((a, b), c), c2)| {
        for (((a, b), c), c2) in a.iter_mut().zip(b).zip(c).zip(c2) {
            let y = (*a + 16.0) / 116.0;
            let xyz = [y + *b / 500.0, y, y - (*c + c2) / 200.0];
            let rgb = apply(&SPACE.from_xyz, xyz).map(|v| v.clamp(0.0, 1.0));
            [*a, *b, *c] = hunt_lab(rgb);
        }
    });
    ([a, b, c], features)
}

/// The planes Y, Cx, Cz of an sRGB image.
fn opponent(image: &Image) -> (Vec<f32>, Vec<f32>, Vec<f32>) {
    let n = image.pixels();
    let (mut y, mut cx, mut cz) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let planes = y.par_chunks_mut(CHUNK).zip(cx.par_chunks_mut(CHUNK)).zip(cz.par_chunks_mut(CHUNK));
    planes.zip(image.data.par_chunks(3 * CHUNK)).for_each(|(((y, cx), cz), pixels)| {
        for (((y, cx), cz), p) in y.iter_mut().zip(cx).zip(cz).zip(pixels.chunks_exact(3)) {
            let rgb = std::array::from_fn(|c| srgb_decode(p[c].clamp_to(0.0, 1.0)));
            let xyz = apply(&SPACE.to_xyz, rgb);
            *y = 116.0 * xyz[1] - 16.0;
            *cx = 500.0 * (xyz[0] - xyz[1]);
            *cz = 200.0 * (xyz[1] - xyz[2]);
        }
    });
    (y, cx, cz)
}

/// Contrast sensitivity filters: sums of Gaussians `a sqrt(pi / b) exp(-pi^2 x^2 / b)`, `x` in degrees.
struct Contrast {
    achromatic: Vec<f32>,
    red_green: Vec<f32>,
    /// Blue-yellow is the sum of two Gaussians, each separable; their sum is normalised.
    blue_yellow: [Vec<f32>; 2],
}

impl Contrast {
    fn new(ppd: f64) -> Self {
        // The filters share the radius of the widest Gaussian, three standard deviations.
        let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * ppd).ceil() as usize;
        let gauss = |b: f64| -> Vec<f64> {
            let taps = (0..=2 * radius).map(|i| (i as f64 - radius as f64) / ppd);
            taps.map(|x| (-PI * PI * x * x / b).exp()).collect()
        };
        let sum = |taps: &[f64]| taps.iter().sum::<f64>();
        let single = |taps: &[f64], scale: f64| trim(taps.iter().map(|t| (t * scale) as f32).collect());
        let one = |b: f64| single(&gauss(b), 1.0 / sum(&gauss(b)));
        let two = [(34.1_f64, 0.04_f64), (13.5, 0.025)].map(|(a, b)| (a * (PI / b).sqrt(), gauss(b)));
        let total: f64 = two.iter().map(|(a, taps)| a * sum(taps).powi(2)).sum();
        // Each factor is applied along rows and along columns.
        let blue_yellow = two.map(|(a, taps)| single(&taps, (a / total).sqrt()));
        Self { achromatic: one(0.0047), red_green: one(0.0053), blue_yellow }
    }
}

/// Drops outer taps that are too small to change a single-precision sum.
fn trim(taps: Vec<f32>) -> Vec<f32> {
    let peak = taps.iter().fold(0.0_f32, |m, t| m.max(t.abs()));
    let skip = taps.iter().take(taps.len() / 2).take_while(|t| t.abs() < 1e-9 * peak).count();
    taps[skip..taps.len() - skip].to_vec()
}

/// Edge and point detectors: first and second derivatives of a Gaussian that matches the width of an edge.
struct FeatureKernels {
    gauss: Vec<f32>,
    first: Vec<f32>,
    second: Vec<f32>,
}

/// Derivatives of the luminance of one image: along x, along y, and twice along each.
struct Features {
    dx: Plane,
    dy: Plane,
    dxx: Plane,
    dyy: Plane,
}

impl Features {
    /// Magnitudes of the edge and of the point at a pixel.
    #[inline(always)]
    fn at(&self, i: usize) -> (f32, f32) {
        let edge = self.dx.data[i].hypot_fast(self.dy.data[i]);
        (edge, self.dxx.data[i].hypot_fast(self.dyy.data[i]))
    }
}

impl FeatureKernels {
    fn new(ppd: f64) -> Self {
        // Edges are 0.082 degrees wide.
        let sd = 0.5 * 0.082 * ppd;
        let radius = (3.0 * sd).ceil() as i64;
        let taps = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
            (-radius..=radius).map(|i| f(i as f64) * (-0.5 * (i as f64 / sd).powi(2)).exp()).collect()
        };
        // Positive weights sum to 1, negative ones to -1.
        let normalised = |taps: Vec<f64>| -> Vec<f32> {
            let positive: f64 = taps.iter().filter(|t| **t > 0.0).sum();
            let negative: f64 = taps.iter().filter(|t| **t < 0.0).map(|t| -t).sum();
            taps.iter().map(|t| (t / if *t < 0.0 { negative } else { positive }) as f32).collect()
        };
        Self {
            gauss: normalised(taps(&|_| 1.0)),
            first: normalised(taps(&|x| -x)),
            second: normalised(taps(&|x| (x / sd).powi(2) - 1.0)),
        }
    }

    fn features(&self, y: &Plane) -> Features {
        let luminance = y.data.iter().map(|y| (y + 16.0) / 116.0).collect();
        let luminance = Plane { width: y.width, height: y.height, data: luminance };
        let smooth = luminance.rows(&self.gauss, Edge::Clamp);
        Features {
            dx: luminance.rows(&self.first, Edge::Clamp).columns(&self.gauss, Edge::Clamp),
            dy: smooth.columns(&self.first, Edge::Clamp),
            dxx: luminance.rows(&self.second, Edge::Clamp).columns(&self.gauss, Edge::Clamp),
            dyy: smooth.columns(&self.second, Edge::Clamp),
        }
    }
}

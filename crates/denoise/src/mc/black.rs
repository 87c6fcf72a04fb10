//! Pixels without diffuse reflectance: lamps, mirrors, black paint.
//!
//! Their light divided by the floor of the albedo is up to a hundred times that of the pixels around, and follows other
//! laws: the two classes are filtered each by itself, so that lamps do not shine onto what is around them.

use super::Stages;
use super::basis::Basis;
use super::demodulate::ALBEDO_FLOOR;
use super::prepare::Prepared;
use super::regression::{CELL, regress};
use crate::Shape;

/// The pixels whose albedo is at the floor in all channels; empty if all others have no weight.
pub(crate) fn black_pixels(albedo: &[f32], weight: &[f32]) -> Vec<usize> {
    let n = weight.len();
    let dark = |i: usize| (0..3).all(|c| albedo[c * n + i] <= ALBEDO_FLOOR);
    let black: Vec<usize> = (0..n).filter(|i| weight[*i] > 0.0 && dark(*i)).collect();
    let sampled = weight.iter().filter(|w| **w > 0.0).count();
    if black.len() < sampled { black } else { Vec::new() }
}

/// A weight without and with only the black pixels.
pub(crate) fn classes(weight: &[f32], black: &[usize]) -> [Vec<f32>; 2] {
    let (mut others, mut own) = (weight.to_vec(), vec![0.0; weight.len()]);
    for i in black {
        own[*i] = std::mem::take(&mut others[*i]);
    }
    [others, own]
}

/// Regresses the black pixels among themselves, with weight `own`, and writes their estimates.
pub(crate) fn regress_black(
    p: &Prepared<'_>,
    basis: &Basis,
    own: &[f32],
    without: Stages,
    estimate: &mut [f32],
) {
    let part = Part::around(&p.black, p.shape);
    let planes = basis.planes.iter().map(|plane| part.cut(plane)).collect();
    let basis = Basis { planes, names: String::new() };
    let variance = p.variance.as_deref().map(|v| part.cut(v));
    let (irradiance, own) = (part.cut(&p.irradiance), part.cut(own));
    let found = regress(part.shape, &basis, &irradiance, &own, variance.as_deref(), without, false).estimate;
    let (n, m) = (p.shape.pixels(), part.shape.pixels());
    for i in &p.black {
        let k = (i / p.shape.width - part.y) * part.shape.width + i % p.shape.width - part.x;
        (0..3).for_each(|c| estimate[c * n + i] = found[c * m + k]);
    }
}

/// A rectangle of a picture that begins and ends with cells.
struct Part {
    whole: Shape,
    shape: Shape,
    x: usize,
    y: usize,
}

impl Part {
    fn around(pixels: &[usize], whole: Shape) -> Self {
        let nothing = [usize::MAX, usize::MAX, 0, 0];
        let [x0, y0, x1, y1] = pixels.iter().fold(nothing, |[x0, y0, x1, y1], i| {
            let (x, y) = (i % whole.width, i / whole.width);
            [x0.min(x), y0.min(y), x1.max(x), y1.max(y)]
        });
        let (x, y) = (x0 / CELL * CELL, y0 / CELL * CELL);
        let end = |last: usize, size: usize| (last + 1).next_multiple_of(CELL).min(size);
        let shape = Shape::new(end(x1, whole.width) - x, end(y1, whole.height) - y, whole.channels);
        Self { whole, shape, x, y }
    }

    /// The rectangle of each plane.
    fn cut(&self, planes: &[f32]) -> Vec<f32> {
        let rows = |plane: usize| (0..self.shape.height).map(move |y| plane * self.whole.height + self.y + y);
        let all = (0..planes.len() / self.whole.pixels()).flat_map(rows);
        all.flat_map(|row| &planes[row * self.whole.width + self.x..][..self.shape.width]).copied().collect()
    }
}

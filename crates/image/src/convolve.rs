//! Separable convolution of planes.

use rayon::prelude::*;

/// What lies beyond the edge of a plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Edge {
    /// The edge sample repeats: `a a | a b c | c c`.
    Clamp,
    /// The plane is mirrored with its edge sample: `b a | a b c | c b`.
    Mirror,
}

impl Edge {
    #[inline]
    fn index(self, i: isize, n: usize) -> usize {
        match self {
            Self::Clamp => i.clamp(0, n as isize - 1) as usize,
            Self::Mirror => {
                let i = i.rem_euclid(2 * n as isize) as usize;
                if i < n { i } else { 2 * n - 1 - i }
            }
        }
    }
}

/// Width of the blocks that are accumulated in registers.
const BLOCK: usize = 16;

/// One channel of an image.
#[derive(Clone, Debug)]
pub(crate) struct Plane {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) data: Vec<f32>,
}

impl Plane {
    fn like(&self) -> Self {
        Self { width: self.width, height: self.height, data: vec![0.0; self.data.len()] }
    }

    /// Correlates with the outer product of `across` (along rows) and `down` (along columns), odd numbers of taps.
    pub(crate) fn separable(&self, across: &[f32], down: &[f32], edge: Edge) -> Self {
        self.rows(across, edge).columns(down, edge)
    }

    /// Correlates each row with `taps`.
    pub(crate) fn rows(&self, taps: &[f32], edge: Edge) -> Self {
        let mut out = self.like();
        let (width, radius) = (self.width, taps.len() / 2);
        let scratch = || vec![0.0; width + 2 * radius];
        let rows = out.data.par_chunks_exact_mut(width.max(1)).zip(self.data.par_chunks_exact(width.max(1)));
        rows.with_min_len(16).for_each_init(scratch, |padded, (out, row)| {
            padded[radius..radius + width].copy_from_slice(row);
            for i in 0..radius {
                padded[i] = row[edge.index(i as isize - radius as isize, width)];
                padded[radius + width + i] = row[edge.index((width + i) as isize, width)];
            }
            for (b, out) in out.chunks_mut(BLOCK).enumerate() {
                accumulate(out, taps.iter().enumerate().map(|(k, w)| (*w, &padded[b * BLOCK + k..])));
            }
        });
        out
    }

    /// Correlates each column with `taps`.
    pub(crate) fn columns(&self, taps: &[f32], edge: Edge) -> Self {
        let mut out = self.like();
        let (width, radius) = (self.width, (taps.len() / 2) as isize);
        let rows = out.data.par_chunks_exact_mut(width.max(1)).enumerate();
        rows.with_min_len(16).for_each(|(y, out)| {
            let row = |k: usize| {
                let source = edge.index(y as isize + k as isize - radius, self.height);
                &self.data[source * width..(source + 1) * width]
            };
            for (b, out) in out.chunks_mut(BLOCK).enumerate() {
                accumulate(out, taps.iter().enumerate().map(|(k, w)| (*w, &row(k)[b * BLOCK..])));
            }
        });
        out
    }
}

/// `out = sum of weight * source` over at most [`BLOCK`] samples.
#[inline(always)]
fn accumulate<'a>(out: &mut [f32], terms: impl Iterator<Item = (f32, &'a [f32])>) {
    let mut sum = [0.0_f32; BLOCK];
    if out.len() == BLOCK {
        for (weight, source) in terms {
            for (s, v) in sum.iter_mut().zip(&source[..BLOCK]) {
                *s += weight * v;
            }
        }
        out.copy_from_slice(&sum);
    } else {
        for (weight, source) in terms {
            for (s, v) in sum.iter_mut().zip(&source[..out.len()]) {
                *s += weight * v;
            }
        }
        out.copy_from_slice(&sum[..out.len()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separable_equals_the_double_sum() {
        let mut random = photofit_gradcheck::Uniform::new(9);
        for (width, height) in [(1, 1), (3, 2), (16, 5), (17, 33), (40, 3)] {
            let data: Vec<f32> = random.vec(width * height, -1.0, 1.0).iter().map(|v| *v as f32).collect();
            let plane = Plane { width, height, data };
            let across = [0.3, -0.2, 0.5, 0.1, 0.7];
            let down = [0.25, 0.5, -0.4];
            for edge in [Edge::Clamp, Edge::Mirror] {
                let fast = plane.separable(&across, &down, edge);
                for (at, got) in fast.data.iter().enumerate() {
                    let (x, y) = (at % width, at / width);
                    let expected: f32 = (0..across.len() * down.len())
                        .map(|k| (k % across.len(), k / across.len()))
                        .map(|(i, j)| {
                            let u = edge.index((x + i) as isize - 2, width);
                            let v = edge.index((y + j) as isize - 1, height);
                            across[i] * down[j] * plane.data[v * width + u]
                        })
                        .sum();
                    assert!((got - expected).abs() < 1e-5, "{edge:?} {width}x{height} at {x},{y}");
                }
            }
        }
    }

    #[test]
    fn edges_continue_as_documented() {
        let at = |edge: Edge| (-4..7).map(|i| edge.index(i, 3)).collect::<Vec<_>>();
        assert_eq!(at(Edge::Clamp), [0, 0, 0, 0, 0, 1, 2, 2, 2, 2, 2]);
        assert_eq!(at(Edge::Mirror), [2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0]);
    }
}

//! Bands of rows: how a picture is drawn that a device has no room for as a whole.
//!
//! A band is a picture of its own, of the same camera looking at part of the rows. Around the rows that count it has those
//! that the loss and the blending of silhouettes reach, so that losses and gradients of all bands add up to those of the
//! picture.

use super::stage::Room;
use photofit_raster::loss::gpu::Part;
use photofit_raster::project::Matrix4;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Rows on either side of those that count: the loss reaches some, and silhouettes blend with the one beyond: no farther where
/// silhouettes lie beside each other, since all blend the colours from before ([`photofit_raster::antialias`]). The weights
/// of pixels reach no farther.
const HALO: usize = Part::REACH + 1;
/// Fewest rows that count of a band of the largest picture: of fewer most of the work would be for the rows around them.
const MIN_ROWS: usize = 2 * HALO;

const _: () = assert!(crate::engine::loss::ASIDE <= HALO);

/// How many bands a picture is drawn in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Bands(usize);

impl Default for Bands {
    fn default() -> Self {
        Self(1)
    }
}

/// In how many bands a fit draws its pictures by now; clones tell the same.
#[derive(Clone, Debug)]
pub struct BandCount(Arc<AtomicUsize>);

impl BandCount {
    pub(super) fn new(bands: Bands) -> Self {
        Self(Arc::new(AtomicUsize::new(bands.0)))
    }

    pub(super) fn tell(&self, bands: Bands) {
        self.0.store(bands.0, Ordering::Relaxed);
    }

    /// Bands of a picture; 1 where it is drawn as a whole.
    pub fn get(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }
}

impl fmt::Display for BandCount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "pictures are drawn in {} bands of rows, for it has no room for whole ones", self.get())
    }
}

/// The rows of a picture that are drawn, and those that count.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Band {
    pub(super) drawn: Range<usize>,
    pub(super) counted: Range<usize>,
    /// Rows of the picture.
    of: usize,
}

impl Bands {
    pub(super) fn count(self) -> usize {
        self.0
    }

    /// Twice as many; none where the bands of the largest picture would have too few rows.
    pub(super) fn finer(self, room: Room) -> Option<Self> {
        let more = 2 * self.0;
        (room.pixels[1] / more >= MIN_ROWS).then_some(Self(more))
    }

    /// Columns and rows of the largest band of pictures of some room.
    pub(super) fn room(self, room: Room) -> Room {
        let [width, height] = room.pixels;
        let rows = if self.0 == 1 { height } else { (height.div_ceil(self.0) + 2 * HALO).min(height) };
        Room { pixels: [width, rows], ..room }
    }

    /// The bands of a picture of so many rows, as many for each picture; those without rows that count draw some.
    pub(super) fn of(self, rows: usize) -> impl Iterator<Item = Band> {
        (0..self.0).map(move |k| {
            let counted = k * rows / self.0..(k + 1) * rows / self.0;
            let drawn = counted.start.saturating_sub(HALO)..(counted.end + HALO).min(rows);
            let drawn = if self.0 == 1 { 0..rows } else { drawn };
            Band { drawn, counted, of: rows }
        })
    }
}

impl Band {
    pub(super) fn rows(&self) -> usize {
        self.drawn.len()
    }

    /// What of a picture of so many columns a loss compares.
    pub(super) fn part(&self, width: usize) -> Part {
        Part { size: [width, self.rows()], counted: self.inside(), rows: self.of }
    }

    /// The rows that count, among those that are drawn.
    pub(super) fn inside(&self) -> Range<usize> {
        self.counted.start - self.drawn.start..self.counted.end - self.drawn.start
    }

    /// Pixels of a picture of so many columns that are drawn.
    pub(super) fn pixels(&self, width: usize) -> Range<usize> {
        self.drawn.start * width..self.drawn.end * width
    }

    /// The rows of a projection whose picture is the band.
    pub(super) fn projection(&self, whole: Matrix4<f32>) -> Matrix4<f32> {
        projection_of_rows(whole, &self.drawn, self.of)
    }
}

/// The rows of a projection whose picture is these rows of `of`: `y' = (H y + (h - H + 2 first) w) / h`, of `H` and `h` rows.
pub(crate) fn projection_of_rows(whole: Matrix4<f32>, drawn: &Range<usize>, of: usize) -> Matrix4<f32> {
    if drawn.len() == of {
        return whole;
    }
    let [rows, of, first] = [drawn.len(), of, drawn.start].map(|n| n as f64);
    let (scale, shift) = (of / rows, (rows - of + 2.0 * first) / rows);
    let mut out = whole;
    for (k, y) in out[1].iter_mut().enumerate() {
        *y = (scale * f64::from(whole[1][k]) + shift * f64::from(whole[3][k])) as f32;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_count_every_row_once_and_have_room() {
        let room = Room { pixels: [8, 200], side: 2 };
        for count in [1, 2, 3, 8, 16] {
            let bands = Bands(count);
            for rows in [1, 7, 100, 199, 200] {
                let all: Vec<Band> = bands.of(rows).collect();
                let counted: Vec<usize> = all.iter().flat_map(|b| b.counted.clone()).collect();
                assert!(counted == (0..rows).collect::<Vec<_>>(), "{count} bands of {rows} rows: {all:?}");
                for b in &all {
                    assert!(b.rows() > 0 && b.rows() <= bands.room(room).pixels[1], "{b:?}");
                    let above = b.counted.start - b.drawn.start;
                    let below = b.drawn.end - b.counted.end;
                    assert!(above >= HALO || b.drawn.start == 0, "{b:?}");
                    assert!(below >= HALO || b.drawn.end == rows, "{b:?}");
                }
            }
        }
        assert_eq!(Bands(4).finer(room), Some(Bands(8)));
        assert_eq!(Bands(16).finer(room), None, "bands of too few rows");
    }

    #[test]
    fn a_band_is_part_of_the_picture() {
        let whole =
            [[1.0, 0.1, 0.2, 0.3], [0.2, 1.5, 0.1, -0.2], [0.0, 0.1, 1.0, 0.5], [0.1, 0.0, -1.0, 4.0]];
        let row = |m: &Matrix4<f32>, p: [f32; 4], height: usize| {
            let dot = |k: usize| (0..4).map(|c| f64::from(m[k][c]) * f64::from(p[c])).sum::<f64>();
            (1.0 - dot(1) / dot(3)) * 0.5 * height as f64
        };
        let p = [0.3, -0.4, 0.5, 1.0];
        for band in Bands(4).of(90) {
            let inside = row(&band.projection(whole), p, band.rows());
            let expected = row(&whole, p, 90) - band.drawn.start as f64;
            assert!((inside - expected).abs() < 1e-4, "{band:?}: {inside} {expected}");
        }
        assert_eq!(Bands::default().of(90).next().map(|b| b.projection(whole)), Some(whole));
    }
}

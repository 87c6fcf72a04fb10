//! The part of the picture in which anything can be: the rest is not worked on.

use super::{Cloud, Maps, Pinhole, SurfaceOptions};
use photofit_image::Image;
use rayon::prelude::*;

/// Points that one task projects.
const CHUNK: usize = 1 << 14;
/// The window begins at multiples of this, so that the cells of pyramids are those of the whole picture.
const ALIGNED: usize = 64;
/// Pixels around what points reach.
const MARGIN: f64 = 16.0;
/// A window that saves less than this share of the picture is not worth it.
const WORTH: f64 = 0.1;

/// A part of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Window {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
    /// Size of the whole picture.
    whole: (usize, usize),
}

impl Window {
    /// What the discs of the points in view reach, with a margin; `None` for the whole picture.
    pub(super) fn of(cloud: &Cloud, camera: &Pinhole, options: &SurfaceOptions) -> Option<Self> {
        if options.fill {
            return None;
        }
        let points = cloud.positions().par_chunks(CHUNK).zip(cloud.spacing().par_chunks(CHUNK));
        let nothing = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        let [left, top, right, bottom] = points
            .map(|(positions, spacing)| {
                let mut reached = nothing;
                for (p, spacing) in positions.iter().zip(spacing) {
                    let [x, y, z] = camera.to_camera(p.cast::<f64>().to_array());
                    let depth = z as f32;
                    let (u, v) = (x / z * camera.fx + camera.cx, y / z * camera.fy + camera.cy);
                    let inside = u >= 0.0 && v >= 0.0 && u < camera.width as f64 && v < camera.height as f64;
                    if !(depth >= f32::MIN_POSITIVE && depth.is_finite() && inside) {
                        continue;
                    }
                    let reach = f64::from(options.reach.reach(*spacing, depth, camera).0);
                    reached = [
                        reached[0].min(u - reach),
                        reached[1].min(v - reach),
                        reached[2].max(u + reach),
                        reached[3].max(v + reach),
                    ];
                }
                reached
            })
            .reduce(|| nothing, |a, b| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]);
        if left > right {
            return None;
        }
        let begin = |v: f64| (v - MARGIN).max(0.0) as usize / ALIGNED * ALIGNED;
        let end = |v: f64, size: usize| ((v + MARGIN) as usize + 1).next_multiple_of(ALIGNED).min(size);
        let (x, y) = (begin(left), begin(top));
        let window = Self {
            x,
            y,
            width: end(right, camera.width) - x,
            height: end(bottom, camera.height) - y,
            whole: (camera.width, camera.height),
        };
        let share = (window.width * window.height) as f64 / camera.pixels() as f64;
        (share < 1.0 - WORTH).then_some(window)
    }

    /// The camera that sees the window.
    pub(super) fn camera(&self, camera: &Pinhole) -> Pinhole {
        Pinhole {
            width: self.width,
            height: self.height,
            cx: camera.cx - self.x as f64,
            cy: camera.cy - self.y as f64,
            ..*camera
        }
    }

    /// The maps in the whole picture, with nothing around.
    pub(super) fn place(&self, maps: &Maps) -> Maps {
        Maps {
            depth: self.place_image(&maps.depth),
            normal: self.place_image(&maps.normal),
            albedo: maps.albedo.as_ref().map(|image| self.place_image(image)),
        }
    }

    fn place_image(&self, part: &Image) -> Image {
        let (width, height) = self.whole;
        let c = part.channels;
        let mut image = Image::new(width, height, c);
        let rows = image.data.par_chunks_mut(width * c).skip(self.y);
        rows.zip(part.data.par_chunks(self.width * c)).for_each(|(row, part)| {
            row[self.x * c..(self.x + self.width) * c].copy_from_slice(part);
        });
        image
    }
}

#[cfg(test)]
mod tests {
    use super::super::reconstruct::in_window;
    use super::super::{Method, SplatRadius, reconstruct};
    use super::*;
    use photofit_sampling::fibonacci_sphere;

    #[test]
    fn the_window_leaves_nothing_out() {
        // A small sphere in a corner of the picture.
        let up = [0.0, 1.0, 0.0];
        let camera = Pinhole::look_at([0.0, 0.0, 9.0], [2.6, -1.7, 0.0], up, 0.9, 400, 300);
        let points = (0..4000).map(|i| fibonacci_sphere::<f32>(i, 4000)).collect();
        let cloud = Cloud::new(points, vec![], vec![]).unwrap();
        for (reach, blended) in [(SplatRadius::Spacing(1.5), true), (SplatRadius::Pixels(3.0), false)] {
            let mut options = SurfaceOptions { reach, ..SurfaceOptions::new(Method::Fast) };
            if !blended {
                options.blend.threshold = 100.0;
            }
            let window = Window::of(&cloud, &camera, &options).unwrap();
            assert!(window.width * window.height < 60_000, "{window:?}");
            assert_eq!(Window::of(&cloud, &camera, &SurfaceOptions { fill: true, ..options }), None);
            let found = reconstruct(&cloud, &camera, &options, |_, _, _| true).unwrap();
            let whole = in_window(&cloud, &camera, &options, &mut |_, _, _| Ok(())).unwrap();
            assert_eq!(found.figures, whole.figures);
            assert_eq!(found.raw.depth, whole.raw.depth);
            let (mut sum, mut worst, mut covered) = (0.0_f32, 0.0_f32, 0);
            for (a, b) in found.maps.depth.data.iter().zip(&whole.maps.depth.data) {
                assert_eq!(*a > 0.0, *b > 0.0, "the window covers what the picture does");
                if *b > 0.0 {
                    sum += (a / b - 1.0).abs();
                    worst = worst.max((a / b - 1.0).abs());
                    covered += 1;
                }
            }
            println!("blended: {blended}; mean difference {}, worst {worst}", sum / covered as f32);
            // The weights of the blend are relative to the contrast of what is worked on.
            let (mean_bound, bound) = if blended { (2e-3, 0.1) } else { (1e-5, 1e-3) };
            assert!(covered > 3000 && sum / (covered as f32) < mean_bound && worst < bound);
        }
    }
}

//! Pull-push: fills the holes of a depth map from a pyramid that keeps the nearest surface.
//!
//! The pull makes coarser levels of the known pixels; up to level `max_level` a cell takes only the children near its
//! nearest one, so that a sparse foreground survives, above it the plain mean. The push goes back: holes are filled
//! from the coarser level, and below `max_level` pixels that lie behind it are replaced.

use rayon::prelude::*;

/// Cells from which work is spread over threads.
const PARALLEL: usize = 1 << 14;

/// What decides that two depths belong to one surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PullPushOptions {
    /// Levels up to which the foreground wins: `2^max_level` is about the distance of neighbouring samples, pixels.
    pub max_level: usize,
    /// Largest difference of ln z within a surface.
    pub tolerance: f32,
}

impl Default for PullPushOptions {
    /// Samples 8 pixels apart, 5% of depth.
    fn default() -> Self {
        Self { max_level: 3, tolerance: 0.05 }
    }
}

impl PullPushOptions {
    /// The level limit for samples that are `spacing` pixels apart.
    pub fn for_spacing(spacing: f32) -> Self {
        let level = spacing.max(1.0).log2().round().clamp(0.0, 16.0);
        Self { max_level: level as usize, ..Self::default() }
    }
}

/// One level: value, slope per cell of this level, and the weight of what the pull found (0 = nothing).
struct Level {
    width: usize,
    height: usize,
    cells: Vec<Cell>,
}

#[derive(Clone, Copy, Default)]
struct Cell {
    u: f32,
    gx: f32,
    gy: f32,
    weight: f32,
}

impl Cell {
    /// The value at an offset in cells; slopes do not reach farther than the tolerance.
    #[inline]
    fn at(&self, dx: f32, dy: f32, tolerance: f32) -> f32 {
        self.u + (self.gx * dx + self.gy * dy).clamp(-tolerance, tolerance)
    }
}

/// Fills `ln_z`, in which the pixels with `valid` are known. Without known pixels the result is zero.
///
/// `slope` gives the differences of ln z to the right and downwards at known pixels (from normals); with it values
/// are carried along the surface instead of staying flat.
///
/// # Panics
/// If the slices have not `width * height` entries.
pub fn pull_push(
    ln_z: &[f32],
    valid: &[bool],
    slope: Option<(&[f32], &[f32])>,
    width: usize,
    height: usize,
    options: &PullPushOptions,
) -> Vec<f32> {
    let pixels = width * height;
    assert!(ln_z.len() == pixels && valid.len() == pixels, "one value per pixel");
    if let Some((gx, gy)) = slope {
        assert!(gx.len() == pixels && gy.len() == pixels, "one slope per pixel");
    }
    let cell = |i: usize| match (valid[i], slope) {
        (false, _) => Cell::default(),
        (true, None) => Cell { u: ln_z[i], weight: 1.0, ..Cell::default() },
        (true, Some((gx, gy))) => Cell { u: ln_z[i], gx: gx[i], gy: gy[i], weight: 1.0 },
    };
    let base = (0..pixels).into_par_iter().map(cell).collect();
    let mut levels = vec![Level { width, height, cells: base }];
    while levels.last().is_some_and(|l| l.width > 1 || l.height > 1) {
        let next = pull(&levels[levels.len() - 1], levels.len(), options);
        levels.push(next);
    }
    while levels.len() > 1 {
        let Some(coarse) = levels.pop() else { break };
        let l = levels.len() - 1;
        push(&mut levels[l], &coarse, l, options);
    }
    levels[0].cells.par_iter().map(|c| c.u).collect()
}

fn pull(fine: &Level, level: usize, options: &PullPushOptions) -> Level {
    let (width, height) = (fine.width.div_ceil(2), fine.height.div_ceil(2));
    let mut cells = vec![Cell::default(); width * height];
    let nearest_wins = level <= options.max_level;
    cells.par_chunks_mut(width).with_min_len(PARALLEL.div_ceil(width)).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            let mut children = [(Cell::default(), 0.0); 4];
            let mut nearest = f32::INFINITY;
            for (k, child) in children.iter_mut().enumerate() {
                let (cx, cy) = (2 * x + (k & 1), 2 * y + (k >> 1));
                if cx >= fine.width || cy >= fine.height {
                    continue;
                }
                let c = fine.cells[cy * fine.width + cx];
                if c.weight > 0.0 {
                    // From the centre of the child to that of the parent: half a cell.
                    let (dx, dy) = (0.5 - (k & 1) as f32, 0.5 - (k >> 1) as f32);
                    let u = c.at(dx, dy, options.tolerance);
                    *child = (c, u);
                    nearest = nearest.min(u);
                }
            }
            let limit = if nearest_wins { nearest + options.tolerance } else { f32::INFINITY };
            let mut sum = Cell::default();
            for (c, u) in children.iter().filter(|(c, u)| c.weight > 0.0 && *u <= limit) {
                sum.weight += c.weight;
                sum.u += c.weight * u;
                sum.gx += c.weight * c.gx;
                sum.gy += c.weight * c.gy;
            }
            if sum.weight > 0.0 {
                let share = 1.0 / sum.weight;
                // A step of the coarser level is two of the finer; above the limit slopes are not trusted.
                let slope = if nearest_wins { 2.0 * share } else { 0.0 };
                *out = Cell {
                    u: sum.u * share,
                    gx: sum.gx * slope,
                    gy: sum.gy * slope,
                    weight: sum.weight.min(1.0),
                };
            }
        }
    });
    Level { width, height, cells }
}

fn push(fine: &mut Level, coarse: &Level, level: usize, options: &PullPushOptions) {
    let tolerance = options.tolerance;
    let width = fine.width;
    fine.cells.par_chunks_mut(width).with_min_len(PARALLEL.div_ceil(width)).enumerate().for_each(
        |(y, row)| {
            for (x, cell) in row.iter_mut().enumerate() {
                let known = cell.weight > 0.0;
                if known && level >= options.max_level {
                    continue;
                }
                let central = coarse.cells[y / 2 * coarse.width + x / 2];
                if known && central.weight <= 0.0 {
                    continue;
                }
                let filled = interpolate(coarse, x, y, tolerance);
                if !known || cell.u > filled.u + tolerance {
                    // Whether the pull covered the cell stays as it is.
                    *cell = Cell { weight: cell.weight, ..filled };
                }
            }
        },
    );
}

/// The bilinear value of a coarse level at a fine cell, from the taps near the central one.
#[inline]
fn interpolate(coarse: &Level, x: usize, y: usize, tolerance: f32) -> Cell {
    let (cx, cy) = (x / 2, y / 2);
    // Offset from the centre of the parent, in parents, and the side on which the other taps are.
    let (sx, sy) = (if x & 1 == 0 { -1_isize } else { 1 }, if y & 1 == 0 { -1_isize } else { 1 });
    let (ox, oy) = (0.25 * sx as f32, 0.25 * sy as f32);
    let central = coarse.cells[cy * coarse.width + cx];
    let here = central.at(ox, oy, tolerance);
    let mut sum = Cell { u: here, gx: central.gx, gy: central.gy, weight: 9.0 };
    sum.u *= 9.0;
    sum.gx *= 9.0;
    sum.gy *= 9.0;
    for (dx, dy, weight) in [(sx, 0, 3.0), (0, sy, 3.0), (sx, sy, 1.0)] {
        let (tx, ty) = (cx as isize + dx, cy as isize + dy);
        if tx < 0 || ty < 0 || tx >= coarse.width as isize || ty >= coarse.height as isize {
            continue;
        }
        let tap = coarse.cells[ty as usize * coarse.width + tx as usize];
        let u = tap.at(ox - dx as f32, oy - dy as f32, tolerance);
        if (u - here).abs() <= tolerance {
            sum.weight += weight;
            sum.u += weight * u;
            sum.gx += weight * tap.gx;
            sum.gy += weight * tap.gy;
        }
    }
    let share = 1.0 / sum.weight;
    // A step of the finer level is half of one of the coarser.
    Cell { u: sum.u * share, gx: 0.5 * sum.gx * share, gy: 0.5 * sum.gy * share, weight: 0.0 }
}

#[cfg(test)]
mod tests {
    use super::super::normal_target;
    use super::super::synthetic::{SIDE, camera, ln_depth, sphere_over_background};
    use super::super::tests::uniform;
    use super::*;

    fn options(max_level: usize) -> PullPushOptions {
        PullPushOptions { max_level, ..PullPushOptions::default() }
    }

    #[test]
    fn the_foreground_wins_up_to_the_level_limit() {
        let scene = sphere_over_background();
        let (samples, _) = scene.sample(0.12, 0.10, uniform(1));
        let (u, valid) = ln_depth(&samples);
        let errors: Vec<(f64, f64)> = (0..5)
            .map(|level| scene.errors(&pull_push(&u, &valid, None, SIDE, SIDE, &options(level))))
            .collect();
        println!("level limit 0..4, front and back error: {errors:.3?}");
        assert!(errors[0].0 >= 1.0, "without the limit the background shows through");
        assert!(errors[3].0 <= 0.15);
        assert!(errors.windows(2).all(|e| e[1].0 < e[0].0), "the front falls");
        assert!(errors[..4].windows(2).all(|e| e[1].1 > e[0].1), "the back rises");
        let slopes = normal_target(&samples.normal, &scene.camera);
        let slopes = Some((slopes.0.as_slice(), slopes.1.as_slice()));
        let oriented = scene.errors(&pull_push(&u, &valid, slopes, SIDE, SIDE, &options(3)));
        println!("with slopes {oriented:.3?}");
        assert!(oriented.0 <= errors[3].0 && oriented.1 < errors[3].1 * 1.1);
    }

    #[test]
    fn known_pixels_stay_where_nothing_is_hidden() {
        let camera = camera();
        let plane: Vec<f32> = (0..SIDE * SIDE)
            .map(|i| {
                let (x, y) = (camera.ray_x((i % SIDE) as f64), camera.ray_y((i / SIDE) as f64));
                (2.0 / (1.0 + 0.3 * x - 0.2 * y)).ln()
            })
            .collect();
        let mut rng = photofit_sampling::Rng::new(6, 0);
        for share in [0.02, 0.2, 1.0] {
            let valid: Vec<bool> = plane.iter().map(|_| rng.next_f32() < share).collect();
            let holes: Vec<f32> = plane.iter().zip(&valid).map(|(u, v)| if *v { *u } else { 9.0 }).collect();
            let out = pull_push(&holes, &valid, None, SIDE, SIDE, &options(3));
            let known = (0..out.len()).filter(|i| valid[*i]).all(|i| out[i] == plane[i]);
            assert!(known, "coverage {share}");
            let worst = out.iter().zip(&plane).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 0.08, "coverage {share}: {worst}");
            // With the slopes the plane is continued, not only averaged.
            let step = |i: usize, d: usize, end: bool| if end { 0.0 } else { plane[i + d] - plane[i] };
            let gx: Vec<f32> = (0..out.len()).map(|i| step(i, 1, i % SIDE == SIDE - 1)).collect();
            let gy: Vec<f32> = (0..out.len()).map(|i| step(i, SIDE, i / SIDE == SIDE - 1)).collect();
            let oriented = pull_push(&holes, &valid, Some((&gx, &gy)), SIDE, SIDE, &options(4));
            let mean =
                |v: &[f32]| v.iter().zip(&plane).map(|(a, b)| (a - b).abs()).sum::<f32>() / v.len() as f32;
            assert!(mean(&oriented) <= 0.5 * mean(&out), "{} against {}", mean(&oriented), mean(&out));
        }
    }

    #[test]
    fn small_pictures_and_no_samples() {
        for (w, h) in [(1, 1), (1, 7), (6, 1), (5, 3)] {
            let mut valid = vec![false; w * h];
            let mut u = vec![0.0; w * h];
            assert!(pull_push(&u, &valid, None, w, h, &options(3)).iter().all(|v| *v == 0.0));
            u[w * h / 2] = -1.25;
            valid[w * h / 2] = true;
            assert!(pull_push(&u, &valid, None, w, h, &options(3)).iter().all(|v| *v == -1.25));
        }
        assert_eq!(PullPushOptions::for_spacing(0.0).max_level, 0);
        assert_eq!(PullPushOptions::for_spacing(7.0).max_level, 3);
        assert_eq!(PullPushOptions::for_spacing(f32::NAN).max_level, 0);
    }
}

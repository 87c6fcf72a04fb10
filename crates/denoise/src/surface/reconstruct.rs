//! The pipeline: points to dense depth, normals and colours.

use super::window::Window;
use super::{
    Cloud, InterpolateOptions, Maps, Method, Pinhole, PullPushOptions, Samples, SurfaceError, SurfaceOptions,
    attributes, box_mean, normal_target, orient, prune, pull_push, render_points, solve, splat_depth,
};
use rayon::prelude::*;

/// A reconstructed view.
#[derive(Clone, Debug)]
pub struct Surface {
    /// What fell on the pixels, hidden points included.
    pub raw: Maps,
    /// The result.
    pub maps: Maps,
    /// What was found on the way.
    pub figures: Figures,
}

/// What was found on the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Points in front of the camera and inside of the picture.
    pub in_view: usize,
    /// Pixels on which a point fell.
    pub samples: usize,
    /// Pixels whose point was taken for hidden.
    pub hidden: usize,
    /// Distance between neighbouring samples, pixels.
    pub spacing: f32,
    /// Level up to which pull-push keeps the nearest surface.
    pub max_level: usize,
    /// Pixels of the result with a surface.
    pub covered: usize,
}

/// Reconstructs what `camera` sees of `cloud`.
///
/// `progress` is told the stage, the steps done and the steps in all; the work stops when it returns false.
///
/// ```
/// use photofit_denoise::surface::{Cloud, Method, Pinhole, SurfaceOptions, reconstruct};
/// use photofit_scalar::vec3;
/// let grid = (0..2500).map(|i| vec3((i % 50) as f32 / 25.0 - 1.0, (i / 50) as f32 / 25.0 - 1.0, 0.0)).collect();
/// let cloud = Cloud::new(grid, vec![], vec![])?;
/// let camera = Pinhole::look_at([0.0, 0.0, 3.0], [0.0; 3], [0.0, 1.0, 0.0], 0.5, 64, 64);
/// let surface = reconstruct(&cloud, &camera, &SurfaceOptions::new(Method::Fast), |_, _, _| true)?;
/// assert!(surface.maps.depth.data.iter().all(|z| (z - 3.0).abs() < 0.01), "a plane without holes");
/// # Ok::<(), photofit_denoise::surface::SurfaceError>(())
/// ```
///
/// # Errors
/// A camera or an option that breaks a rule, no point in view, or [`SurfaceError::Interrupted`].
pub fn reconstruct(
    cloud: &Cloud,
    camera: &Pinhole,
    options: &SurfaceOptions,
    mut progress: impl FnMut(&'static str, usize, usize) -> bool,
) -> Result<Surface, SurfaceError> {
    camera.check()?;
    options.check()?;
    let mut tell = |stage, done, total| {
        if progress(stage, done, total) { Ok(()) } else { Err(SurfaceError::Interrupted) }
    };
    tell("points", 0, 1)?;
    let Some(window) = Window::of(cloud, camera, options) else {
        return in_window(cloud, camera, options, &mut tell);
    };
    let part = in_window(cloud, &window.camera(camera), options, &mut tell)?;
    Ok(Surface { raw: window.place(&part.raw), maps: window.place(&part.maps), ..part })
}

/// The picture of a camera, all of it.
pub(super) fn in_window(
    cloud: &Cloud,
    camera: &Pinhole,
    options: &SurfaceOptions,
    tell: &mut solve::Tell<'_>,
) -> Result<Surface, SurfaceError> {
    let mut samples = render_points(cloud, camera);
    let count = samples.count();
    if count == 0 {
        return Err(SurfaceError::NothingInView { points: cloud.positions().len() });
    }
    let raw = Maps::of_samples(&samples, cloud, camera);
    let splats = splat_depth(&samples, camera, options.reach);
    let hidden = prune(&mut samples, &splats, options.tolerance);
    let spacing = samples.spacing_px(camera);
    orient::orient(&mut samples, camera, spacing);
    let covered = coverage(&samples, &splats, spacing, options.fill);
    tell("fill", 0, 1)?;
    let (start, max_level) = Start::new(&samples, &splats, camera, options, spacing);
    let ln_z = solve::depth(&start, camera, options, tell)?;
    tell("attributes", 0, 1)?;
    let (mut normals, colors) = attributes::normals_and_colors(
        &samples,
        cloud.colors(),
        &ln_z,
        &surroundings(spacing),
        options.tolerance,
    );
    attributes::unit_facing(&mut normals, camera);
    let colors = colors.map(|c| solve::texture(c, camera, options)).transpose()?;
    let maps = attributes::maps(&ln_z, &normals, colors.as_deref(), &covered, camera);
    let figures = Figures {
        in_view: samples.in_view,
        samples: count,
        hidden,
        spacing,
        max_level,
        covered: covered.iter().filter(|c| **c).count(),
    };
    tell("attributes", 1, 1)?;
    Ok(Surface { raw, maps, figures })
}

/// What the solver starts from, pixel by pixel.
pub(super) struct Start {
    /// ln z of the samples; 0 where there is none.
    pub(super) ln_z: Vec<f32>,
    /// Whether there is a sample.
    pub(super) valid: Vec<bool>,
    /// ln z without holes, from pull-push.
    pub(super) filled: Vec<f32>,
    /// The slope that the normals ask for: the plane of x, then the plane of y.
    pub(super) target: Vec<f32>,
    /// How much that slope counts: 1 at samples, less between, 0 at edges.
    pub(super) trust: Vec<f32>,
}

/// Share of the weight of an interpolated normal.
const INTERPOLATED: f32 = 0.5;

impl Start {
    pub(super) fn new(
        samples: &Samples,
        splats: &[f32],
        camera: &Pinhole,
        options: &SurfaceOptions,
        spacing: f32,
    ) -> (Self, usize) {
        let (w, h) = (camera.width, camera.height);
        let valid: Vec<bool> = (0..w * h).into_par_iter().map(|i| samples.is_valid(i)).collect();
        let ln_z: Vec<f32> = samples.z.par_iter().map(|z| if *z > 0.0 { z.ln() } else { 0.0 }).collect();
        let (gx, gy) = normal_target(&samples.normal, camera);
        let mut pyramid = PullPushOptions::for_spacing(spacing);
        if let Some(level) = options.max_level {
            pyramid.max_level = level;
        }
        let mut filled = pull_push(&ln_z, &valid, Some((&gx, &gy)), w, h, &pyramid);
        follow_splats(&mut filled, &valid, splats, pyramid.tolerance);
        // Samples that pull-push replaced are hidden too.
        let valid: Vec<bool> = (0..w * h)
            .into_par_iter()
            .map(|i| valid[i] && (ln_z[i] - filled[i]).abs() <= pyramid.tolerance)
            .collect();
        // The fast method leaves normals between samples to the pyramid.
        let window = Some(surroundings(spacing)).filter(|_| options.method != Method::Fast);
        let normals = attributes::normals(samples, &valid, &filled, window.as_ref());
        let (gx, gy) = normal_target(&normals, camera);
        let trust = |i: usize| {
            let (x, y) = (i % w, i / w);
            let jump = |j: usize, g: f32| (filled[j] - filled[i] - g).abs() > 0.5 * pyramid.tolerance;
            let edge = (x + 1 < w && jump(i + 1, gx[i])) || (y + 1 < h && jump(i + w, gy[i]));
            match (edge, valid[i]) {
                (true, _) => 0.0,
                (false, true) => 1.0,
                (false, false) => INTERPOLATED,
            }
        };
        let trust = (0..w * h).into_par_iter().map(trust).collect();
        let target = gx.into_iter().chain(gy).collect();
        (Self { ln_z, valid, filled, target, trust }, pyramid.max_level)
    }
}

/// Pull-push guesses outlines from squares of pixels; where the discs of the samples say that a hole shows another
/// surface, they are followed.
fn follow_splats(filled: &mut [f32], valid: &[bool], splats: &[f32], tolerance: f32) {
    filled.par_iter_mut().zip(splats).zip(valid).for_each(|((filled, splat), valid)| {
        let splat = splat.ln();
        if !valid && splat.is_finite() && (*filled - splat).abs() > tolerance {
            *filled = splat;
        }
    });
}

/// Windows that hold some samples.
fn surroundings(spacing: f32) -> InterpolateOptions {
    let radius = (1.3 * spacing).ceil().clamp(2.0, 32.0);
    InterpolateOptions {
        window: 2 * radius as usize + 1,
        sigma: (0.7 * spacing).clamp(0.7, 18.0),
        ..InterpolateOptions::default()
    }
}

/// Where there is a surface: at samples and under splats, with pinholes closed by the majority of a window.
fn coverage(samples: &Samples, splats: &[f32], spacing: f32, fill: bool) -> Vec<bool> {
    if fill {
        return vec![true; splats.len()];
    }
    let hit: Vec<f32> = splats.par_iter().map(|z| if z.is_finite() { 1.0 } else { 0.0 }).collect();
    let window = 2 * (spacing.ceil().clamp(1.0, 32.0) as usize) + 1;
    let share = box_mean(&hit, samples.width, samples.height, window);
    share.par_iter().enumerate().map(|(i, share)| *share > 0.5 || samples.is_valid(i)).collect()
}

//! How far a picture is from its reference.

use super::cases::Case;
use photofit_image::{DEFAULT_PIXELS_PER_DEGREE, Image, flip, psnr_from_mse, rmse, ssim, to_display};

/// RMSE, PSNR, SSIM and FLIP of the displayed pictures (sRGB, cut to [0, 1]).
pub(super) fn score(case: &Case, radiance: &[f32]) -> Vec<(&'static str, f64)> {
    let [test, truth] = displayed(case, radiance);
    let error = rmse(&truth, &test);
    vec![
        ("RMSE", error),
        ("PSNR", psnr_from_mse(error * error)),
        ("SSIM", ssim(&truth, &test).mean),
        ("FLIP", flip(&truth, &test, DEFAULT_PIXELS_PER_DEGREE).mean),
    ]
}

/// The displayed RMSE alone.
pub(super) fn display_rmse(case: &Case, radiance: &[f32]) -> f64 {
    let [test, truth] = displayed(case, radiance);
    rmse(&truth, &test)
}

/// A picture and its reference.
fn displayed(case: &Case, radiance: &[f32]) -> [Image; 2] {
    [radiance, &case.reference].map(|planes| to_display(&image(case, planes)))
}

fn image(case: &Case, planes: &[f32]) -> Image {
    let n = case.pixels();
    let sample = |i: usize| {
        let v = planes[i % 3 * n + i / 3];
        if v.is_finite() { v } else { 0.0 }
    };
    Image::from_data(case.width, case.height, 3, (0..3 * n).map(sample).collect())
}

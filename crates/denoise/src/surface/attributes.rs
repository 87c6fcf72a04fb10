//! Normals and colours on the reconstructed depth.

use super::{InterpolateOptions, Maps, Pinhole, Samples, fill_channels, interpolate};
use photofit_image::Image;
use photofit_scalar::{Vec3f, vec3};
use rayon::prelude::*;

/// Dense normals in camera axes (not of unit length): those of the valid samples interpolated under the guidance of
/// `ln_z`, or only from coarser levels without `options`.
pub(super) fn normals(
    samples: &Samples,
    valid: &[bool],
    ln_z: &[f32],
    options: Option<&InterpolateOptions>,
) -> Vec<Vec3f> {
    let known: Vec<bool> =
        valid.par_iter().zip(&samples.normal).map(|(v, n)| *v && *n != Vec3f::zero()).collect();
    let values: Vec<[f32; 3]> = samples.normal.par_iter().map(|n| n.to_array()).collect();
    from_arrays(&filled(&values, &known, ln_z, samples, options))
}

/// As [`normals`], with the colours of the points (one per point) beside; `ln_z` is the result, and samples farther
/// than `tolerance` from it are not used.
pub(super) fn normals_and_colors(
    samples: &Samples,
    colors: &[Vec3f],
    ln_z: &[f32],
    options: &InterpolateOptions,
    tolerance: f32,
) -> (Vec<Vec3f>, Option<Vec<Vec3f>>) {
    let near: Vec<bool> = (samples.z.par_iter().zip(ln_z).enumerate())
        .map(|(i, (z, u))| samples.is_valid(i) && (z.ln() - u).abs() < tolerance)
        .collect();
    if colors.is_empty() {
        return (normals(samples, &near, ln_z, Some(options)), None);
    }
    let known: Vec<bool> =
        near.par_iter().zip(&samples.normal).map(|(v, n)| *v && *n != Vec3f::zero()).collect();
    let value = |i: usize| {
        let (n, c) = (samples.normal[i], colors.get(samples.index[i] as usize).copied().unwrap_or_default());
        [n.x, n.y, n.z, c.x, c.y, c.z]
    };
    let values: Vec<[f32; 6]> = (0..near.len()).into_par_iter().map(value).collect();
    // A sample without a normal still has its colour: such clouds are rare, and filled twice.
    if known == near {
        let all = filled(&values, &near, ln_z, samples, Some(options));
        let split = |k: usize| all.par_iter().map(|a| vec3(a[k], a[k + 1], a[k + 2])).collect();
        return (split(0), Some(split(3)));
    }
    let colors: Vec<[f32; 3]> = values.iter().map(|v| [v[3], v[4], v[5]]).collect();
    let colors = filled(&colors, &near, ln_z, samples, Some(options));
    (normals(samples, &near, ln_z, Some(options)), Some(from_arrays(&colors)))
}

fn filled<const C: usize>(
    values: &[[f32; C]],
    valid: &[bool],
    ln_z: &[f32],
    samples: &Samples,
    options: Option<&InterpolateOptions>,
) -> Vec<[f32; C]> {
    let (w, h) = (samples.width, samples.height);
    match options {
        Some(options) => {
            let (values, found) = interpolate(values, valid, ln_z, w, h, options);
            fill_channels(&values, &found, w, h)
        }
        None => fill_channels(values, valid, w, h),
    }
}

fn from_arrays(values: &[[f32; 3]]) -> Vec<Vec3f> {
    values.par_iter().map(|v| Vec3f::from_array(*v)).collect()
}

/// Unit normals that face the camera; straight at it where interpolation cancelled them.
pub(super) fn unit_facing(normals: &mut [Vec3f], camera: &Pinhole) {
    normals.par_chunks_mut(camera.width).enumerate().for_each(|(y, row)| {
        let ray_y = camera.ray_y(y as f64);
        for (x, n) in row.iter_mut().enumerate() {
            let ray = vec3(camera.ray_x(x as f64), ray_y, 1.0);
            let unit = n.normalize_or_zero();
            let away = unit.dot(ray);
            *n = if unit == Vec3f::zero() {
                -ray.normalize_or_zero()
            } else if away > 0.0 {
                // Turned just past edge-on by interpolation: back into the plane of the picture.
                (unit - ray * (away / ray.length_squared())).normalize_or_zero()
            } else {
                unit
            };
        }
    });
}

/// Joins depth, normals and colours where there is a surface.
pub(super) fn maps(
    ln_z: &[f32],
    normals: &[Vec3f],
    colors: Option<&[Vec3f]>,
    covered: &[bool],
    camera: &Pinhole,
) -> Maps {
    let (w, h) = (camera.width, camera.height);
    let image = |c: usize, data: Vec<f32>| Image::from_data(w, h, c, data);
    let depth = (0..w * h).into_par_iter().map(|i| if covered[i] { ln_z[i].exp() } else { 0.0 }).collect();
    let three = |value: &(dyn Fn(usize) -> Vec3f + Sync)| {
        let mut data = vec![0.0; 3 * w * h];
        data.par_chunks_mut(3 * w).enumerate().for_each(|(y, row)| {
            for (x, out) in row.chunks_exact_mut(3).enumerate().filter(|(x, _)| covered[y * w + x]) {
                out.copy_from_slice(&value(y * w + x).to_array());
            }
        });
        image(3, data)
    };
    Maps {
        depth: image(1, depth),
        normal: three(&|i| camera.direction_to_world(normals[i])),
        albedo: colors.map(|c| three(&|i| c[i].map(|v| v.clamp(0.0, 1.0)))),
    }
}

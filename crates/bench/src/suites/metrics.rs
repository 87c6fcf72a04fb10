//! Image metrics: PSNR, SSIM and FLIP over the image size; SSIM against its definition, window by window.

use anyhow::Result;
use photofit_image::{DEFAULT_PIXELS_PER_DEGREE, Image, flip, psnr, ssim};

use crate::context::Context;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    for size in [64_usize, 128, 256, 512, 1024] {
        let (a, b) = pair(size);
        let case = format!("{size} x {size}");
        let pixels = size * size;
        let definition = (size <= 256).then(|| ssim_by_definition(&a, &b));
        ctx.measure(
            "SSIM",
            &case,
            pixels,
            || ssim(&a, &b).mean,
            |value| {
                let error = definition.map(|exact| ("error", (value - exact).abs()));
                error.into_iter().chain([("value", *value)]).collect()
            },
        );
        if ctx.baseline() && size <= 256 {
            ctx.measure(
                "SSIM by definition",
                &case,
                pixels,
                || ssim_by_definition(&a, &b),
                |v| vec![("value", *v)],
            );
        }
        ctx.measure(
            "FLIP",
            &case,
            pixels,
            || flip(&a, &b, DEFAULT_PIXELS_PER_DEGREE).mean,
            |v| vec![("value", *v)],
        );
        ctx.measure("PSNR", &case, pixels, || psnr(&a, &b), |v| vec![("value", *v)]);
    }
    ctx.note("Colour images; sizes are pixels; all threads. The error of SSIM is against its definition in double precision.");
    Ok(())
}

/// Two display images `[size, size, 3]`: waves with an edge, and the same shifted and noisy.
fn pair(size: usize) -> (Image, Image) {
    let wave = |x: f32, y: f32, c: usize| {
        let k = 0.11 * (c + 1) as f32;
        let edge = if x > y { 0.25 } else { -0.2 };
        (0.5 + 0.2 * (k * x).sin() * (0.07 * y).cos() + edge).clamp(0.0, 1.0)
    };
    let noise = |x: usize, y: usize| ((x * 7919 + y * 104_729) % 101) as f32 / 101.0 - 0.5;
    let (mut a, mut b) = (Image::new(size, size, 3), Image::new(size, size, 3));
    for y in 0..size {
        for x in 0..size {
            for c in 0..3 {
                let (fx, fy) = (x as f32, y as f32);
                a.pixel_mut(x, y)[c] = wave(fx, fy, c);
                b.pixel_mut(x, y)[c] = (wave(fx + 0.7, fy, c) + 0.08 * noise(x, y)).clamp(0.0, 1.0);
            }
        }
    }
    (a, b)
}

/// Mean SSIM (Wang et al. 2004) over the pixels whose 11 x 11 Gaussian window lies inside, by its definition.
fn ssim_by_definition(a: &Image, b: &Image) -> f64 {
    const RADIUS: usize = 5;
    let weight = |d: usize| (-0.5 * (d as f64 - RADIUS as f64).powi(2) / (1.5 * 1.5)).exp();
    let total: f64 = (0..11).map(weight).sum();
    let window: Vec<f64> = (0..121).map(|i| weight(i % 11) * weight(i / 11) / (total * total)).collect();
    let (c1, c2) = (0.01_f64.powi(2), 0.03_f64.powi(2));
    let (mut sum, mut count) = (0.0, 0);
    for y in RADIUS..a.height - RADIUS {
        for x in RADIUS..a.width - RADIUS {
            for c in 0..a.channels {
                let mut m = [0.0; 5];
                for (i, w) in window.iter().enumerate() {
                    let (px, py) = (x + i % 11 - RADIUS, y + i / 11 - RADIUS);
                    let (p, q) = (f64::from(a.pixel(px, py)[c]), f64::from(b.pixel(px, py)[c]));
                    for (m, v) in m.iter_mut().zip([p, q, p * p, q * q, p * q]) {
                        *m += w * v;
                    }
                }
                let [mp, mq, pp, qq, pq] = m;
                let (vp, vq, cov) = (pp - mp * mp, qq - mq * mq, pq - mp * mq);
                sum += (2.0 * mp * mq + c1) * (2.0 * cov + c2) / ((mp * mp + mq * mq + c1) * (vp + vq + c2));
                count += 1;
            }
        }
    }
    sum / f64::from(count)
}

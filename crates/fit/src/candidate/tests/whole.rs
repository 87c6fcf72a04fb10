//! What a fit of an asset runs: several samples per pixel, live mip chains, silhouettes, every sample of a texel; peeled
//! layers with blended sheets and a mask that is cut, or one opaque layer. Random seed gradients and the losses of the product.

use super::*;
use crate::engine::loss::Weights;
use photofit_raster::texture::{MipRule, mip_size};

const VALUES: [Value; 3] = [
    Value::Weighted,
    Value::Loss(PictureLoss { loss: Loss::LogSrgbL1, weights: Weights::Equal }),
    Value::Loss(PictureLoss::RELATIVE_SQUARES),
];

#[test]
fn gradients_of_the_whole_step() {
    for (kind, layers) in [(Kind::Transparent, 6), (Kind::Opaque, 2)] {
        let mut setting = Setting::new(kind, Content::Random, 3);
        let (_, seen) = setting.evaluate(Value::Weighted);
        assert!(seen.len() >= layers, "{} layers of two pictures", seen.len());
        assert!(setting.candidate.maps.levels.len() == 7, "a live chain");
        let rule = setting.candidate.maps.rule;
        assert_eq!(rule == MipRule::Area, kind == Kind::Opaque, "the chain that ships: {rule:?}");
        let groups = GROUPS.iter().filter(|g| kind == Kind::Transparent || g.0 != "alpha");
        let mut rows: Vec<(&str, [f64; 3])> = groups
            .map(|(name, channels)| {
                let worst = |v| channels.clone().map(|c| setting.channel_error(v, c)).fold(0.0, f64::max);
                (*name, VALUES.map(worst))
            })
            .collect();
        let unused = setting.gradients(Value::Weighted);
        let unused = unused.rendered.maps.levels[0].texels.iter().flat_map(|t| &t[channel::USED..]);
        assert!(unused.into_iter().all(|g| *g == 0.0), "unused samples have no gradient");
        let mut linear = Setting::new(kind, Content::Linear, 3);
        rows.push(("positions", VALUES.map(|v| linear.position_error(v))));
        let what = if kind == Kind::Opaque { "opaque" } else { "transparent" };
        println!("| {what} | random weights | log-sRGB L1 | relative squares |\n|---|---|---|---|");
        for (name, [weighted, logarithmic, relative]) in &rows {
            println!("| {name} | {weighted:.1e} | {logarithmic:.1e} | {relative:.1e} |");
        }
        // What the mip level, which passes no gradient to positions, leaves out: all of it shows on maps of noise.
        let left_out = VALUES.map(|v| setting.position_error(v));
        println!("positions on maps of noise: {left_out:.3?}");
        for (name, errors) in rows {
            assert!(errors.iter().all(|e| *e < 1e-6), "{name}: relative errors {errors:?}");
        }
        assert!(left_out.iter().all(|e| *e < 0.2), "{left_out:?}");
    }
}

/// Bilinear upsampling of what `coarse` has, added to the texels of `fine`: a quarter of each for every texel below it.
fn upsampled(coarse: &Maps<f64>, fine: &mut Maps<f64>) {
    let parents = |i: usize, n: usize| {
        let at = ((i as f64 + 0.5) / 2.0 - 0.5).clamp(0.0, (n - 1) as f64);
        let first = at.floor() as usize;
        [(first, 1.0 - at.fract()), ((first + 1).min(n - 1), at.fract())]
    };
    for (i, texel) in fine.texels.iter_mut().enumerate() {
        for (y, wy) in parents(i / fine.width, coarse.height) {
            for (x, wx) in parents(i % fine.width, coarse.width) {
                let from = &coarse.texels[y * coarse.width + x];
                texel.iter_mut().zip(from).for_each(|(t, f)| *t += 0.25 * wx * wy * f);
            }
        }
    }
}

#[test]
fn the_smooth_adjoint_upsamples_the_gradients_of_all_levels() {
    let mut setting = Setting::new(Kind::Opaque, Content::Random, 5);
    // Of levels that are parameters themselves: their gradients are those of differences.
    setting.candidate.maps.rule = MipRule::Free;
    let free = setting.gradients(Value::Weighted).rendered.maps;
    for k in 0..3 {
        let count = free.levels[k].texels.len();
        let place = |c: &mut Candidate<f64>, d: &[f64], step: f64| {
            let moved = c.maps.levels[k].texels.iter_mut().zip(d.chunks(CHANNELS));
            moved.for_each(|(t, d)| t.iter_mut().zip(d).for_each(|(t, d)| *t += d * step));
        };
        let along = |g: &ParameterGradients<f64>, d: &[f64]| {
            g.rendered.maps.levels[k].texels.as_flattened().iter().zip(d).map(|(g, d)| g * d).sum()
        };
        let error = setting.error(Value::Weighted, (count * CHANNELS, STEP), place, along);
        // Normals move with everything else: the difference has their curvature.
        assert!(error < 1e-5, "level {k}: relative error {error:e}");
    }
    let mut expected = free;
    for k in (1..expected.levels.len()).rev() {
        let (fine, coarse) = expected.levels.split_at_mut(k);
        assert_eq!((coarse[0].width, coarse[0].height), mip_size(fine[k - 1].width, fine[k - 1].height));
        upsampled(&coarse[0], &mut fine[k - 1]);
    }
    setting.candidate.maps.rule = MipRule::Area;
    setting.candidate.mip_adjoint = MipAdjoint::Smooth;
    let smooth = setting.gradients(Value::Weighted).rendered.maps;
    let size = |m: &Maps<f64>| m.texels.as_flattened().iter().map(|g| g * g).sum::<f64>().sqrt();
    let pairs = smooth.levels[0].texels.as_flattened().iter().zip(expected.levels[0].texels.as_flattened());
    let wrong = pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    assert!(wrong < 1e-10 * size(&expected.levels[0]), "{wrong:e} of {:e}", size(&expected.levels[0]));
    setting.candidate.mip_adjoint = MipAdjoint::Exact;
    let exact = setting.gradients(Value::Weighted).rendered.maps;
    assert_ne!(exact.levels[0], smooth.levels[0], "levels beyond the first are at work");
}

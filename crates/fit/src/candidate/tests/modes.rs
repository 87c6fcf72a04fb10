//! The other modes of the step: pixels that are shaded once for each triangle, as for levels of detail; masks that fade;
//! the squared error, of noisy pictures; shapes that stay; poses; passes that are switched off.

use super::*;
use std::ops::Range;

/// Where colour and roughness alone are fitted.
const LIT: [Range<usize>; 2] = [channel::BASE_COLOR..channel::ALPHA, channel::ROUGHNESS..channel::METALLIC];

/// A mode: how a setting differs from what [`super::whole`] checks.
struct Mode {
    name: &'static str,
    kind: Kind,
    loss: Loss,
    /// Samples of a texel that have gradients.
    channels: Vec<Range<usize>>,
    change: fn(&mut Setting),
}

/// Levels of their own, none of which follows from another: on maps of noise they differ as much as texels do.
fn free(s: &mut Setting) {
    let chain = s.candidate.maps.levels.clone();
    let linear = chain.len() < 7;
    s.candidate.free_mips();
    if linear {
        // Normals of unit length would not be linear in uv.
        s.candidate.maps.levels = chain;
        return;
    }
    let mut rng = Uniform::new(11);
    for texel in s.candidate.maps.levels[1..].iter_mut().flat_map(|l| &mut l.texels) {
        for c in [0, 1, 2, channel::ROUGHNESS, channel::METALLIC] {
            texel[c] = rng.range(0.35, 0.8);
        }
        // Where masks fade, far from the ends of their slope.
        texel[channel::ALPHA] = rng.range(0.4, 0.6);
    }
}

fn modes() -> Vec<Mode> {
    let all = GROUPS.map(|(_, channels)| channels).to_vec();
    let mode = |name, kind, loss, channels: &[Range<usize>], change| Mode {
        name,
        kind,
        loss,
        channels: channels.to_vec(),
        change,
    };
    let (logarithmic, squares) = (Loss::LogSrgbL1, Loss::Mse);
    let emission = std::array::from_ref(&(channel::EMISSIVE..channel::USED));
    let engine = |s: &mut Setting| s.sampling = Sampling::ENGINE;
    let faded = |s: &mut Setting| s.passes.masks = Masks::Faded { slope: 2.0 };
    let still = |s: &mut Setting| (s.passes.position_gradients, s.passes.antialias) = (false, false);
    vec![
        mode("shaded once per pixel and triangle", Kind::Transparent, logarithmic, &all, engine),
        mode("the same, opaque", Kind::Opaque, logarithmic, &LIT, engine),
        mode("the same, masks fade", Kind::Transparent, logarithmic, &all, |s| {
            s.sampling = Sampling::ENGINE;
            s.passes.masks = Masks::Faded { slope: 2.0 };
        }),
        mode("free mip levels", Kind::Transparent, logarithmic, &all, |s| {
            s.sampling = Sampling::ENGINE;
            s.passes.masks = Masks::Faded { slope: 2.0 };
            free(s);
        }),
        mode("free mip levels, masks are cut", Kind::Transparent, logarithmic, &all, |s| {
            s.sampling = Sampling::ENGINE;
            free(s);
        }),
        mode("free mip levels, opaque", Kind::Opaque, logarithmic, &LIT, |s| {
            s.sampling = Sampling::ENGINE;
            free(s);
        }),
        mode("masks fade", Kind::Transparent, logarithmic, &all, faded),
        mode("squared error", Kind::Transparent, squares, &all, |_| {}),
        mode("the shape stays", Kind::Transparent, logarithmic, &all, still),
        mode("a pose", Kind::Transparent, logarithmic, &all, |s| {
            (s.passes.position_gradients, s.passes.antialias, s.posed) = (false, false, true);
        }),
        mode("two poses of a shape that moves", Kind::Transparent, logarithmic, &all, Setting::bend),
        mode("the same, opaque", Kind::Opaque, logarithmic, &LIT, Setting::bend),
        mode("the same, shaded once per pixel and triangle", Kind::Opaque, squares, &LIT, |s| {
            s.sampling = Sampling::ENGINE;
            s.bend();
        }),
        mode("no normal map, no emission", Kind::Opaque, squares, &LIT, |s| {
            (s.passes.normal_map, s.passes.emissive) = (false, false);
        }),
        mode("no lights", Kind::Opaque, squares, emission, |s| s.lit = false),
        mode("no lights, shaded once per pixel and triangle", Kind::Opaque, logarithmic, emission, |s| {
            s.sampling = Sampling::ENGINE;
            s.lit = false;
        }),
        mode("alpha is not fitted", Kind::Transparent, logarithmic, &LIT, |s| {
            s.passes.alpha_gradients = false;
        }),
    ]
}

#[test]
fn gradients_of_the_other_modes_that_ship() {
    println!("| mode | maps | positions |\n|---|---|---|");
    for Mode { name, kind, loss, channels, change } in modes() {
        let value = Value::Loss(loss.into());
        let set = |content| {
            let mut setting = Setting::new(kind, content, 3);
            change(&mut setting);
            setting
        };
        let (mut random, mut linear) = (set(Content::Random), set(Content::Linear));
        // One of each group: all of them are moved in the usual mode.
        let each: Vec<f64> = channels.iter().map(|c| random.channel_error(value, c.start)).collect();
        let maps = each.iter().copied().fold(0.0, f64::max);
        let positions = linear.passes.position_gradients.then(|| linear.position_error(value));
        println!("| {name} | {maps:.1e} | {} |", positions.map_or("-".into(), |p| format!("{p:.1e}")));
        // Normals of free levels move as freely as those of the base: the differences have their curvature.
        let most = if name.starts_with("free") { 1e-5 } else { 1e-6 };
        assert!(maps < most, "{name}: relative errors {each:?} of {channels:?}");
        assert!(positions.is_none_or(|p| p < 1e-6), "{name}: relative error {positions:?}");
    }
}

#[test]
fn several_levels_are_read() {
    for (kind, sampling) in [
        (Kind::Transparent, Sampling { per_axis: SAMPLES, shade_per_pixel: false }),
        (Kind::Opaque, Sampling { per_axis: SAMPLES, shade_per_pixel: false }),
        (Kind::Opaque, Sampling::ENGINE),
    ] {
        let mut setting = Setting::new(kind, Content::Random, 3);
        setting.sampling = sampling;
        // Levels keep the gradients that pixels give them.
        setting.candidate.maps.rule = MipRule::Free;
        let levels = setting.gradients(Value::Weighted).rendered.maps.levels;
        let read = levels.iter().filter(|l| l.texels.as_flattened().iter().any(|g| *g != 0.0));
        assert!(read.count() >= 3, "{sampling:?}");
    }
}

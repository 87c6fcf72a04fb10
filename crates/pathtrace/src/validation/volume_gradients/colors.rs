//! Media of coloured extinction, colour by colour, and media without an end.

use super::*;

/// Thin enough that the lamp is seen through it.
fn density(kind: Kind) -> f32 {
    if kind == Kind::Around { 0.1 } else { 0.6 }
}

/// A medium whose colours are dimmed and scattered otherwise.
fn colored(kind: Kind) -> Cloud {
    let albedo = vec![vec3(0.02, 0.5, 0.8)];
    Cloud { tint: vec3(0.5, 1.0, 2.0), albedo, ..Cloud::uniform(kind, density(kind)) }
}

/// Standard errors are below `resolved` of the derivative; around everything, where what is lost and what is scattered cancel in one colour, or
/// of a quarter of the largest.
fn extinctions(kind: Kind, spp: [u32; 2], resolved: f64) {
    let found = [0, 1, 2].map(|channel| {
        let at = |x: f64| {
            let mut cloud = colored(kind);
            cloud.tint[channel] += x as f32;
            cloud
        };
        let b = differences(at, 0.1, false, spp[1]);
        // The density is a factor of the tint.
        let a = colored(kind).replayed(MediumValue::Extinction, spp[0], |_, c| {
            if c == channel { f64::from(density(kind)) } else { 0.0 }
        });
        (a, b)
    });
    let largest = found.iter().fold(0.0_f64, |most, (_, b)| most.max(b.0.abs()));
    let floor = if kind == Kind::Around { 0.25 * largest } else { 0.0 };
    for (channel, (a, b)) in found.into_iter().enumerate() {
        let most = resolved * b.0.abs().max(floor);
        compare_within(&format!("extinction of colour {channel}, {kind:?}"), a, b, most);
    }
}

fn albedos(kind: Kind, spp: [u32; 2], resolved: f64) {
    for channel in 0..3 {
        let at = |x: f64| {
            let mut cloud = colored(kind);
            cloud.albedo[0][channel] += x as f32;
            cloud
        };
        let b = differences(at, 0.02, false, spp[1]);
        let a =
            colored(kind).replayed(MediumValue::Albedo, spp[0], |_, c| if c == channel { 1.0 } else { 0.0 });
        compare(&format!("albedo of colour {channel}, {kind:?}"), a, b, resolved);
    }
}

#[test]
fn colours_have_derivatives_of_their_own() {
    extinctions(Kind::Even, [64, 512], 0.08);
    albedos(Kind::Even, [64, 256], 0.08);
}

#[test]
fn media_without_an_end_have_derivatives() {
    albedos(Kind::Around, [64, 1024], 0.12);
}

#[test]
#[ignore = "slow: many samples"]
fn colours_have_derivatives_of_their_own_closely() {
    extinctions(Kind::Even, [2048, 8192], 0.02);
    albedos(Kind::Around, [512, 16384], 0.04);
    extinctions(Kind::Around, [512, 16384], 0.15);
}

//! Tone mapping: light of any brightness into the range of a display.

/// Where compression begins.
const START: f32 = 0.8 - 0.04;
/// How fast compressed colours lose saturation.
const DESATURATION: f32 = 0.15;

/// Khronos PBR Neutral (2024): linear colour, not negative, into `[0, 1]`; colours below about 0.76 are kept but for the
/// reflection of a dielectric, brighter ones are compressed and drawn towards white, without a shift of hue.
///
/// ```
/// use photofit_image::tone_map;
/// let [r, g, b] = tone_map([20.0, 5.0, 1.0]);
/// assert!(r <= 1.0 && r > g && g > b);
/// ```
pub fn tone_map(rgb: [f32; 3]) -> [f32; 3] {
    // Beyond the last value all is white.
    let rgb = rgb.map(|x| if x > 0.0 { x.min(1e30) } else { 0.0 });
    let least = rgb[0].min(rgb[1]).min(rgb[2]);
    // A dielectric adds 0.04 to its base colour at normal incidence.
    let offset = if least < 0.08 { least - 6.25 * least * least } else { 0.04 };
    let rgb = rgb.map(|x| x - offset);
    let peak = rgb[0].max(rgb[1]).max(rgb[2]);
    if peak < START {
        return rgb;
    }
    let room = 1.0 - START;
    let new_peak = 1.0 - room * room / (peak + room - START);
    let kept = 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    rgb.map(|x| x * (new_peak / peak) * kept + new_peak * (1.0 - kept))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dark_colours_are_kept_and_bright_ones_fit() {
        for grey in [0.0, 0.02, 0.18, 0.5, 0.7] {
            let [r, g, b] = tone_map([grey; 3]);
            assert!(r == g && g == b && (grey - r) < 0.0401 && r <= grey, "{grey}: {r}");
        }
        let mut last = 0.0;
        for i in 0..60 {
            let x = 1.3_f32.powi(i) * 0.01;
            let [r, g, b] = tone_map([x, 0.5 * x, 0.1 * x]);
            assert!(r >= last - 1e-6 && r <= 1.0 && g <= r && b <= g, "{x}: {r} {g} {b}");
            last = r;
        }
        let white = tone_map([1e6, 1e5, 1e4]);
        assert!(white.iter().all(|c| *c > 0.97), "very bright colours turn white: {white:?}");
        for x in [f32::INFINITY, f32::NAN, f32::NEG_INFINITY] {
            assert!(tone_map([x, 1.0, 0.0]).iter().all(|c| (0.0..=1.0).contains(c)), "{x}");
        }
    }
}

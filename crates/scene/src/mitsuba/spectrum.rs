//! Colours from spectra: the standard observer and daylight.

use super::properties::Reader;
use crate::error::{Fault, fault};
use crate::load::clip;
use photofit_scalar::{Vec3f, vec3};

/// What a spectrum stands for, which decides about the white that it is measured against.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Meaning {
    /// Light: power per wavelength.
    Emission,
    /// A share of light between 0 and 1, seen in daylight.
    Reflectance,
    /// An index of refraction, or a coefficient.
    Unbounded,
}

/// First wavelength of the table and its step, nanometres.
const FIRST: f64 = 360.0;
const STEP: f64 = 5.0;

/// The colour of a spectrum given at wavelengths (in nanometres, rising), linear in between and zero outside.
pub(super) fn color(points: &[(f64, f64)], meaning: Meaning) -> Vec3f {
    let mut xyz = [0.0_f64; 3];
    let mut white = 0.0;
    let last = FIRST + STEP * (TABLE.len() - 1) as f64;
    let mut next = 0;
    for i in 0..=(last - FIRST) as usize {
        let x = FIRST + i as f64;
        let [a, b, c, d65] = row(x);
        let light = if meaning == Meaning::Emission { 1.0 } else { d65 };
        white += b * light;
        while next < points.len() && points[next].0 < x {
            next += 1;
        }
        let y = match (next.checked_sub(1).map(|k| points[k]), points.get(next)) {
            (_, Some(p)) if p.0 == x => p.1,
            (Some(p), Some(q)) => p.1 + (q.1 - p.1) * (x - p.0) / (q.0 - p.0),
            _ => continue,
        };
        for (sum, weight) in xyz.iter_mut().zip([a, b, c]) {
            *sum += weight * light * y;
        }
    }
    let [x, y, z] = xyz.map(|v| v / white);
    let rgb = vec3(
        (3.240_479 * x - 1.537_150 * y - 0.498_535 * z) as f32,
        (-0.969_256 * x + 1.875_991 * y + 0.041_556 * z) as f32,
        (0.055_648 * x - 0.204_043 * y + 1.057_311 * z) as f32,
    );
    match meaning {
        Meaning::Reflectance => rgb.map(|v| v.clamp(0.0, 1.0)),
        _ => rgb.map(|v| v.max(0.0)),
    }
}

/// Matching functions and daylight at a wavelength.
fn row(wavelength: f64) -> [f64; 4] {
    let at = ((wavelength - FIRST) / STEP).clamp(0.0, (TABLE.len() - 1) as f64);
    let i = (at as usize).min(TABLE.len() - 2);
    let f = at - i as f64;
    std::array::from_fn(|k| f64::from(TABLE[i][k]) * (1.0 - f) + f64::from(TABLE[i + 1][k]) * f)
}

impl Reader {
    /// The colour of a `spectrum` element: one number, pairs of wavelength and value, or a file of such pairs.
    pub(super) fn spectrum(&mut self, element: usize, meaning: Meaning) -> Result<Vec3f, Fault> {
        let place = self.place(element);
        let e = &self.document.elements[element];
        if e.kind == "uniform" || (!e.kind.is_empty() && e.kind != "regular" && e.kind != "irregular") {
            return self.spectrum_plugin(element);
        }
        let text = if let Some(name) = e.attribute("filename") {
            let path = self.document.resolve(name, &place)?;
            let bytes = crate::load::read_file(&path, 1 << 20).map_err(|e| fault(&place, e.to_string()))?;
            let text = String::from_utf8_lossy(&bytes).into_owned();
            let lines = text.lines().filter(|l| !l.trim_start().starts_with('#'));
            lines.map(|l| l.split_whitespace().collect::<Vec<_>>().join(":")).collect::<Vec<_>>().join(" ")
        } else {
            e.attribute("value")
                .ok_or_else(|| {
                    fault(&place, "the spectrum has neither value nor filename; it must have one of them")
                })?
                .to_owned()
        };
        if !text.contains(':') {
            let value = self.attribute_number(element, "value")?;
            return Ok(match meaning {
                // Before version 3, one number was a grey.
                Meaning::Emission if self.document.version >= 3 => {
                    color(&[(0.0, value), (1e4, value)], meaning)
                }
                _ => Vec3f::splat(value as f32),
            });
        }
        let mut points: Vec<(f64, f64)> = Vec::new();
        for word in text.split([',', ' ', '\t', '\n', '\r']).filter(|w| !w.is_empty()) {
            let parsed = word.split_once(':').and_then(|(x, y)| Some((x.parse().ok()?, y.parse().ok()?)));
            let (x, y) =
                parsed.filter(|(x, y): &(f64, f64)| x.is_finite() && y.is_finite()).ok_or_else(|| {
                    fault(&place, format!("the entry is `{}`; it must be wavelength:value", clip(word)))
                })?;
            if points.last().is_some_and(|p| p.0 >= x) {
                return Err(fault(place, "a wavelength is not above the one before; wavelengths must rise"));
            }
            points.push((x, y));
        }
        Ok(color(&points, meaning))
    }

    /// Spectra with a `type`.
    fn spectrum_plugin(&mut self, element: usize) -> Result<Vec3f, Fault> {
        let kind = self.kind(element).to_owned();
        let out = match kind.as_str() {
            "uniform" => Vec3f::splat(self.float(element, "value")?.unwrap_or(1.0) as f32),
            "d65" => Vec3f::splat(self.float(element, "scale")?.unwrap_or(1.0) as f32),
            "srgb" => match self.property(element, "color", &["rgb"]) {
                Some(e) => self.rgb(e)?,
                None => Vec3f::splat(1.0),
            },
            _ => {
                let title = self.title(element);
                self.unsupported(element, title);
                self.mark_all(element);
                Vec3f::splat(1.0)
            }
        };
        self.finish(element);
        Ok(out)
    }
}

/// CIE 1931 colour matching functions x, y and z, and the power of CIE D65 (relative to its luminance), every 5 nm.
#[rustfmt::skip]
const TABLE: [[f32; 4]; 95] = [
    [0.013867, 0.00041814, 0.064701, 0.47111],
    [0.024777, 0.00074352, 0.11593, 0.49864],
    [0.044291, 0.0013226, 0.20774, 0.52617],
    [0.079166, 0.0023506, 0.37213, 0.51549],
    [0.14603, 0.0041633, 0.68854, 0.50482],
    [0.23869, 0.006832, 1.1262, 0.52842],
    [0.45294, 0.01281, 2.1403, 0.55202],
    [0.81664, 0.023165, 3.8654, 0.69397],
    [1.5276, 0.042273, 7.243, 0.83593],
    [2.4755, 0.06832, 11.764, 0.88003],
    [4.6447, 0.12917, 22.14, 0.92413],
    [8.287, 0.23272, 39.636, 0.93395],
    [14.345, 0.427, 68.918, 0.94378],
    [22.927, 0.77928, 110.92, 0.90969],
    [30.306, 1.2383, 147.91, 0.8756],
    [35.067, 1.7977, 173.25, 0.96744],
    [37.179, 2.4553, 186.5, 1.0593],
    [37.155, 3.1812, 190.29, 1.1206],
    [35.889, 4.0565, 189.17, 1.1819],
    [34.021, 5.124, 186.18, 1.186],
    [31.043, 6.405, 178.19, 1.1901],
    [26.805, 7.8888, 163.13, 1.1751],
    [20.855, 9.7121, 137.46, 1.1602],
    [15.169, 12.02, 111.22, 1.1656],
    [10.21, 14.84, 86.783, 1.171],
    [6.1862, 18.073, 65.78, 1.135],
    [3.4171, 22.206, 49.658, 1.0991],
    [1.5692, 27.606, 37.715, 1.1019],
    [0.52308, 34.48, 29.036, 1.1046],
    [0.2562, 43.479, 22.663, 1.0968],
    [0.99278, 53.695, 16.888, 1.0889],
    [3.1064, 64.926, 11.924, 1.0737],
    [6.7541, 75.793, 8.3532, 1.0585],
    [11.7, 84.674, 6.1115, 1.0731],
    [17.667, 92.019, 4.5006, 1.0878],
    [24.099, 97.66, 3.1854, 1.0712],
    [31.0, 101.84, 2.167, 1.0546],
    [38.398, 104.65, 1.4305, 1.0528],
    [46.271, 106.21, 0.93406, 1.051],
    [54.661, 106.75, 0.61381, 1.0306],
    [63.463, 106.22, 0.41633, 1.0101],
    [72.419, 104.47, 0.29356, 0.99161],
    [81.354, 101.63, 0.22418, 0.9731],
    [89.937, 97.719, 0.19215, 0.97034],
    [97.815, 92.873, 0.17614, 0.96758],
    [104.47, 87.14, 0.14945, 0.93171],
    [109.56, 80.81, 0.11743, 0.89584],
    [112.8, 74.181, 0.10675, 0.90251],
    [113.39, 67.359, 0.0854, 0.90918],
    [111.62, 60.506, 0.06405, 0.90712],
    [107.03, 53.695, 0.036295, 0.90507],
    [100.17, 47.098, 0.02562, 0.89547],
    [91.213, 40.672, 0.020283, 0.88587],
    [80.212, 34.267, 0.010675, 0.86359],
    [68.576, 28.289, 0.0053375, 0.84132],
    [57.848, 23.165, 0.0032025, 0.84339],
    [47.813, 18.681, 0.002135, 0.84547],
    [38.515, 14.753, 0.0010675, 0.82692],
    [30.264, 11.422, 0.0, 0.80837],
    [23.346, 8.7108, 0.0, 0.80932],
    [17.603, 6.5118, 0.0, 0.81027],
    [12.938, 4.7589, 0.0, 0.82069],
    [9.33, 3.416, 0.0, 0.83111],
    [6.7893, 2.4766, 0.0, 0.81094],
    [4.9927, 1.8148, 0.0, 0.79077],
    [3.5121, 1.2725, 0.0, 0.74752],
    [2.4232, 0.87642, 0.0, 0.70427],
    [1.6909, 0.61093, 0.0, 0.71381],
    [1.2126, 0.43789, 0.0, 0.72334],
    [0.86584, 0.31267, 0.0, 0.73718],
    [0.61812, 0.22321, 0.0, 0.75102],
    [0.43869, 0.15842, 0.0, 0.68665],
    [0.3095, 0.11177, 0.0, 0.62228],
    [0.21875, 0.078995, 0.0, 0.66411],
    [0.15372, 0.05551, 0.0, 0.70593],
    [0.10674, 0.038548, 0.0, 0.7322],
    [0.073666, 0.026602, 0.0, 0.75847],
    [0.050815, 0.01835, 0.0, 0.70042],
    [0.035473, 0.01281, 0.0, 0.64237],
    [0.025068, 0.0090524, 0.0, 0.55562],
    [0.017737, 0.006405, 0.0, 0.46888],
    [0.012534, 0.0045262, 0.0, 0.57185],
    [0.0088683, 0.0032025, 0.0, 0.67482],
    [0.0062669, 0.0022631, 0.0, 0.65753],
    [0.0044312, 0.0016002, 0.0, 0.64025],
    [0.0031335, 0.0011316, 0.0, 0.6449],
    [0.0022069, 0.00079697, 0.0, 0.64955],
    [0.0015543, 0.00056127, 0.0, 0.62505],
    [0.0010946, 0.00039529, 0.0, 0.60054],
    [0.00077089, 0.00027838, 0.0, 0.5627],
    [0.00054292, 0.00019606, 0.0, 0.52485],
    [0.00038234, 0.00013807, 0.0, 0.55254],
    [0.00026928, 0.000097242, 0.0, 0.58022],
    [0.00018964, 0.0000684835, 0.0, 0.59473],
    [0.00013356, 0.0000482308, 0.0, 0.60923],
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_stays_white_and_equal_energy_is_reddish() {
        let flat = [(300.0, 1.0), (900.0, 1.0)];
        let close = |c: Vec3f, e: [f32; 3]| c.to_array().iter().zip(e).all(|(a, b)| (a - b).abs() < 2e-3);
        assert!(
            close(color(&flat, Meaning::Reflectance), [1.0; 3]),
            "{:?}",
            color(&flat, Meaning::Reflectance)
        );
        assert!(close(color(&flat, Meaning::Emission), [1.2048, 0.9483, 0.9089]));
        // As other renderers make of the lamp of the Cornell box.
        let lamp = [(400.0, 0.0), (500.0, 8.0), (600.0, 15.6), (700.0, 18.4)];
        let c = color(&lamp, Meaning::Emission);
        assert!(
            (c.x - 20.71).abs() < 0.03 && (c.y - 10.85).abs() < 0.02 && (c.z - 2.77).abs() < 0.01,
            "{c:?}"
        );
        // Nothing in the range, and a single wavelength.
        assert_eq!(color(&[(100.0, 1.0), (200.0, 1.0)], Meaning::Emission), Vec3f::zero());
        assert!(color(&[(500.0, 1.0)], Meaning::Reflectance).is_finite());
    }
}

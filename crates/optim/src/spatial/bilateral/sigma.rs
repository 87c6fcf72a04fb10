//! The width of the range weights from the parameters themselves.

use super::{GuideMap, Sigma};
use crate::spatial::grid::Grid;
use photofit_scalar::Real;

/// Sites looked at, about.
const SAMPLES: usize = 8192;

/// `sigma_d` in the guide's units.
///
/// Automatic: `k` times the median length of the differences between neighbours along the axes (for scalars the median
/// absolute deviation of the signed differences about zero), at least `.2 rate` carried through the guide's map at the
/// median parameter: parameters that have converged jitter by about the rate. From a fixed set of sites, so that
/// it takes no time and does not depend on anything but the parameters.
pub(super) fn sigma<T: Real>(
    sigma: Sigma,
    map: GuideMap,
    grid: Grid,
    values: &[T],
    cuts: Option<&[T]>,
    rate: f64,
) -> f64 {
    let factor = match sigma {
        Sigma::Fixed(sigma) => return sigma,
        Sigma::Unlimited => return f64::INFINITY,
        Sigma::Auto(k) => k,
    };
    let (sites, shape, strides) = (grid.sites(), grid.shape(), grid.strides());
    let channels = values.len() / sites;
    let (mut lengths, mut sizes) = (Vec::new(), Vec::new());
    let samples = sites.min(SAMPLES);
    for k in 0..samples {
        let (from, to) = (k * sites / samples, (k + 1) * sites / samples);
        let site = from + scatter(k as u64) as usize % (to - from);
        let own = &values[site * channels..(site + 1) * channels];
        sizes.push(own.iter().map(|x| x.f64().powi(2)).sum::<f64>().sqrt());
        for axis in 0..3 {
            let other = site + strides[axis];
            let inside = site / strides[axis] % shape[axis] + 1 < shape[axis];
            if !inside || cuts.is_some_and(|c| c[site] != c[other]) {
                continue;
            }
            let other = &values[other * channels..(other + 1) * channels];
            let square = |(a, b): (&T, &T)| (map.value(*a).f64() - map.value(*b).f64()).powi(2);
            lengths.push(own.iter().zip(other).map(square).sum::<f64>().sqrt());
        }
    }
    let floor = 0.2 * rate * map.slope(median(&mut sizes));
    (factor * median(&mut lengths)).max(floor)
}

/// Lower median; 0 of nothing.
fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = (values.len() - 1) / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Well-mixed bits of `k`.
fn scatter(k: u64) -> u64 {
    let mut z = k.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb) >> 32
}

//! What collisions leave to tell of the derivatives of a medium, on average.
//!
//! They tell `sigma_t^2 / (sigma_t^2 + c^2)` of what a point of a flight scatters, `c` one over the flight's way in the medium
//! (see the replay of media). Of media whose extinction varies, the mean of the rest, `1 / (1 + (sigma_t / c)^2)`, over all
//! voxels is kept for every power of two of the way.

/// No less is told to be left, so that no flight with light to gather is never chosen.
const LEAST: f32 = 1e-3;
/// Exponents of numbers in single precision.
const EXPONENTS: usize = 256;

/// What is left at an extinction times a way.
#[inline]
pub(super) fn untold(thickness: f32) -> f32 {
    (1.0 / (1.0 + thickness * thickness)).max(LEAST)
}

/// The mean of [`untold`] over the voxels of a grid, by the exponent of the way.
#[derive(Debug)]
pub(super) struct Untold([f32; EXPONENTS]);

impl Untold {
    /// Of extinctions that are finite and not negative.
    pub(super) fn new(extinction: &[f32]) -> Self {
        let mut voxels = [0_u32; EXPONENTS];
        extinction.iter().for_each(|e| voxels[exponent(*e)] += 1);
        let mean = |way: usize| {
            let left = |e: usize| {
                // The middle of the extinctions of this exponent, times the way.
                let middle = e as f32 + 0.5 - 127.0;
                untold((middle + way as f32 - 127.0).exp2())
            };
            // Exponent 0 is that of nothing.
            let sum: f64 = (0..EXPONENTS)
                .filter(|e| voxels[*e] > 0)
                .map(|e| f64::from(voxels[e]) * if e == 0 { 1.0 } else { f64::from(left(e)) })
                .sum();
            (sum / extinction.len() as f64) as f32
        };
        Self(std::array::from_fn(mean))
    }

    /// Of a finite way.
    #[inline]
    pub(super) fn at(&self, way: f32) -> f32 {
        let e = exponent(way);
        let [a, b] = [self.0[e], self.0[(e + 1).min(EXPONENTS - 1)]];
        let fraction = (way.to_bits() & 0x7f_ffff) as f32 / (1_u32 << 23) as f32;
        a + (b - a) * fraction
    }
}

/// The biased exponent of a number that is not negative.
fn exponent(x: f32) -> usize {
    (x.to_bits() >> 23) as usize & (EXPONENTS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    #[test]
    fn means_are_those_of_the_voxels() {
        let mut rng = Rng::new(5, 0);
        let mut grid = |n, from, to| (0..n).map(|_| rng.uniform(from, to)).collect::<Vec<f32>>();
        let mut sparse = vec![0.0; 300];
        sparse.extend(grid(3, 900.0, 1100.0));
        for values in [grid(200, 0.0, 4.0), grid(100, 3.0, 40.0), sparse, vec![0.0; 7], vec![1e38]] {
            let table = Untold::new(&values);
            for way in [1e-38, 1e-12, 1e-3, 0.1, 0.7, 1.0, 1.7, 30.0, 1e5, 1e30, 3e38] {
                let exact =
                    values.iter().map(|v| f64::from(untold(v * way))).sum::<f64>() / values.len() as f64;
                let found = f64::from(table.at(way));
                assert!((0.6..1.6).contains(&(found / exact)), "{way}: {found}, not {exact}");
            }
        }
    }
}

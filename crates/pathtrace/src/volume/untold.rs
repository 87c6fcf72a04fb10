//! What collisions leave to tell of the derivatives of a medium, on average.
//!
//! They tell `sigma_t^2 / (sigma_t^2 + c^2)` of what a point of a flight scatters, `c` one over the flight's way in the medium
//! (see the replay of media). Of media whose extinction varies, the mean of the rest, `1 / (1 + (sigma_t / c)^2)`, over all
//! voxels is kept for every power of two of the way.

use photofit_scalar::Vec3f;

/// The least that counts as left: flights through what is thick everywhere are still chosen, if seldom.
const LEAST: f32 = 1e-3;
/// Exponents of numbers in single precision.
const EXPONENTS: usize = 256;

/// What is left at an extinction times a way.
#[inline]
fn untold(thickness: f32) -> f32 {
    (1.0 / (1.0 + thickness * thickness)).max(LEAST)
}

/// What collisions leave to tell of a medium.
#[derive(Clone, Debug)]
pub(crate) enum Untold {
    /// Of an extinction that is the same everywhere.
    Even(Vec3f),
    /// The mean of [`untold`] over the voxels of a grid: its inverse, by the exponent of the way.
    Voxels(Box<[f32; EXPONENTS]>),
}

impl Untold {
    /// Of extinctions that are finite and not negative.
    pub(super) fn of_voxels(extinction: &[f32]) -> Self {
        // Voxels, and the sum of their extinctions, by the exponent of the extinction.
        let mut groups = [(0_u32, 0.0_f64); EXPONENTS];
        for e in extinction {
            let (voxels, sum) = &mut groups[exponent(*e)];
            *voxels += 1;
            *sum += f64::from(*e);
        }
        let groups: Vec<(f64, f32)> = groups
            .into_iter()
            .filter(|g| g.0 > 0)
            .map(|(voxels, sum)| (f64::from(voxels), (sum / f64::from(voxels)) as f32))
            .collect();
        let inverse = |way: usize| {
            let way = (way as f32 - 127.0).exp2().min(f32::MAX);
            let sum: f64 = groups.iter().map(|(voxels, mean)| voxels * f64::from(untold(mean * way))).sum();
            (extinction.len() as f64 / sum) as f32
        };
        Self::Voxels(Box::new(std::array::from_fn(inverse)))
    }

    /// How much of `throughput` is left on a finite way, on average over the points of the medium.
    #[inline]
    pub(crate) fn at(&self, way: f32, throughput: Vec3f) -> f32 {
        match self {
            Self::Even(sigma) => sigma.map(|s| untold(s * way)).dot(throughput),
            Self::Voxels(inverse) => {
                let e = exponent(way);
                let [a, b] = [inverse[e], inverse[(e + 1).min(EXPONENTS - 1)]];
                let fraction = (way.to_bits() & 0x7f_ffff) as f32 / (1_u32 << 23) as f32;
                throughput.sum() / (a + (b - a) * fraction)
            }
        }
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
    use photofit_scalar::vec3;

    #[test]
    fn means_are_those_of_the_voxels() {
        let mut rng = Rng::new(5, 0);
        let mut grid = |n, from, to| (0..n).map(|_| rng.uniform(from, to)).collect::<Vec<f32>>();
        let mut sparse = vec![0.0; 300];
        sparse.extend(grid(3, 900.0, 1100.0));
        for values in [
            grid(200, 0.0, 4.0),
            grid(100, 3.0, 40.0),
            sparse,
            vec![0.0; 7],
            vec![1e38],
            vec![1.0],
            vec![1.99],
        ] {
            let table = Untold::of_voxels(&values);
            for way in [1e-38, 1e-12, 1e-3, 0.1, 0.7, 1.0, 1.7, 6.0, 8.0, 12.0, 30.0, 1e5, 1e30, 3e38] {
                let exact =
                    values.iter().map(|v| f64::from(untold(v * way))).sum::<f64>() / values.len() as f64;
                let found = f64::from(table.at(way, vec3(1.0, 0.0, 0.0)));
                assert!((0.75..1.3).contains(&(found / exact)), "{way}: {found}, not {exact}");
            }
        }
    }
}

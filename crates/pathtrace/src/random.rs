//! The random numbers of a path: Owen-scrambled Sobol points, four dimensions at a time.

use photofit_sampling::{Rng, Sobol, hash, unit_f32};

/// Dimensions of the camera: place in the pixel, then place on the lens.
const CAMERA_GROUP: u32 = 0;
/// Groups per vertex: one for lights, one for scattering.
const GROUPS: u32 = 2;
/// Vertices with dimensions of their own; later ones draw independent numbers.
const VERTICES: u32 = 64;

/// The numbers of one sample of one pixel: functions of seed, pixel, sample and vertex alone.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathRandom {
    sobol: Sobol,
    sample: u32,
    /// Differs for every path.
    key: u64,
}

impl PathRandom {
    #[inline]
    pub(crate) fn new(seed: u64, pixel: u64, sample: u32) -> Self {
        Self { sobol: Sobol::new(seed, pixel), sample, key: hash(seed ^ 0x5eed, pixel, u64::from(sample)) }
    }

    /// Place in the pixel and on the lens.
    #[inline]
    pub(crate) fn camera(&self) -> [f32; 4] {
        self.sobol.sample_4d(self.sample, CAMERA_GROUP)
    }

    /// For the choice of a light at vertex `vertex`: the place on it, then the choice.
    #[inline]
    pub(crate) fn light(&self, vertex: u32) -> [f32; 4] {
        self.group(vertex, 0)
    }

    /// For scattering at vertex `vertex`: the direction, the lobe, roulette.
    #[inline]
    pub(crate) fn scatter(&self, vertex: u32) -> [f32; 4] {
        self.group(vertex, 1)
    }

    /// For the first flight through a medium behind vertex `vertex`: the colour, the distance. `None` for late vertices.
    #[inline]
    pub(crate) fn flight(&self, vertex: u32) -> Option<[f32; 2]> {
        (vertex < VERTICES).then(|| {
            let [a, b, ..] = self.sobol.sample_4d(self.sample, 1 + GROUPS * VERTICES + vertex);
            [a, b]
        })
    }

    #[inline(always)]
    fn group(&self, vertex: u32, which: u32) -> [f32; 4] {
        if vertex < VERTICES {
            self.sobol.sample_4d(self.sample, 1 + GROUPS * vertex + which)
        } else {
            let draw =
                |i: u64| unit_f32((hash(self.key, u64::from(GROUPS * vertex + which), i) >> 32) as u32);
            [draw(0), draw(1), draw(2), draw(3)]
        }
    }

    /// A number for the surface `what` met by ray `ray` of the path: the same whenever it is asked for.
    #[inline]
    pub(crate) fn surface(&self, ray: u32, what: u64) -> f32 {
        unit_f32((hash(self.key, what, u64::from(ray)) >> 32) as u32)
    }

    /// As many independent numbers as tracking needs, for ray `ray` of the path.
    #[inline]
    pub(crate) fn tracking(&self, ray: u32) -> Rng {
        Rng::new(self.key, 0x7ac4_0000 + u64::from(ray))
    }
}

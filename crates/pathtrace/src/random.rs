//! The random numbers of a path: Owen-scrambled Sobol points, four dimensions at a time. Numbers are made when they are
//! asked for: most scenes need no more than the pairs.

use crate::light::LightRandom;
use photofit_sampling::{Rng, Sobol, SobolPoint, hash, unit_f32};

/// Dimensions of the camera: place in the pixel, then place on the lens.
const CAMERA_GROUP: u32 = 0;
/// Groups per vertex: one for lights, one for scattering.
const GROUPS: u32 = 2;
const LIGHT: u32 = 0;
const SCATTER: u32 = 1;
/// Vertices with dimensions of their own; later ones draw independent numbers.
const VERTICES: u32 = 64;
/// The first group for flights, one per vertex, and for survival, one per four vertices.
const FLIGHT_GROUPS: u32 = 1 + GROUPS * VERTICES;
const SURVIVAL_GROUPS: u32 = FLIGHT_GROUPS + VERTICES;

/// The numbers of all samples of one pixel.
#[derive(Clone, Debug)]
pub(crate) struct PixelRandom {
    sobol: Sobol,
    keys: Rng,
}

impl PixelRandom {
    pub(crate) fn new(seed: u64, pixel: u64) -> Self {
        Self { sobol: Sobol::new(seed, pixel), keys: Rng::new(seed ^ 0x5eed, pixel) }
    }

    /// The numbers of a sample.
    #[inline]
    pub(crate) fn sample(&mut self, sample: u32) -> PathRandom {
        self.keys.skip_to(u64::from(sample));
        PathRandom { sobol: self.sobol, sample, key: self.keys.next_u64() }
    }
}

/// The numbers of one sample of one pixel: functions of seed, pixel, sample and vertex alone.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathRandom {
    sobol: Sobol,
    sample: u32,
    /// Differs for every path.
    key: u64,
}

impl PathRandom {
    /// Place in the pixel, and on the lens.
    #[inline]
    pub(crate) fn camera(&self) -> SobolPoint {
        self.sobol.point(self.sample, CAMERA_GROUP)
    }

    /// Chooses the light at vertex `vertex`, if one is to be chosen, and the place on it.
    #[inline(always)]
    pub(crate) fn light(&self, vertex: u32, choose: bool) -> LightRandom {
        if vertex >= VERTICES {
            let [a, b, c, d] = [0, 1, 2, 3].map(|inner| self.late(vertex, LIGHT, inner));
            return LightRandom { choice: [c, d], place: [a, b] };
        }
        let point = self.sobol.point(self.sample, 1 + GROUPS * vertex + LIGHT);
        let choice = if choose { [point.get(2), point.get(3)] } else { [0.0; 2] };
        LightRandom { choice, place: point.pair() }
    }

    /// The direction of scattering at vertex `vertex`.
    #[inline(always)]
    pub(crate) fn scatter(&self, vertex: u32) -> [f32; 2] {
        self.pair(vertex, SCATTER)
    }

    /// The direction of scattering at the second vertex, stratified together with that at the first one: instead of
    /// [`Self::scatter`], by whoever asks for no [`Self::lobe`] at the first one.
    #[inline(always)]
    pub(crate) fn second_scatter(&self) -> [f32; 2] {
        let first = self.sobol.point(self.sample, 1 + SCATTER);
        [first.get(2), first.get(3)]
    }

    /// Chooses the lobe at vertex `vertex`.
    #[inline]
    pub(crate) fn lobe(&self, vertex: u32) -> f32 {
        self.single(vertex, SCATTER, 2)
    }

    /// Decides whether the path goes on after vertex `vertex`.
    #[inline]
    pub(crate) fn survival(&self, vertex: u32) -> f32 {
        if vertex < VERTICES {
            self.sobol.point(self.sample, SURVIVAL_GROUPS + vertex / 4).get(vertex % 4)
        } else {
            self.late(vertex, SCATTER, 3)
        }
    }

    /// For the first flight through a medium behind vertex `vertex`: the colour, the distance. `None` for late vertices.
    #[inline]
    pub(crate) fn flight(&self, vertex: u32) -> Option<[f32; 2]> {
        (vertex < VERTICES).then(|| self.sobol.point(self.sample, FLIGHT_GROUPS + vertex).pair())
    }

    #[inline(always)]
    fn pair(&self, vertex: u32, which: u32) -> [f32; 2] {
        if vertex < VERTICES {
            self.sobol.point(self.sample, 1 + GROUPS * vertex + which).pair()
        } else {
            [self.late(vertex, which, 0), self.late(vertex, which, 1)]
        }
    }

    #[inline(always)]
    fn single(&self, vertex: u32, which: u32, inner: u32) -> f32 {
        if vertex < VERTICES {
            self.sobol.point(self.sample, 1 + GROUPS * vertex + which).get(inner)
        } else {
            self.late(vertex, which, inner)
        }
    }

    #[cold]
    fn late(&self, vertex: u32, which: u32, inner: u32) -> f32 {
        unit_f32((hash(self.key, u64::from(GROUPS * vertex + which), u64::from(inner)) >> 32) as u32)
    }

    /// A number for the surface `what` met by ray `ray` of the path: the same whenever it is asked for.
    #[inline]
    pub(crate) fn surface(&self, ray: u32, what: u64) -> f32 {
        unit_f32((hash(self.key, what, u64::from(ray)) >> 32) as u32)
    }

    /// Independent numbers for what the derivatives of a path sample beside the path.
    #[inline]
    pub(crate) fn derivatives(&self) -> Rng {
        Rng::new(self.key, 0xd00_0000)
    }

    /// The numbers of one of `count` splits of this path. Those of one sample are stratified together.
    #[inline]
    pub(crate) fn split(&self, index: u32, count: u32) -> Self {
        let sample = self.sample.wrapping_mul(count).wrapping_add(index);
        Self { sobol: self.sobol, sample, key: hash(self.key, 0x3a75_0000, u64::from(index)) }
    }

    /// The numbers of a path that begins at one of this path's segments, independent of those of this path.
    #[inline]
    pub(crate) fn branch(&self) -> Self {
        Self { sobol: self.sobol.branch(1), sample: self.sample, key: hash(self.key, 0xb4a_0000, 0) }
    }

    /// As many independent numbers as tracking needs, for ray `ray` of the path.
    #[inline]
    pub(crate) fn tracking(&self, ray: u32) -> Rng {
        Rng::new(self.key, 0x7ac4_0000 + u64::from(ray))
    }
}

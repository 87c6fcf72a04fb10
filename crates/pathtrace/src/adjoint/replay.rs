//! The sinks of path replay (Vicini, Speierer and Jakob 2021): a first walk finds the light of the path; then [`Replay`]
//! knows at each vertex how much of it is still to come. It is told the path by a second walk, or by what the first one
//! kept of it ([`tape`](super::tape)).
//!
//! Densities, weights of multiple importance sampling and roulette are held: derivatives of the estimator's values alone.

use super::accumulate::Accumulator;
use super::layout::{Layout, NONE};
use super::parameter::MaterialValue;
use super::surface::{Here, Texels, splits};
use super::tape::Tape;
use super::volume::MediaReplay;
use crate::integrator::{Contribution, Found, MediaFlight, PathVertex, ShadowFlight, Sink, SurfaceVisit};
use crate::light::LightOrigin;
use crate::random::PathRandom;
use crate::volume::Derivatives;
use crate::world::World;
use photofit_scalar::{Vec3f, Vec4f, vec3};
use photofit_scene::SampleGradient;
use photofit_scene::graph::SurfacePoint;

/// The light of a path, and of the part before each of its splits.
#[derive(Debug)]
pub(super) struct Total<'a> {
    pub(super) world: &'a World,
    pub(super) layout: &'a Layout,
    pub(super) radiance: [f64; 3],
    pub(super) before: &'a mut Vec<[f64; 3]>,
}

impl Sink for Total<'_> {
    // The replay asks for it, and both walks are one.
    const SURFACES: bool = true;
    const SPLITS: bool = true;

    #[inline(always)]
    fn splits(&self, first: &SurfaceVisit<'_>) -> u32 {
        splits(self.world, self.layout, first)
    }

    #[inline(always)]
    fn split(&mut self) {
        self.before.push(self.radiance);
    }

    #[inline(always)]
    fn contribution(&mut self, light: &Contribution) {
        add(&mut self.radiance, light.value, 1.0);
    }
}

#[inline(always)]
pub(super) fn add(sum: &mut [f64; 3], value: Vec3f, sign: f64) {
    for (s, v) in sum.iter_mut().zip(value.to_array()) {
        *s += sign * f64::from(v);
    }
}

#[inline(always)]
fn subtract(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|c| a[c] - b[c])
}

/// Accumulates gradients along one path.
pub(super) struct Replay<'a> {
    pub(super) world: &'a World,
    pub(super) layout: &'a Layout,
    pub(super) out: &'a mut Accumulator,
    /// Derivative of the loss with respect to the radiance of the path.
    pub(super) loss: Vec3f,
    /// The light of the path, and of its part before each of its splits.
    pub(super) total: [f64; 3],
    pub(super) before: Vec<[f64; 3]>,
    /// Light that the path, or its present split, has still to find.
    pub(super) rest: [f64; 3],
    /// Splits that have begun, and the place of the surface that they begin at.
    split: usize,
    first: Option<usize>,
    /// What the first walk keeps of the path.
    pub(super) tape: Tape,
    /// The surfaces of the path that are kept, and the present one among them, if it has parameters.
    pub(super) surfaces: Vec<Here>,
    pub(super) here: Option<usize>,
    /// Lengths of the present shadow ray in absorbing solids.
    pub(super) shadow: Vec<(u32, f32)>,
    /// What is kept for derivatives of media.
    pub(super) media: MediaReplay,
}

impl Sink for Replay<'_> {
    const SURFACES: bool = true;
    const SPLITS: bool = true;
    const MEDIA: bool = true;

    fn flight(&mut self, flight: &MediaFlight) {
        if self.layout.media {
            self.flown(flight);
        }
    }

    fn shadow_flight(&mut self, flight: &ShadowFlight) {
        if self.layout.medium(flight.medium).extinction != NONE {
            self.media.shadow.push(*flight);
        }
    }

    fn splits(&self, first: &SurfaceVisit<'_>) -> u32 {
        splits(self.world, self.layout, first)
    }

    fn split(&mut self) {
        // The light of all splits, or the rest of the one before.
        let end = self.before.get(self.split + 1).unwrap_or(&self.total);
        let start = self.before[self.split];
        let left =
            if self.split == 0 { subtract(&self.rest, &subtract(&self.total, &start)) } else { self.rest };
        self.out.note_residual(&left, &self.total);
        self.rest = subtract(end, &start);
        if self.split == 0 {
            self.first = self.here;
        }
        self.here = self.first;
        self.split += 1;
    }

    fn surface(&mut self, visit: &SurfaceVisit<'_>) {
        // The one that all splits begin at stays.
        self.settle(self.first.map_or(0, |first| first + 1));
        let place = self.surfaces.len();
        self.surfaces.extend(Here::new(self.world, self.layout, visit));
        self.here = (self.surfaces.len() > place).then_some(place);
    }

    fn absorbed(&mut self, material: u32, length: f32) {
        let cell = self.layout.materials[material as usize].of(MaterialValue::Absorption);
        if cell != NONE {
            let rest = Vec3f::from_array(self.rest.map(|r| r as f32));
            self.out.add(cell, self.loss.mul(rest) * -length);
        }
    }

    fn shadow_absorbed(&mut self, material: u32, length: f32) {
        if self.layout.absorption {
            self.shadow.push((material, length));
        }
    }

    fn contribution(&mut self, light: &Contribution) {
        add(&mut self.rest, light.value, -1.0);
        let before = self.loss.mul(light.throughput) * light.weight;
        if !matches!(light.found, Found::NextEvent | Found::Medium) {
            return self.emitted(light, before);
        }
        for (material, length) in self.shadow.drain(..) {
            let cell = self.layout.materials[material as usize].of(MaterialValue::Absorption);
            self.out.add(cell, self.loss.mul(light.value) * -length);
        }
        self.shadowed(self.loss.mul(light.value));
        if light.found == Found::Medium {
            return self.emitted(light, before.mul(light.transmittance));
        }
        let through = before.mul(light.transmittance) * (1.0 / light.pdf);
        if through == Vec3f::zero() {
            return;
        }
        if light.instance != u32::MAX {
            self.scattered(light.wi, through.mul(light.radiance), light.scattering);
        }
        self.emitted(light, through.mul(light.scattering));
    }

    fn vertex(&mut self, v: &PathVertex) {
        // Delta lobes have no parameters here, directions of media none at all.
        if v.instance == u32::MAX || v.delta || self.here.is_none() {
            return;
        }
        let (mut g, value) = (Vec3f::zero(), v.weight * v.pdf);
        for c in 0..3 {
            let f = f64::from(v.weight[c]) * f64::from(v.pdf);
            if f > f64::from(f32::MIN_POSITIVE) {
                g[c] = (f64::from(self.loss[c]) * self.rest[c] / f) as f32;
            }
        }
        self.scattered(v.wi, g, value);
    }

    fn not_finite(&mut self) {
        self.out.not_finite += 1;
    }
}

impl<'a> Replay<'a> {
    /// Of no path yet; what the first walks keep has at most `kept` reports.
    pub(super) fn new(world: &'a World, layout: &'a Layout, out: &'a mut Accumulator, kept: usize) -> Self {
        Self {
            world,
            layout,
            out,
            loss: Vec3f::zero(),
            total: [0.0; 3],
            before: Vec::new(),
            rest: [0.0; 3],
            split: 0,
            first: None,
            tape: Tape::new(kept),
            surfaces: Vec::new(),
            here: None,
            shadow: Vec::new(),
            media: MediaReplay::default(),
        }
    }

    /// Begins the replay of a path of this light.
    pub(super) fn begin(&mut self, total: [f64; 3], random: &PathRandom) {
        (self.total, self.rest) = (total, total);
        (self.split, self.first, self.here) = (0, None, None);
        self.shadow.clear();
        self.media.begin(random, self.loss, &self.total);
    }

    /// Ends it.
    pub(super) fn end(&mut self) {
        self.settle(self.first.map_or(0, |first| first + 1));
        self.settle(0);
        self.out.note_residual(&self.rest, &self.total);
    }
}

impl Replay<'_> {
    /// Adjoint of the radiance of a light for its gradient `g`.
    fn emitted(&mut self, light: &Contribution, g: Vec3f) {
        if g == Vec3f::zero() {
            return;
        }
        match light.light {
            LightOrigin::Source(index) => {
                let cell = self.layout.lights[index as usize];
                if cell != NONE {
                    // Radiance is the intensity times what distance, cone and picture leave of it.
                    let intensity = self.world.lights.source_color(index as usize);
                    let left = |c: usize| {
                        if intensity[c] > 0.0 { light.radiance[c] / intensity[c] } else { 0.0 }
                    };
                    let left = vec3(left(0), left(1), left(2));
                    // Black channels learn from the others, but where a picture treats each in its way.
                    let throws = self.world.lights.throws_picture(index as usize);
                    let left = if throws { left } else { Vec3f::splat(left.x.max(left.y).max(left.z)) };
                    self.out.add(cell, g.mul(left));
                }
            }
            LightOrigin::Environment => {
                let (cell, environment) = (self.layout.environment, &self.world.lights.environment);
                if let Some(e) = environment.as_ref().filter(|_| cell != NONE) {
                    for (texel, weight) in e.taps(light.wi).pairs() {
                        if weight != 0.0 {
                            self.out.add(offset(cell, texel), g * (weight * e.scale()));
                        }
                    }
                }
            }
            LightOrigin::Medium { medium, point, share } => {
                let cell = self.layout.medium(medium).emission;
                if cell == NONE {
                    return;
                }
                let out = &mut *self.out;
                let add = |voxel, g| out.add(offset(cell, voxel), g);
                Derivatives::of(self.world, medium).emission_vjp(point, g * share, add);
            }
            LightOrigin::Surface { instance, piece, uv } => {
                let material = self.world.placed[instance as usize].material;
                let cells = &self.layout.materials[material as usize];
                self.out.add(cells.of(MaterialValue::Emission), g);
                let compiled = &self.world.materials[material as usize];
                if let Some(graph) = &compiled.graph {
                    let point = SurfacePoint { uv: uv[0], color: Vec4f::splat(1.0), piece };
                    let out = &mut *self.out;
                    graph.emission_vjp(&point, g, |t, texel, g| out.add(offset(cells.graph[t], texel), g));
                } else if let (Some(index), Some(library)) = (compiled.library, &self.world.library) {
                    let mut d = SampleGradient { emissive: g, ..SampleGradient::default() };
                    if compiled.unlit {
                        d = SampleGradient { base_color: g, ..SampleGradient::default() };
                    }
                    let white = Vec4f::splat(1.0);
                    let color = self.here.map(|h| &self.surfaces[h]).filter(|h| h.at.instance == instance);
                    let color = color.map_or(white, |h| h.at.color);
                    let mut sink = Texels { out: self.out, layout: self.layout, material };
                    library.lookup_vjp(index, uv, color, &d, &mut sink);
                }
            }
        }
    }
}

/// A texel of a parameter that begins at a cell, if it is one.
#[inline(always)]
pub(super) fn offset(start: u32, texel: usize) -> u32 {
    if start == NONE { NONE } else { start + texel as u32 }
}

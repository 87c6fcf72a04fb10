//! Next-event estimation: a light for a vertex, its weight, and what of it arrives.

use super::Strategy;
use super::path::Path;
use super::sink::{Contribution, Found, Sink};
use super::visibility::{Around, Passed, transmittance};
use crate::light::{LightSample, Receiver};
use crate::plan;
use crate::world::{Interaction, SurfaceScattering};
use photofit_sampling::{DirectionSampler, Scattering, Vertex, power_heuristic};
use photofit_scalar::Vec3f;

impl<const F: u32, S: Sink, D: DirectionSampler> Path<'_, F, S, D> {
    /// A light for this vertex.
    #[inline(always)]
    pub(super) fn light_for(&self, from: &Receiver) -> Option<LightSample> {
        if F & (plan::ENVIRONMENT | plan::SOURCES | plan::EMITTERS) == 0 {
            return None;
        }
        let lights = &self.world.lights;
        let random = self.random.light(self.depth, !lights.is_single());
        let sample = lights.sample(self.world, from, random)?;
        (sample.delta || self.options.strategy != Strategy::Bsdf).then_some(sample)
    }

    /// Weight of a light sample against scattering of density `pdf`, which is asked for where it matters.
    #[inline(always)]
    pub(super) fn light_weight(&self, light: &LightSample, pdf: impl FnOnce() -> f32) -> f32 {
        if light.delta || self.options.strategy == Strategy::Light {
            1.0
        } else {
            power_heuristic(1.0, light.pdf, 1.0, pdf())
        }
    }

    #[inline(always)]
    pub(super) fn light_at_surface(
        &mut self,
        at: &Interaction,
        vertex: &Vertex<'_, SurfaceScattering<'_>>,
        local: &D::Local,
        from: &Receiver,
    ) {
        let Some(light) = self.light_for(from) else { return };
        let crosses = light.wi.dot(at.ng) * vertex.wo.dot(at.ng) < 0.0;
        if crosses != vertex.scattering.crosses(light.wi) {
            return;
        }
        let (value, own) = vertex.scattering.eval_pdf(light.wi);
        // What is costly waits until it is known whether something is in the way, unless the sink wants to know it all the same.
        let waits = D::COSTLY && !S::SURFACES && !S::MEDIA;
        let pdf = if waits { own } else { self.sampler.pdf(vertex, local, light.wi, own) };
        let weight = if waits { 1.0 } else { self.light_weight(&light, || pdf) };
        let unshadowed = self.throughput.mul(value).mul(light.radiance);
        let arrives = unshadowed * (weight / light.pdf);
        if arrives == Vec3f::zero() && !(S::SURFACES && pdf > 0.0) {
            return;
        }
        let mut around = Around { absorbers: self.inside, medium: self.medium };
        if F & plan::ABSORPTION != 0 && crosses {
            around.absorbers.cross(self.world, at.instance, at.front);
        }
        if F & plan::VOLUMES != 0 {
            around.medium = self.world.media.beside(at.instance, at.front != crosses, self.medium);
        }
        if !waits {
            self.connect(&light, (at.p, Some(at)), around, (value, weight, arrives));
            return;
        }
        let through = self.through(&light, (at.p, Some(at)), around);
        if through == Vec3f::zero() {
            return;
        }
        let weight = self.light_weight(&light, || self.sampler.pdf(vertex, local, light.wi, own));
        let arrives = unshadowed * (weight / light.pdf);
        if arrives.is_finite() {
            self.report(&light, Some(at), through, (value, weight, arrives));
        } else {
            self.sink.not_finite();
        }
    }

    /// Reports light of a sample, as far as it arrives at a vertex; `arrives` is what does where nothing is in the way.
    #[inline(always)]
    pub(super) fn connect(
        &mut self,
        light: &LightSample,
        (p, surface): (Vec3f, Option<&Interaction>),
        around: Around,
        (scattering, weight, arrives): (Vec3f, f32, Vec3f),
    ) {
        if !arrives.is_finite() {
            self.sink.not_finite();
            return;
        }
        let through = self.through(light, (p, surface), around);
        self.report(light, surface, through, (scattering, weight, arrives));
    }

    /// Part of the light of a sample that arrives at a vertex.
    #[inline(always)]
    fn through(
        &mut self,
        light: &LightSample,
        (p, surface): (Vec3f, Option<&Interaction>),
        around: Around,
    ) -> Vec3f {
        let index = 2 * self.depth + 1;
        let sink = &mut self.sink;
        let passed = |part: Passed| match part {
            Passed::Solid(material, length) if S::SURFACES => sink.shadow_absorbed(material, length),
            Passed::Medium(flight) if S::MEDIA => sink.shadow_flight(&flight),
            _ => {}
        };
        let random = (&self.random, index);
        transmittance::<F>(self.world, p, surface, light, around, random, passed)
    }

    #[inline(always)]
    fn report(
        &mut self,
        light: &LightSample,
        surface: Option<&Interaction>,
        through: Vec3f,
        (scattering, weight, arrives): (Vec3f, f32, Vec3f),
    ) {
        self.sink.contribution(&Contribution {
            found: Found::NextEvent,
            depth: self.depth + 1,
            throughput: self.throughput,
            scattering,
            radiance: light.radiance,
            transmittance: through,
            weight,
            pdf: light.pdf,
            wi: light.wi,
            light: light.origin,
            instance: surface.map_or(u32::MAX, |s| s.instance),
            value: arrives.mul(through),
        });
    }
}

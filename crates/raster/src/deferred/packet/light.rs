//! Light that falls on the samples of a packet, light by light, and its adjoint. Points, directions and ambient light under
//! single scattering are loops over the lanes; the rest goes lane by lane.

use super::{LANES, POSITION, Packet, STEP, Scene, add, surface, triple};
use crate::maps::channel;
use photofit_scalar::{Real, Vec3};
use photofit_shading::{
    Beam, Energy, Light, ShadeGradient, SplitSum, shade, shade_ambient, shade_ambient_vjp, shade_beam,
    shade_beam_vjp, shade_vjp, split_sum,
};

impl<T: Real> Packet<T> {
    /// Radiance of the lights, one after the other.
    #[inline(always)]
    pub(super) fn light(&mut self, scene: &Scene<'_, T>) {
        self.rgb = [[T::zero(); LANES + STEP]; 3];
        for light in scene.view.lights {
            match (*light, scene.passes.energy) {
                (Light::Point { position, intensity }, Energy::Single) => {
                    self.add_beam(|p| Beam::of_point(position, intensity, p));
                }
                (Light::Directional { direction, irradiance }, Energy::Single) => {
                    self.add_beam(|_| Beam::of_direction(direction, irradiance));
                }
                (Light::Ambient { radiance }, Energy::Single) => {
                    self.view();
                    for lane in 0..LANES {
                        let s = surface(&self.texel, lane);
                        let rgb = shade_ambient(&s, &self.viewer_at(lane), radiance);
                        add(&mut self.rgb, 0, lane, rgb);
                    }
                }
                (light, energy) => self.add_light(energy, light),
            }
        }
    }

    /// Scale and bias of the specular lobe towards the viewer, from a table.
    #[inline(always)]
    fn view(&mut self) {
        for lane in 0..self.len {
            let cosine = triple(&self.normal, 0, lane).dot(triple(&self.wo, 0, lane));
            let s = split_sum(cosine, surface(&self.texel, lane).lobes().roughness);
            let row = [s.scale, s.bias, s.d_scale[0], s.d_scale[1], s.d_bias[0], s.d_bias[1]];
            for k in 0..6 {
                self.viewer[k][lane] = row[k];
            }
        }
    }

    #[inline(always)]
    fn viewer_at(&self, lane: usize) -> SplitSum<T> {
        let at = |k: usize| self.viewer[k][lane];
        SplitSum { scale: at(0), bias: at(1), d_scale: [at(2), at(3)], d_bias: [at(4), at(5)] }
    }

    #[inline(always)]
    fn add_beam(&mut self, beam: impl Fn(Vec3<T>) -> Beam<T>) {
        for lane in 0..LANES {
            let (s, beam) = (surface(&self.texel, lane), beam(triple(&self.surface, POSITION, lane)));
            let (n, wo) = (triple(&self.normal, 0, lane), triple(&self.wo, 0, lane));
            add(&mut self.rgb, 0, lane, shade_beam(&s, n, wo, &beam));
        }
    }

    #[inline(always)]
    fn add_light(&mut self, energy: Energy, light: Light<'_, T>) {
        for lane in 0..self.len {
            let (s, p) = (surface(&self.texel, lane), triple(&self.surface, POSITION, lane));
            let (n, wo) = (triple(&self.normal, 0, lane), triple(&self.wo, 0, lane));
            add(&mut self.rgb, 0, lane, shade(&s, energy, p, n, wo, &[light]));
        }
    }

    /// Adjoint of [`Self::light`].
    #[inline(always)]
    pub(super) fn light_vjp(&mut self, scene: &Scene<'_, T>) {
        let zero = [[T::zero(); LANES + STEP]; 3];
        (self.g_normal, self.g_wo) = (zero, zero);
        self.g_attributes[POSITION..][..3].copy_from_slice(&zero);
        for light in scene.view.lights {
            match (*light, scene.passes.energy) {
                (Light::Point { position, intensity }, Energy::Single) => {
                    self.add_beam_vjp(|p| Beam::of_point(position, intensity, p));
                }
                (Light::Directional { direction, irradiance }, Energy::Single) => {
                    self.add_beam_vjp(|_| Beam::of_direction(direction, irradiance));
                }
                (Light::Ambient { radiance }, Energy::Single) => {
                    self.view();
                    for lane in 0..LANES {
                        let (s, g) = (surface(&self.texel, lane), triple(&self.g, 0, lane));
                        let (n, wo) = (triple(&self.normal, 0, lane), triple(&self.wo, 0, lane));
                        let d = shade_ambient_vjp(&s, &self.viewer_at(lane), n, wo, radiance, g);
                        self.add_gradient(lane, &d);
                    }
                }
                (light, energy) => self.add_light_vjp(energy, light),
            }
        }
    }

    #[inline(always)]
    fn add_beam_vjp(&mut self, beam: impl Fn(Vec3<T>) -> Beam<T>) {
        for lane in 0..LANES {
            let (s, beam) = (surface(&self.texel, lane), beam(triple(&self.surface, POSITION, lane)));
            let (n, wo) = (triple(&self.normal, 0, lane), triple(&self.wo, 0, lane));
            let d = shade_beam_vjp(&s, n, wo, &beam, triple(&self.g, 0, lane));
            self.add_gradient(lane, &d);
        }
    }

    #[inline(always)]
    fn add_light_vjp(&mut self, energy: Energy, light: Light<'_, T>) {
        for lane in 0..self.len {
            let (s, p) = (surface(&self.texel, lane), triple(&self.surface, POSITION, lane));
            let (n, wo) = (triple(&self.normal, 0, lane), triple(&self.wo, 0, lane));
            let d = shade_vjp(&s, energy, p, n, wo, &[light], triple(&self.g, 0, lane));
            self.add_gradient(lane, &d);
        }
    }

    #[inline(always)]
    fn add_gradient(&mut self, lane: usize, d: &ShadeGradient<T>) {
        add(&mut self.g_texel, channel::BASE_COLOR, lane, d.surface.base_color);
        self.g_texel[channel::ROUGHNESS][lane] += d.surface.roughness;
        self.g_texel[channel::METALLIC][lane] += d.surface.metallic;
        self.g_texel[channel::SPECULAR_SUPPRESSION][lane] += d.surface.gamma;
        add(&mut self.g_attributes, POSITION, lane, d.position);
        add(&mut self.g_normal, 0, lane, d.n);
        add(&mut self.g_wo, 0, lane, d.wo);
    }
}

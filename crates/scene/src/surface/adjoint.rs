//! Adjoint of [`SurfaceLibrary::lookup`] on the base level: what a gradient of the sample says about factors and texels.

use super::{Compiled, Slot, SurfaceLibrary, decode_normal};
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec3};
use std::ops::Add;

/// Gradient with respect to a [`super::SurfaceSample`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleGradient {
    /// With respect to the base colour.
    pub base_color: Vec3f,
    /// With respect to the perceptual roughness.
    pub roughness: f32,
    /// With respect to the metalness.
    pub metallic: f32,
    /// With respect to the unit normal in tangent space.
    pub normal: Vec3f,
    /// With respect to the emitted radiance.
    pub emissive: Vec3f,
}

impl SampleGradient {
    /// Whether all of it is finite.
    pub fn is_finite(&self) -> bool {
        let sum = (self.base_color + self.normal + self.emissive).sum() + self.roughness + self.metallic;
        sum.is_finite()
    }
}

impl Add for SampleGradient {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self {
            base_color: self.base_color + other.base_color,
            roughness: self.roughness + other.roughness,
            metallic: self.metallic + other.metallic,
            normal: self.normal + other.normal,
            emissive: self.emissive + other.emissive,
        }
    }
}

/// Receives gradients with respect to what a material is made of.
pub trait SampleSink {
    /// With respect to the factors of base colour, roughness, metalness and emission.
    fn factors(&mut self, base_color: Vec3f, roughness: f32, metallic: f32, emissive: Vec3f);

    /// With respect to one texel of a texture, in linear light: red, green, blue.
    fn texel(&mut self, texture: usize, texel: usize, gradient: Vec3f);
}

impl SurfaceLibrary {
    /// Adjoint of [`Self::lookup`] without a footprint, for the gradient `g` of the sample: adds to `sink`. Coverage has
    /// none.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn lookup_vjp(
        &self,
        material: usize,
        [uv0, uv1]: [Vec2f; 2],
        vertex_color: Vec4f,
        g: &SampleGradient,
        sink: &mut impl SampleSink,
    ) {
        let m = &self.materials[material];
        let at = At { library: self, material: m, uv: [uv0, uv1] };
        let white = Vec4f::splat(1.0);
        let read = |slot: Option<Slot>| slot.map_or(white, |s| at.read(s));
        let c = &m.constant;
        let (base, rough, glow) = (read(m.base_color), read(m.metallic_roughness), read(m.emissive));
        let tint = vertex_color.xyz();
        sink.factors(
            g.base_color.mul(tint).mul(base.xyz()),
            g.roughness * rough.y,
            g.metallic * rough.z,
            g.emissive.mul(glow.xyz()),
        );
        at.scatter(m.base_color, g.base_color.mul(tint).mul(c.base_color), sink);
        at.scatter(m.metallic_roughness, vec3(0.0, g.roughness * c.roughness, g.metallic * c.metallic), sink);
        at.scatter(m.emissive, g.emissive.mul(c.emissive), sink);
        if let Some(slot) = m.normal
            && g.normal != Vec3f::zero()
        {
            at.scatter(m.normal, decode_normal_vjp(at.read(slot), m.normal_scale, g.normal), sink);
        }
    }
}

/// Adjoint of [`decode_normal`].
fn decode_normal_vjp(t: Vec4f, scale: f32, g: Vec3f) -> Vec3f {
    let n = vec3((2.0 * t.x - 1.0) * scale, (2.0 * t.y - 1.0) * scale, 2.0 * t.z - 1.0);
    if n.normalize_or_zero() == Vec3f::zero() {
        return Vec3f::zero();
    }
    debug_assert_eq!(decode_normal(t, scale), n.normalize_or_zero());
    let g = n.normalize_vjp(g);
    vec3(2.0 * scale * g.x, 2.0 * scale * g.y, 2.0 * g.z)
}

/// A point of a material.
struct At<'a> {
    library: &'a SurfaceLibrary,
    material: &'a Compiled,
    uv: [Vec2f; 2],
}

impl At<'_> {
    fn read(&self, slot: Slot) -> Vec4f {
        let at = self.material.addresses[slot.address].lookup(self.uv, None);
        Vec4f::from_array(self.library.textures[slot.texture].read(&at))
    }

    fn scatter(&self, slot: Option<Slot>, g: Vec3f, sink: &mut impl SampleSink) {
        let Some(slot) = slot.filter(|_| g != Vec3f::zero()) else { return };
        let taps = self.material.addresses[slot.address].lookup(self.uv, None).fine;
        for (index, weight) in taps.index.into_iter().zip(taps.weights()) {
            if weight != 0.0 {
                sink.texel(slot.texture, index as usize, g * weight);
            }
        }
    }
}

#[cfg(test)]
mod tests;

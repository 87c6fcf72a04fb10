//! How a surface scatters at a point, for one direction of view.

use photofit_sampling::{DirectionSample, Scattering};
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::{Bsdf, BsdfSample, Diffuse, Scatter};

/// The scattering at a point of a material that varies.
#[derive(Debug)]
pub(crate) struct Resolved {
    pub(super) bsdf: Bsdf<f32>,
    pub(super) second: Option<(Bsdf<f32>, f32)>,
}

/// A material at a point, for one direction of view.
#[derive(Debug)]
pub(crate) struct SurfaceMaterial<'a> {
    /// How it scatters, in the frame `(s, t, n)`.
    pub(crate) bsdf: &'a Bsdf<f32>,
    /// A second BSDF and its share.
    pub(crate) second: Option<&'a (Bsdf<f32>, f32)>,
    /// The normal before a map bent it, in the frame, and the squared roughness of the shadow that the bend casts.
    pub(crate) bent: Option<(Vec3f, f32)>,
    /// First axis of the frame.
    pub(crate) s: Vec3f,
    /// Second axis of the frame.
    pub(crate) t: Vec3f,
    /// The shading normal.
    pub(crate) n: Vec3f,
    /// Radiance emitted towards the viewer.
    pub(crate) emission: Vec3f,
}

impl SurfaceMaterial<'_> {
    /// A vector in the frame of the BSDF.
    #[inline(always)]
    pub(crate) fn to_local(&self, v: Vec3f) -> Vec3f {
        vec3(self.s.dot(v), self.t.dot(v), self.n.dot(v))
    }

    /// The BSDF if it is Lambert's and all there is: the case that has to be fast.
    #[inline(always)]
    fn diffuse(&self) -> Option<&Diffuse<f32>> {
        match self.bsdf {
            Bsdf::Diffuse(diffuse) if self.second.is_none() && self.bent.is_none() => Some(diffuse),
            _ => None,
        }
    }

    /// `f |cos|` and density, in the frame.
    #[inline(always)]
    pub(crate) fn eval_pdf(&self, wo: Vec3f, wi: Vec3f) -> (Vec3f, f32) {
        match self.diffuse() {
            Some(diffuse) => diffuse.eval_pdf(wo, wi),
            None => self.eval_pdf_of_all(wo, wi),
        }
    }

    #[inline(never)]
    fn eval_pdf_of_all(&self, wo: Vec3f, wi: Vec3f) -> (Vec3f, f32) {
        let (mut value, mut pdf) = self.bsdf.eval_pdf(wo, wi);
        if let Some((other, share)) = self.second {
            let (v, p) = other.eval_pdf(wo, wi);
            value = value * (1.0 - share) + v * *share;
            pdf = pdf * (1.0 - share) + p * share;
        }
        (value * self.shadow(wi), pdf)
    }

    /// Light that arrives in spite of the bend of the normal (Estevez, Lecocq and Stein 2019, "A Microfacet-Based
    /// Shadowing Function to Solve the Bump Terminator Problem"): 1 without one.
    #[inline(always)]
    pub(crate) fn shadow(&self, wi: Vec3f) -> f32 {
        let Some((n, alpha2)) = self.bent else { return 1.0 };
        let cosine = n.dot(wi);
        let square = cosine * cosine;
        if square <= 0.0 {
            return 0.0;
        }
        2.0 / (1.0 + (1.0 + alpha2 * (1.0 - square).max(0.0) / square).sqrt())
    }

    /// A direction, in the frame.
    #[inline(always)]
    pub(crate) fn sample(&self, wo: Vec3f, lobe: f32, u: [f32; 2]) -> Option<BsdfSample<f32>> {
        match self.diffuse() {
            Some(diffuse) => diffuse.sample(wo, lobe, u),
            None => self.sample_any(wo, lobe, u),
        }
    }

    #[inline(never)]
    fn sample_any(&self, wo: Vec3f, lobe: f32, u: [f32; 2]) -> Option<BsdfSample<f32>> {
        match self.second {
            None => {
                let mut sample = self.bsdf.sample(wo, lobe, u)?;
                if self.bent.is_some() {
                    sample.weight *= self.shadow(sample.wi);
                }
                Some(sample)
            }
            Some((other, share)) => self.sample_mixture(other, *share, wo, lobe, u),
        }
    }

    /// One of two by their shares; weighted by both.
    #[inline(never)]
    fn sample_mixture(
        &self,
        other: &Bsdf<f32>,
        share: f32,
        wo: Vec3f,
        lobe: f32,
        u: [f32; 2],
    ) -> Option<BsdfSample<f32>> {
        let mut sample = if lobe < share {
            other.sample(wo, lobe / share, u)
        } else {
            self.bsdf.sample(wo, (lobe - share) / (1.0 - share), u)
        }?;
        if !sample.delta {
            let (value, pdf) = self.eval_pdf(wo, sample.wi);
            let usable = pdf > 0.0 && pdf.is_finite();
            if !usable {
                return None;
            }
            (sample.weight, sample.pdf) = (value / pdf, pdf);
        }
        Some(sample)
    }

    /// Whether all lobes are delta lobes.
    #[inline(always)]
    pub(crate) fn is_delta(&self) -> bool {
        self.bsdf.is_delta() && self.second.is_none_or(|(b, _)| b.is_delta())
    }

    /// Whether light can pass to the other side.
    #[inline(always)]
    pub(crate) fn transmits(&self) -> bool {
        self.bsdf.transmits() || self.second.is_some_and(|(b, _)| b.transmits())
    }

    /// Index of refraction on the other side over that on the side of `wo`, in the frame: that of the first BSDF that
    /// refracts.
    pub(crate) fn eta(&self, wo: Vec3f) -> f32 {
        let first = self.bsdf.eta(wo);
        if first == 1.0 { self.second.map_or(1.0, |(b, _)| b.eta(wo)) } else { first }
    }

    /// Whether a number has to choose among lobes.
    #[inline(always)]
    pub(crate) fn has_lobes(&self) -> bool {
        self.second.is_some() || self.bsdf.has_lobes()
    }

    /// Part of uniform light that is reflected, approximately.
    pub(crate) fn albedo(&self, wo: Vec3f) -> Vec3f {
        let first = self.bsdf.albedo(wo);
        self.second.map_or(first, |(b, share)| first * (1.0 - share) + b.albedo(wo) * *share)
    }

    /// A vector of that frame in the render frame.
    #[inline(always)]
    pub(crate) fn to_render(&self, v: Vec3f) -> Vec3f {
        self.s * v.x + self.t * v.y + self.n * v.z
    }
}

/// A material at a point for one direction of view, with directions in the render frame.
#[derive(Debug)]
pub(crate) struct SurfaceScattering<'a> {
    material: &'a SurfaceMaterial<'a>,
    /// Towards the viewer, in the frame of the material.
    wo: Vec3f,
}

impl<'a> SurfaceScattering<'a> {
    /// `wo` is a unit vector of the render frame.
    #[inline(always)]
    pub(crate) fn new(material: &'a SurfaceMaterial<'a>, wo: Vec3f) -> Self {
        Self { material, wo: material.to_local(wo) }
    }

    /// Whether a direction lies on the other side of the shading plane than the viewer.
    #[inline(always)]
    pub(crate) fn crosses(&self, wi: Vec3f) -> bool {
        self.material.n.dot(wi) * self.wo.z < 0.0
    }
}

impl Scattering for SurfaceScattering<'_> {
    #[inline(always)]
    fn sample(&self, lobe: f32, u: [f32; 2]) -> Option<DirectionSample> {
        let BsdfSample { wi, weight, pdf, delta, eta } = self.material.sample(self.wo, lobe, u)?;
        let transmitted = wi.z * self.wo.z < 0.0;
        let wi = self.material.to_render(wi).normalize_or_zero();
        Some(DirectionSample { wi, weight, pdf, delta, transmitted, eta, preference: 1.0 })
    }

    #[inline(always)]
    fn eval_pdf(&self, wi: Vec3f) -> (Vec3f, f32) {
        self.material.eval_pdf(self.wo, self.material.to_local(wi))
    }

    #[inline]
    fn eta(&self, wi: Vec3f) -> f32 {
        if self.crosses(wi) { self.material.eta(self.wo) } else { 1.0 }
    }

    #[inline(always)]
    fn is_delta(&self) -> bool {
        self.material.is_delta()
    }

    #[inline(always)]
    fn has_lobes(&self) -> bool {
        self.material.has_lobes()
    }
}

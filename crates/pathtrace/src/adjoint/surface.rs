//! Surfaces of a path: what derivatives need to know of them, and where their gradients lead.
//!
//! What scatters at a surface is summed up there before it goes to texels: several directions meet the same ones.

use super::accumulate::Accumulator;
use super::layout::Layout;
use super::parameter::MaterialValue;
use super::replay::{Replay, offset};
use crate::integrator::{Sink, SurfaceVisit};
use crate::world::{Interaction, SurfaceMaterial, World};
use photofit_scalar::Vec3f;
use photofit_scene::graph::SurfacePoint;
use photofit_scene::{SampleGradient, SampleSink};
use photofit_shading::bsdf::{Bsdf, BsdfGradient};
use std::ops::Add;

/// Path splitting at a first surface with parameters that change the directions of light. Derivatives of a density have both
/// signs, which cancel among stratified directions; the path up to there is shared.
const SPLITS: u32 = 4;

/// Into how many a path is split at a first surface.
#[inline(always)]
pub(super) fn splits(world: &World, layout: &Layout, visit: &SurfaceVisit<'_>) -> u32 {
    let material = world.placed[visit.interaction.instance as usize].material;
    if layout.materials[material as usize].changes_directions { SPLITS } else { 1 }
}

/// Gradients with respect to what a surface is made of at a point.
#[derive(Clone, Copy, Debug, Default)]
struct SurfaceGradient {
    /// Of its one or two BSDFs.
    bsdfs: [Option<BsdfGradient>; 2],
    /// Of a material of the library.
    sample: Option<SampleGradient>,
}

/// A surface of the path that has parameters.
#[derive(Debug)]
pub(super) struct Here {
    pub(super) at: Interaction,
    pub(super) wo: Vec3f,
    pub(super) material: u32,
    bsdf: Bsdf<f32>,
    second: Option<(Bsdf<f32>, f32)>,
    bent: Option<(Vec3f, f32)>,
    frame: [Vec3f; 3],
    /// Gradients so far.
    gradient: SurfaceGradient,
}

impl SurfaceGradient {
    fn is_finite(&self) -> bool {
        self.bsdfs.iter().flatten().all(BsdfGradient::is_finite) && self.sample.is_none_or(|s| s.is_finite())
    }
}

impl Here {
    /// What is kept of a visit; `None` where no parameter changes how the surface scatters.
    #[inline(always)]
    pub(super) fn new(world: &World, layout: &Layout, visit: &SurfaceVisit<'_>) -> Option<Self> {
        let material = world.placed[visit.interaction.instance as usize].material;
        let m = visit.material;
        layout.materials[material as usize].scatters.then(|| Self {
            at: *visit.interaction,
            wo: visit.wo,
            material,
            bsdf: *m.bsdf,
            second: m.second.copied(),
            bent: m.bent,
            frame: [m.s, m.t, m.n],
            gradient: SurfaceGradient::default(),
        })
    }

    /// The material there.
    pub(super) fn surface(&self) -> SurfaceMaterial<'_> {
        let [s, t, n] = self.frame;
        let (bsdf, second, bent) = (&self.bsdf, self.second.as_ref(), self.bent);
        SurfaceMaterial { bsdf, second, bent, s, t, n, emission: Vec3f::zero() }
    }
}

impl Replay<'_> {
    /// Adjoint of the `value` of the present surface towards `wi`, cosine included, for its gradient `g`.
    pub(super) fn scattered(&mut self, wi: Vec3f, g: Vec3f, value: Vec3f) {
        let Some(place) = self.here.filter(|_| g != Vec3f::zero()) else { return };
        let here = &self.surfaces[place];
        let surface = here.surface();
        let (wo, wi) = (surface.to_local(here.wo), surface.to_local(wi));
        let mut gradient = here.gradient;
        if let Some(index) = self.world.materials[here.material as usize].library {
            let d = self.world.library_vjp(index, &here.at, (&surface, here.wo), [wo, wi], g);
            gradient.sample = sum(gradient.sample, d);
        } else if let (Bsdf::RoughConductor(metal), None) = (surface.bsdf, surface.second)
            && metal.metal.reflectance.to_array().into_iter().all(|r| r > 0.0)
        {
            let d = metal.eval_vjp_of(wo, wi, g, value);
            gradient.bsdfs[0] = sum(gradient.bsdfs[0], Some(BsdfGradient::RoughConductor(d)));
        } else {
            let g = g * surface.shadow(wi);
            let share = surface.second.map_or(0.0, |s| s.1);
            let first = surface.bsdf.eval_vjp(wo, wi, g * (1.0 - share));
            let second = surface.second.and_then(|(b, share)| b.eval_vjp(wo, wi, g * *share));
            for (total, d) in gradient.bsdfs.iter_mut().zip([first, second]) {
                *total = sum(*total, d);
            }
        }
        // A direction whose gradient is not finite leaves that of the others as it is.
        if gradient.is_finite() {
            self.surfaces[place].gradient = gradient;
        } else {
            self.not_finite();
        }
    }

    /// Hands the gradients of all surfaces but the first `kept` on to parameters, and forgets them.
    pub(super) fn settle(&mut self, kept: usize) {
        for here in self.surfaces.drain(kept.min(self.surfaces.len())..) {
            pass_on(self.world, self.layout, self.out, &here);
        }
    }
}

/// What parameters get of the gradients at a surface.
fn pass_on(world: &World, layout: &Layout, out: &mut Accumulator, here: &Here) {
    let compiled = &world.materials[here.material as usize];
    let cells = &layout.materials[here.material as usize];
    let SurfaceGradient { bsdfs: [first, second], sample } = &here.gradient;
    if let (Some(index), Some(d), Some(library)) = (compiled.library, sample, &world.library) {
        let mut sink = Texels { out, layout, material: here.material };
        return library.lookup_vjp(index, here.at.uv, here.at.color, d, &mut sink);
    }
    if let Some(graph) = &compiled.graph {
        let point = SurfacePoint { uv: here.at.uv[0], color: here.at.color, piece: here.at.piece };
        return graph.resolve_vjp(&point, here.at.front, [first.as_ref(), second.as_ref()], |t, texel, g| {
            out.add(offset(cells.graph[t], texel), g);
        });
    }
    match first {
        Some(BsdfGradient::Diffuse(d)) => out.add(cells.of(MaterialValue::Reflectance), d.reflectance),
        Some(BsdfGradient::RoughConductor(d)) => {
            out.add(cells.of(MaterialValue::SpecularReflectance), d.reflectance);
            out.add(cells.of(MaterialValue::Alpha), number(d.alpha[0] + d.alpha[1]));
            out.add(cells.of(MaterialValue::AlphaU), number(d.alpha[0]));
            out.add(cells.of(MaterialValue::AlphaV), number(d.alpha[1]));
        }
        _ => {}
    }
}

/// The sum of what is there.
#[inline(always)]
fn sum<T: Add<Output = T>>(a: Option<T>, b: Option<T>) -> Option<T> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a + b),
        (a, b) => a.or(b),
    }
}

/// A gradient of one channel.
#[inline(always)]
fn number(g: f32) -> Vec3f {
    Vec3f { x: g, y: 0.0, z: 0.0 }
}

/// Takes up gradients of a library material.
pub(super) struct Texels<'a> {
    pub(super) out: &'a mut Accumulator,
    pub(super) layout: &'a Layout,
    pub(super) material: u32,
}

impl SampleSink for Texels<'_> {
    fn factors(&mut self, base_color: Vec3f, roughness: f32, metallic: f32, emissive: Vec3f) {
        let cells = &self.layout.materials[self.material as usize];
        self.out.add(cells.of(MaterialValue::BaseColor), base_color);
        self.out.add(cells.of(MaterialValue::Roughness), number(roughness));
        self.out.add(cells.of(MaterialValue::Metallic), number(metallic));
        self.out.add(cells.of(MaterialValue::Emissive), emissive);
    }

    fn texel(&mut self, texture: usize, texel: usize, gradient: Vec3f) {
        self.out.add(offset(self.layout.textures[texture], texel), gradient);
    }
}

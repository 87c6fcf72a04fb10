//! Materials with what does not depend on the point worked out.

use super::parts::{BsdfSource, Material};
use crate::PathtraceError;
use crate::error::{absent, invalid};
use photofit_scalar::{Vec3f, Vec4f, vec2, vec3};
use photofit_scene::graph::{SurfaceGraph, SurfaceNode};
use photofit_scene::{ExtensionSample, SurfaceLibrary, SurfaceSample};
use photofit_shading::Surface;
use photofit_shading::bsdf::{Bsdf, Diffuse, Energy, MetallicRoughness, Null, TransportMode};
use std::sync::Arc;

/// A material with what does not depend on the point worked out.
#[derive(Clone, Debug)]
pub(crate) struct CompiledMaterial {
    /// Index in the library; `None` for uniform materials.
    pub(crate) library: Option<usize>,
    /// A tree that has to be resolved.
    pub(crate) graph: Option<Arc<SurfaceGraph>>,
    /// The BSDF everywhere, where nothing varies.
    pub(super) bsdf: Bsdf<f32>,
    /// Emission that is added to what the library says.
    pub(crate) added: Vec3f,
    /// Emission everywhere, where nothing varies.
    pub(crate) emission: Vec3f,
    /// Emission (or the whole material) has to be looked up.
    pub(crate) varies: bool,
    /// Something may pass.
    pub(crate) alpha: bool,
    /// Base colours are shown as they are.
    pub(crate) unlit: bool,
    pub(crate) both_sides: bool,
    /// The frame turns to the viewer.
    pub(crate) two_sided: bool,
    /// Some point of it may emit.
    pub(crate) emits: bool,
    pub(crate) absorption: Vec3f,
    /// The surface bounds a solid: inside, its absorption replaces that of the solids around.
    pub(crate) solid: bool,
    /// Camera rays pass through its back.
    pub(crate) culled: bool,
    pub(crate) transmits: bool,
    /// The surface is not there.
    pub(crate) is_null: bool,
    /// A thin pane in a world with bounded media: what passes straight through is not scattered.
    pub(crate) pane: bool,
}

impl CompiledMaterial {
    /// Whether normals of vertices on the other side than that of the triangle are turned. Those of glTF materials are not, as
    /// rasterizers do not, but for glass, through which light must find its way.
    #[inline(always)]
    pub(crate) fn turns_normals(&self) -> bool {
        self.library.is_none() || self.transmits
    }

    /// All materials of a world; `bounded`: in which surfaces bound media.
    pub(super) fn all(
        materials: &[Material],
        library: Option<&SurfaceLibrary>,
        energy: Energy,
        bounded: bool,
    ) -> Result<Vec<Self>, PathtraceError> {
        let compile = |(i, m)| {
            let mut out = Self::new(i, m, library, energy)?;
            out.find_pane(bounded);
            Ok(out)
        };
        materials.iter().enumerate().map(compile).collect()
    }

    pub(crate) fn new(
        index: usize,
        material: &Material,
        library: Option<&SurfaceLibrary>,
        energy: Energy,
    ) -> Result<Self, PathtraceError> {
        let place = || format!("material {index}");
        for (name, v) in [("emission", material.emission), ("absorption", material.absorption)] {
            if !(v.is_finite() && v.x >= 0.0 && v.y >= 0.0 && v.z >= 0.0) {
                return Err(invalid(
                    place(),
                    format!("{name} is {:?}; it must be finite and not negative", v.to_array()),
                ));
            }
        }
        let added = material.emission;
        let emits = added != Vec3f::zero();
        let common = Self {
            library: None,
            graph: None,
            bsdf: Bsdf::Null(Null),
            added,
            emission: added,
            varies: false,
            alpha: false,
            unlit: false,
            both_sides: material.emits_both_sides,
            two_sided: material.two_sided,
            emits,
            absorption: material.absorption,
            solid: material.solid || material.absorption != Vec3f::zero(),
            culled: false,
            transmits: false,
            is_null: false,
            pane: false,
        };
        match &material.scattering {
            BsdfSource::Uniform(bsdf) => {
                let is_null = matches!(bsdf, Bsdf::Null(_));
                let solid = common.solid || refracts(bsdf);
                Ok(Self { bsdf: *bsdf, transmits: bsdf.transmits(), is_null, solid, ..common })
            }
            BsdfSource::Graph(graph) => Ok(Self::of_graph(common, graph)),
            BsdfSource::Library { index } => {
                let (known, library) = (library, library.filter(|l| *index < l.materials()));
                let count = known.map_or(0, SurfaceLibrary::materials);
                let library = library
                    .ok_or_else(|| invalid(place(), absent(format!("library material {index}"), count)))?;
                let (zero, white) = (vec2(0.0, 0.0), Vec4f::splat(1.0));
                let sample = library.lookup(*index, zero, zero, white, None);
                let extensions = library.extensions(*index, zero, zero, None);
                let bsdf = library_bsdf(&sample, extensions.as_ref(), vec3(0.0, 0.0, 1.0), energy);
                let anisotropic = extensions.is_some_and(|e| e.anisotropy > 0.0);
                let transmits = bsdf.transmits() || library.may_transmit(*index);
                Ok(Self {
                    library: Some(*index),
                    bsdf,
                    emission: added + glow(&sample),
                    varies: anisotropic || !library.is_constant(*index),
                    alpha: !library.is_opaque(*index),
                    unlit: sample.unlit,
                    emits: emits || library.may_emit(*index),
                    culled: material.single_sided && !(transmits && common.solid),
                    transmits,
                    ..common
                })
            }
        }
    }
}

impl CompiledMaterial {
    fn of_graph(common: Self, graph: &Arc<SurfaceGraph>) -> Self {
        let emission = graph.emission.as_ref();
        let glow = emission.map_or(Some(Vec3f::zero()), |e| e.constant());
        let transmits = graph.root.transmits();
        let emits = common.emits || emission.is_some();
        match (graph.root.constant(), glow) {
            (Some((bsdf, two_sided)), Some(glow)) if !graph.root.needs_partials() => {
                let added = common.added + glow;
                let is_null = matches!(bsdf, Bsdf::Null(_));
                let solid = common.solid || refracts(&bsdf);
                Self { bsdf, two_sided, transmits, emits, is_null, solid, added, emission: added, ..common }
            }
            _ => Self {
                graph: Some(graph.clone()),
                varies: true,
                alpha: graph.root.opacity().is_some(),
                transmits,
                emits,
                solid: common.solid || is_boundary(&graph.root),
                ..common
            },
        }
    }

    /// Marks a pane of thin glass as one, if surfaces of the world bound media.
    pub(crate) fn find_pane(&mut self, bounded: bool) {
        self.pane = bounded
            && match &self.graph {
                None => self.library.is_none() && matches!(self.bsdf, Bsdf::ThinDielectric(_)),
                Some(graph) => {
                    matches!(graph.root, SurfaceNode::Dielectric { base: Bsdf::ThinDielectric(_), .. })
                }
            };
    }

    /// The BSDF everywhere, where nothing varies.
    pub(crate) fn uniform(&self) -> &Bsdf<f32> {
        &self.bsdf
    }

    /// What the table of emitting triangles knows of it, the textures aside.
    pub(crate) fn shining(&self) -> (bool, bool, bool, bool, Vec3f) {
        (self.emits, self.both_sides, self.varies, self.unlit, self.emission)
    }

    /// Whether the path through it has to be followed: it absorbs, or is a boundary alone.
    pub(crate) fn absorbs(&self) -> bool {
        self.is_null || self.absorption != Vec3f::zero()
    }
}

/// Whether a tree bounds a refracting solid.
fn is_boundary(root: &SurfaceNode) -> bool {
    match root {
        SurfaceNode::Dielectric { base, .. } => refracts(base),
        SurfaceNode::Principled(_) => root.transmits(),
        _ => false,
    }
}

/// Whether a surface bounds a refracting solid.
fn refracts(bsdf: &Bsdf<f32>) -> bool {
    match bsdf {
        Bsdf::Dielectric(_) | Bsdf::RoughDielectric(_) => true,
        Bsdf::Principled(_) => bsdf.transmits(),
        _ => false,
    }
}

/// What a library material sends out: its emission, and the base colour of unlit ones.
pub(super) fn glow(sample: &SurfaceSample) -> Vec3f {
    sample.emissive + if sample.unlit { sample.base_color } else { Vec3f::zero() }
}

/// The BSDF of a library material at a point; `coat` is the normal of the coat in the frame of the shading normal.
#[inline(never)]
pub(super) fn library_bsdf(
    sample: &SurfaceSample,
    extensions: Option<&ExtensionSample>,
    coat: Vec3f,
    energy: Energy,
) -> Bsdf<f32> {
    if sample.unlit {
        return Bsdf::Diffuse(Diffuse { reflectance: Vec3f::zero() });
    }
    if let Some(e) = extensions {
        return e.parameters(sample, coat, energy, TransportMode::Radiance).bsdf();
    }
    let surface = Surface {
        base_color: sample.base_color,
        roughness: sample.roughness,
        metallic: sample.metallic,
        gamma: 0.0,
    };
    Bsdf::MetallicRoughness(MetallicRoughness::new(&surface, energy))
}

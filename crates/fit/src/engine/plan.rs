//! The plan: which passes a fit runs and which gradients flow, derived from the asset ("skip what a scene doesn't
//! need").

use super::reference::ReferenceRenderer;
use crate::candidate::Candidate;
use crate::simplify::SimplifyOptions;
use photofit_raster::deferred::Passes;
use photofit_raster::{CHANNELS, channel};
use photofit_scene::{AlphaMode, Scene};
use std::fmt;

/// A sample that varies less than this over the baked maps is constant: one step of 8 bits.
const CONSTANT: f32 = 1.0 / 255.0;

/// What runs; printable and comparable.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Depth layers that are looked for.
    pub layers: usize,
    /// Alpha of blended surfaces is fitted.
    pub blend: bool,
    /// Some surfaces are cut out by an alpha mask.
    pub mask: bool,
    /// Normal maps are read, perturbed and fitted.
    pub normal_map: bool,
    /// Metalness is fitted.
    pub metallic: bool,
    /// Emission is read and fitted.
    pub emissive: bool,
    /// Positions are fitted: silhouettes, normals and tangents have gradients.
    pub positions: bool,
    /// Whether each sample of a texel is fitted; one that is the same everywhere in the baked maps is not.
    pub fitted: [bool; CHANNELS],
    /// Pictures of the reference are path traced; the base colour is fitted then even where it is constant.
    pub path_traced: bool,
    /// Textures of the reference that are read, out of those in the file.
    pub textures: (usize, usize),
}

impl Plan {
    /// Derives the plan of a fit.
    pub fn new(scene: &Scene, candidate: &Candidate, options: &SimplifyOptions) -> Self {
        let base = &candidate.maps.levels[0].texels;
        let any = |c: usize, f: &dyn Fn(f32) -> bool| base.iter().any(|t| f(t[c]));
        let emissive = (0..3).any(|k| any(channel::EMISSIVE + k, &|x| x > 1e-4));
        let metallic = any(channel::METALLIC, &|x| x > 0.02);
        let used = |mode: fn(&AlphaMode) -> bool| {
            candidate.class.iter().any(|c| mode(&candidate.classes[*c as usize]))
        };
        let blend = used(|m| *m == AlphaMode::Blend);
        let mask = used(|m| matches!(m, AlphaMode::Mask { .. }));
        let varies = |c: usize| {
            let (lo, hi) = base.iter().fold((f32::MAX, f32::MIN), |(lo, hi), t| (lo.min(t[c]), hi.max(t[c])));
            hi - lo > CONSTANT
        };
        let mut fitted = [false; CHANNELS];
        let path_traced = options.reference == ReferenceRenderer::Path;
        fitted[..3].fill(path_traced || (0..3).any(varies));
        // Alpha of glass is drawn, but not written.
        fitted[channel::ALPHA] = blend && scene.materials.iter().any(|m| m.alpha_mode == AlphaMode::Blend);
        fitted[channel::ROUGHNESS] = varies(channel::ROUGHNESS);
        fitted[channel::METALLIC] = metallic && varies(channel::METALLIC);
        fitted[channel::NORMAL..channel::NORMAL + 3].fill(true);
        fitted[channel::EMISSIVE..channel::EMISSIVE + 3].fill(emissive);
        let mut read: Vec<usize> = scene
            .materials
            .iter()
            .flat_map(|m| {
                [m.base_color_texture, m.metallic_roughness_texture, m.normal_texture, m.emissive_texture]
            })
            .flatten()
            .map(|t| t.image)
            .collect();
        read.sort_unstable();
        read.dedup();
        Self {
            layers: if blend || mask { Passes::default().max_layers } else { 1 },
            blend,
            mask,
            normal_map: true,
            metallic,
            emissive,
            positions: options.steps > 0,
            fitted,
            path_traced,
            textures: (read.len(), scene.images.len()),
        }
    }

    /// The passes of the renderer.
    pub fn passes(&self) -> Passes {
        Passes {
            normal_map: self.normal_map,
            emissive: self.emissive,
            antialias: true,
            max_layers: self.layers,
            position_gradients: self.positions,
            map_gradients: true,
            energy: photofit_shading::Energy::Single,
        }
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut line = |what: &str, runs: bool, why: &str| {
            writeln!(f, "  {} {what:<22} {why}", if runs { "run " } else { "skip" })
        };
        let alpha = match (self.mask, self.blend) {
            (false, false) => "every surface is opaque: one layer, no blending",
            (true, false) => "alpha masks: layers until nothing shows through",
            (false, true) => "blended surfaces: layers until nothing shows through",
            (true, true) => "masks and blended surfaces: layers until nothing shows through",
        };
        line("transparent layers", self.layers > 1, alpha)?;
        line(
            "alpha gradients",
            self.blend,
            if self.blend { "blended surfaces" } else { "nothing is blended" },
        )?;
        line("normal map", self.normal_map, "detail of the reference goes into normals")?;
        line(
            "metalness gradients",
            self.metallic,
            if self.metallic { "metals" } else { "no metal in the baked maps" },
        )?;
        line("emission", self.emissive, if self.emissive { "emitting texels" } else { "nothing emits" })?;
        line(
            "position gradients",
            self.positions,
            if self.positions { "silhouettes and normals move" } else { "no steps" },
        )?;
        line("silhouette search", true, "only where neighbouring pixels show different triangles")?;
        line("volumes", false, "the asset has none")?;
        let indirect = if self.path_traced {
            "pictures of the reference are path traced"
        } else {
            "pictures of the reference are rasterized"
        };
        line("indirect light", self.path_traced, indirect)?;
        writeln!(
            f,
            "  {} of {CHANNELS} samples of a texel are fitted; the others are constant or unused",
            self.fitted.iter().filter(|f| **f).count()
        )?;
        write!(f, "  {} of {} textures of the reference are read", self.textures.0, self.textures.1)
    }
}

//! `bsdf` elements.

use super::Importer;
use super::material_data;
use super::spectrum::Meaning;
use crate::error::{Fault, fault};
use crate::graph::{
    MAX_GRAPH_DEPTH, PrincipledTextures, PrincipledThinTextures, Roughness, SurfaceNode, Texture,
};
use crate::load::clip;
use photofit_scalar::Vec3f;
use photofit_shading::bsdf::{
    Bsdf, Dielectric, Diffuse, Distribution, Masking, Microfacet, Null, Plastic, RoughDielectric,
    RoughPlastic, ThinDielectric, TransportMode,
};

/// Alpha of rough surfaces that do not say theirs.
const ALPHA: f32 = 0.1;

/// What stands in the place of a surface that is not supported; nothing is rendered then.
fn black() -> SurfaceNode {
    SurfaceNode::Constant(Bsdf::Diffuse(Diffuse { reflectance: Vec3f::zero() }))
}

impl Importer {
    /// A BSDF with everything inside it.
    pub(super) fn bsdf(&mut self, element: usize, depth: usize) -> Result<SurfaceNode, Fault> {
        if depth > MAX_GRAPH_DEPTH {
            let rule = format!("BSDFs are nested more than {MAX_GRAPH_DEPTH} deep; that many are accepted");
            return Err(fault(self.reader.place(element), rule));
        }
        let kind = self.reader.kind(element).to_owned();
        let node = match kind.as_str() {
            "diffuse" => SurfaceNode::Diffuse {
                reflectance: self.texture(element, "reflectance", Meaning::Reflectance, 0.5)?,
            },
            "conductor" => self.conductor(element, false)?,
            "roughconductor" => self.conductor(element, true)?,
            "dielectric" | "thindielectric" | "roughdielectric" => self.dielectric(element, &kind)?,
            "plastic" | "roughplastic" => self.plastic(element, kind == "roughplastic")?,
            "principled" => self.principled(element)?,
            "principledthin" => self.principled_thin(element)?,
            "null" => SurfaceNode::Constant(Bsdf::Null(Null)),
            "twosided" => self.two_sided(element, depth)?,
            "mask" => {
                let opacity = self.texture(element, "opacity", Meaning::Reflectance, 0.5)?;
                let inner = self.inner(element, depth, 1)?.swap_remove(0);
                match opacity.constant() {
                    Some(c) if c == Vec3f::splat(1.0) => inner,
                    _ => SurfaceNode::Mask { opacity, inner: Box::new(inner) },
                }
            }
            "blendbsdf" => self.blend(element, depth)?,
            "bumpmap" => {
                let scale = self.reader.float(element, "scale")?.unwrap_or(1.0) as f32;
                let height = self.nested_texture(element)?;
                let inner = Box::new(self.inner(element, depth, 1)?.swap_remove(0));
                SurfaceNode::Bump { height, scale, inner }
            }
            "normalmap" => {
                let map = self.nested_texture(element)?;
                let inner = Box::new(self.inner(element, depth, 1)?.swap_remove(0));
                SurfaceNode::NormalMap { map, inner }
            }
            _ => {
                let title = self.reader.title(element);
                self.reader.unsupported(element, title);
                self.reader.mark_all(element);
                black()
            }
        };
        self.reader.finish(element);
        Ok(node.simplified())
    }

    /// The BSDFs inside of another, `count` of them at most.
    fn inner(&mut self, element: usize, depth: usize, count: usize) -> Result<Vec<SurfaceNode>, Fault> {
        let nested = self.reader.nested(element, "bsdf")?;
        if nested.is_empty() || nested.len() > count {
            let rule = format!("has {} BSDFs inside; it must have 1 to {count}", nested.len());
            return Err(fault(self.reader.place(element), rule));
        }
        nested.into_iter().map(|(_, e)| self.bsdf(e, depth + 1)).collect()
    }

    /// The only texture inside of a BSDF, whatever its name.
    fn nested_texture(&mut self, element: usize) -> Result<Texture, Fault> {
        let nested = self.reader.nested(element, "texture")?;
        match nested[..] {
            [(_, e)] => self.texture_of(e, Meaning::Unbounded, 0),
            _ => {
                Err(fault(self.reader.place(element), "has no texture or several; it must have one texture"))
            }
        }
    }

    fn two_sided(&mut self, element: usize, depth: usize) -> Result<SurfaceNode, Fault> {
        let mut inner = self.inner(element, depth, 2)?;
        if inner.iter().any(|n| n.transmits()) {
            return Err(fault(
                self.reader.place(element),
                "a BSDF inside transmits; only opaque BSDFs may be two-sided",
            ));
        }
        let back = if inner.len() == 2 { inner.pop().map(Box::new) } else { None };
        Ok(SurfaceNode::TwoSided { front: Box::new(inner.swap_remove(0)), back })
    }

    fn blend(&mut self, element: usize, depth: usize) -> Result<SurfaceNode, Fault> {
        let weight = self.texture(element, "weight", Meaning::Unbounded, 0.5)?;
        let inner = self.inner(element, depth, 2)?;
        let leaf = |n: &SurfaceNode| {
            !matches!(
                n,
                SurfaceNode::Blend { .. }
                    | SurfaceNode::Mask { .. }
                    | SurfaceNode::TwoSided { .. }
                    | SurfaceNode::Bump { .. }
                    | SurfaceNode::NormalMap { .. }
            )
        };
        if !inner.iter().all(leaf) {
            self.reader.unsupported(
                element,
                "bsdf `blendbsdf` of twosided, mask, bumpmap, normalmap or blendbsdf (put these around it)",
            );
            return Ok(black());
        }
        match <Box<[SurfaceNode; 2]>>::try_from(inner.into_boxed_slice()) {
            Ok(inner) => Ok(SurfaceNode::Blend { weight, inner }),
            Err(_) => Err(fault(self.reader.place(element), "the blendbsdf has one BSDF; it must have two")),
        }
    }

    /// An index of refraction: a number or a name.
    fn ior(&mut self, element: usize, name: &str, default: &str) -> Result<f64, Fault> {
        if let Some(x) = self.reader.float(element, name)? {
            return Ok(x);
        }
        let text = self.reader.string(element, name)?.unwrap_or_else(|| default.to_owned());
        material_data::ior(&text).ok_or_else(|| {
            fault(
                self.reader.place(element),
                format!("the substance `{}` is unknown; it must be one of the reference's", clip(&text)),
            )
        })
    }

    /// Index of the inside over that of the outside.
    fn relative_ior(&mut self, element: usize, inside: &str) -> Result<f32, Fault> {
        let (inner, outer) = (self.ior(element, "int_ior", inside)?, self.ior(element, "ext_ior", "air")?);
        let ratio = inner / outer;
        if inner > 0.0 && outer > 0.0 && (1e-3..=1e3).contains(&ratio) {
            return Ok(ratio as f32);
        }
        let rule = format!("indices of refraction are {inner} and {outer}; they must be positive");
        Err(fault(self.reader.place(element), rule))
    }

    fn rough(&mut self, element: usize) -> Result<Roughness, Fault> {
        let distribution = match self.reader.string(element, "distribution")?.as_deref() {
            None | Some("beckmann") => Distribution::Beckmann,
            Some("ggx") => Distribution::Ggx,
            Some(other) => {
                let rule = format!("the distribution is `{}`; it must be beckmann or ggx", clip(other));
                return Err(fault(self.reader.place(element), rule));
            }
        };
        // Sampling only.
        self.reader.ignore(element, &["sample_visible"]);
        let both = self.optional_texture(element, "alpha", Meaning::Unbounded)?;
        let mut axis = |name: &str| -> Result<Texture, Fault> {
            let own = self.optional_texture(element, name, Meaning::Unbounded)?;
            Ok(own.or_else(|| both.clone()).unwrap_or_else(|| Texture::number(ALPHA)))
        };
        let (alpha_u, alpha_v) = (axis("alpha_u")?, axis("alpha_v")?);
        let surface =
            Microfacet { distribution, masking: Masking::Separable, alpha_x: ALPHA, alpha_y: ALPHA };
        Ok(Roughness { surface, alpha_u, alpha_v })
    }

    fn conductor(&mut self, element: usize, rough: bool) -> Result<SurfaceNode, Fault> {
        let name = self.reader.string(element, "material")?;
        let (eta, k) = match &name {
            Some(name) => {
                let known = material_data::conductor(name);
                let (eta, k) = known.ok_or_else(|| {
                    fault(
                        self.reader.place(element),
                        format!(
                            "the conductor `{}` is unknown; it must be one of the reference's",
                            clip(name)
                        ),
                    )
                })?;
                (Texture::Constant(Vec3f::from_array(eta)), Texture::Constant(Vec3f::from_array(k)))
            }
            None => (
                self.texture(element, "eta", Meaning::Unbounded, 0.0)?,
                self.texture(element, "k", Meaning::Unbounded, 1.0)?,
            ),
        };
        let reflectance = self.texture(element, "specular_reflectance", Meaning::Reflectance, 1.0)?;
        let rough = if rough { Some(self.rough(element)?) } else { None };
        Ok(SurfaceNode::Conductor { eta, k, reflectance, rough })
    }

    fn dielectric(&mut self, element: usize, kind: &str) -> Result<SurfaceNode, Fault> {
        let ior = self.relative_ior(element, "bk7")?;
        let reflectance = self.texture(element, "specular_reflectance", Meaning::Reflectance, 1.0)?;
        let transmittance = self.texture(element, "specular_transmittance", Meaning::Reflectance, 1.0)?;
        let one = Vec3f::splat(1.0);
        let glass = Dielectric { ior, reflectance: one, transmittance: one, mode: TransportMode::Radiance };
        let (base, rough) = match kind {
            "dielectric" => (Bsdf::Dielectric(glass), None),
            "thindielectric" => {
                let pane = ThinDielectric { ior, reflectance: one, transmittance: one };
                (Bsdf::ThinDielectric(pane), None)
            }
            _ => {
                let rough = self.rough(element)?;
                let surface = rough.surface;
                (Bsdf::RoughDielectric(RoughDielectric { glass, surface }), Some(rough))
            }
        };
        Ok(SurfaceNode::Dielectric { base, reflectance, transmittance, rough })
    }

    fn plastic(&mut self, element: usize, rough: bool) -> Result<SurfaceNode, Fault> {
        let ior = self.relative_ior(element, "polypropylene")?;
        if ior < 1.0 {
            return Err(fault(
                self.reader.place(element),
                "the plastic is thinner than what surrounds it; it must be denser",
            ));
        }
        let diffuse = self.texture(element, "diffuse_reflectance", Meaning::Reflectance, 0.5)?;
        let specular = self.texture(element, "specular_reflectance", Meaning::Reflectance, 1.0)?;
        let nonlinear = self.reader.boolean(element, "nonlinear", false)?;
        let (half, one) = (Vec3f::splat(0.5), Vec3f::splat(1.0));
        if !rough {
            let base = Plastic::new(half, one, ior, nonlinear);
            return Ok(SurfaceNode::Plastic { base, diffuse, specular });
        }
        let rough = self.rough(element)?;
        let alpha = match (rough.alpha_u.constant(), rough.alpha_v.constant()) {
            (Some(u), Some(v)) if u == v => u.x,
            _ => {
                self.reader.unsupported(element, "a textured or anisotropic alpha of bsdf `roughplastic`");
                ALPHA
            }
        };
        let surface = Microfacet { alpha_x: alpha, alpha_y: alpha, ..rough.surface };
        let base = Box::new(RoughPlastic::like_mitsuba(half, one, ior, nonlinear, surface));
        Ok(SurfaceNode::RoughPlastic { base, diffuse, specular })
    }

    fn principled(&mut self, element: usize) -> Result<SurfaceNode, Fault> {
        let place = self.reader.place(element);
        let (own, specular) = (self.reader.float(element, "eta")?, self.reader.float(element, "specular")?);
        let eta = match (own, specular) {
            (Some(_), Some(_)) => return Err(fault(place, "has eta and specular; it must have one of them")),
            (Some(eta), None) => eta,
            (None, s) => {
                let s = s.unwrap_or(0.5);
                if !(0.0..=1.0).contains(&s) {
                    return Err(fault(place, format!("specular is {s}; it must lie in [0, 1]")));
                }
                2.0 / (1.0 - (0.08 * s).sqrt()) - 1.0
            }
        };
        if !(1e-3..=1e3).contains(&eta) {
            return Err(fault(place, format!("eta is {eta}; it must be positive")));
        }
        self.reader.ignore(
            element,
            &["diffuse_reflectance_sampling_rate", "main_specular_sampling_rate", "clearcoat_sampling_rate"],
        );
        let mut get = |name: &str, default: f32| self.texture(element, name, Meaning::Reflectance, default);
        let textures = PrincipledTextures {
            base_color: get("base_color", 0.5)?,
            roughness: get("roughness", 0.5)?,
            anisotropic: get("anisotropic", 0.0)?,
            metallic: get("metallic", 0.0)?,
            spec_trans: get("spec_trans", 0.0)?,
            spec_tint: get("spec_tint", 0.0)?,
            sheen: get("sheen", 0.0)?,
            sheen_tint: get("sheen_tint", 0.0)?,
            flatness: get("flatness", 0.0)?,
            clearcoat: get("clearcoat", 0.0)?,
            clearcoat_gloss: get("clearcoat_gloss", 0.0)?,
            eta: eta as f32,
        };
        Ok(SurfaceNode::Principled(Box::new(textures)))
    }

    fn principled_thin(&mut self, element: usize) -> Result<SurfaceNode, Fault> {
        let eta = self.reader.float(element, "eta")?.unwrap_or(1.5);
        if !(eta > 1.0 && eta <= 1e3) {
            let rule = format!("eta is {eta}; it must be greater than 1");
            return Err(fault(self.reader.place(element), rule));
        }
        self.reader.ignore(
            element,
            &[
                "diffuse_reflectance_sampling_rate",
                "diffuse_transmittance_sampling_rate",
                "specular_reflectance_sampling_rate",
                "specular_transmittance_sampling_rate",
            ],
        );
        // Light that is let through diffusely, of 2 in all.
        let diff_trans = self.texture(element, "diff_trans", Meaning::Unbounded, 0.0)?;
        if let Texture::Constant(c) = &diff_trans
            && c.to_array().iter().any(|x| *x > 2.0)
        {
            let rule = format!("diff_trans is {:?}; it must lie in [0, 2]", c.to_array());
            return Err(fault(self.reader.place(element), rule));
        }
        let mut get = |name: &str, default: f32| self.texture(element, name, Meaning::Reflectance, default);
        let textures = PrincipledThinTextures {
            base_color: get("base_color", 0.5)?,
            roughness: get("roughness", 0.5)?,
            anisotropic: get("anisotropic", 0.0)?,
            spec_trans: get("spec_trans", 0.0)?,
            diff_trans,
            spec_tint: get("spec_tint", 0.0)?,
            sheen: get("sheen", 0.0)?,
            sheen_tint: get("sheen_tint", 0.0)?,
            flatness: get("flatness", 0.0)?,
            eta: eta as f32,
        };
        Ok(SurfaceNode::PrincipledThin(Box::new(textures)))
    }
}

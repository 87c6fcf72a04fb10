//! The values of parameters: read, and replaced in place. What a gradient is taken with respect to is what is read here,
//! in the same order.

use super::layout::Layout;
use super::parameter::{MaterialValue, Parameter, library_material};
use crate::PathtraceError;
use crate::error::invalid;
use crate::world::{BsdfSource, Material, World};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::SurfaceLibrary;
use photofit_scene::graph::{SurfaceGraph, Texture};
use photofit_shading::bsdf::Bsdf;
use std::sync::Arc;

impl World {
    /// The values of a parameter, as [`crate::ParameterGradient`] counts them: channels of one value after the other.
    /// Textures of trees that hold numbers repeat them in all three channels.
    ///
    /// # Errors
    /// As [`crate::Adjoint::new`]; if materials or textures that share the parameter hold different values.
    pub fn parameter(&self, parameter: &Parameter) -> Result<Vec<f32>, PathtraceError> {
        Layout::new(self, std::slice::from_ref(parameter))?;
        Ok(match parameter {
            Parameter::Material { materials, value } => {
                let read = |m: &usize| self.material_value(*m, *value);
                shared(materials, read, |m| format!("{value:?} of material {m}"))?
            }
            Parameter::Texels { texture } => {
                let base = self.library.iter().flat_map(|l| l.texture(*texture).linear_base());
                base.flat_map(|t| [t[0], t[1], t[2]]).collect()
            }
            Parameter::Graph { places } => {
                let read = |[m, t]: &[usize; 2]| {
                    let textures = self.materials[*m].graph.as_ref().map_or_else(Vec::new, |g| g.textures());
                    texels(textures[*t])
                };
                shared(places, read, |[m, t]| format!("texture {t} of material {m}"))?
            }
            Parameter::Light { light } => self.lights.given()[*light].flux().to_array().to_vec(),
            Parameter::Environment => {
                let map = self.lights.environment.as_ref().map(|e| e.map());
                map.map(|m| m.image.data).unwrap_or_default()
            }
            Parameter::Medium { medium, value } => self.media.values(*medium, *value),
            Parameter::Positions { .. } => Vec::new(),
        })
    }

    /// Replaces the values of a parameter, which are read by [`Self::parameter`]; nothing else is built again
    /// but the upper bounds of an extinction.
    ///
    /// # Errors
    /// As [`crate::Adjoint::new`], if their number is another one, or a value is not valid where it stands (negative
    /// radiance, not finite).
    pub fn set_parameter(&mut self, parameter: &Parameter, values: &[f32]) -> Result<(), PathtraceError> {
        let range = Layout::new(self, std::slice::from_ref(parameter))?.ranges[0];
        check_count(values, range.cells * range.channels)?;
        self.take_values(parameter, values)
    }

    /// As [`Self::set_parameter`], of a parameter that is there and its number of values.
    fn take_values(&mut self, parameter: &Parameter, values: &[f32]) -> Result<(), PathtraceError> {
        if let Some(i) = values.iter().position(|v| !v.is_finite()) {
            return Err(invalid(format!("value {i}"), format!("is {}; it must be finite", values[i])));
        }
        match parameter {
            Parameter::Material { materials, value } => {
                materials.iter().try_for_each(|m| self.set_material_value(*m, *value, values))
            }
            Parameter::Texels { texture } => {
                let old = self.library.as_ref().map(|l| l.texture(*texture).linear_base());
                let mut texels = old.unwrap_or_default();
                for (t, v) in texels.iter_mut().zip(values.chunks_exact(3)) {
                    t[..3].copy_from_slice(v);
                }
                self.set_texels(*texture, &texels)
            }
            Parameter::Graph { places } => places.iter().try_for_each(|p| self.set_graph(*p, values)),
            Parameter::Light { light } => {
                let mut sources = self.lights.given().to_vec();
                *sources[*light].flux_mut() = triple(values);
                // The environment stays as it is, bit by bit.
                self.set_sources(&sources)
            }
            Parameter::Environment => {
                let map = self.lights.environment.as_ref().map(|e| {
                    let mut map = e.map();
                    map.image.data.copy_from_slice(values);
                    map
                });
                self.set_environment(map)
            }
            Parameter::Medium { medium, value } => {
                self.media.set_values((*medium, *value), values, self.majorant_factor)
            }
            Parameter::Positions { .. } => Ok(()),
        }
    }

    /// As [`Self::set_parameter`], with values of so many channels: where the parameter has more of them, all further ones are
    /// the last.
    ///
    /// # Errors
    /// As [`Self::set_parameter`]; if the parameter has fewer channels, or `channels` is 0.
    pub fn spread_parameter(
        &mut self,
        parameter: &Parameter,
        channels: usize,
        values: &[f32],
    ) -> Result<(), PathtraceError> {
        let range = Layout::new(self, std::slice::from_ref(parameter))?.ranges[0];
        if !(1..=range.channels).contains(&channels) {
            let rule = format!("are {channels}; they must be 1 to {}", range.channels);
            return Err(invalid("channels", rule));
        }
        check_count(values, range.cells * channels)?;
        if channels == range.channels {
            return self.take_values(parameter, values);
        }
        let cells = values.chunks_exact(channels);
        let spread = cells.flat_map(|v| (0..range.channels).map(|c| v[c.min(channels - 1)]));
        self.take_values(parameter, &spread.collect::<Vec<f32>>())
    }

    fn material_value(&self, index: usize, value: MaterialValue) -> Vec<f32> {
        let compiled = &self.materials[index];
        let factors =
            library_material(&self.given[index]).and_then(|m| self.library.as_ref().map(|l| l.factors(m)));
        let color = match (value, compiled.uniform()) {
            (MaterialValue::Reflectance, Bsdf::Diffuse(d)) => d.reflectance,
            (MaterialValue::SpecularReflectance, Bsdf::RoughConductor(c)) => c.metal.reflectance,
            (MaterialValue::Alpha | MaterialValue::AlphaU, Bsdf::RoughConductor(c)) => {
                return vec![c.surface.alpha_x];
            }
            (MaterialValue::AlphaV, Bsdf::RoughConductor(c)) => return vec![c.surface.alpha_y],
            (MaterialValue::Emission, _) => compiled.added,
            (MaterialValue::Absorption, _) => compiled.absorption,
            _ => match (value, factors) {
                (MaterialValue::BaseColor, Some(f)) => f.base_color,
                (MaterialValue::Emissive, Some(f)) => f.emissive,
                (MaterialValue::Roughness, Some(f)) => return vec![f.roughness],
                (MaterialValue::Metallic, Some(f)) => return vec![f.metallic],
                _ => Vec3f::zero(),
            },
        };
        color.to_array().to_vec()
    }

    fn set_material_value(
        &mut self,
        index: usize,
        value: MaterialValue,
        values: &[f32],
    ) -> Result<(), PathtraceError> {
        if let Some(m) = library_material(&self.given[index])
            && !matches!(value, MaterialValue::Emission | MaterialValue::Absorption)
        {
            let exchange = |library: &mut SurfaceLibrary, values: &mut Vec<f32>| {
                let mut f = library.factors(m);
                match value {
                    MaterialValue::BaseColor => exchange_color(&mut f.base_color, values),
                    MaterialValue::Emissive => exchange_color(&mut f.emissive, values),
                    MaterialValue::Roughness => std::mem::swap(&mut f.roughness, &mut values[0]),
                    _ => std::mem::swap(&mut f.metallic, &mut values[0]),
                }
                library.set_factors(m, &f);
            };
            let glows = |_: &SurfaceLibrary, i| i == m && value == MaterialValue::Emissive;
            return self.exchange_in_library(&mut values.to_vec(), exchange, glows);
        }
        let mut material = self.uniform_material(index);
        match (value, &mut material.scattering) {
            (MaterialValue::Reflectance, BsdfSource::Uniform(Bsdf::Diffuse(d))) => {
                d.reflectance = triple(values);
            }
            (MaterialValue::SpecularReflectance, BsdfSource::Uniform(Bsdf::RoughConductor(c))) => {
                c.metal.reflectance = triple(values);
            }
            (MaterialValue::Alpha, BsdfSource::Uniform(Bsdf::RoughConductor(c))) => {
                (c.surface.alpha_x, c.surface.alpha_y) = (values[0], values[0]);
            }
            (MaterialValue::AlphaU, BsdfSource::Uniform(Bsdf::RoughConductor(c))) => {
                c.surface.alpha_x = values[0];
            }
            (MaterialValue::AlphaV, BsdfSource::Uniform(Bsdf::RoughConductor(c))) => {
                c.surface.alpha_y = values[0];
            }
            (MaterialValue::Emission, _) => material.emission = triple(values),
            (MaterialValue::Absorption, _) => material.absorption = triple(values),
            _ => {}
        }
        self.set_material(index, &material)
    }

    /// A material as it was given; a tree that is the same everywhere becomes its BSDF.
    fn uniform_material(&self, index: usize) -> Material {
        let (given, compiled) = (&self.given[index], &self.materials[index]);
        match given.scattering {
            BsdfSource::Graph(_) if compiled.graph.is_none() => Material {
                scattering: BsdfSource::Uniform(*compiled.uniform()),
                two_sided: compiled.two_sided,
                emission: compiled.added,
                ..given.clone()
            },
            _ => given.clone(),
        }
    }

    fn set_graph(&mut self, [m, t]: [usize; 2], values: &[f32]) -> Result<(), PathtraceError> {
        let mut material = self.given[m].clone();
        if let BsdfSource::Graph(graph) = &mut material.scattering {
            let mut tree = SurfaceGraph::clone(graph);
            tree.edit_texture(t, |texture| match texture {
                Texture::Constant(c) => *c = triple(values),
                Texture::Bitmap { image, .. } => Arc::make_mut(image).set_texels(values),
                _ => {}
            });
            *graph = Arc::new(tree);
        }
        self.set_material(m, &material)
    }
}

fn check_count(values: &[f32], wanted: usize) -> Result<(), PathtraceError> {
    match values.len() {
        found if found != wanted => Err(invalid("values", format!("are {found}; they must be {wanted}"))),
        _ => Ok(()),
    }
}

/// The values that all places hold.
fn shared<P>(
    places: &[P],
    read: impl Fn(&P) -> Vec<f32>,
    name: impl Fn(&P) -> String,
) -> Result<Vec<f32>, PathtraceError> {
    let values = read(&places[0]);
    match places[1..].iter().find(|p| read(p) != values) {
        None => Ok(values),
        Some(other) => {
            let rule = format!(
                "differs from {}; what shares a parameter must hold the same values",
                name(&places[0])
            );
            Err(invalid(name(other), rule))
        }
    }
}

fn exchange_color(color: &mut Vec3f, values: &mut [f32]) {
    let before = *color;
    *color = triple(values);
    values.copy_from_slice(&before.to_array());
}

fn triple(values: &[f32]) -> Vec3f {
    vec3(values[0], values[1], values[2])
}

/// Values of a constant or of an image.
fn texels(texture: &Texture) -> Vec<f32> {
    match texture {
        Texture::Constant(c) => c.to_array().to_vec(),
        Texture::Bitmap { image, .. } => image.texels(),
        _ => Vec::new(),
    }
}

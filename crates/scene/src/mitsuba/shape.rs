//! `shape` elements.

use super::grid_file::parse_distances;
use super::{Importer, MitsubaInstance, MitsubaNames, MitsubaShape, mesh};
use crate::error::{Fault, fault};
use crate::graph::{SurfaceGraph, SurfaceNode};
use crate::load::clip;
use crate::mitsuba::spectrum::Meaning;
use glam::{DAffine3, DVec3};
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::{Bsdf, Diffuse};

impl Importer {
    /// A shape at the top of the scene.
    pub(super) fn shape(&mut self, element: usize) -> Result<(), Fault> {
        let members = self.shape_instances(element, false)?;
        self.budget(element, members.len())?;
        self.scene.instances.extend(members);
        Ok(())
    }

    fn budget(&self, element: usize, more: usize) -> Result<(), Fault> {
        if self.scene.instances.len() + more > self.limits.instances {
            let rule = format!(
                "is one shape more than allowed; there may be at most {} placed shapes",
                self.limits.instances
            );
            return Err(fault(self.reader.place(element), rule));
        }
        Ok(())
    }

    /// What a shape places in the scene: itself, nothing (a group), or the members of a group.
    fn shape_instances(&mut self, element: usize, in_group: bool) -> Result<Vec<MitsubaInstance>, Fault> {
        let kind = self.reader.kind(element).to_owned();
        match kind.as_str() {
            "shapegroup" => {
                self.group(element)?;
                Ok(Vec::new())
            }
            "instance" if !in_group => self.placed_group(element),
            _ => self.simple(element, &kind).map(|i| i.into_iter().collect()),
        }
    }

    fn group(&mut self, element: usize) -> Result<(), Fault> {
        if self.groups.contains_key(&element) {
            return Ok(());
        }
        let mut members = Vec::new();
        for (_, child) in self.reader.nested(element, "shape")? {
            if self.reader.kind(child) == "shapegroup" {
                return Err(fault(self.reader.place(child), "the group stands in a group; it must not"));
            }
            members.extend(self.shape_instances(child, true)?);
            if members.iter().any(|m| self.scene.materials[m.material].emission.is_some()) {
                self.reader.unsupported(child, "an emitter inside of a shapegroup");
            }
        }
        self.reader.finish(element);
        self.groups.insert(element, members);
        Ok(())
    }

    fn placed_group(&mut self, element: usize) -> Result<Vec<MitsubaInstance>, Fault> {
        let transform = self.reader.affine(element, "to_world")?;
        let nested = self.reader.nested(element, "shape")?;
        let [(_, group)] = nested[..] else {
            return Err(fault(
                self.reader.place(element),
                "the instance refers to no shape or to several; it must refer to one shapegroup",
            ));
        };
        if self.reader.kind(group) != "shapegroup" {
            return Err(fault(
                self.reader.place(element),
                "the instance refers to another shape; it must refer to a shapegroup",
            ));
        }
        self.group(group)?;
        self.reader.finish(element);
        let members = &self.groups[&group];
        self.budget(element, members.len())?;
        Ok(members.iter().map(|m| MitsubaInstance { transform: transform * m.transform, ..*m }).collect())
    }

    /// A shape that is one thing; `None` if it is not supported.
    fn simple(&mut self, element: usize, kind: &str) -> Result<Option<MitsubaInstance>, Fault> {
        let mut transform = self.reader.affine(element, "to_world")?;
        let flip = self.reader.boolean(element, "flip_normals", false)?;
        let mut attributes = mesh::Attributes::default();
        let mut shape = match kind {
            "obj" | "ply" | "serialized" => {
                let (mesh, found) = self.mesh_file(element, kind)?;
                attributes = found;
                MitsubaShape::Mesh(mesh)
            }
            "sdfgrid" => self.distance_grid(element, flip)?,
            "rectangle" => MitsubaShape::Mesh(mesh::rectangle()),
            "cube" => MitsubaShape::Mesh(mesh::cube()),
            "disk" => MitsubaShape::Mesh(mesh::disk()),
            "cylinder" => {
                let p0 = self.reader.point(element, "p0")?.unwrap_or(DVec3::ZERO);
                let p1 = self.reader.point(element, "p1")?.unwrap_or(DVec3::Z);
                let radius = self.radius(element)?;
                MitsubaShape::Mesh(mesh::cylinder(single(p0), single(p1), radius))
            }
            "sphere" => {
                let center = single(self.reader.point(element, "center")?.unwrap_or(DVec3::ZERO));
                let radius = self.radius(element)?;
                if flip {
                    MitsubaShape::Mesh(mesh::sphere(center, radius))
                } else {
                    MitsubaShape::Sphere { center, radius }
                }
            }
            _ => {
                let title = self.reader.title(element);
                self.reader.unsupported(element, title);
                self.reader.mark_all(element);
                return Ok(None);
            }
        };
        self.reader.ignore(element, &["silhouette_sampling_weight", "initialize_permutation"]);
        if let MitsubaShape::Mesh(m) = &mut shape {
            if matches!(kind, "obj" | "ply" | "serialized") {
                mesh::align(m);
            }
            if flip {
                mesh::flip(m);
            }
        }
        if kind == "cube" || kind == "rectangle" || kind == "disk" || kind == "cylinder" {
            // Their own meshes are small: nothing is kept but the transform.
            transform = self.checked(element, transform)?;
        }
        let (material, interior, exterior) = self.surface(element, attributes, &mut shape)?;
        self.reader.finish(element);
        if matches!(shape, MitsubaShape::DistanceGrid { .. })
            && self.scene.materials[material].emission.is_some()
        {
            self.reader.unsupported(element, "an emitter on an sdfgrid");
        }
        if let MitsubaShape::Sphere { center, radius } = shape
            && self.scene.materials[material].root.opacity().is_some()
        {
            // Coverage is looked up on triangles.
            shape = MitsubaShape::Mesh(mesh::sphere(center, radius));
        }
        self.scene.shapes.push(shape);
        Ok(Some(MitsubaInstance {
            shape: self.scene.shapes.len() - 1,
            material,
            transform,
            interior,
            exterior,
        }))
    }

    /// The grid of an `sdfgrid`.
    fn distance_grid(&mut self, element: usize, flip: bool) -> Result<MitsubaShape, Fault> {
        let place = self.reader.place(element);
        if flip {
            self.reader.unsupported(element, "flip_normals on an sdfgrid");
        }
        let normals = self.reader.string(element, "normals")?;
        let smooth = match normals.as_deref() {
            None | Some("smooth") => true,
            Some("analytic") => false,
            Some(other) => {
                let rule = format!("normals is `{}`; it must be analytic or smooth", clip(other));
                return Err(fault(place, rule));
            }
        };
        let name = self.reader.string(element, "filename")?;
        let name = name.ok_or_else(|| fault(&place, "the sdfgrid has no filename; it must have one"))?;
        let path = self.reader.document.resolve(&name, &place)?;
        let bytes = crate::load::read_file(&path, self.limits.file_bytes)
            .map_err(|e| fault(&place, e.to_string()))?;
        let (size, values) =
            parse_distances(&bytes).map_err(|rule| fault(format!("{place}: {}", path.display()), rule))?;
        self.texels += values.len() as u64;
        if self.texels > self.limits.texels {
            let rule = format!(
                "textures and grids have more than {} texels and samples together; they may have that many",
                self.limits.texels
            );
            return Err(fault(place, rule));
        }
        Ok(MitsubaShape::DistanceGrid { size, values, smooth })
    }

    fn checked(&self, element: usize, transform: DAffine3) -> Result<DAffine3, Fault> {
        let m = transform.matrix3;
        if m.x_axis == DVec3::ZERO || m.y_axis == DVec3::ZERO {
            return Err(fault(
                self.reader.place(element),
                "the shape is flattened by its transform; it must have an extent",
            ));
        }
        Ok(transform)
    }

    fn radius(&mut self, element: usize) -> Result<f32, Fault> {
        let radius = self.reader.float(element, "radius")?.unwrap_or(1.0) as f32;
        if radius > 0.0 {
            Ok(radius)
        } else {
            Err(fault(self.reader.place(element), "the radius is not positive; it must be"))
        }
    }

    /// Material and media of a shape.
    fn surface(
        &mut self,
        element: usize,
        attributes: mesh::Attributes,
        shape: &mut MitsubaShape,
    ) -> Result<(usize, Option<usize>, Option<usize>), Fault> {
        let bsdfs = self.reader.nested(element, "bsdf")?;
        let emitters = self.reader.nested(element, "emitter")?;
        if bsdfs.len() > 1 || emitters.len() > 1 {
            let rule = "the shape has several BSDFs or emitters; it may have one of each";
            return Err(fault(self.reader.place(element), rule));
        }
        let (bsdf, emitter) = (bsdfs.first().map(|b| b.1), emitters.first().map(|e| e.1));
        let (mut interior, mut exterior) = (None, None);
        for (name, medium) in self.reader.nested(element, "medium")? {
            let index = self.medium(medium, element, &format!("{name}_medium"))?;
            match name.as_str() {
                "interior" => interior = index,
                "exterior" => exterior = index,
                _ => {
                    let rule =
                        "the medium of the shape has another name; it must be named interior or exterior";
                    return Err(fault(self.reader.place(medium), rule));
                }
            }
        }
        let key = (bsdf, emitter);
        if let Some(&known) = self.materials.get(&key) {
            return Ok((known, interior, exterior));
        }
        self.uses_attributes = false;
        self.attributes = matches!(shape, MitsubaShape::Mesh(_)).then_some(attributes);
        let emission = match emitter {
            Some(e) => self.area(e)?,
            None => None,
        };
        let root = match bsdf {
            Some(b) => self.bsdf(b, 0)?,
            None => {
                // Emitters without a BSDF are black.
                let grey = Vec3f::splat(if emitter.is_some() { 0.0 } else { 0.5 });
                SurfaceNode::Constant(Bsdf::Diffuse(Diffuse { reflectance: grey }))
            }
        };
        let material = self.scene.materials.len();
        let shape_name = self.name(element, || format!("shape_{material}"));
        let of = |part: Option<usize>, kind: &str| match part {
            Some(e) => self.name(e, || format!("{shape_name}.{kind}")),
            None => String::new(),
        };
        let bsdf = if bsdf.is_some() { of(bsdf, "bsdf") } else { format!("{shape_name}.bsdf") };
        let names = MitsubaNames { bsdf, emitter: of(emitter, "emitter") };
        self.scene.names.push(names);
        self.scene.materials.push(SurfaceGraph { root, emission });
        let attributes = self.attributes.take();
        if !self.uses_attributes {
            self.materials.insert(key, material);
        } else if let (Some(a), MitsubaShape::Mesh(m)) = (attributes, shape) {
            m.colors = mesh::colors(&a);
        }
        Ok((material, interior, exterior))
    }

    /// The id of an element, or what it is called without one.
    pub(super) fn name(&self, element: usize, otherwise: impl FnOnce() -> String) -> String {
        let id = &self.reader.document.elements[element].id;
        if id.is_empty() { otherwise() } else { id.clone() }
    }

    /// Radiance of an `area` emitter.
    fn area(&mut self, element: usize) -> Result<Option<crate::graph::Texture>, Fault> {
        if self.reader.kind(element) != "area" {
            let title = self.reader.title(element);
            self.reader.unsupported(element, format!("{title} on a shape"));
            return Ok(None);
        }
        let radiance = self.texture(element, "radiance", Meaning::Emission, 1.0)?;
        self.reader.ignore(element, &["sampling_weight"]);
        self.reader.finish(element);
        Ok((radiance.constant() != Some(Vec3f::zero())).then_some(radiance))
    }
}

fn single(v: DVec3) -> Vec3f {
    vec3(v.x as f32, v.y as f32, v.z as f32)
}

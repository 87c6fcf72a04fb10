//! Parts of a world that are replaced alone: geometry, materials, media (lights: [`World::relight`]). Only new geometry
//! builds hierarchies.
//!
//! An edited world renders the same bits as one that is built with the new parts.

use super::instance::Placed;
use super::material::CompiledMaterial;
use super::shape::Stored;
use super::top::Earlier;
use super::{BsdfSource, Geometry, Instance, Material, Shape, World, check_indices, radius};
use crate::PathtraceError;
use crate::error::{absent, invalid};
use crate::volume::{BoundedMedium, InteriorMedium, Medium, MediumRef, MediumValue, Volume};
use photofit_scene::SurfaceLibrary;

impl World {
    /// Replaces all shapes and where they stand; materials, lights and media stay.
    ///
    /// # Errors
    /// As [`World::new`] for shapes and instances, or if instances come or go in a world with bounded media, whose
    /// boundaries name them, or a surface that bounds a medium gets cut-outs. The world is then as it was.
    pub fn set_geometry(&mut self, shapes: Vec<Shape>, instances: &[Instance]) -> Result<(), PathtraceError> {
        check_indices(instances, shapes.len(), self.materials.len())?;
        if self.media.is_bounded() && instances.len() != self.placed.len() {
            let (count, found) = (self.placed.len(), instances.len());
            let rule = format!("{found}; boundaries of media name instances, so there must be {count}");
            return Err(invalid("instances", rule));
        }
        let new = Geometry::new(shapes, instances, self.merge)?;
        self.take_geometry(new)
    }

    /// From the next pose on, every shape has a hierarchy of its own ([`crate::WorldOptions::merge`]): that pose builds
    /// them, later ones those of deformed shapes alone.
    pub fn keep_apart(&mut self) {
        self.merge = false;
    }

    /// Moves the instances, and deforms some shapes: those named are replaced. Hierarchies are built of what changed alone:
    /// of deformed shapes, and of all that are merged into one structure ([`crate::WorldOptions::merge`]) where one of
    /// these moved. Returns how many were built; the tree over instances, which always is, does not count.
    ///
    /// # Errors
    /// As [`Self::set_geometry`], or if an instance shows another shape or has another material than before, or a shape is not there.
    pub fn set_pose(
        &mut self,
        shapes: Vec<(usize, Shape)>,
        instances: &[Instance],
    ) -> Result<usize, PathtraceError> {
        check_indices(instances, self.shapes.len(), self.materials.len())?;
        let same = |(now, p): (&Instance, &Placed)| {
            (now.shape, now.material) == (p.shape as usize, p.material as usize)
        };
        if instances.len() != self.placed.len() || !instances.iter().zip(&self.placed).all(same) {
            let rule = "their number, shapes or materials differ from those of the world; those of a pose must be the same, in their order";
            return Err(invalid("instances", rule));
        }
        let count = self.shapes.len();
        if let Some((i, _)) = shapes.iter().find(|(i, _)| *i >= count) {
            return Err(invalid("shape", absent(i, count)));
        }
        let mut new: Vec<(usize, Stored)> =
            shapes.into_iter().map(|(i, s)| Ok((i, Stored::new(i, s)?))).collect::<Result<_, _>>()?;
        let changed: Vec<usize> = new.iter().map(|(i, _)| *i).collect();
        if let Some(k) = (1..changed.len()).find(|k| changed[..*k].contains(&changed[*k])) {
            return Err(invalid("shape", format!("{} is named twice; each may be named once", changed[k])));
        }
        let mut swap = |all: &mut [Stored]| {
            new.iter_mut().for_each(|(i, s)| std::mem::swap(&mut all[*i], s));
        };
        swap(&mut self.shapes);
        let earlier = Earlier { hierarchy: &self.hierarchy, placed: &self.placed, changed: &changed };
        match Geometry::place(&self.shapes, instances, self.merge, Some(&earlier)) {
            Ok(placed) => {
                let built = placed.hierarchy.built;
                let shapes = std::mem::take(&mut self.shapes);
                self.take_geometry(Geometry { shapes, ..placed }).map(|()| built)
            }
            Err(e) => {
                swap(&mut self.shapes);
                Err(e)
            }
        }
    }

    fn take_geometry(&mut self, mut new: Geometry) -> Result<(), PathtraceError> {
        new.take_materials(&self.materials);
        if let Some(i) = (0..new.placed.len()).find(|i| new.placed[*i].alpha && self.media.bounds_medium(*i))
        {
            let rule = "it has cut-outs and bounds a medium; surfaces that bound media must be whole";
            return Err(invalid(format!("instance {i}"), rule));
        }
        (self.origin, self.bounds) = (new.origin, new.bounds);
        (self.shapes, self.placed, self.hierarchy) = (new.shapes, new.placed, new.hierarchy);
        self.media.see_from(self.origin);
        self.measure()?;
        self.collect_emitters()
    }

    /// Replaces a material on all instances that have it; what it emits becomes or ceases to be a light.
    ///
    /// # Errors
    /// If there is no such material, a value of the new one is not valid, it names a library material that is not
    /// there, or it lets rays pass parts of a surface that bounds a medium; the world is then as it was.
    pub fn set_material(&mut self, index: usize, material: &Material) -> Result<(), PathtraceError> {
        let count = self.materials.len();
        if index >= count {
            return Err(invalid("material", absent(index, count)));
        }
        if self.replace(index, material)? { self.collect_emitters() } else { Ok(()) }
    }

    /// As [`Self::set_material`]; whether lights have to be collected anew.
    fn replace(&mut self, index: usize, material: &Material) -> Result<bool, PathtraceError> {
        let mut new = CompiledMaterial::new(index, material, self.library.as_ref(), self.energy)?;
        if self.media.is_bounded() {
            new.find_pane();
        }
        let mut users = (0..self.placed.len()).filter(|i| self.placed[*i].material as usize == index);
        if let Some(i) = users.find(|i| new.alpha && self.media.bounds_medium(*i)) {
            let rule = "it has cut-outs and bounds a medium; surfaces that bound media must be whole";
            return Err(invalid(format!("instance {i}"), rule));
        }
        let gives_light = |m: &CompiledMaterial| m.emits || m.unlit;
        let lights_change = gives_light(&self.materials[index]) || gives_light(&new);
        self.materials[index] = new;
        self.given[index] = material.clone();
        self.place_material(index);
        Ok(lights_change)
    }

    /// Changes the library of textured materials in place (texels, factors), and takes up what changed.
    ///
    /// # Errors
    /// If there is no library, or a library material became invalid: masked though it bounds a medium. The library keeps
    /// its changes.
    pub fn edit_library(&mut self, edit: impl FnOnce(&mut SurfaceLibrary)) -> Result<(), PathtraceError> {
        let library = self
            .library
            .as_mut()
            .ok_or_else(|| invalid("library", "the world has none; it must have one"))?;
        edit(library);
        let mut lights_change = false;
        for index in 0..self.given.len() {
            if matches!(self.given[index].scattering, BsdfSource::Library { .. }) {
                let material = self.given[index].clone();
                lights_change |= self.replace(index, &material)?;
            }
        }
        if lights_change { self.collect_emitters() } else { Ok(()) }
    }

    /// The library of textured materials: it knows which texture a map is ([`SurfaceLibrary::texture_of`]).
    pub fn library(&self) -> Option<&SurfaceLibrary> {
        self.library.as_ref()
    }

    /// Replaces all texels of a texture of the library: row 0 at v = 0, linear light, 32-bit floating point.
    ///
    /// # Errors
    /// As [`Self::edit_library`].
    ///
    /// # Panics
    /// If there is no such texture or it has another number of texels.
    pub fn set_texels(&mut self, texture: usize, linear: &[[f32; 4]]) -> Result<(), PathtraceError> {
        self.edit_library(|library| library.set_texels(texture, linear))
    }

    /// Replaces a volume in a box.
    ///
    /// # Errors
    /// If there is no such volume or the new one is not valid; the world is then as it was.
    pub fn set_volume(&mut self, index: usize, volume: Volume) -> Result<(), PathtraceError> {
        let count = self.media.boxes.len();
        let new = Medium::new(index, volume, self.origin, self.majorant_factor)?;
        let place = self.media.boxes.get_mut(index);
        *place.ok_or_else(|| invalid("volume", absent(index, count)))? = new;
        self.measure()
    }

    /// Replaces a medium that surfaces bound.
    ///
    /// # Errors
    /// If there is no such medium or the new one is not valid; the world is then as it was.
    pub fn set_medium(&mut self, index: usize, medium: BoundedMedium) -> Result<(), PathtraceError> {
        let count = self.media.bounded.len();
        let new = InteriorMedium::new(index, medium, self.origin, self.majorant_factor)?;
        let place = self.media.bounded.get_mut(index);
        *place.ok_or_else(|| invalid("medium", absent(index, count)))? = new;
        Ok(())
    }

    /// Replaces the density of every voxel of a volume, x fastest.
    ///
    /// # Errors
    /// If there is no such volume, the number of voxels is another, or a density is negative or not finite; the world is
    /// then as it was.
    pub fn set_density(&mut self, volume: usize, density: &[f32]) -> Result<(), PathtraceError> {
        let count = self.media.boxes.len();
        let place = self.media.boxes.get_mut(volume);
        let medium = place.ok_or_else(|| invalid("volume", absent(volume, count)))?;
        medium.set_density(volume, density, self.majorant_factor)
    }

    /// The value of [`crate::MediumValue::Extinction`] at which light across the whole medium is dimmed to 1/e: a measure
    /// for steps of it. 1 where there is no such medium.
    pub fn unit_extinction(&self, medium: MediumRef) -> f32 {
        match self.media.size(medium, MediumValue::Extinction) {
            Ok(_) => self.media.unit_extinction(medium, self.across(medium)),
            Err(_) => 1.0,
        }
    }

    /// Length across a medium: of the largest box around an instance that it fills, or across the world where none does.
    fn across(&self, medium: MediumRef) -> f32 {
        let MediumRef::Bounded(index) = medium else { return 2.0 * self.radius };
        let length = |i: usize| {
            let p = &self.placed[i];
            let [lo, hi] = self.shapes[p.shape as usize].bounds;
            let m = p.to_render.matrix3;
            let extent = (hi - lo).as_vec3();
            (m.x_axis.abs() * extent.x + m.y_axis.abs() * extent.y + m.z_axis.abs() * extent.z).length()
        };
        let longest = self.media.filled_by(index).map(length).fold(0.0, f32::max);
        if longest > 0.0 && longest.is_finite() { longest } else { 2.0 * self.radius }
    }

    /// What instances know of their material.
    pub(super) fn place_material(&mut self, index: usize) {
        let material = &self.materials[index];
        for p in self.placed.iter_mut().filter(|p| p.material as usize == index) {
            p.take_material(material, &self.shapes[p.shape as usize]);
        }
    }

    /// Takes up a new origin and size of the world.
    fn measure(&mut self) -> Result<(), PathtraceError> {
        self.radius = radius(self.bounds, &self.media, self.origin);
        let mut lights = std::mem::take(&mut self.lights);
        let result = lights.see_from(self);
        self.lights = lights;
        result
    }

    /// Takes up emitting surfaces whose materials have changed.
    fn collect_emitters(&mut self) -> Result<(), PathtraceError> {
        let mut lights = std::mem::take(&mut self.lights);
        let result = lights.collect_again(self);
        self.lights = lights;
        result
    }
}

//! Parts of a world that are replaced alone: geometry, materials, media (lights: [`World::relight`]). Only new geometry
//! builds hierarchies.
//!
//! An edited world renders the same bits as one that is built with the new parts.

use super::instance::Placed;
use super::material::CompiledMaterial;
use super::shape::Stored;
use super::top::Earlier;
use super::{BsdfSource, Geometry, Instance, Material, Shape, World, check_indices, count_cells, radius};
use crate::PathtraceError;
use crate::error::{absent, invalid};
use crate::volume::{Boundary, BoundedMedium, InteriorMedium, Media, Medium, MediumRef, MediumValue, Volume};
use photofit_scene::{MapKind, SurfaceLibrary};

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
        self.take_geometry(&mut Geometry::new(shapes, instances, self.merge)?)
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
        let cells = self.shapes.iter().enumerate().try_fold(0, |cells, (i, s)| count_cells(cells, i, s));
        let placed = cells.and_then(|_| Geometry::place(&self.shapes, instances, self.merge, Some(&earlier)));
        let taken = placed.and_then(|placed| {
            let built = placed.hierarchy.built;
            let mut new = Geometry { shapes: std::mem::take(&mut self.shapes), ..placed };
            let taken = self.take_geometry(&mut new);
            if taken.is_err() {
                self.shapes = new.shapes;
            }
            taken.map(|()| built)
        });
        if taken.is_err() {
            swap(&mut self.shapes);
        }
        taken
    }

    /// Takes other geometry up; on an error both are as they were.
    fn take_geometry(&mut self, new: &mut Geometry) -> Result<(), PathtraceError> {
        new.take_materials(&self.materials);
        if let Some(i) = (0..new.placed.len()).find(|i| new.placed[*i].alpha && self.media.bounds_medium(*i))
        {
            return Err(invalid(format!("instance {i}"), CUT_OUTS));
        }
        self.exchange_or_undo(new, Self::exchange_geometry, |world| {
            world.measure()?;
            world.collect_emitters()
        })
    }

    /// Exchanges a part of the world, and takes up what changed; on an error both are as they were.
    fn exchange_or_undo<T>(
        &mut self,
        part: &mut T,
        exchange: impl Fn(&mut Self, &mut T),
        take_up: impl Fn(&mut Self) -> Result<(), PathtraceError>,
    ) -> Result<(), PathtraceError> {
        exchange(self, part);
        let taken = take_up(self);
        if taken.is_err() {
            exchange(self, part);
            take_up(self)?;
        }
        taken
    }

    fn exchange_geometry(&mut self, other: &mut Geometry) {
        std::mem::swap(&mut self.origin, &mut other.origin);
        std::mem::swap(&mut self.bounds, &mut other.bounds);
        std::mem::swap(&mut self.shapes, &mut other.shapes);
        std::mem::swap(&mut self.placed, &mut other.placed);
        std::mem::swap(&mut self.hierarchy, &mut other.hierarchy);
        self.media.see_from(self.origin);
    }

    /// Replaces all materials, with the library that they name; instances keep the indices of theirs.
    ///
    /// # Errors
    /// As [`World::new`] for materials, or if an instance has a material that is no longer there, or one with cut-outs bounds
    /// a medium; the world is then as it was.
    pub fn set_materials(
        &mut self,
        materials: Vec<Material>,
        library: Option<SurfaceLibrary>,
    ) -> Result<(), PathtraceError> {
        let new = CompiledMaterial::all(&materials, library.as_ref(), self.energy, self.media.is_bounded())?;
        for (i, placed) in self.placed.iter().enumerate() {
            let (index, place) = (placed.material as usize, || format!("instance {i}"));
            let Some(material) = new.get(index) else {
                return Err(invalid(place(), absent(format!("material {index}"), new.len())));
            };
            if material.alpha && self.media.bounds_medium(i) {
                return Err(invalid(place(), CUT_OUTS));
            }
        }
        let mut other = (new, materials, library);
        self.exchange_or_undo(&mut other, Self::exchange_materials, Self::collect_emitters)
    }

    fn exchange_materials(
        &mut self,
        other: &mut (Vec<CompiledMaterial>, Vec<Material>, Option<SurfaceLibrary>),
    ) {
        std::mem::swap(&mut self.materials, &mut other.0);
        std::mem::swap(&mut self.given, &mut other.1);
        std::mem::swap(&mut self.library, &mut other.2);
        (0..self.materials.len()).for_each(|i| self.place_material(i));
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
        let (new, lights_change) = self.compiled(index, material, true)?;
        self.take_material(index, new, material.clone());
        if lights_change { self.collect_emitters() } else { Ok(()) }
    }

    /// What takes the place of a material, and whether lights have to be collected anew then. Textures that it emits
    /// through changed if `textures`.
    fn compiled(
        &self,
        index: usize,
        material: &Material,
        textures: bool,
    ) -> Result<(CompiledMaterial, bool), PathtraceError> {
        let mut new = CompiledMaterial::new(index, material, self.library.as_ref(), self.energy)?;
        new.find_pane(self.media.is_bounded());
        let mut users = (0..self.placed.len()).filter(|i| self.placed[*i].material as usize == index);
        if let Some(i) = users.find(|i| new.alpha && self.media.bounds_medium(*i)) {
            return Err(invalid(format!("instance {i}"), CUT_OUTS));
        }
        let old = &self.materials[index];
        let lights_change = (old.emits || new.emits)
            && (old.shining() != new.shining() || (textures && (old.varies || new.varies)));
        Ok((new, lights_change))
    }

    fn take_material(&mut self, index: usize, new: CompiledMaterial, given: Material) {
        self.materials[index] = new;
        self.given[index] = given;
        self.place_material(index);
    }

    /// Changes a copy of the library of textured materials (texels, factors), and takes it up.
    ///
    /// # Errors
    /// If there is no library, or a library material became invalid: masked though it bounds a medium, or gone. The world is
    /// then as it was.
    pub fn edit_library(&mut self, edit: impl FnOnce(&mut SurfaceLibrary)) -> Result<(), PathtraceError> {
        let mut other = self.library.clone().ok_or_else(no_library)?;
        edit(&mut other);
        self.exchange_in_library(&mut other, std::mem::swap, |_, _| true)
    }

    /// Exchanges a part of the library, which copies nothing; `glows` tells which materials of the library emit through it. On an
    /// error both are as they were.
    pub(crate) fn exchange_in_library<T>(
        &mut self,
        part: &mut T,
        exchange: impl Fn(&mut SurfaceLibrary, &mut T),
        glows: impl Fn(&SurfaceLibrary, usize) -> bool,
    ) -> Result<(), PathtraceError> {
        if self.library.is_none() {
            return Err(no_library());
        }
        let exchange = |world: &mut Self, part: &mut T| {
            if let Some(library) = &mut world.library {
                exchange(library, part);
            }
        };
        self.exchange_or_undo(part, exchange, |world| world.take_up_library(&glows))
    }

    /// Takes up materials of a library that changed: all, or none on an error.
    fn take_up_library(
        &mut self,
        glows: &dyn Fn(&SurfaceLibrary, usize) -> bool,
    ) -> Result<(), PathtraceError> {
        let mut all = Vec::new();
        for (index, material) in self.given.iter().enumerate() {
            if let BsdfSource::Library { index: m } = material.scattering {
                let textures = self.library.as_ref().is_some_and(|l| m < l.materials() && glows(l, m));
                all.push((index, self.compiled(index, material, textures)?, material.clone()));
            }
        }
        let lights_change = all.iter().any(|(_, (_, change), _)| *change);
        for (index, (new, _), material) in all {
            self.take_material(index, new, material);
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
    /// If there is no library or no such texture in it, their number is another, or one is not finite; the world is then
    /// as it was.
    pub fn set_texels(&mut self, texture: usize, linear: &[[f32; 4]]) -> Result<(), PathtraceError> {
        let library = self.library.as_ref().ok_or_else(no_library)?;
        let count = library.textures();
        if texture >= count {
            return Err(invalid("texture", absent(texture, count)));
        }
        let place = || format!("texture {texture}");
        let base = library.texture(texture).layout().levels()[0];
        if linear.len() != base.width as usize * base.height as usize {
            let (found, [w, h]) = (linear.len(), [base.width, base.height]);
            return Err(invalid(
                place(),
                format!("{found} texels for {w} x {h}; there must be one for each place"),
            ));
        }
        if let Some(i) = linear.as_flattened().iter().position(|v| !v.is_finite()) {
            return Err(invalid(
                place(),
                format!("texel {} is {:?}; it must be finite", i / 4, linear[i / 4]),
            ));
        }
        let emissive = |l: &SurfaceLibrary, m: usize| l.texture_of(m, MapKind::Emissive) == Some(texture);
        let mut other = library.texture(texture).with_base(linear);
        self.exchange_in_library(
            &mut other,
            |library, other| library.exchange_texture(texture, other),
            emissive,
        )
    }

    /// Replaces all media of both kinds, the surfaces that bound them, and the medium around cameras (see
    /// [`crate::Parts`]).
    ///
    /// # Errors
    /// As [`World::new`] for media; the world is then as it was.
    pub fn set_media(
        &mut self,
        volumes: Vec<Volume>,
        media: Vec<BoundedMedium>,
        boundaries: &[Boundary],
        medium_around_camera: Option<usize>,
    ) -> Result<(), PathtraceError> {
        let holes: Vec<bool> = self.placed.iter().map(|p| p.alpha).collect();
        let frame = (self.origin, self.majorant_factor);
        let boxes = Media::boxes(volumes, frame.0, frame.1)?;
        let mut other = boxes.with_bounded(media, boundaries, medium_around_camera, &holes, frame)?;
        self.exchange_or_undo(&mut other, Self::exchange_media, Self::measure)
    }

    fn exchange_media(&mut self, other: &mut Media) {
        std::mem::swap(&mut self.media, other);
        let bounded = self.media.is_bounded();
        self.materials.iter_mut().for_each(|m| m.find_pane(bounded));
    }

    /// Replaces a volume in a box.
    ///
    /// # Errors
    /// If there is no such volume or the new one is not valid; the world is then as it was.
    pub fn set_volume(&mut self, index: usize, volume: Volume) -> Result<(), PathtraceError> {
        let count = self.media.boxes.len();
        if index >= count {
            return Err(invalid("volume", absent(index, count)));
        }
        let mut other = Medium::new(index, volume, self.origin, self.majorant_factor)?;
        let exchange =
            |world: &mut Self, other: &mut Medium| std::mem::swap(&mut world.media.boxes[index], other);
        self.exchange_or_undo(&mut other, exchange, Self::measure)
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

    /// Length across a medium, in units of the world, positive; 1 where there is no such medium or nothing of it.
    pub fn length_across(&self, medium: MediumRef) -> f32 {
        let length = match self.media.size(medium, MediumValue::Extinction) {
            Ok(_) => self.media.length(medium, self.across(medium)),
            Err(_) => 1.0,
        };
        if length > 0.0 && length.is_finite() { length } else { 1.0 }
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

/// What is wrong with a surface that light may pass.
const CUT_OUTS: &str = "it has cut-outs and bounds a medium; surfaces that bound media must be whole";

fn no_library() -> PathtraceError {
    invalid("library", "the world has none; it must have one")
}

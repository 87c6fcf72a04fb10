//! What the integrators see: shapes in their places, materials, lights and media, prepared for rays.
//!
//! - A shape's hierarchy is built once, however often it is placed; shapes placed once share one hierarchy, so that
//!   most assets are traversed on one level.
//! - Light is carried in the *render frame*: a world farther off than 16 times its size is moved, in double precision and
//!   along the axes it is far off on. An offset of 1e6 costs a world of up to 1e4 no accuracy.

mod adjoint;
mod edit;
mod instance;
mod material;
mod parts;
mod scatter;
mod scene;
mod shape;
mod sphere;
mod surface;
mod top;
mod trace;

pub use parts::{BsdfSource, Instance, Material, Parts, Shape};
pub(crate) use scatter::{SurfaceMaterial, SurfaceScattering};
pub use surface::Interaction;
pub use trace::{WorldHit, WorldRay};

pub(crate) use instance::{Placed, affine, dvec3, from_glam, to_glam};
pub(crate) use shape::{Kind, Stored};

use crate::PathtraceError;
use crate::error::{absent, invalid};
use crate::light::{EnvironmentMap, LightSource, Lights};
use crate::volume::Media;
use glam::{DAffine3, DVec3};
use instance::{SIZE_MAX, SIZE_MIN};
use material::CompiledMaterial;
use photofit_rays::DistanceGrid;
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::SurfaceLibrary;
use photofit_shading::bsdf::Energy;
pub(crate) use top::moved_box;
use top::{Earlier, EntryKind, Hierarchy};

/// A scene ready to be rendered.
#[derive(Debug)]
pub struct World {
    /// Origin of the render frame in the world.
    pub(crate) origin: DVec3,
    /// The box of the instances in the world.
    bounds: [DVec3; 2],
    /// Radius of the sphere around everything.
    pub(crate) radius: f32,
    pub(crate) shapes: Vec<Stored>,
    pub(crate) placed: Vec<Placed>,
    pub(crate) hierarchy: Hierarchy,
    /// The materials as they were given.
    pub(crate) given: Vec<Material>,
    pub(crate) materials: Vec<CompiledMaterial>,
    pub(crate) library: Option<SurfaceLibrary>,
    pub(crate) lights: Lights,
    pub(crate) media: Media,
    pub(crate) energy: Energy,
    pub(crate) majorant_factor: f32,
    merge: bool,
}

/// How a world is prepared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldOptions {
    /// Shapes that are placed once share one hierarchy.
    pub merge: bool,
    /// Whether rough library materials make up for the energy that single scattering loses.
    pub energy: Energy,
    /// Factor of the upper bounds of extinction that grids are tracked with, in `[1, 1000]`: more null collisions, which
    /// make estimates of transmittance less noisy (and densities may be made larger by as much without new bounds).
    pub majorant_factor: f32,
}

impl Default for WorldOptions {
    /// Merged, with the reference model of glTF, as the rasterizer draws it, and tight bounds of extinction.
    fn default() -> Self {
        Self { merge: true, energy: Energy::default(), majorant_factor: 1.0 }
    }
}

impl World {
    /// Prepares parts with the default options.
    ///
    /// # Errors
    /// As [`Self::with_options`].
    pub fn new(parts: Parts) -> Result<Self, PathtraceError> {
        Self::with_options(parts, WorldOptions::default())
    }

    /// Prepares parts.
    ///
    /// # Errors
    /// If an index is out of range, a coordinate is not finite or too large, a transform flattens space, a light has
    /// a negative or non-finite value, or a medium is not valid.
    pub fn with_options(parts: Parts, options: WorldOptions) -> Result<Self, PathtraceError> {
        check_indices(&parts.instances, parts.shapes.len(), parts.materials.len())?;
        let factor = options.majorant_factor;
        if !(1.0..=1000.0).contains(&factor) {
            return Err(invalid("majorant factor", format!("is {factor}; it must lie in [1, 1000]")));
        }
        let mut geometry = Geometry::new(parts.shapes, &parts.instances, options.merge)?;
        let (library, bounded) = (parts.library.as_ref(), !parts.media.is_empty());
        let materials = CompiledMaterial::all(&parts.materials, library, options.energy, bounded)?;
        geometry.take_materials(&materials);
        let Geometry { origin, bounds, shapes, placed, hierarchy } = geometry;
        let holes: Vec<bool> = placed.iter().map(|p| p.alpha).collect();
        let media = Media::boxes(parts.volumes, origin, factor)?.with_bounded(
            parts.media,
            &parts.boundaries,
            parts.medium_around_camera,
            &holes,
            (origin, factor),
        )?;
        let radius = radius(bounds, &media, origin);
        let mut out = Self {
            origin,
            bounds,
            radius,
            shapes,
            placed,
            hierarchy,
            given: parts.materials,
            materials,
            library: parts.library,
            lights: Lights::default(),
            media,
            energy: options.energy,
            majorant_factor: options.majorant_factor,
            merge: options.merge,
        };
        out.lights = Lights::new(&mut out, &parts.lights, parts.environment)?;
        Ok(out)
    }

    /// Replaces the light sources and the environment; emitting surfaces stay.
    ///
    /// # Errors
    /// If a light has a negative or non-finite value; the lights are then as they were.
    pub fn relight(
        &mut self,
        sources: &[LightSource],
        environment: Option<EnvironmentMap>,
    ) -> Result<(), PathtraceError> {
        let mut lights = std::mem::take(&mut self.lights);
        let result = lights.relight(self, sources, environment);
        self.lights = lights;
        result
    }

    /// Replaces the light sources; emitting surfaces and the environment stay.
    ///
    /// # Errors
    /// If a light has a negative or non-finite value; the lights are then as they were.
    pub fn set_sources(&mut self, sources: &[LightSource]) -> Result<(), PathtraceError> {
        let mut lights = std::mem::take(&mut self.lights);
        let result = lights.replace_sources(self, sources);
        self.lights = lights;
        result
    }

    /// Replaces the environment; emitting surfaces and light sources stay.
    ///
    /// # Errors
    /// If it has a negative or non-finite value; the lights are then as they were.
    pub fn set_environment(&mut self, environment: Option<EnvironmentMap>) -> Result<(), PathtraceError> {
        self.lights.replace_environment(self.radius, environment)
    }

    /// The middle of the box of everything that has a place.
    pub fn middle(&self) -> DVec3 {
        let [mut lo, mut hi] = self.bounds;
        if let Some([a, b]) = self.media.bounds() {
            (lo, hi) = (lo.min(a + self.origin), hi.max(b + self.origin));
        }
        if lo.x <= hi.x { 0.5 * (lo + hi) } else { self.origin }
    }

    /// Number of instances.
    pub fn instances(&self) -> usize {
        self.placed.len()
    }

    /// Triangles, spheres and cells of grids that rays can meet, over all instances.
    pub fn pieces(&self) -> usize {
        self.placed.iter().map(|p| self.shapes[p.shape as usize].pieces()).sum()
    }

    /// Number of structures that rays are tested against on the upper level.
    pub fn entries(&self) -> usize {
        self.hierarchy.entries.len()
    }

    /// Whether a ray is traversed on one level.
    pub(crate) fn is_one_level(&self) -> bool {
        match self.hierarchy.entries.as_slice() {
            [] => true,
            [only] => !matches!(only.kind, EntryKind::DistanceGrid { .. }),
            _ => false,
        }
    }

    /// Bytes of geometry, instances and hierarchies.
    pub fn bytes(&self) -> usize {
        let of_shape = |s: &Stored| match &s.kind {
            Kind::Sphere { .. } => 0,
            Kind::DistanceGrid { grid, .. } => grid.bytes(),
            Kind::Mesh(m) => {
                size_of_val(m.positions.as_slice())
                    + size_of_val(m.normals.as_slice())
                    + size_of_val(m.uvs.as_slice())
                    + size_of_val(m.uvs1.as_slice())
                    + size_of_val(m.tangents.as_slice())
                    + size_of_val(m.colors.as_slice())
                    + size_of_val(m.triangles.as_slice())
            }
        };
        let facets = |s: &Stored| size_of_val(s.facets.as_slice());
        self.shapes.iter().map(|s| of_shape(s) + facets(s)).sum::<usize>()
            + size_of_val(self.placed.as_slice())
            + self.hierarchy.bytes()
            + self.lights.bytes()
    }

    /// A point of the world in the render frame.
    pub fn to_render(&self, p: DVec3) -> Vec3f {
        let q = p - self.origin;
        vec3(q.x as f32, q.y as f32, q.z as f32)
    }

    /// A point of the render frame in the world.
    pub fn to_world(&self, p: Vec3f) -> DVec3 {
        dvec3(p) + self.origin
    }
}

/// Shapes in their places, with their hierarchies.
pub(super) struct Geometry {
    origin: DVec3,
    /// The box of the instances in the world.
    bounds: [DVec3; 2],
    shapes: Vec<Stored>,
    placed: Vec<Placed>,
    hierarchy: Hierarchy,
}

impl Geometry {
    fn new(shapes: Vec<Shape>, instances: &[Instance], merge: bool) -> Result<Self, PathtraceError> {
        let mut cells = 0;
        let store = |(i, shape)| {
            let stored = Stored::new(i, shape)?;
            cells = count_cells(cells, i, &stored)?;
            Ok(stored)
        };
        let shapes: Vec<Stored> = shapes.into_iter().enumerate().map(store).collect::<Result<_, _>>()?;
        let placed = Self::place(&shapes, instances, merge, None)?;
        Ok(Self { shapes, ..placed })
    }

    /// Where shapes stand, without themselves; what `earlier` has that did not change is not built again.
    fn place(
        shapes: &[Stored],
        instances: &[Instance],
        merge: bool,
        earlier: Option<&Earlier<'_>>,
    ) -> Result<Self, PathtraceError> {
        let bounds = bounds(shapes, instances)?;
        let origin = shape::far_center(bounds);
        let mut placed = Vec::with_capacity(instances.len());
        let mut transforms = Vec::with_capacity(instances.len());
        for (i, instance) in instances.iter().enumerate() {
            let shape = &shapes[instance.shape];
            let key = (instance.shape, instance.material);
            placed.push(Placed::new(i, key, &instance.transform, shape.center, origin)?);
            let to_origin = DAffine3::from_translation(-origin);
            transforms.push(to_origin * instance.transform * DAffine3::from_translation(shape.center));
        }
        let hierarchy = Hierarchy::build(shapes, &placed, &transforms, merge, earlier)?;
        Ok(Self { origin, bounds, shapes: Vec::new(), placed, hierarchy })
    }

    /// What instances know of their materials.
    fn take_materials(&mut self, materials: &[CompiledMaterial]) {
        for p in &mut self.placed {
            p.take_material(&materials[p.material as usize], &self.shapes[p.shape as usize]);
        }
    }
}

/// The cells that the surfaces of grids pass through, up to a shape: those before it and its own.
fn count_cells(before: usize, i: usize, shape: &Stored) -> Result<usize, PathtraceError> {
    let Kind::DistanceGrid { grid, .. } = &shape.kind else { return Ok(before) };
    let (cells, most) = (before + grid.cells(), DistanceGrid::MAX_CELLS);
    if cells > most {
        let rule = format!(
            "the surfaces of grids pass through {cells} cells up to here; they may pass through {most}"
        );
        return Err(invalid(format!("shape {i}"), rule));
    }
    Ok(cells)
}

fn check_indices(instances: &[Instance], shapes: usize, materials: usize) -> Result<(), PathtraceError> {
    for (i, instance) in instances.iter().enumerate() {
        for (name, index, count) in
            [("shape", instance.shape, shapes), ("material", instance.material, materials)]
        {
            if index >= count {
                return Err(invalid(format!("instance {i}"), absent(format!("{name} {index}"), count)));
            }
        }
    }
    Ok(())
}

/// The box of all instances, each of a size that single precision can carry.
fn bounds(shapes: &[Stored], instances: &[Instance]) -> Result<[DVec3; 2], PathtraceError> {
    let mut all = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for (i, instance) in instances.iter().enumerate() {
        let place = || format!("instance {i}");
        let shape = &shapes[instance.shape];
        if shape.bounds[0].x > shape.bounds[1].x {
            continue;
        }
        if !instance.transform.is_finite() {
            return Err(invalid(place(), instance::NOT_FINITE));
        }
        let [lo, hi] =
            moved_box(shape.bounds, &(instance.transform * DAffine3::from_translation(shape.center)));
        let size = (hi - lo).max_element();
        if !(size <= SIZE_MAX && lo.abs().max(hi.abs()).max_element() <= SIZE_MAX) {
            let rule =
                format!("reaches from {lo} to {hi}; it must lie within {SIZE_MAX:.0e} units of the origin");
            return Err(invalid(place(), rule));
        }
        if size > 0.0 && size < SIZE_MIN {
            return Err(invalid(
                place(),
                format!("is {size:e} units long; it must be larger than {SIZE_MIN:.0e}"),
            ));
        }
        all = [all[0].min(lo), all[1].max(hi)];
    }
    Ok(all)
}

/// Radius of the sphere around the box of the instances and the media.
fn radius([mut lo, mut hi]: [DVec3; 2], media: &Media, origin: DVec3) -> f32 {
    if let Some([a, b]) = media.bounds() {
        (lo, hi) = (lo.min(a + origin), hi.max(b + origin));
    }
    if lo.x > hi.x {
        return 1.0;
    }
    (0.5 * (hi - lo).length() * (1.0 + 1e-6)).max(f64::from(f32::MIN_POSITIVE)) as f32
}

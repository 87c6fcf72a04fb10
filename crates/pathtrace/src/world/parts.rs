//! What a world is made of, before anything is prepared.

use crate::light::{EnvironmentMap, LightSource};
use crate::volume::{Boundary, BoundedMedium, Volume};
use glam::{DAffine3, DVec3};
use photofit_geometry::Mesh;
use photofit_scalar::Vec3f;
use photofit_scene::SurfaceLibrary;
use photofit_scene::graph::SurfaceGraph;
use photofit_shading::bsdf::Bsdf;
use std::sync::Arc;

/// A shape in its own frame.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Triangles; without normals they are flat.
    Mesh(Mesh),
    /// A sphere; the outer side is its front. `u` turns around z, `v` runs from +z to -z.
    Sphere {
        /// Centre.
        center: Vec3f,
        /// Radius, positive.
        radius: f32,
    },
    /// The zero level of a grid over the unit cube, its first and last samples on the faces; open where it reaches them.
    /// Textures are looked up at (0, 0). What it emits is found by scattering alone ([`crate::Strategy::Light`] misses it).
    DistanceGrid {
        /// Samples along x, y and z, each 2 or more.
        size: [usize; 3],
        /// Signed distances, x fastest; negative inside.
        values: Vec<f32>,
        /// Shading normals are continuous from cell to cell; else they are gradients of the interpolated distance.
        smooth: bool,
    },
}

/// A shape in its place.
#[derive(Clone, Copy, Debug)]
pub struct Instance {
    /// Index into [`Parts::shapes`].
    pub shape: usize,
    /// Index into [`Parts::materials`].
    pub material: usize,
    /// The shape's frame to the world.
    pub transform: DAffine3,
}

/// What a surface does with light.
#[derive(Clone, Debug)]
pub struct Material {
    /// How it scatters.
    pub scattering: BsdfSource,
    /// Radiance that it emits, from the front or from both sides; added to that of a library material.
    pub emission: Vec3f,
    /// Emission leaves both sides.
    pub emits_both_sides: bool,
    /// A one-sided BSDF scatters on both sides alike (library materials always do).
    pub two_sided: bool,
    /// Absorption inside the surface, per unit of length of the world (transmitting materials; zero: none).
    pub absorption: Vec3f,
    /// The surface bounds a solid though nothing is absorbed in it: inside, the absorption of solids around does not
    /// count. Absorbing and refracting surfaces do so in any case.
    pub solid: bool,
    /// Camera rays pass through the back, as single-sided materials of glTF are drawn; light and shadows still meet it.
    /// Of library materials; solids that let light through are seen from within as well.
    pub single_sided: bool,
}

/// How a surface scatters.
#[derive(Clone, Debug)]
pub enum BsdfSource {
    /// The same everywhere, with the outer side (that of the counter-clockwise winding) along +z of its frame.
    Uniform(Bsdf<f32>),
    /// Material `index` of [`Parts::library`]; both sides scatter alike, and [`Material::single_sided`] says whether
    /// camera rays see the back.
    Library {
        /// Index of the material.
        index: usize,
    },
    /// A tree of BSDFs and textures; its emission is added to that of the material. One-sided BSDFs are seen from the
    /// front.
    Graph(Arc<SurfaceGraph>),
}

impl Material {
    /// A surface that scatters in one way everywhere.
    pub fn new(bsdf: Bsdf<f32>) -> Self {
        Self::of(BsdfSource::Uniform(bsdf))
    }

    /// The same surface with emission from its front.
    #[must_use]
    pub fn emitting(self, emission: Vec3f) -> Self {
        Self { emission, ..self }
    }

    /// A tree of BSDFs and textures.
    pub fn from_graph(graph: SurfaceGraph) -> Self {
        Self::of(BsdfSource::Graph(Arc::new(graph)))
    }

    /// Material `index` of the library; emission, which the library knows, leaves both sides.
    pub fn from_library(index: usize) -> Self {
        Self { emits_both_sides: true, two_sided: true, ..Self::of(BsdfSource::Library { index }) }
    }

    /// One-sided and dark.
    fn of(scattering: BsdfSource) -> Self {
        Self {
            scattering,
            emission: Vec3f::zero(),
            emits_both_sides: false,
            two_sided: false,
            absorption: Vec3f::zero(),
            solid: false,
            single_sided: false,
        }
    }
}

/// Everything that a [`crate::World`] is made of.
#[derive(Debug, Default)]
pub struct Parts {
    /// Shapes, each once.
    pub shapes: Vec<Shape>,
    /// Placements of shapes.
    pub instances: Vec<Instance>,
    /// Materials.
    pub materials: Vec<Material>,
    /// The textured materials that [`BsdfSource::Library`] names.
    pub library: Option<SurfaceLibrary>,
    /// Lights without a surface.
    pub lights: Vec<LightSource>,
    /// Light from all around.
    pub environment: Option<EnvironmentMap>,
    /// Participating media in boxes of their own.
    pub volumes: Vec<Volume>,
    /// Participating media that surfaces bound.
    pub media: Vec<BoundedMedium>,
    /// The surfaces that bound them, each placed shape at most once (the last one counts); others leave the medium as
    /// it is.
    pub boundaries: Vec<Boundary>,
    /// The medium that cameras are in, an index into [`Self::media`]; `None`: empty space.
    pub medium_around_camera: Option<usize>,
}

impl Parts {
    /// Adds a shape with a material of its own, where it is; returns the index of the instance.
    ///
    /// ```
    /// use photofit_pathtrace::{Material, Parts, Shape, World};
    /// use photofit_scalar::{Vec3, vec3};
    /// use photofit_shading::bsdf::{Bsdf, Diffuse};
    /// let mut parts = Parts::default();
    /// let white = Bsdf::Diffuse(Diffuse { reflectance: Vec3::splat(0.5) });
    /// let ball = Shape::Sphere { center: vec3(0.0, 1.0, 0.0), radius: 1.0 };
    /// parts.add(ball, Material::new(white).emitting(Vec3::splat(0.5)));
    /// let world = World::new(parts)?;
    /// assert_eq!(world.instances(), 1);
    /// # Ok::<(), photofit_pathtrace::PathtraceError>(())
    /// ```
    pub fn add(&mut self, shape: Shape, material: Material) -> usize {
        self.shapes.push(shape);
        self.materials.push(material);
        let (shape, material) = (self.shapes.len() - 1, self.materials.len() - 1);
        self.instances.push(Instance { shape, material, transform: DAffine3::IDENTITY });
        self.instances.len() - 1
    }

    /// Moves and scales everything: a point `p` of the world goes to `factor * p + translation`.
    ///
    /// Pictures stay what they are for cameras that move along: what is measured per length (extinction, absorption)
    /// is divided by the factor, intensities of points and spots grow with its square.
    ///
    /// # Panics
    /// If the factor is not positive and finite.
    pub fn scale(&mut self, factor: f64, translation: DVec3) {
        assert!(factor > 0.0 && factor.is_finite(), "the factor is {factor}; it must be positive and finite");
        let moved = DAffine3::from_translation(translation) * DAffine3::from_scale(DVec3::splat(factor));
        let square = (factor * factor) as f32;
        self.instances.iter_mut().for_each(|i| i.transform = moved * i.transform);
        self.scale_densities((1.0 / factor) as f32);
        for light in &mut self.lights {
            if let LightSource::Point { position, intensity }
            | LightSource::Spot { position, intensity, .. }
            | LightSource::Projector { position, intensity, .. } = light
            {
                *position = moved.transform_point3(*position);
                *intensity *= square;
            }
        }
        self.volumes.iter_mut().for_each(|v| v.transform = moved * v.transform);
        for medium in &mut self.media {
            medium.extinction.transform = moved * medium.extinction.transform;
            medium.albedo.transform = moved * medium.albedo.transform;
        }
    }

    /// Multiplies all that is measured per length (extinction, absorption): for shapes that were moved to another unit of
    /// length by other means than [`Self::scale`].
    pub fn scale_densities(&mut self, factor: f32) {
        self.materials.iter_mut().for_each(|m| m.absorption *= factor);
        self.volumes.iter_mut().for_each(|v| v.scale *= factor);
        self.media.iter_mut().for_each(|m| m.scale *= factor);
    }
}

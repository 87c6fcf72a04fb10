//! Scenes of the Mitsuba 3 renderer: a subset of its XML format (feature `mitsuba`).
//!
//! Read are shapes (`obj`, `ply`, `serialized`, `sphere`, `rectangle`, `disk`, `cube`, `cylinder`,
//! `sdfgrid`, `shapegroup` and `instance`), BSDFs
//! with textures, emitters, the sensor with its film, the integrator's bounds, media, and the ways in which files name
//! each other. Everything that cannot be rendered is listed in one error, with lines.
//!
//! Mitsuba's conventions are kept: `v` of texture coordinates grows with the rows of an image, one-sided surfaces are
//! seen from the side of their shading normal, spectra become colours as in its RGB variants.

mod bsdf;
mod document;
mod emitter;
mod grid_file;
mod integrator;
mod material_data;
mod medium;
mod mesh;
mod picture;
mod pinhole;
mod projected;
mod properties;
mod sensor;
mod serialized;
mod shape;
mod spectrum;
#[cfg(test)]
mod tests;
mod texture;
mod transform;

pub use grid_file::{Grid, encode_grid, parse_grid};
pub use integrator::MitsubaIntegrator;
pub use medium::{MitsubaMedium, MitsubaVolume};
pub use sensor::{MitsubaFilm, MitsubaFilter, MitsubaSensor, Projection};

use crate::error::fault;
use crate::graph::{Bitmap, SurfaceGraph};
use crate::{Limits, PunctualLight, SceneError};
use document::Document;
use glam::{DAffine3, DMat3};
use photofit_geometry::Mesh;
use photofit_image::Image;
use photofit_scalar::Vec3f;
use photofit_texture::{Filter, Wrap};
use properties::Reader;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How a scene is read.
#[derive(Clone, Debug, Default)]
pub struct MitsubaOptions {
    /// Values of the scene's parameters (`$name`), which win over its own `default` elements.
    pub parameters: Vec<(String, String)>,
    /// Which sensor sees, in the order of the file; the first is 0.
    pub sensor: usize,
    /// Columns and rows of the picture, in place of those of the film; a crop window is dropped.
    pub size: [Option<u32>; 2],
    /// Files may lie outside of the scene's folder: in folders above it that the scene names by `..`, and in the folder
    /// right above it, where collections keep meshes that their scenes share. Only for scenes that are trusted.
    pub allow_parent_paths: bool,
    /// What is accepted.
    pub limits: Limits,
}

/// A shape in its own frame.
#[derive(Clone, Debug)]
pub enum MitsubaShape {
    /// Triangles; without normals they are flat. Triangles are wound so that their front is the side of their normals.
    Mesh(Mesh),
    /// A sphere; its outer side is its front.
    Sphere {
        /// Centre.
        center: Vec3f,
        /// Radius, positive.
        radius: f32,
    },
    /// The zero level of a grid over the unit cube (`sdfgrid`), interpolated between samples; the first and the last of each
    /// axis stand on the faces of the cube. The side of positive values is the front.
    DistanceGrid {
        /// Samples along x, y and z, each 2 or more.
        size: [usize; 3],
        /// Signed distances, x fastest: finite, some below 0 and some not.
        values: Vec<f32>,
        /// Shading normals are interpolated between cells; else they are gradients.
        smooth: bool,
    },
}

/// A shape in its place.
#[derive(Clone, Copy, Debug)]
pub struct MitsubaInstance {
    /// Index into [`MitsubaScene::shapes`].
    pub shape: usize,
    /// Index into [`MitsubaScene::materials`].
    pub material: usize,
    /// The shape's frame to the world.
    pub transform: DAffine3,
    /// Index of the medium behind the surface, into [`MitsubaScene::media`].
    pub interior: Option<usize>,
    /// Index of the medium in front of the surface.
    pub exterior: Option<usize>,
}

/// How the parts of a material are called, as Mitsuba names parameters.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MitsubaNames {
    /// The BSDF: its id, or that of the shape with `.bsdf`.
    pub bsdf: String,
    /// The emitter: its id, or that of the shape with `.emitter`; empty without one.
    pub emitter: String,
}

/// Light from all around.
#[derive(Clone, Debug)]
pub struct MitsubaEnvironment {
    /// Its id, or `environment`.
    pub name: String,
    /// Linear radiance, three channels. The direction `d` of the map's frame is found at
    /// `u = atan2(d.x, -d.z) / 2 pi`; `v = acos(d.y) / pi` runs from the middle of the first row to that of the last.
    pub image: Image,
    /// Factor of the radiance.
    pub scale: f32,
    /// From the map's frame to the world; its axes are unit vectors at right angles.
    pub to_world: DMat3,
}

/// A scene.
#[derive(Clone, Debug, Default)]
pub struct MitsubaScene {
    /// Shapes, each once.
    pub shapes: Vec<MitsubaShape>,
    /// Placed shapes.
    pub instances: Vec<MitsubaInstance>,
    /// Materials.
    pub materials: Vec<SurfaceGraph>,
    /// What the materials are called.
    pub names: Vec<MitsubaNames>,
    /// Point, directional and spot lights and projectors; the intensity of a spot falls linearly with the angle between
    /// its cones.
    pub lights: Vec<PunctualLight>,
    /// Light from all around.
    pub environment: Option<MitsubaEnvironment>,
    /// Participating media.
    pub media: Vec<MitsubaMedium>,
    /// The camera.
    pub sensor: MitsubaSensor,
    /// Sensors in the file.
    pub sensors: usize,
    /// How light is followed.
    pub integrator: MitsubaIntegrator,
    /// The XML files that were read, the scene itself first.
    pub files: Vec<PathBuf>,
    /// The meshes, pictures and grids that these name.
    pub resources: Vec<PathBuf>,
}

/// Loads a Mitsuba scene.
///
/// Files are found by paths relative to the scene's folder and the folders that its `path` elements name. They must lie in
/// the scene's folder or below (see [`MitsubaOptions::allow_parent_paths`]); absolute paths are refused.
///
/// # Errors
/// If a file cannot be read, is not valid, or exceeds a limit; [`SceneError::Unsupported`] lists what the scene has and
/// this reader does not.
pub fn load_mitsuba(path: impl AsRef<Path>, options: &MitsubaOptions) -> Result<MitsubaScene, SceneError> {
    let path = path.as_ref();
    let document = Document::read(path, options)?;
    let mut importer = Importer {
        reader: Reader::new(document),
        limits: options.limits.clone(),
        size: options.size,
        sensor: options.sensor,
        scene: MitsubaScene::default(),
        materials: HashMap::new(),
        groups: HashMap::new(),
        media: HashMap::new(),
        bitmaps: HashMap::new(),
        texels: 0,
        vertices: 0,
        attributes: None,
        uses_attributes: false,
    };
    importer.run().map_err(|f| f.in_file(path))?;
    let elements = importer.reader.take_unsupported();
    if elements.is_empty() {
        return Ok(importer.scene);
    }
    Err(SceneError::Unsupported { path: path.to_owned(), elements })
}

/// What a bitmap is decoded for: file, values as they are, wrapping and filter.
type BitmapKey = (PathBuf, bool, Wrap, Filter);

/// A scene on its way.
struct Importer {
    reader: Reader,
    limits: Limits,
    size: [Option<u32>; 2],
    sensor: usize,
    scene: MitsubaScene,
    /// Materials by BSDF and emitter elements.
    materials: HashMap<(Option<usize>, Option<usize>), usize>,
    /// Members of shape groups.
    groups: HashMap<usize, Vec<MitsubaInstance>>,
    media: HashMap<usize, usize>,
    bitmaps: HashMap<BitmapKey, Arc<Bitmap>>,
    texels: u64,
    vertices: u64,
    /// Attributes of the shape whose material is read.
    attributes: Option<mesh::Attributes>,
    /// The material that is read depends on them.
    uses_attributes: bool,
}

impl Importer {
    fn run(&mut self) -> Result<(), crate::error::Fault> {
        let top = self.reader.document.top.clone();
        let (mut sensors, mut integrator) = (Vec::new(), None);
        for &element in &top {
            match self.reader.tag(element) {
                "sensor" => sensors.push(element),
                "integrator" => integrator = integrator.or(Some(element)),
                "shape" => self.shape(element)?,
                "emitter" => self.emitter(element)?,
                // Read where something refers to them.
                "bsdf" | "texture" | "medium" | "phase" | "spectrum" | "rgb" | "volume" => {}
                _ => {
                    let what = self.reader.title(element);
                    self.reader.unsupported(element, what);
                }
            }
        }
        if let Some(element) = integrator {
            self.scene.integrator = self.integrator(element)?;
        }
        let Some(&sensor) = sensors.get(self.sensor) else {
            let rule = match sensors.len() {
                0 => "has no sensor; it must have one".to_owned(),
                1 => format!("has 1 sensor, which is 0; number {} is not there", self.sensor),
                n => format!("has {n} sensors, the first is 0; number {} is not there", self.sensor),
            };
            return Err(fault("the scene", rule));
        };
        self.scene.sensor = self.sensor(sensor)?;
        self.scene.sensors = sensors.len();
        self.scene.files = self.reader.document.files().to_vec();
        self.scene.resources = self.reader.document.named_files();
        Ok(())
    }
}

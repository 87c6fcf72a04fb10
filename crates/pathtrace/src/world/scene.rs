//! A world from an asset.

use super::{Instance, Material, Parts, Shape};
use crate::light::{Falloff, LightSource, ThrownPicture};
use glam::{Affine3A, DAffine3};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::{LightKind, PunctualLight, Scene, SurfaceLibrary};
use std::sync::Arc;

impl Parts {
    /// The surfaces of an asset, as the rasterizer shows them, and its lights; environment and media are left to the
    /// caller.
    ///
    /// Primitives are kept once, however often they are placed.
    ///
    /// # Panics
    /// If the scene is not valid (see [`Scene::validate`]).
    pub fn from_scene(scene: &Scene) -> Self {
        let shapes = (0..scene.primitives.len()).map(|i| Shape::Mesh(scene.complete_mesh(i).into_owned()));
        Self {
            shapes: shapes.collect(),
            instances: Self::instances_of(scene),
            materials: scene.materials.iter().enumerate().map(|(i, m)| material(i, m)).collect(),
            lights: scene.lights.iter().map(|l| LightSource::of_file(l, Falloff::Smooth)).collect(),
            library: Some(SurfaceLibrary::new(scene)),
            ..Self::default()
        }
    }

    /// The instances of an asset where they stand now: those of [`Self::from_scene`].
    pub fn instances_of(scene: &Scene) -> Vec<Instance> {
        let placed = |i: &photofit_scene::Instance| Instance {
            shape: i.primitive,
            material: scene.primitives[i.primitive].material,
            transform: in_double(&i.transform),
        };
        scene.instances.iter().map(placed).collect()
    }
}

fn material(index: usize, m: &photofit_scene::Material) -> Material {
    let acting = m.extensions.as_deref().filter(|_| m.transmits());
    let volume = acting.and_then(|e| e.volume.as_ref()).filter(|v| v.thickness > 0.0);
    let absorption = volume.map_or(Vec3f::zero(), |v| Vec3f::from_array(v.absorption()));
    let (solid, single_sided) = (volume.is_some(), !m.double_sided);
    Material { absorption, solid, single_sided, ..Material::from_library(index) }
}

impl LightSource {
    /// A light of a file; formats differ in how spots fade.
    ///
    /// # Panics
    /// If a projector has no picture.
    pub(crate) fn of_file(light: &PunctualLight, falloff: Falloff) -> Self {
        let intensity = Vec3f::from_array(light.intensity);
        let (position, d) = (light.position.as_dvec3(), light.direction);
        let direction = vec3(d.x, d.y, d.z);
        let picture = light.picture.clone().map(|p| Arc::new(ThrownPicture::new(p)));
        match light.kind {
            LightKind::Point => Self::Point { position, intensity },
            LightKind::Directional => Self::Directional { direction: -direction, irradiance: intensity },
            LightKind::Spot { inner, outer } => {
                Self::Spot { position, direction, intensity, inner, outer, falloff, picture }
            }
            LightKind::Projector => {
                let picture = picture.expect("a projector has a picture");
                Self::Projector { position, direction, intensity, picture }
            }
        }
    }
}

fn in_double(t: &Affine3A) -> DAffine3 {
    DAffine3::from_cols_array(&t.to_cols_array().map(f64::from))
}

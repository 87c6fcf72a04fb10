//! The asset in the frame of a fit.

use super::animated::Animated;
use super::classes::{MaterialClass, classes, drawn};
use super::views::Moment;
use crate::FitError;
use crate::bake;
use crate::candidate::SurfaceClass;
use glam::{Affine3A, DAffine3, Vec3};
use photofit_geometry::Mesh;
use photofit_scalar::Vec3f;
use photofit_scene::{AlphaMode, FlatScene, Material, Scene, SurfaceLibrary, TextureImage};
use std::borrow::Cow;

/// The reference in the frame of the fit: its bounding sphere has radius 1 about the origin.
#[derive(Debug)]
pub struct Normalised {
    /// Name of the asset.
    pub name: String,
    /// World-space geometry in the normalised frame.
    pub flat: FlatScene,
    /// Its materials.
    pub materials: Vec<Material>,
    /// Its materials, ready to be looked up.
    pub library: SurfaceLibrary,
    /// Its texture images.
    pub images: Vec<TextureImage>,
    /// The materials that the light asset will have.
    pub classes: Vec<MaterialClass>,
    /// The class of each material.
    material_class: Vec<u32>,
    /// Names of its animations.
    pub animations: Vec<String>,
    /// Centre in the asset's frame.
    pub center: Vec3f,
    /// Radius in the asset's units.
    pub radius: f32,
}

impl Normalised {
    /// Flattens and normalises a scene.
    ///
    /// # Errors
    /// A scene without a visible extent.
    pub fn new(scene: &Scene) -> Result<Self, FitError> {
        Self::over(scene, &[])
    }

    /// The same in a frame that holds the asset at all these moments, and as it stands.
    ///
    /// # Errors
    /// A scene without a visible extent or without such a moment.
    pub fn over(scene: &Scene, moments: &[Moment]) -> Result<Self, FitError> {
        let mut flat = scene.flatten();
        let moving = Animated::in_frame(scene, Vec3f::zero(), 1.0);
        let posed = moments.iter().map(|m| moving.flat(*m)).collect::<Result<Vec<_>, _>>()?;
        let meshes: Vec<&Mesh> = posed.iter().map(|p| &p.mesh).chain([&flat.mesh]).collect();
        let (center, radius) = bounding_sphere(&meshes).ok_or_else(|| FitError::Setting {
            field: "asset",
            rule: "has no triangles with an extent".into(),
        })?;
        for p in &mut flat.mesh.positions {
            *p = (*p - center) / radius;
        }
        let (classes, material_class) = classes(scene);
        let drawn = drawn(scene);
        let library = SurfaceLibrary::with_occlusion(&drawn);
        let (materials, images) = match drawn {
            Cow::Borrowed(scene) => (scene.materials.clone(), scene.images.clone()),
            Cow::Owned(scene) => (scene.materials, scene.images),
        };
        let name = scene.name.clone();
        let animations = scene.hierarchy.iter().flat_map(|h| &h.animations).map(|a| a.name.clone()).collect();
        Ok(Self {
            name,
            flat,
            materials,
            images,
            classes,
            material_class,
            library,
            animations,
            center,
            radius,
        })
    }

    /// Name of the material of a class: that of the asset's material, or of the asset where it stands for several.
    pub(crate) fn class_name(&self, class: usize) -> String {
        let mut names: Vec<&str> = self
            .materials
            .iter()
            .zip(&self.material_class)
            .filter(|(m, c)| **c as usize == class && !m.name.is_empty())
            .map(|(m, _)| m.name.as_str())
            .collect();
        names.dedup();
        match names[..] {
            [one] => one.to_owned(),
            _ => {
                let material = &self.classes[class];
                let alpha = match material.written {
                    AlphaMode::Opaque => "",
                    AlphaMode::Mask { .. } => "-mask",
                    AlphaMode::Blend => "-blend",
                };
                let unlit = if material.unlit { "-unlit" } else { "" };
                let more = material.extensions.iter().flat_map(|e| e.names()).map(|e| format!("-{e}"));
                format!("{}{alpha}{unlit}{}", self.name, more.collect::<String>())
            }
        }
    }

    /// The reference prepared for rays.
    ///
    /// # Errors
    /// Geometry that cannot be ray cast.
    pub fn surface(&self) -> Result<bake::Reference<'_>, FitError> {
        Ok(bake::Reference::new(&self.flat, &self.materials, &self.library)?)
    }

    /// From the asset's frame to the normalised one.
    pub(crate) fn to_frame(&self) -> DAffine3 {
        to_frame(self.center, self.radius)
    }

    /// Class of each triangle of the reference.
    pub(crate) fn triangle_classes(&self) -> Vec<u32> {
        self.flat.triangle_material.iter().map(|m| self.material_class[*m as usize]).collect()
    }

    /// How each class is drawn in the pictures of a fit.
    pub(crate) fn drawn_classes(&self) -> Vec<SurfaceClass> {
        self.classes.iter().map(|c| SurfaceClass { alpha: c.drawn, sides: c.sides }).collect()
    }
}

/// To a frame with this centre, in the asset's own, and this unit.
pub(super) fn to_frame(center: Vec3f, radius: f32) -> DAffine3 {
    let center = Vec3::from_array(center.to_array());
    let m = Affine3A::from_scale(Vec3::splat(1.0 / radius)) * Affine3A::from_translation(-center);
    DAffine3 { matrix3: m.matrix3.as_dmat3(), translation: m.translation.as_dvec3() }
}

/// Centre of the box around the used vertices of all meshes and the largest distance from it.
pub(super) fn bounding_sphere<'a>(meshes: &[&'a Mesh]) -> Option<(Vec3f, f32)> {
    let of = |m: &'a Mesh| m.triangles.iter().flatten().map(|i| m.positions[*i as usize]);
    let used = || meshes.iter().copied().flat_map(of);
    let first = used().next()?;
    let (lo, hi) = used().fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p)));
    let center = (lo + hi) * 0.5;
    let radius = used().map(|p| (p - center).length()).fold(0.0, f32::max);
    (radius > 0.0 && radius.is_finite()).then_some((center, radius))
}

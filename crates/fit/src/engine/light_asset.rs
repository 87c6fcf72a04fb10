//! What is known of a light asset before its mesh and its maps are.

use super::classes::{MaterialClass, classes};
use super::frame::FitFrame;
use crate::candidate::SurfaceClass;
use photofit_scene::Scene;

/// What is known of a light asset before its mesh and its maps are: what it is called, where it stands, and the materials
/// and animations that it must have.
#[derive(Clone, Debug, PartialEq)]
pub struct LightAsset {
    /// Its name.
    pub name: String,
    /// The frame in which it is fitted.
    pub frame: FitFrame,
    /// Its materials.
    pub classes: Vec<MaterialClass>,
    /// Names of its animations.
    pub animations: Vec<String>,
}

impl LightAsset {
    /// The light asset that will stand for `scene`, whose geometry is not read, and the class of each of the materials.
    pub(crate) fn of(scene: &Scene, frame: FitFrame) -> (Self, Vec<u32>) {
        let (classes, material_class) = classes(scene);
        let animations = scene.hierarchy.iter().flat_map(|h| &h.animations).map(|a| a.name.clone()).collect();
        (Self { name: scene.name.clone(), frame, classes, animations }, material_class)
    }

    /// How each class is drawn in the pictures of a fit.
    pub(crate) fn drawn_classes(&self) -> Vec<SurfaceClass> {
        let drawn = |c: &MaterialClass| SurfaceClass {
            alpha: c.drawn,
            sides: c.sides,
            opposed: c.opposed,
            see_through: c.is_see_through(),
        };
        self.classes.iter().map(drawn).collect()
    }
}

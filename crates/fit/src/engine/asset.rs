//! The asset in the frame of a fit.

use super::animated::Animated;
use super::classes::{MaterialClass, drawn};
use super::frame::FitFrame;
use super::light_asset::LightAsset;
use super::not_finite::NotFinite;
use super::views::Moment;
use crate::FitError;
use crate::bake;
use photofit_geometry::{Mesh, opposed};
use photofit_scalar::Vec3f;
use photofit_scene::{FlatScene, Material, Scene, SurfaceLibrary, TextureImage};
use std::borrow::Cow;
use std::collections::{BTreeMap, HashSet};

/// A position as a key.
pub(crate) fn bits(p: Vec3f) -> [u32; 3] {
    p.to_array().map(f32::to_bits)
}

/// The reference in the frame of the fit: its bounding sphere has radius 1 about the origin.
#[derive(Debug)]
pub struct Normalised {
    /// The light asset that will stand for it, with the frame of the fit.
    pub light_asset: LightAsset,
    /// World-space geometry in the normalised frame.
    pub flat: FlatScene,
    /// Its materials.
    pub materials: Vec<Material>,
    /// Its materials, ready to be looked up.
    pub library: SurfaceLibrary,
    /// Its texture images.
    pub images: Vec<TextureImage>,
    /// The class of each triangle.
    triangle_class: Vec<u32>,
    /// Whether the vertex normals of each triangle point to its back; empty where those of none do.
    opposed: Vec<bool>,
    /// Positions of vertices by the names of the attributes that mark them ([`Scene::vertex_attributes`]), lower case.
    marked: BTreeMap<String, HashSet<[u32; 3]>>,
    /// What path traced pictures of it and of what stands for it leave out.
    pub(crate) not_finite: NotFinite,
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
        let moving = Animated::in_frame(scene, FitFrame::WORLD);
        let posed = moments.iter().map(|m| moving.flat(*m)).collect::<Result<Vec<_>, _>>()?;
        let meshes: Vec<&Mesh> = posed.iter().map(|p| &p.mesh).chain([&flat.mesh]).collect();
        let frame = FitFrame::around(&meshes).ok_or_else(|| FitError::Setting {
            field: "asset",
            rule: "has no triangles with an extent".into(),
        })?;
        for p in &mut flat.mesh.positions {
            *p = frame.to_frame(*p);
        }
        let (light_asset, material_class) = LightAsset::of(scene, frame);
        let drawn = drawn(scene);
        let library = SurfaceLibrary::with_occlusion(&drawn);
        let (materials, images) = match drawn {
            Cow::Borrowed(scene) => (scene.materials.clone(), scene.images.clone()),
            Cow::Owned(scene) => (scene.materials, scene.images),
        };
        let mut marked = BTreeMap::new();
        for a in &scene.vertex_attributes {
            marked.entry(a.name.to_ascii_lowercase()).or_insert_with_key(|name| {
                let positions = scene.positions_with(name).unwrap_or_default();
                positions.into_iter().map(|p| bits(frame.to_frame(p))).collect()
            });
        }
        let triangle_class = flat.triangle_material.iter().map(|m| material_class[*m as usize]).collect();
        let opposed = opposed(&flat.mesh);
        let not_finite = NotFinite::default();
        Ok(Self {
            light_asset,
            flat,
            materials,
            images,
            triangle_class,
            opposed,
            library,
            marked,
            not_finite,
        })
    }

    /// The same with classes of their own for triangles whose vertex normals point to their back; also says how many there
    /// are. What is baked from the asset onto such a class is shaded as the asset is.
    pub(crate) fn with_opposed_normals(mut self) -> (Self, usize) {
        let classes = &mut self.light_asset.classes;
        let mut twins = vec![None; classes.len()];
        for (class, _) in self.triangle_class.iter_mut().zip(&self.opposed).filter(|(_, o)| **o) {
            let of = *class as usize;
            *class = *twins[of].get_or_insert_with(|| {
                classes.push(MaterialClass { opposed: true, ..classes[of].clone() });
                classes.len() as u32 - 1
            });
        }
        let count = self.opposed.iter().filter(|o| **o).count();
        (self, count)
    }

    /// Whether the vertex normals of each triangle point to its back; empty where those of none do.
    pub(crate) fn opposed(&self) -> &[bool] {
        &self.opposed
    }

    /// The positions, as keys ([`bits`]), of vertices whose attribute `name` is above one half; `None` where the asset has no such
    /// attribute.
    pub(crate) fn marked(&self, name: &str) -> Option<&HashSet<[u32; 3]>> {
        self.marked.get(&name.to_ascii_lowercase())
    }

    /// Whether an attribute marks a vertex at this position.
    pub(crate) fn is_marked(&self, p: Vec3f) -> bool {
        self.marked.values().any(|set| set.contains(&bits(p)))
    }

    /// The frame of the fit.
    pub fn frame(&self) -> FitFrame {
        self.light_asset.frame
    }

    /// The reference prepared for rays.
    ///
    /// # Errors
    /// Geometry that cannot be ray cast.
    pub fn surface(&self) -> Result<bake::ReferenceSurface<'_>, FitError> {
        Ok(bake::ReferenceSurface::new(&self.flat, &self.materials, &self.library, &self.opposed)?)
    }

    /// The classes of its triangles; the plain one of [`Self::light_asset`] may have none.
    pub(crate) fn used_classes(&self) -> Vec<&MaterialClass> {
        let mut used = vec![false; self.light_asset.classes.len()];
        self.triangle_class.iter().for_each(|c| used[*c as usize] = true);
        self.light_asset.classes.iter().zip(used).filter_map(|(c, used)| used.then_some(c)).collect()
    }

    /// Class of each triangle of the reference.
    pub(crate) fn triangle_classes(&self) -> Vec<u32> {
        self.triangle_class.clone()
    }
}
